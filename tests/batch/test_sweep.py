"""Sweeps: their axes, the variants that these make, and the results that are kept.

| what | must equal | tolerance |
|---|---|---|
| a grid | all combinations, in order | exact |
| Latin hypercube | one point in each of `count` equal strata of every axis | exact |
| Sobol | four points in each quarter of both axes out of 16 | exact |
| index.csv | the same on 1 and 3 workers, but for its last two columns | exact |
| memory of the parent | the same after 2,000 and 10,000 variants | 3 MB, what an allocator keeps |
"""

import csv
import io
import json
import os
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from padgen.batch.definition import count_points, load_sweep, parse_expression, parse_sweep, variant_table, variants
from padgen.batch.sweep import Event, run_sweep
from padgen.batch.variant import plan_figures, run_task
from padgen.core.errors import FileError, SpecError
from padgen.core.files import OutputFolder
from padgen.core.runner import memory_mb
from padgen.spec import catalogue
from tests import sweep_work
from tests.sweep_work import Inline

HEAD = 'name = "s"\nbase = "paper-32"\n'
NO_FOLDERS = HEAD + "folders = false\n"
GRID = "[axes]\nq_min = {low = 10, high = 20, steps = 3}\n"
SOBOL = '[sample]\nmethod = "sobol"\ncount = 16\n'


def values(text: str, head: str = HEAD) -> list[dict]:
    return [variant.values for variant in variants(parse_sweep(head + text))]


def rows(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO((folder / "index.csv").read_text())))


def counting(tmp_path, monkeypatch):
    monkeypatch.setenv(sweep_work.PLACE, str(tmp_path))
    return lambda: Counter((tmp_path / "ran").read_text().split()) if (tmp_path / "ran").exists() else Counter()


# What is varied


def test_a_grid_is_all_combinations_in_order():
    found = values('[axes]\nq_min = {low = 10, high = 20, steps = 3}\nmaterial = ["pla", "petg"]\n')
    assert [tuple(v.values()) for v in found] == [(q, m) for q in (10, 15, 20) for m in ("pla", "petg")]


def test_linked_fields_move_together():
    found = values("[[linked]]\npad.width_mm = [50, 60]\npad.depth_mm = [50, 70]\n[axes]\nq_min = [10, 12]\n")
    assert [(v["pad.width_mm"], v["pad.depth_mm"]) for v in found] == [(50, 50), (60, 70)] * 2


def test_a_log_range_has_equal_ratios():
    found = [v["q_min"] for v in values('[axes]\nq_min = {low = 1, high = 100, steps = 5, scale = "log"}\n')]
    assert found == pytest.approx([1, 10**0.5, 10, 10**1.5, 100], rel=1e-11)  # written with 12 digits
    assert found[-1] == 100


def test_a_range_of_whole_numbers_has_each_once():
    found = [v["resolution"] for v in values("[axes]\nresolution = {low = 8, high = 10, steps = 9}\n")]
    assert found == [8, 9, 10] and all(isinstance(v, int) for v in found)


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol"])
def test_whole_numbers_of_a_sample_are_equally_many(method):
    text = f'[axes]\nresolution = {{low = 1, high = 4}}\n[sample]\nmethod = "{method}"\ncount = 64\n'
    assert Counter(v["resolution"] for v in values(text)) == dict.fromkeys((1, 2, 3, 4), 16)


def test_latin_hypercube_has_one_point_a_stratum():
    text = "[axes]\nq_min = {low = 10, high = 20}\ndelta_y = {low = 5, high = 15}\n"
    found = values(text + '[sample]\nmethod = "latin-hypercube"\ncount = 50\nseed = 3\n')
    for name, low in (("q_min", 10), ("delta_y", 5)):
        assert sorted(int((v[name] - low) / 10 * 50) for v in found) == list(range(50))


def test_sobol_is_balanced():
    found = values("[axes]\nq_min = {low = 10, high = 20}\ndelta_y = {low = 5, high = 15}\n" + SOBOL)
    quarters = Counter((int((v["q_min"] - 10) / 5), int((v["delta_y"] - 5) / 5)) for v in found)
    assert len(found) == 16 and set(quarters.values()) == {4}


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol"])
def test_a_sample_follows_its_seed(method):
    text = '[axes]\nq_min = {low = 10, high = 20}\n[sample]\nmethod = "%s"\ncount = 20\nseed = %d\n'
    assert values(text % (method, 1)) == values(text % (method, 1)) != values(text % (method, 2))


def test_a_long_sobol_sample_begins_like_a_short_one():
    text = '[axes]\nq_min = {low = 10, high = 20}\n[sample]\nmethod = "sobol"\ncount = %d\n'
    assert values(text % 5000)[:7] == values(text % 7) and len(values(text % 5000)) == 5000


