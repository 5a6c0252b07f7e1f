"""Measurements of a print as plain data: for each taxel a row of a table, a spectrum or a record in time."""

from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

__all__ = ["LARGEST", "SMALLEST", "Measured", "Record", "Row", "Spectrum", "nearest_id"]

SMALLEST, LARGEST = 1e-30, 1e30
"""Bounds of measured values, whose fourth powers are still floating-point numbers; smaller values count as silence."""
LONGEST_NAME = 80


@dataclass(frozen=True, slots=True)
class Row:
    """A taxel's line of a table; values that were left out are None."""

    id: str
    where: str
    resonance_hz: float
    resonance_error_hz: float | None
    q: float | None
    response_um_per_a2: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """A taxel's response (n,), complex or a magnitude, over `frequency_hz` (n,).

    It is in µm per A² of the line of i² where `absolute`, else relative.
    """

    id: str
    where: str
    frequency_hz: np.ndarray
    response: np.ndarray
    absolute: bool


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """A taxel's displacement (n,) over time, in µm where `absolute`, else relative.

    `squared_current_a2` (n,) is the coil's i², None for a free decay.
    """

    id: str
    where: str
    rate_hz: float
    displacement: np.ndarray
    squared_current_a2: np.ndarray | None
    absolute: bool


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A measurement of a print: the measured taxels in the plan's order, and the IDs of the missing ones.

    `kind` is 'table', 'spectrum', 'decay', 'driven', or 'mixed' (a folder). `stated` is True where the file says what
    its frequencies are of; then they need not be near the plan's.
    """

    kind: str
    where: str
    taxels: tuple[Row | Spectrum | Record, ...]
    missing: tuple[str, ...]
    stated: bool


def nearest_id(name: str, known: tuple[str, ...]) -> str:
    """Return the end of a sentence that names the known name most like `name`, or the first and the last one."""
    close = get_close_matches(name[:LONGEST_NAME], known, 1, 0.5)
    return f"; the nearest is {close[0]!r}" if close else f"; they run from {known[0]!r} to {known[-1]!r}"
