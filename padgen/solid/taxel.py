"""The build123d solid of one taxel, as a pure function of the plan's dimensions; known ones come from the cache.

Side view through the beam, own axes (x from the root, z from the bed)::

            boss
            +--+      ---- frame + protrusion
    ####    |  |    ####   ---- frame
    ####  +------+  ####
    ####  |plate |  ####
    ####  | +--+ |  ####      recess: washer + glue, open below
    ####==| |  | |  ####   ---- beam thickness t
    ####==+-+  +-+  ####   ---- z = 0
    root  ^beam

Top view: see the sketches in `padgen.planner.suspensions`. The cache has the triangles, so that a known taxel needs no
CAD kernel.
"""

import io
from collections.abc import Callable
from math import copysign
from typing import Any, NamedTuple

import numpy as np

from padgen.core import cache
from padgen.core.errors import GeometryError, number
from padgen.planner.layout import Outline, outline, shape_inputs
from padgen.planner.plan import Channel, Plan, Plate
from padgen.planner.suspensions import BeamPath, PathPoint, Segment
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.mesh import Mesh

__all__ = ["KnownSolid", "kept_solid", "known_solid", "taxel_key", "taxel_solid", "washer_solid"]

LEAST_MM = 1e-6
"""Edges and fillets that are shorter are left out."""


def taxel_solid(plan: Plan, channel: Channel) -> Any:
    """Return the printed solid of one taxel with the frame of its sub-cell, in the taxel's own axes, in mm.

    Raises
    ------
    GeometryError
        The kernel refused the dimensions.
    """
    plate, thickness = plan.plate, plan.spec.pad.frame_thickness_mm
    arrangement = plan.arrangement(channel)
    length, width = (float(v) for v in arrangement.window_mm)
    washer_x = float(arrangement.washer_x_mm)
    with kernel_errors(f"the taxel of channel {channel.index}"):
        frame = _ring(outline(plan, channel), Outline(0, length, -width / 2, width / 2), thickness)
        beams = [_beam(path, channel.beam.fillet_mm) for path in arrangement.beams]
        blocks = [_box(Outline(*(float(v) for v in block[:4])), float(block.height_mm)) for block in arrangement.blocks]
        parts = [*blocks, _boss(plate, washer_x)] if plate.boss_top_mm - plate.thickness_mm > 1e-6 else blocks
        first, *others = parts
        moving = (first.fuse(*others) if others else first).cut(_recess(plate, washer_x))
        solid = frame.fuse(*beams, *moving.solids())
        return _only_solid(solid, channel)


def washer_solid(plan: Plan, channel: Channel) -> Any:
    """Return the solid of the washer glued to the roof of its recess, in the taxel's own axes, in mm."""
    washer = plan.spec.washer
    washer_x = float(plan.arrangement(channel).washer_x_mm)
    depth = plan.plate.recess_depth_mm
    low = depth - washer.thickness_mm
    with kernel_errors("the washer"):
        return _disc(washer.outer_diameter_mm, washer_x, low, depth).cut(
            _disc(washer.inner_diameter_mm, washer_x, low, depth)
        )


def _ring(outer: Outline, window: Outline, height: float) -> Any:
    b = build123d()
    face = b.Face(_wire(outer), [_wire(window)])
    return b.Solid.extrude(face, b.Vector(0, 0, height))


def _beam(path: BeamPath, fillet: float) -> Any:
    """Extrude the outline on both sides of a beam's path, with a flare of radius `fillet` on each side of its root."""
    b = build123d()
    half = float(path.width_mm) / 2
    edges, ends = [], []
    for side in (half, -half):
        flare, sides = _flare(path.corners[0], side, fillet), _side(path, side, fillet)
        edges += [*flare, *sides]
        ends.append(((flare or sides)[0] @ 0, sides[-1] @ 1))
    (wire,) = b.Wire.combine([*edges, *(b.Edge.make_line(*pair) for pair in zip(*ends, strict=True))])
    return b.Solid.extrude(b.Face(wire), b.Vector(0, 0, float(path.thickness_mm)))


def _flare(root: PathPoint, side: float, fillet: float) -> list[Any]:
    """Return the quarter circle that widens a beam at its root, on the side `side` mm to the left of its path."""
    if fillet < LEAST_MM:
        return []
    bow, out = fillet * (1 - 0.5**0.5), copysign(1.0, side)
    places = [
        root.along(Segment(ahead)).beside(side + out * aside) for ahead, aside in ((0, fillet), (bow, bow), (fillet, 0))
    ]
    return [build123d().Edge.make_three_point_arc(*places)]


