"""`padgen study`: errors against the finest converged rung, in processes of their own, and whole files."""

import csv
import io
import json
import os
import pickle
import re
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from math import inf, isfinite, isnan, nan, sqrt

import numpy as np
import pytest

import padgen as pg
from padgen.cli import run
from padgen.cli.common import described
from padgen.core.display import plot_bytes, seconds_text
from padgen.core.errors import PadgenError, SolverError, SpecError, percent
from padgen.ladders.extreme import fault_of, random_table, selectivity_cases, solid_cases, spec_cases
from padgen.ladders.rung import (
    MOST_SUBJECTS,
    NOT_RUN,
    TOLERANCES,
    Ladder,
    Rung,
    RungFigures,
    Scene,
    Theory,
    chosen_channels,
    distinct_channels,
    judged,
    measured,
    observed_order,
    picks,
    recommended_row,
    timed,
    value_from_process,
)
from padgen.ladders.stages import LADDERS
from padgen.ladders.study import (
    STUDY_FILES,
    CaseVerdict,
    Study,
    extreme_picture,
    judged_error,
    named_cases,
    parse_only,
    relative_error,
    run_extreme,
    run_study,
    study_csv,
    study_json,
    verdict_of,
)
from padgen.make.planning import parse_tolerance
from padgen.report.rungs import extreme_figure, marks_of, marks_read, study_figure
from tests.study_work import (
    EXACT,
    OWN_CASES,
    in_own_process,
    loses_its_mind,
    noted,
    noted_beside,
    nothing,
    power_law,
    prints,
    refuses,
    takes_60_mb,
)

# Judging


def ladder(rungs, reference="fine", **more) -> Ladder:
    return Ladder("test", "a subject", "a figure", "Hz", tuple(rungs), reference, **more)


def known(values, seconds=1.0, **more) -> RungFigures:
    return RungFigures(np.atleast_1d(np.asarray(values, float)), seconds=seconds, runs=1, memory_mb=1.0, **more)


def of_order(order, steps, constant=0.1) -> list[RungFigures]:
    return [known(EXACT * (1 + constant * h**order), seconds=1 / h) for h in steps]


def rungs_of(steps, series="fine") -> list[Rung]:
    return [Rung("model", f"h = {h}", partial(power_law, 2, h), series, h) for h in steps]


@pytest.mark.parametrize("order", [0.5, 1.09, 2, 4, 8])
@pytest.mark.parametrize("steps", [(1, 0.5, 0.25), (1, 0.5, 0.2), (0.3, 0.1, 0.05)])
def test_order_is_observed_from_three_steps(order, steps):
    values = [0.1 * h**order for h in steps]
    gaps = [values[0] - values[1], values[1] - values[2]]
    # Exact but for the cancellation in the differences and the end of the bisection.
    assert observed_order(steps, gaps) == pytest.approx(order, rel=1e-9)


def test_no_order_without_falling_differences():
    assert observed_order((1, 0.5, 0.25), (1e-3, 2e-3)) is None
    assert observed_order((1, 0.5), (1e-3,)) is None
    assert observed_order((1, 0.5, 0.25), (1e-3, 0.0)) is None
    # Differences of rounding tell nothing: the order is that of the steps before.
    assert observed_order((1, 0.5, 0.25, 0.125), (4e-3, 1e-3, 1e-15)) == pytest.approx(2, rel=1e-9)


@pytest.mark.parametrize("order", [0.6, 1, 2, 4])
def test_uncertainty_covers_what_is_left(order):
    steps = (1, 0.5, 0.25, 0.125)
    result = judged(ladder(rungs_of(steps)), of_order(order, steps))
    left = 0.1 * 0.125**order
    assert result.converged
    # Aitken's estimate is exact for a power law; d₂ itself is up to 2^order − 1 times what is left.
    assert left * (1 - 0.05) <= result.uncertainty <= max(2.0**order - 1, 1.1) * left
    for row, h in zip(result.rows, steps, strict=True):
        true = 0.1 * h**order
        assert true <= row.at_most * 1.05


def test_a_last_step_that_hardly_changed_anything_is_not_believed():
    # As when only one of two things was refined.
    result = judged(ladder(rungs_of((1, 0.5, 0.25))), [known(v) for v in (1.1, 1.0, 1.0 + 1e-9)])
    assert result.converged
    assert result.uncertainty == pytest.approx(0.05 * 0.1, rel=1e-6)


