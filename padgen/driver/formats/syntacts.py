"""A Python script that plays a pad through Syntacts (mahilab, MIT licence): one output channel per coil.

Syntacts makes sums, products and sequences of simple signals while it plays. Its expressions of t play all schemes as
they are: the volts are those of `padgen.driver.waveform`, with L di/dt of the transitions too. (It can also read a WAV
file, but only its first channel, and then steps through the samples by truncating a time that is summed up.)

A coil is a list of parts ``(start, length, expression)``, of a time t that begins with the part. Parts meet half way
between two samples: a Syntacts sequence plays both where they touch.
"""

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from padgen.core.errors import at_least, number
from padgen.core.files import OutputFolder
from padgen.driver.formats import DriveJob
from padgen.driver.waveform import (
    CoilDrive,
    PadDrive,
    Timeline,
    bias_flows_at,
    coil_lines,
    constant_a2,
    edges,
    ramp_s,
    volts,
)
from padgen.planner.plan import Plan

__all__ = ["FILE", "MADE_OF", "ORDER", "syntacts_script", "write"]

CONSTANT = """
The current has a constant part: the outputs and the amplifiers must pass 0 Hz.
"""

TEMPLATE = '''"""Plays the pad {name} ({scheme}) through Syntacts, one output channel for each of its {coils} coils.

    python FILE          lists the devices
    python FILE INDEX    plays on one of them

Put it beside syntacts.py and its library, which there is for Windows and macOS. Set the amplifiers so that full
scale of an output (a sample of 1) is {scale_v} V at its coil.
{constant}
Channels begin within a buffer of each other, which no taxel feels: each coil is a channel of its own.
"""

import math
import sys
import time

from syntacts import Envelope, Expression, Repeater, Scalar, Sequence, Session

RATE_HZ = {rate}
SECONDS = {seconds}
LOOPS = {loops}
RAMP_S = {ramp}
# Each signal is a list of parts: start and length in s, and an expression of the part's own t.
SIGNALS = [
{signals}]
# Which of them each channel plays.
COILS = [
{coil_signals}]
GROUP = 16


class Index(int):
    """A device's index; 0 too counts as one, which Session.open takes for none."""

    def __bool__(self):
        return True


def part_signal(text):
    signal = Expression(text)
    if not math.isfinite(signal.sample(0.0)):
        sys.exit(f"This Syntacts cannot read the expression {{text}}")
    return signal


def sequence(parts):
    """Signals (start, length, signal) one after the other; in groups, as a sequence asks all its parts at every t."""
    while len(parts) > GROUP:
        groups = [parts[k : k + GROUP] for k in range(0, len(parts), GROUP)]
        parts = [(group[0][0], group[-1][0] + group[-1][1] - group[0][0], sequence(group)) for group in groups]
    origin = parts[0][0]
    played = Sequence()
    for start, length, signal in parts:
        played.insert(Envelope(length) * signal, start - origin)
    return played


def coil_signal(parts):
    """Return the signal of a coil, None for silence."""
    if not parts:
        return None
    if LOOPS and len(parts) == 1:
        return part_signal(parts[0][2])
    signals = [(start, length, part_signal(text)) for start, length, text in parts]
    if signals[0][0] > 0:
        signals.insert(0, (0.0, signals[0][0], Scalar(0.0)))
    played = sequence(signals)
    return Repeater(played + Envelope(SECONDS, 0.0), 1_000_000, 0.0) if LOOPS else played


def coil_signals():
    signals = [coil_signal(parts) for parts in SIGNALS]
    return [signals[k] for k in COILS]


def fade(session):
    """Down in steps, for a silence without a click, where the signals themselves do not end."""
    for step in range(32, -1, -1):
        for channel in range(len(COILS)):
            session.set_volume(channel, step / 32)
        time.sleep(RAMP_S / 32)


def main():
    session = Session()
    fitting = {{
        device.index: device
        for device in session.available_devices
        if device.max_channels >= len(COILS) and RATE_HZ in device.sample_rates
    }}
    if len(sys.argv) != 2 or not sys.argv[1].isdecimal() or int(sys.argv[1]) not in fitting:
        print(f"Devices with {{len(COILS)}} channels at {{RATE_HZ}} Hz:")
        for index, device in fitting.items():
            print(f"{{index:4}}  {{device.name}} ({{device.api_name}}), {{device.max_channels}} channels")
        return 2
    signals = coil_signals()
    fault = session.open(Index(sys.argv[1]), len(COILS), RATE_HZ)
    if fault:
        print(f"The device does not open (Syntacts error {{fault}}).")
        return 1
    try:
        for channel, signal in enumerate(signals):
            if signal is not None:
                session.play(channel, signal)
        while LOOPS:
            time.sleep(0.1)
        time.sleep(SECONDS + 0.5)
    except KeyboardInterrupt:
        pass
    finally:
        fade(session)
        session.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
'''


