"""Figures of error against run time: of a study's models at each resolution, and of the extreme cases of all models.

The figures are data like those of plans (`padgen/report/figures`): files and the page draw the same ones.
"""

from collections.abc import Mapping, Sequence
from itertools import cycle
from math import ceil, floor, isfinite, log10
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from padgen.core.display import COLOURS
from padgen.core.errors import percent
from padgen.report.figures import Curves, Figure, Line, Panel, Points, Scale

if TYPE_CHECKING:
    from padgen.ladders.study import CaseVerdict, Study

__all__ = ["RungMark", "extreme_figure", "marks_of", "marks_read", "study_figure"]

SYMBOLS = ("o", "s", "D", "^", "v", "P", "X", "*")
"""Symbols of the subjects of a ladder, and of the domains of extreme cases."""
LEAST = 1e-13
LEAST_S = 1e-7
"""Errors and run times below are drawn here."""


class RungMark(NamedTuple):
    """Point of a study's figure: a model at one resolution, what it computes, its run time in s and its relative error.

    Of a bound the error is at most this. `holds` are the tolerances for which it is the quickest of its subject.
    """

    ladder: str
    quantity: str
    subject: str
    model: str
    resolution: str
    seconds: float
    error: float
    is_bound: bool
    holds: tuple[float, ...] = ()


def marks_of(study: "Study") -> list[RungMark]:
    """Return a point for each model and resolution of a study; a missing error or run time is not a finite number."""
    from padgen.ladders.rung import recommended_for

    marks = []
    for result in study.ladders:
        ladder = result.ladder
        for row, holds in zip(result.rows, recommended_for(result, study.tolerances), strict=True):
            # An error that cannot be told from the reference's own is a bound.
            error = row.at_most if row.is_bound or not isfinite(row.at_most) else row.error
            rung = row.rung
            named = (ladder.name, ladder.quantity, ladder.subject, rung.model, rung.resolution)
            marks.append(RungMark(*named, row.measured.seconds, error, row.is_bound, tuple(holds)))
    return marks


def marks_read(table: Mapping[str, Any]) -> list[RungMark]:
    """Return a point for each model and fineness of a ``study.json`` that has both an error and a run time.

    Raises
    ------
    KeyError, TypeError
        The table is not that of a study.
    """
    marks = []
    for ladder in table["ladders"]:
        named = (str(ladder["ladder"]), str(ladder["quantity"]), str(ladder.get("subject", "")))
        for rung in ladder["rungs"]:
            if rung["seconds"] is None or rung["error_at_most"] is None:
                continue
            error = rung["error_at_most"] if rung["is_bound"] else rung.get("error", rung["error_at_most"])
            what = (str(rung["model"]), str(rung["resolution"]))
            marks.append(RungMark(*named, *what, float(rung["seconds"]), float(error), bool(rung["is_bound"])))
    return marks


def study_figure(name: str, rungs: Sequence[RungMark], tolerances: Sequence[float] = ()) -> Figure:
    """Return the figure of error against run time: a panel for each ladder, models by colour, subjects by symbol."""
    ladders = dict.fromkeys((rung.ladder, rung.quantity) for rung in rungs)
    panels = [
        _panel(f"{ladder}: {quantity}", [rung for rung in rungs if rung.ladder == ladder], tolerances)
        for ladder, quantity in ladders
    ]
    return Figure(
        title=f"{name}: error against run time\nringed: the quickest rung for a tolerance",
        description="Error against run time; the table below has the figures",
        panels=tuple(panels),
    )


def _panel(title: str, rungs: Sequence[RungMark], tolerances: Sequence[float]) -> Panel:
    drawn = [rung for rung in rungs if isfinite(rung.error) and isfinite(rung.seconds)]
    if not drawn:
        return Panel(_scale("run time", "s", [1.0]), _scale(ERROR, "", [1.0]), title=f"{title} (no reference)")
    models = list(dict.fromkeys(rung.model for rung in drawn))
    subjects = list(dict.fromkeys(rung.subject for rung in drawn))
    points = []
    for subject, symbol in zip(subjects, cycle(SYMBOLS), strict=False):
        for place, model in enumerate(models):
            some = [rung for rung in drawn if (rung.subject, rung.model) == (subject, model)]
            label = f"{model}, {subject}" if len(subjects) > 1 else model
            if some:
                points.append(_points(label, symbol, f"series-{place % len(COLOURS)}", some))
    seconds = [max(rung.seconds, LEAST_S) for rung in drawn]
    errors = [max(rung.error, LEAST) for rung in drawn]
    return Panel(
        x=_scale("run time", "s", seconds),
        y=_scale(ERROR, "", [*errors, *tolerances]),
        points=tuple(points),
        lines=tuple(Line("limit", tolerance, axis="y") for tolerance in tolerances),
        title=title,
    )


ERROR = "relative error (hollow: at most)"


def _points(label: str, symbol: str, role: str, rungs: Sequence[RungMark]) -> Points:
    return Points(
        label,
        symbol,
        x=tuple(max(rung.seconds, LEAST_S) for rung in rungs),
        y=tuple(max(rung.error, LEAST) for rung in rungs),
        roles=(role,) * len(rungs),
        legend_role=role,
        names=tuple(f"{rung.model}, {rung.resolution}" for rung in rungs),
        hollow=tuple(rung.is_bound for rung in rungs),
        rings=tuple(", ".join(percent(tolerance, 3) for tolerance in rung.holds) for rung in rungs),
    )


def _scale(label: str, unit: str, values: Sequence[float]) -> Scale:
    """Return a logarithmic axis over whole decades around `values`, so that every axis has labels."""
    low = 10.0 ** floor(log10(min(values)))
    high = 10.0 ** ceil(log10(max(values)))
    above = 3 if high > low else 10
    return Scale(label, unit, low / 2, high * above, is_log=True)


VERDICT_ROLES = {"right": "right", "WRONG": "wrong", "unchecked": "unsure", "refused": "limit", "not run": "limit"}


def extreme_figure(verdicts: Sequence["CaseVerdict"]) -> Figure:
    """Return the figure of the extreme cases, error against stated error; cases below the diagonal are right."""
    drawn = [verdict for verdict in verdicts if isfinite(verdict.error) and isfinite(verdict.stated_error)]
    domains = dict.fromkeys(verdict.domain for verdict in verdicts)
    points = []
    for domain, symbol in zip(domains, cycle(SYMBOLS), strict=False):
        some = [verdict for verdict in drawn if verdict.domain == domain]
        points.append(
            Points(
                domain,
                symbol,
                x=tuple(max(verdict.stated_error, LEAST) for verdict in some),
                y=tuple(max(verdict.error, LEAST) for verdict in some),
                roles=tuple(VERDICT_ROLES[verdict.verdict] for verdict in some),
                names=tuple(verdict.case for verdict in some),
            )
        )
    ends = np.array([LEAST, 10.0])
    values = [value for verdict in drawn for value in (verdict.stated_error, verdict.error)]
    inside = [min(max(value, LEAST), 10.0) for value in values]
    panel = Panel(
        x=_scale("stated relative error", "", [*ends.tolist(), *inside]),
        y=_scale("relative error", "", [*ends.tolist(), *inside]),
        marks=(Curves(ends, ends[None], ("limit",), ("",), ("as stated",)),),
        points=tuple(points),
    )
    title = "extreme cases: green below the line is right, red is worse than stated"
    return Figure(title=title, description="Error against stated error of the extreme cases", panels=(panel,))
