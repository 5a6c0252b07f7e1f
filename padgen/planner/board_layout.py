"""Lay out the board that has the coils of a pad: tracks, vias, connectors, holes and names, as data.

Seen from above, with the connector at the pad's near side::

    o-----------------------------o   o: mounting holes, under those of the pad
    |  (coil) |  (coil) |  (coil) |
    |         |         |         |   |: a lane right of each column of coils, with a track for each of its coils
    |  (coil) ||  (coil)||  (coil)||
    o-----------------------------o
       \\  \\  |  |  |  |  /  /         tracks spread to the pins, in their order, without a crossing
        : : : : : : : : : : :          front row: ends on the top layer; rear row: those on the bottom layer

A coil's two ends come out on the top and on the bottom layer at the same place, so that both layers have the same
lanes. Pads with so many rows that the pins of one side do not suffice have a second connector at the far side.

x and y are in mm from the pad's centre, y away from the connector; layers count from the top.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import cos, dist, hypot, pi, sin
from typing import Any, NamedTuple

from padgen.core.errors import Finding, InfeasibleError, at_most, number
from padgen.core.units import COPPER_OHM_M, MM
from padgen.physics.board_coil import BoardCoil, BoardLayer, board_layers, ends_at_via, rectangle_path, side_via
from padgen.planner.coils import without_sizes
from padgen.planner.coils.board import DEFAULT_CONNECTOR, HEAD_MM, board_coil, connector_of, house_of
from padgen.planner.layout import SLACK_MM, coil_axis_mm, corner_groove, corner_holes_mm
from padgen.planner.plan import Plan
from padgen.spec import Coil, Spec

__all__ = [
    "Board",
    "Connector",
    "HeaderPin",
    "Hole",
    "Label",
    "Track",
    "Via",
    "arc_centre",
    "board_findings",
    "board_of",
    "coil_path",
    "least_board_gap_mm",
]

WIDEST_LANE_MM = 0.5
"""Width of the tracks to the connector where there is room: much wider than the coils' own, they add little to them."""
LABEL_MM = 1.0
LABEL_AWAY_MM = 1.9
MARGIN_MM = 1.5
"""Height of names, distance of the middle of a pin's name from the connector's body, and room round the pins."""


class Track(NamedTuple):
    """A straight track, or an arc through `middle_mm`, about half way, on one layer of one net."""

    net: int
    layer: int
    width_mm: float
    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    middle_mm: tuple[float, float] | None = None


class Via(NamedTuple):
    """A plated hole through all layers."""

    net: int
    at_mm: tuple[float, float]
    size_mm: float
    drill_mm: float


class Connector(NamedTuple):
    """A connector of two rows: pitch of pins and rows, hole, pad, and how far the body reaches beyond a pin, in mm.

    It comes with `fewest` to `most` columns of two pins; `part` is what to order.
    """

    name: str
    pitch_mm: float
    drill_mm: float
    pad_mm: float
    body_mm: float
    fewest: int
    most: int
    part: str


class HeaderPin(NamedTuple):
    """A pin of a connector; `row` 0 is the one nearer to the coils."""

    net: int
    connector: int
    number: int
    row: int
    at_mm: tuple[float, float]


class Hole(NamedTuple):
    """A hole without plating."""

    at_mm: tuple[float, float]
    diameter_mm: float


class Label(NamedTuple):
    """A name on the silkscreen of the top, turned by `angle` in degrees."""

    text: str
    at_mm: tuple[float, float]
    angle: float = 0.0


@dataclass(frozen=True, slots=True)
class Board:
    """Layout of a printed circuit board: sizes in mm, nets numbered from 1, tracks, vias, pins, holes and labels.

    `leads_ohm` are the resistances at 20 °C of each net's tracks from its coil to its two pins.
    """

    name: str
    layers: int
    thickness_mm: float
    outline_mm: tuple[float, float, float, float]
    lane_mm: float
    nets: tuple[str, ...]
    leads_ohm: tuple[float, ...]
    tracks: tuple[Track, ...]
    vias: tuple[Via, ...]
    pins: tuple[HeaderPin, ...]
    connector: Connector
    holes: tuple[Hole, ...]
    labels: tuple[Label, ...]
    mark_mm: tuple[float, float]


