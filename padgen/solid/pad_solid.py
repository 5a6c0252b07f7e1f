"""Assembly of a pad's mesh: copies of each distinct taxel with its frame on a grid, border around, seams welded.

A tile is a taxel with the frame of its sub-cell; all tiles are the same rectangle. Where two tiles meet, or a tile
meets the border, the faces are left out and their corner vertices shared. This unites solids that touch face to face,
in time linear in the number of tiles. The border is a plate with round corners and screw holes around the lattice.
Border and washers are prisms over arcs and lines, so they need no CAD kernel: manifold triangulates them, and a formula
gives the border's volume.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from math import acos, ceil, pi
from typing import NamedTuple

import numpy as np

from padgen.core.errors import GeometryError
from padgen.planner.layout import Outline, corner_groove, hexagon, outline, taxel_places, to_cell
from padgen.planner.plan import Channel, Plan
from padgen.solid.mesh import ANGLE_RAD, CHORD_MM, Mesh
from padgen.solid.taxel import Tile, cached_tile

__all__ = [
    "PadSample",
    "PadSolid",
    "SampleShifts",
    "Tile",
    "assembled_pad_mesh",
    "ballast_mesh",
    "border_mesh",
    "border_volume_mm3",
    "build_pad",
    "prism",
    "sampled",
    "tile_grid",
    "turned_grid",
    "washer_mesh",
]


def border_mesh(
    plan: Plan, shape: tuple[int, int], chord_mm: float, angle_rad: float, groove: Outline | None = None
) -> Mesh:
    """Return the triangles of the border around a grid of `shape` (rows, columns) tiles.

    Its inner edge has a vertex wherever two tiles meet. A `groove` (see `padgen.planner.layout`) is cut from its
    outside over the whole height.

    Raises
    ------
    GeometryError
        The outline cannot be triangulated: its holes meet its edges.
    """
    pad = plan.spec.pad
    rows, columns = shape
    half_x = pad.width_mm / 2
    half_y = pad.depth_mm / 2
    x = np.linspace(-half_x, half_x, columns + 1)
    y = np.linspace(-half_y, half_y, rows + 1)
    # The lattice's outline, anticlockwise from the lower left.
    inside = [(v, -half_y) for v in x] + [(half_x, v) for v in y[1:]]
    inside += [(v, half_y) for v in x[-2::-1]] + [(-half_x, v) for v in y[-2:0:-1]]
    rings = [_outside(plan, chord_mm, angle_rad, groove), np.array(inside[::-1])]
    if pad.hole_diameter_mm:
        off_x = (pad.width_mm + pad.border_mm) / 2
        off_y = (pad.depth_mm + pad.border_mm) / 2
        for centre in product((-off_x, off_x), (-off_y, off_y)):
            rings.append(_circle(centre, pad.hole_diameter_mm, chord_mm, angle_rad)[::-1])
    return prism(rings, 0.0, pad.frame_thickness_mm)


def washer_mesh(plan: Plan, channel: Channel, chord_mm: float = CHORD_MM) -> Mesh:
    """Return the mesh of the washer or magnet where it is glued, in mm in the taxel's axes."""
    washer = plan.spec.washer_or_magnet
    high = plan.spec.mover_top_mm
    centre = (float(plan.arrangement(channel).washer_x_mm), 0.0)
    rings = [_circle(centre, washer.outer_diameter_mm, chord_mm, ANGLE_RAD)]
    if washer.inner_diameter_mm:
        rings.append(_circle(centre, washer.inner_diameter_mm, chord_mm, ANGLE_RAD)[::-1])
    return prism(rings, high - washer.thickness_mm, high)


