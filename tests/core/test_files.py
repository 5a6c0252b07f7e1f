"""Folders of results: which files padgen may remove and replace, and that no user's file is lost."""

import ast
import json
import os
import shutil
import signal
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import padgen
from padgen.cli import run
from padgen.core import files
from padgen.core.errors import FileError
from padgen.core.files import (
    OutputFolder,
    csv_cell,
    differs,
    is_current,
    json_line,
    json_text,
    lock_file,
    read_bounded,
    read_manifest,
    recover,
    remove_own_files,
    sha256_hex,
    unlock_file,
)
from padgen.measured.read import read_measured
from padgen.planner import read_plan
from padgen.solid.parts import read_mesh
from padgen.spec import find_spec

PLAN_A = '{"name": "a"}'
PLAN_B = '{"name": "b"}'


def put(folder, built_from=None, remove=(), **texts):
    """Write files named by keywords, in which the last underscore stands for the dot."""
    with OutputFolder(folder) as out:
        for name, text in texts.items():
            out.write(".".join(name.rsplit("_", 1)), text)
        return out.commit(built_from, remove)


def texts(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.name != files.MANIFEST}


def child(code, *arguments):
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


# Numbers


@pytest.mark.parametrize(
    ("number", "written"),
    [
        (9.9e-13, 0.0),
        (-4e-17, 0.0),
        (-0.0, 0.0),
        (1e-12, 1e-12),
        (-1.23456789012e-12, -1.23456789e-12),
        (2 / 3, 0.6666666667),
    ],
)
def test_results_have_ten_digits_and_what_rounding_leaves_of_zero_is_zero(number, written):
    for value in (number, np.float64(number)):
        for text in (json_text({"a": [value]}), json_line({"a": [value]})):
            assert str(json.loads(text)["a"][0]) == str(written), "str tells -0.0 from 0.0"
        assert csv_cell(value) == f"{written:.10g}"


def test_inputs_are_written_in_full():
    spec = {"a": 1.2345678901234e-15, "b": {"c": 1 / 3}}
    assert json.loads(json_text({"spec": spec}))["spec"] == spec


# What goes, and what stays


def test_what_is_stale_goes_only_where_it_is_ours_and_unchanged(tmp_path):
    put(tmp_path, pad_stl="ours", coupon_stl="ours", coupon_3mf="ours")
    (tmp_path / "coupon.3mf").write_text("edited")
    (tmp_path / "coupon.csv").write_text("measured")
    put(tmp_path, remove=["coupon.stl", "coupon.3mf", "coupon.csv"], pad_stl="new")
    assert texts(tmp_path) == {"pad.stl": "new", "coupon.3mf": "edited", "coupon.csv": "measured"}


def test_what_belongs_to_a_plan_goes_with_it(tmp_path):
    put(tmp_path, plan_json=PLAN_A, study_csv="ours", drive_wav="ours")
    (tmp_path / "study.svg").write_text("a user's")
    (tmp_path / "drive.wav").write_text("edited")
    put(tmp_path, plan_json=PLAN_A)
    assert "study.csv" in texts(tmp_path)
    put(tmp_path, plan_json=PLAN_B)
    assert texts(tmp_path) == {"plan.json": PLAN_B, "study.svg": "a user's", "drive.wav": "edited"}


def test_of_another_plan_stay_a_build_until_the_next_and_what_was_measured(tmp_path):
    put(tmp_path, {"spec": "a"}, plan_json=PLAN_A, pad_stl="mesh", pad_glb="mesh")
    put(tmp_path, tuning_json="a print", toy_txt="of a format that is registered")
    put(tmp_path, plan_json=PLAN_B)
    assert set(texts(tmp_path)) == {"plan.json", "pad.stl", "pad.glb", "tuning.json"}
    put(tmp_path, drive_wav="of B")
    put(tmp_path, {"spec": "b"}, plan_json=PLAN_B, pad_stl="mesh")
    assert set(texts(tmp_path)) == {"plan.json", "pad.stl", "tuning.json", "drive.wav"}


def test_every_writer_adds_to_the_manifest(tmp_path):
    put(tmp_path, a_csv="1", b_csv="2")
    put(tmp_path, b_csv="3", c_csv="4")
    (tmp_path / "a.csv").unlink()
    put(tmp_path, d_csv="5")
    known = {"b.csv": "3", "c.csv": "4", "d.csv": "5"}
    assert read_manifest(tmp_path)["files"] == {name: sha256_hex(text.encode()) for name, text in known.items()}


