"""Plan the coil tray, a printed part under the pad that holds the coils at their gap: its dimensions as data.

Section through one coil, the pad on top (heights from the bed on which the tray is printed)::

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
"""

from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

from padgen.core.errors import InfeasibleError, at_least, number
from padgen.core.finding import Finding
from padgen.core.units import MM, UM
from padgen.planner.coupon import coil_axis_mm
from padgen.planner.marks import corner_groove
from padgen.planner.plan import Plan
from padgen.planner.screws import Screw, screw_for
from padgen.planner.tile import Outline
from padgen.spec import Printer, Spec

__all__ = ["LeadSlot", "Tray", "plan_tray", "tray_findings", "washer_underside_mm"]

FLOOR_MM = 2.0
SOCKET_SHARE = 0.4
"""Depth of a socket over the coil's length; beside the rest of the coil there is room for wires."""
LEAST_SOCKET_LAYERS = 3
WALL_LINES = 2
HOLE_SHARE = 0.5
"""Diameter of the hole in the floor over the coil's."""
LEAD_MM, LEAD_REACH_MM = 2.0, 1.2
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
    upwards; `wires` is the largest number of wires through one of them. `screw` is None for a pad without holes.
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
        puts them into the pad.
    """
    spec = plan.spec
    printer, coil, pad = spec.printer, spec.coil, spec.pad
    _refuse_coil(spec)
    _refuse_pitch(plan)
    floor = printer.first_layer_mm + _layers(FLOOR_MM - printer.first_layer_mm, printer) * printer.layer_mm
    below = _layers_near(coil.length_mm + spec.coil.gap_mm - washer_underside_mm(plan), printer)
    height = round(floor + below * printer.layer_mm, 6)
    clear = round(height - floor - coil.length_mm, 6)
    _refuse_gap(plan, clear)
    depth = max(int(SOCKET_SHARE * coil.length_mm / printer.layer_mm + 1e-9), LEAST_SOCKET_LAYERS) * printer.layer_mm
    holes = _corners(spec) if pad.hole_diameter_mm else ()
    screw = screw_for(pad.hole_diameter_mm, pad.frame_thickness_mm, height)
    slots = _wire_slots(plan)
    return Tray(
        name=f"{plan.name}-tray",
        floor_mm=round(floor, 6),
        socket_top_mm=round(floor + depth, 6),
        coil_top_mm=round(floor + coil.length_mm, 6),
        height_mm=height,
        gap_mm=round(clear + washer_underside_mm(plan), 6),
        clear_mm=clear,
        socket_diameter_mm=coil.outer_diameter_mm + printer.smallest_gap_mm,
        seat_hole_mm=HOLE_SHARE * coil.outer_diameter_mm,
        lead=LeadSlot(min(LEAD_MM, coil.outer_diameter_mm / 4), min(LEAD_REACH_MM, coil.outer_diameter_mm / 8)),
        coils_mm=tuple(
            coil_axis_mm(plan.coils, r, c) for r in range(plan.coils.rows) for c in range(plan.coils.columns)
        ),
        wire_slots=slots,
        wires=ceil(2 * plan.coils.rows * plan.coils.columns / len(slots)),
        holes_mm=holes if screw else (),
        screw=screw,
        groove=corner_groove(spec),
    )


def washer_underside_mm(plan: Plan) -> float:
    """Return the height in mm of the glued washers' undersides above the pad's underside."""
    return plan.plate.recess_depth_mm - plan.spec.washer.thickness_mm


def tray_findings(plan: Plan, tray: Tray) -> tuple[Finding, ...]:
    """Return findings about a tray: a gap changed by rounding to layers, plates that touch coils, heads on plates."""
    spec, found = plan.spec, []
    off = tray.gap_mm - spec.coil.gap_mm
    if abs(off) > 1e-6:
        found.append(
            Finding(
                "warning" if abs(off) > GAP_SHARE * spec.coil.gap_mm else "note",
                "tray.gap",
                "tray",
                f"in layers of {number(spec.printer.layer_mm)} mm the gap comes out as {number(tray.gap_mm)} mm,"
                f" planned are {number(spec.coil.gap_mm)} mm; coil.gap_mm = {number(tray.gap_mm)} would be met",
            )
        )
    lowest = max(plan.channels, key=lambda c: c.level_um + c.sag_um + c.static_um)
    travel = (lowest.level_um + lowest.sag_um + lowest.static_um) * UM / MM
    if travel >= tray.clear_mm:
        found.append(
            Finding(
                "error",
                "tray.clear",
                f"channel {lowest.index}",
                f"its plate comes down by {number(travel)} mm (amplitude, sag, static pull), the coils lie"
                f" {number(tray.clear_mm)} mm below it; a gap of"
                f" {at_least(travel + washer_underside_mm(plan) + spec.printer.layer_mm)} mm would do",
            )
        )
    found += _heads(spec, tray)
    return tuple(found)


def _heads(spec: Spec, tray: Tray) -> list[Finding]:
    """Return a warning where screw heads are wider than border and rib, so that they lie on moving plates."""
    pad, screw = spec.pad, tray.screw
    if screw is None or screw.head_mm <= pad.border_mm + pad.rib_mm + 1e-9:
        return []
    return [
        Finding(
            "warning",
            "tray.screw",
            "border",
            f"the {number(screw.head_mm)} mm head of an {screw.name} screw reaches over the moving plates, the border"
            f" is {number(pad.border_mm)} mm and the rib {number(pad.rib_mm)} mm; a border of"
            f" {number(screw.head_mm - pad.rib_mm)} mm would do, or smaller holes",
        )
    ]


def _layers(height_mm: float, printer: Printer) -> int:
    """Return the smallest number of layers that makes up at least a height."""
    return max(ceil(height_mm / printer.layer_mm - 1e-6), 0)


def _layers_near(height_mm: float, printer: Printer) -> int:
    """Return the number of layers that comes nearest to a height, the larger of two."""
    return int(height_mm / printer.layer_mm + 0.5 + 1e-6)


def _refuse_coil(spec: Spec) -> None:
    printer, coil = spec.printer, spec.coil
    least = 4 * max(printer.line_width_mm, printer.smallest_gap_mm)
    if coil.outer_diameter_mm < least - 1e-9:
        raise InfeasibleError(
            f"must be at least {number(least)} mm for a tray's sockets on {printer.name},"
            f" got {number(coil.outer_diameter_mm)} mm",
            "coil.outer_diameter_mm",
        )
    least = LEAST_SOCKET_LAYERS * printer.layer_mm
    if coil.length_mm < least - 1e-9:
        raise InfeasibleError(
            f"must be at least {number(least)} mm ({LEAST_SOCKET_LAYERS} layers) for a tray's sockets,"
            f" got {number(coil.length_mm)} mm",
            "coil.length_mm",
        )


def _refuse_pitch(plan: Plan) -> None:
    printer, coil = plan.spec.printer, plan.spec.coil
    wall = WALL_LINES * printer.line_width_mm
    needed = coil.outer_diameter_mm + printer.smallest_gap_mm + wall
    pitch = plan.coils.pitch_mm
    if pitch < needed - 1e-9:
        between = pitch - coil.outer_diameter_mm - printer.smallest_gap_mm
        raise InfeasibleError(
            f"a coil of {number(coil.outer_diameter_mm)} mm at a pitch of {number(pitch)} mm leaves"
            f" {number(max(between, 0.0))} mm of wall between a tray's sockets, must be {number(wall)} mm (two lines of"
            f" {printer.name}); a coil of {number(coil.outer_diameter_mm - (needed - pitch))} mm or a pitch of"
            f" {number(needed)} mm would do",
            "coil.outer_diameter_mm",
        )


def _refuse_gap(plan: Plan, clear_mm: float) -> None:
    """Raise `InfeasibleError` where coils would reach the pad's underside."""
    spec = plan.spec
    if clear_mm < spec.printer.layer_mm - 1e-6:
        least = washer_underside_mm(plan) + spec.printer.layer_mm
        raise InfeasibleError(
            f"must be at least {number(least)} mm for a tray: washers lie {number(washer_underside_mm(plan))} mm"
            f" within the pad (taxel.glue_gap_mm), and the coils must stay a layer below it, got"
            f" {number(spec.coil.gap_mm)} mm",
            "coil.gap_mm",
        )


