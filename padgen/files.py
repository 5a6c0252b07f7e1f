"""Output files that are whole or not there: written aside, renamed when complete.

`OutputFolder` collects the files of one run in a hidden folder beside their place; `commit` moves
them in, the manifest last. An error or Ctrl-C before that leaves the old files as they were.
"""

import json
import os
import shutil
import stat
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import is_dataclass
from hashlib import file_digest, sha256
from itertools import takewhile
from json.encoder import encode_basestring
from math import isfinite
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import Any

from padgen.errors import FileError

__all__ = [
    "MANIFEST",
    "PLAN_FILES",
    "YIELD_FILE",
    "OutputFolder",
    "differs",
    "file_hash",
    "is_current",
    "json_line",
    "json_text",
    "read_bounded",
    "read_manifest",
    "reason",
    "stale_files",
    "take_away",
]

MANIFEST = "manifest.json"
YIELD_FILE = "yield.json"
DRIVE_FILES = (
    "drive.wav",
    "drive-wave.json",
    "hear.json",
    "drive-tuned.csv",
    "retune.json",
    "drive.hjif",
    "drive_syntacts.py",
    "pad_drive.h",
    "excitation.wav",
    "excitation.json",
)
PLAN_FILES = (YIELD_FILE, "study.csv", "study.json", "study.svg", "study.png", *DRIVE_FILES)
"""Files that belong to the plan beside them."""
READ_BYTES = 1 << 16
LONGEST_PIPE_S = 10.0
"""How long what comes through a pipe may take to end."""


def json_text(table: Any) -> str:
    """JSON as all files hold it: ten significant digits, so that platforms agree, and null for no number.

    Of plain data and dataclasses. As ``json.dumps`` with an indent of 1, which has no quick way to indent.
    """
    return _whole(_json(table, "\n")) + "\n"


def json_line(table: Any) -> str:
    """The same conventions on one line, for streams and journals; values that are no plain data as text."""
    return _whole(json.dumps(_plain(table), ensure_ascii=False))


