"""Clean sets: channels whose pair spurs miss every third channel, and proof of how good any set can be.

A drive of plain tones (or of tones beside a constant) makes a spur for every pair of channels, and a ladder
puts many of them on a third channel. Which resonances keep them apart is a combinatorial question with many
local answers, so that it is asked twice:

- a set is *found* by exchanging channels on a grid, then moved off the grid by linear programs (`descend`);
- a bound is *proven* by branch and bound. The band is cut into cells; each term of an OFF taxel's energy is
  replaced by its least value over the cells of its channels. Energies only add, so what a few cells already
  exceed, no set with channels in them can undercut: the cells are dropped. Those left are halved, and so on.

A response 1/N, ``N = Q² (1−s²)² + s²``, has one peak (N is convex in s²): over an interval it is least at an end.
"""

from collections.abc import Iterator
from math import inf
from typing import NamedTuple

import numpy as np

from padgen.physics.ladder import geometric_ladder
from padgen.physics.levels import LevelLaw
from padgen.physics.resonator import relative_energy
from padgen.physics.selectivity import Scheme, all_states, channels
from padgen.physics.spur_search import Case, case_of, found, polished

__all__ = ["CleanSet", "best_on_grid", "clean_set"]

CELLS = 56
"""Cells of the first cut: enough to prune, few enough that all pairs of offsets fit a core's cache."""
POINTS = 240
"""Grid points for exchanging channels."""
GAPS_DB = (96, 48, 24, 16, 12, 10, 8, 7, 6, 5, 4, 3.5, 3, 2.5, 2, 1.5, 1, 0.7, 0.5, 0.3, 0.2, 0.1, 0.05)
"""What is tried to be proven: that no set is more than this above the one found."""
BUDGET = 1.2e8
"""Work of one proof, in terms of energy looked up: about a second."""
EASY, CHUNK, MOST_HALVED = 6, 1 << 17, 1 << 13
"""Channels that are proven for without a detour, pairs of sets joined at a time, sets halved at a time."""
LARGEST_TABLE, UNTABLED, HALVINGS = 448, 8, 7
"""Most cells for which all pairs of offsets are tabulated, the work of a term that is not, most halvings of a cell."""


class CleanSet(NamedTuple):
    """Ascending resonances and what they reach.

    `bound_db` is proven: no set of resonances in the band, on a grid or off it, exceeds it. The proof is for
    `bound_count` of the channels: with fewer than all it holds as well, but is weaker.
    """

    resonances_hz: np.ndarray
    all_states_db: float
    bound_db: float
    bound_count: int


def clean_set(
    low_hz: float, high_hz: float, count: int, q: float, law: LevelLaw, scheme: Scheme, budget: float = BUDGET
) -> CleanSet:
    """`count` resonances within [low, high] of the largest all-state selectivity, for schemes with pair spurs.

    For equal masses and one Q. Deterministic: the proof stops after counted work, not after time. Never worse
    than the geometric ladder from end to end.
    """
    even = np.clip(geometric_ladder(low_hz, high_hz, count), low_hz, high_hz)
    if count < 2 or not low_hz < high_hz:
        figure = all_states(channels(even, q, law(even)), scheme).db
        return CleanSet(even, figure, figure, count)
    case = case_of(low_hz, high_hz, count, q, law, scheme)
    best, bound, proven_for = _proven(case, found(case, _Grid(case, POINTS, False), np.log(even)), budget)
    hz = np.clip(np.exp(best), low_hz, high_hz)
    figures = [all_states(channels(f, q, law(f)), scheme).db for f in (even, hz)]
    return CleanSet(hz if figures[1] > figures[0] else even, max(figures), max(bound, *figures), proven_for)


