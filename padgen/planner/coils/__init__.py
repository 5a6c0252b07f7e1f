"""Kinds of coil, one file each, named by the file; `register` adds others.

A kind follows `CoilKind`: from the `[coil]` table of a spec it makes the `CoilSource` of the physics, coaxial windings
round an optional core. Everything else about a coil is the same for every kind.
"""

from typing import Protocol

from padgen.core.registry import COILS
from padgen.physics.magnetics import CoilSource, Winding
from padgen.spec import Coil

__all__ = ["CoilKind", "CoilSource", "Winding", "coil_source", "register", "unregister"]


class CoilKind(Protocol):
    """A kind of coil: a module, or any object, whose `source` makes windings and core from a spec's coil table."""

    def source(self, coil: Coil) -> CoilSource:
        """Return windings and core in m, heights from the top face; raise SpecError for fields that make no coil."""


register = COILS.register
unregister = COILS.unregister


def coil_source(coil: Coil) -> CoilSource:
    """Return the windings and the core of a spec's coil, in m.

    Raises
    ------
    SpecError
        There is no such kind, or the fields make no coil of this kind.
    """
    return COILS.get(coil.kind, "coil.kind").source(coil)
