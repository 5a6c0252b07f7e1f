"""The command ``padgen plan``."""

import argparse
import json
from typing import Any

from padgen.cli.common import add_shared, add_spec, code_of, folder_of, plan_of, progress_line, refuse, show
from padgen.core.errors import plain

__all__ = ["add"]

MOST_PADS = 10_000_000
PLOT_FILE = "plan.svg"


def add(commands: Any) -> None:
    """Declare the command and its options."""
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
        plan = plan_of(options, progress, recorded=False)
        if options.explain:
            from padgen.planner.explain import explain_plan

            explanation = explain_plan(plan, progress)
        if options.pads:
            from padgen.planner.print_yield import print_yield

            progress(f"printing {options.pads} pads")
            printed = print_yield(plan, options.pads, options.seed)
    record = plan_to_json(plan)
    folder = folder_of(options, plan.name)
    with OutputFolder(folder) as out:
        out.write("plan.json", record)
        if printed:
            out.write(YIELD_FILE, json_text(printed))
        if options.plot:
            from padgen.core.display import plot_bytes

            out.write(PLOT_FILE, plot_bytes(plan.plot(), "svg"))
        stale = out.commit()
    if options.json:
        more = {key: part for key, part in (("explain", explanation), ("yield", printed)) if part}
        print(json_text(json.loads(record) | more), end="")
    else:
        from padgen.report.plans import explanation_text, plan_text, serious_text, summary_text, yield_text

        place = plain(str(folder))
        others = "".join(f"  {name}" for name in out.names[1:])
        for text in (
            summary_text(plan),
            plan_text(plan) if options.verbose else None,
            serious_text(plan.findings, options.verbose),
            f"\n{explanation_text(explanation)}" if explanation else None,
            f"\n{yield_text(printed)}" if printed else None,
            f"\nwritten: {plain(str(folder / 'plan.json'))}{others}",
            f"the other files in {place} are of an earlier plan; padgen build makes them anew" if stale else None,
        ):
            if text is not None:
                show(text)
    return code_of(plan.findings)