def board_findings(plan: Plan) -> Iterator[Finding]:
    """Yield an error where the board of a plan with board coils cannot be made."""
    spec = plan.spec
    if spec.coil.kind != "board":
        return
    if spec.coil.gap_mm <= spec.mover_low_mm:
        message = (
            f"no spacer fits between it and the pad: coil.gap_mm is {number(spec.coil.gap_mm)} mm, and the"
            f" {spec.mover.kind}s hang {number(spec.mover_low_mm)} mm above the pad's underside"
        )
        yield Finding("error", "board.room", "board", message, ({"coil.gap_mm": least_board_gap_mm(spec)},))
    try:
        board_of(plan)
    except InfeasibleError as error:
        turned = [plan.coils.columns, plan.coils.rows]
        message = f"it cannot be made: {error.where} {error.message}"
        cures: tuple[dict[str, Any], ...] = (without_sizes(spec.coil), {"coil.grid": turned})
        if spec.coil.connector != DEFAULT_CONNECTOR:
            cures = ({"coil.connector": DEFAULT_CONNECTOR}, *cures)
        yield Finding("error", "board.room", "board", message, cures)


def least_board_gap_mm(spec: Spec) -> float:
    """Return the gap in mm from coils on a board to the movers where the spacer between board and pad is one layer."""
    return round(spec.mover_low_mm + spec.printer.height_mm(1), 6)


def board_of(plan: Plan) -> Board:
    """Return the layout of the printed circuit board for a plan with board coils.

    Raises
    ------
    InfeasibleError
        There is no room for the tracks between the coils or for the pins, or the board is larger than the house sells.
    """
    spec = plan.spec
    if spec.coil.kind != "board":
        raise InfeasibleError(f"must be 'board' for a board to be made, got {spec.coil.kind!r}", "coil.kind")
    coil = board_coil(spec.coil)
    house = house_of(spec.coil)
    places = [(r, c) for r in range(plan.coils.rows) for c in range(plan.coils.columns)]
    axes = {place: coil_axis_mm(plan.coils, *place) for place in places}
    nets = {place: k + 1 for k, place in enumerate(places)}
    tracks: list[Track] = []
    vias: list[Via] = []
    for place in places:
        own_tracks, own_vias = coil_path(coil, nets[place], axes[place])
        tracks += own_tracks
        vias += own_vias
    half_x = spec.pad.width_mm / 2 + spec.pad.border_mm
    half_y = spec.pad.depth_mm / 2 + spec.pad.border_mm
    connector = _connector(spec.coil)
    sides = _sides(plan, axes, half_x, connector)
    lanes_mm = _lane_widths_mm(plan, coil, sides, axes, connector)
    pins: list[HeaderPin] = []
    leads_ohm = dict.fromkeys(nets.values(), 0.0)
    labels = [Label(f"r{r}c{c}", axes[r, c]) for r, c in places]
    ends = [-half_y, half_y]
    for k, (side, sign) in enumerate(zip(sides, (-1, 1), strict=False)):
        fan = _fan(coil, connector, [(axes[p], nets[p]) for p in side], lanes_mm, sign, half_y, k)
        tracks += fan.tracks
        for track in fan.tracks:
            leads_ohm[track.net] += _track_ohm(coil, track)
        pins += fan.pins
        ends[k] = fan.end_mm
        for pin in fan.pins:
            if pin.row == 1:
                r, c = places[pin.net - 1]
                away_mm = sign * (connector.body_mm + LABEL_AWAY_MM)
                labels.append(Label(f"r{r}c{c}", (pin.at_mm[0], pin.at_mm[1] + away_mm), 90.0))
    hole = spec.pad.hole_diameter_mm
    width_mm = 2 * half_x
    depth_mm = ends[1] - ends[0]
    if max(width_mm, depth_mm) > house["longest_mm"]:
        raise InfeasibleError(
            f"must be at most {number(house['longest_mm'])} mm long for boards of {house['name']!r}, the board would be"
            f" {number(width_mm)} x {number(depth_mm)} mm",
            "pad.width_mm" if width_mm > depth_mm else "pad.depth_mm",
        )
    groove = corner_groove(spec)
    return Board(
        name=plan.name,
        layers=len(coil.copper),
        thickness_mm=spec.coil.length_mm,
        outline_mm=(-half_x, ends[0], half_x, ends[1]),
        lane_mm=min(lanes_mm.values()),
        nets=tuple(f"r{r}c{c}" for r, c in places),
        leads_ohm=tuple(leads_ohm.values()),
        tracks=tuple(tracks),
        vias=tuple(vias),
        pins=tuple(pins),
        connector=connector,
        holes=tuple(Hole(at, hole) for at in corner_holes_mm(spec.pad)),
        labels=tuple(labels),
        mark_mm=((groove.x0 + groove.x1) / 2, (groove.y0 + groove.y1) / 2),
    )


