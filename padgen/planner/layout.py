"""List layouts in the order in which they are tried (coil grid, channels per coil, cells), and place taxels.

Candidates are ranked before any beam is sized: first grids without empty places, then those with the fewest coils, then
those with the largest margin in mm. For a candidate without room, `explain` names the limit that binds and by how much.
Of a finished plan come the taxels' places and outlines, and the grooves that mark corners.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import groupby, pairwise
from math import ceil, cos, floor, hypot, inf, pi, prod, radians, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import at_least, number, plural
from padgen.core.registry import COILS, MOVERS, SUSPENSIONS
from padgen.core.units import MM
from padgen.planner.plan import TURNS, Channel, CoilGrid, Pitch, Plan, Site, Taxel
from padgen.planner.suspensions import Arrangement, PlateShape, Room, Suspension, allowed, suspension
from padgen.planner.taxel_model import narrowest_mm, plate_shape, recess_mm, shortest_mm
from padgen.spec import Coil, PadTable, Spec

__all__ = [
    "SLACK_MM",
    "Layout",
    "Outline",
    "binding_limit_text",
    "candidates",
    "channel_counts",
    "coil_axis_mm",
    "coil_reach_mm",
    "corner_groove",
    "corner_holes_mm",
    "full_smaller_layouts",
    "groove",
    "hexagon",
    "most_coils",
    "most_outputs",
    "outline",
    "pitch_of",
    "placed_taxel",
    "room",
    "shape_inputs",
    "sub_cell_centres",
    "taxel_places",
    "taxel_site",
    "to_cell",
    "with_fitting_coil",
    "with_other_coils",
]


SLACK_MM = 1e-9
"""Rounding error in mm: a slack may be below zero by so much."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Candidate layout: `rows` × `columns` coils of `channels` each, cells split into `sub_columns` × `sub_rows`.

    `surplus` counts the places without a taxel. Washers hang as near to their coil's axis as they can, but not nearer
    than `ring_mm`.
    """

    rows: int
    columns: int
    channels: int
    sub_columns: int
    sub_rows: int
    sub_width_mm: float
    sub_depth_mm: float
    beam_axis: str
    surplus: int
    slacks: tuple[tuple[str, float], ...]
    """Named slacks in mm, negative where a limit is broken."""
    ring_mm: float = 0.0

    @property
    def coils(self) -> int:
        """Number of coils."""
        return self.rows * self.columns

    @property
    def margin_mm(self) -> float:
        """Smallest slack in mm, of coil, plate, beam and reach; negative where one of them lacks room."""
        return min(slack for _, slack in self.slacks)

    @property
    def binding(self) -> tuple[str, float]:
        """Name and slack in mm of the tightest limit of the layout: coil, width, length or reach."""
        return min(self.slacks, key=lambda item: item[1])

    @property
    def rank(self) -> tuple[bool, int, float]:
        """Sort key of layouts: first those without empty places, then the fewest coils, then the largest margin."""
        return (*self.rank_by_coils, -self.margin_mm)

    @property
    def rank_by_coils(self) -> tuple[bool, int]:
        """The part of `rank` that needs no slacks: whether places are empty, and the number of coils."""
        return self.surplus > 0, self.coils


def candidates(spec: Spec, channel_limit: int) -> list[Layout]:
    """Return layouts for the spec's resolution, sorted by `rank`: all that have room, and the nearest misses."""
    return list(_candidates(_of_any_gap_and_drive(spec), channel_limit, SUSPENSIONS.changes))


def _of_any_gap_and_drive(spec: Spec) -> Spec:
    """Return `spec` with gap and drive set to fixed values; no layout depends on them, so cached layouts are shared."""
    coil = replace(spec.coil, gap_mm=1.0)
    drive = replace(spec.drive, scheme="auto", level_um=1.0)
    return replace(spec, coil=coil, drive=drive)


