"""Hardening of beams that must stretch to bend, as those of a bridge: a cubic spring (Duffing).

A beam that bends grows shorter along its axis. What the taxel's other motions cannot make up for stretches it:
the working mode's force becomes ``k z (1 + α z²)``. For beams guided between two rigid ends ``α = 0.72/t²``
(fixed cubic shape, Timoshenko, Vibration Problems in Engineering, on bars with immovable ends).
"""

from math import sqrt
from typing import Any

import numpy as np

from padgen.physics.beams import tip_stiffness
from padgen.physics.modes import BeamPlacement, to_tip

__all__ = ["hardening", "jump_amplitude", "level_kept", "resonance_rise"]

RELIEVED = 1e-9
"""Share of the stretching that is left when the taxel's other motions relieve it, by rounding."""
BISECTIONS = 60


def hardening(
    beams: list[BeamPlacement], motion: np.ndarray, reference: np.ndarray, compliance: np.ndarray, elastic: Any
) -> np.ndarray:
    """α (…) in 1/m² of the force ``k z (1 + α z²)`` of the working mode of taxels.

    `motion` (…, 6) is the body's at `reference` (…, 3) for 1 m of z, `compliance` (…, 6, 6) the suspended body's there
    under static loads, `elastic` Young's modulus in Pa and Poisson's ratio. Bent beams count as straight.
    """
    load, kept = np.zeros_like(motion), np.zeros(motion.shape[:-1])
    for beam in beams:
        carry, length = to_tip(beam, reference), np.asarray(beam.section.length, float)
        tip = (carry @ motion[..., None])[..., 0]
        # Shortening of a cubic, ½ ∫ w'² dx, by the displacement and slope of its tip: both planes.
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
    """Relative rise of the resonance at an `amplitude` about a static `offset`, lengths in one unit.

    ``ω²/ω₀² = 1 + α (3/4 a² + 3 z²)`` (harmonic balance); z is where the hardened spring carries what would deflect one
    that does not harden by `offset`: the real root of ``z + α z³ = offset``.
    """
    steep = np.sqrt(3 * np.asarray(alpha, float))
    # z = 2/√(3α) sinh(asinh(3/2 √(3α) offset)/3); α z² from it without dividing by α.
    square = 4 / 3 * np.sinh(np.arcsinh(1.5 * steep * offset) / 3) ** 2
    return np.sqrt(1 + 0.75 * alpha * np.square(amplitude) + 3 * square) - 1


def jump_amplitude(alpha: float, q: float) -> float:
    """Amplitude from which the response has two stable levels and jumps between them, in 1/√α; inf without hardening.

    Peak of the response that first has a vertical tangent, ``a² = 32/(9 √3 α Q)`` (Nayfeh and Mook, Nonlinear
    Oscillations, 4.1).
    """
    return sqrt(32 / (9 * sqrt(3) * alpha * q)) if alpha > 0 else float("inf")


def level_kept(alpha: float, q: float, amplitude: float, offset: float = 0.0) -> float:
    """Amplitude over the one asked for when a tone stays at the resonance of small motions; 1 without hardening.

    Root y² of ``y² ((2 Q rise(y))² + 1) = 1``: one, since such a tone lies below the resonance.
    """
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        share = (low + high) / 2
        off = 2 * q * resonance_rise(alpha, share * amplitude, offset)
        low, high = (low, share) if share**2 * (off**2 + 1) > 1 else (share, high)
    return high
