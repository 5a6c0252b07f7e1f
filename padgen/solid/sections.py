"""Walls, gaps and spans of a part, from its horizontal cross-sections.

A cross-section is shrunk by r and grown again by r, with square corners. Whatever is lost is narrower than 2 r: a thin
wall where this is done to the material, a narrow gap where it is done to the empty space.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from padgen.solid.mesh import Mesh

__all__ = [
    "Narrow",
    "Section",
    "narrow_gaps",
    "narrow_walls",
    "sections",
    "smallest",
    "thin_skins",
    "unsupported_spans",
]

LEVELS, MOST_HEIGHTS = 16, 100
"""Most cross-sections of a part, and most heights of its horizontal faces, that are examined."""
STEP_MM = 1e-4
AREA_MM2 = 1e-6
ROOM_MM = 5.0
SPLINTER_SHARE = 0.05


class Section(NamedTuple):
    """A horizontal cross-section: the height `z_mm` of the cut and its manifold3d cross-section."""

    z_mm: float
    shape: Any


class Narrow(NamedTuple):
    """A place that breaks a limit: its middle in mm, and its area in mm²."""

    x_mm: float
    y_mm: float
    z_mm: float
    area_mm2: float


def sections(solid: Any, mesh: Mesh) -> list[Section]:
    """Cut once between any two neighbouring heights of the vertices, at most `LEVELS` times."""
    heights = np.unique(np.round(mesh.vertices_mm[:, 2] / STEP_MM) * STEP_MM)
    if len(heights) > LEVELS + 1:
        heights = np.quantile(heights, np.linspace(0, 1, LEVELS + 1))
    cuts = (Section(float(z), solid.slice(float(z))) for z in (heights[1:] + heights[:-1]) / 2)
    # A cut between two bodies that lie above each other is empty.
    return [cut for cut in cuts if not cut.shape.is_empty()]


def narrow_walls(section: Section, limit_mm: float) -> list[Narrow]:
    """Return the places where the material is narrower than `limit_mm`."""
    return _narrow(section.shape, section.z_mm, limit_mm)


def narrow_gaps(section: Section, limit_mm: float) -> list[Narrow]:
    """Return the places where the empty space within or between parts is narrower than `limit_mm`."""
    return _narrow(section.shape, section.z_mm, limit_mm, empty=True)


def smallest(section: Section, gaps: bool, bound_mm: float) -> float:
    """Return the width in mm of the narrowest wall, or gap, or `bound_mm` where none is narrower than that."""
    return _bisect(lambda width: bool(_narrow(section.shape, section.z_mm, width, gaps)), bound_mm)


def unsupported_spans(solid: Any, mesh: Mesh, bound_mm: float) -> tuple[float, Narrow | None]:
    """Return the longest span in mm that is printed over air, up to `bound_mm`, and its place.

    A horizontal face that looks down is bridged from the material beneath its rim. Its span is twice the largest
    distance from that material. The search stops at `bound_mm`.
    """
    worst, where = 0.0, None
    bed = float(mesh.vertices_mm[:, 2].min())
    for z in (height for height in _flat_heights_mm(mesh, up=False) if height > bed + 2 * STEP_MM):
        below = solid.slice(z - STEP_MM)
        hanging = solid.slice(z + STEP_MM) - below

        left = partial(_beyond, hanging, below)
        if left(worst + STEP_MM).area() > AREA_MM2:
            worst = _bisect(partial(_spanned, left), bound_mm)
            place = left(0.9 * worst)
            where = _where(place if place.area() else hanging, z)
    return worst, where


def thin_skins(solid: Any, mesh: Mesh, limit_mm: float) -> list[Narrow]:
    """Return the parts of horizontal faces that look up and have less than `limit_mm` of material beneath them."""
    found = []
    for z in _flat_heights_mm(mesh, up=True):
        surface = solid.slice(z - STEP_MM) - solid.slice(z + STEP_MM)
        thin = surface - solid.slice(z - limit_mm + 2 * STEP_MM)
        found += [_where(piece, z) for piece in thin.decompose() if piece.area() > limit_mm**2]
    return found


def _beyond(hanging: Any, below: Any, span: float) -> Any:
    """Return the part of `hanging` that is farther than half of `span` (mm) from the material `below`."""
    return hanging - below.offset(span / 2, _join("Round"), 2.0, 64)


def _spanned(left: Callable[[float], Any], span: float) -> bool:
    return bool(left(span).area() <= AREA_MM2)


def _flat_heights_mm(mesh: Mesh, up: bool) -> np.ndarray:
    """Return the heights of the horizontal faces that look up, or down, at most `MOST_HEIGHTS` of them."""
    corners = mesh.corners_mm
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = (np.ptp(corners[..., 2], axis=1) < STEP_MM) & ((normal[:, 2] > 0) == up)
    heights = np.unique(np.round(corners[flat][:, 0, 2] / STEP_MM) * STEP_MM)
    chosen = np.linspace(0, len(heights) - 1, MOST_HEIGHTS).round().astype(int)
    return np.asarray(heights[chosen] if len(heights) > MOST_HEIGHTS else heights)


def _narrow(shape: Any, z_mm: float, limit_mm: float, empty: bool = False) -> list[Narrow]:
    """Return the places where the material (or the `empty` space around and within it) is narrower than `limit_mm`."""
    # Square corners survive; acute ones lose a splinter, which is no wall.
    splinter, half = SPLINTER_SHARE * (limit_mm / 2) ** 2, limit_mm / 2
    filled = _empty(shape) if empty else shape
    lost = filled - filled.offset(-half, _join("Miter")).offset(half * 1.001, _join("Miter"))
    if lost.area() < splinter:
        return []
    return [_where(piece, z_mm) for piece in lost.decompose() if piece.area() > splinter]


def _where(shape: Any, z_mm: float) -> Narrow:
    x0, y0, x1, y1 = shape.bounds()
    return Narrow((x0 + x1) / 2, (y0 + y1) / 2, z_mm, float(shape.area()))


def _empty(shape: Any) -> Any:
    """Return the empty space around and within a cross-section."""
    x0, y0, x1, y1 = shape.bounds()
    room = type(shape).square((x1 - x0 + 2 * ROOM_MM, y1 - y0 + 2 * ROOM_MM))
    return room.translate((x0 - ROOM_MM, y0 - ROOM_MM)) - shape


def _bisect(narrower: Callable[[float], bool], bound_mm: float) -> float:
    """Return the width at which `narrower` turns from false to true, within 0.1 % of `bound_mm`, or `bound_mm`."""
    if not narrower(bound_mm):
        return bound_mm
    low, high = 0.0, bound_mm
    for _ in range(9):
        middle = (low + high) / 2
        low, high = (low, middle) if narrower(middle) else (middle, high)
    return (low + high) / 2


def _join(name: str) -> Any:
    import manifold3d

    return getattr(manifold3d.JoinType, name)
