"""Parts beside the pad, made on request: the coil tray, the coupon, and a tray for the coupon's coil.

Each is modelled, checked and saved like the pad itself.

The coupon is a small pad with a groove beside channel 0. The bill of materials counts the pad and these parts.
"""

import csv
import io
from collections.abc import Mapping
from dataclasses import replace

from padgen.core.errors import number
from padgen.planner.coil_load import fitting_amplifiers
from padgen.planner.coupon import coupon_groove, coupon_plan
from padgen.planner.plan import Plan
from padgen.planner.screws import screw_for
from padgen.planner.tile import Outline
from padgen.planner.tray import plan_tray
from padgen.solid.border import border_mesh, border_volume_mm3
from padgen.solid.checks import check_pad
from padgen.solid.formats import Part
from padgen.solid.mesh import ANGLE_RAD, CHORD_MM
from padgen.solid.pad_solid import PadSolid, Tile, assembled, build_pad
from padgen.solid.tray_checks import build_tray, check_tray

__all__ = ["bill_of_materials", "build_coupon", "build_part", "grooved"]


def build_coupon(plan: Plan) -> tuple[Plan, PadSolid]:
    """Return the plan of the coupon of `plan`, which it is checked against, and its solid.

    Raises
    ------
    GeometryError
        A kernel refused a part.
    """
    coupon = coupon_plan(plan)
    return coupon, grooved(coupon, build_pad(coupon), coupon_groove(coupon))


def grooved(plan: Plan, pad: PadSolid, groove: Outline) -> PadSolid:
    """Return `pad` with a `groove` cut from its border over the whole height."""
    border = Tile(border_mesh(plan, pad.grid.shape, CHORD_MM, ANGLE_RAD, groove), border_volume_mm3(plan, groove))
    volume = pad.volume_mm3 - pad.border.volume_mm3 + border.volume_mm3
    return replace(pad, mesh=assembled(plan, pad.tiles, border, pad.grid), volume_mm3=volume, border=border)


def build_part(plan: Plan, name: str) -> Part:
    """Model and check the part of `plan` with this name: ``"tray"``, ``"coupon"`` or ``"coupon-tray"``.

    Raises
    ------
    InfeasibleError
        The plan's coils do not fit a tray.
    GeometryError
        A kernel refused the part.
    """
    if name == "coupon":
        coupon, pad = build_coupon(plan)
        use = "one taxel of each channel, to be printed beside the pad and measured"
        return Part(name, coupon.name, use, pad.mesh, None, check_pad(pad, coupon))
    of_coupon = name == "coupon-tray"
    over = coupon_plan(plan) if of_coupon else plan
    tray = build_tray(over)
    use = "holds one coil of each kind under the coupon" if of_coupon else "holds the coils under the pad"
    return Part(name, tray.tray.name, use, tray.mesh, tray.solid, check_tray(tray, over))


def _screw_text(plan: Plan, tray: bool) -> str:
    """Describe the screws: by their holes, and with a tray also by name and length."""
    pad = plan.spec.pad
    screw = screw_for(pad.hole_diameter_mm, pad.frame_thickness_mm, plan_tray(plan).height_mm) if tray else None
    holes = f"for {number(pad.hole_diameter_mm)} mm holes"
    return holes if screw is None else f"{screw.name} x {number(screw.length_mm)} mm {holes}"


def bill_of_materials(plan: Plan, plastic_g: float, parts_g: Mapping[str, float] | None = None) -> str:
    """Return the bill of materials as CSV text.

    `plastic_g` is the pad's plastic in g; `parts_g` that of parts printed beside the pad, by name.
    """
    spec = plan.spec
    coils = plan.coils.rows * plan.coils.columns
    washer, coil = spec.washer, spec.coil
    rows = [
        ("item", "quantity", "unit", "what"),
        (
            "washer",
            len(plan.taxels),
            "pieces",
            f"{washer.name}: {number(washer.outer_diameter_mm)} x {number(washer.inner_diameter_mm)} x"
            f" {number(washer.thickness_mm)} mm",
        ),
        (
            "coil",
            coils,
            "pieces",
            f"{coil.name}: {number(coil.outer_diameter_mm)} mm diameter {number(coil.length_mm)} mm long"
            f" {number(coil.resistance_ohm)} ohm {number(coil.inductance_mh)} mH",
        ),
        ("plastic", f"{plastic_g:.2f}", "g", f"pad: {spec.material.name} on {spec.printer.name}"),
        *(("plastic", f"{grams:.2f}", "g", f"{name}: at full infill") for name, grams in (parts_g or {}).items()),
        ("screw", 4 if spec.pad.hole_diameter_mm else 0, "pieces", _screw_text(plan, "tray" in (parts_g or {}))),
    ]
    own, load, fitting = spec.amplifier, plan.load, fitting_amplifiers(plan)
    some = (
        f"{own.name}: {own.channels} channels" if own else "; or ".join(f"{n} x {name}" for name, n in fitting.items())
    )
    asked = f"{number(load.voltage_peak_v)} V and {number(load.current_peak_ma)} mA peak each"
    glue_mg = f", {number(spec.taxel.glue_mg)} mg each" if spec.taxel.glue_mg else ""
    rows += [
        ("amplifier channel", coils, "pieces", f"{asked}{'' if some == '' else f' ({some})'}"),
        (
            "wire",
            2 * coils,
            "leads",
            f"two from each coil to its amplifier channel: {number(load.current_rms_ma)} mA rms",
        ),
        ("glue", len(plan.taxels), "drops", f"one under each washer{glue_mg}"),
    ]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
