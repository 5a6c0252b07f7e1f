"""What a finger feels of a taxel whose coil carries a given i²: all modes, exact in time.

A mode of angular frequency ω moves per A² of i², s(t), as ``u'' + ω/Q u' + ω² u = ω² s``; what is felt is
``Σ gain u + rest s`` in three parts whose energies add (`padgen.physics.modal`: the plan's own model). With
``y' = p y + ω² s``, p = −ω/(2Q) + jω√(1 − 1/(4Q²)), it is ``u = Im y / Im p``: one complex number holds a mode's
state, and a stretch of the file adds its periodic answer and a free decay (`padgen.driver.ear.current`).
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from padgen.core.units import MM, UM
from padgen.driver.ear.current import UNIT, Stretch
from padgen.measured.tuning import TunedTaxel, Tuning, planned_response_um_per_a2
from padgen.physics.modal import felt_gains
from padgen.physics.taxel_modes import TaxelModes
from padgen.planner.plan import Channel, Plan

__all__ = [
    "Grid",
    "HeardTaxel",
    "Moved",
    "answer",
    "felt_at",
    "grid",
    "heard_taxels",
    "lines_needed",
    "move",
    "periodic_states",
]

LEAST_Q = 0.5 * (1 + 1e-9)
"""Below a half there is no vibration; it is taken for critical damping."""
INAUDIBLE = 1e-5
"""Share of a taxel's ON level that lines may have, all together, and be left out."""
POINTS_PER_LINE = 8
"""Points in a period of the highest line that is kept: at 4 no product of two lines folds back onto the mean."""
GONE = 25.0
"""Time constants after which a free decay is 1e-11 of what it was."""
FINE = 512
"""Points of a free decay that are computed at a time."""


class HeardTaxel(NamedTuple):
    """Modes (k,) of one taxel: `gain_m` (k, 3) and `rest_m` (3,) in m per A², the first part vertical at the axis.

    `wanted_m` is what is felt of it at level 1.
    """

    frequency_hz: np.ndarray
    q: float
    gain_m: np.ndarray
    rest_m: np.ndarray
    wanted_m: float

    @property
    def omega(self) -> np.ndarray:
        """Angular frequencies (k,) in 1/s."""
        return 2 * np.pi * self.frequency_hz

    @property
    def pole(self) -> np.ndarray:
        """p (k,) in 1/s."""
        half = 1 / (2 * max(self.q, LEAST_Q))
        return np.asarray(self.omega * (-half + 1j * np.sqrt((1 - half) * (1 + half))))


class Grid(NamedTuple):
    """Evenly spaced `points` over a stretch with its guards; those of its `own` begin `first_s` after its start."""

    points: int
    own: slice
    first_s: float
    step_s: float


class Moved(NamedTuple):
    """`felt_m` (3, points) at a stretch's own points, and the modes' states (k,) at its end."""

    felt_m: np.ndarray
    state: np.ndarray


def heard_taxels(plan: Plan, level_um: np.ndarray, tuning: Tuning | None = None) -> tuple[HeardTaxel, ...]:
    """The taxels of the plan, or of the print that `tuning` tells of.

    `level_um` (taxels,) is what the working mode is to do at level 1. Other modes of a print move with the
    working one, in frequency and in answer.
    """
    radius_m = plan.spec.taxel.boss_diameter_mm / 2 * MM
    bare = [_planned(channel, radius_m) for channel in plan.channels]
    planned = [t._replace(wanted_m=_felt_share(t, c)) for t, c in zip(bare, plan.channels, strict=True)]
    known: dict[tuple, HeardTaxel] = {}
    result = []
    for k, taxel in enumerate(plan.taxels):
        tuned = tuning.taxels[k] if tuning else None
        key = (taxel.channel, float(level_um[k]), tuned and (tuned.resonance_hz, tuned.q, tuned.response_um_per_a2))
        if key not in known:
            own = planned[taxel.channel]
            own = own._replace(wanted_m=own.wanted_m * float(level_um[k]) * UM)
            known[key] = _tuned(own, plan.channels[taxel.channel], tuned) if tuned else own
        result.append(known[key])
    return tuple(result)