def test_a_sample_of_words_takes_each_as_often():
    found = values('[axes]\nmaterial = ["pla", "petg", "abs", "pa12"]\n' + SOBOL)
    assert set(Counter(v["material"] for v in found).values()) == {4}


def test_the_table_of_a_variant():
    sweep = parse_sweep(
        HEAD + '[axes]\n"coil.resistance_ohm" = [7.5]\n"material.poisson_ratio" = [0.3]\nmaterial = ["petg"]\n'
        'drive = ["tones"]\n"drive.level_um" = [12]\n'
    )
    before = json.dumps(sweep.base)
    table = variant_table(sweep, next(variants(sweep)))
    assert table["name"] == "s-00000" and table["coil"]["resistance_ohm"] == 7.5
    assert table["material"] == {"name": "petg", "poisson_ratio": 0.3}
    assert table["drive"] == {"scheme": "tones", "level_um": 12}
    assert json.dumps(sweep.base) == before


# Constraints


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("q_min >= 12", [0, 1, 1]),
        ("10 < q_min <= 12", [0, 1, 0]),
        ("not q_min == 12", [1, 0, 1]),
        ("q_min < 12 or q_min * 2 - 8 ** 2 / 4 > 10", [1, 0, 1]),
        ("q_min + pad.width_mm > 63 and resolution == 32", [0, 0, 1]),
        ("max(q_min, 12) == min(12, 99) and abs(-1) == round(1.2)", [1, 1, 0]),
        ("band_hz[0] == 50 and band_hz[1] // 7 % 5 == 3", [1, 1, 1]),
        ("printer == 'fdm-0.4' and material == 'pla' and drive == 'auto'", [1, 1, 1]),
    ],
)
def test_constraints(text, holds):
    found = values(f'constraints = ["{text}"]\n[axes]\nq_min = [10, 12, 14]\n')
    assert [v["q_min"] for v in found] == [q for q, ok in zip((10, 12, 14), holds, strict=True) if ok]


def test_a_constraint_on_what_is_varied_by_tables():
    axes = '[axes]\nprinter = [{name = "fdm-0.25", layer_mm = 0.1}, "fdm-0.4", {name = "fdm-0.25"}]\n'
    found = values(f"constraints = [\"printer == 'fdm-0.25'\"]\n{axes}")
    assert [v["printer"] for v in found] == [{"name": "fdm-0.25", "layer_mm": 0.1}, {"name": "fdm-0.25"}]


def test_constraints_see_what_a_varied_field_brings_along():
    """Another printer brings another default material, and that its own figures."""
    text = """constraints = ["printer.process == '%s'", "material == '%s'"]\n"""
    text += '[axes]\nprinter = ["fdm-0.4", "resin-0.05"]\n'
    assert [v["printer"] for v in values(text % ("fdm", "pla"))] == ["fdm-0.4"]
    assert [v["printer"] for v in values(text % ("resin", "tough-resin"))] == ["resin-0.05"]
    heavy = max(catalogue("material").values(), key=lambda entry: entry["density_g_per_cm3"])
    names = [heavy["name"], "pla"]
    text = f'constraints = ["material.density_g_per_cm3 >= {heavy["density_g_per_cm3"]}"]\n[axes]\nmaterial = {names}\n'
    assert [v["material"] for v in values(text)] == [heavy["name"]]


def test_a_variant_that_is_no_spec_is_kept_to_say_why(tmp_path):
    axes = '[axes]\nprinter = ["fdm-0.4", "resin-0.05"]\nmaterial = ["pla"]\nq_min = [10, 12]'
    text = f'constraints = ["q_min > 11"]\n{axes}'
    assert run_sweep(parse_sweep(NO_FOLDERS + text), tmp_path, Inline(run_task)).total == 2
    assert [row["status"] for row in rows(tmp_path)] == ["done", "refused"]
    assert "material" in rows(tmp_path)[1]["sentence"]


@pytest.mark.parametrize(
    ("axis", "sentence"),
    [
        (
            'printer = ["fdm-0.4", "resin-50"]',
            r"axes\.printer\[1\]: there is no printer 'resin-50'; did you mean",
        ),
        ('coil.reuse = ["all"]', r"axes\.coil\.reuse\[0\]: .*'all'"),
        ('q_min = [15, "15"]', r"axes\.q_min\[1\]: must be a number"),
        ("resolution = [0]", r"axes\.resolution\[0\]: must be at least 1"),
        ("coil.grid = [[4, 4], [4]]", r"axes\.coil\.grid\[1\]: "),
    ],
)
def test_a_value_that_a_field_never_takes_is_refused_at_once(axis, sentence):
    with pytest.raises(SpecError, match=sentence):
        parse_sweep(HEAD + f"[axes]\n{axis}\n")


