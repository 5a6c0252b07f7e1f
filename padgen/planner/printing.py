"""What the slicer must be told so that the pad prints as planned."""

from collections.abc import Sequence

from padgen.core.errors import number
from padgen.planner.plan import Beam
from padgen.spec import Spec

__all__ = ["print_settings"]


def print_settings(spec: Spec, beams: Sequence[Beam]) -> dict[str, str]:
    """Slicer settings by plain name, for the plan, what a build tells, the 3MF's metadata and the docs."""
    printer = spec.printer
    settings = {
        "printer": printer.name,
        "material": spec.material.name,
        "layer_height": f"{number(printer.layer_mm)} mm",
        "first_layer_height": f"{number(printer.first_layer_mm)} mm",
        "supports": "none",
        "raft": "none",
        "elephant_foot_compensation": "0 mm",
    }
    if printer.process == "fdm":
        settings |= {
            "nozzle": f"{number(printer.nozzle_mm)} mm",
            "line_width": f"{number(printer.line_width_mm)} mm",
            "wall_generator": "variable line width (Arachne)",
            "xy_size_compensation": f"{number(printer.xy_compensation_mm)} mm",
            "detect_thin_walls": "off",
            "infill": "100 %",
            "infill_overlap": "0 %",
            "thick_bridges": "off",
        }
    layers = sorted({beam.layers for beam in beams})
    settings["beam_layers"] = ", ".join(str(n) for n in layers)
    return settings
