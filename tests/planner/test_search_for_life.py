"""The search takes the fewest coils whose prints keep what is asked for life, and says what it takes where none do."""

import json
from dataclasses import replace

import numpy as np
import pytest

from padgen.planner import make, make_plan, plan_to_json
from padgen.planner.life import keeps_for_life
from padgen.spec import make_spec
from tests.print_and_count import kept_db

BAND = {"band_hz": [60, 400]}
LARGE = {"name": "large", "resolution": 32, **BAND, "pad": {"width_mm": 80, "depth_mm": 80}}


def lasts(choice):
    return keeps_for_life(make._assemble(choice, *make._channels_and_selectivity(choice)))


def test_a_pad_that_lasts_is_taken_before_one_of_fewer_coils_that_does_not():
    """Nine in ten prints last by the plan and by a program that shares no code; at 2 K fewer coils do."""
    spec = make_spec({**LARGE, "q_min": 25})
    plan = make_plan(spec, tries_cures=False)
    assert (len(plan.channels), plan.life.retune_k) == (2, 10.0)
    assert not [finding for finding in plan.findings if finding.level == "error"]
    assert make.choose(spec).limits == "what prints keep for life"
    kept = kept_db(json.loads(plan_to_json(plan)), pads=2000, for_life=True)
    assert np.mean(kept >= plan.selectivity.asked_db) > spec.print_share - 0.04
    cool = make_plan(replace(spec, life=replace(spec.life, temperature_range_k=2.0)), tries_cures=False)
    assert cool.coils.rows * cool.coils.columns < plan.coils.rows * plan.coils.columns
    assert cool.life.good_share >= spec.print_share
    # Ten kelvin would be too much for it.
    warm = replace(cool, spec=replace(cool.spec, life=spec.life))
    kept = kept_db(json.loads(plan_to_json(warm)), pads=500, for_life=True)
    assert np.mean(kept >= plan.selectivity.asked_db) < 0.5


@pytest.mark.sample(1)
@pytest.mark.parametrize("table", [{**LARGE, "q_min": 50}, {"name": "small", "resolution": 16, **BAND, "q_min": 30}])
def test_no_layout_in_rank_before_the_one_that_is_taken_lasts(monkeypatch, table):
    """Every layout before it with every reuse, drive and gap, judged one by one."""
    spec = make_spec(table)
    chosen = make.choose(spec)
    assert lasts(chosen)
    monkeypatch.setattr(make, "_lasting", lambda works, later, for_cure: works)
    ranked = []
    monkeypatch.setattr(make, "_best", lambda rank, for_cure: (ranked.extend(rank) or ranked[0], False))
    make.choose(spec)
    before = [choice for choice in ranked if choice.layout.rank_by_coils < chosen.layout.rank_by_coils]
    assert len(before) > 10
    judged_by = make._Round({}, for_cure=False, overloaded=False)
    for choice in before:
        one = make._tried(choice, 20.0, spec.print_share, judged_by)
        assert one.share < spec.print_share or not lasts(choice) or make._has_errors(choice)


def test_where_no_layout_lasts_the_one_of_the_fewest_coils_is_taken(monkeypatch):
    spec = make_spec({"name": "small", "resolution": 32, "band_hz": [50, 200], "q_min": 30})
    chosen = make.choose(spec)
    assert not lasts(chosen)
    monkeypatch.setattr(make, "_lasting", lambda works, later, for_cure: works)
    assert make.choose(spec) == chosen


@pytest.mark.sample(2)
@pytest.mark.parametrize(("taxels", "most", "for_cure"), [(96, 3, False), (32 * 8, 2, True), (1, 1, True)])
def test_of_large_pads_and_for_cures_fewer_layouts_are_judged(monkeypatch, taxels, most, for_cure):
    spec = make_spec({"name": "small", "resolution": 32, "band_hz": [50, 200], "q_min": 30})
    judged = list[bool]()

    def tried(choice, least_db, least_share, judged_by):
        judged.append(judged_by.for_life)
        return make.ChoiceFigures(0.0)

    works = make.choose(spec)
    monkeypatch.setattr(make, "MOST_TAXELS_FOR_LIFE", taxels)
    monkeypatch.setattr(make, "_tried", tried)
    monkeypatch.setattr(make, "keeps_for_life", lambda plan: False)
    monkeypatch.setattr(make, "MOST_ALIKE", 100)
    layouts = (works._replace(layout=replace(works.layout, surplus=100 + k)) for k in range(20))
    assert make._lasting(works, map(make._Unsized.of, layouts), for_cure) == works
    assert judged == [True] * most


def test_a_pad_that_lasts_but_is_too_hot_is_not_taken():
    """At Q = 20 plain tones of two channels a coil would last, but warm their beams too much."""
    plan = make_plan(make_spec({**LARGE, "q_min": 20}), tries_cures=False)
    assert plan.life.good_share >= plan.spec.print_share
    assert not [finding for finding in plan.findings if finding.level == "error"]


def test_the_second_layout_in_rank_is_judged_too():
    """Of 4 coils both; the first, 1 x 4, keeps nothing of it, the second, 2 x 2, all."""
    table = {"name": "second", "resolution": 16, "band_hz": [50, 400], "q_min": 50, "delta_y": 7, "drive": "biased"}
    spec = make_spec({**table, "pad": {"width_mm": 60, "depth_mm": 60}, "coil": {"gap_mm": 1, "reuse": "same"}})
    chosen = make.choose(spec)
    assert (chosen.layout.rows, chosen.layout.columns) == (2, 2)
    assert lasts(chosen)


def test_a_pad_too_large_for_its_bed_lasts_as_it_does_on_a_larger_one():
    """That a bed is too small is the same for all layouts."""
    spec = make_spec({**LARGE, "q_min": 25})
    small_bed = replace(spec, printer=replace(spec.printer, bed_x_mm=30.0))
    plan = make_plan(small_bed, tries_cures=False)
    assert [finding.code for finding in plan.findings if finding.level == "error"] == ["plan.bed"]
    chosen = make.choose(small_bed)
    assert chosen.layout == make.choose(spec).layout
    assert chosen.limits == "what prints keep for life"
