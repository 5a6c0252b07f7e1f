"""A straight beam with the plate at its tip: the paper's suspension.

::

         window
    +--------------------+
    |        +-------+   |
    |   l    | plate | g |      g: gap
    |========|   O   |   |      O: washer below, boss above
    | w      |       |   |
    |        +-------+   |
    +--------------------+
    root (x = 0)
"""

from typing import Any

import numpy as np

from padgen.planner.suspensions import Arrangement, BeamPath, BeamShape, Block, PlateShape, Room, Segment

__all__ = ["BEAMS", "END_FACTOR", "ORDER", "arrange", "longest", "shortest", "widest"]

ORDER = 1
END_FACTOR = 0.25
BEAMS = 1


def longest(room: Room, plate: PlateShape, gap_mm: float) -> float:
    """Return the length in mm of the longest beam; -1 where the washer would not stay over its coil."""
    if plate.length_mm / 2 + gap_mm > room.behind_washer_mm:
        return -1.0
    return min(room.length_mm - plate.length_mm - gap_mm, room.before_washer_mm - plate.length_mm / 2)


def widest(room: Room, plate: PlateShape, gap_mm: float) -> float:
    """Return the largest beam width in mm, which is the plate's width; -1 where the plate does not fit."""
    fits = plate.width_mm + 2 * gap_mm <= room.width_mm + 1e-9
    return min(plate.width_mm, room.width_mm - 2 * gap_mm) if fits else -1.0


def shortest(plate: PlateShape, gap_mm: float) -> float:
    """Return the length in mm of the shortest beam."""
    return 2 * gap_mm


def arrange(plate: PlateShape, beam: BeamShape, gap_mm: float) -> Arrangement:
    """Return the geometry in mm (beam, moving block, frame opening) for one beam shape, or for arrays of them."""
    length: Any = beam.length_mm
    half = plate.width_mm / 2
    zero = 0.0 * length
    path = BeamPath((zero, zero), (1.0, 0.0), (Segment(length),), beam.width_mm, beam.thickness_mm)
    block = Block(length, length + plate.length_mm, -half, half, plate.thickness_mm)
    window_width = np.maximum(plate.width_mm, beam.width_mm) + 2 * gap_mm
    return Arrangement(
        beams=(path,),
        blocks=(block,),
        window_mm=(length + plate.length_mm + gap_mm, window_width),
        washer_x_mm=length + plate.length_mm / 2,
        root_clearance_mm=(window_width - beam.width_mm - gap_mm) / 2,
    )
