"""Settings with which Sphinx builds the documentation site (`make docs`), and its pages that are made from the code."""

import argparse
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from padgen import __version__  # noqa: E402
from padgen.core.errors import number  # noqa: E402

project = "padgen"
author = "the developers of padgen"
copyright = "the developers of padgen, Apache-2.0"
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
exclude_patterns = ["examples", "__pycache__"]
html_theme = "furo"
html_title = f"padgen {__version__}"
html_copy_source = html_show_sphinx = False
html_extra_path = ["generated/extra"]
autodoc_member_order = "bysource"
autodoc_typehints = "none"
add_module_names = False
GENERATED = HERE / "generated"
(GENERATED / "extra").mkdir(parents=True, exist_ok=True)


def setup(app: Any) -> None:
    app.connect("builder-inited", generate)


def generate(app: Any) -> None:
    """Write the pages that come from the code: commands, fields of a spec, catalogues, and the gallery."""
    pages = {"commands": commands(), "fields": spec_fields(), "catalogues": catalogues(), "gallery": gallery()}
    for name, text in pages.items():
        path = GENERATED / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def commands() -> str:
    """Return every command with its help, as ``padgen COMMAND --help`` prints it."""
    from padgen.cli import _parser as parser

    told = [
        "# Commands",
        "",
        "Exit codes: 0 done and every check holds; 1 done, but a check fails; 2 bad input or usage.",
    ]
    every = next(a for a in parser([])._actions if isinstance(a, argparse._SubParsersAction))
    for name, command in every.choices.items():
        command.formatter_class = lambda prog: argparse.HelpFormatter(prog, width=96)
        told += ["", f"## padgen {name}", "", "```text", command.format_help().rstrip(), "```"]
    return "\n".join(told) + "\n"


def spec_fields() -> str:
    """Return every field of a spec with its bounds, default and meaning, from the schema that also checks it."""
    from padgen.spec.load import spec_schema

    schema = spec_schema()
    told = ["# Fields of a spec", "", "`padgen schema` prints the same for editors."]
    tables = {"at the top": {k: v for k, v in schema["properties"].items() if "properties" not in _table(v)}}
    tables |= {f"[{k}]": _table(v)["properties"] for k, v in schema["properties"].items() if "properties" in _table(v)}
    for title, fields in tables.items():
        told += ["", f"## {title}", "", "| field | may be | default | meaning |", "|---|---|---|---|"]
        for name, field in fields.items():
            default = field.get("default", "")
            told.append(f"| `{name}` | {_bounds(field)} | {default} | {_cell(field.get('description', ''))} |")
    return "\n".join(told) + "\n"


def _table(field: dict[str, Any]) -> dict[str, Any]:
    return next((each for each in field.get("anyOf", ()) if "properties" in each), field)


def _bounds(field: dict[str, Any]) -> str:
    if words := field.get("enum"):
        return ", ".join(f"`{word}`" for word in words)
    kind = field.get("type", "")
    if kind == "array":
        return f"list: {_bounds(field['items'])}"
    if kind in ("number", "integer"):
        low = field.get("minimum", field.get("exclusiveMinimum", 0))
        above = "above " if "exclusiveMinimum" in field else ""
        return f"{'whole number, ' * (kind == 'integer')}{above}{number(low)} … {number(field['maximum'])}"
    return {"string": "text", "boolean": "true or false"}.get(kind, kind)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")


def catalogues() -> str:
    """Return the catalogues of parts as tables, with their sources."""
    import csv

    told = ["# Catalogues", "", 'A spec names an entry (`washer = "iso7089-m2"`) or overrides its fields.']
    for path in sorted((HERE.parent / "padgen" / "spec" / "catalogue").glob("*.csv")):
        with path.open(encoding="utf-8", newline="") as file:
            head, *rows = csv.reader(file)
        told += ["", f"## {path.stem}", "", f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
        told += [f"| {' | '.join(map(_cell, row))} |" for row in rows]
    return "\n".join(told) + "\n"


def gallery() -> str:
    """Plan every template; return its verdict and pictures, and write its report beside the site."""
    from padgen import plan, template_names
    from padgen.core.display import plot_bytes
    from padgen.report.charts import picture
    from padgen.report.page import page_data, page_html
    from padgen.report.plans import pad_line
    from padgen.spec import template_paths

    told = [
        "# Gallery of templates",
        "",
        "`padgen build NAME` makes any of them; the reports open in a browser and work offline.",
    ]
    for name in template_names():
        made = plan(name)
        (GENERATED / f"{name}.svg").write_bytes(plot_bytes(picture(made, "pad"), "svg"))
        report = GENERATED / "extra" / f"{name}.html"
        report.write_text(page_html(page_data(made)), encoding="utf-8")
        about = template_paths()[name].read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        told += ["", f"## {name}", "", _cell(about), "", f"![{name} from both sides]({name}.svg)", ""]
        told += [
            _cell(made.verdict.sentence),
            "",
            _cell(pad_line(made)),
            "",
            f'<a href="../{name}.html">the whole report of {name}</a>',
        ]
    return "\n".join(told) + "\n"
