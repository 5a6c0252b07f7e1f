"""A worker: a process that makes one variant after the other, and `Workers`, which start, feed, watch and end them.

A worker is a fresh interpreter that talks over its two pipes; it lives on from variant to variant, so that it
loads numpy, and the CAD kernel where one is needed, once. What breaks down in it, or what the system kills,
costs the variant that it was on, and no other. It needs no ``multiprocessing``, hence neither a guarded
``__main__`` nor a parent that may have children: it also works inside the workers of a cluster.
"""

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from time import perf_counter
from typing import IO, Any

from padgen.batch.definition import Limits
from padgen.batch.limits import excess, memory_mb
from padgen.batch.variant import Record, Task
from padgen.core.errors import PadgenError
from padgen.core.processes import ONE_THREAD, PROCESSES

__all__ = ["Work", "Workers", "broken", "run_tasks", "serve"]

Work = Callable[[Task], Record]
WATCH_S, MOST_LOOKS = 0.05, 10
"""Seconds between two looks at what a variant takes, and for how many such looks one may count at most."""
IDLE_S = 120.0
"""After which a worker without work ends; a cluster's would outlive the sweep otherwise."""
HEAD = 8


class Workers:
    """Worker processes, started as they are needed and used again; closed, they are all ended at once.

    Each may use so many `cores` for processes of its own; None: all.
    """

    def __init__(self, cores: int | None = None) -> None:
        self._cores = cores
        self._lock = Lock()
        self._idle: list[_Worker] = []
        self._all: set[_Worker] = set()
        self._closed = False

    @property
    def pids(self) -> list[int]:
        """The processes that there are."""
        with self._lock:
            return [worker.pid for worker in self._all]

    def run(self, tasks: list[Task], work: Work, limits: Limits) -> list[Record]:
        """Make variants one after the other in a worker; never raises but when no worker can be started.

        Raises
        ------
        PadgenError
            A worker's interpreter cannot be started, or cannot import padgen.
        """
        return [self._one(work, task, limits) for task in tasks]

    def prepare(self) -> None:
        """Start a worker for what is to come; where none starts, that will tell."""
        with suppress(PadgenError):
            worker = self._taken()
            with self._lock:
                self._idle.append(worker)

    def close(self) -> None:
        """End all workers, whatever they are doing."""
        with self._lock:
            self._closed = True
            workers, self._all, self._idle = self._all, set(), []
        for worker in workers:
            worker.kill()

    def _one(self, work: Work, task: Task, limits: Limits) -> Record:
        for _ in range(2):
            worker = self._taken()
            start = perf_counter()
            answer, peak_mb = worker.ask((work, task), limits)
            if isinstance(answer, Record):
                self._give_back(worker, limits)
                return answer
            with self._lock:
                self._all.discard(worker)
            worker.kill()
            if answer != IDLE:
                break
        return broken(task, answer, perf_counter() - start, peak_mb)

    def _give_back(self, worker: "_Worker", limits: Limits) -> None:
        """Let a worker be used again, unless what libraries have kept in it would be charged to the next variant."""
        grown = (memory_mb(worker.pid) or 0.0) > limits.memory_mb / 2
        with self._lock:
            if not grown:
                self._idle.append(worker)
                return
            self._all.discard(worker)
        worker.retire()

    def _taken(self) -> "_Worker":
        with self._lock:
            if self._closed:
                raise PadgenError("was ended", "sweep")
            while self._idle:
                worker = self._idle.pop()
                if worker.environment == os.environ and not worker.ended:
                    return worker
                worker.retire()  # it was started with another cache, say
                self._all.discard(worker)
        worker = _Worker(self._cores)
        with self._lock:
            self._all.add(worker)
            if not self._closed:
                return worker
        worker.kill()
        raise PadgenError("was ended", "sweep")


IDLE = "its process had ended"


