"""What several commands share: exit codes, the options of a model and of the output, progress, printing."""

import argparse
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from padgen.core.errors import plain

__all__ = [
    "BAD_INPUT",
    "CHECK_FAILED",
    "DONE",
    "add_model",
    "add_output",
    "add_spec",
    "add_verbose",
    "asked_of",
    "code_of",
    "end_as_by_ctrl_c",
    "folder_of",
    "progress_line",
    "show",
]

DONE, CHECK_FAILED, BAD_INPUT = 0, 1, 2
WIDTH = 100
"""Most columns of a text for people."""


def add_spec(parser: argparse.ArgumentParser) -> None:
    """The argument SPEC."""
    parser.add_argument("spec", metavar="SPEC", help="a TOML file, the name of a template, or a plan.json")


def add_model(parser: argparse.ArgumentParser) -> None:
    """Options that say where resonances come from."""
    parser.add_argument(
        "--model",
        metavar="beam|solid",
        help="how resonances are computed: by the beam model, or by finite elements of the printed solid, which then"
        " also tune the beams (default: as the spec says, or as the plan in the folder was made)",
    )
    parser.add_argument(
        "--tolerance",
        metavar="SHARE",
        help="largest relative error of a resonance, as 1%% or 0.01: where the beam model may be off by more, finite"
        " elements are solved",
    )


def add_verbose(parser: argparse.ArgumentParser, told: str = "all tables and notes") -> None:
    """The option that asks for all that is known."""
    parser.add_argument("--verbose", action="store_true", help=told)


def add_output(parser: argparse.ArgumentParser) -> None:
    """Options of the folder and of what standard output gets."""
    parser.add_argument("-o", "--output", metavar="DIR", help="folder of the results (default: out/NAME)")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def asked_of(options: argparse.Namespace, recorded: bool = True) -> tuple[Any, float | None]:
    """The spec with the model that the command line asks for, and the tolerance that it asks for, None without.

    Where it says nothing of a model, that of the plan in the results' folder is taken, if it is `recorded`.
    """
    from padgen.make.planning import recorded_spec, spec_of

    spec = spec_of(options.spec, {"model": {"structure": options.model}} if options.model is not None else None)
    if options.tolerance is not None:
        from padgen.ladders.study import parse_tolerance

        return spec, parse_tolerance(options.tolerance)
    return recorded_spec(spec, folder_of(options, spec.name)) if recorded and options.model is None else spec, None


def folder_of(options: argparse.Namespace, name: str) -> Path:
    """Where the results go."""
    given = getattr(options, "output", None)
    return Path(given) if given else Path("out") / name


def show(text: str) -> None:
    """Print for people, lines `plain`: sentences wrapped to a terminal, at most to `WIDTH`, and tables whole."""
    import textwrap

    width = WIDTH
    if sys.stdout.isatty():
        import shutil

        width = min(max(shutil.get_terminal_size().columns, 60), WIDTH)
    for line in map(plain, text.split("\n")):
        # Columns of a table stand two spaces apart.
        whole = len(line) <= width or "  " in line.strip()
        print(line if whole else textwrap.fill(line, width, break_on_hyphens=False, subsequent_indent="  "))


def code_of(findings: Any) -> int:
    """The exit code that findings ask for."""
    return CHECK_FAILED if any(finding.level == "error" for finding in findings) else DONE


def end_as_by_ctrl_c() -> None:
    """Let a request to end (SIGTERM), as by a queue, end this process as Ctrl-C does: what is done is kept."""
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))


@contextmanager
def progress_line(log: bool = False) -> Iterator[Any]:
    """A line that says what is being done, on a terminal; elsewhere nothing or, to `log`, a line for each step."""
    if not sys.stderr.isatty():
        yield lambda step: print(plain(step), file=sys.stderr, flush=True) if log else None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("")
        yield lambda step: bar.update(task, description=plain(step))
