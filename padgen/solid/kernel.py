"""Import build123d with its CAD kernel OCCT faster than usual, and turn their errors into `GeometryError`.

Half of build123d's import time goes into libraries for functions that padgen never calls: drawing SVG, optimising
curves, hulls, recognising primitives in foreign meshes. During the import, placeholders stand in for these libraries.
A placeholder fetches the real module when it is used, so the functions still work.
"""

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType
from typing import Any

from padgen.core.errors import GeometryError
from padgen.core.runner import interrupted_later

__all__ = ["build123d", "kernel_errors"]

DEFERRED = ("scipy.optimize", "scipy.spatial", "sklearn", "sklearn.cluster", "svgpathtools")


class _Later:
    """Placeholder of a module's function or class, which is imported when the placeholder is first used."""

    def __init__(self, module: str, name: str) -> None:
        self._at = module, name

    def _real(self) -> Any:
        return getattr(importlib.import_module(self._at[0]), self._at[1])

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self._real()(*args, **kwargs)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real(), name)

    def __or__(self, other: object) -> Any:
        return self  # "A | B" occurs in type hints only


class _Deferred(ModuleType):
    """Placeholder of a module that build123d imports but does not use while it is being imported."""

    def __getattr__(self, name: str) -> _Later:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Later(self.__name__, name)


@cache
def build123d() -> Any:
    """Return the build123d package, imported at the first call.

    Raises
    ------
    GeometryError
        build123d or one of its libraries is missing or broken.
    """
    added = [name for name in DEFERRED if name not in sys.modules]
    try:
        with interrupted_later():  # a compiled module that is interrupted while it sets itself up may crash
            for name in added:
                sys.modules[name] = _Deferred(name)
            return importlib.import_module("build123d")
    except ImportError as error:
        raise GeometryError(f"build123d cannot be imported ({error}); install padgen again") from error
    finally:
        for name in added:
            sys.modules.pop(name, None)


@contextmanager
def kernel_errors(what: str) -> Iterator[None]:
    """Turn whatever OCCT or build123d raises within the block into a `GeometryError` about `what`."""
    try:
        yield
    except Exception as error:
        # OCCT has exceptions of its own, build123d raises Python's.
        pythons = (RuntimeError, ValueError, TypeError, AttributeError, IndexError)
        if not isinstance(error, pythons) and type(error).__module__.partition(".")[0] != "OCP":
            raise
        text = str(error).strip().splitlines()
        raise GeometryError(f"the CAD kernel refused {what} ({text[0] if text else type(error).__name__})") from error
