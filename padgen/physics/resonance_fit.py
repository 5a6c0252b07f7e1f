"""Fit f, Q and peak response of one resonance, each with one sigma; mains lines, other modes and drift are taken out.

A driven record, the record of a free decay and a spectrum are fitted by one model in frequency, within some bandwidths
of the resonance:

    Y(f) = X (Σ g sⁿ / (Q (1 − s²) + j s) + a + b u) + (Σ c sⁿ / (Q (1 − s²) + j s) + d + e u),
    s = f/f₀, u = s − 1/s

X is the transform of i²; the second bracket has the free vibration at the record's ends. A decay has that bracket
alone, a spectrum the first with X = 1 and ``a sⁿ + b sⁿ⁻²``.
All factors are complex: g is any scale, phase and polarity, a and b stand for
far modes (D. J. Ewins, Modal Testing, 2nd ed. 2000, ch. 4), and to first order for all that changes slowly over the
resonance: a gain that drifts during a sweep, a high-pass, a rest of delay, another kind of sensor. n is 0 for
displacement, 1 for velocity, 2 for acceleration. Factors enter linearly and are projected out (G. Golub, V. Pereyra,
SIAM J. Numer. Anal. 10, 1973, 413-432), so that scipy's least squares search for f₀ and Q only.

What else is in the data is added as columns where it stands out of the residual: mains lines and their harmonics, a
second mode, and in a record a gain or clock that drifts. Delay between excitation and response is found first, from the
impulse response. Clipped crests get caps, whose heights are fitted too. As a check the circle of
`padgen.physics.resonance_judge` is fitted.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, at_least, at_most, number
from padgen.physics.record_faults import refuse_gap, refuse_other_knocks, without_pick_up
from padgen.physics.resonance_judge import (
    COMPARABLE,
    LEAST_GAIN,
    NEEDED,
    NEEDED_OF_SPECTRA,
    CircleFit,
    ResonanceFit,
    Seen,
    circle_resonance,
    detuning,
    judge_agreement,
    point_noise,
    refuse_ambiguous_peaks,
    refuse_bad_record,
    refuse_bad_spectrum,
    refuse_edge,
    refuse_few,
    refuse_no_peak,
    refuse_no_resonance,
    rough_peak,
)

__all__ = [
    "MOST_SAMPLES",
    "SENSORS",
    "current_of_voltage",
    "fit_decay",
    "fit_driven",
    "fit_spectrum",
    "rough_hz",
    "unfitted_response",
]

REACH = 10.0
CLOSE_REACH = 4.0
"""Largest |Q (s − 1/s)| of fitted lines, five bandwidths on either side; and about another mode among them."""
LEAST_SHARE = 0.05
CUBED = 1.6
"""Ratio to a resonance up to which the response counts in its third power."""
FURTHER_Q = 1.0
"""Smallest further peak, over the largest, and its smallest Q: a broader one is no mode, but a slope of the whole."""
FEWEST_LINES = 14
MOST_LINES = 3000
LEAST_Q = 0.55
LARGEST_Q = 1e7
MOST_MODES = 4
MOST_HUM = 8
MOST_TRIES = 100
FIRST_TRIES = 12
"""Evaluations of a search, and of a first one, whose result is fitted again."""
SMOOTHED = (1, 5, 25, 125)
"""Numbers of points over which a response is averaged to find its peak in noise."""
WORTH = 30.0
"""Least decrease of the sum of squares by a further column or mode, in variances."""
CENTRES = np.linspace(-1, 1, 41)
"""Distances, in lines, from a mains line that stands out to the sines that may have made it."""
MAINS_HZ = (50.0, 60.0)
MAINS_OFF = 4e-3
"""Frequencies of the mains, and the largest relative deviation of a line from their multiples."""
SPARE = 20.0
"""Lines in a bandwidth from which those beside a mains line are left out."""
MOST_MISFIT = 2.5
"""Largest residual of a spectrum, over the scatter of its points, that needs no remark."""
SMALLEST_NOISE = 1e-9
"""Noise over the largest response that counts as rounding only."""
EXCITED = 1e-3
"""Power density at the edge of the excited band, over its largest."""
QUIET_SHARE = 1e-3
BEFORE_S = 0.1
RINGING_TAUS = 12.0
"""Share of the largest i² below which a coil is silent; kept silence before (s) and after it (time constants)."""
DECAY_TAUS = 15.0
DECAY_PERIODS = 10.0
FEWEST_PERIODS = 4.0
BEGINS = 0.8
MOST_TAPS = 30
TAP = 0.5
QUIET_TAP = 0.3
BEFORE_TAP = 0.1
"""Share of a record in which a decay must begin; most decays, their least size over the largest, and that of the quiet
before them; and the end of each that is left out.
"""
FEWEST_SAMPLES = 64
MOST_SAMPLES = 3 << 18
MOST_OF_DECAY = 1 << 18
"""Fewest and most samples of a driven record, and most of a decay; all that follow are left out."""
ANSWERING = 3.0
FEWEST_ANSWERING = 40
"""Largest |Q (s − 1/s)| within which the answer of a driven resonance must exceed what is left, and fewest lines: of
fewer, the model can follow what is no answer.
"""
NO_ANSWER = (
    "shows no answer to the excitation: the best one is hidden in what does not follow it; excite more, check that the"
    " first channel is the excitation (and, of noise, that it passes direct current) and that the sensor is on this"
    " taxel, or leave this taxel out"
)
NO_DECAY = (
    "shows no free decay: the best one is no more than noise makes by chance; pluck harder, or leave this taxel out"
)
SEEN = 6.0
WIDE = 0.2
"""Least response over its noise, and least range of ln f, from which the kind of sensor is recognised."""
SENSORS = ("displacement", "velocity", "acceleration")
"""Kinds of sensors, by the power of the frequency."""
FILLED = 4
MOST_CAPS = 400
MOST_HELD = 4000
"""Rounds in which clipped crests are fitted, the number of their heights (of more, neighbours share one), and the most
clipped samples, whose fit takes half a second.
"""
LATE_S = 5e-3
CLOCK = 100e-6 * (2 / 3) ** 0.5
DRIFT = 0.15
BENT = 0.03
"""Delay (s) from which reference and sensor may have clocks of their own, as a pluck and the player have; one sigma of
their ratio, each being anywhere within 100 ppm; one sigma of a gain's drift in a record or, of a shorter one, in a
second; and of what a spring's law has beyond its third power, over the shift by that.
"""


NOT_FED = np.zeros((0, 1))
"""No forces made by the response: what `MeasuredLines.fed` has where the spring is taken to be straight."""


class MeasuredLines(NamedTuple):
    """Measured spectral lines: `data` (n,) over `frequency` (n,) in Hz, and the inputs (m, n) that cause them.

    A record lasts `seconds` (0 for a spectrum). `slow` (k, n) are transforms of the response times the time and times
    its square and, with an excitation, of that times the time. `fed` (k, n) are forces on the first mode that the
    response itself makes. `noise` is that of a line where it is known.
    """

    frequency: np.ndarray
    data: np.ndarray
    inputs: np.ndarray
    seconds: float = 0.0
    slow: np.ndarray | None = None
    noise: float = 0.0
    fed: np.ndarray = NOT_FED

    @property
    def step_hz(self) -> float:
        """Spacing of a record's lines in Hz; of a spectrum's, the largest spacing."""
        return 1 / self.seconds if self.seconds else float(np.diff(self.frequency).max())

    def at(self, keep: np.ndarray) -> "MeasuredLines":
        """Return the lines of the indices `keep`."""
        return self._replace(
            frequency=self.frequency[keep],
            data=self.data[keep],
            inputs=self.inputs[:, keep],
            slow=None if self.slow is None else self.slow[:, keep],
            fed=self.fed[:, keep] if len(self.fed) else self.fed,
        )

    def cubed(self, hz: float) -> "MeasuredLines":
        """Return the lines with a cubic spring's force `fed`: motion near `hz` cubed in time, over its maximum squared.

        The spring of a mode may soften or stiffen: its motion to the third power is then a further force on it
        (nonlinear identification through feedback of the outputs: D. E. Adams, R. J. Allemang, Mech. Syst. Signal
        Process. 14, 2000, 637-656).
        """
        near = np.where((self.frequency > hz / CUBED) & (self.frequency < hz * CUBED), self.data, 0)
        moved = np.fft.irfft(np.concatenate([[0], near, [0]]), 2 * len(near) + 2)
        largest = np.abs(moved).max() or 1.0
        return self._replace(fed=np.fft.rfft(moved**3)[None, 1:-1] / largest**2)

    def around(self, hz: float, q: float, close: Sequence["_Peak"] = ()) -> "MeasuredLines":
        """Return the lines within `REACH` half bandwidths of a resonance, and those about the peaks in `close`.

        Of more than `MOST_LINES` every second, third, … is kept.
        """
        away = np.abs(detuning(self.frequency, hz, q))
        inside = away <= max(REACH, float(np.sort(away)[:FEWEST_LINES][-1]))
        for peak in close:
            inside |= np.abs(detuning(self.frequency, peak.hz, peak.q)) <= CLOSE_REACH
        keep = np.flatnonzero(inside)
        return self.at(keep[:: -(-len(keep) // MOST_LINES)])


class _Solved(NamedTuple):
    """A fit of `lines`: ln f₀ and ln Q of each mode in `theta`, and the `factors` (k,) of the columns `basis` (n, k).

    The last columns are `extra` (n, j), what is in the data beside modes. `noise` is that of a line (rms), from the
    complex `residual` (n,). `caps` (n, c) are the transforms of the caps on clipped crests, where there are any.
    """

    lines: MeasuredLines
    theta: np.ndarray
    factors: np.ndarray
    basis: np.ndarray
    residual: np.ndarray
    noise: float
    extra: np.ndarray
    caps: np.ndarray | None = None

    @property
    def of_fed(self) -> slice:
        """Slice of the fit's columns for forces that depend on the response itself, such as a cubic spring's."""
        end = len(self.factors) - self.extra.shape[1]
        return slice(end - len(self.lines.fed), end)

    @property
    def modes(self) -> np.ndarray:
        """Frequency in Hz and Q of each mode, (m, 2)."""
        return np.asarray(np.exp(self.theta.reshape(-1, 2)))

    @property
    def cost(self) -> float:
        """Sum of the residual's squares."""
        return float(np.vdot(self.residual, self.residual).real)


