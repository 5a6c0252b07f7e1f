"""Draws the README's pictures from the paper's pad: `make pictures`."""

from pathlib import Path

import manifold3d
import numpy as np

from padgen.planner import Plan, make_plan
from padgen.solid.mesh import Mesh, from_manifold
from padgen.solid.pad import build_pad
from padgen.solid.picture import View, picture_png
from padgen.spec import load_spec

HERE = Path(__file__).parent
CREAM, STEEL, COPPER, IRON = (0.97, 0.95, 0.90), (0.62, 0.66, 0.72), (0.93, 0.58, 0.34), (0.45, 0.45, 0.48)


def moved(mesh: Mesh, x: float, y: float, z: float) -> Mesh:
    return Mesh(mesh.vertices_mm + np.array([x, y, z]), mesh.triangles)


def tube(outer: float, inner: float, height: float) -> Mesh:
    solid = manifold3d.Manifold.cylinder(height, outer / 2, outer / 2, 64)
    if inner:
        solid = solid - manifold3d.Manifold.cylinder(3 * height, inner / 2, inner / 2, 64).translate((0, 0, -height))
    return from_manifold(solid)


def exploded(plan: Plan, pad: Mesh) -> list[tuple[Mesh, tuple[float, float, float]]]:
    """Coils below, washers between, the pad above."""
    spec = plan.typed_spec
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


def main() -> None:
    plan = make_plan(load_spec("paper-32"))
    pad = build_pad(plan).mesh
    below = View(azimuth_deg=-35, elevation_deg=-42)
    for name, parts, view in (
        ("pad.png", [(pad, CREAM)], View()),
        ("pad-below.png", [(pad, CREAM)], below),
        ("exploded.png", exploded(plan, pad), View(-32, 30)),
    ):
        (HERE / name).write_bytes(picture_png(parts, (900, 700 if name == "exploded.png" else 620), view))


if __name__ == "__main__":
    main()
