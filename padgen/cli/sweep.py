"""The long commands ``padgen study`` and ``padgen sweep``, which keep what is done when they are stopped."""

import argparse
import signal
import sys
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from threading import Timer
from typing import Any

from padgen.api.pads import read_spec
from padgen.api.studies import read_sweep, run_sweep, study, study_extreme
from padgen.cli.common import (
    BAD_INPUT,
    CHECK_FAILED,
    DONE,
    add_option,
    add_output,
    answer,
    folder_of,
    progress_line,
    show,
    split_names,
)
from padgen.cli.small import add_cache, use_cache
from padgen.core.errors import plain
from padgen.core.rules import Rule, refuse

__all__ = ["add_study", "add_sweep"]

LONGEST_S = 1e6


def _end_as_by_ctrl_c() -> None:
    """Make SIGTERM, as a batch queue sends it, act like Ctrl-C, so that finished results are kept."""
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))


def add_study(commands: Any) -> None:
    """Declare ``padgen study`` and its options."""
    parser = commands.add_parser(
        "study",
        help="error against run time of every model behind a plan",
        description="Run every model behind a plan, each in a process of its own, and tell which is enough for which"
        " error. All ladders take some minutes; needs the extra padgen[study].",
    )
    parser.add_argument("spec", metavar="SPEC", nargs="?", help="a TOML file, the name of a template, or a plan.json")
    add_option(parser, study, "only", metavar="NAME,NAME", type=split_names)
    add_option(parser, study, "tolerance", metavar="SHARE")
    extreme_help = "compare every model with the error that it states, in extreme cases"
    parser.add_argument("--extreme", action="store_true", help=extreme_help)
    parser.add_argument(
        "--time-limit",
        metavar="SECONDS",
        type=float,
        help="stop after so long, as Ctrl-C does: the files have what was measured, and say what was not",
    )
    add_output(parser)
    parser.set_defaults(command=_study)


def _study(options: argparse.Namespace) -> int:
    limit_s = LONGEST_S if options.time_limit is None else options.time_limit
    is_of_a_spec = any(value is not None for value in (options.spec, options.only, options.tolerance))
    refuse(
        Rule(
            0 < limit_s <= LONGEST_S,
            "--time-limit",
            f"must be above 0 and at most {LONGEST_S:g} s, got {limit_s:g} s",
        ),
        Rule(
            options.extreme or options.spec is not None,
            "SPEC",
            "is missing; name a TOML file or a template, or ask for --extreme",
        ),
        Rule(
            not (options.extreme and is_of_a_spec),
            "--extreme",
            "has its own cases and takes no SPEC, --only or --tolerance",
        ),
    )
    _end_as_by_ctrl_c()
    timer = Timer(limit_s, interrupt_main)
    timer.daemon = True
    timer.start()
    try:
        done, folder = (_extreme if options.extreme else _ladders)(options)
    finally:
        timer.cancel()
    if options.json:
        print((folder / done.files[1]).read_text(encoding="utf-8"), end="")
    else:
        show(f"{done.text()}\n\nwritten to {plain(str(folder))}: {'  '.join(done.files)}")
    if done.missing:
        # Printed after the summary, since finished results are kept.
        count = len(done.missing)
        left = f"{count} of {done.total} {'cases' if options.extreme else 'models'} {'was' if count == 1 else 'were'}"
        print(f"padgen: stopped: {left} not run (marked in {done.files[0]})", file=sys.stderr)
        return BAD_INPUT
    return DONE if not options.extreme or done.holds else CHECK_FAILED


def _ladders(options: argparse.Namespace) -> Any:
    spec = read_spec(options.spec)
    folder = folder_of(options, spec.name)
    with progress_line(log=True) as progress:
        spec = read_spec(spec, folder=folder)
        done = study(spec, only=options.only, tolerance=options.tolerance, folder=folder, progress=progress)
    return done, folder