def ballast_mesh(plan: Plan, channel: Channel, chord_mm: float = CHORD_MM) -> Mesh | None:
    """Return the triangles of the ballast in its pocket, in mm in the taxel's own axes; None where there is none."""
    ballast = plan.spec.ballast
    if ballast is None:
        return None
    centre = (float(plan.arrangement(channel).washer_x_mm), 0.0)
    outside = _circle(centre, ballast.width_mm, chord_mm, ANGLE_RAD)
    if ballast.shape == "hexagon":
        outside = np.add(hexagon(ballast.width_mm), centre)
    rings = [outside]
    if ballast.inner_diameter_mm:
        rings.append(_circle(centre, ballast.inner_diameter_mm, chord_mm, ANGLE_RAD)[::-1])
    top = plan.spec.pocket_top_mm
    return prism(rings, top - ballast.height_mm, top)


def border_volume_mm3(plan: Plan, groove: Outline | None = None) -> float:
    """Return the exact volume of the border in mm³."""
    pad = plan.spec.pad
    cut = 0.0 if groove is None else (groove.x1 - groove.x0) * (groove.y1 - groove.y0) / 2
    whole = (pad.width_mm + 2 * pad.border_mm) * (pad.depth_mm + 2 * pad.border_mm)
    corners = (4 - pi) * (pad.border_mm / 2) ** 2
    holes = pi * pad.hole_diameter_mm**2
    return (whole - corners - pad.width_mm * pad.depth_mm - holes - cut) * pad.frame_thickness_mm


def _outside(plan: Plan, chord_mm: float, angle_rad: float, groove: Outline | None) -> np.ndarray:
    """Return the border's outer outline, with round corners and groove, as anticlockwise points (n, 2) in mm.

    A groove's outline lies half outside the border: the inner half is the notch.
    """
    pad = plan.spec.pad
    radius = pad.border_mm / 2
    x, y = (v / 2 + pad.border_mm - radius for v in (pad.width_mm, pad.depth_mm))
    centres = ((x, y), (-x, y), (-x, -y), (x, -y))
    parts = [_arc(c, radius, k * pi / 2, (k + 1) * pi / 2, chord_mm, angle_rad) for k, c in enumerate(centres)]
    if groove is not None:
        above = groove.y0 > 0
        edge = (groove.y0 + groove.y1) / 2
        within = groove.y0 if above else groove.y1
        notch = [(groove.x0, edge), (groove.x0, within), (groove.x1, within), (groove.x1, edge)]
        # The groove follows the corner at which its side of the border begins.
        parts.insert(1 if above else 3, np.array(notch[::-1] if above else notch))
    return np.concatenate(parts)


def _arc(
    centre: tuple[float, float], radius: float, start: float, end: float, chord_mm: float, angle_rad: float
) -> np.ndarray:
    """Return points (k, 2) on an arc, both ends included, at most `angle_rad` apart.

    The chords between them leave the arc by no more than half of `chord_mm`: with all of it, a small pad's volume
    would be farther from the exact one than its taxels' volumes are.
    """
    step = min(2 * acos(max(1 - chord_mm / 2 / radius, -1.0)), angle_rad)
    angle = np.linspace(start, end, ceil((end - start) / step - 1e-9) + 1)
    return np.stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)], -1)


def _circle(centre: tuple[float, float], diameter: float, chord_mm: float, angle_rad: float) -> np.ndarray:
    """Return points (k, 2) on a circle, anticlockwise."""
    return _arc(centre, diameter / 2, 0.0, 2 * pi, chord_mm, angle_rad)[:-1]


def prism(rings: list[np.ndarray], low: float, high: float) -> Mesh:
    """Return the prism from `low` to `high` mm over a polygon with holes.

    `rings` are points (n, 2) in mm: first the outline, anticlockwise, then the holes, clockwise.

    Raises
    ------
    GeometryError
        The polygon cannot be triangulated: rings meet.
    """
    import manifold3d

    flat = np.concatenate(rings)
    count = len(flat)
    ends = np.cumsum([0] + [len(ring) for ring in rings])
    caps = np.asarray(manifold3d.triangulate(rings), np.int64)
    if len(caps) != count + 2 * len(rings) - 4:
        raise GeometryError("the edges of a plate meet its holes")
    sides = []
    for start, stop in pairwise(ends.tolist()):
        a = np.arange(start, stop)
        b = np.roll(a, -1)
        sides += [np.stack([a, b, b + count], -1), np.stack([a, b + count, a + count], -1)]
    vertices = np.concatenate([np.c_[flat, np.full(count, low)], np.c_[flat, np.full(count, high)]])
    return Mesh(vertices, np.concatenate([caps[:, ::-1], caps + count, *sides]))