def test_formats_may_be_a_list():
    assert parse_sweep(HEAD + 'formats = ["glb", "stl"]\n' + GRID).settings.formats == "glb,stl"
    with pytest.raises(SpecError, match="formats: must be among"):
        parse_sweep(HEAD + 'formats = ["no-such"]\n' + GRID)


def test_selectivity_counts_what_the_neighbours_leak(paper_plan, monkeypatch):
    figures = plan_figures(paper_plan)
    assert figures["in_coil_db"] == paper_plan.selectivity.kept_db
    assert figures["leak_db"] == paper_plan.reuse.leak_db
    assert figures["selectivity_db"] == min(figures["in_coil_db"], figures["leak_db"]) == figures["leak_db"]
    monkeypatch.setattr(type(paper_plan.selectivity), "kept_db", None)
    assert plan_figures(paper_plan)["selectivity_db"] == figures["leak_db"]
    far = replace(paper_plan, reuse=replace(paper_plan.reuse, leak_db=None))
    assert plan_figures(far)["selectivity_db"] is None


def test_constraints_do_not_rename_variants():
    sweep = parse_sweep(HEAD + 'constraints = ["q_min > 11"]\n[axes]\nq_min = [10, 12, 14]\n')
    assert [v.number for v in variants(sweep)] == [1, 2] and count_points(sweep) == 3


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("q_min >", "is no condition; an example is"),
        ("__import__('os')", "calls '__import__', known are abs, min, max, round"),
        ("abs(x=1)", "calls 'abs'"),
        ("q_min.real", "names 'q_min.real', which a spec does not have"),
        ("quality > 1", "names 'quality', which a spec does not have"),
        ("[q for q in band_hz]", "which is none of comparison"),
        ("q_min if 1 else 2", "which is none of comparison"),
        ("(lambda: 1)()", "calls"),
        ("q_min << 3", "whose operator is not known"),
        ("q_min in band_hz", "whose operator is not known"),
        ("-" * 5000 + "q_min", "write several conditions|nested too deeply"),
    ],
)
def test_what_is_no_constraint(paper_spec, text, sentence):
    with pytest.raises(SpecError, match=sentence):
        parse_expression(text, paper_spec)


@pytest.mark.parametrize("text", ["1 / (q_min - 12)", "band_hz[7]", "q_min < 'a'", "9 ** 9 ** 9 ** 9 > q_min"])
def test_constraints_that_cannot_be_worked_out(text):
    with pytest.raises(SpecError, match=r"constraint .*: cannot be worked out for \{'q_min': 12\}"):
        values(f'constraints = ["{text}"]\n[axes]\nq_min = [12]\n')


