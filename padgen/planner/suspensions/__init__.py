"""Suspensions, one file each, named by the file; `register` adds others.

A suspension follows the protocol `Suspension`. Planner, solid, finite elements and checks know a taxel's shape only by
the `Arrangement` that the suspension makes: beams as paths of straight pieces and arcs, blocks, a window. Its functions
take numbers or arrays, so that one call lays out a whole grid of candidates.
"""

from math import inf
from typing import Protocol

from padgen.core.registry import SUSPENSIONS
from padgen.planner.arrangement import (
    Arrangement,
    BeamPath,
    BeamShape,
    Block,
    PathPoint,
    PlateShape,
    Room,
    Segment,
    arc,
)

__all__ = [
    "Arrangement",
    "BeamPath",
    "BeamShape",
    "Block",
    "PathPoint",
    "PlateShape",
    "Room",
    "Segment",
    "Suspension",
    "allowed",
    "arc",
    "names",
    "register",
    "suspension",
    "unregister",
]


class Suspension(Protocol):
    """A kind of suspension: a module, or any object, with these names.

    It may have an `ORDER`: the planner tries the lowest first, suspensions without it last, and those with None only
    where a spec names them.
    """

    END_FACTOR: float
    """Factor c of the point-mass rule ``k = c E w t³/l³`` for one beam."""
    BEAMS: int
    """Number of beams that share the load."""

    def longest(self, room: Room, plate: PlateShape, gap_mm: float) -> float:
        """Return the length in mm of the longest beam in `room`; negative where no beam fits."""

    def widest(self, room: Room, plate: PlateShape, gap_mm: float) -> float:
        """Return the largest width in mm that beams of every length may have in `room`; negative where no beam fits."""

    def shortest(self, plate: PlateShape, gap_mm: float) -> float:
        """Return the length in mm of the shortest beam."""

    def arrange(self, plate: PlateShape, beam: BeamShape, gap_mm: float) -> Arrangement:
        """Return beams, blocks and window in mm for one beam shape, or for arrays of them.

        Every path has the length of `beam`; `gap_mm` is the gap between moving parts and frame.
        """


register, unregister = SUSPENSIONS.register, SUSPENSIONS.unregister


def names() -> tuple[str, ...]:
    """Return the names of all suspensions, without importing them."""
    return SUSPENSIONS.names()


def suspension(name: str) -> Suspension:
    """Return the suspension called `name`.

    Raises
    ------
    SpecError
        There is none of that name.
    """
    found: Suspension = SUSPENSIONS.get(name, "suspension.topology")
    return found


def allowed(topology: str) -> list[str]:
    """Return the names of the suspensions that a spec's `topology` allows, in the order in which they are tried.

    A family such as 'serpentine' allows its members, ``auto`` all whose `ORDER` is not None.
    """
    if topology in SUSPENSIONS.families():
        return [name for name in names() if name.rpartition("-")[0] == topology]
    if topology != "auto":
        return [topology]
    orders = {name: getattr(suspension(name), "ORDER", inf) for name in names()}
    return sorted((name for name in orders if orders[name] is not None), key=lambda name: orders[name])
