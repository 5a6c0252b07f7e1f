"""Sensation of vibration: thresholds by frequency and contact area, levels above them, steps that can be told apart.

A threshold is an amplitude in dB re 1 µm peak. Between its frequencies it is straight over their logarithm, between the
areas of two contactors over that of area. Contactors smaller or larger than any that is known take the nearest one's:
below 0.02 cm² area does not count (Verrillo 1963), and beyond 3 cm² nothing is known.

A sensation level (dB SL) is how far a vibration lies above its threshold. Of several lines the energies over their
thresholds add, as in the Pacinian channel (Makous, Friedman and Vierck, J. Neurosci. 15 (1995) 2808); this bounds the
loudest line from above. Masking, and what other channels add, are left out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from padgen.core.units import UM

__all__ = ["Threshold", "distinct_frequencies", "distinct_levels", "for_area", "level_db"]

UNSURE_PER_OCTAVE_DB = 6.0
"""Error that a threshold gains with each octave beyond the frequencies at which it is known: assumed."""
LEAST_HZ = 1e-3
MOST_DB = 300.0
"""Lowest frequency, and largest threshold either way, up to which a curve is continued, however steep its end is."""


class Threshold(NamedTuple):
    """Amplitudes `db` (dB re 1 µm peak) just felt at rising frequencies `hz` through a contact of `area` in m²."""

    hz: np.ndarray
    db: np.ndarray
    error_db: float
    area: float = 0.0

    def at(self, hz: np.ndarray) -> np.ndarray:
        """Return the threshold in dB re 1 µm at any frequencies, extrapolated beyond the first and last known one."""
        x = np.log2(self.hz)
        at = np.log2(np.maximum(np.asarray(hz, float), LEAST_HZ))
        piece = np.clip(np.searchsorted(x, at) - 1, 0, len(x) - 2)
        slope = (self.db[piece + 1] - self.db[piece]) / (x[piece + 1] - x[piece])
        return np.clip(self.db[piece] + slope * (at - x[piece]), -MOST_DB, MOST_DB)

    def error_at(self, hz: np.ndarray) -> np.ndarray:
        """Return the error of the threshold in dB at any frequencies; it grows outside the range of known ones."""
        hz = np.asarray(hz, float)
        octaves = np.maximum(np.log2(self.hz[0] / hz), np.log2(hz / self.hz[-1]))
        return np.asarray(self.error_db + UNSURE_PER_OCTAVE_DB * np.maximum(octaves, 0.0))

    def amplitude(self, hz: np.ndarray) -> np.ndarray:
        """Return the displacement amplitude in m that is just felt at frequencies `hz`."""
        return np.asarray(10 ** (self.at(hz) / 20) * UM)


def for_area(known: Sequence[Threshold], area: float) -> Threshold:
    """Return the threshold for a contact `area` in m²: interpolated between `known` ones or, beyond them, the nearest.

    The error is the larger of those of the two that are used.
    """
    known = sorted(known, key=lambda one: one.area)
    above = next((k for k, one in enumerate(known) if one.area >= area), len(known) - 1)
    upper = known[above]
    lower = known[above - 1] if above and area < upper.area else upper
    hz = np.array(sorted({*lower.hz.tolist(), *upper.hz.tolist()}))  # np.union1d would load all of numpy.ma
    share = 0.0 if upper is lower else float(np.log(area / lower.area) / np.log(upper.area / lower.area))
    db = lower.at(hz) + share * (upper.at(hz) - lower.at(hz))
    return Threshold(hz, db, max(lower.error_db, upper.error_db), area)


def level_db(amplitude: np.ndarray, hz: np.ndarray, threshold: Threshold) -> np.ndarray:
    """Return the sensation level, in dB above `threshold`, of `amplitude` in m at `hz`; -inf for an amplitude of 0."""
    with np.errstate(divide="ignore"):
        return 20 * np.log10(np.asarray(amplitude, float) / UM) - threshold.at(hz)


def distinct_levels(sensation_db: float, step_db: float, first_db: float | None = None) -> int:
    """Return how many felt levels up to `sensation_db` above the threshold can be told apart; 0 if it is negative.

    Each is `step_db` above the one before, the second `first_db` above the threshold.

    >>> [distinct_levels(db, 2.5, 20.0) for db in (-1.0, 5.0, 21.0, 26.0)]
    [0, 1, 2, 4]
    """
    first_db = step_db if first_db is None else first_db
    if sensation_db < 0:
        return 0
    if sensation_db < first_db:
        return 1
    return 2 + int((sensation_db - first_db) / step_db * (1 + 1e-12))


def distinct_frequencies(hz: Sequence[float], weber: float) -> int:
    """Return how many of the frequencies `hz` can be distinguished, given the just felt relative difference `weber`.

    >>> distinct_frequencies([100.0, 110.0, 130.0, 200.0], 0.2)
    3
    """
    count = 0
    last = 0.0
    for each in sorted(hz):
        if each >= last * (1 + weber):
            count += 1
            last = each
    return count
