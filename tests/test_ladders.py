"""Optimised resonances: spur-free ladders (minimax) and clean sets for drives with pair spurs.

Agreements that are checked, figures in dB over all 2ⁿ states:

==============================  ==============================  ===========================================
what                            must be                         why
==============================  ==============================  ===========================================
minimax ladder                  >= geometric ladder             it starts there and keeps the best
clean set                       >= geometric ladder             the same
clean set                       >= figures of the table below   what is known to be possible, within 0.02 dB
bound                           >= set, and >= any other set    it is a proof
best on a small grid            = trying all combinations       branch and bound drops only what cannot win
==============================  ==============================  ===========================================
"""

from itertools import combinations
from math import comb

import numpy as np
import pytest

from padgen.physics import clean_sets, spur_search
from padgen.physics.clean_sets import best_on_grid, clean_set
from padgen.physics.ladder import geometric_ladder
from padgen.physics.levels import LevelLaw
from padgen.physics.minimax import minimax_ladder
from padgen.physics.selectivity import Scheme, all_states, channels, off_energy, one_hot_db
from padgen.physics.spur_search import case_of

CURVE = LevelLaw(0.0, (20.0, 50.0, 100.0, 250.0, 500.0, 1000.0), (20.0, 5.0, 1.0, 0.1, 0.3, 5.0))
TONES, FREE, BIASED, TURNS = (Scheme(name) for name in ("tones", "spur-free", "biased", "time-shared"))
BUDGET = 1e6
"""Work enough for a bound, where its sharpness is not the question."""


def figure(hz: np.ndarray, q: float, law: LevelLaw, scheme: Scheme) -> float:
    return all_states(channels(hz, q, law(hz)), scheme).db


def well_placed(hz: np.ndarray, count: int, low: float, high: float) -> bool:
    return len(hz) == count and bool(np.all(np.diff(hz) > 0)) and low <= hz[0] and hz[-1] <= high


def test_the_minimax_ladder_of_eleven_channels_beats_the_geometric_one():
    hz, law = minimax_ladder(20, 1000, 11, 15, LevelLaw(1), FREE), LevelLaw(1)
    which = channels(hz, 15, law(hz))
    assert all_states(which, FREE).db == pytest.approx(17.635, abs=0.005)
    assert one_hot_db(which, FREE) == pytest.approx(20.86, abs=0.05)
    # Evenly bad: the ends are held by the band, and of the nine between all but one at most are as loud as the loudest.
    assert np.sum(off_energy(which, FREE) > 0.999 * off_energy(which, FREE).max()) >= 8


@pytest.mark.parametrize("scheme", [FREE, TURNS], ids=lambda scheme: scheme.name)
@pytest.mark.parametrize("law", [LevelLaw(0), LevelLaw(3.5), CURVE], ids=range(3))
@pytest.mark.parametrize(
    ("count", "q", "low", "high"), [(1, 15, 20, 1000), (2, 1, 20, 1000), (5, 1e8, 20, 1000), (12, 30, 60, 90)]
)
def test_a_minimax_ladder_is_never_worse_than_the_geometric_one(count, q, low, high, law, scheme):
    hz = minimax_ladder(low, high, count, q, law, scheme)
    assert well_placed(hz, count, low, high)
    even = figure(geometric_ladder(low, high, count), q, law, scheme)
    assert figure(hz, q, law, scheme) >= even - 1e-9 or count == 1


def test_a_minimax_ladder_of_many_channels_is_found():
    law = LevelLaw(0)
    hz = minimax_ladder(20, 1000, 80, 100, law, FREE)
    assert well_placed(hz, 80, 20, 1000)
    assert figure(hz, 100, law, FREE) > figure(geometric_ladder(20, 1000, 80), 100, law, FREE) + 0.2


def test_a_steep_level_law_does_not_trap_the_minimax_ladder():
    # From end to end every start ends with two channels on one frequency, at −0.8 dB.
    assert figure(minimax_ladder(20, 1000, 11, 15, CURVE, FREE), 15, CURVE, FREE) > 10


@pytest.mark.parametrize(
    ("q", "count", "best_db"),
    [
        (15, 3, 34.42),
        (15, 4, 23.64),
        (15, 5, 13.97),
        (15, 6, 7.84),
        (30, 4, 29.65),
        (30, 5, 19.97),
        (30, 6, 13.82),
        (60, 5, 25.98),
        (60, 6, 19.83),
    ],
)
def test_clean_sets_reach_what_is_known_to_be_possible_and_are_proven_best(q, count, best_db):
    law = LevelLaw(1)
    found = clean_set(20, 1000, count, q, law, TONES)
    assert well_placed(found.resonances_hz, count, 20, 1000)
    assert found.all_states_db == pytest.approx(best_db, abs=0.02)
    assert found.all_states_db == figure(found.resonances_hz, q, law, TONES)
    assert found.bound_count == count
    assert found.all_states_db <= found.bound_db <= found.all_states_db + 0.0501


def test_a_clean_set_of_eight_channels_is_found_and_bounded():
    found = clean_set(20, 1000, 8, 60, LevelLaw(1), TONES, budget=4e6)
    assert found.all_states_db > 12.2
    assert found.all_states_db <= found.bound_db < 22


