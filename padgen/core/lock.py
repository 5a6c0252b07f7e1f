"""A lock on a file: the system's, which takes it back from a process that dies, however it dies."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["lock_file", "locked", "unlock_file"]

LOOK_S = 0.02
"""Between two looks at a lock that another has."""
LOCKED_BYTE = 1 << 30
"""The byte that Windows locks, which keeps others from reading it: beyond all that is written into the file."""


@contextmanager
def locked(path: Path, patience_s: float) -> Iterator[bool | None]:
    """Hold a lock, or go without; tells whether it is held: False where another has kept it for `patience_s`.

    The file is there for as long as the lock is held. Where the file system takes no locks, which None tells, nobody
    is kept out.
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
    """Lock a file, which is made; returns it open, or -1 where another process has it.

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
    except (BlockingIOError, FileNotFoundError):  # taken; or given back and taken away just now
        pass
    except BaseException:
        os.close(file)
        raise
    os.close(file)
    return -1


def unlock_file(path: Path, file: int) -> None:
    """Give back what `lock_file` returned, and remove its file."""
    if sys.platform == "win32":
        os.close(file)
        with suppress(OSError):  # which removes no open file, so none that another has locked meanwhile
            path.unlink()
    else:
        import fcntl

        with suppress(OSError):
            path.unlink()
        with suppress(OSError):
            # Closing alone would leave the lock to processes that were forked meanwhile.
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
