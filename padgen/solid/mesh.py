"""Triangle meshes: made from solids, welded, turned into manifolds, and tested.

The tests are of any mesh: closed, consistently wound, in one piece, free of self-intersections.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import GeometryError, MeshFileError
from padgen.solid.kernel import build123d, kernel_errors

__all__ = [
    "ANGLE_RAD",
    "AT_ONCE",
    "CHORD_MM",
    "ROUND_MM",
    "Mesh",
    "Topology",
    "as_manifold",
    "group_indices",
    "intersecting_pairs",
    "shells",
    "signed_volume_mm3",
    "sound_mesh",
    "tessellated",
    "topology",
    "unit_normals",
    "welded",
]

CHORD_MM = 0.01
"""Default largest distance between a curved face and its triangles (docs/performance.md has the table)."""
ROUND_MM = 2 * CHORD_MM
"""Largest change of a diameter by triangles: a polygon lies within the true circle."""
ANGLE_RAD = 0.3
WELD_MM = 1e-6
FILE_WELD_MM = 1e-5
AT_ONCE = 500_000
"""Triangles that are processed together: the corners of all of a large pad's would take too much memory."""
LARGEST_MM = 1e4
"""Largest coordinate that a mesh file may hold."""


class Mesh(NamedTuple):
    """A triangle mesh: `vertices_mm` (V, 3) float64, `triangles` (T, 3) int64, anticlockwise as seen from outside."""

    vertices_mm: np.ndarray
    triangles: np.ndarray

    @property
    def corners_mm(self) -> np.ndarray:
        """Coordinates of each triangle's corners in mm, (T, 3, 3)."""
        return np.asarray(self.vertices_mm[self.triangles])


def unit_normals(corners_mm: np.ndarray) -> np.ndarray:
    """Return the outward unit normals (n, 3) of triangles (n, 3, 3), zero where one has no area."""
    across = np.cross(corners_mm[:, 1] - corners_mm[:, 0], corners_mm[:, 2] - corners_mm[:, 0])
    return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30))


def tessellated(solid: Any, chord_mm: float = CHORD_MM, angle_rad: float = ANGLE_RAD) -> Mesh:
    """Triangulate a build123d solid and weld the triangles.

    They leave its faces by at most `chord_mm`; neighbours on a round face turn by at most `angle_rad`. OCCT is called
    directly, since build123d's own `mesh` takes the chord relative to the shape.
    """
    build123d()
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.BRepTools import BRepTools
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopLoc import TopLoc_Location

    vertices = []
    triangles = []
    offset = 0
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
    """Join vertices that round to the same multiple of `tolerance_mm`, and drop triangles that collapse by it."""
    # The ranks along the three axes are packed into one number: sorting rows would be many times slower.
    number = np.zeros(len(vertices_mm), np.int64)
    for axis in vertices_mm.T:
        rank = np.unique(np.round(axis / tolerance_mm).astype(np.int64), return_inverse=True)[1]
        number = np.unique(number * (int(rank.max(initial=0)) + 1) + rank, return_inverse=True)[1]
    _, first = np.unique(number, return_index=True)
    triangles = number[triangles]
    a, b, c = triangles.T
    return Mesh(vertices_mm[first], triangles[(a != b) & (b != c) & (c != a)])


