"""A mesh against the solid that a plan makes: how it lies, and every difference that a cube of `SMALLEST_MM` fits into.

Triangles with the same corners are the same; where others are, the two solids are subtracted from each other.
"""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import number
from padgen.core.finding import Finding
from padgen.planner.plan import Plan
from padgen.planner.tile import taxel_places
from padgen.solid.mesh import Mesh

__all__ = ["SMALLEST_MM", "Cells", "Difference", "Pose", "differences", "loose_triangles", "pose_of"]

SMALLEST_MM = 0.06
"""Side of a cube along the axes (2.2e-4 mm³): a difference with room for it is found, wherever it is.

About half a layer, and what coarse chords take off a round recess (0.5 rad at 3.7 mm: 0.058 mm).
"""
SAME_MM = 1e-3
"""Largest distance of corners that are the same: single precision, or text of a few digits."""
LANDMARK_MM, LANDMARKS = 0.02, 4000
"""The same of the corners by which a mesh is laid over another, and how many of them."""
CORNER_RAD = 0.8
"""Least difference of a corner's angles from a whole turn: more than those of a round face's rim."""
MARGIN_MM = 0.137
"""By which the parts that are cut out of both reach beyond their cells: where no faces are."""
OUTSIDE_MM = 2e4
MOST_PIECES = 200
"""Differences of a kind whose volumes are worked out: of another pad's thousands only some are told."""
SCALE = 5e-4
"""Smallest relative difference in size that is one of scale."""


class Pose(NamedTuple):
    """Pose of a mesh: `rows` (3, 3) and `shift_mm` take it to where it was planned, `share` of its corners fit."""

    rows: np.ndarray
    shift_mm: np.ndarray
    share: float
    turned_deg: float = 0.0
    flipped: bool = False
    mirrored: bool = False
    scale: float = 1.0

    def laid(self, mesh: Mesh) -> Mesh:
        """The mesh where it was planned, its triangles outwards as before."""
        if not self.shift_mm.any() and np.array_equal(self.rows, np.eye(3)):
            return mesh
        triangles = mesh.triangles[:, ::-1] if np.linalg.det(self.rows) < 0 else mesh.triangles
        return Mesh(mesh.vertices_mm @ self.rows.T + self.shift_mm, triangles)

    def findings(self) -> Iterator[Finding]:
        """Describe the pose in one sentence: as an error where a print would be another."""
        x, y, z = (number(round(float(-v), 4)) for v in self.shift_mm)
        turned = f"turned by {number(round(self.turned_deg, 3))}° about z" if self.turned_deg else ""
        said = [turned] if turned else []
        if self.mirrored:
            said.append("mirrored: export it again without mirroring")
        if self.flipped:
            said.append("upside down: turn it over, bosses up")
        if self.scale != 1:
            said.append(f"{number(1 / self.scale)} times as large as planned: scale it by {number(self.scale)}")
        if said[bool(turned) :]:
            yield Finding("error", "built.pose", "mesh", f"it is {' and '.join(said)}; all else is compared as planned")
        elif turned:
            told = "its coils' rows and columns turn with it; nothing else is to be done"
            yield Finding("note", "built.pose", "mesh", f"it is {turned}, {told}")
        elif (np.abs(self.shift_mm) > SAME_MM).any():
            told = "slicers place it anew anyway; nothing is to be done"
            yield Finding("note", "built.pose", "mesh", f"it was moved by ({x}, {y}, {z}) mm, {told}")


