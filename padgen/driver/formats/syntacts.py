"""A Python script that plays a pad through Syntacts (mahilab, MIT licence): one output channel per coil.

Syntacts makes sums, products and sequences of simple signals while it plays. Steady tones are its sines. Where levels
change, and for the root of a spur-free drive, its expressions of t are used, so that all schemes are played as they
are: the volts are those of `padgen.driver.waveform`, with L di/dt of the transitions too. (It can also read a WAV
file, but only its first channel, and then steps through the samples by truncating a time that is summed up.)

A coil is a list of parts ``(start, length, terms)``, of a time t that begins with the part; each term is
``(shape, constant, tones)`` for shape(t) · (constant + Σ a sin(w t + p)). Parts meet half way between two samples: a
Syntacts sequence plays both where they touch.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from padgen.core.errors import at_least, number
from padgen.core.files import OutputFolder
from padgen.driver.formats import DriveJob
from padgen.driver.pad_drive import CoilDrive, PadDrive, coil_lines, constant_a2
from padgen.driver.waveform import Timeline, edges, is_fed, ramp_s, volts
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

from syntacts import Envelope, Expression, Ramp, Repeater, Scalar, Sequence, Session, Sine

RATE_HZ = {rate}
SECONDS = {seconds}
LOOPS = {loops}
RAMP_S = {ramp}
# Each signal is a list of parts: start and length in s, and terms; a term is the product of an expression of the
# part's own t (or '' for 1) and of a constant plus sines of amplitude, rate in rad/s and phase in rad.
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


def term_signal(shape, constant, tones):
    signal = Scalar(constant)
    for amplitude, rate, phase in tones:
        signal = signal + amplitude * Sine(Ramp(phase, rate))
    if not shape:
        return signal
    envelope = Expression(shape)
    if not math.isfinite(envelope.sample(0.0)):
        sys.exit(f"This Syntacts cannot read the expression {{shape}}")
    return envelope * signal


def part_signal(terms):
    signal = term_signal(*terms[0])
    for term in terms[1:]:
        signal = signal + term_signal(*term)
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
    signals = [(start, length, part_signal(terms)) for start, length, terms in parts]
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


ORDER, MADE_OF, FILE = 5, "frames", "drive_syntacts.py"
Tones = list[tuple[complex, float, float]]
Term = tuple[str, float, list[tuple[float, float, float]]]


class _Stretch(NamedTuple):
    """Samples between two keyframes, `key` and the next; t counts from `start_s` on.

    The share of the way from one to the other is ``clamp(0, offset + speed t, 1)``; `turn` is what a line of
    harmonic 1 has turned by, in half samples of the comb's period, when t is 0.
    """

    key: int
    start_s: float
    length_s: float
    offset: float
    speed: float
    half_samples: int


def write(out: OutputFolder, job: DriveJob) -> None:
    """Add the script, whose samples are as large as those of the wave where one is written."""
    report = job.report
    scale = report.full_scale if report and report.signal == "voltage" else None
    out.write(FILE, syntacts_script(job.plan, *job.played(), scale))


def syntacts_script(plan: Plan, drive: PadDrive, timeline: Timeline, full_scale_v: float | None = None) -> str:
    """Write the script's text; a sample of 1 is `full_scale_v` at the coil.

    That should be the written wave's, if there is one; None: the amplifier's limit, or the peak where it is above.
    """
    scale_v = full_scale_v or _scale_v(drive, timeline)
    stretches = list(_stretches(drive, timeline))
    known: dict[str, int] = {}
    texts: list[str] = []
    for coil in drive.coils:
        texts.append(
            "["
            + ",\n     ".join(
                f"({s.start_s!r}, {s.length_s!r}, {_terms_text(terms)})"
                for s, terms in _parts(drive, timeline, coil, stretches, scale_v)
            )
            + "]"
        )
        known.setdefault(texts[-1], len(known))
    signals = "".join(f"    {text},\n" for text in known)
    coils = ""
    for text, coil in zip(texts, drive.coils, strict=True):
        ids = " ".join(plan.taxels[index].id for index in coil.taxels) or "no taxel"
        coils += f"    {known[text]},  # row {coil.row}, column {coil.column}: {ids}\n"
    constant = CONSTANT if drive.has_constant else ""
    return TEMPLATE.format(
        name=plan.name,
        scheme=drive.scheme.name,
        coils=len(drive.coils),
        scale_v=number(scale_v),
        constant=constant,
        rate=drive.rate_hz,
        seconds=_figure(timeline.seconds),
        loops=timeline.loops,
        ramp=_figure(ramp_s(plan)),
        signals=signals,
        coil_signals=coils,
    )


def _scale_v(drive: PadDrive, timeline: Timeline) -> float:
    peak_v = max((float(np.abs(block).max(initial=0)) for block in volts(drive, timeline)), default=0.0)
    return drive.voltage_limit_v if peak_v <= drive.voltage_limit_v else float(at_least(peak_v))


def _figure(value: float) -> str:
    """Write a number for the script with twelve digits, so that platforms agree."""
    return repr(float(f"{value:.12g}"))


def _stretches(drive: PadDrive, timeline: Timeline) -> Iterator[_Stretch]:
    """Yield the stretches between the keyframes, cut at the same samples as the written wave."""
    rate = drive.rate_hz
    edge = edges(drive, timeline)
    for key, (first, last) in enumerate(pairwise(edge)):
        if last <= first:
            continue
        half = max(2 * first - 1, 0)
        end = 2 * last if key == len(edge) - 2 else 2 * last - 1
        begin_s, speed = float(timeline.time_s[key]), 1 / float(timeline.time_s[key + 1] - timeline.time_s[key])
        start_s = half / (2 * rate)
        yield _Stretch(key, start_s, (end - half) / (2 * rate), (start_s - begin_s) * speed, speed, half)


def _parts(
    drive: PadDrive, timeline: Timeline, coil: CoilDrive, stretches: list[_Stretch], scale_v: float
) -> Iterator[tuple[_Stretch, list[Term]]]:
    """Yield the terms of one coil's stretches, in shares of `scale_v`; none for silence."""
    if not len(coil.taxels):
        return
    levels = timeline.levels[:, coil.taxels]
    constant = constant_a2(drive, coil, levels) if drive.scheme.is_root else np.zeros(len(levels))
    for stretch in stretches:
        before, after = levels[stretch.key], levels[stretch.key + 1]
        if drive.scheme.is_root:
            root = _root_text(drive, coil, stretch, (before, after), constant[stretch.key : stretch.key + 2], scale_v)
            terms: list[Term] = [(root, 1.0, [])] if root else []
        elif drive.scheme.is_biased:
            fed = is_fed(timeline, stretch.key), is_fed(timeline, stretch.key + 1)
            terms = list(_biased(drive, coil, stretch, (before, after), fed, scale_v))
        else:
            terms = list(_tones(drive, coil, stretch, (before, after), scale_v))
        if terms:
            yield stretch, terms


