"""A beam of 5 legs across the window."""

from padgen.planner.suspensions._serpentine import Serpentine

__all__ = ["BEAMS", "END_FACTOR", "arrange", "longest", "shortest", "widest"]

END_FACTOR = 0.25
BEAMS = 1
_SHAPE = Serpentine(5)
longest, widest, shortest, arrange = _SHAPE.longest, _SHAPE.widest, _SHAPE.shortest, _SHAPE.arrange
