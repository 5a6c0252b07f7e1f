"""The exceptions that padgen raises on purpose.

::

    PadgenError            one sentence for the user, exit code 2
    +-- SpecError          the spec: where, value, bound, unit, nearest value that would do
    |   +-- InfeasibleError    the spec is well formed, yet no pad meets it
    +-- FileError          a file or folder that cannot be read or written
    |   +-- MeshFileError      a file that holds no mesh
    +-- GeometryError      a CAD or mesh kernel (OCCT, manifold) could not make a part
    +-- SolverError        a numerical model has no trustworthy answer here
        +-- EngineMissingError an optional package that a model needs is not installed

Findings (`padgen.finding`) are verdicts on a pad that was made; an exception means that none was.
"""

from collections.abc import Callable
from math import ceil, floor, log10

__all__ = [
    "EngineMissingError",
    "FileError",
    "GeometryError",
    "InfeasibleError",
    "MeshFileError",
    "PadgenError",
    "SolverError",
    "SpecError",
    "at_least",
    "at_most",
    "number",
]


class PadgenError(Exception):
    """Base of all errors that end a command with one sentence and exit code 2."""

    code = "padgen"

    def __init__(self, message: str, where: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.where = where

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" if self.where else self.message


class SpecError(PadgenError):
    """A field of the spec is unknown, of the wrong type or out of its bounds."""

    code = "spec"


class InfeasibleError(SpecError):
    """No layout meets the spec; the message names the limit that binds and what would do."""

    code = "infeasible"


class FileError(PadgenError):
    """A file or folder cannot be read or written."""

    code = "file"


class MeshFileError(FileError):
    """A file given as a mesh holds none that can be read."""

    code = "mesh"


class GeometryError(PadgenError):
    """A geometry kernel refused a part."""

    code = "geometry"


class SolverError(PadgenError):
    """A numerical model was asked outside its range, or did not converge."""

    code = "solver"


class EngineMissingError(SolverError):
    """An optional package is not installed; the message names the extra that brings it."""

    code = "engine"


def number(value: float) -> str:
    """Write `value` for a sentence: whole numbers whole, others with at most five significant digits.

    >>> number(4.0), number(0.123456), number(100_000)
    ('4', '0.12346', '100000')
    """
    return str(value) if isinstance(value, int) else f"{value:.5g}"


def at_least(value: float) -> str:
    """Write the smallest value that would do, rounded up to four digits so that it does.

    >>> at_least(1.11201)
    '1.113'
    """
    return _rounded_outwards(value, ceil)


def at_most(value: float) -> str:
    """Write the largest value that would do, rounded down to four digits so that it does.

    >>> at_most(380.149)
    '380.1'
    """
    return _rounded_outwards(value, floor)


def _rounded_outwards(value: float, rounding: Callable[[float], int]) -> str:
    if value <= 0:
        return number(value)
    step = 10.0 ** (floor(log10(value)) - 3)
    return f"{rounding(value / step) * step:.4g}"
