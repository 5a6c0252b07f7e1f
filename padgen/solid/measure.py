"""Built = planned: dimensions of every taxel measured back from the final mesh by rays."""

from collections.abc import Callable, Iterator, Sequence
from math import inf, isfinite, nan
from typing import Any, NamedTuple

import numpy as np

from padgen.planner.plan import Channel, Plan, Plate, Taxel
from padgen.planner.suspensions import BeamPath, PathPoint
from padgen.planner.tile import to_cell
from padgen.solid.mesh import CHORD_MM

__all__ = ["Dimension", "distance_to_sides", "measured", "washer_rooms"]


STATIONS = (0.4, 0.65, 0.9)
"""Where along a beam, from the root, width and thickness are measured: outside the flare."""
HEIGHTS = (0.02, 0.5, 0.98)
"""Where in a recess, as a share of its depth, the room for a washer is measured: a mouth may be narrower."""


LARGEST_RECESS = 1.5
"""Of what diameter a hole is still a recess, in planned ones."""
NEAR_MM = 0.05
"""How near to the end of an arc a ray along it starts."""


class Dimension(NamedTuple):
    """One measured dimension: which taxel, what, as planned and as built, in mm (nan: not found), and what the
    triangles of a round face may change it by."""

    taxel: str
    name: str
    planned_mm: float
    built_mm: float
    facets_mm: float = 0.0


class _Gauge(NamedTuple):
    """A planned length, the rays (from, to, in own axes) that measure it, and how their runs make it up."""

    name: str
    planned_mm: float
    rays: np.ndarray
    combine: Callable[[list[float]], float]
    facets_mm: float = 0.0


def measured(plan: Plan, solid: Any, taxels: Sequence[Taxel] | None = None) -> Iterator[Dimension]:
    """Measure beams, recess and boss of these taxels, or all, on the manifold `solid` of the pad or a part of it.

    A ray runs until it meets a face: from within a beam sideways (width, and that its path is where it was planned),
    above it on from both ends of its path (length), from below and above onto it (thickness), and up into the recess
    (depth). The recess's diameter and place are taken from a cross-section at half its depth.
    """
    gauges = {c.index: _placed(_gauges(plan, c), c) for c in plan.channels}
    recesses = _holes(plan, solid.slice(plan.plate.recess_depth_mm / 2))
    for taxel in plan.taxels if taxels is None else taxels:
        hole = _hole_around(plan, recesses, taxel)
        built, offset = (nan, nan) if hole is None else (hole.diameter_mm, _offset_mm(hole, taxel))
        yield Dimension(taxel.id, "recess diameter", plan.plate.recess_diameter_mm, built)
        yield Dimension(taxel.id, "recess centre offset", 0.0, offset)
        centre = np.array([*_coil_axis_mm(plan, taxel), 0.0])
        around = np.array([-1.0, -1.0, 1.0]) if taxel.turned else np.ones(3)
        for gauge in gauges[taxel.channel]:
            runs = [_run_mm(solid, *(ray * around + centre)) for ray in gauge.rays]
            yield Dimension(taxel.id, gauge.name, gauge.planned_mm, gauge.combine(runs), gauge.facets_mm)


def washer_rooms(plan: Plan, solid: Any, taxels: Sequence[Taxel]) -> Iterator[tuple[str, float]]:
    """For each of these taxels, the diameter of the largest circle about its recess's middle that holds no plastic.

    A round recess is a polygon in the mesh, whose sides are nearer than its corners; nan where there is none.
    """
    cuts = [_holes(plan, solid.slice(plan.plate.recess_depth_mm * share)) for share in HEIGHTS]
    for taxel in taxels:
        found = [_hole_around(plan, holes, taxel) for holes in cuts]
        rooms = [nan if hole is None else 2 * distance_to_sides(hole.outline, hole.centre) for hole in found]
        yield taxel.id, float(np.min(rooms))


