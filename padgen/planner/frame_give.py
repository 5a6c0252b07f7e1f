"""Bound the shift of a plan's resonances by the flexible frame, with `physics.frame_flexibility`."""

from math import hypot

import numpy as np

from padgen.core.errors import SolverError
from padgen.core.units import G_PER_CM3, GPA, GRAM, MM
from padgen.physics.frame_flexibility import SUPPORTS, Ribs, TaxelReaction, lowest_frame_mode_hz, shift_bound
from padgen.planner.plan import Channel, Plan
from padgen.planner.suspensions import BeamPath
from padgen.planner.tile import outline

__all__ = ["flexibility_bounds", "frame_mode_estimate_hz"]


def flexibility_bounds(plan: Plan, clamping: str) -> np.ndarray:
    """Return the largest relative shift (n,) of each channel's resonance on the flexible frame; inf near a frame mode.

    `clamping` is a name in `SUPPORTS`: how the pad is held.

    Raises
    ------
    SolverError
        The clamping is unknown.
    """
    support, moving = SUPPORTS[_checked_clamping(clamping)], _moving_kg(plan)
    return np.array([shift_bound(_reaction(plan, c), _ribs(plan, c, clamping), support, moving) for c in plan.channels])


def frame_mode_estimate_hz(plan: Plan, clamping: str) -> float:
    """Estimate the lowest bending mode of the frame in Hz, to within a factor of two."""
    support, moving = SUPPORTS[_checked_clamping(clamping)], _moving_kg(plan)
    return min(lowest_frame_mode_hz(_ribs(plan, channel, clamping), support, moving) for channel in plan.channels)


def _checked_clamping(clamping: str) -> str:
    if clamping not in SUPPORTS:
        raise SolverError(f"must be one of {', '.join(SUPPORTS)}, got {clamping}", "clamping")
    return clamping


def _moving_kg(plan: Plan) -> float:
    counts = np.bincount([taxel.channel for taxel in plan.taxels], minlength=len(plan.channels))
    return float(counts @ [channel.effective_mass_g for channel in plan.channels]) * GRAM


def _reaction(plan: Plan, channel: Channel) -> TaxelReaction:
    arrangement = plan.arrangement(channel)
    arm = max(_arm_mm(path, float(arrangement.washer_x_mm)) for path in arrangement.beams) * MM
    return TaxelReaction(channel.resonance_hz, channel.stiffness_n_per_m, arm)


def _arm_mm(path: BeamPath, washer_x_mm: float) -> float:
    """Return the distance in mm of the washer from a root: along x for a straight beam, else the direct one."""
    x, y = (float(v) for v in path.root_mm)
    return abs(washer_x_mm - x) if path.is_straight else hypot(washer_x_mm - x, y)


def _ribs(plan: Plan, channel: Channel, clamping: str) -> Ribs:
    """Return the ribs of the frame around a channel's taxel.

    The rib at the root is made of its part in this sub-cell and, beyond the seam, at least the thinnest wall that this
    sub-cell has.
    """
    box, pad, material = outline(plan, channel), plan.spec.pad, plan.spec.material
    length, width = (float(v) for v in plan.arrangement(channel).window_mm)
    walls = (-box.x0, box.x1 - length, width / 2 + box.y1 - width, -box.y0 - width / 2)
    wide, deep = box.x1 - box.x0, box.y1 - box.y0
    plastic = plan.cell.columns * plan.cell.rows * plan.coils.rows * plan.coils.columns * (wide * deep - length * width)
    outside = (pad.width_mm + 2 * pad.border_mm) * (pad.depth_mm + 2 * pad.border_mm) - pad.width_mm * pad.depth_mm
    across = max(pad.width_mm, pad.depth_mm) + 2 * pad.border_mm
    # A border that is held does not bend: the pad's cross-section is then that within it.
    open_share = 1.0 if clamping == "edges" else max(pad.width_mm, pad.depth_mm) / across
    density = material.density_g_per_cm3 * G_PER_CM3
    return Ribs(
        (-box.x0 + max(min(walls), 0.0)) * MM,
        pad.frame_thickness_mm * MM,
        width * MM,
        (across - pad.border_mm) * MM,
        1 - (length / wide + width / deep) / 2 * open_share,
        (plastic + outside) * MM**2 * pad.frame_thickness_mm * MM * density,
        material.youngs_modulus_gpa * GPA,
        material.poisson_ratio,
    )
