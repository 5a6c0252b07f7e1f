"""The picture of a Pareto front: every two objectives against each other. The same figures give the same bytes."""

from dataclasses import replace
from typing import Any

import numpy as np

from padgen.batch.figures import OBJECTIVES
from padgen.batch.front import UNBOUNDED, Overview, front_mask, scores_of
from padgen.core.plots import STYLE, plot_bytes

__all__ = ["front_pictures"]

COLOURED_BY = ("power_w", "selectivity_db", "print_min", "good_pads_retuned", "taxels")
"""The first of these that differs among variants tells apart the front's points by colour."""
RATIOS = ("taxels", "power_w", "print_min")
"""Objectives whose axis is logarithmic where the largest is more than `WIDE` times the smallest."""
WIDE = 20.0
PANEL_INCHES, MARGIN_INCHES, LEGEND_INCHES = (2.9, 2.3), (0.9, 0.7), 2.9
TITLE_INCHES = 0.7
MOST_VECTORS = 1000
"""Points beyond which the SVG holds them as pixels."""


def front_pictures(overview: Overview, name: str) -> tuple[bytes, bytes] | None:
    """The front as SVG and PNG; None where fewer than two objectives differ.

    One panel for every two objectives that differ among variants: coloured is the front, grey what it
    beats, a cross what has error findings. A line joins those that none beats in the panel's two alone.
    """
    shown = _differing(overview)
    if not len(overview.values) or len(shown) < 2:
        return None
    import matplotlib

    title, overview = _title(overview, name), _bounded(overview)
    with matplotlib.rc_context(STYLE):
        figure, panels = _figure(shown)
        hue = min(shown, key=lambda i: COLOURED_BY.index(overview.objectives[i]))
        for (x, y), axis in panels.items():
            points = _panel(axis, overview, (x, y), hue)
        for (x, y), axis in panels.items():
            _name_axes(axis, overview, (x, y), (y == shown[-1], x == shown[0]))
        _legend(figure, points, panels[shown[0], shown[1]], _label(overview, hue))
        figure.text(0.012, 1 - 0.08 / figure.get_figheight(), title, fontsize=9, va="top")
        return plot_bytes(figure, "svg"), plot_bytes(figure, "png")


def _differing(overview: Overview) -> list[int]:
    """Objectives with more than one value."""
    everything = _everything(overview)
    columns = range(len(overview.objectives))
    return [i for i in columns if len(np.unique(everything[np.isfinite(everything[:, i]), i])) > 1]


def _bounded(overview: Overview) -> Overview:
    """With a place for values that nothing limits: a little beyond the largest."""
    parts = [overview.values.copy(), overview.beaten.copy(), overview.faulty.copy()]
    for i, name in enumerate(overview.objectives):
        finite = np.concatenate([part[np.isfinite(part[:, i]), i] for part in parts])
        for part in parts if name in UNBOUNDED else ():
            part[np.isnan(part[:, i]), i] = finite.max() + 0.15 * max(float(np.ptp(finite)), 1.0)
    return replace(overview, values=parts[0], beaten=parts[1], faulty=parts[2])


def _everything(overview: Overview) -> np.ndarray:
    return np.concatenate([overview.values, overview.beaten, overview.faulty])


