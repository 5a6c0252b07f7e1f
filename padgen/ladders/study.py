"""`padgen study`: run the ladders rung by rung, judge them, and leave the files: CSV, JSON and pictures.

Rungs run one after the other, never in parallel: they are timed. Ctrl-C ends the running, and files are written of
what was measured until then; before the first rung's end it leaves everything as it was. The stiff and extreme cases
(`run_extreme`) run one process each, too, and each model is held to the error that it states.
"""

import importlib
import json
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, astuple, dataclass, fields
from functools import partial
from math import isfinite, isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from padgen import __version__
from padgen.core.cache import version
from padgen.core.errors import SolverError
from padgen.core.files import OutputFolder, file_hash, json_text
from padgen.core.registry import names_in
from padgen.core.runner import refuse_unshared, uninterrupted
from padgen.ladders.rung import (
    NOT_RUN,
    TIMES,
    TOLERANCES,
    Judged,
    Ladder,
    Measured,
    Pick,
    Row,
    Scene,
    apart,
    judged,
    measured,
    picks,
    recommended_row,
    timed,
)
from padgen.ladders.stages import LADDERS
from padgen.make.planning import parse_tolerance
from padgen.planner.drive_rows import table_csv
from padgen.verify.extreme import Answer, ExtremeCase

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = [
    "EXTREME_FILES",
    "MISSING",
    "SETS",
    "STUDY_FILES",
    "ExtremeStudy",
    "Named",
    "Study",
    "Verdict",
    "judged_error",
    "measured_study",
    "missing_rungs",
    "named_cases",
    "parse_only",
    "relative_error",
    "run_extreme",
    "run_ladders",
    "run_study",
    "study_csv",
    "study_json",
    "verdict_of",
]

