"""The build123d solid of one taxel, computed from the plan's dimensions alone, and its triangles, kept in a cache.

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
from dataclasses import dataclass
from math import copysign
from typing import Any

import numpy as np

from padgen.core import cache
from padgen.core.errors import GeometryError, number
from padgen.planner.layout import Outline, hexagon, outline, shape_inputs
from padgen.planner.plan import Channel, Pin, Plan
from padgen.planner.suspensions import BeamPath, Segment
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.mesh import Mesh, tessellated
from padgen.spec import Ballast, PadTable

__all__ = ["Tile", "ballast_solid", "box", "cached_tile", "only_solid", "taxel_key", "taxel_solid", "washer_solid"]

LEAST_MM = 1e-6
"""Edges and fillets that are shorter are left out."""


def taxel_solid(plan: Plan, channel: Channel) -> Any:
    """Return the printed solid of one taxel with the frame of its sub-cell, in the taxel's own axes, in mm.

    Raises
    ------
    GeometryError
        The kernel refused the dimensions.
    """
    b = build123d()
    plate = plan.plate
    thickness = plan.spec.pad.frame_thickness_mm
    arrangement = plan.arrangement(channel)
    length, width = (float(v) for v in arrangement.window_mm)
    washer_x = float(arrangement.washer_x_mm)
    with kernel_errors(f"the taxel of channel {channel.index}"):
        rings = outline(plan, channel), Outline(0, length, -width / 2, width / 2)
        corners = [[(r.x0, r.y0), (r.x1, r.y0), (r.x1, r.y1), (r.x0, r.y1)] for r in rings]
        outer, window = (b.Wire.make_polygon(each, close=True) for each in corners)
        frame = b.Solid.extrude(b.Face(outer, [window]), b.Vector(0, 0, thickness))
        beams = [_beam(path, channel.beam.fillet_mm) for path in arrangement.beams]
        parts = [box(Outline(*(float(v) for v in block[:4])), float(block.height_mm)) for block in arrangement.blocks]
        pin = channel.pin
        if pin.on_beam:
            # Through the beam, down to the bed: what is as wide as the beam prints without overhang.
            beams.append(_contactor(pin, plate.boss_edge_mm, float(arrangement.beams[0].thickness_mm)))
        elif pin.top_mm - plate.thickness_mm > LEAST_MM and (pin.fillet_mm or pin.shape == "dome"):
            parts.append(_contactor(pin, plate.boss_edge_mm, plate.thickness_mm))
        elif pin.top_mm - plate.thickness_mm > LEAST_MM:
            boss = _disc(pin.diameter_mm, washer_x, plate.thickness_mm, pin.top_mm)
            if plate.boss_edge_mm >= LEAST_MM:
                boss = boss.chamfer(plate.boss_edge_mm, None, [max(boss.edges(), key=lambda e: e.center().Z)])
            parts.append(boss)
        first, *others = parts
        recess = _disc(plate.recess_diameter_mm, washer_x, 0.0, plate.recess_depth_mm)
        if plate.post_diameter_mm:
            recess = recess.cut(_disc(plate.post_diameter_mm, washer_x, 0.0, plate.recess_depth_mm))
        if plan.spec.ballast:
            recess = recess.fuse(_prism(plan.spec.ballast, washer_x, 0.0, plan.spec.pocket_top_mm))
        moving = (first.fuse(*others) if others else first).cut(recess)
        return only_solid(frame.fuse(*beams, *moving.solids()), f"the taxel of channel {channel.index}")


def washer_solid(plan: Plan, channel: Channel) -> Any:
    """Return the solid of the washer or magnet where it is glued, in the taxel's axes, in mm."""
    washer = plan.spec.washer_or_magnet
    washer_x = float(plan.arrangement(channel).washer_x_mm)
    high = plan.spec.mover_top_mm
    low = high - washer.thickness_mm
    with kernel_errors("the washer"):
        return _disc(washer.outer_diameter_mm, washer_x, low, high).cut(
            _disc(washer.inner_diameter_mm, washer_x, low, high)
        )


