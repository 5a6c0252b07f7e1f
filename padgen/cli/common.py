"""Share exit codes, options, progress and printing between commands."""

import argparse
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from padgen.core.errors import FileError, plain

__all__ = [
    "BAD_INPUT",
    "CHECK_FAILED",
    "DONE",
    "add_model",
    "add_option",
    "add_output",
    "add_shared",
    "add_spec",
    "add_verbose",
    "answer",
    "exit_code_of",
    "folder_of",
    "plan_of",
    "progress_line",
    "show",
    "spec_and_folder",
    "split_names",
]

DONE = 0
CHECK_FAILED = 1
BAD_INPUT = 2
WIDTH = 100
"""Most columns of printed text, tables excepted."""


def add_option(parser: Any, function: Callable[..., Any], parameter: str, flag: str = "", **settings: Any) -> None:
    """Declare the command-line option of a function's parameter, with its default and its docstring's text as help.

    The option is `flag`, by default the parameter's name. A parameter that is False by default is a switch.
    """
    default = inspect.signature(function).parameters[parameter].default
    text = described(function, parameter)
    if default is False:
        settings["action"] = "store_true"
    elif default is not inspect.Parameter.empty:
        settings["default"] = default
        if default not in (None, "", ()) and "default" not in text:
            text = f"{text} (default: {','.join(default) if isinstance(default, tuple) else default})"
    action = parser.add_argument(flag or f"--{parameter.replace('_', '-')}", help=text.replace("%", "%%"), **settings)
    action.parameter = f"{function.__name__}.{parameter}"


def described(function: Callable[..., Any], parameter: str) -> str:
    """Return what a function's docstring says of a parameter, as a clause.

    >>> def play(repeat): "Play.\\n\\nParameters\\n---\\nrepeat : int\\n    Times that it is played."
    >>> described(play, "repeat")
    'times that it is played'
    """
    lines = inspect.getdoc(function) or ""
    paragraph = re.search(rf"^(?:\w+, )*{parameter}(?:, \w+)* : .*\n((?: +.*\n?)+)", lines, re.MULTILINE)
    assert paragraph, f"{function.__name__} does not say what {parameter} is"
    text = " ".join(paragraph[1].split()).removesuffix(".")
    return text if text[:2].isalpha() and text[:2].isupper() else text[0].lower() + text[1:]


def add_spec(parser: argparse.ArgumentParser) -> None:
    """Declare the argument SPEC."""
    parser.add_argument("spec", metavar="SPEC", help="a TOML file, the name of a template, or a plan.json")


def add_model(parser: argparse.ArgumentParser, in_folder: bool = True) -> None:
    """Declare ``--model`` and ``--tolerance``; if `in_folder`, the help says that a recorded plan sets the default."""
    recorded = ", or as the plan in the folder was made" if in_folder else ""
    parser.add_argument(
        "--model",
        metavar="auto|beam|solid",
        help="how resonances are computed. beam: by the beam model; solid: by finite elements of the printed solid, to"
        " which the beams are then tuned (slower); auto: by the beam model, or with --tolerance by finite elements"
        f" where the beam model may be off by more (default: as the spec says{recorded})",
    )
    parser.add_argument(
        "--tolerance",
        metavar="SHARE",
        help="largest relative error of a resonance, as 1%% or 0.01: where the beam model may be off by more, finite"
        " elements are solved, or with --model beam a warning says so",
    )


def add_verbose(parser: argparse.ArgumentParser, shown: str = "all tables and notes") -> None:
    """Declare the option ``--verbose``, with `shown` as its help."""
    parser.add_argument("--verbose", action="store_true", help=shown)


def add_output(parser: argparse.ArgumentParser) -> None:
    """Declare the options ``--output`` and ``--json``."""
    parser.add_argument("-o", "--output", metavar="DIR", help="folder of the results (default: out/NAME)")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def add_shared(
    parser: argparse.ArgumentParser, run: Any, verbose: str = "all tables and notes", late: Any = None
) -> None:
    """Declare the options that commands on a plan share, and set `run`, the function of this command.

    `late` is the name of a positional that may follow an option.
    """
    add_verbose(parser, verbose)
    add_model(parser)
    add_output(parser)
    parser.set_defaults(command=run, late=late)


