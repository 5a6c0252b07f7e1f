"""The `solid` rung of the structure ladder: one taxel's modes by 3-D elasticity on the STEP file that is built.

NGSolve must not be imported into a process that has loaded build123d: call these functions in a
process of their own (they can be pickled).
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.physics.resonator import TaxelModes
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
    LEAN,
    Eigen,
    Elastic,
    Orthotropy,
    System,
    accurate,
    assembled,
    edge_energy_shares,
    eigenmodes,
    energy_shares,
    factored,
    layered,
    rigid_loads,
)
from padgen.verify.engines import ng

__all__ = ["SETTINGS", "Elastic", "Orthotropy", "SolidModes", "SolidTaxel", "converged_modes", "layered", "solve_modes"]


class Setting(NamedTuple):
    """Order of the elements, levels of layers, and their largest size (`Fineness.per_face`)."""

    order: int
    levels: int
    per_face: float = 1.0


SETTINGS = (Setting(3, 2), Setting(3, 2, 0.5), Setting(4, 2, 0.5), Setting(4, 3, 0.35))
"""Cheapest first."""
ADDED = {3: 0.15, 4: 0.7}
"""Share of the last order's change that all higher orders and finer meshes together still make: 0.03 … 0.24 at order 3,
0.6 … 1.4 at order 4, whose change is small, on the taxels of docs/accuracy.md."""
DOUBT = {3: 1 / 6, 4: 0.7}
"""Share of that change by which the extrapolated frequency may be off."""
REST = 3e-4
"""Relative error of a frequency that no order shows: curves of order `LEAN`, elements that stay at it."""
EDGE_RATIO = 0.02
"""Layers are worth while along edges whose tetrahedra hold this much of the energy at the worst edge."""
POOR, POOR_OTHERS = 0.01, 0.2
"""Share of the working mode's energy, and of every other's, in the elements that may stay at order `LEAN`."""


class SolidTaxel(NamedTuple):
    """One taxel to solve: a STEP file in mm with two solids, printed part and washer, bonded where they
    touch. `glue_kg` is carried by the washer. `clamp` is one of `elastic_mesh.CLAMPS`. Refusals call it by its `name`,
    by its file where it has none."""

    step: Path
    printed: Elastic
    washer: Elastic
    washer_volume_mm3: float
    washer_x_mm: float
    glue_kg: float = 0.0
    clamp: str = "sides"
    name: str = ""

    @property
    def where(self) -> str:
        """Beginning of refusals."""
        return self.name or str(self.step)

    @property
    def materials(self) -> dict[str, Elastic]:
        """Materials by name of solid, the glue's mass in the washer's density."""
        density = self.washer.density_kg_per_m3 + self.glue_kg / (self.washer_volume_mm3 * 1e-9)
        return {PRINTED: self.printed, WASHER: self.washer._replace(density_kg_per_m3=density)}


class SolidModes(NamedTuple):
    """Modes by elements of `order` on `elements` with `unknowns`; `residual` of the worst mode;
    `error` (k,) estimated relative error of each frequency,
    nan where there is no second order to compare with; `setting` that of `SETTINGS` which was solved last."""

    modes: TaxelModes
    order: int
    levels: int
    unknowns: int
    elements: int
    residual: float
    error: np.ndarray
    setting: int = 0

    @property
    def working_error(self) -> float:
        """Estimated relative error of the working mode's frequency."""
        return float(self.error[self.modes.working])


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


def solve_modes(taxel: SolidTaxel, order: int = 3, levels: int = 2, modes: int = 6) -> SolidModes:
    """Return the lowest modes of `taxel` by elements of `order` with `levels` of layers round singular edges.

    All frequencies come out too high. `rest` of the result makes the static compliance exact.

    Raises
    ------
    SolverError
        The STEP file does not hold a taxel, cannot be meshed, or the solver does not converge.
    """
    if order < 2 or levels < 0 or modes < 1:
        raise SolverError(f"needs order ≥ 2, levels ≥ 0 and modes ≥ 1, got {order}, {levels} and {modes}", "elasticity")
    draft = _drafted(taxel)
    setting = Setting(order, levels)
    return _result(_answered(draft, _layered(draft, setting), order, modes), setting)