SEAM_MM = 1e-7


@dataclass(frozen=True)
class PadSolid:
    """The modelled pad: its mesh, the exact volume of its solids, and the tiles, border and grid that make it up.

    `tiles`, about their sub-cell's centre and turned as in the pad, has one tile per channel and, last, the
    bare tile; `grid` (rows, columns) of sub-cells holds indices into it.
    """

    mesh: Mesh
    volume_mm3: float
    tiles: tuple[Tile, ...]
    border: Tile
    grid: np.ndarray


class SampleShifts(NamedTuple):
    """Shifts in mm, one for each column and each row of coils, from a place in a `PadSample` to that in the whole pad.

    `columns_mm` and `rows_mm` are the sample's coordinates at which its second, third … column and row of coils begin;
    the shifts, one per column and row, are added to reach the place in the pad.
    """

    columns_mm: tuple[float, ...] = ()
    column_shifts_mm: tuple[float, ...] = (0.0,)
    rows_mm: tuple[float, ...] = ()
    row_shifts_mm: tuple[float, ...] = (0.0,)

    def in_pad(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Return a place of the sample in the pad's coordinates."""
        column = np.searchsorted(self.columns_mm, x_mm)
        row = np.searchsorted(self.rows_mm, y_mm)
        return x_mm + self.column_shifts_mm[column], y_mm + self.row_shifts_mm[row]


class PadSample(NamedTuple):
    """A small pad with every kind of tile of a larger pad, and every pair of neighbouring tiles."""

    plan: Plan
    pad: PadSolid
    places: SampleShifts


def build_pad(
    plan: Plan, chord_mm: float = CHORD_MM, angle_rad: float = ANGLE_RAD, groove: Outline | None = None
) -> PadSolid:
    """Return the pad of `plan`, each distinct taxel modelled once; `groove` replaces the notch that marks a corner.

    Raises
    ------
    GeometryError
        A kernel refused a taxel, or a seam does not close.
    """
    cell = plan.cell
    height = plan.spec.pad.frame_thickness_mm
    tiles = []
    for channel in plan.channels:
        known = cached_tile(plan, channel, chord_mm, angle_rad)
        sides = outline(plan, channel)
        vertices = known.mesh.vertices_mm.copy()
        # What is off the outline by rounding only is moved onto it.
        for axis, value in ((0, sides.x0), (0, sides.x1), (1, sides.y0), (1, sides.y1)):
            vertices[np.abs(vertices[:, axis] - value) < SEAM_MM, axis] = value
        placed = to_cell(vertices, channel)
        placed[:, :2] -= channel.site.centre_mm
        tiles.append(Tile(Mesh(placed, known.mesh.triangles), known.volume_mm3))
    corners = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]) * (cell.width_mm, cell.depth_mm)
    tiles.append(Tile(prism([corners], 0.0, height), cell.width_mm * cell.depth_mm * height))
    return _of_tiles(plan, tuple(tiles), chord_mm, angle_rad, groove)


def _of_tiles(
    plan: Plan, tiles: tuple[Tile, ...], chord_mm: float, angle_rad: float, groove: Outline | None = None
) -> PadSolid:
    grid = tile_grid(plan)
    mark = groove or corner_groove(plan.spec)
    border = Tile(border_mesh(plan, grid.shape, chord_mm, angle_rad, mark), border_volume_mm3(plan, mark))
    counts = np.bincount(grid.ravel(), minlength=len(tiles))
    volume = border.volume_mm3 + sum(float(n) * t.volume_mm3 for n, t in zip(counts, tiles, strict=True))
    return PadSolid(assembled_pad_mesh(plan, tiles, border, grid), volume, tiles, border, grid)


