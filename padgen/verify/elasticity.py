"""One taxel's vibration modes by 3-D finite elements of the STEP file that is built: the structure model `solid`.

NGSolve must not be imported into a process that has loaded build123d: call `solve_modes` and `converged_modes` in a
process of their own (they can be pickled). Meshes are in mm, matrices in N/m and kg.

A frame, a plate and a washer hardly bend. The error of a frequency is at most the energy of the parts that are solved
crudely, so edges are refined by their share of it in every mode asked for (`edge_energy_shares`).

Meshing: STEP → glued B-rep → tetrahedra, refined geometrically at singular edges. Stress is singular along re-entrant
edges and where a clamp ends; the error sits there. Netgen lays shrinking layers of prisms round the edges marked, which
restores the order of the elements.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from padgen.core.errors import SolverError, number
from padgen.physics.resonator import TaxelModes
from padgen.verify import ng, occ

__all__ = [
    "BALLAST",
    "CLAMPED",
    "CLAMPS",
    "LEAN",
    "PRINTED",
    "RESIDUAL_LIMIT",
    "SETTINGS",
    "WASHER",
    "Eigen",
    "Elastic",
    "Fineness",
    "Mirror",
    "Orthotropy",
    "SolidModes",
    "SolidTaxel",
    "Solver",
    "System",
    "accurate",
    "assembled_system",
    "clamped_shape",
    "coarse_mesh",
    "converged_modes",
    "edge_angles",
    "edge_energy_shares",
    "eigenmodes",
    "energy",
    "energy_shares",
    "factored",
    "layered",
    "meshed",
    "mirrored_part",
    "mirrors_of",
    "rigid_loads",
    "singular_edges",
    "solve_modes",
    "stiffness_pa",
    "strain",
    "taxel_shape",
]

PRINTED = "printed"
WASHER = "washer"
BALLAST = "ballast"
CLAMPED = "clamped"
CLAMPS = {"sides": ((0, 0), (0, 1), (1, 0), (1, 1)), "bottom": ((2, 0),), "root": ((0, 0),)}
"""Clamped faces: the outer vertical faces of the frame, its underside, or the face of smallest x only.

Each by its axis, and 0 for the smallest or 1 for the largest place there.
"""
REENTRANT_DEG = 190.0
"""Angle filled with material from which an edge counts as re-entrant."""
ALIKE_MM = 1e-4
"""Largest difference in mm (of areas, in mm²) of what counts as the same face, or as in a plane."""
VOLUME_SHARE = 0.01
"""Largest relative difference of a solid from the washer's volume by which it is recognised."""
LOST_VOLUME = 1e-9
"""Relative change of the whole volume by layers that is rounding only."""


class Fineness(NamedTuple):
    """Fineness of a mesh: layers of elements round singular edges, size and growth of its tetrahedra.

    `levels` of layers, each `factor` as thick as the last, in tetrahedra of at most `largest_mm` and `per_face` times
    the root of a face's area, that grow by `grading` (0 slow, 1 fast).
    """

    levels: int = 2
    factor: float = 0.25
    largest_mm: float = 1e3
    grading: float = 0.5
    per_face: float = 1.0


USUAL = Fineness()


def taxel_shape(step: Path, washer_volume_mm3: float, where: str = "", ballast_volume_mm3: float = 0.0) -> Any:
    """Read a taxel's solids from a STEP file and glue them into one shape with shared faces.

    They are named ``printed``, ``washer`` and, where its volume is given, ``ballast``; told apart by volume because
    names do not survive the import. Refusals begin with `where`, with the file where that is empty.

    Raises
    ------
    SolverError
        The file cannot be read, does not hold these solids with volume, or one of them does not touch the others.
    """
    where = where or str(step)
    try:
        solids = list(occ.OCCGeometry(str(step)).shape.solids)
    except Exception as error:
        raise SolverError(f"cannot be read as STEP ({_first_line(error)})", where) from error
    known = {WASHER: washer_volume_mm3, **({BALLAST: ballast_volume_mm3} if ballast_volume_mm3 else {})}
    left = list(range(len(solids)))
    misfits = []
    for name, volume_mm3 in known.items():
        misfit = {k: abs(solids[k].mass / volume_mm3 - 1) for k in left}
        nearest = min(misfit, key=lambda k: misfit[k], default=None)
        if nearest is not None:
            solids[nearest].name = name
            misfits.append(misfit[nearest])
            left.remove(nearest)
    if len(left) != 1 or max(misfits) > VOLUME_SHARE:
        masses = " and ".join(f"{number(solid.mass)} mm³" for solid in solids)
        parts = "".join(f" and {name} of {number(volume_mm3)} mm³" for name, volume_mm3 in known.items())
        count = "two" if len(known) == 1 else "three"
        raise SolverError(f"must hold {count} solids, printed part{parts}, holds {masses}", where)
    solids[left[0]].name = PRINTED
    shape = occ.Glue(solids)
    if len(shape.solids) != len(solids):
        raise SolverError("its solids overlap: washer and printed part must touch by faces only", where)
    if len({_place(face) for solid in shape.solids for face in solid.faces}) == sum(len(s.faces) for s in shape.solids):
        raise SolverError("the washer does not touch the printed part: it must sit against the recess' roof", where)
    return shape


def _place(face: Any) -> tuple[float, ...]:
    low, high = face.bounding_box
    return tuple(round(v, 6) for v in (*_xyz(low), *_xyz(high), face.mass))


def _xyz(point: Any) -> tuple[float, float, float]:
    return point.x, point.y, point.z


