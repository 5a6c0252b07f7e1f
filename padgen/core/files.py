"""Output files that are whole or not there: written aside, renamed when complete.

`OutputFolder` collects the files of one run in a hidden folder beside their place; `commit` moves
them in, the manifest last. An error or Ctrl-C before that leaves the old files as they were.

``manifest.json`` lists what padgen wrote, with hashes. A listed file that still has its hash is padgen's: it may be
removed and replaced. Any other is its user's: it is never removed, and where an output takes its name it is kept as
``NAME.old``.
"""

import json
import os
import re
import shutil
import stat
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import is_dataclass
from fnmatch import fnmatchcase
from hashlib import file_digest, sha256
from itertools import count, takewhile
from json.encoder import encode_basestring
from math import isfinite
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import Any

from padgen import __version__
from padgen.core.errors import FileError
from padgen.core.lock import locked

__all__ = [
    "MANIFEST",
    "PLAN_FILES",
    "YIELD_FILE",
    "OutputFolder",
    "built_files",
    "differs",
    "file_hash",
    "is_current",
    "is_unchanged",
    "json_line",
    "json_text",
    "keep_aside",
    "read_bounded",
    "read_manifest",
    "reason",
    "remove_unchanged",
    "take_away",
]

PLAN = "plan.json"
MANIFEST = "manifest.json"
MOST_MANIFEST = 1_000_000
"""Bytes of a manifest; the largest pad's has a hundredth."""
PLAIN_NAME = re.compile(r"\w[\w.-]{0,200}", re.ASCII)
HASH = re.compile("[0-9a-f]{64}")
PARTIAL = ".partial-"
LOCK = ".padgen.core.lock"
PATIENCE_S = 10.0
"""How long a commit waits for another; one takes milliseconds."""
YIELD_FILE = "yield.json"
SPEC = "spec"
PLAN_FILES = (
    *(YIELD_FILE, "study.csv", "study.json", "study.svg", "study.png"),
    *("drive.wav", "drive-wave.json", "hear.json", "drive-tuned.csv", "retune.json"),
    *("drive.hjif", "drive_syntacts.py", "pad_drive.h", "excitation.wav", "excitation.json"),
)
"""Files that belong to the plan beside them and go with it."""
READ_BYTES = 1 << 16
LONGEST_PIPE_S = 10.0
"""How long what comes through a pipe may take to end."""


def json_text(table: Any) -> str:
    """JSON as all files hold it: ten significant digits, so that platforms agree, and null for no number.

    An entry called `spec` is what was asked for, not a result: its numbers are written in full, so that they read
    back as they were given. Of plain data and dataclasses. As ``json.dumps`` with an indent of 1, which has no
    quick way to indent.
    """
    return _whole(_json(table, "\n", False)) + "\n"


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


def _json(value: Any, line: str, in_full: bool) -> str:
    """The JSON of a value, its numbers rounded or `in_full`; `line` begins a new line at its depth."""
    if isinstance(value, float):
        return float.__repr__(value if in_full else float(f"{value:.10g}")) if isfinite(value) else "null"
    if isinstance(value, str):
        return encode_basestring(value)
    if type(value) is int:
        return int.__repr__(value)
    if isinstance(value, (list, tuple)):
        inner = line + " "
        return (
            f"[{inner}{f',{inner}'.join([_json(entry, inner, in_full) for entry in value])}{line}]" if value else "[]"
        )
    if isinstance(value, dict) or is_dataclass(value):
        entries = (
            value if isinstance(value, dict) else {name: getattr(value, name) for name in value.__dataclass_fields__}
        )
        inner = line + " "
        pairs = [f"{_key(key)}: {_json(entry, inner, in_full or key == SPEC)}" for key, entry in entries.items()]
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
        self._aside = path / f"{PARTIAL}{os.getpid()}"
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

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files that were added."""
        return tuple(self._hashes)

    def commit(self, built_from: dict[str, Any] | None = None, remove: Iterable[str] = ()) -> list[str]:
        """Move all files in, then the manifest; returns files of an earlier build that a new plan contradicts.

        Parameters
        ----------
        built_from : dict, optional
            These files are a build's: what it was made from, for `is_current`.
        remove : iterable of str
            Patterns of file names that are stale now; `PLAN_FILES` are where the plan is another. Only what
            padgen wrote and nobody has changed since goes.

        Raises
        ------
        FileError
            A folder has the name of a file, or another process is writing; nothing was moved.
        """
        with locked(self.path / LOCK, PATIENCE_S) as taken:
            if taken:
                raise FileError("another process writes into it; try again when it has ended", str(self.path))
            before = read_manifest(self.path)
            known = before.get("files", {})
            for name in (*self._hashes, MANIFEST):
                if (self.path / name).is_dir() and not (self.path / name).is_symlink():
                    raise FileError("cannot be written (a folder has its name)", str(self.path / name))
            other_plan = PLAN in known and known[PLAN] != self._hashes.get(PLAN, known[PLAN])
            stale = [*remove, *(PLAN_FILES if other_plan else ())]
            gone = [
                name
                for name in known.keys() - self._hashes.keys()
                if any(fnmatchcase(name, pattern) for pattern in stale) and _has_hash(self.path / name, known[name])
            ]
            rest = {name: known[name] for name in known.keys() - gone if os.path.lexists(self.path / name)}
            manifest: dict[str, Any] = {"padgen": __version__, "files": dict(sorted({**rest, **self._hashes}.items()))}
            built = before.get("built", [])
            if built_from is not None:
                manifest |= {"inputs": built_from, "built": sorted(self._hashes)}
            elif built and all(manifest["files"].get(name) == known[name] for name in built):
                manifest |= {"inputs": before["inputs"], "built": built}
            (self._aside / MANIFEST).write_text(json_text(manifest), encoding="utf-8")
            self._move_in(gone, before)
        return [name for name in built if name in rest and name not in self._hashes] if other_plan else []

    def _move_in(self, gone: list[str], before: dict[str, Any]) -> None:
        """Take away what is `gone`, make room, and move all files to their places; or leave all as it was."""
        replaced, kept = self._aside / ".replaced", []
        replaced.mkdir()
        away = [(self.path / name, replaced / name) for name in gone]
        for name in (MANIFEST, *self._hashes):
            path = self.path / name
            if not os.path.lexists(path):
                continue
            hashes = (before.get("files", {}).get(name), self._hashes.get(name))
            if bool(before) if name == MANIFEST else any(known and _has_hash(path, known) for known in hashes):
                away.append((path, replaced / name))
            else:
                kept.append((path, _free(path)))
        _move_all([*away, *kept, *((self._aside / name, self.path / name) for name in (*self._hashes, MANIFEST))])
        for path, there in kept:
            _say_kept(path, there)


def _move_all(moves: list[tuple[Path, Path]]) -> None:
    """Rename files one after the other; where that ends early, back again."""
    try:
        for here, there in moves:
            here.replace(there)
    except BaseException:
        for here, there in reversed(moves):
            with suppress(OSError):
                if not os.path.lexists(here):
                    there.replace(here)
        raise


def _free(path: Path) -> Path:
    """A name for a user's file that makes room for an output: with .old, or .old2, or ... behind it."""
    names = (path.with_name(f"{path.name}.old{number if number > 1 else ''}") for number in count(1))
    return next(name for name in names if not os.path.lexists(name))