ORDER = 5
MADE_OF = "frames"
FILE = "drive_syntacts.py"


class _TimedStretch(NamedTuple):
    """Stretch of time from keyframe `key` to the next; t = 0 of its Syntacts expression is at `start_s`.

    The share of the way from one to the other is ``clamp(0, offset + speed t, 1)``. `half_samples` is the time from the
    beginning of the file to t = 0, in half samples.
    """

    key: int
    start_s: float
    length_s: float
    offset: float
    speed: float
    half_samples: int


def write(out: OutputFolder, job: DriveJob) -> None:
    """Write the script, with the same full scale as the WAV of voltages where one is written."""
    report = job.report
    scale = report.full_scale if report and report.signal == "voltage" else None
    out.write(FILE, syntacts_script(job.plan, *job.played(), scale))


def syntacts_script(plan: Plan, drive: PadDrive, timeline: Timeline, full_scale_v: float | None = None) -> str:
    """Return the script's text, in which a sample of 1 means `full_scale_v` at the coil.

    That should be the written wave's, if there is one; None: the amplifier's limit, or the peak where it is above.
    """
    if full_scale_v is None:
        peak_v = max((float(np.abs(block).max(initial=0)) for block in volts(drive, timeline)), default=0.0)
        full_scale_v = drive.voltage_limit_v if peak_v <= drive.voltage_limit_v else float(at_least(peak_v))
    stretches = list(_stretches(drive, timeline))
    known: dict[str, int] = {}
    texts: list[str] = []
    for coil in drive.coils:
        parts = _parts(drive, timeline, coil, stretches, full_scale_v)
        texts.append("[" + ",\n     ".join(f"({s.start_s!r}, {s.length_s!r}, {text!r})" for s, text in parts) + "]")
        known.setdefault(texts[-1], len(known))
    coils = ""
    for text, coil in zip(texts, drive.coils, strict=True):
        ids = " ".join(plan.taxels[index].id for index in coil.taxels) or "no taxel"
        coils += f"    {known[text]},  # row {coil.row}, column {coil.column}: {ids}\n"
    return TEMPLATE.format(
        name=plan.name,
        scheme=drive.scheme.name,
        coils=len(drive.coils),
        scale_v=number(full_scale_v),
        constant=CONSTANT if drive.has_constant else "",
        rate=drive.rate_hz,
        # A little less, or a loop's first sample could fall behind its last part.
        seconds=_figure(timeline.seconds * (1 - 1e-11)),
        loops=timeline.loops,
        ramp=_figure(ramp_s(plan)),
        signals="".join(f"    {text},\n" for text in known),
        coil_signals=coils,
    )


def _figure(value: float) -> str:
    """Return a number as text for the script, with twelve digits so that it is the same on all platforms."""
    return repr(float(f"{value:.12g}"))


def _stretches(drive: PadDrive, timeline: Timeline) -> Iterator[_TimedStretch]:
    """Yield the stretches between the keyframes, cut at the same samples as the written wave."""
    rate = drive.rate_hz
    edge = edges(drive, timeline)
    for key, (first, last) in enumerate(pairwise(edge)):
        if last <= first:
            continue
        half = max(2 * first - 1, 0)
        end = 2 * last if key == len(edge) - 2 else 2 * last - 1
        begin_s = float(timeline.time_s[key])
        speed = 1 / float(timeline.time_s[key + 1] - timeline.time_s[key])
        start_s = half / (2 * rate)
        yield _TimedStretch(key, start_s, (end - half) / (2 * rate), (start_s - begin_s) * speed, speed, half)


