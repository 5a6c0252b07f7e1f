"""The pad as a 3-D scene for viewers and report: each distinct part's mesh once, and where every copy of it lies.

Without a modelled pad, taxels are made from the plan's dimensions by manifold3d, which takes milliseconds and no CAD
kernel; they lack chamfers and fillets. Lengths are in mm, from the pad's centre, heights from its underside.
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import manifold3d
import numpy as np

from padgen.core.errors import InfeasibleError
from padgen.core.units import MM
from padgen.planner.board_layout import Track, arc_centre, board_of, coil_path
from padgen.planner.coils.board import board_coil
from padgen.planner.fixtures import plan_tray
from padgen.planner.guard import plan_guard
from padgen.planner.layout import Outline, coil_axis_mm, corner_groove, hexagon, outline, to_cell
from padgen.planner.plan import TURNS, Channel, Plan
from padgen.planner.suspensions import Arrangement, BeamPath, PathPoint
from padgen.solid.mesh import ANGLE_RAD, CHORD_MM, Mesh
from padgen.solid.pad_solid import PadSolid, ballast_mesh, border_mesh, tile_grid, washer_mesh

__all__ = ["Place", "ScenePart", "SceneParts", "mode_heights", "scene_parts"]

SIDES = 32
FEWER_SIDES = 14
MANY = 200
"""Corners of a round part, and of one that there are many of."""
STATIONS = 12
"""Pieces of a beam in meshes made from the plan's dimensions."""


class Place(NamedTuple):
    """A copy of a part: its name, where the part's origin lies in mm, and whether it is turned by 180° about z."""

    name: str
    x_mm: float
    y_mm: float
    z_mm: float = 0.0
    turned: bool = False


class ScenePart(NamedTuple):
    """A distinct part of a scene: name, material, mesh about the part's origin, and the places of its copies.

    `channel` is that of a taxel or of its washer, else None; `heights` (V,) then has each vertex's displacement in the
    working mode over the washer's, else None.
    """

    name: str
    material: str
    mesh: Mesh
    places: tuple[Place, ...]
    channel: int | None = None
    heights: np.ndarray | None = None


SceneParts = tuple[ScenePart, ...]


def scene_parts(plan: Plan, pad: PadSolid | None = None) -> SceneParts:
    """Return the parts of a plan's pad (with the meshes of `pad` if given), its coils, tray or board, and guard plate.

    A taxel has its origin on the washer's axis, as its places have. Without room for a tray there is none, and coils
    are drawn without a board that has no room for its tracks.
    """
    parts = [part for channel in plan.channels for part in _taxel_and_washer(plan, pad, channel)]
    grid = tile_grid(plan)
    cell = (plan.cell.width_mm, plan.cell.depth_mm)
    rows, columns = np.nonzero(grid == len(plan.channels))
    if len(rows):
        x, y = ((np.arange(n) - (n - 1) / 2) * step for n, step in zip(grid.shape[::-1], cell, strict=True))
        mesh = _mesh_of(_extruded([_rectangle(_around(*cell))], 0.0, plan.spec.pad.frame_thickness_mm))
        bare = (Place(f"frame-{i}-{j}", float(x[j]), float(y[i])) for i, j in zip(rows, columns, strict=True))
        parts.append(ScenePart("frame", "pad", pad.tiles[-1].mesh if pad else mesh, tuple(bare)))
    border = pad.border.mesh if pad else border_mesh(plan, grid.shape, CHORD_MM, ANGLE_RAD, corner_groove(plan.spec))
    parts.append(ScenePart("border", "pad", border, (Place("border", 0.0, 0.0),)))
    return (*parts, *(_board(plan) or _coils(plan)), *_tray(plan), *_guard(plan))