# Bad sweeps


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x", "sweep: is not TOML"),
        ('base = "paper-32"', "name: is missing"),
        ('name = "s"\nbase = "paper-33"\n' + GRID, "there is no file or template 'paper-33'; did you mean 'paper-32'"),
        ('name = "s"\nbase = "no/such.toml"\n' + GRID, "no/such.toml: there is no such file"),
        (f'name = "{"s" * 73}"\nbase = "paper-32"\n' + GRID, "name: must match"),
        (HEAD, "axes: is missing; it names the fields that are varied"),
        (HEAD + "axes = 3", "axes: must be a table"),
        (HEAD + "[linked]\nq_min = [1]", "axes: must be a table"),
        (HEAD + "linked = [3]", "linked: must be a table of fields"),
        (HEAD + "linked = [{}]", "linked: must be a table of fields"),
        (
            HEAD + "[[linked]]\nq_min = [10, 12]\ndelta_y = [10]",
            "linked.delta_y: must have 2 values as q_min has, got 1",
        ),
        (HEAD + "[[linked]]\nq_min = 10", "linked.q_min: must be a list of 1"),
        (HEAD + "[axes]\nq_mim = [1]", "axes.q_mim: there is no field 'q_mim'; did you mean 'q_min'"),
        (HEAD + "[axes]\npad.height = [1]", "axes.pad.height: there is no field"),
        (HEAD + "[axes]\nname = ['a']", "axes.name: cannot be varied"),
        (HEAD + "[axes]\nq_min = []", "axes.q_min: must be a list of 1"),
        (HEAD + "[axes]\nq_min = 12", "axes.q_min: must be a list of values or a range"),
        (
            HEAD + "[axes]\nq_min = {from = 1, to = 2}",
            "axes.q_min.from: must be a list of values or a range .* no 'from'",
        ),
        (HEAD + "[axes]\nq_min = {low = 1, high = 2, step = 3}", "axes.q_min: there is no key 'step'; known are"),
        (HEAD + "[axes]\nq_min = {low = 1, steps = 3}", "axes.q_min.high: is missing"),
        (HEAD + "[axes]\nq_min = {low = 'a', high = 2, steps = 3}", "axes.q_min.low: must be a number, got 'a'"),
        (HEAD + "[axes]\nq_min = {low = 1, high = inf, steps = 3}", "axes.q_min.high: must be at least .* got inf"),
        (HEAD + "[axes]\nq_min = {low = 1, high = nan, steps = 3}", "axes.q_min.high: must be at least .* got nan"),
        (HEAD + "[axes]\nq_min = {low = 2, high = 2, steps = 3}", "axes.q_min.high: must be above low = 2, got 2"),
        (
            HEAD + "[axes]\nq_min = {low = 1, high = 2}",
            "axes.q_min.steps: must be a whole number, 2 … 10000, as { low = 1, high = 2, steps = 5 }",
        ),
        (HEAD + "[axes]\nq_min = {low = 1, high = 2, steps = 2.5}", "axes.q_min.steps: must be a whole number"),
        (HEAD + "[axes]\nq_min = {low = 1, high = 2, steps = true}", "axes.q_min.steps: must be a whole number"),
        (HEAD + "[axes]\nq_min = {low = 1, high = 2, steps = 'x'}\n" + SOBOL, "axes.q_min.steps: must be a whole"),
        (HEAD + "[axes]\nq_min = {low = 0, high = 2, steps = 3, scale = 'log'}", "axes.q_min.low: must be above 0"),
        (
            HEAD + "[axes]\nq_min = {low = 1, high = 2, steps = 3, scale = 'lin'}",
            "axes.q_min.scale: there is no choice 'lin'",
        ),
        (HEAD + "[axes]\nmaterial = {low = 1, high = 2, steps = 3}", "axes.material: is no number, so that it has"),
        (HEAD + "[axes]\ndrive.scheme = {low = 1, high = 2, steps = 3}", "axes.drive.scheme: is no number"),
        (HEAD + "[axes]\nq_min = [1979-05-27]", r"axes.q_min\[0\]: must be a number, text, .* got 1979-05-27"),
        (HEAD + "[axes]\nq_min = [10, nan]", r"axes.q_min\[1\]: must be a number"),
        (HEAD + "[axes]\nq_min = [1]\n[[linked]]\nq_min = [1]", "axes.q_min: is varied twice"),
        (
            HEAD + "[vary]\nq_min = [1, 2]",
            "sweep: there is no key 'vary'; known are axes, base, constraints, folders, formats, limits, linked, name,"
            " pads, sample, stage$",
        ),
        (HEAD + "[axis]\nq_min = [1, 2]", "sweep: there is no key 'axis'; did you mean 'axes'?"),
        (HEAD + "stages = 1\n" + GRID, "sweep|spec: there is no key 'stages'; did you mean 'stage'"),
        (HEAD + "stage = 'bild'\n" + GRID, "stage: there is no choice 'bild'; known are .*; did you mean 'build'"),
        (HEAD + "formats = 'stl,no-such'\n" + GRID, "formats: must be among 3mf, .*stl.*, got 'no-such'"),
        (HEAD + "constraints = 'q_min > 1'\n" + GRID, "constraints: must be a list of conditions as text"),
        (HEAD + "constraints = ['quality > 1']\n" + GRID, "constraint 'quality > 1': names 'quality'"),
        (HEAD + GRID + "[sample]\nmethod = 'sobol'", "sample.count: must be at least 1 for method 'sobol'"),
        (HEAD + GRID + "[sample]\nmethod = 'latin-hypercube'\ncount = 100001", "sample.count: must be at most 100000"),
        (HEAD + GRID + "[sample]\ncount = 7", "sample.count: needs a method: latin-hypercube or sobol"),
        (HEAD + "[axes]\nresolution = {low = 16.2, high = 16.8, steps = 2}", "axes.resolution: holds no whole number"),
        (HEAD + "[axes]\nq_min = [15]\npad = {}", "axes.pad: is empty"),
        (HEAD + "x = 1" + "0" * 5000, "is not TOML"),
        (HEAD + "[axes]\nresolution = " + "[" * 400 + "]" * 400, "nested too deeply|must be"),
        (HEAD + "[axes." + "a." * 3000 + "a]\nx = [1]", "nested too deeply|there is no"),
        (HEAD + GRID + "[sample]\nseed = -1", "sample.seed: must be at least 0"),
        (HEAD + "sample = 3\n" + GRID, "sample: must be a table"),
        (HEAD + GRID + "[limits]\ntime_s = 0", "limits.time_s: must be at least 0.1"),
        (HEAD + GRID + "[limits]\nmemory = 3", "there is no key 'memory'; known are memory_mb, time_s; did"),
        (HEAD + GRID + "x = " + "[" * 20000, "nested too deeply|is not TOML"),
    ],
)
def test_bad_sweeps_are_refused_with_a_sentence(text, sentence):
    with pytest.raises((SpecError, FileError), match=sentence):
        parse_sweep(text)


