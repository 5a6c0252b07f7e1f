"""A meshed solid for elasticity: STEP → glued B-rep → tetrahedra, refined geometrically at singular edges.

Stress is singular along re-entrant edges and where a clamp ends; the error sits there. Netgen lays
shrinking layers of prisms round the edges marked, which restores the order of the elements. Lengths in mm.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.verify.engines import ng, occ

__all__ = [
    "CLAMPED",
    "CLAMPS",
    "PRINTED",
    "WASHER",
    "Fineness",
    "clamped_shape",
    "coarse_mesh",
    "edge_angles",
    "meshed",
    "singular_edges",
    "taxel_shape",
]

PRINTED, WASHER, CLAMPED = "printed", "washer", "clamped"
CLAMPS = ("sides", "bottom", "root")
"""Clamped faces: the outer vertical faces of the frame, its underside, or the face of smallest x only."""
REENTRANT_DEG = 190.0
VOLUME_SHARE = 0.01
LOST_VOLUME = 1e-9


class Fineness(NamedTuple):
    """How fine a mesh is: `levels` of layers round singular edges, each `factor` as thick as the last,
    in tetrahedra of at most `largest_mm` and `per_face` times the root of a face's area, that grow by
    `grading` (0 slow, 1 fast); `curvature` elements to a radius, `per_edge` at least along an edge."""

    levels: int = 2
    factor: float = 0.25
    largest_mm: float = 1e3
    grading: float = 0.5
    curvature: float = 1.0
    per_edge: float = 0.3
    per_face: float = 1.0


USUAL = Fineness()


def taxel_shape(step: Path, washer_volume_mm3: float, where: str = "") -> Any:
    """Glue the two solids of a STEP file into one shape that shares faces.

    They are named ``printed`` and ``washer``, told apart by volume because names do not survive the import. Refusals
    begin with `where`, with the file where that is empty.

    Raises
    ------
    SolverError
        The file cannot be read, does not hold two solids with volume, none of them is the washer,
        or the washer does not touch the printed part.
    """
    where = where or str(step)
    if not step.is_file():
        raise SolverError("there is no such STEP file", where)
    try:
        solids = list(occ.OCCGeometry(str(step)).shape.solids)
    except Exception as error:
        raise SolverError(f"cannot be read as STEP ({_first_line(error)})", where) from error
    volumes = [solid.mass for solid in solids]
    if len(solids) != 2 or min(volumes) <= 0:
        raise SolverError(f"must hold two solids, printed part and washer, holds {len(solids)}", where)
    misfit = [abs(volume / washer_volume_mm3 - 1) for volume in volumes]
    if min(misfit) > VOLUME_SHARE:
        found = " and ".join(f"{number(v)} mm³" for v in volumes)
        raise SolverError(
            f"none of its solids is the washer of {number(washer_volume_mm3)} mm³, they have {found}", where
        )
    washer = int(np.argmin(misfit))
    solids[washer].name, solids[1 - washer].name = WASHER, PRINTED
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
    """Return the shape with the faces that `clamp` (of `CLAMPS`) holds named ``clamped``.

    Raises
    ------
    SolverError
        `clamp` is unknown, or no face lies there.
    """
    if clamp not in CLAMPS:
        raise SolverError(f"must be one of {', '.join(CLAMPS)}, got {clamp}", "clamp")
    printed = next(solid for solid in shape.solids if solid.name == PRINTED)
    low, high = (np.array(_xyz(corner)) for corner in printed.bounding_box)
    sides = {"sides": ((0, low), (0, high), (1, low), (1, high)), "bottom": ((2, low),), "root": ((0, low),)}[clamp]
    near = 1e-5 * float((high - low).max())
    held = [face for face in printed.faces if any(_lies_at(face, axis, bound[axis], near) for axis, bound in sides)]
    if not held:
        raise SolverError(f"has no face to clamp by its {clamp}", "taxel")
    for face in held:
        face.name = CLAMPED
    return shape


def _lies_at(face: Any, axis: int, place: float, near: float) -> bool:
    low, high = (_xyz(corner)[axis] for corner in face.bounding_box)
    return abs(low - place) < near and abs(high - place) < near


def meshed(shape: Any, fineness: Fineness = USUAL, where: str = "taxel", layered: set[str] | None = None) -> Any:
    """Return the NGSolve mesh of `shape` (see `clamped_shape`), not curved yet.

    It has layers along the edges named in `layered`, all singular ones by default. Where Netgen fails, or its layers
    leave an element without volume, slightly other meshes are tried.

    Raises
    ------
    SolverError
        Netgen cannot mesh it, e.g. a beam thinner than it resolves.
    """
    if layered is None:
        layered = singular_edges(shape, coarse_mesh(shape, fineness, where))
    _mark(shape.edges, layered)
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
    """Yield Netgen's meshes of `shape`, and how fine each is: as asked, then slightly other ones; at least one."""
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
                curvaturesafety=attempt.curvature,
                segmentsperedge=attempt.per_edge,
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
    _mark(shape.edges, set())
    mesh, _ = next(_coarse_meshes(shape, fineness, where))
    return mesh


def singular_edges(shape: Any, mesh: Any) -> set[str]:
    """Return names of the edges where stress is singular: re-entrant ones and those of clamped faces."""
    clamped = {edge.name for face in shape.faces if face.name == CLAMPED for edge in face.edges}
    return clamped | {name for name, angle in edge_angles(mesh).items() if angle > REENTRANT_DEG}


def _mark(edges: Iterable[Any], singular: set[str]) -> None:
    for edge in edges:
        edge.hpref = 1.0 if edge.name in singular else 0.0


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def edge_angles(mesh: Any) -> dict[str, float]:
    """Return the angle in degrees that the material fills at each named edge, over 180 where it is re-entrant.

    Measured on the triangles of the outer surface of a Netgen surface mesh; inner edges of a glued
    shape, where no outer surface meets, are left out.
    """
    points, triangles = mesh.Coordinates(), mesh.Elements2D().NumPy()
    corner, face = triangles["nodes"][:, :3] - 1, triangles["index"]
    sides = [(mesh.FaceDescriptor(k + 1).domin, mesh.FaceDescriptor(k + 1).domout) for k in range(face.max())]
    domain = np.array(sides)[face - 1]
    outer = (domain == 0).any(1)
    corner = np.where((domain[:, :1] == 0), corner[:, ::-1], corner)[outer]
    normal = np.cross(points[corner[:, 1]] - points[corner[:, 0]], points[corner[:, 2]] - points[corner[:, 0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    neighbours: dict[frozenset[int], list[int]] = {}
    for k, nodes in enumerate(corner.tolist()):
        for a in range(3):
            neighbours.setdefault(frozenset((nodes[a], nodes[a - 1])), []).append(k)
    angles: dict[str, float] = {}
    for segment in mesh.Elements1D().NumPy():
        ends = frozenset((segment["nodes"][:2] - 1).tolist())
        pair = neighbours.get(ends, [])
        if len(pair) == 2:
            name = mesh.GetCD2Name(int(segment["index"]) - 1)
            one, other = normal[pair[0]], normal[pair[1]]
            (apex,) = set(corner[pair[1]].tolist()) - ends
            above = one @ (points[apex] - points[next(iter(ends))])
            turn = np.degrees(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))
            angles[name] = max(angles.get(name, 0.0), float(180 + turn if above > 0 else 180 - turn))
    return angles
