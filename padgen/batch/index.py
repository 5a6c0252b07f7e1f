"""Results of the variants: a journal that is written while they run, and `index.csv`, made from it.

The journal (`index.jsonl`) has one line of JSON a record, each written by one call, so that a crash can tear
the last one only; a torn line is passed over. It is read when it is opened; of each variant only its place in the
journal, its state and 64 bits of its key are held in memory, 17 bytes, however large its record is.
"""

import csv
import json
import os
from array import array
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any

from padgen.batch.definition import Sweep, variant_name
from padgen.batch.pareto import PARETO_FILES, Overview, overview_of
from padgen.batch.variant import STATUSES, Record
from padgen.core.errors import FileError
from padgen.core.files import OutputFolder, json_line, reason

__all__ = ["COLUMNS", "INDEX", "JOURNAL", "Journal", "write_index"]

INDEX, JOURNAL = "index.csv", "index.jsonl"
COLUMNS = (
    ("number", "name", "status"),
    ("errors", "warnings", "findings", "sentence", "seconds", "peak_memory_mb"),
)
"""Before and after the varied fields and the figures; all but the last two are the same in every run."""
NOWHERE, FORGOTTEN = -1, "forgotten"
WASTE = 1000
"""Lines that later ones have replaced which a journal may hold, beyond as many as are in use."""
NAMES = tuple(f.name for f in fields(Record))


class Journal:
    """The records of a folder: the last one of each number; a context manager, open for writing.

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
        self.path, self.numbers = folder / JOURNAL, numbers
        self._offsets = array("q", [NOWHERE]) * numbers
        self._keys = array("Q", [0]) * numbers
        self._states = bytearray(numbers)
        self.lines = self._end = 0

    def __enter__(self) -> "Journal":
        try:
            self._file, self._reader = FileIO(self.path, "a"), self.path.open("rb")
            line = b"\n"
            for line in self._reader:
                found = _parsed(line)
                number = found.number if isinstance(found, Record) else found
                if number is not None and 0 <= number < self.numbers:
                    self._note(number, found if isinstance(found, Record) else None, self._end)
                self.lines += found is not None
                self._end += len(line)
            if not line.endswith(b"\n"):
                self._end += self._file.write(b"\n")
        except OSError as error:
            raise FileError(f"cannot be written ({reason(error)})", str(self.path)) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        self._reader.close()

    def status(self, number: int, key: str = "") -> str:
        """Return the recorded status of a variant with these inputs, empty if there is none."""
        same = self._states[number] and (not key or self._keys[number] == int(key[:16], 16))
        return STATUSES[self._states[number] - 1] if same else ""

    def add(self, record: Record) -> None:
        """Keep a record; the system has it when this returns."""
        table = {name: getattr(record, name) for name in NAMES}
        offset = self._add_line(table | {"sentence": " ".join(record.sentence.split())})
        self._note(record.number, record, offset)

    def record(self, number: int) -> Record:
        """Return the last record of a variant."""
        record = _parsed(self._line(self._offsets[number]))
        if not isinstance(record, Record):
            raise FileError("was changed while the sweep ran", str(self.path))
        return record

    def forget(self, number: int) -> None:
        """Leave a variant out from now on."""
        self._note(number, None, NOWHERE)

    def disown(self, number: int) -> None:
        """Let no later run take what is known of a variant for true, as its folder is about to change."""
        self._add_line({FORGOTTEN: number})
        self.forget(number)

    def records(self) -> Iterator[Record]:
        """Return the last record of each variant, in the order of their numbers."""
        return (self.record(number) for number in range(self.numbers) if self._states[number])

    def refuse_removed(self) -> None:
        """Raise if the journal is not where it was any more: what it holds would be lost."""
        with suppress(OSError):
            if os.path.samestat(os.fstat(self._file.fileno()), self.path.stat()):
                return
        raise FileError("was removed while the sweep ran", str(self.path))

    def compact(self) -> None:
        """Drop the lines that later ones have replaced, when they are many; the last that is done with a journal."""
        if self.lines <= 2 * sum(map(bool, self._states)) + WASTE:
            return
        aside = self.path.with_name(f".{JOURNAL}.aside")
        with suppress(OSError):  # it can wait until there is room
            try:
                with aside.open("wb") as file:
                    file.writelines(self._line(offset) for offset in self._offsets if offset != NOWHERE)
                self.__exit__(None, None, None)  # Windows replaces no open file
                aside.replace(self.path)
            finally:
                aside.unlink(missing_ok=True)

    def _add_line(self, table: dict[str, Any]) -> int:
        """Write a line, by one call that is not buffered, so that a crash can tear the last one only; its offset."""
        offset, data = self._end, (json_line(table) + "\n").encode()
        rest = data
        try:
            while rest:
                # On a disk that is all but full a part goes in, and the error comes with the rest.
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(offset)
            raise FileError(f"cannot be written ({reason(error)})", str(self.path)) from error
        self._end += len(data)
        self.lines += 1
        return offset

    def _line(self, offset: int) -> bytes:
        self._reader.seek(offset)
        return self._reader.readline()

    def _note(self, number: int, record: Record | None, offset: int) -> None:
        self._offsets[number] = offset if record else NOWHERE
        self._keys[number] = int(record.key[:16], 16) if record else 0
        self._states[number] = STATUSES.index(record.status) + 1 if record else 0


def write_index(
    journal: Journal, sweep: Sweep, folder: Path, take: Callable[[Record], None] = lambda record: None
) -> Overview:
    """Write `index.csv`, one row a variant in the order of their numbers; returns its overview.

    The columns of figures are the union of those of all variants, in the order of their first appearance. What was
    made of an earlier index goes. `take` is called with each record.

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
            take(record)
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
    """Read the record of a line, or the number of one that it takes back; None when it is torn or not one of ours."""
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