def test_a_build_stays_up_to_date_until_its_plan_or_a_file_of_it_is_another(tmp_path):
    inputs = {"spec": "a"}
    put(tmp_path, inputs, plan_json=PLAN_A, pad_stl="mesh", drive_csv="a")
    assert put(tmp_path, plan_json=PLAN_A) == []
    assert put(tmp_path, plan_json=PLAN_A, drive_csv="a", drive_wav="wave") == []
    (tmp_path / "drive.wav").unlink()
    assert is_current(tmp_path, inputs) and not is_current(tmp_path, {"spec": "b"})
    assert put(tmp_path, plan_json=PLAN_B) == ["drive.csv", "pad.stl"]
    assert not is_current(tmp_path, inputs) and not is_current(tmp_path, {"spec": "b"})
    assert put(tmp_path, plan_json=PLAN_B) == []
    assert put(tmp_path, plan_json=PLAN_A) == ["drive.csv", "pad.stl"]
    assert not is_current(tmp_path, inputs), "nobody has looked whether the rest is of it"
    put(tmp_path, inputs, plan_json=PLAN_A, pad_stl="mesh")
    (tmp_path / "pad.stl").write_text("edited")
    assert not is_current(tmp_path, inputs)


def test_a_manifest_of_builds_alone_still_counts(tmp_path):
    """padgen 0.1 wrote such manifests."""
    listed = {name: sha256_hex(text.encode()) for name, text in (("plan.json", PLAN_A), ("pad.stl", "mesh"))}
    (tmp_path / "plan.json").write_text(PLAN_A)
    (tmp_path / "pad.stl").write_text("mesh")
    (tmp_path / "manifest.json").write_text(json.dumps({"padgen": "0.1.0", "inputs": {"spec": "a"}, "files": listed}))
    assert is_current(tmp_path, {"spec": "a"})
    put(tmp_path, plan_json=PLAN_A, drive_csv="a")
    assert is_current(tmp_path, {"spec": "a"})
    assert texts(tmp_path) == {"plan.json": PLAN_A, "pad.stl": "mesh", "drive.csv": "a"}


def test_a_folder_is_taken_away_with_what_a_killed_run_left(tmp_path):
    put(tmp_path / "out", plan_json=PLAN_A)
    (tmp_path / "out" / files.LOCK).touch()
    (tmp_path / "out" / ".partial-4194305").mkdir()  # above the largest process number
    remove_own_files(tmp_path / "out")
    assert not (tmp_path / "out").exists()


# What is in the way


def test_a_users_file_makes_room_and_is_kept(tmp_path, caplog):
    put(tmp_path, drive_csv="ours")
    (tmp_path / "drive.csv").write_text("edited")
    (tmp_path / "bom.csv").write_text("a user's")
    (tmp_path / "bom.csv.old").write_text("older")
    put(tmp_path, drive_csv="new", bom_csv="new")
    kept = {"drive.csv.old": "edited", "bom.csv.old": "older", "bom.csv.old2": "a user's"}
    assert texts(tmp_path) == {"drive.csv": "new", "bom.csv": "new", **kept}
    assert "bom.csv is not padgen's or was changed; kept as bom.csv.old2" in caplog.text
    put(tmp_path, drive_csv="newer", bom_csv="newer")
    assert len(texts(tmp_path)) == 5, "what is ours is replaced"


def test_the_same_bytes_are_no_users_file(tmp_path):
    (tmp_path / "plan.json").write_text(PLAN_A)
    put(tmp_path, plan_json=PLAN_A)
    assert texts(tmp_path) == {"plan.json": PLAN_A}


