"""Linear: sines at the resonances, for movers that the current itself pulls and pushes, such as magnets."""

import numpy as np

from padgen.physics.magnetics import impedance
from padgen.physics.selectivity import Scheme

__all__ = [
    "CURRENT",
    "FORCE_ORDER",
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

ORDER = 4
SIMPLICITY = 0
CURRENT = "linear"
FORCE_ORDER = 1
TAKES_TURNS = False
HAS_PAIR_SPURS = False


def pair_square(scheme: Scheme, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
    """Return zeros: a force in proportion to the current has no products of tones."""
    return np.zeros_like(a * b)


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
    """Return the mean of i² in A²: half the sum of squared peaks of the tones `on`; `line_a2` holds peaks in A."""
    return float((line_a2[on] ** 2).sum() / 2)


def current_lines_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> np.ndarray:
    """Return the lines (n,), which are the tones' peaks in A."""
    return line_a2


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """Return the sum in A of the tones' peaks."""
    return float(line_a2.sum())


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """Return the sum in V of the tones' peak voltages."""
    return float((line_a2 * np.abs(impedance(resistance, inductance, resonance_hz))).sum())
