"""Results that are dear to compute, kept by the hash of what went into them.

One file an entry, written aside and renamed, so that two processes never see half of one; its first
line is the hash of the rest, so that what a disk has spoiled counts as absent. Whoever reads an entry judges
its shape as well: what does not fit is made again. A folder that cannot be
written counts as full: a cache only ever saves time. Entries that were used longest ago go first when
there is more than `limit_bytes` of them.
"""

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from itertools import count
from pathlib import Path
from stat import S_ISREG
from typing import Any, TypeVar

from padgen.core.errors import FileError, SpecError
from padgen.core.files import file_hash, read_bounded, reason
from padgen.core.lock import locked

__all__ = [
    "CacheInfo",
    "claimed",
    "clear",
    "code_hash",
    "folder",
    "info",
    "key_of",
    "limit_bytes",
    "load",
    "load_bytes",
    "once",
    "store",
    "store_bytes",
    "trim",
    "version",
    "versions",
]

VARIABLE, LIMIT_VARIABLE = "PADGEN_CACHE", "PADGEN_CACHE_MB"
DEFAULT_LIMIT_MB = 1024
LOOK_SHARE = 0.02
"""Of the limit that a process stores between two looks at how much there is."""
KEPT_SHARE = 0.8
"""Of the limit that is left after a trim, so that not every entry asks for the next."""
ASIDE = ".aside"
CLAIM = ".claim"
PATIENCE_S = 120.0
"""Longest wait for another process that works on the same."""
LARGEST_ENTRY = 1 << 28
"""Bytes of an entry that is read."""
OWN = re.compile(r"[0-9a-f]{64}\.(entry|claim|json|[0-9]+|[0-9]+-[0-9]+\.aside)")
"""Names of our files: entries, those of former versions, and what killed writers of both left."""
_numbers, _unseen = count(), [float("inf")]
"""Of files aside; and bytes stored since this process last looked, which it does at its first."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class CacheInfo:
    """What the cache holds: entries and bytes, in all and by kind."""

    folder: str
    limit_bytes: int
    entries: int
    bytes: int
    kinds: dict[str, tuple[int, int]]


def folder() -> Path:
    """Where entries lie: the folder named by ``PADGEN_CACHE``, else the user's own cache folder."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    from platformdirs import user_cache_path

    return user_cache_path("padgen", appauthor=False)


