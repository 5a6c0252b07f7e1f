"""The exceptions that padgen raises on purpose, findings, and the verdict.

::

    PadgenError            one sentence for the user, exit code 2
    +-- SpecError          the spec: where, value, bound, unit, cures
    |   +-- InfeasibleError    the spec is well formed, yet no pad meets it
    +-- FileError          a file or folder that cannot be read or written
    |   +-- MeshFileError      a file that holds no mesh
    |   +-- OlderPlanError     a plan.json that an older padgen wrote, which lacks what is judged today
    +-- GeometryError      a CAD or mesh kernel (OCCT, manifold) could not make a part
    +-- SolverError        a numerical model has no trustworthy answer here
        +-- EngineMissingError an optional package that a model needs is not installed

A `Finding` is one thing to say of a pad that was made, its `Verdict` is whether the pad does its job; an exception
means that none was made.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, floor, isfinite, log10
from typing import Any
from unicodedata import category

__all__ = [
    "LEVELS",
    "VERDICTS",
    "EngineMissingError",
    "FileError",
    "Finding",
    "GeometryError",
    "InfeasibleError",
    "MeshFileError",
    "OlderPlanError",
    "PadgenError",
    "SolverError",
    "SpecError",
    "Verdict",
    "about",
    "as_lines",
    "at_least",
    "at_most",
    "cured",
    "less_or_more_text",
    "listed",
    "number",
    "percent",
    "plain",
    "plural",
    "shown",
]

LONGEST = 2000
LONGEST_PART = 300
"""Most characters of a sentence; and of the place that it is about, or of one value in it."""


class PadgenError(Exception):
    """Base of all errors that end a command with one sentence and exit code 2.

    Input of the user in the sentence is shortened where it is long, and made `plain`. Each of `cures` is a change of
    the spec (fields by their dotted names; None: left out) with which this is not refused; the sentence ends with them.
    """

    code = "padgen"

    def __init__(self, message: str, where: str = "", cures: Sequence[Mapping[str, Any]] = ()) -> None:
        self.cures = tuple(cures)
        self.message = plain(cured(message, self.cures), LONGEST)
        self.where = plain(where, LONGEST_PART)
        super().__init__(self.message, self.where)

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" if self.where else self.message


class SpecError(PadgenError):
    """A field of the spec is unknown, of the wrong type or out of its bounds."""

    code = "spec"


class InfeasibleError(SpecError):
    """No layout meets the spec; the message names the limit and, if one was found, a change that helps."""

    code = "infeasible"


class FileError(PadgenError):
    """A file or folder cannot be read or written."""

    code = "file"


class MeshFileError(FileError):
    """A file given as a mesh contains no readable mesh."""

    code = "mesh"


class OlderPlanError(FileError):
    """A plan.json was written by an older padgen; callers may plan anew from the spec in it."""


class GeometryError(PadgenError):
    """A solid or mesh cannot be made, or the file to which it was written does not contain it."""

    code = "geometry"


class SolverError(PadgenError):
    """A numerical model was used outside its valid range, or did not converge."""

    code = "solver"


class EngineMissingError(SolverError):
    """An optional package is not installed; the message names the extra that installs it."""

    code = "engine"


LEVELS = ("note", "warning", "error")


@dataclass(frozen=True, slots=True)
class Finding:
    """A note, warning or error about a pad, with its code, the object that it is about, and spec changes that help.

    Parameters
    ----------
    level : {'note', 'warning', 'error'}
        An error means that the pad does not meet the spec; commands then exit with 1.
    code : str
        Stable dotted name, e.g. ``'print.gap'``.
    where : str
        The judged object: a channel, a taxel, a file.
    message : str
        One sentence with the value, its bound and the nearest value that would pass.
    cures : tuple of dict
        Changes of the spec, fields by their dotted names, that the planner has tried: with each the finding is gone and
        none is worse. The message ends with them.
    """

    level: str
    code: str
    where: str
    message: str
    cures: tuple[dict[str, Any], ...] = field(default=(), hash=False)

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise ValueError(f"level must be one of {LEVELS}, got {self.level!r}")
        object.__setattr__(self, "cures", tuple(self.cures))
        for name in ("where", "message"):
            object.__setattr__(self, name, plain(getattr(self, name), LONGEST))


VERDICTS = ("error", "short", "retune", "good")
"""Levels of a verdict, the worst first."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on a pad, in one line: whether its prints reach the asked selectivity, by how many dB, or why not.

    Parameters
    ----------
    level : {'error', 'short', 'retune', 'good'}
        The pad does not work; its prints keep less than is asked; it works once every taxel is measured and re-tuned;
        it works as printed. A finger is not counted in these: see `touched`.
    sentence : str
        The first line: the level, with its figure or the reason.
    touched : str
        What a finger does to the pad.
    limit : str
        Code of the fact that decides, as findings have it; empty where nothing limits the pad.
    cure : str
        A change of the spec, as the lines of its file, that was tried and removes that fact; empty if none was found.
    figure_db : float, optional
        The figure of the sentence: ON over OFF in dB that the asked share of prints keeps. None where no taxel hears
        another, and where the pad does not work.
    shaken : str
        What recoil leaves where the pad lies loose; empty where it does no harm, and where the spec has a mount.
    """

    level: str
    sentence: str
    touched: str
    limit: str
    cure: str
    figure_db: float | None
    shaken: str = ""

    def __post_init__(self) -> None:
        if self.level not in VERDICTS:
            raise ValueError(f"level must be one of {VERDICTS}, got {self.level!r}")
        for name in ("sentence", "touched", "shaken"):
            object.__setattr__(self, name, plain(getattr(self, name), LONGEST))

    @property
    def is_worth_printing(self) -> bool:
        """True where prints of the pad do what is asked, once they are re-tuned if need be."""
        return self.level in ("retune", "good")


def plain(text: str, most: int | None = None) -> str:
    r"""Return `text` on one line, with characters that would steer a terminal or change the writing direction escaped.

    A text of more than `most` characters loses its middle, since a sentence ends with its advice.

    >>> plain("pad\x1b[2J.stl\n"), plain("abcdefgh", 5)
    ('pad\\x1b[2J.stl\\n', 'ab…gh')
    """
    if most and len(text) > most:
        text = f"{text[: most // 2]}…{text[-(most // 2) :]}"
    if text.isprintable():
        return text
    return "".join(repr(sign)[1:-1] if category(sign) in STEERING else sign for sign in text)


STEERING = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories of characters that are escaped: control, format, surrogate, private, unassigned, separators."""


