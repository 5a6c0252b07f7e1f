"""Suspension topologies, each one file; a new one is that file and one line of `TOPOLOGIES`.

A topology is a module with

- ``END_FACTOR``: c of the point-mass rule ``k = c E w t³/l³`` and ``BEAMS``, how many share the load;
- ``longest(room, plate, gap)``: longest beam in mm that `room` holds, negative when none does;
- ``widest(room, plate, gap)``: widest beam in mm that `room` holds;
- ``shortest(plate, gap)``: shortest beam in mm;
- ``arrange(plate, beam, gap)``: the `Arrangement` of beams and moving blocks.

All take numbers or arrays, so that one call lays out a whole grid of candidates.
"""

from types import ModuleType

from padgen.planner.suspensions import bridge, cantilever, folded
from padgen.planner.suspensions.arrangement import Arrangement, BeamShape, Block, PlateShape, Room, Strip

__all__ = ["TOPOLOGIES", "Arrangement", "BeamShape", "Block", "PlateShape", "Room", "Strip"]

TOPOLOGIES: dict[str, ModuleType] = {
    "cantilever": cantilever,
    "folded": folded,
    "bridge": bridge,
}