def limit_bytes() -> int:
    """Most that the cache may hold: ``PADGEN_CACHE_MB`` megabytes, else 1024.

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
    """The key of a result by all that it depends on, plain data."""
    return file_hash(json.dumps(inputs, sort_keys=True).encode())


def load(kind: str, key: str) -> Any:
    """The stored result, None when there is none that can be read."""
    data = load_bytes(kind, key)
    try:
        return None if data is None else json.loads(data)
    except (ValueError, RecursionError):
        return None


def store(kind: str, key: str, result: Any) -> None:
    """Keep `result`, plain data, if the folder can be written."""
    store_bytes(kind, key, json.dumps(result).encode())


def load_bytes(kind: str, key: str) -> bytes | None:
    """The stored bytes, None when there are none that are whole; they count as used now."""
    path = _path(kind, key)
    try:
        if not path.is_file():
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
    """Keep bytes, if the folder can be written."""
    path = _path(kind, key)
    aside = path.with_suffix(f".{os.getpid()}-{next(_numbers)}{ASIDE}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.write_bytes(_head(key, data) + b"\n" + data)
        aside.replace(path)
    except OSError:
        with suppress(OSError):
            aside.unlink(missing_ok=True)
        return
    _unseen[0] += len(data)
    with suppress(SpecError):  # who starts something long looks at the limit first
        if _unseen[0] > LOOK_SHARE * limit_bytes():
            _unseen[0] = 0
            trim()


def once(kind: str, key: str, find: Callable[[], T | None], make: Callable[[], T]) -> T:
    """What `find` brings; else what `make` makes and keeps, in one process at a time where the folder takes locks."""
    found = find()
    if found is not None:
        return found
    with claimed(kind, [key]):
        found = find()
        return make() if found is None else found


@contextmanager
def claimed(kind: str, keys: Iterable[str]) -> Iterator[None]:
    """While it holds, others that claim one of these keys wait: look again what is kept before working it out.

    It saves time and is no guarantee: where the folder takes no locks, or another process holds one for too
    long, it holds without. The system takes it back from a process that dies.
    """
    with ExitStack() as stack:
        for key in sorted(keys):  # in one order, so that no two wait for each other
            path = _path(kind, key).with_suffix(CLAIM)
            with suppress(OSError):
                path.parent.mkdir(parents=True, exist_ok=True)
            stack.enter_context(locked(path, PATIENCE_S))
        yield


def trim(most_bytes: int | None = None) -> int:
    """Drop the entries that were used longest ago until no more than `most_bytes` (the limit) are left; how many."""
    most = limit_bytes() if most_bytes is None else most_bytes
    entries = sorted(_entries(), key=lambda entry: entry[1:])
    total, dropped = sum(size for _, _, size in entries), 0
    if total <= most:
        return 0
    for path, _, size in entries:
        if total <= KEPT_SHARE * most:
            break
        with suppress(OSError):
            path.unlink(missing_ok=True)
            total, dropped = total - size, dropped + 1
    return dropped


def info() -> CacheInfo:
    """What there is."""
    kinds: dict[str, tuple[int, int]] = {}
    for path, _, size in _entries():
        if path.suffix == CLAIM:
            continue
        kind = path.relative_to(folder()).parts[0]
        entries, total = kinds.get(kind, (0, 0))
        kinds[kind] = (entries + 1, total + size)
    return CacheInfo(
        str(folder()),
        limit_bytes(),
        sum(entries for entries, _ in kinds.values()),
        sum(total for _, total in kinds.values()),
        dict(sorted(kinds.items())),
    )


def clear() -> CacheInfo:
    """Drop every entry; what there was.

    Raises
    ------
    FileError
        An entry cannot be removed.
    """
    before, stays = info(), None
    for path, _, _ in _entries():
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            stays = path, error
    if stays:
        raise FileError(f"cannot be removed ({reason(stays[1])})", str(stays[0])) from stays[1]
    return before


PACKAGES = (
    "build123d",
    "cadquery-ocp-novtk",
    "lib3mf",
    "manifold3d",
    "matplotlib",
    "netgen-mesher",
    "ngsolve",
    "numpy",
    "pillow",
    "scipy",
    "trimesh",
)
"""What bytes that are written may depend on."""


def versions() -> dict[str, str]:
    """Versions of the packages that results depend on."""
    return {name: version(name) for name in PACKAGES}


@cache
def version(package: str) -> str:
    """Version of an installed package, 'missing' when it is not."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "missing"


@cache
def code_hash(*parts: str) -> str:
    """Hash of padgen's own code and data: of all, or of some of its folders and modules."""
    root = Path(__file__).parents[1]
    chosen = [root / part for part in parts] or [root]
    files = sorted(
        path for part in chosen for path in ([part] if part.is_file() else part.rglob("*")) if path.suffix in SOURCES
    )
    return file_hash(b"".join(path.read_bytes() for path in files))


SOURCES = (".py", ".csv", ".npy")


def _head(key: str, data: bytes) -> bytes:
    return f"{key} {file_hash(data)}".encode()


def _entries() -> Iterator[tuple[Path, float, int]]:
    """Path, time of the last use and size of every entry, what was left aside by killed writers too.

    Only files where entries lie: the folder may be one of the user's own.
    """
    for path in folder().glob("*/[0-9a-f][0-9a-f]/*"):
        if OWN.fullmatch(path.name):
            with suppress(OSError):
                state = path.stat()
                if S_ISREG(state.st_mode):
                    yield path, state.st_mtime, state.st_size


def _path(kind: str, key: str) -> Path:
    return folder() / kind / key[:2] / f"{key}.entry"
