"""`padgen sweep`, `padgen cache` and `make variants` as a user meets them."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from padgen import cli
from padgen.batch.definition import RANGE_KEYS, STAGES, PointSample, Settings, VariantLimits
from padgen.batch.sweep import core_count
from padgen.core import cache
from padgen.core.display import seconds_text
from tests.cli.test_cli import HEAVY, loaded_after
from tests.conftest import SMALL

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.toml"))
SWEEP = 'name = "q"\nbase = "tiny.toml"\n[axes]\nq_min = [15, 20]\nresolution = [1, 4]\n'


@pytest.fixture
def work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(SMALL)
    (tmp_path / "q.toml").write_text(SWEEP)
    return tmp_path


def rows(path="out/q/index.csv"):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def events(text):
    """Parse every line of JSON as it was written, refusing NaN."""
    return [json.loads(line, parse_constant=pytest.fail) for line in text.splitlines()]


def test_sweep_tells_writes_and_goes_on(work, capsys):
    assert cli.run(["sweep", "q.toml", "-j", "2"]) == 0
    out = capsys.readouterr().out
    assert "q: 4 variants, 4 done, 0 failed, in " in out
    assert "written to out/q: index.csv, pareto.csv, pareto.svg, pareto.png" in out
    assert [(r["name"], r["status"], r["taxels"]) for r in rows()] == [
        ("q-00000", "done", "1"),
        ("q-00001", "done", "4"),
        ("q-00002", "done", "1"),
        ("q-00003", "done", "4"),
    ]
    assert all((work / "out/q" / r["name"] / "plan.json").is_file() for r in rows())
    # A coil with one channel has nobody to disturb; those of four fall short, and no front recommends them.
    assert {r["verdict"] for r in rows() if r["taxels"] == "4"} == {"short"}
    assert {r["taxels"] for r in rows("out/q/pareto.csv")} == {"1"}
    before = (work / "out/q/q-00003/plan.json").stat().st_mtime_ns
    assert cli.run(["sweep", "q.toml"]) == 0
    assert "4 of them were finished before and not made again" in capsys.readouterr().out
    assert (work / "out/q/q-00003/plan.json").stat().st_mtime_ns == before
    assert cli.run(["sweep", "q.toml", "--no-resume", "-o", "out/q"]) == 0
    assert "finished before" not in capsys.readouterr().out


def test_json_is_one_object_a_line(work, capsys):
    assert cli.run(["sweep", "q.toml", "--json", "-j", "1"]) == 0
    told = events(capsys.readouterr().out)
    kinds = [event["kind"] for event in told if event["kind"] != "progress"]
    assert kinds == ["start", *["done"] * 4, "end", "summary"]
    done = [event["variant"] for event in told if event["kind"] == "done"]
    assert {variant["number"] for variant in done} == {0, 1, 2, 3}
    assert done[0]["figures"]["taxels"] in (1, 4) and set(done[0]["values"]) == {"q_min", "resolution"}
    summary = told[-1]
    assert (summary["total"], summary["done"], summary["failed"], summary["left"]) == (4, 4, 0, 0)
    assert summary["objectives"] == ["taxels", "verdict_db", "power_w"]
    assert summary["short"] == 2
    assert summary["front"] == [int(r["number"]) for r in rows("out/q/pareto.csv")]


def test_a_failure_is_one_line_exit_one_and_made_again_when_asked(work, capsys):
    (work / "out/q").mkdir(parents=True)
    (work / "out/q/q-00001").write_text("a file where a folder should be")
    assert cli.run(["sweep", "q.toml", "-j", "1"]) == 1
    told = capsys.readouterr()
    (line,) = [line for line in told.err.splitlines() if "failed" in line]
    assert line.startswith("failed: q-00001: ") and "q-00001" in line.removeprefix("failed: q-00001")
    assert "3 done, 1 failed" in told.out and "with --retry" in told.out
    (work / "out/q/q-00001").unlink()
    assert cli.run(["sweep", "q.toml"]) == 1
    assert "failed (in an earlier run): q-00001: " in capsys.readouterr().err
    assert cli.run(["sweep", "q.toml", "--retry"]) == 0
    told = capsys.readouterr()
    assert not told.err and "4 done, 0 failed" in told.out


def test_a_refused_variant_is_a_result(work, capsys):
    (work / "q.toml").write_text(SWEEP.replace("[1, 4]", "[4, 90000]"))
    assert cli.run(["sweep", "q.toml"]) == 0
    told = capsys.readouterr()
    assert not told.err
    assert "2 done, 2 refused, 0 failed" in told.out
    assert re.search(r"^refused: q-00001, q-00003: .*taxels", told.out, re.MULTILINE)


def test_constraints_that_leave_nothing_are_refused(work, capsys):
    (work / "q.toml").write_text('constraints = ["resolution > 4"]\n' + SWEEP)
    assert cli.run(["sweep", "q.toml"]) == 2
    assert "constraints: leave none of 4 variants" in capsys.readouterr().err
    assert not (work / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["none.toml"], r"none.toml: cannot be read \(No such file or directory\)"),
        (["."], r"\.: cannot be read \(Is a directory\)"),
        (["q.toml", "-j", "0"], "--jobs: must be 1 … 1024 processes, got 0"),
        (["q.toml", "-j", "9999"], "--jobs: must be 1 … 1024 processes, got 9999"),
        (["q.toml", "-j", "two"], "invalid int value: 'two'"),
        (["q.toml", "-j", "2", "--scheduler", "tcp://localhost:1"], "--jobs: does not go with --scheduler"),
        (["q.toml", "-o", "tiny.toml"], "tiny.toml: cannot be written to"),
        (["odd.toml"], "axes.q_mim: .*q_min"),
        (["stage.toml"], "stage.*'fly'"),
    ],
)
@pytest.mark.parametrize("as_json", [False, True])
def test_bad_input_is_one_sentence(work, capsys, arguments, sentence, as_json):
    (work / "odd.toml").write_text(SWEEP.replace("q_min", "q_mim"))
    (work / "stage.toml").write_text('stage = "fly"\n' + SWEEP)
    assert cli.run(["sweep", *arguments, *["--json"] * as_json]) == 2
    out, err = capsys.readouterr()
    told = json.loads(out)["error"]["message"] if as_json else err
    assert len(told.splitlines()) == 1 and re.search(sentence, told), told
    assert not (work / "out").exists()


def test_a_sweep_that_is_stopped_says_how_to_go_on(work):
    (work / "q.toml").write_text(SWEEP.replace("[15, 20]", "{ low = 15, high = 20, steps = 2000 }"))
    command = [sys.executable, "-m", "padgen", "sweep", "q.toml", "--json", "-j", "2"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while json.loads(process.stdout.readline())["kind"] != "done":
            pass
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert err == "padgen: interrupted; the same command goes on where it stopped\n"
    summary = events(out)[-1]
    assert summary["kind"] == "summary" and summary["interrupted"] and summary["left"] > 0
    kept = rows()
    assert len(kept) == summary["done"] >= 1
    assert (work / "out/q/pareto.csv").is_file()


def test_the_bar_on_a_terminal_tells_failures(work, capsys, monkeypatch):
    (work / "out/q").mkdir(parents=True)
    (work / "out/q/q-00001").write_text("a file where a folder should be")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "200")
    assert cli.run(["sweep", "q.toml", "-j", "1"]) == 1
    err = capsys.readouterr().err
    assert err.count("failed: q-00001: ") == 1
    assert "\x1b[" in err and "3 done, 1 failed" in err  # the bar


def test_help_and_cache_load_no_numpy(work):
    for arguments in (["sweep", "--help"], ["cache", "info"]):
        assert not loaded_after(*arguments) & {"numpy", *HEAVY}


def test_the_parent_of_a_sweep_of_plans_loads_no_kernel(work):
    assert not loaded_after("sweep", "q.toml") & {"build123d", "OCP", "manifold3d", "trimesh", "lib3mf"}


@pytest.fixture
def kept(monkeypatch, tmp_path):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "10")
    cache.store("plan", "ab" * 32, {"x": 1})
    cache.store_bytes("mesh", "cd" * 32, b"12345")
    return tmp_path / "cache"


def test_cache_info_and_clear(kept, capsys):
    assert cli.run(["cache", "info"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert f"{kept}: 2 entries, 0.3 kB of 10.0 MB" in out and "mesh" in out and "plan" in out
    assert cli.run(["cache", "info", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["entries"] == 2 and table["limit_bytes"] == 10_000_000 and not table["cleared"]
    assert set(table["kinds"]) == {"mesh", "plan"} and table["kinds"]["mesh"]["entries"] == 1
    assert cli.run(["cache", "clear"]) == 0
    assert f"{kept}: 2 entries dropped" in " ".join(capsys.readouterr().out.split())
    assert cache.load("plan", "ab" * 32) is None
    assert cli.run(["cache", "clear", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["entries"] == 0


def test_cache_folder_by_option(kept, capsys, tmp_path):
    assert cli.run(["cache", "info", "--cache", str(tmp_path / "other")]) == 0
    assert f"{tmp_path / 'other'}: 0 entries" in capsys.readouterr().out


def test_a_bad_limit_of_the_cache_is_told(kept, capsys, monkeypatch):
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "lots")
    assert cli.run(["cache", "info"]) == 2
    assert re.search("PADGEN_CACHE_MB: must be a number of megabytes.*got 'lots'", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "40 ms"), (9.94, "9.94 s"), (59.6, "59.6 s"), (75, "1 min 15 s"), (7265, "2 h 01 min")],
)
def test_times_as_people_read_them(seconds, text):
    assert seconds_text(seconds) == text


@pytest.mark.sample(1)
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_of_the_docs_run(work, capsys, path):
    text = path.read_text().replace("[16, 32, 48, 64]", "[16]").replace("steps = 5", "steps = 2")
    (work / path.name).write_text(text.replace("count = 200", "count = 4"))
    assert cli.run(["sweep", path.name, "--json"]) == 0
    summary = events(capsys.readouterr().out)[-1]
    assert 1 <= summary["done"] <= 8 and summary["front"]


def test_docs_tell_every_key():
    text = (ROOT / "docs" / "sweeps.md").read_text()
    for kind in (Settings, PointSample, VariantLimits):
        for field in fields(kind):
            assert f"`{field.name}`" in text, field.name
    for word in (
        *RANGE_KEYS,
        *STAGES,
        "[axes]",
        "[[linked]]",
        "constraints",
        "--retry",
        "--no-resume",
        "--scheduler",
        "--json",
    ):
        assert f"`{word}" in text, word


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
@pytest.mark.parametrize(
    ("arguments", "command"),
    [
        (["-j3", "SWEEP=a b.toml"], "padgen sweep a b.toml -j 3"),
        (["-k", "-j", "2", "SWEEP=q.toml"], "padgen sweep q.toml -j 2"),
        (["-j", "SWEEP=q.toml"], "padgen sweep q.toml"),
        (["SWEEP=q.toml"], "padgen sweep q.toml"),
        (["SWEEP=q.toml", "JOBS=5"], "padgen sweep q.toml -j 5"),
        (["-j2"], "padgen build paper-32, make -j2"),
        (["JOBS=3"], "padgen build paper-32, make -j3"),
        ([], f"padgen build paper-32, make -j{core_count()}"),
    ],
)
def test_make_variants(tmp_path, arguments, command):
    tool = tmp_path / "padgen"
    tool.write_text('#!/bin/sh\njobs=$(echo "$MAKEFLAGS" | grep -o -e "-j[0-9]*")\necho "padgen $*, make $jobs"\n')
    tool.chmod(0o755)
    (tmp_path / "stamp").touch()
    own = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "OMP"))}
    done = subprocess.run(
        ["make", "-s", "-C", str(ROOT), "variants", f"BIN={tmp_path}", f"STAMP={tmp_path / 'stamp'}", *arguments],
        capture_output=True,
        text=True,
        env=own,
        check=True,
    )
    lines = done.stdout.splitlines()
    assert command in (lines if "make" in command else [line.partition(", make")[0] for line in lines])
    assert not done.stderr
