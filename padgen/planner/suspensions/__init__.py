"""Suspensions, one file each, named by the file; `register` adds others.

A suspension follows the protocol `Suspension`. Planner, solid, finite elements and checks know a taxel's shape only by
the `Arrangement` that the suspension makes: beams as paths of straight pieces and arcs, blocks, a window. Its functions
take numbers or arrays, so that one call lays out a whole grid of candidates.
"""

from math import inf
from typing import Any, NamedTuple, Protocol

import numpy as np

from padgen.core.registry import SUSPENSIONS

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
    "Yoke",
    "allowed",
    "arc",
    "names",
    "register",
    "suspension",
    "unregister",
]

Number = Any
"""A float, or an array of candidates."""


class Room(NamedTuple):
    """Free space of a sub-cell between its ribs, in mm; the length is along the beams.

    So that the washer stays over its coil, it may lie at most `before_washer_mm` from the wall at the root, and at most
    `behind_washer_mm` from the other end of the window.
    """

    length_mm: float
    width_mm: float
    before_washer_mm: float = inf
    behind_washer_mm: float = inf


class PlateShape(NamedTuple):
    """The plate that carries boss and washer, in mm."""

    length_mm: float
    width_mm: float
    thickness_mm: float


class BeamShape(NamedTuple):
    """Dimensions of a channel's beams, in mm; the length is measured along the beam's path."""

    width_mm: Number
    thickness_mm: Number
    length_mm: Number


class Segment(NamedTuple):
    """A piece of a path: straight, or an arc that turns by `turn_rad` over its length (positive: to the left)."""

    length_mm: Number
    turn_rad: Number = 0.0


def arc(radius_mm: Number, turn_deg: Number) -> Segment:
    """Return an arc of a radius in mm that turns by an angle in degrees (positive: to the left)."""
    turn = np.radians(turn_deg)
    return Segment(radius_mm * np.abs(turn), turn)


class BeamPath(NamedTuple):
    """A beam along a path of straight pieces and arcs from its root to its tip, flush with the pad's bottom.

    ::

                 tip, on the moving body
             |  |
             |  |
        _____/  |     w: width, half of it on each side of the path
        ->_____/      an arc needs a radius of w/2 at least
        root, on the frame, in `direction`

    The path has no corners. A first piece that is straight is flared at the root.
    """

    root_mm: tuple[Number, Number]
    direction: tuple[float, float]
    segments: tuple[Segment, ...]
    width_mm: Number
    thickness_mm: Number

    @property
    def length_mm(self) -> Number:
        """Length along the path."""
        return sum(segment.length_mm for segment in self.segments)

    @property
    def is_straight(self) -> bool:
        """True where no segment of the path turns."""
        return not any(np.any(segment.turn_rad) for segment in self.segments)

    @property
    def corners(self) -> "list[PathPoint]":
        """Start points of the segments, from the root on, and the tip."""
        points = [PathPoint(*self.root_mm, *self.direction)]
        for segment in self.segments:
            points.append(points[-1].along(segment))
        return points

    def within(self, index: int, share: Number) -> "PathPoint":
        """Return the point at a `share` (0 … 1) of the length of segment `index`."""
        segment = self.segments[index]
        return self.corners[index].along(Segment(share * segment.length_mm, share * segment.turn_rad))


class PathPoint(NamedTuple):
    """A place on a path in mm, and the unit vector of the path's direction there."""

    x_mm: Number
    y_mm: Number
    along_x: Number
    along_y: Number

    def along(self, segment: Segment) -> "PathPoint":
        """Return the point at the end of a segment that begins here."""
        length, turn = segment
        # The chord of an arc lies at half of the arc's turn.
        half = turn / 2
        chord = length * np.sinc(half / np.pi)
        c = np.cos(half)
        s = np.sin(half)
        x, y = self.along_x, self.along_y
        turned = (np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y)
        return PathPoint(self.x_mm + chord * (c * x - s * y), self.y_mm + chord * (s * x + c * y), *turned)

    def beside(self, left_mm: Number) -> tuple[Number, Number]:
        """Return the place (x, y) in mm at a distance to the left of the path."""
        return self.x_mm - left_mm * self.along_y, self.y_mm + left_mm * self.along_x


class Block(NamedTuple):
    """A moving block that stands on the pad's bottom: the corners of its rectangle and its height."""

    low_x_mm: Number
    high_x_mm: Number
    low_y_mm: Number
    high_y_mm: Number
    height_mm: Number


class Yoke(NamedTuple):
    """The yoke that joins the tips of two beams to the plate between them: a crossbar, and a neck to the plate.

    `arm_mm` is the free length of the crossbar between a beam and the neck, `bar_width_mm` its width along the beams;
    crossbar and neck have one height.
    """

    arm_mm: Number
    bar_width_mm: Number
    height_mm: Number
    neck_length_mm: Number
    neck_width_mm: Number


class Arrangement(NamedTuple):
    """Geometry of a suspended plate in its own axes: x from the wall at the root, y from the window's centre line.

    `window_mm` is (length, width) of the opening in the frame; the roots lie on its edge. Washer and boss are at
    x = `washer_x_mm`, y = 0. A root's fillets may be as large as `root_clearance_mm`. With a `yoke` between beams and
    plate, `blocks` are plate, neck and crossbar.
    """

    beams: tuple[BeamPath, ...]
    blocks: tuple[Block, ...]
    window_mm: tuple[Number, Number]
    washer_x_mm: Number
    root_clearance_mm: Number
    yoke: Yoke | tuple[()] = ()


class Suspension(Protocol):
    """A kind of suspension: a module, or any object, with the members below.

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
        """Return the largest beam width in mm that fits `room` at every length; negative where no beam fits."""

    def shortest(self, plate: PlateShape, gap_mm: float) -> float:
        """Return the length in mm of the shortest beam."""

    def arrange(self, plate: PlateShape, beam: BeamShape, gap_mm: float) -> Arrangement:
        """Return the geometry in mm (beams, moving blocks, frame opening) for one beam shape, or for arrays of them.

        Every path has the length of `beam`; `gap_mm` is the gap between moving parts and frame.
        """


register = SUSPENSIONS.register
unregister = SUSPENSIONS.unregister
names = SUSPENSIONS.names


def suspension(name: str) -> Suspension:
    """Return the suspension called `name`.

    Raises
    ------
    SpecError
        There is none of that name.
    """
    return SUSPENSIONS.get(name, "suspension.topology")


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