def keep_aside(path: Path) -> None:
    """Make room for an output where a user's file has its name."""
    there = _free(path)
    path.replace(there)
    _say_kept(path, there)


def _say_kept(path: Path, there: Path) -> None:
    import logging

    logging.getLogger("padgen").warning("padgen: %s was not as padgen wrote it; kept as %s", path, there.name)


def read_manifest(path: Path) -> dict[str, Any]:
    """The manifest in a folder, empty when there is none of ours: plain names of files there, each with a hash."""
    file = path / MANIFEST
    try:
        if file.is_symlink() or not file.is_file() or file.stat().st_size > MOST_MANIFEST:
            return {}
        manifest = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    files = manifest.get("files") if isinstance(manifest, dict) else None
    if not isinstance(files, dict) or not all(_is_entry(name, known) for name, known in files.items()):
        return {}
    # Before 0.2 builds alone wrote manifests.
    built = manifest.setdefault("built", list(files) if "inputs" in manifest else [])
    if not isinstance(built, list) or not all(isinstance(name, str) and name in files for name in built):
        return {}
    return dict(manifest) if "inputs" in manifest or not built else {}


def _is_entry(name: str, known: object) -> bool:
    plain = PLAIN_NAME.fullmatch(name) is not None and name.lower() != MANIFEST
    return plain and isinstance(known, str) and HASH.fullmatch(known) is not None


def built_files(path: Path) -> list[str]:
    """The files of the last build in a folder, none when its plan was replaced since."""
    return list(read_manifest(path).get("built", []))


def _has_hash(path: Path, known: str) -> bool:
    """Whether this is a file, and no link to one, of this content."""
    try:
        if path.is_symlink() or not path.is_file():
            return False
        with path.open("rb") as file:
            return file_digest(file, "sha256").hexdigest() == known
    except OSError:
        return False


def is_unchanged(path: Path, name: str) -> bool:
    """Whether padgen wrote this file of a folder and nobody has changed it since."""
    known = read_manifest(path).get("files", {})
    return name in known and _has_hash(path / name, known[name])


def remove_unchanged(path: Path, names: Iterable[str]) -> None:
    """Remove those of some files of a folder that padgen wrote and nobody has changed since."""
    for name in [name for name in names if is_unchanged(path, name)]:
        (path / name).unlink(missing_ok=True)


def take_away(path: Path) -> None:
    """Remove what padgen wrote into a folder and nobody has changed since; the folder, too, when it is empty then."""
    _drop_partial(path)
    with suppress(OSError):
        with locked(path / LOCK, PATIENCE_S):
            manifest = read_manifest(path)
            if manifest:
                remove_unchanged(path, manifest["files"])
                (path / MANIFEST).unlink()
        path.rmdir()


def _drop_partial(path: Path) -> None:
    """Remove what killed runs left half-written in a folder."""
    for left in path.glob(f"{PARTIAL}*"):
        process = left.name.removeprefix(PARTIAL)
        if process.isdecimal() and not _runs(int(process)):
            shutil.rmtree(left, ignore_errors=True)


def _runs(process: int) -> bool:
    """Whether a process of another number than ours runs."""
    import psutil

    try:
        return process != os.getpid() and psutil.pid_exists(process)
    except OverflowError:
        return False


def differs(path: Path, name: str, text: str) -> bool:
    """Whether a folder has a file of this name with another text."""
    try:
        return (path / name).read_bytes() != text.encode()
    except OSError:
        return False


def is_current(path: Path, inputs: dict[str, Any]) -> bool:
    """Whether a folder's last build was made from `inputs` and its files are all there, unchanged."""
    manifest = read_manifest(path)
    if not manifest.get("built") or manifest["inputs"] != inputs:
        return False
    return all(_has_hash(path / name, manifest["files"][name]) for name in manifest["built"])


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
    except FileNotFoundError as error:
        raise FileError("there is no such file", str(path)) from error
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
