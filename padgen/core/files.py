"""Write a folder's files all at once or, if killed, not at all; format JSON and CSV; read files up to a size limit.

`OutputFolder` collects the files of one run in a hidden folder aside. `commit` puts a journal into the folder, moves
the files in one by one, and removes the journal, which commits the change; the replaced files lie aside until then.
Whoever is about to write, finds a journal and gets the folder's lock, which a living process would hold, puts
everything back with the journal (`recover`). A kill while files are put back does no harm, since the next process
continues from there.

A folder may be a stranger's. So only a journal with the seal of this user (`core/seal.py`) for this very folder is
followed, no link is followed on the way to a file that is moved, and nothing that reads ever writes: a reader that
meets a journal waits for a living process (`wait_for_commit`), and otherwise says what restores the folder. Several
files of a folder are read as one state of it by `read_as_one`.

``manifest.json`` lists padgen's files with their hashes. A listed file that still has its hash is padgen's and may be
removed and replaced. Any other file is the user's: it is never removed, and is kept as ``NAME.old`` where an output
takes its name.

Each system call that changes the disk is a function of `os` (those of `Path` call them), so that a test can simulate
another disk by replacing them. Locks on files are the operating system's, which releases them when the process ends in
any way.
"""

import json
import os
import re
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, is_dataclass, replace
from errno import EDQUOT, EIO, ENOSPC, ENOTDIR, EPERM
from functools import partial
from hashlib import file_digest, sha256
from itertools import count, takewhile
from math import isfinite
from pathlib import Path
from shlex import quote
from threading import Thread
from types import TracebackType
from typing import Any, TypeVar

from padgen import __version__
from padgen.core.errors import FileError
from padgen.core.seal import is_sealed, seal_of

__all__ = [
    "LOCK",
    "MANIFEST",
    "PARTIAL",
    "YIELD_FILE",
    "OutputFolder",
    "answer_within",
    "built_files",
    "csv_cell",
    "differs",
    "is_current",
    "is_unchanged",
    "json_line",
    "json_text",
    "lock_file",
    "locked",
    "open_plain",
    "read_as_one",
    "read_bounded",
    "read_manifest",
    "reason",
    "recover",
    "remove_own_files",
    "sha256_hex",
    "unlock_file",
    "wait_for_commit",
    "write_synced",
]

T = TypeVar("T")
LOOK_S = 0.02
"""Seconds between two attempts to get a lock."""
LOCKED_BYTE = 1 << 30
"""Byte that Windows locks, beyond the file's content, since other processes cannot read a locked byte."""


@contextmanager
def locked(path: Path, patience_s: float) -> Iterator[bool | None]:
    """Hold the lock file `path` during the block; after `patience_s` without the lock, continue all the same.

    Yields True with the lock, False where another process kept it for `patience_s`, and None where the file system has
    no locks; nobody is then kept out. The file exists as long as the lock is held.
    """
    file = -1
    has_lock = None
    end = time.monotonic() + patience_s
    try:
        with suppress(OSError):
            while (file := lock_file(path)) < 0 and time.monotonic() < end:
                time.sleep(LOOK_S)
            has_lock = file >= 0
        yield has_lock
    finally:
        if file >= 0:
            unlock_file(path, file)


def open_plain(path: Path, flags: int) -> int:
    """Open an ordinary file for writing, created if missing, and return its descriptor; refuse links.

    Raises
    ------
    OSError
        It cannot be opened, or it is a link, a folder, a pipe or a device.
    """
    with suppress(FileNotFoundError):
        kind = path.lstat().st_mode
        if not stat.S_ISREG(kind):
            cause = "it is a link" if stat.S_ISLNK(kind) else "it is no ordinary file"
            raise OSError(EPERM, cause, str(path))
    file = os.open(path, flags | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0), 0o644)
    if os.fstat(file).st_nlink > 1:
        os.close(file)
        raise OSError(EPERM, "it is a link to a file that has other names", str(path))
    return file