class _Peak(NamedTuple):
    """A mode by a first rough fit: frequency in Hz, Q, and amplitude at resonance in the unit of the data."""

    hz: float
    q: float
    size: float


def fit_spectrum(
    frequency_hz: np.ndarray, response: np.ndarray, near_hz: float | None = None, power: int | None = None
) -> ResonanceFit:
    """Fit a resonance to a `response` (n,), complex or a magnitude, over rising `frequency_hz` (n,).

    Of several comparable peaks the one nearest to `near_hz` is taken; without `near_hz` they are refused. `power` is 0
    for displacement, 1 for velocity, 2 for acceleration, None where it is to be recognised.

    Raises
    ------
    SolverError
        No peak, one at an end of the sweep, two comparable ones, too few points in it, or a phase that rises.
    """
    frequency = np.asarray(frequency_hz, float)
    given = np.asarray(response)
    refuse_bad_spectrum(frequency, given)
    phased = np.iscomplexobj(given)
    noise = point_noise(given)
    data = given if phased else _with_phase(frequency, given)
    lines = MeasuredLines(frequency, np.asarray(data, complex), np.ones((1, len(data))), noise=noise)
    peaks = _peaks(lines, power or 0)
    n = _recognised(lines, peaks, near_hz, power)
    fit = _fit_peaks(lines, peaks, near_hz, n or 0, alone=not phased)
    hz, q = fit.modes[0]
    if phased:
        _refuse_phase(lines, fit, n or 0)
    # A peak of one or two points is more easily made by noise.
    gain = _gain(fit) / (4 if hz / q < 1.5 * fit.lines.step_hz else 1)
    refuse_no_peak(abs(fit.factors[0]), max(fit.noise, noise, 1e-300), gain, frequency, np.abs(given))
    refuse_edge(frequency[0], frequency[-1], hz, q)
    refuse_no_resonance(np.abs(fit.lines.data), fit.noise, noise, hz)
    refuse_few(frequency, hz, q)
    if not phased:
        fit = _refit_to_magnitude(fit, np.abs(given)[np.isin(frequency, fit.lines.frequency)], n or 0)
    return _result(lines, fit, peaks, near_hz, n, phased)


