"""Draw the pictures of the README and of assembly.md from the paper's pad: `make pictures`."""

from pathlib import Path

import manifold3d
import numpy as np

from padgen.planner import Plan, make_plan
from padgen.planner.fixtures import Tray, washer_underside_mm
from padgen.planner.layout import coil_axis_mm
from padgen.solid.mesh import Mesh, as_manifold
from padgen.solid.pad_solid import build_pad
from padgen.solid.parts import build_tray
from padgen.solid.picture import View, picture_png
from padgen.spec import load_spec
from tests.tampering import from_manifold

HERE = Path(__file__).parent
Colour = tuple[float, float, float]
CREAM, STEEL, COPPER, IRON = (0.97, 0.95, 0.90), (0.62, 0.66, 0.72), (0.93, 0.58, 0.34), (0.45, 0.45, 0.48)
SLATE = (0.56, 0.70, 0.78)


def moved(mesh: Mesh, x: float, y: float, z: float) -> Mesh:
    return Mesh(mesh.vertices_mm + np.array([x, y, z]), mesh.triangles)


def tube(outer: float, inner: float, height: float) -> Mesh:
    solid = manifold3d.Manifold.cylinder(height, outer / 2, outer / 2, 64)
    if inner:
        solid = solid - manifold3d.Manifold.cylinder(3 * height, inner / 2, inner / 2, 64).translate((0, 0, -height))
    return from_manifold(solid)


def exploded(plan: Plan, pad: Mesh) -> list[tuple[Mesh, tuple[float, float, float]]]:
    """Place coils below, washers between, the pad above."""
    spec = plan.spec
    parts = [(moved(pad, 0, 0, 42), CREAM)]
    washer = tube(spec.washer.outer_diameter_mm, spec.washer.inner_diameter_mm, spec.washer.thickness_mm)
    parts += [(moved(washer, t.x_mm, t.y_mm, 27), STEEL) for t in plan.taxels]
    winding = tube(spec.coil.outer_diameter_mm, spec.coil.core_diameter_mm, spec.coil.length_mm)
    core = tube(spec.coil.core_diameter_mm, 0, spec.coil.length_mm)
    for row in range(plan.coils.rows):
        for column in range(plan.coils.columns):
            x = (column - (plan.coils.columns - 1) / 2) * plan.coils.pitch_x_mm
            y = (row - (plan.coils.rows - 1) / 2) * plan.coils.pitch_y_mm
            parts += [(moved(winding, x, y, 0), COPPER), (moved(core, x, y, 0.2), IRON)]
    return parts


def stacked(plan: Plan, pad: Mesh, tray: Mesh, levels_mm: tuple[float, ...]) -> list[tuple[Mesh, Colour]]:
    """Place tray, coils, washers, pad and screws, each at its level."""
    spec = plan.spec
    coils_mm, washers_mm, pad_mm, screws_mm = levels_mm
    parts = [(tray, SLATE), (moved(pad, 0, 0, pad_mm), CREAM)]
    washer = tube(spec.washer.outer_diameter_mm, spec.washer.inner_diameter_mm, spec.washer.thickness_mm)
    parts += [(moved(washer, t.x_mm, t.y_mm, washers_mm), STEEL) for t in plan.taxels]
    winding = tube(spec.coil.outer_diameter_mm, spec.coil.core_diameter_mm, spec.coil.length_mm)
    core = tube(spec.coil.core_diameter_mm, 0, spec.coil.length_mm)
    for row in range(plan.coils.rows):
        for column in range(plan.coils.columns):
            at = (*coil_axis_mm(plan.coils, row, column), coils_mm)
            parts += [(moved(winding, *at), COPPER), (moved(core, *at), IRON)]
    x, y = (spec.pad.width_mm + spec.pad.border_mm) / 2, (spec.pad.depth_mm + spec.pad.border_mm) / 2
    return parts + [(moved(screw(), sx * x, sy * y, screws_mm), STEEL) for sx in (-1, 1) for sy in (-1, 1)]


def screw() -> Mesh:
    """Return an M3 x 10 screw, its head's underside at z = 0."""
    shank = manifold3d.Manifold.cylinder(10, 1.5, 1.5, 48).translate((0, 0, -10))
    return from_manifold(shank + manifold3d.Manifold.cylinder(3, 2.75, 2.75, 48))


def cut(parts: list[tuple[Mesh, Colour]], x: tuple[float, float], y: float) -> list[tuple[Mesh, Colour]]:
    """Return the material behind `y` and between both `x`."""
    room = manifold3d.Manifold.cube((x[1] - x[0], 100, 100)).translate((x[0], y, -10))
    inside = [(as_manifold(mesh, "a part") ^ room, colour) for mesh, colour in parts]
    return [(from_manifold(solid), colour) for solid, colour in inside if solid.num_tri()]


def assembled(plan: Plan, pad: Mesh, tray: Mesh, of: Tray) -> list[tuple[Mesh, Colour]]:
    """Place all parts and cut them through the washers of the first taxel's row."""
    low = of.height_mm + washer_underside_mm(plan)
    thick = plan.spec.pad.frame_thickness_mm
    parts = stacked(plan, pad, tray, (of.floor_mm, low, of.height_mm, of.height_mm + thick))
    return cut(parts, (-40, 0.0), plan.taxels[0].y_mm)


def main() -> None:
    plan = make_plan(load_spec("paper-32"))
    pad = build_pad(plan).mesh
    tray = build_tray(plan)
    below = View(azimuth_deg=-35, elevation_deg=-42)
    for name, parts, view in (
        ("pad.png", [(pad, CREAM)], View()),
        ("pad-below.png", [(pad, CREAM)], below),
        ("exploded.png", exploded(plan, pad), View(-32, 30)),
        ("assembly.png", stacked(plan, pad, tray.mesh, (20, 42, 62, 84)), View(-32, 24)),
        ("assembly-cut.png", assembled(plan, pad, tray.mesh, tray.tray), View(-14, 10)),
    ):
        height = {"exploded.png": 700, "assembly.png": 960, "assembly-cut.png": 520}.get(name, 620)
        (HERE / name).write_bytes(picture_png(parts, (900, height), view))


if __name__ == "__main__":
    main()