@pytest.mark.parametrize("law", [LevelLaw(-1), CURVE], ids=range(2))
@pytest.mark.parametrize("scheme", [TONES, BIASED], ids=lambda scheme: scheme.name)
@pytest.mark.parametrize(("count", "q", "low", "high"), [(2, 15, 20, 1000), (3, 1, 20, 1000), (3, 1e8, 50, 100)])
def test_a_clean_set_is_never_worse_than_the_geometric_ladder(count, q, low, high, scheme, law):
    found = clean_set(low, high, count, q, law, scheme, budget=BUDGET)
    assert well_placed(found.resonances_hz, count, low, high)
    assert np.isfinite(found.all_states_db)
    assert found.all_states_db >= figure(geometric_ladder(low, high, count), q, law, scheme) - 1e-9
    assert found.all_states_db == figure(found.resonances_hz, q, law, scheme)
    assert found.bound_db >= found.all_states_db


@pytest.mark.parametrize("law", [LevelLaw(1), LevelLaw(0), CURVE], ids=range(3))
@pytest.mark.parametrize("count", [3, 4, 5])
def test_branch_and_bound_on_a_grid_is_the_same_as_trying_all_combinations(count, law):
    points = 12
    grid = np.exp(np.linspace(np.log(20), np.log(1000), points))
    tried = max(figure(grid[list(sets)], 15, law, TONES) for sets in combinations(range(points), count))
    best = best_on_grid(20, 1000, points, count, 15, law, TONES)
    assert well_placed(best, count, 20, 1000)
    assert figure(best, 15, law, TONES) == pytest.approx(tried, abs=1e-9)


@pytest.mark.parametrize("law", [LevelLaw(0.4), CURVE], ids=range(2))
def test_branch_and_bound_adds_up_what_every_set_of_a_grid_hears(law):
    points, count = 9, 5
    case = case_of(20, 1000, count, 15, law, TONES)
    grid = clean_sets._Grid(case, points, False)
    looked_at = 0
    for sets, worst in clean_sets._Search(grid, np.inf, np.inf):
        assert worst == pytest.approx(off_energy(case.channels(grid.log_hz(sets).T), TONES).max(0), rel=1e-9)
        looked_at += len(sets)
    # Under a power law a set may be shifted, so that its highest channel is the grid's.
    assert looked_at == (comb(points - 1, count - 1) if case.shifts else comb(points, count))


@pytest.mark.parametrize("law", [LevelLaw(1), LevelLaw(0.4), LevelLaw(3), CURVE], ids=range(4))
@pytest.mark.parametrize("scheme", [TONES, BIASED], ids=lambda scheme: scheme.name)
def test_the_least_energies_of_cells_undercut_every_set_in_them(scheme, law):
    """A bound is only as good as its terms: the sets are drawn inside the cells, where branch and bound never looks."""
    count, random = 4, np.random.default_rng(3)
    case = case_of(20, 1000, count, 20, law, scheme)
    grid = clean_sets._Grid(case, 30, True)
    tightest = np.inf
    for _ in range(300):
        cells = np.sort(random.integers(0, 30, count))
        cells[0] *= not case.shifts
        log_hz = case.high - grid.step * (cells + random.random(count))
        if case.shifts:
            log_hz[0] = case.high
        least = [
            sum(float(grid.tone(i, j)) for j in np.delete(cells, k))
            + sum(float(grid.pair(i, a, b)) for a, b in combinations(np.delete(cells, k), 2))
            for k, i in enumerate(cells)
        ]
        real = off_energy(channels(np.exp(log_hz), 20, law(np.exp(log_hz))), scheme)
        assert np.all(np.array(least) <= real * (1 + 1e-9))
        tightest = min(tightest, float(np.min(real / least)))
    # Not by being idle: somewhere the bound is close.
    assert tightest < 1.6


def test_a_bound_is_not_undercut_by_a_better_search(monkeypatch):
    """With next to no search the bound has to do the work: it still may not fall under what is possible."""
    for name in ("POPULATION", "GENERATIONS", "POLISHED", "KEPT"):
        monkeypatch.setattr(spur_search, name, 4 if name == "POPULATION" else 1)
    for count, possible in ((6, 7.845), (7, 4.168)):
        assert clean_set(20, 1000, count, 15, LevelLaw(1), TONES, budget=BUDGET).bound_db >= possible


def test_one_channel_and_determinism(monkeypatch):
    alone = clean_set(20, 1000, 1, 15, LevelLaw(1), TONES)
    assert well_placed(alone.resonances_hz, 1, 20, 1000)
    assert alone.all_states_db == alone.bound_db == np.inf
    case = case_of(20, 1000, 7, 15, LevelLaw(1), TONES)
    grid, even = clean_sets._Grid(case, 60, False), np.log(geometric_ladder(20, 1000, 7))
    monkeypatch.setattr(spur_search, "POPULATION", 4)
    assert np.array_equal(spur_search.found(case, grid, even), spur_search.found(case, grid, even))
    first, second = (clean_set(20, 1000, 3, 15, CURVE, TONES, budget=BUDGET) for _ in range(2))
    assert np.array_equal(first.resonances_hz, second.resonances_hz)
    assert first[1:] == second[1:]
    ladders = [minimax_ladder(20, 1000, 5, 15, CURVE, FREE) for _ in range(2)]
    assert np.array_equal(*ladders)