def group_indices(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, for items in successive groups of sizes `counts`, each item's group index and its index in its group.

    >>> group_indices(np.array([2, 0, 3]))
    (array([0, 0, 2, 2, 2]), array([0, 1, 0, 1, 2]))
    """
    run = np.repeat(np.arange(len(counts)), counts)
    return run, np.arange(len(run)) - np.repeat(np.cumsum(counts) - counts, counts)


def sound_mesh(vertices_mm: np.ndarray, triangles: np.ndarray, where: str, weld: bool = True) -> Mesh:
    """Return vertices and triangles read from file `where` as a checked mesh, with `weld` its corners joined.

    Raises
    ------
    MeshFileError
        A triangle names a vertex that does not exist, a coordinate is beyond `LARGEST_MM` or not a number, or no
        triangle has a size.
    """
    if not len(vertices_mm) or triangles.min() < 0 or triangles.max() >= len(vertices_mm):
        raise MeshFileError(f"has triangles with corners that are none of its {len(vertices_mm)} vertices", where)
    if not (np.abs(vertices_mm) <= LARGEST_MM).all():  # false for nan, too
        raise MeshFileError(f"has coordinates beyond {LARGEST_MM:g} mm, or none at all", where)
    mesh = welded(vertices_mm, triangles, FILE_WELD_MM) if weld else Mesh(vertices_mm, triangles)
    if not len(mesh.triangles):
        raise MeshFileError(f"holds no triangle whose corners are {FILE_WELD_MM:g} mm apart", where)
    return mesh


def signed_volume_mm3(mesh: Mesh) -> float:
    """Return the volume by the divergence theorem; it is negative for a mesh turned inside out."""
    volume = 0.0
    for some in np.array_split(mesh.triangles, len(mesh.triangles) // AT_ONCE + 1):
        a, b, c = np.moveaxis(mesh.vertices_mm[some], 1, 0)
        volume += float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    return volume


def as_manifold(mesh: Mesh, what: str) -> Any:
    """Return the mesh as a manifold3d solid in double precision.

    Raises
    ------
    GeometryError
        manifold3d refuses the mesh; the message names `what` and the status that manifold3d gives.
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


PAIRS_AT_ONCE = 1_000_000
MOST_PAIRS = 40_000_000
MOST_FOUND = 100_000
"""Most candidate pairs beyond `MANY_PAIRS` per triangle, and the number of pairs found that ends the search."""
MOST_COLUMNS = 10_000
MOST_CELLS = 16
MANY_PAIRS = 100
"""Most columns along a side of the grid, most columns per triangle on average, and the candidates per triangle above
which wider columns are tried."""


class Topology(NamedTuple):
    """A mesh's number of faulty edges, a vertex of the first faulty one, number of connected shells, and volume.

    Each edge of a good mesh joins two triangles that agree which side is out: it is closed, without a faulty edge.
    """

    broken_edges: int
    first_broken: int
    shells: int
    volume_mm3: float

    @property
    def closed(self) -> bool:
        """True if every edge joins exactly two triangles that agree which side is outside."""
        return not self.broken_edges


def topology(mesh: Mesh) -> Topology:
    """Return a mesh's number of open, non-manifold or miswound edges, its number of shells and its volume."""
    # An edge and its direction (the last bit) are packed into one number: sorting rows, or an argsort, would take many
    # times as long.
    count = max(len(mesh.vertices_mm), 1)
    sides = np.empty((3, len(mesh.triangles)), np.int64)
    for i, side in enumerate(sides):
        a = mesh.triangles[:, i]
        b = mesh.triangles[:, i - 2]
        np.minimum(a, b, out=side)
        side *= count
        side += np.maximum(a, b)
        side *= 2
        side += a < b
    key = sides.ravel()
    key.sort()
    start = np.flatnonzero(np.diff(key >> 1, prepend=-1))
    counts = np.diff(start, append=len(key))
    # How many of an edge's triangles run along it from its lower vertex number.
    forward = np.add.reduceat(key & 1, start) if len(key) else counts
    broken = key[start[(counts != 2) | (forward != 1)]] // (2 * count)
    return Topology(
        len(broken),
        int(broken[0]) if len(broken) else 0,
        int(shells(mesh).max()) + 1 if len(mesh.triangles) else 0,
        signed_volume_mm3(mesh),
    )


def shells(mesh: Mesh) -> np.ndarray:
    """Return for each triangle the index, from 0, of the connected shell that it belongs to."""
    label = np.arange(len(mesh.vertices_mm))
    before = np.empty(0, int)
    while not np.array_equal(label, before):
        before = label
        label = label.copy()
        least = before[mesh.triangles].min(1)
        for corner in mesh.triangles.T:
            np.minimum.at(label, corner, least)
        label = label[label]
    return np.asarray(np.unique(label[mesh.triangles[:, 0]], return_inverse=True)[1])


def intersecting_pairs(mesh: Mesh) -> np.ndarray:
    """Return the pairs (P, 2) of triangles that pierce each other, no more than about `MOST_FOUND`.

    Triangles pierce when an edge of one passes through the inside of the other. Touching and coplanar overlap are left
    to the checks of closedness and volume. Candidates come from a grid of columns in the plane, so that the time for a
    flat part is linear in its triangles.

    Raises
    ------
    GeometryError
        There are more candidates than can be looked at.
    """
    corners = mesh.corners_mm
    low = corners.min(1)
    high = corners.max(1)
    crossing: list[np.ndarray] = []
    for pairs in _overlapping(low, high):
        crossing.append(pairs[_pierce(mesh, *pairs.T)])
        if sum(len(pairs) for pairs in crossing) > MOST_FOUND:
            break
    pairs = np.concatenate(crossing) if crossing else np.empty((0, 2), dtype=np.int64)
    return np.unique(pairs, axis=0)


def _overlapping(low: np.ndarray, high: np.ndarray) -> Iterator[np.ndarray]:
    """Yield arrays of pairs of triangles whose bounding boxes overlap, in batches; a pair may occur more than once."""
    owner, partners = _columns(low, high)
    if partners.sum() > MANY_PAIRS * len(low) + MOST_PAIRS:
        raise GeometryError("too many of its triangles lie over each other for all of them to be compared")
    stops = np.searchsorted(
        np.cumsum(partners), np.arange(PAIRS_AT_ONCE, partners.sum() + PAIRS_AT_ONCE, PAIRS_AT_ONCE)
    )
    for chunk in np.split(np.arange(len(owner)), np.unique(np.minimum(stops + 1, len(owner)))):
        run, step = group_indices(partners[chunk])
        a = owner[chunk[run]]
        b = owner[chunk[run] + 1 + step]
        for axis in (2, 0, 1):
            # Triangles whose boxes only touch cannot pierce, such as those of one horizontal face.
            overlap = (low[a, axis] < high[b, axis]) & (low[b, axis] < high[a, axis])
            a = a[overlap]
            b = b[overlap]
        yield np.sort(np.stack([a, b], -1), axis=1)


def _columns(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return triangle indices sorted by grid column, and for each how many of those after it to compare it with.

    A column holds about a dozen triangles. Columns are wider where many triangles span several columns, since each
    pair would meet in all of them.
    """
    count = len(low)
    flat = low[:, 2] == high[:, 2]
    floor = low[:, :2].min(0)
    extent = np.ptp(np.concatenate([low, high])[:, :2], axis=0)
    side = max(float(np.sqrt(extent.prod() / max(count / 12, 1))), float(extent.max()) / MOST_COLUMNS, 1e-9)
    best: tuple[np.ndarray, np.ndarray] | None = None
    while True:
        first, last = (((v[:, :2] - floor) // side).astype(np.int64) for v in (low, high))
        spans = last - first + 1
        cells = spans.prod(1)
        if cells.sum() <= MOST_CELLS * count:
            owner, at = group_indices(cells)
            column = first[owner, 0] + at % spans[owner, 0]
            row = first[owner, 1] + at // spans[owner, 0]
            key = column * (int(last[:, 1].max()) + 1) + row
            # Horizontal triangles come last in their column, since two of them never pierce each other.
            order = np.argsort(2 * key + flat[owner], kind="stable")
            owner = owner[order]
            key = key[order]
            partners = np.searchsorted(key, key, side="right") - np.arange(len(key)) - 1
            partners[flat[owner]] = 0
            if best and best[1].sum() <= partners.sum():
                return best
            best = owner, partners
            if partners.sum() <= MANY_PAIRS * count:
                return best
        side *= 2


def _pierce(mesh: Mesh, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a mask of the pairs (`a`, `b`) of triangles where an edge of one passes through the other."""
    result = np.zeros(len(a), dtype=bool)
    for one, other in ((a, b), (b, a)):
        face = mesh.triangles[other]
        corners = np.moveaxis(mesh.vertices_mm[face], 1, 0)
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        margin = 1e-7 * np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
        ends = [mesh.triangles[one, i] for i in range(3)]
        heights = [np.einsum("ij,ij->i", mesh.vertices_mm[end] - corners[0], normal) for end in ends]
        for i, j in ((0, 1), (1, 2), (2, 0)):
            low = np.minimum(heights[i], heights[j])
            high = np.maximum(heights[i], heights[j])
            shared = ((face == ends[i][:, None]) | (face == ends[j][:, None])).any(1)
            at = np.flatnonzero((low < -margin) & (high > margin) & ~shared)
            start = mesh.vertices_mm[ends[i][at]]
            along = mesh.vertices_mm[ends[j][at]] - start
            a, b, c = corners[:, at] - start
            # An edge passes between a face's corners where all volumes that it spans with two of them have one sign.
            turns = [np.einsum("ij,ij->i", np.cross(*each), along) for each in ((a, b), (b, c), (c, a))]
            bound = margin[at] * np.linalg.norm(along, axis=1)
            result[at] |= (np.minimum.reduce(turns) > bound) | (np.maximum.reduce(turns) < -bound)
    return result
