"""The firmware in C against padgen's own waveforms and encoder.

| what | must equal | to | because |
|---|---|---|---|
| volts of on/off states, through ramps | `driver.waveform` | 2e-5 of the peak | float32, near a root's cusp |
| lines of i², any levels | levels times `PadDrive` lines | 1e-5 of the largest | float32 |
| spurs of i², spur-free | none | −100 dB of the largest (asked: −60) | float32 |
| the constant, on/off | `crest.least_constant` and the margin | 1e-5 of the lines | rounded up, float32 |
"""

import re
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from math import ceil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from padgen.driver.formats.c import SCHEME_NUMBERS, c_header, firmware_files, with_tables_crc
from padgen.driver.serial_line import (
    HOLD_WATCHDOGS,
    VERSION,
    Kind,
    Message,
    Reason,
    State,
    decode,
    encode,
    frame_message,
    greeting,
    plan_hash,
    refusal,
)
from padgen.driver.waveform import Timeline, constant_a2, frame_s, make_drive, ramp_s, volts
from tests.firmware_host import (
    SANITIZED,
    STRICT,
    Host,
    Run,
    compiled,
    compiler,
    drum,
    feed,
    host,
    limited,
    metered,
    noise,
    sessions,
)

SILENCE = Message(Kind.SILENCE, 0)
SMALL = "spur-free"