def lock_file(path: Path) -> int:
    """Create and lock a file; return its open descriptor, or -1 where another process has the lock.

    Raises
    ------
    OSError
        The file cannot be made, or the file system has no locks.
    """
    file = open_plain(path, os.O_RDWR)
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(file, LOCKED_BYTE, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(file).st_ino == path.stat().st_ino:
            return file
    except (BlockingIOError, PermissionError, FileNotFoundError):  # locked by another, or removed just now
        pass
    except BaseException:
        os.close(file)
        raise
    os.close(file)
    return -1


def unlock_file(path: Path, file: int) -> None:
    """Release a lock of `lock_file`, and remove its file."""
    steps: list[Callable[[], object]] = [path.unlink, partial(os.close, file)]
    if sys.platform == "win32":  # which keeps files that are open, such as one that another process has locked
        steps.reverse()
    else:
        import fcntl

        # Closing alone would leave the lock with processes forked meanwhile.
        steps.insert(1, partial(fcntl.flock, file, fcntl.LOCK_UN))
    for step in steps:
        with suppress(OSError):
            step()


PARTIAL = ".partial-"
JOURNAL = ".padgen.journal"
LOCK = ".padgen.lock"
MANIFEST = "manifest.json"
REPLACED = ".replaced"
"""Name, in the folder aside, of the folder with padgen's own replaced and removed files."""
ASIDE = re.compile(re.escape(PARTIAL) + "([0-9]{1,99})(?:-[0-9]{1,99})?", re.ASCII)
"""The name of a folder aside: the process's number, and in versions after 0.2 the change's."""
MOST_ATTEMPTS = 100
_own_asides: set[str] = set()
"""Absolute paths of the folders aside that are in use in this process."""
_aside_numbers = count(1)
PATIENCE_S = 10.0
"""Longest wait in s for another process's commit, which takes milliseconds."""
GLANCE_S = 0.1
"""Longest wait in s for a commit of which nothing tells that its process lives; one on another machine may."""
MOST_JSON = 1_000_000
"""Largest manifest or journal in bytes; the largest pad's have a hundredth of this."""
PLAIN_NAME = re.compile(r"\w[\w.-]{0,254}", re.ASCII)
HASH = re.compile("[0-9a-f]{64}")
SMALLEST = 1e-12
"""Smallest result that files tell from zero, in the unit of its name; the smallest that means something, a motion per
newton of modes that were not solved, is a thousand times larger."""
BAD_DISK = (EIO, ENOSPC, EDQUOT)


@dataclass(frozen=True, slots=True)
class _Moves:
    """The files that one commit moves into, out of and within a folder, by name.

    `new` files, with their hashes, come from the folder `aside`. `away` are padgen's own files that go there. `kept`
    are users' files, each with its new name. `seal` is of all this and of the folder, empty where there is no secret.
    """

    aside: str
    new: dict[str, str]
    away: list[str]
    kept: dict[str, str]
    seal: str = ""

    def names(self) -> set[str]:
        """Return the names of all files that are moved."""
        return {*self.new, *self.away, *self.kept, *self.kept.values()}

    def sealed_text(self, path: Path) -> bytes:
        """Return the bytes that a seal signs: the moves and the folder's identity, so that a copied journal fails."""
        place = [os.path.realpath(path), path.stat().st_ino, (path / self.aside).lstat().st_ino]
        return json.dumps([self.aside, self.new, self.away, self.kept, place], sort_keys=True).encode()


@dataclass(frozen=True, slots=True)
class _Folder:
    """An open folder with operations on files by plain name, which follow no link on the way.

    `file` is its descriptor, None where the system has none of folders.
    """

    path: Path
    file: int | None

    def at(self, name: str) -> str | Path:
        """Return the path of `name` to pass to an `os` function along with the folder's descriptor as `dir_fd`."""
        return self.path / name if self.file is None else name

    def has(self, name: str) -> bool:
        """Return whether there is a file, folder or link of this name."""
        try:
            os.stat(self.at(name), dir_fd=self.file, follow_symlinks=False)
        except FileNotFoundError:
            return False
        return True

    def move(self, name: str, to: "_Folder", new: str | None = None) -> None:
        """Move a file to the folder `to`, under its own or a `new` name."""
        os.replace(self.at(name), to.at(new or name), src_dir_fd=self.file, dst_dir_fd=to.file)

    def remove(self, name: str) -> None:
        """Remove a file."""
        os.unlink(self.at(name), dir_fd=self.file)

    def sync(self) -> None:
        """Wait until the names in the folder are on the disk, where the system can do this."""
        if self.file is None:
            return
        try:
            os.fsync(self.file)
        except OSError as error:
            if error.errno in BAD_DISK:
                raise


HAS_HANDLES = hasattr(os, "O_DIRECTORY") and {os.open, os.stat, os.rename, os.unlink} <= os.supports_dir_fd


@contextmanager
def _opened(path: Path, within: _Folder | None = None) -> Iterator[_Folder]:
    """Open a folder for the block; a folder `within` another open one must not be a link.

    Raises
    ------
    OSError
        It is not there, or is no folder.
    """
    if within is not None and not stat.S_ISDIR(path.lstat().st_mode):
        raise NotADirectoryError(ENOTDIR, os.strerror(ENOTDIR), str(path))
    if not HAS_HANDLES:
        yield _Folder(path, None)
        return
    if within is None:
        file = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    else:
        file = os.open(path.name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=within.file)
    try:
        yield _Folder(path, file)
    finally:
        with suppress(OSError):
            os.close(file)


def _move_all(path: Path, moves: _Moves) -> None:
    """Carry out all `moves` in a folder locked by `_locked_folder`; after an error, move all files back."""
    with _opened(path) as folder, _opened(path / moves.aside, folder) as aside:
        (aside.path / REPLACED).mkdir()
        with _opened(aside.path / REPLACED, aside) as replaced:
            sealed = replace(moves, seal=seal_of(moves.sealed_text(path)))
            write_synced(aside.path / JOURNAL, json.dumps(asdict(sealed)).encode())
            try:
                aside.move(JOURNAL, folder)
                folder.sync()
                for name in moves.away:
                    folder.move(name, replaced)
                for name, there in moves.kept.items():
                    folder.move(name, folder, there)
                for name in moves.new:
                    aside.move(name, folder)
                folder.sync()
                folder.remove(JOURNAL)
            except BaseException:
                if folder.has(JOURNAL) and not aside.has(JOURNAL):
                    _move_back(folder, aside, replaced, moves)
                raise


def _move_back(folder: _Folder, aside: _Folder, replaced: _Folder, moves: _Moves) -> None:
    """Undo each completed move; rename a user's file that has meanwhile taken the name of a file to move back."""
    lie = {name: (replaced, name) for name in moves.away}
    lie |= {name: (folder, there) for name, there in moves.kept.items()}
    for name in moves.new | lie:
        place = folder.path / name
        old = lie.get(name)
        if old is not None and not old[0].has(old[1]):
            continue  # it was never moved, or is back already
        if folder.has(name):
            if not aside.has(name) and _has_hash(place, moves.new.get(name, "")):
                folder.move(name, aside)
            elif old is not None:
                there = _free_name(place)
                folder.move(name, folder, there.name)
                _say_kept(place, there)
        if old is not None:
            old[0].move(old[1], folder, name)
    folder.sync()
    folder.remove(JOURNAL)


@contextmanager
def _locked_folder(path: Path) -> Iterator[None]:
    """Lock a folder for the block, after undoing the unfinished commit of a killed process.

    Raises
    ------
    FileError
        Another process holds the folder, or there is a commit that cannot be undone or is not this user's.
    """
    with locked(path / LOCK, PATIENCE_S) as has_lock:
        moves = _read_journal(path)
        # Without locks, the process number in the folder's name decides.
        if has_lock is False or (has_lock is None and moves and _is_in_use(path / moves.aside)):
            raise FileError("another process is writing into it; try again when that has ended", str(path))
        if moves:
            try:
                _restore(path, moves)
            except OSError as error:
                sentence = f"a killed run left it half-written, and it cannot be restored ({reason(error)})"
                raise FileError(sentence, str(path)) from error
            _remove_aside(path / moves.aside)
        yield


def _restore(path: Path, moves: _Moves) -> None:
    """Undo an unfinished commit; raise FileError unless this user's padgen made it in this folder.

    Raises
    ------
    FileError
        It is not.
    OSError
        The files cannot be moved.
    """
    if not _is_own(path, moves):
        old = path / moves.aside / REPLACED
        raise FileError(
            f"says that {path} is half-written, and was not written here by this user's padgen; nothing is changed:"
            f" take what you need from {old}, if that is there, and remove {JOURNAL}",
            str(path / JOURNAL),
        )
    with (
        _opened(path) as folder,
        _opened(path / moves.aside, folder) as aside,
        _opened(aside.path / REPLACED, aside) as replaced,
    ):
        _move_back(folder, aside, replaced, moves)


def _is_own(path: Path, moves: _Moves) -> bool:
    """Return whether a journal was written for this folder by padgen as run by this user; otherwise do not trust it.

    Raises
    ------
    OSError
        The secret cannot be read.
    """
    try:
        text = moves.sealed_text(path)
    except OSError:  # it has no folder aside
        return False
    return is_sealed(text, moves.seal)


def recover(path: Path) -> bool:
    """Undo a killed process's unfinished commit in a folder about to be written; return whether there was one.

    Raises
    ------
    FileError
        As `_locked_folder`.
    """
    is_torn = _read_journal(path) is not None
    if is_torn:
        with _locked_folder(path):
            pass
    return is_torn


def wait_for_commit(folder: Path, name: str) -> None:
    """Wait until no commit is moving file `name` of a folder; call this before reading the file.

    Nothing is written.

    Raises
    ------
    FileError
        The commit does not end: its process was killed, or it is a stranger's. The sentence says what to do.
    """
    start = time.monotonic()
    while (moves := _read_journal(folder)) and name.casefold() in map(str.casefold, moves.names()):
        is_own = False
        with suppress(OSError):
            is_own = _is_own(folder, moves)
        is_going_on = is_own and _is_in_use(folder / moves.aside)
        if time.monotonic() - start > (PATIENCE_S if is_going_on else GLANCE_S):
            if is_going_on:
                cause = "another process is writing it; try again when that has ended"
            elif is_own:
                cause = f"a killed run left its folder half-written; padgen restore {quote(str(folder))} puts that back"
            else:
                cause = (
                    f"its folder is half-written, as {JOURNAL} says, which this user's padgen did not write there;"
                    f" remove {JOURNAL} to read the folder as it is"
                )
            raise FileError(cause, str(folder / name))
        time.sleep(LOOK_S)


def read_as_one(folder: Path, read: Callable[[], T], name: str = MANIFEST) -> T:
    """Call `read`, and call it again if a commit changed the folder's files meanwhile; return the consistent result.

    `name` is the only file that it reads; without it, all that every commit moves.

    Raises
    ------
    FileError
        As `wait_for_commit`, or commits come faster than the files are read.
    """
    for _ in range(MOST_ATTEMPTS):
        wait_for_commit(folder, name)
        before = _commit_stamp(folder)
        try:
            content = read()
        except FileError:
            if _commit_stamp(folder) == before:
                raise
        else:
            if _commit_stamp(folder) == before:
                return content
    raise FileError("other processes write into it faster than it can be read; try again", str(folder))


def _commit_stamp(folder: Path) -> tuple[object, ...]:
    """Return values that every commit changes: whether a journal exists; the manifest's inode, time and size."""
    try:
        manifest = (folder / MANIFEST).lstat()
    except (OSError, ValueError):
        return (os.path.lexists(folder / JOURNAL),)
    return os.path.lexists(folder / JOURNAL), manifest.st_ino, manifest.st_mtime_ns, manifest.st_size


def _drop_partial(path: Path) -> None:
    """Remove half-written files of killed processes from a folder."""
    left = [left for left in path.glob(f"{PARTIAL}*") if not _is_in_use(left)]
    if left:
        with _locked_folder(path):
            for folder in left:
                _remove_aside(folder)
    elif os.path.lexists(path / LOCK):
        with locked(path / LOCK, 0):  # which removes the file that a killed process left
            pass


def _make_aside(path: Path) -> Path:
    """Make a new temporary folder of this process in `path`, with missing parents, and return its path.

    Its name is one process's and one change's, so that neither processes nor threads share it.
    """
    for attempt in count(1):
        aside = path / f"{PARTIAL}{os.getpid()}-{next(_aside_numbers)}"
        _own_asides.add(os.path.abspath(aside))  # noqa: PTH100
        try:
            aside.mkdir(parents=True)
            return aside
        except OSError as error:
            _own_asides.discard(os.path.abspath(aside))  # noqa: PTH100
            # A stranger's file has the name, or another run that failed has just removed the folder that it had made.
            passes = isinstance(error, FileNotFoundError) or os.path.lexists(aside)
            if not passes or attempt == MOST_ATTEMPTS:
                raise
    raise AssertionError


def _remove_aside(folder: Path) -> None:
    """Remove a temporary folder with its files, as far as this succeeds; errors are ignored."""
    with suppress(OSError):  # closing the folder may fail even with ignore_errors
        shutil.rmtree(folder, ignore_errors=True)


def _read_journal(path: Path) -> _Moves | None:
    """Return the file moves of the unfinished commit that a folder's journal records, None without a valid journal."""
    try:
        moves = _Moves(**_read_json_table(path / JOURNAL))
        texts = all(map(PLAIN_NAME.fullmatch, moves.names())) and all(map(HASH.fullmatch, moves.new.values()))
        return moves if texts and _process(moves.aside) and isinstance(moves.seal, str) else None
    except (TypeError, AttributeError):  # it is of another shape
        return None


def _read_json_table(file: Path) -> dict[str, Any]:
    """Return the table in a small JSON file, empty where there is no such file or table."""
    try:
        if file.is_symlink() or not file.is_file() or file.stat().st_size > MOST_JSON:
            return {}
        table = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return table if isinstance(table, dict) else {}


def _has_hash(path: Path, known: str) -> bool:
    """Return whether `path` is a file, not a link, with this hash."""
    try:
        if path.is_symlink() or not path.is_file():
            return False
        with path.open("rb") as file:
            return file_digest(file, "sha256").hexdigest() == known
    except OSError:
        return False


def _free_name(path: Path) -> Path:
    """Return a free name for a user's file: its name with .old, .old2, ... appended."""
    names = (path.with_name(f"{path.name}.old{number if number > 1 else ''}") for number in count(1))
    return next(name for name in names if not os.path.lexists(name))


def _say_kept(path: Path, there: Path) -> None:
    """Log a warning that a user's file was renamed, since an output file takes its name."""
    import logging

    logging.getLogger("padgen").warning("padgen: %s is not padgen's or was changed; kept as %s", path, there.name)


def write_synced(path: Path, data: bytes | bytearray) -> None:
    """Write a file, and wait until it is on the disk."""
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0), 0o666)
    try:
        left = memoryview(data)
        while left:
            left = left[os.write(file, left) :]
        os.fsync(file)
    finally:
        os.close(file)


