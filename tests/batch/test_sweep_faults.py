"""Sweeps that are hit while they run: nothing is lost, nothing is doubled, and the next run goes on.

| fault | costs |
|---|---|
| kill -9, or a crash, of a worker | the variant that it was on |
| a variant that takes too long or too much memory | that variant |
| kill -9 of the parent, Ctrl-C | what was at work; its workers end, the next run makes the rest |
| disk full | the sweep ends with a sentence; what was done is kept |
| two sweeps into one folder | the second is refused |
| torn journal, spoiled cache, a clock that jumps | nothing |
"""

import asyncio
import csv
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent import futures
from concurrent.futures import BrokenExecutor, CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from io import FileIO
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace

import pytest

from padgen.batch.definition import parse_sweep
from padgen.batch.index import write_pareto
from padgen.batch.sweep import Window, run_sweep, sole_sweep
from padgen.batch.variant import run_task
from padgen.core import cache
from padgen.core.errors import FileError
from tests import sweep_work
from tests.sweep_work import Inline

HEAD = 'name = "s"\nbase = "paper-32"\nfolders = false\n'


def table(count: int = 8, more: str = "", time_s: float = 60) -> str:
    return f"{HEAD}{more}\n[axes]\nq_min = {[10 + i for i in range(count)]}\n[limits]\ntime_s = {time_s}\n"


def sweep(*arguments):
    return parse_sweep(table(*arguments))


def rows(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO((folder / "index.csv").read_text())))


def ran(place: Path) -> list[int]:
    path = place / "ran"
    return [int(line) for line in path.read_text().split()] if path.exists() else []


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv(sweep_work.PLACE, str(tmp_path))
    return tmp_path


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until(condition, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)


@pytest.mark.sample(2)
@pytest.mark.parametrize("chunk", [1, 8])
@pytest.mark.parametrize("foreign", [False, True])
def test_a_killed_worker_costs_its_variant(place, foreign, chunk):
    executor = ThreadPoolExecutor(2) if foreign else None
    result = run_sweep(sweep(), place / "out", executor, workers=2, work=sweep_work.killed, chunk=chunk)
    assert (result.done, result.failed, result.left, result.stopped) == (6, 2, 0, "")
    told = {int(row["number"]): row["sentence"] for row in rows(place / "out")}
    assert "killed (signal 9)" in told[3] and "signal 11" in told[5]
    assert sorted(ran(place)) == [0, 1, 2, 4, 6, 7]


def test_limits(place):
    limited = parse_sweep(HEAD + "[axes]\nq_min = [10, 11, 12, 13, 14, 15]\n[limits]\ntime_s = 2.5\nmemory_mb = 300\n")
    result = run_sweep(limited, place / "out", workers=2, work=sweep_work.hungry)
    found = {int(row["number"]): row for row in rows(place / "out")}
    assert (result.done, result.failed) == (4, 2)
    assert found[2]["sentence"] == "took more than 300 MB (limits.memory_mb)"
    assert 300 < float(found[2]["peak_memory_mb"]) < 900
    assert found[4]["sentence"] == "took longer than 2.5 s (limits.time_s)"


def test_whatever_python_breaks_down_with(place):
    result = run_sweep(sweep(6), place / "out", workers=1, work=sweep_work.clumsy)
    found = rows(place / "out")
    assert (result.done, result.failed) == (2, 4)
    assert [row["sentence"].partition("(")[0] for row in found[:4]] == ["broke down "] * 4
    assert "Input/output error" in found[0]["sentence"] and "SystemExit" in found[1]["sentence"]
    assert (found[4]["nan"], found[4]["text"], found[5]["status"]) == ("", "two\nlines", "done")


PARENT = """
import sys
from pathlib import Path
from types import SimpleNamespace
from padgen.batch.definition import parse_sweep
from padgen.batch.sweep import run_sweep
from tests import sweep_work
folder, work, table = sys.argv[1:]
result = run_sweep(parse_sweep(table), Path(folder), workers=2, work=getattr(sweep_work, work))
print("stopped:", result.stopped, result.interrupted, flush=True)
"""


