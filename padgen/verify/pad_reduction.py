"""A pad from its plan and the STEP files of its taxels: each distinct tile reduced once, all put together."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.core.units import G_PER_CM3, GPA, MG
from padgen.planner.plan import Plan
from padgen.verify.elastic_material import Elastic
from padgen.verify.elastic_mesh import PRINTED, WASHER
from padgen.verify.engines import engine
from padgen.verify.pad_assembly import Assembly, Key, PlacedTile, assembly
from padgen.verify.pad_interface import Degrees
from padgen.verify.pad_solids import (
    CLAMPINGS,
    TURNS,
    TileSolid,
    border_corner,
    border_side,
    solid_cell,
    taxel_tile,
    washer_volume_mm3,
)
from padgen.verify.pad_tiles import Elements, ReducedTile, reduced_tile, turned

__all__ = ["ReducedPad", "Resolution", "pad_materials", "reduced_pad"]

ANOTHER_TAXEL = 0.25
"""Relative difference of resonance that no error of the beam model explains."""
TAXEL, SOLID, SIDE_X, SIDE_Y, CORNER = "taxel", "solid", "side along x", "side along y", "corner"
WASHER_MODULUS_GPA, WASHER_POISSON = 200.0, 0.29
"""Steel: against the plastic a washer is rigid, whatever it is made of."""


class Resolution(NamedTuple):
    """How finely a pad is solved: polynomials between tiles, finite elements within them, and up to how many
    times the band's top a tile keeps its own modes."""

    degrees: Degrees = Degrees()
    elements: Elements = Elements()
    modes_up_to: float = 3.0


@dataclass(frozen=True)
class ReducedPad:
    """A pad of reduced tiles, held by `clamping`.

    `taxel_tiles` are the tiles of `plan.taxels`, in that order.
    """

    plan: Plan
    clamping: str
    assembly: Assembly
    taxel_tiles: tuple[PlacedTile, ...]

    @property
    def pulls(self) -> np.ndarray:
        """Loads (n, taxels) of unit vertical forces on the washers."""
        return np.array([self.assembly.pull(tile) for tile in self.taxel_tiles]).T

    def clamped_hz(self, channel: int) -> float:
        """Resonance of a channel's taxel in its sub-cell with all four sides held, by the same elements."""
        tile = next(t for t, taxel in zip(self.taxel_tiles, self.plan.taxels, strict=True) if taxel.channel == channel)
        return self.assembly.kinds[tile.key].working_hz


def pad_materials(plan: Plan) -> dict[str, Elastic]:
    """The plastic, and the washer with its glue, by name of solid."""
    spec = plan.spec
    plastic, washer = spec.material, spec.washer
    glue = spec.taxel.glue_mg * MG / (washer_volume_mm3(plan) * 1e-9)
    return {
        PRINTED: Elastic(
            plastic.youngs_modulus_gpa * GPA, plastic.poisson_ratio, plastic.density_g_per_cm3 * G_PER_CM3
        ),
        WASHER: Elastic(WASHER_MODULUS_GPA * GPA, WASHER_POISSON, washer.density_g_per_cm3 * G_PER_CM3 + glue),
    }


def reduced_pad(
    plan: Plan,
    steps: Mapping[int, Path],
    clamping: str = "corners",
    resolution: Resolution | None = None,
    before: ReducedPad | None = None,
) -> ReducedPad:
    """Reduce the distinct tiles of `plan` and assemble its pad; `steps` has the STEP file of each channel.

    `before`, a pad of the same plan and resolution, lends the tiles that another clamping leaves alike.

    Raises
    ------
    SolverError
        The clamping is unknown, a STEP file is missing or not of this plan, a tile cannot be meshed or
        solved.
    """
    if clamping not in CLAMPINGS:
        raise SolverError(f"must be one of {', '.join(CLAMPINGS)}, got {clamping}", "clamping")
    missing = sorted({taxel.channel for taxel in plan.taxels} - set(steps))
    if missing:
        raise SolverError(
            f"has no STEP file, one is needed for each of {len(plan.channels)} channels", f"channel {missing[0]}"
        )
    engine("ngsolve").SetNumThreads(1)
    resolution = resolution or Resolution()
    keys = _lattice(plan)
    known = _lent(before, clamping)
    for kind, channel in sorted({key[:2] for row in keys for key in row}):
        if (kind, channel, 0) not in known:
            known[kind, channel, 0] = _reduce(plan, steps, clamping, resolution, kind, channel)
    placed = {key for row in keys for key in row}
    kinds = {key: turned(known[key[0], key[1], 0], key[2]) for key in placed}
    pad = assembly(known | kinds, keys)
    rows, columns = _places(plan)
    at = {(tile.row, tile.column): tile for tile in pad.tiles}
    return ReducedPad(plan, clamping, pad, tuple(at[r + 1, c + 1] for r, c in zip(rows, columns, strict=True)))


