"""Margin by which a spur-free force stays above zero, so that the voltage of its square root fits the amplifier.

Where the force F nearly touches zero its root turns sharply. Beside a dip of depth ε and curvature F″ the complex zeros
of F are ``τ = √(2ε/F″)`` off the real time axis, and the root's spectrum falls as exp(−2πf τ). With a margin ``ε = h Σ
A_j (f_j/f_n)²`` over the ON channels, f_n being the coil's highest, τ is at least ``√(2h)/(2πf_n)`` in every state,
since F″ is at most Σ A (2πf)². Low channels have blunt dips and so need little margin. The state with all channels on
and those with each alone are computed; states between have the same bound.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from padgen.physics.crest import least_constant, waveform

__all__ = ["ALIAS_DB", "LEAST_SHARE", "MOST_SHARE", "RootMargin", "root_margin"]

ALIAS_DB = -110.0
"""Largest voltage above the amplifier's band, over the voltage's largest line."""
LEAST_SHARE = 1e-5
"""Smallest margin over a line's amplitude: ten times the error of the least constant."""
MOST_SHARE = 1.0
"""Largest margin that is tried, over the highest line; the constant is then twice that of plain tones."""
SMALLEST = 1e-4
"""Smallest margin that is tried."""
FINER = 4
"""Sampling rate of spectra over the drive's rate; parts above half of it fold back unseen."""
MOST_SAMPLES = 1 << 18
"""Longest period that is transformed whole, in samples at `FINER` times the rate; of a longer one only a piece is."""
PIECE = 1 << 17
"""Samples of the piece of a longer period."""
PER_CYCLE = 16
"""Fewest points per cycle of the highest line in the search for a long period's peak."""
WINDOW = 20.0
"""Kaiser window's β: side lobes below −150 dB."""
ALONE_SAMPLES = (256, 1 << 15)
"""Fewest and most samples of one cycle of a channel that is on alone."""
HALVINGS = 8
"""Bisections of the logarithm of the margin's range, which find it to 4 %."""
PEAKS = 12
"""Margins tried for the voltage limit."""


class RootMargin(NamedTuple):
    """Margins (n,) as shares of each line's amplitude, which are added to the least constant, and their effects.

    With lines of amplitude A (n,), levels included, ``F = least_constant + share @ A + Σ A cos``. `alias_db` is the
    voltage above the amplifier's band (root of the sum of squares) over its largest line, the worst of all channels on
    and each alone. `peak_v` is the largest voltage in V of these states. `constant` is F's constant over Σ A with all
    channels on, which equals the copper loss over that of plain tones.
    """

    share: np.ndarray
    alias_db: float
    peak_v: float
    constant: float


class _Sampled(NamedTuple):
    """A sum of lines in A² at samples, its slope in A²/s, and the window of its spectrum."""

    force: np.ndarray
    slope: np.ndarray
    window: np.ndarray


class _Coil(NamedTuple):
    """A coil's lines (n,), samples of their sum for the spectrum and for the peak, and its amplifier."""

    hz: np.ndarray
    line: np.ndarray
    least: float
    spectrum: _Sampled
    peak: _Sampled
    finer_hz: float
    band_hz: float
    resistance_ohm: float
    inductance_h: float


def root_margin(
    harmonic: np.ndarray,
    line_a2: np.ndarray,
    phase_rad: np.ndarray,
    *,
    period_s: float,
    rate_hz: int,
    resistance_ohm: float,
    inductance_h: float,
    voltage_limit_v: float,
    bandwidth_hz: float | None = None,
) -> RootMargin:
    """Return the smallest margin that keeps `ALIAS_DB`, and the voltage limit if any margin keeps it.

    Lines (n,) are at harmonics of 1/period. The amplifier passes frequencies below half of `rate_hz`, or below
    `bandwidth_hz`. Where no margin up to `MOST_SHARE` keeps `ALIAS_DB` the result is `MOST_SHARE`; where none keeps the
    limit, the one with the lowest peak. Periods of more than `MOST_SAMPLES` are judged by a piece at their deepest dip.
    """
    k, line, phase = np.asarray(harmonic, int), np.asarray(line_a2, float), np.asarray(phase_rad, float)
    if not line.any():
        return RootMargin(np.full(len(k), LEAST_SHARE), -np.inf, 0.0, 0.0)
    finer = round(FINER * rate_hz * period_s)
    whole = finer <= MOST_SAMPLES
    coarse = _one_period(k, line, phase, period_s, finer if whole else 1 << (PER_CYCLE * int(k.max()) - 1).bit_length())
    coil = _Coil(
        k / period_s,
        line,
        float(least_constant(k, line, phase)[0]),
        coarse if whole else _deepest_piece(k, line, phase, period_s, FINER * rate_hz, coarse.force),
        coarse,
        FINER * rate_hz,
        min(rate_hz / 2, bandwidth_hz or np.inf),
        resistance_ohm,
        inductance_h,
    )
    margin = _smallest(lambda h: _together_db(coil, h), _smallest(lambda h: _alone_db(coil, h), SMALLEST))
    margin = _within_limit(coil, margin, voltage_limit_v)
    share = _margin_share(coil, margin)
    alias = max(_alone_db(coil, margin), _together_db(coil, margin))
    return RootMargin(share, alias, _peak_v(coil, margin), float((coil.least + share @ line) / line.sum()))


