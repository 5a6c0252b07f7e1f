"""Resonances of which the loudest OFF taxel is as quiet as can be found.

Without pair spurs that is a ladder, evenly bad instead of evenly spaced: on a geometric ladder the channels in the
middle hear neighbours on both sides, and those at the ends only one. Moving the channels until all OFF taxels are
equally loud gains a little in every state, and linear programs do it. (With pair spurs there are many local
answers: see `padgen.physics.clean_sets`.)
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from padgen.physics.ladder import geometric_ladder
from padgen.physics.levels import LevelLaw
from padgen.physics.selectivity import Channels, Scheme, all_states, channels, tone_energy

__all__ = ["CLOSEST", "STEPS", "Lines", "descend", "minimax_ladder"]

STEPS = 40
"""Most linear programs for one ladder."""
SETTLED = 1e-5
"""Stop when a linear program promises less than this in log energy (4e-5 dB)."""
CLOSEST = 1e-3
"""Closest that neighbours may come, over the spacing of the geometric ladder."""
MANY = 64
"""With more channels than this only the whole band's geometric ladder is tried as a start."""
_PARTS = ((0.0, 1.0), (0.0, 0.75), (0.25, 1.0), (0.0, 0.5))
"""Parts of the band whose geometric ladders are starts: under a steep level law the best ladder leaves an end empty."""
TIGHTEST = 1e-9
"""Smallest trust region, over the same spacing."""
FAINT = 1e-9
"""Terms of a slope under this fraction of the row's largest are dropped: they only fill the matrix."""


class Lines(NamedTuple):
    """Log energies (m,) that are to be kept down and their slopes (m, n) against log resonance."""

    log_energy: np.ndarray
    slope: Any


Model = Callable[[np.ndarray, float], Lines]


def minimax_ladder(low_hz: float, high_hz: float, count: int, q: float, law: LevelLaw, scheme: Scheme) -> np.ndarray:
    """`count` ascending resonances in Hz within [low, high] whose loudest OFF taxel is as quiet as can be.

    For equal masses and one Q, in a scheme without pair spurs: "spur-free" minimises
    ``max_i Σ_{j≠i} M_ij²``, "time-shared" ``max_{i≠j} M_ij²``. A local optimum, found from the geometric
    ladder by linear programs and never worse than that ladder.
    """
    even: np.ndarray = np.clip(geometric_ladder(low_hz, high_hz, count), low_hz, high_hz)
    if count < 2 or not low_hz < high_hz:
        return even

    def model(log_hz: np.ndarray, reach: float) -> Lines:
        which = channels(np.exp(log_hz), q, law(np.exp(log_hz)))
        return _summed(which, law) if not scheme.takes_turns else _single(which, law, reach)

    def figure(resonance_hz: np.ndarray) -> float:
        return float(all_states(channels(resonance_hz, q, law(resonance_hz)), scheme).db)

    best, best_db = even, figure(even)
    bottom, top = np.log(low_hz), np.log(high_hz)
    for first, last in _PARTS[: 1 if count > MANY else len(_PARTS)]:
        start = np.linspace(bottom + first * (top - bottom), bottom + last * (top - bottom), count)
        # The logarithm's rounding must not push an end out of the band.
        ladder = np.clip(np.exp(descend(start, model, bottom, top)), low_hz, high_hz)
        if figure(ladder) > best_db:
            best, best_db = ladder, figure(ladder)
    return best


def descend(start: np.ndarray, model: Model, low: float, high: float, steps: int = STEPS) -> np.ndarray:
    """Log resonances (n,) at which the largest of a model's log energies is least, near `start` (n,).

    Sequential linear programming with a trust region that is a box; deterministic, and never worse than `start`.
    """
    here, spacing = start, (high - low) / (len(start) - 1)
    reach = spacing / 4
    lines = model(here, reach)
    for _ in range(steps):
        step, promised = _linear_step(here, lines, low, high, min(CLOSEST * spacing, np.diff(here).min()), reach)
        if promised < SETTLED:
            break
        there = np.clip(here + step, low, high)
        trial = model(there, reach)
        kept = (lines.log_energy.max() - trial.log_energy.max()) / promised
        if kept > 0:
            here, lines = there, trial
        reach *= 2 if kept > 0.75 else 1 if kept > 0.25 else 0.3
        if reach < TIGHTEST * spacing:
            break
    return here


