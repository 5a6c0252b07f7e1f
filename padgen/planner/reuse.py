"""Frequencies are used again over every coil: what leaks from coil to coil, and how cells are turned."""

from collections.abc import Sequence
from itertools import product
from math import hypot

import numpy as np

from padgen.physics.leakage import leakage
from padgen.physics.resonator import relative_energy
from padgen.physics.selectivity import Channels, Scheme, pair_lines, tone_energy
from padgen.physics.selectivity import channels as resonators
from padgen.planner.channels import magnetic_parts, squared_current_lines
from padgen.planner.layout import Layout
from padgen.planner.plan import Channel, Reuse, Site
from padgen.planner.settings import level_law, scheme_named
from padgen.spec import Spec
from padgen.units import MM, decibel

__all__ = ["cell_is_turned", "coil_reuse", "turned_cells"]

TURNS = ("none", "odd rows", "odd columns")


def coil_reuse(spec: Spec, layout: Layout, channels: Sequence[Channel], drive: str) -> Reuse:
    """Leakage of the neighbouring coils in their worst state onto an OFF taxel, a bound.

    Neighbours of the taxel's own set reach it at its resonance, in step, so that their fields and not
    their pulls add; those of the other set beside it. Where the own coil is on for its other channels,
    its field beats with theirs.
    """
    turned = turned_cells(spec, layout, [channel.site for channel in channels])
    if layout.coils < 2:
        return Reuse(None, None, turned)
    scheme, steps = scheme_named(spec, drive), _STEPS
    pitch = np.array([spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows])
    place = np.array([channel.site.washer_mm for channel in channels])
    leak = leakage(*magnetic_parts(spec), spec.coil.gap_mm * MM, place * MM, steps * pitch * MM)
    which = _as_resonators(spec, channels)
    heard = tone_energy(which, which)
    beat = _beats(scheme, channels, spec.coil.sets, spec.drive.headroom)
    energy = np.zeros(len(channels))
    for there in _surroundings(layout):
        kind = np.abs(steps).sum(1) % spec.coil.sets
        total = np.zeros(len(channels))
        for k in range(spec.coil.sets):
            some = there & (kind == k)
            amplitude = np.sqrt(np.abs(leak.square[:, some])).sum(1) ** 2
            amplitude = amplitude + beat * np.abs(leak.product[:, some]).sum(1)
            # Coils an even number of steps away have the taxel's own set.
            lines = _same_set(len(channels), spec.coil.sets, k)
            total += amplitude**2 * ((heard * lines).sum(1) + _spurs_heard(scheme, which, spec.coil.sets, k))
        energy = np.maximum(energy, total)
    worst = int(energy.argmax())
    return Reuse(-decibel(float(energy[worst]) ** 0.5), worst, turned)


def _beats(scheme: Scheme, channels: Sequence[Channel], sets: int, headroom: float) -> np.ndarray:
    """How much of a neighbour's wanted line (n,) the own coil's constant current makes of its field.

    Biased, the constant is always there: all of it. Spur-free, it is at most the root of what the own
    other channels want, with headroom, against a neighbour that plays this channel alone: twice its
    root's first harmonic, 4√2/(3π) √a.
    """
    if scheme.name == "biased":
        return np.ones(len(channels))
    if scheme.name != "spur-free":
        return np.zeros(len(channels))
    lines = squared_current_lines(channels)
    own = np.array([lines[i % sets :: sets].sum() for i in range(len(lines))])
    share: np.ndarray = np.divide(own - lines, lines, out=np.zeros(len(lines)), where=lines > 0)
    factor: np.ndarray = 8 * 2**0.5 / (3 * np.pi) * np.sqrt((1 + headroom) * np.maximum(share, 0.0))
    return factor


def _as_resonators(spec: Spec, channels: Sequence[Channel]) -> Channels:
    """The channels of all sets as if one coil had them, their washers pulled alike."""
    resonance = np.array([channel.resonance_hz for channel in channels])
    mass = np.array([channel.effective_mass_g for channel in channels])
    return resonators(resonance, spec.q_min, level_law(spec)(resonance), mass)


def _spurs_heard(scheme: Scheme, which: Channels, sets: int, steps: int) -> np.ndarray:
    """Energy (n,) that the pair spurs of a coil so many steps away would have on each taxel."""
    heard = np.zeros(len(which.line))
    for own in range(sets if scheme.has_pair_spurs else 0):
        played = Channels(*(part[(own + steps) % sets :: sets] for part in which))
        frequency, rest, amplitude = pair_lines(played, scheme)
        for i in range(own, len(heard), sets):
            response = relative_energy(frequency, which.resonance_hz[i], which.q[i], rest).sum(0)
            heard[i] = (response * (amplitude / which.line[i]) ** 2).sum()
    return heard


def _same_set(count: int, sets: int, steps: int) -> np.ndarray:
    """Which channels (n, n) a coil so many steps away plays that taxel i would hear.

    With one set, only its own: what others do is small beside it, and judged within the coil.
    """
    index = np.arange(count)
    if sets == 1:
        return np.eye(count, dtype=bool)
    mine: np.ndarray = (index[:, None] + steps - index) % sets == 0
    return mine


_STEPS = np.array([(x, y) for x, y in product((-1, 0, 1), repeat=2) if (x, y) != (0, 0)])
"""Steps (8, 2) along x and y to the coils around."""


def _surroundings(layout: Layout) -> list[np.ndarray]:
    """Which of `_STEPS` lead to a coil, for each kind of corner of a grid of two, or for its middle."""
    sides = [[(-1, 0, 1)] if n > 2 else [(0, 1), (-1, 0)] if n == 2 else [(0,)] for n in (layout.columns, layout.rows)]
    return [np.isin(_STEPS[:, 0], x) & np.isin(_STEPS[:, 1], y) for x, y in product(*sides)]


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
