"""A multichannel WAV through a sound card, one channel a coil."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from padgen.core.errors import EngineMissingError, FileError, SpecError
from padgen.core.wav_reader import Wave, read_wav
from padgen.driver.formats.wav import BEYOND_LIMIT
from padgen.driver.waveform import blend

__all__ = ["EXTRA", "AudioDevice", "Sounded", "list_devices", "play_wave"]

EXTRA = "play"
FADE_S = 0.05
"""Time of fading in and out where a file is begun or stopped in its middle."""
BLOCK_S = 0.25


@dataclass(frozen=True, slots=True)
class AudioDevice:
    """An output of the computer; `is_default` where none was named."""

    index: int
    name: str
    channels: int
    rate_hz: float
    is_default: bool


@dataclass(frozen=True, slots=True)
class Sounded:
    """The result of playing a file; `missed` blocks came too late and left a gap."""

    device: AudioDevice
    channels: int
    rate_hz: int
    seconds: float
    missed: int


def list_devices() -> list[AudioDevice]:
    """Return all outputs.

    Raises
    ------
    EngineMissingError
        sounddevice or its library PortAudio is not installed.
    """
    sound = _sounddevice()
    try:
        default = int(sound.query_devices(kind="output")["index"])
    except (ValueError, sound.PortAudioError):
        default = -1
    devices = [_device(entry, default) for entry in sound.query_devices()]
    return [device for device in devices if device.channels > 0]


def play_wave(
    path: Path,
    device: int | str | None = None,
    loops: int = 1,
    told: Callable[[AudioDevice], None] = lambda chosen: None,
) -> Sounded:
    """Play the WAV `path`, `loops` times without a pause, through a device (None: the computer's first choice).

    `told` hears which device it is before it sounds. An interrupt fades out, and is raised again.

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
        raise SpecError(f"is not played: it {beyond[0]}", str(path))
    sound = _sounddevice()
    chosen = _chosen(sound, device)
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
    told(chosen)
    try:
        with sound.OutputStream(
            samplerate=wave.rate_hz, device=chosen.index, channels=wave.channels, dtype="float32"
        ) as stream:
            missed = _stream(stream, wave, loops)
    except sound.PortAudioError as error:
        raise FileError(f"{chosen.name} stopped ({error})", str(path)) from error
    return Sounded(chosen, wave.channels, wave.rate_hz, wave.seconds * loops, missed)


def _stream(stream: Any, wave: Wave, loops: int) -> int:
    """Write the file to a stream that is open; how many blocks came too late."""
    size = max(round(BLOCK_S * wave.rate_hz), 1)
    fade = max(round(FADE_S * wave.rate_hz), 1)
    total, done, missed = wave.count * loops, 0, 0
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
    """Return what follows sample `done`, going out smoothly; a file that ends in silence is silent here too."""
    places = (done + np.arange(fade)) % wave.count
    after = wave.read()[places] if wave.count <= fade else _around(wave, int(places[0]), fade)
    return np.ascontiguousarray(after * blend(1 - np.arange(fade) / fade)[:, None], np.float32)


def _around(wave: Wave, start: int, count: int) -> np.ndarray:
    """Return samples from `start` on, the file's beginning after its end."""
    first = wave.read(start, min(start + count, wave.count))
    return np.concatenate([first, wave.read(0, count - len(first))])


def _chosen(sound: Any, device: int | str | None) -> AudioDevice:
    """Find the device that is meant: by number, by a part of its name, or the first choice."""
    if isinstance(device, str) and device.isdigit():
        device = int(device)
    try:
        return _device(sound.query_devices(device, "output"), -1 if device is not None else None)
    except (ValueError, sound.PortAudioError) as error:
        there = "; ".join(f"{d.index} {d.name} ({d.channels} channels)" for d in list_devices()) or "none"
        named = "no output device was found" if device is None else f"no output device {device!r}"
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SpecError(f"{named} ({reason}); there are: {there}", "--audio") from error


def _device(entry: Any, default: int | None) -> AudioDevice:
    """Read a device as sounddevice tells of it; `default` is the number of the first choice, None if this is it."""
    index = int(entry["index"])
    rate, channels = float(entry["default_samplerate"]), int(entry["max_output_channels"])
    return AudioDevice(index, str(entry["name"]), channels, rate, default is None or index == default)


def _sounddevice() -> Any:
    try:
        return import_module("sounddevice")
    except ImportError as error:
        raise EngineMissingError(
            f"needs the package sounddevice ({error}); pip install 'padgen[{EXTRA}]' brings it", "--audio"
        ) from error
    except OSError as error:
        raise EngineMissingError(
            f"needs the library PortAudio ({error}); Debian: apt install libportaudio2, other systems get it with"
            " sounddevice",
            "--audio",
        ) from error
