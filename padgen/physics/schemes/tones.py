"""Plain tones: a sum of sines at half the resonances (paper Eq. 4-5)."""

import numpy as np

from padgen.physics.magnetics import impedance
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
    "tone_volts",
]

ORDER, SIMPLICITY = 0, 0
CURRENT, TAKES_TURNS, HAS_PAIR_SPURS = "tones", False, True


def pair_square(scheme: Scheme, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
    """I_a I_b against wanted lines of I²/2, twice the geometric mean."""
    square: np.ndarray = 4 * (a * b)
    return square


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
    """Sum of the lines."""
    return float(line_a2[on].sum())


def current_lines_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> np.ndarray:
    """Each channel's tone."""
    tones: np.ndarray = np.sqrt(2.0 * line_a2)
    return tones


def tone_volts(line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float) -> np.ndarray:
    """Peak voltage (n,) in V of each channel's tone, at half its resonance."""
    volts: np.ndarray = np.sqrt(2.0 * line_a2) * np.abs(impedance(resistance, inductance, resonance_hz / 2))
    return volts


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """Sum of the tones."""
    return float(current_lines_a(scheme, line_a2, headroom).sum())


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """Sum of the tones' voltages."""
    return float(tone_volts(line_a2, resonance_hz, resistance, inductance).sum())
