"""Suspensions, one file each, found by the file's name; others are added by `register`.

A suspension holds to `Suspension`. Planner, solid, finite elements, measuring-back and checks take all they know of
a taxel's shape from the `Arrangement` that it makes: beams as paths of straight pieces and arcs, blocks, a window.
Its functions take numbers or arrays, so that one call lays out a whole grid of candidates.
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

    An `ORDER` may say when the planner tries it, the lowest first; those without one come last, and one of None is
    planned only where a spec names it.
    """

    END_FACTOR: float
    """c of the point-mass rule ``k = c E w t³/l³`` of one beam."""
    BEAMS: int
    """How many beams share the load."""

    def longest(self, room: Room, plate: PlateShape, gap_mm: float) -> float:
        """Longest beam in mm that `room` holds, negative when none does."""

    def widest(self, room: Room, plate: PlateShape, gap_mm: float) -> float:
        """Widest beam in mm that `room` holds, negative when none does: at any length up to the longest."""

    def shortest(self, plate: PlateShape, gap_mm: float) -> float:
        """Shortest beam in mm."""

    def arrange(self, plate: PlateShape, beam: BeamShape, gap_mm: float) -> Arrangement:
        """Beams, blocks and window in mm for one beam shape, or for arrays of them.

        Every path is as long as `beam` says; `gap_mm` is kept between all that moves and the frame.
        """


def register(name: str, suspension: Suspension) -> None:
    """Add a suspension, which specs may name from then on and ``auto`` tries.

    Raises
    ------
    SpecError
        The name is taken or no name, or the suspension lacks something.
    """
    SUSPENSIONS.register(name, suspension, Suspension)


def unregister(name: str) -> None:
    """Take away a suspension that was registered."""
    SUSPENSIONS.unregister(name)


def names() -> tuple[str, ...]:
    """Names of all suspensions, none of which is imported for it."""
    return SUSPENSIONS.names()


def suspension(name: str) -> Suspension:
    """The suspension of that name.

    Raises
    ------
    SpecError
        There is none.
    """
    found: Suspension = SUSPENSIONS.get(name, "suspension.topology")
    return found


def allowed(topology: str) -> list[str]:
    """Names that a spec's `topology` stands for: with ``auto`` those with an order, as they are tried."""
    if topology in SUSPENSIONS.families():
        return [name for name in names() if name.rpartition("-")[0] == topology]
    if topology != "auto":
        return [topology]
    orders = {name: getattr(suspension(name), "ORDER", inf) for name in names()}
    return sorted((name for name in orders if orders[name] is not None), key=lambda name: orders[name])
