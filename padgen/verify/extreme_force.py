"""Extreme cases of the force ladder: the plan's pull, fields near and far, saturated, of any permeability; pull-in."""

from collections.abc import Iterator
from functools import partial
from math import pi
from random import Random

import numpy as np

from padgen.core.errors import SolverError
from padgen.physics.magnetics import CoilSource, SteelRing, balanced_deflection, pull_in_deflection, solenoid
from padgen.physics.pull_table import solved_pulls
from padgen.physics.saturation import MILD_STEEL
from padgen.spec import catalogue
from padgen.verify.extreme import Answer, ExtremeCase
from padgen.verify.field_axisymmetric import axisymmetric_force
from padgen.verify.force_ladder import Pull, solid_pull

__all__ = ["force_cases", "planned_pull", "random_pull"]

COIL = solenoid(10e-3, 4e-3, 10e-3, 1000, 4e-3, 1000)
WASHER = SteelRing(4e-3, 2e-3, 0.5e-3, 1000)
"""The reference problem of tests/reference/magnetostatics.json."""
FINER = {"order": 7, "levels": 6}
HIGHER = 4
RANDOM = 12
"""Coils, washers and places drawn from what a spec allows."""


def force_cases() -> Iterator[ExtremeCase]:
    """The cases; every reference is a closed form or a field solution of far more unknowns."""
    for share in (0.5, 0.99, 0.9999):
        yield _near_pull_in(share)
    for permeability in (1.001, 1.1, 10.0, 1e3, 1e6):
        parts = (COIL._replace(core_permeability=permeability), WASHER._replace(permeability=permeability))
        yield _axisymmetric_case(f"both steels of permeability {permeability:g}", Pull(*parts, gap_m=1e-3))
    for sizes in (1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3):
        gap_m = sizes * WASHER.outer_diameter
        yield _axisymmetric_case(f"gap of {sizes:g} washer diameters", Pull(COIL, WASHER, gap_m))
    for current_a in (2.0, 20.0, 200.0):
        saturated = Pull(COIL, WASHER, 1e-3, 0.0, current_a, MILD_STEEL, MILD_STEEL)
        yield _axisymmetric_case(f"saturated steels, {1000 * current_a:g} ampere turns", saturated)
    yield _solid_case("saturated steels, 20000 ampere turns", Pull(COIL, WASHER, 1e-3, 0, 20.0, MILD_STEEL, MILD_STEEL))
    for ratio in (0.0, 0.98):
        coil = solenoid(10e-3, max(ratio, 0.4) * 10e-3, 10e-3, 1000, ratio * 10e-3, 1000)
        pull, name = Pull(coil, WASHER, 1e-3), f"core {ratio:g} of the coil's diameter"
        yield _axisymmetric_case(name, pull)
        yield _solid_case(name, pull)
        yield _planned_case(name, pull)
    for gap_m in (1e-5, 5e-5, 2e-4, 5e-3):
        yield _planned_case(f"gap of {1e3 * gap_m:g} mm", Pull(COIL, WASHER, gap_m))
    for offset_m in (3e-3, 5e-3, 8e-3):
        yield _planned_case(f"{1e3 * offset_m:g} mm off the axis", Pull(COIL, WASHER, 1e-3, offset_m))
    wide, small = solenoid(20e-3, 16e-3, 20e-3, 1000, 16e-3, 1000), SteelRing(4e-3, 1.7e-3, 0.3e-3, 300)
    yield _planned_case("washer of M1.6 over a core of 16 mm", Pull(wide, small, 5e-4))
    for number in range(RANDOM):
        pull = random_pull(number)
        what = f"washer of {1e3 * pull.washer.outer_diameter:g} mm, core of {1e3 * pull.coil.core_diameter:.3g} mm"
        place = f"{1e3 * pull.gap_m:.3g} mm above, {1e3 * pull.offset_m:.3g} mm aside"
        yield _planned_case(f"random {number}: {what}, {place}", pull)