def _parts(
    drive: PadDrive, timeline: Timeline, coil: CoilDrive, stretches: list[_TimedStretch], scale_v: float
) -> Iterator[tuple[_TimedStretch, str]]:
    """Yield each stretch in which a coil is not silent, with the expression of its voltage as a share of `scale_v`."""
    if not len(coil.taxels):
        return
    levels = timeline.signed[:, coil.taxels]
    constant = constant_a2(coil, levels) if drive.scheme.is_root else np.zeros(len(levels))
    for stretch in stretches:
        keys = slice(stretch.key, stretch.key + 2)
        if drive.scheme.is_root:
            text = _root_text(drive, coil, stretch, levels[keys], constant[keys], scale_v)
        else:
            fed = bias_flows_at(timeline, stretch.key), bias_flows_at(timeline, stretch.key + 1)
            text = _tones_text(drive, coil, stretch, levels[keys], fed, scale_v)
        if text:
            yield stretch, text


def _lines(
    drive: PadDrive, stretch: _TimedStretch, harmonic: np.ndarray, weight: np.ndarray
) -> list[tuple[complex, float]]:
    """Return each spectral line's complex amplitude at a stretch's start, with its angular frequency in rad/s."""
    turned = harmonic * stretch.half_samples % (2 * drive.period_samples) / (2 * drive.period_samples)
    rates = 2 * np.pi * harmonic / drive.period_s
    return list(zip((weight * np.exp(2j * np.pi * turned)).tolist(), rates.tolist(), strict=True))


def _n(value: float) -> str:
    """Return a number as text for a Syntacts expression, in parentheses if it is negative."""
    return f"{value:.15g}" if value >= 0 else f"({value:.15g})"


def _wave(amplitude: complex, rate: float) -> str:
    """Return ``Re amplitude exp(i rate t)`` as text for a Syntacts expression: a cosine of t."""
    return f"{_n(abs(amplitude))} * cos({_n(rate)} * t + {_n(float(np.angle(amplitude)))})"


REST = "(126 - x * (420 - x * (540 - x * (315 - 70 * x))))"
STEP = f"x * x * x * x * x * {REST}"
"""`padgen.driver.waveform.blend` as an expression of the share x."""
STEP_SLOPE = "630 * x * x * x * x * (1 - x) * (1 - x) * (1 - x) * (1 - x)"


def _step_text(stretch: _TimedStretch, half: str = "") -> str:
    """Return script text that assigns the smooth step b, its slope d and q = 1 − b; `half` is appended to each name.

    1 − b is b of 1 − x, which keeps its digits where it is small: the root of it is taken.
    """
    faster = 2 if half else 1
    speed = _n(faster * stretch.speed)
    share = f"clamp(0, {_n(faster * stretch.offset - (half == '2'))} + {speed} * t, 1)"
    text = f"var x := {share}; var b := {STEP}; var d := {speed} * {STEP_SLOPE}; x := 1 - x; var q := {STEP}; "
    return re.sub(r"\b([xbdq])\b", rf"\g<1>{half}", text)


def _mixed(before: float, after: float, half: str = "") -> str:
    """Return text of a value that goes from `before` to `after` with the smooth step of a stretch or of its `half`."""
    shares = [f"{_n(value)} * {share}{half}" for value, share in ((before, "q"), (after, "b")) if value]
    return _n(before) if before == after else f"({' + '.join(shares)})"


