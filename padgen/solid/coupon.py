"""The coupon as a pad of its own, with a groove beside channel 0."""

from dataclasses import replace

from padgen.planner.coupon import coupon_groove, coupon_plan
from padgen.planner.plan import Plan
from padgen.planner.tile import Outline
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.mesh import tessellated
from padgen.solid.pad import PadSolid, Tile, assembled, build_pad

__all__ = ["build_coupon", "grooved"]


def build_coupon(plan: Plan) -> tuple[Plan, PadSolid]:
    """The coupon of `plan`: its own plan, by which it is checked, and its solid.

    Raises
    ------
    GeometryError
        A kernel refused a part.
    """
    coupon = coupon_plan(plan)
    return coupon, grooved(coupon, build_pad(coupon), coupon_groove(coupon))


def grooved(plan: Plan, pad: PadSolid, groove: Outline) -> PadSolid:
    """The `pad` with a `groove` cut from its border over the whole height."""
    b, height = build123d(), plan.typed_spec.pad.frame_thickness_mm
    # Cleaning would join the edges of the border's inside, which end where tiles meet.
    with kernel_errors("the groove in the border"), b.SkipClean():
        at = b.Plane((groove.x0, groove.y0, 0))
        tool = b.Solid.make_box(groove.x1 - groove.x0, groove.y1 - groove.y0, height, at)
        solid = pad.border.solid.cut(tool)
        border = Tile(tessellated(solid), float(solid.volume), solid)
    volume = pad.volume_mm3 - pad.border.volume_mm3 + border.volume_mm3
    return replace(pad, mesh=assembled(plan, list(pad.tiles), border, pad.grid), volume_mm3=volume, border=border)
