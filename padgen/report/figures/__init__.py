"""Pictures as data, one file each, found by the file's name; `register` adds others.

A figure is made once of a plan: panels of axes with marks, labels with units, and colours by role. Files (matplotlib,
`padgen.report.charts`), the report page (``page/charts.js``) and notebooks (`padgen.report.inline_svg`) draw the same
data, each in its own style. A figure's file has the names of `FigureKind`.
"""

from base64 import b64encode
from dataclasses import dataclass, fields, is_dataclass, replace
from math import inf, log
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from padgen.core.display import COLOURS, INK, PALE, channel_colours
from padgen.core.registry import FIGURES

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = [
    "MEDIA",
    "ROLES",
    "Bars",
    "Curves",
    "Discs",
    "Facts",
    "Figure",
    "FigureKind",
    "Line",
    "Matrix",
    "Panel",
    "Points",
    "RowLabel",
    "Rows",
    "Scale",
    "Shape",
    "Stems",
    "colour_of",
    "figure_names",
    "figures_of",
    "packed",
    "page_figures",
    "parts_shown_in",
    "plain_figure",
    "register",
    "unregister",
]

ROLES = {
    "set-0": COLOURS[0],
    "set-1": COLOURS[1],
    "limit": PALE,
    "asked": PALE,
    "tone": INK,
    "spur": COLOURS[1],
    "planned": COLOURS[4],
    "retuned": COLOURS[0],
    "right": COLOURS[2],
    "wrong": COLOURS[1],
    "unsure": COLOURS[4],
    "plate": "#ece5d6",
    "groove": INK,
    "hole": "#ffffff",
    "coil": "#f3dfd0",
    "copper": "#cf8a5b",
    **{f"series-{k}": colour for k, colour in enumerate(COLOURS)},
}
"""The colour of each role that something in a figure has; ``channel-3`` has the colour of channel 3 besides."""
MEDIA = ("draw", "page", "sheet", "move", "notebook")
"""The media of a figure: files, the report page, its two sheets of paper, each move of the live page, notebooks."""


@dataclass(frozen=True)
class Scale:
    """An axis: its label, its unit (empty for a count), its range, and whether it is logarithmic.

    `short` stands before a name on the axis where there is little room, and `near` is the part that the page shows.
    """

    label: str
    unit: str
    low: float
    high: float
    is_log: bool = False
    short: str = ""
    near: tuple[float, float] | None = None

    @property
    def title(self) -> str:
        """The label with its unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label

    def share(self, value: float) -> float:
        """Return a value's relative position on the axis, from 0 to 1; a value outside is clipped to an end."""
        inside = min(max(value, self.low), self.high)
        if self.is_log:
            return log(inside / self.low) / log(self.high / self.low)
        return (inside - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Rows:
    """Marks in rows, each with a span around it and one sigma to each side, in the units of the axes.

    `roles` are those of the single marks, where a medium tells them apart; `which` says in words what the series are.
    """

    role: str
    span_label: str
    mark_label: str
    sigma_label: str
    rows: tuple[float, ...]
    marks: tuple[float, ...]
    spans: tuple[tuple[float, float], ...]
    sigmas: tuple[float, ...]
    roles: tuple[str, ...] = ()
    which: str = ""


@dataclass(frozen=True, eq=False)
class Curves:
    """Curves `y` (n, points) over the same `x` (points,); a curve without a label is left out of a file's legend."""

    x: np.ndarray
    y: np.ndarray
    roles: tuple[str, ...]
    labels: tuple[str, ...]
    short_labels: tuple[str, ...]


@dataclass(frozen=True)
class Stems:
    """Lines from the bottom of the panel up to `y`."""

    role: str
    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]


@dataclass(frozen=True)
class Bars:
    """A histogram: `counts` (n,) between `edges` (n + 1,)."""

    role: str
    label: str
    edges: tuple[float, ...]
    counts: tuple[int, ...]


@dataclass(frozen=True)
class Matrix:
    """A square table of values, coloured by the scale `z`; off the diagonal, values below `asked` are framed."""

    label: str
    names: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    z: Scale
    asked: float

    def __post_init__(self) -> None:
        """Raise `ValueError` if the table is not square; a map of coils, which need not be, is made of `Discs`."""
        count = len(self.names)
        if len(self.values) != count or any(len(row) != count for row in self.values):
            raise ValueError(f"a Matrix has a row and a column for each of its {count} names; a map is made of Discs")