def clamped_shape(shape: Any, clamp: str) -> Any:
    """Name ``clamped`` the faces of the shape that `clamp`, one of `CLAMPS`, holds; return the shape.

    Raises
    ------
    SolverError
        No face lies there.
    """
    bounds = _printed_bounds(shape)
    _hold(shape, clamp, bounds)
    return shape


def _printed_bounds(shape: Any) -> np.ndarray:
    """Return the lowest and highest corner (2, 3) in mm of the printed part."""
    printed = next(solid for solid in shape.solids if solid.name == PRINTED)
    return np.array([_xyz(corner) for corner in printed.bounding_box])


def _hold(shape: Any, clamp: str, bounds: np.ndarray) -> None:
    """Give the name "clamped" to the faces of a print that `clamp` holds; `bounds` (2, 3) in mm: the uncut part's box.

    Raises
    ------
    SolverError
        No face of the printed part lies there.
    """
    near = 1e-5 * float(np.ptp(bounds, axis=0).max())
    printed = [face for solid in shape.solids if solid.name == PRINTED for face in solid.faces]
    for face in printed:
        ends = np.array([_xyz(corner) for corner in face.bounding_box])
        if any((abs(ends[:, axis] - bounds[end, axis]) < near).all() for axis, end in CLAMPS[clamp]):
            face.name = CLAMPED
    if all(face.name != CLAMPED for face in printed):
        raise SolverError(f"has no face to clamp by its {clamp}", "taxel")


class Mirror(NamedTuple):
    """A plane of symmetry across `axis` (0: x, 1: y) at `place_mm`; `name` is that of the faces cut there."""

    axis: int
    place_mm: float

    @property
    def name(self) -> str:
        return f"mirror{self.axis}"

    @property
    def loads(self) -> tuple[int, ...]:
        """Indices of the loads symmetric in this plane: 0 to 2 are forces along x, y, z, 3 to 5 moments about them."""
        return (1, 2, 3) if self.axis == 0 else (0, 2, 4)


def mirrors_of(shape: Any, washer_x_mm: float) -> tuple[Mirror, ...]:
    """Return which of the upright planes x = `washer_x_mm` and y = 0 are planes of symmetry of `shape`."""
    faces = np.array([(face.mass, *_xyz(face.center)) for face in shape.faces])
    mirrors = []
    for mirror in (Mirror(0, washer_x_mm), Mirror(1, 0.0)):
        image = faces.copy()
        image[:, 1 + mirror.axis] = 2 * mirror.place_mm - image[:, 1 + mirror.axis]
        apart = np.abs(faces[:, None] - image).max(-1)
        if (apart.min(0) < ALIKE_MM).all() and (apart.min(1) < ALIKE_MM).all():
            mirrors.append(mirror)
    return tuple(mirrors)


def mirrored_part(shape: Any, mirrors: tuple[Mirror, ...], clamp: str) -> Any:
    """Return the part of `shape` on the lower side of all `mirrors`, its cuts and clamped faces named."""
    bounds = _printed_bounds(shape)
    low, high = (np.array(_xyz(corner)) for corner in shape.bounding_box)
    low -= 1
    high += 1
    for mirror in mirrors:
        high[mirror.axis] = mirror.place_mm
    room = occ.Box(occ.Pnt(*low), occ.Pnt(*high))
    pieces = []
    for whole in shape.solids:
        for piece in (whole * room).solids:
            piece.name = whole.name
            pieces.append(piece)
    part = occ.Glue(pieces)
    for face in part.faces:
        ends = np.array([_xyz(corner) for corner in face.bounding_box])
        for mirror in mirrors:
            if (abs(ends[:, mirror.axis] - mirror.place_mm) < ALIKE_MM).all():
                face.name = mirror.name
    _hold(part, clamp, bounds)
    return part


def meshed(shape: Any, fineness: Fineness = USUAL, where: str = "taxel", layered: set[str] | None = None) -> Any:
    """Return the NGSolve mesh of `shape` (see `clamped_shape`), refined in layers towards singular edges.

    `assembled_system` curves it.

    It has layers along the edges named in `layered`, all singular ones by default. Where Netgen fails, or its layers
    leave an element without volume, slightly other meshes are tried.

    Raises
    ------
    SolverError
        Netgen cannot mesh it, e.g. a beam thinner than it resolves.
    """
    if layered is None:
        layered = singular_edges(shape, coarse_mesh(shape, fineness, where))
    for edge in shape.edges:
        edge.hpref = float(edge.name in layered)
    for coarse, attempt in _coarse_meshes(shape, fineness, where):
        mesh = ng.Mesh(coarse)
        if not fineness.levels:
            return mesh
        volume = _volumes(mesh).sum()
        mesh.RefineHP(attempt.levels, attempt.factor)
        straight = _volumes(mesh)
        mesh.Curve(2)
        if bool(abs(straight.sum() / volume - 1) < LOST_VOLUME and min(straight.min(), _volumes(mesh).min()) > 0):
            return mesh
    raise SolverError("layers round its edges tear the mesh: a part is thinner than the mesh resolves", where)


def _coarse_meshes(shape: Any, fineness: Fineness, where: str) -> Iterator[tuple[Any, Fineness]]:
    """Yield Netgen's meshes of `shape` for repeated attempts with their fineness: as asked, then slightly varied."""
    failure: SolverError | None = None
    for face in shape.faces:
        # Long thin faces bend: no element longer than a share of a square of the same area.
        face.maxh = min(fineness.largest_mm, fineness.per_face * face.mass**0.5)
    for factor, grading in ((1.0, 1.0), (0.8, 1.0), (1.0, 0.8), (0.7, 0.8), (0.8, 0.6)):
        attempt = fineness._replace(factor=factor * fineness.factor, grading=grading * fineness.grading)
        try:
            # Netgen's own threads made meshing 10 times slower on a busy machine.
            mesh = occ.OCCGeometry(shape).GenerateMesh(
                maxh=attempt.largest_mm,
                grading=attempt.grading,
                curvaturesafety=1.0,  # elements to a radius
                segmentsperedge=0.3,
                parallel_meshing=False,
            )
            why = "" if mesh.ne else "Netgen's mesh of it is empty"
        except Exception as error:
            why = f"Netgen cannot mesh it ({_first_line(error)})"
        if not why:
            yield mesh, attempt
        elif not failure:
            failure = SolverError(f"{why}: a part is thinner than it resolves", where)
    if failure:
        raise failure


