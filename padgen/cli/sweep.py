"""The long commands ``padgen study`` and ``padgen sweep``, which keep what is done when they are stopped."""

import argparse
import signal
import sys
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from threading import Timer
from typing import Any

from padgen.cli.common import BAD_INPUT, CHECK_FAILED, DONE, add_output, answer, folder_of, progress_line, refuse, show
from padgen.cli.small import add_cache, use_cache
from padgen.core.errors import plain

__all__ = ["add_study", "add_sweep"]

LONGEST_S = 1e6
LADDER_NAMES = ("allocation", "structure", "force", "dynamics", "geometry", "pad")
MOST_WORKERS = 1024


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
    parser.add_argument("--only", metavar="LADDERS", help=f"some of {', '.join(LADDER_NAMES)}, with commas between")
    parser.add_argument("--tolerance", metavar="SHARE", help="recommend for this relative error too, as 1%% or 0.01")
    parser.add_argument("--extreme", action="store_true", help="hold every model to what it states in extreme cases")
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
        (
            not 0 < limit_s <= LONGEST_S,
            "--time-limit",
            f"must be above 0 and at most {LONGEST_S:g} s, got {limit_s:g} s",
        ),
        (
            not options.extreme and options.spec is None,
            "SPEC",
            "is missing; name a TOML file or a template, or ask for --extreme",
        ),
        (options.extreme and is_of_a_spec, "--extreme", "has its own cases and takes no SPEC, --only or --tolerance"),
    )
    _end_as_by_ctrl_c()
    timer = Timer(limit_s, interrupt_main)
    timer.daemon = True
    timer.start()
    try:
        study, text, folder, files = (_extreme if options.extreme else _ladders)(options)
    finally:
        timer.cancel()
    if options.json:
        print((folder / files[1]).read_text(encoding="utf-8"), end="")
    else:
        show(f"{text(study)}\n\nwritten to {plain(str(folder))}: {'  '.join(files)}")
    if study.missing:
        # Printed after the summary, since finished results are kept.
        print(f"padgen: stopped: {len(study.missing)} were not run; the files say which", file=sys.stderr)
        return BAD_INPUT
    return DONE if not options.extreme or study.holds else CHECK_FAILED


def _ladders(options: argparse.Namespace) -> Any:
    from padgen.ladders.study import STUDY_FILES, parse_only, run_study, study_text
    from padgen.make.planning import parse_tolerance, plan_for, recorded_spec, spec_of

    tolerance = None if options.tolerance is None else parse_tolerance(options.tolerance)
    only = parse_only(options.only)
    spec = spec_of(options.spec)
    folder = folder_of(options, spec.name)
    with progress_line(log=True) as progress:
        plan = plan_for(recorded_spec(spec, folder), progress=progress)
        return run_study(plan, folder, only, tolerance, progress), study_text, folder, STUDY_FILES


def _extreme(options: argparse.Namespace) -> Any:
    from padgen.ladders.study import extreme_text, run_extreme

    with progress_line(log=True) as progress:
        study = run_extreme(folder_of(options, "extreme"), progress)
    return study, extreme_text, study.folder, study.files


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
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="run on a Dask cluster, as tcp://host:8786; needs padgen[dask]"
    )
    parser.add_argument(
        "--resume",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="keep variants that were finished before from the same inputs (default), or make all again",
    )
    parser.add_argument("--retry", action="store_true", help="make variants that failed before once more")
    add_cache(parser)
    parser.add_argument("-o", "--output", metavar="DIR", help="folder of the results (default: out/NAME)")
    parser.add_argument("--json", action="store_true", help="one JSON object a line: every event, then a summary")
    parser.set_defaults(command=_sweep)


def _sweep(options: argparse.Namespace) -> int:
    if options.jobs is not None:
        both = "does not go with --scheduler: the cluster has the workers that it has"
        refuse(
            (
                not 1 <= options.jobs <= MOST_WORKERS,
                "--jobs",
                f"must be 1 … {MOST_WORKERS} processes, got {options.jobs}",
            ),
            (options.scheduler is not None, "--jobs", both),
        )
    use_cache(options)
    from padgen.batch.definition import load_sweep
    from padgen.batch.index import write_pareto
    from padgen.batch.sweep import connect, run_sweep
    from padgen.core.runner import uninterrupted
    from padgen.report.results import sweep_table, sweep_text

    _end_as_by_ctrl_c()
    sweep = load_sweep(options.sweep)
    folder = folder_of(options, sweep.settings.name)
    # Without a Dask cluster, this machine's processes work.
    cluster = nullcontext() if options.scheduler is None else connect(options.scheduler)
    with cluster as executor, _event_printer(options, sweep) as tell:
        result = run_sweep(sweep, folder, executor, options.jobs, options.resume, options.retry, tell)
    with uninterrupted() if result.interrupted else nullcontext():
        files, note = write_pareto(folder, sweep.settings.name, result.overview)
        shown_parts = sweep, replace(result, folder=folder), files
        if options.json:
            _line({**sweep_table(*shown_parts), "notes": [note] * bool(note)})
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
    """Give a function that shows events: as lines of JSON, else each failure in a line, with a bar on a terminal."""
    if options.json:
        from padgen.batch.sweep import event_table

        yield lambda event: _line(event_table(event))
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
        from padgen.batch.definition import variant_name

        before = " (in an earlier run)" if event.reused else ""
        write(f"failed{before}: {variant_name(sweep, event.record.number)}: {plain(event.record.sentence)}")
