"""Run functions in processes of their own: the only code that starts, feeds, watches and ends processes.

A worker is a fresh interpreter that talks over its pipes and lives on from job to job, so that numpy, a CAD
kernel or an engine is loaded once. What breaks down in it, what the system kills and what takes too long or
too much memory costs the job that it was on and nothing else. It needs no ``multiprocessing``, hence neither a
guarded ``__main__`` nor a parent that may have children: it also works inside the workers of a cluster.

- Ctrl-C is the parent's to handle: workers are in sessions of their own.
- Workers end with their parent, however it ends: on Linux the system kills them when a pipe that the parent
  holds is closed, elsewhere a thread waits for that, which code that keeps Python's lock holds up.
- Limits are watched from outside, as such code would hold up a watching thread, too; by resident memory, as a
  limit on addresses (``RLIMIT_AS``) also counts what OpenBLAS and OCCT only reserve.
"""

import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from importlib import import_module
from io import BufferedReader, BufferedWriter
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryFile
from threading import Lock, Thread, current_thread, main_thread
from time import perf_counter
from types import TracebackType
from typing import IO, Any

from padgen.core.errors import PadgenError, SolverError, SpecError, number
from padgen.core.registry import PLUGINS, registered_names

__all__ = [
    "Answer",
    "Runner",
    "core_count",
    "memory_mb",
    "peak_mb",
    "refuse_unshared",
    "reset_peak",
    "serve",
    "uninterrupted",
]

ONE_THREAD = dict.fromkeys(
    (
        "OPENBLAS_NUM_THREADS",
        "OMP_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NGS_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
    ),
    "1",
)
"""Environment of a process beside others: threads inside them would only get in each other's way."""
PROCESSES = "PADGEN_PROCESSES"
"""Environment variable: how many processes of its own a process may use at a time; all cores by default."""
START = "import json, sys; sys.path[:], *rest = json.loads(sys.argv[1]); import padgen.core.runner as r; r.serve(*rest)"
WATCH_S, MOST_LOOKS = 0.05, 10
"""Seconds between two looks at what a job takes, and for how many such looks one may count at most."""
IDLE_S = 120.0
"""After which a worker without work ends; a cluster's would outlive the sweep otherwise."""
HEAD, LAST_BYTES = 8, 4096
"""Bytes of a message's length before it, and of the end of what was printed."""
SIGN = b""
"""Message without content: a worker has started, or has taken a job; to a worker: it may end."""
WHERE = "worker process"


@dataclass(frozen=True, slots=True)
class Answer:
    """What came of a job.

    `kind` is 'value'; 'refused': the function raised `error`, a `PadgenError` of its own class; or 'failed': it
    broke down, its process died, or it exceeded `limit` ('time_s' or 'memory_mb'), and `error` says so. `seconds`
    and `peak_mb` (10⁶ bytes, of the worker and all that it started) are its own; None where nobody measured.
    """

    kind: str
    value: Any = None
    error: PadgenError | None = None
    seconds: float | None = None
    peak_mb: float | None = None
    limit: str = ""

    @property
    def sentence(self) -> str:
        """Why there is no value, empty where there is one."""
        return str(self.error or "")