def _volumes(mesh: Any) -> np.ndarray:
    """Return volumes in mm³ of the elements."""
    return np.asarray(ng.Integrate(1.0, mesh, element_wise=True).NumPy())


def coarse_mesh(shape: Any, fineness: Fineness = USUAL, where: str = "taxel") -> Any:
    """Mesh `shape` by Netgen without layers; name the edges of the shape ``edge0``, ``edge1``, …"""
    for place, edge in enumerate(shape.edges):
        edge.name = f"edge{place}"
        edge.hpref = 0.0
    return next(_coarse_meshes(shape, fineness, where))[0]


def singular_edges(shape: Any, mesh: Any) -> set[str]:
    """Return names of the edges where stress is singular: re-entrant ones and those of clamped faces."""
    clamped = {edge.name for face in shape.faces if face.name == CLAMPED for edge in face.edges}
    return clamped | {name for name, angle in edge_angles(mesh).items() if angle > REENTRANT_DEG}


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def edge_angles(mesh: Any) -> dict[str, float]:
    """Return the angle in degrees that the material fills at each named edge, over 180 where it is re-entrant.

    Measured on the triangles of the outer surface of a Netgen surface mesh; inner edges of a glued
    shape, where no outer surface meets, are left out.
    """
    import trimesh

    points = mesh.Coordinates()
    triangles = mesh.Elements2D().NumPy()
    corner = triangles["nodes"][:, :3] - 1
    face = triangles["index"]
    sides = [(mesh.FaceDescriptor(k + 1).domin, mesh.FaceDescriptor(k + 1).domout) for k in range(face.max())]
    domain = np.array(sides)[face - 1]
    outer = (domain == 0).any(1)
    corner = np.where((domain[:, :1] == 0), corner[:, ::-1], corner)[outer]
    surface = trimesh.Trimesh(points, corner, process=False)
    turn = np.degrees(surface.face_adjacency_angles)
    filled = np.where(surface.face_adjacency_convex, 180 - turn, 180 + turn).tolist()
    between = dict(zip(map(frozenset, surface.face_adjacency_edges.tolist()), filled, strict=True))
    angles: dict[str, float] = {}
    for segment in mesh.Elements1D().NumPy():
        ends = frozenset((segment["nodes"][:2] - 1).tolist())
        if ends in between:
            name = mesh.GetCD2Name(int(segment["index"]) - 1)
            angles[name] = max(angles.get(name, 0.0), between[ends])
    return angles


class Orthotropy(NamedTuple):
    """Elastic constants of an orthotropic material, such as a layered print, along x, y and z.

    Moduli (Ex, Ey, Ez) and shear moduli (Gyz, Gzx, Gxy) in Pa, and Poisson ratios (ν_yz, ν_zx, ν_xy), ν_ij = −ε_j/ε_i
    under σ_i.
    """

    modulus_pa: tuple[float, float, float]
    shear_pa: tuple[float, float, float]
    poisson: tuple[float, float, float]


class Elastic(NamedTuple):
    """A linear elastic material; `axes`, where given, replace `modulus_pa` and `poisson`."""

    modulus_pa: float
    poisson: float
    density_kg_per_m3: float
    axes: Orthotropy | None = None


def layered(material: Elastic, ratio: float) -> Elastic:
    """Return `material` layered along z: modulus along z and shear moduli across layers multiplied by `ratio`."""
    if ratio == 1:
        return material
    e = material.modulus_pa
    nu = material.poisson
    shear = e / 2 / (1 + nu)
    # Pulled along a layer it narrows as before; ν_zx E_x = ν_xz E_z.
    axes = Orthotropy((e, e, ratio * e), (ratio * shear, ratio * shear, shear), (nu, ratio * nu, nu))
    return material._replace(axes=axes)


def stiffness_pa(material: Elastic) -> np.ndarray:
    """Return the stiffness (6, 6) in Pa for engineering strains in the order xx, yy, zz, yz, zx, xy (Voigt)."""
    e = material.modulus_pa
    nu = material.poisson
    axes = material.axes or Orthotropy((e,) * 3, (e / 2 / (1 + nu),) * 3, (nu,) * 3)
    ex, ey, ez = axes.modulus_pa
    yz, zx, xy = axes.poisson
    compliance = np.diag([1 / ex, 1 / ey, 1 / ez, *(1 / g for g in axes.shear_pa)])
    for i, j, coupling in ((0, 1, xy / ex), (1, 2, yz / ey), (0, 2, zx / ez)):
        compliance[i, j] = compliance[j, i] = -coupling
    stiffness = np.linalg.inv(compliance)
    return np.asarray((stiffness + stiffness.T) / 2)


RESIDUAL_LIMIT = 1e-4
"""The eigenvalue is off by its square."""
SETTLED = 1e-3
"""Relative change of an eigenvalue from block to block, above which one that is lower may still turn up."""
ENERGY_LOST = 1e-8
"""Share of the energy that rounding may cost a static answer."""
LEAN = 2
"""Order of the elements that hold little energy."""
SPARE = 2
BLOCKS = 12
MM = 1e-3


