"""Skin as layers on a half-space under a flat punch: its dynamic stiffness by finite elements in the half plane.

Each layer is isotropic with the shear modulus ``G (1 + jωτ)`` and Poisson's ratio ν. Displacements and pressure are
solved for together, so that ν = 1/2, no change of volume, is exact: elements Q_k with discontinuous pressures Q_(k-2),
which bear any aspect (Schötzau, Schwab and Stenberg, Numer. Math. 83 (1999) 667). Punch and guard plate slide without
friction. The mesh is a product of graded lines, finest at the edges of punch and hole, where stresses go as the root of
the distance. It ends where a static field has decayed to a share of `FAR`, or waves have lost `DECAYED` nepers.
"""

from itertools import pairwise
from math import inf, pi
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError
from padgen.verify import ng

__all__ = ["LAYERED", "SkinAnswer", "SkinLayer", "SkinQuestion", "solve_skin"]

FAR = 1e-3
"""Largest size of contact and layers over that of the mesh: the relative error of a static stiffness, about."""
DECAYED = 2.5
"""Nepers that shear waves lose on the way to the end of the mesh; twice that comes back."""
PER_WAVE = 1.2
"""Elements of a shear wave's length, at least."""


class SkinLayer(NamedTuple):
    """A layer: `thickness` in m, infinite for the half-space below, shear modulus in Pa, time constant in s."""

    thickness: float
    shear: float
    time: float
    density: float = 1100.0
    poisson: float = 0.5

    def complex_shear(self, hz: float) -> complex:
        """Return the complex shear modulus in Pa at a frequency."""
        return self.shear * (1 + 2j * pi * hz * self.time)

    def wave_number(self, hz: float) -> complex:
        """Return the wave number of shear waves in rad/m; its imaginary part is negative where they decay."""
        return complex(2 * pi * hz * np.sqrt(self.density / self.complex_shear(hz)))


LAYERED = (SkinLayer(0.35e-3, 1e6 / 4, 0.7e-3), SkinLayer(inf, 80e3 / 4, 0.7e-3))
"""Typical fingertip, provisional: 0.35 mm with a reduced modulus of 1 MPa (Geerligs 2011) on 80 kPa."""


class SkinQuestion(NamedTuple):
    """A punch of `radius` m vibrating at `hz` on skin; a plate holds the skin farther out than `hole_ratio` radii."""

    radius: float
    hz: float
    layers: tuple[SkinLayer, ...]
    hole_ratio: float = inf


class SkinAnswer(NamedTuple):
    """Dynamic stiffness in N/m, number of unknowns, and the relative residual of the linear solution."""

    stiffness: complex
    unknowns: int
    residual: float


def _graded(points: list[float], end: float, smallest: float, growth: float, largest: float) -> np.ndarray:
    """Return coordinates from 0 to `end`, `points` included, about `smallest` apart there and wider elsewhere."""
    marks = sorted({0.0, *points, end})
    line = [0.0]
    for low, high in pairwise(marks):
        fine = [mark for mark in (low, high) if mark in points]
        half = _steps((high - low) / len(fine), smallest, growth, largest)
        steps = half if low in fine else half[::-1]
        if len(fine) == 2:
            steps = np.concatenate([half, half[::-1]])
        line += (low + np.cumsum(steps)).tolist()
        line[-1] = high
    return np.array(line)


def _steps(length: float, smallest: float, growth: float, largest: float) -> np.ndarray:
    """Return element sizes that sum to `length`, the first about `smallest`, each next `growth` times as large."""
    sizes = [min(smallest, length)]
    while sum(sizes) < length:
        sizes.append(min(sizes[-1] * growth, largest))
    steps = np.array(sizes)
    return np.asarray(steps * (length / steps.sum()))


def _mesh(radii: np.ndarray, depths: np.ndarray, question: SkinQuestion) -> Any:
    """Return the mesh of the half plane, a material for each layer, with named edges."""
    from netgen.meshing import Element1D, Element2D, FaceDescriptor, Mesh, MeshPoint, Pnt

    made = Mesh(dim=2)
    points = [[made.Add(MeshPoint(Pnt(r, -z, 0))) for r in radii.tolist()] for z in depths.tolist()]
    bottoms = np.cumsum([layer.thickness for layer in question.layers])
    for k in range(len(question.layers)):
        made.Add(FaceDescriptor(surfnr=k + 1, domin=k + 1, bc=k + 1))
        made.SetMaterial(k + 1, f"layer{k}")
    middles = (depths[1:] + depths[:-1]) / 2
    layer_at = np.searchsorted(bottoms, middles).tolist()
    columns = len(radii) - 1
    for i, k in enumerate(layer_at):
        for j in range(columns):
            corners = points[i + 1][j], points[i + 1][j + 1], points[i][j + 1], points[i][j]
            made.Add(Element2D(k + 1, list(corners)))
    edges = ("axis", "punch", "gap", "plate", "bottom", "side")
    hole = question.radius * question.hole_ratio
    for j, middle in enumerate(((radii[1:] + radii[:-1]) / 2).tolist()):
        name = "punch" if middle < question.radius else "gap"
        if middle > hole:
            name = "plate"
        made.Add(Element1D([points[0][j], points[0][j + 1]], index=edges.index(name) + 1))
        made.Add(Element1D([points[-1][j], points[-1][j + 1]], index=edges.index("bottom") + 1))
    for above, below in pairwise(points):
        made.Add(Element1D([above[0], below[0]], index=edges.index("axis") + 1))
        made.Add(Element1D([above[-1], below[-1]], index=edges.index("side") + 1))
    for number, name in enumerate(edges):
        made.SetBCName(number, name)
    return ng.Mesh(made)