class Cells(NamedTuple):
    """The lattice in which differences are looked for: edges of columns and rows in mm, and what is in each cell."""

    x_mm: np.ndarray
    y_mm: np.ndarray
    names: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, plan: Plan) -> "Cells":
        """The sub-cells of a pad, and around them its border."""
        places = np.pad(taxel_places(plan), 1, constant_values=-2)
        names = [*(f"taxel {taxel.id}" for taxel in plan.taxels), "border", "frame"]
        rows, columns = np.array(places.shape) - 1
        half_x, half_y = plan.spec.pad.width_mm / 2, plan.spec.pad.depth_mm / 2
        return cls(
            np.linspace(-half_x, half_x, columns),
            np.linspace(-half_y, half_y, rows),
            tuple(tuple(names[k] for k in row) for row in places.tolist()),
        )

    def within(self, corners_mm: np.ndarray) -> np.ndarray:
        """Mark the cells (rows + 2, columns + 2) that triangles (n, 3, 3) reach into."""
        low, high = corners_mm[..., :2].min(1) - MARGIN_MM / 2, corners_mm[..., :2].max(1) + MARGIN_MM / 2
        x0, x1 = np.searchsorted(self.x_mm, low[:, 0]), np.searchsorted(self.x_mm, high[:, 0])
        y0, y1 = np.searchsorted(self.y_mm, low[:, 1]), np.searchsorted(self.y_mm, high[:, 1])
        # Each adds one over a rectangle: at its four corners, then summed up both ways.
        count = np.zeros((len(self.y_mm) + 2, len(self.x_mm) + 2), np.int64)
        for row, column, step in ((y0, x0, 1), (y1 + 1, x0, -1), (y0, x1 + 1, -1), (y1 + 1, x1 + 1, 1)):
            np.add.at(count, (row, column), step)
        reached: np.ndarray = count.cumsum(0).cumsum(1)[:-1, :-1] > 0
        return reached

    def room(self, reached: np.ndarray) -> Any:
        """The space over and under the cells."""
        import manifold3d

        x, y = (np.concatenate([[-OUTSIDE_MM], edges, [OUTSIDE_MM]]) for edges in (self.x_mm, self.y_mm))
        boxes = []
        for row, column in np.argwhere(reached).tolist():
            low = np.array([x[column] - MARGIN_MM, y[row] - MARGIN_MM, -OUTSIDE_MM])
            high = np.array([x[column + 1] + MARGIN_MM, y[row + 1] + MARGIN_MM, OUTSIDE_MM])
            boxes.append(manifold3d.Manifold.cube(tuple(high - low)).translate(tuple(low)))
        return manifold3d.Manifold.batch_boolean(boxes, manifold3d.OpType.Add)

    def named(self, x_mm: float, y_mm: float) -> str:
        """Name the part at a place."""
        return self.names[np.searchsorted(self.y_mm, y_mm)][np.searchsorted(self.x_mm, x_mm)]


class Difference(NamedTuple):
    """A difference that is `more` than planned, or missing: its volume, its middle and its extent, in mm."""

    more: bool
    volume_mm3: float
    place_mm: tuple[float, float, float]
    extent_mm: tuple[float, float, float]


def pose_of(mesh: Mesh, planned: Mesh) -> Pose:
    """Find the pose of the mesh against the one that was planned: as it is, or moved, turned, mirrored and scaled.

    Only a mesh that is not where it was planned is tried otherwise: by its outline, whose longest side is one of the
    border's, and by its box. Of all ways that of which most corners of the planned mesh are in it is taken.
    """
    from scipy.spatial import ConvexHull, QhullError, cKDTree

    marks, tree = _landmarks(planned), cKDTree(mesh.vertices_mm)

    def share(rows: np.ndarray, shift: np.ndarray) -> float:
        near = tree.query((marks - shift) @ np.linalg.inv(rows).T, distance_upper_bound=LANDMARK_MM)[0]
        return float(np.isfinite(near).mean())

    best = Pose(np.eye(3), np.zeros(3), share(np.eye(3), np.zeros(3)))
    size = np.ptp(mesh.vertices_mm, axis=0)
    if best.share > 0.999 or not size.all():
        return best
    try:
        outline = mesh.vertices_mm[ConvexHull(mesh.vertices_mm[:, :2]).vertices]
    except QhullError:  # it stands on a line
        return best
    sides = np.roll(outline, -1, axis=0) - outline
    along = sides[np.hypot(*sides[:, :2].T).argmax()]
    ends = np.concatenate([outline, mesh.vertices_mm[mesh.vertices_mm[:, 2].argsort()[[0, -1]]]])
    low, high = planned.vertices_mm.min(0), planned.vertices_mm.max(0)
    for quarter, flipped, mirrored in product(range(4), (False, True), (False, True)):
        angle = quarter * np.pi / 2 - float(np.arctan2(along[1], along[0]))
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        rows = turn @ np.diag([-1.0 if mirrored else 1.0, -1.0 if flipped else 1.0, -1.0 if flipped else 1.0])
        there = ends @ rows.T
        ratios = (high - low) / np.maximum(np.ptp(there, axis=0), 1e-9)
        scale = float(np.median(ratios))
        if abs(scale - 1) < SCALE or np.ptp(ratios) > SCALE * scale:
            scale = 1.0
        there, rows = there * scale, rows * scale
        shift = (low + high - there.min(0) - there.max(0)) / 2
        shift[2] = low[2] - there[:, 2].min()
        found = share(rows, shift)
        if found > best.share + 1e-9:
            turned = (np.degrees(-angle) + 180) % 360 - 180
            if abs(turned) < 1e-3:
                turned = 0.0
            best = Pose(rows, shift, found, turned, flipped, mirrored, scale)
    return best


