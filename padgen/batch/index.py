"""Results of the variants: a journal written while they run, `index.csv` made from it, and the Pareto front.

The journal (`index.jsonl`) has one line of JSON a record, each written by one call, so that a crash can tear
the last one only; a torn line is passed over. It is read when it is opened; of each variant only its place in the
journal, 8 bytes, is held in memory, however large its record is.

The front has the variants that no other one beats: as good in every objective and better in one; equals stay, all of
them. Rows come in one pass: memory holds the front, one block of rows and a thinned rest, however many there are. The
same figures give the same bytes of file and picture.
"""

import csv
import json
import os
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from io import FileIO
from itertools import islice
from math import nan
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from padgen.batch.definition import Sweep
from padgen.batch.variant import STATUSES, VariantRecord
from padgen.core.display import PALE, plot_bytes, plot_style
from padgen.core.errors import FileError
from padgen.core.files import OutputFolder, csv_cell, json_line, open_plain, reason
from padgen.planner.drive_rows import table_csv

__all__ = [
    "BLOCK",
    "COLUMNS",
    "INDEX",
    "JOURNAL",
    "OBJECTIVES",
    "PARETO_FILES",
    "Journal",
    "Objective",
    "Overview",
    "RefusedVariants",
    "front_mask",
    "overview_of",
    "pareto_csv",
    "write_index",
    "write_pareto",
]


class Objective(NamedTuple):
    """A figure by which variants are compared: whether more or less of it is best, and its names in text and plots."""

    best: str
    word: str
    heading: str
    axis: str


OBJECTIVES = {
    "taxels": Objective("most", "taxels", "taxels", "taxels"),
    "verdict_db": Objective("most", "selectivity", "prints keep dB", "ON over OFF that prints keep, dB"),
    "good_pads_retuned": Objective("most", "yield", "good prints", "good prints, re-tuned"),
    "power_w": Objective("least", "power", "copper loss W", "copper loss, W"),
    "print_min": Objective("least", "print time", "print min", "print time, min"),
}
"""By column of the index, where a stage has it."""
UNBOUNDED = frozenset({"verdict_db"})
"""Empty where nothing limits it (one channel a coil has no other to disturb), so that empty is the best."""
PARETO_FILES = ("pareto.csv", "pareto.svg", "pareto.png")
LEFT_OUT = ("status", "sentence", "seconds", "peak_memory_mb")
"""Columns of the index that the front's file does not have: the same for all, or not the same twice."""
BLOCK = CHUNK = 512
MOST_DRAWN = 20_000
"""Points besides the front that are kept for the picture; beyond, every second, fourth, ... one."""
MOST_REFUSED = 3
"""Most reasons for refusals that are told, and most variants that are named with each."""
COLOURED_BY = ("power_w", "verdict_db", "print_min", "good_pads_retuned", "taxels")
"""The first of these that differs among variants tells apart the front's points by colour."""
RATIOS = ("taxels", "power_w", "print_min")
"""Objectives whose axis is logarithmic where the largest is more than `WIDE` times the smallest."""
WIDE = 20.0
PANEL_INCHES = 2.9, 2.3
MOST_VECTORS = 1000
"""Points beyond which the SVG holds them as pixels."""


class RefusedVariants(NamedTuple):
    """Variants that were refused for the same reason: that reason, their number, and the names of the first few.

    `sentence` is theirs, without the details that follow its second colon where they differ in these (not `is_whole`).
    """

    names: tuple[str, ...]
    variants: int
    sentence: str
    is_whole: bool = True


