"""Public functions for the cache, for folders that a killed run left half-written, and for the schema of a spec."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen.core.errors import FileError

if TYPE_CHECKING:
    from padgen.core.cache import CacheInfo

__all__ = ["cache_info", "clear_cache", "restore", "spec_schema", "use_cache"]


def use_cache(folder: "str | Path") -> None:
    """Make this process and its children keep their cache in a folder."""
    import os

    from padgen.core.cache import VARIABLE

    os.environ[VARIABLE] = str(Path(folder).absolute())


def cache_info() -> "CacheInfo":
    """Return the folder of the cache of results that take long to compute, and its size by kind."""
    from padgen.core import cache

    return cache.info()


def clear_cache() -> "CacheInfo":
    """Remove all entries of the cache of computed results, and return how many entries and bytes it had."""
    from padgen.core import cache

    return cache.clear()


def restore(folder: "str | Path") -> bool:
    """Undo the changes that a killed run left unfinished in a folder; return False if there were none.

    Raises
    ------
    FileError
        There is no such folder, or what a killed run left is not this user's.
    """
    from padgen.core.files import recover

    place = Path(folder)
    if not place.is_dir():
        raise FileError("is not a folder" if place.exists() else "there is no such folder", str(folder))
    return recover(place)


def spec_schema() -> dict[str, Any]:
    """Return the JSON schema of a spec, for editors.

    >>> spec_schema()["properties"]["resolution"]["minimum"]
    1
    """
    from padgen.spec.load import spec_schema as schema

    return schema()
