"""What rungs and extreme cases do in tests of studies, in a module that their processes load quickly."""

import os
import sys
from math import inf, nan
from pathlib import Path

import numpy as np

from padgen.core.errors import SolverError
from padgen.ladders.extreme import ExtremeCase
from padgen.ladders.rung import Solved

EXACT = 3.0


def power_law(order: float, step: float) -> Solved:
    """Return an answer with the relative error 0.1 step^order."""
    return Solved(np.array([EXACT * (1 + 0.1 * step**order)]), unknowns=round(1 / step))


def refuses() -> Solved:
    raise SolverError("asks for more than it can: 3 is the nearest that would do", "rung")


def loses_its_mind() -> Solved:
    return Solved(np.array([nan]))


def takes_60_mb() -> Solved:
    return Solved(np.array([np.ones(60_000_000 // 8).sum()]))


def prints() -> Solved:
    print("what an engine prints")
    os.write(1, b"by any way")
    return Solved(np.array([1.0]))


def noted(path: Path) -> str:
    """Leave a mark in a file, to count preparations and solutions."""
    with path.open("a") as marks:
        marks.write("x")
    return path.read_text()


def noted_beside(path: Path, prepared: str) -> str:
    return prepared + noted(path)


def nothing() -> Solved:
    raise AssertionError("is only there to be listed")


def in_own_process() -> Solved:
    return Solved(np.array([float(os.getpid())]), unknowns=len(sys.argv[1]))


def extreme_cases():
    """Yield a case for each verdict."""

    def case(name, solve, reference=lambda: np.array([1.0])):
        return ExtremeCase(name, "test", "model", solve, reference, "by hand")

    yield case("right", lambda: Solved(np.array([1.001]), 0.01, 1e-9, 10.0))
    yield case("refused", refuses)
    yield case("wrong", lambda: Solved(np.array([1.1]), 0.01))
    yield case("no number", lambda: Solved(np.array([nan]), 0.01))
    yield case("states nothing", lambda: Solved(np.array([1.0]), inf))
    yield case("dies", lambda: os.abort())
    yield case("no reference", lambda: Solved(np.array([1.0]), 0.01), refuses)


OWN_CASES = (extreme_cases,)
