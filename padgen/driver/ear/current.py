"""From the samples of one channel to the square of its coil's current, exact between the samples too.

What is written stands for the band-limited signal through its samples (what a converter and its filter put
out), before and behind the file zero, or the file again where it loops. So all of it is done with lines of
Fourier series, for one *stretch* of the file at a time. A stretch that does not repeat has guards on both
sides, on the outermost of which the signal fades out. Where it has not faded, a circuit or a mode moves as its
periodic answer to the faded signal plus the free decay that meets the state in which it enters: both exact,
whatever the damping, however slow the resonance against the sample rate.

Squaring doubles the band, so i² is taken at twice the sample rate: nothing folds back.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

__all__ = ["GUARD", "STRETCH", "UNIT", "Circuit", "Squared", "Stretch", "squared_current", "stretches"]

GUARD = 2048
"""Samples of a guard; a fade of so many leaves 2e-8 of a constant force above 1/200 of the sample rate."""
STRETCH = 1 << 19
"""Samples of a stretch: 11 s at 48 kHz, some 50 MB of work space."""
LONGEST_LOOP = 1 << 22
"""Samples up to which a loop is one stretch that repeats; longer ones are gone through twice."""
UNIT = 64
"""A stretch with its guards is a whole multiple of so many samples."""


class Circuit(NamedTuple):
    """A coil; `by_voltage` tells that the file holds its voltage, not its current."""

    resistance_ohm: float
    inductance_h: float
    by_voltage: bool


class Stretch(NamedTuple):
    """Samples `start` … `stop` of a file; `size` with guards; without, where it `repeats`."""

    start: int
    stop: int
    size: int
    repeats: bool

    @property
    def lead(self) -> int:
        """Samples in front of `start`."""
        return 0 if self.repeats else 2 * GUARD


class Squared(NamedTuple):
    """i² of a stretch: `lines` (m,), A², such that it is the real part of ``Σ lines e^(2πj m t rate/size)``.

    Peak and mean square of the current and the mean and peak of the signal are of the stretch without its guards;
    `leaves_a` is the current one guard before its end.
    """

    lines: np.ndarray
    peak_a: float
    mean_square_a2: float
    leaves_a: float


def stretches(samples: int, loops: bool) -> tuple[Stretch, ...]:
    """A file of so many samples, in stretches."""
    from scipy.fft import next_fast_len

    if loops and samples <= LONGEST_LOOP:
        return (Stretch(0, samples, samples, True),)
    edges = [*range(0, max(samples - STRETCH // 2, 1), STRETCH), samples]
    return tuple(
        Stretch(a, b, UNIT * int(next_fast_len(-(-(b - a + 4 * GUARD) // UNIT), True)), False)
        for a, b in pairwise(edges)
    )


def squared_current(signal: np.ndarray, stretch: Stretch, rate_hz: float, circuit: Circuit, enters_a: float) -> Squared:
    """i² of a stretch from its `signal` (size,) in V or A, guards and what is behind them included.

    `enters_a` is the current one guard before its start.
    """
    from scipy.fft import irfft, rfft

    size = stretch.size
    faded = signal if stretch.repeats else signal * _fade(stretch, 1)
    lines = rfft(faded)
    if circuit.by_voltage:
        lines /= circuit.resistance_ohm + 2j * np.pi * circuit.inductance_h * np.arange(len(lines)) * (rate_hz / size)
    if size % 2 == 0:
        lines[-1] *= 0.5  # half of it is at the negative frequency
    current = 2 * irfft(lines, 2 * size)
    if not stretch.repeats and circuit.by_voltage and circuit.inductance_h > 0:
        _meet(current, stretch, rate_hz, circuit, enters_a)
    lead, length = 2 * stretch.lead, 2 * (stretch.stop - stretch.start)
    own = current[lead : lead + length]
    leaves = float(current[lead + length - 2 * GUARD]) if not stretch.repeats else 0.0
    peak, mean = float(np.abs(own).max()), float(own @ own) / length
    np.square(current, out=current)
    if not stretch.repeats:
        current *= _fade(stretch, 2, inner=True)
    squared = rfft(current)
    squared /= size
    squared[0] /= 2
    squared[-1] /= 2
    return Squared(squared, peak, mean, leaves)


def _meet(current: np.ndarray, stretch: Stretch, rate_hz: float, circuit: Circuit, enters_a: float) -> None:
    """Add the free decay that makes the current `enters_a`, one guard before the stretch."""
    first = 2 * (stretch.lead - GUARD)
    rate = circuit.resistance_ohm / circuit.inductance_h / (2 * rate_hz)
    last = min(first + int(min(40 / rate, 1e9)) + 1, len(current))
    current[first:last] += (enters_a - current[first]) * np.exp(-rate * np.arange(last - first))


def _fade(stretch: Stretch, times: int, inner: bool = False) -> np.ndarray:
    """1 within the stretch and its inner guards (without them: `inner`), to 0 in a guard more; at `times` the rate."""
    angle = np.pi / 2 * np.arange(times * GUARD) / (times * GUARD)
    # sin⁴ is smooth at its foot; over its sum with cos⁴ it is so at its top too.
    rise = np.sin(angle) ** 4 / (np.sin(angle) ** 4 + np.cos(angle) ** 4)
    weight = np.ones(times * stretch.size)
    low = times * (stretch.lead - (GUARD if inner else 2 * GUARD))
    high = times * (stretch.lead + stretch.stop - stretch.start + (0 if inner else GUARD))
    weight[:low], weight[high + len(rise) :] = 0.0, 0.0
    weight[low : low + len(rise)] = rise
    weight[high : high + len(rise)] = rise[::-1]
    return weight
