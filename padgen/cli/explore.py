"""The command ``padgen explore``."""

import argparse
import sys
from typing import Any

from padgen.api.pads import explore
from padgen.cli.common import DONE, add_option

__all__ = ["add"]

USUAL = "pad-32"
"""The template that is explored without a SPEC."""


def add(commands: Any) -> None:
    """Declare ``padgen explore`` and its options."""
    parser = commands.add_parser(
        "explore",
        help="turn the knobs of a spec in the browser and see at once what becomes of the pad",
        description="Serve the page of padgen report with a form of all fields of the spec, to this machine only. Every"
        " change plans anew; buttons write the spec and build the pad. Needs the extra padgen[explore].",
    )
    parser.add_argument(
        "spec", metavar="SPEC", nargs="?", help=f"a TOML file, a template or a plan.json (default: {USUAL})"
    )
    add_option(parser, explore, "port", metavar="N", type=int)
    add_option(parser, explore, "time_limit_s", "--time-limit", metavar="SECONDS", type=float)
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    parser.add_argument("-o", "--output", metavar="DIR", default="out", help="folder of specs and pads (default: out)")
    parser.set_defaults(command=_explore, late="spec")


def _explore(options: argparse.Namespace) -> int:
    def ready(address: str) -> None:
        print(f"{address}\nopen this address in a browser on this machine; Ctrl-C ends", flush=True)
        if not options.no_browser and sys.stdout.isatty():
            import webbrowser

            webbrowser.open(address)

    explore(options.spec or USUAL, options.output, port=options.port, time_limit_s=options.time_limit, on_ready=ready)
    return DONE
