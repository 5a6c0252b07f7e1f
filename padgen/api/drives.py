"""Public functions that compute, write and play the signals of a pad's coils, and check how they are wired."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from padgen.core.errors import Finding, SpecError
from padgen.core.registry import PLAYERS

if TYPE_CHECKING:
    from padgen.driver.drive_folder import Drive
    from padgen.driver.excitation import Excitation
    from padgen.driver.frames import Frames
    from padgen.driver.serial_line import Played
    from padgen.driver.sound_card import Sounded
    from padgen.measured.tuning import Tuning
    from padgen.planner.plan import Plan

__all__ = ["check_wiring", "drive", "excite", "play", "play_wav", "read_frames", "read_tuning"]

MOST_REPEATS = 10_000

Progress = Callable[[str], None]


def _silent(step: str) -> None:
    """Ignore a progress message."""


def read_tuning(path: "str | Path", plan: "Plan") -> "Tuning":
    """Read a print's resonances, Q and responses from its tuning.json; raise `FileError` if it is not of `plan`."""
    from padgen.measured.tuning import read_tuning as read

    return read(Path(path), plan)


def _tuning_of(tuning: "Tuning | str | Path | None", plan: "Plan", warm: bool = False) -> "Tuning | None":
    """Return a print's tuning, read first if it is given as a path; if `warm`, the one for the pad at its warmest."""
    from padgen.measured.tuning import warm_tuning

    known = read_tuning(tuning, plan) if isinstance(tuning, (str, Path)) else tuning
    return warm_tuning(plan, known) if warm else known


def read_frames(paths: "str | Path | Sequence[str | Path]", plan: "Plan") -> "Frames":
    """Read images, one pixel per taxel; return levels (frames, taxels) from 0 to 1 (ON), and notes on unused pixels.

    Raises
    ------
    FileError
        A file is missing, unreadable, of another shape than the pad, or holds what is no level in 0 … 1.
    """
    from padgen.driver.frames import read_frames as read

    return read(paths, plan)


def drive(
    plan: "Plan",
    *,
    state: str | None = None,
    frames: Any = None,
    text: str | None = None,
    pattern: str | None = None,
    seconds: float | None = None,
    loop: bool = False,
    rate_hz: int | None = None,
    signal: str = "voltage",
    carrier_hz: float | None = None,
    tuning: "Tuning | str | Path | None" = None,
    progress: Progress = _silent,
    brake: bool = False,
    warm: bool = False,
) -> "Drive":
    """Return a `Drive`, the coil signals for on/off states, images or text; ``.save`` writes tables, WAV or firmware.

    Parameters
    ----------
    plan : Plan
        The plan whose coils are driven.
    state : str, optional
        One state on every coil, lowest channel first: '0110', levels as '0,0.5,1,0', or 'all', one after the other.
    frames : path, list of paths or array, optional
        Images of the pad, a pixel a taxel: PNG, CSV, NPY, text, or folders of them; or levels (k, taxels) in 0 … 1.
    text : str, optional
        Letters of 5 x 7 taxels, which scroll where they do not fit.
    pattern : {'each', 'rows', 'columns', 'checkerboard', 'sweep', 'crossed'}, optional
        One of each (taxel by taxel, to check the wiring), rows, columns, checkerboard, sweep, and crossed (each coil
        gets its neighbours' tones: only a swapped coil moves).
    seconds : float, optional
        How long each frame lasts; by default as the plan's frame rate has it, and a state until its taxels have their
        levels.
    loop : bool
        With a state: whole periods, which repeat without a jump.
    rate_hz : int, optional
        Samples per second; by default 48000, or more where needed.
    signal : {'voltage', 'current'}
        What the amplifier controls.
    carrier_hz : float, optional
        Frequency in Hz of a carrier for the spur-free drive, for amplifiers that pass no 0 Hz.
    tuning : Tuning or path, optional
        A tuning.json of padgen retune, to drive the print as measured.
    progress : callable
        Called with one line of text at each step.
    brake : bool
        Stop taxels that go OFF by their tone in counter-phase at the end of their last frame (WAV only).
    warm : bool
        Drive the pad as it is once all taxels have been on for long, and have warmed it: with the tones, levels and
        voltages of that state. A tuning must then have been measured at room temperature.

    Returns
    -------
    Drive
        ``.save("drive.wav")`` writes one file of a format, ``.save(folder, formats=[...])`` a folder of them.

    Raises
    ------
    SpecError, FileError
        A state or an image that this pad cannot show, or a tuning of another pad.

    Examples
    --------
    >>> import padgen as pg
    >>> shown = pg.drive(pg.plan("paper-pair"), state="10")
    >>> shown.frames.shape
    (1, 32)
    """
    from padgen.driver.drive_folder import Drive, levels_of
    from padgen.driver.frames import CROSSED

    known = _tuning_of(tuning, plan, warm)
    levels = levels_of(plan, state, frames, text, pattern)
    held = state is not None
    is_crossed = pattern == CROSSED
    return Drive(
        plan, levels, seconds, held, loop, rate_hz, signal, carrier_hz, known, progress, brake, warm, is_crossed
    )


class Excited(NamedTuple):
    """The excitation signal that `excite` wrote, and a finding for each limit that it makes the pad exceed."""

    excitation: "Excitation"
    findings: tuple[Finding, ...]


