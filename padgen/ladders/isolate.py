"""Run one piece of work in a process of its own, on one thread, and measure it.

A crash of an engine costs one rung, netgen and build123d never meet in one process, and the peak of
memory is the work's own.
"""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from padgen.core.errors import PadgenError, SolverError
from padgen.core.processes import ONE_THREAD
from padgen.ladders.child import Answer, Job
from padgen.ladders.rung import Measured, Rung

__all__ = ["isolated", "measured", "run_apart"]

BUDGET_S = 2.0
MOST_RUNS = 7


def isolated(
    work: Callable[..., Any],
    imports: tuple[str, ...] = (),
    limit_s: float = 600.0,
    budget_s: float = BUDGET_S,
    most_runs: int = MOST_RUNS,
    prepare: Callable[[], Any] | None = None,
) -> Answer:
    """Run `work`, which must pickle, in a new process until `limit_s`; it never raises what `work` raises.

    With `prepare` it is called with its result, which is made once, off the clock. A process
    that dies or takes too long is an `Answer` of kind 'failed' that says so.
    """
    with tempfile.TemporaryDirectory(prefix="padgen-study-") as name:
        job, answer, log = (Path(name) / part for part in ("job", "answer", "log"))
        job.write_bytes(pickle.dumps(Job(pickle.dumps((prepare, work)), imports, budget_s, most_runs, tuple(sys.path))))
        command = [sys.executable, "-m", "padgen.ladders.child", str(job), str(answer)]
        with log.open("wb") as out:
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, env=_environment())
            try:
                code = process.wait(limit_s)
            except subprocess.TimeoutExpired:
                return Answer("failed", sentence=f"did not end within {limit_s:g} s")
            finally:
                process.kill()
                process.wait()
        if not answer.exists():
            return Answer("failed", sentence=_death(code, log))
        found: Answer = pickle.loads(answer.read_bytes())
        return found


def measured(rung: Rung) -> Measured:
    """Run a rung and measure it; a refusal or a crash is a `Measured` with its sentence."""
    import numpy as np

    answer = isolated(rung.solve, rung.imports, rung.limit_s, prepare=rung.prepare)
    if answer.kind == "refused":
        return Measured(note=f"refused: {answer.sentence}")
    if answer.kind == "failed":
        return Measured(note=f"broke down: {answer.sentence}")
    solved = answer.value
    own = Measured(
        np.atleast_1d(np.asarray(solved.values, float)),
        int(solved.unknowns),
        float(solved.residual),
        answer.seconds,
        answer.cpu_seconds,
        answer.runs,
        answer.memory_mb,
        float(solved.proven),
    )
    if own.values is not None and np.isfinite(own.values).all():
        return own
    return replace(own, values=None, note="its answer is not a number")


def run_apart(work: Callable[[], Any], imports: tuple[str, ...] = (), limit_s: float = 600.0) -> Any:
    """The value of `work`, run once in a process of its own.

    Raises
    ------
    PadgenError
        With the sentence of the one that `work` raised; `SolverError` when the process died.
    """
    answer = isolated(work, imports, limit_s, budget_s=0.0, most_runs=1)
    if answer.kind == "refused":
        raise PadgenError(answer.sentence)
    if answer.kind == "failed":
        raise SolverError(f"a step of the study broke down ({answer.sentence})", "study")
    return answer.value


def _environment() -> dict[str, str]:
    # The child is found where this very padgen lies, also from another working folder.
    root = str(Path(__file__).resolve().parents[2])
    paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(paths)}


def _death(code: int, log: Path) -> str:
    if code < 0:
        return f"the process died of {signal.Signals(-code).name}"
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f"the process ended with code {code}" + (f" ({lines[-1]})" if lines else "")