def _lent(before: ReducedPad | None, clamping: str) -> dict[Key, ReducedTile]:
    """Tiles within the border, where neither pad is held from below."""
    if before is None or "bottom" in (clamping, before.clamping):
        return {}
    return {key: kind for key, kind in before.assembly.kinds.items() if key[0] in (TAXEL, SOLID) and key[2] == 0}


def _reduce(
    plan: Plan, steps: Mapping[int, Path], clamping: str, resolution: Resolution, kind: str, channel: int
) -> ReducedTile:
    where = f"channel {channel}" if kind == TAXEL else f"the pad's {kind}"
    solid = _solid(plan, steps, clamping, kind, channel)
    highest = resolution.modes_up_to * plan.spec.band_hz[1]
    tile = reduced_tile(solid, pad_materials(plan), resolution.degrees, resolution.elements, highest, where)
    if kind == TAXEL:
        planned = plan.channels[channel].resonance_hz
        if not abs(tile.working_hz / planned - 1) < ANOTHER_TAXEL:
            raise SolverError(
                f"{steps[channel].name} resonates at {number(tile.working_hz)} Hz where the plan has"
                f" {number(planned)} Hz: it is another taxel's",
                where,
            )
    return tile


def _solid(plan: Plan, steps: Mapping[int, Path], clamping: str, kind: str, channel: int) -> TileSolid:
    if kind == TAXEL:
        return taxel_tile(plan, plan.channels[channel], steps[channel], clamping)
    if kind == SOLID:
        return solid_cell(plan, clamping)
    if kind == CORNER:
        return border_corner(plan, clamping)
    return border_side(plan, kind == SIDE_X, clamping)


def _places(plan: Plan) -> tuple[list[int], list[int]]:
    """Row and column of each taxel's sub-cell within the border."""
    cell, rows, columns = plan.cell, [], []
    for taxel in plan.taxels:
        x, y = (-v if taxel.turned else v for v in plan.channels[taxel.channel].site.centre_mm)
        columns.append(taxel.coil[1] * cell.columns + round(x / cell.width_mm + (cell.columns - 1) / 2))
        rows.append(taxel.coil[0] * cell.rows + round(y / cell.depth_mm + (cell.rows - 1) / 2))
    return rows, columns


def _lattice(plan: Plan) -> list[list[Key]]:
    """The key of each tile, rows of columns from the south-west, the border around."""
    cell, coils = plan.cell, plan.coils
    rows, columns = coils.rows * cell.rows, coils.columns * cell.columns
    keys = [[_border_key(row, column, rows, columns) for column in range(columns + 2)] for row in range(rows + 2)]
    for taxel, row, column in zip(plan.taxels, *_places(plan), strict=True):
        turns = TURNS[plan.channels[taxel.channel].site.along] + 2 * taxel.turned
        keys[row + 1][column + 1] = (TAXEL, taxel.channel, turns % 4)
    return keys


def _border_key(row: int, column: int, rows: int, columns: int) -> Key:
    """What lies at a place of the lattice before any taxel is put there."""
    south, north, west, east = row == 0, row == rows + 1, column == 0, column == columns + 1
    if (south or north) and (west or east):
        return CORNER, -1, {(True, True): 0, (True, False): 1, (False, False): 2, (False, True): 3}[south, west]
    if south or north:
        return SIDE_X, -1, 0 if south else 2
    if west or east:
        return SIDE_Y, -1, 0 if west else 2
    return SOLID, -1, 0