def parent(place: Path, work: str) -> subprocess.Popen:
    env = os.environ | {"PYTHONPATH": os.pathsep.join([".", *sys.path])}
    command = [sys.executable, "-c", PARENT, place / "out", work, table(40, "", 1 if work == "brief" else 60)]
    return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, cwd=Path(__file__).parents[2], text=True)


def workers_of(pid: int) -> list[int]:
    found = []
    for thread in Path(f"/proc/{pid}/task").iterdir():
        found += [int(child) for child in (thread / "children").read_text().split()]
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_kill_9_of_the_parent(place):
    process = parent(place, "held")
    kept = place / "out" / "index.jsonl"
    wait_until(lambda: len(ran(place)) >= 6 and kept.exists() and kept.read_bytes().count(b"\n") >= 3)
    workers = workers_of(process.pid)
    process.kill()
    process.communicate(timeout=60)
    assert len(workers) == 2
    wait_until(lambda: not any(alive(pid) for pid in workers))
    # The lock is free, and what the journal holds is not made again.
    before = ran(place)
    journal = kept.read_bytes().count(b"\n")
    result = run_sweep(sweep(40), place / "out", workers=2, work=sweep_work.counted)
    assert (result.done, result.kept, result.left) == (40, journal, 0)
    assert len(ran(place)) - len(before) == 40 - journal
    assert [int(row["number"]) for row in rows(place / "out")] == list(range(40))


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_ctrl_c(place):
    process = parent(place, "held")
    wait_until(lambda: len(ran(place)) >= 6)
    workers = workers_of(process.pid)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=20)[0] == "stopped: interrupted True\n"
    assert not any(alive(pid) for pid in workers)
    found = rows(place / "out")
    assert 4 <= len(found) < 40 and {row["status"] for row in found} == {"done"}
    result = run_sweep(sweep(40), place / "out", workers=2, work=sweep_work.counted)
    assert (result.done, result.kept) == (40, len(found))


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_stop_is_not_charged_to_the_variants(place):
    """After Ctrl-Z for longer than a variant may take, the worker, which went on, is asked once more."""
    process = parent(place, "brief")
    wait_until(lambda: len(ran(place)) >= 2)
    process.send_signal(signal.SIGSTOP)
    time.sleep(2.5)
    process.send_signal(signal.SIGCONT)
    assert process.communicate(timeout=60)[0] == "stopped:  False\n"
    assert {row["status"] for row in rows(place / "out")} == {"done"}


def test_waiting_takes_no_lock_of_a_future():
    """Ctrl-C amid `Future.done` leaves its lock held, and the sweep would wait for ever to end its workers."""

    class Finished:
        def add_done_callback(self, tell):
            tell(self)

        def done(self):
            raise AssertionError("must not be asked by who was told")

    window = Window(SimpleNamespace(submit=lambda *_: Finished()), 1, print)
    window.give([])
    future, tasks = window.take(1)
    assert isinstance(future, Finished) and tasks == []
    assert window.take(0.01) is None and not window.pending


