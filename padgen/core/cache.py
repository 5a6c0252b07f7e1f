"""Cache on disk for results that take long to compute, each under the hash of its inputs.

Each entry is one file, written aside and renamed, so that no process ever reads half of one. Its first line holds the
key and the hash of the rest; a damaged entry counts as absent. The reader of an entry also checks its form, and
computes the result again where that is wrong. If the folder cannot be written, nothing is kept: a cache only saves
time. Above `limit_bytes` the entries that were used longest ago are removed first.
"""

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from itertools import count
from pathlib import Path
from stat import S_ISREG
from typing import Any, TypeVar

from padgen.core.errors import FileError, SpecError
from padgen.core.files import locked, read_bounded, reason, sha256_hex

__all__ = [
    "CacheInfo",
    "claimed",
    "clear",
    "code_hash",
    "folder",
    "get_or_compute",
    "info",
    "key_of",
    "limit_bytes",
    "load",
    "load_bytes",
    "store",
    "store_bytes",
    "trim",
    "version",
    "versions",
]

VARIABLE = "PADGEN_CACHE"
LIMIT_VARIABLE = "PADGEN_CACHE_MB"
DEFAULT_LIMIT_MB = 1024
LOOK_SHARE = 0.02
"""Share of the limit that a process stores between two checks of the cache's size."""
KEPT_SHARE = 0.8
"""Share of the limit that remains after a trim, so that the next entries do not trim again."""
ASIDE = ".aside"
CLAIM = ".claim"
PATIENCE_S = 120.0
"""Longest wait in s for another process that computes the same result."""
LARGEST_ENTRY = 1 << 28
"""Largest entry in bytes that is read."""
OWN = re.compile(r"[0-9a-f]{64}\.(entry|claim|json|[0-9]+|[0-9]+-[0-9]+\.aside)")
"""Names of padgen's files: entries, those of earlier versions, and files that killed writers left."""
_file_numbers = count()
_bytes_since_trim = [float("inf")]
"""Numbers for files aside; and the bytes stored since this process last checked the size, first at its first entry."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class CacheInfo:
    """Contents of the cache: entries and bytes, in all and by kind."""

    folder: str
    limit_bytes: int
    entries: int
    bytes: int
    kinds: dict[str, tuple[int, int]]


def folder() -> Path:
    """Return the folder of the entries: ``PADGEN_CACHE``, or the user's cache folder."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    from platformdirs import user_cache_path

    return user_cache_path("padgen", appauthor=False)


def limit_bytes() -> int:
    """Return the cache's largest size in bytes: ``PADGEN_CACHE_MB`` megabytes, or 1024.

    Raises
    ------
    SpecError
        The variable is no number, or less than 0.
    """
    named = os.environ.get(LIMIT_VARIABLE)
    if not named:
        return DEFAULT_LIMIT_MB * 1_000_000
    try:
        limit = round(float(named) * 1e6)
    except (ValueError, OverflowError):
        limit = -1
    if limit < 0:
        raise SpecError(f"must be a number of megabytes, 0 or more, got {named!r}", LIMIT_VARIABLE)
    return limit


def key_of(inputs: Any) -> str:
    """Return the key of a result: a hash of all its inputs, which are plain data."""
    return sha256_hex(json.dumps(inputs, sort_keys=True).encode())


def load(kind: str, key: str) -> Any:
    """Return the stored result, None where there is none or it cannot be read."""
    data = load_bytes(kind, key)
    try:
        return None if data is None else json.loads(data)
    except (ValueError, RecursionError):
        return None


def store(kind: str, key: str, result: Any) -> None:
    """Store `result`, plain data, under its kind and key; do nothing where the folder cannot be written."""
    store_bytes(kind, key, json.dumps(result).encode())


def load_bytes(kind: str, key: str) -> bytes | None:
    """Return the stored bytes and mark them as used now; None where there are none or they are damaged."""
    path = _path(kind, key)
    try:
        if not path.is_file() or _is_linked(path):
            return None
        head, _, data = read_bounded(path, LARGEST_ENTRY, "an entry of the cache").partition(b"\n")
    except (FileError, OSError):
        return None
    if head != _head(key, data):
        return None
    with suppress(OSError):
        os.utime(path)
    return data


def store_bytes(kind: str, key: str, data: bytes) -> None:
    """Store bytes under their kind and key; do nothing where the folder cannot be written."""
    path = _path(kind, key)
    aside = path.with_suffix(f".{os.getpid()}-{next(_file_numbers)}{ASIDE}")
    if _is_linked(path) or _is_linked(aside):
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.write_bytes(_head(key, data) + b"\n" + data)
        aside.replace(path)
    except OSError:
        with suppress(OSError):
            aside.unlink(missing_ok=True)
        return
    _bytes_since_trim[0] += len(data)
    with suppress(SpecError):  # long commands refuse a bad limit as they start
        if _bytes_since_trim[0] > LOOK_SHARE * limit_bytes():
            _bytes_since_trim[0] = 0
            trim()


def get_or_compute(kind: str, key: str, find: Callable[[], T | None], make: Callable[[], T]) -> T:
    """Return the result of `find` or, if that is None, of `make`, which only one process at a time calls for a key.

    `find` returns the result, or None where there is none; `make` computes and keeps it. Where the folder has no locks,
    several processes may compute it.
    """
    made = find()
    if made is not None:
        return made
    with claimed(kind, [key]):
        made = find()
        return make() if made is None else made


