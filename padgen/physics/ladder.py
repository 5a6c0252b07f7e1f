"""Number and frequencies of the channels that fit a band (paper Eq. 6-12), their levels, and optimised frequencies.

`optimal_ladder` makes the loudest OFF taxel as quiet as possible. Without pair spurs the best set is a ladder that
makes all channels equally bad. On an evenly spaced (geometric) ladder the middle channels hear neighbours on both
sides, and the end ones on one side only. With pair spurs there are many local optima: sets whose spurs miss every third
channel. The search starts from many random sets, moves each channel to the best of a few places, drops the worse half
of the sets, and repeats. Linear programs then move the last sets to their local optimum. This does not prove that
nothing is better; docs/selectivity.md states what is proven and how near the search comes.

`descend` minimises the largest of several functions by linear programs in a trust region that is a box (Madsen, J.
Inst. Maths Applics 16 (1975) 321).
"""

from collections.abc import Callable
from math import atanh, exp, floor, inf, log
from typing import NamedTuple

import numpy as np

from padgen.physics.selectivity import Scheme, all_states, channels, off_energy, tone_energy

__all__ = [
    "Descent",
    "LevelLaw",
    "capacity",
    "descend",
    "geometric_ladder",
    "ladder_ratio",
    "optimal_ladder",
    "paper_ladder",
    "slot_half_width",
    "whole_channels",
]


class LevelLaw(NamedTuple):
    """ON displacement against frequency.

    Either a power law ``D ∝ f^−p`` (p = 0 equal displacement, 1 velocity, 2 acceleration), or equal sensation: in
    proportion to a detection threshold that is given at a few frequencies, `curve_hz` and `curve_um`, and joined by
    straight lines on logarithmic axes.
    """

    exponent: float
    curve_hz: tuple[float, ...] = ()
    curve_um: tuple[float, ...] = ()

    def __call__(self, resonance_hz: np.ndarray) -> np.ndarray:
        """Return displacements (n,) for resonances (n,) in Hz, in any unit."""
        threshold = self.threshold_um(resonance_hz)
        if threshold is not None:
            return threshold
        return np.asarray(resonance_hz, float) ** -self.exponent

    def threshold_um(self, resonance_hz: np.ndarray) -> np.ndarray | None:
        """Return the threshold in µm at `resonance_hz`; None for a power law."""
        if not self.curve_hz:
            return None
        return np.exp(np.interp(np.log(resonance_hz), np.log(self.curve_hz), np.log(self.curve_um)))


def slot_half_width(q: float, delta_y: float) -> float:
    """Return half the relative width of a slot, ``a = Δy/(4Q)``; 1 or more means no capacity at all."""
    return delta_y / (4 * q)


def ladder_ratio(q: float, delta_y: float) -> float:
    """Return the smallest ratio of neighbouring resonances, ``(1+a)/(1−a)``; infinite where a ≥ 1."""
    a = slot_half_width(q, delta_y)
    return (1 + a) / (1 - a) if a < 1 else inf


def capacity(low_hz: float, high_hz: float, q: float, delta_y: float) -> float:
    """Return the number of channels of one coil by the paper's bound (Eq. 12), not rounded down.

    ``n = ln(f_hi/f_lo) / (2 artanh a)``; the artanh does not cancel at large Q.

    >>> capacity(20, 1000, q=15, delta_y=10)
    11.626584840139861
    """
    a = slot_half_width(q, delta_y)
    return log(high_hz / low_hz) / (2 * atanh(a)) if a < 1 else 0.0


def paper_ladder(low_hz: float, count: int, q: float, delta_y: float) -> np.ndarray:
    """Return `count` resonances in Hz at the closest spacing, with the lower edge of the lowest slot at `low_hz`."""
    return low_hz / (1 - slot_half_width(q, delta_y)) * ladder_ratio(q, delta_y) ** np.arange(count)


def geometric_ladder(lowest_hz: float, highest_hz: float, count: int) -> np.ndarray:
    """Return `count` resonances in Hz, evenly spaced in octaves from `lowest_hz` to `highest_hz`."""
    if count == 1:
        return np.array([(lowest_hz * highest_hz) ** 0.5])
    return lowest_hz * exp(log(highest_hz / lowest_hz) / (count - 1)) ** np.arange(count)


def whole_channels(capacity_: float) -> int:
    """Return the capacity rounded down; a capacity that is whole but for rounding counts as whole."""
    return floor(capacity_ * (1 + 1e-12))


