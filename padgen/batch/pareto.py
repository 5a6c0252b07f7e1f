"""The Pareto front of a sweep: the variants that no other one beats. Read from the index in one pass.

A variant beats another if it is as good in every objective and better in one; equals stay, all of them.
Memory holds the front and one block of rows, however long the index is.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from padgen.batch.figures import OBJECTIVES
from padgen.batch.index import INDEX, PARETO_FILES
from padgen.core.errors import FileError
from padgen.core.files import OutputFolder

__all__ = [
    "INDEX",
    "PARETO_FILES",
    "Overview",
    "front_mask",
    "overview_of",
    "pareto_csv",
    "scores_of",
    "write_pareto",
]

UNBOUNDED = frozenset({"selectivity_db"})
"""Empty where nothing limits it (one channel a coil has no other to disturb), so that empty is the best."""
LEFT_OUT = ("status", "sentence", "seconds", "peak_memory_mb")
"""Columns of the index that the front's file does not have: the same for all, or not the same twice."""
BLOCK = 512
CHUNK = 4096
MOST_DRAWN = 20_000
"""Points besides the front that are kept for the picture; beyond, every second, fourth, ... one."""
MOST_SENTENCES = 10


class Told(NamedTuple):
    """A variant that was not made, and why."""

    name: str
    sentence: str


@dataclass(frozen=True)
class Overview:
    """What a sweep's index holds, and its front.

    Attributes
    ----------
    header, rows : the index's columns, and its rows on the front in the order of their numbers.
    objectives : those with a value in any row; columns of `values` (front), `beaten` and `faulty`, not a
        number where a row has none. `beaten` and `faulty` (made, with error findings) are thinned.
    counts : variants by status; `with_errors` of the made ones have error findings.
    of_faulty : the front is of variants with error findings, since there is none without.
    refused, failed : the first few of each.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    objectives: tuple[str, ...]
    values: np.ndarray
    beaten: np.ndarray
    faulty: np.ndarray
    counts: dict[str, int]
    with_errors: int
    of_faulty: bool
    refused: tuple[Told, ...]
    failed: tuple[Told, ...]

    @property
    def made(self) -> int:
        """Variants that were made, whatever their findings."""
        return self.counts.get("done", 0)

    def best(self) -> dict[str, int]:
        """By objective in which variants differ, the row of the front that is best in it; of equals the first."""
        if not len(self.values):
            return {}
        scores = scores_of(self.values, self.objectives)
        every = scores_of(np.concatenate([self.values, self.beaten, self.faulty]), self.objectives)
        differ = every.min(0) < every.max(0)
        return {name: int(np.argmax(scores[:, i])) for i, name in enumerate(self.objectives) if differ[i]}


def front_mask(scores: np.ndarray) -> np.ndarray:
    """Which rows of `scores` (variants, objectives; more is better) no other row beats.

    Rows are compared in lexicographic order, best first, so that only what is already on the front can
    beat the next: of the order of rows times front, in blocks.
    """
    losses, back = np.unique(-np.asarray(scores, dtype=float), axis=0, return_inverse=True)
    on_front = np.zeros(len(losses), dtype=bool)
    for start in range(0, len(losses), BLOCK):
        block = losses[start : start + BLOCK]
        open_ = np.flatnonzero(_as_good(losses[:start][on_front[:start]], block) == 0)
        # Rows are distinct, so each is as good as itself once.
        on_front[start + open_[_as_good(block[open_], block[open_]) == 1]] = True
    kept: np.ndarray = on_front[back.reshape(-1)]
    return kept


def _as_good(others: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """For each of `rows`, how many of `others` lose no more in any objective."""
    good = np.ones((len(rows), len(others)), dtype=bool)
    for own, other in zip(rows.T, others.T, strict=True):
        good &= other[None, :] <= own[:, None]
    count: np.ndarray = good.sum(axis=1)
    return count


def scores_of(values: np.ndarray, objectives: Sequence[str]) -> np.ndarray:
    """Values with a sign that makes more better, and infinities where there are none."""
    signs = [1.0 if OBJECTIVES[name].best == "most" else -1.0 for name in objectives]
    empty = [np.inf if name in UNBOUNDED else -np.inf for name in objectives]
    scores = values * np.array(signs)
    return np.where(np.isnan(scores), np.array(empty), scores)


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
    from padgen.batch.pareto_picture import front_pictures

    pictures = front_pictures(overview, name)
    files |= dict(zip(PARETO_FILES[1:], pictures, strict=True)) if pictures else {}
    if not pictures and len(overview.rows) + len(overview.beaten) > 1:
        note = "there is no picture of the front, as variants differ in one objective at most"
    with OutputFolder(folder) as out:
        for file_name, data in files.items():
            out.write(file_name, data)
        out.commit(remove=PARETO_FILES)
    return overview, tuple(files), note