def test_too_many_combinations():
    axes = "\n".join(f"{name} = {{low = 1, high = 2, steps = 1000}}" for name in ("q_min", "delta_y", "pad.width_mm"))
    with pytest.raises(SpecError, match=r"axes: has 1000000000 combinations, at most 10000000 will do; take a sample"):
        next(variants(parse_sweep(f"{HEAD}[axes]\n{axes}")))


@pytest.mark.parametrize("content", [None, b"\xff\xfe", "folder"])
def test_sweeps_that_cannot_be_read(tmp_path, content):
    path = tmp_path / "x.toml"
    if content == "folder":
        path.mkdir()
    elif content:
        path.write_bytes(content)
    with pytest.raises(FileError, match=r"x.toml: (cannot be read|is not TOML: byte 0)"):
        load_sweep(str(path))


def test_a_base_beside_the_sweep(tmp_path):
    (tmp_path / "base.toml").write_text('name = "b"\nresolution = 32\nband_hz = [50, 200]\nq_min = 15\n')
    (tmp_path / "x.toml").write_text('name = "s"\nbase = "base.toml"\n' + GRID)
    assert load_sweep(str(tmp_path / "x.toml")).spec.name == "b"
    (tmp_path / "base.toml").write_bytes(b"\xff")
    with pytest.raises(FileError, match=r"base.toml: is not TOML: byte 0 is not UTF-8"):
        load_sweep(str(tmp_path / "x.toml"))


# What is kept


def test_the_index_does_not_depend_on_the_order(tmp_path):
    sweep = parse_sweep(NO_FOLDERS + "[axes]\nq_min = [10, 11, 12]\nband_hz = [[50, 200], [60, 210], [50, 190]]\n")
    texts = []
    for workers in (1, 3):
        folder = tmp_path / f"on-{workers}"
        result = run_sweep(sweep, folder, workers=workers, work=sweep_work.uneven)
        assert (result.done, result.total, result.index) == (9, 9, folder / "index.csv")
        lines = (folder / "index.jsonl").read_text().splitlines()
        assert sorted(json.loads(line)["number"] for line in lines) == list(range(9))
        texts.append((folder / "index.csv").read_text())
    assert [json.loads(line)["number"] for line in lines] != list(range(9)), "they did not end in another order"
    assert texts[0] == texts[1]
    found = list(csv.reader(io.StringIO(texts[0])))
    assert found[0] == [
        *("number", "name", "status", "q_min", "band_hz", "taxels", "even", "odd"),
        *("errors", "warnings", "findings", "sentence", "seconds", "peak_memory_mb"),
    ]
    assert found[2] == ["1", "s-00001", "done", "10", "[60, 210]", "2", "", "1.5", "0", "0", "", "", "0.001", "1"]


def test_real_plans(tmp_path):
    """Two variants have plans; no layout fits the other two."""
    sweep = parse_sweep(HEAD + "[axes]\nq_min = [12, 15]\nresolution = [32, 8]\n")
    events = []
    result = run_sweep(sweep, tmp_path, workers=2, on_event=events.append)
    found = rows(tmp_path)
    assert result.failed == 0 and result.done + result.refused == 4
    for row in found:
        planned = (tmp_path / row["name"] / "plan.json").exists()
        assert planned == (row["status"] == "done") == bool(row["taxels"]) == (not row["sentence"])
        assert float(row["seconds"]) > 0 and float(row["peak_memory_mb"]) > 10
    assert {row["status"] for row in found} == {"done", "refused"}
    assert (events[0].kind, events[-1].kind) == ("start", "end")
    assert sorted(e.record.number for e in events if e.record) == [0, 1, 2, 3]
    assert all(e.done + e.refused + e.failed + e.left == e.total == 4 for e in events)


def test_yields(tmp_path):
    sweep = parse_sweep(HEAD + 'stage = "yield"\npads = 50\n[axes]\nq_min = [12]\n')
    assert run_sweep(sweep, tmp_path, Inline(run_task)).done == 1
    assert 0 <= float(rows(tmp_path)[0]["good_pads_retuned"]) <= 1
    assert (tmp_path / "s-00000" / "yield.json").exists()


