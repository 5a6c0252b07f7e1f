"""Plan the parts that go with a pad, as data: the tray that holds its coils, the coupon that is measured, and screws.

Section of the tray through one coil, the pad on top (heights from the bed on which the tray is printed)::

      screw   |<-- active area -->|
    ===##===+=====pad, beams and plates=====    ---- height: the pad's underside on the rim
    |      |                       clear
    | rim  |     +------------+            ---- top of the coils
    |      |     |    coil    |            wires run between the coils, out by slots in the rim
    |      +--+  |            |  +-----    ---- sockets
    |         |  |            |  |
    |         +--+---+    +---+--+         ---- floor: the coil's seat
    +----------------+    +------------    ---- z = 0; a hole to press the coil out again

Washers hang `glue` above the pad's underside, so a coil's top is ``gap − glue`` below the rim.

A coupon is a small pad with one taxel of each channel, to measure how the printer prints them: one coil's cell of the
pad, or two cells side by side where two sets of channels alternate. The tiles lie about the coil's axis as in the pad,
so that one coil drives all of them in the same way. The border is as narrow as the pad's screws allow. A coupon needs
these screws: it weighs only a few times as much as its taxels, and if it lay loose it would move with them and raise
their resonances.

Screws by ISO: clearance holes (273, fine), coarse threads (261: tapping drill = diameter − pitch), nuts (4032), heads
(4762, cylindrical with a hexagon socket), lengths (888). A machine screw cuts its own thread in printed plastic when
driven into a hole of the tapping drill's size.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import ceil
from typing import NamedTuple

from padgen.core.errors import Finding, InfeasibleError, at_least, number
from padgen.core.units import MM, UM
from padgen.planner.board_layout import board_of, least_board_gap_mm
from padgen.planner.layout import SLACK_MM, Outline, coil_axis_mm, corner_groove, corner_holes_mm, groove, placed_taxel
from padgen.planner.plan import NOT_JUDGED, CoilGrid, Plan, Reuse

__all__ = [
    "LeadSlot",
    "Screw",
    "Spacer",
    "Tray",
    "coupon_groove",
    "coupon_plan",
    "plan_spacer",
    "plan_tray",
    "screw_for",
    "spacer_findings",
    "spacer_mm",
    "tray_findings",
    "tray_room_findings",
]

SUFFIX = "-coupon"
LONGEST_NAME = 80
SMALLEST_PAD_MM = 5.0
"""Smallest side of the active area that a spec allows; what is not cell is plain frame."""
SMALLEST_BORDER_MM = 1.0
"""Narrowest border that a spec allows."""


def coupon_plan(plan: Plan) -> Plan:
    """Return the plan of a coupon for `plan`: the same channels, plate and cell, without figures of the whole pad.

    Taxel ``r0c0k0`` is channel 0. A second set of channels lies over the next coil: along x where the pad has several
    columns, else along y. No cell is turned.
    """
    coils = _coils(plan)
    spec = plan.spec
    step = (0, 1) if plan.coils.columns > 1 else (1, 0)
    taxels = tuple(
        placed_taxel(coils, (index * step[0], index * step[1]), k, channel)
        for index, channel_set in enumerate(plan.sets)
        for k, channel in enumerate(channel_set)
    )
    name = plan.name[: LONGEST_NAME - len(SUFFIX)] + SUFFIX
    # The border is as narrow as walls of two lines beside the holes and room for the screws' heads allow.
    pad = spec.pad
    walls = 2 * WALL_LINES * spec.printer.line_width_mm
    least = pad.hole_diameter_mm + walls if pad.hole_diameter_mm else max(walls, pad.rib_mm, SMALLEST_BORDER_MM)
    screw = screw_for(pad.hole_diameter_mm, pad.frame_thickness_mm, pad.frame_thickness_mm)
    border = min(pad.border_mm, round(max(least, screw.head_mm if screw else 0.0), 6))
    width = coils.columns * coils.pitch_x_mm
    depth = coils.rows * coils.pitch_y_mm
    return replace(
        plan,
        name=name,
        verdict=NOT_JUDGED,
        spec=replace(
            spec,
            name=name,
            resolution=len(taxels),
            pad=replace(pad, width_mm=width, depth_mm=depth, border_mm=border),
            coil=replace(spec.coil, grid=(coils.rows, coils.columns)),
        ),
        coils=coils,
        taxels=taxels,
        reuse=Reuse(None, None, "none"),
        layouts=(),
        findings=(),
    )


def coupon_groove(coupon: Plan) -> Outline:
    """Return the groove in the coupon's border that marks channel 0, on the side nearer to its sub-cell."""
    first = next(taxel for taxel in coupon.taxels if taxel.channel == 0)
    at_x, at_y = coupon.channels[0].site.centre_mm
    x0, y0 = coil_axis_mm(coupon.coils, *first.coil)
    return groove(coupon.spec, x0 + at_x, above=y0 + at_y > SLACK_MM)


