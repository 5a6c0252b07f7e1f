"""The one runner of child processes: their results, the ways they end, and that none is left behind."""

import ctypes
import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

from padgen.core import runner
from padgen.core.errors import EngineMissingError, InfeasibleError, PadgenError, SolverError
from padgen.core.runner import Runner

ROOT = Path(__file__).parents[2]
SLEEPS = [sys.executable, "-c", "import time; time.sleep(60)"]


# What workers do: functions of a module, since they run in other processes.


def process_of() -> int:
    return os.getpid()


def environment(name: str) -> str | None:
    return os.environ.get(name)


def raises(error: BaseException):
    raise error


def unsendable():
    return lambda: None


def dies(of: int):
    os.kill(os.getpid(), of)


def leaves(code: int, last_words: bytes = b""):
    os.write(2, b"something\n" + last_words + b"\n")
    os._exit(code)


def sleeps(seconds: float):
    time.sleep(seconds)


def grows():
    hoard = []
    while True:
        hoard.append(b"x" * 5_000_000)
        time.sleep(0.001)


def child_holds(megabytes: int, seconds: float):
    """Hold memory in a child of the worker."""
    code = f"import time; held = b'x' * {megabytes * 10**6}; print(1, flush=True); time.sleep({seconds})"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as child:
        child.stdout.readline()
        time.sleep(seconds)
        return child.pid


def holds(megabytes: int) -> int:
    return len(b"x" * (megabytes * 10**6))


def loads(name: str) -> str:
    return importlib.import_module(name).__name__


def prints():
    print("by Python", flush=True)
    os.write(1, b"by any way")
    os.write(2, b"x" * 1_000_000)
    subprocess.run([sys.executable, "-c", "print('by a child')"], check=True)
    return sys.stdin.read()


def forks_and_dies(path: Path):
    """Fork a process, which holds all that its parent has open and would live on, and crash."""
    if os.fork() == 0:
        path.write_text(str(os.getpid()))
        time.sleep(60)
        os._exit(0)
    while not path.exists() or not path.read_text():
        time.sleep(0.01)
    os.kill(os.getpid(), signal.SIGSEGV)


def has_family():
    """Start a child and a nested worker that holds Python's lock, then hold the lock here, too."""
    with Runner() as nested, subprocess.Popen(SLEEPS):
        nested.submit(holds_the_lock)
        while len(psutil.Process().children()) < 2:
            time.sleep(0.01)
        time.sleep(0.3)
        holds_the_lock()


def holds_the_lock():
    ctypes.PyDLL(None).sleep(60)


def wait_until(condition, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)


