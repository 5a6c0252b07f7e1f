"""The commands ``padgen drive`` and ``padgen play``."""

import argparse
from pathlib import Path
from typing import Any

from padgen.cli.common import (
    DONE,
    add_model,
    add_shared,
    add_spec,
    answer,
    code_of,
    folder_of,
    plan_of,
    progress_line,
    refuse,
)
from padgen.core.errors import number, plain
from padgen.core.registry import FORMATS

__all__ = ["add_drive", "add_play", "tuning_of"]

DEFAULT_TABLES = "csv,json"
DEFAULT_WAVES = "csv,json,wav"
MOST_REPEATS = 10_000
SHOWN = ("state", "frames", "text", "pattern")
"""Options that say what is shown."""


def add_drive(commands: Any) -> None:
    """Declare ``padgen drive`` and its options."""
    parser = commands.add_parser(
        "drive",
        help="tables, waveforms and firmware that play images on the pad",
        description="Write what drives the coils: tables, a WAV file with one channel a coil, C for a microcontroller,"
        " MPEG haptics, a Syntacts script. A state or frames say what is shown.",
    )
    add_spec(parser)
    parser.add_argument(
        "--formats",
        metavar="LIST",
        help=f"of {', '.join(FORMATS.names())} (default: {DEFAULT_TABLES}, with something to show {DEFAULT_WAVES})",
    )
    _add_frames(parser)
    parser.add_argument("--loop", action="store_true", help="with --state: whole periods, which repeat without a jump")
    parser.add_argument(
        "--brake",
        action="store_true",
        help="stop taxels that go OFF by their line in counter-phase at the end of their last frame (WAV only)",
    )
    parser.add_argument("--rate", metavar="HZ", type=int, help="samples per second (default: 48000, or what it takes)")
    parser.add_argument(
        "--depth",
        default="24",
        metavar="24|float",
        help="bits of a sample of the WAV: 24, or 32-bit float (default: 24)",
    )
    parser.add_argument(
        "--signal", default="voltage", metavar="voltage|current", help="what the amplifier controls (default: voltage)"
    )
    parser.add_argument(
        "--carrier",
        metavar="HZ",
        type=float,
        help="frequency of a carrier for the spur-free drive, for amplifiers that pass no 0 Hz",
    )
    parser.add_argument("--tuning", metavar="FILE", help="tuning.json of padgen retune: drive the print as measured")
    parser.add_argument(
        "--hear", action="store_true", help="play the written file on a simulated pad and say what fingers feel of it"
    )
    parser.add_argument(
        "--gap", action="store_true", help="with --hear: count that the pull grows as the gap closes; slower"
    )
    parser.add_argument(
        "--excite", metavar="chirp|noise", help="write only a file that shakes every taxel, to measure it by"
    )
    parser.add_argument("--together", action="store_true", help="with --excite: all coils at once, not in turn")
    parser.add_argument(
        "--wiring",
        metavar="FILE",
        help="write nothing, and say which coils are swapped: a CSV of the taxels played,felt with --pattern each, or a"
        " folder of recordings named after taxels",
    )
    add_shared(parser, _drive, "all notes")


def _add_frames(parser: argparse.ArgumentParser) -> None:
    """Declare the options that choose what to show: `SHOWN`."""
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument(
        "--state",
        metavar="BITS",
        help="one state on every coil, lowest channel first: 0110, or levels as 0,0.5,1,0; all: one after the other",
    )
    shown.add_argument(
        "--frames",
        metavar="FILE",
        nargs="+",
        help="images of the pad, a pixel a taxel: PNG, CSV, NPY, text, or folders of them",
    )
    shown.add_argument("--text", metavar="TEXT", help="letters of 5 x 7 taxels, which scroll where they do not fit")
    shown.add_argument(
        "--pattern",
        metavar="NAME",
        help="each (taxel in turn, to check a new pad's wiring), rows, columns, checkerboard or sweep",
    )
    parser.add_argument(
        "--seconds",
        metavar="S",
        type=float,
        help="how long each frame lasts (default: as the plan's frame rate has it;"
        " a state, until its taxels have their levels)",
    )


