"""Magnetostatics by a scalar potential: steels that saturate, forces and moments on washers anywhere over a coil.

H = T − ∇Ω with curl T the current (T–Ω formulation, Carpenter 1977): Ω minimises the co-energy, a convex
problem, so that Newton's method with a line search always gets there. Meshes are in mm, potentials in
(A/m)·mm, everything else in SI units. The far sphere carries the condition of a dipole at its centre,
``∂Ω/∂n = −2Ω/R``.

A washer on the coil's axis is solved in the half plane, and its pull bracketed by two potentials. Elsewhere the field
is solved in space, where several washers shield each other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.physics.magnetics import MU_0, BHCurve, CoilSource, SteelRing
from padgen.verify import ng, occ

__all__ = [
    "WIDEST",
    "AxisymmetricForce",
    "BodyWrench",
    "PlacedWasher",
    "PullQuestion",
    "ScalarField",
    "SolidForce",
    "Steel",
    "axisymmetric_force",
    "body_wrench",
    "coil_cells",
    "minimise",
    "solid_force",
    "solid_pull",
    "solve_scalar",
    "winding_source",
]

RESIDUAL = 1e-8
STEPS = 60
Steel = float | BHCurve
"""A relative permeability, or a magnetisation curve."""


class ScalarField(NamedTuple):
    """A solved field: NGSolve's `mesh` in mm and `field`, H in A/m as a coefficient function.

    `weight` multiplies volumes (2πr in mm in a half plane of revolution, 2 for half of a symmetric
    model); `residual` of the last step relative to the first; `order` of the elements.
    """

    mesh: Any
    potential: Any
    field: Any
    weight: Any
    unknowns: int
    residual: float
    order: int


class BodyWrench(NamedTuple):
    """Force and moment (6,) in N and N·m on a body, by virtual work in the air and by stress at its surface.

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
) -> ScalarField:
    """Return the scalar-potential field on `mesh`: `steels` by material name, all else air, outer faces named ``far``.

    `source` is T in A/m as a coefficient function; it may jump at faces of the mesh only. `start` is a
    solution on the same mesh to begin with.

    Raises
    ------
    SolverError
        Newton's method does not bring the residual down to 1e-8 of the first.
    """
    space = ng.H1(mesh, order=order)
    trial = space.TrialFunction()
    field = source - ng.grad(trial)
    form = ng.BilinearForm(space, symmetric=True, condense=True)
    for name in dict.fromkeys(mesh.GetMaterials()):
        region = ng.dx(definedon=mesh.Materials(name), bonus_intorder=2 if mesh.dim == 2 else 1)
        form += ng.Variation(weight * _energy_density(steels.get(name, 1.0), field) * region)
    form += ng.Variation(weight * MU_0 / far_radius_mm * trial**2 * ng.ds("far", bonus_intorder=2))
    potential = ng.GridFunction(space)
    if start is None and order > 1 and any(isinstance(steel, BHCurve) for steel in steels.values()):
        # Most of Newton's steps are then taken with few unknowns.
        start = solve_scalar(mesh, source, steels, far_radius_mm, order - 1, weight)
    if start is not None:
        potential.Set(start.potential)
    residual = minimise(form, space, potential)
    return ScalarField(mesh, potential, source - ng.grad(potential), weight, space.ndof, residual, order)


def _energy_density(steel: Steel, field: Any, of_flux: bool = False) -> Any:
    """Return the co-energy in J/m³ of a field H in A/m or, if `of_flux`, the energy of a flux density B in T."""
    square = ng.InnerProduct(field, field)
    if isinstance(steel, BHCurve):
        along, across = (axis.tolist() for axis in (steel.samples()[::-1] if of_flux else steel.samples()))
        return ng.BSpline(2, [0.0, *along], across).Integrate()(ng.sqrt(square + (1e-6 * along[1]) ** 2))
    return square / (2 * MU_0 * steel) if of_flux else MU_0 * steel / 2 * square


