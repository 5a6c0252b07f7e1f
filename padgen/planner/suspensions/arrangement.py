"""The nouns that all suspensions share: what moves, what bends and the window it needs."""

from math import inf
from typing import Any, NamedTuple

__all__ = ["Arrangement", "BeamShape", "Block", "PlateShape", "Room", "Strip"]

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
    """Dimensions that tune a channel, in mm."""

    width_mm: Number
    thickness_mm: Number
    length_mm: Number


class Strip(NamedTuple):
    """A straight beam along x at height `y_mm`, flush with the bottom, from root to tip.

    The root is on the frame; ``tip_x_mm < root_x_mm`` is a beam that points back.
    """

    root_x_mm: Number
    tip_x_mm: Number
    y_mm: Number
    width_mm: Number
    thickness_mm: Number


class Block(NamedTuple):
    """A moving block on the bottom, by its corners and its height."""

    low_x_mm: Number
    high_x_mm: Number
    low_y_mm: Number
    high_y_mm: Number
    height_mm: Number


class Arrangement(NamedTuple):
    """A suspended plate in its own axes: beams along x, root side at x = 0, symmetric about y = 0.

    `window_mm` is (length, width) of the opening in the frame, from x = 0 and centred in y;
    `washer_x_mm` the place of washer and boss on y = 0; `root_clearance_mm` the room beside a root
    that its fillets may take. `tip_twist_per_mm3` is the arm over the torsion constant of what a tip
    is joined to, 0 where it is the plate itself.
    """

    beams: tuple[Strip, ...]
    blocks: tuple[Block, ...]
    window_mm: tuple[Number, Number]
    washer_x_mm: Number
    root_clearance_mm: Number
    tip_twist_per_mm3: Number = 0.0