def test_finished_variants_are_not_run_again(tmp_path, monkeypatch):
    ran = counting(tmp_path, monkeypatch)
    out = tmp_path / "out"

    def run(axis: str, **options):
        return run_sweep(
            parse_sweep(NO_FOLDERS + f"[axes]\nq_min = {axis}\n"), out, Inline(sweep_work.counted), **options
        )

    assert run("[10, 11, 12]").kept == 0
    result = run("[10, 11, 12]")
    assert (result.kept, result.done, ran()) == (3, 3, {"0": 1, "1": 1, "2": 1})
    # A changed value runs that one, a new one that one; one that is no longer there drops out.
    result = run("[10, 13, 12, 14]")
    assert (result.kept, result.done, ran()) == (2, 4, {"0": 1, "1": 2, "2": 1, "3": 1})
    result = run("[10, 13]")
    assert (result.kept, result.total, len(rows(out))) == (2, 2, 2)
    result = run("[10, 13]", resume=False)
    assert (result.kept, result.done, ran()["0"]) == (0, 2, 2)


def test_rows_of_other_inputs_drop_out(tmp_path):
    """Rows of removed and of changed variants are dropped, also where the sweep ends before these are made."""

    def run(text: str, executor=None):
        result = run_sweep(parse_sweep(NO_FOLDERS + text), tmp_path, executor or Inline())
        return result.left, [(row["number"], row["q_min"]) for row in rows(tmp_path)]

    class Closed:
        def submit(self, *anything):
            raise RuntimeError("closed")

    assert run("[axes]\nq_min = [10, 11, 12]\n") == (0, [("0", "10"), ("1", "11"), ("2", "12")])
    assert run("constraints = ['q_min != 11']\n[axes]\nq_min = [10, 11, 12]\n") == (0, [("0", "10"), ("2", "12")])
    assert run("[axes]\nq_min = [10, 11, 13]\n", Closed()) == (1, [("0", "10"), ("1", "11")])


def test_a_changed_stage_code_or_curve_runs_again(tmp_path, monkeypatch):
    ran = counting(tmp_path, monkeypatch)
    (tmp_path / "base.toml").write_text(
        'name = "b"\nresolution = 32\nband_hz = [50, 200]\nq_min = 15\n[drive]\nthreshold_file = "curve.csv"\n'
    )

    def run(more: str = ""):
        text = f'name = "s"\nbase = "base.toml"\nfolders = false\n{more}[axes]\nq_min = [10]\n'
        run_sweep(parse_sweep(text, folder=tmp_path), tmp_path / "out", Inline(sweep_work.counted))
        return ran()["0"]

    (tmp_path / "curve.csv").write_text("50,1\n200,2\n")
    assert (run(), run()) == (1, 1)
    (tmp_path / "curve.csv").write_text("50,1\n200,3\n")
    assert (run(), run()) == (2, 2)
    assert (run("stage = 'yield'\n"), run("stage = 'yield'\npads = 20\n")) == (3, 4)
    assert run("stage = 'yield'\npads = 20\nformats = 'stl'\n") == 4
    monkeypatch.setattr("padgen.batch.variant.code_hash", lambda: "another")
    assert run("stage = 'yield'\npads = 20\n") == 5


def test_a_variant_whose_folder_is_gone_runs_again(tmp_path):
    sweep = parse_sweep(HEAD + "[axes]\nq_min = [12, 13]\n")
    run_sweep(sweep, tmp_path, Inline(run_task))
    (tmp_path / "s-00001" / "plan.json").unlink()
    (tmp_path / "s-00001" / ".partial-999999999").mkdir()
    assert run_sweep(sweep, tmp_path, Inline(run_task)).kept == 1
    assert {path.name for path in (tmp_path / "s-00001").iterdir()} == {"manifest.json", "plan.json"}


def test_what_was_replaced_is_not_kept_when_its_inputs_come_back(tmp_path):
    """A is done; B's variant writes its folder but loses its record; A then must make it anew."""
    a, b = (parse_sweep(HEAD + f"[axes]\nq_min = [{q}, 14]\n") for q in (12, 13))

    class Lost(Inline):
        def submit(self, function, tasks, *rest):
            raise RuntimeError("lost")

    assert run_sweep(a, tmp_path, Inline(run_task)).done == 2
    assert run_sweep(b, tmp_path, Lost()).left == 1
    assert [row["number"] for row in rows(tmp_path)] == ["1"]
    again = run_sweep(a, tmp_path, Inline(run_task))
    assert (again.kept, again.done) == (1, 2)


def test_whole_numbers_stay_within_their_range():
    found = values("[axes]\nresolution = {low = 16.5, high = 18.5, steps = 3}\n")
    assert [v["resolution"] for v in found] == [17, 18]