WORK = 1e8
"""Most responses, about, in the search for a set with pair spurs: one second."""
MOST_SETS = 400
DRAWS = 10
LAST_SETS = 5
"""Most random sets that are improved, random sets drawn for each of these, and sets left for linear programs."""
PLACES = 24
"""Places tried for a channel, one at random in each equal part of the band in octaves."""
SOFTNESS = 0.1
"""Exponent s of the soft maximum ``Σ E^(1/s)`` in the search, through which the second largest energy counts, too."""
SMOOTH_Q = 30.0
"""Highest Q in the search. With more, peaks fall between the places; beside a peak energies go as 1/Q² anyway."""
MOST = 128
MOST_WITH_SPURS = 16
"""Most channels that are optimised without and with pair spurs; for more the result is the geometric ladder."""
MANY = 40
"""Number of channels above which the only start is the ladder over the whole band."""
PARTS = ((0.0, 1.0), (0.0, 0.75), (0.25, 1.0), (0.0, 0.5))
"""Parts of the band whose geometric ladders are starts: under a steep level law the best ladder leaves an end empty."""
PROGRAMS = 40
SETTLED = 1e-5
"""Most linear programs for one ladder, and the predicted decrease of log energy at which it is settled (4e-5 dB)."""
CLOSEST = 1e-3
TIGHTEST = 1e-9
"""Smallest distance of neighbours and smallest trust region, over the spacing of the geometric ladder."""


class _Case(NamedTuple):
    """One problem: ln of the band's ends in Hz, number of channels, Q, level law and drive scheme."""

    low: float
    high: float
    size: int
    q: float
    law: LevelLaw
    scheme: Scheme

    def log_energy(self, log_hz: np.ndarray) -> np.ndarray:
        """Return ln of the OFF energies (m, sets) to be minimised, for sets of log resonances (n, sets)."""
        hz = np.exp(log_hz)
        which = channels(hz, self.q, self.law(hz))
        if self.scheme.takes_turns:  # each line by itself, since a maximum has no slope where two lines are equal
            energy = tone_energy(which, which)[~np.eye(self.size, dtype=bool)]
        else:
            energy = off_energy(which, self.scheme)
        return np.log(energy)


def optimal_ladder(
    low_hz: float, high_hz: float, count: int, q: float, law: LevelLaw, scheme: Scheme, effort: float = 1.0
) -> np.ndarray:
    """Return `count` ascending resonances in Hz within [low, high] with the largest all-state selectivity found.

    For equal masses and one Q. Deterministic, and never worse than the geometric ladder from end to end. Takes one or
    two seconds with pair spurs, otherwise a tenth of one; less with an `effort` below 1.
    """
    even: np.ndarray = np.clip(geometric_ladder(low_hz, high_hz, count), low_hz, high_hz)
    spurs = scheme.has_pair_spurs and count > 2
    if not 1 < count <= (MOST_WITH_SPURS if spurs else MOST) or not low_hz < high_hz:
        return even
    low = log(low_hz)
    high = log(high_hz)
    case = _Case(low, high, count, q, law, scheme)
    if spurs:
        starts = _search_by_exchange(case._replace(q=min(q, SMOOTH_Q)), effort * WORK)
    else:
        ends = low + np.array(PARTS[:1] if count > MANY else PARTS) * (high - low)
        starts = np.linspace(ends[:, 0], ends[:, 1], count, axis=1)
    # The logarithm's rounding must not push an end out of the band.
    optima = [np.clip(np.exp(_descend(case, start, round(effort * PROGRAMS))), low_hz, high_hz) for start in starts]
    return max([even, *optima], key=lambda hz: all_states(channels(hz, q, law(hz)), scheme).db)


