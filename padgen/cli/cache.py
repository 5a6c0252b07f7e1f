"""The commands ``padgen cache info`` and ``padgen cache clear``."""

import argparse
import os
from pathlib import Path
from typing import Any

from padgen.cli.common import DONE, print_json, show

__all__ = ["add", "add_cache", "use_cache"]


def add(commands: Any) -> None:
    """Declare the commands and their options."""
    parser = commands.add_parser(
        "cache",
        help="what is kept of earlier runs, and dropping it",
        description="Results that are dear to compute (meshes of taxels, finite elements, optimised ladders) are kept"
        " in a folder, at most PADGEN_CACHE_MB megabytes (1024); those that were used longest ago go first.",
    )
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    for name, told in (("info", "where it is, and how much it holds"), ("clear", "drop everything in it")):
        action = actions.add_parser(name, help=told, description=told)
        add_cache(action)
        action.add_argument("--json", action="store_true", help="one JSON object on standard output")
        action.set_defaults(command=_cache, action=name)


def add_cache(parser: argparse.ArgumentParser) -> None:
    """Declare the option ``--cache``."""
    parser.add_argument(
        "--cache", metavar="DIR", help="folder of the cache (default: PADGEN_CACHE, else the user's cache folder)"
    )


def use_cache(options: argparse.Namespace) -> None:
    """Make this process and its children use the cache folder of ``--cache``, if that is given."""
    from padgen.core.cache import VARIABLE

    if options.cache:
        os.environ[VARIABLE] = str(Path(options.cache).absolute())


def _cache(options: argparse.Namespace) -> int:
    from padgen.core import cache

    use_cache(options)
    dropped = options.action == "clear"
    held = cache.clear() if dropped else cache.info()
    if options.json:
        from dataclasses import asdict

        kinds = {kind: {"entries": entries, "bytes": size} for kind, (entries, size) in held.kinds.items()}
        print_json({**asdict(held), "kinds": kinds, "cleared": dropped})
    else:
        from padgen.report.sweeps import cache_text

        show(cache_text(held, dropped))
    return DONE
