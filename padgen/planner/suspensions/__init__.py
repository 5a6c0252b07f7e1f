"""Suspension topologies, each one file; a new one is that file and its name in `padgen.spec.model.SUSPENSIONS`.

A topology is a module with

- ``END_FACTOR``: c of the point-mass rule ``k = c E w t³/l³`` and ``BEAMS``, how many share the load;
- ``longest(room, plate, gap)``: longest beam in mm that `room` holds, negative when none does;
- ``widest(room, plate, gap)``: widest beam in mm that `room` holds;
- ``shortest(plate, gap)``: shortest beam in mm;
- ``arrange(plate, beam, gap)``: the `Arrangement` of beams and moving blocks.

All take numbers or arrays, so that one call lays out a whole grid of candidates.
"""

from importlib import import_module
from types import ModuleType

from padgen.planner.suspensions.arrangement import Arrangement, BeamShape, Block, PlateShape, Room, Strip
from padgen.spec.model import SUSPENSIONS

__all__ = ["TOPOLOGIES", "Arrangement", "BeamShape", "Block", "PlateShape", "Room", "Strip"]

TOPOLOGIES: dict[str, ModuleType] = {name: import_module(f"{__name__}.{name}") for name in SUSPENSIONS}
