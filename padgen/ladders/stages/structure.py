"""Structure: a taxel's working resonance, from the paper's point-mass rule to 3-D elements of the printed solid.

And the resonances of taxels on the real frame of the pad, by the order of the elements that the frame is solved with.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from padgen.ladders.isolate import run_apart
from padgen.ladders.rung import Ladder, Rung, Solved, Theory
from padgen.ladders.stages.scene import Scene, chosen_channels, write_steps
from padgen.planner.plan import Channel, Plan
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import Spec

__all__ = [
    "beam_hz",
    "frame_hz",
    "graded_hz",
    "pad_hz",
    "pad_ladders",
    "planned_hz",
    "rule_hz",
    "structure_ladders",
]

GRADED = ((2, 0), (2, 1), (3, 1), (3, 2), (4, 3), (5, 4))
"""(order, levels of refinement at the edges that matter), as `solve_modes` has them; the last steps refine both."""
ELEMENTS, FULL = (1, 2, 4, 8), 4
FRAME, FRAMES = "frame, cubic elements", ("padgen.planner.taxel_frame",)
REFERENCE = "solid, graded"
THEORY = {
    FRAME: Theory(4, "frequencies by cubic shapes and consistent mass; what the flares' fixed slices err by stays"),
}
ENGINE = ("ngsolve", "netgen.occ", "scipy.sparse.linalg", "padgen.verify.elasticity")


def structure_ladders(scene: Scene) -> Iterator[Ladder]:
    """One ladder per taxel that differs from the others in its beams (`chosen_channels`)."""
    for place, channel in enumerate(chosen_channels(scene.plan)):
        yield Ladder(
            "structure",
            f"taxel of channel {channel.index}",
            "working resonance",
            "Hz",
            tuple(_rungs(scene, channel)),
            REFERENCE,
            theory=THEORY,
            before=None if place else partial(run_apart, write_steps, scene),
        )


def _rungs(scene: Scene, channel: Channel) -> Iterator[Rung]:
    spec, plan = scene.plan.spec, scene.plan
    yield Rung("rule", "point mass", partial(rule_hz, spec, channel))
    yield Rung("beam", "6 motions of a rigid body", partial(beam_hz, spec, channel))
    for elements in ELEMENTS:
        solve = partial(frame_hz, spec, channel, elements, False)
        yield Rung("frame", f"{elements} element{'s' * (elements > 1)} a beam", solve, FRAME, 1 / elements, FRAMES)
    solve = partial(frame_hz, spec, channel, FULL, True)
    yield Rung("frame", f"{FULL} elements with inner motions", solve, imports=FRAMES)
    step = scene.step(channel)
    for order, levels in GRADED:
        solve = partial(graded_hz, plan, channel, step, order, levels)
        yield Rung("solid", f"p = {order}, {_levels(levels)}", solve, REFERENCE, imports=ENGINE)


def _levels(levels: int) -> str:
    return f"{levels} level{'s' * (levels != 1)}"


def _model(spec: Spec, channel: Channel) -> TaxelModel:
    beam = channel.beam
    shape = BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm)
    return TaxelModel(spec, beam.topology, plate_shape(spec), shape)


def rule_hz(spec: Spec, channel: Channel) -> Solved:
    """By the paper's Eq. 1 and 2."""
    return Solved(np.array([_model(spec, channel).rule_hz]))


def beam_hz(spec: Spec, channel: Channel) -> Solved:
    """By the model that plans are made with."""
    return Solved(np.array([_model(spec, channel).resonance_hz]), 6)


def frame_hz(spec: Spec, channel: Channel, elements: int, inner: bool) -> Solved:
    """By a frame of `elements` along each beam, with motions within the elements or without."""
    from padgen.physics.frame import frame_modes
    from padgen.planner.taxel_frame import taxel_frame

    model = _model(spec, channel)
    frame = taxel_frame(model, elements)
    frame = frame if inner else frame._replace(bubbles=0)
    modes = frame_modes(frame)
    arm = np.asarray(model.washer_point_m) - frame.bodies[0].body.centroid
    plate = modes.body_motion[:, 0]
    vertical = plate[:, 2] + plate[:, 3] * arm[1] - plate[:, 4] * arm[0]
    working = int(np.abs(vertical / modes.frequency_hz).argmax())
    unknowns = 6 * (len(frame.nodes) - len(frame.clamped))
    return Solved(modes.frequency_hz[[working]], unknowns, modes.residual)


def graded_hz(plan: Plan, channel: Channel, step: Path, order: int, levels: int) -> Solved:
    """By 3-D elements of `order`, refined `levels` times at the singular edges that hold energy."""
    from padgen.make.solid_tuning import solid_taxel
    from padgen.verify.elasticity import solve_modes

    found = solve_modes(solid_taxel(plan, channel, step), order, levels)
    return _working(found.modes, found.unknowns, found.residual)


def _working(modes: Any, unknowns: int, residual: float) -> Solved:
    return Solved(np.array([modes.frequency_hz[modes.working]]), unknowns, residual)


ORDERS = (2, 3, 4)
ON_FRAME = "taxels on the frame"
FRAME_ENGINE = ("ngsolve", "netgen.occ", "scipy.linalg", "padgen.verify.pad_frame")


def pad_ladders(scene: Scene) -> Iterator[Ladder]:
    """One ladder: for each channel the resonance of its taxel nearest to the pad's centre, the frame held by its
    screws or, without holes, glued down."""
    plan, clamping = scene.plan, "corners" if scene.plan.spec.pad.hole_diameter_mm else "bottom"
    rungs = [Rung("clamped sub-cell", "no frame around it", partial(planned_hz, plan))]
    rungs += [
        Rung(ON_FRAME, f"frame p = {order}", partial(pad_hz, plan, clamping, order), ON_FRAME, imports=FRAME_ENGINE)
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
