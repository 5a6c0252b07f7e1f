"""Modes of the whole pad, and what a taxel driven at its resonance does to the others.

The iteration of `pad_lowest` starts from the tiles' own modes and from the frame's, and these from smooth
bending of the whole pad. Damping is structural: every stiffness times 1 + j/Q.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.core.units import MM
from padgen.verify.pad_lowest import ACCURACY, Ritz, lowest_modes
from padgen.verify.pad_reduction import ReducedPad
from padgen.verify.pad_strips import factored, solved

__all__ = [
    "Crosstalk",
    "PadModes",
    "Shift",
    "crosstalk",
    "driven_taxels",
    "frame_modes_hz",
    "frequency_shifts",
    "pad_modes",
    "receptance",
]

NEAR_BAND = 1.2
"""Modes are found up to this many times the band's top."""
GUARD = 1.5
"""Tiles' modes up to this many times the highest frequency start the iteration."""
WAVES = 8
"""Polynomials along each side of the pad that start the frame's modes."""


class PadModes(NamedTuple):
    """Modes of a pad, lowest first.

    `frequency_hz` (k,); `frame_share` (k,), the part of a mode's mass that is not the taxels' swinging in their
    sub-cells; `frame_hz`, the frame's own modes (`frame_modes_hz`); `error`, the largest relative error of a
    frequency by its residual. `square` (m,) in (rad/s)² and `motion` (taxels, m), the washers' vertical motion in
    kg^-½, have the modes and, beyond, less exact ones.
    """

    frequency_hz: np.ndarray
    frame_share: np.ndarray
    frame_hz: np.ndarray
    error: float
    square: np.ndarray
    motion: np.ndarray


class Shift(NamedTuple):
    """How far the resonances of a channel's taxels lie from the clamped sub-cell's, as shares of it.

    `lowest`, `mean` and `highest` over its taxels on the pad.
    """

    channel: int
    clamped_hz: float
    lowest: float
    mean: float
    highest: float


class Crosstalk(NamedTuple):
    """One taxel driven at its resonance: how far below it the others move, in dB, vertically at their washers.

    `below_db` (taxels,) has all, 0 for itself. `same_coil` and `next_coil` name the loudest there, None
    where there is no other; `next_alike` the loudest of the next coils' taxels of its own channel.
    """

    taxel: str
    resonance_hz: float
    below_db: np.ndarray
    same_coil: tuple[str, float] | None
    next_coil: tuple[str, float] | None
    next_alike: tuple[str, float] | None


def pad_modes(pad: ReducedPad, highest_hz: float | None = None, accuracy: float = ACCURACY) -> PadModes:
    """All modes up to `highest_hz`, by default a fifth above the band's top.

    `accuracy` is the largest relative error of a frequency, by its residual.

    Raises
    ------
    SolverError
        The iteration does not converge, or misses a mode.
    """
    limit = _limit(pad, highest_hz)
    assembly = pad.assembly
    frame = _frame(pad, limit)
    own = np.flatnonzero(assembly.square < GUARD**2 * limit) + assembly.size - len(assembly.square)
    start = np.zeros((assembly.size, len(own) + frame.vectors.shape[1]))
    start[own, np.arange(len(own))] = 1.0
    start[: len(frame.vectors), len(own) :] = frame.vectors
    ritz = lowest_modes(assembly, assembly.times_mass(start), limit, accuracy)
    below = int((ritz.square < limit).sum())
    motion = pad.pulls.T @ ritz.vectors
    share = 1 - (ritz.vectors[assembly.size - len(assembly.square) :, :below] ** 2).sum(0)
    return PadModes(
        _hertz(ritz.square[:below]),
        share,
        _hertz(frame.square[frame.square < limit]),
        ritz.error,
        ritz.square,
        motion,
    )


def frame_modes_hz(pad: ReducedPad, highest_hz: float | None = None) -> np.ndarray:
    """Frequencies of the frame's own modes, all taxels riding on it without swinging, up to `highest_hz`.

    By default a fifth above the band's top. On the pad each of them mixes with the taxels near it.
    """
    limit = _limit(pad, highest_hz)
    square = _frame(pad, limit).square
    return _hertz(square[square < limit])


def _frame(pad: ReducedPad, limit: float) -> Ritz:
    frame = pad.assembly.without_modes
    return lowest_modes(frame, frame.times_mass(_waves(pad)[: frame.size]), limit)


def _limit(pad: ReducedPad, highest_hz: float | None) -> float:
    top = NEAR_BAND * pad.plan.spec.band_hz[1] if highest_hz is None else highest_hz
    if not top > 0:
        raise SolverError(f"must be above 0 Hz, got {number(top)}", "highest_hz")
    return (2 * np.pi * top) ** 2


def _hertz(square: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.maximum(square, 0.0)) / (2 * np.pi))


