"""A study as text for people, and as pictures: error against run time. The same figures give the same bytes."""

from collections import Counter
from collections.abc import Iterable, Sequence
from math import ceil, floor, isfinite, isnan, log10
from typing import TYPE_CHECKING, Any

from padgen.core.display import COLOURS, INK, PALE, plot_bytes, plot_style, seconds_text, table
from padgen.core.errors import percent
from padgen.ladders.rung import NOT_RUN, TIMES, TOLERANCES, Judged, Order, Pick, Row, recommended_row

if TYPE_CHECKING:
    from padgen.ladders.study import ExtremeStudy, Study, Verdict

__all__ = [
    "extreme_picture",
    "extreme_text",
    "ladder_text",
    "picks_text",
    "study_figure",
    "study_pictures",
    "study_text",
]

HEADINGS = ("model", "unknowns", "value", "error", "run time", "memory\nMB", "quickest for\nan error of")
WIDEST_MODEL = 36
EXTREME_HEADINGS = ("domain", "case", "model", "error", "stated", "run time", "residual", "condition", "verdict")


def study_text(study: "Study") -> str:
    """Write all ladders of which something was run, the recommended rungs, what times are, and what was not run."""
    parts, stopped = [], []
    for result in study.ladders:
        left, every = sum(row.measured is NOT_RUN for row in result.rows), len(result.rows)
        if left:
            stopped.append(f"not run: {left} of {every} rungs of {result.ladder.name}, {result.ladder.subject}")
        if left < every:
            parts.append(ladder_text(result, study.tolerances))
    return "\n\n".join([*parts, picks_text(study.picks), "\n".join([TIMES, *stopped])])


def ladder_text(result: Judged, tolerances: Sequence[float] = TOLERANCES) -> str:
    """Write one ladder as a table, what it was measured against, and the orders of convergence."""
    ladder = result.ladder
    unit = f", {ladder.unit}" if ladder.unit else ""
    lines = [f"{ladder.name}, {ladder.subject}: {ladder.quantity}{unit}"]
    lines.append(table(HEADINGS, [_table_row(result, i, tolerances) for i in range(len(result.rows))], left=1))
    reference = "" if result.reference is None else f" (so it is known to ± {percent(result.uncertainty, 3)})"
    lines.append(f"{result.why}{reference}")
    if not result.converged and result.reference is not None:
        lines.append(f"nothing is recommended below {percent(result.uncertainty, 3)}")
    lines += [_order(order) for order in result.orders]
    noted = [row for row in result.rows if row.measured.note and row.measured is not NOT_RUN]
    lines += [f"{row.rung.model}, {row.rung.resolution}: {row.measured.note}" for row in noted]
    return "\n".join([*lines, *([ladder.note] if ladder.note else [])])


def _table_row(result: Judged, index: int, tolerances: Sequence[float]) -> tuple[str, ...]:
    row = result.rows[index]
    own = row.measured
    # A rung that is the quickest for two errors is so for those in between.
    holds = sorted({tol for tol in tolerances if recommended_row(result, tol) == index}, reverse=True)
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
        " … ".join(dict.fromkeys(percent(end, 3) for end in (holds[0], holds[-1]))) if holds else "",
    )


def _order(order: Order) -> str:
    observed = "not observed" if order.observed is None else f"{order.observed:.2f} observed"
    theory = "" if order.theory is None else f", {order.theory.order:g} in theory ({order.theory.why})"
    return f"order of convergence, {order.series}: {observed}{theory}"


def picks_text(picks: Iterable[Pick]) -> str:
    """Write the recommended rung of each ladder for each tolerance."""
    rows = []
    for pick in picks:
        rung = f"{pick.model}, {pick.resolution}" if pick.model else "none is known to hold"
        cost = (seconds_text(pick.seconds), percent(pick.at_most, 3)) if pick.model else ("", "")
        rows.append((pick.ladder, percent(pick.tolerance, 3), rung, *cost))
    return "recommended rungs\n" + table(("ladder", "for", "rung", "run time", "error at most"), rows, left=3)


def extreme_text(study: "ExtremeStudy") -> str:
    """Write the table of cases, then what is refused or wrong, sentence by sentence."""
    rows = []
    for found in study.verdicts:
        errors = _two_digits(found.error), _two_digits(found.stated_error), seconds_text(found.seconds)
        rest = _two_digits(found.residual), _two_digits(found.condition), found.verdict
        rows.append((found.domain, found.case, found.model, *errors, *rest))
    lines = [table(EXTREME_HEADINGS, rows, left=3)]
    lines += [f"{found.verdict}: {found.domain}, {found.case}: {found.note}" for found in study.verdicts if found.note]
    counts = Counter(found.verdict for found in study.verdicts)
    told = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    return "\n".join([*lines, TIMES, f"{len(study.verdicts)} cases: {told}"])


def _two_digits(value: float) -> str:
    return f"{value:.2g}" if isfinite(value) else ""


MARKS = ("o", "s", "D", "^", "v", "P", "X", "*")
VERDICT_COLOURS = {"right": COLOURS[2], "WRONG": COLOURS[1], "unchecked": COLOURS[4], "refused": PALE}
PANEL_INCHES = (5.6, 4.2)
LEAST = 1e-13
"""Errors below are drawn here."""


def study_pictures(results: Sequence[Judged], tolerances: Sequence[float], name: str) -> tuple[bytes, bytes]:
    """Return the plot of `study_figure` as SVG and PNG."""
    figure = study_figure(results, tolerances, name)
    return plot_bytes(figure, "svg"), plot_bytes(figure, "png")


