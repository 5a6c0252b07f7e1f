"""The small commands ``padgen cache``, ``restore``, ``templates``, ``init`` and ``schema``."""

import argparse
import json
from typing import Any

from padgen.api import house
from padgen.api.pads import template_names, template_text
from padgen.cli.common import DONE, answer
from padgen.core.errors import plain

__all__ = ["add", "add_cache", "use_cache"]

SCHEMA_LINES = """#:schema ./padgen.schema.json
# padgen schema > padgen.schema.json makes that file; editors then complete this one, and check it.
"""


def add(commands: Any) -> None:
    """Declare ``padgen cache``, ``restore``, ``templates``, ``init`` and ``schema`` with their options."""
    parser = commands.add_parser(
        "cache",
        help="show or clear what earlier runs left for speed",
        description="Results that are dear to compute (meshes of taxels, finite elements, optimised ladders) are kept"
        " in a folder, at most PADGEN_CACHE_MB megabytes (1024); those that were used longest ago go first.",
    )
    actions = parser.add_subparsers(title="actions", required=True, metavar="info|clear")
    for name, help_text in (("info", "where it is, and how much it holds"), ("clear", "drop everything in it")):
        action = actions.add_parser(name, help=help_text, description=help_text)
        add_cache(action)
        action.add_argument("--json", action="store_true", help="one JSON object on standard output")
        action.set_defaults(command=_cache, action=name)

    restore = commands.add_parser(
        "restore",
        help="put a folder back as it was before a run that was killed",
        description="Undo what a killed run had begun to change in a folder. Commands that write into the folder do so"
        " first; those that only read change nothing, and ask for this one.",
    )
    restore.add_argument("folder", metavar="DIR", help="folder of results")
    restore.add_argument("--json", action="store_true", help="one JSON object on standard output")
    restore.set_defaults(command=_restore)
    templates = commands.add_parser("templates", help="list the templates, or show one")
    templates.add_argument("name", metavar="NAME", nargs="?")
    templates.set_defaults(command=_templates, head="")
    init = commands.add_parser("init", help="copy a template to standard output")
    init.add_argument("name", metavar="NAME")
    init.set_defaults(command=_templates, head=SCHEMA_LINES)
    schema = commands.add_parser("schema", help="the JSON schema of a spec, for editors")
    schema.set_defaults(command=_schema)


def _templates(options: argparse.Namespace) -> int:
    if options.name:
        print(options.head + template_text(options.name), end="")
        return DONE
    names = template_names()
    longest = max(map(len, names))
    for name in names:
        print(f"{name:<{longest}}  {template_text(name).splitlines()[0].lstrip('# ')}")
    return DONE


def _restore(options: argparse.Namespace) -> int:
    is_restored = house.restore(options.folder)
    outcome = "is as it was before the run that was killed" if is_restored else "is whole; nothing was changed"
    answer(options, {"folder": options.folder, "restored": is_restored}, f"{plain(options.folder)} {outcome}")
    return DONE


def _schema(options: argparse.Namespace) -> int:
    print(json.dumps(house.spec_schema(), indent=1, ensure_ascii=False))
    return DONE


def add_cache(parser: argparse.ArgumentParser) -> None:
    """Declare the option ``--cache``."""
    parser.add_argument(
        "--cache", metavar="DIR", help="folder of the cache (default: PADGEN_CACHE, else the user's cache folder)"
    )


def use_cache(options: argparse.Namespace) -> None:
    """Make this process and its children use the cache folder of ``--cache``, if that is given."""
    if options.cache:
        house.use_cache(options.cache)


def _cache(options: argparse.Namespace) -> int:
    use_cache(options)
    dropped = options.action == "clear"
    held = house.clear_cache() if dropped else house.cache_info()
    from dataclasses import asdict

    from padgen.report.results import cache_text

    kinds = {kind: {"entries": entries, "bytes": size} for kind, (entries, size) in held.kinds.items()}
    answer(options, {**asdict(held), "kinds": kinds, "cleared": dropped}, cache_text(held, dropped))
    return DONE
