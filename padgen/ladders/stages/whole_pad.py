"""Pad: the resonances of taxels on the real frame, by how finely the seams between the tiles are described."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from padgen.ladders.rung import Ladder, Rung, Solved
from padgen.ladders.stages.scene import Scene
from padgen.planner.plan import Plan
from padgen.verify.pad_interface import Degrees
from padgen.verify.pad_reduction import ReducedPad, Resolution, reduced_pad

__all__ = ["clamped_hz", "pad_hz", "pad_ladders"]

SEAMS = (Degrees(2, 1), Degrees(4, 3), Degrees(6, 4))
"""Degrees of the polynomials along a seam and through the frame's height."""
REDUCED = "reduced pad"
CLAMPING = "corners"
ENGINE = ("ngsolve", "netgen.occ", "scipy.sparse.linalg", "padgen.verify.pad_modes")


def pad_ladders(scene: Scene) -> Iterator[Ladder]:
    """One ladder: for each channel the resonance of its taxel nearest to the pad's centre, clamped by screws."""
    written = {scene.plan.channels[index].beam: step for index, step in scene.steps.items()}
    steps = {channel.index: written[channel.beam] for channel in scene.plan.channels}
    rungs = [Rung("clamped sub-cell", "no frame around it", partial(clamped_hz, scene.plan, steps), imports=ENGINE)]
    for degrees in SEAMS:
        solve = partial(pad_hz, scene.plan, steps, degrees)
        resolution = f"degree {degrees.along} along, {degrees.through} in height"
        rungs.append(Rung(REDUCED, resolution, solve, REDUCED, imports=ENGINE))
    yield Ladder(
        "pad",
        f"{len(scene.plan.taxels)} taxels held at the {CLAMPING}",
        "resonance of each channel on the frame",
        "Hz",
        tuple(rungs),
        REDUCED,
        "each",
        note="within the tiles all rungs have the same finite elements, whose error the structure ladder tells",
    )


def clamped_hz(plan: Plan, steps: Mapping[int, Path]) -> Solved:
    """Each channel's taxel in its sub-cell with all sides held."""
    pad = _reduced(plan, steps, SEAMS[0])
    return Solved(np.array([pad.clamped_hz(channel) for channel in _channels(plan)]))


def pad_hz(plan: Plan, steps: Mapping[int, Path], degrees: Degrees) -> Solved:
    """The same on the pad's own frame: the peak of each taxel's response."""
    from padgen.verify.pad_modes import crosstalk, pad_modes

    pad = _reduced(plan, steps, degrees)
    found = crosstalk(pad, pad_modes(pad))
    return Solved(np.array([one.resonance_hz for one in found]), pad.assembly.size)


def _channels(plan: Plan) -> list[int]:
    return sorted({taxel.channel for taxel in plan.taxels})


def _reduced(plan: Plan, steps: Mapping[int, Path], degrees: Degrees) -> ReducedPad:
    return reduced_pad(plan, steps, CLAMPING, Resolution(degrees))