def _landmarks(mesh: Mesh) -> np.ndarray:
    """Corners (n, 3) where three flat faces meet: those stay, however round faces are cut into triangles."""
    corners = mesh.corners_mm
    sides = np.roll(corners, -1, axis=1) - corners
    sides /= np.maximum(np.linalg.norm(sides, axis=2, keepdims=True), 1e-30)
    angles = np.arccos(np.clip(-np.einsum("tij,tij->ti", sides, np.roll(sides, 1, axis=1)), -1, 1))
    whole = np.bincount(mesh.triangles.ravel(), angles.ravel(), len(mesh.vertices_mm))
    marks = mesh.vertices_mm[np.abs(whole - 2 * np.pi) > CORNER_RAD]
    return np.asarray(marks[:: len(marks) // LANDMARKS + 1])


def loose_triangles(mesh: Mesh, planned: Mesh) -> tuple[np.ndarray, np.ndarray, Mesh]:
    """Triangles of each that the other has not, as masks, and the mesh with its corners put on those planned."""
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(planned.vertices_mm).query(mesh.vertices_mm, distance_upper_bound=SAME_MM)
    count = len(planned.vertices_mm)
    known = nearest < count
    vertices = mesh.vertices_mm.copy()
    vertices[known] = planned.vertices_mm[nearest[known]]
    keys, planned_keys = (_keys(triangles, count) for triangles in (nearest[mesh.triangles], planned.triangles))
    loose = ~known[mesh.triangles].all(1) | ~np.isin(keys, planned_keys)
    return loose, ~np.isin(planned_keys, keys), Mesh(vertices, mesh.triangles)


def _keys(triangles: np.ndarray, count: int) -> np.ndarray:
    """One number for each triangle, wherever it begins (of up to two million corners)."""
    first = triangles.argmin(1)[:, None]
    a, b, c = np.take_along_axis(triangles, (first + np.arange(3)) % 3, 1).T
    return np.asarray((a * (count + 1) + b) * (count + 1) + c)


def differences(one: Any, other: Any) -> list[Difference]:
    """Differences of the manifold `one` from the `other`, largest first; see `SMALLEST_MM`."""
    found = []
    for more, part in ((True, one - other), (False, other - one)):
        core = part
        # What is left are places of a cube's lowest corner: all eight corners lie in the part.
        for step in np.eye(3) * SMALLEST_MM:
            core = core ^ core.translate(tuple(-step))
        for piece in sorted(core.decompose(), key=lambda each: -each.volume())[:MOST_PIECES]:
            bounds = np.array(piece.bounding_box())
            low, high = bounds[:3], bounds[3:] + SMALLEST_MM
            box = type(part).cube(tuple(high - low)).translate(tuple(low))
            middle, extent = tuple(((low + high) / 2).tolist()), tuple((high - low).tolist())
            found.append(Difference(more, float((part ^ box).volume()), middle, extent))
    return sorted(found, key=lambda each: -each.volume_mm3)