def test_order_against_the_reference_itself():
    steps = (1, 0.5, 0.25)
    exact = [known(EXACT * (1 + e)) for e in (1e-6, 1e-9, 1e-12)]
    rungs = rungs_of(steps, "coarse") + [Rung("exact", str(k), nothing, "fine") for k in range(3)]
    measured_ = of_order(1, steps) + exact
    found = judged(ladder(rungs, theory={"coarse": Theory(1, "by design", True)}), measured_).orders
    # Relative errors are against the reference, which is 1e-9 off.
    assert [order.series for order in found] == ["coarse"]
    assert found[0].observed == pytest.approx(1, abs=1e-6)
    assert found[0].theory.order == 1


def test_not_converged_is_said_and_nothing_is_recommended_below():
    values = (1.0, 1.02, 1.0, 1.03)
    result = judged(ladder(rungs_of((1, 0.5, 0.25, 0.125))), [known(v) for v in values])
    assert not result.converged
    assert "not shown to be converged" in result.why
    # Twice the larger of the last two changes, 0.03/1.03.
    assert result.uncertainty == pytest.approx(2 * 0.03 / 1.03)
    assert recommended_row(result, 0.05) is None
    assert recommended_row(result, 0.1) is not None


@pytest.mark.parametrize("count", [0, 1, 2])
def test_two_refinements_are_asked_for(count):
    found = [known(1.0)] * count + [RungFigures(note="refused: no engine")] * (3 - count)
    result = judged(ladder(rungs_of((1, 0.5, 0.25))), found)
    assert result.uncertainty == inf
    assert not result.converged
    assert "refused: no engine" in result.why or count == 0
    assert all(recommended_row(result, tol) is None for tol in TOLERANCES)
    assert (result.reference is None) == (count == 0)
    text = _study(result).text()
    assert "known to ±" not in text and "nothing is recommended below" not in text and "≤ ?" not in text
    if count:
        there = ("none has", "only one has")[count - 1]
        assert f"no error can be stated: it is to be compared with two coarser ones, and {there} an answer" in text
        assert "; the finest has no answer (refused: no engine)" in text


def test_the_quickest_rung_that_holds_is_recommended():
    errors = (0.2, 0.05, 0.004, 3e-6, 2e-6, 1e-6)
    seconds = (1, 5, 3, 20, 30, 40)
    rungs = [Rung("m", str(k), nothing, "fine" if k > 2 else "") for k in range(6, 12)]
    result = judged(ladder(rungs), [known(1 + e, s) for e, s in zip(errors, seconds, strict=True)])
    assert [recommended_row(result, tol) for tol in (0.5, 0.1, 0.01, 0.001)] == [0, 2, 2, 3]


def test_what_is_only_measured_against_is_not_recommended():
    rungs = [Rung("slow", "", nothing), *(replace(rung, offered=False) for rung in rungs_of((1, 0.5, 0.25)))]
    result = judged(ladder(rungs), [known(1.001, 100.0), *[known(1.0, 1.0)] * 3])
    assert recommended_row(result, 0.01) == 0
    assert picks([result], (0.01,))[0].model == "slow"
    assert recommended_row(result, 1e-4) is None


def test_an_error_that_cannot_be_told_from_the_references_own_is_a_bound():
    values = (1.5, 1.004, 1.0, 1.001)
    result = judged(ladder(rungs_of((1, 0.5, 0.25, 0.125))), [known(v) for v in values])
    assert [row.is_bound for row in result.rows] == [False, False, True, True]
    assert "≤" in _study(result).text().splitlines()[7]


def test_errors_are_relative_to_the_largest_or_to_each():
    found = [known(v) for v in ([1.0, 0.011], [1.0, 0.01], [1.0, 0.01], [1.0, 0.01])]
    rungs = rungs_of((1, 0.5, 0.25, 0.125))
    largest = judged(ladder(rungs), found)
    each = judged(ladder(rungs, relative_to="each"), found)
    assert largest.rows[0].error == pytest.approx(0.001)
    assert each.rows[0].error == pytest.approx(0.1)


