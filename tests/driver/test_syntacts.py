"""The Syntacts script, run against a model of the library, plays the volts of the written wave."""

import re
import sys
import types

import numpy as np
import pytest

import padgen as pg
from padgen.driver.formats.syntacts import syntacts_script
from padgen.driver.frames import state_frames
from padgen.driver.waveform import PadDrive, Timeline, make_drive, steady, timeline, volts
from padgen.planner import Plan
from padgen.spec import parse_spec

RATE_HZ = 48_000
SMALL = (
    'name = "t"\nresolution = {}\nband_hz = [50, 400]\nq_min = 15\n'
    "[pad]\nwidth_mm = 25\ndepth_mm = 25\n[coil]\ngrid = [2, 2]\n{}\n"
)


class Signal:
    """A signal as in the library: a value at times (m,) since its start, and a length in s."""

    length = np.inf

    def at(self, t: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def sample(self, t: float) -> float:
        return float(self.at(np.array([t]))[0])

    def __add__(self, other: "Signal") -> "Signal":
        return Pair(self, other, np.add, max)

    def __mul__(self, other: "Signal") -> "Signal":
        return Pair(self, other, np.multiply, min)

    def __rmul__(self, factor: float) -> "Signal":
        return Pair(self, Scalar(factor), np.multiply, min)


class Pair(Signal):
    """A sum, as long as the longer signal, or a product, as long as the shorter."""

    def __init__(self, a, b, combine, length):
        self.a, self.b, self.combine, self.length = a, b, combine, length(a.length, b.length)

    def at(self, t):
        return self.combine(self.a.at(t), self.b.at(t))


class Scalar(Signal):
    def __init__(self, value):
        self.value = float(value)

    def at(self, t):
        return np.full(len(t), self.value)


class Ramp(Signal):
    def __init__(self, initial, rate):
        self.initial = initial
        self.rate = rate

    def at(self, t):
        return self.initial + self.rate * t


class Sine(Signal):
    def __init__(self, angle):
        self.angle = angle

    def at(self, t):
        return np.sin(self.angle.at(t))


class Envelope(Signal):
    def __init__(self, duration, amplitude=1.0):
        self.length = duration
        self.amplitude = amplitude

    def at(self, t):
        return np.where(t > self.length, 0.0, self.amplitude)


class Sequence(Signal):
    """The sum of the parts that play at a time, both ends of each included."""

    def __init__(self):
        self.length = 0.0
        self.parts = []

    def insert(self, signal, start):
        assert not isinstance(signal, Sequence), "whose parts would be taken apart"
        self.length = max(self.length, start + signal.length)
        self.parts.append((start, signal))

    def at(self, t):
        value = np.zeros(len(t))
        for start, signal in self.parts:
            on = (t >= start) & (t <= start + signal.length)
            if on.any():
                value[on] += signal.at(t[on] - start)
        return value


class Repeater(Signal):
    def __init__(self, signal, repetitions, delay):
        assert delay == 0
        self.signal = signal
        self.length = signal.length * repetitions

    def at(self, t):
        return self.signal.at(np.fmod(t, self.signal.length))


class Expression(Signal):
    """The statements of ExprTk that scripts use: ``var a := …; a := …; value``."""

    def __init__(self, text):
        self.text = text

    def at(self, t):
        names = {"t": t, "sqrt": np.sqrt, "cos": np.cos, "sin": np.sin, "max": np.maximum}
        names |= {"clamp": lambda low, x, high: np.clip(x, low, high), "__builtins__": {}}
        *statements, value = self.text.split(";")
        for statement in statements:
            new, name, assigned = re.fullmatch(r" *(var )?([a-z]\d*) := (.+)", statement).groups()
            assert bool(new) == (name not in names)
            names[name] = eval(assigned, names)
        return eval(value.strip(), names) + 0 * t


class Device:
    def __init__(self, index, channels, rates):
        self.index = index
        self.max_channels = channels
        self.sample_rates = rates
        self.name = f"device {index}"
        self.api_name = "model"


class Session:
    """A session that notes its calls."""

    asked: list = []  # noqa: RUF012
    fault = 0

    def __init__(self):
        self.available_devices = [Device(0, 4, [RATE_HZ]), Device(1, 2, [RATE_HZ]), Device(2, 8, [44_100])]

    def open(self, index=None, channels=0, rate=0):
        self.asked.append(("open", int(index) if index else None, channels, rate))
        return self.fault

    def play(self, channel, signal):
        assert isinstance(signal, Signal)
        self.asked.append(("play", channel))

    def set_volume(self, channel, volume):
        self.asked.append(("volume", channel, volume))

    def close(self):
        self.asked.append(("close",))


@pytest.fixture
def library(monkeypatch) -> types.ModuleType:
    module = types.ModuleType("syntacts")
    for thing in (Scalar, Ramp, Sine, Envelope, Sequence, Repeater, Expression, Session):
        setattr(module, thing.__name__, thing)
    monkeypatch.setitem(sys.modules, "syntacts", module)
    monkeypatch.setattr(Session, "asked", [])
    return module


def run(script: str) -> dict:
    names: dict = {"__name__": "script"}
    exec(compile(script, "script.py", "exec"), names)
    return names


def rendered(script: str, samples: int) -> np.ndarray:
    """Return volts (samples, coils), with time summed up as the library does."""
    time_s = np.concatenate([[0.0], np.cumsum(np.full(samples - 1, 1 / RATE_HZ))])
    scale_v = float(re.search(r"\(a sample of 1\) is (\S+) V", script).group(1))
    signals = run(script)["coil_signals"]()
    return np.stack([scale_v * s.at(time_s) if s else np.zeros(samples) for s in signals], 1)


def written(drive: PadDrive, shown: Timeline) -> np.ndarray:
    return np.concatenate(list(volts(drive, shown)))


def error_of(plan: Plan, drive: PadDrive, shown: Timeline) -> float:
    """Return the largest difference over the largest voltage."""
    wanted = written(drive, shown)
    found = rendered(syntacts_script(plan, drive, shown), len(wanted))
    assert np.abs(wanted).max() > 0.01
    return float(np.abs(found - wanted).max() / np.abs(wanted).max())


def small(scheme: str, more: str = "", taxels: int = 7) -> Plan:
    return pg.plan(parse_spec(SMALL.format(taxels, f'{more}\n[drive]\nscheme = "{scheme}"')))


def grey(plan: Plan, count: int = 4) -> np.ndarray:
    return np.random.default_rng(3).integers(0, 3, (count, len(plan.taxels))) / 2


# 1e-7: twelve digits of an amplitude and a phase, and the sum of a second's times, are known to 1e-11 of a turn.
@pytest.mark.sample(4)
@pytest.mark.parametrize("more", ["", 'reuse = "alternate"', "name = 'paper'\ninductance_mh = 0"])
@pytest.mark.parametrize("scheme", ["tones", "biased", "spur-free", "time-shared"])
def test_whole_sequences_are_those_of_the_wave(library, scheme, more):
    """Steady states, transitions and their L di/dt agree, from silence to silence."""
    plan = small(scheme, more)
    drive = make_drive(plan, RATE_HZ)
    assert error_of(plan, drive, timeline(plan, grey(plan))) < 1e-7


@pytest.mark.parametrize("scheme", ["tones", "biased", "spur-free", "time-shared"])
def test_signs_are_those_of_the_wave(library, scheme):
    """Taxels that begin in counter-phase, and some that turn over while they stay on."""
    plan = small(scheme)
    drive = make_drive(plan, RATE_HZ)
    frames = grey(plan)
    signs = np.random.default_rng(4).choice([-1.0, 1.0], frames.shape)
    assert ((signs[1:] != signs[:-1]) & (frames[1:] > 0) & (frames[:-1] > 0)).any()
    assert error_of(plan, drive, timeline(plan, frames, signs=signs)) < 1e-7


@pytest.mark.parametrize("scheme", ["tones", "biased", "spur-free", "time-shared"])
def test_steady_states_go_on_for_ever(library, scheme):
    plan = small(scheme)
    drive = make_drive(plan, RATE_HZ)
    levels = state_frames(plan, "10" if scheme == "time-shared" else "11")[0]
    shown = steady(levels, drive.period_s)
    assert error_of(plan, drive, shown) < 1e-9
    once = written(drive, shown)
    assert run(syntacts_script(plan, drive, shown))["coil_signals"]()[0].length == np.inf
    twice = rendered(syntacts_script(plan, drive, shown), 2 * len(once))
    assert np.abs(twice - np.concatenate([once, once])).max() < 1e-9 * np.abs(once).max()


@pytest.mark.parametrize("ends", ["shown", "silent"])
@pytest.mark.parametrize("scheme", ["tones", "biased", "spur-free"])
def test_loops_of_several_frames_have_no_seam(library, scheme, ends):
    """In three rounds the library's time, then a remainder, is never exactly on the samples or just before the end."""
    plan = small(scheme)
    drive = make_drive(plan, RATE_HZ)
    levels = grey(plan, 6)
    levels[2], levels[-1] = 0, levels[0]
    if ends == "silent":
        levels[[0, 4, 5]] = 0
    shown = Timeline(np.array([0, 0.1, 0.2, 0.21, 0.5, 0.9]) / 0.9 * 4 * drive.period_s, levels, True)
    once = written(drive, shown)
    script = syntacts_script(plan, drive, shown)
    found = rendered(script, 3 * len(once))
    assert np.abs(found - np.concatenate([once] * 3)).max() < 1e-6 * np.abs(once).max()
    just_before = np.array([shown.seconds * (2 - 1e-12)])
    for k, signal in enumerate(run(script)["coil_signals"]()):
        assert 30 * float(signal.at(just_before)[0]) == pytest.approx(once[0, k], abs=1e-6)


def test_a_carrier(library):
    plan = small("spur-free")
    drive = make_drive(plan, RATE_HZ, carrier_hz=6000.0)
    assert error_of(plan, drive, timeline(plan, grey(plan, 2))) < 1e-7


def test_three_tones_with_phases(library):
    plan = pg.plan(parse_spec(SMALL.replace("25", "40").format(12, '[drive]\nscheme = "tones"')))
    drive = make_drive(plan, RATE_HZ)
    assert len(plan.channels) == 3 and np.ptp(drive.coils[0].phase_rad) > 0.1
    assert error_of(plan, drive, timeline(plan, grey(plan, 2))) < 1e-7


def test_eleven_channels(library):
    plan = pg.plan("wide-11")
    drive = make_drive(plan, RATE_HZ)
    assert error_of(plan, drive, timeline(plan, grey(plan, 1))) < 1e-7


THREE = SMALL.format(3, "").replace("[pad]", "resonances_hz = [60]\n[pad]")
"""Three taxels on four coils."""


def test_long_sequences_are_grouped_and_silent_coils_play_nothing(library):
    """40 frames have more parts than a group."""
    plan = pg.plan(parse_spec(THREE))
    drive = make_drive(plan, RATE_HZ)
    frames = np.ones((40, 3))
    frames[::3, 1] = 0
    shown = timeline(plan, frames, 0.3)
    assert error_of(plan, drive, shown) < 1e-6
    assert run(syntacts_script(plan, drive, shown))["coil_signals"]()[3] is None


def test_full_scale_is_what_is_asked_and_nothing_is_clipped(library):
    plan = small("tones")
    drive = make_drive(plan, RATE_HZ)
    shown = steady(np.ones(7), drive.period_s)
    once = written(drive, shown)
    for asked in (None, 12.5):
        script = syntacts_script(plan, drive, shown, asked)
        assert f"is {asked or 30:g} V" in script
        assert np.abs(rendered(script, len(once)) - once).max() < 1e-8
    strong = small("tones", taxels=7)
    loud = make_drive(pg.plan(parse_spec(SMALL.format(7, "\n[drive]\nvoltage_limit_v = 5"))), RATE_HZ)
    script = syntacts_script(strong, loud, shown)
    scale_v = float(re.search(r"is (\S+) V", script).group(1))
    peak_v = np.abs(written(loud, shown)).max()
    assert 5 < peak_v <= scale_v < 1.001 * peak_v


def test_the_script_says_when_a_constant_must_pass(library):
    for scheme, constant in (("tones", False), ("biased", True), ("spur-free", True)):
        plan = small(scheme)
        drive = make_drive(plan, RATE_HZ)
        script = syntacts_script(plan, drive, steady(np.ones(7), drive.period_s))
        assert ("must pass 0 Hz" in script) == constant
        assert script == syntacts_script(plan, drive, steady(np.ones(7), drive.period_s))
        # Coils that play the same are one signal.
        assert len(run(script)["SIGNALS"]) == 2 and run(script)["COILS"] == [0, 0, 0, 1]


def script_of(plan: Plan) -> dict:
    drive = make_drive(plan, RATE_HZ)
    return run(syntacts_script(plan, drive, timeline(plan, np.ones((1, len(plan.taxels))))))


def test_the_script_plays(library, monkeypatch, capsys):
    names = script_of(pg.plan(parse_spec(THREE)))
    slept = []
    monkeypatch.setattr("time.sleep", slept.append)
    monkeypatch.setattr(sys, "argv", ["script.py"])
    assert names["main"]() == 2
    assert capsys.readouterr().out.splitlines() == [
        "Devices with 4 channels at 48000 Hz:",
        "   0  device 0 (model), 4 channels",
    ]
    monkeypatch.setattr(sys, "argv", ["script.py", "0"])
    assert names["main"]() == 0
    asked = Session.asked
    assert asked[:5] == [("open", 0, 4, RATE_HZ), *(("play", channel) for channel in range(3)), ("volume", 0, 1.0)]
    assert asked[-5:] == [*(("volume", channel, 0.0) for channel in range(4)), ("close",)]
    assert max(slept) >= names["SECONDS"]


def test_the_script_says_that_a_device_does_not_open(library, monkeypatch, capsys):
    names = script_of(small("tones"))
    monkeypatch.setattr(Session, "fault", 7)
    monkeypatch.setattr(sys, "argv", ["script.py", "0"])
    assert names["main"]() == 1 and "does not open (Syntacts error 7)" in capsys.readouterr().out
    assert [what for what, *_ in Session.asked] == ["open"]


def test_the_script_plays_nothing_that_the_library_cannot_read(library, monkeypatch):
    """The library does not report an expression that it cannot compile: its value is then nan."""
    names = script_of(small("spur-free"))
    monkeypatch.setattr(Expression, "at", lambda self, t: np.full(len(t), np.nan))
    with pytest.raises(SystemExit, match="This Syntacts cannot read the expression var x := clamp"):
        names["coil_signals"]()