@dataclass(frozen=True)
class Discs:
    """Circles of one diameter, to scale, each with a number and, where there is room, a name (see `names_note`).

    With a `depth` they are rectangles of that size along y, and as wide as their diameter.
    All that is to scale has axes of one unit, which are not drawn.
    """

    role: str
    edge_role: str
    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    diameter: float
    numbers: tuple[str, ...]
    names: tuple[str, ...] = ()
    names_note: str = ""
    depth: float | None = None


@dataclass(frozen=True)
class Shape:
    """A closed outline behind a panel's marks: its corners in the units of the axes, a label and a note."""

    role: str
    label: str
    corners: tuple[tuple[float, ...], ...]
    note: str = ""


@dataclass(frozen=True)
class Points:
    """Single points, each in the colour of its role; `symbol` is one of matplotlib's, such as ``o`` or ``X``.

    `legend_role` is that of the mark in the legend, where it is of one colour. Where they are given, `names` say what
    each point is, `hollow` ones are bounds, and those with words in `rings` stand out, ringed.
    """

    label: str
    symbol: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    roles: tuple[str, ...]
    only: tuple[str, ...] = ()
    legend_role: str = "limit"
    names: tuple[str, ...] = ()
    hollow: tuple[bool, ...] = ()
    rings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Line:
    """A line across a panel at one value of its x axis, or of its y axis; without a label legends leave it out.

    `only` names the media that show it, here as in other parts; empty: all.
    """

    role: str
    at: float
    label: str = ""
    axis: str = "x"
    is_dashed: bool = False
    only: tuple[str, ...] = ()


@dataclass(frozen=True)
class RowLabel:
    """The label of the row at `at`: its name, and its value as text."""

    at: float
    name: str
    value: str


@dataclass(frozen=True)
class Panel:
    """Axes with marks of one kind (such as `Rows` or `Curves`), and lines and points over them.

    `height` is its share of the figure's. `shapes` lie behind `Discs`.
    """

    x: Scale
    y: Scale
    marks: tuple[Any, ...] = ()
    lines: tuple[Line, ...] = ()
    points: tuple[Points, ...] = ()
    row_labels: tuple[RowLabel, ...] = ()
    title: str = ""
    legend_title: str = ""
    height: float = 2.4
    only: tuple[str, ...] = ()
    shapes: tuple[Shape, ...] = ()

    def __post_init__(self) -> None:
        kinds = sorted({type(mark).__name__ for mark in self.marks})
        if len(kinds) > 1:
            raise ValueError(f"a panel must have marks of one kind, got {' and '.join(kinds)}")

    @property
    def kind(self) -> str:
        """The class of the panel's marks in lower case, such as ``rows``; ``points`` where it has no marks."""
        return type(self.marks[0]).__name__.lower() if self.marks else "points"


@dataclass(frozen=True)
class Facts:
    """A small table beside a figure on the page, names in its first column; collapsible if `is_folded`."""

    caption: str
    rows: tuple[tuple[str, ...], ...]
    is_folded: bool = False
    is_open: bool = True


@dataclass(frozen=True)
class Figure:
    """A picture as data: its title, description, panels (tables side by side, others stacked), and notes.

    `description` is read to those who do not see it. Where a reader chooses between several, `label` names this one and
    `choice` what is chosen. `notes` stand under it on the page, and `instead` in the place of its panels there.
    `channels` is the number of the plan's channels, which sets the colours of roles such as ``channel-3``.
    """

    title: str
    description: str
    panels: tuple[Panel, ...]
    channels: int = 0
    label: str = ""
    choice: str = "Shown"
    facts: Facts | None = None
    notes: tuple[str, ...] = ()
    instead: str = ""


class FigureKind(Protocol):
    """Interface of a kind of figure, a module or an object with these names; an `ORDER` may set its place in lists."""

    TITLE: str
    """Its heading on the page."""
    CAPTION: str
    """One sentence on the page: what is seen."""
    SHOWN_IN: tuple[str, ...]
    """Some of `MEDIA`."""

    def make(self, plan: "Plan", quick: bool) -> tuple[Figure, ...]:
        """Return a plan's figure, or several to choose from; if `quick`, without what takes long to compute.

        Of several, files and notebooks show the first.
        """