def _connector(coil: Coil) -> Connector:
    """Return the connector of a board, its pads wide enough for the ring that the house leaves round a hole."""
    entry = connector_of(coil)
    house = house_of(coil)
    connector = Connector(*(entry[key] for key in Connector._fields))
    least_mm = round(connector.drill_mm + house["via_mm"] - house["drill_mm"], 6)
    return connector._replace(pad_mm=max(connector.pad_mm, least_mm))


def _track_ohm(coil: BoardCoil, track: Track) -> float:
    """Return the resistance in Ω at 20 °C of a straight track."""
    section = track.width_mm * MM * coil.copper[track.layer]
    return COPPER_OHM_M * dist(track.start_mm, track.end_mm) * MM / section


def arc_centre(start: "Point", middle: "Point", end: "Point") -> "Point":
    """Return the centre of the circle through three points."""
    bx = middle[0] - start[0]
    by = middle[1] - start[1]
    cx = end[0] - start[0]
    cy = end[1] - start[1]
    twice = 2 * (bx * cy - by * cx)
    square_b = bx * bx + by * by
    square_c = cx * cx + cy * cy
    return start[0] + (cy * square_b - by * square_c) / twice, start[1] + (bx * square_c - cx * square_b) / twice


def coil_path(coil: BoardCoil, net: int, axis_mm: tuple[float, float]) -> tuple[list[Track], list[Via]]:
    """Return the tracks and vias of one coil, from end to end, about an axis in mm.

    A round spiral is half circles about two centres that lie half a pitch apart, so that all turns keep their distance.
    """
    layers = board_layers(coil)
    width_mm = coil.track / MM
    tracks: list[Track] = []
    bore: set[tuple[float, float]] = set()
    side: set[tuple[float, float]] = set()
    for k, layer in enumerate(layers):
        pieces = _spiral_mm(coil, layer)
        for start, middle, end in pieces:
            by_way_of = middle and _moved(middle, axis_mm)
            tracks.append(Track(net, k, width_mm, _moved(start, axis_mm), _moved(end, axis_mm), by_way_of))
        inner = _moved(_polar(coil.bore_via_radius / MM, layer.start_angle), axis_mm)
        bore.add(inner)
        tracks.append(Track(net, k, width_mm, inner, _moved(pieces[0][0], axis_mm)))
        if ends_at_via(coil, k):
            outer = _moved(_side_via_mm(coil, layer), axis_mm)
            side.add(outer)
            tracks.append(Track(net, k, width_mm, _moved(pieces[-1][2], axis_mm), outer))
    vias = [Via(net, at, coil.via / MM, coil.drill / MM) for at in sorted(bore) + sorted(side)]
    return tracks, vias


Point = tuple[float, float]
Piece = tuple[Point, Point | None, Point]
"""A piece of a spiral in mm from the coil's axis: start, a point half way of an arc, and end."""


def _spiral_mm(coil: BoardCoil, layer: BoardLayer) -> tuple[Piece, ...]:
    """Return the pieces of a layer's spiral, from the inside out."""
    if coil.is_round:
        return _arcs_mm(layer, coil.pitch / MM)
    corners = [(float(x), float(y)) for x, y in rectangle_path(coil, layer) / MM]
    return tuple((a, None, b) for a, b in pairwise(corners))


def _side_via_mm(coil: BoardCoil, layer: BoardLayer) -> Point:
    x, y = side_via(coil, layer.end_angle)
    return x / MM, y / MM


LEVEL_MM = 0.01
OFF_MIDDLE = 0.45
"""KiCad 6 errs about arcs whose middle lies level with an end, or straight above it: they have another point."""


