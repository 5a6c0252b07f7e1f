"""Pad: the resonances of taxels on the real frame, by the order of the elements that the frame is solved with."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from padgen.ladders.rung import Ladder, Rung, Solved
from padgen.ladders.stages.scene import Scene
from padgen.planner.plan import Plan

__all__ = ["pad_hz", "pad_ladders", "planned_hz"]

ORDERS = (2, 3, 4)
ON_FRAME = "taxels on the frame"
ENGINE = ("ngsolve", "netgen.occ", "scipy.linalg", "padgen.verify.pad_frame")


def pad_ladders(scene: Scene) -> Iterator[Ladder]:
    """One ladder: for each channel the resonance of its taxel nearest to the pad's centre, the frame held by its
    screws or, without holes, glued down."""
    plan, clamping = scene.plan, "corners" if scene.plan.spec.pad.hole_diameter_mm else "bottom"
    rungs = [Rung("clamped sub-cell", "no frame around it", partial(planned_hz, plan))]
    rungs += [
        Rung(ON_FRAME, f"frame p = {order}", partial(pad_hz, plan, clamping, order), ON_FRAME, imports=ENGINE)
        for order in ORDERS
    ]
    yield Ladder(
        "pad",
        f"{len(plan.taxels)} taxels held at the {clamping}",
        "resonance of each channel on the frame",
        "Hz",
        tuple(rungs),
        ON_FRAME,
        "each",
        note="the frame alone is a solid; taxels are the plan's, whose error the structure ladder tells",
    )


def planned_hz(plan: Plan) -> Solved:
    """Each channel's resonance as planned, with all sides of its sub-cell held."""
    return Solved(np.array([plan.channels[c].resonance_hz for c in sorted({t.channel for t in plan.taxels})]))


def pad_hz(plan: Plan, clamping: str, order: int) -> Solved:
    """The same, moved by as much as the frame moves the peak of the taxel's own response."""
    from padgen.verify.pad_frame import central_taxels, pad_modes, shift

    modes, held = pad_modes(plan, clamping, order)
    moved = [1 + shift(plan, modes, held, taxel) for taxel in central_taxels(plan)]
    return Solved(planned_hz(plan).values * moved, modes.unknowns)