def solve_skin(question: SkinQuestion, order: int = 4, finest: float = 0.02, growth: float = 3.0) -> SkinAnswer:
    """Return the dynamic stiffness under the punch: the force on it that moves it by 1 m at that frequency.

    `order` is that of the displacements; elements are `finest` radii large at the edge of the punch and grow by
    `growth` from one to the next.

    Raises
    ------
    SolverError
        The layers are not one half-space below others.
    """
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    radius = question.radius
    layers = question.layers
    if not layers or layers[-1].thickness < inf or any(layer.thickness == inf for layer in layers[:-1]):
        raise SolverError("needs layers of which the last one alone is infinite", "skin")
    bottoms = np.cumsum([layer.thickness for layer in layers])[:-1].tolist()
    edges = [radius] if question.hole_ratio == inf else [radius, radius * question.hole_ratio]
    stiffness_ratio = max(layer.shear for layer in layers) / layers[-1].shear
    size = max(edges[-1], *(depth * stiffness_ratio ** (1 / 3) for depth in (0.0, *bottoms)))
    end = size / FAR
    largest = inf
    if question.hz > 0:
        numbers = [layer.wave_number(question.hz) for layer in layers]
        slowest = -numbers[-1].imag
        end = max(min(end, DECAYED / slowest), 10 * size) if slowest > 0 else end
        largest = 2 * pi / max(abs(number) for number in numbers) / PER_WAVE
    smallest = finest * radius
    radii = _graded(edges, end, smallest, growth, largest)
    depths = _graded([0.0, *bottoms], end, smallest, growth, largest)
    mesh = _mesh(radii, depths, question)
    # The side lets pass what the punch displaces, as a half-space does: it has no walls.
    moved = ng.VectorH1(mesh, order=order, complex=True, dirichletx="axis", dirichlety="bottom|punch|plate")
    space = moved * ng.L2(mesh, order=order - 2, complex=True)
    (u, p), (v, q) = space.TnT()
    r = ng.x
    omega = 2 * pi * question.hz
    shear = mesh.MaterialCF({f"layer{k}": layer.complex_shear(question.hz) for k, layer in enumerate(layers)})
    # Lamé's λ is 2 G ν/(1 − 2ν); its inverse vanishes at ν = 1/2.
    give = mesh.MaterialCF(
        {
            f"layer{k}": (1 - 2 * layer.poisson) / (2 * layer.complex_shear(question.hz) * layer.poisson)
            for k, layer in enumerate(layers)
        }
    )
    density = mesh.MaterialCF({f"layer{k}": layer.density for k, layer in enumerate(layers)})

    def strain(w: Any) -> tuple[Any, Any, Any, Any]:
        slope = ng.grad(w)
        return slope[0, 0], slope[1, 1], w[0] / r, slope[0, 1] + slope[1, 0]

    of_u = strain(u)
    of_v = strain(v)
    grown_u = sum(of_u[:3])
    grown_v = sum(of_v[:3])
    energy = 2 * shear * sum(a * b for a, b in zip(of_u[:3], of_v[:3], strict=True)) + shear * of_u[3] * of_v[3]
    form = ng.BilinearForm(space, symmetric=True)
    kinetic = density * omega**2 * (u[0] * v[0] + u[1] * v[1])
    form += 2 * pi * r * (energy - p * grown_v - q * grown_u - give * p * q - kinetic) * ng.dx(bonus_intorder=4)
    form.Assemble()
    answer = ng.GridFunction(space)
    answer.components[0].Set(ng.CF((0, 1)), definedon=mesh.Boundaries("punch"))
    free = np.flatnonzero(list(space.FreeDofs()))
    rows, columns, values = form.mat.COO()
    matrix = csc_matrix((np.array(values), (np.array(rows), np.array(columns))))
    given = answer.vec.FV().NumPy()
    load = -(matrix @ given)[free]
    inner = matrix[free][:, free].tocsc()
    solved = splu(inner).solve(load)
    residual = float(np.linalg.norm(inner @ solved - load) / np.linalg.norm(load))
    whole = given.copy()
    whole[free] = solved
    return SkinAnswer(complex(whole @ (matrix @ whole)), len(free), residual)
