"""Excitation files: what the coils play while the taxels' resonances are measured.

A chirp, followed by the silence in which the slowest taxel comes to rest; each coil in turn, or all at once. The force
goes with i², so the current is designed by i²: ``i = I sin(φ/2)`` gives ``i² = I²/2 (1 − cos φ)``, a chirp of the force
without harmonics, at twice the current's frequency. The force at each frequency would move a taxel of the plan that
resonates there by its ON amplitude at most. The volts are those that drive the current through the coil's resistance
and inductance, ``R i + L di/dt``. Levels are those of the plan, or as much lower as amplifier, copper and the mean pull
of all channels together ask for."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil

import numpy as np

from padgen.core.errors import SpecError, at_least, number
from padgen.core.units import MH
from padgen.physics.schemes import mean_square_a2
from padgen.planner.plan import Plan

__all__ = [
    "Excitation",
    "SweepTable",
    "chirp_current_a",
    "excitation",
    "measuring_band_hz",
    "ring_s",
    "shaking_line_a2",
    "sweep_s",
    "sweep_table",
]

VOLTAGE_SHARE = 0.9
"""Share of the amplifier's voltage that the largest peak takes."""
SAMPLES_OF_HIGHEST = 4
MOST_SAMPLES = 1 << 25
"""Samples of one coil's turn that are held in memory."""
BLOCK_SAMPLES = 1 << 16
NARROWEST_MARGIN, WIDEST_MARGIN = 2.0, 3.0
"""Least and largest factor by which the band reaches beyond the channels, for prints that came out far off."""
SIGMAS = 3.0
SWEEP_WIDTHS, SHORTEST_SWEEP_S = 4.0, 2.0
"""Least length of a sweep, over the inverse of the narrowest bandwidth f/Q (which it then resolves), and in s."""
RING_TAUS = 6.0
"""Time constants of silence after the sweep: the slowest taxel is then down to 0.25 %."""
FADE_PERIODS = 4.0

Line = Callable[[np.ndarray], np.ndarray]
"""Function of frequencies in Hz: the amplitude in A² of the line of i² there."""


def measuring_band_hz(plan: Plan) -> tuple[float, float]:
    """Return the lowest and the highest frequency in Hz of the motion to measure: the channels' and a margin."""
    hz = [channel.resonance_hz for channel in plan.channels]
    spread = max(channel.print_spread for channel in plan.channels)
    margin = min(max(NARROWEST_MARGIN, float(np.exp(SIGMAS * spread))), WIDEST_MARGIN)
    return min(hz) / margin, max(hz) * margin


def sweep_s(plan: Plan) -> float:
    """Return the length in s of a sweep that resolves the narrowest bandwidth of the plan's channels."""
    return max(SWEEP_WIDTHS * max(c.q / c.resonance_hz for c in plan.channels), SHORTEST_SWEEP_S)


def ring_s(plan: Plan) -> float:
    """Return the seconds of silence after a sweep in which the slowest taxel comes to rest."""
    return RING_TAUS / np.pi * max(c.q / c.resonance_hz for c in plan.channels)


def shaking_line_a2(plan: Plan) -> Line:
    """Return the function that gives the line of i² that would move a taxel of the plan by its level.

    It is exact at the channels' resonances, and straight between them on logarithmic axes.

    Raises
    ------
    SpecError
        The coils pull no washer.
    """
    line = np.array([c.line_a2 for c in plan.channels])
    hz = np.array([channel.resonance_hz for channel in plan.channels])
    order = np.argsort(hz)
    order = order[line[order] > 0]
    if not len(order):
        raise SpecError("no washer is pulled by its coil, so that nothing can be measured", plan.name)
    log_hz, log_line = np.log(hz[order]), np.log(line[order])

    def line_a2(frequency_hz: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(np.interp(np.log(frequency_hz), log_hz, log_line)))

    return line_a2