def fit_driven(
    rate_hz: float,
    squared_current: np.ndarray,
    response: np.ndarray,
    near_hz: float | None = None,
    power: int | None = None,
    ring_s: float | None = None,
    clipped: np.ndarray | None = None,
    exact: bool = False,
    current: np.ndarray | None = None,
) -> ResonanceFit:
    """Fit a resonance to a `response` (n,) driven by `squared_current` (n,); `peak` is per unit of the latter.

    With the `current` (n,) itself what the sensor picks up of it is taken out. `power` is as in `fit_spectrum`.
    `ring_s` is about the time constant of the resonance; `clipped` (n,) marks samples of the response at the end of
    their scale. With `exact` the peak nearest to `near_hz` is taken however small it is.

    Raises
    ------
    SolverError
        No response, two comparable resonances, a resonance at an end of the excited band, or too short a record.
    """
    x = np.asarray(squared_current, float)
    y = np.array(response, float)
    refuse_bad_record(y)
    if np.ptp(x) == 0:
        raise SolverError("the excitation does not change; leave its column out for a free decay")
    refuse_gap(rate_hz, y, clipped)
    if len(y) > MOST_SAMPLES:
        raise SolverError(
            f"lasts {number(len(y) / rate_hz)} s; at most {at_most(MOST_SAMPLES / rate_hz)} s of it can be fitted: cut"
            " it to the part in which the excitation passes the resonance and the response rings"
        )
    held = np.zeros(len(y), bool) if clipped is None else clipped
    rings = ring_s or len(y) / rate_hz / 8
    if current is not None:
        y = without_pick_up(rate_hz, np.asarray(current, float), y)
    first_lag = _lag(_cross(rate_hz, x, y))
    x, y, held = _shifted(first_lag, x, y, held)
    # Without silence, the constant of the excitation hides none of its lines.
    loud = np.flatnonzero(np.abs(x) > QUIET_SHARE * np.abs(x).max())
    inside = slice(
        max(int(loud[0] - BEFORE_S * rate_hz), 0), min(int(loud[-1] + RINGING_TAUS * rings * rate_hz), len(x))
    )
    cross = _cross(rate_hz, x[inside], y[inside])
    rough = _gated(rate_hz, cross, 0, rings)
    hz, q, _ = _start(rough, rough.data, power or 0, [])
    if not hz:
        raise SolverError("is too short to show a resonance, or shows none; record longer, or excite more")
    first = _solve(rough.around(hz, q), np.log([hz, q]), power or 0, tries=FIRST_TRIES)
    lag = _lag(cross, first.modes[0])
    if abs(lag) > RINGING_TAUS * rings * rate_hz:  # no part of the response that began at the first
        raise SolverError(NO_ANSWER)
    x, y, held = _shifted(lag, x[inside], y[inside], held[inside])
    count = len(x) - len(x) % (1 << max(len(x).bit_length() - 10, 0))  # a length whose Fourier transform is quick
    x, y, held = (v[:count] for v in (x, y, held))
    if held.sum() > MOST_HELD:
        raise SolverError(
            f"has {held.sum()} clipped samples, at most {MOST_HELD} can be restored: lower the input's gain, or cut it"
            f" to {at_most(len(y) / rate_hz * MOST_HELD / held.sum())} s in which the excitation passes the resonance"
        )
    gated = _gated(rate_hz, cross, lag, rings)
    peaks = _peaks(gated, power or 0)
    n = _recognised(gated, peaks, near_hz, power)
    lines = _record_lines(rate_hz, y, x)
    if held.any():
        chosen = _chosen(peaks, near_hz, exact)
        first = _solve(lines.around(chosen.hz, chosen.q), np.log([chosen.hz, chosen.q]), n or 0)
        lines = _record_lines(rate_hz, _with_restored_crests(first, rate_hz, y, held, n or 0)[1], x)
    fit = _fit_peaks(lines, peaks, near_hz, n or 0, exact)
    cubed = lines.cubed(float(fit.modes[0, 0]))
    if _may_be_bent(fit, cubed, n or 0):
        bent = _fit_peaks(cubed, peaks, near_hz, n or 0, exact)
        fit = bent if _is_worth(fit, bent) and _are_resolved(bent) else fit
    if held.any():
        fit, _ = _with_restored_crests(fit, rate_hz, y, held, n or 0)
    hz, q = fit.modes[0]
    clock = CLOCK if abs(first_lag + lag) > LATE_S * rate_hz else 0.0
    _refuse_short(len(y) / rate_hz, hz)
    away = np.abs(detuning(fit.lines.frequency, hz, q))
    near = away < max(ANSWERING, float(np.sort(away)[:FEWEST_ANSWERING][-1]))
    answer = (fit.basis[:, 0] * fit.factors[0])[near]
    if not _gain(fit) >= LEAST_GAIN or np.linalg.norm(answer) < np.linalg.norm(fit.residual[near]):
        raise SolverError(NO_ANSWER)
    refuse_edge(cross.low_hz, cross.high_hz, hz, q, "the excited band", "the excitation", rate_hz / len(y))
    return _result(lines, fit, peaks, near_hz, n, clock=clock, seconds=len(response) / rate_hz)


def fit_decay(
    rate_hz: float,
    response: np.ndarray,
    near_hz: float | None = None,
    exact: bool = False,
    clipped: np.ndarray | None = None,
) -> ResonanceFit:
    """Fit a resonance to the free decay, or to those of several plucks, in a `response` (n,) of any sensor.

    A decay begins at its largest value.

    Raises
    ------
    SolverError
        No decay, two comparable sines in it (unless `near_hz` selects one), or too short a record.
    """
    whole = np.asarray(response, float)
    refuse_bad_record(whole)
    refuse_gap(rate_hz, whole, clipped)
    size = np.abs(whole - whole.mean())
    first = int(size[: int(BEGINS * len(size))].argmax())
    late = int(size.argmax())
    if size[first] < TAP * size[late]:
        raise SolverError(
            f"is largest {number(late / rate_hz)} s into a record of {number(len(size) / rate_hz)} s: a free decay"
            " starts at its largest value; if there was an excitation, add it as a column"
        )
    if clipped is not None and clipped[first:].any():
        first += int(np.flatnonzero(clipped[first:])[-1]) + 1
        size[:first] = 0
    y = whole[first : first + MOST_OF_DECAY]
    refuse_bad_record(y)
    taps: list[int] = []
    for turn in range(4):
        lines = _record_lines(rate_hz, y)
        peaks = _peaks(lines, 0)
        hz, q, _ = peaks[0]
        taps = taps if turn else _pluck_starts(size, int(rate_hz / hz))
        apart = int((1 - BEFORE_TAP) * min(np.diff(taps), default=0))
        if not turn and apart > DECAY_PERIODS * rate_hz / hz:
            y = whole[taps[0] : taps[0] + apart]
            continue
        seconds = max(DECAY_TAUS * q / (np.pi * hz), DECAY_PERIODS / hz)
        if seconds * rate_hz >= 0.9 * len(y):
            break
        y = y[: max(int(seconds * rate_hz), FEWEST_SAMPLES)]
    refuse_other_knocks(rate_hz, whole, peaks[0].hz)
    further = [k for k in taps[1:] if k + len(y) <= len(whole) and len(y) <= apart]
    parts = [lines, *(_record_lines(rate_hz, whole[k : k + len(y)]) for k in further)]
    inputs = np.repeat(np.eye(len(parts)), len(lines.data), 1) * np.concatenate([part.inputs[0] for part in parts])
    joined = MeasuredLines(
        np.tile(lines.frequency, len(parts)),
        np.concatenate([part.data for part in parts]),
        inputs,  # one for each decay, so that each has factors of its own
        lines.seconds,
        np.concatenate([part.slow for part in parts if part.slow is not None], 1),
    )
    fit = _fit_peaks(joined, peaks, near_hz, 0, exact)
    _refuse_short(len(y) / rate_hz, float(fit.modes[0, 0]))
    if not _gain(fit) >= LEAST_GAIN:
        raise SolverError(NO_DECAY)
    return _result(lines, fit, peaks, near_hz, None, clock=CLOCK, seconds=len(response) / rate_hz)


def _pluck_starts(size: np.ndarray, period: int) -> list[int]:
    """Return in order the sample indices at which free decays begin, in a record of absolute values `size` (n,)."""
    from scipy.ndimage import uniform_filter1d

    energy = uniform_filter1d(size**2, max(period, 1))
    loud = energy > TAP**2 * energy.max()
    quiet = energy < QUIET_TAP**2 * energy.max()
    turns = np.flatnonzero(loud | quiet)
    begin = turns[loud[turns] & np.append(True, quiet[turns[:-1]])]
    return [int(k + size[k : k + 2 * period].argmax()) for k in begin[:MOST_TAPS]]


def unfitted_response(rate_hz: float, response: np.ndarray, squared_current: np.ndarray | None = None) -> Seen:
    """Return a record's response over frequency without a fit; of a free decay, its Fourier transform."""
    if squared_current is None or np.ptp(squared_current) == 0:
        first = int(np.abs(response - response.mean(dtype=float)).argmax())
        lines = _record_lines(rate_hz, response[first : first + MOST_OF_DECAY])
    else:
        lines = _gated(rate_hz, _cross(rate_hz, squared_current, response), 0, len(response) / rate_hz / 8)
    return Seen(lines.frequency, lines.data, None)


def rough_hz(rate_hz: float, response: np.ndarray, squared_current: np.ndarray | None = None) -> float:
    """Estimate the resonance in Hz: where frequency times response, per excitation where there is one, is largest."""
    seen = unfitted_response(rate_hz, response, squared_current)
    return float(seen.frequency_hz[(np.abs(seen.data) * seen.frequency_hz).argmax()])


