"""`padgen study`: run the ladders rung by rung, judge them, and leave the files: CSV, JSON and a picture.

A rung runs in a process of its own, on one thread: a crash of an engine costs one rung, netgen and build123d never
meet in one process, and the peak of memory is the rung's own. Rungs run one after the other, never in parallel: they
are timed. Ctrl-C ends the running, and files are written of what was measured until then; before the first rung's end
it leaves everything as it was.

The reference of a ladder is the last rung of its series `reference`. Two refinements lead to it:
with differences d₁, then d₂, and their ratio r = d₂/d₁, a sequence that goes on falling by r has
``d₂ r/(1 − r)`` left, which is below d₂ for r ≤ ½ (Aitken's estimate; Roache, *Annu. Rev. Fluid Mech.*
29, 1997, for grids). So the reference's own uncertainty is d₂, more when r is larger, and not less than
a share of d₁: a last step that hardly changed anything may have refined what does not matter.
Differences that do not fall show nothing.
"""

import gc
import json
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import ceil, floor, inf, isfinite, isnan, log10, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from padgen import __version__
from padgen.core.cache import version
from padgen.core.display import COLOURS, INK, PALE, plot_bytes, plot_style, seconds_text, table
from padgen.core.errors import SolverError, percent
from padgen.core.files import OutputFolder, file_hash, json_text
from padgen.core.registry import names_in
from padgen.core.runner import Runner, peak_mb, refuse_unshared, reset_peak, uninterrupted
from padgen.ladders.stages import LADDERS, Ladder, Rung, Scene, Solved
from padgen.make.planning import parse_tolerance
from padgen.planner.drive_rows import table_csv

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = [
    "NOT_RUN",
    "STUDY_FILES",
    "TIMES",
    "TOLERANCES",
    "Judged",
    "Measured",
    "Pick",
    "Row",
    "Study",
    "judged",
    "ladder_text",
    "measured",
    "measured_study",
    "parse_only",
    "picks",
    "picks_text",
    "recommended_for",
    "run_ladders",
    "run_study",
    "run_timed",
    "study_csv",
    "study_figure",
    "study_json",
    "study_text",
]


@dataclass(frozen=True)
class Measured:
    """The figures of a rung that was run; `values` is None where it refused or broke down, and `note` says why.

    `seconds` (wall) and `cpu_seconds` are the best of `runs`, `memory_mb` is the peak over what the
    process held after its imports.
    """

    values: np.ndarray | None = None
    unknowns: int = 0
    residual: float = nan
    seconds: float = nan
    cpu_seconds: float = nan
    runs: int = 0
    memory_mb: float = nan
    note: str = ""


NOT_RUN = Measured(note="not run: the study was stopped")


@dataclass(frozen=True)
class Row:
    """A rung with what was measured and its `error`, which is at most `at_most`.

    With `is_bound` the error cannot be told from the reference's own: only `at_most` is known.
    """

    rung: Rung
    measured: Measured
    error: float = nan
    at_most: float = inf
    is_bound: bool = False


@dataclass(frozen=True)
class Judged:
    """A ladder that was run. `uncertainty` is the reference's own error, inf where nothing is known of it.

    `converged` tells whether two refinements show it; `why` is that as a sentence. `reference` is
    the index of its row, None where no rung of the reference's series has an answer.
    """

    ladder: Ladder
    rows: tuple[Row, ...]
    reference: int | None
    uncertainty: float
    converged: bool
    why: str


TOLERANCES = (0.1, 0.01, 0.001, 0.0001)
ROUNDING = 1e-12
"""Relative differences that are as good as none."""
SLOWEST = 0.7
"""Largest ratio of two differences that counts as falling."""
FASTEST = 0.05
"""Smallest ratio that is believed."""
CAUTION = 2.0
"""Factor on differences that do not fall, to estimate the error: a guess, and reported as one."""


class Pick(NamedTuple):
    """The cheapest rung that meets a tolerance for every subject of a ladder, and what it costs and errs."""

    ladder: str
    tolerance: float
    model: str
    resolution: str
    seconds: float
    at_most: float


