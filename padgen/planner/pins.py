"""Describe the boss or pin that meets the skin: how it moves with its taxel, and its travel and stress under a push.

A push on a pin first moves its taxel until the mover rests on the coil, then bends the beam between root and plate
further, until pin or beam meets the coil, or the finger rests on the guard plate.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import nan, pi

from padgen.core.errors import Finding, at_most, number
from padgen.core.units import MM, MPA
from padgen.planner.plan import TURNS, Pin, Plan, Site
from padgen.planner.sizing import STRENGTH_OVER_FATIGUE
from padgen.planner.suspensions import Arrangement
from padgen.planner.taxel_model import TaxelModel, foot_fillet_mm, pin_place_mm
from padgen.spec import Spec
from padgen.spec.model import ContactorTable

__all__ = ["BULGE_SHARE", "felt_parts", "judge_pins", "pin_of", "pushed", "with_errors"]

STRENGTH_SHARE = 0.6
"""Share of the strength at which a stop must have ended a push."""
BULGE_SHARE = 0.18
"""Depth by which a fingertip bulges into a hole over the hole's diameter: assumed, from the closed form below.

A half-space of E = 80 kPa with ν = 1/2 under p = 30 kPa (10 N on 3.3 cm²) rises at the middle of an unloaded disc of
radius a by ``2 (1 − ν²) p a/E`` (Johnson, Contact Mechanics, 1985, 3.4): 0.28 of the diameter in free skin; skin that
a plate holds at the edge does less, 0.18 as a clamped disc that shears.
"""


def pin_of(spec: Spec, model: TaxelModel, site: Site) -> Pin:
    """Return size, motion and stiffness of a taxel's boss or pin; `pushed` adds stresses, `with_errors` the errors."""
    arrangement = model.arrangement
    x_mm, y_mm = (float(v) for v in pin_place_mm(spec, arrangement))
    contact = model.contact
    left_mm = max(spec.coil.gap_mm - float(model.sag_m) / MM, 0.0)
    closed_mm = left_mm / contact.mover
    stop, stop_mm = _stop(spec, arrangement, site, (x_mm, y_mm), closed_mm)
    ground_mm = (
        float(arrangement.beams[0].thickness_mm) if spec.pin_share is not None else spec.taxel.plate_thickness_mm
    )
    arm_mm = spec.contact_top_mm - ground_mm
    return Pin(
        on_beam=spec.pin_share is not None,
        shape=spec.contactor.shape,
        diameter_mm=spec.contact_diameter_mm,
        top_mm=spec.contact_top_mm,
        fillet_mm=foot_fillet_mm(spec, float(arrangement.beams[0].width_mm)),
        x_mm=x_mm,
        y_mm=y_mm,
        lever=contact.lever,
        sway=contact.sway,
        lever_error=nan,
        stiffness_n_per_m=contact.stiffness,
        stiffness_error=nan,
        lean=contact.lean,
        closed_mm=closed_mm,
        stop=stop,
        stop_mm=stop_mm,
        stop_stress_mpa=None if stop_mm is None else nan,
        pushed_stress_mpa=nan,
        foot_stress_mpa=32 * arm_mm / (pi * spec.contact_diameter_mm**3),
    )


def pushed(pin: Pin, model: TaxelModel) -> Pin:
    """Return `pin` with the stresses of its beams filled in, for a push of 1 N and for a push as far as its stop."""
    free, held = model.pushes
    closed_mm = pin.closed_mm

    def force_n(way_mm: float) -> tuple[float, float]:
        """Return both parts in N of the push that moves the pin by `way_mm`: until the mover meets the coil, and on."""
        before = min(way_mm, closed_mm) * MM / free.way_m
        after = max(way_mm - closed_mm, 0.0) * MM / held.way_m if held.way_m > 0 else 0.0
        return before, after

    def stress_mpa(forces_n: tuple[float, float]) -> float:
        return (forces_n[0] * free.stress_pa + forces_n[1] * held.stress_pa) / MPA

    most_n = force_n(pin.stop_mm) if pin.stop_mm is not None else (PUSH_N, 0.0)
    first_n = min(closed_mm * MM / free.way_m, PUSH_N)
    newton_n = (first_n, PUSH_N - first_n)
    if sum(most_n) < PUSH_N:
        newton_n = most_n
    return replace(
        pin,
        stop_stress_mpa=None if pin.stop_mm is None else stress_mpa(most_n),
        pushed_stress_mpa=stress_mpa(newton_n),
    )