def _planned(channel: Channel, radius_m: float) -> HeardTaxel:
    modes = TaxelModes(np.array(channel.modes_hz), np.array(channel.mode_motions))
    frequency, gain = felt_gains(modes, np.array(channel.pull_wrench), np.array(channel.rest_motion), radius_m)
    # The plan's force constant is of the working mode, with its share of the pull as it is.
    share = channel.pulled_shares[int(np.argmax(channel.mode_shares))]
    gain = gain * (channel.force_constant_n_per_a2 / share if share else 0.0)
    return HeardTaxel(frequency[:-1], channel.q, gain[:-1], gain[-1], 1.0)


def _felt_share(taxel: HeardTaxel, channel: Channel) -> float:
    """What is felt at the own tone, all modes, over the motion of the working mode there."""
    working = planned_response_um_per_a2(channel) * UM
    return felt_at(taxel, channel.resonance_hz) / working if working > 0 else 1.0


def _tuned(taxel: HeardTaxel, channel: Channel, tuned: TunedTaxel) -> HeardTaxel:
    planned = planned_response_um_per_a2(channel) / channel.q
    scale = tuned.response_um_per_a2 / tuned.q / planned if planned > 0 else 0.0
    return taxel._replace(
        frequency_hz=taxel.frequency_hz * (tuned.resonance_hz / channel.resonance_hz),
        q=tuned.q,
        gain_m=taxel.gain_m * scale,
        rest_m=taxel.rest_m * scale,
    )


def felt_at(taxel: HeardTaxel, line_hz: float) -> float:
    """Felt amplitude in m per A² of a line of i²."""
    parts = answer(taxel, np.array([line_hz]))[:, 0] @ taxel.gain_m + taxel.rest_m
    return float(np.sqrt((np.abs(parts) ** 2).sum()))


def answer(taxel: HeardTaxel, line_hz: np.ndarray) -> np.ndarray:
    """What the modes of a taxel answer to lines: complex u (k, m)."""
    omega, pole, at = taxel.omega[:, None], taxel.pole[:, None], 2j * np.pi * line_hz
    # The product keeps the digits of a line that is next to a resonance of large Q.
    both: np.ndarray = omega**2 / ((at - pole) * (at - pole.conj()))
    return both


def lines_needed(taxels: Sequence[HeardTaxel], lines_a2: np.ndarray, step_hz: float) -> int:
    """How many of the lines (m,) of i² are heard: those above have less than `INAUDIBLE` of any ON level."""
    energy = np.cumsum(np.abs(lines_a2[::-1]) ** 2)[::-1]
    cuts = np.unique(np.geomspace(16, len(lines_a2) - 1, 60).astype(int)) if len(lines_a2) > 17 else np.zeros(0, int)
    for cut in cuts:
        heard = max(_most_above(taxel, cut * step_hz) for taxel in taxels)
        if np.sqrt(energy[cut]) * heard <= INAUDIBLE:
            return int(cut)
    return len(lines_a2)


def _most_above(taxel: HeardTaxel, hz: float) -> float:
    """Most that a line above `hz` can be felt, of the ON level, per A²."""
    if taxel.wanted_m <= 0:
        return 0.0
    beyond = np.maximum((hz / taxel.frequency_hz) ** 2 - 1, 0.0)
    peak = 1 / np.maximum(beyond, 1 / max(taxel.q, 2.0) / 1.2)
    size = np.sqrt((taxel.gain_m**2).sum(-1)) @ peak + np.sqrt((taxel.rest_m**2).sum())
    return float(size / taxel.wanted_m)


