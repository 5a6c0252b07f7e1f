"""Dynamics: where a coil's taxels are after switching on, from phasors to coil and washers acting on each other."""

from collections.abc import Iterator
from functools import partial

from padgen.core.errors import SolverError
from padgen.ladders.rung import Ladder, Rung, Solved
from padgen.ladders.stages.scene import Scene
from padgen.verify.dynamics_ladder import DynamicsRung, dynamics_question, dynamics_rungs

__all__ = ["dynamics_ladders", "solved"]

FINEST = "coupled"


def dynamics_ladders(scene: Scene) -> Iterator[Ladder]:
    """One ladder per kind of coil, in the plan's worst state; none where the coil pulls no washer."""
    for kind in range(len(scene.plan.sets)):
        try:
            question = dynamics_question(scene.plan, coil_set=kind)
        except SolverError:
            continue
        first, last = (1e3 * float(question.time_s[place]) for place in (0, -1))
        rungs = tuple(
            Rung(rung.model, rung.resolution, partial(solved, rung), FINEST if rung.model == FINEST else "")
            for rung in dynamics_rungs(question)
        )
        channels = ", ".join(str(channel.index) for channel in scene.plan.sets[kind])
        yield Ladder(
            "dynamics",
            f"channels {channels}, driven {question.scheme.name}",
            f"displacement {first:.4g} … {last:.4g} ms after switching on",
            "m",
            rungs,
            FINEST,
            note="errors are of the largest displacement; the coupled model refines its tolerance",
        )


def solved(rung: DynamicsRung) -> Solved:
    """The answer of one rung of `padgen.verify.dynamics_ladder`."""
    answer = rung.solve()
    return Solved(answer.values, rung.unknowns, answer.residual)