SPRING_PER_MM = 1e4
"""Springs across a plane of symmetry, over the softer solid's modulus: a ten-thousandth of a mm of it is as soft."""


class System(NamedTuple):
    """Matrices of an elastic solid, acting on vectors (n,) of its unknowns.

    `space`: NGSolve's space, of three components at a node (`blocks`) or one component after the
    other; `stiffness`: its matrix in N/m; `mass`: scipy CSR (n/3, n/3) in kg, the same for each
    component; `free` (n,): not held.
    """

    space: Any
    stiffness: Any
    mass: Any
    free: np.ndarray
    blocks: bool = True

    def stiffness_times(self, vectors: np.ndarray) -> np.ndarray:
        """Return K v of (n,) or (n, k), in N."""
        into = self.stiffness.CreateColVector()
        out = self.stiffness.CreateColVector()
        columns = [_applied(self.stiffness, into, out, column) for column in np.atleast_2d(vectors.T)]
        return np.array(columns).T if vectors.ndim == 2 else columns[0]

    def mass_times(self, vectors: np.ndarray) -> np.ndarray:
        """Return M v of (n,) or (n, k)."""
        nodes = self.mass.shape[0]
        if self.blocks:
            return np.asarray(self.mass @ vectors.reshape(nodes, -1)).reshape(vectors.shape)
        return np.concatenate([self.mass @ part for part in vectors.reshape(3, nodes, *vectors.shape[1:])])

    def diagonal(self) -> np.ndarray:
        """Return the diagonal (n,) of the stiffness."""
        values, columns, starts = (np.asarray(part) for part in self.stiffness.CSR())
        each, make = ((-1, 3, 3), sparse.bsr_matrix) if self.blocks else (-1, sparse.csr_matrix)
        return np.asarray(make((values.reshape(each), columns, starts)).diagonal())


class Eigen(NamedTuple):
    """Eigenmodes: `frequency_hz` (k,) rising, `shape` (n, k) mass-normalised, and their largest `residual`."""

    frequency_hz: np.ndarray
    shape: np.ndarray
    residual: float


def assembled_system(
    mesh: Any,
    materials: Mapping[str, Elastic],
    order: int,
    clamped: str = CLAMPED,
    blocks: bool = True,
    flat: str | None = None,
    rich: np.ndarray | None = None,
    volume_mm3: Mapping[str, float] | None = None,
    mirrors: tuple[Mirror, ...] = (),
) -> System:
    """Assemble stiffness and mass of `mesh` (mm) with elements of `order`.

    `materials` are by name of solid, `clamped` is the name of the faces held, `flat` of those that only slide in x and
    y (a plane of symmetry). `blocks` is 1.6 times faster, but loses a foil's stiffness by rounding (`accurate`) and
    knows no `flat`. Only elements of `rich` (elements,) have that order if it is given, the others `LEAN`; needs
    `blocks`. On the cuts of `mirrors` springs hold the motion across them. What a solid of known `volume_mm3` lacks
    where the mesh cuts its curves is made up for by density.

    The mesh is curved to the lowest order: elements curved more than their order cannot turn without
    strain (f₁ came out four times too high).
    """
    mesh.Curve(order if rich is None else LEAN)
    scalar = ng.H1(mesh, order=order)
    if blocks and flat is None:
        space = ng.H1(mesh, order=order, dim=3, dirichlet=clamped)
        if rich is not None:
            _thin((scalar, space), mesh, order, rich)
    else:
        blocks = False
        slides = {"dirichletz": f"{clamped}|{flat}"} if flat else {}
        space = ng.VectorH1(mesh, order=order, dirichlet=clamped, **slides)
    u, v = space.TnT()
    a, b = scalar.TnT()
    stiffness = ng.BilinearForm(space, symmetric=True)
    mass = ng.BilinearForm(scalar, symmetric=True)
    for name, material in materials.items():
        where = ng.dx(definedon=mesh.Materials(name))
        stiffness += energy(material, u, v) * where
        whole = volume_mm3[name] / ng.Integrate(1.0, mesh.Materials(name)) if volume_mm3 else 1.0
        mass += MM**3 * whole * material.density_kg_per_m3 * a * b * where
    softest_pa = min(stiffness_pa(material).max() for material in materials.values())
    for mirror in mirrors:
        stiffness += SPRING_PER_MM * MM * softest_pa * u[mirror.axis] * v[mirror.axis] * ng.ds(mirror.name)
    stiffness.Assemble()
    mass.Assemble()
    free = np.array(list(space.FreeDofs()), bool)
    weights = sparse.csr_matrix(tuple(np.array(part) for part in mass.mat.CSR()))
    return System(space, stiffness.mat, weights, np.repeat(free, 3) if blocks else free, blocks)


def _thin(spaces: tuple[Any, ...], mesh: Any, order: int, rich: np.ndarray) -> None:
    """Lower the order of `spaces` to `LEAN` at edges, faces and cells that belong to no element of `rich`."""
    counts = {ng.EDGE: mesh.nedge, ng.FACE: mesh.nface, ng.CELL: mesh.ne}
    # The edges and faces that layers have split are numbered still; at order 1 they have no unknowns.
    orders = {kind: np.ones(count, int) for kind, count in counts.items()}
    for place in [*np.flatnonzero(~rich), *np.flatnonzero(rich)]:
        element = mesh[ng.ElementId(ng.VOL, int(place))]
        element_order = order if rich[place] else LEAN
        orders[ng.EDGE][[edge.nr for edge in element.edges]] = element_order
        orders[ng.FACE][[face.nr for face in element.faces]] = element_order
        orders[ng.CELL][place] = element_order
    for kind, wanted in orders.items():
        for place in np.flatnonzero(wanted != order):
            node = ng.NodeId(kind, int(place))
            element_order = int(wanted[place])
            for space in spaces:
                space.SetOrder(node, element_order)
    for space in spaces:
        space.UpdateDofTables()
        space.FinalizeUpdate()