def test_an_answer_of_another_shape_has_no_error():
    found = [known([1.0, 2.0]), known(1.0), known(1.0), known(1.0)]
    row = judged(ladder(rungs_of((1, 0.5, 0.25, 0.125))), found).rows[0]
    assert isnan(row.error)
    assert row.at_most == inf


def test_a_pick_holds_for_every_subject():
    rungs = [Rung("quick", "", nothing), Rung("slow", "", nothing), *rungs_of((1, 0.5, 0.25))]
    exact = [known(1.0, 100.0)] * 3
    one = judged(ladder(rungs), [known(1.001, 1.0), known(1.001, 2.0), *exact])
    other = judged(ladder(rungs), [known(1.2, 1.0), known(1.001, 4.0), *exact])
    (pick,) = picks([one, other], (0.01,))
    assert (pick.model, pick.seconds) == ("slow", 3.0)
    (none,) = picks([one, judged(ladder(rungs), [RungFigures()] * 5)], (0.01,))
    assert none.model == ""


# Processes


def test_a_rung_runs_in_a_process_of_its_own():
    found = measured(Rung("m", "", in_own_process))
    assert found.values[0] != os.getpid()
    assert found.runs > 1
    assert 0 <= found.seconds < 1


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "work, note",
    [
        (refuses, "refused: rung: asks for more than it can: 3 is the nearest that would do"),
        (os.abort, "its process died of signal 6 (SIGABRT)"),
        (partial(os._exit, 3), "its process ended with code 3"),
        (partial(divmod, 1, 0), "broke down (ZeroDivisionError: integer division or modulo by zero)"),
        (loses_its_mind, "its answer is not a number"),
    ],
)
def test_a_refusal_or_a_crash_costs_one_rung(work, note):
    found = measured(Rung("m", "", work))
    assert found.values is None
    assert found.note == note


def test_a_rung_that_does_not_end_is_ended():
    start = time.monotonic()
    found = measured(Rung("m", "", partial(time.sleep, 60), limit_s=1.0))
    assert found.note == "took longer than 1 s"
    # Not the minute that it would have slept.
    assert time.monotonic() - start < 30


def test_the_peak_of_memory_is_the_works_own():
    # An array of 60 MB and nothing else: the interpreter's own 30 MB are not counted.
    assert measured(Rung("m", "", takes_60_mb)).memory_mb == pytest.approx(60, abs=8)
    assert measured(Rung("m", "", prints)).memory_mb < 8


def test_what_an_engine_prints_does_not_reach_the_user(capfd):
    assert measured(Rung("m", "", prints)).values[0] == 1.0
    assert capfd.readouterr() == ("", "")


def test_what_is_prepared_is_made_once(tmp_path):
    prepare = partial(noted, tmp_path / "prepared")
    work = partial(noted_beside, tmp_path / "worked")
    found = timed(work, prepare=prepare, most_runs=3).value
    assert found.value == "xx"
    assert (tmp_path / "prepared").read_text() == "x"
    assert (tmp_path / "worked").read_text() == "xxx" == "x" * found.runs


def test_caches_of_models_are_emptied_between_runs(monkeypatch):
    from padgen.ladders import rung
    from padgen.physics import magnetics
    from padgen.verify import Engine

    cached = lru_cache(maxsize=None)(lambda: object())
    monkeypatch.setattr(magnetics, "a_cache", cached, raising=False)
    monkeypatch.setattr(magnetics, "not_to_be_loaded", Engine("no_such_package"), raising=False)
    cached()
    rung._run(pickle.dumps((None, int)), ())
    assert cached.cache_info().currsize == 0


def test_a_step_apart_says_what_went_wrong():
    with pytest.raises(SolverError, match="rung: asks for more"):
        value_from_process(refuses)
    with pytest.raises(SolverError, match="SIGABRT"):
        value_from_process(os.abort)


# Files


def _study(*results):
    return Study("test", results, picks(results), TOLERANCES, {})


@pytest.fixture
def result():
    theory = {"fine": Theory(2, "by design")}
    rungs = [Rung("crude", "", nothing), Rung("gone", "", nothing), *rungs_of((1, 0.5, 0.25, 0.125))]
    found = [known(EXACT * 1.3, 1e-4), RungFigures(note="refused: it is gone"), *of_order(2, (1, 0.5, 0.25, 0.125))]
    return judged(ladder(rungs, theory=theory), found)