@dataclass(frozen=True)
class Overview:
    """Summary of a sweep's index, with its Pareto front.

    Attributes
    ----------
    header, rows : the index's columns, and its rows on the front in the order of their numbers.
    objectives : those with a value in any row; columns of `values` (front), `beaten`, `short` and `faulty`, not a
        number where a row has none. All but the front are thinned.
    counts : variants by status; `judged` of the made ones by `KINDS`.
    front_of : the kind of variant that the front is of: the first of `KINDS` that there is. `short` and `faulty` are
        the others of these kinds, `beaten` the rest of its own.
    refused : the first few reasons for which variants are refused.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    objectives: tuple[str, ...]
    values: np.ndarray
    beaten: np.ndarray
    short: np.ndarray
    faulty: np.ndarray
    counts: dict[str, int]
    judged: dict[str, int]
    front_of: str
    refused: tuple[RefusedVariants, ...]

    @property
    def points(self) -> np.ndarray:
        """Objective values (points, objectives) of all variants to plot, with those on the Pareto front first."""
        return np.concatenate([self.values, self.beaten, self.short, self.faulty])

    def best(self) -> dict[str, int]:
        """Return, for each objective that differs among variants, the index of the front's best row (first if tied)."""
        if not self.rows:
            return {}
        scores, every = (_scores(values, self.objectives) for values in (self.values, self.points))
        differ = every.min(0) < every.max(0)
        return {name: int(np.argmax(scores[:, i])) for i, name in enumerate(self.objectives) if differ[i]}


def front_mask(scores: np.ndarray) -> np.ndarray:
    """Return a mask (variants,) of the Pareto-optimal rows of `scores` (variants, objectives; more is better).

    Rows are compared in lexicographic order, best first, so that only what is already on the front can
    beat the next: of the order of rows times front, in blocks.
    """
    losses, back = np.unique(-np.asarray(scores, dtype=float), axis=0, return_inverse=True)
    on_front = np.zeros(len(losses), dtype=bool)
    for start in range(0, len(losses), BLOCK):
        block = losses[start : start + BLOCK]
        open_ = np.flatnonzero(_dominator_counts(losses[:start][on_front[:start]], block) == 0)
        # Rows are distinct, so each is as good as itself once.
        on_front[start + open_[_dominator_counts(block[open_], block[open_]) == 1]] = True
    return np.asarray(on_front[back.reshape(-1)])