def energy(material: Elastic, u: Any, v: Any) -> Any:
    """Return the integrand of the stiffness form, for displacements `u` and `v` in m and coordinates in mm."""
    stiffness = stiffness_pa(material)
    # du/dx has 1/mm, the volume mm³: Pa · 1e6/m² · 1e-9 m³.
    if material.axes is None:
        shear = MM * stiffness[5, 5]
        lame = MM * stiffness[0, 1]
        du = ng.Grad(u)
        dv = ng.Grad(v)
        return 2 * shear * ng.InnerProduct(ng.Sym(du), ng.Sym(dv)) + lame * ng.Trace(du) * ng.Trace(dv)
    voigt = ng.CoefficientFunction(tuple((MM * stiffness).ravel().tolist()), dims=(6, 6))
    return ng.InnerProduct(voigt * strain(u), strain(v))


def strain(u: Any) -> Any:
    """Return the engineering strain in Voigt's order."""
    g = ng.Grad(u)
    return ng.CoefficientFunction((g[0, 0], g[1, 1], g[2, 2], g[1, 2] + g[2, 1], g[0, 2] + g[2, 0], g[0, 1] + g[1, 0]))


Solver = Callable[[np.ndarray], np.ndarray]
"""``K⁻¹`` on all unknowns, zero where held: takes a load (n,) in N, returns (n,) in m."""


def factored(system: System) -> Solver:
    """Return a function that solves K u = load, with the stiffness matrix K of `system` factored by Cholesky.

    Raises
    ------
    SolverError
        It is not positive definite: the solid is not held.
    """
    try:
        inverse = system.stiffness.Inverse(system.space.FreeDofs(), inverse="sparsecholesky")
    except Exception as error:
        raise SolverError("the stiffness matrix cannot be factored: the solid is not held", "elasticity") from error
    into = system.stiffness.CreateColVector()
    out = system.stiffness.CreateColVector()
    return partial(_applied, inverse, into, out)


def accurate(system: System, solve: Solver, loads: np.ndarray, answers: np.ndarray) -> bool:
    """Return whether `answers` (n, k) solve `system` for `loads` (n, k), tested for the load that does most work.

    The inverses of 3 × 3 pivots in NGSolve's Cholesky lose soft directions when the stiffnesses of a
    solid lie more than about 1e8 apart, without a word.
    """
    work = np.einsum("ik,ik->k", loads, answers)
    softest = int(work.argmax())
    left = (loads[:, softest] - system.stiffness_times(answers[:, softest])) * system.free
    return bool(abs(left @ solve(left)) <= ENERGY_LOST * work[softest])


def _applied(matrix: Any, into: Any, out: Any, vector: np.ndarray) -> np.ndarray:
    into.FV().NumPy()[:] = np.asarray(vector).ravel()
    out.data = matrix * into
    return np.array(out.FV().NumPy())


def eigenmodes(system: System, solve: Solver, modes: int, start: np.ndarray | None = None) -> Eigen:
    """Return the lowest `modes` of ``K x = (2πf)² M x`` by block Lanczos on K⁻¹ M from `start` (n, b).

    Static answers to loads on the washer are a good start: two blocks more do. Each block is
    orthogonal to all before; Rayleigh–Ritz on all of them, until no λ moves by `SETTLED` and all residuals are below
    `RESIDUAL_LIMIT`.

    Raises
    ------
    SolverError
        More modes than unknowns are asked for, or no convergence.
    """
    unknowns = int(system.free.sum())
    if modes >= unknowns:
        raise SolverError(f"has {unknowns} unknowns, too few for {modes} modes", "elasticity")
    block = start
    if block is None:  # answers to inertia of irregular motions, always the same: no mode is orthogonal to them
        wave = np.cos(np.outer(np.arange(system.free.size), np.sqrt(np.arange(2, 2 + modes + SPARE))))
        block = np.array([solve(load) for load in system.mass_times(wave).T]).T
    basis = stiff = np.zeros((system.free.size, 0))
    values = np.full(modes, np.inf)
    residual = np.inf
    for _ in range(BLOCKS):
        for _ in range(2):  # M-orthonormal to the basis and in itself; twice, as rounding asks for
            block = block - basis @ (basis.T @ system.mass_times(block))
            size, turn = np.linalg.eigh(block.T @ system.mass_times(block))
            kept = size > size[-1] * np.finfo(float).eps * len(size)
            block = block @ (turn[:, kept] / np.sqrt(size[kept]))
        basis = np.hstack((basis, block))
        stiff = np.hstack((stiff, system.stiffness_times(block)))
        square, part = np.linalg.eigh(basis[system.free].T @ stiff[system.free])
        if len(square) >= modes:
            moved = np.abs(values / square[:modes] - 1).max()
            values = square[:modes]
            if moved < SETTLED:
                shape = basis @ part[:, :modes]
                # |D^-½ (K x − λ M x)| / |x|_K, D the diagonal of K
                left = (stiff @ part[:, :modes] - system.mass_times(shape) * values)[system.free]
                bent = (left**2 / system.diagonal()[system.free, None]).sum(0)
                residual = float(np.sqrt(bent / values).max()) if values[0] > 0 else np.inf
                if residual < RESIDUAL_LIMIT:
                    return Eigen(np.sqrt(values) / (2 * np.pi), shape, residual)
        block = np.array([solve(load) for load in system.mass_times(block).T]).T
    raise SolverError(
        f"the eigenvalue solver leaves a residual of {residual:.1e} after {BLOCKS} blocks, must be below"
        f" {RESIDUAL_LIMIT}",
        "elasticity",
    )


