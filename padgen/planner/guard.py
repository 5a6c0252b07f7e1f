"""Plan the guard plate, as data: a second printed part over the pad, on its screws, with a hole for each pin.

Section through one taxel, as it lies on the pad (heights from the pad's top)::

                      pin
    ####################| |######################    ---- height: where the hand rests
    ####################| |######################         thickness
    ####+-------------- | | ----------------+####    ---- clearance: plates and beams move in the pocket
    ####|   pocket      | |                 |####
    =rib=     beam ==========  plate        =rib=    ---- 0: the plate lies on ribs and border

A pocket lies over the window of each taxel. The plate is printed with its top on the bed, pockets up. A hand holds it
down, so a hole's place is that of the pin but for the play of the screws and the prints' errors.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, log, pi

import numpy as np

from padgen.core.errors import Finding, at_least, number
from padgen.core.units import GPA, MM, MPA, UM
from padgen.planner.fixtures import Screw, screw_for
from padgen.planner.layout import Outline, coil_axis_mm, corner_groove, corner_holes_mm, to_cell
from padgen.planner.pins import STRENGTH_SHARE
from padgen.planner.plan import Channel, Plan, Taxel
from padgen.planner.sizing import STRENGTH_OVER_FATIGUE

__all__ = ["GuardPlate", "guard_findings", "pin_places", "plan_guard"]

PLACE_MM = 0.1
"""Error of the place of a hole or pin in a print, from its neighbours over the plate: assumed, one part in 500."""
HAND_N = 10.0
FINGER_MM = 3.0
"""Push of a hand on the plate, and the radius over which the finger that carries it presses: assumed."""
HOLE_NOTCH = 2.0
"""Stress at a hole in a bent plate over that without it (Timoshenko and Woinowsky-Krieger, 1959, 66: 1.8 to 2.3)."""


@dataclass(frozen=True, slots=True)
class GuardPlate:
    """Dimensions of a guard plate: x and y from the pad's centre, heights from the pad's top.

    `pins_mm` are the places of the holes, one for each taxel of the plan in its order, `pockets` the windows over the
    taxels. `play_mm` is how far a hole may be off its pin: by screws, and by prints. `screw` is None where the pad has
    no holes.
    """

    name: str
    thickness_mm: float
    clearance_mm: float
    height_mm: float
    hole_diameter_mm: float
    pins_mm: tuple[tuple[float, float], ...]
    pockets: tuple[Outline, ...]
    screw_holes_mm: tuple[tuple[float, float], ...]
    screw_hole_mm: float
    play_mm: float
    screw: Screw | None
    groove: Outline


def plan_guard(plan: Plan) -> GuardPlate:
    """Return the guard plate of a plan whose spec has one."""
    spec = plan.spec
    pad = spec.pad
    thickness_mm = spec.guard.thickness_mm
    assert thickness_mm, "the spec has a guard plate"
    screw = screw_for(pad.hole_diameter_mm, pad.frame_thickness_mm + spec.guard_height_mm, LOW_MM)
    shank_mm = float(screw.name.removeprefix("M")) if screw else pad.hole_diameter_mm
    # The screw is in the middle of neither hole.
    loose_mm = pad.hole_diameter_mm - shank_mm
    return GuardPlate(
        name=f"{plan.name}-guard",
        thickness_mm=thickness_mm,
        clearance_mm=spec.guard.clearance_mm,
        height_mm=round(spec.guard_height_mm, 6),
        hole_diameter_mm=spec.guard_hole_mm,
        pins_mm=pin_places(plan),
        pockets=tuple(_pocket(plan, taxel) for taxel in plan.taxels),
        screw_holes_mm=corner_holes_mm(pad),
        screw_hole_mm=pad.hole_diameter_mm,
        play_mm=loose_mm + 2**0.5 * PLACE_MM,
        screw=screw,
        groove=corner_groove(spec),
    )


LOW_MM = 0.0
"""Height of a part below the pad that a screw's length is not known with: only its diameter is taken."""


def pin_places(plan: Plan) -> tuple[tuple[float, float], ...]:
    """Return the places (x, y) in mm of all taxels' contactors from the pad's centre."""
    places = []
    for taxel in plan.taxels:
        pin = plan.channels[taxel.channel].pin
        x, y = _on_pad(plan, taxel, np.array([[pin.x_mm, pin.y_mm]]))[0].tolist()
        places.append((round(x, 6), round(y, 6)))
    return tuple(places)