Pair = tuple[np.ndarray, np.ndarray]


def _tones(drive: PadDrive, coil: CoilDrive, stretch: _Stretch, levels: Pair, scale_v: float) -> Iterator[Term]:
    """Yield sines at half the force's frequency, each with the root of its level."""
    harmonic, amplitude = coil_lines(drive, coil)
    for low, high in _pairs(levels):
        own = (levels[0] == low) & (levels[1] == high)
        if low == high:
            shape, slope = "", ""
        elif low == 0 or high == 0:
            shape, slope = _root_of_step(stretch, rises=low == 0)
        else:
            level, rise = _levels_text(stretch, low, high)
            value = level.removeprefix(_share(stretch))
            shape, slope = f"{_share(stretch)}sqrt({value})", f"{rise} / (2 * sqrt({value}))"
        height = float(np.sqrt(low if low == high else 1 if min(low, high) > 0 else max(low, high)))
        tones = list(_lines(drive, stretch, harmonic[own], height / scale_v * amplitude[own]))
        yield from _fed(drive, (shape, slope), 0.0, tones)


def _biased(
    drive: PadDrive, coil: CoilDrive, stretch: _Stretch, levels: Pair, fed: tuple[bool, bool], scale_v: float
) -> Iterator[Term]:
    """Yield a constant and sines at the force's frequency, each as its level; with a root from and to silence."""
    harmonic, amplitude = coil_lines(drive, coil)
    weight, bias = amplitude / scale_v, coil.bias_a / scale_v
    if fed[0] != fed[1]:
        steady = weight * levels[fed.index(True)]
        tones = list(_lines(drive, stretch, harmonic, steady))
        yield from _fed(drive, _root_of_step(stretch, rises=fed[1]), bias, tones)
    elif fed[0]:
        yield "", drive.resistance_ohm * bias, []
        for low, high in _pairs(levels):
            own = (levels[0] == low) & (levels[1] == high)
            shapes = ("", "") if low == high else _levels_text(stretch, low, high)
            height = low if low == high else 1.0
            yield from _fed(drive, shapes, 0.0, list(_lines(drive, stretch, harmonic[own], height * weight[own])))


