"""Two guided beams on opposite sides of the plate, which moves like a piston: for high resonances.

::

    +-----------------------------+
    |        +-------+            |
    |   l    | plate |     l      |
    |========|   O   |============|      w: width of each beam
    |        |       |            |
    |        +-------+            |
    +-----------------------------+
    root (x = 0)              root

The plate is stiff in pitch. At large amplitudes the beams stretch and harden, and shrinkage of the print pulls them
tight, which raises the resonance.
"""

from typing import Any

import numpy as np

from padgen.planner.suspensions import Arrangement, BeamPath, BeamShape, Block, PlateShape, Room, Segment

__all__ = ["BEAMS", "END_FACTOR", "ORDER", "arrange", "longest", "shortest", "widest"]

ORDER = 3
END_FACTOR = 1.0
BEAMS = 2


def longest(room: Room, plate: PlateShape, gap_mm: float) -> float:
    """Return the length in mm of the longest beam; negative where none fits."""
    return min(room.length_mm / 2, room.before_washer_mm, room.behind_washer_mm) - plate.length_mm / 2


def widest(room: Room, plate: PlateShape, gap_mm: float) -> float:
    """Return the largest beam width in mm, which is the plate's width; -1 where the plate does not fit."""
    return plate.width_mm if plate.width_mm + 2 * gap_mm <= room.width_mm + 1e-9 else -1.0


def shortest(plate: PlateShape, gap_mm: float) -> float:
    """Return the length in mm of the shortest beam."""
    return 2 * gap_mm


def arrange(plate: PlateShape, beam: BeamShape, gap_mm: float) -> Arrangement:
    """Return the geometry in mm (beams, moving block, frame opening) for one beam shape, or for arrays of them."""
    length: Any = beam.length_mm
    half = plate.width_mm / 2
    whole = 2 * length + plate.length_mm
    zero = 0.0 * length
    window_width = np.maximum(plate.width_mm, beam.width_mm) + 2 * gap_mm
    return Arrangement(
        beams=(
            BeamPath((zero, zero), (1.0, 0.0), (Segment(length),), beam.width_mm, beam.thickness_mm),
            BeamPath((whole, zero), (-1.0, 0.0), (Segment(length),), beam.width_mm, beam.thickness_mm),
        ),
        blocks=(Block(length, length + plate.length_mm, -half, half, plate.thickness_mm),),
        window_mm=(whole, window_width),
        washer_x_mm=whole / 2,
        root_clearance_mm=(window_width - beam.width_mm - gap_mm) / 2,
    )
