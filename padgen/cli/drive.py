"""The commands ``padgen drive`` and ``padgen play``."""

import argparse
from pathlib import Path
from typing import Any

from padgen.api.drives import check_wiring, drive, excite, play, play_wav, read_frames
from padgen.cli.common import (
    DONE,
    add_model,
    add_option,
    add_shared,
    add_spec,
    answer,
    exit_code_of,
    folder_of,
    plan_of,
    progress_line,
    split_names,
)
from padgen.core.errors import FileError, number
from padgen.core.registry import FORMATS, PLAYERS
from padgen.core.rules import Rule, refuse

__all__ = ["add_drive", "add_play"]

DEFAULT_TABLES = "csv,json"
DEFAULT_WAVES = "csv,json,wav"
DEPTHS = ("24", "float")
SHOWN = ("state", "frames", "text", "pattern")
"""Options that say what is shown."""
FELT = (
    "write a CSV with the columns played,felt, a row a taxel (felt: the one that moved, empty if none did){more},"
    " and give it to padgen drive --wiring FILE"
)


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
        type=split_names,
        metavar="LIST",
        help=f"of {', '.join(FORMATS.names())} (default: {DEFAULT_TABLES}, with something to show {DEFAULT_WAVES})",
    )
    _add_frames(parser)
    add_option(parser, drive, "loop")
    add_option(parser, drive, "brake")
    add_option(parser, drive, "rate_hz", "--rate", metavar="HZ", type=int)
    parser.add_argument(
        "--depth",
        default="24",
        metavar="24|float",
        help="bits of a sample of the WAV: 24, or 32-bit float (default: 24)",
    )
    add_option(parser, drive, "signal", metavar="voltage|current")
    add_option(parser, drive, "carrier_hz", "--carrier", metavar="HZ", type=float)
    add_option(parser, drive, "tuning", metavar="FILE")
    add_option(parser, drive, "warm")
    parser.add_argument(
        "--hear", action="store_true", help="play the written file on a simulated pad and say what fingers feel of it"
    )
    parser.add_argument(
        "--gap", action="store_true", help="with --hear: count that the pull grows as the gap closes; slower"
    )
    parser.add_argument(
        "--excite", metavar="chirp|noise", help="write only a file that shakes every taxel, to measure it by"
    )
    add_option(parser, excite, "together")
    add_option(parser, check_wiring, "felt", "--wiring", metavar="FILE")
    add_shared(parser, _drive, "all notes")


def _add_frames(parser: argparse.ArgumentParser) -> None:
    """Declare the options that say what the pad shows (state, frames, text or pattern) and for how many seconds."""
    shown = parser.add_mutually_exclusive_group()
    add_option(shown, drive, "state", metavar="BITS")
    add_option(shown, drive, "frames", metavar="FILE", nargs="+")
    add_option(shown, drive, "text", metavar="TEXT")
    add_option(shown, drive, "pattern", metavar="NAME")
    add_option(parser, drive, "seconds", metavar="S", type=float)