def _frames_of(options: argparse.Namespace, plan: Any) -> tuple[Any, tuple[str, ...]]:
    """Return the levels of the asked frames (None if none are asked for), and notes about them."""
    seconds = 1.0 if options.seconds is None else options.seconds
    refuse((not 0 < seconds < 1e6, "--seconds", f"must be above 0 s and below 1e6 s, got {number(seconds)} s"))
    if options.frames is not None:
        from padgen.driver.frames import read_frames

        frames = read_frames(options.frames, plan)
        return frames.levels, frames.notes
    from padgen.driver.drive_folder import levels_of

    note = "taxels are played in the plan's order, coil by coil; what was felt instead goes to --wiring as played,felt"
    notes = (note,) * (options.pattern == "each")
    return levels_of(plan, options.state, text=options.text, pattern=options.pattern), notes


def _shows(options: argparse.Namespace) -> bool:
    """Tell whether something to show is asked for."""
    return any(getattr(options, name) is not None for name in SHOWN)


def tuning_of(path: str | None, plan: Any) -> Any:
    """Return the tuning in a file, or None without a path."""
    from padgen.measured.tuning import read_tuning

    return None if path is None else read_tuning(Path(path), plan)


def _drive(options: argparse.Namespace) -> int:
    from padgen.driver.drive_folder import DEPTHS, Drive, parse_formats

    refuse((options.depth not in DEPTHS, "--depth", f"must be one of {', '.join(DEPTHS)}, got {options.depth!r}"))
    if options.excite is not None:
        return _excite(options)
    if options.wiring is not None:
        return _wiring(options)
    still = not _shows(options)
    of_wav = "is of a WAV; add --state or --frames"
    refuse(
        (
            options.signal not in ("voltage", "current"),
            "--signal",
            f"must be voltage or current, got {options.signal!r}",
        ),
        (still and options.depth != "24", "--depth", of_wav),
        (still and options.signal != "voltage", "--signal", of_wav),
        (options.gap and not options.hear, "--gap", "is about how the file is listened to; add --hear"),
        (options.together, "--together", "is for --excite"),
    )
    with progress_line() as progress:
        plan = plan_of(options, progress)
        frames, notes = _frames_of(options, plan)
        formats = None if options.formats is None else parse_formats(options.formats)
        shown = Drive(
            plan,
            frames,
            options.seconds,
            options.state is not None,
            options.loop,
            options.rate,
            options.signal,
            options.carrier,
            tuning_of(options.tuning, plan),
            progress,
            options.brake,
        )
        folder = folder_of(options, plan.name)
        if frames is not None and options.tuning is None and (folder / "tuning.json").exists():
            notes = (*notes, f"these are the plan's tones; {folder / 'tuning.json'} has a print's (--tuning)")
        driven = shown.save_folder(folder, formats, options.depth, options.hear, options.gap)
    from padgen.report.results import driven_table, driven_text

    answer(options, driven_table(plan, driven, notes), driven_text(plan, driven, frames, notes, options.verbose))
    return code_of((*plan.findings, *driven.findings))


def _wiring(options: argparse.Namespace) -> int:
    from padgen.driver.frames import wiring_findings
    from padgen.report.plans import findings_text, held_line

    with progress_line() as progress:
        plan = plan_of(options, progress)
    findings = wiring_findings(plan, Path(options.wiring))
    held = held_line(f"What was felt or heard of {plan.name} is compared with its wiring", findings)
    answer(options, {"findings": findings}, held, *([findings_text(findings)] if findings else []))
    return code_of(findings)


def _excite(options: argparse.Namespace) -> int:
    from padgen.driver.drive_folder import write_excitation

    given = [name for name in ("formats", *SHOWN, "carrier", "tuning", "wiring") if getattr(options, name) is not None]
    given += [name for name in ("loop", "brake", "hear", "gap") if getattr(options, name)]
    given += ["signal"] * (options.signal != "voltage")
    refuse(
        *((True, "--excite", f"writes excitation.wav and nothing else; --{name} does not go with it") for name in given)
    )
    with progress_line() as progress:
        plan = plan_of(options, progress)
        progress("writing the excitation")
        folder = folder_of(options, plan.name)
        played, findings = write_excitation(
            plan, folder, options.excite, options.rate, options.depth, options.seconds, options.together
        )
    from padgen.report.results import excitation_text

    names = ("kind", "rate_hz", "band_hz", "sweep_s", "together", "level_share", "copper_loss_w")
    table = {
        "folder": str(folder),
        "files": ["excitation.wav", "excitation.json"],
        **{name: getattr(played, name) for name in names},
        "findings": findings,
    }
    answer(options, table, excitation_text(played, folder, findings))
    return code_of(findings)


