"""The command ``padgen plan``."""

import argparse
import json
from inspect import signature
from typing import Any

from padgen.api.pads import explain, print_yield, save_plan
from padgen.api.pads import plan as plan_pad
from padgen.cli.common import (
    add_option,
    add_shared,
    add_spec,
    exit_code_of,
    progress_line,
    show,
    spec_and_folder,
)
from padgen.core.errors import plain
from padgen.core.rules import Rule, refuse

__all__ = ["add"]


def add(commands: Any) -> None:
    """Declare ``padgen plan`` and its options."""
    parser = commands.add_parser(
        "plan",
        help="search coils, resonances and beams, and say whether the pad works",
        description="Search coils, resonances and beams for a pad, say whether it works and what would help, and write"
        " plan.json.",
    )
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
        const=signature(print_yield).parameters["pads"].default,
        help="print the pad so many times in the computer (default: %(const)s) and say how many keep what is asked",
    )
    add_option(parser, print_yield, "seed", type=int)
    add_option(parser, save_plan, "plot")
    add_shared(parser, _plan)


def _plan(options: argparse.Namespace) -> int:
    from padgen.core.files import json_text

    refuse(Rule(options.pads is not None or options.seed == 0, "--seed", "is for --yield"))
    explanation = None
    printed = None
    with progress_line() as progress:
        spec, folder = spec_and_folder(options, recorded=False)
        plan = plan_pad(spec, tolerance=options.tolerance, progress=progress)
        if options.explain:
            explanation = explain(plan, spec, progress=progress)
        if options.pads is not None:
            progress(f"printing {options.pads} pads")
            printed = print_yield(plan, options.pads, options.seed)
    saved = save_plan(plan, folder, printed=printed, plot=options.plot)
    if options.json:
        more = {key: part for key, part in (("explain", explanation), ("yield", printed)) if part}
        print(json_text(json.loads(saved.plan_json) | more), end="")
    else:
        from padgen.report.plans import explanation_text, plan_text, serious_text, summary_text, yield_text

        place = plain(str(folder))
        others = "".join(f"  {name}" for name in saved.files[1:])
        for text in (
            summary_text(plan),
            plan_text(plan) if options.verbose else None,
            serious_text(plan.findings, options.verbose),
            f"\n{explanation_text(explanation)}" if explanation else None,
            f"\n{yield_text(printed)}" if printed else None,
            f"\nwritten: {plain(str(folder / 'plan.json'))}{others}",
            f"the other files in {place} are of an earlier plan; padgen build makes them anew"
            if saved.is_stale
            else None,
        ):
            if text is not None:
                show(text)
    return exit_code_of(plan.findings)
