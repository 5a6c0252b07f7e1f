"""Place taxels and tiles: from own axes to the pad's, their outlines and pitch, and grooves that mark corners."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import number
from padgen.core.finding import Finding
from padgen.planner.plan import TURNS, Channel, Pitch, Plan, Taxel
from padgen.spec import Spec

__all__ = [
    "Outline",
    "corner_groove",
    "groove",
    "judge_pitch",
    "outline",
    "pitch_of",
    "shape_inputs",
    "taxel_places",
    "to_cell",
]


def taxel_places(plan: Plan) -> np.ndarray:
    """Return the index of the taxel in each sub-cell of the pad, (rows, columns) from the lower left; -1 for none."""
    cell, coils = plan.cell, plan.coils
    places = np.full((coils.rows * cell.rows, coils.columns * cell.columns), -1)
    for index, taxel in enumerate(plan.taxels):
        x, y = (-v if taxel.turned else v for v in plan.channels[taxel.channel].site.centre_mm)
        column = round(x / cell.width_mm + (cell.columns - 1) / 2) + taxel.coil[1] * cell.columns
        row = round(y / cell.depth_mm + (cell.rows - 1) / 2) + taxel.coil[0] * cell.rows
        places[row, column] = index
    return places


class Outline(NamedTuple):
    """A rectangle in mm, by its sides."""

    x0: float
    x1: float
    y0: float
    y1: float


def to_cell(points: np.ndarray, channel: Channel) -> np.ndarray:
    """Turn and shift points (…, ≥2) in mm from a taxel's own axes to the cell's, whose origin is the coil axis."""
    cosine, sine = TURNS[channel.site.along]
    moved = points.copy()
    moved[..., 0] = cosine * points[..., 0] - sine * points[..., 1] + channel.site.origin_mm[0]
    moved[..., 1] = sine * points[..., 0] + cosine * points[..., 1] + channel.site.origin_mm[1]
    return moved


def outline(plan: Plan, channel: Channel) -> Outline:
    """Return the sub-cell of `channel` in the taxel's own axes, rounded to 1e-9 mm so that layouts share taxels."""
    cosine, sine = TURNS[channel.site.along]
    x = channel.site.centre_mm[0] - channel.site.origin_mm[0]
    y = channel.site.centre_mm[1] - channel.site.origin_mm[1]
    x, y = cosine * x + sine * y, -sine * x + cosine * y
    width, depth = plan.cell.width_mm, plan.cell.depth_mm
    if sine:
        width, depth = depth, width
    return Outline(*(round(v, 9) for v in (x - width / 2, x + width / 2, y - depth / 2, y + depth / 2)))


def shape_inputs(plan: Plan, channel: Channel) -> dict[str, Any]:
    """Return all that the solid of a taxel depends on as plain data, for every kind of suspension."""
    return {
        "plate": asdict(plan.plate),
        "arrangement": _plain(plan.arrangement(channel)),
        "fillet_mm": channel.beam.fillet_mm,
        "outline": outline(plan, channel),
        "frame_mm": plan.spec.pad.frame_thickness_mm,
    }


def _plain(value: Any) -> Any:
    return [_plain(entry) for entry in value] if isinstance(value, tuple) else float(value)


WIDTH_MM, DEPTH_MM = 1.5, 1.0


def groove(spec: Spec, x_mm: float, above: bool = False) -> Outline:
    """Return a groove at `x_mm` in the border's side towards −y, or towards +y with `above`.

    The outline reaches outwards as far as inwards, so that it can be subtracted from the border as it is.
    """
    pad = spec.pad
    side = 1 if above else -1
    edge = side * (pad.depth_mm / 2 + pad.border_mm)
    depth = min(DEPTH_MM, pad.border_mm / 4)
    return Outline(x_mm - WIDTH_MM / 2, x_mm + WIDTH_MM / 2, edge - depth, edge + depth)


def corner_groove(spec: Spec) -> Outline:
    """Return the groove at the corner of the coil in row 0, column 0: where the active area begins, towards −y."""
    return groove(spec, (WIDTH_MM - spec.pad.width_mm) / 2)


SAME_MM = 0.05
"""Taxels whose places differ by no more belong to one row or column."""
LARGEST_RATIO = 1.2
"""Largest over smallest distance up to which taxels feel evenly spaced."""
HOLE_RATIO = 2.0
"""Largest over smallest distance above which a display has holes."""


def pitch_of(taxels: Sequence[Taxel]) -> Pitch:
    """Return the distances in mm of neighbouring columns and rows, and the share of their crossings with a taxel."""
    columns, rows = (_lines([getattr(t, axis) for t in taxels]) for axis in ("x_mm", "y_mm"))
    x, y = (_steps(lines) for lines in (columns, rows))
    ratio = max((high / low for low, high in (step for step in (x, y) if step)), default=1.0)
    return Pitch(x, y, ratio, len(taxels) / (len(columns) * len(rows)))


def _lines(places_mm: list[float]) -> list[float]:
    lines: list[float] = []
    for place in sorted(places_mm):
        if not lines or place - lines[-1] > SAME_MM:
            lines.append(place)
    return lines


def _steps(lines: list[float]) -> tuple[float, ...]:
    steps = [round(b - a, 3) for a, b in pairwise(lines)]
    return (min(steps), max(steps)) if steps else ()


def judge_pitch(plan: Plan) -> Iterator[Finding]:
    """Yield a note where the pitch is uneven, a warning where a display would have holes."""
    pitch = plan.pitch
    if pitch.ratio > LARGEST_RATIO:
        axes = {"columns": pitch.x_mm, "rows": pitch.y_mm}
        name, (low, high) = max(
            ((name, step) for name, step in axes.items() if step), key=lambda item: item[1][1] / item[1][0]
        )
        yield Finding(
            "warning" if pitch.ratio > HOLE_RATIO else "note",
            "layout.pitch",
            "pad",
            f"{name} of taxels lie {number(low)} to {number(high)} mm apart, a ratio of {number(high / low)};"
            f" up to {LARGEST_RATIO:g} counts as even. Washers hang as near to their coil's axis as their beams allow",
        )