def _process(aside: str) -> int:
    """Return the process id in the name of a temporary folder, 0 where it has none."""
    match = ASIDE.fullmatch(aside)
    return int(match[1]) if match else 0


def _is_in_use(aside: Path) -> bool:
    """Return whether the process in a temporary folder's name may still write; True if it names none."""
    import psutil

    process = _process(aside.name)
    if process == os.getpid():
        return os.path.abspath(aside) in _own_asides  # noqa: PTH100 # else an earlier process had this number
    try:
        return not process or psutil.pid_exists(process)
    except OverflowError:
        return False


PLAN = "plan.json"
YIELD_FILE = "yield.json"
SPEC = "spec"
MEASURED_FILES = ("tuning.json", "measured.csv", "printed.json")
"""Files with measurements of a print; they stay when the plan changes, while the rest of the old plan's files go."""
READ_BYTES = 1 << 16
LONGEST_PIPE_S = 10.0
"""Longest time in s for reading a pipe to its end."""


def json_text(table: Any) -> str:
    """Return data as JSON text for a file: floats with ten digits, in full inside `spec`; null for NaN and infinity.

    An entry called `spec` is input, not a result: its numbers are written in full, so that they read back unchanged.
    Takes plain data and dataclasses; other values become text.
    """
    return _escaped(json.dumps(_plain_data(table), indent=1, ensure_ascii=False)) + "\n"


