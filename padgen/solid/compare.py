"""Comparison of a mesh with the planned one: its pose, and every difference into which a cube of `SMALLEST_MM` fits.

Triangles with the same corners are equal. Where triangles differ but cover the same places of the same planes, another
program only cut the faces anew. All else is found by subtracting the two solids from each other.
"""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import Finding, number
from padgen.planner.layout import taxel_places
from padgen.planner.plan import Plan
from padgen.solid.mesh import Mesh, unit_normals

__all__ = [
    "SMALLEST_MM",
    "STRIP_MM",
    "Cells",
    "Difference",
    "Pose",
    "differences",
    "pose_of",
    "same_faces",
    "unmatched_triangles",
]

SMALLEST_MM = 0.06
"""Side of a cube along the axes (2.2e-4 mm³): every difference with room for such a cube is found.

It is about half a layer, and what coarse chords take off a round recess (0.5 rad at 3.7 mm: 0.058 mm).
"""
SAME_MM = 1e-3
"""Largest distance of two corners that count as equal, since files hold single precision or few digits."""
STRIP_MM = 5e-3
"""Width of strips in which the same face of two meshes may differ, since programs round the corners on its edges."""
STEEP = 1e-3
"""Least vertical part of a face's unit normal for the face to count as seen from above or below."""
LANDMARK_MM = 0.02
LANDMARKS = 4000
"""Largest distance of two corners that match when a mesh is laid over another, and the most corners compared."""
CORNER_RAD = 0.8
"""Least difference between the sum of the angles at a corner and a whole turn, so that rims of round faces stay out."""
MARGIN_MM = 0.137
"""Margin around cells when parts are cut out of both solids, so that the cuts fall where no faces are."""
OUTSIDE_MM = 2e4
MOST_PIECES = 200
"""Most differences of a kind whose volumes are computed: another pad has thousands, of which few are reported."""
SCALE = 5e-4
"""Smallest relative difference in size that counts as scaling."""


class Pose(NamedTuple):
    """The place and orientation of a mesh, compared with the planned one.

    ``corner @ rows.T + shift_mm`` is where a corner was planned; then `share` of the compared corners match.
    """

    rows: np.ndarray
    shift_mm: np.ndarray
    share: float
    turned_deg: float = 0.0
    flipped: bool = False
    mirrored: bool = False
    scale: float = 1.0

    def laid(self, mesh: Mesh) -> Mesh:
        """Return the mesh moved to where it was planned, its triangles facing outwards as before."""
        if not self.shift_mm.any() and np.array_equal(self.rows, np.eye(3)):
            return mesh
        triangles = mesh.triangles[:, ::-1] if np.linalg.det(self.rows) < 0 else mesh.triangles
        return Mesh(mesh.vertices_mm @ self.rows.T + self.shift_mm, triangles)

    def findings(self) -> Iterator[Finding]:
        """Yield one finding on the pose, an error if the print would differ, else a note; none if as planned."""
        turned = f"turned by {number(round(self.turned_deg, 3))}° about z"
        size = f"{number(1 / self.scale)} times as large as planned: scale it by {number(self.scale)}"
        wrong = (
            (self.mirrored, "mirrored: export it again without mirroring"),
            (self.flipped, "upside down: turn it over, bosses up"),
            (self.scale != 1, size),
        )
        if faults := [wording for holds, wording in wrong if holds]:
            said = " and ".join([turned] * bool(self.turned_deg) + faults)
            sentence = f"it is {said}; figures and other findings are of the mesh put right"
            yield Finding("error", "built.pose", "mesh", sentence)
        elif self.turned_deg:
            wording = "its coils' rows and columns turn with it; nothing else is to be done"
            yield Finding("note", "built.pose", "mesh", f"it is {turned}, {wording}")
        elif (np.abs(self.shift_mm) > SAME_MM).any():
            moved = ", ".join(number(round(float(-v), 4)) for v in self.shift_mm)
            wording = "slicers place it anew anyway; nothing is to be done"
            yield Finding("note", "built.pose", "mesh", f"it was moved by ({moved}) mm, {wording}")


