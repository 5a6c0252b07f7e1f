"""Triangles: from a build123d solid to welded arrays, and from there to a manifold."""

from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import GeometryError, MeshFileError
from padgen.solid.kernel import build123d, kernel_errors

__all__ = [
    "ANGLE_RAD",
    "AT_ONCE",
    "CHORD_MM",
    "Mesh",
    "as_manifold",
    "from_manifold",
    "joined",
    "signed_volume_mm3",
    "sound_mesh",
    "tessellated",
    "welded",
]

CHORD_MM = 0.01
"""Default largest distance between a curved face and its triangles (docs/performance.md has the table)."""
ANGLE_RAD = 0.3
WELD_MM, FILE_WELD_MM = 1e-6, 1e-5
AT_ONCE = 500_000
"""Triangles whose corners are looked at together: those of a large pad would take more memory than all else."""
LARGEST_MM = 1e4
"""Coordinates of a file."""


class Mesh(NamedTuple):
    """Welded triangles: `vertices_mm` (V, 3) float64, `triangles` (T, 3) int64, outward by right hand."""

    vertices_mm: np.ndarray
    triangles: np.ndarray

    @property
    def corners_mm(self) -> np.ndarray:
        """Corner coordinates, (T, 3, 3)."""
        corners: np.ndarray = self.vertices_mm[self.triangles]
        return corners


def tessellated(solid: Any, chord_mm: float = CHORD_MM, angle_rad: float = ANGLE_RAD) -> Mesh:
    """Triangles of a build123d solid within `chord_mm`, absolute, and `angle_rad`; welded.

    OCCT is called directly, since build123d's own `mesh` takes the chord relative to the shape.
    """
    build123d()
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.BRepTools import BRepTools
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopLoc import TopLoc_Location

    vertices, triangles, offset = [], [], 0
    with kernel_errors("a mesh"):
        BRepTools.Clean_s(solid.wrapped)
        BRepMesh_IncrementalMesh(solid.wrapped, chord_mm, False, angle_rad, False)
        for face in solid.faces():
            location = TopLoc_Location()
            part = BRep_Tool.Triangulation_s(face.wrapped, location)
            if part is None:
                raise GeometryError("the CAD kernel left a face without triangles")
            move = location.Transformation()
            nodes = (part.Node(i).Transformed(move) for i in range(1, part.NbNodes() + 1))
            vertices += [(p.X(), p.Y(), p.Z()) for p in nodes]
            order = (1, 3, 2) if face.wrapped.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else (1, 2, 3)
            corners = (part.Triangle(i) for i in range(1, part.NbTriangles() + 1))
            triangles += [[t.Value(k) + offset - 1 for k in order] for t in corners]
            offset += part.NbNodes()
    return welded(np.array(vertices), np.array(triangles))


def welded(vertices_mm: np.ndarray, triangles: np.ndarray, tolerance_mm: float = WELD_MM) -> Mesh:
    """Join vertices that agree within `tolerance_mm` and drop triangles that lose a side by it."""
    # By ranks along each axis, which pack into one number: rows would sort many times as slowly.
    number = np.zeros(len(vertices_mm), np.int64)
    for axis in vertices_mm.T:
        rank = np.unique(np.round(axis / tolerance_mm).astype(np.int64), return_inverse=True)[1]
        number = np.unique(number * (int(rank.max(initial=0)) + 1) + rank, return_inverse=True)[1]
    _, first = np.unique(number, return_index=True)
    triangles = number[triangles]
    a, b, c = triangles.T
    return Mesh(vertices_mm[first], triangles[(a != b) & (b != c) & (c != a)])


def sound_mesh(vertices_mm: np.ndarray, triangles: np.ndarray, where: str) -> Mesh:
    """What the file `where` holds, if all of it is there: corners that triangles name, and within bounds.

    Raises
    ------
    MeshFileError
        It is not.
    """
    if not len(vertices_mm) or triangles.min() < 0 or triangles.max() >= len(vertices_mm):
        raise MeshFileError(f"has triangles with corners that are none of its {len(vertices_mm)} vertices", where)
    if not (np.abs(vertices_mm) <= LARGEST_MM).all():  # nor is what is no number
        raise MeshFileError(f"has coordinates beyond {LARGEST_MM:g} mm, or none at all", where)
    return Mesh(vertices_mm, triangles)


def joined(mesh: Mesh, where: str) -> Mesh:
    """The triangles of a file joined where they touch, in the steps that files have.

    Raises
    ------
    MeshFileError
        All of them are smaller than such a step.
    """
    whole = welded(*mesh, FILE_WELD_MM)
    if not len(whole.triangles):
        raise MeshFileError(f"holds no triangle whose corners are {FILE_WELD_MM:g} mm apart", where)
    return whole


def signed_volume_mm3(mesh: Mesh) -> float:
    """Volume by the divergence theorem; negative for a mesh turned inside out."""
    volume = 0.0
    for some in np.array_split(mesh.triangles, len(mesh.triangles) // AT_ONCE + 1):
        a, b, c = np.moveaxis(mesh.vertices_mm[some], 1, 0)
        volume += float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    return volume


def as_manifold(mesh: Mesh, what: str) -> Any:
    """The mesh as a manifold in double precision.

    Raises
    ------
    GeometryError
        manifold refuses it; the message names `what` and manifold's own status.
    """
    import manifold3d

    solid = manifold3d.Manifold(
        manifold3d.Mesh64(
            np.ascontiguousarray(mesh.vertices_mm, dtype=np.float64),
            np.ascontiguousarray(mesh.triangles, dtype=np.uint64),
        )
    )
    if solid.status() != manifold3d.Error.NoError:
        raise GeometryError(f"{what} is not a manifold ({solid.status().name})")
    return solid


def from_manifold(solid: Any) -> Mesh:
    """The triangles of a manifold."""
    mesh = solid.to_mesh64()
    return Mesh(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64))