def test_ctrl_c_while_a_task_is_handed_over_leaves_no_lock_held(monkeypatch):
    """It used to end `Condition.__enter__` with the lock taken, and the sweep waited for ever to end its workers."""
    enter = threading.Condition.__enter__
    begun = threading.Event()
    left = [1]

    def enter_and_interrupt(condition):
        entered = enter(condition)
        if left and threading.current_thread() is threading.main_thread():
            left.pop()
            signal.raise_signal(signal.SIGINT)
        return entered

    with ThreadPoolExecutor(1) as executor:
        executor.submit(int).result(20)  # its thread has started
        window = Window(executor, 1, lambda tasks: begun.wait(20))
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(threading.Condition, "__enter__", enter_and_interrupt)
            window.give([])
        assert not left, "it came amid the handing over"
        ((future, _),) = window.pending.values()
        begun.set()
        free = ThreadPoolExecutor(1).submit(future.result, 20)
        assert free.result(20) is True
    assert window.take(20) is not None


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_sigterm_ends_the_command_as_ctrl_c_does(place, tmp_path):
    (tmp_path / "many.toml").write_text(f"{HEAD}[axes]\nq_min = {{low = 10, high = 30, steps = 5000}}\n")
    command = [sys.executable, "-m", "padgen", "sweep", "many.toml", "-j", "2", "-o", "out", "--json"]
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *sys.path])}
    process = subprocess.Popen(
        command, cwd=tmp_path, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    done = sum('"kind": "done"' in process.stdout.readline() for _ in range(20))
    process.terminate()
    out, err = process.communicate(timeout=60)
    assert process.returncode == 2 and "interrupted; the same command goes on where it stopped" in err
    summary = json.loads(out.splitlines()[-1])
    assert done > 3 and summary["interrupted"] and summary["done"] == len(rows(tmp_path / "out")) >= done


def test_a_full_disk_stops_the_sweep_and_fails_no_variant(place):
    (place / "full").touch()
    result = run_sweep(sweep(8), place / "out", Inline(sweep_work.full))
    assert "No space left on device" in result.stopped and (result.done, result.failed, result.left) == (3, 0, 5)
    (place / "full").unlink()
    result = run_sweep(sweep(8), place / "out", Inline(sweep_work.full))
    assert (result.done, result.kept, result.stopped) == (8, 3, "")


def test_a_folder_that_is_removed_meanwhile_is_told(place):
    def remove(event):
        if event.done == 3 and event.kind == "done":
            shutil.rmtree(place / "out")

    with pytest.raises(FileError, match=r"index\.jsonl: was removed while the sweep ran"):
        run_sweep(sweep(8), place / "out", Inline(sweep_work.counted), on_event=remove)


def test_a_killed_run_leaves_no_index_of_what_is_replaced(place):
    """Once a variant is being replaced, index and front list nothing that is gone."""
    made = run_sweep(sweep(4), place / "out", Inline(sweep_work.counted))
    write_pareto(place / "out", "s", made.overview)
    assert (place / "out" / "pareto.csv").exists()
    seen = []

    def look(event):
        seen.append((event.kind, len(rows(place / "out")), (place / "out" / "pareto.csv").exists()))

    run_sweep(sweep(4, "stage = 'yield'"), place / "out", Inline(sweep_work.counted), on_event=look)
    assert seen[0] == ("start", 0, False)


def test_an_interrupted_caller_keeps_what_is_done(place):
    def interrupt(event):
        if event.done == 3 and event.kind == "done":
            raise KeyboardInterrupt

    result = run_sweep(sweep(30), place / "out", workers=2, work=sweep_work.slow, on_event=interrupt)
    assert result.interrupted and result.left == 30 - len(rows(place / "out")) > 10
    assert {row["status"] for row in rows(place / "out")} == {"done"}


class FullDisk(FileIO):
    """A file that takes some lines, then half of one, then none."""

    lines = 0

    def write(self, data):
        FullDisk.lines += 1
        if FullDisk.lines == 5:
            return super().write(data[:20])
        if FullDisk.lines > 5:
            raise OSError(28, "No space left on device")
        return super().write(data)


def test_disk_full(place, monkeypatch):
    from padgen.batch import index

    FullDisk.lines = 0
    monkeypatch.setattr(index, "FileIO", FullDisk)
    with pytest.raises(FileError, match=r"index.jsonl: cannot be written \(No space left on device\)"):
        run_sweep(sweep(), place / "out", Inline(sweep_work.tiny))
    assert [row["number"] for row in rows(place / "out")] == ["0", "1", "2", "3"]
    assert (place / "out" / "index.jsonl").read_bytes().endswith(b"}\n")
    monkeypatch.undo()
    assert run_sweep(sweep(), place / "out", Inline(sweep_work.tiny)).kept == 4


def test_the_index_cannot_be_written(place):
    (place / "out" / "index.csv" / "in the way").mkdir(parents=True)
    with pytest.raises(FileError, match=r"index.csv: cannot be written"):
        run_sweep(sweep(2), place / "out", Inline(sweep_work.tiny))
    (place / "out" / "index.csv" / "in the way").rmdir()
    (place / "out" / "index.csv").rmdir()
    assert run_sweep(sweep(2), place / "out", Inline(sweep_work.tiny)).kept == 2
    assert not list((place / "out").glob(".index*"))


@pytest.mark.parametrize("folder", ["file", "file/out", "/proc/out", "/sys/out"])
def test_a_folder_that_cannot_be_written(place, folder):
    (place / "file").write_text("in the way")
    with pytest.raises(FileError, match=r"out|file") as error:
        run_sweep(sweep(2), place / folder, Inline(sweep_work.tiny))
    assert "cannot be written to (" in str(error.value)


def test_a_variant_whose_folder_cannot_be_written(place):
    real = parse_sweep('name = "s"\nbase = "paper-32"\n[axes]\nq_min = [10, 12]\n')
    (place / "out").mkdir()
    (place / "out" / "s-00000").write_text("in the way")
    result = run_sweep(real, place / "out", Inline(run_task))
    assert (result.done, result.failed) == (1, 1)
    assert rows(place / "out")[0]["sentence"].startswith(f"{place}/out/s-00000: cannot be written to (")


def test_two_sweeps_into_one_folder(place):
    first = parent(place, "held")
    wait_until(lambda: len(ran(place)) >= 2)
    with pytest.raises(
        FileError, match=rf"another sweep writes into it \(process {first.pid} on .* since 20..-"
    ) as error:
        run_sweep(sweep(40), place / "out", Inline(sweep_work.counted))
    assert "wait until it has ended" in str(error.value)
    (place / "go").touch()
    first.communicate(timeout=60)
    assert sorted(ran(place)) == list(range(40)), "the second made nothing"
    assert run_sweep(sweep(40), place / "out", Inline(sweep_work.counted)).kept == 40


def test_the_lock_where_the_system_has_none(tmp_path, monkeypatch):
    def none(*arguments):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", none)
    with (
        sole_sweep(tmp_path),
        pytest.raises(FileError, match=r"another sweep .*remove \.lock"),
        sole_sweep(tmp_path),
    ):
        pass
    with sole_sweep(tmp_path):
        assert (tmp_path / ".lock").exists()
    assert not (tmp_path / ".lock").exists()


@pytest.mark.parametrize(
    "junk", [b'{"number": 2, "key": "ab', b"\n", b"null\n", b'{"number": 7}\n', b"\xff\xfe\n", b"[1]"]
)
def test_a_torn_journal(place, junk):
    run_sweep(sweep(4), place / "out", Inline(sweep_work.counted))
    with open(place / "out" / "index.jsonl", "ab") as file:
        file.write(junk)
    result = run_sweep(sweep(6), place / "out", Inline(sweep_work.counted))
    assert (result.kept, result.done) == (4, 6)
    assert sorted(ran(place)) == list(range(6))
    result = run_sweep(sweep(6), place / "out", Inline(sweep_work.counted))
    assert (result.kept, len(rows(place / "out"))) == (6, 6)


def test_a_spoiled_cache_entry_costs_nothing(place, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(place / "cache"))
    text = 'name = "s"\nbase = "paper-32"\nstage = "build"\nformats = "stl"\n[axes]\nq_min = [10]\n'
    run_sweep(parse_sweep(text), place / "out", Inline(run_task))
    first = (place / "out" / "s-00000" / "pad.stl").read_bytes()
    entries = [path for path in (place / "cache").rglob("*") if path.is_file()]
    for path in entries:
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 0xFF
        path.write_bytes(data)
    result = run_sweep(parse_sweep(text), place / "out2", Inline(run_task))
    assert entries and result.done == 1
    assert (place / "out2" / "s-00000" / "pad.stl").read_bytes() == first


def test_a_clock_that_jumps_back(place, monkeypatch):
    hour = iter(range(10**6))
    monkeypatch.setattr(time, "time", lambda: 1e9 - 3600.0 * next(hour))
    events = []
    result = run_sweep(sweep(4), place / "out", workers=2, work=sweep_work.slow, on_event=events.append)
    seconds = [event.seconds for event in events]
    assert result.done == 4 and seconds == sorted(seconds) and seconds[-1] < 60
    assert all(event.eta_s is None or 0 <= event.eta_s < 60 for event in events)


def test_an_executor_that_breaks_down_stops_the_sweep(place):
    """A caller's pool with a killed process takes no more tasks; the results so far are kept."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        pool.submit(os.getpid).result()

        def kill(event):
            if event.done == 3 and event.kind == "done":
                for pid in pool._processes:
                    os.kill(pid, signal.SIGKILL)

        result = run_sweep(sweep(30), place / "out", pool, work=sweep_work.slow, on_event=kill)
    assert "executor: has ended (BrokenProcessPool" in result.stopped and not result.interrupted
    assert 3 <= result.done < 30 and result.done + result.left == 30 and not result.failed
    assert run_sweep(sweep(30), place / "out", workers=2, work=sweep_work.counted).done == 30


@pytest.mark.parametrize(("error", "cancels"), [(BrokenExecutor("gone"), False), (CancelledError(), True)])
def test_a_pool_that_breaks_down_ends_its_futures_itself(place, error, cancels):
    """Its thread would die of a future that is cancelled while it sets its exception."""
    given = []

    class Pool:
        def submit(self, *_):
            given.append(Future())
            if len(given) == 2:
                given[0].set_exception(error)
            return given[-1]

    result = run_sweep(sweep(3), place / "out", Pool(), work=sweep_work.tiny)
    assert result.stopped and result.left == 3
    assert [future.cancelled() for future in given[1:]] == [cancels] * len(given[1:])


def test_an_executor_that_was_shut_down(place):
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    result = run_sweep(sweep(3), place / "out", pool, work=sweep_work.tiny)
    assert result.stopped == "executor: takes no more tasks (RuntimeError: cannot schedule new futures after shutdown)"
    assert result.left == 3


@pytest.mark.parametrize("error", [futures.CancelledError(), asyncio.CancelledError(), futures.BrokenExecutor("gone")])
def test_an_executor_that_cancels(place, error):
    class Ended:
        def submit(self, *anything):
            future = Future()
            future.set_exception(error)
            return future

    result = run_sweep(sweep(3), place / "out", Ended(), work=sweep_work.tiny)
    told = "BrokenExecutor: gone" if isinstance(error, futures.BrokenExecutor) else "it was shut down, or"
    assert result.stopped.startswith(f"executor: has ended ({told}") and result.left == 3


class Lossy:
    """An executor that loses every task of some variants; like submitit's, its futures have no callbacks."""

    def __init__(self, lost):
        self.lost = lost
        self.asked = []

    def submit(self, function, tasks, *rest):
        self.asked += [task.number for task in tasks]
        future = Future()
        if any(task.number in self.lost for task in tasks):
            future.set_exception(ModuleNotFoundError("No module named 'padgen'"))
        else:
            future.set_result([sweep_work.tiny(task) for task in tasks])

        class Job:
            done = future.done
            result = future.result

        return Job()


def test_a_lost_task_is_tried_once_more_and_alone(place):
    executor = Lossy({5})
    result = run_sweep(sweep(12), place / "out", executor, work=sweep_work.tiny, chunk=4)
    assert (result.done, result.failed) == (11, 1)
    assert executor.asked.count(5) == 2 and executor.asked.count(4) == 2 and executor.asked.count(1) == 1
    assert "its worker was lost (ModuleNotFoundError: No module named" in rows(place / "out")[5]["sentence"]


def test_an_executor_that_loses_everything_is_given_up(place):
    result = run_sweep(sweep(40), place / "out", Lossy(set(range(40))), work=sweep_work.tiny)
    assert "executor: does not make variants (ModuleNotFoundError" in result.stopped
    assert result.left == 40 and rows(place / "out") == []


def test_a_worker_that_does_not_start(place, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    result = run_sweep(sweep(4), place / "out", workers=2, work=sweep_work.tiny)
    assert "worker process: cannot be started (No such file" in result.stopped and result.left == 4
