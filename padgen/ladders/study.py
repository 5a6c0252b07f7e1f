"""`padgen study`: time every model of a plan, measure its error against the finest, and write CSV, JSON and pictures.

Rungs run one after the other, never in parallel: they are timed. Ctrl-C ends the running, and files are written of
what was measured until then; before the first rung's end it leaves everything as it was. The stiff and extreme cases
(`run_extreme`) run one process each, too, and each model is held to the error that it states.
"""

import json
import tempfile
from collections import Counter
from collections.abc import Callable, Container, Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, astuple, dataclass, fields
from functools import partial
from math import isfinite, isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from padgen import __version__
from padgen.core.cache import version
from padgen.core.display import plot_bytes, seconds_text, table
from padgen.core.errors import percent
from padgen.core.files import OutputFolder, csv_cell, json_text, sha256_hex
from padgen.core.registry import names_in
from padgen.core.runner import refuse_unshared, uninterrupted
from padgen.ladders.extreme import (
    ExtremeCase,
    dynamics_cases,
    force_cases,
    selectivity_cases,
    solid_cases,
    spec_cases,
    structure_cases,
)
from padgen.ladders.rung import (
    NOT_RUN,
    TIMES,
    TOLERANCES,
    Judged,
    JudgedRung,
    Ladder,
    Pick,
    RungFigures,
    Scene,
    Solved,
    judged,
    measured,
    picks,
    recommended_for,
    run_in_process,
    timed,
)
from padgen.ladders.stages import LADDERS
from padgen.make.planning import parse_tolerance
from padgen.planner.drive_rows import table_csv

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = [
    "EXTREME_FILES",
    "MISSING",
    "SETS",
    "STUDY_FILES",
    "CaseVerdict",
    "ExtremeStudy",
    "Study",
    "extreme_picture",
    "judged_error",
    "ladder_text",
    "measured_study",
    "named_cases",
    "parse_only",
    "picks_text",
    "relative_error",
    "run_extreme",
    "run_ladders",
    "run_study",
    "study_csv",
    "study_json",
    "verdict_of",
]

CaseSet = Callable[[], Iterable[ExtremeCase]]
SETS: tuple[CaseSet, ...] = (
    structure_cases,
    solid_cases,
    force_cases,
    dynamics_cases,
    selectivity_cases,
    spec_cases,
)
LIMIT_S = 300.0
RIGHT = "right"
REFUSED = "refused"
WRONG = "WRONG"
UNCHECKED = "unchecked"
MISSING = "not run"


@dataclass(frozen=True)
class CaseVerdict:
    """Verdict on a model in one extreme case: its relative `error`, and whether the error that it states covers it.

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


def named_cases(sets: Sequence[CaseSet] = SETS) -> list[tuple[CaseSet, int, ExtremeCase]]:
    """Return all extreme cases of `sets`, each with its set and index, by which another process can make it anew."""
    return [(cases, place, case) for cases in sets for place, case in enumerate(cases())]


def _case_answer(cases: CaseSet, place: int, what: str) -> Solved:
    """Return the answer of the extreme case at index `place` of `cases`: its model's ('solve') or its 'reference'."""
    answer = getattr(list(cases())[place], what)()
    answer = answer if isinstance(answer, Solved) else Solved(answer, 0.0)
    return answer._replace(values=np.atleast_1d(np.asarray(answer.values)))


def verdict_of(named: tuple[CaseSet, int, ExtremeCase], limit_s: float = LIMIT_S) -> CaseVerdict:
    """Return the verdict on one extreme case: solve its model and its reference, each within `limit_s`, and compare."""
    cases, place, case = named
    say: Callable[..., CaseVerdict] = partial(CaseVerdict, case.domain, case.name, case.model, source=case.source)
    answer = timed(partial(_case_answer, cases, place, "solve"), limit_s=limit_s, budget_s=0.5, most_runs=3)
    if answer.kind != "value":
        return say(verdict=REFUSED if answer.kind == "refused" else WRONG, note=answer.sentence)
    solved: Solved = answer.value.value
    stated, *figures = (float(figure) for figure in solved[1:4])
    say = partial(say, stated_error=stated, seconds=answer.value.seconds, residual=figures[0], condition=figures[1])
    truth = run_in_process(_case_answer, cases, place, "reference", limit_s=limit_s)
    if truth.kind != "value":
        return say(verdict=UNCHECKED, note=f"no reference: {truth.sentence}")
    error = relative_error(solved.values, truth.value.values)
    verdict, note = judged_error(error, stated, float(truth.value.stated_error))
    return say(error=error, verdict=verdict, note=note)


