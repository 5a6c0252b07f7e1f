"""Plan the coupon: a small pad with one taxel of each channel, to measure how the printer prints them.

A coupon is one coil's cell of the pad, or two cells side by side where two sets of channels alternate. The tiles lie
about the coil's axis as in the pad, so that one coil drives all of them in the same way. The border is as narrow as the
pad's screws allow. A coupon needs these screws: it weighs only a few times as much as its taxels, and if it lay loose
it would move with them and raise their resonances.
"""

from dataclasses import replace
from math import ceil

from padgen.planner.layout import SLACK_MM
from padgen.planner.marks import groove
from padgen.planner.plan import CoilGrid, Plan, Reuse, Taxel
from padgen.planner.screws import screw_for
from padgen.planner.tile import Outline
from padgen.spec import Spec

__all__ = ["coil_axis_mm", "coupon_groove", "coupon_plan"]

SUFFIX = "-coupon"
LONGEST_NAME = 80
SMALLEST_PAD_MM = 5.0
"""Smallest side of the active area that a spec allows; what is not cell is plain frame."""
SMALLEST_BORDER_MM = 1.0
"""Narrowest border that a spec allows."""
WALL_LINES = 2


def coupon_plan(plan: Plan) -> Plan:
    """Return the plan of a coupon for `plan`: the same channels, plate and cell, without figures of the whole pad.

    Taxel ``r0c0k0`` is channel 0. A second set of channels lies over the next coil: along x where the pad has several
    columns, else along y. No cell is turned.
    """
    coils = _coils(plan)
    step = (0, 1) if plan.coils.columns > 1 else (1, 0)
    taxels = tuple(
        _taxel(plan, coils, (index * step[0], index * step[1]), k, channel.index)
        for index, own in enumerate(plan.sets)
        for k, channel in enumerate(own)
    )
    name = plan.name[: LONGEST_NAME - len(SUFFIX)] + SUFFIX
    return replace(
        plan,
        name=name,
        spec=_spec(plan, name, coils, len(taxels)),
        coils=coils,
        taxels=taxels,
        reuse=Reuse(None, None, "none"),
        layouts=(),
        findings=(),
    )


def coupon_groove(coupon: Plan) -> Outline:
    """Return the groove in the coupon's border that marks channel 0, on the side nearer to its sub-cell."""
    first = next(taxel for taxel in coupon.taxels if taxel.channel == 0)
    at_x, at_y = coupon.channels[0].site.centre_mm
    x0, y0 = coil_axis_mm(coupon.coils, *first.coil)
    return groove(coupon.spec, x0 + at_x, above=y0 + at_y > SLACK_MM)


def coil_axis_mm(coils: CoilGrid, row: int, column: int) -> tuple[float, float]:
    """Return the place (x, y) in mm of a coil's axis, from the pad's centre."""
    return (column - (coils.columns - 1) / 2) * coils.pitch_x_mm, (row - (coils.rows - 1) / 2) * coils.pitch_y_mm


def _coils(plan: Plan) -> CoilGrid:
    """Return the smallest coil grid that holds all sets of channels and makes up the smallest active area."""
    coils, sets = plan.coils, len(plan.sets)
    wide, deep = (sets, 1) if coils.columns > 1 else (1, sets)
    columns = max(wide, ceil(SMALLEST_PAD_MM / coils.pitch_x_mm - SLACK_MM))
    rows = max(deep, ceil(SMALLEST_PAD_MM / coils.pitch_y_mm - SLACK_MM))
    return replace(coils, rows=rows, columns=columns)


def _spec(plan: Plan, name: str, coils: CoilGrid, taxels: int) -> Spec:
    spec = plan.spec
    width, depth = coils.columns * coils.pitch_x_mm, coils.rows * coils.pitch_y_mm
    pad = replace(spec.pad, width_mm=width, depth_mm=depth, border_mm=_border_mm(spec))
    coil = replace(spec.coil, grid=(coils.rows, coils.columns))
    return replace(spec, name=name, resolution=taxels, pad=pad, coil=coil)


def _border_mm(spec: Spec) -> float:
    """Return the coupon's border in mm, at most the pad's.

    It is as narrow as walls of two lines beside the holes and room for the screws' heads allow.
    """
    pad = spec.pad
    walls = 2 * WALL_LINES * spec.printer.line_width_mm
    least = pad.hole_diameter_mm + walls if pad.hole_diameter_mm else max(walls, pad.rib_mm, SMALLEST_BORDER_MM)
    screw = screw_for(pad.hole_diameter_mm, pad.frame_thickness_mm, pad.frame_thickness_mm)
    return min(pad.border_mm, round(max(least, screw.head_mm if screw else 0.0), 6))


def _taxel(plan: Plan, coils: CoilGrid, coil: tuple[int, int], k: int, channel: int) -> Taxel:
    x0, y0 = coil_axis_mm(coils, *coil)
    site = plan.channels[channel].site
    x, y = site.washer_mm
    place = round(x0 + x, 6), round(y0 + y, 6)
    return Taxel(f"r{coil[0]}c{coil[1]}k{k}", coil, channel, *place, site.coil_distance_mm, False)