def test_csv_has_a_row_per_rung(result):
    rows = list(csv.DictReader(io.StringIO(study_csv(_study(result)))))
    assert [row["model"] for row in rows] == ["crude", "gone", *["model"] * 4]
    # The reference is 0.00156 above the truth, and known to that and 0.0047: too little for 0.001.
    assert float(rows[0]["error"]) == pytest.approx(1.3 / 1.0015625 - 1)
    assert rows[1]["error"] == rows[1]["seconds"] == ""
    assert rows[1]["note"] == "refused: it is gone"
    assert [row["recommended_for"] for row in rows] == ["", "", "", "0.1", "0.01", ""]


def test_json_has_what_was_measured_and_what_is_recommended(result):
    told = json.loads(study_json(replace(_study(result), about={"name": "test"})))
    assert told["name"] == "test"
    (ladder,) = told["ladders"]
    assert [rung["note"] for rung in ladder["rungs"]] == ["", "refused: it is gone", "", "", "", ""]
    assert ladder["rungs"][1]["values"] is None and ladder["reference"] == 5
    for pick, again in zip(picks([result]), told["recommended"], strict=True):
        assert again["resolution"] == pick.resolution
        # JSON keeps ten digits, and no number that is not finite.
        assert (again["at_most"] or inf) == pytest.approx(pick.at_most, rel=1e-9)


def test_the_same_figures_draw_the_same_bytes(result):
    one, two = ([plot_bytes(_study(result).plot(), kind) for kind in ("svg", "png")] for _ in range(2))
    assert one == two
    assert b"dc:date" not in one[0]
    assert one[1].startswith(b"\x89PNG")
    verdicts = [CaseVerdict("a", "b", "c", 1e-9, 1e-6, verdict="right")]
    assert extreme_picture(verdicts) == extreme_picture(verdicts)


def test_the_figure_has_every_rung_with_an_error_as_measured_and_as_read_back(result):
    study = replace(_study(result), about={"name": "test"})
    read = marks_read(json.loads(study_json(study)))
    assert [rung[:5] for rung in read] == [rung[:5] for rung in marks_of(study) if isfinite(rung.error)]
    (panel,) = study_figure("test", marks_of(study), study.tolerances).panels
    crude, model = panel.points
    assert (crude.label, model.label) == ("crude", "model") and len(model.x) == 4
    assert crude.x == (1e-4,) and crude.y[0] == pytest.approx(1.3 / 1.0015625 - 1)
    rows = [row for row in result.rows if row.rung.model == "model"]
    assert model.y == pytest.approx([row.at_most if row.is_bound else row.error for row in rows])
    assert model.hollow == tuple(row.is_bound for row in rows) and any(model.hollow) and not all(model.hollow)
    assert model.rings == ("", "10 %", "1 %", "")
    assert [line.at for line in panel.lines] == list(study.tolerances)
    for scale, values in ((panel.x, (*crude.x, *model.x)), (panel.y, (*crude.y, *model.y))):
        assert scale.low < min(values) and max(values) < scale.high
    (again,) = study_figure("test", read).panels
    assert [points.y for points in again.points] == [pytest.approx(points.y, rel=1e-9) for points in panel.points]


def test_extreme_cases_lie_below_the_diagonal_where_they_are_right():
    named = ("right", 1e-9, 1e-6), ("WRONG", 1e-4, 1e-6), ("right", 0.0, 0.0), ("refused", nan, nan)
    verdicts = [CaseVerdict("a", str(k), "c", error, stated, verdict=v) for k, (v, error, stated) in enumerate(named)]
    (panel,) = extreme_figure(verdicts).panels
    (points,) = panel.points
    assert points.names == ("0", "1", "2") and points.roles == ("right", "wrong", "right")
    assert [y <= x for x, y in zip(points.x, points.y, strict=True)] == [True, False, True]
    assert panel.x.low < points.x[2] == points.y[2], "an error of 0 is drawn at the least one"


def test_a_ladder_without_reference_is_drawn_and_told(result):
    bare = judged(result.ladder, [RungFigures(note="refused: no engine")] * 6)
    assert plot_bytes(_study(bare).plot(), "svg")
    assert "there is no reference" in _study(bare).text()