def study_figure(results: Sequence[Judged], tolerances: Sequence[float], name: str) -> Any:
    """Draw every rung's error against its run time, recommended ones ringed; a `matplotlib.figure.Figure`."""
    with plot_style():
        panels: dict[str, list[Judged]] = {}
        for result in results:
            panels.setdefault(result.ladder.name, []).append(result)
        figure, axes = _figure(max(len(panels), 1))
        for axis, (ladder, own) in zip(axes, panels.items(), strict=False):
            _panel(axis, ladder, own, tolerances)
        figure.suptitle(f"{name}: error against run time\nringed: the quickest rung for a tolerance", fontsize=10)
    return figure


def extreme_picture(verdicts: Sequence["Verdict"]) -> bytes:
    """Draw error against stated error of the extreme cases, as SVG: right are those below the diagonal."""
    with plot_style():
        figure, (axis,) = _figure(1)
        axis.plot([LEAST, 10], [LEAST, 10], color=PALE, linewidth=1)
        domains = list(dict.fromkeys(found.domain for found in verdicts))
        for found in verdicts:
            if isfinite(found.error) and isfinite(found.stated_error):
                place = (max(found.stated_error, LEAST), max(found.error, LEAST))
                mark = MARKS[domains.index(found.domain) % len(MARKS)]
                axis.plot(*place, mark, color=VERDICT_COLOURS[found.verdict], markersize=5, linestyle="none")
        for index, domain in enumerate(domains):
            axis.plot([], [], MARKS[index % len(MARKS)], color=INK, linestyle="none", label=domain)
        axis.set(xscale="log", yscale="log", xlabel="stated relative error", ylabel="relative error")
        axis.set_title("extreme cases: green below the line is right, red is worse than stated")
        if domains:
            axis.legend(frameon=False)
        axis.grid(alpha=0.25)
        return plot_bytes(figure, "svg")


def _figure(count: int) -> tuple[Any, list[Any]]:
    from matplotlib.figure import Figure

    columns = min(count, 2)
    rows = -(-count // columns)
    figure = Figure(figsize=(PANEL_INCHES[0] * columns, PANEL_INCHES[1] * rows + 0.4), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for spare in axes[count:]:
        spare.set_axis_off()
    return figure, axes[:count]


def _panel(axis: Any, ladder: str, results: Sequence[Judged], tolerances: Sequence[float]) -> None:
    models = list(dict.fromkeys(row.rung.model for result in results for row in result.rows))
    drawn = [(result, i) for result in results for i, row in enumerate(result.rows) if _shown(row)]
    axis.set_title(f"{ladder}: {results[0].ladder.quantity}")
    if not drawn:
        axis.text(0.5, 0.5, "no reference, so no errors", ha="center", va="center", transform=axis.transAxes)
        axis.set_axis_off()
        return
    for result, i in drawn:
        row = result.rows[i]
        colour = COLOURS[models.index(row.rung.model) % len(COLOURS)]
        mark = MARKS[results.index(result) % len(MARKS)]
        # What cannot be told from the reference's own error is hollow: the error is at most this.
        fill = "white" if row.is_bound else colour
        axis.plot(*_place(row), mark, color=colour, markerfacecolor=fill, markersize=6, zorder=3)
    _rings(axis, results, tolerances)
    for model in dict.fromkeys(result.rows[i].rung.model for result, i in drawn):
        colour = COLOURS[models.index(model) % len(COLOURS)]
        axis.plot([], [], "o", color=colour, label=model)
    for index, result in enumerate(results if len(results) > 1 else ()):
        axis.plot([], [], MARKS[index % len(MARKS)], color=INK, label=result.ladder.subject)
    places = [_place(result.rows[i]) for result, i in drawn]
    axis.set(xscale="log", yscale="log", xlabel="run time, s", ylabel="relative error (hollow: at most)")
    axis.set(xlim=_decades([x for x, _ in places]), ylim=_decades([y for _, y in places] + list(tolerances)))
    for tolerance in tolerances:
        axis.axhline(tolerance, color=PALE, linewidth=0.8, linestyle=(0, (2, 4)), zorder=1)
    axis.grid(alpha=0.2)
    axis.legend(frameon=False, fontsize=8)


def _rings(axis: Any, results: Sequence[Judged], tolerances: Sequence[float]) -> None:
    """Ring each recommended rung and write the tolerances that it is for beside it."""
    for result in results:
        held: dict[int, list[str]] = {}
        for tolerance in tolerances:
            index = recommended_row(result, tolerance)
            if index is not None and _shown(result.rows[index]):
                held.setdefault(index, []).append(percent(tolerance, 3))
        for index, names in held.items():
            place = _place(result.rows[index])
            axis.plot(*place, "o", color="black", markerfacecolor="none", markersize=12, zorder=2)
            right = {"xytext": (8, 5), "textcoords": "offset points", "fontsize": 7, "zorder": 4}
            axis.annotate(", ".join(names), place, **right, bbox={"color": "white", "alpha": 0.7, "pad": 0.5})


def _decades(values: Sequence[float]) -> tuple[float, float]:
    """Return whole decades around `values`, so that every axis has labels."""
    low, high = (10.0 ** round_(log10(value)) for round_, value in ((floor, min(values)), (ceil, max(values))))
    return (low / 2, high * 3) if high > low else (low / 2, high * 10)


def _shown(row: Row) -> bool:
    return isfinite(row.error) and isfinite(row.measured.seconds) and isfinite(row.at_most)


def _place(row: Row) -> tuple[float, float]:
    return max(row.measured.seconds, 1e-7), max(row.at_most if row.is_bound else row.error, LEAST)
