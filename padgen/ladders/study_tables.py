"""A study as CSV and JSON."""

import csv
import io
from collections.abc import Sequence
from dataclasses import astuple, fields
from math import isfinite
from typing import Any

from padgen.core.files import json_text
from padgen.ladders.extreme_study import MISSING, Verdict
from padgen.ladders.rung import NOT_RUN, Judged, Row
from padgen.ladders.verdicts import TOLERANCES, picks, recommended_row

__all__ = ["extreme_csv", "extreme_json", "missing_rungs", "study_csv", "study_json"]

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
    """The rungs that were not run since the study was stopped."""
    return tuple(
        f"{result.ladder.name}, {result.ladder.subject}: {row.rung.model}, {row.rung.resolution}"
        for result in results
        for row in result.rows
        if row.measured is NOT_RUN
    )


def study_csv(results: Sequence[Judged], tolerances: Sequence[float] = TOLERANCES) -> str:
    """One row per rung, in the order of the ladders; no number is an empty cell."""
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


def extreme_csv(verdicts: Sequence[Verdict]) -> str:
    """One row per case."""
    return _csv(EXTREME_COLUMNS, [astuple(found) for found in verdicts])


def extreme_json(verdicts: Sequence[Verdict], about: dict[str, Any]) -> str:
    """The same with `about` ahead of it."""
    return json_text({**about, "stopped": any(v.verdict == MISSING for v in verdicts), "cases": list(verdicts)})
