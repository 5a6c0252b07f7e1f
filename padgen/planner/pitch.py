"""Measure how evenly a pad's taxels are spaced: distances between neighbouring rows and columns."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

from padgen.core.errors import number
from padgen.core.finding import Finding
from padgen.planner.plan import Pitch, Plan, Taxel

__all__ = ["judge_pitch", "pitch_of"]

SAME_MM = 0.05
"""Taxels whose places differ by no more belong to one row or column."""
LARGEST_RATIO = 1.2
"""Largest over smallest distance up to which taxels feel evenly spaced."""
HOLE_RATIO = 2.0
"""Largest over smallest distance above which a display has holes."""


def pitch_of(taxels: Sequence[Taxel]) -> Pitch:
    """Return the distances in mm of neighbouring columns and rows, and the share of their crossings with a taxel."""
    columns, rows = (_lines([getattr(t, axis) for t in taxels]) for axis in ("x_mm", "y_mm"))
    x, y = (_steps(lines) for lines in (columns, rows))
    ratio = max((high / low for low, high in (step for step in (x, y) if step)), default=1.0)
    return Pitch(x, y, ratio, len(taxels) / (len(columns) * len(rows)))


def _lines(places_mm: list[float]) -> list[float]:
    lines: list[float] = []
    for place in sorted(places_mm):
        if not lines or place - lines[-1] > SAME_MM:
            lines.append(place)
    return lines


def _steps(lines: list[float]) -> tuple[float, ...]:
    steps = [round(b - a, 3) for a, b in pairwise(lines)]
    return (min(steps), max(steps)) if steps else ()


def judge_pitch(plan: Plan) -> Iterator[Finding]:
    """Yield a note where the pitch is uneven, a warning where a display would have holes."""
    pitch = plan.pitch
    if pitch.ratio > LARGEST_RATIO:
        axes = {"columns": pitch.x_mm, "rows": pitch.y_mm}
        name, (low, high) = max(
            ((name, step) for name, step in axes.items() if step), key=lambda item: item[1][1] / item[1][0]
        )
        yield Finding(
            "warning" if pitch.ratio > HOLE_RATIO else "note",
            "layout.pitch",
            "pad",
            f"{name} of taxels lie {number(low)} to {number(high)} mm apart, a ratio of {number(high / low)};"
            f" up to {LARGEST_RATIO:g} counts as even. Washers hang as near to their coil's axis as their beams allow",
        )