def alive(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.fixture(scope="module")
def shared():
    with Runner() as one:
        yield one


@pytest.fixture
def started():
    """A function that returns the living processes started since the test began."""
    before = set(psutil.Process().children(recursive=True))
    return lambda: set(psutil.Process().children(recursive=True)) - before


# What comes back


def test_workers_are_used_again(shared):
    answers = [shared.run(process_of) for _ in range(3)]
    assert {answer.kind for answer in answers} == {"value"} and not any(answer.sentence for answer in answers)
    assert len({answer.value for answer in answers} - {os.getpid()}) == 1
    assert all(0 <= answer.seconds < 5 and answer.peak_mb > 5 for answer in answers)


def test_as_many_workers_as_threads(started):
    with Runner(2) as own:
        jobs = [own.submit(sleeps, 0.05) for _ in range(6)] + [own.submit(process_of) for _ in range(4)]
        assert len({job.result().value for job in jobs} - {None}) <= 2 == len(started())
    assert not started()


@pytest.mark.parametrize("kind", [PadgenError, SolverError, EngineMissingError, InfeasibleError])
def test_exceptions_keep_their_class_code_and_sentence(shared, kind):
    answer = shared.run(raises, kind("needs 3 mm", "taxel"))
    assert (answer.kind, answer.value, type(answer.error)) == ("refused", None, kind)
    assert (answer.error.code, answer.error.message, answer.error.where) == (kind.code, "needs 3 mm", "taxel")
    assert answer.sentence == "taxel: needs 3 mm" and answer.seconds >= 0


@pytest.mark.parametrize(
    "work, sentence",
    [
        ((raises, ValueError("two\n lines")), "broke down (ValueError: two lines)"),
        ((raises, SystemExit(3)), "broke down (SystemExit: 3)"),
        ((raises, KeyboardInterrupt()), "broke down (KeyboardInterrupt)"),
        ((raises, MemoryError()), "broke down (MemoryError: not enough memory for it)"),
        ((unsendable,), "broke down (AttributeError: Can't pickle local object"),
        ((lambda: None,), "broke down (PicklingError: Can't pickle"),
        ((holds, "many"), "broke down (TypeError"),
    ],
)
def test_whatever_breaks_down_costs_the_job_and_not_the_worker(shared, work, sentence):
    before = shared.run(process_of).value
    answer = shared.run(*work)
    assert answer.kind == "failed" and isinstance(answer.error, SolverError)
    assert answer.sentence.startswith(sentence) and "\n" not in answer.sentence
    assert shared.run(process_of).value == before


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "work, sentence",
    [
        ((dies, signal.SIGKILL), "its process was killed (signal 9), most likely by the system for lack of memory"),
        ((dies, signal.SIGABRT), "its process died of signal 6 (SIGABRT)"),
        ((dies, signal.SIGTERM), "its process died of signal 15 (SIGTERM)"),
        ((dies, signal.SIGRTMIN + 1), f"its process died of signal {signal.SIGRTMIN + 1}"),
        ((leaves, 3, b"no licence"), "its process ended with code 3 (no licence)"),
        ((leaves, 0), "its process ended with code 0 (something)"),
    ],
)
def test_a_death_is_told_and_another_worker_takes_over(shared, work, sentence):
    before = shared.run(process_of).value
    start = time.monotonic()
    answer = shared.run(*work)
    assert (answer.kind, answer.sentence, answer.limit) == ("failed", sentence, "")
    assert answer.seconds < time.monotonic() - start < 20
    assert shared.run(process_of).value not in (None, before)


@pytest.mark.parametrize("line", [True, False])
def test_what_a_worker_forked_ends_with_it_and_does_not_keep_its_end_from_being_heard(line, tmp_path, monkeypatch):
    """This holds also without help from the system (all but Linux)."""
    if not line:
        monkeypatch.setattr(runner, "_is_life_line", lambda descriptor: False)
    start = time.monotonic()
    with Runner() as own:
        assert own.run(forks_and_dies, tmp_path / "pid").sentence == "its process died of signal 11 (SIGSEGV)"
    wait_until(lambda: not alive(int((tmp_path / "pid").read_text())))
    assert time.monotonic() - start < 20


def test_what_was_printed_for_another_job_tells_nothing(shared):
    shared.run(prints)
    assert shared.run(os._exit, 3).sentence == "its process ended with code 3"


def test_output_does_not_mix_and_input_is_empty(shared, capfd):
    for _ in range(2):
        assert shared.run(prints).value == ""
    assert capfd.readouterr() == ("", "")


# Limits


def test_limit_of_time(shared):
    start = time.monotonic()
    answer = shared.run(sleeps, 60, time_s=0.2)
    assert (answer.kind, answer.sentence, answer.limit) == ("failed", "took longer than 0.2 s", "time_s")
    assert 0.2 <= answer.seconds <= time.monotonic() - start < 20
    assert shared.run(sleeps, 0.2, time_s=20).kind == "value"


def test_limit_of_memory(shared):
    answer = shared.run(grows, most_mb=200)
    assert (answer.sentence, answer.limit) == ("took more than 200 MB", "memory_mb")
    assert 200 < answer.peak_mb < 1000


def test_limit_of_memory_holds_for_what_the_job_starts(shared, started):
    before = shared.run(process_of).value
    answer = shared.run(child_holds, 300, 60, most_mb=200)
    assert answer.limit == "memory_mb" and answer.peak_mb > 200
    assert not alive(before) and not started()


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="elsewhere the peak is the worker's of all jobs")
def test_a_job_that_is_not_wanted_any_more_is_ended_with_its_worker(started):
    with Runner() as own:
        wanted = threading.Event()
        wanted.set()
        job = own.submit(sleeps, 60, wanted=wanted.is_set)
        waits = own.submit(sleeps, 60, wanted=wanted.is_set)
        wait_until(started)
        (worker,) = started()
        wanted.clear()
        assert (job.result(20).kind, job.result().limit) == ("failed", "wanted")
        assert waits.result(20).limit == "wanted"
        wait_until(lambda: not alive(worker.pid))
        assert own.run(process_of, wanted=lambda: True).kind == "value"


