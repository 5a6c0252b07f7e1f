"""Charts of a plan: its ladder of resonances, the taxels' responses, selectivity, and the prints of each coil.

`PICTURES` names these and the drawings: `padgen draw` writes them, `Plan.plot` shows them.
"""

from typing import Any

import numpy as np

from padgen.core.display import COLOURS, INK, PALE, channel_colours, plot_style
from padgen.core.registry import unknown_name
from padgen.physics.resonator import felt_energy
from padgen.physics.selectivity import line_energy, own_lines, pair_lines, tone_energy
from padgen.planner.channels import coil_modes
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.layout import coil_axis_mm
from padgen.planner.plan import Plan
from padgen.report.drawings import all_shapes, border, draw_exploded, draw_pad, draw_section, draw_wiring, title_of
from padgen.report.figures import FIGURES, ROLES, Figure

__all__ = [
    "PICTURES",
    "SHEETS",
    "draw_ladder",
    "draw_overview",
    "draw_prints",
    "draw_responses",
    "draw_selectivity",
    "picture",
]


def colours_of(plan: Plan) -> Any:
    """Return a colour (n, 4) for each channel of a plan."""
    import matplotlib

    return matplotlib.colors.to_rgba_array(channel_colours(len(plan.channels)))


def new_figure(plan: Plan, words: str, width_in: float, height_in: float) -> Any:
    """Return an empty figure with its title."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    figure.suptitle(title_of(plan, words), x=0.01, ha="left")
    return figure


def hz_axis(axis: Any, low_hz: float, high_hz: float) -> None:
    """Make the x axis logarithmic in Hz, with plain numbers."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    axis.set(xscale="log", xlim=(low_hz, high_hz))
    locator = LogLocator(subs=(1, 2, 5)) if high_hz > WIDE * low_hz else MaxNLocator(7, steps=(1, 2, 5, 10))
    ticks = [tick for tick in locator.tick_values(low_hz, high_hz) if low_hz <= tick <= high_hz]
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.grid(axis="x")


WIDE = 5.0
"""Bands that reach over more than this ratio have 1, 2 and 5 of each decade marked."""


def draw_ladder(plan: Plan) -> Any:
    """Draw each channel's resonance, what prints scatter it by, and the slot that no other resonance may come into."""
    height = min(1.7 + 0.3 * len(plan.channels), 9.0)
    rows = FIGURES["ladder"](plan)
    figure = new_figure(plan, rows.title, 9.0, height)
    draw_rows(figure.subplots(), rows)
    figure.legend(loc="outside right upper", fontsize=8)
    return figure