def _pairs(levels: Pair) -> list[tuple[float, float]]:
    """Return the distinct pairs of levels that are not silent."""
    pairs = {(float(low), float(high)) for low, high in zip(*levels, strict=True)}
    return sorted(pair for pair in pairs if any(pair))


def _lines(drive: PadDrive, stretch: _Stretch, harmonic: np.ndarray, weight: np.ndarray) -> Iterator[tuple]:
    """Yield complex amplitudes of the current when t is 0, with their rates in rad/s."""
    for k, amplitude in zip(harmonic.tolist(), weight.tolist(), strict=True):
        turned = k * stretch.half_samples % (2 * drive.period_samples) / (2 * drive.period_samples)
        if amplitude:
            yield amplitude * np.exp(2j * np.pi * turned), 2 * np.pi * k / drive.period_s


def _fed(drive: PadDrive, shapes: tuple[str, str], constant: float, lines: list[tuple]) -> Iterator[Term]:
    """Yield the volts of ``shape(t) (constant + lines)``: R i + L di/dt, the shape's slope with it."""
    r, inductance = drive.resistance_ohm, drive.inductance_h
    if not (lines or constant):
        return
    yield shapes[0], r * constant, [_tone((r + 1j * rate * inductance) * a, rate) for a, rate in lines]
    if shapes[1] and inductance:
        yield shapes[1], inductance * constant, [_tone(inductance * a, rate) for a, rate in lines]


def _tone(amplitude: complex, rate: float) -> tuple[float, float, float]:
    """Return amplitude, rate and phase of the sine that is the real part of ``amplitude exp(i rate t)``."""
    return abs(amplitude), rate, float(np.angle(1j * amplitude))


def _n(value: float) -> str:
    """Write a number for an expression."""
    return f"{value:.15g}" if value >= 0 else f"({value:.15g})"


def _share(stretch: _Stretch) -> str:
    return f"var x := clamp(0, {_n(stretch.offset)} + {_n(stretch.speed)} * t, 1); "


REST = "(126 - x * (420 - x * (540 - x * (315 - 70 * x))))"
STEP = f"x * x * x * x * x * {REST}"
"""`padgen.driver.waveform.blend` as an expression of the share x."""
STEP_SLOPE = "630 * x * x * x * x * (1 - x) * (1 - x) * (1 - x) * (1 - x)"


