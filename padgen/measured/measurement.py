"""`Measured`: what a lab gave of a print, as plain data: per taxel a row of a table, a spectrum or a record."""

from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

__all__ = ["LARGEST", "SMALLEST", "Measured", "Record", "Row", "Spectrum", "nearest_id"]

SMALLEST, LARGEST = 1e-30, 1e30
"""What measured values may be in size; their fourth powers are still numbers. All below is silence."""
LONGEST_NAME = 80


@dataclass(frozen=True, slots=True)
class Row:
    """A taxel's line of a table; what was left out is None."""

    id: str
    where: str
    resonance_hz: float
    resonance_error_hz: float | None
    q: float | None
    response_um_per_a2: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """A taxel's response (n,), complex or a magnitude, over `frequency_hz` (n,); `absolute`: in µm per A² of i²."""

    id: str
    where: str
    frequency_hz: np.ndarray
    response: np.ndarray
    absolute: bool


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """A taxel's displacement (n,), in µm where `absolute`; `squared_current_a2` (n,) where it was driven, else None."""

    id: str
    where: str
    rate_hz: float
    displacement: np.ndarray
    squared_current_a2: np.ndarray | None
    absolute: bool


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What was measured, in the order of the plan's taxels, and the IDs of those that were not.

    `kind` is 'table', 'spectrum', 'decay', 'driven', or 'mixed' (a folder). `stated`: the file says that its
    frequencies are those meant, so that they need not be near the plan's.
    """

    kind: str
    where: str
    taxels: tuple[Row | Spectrum | Record, ...]
    missing: tuple[str, ...]
    stated: bool


def nearest_id(name: str, known: tuple[str, ...]) -> str:
    """The end of a sentence: which of the known names is meant, if any looks like it."""
    close = get_close_matches(name[:LONGEST_NAME], known, 1, 0.5)
    return f"; the nearest is {close[0]!r}" if close else f"; they run from {known[0]!r} to {known[-1]!r}"