def _side(path: BeamPath, side: float, start: float) -> list[Any]:
    """Return the lines and arcs `side` mm to the left of a path, without its first `start` mm."""
    b, edges = build123d(), []
    for k, segment in enumerate(path.segments):
        length, turn = float(segment.length_mm), float(segment.turn_rad)
        if length < abs(turn * side) - LEAST_MM:
            raise GeometryError(
                f"an arc of {number(length / abs(turn))} mm radius must have at least half of the beam's width,"
                f" {number(abs(side))} mm"
            )
        first = start / length if k == 0 else 0.0
        begin, middle, end = (path.within(k, first + (1 - first) * at).beside(side) for at in (0.0, 0.5, 1.0))
        if not turn:
            edges.append(b.Edge.make_line(begin, end))
        elif length > abs(turn * side) + LEAST_MM or turn * side < 0:
            edges.append(b.Edge.make_three_point_arc(begin, middle, end))
    return edges


def _boss(plate: Plate, washer_x: float) -> Any:
    """Return the touch boss on the plate, its upper edge chamfered."""
    boss = _disc(plate.boss_diameter_mm, washer_x, plate.thickness_mm, plate.boss_top_mm)
    if plate.boss_edge_mm < 1e-6:
        return boss
    edge = max(boss.edges(), key=lambda e: e.center().Z)
    return boss.chamfer(plate.boss_edge_mm, None, [edge])


def _recess(plate: Plate, washer_x: float) -> Any:
    recess = _disc(plate.recess_diameter_mm, washer_x, 0.0, plate.recess_depth_mm)
    if not plate.post_diameter_mm:
        return recess
    return recess.cut(_disc(plate.post_diameter_mm, washer_x, 0.0, plate.recess_depth_mm))


def _disc(diameter: float, x: float, low: float, high: float) -> Any:
    b = build123d()
    return b.Solid.make_cylinder(diameter / 2, high - low, b.Plane((x, 0, low)))


def _box(sides: Outline, height: float) -> Any:
    b = build123d()
    return b.Solid.make_box(sides.x1 - sides.x0, sides.y1 - sides.y0, height, b.Plane((sides.x0, sides.y0, 0)))


def _wire(sides: Outline) -> Any:
    corners = [(sides.x0, sides.y0), (sides.x1, sides.y0), (sides.x1, sides.y1), (sides.x0, sides.y1)]
    return build123d().Wire.make_polygon(corners, close=True)


def _only_solid(shape: Any, channel: Channel) -> Any:
    solids = shape.solids()
    if len(solids) != 1 or not solids[0].is_valid:
        raise GeometryError(
            f"the taxel of channel {channel.index} came out as {len(solids)} solids, must be one valid solid"
        )
    return solids[0]


KIND = "taxel-mesh"
CODE = ("solid/taxel.py", "solid/mesh.py", "planner/suspensions/__init__.py", "planner/layout.py")
PACKAGES = ("build123d", "cadquery-ocp-novtk", "numpy")


class KnownSolid(NamedTuple):
    """Triangles of a taxel in its own axes, and its exact volume."""

    mesh: Mesh
    volume_mm3: float


def taxel_key(plan: Plan, channel: Channel, **detail: Any) -> str:
    """Return the cache key of everything that the solid of a taxel depends on, and of `detail`."""
    return cache.key_of(
        {
            **shape_inputs(plan, channel),
            "code": cache.code_hash(*CODE),
            "versions": [cache.version(name) for name in PACKAGES],
            **detail,
        }
    )


def known_solid(key: str) -> KnownSolid | None:
    """Return the taxel kept under `key`, or None where there is none or its data are damaged."""
    data = cache.load_bytes(KIND, key)
    if data is None:
        return None
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            mesh, volume_mm3 = Mesh(arrays["vertices_mm"], arrays["triangles"]), float(arrays["volume_mm3"])
        whole = _is_whole(mesh) and volume_mm3 > 0
    except Exception:  # damaged data raise errors of many kinds
        return None
    return KnownSolid(mesh, volume_mm3) if whole else None


def _is_whole(mesh: Mesh) -> bool:
    """Return whether the arrays have the types, shapes and indices of a mesh."""
    vertices, triangles = mesh
    if vertices.dtype.kind != "f" or triangles.dtype.kind != "i":
        return False
    if vertices.shape[1:] != (3,) or triangles.shape[1:] != (3,) or not len(triangles):
        return False
    return bool(np.isfinite(vertices).all() and triangles.min() >= 0 and triangles.max() < len(vertices))


def kept_solid(key: str, make: Callable[[], KnownSolid]) -> KnownSolid:
    """Return the taxel kept under `key`, or make it with `make` and keep it."""

    def made() -> KnownSolid:
        solid, data = make(), io.BytesIO()
        mesh = solid.mesh
        np.savez(data, vertices_mm=mesh.vertices_mm, triangles=mesh.triangles, volume_mm3=solid.volume_mm3)
        cache.store_bytes(KIND, key, data.getvalue())
        return solid

    return cache.once(KIND, key, lambda: known_solid(key), made)
