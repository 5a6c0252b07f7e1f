"""Kinds of coil, one file each, named by the file; `register` adds others.

A kind follows `CoilKind`: from the `[coil]` table of a spec it makes the `CoilSource` of the physics, coaxial windings
round an optional core. Everything else about a coil is the same for every kind, but for what a kind may have besides
(`padgen.planner.coils.board` has all of it):

| function | what for |
|---|---|
| `completed(given)` | the coil of the fields of a `[coil]` table, with those that follow from others |
| `given_fields(coil)` | the fields of which `completed` makes this coil, for cures that change one of them |
| `beside_mm(coil, rows)` | the gaps in mm that coils need between them, along x and along y |
| `widest_mm(coil, pad, rows, columns)` | the largest sides in mm, along x and y, for which the pad has room |
| `narrowest_mm(coil)` | the least side in mm of such a coil |
| `resized(coil, sides_mm)` | the same coil with other sides: of kinds with this the search finds them |
"""

from typing import Protocol

from padgen.core.registry import COILS
from padgen.physics.magnetics import CoilSource, Winding
from padgen.spec import Coil

__all__ = ["CoilKind", "CoilSource", "Winding", "coil_source", "register", "unregister", "without_sizes"]


class CoilKind(Protocol):
    """A kind of coil: a module, or any object, whose `source` makes windings and core from a spec's coil table."""

    def source(self, coil: Coil) -> CoilSource:
        """Return windings and core in m, heights from the top face; raise SpecError for fields that make no coil."""


register = COILS.register
unregister = COILS.unregister


def without_sizes(coil: Coil) -> dict[str, None]:
    """Return the change of a spec that leaves the sizes of a coil, whose kind is resizable, to the search."""
    sizes = ["outer_diameter_mm"] if coil.outer_depth_mm is None else ["outer_diameter_mm", "outer_depth_mm"]
    return dict.fromkeys(f"coil.{size}" for size in sizes)


def coil_source(coil: Coil) -> CoilSource:
    """Return the windings and the core of a spec's coil, in m.

    Raises
    ------
    SpecError
        There is no such kind, or the fields make no coil of this kind.
    """
    return COILS.get(coil.kind, "coil.kind").source(coil)
