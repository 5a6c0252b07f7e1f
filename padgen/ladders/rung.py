"""Ladders of models: their parts, how a rung is run and timed, errors, orders of convergence and recommended rungs.

A rung runs in a process of its own, on one thread: a crash of an engine costs one rung, netgen and build123d never
meet in one process, and the peak of memory is the rung's own.

The reference of a ladder is the last rung of its series `reference`. Two refinements lead to it:
with differences d₁, then d₂, and their ratio r = d₂/d₁, a sequence that goes on falling by r has
``d₂ r/(1 − r)`` left, which is below d₂ for r ≤ ½ (Aitken's estimate; Roache, *Annu. Rev. Fluid Mech.*
29, 1997, for grids). So the reference's own uncertainty is d₂, more when r is larger, and not less than
a share of d₁: a last step that hardly changed anything may have refined what does not matter.
Differences that do not fall show nothing.
"""

import gc
import pickle
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf, isfinite, isnan, log, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, percent
from padgen.core.runner import Answer, Runner, peak_mb, reset_peak
from padgen.planner.plan import Channel, Plan

__all__ = [
    "NOT_RUN",
    "TIMES",
    "TOLERANCES",
    "Judged",
    "JudgedRung",
    "Ladder",
    "Order",
    "Pick",
    "Rung",
    "RungFigures",
    "Scene",
    "Solved",
    "Theory",
    "Timed",
    "by_ladder",
    "chosen_channels",
    "distinct_channels",
    "judged",
    "measured",
    "observed_order",
    "picks",
    "recommended_for",
    "recommended_row",
    "run_in_process",
    "run_timed",
    "timed",
    "value_from_process",
    "write_steps",
]

MOST_SUBJECTS = 4
"""Taxels that are studied one by one where a pad has more."""


class Scene(NamedTuple):
    """A plan to be studied, and a folder for intermediate files such as its taxels' STEP files."""

    plan: Plan
    aside: Path

    def step_path(self, channel: Channel) -> Path:
        """Return the path of the STEP file that `write_steps` writes of a channel's taxel."""
        return self.aside / f"taxel-{channel.index}.step"


def distinct_channels(plan: Plan) -> tuple[Channel, ...]:
    """Return the first channel of each distinct beam, in the order of the channels."""
    by_beam = {channel.beam: channel for channel in reversed(plan.channels)}
    return tuple(sorted(by_beam.values(), key=lambda channel: channel.index))


def chosen_channels(plan: Plan) -> tuple[Channel, ...]:
    """Return at most `MOST_SUBJECTS` channels of distinct beams, spread from the lowest to the highest channel."""
    every = distinct_channels(plan)
    if len(every) <= MOST_SUBJECTS:
        return every
    places = (round(k * (len(every) - 1) / (MOST_SUBJECTS - 1)) for k in range(MOST_SUBJECTS))
    return tuple(every[place] for place in places)


def write_steps(scene: Scene) -> None:
    """Write the STEP files of `chosen_channels`, as a build does. Imports build123d.

    Raises
    ------
    PadgenError
        The kernel refuses a taxel.
    """
    from padgen.solid.formats.step import write_taxel_step

    for channel in chosen_channels(scene.plan):
        write_taxel_step(scene.plan, channel, scene.step_path(channel))


class Solved(NamedTuple):
    """A model's answer: `values` of any shape, and the relative error that the model states (nan: none).

    `residual` and `condition` are of the linear or eigen problem behind it, nan where there is none; `unknowns` is how
    many it solved for, 0 for a formula.
    """

    values: np.ndarray
    stated_error: float = nan
    residual: float = nan
    condition: float = nan
    unknowns: int = 0


class Theory(NamedTuple):
    """Theoretical order of convergence of a series of rungs, the power of `step` with which errors fall, and why.

    `same_limit` where the series converges to what the ladder's reference does: then errors are
    against that, else the series' own differences are looked at.
    """

    order: float
    why: str
    same_limit: bool = False


@dataclass(frozen=True)
class Rung:
    """One model at one resolution.

    `solve` runs in a process of its own, so that it must pickle: a `functools.partial` of a function
    of a module. Rungs of one `series` follow each other from coarse to fine; `step` is what is refined
    in it (size of elements, chord, time step), nan where no order is expected. `imports` are loaded
    before the clock starts, and so runs `prepare`, whose result `solve` is called with where there is one.
    A rung that is not `offered` is never recommended: it is there to be measured against.
    """

    model: str
    resolution: str
    solve: Callable[..., Solved]
    series: str = ""
    step: float = nan
    imports: tuple[str, ...] = ()
    limit_s: float = 600.0
    prepare: Callable[[], Any] | None = None
    offered: bool = True