@lru_cache(maxsize=64)
def _arcs_mm(layer: BoardLayer, pitch_mm: float) -> tuple[Piece, ...]:
    """Return a spiral as arcs of at most half a turn, from the inside out: start, a point half way and end in mm.

    Half circles about a point a quarter pitch off the axis take turns with ones about a point as far on the other
    side; each is half a pitch wider, and on both sides the track is where an even spiral would be.
    """
    radius = layer.start_radius / MM + pitch_mm / 4
    angle = layer.start_angle
    left = layer.turns * 2 * pi
    centre = (-pitch_mm / 4 * cos(angle), -pitch_mm / 4 * sin(angle))
    arcs = []
    while left > 1e-9:
        sweep = min(pi, left)
        begin = _on_circle(centre, radius, angle)
        end = _on_circle(centre, radius, angle + layer.sense * sweep)
        middle = _on_circle(centre, radius, angle + layer.sense * sweep / 2)
        if any(min(abs(middle[0] - p[0]), abs(middle[1] - p[1])) < LEVEL_MM for p in (begin, end)):
            middle = _on_circle(centre, radius, angle + layer.sense * sweep * OFF_MIDDLE)
        arcs.append((begin, middle, end))
        angle += layer.sense * pi
        left -= pi
        # The next half circle goes on where this one ended, and is half a pitch wider.
        wider = pitch_mm / 2
        centre = (centre[0] - wider * cos(angle), centre[1] - wider * sin(angle))
        radius += wider
    return tuple(arcs)


def _on_circle(centre: Point, radius: float, angle: float) -> Point:
    return centre[0] + radius * cos(angle), centre[1] + radius * sin(angle)


def _polar(radius: float, angle: float) -> Point:
    return radius * cos(angle), radius * sin(angle)


def _moved(point: Point, by: Point) -> Point:
    """Return `point` moved by `by` in mm, rounded to a nanometre so that ends that meet are equal."""
    return round(point[0] + by[0], 6), round(point[1] + by[1], 6)


