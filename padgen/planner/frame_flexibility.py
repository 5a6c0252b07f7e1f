"""Bound the shift of a taxel's resonance by the frame's flexibility, by hand formulas.

A taxel's resonance is planned with the four sides of its sub-cell held. The real frame yields in two ways: the rib at
the beams' root twists, and the pad bends as a plate. In series with a spring of stiffness k a compliance c lowers the
resonance by k c/2.
"""

from math import hypot, inf, pi
from typing import NamedTuple

import numpy as np

from padgen.core.units import G_PER_CM3, GPA, GRAM, MM
from padgen.planner.plan import Channel, Plan
from padgen.planner.tile import outline

__all__ = ["FrameAround", "flexibility_bounds", "frame_around"]

RIB_MARGIN, PLATE_MARGIN = 2.5, 2.5
"""Factors for effects outside the formulas: compliance of the joint, lateral bending of the rib, unequal supports, and
further modes.
"""
SHEAR_SHARE = 0.9
"""Factor on the frame's lowest mode for shear of the ribs, which thin-plate formulas leave out: 7 % were seen."""
NEAR_RESONANCE = 0.7
"""Share of the frame's lowest mode above which a static compliance is no bound."""
SUPPORTS = {"edges": (0.0056, 0.00126), "corners": (0.039, 0.0249), "bottom": (0.0, 0.0)}
"""Deflection of the centre of a square plate, by the way it is held: over P a²/D under a force P there, and over p a⁴/D
under an even pressure p, with the side a and the bending stiffness D. For ν = 0.3: Timoshenko and Woinowsky-Krieger,
Theory of Plates and Shells (1959), tables 35, 37 and 42.
"""


class FrameAround(NamedTuple):
    """The frame around one channel's taxel, in SI units.

    `twist_n_m` is the torsional stiffness in N·m/rad of the rib across the beams' root at its middle, both ends held.
    `bending_n_m` is the bending stiffness of the pad as a plate with sides of `side_m`. `mode_hz` estimates its lowest
    bending mode, to within a factor of two, with the mass of all taxels on it; inf where nothing bends.
    """

    twist_n_m: float
    bending_n_m: float
    side_m: float
    mode_hz: float


def flexibility_bounds(plan: Plan, clamping: str) -> np.ndarray:
    """Return the largest relative shift (n,) of each channel's resonance on the flexible frame; inf near a frame mode.

    `clamping` is a name in `SUPPORTS`: how the pad is held. The resonance is the peak of the taxel's own response.
    """
    bounds, point = [], SUPPORTS[clamping][0]
    for channel in plan.channels:
        frame, arrangement = frame_around(plan, channel, clamping), plan.arrangement(channel)
        if channel.resonance_hz >= NEAR_RESONANCE * frame.mode_hz:
            bounds.append(inf)
            continue
        # From a root to the washer: along x for a straight beam, else directly.
        roots = [(path.is_straight, *(float(v) for v in path.root_mm)) for path in arrangement.beams]
        away = [(float(arrangement.washer_x_mm) - x, 0.0 if straight else y) for straight, x, y in roots]
        half, arm = channel.stiffness_n_per_m / 2, max(hypot(*way) for way in away) * MM
        rib = half * arm**2 / frame.twist_n_m
        plate = half * point * frame.side_m**2 / frame.bending_n_m / (1 - (channel.resonance_hz / frame.mode_hz) ** 2)
        bounds.append(RIB_MARGIN * rib + PLATE_MARGIN * plate)
    return np.array(bounds)


def frame_around(plan: Plan, channel: Channel, clamping: str) -> FrameAround:
    """Return the stiffness of the frame around a channel's taxel.

    The rib at the root is made of its part in this sub-cell and, beyond the seam, at least the thinnest wall that this
    sub-cell has. The lowest mode follows from the deflection w of the pad's centre under its own weight, ``ω² = g/w``
    (Rayleigh), which makes it low.
    """
    box, pad, material = outline(plan, channel), plan.spec.pad, plan.spec.material
    modulus, height = material.youngs_modulus_gpa * GPA, pad.frame_thickness_mm * MM
    length, width = (float(v) for v in plan.arrangement(channel).window_mm)
    walls = (-box.x0, box.x1 - length, width / 2 + box.y1 - width, -box.y0 - width / 2)
    thin, thick = sorted(((-box.x0 + max(min(walls), 0.0)) * MM, height))
    torsion = thick * thin**3 / 3 * (1 - 0.63 * thin / thick)
    wide, deep = box.x1 - box.x0, box.y1 - box.y0
    across = max(pad.width_mm, pad.depth_mm) + 2 * pad.border_mm
    # A border that is held does not bend: the pad's cross-section is then that within it.
    open_share = 1.0 if clamping == "edges" else max(pad.width_mm, pad.depth_mm) / across
    bending = (1 - (length / wide + width / deep) / 2 * open_share) * modulus * height**3 / 12
    side, mode = (across - pad.border_mm) * MM, inf
    if even := SUPPORTS[clamping][1]:
        tiles = (
            plan.cell.columns * plan.cell.rows * plan.coils.rows * plan.coils.columns * (wide * deep - length * width)
        )
        border = (pad.width_mm + 2 * pad.border_mm) * (pad.depth_mm + 2 * pad.border_mm) - pad.width_mm * pad.depth_mm
        plastic = (tiles + border) * MM**2 * pad.frame_thickness_mm * MM * (material.density_g_per_cm3 * G_PER_CM3)
        counts = np.bincount([taxel.channel for taxel in plan.taxels], minlength=len(plan.channels))
        moving = float(counts @ [each.effective_mass_g for each in plan.channels]) * GRAM
        mode = SHEAR_SHARE * (1 / (even * (plastic + moving) * side**2 / bending)) ** 0.5 / (2 * pi)
    return FrameAround(4 * modulus / 2 / (1 + material.poisson_ratio) * torsion / (width * MM), bending, side, mode)
