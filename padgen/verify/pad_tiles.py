"""One tile of a pad reduced to its interface (Craig and Bampton, AIAA J. 6, 1968) from 3-D elasticity.

A tile's displacement is the static answer to the polynomials of `pad_interface` on the side faces where
it meets other tiles, plus its lowest modes with those faces held. SI units throughout.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.verify.elastic_material import Elastic
from padgen.verify.elastic_mesh import WASHER, Fineness, meshed
from padgen.verify.elastic_modes import Factored, System, assembled, factored, rigid_loads
from padgen.verify.engines import engine
from padgen.verify.pad_interface import (
    FACES,
    Degrees,
    Function,
    height_shape,
    interface_functions,
    plane_shape,
    quarter_turned,
)
from padgen.verify.pad_solids import HELD, TileSolid

__all__ = ["Elements", "ReducedTile", "reduced_tile", "turned"]

MODES_AT_ONCE, MOST_MODES = 6, 200
RESIDUAL = 1e-6


class Elements(NamedTuple):
    """Finite elements of the tiles: their `order` and how fine their meshes are."""

    order: int = 4
    fineness: Fineness = Fineness(levels=0)


class ReducedTile(NamedTuple):
    """A tile by `functions` (b,) of its interface and k modes with the interface held.

    `stiffness` and `mass` (b, b) of the interface, `coupling` (b, k) its mass with the modes, whose own
    stiffness is `square` (k,) = (2πf)² and mass 1. `pull` (b + k,) is the mean vertical displacement of the
    washer, and so the load of a unit force on it; zero without a washer.
    """

    functions: tuple[Function, ...]
    stiffness: np.ndarray
    mass: np.ndarray
    coupling: np.ndarray
    square: np.ndarray
    pull: np.ndarray
    unknowns: int

    @property
    def working_hz(self) -> float:
        """Frequency of the mode that a pull on the washer moves most, with the interface held; nan without one."""
        if not len(self.square):
            return float("nan")
        motion = self.pull[len(self.functions) :]
        return float(np.sqrt(self.square[(motion**2 / self.square).argmax()]) / (2 * np.pi))


def reduced_tile(
    tile: TileSolid,
    materials: Mapping[str, Elastic],
    degrees: Degrees,
    elements: Elements,
    highest_hz: float,
    where: str,
) -> ReducedTile:
    """Reduce `tile`, keeping its modes up to `highest_hz`.

    Raises
    ------
    SolverError
        It cannot be meshed, or its modes do not converge.
    """
    mesh = meshed(tile.shape, _fineness(tile, elements.fineness), where)
    solids = {name: material for name, material in materials.items() if name in mesh.GetMaterials()}
    system = assembled(mesh, solids, elements.order, "|".join((*tile.sides, HELD)))
    functions = _functions(tile, degrees)
    solve = factored(system)
    static = _static(system, solve, _traces(system, tile, functions))
    square, shapes = _modes(system, solve, highest_hz)
    heavy = system.mass_times(static)
    pull = np.zeros(len(functions) + len(square))
    if WASHER in solids:
        load = rigid_loads(system, WASHER, materials[WASHER].density_kg_per_m3, tile.axis_x_mm)[:, 2]
        pull = np.concatenate([load @ static, load @ shapes])
    stiffness = static.T @ system.stiffness_times(static)
    return ReducedTile(
        tuple(functions),
        (stiffness + stiffness.T) / 2,
        static.T @ heavy,
        heavy.T @ shapes,
        square,
        pull,
        int(system.free.sum()),
    )


def turned(tile: ReducedTile, quarters: int) -> ReducedTile:
    """The tile turned by `quarters` of +90° about z; its pull stays vertical."""
    functions, signs = list(tile.functions), np.ones(len(tile.functions))
    for _ in range(quarters % 4):
        pairs = [quarter_turned(function) for function in functions]
        functions = [function for function, _ in pairs]
        signs *= np.array([sign for _, sign in pairs])
    both = np.outer(signs, signs)
    pull = tile.pull * np.concatenate([signs, np.ones(len(tile.square))])
    return tile._replace(
        functions=tuple(functions),
        stiffness=tile.stiffness * both,
        mass=tile.mass * both,
        coupling=tile.coupling * signs[:, None],
        pull=pull,
    )


def _fineness(tile: TileSolid, asked: Fineness) -> Fineness:
    """Elements that resolve the polynomials where the shape itself asks for none: half a solid box's least side."""
    box = tile.box
    bare = len(tile.shape.solids) == 1
    least = min(box.x1 - box.x0, box.y1 - box.y0, box.height) / 2
    return asked._replace(largest_mm=min(least, asked.largest_mm)) if bare else asked


