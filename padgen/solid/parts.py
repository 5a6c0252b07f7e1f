"""Parts beside the pad, made on request: the coil tray, the coupon, and a tray for the coupon's coil.

Each is modelled, checked and saved like the pad itself.
"""

from padgen.planner.coupon import coupon_plan
from padgen.planner.plan import Plan
from padgen.solid.checks import check_pad
from padgen.solid.coupon_solid import build_coupon
from padgen.solid.formats import Part
from padgen.solid.tray_checks import check_tray
from padgen.solid.tray_solid import build_tray

__all__ = ["build_part"]


def build_part(plan: Plan, name: str) -> Part:
    """Model and check the part of `plan` with this name: ``"tray"``, ``"coupon"`` or ``"coupon-tray"``.

    Raises
    ------
    InfeasibleError
        The plan's coils do not fit a tray.
    GeometryError
        A kernel refused the part.
    """
    if name == "coupon":
        coupon, pad = build_coupon(plan)
        use = "one taxel of each channel, to be printed beside the pad and measured"
        return Part(name, coupon.name, use, pad.mesh, None, check_pad(pad, coupon))
    of_coupon = name == "coupon-tray"
    over = coupon_plan(plan) if of_coupon else plan
    tray = build_tray(over)
    use = "holds one coil of each kind under the coupon" if of_coupon else "holds the coils under the pad"
    return Part(name, tray.tray.name, use, tray.mesh, tray.solid, check_tray(tray, over))