@lru_cache(maxsize=64)
def _candidates(spec: Spec, channel_limit: int, suspensions_version: int) -> tuple[Layout, ...]:
    parts = _parts(spec)
    bare = _without_slacks(spec, channel_limit)
    spare = [_margin_bound_mm(spec, parts, layout) for layout in bare]
    least = sorted(spare, reverse=True)[min(len(spare), NEAR_MISSES) - 1] if spare else 0.0
    near = (layout for layout, mm in zip(bare, spare, strict=True) if mm >= min(least, -SLACK_MM))
    sized = [replace(layout, slacks=_slacks(with_fitting_coil(spec, layout), parts, layout)) for layout in near]
    return tuple(sorted(sized, key=lambda layout: layout.rank))


NEAR_MISSES = 200
"""Layouts without room for their parts that are kept: a refusal explains what they lack."""


def _without_slacks(spec: Spec, channel_limit: int) -> list[Layout]:
    """Return all layouts for the spec's taxels with fewer empty places than coils, their slacks not yet computed."""
    wanted = spec.resolution
    return [
        layout
        for channels in channel_counts(spec, channel_limit)
        for rows, columns in _grids(spec, ceil(wanted / channels))
        if 0 <= rows * columns * channels - wanted < rows * columns
        for layout in _divisions(spec, rows, columns, channels, wanted)
    ]


def roomy_layouts(spec: Spec, channel_limit: int) -> Iterator[Layout]:
    """Yield, in the order of `rank`, the `candidates` that have room for their parts, computed only as needed."""
    key = _of_any_gap_and_drive(spec), channel_limit, SUSPENSIONS.changes
    for group in range(len(_by_coils(*key))):
        yield from _with_room(*key, group)


@lru_cache(maxsize=64)
def _by_coils(spec: Spec, channel_limit: int, suspensions_version: int) -> tuple[tuple[Layout, ...], ...]:
    """Return the layouts, their slacks not yet computed, sorted and grouped by `rank_by_coils`."""
    bare = sorted(_without_slacks(spec, channel_limit), key=lambda layout: layout.rank_by_coils)
    return tuple(tuple(alike) for _, alike in groupby(bare, key=lambda layout: layout.rank_by_coils))


@lru_cache(maxsize=4096)
def _with_room(spec: Spec, channel_limit: int, suspensions_version: int, group: int) -> tuple[Layout, ...]:
    """Return the layouts of one group of `_by_coils` that have room, by their rank."""
    parts = _parts(spec)
    alike = _by_coils(spec, channel_limit, suspensions_version)[group]
    near = [layout for layout in alike if _margin_bound_mm(spec, parts, layout) >= -SLACK_MM]
    sized = [replace(layout, slacks=_slacks(with_fitting_coil(spec, layout), parts, layout)) for layout in near]
    return tuple(sorted((one for one in sized if one.margin_mm >= -SLACK_MM), key=lambda layout: layout.rank))


