"""The commands from a spec to a checked pad: plan, build and check; and templates, init and schema."""

import argparse
import json
from dataclasses import asdict
from typing import Any

from padgen.cli.common import (
    DONE,
    add_shared,
    add_spec,
    add_verbose,
    answer,
    asked_of,
    code_of,
    folder_of,
    progress_line,
    refuse,
    show,
)
from padgen.core.errors import FileError, plain
from padgen.core.registry import PAD_FORMATS, USUAL_FORMATS

__all__ = ["add_build", "add_check", "add_plan", "add_templates"]

MOST_PADS = 10_000_000
PLOT_FILE = "plan.svg"
SCHEMA_LINES = """#:schema ./padgen.schema.json
# padgen schema > padgen.schema.json makes that file; editors then complete this one, and check it.
"""


def add_plan(commands: Any) -> None:
    """Declare ``padgen plan`` and its options."""
    parser = commands.add_parser("plan", help="search coils, resonances and beams, and say whether the pad works")
    add_spec(parser)
    parser.add_argument(
        "--explain",
        action="store_true",
        help="what keeps a coil from one more channel, and what changes of the spec would gain",
    )
    parser.add_argument(
        "--yield",
        dest="pads",
        metavar="PADS",
        type=int,
        nargs="?",
        const=100_000,
        help="print the pad so many times in the computer (default: %(const)s) and say how many keep what is asked",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        help="start of the random numbers of --yield: the same seed gives the same figures (default: 0)",
    )
    parser.add_argument(
        "--plot",
        action="store_true",
        help=f"write {PLOT_FILE}: the pad to scale, which coils' prints suffer, resonances",
    )
    add_shared(parser, _plan)


def _plan(options: argparse.Namespace) -> int:
    from padgen.core.files import YIELD_FILE, OutputFolder, json_text
    from padgen.make.planning import plan_for
    from padgen.planner import plan_to_json

    refuse(
        (
            options.pads is not None and not 1 <= options.pads <= MOST_PADS,
            "--yield",
            f"must be 1 … {MOST_PADS} pads, got {options.pads}",
        ),
        (options.seed < 0, "--seed", f"must be 0 or more, got {options.seed}"),
    )
    explanation = printed = None
    with progress_line() as progress:
        plan = plan_for(*asked_of(options, recorded=False), progress)
        if options.explain:
            from padgen.planner.explain import explain_plan

            explanation = explain_plan(plan, progress)
        if options.pads:
            from padgen.planner.print_yield import print_yield

            progress(f"printing {options.pads} pads")
            printed = print_yield(plan, options.pads, options.seed)
    text = plan_to_json(plan)
    folder = folder_of(options, plan.name)
    with OutputFolder(folder) as out:
        out.write("plan.json", text)
        if printed:
            out.write(YIELD_FILE, json_text(asdict(printed)))
        if options.plot:
            from padgen.core.display import plot_bytes

            out.write(PLOT_FILE, plot_bytes(plan.plot(), "svg"))
        stale = out.commit()
    if options.json:
        parts = {"explain": explanation, "yield": printed}
        present = {key: asdict(part) for key, part in parts.items() if part}
        print(json_text({**json.loads(text), **present}) if present else text, end="")
    else:
        _print_plan(plan, explanation, printed, options.verbose)
        show(f"\nwritten: {plain(str(folder / 'plan.json'))}{''.join(f'  {name}' for name in out.names[1:])}")
        if stale:
            show(f"the other files in {plain(str(folder))} are of an earlier plan; padgen build makes them anew")
    return code_of(plan.findings)


def _print_plan(plan: Any, explanation: Any, printed: Any, verbose: bool) -> None:
    from padgen.report.plans import explanation_text, plan_text, serious_text, summary_text, yield_text

    show(summary_text(plan))
    if verbose:
        show(plan_text(plan))
    show(serious_text(plan.findings, verbose))
    if explanation:
        show(f"\n{explanation_text(explanation)}")
    if printed:
        show(f"\n{yield_text(printed)}")


