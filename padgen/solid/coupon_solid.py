"""The solid of the coupon, which is a small pad with a groove beside channel 0."""

from dataclasses import replace

from padgen.planner.coupon import coupon_groove, coupon_plan
from padgen.planner.plan import Plan
from padgen.planner.tile import Outline
from padgen.solid.border import border_mesh, border_volume_mm3
from padgen.solid.mesh import ANGLE_RAD, CHORD_MM
from padgen.solid.pad_solid import PadSolid, Tile, assembled, build_pad

__all__ = ["build_coupon", "grooved"]


def build_coupon(plan: Plan) -> tuple[Plan, PadSolid]:
    """Return the plan of the coupon of `plan`, which it is checked against, and its solid.

    Raises
    ------
    GeometryError
        A kernel refused a part.
    """
    coupon = coupon_plan(plan)
    return coupon, grooved(coupon, build_pad(coupon), coupon_groove(coupon))


def grooved(plan: Plan, pad: PadSolid, groove: Outline) -> PadSolid:
    """Return `pad` with a `groove` cut from its border over the whole height."""
    border = Tile(border_mesh(plan, pad.grid.shape, CHORD_MM, ANGLE_RAD, groove), border_volume_mm3(plan, groove))
    volume = pad.volume_mm3 - pad.border.volume_mm3 + border.volume_mm3
    return replace(pad, mesh=assembled(plan, pad.tiles, border, pad.grid), volume_mm3=volume, border=border)
