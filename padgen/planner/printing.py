"""Slicer settings with which the pad prints as planned, by plain names and by those of PrusaSlicer and others."""

from collections.abc import Sequence
from typing import NamedTuple

from padgen import __version__
from padgen.core.errors import number
from padgen.planner.plan import Beam, Plan
from padgen.spec import Spec

__all__ = [
    "OTHER_SLICERS_FILE",
    "PROFILE_FILE",
    "other_slicers_text",
    "print_settings",
    "profile_text",
    "prusa_profile",
    "shaping_profile",
]

PROFILE_FILE = "pad.ini"
OTHER_SLICERS_FILE = "slicer-settings.txt"
TYPICAL_C = {"pla": (215, 60), "petg": (240, 80), "abs": (250, 100), "pa12": (255, 100)}
"""Typical temperatures of nozzle and bed for materials of the catalogue, by filament makers; others take PLA's."""


class Setting(NamedTuple):
    """A slicer setting: its plain `name` and `value`, PrusaSlicer's keys and values, its names in Cura and in Orca.

    A name in Cura or Orca with a colon contains its value; it is empty where the slicer has no such setting.
    """

    name: str
    value: str
    prusa: dict[str, str]
    cura: str
    orca: str


OF_EVERY_PRINTER = ("layer_height", "first_layer_height", "elephant_foot_compensation", "supports", "raft")
"""The settings that resin printers have, too; all others are of printers that lay filament."""


def _settings(spec: Spec) -> list[Setting]:
    """Return all settings that beams, plates, recesses or gaps depend on, the most important first."""
    printer = spec.printer
    layer, first, line, xy = (
        number(v) for v in (printer.layer_mm, printer.first_layer_mm, printer.line_width_mm, printer.xy_compensation_mm)
    )
    kinds = ("", "first_layer_", "perimeter_", "external_perimeter_", "infill_", "solid_infill_", "top_infill_")
    settings = [
        Setting("layer_height", f"{layer} mm", {"layer_height": layer}, "Layer Height", "Layer height"),
        Setting(
            "first_layer_height",
            f"{first} mm",
            {"first_layer_height": first},
            "Initial Layer Height",
            "First layer height",
        ),
        Setting(
            "wall_generator",
            "variable line width (Arachne)",
            {"perimeter_generator": "arachne"},
            "Variable line widths: always, from version 5.0",
            "Wall generator",
        ),
        Setting(
            "elephant_foot_compensation",
            "0 mm",
            {"elefant_foot_compensation": "0"},
            "Initial Layer Horizontal Expansion",
            "Elephant foot compensation",
        ),
        Setting("thick_bridges", "off", {"thick_bridges": "0"}, "", "Thick bridges"),
        Setting(
            "line_width", f"{line} mm", {f"{kind}extrusion_width": line for kind in kinds}, "Line Width", "Line width"
        ),
        Setting(
            "xy_size_compensation",
            f"{xy} mm",
            {"xy_size_compensation": xy},
            "Horizontal Expansion: 0 mm, as it lays lines without round edges",
            f"X-Y contour compensation: {xy} mm, X-Y hole compensation: -{xy} mm",
        ),
        Setting("detect_thin_walls", "off", {"thin_walls": "0"}, "Print Thin Walls", "Detect thin wall"),
        Setting(
            "infill",
            "100 %",
            {
                "fill_density": "100%", "fill_pattern": "concentric", "top_fill_pattern": "concentric",
                "bottom_fill_pattern": "concentric", "solid_infill_below_area": "0", "top_solid_layers": "1",
                "bottom_solid_layers": "1",
            },
            "Infill Density",
            "Sparse infill density",
        ),
        Setting(
            "infill_overlap",
            "0 %",
            {"infill_overlap": "0%"},
            "Infill Overlap Percentage, Skin Overlap Percentage",
            "Infill/Wall overlap",
        ),
        Setting("supports", "none", {"support_material": "0"}, "Generate Support", "Enable support"),
        Setting("raft", "none", {"raft_layers": "0", "brim_width": "0"}, "Build Plate Adhesion Type", "Raft layers"),
        Setting(
            "nozzle", f"{number(printer.nozzle_mm)} mm", {"nozzle_diameter": number(printer.nozzle_mm)}, "Nozzle Size",
            "Nozzle diameter",
        ),
    ]  # fmt: skip
    return [setting for setting in settings if printer.process == "fdm" or setting.name in OF_EVERY_PRINTER]


