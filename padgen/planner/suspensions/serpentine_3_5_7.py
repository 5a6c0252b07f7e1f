"""A beam folded in its plane into legs across the window: softer than a straight beam of the same thickness.

::

         window
    +----------------------+
    |  __      +-------+   |
    | |  |     | plate |   |     three legs of width w, a gap between them
    |=+  |  +==|   O   |   |     O: washer below, boss above
    |    |  |  |       |   |
    |    +--+  +-------+   |     (all corners are round)
    +----------------------+
    root (x = 0)

The legs bend and twist. So the resonance depends less on the thickness and more on the width than that of a straight
beam, and less on errors common to a print. Sideways the legs are as soft as up and down.
"""

from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar

import numpy as np

from padgen.planner.suspensions import Arrangement, BeamPath, BeamShape, Block, PlateShape, Room, Segment, arc

__all__ = ["Serpentine", "member"]

WIDEST_SHARE = 0.2
"""Largest width of the beam over the plate's: a wider beam would have hardly any legs."""


@dataclass(frozen=True)
class Serpentine:
    """A beam folded into an odd number of `legs` across the window; the first and last span only half of it.

    All bends have the radius that leaves the smallest gap between legs, so that each leg takes up the beam's width and
    one gap along the window.
    """

    legs: int
    ORDER: ClassVar[None] = None
    END_FACTOR: ClassVar[float] = 0.25
    """Factor of the point-mass rule of the same beam, unfolded."""
    BEAMS: ClassVar[int] = 1

    def longest(self, room: Room, plate: PlateShape, gap_mm: float) -> float:
        """Return the length in mm of the longest beam at the largest width; narrower beams may be as long, too."""
        widest = self.widest(room, plate, gap_mm)
        out = room.width_mm / 2 - gap_mm - widest / 2 - (widest + gap_mm) / 2
        return self._length_mm(out, widest, gap_mm) if widest >= 0 else -1.0

    def widest(self, room: Room, plate: PlateShape, gap_mm: float) -> float:
        """Return the largest width in mm with which all legs fit between root and plate; negative where none does.

        It is at most `WIDEST_SHARE` of the plate's width.
        """
        if plate.width_mm + 2 * gap_mm > room.width_mm + 1e-9 or plate.length_mm / 2 + gap_mm > room.behind_washer_mm:
            return -1.0
        along = min(room.length_mm - plate.length_mm - gap_mm, room.before_washer_mm - plate.length_mm / 2)
        return min((along - gap_mm) / self.legs - gap_mm, WIDEST_SHARE * plate.width_mm)

    def shortest(self, plate: PlateShape, gap_mm: float) -> float:
        """Return the shortest beam length in mm: the widest beam's first leg is then straight over just `gap_mm`."""
        widest = WIDEST_SHARE * plate.width_mm
        return float(self._length_mm((widest + gap_mm) / 2 + gap_mm, widest, gap_mm))

    def arrange(self, plate: PlateShape, beam: BeamShape, gap_mm: float) -> Arrangement:
        """Return the geometry in mm (beam, moving block, frame opening) for one beam shape, or for arrays of them."""
        radius = (beam.width_mm + gap_mm) / 2 + 0.0 * beam.length_mm
        zero = 0.0 * beam.length_mm
        out = (beam.length_mm - self._length_mm(zero, beam.width_mm, gap_mm)) / (2 * (self.legs - 1))
        stub = Segment(zero + gap_mm / 2)
        half = Segment(out - radius)
        across = Segment(2 * out)
        segments = [stub, arc(radius, 90), half]
        for leg in range(1, self.legs):
            segments += [arc(radius, 180 if leg % 2 == 0 else -180), across if leg < self.legs - 1 else half]
        path = BeamPath((zero, zero), (1.0, 0.0), (*segments, arc(radius, -90), stub), beam.width_mm, beam.thickness_mm)
        begin = 2 * self.legs * radius + gap_mm
        side = plate.width_mm / 2
        reach: Any = out + radius + beam.width_mm / 2
        return Arrangement(
            beams=(path,),
            blocks=(Block(begin, begin + plate.length_mm, -side, side, plate.thickness_mm),),
            window_mm=(begin + plate.length_mm + gap_mm, 2 * (np.maximum(side, reach) + gap_mm)),
            washer_x_mm=begin + plate.length_mm / 2,
            root_clearance_mm=zero,
        )

    def _length_mm(self, out_mm: Any, width_mm: Any, gap_mm: float) -> Any:
        """Return the length in mm of a beam whose outer bends are centred `out_mm` off the window's centre line."""
        radius = (width_mm + gap_mm) / 2
        return gap_mm + (self.legs * pi - 2) * radius + 2 * (self.legs - 1) * out_mm


def member(legs: int) -> Serpentine:
    """Return the serpentine with this number of legs."""
    return Serpentine(legs)