def minimise(form: Any, space: Any, solution: Any) -> float:
    """Minimise the convex energy `form` (statically condensed) from `solution` on; return the residual.

    Raises
    ------
    SolverError
        The residual does not come down to 1e-8 of the first, or no step lowers the energy.
    """
    slope, step, trial = (solution.vec.CreateVector() for _ in range(3))
    free = ng.Projector(space.FreeDofs(), True)
    first = 0.0
    residual = 1.0
    for _ in range(STEPS):
        form.Apply(solution.vec, slope)
        free.Project(slope)
        size = float(slope.Norm())
        first = first or size
        residual = size / first if first else 0.0
        if residual <= RESIDUAL:
            return residual
        form.AssembleLinearization(solution.vec)
        inverse = form.mat.Inverse(space.FreeDofs(True), inverse="sparsecholesky")
        step.data = inverse * (slope + form.harmonic_extension_trans * slope).Evaluate()
        step.data += form.harmonic_extension * step
        step.data += form.inner_solve * slope
        if not _line_search(form, solution, step, trial, expected=float(ng.InnerProduct(slope, step))):
            break
    if residual <= 100 * RESIDUAL:  # the energy has no more digits to lose
        return residual
    raise SolverError(
        f"the magnetic field did not converge: Newton's steps leave a residual of {number(residual)} of the first, it"
        f" must be {number(RESIDUAL)}"
    )


def _line_search(form: Any, solution: Any, step: Any, trial: Any, expected: float) -> bool:
    """Move `solution` along −step by backtracking until the energy falls enough; return False if it never does."""
    energy = float(form.Energy(solution.vec))
    share = 1.0
    while share > 1e-6:
        trial.data = solution.vec - share * step
        if float(form.Energy(trial)) <= energy - 1e-4 * share * expected + 1e-13 * abs(energy):
            solution.vec.data = trial
            return True
        share /= 2
    return False


def body_wrench(solved: ScalarField, body: str, at_mm: tuple[float, float, float]) -> BodyWrench:
    """Return the wrench on the material `body`, surrounded by the material ``air``, about the point `at_mm`.

    In a half plane of revolution (two-dimensional meshes) only Fz.
    """
    space = ng.H1(solved.mesh, order=1)
    moved = np.fromiter((float(flag) for flag in space.GetDofs(solved.mesh.Materials(body))), float)
    near = ng.GridFunction(space)
    near.vec.FV().NumPy()[:] = moved
    return BodyWrench(
        *(_stress_on(solved, shift, at_mm) for shift in (_virtual_displacement(solved, space, near), near))
    )


def _virtual_displacement(solved: ScalarField, space: Any, near: Any) -> Any:
    """Return a virtual displacement: 1 on the body, harmonic in the air, 0 on other bodies and the far boundary."""
    mesh = solved.mesh
    others = [name for name in dict.fromkeys(mesh.GetMaterials()) if name != "air"]
    fixed = space.GetDofs(mesh.Materials("|".join(others))) | space.GetDofs(mesh.Boundaries("far"))
    trial, test = space.TnT()
    form = ng.BilinearForm(solved.weight * ng.grad(trial) * ng.grad(test) * ng.dx).Assemble()
    spread = ng.GridFunction(space)
    spread.vec.data = near.vec - form.mat.Inverse(~fixed, inverse="sparsecholesky") @ form.mat * near.vec
    return spread


def _stress_on(solved: ScalarField, shift: Any, at_mm: tuple[float, float, float]) -> np.ndarray:
    """Return force and moment (6,) ``−∫ σ·∇shift`` on the body on which the weight `shift` is 1.

    The integral is over the air, where `shift` falls to 0, with Maxwell's stress σ = μ0 (H⊗H − ½ H²); the moment is
    about `at_mm`.
    """
    slope = ng.grad(shift)
    field = solved.field
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


FAR = 15.0
"""Radius of the far sphere over the largest distance of a part from the coil's middle."""
SHRINK = 0.2
"""Size of elements at a marked corner or edge, over that of their neighbours, in each refinement."""
WIDEST = 0.2
"""Relative width of a bracket of the force that is too wide to be an answer."""


