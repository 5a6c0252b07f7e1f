"""The command ``padgen draw``."""

import argparse
from pathlib import Path
from typing import Any

from padgen.cli.common import DONE, add_model, add_output, add_spec, answer, folder_of, plan_of, progress_line
from padgen.core.errors import plain
from padgen.core.registry import names_in

__all__ = ["add"]

NAMES = ("pad", "section", "exploded", "ladder", "responses", "selectivity", "prints", "wiring")
KINDS = ("svg", "png")


def add(commands: Any) -> None:
    """Declare the command and its options."""
    parser = commands.add_parser(
        "draw",
        help="pictures that explain the pad, as SVG and PNG",
        description="Draw the pad from its plan: both sides with dimensions, a section through one taxel, the parts"
        " above each other, the ladder of resonances, the taxels' responses, selectivity, what prints keep, the"
        " wiring.",
    )
    add_spec(parser)
    parser.add_argument("--only", metavar="PICTURES", help=f"some of {', '.join(NAMES)}, with commas between")
    parser.add_argument("--format", metavar="KINDS", default="svg,png", help="svg, png or both (default: %(default)s)")
    add_model(parser)
    add_output(parser)
    parser.set_defaults(command=_draw)


def _draw(options: argparse.Namespace) -> int:
    names = NAMES if options.only is None else names_in(options.only, NAMES, "--only")
    kinds = names_in(options.format, KINDS, "--format")
    from padgen import api

    with progress_line() as progress:
        plan = plan_of(options, progress)
        folder = Path(options.output or folder_of(options, plan.name) / "pictures")
        files = api.draw(plan, folder, only=names, formats=kinds, progress=progress)
    table = {"name": plan.name, "folder": str(folder), "files": files}
    answer(options, table, f"written to {plain(str(folder))}: {'  '.join(files)}")
    return DONE
