"""Coil currents that excite taxels to be measured: chirps and noise, faded in and out, as strong as ON tones.

The force on steel goes with i², so the current is designed by i². A chirp ``i = I sin(φ/2)`` gives ``i² = I²/2 (1 − cos
φ)``: a chirp of the force without harmonics, at twice the current's frequency. Noise is the root of a constant and
lines on a comb, as in the spur-free drive. The force at each frequency would move a taxel of the plan that resonates
there as its ON tone does: with the same root mean square under noise, with at most the same amplitude under a chirp.
The force on a magnet goes with the current, which is then the chirp or the noise itself.
"""

from collections.abc import Callable

import numpy as np

from padgen.core.errors import SpecError
from padgen.physics.selectivity import SQUARE
from padgen.planner.plan import Plan

__all__ = ["chirp_current_a", "measuring_band_hz", "noise_current_a", "ring_s", "shaking_line_a2", "sweep_s"]

NARROWEST_MARGIN = 2.0
WIDEST_MARGIN = 3.0
"""Least and largest factor by which the band reaches beyond the channels, for prints that came out far off."""
SIGMAS = 3.0
SWEEP_WIDTHS = 4.0
SHORTEST_SWEEP_S = 2.0
"""Least length of a sweep, over the inverse of the narrowest bandwidth f/Q (which it then resolves), and in s."""
RING_TAUS = 6.0
"""Time constants of silence after the sweep: the slowest taxel is then down to 0.25 %."""
FADE_PERIODS = 4.0
CREST_STEPS = 30
CREST = 1.7
"""Goal for the constant of the noise's i², over the root mean square of its lines."""
MARGIN = 0.1
"""Share of the constant that is added so that i² stays above 0, where the slope of its root diverges."""

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
    """Return a function of frequency in Hz: the amplitude in A² of i² that moves a taxel resonant there by its level.

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
        raise SpecError(f"no {plan.spec.mover.kind} is pulled by its coil, so that nothing can be measured", plan.name)
    log_hz = np.log(hz[order])
    log_line = np.log(line[order])

    def line_a2(frequency_hz: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(np.interp(np.log(frequency_hz), log_hz, log_line)))

    return line_a2


def chirp_current_a(
    time_s: np.ndarray, seconds: float, band_hz: tuple[float, float], line_a2: Line, force_order: int = SQUARE
) -> tuple[np.ndarray, np.ndarray]:
    """Return the current in A and its slope in A/s, both (n,), that make the force a chirp rising through `band_hz`.

    Where the force goes with the current itself (`force_order` 1), the current is at its frequency, not at half of it.

    It spends equal times in equal octaves and ends after `seconds`; then there is silence. It fades in over four
    periods of the lowest frequency, and out over four of the highest, each at most a tenth of its length.
    """
    low, high = band_hz
    rate = np.log(high / low) / seconds
    inside = (time_s >= 0) & (time_s <= seconds)
    time = np.where(inside, time_s, 0.0)
    frequency = low * np.exp(rate * time)
    phase = 2 * np.pi * low / rate * np.expm1(rate * time) / force_order
    amplitude = line_a2(frequency) if force_order == 1 else np.sqrt(2 * line_a2(frequency))
    step = 1e-4
    steepness = (np.log(line_a2(frequency * (1 + step))) - np.log(line_a2(frequency * (1 - step)))) / (2 * step)
    bend = steepness / force_order * rate
    fade, fade_slope = _fade(time, seconds, low, high)
    sine = np.sin(phase)
    cosine = np.cos(phase)
    slope = (fade_slope + fade * bend) * sine + fade * cosine * 2 * np.pi * frequency / force_order
    return np.where(inside, amplitude * fade * sine, 0.0), np.where(inside, amplitude * slope, 0.0)


def noise_current_a(
    samples: int,
    rate_hz: float,
    band_hz: tuple[float, float],
    line_a2: Line,
    q: float,
    seed: int,
    force_order: int = SQUARE,
) -> tuple[np.ndarray, np.ndarray]:
    """Return a current in A and its slope in A/s, both (samples,), whose square is noise in `band_hz`.

    Where the force goes with the current itself (`force_order` 1), the current is that noise.

    It begins and ends in silence. The lines lie on the comb of the record's length and have random phases, which are
    then moved so that i² needs a small constant (by clipping and restoring the lines: Van der Ouderaa et al. 1988).
    Together they move a taxel of quality factor `q` with the root mean square of its ON motion.
    """
    frequency = np.fft.rfftfreq(samples, 1 / rate_hz)
    within = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    amplitude = np.zeros(len(frequency))
    # A resonator passes the noise power of a bandwidth π f/(2Q): the lines of the comb in it act as one of its own.
    lines = samples / rate_hz * np.pi * frequency[within] / (2 * q)
    amplitude[within] = line_a2(frequency[within]) / np.sqrt(lines)
    phase = _smooth_phases(amplitude, samples, seed)
    spectrum = amplitude * np.exp(1j * phase) * samples / 2
    swing = np.fft.irfft(spectrum, samples)
    swing_slope = np.fft.irfft(2j * np.pi * frequency * spectrum, samples)
    force = swing - swing.min() * (1 + MARGIN)
    fade, fade_slope = _fade(np.arange(samples) / rate_hz, samples / rate_hz, band_hz[0], band_hz[0])
    if force_order == 1:
        return swing * fade, swing * fade_slope + swing_slope * fade
    current = np.sqrt(force * fade)
    bend = force * fade_slope + swing_slope * fade
    return current, np.divide(bend, 2 * current, out=np.zeros(samples), where=current > 1e-9 * current.max())


def _smooth_phases(amplitude: np.ndarray, samples: int, seed: int) -> np.ndarray:
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(amplitude))
    floor = -CREST * np.sqrt((amplitude**2).sum() / 2)
    best = phase
    least = -np.inf
    for _ in range(CREST_STEPS):
        swing = np.fft.irfft(amplitude * np.exp(1j * phase) * samples / 2, samples)
        if swing.min() > least:
            best = phase
            least = float(swing.min())
        phase = np.angle(np.fft.rfft(np.maximum(swing, floor)))
    return best


def _fade(time: np.ndarray, seconds: float, first_hz: float, last_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a factor that rises smoothly from 0 to 1 and back to 0 after `seconds`, and its slope per second.

    It rises in `FADE_PERIODS` of `first_hz` and falls in as many of `last_hz`, at most in a tenth of the time each.
    """
    long = np.array([[FADE_PERIODS / first_hz], [FADE_PERIODS / last_hz]]).clip(max=seconds / 10)
    share = np.clip(np.stack([time, seconds - time]) / long, 0.0, 1.0)
    up, down = share**3 * (10 - 15 * share + 6 * share**2)
    up_slope, down_slope = 30 * share**2 * (1 - share) ** 2 / long
    return up * down, up_slope * down - up * down_slope
