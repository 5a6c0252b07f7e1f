"""Suspension by one beam of three legs across the window, by `Serpentine`."""

from padgen.planner.suspensions._serpentine import BEAMS, END_FACTOR, ORDER, Serpentine

__all__ = ["BEAMS", "END_FACTOR", "ORDER", "arrange", "longest", "shortest", "widest"]

_SHAPE = Serpentine(3)
longest, widest, shortest, arrange = _SHAPE.longest, _SHAPE.widest, _SHAPE.shortest, _SHAPE.arrange