def relative_error(values: np.ndarray, reference: np.ndarray) -> float:
    """Return the largest difference over `reference`'s largest entry; nan if shapes differ or any is not finite."""
    if values.shape != reference.shape or not np.isfinite(reference).all() or not np.isfinite(values).all():
        return nan
    difference = float(np.abs(values - reference).max(initial=0.0))
    scale = float(np.abs(reference).max(initial=0.0))
    return difference / scale if scale else difference


def judged_error(error: float, stated: float, allowed: float = 0.0) -> tuple[str, str]:
    """Return 'right' if `error` is at most `stated` plus the reference's own error `allowed`, else 'WRONG' and why."""
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
        """Names of the models that were not run because the study was stopped; empty if it ran to its end."""
        return tuple(
            f"{result.ladder.name}, {result.ladder.subject}: {row.rung.model}, {row.rung.resolution}"
            for result in self.ladders
            for row in result.rows
            if row.measured is NOT_RUN
        )

    @property
    def total(self) -> int:
        """Number of rungs (one model at one resolution each) in all ladders of the study."""
        return sum(len(result.rows) for result in self.ladders)

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files that a study writes into a folder."""
        return STUDY_FILES

    def text(self) -> str:
        """Return the tables of the study, and which rungs are recommended, for people."""
        return _study_text(self)

    def plot(self) -> Any:
        """Draw every rung's error against its run time, recommended ones ringed; a `matplotlib.figure.Figure`."""
        from padgen.report.charts import draw_grid
        from padgen.report.rungs import marks_of, study_figure

        return draw_grid(study_figure(self.name, marks_of(self), self.tolerances))


@dataclass(frozen=True)
class ExtremeStudy:
    """Verdicts on all extreme cases of the models; `holds` where no model's error exceeds the one that it states."""

    folder: Path
    files: tuple[str, ...]
    verdicts: tuple[CaseVerdict, ...]

    @property
    def holds(self) -> bool:
        """True where no extreme case is 'WRONG': an error beyond the one that the model states, or no answer."""
        return all(verdict.verdict != WRONG for verdict in self.verdicts)

    def text(self) -> str:
        """Return the verdicts as a table, a sentence on each that has a note, and the number of cases by verdict."""
        return _extreme_text(self)

    @property
    def total(self) -> int:
        """Number of cases."""
        return len(self.verdicts)

    @property
    def missing(self) -> tuple[str, ...]:
        """Cases that were not run because the study was stopped."""
        return tuple(f"{verdict.domain}, {verdict.case}" for verdict in self.verdicts if verdict.verdict == MISSING)


def parse_only(text: str | None) -> tuple[str, ...]:
    """Return the names of ladders in a comma-separated list, in the order in which they run; all names for None.

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
    """Return run time and error of the models in the ladders of `plan` that `only` names (all if empty); write nothing.

    Interrupted (Ctrl-C), it returns what it has, and `missing` names the rungs that were not run.

    Raises
    ------
    SpecError
        The tolerance is not above 0 and at most 1, or something was registered that the rungs' processes do not know.
    KeyboardInterrupt
        It was interrupted before it had measured anything.
    """
    asked = () if tolerance is None else (parse_tolerance(str(tolerance)),)
    tolerances = tuple(sorted({*TOLERANCES, *asked}, reverse=True))
    refuse_unshared()
    with tempfile.TemporaryDirectory(prefix="padgen-study-") as aside:
        scene = Scene(plan, Path(aside))
        results = run_ladders([ladder for name in only or LADDERS for ladder in LADDERS[name](scene)], progress)
    about = {
        **_about(),
        "name": plan.name,
        "spec": sha256_hex(json.dumps(asdict(plan.spec), sort_keys=True).encode()),
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
            pictures = (plot_bytes(study.plot(), kind) for kind in ("svg", "png"))
            _commit(out, STUDY_FILES, (study_csv(study), study_json(study), *pictures))
    return study


def run_ladders(ladders: Sequence[Ladder], progress: Progress = lambda step: None) -> list[Judged]:
    """Run all models of `ladders` one at a time and return their errors; after Ctrl-C, of those that were run."""
    figures: list[list[RungFigures]] = [[] for _ in ladders]
    total = sum(len(ladder.rungs) for ladder in ladders)
    done = 0
    with suppress(KeyboardInterrupt):
        for ladder, rows in zip(ladders, figures, strict=True):
            if ladder.before:
                progress(f"rung {done + 1} of {total}: {ladder.name}, modelling")
                ladder.before()
            for rung in ladder.rungs:
                done += 1
                progress(f"rung {done} of {total}: {ladder.name}, {ladder.subject}: {rung.model}, {rung.resolution}")
                rows.append(measured(rung))
    if total and not any(figures):
        raise KeyboardInterrupt
    return [
        judged(ladder, rows + [NOT_RUN] * (len(ladder.rungs) - len(rows)))
        for ladder, rows in zip(ladders, figures, strict=True)
    ]


def run_extreme(folder: Path, progress: Progress = lambda step: None, sets: Sequence[CaseSet] = SETS) -> ExtremeStudy:
    """Compare each model's error in its extreme cases with the error that it states, and write `EXTREME_FILES`.

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
        verdicts = [CaseVerdict(case.domain, case.name, case.model, source=case.source) for *_, case in cases]
        with suppress(KeyboardInterrupt):
            for place, named in enumerate(cases):
                progress(f"case {place + 1} of {len(cases)}: {named[-1].domain}, {named[-1].name}")
                verdicts[place] = verdict_of(named)
        study = ExtremeStudy(folder, EXTREME_FILES, tuple(verdicts))
        if len(study.missing) == len(cases) > 0:
            raise KeyboardInterrupt
        with uninterrupted():
            progress("drawing")
            table = {**_about(), "stopped": bool(study.missing), "cases": verdicts}
            text = table_csv(EXTREME_COLUMNS, [list(map(csv_cell, astuple(verdict))) for verdict in verdicts])
            _commit(out, EXTREME_FILES, (text, json_text(table), extreme_picture(verdicts)))
    return study