def _taxel_and_washer(plan: Plan, pad: PadSolid | None, channel: Channel) -> list[ScenePart]:
    channel_taxels = [taxel for taxel in plan.taxels if taxel.channel == channel.index]
    arrangement = plan.arrangement(channel)
    k = channel.index
    chord = 0.1 if len(plan.taxels) > MANY else 0.02
    axis = to_cell(np.array([float(arrangement.washer_x_mm), 0.0, 0.0]), channel) * (1, 1, 0)
    parts = []
    hung = {"washer": washer_mesh(plan, channel, chord), "ballast": ballast_mesh(plan, channel, chord)}
    for kind, material in (("taxel", "pad"), ("washer", "steel"), ("ballast", "ballast")):
        if material == "ballast" and hung["ballast"] is None:
            continue
        if pad is None or material != "pad":
            mesh = hung.get(kind) or _taxel_mesh(plan, channel, arrangement)
            own_axes = mesh.vertices_mm
            placed = to_cell(mesh.vertices_mm, channel)
        else:
            mesh = pad.tiles[k].mesh
            placed = mesh.vertices_mm + np.array([*channel.site.centre_mm, 0.0])
            own_axes = _from_cell(placed, channel)
        heights = mode_heights(arrangement, channel, own_axes)
        places = (
            Place(t.id if kind == "taxel" else f"{kind}-{t.id}", t.x_mm, t.y_mm, 0.0, t.turned) for t in channel_taxels
        )
        parts.append(ScenePart(f"{kind}-{k}", material, Mesh(placed - axis, mesh.triangles), tuple(places), k, heights))
    return parts


def _from_cell(points: np.ndarray, channel: Channel) -> np.ndarray:
    """Turn and shift points (n, 3) in mm from the cell's axes to a taxel's own: the inverse of `to_cell`."""
    cosine, sine = TURNS[channel.site.along]
    x, y = (points[:, i] - channel.site.origin_mm[i] for i in (0, 1))
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, points[:, 2]], -1)


