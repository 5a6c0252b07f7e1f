"""Work out the leakage between coils, which all use the same frequencies, and choose the cells to turn."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from math import hypot

import numpy as np

from padgen.core.units import MM, decibel
from padgen.physics.magnetic_charge import pole_error
from padgen.physics.magnetics import CoilSource, SteelRing
from padgen.physics.pull import Leakage, leakage
from padgen.physics.resonator import relative_energy
from padgen.physics.selectivity import Channels, Scheme, pair_lines, tone_energy
from padgen.physics.selectivity import channels as resonators
from padgen.planner.layout import Layout
from padgen.planner.plan import Channel, Reuse, Site
from padgen.planner.pull_modes import magnetic_parts
from padgen.planner.settings import level_law
from padgen.spec import Spec

__all__ = ["RINGS", "cell_is_turned", "coil_reuse", "coils_around", "turned_cells"]

TURNS = ("none", "odd rows", "odd columns")
RINGS = 5
"""Number of coils, in each direction, up to which leakage is counted."""
LEAK_ERROR = 0.2
"""Relative error of leakage from the nearest coils if cores are no longer than the pitch (docs/accuracy.md)."""


def coil_reuse(spec: Spec, layout: Layout, channels: Sequence[Channel], scheme: Scheme) -> Reuse:
    """Bound the leakage of the coils around, in their worst state, onto an OFF taxel.

    With the driver table neighbours play in step, so that their fields add. Where the taxel's own coil plays its other
    channels, its field beats with theirs.
    """
    turned = turned_cells(spec, layout, [channel.site for channel in channels])
    if layout.coils < 2:
        return Reuse(None, None, turned, (None,) * len(channels), (None,) * len(channels))
    pitch = np.array([spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows])
    washers_mm = tuple(channel.site.washer_mm for channel in channels)
    place = np.array(washers_mm)
    steps_to = coils_around(layout.rows, layout.columns)
    next_to = np.abs(steps_to).max(1) == 1
    at = steps_to * pitch * MM
    leak = _leakage(magnetic_parts(spec), spec.coil.gap_mm, washers_mm, (layout.rows, layout.columns), tuple(pitch))
    away = np.abs(steps_to).sum(1) % spec.coil.sets
    heard = [_heard(spec, scheme, channels, steps) for steps in range(spec.coil.sets)]
    energy, apart = np.zeros((2, len(channels)))
    for there in _surroundings(layout, steps_to):
        total, own_lines = np.zeros((2, len(channels)))
        for steps, (tones, spurs, beats) in enumerate(heard):
            some = there & (away == steps)
            square = np.abs(leak.mutual[:, some][:, :, some]).sum((1, 2))
            product = np.abs(leak.product[:, some]).sum(1)
            constant = product if scheme.is_biased else 0.0
            # Spurs and beats of the same channels have the same frequencies, so that their amplitudes add.
            total += (square + constant) ** 2 * tones + (square * np.sqrt(spurs) + product * np.sqrt(beats)) ** 2
            lines, products = _lines_apart(leak, some, scheme), (leak.product[:, some] ** 2).sum(1)
            own_lines += lines * tones + (np.sqrt(lines * spurs) + np.sqrt(products * beats)) ** 2
        energy, apart = np.maximum(energy, total), np.maximum(apart, own_lines)
    worst = int(energy.argmax())
    leaks, retuned = (tuple(-decibel(float(value) ** 0.5) for value in each) for each in (energy, apart))
    error = _leak_error(spec, layout, leak, place[:, None] * MM - at, ~next_to, pitch) + channels[worst].force_error
    return Reuse(leaks[worst], worst, turned, leaks, retuned, error)


@lru_cache(maxsize=64)
def _leakage(
    parts: tuple[CoilSource, SteelRing],
    gap_mm: float,
    washers_mm: tuple[tuple[float, float], ...],
    grid: tuple[int, int],
    pitch_mm: tuple[float, float],
) -> Leakage:
    """Return the leakage of the coils in the order of `coils_around`; it does not depend on the drive."""
    steps = coils_around(*grid)
    at, next_to = steps * np.array(pitch_mm) * MM, np.abs(steps).max(1) == 1
    return leakage(*parts, gap_mm * MM, np.array(washers_mm) * MM, at[next_to], at[~next_to])


def _lines_apart(leak: Leakage, some: np.ndarray, scheme: Scheme) -> np.ndarray:
    """Return the energy (n,) of the tones of coils with different frequencies, over that of the own coil's tone.

    Each coil then makes a line of its own, and with plain tones every two coils one more between theirs. Lines of
    different frequencies add as energies. With constant currents each coil's tone makes its line with all of them.
    """
    mutual = np.abs(leak.mutual[:, some][:, :, some])
    alone = np.einsum("nkk->nk", mutual)
    if scheme.has_constant:
        constant = np.abs(leak.product[:, some]) if scheme.is_biased else 0.0
        return ((mutual.sum(1) + constant) ** 2).sum(1)
    return 2 * (mutual**2).sum((1, 2)) - (alone**2).sum(1)


def _leak_error(
    spec: Spec, layout: Layout, leak: Leakage, away_m: np.ndarray, far: np.ndarray, pitch_mm: np.ndarray
) -> float:
    """Return the relative error of the leakage.

    It is made of the model's error, that of far coils taken as poles, and that of coils too far to be counted, whose
    field falls with the cube of the distance.
    """
    doubt = np.where(far, pole_error(magnetic_parts(spec)[0], np.linalg.norm(away_m, axis=-1)), 0.0)
    parts = (np.abs(leak.mutual).sum(1), 2.0), (np.abs(leak.product), 1.0)
    shares = [times * (doubt * part).sum(1) / np.maximum(part.sum(1), 1e-300) for part, times in parts]
    steps = np.stack(np.meshgrid(*(np.arange(-(n // 2), n // 2 + 1) for n in (layout.columns, layout.rows))), -1)
    cube = np.linalg.norm(steps * pitch_mm, axis=-1) ** 3
    ring = np.abs(steps).max(-1)
    beyond, counted = ((1 / cube[among]).sum() for among in (ring > RINGS, (ring > 0) & (ring <= RINGS)))
    # The model takes cores that magnetise each other as dipoles, which holds at distances above their length. Nearer
    # they do so with the cube of length over distance.
    nearest = np.linalg.norm(steps * pitch_mm, axis=-1)[ring > 0].min() * MM
    long = max(magnetic_parts(spec)[0].core_length / nearest, 1.0)
    return float(LEAK_ERROR * long**3 + max(map(np.max, shares)) + 2 * beyond / counted)


def _heard(spec: Spec, scheme: Scheme, channels: Sequence[Channel], steps: int) -> tuple[np.ndarray, ...]:
    """Return energies (n,) of OFF taxels, over their ON states, as if a coil `steps` away were their own.

    The three are by the tones of all channels of that coil, by its pair spurs, and by twice the product of its current
    with that of the own coil, which plays all channels but the OFF one.
    """
    resonance = np.array([channel.resonance_hz for channel in channels])
    mass = np.array([channel.effective_mass_g for channel in channels])
    taxels = resonators(resonance, spec.q_min, level_law(spec)(resonance), mass)
    sets, tones, spurs, beats = spec.coil.sets, *np.zeros((3, len(channels)))
    for i in range(len(channels)):
        taxel, other = Channels(*(part[[i]] for part in taxels)), slice((i + steps) % sets, None, sets)
        played = Channels(*(part[other] for part in taxels))
        own = [k for k in range(i % sets, len(channels), sets) if k != i]
        tones[i] = tone_energy(taxel, played).sum()
        if scheme.has_pair_spurs:
            spurs[i] = _line_energy(taxel, *pair_lines(played, scheme)[:3])
        beats[i] = _beat_energy(taxel, Channels(*(part[own] for part in taxels)), played, scheme, spec.drive.headroom)
    return tones, spurs, beats


def _beat_energy(taxel: Channels, own: Channels, other: Channels, scheme: Scheme, headroom: float) -> float:
    """Return the largest energy by twice the product of the currents of the own coil and another.

    With tones or biased currents every two channels make a line at their sum and one at their difference; the caller
    counts the constant of biased currents. With spur-free currents the own root is at most the root of its mean square;
    the other coil plays one channel alone, whose root has harmonics of ``4√2/(π(4n² − 1)) √a``.
    """
    if not len(own.line) or scheme.takes_turns:
        return 0.0
    if scheme.has_pair_spurs:
        # If both coils play the same two channels, these make the same line twice, at worst in step.
        twice = 1.0 if set(own.resonance_hz.tolist()).isdisjoint(other.resonance_hz.tolist()) else 2.0
        both = Channels(*(np.concatenate(parts) for parts in zip(own, other, strict=True)))
        a, b = np.indices((len(own.line), len(other.line))).reshape(2, -1)
        made = pair_lines(both, scheme, (a, b + len(own.line)), other.line.max())
        return twice * _line_energy(taxel, *made[:3])
    mean = (1 + headroom) * own.line.sum()
    harmonic = np.arange(1, 4)[:, None]
    amplitude = 8 * 2**0.5 / (np.pi * (4 * harmonic**2 - 1)) * np.sqrt(mean * other.line)
    return _line_energy(taxel, harmonic * other.resonance_hz, np.zeros(1), amplitude**2)


def _line_energy(taxel: Channels, hz: np.ndarray, rest: np.ndarray, square: np.ndarray) -> float:
    """Return the energy of a taxel under lines (as in `selectivity.Lines`), over that of its ON state."""
    response = relative_energy(hz, taxel.resonance_hz[0], taxel.q[0], rest)
    return float((response * square).sum() / taxel.line[0] ** 2)


def coils_around(rows: int, columns: int) -> np.ndarray:
    """Return the steps (k, 2) along x and y from a coil in the middle of the grid to those around, the nearest first.

    They reach as far as `RINGS`. With an even number of rows or columns they are those around either middle coil.
    """
    sides = (range(-min(n // 2, RINGS), min(n // 2, RINGS) + 1) for n in (columns, rows))
    steps = [step for step in product(*sides) if step != (0, 0)]
    return np.array(sorted(steps, key=lambda step: max(map(abs, step)) > 1))


def _surroundings(layout: Layout, steps: np.ndarray) -> list[np.ndarray]:
    """Return masks (k,), one for each coil in the middle of the grid: true for `steps` that lead to a coil."""
    spans = [{(-(n // 2), (n - 1) // 2), (-((n - 1) // 2), n // 2)} for n in (layout.columns, layout.rows)]
    low_high = [np.array(span) for span in product(*(sorted(span) for span in spans))]
    return [np.asarray(((steps >= span[:, 0]) & (steps <= span[:, 1])).all(1)) for span in low_high]


def turned_cells(spec: Spec, layout: Layout, sites: Sequence[Site]) -> str:
    """Choose the cells to turn by 180° so that taxels of one channel lie farthest apart."""
    # Lists of distances compare by the shortest first; of equal ones, `max` takes the simplest choice.
    return max(TURNS, key=lambda turned: _distances_mm(spec, layout, sites, turned))


def cell_is_turned(turned: str, row: int, column: int) -> bool:
    """Return whether the cell of a coil is turned by 180°."""
    return {"none": False, "odd rows": row % 2 == 1, "odd columns": column % 2 == 1}[turned]


def _distances_mm(spec: Spec, layout: Layout, sites: Sequence[Site], turned: str) -> list[float]:
    """Return the distances in mm of taxels of one channel in neighbouring cells, the shortest first."""
    pitch_x, pitch_y = spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows
    distances = []
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1)):
        if row >= layout.rows or column >= layout.columns:
            continue
        # Measured from a cell that is not turned; from a turned one the distances are the same.
        shift = -2 if cell_is_turned(turned, row, column % 2) else 0
        for site in sites:
            x, y = site.washer_mm
            distances.append(round(hypot(column * pitch_x + shift * x, row * pitch_y + shift * y), 6))
    return sorted(distances)