@pytest.mark.parametrize("name", ["pad.stl", "bom.csv", "manifest.json"])
def test_a_folder_in_the_way_is_refused_before_anything_is_moved(tmp_path, name):
    put(tmp_path, plan_json=PLAN_A, study_csv="ours")
    before = read_manifest(tmp_path)
    (tmp_path / name).unlink(missing_ok=True)
    (tmp_path / name / "mine").mkdir(parents=True)
    with pytest.raises(FileError, match=rf"{name}: cannot be written \(a folder has its name\)"):
        put(tmp_path, plan_json=PLAN_B, pad_stl="new", bom_csv="new")
    assert (tmp_path / name / "mine").is_dir()
    assert (tmp_path / "plan.json").read_text() == PLAN_A and (tmp_path / "study.csv").exists()
    assert {path.name for path in tmp_path.iterdir()} == {"plan.json", "study.csv", "manifest.json", name}
    assert name == "manifest.json" or read_manifest(tmp_path) == before


def test_a_folder_that_is_not_in_the_way_is_of_no_account(tmp_path):
    put(tmp_path, plan_json=PLAN_A, pad_stl="ours", coupon_stl="ours")
    (tmp_path / "coupon.stl").unlink()
    for name in ("coupon.d", "coupon.stl", "study.csv"):
        (tmp_path / name / "mine").mkdir(parents=True)
    put(tmp_path, remove=["coupon.d", "coupon.stl"], plan_json=PLAN_B, pad_stl="new")
    assert all((tmp_path / name / "mine").is_dir() for name in ("coupon.d", "coupon.stl", "study.csv"))


def test_a_link_is_a_users_and_what_it_points_to_stays(tmp_path):
    outside = tmp_path / "outside.stl"
    folder = tmp_path / "out"
    put(folder, pad_stl="ours", coupon_stl="ours")
    outside.write_text("ours")
    for name in ("pad.stl", "coupon.stl"):
        (folder / name).unlink()
        (folder / name).symlink_to(outside)
    put(folder, remove=["coupon.stl"], pad_stl="new")
    assert outside.read_text() == "ours" and (folder / "coupon.stl").is_symlink()
    assert (folder / "pad.stl").read_text() == "new" and (folder / "pad.stl.old").is_symlink()


TAMPERED = {
    "a list": '{"files": ["study.csv"]}',
    "hashes that are none": '{"files": {"study.csv": 1}}',
    "a short hash": '{"files": {"study.csv": "e3b0"}}',
    "nested": '{"files": {"study.csv": {"study.csv": "HASH"}}}',
    "a path": '{"files": {"study.csv": "HASH", "../victim.txt": "HASH"}}',
    "a Windows path": '{"files": {"study.csv": "HASH", "..\\\\victim.txt": "HASH"}}',
    "the folder above": '{"files": {"study.csv": "HASH", "..": "HASH"}}',
    "a NUL": '{"files": {"study.csv": "HASH", "a\\u0000b": "HASH"}}',
    "half a character": '{"files": {"study.csv": "HASH", "\\ud800": "HASH"}}',
    "a long name": f'{{"files": {{"study.csv": "HASH", "{"a" * 5000}": "HASH"}}}}',
    "itself": '{"files": {"study.csv": "HASH", "manifest.json": "HASH"}}',
    "many": json.dumps({"files": {"study.csv": "HASH"} | {f"{k}.csv": "HASH" for k in range(100_000)}}),
    "deep": "[" * 100_000,
    "a long number": '{"files": {"study.csv": ' + "1" * 5000 + "}}",
    "odd builds": '{"files": {"study.csv": "HASH"}, "inputs": {}, "built": [["study.csv"]]}',
    "builds of other files": '{"files": {"study.csv": "HASH"}, "inputs": {}, "built": ["other.csv"]}',
    "builds as text": '{"files": {"study.csv": "HASH"}, "inputs": {}, "built": ""}',
    "no text": "\udcff",
}


@pytest.mark.parametrize("text", TAMPERED.values(), ids=TAMPERED)
def test_a_tampered_manifest_is_none(tmp_path, text):
    folder = tmp_path / "out"
    victim = tmp_path / "victim.txt"
    folder.mkdir()
    victim.write_text("mine")
    (folder / "study.csv").write_text("mine")
    raw = text.replace("HASH", sha256_hex(b"mine")).encode(errors="surrogateescape")
    (folder / "manifest.json").write_bytes(raw)
    assert read_manifest(folder) == {} and not is_current(folder, {})
    remove_own_files(folder)
    put(folder, remove=["*"], plan_json=PLAN_A)
    assert victim.read_text() == "mine" and (folder / "study.csv").read_text() == "mine"
    assert (folder / "manifest.json.old").read_bytes() == raw
    assert set(read_manifest(folder)["files"]) == {"plan.json"}


