"""How much the search computes, counted: layouts sized and prints simulated, which no machine's speed changes."""

from dataclasses import replace
from math import inf, log2, log10

import pytest

from padgen.planner import make, make_plan, search
from padgen.planner.printed_pads import QUICK_PADS, compared_prints
from padgen.spec import load_spec, make_spec


@pytest.mark.parametrize(
    ("spacing", "range_k", "most"), [("spread", 10, 5), ("optimised", 0, 9), ("optimised", 10, 15)]
)
def test_layouts_after_the_first_that_works_are_not_sized(monkeypatch, spacing, range_k, most):
    # When all were sized before the first was tried, there were 30 and 86. Optimised, the first does not last at 10 K.
    sized = []
    beams = search._beams

    def counted(spec, layout):
        sized.append(layout)
        return beams(spec, layout)

    monkeypatch.setattr(search, "_beams", counted)
    # The choice alone: a plan may try cures, each by a search of its own.
    table = {"name": "a", "resolution": 10, "band_hz": [50, 120], "q_min": 30, "spacing": spacing}
    make.choose(make_spec({**table, "life": {"temperature_range_k": range_k}}))
    assert 0 < len(sized) <= most


def test_few_prints_are_simulated_of_a_layout_that_cannot_be_chosen():
    plan = make_plan(load_spec("resin-fine"))
    plan = replace(plan, spec=replace(plan.spec, print_share=0.99))
    sure = compared_prints(plan, -inf, 0.0)[1]
    few = compared_prints(plan, -inf, 1.5)[1]
    assert 0 < sure.good_share < 1
    assert few.pads <= QUICK_PADS < sure.pads
    assert abs(few.good_share - sure.good_share) <= few.error_share + sure.error_share


@pytest.mark.parametrize("count", [1, 3, 40])
def test_the_layout_that_works_most_often_is_found_with_many_prints_of_few(monkeypatch, count):
    spec = load_spec("paper-32")  # its layout is given, so that no bent beams are tried
    shares = [0.3 + 0.5 * (7 * k % count) / count for k in range(count)]
    sure = []

    def tried(choice, least_db, least_share, *_):
        share = shares[choice.layout]
        unsure = 0.05
        if share + unsure < least_share:
            return make.ChoiceFigures(30.0, share - 0.02 * (choice.layout % 2), 20.0, unsure)
        sure.append(choice)
        return make.ChoiceFigures(30.0, share, 20.0)

    monkeypatch.setattr(make, "_tried", tried)
    monkeypatch.setattr(make, "_with_bent_beams", lambda tried: iter(()))
    found, _ = make._best((make.Choice(spec, k, ()) for k in range(count)), for_cure=False)
    assert shares[found.layout] == max(shares)
    assert len(sure) <= make.MOST_SURE


def _found(monkeypatch, choices, figures):
    """Return the choice that is taken where `figures` are those of each, and what was judged."""
    judged = []

    def tried(choice, *_):
        judged.append(choice)
        return make.ChoiceFigures(*figures(choice))

    monkeypatch.setattr(make, "_tried", tried)
    monkeypatch.setattr(make, "_with_bent_beams", lambda tried: iter(()))
    return make._best(iter(choices), for_cure=False)[0], judged


def test_layouts_far_short_in_every_print_stand_for_others_with_as_many_channels(monkeypatch):
    spec = load_spec("paper-32")
    asked_db = 20 * log10(spec.delta_y)
    few = [make.Choice(spec, k, (None,) * 3) for k in range(9)]
    others = [make.Choice(spec, 10 + k, (None,) * 2) for k in range(2)]
    far_db = asked_db - 1.5 * make.FAR_SHORT_DB
    _, judged = _found(monkeypatch, [*few, *others], lambda choice: (30.0, 0.0, far_db))
    assert judged == [*few[: make.MOST_FAR_SHORT], *others]
    _, judged = _found(monkeypatch, few, lambda choice: (30.0, 0.0, asked_db - 0.5 * make.FAR_SHORT_DB))
    assert judged == few


def test_of_pads_that_keep_as_much_that_with_the_fewest_coils_is_taken(monkeypatch):
    choices = [make.Choice(load_spec("paper-32"), k, ()) for k in range(3)]
    found, _ = _found(monkeypatch, choices, lambda choice: (30.0, 0.4, 12.0 + 0.4 * make.ALIKE_DB * choice.layout))
    assert found is choices[0]
    found, _ = _found(monkeypatch, choices, lambda choice: (30.0, 0.4, 12.0 + 2 * make.ALIKE_DB * choice.layout))
    assert found is choices[2]


def test_of_pads_of_which_no_print_works_one_that_does_as_drawn_is_taken(monkeypatch):
    spec = load_spec("paper-32")
    short_db = 20 * log10(spec.delta_y) - 3.0
    choices = [make.Choice(spec, k, ()) for k in range(2)]
    found, _ = _found(monkeypatch, choices, lambda choice: (30.0, 0.0, 5.0) if choice.layout else (short_db, 0.0, 9.0))
    assert found is choices[1]


def test_a_pad_is_judged_once_though_its_drive_is_asked_for_by_name(monkeypatch):
    table = {"name": "four", "resolution": 32, "band_hz": [50, 200], "q_min": 15, "delta_y": 5, "print_share": 0.999}
    pads = []

    def counted(plan, *arguments):
        hz = tuple(channel.resonance_hz for channel in plan.channels)
        pads.append((plan.coils, hz, plan.spec.coil.gap_mm, plan.spec.coil.reuse, plan.selectivity.drive))
        return compared_prints(plan, *arguments)

    monkeypatch.setattr(make, "compared_prints", counted)
    monkeypatch.setattr(make, "MOST_PRINTED", 0)  # the second round, which judges the best ones again
    make.choose(make_spec(table))
    assert len(pads) == len(set(pads)) > 1


@pytest.mark.parametrize(
    "changes",
    [
        {"band_hz": [50, 200], "q_min": 15},  # plain tones of two channels fall short there, without spurs they do not
        pytest.param({"band_hz": [50, 400], "q_min": 10, "delta_y": 5}, marks=pytest.mark.soak),
        {"band_hz": [20, 100], "q_min": 25},
        {"band_hz": [80, 320], "q_min": 15, "delta_y": 5, "magnet": "disc-3x1", "coil": "air-10"},
    ],
)
def test_gaps_that_are_not_computed_change_no_choice(monkeypatch, changes):
    spec = make_spec({"name": "four", "resolution": 32, **changes})
    chosen = make.choose(spec)
    monkeypatch.setattr(make, "NO_HOPE_DB", inf)
    every = make.choose(spec)
    assert chosen.layout == every.layout
    assert chosen.spec == every.spec


@pytest.mark.parametrize("largest", [64, 65, 100, 977, 4095, 4096])
@pytest.mark.parametrize("near", [None, 64, 99, 101, 976, 978, 4096])
def test_the_largest_count_is_found_in_few_steps_from_a_guess(largest, near):
    asked = []

    def holds(count):
        asked.append(count)
        return count <= largest

    assert search.largest_that_holds(holds, 64, 4096, near) == largest
    assert len(asked) == len(set(asked))
    away = abs(largest - (near or 64)) + 1
    assert len(asked) <= 2 * log2(away) + 4