def judged(ladder: Ladder, measured: Sequence[Measured]) -> Judged:
    """Return errors and the reference of a ladder from its measured rungs, in its order."""
    line = [i for i, rung in enumerate(ladder.rungs) if rung.series == ladder.reference]
    solved = [i for i in line if measured[i].values is not None]
    reference = solved[-1] if solved else None
    uncertainty, converged, why = _uncertainty(ladder, measured, solved)
    if line and solved and solved[-1] != line[-1]:
        why += f"; finer ones have no answer ({measured[line[-1]].note})"
    rows = []
    for rung, figures in zip(ladder.rungs, measured, strict=True):
        error = inf if reference is None else _distance(ladder, figures, measured[reference])
        row = Row(rung, figures, error, error + uncertainty, error <= uncertainty)
        rows.append(row if isfinite(error) else Row(rung, figures))
    return Judged(ladder, tuple(rows), reference, uncertainty, converged, why)


def _uncertainty(ladder: Ladder, measured: Sequence[Measured], solved: Sequence[int]) -> tuple[float, bool, str]:
    """Return the reference's own relative error, whether it is shown, and a sentence on it."""
    if not solved:
        return inf, False, f"no rung of '{ladder.reference}' has an answer, so that there is no reference"
    name = f"{ladder.rungs[solved[-1]].model}, {ladder.rungs[solved[-1]].resolution}"
    if len(solved) < 3:
        return inf, False, f"the reference {name} is not shown to be converged: it needs two coarser ones"
    first, second = (_distance(ladder, measured[a], measured[b]) for a, b in pairwise(solved[-3:]))
    said = f"the last two refinements changed it by {percent(first)} and {percent(second)}"
    ratio = second / first if first > 0 else inf
    if second <= ROUNDING or ratio <= SLOWEST:
        left = second * max(1.0, ratio / (1 - ratio)) if ratio <= SLOWEST else second
        return max(left, FASTEST * first, ROUNDING), True, f"the reference is {name}: {said}"
    return CAUTION * max(first, second), False, f"the reference is {name}, which is not shown to be converged: {said}"


def _distance(ladder: Ladder, one: Measured, other: Measured) -> float:
    """Return the largest difference of two answers, relative to the second as the ladder says.

    inf where they have no common shape.
    """
    a, b = one.values, other.values
    if a is None or b is None or a.shape != b.shape:
        return inf
    scale = np.abs(b) if ladder.relative_to == "each" else np.full(b.shape, np.abs(b).max(initial=0.0))
    difference = np.abs(a - b)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(difference > 0, difference / scale, 0.0)
    return float(relative.max(initial=0.0))


def picks(results: Iterable[Judged], tolerances: Sequence[float] = TOLERANCES) -> tuple[Pick, ...]:
    """Return for each ladder and tolerance the rung that is quickest over all subjects and holds for each of them.

    A ladder and tolerance for which none is known has a `Pick` without a model.
    """
    by_ladder: dict[str, list[Judged]] = {}
    for result in results:
        by_ladder.setdefault(result.ladder.name, []).append(result)
    return tuple(_pick(name, own, tol) for name, own in by_ladder.items() for tol in tolerances)


def _pick(name: str, results: Sequence[Judged], tolerance: float) -> Pick:
    held: dict[tuple[str, str], list[Row]] = {}
    for row in (row for result in results for row in result.rows if row.rung.offered and row.at_most <= tolerance):
        held.setdefault((row.rung.model, row.rung.resolution), []).append(row)
    costs = {key: sum(row.measured.seconds for row in rows) for key, rows in held.items() if len(rows) == len(results)}
    if not costs:
        return Pick(name, tolerance, "", "", nan, inf)
    best = min(costs, key=lambda key: costs[key])
    return Pick(name, tolerance, *best, costs[best] / len(results), max(row.at_most for row in held[best]))


def recommended_for(result: Judged, chosen: Iterable[Pick]) -> list[list[float]]:
    """Return for each row of a ladder the tolerances for which it is among the `chosen` picks."""
    rungs = [(result.ladder.name, row.rung.model, row.rung.resolution) for row in result.rows]
    every = [((pick.ladder, pick.model, pick.resolution), pick.tolerance) for pick in chosen]
    return [[tolerance for name, tolerance in every if name == rung] for rung in rungs]


BUDGET_S, MOST_RUNS = 2.0, 7
LONG_S = 6.0
"""A run that takes longer is not repeated, a shorter one at least once."""
MODELS = ("padgen.physics", "padgen.planner", "padgen.verify")
TIMES = (
    f"run times are the best of 2 to {MOST_RUNS} runs (of one run if it takes over {LONG_S:g} s) on one thread, with"
    " empty caches, without starting Python and imports"
)


