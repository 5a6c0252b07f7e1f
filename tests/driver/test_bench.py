"""`padgen bench` against a simulated sound card and the compiled firmware, both of which shake a modelled print.

The print is modelled apart from padgen: a coil's R and L, its squared current, and every taxel as a state space,
discretised exactly for signals that are straight between samples. A contact microphone hears velocity, hum and noise.
"""

import builtins
import json
import os
import re
import subprocess
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import wavfile
from scipy.signal import cont2discrete, lfilter

import padgen as pg
import padgen.driver.bench
from padgen import cli
from padgen.core.errors import FileError, SolverError
from padgen.driver import sound_card
from padgen.driver.excitation import sweep_table
from padgen.driver.serial_line import Kind, Message, Reason, State, excite, refusal
from padgen.driver.sound_card import audio_device, record_input
from padgen.driver.waveform import make_drive
from padgen.spec import parse_spec
from tests.firmware_host import compiled, feed, host

FOUR = """
name = "four"
resolution = 4
band_hz = [50, 200]
q_min = 15
[pad]
width_mm = 26
depth_mm = 14
[coil]
grid = [1, 2]
"""
RATE_HZ = 8000
HEARD = 40.0
"""Gain of the input: about a third of its full scale."""


class Print:
    """A print of a plan whose resonances and Q are off, as a sensor on one of its taxels hears it."""

    def __init__(self, plan, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.plan = plan
        self.rng = rng
        self.at = ""
        self.gain = 1.0
        self.true = {
            taxel.id: (
                plan.channels[taxel.channel].resonance_hz * rng.uniform(0.85, 1.15),
                plan.channels[taxel.channel].q * rng.uniform(0.8, 1.2),
            )
            for taxel in plan.taxels
        }
        self.rest()

    def rest(self) -> None:
        self._states = {}
        self.samples = 0

    def heard(self, volts: np.ndarray) -> np.ndarray:
        """Return what the input hears (n,) while the coils get `volts` (n, coils)."""
        coil = self.plan.spec.coil
        total = 0.003 * self.rng.standard_normal(len(volts))
        time = (self.samples + np.arange(len(volts))) / RATE_HZ
        total += 0.005 * np.cos(2 * np.pi * 50.02 * time)
        for k in range(volts.shape[1]):
            ampere = self._filtered(k, ([1.0], [coil.inductance_mh * 1e-3, coil.resistance_ohm]), volts[:, k])
            for name, (hz, q) in self.true.items():
                if name.startswith("r{}c{}k".format(*divmod(k, self.plan.coils.columns))):
                    omega = 2 * np.pi * hz
                    system = ([omega, 0.0], [1.0, omega / q, omega**2])
                    share = 1.0 if name.startswith(self.at or "none") else 0.02
                    total += HEARD * share * self._filtered(name, system, ampere**2)
        self.samples += len(volts)
        return np.clip(self.gain * total, -1, 1 - 2.0**-15)  # 16 bits

    def _filtered(self, key, system, signal: np.ndarray) -> np.ndarray:
        (num,), den, _ = cont2discrete(system, 1 / RATE_HZ, "foh")
        out, self._states[key] = lfilter(num, den, signal, zi=self._states.get(key, np.zeros(len(den) - 1)))
        return out


class PortAudioError(Exception):
    pass


class CallbackStop(Exception):  # noqa: N818
    pass


class Card:
    """The parts of sounddevice that padgen records with; its output drives the coils of a `Print`."""

    PortAudioError = PortAudioError
    CallbackStop = CallbackStop

    def __init__(self, pad: Print, outputs: int = 2, inputs: int = 1, gain: float = 1.0) -> None:
        pad.gain = gain
        self.pad = pad
        self.outputs = outputs
        self.sounded = []
        self.status = SimpleNamespace(input_overflow=False, output_underflow=False)
        self.breaks_after = 10**9
        self.source = None
        self.entries = [
            {"index": 0, "name": "Mike", "max_input_channels": inputs, "max_output_channels": 0},
            {"index": 1, "name": "Loud", "max_input_channels": 0, "max_output_channels": outputs},
        ]

    def query_devices(self, device=None, kind=None):
        entries = [{**entry, "default_samplerate": float(RATE_HZ)} for entry in self.entries]
        if device is None and kind is None:
            return entries
        found = [e for e in entries if device in (None, e["index"]) or str(device) in e["name"]]
        found = [e for e in found if e[f"max_{kind}_channels"]]
        if not found:
            raise ValueError(f"No {kind} device matching {device!r}")
        return found[0]

    def Stream(self, channels, **settings):  # noqa: N802
        return Running(self, channels[1], **settings)

    def InputStream(self, channels, **settings):  # noqa: N802
        return Running(self, 0, **settings)


class Running:
    """A stream that calls back from a thread of its own, as fast as it is answered; heard is a block late."""

    def __init__(self, card, outputs, samplerate, dtype, callback, finished_callback, device) -> None:
        if samplerate != RATE_HZ:
            raise PortAudioError("Invalid sample rate")
        self.card = card
        self.outputs = outputs
        self.callback = callback
        self.over = finished_callback
        self.thread = threading.Thread(target=self.run, daemon=True)

    def __enter__(self):
        self.card.pad.rest()
        self.card.sounded.append([])
        self.thread.start()
        return self

    def __exit__(self, *error) -> None:
        self.card.breaks_after = 0
        self.thread.join(10)
        self.card.breaks_after = 10**9

    def run(self) -> None:
        late = np.zeros((1024, self.card.outputs))
        volts = self.card.pad.plan.spec.drive.voltage_limit_v
        for _ in range(10**9):
            if len(self.card.sounded[-1]) >= self.card.breaks_after:
                break
            if self.card.source:
                late = self.card.source()
            heard = self.card.pad.heard(late if not self.outputs else late * volts)
            out = np.full((1024, self.outputs), np.nan, np.float32)
            block = [heard[:, None].astype(np.float32), *([out] if self.outputs else [])]
            try:
                self.callback(*block, len(heard), None, self.card.status)
            except CallbackStop:
                break
            finally:
                late = out
                self.card.sounded[-1].append(out)
        self.over()


@pytest.fixture(scope="module")
def plan():
    return pg.plan(parse_spec(FOUR))


@pytest.fixture
def card(plan, tmp_path, monkeypatch) -> Card:
    card = Card(Print(plan, 3))
    monkeypatch.setattr(sound_card, "import_module", lambda name: card)
    monkeypatch.chdir(tmp_path)
    Path("four.toml").write_text(FOUR)
    return card


@pytest.fixture
def person(card, monkeypatch, capsys):
    """Give a person's deeds by the name that is asked for, which also move the sensor, and what was asked."""
    deeds = {}
    asked = []
    said = []

    def answer() -> str:
        told = capsys.readouterr()
        prompt = told.err.rpartition("\n")[2]
        asked.append(prompt)
        said.append(told.out)
        name = re.search(r"r0c\d(k\d)?(?=:| are heard:)", prompt)[0]
        deed = deeds.pop(name, "")
        if deed == "interrupt":
            raise KeyboardInterrupt
        card.pad.at = "nowhere" if deed == "forgets" else name
        return deed if deed == "s" else ""

    monkeypatch.setattr(builtins, "input", answer)
    monkeypatch.setattr(cli.retune.sys.stdin, "isatty", lambda: True, raising=False)
    return deeds, asked, said


def measured(folder: Path) -> dict[str, dict]:
    return {t["id"]: t for t in json.loads((folder / "tuning.json").read_text())["taxels"]}


def compare(card: Card, folder: Path, names: list[str]) -> None:
    """The bars of a fit: f within 0.2 %, Q within 10 %; what was not measured is said to be."""
    tuned = measured(folder)
    assert [name for name, taxel in tuned.items() if taxel["measured"]] == names
    for name in names:
        hz, q = card.pad.true[name]
        assert tuned[name]["resonance_hz"] == pytest.approx(hz, rel=2e-3)
        assert tuned[name]["q"] == pytest.approx(q, rel=0.1)


def test_a_session_goes_on_where_it_was_stopped(card, person, capsys):
    deeds, asked, said = person
    deeds |= {"r0c0k1": "forgets", "r0c1k0": "s", "r0c1k1": "interrupt"}
    assert cli.run(["bench", "four.toml", "-o", "print"]) == 2
    told = capsys.readouterr()
    first, failed, again, left_out = "".join([*said, told.out]).replace("\n  ", " ").splitlines()
    hz = card.pad.true["r0c0k0"][0]
    assert first.startswith("r0c0k0  ") and float(first.split()[1]) == pytest.approx(hz, rel=2e-3)
    assert failed.startswith("r0c0k1: ") and failed.endswith("; once more")
    assert again.startswith("r0c0k1  ")
    assert left_out == "r0c1k0: left out"
    assert "print: stopped with 2 of 4 recorded; the same command goes on" in told.err
    kept = {path: path.read_bytes() for path in Path("print/recorded").glob("*.wav")}
    assert len(kept) == 2 and not Path("print/tuning.json").exists()
    # The sweep of a repetition is twice as long.
    assert 1.5 < len(card.sounded[2]) / len(card.sounded[1]) < 2.5
    asked.clear()
    said.clear()
    assert cli.run(["bench", "four.toml", "-o", "print"]) in (0, 1)
    assert said[0] == "2 of 4 were recorded before, and are kept\n"
    assert [prompt.split("at ")[1].split(":")[0] for prompt in asked] == ["r0c1k0", "r0c1k1"]
    assert all(path.read_bytes() == data for path, data in kept.items())
    compare(card, Path("print"), [*card.pad.true])


def test_only_the_coil_in_turn_sounds_within_full_scale_and_ends_in_silence(card, person):
    deeds, *_ = person
    deeds |= {"r0c0k0": "s", "r0c0k1": "s"}
    assert cli.run(["bench", "four.toml", "-o", "print"]) in (0, 1)
    sounded = np.concatenate(card.sounded[0])
    assert not sounded[:, 0].any() and 0.01 < np.abs(sounded[:, 1]).max() <= 1
    assert not sounded[-RATE_HZ // 4 :].any()
    compare(card, Path("print"), ["r0c1k0", "r0c1k1"])
    # It is padgen retune of the folder.
    assert cli.run(["retune", "four.toml", "print/recorded", "-o", "other"]) in (0, 1)
    for name in ("tuning.json", "drive-tuned.csv", "retune.json"):
        assert Path("print", name).read_bytes() == Path("other", name).read_bytes()


def test_with_one_output_each_coil_is_asked_for(card, person):
    deeds, asked, said = person
    deeds |= {"r0c1k0": "interrupt"}
    card.entries[1]["max_output_channels"] = 1
    assert cli.run(["bench", "four.toml", "-o", "print", "--json"]) == 2
    assert asked[2].startswith("coil r0c1 at output 1, sensor at r0c1k0: Enter records")
    assert not "".join(said)  # but one JSON object
    assert Path("print/recorded/r0c0k1.wav").exists()


@pytest.mark.parametrize(("change", "arguments", "sentence"), [
    ({"inputs": 0}, [], "--record: no input device was found (No input device matching None); there are: none; without"
     " an input, record by other means, one file a taxel, named as r0c0k0.wav in a folder, and give it to padgen"
     " retune"),
    ({"outputs": 0}, [], "--device: no output device was found"),
    ({}, ["--device", "Tuba"], "--device: no output device 'Tuba'"),
    ({}, ["--record", "Loud"], "--record: no input device 'Loud'"),
    ({"outputs": 1}, [], "--device: Loud has 1 output channels for 2 coils; run this in a terminal"),
    ({}, ["--rate", "44100"], "--record: Loud and Mike cannot record at 44100 Hz (Invalid sample rate)"),
    ({}, ["--tries", "0"], "--tries: must be 1 … 20, got 0"),
    ({}, ["--port", "/dev/no-such-port"], "/dev/no-such-port: cannot be opened"),
    ({"gain": 1000.0}, ["--coils"], "% of its samples are at full scale, at most 5% may be; lower the input's gain"),
    ({}, ["--coils"], "has no recording that shows a resonance; nothing is re-tuned"),
])  # fmt: skip
def test_what_a_session_cannot_do(card, plan, monkeypatch, capsys, change, arguments, sentence):
    monkeypatch.setattr(sound_card, "import_module", lambda name: Card(Print(plan, 3), **change))
    assert cli.run(["bench", "four.toml", "-o", "print", "--tries", "1", *arguments]) == 2
    assert sentence in "".join(capsys.readouterr()).replace("\n  ", " ")
    assert not Path("print/tuning.json").exists()
    if "gain" in change:
        # The last step of 16 bits is not 1; in the file it is, so that clipping is seen.
        assert wavfile.read("print/recorded/tried/r0c0.wav")[1][:, 1].max() == 1


def test_recordings_of_another_plan_are_left_alone(card, capsys):
    Path("other.toml").write_text(FOUR.replace("15", "16"))
    assert cli.run(["plan", "other.toml", "-o", "print"]) in (0, 1)
    Path("print/recorded").mkdir()
    Path("print/recorded/r0c0k0.wav").write_bytes(b"mine")
    assert cli.run(["bench", "four.toml", "-o", "print"]) == 2
    assert "print: has recordings of another plan; name another folder with -o" in capsys.readouterr().err


def test_an_interrupt_fades_out_and_lost_samples_are_told_of(card):
    devices = audio_device(None, "input"), audio_device(None)
    tone = np.ones(4 * RATE_HZ)

    def record(**more):
        return record_input(devices[0], RATE_HZ, 4.0, devices[1], tone, 2, **more)

    def interrupt(*_) -> None:
        while len(card.sounded[-1]) < 3:
            pass
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(begin=interrupt)
    sounded = np.concatenate(card.sounded[-1])[:, 0]
    assert len(sounded) < len(tone) and sounded[-1] == 0 and np.abs(np.diff(sounded)).max() < 0.01
    card.status.input_overflow = True
    with pytest.raises(SolverError, match="Mike: samples were lost"):
        record()

    class Beginning:
        """Overflows in the first block, as inputs do that start before they are read."""

        output_underflow = False
        input_overflow = property(lambda self: not card.sounded[-1])

    card.status = Beginning()
    assert len(record()) == len(tone)
    card.breaks_after = 3
    with pytest.raises(FileError, match="Mike: stopped before the recording was over"):
        record()


def test_a_taxel_that_the_sensor_does_not_hear_is_told_of(card, plan, capsys):
    card.pad.at = "r0c0k0"
    assert cli.run(["bench", "four.toml", "--coils", "-o", "print", "--tries", "1"]) in (0, 1)
    told = capsys.readouterr().out
    assert told.startswith("r0c0k0  ") and "r0c0k1: not heard, and keeps the plan's tone" in told
    compare(card, Path("print"), ["r0c0k0"])


# ---- The firmware --------------------------------------------------------------------------------------------------


def test_the_firmware_shakes_a_print(card, plan, tmp_path, person, capsys, monkeypatch):
    person[0]["r0c0"] = "s"
    pad = compiled(plan, make_drive(plan, RATE_HZ), tmp_path)
    ours, theirs = os.openpty()
    volts = tmp_path / "volts"
    command = [pad.program, "line", "--speed", "8", "--volts", volts, "--log", tmp_path / "log"]
    firmware = subprocess.Popen(command, stdin=ours, stdout=ours)
    read = 0

    def source() -> np.ndarray:
        """What the firmware has sent to the coils meanwhile: its samples are the clock."""
        nonlocal read
        while not volts.exists() or volts.stat().st_size < read + 4096:
            threading.Event().wait(0.005)
        with volts.open("rb") as file:
            file.seek(read)
            data = file.read((volts.stat().st_size - read) // 8 * 8)
        read += len(data)
        return np.frombuffer(data, np.float32).reshape(-1, 2).astype(float)

    def excited(*arguments, **settings) -> None:
        """Return once the microphone has heard all that was sent: on a busy machine the model is seconds behind."""
        excite(*arguments, **settings)
        sent = volts.stat().st_size // 8
        while card.pad.samples < sent:
            threading.Event().wait(0.005)

    card.source = source
    monkeypatch.setattr(padgen.driver.bench, "excite", excited)
    try:
        arguments = ["--port", os.ttyname(theirs), "--coils", "-o", "print", "--tries", "1"]
        assert cli.run(["bench", "four.toml", *arguments]) in (0, 1)
    finally:
        firmware.terminate()
        assert firmware.wait(20) == 0, "the device was not silent in time"
        os.close(ours)
        os.close(theirs)
    assert [path.name for path in Path("print/recorded").glob("*.wav")] == ["r0c1.wav"]
    assert capsys.readouterr().out.startswith("r0c1k0  ")
    compare(card, Path("print"), ["r0c1k0", "r0c1k1"])


def test_the_sweep_of_the_firmware(tmp_path_factory):
    pad = host("quick", tmp_path_factory)
    table = sweep_table(pad.plan)
    rate = pad.drive.rate_hz
    count = pad.number("PADGEN_SWEEP_SAMPLES")
    sweep = feed(Message(Kind.EXCITE, 1, b"\5\0"))
    frame = feed(Message(Kind.FRAME_BITS, 0, b"\1\0"))
    run = pad.run(sweep + pad.hello + feed(Message(Kind.EXCITE, 2, b"\x10\0")) + sweep + sweep + frame
                  + pad.wait(count) + feed(Message(Kind.PING, 3)))  # fmt: skip
    reasons = [refusal(a).reason for a in run.answers if a.kind == Kind.NAK]
    assert reasons == [Reason.STRANGER, Reason.LENGTH, Reason.BUSY, Reason.BUSY]
    assert run.answers[-1].payload[:2] == bytes([Kind.PING, State.SILENT])
    expected = table.voltage_v(rate)
    # The device's rows and increments are single floats: some 600 turns, each off by at most 6e-8.
    assert run.volts[:count, 5] == pytest.approx(expected[:count], abs=1e-3 * np.abs(expected).max())
    assert np.abs(run.volts).max() <= pad.plan.spec.drive.voltage_limit_v
    assert not np.delete(run.volts, 5, axis=1).any() and not run.volts[count:].any()
    for ends in (feed(Message(Kind.SILENCE, 4)), f"run {pad.number('PADGEN_WATCHDOG_SAMPLES')}\n"):
        script = pad.hello + sweep + f"run {rate // 2}\n" + ends
        stopped = pad.run(script + f"run {rate // 50 + 1}\n" + feed(Message(Kind.PING, 5)) + f"run {rate}\n")
        assert stopped.answers[-1].payload[:2] == bytes([Kind.PING, State.SILENT])
        assert not stopped.volts[-rate + 1 :].any() and stopped.volts[: rate // 2].any()
