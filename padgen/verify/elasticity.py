"""The `solid` rung of the structure ladder: one taxel's modes by 3-D elasticity on the STEP file that is built.

NGSolve must not be imported into a process that has loaded build123d: call these functions in a
process of their own (they can be pickled).
"""

import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.physics.taxel_modes import TaxelModes
from padgen.verify.elastic_material import Elastic, Orthotropy, layered
from padgen.verify.elastic_mesh import (
    PRINTED,
    WASHER,
    Fineness,
    clamped_shape,
    coarse_mesh,
    meshed,
    singular_edges,
    taxel_shape,
)
from padgen.verify.elastic_modes import (
    Eigen,
    System,
    accurate,
    assembled,
    edge_energy_shares,
    eigenmodes,
    energy_shares,
    factored,
    rigid_loads,
)
from padgen.verify.engines import engine

__all__ = ["SETTINGS", "Elastic", "Orthotropy", "SolidModes", "SolidTaxel", "converged_modes", "layered", "solve_modes"]


class Setting(NamedTuple):
    """Order of the elements, levels of layers, and their largest size (`Fineness.per_face`)."""

    order: int
    levels: int
    per_face: float = 1.0


SETTINGS = (Setting(3, 2), Setting(3, 2, 0.5), Setting(4, 2, 0.5), Setting(4, 3, 0.5))
"""Cheapest first."""
ENOUGH = 30_000
"""Unknowns from which on an error that can be accepted is not worth making smaller."""
ADDED = 0.15
"""Share of the last order's change that all higher orders together still make: 0.06 … 0.3 on the templates' taxels
and the reference problem (docs/accuracy.md)."""
DOUBT = {3: 1 / 6, 4: 1 / 2}
"""Share of that change by which the extrapolated frequency may be off; at order 4 the layers count as well."""
EDGE_RATIO = 0.1
"""Layers are worth while along edges whose tetrahedra hold this much of the energy at the worst edge."""


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
    def materials(self) -> dict[str, Elastic]:
        """Materials by name of solid, the glue's mass in the washer's density."""
        density = self.washer.density_kg_per_m3 + self.glue_kg / (self.washer_volume_mm3 * 1e-9)
        return {PRINTED: self.printed, WASHER: self.washer._replace(density_kg_per_m3=density)}


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


class _Draft(NamedTuple):
    """A taxel's solid and the edges that its modes, solved on a coarse mesh, strain."""

    taxel: SolidTaxel
    shape: Any
    layered: set[str]


class _Answer(NamedTuple):
    """`loads` (n, 6) on the washer, the static `answers` (n, 6) to them, and the modes."""

    system: System
    loads: np.ndarray
    answers: np.ndarray
    eigen: Eigen