def excite(
    plan: "Plan",
    folder: "str | Path",
    kind: str = "chirp",
    *,
    rate_hz: int | None = None,
    depth: str = "24",
    seconds: float | None = None,
    together: bool = False,
) -> Excited:
    """Write ``excitation.wav``, a chirp or noise that shakes every taxel of a print to measure it, and its JSON file.

    Parameters
    ----------
    plan : Plan
        The printed plan.
    folder : path
        It is made if it is not there.
    kind : {'chirp', 'noise'}
        Sweep or noise.
    rate_hz : int, optional
        Samples per second; by default 48000, or more where needed.
    depth : {'24', 'float'}
        Bits of a sample: 24, or 32-bit float.
    seconds : float, optional
        Length for each coil; by default as the taxels' Q needs.
    together : bool
        With an excitation: all coils at once, not in turn.

    Raises
    ------
    SpecError, FileError
        An argument is out of its bounds, or the folder cannot be written.
    """
    from padgen.driver.drive_folder import write_excitation

    return Excited(*write_excitation(plan, Path(folder), kind, rate_hz, depth, seconds, together))


def check_wiring(plan: "Plan", felt: "str | Path") -> list[Finding]:
    """Return findings on swapped or silent coils, from a record of which taxel moved when each tone was played.

    Parameters
    ----------
    plan : Plan
        The printed plan.
    felt : path
        What was felt, to find coils that are swapped: a CSV with columns played and felt (the taxels of pattern 'each'
        or 'crossed' one by one, and where each was felt), or a folder of recordings named after taxels; nothing is
        written.

    Raises
    ------
    FileError
        The file is no such table, or names a taxel that the pad does not have.
    """
    from padgen.driver.wiring import wiring_findings

    return wiring_findings(plan, Path(felt))


def play(
    plan: "Plan",
    port: str,
    *,
    state: str | None = None,
    frames: Any = None,
    text: str | None = None,
    pattern: str | None = None,
    seconds: float | None = None,
    repeat: int = 1,
    baud: int = 115_200,
    tuning: "Tuning | str | Path | None" = None,
    warm: bool = False,
    player: str = "port",
    on_shown: Callable[[int, int], None] = lambda shown, total: None,
) -> "Played":
    """Show states, images, text or a pattern on a pad through the serial port of the microcontroller that drives it.

    Parameters
    ----------
    plan : Plan
        The plan that the firmware was written for.
    port : str
        Serial port, as '/dev/ttyACM0' or 'COM3'; of a registered `player` the address that it takes.
    state, frames, text, pattern
        As in `drive`; one of them.
    seconds : float, optional
        Duration of each frame; by default the device's.
    repeat : int
        Times that all frames are shown, 1 to 10,000.
    baud : int
        Baud rate of the port.
    tuning : Tuning or path, optional
        The tuning.json that the firmware was written for.
    warm : bool
        The firmware was written for the warm pad.
    player : str
        What shows the frames: "port", or a player registered in `padgen.driver.players`, whose result is returned.
    on_shown : callable
        Called with the number of frames that are shown, and of all.

    Raises
    ------
    SpecError
        Levels or times that the pad cannot show, or the line cannot carry; frames that are beyond a limit.
    FileError
        The port cannot be opened, nothing answers, it holds another pad or protocol, or the line broke.
    EngineMissingError
        The extra ``play`` is not installed.
    """
    shows = _player(player, "frames")
    if not 1 <= repeat <= MOST_REPEATS:
        raise SpecError(f"must be 1 … {MOST_REPEATS}, got {repeat}", "--repeat")
    if baud < 1:
        raise SpecError(f"must be above 0, got {baud}", "--baud")
    import numpy as np

    from padgen.driver.drive_folder import levels_of
    from padgen.driver.frames import CROSSED
    from padgen.driver.players import FramesJob

    if pattern == CROSSED:
        raise SpecError(f"{CROSSED!r} is of a WAV: the firmware plays each coil its own resonances", "--pattern")
    levels = levels_of(plan, state, frames, text, pattern)
    if levels is None:
        raise SpecError("needs something to show; add --state or --frames", f"--{player}")
    repeated = np.concatenate([levels] * repeat)
    job = FramesJob(
        address=port,
        plan=plan,
        levels=repeated,
        seconds=seconds,
        tuning=_tuning_of(tuning, plan, warm),
        baud=baud,
        on_shown=lambda shown: on_shown(shown, len(repeated)),
    )
    return shows.play(job)


def play_wav(
    path: "str | Path",
    device: int | str | None = None,
    *,
    repeat: int = 1,
    player: str = "audio",
    progress: Progress = _silent,
) -> "Sounded":
    """Play a WAV file of `drive` over a sound card with a channel for each coil.

    Parameters
    ----------
    path : path
        The file.
    device : int or str, optional
        Sound card, by number or a part of its name; by default the computer's first choice.
    repeat : int
        Times that it is played without a pause, 1 to 10,000.
    player : str
        What plays it: "audio", or a player registered in `padgen.driver.players`, whose result is returned.
    progress : callable
        Called with one line of text at each step.

    Raises
    ------
    FileError
        No WAV that can be read, or the device stopped.
    SpecError
        A file that is beyond a limit of its pad; a device that is not there, or that has too few channels or another
        rate.
    EngineMissingError
        The extra ``play`` is not installed.
    """
    if not 1 <= repeat <= MOST_REPEATS:
        raise SpecError(f"must be 1 … {MOST_REPEATS}, got {repeat}", "--repeat")
    from padgen.driver.players import WavJob

    return _player(player, "wav").play(WavJob(device, Path(path), repeat, progress))


def _player(name: str, plays: str) -> Any:
    """Return the player `name`; raise `SpecError` if it does not play what `plays` names ("frames" or "wav")."""
    player = PLAYERS.get(name, "player")
    if plays != player.PLAYS:
        raise SpecError(f"{name!r} plays {player.PLAYS}, not {plays}", "player")
    return player
