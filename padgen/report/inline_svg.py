"""Figures as inline SVG, for notebooks: lists of rows side by side, charts and tables below each other.

It needs no library, and text goes in escaped, so that a name cannot become markup.
"""

from collections.abc import Callable
from html import escape
from math import ceil

from padgen.core.display import INK, PALE
from padgen.report.figures import Bars, Curves, Figure, Panel, Scale, Stems, colour_of

__all__ = ["svg"]

WIDTH_PX = 560
STRIP_PX = 46
CHART_PX = 190
CELL_PX = (56, 22)
LEFT_PX = 52
FOOT_PX = 34


def svg(figure: Figure) -> str:
    """Return a figure as inline SVG, the panels below each other."""
    drawn = [_panel(panel, figure) for panel in figure.panels]
    heights = [height for _, height in drawn]
    tops = [sum(heights[:k]) for k in range(len(heights))]
    parts = [
        text if not top else f'<g transform="translate(0 {top})">{text}</g>'
        for (text, _), top in zip(drawn, tops, strict=True)
    ]
    height = sum(heights)
    return (
        f'<svg role="img" aria-label="{escape(figure.description)}" width="{WIDTH_PX}" height="{height}"'
        f' viewBox="-20 0 {WIDTH_PX + 40} {height}">{"".join(parts)}</svg>'
    )


def _panel(panel: Panel, figure: Figure) -> tuple[str, int]:
    """Return the SVG elements of a panel, and its height in px."""
    if panel.kind == "rows":
        return _strip(panel, figure), STRIP_PX
    if panel.kind == "matrix":
        return _table(panel)
    if panel.kind == "discs":
        return _discs(panel)
    return _chart(panel, figure), CHART_PX


def _strip(panel: Panel, figure: Figure) -> str:
    """Return as SVG a panel that is one strip along the x axis: its spans, its marks, and the value of each mark."""
    at = _places(panel.x, 0.0, WIDTH_PX - 1.0)
    parts = []
    for series in panel.marks:
        colour = colour_of(series.role, figure.channels)
        for mark, (first, last) in zip(series.marks, series.spans, strict=True):
            line = at(mark)
            width = round(at(last) - at(first), 1)
            parts += [
                f'<rect x="{at(first)}" y="6" width="{width}" height="20" fill="{colour}" fill-opacity="0.25"/>',
                f'<line x1="{line}" x2="{line}" y1="4" y2="28" stroke="{colour}" stroke-width="2"/>',
                f'<text x="{line}" y="42" font-size="10" text-anchor="middle">{mark:.0f} {escape(panel.x.unit)}</text>',
            ]
    for crossing in panel.lines:
        place = at(crossing.at)
        parts.append(
            f'<path d="M{place} 2V30" stroke="{colour_of(crossing.role, figure.channels)}" stroke-dasharray="2 2">'
            f"<title>{escape(crossing.label)}</title></path>"
        )
    return "".join(parts)


def _chart(panel: Panel, figure: Figure) -> str:
    """Return as SVG a panel of curves, stems, bars or points over two axes, each with its title and end values."""
    bottom = CHART_PX - FOOT_PX
    x = _places(panel.x, LEFT_PX, WIDTH_PX - 1.0)
    y = _places(panel.y, bottom, 8.0)
    parts = [f'<path d="M{LEFT_PX} 8V{bottom}H{WIDTH_PX - 1}" stroke="{PALE}" fill="none"/>']
    for mark in panel.marks:
        if isinstance(mark, Curves):
            for curve, role in zip(mark.y, mark.roles, strict=True):
                places = " ".join(f"{x(one)},{y(other)}" for one, other in zip(mark.x, curve, strict=True))
                colour = colour_of(role, figure.channels)
                parts.append(f'<polyline points="{places}" stroke="{colour}" stroke-width="1.5" fill="none"/>')
        if isinstance(mark, Stems):
            colour = colour_of(mark.role, figure.channels)
            for one, other in zip(mark.x, mark.y, strict=True):
                parts.append(f'<path d="M{x(one)} {bottom}V{y(other)}" stroke="{colour}" stroke-width="2"/>')
        if isinstance(mark, Bars):
            colour = colour_of(mark.role, figure.channels)
            for first, last, count in zip(mark.edges, mark.edges[1:], mark.counts, strict=False):
                top = y(count)
                size = f'width="{round(x(last) - x(first), 1)}" height="{round(bottom - top, 1)}"'
                parts.append(f'<rect x="{x(first)}" y="{top}" {size} fill="{colour}" fill-opacity="0.7"/>')
    for line in panel.lines:
        path = f"M{x(line.at)} 8V{bottom}" if line.axis == "x" else f"M{LEFT_PX} {y(line.at)}H{WIDTH_PX - 1}"
        colour = colour_of(line.role, figure.channels)
        parts.append(
            f'<path d="{path}" stroke="{colour}" stroke-dasharray="3 3"><title>{escape(line.label)}</title></path>'
        )
    for points in panel.points:
        for one, other, role in zip(points.x, points.y, points.roles, strict=True):
            parts.append(f'<circle cx="{x(one)}" cy="{y(other)}" r="4" fill="{colour_of(role, figure.channels)}"/>')
    middle = (LEFT_PX + WIDTH_PX) / 2
    parts += [
        _text(LEFT_PX, bottom + 13, f"{panel.x.low:.4g}", "start"),
        _text(WIDTH_PX - 1, bottom + 13, f"{panel.x.high:.4g}", "end"),
        _text(LEFT_PX - 4, bottom, f"{panel.y.low:.4g}", "end"),
        _text(LEFT_PX - 4, 17, f"{panel.y.high:.4g}", "end"),
        _text(middle, CHART_PX - 7, panel.x.title),
        f'<g transform="rotate(-90 4 {bottom / 2})">{_text(4, bottom / 2, panel.y.title)}</g>',
    ]
    return "".join(parts)


