"""The command ``padgen play``."""

import argparse
from typing import Any

from padgen.cli.common import DONE, add_model, print_json, progress_line, show
from padgen.cli.drive import SHOWN, add_frames, frames_of, plan_of, shows, tuning_of
from padgen.core.errors import SpecError, plain

__all__ = ["add"]

MOST_REPEATS = 10_000


def add(commands: Any) -> None:
    """Declare the command and its options."""
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
    add_frames(parser)
    parser.add_argument(
        "--tuning", metavar="FILE", help="with --port: the tuning.json that the firmware was written for"
    )
    parser.add_argument("--baud", metavar="N", type=int, default=115200, help="of --port (default: %(default)s)")
    parser.add_argument("--repeat", metavar="N", type=int, default=1, help="show all frames so many times")
    add_model(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.set_defaults(command=_play)


def _play(options: argparse.Namespace) -> int:
    if not 1 <= options.repeat <= MOST_REPEATS:
        raise SpecError(f"must be 1 … {MOST_REPEATS}, got {options.repeat}", "--repeat")
    if options.baud < 1:
        raise SpecError(f"must be above 0, got {options.baud}", "--baud")
    return _audio(options) if options.audio is not None else _serial(options)


def _serial(options: argparse.Namespace) -> int:
    import numpy as np

    from padgen.driver.serial_line import play_frames

    if not shows(options):
        raise SpecError("needs something to show; add --state or --frames", "--port")
    with progress_line() as progress:
        plan = plan_of(options, progress)
        frames, notes = frames_of(options, plan)
        repeated = np.concatenate([frames] * options.repeat)
        tuning = tuning_of(options.tuning, plan)

        def told(shown: int) -> None:
            progress(f"frame {shown} of {len(repeated)}")

        played = play_frames(options.port, plan, repeated, options.seconds, tuning=tuning, baud=options.baud, told=told)
    figures = {"frames": played.frames, "resent": played.resent, "seconds": played.seconds, "given": played.given}
    if options.json:
        print_json({"port": options.port, **figures, "notes": list(notes)})
        return DONE
    lost = f"; {played.resent} messages were lost on the line and sent again" if played.resent else ""
    warm = f"; coils were as warm as they bear, and got down to {played.given:.0%} of their voltage"
    lost += warm if played.given < 1 else ""
    frames_shown = "1 frame" if played.frames == 1 else f"{played.frames} frames"
    show("\n".join([f"showed {frames_shown} in {played.seconds:.1f} s on {plain(options.port)}{lost}", *notes]))
    return DONE


def _audio(options: argparse.Namespace) -> int:
    from pathlib import Path

    from padgen.driver.sound_card import play_wave

    given = [f"--{name}" for name in (*SHOWN, "seconds", "tuning") if getattr(options, name) is not None]
    if given:
        raise SpecError(f"plays a WAV file of padgen drive as it is; {given[0]} goes with padgen drive", "--audio")
    with progress_line() as progress:

        def told(device: Any) -> None:
            progress(f"playing on {device.name}")

        played = play_wave(Path(options.spec), options.audio or None, options.repeat, told)
    if options.json:
        print_json({"device": played.device.name, "seconds": played.seconds, "late_blocks": played.missed})
        return DONE
    late = f"; {played.missed} blocks came too late, and were heard as gaps" if played.missed else ""
    show(f"played {played.seconds:.1f} s on {plain(played.device.name)}{late}")
    return DONE
