"""One taxel as a build123d solid: a pure function of the plan's dimensions.

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

Top view: see the sketches in `padgen.planner.suspensions`.
"""

from typing import Any

from padgen.core.errors import GeometryError
from padgen.planner.plan import Channel, Plan, Plate
from padgen.planner.suspensions import Strip
from padgen.planner.tile import Outline, outline
from padgen.solid.kernel import build123d, kernel_errors

__all__ = ["taxel_solid", "washer_solid"]


def taxel_solid(plan: Plan, channel: Channel) -> Any:
    """The printed solid of one taxel with the frame of its sub-cell, in its own axes, mm.

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
        beams = [_beam(strip, channel.beam.fillet_mm) for strip in arrangement.beams]
        blocks = [_box(Outline(*(float(v) for v in block[:4])), float(block.height_mm)) for block in arrangement.blocks]
        parts = [*blocks, _boss(plate, washer_x)] if plate.boss_top_mm - plate.thickness_mm > 1e-6 else blocks
        first, *others = parts
        moving = (first.fuse(*others) if others else first).cut(_recess(plate, washer_x))
        solid = frame.fuse(*beams, *moving.solids())
        return _only_solid(solid, channel)


def washer_solid(plan: Plan, channel: Channel) -> Any:
    """The washer where the glue holds it, against the roof of its recess, in the taxel's own axes."""
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


def _beam(strip: Strip, fillet: float) -> Any:
    """A beam with a flare of radius `fillet` on both sides of its root."""
    b = build123d()
    root, tip, y = float(strip.root_x_mm), float(strip.tip_x_mm), float(strip.y_mm)
    half = float(strip.width_mm) / 2
    if fillet < 1e-6:
        low, high = sorted((root, tip))
        return _box(Outline(low, high, y - half, y + half), float(strip.thickness_mm))
    step = fillet if tip > root else -fillet
    edges = []
    corners = {}
    for side in (-1, 1):
        wall = b.Vector(root, y + side * (half + fillet))
        straight = b.Vector(root + step, y + side * half)
        bow = 1 - 0.5**0.5
        middle = b.Vector(root + step * bow, y + side * (half + fillet * bow))
        edges.append(b.Edge.make_three_point_arc(wall, middle, straight))
        end = b.Vector(tip, y + side * half)
        edges.append(b.Edge.make_line(straight, end))
        corners[side] = (wall, end)
    edges.append(b.Edge.make_line(corners[-1][0], corners[1][0]))
    edges.append(b.Edge.make_line(corners[-1][1], corners[1][1]))
    (wire,) = b.Wire.combine(edges)
    face = b.Face(wire)
    return b.Solid.extrude(face, b.Vector(0, 0, float(strip.thickness_mm)))


def _boss(plate: Plate, washer_x: float) -> Any:
    """The touch boss on the plate, with its edge broken."""
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
