"""A study as text for people. Makes text; the command line prints it."""

from collections import Counter
from collections.abc import Iterable, Sequence
from math import isfinite, isnan
from typing import TYPE_CHECKING

from padgen.core.errors import number
from padgen.ladders.isolate import TIMES
from padgen.ladders.rung import NOT_RUN, Judged, Order, Row
from padgen.ladders.verdicts import TOLERANCES, Pick, recommended_row

if TYPE_CHECKING:
    from padgen.ladders.extreme_study import Verdict
    from padgen.ladders.study import ExtremeStudy, Study

__all__ = ["extreme_text", "ladder_text", "percent", "picks_text", "seconds_text", "study_text"]

HEADINGS = ("model", "resolution", "unknowns", "value", "error", "run time", "memory MB", "recommended for")
EXTREME_HEADINGS = ("domain", "case", "model", "error", "stated", "run time", "residual", "condition", "verdict")


def study_text(study: "Study") -> str:
    """All ladders of which something was run, then the recommended rungs, what times are, and what was not run."""
    parts, stopped = [], []
    for result in study.ladders:
        left, every = sum(row.measured is NOT_RUN for row in result.rows), len(result.rows)
        if left:
            stopped.append(f"not run: {left} of {every} rungs of {result.ladder.name}, {result.ladder.subject}")
        if left < every:
            parts.append(ladder_text(result, study.tolerances))
    return "\n\n".join([*parts, picks_text(study.picks), "\n".join([TIMES, *stopped])])


def ladder_text(result: Judged, tolerances: Sequence[float] = TOLERANCES) -> str:
    """One ladder as a table, what it was measured against, and the orders of convergence."""
    ladder = result.ladder
    unit = f", {ladder.unit}" if ladder.unit else ""
    lines = [f"{ladder.name}, {ladder.subject}: {ladder.quantity}{unit}"]
    lines.append(_table(HEADINGS, [_row(result, i, tolerances) for i in range(len(result.rows))], left=2))
    reference = "" if result.reference is None else f" (the reference is good to {percent(result.uncertainty)})"
    lines.append(f"{result.why}{reference}")
    if not result.converged and result.reference is not None:
        lines.append(f"nothing is recommended below {percent(result.uncertainty)}")
    lines += [_order(order) for order in result.orders]
    noted = [row for row in result.rows if row.measured.note and row.measured is not NOT_RUN]
    lines += [f"{row.rung.model}, {row.rung.resolution}: {row.measured.note}" for row in noted]
    return "\n".join([*lines, *([ladder.note] if ladder.note else [])])


def _row(result: Judged, index: int, tolerances: Sequence[float]) -> tuple[str, ...]:
    row = result.rows[index]
    own = row.measured
    holds = ", ".join(percent(tol) for tol in tolerances if recommended_row(result, tol) == index)
    if own.values is None:
        return (row.rung.model, row.rung.resolution, "", "", "not run" if own is NOT_RUN else "no answer", "", "", "")
    value = f"{own.values.ravel()[0]:.7g}" if own.values.size == 1 else f"{own.values.size} values"
    return (
        row.rung.model,
        row.rung.resolution,
        str(own.unknowns or ""),
        value,
        _error(row),
        seconds_text(own.seconds),
        f"{own.memory_mb:.1f}",
        holds,
    )


def _error(row: Row) -> str:
    if isnan(row.error):
        return "?"
    if row.is_bound:
        return f"≤ {percent(row.at_most)}"
    return percent(row.error)


def _order(order: Order) -> str:
    observed = "not observed" if order.observed is None else f"{order.observed:.2f} observed"
    theory = "" if order.theory is None else f", {order.theory.order:g} in theory ({order.theory.why})"
    return f"order of convergence, {order.series}: {observed}{theory}"


def picks_text(picks: Iterable[Pick]) -> str:
    """The recommended rung of each ladder for each tolerance."""
    rows = []
    for pick in picks:
        rung = f"{pick.model}, {pick.resolution}" if pick.model else "none is known to hold"
        cost = (seconds_text(pick.seconds), percent(pick.at_most)) if pick.model else ("", "")
        rows.append((pick.ladder, percent(pick.tolerance), rung, *cost))
    return "recommended rungs\n" + _table(("ladder", "for", "rung", "run time", "error at most"), rows, left=3)


def extreme_text(study: "ExtremeStudy") -> str:
    """The table of cases, then what is refused or wrong, sentence by sentence."""
    lines = [_table(EXTREME_HEADINGS, [_verdict(found) for found in study.verdicts], left=3)]
    lines += [f"{found.verdict}: {found.domain}, {found.case}: {found.note}" for found in study.verdicts if found.note]
    counts = Counter(found.verdict for found in study.verdicts)
    told = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    return "\n".join([*lines, TIMES, f"{len(study.verdicts)} cases: {told}"])


def _verdict(found: "Verdict") -> tuple[str, ...]:
    errors, rest = (found.error, found.stated_error), (found.residual, found.condition)
    head = (found.domain, found.case, found.model, *map(_power, errors), seconds_text(found.seconds))
    return (*head, *map(_power, rest), found.verdict)


def _power(value: float) -> str:
    return f"{value:.2g}" if isfinite(value) else ""


def percent(share: float) -> str:
    """A share in percent, two significant digits, three from 100 %."""
    if not isfinite(share):
        return "?"
    value = 100 * share
    return f"{value:.3g} %" if value < 1000 else f"{value:.2g} %"


def seconds_text(seconds: float) -> str:
    """A time with the unit that suits it."""
    if not isfinite(seconds):
        return ""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{number(float(f'{seconds / size:.3g}'))} {unit}"
    return f"{number(float(f'{seconds / 1e-6:.3g}'))} µs"


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]], left: int) -> str:
    """Columns under their headings, the first `left` of them flush left."""
    cells = [tuple(headings), *(tuple(row) for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(headings))]
    lines = [
        "  ".join(
            cell.ljust(width) if i < left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)