class Cells(NamedTuple):
    """The lattice of cells that differences are sorted into: edges of columns and rows in mm, and each cell's name."""

    x_mm: np.ndarray
    y_mm: np.ndarray
    names: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, plan: Plan) -> "Cells":
        """Return the sub-cells of a pad with its border around them."""
        places = np.pad(taxel_places(plan), 1, constant_values=-2)
        names = [*(f"taxel {taxel.id}" for taxel in plan.taxels), "border", "frame"]
        rows, columns = np.array(places.shape) - 1
        half_x = plan.spec.pad.width_mm / 2
        half_y = plan.spec.pad.depth_mm / 2
        return cls(
            np.linspace(-half_x, half_x, columns),
            np.linspace(-half_y, half_y, rows),
            tuple(tuple(names[k] for k in row) for row in places.tolist()),
        )

    def within(self, corners_mm: np.ndarray) -> np.ndarray:
        """Return a mask (rows + 2, columns + 2) of the cells that triangles (n, 3, 3) reach into."""
        low = corners_mm[..., :2].min(1) - MARGIN_MM / 2
        high = corners_mm[..., :2].max(1) + MARGIN_MM / 2
        x0, x1 = (np.searchsorted(self.x_mm, corner[:, 0]) for corner in (low, high))
        y0, y1 = (np.searchsorted(self.y_mm, corner[:, 1]) for corner in (low, high))
        reached = np.zeros((len(self.y_mm) + 1, len(self.x_mm) + 1), bool)
        for left, right, below, above in np.unique(np.stack([x0, x1, y0, y1], -1), axis=0).tolist():
            reached[below : above + 1, left : right + 1] = True
        return reached

    def room(self, reached: np.ndarray) -> Any:
        """Return a manifold3d solid that fills the `reached` cells at all heights, far above and below the pad."""
        import manifold3d

        x, y = (np.concatenate([[-OUTSIDE_MM], edges, [OUTSIDE_MM]]) for edges in (self.x_mm, self.y_mm))
        boxes = []
        for row, column in np.argwhere(reached).tolist():
            low = np.array([x[column] - MARGIN_MM, y[row] - MARGIN_MM, -OUTSIDE_MM])
            high = np.array([x[column + 1] + MARGIN_MM, y[row + 1] + MARGIN_MM, OUTSIDE_MM])
            boxes.append(manifold3d.Manifold.cube(tuple(high - low)).translate(tuple(low)))
        return manifold3d.Manifold.batch_boolean(boxes, manifold3d.OpType.Add)

    def name_at(self, x_mm: float, y_mm: float) -> str:
        """Return the name of the cell at a place in mm: that of its taxel, 'border' or 'frame'."""
        return self.names[np.searchsorted(self.y_mm, y_mm)][np.searchsorted(self.x_mm, x_mm)]


class Difference(NamedTuple):
    """A piece of material, surplus if `more`, else missing: its volume in mm³, middle and extent in mm."""

    more: bool
    volume_mm3: float
    place_mm: tuple[float, float, float]
    extent_mm: tuple[float, float, float]


def pose_of(mesh: Mesh, planned: Mesh) -> Pose:
    """Find how the mesh lies compared with the planned one: as planned, or moved, turned, mirrored or scaled.

    Other poses are tried only where the mesh does not lie as planned. The longest side of its outline, taken as a side
    of the border, gives the angle; the boxes of both meshes give scale and shift. The pose with the largest share of
    matching corners wins.
    """
    from scipy.spatial import ConvexHull, QhullError, cKDTree

    marks = _landmarks(planned)
    tree = cKDTree(mesh.vertices_mm)

    def share(rows: np.ndarray, shift: np.ndarray) -> float:
        near = tree.query((marks - shift) @ np.linalg.inv(rows).T, distance_upper_bound=LANDMARK_MM)[0]
        return float(np.isfinite(near).mean())

    best = Pose(np.eye(3), np.zeros(3), share(np.eye(3), np.zeros(3)))
    if best.share > 0.999 or not np.ptp(mesh.vertices_mm, axis=0).all():
        return best
    try:
        outline = mesh.vertices_mm[ConvexHull(mesh.vertices_mm[:, :2]).vertices]
    except QhullError:  # it stands on a line
        return best
    sides = np.roll(outline, -1, axis=0) - outline
    along = sides[np.hypot(*sides[:, :2].T).argmax()]
    ends = np.concatenate([outline, mesh.vertices_mm[mesh.vertices_mm[:, 2].argsort()[[0, -1]]]])
    low = planned.vertices_mm.min(0)
    high = planned.vertices_mm.max(0)
    for quarter, flipped, mirrored in product(range(4), (False, True), (False, True)):
        angle = quarter * np.pi / 2 - float(np.arctan2(along[1], along[0]))
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        rows = turn @ np.diag([-1.0 if mirrored else 1.0, -1.0 if flipped else 1.0, -1.0 if flipped else 1.0])
        there = ends @ rows.T
        ratios = (high - low) / np.maximum(np.ptp(there, axis=0), 1e-9)
        scale = float(np.median(ratios))
        if abs(scale - 1) < SCALE or np.ptp(ratios) > SCALE * scale:
            scale = 1.0
        there = there * scale
        rows = rows * scale
        shift = (low + high - there.min(0) - there.max(0)) / 2
        shift[2] = low[2] - there[:, 2].min()
        shared = share(rows, shift)
        if shared > best.share + 1e-9:
            turned = (np.degrees(-angle) + 180) % 360 - 180
            if abs(turned) < 1e-3:
                turned = 0.0
            best = Pose(rows, shift, shared, turned, flipped, mirrored, scale)
    return best


