"""Biased: sines at the resonances on a constant current, `bias_ratio` times the largest of them."""

import numpy as np

from padgen.physics.magnetics import impedance
from padgen.physics.schemes import bias_a
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

ORDER = 2
SIMPLICITY = 1
CURRENT = "biased"
TAKES_TURNS = False
HAS_PAIR_SPURS = True


def pair_square(scheme: Scheme, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
    """Return the squared amplitude of the spurs of two tones, small beside the tones' products with the constant."""
    return (a * b / (2 * scheme.bias_ratio * strongest)) ** 2


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
    """Return the mean of i² in A²: of the constant current, sized for all channels on, plus that of the tones `on`."""
    return float(bias_a(scheme, line_a2) ** 2 + (current_lines_a(scheme, line_a2, headroom)[on] ** 2).sum() / 2)


def current_lines_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> np.ndarray:
    """Return the peak (n,) in A of each channel's tone."""
    bias = bias_a(scheme, line_a2)
    return line_a2 / (2 * bias) if bias else np.zeros(len(line_a2))


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """Return the sum in A of the constant and all tones."""
    return bias_a(scheme, line_a2) + float(current_lines_a(scheme, line_a2, headroom).sum())


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """Return the sum in V of the constant's voltage and all tones' voltages."""
    lines = current_lines_a(scheme, line_a2, headroom)
    volts = lines * np.abs(impedance(resistance, inductance, resonance_hz))
    return float(resistance * bias_a(scheme, line_a2) + volts.sum())
