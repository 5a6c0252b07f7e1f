"""The command ``padgen sweep``."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from typing import Any

from padgen.cli.cache import add_cache, use_cache
from padgen.cli.common import BAD_INPUT, CHECK_FAILED, DONE, end_as_by_ctrl_c, folder_of, show
from padgen.core.errors import SpecError, plain

__all__ = ["add"]

MOST_WORKERS = 1024


def add(commands: Any) -> None:
    """Declare the command and its options."""
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
    if options.jobs is not None and not 1 <= options.jobs <= MOST_WORKERS:
        raise SpecError(f"must be 1 … {MOST_WORKERS} processes, got {options.jobs}", "--jobs")
    if options.jobs is not None and options.scheduler is not None:
        raise SpecError("does not go with --scheduler: the cluster has the workers that it has", "--jobs")
    use_cache(options)
    from padgen.batch.definition import load_sweep
    from padgen.batch.index import write_pareto
    from padgen.batch.sweep import run_sweep
    from padgen.core.runner import uninterrupted

    end_as_by_ctrl_c()
    sweep = load_sweep(options.sweep)
    folder = folder_of(options, sweep.settings.name)
    with _executor(options.scheduler) as executor, _event_printer(options, sweep) as tell:
        result = run_sweep(sweep, folder, executor, options.jobs, options.resume, options.retry, tell)
    with uninterrupted() if result.interrupted else nullcontext():
        files, note = write_pareto(folder, sweep.settings.name, result.overview)
        _print_summary(options, (sweep, replace(result, folder=folder), files), note)
    if result.stopped:
        # Printed after the summary, since finished variants are kept.
        again = "the same command" if options.resume else "the same command without --no-resume"
        print(f"padgen: {plain(result.stopped)}; {again} goes on where it stopped", file=sys.stderr)
        return BAD_INPUT
    return CHECK_FAILED if result.failed else DONE


def _print_summary(options: argparse.Namespace, told: tuple[Any, ...], note: str) -> None:
    from padgen.report.sweeps import sweep_table, sweep_text

    if options.json:
        _line({**sweep_table(*told), "notes": [note] * bool(note)})
        return
    show(sweep_text(*told))
    if note:
        show(f"note: {note}")
    if told[1].failed:
        show("the same command with --retry makes the failed ones once more")


def _executor(address: str | None) -> Any:
    """Return the executor of the Dask cluster at `address`, or None without one: this machine's processes then work."""
    if address is None:
        return nullcontext()
    from padgen.batch.sweep import connect

    return connect(address)


@contextmanager
def _event_printer(options: argparse.Namespace, sweep: Any) -> Iterator[Callable[[Any], None]]:
    """Give a function that shows events: as lines of JSON, else each failure in a line, with a bar on a terminal."""
    if options.json:
        from padgen.batch.sweep import event_table

        yield lambda event: _line(event_table(event))
    elif not sys.stderr.isatty():
        yield lambda event: _failure(sweep, event, lambda line: print(line, file=sys.stderr, flush=True))
    else:
        with _bar(sweep) as tell:
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


@contextmanager
def _bar(sweep: Any) -> Iterator[Callable[[Any], None]]:
    """Give a function that shows events in a bar on the terminal: variants ended, time left, failures above."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from padgen.core.display import seconds_text
    from padgen.report.sweeps import counts_text

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True, highlight=False), transient=True) as bar:
        task = bar.add_task("", total=None)

        def tell(event: Any) -> None:
            left = f", {seconds_text(event.eta_s)} to go" if event.left and event.eta_s is not None else ""
            ended = event.total - event.left
            bar.update(task, total=event.total, completed=ended, description=f"{counts_text(event)}{left}")
            _failure(sweep, event, lambda line: bar.console.print(line, markup=False))

        yield tell