SETS = (
    ("padgen.verify.extreme", "structure_cases"),
    ("padgen.verify.extreme", "solid_cases"),
    ("padgen.verify.extreme", "force_cases"),
    ("padgen.verify.extreme", "dynamics_cases"),
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
    """The verdict on a case: the columns of its table. `error` is relative, against the case's own reference.

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
    """List all cases of `sets`.

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
    """Return the answer of a case's model ('solve') or of its 'reference'; run in a process of its own."""
    answer = getattr(_cases(module, function)[place], what)()
    answer = answer if isinstance(answer, Answer) else Answer(answer, 0.0)
    return answer._replace(values=np.atleast_1d(np.asarray(answer.values)))


def verdict_of(named: Named, limit_s: float = LIMIT_S) -> Verdict:
    """Run a case and its reference, and compare them, allowing for the reference's own error."""
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
    """Return the largest difference over the largest entry of `reference`; nan for a shape or number that is none."""
    if values.shape != reference.shape or not np.isfinite(reference).all() or not np.isfinite(values).all():
        return nan
    difference, scale = float(np.abs(values - reference).max(initial=0.0)), float(np.abs(reference).max(initial=0.0))
    return difference / scale if scale else difference


def judged_error(error: float, stated: float, allowed: float = 0.0) -> tuple[str, str]:
    """Return the verdict on an error beside the stated one (plus `allowed`, the reference's), and why if wrong."""
    if isnan(error):
        return WRONG, "the answer is not a number, or not of the reference's shape"
    if not isfinite(stated):
        return WRONG, "it states no error"
    if error > stated + allowed:
        return WRONG, f"{error / stated:.3g} times what it states" if stated > 0 else "it states to be exact"
    return RIGHT, ""


STUDY_FILES = ("study.csv", "study.json", "study.svg", "study.png")
EXTREME_FILES = ("extreme.csv", "extreme.json", "extreme.svg")
PACKAGES = ("numpy", "scipy", "ngsolve", "build123d", "mpmath")
Progress = Callable[[str], None]


@dataclass(frozen=True, repr=False)
class Study:
    """Error against run time of the models behind a plan; made by `padgen.study`.

    `tolerances` are the usual ones and the one that was asked for, `picks` the quickest rungs that meet them; `about`
    has versions, the spec's hash and what the run times are.
    """

    name: str
    ladders: tuple[Judged, ...]
    picks: tuple[Pick, ...]
    tolerances: tuple[float, ...]
    about: dict[str, Any]

    def __repr__(self) -> str:
        return f"<Study {self.name}: {', '.join(dict.fromkeys(result.ladder.name for result in self.ladders))}>"

    @property
    def missing(self) -> tuple[str, ...]:
        """Rungs that were not run since the study was stopped; none where it was not."""
        return missing_rungs(self.ladders)

    def plot(self) -> Any:
        """Draw every rung's error against its run time; a `matplotlib.figure.Figure`."""
        from padgen.ladders.text import study_figure

        return study_figure(self.ladders, self.tolerances, self.name)


@dataclass(frozen=True)
class ExtremeStudy:
    """The verdicts on the extreme cases; `holds` where none is worse than it states."""

    folder: Path
    files: tuple[str, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def holds(self) -> bool:
        """True where no case is wrong."""
        return all(found.verdict != WRONG for found in self.verdicts)

    @property
    def missing(self) -> tuple[str, ...]:
        """Cases that were not run since the study was stopped."""
        return tuple(f"{found.domain}, {found.case}" for found in self.verdicts if found.verdict == MISSING)


def parse_only(text: str | None) -> tuple[str, ...]:
    """Read ladders from a comma-separated list, in the order in which they run; None means all.

    Raises
    ------
    SpecError
        A name is no ladder's; the message has the nearest that is.
    """
    return tuple(LADDERS) if text is None else names_in(text, LADDERS, "--only")


def measured_study(
    plan: "Plan",
    only: Sequence[str] = (),
    tolerance: float | None = None,
    progress: Progress = lambda step: None,
) -> Study:
    """Measure the ladders named in `only` (all without) on `plan`; nothing is written.

    Interrupted (Ctrl-C), it returns what it has, and `missing` names the rungs that were not run.

    Raises
    ------
    SpecError
        The tolerance is not above 0 and at most 1, or something was registered that the rungs' processes do not know.
    KeyboardInterrupt
        It was interrupted before it had measured anything.
    """
    tolerances = _tolerances(tolerance)
    refuse_unshared()
    with tempfile.TemporaryDirectory(prefix="padgen-study-") as aside:
        scene = Scene(plan, Path(aside))
        results = run_ladders([ladder for name in only or LADDERS for ladder in LADDERS[name](scene)], progress)
    about = {
        **_about(),
        "name": plan.name,
        "spec": file_hash(json.dumps(asdict(plan.spec), sort_keys=True).encode()),
        "tolerances": list(tolerances),
    }
    return Study(plan.name, tuple(results), picks(results, tolerances), tolerances, about)


def run_study(
    plan: "Plan",
    folder: Path,
    only: Sequence[str] = (),
    tolerance: float | None = None,
    progress: Progress = lambda step: None,
) -> Study:
    """Measure as `measured_study` does, and write `STUDY_FILES` into `folder`.

    Raises
    ------
    SpecError
        The tolerance is not above 0 and at most 1.
    FileError
        The folder cannot be written; what was there stays.
    """
    with OutputFolder(folder) as out:
        study = measured_study(plan, only, tolerance, progress)
        with uninterrupted():
            progress("drawing")
            from padgen.ladders.text import study_pictures

            pictures = study_pictures(study.ladders, study.tolerances, study.name)
            texts = (
                study_csv(study.ladders, study.tolerances),
                study_json(study.ladders, study.about, study.tolerances),
            )
            _commit(out, STUDY_FILES, (*texts, *pictures))
    return study


def run_ladders(ladders: Sequence[Ladder], progress: Progress = lambda step: None) -> list[Judged]:
    """Run all rungs of some ladders, one at a time, and judge them; after Ctrl-C, what was measured until then."""
    found: list[list[Measured]] = [[] for _ in ladders]
    total, done = sum(len(ladder.rungs) for ladder in ladders), 0
    with suppress(KeyboardInterrupt):
        for ladder, own in zip(ladders, found, strict=True):
            if ladder.before:
                progress(f"rung {done + 1} of {total}: {ladder.name}, modelling")
                ladder.before()
            for rung in ladder.rungs:
                done += 1
                where = f"{ladder.name}, {ladder.subject}: {rung.model}, {rung.resolution}"
                progress(f"rung {done} of {total}: {where}")
                own.append(measured(rung))
    if total and not any(found):
        raise KeyboardInterrupt
    return [
        judged(ladder, own + [NOT_RUN] * (len(ladder.rungs) - len(own)))
        for ladder, own in zip(ladders, found, strict=True)
    ]


def run_extreme(
    folder: Path, progress: Progress = lambda step: None, sets: tuple[tuple[str, str], ...] = SETS
) -> ExtremeStudy:
    """Hold every model to what it states in its extreme cases, and write `EXTREME_FILES` into `folder`.

    Interrupted (Ctrl-C), the cases that were left are 'not run'.

    Raises
    ------
    FileError
        The folder cannot be written; what was there stays.
    KeyboardInterrupt
        It was interrupted before the first case was done.
    """
    with OutputFolder(folder) as out:
        cases = named_cases(sets)
        verdicts = [Verdict(case.domain, case.name, case.model, source=case.source) for *_, case in cases]
        with suppress(KeyboardInterrupt):
            for place, named in enumerate(cases):
                progress(f"case {place + 1} of {len(cases)}: {named.case.domain}, {named.case.name}")
                verdicts[place] = verdict_of(named)
        study = ExtremeStudy(folder, EXTREME_FILES, tuple(verdicts))
        if len(study.missing) == len(cases) > 0:
            raise KeyboardInterrupt
        with uninterrupted():
            progress("drawing")
            from padgen.ladders.text import extreme_picture

            table = {**_about(), "stopped": bool(study.missing), "cases": verdicts}
            texts = _csv(EXTREME_COLUMNS, [astuple(found) for found in verdicts]), json_text(table)
            _commit(out, EXTREME_FILES, (*texts, extreme_picture(verdicts)))
    return study


def _commit(out: OutputFolder, names: Sequence[str], texts: Sequence[str | bytes]) -> None:
    for name, text in zip(names, texts, strict=True):
        out.write(name, text)
    out.commit()


def _tolerances(asked: float | None) -> tuple[float, ...]:
    if asked is not None and not 0 < asked <= 1:
        return _tolerances(parse_tolerance(repr(asked)))
    return tuple(sorted({*TOLERANCES, *([] if asked is None else [asked])}, reverse=True))


def _about() -> dict[str, Any]:
    return {"padgen": __version__, "versions": {name: version(name) for name in PACKAGES}, "times": TIMES}


HEAD = ("subject", "quantity", "unit")
COLUMNS = (
    "ladder",
    *HEAD,
    "model",
    "resolution",
    "series",
    "step",
    "unknowns",
    "error",
    "error_at_most",
    "seconds",
    "cpu_seconds",
    "runs",
    "memory_mb",
    "residual",
    "recommended_for",
    "values",
    "note",
)
EXTREME_COLUMNS = tuple(item.name for item in fields(Verdict))


def missing_rungs(results: Sequence[Judged]) -> tuple[str, ...]:
    """Name the rungs that were not run since the study was stopped."""
    return tuple(
        f"{result.ladder.name}, {result.ladder.subject}: {row.rung.model}, {row.rung.resolution}"
        for result in results
        for row in result.rows
        if row.measured is NOT_RUN
    )


def study_csv(results: Sequence[Judged], tolerances: Sequence[float] = TOLERANCES) -> str:
    """Write one row per rung, in the order of the ladders; no number is an empty cell."""
    rows = []
    for result in results:
        ladder = result.ladder
        for index, row in enumerate(result.rows):
            table, values = _rung(row), row.measured.values
            table |= {"ladder": ladder.name, **{name: getattr(ladder, name) for name in HEAD}}
            table["values"] = "" if values is None else " ".join(f"{v:.10g}" for v in values.ravel())
            holds = [f"{tol:g}" for tol in tolerances if recommended_row(result, tol) == index]
            table["recommended_for"] = " ".join(holds)
            rows.append([table[name] for name in COLUMNS])
    return _csv(COLUMNS, rows)


def _csv(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    cells = ([v if not isinstance(v, float) else f"{v:.10g}" if isfinite(v) else "" for v in row] for row in rows)
    return table_csv(columns, cells)


def study_json(results: Sequence[Judged], about: dict[str, Any], tolerances: Sequence[float] = TOLERANCES) -> str:
    """Write all that was measured, with `about` (what was studied, by which versions) ahead of it."""
    missing = missing_rungs(results)
    told = {
        "stopped": bool(missing),
        "missing": missing,
        "recommended": [p._asdict() for p in picks(results, tolerances)],
    }
    return json_text({**about, **told, "ladders": [_ladder(result) for result in results]})


def _ladder(result: Judged) -> dict[str, Any]:
    ladder = result.ladder
    return {
        "ladder": ladder.name,
        **{name: getattr(ladder, name) for name in (*HEAD, "relative_to", "note")},
        **{name: getattr(result, name) for name in ("reference", "uncertainty", "converged", "why")},
        "orders": [
            {
                "series": order.series,
                "observed": order.observed,
                "theory": order.theory.order if order.theory else None,
                "why": order.theory.why if order.theory else "",
            }
            for order in result.orders
        ],
        "rungs": [_rung(row) for row in result.rows],
    }


def _rung(row: Row) -> dict[str, Any]:
    rung, own = row.rung, row.measured
    return {
        **{name: getattr(rung, name) for name in ("model", "resolution", "series", "offered", "step")},
        "unknowns": own.unknowns,
        "error": row.error,
        "error_at_most": row.at_most,
        "is_bound": row.is_bound,
        **{name: getattr(own, name) for name in ("seconds", "cpu_seconds", "runs", "memory_mb", "residual")},
        "values": None if own.values is None else own.values.tolist(),
        "note": own.note,
    }