def converged_modes(taxel: SolidTaxel, tolerance: float = 1e-3, modes: int = 6, first: int = 0) -> SolidModes:
    """Return modes with the estimated error of the working mode below `tolerance`, by the cheapest setting that does.

    Where no setting does, the modes of the one that comes nearest: compare their `error`. Settings before the one of
    place `first` in `SETTINGS` are not tried.

    On one mesh, order 2 tells which elements hold the energy, and these alone are solved by higher orders; the
    frequencies are extrapolated by a share of the last order's change, which the error grows with. Of other
    modes `error` is the whole change; for the torsion of thin beams, slow to converge, it may be too small.

    Raises
    ------
    SolverError
        As `solve_modes`; no such tolerance.
    """
    if not 0 < tolerance < 1:
        raise SolverError(f"must lie between 0 and 1, got {number(tolerance)}, e.g. 0.001", "tolerance")
    known, before = None, None
    draft = _drafted(taxel)
    for place, setting in enumerate(SETTINGS[first:], first):
        try:
            if before != setting[1:]:
                mesh, before = _layered(draft, setting), setting[1:]
                lean = _answered(draft, mesh, LEAN, modes)
                found = _result(lean, setting._replace(order=LEAN))
                shares = energy_shares(lean.system, taxel.materials, lean.eigen)
                rich = _rich(mesh, shares, found.modes.working)
            for order in range(found.order + 1, setting.order + 1):
                coarser = found
                found = _result(_answered(draft, mesh, order, modes, rich), setting._replace(order=order))
        except SolverError:
            if known is None:
                raise
            break  # the finer mesh tears: what is known stays
        extrapolated = _extrapolated(coarser, found)._replace(setting=place)
        if known is None or extrapolated.working_error < known.working_error:
            known = extrapolated
        if known.working_error < tolerance:
            break
    assert known is not None
    return known


def _rich(mesh: Any, shares: np.ndarray, working: int) -> np.ndarray:
    """Elements (n,) to solve by higher orders: those that hold all but little of each mode's energy `shares` (n, k),
    and all that touch them, where a stiff element has no energy because it cannot follow."""
    poor = np.full(shares.shape[1], POOR_OTHERS)
    poor[working] = POOR
    order = shares.argsort(0)
    rich = np.empty(shares.shape, bool)
    np.put_along_axis(rich, order, np.take_along_axis(shares, order, 0).cumsum(0) > poor, 0)
    corners = [[corner.nr for corner in element.vertices] for element in mesh.Elements()]
    touched = np.zeros(mesh.nv, bool)
    for place in np.flatnonzero(rich.any(1)):
        touched[corners[place]] = True
    return np.array([touched[own].any() for own in corners])


def _extrapolated(coarser: SolidModes, found: SolidModes) -> SolidModes:
    """Add to `found` what higher orders than its own would still add, judged by the step from `coarser`."""
    working, other = found.modes.working, coarser.modes.working
    change = coarser.modes.frequency_hz / found.modes.frequency_hz - 1
    change[working] = coarser.modes.frequency_hz[other] / found.modes.frequency_hz[working] - 1
    error = np.abs(change)
    error[working] = DOUBT[found.order] * error[working] + REST
    modes = found.modes._replace(frequency_hz=found.modes.frequency_hz * (1 - ADDED[found.order] * change))
    return found._replace(modes=modes, error=error)


def _drafted(taxel: SolidTaxel) -> _Draft:
    ng.SetNumThreads(1)
    shape = clamped_shape(taxel_shape(taxel.step, taxel.washer_volume_mm3, taxel.where), taxel.clamp)
    mesh = coarse_mesh(shape, where=taxel.where)
    singular = singular_edges(shape, mesh)
    draft = _Draft(taxel, shape, set())
    answer = _answered(draft, ng.Mesh(mesh), LEAN, 6)
    shares = edge_energy_shares(mesh, energy_shares(answer.system, taxel.materials, answer.eigen))
    worst = max((shares.get(edge, 0.0) for edge in singular), default=0.0)
    return draft._replace(layered={edge for edge in singular if shares.get(edge, 0.0) > EDGE_RATIO * worst})


def _layered(draft: _Draft, setting: Setting) -> Any:
    fineness = Fineness(levels=setting.levels, per_face=setting.per_face)
    return meshed(draft.shape, fineness, draft.taxel.where, draft.layered)


def _answered(draft: _Draft, mesh: Any, order: int, modes: int, rich: np.ndarray | None = None) -> _Answer:
    """Solve statics and modes, in blocks where rounding allows; elsewhere every element is `rich`."""
    taxel = draft.taxel
    density = taxel.materials[WASHER].density_kg_per_m3
    volumes = {solid.name: solid.mass for solid in draft.shape.solids}
    for blocks in (True, False):
        of_order = rich if blocks else None
        system = assembled(mesh, taxel.materials, order, blocks=blocks, rich=of_order, volume_mm3=volumes)
        loads = rigid_loads(system, WASHER, density, taxel.washer_x_mm)
        solve = factored(system)
        answers = np.array([solve(load) for load in loads.T]).T
        if accurate(system, solve, loads, answers):
            break
    else:
        raise SolverError("stiff and soft parts lie too far apart for double precision", taxel.where)
    eigen = eigenmodes(system, solve, modes, answers)
    return _Answer(system, loads, answers, eigen)


def _result(answer: _Answer, setting: Setting) -> SolidModes:
    system, loads, answers, eigen = answer
    motion = eigen.shape.T @ loads
    modal = motion.T @ (motion / (2 * np.pi * eigen.frequency_hz[:, None]) ** 2)
    return SolidModes(
        TaxelModes(eigen.frequency_hz, motion, loads.T @ answers - modal),
        setting.order,
        setting.levels,
        int(system.free.sum()),
        system.space.mesh.ne,
        eigen.residual,
        np.full(len(eigen.frequency_hz), np.nan),
    )