def rigid_loads(
    system: System,
    solid: str,
    density_kg_per_m3: float,
    x_mm: float,
    y_mm: float = 0.0,
    z_mm: float = 0.0,
    only: tuple[int, ...] = (0, 1, 2, 3, 4, 5),
) -> np.ndarray:
    """Return loads (n, 6) on the named solid, spread over its volume, for unit forces and moments about a point.

    Or `only` some of them.

    They are in N and N·m. Their transpose takes a displacement to the solid's mean motion as a body, in m and rad: the
    mass-weighted least-squares fit.
    """
    mesh = system.space.mesh
    where = ng.dx(definedon=system.space.mesh.Materials(solid))
    x = MM * (ng.x - x_mm)
    y = MM * (ng.y - y_mm)
    z = MM * (ng.z - z_mm)
    motions = (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -z, y), (z, 0, -x), (-y, x, 0)
    fields = [ng.CoefficientFunction(motions[place]) for place in only]
    weight = MM**3 * density_kg_per_m3
    v = system.space.TestFunction()
    forms = [ng.LinearForm(weight * ng.InnerProduct(field, v) * where).Assemble() for field in fields]
    products = ng.CoefficientFunction(tuple(weight * ng.InnerProduct(a, b) for a in fields for b in fields))
    gram = np.array(ng.Integrate(products, mesh, definedon=mesh.Materials(solid))).reshape(len(only), len(only))
    return np.asarray(np.linalg.solve(gram, np.array([form.vec.FV().NumPy() for form in forms])).T)


def energy_shares(system: System, materials: Mapping[str, Elastic], eigen: Eigen) -> np.ndarray:
    """Return the shares (elements, k) of each element in the strain energy of k modes; a mode's sum to 1."""
    mesh = system.space.mesh
    field = ng.GridFunction(system.space)
    density = mesh.MaterialCF({name: energy(material, field, field) for name, material in materials.items()})
    shares = []
    for shape in eigen.shape.T:
        field.vec.FV().NumPy()[:] = shape
        held = np.array(ng.Integrate(density, mesh, element_wise=True).NumPy())
        shares.append(held / held.sum())
    return np.array(shares).T


def edge_energy_shares(netgen_mesh: Any, shares: np.ndarray) -> dict[str, float]:
    """Return for each named edge the largest share of a mode's strain energy that lies in tetrahedra along it."""
    nodes = netgen_mesh.Elements3D().NumPy()["nodes"][:, :4].astype(np.int64)
    segments = netgen_mesh.Elements1D().NumPy()
    ends = np.sort(segments["nodes"][:, :2].astype(np.int64), axis=1)
    stride = int(nodes.max()) + 1
    one, other = np.triu_indices(4, 1)
    pairs = np.minimum(nodes[:, one], nodes[:, other]) * stride + np.maximum(nodes[:, one], nodes[:, other])
    share_of: dict[str, float] = {}
    for index in np.unique(segments["index"]):
        segment_ends = ends[segments["index"] == index]
        along = np.isin(pairs, segment_ends[:, 0] * stride + segment_ends[:, 1]).any(1)
        name = netgen_mesh.GetCD2Name(int(index) - 1)
        share_of[name] = max(share_of.get(name, 0.0), float(shares[along].sum(0).max()))
    return share_of


class FineSetting(NamedTuple):
    """Order of the elements, number of layers round edges, and largest element size (`Fineness.per_face`)."""

    order: int
    levels: int
    per_face: float = 1.0


SETTINGS = (FineSetting(3, 2), FineSetting(3, 2, 0.5), FineSetting(4, 2, 0.5), FineSetting(4, 3, 0.35))
"""Cheapest first."""
MIRRORED = (SETTINGS[0], FineSetting(4, 2), *SETTINGS[2:])
"""The same for a part of a solid that is symmetric, which order 4 costs a tenth; the first is of the whole of it."""
ADDED = {3: 0.15, 4: 0.7}
"""Share of the last order's change that all higher orders and finer meshes together still make: 0.03 … 0.24 at order 3,
0.6 … 1.4 at order 4, whose change is small, on the taxels of docs/accuracy.md."""
DOUBT = {3: 1 / 6, 4: 0.7}
"""Share of that change by which the extrapolated frequency may be off."""
SAME_MODE = 0.1
"""Relative difference of frequencies above which the symmetric mode found is taken for another one."""
REST = 3e-4
"""Relative error of a frequency that no order shows: curves of order `LEAN`, elements that stay at it."""
EDGE_RATIO = 0.02
"""Layers are worth while along edges whose tetrahedra hold this much of the energy at the worst edge."""
POOR = 0.01
POOR_OTHERS = 0.2
"""Share of the working mode's energy, and of every other's, in the elements that may stay at order `LEAN`."""


