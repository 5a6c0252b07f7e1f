"""Plans tuned to the finite-element resonances of their own printed solids."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from math import log

import numpy as np
import psutil
import pytest

from padgen import cli
from padgen.core import cache
from padgen.core.errors import EngineMissingError, SolverError
from padgen.core.runner import Runner
from padgen.make import planning
from padgen.make import solid_tuning as loop
from padgen.physics.resonator import TaxelModes
from padgen.planner import make_plan, plan_from_json, plan_to_json
from padgen.spec import load_spec, parse_spec

SPEC = 'name = "a"\nresolution = 2\nband_hz = [50, 200]\nq_min = 15\nresonances_hz = [80, 120]\n'
WHOLE = "[pad]\nwidth_mm = 25\ndepth_mm = 25\n[coil]\ngrid = [1, 1]\n"
SOLVED = 2e-3
"""Accuracy asked of the solver; the loop ends within half of it, or at a step of the printer."""


def in_a_process(work, *arguments):
    """Run `work` in a process of its own, since the finite-element engine and the CAD kernel cannot share one."""
    with Runner() as runner:
        return runner.run(work, *arguments).value


@pytest.fixture(scope="module")
def solved():
    spec = parse_spec('model = "solid"\n' + SPEC + WHOLE)
    return spec, loop.plan_tuned_to_solid(spec)


def test_the_printed_solid_resonates_where_it_was_planned(solved):
    _, plan = solved
    for channel in plan.channels:
        assert channel.model == "solid"
        assert channel.resonance_hz == pytest.approx(channel.target_hz, rel=SOLVED / 2)
        assert 0 < channel.model_error <= SOLVED


@pytest.mark.soak
def test_a_finer_solve_of_the_exported_file_agrees(solved, tmp_path):
    """Order 3 on elements of half the size agrees with the loop's within the sum of both stated errors."""
    _, plan = solved
    from padgen.solid.formats.step import write_taxel_step

    channel = plan.channels[0]
    path = tmp_path / "0.step"
    write_taxel_step(plan, channel, path)
    found = in_a_process(loop.solve_step, loop.solid_taxel(plan, channel, path), SOLVED, 1)
    assert found.setting == 1
    assert found.error < channel.model_error
    assert channel.resonance_hz == pytest.approx(found.resonance_hz, rel=channel.model_error + found.error)


def test_the_beam_models_error_is_told(solved):
    spec, plan = solved
    beams = make_plan(spec)
    for solid, beam in zip(plan.channels, beams.channels, strict=True):
        assert beam.beam_error is None
        assert abs(solid.beam_error) < 0.03
        # The width was tuned against just this error: f goes with the root of the width, at least.
        assert (solid.beam.width_mm < beam.beam.width_mm) == (solid.beam_error < 0)
        assert solid.beam.thickness_mm == beam.beam.thickness_mm


def test_a_plan_from_solids_survives_the_round_trip(solved):
    _, plan = solved
    assert plan_to_json(plan_from_json(plan_to_json(plan))) == plan_to_json(plan)


