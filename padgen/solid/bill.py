"""The bill of materials of a pad and of the parts beside it."""

import csv
import io
from collections.abc import Mapping

from padgen.core.errors import number
from padgen.planner.plan import Plan
from padgen.planner.screws import screw_for
from padgen.planner.tray import plan_tray

__all__ = ["bill_of_materials"]


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
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
