"""The solids of a pad's tiles for Netgen: taxels from their STEP files, the rest from the plan's dimensions.

A tile lies in its own axes, in mm; its side faces that meet other tiles are named ``south``, ``east``,
``north`` and ``west``, faces that the clamping holds ``held``.
"""

from collections.abc import Iterable
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.planner.plan import Channel, Plan
from padgen.planner.tile import outline
from padgen.verify.elastic_mesh import PRINTED, taxel_shape
from padgen.verify.engines import engine

__all__ = [
    "CLAMPINGS",
    "HELD",
    "TURNS",
    "Box",
    "TileSolid",
    "border_corner",
    "border_side",
    "solid_cell",
    "taxel_box",
    "taxel_tile",
    "washer_volume_mm3",
]

CLAMPINGS = ("edges", "bottom", "corners", "free")
"""Held are: outer side faces of the border; the frame's underside; the walls of the corner holes (the
whole corners where there are no holes); nothing."""
HELD = "held"
TURNS = {"+x": 0, "+y": 1, "-x": 2, "-y": 3}
"""Quarter turns from a taxel's own axes to the cell's."""
ALL_SIDES = ("south", "east", "north", "west")
NEAR_MM = 1e-5
SAME_MM = 1e-3


class Box(NamedTuple):
    """A tile's outline in mm, from z = 0 up to the frame's thickness."""

    x0: float
    x1: float
    y0: float
    y1: float
    height: float


class TileSolid(NamedTuple):
    """A tile's netgen `shape` in mm, its outline, and the `sides` that meet other tiles.

    `held_sides` are outer sides that the clamping holds; `held_below` tells that the frame's underside is held.
    `axis_x_mm` is where the washer's axis stands, on y = 0.
    """

    shape: Any
    box: Box
    sides: tuple[str, ...]
    held_sides: tuple[str, ...] = ()
    held_below: bool = False
    axis_x_mm: float = 0.0


def taxel_tile(plan: Plan, channel: Channel, step: Path, clamping: str) -> TileSolid:
    """The tile of a channel: taxel, washer and the frame of its sub-cell, from its STEP file.

    Raises
    ------
    SolverError
        The file cannot be read or is not this channel's taxel.
    """
    shape = taxel_shape(step, washer_volume_mm3(plan))
    box = taxel_box(plan, channel)
    _must_match(shape, plan, box, f"channel {channel.index}")
    below = clamping == "bottom"
    if below:
        shape = _frame_apart(shape, plan, channel, box)
    _name_sides(shape, box, ALL_SIDES)
    if below:
        _hold(face for face in _underside(shape) if not _within(face, _window(plan, channel, box.height)))
    return TileSolid(shape, box, ALL_SIDES, (), below, float(plan.arrangement(channel).washer_x_mm))


def washer_volume_mm3(plan: Plan) -> float:
    """Volume of one washer."""
    washer = plan.spec.washer
    return pi / 4 * (washer.outer_diameter_mm**2 - washer.inner_diameter_mm**2) * washer.thickness_mm


def taxel_box(plan: Plan, channel: Channel) -> Box:
    """The sub-cell of `channel` in the taxel's own axes."""
    return Box(*outline(plan, channel), plan.spec.pad.frame_thickness_mm)


def solid_cell(plan: Plan, clamping: str) -> TileSolid:
    """A sub-cell without a taxel: solid."""
    return _boxed(plan, plan.cell.width_mm, plan.cell.depth_mm, ALL_SIDES, (), clamping)


def border_side(plan: Plan, along_x: bool, clamping: str) -> TileSolid:
    """The piece of the border along one sub-cell: of the south border (`along_x`) or of the west border."""
    wide = plan.spec.pad.border_mm
    outer = "south" if along_x else "west"
    sides = tuple(side for side in ALL_SIDES if side != outer)
    held = (outer,) if clamping == "edges" else ()
    size = (plan.cell.width_mm, wide) if along_x else (wide, plan.cell.depth_mm)
    return _boxed(plan, *size, sides, held, clamping)