def sampled(plan: Plan, pad: PadSolid) -> PadSample:
    """Return a smaller pad, of which the rows and columns of coils that only repeat their neighbours are left out.

    Every dimension that can be measured on the pad can be measured on this sample.
    """
    coils = plan.coils
    spec = plan.spec
    kinds = 2 * pad.grid + turned_grid(plan)
    rows = _unrepeated([part.tobytes() for part in kinds.reshape(coils.rows, -1)])
    columns = _unrepeated([part.tobytes() for part in np.ascontiguousarray(kinds.T).reshape(coils.columns, -1)])
    if len(rows) * len(columns) == coils.rows * coils.columns:
        return PadSample(plan, pad, SampleShifts())
    wide = len(columns) * coils.pitch_x_mm
    deep = len(rows) * coils.pitch_y_mm
    shift_x = [(k - j) * coils.pitch_x_mm + (wide - spec.pad.width_mm) / 2 for j, k in enumerate(columns)]
    shift_y = [(k - j) * coils.pitch_y_mm + (deep - spec.pad.depth_mm) / 2 for j, k in enumerate(rows)]
    taxels = tuple(
        replace(t, coil=(i, j), x_mm=t.x_mm - shift_x[j], y_mm=t.y_mm - shift_y[i])
        for t in plan.taxels
        if t.coil[0] in rows and t.coil[1] in columns
        for i, j in [(rows.index(t.coil[0]), columns.index(t.coil[1]))]
    )
    fewer = replace(
        plan,
        spec=replace(spec, pad=replace(spec.pad, width_mm=wide, depth_mm=deep), resolution=len(taxels)),
        coils=replace(coils, rows=len(rows), columns=len(columns)),
        taxels=taxels,
    )
    places = SampleShifts(
        tuple(j * coils.pitch_x_mm - wide / 2 for j in range(1, len(columns))),
        tuple(shift_x),
        tuple(i * coils.pitch_y_mm - deep / 2 for i in range(1, len(rows))),
        tuple(shift_y),
    )
    return PadSample(fewer, _of_tiles(fewer, pad.tiles, CHORD_MM, ANGLE_RAD), places)


def _unrepeated(kinds: Sequence[bytes]) -> list[int]:
    """Return the rows (or columns) to keep so that each adjacent pair of `kinds` and the first and last kind remain."""
    kept: list[int] = []
    for index in range(len(kinds)):
        kept.append(index)
        for period in (1, 2):
            last = [kinds[k] for k in kept[-2 * period - 1 :]]
            if len(last) > 2 * period and last[:-period] == last[period:]:
                del kept[-period:]
    return kept


def tile_grid(plan: Plan) -> np.ndarray:
    """Return the taxel's channel in each sub-cell (rows, columns) from lower left; in empty ones the channel count."""
    places = taxel_places(plan)
    channel = np.array([taxel.channel for taxel in plan.taxels])
    return np.where(places < 0, len(plan.channels), channel[places])


def turned_grid(plan: Plan) -> np.ndarray:
    """Return a mask (rows, columns) over the pad's sub-cells: True where their coil's cell is turned by 180°."""
    cells = np.zeros((plan.coils.rows, plan.coils.columns), dtype=bool)
    for taxel in plan.taxels:
        cells[taxel.coil] = taxel.turned
    return cells.repeat(plan.cell.rows, 0).repeat(plan.cell.columns, 1)


