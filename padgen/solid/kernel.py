"""The one door to build123d and OCCT: a quicker import, and their errors as `GeometryError`.

build123d imports scikit-learn for one function that recognises primitives in foreign meshes; that
is 40 % of its import and padgen never calls it. While build123d is imported, a placeholder stands
in for ``sklearn.cluster``; the function still works, since the placeholder fetches the real module
when it is called.
"""

import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType
from typing import Any

from padgen.core.errors import GeometryError

__all__ = ["build123d", "kernel_errors"]

DEFERRED = "sklearn.cluster"


class _Deferred(ModuleType):
    """Stands in for a module whose functions are only called later."""

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("__"):
            raise AttributeError(name)

        def call(*args: Any, **kwargs: Any) -> Any:
            return getattr(importlib.import_module(self.__name__), name)(*args, **kwargs)

        return call


@contextmanager
def _deferred(name: str) -> Iterator[None]:
    """Let ``import name`` succeed at once within the block, if it was not imported yet."""
    package = name.partition(".")[0]
    added = [part for part in (package, name) if part not in sys.modules]
    if name in sys.modules:
        added = []
    for part in added:
        sys.modules[part] = _Deferred(part)
    try:
        yield
    finally:
        for part in added:
            sys.modules.pop(part, None)


@cache
def build123d() -> Any:
    """The build123d package, imported at the first call.

    Raises
    ------
    GeometryError
        build123d or one of its libraries is missing or broken.
    """
    try:
        with _deferred(DEFERRED):
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