def border_corner(plan: Plan, clamping: str) -> TileSolid:
    """The south-west corner of the border: rounded outside, with its hole."""
    occ = engine("netgen.occ")
    pad = plan.spec.pad
    wide, height, hole = pad.border_mm, pad.frame_thickness_mm, pad.hole_diameter_mm
    if clamping == "corners" and not hole:
        return _boxed(plan, wide, wide, ("east", "north"), ALL_SIDES, clamping)
    block = _block(Box(0, wide, 0, wide, height))
    shape = block.MakeFillet([min(block.edges, key=lambda edge: edge.center.x + edge.center.y)], wide / 2)
    if hole:
        shape = shape - occ.Cylinder(occ.Pnt(wide / 2, wide / 2, -1), occ.Z, hole / 2, height + 2)
    shape.solids[0].name = PRINTED
    box = Box(0, wide, 0, wide, height)
    _name_sides(shape, box, ("east", "north"))
    if clamping == "bottom":
        _hold(_underside(shape))
    walls = [face for face in shape.faces if face.name not in ALL_SIDES and not _flat_at(face)]
    bore = Box((wide - hole) / 2, (wide + hole) / 2, (wide - hole) / 2, (wide + hole) / 2, height)
    if clamping in ("edges", "corners"):
        _hold(face for face in walls if _within(face, bore) == (clamping == "corners"))
    held = ("south", "west") if clamping == "edges" else ()
    return TileSolid(shape, box, ("east", "north"), held, clamping == "bottom")


def _boxed(
    plan: Plan, wide: float, deep: float, sides: tuple[str, ...], held: tuple[str, ...], clamping: str
) -> TileSolid:
    box = Box(0.0, wide, 0.0, deep, plan.spec.pad.frame_thickness_mm)
    shape = _block(box)
    shape.solids[0].name = PRINTED
    _name_sides(shape, box, sides)
    _name_sides(shape, box, held, HELD)
    if clamping == "bottom":
        _hold(_underside(shape))
    return TileSolid(shape, box, sides, held, clamping == "bottom")


def _block(box: Box) -> Any:
    occ = engine("netgen.occ")
    return occ.Box(occ.Pnt(box.x0, box.y0, 0), occ.Pnt(box.x1, box.y1, box.height))


def _bounds(face: Any) -> np.ndarray:
    """Corners of a face's box, (2, 3)."""
    return np.array([(corner.x, corner.y, corner.z) for corner in face.bounding_box])


def _name_sides(shape: Any, box: Box, sides: Iterable[str], name: str = "") -> None:
    planes = {"west": (0, box.x0), "east": (0, box.x1), "south": (1, box.y0), "north": (1, box.y1)}
    for side in sides:
        axis, at = planes[side]
        for face in shape.faces:
            if np.abs(_bounds(face)[:, axis] - at).max() < NEAR_MM:
                face.name = name or side


def _hold(faces: Iterable[Any]) -> None:
    for face in faces:
        face.name = HELD


def _underside(shape: Any) -> list[Any]:
    return [face for face in shape.faces if np.abs(_bounds(face)[:, 2]).max() < NEAR_MM]


def _flat_at(face: Any) -> bool:
    """Whether a face is horizontal."""
    return bool(np.ptp(_bounds(face)[:, 2]) < NEAR_MM)


def _within(face: Any, box: Box) -> bool:
    low, high = _bounds(face)
    inside = low[0] > box.x0 - NEAR_MM and high[0] < box.x1 + NEAR_MM
    return bool(inside and low[1] > box.y0 - NEAR_MM and high[1] < box.y1 + NEAR_MM)


def _window(plan: Plan, channel: Channel, height: float) -> Box:
    length, width = (float(v) for v in plan.arrangement(channel).window_mm)
    return Box(0.0, length, -width / 2, width / 2, height)


def _frame_apart(shape: Any, plan: Plan, channel: Channel, box: Box) -> Any:
    """The same shape with the frame a solid of its own, so that its underside is faces of their own."""
    occ = engine("netgen.occ")
    ring = _block(box) - _block(_window(plan, channel, box.height))
    printed, washer = sorted(shape.solids, key=lambda solid: solid.name != PRINTED)
    parts = [printed * ring, printed - ring]
    for part in parts:
        for solid in part.solids:
            solid.name = PRINTED
    return occ.Glue([*parts, washer])


def _must_match(shape: Any, plan: Plan, box: Box, where: str) -> None:
    """The printed solid must fill the sub-cell and reach up to the boss."""
    printed = next(solid for solid in shape.solids if solid.name == PRINTED)
    top = max(plan.plate.boss_top_mm, box.height)
    planned = np.array([(box.x0, box.y0, 0.0), (box.x1, box.y1, top)])
    found = _bounds(printed)
    worst = np.unravel_index(np.abs(found - planned).argmax(), planned.shape)
    if np.abs(found - planned).max() > SAME_MM:
        raise SolverError(
            f"the STEP file's solid ends at {number(float(found[worst]))} mm where the plan has"
            f" {number(float(planned[worst]))} mm: build the plan's own taxels",
            where,
        )
