"""The solid of the coil tray: three extruded layers, fused. `padgen.planner.tray` draws its section."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt
from typing import Any

from padgen.core.errors import GeometryError
from padgen.planner.plan import Plan
from padgen.planner.tile import Outline
from padgen.planner.tray import Tray, plan_tray
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.mesh import ANGLE_RAD, CHORD_MM, Mesh, tessellated
from padgen.spec import Pad

__all__ = ["TraySolid", "build_tray", "tray_solid"]


@dataclass(frozen=True)
class TraySolid:
    """A coil tray: its plan, its triangles, its build123d solid and the solid's exact volume."""

    tray: Tray
    mesh: Mesh
    volume_mm3: float
    solid: Any


def build_tray(plan: Plan, chord_mm: float = CHORD_MM, angle_rad: float = ANGLE_RAD) -> TraySolid:
    """Build the tray for the coils of `plan`.

    Raises
    ------
    InfeasibleError
        See `padgen.planner.tray.plan_tray`.
    GeometryError
        A kernel refused a part.
    """
    return tray_solid(plan_tray(plan), plan.spec.pad, chord_mm, angle_rad)


def tray_solid(tray: Tray, pad: Pad, chord_mm: float = CHORD_MM, angle_rad: float = ANGLE_RAD) -> TraySolid:
    """Build the solid of a `tray` with the outline of `pad`."""
    with kernel_errors("the coil tray"):
        floor = _layer(_outside(pad), _seats(tray), 0.0, tray.floor_mm)
        block = _layer(_outside(pad), _sockets(tray), tray.floor_mm, tray.socket_top_mm)
        rim = _layer(_outside(pad), [_inside(pad)], tray.socket_top_mm, tray.height_mm)
        walls = rim.cut(*_prisms(tray.wire_slots, tray.socket_top_mm, tray.height_mm))
        whole = floor.fuse(block, *walls.solids()).cut(*_prisms([tray.groove], 0.0, tray.height_mm), *_bores(tray))
        solids = whole.solids()
    if len(solids) != 1 or not solids[0].is_valid:
        raise GeometryError(f"the coil tray came out as {len(solids)} solids, must be one valid solid")
    (solid,) = solids
    return TraySolid(tray, tessellated(solid, chord_mm, angle_rad), float(solid.volume), solid)


def _layer(outside: Any, holes: list[Any], low: float, high: float) -> Any:
    b = build123d()
    solid = b.Solid.extrude(b.Face(outside, holes), b.Vector(0, 0, high - low))
    return solid.moved(b.Location((0, 0, low)))


def _outside(pad: Pad) -> Any:
    """Return the pad's outline, with its round corners, as a wire."""
    b = build123d()
    wire = b.Wire.make_rect(pad.width_mm + 2 * pad.border_mm, pad.depth_mm + 2 * pad.border_mm)
    return wire.fillet_2d(pad.border_mm / 2, wire.vertices())


def _inside(pad: Pad) -> Any:
    return build123d().Wire.make_rect(pad.width_mm, pad.depth_mm)


def _seats(tray: Tray) -> list[Any]:
    b = build123d()
    return [b.Wire.make_circle(tray.seat_hole_mm / 2, b.Plane((x, y, 0))) for x, y in tray.coils_mm]


def _sockets(tray: Tray) -> list[Any]:
    return [_socket(tray, x, y) for x, y in tray.coils_mm]


def _socket(tray: Tray, x: float, y: float) -> Any:
    """Return the wire of a coil's socket: a circle with a slot for the leads towards +x +y."""
    b, radius, half = build123d(), tray.socket_diameter_mm / 2, tray.lead.width_mm / 2
    mouth, end = sqrt(radius**2 - half**2), radius + tray.lead.reach_mm

    def at(along: float, across: float) -> Any:
        turn = sqrt(0.5)
        return b.Vector(x + turn * (along - across), y + turn * (along + across))

    edges = [
        b.Edge.make_three_point_arc(at(mouth, half), at(-radius, 0.0), at(mouth, -half)),
        b.Edge.make_line(at(mouth, -half), at(end, -half)),
        b.Edge.make_line(at(end, -half), at(end, half)),
        b.Edge.make_line(at(end, half), at(mouth, half)),
    ]
    (wire,) = b.Wire.combine(edges)
    return wire


def _bores(tray: Tray) -> list[Any]:
    """Return the cylinders of the screw holes, from the top of the rim down."""
    b, screw = build123d(), tray.screw
    if screw is None:
        return []
    low = tray.height_mm - screw.hole_depth_mm
    return [
        b.Solid.make_cylinder(screw.hole_diameter_mm / 2, screw.hole_depth_mm, b.Plane((x, y, low)))
        for x, y in tray.holes_mm
    ]


def _prisms(outlines: Iterable[Outline], low: float, high: float) -> list[Any]:
    b = build123d()
    return [
        b.Solid.make_box(sides.x1 - sides.x0, sides.y1 - sides.y0, high - low, b.Plane((sides.x0, sides.y0, low)))
        for sides in outlines
    ]
