"""Draw the figures of a plan by matplotlib, and the map of the share of prints in which each coil is selective enough.

`picture_names` has these and the drawings: `padgen draw` writes them, `Plan.plot` shows them.
"""

from collections.abc import Callable, Sequence
from textwrap import fill
from typing import Any

import numpy as np

from padgen.core.display import COLOURS, INK, PALE, channel_colours, plot_style
from padgen.core.registry import unknown_name
from padgen.planner.layout import Outline, coil_axis_mm
from padgen.planner.plan import Plan
from padgen.report.drawings import (
    NAME_PT,
    SMALL_PT,
    Sheet,
    all_shapes,
    circle,
    draw_exploded,
    draw_pad,
    draw_section,
    pad_corners,
    rectangle,
    title_of,
)
from padgen.report.figures import Figure, Panel, Points, colour_of, figure_names, figures_of
from padgen.report.figures.responses import MOST_NAMED

__all__ = ["draw_figure", "draw_grid", "draw_overview", "draw_panel", "draw_prints", "picture", "picture_names"]


def colours_of(plan: Plan) -> Any:
    """Return a colour (n, 4) for each channel of a plan."""
    import matplotlib

    return matplotlib.colors.to_rgba_array(channel_colours(len(plan.channels)))


def new_canvas(plan: Plan, words: str, width_in: float, height_in: float) -> Any:
    """Return an empty matplotlib figure of a size in inches, titled by the pad's name and `words`."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(width_in, height_in), layout="constrained")
    canvas.suptitle(title_of(plan, words), x=0.01, ha="left")
    return canvas


def draw_figure(plan: Plan, name: str) -> Any:
    """Draw the figure named `name` by matplotlib: tables side by side, other panels stacked over one x axis."""
    figure = figures_of(plan, name, "draw")[0]
    panels = figure.panels
    if panels and panels[0].kind == "discs":
        return draw_to_scale(plan, figure)
    canvas = new_canvas(plan, figure.title, *size_in(panels))
    if not panels:
        canvas.text(0.01, 0.5, figure.instead or "\n".join(figure.notes))
    elif panels[0].kind == "matrix":
        draw_tables(canvas.subplots(1, len(panels), squeeze=False)[0], panels)
    else:
        shares = [panel.height for panel in panels]
        axes = canvas.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=shares)[:, 0]
        for axis, panel in zip(axes, panels, strict=True):
            draw_panel(axis, panel, figure)
            axis.label_outer()
            legend(canvas, axis, panel)
    return canvas


def draw_grid(figure: Figure) -> Any:
    """Draw a figure that shows no single plan by matplotlib: two panels in a row, each with its own axes and legend."""
    from matplotlib.figure import Figure as Canvas

    count = max(len(figure.panels), 1)
    columns = min(count, 2)
    rows = -(-count // columns)
    with plot_style():
        canvas = Canvas(figsize=(GRID_IN[0] * columns, GRID_IN[1] * rows + 0.4), layout="constrained")
        axes = canvas.subplots(rows, columns, squeeze=False).ravel()
        for spare in axes[len(figure.panels) :]:
            spare.set_axis_off()
        for axis, panel in zip(axes, figure.panels, strict=False):
            draw_panel(axis, panel, figure)
            axis.set_title(panel.title)
            axis.grid(axis="y")
            if axis.get_legend_handles_labels()[0]:
                axis.legend(fontsize=8)
        canvas.suptitle(figure.title.replace("$", r"\$"))
    return canvas


GRID_IN = (5.6, 4.2)
"""Width and height of a panel of a grid, in inches."""


def draw_to_scale(plan: Plan, figure: Figure) -> Any:
    """Draw panels of discs to scale beside each other, with their numbers and, where there is room, their names."""
    first = figure.panels[0]
    wide = first.x.high - first.x.low
    apart = 1.12 * wide
    area = Outline(first.x.low, first.x.high + apart * (len(figure.panels) - 1), first.y.low, first.y.high)
    # So large that a number of three digits fits into a disc.
    least = LEAST_DISC_IN * 2.12 * wide / min(min(mark.diameter, mark.depth or mark.diameter) for mark in first.marks)
    notes = [fill(note, NOTE_LETTERS) for note in figure.notes]
    below = 0.4 + NOTE_LINE_IN * sum(note.count("\n") + 1 for note in notes)
    room = (0.7, 0.3, below, 0.85)
    sheet = Sheet(title_of(plan, figure.title), area, room, (max(9.5, least), max(6.5 + below, least)))
    for place, panel in enumerate(figure.panels):
        beside = np.array([apart * place, 0.0])
        for shape in panel.shapes:
            sheet.part(shape.label, [np.array(shape.corners) + beside], facecolor=colour_of(shape.role, 0))
        middle = np.array([(panel.x.low + panel.x.high) / 2, panel.y.high + 0.12 * sheet.mm]) + beside
        sheet.words(middle, panel.title, va="bottom", weight="bold", fontsize=NAME_PT)
        for mark in panel.marks:
            roomy = bool(mark.names) and mark.diameter > ROOMY_DISC_IN * sheet.mm
            style = {"facecolor": colour_of(mark.role, 0), "edgecolor": colour_of(mark.edge_role, 0)}
            for index, (x, y) in enumerate(np.column_stack([mark.x, mark.y]) + beside):
                around = circle(x, y, mark.diameter)
                if mark.depth is not None:
                    half_x = mark.diameter / 2
                    half_y = mark.depth / 2
                    around = rectangle(x - half_x, x + half_x, y - half_y, y + half_y)
                sheet.part(mark.label, [around], **style)
                up = 0.08 * sheet.mm if roomy else 0.0
                sheet.words((x, y + up), mark.numbers[index], fontsize=11 if roomy else SMALL_PT, weight="bold")
                if roomy:
                    sheet.words((x, y - 0.11 * sheet.mm), mark.names[index], color="#555555")
            if roomy and not place:
                notes.append(mark.names_note)
    sheet.words((area.x0, area.y0 - 0.15 * sheet.mm), "\n".join(notes), ha="left", va="top")
    return sheet.figure


LEAST_DISC_IN = 0.28
ROOMY_DISC_IN = 0.45
NOTE_LETTERS = 120
NOTE_LINE_IN = 0.15
"""Letters in a line of a note, and the height of one, in inches."""


def size_in(panels: Sequence[Panel]) -> tuple[float, float]:
    """Return width and height in inches of a picture with these panels."""
    kind = panels[0].kind if panels else ""
    if kind == "rows":
        return 9.0, min(1.7 + 0.3 * len(panels[0].row_labels), 9.0)
    if kind == "matrix":
        side = min(max(0.42 * len(panels[0].marks[0].names), 2.6), 7.5)
        return max(len(panels) * (side + 0.9) + 1.5, 6.2), side + 1.5
    return 9.0, 0.5 + 1.5 * sum(panel.height for panel in panels)


def legend(canvas: Any, axis: Any, panel: Panel) -> None:
    """Add a panel's legend to its right: beside the whole picture for rows, else beside the panel's axes."""
    if not axis.get_legend_handles_labels()[0]:
        return
    if panel.kind == "rows":
        canvas.legend(loc="outside right upper", fontsize=8)
    else:
        beside: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "fontsize": 8}
        axis.legend(title=panel.legend_title or None, alignment="left", **beside)


def scale_axes(axis: Any, panel: Panel) -> None:
    """Give both axes their range, title and ticks; a logarithmic x axis has plain numbers."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    low = panel.x.low
    high = panel.x.high
    axis.set(xlabel=panel.x.title, ylabel=panel.y.title, ylim=(panel.y.low, panel.y.high))
    if panel.x.is_log:
        axis.set(xscale="log", xlim=(low, high))
        locator: Any = MaxNLocator(7, steps=(1, 2, 5, 10))
        if high > WIDE * low:
            locator = LogLocator(subs=(1, 2, 5))
        if high > WIDEST * low:
            locator = LogLocator(numticks=8)
        ticks = [tick for tick in locator.tick_values(low, high) if low <= tick <= high]
        axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.minorticks_off()
        axis.grid(axis="x")
    else:
        axis.set_xlim(low, high)
    if panel.y.is_log:
        axis.set_yscale("log")