def _extreme(options: argparse.Namespace) -> Any:
    with progress_line(log=True) as progress:
        done = study_extreme(folder_of(options, "extreme"), progress=progress)
    return done, done.folder


def add_sweep(commands: Any) -> None:
    """Declare ``padgen sweep`` and its options."""
    parser = commands.add_parser(
        "sweep",
        help="many variants of a pad: an index, a folder each, the best of them",
        description="Make the variants that a sweep's TOML names, as many at a time as there are cores; finished ones"
        " are not made again. Exit code 1 if a variant failed (broke down, took too long); one whose spec no pad meets"
        " is refused, which is a result like another. docs/sweeps.md tells what a sweep may hold.",
    )
    parser.add_argument("sweep", metavar="SWEEP", help="a TOML file: a base spec, and what is varied")
    parser.add_argument("-j", "--jobs", metavar="N", type=int, help="processes at a time (default: one per core)")
    add_option(parser, run_sweep, "scheduler", metavar="ADDRESS")
    add_option(parser, run_sweep, "resume", action=argparse.BooleanOptionalAction)
    add_option(parser, run_sweep, "retry")
    add_cache(parser)
    parser.add_argument("-o", "--output", metavar="DIR", help="folder of the results (default: out/NAME)")
    parser.add_argument("--json", action="store_true", help="one JSON object a line: every event, then a summary")
    parser.set_defaults(command=_sweep)


def _sweep(options: argparse.Namespace) -> int:
    use_cache(options)
    from padgen.report.results import sweep_table, sweep_text

    _end_as_by_ctrl_c()
    sweep = read_sweep(options.sweep)
    folder = folder_of(options, sweep.settings.name)
    with _event_printer(options, sweep) as tell:
        result, files, note = run_sweep(
            sweep,
            folder,
            workers=options.jobs,
            scheduler=options.scheduler,
            resume=options.resume,
            retry=options.retry,
            on_event=tell,
        )
    shown_parts = sweep, replace(result, folder=folder), files
    if options.json:
        _line({**sweep_table(*shown_parts), "notes": [note] if note else []})
    else:
        again = "the same command with --retry makes the failed ones once more" if result.failed else ""
        answer(options, None, sweep_text(*shown_parts), f"note: {note}" if note else "", again)
    if result.stopped:
        # Printed after the summary, since finished variants are kept.
        without = "" if options.resume else " without --no-resume"
        print(f"padgen: {plain(result.stopped)}; the same command{without} goes on where it stopped", file=sys.stderr)
        return BAD_INPUT
    return CHECK_FAILED if result.failed else DONE


@contextmanager
def _event_printer(options: argparse.Namespace, sweep: Any) -> Iterator[Callable[[Any], None]]:
    """Yield a function that prints a sweep's events: with ``--json`` all, else failures (on a terminal, also a bar)."""
    if options.json:
        yield lambda event: _line(event.table())
        return
    if not sys.stderr.isatty():
        yield lambda event: _failure(sweep, event, lambda line: print(line, file=sys.stderr, flush=True))
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from padgen.core.display import seconds_text
    from padgen.report.results import counts_text

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True, highlight=False), transient=True) as bar:
        task = bar.add_task("", total=None)

        def tell(event: Any) -> None:
            left = f", {seconds_text(event.eta_s)} to go" if event.left and event.eta_s is not None else ""
            ended = event.total - event.left
            bar.update(task, total=event.total, completed=ended, description=f"{counts_text(event)}{left}")
            _failure(sweep, event, lambda line: bar.console.print(line, markup=False))

        yield tell


def _line(table: dict[str, Any]) -> None:
    """Print one line of JSON and flush it."""
    from padgen.core.files import json_line

    print(json_line(table), flush=True)


def _failure(sweep: Any, event: Any, write: Callable[[str], None]) -> None:
    if event.kind == "failed" and event.record is not None:
        before = " (in an earlier run)" if event.reused else ""
        write(f"failed{before}: {sweep.name_of(event.record.number)}: {plain(event.record.sentence)}")
