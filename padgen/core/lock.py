"""A lock on a file by the operating system, which releases it when the process ends in any way."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["lock_file", "locked", "unlock_file"]

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
