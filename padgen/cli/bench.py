"""The command ``padgen bench``."""

import argparse
import sys
from typing import Any

from padgen.cli.common import add_model, add_output, add_spec, add_verbose, folder_of, progress_line, show
from padgen.cli.drive import plan_of, tuning_of
from padgen.cli.retune import tell
from padgen.core.errors import EngineMissingError, FileError, SolverError, SpecError, plain

__all__ = ["add"]

MOST_TRIES = 20


def add(commands: Any) -> None:
    """Declare the command and its options."""
    parser = commands.add_parser(
        "bench",
        help="measure a print at the bench, taxel by taxel, and re-tune tones and levels to it",
        description="Shake every taxel in turn, through a sound card or a microcontroller with the firmware, record it"
        " by a sensor at an input of a sound card, fit it at once, and write what padgen retune writes. What is"
        " recorded is kept in the folder; the same command goes on where it was stopped. Needs the extra padgen[play].",
    )
    add_spec(parser)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--device", metavar="NAME", help="sound card that plays, by name or number (default: first)")
    where.add_argument("--port", metavar="PORT", default="", help="serial port of the microcontroller that plays")
    parser.add_argument("--record", metavar="NAME", help="sound card that records, by name or number (default: first)")
    parser.add_argument("--coils", action="store_true", help="the sensor hears all taxels of a coil: record by coil")
    parser.add_argument("--tries", metavar="N", type=int, default=3, help="most recordings of one (default: 3)")
    parser.add_argument("--rate", metavar="HZ", type=int, help="samples per second (default: the sound card's)")
    parser.add_argument("--baud", metavar="N", type=int, default=115200, help="of --port (default: %(default)s)")
    parser.add_argument("--tuning", metavar="FILE", help="with --port: tuning.json that the firmware was written for")
    parser.add_argument("--nearest", action="store_true", help="of two like peaks take the one nearer to the plan's")
    add_verbose(parser, "all notes, and more taxels")
    add_model(parser)
    add_output(parser)
    parser.set_defaults(command=_bench)


def _bench(options: argparse.Namespace) -> int:
    for name, most in (("tries", MOST_TRIES), ("baud", 10**8), ("rate", 10**7)):
        value = getattr(options, name)
        if value is not None and not 1 <= value <= most:
            raise SpecError(f"must be 1 … {most}, got {value}", f"--{name}")
    from padgen.driver.bench import RECORDED, bench
    from padgen.measured.tuned_folder import write_retuned

    with progress_line() as progress:
        plan = plan_of(options, progress)
    folder, tuning = folder_of(options, plan.name), tuning_of(options.tuning, plan)
    session = bench(plan, folder, options.device, options.record, options.rate, options.port, options.baud, tuning)
    if session.sink and session.by_hand and not _asks():
        raise SpecError(
            f"{session.sink.name} has {session.sink.channels} output channels for"
            f" {plan.coils.rows * plan.coils.columns} coils; run this in a terminal, which asks to connect one coil"
            " after the other to output 1",
            "--device",
        )
    names = session.names(options.coils)
    left = [name for name in names if not session.is_kept(name)]
    if len(left) < len(names):
        _say(options, f"{len(names) - len(left)} of {len(names)} were recorded before, and are kept")
    try:
        for name in left:
            _measure(options, session, name)
    except (KeyboardInterrupt, EOFError) as error:
        kept = sum(map(session.is_kept, names))
        told = f"stopped with {kept} of {len(names)} recorded; the same command goes on with the others"
        raise FileError(told, str(folder)) from error
    if not any(map(session.is_kept, names)):
        raise FileError("has no recording that shows a resonance; nothing is re-tuned", str(folder / RECORDED))
    with progress_line() as progress:
        written = write_retuned(plan, folder, [str(folder / RECORDED)], nearest=options.nearest, progress=progress)
    return tell(options, plan, written)


def _measure(options: argparse.Namespace, session: Any, name: str) -> None:
    """Record and fit a taxel or a coil, again where that fails, and tell of each."""
    for attempt in range(options.tries):
        if not _is_ready(session, name, attempt):
            _say(options, f"{name}: left out")
            return
        try:
            with progress_line() as progress:
                fits = session.take(name, attempt, options.nearest, progress)
        except EngineMissingError:
            raise
        except SolverError as error:
            last = attempt + 1 == options.tries
            _say(options, f"{name}: {error.message}; {'it is left out' if last else 'once more'}")
            continue
        for fit in fits:
            _say(
                options,
                f"{fit.id}  {fit.resonance_hz:.2f} ± {fit.resonance_error_hz:.1g} Hz,"
                f" Q {fit.q:.1f} ± {fit.q_error:.1g}",
            )
        return


def _asks() -> bool:
    """Tell whether there is somebody at a terminal to ask."""
    return sys.stdin is not None and sys.stdin.isatty()


def _is_ready(session: Any, name: str, attempt: int) -> bool:
    """Ask at a terminal whether sensor and coil are in place; elsewhere they are."""
    if not _asks():
        return True
    coil = name.partition("k")[0]
    wired = f"coil {coil} at output 1, " if session.by_hand else ""
    sensor = f"where all taxels of {name} are heard" if name == coil else f"at {name}"
    repeats = "repeats" if attempt else "records"
    print(f"{wired}sensor {sensor}: Enter {repeats}, s leaves it out ", end="", file=sys.stderr, flush=True)
    return input().strip().lower() != "s"


def _say(options: argparse.Namespace, text: str) -> None:
    """Print a line for people, which goes to standard error with ``--json``."""
    if options.json:
        print(plain(text), file=sys.stderr, flush=True)
    else:
        show(text)
        sys.stdout.flush()
