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
OVERSAMPLE = 2


class View(NamedTuple):
    """The direction that a picture is taken from: degrees around z from −y, and degrees above the horizon."""

    azimuth_deg: float = -35.0
    elevation_deg: float = 38.0


def picture_png(
    parts: "list[tuple[Mesh, tuple[float, float, float]]]", size_px: tuple[int, int], view: View | None = None
) -> bytes:
    """Draw meshes with their colours (red, green, blue in 0 … 1) as a PNG of this size, in parallel projection."""
    from PIL import Image

    width, height = (OVERSAMPLE * n for n in size_px)
    azimuth, elevation = np.radians(view or View())
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0])
    toward = np.array([np.sin(azimuth) * np.cos(elevation), -np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    axes = np.stack([right, np.cross(toward, right), toward])
    seen = [mesh.vertices_mm @ axes.T for mesh, _ in parts]
    low, high = np.min([each.min(0) for each in seen], 0), np.max([each.max(0) for each in seen], 0)
    scale = 0.94 * min(width / (high[0] - low[0]), height / (high[1] - low[1]))
    shift = np.array([width, height, 0]) / 2 - (low + high) / 2 * (scale, -scale, scale)
    image, nearest = np.tile(BACKGROUND, (width * height, 1)), np.full(width * height, -np.inf)
    for (mesh, colour), places in zip(parts, seen, strict=True):
        for some in np.array_split(mesh.triangles, len(mesh.triangles) // AT_ONCE + 1):
            corners = places[some]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            facing = normal[:, 2] > 1e-9
            normal = normal[facing] / np.linalg.norm(normal[facing], axis=1, keepdims=True)
            lit = [share * np.clip(normal @ (light / np.linalg.norm(light)), 0, 1) for light, share in LIGHTS]
            shades = np.clip(np.array(colour) * (AMBIENT + sum(lit))[:, None], 0, 1)
            pixel, owner, depth = _covered(corners[facing] * (scale, -scale, scale) + shift, width, height)
            # Assigned in the order of depth, the nearest triangle comes last and stays.
            order = np.argsort(depth, kind="stable")
            order = order[depth[order] >= nearest[pixel[order]]]
            nearest[pixel[order]], image[pixel[order]] = depth[order], shades[owner[order]]
    image = image.reshape(height, width, 3)
    steps = range(OVERSAMPLE)
    # A mean over two axes would take ten times as long.
    image = np.add.reduce([image[i::OVERSAMPLE, j::OVERSAMPLE] for i in steps for j in steps]) / OVERSAMPLE**2
    result = io.BytesIO()
    Image.fromarray((image * 255 + 0.5).astype(np.uint8)).save(result, "PNG", optimize=False)
    return result.getvalue()


def _covered(corners: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pixels whose centres triangles (n, 3, 3) cover, each one's triangle, and its depth there."""
    low, high = corners[..., 1].min(1), corners[..., 1].max(1)
    owner, row = _runs(np.maximum(np.ceil(low - 0.5), 0), np.minimum(np.floor(high - 0.5), height - 1))
    # The corners' weights and the depth are linear in the place: slopes to the right and down, and offsets.
    depth = corners[..., 2:].copy()
    planes = np.linalg.inv(np.concatenate([corners[..., :2], np.ones_like(depth)], axis=2))
    along, down, offset = np.moveaxis(np.concatenate([planes, planes @ depth], axis=2)[owner], 1, 0)
    offset += down * (row + 0.5)[:, None]
    # Inside no weight is negative.
    with np.errstate(divide="ignore", invalid="ignore"):
        edges = -offset[:, :3] / along[:, :3]
    left = np.where(along[:, :3] > 0, edges, 0.0).max(1)
    right = np.where(along[:, :3] < 0, edges, width).min(1)
    line, column = _runs(np.ceil(left - 0.5), np.minimum(np.floor(right - 0.5), width - 1))
    return row[line] * width + column, owner[line], offset[line, 3] + along[line, 3] * (column + 0.5)


def _runs(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Expand runs ``first … last`` into single steps: the index of each step's run, and its place."""
    count = np.maximum(last - first + 1, 0).astype(np.int64)
    index = np.repeat(np.arange(len(count)), count)
    start = np.cumsum(count) - count
    return index, first[index].astype(np.int64) + np.arange(len(index)) - start[index]