def test_what_is_known_loads_neither_kernel_nor_engine(solved, tmp_path):
    path = tmp_path / "spec.toml"
    path.write_text('model = "solid"\n' + SPEC + WHOLE)
    code = (
        "import sys\nfrom padgen.cli import run\n"
        f"assert run(['plan', {str(path)!r}, '-o', {str(tmp_path)!r}]) in (0, 1)\n"
        "heavy = {'build123d', 'OCP', 'ngsolve', 'netgen', 'trimesh'}\n"
        "print(sorted({m.partition('.')[0] for m in sys.modules} & heavy))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("[]")
    again = json.loads((tmp_path / "plan.json").read_text())
    assert [c["resonance_hz"] for c in again["channels"]] == pytest.approx(
        [c.resonance_hz for c in solved[1].channels], rel=1e-9
    )


def test_the_key_holds_all_that_the_modes_depend_on(solved):
    spec, plan = solved
    solver = loop.TaxelSolver(SOLVED, lambda step: None)
    first, second = (cache.key_of(solver._inputs(plan, channel, 0)) for channel in plan.channels)
    assert first != second
    assert cache.key_of(solver._inputs(plan, plan.channels[0], 1)) != first
    for change in ("[material]\nyoungs_modulus_gpa = 2.9", "[taxel]\nglue_mg = 1", "[washer]\ndensity_g_per_cm3 = 7.8"):
        other = loop.finish(loop.choose(spec)._replace(spec=parse_spec(SPEC + WHOLE + change)))
        assert cache.key_of(solver._inputs(other, plan.channels[0], 0)) != first


def test_what_another_process_solved_meanwhile_is_not_solved_again(solved, monkeypatch, tmp_path):
    _, plan = solved
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "empty"))
    others = loop.SolvedTaxel(TaxelModes(np.full(6, 80.0), np.ones((6, 6)), np.eye(6)), 1e-4)
    asked = []

    @contextmanager
    def waited(kind, keys):
        """Wait until another process has solved the first taxel."""
        first, *_ = sorted(keys)
        cache.store(kind, first, loop._to_plain(others))
        yield

    def computed(self, plan, tasks):
        asked.extend(tasks)
        return [loop.SolvedTaxel(TaxelModes(np.full(6, 120.0), np.ones((6, 6)), np.eye(6)), 1e-4)] * len(tasks)

    monkeypatch.setattr(cache, "claimed", waited)
    monkeypatch.setattr(loop.TaxelSolver, "_computed", computed)
    with loop.TaxelSolver(SOLVED, lambda step: None) as solver:
        found = solver.solve(plan, [0, 0])
    assert len(asked) == len(plan.channels) - 1
    assert sorted(float(one.modes.frequency_hz[0]) for one in found) == [80.0, 120.0]


def test_coarse_steps_end_at_the_nearest_beam():
    """A resin printer's pixels are coarser than the miss: the plan keeps its beams and takes the solids' resonances."""
    spec = load_spec("resin-fine")
    trial_hz = 64.0
    goal_hz = 62.4
    sized = loop.choose(spec).channels[0]
    tried = [loop.Trial(sized, None, log(goal_hz / trial_hz))]
    assert loop._next_trial(spec, loop.choose(spec), tried, 5e-4) is sized


def test_the_secant_takes_its_slope_from_the_last_two_trials():
    spec = load_spec("paper-32")
    sized = loop.choose(spec).channels[0]
    wider = replace(sized, beam=sized.beam._replace(width_mm=sized.beam.width_mm * 1.1))
    first = loop.Trial(sized, None, 0.05)
    # A tenth more of width moved ln f by 0.06: f goes as w^0.63.
    assert loop._slope(spec, [first, loop.Trial(wider, None, -0.01)]) == pytest.approx(0.06 / log(1.1))
    assert loop._slope(spec, [first, loop.Trial(wider, None, 0.0499)]) == loop.FLATTEST


def test_the_first_slope_is_the_beam_models():
    """Over 4 % of width, by the model itself; it is near the paper's f ∝ w^½. The chord of 1 % is within 2 % of it."""
    spec = load_spec("paper-32")
    sized = loop.choose(spec).channels[0]
    plate = loop.plate_shape(spec)
    narrow, wide = (
        type(sized.model)(spec, sized.topology, plate, sized.beam._replace(width_mm=sized.beam.width_mm * share))
        for share in (0.98, 1.02)
    )
    expected = log(float(wide.resonance_hz / narrow.resonance_hz)) / log(1.02 / 0.98)
    found = loop._slope(spec, [loop.Trial(sized, None, 0.05)])
    assert found == pytest.approx(expected, rel=0.02)
    assert found == pytest.approx(0.5, abs=0.1)
    assert found != 0.5


@pytest.mark.soak
def test_steps_tell_the_share_that_is_solved(monkeypatch, tmp_path):
    """With two taxels the bar stands at nothing, then at a half."""
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "empty"))
    monkeypatch.setattr(loop, "solve_step", _found)
    told = []
    loop.plan_tuned_to_solid(parse_spec('model = "solid"\n' + SPEC + WHOLE), told.append)
    shares = [step.share for step in told if step == "solving 2 taxels by finite elements"]
    assert shares[:2] == [0.0, 0.5]


