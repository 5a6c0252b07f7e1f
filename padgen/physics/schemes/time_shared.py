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

ORDER, SIMPLICITY = 3, 0
CURRENT, TAKES_TURNS, HAS_PAIR_SPURS = "tones", True, False


def pair_square(scheme: Scheme, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
    """None: there are no pairs."""
    return np.zeros_like(a * b)


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
    """In the slot of the largest."""
    return float(line_a2[on].max(initial=0.0))


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """The largest tone."""
    return float(current_lines_a(scheme, line_a2, headroom).max(initial=0.0))


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """The largest of the tones' voltages."""
    return float(tone_volts(line_a2, resonance_hz, resistance, inductance).max())