def test_the_table_tells_orders_and_refusals(result):
    text = _study(result).text()
    assert "order of convergence, fine: 2.00 observed, 2 in theory (by design)" in text
    assert "gone, : refused: it is gone" in text
    assert "memory  quickest for\n" in text


def test_words():
    assert [percent(v, 3) for v in (1.459, 0.1, 0.00012345, inf)] == ["146 %", "10 %", "0.0123 %", "?"]
    assert [seconds_text(v) for v in (12.34, 0.0012, 3.4e-6, nan)] == ["12.3 s", "1.2 ms", "3.4 µs", ""]


# The command


def test_a_study_measures_and_draws(paper_plan):
    said = []
    study = pg.study(paper_plan, only=["allocation"], tolerance=0.05, progress=said.append)
    assert repr(study) == "<Study paper-32: allocation>" and len(study.plot().axes) >= 1
    assert study.tolerances == (0.1, 0.05, 0.01, 0.001, 0.0001)
    assert sum("rung" in step for step in said) == len(study.ladders[0].rows)
    assert study.ladders[0].converged
    assert study.ladders[0].uncertainty < 10 ** (0.1 / 20) - 1
    assert study.text().count("allocation") >= 5


def interrupted_at(words: str):
    """Return a progress function that raises Ctrl-C when it is called with these words."""

    def progress(step: str) -> None:
        if words in step:
            raise KeyboardInterrupt

    return progress


def test_an_interrupted_study_writes_what_it_has(paper_plan, tmp_path):
    study = run_study(paper_plan, tmp_path / "out", ("allocation", "geometry"), progress=interrupted_at("rung 3"))
    rows = [row for result in study.ladders for row in result.rows]
    assert [row.measured is NOT_RUN for row in rows] == [False] * 2 + [True] * (len(rows) - 2)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted([*STUDY_FILES, "manifest.json"])
    told = json.loads((tmp_path / "out" / "study.json").read_text())
    assert told["tolerances"] == list(study.tolerances)
    assert told["stopped"] and len(told["missing"]) == len(rows) - 2
    assert told["missing"][0].startswith("allocation, ") and told["missing"][0].endswith("exact response, all states")
    table = (tmp_path / "out" / "study.csv").read_text()
    notes = [row["note"] for row in csv.DictReader(io.StringIO(table))]
    assert notes == ["", ""] + ["not run: the study was stopped"] * (len(rows) - 2)
    text = study.text()
    assert "not run: 4 of 6 models of allocation (" in text and "not run: 8 of 8 models of geometry (" in text
    assert "not known, since the study was stopped" in text and "none is known" not in text
    assert study.total == len(rows)
    assert "\ngeometry," not in text


