"""Odd numbers within the bounds of a spec: a plan of finite figures or one sentence, and no verdict on no number."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from padgen.core.errors import SolverError, SpecError
from padgen.core.units import MM
from padgen.ladders.extreme import ODD, fault_of, odd_table
from padgen.make.planning import spec_of
from padgen.physics.magnetics import coil_rings, rings_potential, solenoid
from padgen.physics.pull import _coarse_rings
from padgen.planner import make, make_plan
from padgen.planner.movers import mover_of
from padgen.report.plans import plan_text
from padgen.spec import catalogue, make_spec

FOUR = {"name": "odd", "resolution": 8, "band_hz": [50, 200], "q_min": 15}
SAMPLE = range(1000, 1012)
"""Odd specs that every run of the tests plans; `make odd` plans 20,000."""


@pytest.mark.sample(2)
@pytest.mark.parametrize("part", range(4))
def test_odd_specs_are_planned_or_refused_in_a_sentence(part):
    faults = {number: fault_of(odd_table(number)) for number in SAMPLE[part::4]}
    assert {number: fault for number, fault in faults.items() if fault} == {}


def test_odd_specs_reach_both_ends_of_every_bound():
    drawn: dict[tuple[str, str], set] = {}
    for table in map(odd_table, range(500)):
        for name, item in ODD:
            inner = table.get(name, {}) if name else table
            if isinstance(inner, dict) and item.name in inner:
                value = inner[item.name]
                drawn.setdefault((name, item.name), set()).update(value if isinstance(value, list) else [value])
    for name, item in ODD:
        meta = item.metadata
        found = drawn[name, item.name]
        assert "low" not in meta or {meta["low"], meta["high"]} <= found, (name, item.name)


@pytest.mark.parametrize(
    ("length_mm", "permeability"),
    [(10, 1000), (10, 2.5), (12, 3), (80, 3), (450, 1000), (499, 1000), (500, 1000), (500, 1e4)],
)
def test_coarse_rings_have_the_field_of_all_charge_of_a_coil(length_mm, permeability):
    """A few rings against hundreds, beside the coil; from 450 mm on the core's face has charge of both signs.

    0.2 % is twice what the coarse rings of a short core miss; a radius outside of the coil misses more.
    """
    coil = solenoid(10 * MM, 4 * MM, length_mm * MM, 1000, 4 * MM, permeability)
    coarse = _coarse_rings(coil)
    fine = coil_rings(coil, 0.2 * MM)
    assert (coarse[0] <= 5 * MM).all()
    away = np.array([11.0, 12.5, 17.0]) * MM
    height = np.array([0.5, 1.0, 3.0]) * MM
    parts = zip(rings_potential(coarse, away, height), rings_potential(fine, away, height), strict=True)
    for found, true in parts:
        assert found == pytest.approx(true, abs=2e-3 * np.abs(true).max())


@pytest.mark.sample(2)
@pytest.mark.parametrize(("length_mm", "known"), [(12.0, True), (30.0, False), (450.0, False), (499.0, False)])
def test_no_pad_works_by_a_leakage_that_is_not_known(length_mm, known):
    plan = make_plan(spec_of("pad-32", {"coil": {"length_mm": length_mm}}))
    codes = [finding.code for finding in plan.findings if finding.level == "error"]
    assert plan.reuse.is_known == known
    assert ("coil.leak_unknown" in codes) == (not known)
    assert (plan.verdict.level == "error") == (not known)
    assert ("is not known" in plan_text(plan)) == (not known)
    for cure in next((f.cures for f in plan.findings if f.code == "coil.leak_unknown"), ()):
        cured = make_plan(spec_of("pad-32", {"coil": {"length_mm": cure["coil.length_mm"]}}))
        assert cured.reuse.is_known and "coil.leak_unknown" not in [finding.code for finding in cured.findings]


def test_a_leakage_that_is_small_whatever_its_error_is_no_finding():
    plan = make_plan(spec_of("pad-32"))
    reuse = replace(plan.reuse, leak_db=60.0, leak_error=3.0)
    assert reuse.most_leak_db == pytest.approx(60 - 20 * np.log10(4))
    for loud, told in ((reuse, 0), (replace(reuse, leak_error=300.0), 1)):
        findings = make.judge(replace(plan, reuse=loud))
        assert sum(f.code == "coil.leak_unknown" for f in findings) == told


@pytest.mark.parametrize(
    ("printer", "drawn_mm", "key", "offset_mm"),
    [
        ({"name": "fdm-0.25"}, 0.15, "z_offset_mm", -0.2),
        ({"name": "fdm-0.4"}, 0.2, "z_offset_mm", -0.2),
        ({"name": "resin-0.05"}, 0.15, "z_offset_mm", -0.15),
        ({"name": "fdm-0.4", "smallest_beam_layers": 2}, 0.3, "z_offset_mm", -0.45),
        ({"name": "fdm-0.25"}, 0.27, "width_offset_mm", -0.3),
    ],
)
def test_beams_that_print_with_nothing_left_are_refused(printer, drawn_mm, key, offset_mm):
    table = {**FOUR, "resolution": 16, "coil": {"grid": [4, 4]}}
    with pytest.raises(SpecError, match=f"at least {0.01 - drawn_mm:.5g} mm, got {offset_mm} mm") as told:
        make_spec({**table, "printer": {**printer, key: offset_mm}})
    assert told.value.where == f"printer.{key}"
    (cure,) = told.value.cures
    assert fault_of({**table, "printer": {**printer, key: cure[f"printer.{key}"]}}) == ""


def pulled(table, gap_m, offset_m):
    spec = make_spec(table)
    places_m = np.stack([offset_m, np.zeros_like(offset_m)], -1)
    return mover_of(spec).pulls(spec.coil, spec.washer_or_magnet, gap_m, places_m)


@pytest.mark.parametrize("coil", sorted(catalogue("coil")))
def test_pulls_go_as_the_square_of_the_turns_on_and_off_the_catalogue(coil):
    """As linear steel has it; to rounding, over catalogue tables (1 mm) and solved ones (0.2 mm)."""
    gap = np.array([0.2, 1.0, 3.0]) * MM
    offset = np.array([4.0, 4.4, 2.0]) * MM
    listed = catalogue("coil")[coil]["turns"]
    one = pulled({**FOUR, "coil": {"name": coil}}, gap, offset)
    for turns in (listed + 1, 1.0, 777.7, 1e6):
        other = pulled({**FOUR, "coil": {"name": coil, "turns": turns}}, gap, offset)
        square = (turns / listed) ** 2
        for name in ("pull", "side", "moment", "slope", "jump", "slope_off", "bend_off"):
            assert getattr(other, name) / square == pytest.approx(getattr(one, name), rel=1e-12, abs=0), name
        assert other.dipole / (turns / listed) == pytest.approx(one.dipole, rel=1e-12)
        assert other.error == pytest.approx(one.error, rel=1e-12)


def test_numbers_that_break_down_are_told_in_a_sentence(monkeypatch):
    for broken in (
        lambda *_: np.zeros(1) / np.zeros(1),
        lambda *_: np.exp(np.full(1, 1e4)),
        lambda *_: np.log(np.zeros(1)),
        lambda *_: 1 / 0,
        lambda *_: np.linalg.inv(np.zeros((2, 2))),
    ):
        monkeypatch.setattr(make, "judge", broken)
        told = r"^the spec: leaves the range .* in finish of planner/make.py\)"
        with np.errstate(all="ignore"), pytest.raises(SolverError, match=told):
            make_plan(make_spec(FOUR))


def test_a_breakdown_names_the_field_whose_usual_value_does(monkeypatch):
    judge = make.judge
    monkeypatch.setattr(make, "judge", lambda plan: judge(plan) if plan.spec.q_min < 1e5 else 1 / 0)
    with pytest.raises(SolverError, match=r"must be nearer to what is usual, got 1e\+06: .* leaves the range") as told:
        make_plan(make_spec({**FOUR, "q_min": 1e6, "drive": {"level_um": 1e-3}}))
    assert told.value.where == "q_min"
    assert told.value.cures == ({"q_min": 15.0},)


def test_a_breakdown_that_no_usual_value_mends_is_told_as_it_is(monkeypatch):
    """As where it is in what trials leave out: each field that is tried is planned whole."""
    monkeypatch.setattr(make, "left_out", lambda plan: 1 / 0)
    with pytest.raises(SolverError, match="leaves the range in which it can be computed") as told:
        make_plan(make_spec(FOUR))
    assert not told.value.cures


@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_no_plan_has_a_figure_that_is_not_finite(monkeypatch, value):
    plan = make_plan(make_spec(FOUR))
    lost = replace(plan, channels=(replace(plan.channels[0], sag_um=value), *plan.channels[1:]))
    monkeypatch.setattr(make, "finish", lambda *_, **__: lost)
    with pytest.raises(SolverError, match=r"channels\[0\]\.sag_um: has no finite value \(-?(nan|inf)\)"):
        make_plan(make_spec(FOUR))
