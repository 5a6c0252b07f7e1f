"""Run functions in processes of their own: the only code that starts, feeds, watches and ends processes.

A worker is a fresh interpreter that receives jobs over its pipes and stays alive between them, so that numpy, a CAD
kernel or an engine is loaded once. A crash, a kill by the system, or too much time or memory costs only the job
concerned. Workers do not use ``multiprocessing``, which would need a guarded ``__main__`` and a parent that may have
children; they also run inside the workers of a cluster.

- The parent handles Ctrl-C: workers are in sessions of their own.
- Workers end with their parent, however it ends. On Linux the system kills them when a pipe held by the parent is
  closed. Elsewhere a thread waits for this, which code that keeps Python's lock can delay.
- Limits are watched from outside, since such code would also delay a watching thread. Memory is resident memory, since
  a limit on addresses (``RLIMIT_AS``) also counts memory that OpenBLAS and OCCT only reserve.
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
    "interrupted_later",
    "memory_mb",
    "peak_mb",
    "refuse_unshared",
    "reset_peak",
    "serve",
    "tell",
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
"""Environment of a worker: threads inside several processes would only compete for the cores."""
PROCESSES = "PADGEN_PROCESSES"
"""Environment variable: number of processes that a process may use at a time; by default one per core."""
START = "import json, sys; sys.path[:], *rest = json.loads(sys.argv[1]); import padgen.core.runner as r; r.serve(*rest)"
WATCH_S = 0.05
MOST_LOOKS = 10
"""Seconds between two looks at a job's time and memory, and the number of looks that a single one may count as."""
IDLE_S = 120.0
"""Seconds after which an idle worker ends, so that workers of a cluster do not outlive the sweep."""
HEAD = 8
LAST_BYTES = 4096
"""Bytes of the length before each message, and bytes kept of the end of printed output."""
EMPTY = b""
"""Empty message. From a worker: it has started, or has taken a job. To a worker: it is to end."""
WHERE = "worker process"


@dataclass(frozen=True, slots=True)
class Answer:
    """The result of a job in a worker process: a value, or why there is none.

    `kind` is 'value'; 'refused', where the function raised `error`, a `PadgenError` of its own class; or 'failed',
    where the function broke down, its process died, or it exceeded `limit` ('time_s' or 'memory_mb'), as `error` says;
    `limit` is 'wanted' where nobody wanted the answer any more.
    `seconds` and `peak_mb` (10⁶ bytes, of the worker and all its processes) are the job's; None where nobody measured.
    """

    kind: str
    value: Any = None
    error: PadgenError | None = None
    seconds: float | None = None
    peak_mb: float | None = None
    limit: str = ""

    @property
    def sentence(self) -> str:
        """The reason for the missing value, empty where there is a value."""
        return str(self.error or "")


UNWANTED = Answer("failed", None, SolverError("was ended, since nobody wants its answer any more"), limit="wanted")


