"""The small commands ``padgen templates``, ``padgen init`` and ``padgen schema``."""

import argparse
import json
from typing import Any

from padgen.cli.common import DONE
from padgen.core.errors import FileError

__all__ = ["add"]

SCHEMA_LINES = """#:schema ./padgen.schema.json
# padgen schema > padgen.schema.json makes that file; editors then complete this one, and check it.
"""


def add(commands: Any) -> None:
    """Declare the commands and their options."""
    templates = commands.add_parser("templates", help="list the templates, or show one")
    templates.add_argument("name", metavar="NAME", nargs="?")
    templates.set_defaults(command=_templates)

    init = commands.add_parser("init", help="copy a template to standard output")
    init.add_argument("name", metavar="NAME")
    init.set_defaults(command=_init)

    schema = commands.add_parser("schema", help="the JSON schema of a spec, for editors")
    schema.set_defaults(command=_schema)


def _templates(options: argparse.Namespace) -> int:
    from padgen.spec import template_paths

    if options.name:
        print(_template(options.name), end="")
        return DONE
    for name, path in template_paths().items():
        first = path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        print(f"{name:<12}  {first}")
    return DONE


def _init(options: argparse.Namespace) -> int:
    print(SCHEMA_LINES + _template(options.name), end="")
    return DONE


def _template(name: str) -> str:
    from padgen.spec.fields import unknown_name
    from padgen.spec.load import template_paths

    templates = template_paths()
    if name not in templates:
        raise FileError(unknown_name(name, list(templates), "template", "").message, "NAME")
    return templates[name].read_text(encoding="utf-8")


def _schema(options: argparse.Namespace) -> int:
    from padgen.spec.load import spec_schema

    print(json.dumps(spec_schema(), indent=1, ensure_ascii=False))
    return DONE