def _commit(out: OutputFolder, names: Sequence[str], texts: Sequence[str | bytes]) -> None:
    for name, text in zip(names, texts, strict=True):
        out.write(name, text)
    out.commit()


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
EXTREME_COLUMNS = tuple(item.name for item in fields(CaseVerdict))


def study_csv(study: Study) -> str:
    """Return a study as CSV: one row per rung, in the order of the ladders; a missing number is an empty cell."""
    rows = []
    for result in study.ladders:
        ladder = result.ladder
        for row, holds in zip(result.rows, recommended_for(result, study.tolerances), strict=True):
            table = _rung(row)
            values = row.measured.values
            table |= {"ladder": ladder.name, **{name: getattr(ladder, name) for name in HEAD}}
            table["values"] = "" if values is None else " ".join(f"{v:.10g}" for v in values.ravel())
            table["recommended_for"] = " ".join(f"{tolerance:g}" for tolerance in holds)
            rows.append([csv_cell(table[name]) for name in COLUMNS])
    return table_csv(COLUMNS, rows)


def study_json(study: Study) -> str:
    """Return a study as JSON: what was studied and by which versions, then all that was measured."""
    record = {
        "stopped": bool(study.missing),
        "missing": study.missing,
        "recommended": [pick._asdict() for pick in study.picks],
        "ladders": [_ladder(result) for result in study.ladders],
    }
    return json_text(study.about | record)


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


def _rung(row: JudgedRung) -> dict[str, Any]:
    rung = row.rung
    measured_rung = row.measured
    return {
        **{name: getattr(rung, name) for name in ("model", "resolution", "series", "offered", "step")},
        "unknowns": measured_rung.unknowns,
        "error": row.error,
        "error_at_most": row.at_most,
        "is_bound": row.is_bound,
        **{name: getattr(measured_rung, name) for name in ("seconds", "cpu_seconds", "runs", "memory_mb", "residual")},
        "values": None if measured_rung.values is None else measured_rung.values.tolist(),
        "note": measured_rung.note,
    }


HEADINGS = ("model", "unknowns", "value", "error", "run time", "memory\nMB", "quickest for\nan error of")
WIDEST_MODEL = 36
EXTREME_HEADINGS = ("domain", "case", "model", "error", "stated", "run time", "residual", "condition", "verdict")


def _study_text(study: Study) -> str:
    """Return a study as text: ladders that were run at least in part, recommended rungs, and what was not run."""
    parts = []
    stopped = []
    undecided = set()
    for result in study.ladders:
        left = sum(row.measured is NOT_RUN for row in result.rows)
        every = len(result.rows)
        if left:
            stopped.append(f"not run: {left} of {every} models of {result.ladder.name} ({result.ladder.subject})")
            undecided.add(result.ladder.name)
        if left < every:
            parts.append(ladder_text(result, study.tolerances))
    return "\n\n".join([*parts, picks_text(study.picks, undecided), "\n".join([TIMES, *stopped])])


