"""Faults of a record that a fit would take for a resonance: a coil's pick-up, a gap, a knock beside the pluck.

Pick-up is taken out; the others are refused with the place where they are, as what they hide is not known.
"""

import numpy as np

from padgen.core.errors import SolverError, number

__all__ = ["refuse_gap", "refuse_other_knocks", "without_pick_up"]

TAPS = 7
"""Samples of the current, about its delay, from which pick-up is worked out: of itself, its slope, and rounding."""
LATEST_S = 1.0
APART_S = 0.01
"""Longest delay between the current and its pick-up, and distance from there at which no more of it comes, in s."""
SHARP = 20.0
"""Least height of pick-up's impulse over what is usual: it is 40 with pick-up of 5 %, and 3 to 9 with none."""
EXCITED = 1e-3
"""Share of the current's largest power below which a line tells nothing."""
APART = 0.3
"""Largest correlation of i with i² at which pick-up and the answer to i² are told apart: sweeps have almost none."""
GAP_S = 3e-3
GAP_SAMPLES = 8
"""Shortest gap that is looked for, in s and in samples: crests that touch the end of a scale are shorter."""
MOVING = 0.1
"""Least motion on both sides of a gap, over the record's largest: silence has no gaps."""
JUMP = 2.0
"""Least step at an end of a gap, over the largest steps beside it."""
OCTAVE = 2.0
"""Ratio to the loudest knock's frequency within which others are heard."""
LOUD = 0.2
CLEAR = 10.0
"""Least size of a knock over the largest one's, and over the quietest tenth of the record."""
RISE = 3.0
"""Least rise of the motion within two periods where a knock is."""
UNLIKE = 0.04
"""Relative difference of frequency from which two knocks do not ring alike: a spring that softens gives half of it."""
FEWEST_PERIODS = 8


def without_pick_up(rate_hz: float, current: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Return `response` (n,) minus what the sensor picks up, if anything, of the coil's `current` (n,) and its slope.

    A sensor near a coil hears its field, i and di/dt; the taxel answers to i². In a sweep both pass a frequency at
    different times, so that the one is found by least squares without touching the other.
    """
    swing = current - current.mean()
    force = current**2
    size = np.linalg.norm(swing) * np.linalg.norm(force - force.mean())
    if size == 0 or abs(swing @ (force - force.mean())) > APART * size:
        return response
    level = response - response.mean()
    lag = _pick_up_lag(rate_hz, swing, level)
    if lag is None:
        return response
    heard = np.stack([_late(swing, lag + k - TAPS // 2) for k in range(TAPS)], 1)
    return np.asarray(response - heard @ np.linalg.lstsq(heard, level, rcond=1e-10)[0])


def _pick_up_lag(rate_hz: float, swing: np.ndarray, level: np.ndarray) -> int | None:
    """Return by how many samples pick-up of the coil's current lags that current; None where there is no pick-up.

    What follows a sweep at once at all frequencies is a short impulse; what answers to i² at other times is not.
    """
    size = 2 * len(swing)
    own_lines = np.fft.rfft(swing, size)
    power = np.abs(own_lines) ** 2
    impulse = np.abs(np.fft.irfft(np.fft.rfft(level, size) * own_lines.conj() / (power + EXCITED * power.max()), size))
    lags = np.fft.fftfreq(size, 1 / size).astype(int)
    near = np.abs(lags) <= LATEST_S * rate_hz
    lag = int(lags[near][impulse[near].argmax()])
    away = near & (np.abs(lags - lag) > APART_S * rate_hz)
    usual = float(np.sqrt(np.mean(impulse[away] ** 2))) if away.any() else np.inf
    return lag if impulse[lag] > SHARP * usual else None


def _late(values: np.ndarray, samples: int) -> np.ndarray:
    """Return `values` (n,) delayed by `samples` (advanced if negative), with zeros where the shift leaves no value."""
    moved = np.roll(values, samples)
    if samples > 0:
        moved[:samples] = 0
    elif samples < 0:
        moved[samples:] = 0
    return moved


def refuse_gap(rate_hz: float, response: np.ndarray, clipped: np.ndarray | None = None) -> None:
    """Refuse a record with a gap: samples that stand still while the motion around them does not.

    Samples marked as `clipped` (n,) stand still for another reason.
    """
    still = np.diff(response) == 0
    if clipped is not None:
        still &= ~clipped[1:]
    ends = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    least = max(int(GAP_S * rate_hz), GAP_SAMPLES)
    size = float(np.ptp(response))
    for begin, end in zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True):
        length = end - begin
        before = response[max(begin - length, 0) : begin]
        after = response[end + 1 : end + 1 + length]
        if length < least or min(len(before), len(after)) < least:
            continue
        # Means over some samples spread an end over two of them.
        jump = max(abs(response[begin] - before[-2]), abs(after[1] - response[end]))
        steps = max(np.abs(np.diff(before[:-2])).max(), np.abs(np.diff(after[2:])).max())
        if min(np.ptp(before), np.ptp(after)) > MOVING * size and jump > JUMP * steps:
            raise SolverError(
                f"has a gap of {number(1e3 * length / rate_hz)} ms at {number(begin / rate_hz)} s, in which nothing was"
                " recorded while the taxel moved (a dropout of the recorder): record it again, or cut it"
            )


def refuse_other_knocks(rate_hz: float, response: np.ndarray, near_hz: float) -> None:
    """Refuse a record of plucks whose knocks ring at different frequencies; `near_hz` is the loudest one's."""
    from scipy.ndimage import uniform_filter1d

    frequency = np.fft.rfftfreq(len(response), 1 / rate_hz)
    heard = (frequency > near_hz / OCTAVE) & (frequency < near_hz * OCTAVE)
    level = np.fft.irfft(np.where(heard, np.fft.rfft(response), 0), len(response))
    period = max(int(rate_hz / near_hz), 2)
    size = np.sqrt(uniform_filter1d(level**2, period))
    rise = size[2 * period :] > RISE * size[: -2 * period]
    loud = size[2 * period :] > max(LOUD * size.max(), CLEAR * np.quantile(size, 0.1))
    begins = np.flatnonzero(np.diff(np.concatenate([[0], (rise & loud).astype(np.int8)])) == 1) + 2 * period
    stops = np.append(begins[1:] - 2 * period, len(level))[: len(begins)]
    knocks = []
    for begin, stop in zip(begins.tolist(), stops.tolist(), strict=True):
        if stop - begin >= FEWEST_PERIODS * period:
            knocks.append((begin / rate_hz, _ringing_hz(rate_hz, level[begin:stop], size[begin:stop])))
    for at_s, hz in knocks[1:]:
        first_s, first_hz = knocks[0]
        if abs(np.log(hz / first_hz)) > UNLIKE:
            raise SolverError(
                f"holds knocks that ring differently: at {first_s:.2f} s with {number(first_hz)} Hz, at {at_s:.2f} s"
                f" with {number(hz)} Hz; cut it to the pluck"
            )


def _ringing_hz(rate_hz: float, level: np.ndarray, size: np.ndarray) -> float:
    """Return the frequency in Hz at which a knock rings, up to where it has died to a tenth of its largest size."""
    audible = np.flatnonzero(size > size.max() / 10)
    part = level[: int(audible[-1]) + 1]
    spectrum = np.abs(np.fft.rfft(part * np.hanning(2 * len(part))[len(part) :], 8 * len(part)))
    frequency = np.fft.rfftfreq(8 * len(part), 1 / rate_hz)
    return float(frequency[spectrum.argmax()])
