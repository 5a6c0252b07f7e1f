"""One resonance from the record of a free decay (a pluck): least squares of damped sines, and a circle.

The model is a sum of ``Re(C e^{λt})``, ``λ = ω₀ (−1/(2Q) + j √(1 − 1/(4Q²)))``, beside a constant and a drift. The
second method is the circle that the transform of one damped sine is. Noise is taken as white.
"""

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.physics.circle_fit import CircleFit, circle_resonance
from padgen.physics.record_result import (
    LARGEST_Q,
    LEAST_Q,
    MOST_MODES,
    MOST_SAMPLES,
    SAMPLES_PER_PERIOD,
    main_mode,
    poles,
    record_result,
    refuse_noise,
    refuse_record,
    refuse_short,
    structured,
    worth_a_mode,
)
from padgen.physics.resonance_judge import ResonanceFit, refuse_two
from padgen.physics.separable_fit import SeparableFit, separable_fit
from padgen.physics.spectrum_noise import rough_peak

__all__ = ["fit_decay", "rough_decay_hz"]

LONGEST = 1 << 20
"""Samples of a decay that are looked at, before they are thinned."""

LONGEST_DECAY = 8.0
"""Time constants of a decay that are looked at: what follows is noise."""


def fit_decay(rate_hz: float, displacement: np.ndarray, near_hz: float | None = None) -> ResonanceFit:
    """Fit the free decay in `displacement` (n,) after its largest value; `peak` is about its amplitude there.

    Raises
    ------
    SolverError
        No decay, two comparable sines in it (unless `near_hz` tells which one is meant), or too short a record.
    """
    y = np.asarray(displacement, float)
    refuse_record(y)
    first = _largest(y)
    if first > 0.8 * len(y):
        raise SolverError(
            f"is largest {number(first / rate_hz)} s into a record of {number(len(y) / rate_hz)} s: a free decay starts"
            " at its largest; add the excitation as a column if there was one"
        )
    y = y[first : first + LONGEST]
    hz, q = _decay_start(rate_hz, y)
    y, rate = _thinned(y, rate_hz, hz)
    y = y[: max(min(int(LONGEST_DECAY * q / (np.pi * hz) * rate), MOST_SAMPLES), int(10 * rate / hz)) + 1]
    time = np.arange(len(y)) / rate
    refuse_short(time[-1], hz)
    fit = _decay_modes(time, y, hz, q)
    return _decay_result(rate, time, y, fit, near_hz)


def rough_decay_hz(rate_hz: float, displacement: np.ndarray) -> float:
    """The largest line of what follows the largest value: a first look."""
    y = displacement[_largest(displacement) :][:LONGEST]
    size = np.abs(np.fft.rfft(y - y.mean(dtype=float)))
    return float(np.fft.rfftfreq(len(y), 1 / rate_hz)[int(size.argmax())])


def _largest(y: np.ndarray) -> int:
    """Where a signal is farthest from its mean."""
    middle = y.mean(dtype=float)
    return max(int(y.argmax()), int(y.argmin()), key=lambda k: abs(float(y[k]) - middle))


def _decay_modes(time: np.ndarray, y: np.ndarray, hz: float, q: float) -> SeparableFit:
    """Damped sines, one after the other as long as one is worth its numbers."""
    fit = _decay_fit(time, y, np.log([hz, q]))
    rate = 1 / time[1]
    for _ in range(MOST_MODES - 1):
        if fit.noise < 1e-9 * np.abs(y).max() or len(y) < 40 or not structured(fit):
            break
        start = np.log(_decay_start(rate, fit.residual))
        more = _decay_fit(time, y, np.concatenate([fit.theta, start]))
        if not worth_a_mode(more, fit, time[-1]):
            break
        fit = more
    return fit


