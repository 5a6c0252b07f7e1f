"""Hardening by beams that must stretch to bend, such as those of a bridge: a cubic spring (Duffing).

A bending beam gets shorter along its axis. It is stretched as far as the taxel's other motions cannot compensate, and
the working mode's force becomes ``k z (1 + α z²)``. For beams guided between two rigid ends ``α = 0.72/t²`` (fixed
cubic shape, Timoshenko, Vibration Problems in Engineering, on bars with immovable ends).
"""

from math import sqrt
from typing import Any

import numpy as np

from padgen.physics.beams import tip_stiffness
from padgen.physics.modes import BeamPlacement, to_tip

__all__ = ["hardening", "jump_amplitude", "level_kept", "resonance_rise"]

RELIEVED = 1e-9
"""Share of the stretching below which it counts as rounding: other motions then relieve all of it."""
BISECTIONS = 60


def hardening(
    beams: list[BeamPlacement], motion: np.ndarray, reference: np.ndarray, compliance: np.ndarray, elastic: Any
) -> np.ndarray:
    """Return α (…) in 1/m² of the force ``k z (1 + α z²)`` of the working mode of taxels.

    `motion` (…, 6) is the body's at `reference` (…, 3) for 1 m of z. `compliance` (…, 6, 6) is that of the suspended
    body there under static loads. `elastic` is Young's modulus in Pa and Poisson's ratio. Bent beams count as straight.
    """
    load, kept = np.zeros_like(motion), np.zeros(motion.shape[:-1])
    for beam in beams:
        carry, length = to_tip(beam, reference), np.asarray(beam.section.length, float)
        tip = (carry @ motion[..., None])[..., 0]
        # Shortening of a cubic, ½ ∫ w'² dx, from displacement and slope of its tip, in both planes.
        shorter: Any = sum(
            (36 * w**2 - 6 * length * w * slope + 4 * length**2 * slope**2) / (60 * length)
            for w, slope in ((tip[..., 2], -tip[..., 4]), (tip[..., 1], tip[..., 5]))
        )
        along = tip_stiffness(beam.section, *elastic)[..., 0, 0]
        load += (along * shorter)[..., None] * carry[..., 0, :]
        kept += along * shorter**2
    softness = (motion * np.linalg.solve(compliance, motion[..., None])[..., 0]).sum(-1)
    left = kept - (load * (compliance @ load[..., None])[..., 0]).sum(-1)
    return np.where(left > RELIEVED * kept, 2 * left / softness, 0.0)


def resonance_rise(alpha: Any, amplitude: Any, offset: Any = 0.0) -> Any:
    """Return the relative rise of the resonance at an `amplitude` about a static `offset`, all lengths in one unit.

    ``ω²/ω₀² = 1 + α (3/4 a² + 3 z²)`` (harmonic balance). `offset` is the deflection without hardening; z is that with
    it, the real root of ``z + α z³ = offset``.
    """
    steep = np.sqrt(3 * np.asarray(alpha, float))
    # z = 2/√(3α) sinh(asinh(3/2 √(3α) offset)/3); α z² from it without dividing by α.
    square = 4 / 3 * np.sinh(np.arcsinh(1.5 * steep * offset) / 3) ** 2
    return np.sqrt(1 + 0.75 * alpha * np.square(amplitude) + 3 * square) - 1


def jump_amplitude(alpha: float, q: float) -> float:
    """Return the amplitude from which the response jumps between two stable levels, in √(1/α); inf without hardening.

    It is the peak of the first response with a vertical tangent, ``a² = 32/(9 √3 α Q)`` (Nayfeh and Mook, Nonlinear
    Oscillations, 4.1).
    """
    return sqrt(32 / (9 * sqrt(3) * alpha * q)) if alpha > 0 else float("inf")


def level_kept(alpha: Any, q: float, amplitude: Any, offset: Any = 0.0) -> Any:
    """Return the amplitude over the wanted one when a tone stays at the resonance of small motions.

    It is 1 without hardening; otherwise the root y of ``y² ((2 Q rise(y))² + 1) = 1``, which is unique since the tone
    lies below the resonance.
    """
    high = np.ones(np.broadcast(alpha, amplitude, offset).shape)
    low = np.zeros_like(high)
    for _ in range(BISECTIONS):
        share = (low + high) / 2
        off = 2 * q * resonance_rise(alpha, share * amplitude, offset)
        above = share**2 * (off**2 + 1) > 1
        low, high = np.where(above, low, share), np.where(above, share, high)
    return high