@dataclass(frozen=True)
class Ladder:
    """Models (rungs), coarse to fine, that answer one question about one `subject`.

    The last three rungs of the series `reference` are what the others are measured against. Errors
    are relative to each value (`relative_to` = "each") or to the largest one ("largest"). `before` is called
    once, ahead of the rungs.
    """

    name: str
    subject: str
    quantity: str
    unit: str
    rungs: tuple[Rung, ...]
    reference: str
    relative_to: str = "largest"
    theory: Mapping[str, Theory] = field(default_factory=dict)
    note: str = ""
    before: Callable[[], Any] | None = None


@dataclass(frozen=True)
class RungFigures:
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


NOT_RUN = RungFigures(note="not run: the study was stopped")


@dataclass(frozen=True)
class JudgedRung:
    """A rung with its figures, its relative `error` to the reference, and `at_most`, an estimated bound on it.

    With `is_bound` the error cannot be told from the reference's own: only `at_most` is known.
    """

    rung: Rung
    measured: RungFigures
    error: float = nan
    at_most: float = inf
    is_bound: bool = False


@dataclass(frozen=True)
class Order:
    """Order of convergence of a series by its finest rungs whose differences are more than noise.

    None where it has too few of them, or where their differences do not fall.
    """

    series: str
    observed: float | None
    theory: Theory | None


@dataclass(frozen=True)
class Judged:
    """A ladder that was run; `uncertainty` is the estimated relative error of its reference, inf if unknown.

    `converged` tells whether two refinements show it; `why` is that as a sentence. `reference` is
    the index of its row, None where no rung of the reference's series has an answer.
    """

    ladder: Ladder
    rows: tuple[JudgedRung, ...]
    reference: int | None
    uncertainty: float
    converged: bool
    why: str
    orders: tuple[Order, ...]


TOLERANCES = (0.1, 0.01, 0.001, 0.0001)
ROUNDING = 1e-12
"""Relative differences that are as good as none."""
SLOWEST = 0.7
"""Largest ratio of two differences that counts as falling."""
FASTEST = 0.05
"""Smallest ratio that is believed."""
CLEAR = 3.0
"""Errors are counted for an order when they are so many times the reference's uncertainty."""
CAUTION = 2.0
"""Factor on differences that do not fall, to estimate the error: a guess, and reported as one."""


class Pick(NamedTuple):
    """The quickest rung that meets a tolerance for every subject of a ladder, its mean run time and largest error."""

    ladder: str
    tolerance: float
    model: str
    resolution: str
    seconds: float
    at_most: float


def judged(ladder: Ladder, measured: Sequence[RungFigures]) -> Judged:
    """Return errors, orders of convergence and reference of a ladder; `measured` is in the order of its rungs."""
    line = [i for i, rung in enumerate(ladder.rungs) if rung.series == ladder.reference]
    solved = [i for i in line if measured[i].values is not None]
    reference = solved[-1] if solved else None
    uncertainty, converged, why = _uncertainty(ladder, measured, solved)
    if line and solved and solved[-1] != line[-1]:
        why += f"; the finest has no answer ({measured[line[-1]].note})"
    rows = []
    for rung, figures in zip(ladder.rungs, measured, strict=True):
        error = inf if reference is None else _distance(ladder, figures, measured[reference])
        row = JudgedRung(rung, figures, error, error + uncertainty, error <= uncertainty)
        rows.append(row if isfinite(error) else JudgedRung(rung, figures))
    names = dict.fromkeys(row.rung.series for row in rows if row.rung.series and not isnan(row.rung.step))
    verdicts = []
    for name in names:
        rows_of_case = [
            row
            for row in rows
            if row.rung.series == name and not isnan(row.rung.step) and row.measured.values is not None
        ]
        # Those whose error the reference's own does not blur.
        clear = [row for row in rows_of_case if row.error > CLEAR * uncertainty]
        theory = ladder.theory.get(name)
        order = None
        if not (theory and theory.same_limit):
            gaps = [
                _distance(ladder, a.measured, b.measured, rows_of_case[-1].measured) for a, b in pairwise(rows_of_case)
            ]
            order = observed_order([row.rung.step for row in rows_of_case], gaps)
        elif len(clear) > 1:
            a, b = clear[-2:]
            order = log(a.error / b.error) / log(a.rung.step / b.rung.step)
        verdicts.append(Order(name, order, theory))
    return Judged(ladder, tuple(rows), reference, uncertainty, converged, why, tuple(verdicts))


