"""Convert a taxel's own axes to the pad's, and give a tile's outline in its own axes."""

from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from padgen.planner.plan import Channel, Plan

__all__ = ["TURNS", "Outline", "outline", "shape_inputs", "taxel_places", "to_cell"]

TURNS = {"+x": (1, 0), "+y": (0, 1), "-x": (-1, 0), "-y": (0, -1)}
"""Direction of a taxel's own x axis as (cosine, sine): exact quarter turns."""


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
