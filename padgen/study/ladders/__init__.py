"""The ladders of a study: from a scene (a spec and its plan) to the rungs that answer one question each.

Every module here only hands a plan's figures to models that live elsewhere.
"""

from collections.abc import Callable, Iterable

from padgen.study.ladders.allocation import allocation_ladders
from padgen.study.ladders.dynamics import dynamics_ladders
from padgen.study.ladders.force import force_ladders
from padgen.study.ladders.geometry import geometry_ladders
from padgen.study.ladders.pad import pad_ladders
from padgen.study.ladders.scene import Scene
from padgen.study.ladders.structure import structure_ladders
from padgen.study.rung import Ladder

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
