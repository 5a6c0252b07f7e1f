"""Sweeps over foreign executors: a Dask cluster whose processes are killed, SLURM users' executors, threads.

Clusters are real, on the local host with ports that the system chooses. Each variant is made at least once and kept
exactly once, whatever is killed.
"""

import csv
import io
import logging
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from padgen.batch import sweep as sweep_module
from padgen.batch.definition import parse_sweep
from padgen.batch.sweep import connect, fingerprint, run_sweep
from padgen.batch.variant import run_task
from padgen.core.errors import EngineMissingError, PadgenError
from tests import sweep_work

ROOT = Path(__file__).parents[2]
COUNT = 40
FOREIGN = "padgen[dask] brings what the test needs"


def sweep(count: int = COUNT, more: str = "folders = false"):
    return parse_sweep(f'name = "s"\nbase = "paper-32"\n{more}\n[axes]\nq_min = {[10 + i / 8 for i in range(count)]}\n')


def rows(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO((folder / "index.csv").read_text())))


def ran(place: Path) -> list[int]:
    return [int(line) for line in (place / "ran").read_text().split()]


def check_whole(folder: Path, count: int = COUNT) -> None:
    """Check that every variant is done once, in the order of numbers, and that the journal agrees."""
    assert [(int(row["number"]), row["status"]) for row in rows(folder)] == [(i, "done") for i in range(count)]
    assert (folder / "index.jsonl").read_bytes().count(b'"number":') == count


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv(sweep_work.PLACE, str(tmp_path))
    return tmp_path


