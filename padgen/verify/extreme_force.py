"""Extreme cases of the force ladder: near pull-in, saturated, any permeability, gaps tiny and huge."""

from collections.abc import Iterator
from functools import partial
from math import pi

import numpy as np

from padgen.physics.magnetics import SteelRing, solenoid
from padgen.physics.pull import pull as charges_pull
from padgen.physics.saturation import MILD_STEEL
from padgen.verify.extreme import Answer, ExtremeCase
from padgen.verify.field_axisymmetric import AxisymmetricForce, axisymmetric_force
from padgen.verify.force_ladder import Pull, PullCurve, balance, pull_in

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
    return ExtremeCase(
        name=name,
        domain="force",
        model="axisymmetric",
        solve=partial(_axisymmetric, pull),
        reference=partial(_finer, pull),
        source="the same by elements of order 7 and six refinements, scalar potential",
    )


def _axisymmetric(pull: Pull) -> Answer:
    solved = _solve(pull)
    return Answer(np.array([-solved.force_n]), solved.error, solved.residual)


def _finer(pull: Pull) -> np.ndarray:
    return np.array([-_solve(pull, **FINER).scalar_n])


def _solve(pull: Pull, **fineness: int) -> AxisymmetricForce:
    return axisymmetric_force(
        pull.coil, pull.washer, pull.gap_m, pull.current_a, pull.core_steel, pull.washer_steel, **fineness
    )


def _far_case(sizes: float) -> ExtremeCase:
    """So far away that the force is lost in rounding: a field solution has to say so."""
    gap_m = sizes * WASHER.outer_diameter

    def reference() -> np.ndarray:
        # A dipole's pull on a small body falls with the seventh power of the distance of their middles.
        near_m, middles_m = 50 * WASHER.outer_diameter, (COIL.length + WASHER.thickness) / 2
        near = -charges_pull(COIL, WASHER, near_m, 0.0).axial
        return np.array([near]) * ((near_m + middles_m) / (gap_m + middles_m)) ** 7

    return ExtremeCase(
        name=f"gap of {sizes:g} washer diameters",
        domain="force",
        model="axisymmetric",
        solve=partial(_axisymmetric, Pull(COIL, WASHER, gap_m)),
        reference=reference,
        source="surface charges at 50 diameters, carried on by the dipole's seventh power",
    )


def _near_pull_in(share: float) -> ExtremeCase:
    """A pull c ∝ 1/gap² has its pull-in at a third of the gap; below it the balance solves a cubic."""
    gap_m, stiffness = 1e-3, 20.0
    gaps = gap_m * np.geomspace(0.3, 1.0, 5)
    curve = PullCurve(gaps, 1e-7 / gaps**2)

    def solve() -> Answer:
        limit = pull_in(curve, stiffness, gap_m)
        solved = balance(curve, stiffness, gap_m, share * limit.mean_square_a2)
        return Answer(np.array([solved.deflection_m, solved.magnetic_n_per_m]), 1e-6)

    def reference() -> np.ndarray:
        # z (g − z)² = share · 4 g³/27; the smallest root in closed form.
        turn = np.arccos(2 * share - 1)
        z = gap_m * (2 / 3 + 2 / 3 * np.cos(turn / 3 + 2 * pi / 3))
        return np.array([z, 2 * stiffness * z / (gap_m - z)])

    return ExtremeCase(
        name=f"balance at {share:g} of the pull-in current squared",
        domain="force",
        model="balance",
        solve=solve,
        reference=reference,
        source="cubic of a spring against 1/gap^2, closed form",
    )
