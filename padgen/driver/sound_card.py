"""A sound card: a multichannel WAV through its outputs, recordings by its inputs, and a session that measures a print.

In a session every coil in turn plays a sweep, and an input hears the taxels. A recording has the coil's current, as it
is known to be played, and what was heard, so that the files are what ``padgen retune`` reads. Delay and clock between
the two are found by the fit. A file is kept once it is fitted: a session that was stopped goes on with what is missing.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from padgen.core.errors import EngineMissingError, FileError, SolverError, SpecError
from padgen.core.files import OutputFolder, differs, recover
from padgen.core.units import MH
from padgen.core.wav_reader import Wave, read_wav
from padgen.driver.excitation import excitation, sweep_table
from padgen.driver.formats.wav import BEYOND_LIMIT, WavWriter
from padgen.driver.loads import excitation_load, judge_load
from padgen.driver.serial_line import BAUD, excite
from padgen.driver.waveform import blend
from padgen.measured.fits import TaxelFit, fit_measured
from padgen.measured.read import read_measured
from padgen.measured.shaking import measuring_band_hz, ring_s, sweep_s
from padgen.measured.tuning import Tuning
from padgen.physics.resonance_fit import current_of_voltage
from padgen.planner.plan import Plan, plan_to_json

__all__ = [
    "EXTRA",
    "RECORDED",
    "AudioDevice",
    "Bench",
    "Sounded",
    "audio_device",
    "bench",
    "list_devices",
    "play_wave",
    "recorded",
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
    """Return what follows sample `done`, going out smoothly; a file that ends in silence is silent here too."""
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
    """Read a device as sounddevice tells of it."""
    rate = float(entry["default_samplerate"])
    channels = int(entry[f"max_{kind}_channels"])
    return AudioDevice(int(entry["index"]), str(entry["name"]), channels, rate)


def recorded(
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
    """Record the first channel of an input for some seconds, as (n,), while `played` (k,) sounds on a `sink`.

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