def _corners(spec: Spec) -> tuple[tuple[float, float], ...]:
    """Return the centres (x, y) in mm of the pad's corner holes."""
    pad = spec.pad
    x, y = (pad.width_mm + pad.border_mm) / 2, (pad.depth_mm + pad.border_mm) / 2
    return tuple((sx * x, sy * y) for sx in (-1, 1) for sy in (-1, 1))


def _wire_slots(plan: Plan) -> tuple[Outline, ...]:
    """Return slots through the rim at both ends of the lanes between coils; for one coil, at its two sides."""
    pad, coils = plan.spec.pad, plan.coils
    half_x, half_y = pad.width_mm / 2, pad.depth_mm / 2
    slots = []
    across = [(k - coils.columns / 2) * coils.pitch_x_mm for k in range(1, coils.columns)]
    along = [(k - coils.rows / 2) * coils.pitch_y_mm for k in range(1, coils.rows)]
    if not across and not along:
        along = [0.0]
    for x in across:
        half = min(WIRE_SLOT_MM, coils.pitch_x_mm / 3) / 2
        slots += [Outline(x - half, x + half, *_through(half_y, pad.border_mm, side)) for side in (-1, 1)]
    for y in along:
        half = min(WIRE_SLOT_MM, coils.pitch_y_mm / 3) / 2
        slots += [Outline(*_through(half_x, pad.border_mm, side), y - half, y + half) for side in (-1, 1)]
    return tuple(slots)


def _through(half_mm: float, border_mm: float, side: int) -> tuple[float, float]:
    """Return two coordinates in mm across the rim on one side: within the rim, and beyond its outside."""
    low, high = sorted((side * (half_mm - border_mm / 2), side * (half_mm + 1.5 * border_mm)))
    return low, high