def mode_heights(arrangement: Arrangement, channel: Channel, points_mm: np.ndarray) -> np.ndarray:
    """Return vertical displacements (n,) of points (n, 3) in a taxel's working mode, divided by the washer's.

    Points are in mm in the taxel's own axes. Plate, washer and boss move as one body, by the mode's translation and
    rotations; the frame is at rest; between them a beam is drawn as the cubic curve that meets both without a kink.
    """
    motion = channel.mode_motions[int(np.argmax(channel.mode_shares))]
    up = motion[2]
    about_x = motion[3] * 1e-3
    about_y = motion[4] * 1e-3
    washer_x = float(arrangement.washer_x_mm)

    def rigid(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return (up + about_x * y - about_y * (x - washer_x)) / up

    x, y = points_mm[:, 0], points_mm[:, 1]
    length, width = (float(v) for v in arrangement.window_mm)
    in_window = (x > EDGE_MM) & (x < length - EDGE_MM) & (np.abs(y) < width / 2 - EDGE_MM)
    in_block = np.any(
        [
            (x > float(b.low_x_mm) - EDGE_MM)
            & (x < float(b.high_x_mm) + EDGE_MM)
            & (y > float(b.low_y_mm) - EDGE_MM)
            & (y < float(b.high_y_mm) + EDGE_MM)
            for b in arrangement.blocks
        ],
        axis=0,
    )
    result = np.where(in_window & in_block, rigid(x, y), 0.0)
    bends = in_window & ~in_block
    places = []
    curves = []
    for path in arrangement.beams:
        points, share = _stations(path, 2 * STATIONS, 2)
        places += [(float(point.x_mm), float(point.y_mm)) for point in points]
        tip = np.array(places[-1])
        ahead = np.array([path.corners[-1].along_x, path.corners[-1].along_y], float)
        there = float(rigid(*tip))
        slope = float(path.length_mm) * float(rigid(*(tip + ahead)) - rigid(*tip))
        curves.append((3 * there - slope) * share**2 + (slope - 2 * there) * share**3)
    # What bends moves as the nearest station of any beam does.
    beam_x, beam_y = np.array(places).T
    away = np.hypot(x[bends, None] - beam_x, y[bends, None] - beam_y)
    result[bends] = np.concatenate(curves)[away.argmin(1)]
    return result


EDGE_MM = 1e-4


def _stations(path: BeamPath, pieces: int, least: int) -> tuple[list[PathPoint], np.ndarray]:
    """Return points along a beam's path, and their distances (k,) from its root as shares of its length.

    They cut it into about so many `pieces`, and each segment into `least` or more.
    """
    whole = float(path.length_mm)
    before = 0.0
    points = []
    shares = []
    for index, segment in enumerate(path.segments):
        length = float(segment.length_mm)
        for at in np.linspace(0, 1, 1 + max(round(pieces * length / whole), least))[bool(index) :].tolist():
            points.append(path.within(index, at))
            shares.append((before + at * length) / whole)
        before += length
    return points, np.array(shares)


def _taxel_mesh(plan: Plan, channel: Channel, arrangement: Arrangement) -> Mesh:
    """Return a taxel with the frame of its sub-cell, in its own axes, from the plan's dimensions alone."""
    plate = plan.plate
    x = float(arrangement.washer_x_mm)
    sides = _sides(len(plan.taxels))
    length, width = (float(v) for v in arrangement.window_mm)
    window = _rectangle(Outline(0, length, -width / 2, width / 2))
    full = plan.spec.pad.frame_thickness_mm
    solid = _extruded([_rectangle(outline(plan, channel)), window[::-1]], 0.0, full)
    moving = [_extruded([_rectangle(Outline(*map(float, b[:4])))], 0.0, float(b.height_mm)) for b in arrangement.blocks]
    pin = channel.pin
    felt = _disc(pin.diameter_mm, pin.x_mm, pin.y_mm, sides=sides)
    foot = 0.0 if pin.on_beam else plate.thickness_mm / 2
    recess = [_disc(plate.recess_diameter_mm, x, sides=sides)]
    if plate.post_diameter_mm:
        recess.append(_disc(plate.post_diameter_mm, x, sides=sides)[::-1])
    body = manifold3d.Manifold.batch_boolean(moving, manifold3d.OpType.Add)
    body -= _extruded(recess, -1.0, plate.recess_depth_mm)
    if ballast := plan.spec.ballast:
        pocket = _disc(ballast.width_mm, x, sides=sides)
        if ballast.shape == "hexagon":
            pocket = np.add(hexagon(ballast.width_mm), (x, 0.0))
        body -= _extruded([pocket], -1.0, plan.spec.pocket_top_mm)
    beams = [_beam(path) for path in arrangement.beams]
    beams.append(_extruded([felt], foot, pin.top_mm))
    return _mesh_of(manifold3d.Manifold.batch_boolean([solid, body, *beams], manifold3d.OpType.Add))


def _beam(path: BeamPath) -> manifold3d.Manifold:
    """Return the solid of a beam, which reaches a little into the frame so that the two join."""
    half = float(path.width_mm) / 2
    points, _ = _stations(path, STATIONS, 1)
    left, right = (np.array([point.beside(way) for point in points], float) for way in (half, -half))
    for side in (left, right):
        side[0] -= 0.05 * np.array(path.direction, float)
    return _extruded([np.concatenate([right, left[::-1]])], 0.0, float(path.thickness_mm))


def _coils(plan: Plan) -> SceneParts:
    """Return the windings and cores of all coils as scene parts, their tops the spec's gap below the washers."""
    coil = plan.spec.coil
    grid = plan.coils
    top = plan.spec.mover_low_mm - coil.gap_mm
    places = [coil_axis_mm(grid, r, c) for r, c in product(range(grid.rows), range(grid.columns))]
    inner = min(coil.inner_diameter_mm, coil.outer_diameter_mm - 0.1)
    sides = _sides(len(places))
    rings = {"winding": ("copper", [_disc(coil.outer_diameter_mm, sides=sides), _disc(inner, sides=sides)[::-1]])}
    if coil.core_diameter_mm:
        rings["core"] = "iron", [_disc(min(coil.core_diameter_mm, inner), sides=sides)]
    return tuple(
        ScenePart(
            name,
            material,
            _mesh_of(_extruded(outlines, top - coil.length_mm, top)),
            tuple(Place(f"{name}-{k + 1}", x, y) for k, (x, y) in enumerate(places)),
        )
        for name, (material, outlines) in rings.items()
    )


def _board(plan: Plan) -> SceneParts:
    """Return the circuit board of the coils, with its spacers and the copper on its top, as scene parts.

    () with other coils, and where the board has no room for its tracks.
    """
    spec = plan.spec
    if spec.coil.kind != "board":
        return ()
    try:
        board = board_of(plan)
    except InfeasibleError:
        return ()
    coil = board_coil(spec.coil)
    section = manifold3d.CrossSection
    top = spec.mover_low_mm - spec.coil.gap_mm
    low = top - coil.copper[0] / MM
    x0, y0, x1, y1 = board.outline_mm
    bores = [_disc(hole.diameter_mm, *hole.at_mm) for hole in board.holes]
    bores += [_disc(board.connector.drill_mm, *pin.at_mm, sides=FEWER_SIDES) for pin in board.pins]
    slab = section([_rectangle(Outline(x0, x1, y0, y1))]) - section(bores)
    axes = [coil_axis_mm(plan.coils, r, c) for r, c in product(range(plan.coils.rows), range(plan.coils.columns))]
    spiral = _on_top(coil_path(coil, 1, (0.0, 0.0))[0])
    of_spirals = {track for k, axis in enumerate(axes) for track in coil_path(coil, k + 1, axis)[0]}
    lanes = _on_top([track for track in board.tracks if track not in of_spirals])
    coils = tuple(Place(f"winding-{k + 1}", x, y) for k, (x, y) in enumerate(axes))
    parts = [
        ScenePart(
            "board", "board", _mesh_of(_lifted(slab, top - board.thickness_mm, low)), (Place("board", 0.0, 0.0),)
        ),
        ScenePart("winding", "copper", _mesh_of(_lifted(spiral, low, top)), coils),
    ]
    if not lanes.is_empty():
        parts.append(ScenePart("lanes", "copper", _mesh_of(_lifted(lanes, low, top)), (Place("lanes", 0.0, 0.0),)))
    if board.holes:
        hole_mm = board.holes[0].diameter_mm
        ring = section([_disc(hole_mm + 2 * SPACER_WALL_MM), _disc(hole_mm)[::-1]])
        places = tuple(Place(f"spacer-{k + 1}", *hole.at_mm) for k, hole in enumerate(board.holes))
        parts.append(ScenePart("spacer", "board", _mesh_of(_lifted(ring, top, 0.0)), places))
    return tuple(parts)


SPACER_WALL_MM = 1.0
ARC_SIDES = 16
"""Wall of the spacers that are drawn, and sides by which an arc of a track is drawn."""


def _on_top(tracks: Sequence[Track]) -> manifold3d.CrossSection:
    """Return the outline of those of the tracks that lie on the first layer."""
    section = manifold3d.CrossSection
    return section.batch_boolean(
        [section([_ribbon(track)]) for track in tracks if track.layer == 0], manifold3d.OpType.Add
    )


def _ribbon(track: Track) -> np.ndarray:
    """Return the outline (n, 2) of a track in mm; square ends reach half its width past its start and end points."""
    points = np.array([track.start_mm, track.end_mm])
    if track.middle_mm is not None:
        centre = complex(*arc_centre(track.start_mm, track.middle_mm, track.end_mm))
        start, middle, end = (complex(*at) - centre for at in (track.start_mm, track.middle_mm, track.end_mm))
        way = np.sign(np.angle(middle / start))
        sweep = way * (way * np.angle(end / start) % (2 * np.pi))
        arc = centre + start * np.exp(1j * sweep * np.linspace(0, 1, ARC_SIDES + 1))
        points = np.stack([arc.real, arc.imag], -1)
    ahead = np.gradient(points, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    half = track.width_mm / 2
    points[0] -= half * ahead[0]
    points[-1] += half * ahead[-1]
    aside = half * np.stack([-ahead[:, 1], ahead[:, 0]], -1)
    return np.concatenate([points - aside, (points + aside)[::-1]])


def _tray(plan: Plan) -> SceneParts:
    """Return the coil tray as scene parts: its rim, and one cell repeated under each coil; () where no tray fits."""
    try:
        tray = plan_tray(plan)
    except InfeasibleError:
        return ()
    pad = plan.spec.pad
    section = manifold3d.CrossSection
    radius = plan.spec.pad.border_mm / 2
    whole = _around(pad.width_mm + 2 * radius, pad.depth_mm + 2 * radius)
    ring = section([_rectangle(whole)]).offset(radius, manifold3d.JoinType.Round, 2.0, SIDES)
    ring -= section([_rectangle(_around(pad.width_mm, pad.depth_mm))]) + section([_rectangle(tray.groove)])
    slots = section.batch_boolean([section([_rectangle(slot)]) for slot in tray.wire_slots], manifold3d.OpType.Add)
    cell = section([_rectangle(_around(plan.coils.pitch_x_mm, plan.coils.pitch_y_mm))])
    half = tray.lead.width_mm / 2
    reach = tray.socket_diameter_mm / 2 + tray.lead.reach_mm
    sides = _sides(len(tray.coils_mm))
    socket = section([_disc(tray.socket_diameter_mm, sides=sides)])
    socket += section([_rectangle(Outline(0, reach, -half, half))]).rotate(45)
    parts = {
        "tray": (((ring, 0.0, tray.socket_top_mm), (ring - slots, tray.socket_top_mm, tray.height_mm)), [(0.0, 0.0)]),
        "tray-cell": (
            (
                (cell - section([_disc(tray.seat_hole_mm, sides=sides)]), 0.0, tray.floor_mm),
                (cell - socket, tray.floor_mm, tray.socket_top_mm),
            ),
            tray.coils_mm,
        ),
    }
    return tuple(
        ScenePart(
            name,
            "tray",
            _mesh_of(
                manifold3d.Manifold.batch_boolean(
                    [_lifted(of, low - tray.height_mm, high - tray.height_mm) for of, low, high in layers],
                    manifold3d.OpType.Add,
                )
            ),
            tuple(Place(f"{name}-{k + 1}" if len(places) > 1 else name, *at) for k, at in enumerate(places)),
        )
        for name, (layers, places) in parts.items()
    )


def _guard(plan: Plan) -> SceneParts:
    """Return the guard plate as it lies on the pad; none where the spec has none."""
    spec = plan.spec
    if not spec.guard.thickness_mm:
        return ()
    guard = plan_guard(plan)
    pad = spec.pad
    section = manifold3d.CrossSection
    radius = pad.border_mm / 2
    whole = _around(pad.width_mm + 2 * radius, pad.depth_mm + 2 * radius)
    outside = section([_rectangle(whole)]).offset(radius, manifold3d.JoinType.Round, 2.0, SIDES)
    sides = _sides(len(guard.pins_mm))
    bores = [section([_disc(guard.hole_diameter_mm, *place, sides=sides)]) for place in guard.pins_mm]
    bores += [section([_disc(guard.screw_hole_mm, *place, sides=sides)]) for place in guard.screw_holes_mm]
    bores.append(section([_rectangle(guard.groove)]))
    plate = outside - section.batch_boolean(bores, manifold3d.OpType.Add)
    pockets = section.batch_boolean([section([_rectangle(p)]) for p in guard.pockets], manifold3d.OpType.Add)
    low = pad.frame_thickness_mm
    high = low + guard.clearance_mm
    solid = manifold3d.Manifold.batch_boolean(
        [
            _lifted(plate - pockets, low, high),
            _lifted(plate, high, high + guard.thickness_mm),
        ],
        manifold3d.OpType.Add,
    )
    return (ScenePart("guard", "guard", _mesh_of(solid), (Place("guard", 0.0, 0.0),)),)


def _around(width: float, depth: float) -> Outline:
    return Outline(-width / 2, width / 2, -depth / 2, depth / 2)


def _rectangle(sides: Outline) -> np.ndarray:
    x0, x1, y0, y1 = sides
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], float)


def _sides(count: int) -> int:
    return FEWER_SIDES if count > MANY else SIDES


def _disc(diameter: float, x: float = 0.0, y: float = 0.0, sides: int = SIDES) -> np.ndarray:
    angle = 2 * np.pi * np.arange(sides) / sides
    return np.stack([x + diameter / 2 * np.cos(angle), y + diameter / 2 * np.sin(angle)], -1)


def _extruded(rings: list[np.ndarray], low: float, high: float) -> manifold3d.Manifold:
    """Return the prism from `low` to `high` mm over anticlockwise outlines with clockwise holes."""
    return _lifted(manifold3d.CrossSection(rings, manifold3d.FillRule.Positive), low, high)


def _lifted(shape: manifold3d.CrossSection, low_mm: float, high_mm: float) -> manifold3d.Manifold:
    """Return the solid of an outline between two heights."""
    return shape.extrude(high_mm - low_mm).translate((0, 0, low_mm))


def _mesh_of(solid: manifold3d.Manifold) -> Mesh:
    mesh = solid.to_mesh64()
    return Mesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts, np.int64))