def _coils(plan: Plan) -> CoilGrid:
    """Return the smallest coil grid for a coupon that has every set of channels and the minimum active area."""
    coils = plan.coils
    sets = len(plan.sets)
    wide, deep = (sets, 1) if coils.columns > 1 else (1, sets)
    return replace(
        coils,
        rows=max(deep, ceil(SMALLEST_PAD_MM / coils.pitch_y_mm - SLACK_MM)),
        columns=max(wide, ceil(SMALLEST_PAD_MM / coils.pitch_x_mm - SLACK_MM)),
    )


class Screw(NamedTuple):
    """A screw that goes from above through the pad into a part below.

    `head_mm` is the head's diameter. `hole_diameter_mm` and `hole_depth_mm` (from the top) are of the hole in the part
    below: a tapping hole, or, with a `nut`, a clearance hole all through.
    """

    name: str
    length_mm: float
    head_mm: float
    hole_diameter_mm: float
    hole_depth_mm: float
    nut: bool


SIZES = (
    ("M1.6", 1.6, 1.7, 1.25, 1.3, 3.0),
    ("M2", 2.0, 2.2, 1.6, 1.6, 3.8),
    ("M2.5", 2.5, 2.7, 2.05, 2.0, 4.5),
    ("M3", 3.0, 3.2, 2.5, 2.4, 5.5),
    ("M4", 4.0, 4.3, 3.3, 3.2, 7.0),
    ("M5", 5.0, 5.3, 4.2, 4.7, 8.5),
    ("M6", 6.0, 6.4, 5.0, 5.2, 10.0),
    ("M8", 8.0, 8.4, 6.75, 6.8, 13.0),
    ("M10", 10.0, 10.5, 8.5, 8.4, 16.0),
    ("M12", 12.0, 13.0, 10.25, 10.8, 18.0),
)
"""Screws by name: diameter, clearance hole, tapping hole, height of the nut and diameter of the head, in mm."""
LENGTHS_MM = (2, 2.5, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70)
GOOD_TURNS = 2.0
LEAST_TURNS = 1.5
"""Wanted and least depth of a screw in plastic, in screw diameters."""
TIP_MM = 1.0
"""Depth of a hole beyond the screw's tip, and least floor below a hole that does not go through."""


def screw_for(hole_mm: float, clamped_mm: float, below_mm: float) -> Screw | None:
    """Return the largest screw for a hole of `hole_mm` in a plate of `clamped_mm` on a part `below_mm` high.

    It is driven into the part below or, where that part is too low, goes through it into a nut. None where no metric
    screw passes the hole, or none is long enough.
    """
    for name, diameter, clearance, tapping, nut, head in reversed(SIZES):
        if clearance > hole_mm + 1e-9:
            continue
        least = clamped_mm + LEAST_TURNS * diameter - 1e-9
        wanted = next((n for n in LENGTHS_MM if n >= clamped_mm + GOOD_TURNS * diameter - 1e-9), LENGTHS_MM[-1])
        fitting = [n for n in LENGTHS_MM if least <= n <= wanted and n - clamped_mm <= below_mm]
        if fitting:
            depth = fitting[-1] - clamped_mm + TIP_MM
            blind = depth + TIP_MM <= below_mm
            return Screw(name, float(fitting[-1]), head, tapping, depth if blind else below_mm, False)
        through = next((n for n in LENGTHS_MM if n >= clamped_mm + below_mm + nut - 1e-9), None)
        if through is not None:
            return Screw(name, float(through), head, hole_mm, below_mm, True)
    return None


FLOOR_MM = 2.0
SOCKET_SHARE = 0.4
"""Depth of a socket over the coil's length; beside the rest of the coil there is room for wires."""
LEAST_SOCKET_LAYERS = 3
WALL_LINES = 2
HOLE_SHARE = 0.5
"""Diameter of the hole in the floor over the coil's."""
LEAD_MM = 2.0
LEAD_REACH_MM = 1.2
WIRE_SLOT_MM = 4.0
GAP_SHARE = 0.05
"""Share of the gap by which rounding to layers may change it without a warning."""