class Runner:
    """Workers, started as they are needed and used again; a context manager that ends them.

    There are as many as threads call `run` at a time; `threads` has `workers` for that. They load the modules
    named in `imports` as they start, before any limit counts; what cannot be loaded is for the job to tell. Each
    may use its share of the cores for processes of its own.
    """

    def __init__(self, workers: int = 1, imports: tuple[str, ...] = ()) -> None:
        self.threads = ThreadPoolExecutor(workers)
        self._cores, self._imports = max(core_count() // workers, 1), imports
        self._lock = Lock()
        self._idle: list[_Worker] = []
        self._all: set[_Worker] = set()
        self._closed = False

    def __enter__(self) -> "Runner":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def run(self, function: Callable[..., Any], *arguments: Any, time_s: float = inf, most_mb: float = inf) -> Answer:
        """Call a function of a module in a worker and wait for its answer; everything must pickle.

        Raises
        ------
        SolverError
            The runner is closed, or a worker's interpreter cannot be started or cannot import padgen.
        """
        try:
            job = pickle.dumps((function, arguments))
        except Exception as error:
            return _broken(error)
        while True:
            worker = self._taken()
            try:
                answer = worker.ask(job, time_s, most_mb)
            except BaseException:
                worker.kill()
                raise
            finally:
                self._give_back(worker, most_mb)
            if answer is not None:
                return answer

    def submit(self, function: Callable[..., Any], *arguments: Any, **limits: float) -> "Future[Answer]":
        """Let a thread `run` it."""
        return self.threads.submit(self.run, function, *arguments, **limits)

    def prepare(self, count: int) -> None:
        """Start workers for what is to come without waiting; where none starts, what comes will tell."""

        def start() -> None:
            with suppress(PadgenError):
                self._give_back(self._taken(), inf)

        for _ in range(count):
            self.threads.submit(start)

    def close(self) -> None:
        """End all workers, whatever they are doing."""
        with self._lock:
            self._closed = True
            workers, self._all, self._idle = self._all, set(), []
        for worker in workers:
            worker.kill()
        self.threads.shutdown(cancel_futures=True)

    def _taken(self) -> "_Worker":
        """A worker for a job: an idle one that was started as it would be now, or a new one."""
        conditions = _conditions(self._imports)
        with self._lock:
            while self._idle:
                worker = self._idle.pop()
                if worker.conditions == conditions and not worker.ended:
                    return worker
                worker.retire()
                self._all.discard(worker)
            if self._closed:
                raise SolverError("was ended", WHERE)
            worker = _Worker(conditions, self._cores)
            self._all.add(worker)  # before it is ready, as it may have to be ended until then
        try:
            worker.wait()
        except SolverError:
            with self._lock:
                self._all.discard(worker)
            raise
        return worker

    def _give_back(self, worker: "_Worker", most_mb: float) -> None:
        """Let a worker be used again, unless what libraries have kept in it would be charged to the next job."""
        grown = most_mb < inf and memory_mb(worker.pid) > most_mb / 2
        with self._lock:
            if not (grown or worker.ended or self._closed):
                worker.rested = True
                self._idle.append(worker)
                return
            self._all.discard(worker)
        worker.retire()


class _Worker:
    """The parent's end of one worker, which is started under `conditions` (`_conditions`)."""

    def __init__(self, conditions: tuple[Any, ...], cores: int) -> None:
        self.conditions = conditions
        environment, _, path, imports = conditions
        with ExitStack() as ends:
            try:
                # What libraries print; its last line may tell why the process ended.
                self._log = ends.enter_context(TemporaryFile(buffering=0))
                life, own = os.pipe()
                ends.callback(os.close, own)
                try:
                    self._process = subprocess.Popen(
                        [sys.executable, "-P", "-c", START, json.dumps([path, imports, life])],
                        stdin=subprocess.PIPE,
                        stdout=subprocess.PIPE,
                        stderr=self._log,
                        env=environment | ONE_THREAD | {PROCESSES: str(cores)},
                        pass_fds=[life] if _is_life_line(life) else (),
                        start_new_session=True,  # Ctrl-C is the parent's to handle; on Windows by the next line
                        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
                    )
                finally:
                    os.close(life)
            except OSError as error:
                raise SolverError(f"cannot be started ({error.strerror or error})", WHERE) from error
            self._ends = ends.pop_all()
        self.pid = self._process.pid
        self.rested, self._last_line = False, ""
        self._lock = Lock()
        self._words: SimpleQueue[bytes | None] = SimpleQueue()
        self._listener = Thread(target=self._listen, daemon=True)
        self._listener.start()

    def wait(self) -> None:
        """Wait until it is ready.

        Raises
        ------
        SolverError
            It has ended instead.
        """
        if self._words.get() is None:
            raise SolverError(f"cannot start ({self._last_line or f'exit code {self._process.returncode}'})", WHERE)

    def ask(self, job: bytes, time_s: float, most_mb: float) -> Answer | None:
        """The answer to a pickled job; None where this worker, `rested`, had ended before it took the job.

        It is ended when it takes more than it may.
        """
        taken, peak, spent_s, start = False, 0.0, 0.0, perf_counter()
        looked = start
        with suppress(OSError, ValueError):  # it has ended, which will be heard
            self._log.seek(0)  # which is the worker's place in it, too
            self._log.truncate()
            _send(self._in, job)
        while True:
            try:
                word = self._words.get(timeout=WATCH_S)
            except Empty:
                peak = max(peak, memory_mb(self.pid))
                # Not more than a few looks' worth, as this process may have been stopped meanwhile.
                now = perf_counter()
                spent_s, looked = spent_s + min(now - looked, MOST_LOOKS * WATCH_S), now
                if answer := _excess(spent_s, time_s, peak, most_mb):
                    self.kill()
                    return replace(answer, seconds=now - start, peak_mb=peak or None)
                continue
            if word is None:
                if self.rested and not taken:
                    return None
                return Answer("failed", None, SolverError(self._why()), perf_counter() - start, peak or None)
            if taken:
                answer = _unpickled(word)
                return replace(answer, peak_mb=max(peak, answer.peak_mb or 0.0) or None)
            taken = True

    @property
    def ended(self) -> bool:
        """Whether its process is known to have ended."""
        return self._process.returncode is not None

    def retire(self) -> None:
        """Ask it to end when it has answered everything."""
        with suppress(OSError, ValueError):
            _send(self._in, SIGN)

    def kill(self) -> None:
        """End it, and what it started."""
        with self._lock:
            if not self.ended:
                _end_family(self.pid)
        self._listener.join()

    @property
    def _in(self) -> IO[bytes]:
        assert self._process.stdin
        return self._process.stdin

    def _listen(self) -> None:
        stream = self._process.stdout
        assert stream
        with stream:
            while (word := _received(stream)) is not None:
                self._words.put(word)
        with self._lock:
            _end_family(self.pid)  # before its number is given back
            self._process.wait()
        with suppress(OSError):
            self._in.close()
        self._log.seek(max(self._log.seek(0, os.SEEK_END) - LAST_BYTES, 0))
        self._last_line = self._log.read().decode(errors="replace").strip().rpartition("\n")[2]
        self._ends.close()
        self._words.put(None)

    def _why(self) -> str:
        """Why it does not answer any more."""
        code = self._process.returncode
        if code == -9:
            return "its process was killed (signal 9), most likely by the system for want of memory"
        if code < 0:
            name = next((f" ({one.name})" for one in signal.Signals if one == -code), "")
            return f"its process died of signal {-code}{name}"
        return f"its process ended with code {code}" + (f" ({self._last_line})" if self._last_line else "")


def refuse_unshared() -> None:
    """Raise for a suspension or drive scheme that was registered here and that workers do not know; asks one of them.

    Raises
    ------
    SpecError
        There is one; the sentence says how workers would know it.
    """
    here = registered_names()
    if not any(here.values()):
        return
    with Runner() as runner:
        there = runner.run(registered_names).value or {}
    for kind, names in here.items():
        for name in names:
            if name not in there.get(kind, ()):
                advice = f"register it in a module, and name that in the environment variable {PLUGINS}"
                raise SpecError(f"the {kind} {name!r} is known to this process alone, not to its workers; {advice}")


def core_count() -> int:
    """Cores that this process may use."""
    named = os.environ.get(PROCESSES, "")
    if named.isdecimal() and int(named):
        return int(named)
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ignore Ctrl-C meanwhile, where this is the thread that gets it."""
    if current_thread() is not main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def memory_mb(pid: int) -> float:
    """Resident memory of a process and of all that it started, MB (10⁶ bytes); 0 where the system does not tell."""
    import psutil

    total = 0
    for process in _family(pid):
        with suppress(psutil.Error):
            total += process.memory_info().rss
    return total / 1e6


def reset_peak() -> None:
    """Let the peak count from now on, where the system can (Linux)."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_bytes(b"5")


def peak_mb() -> float | None:
    """Peak resident memory of this process in MB (10⁶ bytes); None where the system does not tell."""
    with suppress(OSError):
        # ru_maxrss would start with what the parent held.
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ImportError:
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def _family(pid: int) -> list[Any]:
    """A process (`psutil.Process`) and all that descend from it; none where it has ended."""
    import psutil

    found: list[Any] = []
    with suppress(psutil.Error):
        found.append(psutil.Process(pid))
        for process in found:
            found += _children(process)
    return found


def _children(process: Any) -> list[Any]:
    import psutil

    found: list[Any] = []
    with suppress(psutil.Error, OSError):
        if sys.platform != "linux":
            return list(process.children())
        # Looked at often, and psutil would read what every process of the machine tells of its parent.
        for thread in Path(f"/proc/{process.pid}/task").iterdir():
            for child in (thread / "children").read_text().split():
                with suppress(psutil.Error):
                    found.append(psutil.Process(int(child)))
    return found


def _end_family(pid: int) -> None:
    """End a process that nobody has waited for yet, its group, and all that descend from it."""
    import psutil

    family = _family(pid)
    with suppress(OSError, AttributeError):  # Windows has no groups
        os.killpg(pid, signal.SIGKILL)
    for process in family:
        with suppress(psutil.Error):
            process.kill()


def _excess(seconds: float, time_s: float, used_mb: float, most_mb: float) -> Answer | None:
    if seconds > time_s:
        return Answer("failed", error=SolverError(f"took longer than {number(time_s)} s"), limit="time_s")
    if used_mb > most_mb:
        return Answer("failed", error=SolverError(f"took more than {number(most_mb)} MB"), limit="memory_mb")
    return None


def _broken(error: BaseException) -> Answer:
    text = "not enough memory for it" if isinstance(error, MemoryError) else " ".join(str(error).split())
    return Answer("failed", error=SolverError(f"broke down ({type(error).__name__}: {text}".rstrip(": ") + ")"))


def _conditions(imports: tuple[str, ...]) -> tuple[Any, ...]:
    """Whatever a worker is started with: environment, working folder, where modules are found, which are loaded."""
    folder = None
    with suppress(OSError):  # it was removed
        folder = Path.cwd()
    return dict(os.environ), folder, [entry for entry in sys.path if isinstance(entry, str)], imports


def _is_life_line(descriptor: int) -> bool:
    """Whether a worker can use our pipe: on Linux, and clear of the standard streams, which it replaces."""
    return sys.platform == "linux" and descriptor > 2


def serve(imports: list[str], life: int) -> None:
    """In the worker: answer until there is nobody left who asks.

    `life` is the end of a pipe that its parent holds the other end of.
    """
    questions, answers = _private_pipes()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    waiting: SimpleQueue[bytes] = SimpleQueue()

    def follow() -> None:
        while (question := _received(questions)) is not None:
            waiting.put(question)
        # The parent is gone: what is still computed nobody waits for, here and in processes of ours.
        with suppress(OSError, AttributeError):
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    Thread(target=follow, daemon=True).start()
    if _is_life_line(life):
        import fcntl

        with suppress(OSError):  # the system lacks it: `follow` ends us
            fcntl.fcntl(life, fcntl.F_SETSIG, signal.SIGKILL)
            fcntl.fcntl(life, fcntl.F_SETOWN, -os.getpgrp())
            fcntl.fcntl(life, fcntl.F_SETFL, os.O_ASYNC)
    with suppress(AttributeError):  # Windows
        # Else our own end would not be heard as long as a process that was forked here lives.
        os.register_at_fork(after_in_child=answers.raw.close)
    for name in imports:
        with suppress(Exception):
            import_module(name)
    _send(answers, SIGN)
    while True:
        try:
            job = waiting.get(timeout=IDLE_S)
        except Empty:
            job = SIGN
        if job == SIGN:
            os._exit(0)  # at once: some engines crash when they are taken apart
        _send(answers, SIGN)
        _send(answers, _answered(job))


def _answered(job: bytes) -> bytes:
    """The pickled answer to a pickled job."""
    reset_peak()
    start = perf_counter()
    try:
        function, arguments = pickle.loads(job)
        answer = Answer("value", function(*arguments))
    except PadgenError as error:
        answer = Answer("refused", error=error)
    except BaseException as error:  # not even an exit may end the worker in mid-job
        answer = _broken(error)
    answer = replace(answer, seconds=perf_counter() - start, peak_mb=peak_mb())
    try:
        return pickle.dumps(answer)
    except Exception as error:
        return pickle.dumps(_broken(error))


def _private_pipes() -> tuple[BufferedReader, BufferedWriter]:
    """The two pipes out of the way of libraries that print, and of processes that are started from here."""
    pipes = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    return pipes


def _send(stream: IO[bytes], data: bytes) -> None:
    stream.write(len(data).to_bytes(HEAD, "little") + data)
    stream.flush()


def _received(stream: IO[bytes]) -> bytes | None:
    """The next message, None at the end."""
    head = stream.read(HEAD)
    data = stream.read(int.from_bytes(head, "little"))
    return data if len(head) == HEAD and len(data) == int.from_bytes(head, "little") else None


def _unpickled(word: bytes) -> Answer:
    """The answer that was sent, or that it cannot be read here."""
    try:
        answer: Answer = pickle.loads(word)
        return answer
    except Exception as error:
        return _broken(error)
