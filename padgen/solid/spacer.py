"""Build and check the spacer: a flat frame between pad and board that keeps the coils at their gap.

It has the outline of the pad's border, its screw holes and the groove that marks the corner of coil `r0c0`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from padgen.planner.fixtures import Spacer, plan_spacer, spacer_findings
from padgen.planner.plan import Plan
from padgen.solid.checks import Report, check_part
from padgen.solid.guard_plate import free_diameter
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.measure import Dimension, holes_of, ray_distance_mm
from padgen.solid.mesh import ROUND_MM, Mesh, tessellated
from padgen.solid.taxel import box, only_solid, pad_outline
from padgen.spec import PadTable

__all__ = ["SpacerSolid", "build_spacer", "check_spacer"]


@dataclass(frozen=True)
class SpacerSolid:
    """A spacer: its plan, its triangles, its build123d solid and the solid's exact volume."""

    spacer: Spacer
    mesh: Mesh
    volume_mm3: float
    solid: Any


def build_spacer(plan: Plan) -> SpacerSolid:
    """Build the spacer of a `plan` with coils on a board.

    Raises
    ------
    InfeasibleError
        See `padgen.planner.fixtures.plan_spacer`.
    GeometryError
        The kernel refused it.
    """
    spacer = plan_spacer(plan)
    solid = _solid(spacer, plan.spec.pad)
    return SpacerSolid(spacer, tessellated(solid), float(solid.volume), solid)


def _solid(spacer: Spacer, pad: PadTable) -> Any:
    b = build123d()
    with kernel_errors("the spacer"):
        holes = [b.Wire.make_rect(pad.width_mm, pad.depth_mm)]
        holes += [b.Wire.make_circle(spacer.hole_diameter_mm / 2, b.Plane((x, y, 0))) for x, y in spacer.holes_mm]
        frame = b.Solid.extrude(b.Face(pad_outline(pad), holes), b.Vector(0, 0, spacer.height_mm))
        return only_solid(frame.cut(box(spacer.groove, spacer.height_mm)), "the spacer")


def check_spacer(built: SpacerSolid, plan: Plan, mesh: Mesh | None = None) -> Report:
    """Return the report of all checks of the spacer of `plan`: of its own mesh, or of a `mesh` read from a file."""
    gauges_of = partial(_measured, built.spacer, plan.spec.pad)
    report = check_part("the spacer", "spacer.built", built.mesh, built.volume_mm3, plan.spec, gauges_of, mesh)
    return replace(report, findings=(*spacer_findings(plan, built.spacer), *report.findings))


def _measured(spacer: Spacer, pad: PadTable, solid: Any) -> Iterator[Dimension]:
    """Yield the diameters of the screw holes, and the height at the middle of each side, of a spacer's solid."""
    low = holes_of(solid, spacer.height_mm / 2)
    for x, y in spacer.holes_mm:
        where = f"the screw hole at ({x:.5g}, {y:.5g}) mm"
        yield Dimension(where, "hole diameter", spacer.hole_diameter_mm, free_diameter(low, x, y), ROUND_MM)
    above = spacer.height_mm + 1.0
    across = (pad.width_mm + pad.border_mm) / 2
    along = (pad.depth_mm + pad.border_mm) / 2
    for side, x, y in (("left", -across, 0.0), ("right", across, 0.0), ("near", 0.0, -along), ("far", 0.0, along)):
        top = above - ray_distance_mm(solid, (x, y, above), (x, y, -1.0))
        yield Dimension(f"the {side} side", "height", spacer.height_mm, float(top))