def cured(sentence: str, cures: Sequence[Mapping[str, Any]]) -> str:
    """Return `sentence` with proposed changes of the spec at its end, as lines of the spec's file.

    >>> cured("too much", [{"coil.grid": [2, 2], "washer": "iso7092-m2"}, {"coil.gap_mm": None}])
    "too much; coil.grid = [2, 2] with washer = 'iso7092-m2', or leaving out coil.gap_mm, would do"
    """
    ways = [as_lines(cure) for cure in cures]
    comma = "," if len(ways) > 1 else ""
    return f"{sentence}; {', or '.join(ways)}{comma} would do" if ways else sentence


def as_lines(cure: Mapping[str, Any]) -> str:
    """Return a spec change as text: the fields that are set, then those that are left out.

    >>> as_lines({"coil.shape": "round", "coil.outer_depth_mm": None}), as_lines({"coil.name": None, "coil.grid": None})
    ("coil.shape = 'round' without coil.outer_depth_mm", 'leaving out coil.name and coil.grid')
    """
    left_out = [key for key, value in cure.items() if value is None]
    settings = " with ".join(f"{key} = {_toml(value)}" for key, value in cure.items() if value is not None)
    if not left_out:
        return settings
    if not settings:
        return f"leaving out {listed(left_out)}"
    return f"{settings} without {listed(left_out)}"


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.10g}" if isinstance(value, float) else repr(value)


def shown(value: Any) -> str:
    """Return a value as text for a message: as Python writes it, dates as in TOML, shortened where it is long.

    >>> shown("pla"), shown(16**9999)
    ("'pla'", 'a value too large to be shown')
    """
    try:
        return plain(value.isoformat() if hasattr(value, "isoformat") else repr(value), LONGEST_PART)
    except (ValueError, RecursionError):  # thousands of digits, or thousands of nested brackets
        return "a value too large to be shown"


def number(value: float) -> str:
    """Return a number as text for a message: whole numbers in full, others with at most five significant digits.

    >>> number(4.0), number(0.123456), number(100_000)
    ('4', '0.12346', '100000')
    """
    return shown(value) if isinstance(value, int) else f"{value:.5g}"


def plural(count: float) -> str:
    """Return the plural ending of a noun after a count: empty for 1, else ``s``.

    >>> f"1 coil{plural(1)}, 2 coil{plural(2)}"
    '1 coil, 2 coils'
    """
    return "" if count == 1 else "s"


def listed(words: Sequence[str]) -> str:
    """Return words in a row, the last after an 'and'.

    >>> listed(["0"]), listed(["0", "2"]), listed(["0", "2", "4"])
    ('0', '0 and 2', '0, 2 and 4')
    """
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def about(value: float, digits: int = 2) -> str:
    """Return a number as text, rounded to `digits` significant digits.

    >>> about(4.4917), about(123.4)
    ('4.5', '120')
    """
    return number(float(f"{value:.{digits}g}"))


def percent(share: float, digits: int = 2) -> str:
    """Return a share (0.02) as text in per cent (2 %) with `digits` significant digits, ``?`` where it is unknown.

    >>> percent(0.0031), percent(0.02)
    ('0.31 %', '2 %')
    """
    return f"{about(share * 100, digits)} %" if isfinite(share) else "?"


def less_or_more_text(level_db: float) -> str:
    """Return a level difference in dB as text: ``20.9 dB less``, or ``7.3 dB more`` where it is negative.

    >>> less_or_more_text(20.94), less_or_more_text(-7.3)
    ('20.9 dB less', '7.3 dB more')
    """
    return f"{abs(level_db):.1f} dB {'less' if level_db >= 0 else 'more'}"


def at_least(value: float) -> str:
    """Return a lower bound as text with four significant digits, rounded up, so that the written value meets it.

    >>> at_least(1.11201)
    '1.113'
    """
    return _rounded_outwards(value, ceil)


def at_most(value: float) -> str:
    """Return an upper bound as text with four significant digits, rounded down, so that the written value meets it.

    >>> at_most(380.149)
    '380.1'
    """
    return _rounded_outwards(value, floor)


def _rounded_outwards(value: float, rounding: Callable[[float], int]) -> str:
    if not 1e-300 < value < 1e300:  # outside, the rounding step would overflow or be 0
        return number(value)
    step = 10.0 ** (floor(log10(value)) - 3)
    return f"{rounding(value / step) * step:.4g}"