def _functions(tile: TileSolid, degrees: Degrees) -> list[Function]:
    held = {vertex for side in tile.held_sides for vertex in FACES[side]}
    sides = [side for side in tile.sides if side not in tile.held_sides]
    return interface_functions(sides, degrees, held)


def _traces(system: System, tile: TileSolid, functions: Sequence[Function]) -> np.ndarray:
    """Unknowns (n, b) on the tile's sides of each function, by least squares over the sides."""
    ngs, linalg = engine("ngsolve"), engine("scipy.sparse.linalg")
    space = ngs.H1(system.space.mesh, order=system.space.globalorder)
    on = ngs.ds("|".join(tile.sides))
    u, v = space.TnT()
    gram = ngs.BilinearForm(space)
    gram += u * v * on
    gram.Assemble()
    scalar = _scalar_matrix(gram.mat, space.ndof)
    live = np.flatnonzero(scalar.diagonal() > 0)
    solve = linalg.factorized(scalar[live][:, live].tocsc())
    known: dict[tuple, np.ndarray] = {}
    traces = np.zeros((system.free.size, len(functions)))
    for column, function in enumerate(functions):
        key = function[:3]
        if key not in known:
            form = ngs.LinearForm(space)
            form += _shape(function, tile) * v * on
            form.Assemble()
            known[key] = solve(form.vec.FV().NumPy()[live])
        traces[3 * live + function.axis, column] = known[key]
    return traces


def _shape(function: Function, tile: TileSolid) -> Any:
    ngs, box = engine("ngsolve"), tile.box
    xi = (2 * ngs.x - box.x0 - box.x1) / (box.x1 - box.x0)
    eta = (2 * ngs.y - box.y0 - box.y1) / (box.y1 - box.y0)
    zeta = 2 * ngs.z / box.height - 1
    return plane_shape(function.place, function.degree, xi, eta) * height_shape(function.height, zeta, tile.held_below)


def _scalar_matrix(matrix: Any, size: int) -> Any:
    sparse = engine("scipy.sparse")
    rows, columns, values = (np.asarray(part) for part in matrix.COO())
    return sparse.csr_matrix((values, (rows, columns)), shape=(size, size))


def _static(system: System, solve: Factored, traces: np.ndarray) -> np.ndarray:
    """Displacements (n, b) of the tile under prescribed traces."""
    load = system.stiffness_times(traces) * system.free[:, None]
    return np.asarray(traces - np.array([solve(column) for column in load.T]).T)


def _modes(system: System, solve: Factored, highest_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """``(2πf)²`` and mass-normalised shapes of the modes up to `highest_hz`."""
    highest = (2 * np.pi * highest_hz) ** 2
    count = MODES_AT_ONCE
    while True:
        square, shapes = _lowest(system, solve, count)
        below = square <= highest
        if not below.all():
            return square[below], shapes[:, below]
        count *= 2
        if count > MOST_MODES:
            raise SolverError(f"has more than {count // 2} modes below {number(highest_hz)} Hz", "tile")


def _lowest(system: System, solve: Factored, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The lowest modes by Lanczos on ``K⁻¹ M``; each is checked by applying that once more."""
    linalg = engine("scipy.sparse.linalg")
    shape = (system.free.size, system.free.size)
    heavy = linalg.LinearOperator(shape, lambda x: system.mass_times(np.ravel(x) * system.free), dtype=float)
    inverse = linalg.LinearOperator(shape, lambda x: solve(np.ravel(x)), dtype=float)
    start = solve(heavy(np.cos(np.arange(system.free.size))))
    try:
        square, found = linalg.eigsh(heavy, count, M=heavy, sigma=0.0, OPinv=inverse, v0=start, tol=1e-9)
    except linalg.ArpackError as error:
        raise SolverError(f"the modes of a tile did not converge ({error})", "pad") from error
    left = np.array([solve(heavy(column)) for column in found.T]).T * square - found
    worst = float((np.linalg.norm(left, axis=0) / np.linalg.norm(found, axis=0)).max())
    if not worst < RESIDUAL:
        raise SolverError(f"a mode of a tile leaves a residual of {worst:.1e}, must be below {RESIDUAL:.0e}", "pad")
    weight = np.einsum("ik,ik->k", found, system.mass_times(found))
    return square, found / np.sqrt(weight)
