"""Optimised resonances: ladders without pair spurs, and sets whose pair spurs miss every third channel.

Agreements that are checked, figures in dB over all 2ⁿ states:

============================  =================================  ================================================
what                          must be                            why
============================  =================================  ================================================
optimised resonances          >= geometric ladder                it is among those compared
of plain tones                the table below, within 0.02 dB    proven to be within 0.05 dB of the best possible
of three and four channels    >= every set on a grid             all combinations are tried
============================  =================================  ================================================
"""

from itertools import combinations

import numpy as np
import pytest

from padgen.physics.ladder import LevelLaw, geometric_ladder, optimal_ladder
from padgen.physics.selectivity import Scheme, all_states, channels, off_energy, one_hot_db

CURVE = LevelLaw(0.0, (20.0, 50.0, 100.0, 250.0, 500.0, 1000.0), (20.0, 5.0, 1.0, 0.1, 0.3, 5.0))
TONES, FREE, BIASED, TURNS = (Scheme(name) for name in ("tones", "spur-free", "biased", "time-shared"))


def figure(hz: np.ndarray, q: float, law: LevelLaw, scheme: Scheme) -> float:
    return all_states(channels(hz, q, law(hz)), scheme).db


def well_placed(hz: np.ndarray, count: int, low: float, high: float) -> bool:
    return len(hz) == count and bool(np.all(np.diff(hz) > 0)) and low <= hz[0] and hz[-1] <= high


def test_the_optimal_ladder_of_eleven_channels_beats_the_geometric_one():
    hz = optimal_ladder(20, 1000, 11, 15, LevelLaw(1), FREE)
    law = LevelLaw(1)
    which = channels(hz, 15, law(hz))
    assert all_states(which, FREE).db == pytest.approx(17.635, abs=0.005)
    assert one_hot_db(which, FREE) == pytest.approx(20.86, abs=0.05)
    # Evenly bad, to 0.02 dB: the ends are held by the band, and those between are as loud as the loudest.
    assert np.sum(off_energy(which, FREE) > 0.995 * off_energy(which, FREE).max()) == 9


@pytest.mark.parametrize("scheme", [FREE, TURNS, TONES, BIASED], ids=lambda scheme: scheme.name)
@pytest.mark.parametrize("law", [LevelLaw(-1), LevelLaw(0), LevelLaw(3.5), CURVE], ids=range(4))
@pytest.mark.parametrize(
    ("count", "q", "low", "high"),
    [(1, 15, 20, 1000), (2, 1, 20, 1000), (3, 1, 20, 1000), (5, 1e8, 20, 1000), (12, 30, 60, 90)],
)
def test_optimised_resonances_are_never_worse_than_the_geometric_ladder(count, q, low, high, law, scheme):
    effort = 0.02  # however little is searched
    hz = optimal_ladder(low, high, count, q, law, scheme, effort)
    assert well_placed(hz, count, low, high)
    even = figure(geometric_ladder(low, high, count), q, law, scheme)
    assert figure(hz, q, law, scheme) >= even - 1e-9 or count == 1


@pytest.mark.parametrize("scheme, gain_db", [(FREE, 0.2), (TURNS, -1e-9)], ids=["spur-free", "time-shared"])
def test_an_optimal_ladder_of_many_channels_is_found(scheme, gain_db):
    law = LevelLaw(0)
    hz = optimal_ladder(20, 1000, 80, 100, law, scheme)
    assert well_placed(hz, 80, 20, 1000)
    assert figure(hz, 100, law, scheme) > figure(geometric_ladder(20, 1000, 80), 100, law, scheme) + gain_db


def test_a_steep_level_law_does_not_trap_the_search():
    # From end to end every start ends with two channels on one frequency, at −0.8 dB.
    assert figure(optimal_ladder(20, 1000, 11, 15, CURVE, FREE), 15, CURVE, FREE) > 10


@pytest.mark.sample(4)
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
        # Met by an exhaustive search, and proven to 0.7 and 3 dB only.
        (15, 7, 4.17),
        (60, 8, 12.32),
    ],
)
def test_plain_tones_reach_what_has_been_proven_to_be_best(q, count, best_db):
    law = LevelLaw(1)
    hz = optimal_ladder(20, 1000, count, q, law, TONES)
    assert well_placed(hz, count, 20, 1000)
    assert figure(hz, q, law, TONES) == pytest.approx(best_db, abs=0.02)


@pytest.mark.parametrize("law", [LevelLaw(1), LevelLaw(0), CURVE], ids=range(3))
@pytest.mark.parametrize("scheme", [TONES, BIASED], ids=lambda scheme: scheme.name)
@pytest.mark.parametrize("count, points", [(3, 40), (4, 20)])
def test_no_set_on_a_grid_is_better(count, points, scheme, law):
    grid = np.exp(np.linspace(np.log(20), np.log(1000), points))
    sets = grid[np.array(list(combinations(range(points), count)))].T
    tried = -10 * np.log10(off_energy(channels(sets, 15, law(sets)), scheme).max(0).min())
    hz = optimal_ladder(20, 1000, count, 15, law, scheme)
    assert figure(hz, 15, law, scheme) >= tried


@pytest.mark.parametrize("scheme", [TONES, TURNS], ids=lambda scheme: scheme.name)
def test_the_same_question_has_the_same_answer(scheme):
    first, second = (optimal_ladder(20, 1000, 4, 15, CURVE, scheme, 0.1) for _ in range(2))
    assert np.array_equal(first, second)
