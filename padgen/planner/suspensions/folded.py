"""Two beams alongside the plate, joined to it by a crossbar at their tips.

::

    +-----------------------+
    |===================+-+ |     two beams of width w and length l
    |  +-----------+    | | |     crossbar at the tips
    |  |   plate   |----+ | |
    |  |       O   |neck  | |     O: washer below, boss above, at x = l/2
    |  +-----------+----+ | |
    |===================+-+ |
    +-----------------------+
    root (x = 0)

A force at half the beams' length does not turn the tips. The plate reaches further to the root side, so that the centre
of the moving mass is at half the length, too. The plate then moves like a piston and its pitch mode is not excited.
"""

from typing import Any

import numpy as np

from padgen.planner.suspensions import Arrangement, BeamPath, BeamShape, Block, PlateShape, Room, Segment, Yoke

__all__ = ["BEAMS", "END_FACTOR", "ORDER", "arrange", "longest", "shortest", "widest"]

ORDER = 2
END_FACTOR = 1.0
BEAMS = 2
CROSSBAR_MM = 0.8
CROSSBAR_HEIGHT_MM = 0.8
CROSSBAR_HEIGHT_PER_BEAM = 2.5
"""Height of the crossbar over the beams' thickness: much stiffer than the beams, and still light."""


def longest(room: Room, plate: PlateShape, gap_mm: float) -> float:
    """Return the length in mm of the longest beam; negative where none fits."""
    end = CROSSBAR_MM + gap_mm
    return min(room.length_mm - end, 2 * room.before_washer_mm, 2 * (room.behind_washer_mm - end))


def widest(room: Room, plate: PlateShape, gap_mm: float) -> float:
    """Return the largest width of a beam in mm: half of what plate and four gaps leave of the room's width."""
    return (room.width_mm - plate.width_mm - 4 * gap_mm) / 2


def shortest(plate: PlateShape, gap_mm: float) -> float:
    """Return the length in mm of the shortest beam: the plate and, at each end, two gaps (one for the fillets)."""
    return plate.length_mm + 4 * gap_mm


def arrange(plate: PlateShape, beam: BeamShape, gap_mm: float) -> Arrangement:
    """Return the geometry in mm (beams, moving blocks, frame opening) for one beam shape, or for arrays of them."""
    length: Any = beam.length_mm
    zero = 0.0 * length
    half = plate.width_mm / 2
    middle = length / 2
    y = half + gap_mm + beam.width_mm / 2
    outside = y + beam.width_mm / 2
    height = np.minimum(
        plate.thickness_mm, np.maximum(CROSSBAR_HEIGHT_MM, CROSSBAR_HEIGHT_PER_BEAM * beam.thickness_mm)
    )
    back = _reach_to_root_mm(plate, middle, outside, height / plate.thickness_mm)
    low_x = middle - np.clip(back, plate.length_mm / 2, middle - 2 * gap_mm)
    high_x = middle + plate.length_mm / 2
    return Arrangement(
        beams=tuple(
            BeamPath((zero, side * y), (1.0, 0.0), (Segment(length),), beam.width_mm, beam.thickness_mm)
            for side in (-1, 1)
        ),
        blocks=(
            Block(low_x, high_x, -half, half, plate.thickness_mm),
            Block(high_x, length, -half / 2, half / 2, height),
            Block(length, length + CROSSBAR_MM, -outside, outside, height),
        ),
        window_mm=(length + CROSSBAR_MM + gap_mm, 2 * (outside + gap_mm)),
        washer_x_mm=middle,
        root_clearance_mm=zero + gap_mm / 2,
        yoke=Yoke(half / 2 + gap_mm, CROSSBAR_MM, height, length - high_x, half),
    )


def _reach_to_root_mm(plate: PlateShape, middle: Any, outside: Any, lightness: Any) -> Any:
    """Return how far in mm the plate must extend from the washer towards the beams' root to balance the crossbar.

    `outside` is half of the crossbar's length, `lightness` the height of neck and crossbar over the plate's.
    """
    front = plate.length_mm / 2
    neck = (middle**2 - front**2) / 2
    crossbar = 4 * outside / plate.width_mm * CROSSBAR_MM * (middle + CROSSBAR_MM / 2)
    return np.sqrt(front**2 + lightness * (neck + crossbar))