def json_line(table: Any) -> str:
    """Return data as JSON on one line, for streams and journals, with numbers as in `json_text`."""
    return _escaped(json.dumps(_plain_data(table), ensure_ascii=False))


def csv_cell(value: Any) -> str:
    """Return a value as a cell's text: floats with ten digits, empty for None, NaN and infinity.

    >>> csv_cell(1 / 3), csv_cell(float("inf")), csv_cell([50, 200]), csv_cell(True), csv_cell(-1e-17)
    ('0.3333333333', '', '[50, 200]', 'true', '0')
    """
    if isinstance(value, float) and isfinite(value):
        return f"{_rounded(value):.10g}"
    if value is None or isinstance(value, float):
        return ""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _rounded(value: float) -> float:
    """Round a finite number as written to files: to ten significant digits, and to 0 below `SMALLEST`.

    Ten digits agree between platforms. Smaller figures do not, since they are what rounding leaves of zero.
    """
    return float(f"{value:.10g}") if abs(value) >= SMALLEST else 0.0


def _escaped(text: str) -> str:
    """Escape lone surrogates in JSON, which names of files may contain but UTF-8 text cannot."""
    return text.encode(errors="backslashreplace").decode()


def _plain_data(value: Any, in_full: bool = False) -> Any:
    """Return a value as JSON data (dicts, lists, text, numbers), floats to ten digits or, if `in_full`, unrounded."""
    if isinstance(value, float):
        if not isfinite(value):
            return None
        return value if in_full else _rounded(value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, (list, tuple)):
        return [_plain_data(entry, in_full) for entry in value]
    if is_dataclass(value):
        value = {name: getattr(value, name) for name in value.__dataclass_fields__}
    if isinstance(value, dict):
        return {str(key): _plain_data(entry, in_full or key == SPEC) for key, entry in value.items()}
    return _plain_data(value.item()) if hasattr(value, "item") else str(value)