def chirp_current_a(
    time_s: np.ndarray, seconds: float, band_hz: tuple[float, float], line_a2: Line
) -> tuple[np.ndarray, np.ndarray]:
    """Return the current in A and its slope in A/s, both (n,), of a chirp of the force up through `band_hz`.

    It spends equal times in equal octaves and ends after `seconds`; then there is silence. It fades in over four
    periods of the lowest frequency, and out over four of the highest, each at most a tenth of its length.
    """
    low, high = band_hz
    rate = np.log(high / low) / seconds
    inside = (time_s >= 0) & (time_s <= seconds)
    time = np.where(inside, time_s, 0.0)
    frequency = low * np.exp(rate * time)
    half_phase = np.pi * low / rate * np.expm1(rate * time)
    amplitude = np.sqrt(2 * line_a2(frequency))
    step = 1e-4
    bend = (np.log(line_a2(frequency * (1 + step))) - np.log(line_a2(frequency * (1 - step)))) / (4 * step) * rate
    up, up_slope = _fade(time, min(FADE_PERIODS / low, seconds / 10))
    down, down_slope = _fade(seconds - time, min(FADE_PERIODS / high, seconds / 10))
    fade, fade_slope = up * down, up_slope * down - up * down_slope
    sine, cosine = np.sin(half_phase), np.cos(half_phase)
    slope = (fade_slope + fade * bend) * sine + fade * cosine * np.pi * frequency
    return np.where(inside, amplitude * fade * sine, 0.0), np.where(inside, amplitude * slope, 0.0)