def _found(taxel, tolerance, setting):
    return loop.SolvedTaxel(TaxelModes(np.arange(80.0, 86.0), np.eye(6), np.eye(6)), 1e-3)


def planned_with(monkeypatch, error):
    """Plan with a solver that states `error`, solves every taxel to 80 Hz from setting 2 on, and notes its calls."""

    def solve(self, plan, asked):
        settings.append(asked)
        return [loop.SolvedTaxel(TaxelModes(np.arange(80.0, 86.0), np.eye(6), np.eye(6)), error, 2) for _ in asked]

    settings = []
    monkeypatch.setattr(loop.TaxelSolver, "solve", solve)
    plan = loop.plan_tuned_to_solid(parse_spec('model = "solid"\n' + SPEC + WHOLE))
    return plan, settings


def test_a_solid_that_is_not_known_well_enough_is_said_not_to_be_tuned(monkeypatch):
    plan, _ = planned_with(monkeypatch, 3e-3)
    assert {c.model for c in plan.channels} == {"solid"}
    (doubt,) = [f for f in plan.findings if f.code == "model.error"]
    assert doubt.where == "channels 0, 1"
    assert "by 0.30% of its resonance (allowed: 0.20%): it is not tuned" in doubt.message
    plan, _ = planned_with(monkeypatch, 1.9e-3)
    assert "model.error" not in {f.code for f in plan.findings}


def test_a_solid_less_sure_than_the_beam_leaves_the_beams_figures(monkeypatch):
    plan, _ = planned_with(monkeypatch, 0.02)
    beams = make_plan(parse_spec(SPEC + WHOLE))
    assert [c.model for c in plan.channels] == ["beam", "beam"]
    assert [(c.resonance_hz, c.beam, c.model_error) for c in plan.channels] == [
        (c.resonance_hz, c.beam, c.model_error) for c in beams.channels
    ]
    (doubt,) = [f.message for f in plan.findings if f.code == "model.error"]
    worst_error = max(c.model_error for c in plan.channels)
    assert f"may be off by {worst_error:.2%} of its resonance, since finite elements" in doubt


def test_what_sufficed_for_the_last_width_is_tried_first(monkeypatch):
    _, settings = planned_with(monkeypatch, 1e-3)
    assert settings[0] == [0, 0]
    assert settings[1:] == [[2, 2]] * (len(settings) - 1) != []


@pytest.mark.soak
def test_a_folded_resin_taxel_is_known_to_its_stated_error(monkeypatch, tmp_path):
    """Order 2 is 6 % off on the usual mesh for this taxel, so that nothing can be extrapolated from it.

    The reference is docs/measure_loop.py's: order 4 on a mesh of a third of the size with three layers, good to
    0.05 %. The beam stays, as the printer's pixels are coarser than the miss.
    """
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "empty"))
    text = (
        'name = "a"\nresolution = 1\nband_hz = [50, 400]\nq_min = 15\nmodel = "solid"\nprinter = "resin-0.05"\n'
        '[pad]\nwidth_mm = 12\ndepth_mm = 12\n[coil]\ngrid = [1, 1]\n[suspension]\ntopology = "folded"\n'
    )
    (channel,) = planning.plan_for(parse_spec(text)).channels
    assert channel.model == "solid"
    assert channel.model_error <= SOLVED
    assert channel.resonance_hz == pytest.approx(143.62, rel=SOLVED)


def test_a_missing_engine_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "empty"))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(EngineMissingError, match=r"padgen\[study\]"):
        loop.plan_tuned_to_solid(parse_spec(SPEC + WHOLE))
    assert cli.run(["plan", "paper-32", "--model", "solid", "-o", str(tmp_path / "out")]) == 2
    assert "padgen[study]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_auto_without_the_engine_stays_with_the_beam_and_says_so(monkeypatch, tmp_path):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "empty"))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    plan = planning.plan_for(parse_spec(SPEC + WHOLE), 1e-4)
    assert {c.model for c in plan.channels} == {"beam"}
    assert "model.error" in {f.code for f in plan.findings}