def sha256_hex(data: bytes | bytearray) -> str:
    """Return the SHA-256 of bytes, in hexadecimal."""
    return sha256(data).hexdigest()


class OutputFolder:
    """A folder whose files change all at once; a context manager.

    Parameters
    ----------
    path : Path
        The folder; made with its parents when it is not there.

    Raises
    ------
    FileError
        On entry or when writing: the folder cannot be made or written to, or the disk is full.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._aside = path
        self._made: list[Path] = []
        self._hashes: dict[str, str] = {}

    def __enter__(self) -> "OutputFolder":
        try:
            self._made = list(takewhile(lambda path: not path.exists(), (self.path, *self.path.parents)))
            recover(self.path)
            _drop_partial(self.path)
            self._aside = _make_aside(self.path)
        except OSError as error:
            raise FileError(f"cannot be written to ({reason(error)})", str(self.path)) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        moves = _read_journal(self.path)
        if not moves or moves.aside != self._aside.name:  # else its files are needed to undo the commit
            _remove_aside(self._aside)
        _own_asides.discard(os.path.abspath(self._aside))  # noqa: PTH100
        if kind is not None:
            with suppress(OSError):
                for folder in self._made:
                    folder.rmdir()
        if isinstance(error, OSError):
            raise FileError(f"cannot be written ({reason(error)})", str(self.path)) from error

    def write(self, name: str, data: bytes | bytearray | str) -> Path:
        """Write a file into the temporary folder, and return its path there, for reading back."""
        raw = data.encode() if isinstance(data, str) else data
        write_synced(self._aside / name, raw)
        self._hashes[name] = sha256_hex(raw)
        return self._aside / name

    def write_by(self, name: str, writer: Callable[[Path], None]) -> Path:
        """Add a file that `writer` writes to the path it is given; return that path, for reading back."""
        path = self._aside / name
        writer(path)
        with path.open("r+b") as file:  # writable, since Windows syncs no other files
            self._hashes[name] = file_digest(file, "sha256").hexdigest()
            os.fsync(file)
        return path

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the added files."""
        return tuple(self._hashes)

    def commit(self, built_from: dict[str, Any] | None = None, remove: Iterable[str] = ()) -> list[str]:
        """Move all added files and a new manifest into the folder; return names of built files now out of date.

        A changed plan removes the files that came of the old one, except `MEASURED_FILES` and those of an earlier
        build, which the next build removes. Only unchanged files of padgen are removed.

        Parameters
        ----------
        built_from : dict, optional
            The inputs of a build, for `is_current`; given where these files are a build's.
        remove : iterable of str
            Names of other files that are out of date.

        Raises
        ------
        FileError
            A folder has the name of a file, or another process is writing; nothing was moved.
        """
        with _locked_folder(self.path):
            before = read_manifest(self.path)
            known = before.get("files", {})
            built = before.get("built", [])
            for name in (*self._hashes, MANIFEST):
                if (self.path / name).is_dir() and not (self.path / name).is_symlink():
                    raise FileError("cannot be written (a folder has its name)", str(self.path / name))
            other_plan = PLAN in known and known[PLAN] != self._hashes.get(PLAN, known[PLAN])
            stale = {*remove, *(built if built_from is not None else ())}
            if other_plan:
                stale |= known.keys() - {*MEASURED_FILES, *built}
            stale &= known.keys() - self._hashes.keys()
            away = [name for name in stale if _has_hash(self.path / name, known[name])]
            kept = {}
            rest = {name: known[name] for name in known.keys() - away if os.path.lexists(self.path / name)}
            manifest: dict[str, Any] = {"padgen": __version__, "files": dict(sorted({**rest, **self._hashes}.items()))}
            left = [name for name in built if manifest["files"].get(name) == known[name]]
            if built_from is not None:
                manifest |= {"inputs": built_from, "built": sorted(self._hashes)}
            elif left:
                manifest["built"] = left
                if left == built and "inputs" in before:
                    manifest["inputs"] = before["inputs"]
            text = json_text(manifest).encode()
            write_synced(self._aside / MANIFEST, text)
            new = {**self._hashes, MANIFEST: sha256_hex(text)}
            for name, digest in new.items():
                path = self.path / name
                hashes = {digest, known.get(name)}
                ours = before if name == MANIFEST else any(_has_hash(path, each) for each in hashes if each)
                if ours:
                    away.append(name)
                elif os.path.lexists(path):
                    kept[name] = _free_name(path).name
            _move_all(self.path, _Moves(self._aside.name, new, away, kept))
            for name, there in kept.items():
                _say_kept(self.path / name, self.path / there)
        return [name for name in built if name in rest and name not in self._hashes] if other_plan else []