def with_errors(pin: Pin, model: TaxelModel) -> Pin:
    """Return `pin` with the errors of its lever and stiffness filled in; searches do without these slow figures."""
    lever_error, stiffness_error = model.contact_errors
    return replace(pin, lever_error=lever_error, stiffness_error=stiffness_error)


PUSH_N = 1.0
"""Push on one pin that a pad is to bear."""


def _stop(
    spec: Spec, arrangement: Arrangement, site: Site, at_mm: tuple[float, float], closed_mm: float
) -> tuple[str | None, float | None]:
    """Return what stops a push on boss or pin, 'coil' or 'guard', and after how many mm; None and None if nothing."""
    ways = []
    if spec.guard.thickness_mm:
        ways.append((spec.contact_proud_mm + BULGE_SHARE * spec.guard_hole_mm, "guard"))
    if spec.pin_share is None:
        ways.append((closed_mm, "coil"))
    else:
        cosine, sine = TURNS[site.along]
        x_mm = cosine * at_mm[0] - sine * at_mm[1] + site.origin_mm[0]
        y_mm = sine * at_mm[0] + cosine * at_mm[1] + site.origin_mm[1]
        clear_mm = spec.coil.gap_mm - (spec.recess_depth_mm - spec.washer_or_magnet.thickness_mm)
        if spec.coil.off_axis_mm((x_mm, y_mm)) <= spec.coil.outer_diameter_mm / 2:
            ways.append((clear_mm, "coil"))
    if not ways:
        return None, None
    way_mm, stop = min(ways)
    return stop, way_mm


def felt_parts(plan: Plan) -> str:
    """Return the word for the parts that a finger feels: 'bosses' or 'pins'."""
    return "bosses" if plan.spec.contactor == ContactorTable() else "pins"


def judge_pins(plan: Plan) -> Iterator[Finding]:
    """Warn where a push of 1 N on a pin, or less where a stop ends it, brings its beams near their strength."""
    spec = plan.spec
    if spec.contactor == ContactorTable() and not spec.guard.thickness_mm:
        return
    strength = STRENGTH_OVER_FATIGUE * spec.material.fatigue_stress_mpa
    bound = STRENGTH_SHARE * strength
    worst = max(plan.channels, key=lambda channel: channel.pin.pushed_stress_mpa)
    pin = worst.pin
    if pin.pushed_stress_mpa > bound:
        end = "which nothing stops"
        if pin.stop_mm is not None:
            end = f"which the {pin.stop} stops only after {pin.stop_mm:.2g} mm"
        yield Finding(
            "warning",
            "pin.strength",
            f"channel {worst.index}",
            f"a push of {number(PUSH_N)} N on its pin, {end}, stresses its beams by {pin.pushed_stress_mpa:.2g} MPa"
            f" (allowed: {bound:.2g} MPa, {number(STRENGTH_SHARE)} of what {spec.material.name} bears)",
            tuple(_stops(plan, bound)),
        )


def _stops(plan: Plan, bound_mpa: float) -> Iterator[dict[str, float]]:
    """Yield spec changes by which a push ends before beams bear `bound_mpa` in MPa: a guard plate, or lower pins."""
    spec = plan.spec
    layer_mm = spec.printer.layer_mm
    share = min(
        bound_mpa / channel.pin.stop_stress_mpa if channel.pin.stop_stress_mpa else 1.0 for channel in plan.channels
    )
    if not spec.guard.thickness_mm:
        yield {"guard.thickness_mm": GUARD_MM, "contactor.protrusion_mm": min(spec.contact_proud_mm, 4 * layer_mm)}
        yield {"guard.thickness_mm": GUARD_MM, "contactor.protrusion_mm": min(spec.contact_proud_mm, 2 * layer_mm)}
        return
    lower_mm = int(float(at_most(spec.contact_proud_mm * share)) / layer_mm) * layer_mm
    for mm in (lower_mm, layer_mm):
        if layer_mm <= mm < spec.contact_proud_mm:
            yield {"contactor.protrusion_mm": round(mm, 6)}


GUARD_MM = 1.0
"""Thickness of a guard plate in a cure."""