def _uncertainty(ladder: Ladder, measured: Sequence[RungFigures], solved: Sequence[int]) -> tuple[float, bool, str]:
    """Return the reference's estimated relative error, whether it is shown to converge, and a sentence on that."""
    if not solved:
        return inf, False, f"no rung of '{ladder.reference}' has an answer, so that there is no reference"
    name = f"{ladder.rungs[solved[-1]].model}, {ladder.rungs[solved[-1]].resolution}"
    if len(solved) < 3:
        there = "only one has" if len(solved) == 2 else "none has"
        coarser = f"it is to be compared with two coarser ones, and {there} an"
        why = f"the reference {name} is not shown to be converged, so that no error can be stated: {coarser} answer"
        return inf, False, why
    first, second = (_distance(ladder, measured[a], measured[b]) for a, b in pairwise(solved[-3:]))
    said = f"the last two refinements changed it by {percent(first)} and {percent(second)}"
    ratio = second / first if first > 0 else inf
    if second <= ROUNDING or ratio <= SLOWEST:
        left = second * max(1.0, ratio / (1 - ratio)) if ratio <= SLOWEST else second
        return max(left, FASTEST * first, ROUNDING), True, f"the reference is {name}: {said}"
    return CAUTION * max(first, second), False, f"the reference is {name}, which is not shown to be converged: {said}"


def _distance(ladder: Ladder, one: RungFigures, other: RungFigures, to: RungFigures | None = None) -> float:
    """Return the largest difference of two answers, relative to each value of `to` (default `other`) or to its largest.

    inf where they have no common shape.
    """
    a = one.values
    b = other.values
    size = (to or other).values
    if a is None or b is None or size is None or not a.shape == b.shape == size.shape:
        return inf
    scale = np.abs(size) if ladder.relative_to == "each" else np.full(size.shape, np.abs(size).max(initial=0.0))
    difference = np.abs(a - b)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(difference > 0, difference / scale, 0.0)
    return float(relative.max(initial=0.0))


def observed_order(steps: Sequence[float], differences: Sequence[float]) -> float | None:
    """Return the order q of answers ``v + C h^q`` at `steps` (n,), from the `differences` (n − 1,) of neighbours.

    Of the last two differences that are more than rounding: ``(h₁^q − h₂^q)/(h₂^q − h₃^q) = d₁/d₂``,
    a root in 0.01 … 20; None where there are no two or no such q.
    """
    last = next((k for k in range(len(differences) - 1, 0, -1) if differences[k] > 10 * ROUNDING), None)
    if last is None or not all(isfinite(d) and d > 0 for d in differences[last - 1 : last + 1]):
        return None
    fine = steps[last + 1]
    coarse = steps[last - 1] / fine
    middle = steps[last] / fine
    wanted = differences[last - 1] / differences[last]

    def ratio(order: float) -> float:
        return float((coarse**order - middle**order) / (middle**order - 1))

    low = 0.01
    high = 20.0
    if not ratio(low) < wanted < ratio(high):
        return None
    from scipy.optimize import brentq

    return float(brentq(lambda order: ratio(order) - wanted, low, high))


def recommended_row(result: Judged, tolerance: float) -> int | None:
    """Return the index of the quickest rung that is known to err by at most `tolerance`; None if there is none."""
    held = [i for i, row in enumerate(result.rows) if _holds(row, tolerance)]
    return min(held, key=lambda i: result.rows[i].measured.seconds, default=None)


def recommended_for(result: Judged, tolerances: Sequence[float]) -> list[list[float]]:
    """Return, for each rung of a ladder, the tolerances for which it is the quickest one that meets them."""
    best = [recommended_row(result, tolerance) for tolerance in tolerances]
    return [[tol for tol, at in zip(tolerances, best, strict=True) if at == i] for i in range(len(result.rows))]


def _holds(row: JudgedRung, tolerance: float) -> bool:
    return row.rung.offered and row.at_most <= tolerance


def by_ladder(results: Iterable[Judged]) -> dict[str, list[Judged]]:
    """Group results by the name of their ladder."""
    grouped: dict[str, list[Judged]] = {}
    for result in results:
        grouped.setdefault(result.ladder.name, []).append(result)
    return grouped


def picks(results: Iterable[Judged], tolerances: Sequence[float] = TOLERANCES) -> tuple[Pick, ...]:
    """Return for each ladder and tolerance the quickest rung that meets the tolerance for every subject.

    A ladder and tolerance for which none is known has a `Pick` without a model.
    """
    return tuple(_pick(name, rows, tol) for name, rows in by_ladder(results).items() for tol in tolerances)


