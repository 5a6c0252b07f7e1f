"""Meshes of a pad's border and of its washers.

The border is a plate with round corners and screw holes around the lattice of tiles. Border and washers are prisms
over arcs and lines, so they need no CAD kernel: manifold triangulates them, and a formula gives the border's volume.
"""

from itertools import pairwise
from math import acos, ceil, pi

import numpy as np

from padgen.core.errors import GeometryError
from padgen.planner.plan import Channel, Plan
from padgen.planner.tile import Outline
from padgen.solid.mesh import ANGLE_RAD, CHORD_MM, Mesh

__all__ = ["border_mesh", "border_volume_mm3", "prism", "washer_mesh"]


def border_mesh(
    plan: Plan, shape: tuple[int, int], chord_mm: float, angle_rad: float, groove: Outline | None = None
) -> Mesh:
    """Return the triangles of the border around `shape` (rows, columns) of tiles.

    Its inner edge has a vertex wherever two tiles meet. A `groove` (see `padgen.planner.tile`) is cut from its
    outside over the whole height.

    Raises
    ------
    GeometryError
        The outline cannot be triangulated: its holes meet its edges.
    """
    pad = plan.spec.pad
    rings = [_outside(plan, chord_mm, angle_rad, groove), _inside(plan, shape)[::-1]]
    if pad.hole_diameter_mm:
        off_x, off_y = (pad.width_mm + pad.border_mm) / 2, (pad.depth_mm + pad.border_mm) / 2
        for x, y in ((-off_x, -off_y), (-off_x, off_y), (off_x, -off_y), (off_x, off_y)):
            rings.append(_circle((x, y), pad.hole_diameter_mm, chord_mm, angle_rad)[::-1])
    return prism(rings, 0.0, pad.frame_thickness_mm)


def washer_mesh(plan: Plan, channel: Channel, chord_mm: float = CHORD_MM, angle_rad: float = ANGLE_RAD) -> Mesh:
    """Return the triangles of the washer glued to the roof of its recess, in mm in the taxel's own axes."""
    washer, depth = plan.spec.washer, plan.plate.recess_depth_mm
    centre = (float(plan.arrangement(channel).washer_x_mm), 0.0)
    rings = [_circle(centre, washer.outer_diameter_mm, chord_mm, angle_rad)]
    if washer.inner_diameter_mm:
        rings.append(_circle(centre, washer.inner_diameter_mm, chord_mm, angle_rad)[::-1])
    return prism(rings, depth - washer.thickness_mm, depth)


def border_volume_mm3(plan: Plan, groove: Outline | None = None) -> float:
    """Return the exact volume of the border in mm³."""
    pad = plan.spec.pad
    cut = 0.0 if groove is None else (groove.x1 - groove.x0) * (groove.y1 - groove.y0) / 2
    whole = (pad.width_mm + 2 * pad.border_mm) * (pad.depth_mm + 2 * pad.border_mm)
    corners = (4 - pi) * (pad.border_mm / 2) ** 2
    holes = pi * pad.hole_diameter_mm**2
    return (whole - corners - pad.width_mm * pad.depth_mm - holes - cut) * pad.frame_thickness_mm


def _outside(plan: Plan, chord_mm: float, angle_rad: float, groove: Outline | None) -> np.ndarray:
    """Return the outside with its round corners as points (n, 2) in mm, anticlockwise.

    A groove's outline lies half outside the border: the inner half is the notch.
    """
    pad = plan.spec.pad
    radius = pad.border_mm / 2
    x, y = (v / 2 + pad.border_mm - radius for v in (pad.width_mm, pad.depth_mm))
    centres = ((x, y), (-x, y), (-x, -y), (x, -y))
    parts = [_arc(c, radius, k * pi / 2, (k + 1) * pi / 2, chord_mm, angle_rad) for k, c in enumerate(centres)]
    if groove is not None:
        above, edge = groove.y0 > 0, (groove.y0 + groove.y1) / 2
        within = groove.y0 if above else groove.y1
        notch = [(groove.x0, edge), (groove.x0, within), (groove.x1, within), (groove.x1, edge)]
        # The groove follows the corner at which its side of the border begins.
        parts.insert(1 if above else 3, np.array(notch[::-1] if above else notch))
    return np.concatenate(parts)


def _inside(plan: Plan, shape: tuple[int, int]) -> np.ndarray:
    """Return the lattice's outline as points (n, 2) in mm, anticlockwise, with a point wherever two tiles meet."""
    pad, (rows, columns) = plan.spec.pad, shape
    half_x, half_y = pad.width_mm / 2, pad.depth_mm / 2
    x, y = np.linspace(-half_x, half_x, columns + 1), np.linspace(-half_y, half_y, rows + 1)
    points = [(v, -half_y) for v in x] + [(half_x, v) for v in y[1:]]
    points += [(v, half_y) for v in x[-2::-1]] + [(-half_x, v) for v in y[-2:0:-1]]
    return np.array(points)


def _arc(
    centre: tuple[float, float], radius: float, start: float, end: float, chord_mm: float, angle_rad: float
) -> np.ndarray:
    """Return points (k, 2) on an arc, both ends included, at most `angle_rad` apart.

    The chords between them leave the arc by no more than half of `chord_mm`: with all of it, a small pad's volume
    would be farther from the exact one than its taxels' volumes are.
    """
    step = min(2 * acos(max(1 - chord_mm / 2 / radius, -1.0)), angle_rad)
    angle = np.linspace(start, end, ceil((end - start) / step - 1e-9) + 1)
    return np.stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)], -1)


def _circle(centre: tuple[float, float], diameter: float, chord_mm: float, angle_rad: float) -> np.ndarray:
    """Return points (k, 2) on a circle, anticlockwise."""
    return _arc(centre, diameter / 2, 0.0, 2 * pi, chord_mm, angle_rad)[:-1]


def prism(rings: list[np.ndarray], low: float, high: float) -> Mesh:
    """Return the prism from `low` to `high` mm over a polygon with holes.

    `rings` are points (n, 2) in mm: first the outline, anticlockwise, then the holes, clockwise.

    Raises
    ------
    GeometryError
        The polygon cannot be triangulated: rings meet.
    """
    import manifold3d

    flat = np.concatenate(rings)
    count, ends = len(flat), np.cumsum([0] + [len(ring) for ring in rings])
    caps = np.asarray(manifold3d.triangulate(rings), np.int64)
    if len(caps) != count + 2 * len(rings) - 4:
        raise GeometryError("the edges of a plate meet its holes")
    sides = []
    for start, stop in pairwise(ends.tolist()):
        a = np.arange(start, stop)
        b = np.roll(a, -1)
        sides += [np.stack([a, b, b + count], -1), np.stack([a, b + count, a + count], -1)]
    vertices = np.concatenate([np.c_[flat, np.full(count, low)], np.c_[flat, np.full(count, high)]])
    return Mesh(vertices, np.concatenate([caps[:, ::-1], caps + count, *sides]))