class _Worker:
    """The parent's end of one worker."""

    def __init__(self, cores: int | None) -> None:
        self.environment = dict(os.environ)
        own = {PROCESSES: str(cores)} if cores else {}
        path = os.pathsep.join(entry or os.curdir for entry in sys.path)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", "from padgen.batch.worker import serve; serve()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=self.environment | ONE_THREAD | own | {"PYTHONPATH": path},
                start_new_session=True,  # Ctrl-C is the parent's to handle
            )
        except OSError as error:
            raise PadgenError(f"cannot be started ({error.strerror or error})", "worker process") from error
        self.pid = self._process.pid
        self._answers: SimpleQueue[Any] = SimpleQueue()
        self._listener = Thread(target=self._listen, daemon=True)
        self._listener.start()
        if self._answers.get() != READY:
            self.kill()
            raise PadgenError(f"cannot start (exit code {self._process.returncode})", "worker process")

    def ask(self, question: Any, limits: Limits) -> tuple[Any, float | None]:
        """The answer, a `Record`, or the sentence why there is none; and the most memory that was seen."""
        peak_mb, spent_s, looked = None, 0.0, perf_counter()
        try:
            _send(self._in, question)
        except (OSError, ValueError):  # it has ended, or its pipe is closed already
            return self._ending(), None
        while True:
            try:
                answer = self._answers.get(timeout=WATCH_S)
            except Empty:
                used_mb = memory_mb(self.pid)
                peak_mb = max(peak_mb or 0.0, used_mb or 0.0) or None
                # Not more than a few looks' worth, as this process may have been stopped meanwhile.
                now = perf_counter()
                spent_s, looked = spent_s + min(now - looked, MOST_LOOKS * WATCH_S), now
                if sentence := excess(limits, used_mb, spent_s):
                    return sentence, peak_mb
                continue
            return (self._ending() if answer is None else answer), peak_mb

    @property
    def ended(self) -> bool:
        """Whether its process is known to have ended."""
        return self._process.returncode is not None

    def retire(self) -> None:
        """Ask it to end when it has answered everything."""
        with suppress(OSError, ValueError):
            _send(self._in, None)

    def kill(self) -> None:
        """End it, and what it started."""
        with suppress(OSError, AttributeError):
            if self._process.returncode is None:  # else its number may be another's by now
                os.killpg(self.pid, signal.SIGKILL)
        with suppress(OSError):
            self._process.kill()
        self._listener.join()

    @property
    def _in(self) -> IO[bytes]:
        assert self._process.stdin
        return self._process.stdin

    def _listen(self) -> None:
        stream = self._process.stdout
        assert stream
        with stream:
            while (data := _received(stream)) is not None:
                self._answers.put(_unpickled(data))
        self._process.wait()
        with suppress(OSError):
            self._in.close()
        self._answers.put(None)

    def _ending(self) -> str:
        """Why it does not answer any more."""
        code = self._process.wait()
        if code == 0:
            return IDLE
        if code == -9:
            return "its process was killed (signal 9), most likely by the system for want of memory"
        return f"its process died ({f'signal {-code}' if code < 0 else f'exit code {code}'})"


READY = "ready"
_own: dict[int, Workers] = {}
_own_lock = Lock()


def run_tasks(tasks: list[Task], work: Work, limits: Limits) -> list[Record]:
    """What is submitted to an executor that the caller brought: variants, made in a watched process beside its own."""
    with _own_lock:
        own = _own.get(os.getpid())  # a forked process must not share the pipes of the one that it came from
        if not own:
            import atexit

            own = _own[os.getpid()] = Workers()
            atexit.register(own.close)
    return own.run(tasks, work, limits)


def broken(task: Task, sentence: str, seconds: float | None = None, memory_mb: float | None = None) -> Record:
    """The record of a variant whose worker cannot tell any more what happened."""
    return Record(task.number, task.key, "failed", sentence, task.values, {}, 0, 0, (), seconds, memory_mb)


def serve() -> None:
    """In the worker: answer until there is nobody left who asks."""
    questions, answers = _private_pipes()
    waiting: SimpleQueue[bytes] = SimpleQueue()

    def follow() -> None:
        while (question := _received(questions)) is not None:
            waiting.put(question)
        # The parent is gone: what is still computed nobody waits for, here and in processes of ours.
        with suppress(OSError, AttributeError):
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    import_module("padgen.planner")  # each variant needs it, and its limit of time should not pay for it
    _send(answers, READY)
    Thread(target=follow, daemon=True).start()
    while True:
        try:
            question = waiting.get(timeout=IDLE_S)
        except Empty:
            os._exit(0)
        _send_bytes(answers, _answered(question))


def _answered(question: bytes) -> bytes:
    """The pickled record of a pickled variant, or the sentence why there is none."""
    asked = _unpickled(question)
    if asked is None:
        os._exit(0)
    if isinstance(asked, str):
        return pickle.dumps(asked)
    record = _recorded(*asked)
    try:
        return pickle.dumps(record)
    except Exception as error:
        return pickle.dumps(f"broke down ({type(error).__name__}: {error})")


def _recorded(work: Work, task: Task) -> Record:
    try:
        return work(task)
    except BaseException as error:  # not even an exit may end the worker in mid-variant
        return broken(task, f"broke down ({type(error).__name__}: {error})")


def _private_pipes() -> tuple[IO[bytes], IO[bytes]]:
    """The two pipes out of the way of libraries that print, and of processes that are started from here."""
    pipes = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    return pipes


def _send(stream: IO[bytes], value: Any) -> None:
    _send_bytes(stream, pickle.dumps(value))


def _send_bytes(stream: IO[bytes], data: bytes) -> None:
    stream.write(len(data).to_bytes(HEAD, "little") + data)
    stream.flush()


def _received(stream: IO[bytes]) -> bytes | None:
    """The next message's bytes, None at the end."""
    head = stream.read(HEAD)
    data = stream.read(int.from_bytes(head, "little"))
    return data if len(head) == HEAD and len(data) == int.from_bytes(head, "little") else None


def _unpickled(data: bytes) -> Any:
    """What was sent, or the sentence why it cannot be read here."""
    try:
        return pickle.loads(data)
    except Exception as error:
        return f"broke down ({type(error).__name__}: {error})"
