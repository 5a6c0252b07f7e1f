"""Frequencies are used again over every coil: what leaks from coil to coil, and how cells are turned."""

from collections.abc import Sequence
from itertools import product
from math import hypot

import numpy as np

from padgen.physics.leakage import leakage
from padgen.physics.selectivity import channels as resonators
from padgen.physics.selectivity import tone_energy
from padgen.planner.channels import magnetic_parts
from padgen.planner.layout import Layout
from padgen.planner.plan import Channel, Reuse, Site
from padgen.planner.selectivity import level_law
from padgen.spec import Spec
from padgen.units import MM, decibel

__all__ = ["cell_is_turned", "coil_reuse", "turned_cells"]

TURNS = ("none", "odd rows", "odd columns")


def coil_reuse(spec: Spec, layout: Layout, channels: Sequence[Channel], drive: str) -> Reuse:
    """Leakage of the neighbouring coils, all their channels on, onto an OFF taxel.

    Neighbours of the taxel's own set reach it at its resonance, their pulls in step; those of the
    other set beside it.
    """
    turned = turned_cells(spec, layout, [channel.site for channel in channels])
    steps = _steps(layout)
    if not len(steps):
        return Reuse(None, None, turned)
    pitch = np.array([spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows])
    place = np.array([channel.site.washer_mm for channel in channels])
    leak = leakage(*magnetic_parts(spec), spec.coil.gap_mm * MM, place * MM, steps * pitch * MM)
    amplitude = np.abs(leak.square)
    if drive in ("spur-free", "biased") and layout.channels > 1:
        # The own coil is on for its other channels: its constant part beats with the neighbour's tone.
        amplitude = amplitude + np.abs(leak.product)
    energy = ((amplitude[:, :, None] * _lines_heard(spec, channels, steps)).sum(1) ** 2).sum(-1)
    worst = int(energy.argmax())
    return Reuse(-decibel(float(energy[worst]) ** 0.5), worst, turned)


def _lines_heard(spec: Spec, channels: Sequence[Channel], steps: np.ndarray) -> np.ndarray:
    """How much of its ON amplitude taxel i gets at the tone of channel j of the coil k steps away, were it its
    own coil: (n, k, n), 0 where that coil has no such channel."""
    resonance = np.array([channel.resonance_hz for channel in channels])
    mass = np.array([channel.effective_mass_g for channel in channels])
    which = resonators(resonance, spec.q_min, level_law(spec)(resonance), mass)
    kind = np.arange(len(channels)) % spec.coil.sets
    there = (kind[:, None] + np.abs(steps).sum(-1)) % spec.coil.sets
    heard: np.ndarray = np.sqrt(tone_energy(which, which))[:, None] * (there[:, :, None] == kind)
    if spec.coil.sets == 1:
        # What other channels of the same set do is small beside a channel's own, and judged within the coil.
        heard = heard * np.eye(len(channels))[:, None]
    return heard


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


def _steps(layout: Layout) -> np.ndarray:
    """Steps (k, 2) along x and y to the coils around one of the best surrounded."""
    steps_x = range(-1, 2) if layout.columns > 2 else range(layout.columns)
    steps_y = range(-1, 2) if layout.rows > 2 else range(layout.rows)
    return np.array([(x, y) for x, y in product(steps_x, steps_y) if (x, y) != (0, 0)])