def _sides(
    plan: Plan, axes: dict[tuple[int, int], Point], half_x: float, connector: Connector
) -> list[list[tuple[int, int]]]:
    """Return the coils that each connector feeds: one connector if all pins fit on the near side, else two."""
    fitting = min(int((2 * half_x - 2 * MARGIN_MM) / connector.pitch_mm), connector.most)
    places = sorted(axes, key=lambda place: axes[place][1])
    if len(places) < connector.fewest:
        raise InfeasibleError(
            f"must be one of fewer pins than {connector.name!r}, which is for at least {connector.fewest} coils, got"
            f" {len(places)}",
            "coil.connector",
        )
    if len(places) <= fitting:
        return [places]
    rows = sorted({y for _, y in axes.values()})
    near = [place for place in places if axes[place][1] in rows[: (len(rows) + 1) // 2]]
    far = [place for place in places if place not in near]
    if max(len(near), len(far)) > fitting:
        raise InfeasibleError(
            f"must leave at most {fitting} coils to each of two connectors {connector.name!r} on"
            f" {number(2 * half_x)} mm, got {max(len(near), len(far))} of {plan.coils.rows} x {plan.coils.columns}",
            "coil.grid",
        )
    return [near, far]


def _lane_widths_mm(
    plan: Plan,
    coil: BoardCoil,
    sides: list[list[tuple[int, int]]],
    axes: dict[tuple[int, int], Point],
    connector: Connector,
) -> dict[float, float]:
    """Return column x → width in mm of the tracks beside that column of coils; raise `InfeasibleError` without room.

    The tracks of the last column pass between its coils and the screws' heads; none is wider than `WIDEST_LANE_MM`.
    """
    spec = plan.spec
    space = coil.space / MM
    outer = coil.outer_diameter / MM
    least = coil.track / MM
    last = max(x for x, _ in axes.values())
    screw_x = spec.pad.width_mm / 2 + spec.pad.border_mm / 2 - spec.pad.hole_diameter_mm / 2 - HEAD_MM
    widths = {}
    for column in sorted({round(x, 6) for x, _ in axes.values()}):
        tracks = max(sum(round(axes[place][0], 6) == column for place in side) for side in sides)
        room = screw_x - last - outer / 2 if column == round(last, 6) else plan.coils.pitch_x_mm - outer
        width = (room - space * (tracks + 1)) / tracks
        if width < least - SLACK_MM:
            narrower = outer - (least - width) * tracks * (2 if column == round(last, 6) else 1)
            raise InfeasibleError(
                f"must be at most {at_most(narrower)} mm to leave room for {tracks} tracks beside a column of coils, at"
                f" a pitch of {number(plan.coils.pitch_x_mm)} mm, got {number(outer)} mm",
                "coil.outer_diameter_mm",
            )
        # Those of the bottom layer pass between the pins of the front row.
        passing = connector.pitch_mm - connector.pad_mm - 2 * space
        widths[column] = float(min(WIDEST_LANE_MM, passing, round(max(width - 5e-4, least), 3)))
    return widths


class _Fan(NamedTuple):
    tracks: list[Track]
    pins: list[HeaderPin]
    end_mm: float


def _fan(
    coil: BoardCoil,
    connector: Connector,
    coils: list[tuple[Point, int]],
    lanes_mm: dict[float, float],
    sign: int,
    half_y: float,
    index: int,
) -> _Fan:
    """Return tracks from coils to a connector, its pins, and the y in mm of the board's edge behind it.

    `sign` is -1 for the connector at the edge of lower y, else +1; `index` is its number from 0.
    """
    pitch_mm = connector.pitch_mm
    step = max(lanes_mm.values()) + coil.space / MM
    outer = coil.outer_diameter / 2 / MM
    last = len(coil.copper) - 1
    columns = sorted({round(x, 6) for (x, _), _ in coils})
    lanes: list[tuple[float, float, Point, int]] = []
    for column in columns:
        # The coil nearest to the connector takes the lane nearest to its column.
        of_column = sorted(
            (axis for axis in coils if round(axis[0][0], 6) == column), key=lambda one: -sign * one[0][1]
        )
        width = lanes_mm[column]
        beside = column + outer + coil.space / MM + width / 2
        lanes += [(beside + k * (width + coil.space / MM), width, *one) for k, one in enumerate(of_column)]
    starts = [lane[0] for lane in lanes]
    targets = [(k - (len(lanes) - 1) / 2) * pitch_mm for k in range(len(lanes))]
    begin = half_y + step
    levels = max(_levels(starts, [t + shift for t in targets], step)[1] for shift in (0.0, pitch_mm / 2))
    front_y = begin + levels * step + MARGIN_MM + connector.pad_mm / 2
    tracks: list[Track] = []
    pins: list[HeaderPin] = []
    for row, layer in ((0, 0), (1, last)):
        shift = row * pitch_mm / 2
        level_of, _ = _levels(starts, [t + shift for t in targets], step)
        for k, (x, width, axis, net) in enumerate(lanes):
            pin = (targets[k], sign * (front_y + row * pitch_mm))
            start = _end_point(coil, layer, axis)
            level = sign * (begin + level_of[k] * step)
            lane = (x, start[1])
            points = [lane, (x, level), (targets[k] + shift, level), (targets[k] + shift, pin[1]), pin]
            # Up to its lane a track is as wide as the coil's: a wider one's round end would touch the turn inside.
            tracks.append(Track(net, layer, coil.track / MM, _rounded(start), _rounded(lane)))
            tracks += [
                Track(net, layer, width, a, b)
                for a, b in zip(map(_rounded, points), map(_rounded, points[1:]), strict=False)
                if hypot(a[0] - b[0], a[1] - b[1]) > 1e-6
            ]
            pins.append(HeaderPin(net, index, 2 * k + row + 1, row, _rounded(pin)))
    behind_mm = pitch_mm + connector.body_mm
    return _Fan(tracks, pins, sign * (front_y + behind_mm + LABEL_AWAY_MM + 2 * LABEL_MM + MARGIN_MM))


def _end_point(coil: BoardCoil, layer: int, axis: Point) -> Point:
    """Return where a coil's end on a layer is: the outer end of its spiral, or the via beside it."""
    spiral = board_layers(coil)[layer]
    if coil.parallel:
        return _moved(_side_via_mm(coil, spiral), axis)
    return _moved(_spiral_mm(coil, spiral)[-1][2], axis)


def _rounded(point: Point) -> Point:
    return round(point[0], 6), round(point[1], 6)


def _levels(starts: list[float], ends: list[float], apart: float) -> tuple[list[int], int]:
    """Return the row (0 nearest the coils) in which each track to a connector runs sideways, and the number of rows.

    Of tracks that go right the rightmost turns first, of those that go left the leftmost, so that none cross. A track
    that does not come within `apart` of the one that turned before it has the first level again.
    """
    right = [k for k in range(len(starts)) if ends[k] > starts[k]][::-1]
    left = [k for k in range(len(starts)) if ends[k] <= starts[k]]
    level = [0] * len(starts)
    for order in (right, left):
        for before, k in pairwise(order):
            low = max(min(starts[before], ends[before]), min(starts[k], ends[k]))
            high = min(max(starts[before], ends[before]), max(starts[k], ends[k]))
            level[k] = level[before] + 1 if low - high < apart else 0
    return level, max(level) + 1
