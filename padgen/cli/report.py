"""The command ``padgen report``."""

import argparse
from pathlib import Path
from typing import Any

from padgen.api.pads import write_report
from padgen.cli.common import add_model, add_output, answer, exit_code_of, folder_of, plan_of, progress_line
from padgen.core.errors import plain

__all__ = ["add"]


def add(commands: Any) -> None:
    """Declare ``padgen report`` and its options."""
    parser = commands.add_parser(
        "report",
        help="one page for the browser: the pad in 3-D, what each taxel does, how sure it is, what to order",
        description="Write report.html, one file that needs no network and no server. It shows the built pad where the"
        " folder has the build of this plan (padgen build), else the pad as the plan's dimensions give it.",
    )
    parser.add_argument("spec", metavar="SPEC", help="a TOML file, the name of a template, a plan.json, or a folder")
    add_model(parser)
    add_output(parser)
    parser.set_defaults(command=_report)


def _report(options: argparse.Namespace) -> int:
    given = Path(options.spec)
    with progress_line() as progress:
        if given.is_dir():
            reported = write_report(given, options.output or given, progress=progress)
        else:
            plan = plan_of(options, progress)
            source = folder_of(options, plan.name)
            reported = write_report(plan, options.output or source, source=source, progress=progress)
    from padgen.report.plans import findings_text, verdict_text

    plan = reported.plan
    shown = "the built pad" if reported.is_built else "the pad as planned; padgen build --report shows it as built"
    written = f"written: {plain(str(reported.file))}, {reported.size_bytes / 1e6:.2f} MB, with {shown}"
    table = {
        "verdict": plan.verdict,
        "file": str(reported.file),
        "built": reported.is_built,
        "bytes": reported.size_bytes,
    }
    errors = [finding for finding in reported.findings if finding.level == "error"]
    sections = [findings_text(errors)] if errors else []
    answer(options, table, verdict_text(plan.verdict), *sections, written)
    return exit_code_of(reported.findings)
