"""Force: the coil's pull on a washer at the plan's gap, from the paper's Eq. 4 to field solutions."""

from collections.abc import Iterator
from functools import partial
from math import pi

import numpy as np

from padgen.core.units import MM
from padgen.ladders.rung import Ladder, Rung, Solved
from padgen.ladders.stages.scene import Scene, chosen_channels
from padgen.physics.magnetics import paper_force_constant
from padgen.physics.pull_table import solved_pulls
from padgen.planner.pulls import magnetic_parts
from padgen.verify.force_ladder import Pull, solid_pull

__all__ = ["axisymmetric_pull", "charges_pull", "force_ladders", "paper_pull", "three_d_pull"]

AXISYMMETRIC = ((3, 1), (4, 2), (5, 3), (6, 4))
SOLID = ((2, 1), (3, 2), (4, 3))
"""(order, levels of refinement at the edges of steel): both are refined at a time."""
COAXIAL, OFF_AXIS = "axisymmetric field", "3-D field"
ENGINE = ("ngsolve", "netgen.occ", "netgen.geom2d", "scipy.sparse.linalg", "padgen.verify.force_ladder")
LEAST_OFFSET_MM = 1e-3


def force_ladders(scene: Scene) -> Iterator[Ladder]:
    """One ladder for each distance from the coil's axis at which the plan has a washer."""
    coil, washer = magnetic_parts(scene.plan.spec)
    gap = scene.plan.spec.coil.gap_mm
    distances = {round(c.site.coil_distance_mm, 3) for c in chosen_channels(scene.plan)}
    for offset in sorted({distance if distance >= LEAST_OFFSET_MM else 0.0 for distance in distances}):
        pull = Pull(coil, washer, gap * MM, offset * MM)
        place = f"{offset:g} mm off the axis" if offset else "on the axis"
        yield Ladder(
            "force",
            f"{place}, gap {gap:g} mm",
            "pull over the current's square",
            "N/A²",
            tuple(_rungs(pull)),
            OFF_AXIS if offset else COAXIAL,
            note="steel is linear, with the catalogue's permeability",
        )


def _rungs(pull: Pull) -> Iterator[Rung]:
    yield Rung("paper", "Eq. 4 as printed", partial(paper_pull, pull))
    yield Rung("charges", "on core and washer", partial(charges_pull, pull))
    if not pull.offset_m:
        for order, levels in AXISYMMETRIC:
            solve = partial(axisymmetric_pull, pull, order, levels)
            yield Rung(COAXIAL, _resolution(order, levels), solve, COAXIAL, imports=ENGINE)
    for order, levels in SOLID:
        solve = partial(three_d_pull, pull, order, levels)
        yield Rung(OFF_AXIS, _resolution(order, levels), solve, OFF_AXIS, imports=ENGINE)


def _resolution(order: int, levels: int) -> str:
    return f"p = {order}, {levels} level{'s' * (levels > 1)}"


def paper_pull(pull: Pull) -> Solved:
    """By Eq. 4 as printed, over the core's end (the bore's without a core)."""
    diameter = pull.coil.core_diameter or min(winding.inner_diameter for winding in pull.coil.windings)
    return Solved(np.array([paper_force_constant(pull.coil, pi / 4 * diameter**2)]))


def charges_pull(pull: Pull) -> Solved:
    """By surface charges on core and washer, which know no saturation: the plan's own."""
    found = solved_pulls(pull.coil, pull.washer, np.array([pull.gap_m]), np.array([pull.offset_m]))
    return Solved(found.pull)


def axisymmetric_pull(pull: Pull, order: int, levels: int) -> Solved:
    """By elements of `order` in the half plane, the middle of what two potentials say."""
    from padgen.verify.field_axisymmetric import axisymmetric_force

    found = axisymmetric_force(pull.coil, pull.washer, pull.gap_m, pull.current_a, order=order, levels=levels)
    return Solved(np.array([-found.force_n / pull.current_a**2]), found.unknowns, found.residual)


def three_d_pull(pull: Pull, order: int, levels: int) -> Solved:
    """By elements of `order` in space."""
    found = solid_pull(pull, order, levels)
    return Solved(np.array([-float(found.wrench[0, 2]) / pull.current_a**2]), found.unknowns, found.residual)
