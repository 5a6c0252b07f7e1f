"""Currents that shake all taxels of a coil so that their resonances can be measured: a chirp, and noise.

The force goes with i², so the current is made for i²: a chirp ``i = I sin(φ/2)`` gives ``i² = I²/2 (1 − cos φ)``, a
chirp of the force with no harmonics, at twice the current's frequency; noise is the root of a constant and lines on a
comb, as the spur-free drive is. At every frequency the force is so large that a taxel of the plan that resonates there
moves by its ON amplitude: as its root mean square under noise, at most under a chirp.
"""

from collections.abc import Callable

import numpy as np

from padgen.core.errors import SpecError
from padgen.planner.plan import Plan

__all__ = [
    "chirp_current_a",
    "measuring_band_hz",
    "noise_current_a",
    "ring_s",
    "shaking_line_a2",
    "sweep_s",
]

NARROWEST_MARGIN, WIDEST_MARGIN = 2.0, 3.0
"""Factors by which the band reaches beyond the channels at least, and at most, for prints that came out far off."""
SIGMAS = 3.0
SWEEP_WIDTHS, SHORTEST_SWEEP_S = 4.0, 2.0
"""A sweep lasts at least so many over the narrowest bandwidth f/Q, which a spectrum of it then resolves."""
RING_TAUS = 6.0
"""Time constants of silence after the sweep: the slowest taxel is then down to 0.25 %."""
FADE_PERIODS = 4.0
CREST_STEPS = 30
CREST = 1.7
"""What the constant of the noise is aimed at, over the lines' root mean square."""
MARGIN = 0.1
"""Share of the constant that keeps the root off its cusp."""

Line = Callable[[np.ndarray], np.ndarray]
"""Amplitude in A² of the line of i² at frequencies in Hz."""


def measuring_band_hz(plan: Plan) -> tuple[float, float]:
    """Lowest and highest frequency of the motion to measure at: the channels', and a factor on either side."""
    hz = [channel.resonance_hz for channel in plan.channels]
    spread = max(channel.print_spread for channel in plan.channels)
    margin = min(max(NARROWEST_MARGIN, float(np.exp(SIGMAS * spread))), WIDEST_MARGIN)
    return min(hz) / margin, max(hz) * margin


def sweep_s(plan: Plan) -> float:
    """Seconds of a sweep that resolves the slowest taxel's bandwidth."""
    return max(SWEEP_WIDTHS * max(c.q / c.resonance_hz for c in plan.channels), SHORTEST_SWEEP_S)


def ring_s(plan: Plan) -> float:
    """Seconds of silence after a sweep in which the slowest taxel comes to rest."""
    return RING_TAUS / np.pi * max(c.q / c.resonance_hz for c in plan.channels)


def shaking_line_a2(plan: Plan) -> Line:
    """Lines that move a taxel of the plan by its level, straight between the channels on logarithmic axes.

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
    """Current in A and its slope in A/s (n,) of a chirp of the force up `band_hz`, evenly in octaves; then silence.

    It fades in over four periods of the lowest frequency, at most a tenth of its length, and out likewise.
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


def noise_current_a(
    samples: int, rate_hz: float, band_hz: tuple[float, float], line_a2: Line, q: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Current in A and its slope in A/s (samples,) whose square is noise in `band_hz`, from silence to silence.

    Lines on the comb of the record's length, of random phases that are then moved so that the force swings no lower
    than need be (clipping and restoring the lines: Van der Ouderaa et al. 1988); each as strong as a taxel of quality
    `q` asks for.
    """
    frequency = np.fft.rfftfreq(samples, 1 / rate_hz)
    within = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    amplitude = np.zeros(len(frequency))
    # A resonator passes the noise power of π f/(2Q): so many lines of the comb add up to one of its own.
    lines = samples / rate_hz * np.pi * frequency[within] / (2 * q)
    amplitude[within] = line_a2(frequency[within]) / np.sqrt(lines)
    phase = _smooth_phases(amplitude, samples, seed)
    spectrum = amplitude * np.exp(1j * phase) * samples / 2
    swing = np.fft.irfft(spectrum, samples)
    swing_slope = np.fft.irfft(2j * np.pi * frequency * spectrum, samples)
    force = swing - swing.min() * (1 + MARGIN)
    time = np.arange(samples) / rate_hz
    length = samples / rate_hz
    fade_s = min(FADE_PERIODS / band_hz[0], length / 10)
    up, up_slope = _fade(time, fade_s)
    down, down_slope = _fade(length - time, fade_s)
    fade, fade_slope = up * down, up_slope * down - up * down_slope
    current = np.sqrt(force * fade)
    bend = force * fade_slope + swing_slope * fade
    return current, np.divide(bend, 2 * current, out=np.zeros(samples), where=current > 1e-9 * current.max())


def _smooth_phases(amplitude: np.ndarray, samples: int, seed: int) -> np.ndarray:
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(amplitude))
    floor = -CREST * np.sqrt((amplitude**2).sum() / 2)
    best, least = phase, -np.inf
    for _ in range(CREST_STEPS):
        swing = np.fft.irfft(amplitude * np.exp(1j * phase) * samples / 2, samples)
        if swing.min() > least:
            best, least = phase, float(swing.min())
        phase = np.angle(np.fft.rfft(np.maximum(swing, floor)))
    return best


def _fade(time: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """The smooth step from 0 to 1 over `seconds`, and its slope per second."""
    share = np.clip(time / seconds, 0.0, 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2), 30 * share**2 * (1 - share) ** 2 / seconds