def _table(panel: Panel) -> tuple[str, int]:
    """Return a table of values with its height in px; what is less than asked is framed."""
    (matrix,) = panel.marks
    wide, high = CELL_PX
    parts = [_text(LEFT_PX, 14, matrix.label, "start")]
    for column, name in enumerate(matrix.names):
        parts.append(_text(LEFT_PX + wide * (column + 0.5), 14 + high, f"{panel.x.short} {name}".strip()))
    for row, (name, values) in enumerate(zip(matrix.names, matrix.values, strict=True)):
        base = 14 + high * (row + 2)
        parts.append(_text(LEFT_PX - 4, base, f"{panel.y.short} {name}".strip(), "end"))
        for column, value in enumerate(values):
            left = LEFT_PX + wide * column
            if row != column and value < matrix.asked:
                box = f'x="{left + 1}" y="{base - 15}" width="{wide - 2}" height="{high - 2}"'
                parts.append(f'<rect {box} fill="none" stroke="{colour_of("spur", 0)}" stroke-width="2"/>')
            parts.append(_text(left + wide / 2, base, "on" if row == column else f"{value:.1f}"))
    return "".join(parts), 14 + high * (len(matrix.names) + 2)


def _discs(panel: Panel) -> tuple[str, int]:
    """Return as SVG a panel's outlines with discs over them, to scale, a number in each; and its height in px."""
    each = (WIDTH_PX - 1.0) / (panel.x.high - panel.x.low)

    def at(x: float, y: float) -> tuple[float, float]:
        return round(each * (x - panel.x.low), 1), round(each * (panel.y.high - y), 1)

    parts = []
    for shape in panel.shapes:
        corners = " ".join(f"{x},{y}" for x, y in (at(*corner) for corner in shape.corners))
        parts.append(f'<polygon points="{corners}" fill="{colour_of(shape.role, 0)}" stroke="{INK}"/>')
    for mark in panel.marks:
        style = f'fill="{colour_of(mark.role, 0)}" stroke="{colour_of(mark.edge_role, 0)}"'
        for x, y, number in zip(mark.x, mark.y, mark.numbers, strict=True):
            across, down = at(x, y)
            wide = each * mark.diameter
            if mark.depth is None:
                parts.append(f'<circle cx="{across}" cy="{down}" r="{round(wide / 2, 1)}" {style}/>')
            else:
                high = each * mark.depth
                corner = f'x="{round(across - wide / 2, 1)}" y="{round(down - high / 2, 1)}"'
                parts.append(f'<rect {corner} width="{round(wide, 1)}" height="{round(high, 1)}" {style}/>')
            parts.append(_text(across, down + 4, number))
    return "".join(parts), ceil(each * (panel.y.high - panel.y.low))


def _text(x: float, y: float, words: str, anchor: str = "middle") -> str:
    return f'<text x="{x}" y="{y}" font-size="10" fill="{INK}" text-anchor="{anchor}">{escape(words)}</text>'


def _places(scale: Scale, first: float, last: float) -> Callable[[float], float]:
    """Return the function that maps a value on an axis to px, from `first` at its low end to `last` at its high."""
    return lambda value: round(first + (last - first) * scale.share(value), 1)
