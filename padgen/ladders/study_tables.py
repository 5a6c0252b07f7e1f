"""A study as CSV and JSON."""

import csv
import io
from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

from padgen.core.files import json_text
from padgen.ladders.rung import Judged, Row
from padgen.ladders.verdicts import TOLERANCES, picks, recommended_row

if TYPE_CHECKING:
    from padgen.ladders.extreme_study import Verdict

__all__ = ["extreme_csv", "extreme_json", "study_csv", "study_json"]

COLUMNS = (
    "ladder",
    "subject",
    "quantity",
    "unit",
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
EXTREME_COLUMNS = (
    "domain",
    "case",
    "model",
    "error",
    "stated_error",
    "seconds",
    "residual",
    "condition",
    "verdict",
    "source",
    "note",
)


def study_csv(results: Sequence[Judged], tolerances: Sequence[float] = TOLERANCES) -> str:
    """One row per rung, in the order of the ladders; no number is an empty cell."""
    return _csv(COLUMNS, [_cells(result, i, tolerances) for result in results for i in range(len(result.rows))])


def _cells(result: Judged, index: int, tolerances: Sequence[float]) -> list[Any]:
    ladder, row = result.ladder, result.rows[index]
    rung, own = row.rung, row.measured
    values = "" if own.values is None else " ".join(f"{v:.10g}" for v in own.values.ravel())
    holds = " ".join(f"{tol:g}" for tol in tolerances if recommended_row(result, tol) == index)
    head = (ladder.name, ladder.subject, ladder.quantity, ladder.unit, rung.model, rung.resolution, rung.series)
    figures = (rung.step, own.unknowns, row.error, row.at_most, own.seconds, own.cpu_seconds, own.runs, own.memory_mb)
    return [*head, *figures, own.residual, holds, values, own.note]


def _csv(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return out.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.10g}" if isfinite(value) else ""
    return value


def study_json(results: Sequence[Judged], about: dict[str, Any], tolerances: Sequence[float] = TOLERANCES) -> str:
    """All that was measured, with `about` (what was studied, by which versions) ahead of it."""
    told = [pick._asdict() for pick in picks(results, tolerances)]
    return json_text({**about, "recommended": told, "ladders": [_ladder(result) for result in results]})


def _ladder(result: Judged) -> dict[str, Any]:
    ladder = result.ladder
    return {
        "ladder": ladder.name,
        "subject": ladder.subject,
        "quantity": ladder.quantity,
        "unit": ladder.unit,
        "relative_to": ladder.relative_to,
        "note": ladder.note,
        "reference": result.reference,
        "uncertainty": result.uncertainty,
        "converged": result.converged,
        "why": result.why,
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
        "model": rung.model,
        "resolution": rung.resolution,
        "series": rung.series,
        "offered": rung.offered,
        "step": rung.step,
        "unknowns": own.unknowns,
        "error": row.error,
        "error_at_most": row.at_most,
        "is_bound": row.is_bound,
        "seconds": own.seconds,
        "cpu_seconds": own.cpu_seconds,
        "runs": own.runs,
        "memory_mb": own.memory_mb,
        "residual": own.residual,
        "values": None if own.values is None else own.values.tolist(),
        "note": own.note,
    }


def extreme_csv(verdicts: Sequence["Verdict"]) -> str:
    """One row per case."""
    return _csv(EXTREME_COLUMNS, [_verdict(found) for found in verdicts])


def extreme_json(verdicts: Sequence["Verdict"], about: dict[str, Any]) -> str:
    """The same with `about` ahead of it."""
    cases = [dict(zip(EXTREME_COLUMNS, _verdict(found), strict=True)) for found in verdicts]
    return json_text({**about, "cases": cases})


def _verdict(found: "Verdict") -> list[Any]:
    head = (found.domain, found.name, found.model, found.error, found.stated_error, found.seconds)
    return [*head, found.residual, found.condition, found.verdict, found.source, found.note]
