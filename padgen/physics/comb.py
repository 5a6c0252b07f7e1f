"""A comb of frequencies: whole multiples of 1/period, so that a sum of lines repeats and can be looped."""

import numpy as np

__all__ = ["LONGEST_S", "MOST_OFF", "SHORTEST_S", "comb_period_s", "off_resonance", "on_comb"]

MOST_OFF = 0.1
"""How far off its resonance the comb may move a line, in half bandwidths f/(2Q).

The caller makes the line larger by what the taxel answers less there, √(1 + 0.1²) or 0.04 dB. What changes is
what the OFF taxels hear of it: a neighbour Δ half bandwidths away is 0.1/Δ nearer or farther, together at most
0.13 dB at Δ = 10 (20 dB of selectivity) and 0.22 dB at Δ = 5; on a ladder's two sides the signs differ."""
SHORTEST_S = 0.1
"""Shortest period that is tried."""
LONGEST_S = 30.0
"""Longest period: where no shorter one keeps `MOST_OFF`, the best up to here is taken."""
LEAST_PERIODS = 2.0
"""Fewest periods of the lowest line in the comb's."""
CHUNK = 1 << 15
"""Candidates that are worked on at a time."""


def comb_period_s(resonance_hz: np.ndarray, q: np.ndarray, step: int, rate_hz: int) -> float:
    """Shortest period in s whose comb moves no line by more than `MOST_OFF` half bandwidths off its resonance.

    Lines (n,) are on whole multiples of ``step/period``; the period is a whole number of samples at `rate_hz`,
    at least `SHORTEST_S` and `LEAST_PERIODS` of the lowest line. From ``step max Q/f / MOST_OFF`` on every period
    will do; where that is above `LONGEST_S`, and no shorter one fits, it is the one that is least off.
    """
    resonance, quality = np.asarray(resonance_hz, float), np.asarray(q, float)
    # Those that bind first: what the later ones would refuse is mostly gone by then.
    order = np.argsort(resonance / quality, kind="stable")
    resonance, quality = resonance[order], quality[order]
    first = int(np.ceil(max(SHORTEST_S, LEAST_PERIODS * step / float(resonance.min())) * rate_hz))
    last = max(int(LONGEST_S * rate_hz), first)
    best = last
    least = float(off_resonance(resonance, quality, last / rate_hz, step).max())
    for start in range(first, last + 1, CHUNK):
        samples = np.arange(start, min(start + CHUNK, last + 1))
        samples, off = _less_off(samples, resonance * (1 / (rate_hz * step)), quality, max(least, MOST_OFF))
        good = samples[off <= MOST_OFF]
        if good.size:
            return float(good[0] / rate_hz)
        if off.size and off.min() < least:
            best, least = int(samples[off.argmin()]), float(off.min())
    return best / rate_hz


def off_resonance(resonance_hz: np.ndarray, q: np.ndarray, period_s: float, step: int) -> np.ndarray:
    """How far (n,) the comb's nearest line is off each resonance, in half bandwidths."""
    line_hz = on_comb(resonance_hz, period_s, step) / period_s
    off: np.ndarray = np.abs(line_hz / np.asarray(resonance_hz, float) - 1) * 2 * np.asarray(q, float)
    return off


def on_comb(resonance_hz: np.ndarray, period_s: float, step: int) -> np.ndarray:
    """The multiples (n,) of 1/period nearest to the resonances: whole multiples of `step`, at least one."""
    steps = np.rint(np.asarray(resonance_hz, float) * period_s / step).astype(int)
    multiple: np.ndarray = np.maximum(steps, 1) * step
    return multiple


def _less_off(
    samples: np.ndarray, steps_per_sample: np.ndarray, q: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Those of the periods (m,) in samples that are at most `limit` off with every line, and by how much."""
    off = np.zeros(len(samples))
    for slope, quality in zip(steps_per_sample, q, strict=True):
        steps = samples * slope
        off = np.maximum(off, np.abs(np.rint(steps) / steps - 1) * (2 * quality))
        near = off <= limit
        samples, off = samples[near], off[near]
    return samples, off