class SolidTaxel(NamedTuple):
    """A taxel to solve by finite elements: a STEP file in mm of printed part, washer and, if any, ballast.

    The solids are bonded where they touch. `glue_kg` is carried by the washer. `clamp` is one of `CLAMPS`. Refusals
    call the taxel by its `name`, by its file where it has none.
    """

    step: Path
    printed: Elastic
    washer: Elastic
    washer_volume_mm3: float
    washer_x_mm: float
    glue_kg: float = 0.0
    clamp: str = "sides"
    name: str = ""
    ballast: Elastic | None = None
    ballast_volume_mm3: float = 0.0

    @property
    def where(self) -> str:
        """Name with which error messages about the taxel begin: its own, or its STEP file's if it has none."""
        return self.name or str(self.step)

    @property
    def materials(self) -> dict[str, Elastic]:
        """Materials by name of solid; the washer's density includes the glue's mass."""
        density = self.washer.density_kg_per_m3 + self.glue_kg / (self.washer_volume_mm3 * 1e-9)
        ballast = {BALLAST: self.ballast} if self.ballast else {}
        return {PRINTED: self.printed, WASHER: self.washer._replace(density_kg_per_m3=density), **ballast}


class SolidModes(NamedTuple):
    """The modes of a taxel by elements of `order` with `unknowns`, and the estimated errors of their frequencies.

    `residual` is that of the worst mode; `error` (k,) the estimated relative error of each frequency, nan where there
    is no second order to compare with; `setting` the place in `SETTINGS` of the one that was solved last.
    """

    modes: TaxelModes
    order: int
    unknowns: int
    residual: float
    error: np.ndarray
    setting: int = 0

    @property
    def working_error(self) -> float:
        """Estimated relative error of the working mode's frequency."""
        return float(self.error[self.modes.working])


def solve_modes(taxel: SolidTaxel, order: int = 3, levels: int = 2, modes: int = 6) -> SolidModes:
    """Return the lowest modes of `taxel` by elements of `order` with `levels` of layers round singular edges.

    All frequencies come out too high. `rest` of the result makes the static compliance exact.

    Raises
    ------
    SolverError
        The STEP file does not hold a taxel, cannot be meshed, or the solver does not converge.
    """
    setting = FineSetting(order, levels)
    draft = _drafted(taxel)
    return _result(_answered(taxel, draft, _layered(taxel, draft, setting), order, modes), setting)


def converged_modes(taxel: SolidTaxel, tolerance: float = 1e-3, modes: int = 6, first: int = 0) -> SolidModes:
    """Return a taxel's modes at the cheapest mesh setting with a working mode's estimated error below `tolerance`.

    Where no setting does, the modes of the one that comes nearest: compare their `error`. Settings before the one of
    place `first` in `SETTINGS` are not tried.

    Where the first setting does not suffice and the solid has planes of symmetry, all modes are as it has them but the
    working one, which finer elements of a half or a quarter find.

    On one mesh, order 2 tells which elements hold the energy, and these alone are solved by higher orders; the
    frequencies are extrapolated by a share of the last order's change, which the error grows with. Of other
    modes `error` is the whole change; for the torsion of thin beams, slow to converge, it may be too small.

    Raises
    ------
    SolverError
        As `solve_modes`.
    """
    draft = _drafted(taxel)
    mirrors = mirrors_of(draft.shape, taxel.washer_x_mm)
    if not mirrors:
        return _by_settings(taxel, draft, SETTINGS, first, modes, tolerance)
    known = _by_settings(taxel, draft, SETTINGS[:1], 0, modes, tolerance)
    if not first and known.working_error < tolerance:
        return known
    try:
        part = _drafted(taxel, mirrors)
        finer = _by_settings(taxel, part, MIRRORED, max(first, 1), len(part.loads), tolerance)
    except SolverError:  # the part cannot be meshed
        return _by_settings(taxel, draft, SETTINGS, max(first, 1), modes, tolerance)
    return _with_working(known, finer)


def _by_settings(
    taxel: SolidTaxel, draft: "MeshDomain", settings: tuple[FineSetting, ...], first: int, modes: int, tolerance: float
) -> SolidModes:
    """Return modes by the first of `settings`, from index `first`, with error below `tolerance`, else by the best."""
    known = None
    before = None
    for place, setting in enumerate(settings[first:], first):
        try:
            if before != setting[1:]:
                mesh = _layered(taxel, draft, setting)
                before = setting[1:]
                lean = _answered(taxel, draft, mesh, LEAN, modes)
                solved = _result(lean, setting._replace(order=LEAN))
                rich = _rich(mesh, energy_shares(lean.system, taxel.materials, lean.eigen), solved.modes.working)
            for order in range(solved.order + 1, setting.order + 1):
                coarser = solved
                solved = _result(_answered(taxel, draft, mesh, order, modes, rich), setting._replace(order=order))
        except SolverError:
            if known is None:
                raise
            break  # the finer mesh tears: what is known stays
        extrapolated = _extrapolated(coarser, solved)._replace(setting=place)
        if known is None or extrapolated.working_error < known.working_error:
            known = extrapolated
        if known.working_error < tolerance:
            break
    assert known is not None
    return known


def _with_working(known: SolidModes, finer: SolidModes) -> SolidModes:
    """Return `known` with the working mode's frequency from `finer`, if it is the same mode with a smaller error."""
    working = known.modes.working
    hz = float(finer.modes.frequency_hz[finer.modes.working])
    frequency = known.modes.frequency_hz.copy()
    if finer.working_error >= known.working_error or abs(hz / frequency[working] - 1) > SAME_MODE:
        return known
    frequency[working] = hz
    error = known.error.copy()
    error[working] = finer.working_error
    modes = known.modes._replace(frequency_hz=frequency)
    return known._replace(modes=modes, error=error, order=finer.order, setting=finer.setting)


