"""Resonances of which the loudest OFF taxel is as quiet as can be found.

Without pair spurs that is a ladder, evenly bad instead of evenly spaced: on a geometric ladder the channels in the
middle hear neighbours on both sides, and those at the ends only one. With pair spurs there are many local answers:
sets whose spurs miss every third channel. Each channel of many random sets is moved to the best of a few places, the
worse half of the sets is dropped, and so on. Linear programs then move the last ones to their local optimum. None of
this proves that nothing is better: docs/selectivity.md has what has been proven, and how near this comes.
"""

from math import log
from typing import NamedTuple

import numpy as np

from padgen.physics.ladder import geometric_ladder
from padgen.physics.levels import LevelLaw
from padgen.physics.selectivity import Scheme, all_states, channels, off_energy, tone_energy

__all__ = ["optimal_ladder"]

WORK = 1e8
"""Responses that the search for a set with pair spurs may take, about: a second."""
MOST_SETS, DRAWS, LAST_SETS = 400, 10, 5
"""Random sets that are improved at most, random sets drawn for one that is, and sets left for linear programs."""
PLACES = 24
"""Places that a channel is tried at, one at random in each equal part of the band in octaves."""
SOFTNESS = 0.1
"""The largest energy of a set is taken as ``Σ E^(1/s)`` in the search, so that the second largest counts as well."""
SMOOTH_Q = 30.0
"""Highest Q in the search: of more the peaks fall between the places, and beside a peak energies go as 1/Q²."""
MOST, MOST_WITH_SPURS = 128, 16
"""With more channels than this the geometric ladder is the answer."""
MANY = 40
"""With more channels than this only the whole band is a start."""
PARTS = ((0.0, 1.0), (0.0, 0.75), (0.25, 1.0), (0.0, 0.5))
"""Parts of the band whose geometric ladders are starts: under a steep level law the best ladder leaves an end empty."""
PROGRAMS, SETTLED = 40, 1e-5
"""Most linear programs for one ladder; it is settled when one promises less than this in log energy (4e-5 dB)."""
CLOSEST, TIGHTEST = 1e-3, 1e-9
"""Closest that neighbours may come, and smallest trust region, over the spacing of the geometric ladder."""


class _Case(NamedTuple):
    """A question: ln of the band's ends in Hz, how many channels, and the laws of their energies."""

    low: float
    high: float
    size: int
    q: float
    law: LevelLaw
    scheme: Scheme

    def log_energy(self, log_hz: np.ndarray) -> np.ndarray:
        """ln of the OFF energies (m, sets) that are to be kept down, of sets of log resonances (n, sets)."""
        hz = np.exp(log_hz)
        which = channels(hz, self.q, self.law(hz))
        if self.scheme.takes_turns:  # each line on its own: the largest of many has no slope where two are alike
            energy = tone_energy(which, which)[~np.eye(self.size, dtype=bool)]
        else:
            energy = off_energy(which, self.scheme)
        log_energy: np.ndarray = np.log(energy)
        return log_energy


def optimal_ladder(
    low_hz: float, high_hz: float, count: int, q: float, law: LevelLaw, scheme: Scheme, effort: float = 1.0
) -> np.ndarray:
    """`count` ascending resonances in Hz within [low, high] of the largest all-state selectivity that is found.

    For equal masses and one Q. Deterministic, and never worse than the geometric ladder from end to end. A second or
    two with pair spurs, else a tenth; less with an `effort` below 1.
    """
    even: np.ndarray = np.clip(geometric_ladder(low_hz, high_hz, count), low_hz, high_hz)
    spurs = scheme.has_pair_spurs and count > 2
    if not 1 < count <= (MOST_WITH_SPURS if spurs else MOST) or not low_hz < high_hz:
        return even
    low, high = log(low_hz), log(high_hz)
    case = _Case(low, high, count, q, law, scheme)
    parts = PARTS[:1] if count > MANY else PARTS
    starts = np.array([np.linspace(low + a * (high - low), low + b * (high - low), count) for a, b in parts])
    if spurs:
        starts = _exchanged(case._replace(q=min(q, SMOOTH_Q)), effort * WORK)
    # The logarithm's rounding must not push an end out of the band.
    found = [np.clip(np.exp(_descended(case, start, round(effort * PROGRAMS))), low_hz, high_hz) for start in starts]
    return max([even, *found], key=lambda hz: all_states(channels(hz, q, law(hz)), scheme).db)


