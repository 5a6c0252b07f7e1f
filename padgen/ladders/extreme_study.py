"""The stiff and extreme cases of every ladder, each run in a process of its own and held to what it states."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import isfinite, isnan, nan
from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError
from padgen.ladders.isolate import apart, timed
from padgen.verify.extreme import Answer, ExtremeCase

__all__ = [
    "RIGHT",
    "SETS",
    "Named",
    "Verdict",
    "judged_error",
    "named_cases",
    "reference_of",
    "relative_error",
    "solve_case",
    "verdict_of",
]

SETS = (
    ("padgen.verify.extreme_structure", "structure_cases"),
    ("padgen.verify.extreme_force", "force_cases"),
    ("padgen.verify.extreme_dynamics", "dynamics_cases"),
    ("padgen.ladders.extreme_selectivity", "selectivity_cases"),
)
"""Modules and their functions that yield `ExtremeCase`s."""
LIMIT_S = 180.0
RIGHT, REFUSED, WRONG, UNCHECKED = "right", "refused", "WRONG", "unchecked"


class Named(NamedTuple):
    """A case by where it comes from, since a case itself need not pickle."""

    module: str
    function: str
    place: int
    name: str
    domain: str
    model: str
    source: str


@dataclass(frozen=True)
class Verdict:
    """What came of a case. `error` is relative, against the case's own reference.

    'right': within the stated error; 'refused': one sentence instead of an answer; 'WRONG': worse than
    stated, no number, or no end; 'unchecked': the reference itself could not be computed.
    """

    name: str
    domain: str
    model: str
    source: str
    verdict: str
    error: float = nan
    stated_error: float = nan
    seconds: float = nan
    residual: float = nan
    condition: float = nan
    note: str = ""


def named_cases(sets: tuple[tuple[str, str], ...] = SETS) -> list[Named]:
    """All cases of `sets`.

    Raises
    ------
    EngineMissingError
        A package that the set's own references need is not installed.
    SolverError
        A set cannot be listed.
    """
    found = []
    for module, function in sets:
        try:
            cases = _cases(module, function)
        except ImportError as error:
            raise SolverError(f"the set of extreme cases cannot be loaded ({error})", module) from error
        found += [
            Named(module, function, place, case.name, case.domain, case.model, case.source)
            for place, case in enumerate(cases)
        ]
    return found


def _cases(module: str, function: str) -> list[ExtremeCase]:
    return list(getattr(importlib.import_module(module), function)())


def solve_case(named: Named) -> Answer:
    """Run a case's model, in the process of its own; raises what it refuses with."""
    answer = _cases(named.module, named.function)[named.place].solve()
    return answer._replace(values=np.atleast_1d(np.asarray(answer.values)))


def reference_of(named: Named) -> np.ndarray:
    """A case's reference, in another process."""
    return np.atleast_1d(np.asarray(_cases(named.module, named.function)[named.place].reference()))


def verdict_of(named: Named, limit_s: float = LIMIT_S) -> Verdict:
    """Run a case and its reference, and compare."""
    say: Callable[..., Verdict] = partial(Verdict, named.name, named.domain, named.model, named.source)
    answer = timed(partial(solve_case, named), limit_s=limit_s, budget_s=0.5, most_runs=3)
    if answer.kind != "value":
        return say(REFUSED if answer.kind == "refused" else WRONG, note=answer.sentence)
    run: Answer = answer.value.value
    figures = {
        "stated_error": float(run.stated_error),
        "seconds": answer.value.seconds,
        "residual": float(run.residual),
        "condition": float(run.condition),
    }
    truth = apart(reference_of, named, limit_s=limit_s)
    if truth.kind != "value":
        return say(UNCHECKED, **figures, note=f"no reference: {truth.sentence}")
    error = relative_error(run.values, truth.value)
    verdict, note = judged_error(error, figures["stated_error"])
    return say(verdict, error, note=note, **figures)


def relative_error(values: np.ndarray, reference: np.ndarray) -> float:
    """Largest difference over the largest entry of `reference`; nan for a shape or number that is none."""
    if values.shape != reference.shape or not np.isfinite(reference).all() or not np.isfinite(values).all():
        return nan
    difference, scale = float(np.abs(values - reference).max(initial=0.0)), float(np.abs(reference).max(initial=0.0))
    return difference / scale if scale else difference


def judged_error(error: float, stated: float) -> tuple[str, str]:
    """The verdict on an error beside what was stated, and why where it is not 'right'."""
    if isnan(error):
        return WRONG, "the answer is not a number, or not of the reference's shape"
    if not isfinite(stated):
        return WRONG, "it states no error"
    if error > stated:
        return WRONG, f"{error / stated:.3g} times what it states" if stated > 0 else "it states to be exact"
    return RIGHT, ""
