"""The ladders of a study: from a scene (a spec and its plan) to the rungs that answer one question each.

Every module here only hands a plan's figures to models that live elsewhere.
"""

from collections.abc import Callable, Iterable

from padgen.ladders.rung import Ladder
from padgen.ladders.stages.allocation import allocation_ladders
from padgen.ladders.stages.dynamics import dynamics_ladders
from padgen.ladders.stages.force import force_ladders
from padgen.ladders.stages.geometry import geometry_ladders
from padgen.ladders.stages.scene import Scene
from padgen.ladders.stages.structure import pad_ladders, structure_ladders

__all__ = ["LADDERS", "Scene"]

LADDERS: dict[str, Callable[[Scene], Iterable[Ladder]]] = {
    "allocation": allocation_ladders,
    "geometry": geometry_ladders,
    "dynamics": dynamics_ladders,
    "force": force_ladders,
    "structure": structure_ladders,
    "pad": pad_ladders,
}
"""The ladders by name, in the order in which they run: the quick ones first."""
