"""The figures by which variants are compared: one flat row of numbers and words from a plan, a yield, a build."""

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from padgen.planner.plan import Plan
    from padgen.planner.print_yield import PrintYield

__all__ = ["OBJECTIVES", "Objective", "build_figures", "plan_figures", "yield_figures"]


class Objective(NamedTuple):
    """What a Pareto front weighs: whether the most or the least of it is best; a word, a heading, an axis' name."""

    best: str
    word: str
    heading: str
    axis: str


OBJECTIVES = {
    "taxels": Objective("most", "taxels", "taxels", "taxels"),
    "selectivity_db": Objective("most", "selectivity", "selectivity dB", "selectivity, dB"),
    "good_pads_retuned": Objective("most", "yield", "good prints", "good prints, re-tuned"),
    "power_w": Objective("least", "power", "copper loss W", "copper loss, W"),
    "print_min": Objective("least", "print time", "print min", "print time, min"),
}
"""By column of the index, where a stage has it."""
FDM_MM_PER_S = 40.0
"""Speed of a nozzle along fine walls; a print's time is of this order."""
RESIN_S_PER_LAYER = 9.0


def plan_figures(plan: "Plan") -> dict[str, Any]:
    """Figures of a plan.

    `selectivity_db` is the worse of what a coil keeps in all states and what its neighbours leak; None where
    neither limits. `power_w` is the copper loss of all coils with all channels on.
    """
    kept = [db for db in (plan.selectivity.kept_db, plan.reuse.leak_db) if db is not None]
    coils = plan.coils.rows * plan.coils.columns
    rate = {f.scheme: f.frames_per_s for f in plan.refresh}[plan.selectivity.drive]
    return {
        "taxels": len(plan.taxels),
        "coils": coils,
        "channels": len(plan.channels),
        "scheme": plan.selectivity.drive,
        "selectivity_db": min(kept, default=None),
        "in_coil_db": plan.selectivity.kept_db,
        "leak_db": plan.reuse.leak_db,
        "one_hot_db": plan.selectivity.one_hot_db,
        "lowest_hz": plan.channels[0].resonance_hz,
        "highest_hz": max(c.resonance_hz for c in plan.channels),
        "frames_per_s": rate,
        "reachable_level_um": plan.load.reachable_level_um,
        "voltage_v": plan.load.voltage_peak_v,
        "power_w": plan.load.copper_loss_w * coils,
        "largest_print_spread": max(c.print_spread for c in plan.channels),
        "largest_sag_um": max(c.sag_um for c in plan.channels),
    }


def yield_figures(printed: "PrintYield") -> dict[str, Any]:
    """Shares of good prints, and what the median pad keeps."""
    return {
        "good_pads": printed.planned.pads.share,
        "good_pads_retuned": printed.retuned.pads.share,
        "good_taxels_retuned": printed.retuned.taxels.share,
        "median_retuned_db": printed.retuned.median_db,
    }


def build_figures(plan: "Plan", figures: dict[str, Any]) -> dict[str, Any]:
    """What was measured on the mesh, and about how long it prints."""
    spec, volume = plan.spec, float(figures["volume_mm3"])
    printer = spec.printer
    if printer.process == "resin":
        seconds = figures["size_mm"][2] / printer.layer_mm * RESIN_S_PER_LAYER
    else:
        seconds = volume / (printer.line_width_mm * printer.layer_mm * FDM_MM_PER_S)
    return {
        "plastic_g": figures["plastic_g"],
        "triangles": figures["triangles"],
        "print_min": seconds / 60,
        "off_plan_mm": figures.get("largest_difference_from_plan_mm"),
    }