def _fade(time: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a smooth step from 0 to 1 over `seconds`, and its slope per second."""
    share = np.clip(time / seconds, 0.0, 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2), 30 * share**2 * (1 - share) ** 2 / seconds


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """The current and voltage that the coils play while taxels are measured, and how strong they are.

    `current_a`, `voltage_v` (samples,) are of one coil's turn; `coils` (row, column) in the order of the columns of
    `blocks`. `level_share` is how strongly taxels are shaken over their planned levels; `copper_loss_w` the mean of a
    turn.
    """

    rate_hz: int
    band_hz: tuple[float, float]
    sweep_s: float
    together: bool
    coils: tuple[tuple[int, int], ...]
    current_a: np.ndarray
    voltage_v: np.ndarray
    level_share: float
    copper_loss_w: float

    @property
    def samples(self) -> int:
        """Samples of the whole: of one turn, or of one turn for each coil."""
        return len(self.current_a) * (1 if self.together else len(self.coils))

    @property
    def seconds(self) -> float:
        """Length of the whole."""
        return self.samples / self.rate_hz

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield blocks (samples, coils) of the whole, in V."""
        for k in range(1 if self.together else len(self.coils)):
            for start in range(0, len(self.voltage_v), BLOCK_SAMPLES):
                part = self.voltage_v[start : start + BLOCK_SAMPLES]
                block = np.zeros((len(part), len(self.coils)))
                block[:, slice(None) if self.together else slice(k, k + 1)] = part[:, None]
                yield block


def excitation(plan: Plan, rate_hz: int, seconds: float | None = None, together: bool = False) -> Excitation:
    """Make the excitation that measures `plan`'s pad, sampled at `rate_hz`.

    `seconds` is the length of the chirp (None: as long as the slowest taxel asks for), to which the silence is added.
    `together` shakes all coils at once: quicker, and each taxel then hears its neighbours' coils too.

    Raises
    ------
    SpecError
        A rate too low for the highest frequency; a length too short for the slowest taxel, or too long for memory; no
        washer that is pulled.
    """
    amplifier, band = plan.spec.amplifier, measuring_band_hz(plan)
    least = SAMPLES_OF_HIGHEST * band[1]
    if not rate_hz >= least:
        raise SpecError(
            f"must be at least {number(float(np.ceil(least)))} Hz, {SAMPLES_OF_HIGHEST} times the highest frequency"
            f" that is measured, got {number(rate_hz)} Hz",
            "--rate",
        )
    sweep = sweep_s(plan) if seconds is None else seconds
    shortest = max(c.q / c.resonance_hz for c in plan.channels)
    if not sweep >= shortest:
        raise SpecError(
            f"must be at least {at_least(shortest)} s, Q periods of the slowest taxel, got {number(sweep)} s",
            "--seconds",
        )
    if (sweep + ring_s(plan)) * rate_hz > MOST_SAMPLES:
        longest = MOST_SAMPLES / rate_hz - ring_s(plan)
        would_do = f"at most {number(longest)} s would do" if longest > shortest else "a lower --rate would do"
        raise SpecError(
            f"{number(sweep)} s of sweep are too many samples at {number(rate_hz)} Hz; {would_do}", "--seconds"
        )
    line, swept, total = shaking_line_a2(plan), round(sweep * rate_hz), round((sweep + ring_s(plan)) * rate_hz)
    current, slope = chirp_current_a(np.arange(total) / rate_hz, swept / rate_hz, band, line)
    coil = plan.spec.coil
    volts = coil.resistance_ohm * current + coil.inductance_mh * MH * slope
    square, headroom = float((current[:swept] ** 2).mean()), plan.spec.drive.headroom
    planned = max(mean_square_a2(plan.scheme, np.array([c.line_a2 for c in own]), headroom) for own in plan.sets)
    share = min(
        1.0,
        (VOLTAGE_SHARE * plan.spec.drive.voltage_limit_v / float(np.abs(volts).max())) ** 2,
        coil.power_limit_w / (square * coil.resistance_ohm),
        (VOLTAGE_SHARE * amplifier.current_a / float(np.abs(current).max())) ** 2 if amplifier else 1.0,
        max(planned / square, 1e-6),
    )
    factor = share**0.5
    places = tuple((row, column) for row in range(plan.coils.rows) for column in range(plan.coils.columns))
    loss_w = share * square * swept / total * coil.resistance_ohm
    return Excitation(rate_hz, band, swept / rate_hz, together, places, current * factor, volts * factor, share, loss_w)


SWEEP_ROWS, SHORTEST_S = 65, 0.1
"""Rows of the firmware's table, and the length in s of a silent sweep."""


@dataclass(frozen=True, slots=True, eq=False)
class SweepTable:
    """A sweep as the firmware plays it: frequency `hz` and amplitude `volts` of the voltage, in even steps of time."""

    seconds: float
    hz: np.ndarray
    volts: np.ndarray

    def voltage_v(self, rate_hz: float) -> np.ndarray:
        """Return the voltage (n,), straight between the rows in frequency and amplitude."""
        at = np.arange(ceil(self.seconds * rate_hz)) / (self.seconds * rate_hz) * (len(self.hz) - 1)
        rows = np.arange(len(self.hz))
        hz = np.interp(at, rows, self.hz)
        turns = (np.cumsum(hz) - hz) / rate_hz
        return np.asarray(np.interp(at, rows, self.volts) * np.sin(2 * np.pi * turns))


def sweep_table(plan: Plan) -> SweepTable:
    """Return the sweep by which the firmware measures one coil's taxels, as strong as the chirp.

    It is silent where nothing can be measured.
    """
    low, high = measuring_band_hz(plan)
    try:
        share = excitation(plan, ceil(SAMPLES_OF_HIGHEST * high)).level_share
        hz = np.geomspace(low, high, SWEEP_ROWS)
        line = share * shaking_line_a2(plan)(hz)
    except SpecError:
        return SweepTable(SHORTEST_S, np.zeros(2), np.zeros(2))
    coil = plan.spec.coil
    ohms = np.hypot(coil.resistance_ohm, np.pi * hz * coil.inductance_mh * MH)
    fade = np.clip(np.minimum(np.arange(SWEEP_ROWS), np.arange(SWEEP_ROWS)[::-1]) / 4, 0, 1)
    return SweepTable(sweep_s(plan), hz / 2, ohms * np.sqrt(2 * line) * fade)
