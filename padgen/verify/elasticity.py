"""The `solid` rung of the structure ladder: one taxel's modes by 3-D elasticity on the STEP file that is built.

NGSolve must not be imported into a process that has loaded build123d: call these functions in a
process of their own (they can be pickled).
"""

import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.errors import SolverError, number
from padgen.physics.taxel_modes import TaxelModes
from padgen.verify.elastic_material import Elastic, Orthotropy
from padgen.verify.elastic_mesh import PRINTED, WASHER, Fineness, clamped_shape, meshed, taxel_shape
from padgen.verify.elastic_modes import assembled, eigenmodes, factored, rigid_loads
from padgen.verify.engines import engine

__all__ = ["Elastic", "Orthotropy", "SolidModes", "SolidTaxel", "converged_modes", "solve_modes"]

SETTINGS = ((3, 1), (3, 2), (4, 2), (4, 3))
"""(order, levels), cheapest first."""


class SolidTaxel(NamedTuple):
    """One taxel to solve: a STEP file in mm with two solids, printed part and washer, bonded where they
    touch. `glue_kg` is carried by the washer. `clamp` is one of `elastic_mesh.CLAMPS`."""

    step: Path
    printed: Elastic
    washer: Elastic
    washer_volume_mm3: float
    washer_x_mm: float
    glue_kg: float = 0.0
    clamp: str = "sides"

    @property
    def loaded_washer(self) -> Elastic:
        """The washer's material with the glue's mass in its density."""
        density = self.washer.density_kg_per_m3 + self.glue_kg / (self.washer_volume_mm3 * 1e-9)
        return self.washer._replace(density_kg_per_m3=density)


class SolidModes(NamedTuple):
    """Modes by elements of `order` on `elements` with `unknowns`; `residual` of the worst mode;
    `seconds` of processor time by stage; `error` (k,) estimated relative error of each frequency,
    nan where there is no second order to compare with."""

    modes: TaxelModes
    order: int
    levels: int
    unknowns: int
    elements: int
    residual: float
    error: np.ndarray
    seconds: dict[str, float]


def solve_modes(taxel: SolidTaxel, order: int = 3, levels: int = 2, modes: int = 6) -> SolidModes:
    """The lowest modes of `taxel` by elements of `order` with `levels` of layers round singular edges.

    All frequencies come out too high. `rest` of the result makes the static compliance exact.

    Raises
    ------
    SolverError
        The STEP file does not hold a taxel, cannot be meshed, or the solver does not converge.
    """
    mesh, seconds = _taxel_mesh(taxel, Fineness(levels=levels))
    return _solved(taxel, mesh, order, levels, modes, seconds)


def converged_modes(taxel: SolidTaxel, tolerance: float = 1e-3, modes: int = 6) -> SolidModes:
    """Modes with the estimated error of the first below `tolerance`, the cheapest setting that does.

    The estimate is the change from one order to the next on one mesh.

    Raises
    ------
    SolverError
        No setting reaches `tolerance`; otherwise as `solve_modes`.
    """
    if not tolerance > 0:
        raise SolverError(f"must be above 0, got {number(tolerance)}, e.g. 0.001", "tolerance")
    best = np.inf
    for order, levels in SETTINGS:
        mesh, seconds = _taxel_mesh(taxel, Fineness(levels=levels))
        lower = _solved(taxel, mesh, order - 1, levels, modes, seconds)
        found = _solved(taxel, mesh, order, levels, modes, seconds)
        change = np.abs(lower.modes.frequency_hz / found.modes.frequency_hz - 1)
        best = min(best, float(change[0]))
        if change[0] < tolerance:
            return found._replace(error=change)
    raise SolverError(f"the first mode is known to {best:.1e} at best, asked was {tolerance:.1e}", str(taxel.step))


def _taxel_mesh(taxel: SolidTaxel, fineness: Fineness) -> tuple[Any, dict[str, float]]:
    engine("ngsolve").SetNumThreads(1)
    started = time.process_time()
    shape = clamped_shape(taxel_shape(taxel.step, taxel.washer_volume_mm3), taxel.clamp)
    read = time.process_time()
    mesh = meshed(shape, fineness, str(taxel.step))
    return mesh, {"read": read - started, "mesh": time.process_time() - read}


def _solved(taxel: SolidTaxel, mesh: Any, order: int, levels: int, modes: int, before: dict[str, float]) -> SolidModes:
    clock = [time.process_time()]
    washer = taxel.loaded_washer
    system = assembled(mesh, {PRINTED: taxel.printed, WASHER: washer}, order)
    clock.append(time.process_time())
    solve = factored(system)
    clock.append(time.process_time())
    loads = rigid_loads(system, WASHER, washer.density_kg_per_m3, taxel.washer_x_mm)
    answers = np.array([solve(load) for load in loads.T]).T
    eigen = eigenmodes(system, solve, modes, answers)
    motion = eigen.shape.T @ loads
    static = loads.T @ answers
    modal = motion.T @ (motion / (2 * np.pi * eigen.frequency_hz[:, None]) ** 2)
    clock.append(time.process_time())
    stages = dict(zip(("assemble", "factor", "modes"), np.diff(clock).tolist(), strict=True))
    return SolidModes(
        TaxelModes(eigen.frequency_hz, motion, static - modal),
        order,
        levels,
        int(system.free.sum()),
        mesh.ne,
        eigen.residual,
        np.full(len(eigen.frequency_hz), np.nan),
        before | stages,
    )