def test_auto_takes_the_beam_where_it_is_good_enough(monkeypatch):
    monkeypatch.setattr(loop, "plan_tuned_to_solid", lambda *_: pytest.fail("not needed"))
    plan = planning.plan_for(parse_spec(SPEC + WHOLE), 0.5)
    assert {c.model for c in plan.channels} == {"beam"}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--model", "rule"], "model.structure: there is no choice 'rule'"),
        (["--tolerance", "lots"], "--tolerance: must be a relative error such as 1% or 0.01, got 'lots'"),
        (["--tolerance", "0"], "--tolerance: must be above 0"),
        (["--tolerance", "60%"], "model.tolerance: must be at least 0.0001"),
        (["--tolerance", "nan"], "--tolerance: must be above 0"),
    ],
)
def test_bad_options_are_one_sentence(arguments, sentence, tmp_path, capsys):
    assert cli.run(["plan", "paper-32", *arguments, "-o", str(tmp_path / "out")]) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "entry",
    [
        None,
        [],
        {"frequency_hz": [56.0]},
        {"frequency_hz": [1, 2], "motion": [[1]], "rest": None, "error": 0.1},
        {"frequency_hz": [1.0] * 6, "motion": [[1.0] * 6] * 6, "rest": [[float("nan")] * 6] * 6, "error": 0.1},
        {"frequency_hz": [1.0] * 6, "motion": [[1.0] * 6] * 6, "rest": [[1.0] * 6] * 6, "error": 0.1},
    ],
)
def test_a_damaged_entry_counts_as_absent(entry):
    assert loop._from_plain(entry) is None


def test_an_entry_comes_back_as_it_was(solved):
    solver = loop.TaxelSolver(SOLVED, lambda step: None)
    found = loop.SolvedTaxel(TaxelModes(np.arange(1.0, 7.0), np.eye(6), np.ones((6, 6))), 1e-3, 2)
    again = loop._from_plain(json.loads(json.dumps(loop._to_plain(found))))
    assert all(np.array_equal(a, b) for a, b in zip(again.modes, found.modes, strict=True))
    assert (again.error, again.setting) == (found.error, found.setting)
    assert solver._runner is None


def test_a_refusal_leaves_no_process_and_auto_its_beam_plan(monkeypatch, tmp_path):
    """No setting reaches the tolerance: the solver refuses, and ``auto`` keeps the beam model's plan."""
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "empty"))
    monkeypatch.setattr(loop, "solve_step", _refuse)
    spec = parse_spec(SPEC + WHOLE)
    before = psutil.Process().children(recursive=True)
    with pytest.raises(SolverError, match="channel 0: no answer"):
        loop.plan_tuned_to_solid(spec)
    assert psutil.Process().children(recursive=True) == before
    plan = planning.plan_for(parse_spec(SPEC + WHOLE), 1e-4)
    assert {c.model for c in plan.channels} == {"beam"}


def _refuse(taxel, tolerance, setting):
    """Refuse the first channel's taxel while the other's is still being solved."""
    if taxel.step.name != "taxel-0.step":
        time.sleep(60)
    raise SolverError("no answer")


@pytest.mark.parametrize("way", ["dies", "misses"])
def test_a_solver_that_breaks_down_is_one_sentence(monkeypatch, tmp_path, way):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "empty"))
    monkeypatch.setattr(loop, "solve_step", _dies if way == "dies" else _misses)
    kind, sentence = {
        "dies": (SolverError, r"channel 0: the finite elements have no answer: its process was killed \(signal 9\)"),
        "misses": (EngineMissingError, r"model: needs the package x"),
    }[way]
    with pytest.raises(kind, match=sentence) as error:
        loop.plan_tuned_to_solid(parse_spec(SPEC + WHOLE))
    assert error.type is kind


def _dies(taxel, tolerance, setting):
    os.kill(os.getpid(), signal.SIGKILL)


def _misses(taxel, tolerance, setting):
    raise EngineMissingError("needs the package x", "model")
