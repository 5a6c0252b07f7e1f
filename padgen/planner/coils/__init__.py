"""Kinds of coil, one file each, found by the file's name; others are added by `register`.

A kind holds to `CoilKind`: it makes of the `[coil]` table of a spec the `CoilSource` that the physics works with,
coaxial windings round an optional core. Everything else about a coil is the same for every kind.
"""

from typing import Protocol

from padgen.core.registry import COILS
from padgen.physics.magnetics import CoilSource, Winding
from padgen.spec import Coil

__all__ = ["CoilKind", "CoilSource", "Winding", "coil_source", "register", "unregister"]


class CoilKind(Protocol):
    """A kind of coil: a module, or any object, with this name."""

    def source(self, coil: Coil) -> CoilSource:
        """The windings and the core, in m, heights over the top face; may raise SpecError of fields that make none."""


def register(name: str, kind: CoilKind) -> None:
    """Add a kind of coil, which specs may name from then on.

    Raises
    ------
    SpecError
        The name is taken or no name, or the kind lacks something.
    """
    COILS.register(name, kind, CoilKind)


def unregister(name: str) -> None:
    """Take away a kind of coil that was registered."""
    COILS.unregister(name)


def coil_source(coil: Coil) -> CoilSource:
    """What a spec's coil is to its field.

    Raises
    ------
    SpecError
        There is no such kind, or its fields make no coil of it.
    """
    kind: CoilKind = COILS.get(coil.kind, "coil.kind")
    return kind.source(coil)