def _on_pad(plan: Plan, taxel: Taxel, points_mm: np.ndarray) -> np.ndarray:
    """Return the places (n, 2) on the pad of points in a taxel's own axes."""
    turn = -1 if taxel.turned else 1
    return turn * to_cell(points_mm, plan.channels[taxel.channel]) + coil_axis_mm(plan.coils, *taxel.coil)


def _pocket(plan: Plan, taxel: Taxel) -> Outline:
    length, width = (float(side) for side in plan.arrangement(plan.channels[taxel.channel]).window_mm)
    corners = _on_pad(plan, taxel, np.array([[0.0, -width / 2], [length, width / 2]]))
    low = corners.min(0)
    high = corners.max(0)
    return Outline(*(round(float(v), 6) for v in (low[0], high[0], low[1], high[1])))


def guard_findings(plan: Plan) -> Iterator[Finding]:
    """Yield findings about the guard plate: pins or plates that touch it, thin walls, a hand that bends it."""
    spec = plan.spec
    if not spec.guard.thickness_mm:
        return
    guard = plan_guard(plan)
    yield from _caught(plan, guard)
    yield from _walls(plan, guard)
    yield from _lifted(plan, guard)
    yield from _pressed(plan, guard)


def _caught(plan: Plan, guard: GuardPlate) -> Iterator[Finding]:
    """Yield an error where a vibrating pin meets the edge of its hole, else a warning where a pushed one does.

    Beside its motion a pin is off its hole's middle by the play. Its top leans; in the hole it is up to the thickness
    lower, where it leans less.
    """
    spec = plan.spec
    free_mm = (guard.hole_diameter_mm - spec.contact_diameter_mm) / 2
    swayed = {c.index: guard.play_mm + c.pin.sway * c.level_um * UM / MM for c in plan.channels}
    pushed = {c.index: swayed[c.index] + _leaned_mm(c) for c in plan.channels}
    for ways, level, code, what in (
        (swayed, "error", "guard.caught", "in its own motion"),
        (pushed, "warning", "guard.jam", "while a finger pushes it down to the plate"),
    ):
        worst = max(ways, key=lambda index: ways[index])
        if ways[worst] > free_mm:
            pin = plan.channels[worst].pin
            wide_mm = float(at_least(2 * ways[worst] + pin.diameter_mm))
            yield Finding(
                level,
                code,
                f"channel {worst}",
                f"{what} its pin moves {ways[worst]:.2g} mm sideways at its top ({guard.play_mm:.2g} mm of it are play"
                f" of screws and prints) and meets its hole of {number(guard.hole_diameter_mm)} mm, which leaves"
                f" {free_mm:.2g} mm",
                ({"guard.hole_diameter_mm": wide_mm},),
            )
            return


def _leaned_mm(channel: Channel) -> float:
    """Return how far in mm a pin's top leans sideways when a push brings it to its stop; 0 for a pin without a stop."""
    return channel.pin.lean * (channel.pin.stop_mm or 0.0)


def _walls(plan: Plan, guard: GuardPlate) -> Iterator[Finding]:
    """Yield an error where the wall between neighbouring holes is thinner than two printed line widths."""
    spec = plan.spec
    if len(guard.pins_mm) < 2:
        return
    wall_mm = 2 * spec.printer.line_width_mm
    nearest_mm = _nearest_mm(np.array(guard.pins_mm))
    left_mm = nearest_mm - guard.hole_diameter_mm
    if left_mm < wall_mm - 1e-9:
        most_mm = nearest_mm - wall_mm
        free_mm = spec.contact_diameter_mm + 2 * spec.printer.smallest_gap_mm
        yield Finding(
            "error",
            "guard.wall",
            "guard plate",
            f"holes of {number(guard.hole_diameter_mm)} mm at {nearest_mm:.3g} mm leave {max(left_mm, 0.0):.2g} mm of"
            f" wall, must be two lines, {number(wall_mm)} mm",
            ({"guard.hole_diameter_mm": int(most_mm * 100) / 100},) if most_mm >= free_mm else (),
        )