def print_settings(spec: Spec, beams: Sequence[Beam]) -> dict[str, str]:
    """Return slicer settings by plain name, the most important first: for the plan, a build's report and the 3MF."""
    return {
        **{setting.name: setting.value for setting in _settings(spec)},
        "printer": spec.printer.name,
        "material": spec.material.name,
        "beam_layers": ", ".join(str(n) for n in sorted({beam.layers for beam in beams})),
    }


def prusa_profile(spec: Spec) -> dict[str, str]:
    """Return a complete profile for PrusaSlicer, by its own names; empty for printers that do not lay filament.

    The settings that beams, plates and recesses depend on come first, then those typical of a printer and its filament.
    """
    printer = spec.printer
    if printer.process != "fdm":
        return {}
    hot, bed = (str(celsius) for celsius in TYPICAL_C.get(spec.material.name, TYPICAL_C["pla"]))
    x = number(printer.bed_x_mm)
    y = number(printer.bed_y_mm)
    return shaping_profile(spec) | {
        "skirts": "0", "filament_diameter": "1.75",
        "temperature": hot, "first_layer_temperature": hot, "bed_temperature": bed, "first_layer_bed_temperature": bed,
        "perimeter_speed": "30", "external_perimeter_speed": "20", "small_perimeter_speed": "15", "infill_speed": "40",
        "solid_infill_speed": "30", "top_solid_infill_speed": "20", "gap_fill_speed": "15", "bridge_speed": "20",
        "first_layer_speed": "15", "travel_speed": "120", "retract_length": "0.8", "slowdown_below_layer_time": "10",
        "gcode_flavor": "marlin", "bed_shape": f"0x0,{x}x0,{x}x{y},0x{y}", "max_print_height": number(printer.bed_z_mm),
    }  # fmt: skip


def shaping_profile(spec: Spec) -> dict[str, str]:
    """Return the settings for PrusaSlicer that change what is laid, by its own names."""
    profile = {key: value for setting in _settings(spec) for key, value in setting.prusa.items()}
    # With more than two perimeters the inner ones would hang free over the recesses. All further settings are
    # PrusaSlicer's defaults, written because a user's profile may have other values.
    return profile | {
        "perimeters": "2", "extra_perimeters": "1", "infill_every_layers": "1", "fill_angle": "45",
        "external_perimeters_first": "0", "overhangs": "1", "bridge_flow_ratio": "1",
        "extrusion_multiplier": "1", "gap_fill_enabled": "1", "min_feature_size": "25%", "min_bead_width": "85%",
        "wall_distribution_count": "1", "wall_transition_length": "100%", "wall_transition_angle": "10",
        "wall_transition_filter_deviation": "25%", "slice_closing_radius": "0.049", "slicing_mode": "regular",
        "resolution": "0", "gcode_resolution": "0.005", "fuzzy_skin": "none", "ironing": "0", "spiral_vase": "0",
    }  # fmt: skip


def profile_text(plan: Plan) -> str:
    """Return the text of the file for ``prusa-slicer --load``; empty where there is no such profile."""
    spec = plan.spec
    profile = prusa_profile(plan.spec)
    notes = {
        "layer_height": f"PrusaSlicer's settings for {plan.name} on {spec.printer.name} in {spec.material.name}, by"
        f" padgen {__version__}: prusa-slicer --load {PROFILE_FILE} pad.stl, or File, Import, Import Config.\n"
        "# Beams, plates, recesses and gaps depend on these:",
        "temperature": "Typical; take what your spool says. Add your printer's own start and end G-code.",
    }
    return "".join((f"# {notes[k]}\n" if k in notes else "") + f"{k} = {value}\n" for k, value in profile.items())


def other_slicers_text(plan: Plan) -> str:
    """Return the settings by other slicers' names, as text for people who set them by hand."""
    heading = (
        f"Settings for {plan.name} on {plan.spec.printer.name}, in the order in which they matter.\n"
        "Print flat, the recesses down, without supports.\n"
    )
    settings = _settings(plan.spec)
    if plan.spec.printer.process != "fdm":
        return heading + "".join(f"{each.name.replace('_', ' ')}: {each.value}\n" for each in settings)
    parts = [
        f"PrusaSlicer takes all of them from {PROFILE_FILE}. By the names of others (Cura's were tried with CuraEngine"
        " 4.13, the rest are untested):\n"
    ]
    for slicer, slicer_lines in (
        ("Cura", [each.cura for each in settings]),
        ("OrcaSlicer, Bambu Studio", [each.orca for each in settings]),
    ):
        lines = (
            f"  {name}" + (f": {each.value}" if ":" not in name else "")
            for name, each in zip(slicer_lines, settings, strict=True)
            if name
        )
        parts.append("\n".join((f"{slicer}:", *lines, "")))
    return "\n".join((heading, *parts))
