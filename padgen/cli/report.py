"""The command ``padgen report``."""

import argparse
from contextlib import suppress
from pathlib import Path
from typing import Any

from padgen.cli.common import add_model, add_output, answer, code_of, folder_of, plan_of, progress_line
from padgen.core.errors import PadgenError, SpecError, plain

__all__ = ["add"]


def add(commands: Any) -> None:
    """Declare the command and its options."""
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
    from padgen.core.files import OutputFolder, read_as_one, recover
    from padgen.planner import plan_to_json

    given = Path(options.spec)
    with progress_line() as progress:
        if given.is_dir():
            if not options.output:
                recover(given)
            plan = _recorded(given)
            source = given
        else:
            plan = plan_of(options, progress)
            source = folder_of(options, plan.name)
        from padgen.report.page import REPORT_FILE, Page, study_of
        from padgen.report.plans import findings_text, verdict_text

        pad = read_as_one(source, lambda: _built(plan, source))
        progress("drawing the page")
        page = Page(plan, pad, study_of(source), _bill(source) if pad else "").html
        folder = Path(options.output) if options.output else source
        with OutputFolder(folder) as out:
            out.write("plan.json", plan_to_json(plan))
            out.write(REPORT_FILE, page)
            out.commit()
    findings = (*plan.findings, *(pad.check().findings if pad else ()))
    file = str(folder / REPORT_FILE)
    count = len(page.encode())
    shown = "the built pad" if pad else "the pad as planned; padgen build --report shows it as built"
    written = f"written: {plain(file)}, {count / 1e6:.2f} MB, with {shown}"
    table = {"verdict": plan.verdict, "file": file, "built": pad is not None, "bytes": count}
    errors = [finding for finding in findings if finding.level == "error"]
    sections = [findings_text(errors)] if errors else []
    answer(options, table, verdict_text(plan.verdict), *sections, written)
    return code_of(findings)


def _recorded(folder: Path) -> Any:
    """Return the plan of a folder in full precision: planned anew from its spec where that gives the same plan."""
    from padgen.core.files import differs, read_as_one
    from padgen.make.planning import plan_for, recorded_plan
    from padgen.planner import plan_to_json

    if not read_as_one(folder, (folder / "plan.json").exists, "plan.json"):
        raise SpecError("has no plan.json; name a spec, or a folder that padgen plan or build wrote", str(folder))
    plan = recorded_plan(folder / "plan.json")
    if plan.spec.model.structure != "solid":
        with suppress(PadgenError):
            again = plan_for(plan.spec)
            return plan if differs(folder, "plan.json", plan_to_json(again)) else again
    return plan


def _bill(folder: Path) -> str:
    """Return the bill of materials of the build in `folder`, which names the parts that were built with the pad."""
    from padgen.core.files import is_unchanged, read_bounded

    bill = "bom.csv"
    return (
        read_bounded(folder / bill, LARGEST_BILL, "a bill of materials").decode() if is_unchanged(folder, bill) else ""
    )


LARGEST_BILL = 1_000_000


def _built(plan: Any, folder: Path) -> Any:
    """Return the pad if `folder` has an unchanged build of this very plan, else None."""
    from padgen.core.files import built_files, differs, is_unchanged
    from padgen.make.pad import Pad
    from padgen.planner import plan_to_json

    names = ("plan.json", "checks.json")
    is_whole = names[1] in built_files(folder) and all(is_unchanged(folder, name) for name in names)
    return Pad(plan.spec, given=plan) if is_whole and not differs(folder, names[0], plan_to_json(plan)) else None