def _rich(mesh: Any, shares: np.ndarray, working: int) -> np.ndarray:
    """Return a mask (n,) of the elements with most strain energy and their neighbours, to be solved at higher order.

    They are those that hold all but little of each mode's energy `shares` (n, k), and all that touch them, where a
    stiff element has no energy because it cannot follow.
    """
    poor = np.full(shares.shape[1], POOR_OTHERS)
    poor[working] = POOR
    order = shares.argsort(0)
    rich = np.empty(shares.shape, bool)
    np.put_along_axis(rich, order, np.take_along_axis(shares, order, 0).cumsum(0) > poor, 0)
    corners = [[corner.nr for corner in element.vertices] for element in mesh.Elements()]
    touched = np.zeros(mesh.nv, bool)
    for place in np.flatnonzero(rich.any(1)):
        touched[corners[place]] = True
    return np.array([touched[element_corners].any() for element_corners in corners])


def _extrapolated(coarser: SolidModes, finer: SolidModes) -> SolidModes:
    """Return `finer` with frequencies extrapolated from their change since `coarser`, and estimated errors."""
    working = finer.modes.working
    other = coarser.modes.working
    change = coarser.modes.frequency_hz / finer.modes.frequency_hz - 1
    change[working] = coarser.modes.frequency_hz[other] / finer.modes.frequency_hz[working] - 1
    error = np.abs(change)
    error[working] = DOUBT[finer.order] * error[working] + REST
    modes = finer.modes._replace(frequency_hz=finer.modes.frequency_hz * (1 - ADDED[finer.order] * change))
    return finer._replace(modes=modes, error=error)


class MeshDomain(NamedTuple):
    """The solid that is meshed: a taxel's, or the part of it on one side of planes of symmetry.

    `layered`: names of the edges that its modes, solved on a coarse mesh, strain; `loads`: those of the six on the
    washer that are symmetric.
    """

    shape: Any
    layered: set[str]
    mirrors: tuple[Mirror, ...] = ()

    @property
    def loads(self) -> tuple[int, ...]:
        """Indices, among three forces and three moments on the washer, of those symmetric in every mirror plane."""
        return tuple(k for k in range(6) if all(k in mirror.loads for mirror in self.mirrors))


class SolvedDraft(NamedTuple):
    """A solved `MeshDomain`: system, loads (n, k) on the washer, static displacements (n, k) under them, and modes.

    `copies`: how often the meshed part goes into the solid.
    """

    system: System
    loads: np.ndarray
    answers: np.ndarray
    eigen: Eigen
    places: tuple[int, ...]
    copies: int


def _drafted(taxel: SolidTaxel, mirrors: tuple[Mirror, ...] = ()) -> MeshDomain:
    """Return a taxel's solid to be meshed, or its part on one side of `mirrors`, with the edges to be refined."""
    ng.SetNumThreads(1)
    shape = clamped_shape(
        taxel_shape(taxel.step, taxel.washer_volume_mm3, taxel.where, taxel.ballast_volume_mm3), taxel.clamp
    )
    if mirrors:
        shape = mirrored_part(shape, mirrors, taxel.clamp)
    mesh = coarse_mesh(shape, where=taxel.where)
    singular = singular_edges(shape, mesh)
    draft = MeshDomain(shape, set(), mirrors)
    lean = _answered(taxel, draft, ng.Mesh(mesh), LEAN, len(draft.loads))
    shares = edge_energy_shares(mesh, energy_shares(lean.system, taxel.materials, lean.eigen))
    worst = max((shares.get(edge, 0.0) for edge in singular), default=0.0)
    return draft._replace(layered={edge for edge in singular if shares.get(edge, 0.0) > EDGE_RATIO * worst})


def _layered(taxel: SolidTaxel, draft: MeshDomain, setting: FineSetting) -> Any:
    fineness = Fineness(levels=setting.levels, per_face=setting.per_face)
    return meshed(draft.shape, fineness, taxel.where, draft.layered)


def _answered(
    taxel: SolidTaxel, draft: MeshDomain, mesh: Any, order: int, modes: int, rich: np.ndarray | None = None
) -> SolvedDraft:
    """Return static displacements and modes of a taxel's mesh, by 3 x 3 blocks unless rounding spoils these."""
    volumes: dict[str, float] = {}
    for solid in draft.shape.solids:
        volumes[solid.name] = volumes.get(solid.name, 0.0) + solid.mass
    density = taxel.materials[WASHER].density_kg_per_m3
    for blocks in (True, False):
        of_order = rich if blocks else None
        system = assembled_system(
            mesh, taxel.materials, order, blocks=blocks, rich=of_order, volume_mm3=volumes, mirrors=draft.mirrors
        )
        loads = rigid_loads(system, WASHER, density, taxel.washer_x_mm, only=draft.loads)
        solve = factored(system)
        answers = np.array([solve(load) for load in loads.T]).T
        if accurate(system, solve, loads, answers):
            eigen = eigenmodes(system, solve, modes, answers)
            return SolvedDraft(system, loads, answers, eigen, draft.loads, 2 ** len(draft.mirrors))
    raise SolverError("stiff and soft parts lie too far apart for double precision", taxel.where)


def _result(answer: SolvedDraft, setting: FineSetting) -> SolidModes:
    frequency_hz = answer.eigen.frequency_hz
    motion = np.zeros((len(frequency_hz), 6))
    # Of a part, modes have the part's mass as theirs, and bear the part's share of the load.
    motion[:, answer.places] = answer.eigen.shape.T @ answer.loads / answer.copies**0.5
    compliance = np.zeros((6, 6))
    compliance[np.ix_(answer.places, answer.places)] = answer.loads.T @ answer.answers / answer.copies
    modal = motion.T @ (motion / (2 * np.pi * frequency_hz[:, None]) ** 2)
    return SolidModes(
        TaxelModes(frequency_hz, motion, compliance - modal),
        setting.order,
        int(answer.system.free.sum()),
        answer.eigen.residual,
        np.full(len(frequency_hz), np.nan),
    )