def _root_of_step(stretch: _Stretch, rises: bool) -> tuple[str, str]:
    """Return the root of the smooth step, up or down, and its slope, in closed form: both vanish where it starts."""
    share = _share(stretch) + ("" if rises else "x := 1 - x; ")
    speed = stretch.speed if rises else -stretch.speed
    fall = "(1 - x) * (1 - x) * (1 - x) * (1 - x)"
    return (
        f"{share}x * x * sqrt(x) * sqrt{REST}",
        f"{share}{_n(315 * speed)} * x * sqrt(x) * {fall} / sqrt{REST}",
    )


def _levels_text(stretch: _Stretch, low: float, high: float) -> tuple[str, str]:
    """Return a level that goes from one value to another, and its slope."""
    share = _share(stretch)
    rise = f"{_n(high - low)}"
    return f"{share}{_n(low)} + {rise} * ({STEP})", f"{share}{_n((high - low) * stretch.speed)} * {STEP_SLOPE}"


def _root_text(
    drive: PadDrive, coil: CoilDrive, stretch: _Stretch, levels: Pair, constant: np.ndarray, scale_v: float
) -> str:
    """Return the volts of √F, with F from one keyframe's force to the next's; '' for silence.

    On a carrier the current is √(2F) cos(w t + p).
    """
    if not np.any(levels):
        return ""
    text, force, slope = "", [_mixed(constant[0], constant[1])], []
    if not np.array_equal(*levels):
        # 1 − b is b of 1 − x, which keeps its digits where it is small: the root of it is taken.
        text = (
            f"{_share(stretch)}var b := {STEP}; var d := {_n(stretch.speed)} * {STEP_SLOPE}; "
            f"x := 1 - x; var q := {STEP}; "
        )
        slope.append(f"{_n(constant[1] - constant[0])} * d")
    lines = _lines(drive, stretch, *coil_lines(drive, coil))
    for j, ((turned, rate), *pair) in enumerate(zip(lines, *levels, strict=True)):
        if any(pair):
            before, after = (abs(turned) * level for level in pair)
            angle = f"({_n(rate)} * t + {_n(np.angle(turned))})"
            level = _mixed(before, after)
            text += f"var c{j} := cos{angle}; "
            force.append(f"{level} * c{j}")
            slope.append(f"{level} * {_n(-rate)} * sin{angle}")
            if before != after:
                slope.append(f"{_n(after - before)} * d * c{j}")
    r, half_l = drive.resistance_ohm / scale_v, drive.inductance_h / (2 * scale_v)
    text += f"var r := sqrt(max({' + '.join(force)}, 1e-300)); var s := ({' + '.join(slope)}) / r; "
    if drive.carrier_hz is None:
        return f"{text}{_n(r)} * r + {_n(half_l)} * s"
    assert drive.carrier_hz is not None
    harmonic = np.array([round(drive.carrier_hz * drive.period_s)])
    ((begin, speed),) = _lines(drive, stretch, harmonic, np.full(1, np.sqrt(2) + 0j))
    swing = f"({_n(speed)} * t + {_n(np.angle(begin))})"
    high = abs(begin)
    return (
        text
        + f"{_n(high)} * (({_n(r)} * r + {_n(half_l)} * s) * cos{swing} - {_n(2 * half_l * speed)} * r * sin{swing})"
    )


def _mixed(before: float, after: float) -> str:
    """Write a number that goes with the smooth step b, of which q is what is left to 1."""
    shares = [f"{_n(value)} * {share}" for value, share in ((before, "q"), (after, "b")) if value]
    return _n(before) if before == after else f"({' + '.join(shares)})"


def _terms_text(terms: list[Term]) -> str:
    shown = []
    for shape, constant, tones in terms:
        sines = ", ".join(f"({_figure(a)}, {rate!r}, {_figure(phase)})" for a, rate, phase in tones)
        shown.append(f"({shape!r}, {_figure(constant)}, [{sines}])")
    return "[" + ", ".join(shown) + "]"