def _tones_text(
    drive: PadDrive, coil: CoilDrive, stretch: _TimedStretch, levels: np.ndarray, fed: tuple[bool, bool], scale_v: float
) -> str:
    """Return the expression of a coil's volts for a current of tones, with or without a constant; '' for silence."""
    harmonic, amplitude = coil_lines(drive, coil)
    is_root = not drive.scheme.goes_with_level
    if drive.scheme.is_biased:
        harmonic = np.append(harmonic, 0)
        amplitude = np.append(amplitude, coil.bias_a)
        levels = np.column_stack([levels, fed])
        if fed[0] != fed[1]:  # i² rises with the step as a whole
            amplitude = amplitude * levels[fed.index(True)]
            is_root = True
            levels = np.repeat(np.array(fed, float)[:, None], len(harmonic), 1)
        elif not fed[0]:
            return ""
    text = ""
    terms = []
    shapes = dict[tuple[float, float, str], tuple[str, str]]()
    lines = _lines(drive, stretch, harmonic, amplitude / scale_v)
    for line, rate, before, after, half in _blends(lines, levels, is_root):
        if not (line and (before or after)):
            continue
        if (before, after, half) not in shapes:
            level = _mixed(before, after, half)
            rise = f"{_n(after - before)} * d{half}" if before != after else ""
            if is_root:
                k = len(shapes)
                text += f"var g{k} := sqrt(max({level}, 1e-300)); "
                level = f"g{k}"
                rise = f"{rise} / (2 * g{k})" if rise else ""
            shapes[before, after, half] = level, rise
        level, rise = shapes[before, after, half]
        # The constant current of the biased scheme has no line to be made good.
        correction = complex(drive.high_pass_correction(np.array(rate / (2 * np.pi)))) if rate else 1.0
        line_v = (drive.resistance_ohm + 1j * rate * drive.inductance_h) * line * correction
        terms.append(f"{level} * {_wave(line_v, rate)}")
        if rise:
            terms.append(f"{rise} * {_wave(drive.inductance_h * line, rate)}")
    steps = {half for (_, _, half), (_, rise) in shapes.items() if rise}
    return "".join(_step_text(stretch, half) for half in sorted(steps)) + text + " + ".join(terms)


def _blends(
    lines: list[tuple[complex, float]], levels: np.ndarray, is_root: bool
) -> Iterator[tuple[complex, float, float, float, str]]:
    """Yield (line, rad/s, level before, level after, half of the stretch in which they hold: '1', '2', or '' for all).

    A tone, which has the root of its level, is a quarter of its period late where that is below 0, and is down in the
    middle where its level turns over.
    """
    for (line, rate), before, after in zip(lines, *levels.tolist(), strict=True):
        if is_root and before * after < 0:
            yield line * (-1j if before < 0 else 1), rate, abs(before), 0.0, "1"
            yield line * (-1j if after < 0 else 1), rate, 0.0, abs(after), "2"
        elif is_root and min(before, after) < 0:
            yield -1j * line, rate, abs(before), abs(after), ""
        else:
            yield line, rate, before, after, ""


def _root_text(
    drive: PadDrive, coil: CoilDrive, stretch: _TimedStretch, levels: np.ndarray, constant: np.ndarray, scale_v: float
) -> str:
    """Return the expression for the volts of a spur-free coil, its force blended between keyframes; '' for silence.

    On a carrier the current is √(2F) cos(w t + p).
    """
    if not levels.any():
        return ""
    text = ""
    force = [_mixed(constant[0], constant[1])]
    slope = ["0"]
    if not np.array_equal(*levels):
        text = _step_text(stretch)
        slope.append(f"{_n(constant[1] - constant[0])} * d")
    lines = _lines(drive, stretch, *coil_lines(drive, coil))
    for (line, rate), before, after in zip(lines, *levels.tolist(), strict=True):
        if before or after:
            level = _mixed(before, after)
            force.append(f"{level} * {_wave(line, rate)}")
            slope.append(f"{level} * {_wave(1j * rate * line, rate)}")
            if before != after:
                slope.append(f"{_n(after - before)} * d * {_wave(line, rate)}")
    r = drive.resistance_ohm / scale_v
    half_l = drive.inductance_h / (2 * scale_v)
    text += f"var r := sqrt(max({' + '.join(force)}, 1e-300)); var s := ({' + '.join(slope)}) / r; "
    volts = f"{_n(r)} * r + {_n(half_l)} * s"
    if drive.carrier_hz is None:
        return text + volts
    harmonic = np.array([round(drive.carrier_hz * drive.period_s)])
    correction = drive.high_pass_correction(harmonic / drive.period_s)
    ((begin, rate),) = _lines(drive, stretch, harmonic, np.sqrt(2) * correction)
    return f"{text}({volts}) * {_wave(begin, rate)} + {_n(2 * half_l)} * r * {_wave(1j * rate * begin, rate)}"