@pytest.mark.parametrize("text", ["'a' * 1000000 == 'b'", "'%9d' % q_min == 'a'", "printer + 'x' == 'y'"])
def test_a_constraint_does_no_arithmetic_on_text(text):
    sweep = parse_sweep(HEAD + f'constraints = ["{text}"]\n[axes]\nq_min = [12]\n')
    with pytest.raises(SpecError, match="arithmetic is of numbers"):
        list(variants(sweep))


@pytest.mark.parametrize("line", [{"figures": 3}, {"values": None}, {"findings": [3]}, {"sentence": 1}])
def test_a_line_of_the_journal_of_another_shape_is_passed_over(tmp_path, line):
    sweep = parse_sweep(NO_FOLDERS + "[axes]\nq_min = [10, 11]\n")
    run_sweep(sweep, tmp_path, Inline())
    first, second = (tmp_path / "index.jsonl").read_text().splitlines()
    (tmp_path / "index.jsonl").write_text(json.dumps(json.loads(first) | line) + "\n" + second + "\n" + "[" * 9999)
    assert run_sweep(sweep, tmp_path, Inline()).kept == 1
    assert len(rows(tmp_path)) == 2


def test_made_anew_the_index_keeps_what_is_still_true_until_it_is_replaced(tmp_path):
    sweep = parse_sweep(NO_FOLDERS + "[axes]\nq_min = [10, 11, 12]\n")

    class Stops(Inline):
        def submit(self, function, tasks, *rest):
            if tasks[0].number:
                raise RuntimeError("no more")
            return super().submit(function, tasks, *rest)

    run_sweep(sweep, tmp_path, Inline())
    stopped = run_sweep(sweep, tmp_path, Stops(), resume=False)
    assert (stopped.done, stopped.left) == (1, 2)
    assert [row["number"] for row in rows(tmp_path)] == ["0", "2"], "that of 1 was about to be replaced"


def test_another_plan_leaves_nothing_of_the_one_before(tmp_path):
    def made(more: str) -> set[str]:
        run_sweep(parse_sweep(HEAD + f"pads = 20\n{more}"), tmp_path, Inline(run_task))
        return {path.name for path in (tmp_path / "s-00000").iterdir()} - {"manifest.json"}

    assert made('stage = "yield"\n[axes]\nq_min = [15]') == {"plan.json", "yield.json"}
    assert made("[axes]\nq_min = [15]") == {"plan.json", "yield.json"}
    assert made("[axes]\nq_min = [16]") == {"plan.json"}


def test_folders_that_were_left_out_meanwhile_are_made_anew(tmp_path):
    """A run with folders, one of other values without, and again the first: each folder has the plan of its row."""

    def run(folders: str, resolutions: list[int]) -> list[int | None]:
        text = f"folders = {folders}\n[axes]\nresolution = {resolutions}\n"
        run_sweep(parse_sweep(HEAD + text), tmp_path, Inline(run_task))
        plans = [tmp_path / f"s-0000{k}" / "plan.json" for k in range(2)]
        return [json.loads(path.read_text())["spec"]["resolution"] if path.exists() else None for path in plans]

    assert run("true", [32, 28]) == [32, 28]
    assert run("false", [30, 26]) == [None, None]
    assert run("true", [30, 26]) == [30, 26]


@pytest.mark.parametrize(("stage", "names"), [("yield", ["yield.json"]), ("build", ["pad.stl", "manifest.json"])])
def test_a_variant_that_has_lost_a_file_runs_again(tmp_path, stage, names):
    text = f'{HEAD}stage = "{stage}"\nformats = "stl"\npads = 20\n[axes]\nq_min = [15]\n'
    run_sweep(parse_sweep(text), tmp_path, Inline(run_task))
    for name in names:
        assert run_sweep(parse_sweep(text), tmp_path, Inline(run_task)).kept == 1
        (tmp_path / "s-00000" / name).unlink()
        assert run_sweep(parse_sweep(text), tmp_path, Inline(run_task)).kept == 0
        assert (tmp_path / "s-00000" / name).exists()


def test_a_constraint_that_breaks_late_leaves_nothing(tmp_path):
    sweep = parse_sweep(HEAD + 'constraints = ["1 / (q_min - 14) < 9"]\n[axes]\nq_min = [12, 13, 14]\n')
    with pytest.raises(SpecError, match="cannot be worked out"):
        run_sweep(sweep, tmp_path / "out", Inline())
    assert not (tmp_path / "out").exists()