def _decay_fit(time: np.ndarray, y: np.ndarray, start: np.ndarray) -> SeparableFit:
    low = np.tile(np.log([0.2 / time[-1], LEAST_Q]), len(start) // 2)
    high = np.tile(np.log([0.5 / time[1], LARGEST_Q]), len(start) // 2)
    return separable_fit(lambda theta: _decay_basis(time, theta), y, start, low, high)


def _decay_basis(time: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pole, bend = poles(theta)
    count = len(pole)
    wave = np.exp(time[:, None] * pole)
    flat = np.stack([np.ones(len(time)), time / time[-1] - 0.5], axis=1)
    slopes = np.zeros((2 * count, len(time), 2 * count + 2))
    for k in range(count):
        for n, slope in enumerate((pole[k], bend[k])):
            moved = slope * time * wave[:, k]
            slopes[2 * k + n, :, k], slopes[2 * k + n, :, count + k] = moved.real, moved.imag
    return np.concatenate([wave.real, wave.imag, flat], axis=1), slopes


def _decay_start(rate: float, y: np.ndarray) -> tuple[float, float]:
    """The largest line of a decay, and the Q of those tried that leaves least."""
    time = np.arange(len(y)) / rate
    flat = np.polynomial.polynomial.polyfit(time, y, 1)
    level = y - np.polynomial.polynomial.polyval(time, flat)
    size = np.abs(np.fft.rfft(level, 4 * len(y)))
    frequency = np.fft.rfftfreq(4 * len(y), 1 / rate)
    hz, _ = rough_peak(frequency[4:], size[4:])
    y, rate = _thinned(level, rate, hz)
    time = np.arange(len(y)) / rate
    tried = np.geomspace(1.0, max(20 * hz * time[-1], 2.0), 14)
    left = []
    for q in tried:
        basis, _ = _decay_basis(time, np.log([hz, q]))
        left.append(float(np.linalg.norm(y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0])))
    return hz, float(tried[int(np.argmin(left))])


def _thinned(y: np.ndarray, rate: float, hz: float) -> tuple[np.ndarray, float]:
    """Means of so many samples that a period keeps enough: a damped sine stays one, of the same pole."""
    many = max(int(rate / (SAMPLES_PER_PERIOD * hz)), 1)
    whole = len(y) // many * many
    return (y[:whole].reshape(-1, many).mean(1), rate / many) if many > 1 else (y, rate)


def _decay_result(
    rate: float, time: np.ndarray, y: np.ndarray, fit: SeparableFit, near_hz: float | None
) -> ResonanceFit:
    count = len(fit.theta) // 2
    hz, q = np.exp(fit.theta[::2]), np.exp(fit.theta[1::2])
    peak = np.hypot(fit.coefficients[:count], fit.coefficients[count : 2 * count])
    main = main_mode(hz, peak, near_hz)
    plain = float(np.sum((y - np.mean(y)) ** 2))
    gain = (plain - float(fit.residual @ fit.residual)) / max(fit.noise**2, np.finfo(float).tiny)
    refuse_noise(float(peak[main]), fit.noise, gain, "free decay")
    others = tuple((float(hz[k]), float(peak[k])) for k in range(count) if k != main)
    if near_hz is None:
        refuse_two(float(hz[main]), float(peak[main]), others)
    basis, _ = _decay_basis(time, fit.theta)
    own = np.array([main, count + main])
    alone = fit.residual + basis[:, own] @ fit.coefficients[own]
    circle = _decay_circle(rate, alone, float(hz[main]), float(q[main]))
    pair = 2 * count + own
    along = fit.coefficients[own] / peak[main]
    variance = float(along @ fit.covariance[np.ix_(pair, pair)] @ along)
    return record_result(fit, main, float(peak[main]), np.sqrt(variance), circle, others)


def _decay_circle(rate: float, y: np.ndarray, hz: float, q: float) -> CircleFit | None:
    """The circle of a decay's transform; a decay that outlasts the record is damped by a window, and that taken off."""
    seconds, own = len(y) / rate, np.pi * hz / q
    window = max(2 * np.pi / seconds - own, 0.0)
    data = np.fft.rfft(y * np.exp(-window * np.arange(len(y)) / rate))
    frequency = np.fft.rfftfreq(len(y), 1 / rate)
    damped = hz * np.sqrt(1 - 1 / (4 * q * q))
    found = circle_resonance(frequency[1:], data[1:], damped, np.pi * damped / (own + window), decay=True)
    if found is None:
        return None
    rest = np.pi * found.resonance_hz / found.q - window
    if rest <= 0:
        return None
    quality = np.pi * found.resonance_hz / rest
    # Under the window's e^{-w t/T} the noise of neighbouring lines is alike: their correlations add up to w coth w.
    damped_by = window * seconds
    wider = float(np.sqrt(damped_by / np.tanh(damped_by))) if damped_by > 0 else 1.0
    error = wider * found.q_error * (quality / found.q) ** 2
    natural = found.resonance_hz / np.sqrt(max(1 - 1 / (4 * quality**2), 0.1))
    return CircleFit(float(natural), wider * found.resonance_error_hz, float(quality), float(error), found.points)
