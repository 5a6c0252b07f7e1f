"""The nouns that all suspensions share: what moves, what bends and the window it needs."""

from math import inf
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "Arrangement",
    "BeamPath",
    "BeamShape",
    "Block",
    "PathPoint",
    "PlateShape",
    "Room",
    "Segment",
    "Yoke",
    "arc",
]

Number = Any
"""A float, or an array of candidates."""


class Room(NamedTuple):
    """What a sub-cell leaves between its ribs, in mm.

    `before_washer_mm` and `behind_washer_mm` limit how far the washer may lie from the wall at the
    root and from the other end of the window, so that it stays over its coil.
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
    """Dimensions that tune a channel, in mm; the length is that of the path."""

    width_mm: Number
    thickness_mm: Number
    length_mm: Number


class Segment(NamedTuple):
    """A piece of a path: straight, or an arc that turns by `turn_rad` (to the left, if positive) on its length."""

    length_mm: Number
    turn_rad: Number = 0.0


def arc(radius_mm: Number, turn_deg: Number) -> Segment:
    """An arc about a centre `radius_mm` away, to the left for a positive turn."""
    turn = np.radians(turn_deg)
    return Segment(radius_mm * np.abs(turn), turn)


class BeamPath(NamedTuple):
    """A beam, flush with the bottom, along a path of straight pieces and arcs from its root to its tip.

    ::

                 tip, on what moves
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
        """Whether nothing of the path turns."""
        return not any(np.any(segment.turn_rad) for segment in self.segments)

    @property
    def corners(self) -> "list[PathPoint]":
        """Where segments begin, from the root, and the tip."""
        points = [PathPoint(*self.root_mm, *self.direction)]
        for segment in self.segments:
            points.append(points[-1].along(segment))
        return points

    def within(self, index: int, share: Number) -> "PathPoint":
        """The point at a `share` of the length of one segment."""
        segment = self.segments[index]
        return self.corners[index].along(Segment(share * segment.length_mm, share * segment.turn_rad))


class PathPoint(NamedTuple):
    """A place on a path in mm, and the unit vector along the path there."""

    x_mm: Number
    y_mm: Number
    along_x: Number
    along_y: Number

    def along(self, segment: Segment) -> "PathPoint":
        """The point at the end of a segment that begins here."""
        length, turn = segment
        # The chord of an arc: its length, and half of the turn.
        half = turn / 2
        chord, c, s = length * np.sinc(half / np.pi), np.cos(half), np.sin(half)
        x, y = self.along_x, self.along_y
        turned = (np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y)
        return PathPoint(self.x_mm + chord * (c * x - s * y), self.y_mm + chord * (s * x + c * y), *turned)

    def beside(self, left_mm: Number) -> tuple[Number, Number]:
        """The place so far to the left of the path."""
        return self.x_mm - left_mm * self.along_y, self.y_mm + left_mm * self.along_x


class Block(NamedTuple):
    """A moving block on the bottom, by its corners and its height."""

    low_x_mm: Number
    high_x_mm: Number
    low_y_mm: Number
    high_y_mm: Number
    height_mm: Number


class Yoke(NamedTuple):
    """The yoke from two beams' tips to the plate between: a crossbar, `arm_mm` of it free between beam and neck, wide
    along the beams, as high as the neck that carries the plate."""

    arm_mm: Number
    bar_width_mm: Number
    height_mm: Number
    neck_length_mm: Number
    neck_width_mm: Number


class Arrangement(NamedTuple):
    """A suspended plate in its own axes: root side at x = 0, window centred in y.

    `window_mm` is (length, width) of the opening in the frame; roots lie on its edge. `washer_x_mm` is
    the place of washer and boss on y = 0; `root_clearance_mm` the room beside a root
    that its fillets may take. Where the tips are joined to a `yoke` and not to the plate itself, `blocks` are plate,
    neck and crossbar.
    """

    beams: tuple[BeamPath, ...]
    blocks: tuple[Block, ...]
    window_mm: tuple[Number, Number]
    washer_x_mm: Number
    root_clearance_mm: Number
    yoke: Yoke | tuple[()] = ()
