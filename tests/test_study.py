"""`padgen study`: errors against the finest converged rung, in processes of their own, and whole files."""

import csv
import io
import json
import os
import pickle
import subprocess
import sys
import time
from dataclasses import replace
from functools import lru_cache, partial
from math import inf, isnan, nan

import numpy as np
import pytest

import padgen as pg
from padgen.cli import run
from padgen.core.display import plot_bytes, seconds_text
from padgen.core.errors import SolverError, SpecError, percent
from padgen.ladders.stages import (
    LADDERS,
    MOST_SUBJECTS,
    Ladder,
    Rung,
    Scene,
    chosen_channels,
    distinct_channels,
)
from padgen.ladders.study import (
    NOT_RUN,
    STUDY_FILES,
    TOLERANCES,
    Measured,
    Study,
    judged,
    measured,
    parse_only,
    picks,
    recommended_for,
    run_ladders,
    run_study,
    run_timed,
    study_csv,
    study_json,
    study_text,
)
from padgen.make.planning import parse_tolerance
from tests.study_work import (
    EXACT,
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


def known(values, seconds=1.0, **more) -> Measured:
    return Measured(np.atleast_1d(np.asarray(values, float)), seconds=seconds, runs=1, memory_mb=1.0, **more)


def quickest(result, tolerance):
    """Return the index of the row recommended for a tolerance, None without one."""
    return next((i for i, held in enumerate(recommended_for(result, picks([result], [tolerance]))) if held), None)


def of_order(order, steps, constant=0.1) -> list[Measured]:
    return [known(EXACT * (1 + constant * h**order), seconds=1 / h) for h in steps]


def rungs_of(steps, series="fine") -> list[Rung]:
    return [Rung("model", f"h = {h}", partial(power_law, 2, h), series) for h in steps]


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


def test_not_converged_is_said_and_nothing_is_recommended_below():
    values = (1.0, 1.02, 1.0, 1.03)
    result = judged(ladder(rungs_of((1, 0.5, 0.25, 0.125))), [known(v) for v in values])
    assert not result.converged
    assert "not shown to be converged" in result.why
    # Twice the larger of the last two changes, 0.03/1.03.
    assert result.uncertainty == pytest.approx(2 * 0.03 / 1.03)
    assert quickest(result, 0.05) is None
    assert quickest(result, 0.1) is not None


@pytest.mark.parametrize("count", [0, 1, 2])
def test_two_refinements_are_asked_for(count):
    found = [known(1.0)] * count + [Measured(note="refused: no engine")] * (3 - count)
    result = judged(ladder(rungs_of((1, 0.5, 0.25))), found)
    assert result.uncertainty == inf
    assert not result.converged
    assert "refused: no engine" in result.why or count == 0
    assert all(quickest(result, tol) is None for tol in TOLERANCES)
    assert (result.reference is None) == (count == 0)


def test_the_quickest_rung_that_holds_is_recommended():
    errors = (0.2, 0.05, 0.004, 3e-6, 2e-6, 1e-6)
    seconds = (1, 5, 3, 20, 30, 40)
    rungs = [Rung("m", str(k), nothing, "fine" if k > 2 else "") for k in range(6, 12)]
    result = judged(ladder(rungs), [known(1 + e, s) for e, s in zip(errors, seconds, strict=True)])
    assert [quickest(result, tol) for tol in (0.5, 0.1, 0.01, 0.001)] == [0, 2, 2, 3]


def test_what_is_only_measured_against_is_not_recommended():
    rungs = [Rung("slow", "", nothing), *(replace(rung, offered=False) for rung in rungs_of((1, 0.5, 0.25)))]
    result = judged(ladder(rungs), [known(1.001, 100.0), *[known(1.0, 1.0)] * 3])
    assert quickest(result, 0.01) == 0
    assert picks([result], (0.01,))[0].model == "slow"
    assert quickest(result, 1e-4) is None


def test_an_error_that_cannot_be_told_from_the_references_own_is_a_bound():
    values = (1.5, 1.004, 1.0, 1.001)
    result = judged(ladder(rungs_of((1, 0.5, 0.25, 0.125))), [known(v) for v in values])
    assert [row.is_bound for row in result.rows] == [False, False, True, True]
    assert "≤" in study_text(_study(result)).splitlines()[7]


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
    (none,) = picks([one, judged(ladder(rungs), [Measured()] * 5)], (0.01,))
    assert none.model == ""


# Processes


def test_what_is_modelled_before_a_ladder_may_be_refused():
    with pytest.raises(SolverError, match="rung: asks for more"):
        run_ladders([ladder(rungs_of((1,)), before=refuses)])
    with pytest.raises(SolverError, match="SIGABRT"):
        run_ladders([ladder(rungs_of((1,)), before=os.abort)])


def test_a_rung_runs_in_a_process_of_its_own():
    found = measured(Rung("m", "", in_own_process))
    assert found.values[0] != os.getpid()
    assert found.runs > 1
    assert 0 <= found.seconds < 1


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
    prepare, work = partial(noted, tmp_path / "prepared"), partial(noted_beside, tmp_path / "worked")
    runs = run_timed(pickle.dumps((prepare, work)))[3]
    assert (tmp_path / "prepared").read_text() == "x"
    assert (tmp_path / "worked").read_text() == "x" * runs and runs > 1


def test_caches_of_models_are_emptied_between_runs(monkeypatch):
    from padgen.ladders import study
    from padgen.physics import magnetics
    from padgen.verify import Engine

    cached = lru_cache(maxsize=None)(lambda: object())
    monkeypatch.setattr(magnetics, "a_cache", cached, raising=False)
    monkeypatch.setattr(magnetics, "not_to_be_loaded", Engine("no_such_package"), raising=False)
    cached()
    study._run(pickle.dumps((None, int)), ())
    assert cached.cache_info().currsize == 0


# Files


def _study(*results):
    return Study("test", results, picks(results), TOLERANCES, {"name": "test"})


@pytest.fixture
def result():
    rungs = [Rung("crude", "", nothing), Rung("gone", "", nothing), *rungs_of((1, 0.5, 0.25, 0.125))]
    found = [known(EXACT * 1.3, 1e-4), Measured(note="refused: it is gone"), *of_order(2, (1, 0.5, 0.25, 0.125))]
    return judged(ladder(rungs), found)


def test_csv_has_a_row_per_rung(result):
    rows = list(csv.DictReader(io.StringIO(study_csv(_study(result)))))
    assert [row["model"] for row in rows] == ["crude", "gone", *["model"] * 4]
    # The reference is 0.00156 above the truth, and known to that and 0.0047: too little for 0.001.
    assert float(rows[0]["error"]) == pytest.approx(1.3 / 1.0015625 - 1)
    assert rows[1]["error"] == rows[1]["seconds"] == ""
    assert rows[1]["note"] == "refused: it is gone"
    assert [row["recommended_for"] for row in rows] == ["", "", "", "0.1", "0.01", ""]


def test_json_has_what_was_measured_and_what_is_recommended(result):
    told = json.loads(study_json(_study(result)))
    assert told["name"] == "test"
    (ladder,) = told["ladders"]
    assert [rung["note"] for rung in ladder["rungs"]] == ["", "refused: it is gone", "", "", "", ""]
    assert ladder["rungs"][1]["values"] is None and ladder["reference"] == 5
    for pick, again in zip(picks([result]), told["recommended"], strict=True):
        assert again["resolution"] == pick.resolution
        # JSON keeps ten digits, and no number that is not finite.
        assert (again["at_most"] or inf) == pytest.approx(pick.at_most, rel=1e-9)


def test_the_same_figures_draw_the_same_bytes(result):
    one, two = (plot_bytes(_study(result).plot(), "svg") for _ in range(2))
    assert one == two and b"dc:date" not in one


def test_a_ladder_without_reference_is_drawn_and_told(result):
    bare = judged(result.ladder, [Measured(note="refused: no engine")] * 6)
    assert plot_bytes(_study(bare).plot(), "svg")
    assert "there is no reference" in study_text(_study(bare))


def test_the_table_tells_refusals(result):
    text = study_text(_study(result))
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
    assert study_text(study).count("allocation") >= 5


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
    text = study_text(study)
    assert "not run: 4 of 6 rungs of allocation, " in text and "not run: 8 of 8 rungs of geometry, " in text
    assert "\ngeometry," not in text


def test_interrupted_before_anything_it_leaves_nothing(paper_plan, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run_study(paper_plan, tmp_path / "out", ("allocation",), progress=interrupted_at("rung 1"))
    assert not (tmp_path / "out").exists()


def test_the_command_stops_in_time_and_logs_its_rungs(tmp_path):
    command = [sys.executable, "-m", "padgen", "study", "paper-pair", "--only", "dynamics", "-o", str(tmp_path)]
    ended = subprocess.run([*command, "--time-limit", "3"], capture_output=True, text=True, timeout=120)
    log = ended.stderr.splitlines()
    if (tmp_path / "study.json").exists():  # else not even the first rung was done in time
        assert any(line.startswith("rung 1 of ") for line in log)
        told = json.loads((tmp_path / "study.json").read_text())
        assert (ended.returncode, told["stopped"]) in ((2, True), (0, False))
        assert not told["stopped"] or log[-1].startswith("padgen: stopped: ")
        assert "best of 2 to 7 runs" in told["times"] and told["times"] in " ".join(ended.stdout.split())
    else:
        assert log[-1].startswith("padgen: interrupted")


@pytest.mark.parametrize("limit", ["0", "-1", "nan", "inf"])
def test_a_time_limit_that_is_none(limit, capsys):
    assert run(["study", "paper-pair", "--time-limit", limit]) == 2
    assert "--time-limit: must be above 0" in capsys.readouterr().err


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
