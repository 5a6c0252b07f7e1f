"""The commands ``padgen build`` and ``padgen check``."""

import argparse
from typing import Any

from padgen.api.pads import build, check
from padgen.cli.common import (
    DONE,
    add_option,
    add_shared,
    add_spec,
    add_verbose,
    answer,
    exit_code_of,
    progress_line,
    spec_and_folder,
    split_names,
)
from padgen.core.errors import plain
from padgen.core.registry import PAD_FORMATS, USUAL_FORMATS
from padgen.core.rules import Rule, refuse

__all__ = ["add_build", "add_check"]


def add_build(commands: Any) -> None:
    """Declare ``padgen build`` and its options."""
    parser = commands.add_parser(
        "build",
        help="model the pad, check it, and write its files and its driver table",
        description="Plan the pad, model and check it, and write its folder: the files to print, order and drive it."
        " The format board is the printed circuit board of its coils, for KiCad and board houses.",
    )
    add_spec(parser)
    parser.add_argument(
        "--formats",
        type=split_names,
        default=USUAL_FORMATS,
        metavar="LIST",
        help=f"of {', '.join(PAD_FORMATS.names())} (default: {','.join(USUAL_FORMATS)})",
    )
    add_option(parser, build, "parts", metavar="LIST", type=split_names)
    parser.add_argument(
        "--instances", action="store_true", help="3MF with one mesh per distinct taxel, placed many times"
    )
    parser.add_argument("--report", action="store_true", help="also write report.html, the page that shows the pad")
    parser.add_argument("--force", action="store_true", help="build again even if nothing changed")
    add_shared(parser, _build, "all notes and the slicer's settings")


def add_check(commands: Any) -> None:
    """Declare ``padgen check`` and its options."""
    parser = commands.add_parser(
        "check",
        help="whether an STL or 3MF prints, or what a slicer's G-code makes of a pad",
        description="Measure a mesh and say whether it prints, and with --spec whether it is the pad of a plan; or say"
        " what a slicer's G-code would make of the pad. Nothing is written.",
    )
    parser.add_argument("mesh", metavar="MESH", nargs="?", help="an STL, 3MF, OBJ or PLY file")
    parser.add_argument(
        "--gcode",
        metavar="FILE",
        help="a slicer's G-code of the pad, instead of a mesh: what would be laid of it, beam by beam, at which"
        " frequency each taxel would resonate, and which settings to change; with --spec",
    )
    parser.add_argument(
        "--spec",
        metavar="SPEC",
        help="compare with the plan of this spec, the one recorded beside the mesh where it is of this spec, and take"
        " its printer's limits; a plan.json is taken as recorded",
    )
    add_verbose(parser, "all notes; of G-code, a line for each taxel")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.set_defaults(command=_check, late="mesh")


def _build(options: argparse.Namespace) -> int:
    spec, folder = spec_and_folder(options)
    with progress_line() as progress:
        pad = build(spec, parts=options.parts, tolerance=options.tolerance, progress=progress)
        built = pad.save(folder, options.formats, options.instances, options.force, options.report)
    from padgen.report.plans import built_text

    into = f" -o {plain(options.output)}" if options.output else ""
    drive = f"padgen drive {plain(options.spec)} --state all --hear{into}"
    is_whole = exit_code_of(built.findings) == DONE
    following = f"next: print and assemble it, then {drive}" if built.verdict.is_worth_printing and is_whole else ""
    answer(options, built, built_text(built, options.verbose), following)
    return exit_code_of(built.findings)


def _check(options: argparse.Namespace) -> int:
    is_one = (options.mesh is None) != (options.gcode is None)
    refuse(Rule(is_one, "padgen check", "needs either a mesh or --gcode FILE; padgen check --help tells more"))
    with progress_line() as progress:
        report = check(
            options.mesh or options.gcode, options.spec or None, gcode=options.mesh is None, progress=progress
        )
    from padgen.report.plans import figures_text, outcome_line, serious_text
    from padgen.report.results import laid_text

    serious = serious_text(report.findings, options.verbose)
    if options.mesh is None:
        texts = [laid_text(report, options.gcode, options.verbose), serious]
    else:
        texts = [outcome_line(f"{options.mesh} is read", report.findings), serious, figures_text(report.figures)]
    answer(options, report, *texts)
    return exit_code_of(report.findings)
