"""Phases that minimise the constant part of a spur-free force, its margin above zero, and the period of a looped drive.

The force is ``F₀ + Σ A_j cos(2π k_j t/T + φ_j)`` and may not be negative. F₀ is therefore at least the depth of the
sum's deepest dip, and copper loss and mean pull are proportional to F₀. Everything is over one period T, at the angle x
= 2πt/T, with whole harmonics k_j. Frequencies that are whole multiples of 1/T form a comb: their sum repeats and can be
looped.

The force stays above zero by a margin, so that the voltage of its square root, the current, fits the amplifier. Where
the force F nearly touches zero its root turns sharply. Beside a dip of depth ε and curvature F″ the complex zeros of F
are ``τ = √(2ε/F″)`` off the real time axis, and the root's spectrum falls as exp(−2πf τ). With a margin ``ε = h Σ A_j
(f_j/f_n)²`` over the ON channels, f_n being the coil's highest, τ is at least ``√(2h)/(2πf_n)`` in every state, since
F″ is at most Σ A (2πf)². Low channels have blunt dips and so need little margin. The state with all channels on and
those with each alone are computed; states between have the same bound.
"""

from collections.abc import Callable
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

__all__ = [
    "ALIAS_DB",
    "EXACT",
    "LEAST_SHARE",
    "LONGEST_S",
    "MOST_OFF",
    "MOST_SHARE",
    "SHORTEST_S",
    "RootMargin",
    "comb_period_s",
    "least_constant",
    "low_crest_phases",
    "off_resonance",
    "on_comb",
    "root_margin",
    "schroeder_phases",
    "waveform",
]

EXACT = 1e-6
"""Proven error of `least_constant`, over Σ A."""
PER_CYCLE = 8
"""Fewest points of a grid in one cycle of the highest line."""
BLOCK = 1 << 19
"""Points of waveforms computed at a time."""
DRAWS = 1024
"""Random sets of phases that are tried as starts."""
STARTS = 16
"""Largest number of starts."""
SAMPLES = 4096
"""Most angles at which random phases are compared, so as to choose the starts."""
FIRST_STEPS = 4
LAST_STEPS = 25
BEST = 3
"""Linear programs from every start, then more from the BEST starts."""
WITHIN = 0.1
MOST_DIPS = 200
"""Dips that a linear program includes: within this share of Σ A of the deepest, and at most MOST_DIPS."""
TRUST = 0.1
"""First trust region in rad."""
SETTLED = 1e-4
"""Stop when a linear program predicts a decrease of less than this, over Σ A."""
LONG = 1 << 17
FEWEST = 3
"""Most points of the grids of all starts together, and fewest starts. On a long comb phases gain little, so it gets
few.
"""


def schroeder_phases(amplitude: np.ndarray) -> np.ndarray:
    """Return phases (n,) in rad with which spectral lines in rising order add up to a sweep through their frequencies.

    The sweep gives each line time by its share of the power. ``φ_j = −2π Σ_{l<j} (j − l) p_l`` with the shares p:
    Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85.
    """
    power = np.asarray(amplitude, float) ** 2
    before = np.concatenate([[0.0], np.cumsum(power / power.sum())[:-1]])
    return -2 * np.pi * np.cumsum(before)