RECORDED = "recorded"
TRIED = "tried"
"""Folder of the recordings, and in it that of those which could not be fitted."""
LATE_S = 0.5
"""Longest time by which what is heard may come after what is played."""
BELOW_FULL = 0.99
FULL = 0.9999
"""Largest value of the current in a file, which would else look clipped; the value from which an input is."""
KEPT = 16
"""Least samples in a file, over periods of the highest frequency that is measured."""
LONGER = 2.0
"""Factor on a sweep's length with each repetition."""
Told = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Bench:
    """The set-up of a session: its plan, its folder, the input that hears, and what plays.

    That is the output `sink`, or the firmware at `port`, which knows the print by `tuning`.
    """

    plan: Plan
    folder: Path
    source: AudioDevice
    sink: AudioDevice | None
    rate_hz: int
    port: str = ""
    baud: int = BAUD
    tuning: Tuning | None = None

    @property
    def recordings(self) -> Path:
        """The folder of the session's recordings."""
        return self.folder / RECORDED

    @property
    def by_hand(self) -> bool:
        """True where the output has too few channels, so that each coil has to be connected to the first one."""
        return self.sink is not None and self.sink.channels < self.plan.coils.rows * self.plan.coils.columns

    def names(self, by_coil: bool = False) -> tuple[str, ...]:
        """Return the taxels to record, or the coils all of whose taxels are heard at once."""
        if by_coil:
            return tuple(dict.fromkeys(taxel.id.partition("k")[0] for taxel in self.plan.taxels))
        return tuple(taxel.id for taxel in self.plan.taxels)

    def is_kept(self, name: str) -> bool:
        """Return whether a recording of this taxel or coil is there already."""
        return (self.recordings / f"{name}.wav").exists()

    def take(self, name: str, attempt: int, nearest: bool, notify: Told) -> tuple[TaxelFit, ...]:
        """Record a taxel or a coil, fit it, and keep the file; `attempt` counts repetitions, whose sweeps are longer.

        Raises
        ------
        SolverError
            No resonance is seen, and the file is kept aside; or samples were lost. The sentence says what to do.
        FileError
            A device stopped.
        SpecError
            The excitation is beyond a limit, or devices do not go together.
        """
        plan = self.plan
        sink = self.sink
        row, column = next(t.coil for t in plan.taxels if name in (t.id, t.id.partition("k")[0]))
        coil = row * plan.coils.columns + column
        outputs = 1 if self.by_hand else plan.coils.rows * plan.coils.columns
        played: np.ndarray | None = None
        chirp = excitation(plan, "chirp", self.rate_hz, sweep_s(plan) * (1 if sink is None else LONGER**attempt))
        beyond = next(judge_load("", plan, excitation_load(plan, chirp)), None)
        if beyond is not None:
            raise SpecError(f"its excitation is not played: {beyond.message}", plan.name)
        if sink is None:
            volts = sweep_table(plan).voltage_v(self.rate_hz)
            ohms = plan.spec.coil.resistance_ohm
            henries = plan.spec.coil.inductance_mh * MH
            current = current_of_voltage(self.rate_hz, volts, ohms, henries)
            seconds = ring_s(plan) + LATE_S
        else:
            current = chirp.current_a
            seconds = len(chirp.current_a) / self.rate_hz + LATE_S
            played = chirp.voltage_v / plan.spec.drive.voltage_limit_v

        def by_firmware() -> None:
            notify(f"{name}: the firmware plays its sweep")
            excite(self.port, plan, coil, tuning=self.tuning, baud=self.baud)

        heard = recorded(
            self.source,
            self.rate_hz,
            seconds,
            sink,
            played,
            outputs,
            min(coil, outputs - 1),
            by_firmware if sink is None else None,
            lambda done: notify(f"{name}: {done:.1f} s of {max(done, seconds):.1f} s"),
        )
        notify(f"{name}: fitting")
        path = self.folder / RECORDED / TRIED / f"{name}.wav"
        for each in (path.parents[1], path.parent, path.parents[1] / path.name):
            if each.is_symlink():
                raise FileError("is a link, where recordings must be; remove it", str(each))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)  # it may be a link
        # Means over some samples are enough, and do not fill the disk; one that was clipped stays so.
        most = int(self.rate_hz / (KEPT * measuring_band_hz(plan)[1]))
        step = max((k for k in range(1, most + 1) if self.rate_hz % k == 0), default=1)
        parts = np.zeros((max(len(heard), len(current)) // step + 1, step, 2))
        parts.reshape(-1, 2)[: len(current), 0] = current * (BELOW_FULL / np.abs(current).max())
        parts.reshape(-1, 2)[: len(heard), 1] = heard
        kept = parts.mean(1)
        clipped = np.abs(parts[..., 1]).max(1) >= FULL
        kept[clipped, 1] = np.sign(kept[clipped, 1])
        with WavWriter(path, self.rate_hz // step, 2, len(kept), "float") as file:
            file.write(kept)
        try:
            fits = fit_measured(read_measured([path], plan), plan, nearest)
        except FileError as error:
            raise SolverError(error.message, error.where) from error
        path.replace(self.folder / RECORDED / path.name)
        return fits


def bench(
    plan: Plan,
    folder: Path,
    device: str | None = None,
    record: str | None = None,
    rate_hz: int | None = None,
    port: str = "",
    baud: int = BAUD,
    tuning: Tuning | None = None,
) -> Bench:
    """Find the devices of a session, and begin its folder or go on in it.

    `device` and `record` are an output and an input, by number or a part of their names (None: the computer's first
    choice); with a serial `port` the firmware plays instead, as it was written for `tuning`. `rate_hz` None: the
    output's own, or the input's.

    Raises
    ------
    SpecError
        A device is not there.
    FileError
        The folder has recordings of another plan.
    EngineMissingError
        sounddevice or its library PortAudio is not installed.
    """
    sink = None if port else audio_device(device, where="--device")
    try:
        source = audio_device(record, "input", "--record")
    except SpecError as error:
        raise SpecError(
            f"{error.message}; without an input, record by other means, one file a taxel, named as"
            f" {plan.taxels[0].id}.wav in a folder, and give it to padgen retune",
            error.where,
        ) from error
    text = plan_to_json(plan)
    recover(folder)
    if any((folder / RECORDED).glob("*.wav")) and differs(folder, "plan.json", text):
        raise FileError("has recordings of another plan; name another folder with -o", str(folder))
    with OutputFolder(folder) as out:
        out.write("plan.json", text)
        out.commit()
    rate = round((sink or source).rate_hz) if rate_hz is None else rate_hz
    return Bench(plan, folder, source, sink, rate, port, baud, tuning)
