"""Frequencies are used again over every coil: what leaks from coil to coil, and how cells are turned."""

from collections.abc import Sequence
from itertools import product
from math import hypot

import numpy as np

from padgen.physics.leakage import leakage
from padgen.planner.channels import magnetic_parts
from padgen.planner.layout import Layout
from padgen.planner.plan import Channel, Reuse, Site
from padgen.spec import Spec
from padgen.units import MM, decibel

__all__ = ["cell_is_turned", "coil_reuse", "turned_cells"]

TURNS = ("none", "odd rows", "odd columns")


def coil_reuse(spec: Spec, layout: Layout, channels: Sequence[Channel], drive: str) -> Reuse:
    """Leakage of the neighbouring coils, all with the same channel on, onto an OFF taxel of that channel."""
    turned = turned_cells(spec, layout, [channel.site for channel in channels])
    neighbours = _neighbours(spec, layout)
    if not len(neighbours):
        return Reuse(None, None, turned)
    place = np.array([channel.site.washer_mm for channel in channels]) * MM
    leak = leakage(*magnetic_parts(spec), spec.coil.gap_mm * MM, place, neighbours * MM)
    amplitude = np.abs(leak.square).sum(1)
    if drive in ("spur-free", "biased") and len(channels) > 1:
        # The own coil is on for its other channels: its constant part beats with the neighbour's tone.
        amplitude = amplitude + np.abs(leak.product).sum(1)
    worst = int(amplitude.argmax())
    return Reuse(-decibel(float(amplitude[worst])), worst, turned)


def turned_cells(spec: Spec, layout: Layout, sites: Sequence[Site]) -> str:
    """Which cells to turn by 180° so that taxels of one channel lie farthest apart."""
    # Compared from the shortest distance on; the first of equals.
    return max(TURNS, key=lambda turned: _distances_mm(spec, layout, sites, turned))


def cell_is_turned(turned: str, row: int, column: int) -> bool:
    """Whether the cell of a coil is turned by 180°."""
    return {"none": False, "odd rows": row % 2 == 1, "odd columns": column % 2 == 1}[turned]


def _distances_mm(spec: Spec, layout: Layout, sites: Sequence[Site], turned: str) -> list[float]:
    """Distances of taxels of one channel in neighbouring cells, the shortest first."""
    pitch_x, pitch_y = spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows
    distances = []
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1)):
        if row >= layout.rows or column >= layout.columns:
            continue
        # Seen from a cell that is not turned; from one that is, it looks the same turned round.
        shift = -2 if cell_is_turned(turned, row, column % 2) else 0
        for site in sites:
            x, y = site.washer_mm
            distances.append(round(hypot(column * pitch_x + shift * x, row * pitch_y + shift * y), 6))
    return sorted(distances)


def _neighbours(spec: Spec, layout: Layout) -> np.ndarray:
    """Axes (k, 2) in mm of the coils around one of the best surrounded."""
    pitch_x, pitch_y = spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows
    steps_x = range(-1, 2) if layout.columns > 2 else range(layout.columns)
    steps_y = range(-1, 2) if layout.rows > 2 else range(layout.rows)
    return np.array([(x * pitch_x, y * pitch_y) for x, y in product(steps_x, steps_y) if (x, y) != (0, 0)])