def _exchanged(case: _Case, work: float) -> np.ndarray:
    """The best ascending sets (few, n) of log resonances that moving one channel at a time finds, best first."""
    random, count, width = np.random.default_rng(1), case.size, case.high - case.low

    def badness(sets: np.ndarray) -> np.ndarray:
        log_energy = case.log_energy(sets.reshape(-1, count).T)
        top = log_energy.max(0)
        soft: np.ndarray = top + SOFTNESS * np.log(np.exp((log_energy - top) / SOFTNESS).sum(0))
        return soft.reshape(sets.shape[:-1])

    # Halving the sets again and again costs twice the first round.
    most = min(int(work / (2 * PLACES * count**3 * (count - 1))), MOST_SETS)
    sets = random.uniform(case.low, case.high, (DRAWS * max(most, LAST_SETS), count))
    # Under a power law a set can be shifted up without change, so that its highest channel is at the top.
    fixed = int(not len(case.law.bends_log_hz))
    sets[:, :fixed] = case.high
    sets[0] = np.linspace(case.high, case.low, count)
    sets = sets[np.argsort(badness(sets), kind="stable")[: max(most, LAST_SETS)]]
    while True:
        for k in range(fixed, count):
            tried = np.repeat(sets[:, None], PLACES + 1, 1)
            tried[:, 1:, k] = case.low + width / PLACES * (np.arange(PLACES) + random.random((len(sets), PLACES)))
            found = badness(tried)
            sets = tried[np.arange(len(sets)), found.argmin(1)]
        sets = sets[np.argsort(found.min(1), kind="stable")]
        if len(sets) <= LAST_SETS:
            return np.sort(sets, 1)
        sets = sets[: max(len(sets) // 2, LAST_SETS)]


def _descended(case: _Case, start: np.ndarray, programs: int) -> np.ndarray:
    """Log resonances (n,) at which the largest log energy is least, near `start` (n,).

    Sequential linear programming with a trust region that is a box.
    """
    spacing = (case.high - case.low) / (case.size - 1)
    # Far under a resonance's width, far over the rounding of a logarithm.
    aside = min(1e-5, 1e-2 / case.q)
    shifts = aside * np.concatenate([np.zeros((case.size, 1)), np.eye(case.size), -np.eye(case.size)], 1)

    def lines(log_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        now, above, below = np.split(case.log_energy(log_hz[:, None] + shifts), [1, 1 + case.size], 1)
        return now[:, 0], (above - below) / (2 * aside)

    # Two channels of a start may lie in one place.
    here, reach = start + 2 * CLOSEST * (np.linspace(case.low, case.high, case.size) - start), spacing / 4
    energy, slope = lines(here)
    for _ in range(programs):
        step, promised = _programmed(case, here, energy, slope, reach)
        if promised < SETTLED or reach < TIGHTEST * spacing:
            break
        there = np.clip(here + step, case.low, case.high)
        trial = lines(there)
        kept = (energy.max() - trial[0].max()) / promised
        if kept > 0:
            here, (energy, slope) = there, trial
        reach *= 2 if kept > 0.75 else 1 if kept > 0.25 else 0.3
    return np.asarray(here)


def _programmed(
    case: _Case, here: np.ndarray, energy: np.ndarray, slope: np.ndarray, reach: float
) -> tuple[np.ndarray, float]:
    """The step (n,) within `reach` that lowers the linearised largest log energy most, and by how much."""
    from scipy.optimize import linprog

    count, gaps = len(here), np.diff(here)
    closest = min(CLOSEST * (case.high - case.low) / (count - 1), gaps.min())
    # Only what could become the largest.
    swing = reach * np.abs(slope).sum(1)
    near = energy + swing >= (energy - swing).max()
    # In units of the reach, so that the program looks alike at every scale.
    order = (np.eye(count) - np.eye(count, k=1))[:-1] * reach
    matrix = np.block([[slope[near] * reach, -np.ones((near.sum(), 1))], [order, np.zeros((count - 1, 1))]])
    limit = np.concatenate([energy.max() - energy[near], gaps - closest])
    lower, upper = np.maximum(-1, (case.low - here) / reach), np.minimum(1, (case.high - here) / reach)
    bounds = np.column_stack([np.append(lower, -np.inf), np.append(upper, 0.0)])
    result = linprog(np.append(np.zeros(count), 1.0), A_ub=matrix, b_ub=limit, bounds=bounds, method="highs")
    if result.x is None:
        return np.zeros(count), 0.0
    return np.asarray(result.x[:-1] * reach), -float(result.x[-1])