def add_play(commands: Any) -> None:
    """Declare ``padgen play`` and its options."""
    parser = commands.add_parser(
        "play",
        help="show frames on a pad: over a serial port, or a WAV file over a sound card",
        description="Show frames on a pad whose microcontroller runs the firmware of `padgen drive --formats c`, or"
        " play a WAV file of `padgen drive` over a sound card with a channel for each coil. Needs the extra"
        " padgen[play].",
    )
    parser.add_argument("spec", metavar="SPEC|WAV", help="a spec or template with --port, a WAV file with --audio")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--port", metavar="PORT", help="serial port of the microcontroller, as /dev/ttyACM0 or COM3")
    where.add_argument(
        "--audio", metavar="DEVICE", nargs="?", const="", help="sound card, by name or number (default: the system's)"
    )
    _add_frames(parser)
    parser.add_argument(
        "--tuning", metavar="FILE", help="with --port: the tuning.json that the firmware was written for"
    )
    parser.add_argument(
        "--baud", metavar="N", type=int, default=115200, help="baud rate of --port (default: %(default)s)"
    )
    parser.add_argument("--repeat", metavar="N", type=int, default=1, help="show all frames so many times")
    add_model(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.set_defaults(command=_play)


def _play(options: argparse.Namespace) -> int:
    refuse(
        (not 1 <= options.repeat <= MOST_REPEATS, "--repeat", f"must be 1 … {MOST_REPEATS}, got {options.repeat}"),
        (options.baud < 1, "--baud", f"must be above 0, got {options.baud}"),
    )
    return _audio(options) if options.audio is not None else _serial(options)


def _serial(options: argparse.Namespace) -> int:
    import numpy as np

    from padgen.driver.serial_line import play_frames

    refuse((not _shows(options), "--port", "needs something to show; add --state or --frames"))
    with progress_line() as progress:
        plan = plan_of(options, progress)
        frames, notes = _frames_of(options, plan)
        repeated = np.concatenate([frames] * options.repeat)
        played = play_frames(
            options.port,
            plan,
            repeated,
            options.seconds,
            tuning=tuning_of(options.tuning, plan),
            baud=options.baud,
            on_shown=lambda shown: progress(f"frame {shown} of {len(repeated)}"),
        )
    count = "1 frame" if played.frames == 1 else f"{played.frames} frames"
    summary = (
        f"showed {count} in {played.seconds:.1f} s on {plain(options.port)}",
        f"{played.resent} messages were lost on the line and sent again" if played.resent else "",
        f"coils were as warm as they bear, and got down to {played.given:.0%} of their voltage"
        if played.given < 1
        else "",
    )
    figures = {name: getattr(played, name) for name in ("frames", "resent", "seconds", "given")}
    answer(options, {"port": options.port, **figures, "notes": notes}, "; ".join(filter(None, summary)), *notes)
    return DONE


def _audio(options: argparse.Namespace) -> int:
    from padgen.driver.sound_card import play_wave

    for name in (*SHOWN, "seconds", "tuning"):
        reason_why = f"plays a WAV file of padgen drive as it is; --{name} goes with padgen drive"
        refuse((getattr(options, name) is not None, "--audio", reason_why))
    with progress_line() as progress:
        played = play_wave(
            Path(options.spec),
            options.audio or None,
            options.repeat,
            lambda device: progress(f"playing on {device.name}"),
        )
    late = f"; gaps are heard where the computer was too late: {played.missed}" if played.missed else ""
    table = {"device": played.device.name, "seconds": played.seconds, "late_blocks": played.missed}
    answer(options, table, f"played {played.seconds:.1f} s on {plain(played.device.name)}{late}")
    return DONE
