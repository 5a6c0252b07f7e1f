"""Run one piece of work in a process of its own, on one thread, and measure it there.

A crash of an engine costs one rung, netgen and build123d never meet in one process, and the peak of
memory is the work's own.
"""

import gc
import pickle
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from padgen.core.errors import SolverError
from padgen.core.runner import Answer, Runner, peak_mb, reset_peak
from padgen.ladders.rung import Measured, Rung

__all__ = ["TIMES", "Timed", "apart", "measured", "run_apart", "run_timed", "timed"]

LIMIT_S = 600.0
BUDGET_S, MOST_RUNS = 2.0, 7
LONG_S = 6.0
"""A run that takes longer is not repeated, a shorter one at least once."""
MODELS = ("padgen.physics", "padgen.planner", "padgen.verify")
TIMES = (
    f"run times are the best of 2 to {MOST_RUNS} runs (of one where that takes over {LONG_S:g} s), on one thread, with"
    " empty caches, in a process of its own that has started and imported what it needs: a first call takes longer"
)


class Timed(NamedTuple):
    """Timed work's result, and the best of its `runs`; the peak of memory is over what was held before."""

    value: Any
    seconds: float
    cpu_seconds: float
    runs: int
    memory_mb: float


def apart(work: Callable[..., Any], *arguments: Any, imports: tuple[str, ...] = (), limit_s: float = LIMIT_S) -> Answer:
    """Run `work`, which must pickle, in a new process until `limit_s`; it never raises what `work` raises."""
    with Runner(imports=imports) as runner:
        return runner.run(work, *arguments, time_s=limit_s)


def run_apart(work: Callable[..., Any], *arguments: Any) -> Any:
    """Return the value of `work`, run once in a process of its own.

    Raises
    ------
    PadgenError
        The one that `work` raised; `SolverError` when it broke down.
    """
    answer = apart(work, *arguments)
    if answer.kind == "failed":
        raise SolverError(f"a step of the study has no answer: {answer.sentence}", "study")
    if answer.error:
        raise answer.error
    return answer.value


def timed(
    work: Callable[..., Any],
    imports: tuple[str, ...] = (),
    limit_s: float = LIMIT_S,
    budget_s: float = BUDGET_S,
    most_runs: int = MOST_RUNS,
    prepare: Callable[[], Any] | None = None,
) -> Answer:
    """Run `work` apart, again and again until `budget_s` is spent; the answer's value is a `Timed`.

    With `prepare` it is called with its result, which is made once, off the clock.
    """
    return apart(run_timed, pickle.dumps((prepare, work)), budget_s, most_runs, imports=imports, limit_s=limit_s)


def measured(rung: Rung) -> Measured:
    """Run a rung and measure it; a refusal or a crash is a `Measured` with its sentence."""
    import numpy as np

    answer = timed(rung.solve, rung.imports, rung.limit_s, prepare=rung.prepare)
    if answer.kind != "value":
        return Measured(note="refused: " * (answer.kind == "refused") + answer.sentence)
    found: Timed = answer.value
    solved = found.value
    own = Measured(
        np.atleast_1d(np.asarray(solved.values, float)),
        int(solved.unknowns),
        float(solved.residual),
        found.seconds,
        found.cpu_seconds,
        found.runs,
        found.memory_mb,
    )
    if own.values is not None and np.isfinite(own.values).all():
        return own
    return replace(own, values=None, note="its answer is not a number")


def run_timed(pickled: bytes, budget_s: float, most_runs: int) -> Timed:
    """Run a pickled pair in this process: a function to call off the clock or None, and the one to time."""
    prepare, _ = pickle.loads(pickled)  # so that the modules it names are loaded
    try:
        made = () if prepare is None else (prepare(),)
        reset_peak()
        before = peak_mb() or 0.0
        value, *times = _run(pickled, made)
        memory = max((peak_mb() or 0.0) - before, 0.0)
        walls, cpus = ([time_] for time_ in times)
        while len(walls) < most_runs and (len(walls) < 2 or sum(walls) < budget_s) and min(walls) < LONG_S:
            _, wall, cpu = _run(pickled, made)
            walls.append(wall)
            cpus.append(cpu)
    except MemoryError as error:
        raise SolverError("the machine has not enough memory for it") from error
    return Timed(value, min(walls), min(cpus), len(walls), memory)


def _run(pickled: bytes, made: tuple[Any, ...]) -> tuple[Any, float, float]:
    """Run once; return the value with its wall and processor seconds.

    Unpickled anew and with empty caches, so that a repeated run is as dear as the first.
    """
    _, work = pickle.loads(pickled)
    for name, module in list(sys.modules.items()):
        if name.startswith(MODELS):
            for held in list(vars(module).values()):
                if hasattr(type(held), "cache_clear"):
                    held.cache_clear()
    gc.collect()
    wall, cpu = time.perf_counter(), time.process_time()
    value = work(*made)
    return value, time.perf_counter() - wall, time.process_time() - cpu
