"""Slicer settings with which the pad prints as planned, by plain names and by those of PrusaSlicer and others."""

from collections.abc import Sequence
from typing import NamedTuple

from padgen import __version__
from padgen.core.errors import number
from padgen.core.files import json_text
from padgen.planner.plan import Beam, Plan
from padgen.planner.taxel_model import hollows_mm
from padgen.spec import Spec

__all__ = [
    "IN_ORCA",
    "ORCA_FILE",
    "OTHER_SLICERS_FILE",
    "PROFILE_FILE",
    "orca_text",
    "other_slicers_text",
    "print_settings",
    "profile_text",
    "prusa_profile",
    "shaping_profile",
]

PROFILE_FILE = "pad.ini"
ORCA_FILE = "pad-orca.json"
OTHER_SLICERS_FILE = "slicer-settings.txt"
NOZZLE_C = 215.0
BED_C = 60.0
"""Temperatures for a filament that states none: those of PLA."""


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
    material = spec.material
    hot = number(NOZZLE_C if material.nozzle_c is None else material.nozzle_c)
    bed = number(BED_C if material.bed_c is None else material.bed_c)
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


DEEP_MM = 0.6
"""Depth of a recess, ballast above it included, from which its walls make up much of a plate."""


def _wall_transition_angle(spec: Spec) -> str:
    """Return the largest wedge angle in degrees at which the slicer changes a wall from one printed line to two.

    With its usual 10 it lays two lines in walls round a recess where only one has room, which make plates with deep
    recesses 5 to 10 % heavy; with 59 some plates with flat recesses come out 1 % light (docs/printing.md).
    """
    return "59" if hollows_mm(spec)[-1][1] > DEEP_MM else "10"


def shaping_profile(spec: Spec) -> dict[str, str]:
    """Return the settings, under PrusaSlicer's names, that change where and how much plastic is laid."""
    profile = {key: value for setting in _settings(spec) for key, value in setting.prusa.items()}
    # With more than two perimeters the inner ones would hang free over the recesses. All further settings are
    # PrusaSlicer's defaults, written because a user's profile may have other values.
    return profile | {
        "perimeters": "2", "extra_perimeters": "1", "infill_every_layers": "1", "fill_angle": "45",
        "external_perimeters_first": "0", "overhangs": "1", "bridge_flow_ratio": "1",
        "extrusion_multiplier": "1", "gap_fill_enabled": "1", "min_feature_size": "25%", "min_bead_width": "85%",
        "wall_distribution_count": "1", "wall_transition_length": "100%",
        "wall_transition_angle": _wall_transition_angle(spec), "wall_transition_filter_deviation": "25%",
        "slice_closing_radius": "0.049", "slicing_mode": "regular",
        "resolution": "0", "gcode_resolution": "0.005", "fuzzy_skin": "none", "ironing": "0", "spiral_vase": "0",
    }  # fmt: skip


IN_ORCA = {
    "first_layer_height": "initial_layer_print_height",
    "perimeter_generator": "wall_generator",
    "extrusion_width": "line_width",
    "first_layer_extrusion_width": "initial_layer_line_width",
    "perimeter_extrusion_width": "inner_wall_line_width",
    "external_perimeter_extrusion_width": "outer_wall_line_width",
    "infill_extrusion_width": "sparse_infill_line_width",
    "solid_infill_extrusion_width": "internal_solid_infill_line_width",
    "top_infill_extrusion_width": "top_surface_line_width",
    "xy_size_compensation": "xy_contour_compensation",
    "thin_walls": "detect_thin_wall",
    "fill_density": "sparse_infill_density",
    "fill_pattern": "sparse_infill_pattern",
    "top_fill_pattern": "top_surface_pattern",
    "bottom_fill_pattern": "bottom_surface_pattern",
    "solid_infill_below_area": "minimum_sparse_infill_area",
    "top_solid_layers": "top_shell_layers",
    "bottom_solid_layers": "bottom_shell_layers",
    "infill_overlap": "infill_wall_overlap",
    "support_material": "enable_support",
    "perimeters": "wall_loops",
    "fill_angle": "infill_direction",
    "overhangs": "detect_overhang_wall",
    "bridge_flow_ratio": "bridge_flow",
    "extrusion_multiplier": "filament_flow_ratio",
    "gcode_resolution": "resolution",
    "ironing": "ironing_type",
    "spiral_vase": "spiral_mode",
}
"""Names that OrcaSlicer and Bambu Studio have for PrusaSlicer's settings, where they are others. Those of both stand in
the comments of Bambu Studio's G-code (2.4)."""
NOT_OF_ORCAS_PROCESS = (
    *("nozzle_diameter", "extra_perimeters", "infill_every_layers", "external_perimeters_first", "resolution"),
    *("extrusion_multiplier", "gap_fill_enabled", "ironing"),
)
"""Settings that they do not have, that are of their printers and filaments, or that have other values there."""


def orca_text(plan: Plan) -> str:
    """Return the text of a process preset for OrcaSlicer and Bambu Studio; empty for printers that lay no filament."""
    spec = plan.spec
    if spec.printer.process != "fdm":
        return ""
    shaping = shaping_profile(spec)
    ours = {IN_ORCA.get(key, key): value for key, value in shaping.items() if key not in NOT_OF_ORCAS_PROCESS}
    hole_mm = number(-spec.printer.xy_compensation_mm)
    name = f"padgen {plan.name}"
    preset = {"type": "process", "name": name, "print_settings_id": name, "from": "User", "inherits": ""}
    # Infill of 100 % is solid there. Thicknesses of shells would ask for more solid layers than the counts do.
    only_there = {
        "xy_hole_compensation": hole_mm, "internal_solid_infill_pattern": "concentric", "top_shell_thickness": "0",
        "bottom_shell_thickness": "0", "ironing_type": "no ironing", "brim_type": "no_brim", "print_flow_ratio": "1",
        "enable_arc_fitting": "0", "wall_sequence": "inner wall/outer wall", "skirt_loops": "0",
        "top_one_wall_type": "not apply", "only_one_wall_first_layer": "0",
    }  # fmt: skip
    return json_text(preset | ours | only_there)


def profile_text(plan: Plan) -> str:
    """Return the text of ``pad.ini``, for ``prusa-slicer --load``; empty for printers that do not lay filament."""
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
        f"PrusaSlicer takes all of them from {PROFILE_FILE}, OrcaSlicer and Bambu Studio from {ORCA_FILE} (File,"
        " Import, Import Configs), which no version was tried with. By the names of others (Cura's were tried with"
        " CuraEngine 4.13, the rest are untested):\n"
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
