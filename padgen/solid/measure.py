"""Measurement of every taxel's dimensions on the finished mesh, by rays and cross-sections."""

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
"""Shares of a straight beam's length, from the root, at which width and thickness are measured, beyond the flare."""
HEIGHTS = (0.02, 0.5, 0.98)
"""Shares of a recess's depth at which the room for a washer is measured, since its mouth may be narrower."""
LARGEST_RECESS = 1.5
"""Largest diameter of a hole that counts as a recess, in planned recess diameters."""
NEAR_MM = 0.05
"""Distance from the end of an arc at which a ray along the arc starts."""


class Dimension(NamedTuple):
    """One measured dimension of a taxel, as planned and as built, in mm (nan where it was not found).

    The triangles of a round face may change it by `facets_mm`.
    """

    taxel: str
    name: str
    planned_mm: float
    built_mm: float
    facets_mm: float = 0.0


class _Gauge(NamedTuple):
    """A planned length in mm, the rays that measure it, and the function that combines their runs to that length.

    `rays` (n, 2, 3) are from and to, in the taxel's axes. A run is the distance in mm from a ray's start to a face.
    """

    name: str
    planned_mm: float
    rays: np.ndarray
    combine: Callable[[list[float]], float]
    facets_mm: float = 0.0


def measured(plan: Plan, solid: Any, taxels: Sequence[Taxel] | None = None) -> Iterator[Dimension]:
    """Measure beams, recess and boss of these taxels, or all, on the manifold `solid` of the pad or a part of it.

    Each ray runs until it meets a face. Rays go sideways from within a beam (its width and place), above the beam
    along its path to both ends (length), onto the beam from below and above (thickness), and up into the recess
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
    """Yield for each taxel its id and the free diameter of its recess in mm, nan where there is no recess.

    The free diameter is that of the largest circle about the recess's middle that holds no plastic. In the mesh a
    round recess is a polygon, whose sides lie nearer to the middle than its corners do.
    """
    cuts = [_holes(plan, solid.slice(plan.plate.recess_depth_mm * share)) for share in HEIGHTS]
    for taxel in taxels:
        found = [_hole_around(plan, holes, taxel) for holes in cuts]
        rooms = [nan if hole is None else 2 * distance_to_sides(hole.outline, hole.centre) for hole in found]
        yield taxel.id, float(np.min(rooms))


def distance_to_sides(outline: np.ndarray, at: np.ndarray) -> float:
    """Return the distance from a point (2,) to the nearest side of a closed outline (n, 2)."""
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
        # The planned length between a bent beam's ends counts as built only if the beam lies on its path.
        yield _Gauge("offset from its path", 0.0, across, lambda runs: _worst(runs, 0.0, 0.0, 0.5, -0.5))
    span = lowest_block + 2
    faces = np.array([[[*at[:2], z], at] for at in inside for z in (-1.0, lowest_block + 1)])
    yield _Gauge("thickness", thickness, faces, lambda runs: _worst(runs, thickness, span, -1.0, -1.0))
    yield _Gauge("height above the bed", 0.0, faces[::2], lambda runs: max(runs) - 1)


def _length_gauge(name: str, path: BeamPath, height: float) -> _Gauge:
    """Gauge a beam's length by rays back to the frame and forward to the plate, `height` mm above the bed.

    They start within the first and the last segment. A straight ray leaves an arc, so on an arc it starts close to
    the arc's end.
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
    """Return the size farthest from `planned` of one per station: ``span + one * run + other * next run``, in mm."""
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
    """The outline (n, 2) of a hole in a cross-section, and the hole's centroid (2,), in mm."""

    outline: np.ndarray
    centre: np.ndarray

    @property
    def diameter_mm(self) -> float:
        """The largest diameter: the corners of a round hole lie on its true circle."""
        return 2 * float(np.hypot(*(self.outline - self.centre).T).max())


Holes = dict[tuple[int, int], list[_Hole]]


def _holes(plan: Plan, section: Any) -> Holes:
    """Return the holes of a cross-section, by the sub-cell that they lie in."""
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
    """Return the hole around a taxel's washer, which is its recess, or None."""
    column, row = _sub_cell(plan, taxel.x_mm, taxel.y_mm)
    near = [hole for i in (-1, 0, 1) for j in (-1, 0, 1) for hole in holes.get((column + i, row + j), [])]
    # The window around a plate may have the same centre as the recess, but it is larger.
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
    """Return the distance in mm from a ray's start to the first face, nan where it meets none."""
    hits = solid.ray_cast(tuple(start), tuple(stop))
    return float(hits[0].distance * np.linalg.norm(stop - start)) if hits else float("nan")
