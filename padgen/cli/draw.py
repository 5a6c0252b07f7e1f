"""The command ``padgen draw``."""

import argparse
from pathlib import Path
from typing import Any

from padgen.api.pads import draw
from padgen.cli.common import (
    DONE,
    add_model,
    add_option,
    add_output,
    add_spec,
    answer,
    folder_of,
    plan_of,
    progress_line,
    split_names,
)
from padgen.core.errors import plain

__all__ = ["add"]


def add(commands: Any) -> None:
    """Declare ``padgen draw`` and its options."""
    parser = commands.add_parser(
        "draw",
        help="pictures that explain the pad, as SVG and PNG",
        description="Draw the pad from its plan: both sides with dimensions, a section through one taxel, the parts"
        " above each other, the ladder of resonances, the taxels' responses, selectivity, what prints keep, the"
        " wiring.",
    )
    add_spec(parser)
    add_option(parser, draw, "only", metavar="PICTURES", type=split_names)
    add_option(parser, draw, "formats", "--format", metavar="KINDS", type=split_names)
    add_model(parser)
    add_output(parser)
    parser.set_defaults(command=_draw)


def _draw(options: argparse.Namespace) -> int:
    with progress_line() as progress:
        plan = plan_of(options, progress)
        folder = Path(options.output or folder_of(options, plan.name) / "pictures")
        files = draw(plan, folder, only=options.only, formats=options.format, progress=progress)
    table = {"name": plan.name, "folder": str(folder), "files": files}
    answer(options, table, f"written to {plain(str(folder))}: {'  '.join(files)}")
    return DONE