def _dominator_counts(others: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return for each of `rows` how many of `others` are at least as good in every objective, where less is better."""
    good = np.ones((len(rows), len(others)), dtype=bool)
    for values, other in zip(rows.T, others.T, strict=True):
        good &= other[None, :] <= values[:, None]
    return np.asarray(good.sum(axis=1))


def _scores(values: np.ndarray, objectives: Sequence[str]) -> np.ndarray:
    """Return values signed so that more is better; missing ones are inf for objectives in `UNBOUNDED`, else -inf."""
    signs = [1.0 if OBJECTIVES[name].best == "most" else -1.0 for name in objectives]
    empty = [np.inf if name in UNBOUNDED else -np.inf for name in objectives]
    return np.where(np.isnan(values), empty, values * signs)


class _RunningFront:
    """The Pareto front of one kind of variants, updated by blocks, and a thinned-out rest of that kind to plot."""

    def __init__(self, objectives: Sequence[str]) -> None:
        self.objectives = tuple(objectives)
        self.rows: list[tuple[str, ...]] = []
        self.front = self.rest = np.empty((0, len(objectives)))
        self.stride = 1

    def add(self, pairs: Sequence[tuple[VariantRecord, tuple[str, ...]]]) -> None:
        """Add variants, each as its record and its row of the index, and update the Pareto front."""
        if not pairs:
            return
        figures = [[record.figures.get(name) for name in self.objectives] for record, _ in pairs]
        values = np.array([[v if isinstance(v, (int, float)) else nan for v in row] for row in figures], dtype=float)
        rows = [*self.rows, *(row for _, row in pairs)]
        together = np.concatenate([self.front, values])
        kept = front_mask(_scores(together, self.objectives))
        self.rows = [rows[i] for i in np.flatnonzero(kept)]
        self.front = together[kept]
        self.rest = np.concatenate([self.rest, together[~kept][:: self.stride]])
        while len(self.rest) > MOST_DRAWN:
            self.rest = self.rest[::2]
            self.stride = 2 * self.stride


def overview_of(header: tuple[str, ...], pairs: Iterable[tuple[VariantRecord, tuple[str, ...]]]) -> Overview:
    """Summarise all records in one pass; each comes with its row of the index, whose columns `header` names."""
    names = [name for name in OBJECTIVES if name in header]
    pools = {kind: _RunningFront(names) for kind in KINDS}
    counts: Counter[str] = Counter()
    judged: Counter[str] = Counter()
    refused: dict[str, RefusedVariants] = {}
    left = iter(pairs)
    while chunk := list(islice(left, CHUNK)):
        counts.update(record.status for record, _ in chunk)
        for record, row in chunk:
            if record.status == "refused":
                _add_refusal(refused, row[header.index("name")], record.sentence)
        made = [(_kind(pair[0]), pair) for pair in chunk if pair[0].status == "done"]
        judged.update(kind for kind, _ in made)
        for kind, pool in pools.items():
            pool.add([pair for made_kind, pair in made if made_kind == kind])
    front_of = next((kind for kind in KINDS if pools[kind].rows), KINDS[0])
    front = pools[front_of]
    nothing = np.empty((0, len(names)))
    apart = {
        kind: nothing if kind == front_of else np.concatenate([pools[kind].front, pools[kind].rest])
        for kind in ("short", "faulty")
    }
    has = np.isfinite(np.concatenate([front.front, front.rest, *apart.values()])).any(axis=0)
    return Overview(
        header,
        tuple(front.rows),
        tuple(name for name, some in zip(names, has, strict=True) if some),
        front.front[:, has],
        front.rest[:, has],
        apart["short"][:, has],
        apart["faulty"][:, has],
        dict(counts),
        {kind: judged[kind] for kind in KINDS},
        front_of,
        tuple(refused.values()),
    )


def _add_refusal(refused: dict[str, RefusedVariants], name: str, sentence: str) -> None:
    """Count a refused variant under its reason (`sentence` up to its second ": "); keep only the first few reasons."""
    place, colon, reason_and_details = sentence.partition(": ")
    head = place + colon + reason_and_details.partition(": ")[0]
    before = refused.get(head)
    if before is None:
        if len(refused) < MOST_REFUSED:
            refused[head] = RefusedVariants((name,), 1, sentence)
        return
    is_whole = before.is_whole and before.sentence == sentence
    names = (*before.names, name)[:MOST_REFUSED]
    refused[head] = RefusedVariants(names, before.variants + 1, sentence if is_whole else head, is_whole)


KINDS = ("works", "short", "faulty")
"""Kinds of variants that were made, by their verdicts: only those of the first kind that there is compete."""


def _kind(record: VariantRecord) -> str:
    """Return 'works', 'short' or 'faulty' for a computed variant, by its record's errors and its plan's verdict."""
    level = record.figures.get("verdict")
    if record.errors or level == "error":
        return "faulty"
    return "short" if level == "short" else "works"


def pareto_csv(overview: Overview) -> str:
    """Return the front as CSV: its rows of the index, each with the objectives in which it is best."""
    columns = [i for i, name in enumerate(overview.header) if name not in LEFT_OUT]
    best = overview.best()
    best_in = [" ".join(name for name, which in best.items() if which == k) for k in range(len(overview.rows))]
    rows = [[*(row[i] for i in columns), names] for row, names in zip(overview.rows, best_in, strict=True)]
    return table_csv([*(overview.header[i] for i in columns), "best_in"], rows)


def write_pareto(folder: Path, name: str, overview: Overview) -> tuple[tuple[str, ...], str]:
    """Write the Pareto front of a sweep as CSV, and as SVG and PNG if variants differ in two objectives or more.

    Return the names of the files, and why there is no picture, empty where there is one.

    Raises
    ------
    FileError
        It cannot be written.
    """
    files = {"pareto.csv": pareto_csv(overview).encode()}
    note = ""
    if pictures := _pictures(overview, name):
        files |= dict(zip(PARETO_FILES[1:], pictures, strict=True))
    elif len(overview.rows) + len(overview.beaten) > 1:
        note = "there is no picture of the front, as variants differ in one objective at most"
    with OutputFolder(folder) as out:
        for file_name, data in files.items():
            out.write(file_name, data)
        out.commit(remove=PARETO_FILES)
    return tuple(files), note


def _pictures(overview: Overview, name: str) -> tuple[bytes, bytes] | None:
    """Return plots of the Pareto front as SVG and PNG, or None if variants differ in fewer than two objectives.

    One panel for every two objectives that differ among variants: coloured is the front, grey what it
    beats, a triangle what falls short of what it asks, a cross what does not work. A line joins those that
    none beats in the panel's two alone.
    """
    differ = [i for i, column in enumerate(overview.points.T) if len(np.unique(column[np.isfinite(column)])) > 1]
    if not len(overview.values) or len(differ) < 2:
        return None
    from matplotlib.figure import Figure

    labels = [
        f"{OBJECTIVES[name].axis}\n({'more' if OBJECTIVES[name].best == 'most' else 'less'} is better)"
        for name in overview.objectives
    ]
    title = _title(overview, name)
    shown = _for_plotting(overview)
    hue = min(differ, key=lambda i: COLOURED_BY.index(overview.objectives[i]))
    side = len(differ) - 1
    with plot_style():
        figure = Figure(figsize=(PANEL_INCHES[0] * side + 2.6, PANEL_INCHES[1] * side + 1.2), layout="constrained")
        axes = figure.subplots(side, side, sharex="col", sharey="row", squeeze=False)
        for (i, j), axis in np.ndenumerate(axes):
            axis.set_visible(j <= i)
            if j <= i:
                points = _panel(axis, shown, (differ[j], differ[i + 1]), hue)
        below = [axis.xaxis for axis in axes[-1]]
        beside = [axis.yaxis for axis in axes[:, 0]]
        for axis, objective in zip([*below, *beside], [*differ[:-1], *differ[1:]], strict=True):
            axis.set_label_text(labels[objective])
            if _needs_log_axis(overview, objective):
                axis._set_axes_scale("log")
                axis.set_major_formatter("{x:g}")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right upper", frameon=False)
        figure.colorbar(points, ax=axes, shrink=0.5, format="{x:g}", label=f"colour: {labels[hue]}")
        figure.suptitle(title, x=0.01, ha="left", fontsize=9)
        return plot_bytes(figure, "svg"), plot_bytes(figure, "png")


def _for_plotting(overview: Overview) -> Overview:
    """Return a copy for plotting, in which missing values that mean "unlimited" lie above the largest finite value."""
    parts = {name: getattr(overview, name).copy() for name in ("values", "beaten", "short", "faulty")}
    for i in (overview.objectives.index(name) for name in UNBOUNDED & {*overview.objectives}):
        finite = overview.points[np.isfinite(overview.points[:, i]), i]
        for part in parts.values():
            part[np.isnan(part[:, i]), i] = finite.max() + 0.15 * max(float(np.ptp(finite)), 1.0)
    return replace(overview, **parts)


def _panel(axis: Any, overview: Overview, pair: tuple[int, int], hue: int) -> Any:
    from matplotlib.colors import LogNorm, Normalize

    front = overview.values[:, pair]
    for points, mark, color, label in (
        (overview.beaten[:, pair], "o", "#bdbdbd", "beaten by others"),
        (overview.short[:, pair], "v", "#e0c08a", "falls short"),
        (overview.faulty[:, pair], "x", "#d49a8a", "does not work"),
    ):
        many = len(points) > MOST_VECTORS
        style = {"markersize": 1.5 if many else 3.0, "color": color, "zorder": 1, "rasterized": many}
        axis.plot(*points.T, mark, **style, label=label if len(points) else None)
    finite = np.unique(front[np.isfinite(front).all(axis=1)], axis=0)
    edge: np.ndarray = finite[front_mask(_scores(finite, [overview.objectives[i] for i in pair]))]
    axis.plot(*edge.T, color=PALE, linewidth=0.8, zorder=2, label="best in these two" if len(edge) else None)
    shown = axis.scatter(
        *front.T,
        s=26 if len(front) < 100 else 9,
        c=overview.values[:, hue],
        norm=(LogNorm if _needs_log_axis(overview, hue) else Normalize)(),
        cmap="viridis",
        edgecolors="black",
        linewidths=0.5 if len(front) < 100 else 0.2,
        zorder=3,
        plotnonfinite=True,
        rasterized=len(front) > MOST_VECTORS,
        label=FRONT_LABELS[overview.front_of],
    )
    axis.grid(alpha=0.25)
    column = overview.header.index("number")
    places: dict[tuple[float, ...], list[str]] = {}
    for row in dict.fromkeys(overview.best().values()):
        if np.isfinite(front[row]).all():
            places.setdefault(tuple(front[row].tolist()), []).append(overview.rows[row][column])
    for place, numbers in places.items():
        style = {"xytext": (4, 3), "textcoords": "offset points", "fontsize": 7, "zorder": 4}
        axis.annotate(", ".join(numbers), place, **style, bbox={"color": "white", "alpha": 0.6, "pad": 0.3})
    return shown


FRONT_LABELS = {
    "works": "Pareto front",
    "short": "Pareto front, all fall short",
    "faulty": "Pareto front, none works",
}


def _needs_log_axis(overview: Overview, objective: int) -> bool:
    """Tell whether an objective needs a log axis: it is in `RATIOS`, positive, and its largest / smallest > `WIDE`."""
    finite = overview.points[:, objective]
    finite = finite[np.isfinite(finite)]
    has_ratio = overview.objectives[objective] in RATIOS and finite.size and finite.min() > 0
    return bool(has_ratio and finite.max() > WIDE * finite.min())


def _title(overview: Overview, name: str) -> str:
    front = "1 is" if len(overview.rows) == 1 else f"{len(overview.rows)} are"
    phrases = {"short": "fall short", "faulty": "do not work"}
    others = [f"{overview.judged[kind]} {words}" for kind, words in phrases.items() if overview.judged[kind]]
    rest = f" ({', '.join(others)})" if others else ""
    count = overview.counts.get("done", 0)
    made = "1 variant" if count == 1 else f"{count} variants"
    lines = [
        f"{name}: {made} made{rest}, {front} on the Pareto front",
        "numbers: variants that are best in an objective",
    ]
    for objective, column in zip(overview.objectives, overview.points.T, strict=True):
        if objective in UNBOUNDED and np.isnan(column).any():
            lines.append(f"{OBJECTIVES[objective].axis}: nothing limits it for the farthest")
    return "\n".join(lines)


INDEX = "index.csv"
JOURNAL = "index.jsonl"
COLUMNS = (
    ("number", "name", "status"),
    ("errors", "warnings", "findings", "sentence", "seconds", "peak_memory_mb"),
)
"""Before and after the varied fields and the figures; all but the last two are the same in every run."""
NOWHERE = -1
FORGOTTEN = "forgotten"


class Journal:
    """The file to which a sweep appends each variant's result as it ends; a context manager that opens it for writing.

    Of each variant only the place of its line is held in memory.

    Parameters
    ----------
    folder : Path
        It exists, and nobody else writes there.
    numbers : int
        Variants are numbered below it; records of others are passed over.

    Raises
    ------
    FileError
        On entry or when adding: the journal cannot be read or written, or the disk is full.
    """

    def __init__(self, folder: Path, numbers: int) -> None:
        self.path = folder / JOURNAL
        self._places = array("q", [NOWHERE]) * numbers

    def __enter__(self) -> "Journal":
        place = 0
        line = b"\n"
        try:
            self._file = FileIO(open_plain(self.path, os.O_RDWR | os.O_APPEND), "a")
            self._reader = self.path.open("rb")
            for line in self._reader:
                parsed = _parsed(line)
                number = parsed.number if isinstance(parsed, VariantRecord) else parsed
                if number is not None and 0 <= number < len(self._places):
                    self._places[number] = place if isinstance(parsed, VariantRecord) else NOWHERE
                place += len(line)
            if not line.endswith(b"\n"):
                self._file.write(b"\n")
        except OSError as error:
            raise FileError(f"cannot be written ({reason(error)})", str(self.path)) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        self._reader.close()

    def record(self, number: int) -> VariantRecord | None:
        """Return the last record of a variant, if there is one."""
        if self._places[number] == NOWHERE:
            return None
        self._reader.seek(self._places[number])
        record = _parsed(self._reader.readline())
        if not isinstance(record, VariantRecord):
            raise FileError("was changed while the sweep ran", str(self.path))
        return record

    def records(self) -> Iterator[VariantRecord]:
        """Yield the last record of each variant, in the order of their numbers."""
        return (record for number in range(len(self._places)) if (record := self.record(number)))

    def add(self, record: VariantRecord) -> None:
        """Append a record to the journal's file; the operating system has it when this returns."""
        one_line = replace(record, sentence=" ".join(record.sentence.split()))
        self._places[record.number] = self._write(one_line)

    def forget(self, number: int) -> None:
        """Treat a variant as having no record for the rest of this run; the journal's file is not changed."""
        self._places[number] = NOWHERE

    def invalidate(self, number: int) -> None:
        """Invalidate the record of a variant, also for later runs, as its folder is about to change."""
        self._write({FORGOTTEN: number})
        self.forget(number)

    def refuse_removed(self) -> None:
        """Raise `FileError` if the journal's file was removed or replaced, since its records would be lost."""
        with suppress(OSError):
            if os.path.samestat(os.fstat(self._file.fileno()), self.path.stat()):
                return
        raise FileError("was removed while the sweep ran", str(self.path))

    def _write(self, table: VariantRecord | dict[str, int]) -> int:
        """Append a line unbuffered, so that a crash can damage the last line only; return the line's byte offset."""
        place = self._file.seek(0, os.SEEK_END)
        rest = (json_line(table) + "\n").encode()
        try:
            while rest:
                # On a disk that is all but full a part goes in, and the error comes with the rest.
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(place)
            raise FileError(f"cannot be written ({reason(error)})", str(self.path)) from error
        return place


def write_index(journal: Journal, sweep: Sweep, folder: Path) -> Overview:
    """Write `index.csv`, one row per variant in the order of their numbers, and return its `Overview`.

    The columns of figures are the union of those of all variants, in the order of their first appearance. What was
    made of an earlier index goes.

    Raises
    ------
    FileError
        It cannot be written; the one before stays.
    """
    axes = [name for axis in sweep.axes for name in axis.fields]
    figures = list(dict.fromkeys(name for record in journal.records() for name in record.figures))
    header = (*COLUMNS[0], *axes, *figures, *COLUMNS[1])

    def rows(writer: Any) -> Iterator[tuple[VariantRecord, tuple[str, ...]]]:
        writer.writerow(header)
        for record in journal.records():
            named = {"name": sweep.name_of(record.number), "findings": " ".join(record.findings)}
            before, after = ([named.get(name, getattr(record, name, "")) for name in names] for names in COLUMNS)
            varied = map(record.values.get, axes)
            reached = map(record.figures.get, figures)
            row = tuple(map(csv_cell, (*before, *varied, *reached, *after)))
            writer.writerow(row)
            yield record, row

    with OutputFolder(folder) as out:
        overviews: list[Overview] = []

        def write(path: Path) -> None:
            with path.open("w", encoding="utf-8", newline="") as file:
                overviews.append(overview_of(header, rows(csv.writer(file, lineterminator="\n"))))

        out.write_by(INDEX, write)
        out.commit(remove=PARETO_FILES)
    return overviews[0]


def _parsed(line: bytes) -> VariantRecord | int | None:
    """Parse a journal line into a record, or the number of a variant whose record was invalidated; None if damaged."""
    try:
        table = json.loads(line)
        if isinstance(table.get(FORGOTTEN), int):
            return int(table[FORGOTTEN])
        record = VariantRecord(**{**table, "findings": tuple(table["findings"])})
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    words = (record.key, record.sentence, *record.findings)
    tables = (record.values, record.figures)
    whole = isinstance(record.number, int) and record.status in STATUSES and all(isinstance(t, dict) for t in tables)
    return record if whole and all(isinstance(word, str) for word in words) else None
