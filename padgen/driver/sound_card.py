"""Play a multichannel WAV through a sound card's outputs, and record from its inputs."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from padgen.core.errors import EngineMissingError, FileError, SolverError, SpecError
from padgen.core.wav_reader import Wave, read_wav
from padgen.driver.formats.wav import BEYOND_LIMIT
from padgen.driver.waveform import blend

__all__ = [
    "EXTRA",
    "AudioDevice",
    "Sounded",
    "audio_device",
    "list_devices",
    "play_wave",
    "record_input",
]

EXTRA = "play"
FADE_S = 0.05
"""Time of fading in and out where a file is begun or stopped in its middle."""
BLOCK_S = 0.25
LOOK_S = 0.1
LATE = 2
FEWEST_LOOKS = 50
"""Seconds between two looks at a recording; the share of its length, and the looks more, after which it is given up."""


@dataclass(frozen=True, slots=True)
class AudioDevice:
    """An output, or an input, of the computer."""

    index: int
    name: str
    channels: int
    rate_hz: float


@dataclass(frozen=True, slots=True)
class Sounded:
    """The result of playing a file; `missed` blocks came too late and left a gap."""

    device: AudioDevice
    seconds: float
    missed: int


def list_devices(kind: str = "output") -> list[AudioDevice]:
    """Return all outputs, or with `kind` 'input' all inputs.

    Raises
    ------
    EngineMissingError
        sounddevice or its library PortAudio is not installed.
    """
    devices = [_device(entry, kind) for entry in _sounddevice().query_devices()]
    return [device for device in devices if device.channels > 0]


def play_wave(
    path: Path,
    device: int | str | None = None,
    loops: int = 1,
    on_chosen: Callable[[AudioDevice], None] = lambda chosen: None,
) -> Sounded:
    """Play the WAV `path`, `loops` times without a pause, through a device (None: the computer's first choice).

    `on_chosen` hears which device it is before it sounds. An interrupt fades out, and is raised again.

    Raises
    ------
    FileError
        No WAV that can be read, or the device stopped.
    SpecError
        A file that is beyond a limit of its pad; a device that is not there, or that has too few channels or another
        rate.
    EngineMissingError
        sounddevice or its library PortAudio is not installed.
    """
    wave = read_wav(path)
    if not wave.count:
        raise FileError("has no samples", str(path))
    if loops < 1:
        raise SpecError(f"must be at least 1 time, got {loops}", "--loops")
    _, *beyond = wave.comment.split(BEYOND_LIMIT)
    if beyond:
        raise SpecError(f"is not played: {beyond[0]}", str(path))
    sound = _sounddevice()
    chosen = audio_device(device)
    named = f"{chosen.name} (device {chosen.index})"
    if wave.channels > chosen.channels:
        raise SpecError(
            f"{named} has {chosen.channels} output channels, {wave.path.name} needs {wave.channels}, one a coil",
            "--audio",
        )
    try:
        sound.check_output_settings(
            device=chosen.index, channels=wave.channels, dtype="float32", samplerate=wave.rate_hz
        )
    except (ValueError, sound.PortAudioError) as error:
        raise SpecError(
            f"{named} does not play {wave.channels} channels at {wave.rate_hz} Hz ({error}); its own rate is"
            f" {chosen.rate_hz:g} Hz, for which padgen drive --rate writes",
            "--audio",
        ) from error
    on_chosen(chosen)
    try:
        with sound.OutputStream(
            samplerate=wave.rate_hz, device=chosen.index, channels=wave.channels, dtype="float32"
        ) as stream:
            missed = _stream(stream, wave, loops)
    except sound.PortAudioError as error:
        raise FileError(f"{chosen.name} stopped ({error})", str(path)) from error
    return Sounded(chosen, wave.seconds * loops, missed)


def _stream(stream: Any, wave: Wave, loops: int) -> int:
    """Write the file to a stream that is open; return how many blocks came too late."""
    size = max(round(BLOCK_S * wave.rate_hz), 1)
    fade = max(round(FADE_S * wave.rate_hz), 1)
    total = wave.count * loops
    done = 0
    missed = 0
    try:
        while done < total:
            start = done % wave.count
            block = wave.read(start, min(start + size, wave.count))
            if done < fade:
                share = np.minimum((done + np.arange(len(block))) / fade, 1.0)
                block = block * blend(share)[:, None]
            missed += bool(stream.write(np.ascontiguousarray(block, np.float32)))
            done += len(block)
        stream.write(_faded_out(wave, total, fade))
    except KeyboardInterrupt:
        stream.write(_faded_out(wave, done, fade))
        raise
    return missed


def _faded_out(wave: Wave, done: int, fade: int) -> np.ndarray:
    """Return the `fade` samples that follow sample `done`, faded out; after its end the file begins again."""
    start = done % wave.count
    again = np.resize(wave.read(0, fade), (fade, wave.channels))
    after = np.concatenate([wave.read(start, start + fade), again])[:fade]
    return np.ascontiguousarray(after * blend(1 - np.arange(fade) / fade)[:, None], np.float32)


def audio_device(device: int | str | None, kind: str = "output", where: str = "--audio") -> AudioDevice:
    """Find the output, or the input, that is meant: by number, by a part of its name, or the first choice.

    Raises
    ------
    SpecError
        There is none; the sentence has those that there are, and begins with the option `where`.
    EngineMissingError
        sounddevice or its library PortAudio is not installed.
    """
    sound = _sounddevice()
    if isinstance(device, str) and device.isdigit():
        device = int(device)
    try:
        return _device(sound.query_devices(device, kind), kind)
    except (ValueError, sound.PortAudioError) as error:
        there = "; ".join(f"{d.index} {d.name} ({d.channels} channels)" for d in list_devices(kind)) or "none"
        named = f"no {kind} device was found" if device is None else f"no {kind} device {device!r}"
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SpecError(f"{named} ({reason}); there are: {there}", where) from error


def _device(entry: Any, kind: str) -> AudioDevice:
    """Return the device of sounddevice's `entry`, with its channels of this `kind`, 'output' or 'input'."""
    rate = float(entry["default_samplerate"])
    channels = int(entry[f"max_{kind}_channels"])
    return AudioDevice(int(entry["index"]), str(entry["name"]), channels, rate)


def record_input(
    source: AudioDevice,
    rate_hz: int,
    seconds: float,
    sink: AudioDevice | None = None,
    played: np.ndarray | None = None,
    outputs: int = 1,
    channel: int = 0,
    begin: Callable[[], None] | None = None,
    on_progress: Callable[[float], None] = lambda seconds: None,
) -> np.ndarray:
    """Return samples (n,) of an input's first channel, recorded for `seconds` while `played` (k,) sounds on a `sink`.

    It sounds on one `channel` of `outputs`, the others are silent. Where there is `begin`, it is called once the input
    runs, and the seconds count from its end. `on_progress` hears how many are recorded. An interrupt fades out
    what is played, and is raised again.

    Raises
    ------
    SpecError
        The devices do not run at this rate, or not together.
    FileError
        The device stopped.
    SolverError
        Samples were lost.
    """
    sound = _sounddevice()
    over = Event()
    stopped = Event()
    lost = Event()
    sounds = np.zeros(0) if played is None else played
    heard: list[np.ndarray] = []
    wanted = round(seconds * rate_hz)
    done = 0
    count = wanted if begin is None else sys.maxsize

    def block(samples: np.ndarray, *more: Any) -> None:
        nonlocal done
        *out, _, _, status = more
        # What is lost before the first block only delays what is heard, by as much as the fit then finds.
        if done and (status.input_overflow or status.output_underflow):
            lost.set()
        heard.append(samples[:, 0].copy())
        for sounding in out:
            part = sounds[done : done + len(samples)]
            sounding[:] = 0
            sounding[: len(part), channel] = part
            if stopped.is_set():
                sounding *= blend(np.linspace(1, 0, len(samples)))[:, None]
        done += len(samples)
        if done >= count or stopped.is_set():
            raise sound.CallbackStop

    settings = {"samplerate": rate_hz, "dtype": "float32", "callback": block, "finished_callback": over.set}
    try:
        if sink is None:
            stream = sound.InputStream(device=source.index, channels=1, **settings)
        else:
            stream = sound.Stream(device=(source.index, sink.index), channels=(1, outputs), **settings)
        with stream:
            try:
                if begin is not None:
                    begin()
                    count = done + wanted
                for _ in range(int(LATE * seconds / LOOK_S) + FEWEST_LOOKS):
                    if over.wait(LOOK_S):
                        break
                    on_progress(done / rate_hz)
            except BaseException:
                stopped.set()
                over.wait(1.0)
                raise
    except (ValueError, sound.PortAudioError) as error:
        names = source.name if sink is None else f"{sink.name} and {source.name}"
        raise SpecError(f"{names} cannot record at {rate_hz} Hz ({error})", "--record") from error
    if done < count:
        raise FileError("stopped before the recording was over; is it still connected?", source.name)
    if lost.is_set():
        raise SolverError("samples were lost: close other programs, or take a lower --rate", source.name)
    return np.concatenate(heard)[:count].astype(float)


def _sounddevice() -> Any:
    try:
        return import_module("sounddevice")
    except ImportError as error:
        raise EngineMissingError(
            f"needs the package sounddevice ({error}); pip install 'padgen[{EXTRA}]' brings it", "sound card"
        ) from error
    except OSError as error:
        raise EngineMissingError(
            f"needs the library PortAudio ({error}); Debian: apt install libportaudio2, other systems get it with"
            " sounddevice",
            "sound card",
        ) from error