def read_manifest(path: Path) -> dict[str, Any]:
    """Return the manifest in a folder, empty where there is no valid one of padgen.

    A valid one holds plain names of files, each with a hash.

    Raises
    ------
    FileError
        As `wait_for_commit`.
    """
    wait_for_commit(path, MANIFEST)
    manifest = _read_json_table(path / MANIFEST)
    try:
        files = manifest["files"]
        # Before version 0.2 only builds wrote manifests.
        built = manifest.setdefault("built", list(files) if "inputs" in manifest else [])
        plain = all(PLAIN_NAME.fullmatch(name) and HASH.fullmatch(known) for name, known in files.items())
        listed = isinstance(built, list) and all(name in files for name in built)
    except (TypeError, KeyError, AttributeError):  # it is not padgen's
        return {}
    return manifest if plain and listed and MANIFEST not in map(str.lower, files) else {}


def built_files(path: Path) -> list[str]:
    """Return the names of the files of a folder's last build, without those replaced since."""
    return list(read_manifest(path).get("built", []))


def is_unchanged(path: Path, name: str) -> bool:
    """Return whether padgen wrote this file of a folder and nobody has changed it since."""
    known = read_manifest(path).get("files", {})
    return name in known and _has_hash(path / name, known[name])


def remove_own_files(path: Path) -> None:
    """Remove padgen's unchanged files from a folder, and the folder if it is then empty."""
    if path.is_symlink():  # it is not padgen that has made this
        return
    with suppress(OSError, FileError):
        _drop_partial(path)
        with _locked_folder(path):
            files = read_manifest(path).get("files")
            if files is not None:
                aside = _make_aside(path)
                try:
                    ours = [name for name, known in files.items() if _has_hash(path / name, known)]
                    _move_all(path, _Moves(aside.name, {}, [*ours, MANIFEST], {}))
                    _remove_aside(aside)
                finally:
                    _own_asides.discard(os.path.abspath(aside))  # noqa: PTH100
        path.rmdir()


