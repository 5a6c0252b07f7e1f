"""The command ``padgen study``."""

import argparse
import sys
from _thread import interrupt_main
from threading import Timer
from typing import Any

from padgen.cli.common import (
    BAD_INPUT,
    CHECK_FAILED,
    DONE,
    add_output,
    end_as_by_ctrl_c,
    folder_of,
    progress_line,
    show,
)
from padgen.core.errors import SpecError, plain

__all__ = ["add"]

LONGEST_S = 1e6
LADDER_NAMES = ("allocation", "structure", "force", "dynamics", "geometry", "pad")


def add(commands: Any) -> None:
    """Declare the command and its options."""
    parser = commands.add_parser(
        "study",
        help="error against run time of every model behind a plan",
        description="Run every model behind a plan, each in a process of its own, and tell which is enough for which"
        " error. All ladders take some minutes; needs the extra padgen[study].",
    )
    parser.add_argument("spec", metavar="SPEC", nargs="?", help="a TOML file, the name of a template, or a plan.json")
    parser.add_argument("--only", metavar="LADDERS", help=f"some of {', '.join(LADDER_NAMES)}, with commas between")
    parser.add_argument("--tolerance", metavar="SHARE", help="recommend for this relative error too, as 1%% or 0.01")
    parser.add_argument("--extreme", action="store_true", help="hold every model to what it states in extreme cases")
    parser.add_argument(
        "--time-limit",
        metavar="SECONDS",
        type=float,
        help="stop after so long, as Ctrl-C does: the files have what was measured, and say what was not",
    )
    add_output(parser)
    parser.set_defaults(command=_study)


def _study(options: argparse.Namespace) -> int:
    limit_s = options.time_limit
    if limit_s is not None and not 0 < limit_s <= LONGEST_S:
        raise SpecError(f"must be above 0 and at most {LONGEST_S:g} s, got {limit_s:g} s", "--time-limit")
    if not options.extreme and options.spec is None:
        raise SpecError("is missing; name a TOML file or a template, or ask for --extreme", "SPEC")
    if options.extreme and any(value is not None for value in (options.spec, options.only, options.tolerance)):
        raise SpecError("has its own cases and takes no SPEC, --only or --tolerance", "--extreme")
    end_as_by_ctrl_c()
    timer = Timer(limit_s or LONGEST_S, interrupt_main)
    timer.daemon = True
    timer.start()
    try:
        study, text, folder, files = (_extreme if options.extreme else _ladders)(options)
    finally:
        timer.cancel()
    if options.json:
        print((folder / files[1]).read_text(encoding="utf-8"), end="")
    else:
        show(text(study))
        show(f"\nwritten to {plain(str(folder))}: {'  '.join(files)}")
    if study.missing:
        # Printed after the summary, since finished results are kept.
        print(f"padgen: stopped: {len(study.missing)} were not run; the files say which", file=sys.stderr)
        return BAD_INPUT
    return DONE if not options.extreme or study.holds else CHECK_FAILED


def _ladders(options: argparse.Namespace) -> Any:
    from padgen.ladders.study import STUDY_FILES, parse_only, run_study, study_text
    from padgen.make.planning import parse_tolerance, plan_for, recorded_spec, spec_of

    tolerance = None if options.tolerance is None else parse_tolerance(options.tolerance)
    only, spec = parse_only(options.only), spec_of(options.spec)
    folder = folder_of(options, spec.name)
    with progress_line(log=True) as progress:
        plan = plan_for(recorded_spec(spec, folder), progress=progress)
        return run_study(plan, folder, only, tolerance, progress), study_text, folder, STUDY_FILES


def _extreme(options: argparse.Namespace) -> Any:
    from padgen.ladders.study import extreme_text, run_extreme

    with progress_line(log=True) as progress:
        study = run_extreme(folder_of(options, "extreme"), progress)
    return study, extreme_text, study.folder, study.files
