"""Built = planned: dimensions of every taxel measured back from the final mesh by rays."""

from collections.abc import Callable, Iterator
from math import inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from padgen.planner.plan import Beam, Channel, Plan, Plate, Taxel
from padgen.planner.suspensions import Strip
from padgen.planner.tile import to_cell

__all__ = ["Dimension", "measured"]


STATIONS = (0.4, 0.65, 0.9)
"""Where along a beam, from the root, width and thickness are measured: outside the flare."""


class Dimension(NamedTuple):
    """One measured dimension: which taxel, what, as planned and as built, in mm (nan: not found)."""

    taxel: str
    name: str
    planned_mm: float
    built_mm: float


class _Gauge(NamedTuple):
    """A planned length, the rays (from, to, in own axes) that measure it, and how their runs make it up."""

    name: str
    planned_mm: float
    rays: np.ndarray
    combine: Callable[[list[float]], float]


def measured(plan: Plan, solid: Any) -> Iterator[Dimension]:
    """Measure beams, recess and boss of every taxel on the manifold `solid` of the pad.

    A ray runs until it meets a face: from within a beam sideways (width), above it along its axis
    (length), from below and above onto it (thickness), and up into the recess (depth). The recess's
    diameter and place are taken from a cross-section at half its depth.
    """
    gauges = {c.index: _placed(_gauges(plan, c), c) for c in plan.channels}
    recesses = _holes(plan, solid.slice(plan.plate.recess_depth_mm / 2))
    for taxel in plan.taxels:
        built, offset = _nearest_hole(plan, recesses, taxel)
        yield Dimension(taxel.id, "recess diameter", plan.plate.recess_diameter_mm, built)
        yield Dimension(taxel.id, "recess centre offset", 0.0, offset)
        centre = np.array([*_coil_axis_mm(plan, taxel), 0.0])
        around = np.array([-1.0, -1.0, 1.0]) if taxel.turned else np.ones(3)
        for gauge in gauges[taxel.channel]:
            runs = [_run_mm(solid, *(ray * around + centre)) for ray in gauge.rays]
            yield Dimension(taxel.id, gauge.name, gauge.planned_mm, gauge.combine(runs))


def _gauges(plan: Plan, channel: Channel) -> Iterator[_Gauge]:
    arrangement = plan.arrangement(channel)
    lowest_block = min(float(block.height_mm) for block in arrangement.blocks)
    for number, strip in enumerate(arrangement.beams):
        name = f"beam {number + 1}" if len(arrangement.beams) > 1 else "beam"
        yield from _beam_gauges(name, strip, channel.beam, lowest_block)
    yield from _recess_gauges(plan.plate, float(arrangement.washer_x_mm))


def _beam_gauges(name: str, strip: Strip, beam: Beam, lowest_block: float) -> Iterator[_Gauge]:
    root, run, y = float(strip.root_x_mm), float(strip.tip_x_mm - strip.root_x_mm), float(strip.y_mm)
    above = np.array([root + run / 2, y, (beam.thickness_mm + lowest_block) / 2])
    yield _Gauge(f"{name} length", beam.length_mm, _both_ways(above, [beam.length_mm, 0, 0]), sum)
    inside = [np.array([root + share * run, y, beam.thickness_mm / 2]) for share in STATIONS]
    across = np.concatenate([_both_ways(at, [0, beam.width_mm, 0]) for at in inside])
    yield _Gauge(f"{name} width", beam.width_mm, across, lambda runs: _worst(runs, beam.width_mm, 0.0, 1.0))
    span = lowest_block + 2
    faces = np.array([[[*at[:2], z], at] for at in inside for z in (-1.0, lowest_block + 1)])
    thickness = beam.thickness_mm
    yield _Gauge(f"{name} thickness", thickness, faces, lambda runs: _worst(runs, thickness, span, -1.0))
    yield _Gauge(f"{name} height above the bed", 0.0, faces[::2], lambda runs: max(runs) - 1)


def _worst(runs: list[float], planned: float, span: float, sign: float) -> float:
    """Of one sum of two runs (or what it leaves of `span`) per station, the one farthest from `planned`."""
    sizes = [span + sign * (a + b) for a, b in zip(runs[::2], runs[1::2], strict=True)]
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


Holes = dict[tuple[int, int], list[tuple[np.ndarray, float]]]


def _holes(plan: Plan, section: Any) -> Holes:
    """Centroid and largest diameter of each hole of a cross-section, by the sub-cell it lies in.

    The corners of a round hole lie on its circle, the sides between them within it.
    """
    holes: Holes = {}
    for contour in section.to_polygons():
        following = np.roll(contour, -1, axis=0)
        cross = contour[:, 0] * following[:, 1] - contour[:, 1] * following[:, 0]
        if cross.sum() < 0:
            centre = ((contour + following) * cross[:, None]).sum(0) / (3 * cross.sum())
            diameter = 2 * float(np.hypot(*(contour - centre).T).max())
            holes.setdefault(_sub_cell(plan, *centre), []).append((centre, diameter))
    return holes


def _sub_cell(plan: Plan, x: float, y: float) -> tuple[int, int]:
    return int(np.floor(x / plan.cell.width_mm)), int(np.floor(y / plan.cell.depth_mm))


def _nearest_hole(plan: Plan, holes: Holes, taxel: Taxel) -> tuple[float, float]:
    """Diameter of the hole around a taxel's washer and its centre's distance from there; nan without one."""
    column, row = _sub_cell(plan, taxel.x_mm, taxel.y_mm)
    near = [hole for i in (-1, 0, 1) for j in (-1, 0, 1) for hole in holes.get((column + i, row + j), [])]
    sized = [(diameter, float(np.hypot(*(centre - (taxel.x_mm, taxel.y_mm))))) for centre, diameter in near]
    # The window around a plate may have the same centre as its recess, but is larger.
    inside = [(diameter, offset) for diameter, offset in sized if offset < diameter / 2]
    return min(inside, default=(float("nan"), float("nan")))


def _both_ways(start: np.ndarray, reach: list[float]) -> np.ndarray:
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