def distance_to_sides(outline: np.ndarray, at: np.ndarray) -> float:
    """Distance from a point (2,) to the sides of a closed outline (n, 2)."""
    start, along = outline - at, np.roll(outline, -1, axis=0) - outline
    share = -np.einsum("ij,ij->i", start, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-30)
    nearest = start + np.clip(share, 0, 1)[:, None] * along
    return float(np.hypot(*nearest.T).min())


def _gauges(plan: Plan, channel: Channel) -> Iterator[_Gauge]:
    arrangement = plan.arrangement(channel)
    lowest_block = min(float(block.height_mm) for block in arrangement.blocks)
    for number, path in enumerate(arrangement.beams):
        name = f"beam {number + 1}" if len(arrangement.beams) > 1 else "beam"
        yield from _beam_gauges(name, path, lowest_block)
    yield from _recess_gauges(plan.plate, float(arrangement.washer_x_mm))


def _beam_gauges(name: str, path: BeamPath, lowest_block: float) -> Iterator[_Gauge]:
    yield _length_gauge(name, path, (float(path.thickness_mm) + lowest_block) / 2)
    bends = [(k, 0.5) for k, segment in enumerate(path.segments) if segment.turn_rad]
    straight = [(k, 0.5) for k, segment in enumerate(path.segments) if not segment.turn_rad]
    stations = [(0, at) for at in STATIONS] if len(path.segments) == len(straight) == 1 else straight
    for what, places, facets in (("", stations, 0.0), (" in its bends", bends, CHORD_MM)):
        if places:
            points = [path.within(*place) for place in places]
            for gauge in _section_gauges(path, points, lowest_block):
                yield gauge._replace(name=f"{name} {gauge.name}{what}", facets_mm=facets)


def _section_gauges(path: BeamPath, points: list[PathPoint], lowest_block: float) -> Iterator[_Gauge]:
    width, thickness = float(path.width_mm), float(path.thickness_mm)
    inside = [np.array([p.x_mm, p.y_mm, thickness / 2], float) for p in points]
    sides = [width * np.array([-p.along_y, p.along_x, 0.0], float) for p in points]
    across = np.concatenate([_both_ways(at, side) for at, side in zip(inside, sides, strict=True)])
    yield _Gauge("width", width, across, lambda runs: _worst(runs, width, 0.0, 1.0, 1.0))
    if not path.is_straight:
        # Only where a beam lies on its path does what was planned between its ends count as its length.
        yield _Gauge("offset from its path", 0.0, across, lambda runs: _worst(runs, 0.0, 0.0, 0.5, -0.5))
    span = lowest_block + 2
    faces = np.array([[[*at[:2], z], at] for at in inside for z in (-1.0, lowest_block + 1)])
    yield _Gauge("thickness", thickness, faces, lambda runs: _worst(runs, thickness, span, -1.0, -1.0))
    yield _Gauge("height above the bed", 0.0, faces[::2], lambda runs: max(runs) - 1)


def _length_gauge(name: str, path: BeamPath, height: float) -> _Gauge:
    """Back to the frame and on to what moves, from within the first and the last piece, at a `height` above the beam.

    A ray along an arc leaves it: there it starts close to the end.
    """
    length, last = float(path.length_mm), len(path.segments) - 1
    aside = [0.5 if not s.turn_rad else min(NEAR_MM / float(s.length_mm), 0.5) for s in path.segments]
    places = path.within(0, aside[0]), path.within(last, 1 - aside[last])
    between = length - sum(aside[k] * float(path.segments[k].length_mm) for k in (0, last))
    rays = []
    for place, reach in zip(places, (-length, length), strict=True):
        start = np.array([place.x_mm, place.y_mm, height], float)
        rays.append([start, start + reach * np.array([place.along_x, place.along_y, 0.0], float)])
    return _Gauge(f"{name} length", length, np.array(rays), lambda runs: between + sum(runs))


def _worst(runs: list[float], planned: float, span: float, one: float, other: float) -> float:
    """Of one sum of two runs (with these factors, and `span`) per station, the one farthest from `planned`."""
    sizes = [span + one * a + other * b for a, b in zip(runs[::2], runs[1::2], strict=True)]
    return max(sizes, key=lambda size: abs(size - planned) if isfinite(size) else inf)