def _nearest_mm(places: np.ndarray) -> float:
    """Return the smallest distance in mm of two of the places (n, 2)."""
    order = places[np.lexsort((places[:, 1], places[:, 0]))]
    nearest = inf
    for k in range(1, len(order)):
        ahead = order[k:] - order[:-k]
        if ahead[:, 0].min() >= nearest:
            break
        nearest = min(nearest, float(np.hypot(*ahead.T).min()))
    return nearest


def _lifted(plan: Plan, guard: GuardPlate) -> Iterator[Finding]:
    """Yield an error where plates that swing up meet the pocket's roof."""
    spec = plan.spec
    room_mm = guard.clearance_mm + spec.pad.frame_thickness_mm - spec.taxel.plate_thickness_mm
    # The plate's far edge rises more than the mover.
    rises_mm = {c.index: 2 * c.level_um * UM / MM for c in plan.channels}
    worst = max(rises_mm, key=lambda index: rises_mm[index])
    if rises_mm[worst] > room_mm:
        yield Finding(
            "error",
            "guard.clear",
            f"channel {worst}",
            f"its plate swings up by as much as {rises_mm[worst]:.2g} mm, the guard plate is {room_mm:.2g} mm above it",
            ({"guard.clearance_mm": float(at_least(guard.clearance_mm + rises_mm[worst] - room_mm))},),
        )


def _pressed(plan: Plan, guard: GuardPlate) -> Iterator[Finding]:
    """Yield a warning where a finger's push of 10 N bends the plate over a pocket beyond its allowed stress or sag.

    The allowed stress is `STRENGTH_SHARE` of the strength, the allowed sag half the clearance.

    Notes
    -----
    A rectangle supported at its edges under a load over a small disc at its middle (Roark, Formulas for Stress and
    Strain, plates 1b): stress and deflection with the coefficients for its sides, and the notch of a hole.
    """
    spec = plan.spec
    bound_mpa = STRENGTH_SHARE * STRENGTH_OVER_FATIGUE * spec.material.fatigue_stress_mpa
    room_mm = guard.clearance_mm / 2
    # A long narrow pocket may bend less than a square one and be stressed more.
    pressed = pressed_pockets(plan, guard)
    long_mm, short_mm, stress_mpa, sag_mm = max(pressed, key=lambda case: max(case[2] / bound_mpa, case[3] / room_mm))
    if stress_mpa > bound_mpa or sag_mm > room_mm:
        thicker = max((stress_mpa / bound_mpa) ** (1 / 2), (sag_mm / room_mm) ** (1 / 3))
        yield Finding(
            "warning",
            "guard.hand",
            "guard plate",
            f"{number(HAND_N)} N of a finger over a pocket of {long_mm:.3g} x {short_mm:.3g} mm bend its"
            f" {number(guard.thickness_mm)} mm by {sag_mm:.2g} mm, at most {room_mm:.2g} mm, with {stress_mpa:.2g} MPa,"
            f" at most {bound_mpa:.2g} MPa",
            ({"guard.thickness_mm": float(at_least(guard.thickness_mm * thicker))},),
        )


SIDES = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 100.0)
STRESS = (0.435, 0.650, 0.789, 0.875, 0.927, 0.958, 1.0)
SAG = (0.1267, 0.1478, 0.1621, 0.1715, 0.1770, 0.1805, 0.1851)
"""Roark's coefficients by the ratio of sides: of the stress in the middle, and of the deflection."""


def pressed_pockets(plan: Plan, guard: GuardPlate) -> list[tuple[float, float, float, float]]:
    """Return for each size of pocket its sides in mm, and stress in MPa and deflection in mm by a finger's push."""
    material = plan.spec.material
    sizes = {(pocket.x1 - pocket.x0, pocket.y1 - pocket.y0) for pocket in guard.pockets}
    cases = []
    for short, long in sorted({(min(sides), max(sides)) for sides in sizes}):
        ratio = long / short
        radius = min(FINGER_MM, short / 2)
        bent = (1 + material.poisson_ratio) * log(2 * short / (pi * radius)) + float(np.interp(ratio, SIDES, STRESS))
        stress = HOLE_NOTCH * 3 * HAND_N / (2 * pi * (guard.thickness_mm * MM) ** 2) * max(bent, 0.0)
        soft = float(np.interp(ratio, SIDES, SAG)) * HAND_N * (short * MM) ** 2
        sag = soft / (material.modulus_gpa * GPA * (guard.thickness_mm * MM) ** 3)
        cases.append((long, short, stress / MPA, sag / MM))
    return cases