def test_a_manifest_that_is_no_file_is_none(tmp_path):
    (tmp_path / "manifest.json").symlink_to("/dev/zero")
    assert read_manifest(tmp_path) == {}
    (tmp_path / "manifest.json").unlink()
    os.mkfifo(tmp_path / "manifest.json")
    assert read_manifest(tmp_path) == {}


# Ends before the end


@pytest.mark.parametrize("calls", range(9))
@pytest.mark.parametrize("error", [OSError(13, "Permission denied"), KeyboardInterrupt()])
def test_a_commit_that_ends_early_leaves_all_as_it_was(tmp_path, monkeypatch, calls, error):
    put(tmp_path, {"spec": "a"}, plan_json=PLAN_A, pad_stl="ours", study_csv="ours")
    (tmp_path / "bom.csv").write_text("a user's")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    left = [calls]
    replace = os.replace

    def breaks(*arguments, **named):
        left[0] -= 1
        if left[0] == -1:
            raise error
        return replace(*arguments, **named)

    monkeypatch.setattr(os, "replace", breaks)
    with pytest.raises((FileError, KeyboardInterrupt)):
        put(tmp_path, {"spec": "b"}, plan_json=PLAN_B, pad_stl="new", bom_csv="new")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_what_dead_processes_left_goes_and_a_living_ones_stays(tmp_path):
    dead = child("pass")
    living = child("input()")
    dead.communicate()
    for name in (dead.pid, living.pid, 10**30, "mine", ""):
        (tmp_path / f".partial-{name}" / "file").mkdir(parents=True)
    put(tmp_path, plan_json=PLAN_A)
    left = {path.name.removeprefix(".partial-") for path in tmp_path.glob(".partial-*")}
    living.communicate("\n")
    assert left == {str(living.pid), "mine", ""}


