"""Choose the screw for a pad's holes, and the hole for it in the part below.

Sizes by ISO: clearance holes (273, fine), coarse threads (261: tapping drill = diameter − pitch),
nuts (4032), heads (4762, cylindrical with a hexagon socket), lengths (888). A machine screw cuts its
own thread in printed plastic when driven into a hole of the tapping drill's size.
"""

from typing import NamedTuple

__all__ = ["Screw", "screw_for"]


class Screw(NamedTuple):
    """A screw that goes from above through the pad into a part below.

    `head_mm` is the head's diameter. `hole_diameter_mm` and `hole_depth_mm` (from the top) are of the hole in the part
    below: a tapping hole, or, with a `nut`, a clearance hole all through.
    """

    name: str
    length_mm: float
    head_mm: float
    hole_diameter_mm: float
    hole_depth_mm: float
    nut: bool


class _Size(NamedTuple):
    name: str
    diameter_mm: float
    clearance_mm: float
    tapping_mm: float
    nut_mm: float
    head_mm: float


SIZES = (
    _Size("M1.6", 1.6, 1.7, 1.25, 1.3, 3.0),
    _Size("M2", 2.0, 2.2, 1.6, 1.6, 3.8),
    _Size("M2.5", 2.5, 2.7, 2.05, 2.0, 4.5),
    _Size("M3", 3.0, 3.2, 2.5, 2.4, 5.5),
    _Size("M4", 4.0, 4.3, 3.3, 3.2, 7.0),
    _Size("M5", 5.0, 5.3, 4.2, 4.7, 8.5),
    _Size("M6", 6.0, 6.4, 5.0, 5.2, 10.0),
    _Size("M8", 8.0, 8.4, 6.75, 6.8, 13.0),
    _Size("M10", 10.0, 10.5, 8.5, 8.4, 16.0),
    _Size("M12", 12.0, 13.0, 10.25, 10.8, 18.0),
)
LENGTHS_MM = (2, 2.5, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70)
GOOD_TURNS, LEAST_TURNS = 2.0, 1.5
"""Wanted and least depth of a screw in plastic, in screw diameters."""
TIP_MM = 1.0
"""Depth of a hole beyond the screw's tip, and least floor below a hole that does not go through."""


def screw_for(hole_mm: float, clamped_mm: float, below_mm: float) -> Screw | None:
    """Return the largest screw for a hole of `hole_mm` in a plate of `clamped_mm` on a part `below_mm` high.

    It is driven into the part below or, where that part is too low, goes through it into a nut. None where no metric
    screw passes the hole.
    """
    passing = [size for size in SIZES if size.clearance_mm <= hole_mm + 1e-9]
    if not passing:
        return None
    size = passing[-1]
    wanted = next(n for n in LENGTHS_MM if n >= clamped_mm + GOOD_TURNS * size.diameter_mm - 1e-9)
    for length in (n for n in reversed(LENGTHS_MM) if n <= wanted):
        held = length - clamped_mm
        if held < LEAST_TURNS * size.diameter_mm - 1e-9:
            break
        if held <= below_mm:
            depth = held + TIP_MM
            blind = depth + TIP_MM <= below_mm
            return Screw(size.name, float(length), size.head_mm, size.tapping_mm, depth if blind else below_mm, False)
    through = next(n for n in LENGTHS_MM if n >= clamped_mm + below_mm + size.nut_mm - 1e-9)
    return Screw(size.name, float(through), size.head_mm, hole_mm, below_mm, True)
