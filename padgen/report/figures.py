"""Pictures as data: axes, spans, marks and labels with colours by role, made once of a plan and drawn by any renderer.

A function of a plan makes each figure; `FIGURES` names them. `charts.py` draws them by matplotlib, `svg` as inline SVG.
"""

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from math import log
from typing import TYPE_CHECKING

from padgen.core.display import COLOURS, PALE
from padgen.physics.ladder import slot_half_width

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = ["FIGURES", "ROLES", "Figure", "Line", "Scale", "Series", "ladder", "slot_hz", "svg"]

ROLES = {"set-0": COLOURS[0], "set-1": COLOURS[1], "limit": PALE}
"""The colour of each role that something in a figure has."""


@dataclass(frozen=True)
class Scale:
    """An axis: its label, its unit (empty where it counts), its range, and whether it is logarithmic."""

    label: str
    unit: str
    low: float
    high: float
    is_log: bool = False

    @property
    def title(self) -> str:
        """The label with its unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label

    def share(self, value: float) -> float:
        """Return the place of a value between the ends of the axis, from 0 to 1; what lies outside is put on an end."""
        inside = min(max(value, self.low), self.high)
        if self.is_log:
            return log(inside / self.low) / log(self.high / self.low)
        return (inside - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Series:
    """Marks in rows, each with a span around it and one sigma to each side, in the units of the axes."""

    role: str
    span_label: str
    mark_label: str
    rows: tuple[float, ...]
    marks: tuple[float, ...]
    spans: tuple[tuple[float, float], ...]
    sigmas: tuple[float, ...]


@dataclass(frozen=True)
class Line:
    """A line across a figure at one value of its x axis; without a label the legend leaves it out."""

    role: str
    at: float
    label: str = ""


@dataclass(frozen=True)
class Figure:
    """A picture as data: its title, axes, series and lines, and the text of each row by its place."""

    title: str
    x: Scale
    y: Scale
    series: tuple[Series, ...]
    lines: tuple[Line, ...] = ()
    row_labels: tuple[tuple[float, str], ...] = ()


def slot_hz(plan: "Plan", resonance_hz: float) -> tuple[float, float]:
    """Return the ends in Hz of the slot that a resonance needs for itself: the paper's Δy/4Q to either side."""
    half = slot_half_width(plan.spec.q_min, plan.spec.delta_y)
    return resonance_hz * max(1 - half, 0.0), resonance_hz * (1 + half)


def ladder(plan: "Plan") -> Figure:
    """Return each channel's resonance, what prints scatter it by, and the slot that no other may come into."""
    half = slot_half_width(plan.spec.q_min, plan.spec.delta_y)
    several = len(plan.sets) > 1
    series = []
    for place, (channel_set, name) in enumerate(zip(plan.sets, ("even", "odd"), strict=False)):
        words = f"\n(coils of {name} row + column)" if several else ""
        series.append(
            Series(
                role=f"set-{place}",
                span_label="slot, Δy/4Q to each side" + words,
                mark_label="resonance, ± 1 sigma of prints" + words,
                rows=tuple(float(c.index) for c in channel_set),
                marks=tuple(c.resonance_hz for c in channel_set),
                spans=tuple(slot_hz(plan, c.resonance_hz) for c in channel_set),
                sigmas=tuple(c.resonance_hz * c.print_spread for c in channel_set),
            )
        )
    low_hz, high_hz = plan.spec.band_hz
    least = min(c.resonance_hz * max(1 - max(half, c.print_spread), 0.05) for c in plan.channels)
    most = max(c.resonance_hz * (1 + max(half, c.print_spread)) for c in plan.channels)
    return Figure(
        title="resonances of the channels, and the slots that keep them apart",
        x=Scale("frequency", "Hz", 0.93 * min(least, low_hz), 1.07 * max(most, high_hz), is_log=True),
        y=Scale("channel", "", -0.6, len(plan.channels) - 0.4),
        series=tuple(series),
        lines=(Line("limit", low_hz, "band asked for"), Line("limit", high_hz)),
        row_labels=tuple((float(c.index), f"{c.index}:  {c.resonance_hz:.1f} Hz") for c in plan.channels),
    )


FIGURES: dict[str, Callable[["Plan"], Figure]] = {"ladder": ladder}
"""The function that makes each figure of a plan, by the figure's name."""

WIDTH_PX = 560
HEIGHT_PX = 46


def svg(figure: Figure, label: str) -> str:
    """Return a figure as one strip of inline SVG: spans, marks and the marks' values along the x axis."""

    def at(value: float) -> float:
        return round((WIDTH_PX - 1) * figure.x.share(value), 1)

    parts = []
    for series in figure.series:
        colour = ROLES[series.role]
        for mark, (first, last) in zip(series.marks, series.spans, strict=True):
            line = at(mark)
            width = round(at(last) - at(first), 1)
            parts += [
                f'<rect x="{at(first)}" y="6" width="{width}" height="20" fill="{colour}" fill-opacity="0.25"/>',
                f'<line x1="{line}" x2="{line}" y1="4" y2="28" stroke="{colour}" stroke-width="2"/>',
                f'<text x="{line}" y="42" font-size="10" text-anchor="middle">{mark:.0f} {figure.x.unit}</text>',
            ]
    for crossing in figure.lines:
        place = at(crossing.at)
        parts.append(
            f'<path d="M{place} 2V30" stroke="{ROLES[crossing.role]}" stroke-dasharray="2 2">'
            f"<title>{escape(crossing.label)}</title></path>"
        )
    return (
        f'<svg role="img" aria-label="{escape(label)}" width="{WIDTH_PX}" height="{HEIGHT_PX}"'
        f' viewBox="-20 0 {WIDTH_PX + 40} {HEIGHT_PX}">{"".join(parts)}</svg>'
    )
