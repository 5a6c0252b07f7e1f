"""Change the files of a folder all at once or not at all, even if the process is killed meanwhile.

The complete new files first lie in a hidden folder aside. A journal is put into the folder, the files are moved one by
one, and removing the journal commits the change. The replaced files lie aside until then. Whoever finds a journal and
gets the folder's lock, which a living process would hold, puts everything back with the journal (`recover`). A kill
while files are put back does no harm, since the next process continues from there.

Each system call that changes the disk is a function of `os` (those of `Path` call them), also in the writing of files.
A test can therefore simulate another disk by replacing these functions.

Locks on files are the operating system's, which releases them when the process ends in any way.
"""

import json
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from errno import EDQUOT, EIO, ENOSPC
from hashlib import file_digest
from itertools import count
from pathlib import Path
from typing import Any

from padgen.core.errors import FileError

__all__ = [
    "LOCK",
    "PARTIAL",
    "Moves",
    "drop_partial",
    "free_name",
    "has_hash",
    "held",
    "is_entry",
    "is_under_way",
    "keep_aside",
    "lock_file",
    "locked",
    "move_all",
    "read_json_table",
    "recover",
    "remove_aside",
    "say_kept",
    "unlock_file",
    "write_synced",
]

LOOK_S = 0.02
"""Seconds between two attempts to get a lock."""
LOCKED_BYTE = 1 << 30
"""Byte that Windows locks, beyond the file's content, since other processes cannot read a locked byte."""


@contextmanager
def locked(path: Path, patience_s: float) -> Iterator[bool | None]:
    """Hold a lock, or continue without it.

    Yields True with the lock, False where another process kept it for `patience_s`, and None where the file system has
    no locks; nobody is then kept out. The file exists as long as the lock is held.
    """
    file, has_lock, end = -1, None, time.monotonic() + patience_s
    try:
        with suppress(OSError):
            while (file := lock_file(path)) < 0 and time.monotonic() < end:
                time.sleep(LOOK_S)
            has_lock = file >= 0
        yield has_lock
    finally:
        if file >= 0:
            unlock_file(path, file)


def lock_file(path: Path) -> int:
    """Create and lock a file; return its open descriptor, or -1 where another process has the lock.

    Raises
    ------
    OSError
        The file cannot be made, or the file system has no locks.
    """
    file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
    try:
        _lock(file)
        if os.fstat(file).st_ino == path.stat().st_ino:
            return file
    except (BlockingIOError, FileNotFoundError):  # locked by another, or released and removed just now
        pass
    except BaseException:
        os.close(file)
        raise
    os.close(file)
    return -1


def unlock_file(path: Path, file: int) -> None:
    """Release a lock of `lock_file`, and remove its file."""
    if sys.platform == "win32":
        os.close(file)
        with suppress(OSError):  # Windows keeps files that are open, such as one that another process has locked
            path.unlink()
    else:
        import fcntl

        with suppress(OSError):
            path.unlink()
        with suppress(OSError):
            # Closing alone would leave the lock with processes forked meanwhile.
            fcntl.flock(file, fcntl.LOCK_UN)
        with suppress(OSError):
            os.close(file)