def _linear_step(
    here: np.ndarray, lines: Lines, low: float, high: float, closest: float, reach: float
) -> tuple[np.ndarray, float]:
    """The step (n,) within `reach` that lowers the linearised largest log energy most, and by how much."""
    from scipy.optimize import linprog
    from scipy.sparse import (
        csr_array,
        diags_array,
        hstack,
        vstack,
    )

    count, rows = len(here), len(lines.log_energy)
    top = lines.log_energy.max()
    order = diags_array([np.ones(count - 1), -np.ones(count - 1)], offsets=[0, 1], shape=(count - 1, count))
    # In units of the reach, so that the program looks alike at every scale.
    matrix = vstack(
        [
            hstack([csr_array(lines.slope) * reach, csr_array(-np.ones((rows, 1)))]),
            hstack([order * reach, csr_array((count - 1, 1))]),
        ],
        format="csr",
    )
    limit = np.concatenate([top - lines.log_energy, np.diff(here) - closest])
    lower, upper = np.maximum(-1, (low - here) / reach), np.minimum(1, (high - here) / reach)
    bounds = np.column_stack([np.append(lower, -np.inf), np.append(upper, 0.0)])
    result = linprog(np.append(np.zeros(count), 1.0), A_ub=matrix, b_ub=limit, bounds=bounds, method="highs")
    if result.x is None:
        return np.zeros(count), 0.0
    return result.x[:-1] * reach, -float(result.x[-1])


def _tone_slope(frequency_ratio: np.ndarray, q: float) -> np.ndarray:
    """Slope of the log of `relative_energy` against log frequency ratio s = f/f_i."""
    v = frequency_ratio**2
    detuning = q * (1 - frequency_ratio) * (1 + frequency_ratio)
    slope: np.ndarray = 2 * v * (2 * q * detuning - 1) / (detuning**2 + v)
    return slope


def _line_slope(hz: np.ndarray, law: LevelLaw) -> np.ndarray:
    """Slope (n,) of the log wanted line against log resonance, equal masses: 2 and the level law's."""
    aside = 1e-6
    rise = np.log(law(hz * (1 + aside)) / law(hz * (1 - aside))) / (2 * aside)
    slope: np.ndarray = 2 + rise
    return slope


def _pair_terms(which: Channels, law: LevelLaw) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Energies (n, n) of taxel i at tone j and the slopes of their logs against log r_i and log r_j."""
    hz = which.resonance_hz
    energy = tone_energy(which, which)
    np.fill_diagonal(energy, 0.0)
    response = _tone_slope(hz / hz[:, None], which.q[0])
    line = 2 * _line_slope(hz, law)
    return energy, -response - line[:, None], response + line


def _summed(which: Channels, law: LevelLaw) -> Lines:
    energy, by_receiver, by_driver = _pair_terms(which, law)
    total = energy.sum(1)
    share = energy / total[:, None]
    slope = share * by_driver
    slope[np.abs(slope) < FAINT * np.abs(slope).max(1, keepdims=True)] = 0.0
    np.fill_diagonal(slope, (share * by_receiver).sum(1))
    return Lines(np.log(total), slope)


def _single(which: Channels, law: LevelLaw, reach: float) -> Lines:
    """The single terms that a step within `reach` could make the largest."""
    from scipy.sparse import csr_array

    count = len(which.line)
    energy, by_receiver, by_driver = _pair_terms(which, law)
    off = ~np.eye(count, dtype=bool)
    log_energy, steepness = (
        np.log(energy, where=off, out=np.full_like(energy, -np.inf)),
        abs(by_receiver) + abs(by_driver),
    )
    floor = (log_energy - reach * steepness)[off].max()
    i, j = np.nonzero(off & (log_energy + reach * steepness >= floor))
    row = np.arange(len(i))
    slope = csr_array(
        (np.concatenate([by_receiver[i, j], by_driver[i, j]]), (np.tile(row, 2), np.concatenate([i, j]))),
        shape=(len(i), count),
    )
    return Lines(log_energy[i, j], slope)