class AxisymmetricForce(NamedTuple):
    """Axial force on the washer in N, negative towards the coil, by the scalar and by the vector potential.

    The scalar potential bounds the field's energy from one side, the vector potential from the other;
    so far they did so with the force as well. Taken is the method (`BodyWrench`) by which the two lie
    closer together: virtual work near the coil; far away, where that drowns in rounding, the stress around the
    washer. `residual` is the larger of the two.
    """

    scalar_n: float
    vector_n: float
    unknowns: int
    residual: float

    @property
    def force_n(self) -> float:
        """The force in N: the mean of those by the two potentials."""
        return (self.scalar_n + self.vector_n) / 2

    @property
    def error(self) -> float:
        """Relative difference of the forces by the scalar and the vector potential; inf if their mean is 0."""
        return abs(self.scalar_n - self.vector_n) / abs(self.force_n) if self.force_n else float("inf")


def axisymmetric_force(
    coil: CoilSource,
    washer: SteelRing,
    gap_m: float,
    current_a: float = 1.0,
    core_steel: BHCurve | None = None,
    washer_steel: BHCurve | None = None,
    order: int = 5,
    levels: int = 4,
) -> AxisymmetricForce:
    """Return the force on a washer on the coil's axis, `gap_m` above its top face, at `current_a`.

    A steel of None is linear, with the part's permeability. Elements of `order` (at least 3), refined
    `levels` times towards every corner of core and washer.

    Raises
    ------
    SolverError
        The parts cannot be meshed, Newton's method does not converge, or the two potentials differ by more
        than a fifth (a washer very far away).
    """
    mesh, far_mm = _half_plane(coil, washer, gap_m, levels)
    steels: dict[str, Steel] = {
        "core": core_steel or coil.core_permeability,
        "washer": washer_steel or washer.permeability,
    }
    source = ng.CF((0, winding_source(coil, current_a, ng.x, ng.y)[0]))
    scalar = solve_scalar(mesh, source, steels, far_mm, order, weight=2 * np.pi * ng.x)
    vector = _by_vector(mesh, coil, current_a, steels, far_mm, order)
    methods = zip(*(body_wrench(field, "washer", (0, 0, 0)) for field in (scalar, vector)), strict=True)
    residual = max(scalar.residual, vector.residual)
    forces = (AxisymmetricForce(float(a[2]), float(b[2]), scalar.unknowns, residual) for a, b in methods)
    force = min(forces, key=lambda force: force.error)
    if force.error > WIDEST:
        raise SolverError(
            f"the force of {number(abs(force.force_n))} N over a gap of {number(gap_m)} m drowns in the field's own"
            f" error: the two potentials differ by {number(force.error)} of it, they may by {WIDEST};"
            " a smaller gap, a higher order or surface charges would do"
        )
    return force


def _half_plane(coil: CoilSource, washer: SteelRing, gap_m: float, levels: int) -> tuple[Any, float]:
    """Return the mesh of coil, washer and air in mm (x: radius, y: height above coil), and its outer radius in mm."""
    low = 1e3 * gap_m
    high = 1e3 * (gap_m + washer.thickness)
    hole = 500 * washer.inner_diameter
    rim = 500 * washer.outer_diameter
    outer = 500 * coil.outer_diameter
    length = 1e3 * coil.length
    rings = [(hole, rim, low, high)]
    if washer.crown_height:
        across = 500 * washer.crown_inner_diameter, 500 * washer.crown_outer_diameter
        rings.append((*across, high, high + 1e3 * washer.crown_height))
    reach = max(np.hypot(right, top + length / 2) for _, right, _, top in rings)
    far = FAR * max(np.hypot(outer, length / 2), reach)
    faces = []
    for name, left, right, bottom, top in [*(("washer", *ring) for ring in rings), *coil_cells(coil)]:
        face = occ.MoveTo(left, bottom).Rectangle(right - left, top - bottom).Face()
        face.faces.name = name
        face.faces.maxh = max(top - bottom, right - left)
        faces.append(face)
    air = occ.Circle((0, -length / 2), far).Face()
    air *= occ.MoveTo(0, -length / 2 - 2 * far).Rectangle(2 * far, 4 * far).Face()
    air.edges.name = "far"
    air.edges[1e-6 * far >= occ.X].name = "axis"
    for face in faces:
        air -= face
    air.faces.name = "air"
    shape = occ.Glue([*faces, air])
    core = 500 * coil.core_diameter
    core_top = 1e3 * coil.core_top
    corners = [(r, z) for left, right, *ends in rings for r in (left, right) for z in ends]
    corners += [(core, z) for z in (core_top, core_top - 1e3 * coil.core_length)]
    for vertex in shape.vertices:
        if any(r > 0 and np.hypot(vertex.p.x - r, vertex.p.y - z) < 1e-6 * r for r, z in corners):
            vertex.hpref = 1
    return _meshed(shape, levels, dim=2, maxh=far / 4, grading=0.3), far


