"""Text tables, times as text, and padgen's style of plots, whose files have the same bytes on every machine."""

import io
from collections.abc import Iterable, Sequence
from itertools import chain, zip_longest
from math import isfinite, isnan
from typing import Any

from padgen.core.errors import number

__all__ = [
    "COLOURS",
    "INK",
    "PALE",
    "Step",
    "channel_colours",
    "plot_bytes",
    "plot_style",
    "seconds_text",
    "span_text",
    "table",
]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a4c2f", "#666666")
"""Colours that colour-blind people, too, tell apart (most of them Okabe and Ito's, Color Universal Design, 2008)."""
MANY = ("#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30")
"""Points of a scale from dark to light (viridis without its palest end) for more channels than `COLOURS` has."""
INK = "#333333"
PALE = "#8a8a8a"
STYLE = {
    "svg.hashsalt": "padgen",
    "svg.fonttype": "path",
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "text.color": INK,
    "axes.edgecolor": PALE,
    "axes.labelcolor": INK,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.1,
    "figure.titlesize": 10,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "xtick.color": INK,
    "ytick.color": INK,
}


class Step(str):
    """A step of work as text for people, with the share (0 … 1) of it that is done."""

    share: float

    def __new__(cls, text: str, share: float) -> "Step":
        """Make a step from its text and share."""
        step = super().__new__(cls, text)
        step.share = share
        return step


def channel_colours(count: int) -> list[str]:
    """Return the colour of each of `count` channels as ``#rrggbb``: the same in every picture and on the page.

    >>> channel_colours(2), channel_colours(9)[-1]
    (['#0072b2', '#d55e00'], '#addc30')
    """
    if count < len(COLOURS):
        return list(COLOURS[:count])
    colours = []
    for index in range(count):
        place = index * (len(MANY) - 1) / (count - 1)
        low = min(int(place), len(MANY) - 2)
        ends = [[int(MANY[k][i : i + 2], 16) for i in (1, 3, 5)] for k in (low, low + 1)]
        mixed = [round(a + (b - a) * (place - low)) for a, b in zip(*ends, strict=True)]
        colours.append("#" + "".join(f"{value:02x}" for value in mixed))
    return colours


def plot_style() -> Any:
    """Return a context in which figures are made in padgen's style, whatever style the user has set."""
    from matplotlib import style

    return style.context(["default", STYLE])


def plot_bytes(figure: Any, kind: str) -> bytes:
    """Return a matplotlib figure as the bytes of an ``svg`` or ``png`` file; its title is in the file's metadata."""
    out = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {"Software": None}
    if figure.get_suptitle():
        metadata["Title"] = figure.get_suptitle()
    with plot_style():
        figure.savefig(out, format=kind, dpi=120, metadata=metadata, facecolor="white")
    return out.getvalue()


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], left: int = 0) -> str:
    """Return a text table of columns under their headings, the first `left` of them flush left, the others right.

    Headings and cells may have several lines; a heading's last one stands right above the rule.

    >>> print(table(["name", "level\\nµm"], [["a\\n b", "1.5"]], left=1))
          level
    name     µm
    ----  -----
    a       1.5
     b
    """
    deep = max(heading.count("\n") for heading in headings)
    cells = [["\n" * (deep - heading.count("\n")) + heading for heading in headings], *rows]
    split = [list(zip_longest(*(cell.split("\n") for cell in row), fillvalue="")) for row in cells]
    widths = [max(len(line[i]) for row in split for line in row) for i in range(len(headings))]
    lines = []
    for line in chain.from_iterable(split):
        sized = enumerate(zip(line, widths, strict=True))
        lines.append("  ".join(cell.ljust(n) if i < left else cell.rjust(n) for i, (cell, n) in sized).rstrip())
    lines.insert(deep + 1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)


def span_text(values: Iterable[float | None], form: str) -> str:
    """Return the range of some numbers as text, one number where both ends are written alike.

    None and not a number are left out; empty where nothing else is there.

    >>> span_text([2.0, None, 1.5], ".2f"), span_text([1.001, 1.002], ".2f"), span_text([], ".1f")
    ('1.50 … 2.00', '1.00', '')
    """
    known = [value for value in values if value is not None and not isnan(value)]
    return " … ".join(dict.fromkeys(f"{end(known):{form}}" for end in (min, max) if known))


def seconds_text(seconds: float) -> str:
    """Return a time in s as text in suitable units, empty if it is not finite.

    >>> seconds_text(3.4e-6), seconds_text(12.34), seconds_text(75), seconds_text(7265)
    ('3.4 µs', '12.3 s', '1 min 15 s', '2 h 01 min')
    """
    if not isfinite(seconds):
        return ""
    if seconds < 60:
        units = (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6))
        unit, size = next((pair for pair in units if seconds >= pair[1]), units[-1])
        return f"{number(float(f'{seconds / size:.3g}'))} {unit}"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