def random_pull(number: int) -> Pull:
    """Coil, washer and place number `number` of those drawn: gap 0.2 … 5 mm, offset 0 … 15 mm, core 0 … 20 mm.

    The same ones on every machine.
    """
    draw = Random(number).random
    washers = [entry for name, entry in sorted(catalogue("washer").items()) if entry["relative_permeability"] > 10]
    ring = washers[int(draw() * len(washers))]
    core = 20e-3 * draw() if draw() < 0.8 else 0.0
    bore = max(core, 2e-3) * (1 + 0.3 * draw())
    outer, length = bore + 2e-3 * (1 + 4 * draw()), 5e-3 * 8 ** draw()
    sizes = [1e-3 * ring[key] for key in ("outer_diameter_mm", "inner_diameter_mm", "thickness_mm")]
    coil = solenoid(outer, bore, length, 1000, core, 1000)
    return Pull(coil, SteelRing._make([*sizes, ring["relative_permeability"]]), 2e-4 * 25 ** draw(), 15e-3 * draw())


def planned_pull(coil: CoilSource, washer: SteelRing, gap_m: float, offset_m: float) -> Answer:
    """The pull over the current's square by which plans are made, and the error that it states."""
    found = solved_pulls(coil, washer, np.array([gap_m]), np.array([offset_m]))
    return Answer(found.pull, float(found.error[0]))


def _planned_case(name: str, pull: Pull) -> ExtremeCase:
    solve = partial(planned_pull, pull.coil, pull.washer, pull.gap_m, pull.offset_m)
    if pull.offset_m:
        return ExtremeCase(name, "force", "plan", solve, partial(_off_axis, pull), "3-D field, with its own error")
    return ExtremeCase(name, "force", "plan", solve, partial(_axisymmetric, pull), "axisymmetric field, with its error")


def _axisymmetric_case(name: str, pull: Pull) -> ExtremeCase:
    source = "the same by elements of order 7 and six refinements, with its own error"
    finer = partial(_axisymmetric, pull, **FINER)
    return ExtremeCase(name, "force", "axisymmetric", partial(_axisymmetric, pull), finer, source)


def _axisymmetric(pull: Pull, **fineness: int) -> Answer:
    """The middle of the bracket over the current's square; of a finer solution what the scalar potential says."""
    solved = axisymmetric_force(
        pull.coil, pull.washer, pull.gap_m, pull.current_a, pull.core_steel, pull.washer_steel, **fineness
    )
    force_n = solved.scalar_n if fineness else solved.force_n
    return Answer(np.array([-force_n / pull.current_a**2]), solved.error, solved.residual)


def _solid_case(name: str, pull: Pull) -> ExtremeCase:
    source = "axisymmetric field, with its own error"
    return ExtremeCase(name, "force", "3-D", partial(_solid, pull), partial(_axisymmetric, pull), source)


def _off_axis(pull: Pull) -> Answer:
    """The 3-D field; of a higher order where a weak pull drowns in the usual one's own error."""
    try:
        return _solid(pull)
    except SolverError:
        return _solid(pull, HIGHER)


def _solid(pull: Pull, order: int = 3) -> Answer:
    found = solid_pull(pull, order)
    return Answer(np.array([-float(found.wrench[0, 2]) / pull.current_a**2]), found.error, found.residual)


def _near_pull_in(share: float) -> ExtremeCase:
    """A pull c ∝ 1/gap² has its pull-in at a third of the gap; below it the balance solves a cubic."""
    gap_m = 1e-3

    def solve() -> Answer:
        slack = share * pull_in_deflection(gap_m, 2.0)[1]
        return Answer(np.array([balanced_deflection(slack, gap_m, 2.0)], float), 1e-6)

    # z (g − z)² = share · 4 g³/27; the smallest root in closed form.
    root = gap_m * (2 / 3 + 2 / 3 * np.cos(np.arccos(2 * share - 1) / 3 + 2 * pi / 3))
    name = f"balance at {share:g} of the pull-in current squared"
    source = "cubic of a spring against 1/gap^2, closed form"
    return ExtremeCase(name, "force", "balance", solve, partial(np.array, [root]), source)