def assembled_pad_mesh(plan: Plan, tiles: Sequence[Tile], border: Tile, grid: np.ndarray) -> Mesh:
    """Return the pad's mesh: tile ``tiles[grid[row, column]]`` in each sub-cell, `border` around, seams welded."""
    rows, columns = grid.shape
    spec = plan.spec
    x = np.linspace(-spec.pad.width_mm / 2, spec.pad.width_mm / 2, columns + 1)
    y = np.linspace(-spec.pad.depth_mm / 2, spec.pad.depth_mm / 2, rows + 1)
    z = np.array([0.0, spec.pad.frame_thickness_mm])
    lattice = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)
    vertices = [lattice]
    triangles = []
    offset = len(lattice)
    turned = turned_grid(plan)
    for (index, tile), around in product(enumerate(tiles), (False, True)):
        r, c = np.nonzero((grid == index) & (turned == around))
        if not len(r):
            continue
        # Turned by 180° about z, without rounding.
        mesh = tile.mesh._replace(vertices_mm=tile.mesh.vertices_mm * ((-1, -1, 1) if around else 1))
        inner, corner, faces = _open_seams(mesh, plan.cell.width_mm / 2, plan.cell.depth_mm / 2, z)
        # Vertex numbers per place: the tile's own vertices follow each other, corners point into the lattice.
        number = np.empty((len(r), len(inner)), dtype=np.int64)
        place = np.flatnonzero(inner)
        number[:, place] = offset + np.arange(len(r))[:, None] * len(place) + np.arange(len(place))
        at = corner[~inner]
        lattice_index = ((c[:, None] + at[:, 0]) * (rows + 1) + r[:, None] + at[:, 1]) * 2 + at[:, 2]
        number[:, np.flatnonzero(~inner)] = lattice_index
        centre = np.stack([(x[c] + x[c + 1]) / 2, (y[r] + y[r + 1]) / 2, np.zeros(len(r))], -1)
        vertices.append((centre[:, None] + mesh.vertices_mm[place]).reshape(-1, 3))
        triangles.append(number[:, faces].reshape(-1, 3))
        offset += len(r) * len(place)
    on_lattice, faces = _open_border(border.mesh, x, y, z)
    is_off_lattice = on_lattice < 0
    number = np.where(is_off_lattice, offset + np.cumsum(is_off_lattice) - 1, on_lattice)
    vertices.append(border.mesh.vertices_mm[is_off_lattice])
    triangles.append(number[faces])
    whole = Mesh(np.concatenate(vertices), np.concatenate(triangles))
    used = np.zeros(len(whole.vertices_mm), dtype=bool)
    used[whole.triangles] = True
    return Mesh(whole.vertices_mm[used], (np.cumsum(used) - 1)[whole.triangles])


def _open_seams(mesh: Mesh, half_x: float, half_y: float, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what joins a tile to its neighbours: vertex mask, lattice steps, and triangles without its four sides.

    Return a mask of the vertices that are not on its corner edges, the step (V, 3) to the lattice point of those that
    are (0 or 1 per axis), and the triangles that stay.
    """
    v = mesh.vertices_mm
    on_x = np.abs(np.abs(v[:, 0]) - half_x) < SEAM_MM
    on_y = np.abs(np.abs(v[:, 1]) - half_y) < SEAM_MM
    corner = np.stack([v[:, 0] > 0, v[:, 1] > 0, np.abs(v[:, 2] - z[1]) < SEAM_MM], -1).astype(np.int64)
    side = np.stack([on_x & (v[:, 0] < 0), on_x & (v[:, 0] > 0), on_y & (v[:, 1] < 0), on_y & (v[:, 1] > 0)], -1)
    seam = side[mesh.triangles].all(1).any(1)
    return ~(on_x & on_y), corner, mesh.triangles[~seam]


def _open_border(mesh: Mesh, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each border vertex's index among tile corners (-1 if not one), and triangles without the inner sides.

    Those of the inner sides, where tiles join, are dropped.
    """
    v = mesh.vertices_mm
    inside = (np.abs(v[:, 0]) < x[-1] + SEAM_MM) & (np.abs(v[:, 1]) < y[-1] + SEAM_MM)
    step = [np.abs(v[:, i, None] - axis).argmin(1) for i, axis in enumerate((x, y, z))]
    on_lattice = np.where(inside, (step[0] * len(y) + step[1]) * 2 + step[2], -1)
    flat = np.ptp(v[mesh.triangles, 2], axis=1) < SEAM_MM
    return on_lattice, mesh.triangles[~inside[mesh.triangles].all(1) | flat]