def draw_rows(axis: Any, figure: Figure) -> None:
    """Draw a figure of marks in rows into an axis of matplotlib."""
    for series in figure.series:
        colour = ROLES[series.role]
        left = [first for first, _ in series.spans]
        width = [last - first for first, last in series.spans]
        axis.barh(series.rows, width, 0.7, left, color=colour, alpha=0.22, label=series.span_label)
        axis.errorbar(
            series.marks,
            series.rows,
            xerr=series.sigmas,
            fmt="o",
            color=colour,
            capsize=3,
            markersize=5,
            label=series.mark_label,
        )
    for line in figure.lines:
        axis.axvline(line.at, color=ROLES[line.role], linestyle=":", label=line.label or None)
    if figure.x.is_log:
        hz_axis(axis, figure.x.low, figure.x.high)
    else:
        axis.set_xlim(figure.x.low, figure.x.high)
    step = max(-(-len(figure.row_labels) // MOST_TICKS), 1)
    named = figure.row_labels[::step]
    if named:
        axis.set_yticks([row for row, _ in named], [text for _, text in named])
    axis.set(xlabel=figure.x.title, ylabel=figure.y.title, ylim=(figure.y.low, figure.y.high))


MOST_TICKS = 30


def draw_responses(plan: Plan) -> Any:
    """Draw how the taxels of one coil answer each frequency, and the lines of its current's square, all channels on.

    Above, a curve is a taxel's motion, in dB of its ON level, if the line that drives it moved in frequency. A mark is
    what the loudest OFF taxel hears of a tone or a spur that others make. Below are the lines' own strengths.
    """
    channel_set = plan.sets[0]
    scheme = plan.scheme
    which = placed_channels(plan.spec, channel_set)
    modes = coil_modes(plan.spec, channel_set)
    colours = colours_of(plan)[[channel.index for channel in channel_set]]
    parts = list(own_lines(which, scheme))
    if scheme.has_pair_spurs and 1 < len(channel_set) <= MOST_WITH_SPURS:
        parts.append(pair_lines(which, scheme))
    heard_db = np.concatenate([_heard(which, part, modes) for part in parts], axis=1)
    hz = which.resonance_hz
    heard_db = heard_db[:, heard_db[0] >= hz[0] / 8]
    low = 0.9 * min(hz[0] / 2, heard_db[0].min())
    high = 1.1 * max(2 * hz[-1], heard_db[0].max())
    figure = new_figure(plan, "how the taxels of one coil answer, and what its current asks of them", 9.0, 5.6)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    grid = np.unique(np.concatenate([np.geomspace(low, high, 1200), hz]))
    named = range(len(channel_set)) if len(channel_set) <= MOST_NAMED else (0, len(channel_set) - 1)
    for k, curve in enumerate(10 * np.log10(felt_energy(modes, slice(None), grid))):
        label = f"channel {channel_set[k].index}, {hz[k]:.1f} Hz" if k in named else None
        top.plot(grid, curve, color=colours[k], label=label, linewidth=1.5)
    asked = plan.selectivity.asked_db
    top.axhline(-asked, color=PALE, linestyle="--", label=f"asked of OFF taxels: {asked:.0f} dB below")
    strongest = which.line.max()
    legend = (
        "{} of others, as the loudest OFF\ntaxel hears it: off its curve by how much\nweaker or stronger it is played"
    )
    for is_spur, mark, colour, name in ((0, "o", INK, "tone"), (1, "X", COLOURS[1], "spur")):
        of_kind = heard_db[:, heard_db[4] == is_spur]
        if not of_kind.size:
            continue
        level = 10 * np.log10(np.maximum(of_kind[1], 1e-30)) - 20 * np.log10(strongest)
        bottom.vlines(of_kind[0], FLOOR_DB, level, color=colour, linewidth=2.0, label=name)
        heard = of_kind[:, of_kind[2] > 0]
        if heard.size:
            size = 10 * np.log10(heard[2])
            colour = colours[heard[3].astype(int)]
            top.scatter(heard[0], size, 45, colour, marker=mark, edgecolors="white", linewidths=0.8, zorder=5)
            top.plot([], [], mark, color=PALE, markeredgecolor="white", markersize=8, label=legend.format(name))
    top.set(ylim=(FLOOR_DB, 8), ylabel="motion, dB of the ON level")
    bottom.set(ylim=(FLOOR_DB, 8), ylabel="pull, dB of\nthe strongest", xlabel="frequency of the pull, Hz")
    hz_axis(bottom, low, high)
    top.grid(axis="x")
    beside: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "fontsize": 8}
    top.legend(**beside)
    turns = " (one at a time)" if scheme.takes_turns else ""
    bottom.legend(title=f"{scheme.name}, all on{turns}", alignment="left", **beside)
    return figure


MOST_NAMED = 12
MOST_WITH_SPURS = 64
FLOOR_DB = -60.0


def _heard(which: Any, part: Any, modes: Any) -> Any:
    """Return of each line (5, m): frequency in Hz, squared size, energy in the loudest OFF taxel, which, is a spur."""
    energy = line_energy(which, part, modes)
    for maker in part.makers:
        energy[maker, :, np.arange(len(maker))] = 0.0
    spur = np.ones(part.hz.shape)
    spur[0] = len(part.makers) > 1
    rows = part.hz, np.broadcast_to(part.square, part.hz.shape), energy.max(0), energy.argmax(0), spur
    return np.stack([row.ravel() for row in rows])


def draw_selectivity(plan: Plan) -> Any:
    """Draw for each set of channels by how much an OFF taxel (row) is quieter than ON at the tone of another."""
    from matplotlib.patches import Rectangle

    figures = plan.selectivity
    # Of many channels the plan has no table.
    many = [placed_channels(plan.spec, channel_set) for channel_set in plan.sets if not figures.matrix_db]
    tables = [np.array(table) for table in figures.matrix_db] or [-10 * np.log10(tone_energy(c, c)) for c in many]
    side = min(max(0.42 * len(tables[0]), 2.6), 7.5)
    words = "how much quieter an OFF taxel is than ON, at the tone of another"
    figure = new_figure(plan, words, max(len(tables) * (side + 0.9) + 1.5, 6.2), side + 1.5)
    axes = figure.subplots(1, len(tables), squeeze=False)[0]
    largest = max([2 * figures.asked_db, *(float(t.max()) for t in tables)])
    for axis, channel_set, db in zip(axes, plan.sets, tables, strict=True):
        shown = np.ma.masked_array(db, np.eye(len(channel_set), dtype=bool))
        image = axis.imshow(shown, cmap="cividis", vmin=0.0, vmax=min(largest, 60.0))
        for (row, column), value in np.ndenumerate(db):
            if len(channel_set) <= MOST_WRITTEN:
                dark = row != column and image.norm(value) < 0.55
                digits = 0 if len(channel_set) > 4 else 1
                words = "ON" if row == column else f"{value:.{digits}f}"
                axis.text(column, row, words, ha="center", va="center", fontsize=8, color="white" if dark else INK)
            if row != column and value < figures.asked_db:
                corner = column - 0.46, row - 0.46
                axis.add_patch(Rectangle(corner, 0.92, 0.92, fill=False, edgecolor=COLOURS[1], linewidth=2))
        every = slice(None, None, -(-len(channel_set) // MOST_TICKS))
        names = [str(c.index) for c in channel_set]
        at = range(len(channel_set))
        axis.set_xticks(at[every], names[every])
        axis.set_yticks(at[every], names[every])
        axis.set(xlabel="tone of channel", ylabel="OFF taxel of channel")
    if len(tables[0]) < 2:
        axes[0].set_title("one channel per coil: there is no other tone to hear")
    bar = figure.colorbar(image, ax=list(axes), label="dB (framed: less than asked)", shrink=0.9)
    bar.ax.axhline(figures.asked_db, color=COLOURS[1], linewidth=2)
    return figure


MOST_WRITTEN = 16


def draw_prints(plan: Plan) -> Any:
    """Draw the pad from the touch side, each coil's cell in the colour of the share of prints in which it is good."""
    figure = new_figure(plan, "which coils' prints suffer", 6.8, 5.9)
    print_map(figure.subplots(), plan)
    figure.legend(loc="outside lower left", fontsize=8, ncols=6)
    return figure


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
        axis.plot(*border(plan, grow)[[0, 1, 2, 3, 0]].T, style, color=PALE, linewidth=0.8)
    axis.set(xlabel="x, mm", ylabel="y, mm", aspect="equal")
    asked = f"keeps {plan.selectivity.asked_db:.1f} dB in so many re-tuned prints"
    bar = axis.figure.colorbar(
        shade, ax=axis, extend="min", shrink=0.8, label=f"share: a coil {asked}", format="{x:.0%}"
    )
    bar.ax.set_ylim(least, 1.0)


MOST_LABELLED = 64


def draw_overview(plan: Plan) -> Any:
    """Draw the pad with the prints that each coil survives, and beside it the ladder of resonances."""
    figure = new_figure(plan, repr(plan).strip("<>").removeprefix(f"Plan {plan.name}: "), 11.0, 5.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1))
    print_map(left, plan)
    draw_rows(right, FIGURES["ladder"](plan))
    figure.legend(loc="outside lower left", fontsize=8, ncols=6)
    return figure


PICTURES = {
    "pad": draw_pad,
    "section": draw_section,
    "exploded": draw_exploded,
    "ladder": draw_ladder,
    "responses": draw_responses,
    "selectivity": draw_selectivity,
    "prints": draw_prints,
    "wiring": draw_wiring,
    "overview": draw_overview,
}
SHEETS = ("overview",)
"""Those of the `PICTURES` that show several others on one sheet."""


def picture(plan: Plan, name: str) -> Any:
    """Draw one of `PICTURES` from a plan alone, without a display or a CAD kernel.

    Returns
    -------
    matplotlib.figure.Figure
        `padgen.core.display.plot_bytes` makes SVG and PNG of it, the same bytes for the same plan.

    Raises
    ------
    SpecError
        There is no picture of that name; the sentence has the nearest.
    """
    if name not in PICTURES:
        raise unknown_name(name, list(PICTURES), "picture", "")
    with plot_style():
        return PICTURES[name](plan)