def differs(path: Path, name: str, text: str) -> bool:
    """Return whether a folder has a file of this name with another text."""
    wait_for_commit(path, name)
    file = path / name
    data = text.encode()
    try:
        if not file.is_file():
            return False
        return file.stat().st_size != len(data) or _read_at_most(file, len(data) + 1, len(data) + 1) != data
    except OSError:
        return False


def is_current(path: Path, inputs: dict[str, Any]) -> bool:
    """Return whether a folder's last build was made from `inputs` and all its files are there, unchanged."""
    manifest = read_manifest(path)
    if not manifest.get("built") or manifest.get("inputs") != inputs:
        return False
    return all(_has_hash(path / name, manifest["files"][name]) for name in manifest["built"])


def read_bounded(path: Path, most_bytes: int, what: str) -> bytes:
    """Read a file of at most `most_bytes`; `what` names its expected content in errors ("a tuning").

    Reads ordinary files, and pipes (standard input, the shell's ``<(…)``) that end within `LONGEST_PIPE_S`; never more
    than one byte beyond the bound.

    Raises
    ------
    FileError
        The file is missing, a folder, a device or too large, or cannot be read; or as `wait_for_commit`.
    """
    return read_as_one(path.parent, partial(_read_once, path, most_bytes, what), path.name)