def add_build(commands: Any) -> None:
    """Declare ``padgen build`` and its options."""
    parser = commands.add_parser("build", help="model the pad, check it, and write its files and its driver table")
    add_spec(parser)
    parser.add_argument(
        "--formats",
        default=",".join(USUAL_FORMATS),
        metavar="LIST",
        help=f"of {', '.join(PAD_FORMATS.names())} (default: %(default)s)",
    )
    parser.add_argument(
        "--parts",
        default="",
        metavar="LIST",
        help="parts beside the pad: tray (holds the coils), coupon (one taxel of each kind), coupon-tray",
    )
    parser.add_argument(
        "--instances", action="store_true", help="3MF with one mesh per distinct taxel, placed many times"
    )
    parser.add_argument("--report", action="store_true", help="also write report.html, the page that shows the pad")
    parser.add_argument("--force", action="store_true", help="build again even if nothing changed")
    add_shared(parser, _build, "all notes and the slicer's settings")


def add_check(commands: Any) -> None:
    """Declare ``padgen check`` and its options."""
    parser = commands.add_parser("check", help="whether an STL or 3MF prints, or what a slicer's G-code makes of a pad")
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
    from padgen.make.pad import Pad, parse_formats, parse_parts

    spec, tolerance = asked_of(options)
    formats, parts = parse_formats(options.formats), parse_parts(options.parts)
    with progress_line() as progress:
        pad = Pad(spec, parts, tolerance, progress=progress)
        built = pad.save(folder_of(options, spec.name), formats, options.instances, options.force, options.report)
    from padgen.report.plans import built_text

    following = f"next: print it, then padgen drive {plain(options.spec)} --state all --hear"
    table = {**asdict(built), "folder": str(built.folder)}
    answer(options, table, built_text(built, options.verbose), following)
    return code_of(built.findings)


def _check(options: argparse.Namespace) -> int:
    from padgen.api import check

    neither = "needs either a mesh or --gcode FILE; padgen check --help tells more"
    refuse(((options.mesh is None) == (options.gcode is None), "padgen check", neither))
    with progress_line() as progress:
        report = check(
            options.mesh or options.gcode, options.spec or None, gcode=options.mesh is None, progress=progress
        )
    from padgen.report.measured_prints import laid_text
    from padgen.report.plans import figures_text, held_line, serious_text

    serious = serious_text(report.findings, options.verbose)
    if options.mesh is None:
        texts = [laid_text(report, options.gcode, options.verbose), serious]
    else:
        texts = [held_line(f"{options.mesh} is read", report.findings), serious, figures_text(report.figures)]
    answer(options, asdict(report), *texts)
    return code_of(report.findings)


def add_templates(commands: Any) -> None:
    """Declare ``padgen templates``, ``padgen init`` and ``padgen schema``."""
    templates = commands.add_parser("templates", help="list the templates, or show one")
    templates.add_argument("name", metavar="NAME", nargs="?")
    templates.set_defaults(command=_templates, head="")
    init = commands.add_parser("init", help="copy a template to standard output")
    init.add_argument("name", metavar="NAME")
    init.set_defaults(command=_templates, head=SCHEMA_LINES)
    schema = commands.add_parser("schema", help="the JSON schema of a spec, for editors")
    schema.set_defaults(command=_schema)


def _templates(options: argparse.Namespace) -> int:
    from padgen.spec import template_paths
    from padgen.spec.fields import unknown_name

    texts = {name: path.read_text(encoding="utf-8") for name, path in template_paths().items()}
    if options.name and options.name not in texts:
        raise FileError(unknown_name(options.name, list(texts), "template", "").message, "NAME")
    listed = "".join(f"{name:<12}  {text.splitlines()[0].lstrip('# ')}\n" for name, text in texts.items())
    print(options.head + texts[options.name] if options.name else listed, end="")
    return DONE


def _schema(options: argparse.Namespace) -> int:
    from padgen.spec.load import spec_schema

    print(json.dumps(spec_schema(), indent=1, ensure_ascii=False))
    return DONE
