"""Cures that refusals and findings name: applied, they do what they say."""

from collections import Counter
from dataclasses import replace

import pytest

from padgen.core.errors import Finding, InfeasibleError, PadgenError, SpecError, cured
from padgen.ladders.extreme import random_table
from padgen.planner import cures, make_plan, plan_from_json, plan_to_json
from padgen.spec import make_spec
from padgen.spec.load import laid_over, without_none

SPECS = (0, 4, 6, 7, 15, 22, 26, 56, 60)
SLOW_SPECS = (3, 13, 23, 42, 52, 55, 78, 83, 88)
"""Others take seconds: `docs/measure_cures.py` has three hundred."""
BASE = {"name": "cured", "resolution": 4, "band_hz": [50, 200], "q_min": 15}


def cures_of(table):
    """Return ``(what it cures, fault)`` of each cure that the answer to a spec names; no fault where the cure works.

    A refusal's fields are refused no more by that field; where no pad could be laid out, the plan has no error then.
    Of a finding's none of its kind is left.
    """
    answer = _answer(table, {})
    if isinstance(answer, PadgenError):
        return [(answer.where, _fault(answer, _answer(table, cure))) for cure in answer.cures]
    told = {finding.code: finding.cures for finding in answer.findings if finding.cures}
    return [(code, _left(code, _answer(table, cure))) for code, cures in told.items() for cure in cures]


def _answer(table, cure):
    """Return the plan of a spec with a cure applied, or its refusal."""
    try:
        return make_plan(make_spec(without_none(laid_over(table, cure))), tries_cures=not cure)
    except PadgenError as error:
        return error


def _fault(refusal, answer):
    if isinstance(answer, PadgenError):
        again = answer.where == refusal.where or isinstance(refusal, InfeasibleError)
        return f"is refused: {answer}" if again else ""
    errors = [finding.message for finding in answer.findings if finding.level == "error"]
    return errors[0] if errors and isinstance(refusal, InfeasibleError) else ""


def _left(code, answer):
    if isinstance(answer, PadgenError):
        return f"is refused: {answer}"
    left = [finding.message for finding in answer.findings if finding.code == code and finding.level != "note"]
    return left[0] if left else ""


@pytest.mark.parametrize(
    ("specs", "codes"),
    [
        (SPECS, {"washer", "coil.heat", "gap.travel"}),
        pytest.param(SLOW_SPECS, {"resolution", "coil.softening"}, marks=pytest.mark.soak),
    ],
    ids=["usual", "slow"],
)
def test_every_cure_of_random_specs_does_what_it_says(specs, codes):
    tried = Counter()
    for number in specs:
        for what, fault in cures_of(random_table(number)):
            assert not fault, (number, what, fault)
            tried[what] += 1
    assert tried.total() >= 10 and codes <= set(tried), tried


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"drive": {"level_um": 90}, "coil": {"gap_mm": 0.4}}, "gap.travel"),
        ({"drive": {"level_um": 300.0}, "coil": {"gap_mm": 3.0}}, "coil.heat"),
        ({"drive": {"voltage_limit_v": 0.5}}, "coil.voltage"),
        ({"limits": {"power_w": 0.001}}, "limits.power"),
        ({"pad": {"width_mm": 260, "depth_mm": 40}, "resolution": 8}, "plan.bed"),
    ],
)
def test_a_finding_names_a_cure(changes, code):
    table = {**BASE, **changes}
    found = [f for f in make_plan(make_spec(table)).findings if f.code == code]
    assert found and all(f.cures and f.message.endswith(" would do") for f in found)
    assert [fault for what, fault in cures_of(table) if what == code] == [""]


def test_too_few_outputs_name_a_cure_for_a_grid_that_is_given():
    coil = {"grid": [4, 4], "reuse": "alternate", "gap_mm": 1}
    amplifier = {"channels": 4, "coupling": "DC", "voltage_v": 20, "current_a": 1}
    found = cures_of({**BASE, "resolution": 32, "delta_y": 5, "coil": coil, "amplifier": amplifier})
    assert found and not any(fault for _, fault in found)


def test_a_cure_that_helps_nothing_or_harms_is_not_said():
    plan = make_plan(make_spec({**BASE, "resolution": 8}))
    finding = Finding("warning", "coil.heat", "coil", "hot", ({"a": 1}, {"b": 2}, {"c": 3}))
    ill = replace(plan, findings=(finding,))
    answers = {
        "a": ill,
        "b": replace(plan, findings=(Finding("error", "gap.travel", "channel 0", "it meets the coil"),)),
        "c": replace(plan, selectivity=replace(plan.selectivity, placed_all_states_db=-1.0)),
    }
    (told,) = cures.with_tried_cures(ill, lambda cure: answers[next(iter(cure))]).findings
    assert (told.message, told.cures) == ("hot", ())
    (told,) = cures.with_tried_cures(ill, lambda cure: replace(plan, findings=())).findings
    assert (told.message, told.cures) == ("hot; a = 1 would do", ({"a": 1},))


def test_cures_are_in_the_plan_and_come_back():
    plan = make_plan(make_spec({**BASE, "limits": {"power_w": 0.001}}))
    assert any(f.cures for f in plan.findings)
    assert plan_from_json(plan_to_json(plan)).findings == plan.findings


def test_cures_in_words():
    cure = {"coil.reuse": "same", "taxel.centre_post": True, "band_hz": [50.0, 70.5]}
    words = "coil.reuse = 'same' with taxel.centre_post = true with band_hz = [50, 70.5]"
    assert cured("no", [cure]) == f"no; {words} would do"
    assert cured("no", [{"material": None}, {"q_min": 1.5}]) == "no; leaving out material, or q_min = 1.5, would do"
    assert cured("no", [{"coil": None, "washer": None}]) == "no; leaving out coil and washer would do"
    assert cured("no", [{"washer": None, "q_min": 2.5}]) == "no; q_min = 2.5 without washer would do"
    assert cured("no", []) == "no"


@pytest.mark.parametrize(
    "coil", [{"resistance_ohm": 5.0, "inductance_mh": 2.0}, {"turns": 300}, {"inductance_mh": 1.0, "turns": 99.0}]
)
def test_a_coil_given_in_part_is_refused(coil):
    with pytest.raises(SpecError, match=r"^coil: needs turns, resistance_ohm, inductance_mh together .* got only "):
        make_spec({**BASE, "coil": coil})
    assert make_spec({**BASE, "coil": {"name": "paper", **coil}}).coil.name == "paper"
    assert make_spec({**BASE, "coil": {"inductance_mh": 0.0}}).coil.inductance_mh == 0
    whole = {"turns": 300, "resistance_ohm": 5.0, "inductance_mh": 2.0}
    assert make_spec({**BASE, "coil": {**whole, **coil}}).coil.turns in (99, 300)