def _meshed(shape: Any, levels: int, dim: int, **sizes: Any) -> Any:
    """Return the curved mesh of a shape, refined `levels` times where it is marked."""
    try:
        mesh = ng.Mesh(occ.OCCGeometry(shape, dim=dim).GenerateMesh(**sizes))
    except Exception as error:  # netgen raises its own and the geometry kernel's types
        raise SolverError(f"coil and washers could not be meshed ({error})") from error
    if levels:
        mesh.RefineHP(levels, SHRINK)
    mesh.Curve(3)
    return mesh


def coil_cells(coil: CoilSource) -> list[tuple[str, float, float, float, float]]:
    """Return the coil's cross-section as rectangles: name, inner and outer radius, lower and upper height in mm.

    Named ``core``, ``winding``, or ``bore`` within a winding.
    """
    core = 500 * coil.core_diameter
    core_top = 1e3 * coil.core_top
    core_low = core_top - 1e3 * coil.core_length
    wound = [
        tuple(1e3 * v for v in (w.inner_diameter / 2, w.outer_diameter / 2, w.bottom, w.top)) for w in coil.windings
    ]
    radii = _edges(0.0, core, *(r for w in wound for r in w[:2]))
    heights = _edges(*(z for w in wound for z in w[2:]), *((core_low, core_top) if core else ()))
    cells = []
    for r, next_r in pairwise(radii):
        for z, next_z in pairwise(heights):
            around = [w for w in wound if r < w[1] and w[2] <= z < w[3]]
            if r < core and core_low <= z < core_top:
                cells.append(("core", r, next_r, z, next_z))
            elif around:
                within = any(w[0] <= r for w in around)
                cells.append(("winding" if within else "bore", r, next_r, z, next_z))
    return cells


def _edges(*places: float) -> list[float]:
    """Return coordinates in rising order, without those that differ from the one before by rounding only."""
    ordered = sorted(places)
    close = 1e-6 * (ordered[-1] - ordered[0])
    return [ordered[0], *(v for u, v in pairwise(ordered) if v - u > close)]


def winding_source(coil: CoilSource, current_a: float, radius: Any, height: Any) -> tuple[Any, Any]:
    """Return the current vector potential T_z in A/m and the current density in A/(m·mm), for positions in mm."""
    potential = ng.CF(0)
    density = ng.CF(0)
    for w in coil.windings:
        inner = 500 * w.inner_diameter
        outer = 500 * w.outer_diameter
        full = w.turns * current_a / w.length
        share = ng.IfPos(radius - inner, ng.IfPos(outer - radius, (outer - radius) / (outer - inner), 0), 1)
        among = ng.IfPos(height - 1e3 * w.bottom, ng.IfPos(1e3 * w.top - height, full, 0), 0)
        potential += among * share
        density += among * ng.IfPos(radius - inner, ng.IfPos(outer - radius, 1 / (outer - inner), 0), 0)
    return potential, density


def _by_vector(
    mesh: Any, coil: CoilSource, current_a: float, steels: dict[str, Steel], far_mm: float, order: int
) -> ScalarField:
    """Solve the axisymmetric field by its vector potential ``r w`` (T, mm): ``B = (−r ∂w/∂z, 2w + r ∂w/∂r)``."""
    _, density = winding_source(coil, current_a, ng.x, ng.y)
    space = ng.H1(mesh, order=order)
    trial = space.TrialFunction()
    weight = 2 * np.pi * ng.x
    flux = _curl(trial)
    form = ng.BilinearForm(space, symmetric=True, condense=True)
    for name in dict.fromkeys(mesh.GetMaterials()):
        region = ng.dx(definedon=mesh.Materials(name), bonus_intorder=4)
        form += ng.Variation(weight * _energy_density(steels.get(name, 1.0), flux, of_flux=True) * region)
    form += ng.Variation(-weight * density * ng.x * trial * ng.dx(bonus_intorder=4))
    far = weight * (ng.x * trial) ** 2 / (2 * MU_0 * far_mm)
    form += ng.Variation(far * ng.ds("far", bonus_intorder=4))
    potential = ng.GridFunction(space)
    residual = minimise(form, space, potential)
    field = _curl(potential) / MU_0  # right in air, where the stress is taken
    return ScalarField(mesh, potential, field, weight, space.ndof, residual, order)


