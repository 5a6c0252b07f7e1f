"""Text tables, run times and plots for people: the same figures give the same bytes on every machine."""

import io
from collections.abc import Iterable, Sequence
from math import isfinite, isnan
from typing import Any

from padgen.core.errors import number

__all__ = ["STYLE", "plot_bytes", "seconds_text", "span_text", "table"]

STYLE = {"svg.hashsalt": "padgen", "svg.fonttype": "path", "font.size": 9, "font.family": "DejaVu Sans"}


def plot_bytes(figure: Any, kind: str) -> bytes:
    """Return a matplotlib figure as the bytes of an ``svg`` or ``png`` file."""
    out = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {"Software": None}
    figure.savefig(out, format=kind, dpi=120, metadata=metadata, facecolor="white")
    return out.getvalue()


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], left: int = 0) -> str:
    """Return a text table of columns under their headings, the first `left` of them flush left, the others right."""
    cells = [tuple(headings), *rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(headings))]
    lines = []
    for row in cells:
        sized = enumerate(zip(row, widths, strict=True))
        lines.append("  ".join(cell.ljust(n) if i < left else cell.rjust(n) for i, (cell, n) in sized).rstrip())
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)


def span_text(values: Iterable[float | None], form: str) -> str:
    """Return the smallest and the largest of some numbers as text, one where they are written alike.

    None and not a number are left out; empty where nothing else is there.

    >>> span_text([2.0, None, 1.5], ".2f"), span_text([1.001, 1.002], ".2f"), span_text([], ".1f")
    ('1.50 … 2.00', '1.00', '')
    """
    known = [value for value in values if value is not None and not isnan(value)]
    return " … ".join(dict.fromkeys(f"{end(known):{form}}" for end in (min, max) if known))


def seconds_text(seconds: float) -> str:
    """Return a time as text in the units that suit it, empty where there is none.

    >>> seconds_text(3.4e-6), seconds_text(12.34), seconds_text(75), seconds_text(7265)
    ('3.4 µs', '12.3 s', '1 min 15 s', '2 h 01 min')
    """
    if not isfinite(seconds):
        return ""
    if seconds < 60:
        unit, size = ("s", 1.0) if seconds >= 1 else ("ms", 1e-3) if seconds >= 1e-3 else ("µs", 1e-6)
        return f"{number(float(f'{seconds / size:.3g}'))} {unit}"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