def tells(steps: list[str]):
    for step in steps:
        runner.tell(step)
    return len(steps)


def test_the_steps_of_a_job_are_heard_in_order(shared):
    heard = []
    steps = ["modelling", "", "x" * 100_000]
    assert shared.run(tells, steps, hear=heard.append).value == 3
    assert heard == steps
    assert shared.run(tells, steps).value == 3
    assert tells(steps) == 3  # outside a worker nobody hears


def test_as_many_workers_are_prepared_as_are_lacking(started):
    with Runner(2) as own:
        for _ in range(2):
            own.prepare(2)
            own.threads.submit(int).result(20)
            wait_until(lambda: len(started()) == 2)
        assert own.run(dies, signal.SIGKILL).kind == "failed"
        assert len(started()) == 1
        own.prepare(2)
        wait_until(lambda: len(started()) == 2)


def test_peaks_are_the_jobs_own_and_of_all_its_processes(shared):
    bare = shared.run(process_of).peak_mb
    # 100 MB held for a moment by the worker, or by another process for long enough to be seen.
    assert shared.run(holds, 100).peak_mb == pytest.approx(bare + 100, abs=10)
    assert shared.run(process_of).peak_mb == pytest.approx(bare, abs=10)
    assert shared.run(child_holds, 100, 0.5).peak_mb > bare + 100


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="elsewhere the peak counts from the start")
def test_the_peak_of_this_process_counts_anew():
    # In a process of its own: one that has run other tests may give memory back meanwhile.
    code = (
        "from padgen.core import runner; runner.reset_peak(); before = runner.peak_mb(); held = b'x' * 240_000_000;"
        " grown = runner.peak_mb(); del held; runner.reset_peak(); print(before, grown, runner.peak_mb())"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60).stdout
    before, grown, again = map(float, told.split())
    assert grown > before + 200
    assert again < before + 100


def test_a_worker_that_has_grown_is_replaced():
    with Runner() as own:
        first, second = (own.run(process_of, most_mb=4000).value for _ in range(2))
        # It holds more than 5 MB, and answers before its memory is looked at.
        assert own.run(process_of, most_mb=10).value == first == second
        assert own.run(process_of, most_mb=4000).value != first
        wait_until(lambda: not alive(first))


# Workers' conditions


