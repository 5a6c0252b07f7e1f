"""Output files that are complete or absent: written aside, renamed when complete.

`OutputFolder` collects the files of one run in a hidden folder beside their place; `commit` moves all of them in, or
none (`padgen.core.commit`). An error, Ctrl-C or kill before the commit leaves the old files as they were.

``manifest.json`` lists padgen's files with their hashes. A listed file that still has its hash is padgen's and may be
removed and replaced. Any other file is the user's: it is never removed, and is kept as ``NAME.old`` where an output
takes its name.
"""

import json
import os
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

from padgen import __version__
from padgen.core.commit import (
    PARTIAL,
    Moves,
    drop_partial,
    free_name,
    has_hash,
    held,
    is_entry,
    is_under_way,
    keep_aside,
    move_all,
    read_json_table,
    recover,
    remove_aside,
    say_kept,
    write_synced,
)
from padgen.core.errors import FileError

__all__ = [
    "MANIFEST",
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
    "recover",
    "take_away",
]

PLAN = "plan.json"
MANIFEST = "manifest.json"
YIELD_FILE = "yield.json"
SPEC = "spec"
MEASURED_FILES = ("tuning.json", "measured.csv", "printed.json")
"""Files with measurements of a print; they stay when the plan changes, while the rest of the old plan's files go."""
READ_BYTES = 1 << 16
LONGEST_PIPE_S = 10.0
"""Longest time in s for reading a pipe to its end."""


def json_text(table: Any) -> str:
    """Return JSON in the form of all files: numbers with ten significant digits, null for NaN and infinity.

    Ten digits agree between platforms. An entry called `spec` is input, not a result: its numbers are written in full,
    so that they read back unchanged. Takes plain data and dataclasses. Same layout as ``json.dumps`` with an indent of
    1, but faster.
    """
    return _whole(_json(table, "\n", False)) + "\n"


def json_line(table: Any) -> str:
    """Return JSON on one line in the same form, for streams and journals; values that are no plain data become text."""
    return _whole(json.dumps(_plain(table), ensure_ascii=False))


def _whole(text: str) -> str:
    """Escape lone surrogates in JSON, which names of files may contain but no file can."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return "".join(f"\\u{ord(sign):04x}" if "\ud800" <= sign <= "\udfff" else sign for sign in text)
    return text


def _plain(value: Any) -> Any:
    """Return a value as plain data with rounded numbers."""
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
    """Return the JSON of a value, its numbers rounded or `in_full`; `line` is a line break with its indent."""
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


def file_hash(data: bytes | bytearray) -> str:
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
        self._aside = path / f"{PARTIAL}{os.getpid()}"
        self._made: list[Path] = []
        self._hashes: dict[str, str] = {}

    def __enter__(self) -> "OutputFolder":
        try:
            missing = list(takewhile(lambda path: not path.exists(), (self.path, *self.path.parents)))
            recover(self.path)
            drop_partial(self.path)
            self._aside.mkdir(parents=True)
            self._made = missing
        except OSError as error:
            raise FileError(f"cannot be written to ({reason(error)})", str(self.path)) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not is_under_way(self.path, self._aside.name):  # else its files are needed to undo the commit
            remove_aside(self._aside)
        if kind is not None:
            with suppress(OSError):
                for folder in self._made:
                    folder.rmdir()
        if isinstance(error, OSError):
            raise FileError(f"cannot be written ({reason(error)})", str(self.path)) from error

    def write(self, name: str, data: bytes | bytearray | str) -> Path:
        """Add a file and return its path aside, for reading back."""
        raw = data.encode() if isinstance(data, str) else data
        write_synced(self._aside / name, raw)
        self._hashes[name] = file_hash(raw)
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
        """Move all files in, then the manifest; return files of an earlier build that contradict a new plan.

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
        with held(self.path):
            before = read_manifest(self.path)
            known, built = before.get("files", {}), before.get("built", [])
            for name in (*self._hashes, MANIFEST):
                if (self.path / name).is_dir() and not (self.path / name).is_symlink():
                    raise FileError("cannot be written (a folder has its name)", str(self.path / name))
            other_plan = PLAN in known and known[PLAN] != self._hashes.get(PLAN, known[PLAN])
            stale = {*remove, *(built if built_from is not None else ())}
            if other_plan:
                stale |= known.keys() - {*MEASURED_FILES, *built}
            gone = [
                name for name in (known.keys() & stale) - self._hashes.keys() if has_hash(self.path / name, known[name])
            ]
            rest = {name: known[name] for name in known.keys() - gone if os.path.lexists(self.path / name)}
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
            self._move_in({**self._hashes, MANIFEST: file_hash(text)}, gone, before)
        return [name for name in built if name in rest and name not in self._hashes] if other_plan else []

    def _move_in(self, new: dict[str, str], gone: list[str], before: dict[str, Any]) -> None:
        """Remove the files `gone`, make room, and move all files to their places; or leave everything as it was."""
        away, kept = list(gone), {}
        for name in new:
            path = self.path / name
            if not os.path.lexists(path):
                continue
            hashes = (before.get("files", {}).get(name), new[name])
            if bool(before) if name == MANIFEST else any(known and has_hash(path, known) for known in hashes):
                away.append(name)
            else:
                kept[name] = free_name(path).name
        move_all(self.path, Moves(self._aside.name, new, away, kept))
        for name, there in kept.items():
            say_kept(self.path / name, self.path / there)