def grid(stretch: Stretch, rate_hz: float, lines: int, least_per_s: float = 0.0) -> Grid:
    """Points for so many lines; `least_per_s` or more.

    A stretch that does not repeat has them every so many samples, a power of two of them or an inverse of one.
    """
    from scipy.fft import next_fast_len

    least = max(POINTS_PER_LINE * lines, int(np.ceil(least_per_s * stretch.size / rate_hz)), 16)
    if stretch.repeats:
        points = int(next_fast_len(least, True))
        return Grid(points, slice(0, points), 0.0, stretch.size / rate_hz / points)
    points = stretch.size // UNIT
    while points < least:
        points *= 2
    step = stretch.size / points
    first = stretch.lead / step
    low, high = int(np.ceil(first - 1e-9)), int(np.ceil(first + (stretch.stop - stretch.start) / step - 1e-9))
    return Grid(points, slice(low, high), (low - first) * step / rate_hz, step / rate_hz)


def move(
    taxel: HeardTaxel, per_line: np.ndarray, lines_a2: np.ndarray, stretch: Stretch, at: Grid, state: np.ndarray
) -> Moved:
    """Motion over a stretch under lines (m,) of i² from the modes' `state` (k,); `per_line` is their `answer`."""
    from scipy.fft import irfft

    each = per_line * lines_a2
    spectrum = taxel.gain_m.T @ each + taxel.rest_m[:, None] * lines_a2
    spectrum[:, 1:] /= 2
    periodic = irfft(spectrum, at.points, axis=1, norm="forward")
    if stretch.repeats:
        return Moved(periodic, state)
    rate_hz = stretch.size / (at.points * at.step_s)
    first_s, length_s = stretch.lead / rate_hz, (stretch.stop - stretch.start) / rate_hz
    states = periodic_states(taxel, each, rate_hz / stretch.size, (first_s, first_s + length_s))
    free = state - states[0]
    felt = periodic[:, at.own]
    _add_free(felt, taxel, free, at)
    leaves = states[1] + free * np.exp(taxel.pole * length_s)
    return Moved(felt, leaves)


def periodic_states(taxel: HeardTaxel, each: np.ndarray, step_hz: float, times_s: tuple[float, ...]) -> np.ndarray:
    """States (t, k) at times (t,) of modes that answer `each` (k, m) to lines `step_hz` apart."""
    moved = each @ _turns(each.shape[1], step_hz, times_s)
    pole, (u, v) = taxel.pole, moved.real.T.reshape(2, len(times_s), -1)
    # u = Im y / Im p and u' = Im(p y) / Im p.
    return np.asarray(v - pole.real * u + 1j * pole.imag * u)


@lru_cache(maxsize=4)
def _turns(lines: int, step_hz: float, times_s: tuple[float, ...]) -> np.ndarray:
    """What lines (m,) are at times (t,), and their slopes: (m, 2t)."""
    at = 2j * np.pi * step_hz * np.arange(lines)[:, None]
    turn = np.exp(at * np.array(times_s))
    return np.concatenate([turn, at * turn], 1)


def _add_free(felt_m: np.ndarray, taxel: HeardTaxel, state: np.ndarray, at: Grid) -> None:
    """Add the free decay from `state` at the beginning of a stretch, as long as it is heard, to (3, points)."""
    pole = taxel.pole
    count = min(felt_m.shape[1], int(GONE / -float(pole.real.max()) / at.step_s) + 1)
    scaled = (taxel.gain_m / pole.imag[:, None]).T * (state * np.exp(pole * at.first_s))
    coarse = scaled[:, None] * np.exp(np.multiply.outer(np.arange(-(-count // FINE)) * (FINE * at.step_s), pole))
    fine = np.exp(np.multiply.outer(pole, np.arange(FINE) * at.step_s))
    # The imaginary part of the product, by real ones.
    decay = np.concatenate([coarse.real, coarse.imag], 2) @ np.concatenate([fine.imag, fine.real])
    felt_m[:, :count] += decay.reshape(3, -1)[:, :count]