def current_of_voltage(rate_hz: float, voltage: np.ndarray, resistance: float, inductance: float) -> np.ndarray:
    """Return the current (n,) in A that a voltage (n,) in V drives through R in Ω and L in H, steady before the record.

    Exact for a voltage that is straight between samples.
    """
    settled = voltage / resistance
    if inductance == 0:
        return np.asarray(settled)
    from scipy.signal import lfilter

    z = -resistance / inductance / rate_hz
    late = (np.expm1(z) - z) / z
    inputs = -late * settled[1:] - (np.expm1(z) - late) * settled[:-1]
    return np.concatenate([settled[:1], lfilter([1.0], [1.0, -np.exp(z)], inputs, zi=[np.exp(z) * settled[0]])[0]])


# Records


def _record_lines(rate: float, y: np.ndarray, x: np.ndarray | None = None) -> MeasuredLines:
    """Return the spectral lines of a record `y` without its mean, with the excitation `x`, if any, as an input."""
    level = y - y.mean()
    time = np.linspace(-0.5, 0.5, len(y))
    late = [level * time, level * time**2, *([] if x is None else [(x - x.mean()) * time])]
    slow = np.array([np.fft.rfft(each)[1:-1] for each in late])
    data = np.fft.rfft(level)[1:-1]
    size = np.full(len(data), np.sqrt(np.mean(np.abs(data) ** 2)) or 1.0, complex)
    inputs = [size] if x is None else [np.fft.rfft(x - x.mean())[1:-1], size]
    return MeasuredLines(np.fft.rfftfreq(len(y), 1 / rate)[1:-1], data, np.array(inputs), len(y) / rate, slow)


class _Cross(NamedTuple):
    """Transfer function of a record over `frequency` (n,) in Hz, zero outside the excited band.

    `response` (n,) is complex, `impulse` (n,) its inverse transform; `low_hz` and `high_hz` are the band's ends. The
    transforms are twice as long as the record, so that lags of either sign stay apart.
    """

    frequency: np.ndarray
    response: np.ndarray
    impulse: np.ndarray
    low_hz: float
    high_hz: float