def full_smaller_layouts(spec: Spec, channel_limit: int) -> Iterator[Layout]:
    """Yield layouts with room for fewer taxels than asked and without empty places, most taxels first."""
    rows_, columns_ = most_coils(spec)
    plate = plate_shape(spec)
    most = min(spec.resolution - 1, int(spec.pad.width_mm * spec.pad.depth_mm / (plate.length_mm * plate.width_mm)))
    grids = (
        (rows, columns, channels)
        for channels in channel_counts(spec, channel_limit)
        for rows in range(1, rows_ + 1)
        for columns in range(1, int(min(columns_, most // (rows * channels), most_outputs(spec) // rows)) + 1)
    )
    spare: dict[tuple[float, float], float] = {}
    parts = _parts(spec)
    work = 0
    for taxels, alike in groupby(sorted(grids, key=prod, reverse=True), key=prod):
        fitting = []
        for layout in (each for grid in alike for each in _divisions(spec, *grid, taxels)):
            size = layout.sub_width_mm, layout.sub_depth_mm
            # Many layouts share a size of sub-cell; that their pitch holds the coil is known.
            if size not in spare:
                spare[size] = _margin_bound_mm(spec, parts, layout)
            work += 1
            if spare[size] >= -SLACK_MM:
                work += layout.channels
                fitted = with_fitting_coil(spec, layout)
                fitting.append(replace(layout, slacks=_slacks(fitted, parts, layout)))
        yield from sorted((f for f in fitting if f.margin_mm >= -SLACK_MM), key=lambda layout: layout.rank)
        if work > MOST_WORK:
            return


MOST_WORK = 100_000
"""Largest number of layouts and of their places that `full_smaller_layouts` looks at: some seconds of work."""


def channel_counts(spec: Spec, channel_limit: int) -> Sequence[int]:
    """Return the counts of channels per coil worth trying.

    There are no more than taxels asked, than plates that the pad holds, or than plates that a coil reaches.
    """
    if spec.resonances_hz:
        return [len(spec.resonances_hz) // spec.coil.sets]
    plate = plate_shape(spec)
    plates = spec.pad.width_mm * spec.pad.depth_mm / min(plate.length_mm, plate.width_mm) ** 2
    if not spec.coil.grid:
        # Each plate's washer lies within the coil's reach, so the plate within an outline wider by its diagonal.
        reach_x, reach_y = (side_mm + hypot(plate.length_mm, plate.width_mm) for side_mm in coil_reaches_mm(spec))
        area_mm2 = (pi if spec.coil.shape == "round" else 4) * reach_x * reach_y
        plates = min(plates, area_mm2 / (plate.length_mm * plate.width_mm))
    return range(1, min(channel_limit, spec.resolution, max(int(plates), 1)) + 1)


def most_coils(spec: Spec) -> tuple[int, int]:
    """Return rows and columns of the largest grid whose pitches are at least the coil's (smallest) sides."""
    x_mm, y_mm = _least_coil_mm(spec.coil)
    return floor(spec.pad.depth_mm / y_mm + 1e-9), floor(spec.pad.width_mm / x_mm + 1e-9)


def most_outputs(spec: Spec) -> float:
    """Return the most coils that the spec's amplifier and sound card have outputs for; infinity without either."""
    return min((device.channels for _, device in spec.drive_devices), default=inf)


def _grids(spec: Spec, coils: int) -> list[tuple[int, int]]:
    """Return grids (rows, columns) of at least `coils` coils that do not overlap; the spec's grid, if it has one.

    For each number of rows there is one grid, with as few columns as possible.
    """
    most_rows, most_columns = most_coils(spec)
    grids = [(rows, ceil(coils / rows)) for rows in range(1, min(coils, most_rows) + 1)]
    fitting = [grid for grid in grids if grid[1] <= most_columns and spec.coil.sets <= grid[0] * grid[1]]
    return [g for g in ([spec.coil.grid] if spec.coil.grid else fitting) if g[0] * g[1] <= most_outputs(spec)]


def _divisions(spec: Spec, rows: int, columns: int, channels: int, wanted: int) -> Iterator[Layout]:
    pitch_x = spec.pad.width_mm / columns
    pitch_y = spec.pad.depth_mm / rows
    # Down to half a plate's side, so that near misses remain: a refusal explains what they lack.
    narrowest = min(plate_shape(spec)[:2]) / 2
    for sub_columns in range(1, min(channels, max(int(pitch_x / narrowest), 1)) + 1):
        sub_rows = ceil(channels / sub_columns)
        if (sub_columns - 1) * sub_rows < channels:
            width = pitch_x / sub_columns
            depth = pitch_y / sub_rows
            axis = "x" if width >= depth else "y"
            surplus = rows * columns * channels - wanted
            yield Layout(rows, columns, channels, sub_columns, sub_rows, width, depth, axis, surplus, ())


def room(spec: Spec, layout: Layout) -> Room:
    """Return the room between the ribs of one sub-cell, along and across the beams.

    Its two limits keep every washer over its coil's winding, where that pulls it. The sub-cell's centre is at (u, v)
    from the coil axis, with the root on the side away from the axis; the washer may lie beyond the axis, or short of
    it, by no more than the winding reaches there.
    """
    length, width = _sides_mm(spec, layout)
    slide = max(width - plate_shape(spec).width_mm, 0) / 2 - spec.printer.smallest_gap_mm
    centres = [at if layout.beam_axis == "x" else at[::-1] for at in sub_cell_centres(layout)]
    # What sliding across leaves of v is a chord's distance from the coil's axis: the winding reaches half that chord.
    beside = [(abs(u), max(abs(v) - max(slide, 0), 0)) for u, v in centres]
    half_mm = [
        min(side_mm / 2, reach_mm) for side_mm, reach_mm in zip(spec.coil.sides_mm, coil_reaches_mm(spec), strict=True)
    ]
    along_mm, across_mm = half_mm if layout.beam_axis == "x" else half_mm[::-1]
    if spec.coil.shape == "round":
        reaches = [(u, sqrt(max(along_mm**2 - off**2, 0.0))) for u, off in beside]
    else:
        reaches = [(u, along_mm if off <= across_mm else 0.0) for u, off in beside]
    return Room(length, width, *(min(length / 2 + way * u + reach for u, reach in reaches) for way in (1, -1)))


def _sides_mm(spec: Spec, layout: Layout) -> tuple[float, float]:
    """Return length and width of a sub-cell between its ribs, in mm along and across the beams."""
    width = layout.sub_width_mm - spec.pad.rib_mm
    depth = layout.sub_depth_mm - spec.pad.rib_mm
    return (width, depth) if layout.beam_axis == "x" else (depth, width)


class _Parts(NamedTuple):
    """The parts for which a sub-cell needs room: a plate, the gap around it, and one of the allowed suspensions.

    No beam is narrower than `narrowest_mm`. Each of the suspensions stands with the length of its shortest beam in mm.
    """

    plate: PlateShape
    gap_mm: float
    narrowest_mm: float
    suspensions: list[tuple[Suspension, float]]


def _parts(spec: Spec) -> _Parts:
    kinds = [(suspension(name), shortest_mm(spec, name)) for name in allowed(spec.suspension.topology)]
    return _Parts(plate_shape(spec), spec.printer.smallest_gap_mm, narrowest_mm(spec), kinds)


def _margin_bound_mm(spec: Spec, parts: _Parts, layout: Layout) -> float:
    """Return a quick upper bound in mm of a layout's smallest slack; the bound ignores where the washers lie."""
    return min(slack for _, slack in _part_slacks(spec, parts, layout, Room(*_sides_mm(spec, layout))))


def _slacks(spec: Spec, parts: _Parts, layout: Layout) -> tuple[tuple[str, float], ...]:
    reach_mm = coil_reach_mm(spec) - _farthest_mover_mm(spec, layout)
    return *_part_slacks(spec, parts, layout, room(spec, layout)), ("reach", reach_mm)


def _farthest_mover_mm(spec: Spec, layout: Layout) -> float:
    """Return how far in mm off the coil's axis the farthest mover lies, with plates slid towards the coil."""
    pocket = recess_mm(spec)[0] / 2 + spec.printer.line_width_mm + spec.printer.smallest_gap_mm + spec.pad.rib_mm / 2
    x_mm, y_mm = (max(side / 2 - pocket, 0) for side in (layout.sub_width_mm, layout.sub_depth_mm))
    nearest = ((max(abs(x) - x_mm, 0), max(abs(y) - y_mm, 0)) for x, y in sub_cell_centres(layout))
    return max(spec.coil.off_axis_mm(place) for place in nearest)


COIL_STEP_MM = 0.1
"""Step of the sides of coils whose size is left open."""


def with_fitting_coil(spec: Spec, layout: Layout) -> Spec:
    """Return `spec` with the widest coil for which the cells of `layout` have room, if the coil's size is left open."""
    if spec.coil.sizing != "auto":
        return spec
    kind = COILS.get(spec.coil.kind, "coil.kind")
    widest_mm = _stepped_mm(kind.widest_mm(spec.coil, spec.pad, layout.rows, layout.columns))
    sides_mm = tuple(map(max, widest_mm, _least_coil_mm(spec.coil)))
    return replace(spec, coil=kind.resized(spec.coil, sides_mm))


def with_other_coils(spec: Spec, layout: Layout) -> Iterator[Spec]:
    """Yield `spec` with other coils for which the cells of `layout` have room, from the widest down."""
    kind = COILS.get(spec.coil.kind, "coil.kind")
    widest_mm = kind.widest_mm(spec.coil, spec.pad, layout.rows, layout.columns)
    for k in range(MOST_NARROWER + 1):
        sides_mm = _stepped_mm([side_mm * NARROWER**k for side_mm in widest_mm])
        if min(sides_mm) >= kind.narrowest_mm(spec.coil) and sides_mm != spec.coil.sides_mm:
            yield replace(spec, coil=kind.resized(spec.coil, sides_mm))


NARROWER = 0.93
MOST_NARROWER = 16
"""Ratio of the sides of narrower coils that are tried, each to the next wider one's, and how many are tried: down to
three tenths of the widest."""


def _stepped_mm(sides_mm: Sequence[float]) -> tuple[float, ...]:
    return tuple(round(floor(side_mm / COIL_STEP_MM + SLACK_MM) * COIL_STEP_MM, 6) for side_mm in sides_mm)


def _least_coil_mm(coil: Coil) -> tuple[float, float]:
    """Return the sides of a coil in mm along x and y, or the least that they may be if its size is left open."""
    if coil.sizing != "auto":
        return coil.sides_mm
    least_mm = float(at_least(COILS.get(coil.kind, "coil.kind").narrowest_mm(coil)))
    return least_mm, least_mm


def _part_slacks(spec: Spec, parts: _Parts, layout: Layout, inside: Room) -> tuple[tuple[str, float], ...]:
    """Return the spare room (slack) in mm of the coil in its pitch, and of beam and plate inside a sub-cell."""
    plate = parts.plate
    gap = parts.gap_mm
    least_x, least_y = coil_room_mm(spec, layout.rows)
    spare = min(spec.pad.width_mm / layout.columns - least_x, spec.pad.depth_mm / layout.rows - least_y)
    lengths = []
    widths = []
    for shape, shortest in parts.suspensions:
        widest = shape.widest(inside, plate, gap)
        widths.append(widest - parts.narrowest_mm if widest >= 0 else inside.width_mm - plate.width_mm - 2 * gap)
        lengths.append(shape.longest(inside, plate, gap) - shortest)
    best = max(range(len(widths)), key=lambda i: min(widths[i], lengths[i]))
    return ("coil", spare), ("width", widths[best]), ("length", lengths[best])


def coil_room_mm(spec: Spec, rows: int) -> tuple[float, float]:
    """Return the least coil pitch in mm along x and y; on a board, tracks to `rows` coils run between columns.

    Of a coil whose size is left open it is that of the smallest.
    """
    outer_x, outer_y = _least_coil_mm(spec.coil)
    if spec.coil.kind == "solenoid":
        return outer_x, outer_y
    beside = getattr(COILS.get(spec.coil.kind, "coil.kind"), "beside_mm", None)
    x_mm, y_mm = beside(spec.coil, rows) if beside else (0.0, 0.0)
    return outer_x + x_mm, outer_y + y_mm


def coil_reaches_mm(spec: Spec) -> tuple[float, float]:
    """Return the coil's reach in mm along x and along y."""
    reach_mm = coil_reach_mm(spec)
    width_mm, depth_mm = spec.coil.sides_mm
    return reach_mm, reach_mm * depth_mm / width_mm


def coil_reach_mm(spec: Spec) -> float:
    """Return the coil's reach in mm: how far off its axis a mover may lie that still overlaps it and is pulled by it.

    For a mover with a `reach_m` it is that, if it is less: the pull on a magnet turns round within the overlap. Of a
    rectangular coil it is the reach along x (`Coil.off_axis_mm`).
    """
    overlap_mm = (spec.coil.outer_diameter_mm + spec.washer_or_magnet.outer_diameter_mm) / 2
    reach = getattr(MOVERS.get(spec.mover.kind, "mover.kind"), "reach_m", None)
    return min(overlap_mm, reach(spec.coil, spec.washer_or_magnet) / MM) if reach else overlap_mm


def sub_cell_centres(layout: Layout) -> list[tuple[float, float]]:
    """Return the centres in mm, from the coil axis, of the sub-cells that hold a channel, channel 0 first.

    The highest channels need the most force and lie nearest to the coil.
    """
    centres = [
        (
            (c - (layout.sub_columns - 1) / 2) * layout.sub_width_mm,
            (r - (layout.sub_rows - 1) / 2) * layout.sub_depth_mm,
        )
        for r in range(layout.sub_rows)
        for c in range(layout.sub_columns)
    ]
    nearest = sorted(centres, key=lambda at: (round(hypot(*at), 6), at[1], at[0]))[: layout.channels]
    if hypot(*nearest[-1]) - hypot(*nearest[0]) > 1e-6:
        return nearest[::-1]
    return sorted(nearest, key=lambda at: (at[1], at[0]))


def taxel_site(spec: Spec, layout: Layout, centre: tuple[float, float], arrangement: Arrangement) -> Site:
    """Return the site of a taxel in its sub-cell, its washer as near to the coil axis as room and `ring_mm` allow.

    The root lies on the side away from the coil. Where the cell is not divided along the beams, the roots lie on
    alternating sides so that the pad stays balanced.
    """
    window_mm = [float(side) for side in arrangement.window_mm]
    washer_x_mm = float(arrangement.washer_x_mm)
    across_x = layout.beam_axis == "y"
    u, v = centre[::-1] if across_x else centre
    sign = -1.0 if u > 1e-9 or (abs(u) <= 1e-9 and v > 1e-9) else 1.0
    # The window may slide within the room: to the place nearest to the coil axis, and from there away from it.
    slide = (np.array(_sides_mm(spec, layout)) - window_mm) / 2
    middle = np.array([sign * (washer_x_mm - window_mm[0] / 2) + u, v])
    near = middle - np.clip(middle, -slide, slide)
    far = middle + np.copysign(slide, middle) * (np.abs(middle) > SLACK_MM)
    washer_u, washer_v = near + _share_to_ring(layout.ring_mm, near, far - near) * (far - near)
    origin_u = round(float(washer_u) - sign * washer_x_mm, 6)
    origin_v = round(float(washer_v), 6)
    washer_u = origin_u + sign * washer_x_mm
    start = sign * (origin_u - u)
    along = ("+" if sign > 0 else "-") + layout.beam_axis
    origin = (origin_v, origin_u) if across_x else (origin_u, origin_v)
    washer = (origin_v, washer_u) if across_x else (washer_u, origin_v)
    cell = layout.sub_depth_mm if across_x else layout.sub_width_mm
    roots = [(float(path.root_mm[0]) + start, float(path.direction[0])) for path in arrangement.beams]
    depth = max(cell / 2 + (x if ahead > 0 else -x) for x, ahead in roots)
    return Site(centre, origin, washer, along, hypot(*washer), round(depth, 6))


def _share_to_ring(ring_mm: float, near: np.ndarray, way: np.ndarray) -> float:
    """Return the share (0 … 1) of vector `way` to add to point `near` so that it comes `ring_mm` from the coil axis."""
    short = ring_mm**2 - float(near @ near)
    length = float(way @ way)
    if short <= 0 or not length:
        return 0.0
    ahead = float(near @ way) / length
    return min(sqrt(ahead**2 + short / length) - ahead, 1.0)


def binding_limit_text(spec: Spec, layout: Layout) -> str:
    """Return one clause that names the limit that binds this layout, and by how much."""
    spec = with_fitting_coil(spec, layout)
    kind, slack = layout.binding
    pitches_mm = spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows
    pitch = f"pitch of {number(min(pitches_mm))} mm"
    if spec.coil.kind == "board":
        pitch = f"pitches of {number(pitches_mm[0])} x {number(pitches_mm[1])} mm"
    sub = f"a taxel has {number(layout.sub_width_mm)} x {number(layout.sub_depth_mm)} mm of the pad"
    inside = room(spec, layout)
    plate = plate_shape(spec)
    washer = spec.washer_or_magnet
    reach_mm = coil_reach_mm(spec)
    least = coil_room_mm(spec, layout.rows)
    short_mm = 2 * spec.printer.smallest_gap_mm - (inside.width_mm - plate.width_mm)
    too_wide = (
        f"the {spec.mover.kind} {washer.name} ({number(washer.outer_diameter_mm)} mm) with its walls and two gaps of"
        f" {number(spec.printer.smallest_gap_mm)} mm is {number(short_mm)} mm too wide"
    )
    if short_mm <= 0:
        too_wide = (
            f"the plate ({number(plate.width_mm)} mm) leaves too little width for a beam ({number(-slack)} mm short)"
        )
    with_tracks = f", with tracks beside it {number(least[0])} x {number(least[1])} mm"
    if least == spec.coil.sides_mm:
        with_tracks = ""
    sentences = {
        "coil": f"the coil ({spec.coil.size_text}{with_tracks}) exceeds the {pitch}",
        "reach": f"the farthest {spec.mover.kind} lies {number(reach_mm - slack)} mm off the coil axis,"
        f" beyond the coil's reach of {number(reach_mm)} mm",
        "width": f"{sub}, {too_wide}",
        "length": f"{sub}, the plate ({number(plate.length_mm)} mm) leaves no length for a beam"
        f" ({number(-slack)} mm short)",
    }
    channels = f"{layout.channels} channel{plural(layout.channels)} per coil"
    return f"{channels} on the {layout.rows} x {layout.columns} grid: {sentences[kind]}"


def taxel_places(plan: Plan) -> np.ndarray:
    """Return the index of the taxel in each sub-cell of the pad, (rows, columns) from the lower left; -1 for none."""
    cell = plan.cell
    coils = plan.coils
    places = np.full((coils.rows * cell.rows, coils.columns * cell.columns), -1)
    for index, taxel in enumerate(plan.taxels):
        x, y = (-v if taxel.turned else v for v in plan.channels[taxel.channel].site.centre_mm)
        column = round(x / cell.width_mm + (cell.columns - 1) / 2) + taxel.coil[1] * cell.columns
        row = round(y / cell.depth_mm + (cell.rows - 1) / 2) + taxel.coil[0] * cell.rows
        places[row, column] = index
    return places


class Outline(NamedTuple):
    """A rectangle with sides along x and y, by the coordinates of its four sides in mm."""

    x0: float
    x1: float
    y0: float
    y1: float


def to_cell(points: np.ndarray, channel: Channel) -> np.ndarray:
    """Turn and shift points (…, ≥2) in mm from a taxel's own axes to the cell's, whose origin is the coil axis."""
    cosine, sine = TURNS[channel.site.along]
    moved = points.copy()
    moved[..., 0] = cosine * points[..., 0] - sine * points[..., 1] + channel.site.origin_mm[0]
    moved[..., 1] = sine * points[..., 0] + cosine * points[..., 1] + channel.site.origin_mm[1]
    return moved


def outline(plan: Plan, channel: Channel) -> Outline:
    """Return the rectangle of a channel's sub-cell in the taxel's axes, rounded to 1e-9 mm for exact comparison."""
    cosine, sine = TURNS[channel.site.along]
    dx, dy = (c - o for c, o in zip(channel.site.centre_mm, channel.site.origin_mm, strict=True))
    x = cosine * dx + sine * dy
    y = -sine * dx + cosine * dy
    wide = plan.cell.width_mm / 2
    deep = plan.cell.depth_mm / 2
    wide, deep = (deep, wide) if sine else (wide, deep)
    return Outline(*(round(v, 9) for v in (x - wide, x + wide, y - deep, y + deep)))


def shape_inputs(plan: Plan, channel: Channel) -> dict[str, Any]:
    """Return, as plain data, all inputs that the solid of a taxel depends on, whatever its kind of suspension."""

    def plain(value: Any) -> Any:
        return [plain(entry) for entry in value] if isinstance(value, tuple) else float(value)

    ballast = plan.spec.ballast
    pocket = {"pocket": [ballast.shape, ballast.width_mm, plan.spec.pocket_top_mm]} if ballast else {}
    return {
        **pocket,
        "plate": asdict(plan.plate),
        "arrangement": plain(plan.arrangement(channel)),
        "fillet_mm": channel.beam.fillet_mm,
        "outline": outline(plan, channel),
        "pin": [getattr(channel.pin, name) for name in PIN_SHAPE],
        "frame_mm": plan.spec.pad.frame_thickness_mm,
    }


PIN_SHAPE = ("on_beam", "shape", "diameter_mm", "top_mm", "fillet_mm", "x_mm", "y_mm")
"""Fields of a `Pin` that give its solid."""


def hexagon(across_mm: float) -> list[tuple[float, float]]:
    """Return the corners (x, y) in mm of a hexagon about the origin, anticlockwise; two of its flats face ±x."""
    corner = across_mm / sqrt(3)
    return [(corner * cos(radians(60 * k + 30)), corner * sin(radians(60 * k + 30))) for k in range(6)]


def coil_axis_mm(coils: CoilGrid, row: int, column: int) -> tuple[float, float]:
    """Return the place (x, y) in mm of a coil's axis, from the pad's centre."""
    return (column - (coils.columns - 1) / 2) * coils.pitch_x_mm, (row - (coils.rows - 1) / 2) * coils.pitch_y_mm


def placed_taxel(coils: CoilGrid, coil: tuple[int, int], k: int, channel: Channel, turned: bool = False) -> Taxel:
    """Return the taxel of the `k`-th channel over a coil (row, column), whose cell may be turned by 180°."""
    sign = -1 if turned else 1
    x, y = channel.site.washer_mm
    x0, y0 = coil_axis_mm(coils, *coil)
    name = f"r{coil[0]}c{coil[1]}k{k}"
    place = (round(x0 + sign * x, 6), round(y0 + sign * y, 6))
    return Taxel(name, coil, channel.index, *place, channel.site.coil_distance_mm, turned)


WIDTH_MM = 1.5
DEPTH_MM = 1.0


def groove(spec: Spec, x_mm: float, above: bool = False) -> Outline:
    """Return a groove at `x_mm` in the border's side towards −y, or towards +y with `above`.

    The outline reaches outwards as far as inwards, so that it can be subtracted from the border as it is.
    """
    edge = (spec.pad.depth_mm / 2 + spec.pad.border_mm) * (1 if above else -1)
    depth = min(DEPTH_MM, spec.pad.border_mm / 4)
    return Outline(x_mm - WIDTH_MM / 2, x_mm + WIDTH_MM / 2, edge - depth, edge + depth)


def corner_groove(spec: Spec) -> Outline:
    """Return the groove that marks the corner of the coil in row 0, column 0, in the border's side towards −y."""
    return groove(spec, (WIDTH_MM - spec.pad.width_mm) / 2)


def corner_holes_mm(pad: PadTable) -> tuple[tuple[float, float], ...]:
    """Return the centres of the screw holes in a pad's border, from the pad's centre; none for a pad without holes."""
    if not pad.hole_diameter_mm:
        return ()
    x = (pad.width_mm + pad.border_mm) / 2
    y = (pad.depth_mm + pad.border_mm) / 2
    return tuple((sx * x, sy * y) for sx in (-1, 1) for sy in (-1, 1))


SAME_MM = 0.05
"""Taxels whose places differ by no more belong to one row or column."""


def pitch_of(taxels: Sequence[Taxel]) -> Pitch:
    """Return the spacing in mm of the taxels' columns and rows, and the share of row-column crossings with a taxel."""
    crossings = 1
    steps = list[tuple[float, ...]]()
    for places_mm in ([t.x_mm for t in taxels], [t.y_mm for t in taxels]):
        lines: list[float] = []
        for at in sorted(places_mm):
            if not lines or at - lines[-1] > SAME_MM:
                lines.append(at)
        crossings *= len(lines)
        apart = [round(b - a, 3) for a, b in pairwise(lines)]
        steps.append((min(apart), max(apart)) if apart else ())
    ratio = max((step[1] / step[0] for step in steps if step), default=1.0)
    return Pitch(steps[0], steps[1], ratio, len(taxels) / crossings)