def test_one_thread_and_a_share_of_the_cores():
    with Runner(2) as own:
        assert own.run(environment, "OMP_NUM_THREADS").value == "1"
        assert int(own.run(environment, "PADGEN_PROCESSES").value) == max(runner.core_count() // 2, 1)


def test_what_has_changed_is_seen(tmp_path, monkeypatch):
    """Environment, working folder and module path are passed on, also from a folder with an odd name."""
    odd = tmp_path / f"odd{os.pathsep}näme\udcff"
    odd.mkdir()
    (odd / "only_there.py").write_text("def answer(): return 42\n")
    with Runner() as own:
        first = own.run(process_of).value
        monkeypatch.setenv("PADGEN_TEST", "new")
        assert own.run(environment, "PADGEN_TEST").value == "new"
        monkeypatch.syspath_prepend(odd)
        from only_there import answer

        assert own.run(answer).value == 42
        monkeypatch.chdir(tmp_path)
        assert own.run(os.getcwd).value == str(tmp_path)
        wait_until(lambda: not alive(first))


def test_a_removed_working_folder(tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with Runner() as own:
        assert own.run(process_of).kind == "value"


def test_modules_are_loaded_before_the_clock_and_a_missing_one_is_left_to_the_job(tmp_path, monkeypatch):
    (tmp_path / "slow_to_load.py").write_text("import time; time.sleep(2)\n")
    monkeypatch.syspath_prepend(tmp_path)
    with Runner(imports=("slow_to_load", "no_such_module")) as own:
        answer = own.run(loads, "slow_to_load")
        assert answer.value == "slow_to_load" and answer.seconds < 2


def test_a_worker_that_cannot_be_started(tmp_path, monkeypatch, started):
    with monkeypatch.context() as patch, Runner() as own:
        patch.setattr(sys, "executable", "/nowhere/python")
        with pytest.raises(SolverError, match=r"^worker process: cannot be started \(No such file or directory\)$"):
            own.run(process_of)
    (tmp_path / "padgen.py").write_text("raise RuntimeError('spoiled')\n")
    with monkeypatch.context() as patch, Runner() as own:
        patch.setattr(sys, "path", [str(tmp_path)])
        own.prepare(1)
        with pytest.raises(SolverError, match=r"^worker process: cannot start \(RuntimeError: spoiled\)$"):
            own.run(process_of)
    assert not started()


# Ends


def test_idle_workers_that_have_ended_cost_no_job(started):
    with Runner(3) as own:
        for job in [own.submit(sleeps, 0.1) for _ in range(3)]:
            job.result()
        workers = started()
        for worker in workers:
            worker.suspend()  # so that their ends are not known yet when they are asked
        threading.Timer(0.2, lambda: [worker.kill() for worker in workers]).start()
        assert own.run(process_of).kind == "value"


def test_new_workers_that_end_before_their_first_job_cost_no_job(monkeypatch):
    """A busy machine may give the parent no time until a worker has waited for longer than `idle_s`."""
    ready = Runner._ready
    late = []

    def ready_but_late(own, worker):
        ready(own, worker)
        if not late:
            late.append(worker.pid)
            wait_until(lambda: not alive(worker.pid))
        return worker

    monkeypatch.setattr(Runner, "_ready", ready_but_late)
    with Runner(idle_s=0.3) as own:
        assert own.run(process_of).value not in (None, *late)


def test_idle_workers_end_by_themselves():
    code = (
        "from tests.core.test_runner import *\nown = Runner(idle_s=0.1)\nfirst = own.run(process_of).value\n"
        "wait_until(lambda: not alive(first))\nassert own.run(process_of).value not in (None, first)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env=ENVIRONMENT, cwd=ROOT)


@pytest.mark.parametrize("busy", [True, False])
def test_closing_ends_everything_at_once(busy, tmp_path, monkeypatch, started):
    (tmp_path / "very_slow_to_load.py").write_text("import time; time.sleep(60)\n")
    monkeypatch.syspath_prepend(tmp_path)
    start = time.monotonic()
    with Runner(2, () if busy else ("very_slow_to_load",)) as own:
        jobs = [own.submit(sleeps, 60) for _ in range(3)]
        wait_until(lambda: len(started()) == 2)
        time.sleep(0.1)
    assert time.monotonic() - start < 20 and not started()
    assert all(job.done() for job in jobs)
    with pytest.raises(SolverError, match="was ended"):
        own.run(process_of)


def test_ctrl_c_is_the_parents(shared):
    assert shared.run(signal.raise_signal, signal.SIGINT).kind == "value"
    worker = shared.run(process_of).value
    assert os.getsid(worker) == worker != os.getsid(0)


ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
PARENT = """
from tests.core.test_runner import *
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # where nohup runs these tests, it is ignored
with Runner() as own:
    try:
        own.run(has_family)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""
FORGETS = """
from tests.core.test_runner import *
own = Runner()
own.threads.submit(own.run, has_family)
sys.stdin.read()
os._exit(0)
"""


@pytest.mark.sample(3)
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere what holds Python's lock lives on until it is free")
@pytest.mark.parametrize(
    "code, end, told",
    [
        (PARENT, signal.SIGINT, "interrupted\n"),
        (PARENT, signal.SIGTERM, ""),
        (PARENT, signal.SIGKILL, ""),
        (PARENT, signal.SIGHUP, ""),
        (FORGETS, None, ""),
    ],
)
def test_workers_and_what_they_started_end_with_their_parent(code, end, told):
    """A worker, its child and its own worker end; both workers hold Python's lock."""
    command = [sys.executable, "-c", code]
    with subprocess.Popen(
        command, env=ENVIRONMENT, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        family = []

        def is_complete() -> bool:
            family[:] = psutil.Process(parent.pid).children(recursive=True)
            return len(family) == 3

        wait_until(is_complete)
        time.sleep(0.5)  # until both hold the lock
        if end:
            parent.send_signal(end)
        assert parent.communicate(timeout=20)[0] == told
    wait_until(lambda: not any(alive(member.pid) for member in family), 5)