class Runner:
    """A pool of worker processes, started when needed and reused; a context manager that ends them.

    As many workers run as threads call `run` at a time; the pool `threads` has `workers` threads for this. Workers load
    the modules named in `imports` as they start, before any limit counts; if one cannot be loaded, the job that needs
    it fails. Each worker may use its share of the cores for processes of its own. A worker ends after `idle_s` without
    a job.
    """

    def __init__(self, workers: int = 1, imports: tuple[str, ...] = (), idle_s: float = IDLE_S) -> None:
        self.threads = ThreadPoolExecutor(workers)
        self._cores = max(core_count() // workers, 1)
        self._imports = imports
        self._idle_s = idle_s
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

    def run(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        time_s: float = inf,
        most_mb: float = inf,
        wanted: Callable[[], bool] = lambda: True,
        hear: Callable[[str], object] = lambda step: None,
    ) -> Answer:
        """Call a function of a module in a worker and return its answer; function, arguments and result must pickle.

        The worker is ended as soon as the answer is not `wanted`. `hear` gets the steps that the function
        tells (`tell`).

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
            if not wanted():
                return UNWANTED
            worker = self._idle_or_new()
            try:
                answer = worker.ask(job, time_s, most_mb, wanted, hear)
            except BaseException:
                worker.kill()
                raise
            finally:
                self._release(worker, most_mb)
            if answer is not None:
                return answer

    def submit(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> "Future[Answer]":
        """Call `run` in a thread and return its future."""
        with interrupted_later():
            return self.threads.submit(self.run, function, *arguments, **options)

    def prepare(self, count: int) -> None:
        """Start workers until there are `count`, without waiting; if none starts, the next `run` raises the error."""

        def start() -> None:
            with suppress(PadgenError):
                conditions = self._conditions()
                with self._lock:
                    if len(self._all) >= count:
                        return
                    worker = self._new(conditions)
                self._release(self._ready(worker), inf)

        with interrupted_later():
            for _ in range(count):
                self.threads.submit(start)

    def close(self) -> None:
        """End all workers, even during a job."""
        with self._lock:
            self._closed = True
            workers = self._all
            self._all = set()
            self._idle = []
        for worker in workers:
            worker.kill()
        self.threads.shutdown(cancel_futures=True)

    def _idle_or_new(self) -> "_Worker":
        """Return an idle worker that was started under the present conditions, or start a new one."""
        conditions = self._conditions()
        with self._lock:
            while self._idle:
                worker = self._idle.pop()
                if worker.conditions == conditions and not worker.ended:
                    return worker
                worker.retire()
                self._all.discard(worker)
            worker = self._new(conditions)
        return self._ready(worker)

    def _conditions(self) -> tuple[Any, ...]:
        """Return what a worker inherits from this process: environment, working folder, module path, imports."""
        folder = None
        with suppress(OSError):  # it was removed
            folder = Path.cwd()
        path = [entry for entry in sys.path if isinstance(entry, str)]
        return dict(os.environ), folder, path, self._imports

    def _new(self, conditions: tuple[Any, ...]) -> "_Worker":
        """Start a worker; the caller holds this runner's lock."""
        if self._closed:
            raise SolverError("was ended", WHERE)
        worker = _Worker(conditions, self._cores, self._idle_s)
        self._all.add(worker)  # before it is ready, so that `close` can end it
        return worker

    def _ready(self, worker: "_Worker") -> "_Worker":
        """Wait until a new worker is ready, and return it."""
        try:
            worker.wait()
        except SolverError:
            with self._lock:
                self._all.discard(worker)
            raise
        return worker

    def _release(self, worker: "_Worker", most_mb: float) -> None:
        """Make a worker available again, or end it if it uses more than half of the memory limit `most_mb`."""
        grown = most_mb < inf and memory_mb(worker.pid) > most_mb / 2
        with self._lock:
            if not (grown or worker.ended or self._closed):
                worker.rested = True
                self._idle.append(worker)
                return
            self._all.discard(worker)
        worker.retire()


class _Worker:
    """A worker process as its parent sees it: to start, give jobs to, watch and end.

    It is started under `conditions`: environment, working folder, module path, modules to load.
    """

    def __init__(self, conditions: tuple[Any, ...], cores: int, idle_s: float) -> None:
        self.conditions = conditions
        environment, _, path, imports = conditions
        with ExitStack() as ends:
            try:
                # Output printed by libraries, whose last line may tell why the process ended.
                self._log = ends.enter_context(TemporaryFile(buffering=0))
                life, child_end = os.pipe()
                ends.callback(os.close, child_end)
                try:
                    self._process = subprocess.Popen(
                        [sys.executable, "-P", "-c", START, json.dumps([path, imports, life, idle_s])],
                        stdin=subprocess.PIPE,
                        stdout=subprocess.PIPE,
                        stderr=self._log,
                        env=environment | ONE_THREAD | {PROCESSES: str(cores)},
                        pass_fds=[life] if _is_life_line(life) else (),
                        start_new_session=True,  # only the parent gets Ctrl-C; on Windows by the next line
                        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
                    )
                finally:
                    os.close(life)
            except OSError as error:
                raise SolverError(f"cannot be started ({error.strerror or error})", WHERE) from error
            self._ends = ends.pop_all()
        self.pid = self._process.pid
        self.rested = False
        self._last_line = ""
        self._lock = Lock()
        self._messages: SimpleQueue[bytes | None] = SimpleQueue()
        self._listener = Thread(target=self._listen, daemon=True)
        self._listener.start()

    def wait(self) -> None:
        """Wait until the worker is ready.

        Raises
        ------
        SolverError
            The worker has ended instead.
        """
        if self._messages.get() is None:
            raise SolverError(f"cannot start ({self._last_line or f'exit code {self._process.returncode}'})", WHERE)

    def ask(
        self,
        job: bytes,
        time_s: float,
        most_mb: float,
        wanted: Callable[[], bool],
        hear: Callable[[str], object],
    ) -> Answer | None:
        """Return the answer to a pickled job, and end the worker if it exceeds a limit or is not `wanted` any more.

        None where this worker ended before it took the job, since it had waited for one too long or had `rested`.
        """
        taken = False
        peak = 0.0
        spent_s = 0.0
        start = perf_counter()
        looked = start
        with suppress(OSError, ValueError):  # if the worker has ended, a message will say so
            self._log.seek(0)  # parent and worker share this position
            self._log.truncate()
            _send(self._in, job)
        while True:
            try:
                message = self._messages.get(timeout=WATCH_S)
            except Empty:
                if not wanted():
                    self.kill()
                    return UNWANTED
                peak = max(peak, memory_mb(self.pid))
                # One look counts for a few at most, since this process may have been stopped meanwhile.
                now = perf_counter()
                spent_s = spent_s + min(now - looked, MOST_LOOKS * WATCH_S)
                looked = now
                if spent_s > time_s:
                    limit = "time_s"
                    said = f"took longer than {number(time_s)} s"
                elif peak > most_mb:
                    limit = "memory_mb"
                    said = f"took more than {number(most_mb)} MB"
                else:
                    continue
                self.kill()
                return Answer("failed", None, SolverError(said), now - start, peak or None, limit)
            if message is None:
                waited_too_long = self._process.returncode == 0
                if not taken and (self.rested or waited_too_long):
                    return None
                return Answer("failed", None, SolverError(self._cause_of_end()), perf_counter() - start, peak or None)
            if taken:
                try:
                    answer: Answer | str = pickle.loads(message)
                except Exception as error:
                    return _broken(error)
                if isinstance(answer, str):
                    hear(answer)
                    continue
                return replace(answer, peak_mb=max(peak, answer.peak_mb or 0.0) or None)
            taken = True

    @property
    def ended(self) -> bool:
        """True when the process is known to have ended."""
        return self._process.returncode is not None

    def retire(self) -> None:
        """Ask the worker to end after its present job."""
        with suppress(OSError, ValueError):
            _send(self._in, EMPTY)

    def kill(self) -> None:
        """End the worker and all processes that it started."""
        with self._lock:
            if not self.ended:
                _end_family(self.pid)
        self._listener.join()

    @property
    def _in(self) -> IO[bytes]:
        assert self._process.stdin
        return self._process.stdin

    def _listen(self) -> None:
        """Put each message of the worker into the parent's queue until the worker ends, then clean up after it."""
        stream = self._process.stdout
        assert stream
        with stream:
            while (message := _received(stream)) is not None:
                self._messages.put(message)
        with self._lock:
            _end_family(self.pid)  # before the system reuses the process number
            self._process.wait()
        with suppress(OSError):
            self._in.close()
        self._log.seek(max(self._log.seek(0, os.SEEK_END) - LAST_BYTES, 0))
        self._last_line = self._log.read().decode(errors="replace").strip().rpartition("\n")[2]
        self._ends.close()
        self._messages.put(None)

    def _cause_of_end(self) -> str:
        """Return a sentence on why the worker process ended: its signal, or its exit code and last line of output."""
        code = self._process.returncode
        if code == -9:
            return "its process was killed (signal 9), most likely by the system for lack of memory"
        if code < 0:
            name = next((f" ({one.name})" for one in signal.Signals if one == -code), "")
            return f"its process died of signal {-code}{name}"
        return f"its process ended with code {code}" + (f" ({self._last_line})" if self._last_line else "")


def refuse_unshared() -> None:
    """Refuse a suspension or drive scheme that is registered in this process but unknown to a worker.

    Raises
    ------
    SpecError
        There is one; the sentence says how to register it for workers.
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
    """Return the number of cores that this process may use."""
    named = os.environ.get(PROCESSES, "")
    if named.isdecimal() and int(named):
        return int(named)
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ignore Ctrl-C inside the block, in the main thread, which is the one that receives it."""
    if current_thread() is not main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def interrupted_later() -> Iterator[None]:
    """Delay a Ctrl-C that comes inside the block until the block ends.

    For what takes locks written in Python, such as handing a job to a thread: an exception between the taking of such a
    lock and the block that frees it leaves it held, and the thread waits for it for ever. Also for the import of
    compiled modules, which may crash where they are interrupted.
    """
    if current_thread() is not main_thread():
        yield
        return
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            signal.raise_signal(signal.SIGINT)


def memory_mb(pid: int) -> float:
    """Return the resident memory of a process and all its descendants in MB (10⁶ bytes); 0 where it is unknown."""
    import psutil

    total = 0
    for process in _family(pid):
        with suppress(psutil.Error):
            total += process.memory_info().rss
    return total / 1e6


def reset_peak() -> None:
    """Restart the measurement of this process's peak memory, where the system can do this (Linux)."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_bytes(b"5")


def peak_mb() -> float | None:
    """Return the peak resident memory of this process in MB (10⁶ bytes); None where it is unknown."""
    with suppress(OSError):
        # ru_maxrss would include the parent's memory before the fork.
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ImportError:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6


def _family(pid: int) -> list[Any]:
    """Return a process (`psutil.Process`) and all its descendants; an empty list where it has ended."""
    import psutil

    members: list[Any] = []
    with suppress(psutil.Error):
        members.append(psutil.Process(pid))
    for process in members:  # which grows by the children of each
        with suppress(psutil.Error, OSError):
            if sys.platform != "linux":
                members += process.children()
                continue
            # Called often, and psutil would read the parent of every process of the machine.
            for thread in Path(f"/proc/{process.pid}/task").iterdir():
                for child in (thread / "children").read_text().split():
                    with suppress(psutil.Error):
                        members.append(psutil.Process(int(child)))
    return members


def _end_family(pid: int) -> None:
    """Kill a process whose exit status nobody has collected yet, its group, and all its descendants."""
    import psutil

    family = _family(pid)
    with suppress(OSError, AttributeError):  # Windows has no groups
        os.killpg(pid, signal.SIGKILL)
    for process in family:
        with suppress(psutil.Error):
            process.kill()


def _broken(error: BaseException) -> Answer:
    """Return a failed `Answer` with type and text of an unexpected exception (one that is not a `PadgenError`)."""
    text = "not enough memory for it" if isinstance(error, MemoryError) else " ".join(str(error).split())
    return Answer("failed", error=SolverError(f"broke down ({type(error).__name__}: {text}".rstrip(": ") + ")"))


def _is_life_line(descriptor: int) -> bool:
    """Return whether this pipe can signal the parent's end to a worker: on Linux, if it is not a standard stream."""
    return sys.platform == "linux" and descriptor > 2


_answers: IO[bytes] | None = None
"""The stream for a worker's messages; None in any other process."""


def tell(step: str) -> None:
    """Send a progress message from a worker to the callback `hear` of `Runner.run`; do nothing outside a worker."""
    if _answers is not None:
        _send(_answers, pickle.dumps(step))


def serve(imports: list[str], life: int, idle_s: float) -> None:
    """Run a worker: answer jobs until the parent is gone, or none has come for `idle_s`.

    `life` is one end of a pipe, whose other end the parent holds.
    """
    global _answers
    # Under new descriptors, out of reach of libraries that print and of child processes.
    questions = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    _answers = answers
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    waiting: SimpleQueue[bytes] = SimpleQueue()

    def follow() -> None:
        while (question := _received(questions)) is not None:
            waiting.put(question)
        # The parent is gone, so nobody waits for this worker's or its processes' results.
        with suppress(OSError, AttributeError):
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    Thread(target=follow, daemon=True).start()
    if _is_life_line(life):
        import fcntl

        with suppress(OSError):  # where the system lacks it, `follow` ends this process
            fcntl.fcntl(life, fcntl.F_SETSIG, signal.SIGKILL)
            fcntl.fcntl(life, fcntl.F_SETOWN, -os.getpgrp())
            fcntl.fcntl(life, fcntl.F_SETFL, os.O_ASYNC)
    with suppress(AttributeError):  # Windows
        # A forked process that kept the pipe open would hide this worker's end from the parent.
        os.register_at_fork(after_in_child=answers.raw.close)
    for name in imports:
        with suppress(Exception):
            import_module(name)
    _send(answers, EMPTY)
    while True:
        try:
            job = waiting.get(timeout=None if idle_s == inf else idle_s)
        except Empty:
            job = EMPTY
        if job == EMPTY:
            os._exit(0)  # without clean-up, in which some engines crash
        _send(answers, EMPTY)
        _send(answers, _answered(job))


def _answered(job: bytes) -> bytes:
    """Run a pickled job and return its pickled answer."""
    reset_peak()
    start = perf_counter()
    try:
        function, arguments = pickle.loads(job)
        answer = Answer("value", function(*arguments))
    except PadgenError as error:
        answer = Answer("refused", error=error)
    except BaseException as error:  # not even SystemExit may end the worker during a job
        answer = _broken(error)
    answer = replace(answer, seconds=perf_counter() - start, peak_mb=peak_mb())
    try:
        return pickle.dumps(answer)
    except Exception as error:
        return pickle.dumps(_broken(error))


def _send(stream: IO[bytes], data: bytes) -> None:
    """Write a message with its length before it."""
    stream.write(len(data).to_bytes(HEAD, "little") + data)
    stream.flush()


def _received(stream: IO[bytes]) -> bytes | None:
    """Read from a stream the next message that `_send` wrote; return None at the end of the stream."""
    head = stream.read(HEAD)
    data = stream.read(int.from_bytes(head, "little"))
    return data if len(head) == HEAD and len(data) == int.from_bytes(head, "little") else None
