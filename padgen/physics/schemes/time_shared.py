"""Time-shared: the channels of a coil take turns, each with a plain tone; never two at once."""

import numpy as np

from padgen.physics.schemes.tones import current_lines_a, tone_volts
from padgen.physics.selectivity import Scheme

__all__ = [
    "CURRENT",
    "HAS_PAIR_SPURS",
    "ORDER",
    "SIMPLICITY",
    "TAKES_TURNS",
    "current_lines_a",
    "mean_square_a2",
    "pair_square",
    "peak_current_a",
    "peak_voltage_v",
]

ORDER = 3
SIMPLICITY = 0
CURRENT = "tones"
TAKES_TURNS = True
HAS_PAIR_SPURS = False


def pair_square(scheme: Scheme, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
    """Return zeros, since no two channels are on at once."""
    return np.zeros_like(a * b)


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
    """Return the mean of i² in A² during the slot of the strongest channel `on`."""
    return float(line_a2[on].max(initial=0.0))


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """Return the peak in A of the largest tone."""
    return float(current_lines_a(scheme, line_a2, headroom).max(initial=0.0))


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """Return the largest peak voltage in V of a tone."""
    return float(tone_volts(line_a2, resonance_hz, resistance, inductance).max())
