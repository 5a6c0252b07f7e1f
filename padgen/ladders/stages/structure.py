"""Structure: a taxel's working resonance, from the paper's point-mass rule to 3-D elements of the printed solid."""

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

__all__ = ["beam_hz", "frame_hz", "graded_hz", "meshed_hz", "rule_hz", "structure_ladders"]

GRADED = ((2, 0), (2, 1), (3, 1), (3, 2), (4, 3), (5, 4))
"""(order, levels of refinement at the edges that matter), as `solve_modes` has them; the last steps refine both."""
EVERY_EDGE = (3, 2)
"""The same at all singular edges: dearer, and shows what the choice of edges leaves out."""
ELEMENTS, FULL = (1, 2, 4, 8), 4
FRAME, FRAMES = "frame, cubic elements", ("padgen.planner.taxel_frame",)
WHOLE_MM = 1e3
"""No bound on the elements' size but the solid's own features."""
SIZES_MM = (2.0, 1.0, 0.5)
UNIFORM = "solid p = 2, even elements"
REFERENCE = "solid, graded"
SINGULAR = 2 * 0.5445
"""Twice the exponent of stress at a free re-entrant edge of 270° (Williams, J. Appl. Mech. 19, 1952)."""
THEORY = {
    FRAME: Theory(4, "frequencies by cubic shapes and consistent mass; what the flares' fixed slices err by stays"),
    UNIFORM: Theory(SINGULAR, "stress is singular at re-entrant edges, whatever the order p", True),
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
    for size in SIZES_MM:
        solve = partial(meshed_hz, plan, channel, step, 2, 0, size)
        yield Rung("solid", f"p = 2, elements of {size:g} mm", solve, UNIFORM, size, ENGINE)
    for order, levels in GRADED:
        solve = partial(graded_hz, plan, channel, step, order, levels)
        yield Rung("solid", f"p = {order}, {_levels(levels)}", solve, REFERENCE, imports=ENGINE)
    solve = partial(meshed_hz, plan, channel, step, *EVERY_EDGE, WHOLE_MM)
    yield Rung("solid", f"p = {EVERY_EDGE[0]}, {_levels(EVERY_EDGE[1])} at every edge", solve, imports=ENGINE)


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


def meshed_hz(plan: Plan, channel: Channel, step: Path, order: int, levels: int, size_mm: float) -> Solved:
    """By 3-D elements of `order` and at most `size_mm`, refined `levels` times at every singular edge.

    With no levels and small elements it is what an unguided mesh costs.
    """
    from padgen.make.solid_tuning import solid_taxel
    from padgen.physics.taxel_modes import TaxelModes
    from padgen.verify.elastic_mesh import WASHER, Fineness, clamped_shape, meshed, taxel_shape
    from padgen.verify.elastic_modes import assembled, eigenmodes, factored, rigid_loads

    taxel = solid_taxel(plan, channel, step)
    shape = clamped_shape(taxel_shape(step, taxel.washer_volume_mm3), taxel.clamp)
    mesh = meshed(shape, Fineness(levels=levels, largest_mm=size_mm), str(step))
    system = assembled(mesh, taxel.materials, order)
    eigen = eigenmodes(system, factored(system), 6)
    loads = rigid_loads(system, WASHER, taxel.materials[WASHER].density_kg_per_m3, taxel.washer_x_mm)
    return _working(TaxelModes(eigen.frequency_hz, eigen.shape.T @ loads), int(system.free.sum()), eigen.residual)


def _working(modes: Any, unknowns: int, residual: float) -> Solved:
    return Solved(np.array([modes.frequency_hz[modes.working]]), unknowns, residual)
