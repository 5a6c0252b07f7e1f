"""Run variants on any executor, a bounded window of tasks at a time, with watched processes beside its workers.

Only ``submit`` of an executor is used, and of its futures ``result`` with ``add_done_callback`` or, where they
lack that, ``done``; so `concurrent.futures`, Dask, executorlib and submitit will do.
"""

import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError
from dataclasses import replace
from queue import Empty, SimpleQueue
from threading import Lock
from typing import Any

from padgen.batch.definition import Limits
from padgen.batch.variant import Record, Task
from padgen.core.errors import PadgenError
from padgen.core.runner import Runner

__all__ = [
    "IMPORTS",
    "LostError",
    "StoppedError",
    "Window",
    "Work",
    "broken",
    "make_variants",
    "records_of",
    "run_tasks",
    "told",
]

Work = Callable[[Task], Record]
POLL_S = 0.2
"""Between two looks at futures that do not call back."""
IMPORTS = ("padgen.planner",)
"""Modules that every variant needs, loaded before its limit of time counts."""
_own: dict[int, Runner] = {}
_own_lock = Lock()


class StoppedError(PadgenError):
    """The executor makes no more variants."""


class LostError(PadgenError):
    """The executor lost a task, for whatever reason, and may still make others."""


class Window:
    """An executor, and the tasks, `most` at a time, that it has been given and has not given back.

    What it is to call is ``function(tasks, *rest)``.
    """

    def __init__(self, executor: Any, most: int, function: Callable[..., list[Record]], *rest: Any) -> None:
        self._executor, self._most, self._function, self._rest = executor, most, function, rest
        self._pending: dict[int, tuple[Any, list[Task]]] = {}
        self._finished: SimpleQueue[int] = SimpleQueue()
        self._silent = False

    def __len__(self) -> int:
        return len(self._pending)

    @property
    def full(self) -> bool:
        """Whether enough tasks are waiting."""
        return len(self._pending) >= self._most

    def give(self, tasks: list[Task]) -> None:
        """Hand tasks over.

        Raises
        ------
        StoppedError
            The executor takes none.
        """
        try:
            future = self._executor.submit(self._function, tasks, *self._rest)
        except Exception as error:
            raise StoppedError(f"takes no more tasks ({told(error)})", "executor") from error
        self._pending[id(future)] = future, tasks
        if hasattr(future, "add_done_callback"):
            future.add_done_callback(lambda future: self._finished.put(id(future)))
        else:
            self._silent = True

    def take(self, wait_s: float) -> tuple[Any, list[Task]] | None:
        """A future that is finished, with its tasks; None when `wait_s` went by without one."""
        end = time.monotonic() + wait_s
        while (wait := end - time.monotonic()) > 0:
            try:
                return self._pending.pop(self._finished.get(timeout=min(wait, POLL_S) if self._silent else wait))
            except Empty:
                for future, _ in self._pending.values() if self._silent else ():
                    if not hasattr(future, "add_done_callback") and future.done():
                        self._finished.put(id(future))
        return None

    def rest(self) -> Iterator[tuple[Any, list[Task]]]:
        """What is finished without having been taken; the others are cancelled."""
        for future, tasks in self._pending.values():
            if future.done():
                yield future, tasks
            elif hasattr(future, "cancel"):
                future.cancel()
        self._pending.clear()


def records_of(future: Any, tasks: list[Task]) -> list[Record]:
    """What a finished future brings: one record a task.

    Raises
    ------
    StoppedError
        The executor has broken down or was shut down, or no worker can be started.
    LostError
        Anything else came instead.
    """
    # An executor that cancels as asyncio does has loaded it; we need not.
    cancelled = getattr(sys.modules.get("asyncio"), "CancelledError", CancelledError)
    try:
        records = future.result()
    except (CancelledError, cancelled, BrokenExecutor, PadgenError) as error:
        raise StoppedError(f"has ended ({told(error)})", "executor") from error
    except Exception as error:
        raise LostError(told(error)) from error
    asked = [(task.number, task.key) for task in tasks]
    if not isinstance(records, list) or [(r.number, r.key) for r in records if isinstance(r, Record)] != asked:
        raise LostError("what came back is not what was asked for")
    return records


def told(error: Any) -> str:
    """An error on one line, with its kind where it is not one of ours."""
    text = " ".join(str(error).split())
    return str(error) if isinstance(error, PadgenError) else f"{type(error).__name__}: {text}".rstrip(": ")


def run_tasks(tasks: list[Task], work: Work, limits: Limits) -> list[Record]:
    """Make variants in a worker beside this process: what is submitted to an executor that the caller brought."""
    with _own_lock:
        own = _own.get(os.getpid())  # a forked process must not share the pipes of the one that it came from
        if not own:
            import atexit

            own = _own[os.getpid()] = Runner(imports=IMPORTS)
            atexit.register(own.close)
    return make_variants(own, tasks, work, limits)


def make_variants(runner: Runner, tasks: list[Task], work: Work, limits: Limits) -> list[Record]:
    """Make variants one after the other in a worker; never raises but when no worker can be started.

    Raises
    ------
    SolverError
        A worker's interpreter cannot be started, or cannot import padgen.
    """
    return [_made(runner, task, work, limits) for task in tasks]


def _made(runner: Runner, task: Task, work: Work, limits: Limits) -> Record:
    answer = runner.run(work, task, time_s=limits.time_s, most_mb=limits.memory_mb)
    if answer.kind == "value":
        record: Record = answer.value
        if isinstance(record, Record) and record.seconds is None:
            return replace(record, seconds=answer.seconds, peak_memory_mb=answer.peak_mb)
        return record
    sentence = answer.sentence + f" (limits.{answer.limit})" * bool(answer.limit)
    if answer.kind == "refused":
        sentence = f"broke down ({type(answer.error).__name__}: {sentence})"
    return broken(task, sentence, answer.seconds, answer.peak_mb)


def broken(task: Task, sentence: str, seconds: float | None = None, memory_mb: float | None = None) -> Record:
    """The record of a variant whose worker cannot tell any more what happened."""
    return Record(task.number, task.key, "failed", sentence, task.values, {}, 0, 0, (), seconds, memory_mb)