def _margin_share(coil: _Coil, margin: float) -> np.ndarray:
    """Return the margin (n,) over each line's amplitude: as the squared frequency, at least `LEAST_SHARE`."""
    return np.maximum(margin * (coil.hz / coil.hz.max()) ** 2, LEAST_SHARE)


def _one_period(k: np.ndarray, line: np.ndarray, phase: np.ndarray, period_s: float, points: int) -> _Sampled:
    """Return one period of all lines."""
    omega = 2 * np.pi * k / period_s
    force = waveform(k, line[None], phase, points)[0]
    return _Sampled(force, waveform(k, (omega * line)[None], phase + np.pi / 2, points)[0], np.ones(points))


def _deepest_piece(
    k: np.ndarray, line: np.ndarray, phase: np.ndarray, period_s: float, finer_hz: float, coarse: np.ndarray
) -> _Sampled:
    """Return a piece of a long period at its deepest dip, to stand for the whole."""
    time = int(coarse.argmin()) / len(coarse) * period_s + (np.arange(PIECE) - PIECE // 2) / finer_hz
    force, slope = np.zeros(PIECE), np.zeros(PIECE)
    for omega, a, start in zip(2 * np.pi * k / period_s, line, phase, strict=True):
        angle = omega * time + start
        force += a * np.cos(angle)
        slope -= omega * a * np.sin(angle)
    return _Sampled(force, slope, np.kaiser(PIECE, WINDOW))


def _voltage(coil: _Coil, force: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return the voltage in V of the root of a force above 0: ``R i + L di/dt``, ``di/dt = F'/(2 i)``."""
    current = np.sqrt(force)
    return coil.resistance_ohm * current + coil.inductance_h * slope / (2 * current)


def _together_v(coil: _Coil, seen: _Sampled, margin: float) -> np.ndarray:
    """Return the voltage (samples,) in V with all channels on."""
    return _voltage(coil, coil.least + _margin_share(coil, margin) @ coil.line + seen.force, seen.slope)


def _alone_v(coil: _Coil, margin: float) -> np.ndarray:
    """Return the voltage (n, samples) in V over one cycle of each channel alone."""
    most = int(coil.finer_hz / coil.hz.min())
    fewest, largest = ALONE_SAMPLES
    angle = np.arange(samples := min(max(1 << most.bit_length(), fewest), largest)) * (2 * np.pi / samples)
    force = coil.line[:, None] * ((1 + _margin_share(coil, margin))[:, None] + np.cos(angle))
    return _voltage(coil, force, -np.outer(2 * np.pi * coil.hz * coil.line, np.sin(angle)))


def _together_db(coil: _Coil, margin: float) -> float:
    """Return the voltage above the amplifier's band over its largest line in dB, with all channels on."""
    window = coil.spectrum.window
    energy = np.abs(np.fft.rfft(_together_v(coil, coil.spectrum, margin) * window)) ** 2
    hz = np.arange(len(energy)) * (coil.finer_hz / len(window))
    # The constant's lobe is left out; it ends below half of the lowest line.
    largest = energy[hz > coil.hz.min() / 2].max() / window.sum() ** 2
    return _db(energy[hz > coil.band_hz].sum() / (len(window) * (window**2).sum()) / largest)


def _alone_db(coil: _Coil, margin: float) -> float:
    """Return the largest voltage above the band over its largest line in dB, of each channel alone."""
    energy = np.abs(np.fft.rfft(_alone_v(coil, margin), axis=1)) ** 2
    hz = coil.hz[:, None] * np.arange(energy.shape[1])
    above = np.where(hz > coil.band_hz, energy, 0.0).sum(1)
    largest = energy[:, 1:].max(1)
    return _db(float((above[largest > 0] / largest[largest > 0]).max()))


def _db(energy: float) -> float:
    return float(10 * np.log10(energy)) if energy > 0 else -np.inf


def _peak_v(coil: _Coil, margin: float) -> float:
    """Return the largest voltage in V of all channels on and each alone."""
    seen = (coil.peak,) if coil.peak is coil.spectrum else (coil.peak, coil.spectrum)
    together = max(float(np.abs(_together_v(coil, part, margin)).max()) for part in seen)
    return max(together, float(np.abs(_alone_v(coil, margin)).max()))


def _smallest(above_db: Callable[[float], float], least: float) -> float:
    """Return the smallest margin from `least` to `MOST_SHARE` that keeps `ALIAS_DB`; the largest if none does."""
    if above_db(least) <= ALIAS_DB:
        return least
    low, high = np.log(least), np.log(MOST_SHARE)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if above_db(float(np.exp(middle))) <= ALIAS_DB else (middle, high)
    return float(np.exp(high))


def _within_limit(coil: _Coil, margin: float, limit_v: float) -> float:
    """Return the smallest margin from `margin` on that keeps the voltage limit, or the one of the lowest peak."""
    tried = np.geomspace(margin, MOST_SHARE, PEAKS)
    peaks: list[float] = []
    for one in tried.tolist():
        peaks.append(_peak_v(coil, one))
        if peaks[-1] <= limit_v:
            return float(one)
    return float(tried[int(np.argmin(peaks))])