def _search_by_exchange(case: _Case, work: float) -> np.ndarray:
    """Return the best ascending sets (few, n) of log resonances found by moving one channel at a time, best first."""
    random = np.random.default_rng(1)
    count = case.size
    width = case.high - case.low

    def badness(sets: np.ndarray) -> np.ndarray:
        log_energy = case.log_energy(sets.reshape(-1, count).T)
        top = log_energy.max(0)
        soft = SOFTNESS * np.log(np.exp((log_energy - top) / SOFTNESS).sum(0))
        return np.reshape(top + soft, sets.shape[:-1])

    # The rounds on ever fewer sets take twice the first one in all.
    most = min(int(work / (2 * PLACES * count**3 * (count - 1))), MOST_SETS)
    sets = random.uniform(case.low, case.high, (DRAWS * max(most, LAST_SETS), count))
    # Under a power law a shift in octaves changes nothing, so the highest channel may stay at the top.
    fixed = int(not case.law.curve_hz)
    sets[:, :fixed] = case.high
    sets[0] = np.linspace(case.high, case.low, count)
    sets = sets[np.argsort(badness(sets), kind="stable")[: max(most, LAST_SETS)]]
    while True:
        for k in range(fixed, count):
            tried = np.repeat(sets[:, None], PLACES + 1, 1)
            tried[:, 1:, k] = case.low + width / PLACES * (np.arange(PLACES) + random.random((len(sets), PLACES)))
            tried_badness = badness(tried)
            sets = tried[np.arange(len(sets)), tried_badness.argmin(1)]
        sets = sets[np.argsort(tried_badness.min(1), kind="stable")]
        if len(sets) <= LAST_SETS:
            return np.sort(sets, 1)
        sets = sets[: max(len(sets) // 2, LAST_SETS)]


def _descend(case: _Case, start: np.ndarray, programs: int) -> np.ndarray:
    """Return log resonances (n,) near `start` (n,) that minimise the largest log energy."""
    spacing = (case.high - case.low) / (case.size - 1)
    # The step of the differences: far below a resonance's width, far above the rounding of a logarithm.
    aside = min(1e-5, 1e-2 / case.q)
    shifts = aside * np.concatenate([np.zeros((case.size, 1)), np.eye(case.size), -np.eye(case.size)], 1)

    def lines(log_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        now, above, below = np.split(case.log_energy(log_hz[:, None] + shifts), [1, 1 + case.size], 1)
        return now[:, 0], (above - below) / (2 * aside)

    # Two channels of a start may coincide; this moves them apart.
    apart = start + 2 * CLOSEST * (np.linspace(case.low, case.high, case.size) - start)
    bounds = np.full(case.size, case.low), np.full(case.size, case.high)
    at = Descent(apart, inf, spacing / 4)
    return descend(lines, at, *bounds, programs, SETTLED, CLOSEST * spacing, TIGHTEST * spacing).place


Lines = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""A function of a place (n,): values (m,) and their slopes (m, n); m may differ from place to place."""


class Descent(NamedTuple):
    """State of a descent: a place (n,), the largest value there, and the half width of the trust region."""

    place: np.ndarray
    largest: float
    reach: float


def descend(
    lines: Lines,
    at: Descent,
    low: np.ndarray,
    high: np.ndarray,
    programs: int,
    settled: float,
    closest: float | None = None,
    tightest: float = 0.0,
) -> Descent:
    """Return the descent between `low` and `high` (n,) after up to `programs` linear programs.

    Coordinates that have an order stay at least `closest` apart. The descent ends when a program predicts a decrease of
    less than `settled`, or when the trust region is below `tightest`.
    """
    from scipy.optimize import linprog

    here = at.place
    reach = at.reach
    values, slope = lines(here)
    for _ in range(programs):
        # The step within the reach that most lowers the linearised largest value. Only values that could become the
        # largest, in units of the reach, so that the program is scaled alike each time.
        swing = reach * np.abs(slope).sum(1)
        near = values + swing >= (values - swing).max()
        matrix = np.hstack([slope[near] * reach, -np.ones((near.sum(), 1))])
        limit = values.max() - values[near]
        if closest is not None:
            gaps = np.diff(here)
            order = np.eye(len(here), len(here) + 1) - np.eye(len(here), len(here) + 1, k=1)
            matrix = np.vstack([matrix, order[:-1] * reach])
            limit = np.concatenate([limit, gaps - min(closest, gaps.min())])
        lower = np.maximum(-1, (low - here) / reach)
        upper = np.minimum(1, (high - here) / reach)
        bounds = np.column_stack([np.append(lower, -np.inf), np.append(upper, 0.0)])
        best = linprog(np.append(np.zeros(len(here)), 1.0), A_ub=matrix, b_ub=limit, bounds=bounds, method="highs").x
        if best is None or -best[-1] < settled or reach < tightest:
            break
        there = np.clip(here + best[:-1] * reach, low, high)
        trial = lines(there)
        kept = (values.max() - trial[0].max()) / -best[-1]
        if kept > 0:
            here = there
            values, slope = trial
        if kept > 0.75:
            reach *= 2
        elif not kept > 0.25:  # nor where the step predicts no gain, and the ratio is no number
            reach *= 0.3
    return Descent(here, float(values.max()), reach)