class LeadSlot(NamedTuple):
    """The slot beside a socket where the coil's leads come up, at 45° between the coils."""

    width_mm: float
    reach_mm: float


@dataclass(frozen=True, slots=True)
class Tray:
    """Dimensions of a tray: x and y from the pad's centre, heights from the bed that the tray is printed on.

    `gap_mm` is the gap that the tray makes, `clear_mm` the distance of the coils from the pad's moving parts. `groove`
    marks the corner of the coil in row 0, column 0. `wire_slots` are cut through the rim, from the sockets' top
    upwards; `wires` is the largest number of wires through one of them. `screw` is None for a pad without holes, or too
    thick for any screw.
    """

    name: str
    floor_mm: float
    socket_top_mm: float
    coil_top_mm: float
    height_mm: float
    gap_mm: float
    clear_mm: float
    socket_diameter_mm: float
    seat_hole_mm: float
    lead: LeadSlot
    coils_mm: tuple[tuple[float, float], ...]
    wire_slots: tuple[Outline, ...]
    wires: int
    holes_mm: tuple[tuple[float, float], ...]
    screw: Screw | None
    groove: Outline


def plan_tray(plan: Plan) -> Tray:
    """Return the tray for the coils of `plan`, with a socket for each coil of the grid.

    Raises
    ------
    InfeasibleError
        Coils too close for a wall between their sockets, too small or too short for one, or a gap that
        puts them into the pad. Coils on a board, which is screwed to the pad itself.
    """
    spec = plan.spec
    printer = spec.printer
    coil = spec.coil
    pad = spec.pad
    if coil.kind == "board":
        raise InfeasibleError(
            f"coils on a board need no tray: it is screwed to the pad over spacers of {number(spacer_mm(plan))} mm, or"
            " over the part 'spacer'",
            "--parts",
        )
    # Whole layers: enough for the floor, and as near as they come to the height above it.
    floor = printer.height_mm(printer.layers_up_to(FLOOR_MM))
    layers = int((coil.length_mm + coil.gap_mm - plan.spec.mover_low_mm) / printer.layer_mm + 0.5 + 1e-6)
    height = round(floor + layers * printer.layer_mm, 6)
    clear = round(height - floor - coil.length_mm, 6)
    _refuse(plan, clear)
    depth = max(int(SOCKET_SHARE * coil.length_mm / printer.layer_mm + 1e-9), LEAST_SOCKET_LAYERS) * printer.layer_mm
    screw = screw_for(pad.hole_diameter_mm, pad.frame_thickness_mm + spec.guard_height_mm, height)
    slots = _wire_slots(plan)
    return Tray(
        name=f"{plan.name}-tray",
        floor_mm=round(floor, 6),
        socket_top_mm=round(floor + depth, 6),
        coil_top_mm=round(floor + coil.length_mm, 6),
        height_mm=height,
        gap_mm=round(clear + plan.spec.mover_low_mm, 6),
        clear_mm=clear,
        socket_diameter_mm=coil.outer_diameter_mm + printer.smallest_gap_mm,
        seat_hole_mm=HOLE_SHARE * coil.outer_diameter_mm,
        lead=LeadSlot(min(LEAD_MM, coil.outer_diameter_mm / 4), min(LEAD_REACH_MM, coil.outer_diameter_mm / 8)),
        coils_mm=tuple(
            coil_axis_mm(plan.coils, r, c) for r in range(plan.coils.rows) for c in range(plan.coils.columns)
        ),
        wire_slots=slots,
        wires=ceil(2 * plan.coils.rows * plan.coils.columns / len(slots)),
        holes_mm=corner_holes_mm(pad) if screw else (),
        screw=screw,
        groove=corner_groove(spec),
    )


def spacer_mm(plan: Plan) -> float:
    """Return the height in mm of the spacers between the pad's underside and the coils' tops on a board."""
    return round(plan.spec.coil.gap_mm - plan.spec.mover_low_mm, 6)