def test_interrupted_before_anything_it_leaves_nothing(paper_plan, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run_study(paper_plan, tmp_path / "out", ("allocation",), progress=interrupted_at("rung 1"))
    with pytest.raises(KeyboardInterrupt):
        run_extreme(tmp_path / "out", interrupted_at("case 1"), OWN_CASES)
    assert not (tmp_path / "out").exists()


@pytest.mark.soak
def test_interrupted_extreme_cases_say_which_were_not_run(tmp_path):
    study = run_extreme(tmp_path / "out", interrupted_at("case 3"), OWN_CASES)
    assert [v.verdict for v in study.verdicts] == ["right", "refused", *["not run"] * 5]
    assert study.missing[0] == "test, wrong" and (len(study.missing), study.total) == (5, 7)
    assert json.loads((tmp_path / "out" / "extreme.json").read_text())["stopped"]
    assert "5 not run" in study.text()


def test_the_command_stops_in_time_and_logs_its_rungs(tmp_path):
    command = [sys.executable, "-m", "padgen", "study", "paper-pair", "--only", "dynamics", "-o", str(tmp_path)]
    ended = subprocess.run([*command, "--time-limit", "3"], capture_output=True, text=True, timeout=120)
    log = ended.stderr.splitlines()
    if (tmp_path / "study.json").exists():  # else not even the first rung was done in time
        assert any(line.startswith("rung 1 of ") for line in log)
        told = json.loads((tmp_path / "study.json").read_text())
        assert (ended.returncode, told["stopped"]) in ((2, True), (0, False))
        assert not told["stopped"] or re.fullmatch(
            r"padgen: stopped: \d+ of \d+ models (was|were) not run \(marked in study.csv\)", log[-1]
        )
        assert "best of 2 to 7 runs" in told["times"] and told["times"] in " ".join(ended.stdout.split())
    else:
        assert log[-1].startswith("padgen: interrupted")


@pytest.mark.parametrize("limit", ["0", "-1", "nan", "inf"])
def test_a_time_limit_that_is_none(limit, capsys):
    assert run(["study", "paper-pair", "--time-limit", limit]) == 2
    assert "--time-limit: must be above 0" in capsys.readouterr().err


def test_the_help_of_only_names_every_ladder():
    text = described(pg.study, "only")
    assert all(name in text for name in LADDERS)


def test_names_of_ladders():
    assert parse_only(None) == tuple(LADDERS)
    assert parse_only(" structure, allocation") == ("allocation", "structure")
    with pytest.raises(SpecError, match=r"--only: must be among .*, got 'structre'; did you mean 'structure'"):
        parse_only("structre")
    with pytest.raises(SpecError, match="must name one or more"):
        parse_only(",")


@pytest.mark.parametrize("text, value", [("1%", 0.01), ("0.01", 0.01), (" 100 %", 1.0), ("1e-4", 1e-4)])
def test_tolerances(text, value):
    assert parse_tolerance(text) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("text", ["0", "-1%", "101%", "2", "nan", "inf", "much", ""])
def test_tolerances_that_are_none(text):
    with pytest.raises(SpecError, match="--tolerance: must be"):
        parse_tolerance(text)


def test_a_tolerance_out_of_range_is_refused_before_work(paper_plan, tmp_path):
    with pytest.raises(SpecError, match="--tolerance"):
        run_study(paper_plan, tmp_path / "out", ("allocation",), tolerance=2.0)
    assert not (tmp_path / "out").exists()


# Ladders


@pytest.mark.parametrize("name", list(LADDERS))
def test_every_rung_pickles_and_every_ladder_can_show_convergence(name, paper_spec, paper_plan, tmp_path):
    for found in LADDERS[name](Scene(paper_plan, tmp_path)):
        assert found.name == name
        line = [rung for rung in found.rungs if rung.series == found.reference]
        assert len(line) >= 3
        assert found.theory.keys() <= {rung.series for rung in found.rungs}
        labels = [(rung.model, rung.resolution) for rung in found.rungs]
        assert len(set(labels)) == len(labels)
        for rung in found.rungs:
            assert pickle.loads(pickle.dumps(rung)).resolution == rung.resolution


def test_of_many_taxels_a_few_are_studied(paper_plan):
    one = paper_plan.channels[0]
    beams = [replace(one.beam, width_mm=1 + k / 10) for k in range(9)]
    many = replace(paper_plan, channels=tuple(replace(one, index=k, beam=b) for k, b in enumerate(beams)))
    assert len(distinct_channels(many)) == 9
    chosen = chosen_channels(many)
    assert len(chosen) == MOST_SUBJECTS
    assert (chosen[0].index, chosen[-1].index) == (0, 8)
    twins = replace(paper_plan, channels=(one, replace(one, index=1)))
    assert [c.index for c in distinct_channels(twins)] == [0]


def test_mesh_volumes_converge_to_the_solids(small_plan):
    from padgen.ladders.stages import exact_volumes, mesh_volumes, taxel_solids

    solids = taxel_solids(small_plan)
    exact = exact_volumes(1e-9, solids).values
    errors = [np.abs(mesh_volumes(h, 0.3 * (h / 0.01) ** 0.5, solids).values / exact - 1).max() for h in (0.01, 0.001)]
    # A segment's height halves its area's share with the chord; edges that are cut evenly blur the order.
    assert np.log10(errors[0] / errors[1]) == pytest.approx(1, abs=0.25)
    box = sum(float(solid.volume) for solid in solids)
    # The kernel's own volume, to the six digits that it integrates with by default.
    assert exact.sum() == pytest.approx(box, rel=1e-6)


# Extreme cases


def test_verdicts(tmp_path):
    study = run_extreme(tmp_path / "out", sets=OWN_CASES)
    found = {verdict.case: verdict for verdict in study.verdicts}
    assert [v.verdict for v in study.verdicts] == ["right", "refused", "WRONG", "WRONG", "WRONG", "WRONG", "unchecked"]
    assert found["right"].error == pytest.approx(1e-3)
    assert found["refused"].note.startswith("rung: asks for more")
    assert found["wrong"].note == "10 times what it states"
    assert "SIGABRT" in found["dies"].note
    assert not study.holds
    rows = list(csv.DictReader(io.StringIO((tmp_path / "out" / "extreme.csv").read_text())))
    assert [row["verdict"] for row in rows] == [v.verdict for v in study.verdicts]
    assert "7 cases: 4 WRONG, 1 refused, 1 right, 1 unchecked" in study.text()


def test_a_case_that_does_not_end_is_wrong():
    case = named_cases(OWN_CASES)[0]
    assert verdict_of(case, limit_s=0.01).verdict == "WRONG"


def test_errors_of_extreme_cases():
    assert relative_error(np.array([1.0, 2.2]), np.array([1.0, 2.0])) == pytest.approx(0.1)
    assert isnan(relative_error(np.array([1.0]), np.array([1.0, 2.0])))
    assert isnan(relative_error(np.array([1.0]), np.array([inf])))
    assert relative_error(np.array([0.5]), np.array([0.0])) == 0.5
    assert judged_error(1e-3, 1e-3)[0] == "right"
    assert judged_error(1e-3, 0.0) == ("WRONG", "it states to be exact")
    assert judged_error(1e-3, 0.0, allowed=2e-3)[0] == "right"


@pytest.mark.soak
def test_random_specs_are_planned_or_refused_in_a_sentence():
    """A few of the list are tried; `padgen study --extreme` plans hundreds and solves some by finite elements."""
    tables = [random_table(number) for number in range(6, 12)]
    assert tables == [random_table(number) for number in range(6, 12)]
    assert [fault_of(table) for table in tables] == [""] * 6
    odd = [set(table) - {"name", *random_table(0, 0)} for table in tables]
    assert len(set.union(*odd)) > 3


def test_a_wrong_plan_of_a_random_spec_is_found(monkeypatch):
    from padgen.ladders import extreme

    table = {"name": "a", "resolution": 2, "band_hz": [50, 200], "q_min": 15}
    plan = extreme.plan_for(extreme.make_spec(table))
    lost = replace(plan, channels=(replace(plan.channels[0], sag_um=nan), *plan.channels[1:]))
    monkeypatch.setattr(extreme, "plan_for", lambda spec: lost)
    assert fault_of(table) == "channels[0].sag_um is no number"

    def breaks(spec):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(extreme, "plan_for", breaks)
    assert fault_of(table) == "ZeroDivisionError: by nothing"
    with pytest.raises(ValueError, match="are wrong: random "):
        next(spec_cases()).solve()


@pytest.mark.soak
def test_statics_that_no_pad_survives_are_refused():
    cases = [case for case in spec_cases() if "impossible" in repr(case.solve.args[:1])]
    assert len(cases) == 4
    for case in cases:
        with suppress(PadgenError):
            assert case.solve().values == case.reference()


def solved(name: str):
    """Return the finite-element answer to a case of `solid_cases`, in a process of its own."""
    return next(case for case in solid_cases() if case.name == name).solve()


@pytest.mark.soak
def test_elements_know_their_error():
    """One case of the list; `padgen study --extreme` runs all, and solves the references anew.

    138.80316 Hz is the block at 3 GPa by elements of order 4 in three layers (`extreme.solid_answer`, NGSolve 6.2.2608,
    not extrapolated: good to 1e-3); resonances go with the root of the moduli.
    """
    answer = value_from_process(solved, "modulus 1e+12 Pa, steel in proportion")
    truth = 138.80316391 * sqrt(1e12 / 3e9)
    assert relative_error(answer.values, np.array([truth])) <= answer.stated_error + 1e-3 < 5e-3


@pytest.mark.parametrize("case", list(selectivity_cases()), ids=lambda case: f"{case.name} {case.model}")
def test_selectivity_keeps_its_digits(case):
    answer = case.solve()
    error = relative_error(answer.values, case.reference())
    # The stated bound is of rounding, not of a method: it must not hide more than a few digits.
    assert error <= answer.stated_error < 1e-14