def _pick(name: str, results: Sequence[Judged], tolerance: float) -> Pick:
    held: dict[tuple[str, str], list[JudgedRung]] = {}
    for row in (row for result in results for row in result.rows if _holds(row, tolerance)):
        held.setdefault((row.rung.model, row.rung.resolution), []).append(row)
    costs = {key: sum(row.measured.seconds for row in rows) for key, rows in held.items() if len(rows) == len(results)}
    if not costs:
        return Pick(name, tolerance, "", "", nan, inf)
    best = min(costs, key=lambda key: costs[key])
    return Pick(name, tolerance, *best, costs[best] / len(results), max(row.at_most for row in held[best]))


LIMIT_S = 600.0
BUDGET_S = 2.0
MOST_RUNS = 7
LONG_S = 6.0
"""A run that takes longer is not repeated, a shorter one at least once."""
MODELS = ("padgen.physics", "padgen.planner", "padgen.verify")
TIMES = (
    f"run times are the best of 2 to {MOST_RUNS} runs (of one run if it takes over {LONG_S:g} s) on one thread, with"
    " empty caches, without starting Python and imports"
)


class Timed(NamedTuple):
    """Result of timed work: its value, least wall and processor time in s of `runs`, and peak memory added in MB."""

    value: Any
    seconds: float
    cpu_seconds: float
    runs: int
    memory_mb: float


def run_in_process(
    work: Callable[..., Any], *arguments: Any, imports: tuple[str, ...] = (), limit_s: float = LIMIT_S
) -> Answer:
    """Run `work`, which must pickle, in a new process for at most `limit_s`; its error is returned, not raised."""
    with Runner(imports=imports) as runner:
        return runner.run(work, *arguments, time_s=limit_s)


def value_from_process(work: Callable[..., Any], *arguments: Any) -> Any:
    """Return the value of `work`, run once in a process of its own.

    Raises
    ------
    PadgenError
        The one that `work` raised; `SolverError` when it broke down.
    """
    answer = run_in_process(work, *arguments)
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
    """Time `work` in a new process, repeated until `budget_s` is spent; the answer's value is a `Timed`.

    With `prepare`, `work` is called with the result of `prepare`, which is made once, off the clock.
    """
    return run_in_process(
        run_timed, pickle.dumps((prepare, work)), budget_s, most_runs, imports=imports, limit_s=limit_s
    )


def measured(rung: Rung) -> RungFigures:
    """Run a rung in a new process and return its values and run time, or, in `note`, its refusal or crash."""
    answer = timed(rung.solve, rung.imports, rung.limit_s, prepare=rung.prepare)
    if answer.kind != "value":
        return RungFigures(note=("refused: " if answer.kind == "refused" else "") + answer.sentence)
    answer_timed: Timed = answer.value
    solved: Solved = answer_timed.value
    values = np.atleast_1d(np.asarray(solved.values, float))
    known, note = (values, "") if np.isfinite(values).all() else (None, "its answer is not a number")
    return RungFigures(known, int(solved.unknowns), float(solved.residual), *answer_timed[1:], note)


def run_timed(pickled: bytes, budget_s: float, most_runs: int) -> Timed:
    """Time the second of two pickled functions in this process; the first, or None, prepares its argument."""
    prepare, _ = pickle.loads(pickled)  # so that the modules it names are loaded
    try:
        made = () if prepare is None else (prepare(),)
        reset_peak()
        before = peak_mb() or 0.0
        value, *times = _run(pickled, made)
        memory = max((peak_mb() or 0.0) - before, 0.0)
        walls, cpus = ([seconds] for seconds in times)
        while len(walls) < most_runs and (len(walls) < 2 or sum(walls) < budget_s) and min(walls) < LONG_S:
            _, *times = _run(pickled, made)
            walls = [*walls, times[0]]
            cpus = [*cpus, times[1]]
    except MemoryError as error:
        raise SolverError("the machine has not enough memory for it") from error
    return Timed(value, min(walls), min(cpus), len(walls), memory)


def _run(pickled: bytes, made: tuple[Any, ...]) -> tuple[Any, float, float]:
    """Run the pickled work once; return its value, wall seconds and processor seconds.

    It is unpickled anew and caches are emptied, so that a repeated run takes as long as the first.
    """
    _, work = pickle.loads(pickled)
    for name, module in list(sys.modules.items()):
        if name.startswith(MODELS):
            for held in list(vars(module).values()):
                if hasattr(type(held), "cache_clear"):
                    held.cache_clear()
    gc.collect()
    wall = time.perf_counter()
    cpu = time.process_time()
    value = work(*made)
    return value, time.perf_counter() - wall, time.process_time() - cpu
