"""Spur-free: the current is the root of the wanted force, so that i² has a constant and the wanted tones, no others."""

import numpy as np

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

ORDER = 1
SIMPLICITY = 2
CURRENT = "root"
TAKES_TURNS = False
HAS_PAIR_SPURS = False


def pair_square(scheme: Scheme, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
    """Return zeros, since the root makes no spurs."""
    return np.zeros_like(a * b)


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
    """Return the mean of i² in A², its constant ``(1 + headroom) Σ a`` over channels `on`, enough for any phases."""
    return float((1 + headroom) * line_a2[on].sum())


def current_lines_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> np.ndarray:
    """Return the peak (n,) in A of the coil's current with each channel alone on."""
    return np.sqrt((2 + headroom) * line_a2)


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """Return the peak current in A, ``√((2 + headroom) Σ a)``."""
    return float(np.sqrt((2 + headroom) * line_a2.sum()))


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """Return an upper bound in V of the coil's voltage, ``R √((2+h) Σa) + L √(Σ a ω²/2)``.

    With i² = h Σa + Σ a (1 + cos θ) the slope is ``(i²)'/(2i)``, which Cauchy's inequality bounds.
    """
    slope = np.sqrt((line_a2 * (2 * np.pi * resonance_hz) ** 2).sum() / 2)
    return float(resistance * peak_current_a(scheme, line_a2, headroom) + inductance * slope)