def _read_once(path: Path, most_bytes: int, what: str) -> bytes:
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise FileError("cannot be read (Is a directory)", str(path))
        if stat.S_ISCHR(status.st_mode) or stat.S_ISBLK(status.st_mode):
            raise FileError("cannot be read (it is a device)", str(path))
        if stat.S_ISREG(status.st_mode):
            data = b"" if status.st_size > most_bytes else _read_at_most(path, most_bytes + 1, status.st_size + 1)
        else:
            try:
                # In a thread, since even opening a pipe waits for its writer.
                data = answer_within(LONGEST_PIPE_S, partial(_read_at_most, path, most_bytes + 1))
            except TimeoutError as error:
                advice = f"it did not end within {LONGEST_PIPE_S:g} s; write it to a file first"
                raise FileError(f"cannot be read ({advice})", str(path)) from error
    except (OSError, ValueError) as error:  # the latter where the name is impossible for a file
        cause = reason(error) if isinstance(error, OSError) else error
        raise FileError(f"cannot be read ({cause})", str(path)) from error
    size = max(status.st_size, len(data))
    if size > most_bytes:
        raise FileError(f"is too large for {what}: at most {most_bytes} bytes, has {size} or more", str(path))
    return data


def _read_at_most(path: Path, most_bytes: int, likely: int = 0) -> bytes:
    """Read at most `most_bytes`, in blocks, since each read allocates all the memory that it asks for."""
    blocks: list[bytes] = []
    left = most_bytes
    with path.open("rb") as file:
        while block := file.read(min(left, max(likely, READ_BYTES))):
            blocks.append(block)
            left -= len(block)
    return b"".join(blocks)


def answer_within(seconds: float, act: Callable[[], T]) -> T:
    """Call `act` in a thread and wait up to `seconds`; return its answer, or raise what it raises.

    Raises
    ------
    TimeoutError
        It takes longer than `seconds`; the thread is left to itself.
    """
    from concurrent.futures import Future  # here, since no plan needs it

    answer: Future[T] = Future()

    def run() -> None:
        try:
            answer.set_result(act())
        except BaseException as error:
            answer.set_exception(error)

    Thread(target=run, daemon=True).start()
    return answer.result(seconds)


def reason(error: OSError) -> str:
    """Return the operating system's message for an error."""
    return error.strerror or type(error).__name__