def test_a_refused_variant_keeps_no_older_files(tmp_path):
    with OutputFolder(tmp_path / "s-00000") as out:
        out.write("pad.stl", "")
        out.write("pad.3mf", "")
        out.commit()
    (tmp_path / "s-00000" / "mine.txt").touch()
    (tmp_path / "s-00000" / "pad.3mf").write_text("mine, too")
    run_sweep(parse_sweep(HEAD + "[axes]\nresolution = [8]\n"), tmp_path, Inline(run_task))
    assert rows(tmp_path)[0]["status"] == "refused"
    assert {path.name for path in (tmp_path / "s-00000").iterdir()} == {"mine.txt", "pad.3mf"}


def test_a_limit_of_the_cache_that_is_none_is_refused_at_once(tmp_path, monkeypatch):
    monkeypatch.setenv("PADGEN_CACHE_MB", "much")
    with pytest.raises(SpecError, match="PADGEN_CACHE_MB"):
        run_sweep(parse_sweep(HEAD + "[axes]\nq_min = [12]\n"), tmp_path / "out", Inline(run_task))
    assert not (tmp_path / "out").exists()


def test_a_users_index_makes_room_and_is_kept(tmp_path):
    (tmp_path / "index.csv").write_text("mine")
    for _ in range(2):
        run_sweep(parse_sweep(NO_FOLDERS + "[axes]\nq_min = [12]\n"), tmp_path, Inline(run_task))
    assert (tmp_path / "index.csv.old").read_text() == "mine"
    assert len(rows(tmp_path)) == 1 and not (tmp_path / "index.csv.old2").exists()


def test_a_refused_variant_keeps_no_older_plan(tmp_path):
    for resolution, there in ((32, True), (8, False)):
        run_sweep(parse_sweep(HEAD + f"[axes]\nresolution = [{resolution}]\n"), tmp_path, Inline(run_task))
        status = rows(tmp_path)[0]["status"]
        assert (tmp_path / "s-00000" / "plan.json").exists() == there == (status == "done")


def test_failed_variants_are_told_again_and_tried_with_retry(tmp_path, monkeypatch):
    ran = counting(tmp_path, monkeypatch)
    out = tmp_path / "out"
    sweep = parse_sweep(NO_FOLDERS + "[axes]\nq_min = [10, 11, 12]\n")
    (tmp_path / "broken").touch()
    assert run_sweep(sweep, out, Inline(sweep_work.failing)).failed == 1
    (tmp_path / "broken").unlink()
    events = []
    result = run_sweep(sweep, out, Inline(sweep_work.failing), on_event=events.append)
    assert (result.failed, result.kept, ran()["1"]) == (1, 3, 1)
    assert [(e.kind, e.reused, e.record and e.record.sentence) for e in events] == [
        ("start", False, None),
        ("failed", True, "it is broken"),
        ("end", False, None),
    ]
    result = run_sweep(sweep, out, Inline(sweep_work.failing), retry=True)
    assert (result.done, result.kept, ran()) == (3, 2, {"0": 1, "1": 2, "2": 1})


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_of_the_parent_is_flat(tmp_path):
    sweep = parse_sweep(NO_FOLDERS + "[axes]\nq_min = {low = 10, high = 20, steps = 5000}\n")
    used = {}

    def look(event: Event) -> None:
        if event.done in (1000, 5000):
            used[event.done] = memory_mb(os.getpid())

    result = run_sweep(sweep, tmp_path, Inline(), on_event=look)
    assert (result.done, len(rows(tmp_path))) == (5000, 5000)
    assert used[5000] - used[1000] < 1.5
    assert run_sweep(sweep, tmp_path, Inline()).kept == 5000


def test_the_time_left(tmp_path, monkeypatch):
    """What a variant took, for each of those that are left; none is known before the first."""
    now = iter(range(10**6))
    monkeypatch.setattr(
        "padgen.batch.sweep.time",
        SimpleNamespace(monotonic=lambda: next(now) / 1024, strftime=time.strftime),
    )
    events = []
    text = NO_FOLDERS + "[axes]\nq_min = [10, 11, 12, 13]\n"
    run_sweep(parse_sweep(text), tmp_path, Inline(), on_event=events.append)
    assert events[0].eta_s is None
    assert [(e.left, e.eta_s) for e in events if e.record] == [
        (e.left, e.left * e.seconds / (4 - e.left)) for e in events if e.record
    ]
    assert events[-1].eta_s == 0 and events[1].eta_s == 3 * events[1].seconds > 0


def test_an_event_as_json(tmp_path):
    events = []
    run_sweep(parse_sweep(NO_FOLDERS + "[axes]\nq_min = [10]\n"), tmp_path, Inline(), on_event=events.append)
    start, done, end = (json.loads(json.dumps(event.table())) for event in events)
    assert (start["kind"], start["left"], end["kind"], end["left"]) == ("start", 1, "end", 0)
    assert done["variant"]["number"] == 0 and done["variant"]["figures"] == {"taxels": 1} and "record" not in done
