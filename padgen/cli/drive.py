"""The command ``padgen drive``."""

import argparse
from pathlib import Path
from typing import Any

from padgen.cli.common import (
    add_model,
    add_output,
    add_spec,
    add_verbose,
    asked_of,
    code_of,
    folder_of,
    print_json,
    progress_line,
    show,
)
from padgen.core.errors import SpecError, number
from padgen.core.registry import FORMATS

__all__ = ["SHOWN", "add", "add_frames", "frames_of", "plan_of", "shows", "tuning_of"]

DEFAULT_TABLES, DEFAULT_WAVES = "csv,json", "csv,json,wav"


def add(commands: Any) -> None:
    """Declare the command and its options."""
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
    add_frames(parser)
    parser.add_argument("--loop", action="store_true", help="with --state: whole periods, which repeat without a jump")
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
    add_verbose(parser, "all notes")
    add_model(parser)
    add_output(parser)
    parser.set_defaults(command=_drive)


SHOWN = ("state", "frames", "text", "pattern")
"""Options that say what is shown."""


def add_frames(parser: argparse.ArgumentParser) -> None:
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


def plan_of(options: argparse.Namespace, progress: Any) -> Any:
    """Return the plan of SPEC, by the same model as a build."""
    from padgen.make.planning import plan_for

    return plan_for(*asked_of(options), progress)


def frames_of(options: argparse.Namespace, plan: Any) -> tuple[Any, tuple[str, ...]]:
    """Return the levels of the asked frames (None if none are asked for), and notes about them."""
    if options.seconds is not None and not 0 < options.seconds < 1e6:
        raise SpecError(f"must be above 0 s and below 1e6 s, got {number(options.seconds)} s", "--seconds")
    if options.frames is not None:
        from padgen.driver.frames import read_frames

        frames = read_frames(options.frames, plan)
        return frames.levels, frames.notes
    from padgen.driver.drive_folder import levels_of

    note = "taxels are played in the plan's order, coil by coil; what was felt instead goes to --wiring as played,felt"
    notes = (note,) if options.pattern == "each" else ()
    return levels_of(plan, options.state, text=options.text, pattern=options.pattern), notes


def shows(options: argparse.Namespace) -> bool:
    """Tell whether something to show is asked for."""
    return any(getattr(options, name) is not None for name in SHOWN)


def tuning_of(path: str | None, plan: Any) -> Any:
    """Return the tuning in a file, or None without a path."""
    if path is None:
        return None
    from padgen.measured.tuning import read_tuning

    return read_tuning(Path(path), plan)


def _drive(options: argparse.Namespace) -> int:
    from padgen.driver.drive_folder import DEPTHS

    if options.depth not in DEPTHS:
        raise SpecError(f"must be one of {', '.join(DEPTHS)}, got {options.depth!r}", "--depth")
    if options.excite is not None:
        return _excite(options)
    if options.wiring is not None:
        return _wiring(options)
    from padgen.driver.drive_folder import Drive, parse_formats

    _refuse(options)
    with progress_line() as progress:
        plan = plan_of(options, progress)
        frames, notes = frames_of(options, plan)
        formats = None if options.formats is None else parse_formats(options.formats)
        tuning, held = tuning_of(options.tuning, plan), options.state is not None
        shown = Drive(
            plan,
            frames,
            options.seconds,
            held,
            options.loop,
            options.rate,
            options.signal,
            options.carrier,
            tuning,
            progress,
        )
        folder = folder_of(options, plan.name)
        if frames is not None and options.tuning is None and (folder / "tuning.json").exists():
            notes = (*notes, f"these are the plan's tones; {folder / 'tuning.json'} has a print's (--tuning)")
        driven = shown.save_folder(folder, formats, options.depth, options.hear, options.gap)
    from padgen.report.drives import driven_table, driven_text

    if options.json:
        print_json(driven_table(driven, notes))
    else:
        show(driven_text(plan, driven, frames, notes, options.verbose))
    return code_of(driven.findings)


def _refuse(options: argparse.Namespace) -> None:
    if options.signal not in ("voltage", "current"):
        raise SpecError(f"must be voltage or current, got {options.signal!r}", "--signal")
    for name, default in (("depth", "24"), ("signal", "voltage")):
        if not shows(options) and getattr(options, name) != default:
            raise SpecError("is of a WAV; add --state or --frames", f"--{name}")
    if options.gap and not options.hear:
        raise SpecError("is about how the file is listened to; add --hear", "--gap")
    if options.together:
        raise SpecError("is for --excite", "--together")


def _wiring(options: argparse.Namespace) -> int:
    from padgen.driver.patterns import wiring_findings
    from padgen.report.plans import findings_text, held_line

    with progress_line() as progress:
        plan = plan_of(options, progress)
    findings = wiring_findings(plan, Path(options.wiring))
    if options.json:
        from dataclasses import asdict

        from padgen.core.files import json_text

        print(json_text({"findings": [asdict(finding) for finding in findings]}), end="")
    else:
        show(held_line(f"What was felt or heard of {plan.name} is compared with its wiring", findings))
        show(findings_text(findings))
    return code_of(findings)


def _excite(options: argparse.Namespace) -> int:
    from dataclasses import asdict

    from padgen.driver.drive_folder import write_excitation

    given = [
        f"--{name}" for name in ("formats", *SHOWN, "carrier", "tuning", "wiring") if getattr(options, name) is not None
    ]
    given += [f"--{name}" for name in ("loop", "hear", "gap") if getattr(options, name)]
    if options.signal != "voltage":
        given.append("--signal")
    if given:
        raise SpecError(f"writes excitation.wav and nothing else; {given[0]} does not go with it", "--excite")
    with progress_line() as progress:
        plan = plan_of(options, progress)
        progress("writing the excitation")
        folder = folder_of(options, plan.name)
        played, findings = write_excitation(
            plan, folder, options.excite, options.rate, options.depth, options.seconds, options.together
        )
    if options.json:
        names = ("kind", "rate_hz", "band_hz", "sweep_s", "together", "level_share", "copper_loss_w")
        figures = {name: value for name, value in asdict(played).items() if name in names}
        figures["findings"] = [asdict(finding) for finding in findings]
        print_json({"folder": str(folder), "files": ["excitation.wav", "excitation.json"], **figures})
    else:
        from padgen.report.drives import excitation_text

        show(excitation_text(played, folder, findings))
    return code_of(findings)