def board_parts(plan: Plan) -> list[tuple[str, int, str, str]]:
    """Return what a board of coils needs besides, as rows of a bill of materials: connectors and spacers.

    None with wound coils, and where no board can be laid out.
    """
    if plan.spec.coil.kind != "board":
        return []
    try:
        board = board_of(plan)
    except InfeasibleError:
        return []
    connectors = Counter(Counter(pin.connector for pin in board.pins).values())
    rows = [
        ("connector", count, "pieces", board.connector.part.format(rows=2, columns=pins // 2, pins=pins))
        for pins, count in sorted(connectors.items())
    ]
    between = "between board and pad at each screw; or the one frame that padgen build --parts spacer makes"
    rows.append(("spacer", len(board.holes) or 1, "pieces", f"{number(spacer_mm(plan))} mm, {between}"))
    return rows


@dataclass(frozen=True, slots=True)
class Spacer:
    """Dimensions of the frame between pad and board: x and y from the pad's centre, in mm.

    `gap_mm` is the coils' gap that it makes. `groove` marks the corner of the coil in row 0, column 0.
    """

    name: str
    height_mm: float
    gap_mm: float
    hole_diameter_mm: float
    holes_mm: tuple[tuple[float, float], ...]
    groove: Outline


def plan_spacer(plan: Plan) -> Spacer:
    """Return the spacer for the board of `plan`, of whole layers as near as they come to the planned height.

    Raises
    ------
    InfeasibleError
        The coils are wound, and stand in a tray; or the gap leaves no room for a layer between pad and board.
    """
    spec = plan.spec
    if spec.coil.kind != "board":
        raise InfeasibleError("wound coils need no spacer: they stand in a tray, part 'tray'", "--parts")
    pad = spec.pad
    wanted_mm = spacer_mm(plan)
    if wanted_mm < spec.printer.height_mm(1) / 2:
        raise InfeasibleError(
            f"must be at least {number(least_board_gap_mm(spec))} mm for a layer between pad and board,"
            f" got {number(spec.coil.gap_mm)} mm",
            "coil.gap_mm",
        )
    more = spec.printer.layers_up_to(wanted_mm)
    # Of two that are as near the higher one, which leaves plates more room.
    heights_mm = [spec.printer.height_mm(layers) for layers in (more, max(more - 1, 1))]
    height_mm = min(heights_mm, key=lambda height: round(abs(height - wanted_mm), 6))
    return Spacer(
        name=f"{plan.name}-spacer",
        height_mm=height_mm,
        gap_mm=round(height_mm + spec.mover_low_mm, 6),
        hole_diameter_mm=pad.hole_diameter_mm,
        holes_mm=corner_holes_mm(pad),
        groove=corner_groove(spec),
    )


def spacer_findings(plan: Plan, spacer: Spacer) -> tuple[Finding, ...]:
    """Return findings about a spacer: a gap changed by rounding to layers, plates that touch the board."""
    return (
        *_rounded_gap(plan, spacer.gap_mm, "spacer"),
        *_too_low(plan, spacer.height_mm, "spacer"),
    )


def _too_low(plan: Plan, clear_mm: float, part: str) -> Iterator[Finding]:
    """Yield an error where a plate comes down by as much as the coils lie below it over this `part`."""
    lowest = max(plan.channels, key=lambda c: c.level_um + c.sag_um + c.static_um)
    travel = (lowest.level_um + lowest.sag_um + lowest.static_um) * UM / MM
    if travel >= clear_mm:
        yield Finding(
            "error",
            f"{part}.clear",
            f"channel {lowest.index}",
            f"its plate comes down by {number(travel)} mm (amplitude, sag, static pull), the coils lie"
            f" {number(clear_mm)} mm below it; a gap of"
            f" {at_least(travel + plan.spec.mover_low_mm + plan.spec.printer.layer_mm)} mm would do",
        )


def _rounded_gap(plan: Plan, made_mm: float, part: str) -> Iterator[Finding]:
    """Yield a finding where a `part` in whole layers makes another gap than planned: a warning if much another."""
    spec = plan.spec
    off = made_mm - spec.coil.gap_mm
    if abs(off) > 1e-6:
        yield Finding(
            "warning" if abs(off) > GAP_SHARE * spec.coil.gap_mm else "note",
            f"{part}.gap",
            part,
            f"in layers of {number(spec.printer.layer_mm)} mm the gap comes out as {number(made_mm)} mm,"
            f" planned are {number(spec.coil.gap_mm)} mm; coil.gap_mm = {number(made_mm)} would be met",
        )


def tray_findings(plan: Plan, tray: Tray) -> tuple[Finding, ...]:
    """Return findings about a tray: a gap changed by rounding to layers, plates that touch coils, heads on plates."""
    spec = plan.spec
    findings = list(_rounded_gap(plan, tray.gap_mm, "tray"))
    findings += _too_low(plan, tray.clear_mm, "tray")
    pad = spec.pad
    screw = tray.screw
    if screw is not None and screw.head_mm > pad.border_mm + pad.rib_mm + 1e-9:  # heads lie on moving plates
        findings.append(
            Finding(
                "warning",
                "tray.screw",
                "border",
                f"the {number(screw.head_mm)} mm head of an {screw.name} screw reaches over the moving plates, the"
                f" border is {number(pad.border_mm)} mm and the rib {number(pad.rib_mm)} mm; a border of"
                f" {number(screw.head_mm - pad.rib_mm)} mm would do, or smaller holes",
            )
        )
    return tuple(findings)


def tray_room_findings(plan: Plan) -> Iterator[Finding]:
    """Yield a warning where no tray with sockets can be printed for the wound coils of a plan."""
    if plan.spec.coil.kind == "board":
        return
    try:
        plan_tray(plan)
    except InfeasibleError as error:
        message = f"no tray can be printed for them (padgen build --parts tray): {error.where} {error.message}"
        yield Finding("warning", "tray.room", "coils", message)


def _refuse(plan: Plan, clear_mm: float) -> None:
    """Raise `InfeasibleError` for coils too small, short or close for sockets, or less than a layer below the pad."""
    spec = plan.spec
    printer = plan.spec.printer
    coil = plan.spec.coil
    pitch = plan.coils.pitch_mm
    outer = coil.outer_diameter_mm
    wall = WALL_LINES * printer.line_width_mm
    smallest = 4 * max(printer.line_width_mm, printer.smallest_gap_mm)
    shortest = LEAST_SOCKET_LAYERS * printer.layer_mm
    needed = outer + printer.smallest_gap_mm + wall
    inside = plan.spec.mover_low_mm
    rules = (
        (
            outer >= smallest - 1e-9,
            "coil.outer_diameter_mm",
            f"must be at least {number(smallest)} mm for a tray's sockets on {printer.name}, got {number(outer)} mm",
        ),
        (
            coil.length_mm >= shortest - 1e-9,
            "coil.length_mm",
            f"must be at least {number(shortest)} mm ({LEAST_SOCKET_LAYERS} layers) for a tray's sockets,"
            f" got {number(coil.length_mm)} mm",
        ),
        (
            pitch >= needed - 1e-9,
            "coil.outer_diameter_mm",
            f"a coil of {number(outer)} mm at a pitch of {number(pitch)} mm leaves"
            f" {number(max(pitch - outer - printer.smallest_gap_mm, 0.0))} mm of wall between a tray's sockets, must be"
            f" {number(wall)} mm (two lines of {printer.name}); a coil of {number(outer - (needed - pitch))} mm or a"
            f" pitch of {number(needed)} mm would do",
        ),
        (
            clear_mm >= printer.layer_mm - 1e-6,
            "coil.gap_mm",
            f"must be at least {number(inside + printer.layer_mm)} mm for a tray: washers lie {number(inside)} mm"
            f" within the pad (taxel.glue_gap_mm), and the coils must stay a layer below it, got"
            f" {number(spec.coil.gap_mm)} mm",
        ),
    )
    for holds, where, sentence in rules:
        if not holds:
            raise InfeasibleError(sentence, where)


def _wire_slots(plan: Plan) -> tuple[Outline, ...]:
    """Return slots through the rim at both ends of the lanes between coils; for one coil, at its two sides."""
    pad = plan.spec.pad
    coils = plan.coils
    columns = _lane_slots(coils.columns, coils.pitch_x_mm, pad.depth_mm / 2, pad.border_mm)
    rows = _lane_slots(coils.rows, coils.pitch_y_mm, pad.width_mm / 2, pad.border_mm)
    if not columns and not rows:
        rows = _lane_slots(2, coils.pitch_y_mm, pad.width_mm / 2, pad.border_mm)
    return (*(Outline(*lane, *rim) for lane, rim in columns), *(Outline(*rim, *lane) for lane, rim in rows))


def _lane_slots(count: int, pitch_mm: float, half_mm: float, border_mm: float) -> list[tuple[list[float], list[float]]]:
    """Return where the tray's rim is slotted for wires: at both ends of each lane between two rows of coils.

    Spans in mm across the lane and across the rim, for `count` rows. Across the rim a slot reaches from within it to
    beyond its outside.
    """
    middles = [(k - count / 2) * pitch_mm for k in range(1, count)]
    half = min(WIRE_SLOT_MM, pitch_mm / 3) / 2
    ends = half_mm - border_mm / 2, half_mm + 1.5 * border_mm
    return [([at - half, at + half], sorted(side * end for end in ends)) for at in middles for side in (-1, 1)]