def split_names(text: str) -> tuple[str, ...]:
    """Return the names in a comma-separated text."""
    return tuple(text.split(","))


def spec_and_folder(options: argparse.Namespace, recorded: bool = True) -> tuple[Any, Path]:
    """Return the spec with the model that the command line asks for, and the folder of the results.

    If the command line asks for none and `recorded` is true, the spec has the model of the plan in that folder.
    """
    from padgen.api.house import restore
    from padgen.api.pads import read_spec

    fields: dict[str, Any] = {} if options.model is None else {"model": {"structure": options.model}}
    spec = read_spec(options.spec, **fields)
    folder = folder_of(options, spec.name)
    if recorded and options.model is None and options.tolerance is None:
        if hasattr(options, "output") and folder.is_dir():  # of commands that are about to write there
            restore(folder)
        spec = read_spec(spec, folder=folder)
    return spec, folder


def plan_of(options: argparse.Namespace, progress: Any, recorded: bool = True) -> Any:
    """Plan what the command line asks for; if `recorded`, the model defaults to that of the plan in the folder."""
    from padgen.api.pads import plan

    return plan(spec_and_folder(options, recorded)[0], tolerance=options.tolerance, progress=progress)


def folder_of(options: argparse.Namespace, name: str) -> Path:
    """Return the folder of the results: that of ``--output``, else ``out/NAME``.

    Raises
    ------
    FileError
        The latter is a link, which may be a stranger's.
    """
    given = getattr(options, "output", None)
    if given:
        return Path(given)
    folder = Path("out") / name
    for path in (folder.parent, folder):
        if path.is_symlink():
            raise FileError(f"is a link to {path.readlink()}; name the folder of the results with -o", str(path))
    return folder


def show(text: str, stream: Any = None) -> None:
    """Print text for people: control characters escaped, sentences wrapped to at most `WIDTH` columns, tables whole."""
    import textwrap

    width = WIDTH
    if sys.stdout.isatty():
        import shutil

        width = min(max(shutil.get_terminal_size().columns, 60), WIDTH)
    for line in map(plain, text.split("\n")):
        # A line with two spaces in a row is one of a table.
        whole = len(line) <= width or "  " in line.strip()
        wrapped = line if whole else textwrap.fill(line, width, break_on_hyphens=False, subsequent_indent="  ")
        print(wrapped, file=stream)


def answer(options: argparse.Namespace, table: Any, *texts: str) -> None:
    """Print a command's answer: with ``--json`` the table (plain data or dataclasses), else the texts for people."""
    if options.json:
        from padgen.core.files import json_text

        print(json_text(table), end="")
        return
    for text in filter(None, texts):
        show(text)


def exit_code_of(findings: Any) -> int:
    """Return the exit code for findings: `CHECK_FAILED` if one is an error, else `DONE`."""
    return CHECK_FAILED if any(finding.level == "error" for finding in findings) else DONE


@contextmanager
def progress_line(log: bool = False) -> Iterator[Any]:
    """Yield a function that shows each step: on a terminal in one updated line; elsewhere, if `log`, on a new line.

    A step that knows its share (`core.display.Step`) has a bar.
    """
    if not sys.stderr.isatty():
        yield lambda step: print(plain(step), file=sys.stderr, flush=True) if log else None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, Task, TextColumn, TimeElapsedColumn

    class ShareColumn(BarColumn):
        """A progress bar that shows nothing while it is unknown which share of the step is done."""

        def render(self, task: Task) -> Any:
            return "" if task.total is None else super().render(task)

    text = TextColumn("{task.description}", markup=False)
    columns = (SpinnerColumn(), text, ShareColumn(bar_width=20), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)

        def tell(step: str) -> None:
            share = getattr(step, "share", None)
            # A total of None means "unknown", but rich takes it for "unchanged" in an update.
            bar.tasks[0].total = None if share is None else 1.0
            bar.update(task, description=plain(step), completed=share or 0.0)

        yield tell