def _recess_gauges(plate: Plate, washer_x: float) -> Iterator[_Gauge]:
    washer = np.array([washer_x, 0.0, 0.0])
    aside = (plate.post_diameter_mm + plate.recess_diameter_mm) / 4
    under = washer + np.array([0.0, aside, -1.0])
    up = np.array([[under, under + np.array([0, 0, plate.recess_depth_mm + 2])]])
    yield _Gauge("recess depth", plate.recess_depth_mm, up, lambda runs: runs[0] - 1)
    over = washer + np.array([0, 0, plate.boss_top_mm + 1])
    down = np.array([[over, over - np.array([0, 0, plate.boss_top_mm])]])
    yield _Gauge("boss height", plate.boss_top_mm, down, lambda runs: plate.boss_top_mm + 1 - runs[0])


class _Hole(NamedTuple):
    """The outline (n, 2) of a hole of a cross-section and its centroid."""

    outline: np.ndarray
    centre: np.ndarray

    @property
    def diameter_mm(self) -> float:
        """The largest diameter: the corners of a round hole lie on its circle."""
        return 2 * float(np.hypot(*(self.outline - self.centre).T).max())


Holes = dict[tuple[int, int], list[_Hole]]


def _holes(plan: Plan, section: Any) -> Holes:
    """The holes of a cross-section, by the sub-cell that they lie in."""
    holes: Holes = {}
    for contour in section.to_polygons():
        following = np.roll(contour, -1, axis=0)
        cross = contour[:, 0] * following[:, 1] - contour[:, 1] * following[:, 0]
        if cross.sum() < 0:
            centre = ((contour + following) * cross[:, None]).sum(0) / (3 * cross.sum())
            holes.setdefault(_sub_cell(plan, *centre), []).append(_Hole(contour, centre))
    return holes


def _sub_cell(plan: Plan, x: float, y: float) -> tuple[int, int]:
    return int(np.floor(x / plan.cell.width_mm)), int(np.floor(y / plan.cell.depth_mm))


def _hole_around(plan: Plan, holes: Holes, taxel: Taxel) -> _Hole | None:
    """The hole around a taxel's washer: its recess."""
    column, row = _sub_cell(plan, taxel.x_mm, taxel.y_mm)
    near = [hole for i in (-1, 0, 1) for j in (-1, 0, 1) for hole in holes.get((column + i, row + j), [])]
    # The window around a plate may have the same centre as its recess, but is larger: it is none.
    most = LARGEST_RECESS * plan.plate.recess_diameter_mm
    inside = [hole for hole in near if _offset_mm(hole, taxel) < hole.diameter_mm / 2 < most / 2]
    return min(inside, key=lambda hole: hole.diameter_mm, default=None)


def _offset_mm(hole: _Hole, taxel: Taxel) -> float:
    return float(np.hypot(*(hole.centre - (taxel.x_mm, taxel.y_mm))))


def _both_ways(start: np.ndarray, reach: np.ndarray) -> np.ndarray:
    return np.array([[start, start + reach], [start, start - reach]])


def _placed(gauges: Iterator[_Gauge], channel: Channel) -> list[_Gauge]:
    return [gauge._replace(rays=to_cell(gauge.rays, channel)) for gauge in gauges]


def _coil_axis_mm(plan: Plan, taxel: Taxel) -> tuple[float, float]:
    row, column = taxel.coil
    coils = plan.coils
    return (
        (column - (coils.columns - 1) / 2) * coils.pitch_x_mm,
        (row - (coils.rows - 1) / 2) * coils.pitch_y_mm,
    )


def _run_mm(solid: Any, start: np.ndarray, stop: np.ndarray) -> float:
    """How far a ray runs until it meets a face; nan when it meets none."""
    hits = solid.ray_cast(tuple(start), tuple(stop))
    return float(hits[0].distance * np.linalg.norm(stop - start)) if hits else float("nan")