def _curl(w: Any) -> Any:
    slope = ng.grad(w)
    return ng.CF((-ng.x * slope[1], 2 * w + ng.x * slope[0]))


FAR_IN_SPACE = 8.0
"""Radius of the far sphere over the largest distance of a part from the coil's middle."""


class PlacedWasher(NamedTuple):
    """A washer whose underside's middle lies at (`x_m`, `y_m`, `gap_m`) from the middle of the coil's top face."""

    ring: SteelRing
    gap_m: float
    x_m: float
    y_m: float = 0.0
    steel: BHCurve | None = None


class SolidForce(NamedTuple):
    """Wrench (washers, 6) on each washer: force in N, and moment in N·m about its underside's centre.

    Axes as `PlacedWasher`'s; `surface` is the same by a second method (`BodyWrench`), `error` the
    larger of their disagreement and the step from elements of one order less, relative to the force.
    """

    wrench: np.ndarray
    surface: np.ndarray
    error: float
    unknowns: int
    residual: float


def solid_force(
    coil: CoilSource,
    washers: Sequence[PlacedWasher],
    current_a: float = 1.0,
    core_steel: BHCurve | None = None,
    order: int = 3,
    levels: int = 1,
    size: float = 1.0,
) -> SolidForce:
    """Return forces and moments on `washers` above a coil that carries `current_a`.

    A steel of None is linear, with the part's permeability. Elements of `order` (at least 2), refined
    `levels` times towards the edges of core and washers; those of washers are `size` times as large as usual. Where
    all washers lie on y = 0 half the model is solved.

    Raises
    ------
    SolverError
        The parts cannot be meshed, Newton's method does not converge, or the force's own error is more than a
        fifth of it (a washer far away).
    """
    half = all(abs(w.y_m) < 1e-9 for w in washers)
    mesh, far_mm = _mesh(coil, washers, half, levels, size)
    steels: dict[str, Steel] = {f"washer{i}": w.steel or w.ring.permeability for i, w in enumerate(washers)}
    steels["core"] = core_steel or coil.core_permeability
    source = ng.CF((0, 0, winding_source(coil, current_a, ng.sqrt(ng.x**2 + ng.y**2), ng.z)[0]))
    weight = 2.0 if half else 1.0
    kept = np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0]) if half else np.ones(6)

    def at_order(p: int, start: ScalarField | None) -> tuple[ScalarField, np.ndarray, np.ndarray]:
        solved = solve_scalar(mesh, source, steels, far_mm, p, weight, start)
        both = [body_wrench(solved, f"washer{i}", _foot_mm(w)) for i, w in enumerate(washers)]
        return solved, kept * [b.virtual_work for b in both], kept * [b.surface for b in both]

    first, coarse, _ = at_order(order - 1, None)
    # Of linear steels a start saves nothing.
    solved, wrench, surface = at_order(order, first if BHCurve in map(type, steels.values()) else None)
    size = np.linalg.norm(wrench[:, :3], axis=1).max()
    off = max(np.linalg.norm((other - wrench)[:, :3], axis=1).max() for other in (coarse, surface))
    error = float(off / size) if size > 0 else 0.0
    if error > WIDEST:
        raise SolverError(
            f"the pull drowns in the field's own error, {number(error)} of it, which may be {WIDEST}: a higher order"
            f" than {order} or a washer nearer to the coil would do"
        )
    return SolidForce(
        wrench=wrench,
        surface=surface,
        error=error,
        unknowns=solved.unknowns,
        residual=solved.residual,
    )


def _foot_mm(washer: PlacedWasher) -> tuple[float, float, float]:
    return 1e3 * washer.x_m, 1e3 * washer.y_m, 1e3 * washer.gap_m


