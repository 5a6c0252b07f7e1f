"""Build and check the guard plate: the printed part over the pad, with a hole for each pin (`padgen.planner.guard`).

It is modelled as it is printed, its top on the bed and its pockets up: turned about the pad's x axis, so that a hole at
(x, y) of the pad lies at (x, −y).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from math import nan
from typing import Any

import numpy as np

from padgen.core.errors import number
from padgen.planner.guard import GuardPlate, plan_guard
from padgen.planner.plan import Plan
from padgen.solid.checks import Report, check_part
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.measure import Dimension, distance_to_sides, holes_of, ray_distance_mm
from padgen.solid.mesh import ROUND_MM, Mesh, tessellated
from padgen.solid.taxel import box, only_solid, pad_outline
from padgen.spec import PadTable

__all__ = ["GuardSolid", "build_guard", "check_guard", "free_diameter", "measured_guard"]


@dataclass(frozen=True)
class GuardSolid:
    """A guard plate: its plan, its triangles, its build123d solid and the solid's exact volume."""

    guard: GuardPlate
    mesh: Mesh
    volume_mm3: float
    solid: Any


def build_guard(plan: Plan) -> GuardSolid:
    """Build the guard plate of `plan`.

    Raises
    ------
    GeometryError
        The kernel refused it.
    """
    guard = plan_guard(plan)
    solid = _solid(guard, plan.spec.pad)
    return GuardSolid(guard, tessellated(solid), float(solid.volume), solid)


def _solid(guard: GuardPlate, pad: PadTable) -> Any:
    b = build123d()
    with kernel_errors("the guard plate"):
        bores = [(place, guard.hole_diameter_mm) for place in guard.pins_mm]
        bores += [(place, guard.screw_hole_mm) for place in guard.screw_holes_mm]
        holes = [b.Wire.make_circle(wide / 2, b.Plane((x, -y, 0))) for (x, y), wide in bores]
        plate = b.Solid.extrude(b.Face(pad_outline(pad), holes), b.Vector(0, 0, guard.height_mm))
        cuts = [
            box(sides._replace(y0=-sides.y1, y1=-sides.y0), guard.height_mm, guard.thickness_mm)
            for sides in guard.pockets
        ]
        groove = guard.groove
        cuts.append(box(groove._replace(y0=-groove.y1, y1=-groove.y0), guard.height_mm))
        return only_solid(plate.cut(*cuts), "the guard plate")


def check_guard(built: GuardSolid, plan: Plan, mesh: Mesh | None = None) -> Report:
    """Return the report of all checks of the guard plate of `plan`: of its own mesh, or of a `mesh` read from a file.

    What the plate does to pins and hands is judged with the plan.
    """
    return check_part(
        "the guard plate",
        "guard.built",
        built.mesh,
        built.volume_mm3,
        plan.spec,
        partial(measured_guard, built.guard),
        mesh,
    )


def measured_guard(guard: GuardPlate, solid: Any) -> Iterator[Dimension]:
    """Yield hole diameters and thicknesses above the pockets, measured on a guard plate's solid, posed as printed."""
    low = holes_of(solid, guard.thickness_mm / 2)
    for what, places, wide_mm in (
        ("the hole of the pin", guard.pins_mm, guard.hole_diameter_mm),
        ("the screw hole", guard.screw_holes_mm, guard.screw_hole_mm),
    ):
        for x, y in places:
            where = f"{what} at ({number(x)}, {number(y)}) mm"
            yield Dimension(where, "hole diameter", wide_mm, free_diameter(low, x, -y), ROUND_MM)
    for pocket, (x, y) in zip(guard.pockets, guard.pins_mm, strict=True):
        where = f"the pocket at ({number(x)}, {number(y)}) mm"
        # The corner that is farthest from the hole, a little inside.
        corner_x = pocket.x0 + INSIDE_MM if x > (pocket.x0 + pocket.x1) / 2 else pocket.x1 - INSIDE_MM
        corner_y = pocket.y0 + INSIDE_MM if y > (pocket.y0 + pocket.y1) / 2 else pocket.y1 - INSIDE_MM
        above = guard.height_mm + 1.0
        top = above - ray_distance_mm(solid, (corner_x, -corner_y, above), (corner_x, -corner_y, -1.0))
        yield Dimension(where, "thickness above the pocket", guard.thickness_mm, float(top))


INSIDE_MM = 0.05
"""Distance from a pocket's sides at which its depth is measured."""


def free_diameter(holes: list[np.ndarray], x: float, y: float) -> float:
    """Return the diameter of the largest circle about (x, y) in the hole around it, nan if it lies in no hole."""
    at = np.array([x, y])
    for contour in holes:
        if (contour.min(0) < at).all() and (at < contour.max(0)).all():
            return 2 * distance_to_sides(contour, at)
    return nan
