"""Choose phases for which a sum of cosines dips least below zero, find how deep a sum dips, and choose a comb's period.

The spur-free drive's force is ``F₀ + Σ A_j cos(2π k_j t/T + φ_j)`` and may not be negative. F₀ is therefore at least
the depth of the sum's deepest dip, and copper loss and mean pull are proportional to F₀. Everything is over one period
T, at the angle x = 2πt/T, with whole harmonics k_j. Frequencies that are whole multiples of 1/T form a comb: their sum
repeats and can be looped.
"""

from functools import lru_cache
from operator import attrgetter

import numpy as np

from padgen.physics.minimax import Box, Descent, descend

__all__ = [
    "EXACT",
    "LONGEST_S",
    "MOST_OFF",
    "SHORTEST_S",
    "comb_period_s",
    "least_constant",
    "low_crest_phases",
    "off_resonance",
    "on_comb",
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
"""Most angles used by the choice of the starts."""
FIRST_STEPS, LAST_STEPS, BEST = 4, 25, 3
"""Linear programs from every start, then more from the BEST starts."""
WITHIN, MOST_DIPS = 0.1, 200
"""Dips that a linear program includes: within this share of Σ A of the deepest, and at most MOST_DIPS."""
TRUST = 0.1
"""First trust region in rad."""
SETTLED = 1e-4
"""Stop when a linear program predicts a decrease of less than this, over Σ A."""
LONG, FEWEST = 1 << 17, 3
"""Most points of the grids of all starts together, and fewest starts. On a long comb phases gain little, so it gets
few.
"""


def schroeder_phases(amplitude: np.ndarray) -> np.ndarray:
    """Return phases (n,) in rad for which the sum of lines in rising order sweeps through their frequencies.

    The sweep gives each line time by its share of the power. ``φ_j = −2π Σ_{l<j} (j − l) p_l`` with the shares p:
    Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85.
    """
    power = np.asarray(amplitude, float) ** 2
    before = np.concatenate([[0.0], np.cumsum(power / power.sum())[:-1]])
    return -2 * np.pi * np.cumsum(before)


def low_crest_phases(harmonic: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """Return phases φ (n,) in rad, in 0 … 2π, for which ``Σ A_j cos(k_j x + φ_j)`` dips least below zero.

    Exact for two lines; otherwise the best of a few descents, a local optimum that is the same each time. `amplitude`
    (n,) is at least 0, in any unit. Lines of one harmonic get one phase.
    """
    k, a = np.asarray(harmonic, int), np.asarray(amplitude, float)
    phase, played = np.zeros(len(k)), a > 0
    if not played.any():
        return phase
    distinct, place = np.unique(k[played], return_inverse=True)
    total = np.bincount(place, a[played])
    shape = np.round(total / total.max(), 12)
    reduced = distinct // np.gcd.reduce(distinct)
    phase[played] = np.array(_phases(tuple(reduced.tolist()), tuple(shape.tolist())))[place]
    return phase


def least_constant(harmonic: np.ndarray, amplitude: np.ndarray, phase: np.ndarray) -> np.ndarray:
    """Return the least F₀ (s,) of states `amplitude` (s, n): ``−min_x Σ_j A_sj cos(k_j x + φ_j)``.

    It is 0 for a silent state; otherwise at most rounding above the true value and at most `EXACT` Σ A below it. A grid
    comes first; then each of its pieces in which a Taylor bound allows a deeper dip is divided, until no piece is left.
    """
    k, a = np.asarray(harmonic, int), np.atleast_2d(np.asarray(amplitude, float))
    result = np.zeros(len(a))
    heard = np.flatnonzero(a.any(axis=1))
    if heard.size == 0:
        return result
    k = k // np.gcd.reduce(k)
    points = _points(k)
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


def _points(harmonic: np.ndarray) -> int:
    """Return a power of two: at least `PER_CYCLE` points per cycle of the highest line, and less than twice as many."""
    return 1 << (PER_CYCLE * int(harmonic.max()) - 1).bit_length()


def _depths(harmonic: np.ndarray, amplitude: np.ndarray, phase: np.ndarray, points: int) -> np.ndarray:
    """Return `least_constant` of states, each with at least one amplitude above 0."""
    wave = waveform(harmonic, amplitude, phase, points)
    total = amplitude.sum(1)
    bend, twist = amplitude @ harmonic**2.0, amplitude @ harmonic**3.0
    lowest, half = wave.min(1), np.pi / points
    # The slope is 0 at the deepest dip, and a grid point lies within half a step of it.
    state, point = np.nonzero(wave <= (lowest + bend * half**2 / 2)[:, None])
    angle = point * (2 * half)
    while state.size:
        line = np.outer(angle, harmonic) + phase
        cosine, sine = amplitude[state] * np.cos(line), amplitude[state] * np.sin(line)
        value, slope, curve = cosine.sum(1), -(sine @ harmonic), -(cosine @ harmonic**2.0)
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


_largest = attrgetter("largest")


@lru_cache(maxsize=4096)
def _phases(harmonic: tuple[int, ...], amplitude: tuple[float, ...]) -> tuple[float, ...]:
    """Return `low_crest_phases` of rising harmonics without a common divisor; the first phase is 0."""
    if len(harmonic) == 1:
        return (0.0,)
    if len(harmonic) == 2:
        return 0.0, _second_phase(*harmonic)
    k, a = np.array(harmonic), np.array(amplitude) / sum(amplitude)
    # The first phase stays 0, since a shift in time changes nothing.
    free = np.append(0.0, np.full(len(k) - 1, np.inf))

    def improved(at: Descent, steps: int) -> Descent:
        return descend(lambda phase: _dips(k, a, phase), at, Box(-free, free), steps, SETTLED)

    begun = sorted((improved(Descent(start, np.inf, TRUST), FIRST_STEPS) for start in _starts(k, a)), key=_largest)
    best = min((improved(descent, LAST_STEPS) for descent in begun[:BEST]), key=_largest).place
    # Later digits may differ between machines, and have no effect on the depth.
    return tuple(np.round(best % (2 * np.pi), 6).tolist())


def _second_phase(low: int, high: int) -> float:
    """Return the best phase of the second of two lines, for any amplitudes.

    The two angles run along lines of offset k₂θ₁ − k₁θ₂ in the plane, 2π apart. The dips lie near (π, π), and the best
    offset is π away from that point. Phase 0 gives this unless both harmonics are odd, and phase π if they are.
    """
    return float(np.pi) if low % 2 and high % 2 else 0.0


def _starts(harmonic: np.ndarray, amplitude: np.ndarray) -> list[np.ndarray]:
    """Return phases to descend from: Schroeder's and the best random ones."""
    count, points = len(harmonic), _points(harmonic)
    random = np.random.default_rng(0)
    draws = np.concatenate([schroeder_phases(amplitude)[None], random.uniform(0, 2 * np.pi, (DRAWS, count))])
    draws[:, 0] = 0.0
    where = np.arange(points) if points <= SAMPLES else np.sort(random.choice(points, SAMPLES, replace=False))
    angle = np.outer(where * (2 * np.pi / points), harmonic)
    table = np.hstack([np.cos(angle), np.sin(angle)])
    depth = -(table @ np.hstack([amplitude * np.cos(draws), -amplitude * np.sin(draws)]).T).min(0)
    depth[0] = 0.0  # Schroeder's phases always rank first.
    few = min(STARTS, 2 * count, max(LONG // (2 * points), FEWEST))
    return list(draws[np.argsort(depth, kind="stable")[:few]])


def _dips(harmonic: np.ndarray, amplitude: np.ndarray, phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return depths (m,) of the sum's deep dips, deepest on the grid first, and their slopes (m, n) by the phases."""
    points = _points(harmonic)
    wave = waveform(harmonic, amplitude[None], phase, points)[0]
    near = np.flatnonzero(wave < wave.min() + WITHIN)
    low = near[(wave[near] <= wave[near - 1]) & (wave[near] < wave[(near + 1) % points])]
    low = low[np.argsort(wave[low], kind="stable")[:MOST_DIPS]]
    angle, half = low * (2 * np.pi / points), np.pi / points
    for _ in range(2):
        line = np.outer(angle, harmonic) + phase
        slope, curve = -(np.sin(line) @ (harmonic * amplitude)), -(np.cos(line) @ (harmonic**2.0 * amplitude))
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
    """Return the shortest period in s whose comb moves no line by more than `MOST_OFF` half bandwidths.

    Lines (n,) are on whole multiples of ``step/period``. The period is a whole number of samples at `rate_hz`, at least
    `SHORTEST_S` and at least `LEAST_PERIODS` of the lowest line. Every period from ``step max Q/f / MOST_OFF`` on keeps
    the limit. Where that is above `LONGEST_S` and no shorter period keeps it, the result is the one with the smallest
    distance.
    """
    resonance, quality = np.asarray(resonance_hz, float), np.asarray(q, float)
    # The strictest resonances first: they reject most candidates, so that few remain for the others.
    order = np.argsort(resonance / quality, kind="stable")
    resonance, quality = resonance[order], quality[order]
    first = int(np.ceil(max(SHORTEST_S, LEAST_PERIODS * step / float(resonance.min())) * rate_hz))
    last = max(int(LONGEST_S * rate_hz), first)
    best = last
    least = float(off_resonance(resonance, quality, last / rate_hz, step).max())
    for start in range(first, last + 1, CHUNK):
        samples = np.arange(start, min(start + CHUNK, last + 1))
        samples, off = _near_enough(samples, resonance * (1 / (rate_hz * step)), quality, max(least, MOST_OFF))
        good = samples[off <= MOST_OFF]
        if good.size:
            return float(good[0] / rate_hz)
        if off.size and off.min() < least:
            best, least = int(samples[off.argmin()]), float(off.min())
    return best / rate_hz


def off_resonance(resonance_hz: np.ndarray, q: np.ndarray, period_s: float, step: int) -> np.ndarray:
    """Return the distance (n,) of the comb's nearest line from each resonance, in half bandwidths."""
    line_hz = on_comb(resonance_hz, period_s, step) / period_s
    return np.abs(line_hz / np.asarray(resonance_hz, float) - 1) * 2 * np.asarray(q, float)


def on_comb(resonance_hz: np.ndarray, period_s: float, step: int) -> np.ndarray:
    """Return the multiples (n,) of 1/period nearest to the resonances: whole multiples of `step`, at least one."""
    steps = np.rint(np.asarray(resonance_hz, float) * period_s / step).astype(int)
    return np.maximum(steps, 1) * step


def _near_enough(
    samples: np.ndarray, steps_per_sample: np.ndarray, q: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return those of the periods `samples` (m,) that put every line at most `limit` off, and the largest distance."""
    off = np.zeros(len(samples))
    for slope, quality in zip(steps_per_sample, q, strict=True):
        steps = samples * slope
        off = np.maximum(off, np.abs(np.rint(steps) / steps - 1) * (2 * quality))
        near = off <= limit
        samples, off = samples[near], off[near]
    return samples, off
