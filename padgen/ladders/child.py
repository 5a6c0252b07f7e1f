"""The process in which one rung runs: ``python -m padgen.ladders.child JOB ANSWER``.

Started by `padgen.ladders.isolate`, which has the job pickled and reads the answer. What engines print
does not reach the user; leaving is immediate, since some engines crash when taken apart.
"""

import gc
import importlib
import os
import pickle
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

from padgen.core.processes import peak_mb, reset_peak

__all__ = ["Answer", "Job", "main"]


class Job(NamedTuple):
    """What to run: `work`, pickled, and how often: until `budget_s` is spent, at most `most_runs` times.

    `work` is a pair: a function to call off the clock, or None, and the one to time, called with its result.
    """

    work: bytes
    imports: tuple[str, ...]
    budget_s: float
    most_runs: int
    path: tuple[str, ...]


class Answer(NamedTuple):
    """What came of it. `kind`: 'value', 'refused' (a `PadgenError`, by its sentence) or 'failed'."""

    kind: str
    value: Any = None
    sentence: str = ""
    seconds: float = float("nan")
    cpu_seconds: float = float("nan")
    runs: int = 0
    memory_mb: float = float("nan")


LONG_S = 6.0
"""A run that takes longer is not repeated, a shorter one at least once."""
MODELS = ("padgen.physics", "padgen.planner", "padgen.verify")


def main() -> None:
    """Read the job, run it, write the answer, leave."""
    job: Job = pickle.loads(Path(sys.argv[1]).read_bytes())
    sys.path[:] = job.path
    answer = _run(job)
    aside = Path(sys.argv[2] + ".part")
    aside.write_bytes(pickle.dumps(answer))
    aside.replace(sys.argv[2])
    sys.stdout.flush()
    os._exit(0)


def _run(job: Job) -> Answer:
    from padgen.core.errors import PadgenError

    try:
        pickle.loads(job.work)  # so that the modules it names are loaded
        for name in job.imports:
            _import(name)
        return _measured(job)
    except PadgenError as error:
        return Answer("refused", sentence=str(error))
    except MemoryError:
        return Answer("refused", sentence="the machine has not enough memory for it")
    except Exception as error:
        text = str(error).strip().splitlines()
        return Answer("failed", sentence=f"{type(error).__name__}: {text[0] if text else 'no reason given'}")


def _import(name: str) -> None:
    """Import ahead of the clock; what is missing is for the work itself to say."""
    try:
        importlib.import_module(name)
    except ImportError:
        return


def _measured(job: Job) -> Answer:
    prepare, _ = pickle.loads(job.work)
    made = () if prepare is None else (prepare(),)
    reset_peak()
    before = peak_mb() or 0.0
    value, wall, cpu = _timed(job, made)
    memory = max((peak_mb() or 0.0) - before, 0.0)
    walls, cpus = [wall], [cpu]
    while len(walls) < job.most_runs and (len(walls) < 2 or sum(walls) < job.budget_s) and min(walls) < LONG_S:
        _, wall, cpu = _timed(job, made)
        walls.append(wall)
        cpus.append(cpu)
    return Answer("value", value, "", min(walls), min(cpus), len(walls), memory)


def _timed(job: Job, made: tuple[Any, ...]) -> tuple[Any, float, float]:
    """One run and its wall and processor seconds.

    Unpickled anew and with empty caches, so that a repeated run is as dear as the first.
    """
    _, work = pickle.loads(job.work)
    _forget()
    gc.collect()
    wall, cpu = time.perf_counter(), time.process_time()
    value = work(*made)
    return value, time.perf_counter() - wall, time.process_time() - cpu


def _forget() -> None:
    """Empty the caches of padgen's models."""
    for name, module in list(sys.modules.items()):
        if name.startswith(MODELS):
            for value in list(vars(module).values()):
                clear = getattr(value, "cache_clear", None)
                if callable(clear):
                    clear()


if __name__ == "__main__":
    from padgen.ladders.child import main as importable_main

    importable_main()
