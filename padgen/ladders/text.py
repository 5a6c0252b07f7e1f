"""A study as text for people. Makes text; the command line prints it."""

from collections.abc import Iterable, Sequence
from math import isfinite, isnan
from typing import TYPE_CHECKING

from padgen.core.errors import number
from padgen.ladders.rung import Judged, Order, Row
from padgen.ladders.verdicts import TOLERANCES, Pick, recommended_row

if TYPE_CHECKING:
    from padgen.ladders.extreme_study import Verdict
    from padgen.ladders.study import ExtremeStudy, Study

__all__ = ["extreme_text", "ladder_text", "percent", "picks_text", "seconds_text", "study_text"]

HEADINGS = ("model", "resolution", "unknowns", "value", "error", "run time", "memory MB", "recommended for")
EXTREME_HEADINGS = ("domain", "case", "model", "error", "stated", "run time", "residual", "condition", "verdict")


def study_text(study: "Study") -> str:
    """All ladders, then the recommended rungs."""
    parts = [ladder_text(result, study.tolerances) for result in study.ladders]
    return "\n\n".join([*parts, picks_text(study.picks)])


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
    lines += [f"{row.rung.model}, {row.rung.resolution}: {row.measured.note}" for row in _noted(result.rows)]
    return "\n".join([*lines, *([ladder.note] if ladder.note else [])])


def _noted(rows: Iterable[Row]) -> list[Row]:
    return [row for row in rows if row.measured.note]


def _row(result: Judged, index: int, tolerances: Sequence[float]) -> tuple[str, ...]:
    row = result.rows[index]
    own = row.measured
    holds = ", ".join(percent(tol) for tol in tolerances if recommended_row(result, tol) == index)
    if own.values is None:
        return (row.rung.model, row.rung.resolution, "", "", "no answer", "", "", "")
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
    rows = [_verdict(found) for found in study.verdicts]
    lines = [_table(EXTREME_HEADINGS, rows, left=3)]
    lines += [f"{found.verdict}: {found.domain}, {found.name}: {found.note}" for found in study.verdicts if found.note]
    counts: dict[str, int] = {}
    for found in study.verdicts:
        counts[found.verdict] = counts.get(found.verdict, 0) + 1
    told = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    return "\n".join([*lines, f"{len(study.verdicts)} cases: {told}"])


def _verdict(found: "Verdict") -> tuple[str, ...]:
    figures = (_power(found.error), _power(found.stated_error), seconds_text(found.seconds))
    return (
        found.domain,
        found.name,
        found.model,
        *figures,
        _power(found.residual),
        _power(found.condition),
        found.verdict,
    )


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