def _waves(pad: ReducedPad) -> np.ndarray:
    """Plate bending with polynomial deflections, and shear and turning in the plane, at the lattice's vertices."""
    lines = _lines_m(pad)
    thickness = pad.plan.spec.pad.frame_thickness_mm * MM
    vertex = [k for k, place in enumerate(pad.assembly.places) if place[0] == "vertex"]
    columns, rows = np.array([pad.assembly.places[k][1:] for k in vertex], dtype=np.int64).reshape(-1, 2).T
    height = np.array([pad.assembly.functions[k].height for k in vertex])
    axis = np.array([pad.assembly.functions[k].axis for k in vertex])
    half = [np.abs(line).max() for line in lines]
    place = lines[0][columns] / half[0], lines[1][rows] / half[1]
    shapes = []
    unit = np.eye(WAVES)
    for i, j in np.ndindex(WAVES, WAVES):
        one, other = (np.polynomial.Polynomial(np.polynomial.legendre.leg2poly(unit[k])) for k in (i, j))
        slope = one.deriv()(place[0]) * other(place[1]) / half[0], one(place[0]) * other.deriv()(place[1]) / half[1]
        deflection = np.where((axis == 2) & (height == 0), one(place[0]) * other(place[1]), 0.0)
        for k in (0, 1):
            deflection[(axis == k) & (height == 1)] = -thickness / 2 * slope[k][(axis == k) & (height == 1)]
        shapes.append(deflection)
        if i + j < 2:
            shapes += [np.where((axis == k) & (height == 0), one(place[0]) * other(place[1]), 0.0) for k in (0, 1)]
    result = np.zeros((pad.assembly.size, len(shapes)))
    result[vertex] = np.array(shapes).T
    return result


def _lines_m(pad: ReducedPad) -> tuple[np.ndarray, np.ndarray]:
    """Lattice lines along x and y in m, from the pad's centre."""
    spec, (rows, columns) = pad.plan.spec.pad, pad.assembly.shape
    lines = []
    for active, tiles in ((spec.width_mm, columns - 2), (spec.depth_mm, rows - 2)):
        inner = np.linspace(-active / 2, active / 2, tiles + 1)
        lines.append(np.concatenate([[inner[0] - spec.border_mm], inner, [inner[-1] + spec.border_mm]]) * MM)
    return lines[0], lines[1]


def driven_taxels(pad: ReducedPad) -> tuple[int, ...]:
    """For each channel the taxel nearest to the pad's centre."""
    taxels = pad.plan.taxels
    return tuple(
        min(
            (k for k, t in enumerate(taxels) if t.channel == channel),
            key=lambda k: np.hypot(taxels[k].x_mm, taxels[k].y_mm),
        )
        for channel in sorted({taxel.channel for taxel in taxels})
    )


def receptance(modes: PadModes, taxel: int, frequency_hz: np.ndarray, q: float) -> np.ndarray:
    """Vertical motion (frequencies, taxels) of all washers in m for 1 N on the washer of `taxel`, complex."""
    square = (2 * np.pi * np.asarray(frequency_hz)[:, None]) ** 2
    part = modes.motion[taxel] / (modes.square * (1 + 1j / q) - square)
    return np.asarray(part @ modes.motion.T)


def frequency_shifts(pad: ReducedPad, modes: PadModes) -> list[Shift]:
    """How far the real frame shifts each channel's resonance, the peak of a taxel's own response."""
    shifts = []
    for channel in sorted({taxel.channel for taxel in pad.plan.taxels}):
        clamped = pad.clamped_hz(channel)
        own = [k for k, taxel in enumerate(pad.plan.taxels) if taxel.channel == channel]
        peaks = np.array([_peak_hz(modes, k, clamped, pad.plan.channels[channel].q) for k in own])
        share = peaks / clamped - 1
        shifts.append(Shift(channel, clamped, float(share.min()), float(share.mean()), float(share.max())))
    return shifts


def _peak_hz(modes: PadModes, taxel: int, near_hz: float, q: float) -> float:
    """Frequency of the highest response of a taxel to a force on itself, within 30 % of `near_hz`."""
    weight = modes.motion[taxel] ** 2

    def answer(frequency: np.ndarray) -> np.ndarray:
        square = (2 * np.pi * frequency[:, None]) ** 2
        return np.asarray(np.abs((weight / (modes.square * (1 + 1j / q) - square)).sum(1)))

    low, high = 0.7 * near_hz, 1.3 * near_hz
    for _ in range(6):
        grid = np.linspace(low, high, 61)
        at = int(answer(grid).argmax())
        low, high = grid[max(at - 1, 0)], grid[min(at + 1, 60)]
    return float((low + high) / 2)


def crosstalk(pad: ReducedPad, modes: PadModes, driven: Sequence[int] | None = None) -> list[Crosstalk]:
    """What taxels `driven` at their resonances do to the others; by default `driven_taxels`.

    The peak is found from the modes, the motion there by a direct solve of the reduced pad.
    """
    return [_crosstalk(pad, modes, taxel) for taxel in (driven_taxels(pad) if driven is None else driven)]


def _crosstalk(pad: ReducedPad, modes: PadModes, driven: int) -> Crosstalk:
    taxels = pad.plan.taxels
    one = taxels[driven]
    q = pad.plan.channels[one.channel].q
    peak = _peak_hz(modes, driven, pad.clamped_hz(one.channel), q)
    pulls = pad.pulls
    motion = solved(factored(pad.assembly, (2 * np.pi * peak) ** 2, 1 / q), pulls[:, [driven]])
    amplitude = np.abs(pulls.T @ motion[:, 0])
    below = 20 * np.log10(amplitude[driven] / np.maximum(amplitude, 1e-30 * amplitude[driven]))
    steps = np.array([(abs(t.coil[0] - one.coil[0]), abs(t.coil[1] - one.coil[1])) for t in taxels]).sum(1)
    alike = np.array([taxel.channel == one.channel for taxel in taxels])

    def loudest(where: np.ndarray) -> tuple[str, float] | None:
        among = np.flatnonzero(where & (np.arange(len(taxels)) != driven))
        if not len(among):
            return None
        found = among[below[among].argmin()]
        return taxels[found].id, float(below[found])

    return Crosstalk(
        one.id, peak, below, loudest(steps == 0), loudest((steps == 1) & ~alike), loudest((steps == 1) & alike)
    )
