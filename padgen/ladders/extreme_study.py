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
    "MISSING",
    "SETS",
    "Named",
    "Verdict",
    "judged_error",
    "named_cases",
    "relative_error",
    "verdict_of",
]

SETS = (
    ("padgen.verify.extreme_structure", "structure_cases"),
    ("padgen.verify.extreme_solid", "solid_cases"),
    ("padgen.verify.extreme_force", "force_cases"),
    ("padgen.verify.extreme_dynamics", "dynamics_cases"),
    ("padgen.ladders.extreme_specs", "selectivity_cases"),
    ("padgen.ladders.extreme_specs", "spec_cases"),
)
"""Modules and their functions that yield `ExtremeCase`s."""
LIMIT_S = 300.0
RIGHT, REFUSED, WRONG, UNCHECKED, MISSING = "right", "refused", "WRONG", "unchecked", "not run"


class Named(NamedTuple):
    """A case and where it comes from: the case itself need not pickle."""

    module: str
    function: str
    place: int
    case: ExtremeCase


@dataclass(frozen=True)
class Verdict:
    """What came of a case: the columns of its table. `error` is relative, against the case's own reference.

    'right': within the stated error; 'refused': one sentence instead of an answer; 'WRONG': worse than
    stated, no number, or no end; 'unchecked': the reference itself could not be computed; 'not run'.
    """

    domain: str
    case: str
    model: str
    error: float = nan
    stated_error: float = nan
    seconds: float = nan
    residual: float = nan
    condition: float = nan
    verdict: str = MISSING
    source: str = ""
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
    found: list[Named] = []
    for module, function in sets:
        try:
            cases = _cases(module, function)
        except ImportError as error:
            raise SolverError(f"the set of extreme cases cannot be loaded ({error})", module) from error
        found += [Named(module, function, place, case) for place, case in enumerate(cases)]
    return found


def _cases(module: str, function: str) -> list[ExtremeCase]:
    return list(getattr(importlib.import_module(module), function)())


def _asked(module: str, function: str, place: int, what: str) -> Answer:
    """In a process of its own: what a case's model ('solve') or its 'reference' answers; it raises refusals."""
    answer = getattr(_cases(module, function)[place], what)()
    answer = answer if isinstance(answer, Answer) else Answer(answer, 0.0)
    return answer._replace(values=np.atleast_1d(np.asarray(answer.values)))


def verdict_of(named: Named, limit_s: float = LIMIT_S) -> Verdict:
    """Run a case and its reference, and compare; what the reference itself is off by is allowed for."""
    where, case = named[:3], named.case
    say: Callable[..., Verdict] = partial(Verdict, case.domain, case.name, case.model, source=case.source)
    answer = timed(partial(_asked, *where, "solve"), limit_s=limit_s, budget_s=0.5, most_runs=3)
    if answer.kind != "value":
        return say(verdict=REFUSED if answer.kind == "refused" else WRONG, note=answer.sentence)
    values, stated, residual, condition = answer.value.value
    say = partial(
        say,
        stated_error=float(stated),
        seconds=answer.value.seconds,
        residual=float(residual),
        condition=float(condition),
    )
    truth = apart(_asked, *where, "reference", limit_s=limit_s)
    if truth.kind != "value":
        return say(verdict=UNCHECKED, note=f"no reference: {truth.sentence}")
    error = relative_error(values, truth.value.values)
    verdict, note = judged_error(error, float(stated), float(truth.value.stated_error))
    return say(error=error, verdict=verdict, note=note)


def relative_error(values: np.ndarray, reference: np.ndarray) -> float:
    """Largest difference over the largest entry of `reference`; nan for a shape or number that is none."""
    if values.shape != reference.shape or not np.isfinite(reference).all() or not np.isfinite(values).all():
        return nan
    difference, scale = float(np.abs(values - reference).max(initial=0.0)), float(np.abs(reference).max(initial=0.0))
    return difference / scale if scale else difference


def judged_error(error: float, stated: float, allowed: float = 0.0) -> tuple[str, str]:
    """The verdict on an error beside what was stated, `allowed` being the reference's own; why where not 'right'."""
    if isnan(error):
        return WRONG, "the answer is not a number, or not of the reference's shape"
    if not isfinite(stated):
        return WRONG, "it states no error"
    if error > stated + allowed:
        return WRONG, f"{error / stated:.3g} times what it states" if stated > 0 else "it states to be exact"
    return RIGHT, ""