WIDE = 5.0
WIDEST = 1e3
"""Bands that reach over more than these ratios have 1, 2 and 5 of each decade marked, and whole decades only."""


def draw_panel(axis: Any, panel: Panel, figure: Figure) -> None:
    """Draw a panel of a figure into an axis of matplotlib."""
    MARKS[panel.kind](axis, panel, figure)
    for line in panel.lines:
        draw = axis.axvline if line.axis == "x" else axis.axhline
        style = "--" if line.is_dashed else ":"
        draw(line.at, color=colour_of(line.role, figure.channels), linestyle=style, label=line.label or None)
    for points in panel.points:
        draw_points(axis, points, figure)
    scale_axes(axis, panel)


def draw_points(axis: Any, points: Points, figure: Figure) -> None:
    """Draw single points: hollow where the value is a bound, ringed and labelled where `rings` has words."""
    colours = [colour_of(role, figure.channels) for role in points.roles]
    fills = colours
    edges: Any = "white"
    if any(points.hollow):
        fills = ["white" if is_hollow else colour for colour, is_hollow in zip(colours, points.hollow, strict=True)]
        edges = colours
    axis.scatter(points.x, points.y, 45, fills, marker=points.symbol, edgecolors=edges, linewidths=0.8, zorder=5)
    # Where its points have colours of their own, the legend's mark is of none of them.
    mark = {"color": colour_of(points.legend_role, figure.channels), "markeredgecolor": "white", "markersize": 8}
    axis.plot([], [], points.symbol, label=points.label, **mark)
    for x, y, words in zip(points.x, points.y, points.rings, strict=False):
        if words:
            axis.plot(x, y, "o", color=INK, markerfacecolor="none", markersize=12, zorder=4)
            beside = {"xytext": (8, 5), "textcoords": "offset points", "fontsize": 7, "zorder": 6}
            axis.annotate(words, (x, y), **beside, bbox={"color": "white", "alpha": 0.7, "pad": 0.5})