def best_on_grid(
    low_hz: float, high_hz: float, points: int, count: int, q: float, law: LevelLaw, scheme: Scheme
) -> np.ndarray:
    """The best `count` of `points` resonances that are evenly spaced in octaves, by branch and bound; ascending.

    For "biased" the strongest line is taken as that of the whole grid.
    """
    grid = _Grid(case_of(low_hz, high_hz, count, q, law, scheme), points, False)
    search, best = _Search(grid, inf, inf), np.arange(count)
    for sets, worst in search:
        if worst.min(initial=inf) < search.limit:
            best, search.limit = sets[worst.argmin()], float(worst.min())
    resonance_hz: np.ndarray = np.clip(np.exp(grid.log_hz(best)), low_hz, high_hz)[::-1]
    return resonance_hz


class _Grid:
    """Least energies over the cells (or at the points) of a band, index 0 at its top.

    The energy of a tone or spur is a part that depends on the offsets between cells alone, times weights.
    """

    def __init__(self, case: Case, count: int, cells: bool) -> None:
        self.count, self.cells, self.case = count, cells, case
        self.step = (case.high - case.low) / (count if cells else count - 1)
        offset, spread = -np.arange(1 - count, count) * self.step, self.step if cells else 0.0
        self._ratio = np.exp([offset - spread, offset + spread])
        self._biased = case.scheme.is_biased
        self._line = self._ratio[0] ** case.power
        self._weigh()
        # One peak: least at an end.
        self._tone = (self._ratio ** (2 * case.power) * relative_energy(self._ratio, 1.0, case.q)).min(0)
        self._harmonic = self._least(*(2 * self._ratio)) * case.scheme.pair_square(self._line, self._line, 1.0) / 4
        self._table: np.ndarray | None = None
        self.cost = 1 if count <= LARGEST_TABLE else UNTABLED
        if count <= LARGEST_TABLE:
            index = np.arange(2 * count - 1)
            self._table = self._spurs(np.repeat(index, len(index)), np.tile(index, len(index)))

    def _weigh(self) -> None:
        """Weights (count,): of tones' receivers and drivers, of spurs' receivers and drivers."""
        case = self.case
        edge = case.high - self.step * np.arange(self.count + self.cells)[:, None]
        if self.cells:
            # A level law bends where it is given, and nowhere else has an extreme inside a cell.
            bends = np.clip(case.law.bends_log_hz, edge[1:], edge[:-1]) if len(case.law.bends_log_hz) else edge[1:]
            edge = np.concatenate([edge[:-1], edge[1:], bends], axis=1)
        line, straight = case.line(edge) ** 2, np.exp(2 * case.power * (edge - case.high))
        weight = np.ones_like(line) if case.straight else line / straight
        least, most = weight.min(1), weight.max(1)
        self._hears, self._drives = 1 / most, least
        self._spur_hears, self._spur_drives = 1 / most, np.sqrt(least)
        if self._biased:
            strongest = 1.0 if case.shifts else float(line.max())
            self._spur_hears = straight.min(1) / (most * strongest)
            self._spur_drives = least
        self._weighed = self._biased or not case.straight

    def _least(self, *ends: np.ndarray) -> np.ndarray:
        least: np.ndarray = np.minimum(*(relative_energy(end, 1.0, self.case.q) for end in ends))
        return least

    def _spurs(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Least energies at the sum and the difference of two offsets, without weights."""
        (low_a, high_a), (low_b, high_b) = self._ratio[:, a], self._ratio[:, b]
        scheme = self.case.scheme
        energy: np.ndarray = self._least(scheme.pair_scale * (low_a + low_b), scheme.pair_scale * (high_a + high_b))
        nearest = np.maximum(np.maximum(low_a - high_b, low_b - high_a), 0.0)
        farthest = np.maximum(high_a - low_b, high_b - low_a)
        energy += self._least(scheme.pair_scale * nearest, scheme.pair_scale * farthest)
        energy *= scheme.pair_square(self._line[a], self._line[b], 1.0)
        return energy

    def tone(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """Least energies of taxels in cells `i` at the tones of channels in cells `j`, with their harmonics."""
        offset = j - i + self.count - 1
        energy: np.ndarray = self._tone[offset]
        if self._weighed:
            energy = energy * self._hears[i] * self._drives[j]
        if self._biased:
            energy = energy + self._harmonic[offset] * self._spur_hears[i] * self._spur_drives[j] ** 2
        return energy

    def pair(self, i: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Least energies of taxels in cells `i` at the spurs of channels in cells `a` and `b`."""
        shift, width = self.count - 1, 2 * self.count - 1
        if self._table is None:
            energy = self._spurs(a - i + shift, b - i + shift)
        else:
            energy = self._table.take((a - i) * width + (b - i) + shift * (width + 1))
        if self._weighed:
            energy *= self._spur_hears[i] * self._spur_drives[a] * self._spur_drives[b]
        return energy

    def log_hz(self, cells: np.ndarray) -> np.ndarray:
        """Centres of cells, or points."""
        centre: np.ndarray = self.case.high - self.step * (cells + 0.5 * self.cells)
        return centre


class _Block(NamedTuple):
    """Sets of cells (m, k) from the top down, their energies (m, k), and runs of rows that differ in the last only.

    `without` holds the energies (m, k − 1) before the last cell was added.
    """

    sets: np.ndarray
    energy: np.ndarray
    without: np.ndarray
    runs: np.ndarray


class _Search:
    """Depth-first search, in blocks, for all sets of cells whose energies stay within `limit`."""

    def __init__(self, grid: _Grid, limit: float, budget: float) -> None:
        self.grid, self.count, self.limit, self.budget = grid, grid.case.size, limit, budget
        firsts = range(1 if grid.case.shifts else grid.count)
        self.work, self.stack = 0, [self._pairs(np.full(1, first)) for first in reversed(firsts)]

    def _pairs(self, first: np.ndarray) -> _Block:
        second = np.arange(first[0] + (not self.grid.cells), self.grid.count)
        sets = np.column_stack(np.broadcast_arrays(first, second))
        energy = np.column_stack([self.grid.tone(first, second), self.grid.tone(second, first)])
        good = energy.max(1) <= self.limit
        sets, energy = sets[good], energy[good]
        return _Block(sets, energy, np.zeros((len(sets), 1)), np.array([0, len(sets)]))

    def __iter__(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Blocks of full sets (m, count) and their largest energies (m,); stops early when the budget is spent."""
        while self.stack and self.work <= self.budget:
            block = self.stack.pop()
            if block.sets.shape[1] == self.count:
                yield block.sets, block.energy.max(1)
            elif len(block.sets):
                left, right = self._joins(block)
                if len(left):
                    self.stack.append(self._joined(block, left, right))

    def _joins(self, block: _Block) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of rows of one run, as many as a chunk takes; the rest of the block goes back on the stack."""
        rows, same = len(block.sets), int(not self.grid.cells)
        partners = np.repeat(block.runs[1:], np.diff(block.runs)) - np.arange(rows) - same
        total = np.cumsum(partners)
        taken = rows if total[-1] <= CHUNK else max(int(np.searchsorted(total, CHUNK)), 1)
        if taken < rows:
            run = int(np.searchsorted(block.runs, taken, side="right"))
            runs = np.concatenate([[taken], block.runs[run:]]) - taken
            self.stack.append(_Block(block.sets[taken:], block.energy[taken:], block.without[taken:], runs))
        partners = partners[:taken]
        left = np.repeat(np.arange(taken), partners)
        right = np.arange(len(left)) - np.repeat(np.cumsum(partners) - partners, partners) + left + same
        self.work += len(left) * block.sets.shape[1]
        return left, right

    def _joined(self, block: _Block, left: np.ndarray, right: np.ndarray) -> _Block:
        """Rows that share all but their last cells c and d become one set; energies are summed, not evaluated anew."""
        grid, last = self.grid, block.sets.shape[1] - 1
        energy_c = self._last_energy(block, left, right, left)
        good = np.flatnonzero(energy_c <= self.limit)
        left, right, energy_c = left[good], right[good], energy_c[good]
        energy_d = self._last_energy(block, right, left, left)
        good = np.flatnonzero(energy_d <= self.limit)
        left, right, energy_c, energy_d = left[good], right[good], energy_c[good], energy_d[good]
        sets, d = block.sets[left], block.sets[right, last]
        energy = block.energy[left, :last] + block.energy[right, :last] - block.without[left]
        for k in range(last):
            energy[:, k] += grid.pair(sets[:, k], sets[:, last], d)
        good = np.flatnonzero(energy.max(1) <= self.limit)
        left = left[good]
        runs = np.concatenate([[0], np.flatnonzero(np.diff(left)) + 1, [len(left)]])
        return _Block(
            np.column_stack([sets[good], d[good]]),
            np.column_stack([energy[good], energy_c[good], energy_d[good]]),
            block.energy[left],
            runs if len(left) else np.array([0, 0]),
        )

    def _last_energy(self, block: _Block, own: np.ndarray, other: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Energy of the last cell of the rows `own` when the last of the rows `other` is added."""
        last = block.sets.shape[1] - 1
        here, there = block.sets[own, last], block.sets[other, last]
        energy: np.ndarray = block.energy[own, last] + self.grid.tone(here, there)
        for k in range(last):
            energy += self.grid.pair(here, block.sets[left, k], there)
        return energy


def _halved(grid: _Grid, parents: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Sets (m, n) of a grid's cells within halves of the cells of `parents` (N, n), largest energies, work.

    From the top down, with every shared beginning looked at once. Only sets within `limit`.
    """
    parents = np.unique(parents, axis=0)
    rows, count = parents.shape
    new = np.ones((rows, count), bool)
    new[1:] = np.logical_or.accumulate(parents[1:] != parents[:-1], axis=1)
    sets, energy, node, starts, work = np.empty((1, 0), int), np.empty((1, 0)), *np.zeros((2, 1), int), 0
    for k in range(count):
        begins = np.flatnonzero(new[:, k])
        first = np.searchsorted(begins, np.append(starts, rows))
        children = np.diff(first)[node]
        row = np.repeat(np.arange(len(node)), children)
        child = np.arange(len(row)) - np.repeat(np.cumsum(children) - children, children) + first[node[row]]
        coarse = parents[begins[child], k]
        row, child, cell = np.tile(row, 2), np.tile(child, 2), np.concatenate([2 * coarse, 2 * coarse + 1])
        # Sets that may be shifted are looked at with their highest channel at the band's very top.
        good = cell >= sets[row, -1] if k else (cell == 0) | (not grid.case.shifts)
        row, child, cell = row[good], child[good], cell[good]
        work += len(cell) * k * k * grid.cost
        sets, energy, node, starts = *_extended(grid, sets, energy, row, cell, child, limit), begins
    return sets, energy.max(1), work


def _extended(
    grid: _Grid, sets: np.ndarray, energy: np.ndarray, row: np.ndarray, cell: np.ndarray, node: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of `sets` with one more cell each, their energies and `node`, where these stay within `limit`."""
    size = sets.shape[1]
    own = np.zeros(len(cell))
    for a in range(size):
        own += grid.tone(cell, sets[row, a])
        for b in range(a + 1, size):
            own += grid.pair(cell, sets[row, a], sets[row, b])
    good = own <= limit
    row, cell, node, own = row[good], cell[good], node[good], own[good]
    grown, before = energy[row], sets[row]
    for i in range(size):
        grown[:, i] += grid.tone(before[:, i], cell)
        for a in range(size):
            if a != i:
                grown[:, i] += grid.pair(before[:, i], before[:, a], cell)
    good = (grown <= limit).all(1)
    return np.column_stack([before[good], cell[good]]), np.column_stack([grown[good], own[good]]), node[good]


class _Proof:
    """Whether any set of a case reaches a figure, asked again and again; the grids are kept, the work adds up."""

    def __init__(self, case: Case, budget: float) -> None:
        self.case, self.budget, self.grids = case, budget, [_Grid(case, CELLS, True)]
        self.witness: np.ndarray | None = None

    def grid(self, level: int) -> _Grid:
        if level == len(self.grids):
            self.grids.append(_Grid(self.case, CELLS << level, True))
        return self.grids[level]

    def none_reaches(self, target_db: float) -> bool:
        """Whether no set reaches `target_db`; if one of finest cells could, it becomes the `witness`."""
        # A hair above, for the rounding of sums.
        limit = 10 ** (-target_db / 10) * (1 + 1e-9)
        search, self.witness = _Search(self.grid(0), limit, self.budget), None
        for sets, _ in search:
            self._halve(sets, search)
            if self.witness is not None:
                break
        self.budget -= search.work
        return self.witness is None and self.budget >= 0

    def _halve(self, sets: np.ndarray, search: "_Search") -> None:
        """Halve cells, deepest first, until no set is left within the limit or one of the finest is."""
        stack = [(0, sets)]
        while stack and search.work <= search.budget:
            level, sets = stack.pop()
            if len(sets) > MOST_HALVED:
                stack.append((level, sets[MOST_HALVED:]))
            grid = self.grid(level + 1)
            halves, worst, work = _halved(grid, sets[:MOST_HALVED], search.limit)
            search.work += work
            if len(halves) and level + 1 == HALVINGS:
                self.witness, stack = grid.log_hz(halves[worst.argmin()])[::-1], []
            elif len(halves):
                stack.append((level + 1, halves))


def _proven(case: Case, best: np.ndarray, budget: float) -> tuple[np.ndarray, float, int]:
    """`best` (n,), or a better set if the proof comes across one; the lowest bound that is proven; for what count."""
    bound, proven_for, parts = inf, 0, _parts(case)
    for part in parts:
        share = budget if part is parts[-1] else budget / 2
        proof, budget = _Proof(part, share), budget - share
        if case.size <= EASY:
            # Few channels are settled at once, or a quarter of the budget is left; of many a coarse answer comes first.
            proof.budget *= 0.75
            done, best = _asked(case, proof, best, GAPS_DB[-1])
            if done:
                return best, case.db(best) + GAPS_DB[-1], part.size
            proof.budget = max(proof.budget, 0.0) + share / 4
        for gap in GAPS_DB:
            if case.db(best) + gap < bound:
                done, best = _asked(case, proof, best, gap)
                if not done:
                    break
                bound, proven_for = case.db(best) + gap, part.size
        budget += max(proof.budget, 0.0)
    return best, bound, proven_for


def _asked(case: Case, proof: _Proof, best: np.ndarray, gap: float) -> tuple[bool, np.ndarray]:
    """Whether it is proven that no set is more than `gap` better than `best`, or than the better one met on the way."""
    while not proof.none_reaches(case.db(best) + gap):
        if proof.witness is None or proof.case.size < case.size:
            return False, best
        better = polished(case, proof.witness)
        if case.db(better) <= case.db(best):
            return False, best
        best = better
    return True, best


def _parts(case: Case) -> list[Case]:
    """Cases whose bounds hold for `case`, the easiest first and `case` itself last.

    Any n channels hold any fewer. If sets may be shifted, those of n channels hold m neighbours within 1/r of the
    band, r (m − 1) ≤ n − 1: energies of the rest only add.
    """
    count, octaves = case.size, case.high - case.low
    if count <= EASY:
        return [case]
    if not case.shifts or case.scheme.is_biased:
        fewer = sorted({min(count, m) for m in (3, 4, 5, 6, count - 1, count) if m > 1})
        return [case._replace(size=m) for m in fewer]
    shares = {(count - 1) // r + 1: r for r in range(count - 1, 0, -1)} | {max(count - 1, 2): 1, count: 1}
    return [case._replace(size=m, low=case.high - octaves / shares[m]) for m in sorted(shares)]