def _landmarks(mesh: Mesh) -> np.ndarray:
    """Return corners (n, 3) where three flat faces meet, which do not depend on how round faces are triangulated."""
    import trimesh

    angles = trimesh.triangles.angles(mesh.corners_mm)
    whole = np.bincount(mesh.triangles.ravel(), angles.ravel(), len(mesh.vertices_mm))
    marks = mesh.vertices_mm[np.abs(whole - 2 * np.pi) > CORNER_RAD]
    return np.asarray(marks[:: len(marks) // LANDMARKS + 1])


def unmatched_triangles(mesh: Mesh, planned: Mesh) -> tuple[np.ndarray, np.ndarray, Mesh]:
    """Return masks of each mesh's triangles that the other lacks, and `mesh` with corners snapped to `planned`.

    The first mask is of the triangles of `mesh`, the second of those of `planned`.
    """
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(planned.vertices_mm).query(mesh.vertices_mm, distance_upper_bound=SAME_MM)
    count = len(planned.vertices_mm)
    known = nearest < count
    vertices = mesh.vertices_mm.copy()
    vertices[known] = planned.vertices_mm[nearest[known]]
    keys = []
    for triangles in (nearest[mesh.triangles], planned.triangles):
        # One number per triangle, the same for all three first corners (for up to two million vertices).
        first = triangles.argmin(1)[:, None]
        a, b, c = np.take_along_axis(triangles, (first + np.arange(3)) % 3, 1).T
        keys.append((a * (count + 1) + b) * (count + 1) + c)
    lost = ~np.isin(*keys[::-1])
    return ~known[mesh.triangles].all(1) | ~np.isin(*keys), lost, Mesh(vertices, mesh.triangles)


def same_faces(triangles_mm: np.ndarray, planned_mm: np.ndarray) -> bool:
    """Return whether two sets of triangles (n, 3, 3) cover the same faces, however the faces are triangulated.

    Along a vertical line two solids that differ by these triangles can part only at faces that are seen from above or
    below, and cannot where the triangles in every plane cover the same places. Strips narrower than `STRIP_MM` are left
    out.
    """
    from manifold3d import CrossSection, FillRule, JoinType

    corners = np.concatenate([triangles_mm, planned_mm])
    if not len(corners):
        return True
    normals = unit_normals(corners)
    planes = np.column_stack([normals, np.einsum("ij,ij->i", normals, corners[:, 0])])
    seen = np.flatnonzero(np.abs(normals[:, 2]) > STEEP)
    _, plane = np.unique(np.round(planes[seen] / SAME_MM), axis=0, return_inverse=True)
    order = np.argsort(plane, kind="stable")
    for members in np.split(seen[order], np.flatnonzero(np.diff(plane[order])) + 1):
        # They come in their order, those of the plan last.
        one, other = (
            CrossSection(list(corners[part, :, :2]), FillRule.NonZero)
            for part in np.split(members, [np.searchsorted(members, len(triangles_mm))])
        )
        apart = (one - other) + (other - one)
        large = apart.area() > STRIP_MM**2 / 2
        # Without `simplify`, slivers would come out of `offset` turned inside out.
        if large and not apart.simplify(STRIP_MM / 50).offset(-STRIP_MM / 2, JoinType.Miter).is_empty():
            return False
    return True


def differences(one: Any, other: Any) -> list[Difference]:
    """Return the pieces in which two manifold3d solids differ, largest first: surplus in `one` or missing.

    See `SMALLEST_MM` for how small a piece is found.
    """
    differing = []
    for more, part in ((True, one - other), (False, other - one)):
        core = part
        # What is left are places of a cube's lowest corner: all eight corners lie in the part.
        for step in np.eye(3) * SMALLEST_MM:
            core = core ^ core.translate(tuple(-step))
        for piece in sorted(core.decompose(), key=lambda each: -each.volume())[:MOST_PIECES]:
            bounds = np.array(piece.bounding_box())
            low = bounds[:3]
            high = bounds[3:] + SMALLEST_MM
            box = type(part).cube(tuple(high - low)).translate(tuple(low))
            middle = tuple(((low + high) / 2).tolist())
            extent = tuple((high - low).tolist())
            differing.append(Difference(more, float((part ^ box).volume()), middle, extent))
    return sorted(differing, key=lambda each: -each.volume_mm3)