def draw_rows(axis: Any, panel: Panel, figure: Figure) -> None:
    """Draw marks in rows, each with a bar for its span behind it and an error bar of one sigma to both sides."""
    for series in panel.marks:
        colour = colour_of(series.role, figure.channels)
        left = [first for first, _ in series.spans]
        width = [last - first for first, last in series.spans]
        words = f"\n{series.which}" if series.which else ""
        axis.barh(series.rows, width, 0.7, left, color=colour, alpha=0.22, label=series.span_label + words)
        axis.errorbar(
            series.marks,
            series.rows,
            xerr=series.sigmas,
            fmt="o",
            color=colour,
            capsize=3,
            markersize=5,
            label=f"{series.mark_label}, {series.sigma_label}{words}",
        )
    step = max(-(-len(panel.row_labels) // MOST_TICKS), 1)
    named = panel.row_labels[::step]
    if named:
        axis.set_yticks([row.at for row in named], [f"{row.name}:  {row.value}" for row in named])


MOST_TICKS = 30


def draw_curves(axis: Any, panel: Panel, figure: Figure) -> None:
    """Draw curves over a common x."""
    for curves in panel.marks:
        for y, role, label in zip(curves.y, curves.roles, curves.labels, strict=True):
            axis.plot(curves.x, y, color=colour_of(role, figure.channels), label=label or None, linewidth=1.5)


def draw_stems(axis: Any, panel: Panel, figure: Figure) -> None:
    """Draw lines from the bottom of a panel up."""
    for stems in panel.marks:
        colour = colour_of(stems.role, figure.channels)
        axis.vlines(stems.x, panel.y.low, stems.y, color=colour, linewidth=2.0, label=stems.label)


def draw_bars(axis: Any, panel: Panel, figure: Figure) -> None:
    """Draw histograms on the same axes, each seen through the next."""
    for bars in panel.marks:
        edges = np.array(bars.edges)
        colour = colour_of(bars.role, figure.channels)
        axis.bar(edges[:-1], bars.counts, np.diff(edges), align="edge", color=colour, alpha=0.7, label=bars.label)


MARKS: dict[str, Callable[[Any, Panel, Figure], None]] = {
    "rows": draw_rows,
    "curves": draw_curves,
    "stems": draw_stems,
    "bars": draw_bars,
    "points": lambda axis, panel, figure: None,
}
"""The function that draws the marks of each kind of panel; tables have their own colours, and `draw_tables`."""


def draw_tables(axes: Any, panels: Sequence[Panel]) -> None:
    """Draw tables beside each other in the colours of one scale; what is less than asked is framed."""
    from matplotlib.patches import Rectangle

    for axis, panel in zip(axes, panels, strict=True):
        (matrix,) = panel.marks
        count = len(matrix.names)
        db = np.array(matrix.values)
        shown = np.ma.masked_array(db, np.eye(count, dtype=bool))
        image = axis.imshow(shown, cmap="cividis", vmin=matrix.z.low, vmax=matrix.z.high)
        for (row, column), value in np.ndenumerate(db):
            if count <= MOST_WRITTEN:
                dark = row != column and image.norm(value) < 0.55
                digits = 0 if count > 4 else 1
                words = "ON" if row == column else f"{value:.{digits}f}"
                axis.text(column, row, words, ha="center", va="center", fontsize=8, color="white" if dark else INK)
            if row != column and value < matrix.asked:
                corner = column - 0.46, row - 0.46
                axis.add_patch(Rectangle(corner, 0.92, 0.92, fill=False, edgecolor=COLOURS[1], linewidth=2))
        every = slice(None, None, -(-count // MOST_TICKS))
        axis.set_xticks(range(count)[every], matrix.names[every])
        axis.set_yticks(range(count)[every], matrix.names[every])
        axis.set(xlabel=panel.x.title, ylabel=panel.y.title)
        if panel.title:
            axis.set_title(panel.title)
    label = f"{matrix.z.title.lstrip(', ')} (framed: less than asked)"
    bar = axes[0].figure.colorbar(image, ax=list(axes), label=label, shrink=0.9)
    bar.ax.axhline(matrix.asked, color=COLOURS[1], linewidth=2)


MOST_WRITTEN = 16


def draw_prints(plan: Plan) -> Any:
    """Draw the pad from the touch side, coloured by the share of prints in which each coil keeps the asked dB."""
    canvas = new_canvas(plan, "which coils' prints suffer", 6.8, 5.9)
    print_map(canvas.subplots(), plan)
    canvas.legend(loc="outside lower left", fontsize=8, ncols=6)
    return canvas


def print_map(axis: Any, plan: Plan) -> None:
    """Draw the share of re-tuned prints in which each coil keeps the asked selectivity, and the bosses by channel."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    coils = plan.coils
    least = plan.spec.print_share
    shade = ScalarMappable(Normalize(least, 1.0), LinearSegmentedColormap.from_list("prints", ("#f0bf5a", "white")))
    half = np.array([coils.pitch_x_mm, coils.pitch_y_mm]) / 2
    places = [coil_axis_mm(coils, row, column) for row in range(coils.rows) for column in range(coils.columns)]
    cells = [place + half * [(-1, -1), (1, -1), (1, 1), (-1, 1)] for place in places]
    for cell, share in zip(cells, plan.prints.coil_shares, strict=True):
        if len(cells) <= MOST_LABELLED:
            axis.annotate(f"{100 * share:.3g} %", cell[0], (2, 2), textcoords="offset points", fontsize=8)
    fills = shade.to_rgba(np.array(plan.prints.coil_shares))
    axis.add_collection(PolyCollection(cells, facecolors=fills, edgecolors=PALE, linewidths=0.4, gid="cells"))
    colours = colours_of(plan)
    for index, colour in enumerate(colours if len(plan.channels) <= MOST_NAMED else ()):
        axis.plot([], [], "o", color=colour, label=f"channel {index}")
    axis.add_collection(
        PolyCollection(
            all_shapes(plan, ("boss",))["boss"],
            facecolors=colours[[t.channel for t in plan.taxels]],
            edgecolors="white",
            linewidths=0.5,
            gid="bosses",
        )
    )
    for grow, style in ((1.0, "-"), (0.0, ":")):
        axis.plot(*pad_corners(plan, grow)[[0, 1, 2, 3, 0]].T, style, color=PALE, linewidth=0.8)
    axis.set(xlabel="x, mm", ylabel="y, mm", aspect="equal")
    asked = f"keeps {plan.selectivity.asked_db:.1f} dB in so many re-tuned prints"
    bar = axis.figure.colorbar(
        shade, ax=axis, extend="min", shrink=0.8, label=f"share: a coil {asked}", format="{x:.0%}"
    )
    bar.ax.set_ylim(least, 1.0)


MOST_LABELLED = 64


def draw_overview(plan: Plan) -> Any:
    """Draw the map of the share of prints in which each coil keeps the asked dB and, beside it, all resonances."""
    canvas = new_canvas(plan, repr(plan).strip("<>").removeprefix(f"Plan {plan.name}: "), 11.0, 5.6)
    left, right = canvas.subplots(1, 2, width_ratios=(1.15, 1))
    print_map(left, plan)
    (ladder,) = figures_of(plan, "ladder", "draw")
    draw_panel(right, ladder.panels[0], ladder)
    canvas.legend(loc="outside lower left", fontsize=8, ncols=6)
    return canvas


DRAWINGS: dict[str, Callable[[Plan], Any]] = {
    "pad": draw_pad,
    "section": draw_section,
    "exploded": draw_exploded,
    "prints": draw_prints,
}
"""The function of each drawing that is no figure: these are to scale in mm."""
SHEETS: dict[str, Callable[[Plan], Any]] = {"overview": draw_overview}
"""The function of each sheet that shows several others."""


def picture_names(with_sheets: bool = True) -> tuple[str, ...]:
    """Return the names of all pictures: drawings, figures, and sheets of several of them."""
    return (*DRAWINGS, *figure_names("draw"), *(SHEETS if with_sheets else ()))


def picture(plan: Plan, name: str) -> Any:
    """Draw one of the `picture_names` from a plan alone, without a display or a CAD kernel.

    Returns
    -------
    matplotlib.figure.Figure
        `padgen.core.display.plot_bytes` makes SVG and PNG of it, the same bytes for the same plan.

    Raises
    ------
    SpecError
        There is no picture of that name; the sentence has the nearest.
    """
    if name not in picture_names():
        raise unknown_name(name, list(picture_names()), "picture", "")
    drawings = {**DRAWINGS, **SHEETS}
    with plot_style():
        return drawings[name](plan) if name in drawings else draw_figure(plan, name)