def low_crest_phases(harmonic: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """Search for phases φ (n,) in rad, in 0 … 2π, with which ``Σ A_j cos(k_j x + φ_j)`` dips least below zero.

    Exact for two lines; otherwise the best of a few descents, a local optimum that is the same each time. `amplitude`
    (n,) is at least 0, in any unit. Lines of one harmonic get one phase.
    """
    k = np.asarray(harmonic, int)
    a = np.asarray(amplitude, float)
    phase = np.zeros(len(k))
    played = a > 0
    if not played.any():
        return phase
    distinct, place = np.unique(k[played], return_inverse=True)
    total = np.bincount(place, a[played])
    shape = np.round(total / total.max(), 12)
    reduced = distinct // np.gcd.reduce(distinct)
    phase[played] = np.array(_phases(tuple(reduced.tolist()), tuple(shape.tolist())))[place]
    return phase


def least_constant(harmonic: np.ndarray, amplitude: np.ndarray, phase: np.ndarray) -> np.ndarray:
    """Return the least F₀ (s,) that keeps ``F₀ + Σ_j A_sj cos(k_j x + φ_j)`` from being negative, A = `amplitude`.

    Amplitudes have any signs. F₀ is 0 for a silent state; otherwise at most rounding above the true value and at most
    `EXACT` Σ A below it. A grid comes first; then each of its pieces in which a Taylor bound allows a deeper dip is
    divided, until no piece is left.
    """
    k = np.asarray(harmonic, int)
    a = np.atleast_2d(np.asarray(amplitude, float))
    result = np.zeros(len(a))
    heard = np.flatnonzero(a.any(axis=1))
    if heard.size == 0:
        return result
    k = k // np.gcd.reduce(k)
    points = _grid_size(k)
    rows = max(BLOCK // points, 1)
    for start in range(0, len(heard), rows):
        part = heard[start : start + rows]
        result[part] = _depths(k, a[part], np.asarray(phase, float), points)
    return result


def waveform(harmonic: np.ndarray, amplitude: np.ndarray, phase: np.ndarray, points: int) -> np.ndarray:
    """Return ``Σ_j A_sj cos(k_j x + φ_j)`` (s, points) at x = 2π p/points, for amplitudes (s, n).

    The harmonics must be below half of `points`.
    """
    lines = np.asarray(amplitude) * np.exp(1j * np.asarray(phase)) / 2
    spectrum = np.zeros((len(lines), points // 2 + 1), complex)
    for j, k in enumerate(harmonic):
        spectrum[:, k] += lines[:, j]
    return np.fft.irfft(spectrum, points, axis=1, norm="forward")


def _grid_size(harmonic: np.ndarray, per_cycle: int = PER_CYCLE) -> int:
    """Return the number of grid points, a power of two: at least `per_cycle` in a cycle of the highest line."""
    return 1 << (per_cycle * int(harmonic.max()) - 1).bit_length()


def _depths(harmonic: np.ndarray, amplitude: np.ndarray, phase: np.ndarray, points: int) -> np.ndarray:
    """Return for each state (s,) how far its waveform dips below zero, found by refining a grid of `points`."""
    wave = waveform(harmonic, amplitude, phase, points)
    size = np.abs(amplitude)
    total = size.sum(1)
    bend = size @ harmonic**2.0
    twist = size @ harmonic**3.0
    lowest = wave.min(1)
    half = np.pi / points
    # The slope is 0 at the deepest dip, and a grid point lies within half a step of it.
    state, point = np.nonzero(wave <= (lowest + bend * half**2 / 2)[:, None])
    angle = point * (2 * half)
    while state.size:
        line = np.outer(angle, harmonic) + phase
        cosine = amplitude[state] * np.cos(line)
        sine = amplitude[state] * np.sin(line)
        value = cosine.sum(1)
        slope = -(sine @ harmonic)
        curve = -(cosine @ harmonic**2.0)
        move, below = _least_of_parabola(slope, curve, half)
        tried = (amplitude[state] * np.cos(line + np.outer(move, harmonic))).sum(1)
        np.minimum.at(lowest, state, np.minimum(value, tried))
        bound = value + np.maximum(
            below - twist[state] * half**3 / 6, -np.abs(slope) * half - bend[state] * half**2 / 2
        )
        open_ = bound < lowest[state] - EXACT * total[state]
        half /= 4
        state = np.repeat(state[open_], 4)
        angle = (angle[open_, None] + half * np.array([-3.0, -1.0, 1.0, 3.0])).ravel()
    return np.maximum(-lowest, 0.0)


def _least_of_parabola(slope: np.ndarray, curve: np.ndarray, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the d in ±half at which ``slope d + curve d²/2`` is least, and the value there."""
    edge = -np.copysign(half, slope)
    inside = (curve > 0) & (np.abs(slope) < curve * half)
    move = np.where(inside, -slope / np.where(inside, curve, 1.0), edge)
    return move, slope * move + curve * move**2 / 2


@lru_cache(maxsize=4096)
def _phases(harmonic: tuple[int, ...], amplitude: tuple[float, ...]) -> tuple[float, ...]:
    """Return `low_crest_phases` of rising harmonics without a common divisor; the first phase is 0."""
    if len(harmonic) == 1:
        return (0.0,)
    if len(harmonic) == 2:
        # The two angles run along lines of offset k₂θ₁ − k₁θ₂ in the plane, 2π apart. The dips lie near (π, π), and the
        # best offset, for any amplitudes, is π away from that point: phase 0, and π if both harmonics are odd.
        return 0.0, float(np.pi) if harmonic[0] % 2 and harmonic[1] % 2 else 0.0
    k = np.array(harmonic)
    a = np.array(amplitude) / sum(amplitude)
    # The first phase stays 0, since a shift in time changes nothing.
    free = np.append(0.0, np.full(len(k) - 1, np.inf))

    def improved(at: _Descent, steps: int) -> _Descent:
        return _descend(lambda phase: _dips(k, a, phase), at, -free, free, steps, SETTLED)

    # The starts are Schroeder's phases and the best random ones.
    points = _grid_size(k)
    random = np.random.default_rng(0)
    draws = np.concatenate([schroeder_phases(a)[None], random.uniform(0, 2 * np.pi, (DRAWS, len(k)))])
    draws[:, 0] = 0.0
    where = np.arange(points) if points <= SAMPLES else np.sort(random.choice(points, SAMPLES, replace=False))
    angle = np.outer(where * (2 * np.pi / points), k)
    depth = -(np.hstack([np.cos(angle), np.sin(angle)]) @ np.hstack([a * np.cos(draws), -a * np.sin(draws)]).T).min(0)
    depth[0] = 0.0  # Schroeder's phases always rank first.
    few = min(STARTS, 2 * (len(k) - 1), max(LONG // (2 * points), FEWEST))
    begun = [improved(_Descent(draws[at], np.inf, TRUST), FIRST_STEPS) for at in np.argsort(depth, kind="stable")[:few]]
    begun.sort(key=lambda descent: descent.largest)
    best = min((improved(descent, LAST_STEPS) for descent in begun[:BEST]), key=lambda descent: descent.largest).place
    # Later digits may differ between machines, and have no effect on the depth.
    return tuple(np.round(best % (2 * np.pi), 6).tolist())


_Lines = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""A function of a place (n,): values (m,) and their slopes (m, n); m may differ from place to place."""


class _Descent(NamedTuple):
    """State of a descent: a place (n,), the largest value there, and the half width of the trust region."""

    place: np.ndarray
    largest: float
    reach: float


def _descend(
    lines: _Lines,
    at: _Descent,
    low: np.ndarray,
    high: np.ndarray,
    programs: int,
    settled: float,
) -> _Descent:
    """Minimise the largest value of `lines` within `low` and `high` (n,) by up to `programs` linear programs.

    It ends when a program predicts a decrease of less than `settled`. The trust region is a box (Madsen, J. Inst. Maths
    Applics 16 (1975) 321).
    """
    from scipy.optimize import linprog

    here = at.place
    reach = at.reach
    values, slope = lines(here)
    for _ in range(programs):
        # The step within the reach that most lowers the linearised largest value. Only values that could become the
        # largest, in units of the reach, so that the program is scaled alike each time.
        swing = reach * np.abs(slope).sum(1)
        near = values + swing >= (values - swing).max()
        matrix = np.hstack([slope[near] * reach, -np.ones((near.sum(), 1))])
        limit = values.max() - values[near]
        lower = np.maximum(-1, (low - here) / reach)
        upper = np.minimum(1, (high - here) / reach)
        bounds = np.column_stack([np.append(lower, -np.inf), np.append(upper, 0.0)])
        best = linprog(np.append(np.zeros(len(here)), 1.0), A_ub=matrix, b_ub=limit, bounds=bounds, method="highs").x
        if best is None or -best[-1] < settled:
            break
        there = np.clip(here + best[:-1] * reach, low, high)
        trial = lines(there)
        kept = (values.max() - trial[0].max()) / -best[-1]
        if kept > 0:
            here = there
            values, slope = trial
        if kept > 0.75:
            reach *= 2
        elif not kept > 0.25:  # nor where the step predicts no gain, and the ratio is no number
            reach *= 0.3
    return _Descent(here, float(values.max()), reach)


def _dips(harmonic: np.ndarray, amplitude: np.ndarray, phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return depths (m,) of the sum's deep dips, deepest on the grid first, and their slopes (m, n) by the phases."""
    points = _grid_size(harmonic)
    wave = waveform(harmonic, amplitude[None], phase, points)[0]
    near = np.flatnonzero(wave < wave.min() + WITHIN)
    low = near[(wave[near] <= wave[near - 1]) & (wave[near] < wave[(near + 1) % points])]
    low = low[np.argsort(wave[low], kind="stable")[:MOST_DIPS]]
    angle = low * (2 * np.pi / points)
    half = np.pi / points
    for _ in range(2):
        line = np.outer(angle, harmonic) + phase
        slope = -(np.sin(line) @ (harmonic * amplitude))
        curve = -(np.cos(line) @ (harmonic**2.0 * amplitude))
        angle = angle + _least_of_parabola(slope, curve, 2 * half)[0]
    line = np.outer(angle, harmonic) + phase
    return -(np.cos(line) @ amplitude), amplitude * np.sin(line)


MOST_OFF = 0.1
"""Largest distance from its resonance to which the comb may move a line, in half bandwidths f/(2Q).

The caller raises the line to make up for the taxel's smaller response there, √(1 + 0.1²) or 0.04 dB. OFF taxels then
hear the line from another distance: a neighbour Δ half bandwidths away is 0.1/Δ nearer or farther. That is at most 0.13
dB at Δ = 10 (20 dB of selectivity) and 0.22 dB at Δ = 5; the signs differ on a ladder's two sides.
"""
SHORTEST_S = 0.1
"""Shortest period that is tried."""
LONGEST_S = 30.0
"""Longest period: where no shorter one keeps `MOST_OFF`, the best one up to this is taken."""
LEAST_PERIODS = 2.0
"""Fewest periods of the lowest line in the comb's period."""
CHUNK = 1 << 15
"""Candidates judged at a time."""


def comb_period_s(resonance_hz: np.ndarray, q: np.ndarray, step: int, rate_hz: int) -> float:
    """Return the shortest period in s with a harmonic near each resonance (`MOST_OFF`), else the best possible one.

    Lines (n,) are on whole multiples of ``step/period``. The period is a whole number of samples at `rate_hz`, at least
    `SHORTEST_S` and at least `LEAST_PERIODS` of the lowest line. Every period from ``step max Q/f / MOST_OFF`` on keeps
    the limit. Where that is above `LONGEST_S` and no shorter period keeps it, the result is the one with the smallest
    distance.
    """
    resonance = np.asarray(resonance_hz, float)
    quality = np.asarray(q, float)
    # The strictest resonances first: they reject most candidates, so that few remain for the others.
    order = np.argsort(resonance / quality, kind="stable")
    resonance = resonance[order]
    quality = quality[order]
    steps_per_sample = resonance * (1 / (rate_hz * step))
    first = int(np.ceil(max(SHORTEST_S, LEAST_PERIODS * step / float(resonance.min())) * rate_hz))
    last = max(int(LONGEST_S * rate_hz), first)
    best = last
    least = float(off_resonance(resonance, quality, last / rate_hz, step).max())
    for start in range(first, last + 1, CHUNK):
        samples = np.arange(start, min(start + CHUNK, last + 1))
        off = np.zeros(len(samples))
        limit = max(least, MOST_OFF)
        for slope, taxel_q in zip(steps_per_sample, quality, strict=True):
            steps = samples * slope
            off = np.maximum(off, np.abs(np.rint(steps) / steps - 1) * (2 * taxel_q))
            near = off <= limit
            samples = samples[near]
            off = off[near]
        good = samples[off <= MOST_OFF]
        if good.size:
            return float(good[0] / rate_hz)
        if off.size and off.min() < least:
            best = int(samples[off.argmin()])
            least = float(off.min())
    return best / rate_hz


def off_resonance(resonance_hz: np.ndarray, q: np.ndarray, period_s: float, step: int) -> np.ndarray:
    """Return the distance (n,), in half bandwidths, of each resonance from the nearest multiple of `step/period_s`."""
    line_hz = on_comb(resonance_hz, period_s, step) / period_s
    return np.abs(line_hz / np.asarray(resonance_hz, float) - 1) * 2 * np.asarray(q, float)


def on_comb(resonance_hz: np.ndarray, period_s: float, step: int) -> np.ndarray:
    """Return the multiples (n,) of 1/period nearest to the resonances: whole multiples of `step`, at least one."""
    steps = np.rint(np.asarray(resonance_hz, float) * period_s / step).astype(int)
    return np.maximum(steps, 1) * step


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
PEAK_PER_CYCLE = 16
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
    """Margins (n,) that lift a force above zero, as shares of each line's amplitude, and the coil voltage that follows.

    With lines of amplitude A (n,), levels included, ``F = least_constant + share @ A + Σ A cos``. `alias_db` is the
    voltage above the amplifier's band (root of the sum of squares) over its largest line, the worst of all channels on
    and each alone. `peak_v` is the largest voltage in V of these states. `constant` is F's constant over Σ A with all
    channels on, which equals the copper loss over that of plain tones.
    """

    share: np.ndarray
    alias_db: float
    peak_v: float
    constant: float


_Sampled = tuple[np.ndarray, np.ndarray, np.ndarray]
"""A sum of lines in A² at samples, its slope in A²/s, and the window of its spectrum."""


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
    most_constant: float = np.inf,
) -> RootMargin:
    """Return the smallest force margin for which the coil voltage meets `ALIAS_DB` and, if possible, its limit.

    Lines (n,) are at harmonics of 1/period. The amplifier passes frequencies below half of `rate_hz`, or below
    `bandwidth_hz`. Where no margin up to `MOST_SHARE` keeps `ALIAS_DB` the result is `MOST_SHARE`; where none keeps the
    limit, the one with the lowest peak. For the limit it grows only until `RootMargin.constant` is `most_constant`.
    Periods of more than `MOST_SAMPLES` are judged by a piece at their deepest dip.
    """
    k = np.asarray(harmonic, int)
    line = np.asarray(line_a2, float)
    phase = np.asarray(phase_rad, float)
    if not line.any():
        return RootMargin(np.full(len(k), LEAST_SHARE), -np.inf, 0.0, 0.0)
    finer = round(FINER * rate_hz * period_s)
    whole = finer <= MOST_SAMPLES
    points = finer if whole else _grid_size(k, PEAK_PER_CYCLE)
    omega = 2 * np.pi * k / period_s
    force, slope = (
        waveform(k, size[None], start, points)[0] for size, start in ((line, phase), (omega * line, phase + np.pi / 2))
    )
    coarse = force, slope, np.ones(points)
    coil = _Coil(
        k / period_s,
        line,
        float(least_constant(k, line, phase)[0]),
        coarse if whole else _deepest_piece(omega, line, phase, period_s, FINER * rate_hz, force),
        coarse,
        FINER * rate_hz,
        min(rate_hz / 2, bandwidth_hz or np.inf),
        resistance_ohm,
        inductance_h,
    )
    least = _smallest(lambda h: _together_db(coil, h), _smallest(lambda h: _alone_db(coil, h), SMALLEST))
    peaks = dict[float, float]()
    for tried in np.geomspace(least, MOST_SHARE, PEAKS).tolist():
        peaks[tried] = _peak_v(coil, tried)
        if peaks[tried] <= voltage_limit_v:
            break
    lowest = min(peaks, key=lambda tried: peaks[tried])  # also the one within the limit, all before it being above
    wanted = _with_margin(coil, lowest, peaks[lowest])
    if wanted.constant <= most_constant:
        return wanted
    first = next(iter(peaks))
    enough = _with_margin(coil, first, peaks[first])
    if enough.constant >= most_constant:
        return enough
    part = (most_constant - enough.constant) / (wanted.constant - enough.constant)
    share = enough.share + part * (wanted.share - enough.share)
    return RootMargin(share, enough.alias_db, enough.peak_v, most_constant)


def _with_margin(coil: _Coil, margin: float, peak_v: float) -> RootMargin:
    share = _margin_share(coil, margin)
    alias = max(_alone_db(coil, margin), _together_db(coil, margin))
    return RootMargin(share, alias, peak_v, float((coil.least + share @ coil.line) / coil.line.sum()))


def _margin_share(coil: _Coil, margin: float) -> np.ndarray:
    """Return each line's margin (n,) divided by its amplitude: proportional to frequency², at least `LEAST_SHARE`."""
    return np.maximum(margin * (coil.hz / coil.hz.max()) ** 2, LEAST_SHARE)


def _deepest_piece(
    omegas: np.ndarray, line: np.ndarray, phase: np.ndarray, period_s: float, finer_hz: float, coarse: np.ndarray
) -> _Sampled:
    """Return samples of a sum of lines round its deepest dip, to stand for a period too long to sample whole."""
    time = int(coarse.argmin()) / len(coarse) * period_s + (np.arange(PIECE) - PIECE // 2) / finer_hz
    force = np.zeros(PIECE)
    slope = np.zeros(PIECE)
    for omega, a, start in zip(omegas, line, phase, strict=True):
        angle = omega * time + start
        force += a * np.cos(angle)
        slope -= omega * a * np.sin(angle)
    return force, slope, _window()


@cache
def _window() -> np.ndarray:
    return np.kaiser(PIECE, WINDOW)


def _voltage(coil: _Coil, force: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return the coil's voltage in V at the current i = √F, F > 0: ``R i + L di/dt``, ``di/dt = F'/(2 i)``."""
    current = np.sqrt(force)
    return coil.resistance_ohm * current + coil.inductance_h * slope / (2 * current)


def _together_v(coil: _Coil, seen: _Sampled, margin: float) -> np.ndarray:
    """Return the voltage (samples,) in V with all channels on."""
    return _voltage(coil, coil.least + _margin_share(coil, margin) @ coil.line + seen[0], seen[1])


def _alone_v(coil: _Coil, margin: float) -> np.ndarray:
    """Return the voltage (n, samples) in V over one cycle of each channel alone."""
    samples = int(np.clip(1 << int(coil.finer_hz / coil.hz.min()).bit_length(), *ALONE_SAMPLES))
    angle = np.arange(samples) * (2 * np.pi / samples)
    force = coil.line[:, None] * ((1 + _margin_share(coil, margin))[:, None] + np.cos(angle))
    return _voltage(coil, force, -np.outer(2 * np.pi * coil.hz * coil.line, np.sin(angle)))


def _together_db(coil: _Coil, margin: float) -> float:
    """Return the ratio in dB of voltage above the amplifier's band to the voltage's largest line, all channels on."""
    window = coil.spectrum[2]
    energy = np.abs(np.fft.rfft(_together_v(coil, coil.spectrum, margin) * window)) ** 2
    hz = np.arange(len(energy)) * (coil.finer_hz / len(window))
    # The constant's lobe is left out; it ends below half of the lowest line.
    largest = energy[hz > coil.hz.min() / 2].max() / window.sum() ** 2
    return _db(energy[hz > coil.band_hz].sum() / (len(window) * (window**2).sum()) / largest)


def _alone_db(coil: _Coil, margin: float) -> float:
    """Return the ratio in dB of voltage above the amplifier's band to its largest line, worst of the channels alone."""
    energy = np.abs(np.fft.rfft(_alone_v(coil, margin), axis=1)) ** 2
    hz = coil.hz[:, None] * np.arange(energy.shape[1])
    above = np.where(hz > coil.band_hz, energy, 0.0).sum(1)
    largest = energy[:, 1:].max(1)
    return _db(float((above[largest > 0] / largest[largest > 0]).max()))


def _db(energy: float) -> float:
    return float(10 * np.log10(energy)) if energy > 0 else -np.inf


def _peak_v(coil: _Coil, margin: float) -> float:
    """Return the largest voltage in V with all channels on or any one of them alone."""
    seen = (coil.peak,) if coil.peak is coil.spectrum else (coil.peak, coil.spectrum)
    together = max(float(np.abs(_together_v(coil, part, margin)).max()) for part in seen)
    return max(together, float(np.abs(_alone_v(coil, margin)).max()))


def _smallest(above_db: Callable[[float], float], least: float) -> float:
    """Return the smallest margin from `least` to `MOST_SHARE` that meets `ALIAS_DB`; `MOST_SHARE` if none does."""
    if above_db(least) <= ALIAS_DB:
        return least
    low = np.log(least)
    high = np.log(MOST_SHARE)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if above_db(float(np.exp(middle))) <= ALIAS_DB else (middle, high)
    return float(np.exp(high))
