"""Extreme cases of the force ladder: near pull-in, saturated, any permeability, gaps tiny and huge."""

from collections.abc import Iterator
from functools import partial
from math import pi

import numpy as np

from padgen.physics.magnetics import SteelRing, balanced_deflection, pull_in_deflection, solenoid
from padgen.physics.pull import pull as charges_pull
from padgen.physics.saturation import MILD_STEEL
from padgen.verify.extreme import Answer, ExtremeCase
from padgen.verify.field_axisymmetric import axisymmetric_force
from padgen.verify.force_ladder import Pull

__all__ = ["force_cases"]

COIL = solenoid(10e-3, 4e-3, 10e-3, 1000, 4e-3, 1000)
WASHER = SteelRing(4e-3, 2e-3, 0.5e-3, 1000)
"""The reference problem of tests/reference/magnetostatics.json."""
FINER = {"order": 7, "levels": 6}


def force_cases() -> Iterator[ExtremeCase]:
    """The cases; every reference is a closed form or a field solution of far more unknowns."""
    for share in (0.5, 0.99, 0.9999):
        yield _near_pull_in(share)
    for permeability in (1.001, 1.1, 10.0, 1e3, 1e6):
        parts = (COIL._replace(core_permeability=permeability), WASHER._replace(permeability=permeability))
        yield _field_case(f"both steels of permeability {permeability:g}", Pull(*parts, gap_m=1e-3))
    for sizes in (1e-2, 0.1, 1.0):
        gap_m = sizes * WASHER.outer_diameter
        yield _field_case(f"gap of {sizes:g} washer diameters", Pull(COIL, WASHER, gap_m))
    for sizes in (100.0, 1e3):
        yield _far_case(sizes)
    for current_a in (2.0, 20.0, 200.0):
        saturated = Pull(COIL, WASHER, 1e-3, 0.0, current_a, MILD_STEEL, MILD_STEEL)
        yield _field_case(f"saturated steels, {1000 * current_a:g} ampere turns", saturated)


def _field_case(name: str, pull: Pull) -> ExtremeCase:
    source = "the same by elements of order 7 and six refinements, scalar potential"
    finer = partial(_axisymmetric, pull, **FINER)
    return ExtremeCase(name, "force", "axisymmetric", partial(_axisymmetric, pull), lambda: finer().values, source)


def _axisymmetric(pull: Pull, **fineness: int) -> Answer:
    """The middle of the bracket; of a finer solution what the scalar potential says."""
    solved = axisymmetric_force(
        pull.coil, pull.washer, pull.gap_m, pull.current_a, pull.core_steel, pull.washer_steel, **fineness
    )
    return Answer(np.array([-(solved.scalar_n if fineness else solved.force_n)]), solved.error, solved.residual)


def _far_case(sizes: float) -> ExtremeCase:
    """So far away that the force is lost in rounding: a field solution has to say so."""
    gap_m = sizes * WASHER.outer_diameter

    def reference() -> np.ndarray:
        # A dipole's pull on a small body falls with the seventh power of the distance of their middles.
        near_m, middles_m = 50 * WASHER.outer_diameter, (COIL.length + WASHER.thickness) / 2
        near = -charges_pull(COIL, WASHER, near_m, 0.0).axial
        return np.array([near]) * ((near_m + middles_m) / (gap_m + middles_m)) ** 7

    name, solve = f"gap of {sizes:g} washer diameters", partial(_axisymmetric, Pull(COIL, WASHER, gap_m))
    source = "surface charges at 50 diameters, carried on by the dipole's seventh power"
    return ExtremeCase(name, "force", "axisymmetric", solve, reference, source)


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
