"""Variants made in watched worker processes: on this machine, or beside the workers of an executor."""

import os
from collections.abc import Callable
from dataclasses import replace
from threading import Lock

from padgen.batch.definition import Limits
from padgen.batch.variant import Record, Task
from padgen.core.runner import Runner

__all__ = ["IMPORTS", "Work", "broken", "make_variants", "run_tasks"]

Work = Callable[[Task], Record]
IMPORTS = ("padgen.planner",)
"""Modules that every variant needs, loaded before its limit of time counts."""

_own: dict[int, Runner] = {}
_own_lock = Lock()


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
