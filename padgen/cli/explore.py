"""The command ``padgen explore``."""

import argparse
import sys
from pathlib import Path
from typing import Any

from padgen.cli.common import DONE, refuse

__all__ = ["add"]

USUAL = "pad-32"
"""The template that is explored without a SPEC."""
USUAL_S = 20.0
LONGEST_S = 86_400.0


def add(commands: Any) -> None:
    """Declare the command and its options."""
    parser = commands.add_parser(
        "explore",
        help="turn the knobs of a spec in the browser and see at once what becomes of the pad",
        description="Serve the page of padgen report with a form of all fields of the spec, to this machine only. Every"
        " change plans anew; buttons write the spec and build the pad. Needs the extra padgen[explore].",
    )
    parser.add_argument(
        "spec", metavar="SPEC", nargs="?", help=f"a TOML file, a template or a plan.json (default: {USUAL})"
    )
    parser.add_argument("--port", metavar="N", type=int, default=0, help="port of the page (default: a free one)")
    parser.add_argument(
        "--time-limit",
        metavar="SECONDS",
        type=float,
        default=USUAL_S,
        help=f"give up a plan that takes longer (default: {USUAL_S:g})",
    )
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    parser.add_argument("-o", "--output", metavar="DIR", default="out", help="folder of specs and pads (default: out)")
    parser.set_defaults(command=_explore, late="spec")


def _explore(options: argparse.Namespace) -> int:
    limit_s = options.time_limit
    refuse(
        (not 0 <= options.port <= 65_535, "--port", f"must be 0 … 65535, got {options.port}"),
        (
            not 0 < limit_s <= LONGEST_S,
            "--time-limit",
            f"must be above 0 and at most {LONGEST_S:.0f} s, got {limit_s:g} s",
        ),
    )
    from padgen.report.live import serve

    def ready(address: str) -> None:
        print(f"{address}\nopen this address in a browser on this machine; Ctrl-C ends", flush=True)
        if not options.no_browser and sys.stdout.isatty():
            import webbrowser

            webbrowser.open(address)

    serve(options.spec or USUAL, Path(options.output), options.port, ready, limit_s)
    return DONE