def measured(rung: Rung) -> Measured:
    """Run a rung again and again in a process of its own; a refusal or a crash is a `Measured` with its sentence."""
    with Runner(imports=rung.imports) as runner:
        answer = runner.run(run_timed, pickle.dumps((rung.prepare, rung.solve)), time_s=rung.limit_s)
    if answer.kind != "value":
        return Measured(note="refused: " * (answer.kind == "refused") + answer.sentence)
    solved, seconds, cpu_seconds, runs, memory_mb = answer.value
    values = np.atleast_1d(np.asarray(solved.values, float))
    known, note = (values, "") if np.isfinite(values).all() else (None, "its answer is not a number")
    unknowns, residual = int(solved.unknowns), float(solved.residual)
    return Measured(known, unknowns, residual, seconds, cpu_seconds, runs, memory_mb, note)


def run_timed(pickled: bytes) -> tuple[Solved, float, float, int, float]:
    """Run a pickled pair in this process: a function to call off the clock or None, and the one to time.

    Returns the answer, the best wall and processor times in s, the number of runs, and the peak of memory in MB over
    what was held before.
    """
    prepare, _ = pickle.loads(pickled)  # so that the modules it names are loaded
    try:
        made = () if prepare is None else (prepare(),)
        reset_peak()
        before = peak_mb() or 0.0
        value, *times = _run(pickled, made)
        memory = max((peak_mb() or 0.0) - before, 0.0)
        walls, cpus = ([seconds] for seconds in times)
        while len(walls) < MOST_RUNS and (len(walls) < 2 or sum(walls) < BUDGET_S) and min(walls) < LONG_S:
            _, *times = _run(pickled, made)
            walls, cpus = [*walls, times[0]], [*cpus, times[1]]
    except MemoryError as error:
        raise SolverError("the machine has not enough memory for it") from error
    return value, min(walls), min(cpus), len(walls), memory


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


STUDY_FILES = ("study.csv", "study.json", "study.svg")
PACKAGES = ("numpy", "scipy", "ngsolve", "build123d")
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
        return tuple(
            f"{result.ladder.name}, {result.ladder.subject}: {row.rung.model}, {row.rung.resolution}"
            for result in self.ladders
            for row in result.rows
            if row.measured is NOT_RUN
        )

    def plot(self) -> Any:
        """Draw every rung's error against its run time; a `matplotlib.figure.Figure`."""
        return study_figure(self)


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
        "padgen": __version__,
        "versions": {name: version(name) for name in PACKAGES},
        "times": TIMES,
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
            out.write(STUDY_FILES[0], study_csv(study))
            out.write(STUDY_FILES[1], study_json(study))
            out.write(STUDY_FILES[2], plot_bytes(study.plot(), "svg"))
            out.commit()
    return study


def run_ladders(ladders: Sequence[Ladder], progress: Progress = lambda step: None) -> list[Judged]:
    """Run all rungs of some ladders, one at a time, and judge them; after Ctrl-C, what was measured until then."""
    found: list[list[Measured]] = [[] for _ in ladders]
    total, done = sum(len(ladder.rungs) for ladder in ladders), 0
    with suppress(KeyboardInterrupt):
        for ladder, own in zip(ladders, found, strict=True):
            if ladder.before:
                progress(f"rung {done + 1} of {total}: {ladder.name}, modelling")
                with Runner() as runner:
                    answer = runner.run(ladder.before)
                if answer.error:
                    raise answer.error
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


def _tolerances(asked: float | None) -> tuple[float, ...]:
    if asked is not None and not 0 < asked <= 1:
        return _tolerances(parse_tolerance(repr(asked)))
    return tuple(sorted({*TOLERANCES, *([] if asked is None else [asked])}, reverse=True))


