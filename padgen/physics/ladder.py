"""Number and frequencies of the channels that fit a band (paper Eq. 6-12), their levels, and optimised frequencies.

`optimal_ladder` makes the loudest OFF taxel as quiet as possible. Without pair spurs the best set is a ladder that
makes all channels equally bad. On an evenly spaced (geometric) ladder the middle channels hear neighbours on both
sides, and the end ones on one side only. With pair spurs there are many local optima: sets whose spurs miss every third
channel. The search starts from many random sets, moves each channel to the best of a few places, drops the worse half
of the sets, and repeats. A descent then moves the last sets to their local optimum. This does not prove that nothing
is better; docs/selectivity.md states what is proven and how near the search comes.
"""

from functools import lru_cache
from math import atanh, exp, floor, inf, log
from typing import NamedTuple

import numpy as np

from padgen.physics.selectivity import Scheme, all_states, channels, off_energy, tone_energy

__all__ = [
    "LevelLaw",
    "capacity",
    "geometric_ladder",
    "ladder_ratio",
    "optimal_ladder",
    "paper_ladder",
    "slot_half_width",
    "whole_channels",
]


class LevelLaw(NamedTuple):
    """Law of how far ON taxels move at each resonance: a power of frequency, or in proportion to a detection threshold.

    Either a power law ``D ∝ f^−p`` (p = 0 equal displacement, 1 velocity, 2 acceleration), or equal sensation: in
    proportion to a detection threshold that is given at a few frequencies, `curve_hz` and `curve_um`, and joined by
    straight lines on logarithmic axes.
    """

    exponent: float
    curve_hz: tuple[float, ...] = ()
    curve_um: tuple[float, ...] = ()

    def __call__(self, resonance_hz: np.ndarray) -> np.ndarray:
        """Return the relative displacements (n,) for resonances (n,) in Hz; only their ratios have a meaning."""
        threshold = self.threshold_um(resonance_hz)
        if threshold is not None:
            return threshold
        return np.asarray(resonance_hz, float) ** -self.exponent

    def threshold_um(self, resonance_hz: np.ndarray) -> np.ndarray | None:
        """Return the detection threshold in µm at `resonance_hz`, or None where the law is a power of frequency."""
        if not self.curve_hz:
            return None
        return np.exp(np.interp(np.log(resonance_hz), np.log(self.curve_hz), np.log(self.curve_um)))


def slot_half_width(q: float, delta_y: float) -> float:
    """Return half the relative bandwidth ``a = Δy/(4Q)`` of a channel for the ON/OFF ratio Δy; none fits if a ≥ 1."""
    return delta_y / (4 * q)


def ladder_ratio(q: float, delta_y: float) -> float:
    """Return the smallest ratio of neighbouring resonances, ``(1+a)/(1−a)``, a = Δy/(4Q); infinite where a ≥ 1."""
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
    """Return `count` resonances in Hz at ratios `ladder_ratio`; the band of the lowest channel begins at `low_hz`."""
    return low_hz / (1 - slot_half_width(q, delta_y)) * ladder_ratio(q, delta_y) ** np.arange(count)


def geometric_ladder(lowest_hz: float, highest_hz: float, count: int) -> np.ndarray:
    """Return `count` resonances in Hz, evenly spaced in octaves from `lowest_hz` to `highest_hz`."""
    if count == 1:
        return np.array([(lowest_hz * highest_hz) ** 0.5])
    return lowest_hz * exp(log(highest_hz / lowest_hz) / (count - 1)) ** np.arange(count)


def whole_channels(capacity_: float) -> int:
    """Return a number of channels rounded down to an integer, with a relative tolerance for rounding errors."""
    return floor(capacity_ * (1 + 1e-12))


WORK = 1e8
"""Most responses, about, in the search for a set with pair spurs: one second."""
MOST_SETS = 400
MOST_SETS_OF_FEW = 50
FEW = 4
DRAWS = 10
LAST_SETS = 5
"""Most random sets that are improved, also of up to `FEW` channels (of 150 random problems with 3 or 4, none lost more
than 1e-8 dB by them), random sets drawn for each of these, and sets left for descents."""
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
"""Number of channels above which the only start is the ladder over the whole band, and a descent takes fewer steps."""
PARTS = ((0.0, 1.0), (0.0, 0.75), (0.25, 1.0), (0.0, 0.5))
"""Parts of the band whose geometric ladders are starts: under a steep level law the best ladder leaves an end empty."""
STEPS = 60
SETTLED = 1e-8
"""Most steps of one descent, and the decrease of log energy in a step at which it is settled (4e-8 dB)."""
CLOSEST = 1e-3
"""Smallest distance of neighbours over the spacing of the geometric ladder."""


class _Case(NamedTuple):
    """Problem of `optimal_ladder`: ln of the band's ends in Hz, number of channels, Q, level law and drive scheme."""

    low: float
    high: float
    size: int
    q: float
    law: LevelLaw
    scheme: Scheme

    def log_energy(self, log_hz: np.ndarray) -> np.ndarray:
        """Return ln of OFF taxels' energies (m, sets) over their ON energies, for sets of ln resonances (n, sets)."""
        hz = np.exp(log_hz)
        which = channels(hz, self.q, self.law(hz))
        if self.scheme.takes_turns:  # each line by itself, since a maximum has no slope where two lines are equal
            energy = tone_energy(which, which)[~np.eye(self.size, dtype=bool)]
        else:
            energy = off_energy(which, self.scheme)
        return np.log(energy)