@contextmanager
def claimed(kind: str, keys: Iterable[str]) -> Iterator[None]:
    """Lock cache keys during the block, so that no two processes compute one result; the block must look them up again.

    A claim saves time and guarantees nothing: where the folder has no locks, or another process keeps one for more than
    `PATIENCE_S`, the block runs without it. The system releases the claim of a process that dies.
    """
    with ExitStack() as stack:
        for key in sorted(keys):  # in one order, so that no two processes wait for each other
            path = _path(kind, key).with_suffix(CLAIM)
            if _is_linked(path):
                continue
            with suppress(OSError):
                path.parent.mkdir(parents=True, exist_ok=True)
            stack.enter_context(locked(path, PATIENCE_S))
        yield


def trim(most_bytes: int | None = None) -> int:
    """If the cache exceeds `most_bytes`, remove its least recently used entries down to 80 % of that; return how many.

    By default `most_bytes` is the cache's limit.
    """
    most = limit_bytes() if most_bytes is None else most_bytes
    entries = sorted(_entries(), key=lambda entry: entry[1:])
    total = sum(size for _, _, size in entries)
    dropped = 0
    enough = most if total <= most else KEPT_SHARE * most
    for path, _, size in entries:
        if total <= enough:
            break
        with suppress(OSError):
            path.unlink(missing_ok=True)
            total = total - size
            dropped = dropped + 1
    return dropped


def info() -> CacheInfo:
    """Return the number and bytes of the cache's entries, in all and by kind."""
    kinds: dict[str, list[int]] = {}
    for path, _, size in _entries():
        if path.suffix != CLAIM:
            kinds.setdefault(path.parts[-3], []).append(size)
    counted = {kind: (len(sizes), sum(sizes)) for kind, sizes in sorted(kinds.items())}
    entries, total = (sum(part) for part in zip((0, 0), *counted.values(), strict=True))
    return CacheInfo(str(folder()), limit_bytes(), entries, total, counted)


def clear() -> CacheInfo:
    """Remove every entry, and return the number and bytes of the removed entries, in all and by kind.

    Raises
    ------
    FileError
        An entry cannot be removed.
    """
    before = info()
    stays = None
    for path, _, _ in _entries():
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            stays = FileError(f"cannot be removed ({reason(error)})", str(path))
    if stays:
        raise stays
    return before


PACKAGES = (
    "build123d",
    "cadquery-ocp-novtk",
    "manifold3d",
    "matplotlib",
    "netgen-mesher",
    "ngsolve",
    "numpy",
    "pillow",
    "scipy",
    "trimesh",
)
"""Packages whose versions may change the bytes of results."""


def versions() -> dict[str, str]:
    """Return the versions of the packages that results depend on."""
    return {name: version(name) for name in PACKAGES}


@cache
def version(package: str) -> str:
    """Return the version of an installed package, or 'missing'."""
    from importlib import metadata  # which loads a reader of e-mails

    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "missing"


@cache
def code_hash(*parts: str) -> str:
    """Return a hash of padgen's code and data files: of all of them, or only of the folders and modules in `parts`.

    The files are read only if the name, the size, or the time of change or of modification of one differs from those
    with which the cache has the hash.
    """
    root = Path(__file__).parents[1]
    files = sorted(path for part in parts or ("",) for path in _sources(root / part))
    stamp = _stamp(files)
    known = load_bytes("code", stamp) or b""
    if HASH.fullmatch(known):
        return known.decode()
    made = sha256_hex(b"".join(path.read_bytes() for path in files))
    if _stamp(files) == stamp:  # no file was changed while they were read
        store_bytes("code", stamp, made.encode())
    return made


HASH = re.compile(rb"[0-9a-f]{64}")
"""Form of a stored hash."""


def _stamp(files: list[Path]) -> str:
    """Return a hash of the files' names, sizes and times."""
    states = [path.stat() for path in files]
    return key_of([[str(p), s.st_size, s.st_mtime_ns, s.st_ctime_ns] for p, s in zip(files, states, strict=True)])


def _sources(part: Path) -> Iterator[Path]:
    """Yield the files of code and data of a folder, or the one file that `part` is."""
    if part.is_file():
        yield part
    for folder, inner, names in os.walk(part):
        if "__pycache__" in inner:
            inner.remove("__pycache__")
        yield from (Path(folder, name) for name in names if name.endswith(SOURCES))


SOURCES = (".py", ".csv", ".npy", ".html", ".min.js", ".min.css")


def _head(key: str, data: bytes) -> bytes:
    return f"{key} {sha256_hex(data)}".encode()


def _entries() -> Iterator[tuple[Path, float, int]]:
    """Yield path, time of last use and size of every entry, including files that killed writers left.

    Only files named as entries count, since the folder may be one of the user's own.
    """
    for path in folder().glob("*/[0-9a-f][0-9a-f]/*"):
        if OWN.fullmatch(path.name) and not _is_linked(path):
            with suppress(OSError):
                state = path.stat()
                if S_ISREG(state.st_mode):
                    yield path, state.st_mtime, state.st_size


def _is_linked(path: Path) -> bool:
    """Return whether a file of the cache must be left alone: it or one of its two folders is a symbolic link.

    So must a file be that cannot be looked at, since it may be one.
    """
    try:
        return any(each.is_symlink() for each in (path, path.parent, path.parents[1]))
    except OSError:
        return True


def _path(kind: str, key: str) -> Path:
    return folder() / kind / key[:2] / f"{key}.entry"
