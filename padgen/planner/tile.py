"""From a taxel's own axes to the pad's, and a tile's outline in its own axes."""

from typing import NamedTuple

import numpy as np

from padgen.planner.plan import Channel, Plan

__all__ = ["TURNS", "Outline", "outline", "to_cell"]

TURNS = {"+x": (1, 0), "+y": (0, 1), "-x": (-1, 0), "-y": (0, -1)}
"""Where a taxel's own x axis points, as (cosine, sine): whole quarter turns, exact."""


class Outline(NamedTuple):
    """A rectangle in mm, by its sides."""

    x0: float
    x1: float
    y0: float
    y1: float


def to_cell(points: np.ndarray, channel: Channel) -> np.ndarray:
    """Turn and shift own (…, ≥2) coordinates in mm to the cell, whose origin is the coil axis."""
    cosine, sine = TURNS[channel.site.along]
    moved = points.copy()
    moved[..., 0] = cosine * points[..., 0] - sine * points[..., 1] + channel.site.origin_mm[0]
    moved[..., 1] = sine * points[..., 0] + cosine * points[..., 1] + channel.site.origin_mm[1]
    return moved


def outline(plan: Plan, channel: Channel) -> Outline:
    """The sub-cell of `channel` in the taxel's own axes."""
    cosine, sine = TURNS[channel.site.along]
    x = channel.site.centre_mm[0] - channel.site.origin_mm[0]
    y = channel.site.centre_mm[1] - channel.site.origin_mm[1]
    x, y = cosine * x + sine * y, -sine * x + cosine * y
    width, depth = plan.cell.width_mm, plan.cell.depth_mm
    if sine:
        width, depth = depth, width
    return Outline(x - width / 2, x + width / 2, y - depth / 2, y + depth / 2)
