"""Spur-free: the current is the square root of the wanted force, so that i² has the wanted lines and a constant."""

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

ORDER, SIMPLICITY = 1, 2
CURRENT, TAKES_TURNS, HAS_PAIR_SPURS = "root", False, False


def pair_square(scheme: Scheme, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
    """None: the root makes no spurs."""
    return np.zeros_like(a * b)


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
    """The constant F₀/c, here at its safe value (1 + headroom) Σ a, for any phases."""
    return float((1 + headroom) * line_a2[on].sum())


def current_lines_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> np.ndarray:
    """The coil's current with each channel alone on."""
    alone: np.ndarray = np.sqrt((2 + headroom) * line_a2)
    return alone


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """Root of twice the lines and the headroom."""
    return float(np.sqrt((2 + headroom) * line_a2.sum()))


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """``R √((2+h) Σa) + L √(Σ a ω²/2)``. The second is the steepest that the root can be.

    With i² = h Σa + Σ a (1 + cos θ), Cauchy's inequality takes the sum out of ``(i²)'/(2i)``.
    """
    slope = np.sqrt((line_a2 * (2 * np.pi * resonance_hz) ** 2).sum() / 2)
    return float(resistance * peak_current_a(scheme, line_a2, headroom) + inductance * slope)
