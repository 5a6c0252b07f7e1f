"""Pictures of meshes, drawn with a depth buffer in numpy: they need no window and no graphics driver."""

import io
from typing import NamedTuple

import numpy as np

from padgen.solid.mesh import AT_ONCE, Mesh

__all__ = ["View", "picture_png"]

BACKGROUND = np.array([1.0, 1.0, 1.0])
# In the viewer's axes: right, up, towards. Key light from the upper left, fill from the right.
LIGHTS = ((np.array([-0.45, 0.75, 0.5]), 0.62), (np.array([0.7, -0.1, 0.7]), 0.28))
AMBIENT = 0.24


class View(NamedTuple):
    """The direction that a picture is taken from: degrees around z from −y, and degrees above the horizon."""

    azimuth_deg: float = -35.0
    elevation_deg: float = 38.0


def picture_png(
    parts: "list[tuple[Mesh, tuple[float, float, float]]]", size_px: tuple[int, int], view: View | None = None
) -> bytes:
    """Draw meshes with their colours (red, green, blue in 0 … 1) as a PNG of this size, in parallel projection."""
    from PIL import Image

    oversample = 2
    width, height = (oversample * n for n in size_px)
    axes = _camera(view or View())
    scale, shift = _fit(np.concatenate([mesh.vertices_mm @ axes.T for mesh, _ in parts]), width, height)
    image, nearest = np.tile(BACKGROUND, (width * height, 1)), np.full(width * height, -np.inf)
    for mesh, colour in parts:
        for k in range(0, len(mesh.triangles), AT_ONCE):
            corners = mesh.vertices_mm[mesh.triangles[k : k + AT_ONCE]]
            across = corners[:, 1:] - corners[:, :1]
            normal = np.cross(across[:, 0], across[:, 1])
            facing = normal @ axes[2] > 0
            normal = normal[facing] / np.maximum(np.linalg.norm(normal[facing], axis=1, keepdims=True), 1e-30)
            shade = AMBIENT + sum(
                share * np.clip(normal @ axes.T @ (light / np.linalg.norm(light)), 0, 1) for light, share in LIGHTS
            )
            pixels, owner, depth = _visible(corners[facing] @ axes.T * scale + shift, width, height)
            over = depth >= nearest[pixels]
            nearest[pixels[over]] = depth[over]
            image[pixels[over]] = np.clip(np.array(colour) * shade[:, None], 0, 1)[owner[over]]
    image = image.reshape(height, width, 3)
    steps = range(oversample)
    # A mean over two axes would take ten times as long.
    image = np.add.reduce([image[i::oversample, j::oversample] for i in steps for j in steps]) / oversample**2
    result = io.BytesIO()
    Image.fromarray((image * 255 + 0.5).astype(np.uint8)).save(result, "PNG", optimize=False)
    return result.getvalue()


def _camera(view: View) -> np.ndarray:
    """Return unit vectors to the right, up and towards the viewer, as rows (3, 3)."""
    a, e = np.radians(view.azimuth_deg), np.radians(view.elevation_deg)
    right = np.array([np.cos(a), np.sin(a), 0])
    toward = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    return np.stack([right, np.cross(toward, right), toward])


def _fit(seen: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Return factors (3,) and shifts (3,) that turn right, up and depth of points (n, 3) in mm into pixels."""
    low, high = (np.array([of(seen[:, 0]), of(seen[:, 1])]) for of in (np.min, np.max))
    scale = 0.94 * min(width / (high[0] - low[0]), height / (high[1] - low[1]))
    centre = (low + high) / 2 * scale
    return scale * np.array([1.0, -1.0, 1.0]), np.array([width / 2 - centre[0], height / 2 + centre[1], 0.0])


def _visible(screen: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pixels that any triangle covers, the index of the nearest triangle, and its depth, by scan lines."""
    x, y, z = np.moveaxis(screen, -1, 0)
    # One row per triangle and scan line through pixel centres.
    first = np.clip(np.ceil(y.min(1) - 0.5), 0, height).astype(np.int64)
    last = np.clip(np.floor(y.max(1) - 0.5), -1, height - 1).astype(np.int64)
    rows, line = _runs(first, last)
    centre = (first[rows] + line) + 0.5
    left, right = np.full(len(rows), np.inf), np.full(len(rows), -np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        y0, y1 = y[rows, i], y[rows, j]
        rise = np.where(y1 == y0, 1.0, y1 - y0)
        share = (centre - y0) / rise
        hit = (y1 != y0) & (share >= 0) & (share <= 1)
        at = x[rows, i] + share * (x[rows, j] - x[rows, i])
        left, right = np.where(hit, np.minimum(left, at), left), np.where(hit, np.maximum(right, at), right)
    empty = left > right
    left, right = np.where(empty, 0, left), np.where(empty, -1, right)
    start = np.clip(np.ceil(left - 0.5), 0, width).astype(np.int64)
    stop = np.clip(np.floor(right - 0.5), -1, width - 1).astype(np.int64)
    spans, step = _runs(start, stop)
    owner = rows[spans]
    column, row = start[spans] + step, (first[rows] + line)[spans]
    depth = _depth_at(x, y, z, owner, column + 0.5, row + 0.5)
    pixel = row * width + column
    order = np.argsort(depth, kind="stable")
    # Assigned in the order of depth, the nearest triangle comes last and stays.
    seen = np.full(width * height, -1)
    seen[pixel[order]] = owner[order]
    covered = np.flatnonzero(seen >= 0)
    nearest = np.full(width * height, -np.inf)
    nearest[pixel[order]] = depth[order]
    return covered, seen[covered], nearest[covered]


def _runs(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Expand runs ``first … last`` into single steps: the index of each step's run, and its number within the run."""
    count = np.maximum(last - first + 1, 0)
    index = np.repeat(np.arange(len(count)), count)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)


def _depth_at(
    x: np.ndarray, y: np.ndarray, z: np.ndarray, owner: np.ndarray, column: np.ndarray, row: np.ndarray
) -> np.ndarray:
    """Return the depth of the planes of the triangles `owner` at pixel centres."""
    ax, ay = x[:, 1] - x[:, 0], y[:, 1] - y[:, 0]
    bx, by = x[:, 2] - x[:, 0], y[:, 2] - y[:, 0]
    za, zb = z[:, 1] - z[:, 0], z[:, 2] - z[:, 0]
    area = ax * by - ay * bx
    area = np.where(np.abs(area) < 1e-12, 1e-12, area)
    slope_x, slope_y = (za * by - zb * ay) / area, (zb * ax - za * bx) / area
    result: np.ndarray = z[owner, 0] + slope_x[owner] * (column - x[owner, 0]) + slope_y[owner] * (row - y[owner, 0])
    return result
