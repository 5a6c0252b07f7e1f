"""The command ``padgen calibrate``."""

import argparse
from pathlib import Path
from typing import Any

from padgen.cli.common import DONE, add_model, add_spec, asked_of, print_json, progress_line, show
from padgen.core.errors import SpecError, plain

__all__ = ["add"]


def add(commands: Any) -> None:
    """Declare the command and its options."""
    parser = commands.add_parser(
        "calibrate",
        help="find a printer's offsets and a material's modulus from measured prints",
        description="Fit how much thicker and wider a printer makes beams, and the modulus, to measured prints of SPEC;"
        ' a spec that says printer = "my-printer.toml" is then planned for that printer.',
    )
    add_spec(parser)
    parser.add_argument(
        "measured",
        metavar="MEASURED",
        nargs="+",
        help="what was measured, one for each print: a CSV, a WAV, or a folder of them",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        default="my-printer.toml",
        help="the printer's file that is written (default: my-printer.toml)",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    add_model(parser)
    parser.set_defaults(command=_calibrate)


def _calibrate(options: argparse.Namespace) -> int:
    path = Path(options.output)
    if path.suffix != ".toml":
        raise SpecError(f"must be a file of the kind my-printer.toml, got {options.output!r}", "--output")
    from padgen.api import calibrate
    from padgen.core.files import OutputFolder
    from padgen.make.planning import plan_for
    from padgen.measured.printer_fit import printer_toml

    spec, tolerance = asked_of(options, recorded=False)
    with progress_line() as progress:
        plan = plan_for(spec, tolerance, progress)
        progress("fitting")
        found = calibrate(plan, options.measured)
    with OutputFolder(path.parent) as out:
        out.write(path.name, printer_toml(plan.spec, found, path.stem))
        out.commit()
    if options.json:
        print_json(found)
        return DONE
    show(
        f"beams print {found.z_offset_mm:.4f} ± {found.z_offset_error_mm:.4f} mm thicker and"
        f" {found.width_offset_mm:.4f} ± {found.width_offset_error_mm:.4f} mm wider than drawn, of"
        f" {found.modulus_gpa:.3f} ± {found.modulus_error_gpa:.3f} GPa"
        f" ({found.prints} print{'s' * (found.prints > 1)}, {found.taxels} taxels, chi-square"
        f" {found.chi_square:.1f} of {found.freedom})"
    )
    show(f'written: {plain(str(path))}; printer = "{plain(path.name)}" in a spec beside it plans for this printer')
    return DONE