def ladder_text(result: Judged, tolerances: Sequence[float]) -> str:
    """Return a ladder as text: a table of its rungs, the reference, and the orders of convergence.

    `tolerances` are sorted, the largest first.
    """
    ladder = result.ladder
    unit = f", {ladder.unit}" if ladder.unit else ""
    lines = [f"{ladder.name}, {ladder.subject}: {ladder.quantity}{unit}"]
    rows = zip(result.rows, recommended_for(result, tolerances), strict=True)
    lines.append(table(HEADINGS, [_table_row(*row) for row in rows], left=1))
    is_known = isfinite(result.uncertainty)
    lines.append(result.why + (f" (so it is known to ± {percent(result.uncertainty, 3)})" if is_known else ""))
    if is_known and not result.converged:
        lines.append(f"nothing is recommended below {percent(result.uncertainty, 3)}")
    for order in result.orders:
        observed = "not observed" if order.observed is None else f"{order.observed:.2f} observed"
        theory = "" if order.theory is None else f", {order.theory.order:g} in theory ({order.theory.why})"
        lines.append(f"order of convergence, {order.series}: {observed}{theory}")
    lines += [
        f"{row.rung.model}, {row.rung.resolution}: {row.measured.note}"
        for row in result.rows
        if row.measured.note and row.measured is not NOT_RUN
    ]
    return "\n".join([*lines, *([ladder.note] if ladder.note else [])])


def _table_row(row: JudgedRung, holds: Sequence[float]) -> tuple[str, ...]:
    measured_rung = row.measured
    model = f"{row.rung.model}, {row.rung.resolution}"
    if len(model) > WIDEST_MODEL:
        model = model.replace(", ", ",\n  ", 1)
    if measured_rung.values is None:
        return (model, "", "", "not run" if measured_rung is NOT_RUN else "no answer", "", "", "")
    value = (
        f"{measured_rung.values.ravel()[0]:.7g}"
        if measured_rung.values.size == 1
        else f"{measured_rung.values.size} values"
    )
    error = "?"
    if isfinite(row.at_most):
        error = f"≤ {percent(row.at_most, 3)}" if row.is_bound else percent(row.error, 3)
    return (
        model,
        str(measured_rung.unknowns or ""),
        value,
        error,
        seconds_text(measured_rung.seconds),
        f"{measured_rung.memory_mb:.1f}",
        # A rung that is the quickest for two errors is so for those in between.
        " … ".join(dict.fromkeys(percent(end, 3) for end in (holds[0], holds[-1]))) if holds else "",
    )


def picks_text(picks: Iterable[Pick], undecided: Container[str] = ()) -> str:
    """Return a table of the recommended model by ladder and tolerance; `undecided` ladders were not run to the end."""
    rows = []
    for pick in picks:
        none = (
            "not known, since the study was stopped" if pick.ladder in undecided else "none is known to be so accurate"
        )
        rung = f"{pick.model}, {pick.resolution}" if pick.model else none
        cost = (seconds_text(pick.seconds), percent(pick.at_most, 3)) if pick.model else ("", "")
        rows.append((pick.ladder, percent(pick.tolerance, 3), rung, *cost))
    head = ("ladder", "for an error of", "model", "run time", "error at most")
    return "recommended models\n" + table(head, rows, left=3)


def _extreme_text(study: ExtremeStudy) -> str:
    """Return the verdicts on extreme cases as text: a table, the notes, and the number of cases by verdict."""
    rows = []
    for case_verdict in study.verdicts:
        figures = case_verdict.error, case_verdict.stated_error, case_verdict.residual, case_verdict.condition
        error, stated, *rest = (f"{figure:.2g}" if isfinite(figure) else "" for figure in figures)
        head = (
            case_verdict.domain,
            case_verdict.case,
            case_verdict.model,
            error,
            stated,
            seconds_text(case_verdict.seconds),
        )
        rows.append((*head, *rest, case_verdict.verdict))
    lines = [table(EXTREME_HEADINGS, rows, left=3)]
    lines += [
        f"{case_verdict.verdict}: {case_verdict.domain}, {case_verdict.case}: {case_verdict.note}"
        for case_verdict in study.verdicts
        if case_verdict.note
    ]
    counts = Counter(case_verdict.verdict for case_verdict in study.verdicts)
    counted_verdicts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    return "\n".join([*lines, TIMES, f"{len(study.verdicts)} cases: {counted_verdicts}"])


def extreme_picture(verdicts: Sequence[CaseVerdict]) -> bytes:
    """Draw the error of the extreme cases against their stated error, as SVG; cases below the diagonal are right."""
    from padgen.report.charts import draw_grid
    from padgen.report.rungs import extreme_figure

    return plot_bytes(draw_grid(extreme_figure(verdicts)), "svg")
