"""Playing to the compiled firmware over a good, a bad and a lost line, and through a sound card."""

import os
import re
import select
import subprocess
import threading
import time
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from padgen.core.errors import EngineMissingError, FileError, SpecError
from padgen.core.wav_reader import read_wav
from padgen.driver import serial_line as play_serial
from padgen.driver import sound_card as play_audio
from padgen.driver.formats.wav import WavWriter
from padgen.driver.serial_line import VERSION, Kind, Message, decode, encode, plan_hash, play_frames, serial_ports
from padgen.driver.signs import PlayedPad, played_recoil
from padgen.driver.sound_card import list_devices, play_wave
from padgen.driver.waveform import make_drive, ramp_s
from tests.firmware_host import Host, compiled, host

SPEED = 20
"""Speed of the firmware's samples over real time; on a busy machine they pass more slowly."""
FRAME_S = 0.05
REPLY_S = 0.05


class Relay(threading.Thread):
    """A line between a pseudo-terminal and the firmware that damages bytes at random, by a seed."""

    def __init__(
        self, pad: Host, share: float = 0.0, seed: int = 0, closes_after: int | None = None, speed: float = SPEED
    ) -> None:
        super().__init__(daemon=True)
        self.log_path = pad.folder / f"log-{seed}-{share}"
        self.firmware = subprocess.Popen(
            [pad.program, "line", "--speed", str(speed), "--log", self.log_path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self.ours, self.theirs = os.openpty()
        self.port = os.ttyname(self.theirs)
        self.acknowledged: list[int] = []
        self._share, self._rng = share, np.random.default_rng(seed)
        self._closes_after = closes_after
        self._passed = 0
        self._ended = threading.Event()
        self._answers = b""

    def run(self) -> None:
        assert self.firmware.stdin and self.firmware.stdout
        out = self.firmware.stdout.fileno()
        while not self._ended.is_set():
            ready, _, _ = select.select([self.ours, out], [], [], 0.02)
            if self.ours in ready:
                data = os.read(self.ours, 256)
                if self._closes_after is not None and self._passed + len(data) > self._closes_after:
                    self.firmware.stdin.write(data[: self._closes_after - self._passed])
                    self.firmware.stdin.flush()
                    break
                self._passed += len(data)
                self.firmware.stdin.write(self._damaged(data))
                self.firmware.stdin.flush()
            if out in ready:
                data = self._damaged(os.read(out, 256))
                self._note(data)
                os.write(self.ours, data)
        os.close(self.ours)
        os.close(self.theirs)

    def _damaged(self, data: bytes) -> bytes:
        """Return the bytes with some flipped, dropped or doubled, and now and then all of them twice."""
        if not self._share:
            return data
        result = bytearray()
        for byte in data:
            fate = self._rng.random() / self._share
            if fate < 1:
                byte ^= 1 << int(self._rng.integers(8))
            if not 1 <= fate < 2:
                result.append(byte)
            if 2 <= fate < 3:
                result.append(byte)
        return bytes(result) * (2 if self._rng.random() < 10 * self._share else 1)

    def _note(self, data: bytes) -> None:
        """Note the frames that the computer was told are shown."""
        messages, self._answers = decode(self._answers + data)
        for message in messages:
            is_frame = message and message.kind == Kind.ACK and message.payload[0] in (Kind.FRAME, Kind.FRAME_BITS)
            if message and is_frame and message.sequence not in self.acknowledged:
                self.acknowledged.append(message.sequence)

    def finish(self) -> list[str]:
        """Close the line; return the lines of the firmware's log once it has come to rest."""
        self._ended.set()
        self.join(10)
        assert self.firmware.stdin and self.firmware.stdout
        self.firmware.stdin.close()
        assert self.firmware.wait(20) == 0, "the device was not silent in time"
        self.firmware.stdout.close()
        return self.log_path.read_text().splitlines()


@contextmanager
def relayed(pad: Host, **how: float) -> Iterator[Relay]:
    relay = Relay(pad, **how)  # type: ignore[arg-type]
    relay.start()
    try:
        yield relay
    finally:
        if relay.firmware.poll() is None:
            relay.finish()


@pytest.fixture
def pad(tmp_path_factory: pytest.TempPathFactory) -> Host:
    return host("quick", tmp_path_factory)


def numbered(count: int) -> np.ndarray:
    """Return frames of 16 taxels that all differ, in bits and grey."""
    bits = (np.arange(1, count + 1)[:, None] >> np.arange(16) & 1).astype(float)
    bits[::3] *= 0.4
    return bits


def shown(log: list[str]) -> list[list[int]]:
    return [list(bytes.fromhex(line.split()[3])) for line in log if " frame " in line]


def ends_silent(log: list[str]) -> bool:
    return [line.split()[0] for line in log][-2:] == ["silent", "peak"]


# ---- Serial --------------------------------------------------------------------------------------------------------


def test_frames_arrive_in_order_and_it_ends_in_silence(pad: Host):
    frames = numbered(12)
    heard = []
    with relayed(pad) as line:
        played = play_frames(line.port, pad.plan, frames, FRAME_S, reply_s=1.0, on_shown=heard.append)
        log = line.finish()
    assert (played.frames, played.resent) == (12, 0)
    assert played.seconds >= 12 * FRAME_S
    assert heard == list(range(1, 13))
    assert shown(log) == np.rint(frames * 255).astype(int).tolist()
    assert "silence" in log[-3] and ends_silent(log)


def test_frames_have_the_signs_that_keep_the_pad_still(pad: Host):
    plan = pad.plan
    frames = np.ones((2, len(plan.taxels)))
    frames[1, ::3] = 0.0
    with relayed(pad) as line:
        play_frames(line.port, plan, frames, FRAME_S, reply_s=1.0)
        log = line.finish()
    told = [bytes.fromhex(line.split()[4]) for line in log if " frame " in line]
    turned = np.array([np.unpackbits(np.frombuffer(one, np.uint8), bitorder="little") for one in told])
    # Each at its own resonance, all of one frequency: what is left is little more than one taxel's recoil.
    played = PlayedPad(plan, make_drive(plan, 8000))
    recoil = played_recoil(played, frames, np.where(turned, -1.0, 1.0))
    assert recoil.signed_db > recoil.in_step_db + 6
    assert abs(int(turned[0].sum()) - frames.shape[1] // 2) <= 1
    assert not turned[frames == 0].any()


def test_a_frame_that_lasts_longer_than_one_is_held_is_sent_again(pad: Host, monkeypatch):
    monkeypatch.setattr(play_serial, "HOLD_SHARE", 0.02)  # of eight seconds
    frames = numbered(2)
    heard = []
    with relayed(pad) as line:
        play_frames(line.port, pad.plan, frames, 0.4, reply_s=1.0, on_shown=heard.append)
        log = line.finish()
    assert shown(log) == np.repeat(np.rint(frames * 255).astype(int), 3, axis=0).tolist()
    assert (heard[0], heard[-1]) == (1, 2)


def test_what_the_device_takes_back_is_told(pad: Host, tmp_path: Path):
    lower = re.compile(r"(COIL|PAD)_LIMIT_UW \d+")
    warm = compiled(pad.plan, pad.drive, tmp_path, lambda text: lower.sub(r"\1_LIMIT_UW 9000", text))
    given = []
    for one in (pad, warm):
        with relayed(one, speed=1) as line:
            given.append(play_frames(line.port, pad.plan, np.ones((4, 16)), 0.1, reply_s=1.0).given)
    assert given[0] == 1.0 and 0.01 < given[1] < 0.9


def test_a_device_whose_self_test_fails_is_not_played_on(pad: Host, tmp_path: Path):
    spoiled = compiled(pad.plan, pad.drive, tmp_path, lambda text: re.sub(r"(line_a2.*\n\{)", r"\g<1>9", text))
    with relayed(spoiled) as line, pytest.raises(FileError, match="found its tables wrong when it tested itself"):
        play_frames(line.port, pad.plan, numbered(2), FRAME_S, reply_s=1.0)


def test_it_is_silent_when_playing_ends(pad: Host):
    with relayed(pad, speed=1) as line:
        played = play_frames(line.port, pad.plan, numbered(2), 0.1, reply_s=1.0)
        line.finish()
    assert played.seconds >= 2 * 0.1 + 0.95 * ramp_s(pad.plan)


def test_a_device_may_be_a_pseudo_terminal_itself(pad: Host, tmp_path: Path):
    log = tmp_path / "log"
    command = [pad.program, "pty", "--speed", str(SPEED), "--log", log]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as firmware:
        assert firmware.stdout
        port = firmware.stdout.readline().strip()
        play_frames(port, pad.plan, numbered(3), FRAME_S, reply_s=1.0)
        assert firmware.wait(20) == 0
    assert len(shown(log.read_text().splitlines())) == 3
    assert ends_silent(log.read_text().splitlines())


@pytest.mark.parametrize(("seed", "share"), [(1, 0.002), (2, 0.005), (3, 0.01)])
def test_a_bad_line_loses_nothing_and_repeats_nothing(pad: Host, seed: int, share: float, monkeypatch):
    monkeypatch.setattr(play_serial, "TRIES", 40)
    frames = numbered(24)
    with relayed(pad, share=share, seed=seed) as line:
        played = play_frames(line.port, pad.plan, frames, FRAME_S, reply_s=REPLY_S)
        log = line.finish()
    assert played.resent > 0
    assert shown(log) == np.rint(frames * 255).astype(int).tolist()
    assert ends_silent(log)


@pytest.mark.parametrize("closes_after", [60, 105, 150])
def test_a_line_that_closes_leaves_the_device_silent(pad: Host, closes_after: int):
    with relayed(pad, closes_after=closes_after, seed=closes_after) as line:
        with pytest.raises(FileError) as refused:
            play_frames(line.port, pad.plan, numbered(20), FRAME_S, reply_s=1.0)
        log = line.finish()
    assert "the line closed in frame" in refused.value.message
    assert "falls silent by itself within 1." in refused.value.message
    assert refused.value.where == line.port
    count = len(shown(log))
    assert set(line.acknowledged) <= set(range(count))
    assert shown(log) == np.rint(numbered(20)[:count] * 255).astype(int).tolist()
    assert 1 <= count < 20
    assert ends_silent(log)


def test_a_line_that_goes_dead_is_told_of(pad: Host, monkeypatch):
    monkeypatch.setattr(play_serial, "TRIES", 3)
    with relayed(pad) as line:

        def cut(shown: int) -> None:
            line._damaged = lambda data: b""  # type: ignore[method-assign]

        with pytest.raises(FileError, match="no answer in 3 tries"):
            play_frames(line.port, pad.plan, numbered(20), FRAME_S, reply_s=0.1, on_shown=cut)
        log = line.finish()
    assert ends_silent(log)


def test_an_interrupt_is_told_to_the_device(pad: Host):
    def stop(count: int) -> None:
        if count == 3:
            raise KeyboardInterrupt

    with relayed(pad) as line:
        with pytest.raises(KeyboardInterrupt):
            play_frames(line.port, pad.plan, numbered(20), FRAME_S, reply_s=1.0, on_shown=stop)
        time.sleep(0.1)
        log = line.finish()
    assert len(shown(log)) in (2, 3)  # silence goes before a frame that waits
    assert "silence" in log[-3] and ends_silent(log)
    # It was told to: the watchdog would have taken a second.
    last, silence = (int(line.split()[1]) for line in log[-4:-2])
    assert silence - last < 0.8 * pad.number("PADGEN_WATCHDOG_SAMPLES")


@contextmanager
def device(answers: bytes) -> Iterator[str]:
    """Open a port that replies to the first message with `answers`."""
    ours, theirs = os.openpty()

    def answer() -> None:
        if select.select([ours], [], [], 5)[0]:
            os.read(ours, 256)
            os.write(ours, answers)

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        thread.join(6)
        os.close(ours)
        os.close(theirs)


def test_another_pads_firmware_is_refused(pad: Host, small_plan):
    with relayed(pad) as line:
        with pytest.raises(FileError) as refused:
            play_frames(line.port, small_plan, np.ones((1, 4)), reply_s=1.0)
        line.finish()
    assert refused.value.message == (
        f"holds another pad or print (16 taxels, {plan_hash(pad.plan).hex()}) than 'tiny' (4 taxels,"
        f" {plan_hash(small_plan).hex()}); write its firmware anew with padgen drive --formats c, and compile it, or"
        " name its tuning (--tuning)"
    )


def test_another_version_is_refused(pad: Host):
    answer = encode(Message(Kind.NAK, 1, b"\x01\x02\0\0", VERSION + 1))
    with (
        device(answer) as port,
        pytest.raises(FileError, match="speaks version 2 of the protocol, this padgen version 1"),
    ):
        play_frames(port, pad.plan, np.ones((1, 16)), reply_s=0.5)


def test_a_device_that_says_nothing_or_nonsense(pad: Host):
    for babble in (b"", b"boot v1.2\r\n\0", encode(Message(Kind.GREETING, 1, b"short"))):
        with device(babble) as port, pytest.raises(FileError, match=r"nothing answers within 0\.2 s; is the firmware"):
            play_frames(port, pad.plan, np.ones((1, 16)), reply_s=0.1, greet_s=0.2)


@pytest.mark.parametrize(("port", "baud", "sentence"), [
    ("/dev/no-such-port", 115200, "/dev/no-such-port: cannot be opened"),
    ("/dev/null", 115200, "/dev/null: cannot be opened"),
    ("/dev/null", -5, "/dev/null: cannot be opened"),
])  # fmt: skip
def test_a_port_that_is_none(pad: Host, port: str, baud: int, sentence: str):
    with pytest.raises(FileError) as refused:
        play_frames(port, pad.plan, np.ones((1, 16)), baud=baud)
    assert str(refused.value).startswith(sentence)
    assert "serial ports that there are: " in str(refused.value)


def test_a_port_that_another_program_plays_to(pad: Host):
    import serial

    ours, theirs = os.openpty()
    with serial.Serial(os.ttyname(theirs), exclusive=True), pytest.raises(FileError, match="cannot be opened"):
        play_frames(os.ttyname(theirs), pad.plan, np.ones((1, 16)))
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(("frames", "frame_s", "sentence"), [
    (np.ones((2, 15)), None, "frames: must be one or more rows of 16 levels, got 2 x 15"),
    (np.full((1, 16), np.nan), None, "frames: levels must be in 0 … 1, got nan"),
    (np.full((1, 16), 1.5), None, "frames: levels must be in 0 … 1, got 1.5"),
    (np.ones((1, 16)), 0.001, "--seconds: a frame of "),
])  # fmt: skip
def test_frames_that_cannot_be_shown_open_no_port(pad: Host, frames: np.ndarray, frame_s: float, sentence: str):
    with pytest.raises(SpecError) as refused:
        play_frames("/dev/no-such-port", pad.plan, frames, frame_s)
    assert str(refused.value).startswith(sentence)


def test_frames_that_the_line_cannot_carry(pad: Host):
    with relayed(pad) as line:
        with pytest.raises(SpecError, match=r"a frame of 29 bytes needs at least .* s at 300 baud, got 0\.2 s"):
            play_frames(line.port, pad.plan, np.full((1, 16), 0.5), 0.2, baud=300, reply_s=1.0)
        line.finish()


def test_without_pyserial(pad: Host, monkeypatch):
    monkeypatch.setattr(play_serial, "import_module", missing)
    for call in (lambda: play_frames("x", pad.plan, np.ones((1, 16))), serial_ports):
        with pytest.raises(
            EngineMissingError, match=r"--port: needs the package pyserial .* pip install 'padgen\[play\]'"
        ):
            call()


def missing(name: str) -> types.ModuleType:
    raise ModuleNotFoundError(f"No module named {name!r}")


# ---- Audio ---------------------------------------------------------------------------------------------------------


class PortAudioError(Exception):
    pass


class Stream:
    """An output that keeps the samples written to it, and may fail or be interrupted after some blocks."""

    def __init__(self, card: "Card", **settings: object) -> None:
        self.card = card
        card.settings = settings

    def __enter__(self) -> "Stream":
        return self

    def __exit__(self, *args: object) -> None:
        self.card.closed = True

    def write(self, block: np.ndarray) -> bool:
        assert block.dtype == np.float32 and block.flags.c_contiguous
        if self.card.error and len(self.card.blocks) == 2:
            error = self.card.error
            self.card.error = None
            raise error
        self.card.blocks.append(block)
        return len(self.card.blocks) == 1


class Card:
    """The parts of sounddevice that padgen uses, with outputs that are not real."""

    PortAudioError = PortAudioError

    def __init__(self, outputs: int = 16, rates: tuple[int, ...] = (48000,)) -> None:
        self.entries = [
            {"index": 0, "name": "Microphone", "max_output_channels": 0, "default_samplerate": 44100.0},
            {"index": 1, "name": "Loud 16", "max_output_channels": outputs, "default_samplerate": 48000.0},
        ]
        self.rates = rates
        self.blocks = []
        self.closed = False
        self.settings: dict[str, object] = {}
        self.error: BaseException | None = None

    def query_devices(self, device: int | str | None = None, kind: str | None = None) -> object:
        if device is None and kind is None:
            return self.entries
        found = [e for e in self.entries if device in (None, e["index"]) or str(device) in str(e["name"])]
        found = [e for e in found if e["max_output_channels"]]
        if not found:
            raise ValueError(f"No output device matching {device!r}")
        return found[0]

    def check_output_settings(self, samplerate: int, **_: object) -> None:
        if samplerate not in self.rates:
            raise PortAudioError("Invalid sample rate")

    def OutputStream(self, **settings: object) -> Stream:  # noqa: N802
        return Stream(self, **settings)


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Card:
    card = Card()
    monkeypatch.setattr(play_audio, "import_module", lambda name: card)
    return card


def wave(path: Path, channels: int = 4, seconds: float = 0.6, rate_hz: int = 48000, silent_ends: bool = True) -> Path:
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    tone = 0.5 * np.cos(2 * np.pi * 50 * t)
    if silent_ends:
        tone *= np.sin(np.pi * t / seconds) ** 2
    with WavWriter(path, rate_hz, channels, len(t), "float") as file:
        file.write(tone[:, None] * np.arange(1, channels + 1) / channels)
    return path


def test_a_file_sounds_as_it_is(card: Card, tmp_path: Path):
    path = wave(tmp_path / "a.wav", silent_ends=False)
    chosen = []
    played = play_wave(path, on_chosen=chosen.append)
    sounded = np.concatenate(card.blocks)
    samples = read_wav(path).read()
    fade = round(0.05 * 48000)
    assert sounded.shape == (len(samples) + fade, 4)
    assert np.array_equal(sounded[fade : len(samples)], samples[fade:].astype(np.float32))
    assert card.settings == {"samplerate": 48000, "device": 1, "channels": 4, "dtype": "float32"}
    assert (played.device.name, played.missed) == ("Loud 16", 1)
    assert chosen == [played.device]
    assert card.closed


def test_a_loop_has_no_seam_and_comes_and_goes_smoothly(card: Card, tmp_path: Path):
    path = wave(tmp_path / "a.wav", silent_ends=False)
    played = play_wave(path, device="Loud", loops=3)
    sounded = np.concatenate(card.blocks)[:, 3]
    step = 0.5 * 2 * np.pi * 50 / 48000
    fading = 0.5 * 2.5 / (0.05 * 48000)
    assert np.abs(np.diff(sounded)).max() <= step + fading
    assert sounded[0] == 0 and abs(sounded[-1]) < 1e-6
    samples = read_wav(path).read()[:, 3].astype(np.float32)
    assert np.array_equal(sounded[len(samples) : 3 * len(samples)], np.tile(samples, 2))
    assert played.seconds == pytest.approx(1.8)
    assert len(sounded) == 3 * 28800 + 2400


def test_an_interrupt_fades_out(card: Card, tmp_path: Path):
    card.error = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        play_wave(wave(tmp_path / "a.wav", seconds=3, silent_ends=False))
    sounded = np.concatenate(card.blocks)[:, 0]
    assert len(sounded) == 2 * 12000 + 2400
    assert np.abs(np.diff(sounded)).max() < 0.01 and abs(sounded[-1]) < 1e-6
    assert card.closed


def test_a_device_that_stops_is_told_of(card: Card, tmp_path: Path):
    card.error = PortAudioError("Device unavailable")
    with pytest.raises(FileError, match=r"Loud 16 stopped \(Device unavailable\)"):
        play_wave(wave(tmp_path / "a.wav", seconds=3))


@pytest.mark.parametrize(("channels", "rate_hz", "device", "sentence"), [
    (17, 48000, None, "--audio: Loud 16 (device 1) has 16 output channels, a.wav needs 17, one a coil"),
    (4, 44100, 1, "--audio: Loud 16 (device 1) does not play 4 channels at 44100 Hz (Invalid sample rate);"
     " its own rate is 48000 Hz, for which padgen drive --rate writes"),
    (4, 48000, "Tuba", "--audio: no output device 'Tuba' (No output device matching 'Tuba');"
     " there are: 1 Loud 16 (16 channels)"),
    (4, 48000, "7", "--audio: no output device 7 (No output device matching 7); there are: 1 Loud 16 (16 channels)"),
])  # fmt: skip
def test_what_a_device_cannot_play(card: Card, tmp_path: Path, channels: int, rate_hz: int, device, sentence: str):
    with pytest.raises(SpecError) as refused:
        play_wave(wave(tmp_path / "a.wav", channels, 0.1, rate_hz), device)
    assert str(refused.value) == sentence
    assert not card.blocks


def test_files_and_loops_that_are_none(card: Card, tmp_path: Path):
    with pytest.raises(FileError, match="has no samples"):
        play_wave(wave(tmp_path / "a.wav", seconds=0))
    with pytest.raises(FileError, match="there is no such file"):
        play_wave(tmp_path / "b.wav")
    with pytest.raises(SpecError, match="must be at least 1 time, got 0"):
        play_wave(wave(tmp_path / "a.wav"), loops=0)


def test_outputs_are_listed(card: Card):
    (only,) = list_devices()
    assert (only.index, only.name, only.channels, only.rate_hz) == (1, "Loud 16", 16, 48000.0)


def test_without_sounddevice_or_its_library(tmp_path: Path, monkeypatch):
    path = wave(tmp_path / "a.wav")
    monkeypatch.setattr(play_audio, "import_module", missing)
    with pytest.raises(
        EngineMissingError, match=r"sound card: needs the package sounddevice .* pip install 'padgen\[play\]'"
    ):
        play_wave(path)

    def no_library(name: str) -> types.ModuleType:
        raise OSError("PortAudio library not found")

    monkeypatch.setattr(play_audio, "import_module", no_library)
    with pytest.raises(EngineMissingError, match=r"needs the library PortAudio \(PortAudio library not found\)"):
        list_devices()
