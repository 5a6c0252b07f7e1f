"""What came of the variants: a journal that is written while they run, and `index.csv`, made from it.

The journal (`index.jsonl`) has one line of JSON a record, each written by one call, so that a crash can tear
the last one only; a torn line is passed over. Of each variant only its place in the journal, its state
and 64 bits of its key are held in memory, 17 bytes, however large its record is.
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

from padgen.batch.definition import Sweep
from padgen.batch.points import variant_name
from padgen.batch.variant import STATUSES, Record
from padgen.core.errors import FileError
from padgen.core.files import json_line, keep_aside, reason

__all__ = ["COLUMNS", "INDEX", "JOURNAL", "PARETO_FILES", "Journal", "write_index"]

INDEX, JOURNAL = "index.csv", "index.jsonl"
PARETO_FILES = ("pareto.csv", "pareto.svg", "pareto.png")
"""Made from the index."""
COLUMNS = (
    ("number", "name", "status"),
    ("errors", "warnings", "findings", "sentence", "seconds", "peak_memory_mb"),
)
"""Before and after the varied fields and the figures; all but the last two are the same in every run."""
NOWHERE, FORGOTTEN = -1, "forgotten"
WASTE = 1000
"""Lines that later ones have replaced which a journal may hold, beyond as many as are in use."""


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
        self.path = folder / JOURNAL
        self._offsets = array("q", [NOWHERE]) * numbers
        self._keys = array("Q", [0]) * numbers
        self._states = bytearray(numbers)
        self.lines, self._end = 0, 0
        self._file: FileIO | None = None

    def __enter__(self) -> "Journal":
        try:
            index = self.path.with_name(INDEX)
            if index.is_file() and not self.path.exists():
                keep_aside(index)  # it is of no sweep
            self._scan()
            self.path.touch()
            self._file = FileIO(self.path, "r+")
            self._end = self._file.seek(0, os.SEEK_END)
            if self._end and self._block(self._end - 1) != b"\n":
                self._append(b"\n")
        except OSError as error:
            raise _unwritable(self.path, error) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file:
            self._file.close()

    def status(self, number: int, key: str) -> str:
        """What came of a variant with these inputs, empty when that is not known."""
        return self._state(number) if self._keys[number] == _short(key) else ""

    @property
    def numbers(self) -> int:
        """Variants are numbered below it."""
        return len(self._states)

    def numbers_of(self, status: str) -> Iterator[int]:
        """The variants with a status."""
        return (number for number in range(self.numbers) if self._state(number) == status)

    def known(self, number: int) -> bool:
        """Whether there is any record of a variant."""
        return self._offsets[number] != NOWHERE

    def add(self, record: Record) -> None:
        """Keep a record; the system has it when this returns."""
        table = {name: getattr(record, name) for name in NAMES}
        offset = self._add_line(table | {"sentence": " ".join(record.sentence.split())})
        self._note(record.number, record.key, record.status, offset)

    def record(self, number: int) -> Record:
        """The last record of a variant that is known."""
        return self._read(self._offsets[number])

    def forget(self, number: int) -> None:
        """Leave a variant out from now on."""
        self._offsets[number], self._states[number] = NOWHERE, 0

    def disown(self, number: int) -> None:
        """Let no later run take what is known of a variant for true, as its folder is about to change."""
        self._add_line({FORGOTTEN: number})
        self.forget(number)

    def records(self) -> Iterator[Record]:
        """The last record of each variant, in the order of their numbers."""
        return (self._read(offset) for offset in self._offsets if offset != NOWHERE)

    def refuse_removed(self) -> None:
        """Raise if the journal is not where it was any more: what it holds would be lost."""
        try:
            same = os.path.samestat(os.fstat(self._stream.fileno()), self.path.stat())
        except OSError:
            same = False
        if not same:
            raise FileError("was removed while the sweep ran", str(self.path))

    def compact(self) -> None:
        """Drop the lines that later ones have replaced, when they are many."""
        used = sum(offset != NOWHERE for offset in self._offsets)
        if self.lines > 2 * used + WASTE:
            with suppress(OSError):  # it can wait until there is room
                _replaced(self.path, self._write_used)

    def _write_used(self, path: Path) -> None:
        """Write what is in use; the journal is closed then."""
        with path.open("wb") as file:
            for offset in self._offsets:
                if offset != NOWHERE:
                    file.write(self._line(offset))
        self._stream.close()

    def _add_line(self, table: dict[str, Any]) -> int:
        """Write a line; its offset."""
        offset = self._end
        try:
            self._append((json_line(table) + "\n").encode())
        except OSError as error:
            with suppress(OSError):
                self._stream.truncate(offset)
            raise _unwritable(self.path, error) from error
        self.lines += 1
        return offset

    def _scan(self) -> None:
        if not self.path.exists():
            return
        offset = 0
        with self.path.open("rb") as file:
            for line in file:
                record = _parsed(line)
                if record:
                    self.lines += 1
                    if 0 <= record.number < len(self._offsets):
                        self._note(record.number, record.key, record.status, offset)
                elif 0 <= (gone := _forgotten(line)) < len(self._offsets):
                    self.lines += 1
                    self.forget(gone)
                offset += len(line)

    def _note(self, number: int, key: str, status: str, offset: int) -> None:
        self._offsets[number], self._keys[number] = offset, _short(key)
        self._states[number] = STATUSES.index(status) + 1

    def _state(self, number: int) -> str:
        return STATUSES[self._states[number] - 1] if self._states[number] else ""

    @property
    def _stream(self) -> FileIO:
        assert self._file, "the journal is open"
        return self._file

    def _append(self, data: bytes) -> None:
        """One call, so that a crash leaves the line whole or torn at the very end; not buffered."""
        self._stream.seek(self._end)
        rest = data
        while rest:
            # On a disk that is all but full a part goes in, and the error comes with the rest.
            rest = rest[self._stream.write(rest) :]
        self._end += len(data)

    def _block(self, offset: int) -> bytes:
        self._stream.seek(offset)
        return self._stream.read(BLOCK)

    def _line(self, offset: int) -> bytes:
        parts = []
        while True:
            part = self._block(offset)
            head, newline, _ = part.partition(b"\n")
            parts.append(head)
            if newline or not part:
                return b"".join(parts) + b"\n"
            offset += len(part)

    def _read(self, offset: int) -> Record:
        record = _parsed(self._line(offset))
        if record is None:
            raise FileError("was changed while the sweep ran", str(self.path))
        return record


BLOCK = 4096


def write_index(journal: Journal, sweep: Sweep, folder: Path) -> Path:
    """Write `index.csv`, one row a variant in the order of their numbers; returns its path.

    The columns of figures are the union of those of all variants, in the order of their first appearance.

    Raises
    ------
    FileError
        It cannot be written; the one before stays.
    """
    path = folder / INDEX
    axes = [name for axis in sweep.axes for name in axis.fields]
    figures = list(dict.fromkeys(name for shape in _shapes(journal) for name in shape))

    def write(aside: Path) -> None:
        with aside.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow([*COLUMNS[0], *axes, *figures, *COLUMNS[1]])
            rows.writerows(_row(sweep, record, axes, figures) for record in journal.records())

    try:
        _replaced(path, write)
    except OSError as error:
        raise _unwritable(path, error) from error
    return path


def _shapes(journal: Journal) -> Iterator[tuple[str, ...]]:
    """The distinct sets of figures, in the order of the numbers."""
    seen: set[tuple[str, ...]] = set()
    for record in journal.records():
        shape = tuple(record.figures)
        if shape not in seen:
            seen.add(shape)
            yield shape


def _row(sweep: Sweep, record: Record, axes: list[str], figures: list[str]) -> list[str]:
    own = {"name": variant_name(sweep, record.number), "findings": " ".join(record.findings)}
    before, after = (
        [_cell(own[name] if name in own else getattr(record, name)) for name in names] for names in COLUMNS
    )
    varied = [_cell(record.values.get(name)) for name in axes]
    return [*before, *varied, *(_cell(record.figures.get(name)) for name in figures), *after]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.10g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _replaced(path: Path, write: Callable[[Path], None]) -> None:
    """Let `write` write aside, then put that in the place of `path`."""
    aside = path.with_name(f".{path.name}.aside")
    try:
        write(aside)
        aside.replace(path)
    except BaseException:
        with suppress(OSError):
            aside.unlink(missing_ok=True)
        raise


def _parsed(line: bytes) -> Record | None:
    """The record of a line, None when it is torn or not one of ours."""
    try:
        table = json.loads(line)
        record = Record(**{**table, "findings": tuple(table["findings"])})
    except (ValueError, TypeError, KeyError, RecursionError):
        return None
    tables = isinstance(record.values, dict) and isinstance(record.figures, dict)
    words = all(isinstance(word, str) for word in (record.key, record.sentence, *record.findings))
    whole = isinstance(record.number, int) and record.status in STATUSES and tables and words
    return record if whole and set(table) == set(NAMES) else None


def _forgotten(line: bytes) -> int:
    """The number of a line that takes a record back, -1 when it is none."""
    if not line.startswith(b'{"' + FORGOTTEN.encode()):
        return -1
    try:
        number = json.loads(line)[FORGOTTEN]
    except (ValueError, TypeError, KeyError, RecursionError):
        return -1
    return number if isinstance(number, int) else -1


NAMES = tuple(f.name for f in fields(Record))


def _short(key: str) -> int:
    try:
        return int(key[:16], 16)
    except ValueError:
        return 0


def _unwritable(path: Path, error: OSError) -> FileError:
    return FileError(f"cannot be written ({reason(error)})", str(path))