def optimal_ladder(
    low_hz: float,
    high_hz: float,
    count: int,
    q: float,
    law: LevelLaw,
    scheme: Scheme,
    effort: float = 1.0,
    near_hz: np.ndarray | None = None,
) -> np.ndarray:
    """Return `count` ascending resonances in Hz within [low, high] with the largest all-state selectivity found.

    For equal masses and one Q. Deterministic, and never worse than the geometric ladder from end to end. Takes one or
    two seconds with pair spurs, otherwise a tenth of one; less with an `effort` below 1. With `near_hz` (n,), the
    optimum of a similar band, only the local optimum near that is looked for, which takes a twentieth.
    """
    even: np.ndarray = np.clip(geometric_ladder(low_hz, high_hz, count), low_hz, high_hz)
    spurs = scheme.has_pair_spurs and count > 2
    if not 1 < count <= (MOST_WITH_SPURS if spurs else MOST) or not low_hz < high_hz:
        return even
    low = log(low_hz)
    high = log(high_hz)
    case = _Case(low, high, count, q, law, scheme)
    if near_hz is not None:
        starts = _fitted(np.log(near_hz), low, high)[None]
    elif spurs:
        starts = _search_by_exchange(case._replace(q=min(q, SMOOTH_Q)), effort * WORK)
    else:
        ends = low + np.array(PARTS[:1] if count > MANY else PARTS) * (high - low)
        starts = np.linspace(ends[:, 0], ends[:, 1], count, axis=1)
    # The time of a step grows with the cube of the channels.
    steps = round(effort * STEPS * min(1.0, MANY / count))
    # The logarithm's rounding must not push an end out of the band.
    optima = [np.clip(np.exp(_descend(case, start, steps)), low_hz, high_hz) for start in starts]
    return max([even, *optima], key=lambda hz: all_states(channels(hz, q, law(hz)), scheme).db)


def _fitted(log_hz: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return log resonances (n,) shifted into a band, or compressed to its width if they are wider."""
    width = log_hz[-1] - log_hz[0]
    if width > high - low:
        return np.asarray(low + (log_hz - log_hz[0]) * ((high - low) / width))
    return np.clip(log_hz[0], low, high - width) + (log_hz - log_hz[0])


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
    most = min(int(work / (2 * PLACES * count**3 * (count - 1))), MOST_SETS_OF_FEW if count <= FEW else MOST_SETS)
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


def _descend(case: _Case, start: np.ndarray, steps: int) -> np.ndarray:
    """Return ln resonances (n,) near `start` (n,) that locally minimise the largest OFF energy, in up to `steps` steps.

    The largest energy is a variable of its own, which no log energy exceeds, and is minimised by sequential quadratic
    programming.
    """
    from scipy.optimize import minimize

    size = case.size
    width = case.high - case.low
    closest = CLOSEST * width / (size - 1)
    # The step of the differences: far below a resonance's width, far above the rounding of a logarithm.
    aside = min(1e-5, 1e-2 / case.q)
    shifts = aside * np.concatenate([np.zeros((size, 1)), np.eye(size), -np.eye(size)], 1)
    # Variables: distances from the low end over the spacing of the geometric ladder, and the largest log energy.
    spacing = width / (size - 1)

    def log_hz(variables: np.ndarray) -> np.ndarray:
        return np.clip(case.low + variables[:-1] * spacing, case.low, case.high)

    @lru_cache(maxsize=1)  # values and slopes are asked for one after the other
    def lines(of: bytes) -> tuple[np.ndarray, np.ndarray]:
        now, above, below = np.split(case.log_energy(np.frombuffer(of)[:, None] + shifts), [1, 1 + size], 1)
        return now[:, 0], (above - below) / (2 * aside)

    def below_largest(variables: np.ndarray) -> np.ndarray:
        values, _ = lines(log_hz(variables).tobytes())
        return np.asarray(variables[-1] - values)

    def slope_below_largest(variables: np.ndarray) -> np.ndarray:
        _, slope = lines(log_hz(variables).tobytes())
        return np.hstack([-slope * spacing, np.ones((len(slope), 1))])

    # Two channels of a start may coincide; this moves them apart.
    apart = start + 2 * CLOSEST * (np.linspace(case.low, case.high, size) - start)
    largest = lines(apart.tobytes())[0].max()
    gaps = np.diff(np.eye(size, size + 1), axis=0)
    least_gap = min(closest, np.diff(apart).min()) / spacing
    only_largest = np.eye(size + 1)[-1]
    optimum = minimize(
        lambda variables: variables[-1],
        np.append((apart - case.low) / spacing, largest),
        jac=lambda variables: only_largest,
        bounds=[(0, size - 1)] * size + [(None, None)],
        constraints=[
            {"type": "ineq", "fun": below_largest, "jac": slope_below_largest},
            {"type": "ineq", "fun": lambda variables: gaps @ variables - least_gap, "jac": lambda variables: gaps},
        ],
        method="SLSQP",
        options={"maxiter": steps, "ftol": SETTLED},
    )
    place = log_hz(optimum.x)
    return place if lines(place.tobytes())[0].max() < largest else apart
