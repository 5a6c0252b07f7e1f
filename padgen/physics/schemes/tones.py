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

ORDER = 0
SIMPLICITY = 0
CURRENT = "tones"
TAKES_TURNS = False
HAS_PAIR_SPURS = True


def pair_square(scheme: Scheme, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
    """Return the squared amplitude of two tones' spurs, ``(I_a I_b)² = 4 a b``, their lines being ``a = I_a²/2``."""
    return 4 * (a * b)


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
    """Return the mean of i² in A², which is the sum of the wanted lines of the channels `on`."""
    return float(line_a2[on].sum())


def current_lines_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> np.ndarray:
    """Return the peak (n,) in A of each channel's tone."""
    return np.sqrt(2.0 * line_a2)


def tone_volts(line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float) -> np.ndarray:
    """Return the peak voltage (n,) in V of each channel's tone, at half its resonance."""
    return np.sqrt(2.0 * line_a2) * np.abs(impedance(resistance, inductance, resonance_hz / 2))


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """Return the sum in A of the tones' peaks."""
    return float(current_lines_a(scheme, line_a2, headroom).sum())


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """Return the sum in V of the tones' peak voltages."""
    return float(tone_volts(line_a2, resonance_hz, resistance, inductance).sum())