def _whole(text: str) -> str:
    """JSON with halves of characters, as names of files may hold, as their escapes: no file takes them."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return "".join(f"\\u{ord(sign):04x}" if "\ud800" <= sign <= "\udfff" else sign for sign in text)
    return text


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.10g}") if isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return _plain(value.item()) if hasattr(value, "item") else str(value)


def _json(value: Any, line: str) -> str:
    """The JSON of a value; `line` begins a new line at its depth."""
    if isinstance(value, float):
        return float.__repr__(float(f"{value:.10g}")) if isfinite(value) else "null"
    if isinstance(value, str):
        return encode_basestring(value)
    if type(value) is int:
        return int.__repr__(value)
    if isinstance(value, (list, tuple)):
        inner = line + " "
        return f"[{inner}{f',{inner}'.join([_json(entry, inner) for entry in value])}{line}]" if value else "[]"
    if isinstance(value, dict) or is_dataclass(value):
        entries = (
            value if isinstance(value, dict) else {name: getattr(value, name) for name in value.__dataclass_fields__}
        )
        inner = line + " "
        pairs = [f"{_key(key)}: {_json(entry, inner)}" for key, entry in entries.items()]
        return f"{{{inner}{f',{inner}'.join(pairs)}{line}}}" if pairs else "{}"
    return json.dumps(value)


def _key(key: Any) -> str:
    return encode_basestring(key if isinstance(key, str) else json.dumps(key))


def file_hash(data: bytes) -> str:
    """SHA-256 of some bytes, in hexadecimal."""
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
        self._aside = path / f".partial-{os.getpid()}"
        self._made: list[Path] = []
        self._hashes: dict[str, str] = {}

    def __enter__(self) -> "OutputFolder":
        try:
            missing = list(takewhile(lambda path: not path.exists(), (self.path, *self.path.parents)))
            if not missing:
                _drop_partial(self.path)
            self._aside.mkdir(parents=True)
            self._made = missing
        except OSError as error:
            raise FileError(f"cannot be written to ({reason(error)})", str(self.path)) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._aside.rmdir()  # all moved in
        except OSError:
            shutil.rmtree(self._aside, ignore_errors=True)
        if kind is not None:
            for folder in self._made:
                try:
                    folder.rmdir()
                except OSError:
                    return
        if isinstance(error, OSError):
            raise FileError(f"cannot be written ({reason(error)})", str(self.path)) from error

    def write(self, name: str, data: bytes | str) -> None:
        """Add a file."""
        raw = data.encode() if isinstance(data, str) else data
        (self._aside / name).write_bytes(raw)
        self._hashes[name] = file_hash(raw)

    def write_by(self, name: str, writer: Callable[[Path], None]) -> Path:
        """Add a file that `writer` writes to the path it is given; returns that path, for reading back."""
        path = self._aside / name
        writer(path)
        with path.open("rb") as file:
            self._hashes[name] = file_digest(file, "sha256").hexdigest()
        return path

    def path_of(self, name: str) -> Path:
        """Where a file that was added lies until `commit`."""
        return self._aside / name

    def commit(self, manifest: dict[str, Any] | None = None, remove: Iterable[str] = ()) -> None:
        """Move all files in, then the manifest (with every file's hash); drop stale files named in `remove`."""
        if manifest is not None:
            listed = dict(sorted(self._hashes.items()))
            (self._aside / MANIFEST).write_text(json_text({**manifest, "files": listed}), encoding="utf-8")
        fresh = bool(self._made)
        for name in () if fresh else self._hashes:
            if (self.path / name).is_dir():
                raise FileError("cannot be written (a folder has its name)", str(self.path / name))
        known = {} if fresh else read_manifest(self.path).get("files", {})
        if any(name in known and known[name] != new for name, new in self._hashes.items()):
            (self.path / MANIFEST).unlink(missing_ok=True)
        for name in self._hashes:
            (self._aside / name).replace(self.path / name)
        for name in set(remove) - set(self._hashes):
            (self.path / name).unlink(missing_ok=True)
        if manifest is not None:
            (self._aside / MANIFEST).replace(self.path / MANIFEST)


def _runs(process: str) -> bool:
    """Whether a process of another number than ours runs."""
    if not process.isdecimal() or int(process) == os.getpid():
        return False
    try:
        os.kill(int(process), 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def read_manifest(path: Path) -> dict[str, Any]:
    """The manifest in a folder, empty when there is none of ours: its files lie in the folder itself."""
    try:
        manifest = json.loads((path / MANIFEST).read_bytes())
    except (OSError, ValueError):
        return {}
    files = manifest.get("files") if isinstance(manifest, dict) else None
    if not isinstance(files, dict) or any(Path(name).name != name for name in files):
        return {}
    return dict(manifest)


def stale_files(path: Path, plan: str) -> list[str]:
    """Files of an earlier build in a folder that a new `plan.json` with this text would contradict."""
    files = read_manifest(path).get("files", {})
    return [] if files.get("plan.json") == file_hash(plan.encode()) else list(files)


def take_away(path: Path) -> None:
    """Remove what earlier runs wrote: a plan and what belongs to it, what the manifest names; an empty folder, too."""
    _drop_partial(path)
    with suppress(OSError):
        for name in (MANIFEST, "plan.json", *PLAN_FILES, *read_manifest(path).get("files", {})):
            (path / name).unlink(missing_ok=True)
        path.rmdir()


def _drop_partial(path: Path) -> None:
    """Remove what killed runs left half-written in a folder."""
    for left in path.glob(".partial-*"):
        if not _runs(left.name.removeprefix(".partial-")):
            shutil.rmtree(left, ignore_errors=True)


def differs(path: Path, name: str, text: str) -> bool:
    """Whether a folder has a file of this name with another text."""
    try:
        return (path / name).read_bytes() != text.encode()
    except OSError:
        return False


def is_current(path: Path, inputs: dict[str, Any]) -> bool:
    """Whether a folder's manifest was made from `inputs` and its files are all there, unchanged."""
    manifest = read_manifest(path)
    if not manifest.get("files") or manifest.get("inputs") != inputs:
        return False
    try:
        return all(file_hash((path / name).read_bytes()) == known for name, known in manifest["files"].items())
    except OSError:
        return False


def read_bounded(path: Path, most_bytes: int, what: str) -> bytes:
    """Read a file whole, which is to be `what` ("a tuning") and has at most so many bytes.

    Ordinary files are read, and pipes (standard input, the shell's ``<(…)``) that end within `LONGEST_PIPE_S`; never
    more than one byte beyond the bound.

    Raises
    ------
    FileError
        It is not there, a folder, a device, too large, or cannot be read.
    """
    try:
        found = path.stat()
        if stat.S_ISDIR(found.st_mode):
            raise FileError("cannot be read (Is a directory)", str(path))
        if stat.S_ISCHR(found.st_mode) or stat.S_ISBLK(found.st_mode):
            raise FileError("cannot be read (it is a device)", str(path))
        if stat.S_ISREG(found.st_mode):
            data = b"" if found.st_size > most_bytes else _read_at_most(path, most_bytes + 1, found.st_size + 1)
        else:
            data = _read_pipe(path, most_bytes + 1)
    except OSError as error:
        raise FileError(f"cannot be read ({reason(error)})", str(path)) from error
    except ValueError as error:  # names that no file can have
        raise FileError(f"cannot be read ({error})", str(path)) from error
    size = max(found.st_size, len(data))
    if size > most_bytes:
        raise FileError(f"is too large for {what}: at most {most_bytes} bytes, has {size} or more", str(path))
    return data


def _read_at_most(path: Path, most_bytes: int, likely: int = 0) -> bytes:
    """Read at most so many bytes; a read takes the memory that it asks for, not what comes."""
    blocks: list[bytes] = []
    left = most_bytes
    with path.open("rb") as file:
        while block := file.read(min(left, max(likely, READ_BYTES))):
            blocks.append(block)
            left -= len(block)
    return b"".join(blocks)


def _read_pipe(path: Path, most_bytes: int) -> bytes:
    """Read what another process writes; a thread waits for it, since opening a pipe that no one writes to waits too."""
    read: list[bytes] = []
    failed: list[Exception] = []

    def wait() -> None:
        try:
            read.append(_read_at_most(path, most_bytes))
        except Exception as error:
            failed.append(error)

    thread = Thread(target=wait, daemon=True)
    thread.start()
    thread.join(LONGEST_PIPE_S)
    if failed:
        raise failed[0]
    if not read:
        raise FileError(
            f"cannot be read (it did not end within {LONGEST_PIPE_S:g} s; write it to a file first)", str(path)
        )
    return read[0]


def reason(error: OSError) -> str:
    """Why the system refused, in its words."""
    return error.strerror or type(error).__name__