def _figure(shown: list[int]) -> tuple[Any, dict[tuple[int, int], Any]]:
    """The lower triangle of a square of panels by the objectives along x and y; room for the legend at its right."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    side = len(shown) - 1
    wide = MARGIN_INCHES[0] + side * PANEL_INCHES[0] + (LEGEND_INCHES if side == 1 else 0.2)
    high = MARGIN_INCHES[1] + side * PANEL_INCHES[1] + TITLE_INCHES
    figure = Figure(figsize=(wide, high))
    FigureCanvasAgg(figure)
    axes = figure.subplots(side, side, sharex="col", sharey="row", squeeze=False)
    right = (MARGIN_INCHES[0] + side * PANEL_INCHES[0]) / wide
    left, bottom, top = MARGIN_INCHES[0] / wide, MARGIN_INCHES[1] / high, 1 - TITLE_INCHES / high
    figure.subplots_adjust(left, bottom, right, top, wspace=0.06, hspace=0.08)
    panels = {}
    for i, row in enumerate(axes):
        for j, axis in enumerate(row):
            if j <= i:
                panels[shown[j], shown[i + 1]] = axis
            else:
                axis.set_visible(False)
    return figure, panels


def _panel(axis: Any, overview: Overview, pair: tuple[int, int], hue: int) -> Any:
    from matplotlib.colors import LogNorm, Normalize

    beaten, faulty, front = (points[:, pair] for points in (overview.beaten, overview.faulty, overview.values))
    axis.plot(*beaten.T, "o", **_dull(beaten), markersize=_size(beaten, 3.0), color="#bdbdbd", label="beaten by others")
    axis.plot(
        *faulty.T, "x", **_dull(faulty), markersize=_size(faulty, 3.5), color="#d49a8a", label="has error findings"
    )
    axis.plot(*_edge(overview, pair).T, color="#666666", linewidth=0.8, zorder=2, label="best in these two")
    points = axis.scatter(
        *front.T,
        s=26 if len(front) < 100 else 9,
        c=overview.values[:, hue],
        norm=(LogNorm if _is_wide(overview, hue) else Normalize)(),
        cmap="viridis",
        edgecolors="black",
        linewidths=0.5 if len(front) < 100 else 0.2,
        zorder=3,
        plotnonfinite=True,
        rasterized=len(front) > MOST_VECTORS,
        label="Pareto front" + ", all with error findings" * overview.of_faulty,
    )
    axis.grid(alpha=0.25)
    _write_numbers(axis, overview, pair)
    return points


def _edge(overview: Overview, pair: tuple[int, int]) -> np.ndarray:
    """Points of the front that none beats in two objectives alone, by the first of these."""
    values: np.ndarray = overview.values[:, pair]
    values = np.unique(values[np.isfinite(values).all(axis=1)], axis=0)
    kept: np.ndarray = values[front_mask(scores_of(values, [overview.objectives[i] for i in pair]))]
    return kept


def _write_numbers(axis: Any, overview: Overview, pair: tuple[int, int]) -> None:
    """Numbers of the variants that are best in an objective; of those at one place together."""
    column = overview.header.index("number")
    places: dict[tuple[float, float], list[str]] = {}
    for row in dict.fromkeys(overview.best().values()):
        x, y = overview.values[row, pair].tolist()
        if np.isfinite([x, y]).all():
            places.setdefault((x, y), []).append(overview.rows[row][column])
    for place, numbers in places.items():
        style = {"xytext": (4, 3), "textcoords": "offset points", "fontsize": 7, "zorder": 4}
        axis.annotate(", ".join(numbers), place, **style, bbox={"color": "white", "alpha": 0.6, "pad": 0.3})


def _name_axes(axis: Any, overview: Overview, pair: tuple[int, int], named: tuple[bool, bool]) -> None:
    for which, shows, objective in zip((axis.xaxis, axis.yaxis), named, pair, strict=True):
        if _is_wide(overview, objective):
            which._set_axes_scale("log")
            _round_ticks(which)
        if shows:
            which.set_label_text(_label(overview, objective))


def _round_ticks(axis: Any) -> None:
    """1, 2, 5, 10, ... instead of powers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _legend(figure: Any, points: Any, panel: Any, coloured: str) -> None:
    """Beside a single panel, or in the empty corner of the triangle."""
    marks = zip(*panel.get_legend_handles_labels(), strict=True)
    handles, labels = zip(*((mark, label) for mark, label in marks if _has_points(mark)), strict=True)
    wide, high = figure.get_size_inches()
    left, top = 1 - (LEGEND_INCHES - 0.2) / wide, 1 - TITLE_INCHES / high
    figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(left, top), frameon=False)
    place = figure.add_axes((left + 0.2 / wide, top - 2.1 / high, 0.16 / wide, 1.0 / high))
    bar = figure.colorbar(points, cax=place)
    if bar.ax.get_yscale() == "log":
        _round_ticks(bar.ax.yaxis)
    bar.set_label(f"colour: {coloured}", fontsize=8)


def _has_points(mark: Any) -> bool:
    return len(mark.get_xdata() if hasattr(mark, "get_xdata") else mark.get_offsets()) > 0


def _dull(points: np.ndarray) -> dict[str, Any]:
    return {"linestyle": "none", "zorder": 1, "rasterized": len(points) > MOST_VECTORS}


def _size(points: np.ndarray, few: float) -> float:
    """Size of a mark: smaller where there are many."""
    return few if len(points) < MOST_VECTORS else few / 2


def _is_wide(overview: Overview, objective: int) -> bool:
    """Whether an objective spans ratios rather than differences."""
    values = _everything(overview)[:, objective]
    finite = values[np.isfinite(values)]
    wide = finite.size and finite.min() > 0 and finite.max() > WIDE * finite.min()
    return bool(wide and overview.objectives[objective] in RATIOS)


def _label(overview: Overview, objective: int) -> str:
    name = overview.objectives[objective]
    return f"{OBJECTIVES[name].axis}\n({'more' if OBJECTIVES[name].best == 'most' else 'less'} is better)"


def _title(overview: Overview, name: str) -> str:
    front = "1 is" if len(overview.rows) == 1 else f"{len(overview.rows)} are"
    rest = f" ({overview.with_errors} with error findings)" * bool(overview.with_errors)
    made = "1 variant" if overview.made == 1 else f"{overview.made} variants"
    lines = [
        f"{name}: {made} made{rest}, {front} on the Pareto front",
        "numbers: variants that are best in an objective",
    ]
    everything = _everything(overview)
    for i, objective in enumerate(overview.objectives):
        if objective in UNBOUNDED and np.isnan(everything[:, i]).any():
            lines.append(f"{OBJECTIVES[objective].axis}: nothing limits it for the farthest")
    return "\n".join(lines)
