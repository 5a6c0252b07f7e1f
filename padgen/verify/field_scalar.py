"""Magnetostatics by a scalar potential: steels that saturate, forces and moments on bodies.

H = T − ∇Ω with curl T the current (T–Ω formulation, Carpenter 1977): Ω minimises the co-energy, a convex
problem, so that Newton's method with a line search always gets there. Meshes are in mm, potentials in
(A/m)·mm, everything else in SI units. The far sphere carries the condition of a dipole at its centre,
``∂Ω/∂n = −2Ω/R``.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, SpecError, number
from padgen.physics.saturation import BHCurve
from padgen.verify.engines import engine

__all__ = ["BodyWrench", "ScalarField", "Steel", "body_wrench", "minimise", "solve_scalar"]

MU_0 = 4e-7 * np.pi
RESIDUAL, STEPS = 1e-8, 60
Steel = float | BHCurve
"""A relative permeability, or a magnetisation curve."""


class ScalarField(NamedTuple):
    """A solved field: NGSolve's `mesh` in mm and `field`, H in A/m as a coefficient function.

    `weight` multiplies volumes (2πr in mm in a half plane of revolution, 2 for half of a symmetric
    model); `co_energy_j`; `residual` of the last step relative to the first; `order` of the elements.
    """

    mesh: Any
    potential: Any
    field: Any
    weight: Any
    co_energy_j: float
    unknowns: int
    residual: float
    steps: int
    order: int


class BodyWrench(NamedTuple):
    """Force and moment (6,) in N and N·m on a body, and the same by a second method.

    `virtual_work` spreads a virtual displacement over all the air between the bodies; `surface` over the
    one layer of elements around the body (Coulomb 1983; Maxwell's stress right at the surface). They
    agree where the field is resolved.
    """

    virtual_work: np.ndarray
    surface: np.ndarray


def solve_scalar(
    mesh: Any,
    source: Any,
    steels: Mapping[str, Steel],
    far_radius_mm: float,
    order: int,
    weight: Any = 1.0,
    start: ScalarField | None = None,
    grounded: str = "",
) -> ScalarField:
    """Solve for Ω on `mesh` (materials named in `steels` are steel, all others air; far boundary ``far``).

    `source` is T in A/m as a coefficient function; it may jump at faces of the mesh only. `start` is a
    solution on the same mesh to begin with; on the boundary `grounded` Ω is 0 (a plane that the field crosses
    at a right angle).

    Raises
    ------
    SpecError
        A permeability that is not above 0.
    SolverError
        Newton's method does not bring the residual down to 1e-8 of the first.
    """
    ng = engine("ngsolve")
    space = ng.H1(mesh, order=order, dirichlet=grounded)
    trial = space.TrialFunction()
    field = source - ng.grad(trial)
    form = ng.BilinearForm(space, symmetric=True, condense=True)
    extra = 2 if mesh.dim == 2 else 1
    for name in dict.fromkeys(mesh.GetMaterials()):
        region = ng.dx(definedon=mesh.Materials(name), bonus_intorder=extra)
        form += ng.Variation(weight * _co_energy_density(ng, steels.get(name, 1.0), field, name) * region)
    form += ng.Variation(weight * MU_0 / far_radius_mm * trial**2 * ng.ds("far", bonus_intorder=2))
    potential = ng.GridFunction(space)
    if start is None and order > 1 and any(isinstance(steel, BHCurve) for steel in steels.values()):
        # Most of Newton's steps are then taken with few unknowns.
        start = solve_scalar(mesh, source, steels, far_radius_mm, order - 1, weight, grounded=grounded)
    if start is not None:
        potential.Set(start.potential)
    residual, steps = minimise(ng, form, space, potential)
    return ScalarField(
        mesh=mesh,
        potential=potential,
        field=source - ng.grad(potential),
        weight=weight,
        co_energy_j=float(form.Energy(potential.vec)) * 1e-9,
        unknowns=space.ndof,
        residual=residual,
        steps=steps,
        order=order,
    )


def _co_energy_density(ng: Any, steel: Steel, field: Any, name: str) -> Any:
    square = ng.InnerProduct(field, field)
    if isinstance(steel, BHCurve):
        fields, densities = steel.samples()
        curve = ng.BSpline(2, [0.0, *fields.tolist()], densities.tolist()).Integrate()
        return curve(ng.sqrt(square + (1e-6 * float(fields[1])) ** 2))
    if not steel > 0:
        raise SpecError(f"the permeability must be above 0, got {number(steel)}", name)
    return MU_0 * steel / 2 * square


def minimise(ng: Any, form: Any, space: Any, solution: Any) -> tuple[float, int]:
    """Minimise the convex energy `form` (statically condensed) from `solution` on; residual and Newton steps.

    Raises
    ------
    SolverError
        The residual does not come down to 1e-8 of the first, or no step lowers the energy.
    """
    slope, step, trial = (solution.vec.CreateVector() for _ in range(3))
    free = ng.Projector(space.FreeDofs(), True)
    first, residual = 0.0, 1.0
    for count in range(STEPS):
        form.Apply(solution.vec, slope)
        free.Project(slope)
        size = float(slope.Norm())
        first = first or size
        residual = size / first if first else 0.0
        if residual <= RESIDUAL:
            return residual, count
        form.AssembleLinearization(solution.vec)
        _newton_step(form, space, slope, step)
        if not _line_search(form, solution, step, trial, expected=float(ng.InnerProduct(slope, step))):
            break
    if residual <= 100 * RESIDUAL:  # the energy has no more digits to lose
        return residual, count
    raise SolverError(
        f"the magnetic field did not converge: after {count + 1} Newton steps the residual is"
        f" {number(residual)} of the first, it must be {number(RESIDUAL)}"
    )


def _newton_step(form: Any, space: Any, slope: Any, step: Any) -> None:
    inverse = form.mat.Inverse(space.FreeDofs(True), inverse="sparsecholesky")
    outer = slope.CreateVector()
    outer.data = slope + form.harmonic_extension_trans * slope
    step.data = inverse * outer
    step.data += form.harmonic_extension * step
    step.data += form.inner_solve * slope


def _line_search(form: Any, solution: Any, step: Any, trial: Any, expected: float) -> bool:
    """Go along −step as far as the energy falls by a share of what the slope promises; False if nowhere."""
    energy, share = float(form.Energy(solution.vec)), 1.0
    while share > 1e-6:
        trial.data = solution.vec - share * step
        if float(form.Energy(trial)) <= energy - 1e-4 * share * expected + 1e-13 * abs(energy):
            solution.vec.data = trial
            return True
        share /= 2
    return False


def body_wrench(solved: ScalarField, body: str, at_mm: tuple[float, float, float]) -> BodyWrench:
    """Wrench on the material `body`, surrounded by the material ``air``, about the point `at_mm`.

    In a half plane of revolution (two-dimensional meshes) only Fz.
    """
    ng = engine("ngsolve")
    space = ng.H1(solved.mesh, order=1)
    moved = _flags(space.GetDofs(solved.mesh.Materials(body)))
    near = ng.GridFunction(space)
    near.vec.FV().NumPy()[:] = moved
    both = [_stress_on(ng, solved, shift, at_mm) for shift in (_spread(ng, solved, space, near), near)]
    return BodyWrench(*both)


def _flags(dofs: Any) -> np.ndarray:
    return np.fromiter((float(flag) for flag in dofs), float)


def _spread(ng: Any, solved: ScalarField, space: Any, near: Any) -> Any:
    """The displacement 1 on the body, harmonic in the air, 0 on all other bodies and on the far sphere."""
    mesh = solved.mesh
    others = [name for name in dict.fromkeys(mesh.GetMaterials()) if name != "air"]
    fixed = space.GetDofs(mesh.Materials("|".join(others))) | space.GetDofs(mesh.Boundaries("far"))
    trial, test = space.TnT()
    form = ng.BilinearForm(solved.weight * ng.grad(trial) * ng.grad(test) * ng.dx).Assemble()
    spread = ng.GridFunction(space)
    spread.vec.data = near.vec
    spread.vec.data -= form.mat.Inverse(~fixed, inverse="sparsecholesky") @ form.mat * near.vec
    return spread


def _stress_on(ng: Any, solved: ScalarField, shift: Any, at_mm: tuple[float, float, float]) -> np.ndarray:
    """``−∫ σ·∇g`` and its moment, with Maxwell's stress σ = μ0 (H⊗H − ½ H²)."""
    slope, field = ng.grad(shift), solved.field
    density = MU_0 * (ng.InnerProduct(field, field) / 2 * slope - ng.InnerProduct(field, slope) * field)
    options = {"definedon": solved.mesh.Materials("air"), "order": 2 * solved.order + 2}
    if solved.mesh.dim == 2:
        pull = float(ng.Integrate(solved.weight * density[1], solved.mesh, **options)) * 1e-6
        return np.array([0.0, 0.0, pull, 0.0, 0.0, 0.0])
    arm = [c - a for c, a in zip((ng.x, ng.y, ng.z), at_mm, strict=True)]
    part = [density[i] for i in range(3)]
    moment = [arm[i - 2] * part[i - 1] - arm[i - 1] * part[i - 2] for i in range(3)]
    total = np.array(ng.Integrate(solved.weight * ng.CF((density, *moment)), solved.mesh, **options))
    return np.asarray(total * np.array([1e-6] * 3 + [1e-9] * 3))