HEAD = ("subject", "quantity", "unit")
COLUMNS = (
    "ladder",
    *HEAD,
    "model",
    "resolution",
    "series",
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


def study_csv(study: Study) -> str:
    """Write one row per rung, in the order of the ladders; no number is an empty cell."""
    rows = []
    for result in study.ladders:
        ladder = result.ladder
        for row, holds in zip(result.rows, recommended_for(result, study.picks), strict=True):
            table, values = _rung(row), row.measured.values
            table |= {"ladder": ladder.name, **{name: getattr(ladder, name) for name in HEAD}}
            table["values"] = "" if values is None else " ".join(f"{v:.10g}" for v in values.ravel())
            table["recommended_for"] = " ".join(f"{tolerance:g}" for tolerance in holds)
            cells = (table[name] for name in COLUMNS)
            rows.append([v if not isinstance(v, float) else f"{v:.10g}" if isfinite(v) else "" for v in cells])
    return table_csv(COLUMNS, rows)


def study_json(study: Study) -> str:
    """Write all that was measured, with what was studied, by which versions, ahead of it."""
    told = {
        "stopped": bool(study.missing),
        "missing": study.missing,
        "recommended": [p._asdict() for p in study.picks],
        "ladders": [_ladder(result) for result in study.ladders],
    }
    return json_text({**study.about, **told})


def _ladder(result: Judged) -> dict[str, Any]:
    ladder = result.ladder
    return {
        "ladder": ladder.name,
        **{name: getattr(ladder, name) for name in (*HEAD, "relative_to", "note")},
        **{name: getattr(result, name) for name in ("reference", "uncertainty", "converged", "why")},
        "rungs": [_rung(row) for row in result.rows],
    }


def _rung(row: Row) -> dict[str, Any]:
    rung, own = row.rung, row.measured
    return {
        **{name: getattr(rung, name) for name in ("model", "resolution", "series", "offered")},
        "unknowns": own.unknowns,
        "error": row.error,
        "error_at_most": row.at_most,
        "is_bound": row.is_bound,
        **{name: getattr(own, name) for name in ("seconds", "cpu_seconds", "runs", "memory_mb", "residual")},
        "values": None if own.values is None else own.values.tolist(),
        "note": own.note,
    }


HEADINGS = ("model", "unknowns", "value", "error", "run time", "memory\nMB", "quickest for\nan error of")
WIDEST_MODEL = 36


def study_text(study: Study) -> str:
    """Write all ladders of which something was run, the recommended rungs, what times are, and what was not run."""
    parts, stopped = [], []
    for result in study.ladders:
        left, every = sum(row.measured is NOT_RUN for row in result.rows), len(result.rows)
        if left:
            stopped.append(f"not run: {left} of {every} rungs of {result.ladder.name}, {result.ladder.subject}")
        if left < every:
            parts.append(ladder_text(result, study.picks))
    return "\n\n".join([*parts, picks_text(study.picks), "\n".join([TIMES, *stopped])])


def ladder_text(result: Judged, chosen: Iterable[Pick]) -> str:
    """Write one ladder as a table, and what it was measured against."""
    ladder = result.ladder
    unit = f", {ladder.unit}" if ladder.unit else ""
    lines = [f"{ladder.name}, {ladder.subject}: {ladder.quantity}{unit}"]
    holds = recommended_for(result, chosen)
    lines.append(table(HEADINGS, [_table_row(*row) for row in zip(result.rows, holds, strict=True)], left=1))
    reference = "" if result.reference is None else f" (so it is known to ± {percent(result.uncertainty, 3)})"
    lines.append(f"{result.why}{reference}")
    if not result.converged and result.reference is not None:
        lines.append(f"nothing is recommended below {percent(result.uncertainty, 3)}")
    noted = [row for row in result.rows if row.measured.note and row.measured is not NOT_RUN]
    lines += [f"{row.rung.model}, {row.rung.resolution}: {row.measured.note}" for row in noted]
    return "\n".join([*lines, *([ladder.note] if ladder.note else [])])


def _table_row(row: Row, holds: Sequence[float]) -> tuple[str, ...]:
    own = row.measured
    model = f"{row.rung.model}, {row.rung.resolution}"
    if len(model) > WIDEST_MODEL:
        model = model.replace(", ", ",\n  ", 1)
    if own.values is None:
        return (model, "", "", "not run" if own is NOT_RUN else "no answer", "", "", "")
    value = f"{own.values.ravel()[0]:.7g}" if own.values.size == 1 else f"{own.values.size} values"
    return (
        model,
        str(own.unknowns or ""),
        value,
        "?" if isnan(row.error) else f"≤ {percent(row.at_most, 3)}" if row.is_bound else percent(row.error, 3),
        seconds_text(own.seconds),
        f"{own.memory_mb:.1f}",
        # A rung that is the quickest for two errors is so for those in between.
        " … ".join(dict.fromkeys(percent(end, 3) for end in (holds[0], holds[-1]))) if holds else "",
    )


def picks_text(picks: Iterable[Pick]) -> str:
    """Write the recommended rung of each ladder for each tolerance."""
    rows = []
    for pick in picks:
        rung = f"{pick.model}, {pick.resolution}" if pick.model else "none is known to hold"
        cost = (seconds_text(pick.seconds), percent(pick.at_most, 3)) if pick.model else ("", "")
        rows.append((pick.ladder, percent(pick.tolerance, 3), rung, *cost))
    return "recommended rungs\n" + table(("ladder", "for", "rung", "run time", "error at most"), rows, left=3)


MARKS = ("o", "s", "D", "^", "v", "P", "X", "*")
PANEL_INCHES = (5.6, 4.2)
LEAST = 1e-13
"""Errors below are drawn here."""


def study_figure(study: Study) -> Any:
    """Draw every rung's error against its run time, recommended ones ringed; a `matplotlib.figure.Figure`."""
    from matplotlib.figure import Figure

    with plot_style():
        panels: dict[str, list[Judged]] = {}
        for result in study.ladders:
            panels.setdefault(result.ladder.name, []).append(result)
        columns, rows = min(len(panels), 2), -(-len(panels) // 2)
        figure = Figure(figsize=(PANEL_INCHES[0] * columns, PANEL_INCHES[1] * rows + 0.4), layout="constrained")
        for place, (ladder, own) in enumerate(panels.items(), 1):
            _panel(figure.add_subplot(rows, columns, place), ladder, own, study)
        figure.suptitle(f"{study.name}: error against run time\nringed: the quickest rung for a tolerance", fontsize=10)
    return figure


def _panel(axis: Any, ladder: str, results: Sequence[Judged], study: Study) -> None:
    models = list(dict.fromkeys(row.rung.model for result in results for row in result.rows))
    drawn = [
        (result, row, holds)
        for result in results
        for row, holds in zip(result.rows, recommended_for(result, study.picks), strict=True)
        if isfinite(row.error) and isfinite(row.measured.seconds) and isfinite(row.at_most)
    ]
    axis.set_title(f"{ladder}: {results[0].ladder.quantity}")
    if not drawn:
        axis.text(0.5, 0.5, "no reference, so no errors", ha="center", va="center", transform=axis.transAxes)
        axis.set_axis_off()
        return
    for result, row, holds in drawn:
        colour = COLOURS[models.index(row.rung.model) % len(COLOURS)]
        mark = MARKS[results.index(result) % len(MARKS)]
        # What cannot be told from the reference's own error is hollow: the error is at most this.
        fill = "white" if row.is_bound else colour
        axis.plot(*_place(row), mark, color=colour, markerfacecolor=fill, markersize=6, zorder=3)
        if names := [percent(tolerance, 3) for tolerance in holds]:
            axis.plot(*_place(row), "o", color="black", markerfacecolor="none", markersize=12, zorder=2)
            right = {"xytext": (8, 5), "textcoords": "offset points", "fontsize": 7, "zorder": 4}
            axis.annotate(", ".join(names), _place(row), **right, bbox={"color": "white", "alpha": 0.7, "pad": 0.5})
    for model in dict.fromkeys(row.rung.model for _, row, _ in drawn):
        colour = COLOURS[models.index(model) % len(COLOURS)]
        axis.plot([], [], "o", color=colour, label=model)
    for index, result in enumerate(results if len(results) > 1 else ()):
        axis.plot([], [], MARKS[index % len(MARKS)], color=INK, label=result.ladder.subject)
    places = [_place(row) for _, row, _ in drawn]
    axis.set(xscale="log", yscale="log", xlabel="run time, s", ylabel="relative error (hollow: at most)")
    axis.set(xlim=_decades([x for x, _ in places]), ylim=_decades([y for _, y in places] + list(study.tolerances)))
    for tolerance in study.tolerances:
        axis.axhline(tolerance, color=PALE, linewidth=0.8, linestyle=(0, (2, 4)), zorder=1)
    axis.grid(alpha=0.2)
    axis.legend(frameon=False, fontsize=8)


def _decades(values: Sequence[float]) -> tuple[float, float]:
    """Return whole decades around `values`, so that every axis has labels."""
    low, high = (10.0 ** round_(log10(value)) for round_, value in ((floor, min(values)), (ceil, max(values))))
    return (low / 2, high * 3) if high > low else (low / 2, high * 10)


def _place(row: Row) -> tuple[float, float]:
    return max(row.measured.seconds, 1e-7), max(row.at_most if row.is_bound else row.error, LEAST)