def _shown_of(options: argparse.Namespace, plan: Any) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return what the command line asks to show, as arguments of `padgen.drive`, and notes about it."""
    seconds = 1.0 if options.seconds is None else options.seconds
    refuse(Rule(0 < seconds < 1e6, "--seconds", f"must be above 0 s and below 1e6 s, got {number(seconds)} s"))
    asked = {name: getattr(options, name) for name in (*SHOWN, "seconds")}
    if options.frames is not None:
        frames = read_frames(options.frames, plan)
        return {**asked, "frames": frames.levels}, frames.notes
    if options.pattern != "each":
        return asked, ()
    more = ", add rows for padgen drive --pattern crossed in the same way" if plan.coils.sets > 1 else ""
    return asked, (f"taxels are played in the plan's order, coil by coil; {FELT.format(more=more)}",)


def _shows(options: argparse.Namespace) -> bool:
    """Tell whether the command line asks to show a state, frames, text or a pattern."""
    return any(getattr(options, name) is not None for name in SHOWN)


def _drive(options: argparse.Namespace) -> int:
    refuse(Rule(options.depth in DEPTHS, "--depth", f"must be one of {', '.join(DEPTHS)}, got {options.depth!r}"))
    if options.excite is not None:
        return _excite(options)
    if options.wiring is not None:
        return _wiring(options)
    shows = _shows(options)
    of_wav = "is of a WAV; add --state or --frames"
    refuse(
        Rule(
            options.signal in ("voltage", "current"),
            "--signal",
            f"must be voltage or current, got {options.signal!r}",
        ),
        Rule(shows or options.depth == "24", "--depth", of_wav),
        Rule(shows or options.signal == "voltage", "--signal", of_wav),
        Rule(options.hear or not options.gap, "--gap", "is about how the file is listened to; add --hear"),
        Rule(not options.together, "--together", "is for --excite"),
    )
    with progress_line() as progress:
        plan = plan_of(options, progress)
        asked, notes = _shown_of(options, plan)
        shown = drive(
            plan,
            **asked,
            loop=options.loop,
            rate_hz=options.rate,
            signal=options.signal,
            carrier_hz=options.carrier,
            tuning=options.tuning,
            brake=options.brake,
            warm=options.warm,
            progress=progress,
        )
        folder = folder_of(options, plan.name)
        if shown.frames is not None and options.tuning is None and (folder / "tuning.json").exists():
            notes = (
                *notes,
                f"these are the planned tones; for the measured print add --tuning {folder / 'tuning.json'}",
            )
        driven = shown.save_folder(folder, options.formats, options.depth, options.hear, options.gap)
    if shown.played:
        order = f"{', '.join(shown.played[:3])} … {shown.played[-1]}"
        sense = "for each coil the tones that it has no taxels for; some move only where its plug is at another coil"
        notes = (*notes, f"played are {order}: {sense}; {FELT}")
    from padgen.report.plans import warm_drive_line
    from padgen.report.results import driven_table, driven_text

    if options.warm:
        notes = (*notes, warm_drive_line(plan))
    pictured = None if shown.played else shown.frames
    answer(options, driven_table(plan, driven, notes), driven_text(plan, driven, pictured, notes, options.verbose))
    return exit_code_of((*plan.findings, *driven.findings))


def _wiring(options: argparse.Namespace) -> int:
    from padgen.report.plans import findings_text, outcome_line

    with progress_line() as progress:
        plan = plan_of(options, progress)
    findings = check_wiring(plan, options.wiring)
    held = outcome_line(f"What was felt or heard of {plan.name} is compared with its wiring", findings)
    answer(options, {"findings": findings}, held, *([findings_text(findings)] if findings else []))
    return exit_code_of(findings)


def _excite(options: argparse.Namespace) -> int:
    given = [name for name in ("formats", *SHOWN, "carrier", "tuning", "wiring") if getattr(options, name) is not None]
    given += [name for name in ("loop", "brake", "warm", "hear", "gap") if getattr(options, name)]
    given += ["signal"] * (options.signal != "voltage")
    refuse(
        *(
            Rule(False, "--excite", f"writes excitation.wav and nothing else; --{name} does not go with it")
            for name in given
        )
    )
    with progress_line() as progress:
        plan = plan_of(options, progress)
        progress("writing the excitation")
        folder = folder_of(options, plan.name)
        played, findings = excite(
            plan,
            folder,
            options.excite,
            rate_hz=options.rate,
            depth=options.depth,
            seconds=options.seconds,
            together=options.together,
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
    return exit_code_of(findings)


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
    for name in PLAYERS.names():
        player = PLAYERS.get(name)
        address = player.ADDRESS.strip("[]")
        optional = {"nargs": "?", "const": ""} if address != player.ADDRESS else {}
        where.add_argument(f"--{name}", dest=_address_key(name), metavar=address, help=player.ABOUT, **optional)
    _add_frames(parser)
    add_option(parser, play, "tuning", metavar="FILE")
    add_option(parser, play, "warm")
    add_option(parser, play, "baud", metavar="N", type=int)
    add_option(parser, play, "repeat", metavar="N", type=int)
    add_model(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.set_defaults(command=_play)


def _address_key(player: str) -> str:
    """Return the attribute of the parsed options that holds a player's address, such as a serial port or sound card."""
    return f"address of {player}"


def _play(options: argparse.Namespace) -> int:
    name = next(name for name in PLAYERS.names() if getattr(options, _address_key(name)) is not None)
    address = getattr(options, _address_key(name))
    if PLAYERS.get(name).PLAYS == "wav":
        return _play_wav(options, name, address)
    return _play_frames(options, name, address)


def _play_frames(options: argparse.Namespace, player: str, address: str) -> int:
    refuse(Rule(_shows(options), f"--{player}", "needs something to show; add --state or --frames"))
    with progress_line() as progress:
        plan = plan_of(options, progress)
        asked, notes = _shown_of(options, plan)
        played = play(
            plan,
            address,
            **asked,
            repeat=options.repeat,
            baud=options.baud,
            tuning=options.tuning,
            warm=options.warm,
            player=player,
            on_shown=lambda shown, total: progress(f"frame {shown} of {total}"),
        )
    sentence, figures = PLAYERS.get(player).outcome(played)
    answer(options, {**figures, "notes": notes}, sentence, *notes)
    return DONE


def _play_wav(options: argparse.Namespace, player: str, address: str) -> int:
    for name in (*SHOWN, "seconds", "tuning", "warm"):
        reason_why = f"plays a WAV file of padgen drive as it is; --{name} goes with padgen drive"
        refuse(Rule(getattr(options, name) in (None, False), f"--{player}", reason_why))
    if not Path(options.spec).exists():
        where = Path("out") / Path(options.spec).stem / "drive.wav"
        there = f"; --{player} plays a WAV that padgen drive wrote, as {where}"
        raise FileError(f"there is no such file{there}", options.spec)
    with progress_line() as progress:
        played = play_wav(options.spec, address or None, repeat=options.repeat, player=player, progress=progress)
    sentence, figures = PLAYERS.get(player).outcome(played)
    answer(options, figures, sentence)
    return DONE