register = FIGURES.register
unregister = FIGURES.unregister


def figure_names(medium: str) -> tuple[str, ...]:
    """Return, in order, the names of the figures that a medium of `MEDIA` shows, such as 'page' or 'notebook'."""
    kinds = {name: FIGURES.get(name) for name in FIGURES.names()}
    shown = (name for name, kind in kinds.items() if medium in kind.SHOWN_IN)
    return tuple(sorted(shown, key=lambda name: getattr(kinds[name], "ORDER", inf)))


def figures_of(plan: "Plan", name: str, medium: str, quick: bool = False) -> tuple[Figure, ...]:
    """Return the figures of the kind `name` with only the parts that `medium` shows; if `quick`, without slow parts.

    `quick` leaves out what takes more than some milliseconds.

    Raises
    ------
    SpecError
        There is no figure of that name; the sentence has the nearest.
    """
    return tuple(parts_shown_in(figure, medium) for figure in FIGURES.get(name).make(plan, quick))


def parts_shown_in(figure: Figure, medium: str) -> Figure:
    """Return a figure without the parts that are for other media only."""

    def kept(parts: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(part for part in parts if not part.only or medium in part.only)

    panels = (replace(panel, lines=kept(panel.lines), points=kept(panel.points)) for panel in kept(figure.panels))
    return replace(figure, panels=tuple(panels))


def colour_of(role: str, channels: int) -> str:
    """Return the colour ``#rrggbb`` of a role, such as 'tone' or 'channel-3', in a figure of `channels` channels."""
    kind, _, index = role.partition("-")
    return channel_colours(channels)[int(index)] if kind == "channel" else ROLES[role]


def page_figures(plan: "Plan", names: tuple[str, ...], quick: bool) -> dict[str, list[dict[str, Any]]]:
    """Return the named figures as plain data for the page, cropped to the ranges that it shows, curves packed."""
    return {name: [plain_figure(figure) for figure in figures_of(plan, name, "page", quick)] for name in names}


def plain_figure(figure: Figure) -> dict[str, Any]:
    """Return a figure as plain data for the page, cropped to the ranges that the page shows."""
    plain: dict[str, Any] = _plain(_near(figure))
    return plain


def _near(figure: Figure) -> Figure:
    """Return a figure cropped to its axes' ranges `near`; one that has a text (`instead`) has no panels."""
    panels = []
    for panel in figure.panels if not figure.instead else ():
        x = _near_scale(panel.x)
        marks = panel.marks
        if panel.kind == "curves":
            marks = tuple(_between(curves, x.low, x.high) for curves in marks)
        if panel.kind == "matrix":
            marks = tuple(replace(matrix, z=_near_scale(matrix.z)) for matrix in marks)
        panels.append(replace(panel, x=x, y=_near_scale(panel.y), marks=marks))
    return replace(figure, panels=tuple(panels))


def _near_scale(scale: Scale) -> Scale:
    if scale.near is None:
        return scale
    low, high = scale.near
    return replace(scale, low=low, high=high, near=None)


def _between(curves: Curves, low: float, high: float) -> Curves:
    """Return curves cropped to `low` … `high` in x, with y rounded to a thousandth, which no screen shows."""
    inside = (curves.x >= low) & (curves.x <= high)
    return replace(curves, x=curves.x[inside], y=curves.y[:, inside].round(3))


def _plain(value: Any) -> Any:
    """Return a part of a figure as dicts, lists, texts and numbers; each part has its `kind`, arrays are `packed`."""
    if isinstance(value, np.ndarray):
        return packed(value)
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    if is_dataclass(value):
        parts = {field.name: _plain(getattr(value, field.name)) for field in fields(value) if field.name != "only"}
        return {"kind": type(value).__name__.lower(), **parts}
    return value


def packed(values: np.ndarray) -> dict[str, str]:
    """Return numbers as base64 text of 32-bit floats, which is short and quick to read."""
    return {"float32": b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()}
