"""What a drive scheme asks of a coil and its amplifier when all channels are on.

`line_a2` (n,) are the amplitudes in A² of the wanted lines of i², one per channel.
"""

import numpy as np

from padgen.physics.magnetics import impedance
from padgen.physics.selectivity import Scheme

__all__ = [
    "FORMULAS",
    "bias_a",
    "current_lines_a",
    "mean_square_a2",
    "peak_current_a",
    "peak_voltage_v",
    "root_voltage_v",
]

FORMULAS = {
    "spur-free": "i(t) = sqrt(a0 + sum over ON channels of a_j cos(2 pi resonance_hz_j t))",
    "biased": "i(t) = B + sum over ON channels of b_j sin(2 pi resonance_hz_j t)",
    "tones": "i(t) = sum over ON channels of I_j sin(2 pi drive_hz_j t)",
    "time-shared": "i(t) = I_j sin(2 pi drive_hz_j t) in the slot of each ON channel j, one after the other",
}
"""The current of each scheme: a_j are `line_a2`, B is `bias_a`, b_j and I_j are `current_lines_a`."""


def bias_a(scheme: Scheme, line_a2: np.ndarray) -> float:
    """Constant current B in A of the biased scheme: `bias_ratio` times its largest tone ``b = a/(2B)``."""
    return float(np.sqrt(scheme.bias_ratio * line_a2.max(initial=0.0) / 2))


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray | None = None) -> float:
    """Mean of i² in A² with the channels `on` (n,), or all: times R the copper loss, times a force constant the pull.

    Biased, the constant current stays on, as for all channels, whatever is off.

    Time-shared: in the slot of the largest. Spur-free: the constant F₀/c, here at its safe value
    (1 + headroom) Σ a, for any phases.
    """
    playing = np.ones(len(line_a2), dtype=bool) if on is None else on
    if scheme.name == "tones":
        return float(line_a2[playing].sum())
    if scheme.name == "spur-free":
        return float((1 + headroom) * line_a2[playing].sum())
    if scheme.name == "biased":
        return float(bias_a(scheme, line_a2) ** 2 + (current_lines_a(scheme, line_a2)[playing] ** 2).sum() / 2)
    return float(line_a2[playing].max(initial=0.0))


def current_lines_a(scheme: Scheme, line_a2: np.ndarray, headroom: float = 0.0) -> np.ndarray:
    """Peak current (n,) in A of each channel: of its tone, or spur-free of the coil with it alone on."""
    if scheme.name == "biased":
        bias = bias_a(scheme, line_a2)
        tones: np.ndarray = line_a2 / (2 * bias) if bias else np.zeros(len(line_a2))
        return tones
    alone: np.ndarray = np.sqrt((2 + (headroom if scheme.name == "spur-free" else 0.0)) * line_a2)
    return alone


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """Largest current in A, all peaks together."""
    if scheme.name == "spur-free":
        return float(np.sqrt((2 + headroom) * line_a2.sum()))
    lines = current_lines_a(scheme, line_a2)
    if scheme.name == "biased":
        return bias_a(scheme, line_a2) + float(lines.sum())
    return float(lines.max(initial=0.0) if scheme.takes_turns else lines.sum())


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """Bound in V of what the coil asks for, all peaks together.

    Spur-free: ``R √((2+h) Σa) + L √(Σ a ω²/2)``. The second is the steepest that the root can be:
    with i² = h Σa + Σ a (1 + cos θ), Cauchy's inequality takes the sum out of ``(i²)'/(2i)``.
    """
    if scheme.name == "spur-free":
        slope = np.sqrt((line_a2 * (2 * np.pi * resonance_hz) ** 2).sum() / 2)
        return float(resistance * peak_current_a(scheme, line_a2, headroom) + inductance * slope)
    lines = current_lines_a(scheme, line_a2)
    if scheme.name == "biased":
        volts = lines * np.abs(impedance(resistance, inductance, resonance_hz))
        return float(resistance * bias_a(scheme, line_a2) + volts.sum())
    volts = lines * np.abs(impedance(resistance, inductance, resonance_hz / 2))
    return float(volts.max() if scheme.takes_turns else volts.sum())


def root_voltage_v(line_a2: float, resonance_hz: float, resistance: float, inductance: float, headroom: float) -> float:
    """Peak in V of ``R i + L di/dt`` over one period for ``i² = a (1 + h + cos 2π r t)``: one channel on, spur-free."""
    # The current's sharpest bend is √h wide.
    phase = np.pi + 2 * np.pi * np.sinh(np.linspace(-4, 4, 4001)) / (2 * np.sinh(4))
    current = np.sqrt(line_a2 * np.maximum(headroom + 2 * np.cos(phase / 2) ** 2, 1e-30))
    slope = -line_a2 * np.sin(phase) * 2 * np.pi * resonance_hz / (2 * current)
    return float((resistance * current + inductance * slope).max())