def read_manifest(path: Path) -> dict[str, Any]:
    """Return the manifest in a folder, empty where there is no valid one of padgen.

    A valid one holds plain names of files, each with a hash.
    """
    recover(path)
    manifest = read_json_table(path / MANIFEST)
    files = manifest.get("files")
    if not isinstance(files, dict) or not all(
        is_entry(name, known) and name.lower() != MANIFEST for name, known in files.items()
    ):
        return {}
    # Before version 0.2 only builds wrote manifests.
    built = manifest.setdefault("built", list(files) if "inputs" in manifest else [])
    if not isinstance(built, list) or not all(isinstance(name, str) and name in files for name in built):
        return {}
    return manifest


def built_files(path: Path) -> list[str]:
    """Return the files of the last build in a folder, without those replaced since."""
    return list(read_manifest(path).get("built", []))


def is_unchanged(path: Path, name: str) -> bool:
    """Return whether padgen wrote this file of a folder and nobody has changed it since."""
    known = read_manifest(path).get("files", {})
    return name in known and has_hash(path / name, known[name])


def take_away(path: Path) -> None:
    """Remove padgen's unchanged files from a folder, and the folder if it is then empty."""
    aside = path / f"{PARTIAL}{os.getpid()}"
    with suppress(OSError, FileError):
        drop_partial(path)
        with held(path):
            files = read_manifest(path).get("files")
            if files is not None:
                aside.mkdir()
                ours = [name for name, known in files.items() if has_hash(path / name, known)]
                move_all(path, Moves(aside.name, {}, [*ours, MANIFEST], {}))
                remove_aside(aside)
        path.rmdir()


def differs(path: Path, name: str, text: str) -> bool:
    """Return whether a folder has a file of this name with another text."""
    recover(path)
    try:
        return (path / name).read_bytes() != text.encode()
    except OSError:
        return False


def is_current(path: Path, inputs: dict[str, Any]) -> bool:
    """Return whether a folder's last build was made from `inputs` and all its files are there, unchanged."""
    manifest = read_manifest(path)
    if not manifest.get("built") or manifest.get("inputs") != inputs:
        return False
    return all(has_hash(path / name, manifest["files"][name]) for name in manifest["built"])


def read_bounded(path: Path, most_bytes: int, what: str) -> bytes:
    """Read a file of at most `most_bytes`; `what` names its expected content in errors ("a tuning").

    Reads ordinary files, and pipes (standard input, the shell's ``<(…)``) that end within `LONGEST_PIPE_S`; never more
    than one byte beyond the bound.

    Raises
    ------
    FileError
        The file is missing, a folder, a device or too large, or cannot be read.
    """
    recover(path.parent)
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
    except ValueError as error:  # the name is impossible for a file
        raise FileError(f"cannot be read ({error})", str(path)) from error
    size = max(found.st_size, len(data))
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


def _read_pipe(path: Path, most_bytes: int) -> bytes:
    """Read a pipe in a thread with a time limit, since even opening a pipe waits for its writer."""
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
    """Return the system's own words for an error."""
    return error.strerror or type(error).__name__
