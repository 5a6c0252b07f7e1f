"""``padgen study``."""

import argparse
from typing import Any

from padgen.cli.common import CHECK_FAILED, DONE, add_output, folder_of, progress_line, show
from padgen.core.errors import SpecError, plain

__all__ = ["add"]

LADDER_NAMES = ("allocation", "structure", "force", "dynamics", "geometry", "pad")


def add(commands: Any) -> None:
    """Add the command."""
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
    add_output(parser)
    parser.set_defaults(command=_study)


def _study(options: argparse.Namespace) -> int:
    if options.extreme:
        return _extreme_study(options)
    if options.spec is None:
        raise SpecError("is missing; name a TOML file or a template, or ask for --extreme", "SPEC")
    from padgen.ladders import parse_only, parse_tolerance, run_study
    from padgen.ladders.study import STUDY_FILES
    from padgen.make.planning import plan_for, recorded_spec, spec_of

    tolerance = None if options.tolerance is None else parse_tolerance(options.tolerance)
    only, spec = parse_only(options.only), spec_of(options.spec)
    folder = folder_of(options, spec.name)
    with progress_line() as progress:
        plan = plan_for(recorded_spec(spec, folder), progress=progress)
        study = run_study(plan, folder, only, tolerance, progress)
    if options.json:
        print((folder / "study.json").read_text(encoding="utf-8"), end="")
    else:
        from padgen.ladders.text import study_text

        show(study_text(study))
        show(f"\nwritten to {plain(str(folder))}: {'  '.join(STUDY_FILES)}")
    return DONE


def _extreme_study(options: argparse.Namespace) -> int:
    if any(value is not None for value in (options.spec, options.only, options.tolerance)):
        raise SpecError("has its own cases and takes no SPEC, --only or --tolerance", "--extreme")
    from padgen.ladders import run_extreme

    with progress_line() as progress:
        study = run_extreme(folder_of(options, "extreme"), progress)
    if options.json:
        print((study.folder / "extreme.json").read_text(encoding="utf-8"), end="")
    else:
        from padgen.ladders.text import extreme_text

        show(extreme_text(study))
        show(f"\nwritten to {plain(str(study.folder))}: {'  '.join(study.files)}")
    return DONE if study.holds else CHECK_FAILED