def _lock(file: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        os.lseek(file, LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError from error
        finally:
            os.lseek(file, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


PARTIAL = ".partial-"
JOURNAL = ".padgen.journal"
LOCK = ".padgen.lock"
REPLACED = ".replaced"
"""Name, in the folder aside, of the folder with padgen's own replaced and removed files."""
PATIENCE_S = 10.0
"""Longest wait in s of a commit for another, which takes milliseconds."""
MOST_JSON = 1_000_000
"""Largest manifest or journal in bytes; the largest pad's have a hundredth of this."""
PLAIN_NAME = re.compile(r"\w[\w.-]{0,254}", re.ASCII)
HASH = re.compile("[0-9a-f]{64}")
BAD_DISK = (EIO, ENOSPC, EDQUOT)


@dataclass(frozen=True, slots=True)
class Moves:
    """The moves of a commit, by names of files in the folder.

    `new` files, with their hashes, come from the folder `aside`. `away` are padgen's own files that go there. `kept`
    are users' files, each with its new name.
    """

    aside: str
    new: dict[str, str]
    away: list[str]
    kept: dict[str, str]


def move_all(path: Path, moves: Moves) -> None:
    """Move all files of a folder that is `held`; after an error all are moved back."""
    aside, journal = path / moves.aside, path / JOURNAL
    try:
        (aside / REPLACED).mkdir()
        write_synced(aside / JOURNAL, json.dumps(asdict(moves)).encode())
        (aside / JOURNAL).replace(journal)
        _sync_folder(path)
        for name in moves.away:
            (path / name).replace(aside / REPLACED / name)
        for name, there in moves.kept.items():
            (path / name).replace(path / there)
        for name in moves.new:
            (aside / name).replace(path / name)
        _sync_folder(path)
        journal.unlink()
    except BaseException:
        if os.path.lexists(journal):
            _move_back(path, moves)
        raise


def _move_back(path: Path, moves: Moves) -> None:
    """Undo each completed move, and keep files that a user has put there since under another name."""
    aside = path / moves.aside
    lie = {name: aside / REPLACED / name for name in moves.away}
    lie |= {name: path / there for name, there in moves.kept.items()}
    for name in (moves.new | lie) if aside.is_dir() else ():
        place, old = path / name, lie.get(name)
        if old is not None and not os.path.lexists(old):
            continue  # it was never moved, or is back already
        if os.path.lexists(place):
            if not os.path.lexists(aside / name) and has_hash(place, moves.new.get(name, "")):
                place.replace(aside / name)
            elif old is not None:
                keep_aside(place)
        if old is not None:
            old.replace(place)
    _sync_folder(path)
    (path / JOURNAL).unlink()


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Keep other processes from changing a folder, and first undo the unfinished commit of a killed process.

    Raises
    ------
    FileError
        Another process holds the folder, or the commit cannot be undone.
    """
    with locked(path / LOCK, PATIENCE_S) as has_lock:
        moves = _read_journal(path)
        # Without locks, the process number in the folder's name decides.
        if has_lock is False or (has_lock is None and moves and _runs(moves.aside)):
            raise FileError("another process is writing into it; try again when that has ended", str(path))
        if moves:
            try:
                _move_back(path, moves)
            except OSError as error:
                reason = error.strerror or type(error).__name__
                sentence = f"a killed run left it half-written, and it cannot be restored ({reason})"
                raise FileError(sentence, str(path)) from error
            remove_aside(path / moves.aside)
        yield


def recover(path: Path) -> None:
    """Undo the unfinished commit of a killed process; call this before reading the folder.

    Raises
    ------
    FileError
        As `held`.
    """
    if _read_journal(path):
        with held(path):
            pass


def drop_partial(path: Path) -> None:
    """Remove half-written files of killed processes from a folder."""
    left = [left for left in path.glob(f"{PARTIAL}*") if not _runs(left.name)]
    if left or (path / LOCK).exists():  # holding the folder removes the lock's file, too
        with held(path):
            for folder in left:
                remove_aside(folder)


def remove_aside(folder: Path) -> None:
    """Remove a folder of files that are not needed, as far as the disk allows."""
    with suppress(OSError):  # closing the folder may fail even with ignore_errors
        shutil.rmtree(folder, ignore_errors=True)


def is_under_way(path: Path, aside: str) -> bool:
    """Return whether the files in the folder `aside` are needed to undo a commit."""
    moves = _read_journal(path)
    return moves is not None and moves.aside == aside


def _read_journal(path: Path) -> Moves | None:
    """Return the journal in a folder, None where there is none or it is not padgen's."""
    try:
        moves = Moves(**read_json_table(path / JOURNAL))
        names = (*moves.new, *moves.away, *moves.kept, *moves.kept.values())
        plain = all(PLAIN_NAME.fullmatch(name) for name in names) and all(map(HASH.fullmatch, moves.new.values()))
        return moves if plain and _process(moves.aside) else None
    except (TypeError, AttributeError):
        return None


def read_json_table(file: Path) -> dict[str, Any]:
    """Return the table in a small JSON file, empty where there is no such file or table."""
    try:
        if file.is_symlink() or not file.is_file() or file.stat().st_size > MOST_JSON:
            return {}
        table = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return table if isinstance(table, dict) else {}


def is_entry(name: str, known: object) -> bool:
    """Return whether `name` is the plain name of a file and `known` a hash."""
    return PLAIN_NAME.fullmatch(name) is not None and isinstance(known, str) and HASH.fullmatch(known) is not None


def has_hash(path: Path, known: str) -> bool:
    """Return whether `path` is a file, not a link, with this hash."""
    try:
        if path.is_symlink() or not path.is_file():
            return False
        with path.open("rb") as file:
            return file_digest(file, "sha256").hexdigest() == known
    except OSError:
        return False


def free_name(path: Path) -> Path:
    """Return a free name for a user's file: its name with .old, .old2, ... appended."""
    names = (path.with_name(f"{path.name}.old{number if number > 1 else ''}") for number in count(1))
    return next(name for name in names if not os.path.lexists(name))


def keep_aside(path: Path) -> None:
    """Rename a user's file to make room for an output of the same name."""
    there = free_name(path)
    path.replace(there)
    say_kept(path, there)


def say_kept(path: Path, there: Path) -> None:
    """Log the new name of a user's file."""
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


def _sync_folder(path: Path) -> None:
    """Wait until the names in a folder are on the disk, where the system can do this."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    try:
        file = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(file)
        finally:
            os.close(file)
    except OSError as error:
        if error.errno in BAD_DISK:
            raise


def _process(aside: str) -> int:
    """Return the process number in the name of a folder aside, 0 where it has none."""
    number = aside.removeprefix(PARTIAL)
    return int(number) if aside.startswith(PARTIAL) and number.isascii() and number.isdecimal() else 0


def _runs(aside: str) -> bool:
    """Return whether another process, the owner of a folder aside, still runs; without an owner, return True."""
    import psutil

    process = _process(aside)
    try:
        return not process or (process != os.getpid() and psutil.pid_exists(process))
    except OverflowError:
        return False
