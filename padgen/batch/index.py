"""Results of the variants: a journal written while they run, `index.csv` made from it, and the Pareto front.

The journal (`index.jsonl`) has one line of JSON a record, each written by one call, so that a crash can tear
the last one only; a torn line is passed over. It is read when it is opened; of each variant only its place in the
journal, its state and 64 bits of its key are held in memory, 17 bytes, however large its record is.

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
from dataclasses import dataclass, fields
from io import FileIO
from itertools import islice
from math import nan
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from padgen.batch.definition import Sweep, variant_name
from padgen.batch.variant import STATUSES, Record
from padgen.core.display import COLOURS, PALE, plot_bytes, plot_style
from padgen.core.errors import FileError
from padgen.core.files import OutputFolder, json_line, reason
from padgen.planner.drive_rows import table_csv

__all__ = [
    "COLUMNS",
    "INDEX",
    "JOURNAL",
    "OBJECTIVES",
    "PARETO_FILES",
    "Journal",
    "Objective",
    "Overview",
    "front_mask",
    "overview_of",
    "pareto_csv",
    "write_index",
    "write_pareto",
]


class Objective(NamedTuple):
    """One objective of a front: whether the most or the least of it is best, and its word, heading and axis label."""

    best: str
    word: str
    heading: str
    axis: str


OBJECTIVES = {
    "taxels": Objective("most", "taxels", "taxels", "taxels"),
    "selectivity_db": Objective("most", "selectivity", "selectivity dB", "selectivity, dB"),
    "good_pads_retuned": Objective("most", "yield", "good prints", "good prints, re-tuned"),
    "power_w": Objective("least", "power", "copper loss W", "copper loss, W"),
    "print_min": Objective("least", "print time", "print min", "print time, min"),
}
"""By column of the index, where a stage has it."""
UNBOUNDED = frozenset({"selectivity_db"})
"""Empty where nothing limits it (one channel a coil has no other to disturb), so that empty is the best."""
PARETO_FILES = ("pareto.csv", "pareto.svg", "pareto.png")
LEFT_OUT = ("status", "sentence", "seconds", "peak_memory_mb")
"""Columns of the index that the front's file does not have: the same for all, or not the same twice."""
CHUNK = 512
MOST_DRAWN = 2000
"""Points besides the front that are kept for the picture; beyond, every second, fourth, ... one."""
MOST_REFUSED = 3
PANEL_INCHES = 3.6, 3.2