class _Clock:
    """Processor time by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.last = time.process_time()

    def stop(self, stage: str) -> None:
        now = time.process_time()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self.last
        self.last = now


def solve_modes(taxel: SolidTaxel, order: int = 3, levels: int = 2, modes: int = 6) -> SolidModes:
    """The lowest modes of `taxel` by elements of `order` with `levels` of layers round singular edges.

    All frequencies come out too high. `rest` of the result makes the static compliance exact.

    Raises
    ------
    SolverError
        The STEP file does not hold a taxel, cannot be meshed, or the solver does not converge.
    """
    if order < 2 or levels < 0 or modes < 1:
        raise SolverError(f"needs order ≥ 2, levels ≥ 0 and modes ≥ 1, got {order}, {levels} and {modes}", "elasticity")
    clock = _Clock()
    draft = _drafted(taxel, clock)
    setting = Setting(order, levels)
    return _solved(taxel, _layered(draft, setting, clock), setting, modes, clock)


def converged_modes(
    taxel: SolidTaxel, tolerance: float = 1e-3, modes: int = 6, accept: float | None = None
) -> SolidModes:
    """Modes with the estimated error of the working mode below `tolerance`, by the cheapest setting that does.

    An error below `accept` will do where a smaller one would be dear.

    Two orders are solved on one mesh, and the frequencies extrapolated by a share of their difference. Of other
    modes `error` is the whole difference; for the torsion of thin beams, slow to converge, it may be too small.

    Raises
    ------
    SolverError
        No setting reaches `tolerance`, or `accept`; otherwise as `solve_modes`.
    """
    if not 0 < tolerance < 1:
        raise SolverError(f"must lie between 0 and 1, got {number(tolerance)}, e.g. 0.001", "tolerance")
    clock, best, known = _Clock(), float("inf"), None
    draft = _drafted(taxel, clock)
    mesh, coarser, before = None, None, None
    for setting in SETTINGS:
        if mesh is None or coarser is None or before != setting[1:]:
            mesh, before = _layered(draft, setting, clock), setting[1:]
            coarser = _solved(taxel, mesh, setting._replace(order=setting.order - 1), modes, clock)
        found = _solved(taxel, mesh, setting, modes, clock)
        extrapolated = _extrapolated(coarser, found)
        error = float(extrapolated.error[found.modes.working])
        if error < best:
            best, known = error, extrapolated
        acceptable = accept is not None and best < accept
        if known and (best < tolerance or (acceptable and (found.unknowns > ENOUGH or setting is SETTINGS[-1]))):
            return known
        coarser = found
    raise SolverError(
        f"its working mode is known to {best:.1e} at best, asked was {max(tolerance, accept or 0.0):.1e};"
        " allow a larger model.tolerance",
        str(taxel.step),
    )


def _extrapolated(coarser: SolidModes, found: SolidModes) -> SolidModes:
    """`found` with what higher orders than its own would still add, judged by the step from `coarser`."""
    working, other = found.modes.working, coarser.modes.working
    change = coarser.modes.frequency_hz / found.modes.frequency_hz - 1
    change[working] = coarser.modes.frequency_hz[other] / found.modes.frequency_hz[working] - 1
    error = np.abs(change)
    error[working] *= DOUBT[found.order]
    modes = found.modes._replace(frequency_hz=found.modes.frequency_hz * (1 - ADDED * change))
    return found._replace(modes=modes, error=error)


def _drafted(taxel: SolidTaxel, clock: _Clock) -> _Draft:
    engine("ngsolve").SetNumThreads(1)
    shape = clamped_shape(taxel_shape(taxel.step, taxel.washer_volume_mm3), taxel.clamp)
    clock.stop("read")
    mesh = coarse_mesh(shape, where=str(taxel.step))
    singular = singular_edges(shape, mesh)
    clock.stop("mesh")
    answer = _answered(taxel, engine("ngsolve").Mesh(mesh), 2, 6, clock)
    shares = edge_energy_shares(mesh, energy_shares(answer.system, taxel.materials, answer.eigen))
    worst = max((shares.get(edge, 0.0) for edge in singular), default=0.0)
    layered = {edge for edge in singular if shares.get(edge, 0.0) > EDGE_RATIO * worst}
    clock.stop("modes")
    return _Draft(taxel, shape, layered)


def _layered(draft: _Draft, setting: Setting, clock: _Clock) -> Any:
    fineness = Fineness(levels=setting.levels, per_face=setting.per_face)
    mesh = meshed(draft.shape, fineness, str(draft.taxel.step), draft.layered)
    clock.stop("mesh")
    return mesh


def _answered(taxel: SolidTaxel, mesh: Any, order: int, modes: int, clock: _Clock) -> _Answer:
    """Statics and modes, in blocks where rounding allows."""
    density = taxel.materials[WASHER].density_kg_per_m3
    for blocks in (True, False):
        system = assembled(mesh, taxel.materials, order, blocks=blocks)
        loads = rigid_loads(system, WASHER, density, taxel.washer_x_mm)
        clock.stop("assemble")
        solve = factored(system)
        clock.stop("factor")
        answers = np.array([solve(load) for load in loads.T]).T
        if accurate(system, solve, loads, answers):
            break
    else:
        raise SolverError("stiff and soft parts lie too far apart for double precision", str(taxel.step))
    eigen = eigenmodes(system, solve, modes, answers)
    clock.stop("modes")
    return _Answer(system, loads, answers, eigen)


def _solved(taxel: SolidTaxel, mesh: Any, setting: Setting, modes: int, clock: _Clock) -> SolidModes:
    order, levels, _ = setting
    system, loads, answers, eigen = _answered(taxel, mesh, order, modes, clock)
    motion = eigen.shape.T @ loads
    modal = motion.T @ (motion / (2 * np.pi * eigen.frequency_hz[:, None]) ** 2)
    return SolidModes(
        TaxelModes(eigen.frequency_hz, motion, loads.T @ answers - modal),
        order,
        levels,
        int(system.free.sum()),
        mesh.ne,
        eigen.residual,
        np.full(len(eigen.frequency_hz), np.nan),
        dict(clock.seconds),
    )
