"""The Pareto front of a sweep: the variants that no other one beats. Read from the index in one pass.

Memory holds the front and one block of rows, however long the index is.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from padgen.batch.figures import OBJECTIVES
from padgen.batch.front import Overview, Told, front_mask, scores_of
from padgen.batch.index import INDEX, PARETO_FILES
from padgen.batch.pareto_picture import front_pictures
from padgen.core.errors import FileError
from padgen.core.files import OutputFolder

__all__ = [
    "INDEX",
    "PARETO_FILES",
    "overview_of",
    "pareto_csv",
    "write_pareto",
]

LEFT_OUT = ("status", "sentence", "seconds", "peak_memory_mb")
"""Columns of the index that the front's file does not have: the same for all, or not the same twice."""
CHUNK = 4096
MOST_DRAWN = 20_000
"""Points besides the front that are kept for the picture; beyond, every second, fourth, ... one."""
MOST_SENTENCES = 10


class _Pool:
    """Points of one kind, taken in block by block: the front so far with its rows, the rest thinned."""

    def __init__(self, objectives: Sequence[str]) -> None:
        self.objectives = tuple(objectives)
        self.rows: list[tuple[str, ...]] = []
        self.front = self.rest = np.empty((0, len(objectives)))
        self.stride = 1

    def add(self, rows: Sequence[tuple[str, ...]], values: np.ndarray) -> None:
        """Take in some rows with their values of the objectives."""
        if not rows:
            return
        both, together = [*self.rows, *rows], np.concatenate([self.front, values])
        kept = front_mask(scores_of(together, self.objectives))
        self.rows, self.front = [both[i] for i in np.flatnonzero(kept)], together[kept]
        self.rest = np.concatenate([self.rest, together[~kept][:: self.stride]])
        while len(self.rest) > MOST_DRAWN:
            self.rest, self.stride = self.rest[::2], 2 * self.stride

    @property
    def all(self) -> np.ndarray:
        return np.concatenate([self.front, self.rest])


def overview_of(lines: Iterable[str]) -> Overview:
    """Go through an index, its lines as `csv` takes them."""
    reader = csv.reader(lines)
    header = tuple(next(reader, ()))
    names = [name for name in OBJECTIVES if name in header]
    clean, faulty = _Pool(names), _Pool(names)
    counts: dict[str, int] = {}
    told: dict[str, list[Told]] = {"refused": [], "failed": []}
    with_errors = 0
    for chunk in _chunks(reader):
        tables = [dict(zip(header, row, strict=False)) for row in chunk]
        for table in tables:
            status = table.get("status", "")
            counts[status] = counts.get(status, 0) + 1
            if len(told.get(status, ())) < MOST_SENTENCES and status in told:
                told[status].append(Told(table.get("name", ""), table.get("sentence", "")))
        values = np.array([[_value(table.get(name)) for name in names] for table in tables]).reshape(len(tables), -1)
        done = np.array([table.get("status") == "done" for table in tables])
        erring = np.array([table.get("errors", "") not in ("", "0") for table in tables])
        for pool, mask in ((clean, done & ~erring), (faulty, done & erring)):
            pool.add([chunk[i] for i in np.flatnonzero(mask)], values[mask])
        with_errors += int((done & erring).sum())
    return _overview(header, clean, faulty, counts, with_errors, told)


def _overview(
    header: tuple[str, ...],
    clean: _Pool,
    faulty: _Pool,
    counts: dict[str, int],
    with_errors: int,
    told: dict[str, list[Told]],
) -> Overview:
    of_faulty = not clean.rows and bool(faulty.rows)
    chosen = faulty if of_faulty else clean
    apart = faulty.all[:0] if of_faulty else faulty.all
    has = np.isfinite(np.concatenate([chosen.all, apart])).any(axis=0)
    return Overview(
        header,
        tuple(chosen.rows),
        tuple(name for name, some in zip(chosen.objectives, has, strict=True) if some),
        chosen.front[:, has],
        chosen.rest[:, has],
        apart[:, has],
        counts,
        with_errors,
        of_faulty,
        tuple(told["refused"]),
        tuple(told["failed"]),
    )


def _chunks(reader: Iterator[list[str]]) -> Iterator[list[tuple[str, ...]]]:
    while chunk := [tuple(row) for row in islice(reader, CHUNK) if row]:
        yield chunk


def _value(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def pareto_csv(overview: Overview) -> str:
    """The front's rows, and what each is best in; the same index gives the same bytes."""
    columns = [i for i, name in enumerate(overview.header) if name not in LEFT_OUT]
    best = overview.best()
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*(overview.header[i] for i in columns), "best_in"])
    for index, row in enumerate(overview.rows):
        best_in = " ".join(name for name, which in best.items() if which == index)
        writer.writerow([*(row[i] for i in columns), best_in])
    return out.getvalue()


def write_pareto(folder: Path, name: str) -> tuple[Overview, tuple[str, ...], str]:
    """Write the front of the index in `folder` beside it; overview, files, and why there is no picture, if so.

    Raises
    ------
    FileError
        The index cannot be read, or the front not be written.
    """
    try:
        with (folder / INDEX).open(newline="", encoding="utf-8") as file:
            overview = overview_of(file)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"cannot be read ({getattr(error, 'strerror', None) or error})", str(folder / INDEX)) from error
    files, note = {"pareto.csv": pareto_csv(overview).encode()}, ""
    pictures = front_pictures(overview, name)
    files |= dict(zip(PARETO_FILES[1:], pictures, strict=True)) if pictures else {}
    if not pictures and len(overview.rows) + len(overview.beaten) > 1:
        note = "there is no picture of the front, as variants differ in one objective at most"
    with OutputFolder(folder) as out:
        for file_name, data in files.items():
            out.write(file_name, data)
        out.commit(remove=PARETO_FILES)
    return overview, tuple(files), note
