"""The one door to build123d and OCCT: a quicker import, and their errors as `GeometryError`.

Half of the time that build123d takes to be imported goes into libraries that it needs for a few functions which
padgen never calls: drawing SVG, optimising curves, hulls, recognising primitives in foreign meshes. While it is
imported placeholders stand in for them; those functions still work, since a placeholder fetches the real module when
something of it is used.
"""

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType
from typing import Any

from padgen.core.errors import GeometryError

__all__ = ["build123d", "kernel_errors"]

DEFERRED = ("scipy.optimize", "scipy.spatial", "sklearn", "sklearn.cluster", "svgpathtools")


class _Later:
    """Stands in for a module's function or class until it is called or asked for something."""

    def __init__(self, module: str, name: str) -> None:
        self._at = module, name

    def _real(self) -> Any:
        return getattr(importlib.import_module(self._at[0]), self._at[1])

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self._real()(*args, **kwargs)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real(), name)

    def __or__(self, other: object) -> Any:
        return self  # in a hint of types only


class _Deferred(ModuleType):
    """Stands in for a module of which nothing is used but later."""

    def __getattr__(self, name: str) -> _Later:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Later(self.__name__, name)


@contextmanager
def _deferred() -> Iterator[None]:
    """Let imports of `DEFERRED` succeed at once within the block, where they were not imported yet."""
    added = [name for name in DEFERRED if name not in sys.modules]
    for name in added:
        sys.modules[name] = _Deferred(name)
    try:
        yield
    finally:
        for name in added:
            sys.modules.pop(name, None)


@cache
def build123d() -> Any:
    """The build123d package, imported at the first call.

    Raises
    ------
    GeometryError
        build123d or one of its libraries is missing or broken.
    """
    try:
        with _deferred():
            return importlib.import_module("build123d")
    except ImportError as error:
        if _interrupted(error):
            raise KeyboardInterrupt from error
        raise GeometryError(f"build123d cannot be imported ({error}); install padgen again") from error


def _interrupted(error: BaseException | None) -> bool:
    """Whether an import failed because of Ctrl-C: a library's start-up turns that into an ImportError."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt) or "initialization failed" in str(error):
            return True
        error = error.__cause__ or error.__context__
    return False


@contextmanager
def kernel_errors(what: str) -> Iterator[None]:
    """Turn whatever OCCT or build123d raises within the block into a `GeometryError` about `what`."""
    try:
        yield
    except Exception as error:
        if not _from_kernel(error):
            raise
        text = str(error).strip().splitlines()
        raise GeometryError(f"the CAD kernel refused {what} ({text[0] if text else type(error).__name__})") from error


def _from_kernel(error: Exception) -> bool:
    """OCCT's exceptions derive from Exception alone; build123d raises Python's own."""
    if isinstance(error, (RuntimeError, ValueError, TypeError, AttributeError, IndexError)):
        return True
    return type(error).__module__.partition(".")[0] == "OCP"
