"""Looking for resonances whose pair spurs miss every third channel.

There are many local answers: channels are exchanged on a grid until none is better elsewhere, and the best sets
moved off the grid by linear programs. How good any set can be is for `padgen.physics.clean_sets` to prove.
"""

from math import inf, log
from typing import NamedTuple, Protocol

import numpy as np

from padgen.physics.levels import LevelLaw
from padgen.physics.minimax import CLOSEST, STEPS, Lines, descend
from padgen.physics.selectivity import Channels, Scheme, all_states, channels, off_energy

__all__ = ["Case", "Grid", "case_of", "found", "polished"]

POPULATION, GENERATIONS = 48, 3
"""Sets that are exchanged at a time, and how often."""
POLISHED, ROUGHLY, KEPT = 16, 5, 3
"""How many of the best are moved off the grid in how few steps, and how many of those to the end."""
SWEEPS, MOST_EXCHANGED = 8, 16
"""How often each channel is exchanged at most, and with more channels than how many none is."""


class Grid(Protocol):
    """Log resonances to choose from, and energies between them by index."""

    count: int

    def tone(self, i: np.ndarray, j: np.ndarray) -> np.ndarray: ...

    def pair(self, i: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray: ...

    def log_hz(self, cells: np.ndarray) -> np.ndarray: ...


class Case(NamedTuple):
    """A question: log band, count and laws; `power` is the power of frequency nearest to that of the wanted line."""

    low: float
    high: float
    size: int
    q: float
    law: LevelLaw
    scheme: Scheme
    power: float

    @property
    def straight(self) -> bool:
        """Whether the wanted lines follow the `power` exactly."""
        return not len(self.law.bends_log_hz) and 0 <= self.law.exponent <= 2

    @property
    def shifts(self) -> bool:
        """Whether a set may be moved up to the top of the band without change: under power laws it may."""
        rising = self.law.exponent <= 2 or not self.scheme.has_constant
        return not len(self.law.bends_log_hz) and rising

    def db(self, log_hz: np.ndarray) -> float:
        return float(all_states(self.channels(log_hz), self.scheme).db)

    def channels(self, log_hz: np.ndarray) -> Channels:
        hz = np.exp(log_hz)
        return channels(hz, self.q, self.law(hz))

    def line(self, log_hz: np.ndarray) -> np.ndarray:
        """Wanted lines up to a factor, those of the top of the band 1."""
        top = np.array([np.exp(self.high)])
        line: np.ndarray = self.law(np.exp(log_hz)) / self.law(top) * np.exp(2 * (log_hz - self.high))
        return line


def case_of(low_hz: float, high_hz: float, count: int, q: float, law: LevelLaw, scheme: Scheme) -> Case:
    """The `Case` of `count` channels with equal masses and one Q in the band [low, high]."""
    low, high = log(low_hz), log(high_hz)
    case = Case(low, high, count, q, law, scheme, 0.0)
    rise = -float(np.log(case.line(np.array([low]))[0])) / (high - low)
    # Between 0 and 2 a tone's term has one peak against frequency; the rest of the law goes into weights.
    return case._replace(power=min(max(rise, 0.0), 2.0))


def polished(case: Case, start: np.ndarray, steps: int = STEPS) -> np.ndarray:
    """The local optimum (n,) by linear programs next to log resonances `start` (n,)."""
    # Far under a resonance's width, far over the rounding of a logarithm.
    aside = min(1e-5, 1e-2 / case.q)
    shifts = aside * np.concatenate([np.zeros((case.size, 1)), np.eye(case.size), -np.eye(case.size)], 1)

    def model(log_hz: np.ndarray, reach: float) -> Lines:
        log_energy = np.log(off_energy(case.channels(log_hz[:, None] + shifts), case.scheme))
        here, above, below = np.split(log_energy, [1, 1 + case.size], 1)
        return Lines(here[:, 0], (above - below) / (2 * aside))

    # A start may lie half a cell out of the band, or two channels in one cell.
    even = np.linspace(case.low, case.high, case.size)
    start = np.clip(start, case.low, case.high) + 2 * CLOSEST * (even - np.clip(start, case.low, case.high))
    return descend(start, model, case.low, case.high, steps)


def found(case: Case, grid: Grid, even: np.ndarray) -> np.ndarray:
    """The best set (n,) of log resonances that exchanging channels on a grid and polishing finds, `even` at least."""
    if case.size > MOST_EXCHANGED:
        return even
    random, sets = np.random.default_rng(1), 4 * max(1, int(POPULATION / 4 * min(1.0, (12 / case.size) ** 4)))
    population = np.array([random.choice(grid.count, case.size, replace=False) for _ in range(sets)])
    population[0] = np.rint(np.linspace(0, grid.count - 1, case.size))
    if case.shifts:
        population[:, 0] = 0
    best: dict[tuple[int, ...], float] = {}
    for _ in range(GENERATIONS):
        population, worst = _exchanged(grid, population, case.shifts)
        best.update(zip(map(tuple, population.tolist()), worst.tolist(), strict=True))
        parents = np.array(sorted(best, key=best.__getitem__)[: sets // 4])
        population = np.tile(parents, (4, 1))
        # New blood for two channels of each, the top one apart.
        for cells in population:
            some = random.choice(np.arange(1, case.size), min(2, case.size - 1), replace=False)
            cells[some] = random.choice(grid.count, len(some), replace=False)
    starts = sorted(best, key=best.__getitem__)[:POLISHED]
    roughly = [polished(case, np.sort(grid.log_hz(np.array(cells))), ROUGHLY) for cells in starts]
    roughly.sort(key=case.db, reverse=True)
    return max([even, *(polished(case, start) for start in roughly[:KEPT])], key=case.db)


def _exchanged(grid: Grid, population: np.ndarray, shifts: bool) -> tuple[np.ndarray, np.ndarray]:
    """Move one channel of every set (m, n) at a time to the best point of the grid, until none moves.

    Ascending distinct sets and their largest energies.
    """
    count = population.shape[1]
    worst = np.full(len(population), inf)
    for _ in range(SWEEPS):
        before = population.copy()
        for place in range(int(shifts), count):
            energy = _with_one_more(grid, np.delete(population, place, 1))
            population[:, place] = energy.argmin(1)
            worst = energy.min(1)
        if np.array_equal(before, population):
            break
    population, first = np.unique(np.sort(population, 1), axis=0, return_index=True)
    return population, worst[first]


def _with_one_more(grid: Grid, sets: np.ndarray) -> np.ndarray:
    """Largest energy (m, points) of each set (m, k) with a channel at each point of the grid; inf where one is."""
    point, size = np.arange(grid.count), sets.shape[1]
    columns = [sets[:, k, None] for k in range(size)]
    new = np.zeros((len(sets), grid.count))
    worst = np.zeros_like(new)
    for i, own in enumerate(columns):
        others = columns[:i] + columns[i + 1 :]
        heard = grid.tone(own, point)
        for k, other in enumerate(others):
            heard = heard + grid.tone(own, other)
            for third in others[k + 1 :]:
                heard = heard + grid.pair(own, other, third)
        for other in others:
            heard = heard + grid.pair(own, other, point)
        np.maximum(worst, heard, out=worst)
        new += grid.tone(point, own)
        for other in columns[i + 1 :]:
            new += grid.pair(point, own, other)
    worst = np.maximum(worst, new)
    np.put_along_axis(worst, sets, inf, 1)
    return worst