@pytest.fixture
def pad(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Host:
    return host(getattr(request, "param", SMALL), tmp_path_factory)


def pads(*names: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("pad", names, indirect=True)


def frames(pad: Host, count: int, seed: int = 0) -> np.ndarray:
    """Return frames of levels: all on, then random on/off states."""
    states = np.random.default_rng(seed).integers(0, 2, (count, len(pad.plan.taxels))).astype(float)
    states[0] = 1.0
    return states


def played(pad: Host, levels: np.ndarray, each: int) -> Run:
    """Play frames (k, taxels), one every `each` samples, then silence."""
    script = pad.hello + "".join(feed(frame_message(f, k)) + pad.wait(each) for k, f in enumerate(levels))
    return pad.run(script + feed(SILENCE) + f"run {each}\n")


# ---- What it plays -------------------------------------------------------------------------------------------------


@pytest.mark.sample(3)
@pads("one", "tones", "biased", "time-shared", "carrier", "magnet")
def test_files_compile_without_a_warning_as_c_and_header_as_cpp(pad: Host):
    (pad.folder / "header.cc").write_text('#include "padgen_protocol.h"\nint main() { return PADGEN_COILS == 0; }\n')
    command = [compiler("CXX", "c++", "g++"), "-std=c++11", *STRICT, "-fsyntax-only", "header.cc"]
    done = subprocess.run(command, cwd=pad.folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    own = [line for line in (pad.folder / "pad_drive.h").read_text().splitlines() if line.startswith("#include")]
    assert own == ["#include <stdint.h>"]
    for taxel in pad.plan.taxels:
        assert taxel.id in (pad.folder / "pad_drive.h").read_text()


@pytest.mark.sample(5)
@pads("one", "tones", "spur-free", "no inductance", "carrier", "biased", "magnet")
@pytest.mark.parametrize("with_signs", [False, True])
def test_volts_are_those_of_the_waveform(pad: Host, with_signs: bool):
    rate = pad.drive.rate_hz
    ramp = ceil(ramp_s(pad.plan) * rate)
    hold = rate // 10
    levels = frames(pad, 3)
    signs = np.random.default_rng(5).choice([-1.0, 1.0], levels.shape) if with_signs else np.ones(levels.shape)
    run = played(pad, levels * signs, ramp + hold)
    silent = np.zeros((1, levels.shape[1]))
    times = [0, ramp]
    for k in range(1, 4):
        times += [k * (ramp + hold), k * (ramp + hold) + ramp]
    states = np.concatenate([silent, np.repeat(levels, 2, 0), silent])
    signed = np.concatenate([silent + 1, np.repeat(signs, 2, 0), silent + 1])
    wanted = np.concatenate(list(volts(pad.drive, Timeline(np.array(times) / rate, states, False, signs=signed))))
    got = run.volts[: len(wanted)]
    assert np.abs(wanted).max() > 1.0
    # One tone is as exact as the sine; roots and coils of several lose some digits.
    exact = 2e-6 if len(pad.plan.channels) == 1 else 2e-5
    assert np.abs(got - wanted).max() <= exact * np.abs(wanted).max()
    assert not run.volts[len(wanted) :].any()
    assert run.is_silent


@pads("time-shared")
def test_channels_take_their_turns(pad: Host):
    half = pad.number("PADGEN_RAMP_SAMPLES")
    slots = pad.number("PADGEN_SLOTS")
    turns = {channel.index: k for own in pad.plan.sets for k, channel in enumerate(own)}
    turn = np.array([turns[taxel.channel] for taxel in pad.plan.taxels])
    levels = np.stack([np.ones(len(turn)), np.linspace(0, 1, len(turn)).round(1) // 0.2 * 0.2])
    run = played(pad, levels, 2 * half * slots)
    keys = np.zeros((4 * slots + 1, len(turn)))
    for k, frame in enumerate(levels):
        quantised = np.rint(frame * 255) / 255
        for s in range(slots):
            keys[2 * (k * slots + s) + 1] = np.where(turn == s, quantised, 0.0)
    times = np.arange(len(keys)) * half / pad.drive.rate_hz
    wanted = np.concatenate(list(volts(pad.drive, Timeline(times, keys, False))))
    assert np.abs(run.volts[: len(wanted)] - wanted).max() <= 2e-5 * np.abs(wanted).max()
    assert np.abs(wanted).max() > 0.1
    assert not run.volts[len(wanted) :].any()
    assert half * 2 >= 2 * max(c.ring_down_ms for c in pad.plan.channels) * 1e-3 * pad.drive.rate_hz


def squared(pad: Host, run: Run) -> np.ndarray:
    """Return the lines (harmonics, coils) of i² in A² of the last period: 0 Hz, then amplitudes with phases."""
    drive = pad.drive
    n = pad.drive.period_samples
    voltage = np.fft.rfft(run.volts[-n:], axis=0)
    omega = 2 * np.pi * np.arange(len(voltage)) / drive.period_s
    current = voltage / (drive.resistance_ohm + 1j * omega * drive.inductance_h)[:, None]
    # Squaring doubles the band: sampled twice as fast it does not fold.
    wide = np.zeros((n + 1, current.shape[1]), complex)
    wide[: len(current)] = current
    i = np.fft.irfft(wide, 2 * n, axis=0) * 2
    lines = np.fft.rfft(i**2, axis=0) / n
    lines[0] /= 2
    return lines[: n // 2]


@pytest.mark.sample(7)
@pads("one", "tones", "spur-free", "no inductance", "eleven", "biased", "carrier")
@pytest.mark.parametrize(("grey", "with_signs"), [(False, False), (True, False), (True, True)])
def test_lines_are_those_asked_for_at_any_level(pad: Host, grey: bool, with_signs: bool):
    rng = np.random.default_rng(3)
    shape = len(pad.plan.taxels)
    levels = rng.integers(0, 256, shape) / 255 if grey else rng.integers(0, 2, shape).astype(float)
    levels *= rng.choice([-1.0, 1.0], shape) if with_signs else 1.0
    # Two whole periods, so that phases began anew in between.
    settle = pad.number("PADGEN_RAMP_SAMPLES") // pad.drive.period_samples + 1
    script = pad.hello + feed(frame_message(levels, 0)) + pad.wait((settle + 2) * pad.drive.period_samples)
    lines = squared(pad, pad.run(script))
    for index, coil in enumerate(pad.drive.coils):
        got = lines[:, index]
        wanted = levels[coil.taxels] * coil.line_a2 * np.exp(1j * coil.phase_rad)
        scale = coil.line_a2.max()
        spurs = got[1:].copy()
        spurs[coil.harmonic - 1] = 0.0
        if pad.drive.scheme.name == "spur-free":
            own = coil.harmonic
            band = slice(0, len(spurs) if pad.drive.carrier_hz is None else pad.drive.period_samples // 6)
            assert np.abs(got[own] - wanted).max() <= 1e-5 * scale
            assert np.abs(spurs[band]).max() <= 1e-5 * scale
            (exact,) = constant_a2(coil, levels[coil.taxels])
            safe = ((1 + coil.margin) * coil.line_a2 * np.abs(levels[coil.taxels])).sum()
            assert exact - 1e-5 * scale <= got[0].real <= safe + 1e-5 * scale
            if not grey and len(coil.taxels) <= 8:
                assert got[0].real == pytest.approx(exact, abs=1e-5 * scale)
        else:
            # A sum or difference of two tones may fall on a line.
            clean = [k for k in range(len(wanted)) if not _is_spur(coil.harmonic, k, pad.drive.scheme.name)]
            assert np.abs(got[coil.harmonic] - wanted)[clean].max() <= 1e-5 * scale
    assert np.abs(lines[1:]).max() > 1e-6


def _is_spur(harmonic: np.ndarray, k: int, scheme: str) -> bool:
    a, b = np.triu_indices(len(harmonic), 1)
    share = 2 if scheme == "tones" else 1
    made = {*((harmonic[a] + harmonic[b]) / share), *(np.abs(harmonic[a] - harmonic[b]) / share)}
    return harmonic[k] in made | (set() if scheme == "tones" else set(2 * harmonic))


def test_all_on_is_as_cool_as_the_phases_allow(tmp_path_factory: pytest.TempPathFactory):
    pad = host("eleven", tmp_path_factory)
    each = pad.number("PADGEN_RAMP_SAMPLES") + pad.drive.period_samples
    run = pad.run(pad.hello + feed(frame_message(np.ones(44), 0)) + pad.wait(each))
    coil = pad.drive.coils[0]
    (exact,) = constant_a2(coil, np.ones(11))
    assert squared(pad, run)[0, 0].real == pytest.approx(exact, rel=1e-4)
    # The strongest line is half of all: no phases take more than a hundredth off the constant.
    assert exact < 0.995 * ((1 + coil.margin) * coil.line_a2).sum()


@pads("one")
def test_phases_are_as_exact_after_ten_minutes(pad: Host):
    samples = 600 * pad.drive.rate_hz // pad.drive.period_samples * pad.drive.period_samples
    shown = pad.hello + feed(frame_message(np.ones(16), 0)) + "run 2000\n"
    first = pad.run(shown)
    later = pad.run(f"run {samples}\n" + shown, "--skip", str(samples))
    assert later.log[0].startswith(f"begin {samples} ")
    assert np.array_equal(later.volts, first.volts)
    assert np.abs(first.volts).max() > 0.1


def test_codes_of_a_converter(pad: Host):
    (pad.folder / "codes.c").write_text(
        '#include <math.h>\n#include <stdio.h>\n#include "padgen_drive.h"\nint main(void) {\n'
        'printf("%d %d %d %d %d %d", (int)padgen_code(-15.0f, 30.0f, 12),\n'
        "(int)padgen_code(0.0f, 30.0f, 16), (int)padgen_code(30.0f, 30.0f, 16),\n"
        "(int)padgen_code(-31.0f, 30.0f, 16), (int)padgen_code(15.0f, 30.0f, 12), (int)padgen_code(1e9f, 1.0f, 24));\n"
        'printf(" %d %d %d %d %d %d", (int)padgen_code(30.0f, 30.0f, 26), (int)padgen_code(31.0f, 30.0f, 32),\n'
        "(int)padgen_code(-31.0f, 30.0f, 32), (int)padgen_code(NAN, 30.0f, 16), (int)padgen_code(1.0f, 0.0f, 16),\n"
        "(int)padgen_code(0.0f, 0.0f, 16));\n"
        "return 0; }\n"
    )
    command = [compiler("CC", "cc", "gcc"), "-std=c99", *STRICT, "codes.c", "-o", "codes"]
    subprocess.run(command, cwd=pad.folder, check=True)
    (pad.folder / "codes.c").unlink()
    said = subprocess.run([pad.folder / "codes"], capture_output=True, text=True).stdout
    assert said == "-1024 0 32767 -32767 1024 8388607 33554431 2147483647 -2147483647 0 32767 0"


# ---- What it never does --------------------------------------------------------------------------------------------


LIMIT_V = 2.0


def spoiled(header: str, table: str, entry: str) -> str:
    """Return a header with all numbers of a table replaced, the checksum with them."""
    declared, entries = header.split(f"static const float {table}")
    own, rest = entries.split(";", 1)
    numbers = re.sub(r"-?\d+\.?\d*(e[-+]?\d+)?f", entry, own)
    assert numbers != own
    return with_tables_crc(f"#include <math.h>\n{declared}static const float {table}{numbers};{rest}")


@pytest.mark.sample(2)
@pytest.mark.parametrize(("scheme", "table", "entry"), [
    ("tones", "padgen_line_a2", "1e9f"),
    ("tones", "padgen_line_a2", "-1e3f"),
    ("tones", "padgen_tone_hz", "NAN"),
    ("spur-free", "padgen_line_a2", "3e38f"),
    ("spur-free", "padgen_line_a2", "NAN"),
    ("spur-free", "padgen_margin_a2", "-1.0f"),
    ("spur-free", "padgen_least_a2", "INFINITY"),
    ("spur-free", "padgen_tone_hz", "1e12f"),
    ("biased", "padgen_bias_a", "0.0f"),
    ("biased", "padgen_bias_a", "1e20f"),
    ("biased", "padgen_line_a2", "INFINITY"),
])  # fmt: skip
def test_whatever_the_tables_hold_no_volt_is_beyond_the_limit(tmp_path: Path, scheme: str, table: str, entry: str):
    plan = drum(scheme, 14, scheme)
    drive = replace(make_drive(plan, 16_000), voltage_limit_v=LIMIT_V)
    pad = compiled(plan, drive, tmp_path, lambda header: spoiled(header, table, entry))
    grey = frame_message(np.random.default_rng(2).integers(0, 256, 14) / 255, 1)
    each = f"run {pad.number('PADGEN_STEP_SAMPLES') + 2000}\n"
    run = pad.run(pad.hello + feed(frame_message(np.ones(14), 0)) + each + feed(grey) + each)
    assert np.isfinite(run.volts).all()
    assert np.abs(run.volts).max() <= LIMIT_V


@pytest.mark.sample(2)
@pads("tones", "spur-free", "biased", "carrier")
def test_volts_are_cut_at_the_limit_and_nowhere_else(pad: Host, tmp_path: Path):
    cut = compiled(pad.plan, replace(pad.drive, voltage_limit_v=LIMIT_V), tmp_path)
    levels = frames(pad, 3)
    each = pad.number("PADGEN_RAMP_SAMPLES") + 500
    whole = played(pad, levels, each).volts
    assert np.abs(whole).max() > 1.2 * LIMIT_V
    assert np.array_equal(played(cut, levels, each).volts, np.clip(whole, -LIMIT_V, LIMIT_V))


@pytest.mark.parametrize(("changed", "said"), [
    ("HEADER 1", "are of different versions"),
    ("VOLTAGE_LIMIT_UV 30000001", "PADGEN_VOLTAGE_LIMIT_UV must be"),
    ("CURRENT_LIMIT_UA 900000000", "PADGEN_CURRENT_LIMIT_UA must be"),
    ("PAD_LIMIT_UW 16000000", "PADGEN_PAD_LIMIT_UW must be"),
    ("START_SAMPLES 10u", "PADGEN_START_SAMPLES must be"),
    ("STEP_SAMPLES 1u", "PADGEN_STEP_SAMPLES must be"),
    ("FRAME_SAMPLES 1u", "PADGEN_FRAME_SAMPLES must hold"),
    ("WATCHDOG_SAMPLES 12000u", "PADGEN_WATCHDOG_SAMPLES must be"),
    ("HOLD_SAMPLES 4294967295u", "PADGEN_HOLD_SAMPLES must be"),
])  # fmt: skip
def test_a_header_beyond_the_limits_does_not_compile(tmp_path: Path, changed: str, said: str):
    name = changed.split()[0]
    plan, drive = limited("quick", 0.5)
    text = re.sub(rf"#define PADGEN_{name} \S+", f"#define PADGEN_{changed}", c_header(plan, drive))
    files = {**firmware_files(), "pad_drive.h": text.encode()}
    for kept in ("pad_drive.h", "padgen_drive.h"):
        (tmp_path / kept).write_bytes(files[kept])
    command = [compiler("CC", "cc", "gcc"), "-std=c99", "-fsyntax-only", "padgen_drive.h"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    errors = [line for line in done.stderr.splitlines() if "#error" in line and "error:" in line]
    assert done.returncode and len(errors) == 1 and said in errors[0]


OVERDRIVEN = {
    "one": lambda: limited("one", 2.4e-3),
    "spur-free": lambda: limited("spur-free", 0.5),
    "biased": lambda: limited("biased", 0.5, 1.2, 0.35),
}
"""Pads that ask for 3 to 5 times the heat that coils bear; the second for more volts too, the third for more amperes
and more heat of all coils."""


def shown_for_long(pad: Host, seconds: float) -> str:
    """Return a script that keeps all taxels on by new frames."""
    hold = pad.number("PADGEN_HOLD_SAMPLES")
    taxels = len(pad.plan.taxels)
    times = ceil(seconds * pad.drive.rate_hz / hold)
    return pad.hello + "".join(feed(frame_message(np.ones(taxels), k)) + pad.wait(hold) for k in range(times))


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", OVERDRIVEN)
def test_what_is_asked_for_long_is_held_at_what_is_borne(tmp_path: Path, name: str):
    """By the filters of `Meter`, which are off by 2e-4 at most: a current between samples bends by (R dt/L)²/192."""
    pad = compiled(*OVERDRIVEN[name](), tmp_path)
    spec = pad.plan.spec
    meter = metered(pad, shown_for_long(pad, 12.0))
    answers, _ = decode(bytes.fromhex("".join(re.findall("send (.*)", (tmp_path / "answers").read_text()))))
    _, _, faults, warmest, given = answers[-1].payload  # type: ignore[union-attr]
    assert meter.volts <= spec.drive.voltage_limit_v
    # The limit is reached and not passed: what the pad can do, it does.
    assert 0.98 < max(meter.heat[0], meter.total) < 1.0 + 2e-4
    assert max(meter.heat[1:]) < meter.heat[0]
    assert meter.total < 1.0 + 2e-4
    if spec.amplifier is not None:
        assert 0.999 < meter.amperes / spec.amplifier.current_a < 1.001
    # The answers say so: a third to two thirds of the voltage, the warmest coil within the last sixty-fourth.
    assert (faults, given) == (0, pytest.approx(130, abs=55))
    assert warmest >= 248 or spec.limits.power_w


@pytest.mark.sample(1)
@pytest.mark.parametrize(("coil_w", "power_w"), [(0.05, None), (0.001, None), (1.0, 0.004)])
def test_a_pad_that_bears_next_to_nothing_is_stopped_in_time(tmp_path: Path, coil_w: float, power_w: float | None):
    """A few samples at the voltage's limit would be too much, and so would be what the field still holds by then."""
    pad = compiled(*limited("biased", coil_w, power_w), tmp_path, lambda h: spoiled(h, "padgen_line_a2", "1e9f"))
    meter = metered(pad, shown_for_long(pad, 0.5))
    assert 0.5 < max(meter.heat[0], meter.total) < 1.0 + 2e-4


def test_heat_within_the_limit_takes_nothing_back(tmp_path: Path):
    folders = [tmp_path / "near", tmp_path / "far"]
    for folder in folders:
        folder.mkdir()
    # Copper loss of 0.98 of the limit, and of 0.024.
    pad, cool = (compiled(*limited("one", watt), folder) for watt, folder in zip((0.0123, 0.5), folders, strict=True))
    script = shown_for_long(pad, 1.0)
    runs = [own.run(script.replace(pad.hello, own.hello), "--boot", "1") for own in (pad, cool)]
    assert np.abs(runs[0].volts).max() > 1.0
    assert np.array_equal(runs[0].volts, runs[1].volts)


def test_a_board_that_starts_anew_is_silent_and_its_coils_as_warm_as_they_may_be(tmp_path: Path):
    pad = compiled(*OVERDRIVEN["spur-free"](), tmp_path)
    taxels = len(pad.plan.taxels)
    rest = pad.number("PADGEN_START_SAMPLES")
    ramp = pad.number("PADGEN_RAMP_SAMPLES")
    assert rest / pad.drive.rate_hz < 0.2
    frame = pad.hello + feed(frame_message(np.ones(taxels), 0))
    run = pad.run((frame + f"run {rest + ramp}\nreset\n") * 2, "--boot", "1")
    for start in (0, rest + ramp):
        own = run.volts[start : start + rest + ramp]
        assert not own[:rest].any() and own[rest:].any()
    kinds = [a.kind for a in run.answers if a]
    assert kinds == [Kind.GREETING, Kind.ACK] * 2
    # Whoever resets it as often as they can does not get it warmer either.
    again = "".join(frame + f"run {rest + 6 * ramp}\nreset\n" for _ in range(20))
    assert 0.95 < metered(pad, shown_for_long(pad, 4.0) + again).heat[0] < 1.0 + 2e-4


def test_a_main_program_that_hangs_leaves_it_silent(pad: Host):
    dog = pad.number("PADGEN_WATCHDOG_SAMPLES")
    ramp = pad.number("PADGEN_RAMP_SAMPLES")
    shown = pad.hello + feed(frame_message(np.ones(16), 0)) + f"run {ramp}\n"
    run = pad.run(shown + f"away {dog + ramp + 200}\nrun {2 * ramp}\n")
    assert run.volts[ramp + dog - 200 : ramp + dog].any()
    hung = run.volts[ramp + dog + ramp + 2 : ramp + dog + ramp + 200]
    assert not hung.any()
    # It goes in a ramp and comes back in one.
    steps = np.abs(np.diff(run.volts, axis=0))
    assert steps[ramp + dog :].max() <= 1.05 * steps[ramp : ramp + dog].max()
    assert run.volts[-200:].any()


@pytest.mark.parametrize(("spoil", "faults"), [
    (lambda text: re.sub(r"(line_a2.*\n\{)", r"\g<1>9", text), 1),
    (lambda text: text + "\n#undef PADGEN_VOLTAGE_LIMIT_V\n#define PADGEN_VOLTAGE_LIMIT_V (-30.0f)\n", 2),
    (lambda text: text + "\n#include <math.h>\n#define sqrtf(x) (1.5f * (x))\n", 4),
])  # fmt: skip
def test_a_self_test_that_fails_keeps_it_silent_and_is_told(tmp_path: Path, spoil: Callable[[str], str], faults: int):
    pad = compiled(*limited("quick", 0.5), tmp_path, spoil)
    frame = feed(frame_message(np.ones(16), 0))
    run = pad.run(pad.hello + frame + "run 4000\n" + feed(Message(Kind.PING, 5)))
    met, refused, pinged = run.answers
    assert greeting(met).faults == faults and pinged.payload[2] == faults  # type: ignore[arg-type, union-attr]
    assert refusal(refused).reason == Reason.FAULT  # type: ignore[arg-type]
    assert not run.volts.any() and not run.begun


@pytest.mark.parametrize("name", [
    "biased", *[pytest.param(name, marks=pytest.mark.soak) for name in OVERDRIVEN]
])  # fmt: skip
def test_no_bytes_on_the_line_harm_it(
    tmp_path: Path, name: str, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
):
    """Noise and damaged sessions on a board compiled with sanitizers, its voltages by `Meter`."""
    soaked = request.node.get_closest_marker("soak") is not None
    count, bytes_count = (10_000, 10_000_000) if soaked else (20, 10_000)
    pad = compiled(*OVERDRIVEN[name](), tmp_path, options=SANITIZED)
    rng = np.random.default_rng(19)
    spec = pad.plan.spec
    rate = pad.drive.rate_hz
    rest = pad.number("PADGEN_WATCHDOG_SAMPLES") + 2 * pad.number("PADGEN_STEP_SAMPLES")
    began = time.monotonic()
    told = []
    scripts = {"sessions": sessions(pad, rng, count), "random bytes": noise(pad, rng, bytes_count, 1)}
    for kind, script in scripts.items():
        meter = metered(pad, shown_for_long(pad, 1.0) + "".join(script) + f"run {rest}\n")
        assert meter.volts <= spec.drive.voltage_limit_v
        assert max(*meter.heat, meter.total) < 1.0 + 2e-4
        assert meter.amperes < 1.001 * (spec.amplifier.current_a if spec.amplifier else np.inf)
        assert not meter.last.any()
        log = (tmp_path / "log").read_text()
        assert log.splitlines()[-2].startswith("silent")
        told.append(
            f"{kind}: {meter.samples / rate:.0f} s, {log.count('frame')} frames, {meter.volts:.2f} V,"
            f" {meter.amperes:.3f} A, heat {meter.heat[0]:.4f}, of all coils {meter.total:.4f}"
        )
    if soaked:
        with capsys.disabled():
            print(
                f"\n{name}: {count} sessions, {bytes_count} bytes, {time.monotonic() - began:.0f} s", *told, sep="\n  "
            )


@pads("biased", "spur-free", "time-shared")
def test_pings_do_not_hold_a_frame_for_ever(pad: Host):
    dog = pad.number("PADGEN_WATCHDOG_SAMPLES")
    hold = pad.number("PADGEN_HOLD_SAMPLES")
    step = pad.number("PADGEN_STEP_SAMPLES")
    taxels = len(pad.plan.taxels)
    assert hold == HOLD_WATCHDOGS * dog
    pings = (f"run {dog // 2}\n" + feed(Message(Kind.PING, 5))) * (2 * HOLD_WATCHDOGS + 4)
    hellos = (f"run {dog // 2}\n" + pad.hello) * (2 * HOLD_WATCHDOGS + 4)
    repeated = (f"run {dog // 2}\n" + feed(frame_message(np.ones(taxels), 0))) * (2 * HOLD_WATCHDOGS + 4)
    for kept in (pings, hellos, repeated):
        run = pad.run(pad.hello + feed(frame_message(np.ones(taxels), 0)) + kept)
        assert run.begun == [[255] * taxels, None]
        silence = int(run.log[1].split()[1])
        assert hold - 1 <= silence <= hold + step
        assert not run.volts[-1].any()
    # Pings are answered all the time, and a new frame is shown.
    again = pad.run(
        pad.hello
        + feed(frame_message(np.ones(taxels), 0))
        + pings
        + feed(frame_message(np.ones(taxels), 1))
        + "run 2000\n"
    )
    assert [a.kind for a in again.answers[2:] if a] == [Kind.ACK] * (2 * HOLD_WATCHDOGS + 5)
    assert again.volts[-1].any()


@pads("quick")
def test_new_frames_hold_it_as_long_as_they_come(pad: Host):
    hold = pad.number("PADGEN_HOLD_SAMPLES")
    kept = "".join(feed(frame_message(np.ones(16), k)) + pad.wait(hold // 2) for k in range(4))
    run = pad.run(pad.hello + kept, "--skip", str(2 * hold - 2000))
    assert None not in run.begun and len(run.begun) == 4
    assert run.volts[-800:].any()


def test_time_that_passes_at_once_is_time_that_passed(pad: Host):
    """A main program that was away for a whole turn of the counter still falls silent."""
    (pad.folder / "away.c").write_text(
        '#include <stdio.h>\n#include "padgen_protocol.h"\n'
        "static void send(void *c, const uint8_t *b, size_t n) { (void)c; (void)b; (void)n; }\n"
        "int main(void) {\n    static padgen_drive d;\n    static padgen_link l;\n"
        "    static const uint8_t on[PADGEN_TAXELS] = {255};\n    float volts[PADGEN_COILS];\n"
        "    padgen_start(&d);\n    padgen_link_start(&l, &d, send, 0);\n    padgen_show(&d, on);\n"
        "    padgen_next(&d, volts);\n    padgen_link_tick(&l, 1);\n    padgen_link_tick(&l, UINT32_MAX);\n"
        '    printf("%d", d.waiting);\n    return 0;\n}\n'
    )
    sources = ["away.c", "padgen_drive.c", "padgen_protocol.c"]
    command = [compiler("CC", "cc", "gcc"), "-std=c99", *STRICT, *sources, "-lm", "-o", "away"]
    subprocess.run(command, cwd=pad.folder, check=True)
    (pad.folder / "away.c").unlink()
    assert subprocess.run([pad.folder / "away"], capture_output=True, text=True).stdout == "2"


# ---- What it understands -------------------------------------------------------------------------------------------


@pads("spur-free", "time-shared", "tones")
def test_greeting_tells_what_the_header_has(pad: Host):
    answer = pad.run(pad.hello).answers[0]
    assert answer is not None and answer.kind == Kind.GREETING
    told = greeting(answer)
    plan = pad.plan
    rate = pad.drive.rate_hz
    step = pad.number("PADGEN_STEP_SAMPLES") / rate
    least = step * (pad.number("PADGEN_SLOTS") if plan.selectivity.drive == "time-shared" else 1)
    assert told.plan_hash == plan_hash(plan)
    assert (told.taxels, told.coils, told.rate_hz) == (len(plan.taxels), 4, rate)
    assert told.channels == max(len(coil.taxels) for coil in pad.drive.coils)
    assert told.next_sequence == 0
    assert told.least_frame_us == pytest.approx(least * 1e6, abs=1)
    assert told.frame_us == pytest.approx(max(frame_s(plan), least) * 1e6, abs=1e6 / rate)
    assert told.watchdog_ms == pytest.approx(max(1.0, 2 * told.frame_us * 1e-6) * 1e3, abs=1)


def damaged(message: Message, place: int) -> bytes:
    packet = bytearray(encode(message))
    packet[place] ^= 0x10
    return bytes(packet)


def wrong(pad: Host) -> dict[str, tuple[list[Message | bytes], Reason]]:
    frame = frame_message(np.ones(len(pad.plan.taxels)), 0)
    return {
        "a flipped bit": ([damaged(frame, 6)], Reason.DAMAGED),
        "a wrong checksum": ([damaged(frame, -2)], Reason.DAMAGED),
        "a lost byte": ([encode(frame)[:5] + encode(frame)[6:]], Reason.DAMAGED),
        "a byte too many": ([encode(frame)[:5] + b"\x07" + encode(frame)[5:]], Reason.DAMAGED),
        "a cut": ([encode(frame)[:-4] + b"\0"], Reason.DAMAGED),
        "noise": ([bytes(range(1, 200)) + b"\0"], Reason.DAMAGED),
        "endless": ([b"\x02a" * 5000 + b"\0"], Reason.DAMAGED),
        "another version": ([Message(frame.kind, 0, frame.payload, VERSION + 1)], Reason.VERSION),
        "an unknown kind": ([Message(77, 0)], Reason.KIND),
        "a short frame": ([Message(Kind.FRAME, 0, b"\xff")], Reason.LENGTH),
        "a long frame": ([Message(Kind.FRAME_BITS, 0, frame.payload + b"\xff")], Reason.LENGTH),
        "out of order": ([Message(frame.kind, 1, frame.payload)], Reason.ORDER),
        "long ago": ([Message(frame.kind, 65535, frame.payload)], Reason.DUPLICATE),
        "another pad": ([Message(Kind.HELLO, 0, b"12345678"), frame], Reason.STRANGER),
        "half a name": ([Message(Kind.HELLO, 0, b"1234")], Reason.LENGTH),
    }


@pytest.mark.parametrize("case", [
    "a flipped bit", "a wrong checksum", "a lost byte", "a byte too many", "a cut", "noise", "endless",
    "another version", "an unknown kind", "a short frame", "a long frame", "out of order",
    "long ago", "another pad", "half a name",
])  # fmt: skip
def test_what_is_wrong_is_refused_and_changes_nothing(pad: Host, case: str):
    messages, reason = wrong(pad)[case]
    run = pad.run(pad.hello + feed(*messages) + "run 4000\n")
    last = run.answers[-1]
    assert last is not None and last.kind == Kind.NAK
    assert (refusal(last).reason, refusal(last).next_sequence) == (reason, 0)
    assert not run.begun and not run.volts.any()
    # The next one is understood.
    good = frame_message(np.ones(len(pad.plan.taxels)), 0)
    again = pad.run(pad.hello + feed(*messages) + pad.hello + feed(good) + "run 4000\n")
    assert again.begun == [[255] * len(pad.plan.taxels)]


def test_a_frame_before_hello_is_a_strangers(pad: Host):
    run = pad.run(feed(frame_message(np.ones(16), 0)) + "run 100\n")
    assert [refusal(a).reason for a in run.answers if a] == [Reason.STRANGER]
    assert not run.begun


def test_a_cut_packet_costs_itself_alone(pad: Host):
    first = frame_message(np.eye(16)[0], 0)
    second = frame_message(np.eye(16)[1], 0)
    run = pad.run(pad.hello + feed(encode(first)[:7], second) + "run 4000\n")
    assert [a.kind for a in run.answers if a] == [Kind.GREETING, Kind.NAK, Kind.ACK]
    assert run.begun == [(np.eye(16)[1] * 255).astype(int).tolist()]


def test_a_frame_is_shown_once_however_often_it_comes(pad: Host):
    first = frame_message(np.eye(16)[0], 0)
    second = frame_message(np.eye(16)[1], 1)
    each = pad.number("PADGEN_RAMP_SAMPLES")
    run = pad.run(pad.hello + (feed(first) + f"run {each}\n") * 3 + (feed(second, second) + f"run {each}\n") * 2)
    kinds = [a.kind for a in run.answers if a]
    assert kinds == [Kind.GREETING, Kind.ACK, Kind.NAK, Kind.NAK, Kind.ACK, Kind.NAK, Kind.NAK, Kind.NAK]
    assert {refusal(a).reason for a in run.answers if a and a.kind == Kind.NAK} == {Reason.DUPLICATE}
    assert run.begun == [(np.eye(16)[k] * 255).astype(int).tolist() for k in (0, 1)]


def test_a_frame_that_comes_too_early_waits_and_the_next_is_told_to(pad: Host):
    ramp = pad.number("PADGEN_RAMP_SAMPLES")
    shown = [frame_message(np.eye(16)[k], k) for k in range(3)]
    run = pad.run(pad.hello + feed(shown[0]) + "run 10\n" + feed(shown[1], shown[2]) + f"run {ramp}\n" + feed(shown[2]))
    assert [a.kind for a in run.answers if a] == [Kind.GREETING, Kind.ACK, Kind.ACK, Kind.NAK, Kind.ACK]
    assert refusal(run.answers[3]).reason == Reason.BUSY  # type: ignore[arg-type]
    assert [line.split()[1] for line in run.log if line.startswith("begin")] == ["0", str(ramp)]


def test_sequence_numbers_begin_again_after_the_last(pad: Host):
    each = pad.number("PADGEN_RAMP_SAMPLES")
    shown = "".join(feed(frame_message(np.eye(16)[k], 65534 + k)) + f"run {each}\n" for k in range(4))
    run = pad.run(pad.hello + shown, "--next", "65534")
    assert len(run.begun) == 4
    assert greeting(run.answers[0]).next_sequence == 65534  # type: ignore[arg-type]
    assert [a.sequence for a in run.answers[1:] if a] == [65534, 65535, 0, 1]


def test_no_message_and_it_falls_silent(pad: Host):
    dog = pad.number("PADGEN_WATCHDOG_SAMPLES")
    ramp = pad.number("PADGEN_RAMP_SAMPLES")
    shown = feed(frame_message(np.ones(16), 0))
    run = pad.run(pad.hello + shown + f"run {dog + ramp + 2}\n")
    assert run.log[:-1] == [f"begin 0 frame {'ff' * 16} 0000", f"begin {dog - 1} silence", f"silent {dog - 1 + ramp}"]
    assert run.volts[dog - 2].any() and not run.volts[-1].any()
    kept = pad.run(pad.hello + shown + (f"run {dog - 1}\n" + feed(Message(Kind.PING, 5))) * 3)
    assert kept.volts[-1].any()


def test_damaged_messages_do_not_keep_it_awake(pad: Host):
    dog = pad.number("PADGEN_WATCHDOG_SAMPLES")
    ramp = pad.number("PADGEN_RAMP_SAMPLES")
    noise = feed(damaged(Message(Kind.PING, 5), 3))
    run = pad.run(pad.hello + feed(frame_message(np.ones(16), 0)) + (f"run {dog // 4}\n" + noise) * 5 + f"run {ramp}\n")
    assert run.is_silent


def test_a_line_that_closes_in_mid_frame_leaves_it_silent(pad: Host):
    dog = pad.number("PADGEN_WATCHDOG_SAMPLES")
    ramp = pad.number("PADGEN_RAMP_SAMPLES")
    half = encode(frame_message(np.eye(16)[1], 1))[:6]
    run = pad.run(pad.hello + feed(frame_message(np.eye(16)[0], 0)) + "run 3000\n" + feed(half) + f"run {dog + ramp}\n")
    assert run.begun == [(np.eye(16)[0] * 255).astype(int).tolist(), None]
    assert run.is_silent and not run.volts[-1].any()


def test_silence_goes_before_a_frame_that_waits(pad: Host):
    ramp = pad.number("PADGEN_RAMP_SAMPLES")
    shown = [frame_message(np.eye(16)[k], k) for k in range(2)]
    run = pad.run(pad.hello + feed(shown[0]) + "run 10\n" + feed(shown[1], SILENCE) + f"run {2 * ramp}\n")
    assert run.begun == [(np.eye(16)[0] * 255).astype(int).tolist(), None]
    assert run.is_silent


@pads("time-shared")
def test_silence_is_kept_at_the_end_of_a_slot(pad: Host):
    slot = pad.number("PADGEN_STEP_SAMPLES")
    run = pad.run(pad.hello + feed(frame_message(np.ones(11), 0)) + "run 100\n" + feed(SILENCE) + f"run {slot}\n")
    assert f"silent {slot}" in run.log
    assert not run.volts[slot:].any() and run.volts[slot // 2].any()


@pads("big")
def test_frames_of_many_taxels_are_understood(pad: Host):
    ramp = pad.number("PADGEN_RAMP_SAMPLES")
    levels = np.arange(512) % 255 + 1
    bits = np.arange(512) % 3 == 0
    shown = feed(frame_message(levels / 255, 0)) + f"run {ramp}\n" + feed(frame_message(bits, 1)) + f"run {ramp}\n"
    run = pad.run(pad.hello + shown)
    assert run.begun == [levels.tolist(), (bits * 255).tolist()]


def test_whatever_comes_no_frame_is_shown_that_was_not_sent(pad: Host):
    rng = np.random.default_rng(4)
    ramp = pad.number("PADGEN_RAMP_SAMPLES")
    script = pad.hello
    sent = []
    for k in range(300):
        message = frame_message(rng.integers(0, 256, 16) / 255, k % 7)
        packet = bytearray(encode(message))
        for _ in range(rng.integers(0, 3)):
            place, drops, adds = rng.integers(0, len(packet)), *rng.integers(0, 2, 2)
            packet[place : place + drops] = bytes(rng.integers(0, 256, adds).tolist())
        sent.append(list(message.payload))
        script += feed(bytes(packet)) + f"run {ramp // 2}\n"
    run = pad.run(script)
    shown = [levels for levels in run.begun if levels]
    assert 7 <= len(shown) < 300
    assert all(levels in sent for levels in shown)
    assert len([a for a in run.answers if a and a.kind == Kind.ACK]) == len(shown)


# ---- Messages ------------------------------------------------------------------------------------------------------


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 255), st.integers(0, 65535), st.binary(max_size=600))
def test_messages_come_back(kind: int, sequence: int, payload: bytes):
    message = Message(kind, sequence, payload)
    packet = encode(message)
    assert packet[0] == packet[-1] == 0 and 0 not in packet[1:-1]
    assert decode(packet) == ([message], b"")
    assert decode(packet[:-1]) == ([], packet[1:-1])


@pytest.mark.parametrize("length", [0, 1, 245, 246, 247, 253, 254, 255, 500, 508, 509, 1000])
@pytest.mark.parametrize("byte", [0, 1, 255])
def test_payloads_of_any_length_come_back(length: int, byte: int):
    for end in (b"", b"\0", b"\0\x01"):
        message = Message(Kind.FRAME, 3, bytes([byte]) * length + end)
        assert decode(encode(message) * 2) == ([message, message], b"")


@given(st.binary(min_size=1, max_size=40), st.integers(0, 1000), st.integers(1, 255))
def test_a_changed_byte_is_noticed(payload: bytes, place: int, change: int):
    packet = bytearray(encode(Message(Kind.FRAME, 9, payload)))
    packet[1 + place % (len(packet) - 2)] ^= change
    messages, _ = decode(bytes(packet))
    assert all(message is None for message in messages)


def test_signs_follow_the_levels_where_a_taxel_is_turned_over():
    assert frame_message(np.array([1.0, -1.0, 0.0]), 7) == Message(Kind.FRAME_BITS, 7, bytes([0b011, 0b010]))
    assert frame_message(np.array([-0.2, 1.0]), 7) == Message(Kind.FRAME, 7, bytes([51, 255, 0b01]))


def test_grey_frames_have_a_byte_and_others_a_bit_for_a_taxel():
    assert frame_message(np.array([1, 0, 0, 1, 0, 0, 0, 0, 1.0]), 3) == Message(Kind.FRAME_BITS, 3, b"\x09\x01")
    assert frame_message(np.array([0, 0.5, 1.0]), 4) == Message(Kind.FRAME, 4, b"\x00\x80\xff")


def test_firmware_files_go_beside_the_header():
    names = set(firmware_files())
    assert names == {
        *(f"padgen_{part}.{kind}" for part in ("drive", "protocol") for kind in "ch"),
        "host_main.c",
        "padgen_firmware.md",
    }


def test_firmware_has_no_use_of_the_heap():
    core = b"".join(firmware_files()[f"padgen_{part}.{kind}"] for part in ("drive", "protocol") for kind in "ch")
    assert not any(word in core for word in (b"malloc(", b"sinf(", b"cosf(", b"double", b"stdio.h"))


def test_example_of_the_page_is_what_the_encoder_makes():
    page = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text()
    lines = page.split("## An example")[1].splitlines()
    packets = [bytes.fromhex(line.split(maxsplit=1)[1]) for line in lines if line.lstrip().startswith(("→ 00", "← 00"))]
    pad = bytes.fromhex("0123456789abcdef")
    first = np.zeros(16)
    first[[0, 2, 15]] = 1.0
    assert packets[0] == encode(Message(Kind.HELLO, 1, pad))
    (met,), _ = decode(packets[1])
    assert greeting(met) == (pad, 16, 16, 1, 0, 0, 8000, 133334, 133334, 1000, 267, 0)
    assert packets[2] == encode(frame_message(first, 0))
    assert packets[3] == encode(Message(Kind.ACK, 0, bytes([Kind.FRAME_BITS, State.SWITCHING, 0, 251, 255])))
    assert packets[4] == encode(frame_message(np.array([1, 128 / 255] + [0] * 14), 1))
    (refused,), _ = decode(packets[5])
    assert refusal(refused) == (Kind.FRAME, Reason.BUSY, 1)
    assert packets[6] == encode(Message(Kind.PING, 2))
    assert packets[7] == encode(Message(Kind.ACK, 2, bytes([Kind.PING, State.HOLDING, 0, 231, 255])))
    assert packets[8] == encode(Message(Kind.SILENCE, 3))
    assert packets[9] == encode(Message(Kind.ACK, 3, bytes([Kind.SILENCE, State.SWITCHING, 0, 231, 255])))
    assert len(packets) == 10


def test_page_has_every_kind_reason_and_state_by_number():
    page = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text()
    for member in (*Kind, *Reason):
        assert f"| {member.value} | {member.name} |" in page
    for state in State:
        assert f"{state.value} {state.name.lower()}" in page
    for name, number in SCHEME_NUMBERS.items():
        assert f"{number} {name}" in page