def _mesh(coil: CoilSource, washers: Sequence[PlacedWasher], half: bool, levels: int, size: float) -> tuple[Any, float]:
    """Return the 3-D mesh in mm of coil, washers and air (with `half`, of y ≥ 0 only), and its outer radius in mm.

    It is refined at the circular edges of core and washers, where the field is singular.
    """
    length = 1e3 * coil.length
    core = 500 * coil.core_diameter
    top = 1e3 * coil.core_top
    parts = []
    for name, inner, outer, low, high in coil_cells(coil):
        part = _tube((0.0, 0.0, low), inner, outer, high - low).mat(name)
        if name == "core":
            part.faces.maxh = 0.6 * outer
        parts.append(part)
    circles = [(0.0, 0.0, z, core) for z in (top, top - 1e3 * coil.core_length) if core > 0]
    reach = float(np.hypot(500 * coil.outer_diameter, length / 2))
    for i, w in enumerate(washers):
        x, y, z = _foot_mm(w)
        rim = 500 * w.ring.outer_diameter
        high = 1e3 * w.ring.thickness
        body = _tube((x, y, z), 500 * w.ring.inner_diameter, rim, high)
        circles += [(x, y, h, 500 * d) for h in (z, z + high) for d in w.ring[:2]]
        if w.ring.crown_height:
            across = 500 * w.ring.crown_inner_diameter, 500 * w.ring.crown_outer_diameter
            crown = 1e3 * w.ring.crown_height
            body = body + _tube((x, y, z + high), *across, crown)
            circles += [(x, y, h, radius) for h in (z + high, z + high + crown) for radius in across]
            rim = max(rim, across[1])
            high += crown
        body.mat(f"washer{i}").maxh = size * max(high, rim / 2)
        parts.append(body)
        reach = max(reach, float(np.hypot(np.hypot(x, y) + rim, z + high + length / 2)))
    far = FAR_IN_SPACE * reach
    air = occ.Sphere(occ.Pnt(0, 0, -length / 2), far)
    air.faces.name = "far"
    for part in parts:
        air -= part
    shape = occ.Glue([*parts, air.mat("air")])
    if half:
        shape *= occ.Box(occ.Pnt(-2 * far, 0, -2 * far), occ.Pnt(2 * far, 2 * far, 2 * far))
    for edge in shape.edges:
        ends = [v.p for v in edge.vertices]  # edge.start crashes on the poles of the sphere
        front, back = (corner.y for corner in edge.bounding_box)
        for x, y, z, radius in circles:
            on_circle = all(abs(p.z - z) + abs(np.hypot(p.x - x, p.y - y) - radius) < 1e-6 * radius for p in ends)
            if on_circle and back - front > radius / 2:  # a cut's diameter ends on the circle too, but is flat in y
                edge.hpref = 1
    return _meshed(shape, levels, dim=3, maxh=far / 3, grading=0.5, parallel_meshing=False, optsteps3d=3), far


def _tube(foot: tuple[float, float, float], inner: float, outer: float, height: float) -> Any:
    """Return an upright tube, a cylinder for `inner` = 0."""
    point = occ.Pnt(*foot)
    whole = occ.Cylinder(point, occ.Z, outer, height)
    return whole - occ.Cylinder(point, occ.Z, inner, height) if inner else whole


@dataclass(frozen=True)
class PullQuestion:
    """A case for all models of pull: a coil at `current_a`, a washer `offset_m` off its axis, at `gap_m`.

    A steel of None is linear, with the part's permeability.
    """

    coil: CoilSource
    washer: SteelRing
    gap_m: float
    offset_m: float = 0.0
    current_a: float = 1.0
    core_steel: BHCurve | None = None
    washer_steel: BHCurve | None = None


def solid_pull(pull: PullQuestion, order: int = 3, levels: int = 1) -> SolidForce:
    """Return force and moment on the washer of a `PullQuestion`, by the field in three dimensions.

    Raises
    ------
    SolverError
        As `solid_force`.
    """
    washers = [PlacedWasher(pull.washer, pull.gap_m, pull.offset_m, 0.0, pull.washer_steel)]
    return solid_force(pull.coil, washers, pull.current_a, pull.core_steel, order, levels)
