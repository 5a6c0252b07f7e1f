"""Grooves in the outside of a border that mark a corner, so that a square part is not mounted the wrong way round."""

from padgen.planner.tile import Outline
from padgen.spec import Spec

__all__ = ["corner_groove", "groove"]

WIDTH_MM, DEPTH_MM = 1.5, 1.0


def groove(spec: Spec, x_mm: float, above: bool = False) -> Outline:
    """Return a groove at `x_mm` in the border's side towards −y, or towards +y with `above`.

    The outline reaches outwards as far as inwards, so that it can be subtracted from the border as it is.
    """
    pad = spec.pad
    side = 1 if above else -1
    edge = side * (pad.depth_mm / 2 + pad.border_mm)
    depth = min(DEPTH_MM, pad.border_mm / 4)
    return Outline(x_mm - WIDTH_MM / 2, x_mm + WIDTH_MM / 2, edge - depth, edge + depth)


def corner_groove(spec: Spec) -> Outline:
    """Return the groove at the corner of the coil in row 0, column 0: where the active area begins, towards −y."""
    return groove(spec, (WIDTH_MM - spec.pad.width_mm) / 2)
