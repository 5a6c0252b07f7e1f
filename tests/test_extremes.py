"""Extreme cases: what each model says, what is true, whether it knew; a few of those of `docs/measure_extremes.py`."""

import os
from contextlib import suppress
from dataclasses import replace
from math import inf, isnan, nan, sqrt

import numpy as np
import pytest

from docs.measure_extremes import judged_error, relative_error, verdict
from padgen.core.errors import PadgenError
from padgen.core.runner import Runner
from padgen.ladders.stages import Solved
from padgen.planner import make_plan
from padgen.spec import make_spec
from tests import random_specs
from tests.extremes import ExtremeCase, selectivity_cases, solid_cases, spec_cases
from tests.random_specs import outcome, random_table
from tests.study_work import refuses


def own_cases():
    """Yield a case for each verdict."""

    def case(name, solve, reference=lambda: np.array([1.0])):
        return ExtremeCase(name, "test", "model", solve, reference, "by hand")

    yield case("right", lambda: Solved(np.array([1.001]), 0.01))
    yield case("refused", refuses)
    yield case("wrong", lambda: Solved(np.array([1.1]), 0.01))
    yield case("no number", lambda: Solved(np.array([nan]), 0.01))
    yield case("states nothing", lambda: Solved(np.array([1.0]), inf))
    yield case("dies", lambda: os.abort())
    yield case("no reference", lambda: Solved(np.array([1.0]), 0.01), refuses)


def test_verdicts():
    with Runner() as runner:
        found = [verdict(runner, own_cases, place) for place in range(7)]
    assert [told for told, _ in found] == ["right", "refused", "WRONG", "WRONG", "WRONG", "WRONG", "unchecked"]
    assert found[1][1].startswith("rung: asks for more") and "SIGABRT" in found[5][1]
    assert found[2][1] == "off by 0.1, states 0.01"


def test_errors_of_extreme_cases():
    assert relative_error(np.array([1.0, 2.2]), np.array([1.0, 2.0])) == pytest.approx(0.1)
    assert isnan(relative_error(np.array([1.0]), np.array([1.0, 2.0])))
    assert isnan(relative_error(np.array([1.0]), np.array([inf])))
    assert relative_error(np.array([0.5]), np.array([0.0])) == 0.5
    assert judged_error(1e-3, 1e-3)[0] == "right"
    assert judged_error(1e-3, 0.0)[0] == "WRONG"
    assert judged_error(1e-3, 0.0, allowed=2e-3)[0] == "right"


def test_random_specs_are_planned_or_refused_in_a_sentence():
    """A few of the list are tried; `docs/measure_extremes.py` plans hundreds and solves some by finite elements."""
    tables = [random_table(number) for number in range(6, 12)]
    assert tables == [random_table(number) for number in range(6, 12)]
    assert [outcome(table) for table in tables] == [""] * 6
    odd = [set(table) - {"name", *random_table(0, 0)} for table in tables]
    assert len(set.union(*odd)) > 3


def test_a_wrong_plan_of_a_random_spec_is_found(monkeypatch):
    table = {"name": "a", "resolution": 2, "band_hz": [50, 200], "q_min": 15}
    plan = make_plan(make_spec(table))
    lost = replace(plan, channels=(replace(plan.channels[0], sag_um=nan), *plan.channels[1:]))
    monkeypatch.setattr(random_specs, "plan_for", lambda spec: lost)
    assert outcome(table) == "sag_um is no number"

    def breaks(spec):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(random_specs, "plan_for", breaks)
    assert outcome(table) == "ZeroDivisionError: by nothing"
    with pytest.raises(ValueError, match="are wrong: random "):
        next(spec_cases()).solve()


def test_statics_that_no_pad_survives_are_refused():
    cases = [case for case in spec_cases() if "impossible" in repr(case.solve.args[:1])]
    assert len(cases) == 4
    for case in cases:
        with suppress(PadgenError):
            assert case.solve().values == case.reference()


def solved(name: str):
    """Return the finite-element answer to a case of `solid_cases`, in a process of its own."""
    return next(case for case in solid_cases() if case.name == name).solve()


def test_elements_know_their_error():
    """One case of the list; `docs/measure_extremes.py` runs all, and solves the references anew.

    138.80316 Hz is the block at 3 GPa by elements of order 4 in three layers (`extremes._by_finer`, NGSolve 6.2.2608,
    not extrapolated: good to 1e-3); resonances go with the root of the moduli.
    """
    with Runner() as runner:
        answer = runner.run(solved, "modulus 1e+12 Pa, steel in proportion").value
    truth = 138.80316391 * sqrt(1e12 / 3e9)
    assert relative_error(answer.values, np.array([truth])) <= answer.stated_error + 1e-3 < 5e-3


@pytest.mark.parametrize("case", list(selectivity_cases()), ids=lambda case: f"{case.name} {case.model}")
def test_selectivity_keeps_its_digits(case):
    answer = case.solve()
    error = relative_error(answer.values, case.reference())
    # The stated bound is of rounding, not of a method: it must not hide more than a few digits.
    assert error <= answer.stated_error < 1e-14