def _cross(rate: float, x: np.ndarray, y: np.ndarray) -> _Cross:
    """Return the transfer function from x to y in the band that x excites."""
    from scipy.fft import next_fast_len
    from scipy.ndimage import uniform_filter1d

    size = next_fast_len(2 * len(x))
    one, two = (np.fft.rfft(v - v.mean(), size) for v in (x, y))
    power = uniform_filter1d(np.abs(one) ** 2, max(size // 2000, 3))
    floor = EXCITED * power[2:].max()
    frequency = np.fft.fftfreq(size, 1 / rate)
    band = np.flatnonzero(power[2:-1] > floor) + 2
    if len(band) < 2:
        raise SolverError(
            "the excitation has no band of frequencies; sweep it, or leave its column out for a free decay"
        )
    response = np.zeros(size, complex)
    inside = slice(band[0], band[-1] + 1)
    response[inside] = two[inside] * one[inside].conj() / (np.abs(one[inside]) ** 2 + floor)
    low_hz, high_hz = frequency[band[[0, -1]]].tolist()
    return _Cross(frequency, response, np.fft.ifft(response), low_hz, high_hz)


def _lag(cross: _Cross, mode: np.ndarray | None = None) -> int:
    """Return the response's delay in samples: where impulse response, or its correlation with `mode`, peaks."""
    impulse = cross.impulse
    inside = cross.response != 0
    if mode is not None:
        matched = cross.response.copy()
        matched[inside] *= _mode(cross.frequency[inside], mode[0], mode[1], 0).conj()
        impulse = np.fft.ifft(matched)
    lag = int(np.abs(impulse).argmax())
    return lag - len(impulse) * (lag > len(impulse) // 2)


def _shifted(lag: int, x: np.ndarray, *late: np.ndarray) -> list[np.ndarray]:
    """Return x and the signals `late` shifted back by `lag` samples, all cut to the samples that they share."""
    count = max(len(x) - abs(lag), 0)
    kept = [x[max(-lag, 0) :][:count], *(v[max(lag, 0) :][:count] for v in late)]
    # A delay that leaves the answer to most of the excitation outside the record is one that chance has made.
    heard = count >= FEWEST_SAMPLES and np.sum(kept[0] ** 2) > np.sum(x**2) / 2
    if not heard or not (np.ptp(kept[0]) and np.ptp(kept[1])):
        raise SolverError(NO_ANSWER)
    return kept


def _gated(rate: float, cross: _Cross, lag: int, rings: float) -> MeasuredLines:
    """Return the spectrum of the impulse response, from `lag` to about 8 time constants (`rings` s each) later."""
    impulse = cross.impulse
    after = min(max(int(8 * rings * rate), FEWEST_SAMPLES), len(impulse) // 4)
    before = max(after // 16, 4)
    kept = np.roll(impulse, before - lag)[: before + after] * np.clip(np.linspace(4, 0, before + after), 0, 1)
    frequency = np.fft.fftfreq(2 * len(kept), 1 / rate)[: len(kept)]
    data = np.fft.fft(kept, 2 * len(kept))[: len(kept)] * np.exp(2j * np.pi * frequency * before / rate)
    inside = np.flatnonzero((frequency >= cross.low_hz / 1.1) & (frequency <= 1.1 * cross.high_hz) & (frequency > 0))
    away = np.roll(impulse, len(impulse) // 2 - lag)[: len(impulse) // 4]
    noise = float(np.sqrt(np.mean(np.abs(away) ** 2) * len(kept)))
    return MeasuredLines(frequency, data, np.ones((1, len(data))), noise=noise).at(inside)


def _recognised(lines: MeasuredLines, peaks: list[_Peak], near_hz: float | None, power: int | None) -> int | None:
    """Return the kind of sensor: 0 for displacement, 1 for velocity, 2 for acceleration, None where unclear.

    It is the slope of the response over the first peak's on logarithmic axes, above and below it, where other peaks and
    noise are small. A stated `power` is believed.
    """
    if power is not None:
        return power
    chosen, *others = sorted(peaks, key=lambda p: p is not _chosen(peaks, near_hz))
    s = lines.frequency / chosen.hz
    alone = chosen.size * np.abs(_mode(lines.frequency, chosen.hz, chosen.q, 0))
    good = (np.abs(lines.data) > SEEN * lines.noise) & (s > 1 / 3) & (s < 3)
    for other in others:
        good &= other.size * np.abs(_mode(lines.frequency, other.hz, other.q, 0)) < 0.3 * alone
    recognised: set[int | None] = set()
    for side in (s < 1, s > 1):
        log = np.log(s[good & side])
        over = np.log((np.abs(lines.data) / alone)[good & side])
        slope = float(np.polyfit(log, over, 1)[0]) if len(log) > 3 and np.ptp(log) > WIDE else np.nan
        recognised |= {n for n in range(3) if abs(slope - n) < 0.4} or {None}
    return recognised.pop() if len(recognised) == 1 else None


def _refuse_short(seconds: float, hz: float) -> None:
    """Refuse a record of too few periods."""
    if seconds * hz < FEWEST_PERIODS:
        raise SolverError(
            f"holds {number(float(seconds * hz))} periods of {number(hz)} Hz; record at least"
            f" {at_least(FEWEST_PERIODS / hz)} s"
        )


# The fit


def _mode(frequency: np.ndarray, hz: float, q: float, power: int) -> np.ndarray:
    """Return the response (n,) of a mode, of size 1 at its resonance, to a sensor of kind `power` (`SENSORS`)."""
    s = frequency / hz
    return np.asarray(s**power / (q * (1 - s) * (1 + s) + 1j * s))


def _basis(lines: MeasuredLines, theta: np.ndarray, power: int, extra: np.ndarray) -> np.ndarray:
    """Return the linear model's columns (n, k): modes of peak 1 and far-mode terms per input, then `fed`, `extra`."""
    s = lines.frequency / lines.frequency[len(lines.frequency) // 2]
    shapes = [_mode(lines.frequency, hz, q, power) for hz, q in np.exp(theta.reshape(-1, 2))]
    hz, q = np.exp(theta[:2])
    fed = [_mode(lines.frequency, hz, q, 0) * force for force in lines.fed]
    if lines.seconds:
        shapes += [(s - 1 / s) ** k for k in range(3)]
    else:
        shapes += [s**power, s ** (power - 2)]
    return np.concatenate([np.stack([*(x * shape for x in lines.inputs for shape in shapes), *fed], 1), extra], 1)


def _projected(basis: np.ndarray, data: np.ndarray) -> np.ndarray:
    """Return the residual of `data` (n,) or (n, p) after a least-squares fit by the columns of `basis`."""
    return _outside(_orthonormal(basis)[0], data)


def _orthonormal(basis: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return orthonormal columns (n, m), a triangle (m, k) and the columns' sizes (k,), m = min(n, k).

    Columns times triangle, each column times its size, are the `basis` (n, k).
    """
    size = np.linalg.norm(basis, axis=0)
    norm = np.where(size > 0, size, 1)
    return *np.linalg.qr(basis / norm), norm


def _outside(span: np.ndarray, data: np.ndarray) -> np.ndarray:
    """Return the part of `data` (n,) or (n, p) that is orthogonal to the orthonormal columns `span`."""
    return np.asarray(data - span @ (span.conj().T @ data))


def _parts(values: np.ndarray) -> np.ndarray:
    """Return the real parts, then the imaginary parts."""
    return np.concatenate([values.real, values.imag])


def _solve(
    lines: MeasuredLines, start: np.ndarray, power: int, extra: np.ndarray | None = None, tries: int = MOST_TRIES
) -> _Solved:
    """Minimise the residual of `lines` over ln f₀ and ln Q of each mode, from `start`, in at most `tries` steps."""
    from scipy.optimize import least_squares

    more = np.zeros((len(lines.data), 0)) if extra is None else extra
    size = float(np.linalg.norm(lines.data)) or 1.0
    low = np.tile(np.log([lines.frequency[0] / 1.5, LEAST_Q]), len(start) // 2)
    high = np.tile(np.log([lines.frequency[-1] * 1.5, LARGEST_Q]), len(start) // 2)
    first = np.clip(start, low + 1e-9, high - 1e-9)
    scale = np.ones(len(start))
    scale[::2] = np.exp(-first[1::2])

    @lru_cache(maxsize=1)
    def at(*v: float) -> tuple[_Solved, np.ndarray]:
        """Return the fit with modes at `v`, and orthonormal columns that span its basis."""
        theta = np.clip(first + scale * np.array(v), low, high)
        basis = _basis(lines, theta, power, more)
        span, triangle, norm = _orthonormal(basis)
        factors = np.linalg.lstsq(triangle, span.conj().T @ lines.data, rcond=1e-12)[0] / norm
        residual = lines.data - basis @ factors
        left = max(2 * len(lines.data) - len(theta) - 2 * len(factors), 1)
        noise = float(np.sqrt(2 * np.vdot(residual, residual).real / left))
        return _Solved(lines, theta, factors, basis, residual, noise, more), span

    def slopes(v: np.ndarray) -> np.ndarray:
        # L. Kaufman, BIT 15, 1975, 49-57: what is left out is orthogonal to the residual.
        fit, span = at(*v)
        return -_parts(_outside(span, _slopes(fit, power) * scale)) / size

    solution = least_squares(
        lambda v: _parts(at(*v)[0].residual) / size,
        np.zeros(len(first)),
        slopes,
        method="lm",
        ftol=1e-11,
        xtol=1e-9,
        max_nfev=tries,
    )
    return at(*solution.x)[0]


def _slopes(fit: _Solved, power: int) -> np.ndarray:
    """Return the derivatives (n, p) of the fitted data with respect to ln f₀ and ln Q of each mode."""
    lines = fit.lines
    slopes = []
    each = (len(fit.factors) - fit.extra.shape[1] - len(lines.fed)) // len(lines.inputs)
    for k, (hz, q) in enumerate(fit.modes):
        s = lines.frequency / hz
        mode = _mode(lines.frequency, hz, q, 0)
        whole = fit.factors[k : each * len(lines.inputs) : each] @ lines.inputs * s**power * mode
        if not k and len(lines.fed):
            whole = whole + fit.factors[fit.of_fed] @ lines.fed * mode
        slopes += [whole * ((1j - 2 * q * s) * s * mode - power), -whole * mode * q * (1 - s) * (1 + s)]
    return np.stack(slopes, 1)


def _real_columns(fit: _Solved, power: int, phased: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the fit's derivatives by all real parameters (caps last), and each one's noise over prior variance."""
    caps = np.zeros((len(fit.residual), 0)) if fit.caps is None else fit.caps
    columns = np.concatenate([_slopes(fit, power), fit.basis, *([1j * fit.basis] if phased else []), caps], 1)
    prior = np.zeros(columns.shape[1])
    prior[len(prior) - caps.shape[1] :] = fit.noise**2 / 2
    return columns, prior


def _covariance(fit: _Solved, power: int, phased: bool, unseen: np.ndarray) -> np.ndarray:
    """Return the covariance of theta, then the factors' real and their imaginary parts, by linear error propagation.

    The residual of each line is its own measure of noise, so that noise of any colour counts where it is. `unseen`
    (n, k) is what errors of one sigma, which the residual need not show, add to the data.
    """
    columns, prior = _real_columns(fit, power, phased)
    if not phased:  # the part along the model alone was measured
        columns = (columns * np.exp(-1j * np.angle(fit.lines.data))[:, None]).real
    norm = np.linalg.norm(columns, axis=0)
    norm = np.where(norm > 0, norm, 1)
    columns = columns / norm
    inverse = np.linalg.pinv((columns.conj().T @ columns).real + np.diag(prior / norm**2), rcond=1e-13, hermitian=True)
    plain = fit.noise**2 / 2 * inverse
    if fit.lines.seconds and len(fit.residual) > 4 * len(inverse):
        # A line that the model follows by itself leaves less residual than its noise (J. G. MacKinnon, H. White, J.
        # Econometrics 29, 1985, 305-325: HC3).
        followed = (columns.conj() @ inverse * columns).real.sum(1) / 2
        scores = (columns.conj() * (fit.residual / np.maximum(1 - followed, 0.5))[:, None]).real
        meat = scores.T @ scores
        for lag, share in ((1, 0.67), (2, 0.33)):
            across = scores[lag:].T @ scores[:-lag]
            meat += share * (across + across.T)
        robust = inverse @ meat @ inverse
        bigger = np.sqrt(np.maximum(np.diag(robust) / np.maximum(np.diag(plain), 1e-300), 1.0))
        plain = plain * np.outer(bigger, bigger)
    else:
        plain = plain * _correlation(fit.residual) ** 2
    moved = inverse @ (columns.conj().T @ unseen).real
    return np.asarray((plain + moved @ moved.T) / np.outer(norm, norm))


def _correlation(residual: np.ndarray) -> float:
    """Return the factor by which correlated noise widens the errors of a fit: 1 for white noise, at most 10.

    For a first-order process of lag-one correlation ρ it is √((1+ρ)/(1−ρ)); ρ within two sigma of 0 counts as 0.
    """
    power = float(np.vdot(residual, residual).real)
    rho = float(np.vdot(residual[:-1], residual[1:]).real) / power if power > 0 else 0.0
    return 1.0 if rho < 2 / np.sqrt(len(residual)) else float(min(np.sqrt((1 + rho) / max(1 - rho, 1e-3)), 10.0))


def _gain(fit: _Solved) -> float:
    """Return how much the modes lower the sum of squares, divided by the noise variance of one line's real part."""
    smooth = np.arange(fit.basis.shape[1]) >= len(fit.modes)
    smooth[fit.of_fed] = False
    plain = _projected(fit.basis[:, smooth], fit.lines.data)
    taken = float(np.vdot(plain, plain).real) - fit.cost
    return taken / max(max(fit.noise, fit.lines.noise) ** 2 / 2, np.finfo(float).tiny)


def _start(lines: MeasuredLines, rest: np.ndarray, power: int, peaks: list[_Peak]) -> tuple[float, float, float]:
    """Return frequency in Hz, Q and explained power of the mode that best explains `rest` (n,), away from `peaks`."""
    from scipy.ndimage import uniform_filter1d

    tried = []
    free = np.ones(len(rest), bool)
    for hz, q, _ in peaks:
        free &= np.abs(detuning(lines.frequency, hz, q)) > 2
    part = lines._replace(data=rest, fed=NOT_FED).at(np.flatnonzero(free))
    if len(part.data) < FEWEST_LINES:
        return 0.0, 1.0, 0.0
    for points in (each for each in SMOOTHED if each <= max(len(part.data) // 4, 1)):
        smooth = np.abs(uniform_filter1d(part.data.real, points) + 1j * uniform_filter1d(part.data.imag, points))
        for size in (smooth, smooth * part.frequency) if points == 1 else (smooth,):
            hz, width = rough_peak(part.frequency, size)
            tried += [(hz, min(max(hz / max(width, 1e-9 * hz) * k, LEAST_Q), LARGEST_Q)) for k in (0.5, 1, 2, 5)]
    best = 0.0, 1.0, 0.0
    for hz, q in tried:
        local = part.around(hz, q)
        basis = _basis(local, np.log([hz, q]), power, np.zeros((len(local.data), 0)))
        # The mode explains only what lies along its part that is orthogonal to the other columns.
        mode, unexplained = _projected(basis[:, 1:], np.stack([basis[:, 0], local.data], 1)).T
        taken = float(np.abs(np.vdot(mode, unexplained)) ** 2 / max(np.vdot(mode, mode).real, np.finfo(float).tiny))
        best = max(best, (hz, q, taken), key=lambda each: each[2])
    return best


def _shown(fit: _Solved) -> bool:
    """Return whether the first mode stands out of the noise and its peak is < 1.5 times the largest data near it."""
    near = np.abs(detuning(fit.lines.frequency, fit.modes[0, 0], fit.modes[0, 1])) < 1
    largest = np.abs(fit.lines.data / fit.lines.inputs[0])[near].max(initial=0.0)
    return bool(abs(fit.factors[0]) < 1.5 * largest and _gain(fit) > LEAST_GAIN)


def _peaks(lines: MeasuredLines, power: int) -> list[_Peak]:
    """Return the modes in a spectrum, a gated response or the transform of a decay, most powerful first."""
    if len(lines.data) < FEWEST_LINES:
        raise SolverError("is too short to show a resonance; record longer")
    rest = lines.data.copy()
    step = float(np.diff(lines.frequency).min())
    peaks = list[_Peak]()
    passed = list[_Peak]()
    for _ in range(MOST_MODES):
        hz, q, taken = _start(lines, rest, power, passed)
        if taken <= 0:
            break
        for _ in range(2):
            fit = _solve(lines._replace(data=rest).around(hz, q), np.log([hz, q]), power, tries=FIRST_TRIES)
            hz, q = fit.modes[0]
        passed.append(_Peak(float(hz), float(q), float(abs(fit.factors[0] * fit.lines.inputs[0].mean()))))
        inside = lines.frequency[0] < hz < lines.frequency[-1] and hz / q > 1.5 * step and q > FURTHER_Q
        if not peaks or (inside and _shown(fit) and passed[-1].size > LEAST_SHARE * peaks[0].size):
            peaks.append(passed[-1])
            rest = rest - fit.factors[0] * lines.inputs[0] * _mode(lines.frequency, hz, q, power)
    if not peaks:
        raise SolverError("shows no resonance; excite more, or leave this taxel out")
    return peaks


def _with_restored_crests(
    fit: _Solved, rate: float, y: np.ndarray, held: np.ndarray, power: int
) -> tuple[_Solved, np.ndarray]:
    """Return the fit of record `y` with clipped samples `held` restored by parabolic caps, and the restored record.

    Caps are parabolas. Their heights, about as large as y or less, are found with all else by least squares.
    """
    places = np.round(fit.lines.frequency * fit.lines.seconds).astype(int)
    at = np.flatnonzero(held)
    turn = -2j * np.pi * places / len(y)
    other = (np.diff(at) > rate / (4 * fit.modes[0, 0])) | (np.diff(np.sign(y[at])) != 0)
    crests = np.split(at, np.flatnonzero(other) + 1)
    shapes = np.zeros(len(y))
    count = min(len(crests), MOST_CAPS)
    label = np.zeros(len(y), int)
    caps = np.zeros((len(places), count), complex)
    for k, crest in enumerate(crests):
        middle = (crest[0] + crest[-1]) / 2
        half = (crest[-1] - crest[0] + 2) / 2
        shapes[crest] = np.abs(y).max() * np.sign(y[crest].sum()) * (1 - ((crest - middle) / half) ** 2)
        label[crest] = k * count // len(crests)
        caps[:, label[crest[0]]] -= np.exp(turn * middle) * (np.exp(np.outer(turn, crest - middle)) @ shapes[crest])
    heights = np.zeros(count)
    for _ in range(FILLED):
        columns, prior = _real_columns(fit._replace(caps=caps), power, True)
        seen = (columns.conj().T @ fit.residual).real
        seen[-count:] -= prior[-count:] * heights
        norm = np.sqrt((np.abs(columns) ** 2).sum(0) + prior)
        square = (columns.conj().T @ columns).real + np.diag(prior)
        step = np.linalg.lstsq(square / np.outer(norm, norm), seen / norm, rcond=1e-13)[0] / norm
        heights = heights + step[-count:]
        there = y + heights[label] * shapes
        lines = fit.lines._replace(data=np.fft.rfft(there)[places])
        fit = _solve(lines, fit.theta, power, fit.extra)
        if not _are_resolved(fit):  # a further mode was one of the clipped crests
            fit = _solve(lines, fit.theta[:2], power, fit.extra)
    return fit._replace(caps=caps), there


def _chosen(peaks: list[_Peak], near_hz: float | None, exact: bool = False) -> _Peak:
    """Return the comparably high (if `exact`: any) peak nearest to `near_hz`, or the highest one if that is None."""
    least = 0.0 if exact else COMPARABLE * max(p.size for p in peaks)
    return min(
        (peak for peak in peaks if peak.size >= least),
        key=lambda p: -p.size if near_hz is None else abs(np.log(p.hz / near_hz)),
    )


def _fit_peaks(
    lines: MeasuredLines,
    peaks: list[_Peak],
    near_hz: float | None,
    power: int,
    exact: bool = False,
    alone: bool = False,
) -> _Solved:
    """Fit one peak; if not `alone`, together with its neighbours and others that stand out of the residual."""
    chosen = _chosen(peaks, near_hz, exact)
    start = np.log([chosen.hz, chosen.q])
    others = [peak for peak in peaks if peak is not chosen]
    far = [p for p in others if abs(detuning(np.array(p.hz), chosen.hz, chosen.q)) >= REACH]
    close = [] if alone else [p for p in others if p not in far]
    for _ in range(3):
        hz, q = np.exp(start[:2])
        local = lines.around(hz, q, close)
        wings = [local.inputs[0] * _mode(local.frequency, p.hz, p.q, power) for p in far]
        fit = _solve(local, start, power, np.array(wings).reshape(-1, len(local.data)).T)
        if np.abs(fit.theta[:2] - start[:2]).max() < 0.05 / np.exp(start[1]):
            break
        start = fit.theta
    if local.slow is not None and len(local.slow) > 2:
        # In noise, a response that drifts is none that the model has; in a sweep it is, of a slightly other damping.
        drifts = local.slow[2] * _mode(local.frequency, fit.modes[0, 0], fit.modes[0, 1], power)
        left = _projected(np.concatenate([fit.basis, _slopes(fit, power)], 1), drifts)
        if np.linalg.norm(left) > 0.5 * np.linalg.norm(drifts):
            fit = _with_mains_lines(fit, power)
            slow = np.array([*local.slow[:2], local.slow[0] * local.frequency / local.frequency[0]]).T
            fit = _solve(local, fit.theta, power, np.concatenate([fit.extra, slow], 1))
    for peak in close:
        fit = _with_mains_lines(fit, power)
        fit = _better(fit, np.append(fit.theta, np.log([peak.hz, peak.q])), power, fit.extra) or fit
    if alone:
        return _with_mains_lines(fit, power)
    for _ in range(MOST_MODES):
        fit = _with_mains_lines(fit, power)
        size = np.abs(fit.residual)
        noise = float(np.median(size)) / np.sqrt(np.log(2))
        shown = size.max() >= noise * np.sqrt(np.log(len(size)) + 4) or _correlation(fit.residual) > 1
        if fit.noise < SMALLEST_NOISE * np.abs(local.data).max() or not shown:
            break
        hz, q, _ = _start(local, fit.residual, power, [])
        more = _better(fit, np.append(fit.theta, np.log([hz, q])), power, fit.extra) if hz else None
        if more is None:
            break
        fit = more
    fit = _with_mains_lines(fit, power)
    first = int(np.abs(np.log(fit.modes[:, 0] / near_hz)).argmin()) if exact and near_hz else 0
    if first:
        order = [first, *(k for k in range(len(fit.modes)) if k != first)]
        fit = _solve(fit.lines, fit.theta.reshape(-1, 2)[order].ravel(), power, fit.extra)
    return fit


def _may_be_bent(fit: _Solved, cubed: MeasuredLines, power: int) -> bool:
    """Return whether a cubic term in the spring explains what a linear spring alone does not.

    Further modes are left out: a peak that leans looks like two.
    """
    places = np.searchsorted(cubed.frequency, fit.lines.frequency)
    straight = _solve(fit.lines, fit.theta[:2], power, fit.extra) if len(fit.modes) > 1 else fit
    bent = _solve(fit.lines._replace(fed=cubed.fed[:, places]), straight.theta, power, fit.extra)
    return _is_worth(straight, bent)


def _is_worth(fit: _Solved, more: _Solved) -> bool:
    """Return whether a fit with more terms explains more than chance does."""
    return bool(fit.cost - more.cost > WORTH * more.noise**2 / 2)


def _with_mains_lines(fit: _Solved, power: int) -> _Solved:
    """Return the fit with columns added for the mains lines that stand out of the residual."""
    lines = fit.lines
    for _ in range(MOST_HUM):
        size = np.abs(fit.residual)
        off = [np.abs(lines.frequency - hz * np.maximum(np.round(lines.frequency / hz), 1)) for hz in MAINS_HZ]
        hum = size * (np.minimum(*off) < np.maximum(MAINS_OFF * lines.frequency, 1.01 * lines.step_hz))
        if hum.max() <= 3.5 * np.median(size) / np.sqrt(np.log(2)):
            break
        hz, q = fit.modes[0]
        line = _line_columns(fit, power, int(hum.argmax()), hz / q)
        more = _better(fit, fit.theta, power, np.concatenate([fit.extra, line], 1))
        if more is None:
            break
        fit = more
    return fit


def _better(fit: _Solved, theta: np.ndarray, power: int, extra: np.ndarray) -> _Solved | None:
    """Return a fit with modes `theta` and columns `extra`; None where it explains no more or a mode is not resolved."""
    if len(fit.residual) < fit.basis.shape[1] + 6:
        return None
    more = _solve(fit.lines, theta, power, extra)
    size = np.abs(more.factors[: len(more.modes)]) / np.abs(fit.factors[0])
    same = np.abs(more.theta[0] - fit.theta[0]) < 0.5 / more.modes[0, 1] and 0.5 < size[0] < 2
    is_clearer = same and (size[1:] < 2).all() and _are_resolved(more)
    return more if is_clearer and _is_worth(fit, more) else None


def _are_resolved(fit: _Solved) -> bool:
    """Return whether the modes lie apart, and all but the first lie within the lines and are wide enough to see."""
    hz, q = fit.modes.T
    step = fit.lines.step_hz
    width = np.maximum(hz / q, step)
    near = np.abs(hz[:, None] - hz) <= 0.5 * np.maximum.outer(width, width)
    inside = (hz > fit.lines.frequency[0]) & (hz < fit.lines.frequency[-1]) & (hz / q > 0.3 * step)
    return bool(near.sum() == len(hz) and inside[1:].all())


def _line_columns(fit: _Solved, power: int, place: int, width_hz: float) -> np.ndarray:
    """Return columns (n, k) for a sine of unsteady frequency near the `place`-th line; in a spectrum, for that point.

    They are neighbouring sines about that one which explains most of what neither the model nor its slopes do. Where a
    resonance of `width_hz` has lines to spare, the nearest ones are left out altogether.
    """
    lines = fit.lines
    hz = lines.frequency[place]
    if not lines.seconds:
        return np.asarray(lines.frequency == hz, float)[:, None]
    away = (hz - lines.frequency)[:, None] / lines.step_hz
    known = np.concatenate([fit.basis, _slopes(fit, power)], 1)
    together = (lines.inputs[lines.inputs[:, place] != 0] != 0).any(0)  # of the same tap, where there are several
    sines = _projected(known, _sines(away + CENTRES) * together[:, None])
    centre = CENTRES[(np.abs(sines.conj().T @ fit.residual) / np.linalg.norm(sines, axis=0)).argmax()]
    near = np.abs(away - np.array([-2, -1, 1, 2])) < 0.5
    spared = near[:, near.any(0)] if width_hz > SPARE * lines.step_hz else near[:, :0]
    waver = _sines(away + centre + np.array([-0.5, 0.0, 0.5]))
    return np.asarray(np.concatenate([waver, spared], 1) * together[:, None] * np.abs(lines.data).max())


def _sines(away: np.ndarray) -> np.ndarray:
    """Return a sine's Fourier transform at lines that lie `away` line spacings below it, in a record of length 1."""
    return np.asarray(np.sinc(away) * np.exp(1j * np.pi * away))


def _result(
    lines: MeasuredLines,
    fit: _Solved,
    peaks: list[_Peak],
    near_hz: float | None,
    power: int | None,
    phased: bool = True,
    clock: float = 0.0,
    seconds: float = np.inf,
) -> ResonanceFit:
    """Return the resonance by the fit and, as a check, by a circle fitted to the data without all other terms.

    `clock` is one sigma of the time's scale, which all methods have in common. A gain that drifts during the `seconds`
    of the whole record looks like damping.
    """
    n = power or 0
    hz, q = fit.modes[0]
    peak = float(abs(fit.factors[0]))
    others = [
        (float(f), float(abs(factor)))
        for (f, _), factor in zip(fit.modes[1:], fit.factors[1 : len(fit.modes)], strict=True)
    ]
    for far in peaks:
        # A peak of the first look counts where the record itself shows it.
        if all(abs(np.log(far.hz / f)) > 1 / far.q for f in fit.modes[:, 0]):
            seen = _fit_peaks(lines, peaks, far.hz, n, exact=True)
            if _shown(seen) and abs(np.log(seen.modes[0, 0] / far.hz)) < 1 / far.q:
                others.append((float(seen.modes[0, 0]), float(abs(seen.factors[0]))))
    if near_hz is None:
        refuse_ambiguous_peaks(hz, peak, tuple(others))
    late = np.zeros(len(fit.residual)) if fit.lines.slow is None else fit.lines.slow[0] * fit.lines.seconds
    unseen = np.stack([DRIFT / max(seconds, 1.0) * late, clock * 2j * np.pi * fit.lines.frequency * late], 1)
    # By what the largest motion shifts the resonance: 3/8 of the third power's part of the spring.
    bent = float(0.375 * np.abs(fit.factors[fit.of_fed]).sum() / q)
    place = len(fit.theta) + np.array([0, len(fit.factors) * phased])
    along = np.array([fit.factors[0].real, fit.factors[0].imag]) / peak
    errors = []
    for each in (0 * unseen, unseen):
        covariance = _covariance(fit, n, phased, each)
        sigma = np.sqrt(np.append(np.diag(covariance)[:2], along @ covariance[np.ix_(place, place)] @ along))
        errors.append((float(hz * np.hypot(sigma[0], BENT * bent)), float(q * sigma[1]), float(sigma[2])))
    lines = fit.lines
    drive = fit.lines.inputs[0]
    strong = np.abs(drive) > EXCITED * np.abs(drive).max()
    alone = fit.residual + fit.basis[:, 0] * fit.factors[0]
    s = lines.frequency[strong] / hz
    circle = None
    if phased:
        circle = circle_resonance(
            lines.frequency[strong], alone[strong] / drive[strong] / s**n, hz, q, 1 / (np.abs(drive[strong]) * s**n)
        )
    data = lines.data[strong] / drive[strong]
    left = fit.residual[strong] / drive[strong]
    needed = NEEDED if fit.lines.seconds else NEEDED_OF_SPECTRA
    agreed = judge_agreement(CircleFit(float(hz), errors[0][0], float(q), errors[0][1]), circle, needed)
    return ResonanceFit(
        resonance_hz=float(hz),
        resonance_error_hz=errors[1][0],
        q=float(q),
        q_error=errors[1][1],
        peak=peak,
        peak_error=errors[1][2],
        noise=fit.noise / float(np.abs(drive).mean()),
        check=circle,
        # A residual far above the scatter of neighbouring points is of another form.
        agree=agreed and not 0 < MOST_MISFIT * lines.noise < fit.noise,
        others=tuple(others),
        seen=Seen(lines.frequency[strong], data, data - left),
        power=power,
    )


# Spectra


def _with_phase(frequency: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return a magnitude (n,) with the phase of a minimum-phase response, by the Hilbert transform of its logarithm."""
    from scipy.signal import hilbert

    even = np.geomspace(frequency[0], frequency[-1], 4 * len(frequency))
    log = np.interp(even, frequency, np.log(np.maximum(size, 1e-6 * size.max())))
    phase = -np.imag(hilbert(np.concatenate([log[::-1], log, log[::-1]])))[len(even) : 2 * len(even)]
    return np.asarray(size * np.exp(1j * np.interp(frequency, even, phase)))


def _refit_to_magnitude(fit: _Solved, size: np.ndarray, power: int) -> _Solved:
    """Return a fit of the magnitudes `size` (n,) that starts from a complex one; its data have the model's phases.

    A magnitude in complex noise of rms N is on average larger by ``N²/4|H|`` (S. O. Rice, Bell Syst. Tech. J. 24,
    1945).
    """
    from scipy.optimize import least_squares

    count = len(fit.theta)
    scale = np.ones(len(fit.theta))
    lines = fit.lines
    scale[::2] = 1 / fit.modes[:, 1]
    most = float(size.max())

    def model(v: np.ndarray) -> np.ndarray:
        basis = _basis(lines, fit.theta + scale * np.clip(v[:count], -9, 9), power, fit.extra)
        return np.asarray(basis @ (v[count:] * most))

    # Far modes are without damping: all factors are real, up to one phase.
    polished = np.concatenate([np.zeros(count), (fit.factors * np.exp(-1j * np.angle(fit.factors[0]))).real / most])
    noise = 0.0
    data = size
    for _ in range(2):
        data = size - noise**2 / (4 * np.maximum(np.abs(model(polished)), noise or 1.0))
        polished = least_squares(
            lambda v, d=data: (np.abs(model(v)) - d) / most, polished, method="lm", max_nfev=1000
        ).x
        left = max(len(size) - len(polished), 1)
        noise = float(np.sqrt(2 * np.sum((np.abs(model(polished)) - data) ** 2) / left))
    theta = fit.theta + scale * np.clip(polished[:count], -9, 9)
    whole = model(polished)
    turned = lines._replace(data=data * np.exp(1j * np.angle(whole)))
    basis = _basis(lines, theta, power, fit.extra)
    return _Solved(turned, theta, polished[count:] * most, basis, turned.data - whole, noise, fit.extra)


def _refuse_phase(lines: MeasuredLines, fit: _Solved, power: int) -> None:
    """Refuse a phase that rises through the peak, or that shows no resonance."""
    if fit.noise < 0.05 * float(np.abs(lines.data).max()):
        return
    for data, what in (
        (
            lines.data.conj(),
            "the phase rises through the peak at {}, where that of a displacement falls by 180°: negate the phase or"
            " the imaginary part, or swap real and imaginary parts",
        ),
        (
            _with_phase(lines.frequency, np.abs(lines.data)),
            "the magnitude has a peak at {}, but the phase does not fall by 180° there as at a resonance; check that it"
            " is in degrees and of this taxel, or leave it out",
        ),
    ):
        other = lines._replace(data=data)
        other_fit = _fit_peaks(other, _peaks(other, power), None, power)
        hz = other_fit.modes[0, 0]
        inside = lines.frequency[[0, -1]]
        if max(other_fit.noise, lines.noise) < 0.5 * fit.noise and inside[0] < hz < inside[1]:
            raise SolverError(what.format(f"{number(float(hz))} Hz"))