@dataclass(frozen=True)
class Overview:
    """Summary of a sweep's index, with its Pareto front.

    Attributes
    ----------
    header, rows : the index's columns, and its rows on the front in the order of their numbers.
    objectives : those with a value in any row; columns of `values` (front) and `others` (beaten, or made with error
        findings; thinned), not a number where a row has none.
    counts : variants by status; `with_errors` of the made ones have error findings.
    of_faulty : the front is of variants with error findings, since there is none without.
    refused : name and sentence of the first few.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    objectives: tuple[str, ...]
    values: np.ndarray
    others: np.ndarray
    counts: dict[str, int]
    with_errors: int
    of_faulty: bool
    refused: tuple[tuple[str, str], ...]

    def best(self) -> dict[str, int]:
        """Return by objective in which variants differ the row of the front that is best in it; of equals the first."""
        if not self.rows:
            return {}
        scores, others = (_scores(values, self.objectives) for values in (self.values, self.others))
        differ = np.ptp(np.concatenate([scores, others]), axis=0) != 0
        return {name: int(np.argmax(scores[:, i])) for i, name in enumerate(self.objectives) if differ[i]}


def front_mask(scores: np.ndarray) -> np.ndarray:
    """Tell which rows of `scores` (variants, objectives; more is better) no other row beats."""
    beaten = [((scores >= row).all(axis=1) & (scores > row).any(axis=1)).any() for row in scores]
    return ~np.array(beaten, dtype=bool)


def _scores(values: np.ndarray, objectives: Sequence[str]) -> np.ndarray:
    """Return values with a sign that makes more better, and infinities where there are none."""
    signs = [1.0 if OBJECTIVES[name].best == "most" else -1.0 for name in objectives]
    empty = [np.inf if name in UNBOUNDED else -np.inf for name in objectives]
    return np.where(np.isnan(values), empty, values * signs)


class _Pool:
    """Points of one kind, taken in block by block: the front so far with its rows, the rest thinned."""

    def __init__(self, objectives: Sequence[str]) -> None:
        self.objectives = tuple(objectives)
        self.rows: list[tuple[str, ...]] = []
        self.front = self.rest = np.empty((0, len(objectives)))
        self.stride = 1

    def add(self, pairs: Sequence[tuple[Record, tuple[str, ...]]]) -> None:
        """Take in some records with their rows."""
        if not pairs:
            return
        figures = [[record.figures.get(name) for name in self.objectives] for record, _ in pairs]
        values = np.array([[v if isinstance(v, (int, float)) else nan for v in row] for row in figures], dtype=float)
        rows, together = [*self.rows, *(row for _, row in pairs)], np.concatenate([self.front, values])
        kept = front_mask(_scores(together, self.objectives))
        self.rows, self.front = [rows[i] for i in np.flatnonzero(kept)], together[kept]
        self.rest = np.concatenate([self.rest, together[~kept][:: self.stride]])
        while len(self.rest) > MOST_DRAWN:
            self.rest, self.stride = self.rest[::2], 2 * self.stride


def overview_of(header: tuple[str, ...], pairs: Iterable[tuple[Record, tuple[str, ...]]]) -> Overview:
    """Go once through records with their rows of the index, whose columns `header` names."""
    names = [name for name in OBJECTIVES if name in header]
    clean, faulty = _Pool(names), _Pool(names)
    counts: Counter[str] = Counter()
    refused: list[tuple[str, str]] = []
    with_errors = 0
    left = iter(pairs)
    while chunk := list(islice(left, CHUNK)):
        counts.update(record.status for record, _ in chunk)
        told = [(row[header.index("name")], record.sentence) for record, row in chunk if record.status == "refused"]
        refused += told[: MOST_REFUSED - len(refused)]
        clean.add([pair for pair in chunk if pair[0].status == "done" and not pair[0].errors])
        erring = [pair for pair in chunk if pair[0].status == "done" and pair[0].errors]
        faulty.add(erring)
        with_errors += len(erring)
    of_faulty = not clean.rows and bool(faulty.rows)
    front = faulty if of_faulty else clean
    others = np.concatenate([front.rest, *(() if of_faulty else (faulty.front, faulty.rest))])
    has = np.isfinite(np.concatenate([front.front, others])).any(axis=0)
    return Overview(
        header,
        tuple(front.rows),
        tuple(name for name, some in zip(names, has, strict=True) if some),
        front.front[:, has],
        others[:, has],
        dict(counts),
        with_errors,
        of_faulty,
        tuple(refused),
    )


def pareto_csv(overview: Overview) -> str:
    """Return the front as CSV: its rows of the index, each with the objectives in which it is best."""
    columns, best = [i for i, name in enumerate(overview.header) if name not in LEFT_OUT], overview.best()
    best_in = [" ".join(name for name, which in best.items() if which == k) for k in range(len(overview.rows))]
    rows = [[*(row[i] for i in columns), told] for row, told in zip(overview.rows, best_in, strict=True)]
    return table_csv([*(overview.header[i] for i in columns), "best_in"], rows)


def write_pareto(folder: Path, name: str, overview: Overview) -> tuple[str, ...]:
    """Write the front of a sweep beside its index, with a picture if two objectives differ; return the files' names.

    Raises
    ------
    FileError
        It cannot be written.
    """
    files = {"pareto.csv": pareto_csv(overview).encode(), **_pictures(overview, name)}
    with OutputFolder(folder) as out:
        for file_name, data in files.items():
            out.write(file_name, data)
        out.commit(remove=PARETO_FILES)
    return tuple(files)


def _pictures(overview: Overview, name: str) -> dict[str, bytes]:
    """Draw the front over all that it beats: one objective against each other one that differs, if any does.

    Numbered are variants that are best in an objective.
    """
    values = np.concatenate([overview.values, overview.others])
    differ = [i for i, column in enumerate(values.T) if len(np.unique(column[np.isfinite(column)])) > 1]
    if len(differ) < 2:
        return {}
    from matplotlib.figure import Figure

    height, *widths = sorted(differ, key=lambda i: overview.objectives[i] != "selectivity_db")
    numbers = {overview.rows[row][overview.header.index("number")]: row for row in overview.best().values()}
    with plot_style():
        figure = Figure(figsize=(PANEL_INCHES[0] * len(widths), PANEL_INCHES[1]), layout="constrained")
        for axis, width in zip(figure.subplots(1, len(widths), sharey=True, squeeze=False)[0], widths, strict=True):
            axis.plot(*overview.others[:, (width, height)].T, "o", markersize=3, color=PALE, alpha=0.4, rasterized=True)
            axis.plot(*overview.values[:, (width, height)].T, "o", markersize=5, color=COLOURS[0])
            for number, row in numbers.items():
                place = overview.values[row, (width, height)]
                if np.isfinite(place).all():
                    axis.annotate(number, place, xytext=(4, 3), textcoords="offset points", fontsize=7)
            axis.set_xlabel(OBJECTIVES[overview.objectives[width]].axis)
            axis.grid(alpha=0.25)
        figure.axes[0].set_ylabel(OBJECTIVES[overview.objectives[height]].axis)
        told = f"{name}: {len(overview.rows)} of {overview.counts['done']} variants are on the Pareto front"
        figure.suptitle(told + ", all with error findings" * overview.of_faulty)
        return {f"pareto.{kind}": plot_bytes(figure, kind) for kind in ("svg", "png")}


INDEX, JOURNAL = "index.csv", "index.jsonl"
COLUMNS = (
    ("number", "name", "status"),
    ("errors", "warnings", "findings", "sentence", "seconds", "peak_memory_mb"),
)
"""Before and after the varied fields and the figures; all but the last two are the same in every run."""
NOWHERE, FORGOTTEN = -1, "forgotten"
NAMES = tuple(f.name for f in fields(Record))


class Journal:
    """The records of a folder: the last one of each number; a context manager, open for writing.

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
        place, line = 0, b"\n"
        try:
            self._file, self._reader = FileIO(self.path, "a"), self.path.open("rb")
            for line in self._reader:
                found = _parsed(line)
                number = found.number if isinstance(found, Record) else found
                if number is not None and 0 <= number < len(self._places):
                    self._places[number] = place if isinstance(found, Record) else NOWHERE
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

    def record(self, number: int) -> Record | None:
        """Return the last record of a variant, if there is one."""
        if self._places[number] == NOWHERE:
            return None
        self._reader.seek(self._places[number])
        record = _parsed(self._reader.readline())
        if not isinstance(record, Record):
            raise FileError("was changed while the sweep ran", str(self.path))
        return record

    def records(self) -> Iterator[Record]:
        """Yield the last record of each variant, in the order of their numbers."""
        return (record for number in range(len(self._places)) if (record := self.record(number)))

    def add(self, record: Record) -> None:
        """Keep a record; the system has it when this returns."""
        table = {name: getattr(record, name) for name in NAMES}
        self._places[record.number] = self._write(table | {"sentence": " ".join(record.sentence.split())})

    def forget(self, number: int) -> None:
        """Leave a variant out from now on."""
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

    def _write(self, table: dict[str, Any]) -> int:
        """Write a line, by one call that is not buffered, so that a crash can tear the last one only; its place."""
        place, rest = self._file.seek(0, os.SEEK_END), (json_line(table) + "\n").encode()
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
    """Write `index.csv`, one row a variant in the order of their numbers; returns its overview.

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

    def rows(writer: Any) -> Iterator[tuple[Record, tuple[str, ...]]]:
        writer.writerow(header)
        for record in journal.records():
            own = {"name": variant_name(sweep, record.number), "findings": " ".join(record.findings)}
            before, after = ([own.get(name, getattr(record, name, "")) for name in names] for names in COLUMNS)
            varied, reached = map(record.values.get, axes), map(record.figures.get, figures)
            row = tuple(map(_cell, (*before, *varied, *reached, *after)))
            writer.writerow(row)
            yield record, row

    with OutputFolder(folder) as out:
        found: list[Overview] = []

        def write(path: Path) -> None:
            with path.open("w", encoding="utf-8", newline="") as file:
                found.append(overview_of(header, rows(csv.writer(file, lineterminator="\n"))))

        out.write_by(INDEX, write)
        out.commit(remove=PARETO_FILES)
    return found[0]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.10g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _parsed(line: bytes) -> Record | int | None:
    """Return the record in a line, or the number of an invalidated one; None where the line holds neither."""
    try:
        table = json.loads(line)
        if isinstance(table.get(FORGOTTEN), int):
            return int(table[FORGOTTEN])
        record = Record(**{**table, "findings": tuple(table["findings"])})
        words = [
            int(record.key[:16], 16) >= 0,
            *(isinstance(word, str) for word in (record.sentence, *record.findings)),
        ]
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    tables = isinstance(record.values, dict) and isinstance(record.figures, dict)
    whole = isinstance(record.number, int) and record.status in STATUSES and tables and all(words)
    return record if whole else None