def ballast_solid(plan: Plan, channel: Channel) -> Any:
    """Return the solid of the ballast in its pocket, in the taxel's own axes, in mm; None where the plan has none."""
    ballast = plan.spec.ballast
    if ballast is None:
        return None
    washer_x = float(plan.arrangement(channel).washer_x_mm)
    top = plan.spec.pocket_top_mm
    low = top - ballast.height_mm
    with kernel_errors("the ballast"):
        solid = _prism(ballast, washer_x, low, top)
        bore = ballast.inner_diameter_mm
        return solid.cut(_disc(bore, washer_x, low, top)) if bore else solid


def _beam(path: BeamPath, fillet: float) -> Any:
    """Return a beam's solid along its path, with a flare of radius `fillet` in mm on each side of its root."""
    b = build123d()
    half = float(path.width_mm) / 2
    edges = []
    ends = []
    for side in (half, -half):
        flare = []
        sides = _side(path, side, fillet)
        if fillet >= LEAST_MM:
            # A quarter circle widens the beam at its root.
            bow = fillet * (1 - 0.5**0.5)
            out = copysign(1.0, side)
            root = path.corners[0]
            places = ((0, fillet), (bow, bow), (fillet, 0))
            arc = [root.along(Segment(ahead)).beside(side + out * aside) for ahead, aside in places]
            flare = [b.Edge.make_three_point_arc(*arc)]
        edges += [*flare, *sides]
        ends.append(((flare or sides)[0] @ 0, sides[-1] @ 1))
    (wire,) = b.Wire.combine([*edges, *(b.Edge.make_line(*pair) for pair in zip(*ends, strict=True))])
    return b.Solid.extrude(b.Face(wire), b.Vector(0, 0, float(path.thickness_mm)))


def _side(path: BeamPath, side: float, start: float) -> list[Any]:
    """Return the CAD edges, lines and arcs, `side` mm to the left of a path, from `start` mm along it to its end."""
    b = build123d()
    edges = []
    for k, segment in enumerate(path.segments):
        length = float(segment.length_mm)
        turn = float(segment.turn_rad)
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


def _contactor(pin: Pin, edge_mm: float, ground_mm: float) -> Any:
    """Return the solid of a boss or pin, turned about its axis, with its foot's fillet and its dome or chamfer.

    `ground_mm` is the height of the plate or beam on which the fillet stands. What ends on the top of a plate stands on
    it; on a beam it begins at the bed.
    """
    b = build123d()
    half = pin.diameter_mm / 2
    top = pin.top_mm
    profile = [(0.0, 0.0 if pin.on_beam else ground_mm)]
    edges = []

    def line_to(r: float, z: float) -> None:
        if abs(profile[-1][0] - r) + abs(profile[-1][1] - z) > LEAST_MM:
            edges.append(b.Edge.make_line(_upright(*profile[-1]), _upright(r, z)))
            profile.append((r, z))

    def arc_to(middle: tuple[float, float], end: tuple[float, float]) -> None:
        edges.append(b.Edge.make_three_point_arc(*(_upright(*at) for at in (profile[-1], middle, end))))
        profile.append(end)

    bow = 1 - 0.5**0.5
    if pin.fillet_mm >= LEAST_MM:
        r = pin.fillet_mm
        if pin.on_beam:
            line_to(half, 0.0)
            line_to(half, ground_mm / 2)
            line_to(half + r, ground_mm / 2)
        line_to(half + r, ground_mm)
        arc_to((half + bow * r, ground_mm + bow * r), (half, ground_mm + r))
    else:
        line_to(half, profile[0][1])
    if pin.shape == "dome":
        line_to(half, top - half)
        arc_to((half * 0.5**0.5, top - bow * half), (0.0, top))
    else:
        line_to(half, top - edge_mm)
        line_to(half - edge_mm, top)
        line_to(0.0, top)
    line_to(*profile[0])
    solid = b.Solid.revolve(b.Face(b.Wire(edges)), 360, b.Axis((0, 0, 0), (0, 0, 1)))
    return solid.moved(b.Location((pin.x_mm, pin.y_mm, 0)))