def test_no_process_is_asked_by_a_signal():
    """On Windows, signal 0 is Ctrl-C."""
    for path in Path(padgen.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "kill":
                assert not any(isinstance(value, ast.Constant) and value.value == 0 for value in node.args), path


# A faulty disk: each system call in turn fails, or is the last


CHANGES = ("open", "write", "fsync", "close", "mkdir", "rename", "replace", "unlink", "rmdir")
"""The functions of `os` by which a commit changes the disk."""


def faulty_disk(monkeypatch, at, fault):
    """Run `fault` at call number `at` of those that change the disk; return the list of calls made."""
    calls = []

    def befallen(name):
        call = getattr(os, name)

        def changed(*arguments, **named):
            calls.append(name)
            if len(calls) - 1 == at:
                if name == "close":
                    call(*arguments)
                fault()
            return call(*arguments, **named)

        return changed

    for name in CHANGES:
        monkeypatch.setattr(os, name, befallen(name))
    return calls


def killed(at, work):
    """Run `work` in a process that exits at its call number `at`; return whether it got that far."""
    process = os.fork()
    if process == 0:
        try:
            faulty_disk(pytest.MonkeyPatch(), at, lambda: os._exit(9))
            work()
            os._exit(0)
        finally:
            os._exit(1)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    assert code in (0, 9)
    return code == 9


def seen(folder):
    """Return the names and contents of all files that are not hidden."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name[0] != "."} if folder.exists() else {}


def tree(folder):
    """Return all that is in a folder: kinds, contents, targets of links, times of the last change."""
    found = {}
    for path in sorted(folder.rglob("*")):
        state = path.lstat()
        data = path.readlink() if path.is_symlink() else path.read_bytes() if path.is_file() else ""
        found[str(path.relative_to(folder))] = stat.S_IFMT(state.st_mode), data, state.st_mtime_ns, state.st_ino
    return found


def hidden(folder):
    return [path.name for path in folder.iterdir() if path.name[0] == "."] if folder.exists() else []


def enter(folder):
    with OutputFolder(folder):
        pass


def old_build(folder):
    put(folder, {"spec": "a"}, plan_json=PLAN_A, pad_stl="ours", taxel_step="ours", study_csv="ours", notes_csv="ours")
    (folder / "measured.csv").write_text("a user's")


def old_build_edited(folder):
    old_build(folder)
    for name in ("pad.stl", "study.csv", "manifest.json.old"):
        (folder / name).write_text("edited")
    (folder / "bom.csv").write_text("a user's")


def new_build(folder):
    put(folder, {"spec": "b"}, plan_json=PLAN_B, pad_stl="new", bom_csv="new")


COMMITS = {
    "a folder that was not there": (lambda folder: None, new_build),
    "a build by another of fewer files": (old_build, new_build),
    "users' files that are kept": (old_build_edited, new_build),
    "a manifest that is a user's": (lambda folder: (folder.mkdir(), (folder / "manifest.json").touch()), new_build),
    "stale files alone": (old_build, lambda folder: put(folder, remove=["taxel.step", "notes.csv"])),
    "a folder taken away": (old_build_edited, remove_own_files),
}
commits = pytest.mark.parametrize(("before", "commit_"), COMMITS.values(), ids=COMMITS)


def states(tmp_path, before, commit_):
    """Return a function that copies a folder to be changed, and its content before and after the change."""
    model = tmp_path / "model"
    folder = tmp_path / "new"
    before(model)

    def copied(to):
        if model.exists():
            shutil.copytree(model, to)
        return to

    commit_(copied(folder))
    assert seen(folder) != seen(model) and not hidden(folder)
    return copied, seen(model), seen(folder)


@pytest.mark.sample(6)
@commits
@pytest.mark.parametrize("errno", [5, 28])
def test_where_a_call_fails_the_folder_is_the_old_or_the_new_one(tmp_path, caplog, before, commit_, errno):
    def fails():
        raise OSError(errno, os.strerror(errno))

    copied, old, new = states(tmp_path, before, commit_)
    ends = set()
    for at in count():
        folder = copied(tmp_path / str(at))
        with pytest.MonkeyPatch.context() as patch:
            calls = faulty_disk(patch, at, fails)
            told = False
            try:
                commit_(folder)
            except FileError:
                told = True
        state = seen(folder)
        assert state in ((old, new) if commit_ is remove_own_files else (old,) if told else (new,)), calls[at:]
        ends.add(state == new)
        if len(calls) <= at:
            break
        enter(folder)
        assert seen(folder) == state and not hidden(folder)
    assert at > 15 and ends == {False, True}


@pytest.mark.sample(3)
@commits
def test_where_a_process_is_killed_the_folder_is_the_old_or_the_new_one(tmp_path, before, commit_):
    """Killed before every second call that changes the disk; `test_where_a_call_fails…` tries all."""
    copied, old, new = states(tmp_path, before, commit_)
    ends = []
    for at in count(step=2):
        folder = copied(tmp_path / str(at))
        if not killed(at, lambda folder=folder: commit_(folder)):
            break
        is_torn = (folder / files.JOURNAL).exists()
        found = seen(folder)
        assert is_torn or found in (old, new), at
        if is_torn:
            with pytest.raises(FileError, match=f"half-written; padgen restore {folder} puts that back"):
                read_manifest(folder)
            assert seen(folder) == found, "reading changes nothing"
        enter(folder)
        ends.append(seen(folder) == new)
        assert seen(folder) == (new if ends[-1] else old) and not hidden(folder)
        assert not (is_torn and ends[-1]), "old until the commit"
    assert at > 15 and ends == sorted(ends) and {*ends} == {False, True}, "old until the commit, new from then on"


def test_a_process_that_is_killed_while_it_puts_back_does_no_harm(tmp_path):
    copied, old, _ = states(tmp_path, *COMMITS["users' files that are kept"])
    torn = 0
    for at in count(step=6):
        folder = copied(tmp_path / str(at))
        if not killed(at, lambda folder=folder: new_build(folder)):
            break
        if (folder / files.JOURNAL).exists():
            torn += 1
            calls = next(call for call in count() if not killed(call, lambda folder=folder: enter(folder)))
            assert calls > 5 and seen(folder) == old and not hidden(folder)
    assert torn > 1


def before_torn(tmp_path):
    """Return a folder, its content, and the call of `new_build` at which some files are new and some old."""
    copied, old, _ = states(tmp_path, *COMMITS["users' files that are kept"])
    with pytest.MonkeyPatch.context() as patch:
        calls = faulty_disk(patch, -1, None)
        new_build(copied(tmp_path / "counted"))
    *_, at, _ = (number for number, name in enumerate(calls) if name == "replace")
    return copied(tmp_path / "torn"), old, at


def torn(tmp_path):
    """Return a folder that a killed process left half old and half new, with its content before."""
    folder, old, at = before_torn(tmp_path)
    assert killed(at, lambda: new_build(folder))
    assert (folder / "plan.json").read_text() == PLAN_B and not (folder / "manifest.json").exists()
    return folder, old


@pytest.mark.parametrize("broken", [CHANGES, ("replace",)])
def test_a_disk_that_does_not_come_back_is_put_right_when_it_is_there_again(tmp_path, broken):
    folder, old, at = before_torn(tmp_path)

    def fails(*arguments, **named):
        raise OSError(5, "Input/output error")

    def breaks():
        for name in broken:
            patch.setattr(os, name, fails)
        fails()

    with pytest.MonkeyPatch.context() as patch:
        faulty_disk(patch, at, breaks)
        with pytest.raises(FileError, match="Input/output error"):
            new_build(folder)
        assert seen(folder) != old
        with pytest.raises(FileError, match=r"a killed run left it half-written, and it cannot be restored \(Input"):
            recover(folder)
    assert recover(folder) and is_current(folder, {"spec": "a"}) is False and seen(folder) == old
    enter(folder)
    assert not hidden(folder)


@pytest.mark.parametrize(
    "read",
    [
        lambda folder: read_plan(folder / "plan.json"),
        lambda folder: find_spec(str(folder / "plan.json")),
        lambda folder: read_mesh(folder / "pad.stl"),
        lambda folder: read_measured(folder, SimpleNamespace(name="a", taxels=[SimpleNamespace(id="a", coil=(0, 0))])),
        lambda folder: read_bounded(folder / "bom.csv", 1000, "a bill"),
        lambda folder: differs(folder, "plan.json", PLAN_A),
        lambda folder: read_manifest(folder),
    ],
)
def test_whoever_reads_a_torn_folder_is_told_what_restores_it(tmp_path, read):
    folder, old = torn(tmp_path)
    found = tree(folder)
    with pytest.raises(FileError, match=f"a killed run left its folder half-written; padgen restore {folder} puts"):
        read(folder)
    assert tree(folder) == found
    assert run(["restore", str(folder)]) == 0
    assert seen(folder) == old and not (folder / files.JOURNAL).exists()
    with suppress(FileError):
        read(folder)
    assert seen(folder) == old


def test_a_file_that_no_commit_moves_is_read_in_a_torn_folder(tmp_path):
    folder, _ = torn(tmp_path)
    (folder / "mine.csv").write_text("mine")
    assert read_bounded(folder / "mine.csv", 100, "a measurement") == b"mine"


def test_what_a_user_has_put_into_a_torn_folder_is_kept(tmp_path):
    folder, old = torn(tmp_path)
    theirs = ("plan.json", "pad.stl", "bom.csv", "taxel.step")
    for name in theirs:
        (folder / name).write_text(f"a user's {name}")
    (folder / "new.csv").write_text("a user's")
    enter(folder)
    kept = {path.read_text() for path in folder.iterdir() if ".old" in path.name}
    assert {f"a user's {name}" for name in theirs} <= kept and (folder / "new.csv").exists()
    assert {name: data for name, data in seen(folder).items() if name in old} == old


def test_without_locks_a_torn_folder_is_put_back_where_its_process_is_gone(tmp_path, monkeypatch):
    def none(*arguments):
        raise OSError(95, "Operation not supported")

    folder, old = torn(tmp_path)
    monkeypatch.setattr("fcntl.flock", none)
    journal = (folder / files.JOURNAL).read_text()
    living = child("input()")
    (aside,) = folder.glob(".partial-*")
    (folder / files.JOURNAL).write_text(journal.replace(aside.name, f".partial-{living.pid}"))
    with pytest.raises(FileError, match="another process is writing into it"):
        enter(folder)
    living.communicate("\n")
    (folder / files.JOURNAL).write_text(journal)
    enter(folder)
    assert seen(folder) == old


TAMPERED_JOURNALS = {
    "no table": "[]",
    "half of one": '{"aside": ".partial-1", "new": {}',
    "another's": '{"steps": []}',
    "a path aside": '{"aside": ".partial-1/../..", "new": {}, "away": [], "kept": {}}',
    "a path to put back": '{"aside": ".partial-1", "new": {}, "away": [], "kept": {"mine.csv": "../victim.txt"}}',
    "a path to take": '{"aside": ".partial-1", "new": {"../victim.txt": "HASH"}, "away": [], "kept": {}}',
    "no names": '{"aside": ".partial-1", "new": {}, "away": [["a"]], "kept": {}}',
    "no lists": '{"aside": 1, "new": 1, "away": 1, "kept": 1}',
}


@pytest.mark.parametrize("text", TAMPERED_JOURNALS.values(), ids=TAMPERED_JOURNALS)
def test_a_tampered_journal_is_none(tmp_path, text):
    folder = tmp_path / "out"
    victim = tmp_path / "victim.txt"
    (folder / ".partial-1").mkdir(parents=True)
    victim.write_text("mine")
    (folder / files.JOURNAL).write_text(text.replace("HASH", sha256_hex(b"mine")))
    put(folder, plan_json=PLAN_A)
    assert victim.read_text() == "mine" and seen(folder).keys() == {"plan.json", "manifest.json"}


# Two at once


WRITER = """
import sys
from pathlib import Path
from padgen.core.files import OutputFolder

folder, letter = Path(sys.argv[1]), sys.argv[2]
print("ready", flush=True)
input()
for _ in range(20):
    with OutputFolder(folder) as out:
        for k in range(25):
            out.write(f"{k}.csv", letter)
        out.write(f"taxel-{letter}.step", letter)
        out.commit({"spec": letter})
"""


def test_of_two_writers_one_is_last_and_whole(tmp_path):
    folder = tmp_path / "out"
    writers = [child(WRITER, folder, letter) for letter in "ab"]
    for writer in writers:
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        writer.stdin.write("\n")
        writer.stdin.flush()
    for writer in writers:
        writer.communicate()
        assert writer.returncode == 0
    (letter,) = set(texts(folder).values())
    assert set(texts(folder)) == {*(f"{k}.csv" for k in range(25)), f"taxel-{letter}.step"}
    assert is_current(folder, {"spec": letter})


HOLDER = """
import sys
from pathlib import Path
from padgen.core.files import lock_file

print(lock_file(Path(sys.argv[1])) >= 0, flush=True)
input()
"""


def test_a_folder_that_another_process_writes_into_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "PATIENCE_S", 0.05)
    put(tmp_path, plan_json=PLAN_A)
    holder = child(HOLDER, tmp_path / files.LOCK)
    assert holder.stdout.readline() == "True\n"
    with pytest.raises(FileError, match="another process is writing into it; try again"):
        put(tmp_path, plan_json=PLAN_B)
    assert texts(tmp_path) == {"plan.json": PLAN_A, files.LOCK: ""}
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    put(tmp_path, plan_json=PLAN_B)
    assert texts(tmp_path) == {"plan.json": PLAN_B}, "a dead process holds nothing, and no lock is left"


def test_where_there_are_no_locks_one_writes_without(tmp_path, monkeypatch):
    def none(*arguments):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", none)
    put(tmp_path, plan_json=PLAN_A)
    assert (tmp_path / "plan.json").read_text() == PLAN_A


def test_a_lock_is_no_way_out_of_a_folder(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / files.LOCK).symlink_to(tmp_path / "outside")
    put(tmp_path / "out", plan_json=PLAN_A)
    assert not (tmp_path / "outside").exists()


def test_a_lock_is_given_back(tmp_path):
    file = lock_file(tmp_path / "lock")
    assert file >= 0 > lock_file(tmp_path / "lock")
    unlock_file(tmp_path / "lock", file)
    assert not (tmp_path / "lock").exists()


def test_a_hundred_saves_at_once_in_one_process_are_all_whole(tmp_path):
    """Threads share the process's number, so that each needs a folder aside of its own."""

    def save(letter):
        put(tmp_path, {"spec": letter}, plan_json=letter, pad_stl=letter)

    with ThreadPoolExecutor(100) as threads:
        for saved in [threads.submit(save, str(number)) for number in range(100)]:
            saved.result()
    (letter,) = set(texts(tmp_path).values())
    assert is_current(tmp_path, {"spec": letter}) and not hidden(tmp_path)
