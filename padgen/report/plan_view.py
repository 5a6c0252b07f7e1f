"""Draw a plan as a picture and as HTML for notebooks: the pad to scale, and the ladder of its resonances."""

from html import escape
from typing import TYPE_CHECKING, Any

from padgen.core.plots import STYLE
from padgen.report.plans import findings_text

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = ["plan_figure", "plan_html"]

LEVEL_COLOURS = {"error": "#c2241a", "warning": "#a86a00", "note": "#666666"}
HEADINGS = ("channel", "resonance Hz", "drive Hz", "suspension", "beam mm (w × t × l)", "ring-up ms", "level µm")
LADDER_PX, LADDER_HEIGHT_PX = 560, 46
MOST_LABELLED = 64
"""Most coils for which each one's share of good prints is written in its cell."""


def plan_figure(plan: "Plan") -> Any:
    """Draw the pad from the touch side, to scale, and the resonances of its channels.

    Returns
    -------
    matplotlib.figure.Figure
        Left: coils (open circles) and bosses, coloured by channel. Each cell shows the share of re-tuned prints in
        which its coil keeps the asked selectivity. The smaller the share, the stronger its tint, up to full where that
        coil alone misses `print_share`. Right: each channel's slot and resonance.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 4.6), layout="constrained")
        FigureCanvasAgg(figure)
        pad, ladder = figure.subplots(1, 2, width_ratios=(1, 1))
        colours = [matplotlib.colormaps["viridis"](share) for share in _shares(len(plan.channels))]
        _draw_pad(pad, plan, colours)
        _draw_ladder(ladder, plan, colours)
        figure.suptitle(repr(plan).strip("<>"), fontsize=10)
    return figure


def _shares(count: int) -> list[float]:
    """Return `count` evenly spaced places on a colour map, without its palest end."""
    return [0.85 * k / max(count - 1, 1) for k in range(count)]


def _draw_pad(axis: Any, plan: "Plan", colours: list[Any]) -> None:
    from matplotlib.patches import Circle, Rectangle

    pad, coils = plan.spec.pad, plan.coils
    for grow, style in ((2 * pad.border_mm, "-"), (0.0, ":")):
        wide, deep = pad.width_mm + grow, pad.depth_mm + grow
        axis.add_patch(Rectangle((-wide / 2, -deep / 2), wide, deep, fill=False, linestyle=style, color="#444444"))
    for row in range(coils.rows):
        for column in range(coils.columns):
            centre = (
                (column - (coils.columns - 1) / 2) * coils.pitch_x_mm,
                (row - (coils.rows - 1) / 2) * coils.pitch_y_mm,
            )
            corner = centre[0] - coils.pitch_x_mm / 2, centre[1] - coils.pitch_y_mm / 2
            share = plan.prints.coil_shares[row * coils.columns + column]
            tint = 0.6 * min((1 - share) / (1 - plan.spec.print_share), 1.0)
            cell = Rectangle(corner, coils.pitch_x_mm, coils.pitch_y_mm, facecolor=(0.76, 0.14, 0.1, tint), linewidth=0)
            axis.add_patch(cell)
            if coils.rows * coils.columns <= MOST_LABELLED:
                axis.annotate(f"{100 * share:.3g} %", corner, (2, 2), textcoords="offset points", fontsize=6)
            axis.add_patch(Circle(centre, plan.spec.coil.outer_diameter_mm / 2, fill=False, color="#b8753a"))
    for taxel in plan.taxels:
        boss = Circle((taxel.x_mm, taxel.y_mm), plan.plate.boss_diameter_mm / 2, color=colours[taxel.channel])
        axis.add_patch(boss)
    keeps = f"which a coil keeps {plan.selectivity.asked_db:.1f} dB (redder: fewer)"
    title = f"touch side: bosses over coils; share of prints in\n{keeps}"
    axis.set(xlabel="x, mm", ylabel="y, mm", title=title)
    axis.set_aspect("equal")
    axis.autoscale_view()


def _draw_ladder(axis: Any, plan: "Plan", colours: list[Any]) -> None:
    for channel, colour in zip(plan.channels, colours, strict=True):
        low, high = _slot_hz(plan, channel.resonance_hz)
        axis.barh(channel.index, high - low, left=low, height=0.7, color=colour, alpha=0.3)
        axis.plot([channel.resonance_hz], [channel.index], "o", color=colour)
    axis.set(xscale="log", xlabel="Hz", ylabel="channel", title="resonances and their slots (paper's Δy/4Q)")
    axis.set_yticks([channel.index for channel in plan.channels])
    ticks = sorted({float(f"{channel.resonance_hz:.3g}") for channel in plan.channels})
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.grid(alpha=0.25)


def _slot_hz(plan: "Plan", resonance_hz: float) -> tuple[float, float]:
    half = plan.spec.delta_y / (4 * plan.spec.q_min)
    return resonance_hz * max(1 - half, 0.0), resonance_hz * (1 + half)


def plan_html(plan: "Plan") -> str:
    """Return the plan as HTML: one line, the ladder, a table of channels, and the findings."""
    rows = [
        (
            str(c.index),
            f"{c.resonance_hz:.2f}",
            f"{c.drive_hz:.2f}",
            c.beam.topology,
            f"{c.beam.width_mm:.3f} × {c.beam.thickness_mm:.2f} × {c.beam.length_mm:.2f}",
            f"{c.ring_up_ms:.0f}",
            f"{c.level_um:.2f}",
        )
        for c in plan.channels
    ]
    head = "".join(f"<th>{escape(heading)}</th>" for heading in HEADINGS)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    findings = "".join(
        f'<li style="color:{LEVEL_COLOURS[finding.level]}">{escape(findings_text([finding]))}</li>'
        for finding in plan.findings
    )
    return f"<p>{escape(repr(plan))}</p>{_ladder_svg(plan)}<table><tr>{head}</tr>{body}</table><ul>{findings}</ul>"


def _ladder_svg(plan: "Plan") -> str:
    """Return an SVG picture of the resonances as lines on a logarithmic axis, each within its slot."""
    from math import log

    slots = [_slot_hz(plan, channel.resonance_hz) for channel in plan.channels]
    low, high = max(slots[0][0], plan.channels[0].resonance_hz / 10), slots[-1][1]

    def at(hz: float) -> float:
        return round((LADDER_PX - 1) * log(max(hz, low) / low) / log(high / low), 1)

    marks = []
    for channel, (first, last) in zip(plan.channels, slots, strict=True):
        x, width = at(first), round(at(last) - at(first), 1)
        marks.append(f'<rect x="{x}" y="6" width="{width}" height="20" fill="#1f5fa8" fill-opacity="0.25"/>')
        line = at(channel.resonance_hz)
        marks.append(f'<line x1="{line}" x2="{line}" y1="4" y2="28" stroke="#1f5fa8" stroke-width="2"/>')
        marks.append(
            f'<text x="{line}" y="42" font-size="10" text-anchor="middle">{channel.resonance_hz:.0f} Hz</text>'
        )
    label = f"resonances of {len(plan.channels)} channels"
    return (
        f'<svg role="img" aria-label="{label}" width="{LADDER_PX}" height="{LADDER_HEIGHT_PX}"'
        f' viewBox="-20 0 {LADDER_PX + 40} {LADDER_HEIGHT_PX}">{"".join(marks)}</svg>'
    )