def _upright(radius_mm: float, z_mm: float) -> tuple[float, float, float]:
    return radius_mm, 0.0, z_mm


def _disc(diameter: float, x: float, low: float, high: float) -> Any:
    b = build123d()
    return b.Solid.make_cylinder(diameter / 2, high - low, b.Plane((x, 0, low)))


def _prism(ballast: Ballast, x: float, low: float, high: float) -> Any:
    """Return the ballast's solid without bore, `low` to `high` mm above the bed; a hexagon has corners towards ±y."""
    b = build123d()
    if ballast.shape == "round":
        return _disc(ballast.width_mm, x, low, high)
    wire = b.Wire.make_polygon([b.Vector(x + at_x, at_y, low) for at_x, at_y in hexagon(ballast.width_mm)], close=True)
    return b.Solid.extrude(b.Face(wire), b.Vector(0, 0, high - low))


def box(sides: Outline, high: float, low: float = 0.0) -> Any:
    """Return the box over a rectangle from `low` to `high` mm."""
    b = build123d()
    return b.Solid.make_box(sides.x1 - sides.x0, sides.y1 - sides.y0, high - low, b.Plane((sides.x0, sides.y0, low)))


def pad_outline(pad: PadTable) -> Any:
    """Return the outline of a pad with its border, a build123d wire: a rectangle with round corners."""
    b = build123d()
    rectangle = b.Wire.make_rect(pad.width_mm + 2 * pad.border_mm, pad.depth_mm + 2 * pad.border_mm)
    return rectangle.fillet_2d(pad.border_mm / 2, rectangle.vertices())


def only_solid(shape: Any, name: str) -> Any:
    """Return the one valid solid of a shape.

    Raises
    ------
    GeometryError
        It has several, none, or an invalid one.
    """
    solids = shape.solids()
    if len(solids) != 1 or not solids[0].is_valid:
        raise GeometryError(f"{name} came out as {len(solids)} solids, must be one valid solid")
    return solids[0]


KIND = "taxel-mesh"
CODE = ("solid/taxel.py", "solid/mesh.py", "planner/suspensions/__init__.py", "planner/layout.py")
PACKAGES = ("build123d", "cadquery-ocp-novtk", "numpy")


@dataclass(frozen=True)
class Tile:
    """Triangles of a taxel, or of another part that a pad is assembled from, and its exact volume."""

    mesh: Mesh
    volume_mm3: float


def taxel_key(plan: Plan, channel: Channel, **detail: Any) -> str:
    """Return the cache key of a channel's taxel: a hash of everything that its solid depends on, and of `detail`."""
    return cache.key_of(
        {
            **shape_inputs(plan, channel),
            "code": cache.code_hash(*CODE),
            "versions": [cache.version(name) for name in PACKAGES],
            **detail,
        }
    )


def cached_tile(plan: Plan, channel: Channel, chord_mm: float, angle_rad: float) -> Tile:
    """Return the triangles (in the taxel's axes) and volume of a channel's taxel, from the cache if it has them."""
    key = taxel_key(plan, channel, chord_mm=chord_mm, angle_rad=angle_rad)

    def made() -> bytes:
        solid = taxel_solid(plan, channel)
        data = io.BytesIO()
        np.savez(data, **tessellated(solid, chord_mm, angle_rad)._asdict(), volume_mm3=float(solid.volume))
        cache.store_bytes(KIND, key, data.getvalue())
        return data.getvalue()

    kept = cache.get_or_compute(KIND, key, lambda: cache.load_bytes(KIND, key), made)
    with np.load(io.BytesIO(kept), allow_pickle=False) as arrays:
        return Tile(Mesh(arrays["vertices_mm"], arrays["triangles"]), float(arrays["volume_mm3"]))