class Cluster:
    """A Dask scheduler and workers started as on the machines of a cluster."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack = stack
        self._folder = folder
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        self.address = self._told("scheduler", self.scheduler, r"Scheduler at: +(tcp://\S+)")

    def worker(self, name: str, *more: str, path: str = os.pathsep.join([str(ROOT), *filter(None, sys.path)])):
        return self._start(f"worker-{name}", self.address, "--nthreads", "1", "--no-dashboard", *more, path=path)

    def _start(self, name: str, *arguments: str, path: str = str(ROOT)) -> subprocess.Popen:
        env = os.environ | {"PYTHONPATH": path, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s"}
        env[sweep_work.PLACE] = str(self._folder)
        with open(self._folder / name, "w") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", name.partition("-")[0], *arguments],
                env=env,
                cwd=self._folder,
                stdout=log,
                stderr=log,
            )
        self._stack.callback(self._end, process)
        return process

    def _told(self, name: str, process: subprocess.Popen, pattern: str) -> str:
        end = time.monotonic() + 20
        while not (found := re.search(pattern, (self._folder / name).read_text())):
            assert process.poll() is None and time.monotonic() < end, (self._folder / name).read_text()
            time.sleep(0.05)
        return found[1]

    @staticmethod
    def _end(process: subprocess.Popen) -> None:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    pytest.importorskip("distributed", reason=FOREIGN)
    folder.mkdir(exist_ok=True)
    with ExitStack() as stack:
        yield Cluster(stack, folder)


class Collector(logging.Handler):
    def __init__(self, logged: list[logging.LogRecord]) -> None:
        super().__init__()
        self.emit = logged.append


def after(count: int, act):
    """Return an event listener that acts once, when `count` variants are done."""
    acted = []

    def listen(event) -> None:
        if event.done >= count and not acted:
            acted.append(event.done)
            act()

    listen.acted = acted
    return listen


@pytest.mark.soak
def test_workers_that_would_make_something_else_or_are_killed(place):
    """Tried are no worker at all, one with another padgen, one that is killed and one without padgen.

    The first has a nanny, which would start another; that which is killed has none and stays dead.
    """
    bare = place / "bare"
    bare.mkdir()
    (bare / "padgen.py").write_text("raise ModuleNotFoundError(\"No module named 'padgen'\")\n")
    with cluster(place / "cluster") as dask:
        sentence = rf"scheduler {dask.address}: has no worker; dask worker {dask.address} starts one"
        with pytest.raises(PadgenError, match=sentence), connect(dask.address, 0.5):
            pass
        dask.worker("a", "--nanny")
        for name, other, sentence in (
            (
                "numpy",
                "1.0.0",
                r"worker tcp://\S+: has numpy \S+, this machine 1\.0\.0; install the same version on both",
            ),
            ("PADGEN_PLUGINS", "0123", r"worker tcp://\S+: has other modules in PADGEN_PLUGINS than this machine"),
            ("padgen", "0123", r"worker tcp://\S+: has another padgen than this machine; install the same one on both"),
        ):
            mine = fingerprint() | {name: other}
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(sweep_module, "fingerprint", lambda mine=mine: mine)
                with pytest.raises(PadgenError, match=sentence), connect(dask.address, 20):
                    pass
        doomed = dask.worker("b", "--no-nanny")
        with connect(dask.address, 20) as executor:
            listen = after(8, lambda: os.kill(doomed.pid, signal.SIGKILL))
            result = run_sweep(sweep(), place / "out", executor, work=sweep_work.slow, on_event=listen)
        worker = dask.worker("bare", "--no-nanny", "--name", "bare", path=str(bare))
        with pytest.raises(
            PadgenError, match=r"worker tcp://\S+: cannot import padgen \(ModuleNotFoundError: No module"
        ):
            for _ in range(100):  # until it has come
                with connect(dask.address, 20):
                    time.sleep(0.1)
        assert worker.poll() is None
    assert listen.acted and doomed.returncode == -signal.SIGKILL
    assert (result.done, result.failed, result.left, result.stopped) == (COUNT, 0, 0, "")
    check_whole(place / "out")
    assert set(ran(place / "cluster")) == set(range(COUNT))


def test_a_cluster_makes_the_same_index_until_its_scheduler_is_killed(place, monkeypatch):
    """The sweep ends with a message, keeps its results, and goes on with a cluster or without any."""
    distributed = pytest.importorskip("distributed", reason=FOREIGN)
    logged: list[logging.LogRecord] = []

    def interrupt() -> None:
        raise KeyboardInterrupt

    with cluster(place / "cluster") as dask:
        dask.worker("a", "--no-nanny")
        with connect(dask.address, 20) as executor:
            result = run_sweep(sweep(6, ""), place / "there", executor)
            assert (result.done, result.left, result.stopped) == (6, 0, "")
            listen = after(5, interrupt)
            first = run_sweep(sweep(), place / "out", executor, work=sweep_work.slow, on_event=listen)
        assert first.interrupted and 5 <= first.done < COUNT
        # A caller's own executor of the same cluster, in bigger tasks; what is there already is kept.
        with distributed.Client(dask.address) as client:
            again = run_sweep(sweep(12, ""), place / "there", client.get_executor(pure=False), chunk=3)
        assert (again.kept, again.done) == (6, 12)
        monkeypatch.setattr(logging.getLogger("distributed.client"), "handlers", [Collector(logged)])
        with connect(dask.address, 20) as executor:
            listen = after(first.done + 5, lambda: os.kill(dask.scheduler.pid, signal.SIGKILL))
            start = time.monotonic()
            second = run_sweep(sweep(), place / "out", executor, work=sweep_work.slow, on_event=listen)
            assert time.monotonic() - start < 60
    assert second.stopped == "executor: has ended (it was shut down, or the connection to it was lost)"
    assert second.kept == first.done and first.done + 5 <= second.done < COUNT
    assert second.done + second.left == COUNT and not second.failed
    assert len(rows(place / "out")) == second.done
    assert not logged, "a sentence tells of it, no traceback of Dask's"
    last = run_sweep(sweep(), place / "out", workers=2, work=sweep_work.slow)
    assert (last.kept, last.done, last.left) == (second.done, COUNT, 0)
    check_whole(place / "out")
    here = run_sweep(sweep(12, ""), place / "here", sweep_work.Inline(run_task))
    assert here.done == 12
    measured = ("seconds", "peak_memory_mb")
    there, mine = (
        [{k: v for k, v in row.items() if k not in measured} for row in rows(place / f)] for f in ("there", "here")
    )
    assert there == mine
    assert (place / "there/s-00003/plan.json").read_bytes() == (place / "here/s-00003/plan.json").read_bytes()


@pytest.mark.parametrize(
    "address, sentence",
    [
        ("tcp://127.0.0.1:1", "does not answer within 1 s; is it running?"),
        ("127.0.0.1", "cannot be used"),
        ("", "cannot be used"),
        ("nonsense://x:1", "cannot be used"),
        ("tcp://127.0.0.1:port", "cannot be used"),
    ],
)
def test_no_scheduler_there(address, sentence):
    pytest.importorskip("distributed", reason=FOREIGN)
    with pytest.raises(PadgenError) as error, connect(address, 1):
        pass
    assert str(error.value).startswith(f"scheduler {address}: {sentence}") and "\n" not in str(error.value)


def test_something_else_listens_there():
    pytest.importorskip("distributed", reason=FOREIGN)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(PadgenError, match=f"scheduler {address}: does not answer within 1 s"), connect(address, 1):
            pass


def test_without_dask(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    sentence = r"scheduler tcp://x:1: needs the package distributed \(.*\); pip install 'padgen\[dask\]' brings it"
    with pytest.raises(EngineMissingError, match=sentence), connect("tcp://x:1"):
        pass


def test_threads(place):
    with ThreadPoolExecutor(2) as executor:
        result = run_sweep(sweep(6), place / "out", executor, work=sweep_work.counted, chunk=2)
    assert (result.done, sorted(ran(place))) == (6, list(range(6)))
    check_whole(place / "out", 6)


@pytest.mark.soak
def test_submitit(place):
    submitit = pytest.importorskip("submitit", reason="submitit is not installed")
    executor = submitit.AutoExecutor(folder=place / "jobs", cluster="local")
    executor.update_parameters(timeout_min=2, cpus_per_task=1)
    result = run_sweep(sweep(4), place / "out", executor, work=sweep_work.counted, chunk=2)
    assert (result.done, result.stopped, sorted(ran(place))) == (4, "", list(range(4)))
    check_whole(place / "out", 4)


@pytest.mark.soak
def test_executorlib(place):
    executorlib = pytest.importorskip("executorlib", reason="executorlib is not installed")
    with executorlib.SingleNodeExecutor(max_workers=1) as executor:
        result = run_sweep(sweep(4), place / "out", executor, work=sweep_work.counted, chunk=2)
    assert (result.done, result.stopped, sorted(ran(place))) == (4, "", list(range(4)))
    check_whole(place / "out", 4)
