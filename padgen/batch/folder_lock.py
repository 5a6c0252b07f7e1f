"""One sweep at a time in a folder: a lock that the system takes back when its holder dies, however it dies."""

import json
import os
import socket
import time
from pathlib import Path
from types import TracebackType
from typing import Any

from padgen.core.errors import FileError
from padgen.core.lock import lock_file, unlock_file

__all__ = ["FolderLock"]

LOCK, OWNER = ".lock", ".running"


class FolderLock:
    """The right to write into a folder; a context manager. The folder is made when it is not there.

    The lock is the system's, on an open file: there are no stale ones. Over NFS it holds between
    machines where the server's lock service runs. On a file system without locks a file that exists while
    the sweep runs takes its place; after a power cut that one has to be removed by hand, and the sentence says so.

    Raises
    ------
    FileError
        On entry: another sweep has the folder, or it cannot be made or written to.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file = -1
        self._owner: Path | None = None

    def __enter__(self) -> "FolderLock":
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._take()
        except OSError as error:
            self.__exit__(None, None, None)
            raise FileError(f"cannot be written to ({error.strerror or error})", str(self._folder)) from error
        except FileError:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file >= 0:
            unlock_file(self._folder / LOCK, self._file)
            self._file = -1
        if self._owner:
            self._owner.unlink(missing_ok=True)
            self._owner = None

    def _take(self) -> None:
        """Lock, and leave word who did."""
        try:
            self._file = lock_file(self._folder / LOCK)
        except OSError:  # no locks on this file system
            self._take_by_file()
            return
        if self._file < 0:
            raise self._refusal(_read(self._folder / LOCK), "wait until it has ended, or name another folder")
        os.ftruncate(self._file, 0)
        os.lseek(self._file, 0, os.SEEK_SET)
        os.write(self._file, _holder())

    def _take_by_file(self) -> None:
        owner = self._folder / OWNER
        try:
            file = os.open(owner, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        except FileExistsError as error:
            advice = f"wait until it has ended; if it no longer runs, remove {OWNER}"
            raise self._refusal(_read(owner), advice) from error
        self._owner = owner
        with os.fdopen(file, "wb") as stream:
            stream.write(_holder())

    def _refusal(self, held: dict[str, Any], advice: str) -> FileError:
        who = "process {pid} on {host} since {since}".format(**held) if {"pid", "host", "since"} <= set(held) else ""
        return FileError(f"another sweep writes into it{f' ({who})' if who else ''}; {advice}", str(self._folder))


def _holder() -> bytes:
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    return json.dumps({"pid": os.getpid(), "host": socket.gethostname(), "since": since}).encode()


def _read(file: Path) -> dict[str, Any]:
    """Who holds it, empty when that cannot be read."""
    try:
        held = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return held if isinstance(held, dict) else {}
