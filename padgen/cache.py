"""Results that are dear to compute, kept by the hash of what went into them.

One small JSON file an entry, written aside and renamed, so that two processes never see half of
one. An entry that cannot be read counts as absent, a folder that cannot be written as full: a cache
only ever saves time.
"""

import json
import os
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from padgen.files import file_hash

__all__ = ["code_hash", "folder", "key_of", "load", "store", "version"]

VARIABLE = "PADGEN_CACHE"


def folder() -> Path:
    """Where entries lie: the folder named by ``PADGEN_CACHE``, else the user's own cache folder."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    from platformdirs import user_cache_path

    return user_cache_path("padgen", appauthor=False)


def key_of(inputs: Any) -> str:
    """The key of a result by all that it depends on, plain data."""
    return file_hash(json.dumps(inputs, sort_keys=True).encode())


def load(kind: str, key: str) -> Any:
    """The stored result, None when there is none that can be read."""
    try:
        entry = json.loads(_path(kind, key).read_bytes())
    except (OSError, ValueError):
        return None
    return entry["result"] if isinstance(entry, dict) and entry.get("key") == key else None


def store(kind: str, key: str, result: Any) -> None:
    """Keep `result`, plain data, if the folder can be written."""
    path = _path(kind, key)
    aside = path.with_suffix(f".{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.write_text(json.dumps({"key": key, "result": result}), encoding="utf-8")
        aside.replace(path)
    except OSError:
        return


def version(package: str) -> str:
    """Version of an installed package, 'missing' when it is not."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "missing"


@cache
def code_hash(*parts: str) -> str:
    """Hash of padgen's own code and data: of all, or of some of its folders and modules."""
    root = Path(__file__).parent
    chosen = [root / part for part in parts] or [root]
    files = sorted(
        path for part in chosen for path in ([part] if part.is_file() else part.rglob("*")) if path.suffix in SOURCES
    )
    return file_hash(b"".join(path.read_bytes() for path in files))


SOURCES = (".py", ".csv")


def _path(kind: str, key: str) -> Path:
    return folder() / kind / key[:2] / f"{key}.json"
