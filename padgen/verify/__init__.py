"""Finer models than a plan's: finite elements, magnetic fields, time domain.

Every model here is a rung of a ladder, with its error and its cost (`padgen study`). Heavy packages
are imported by the functions that use them.
"""

import importlib.util
from typing import Any

from padgen.core.errors import EngineMissingError

__all__ = [
    "Engine",
    "mpmath",
    "ng",
    "occ",
    "require",
]


def require(name: str) -> None:
    """Raise `EngineMissingError` if the optional package `name` is not installed, without importing it."""
    if importlib.util.find_spec(name) is None:
        raise _missing(name, "it is not installed")


def _missing(name: str, why: str) -> EngineMissingError:
    package = name.partition(".")[0]
    return EngineMissingError(f"needs the package {package} ({why}); pip install 'padgen[study]' brings it", "model")


class Engine:
    """An optional package that is imported when one of its names is first asked for.

    Raises
    ------
    EngineMissingError
        It is not installed, or cannot be loaded; the message names the extra that brings it.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # who looks at all modules' names must not load it
            raise AttributeError(name)
        try:
            return getattr(importlib.import_module(self._name), name)
        except ImportError as error:
            raise _missing(self._name, str(error)) from error


ng, occ, mpmath = (Engine(name) for name in ("ngsolve", "netgen.occ", "mpmath"))
