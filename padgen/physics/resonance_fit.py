"""Fit one resonance to measured data: frequency, Q and peak response, with one sigma of each.

The data are a spectrum, a record of the response to a known excitation, or a record of a free decay. All are fitted by
one model in frequency; a record by its Fourier transform:

    Y(f) = X Σ P / (Q (1 − s²) + j s) + a X + b X/s² + Σ free decays,   s = f/f₀

X is the transform of i², 1 for a spectrum and 0 for a free decay. a and b are contributions of modes far above and
below (D. J. Ewins, Modal Testing, 2nd ed. 2000, ch. 4). P, a, b are complex for a spectrum (any phase of the sensor).
The vibration of a mode at a record's start and at its end is a free decay of the mode's pole, whose transform is ``(1 −
e^{λT})/(1 − e^{(λ − jω)/rate})``; records need therefore be neither silent at their ends nor periodic. A drift is a
pole at 0.

The first method is least squares in all lines near the resonance. Further peaks that stand out of the residual become
modes of the model, so that a small one does not distort the taxel's own. The second method, as a check, is the circle
of `padgen.physics.circle_fit`. Magnitudes without phase are fitted by `padgen.physics.magnitude_fit`.

Noise is assumed equal and independent at all lines; where the residual is correlated, the errors are widened
(`correlation_factor`). Tested from Q = 2 to 10⁴, at 20 to 60 dB, in `tests/test_resonance_fit.py`.
"""

from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, at_least, at_most, number
from padgen.physics.circle_fit import circle_resonance
from padgen.physics.magnitude_fit import SeparableFit, correlation_factor, fit_magnitude, left_over, separable_fit
from padgen.physics.resonance_judge import (
    COMPARABLE,
    MOST_VAGUE,
    ResonanceFit,
    checked,
    point_noise,
    refuse_bad_record,
    refuse_bad_spectrum,
    refuse_edge,
    refuse_few,
    refuse_hidden,
    refuse_no_peak,
    refuse_no_resonance,
    refuse_two,
)

__all__ = ["current_of_voltage", "fit_decay", "fit_driven", "fit_spectrum", "rough_hz"]

MOST_MODES = 4
LEAST_Q, LARGEST_Q = 0.55, 1e7
SMOOTHED = (1, 5, 25, 125)
"""Numbers of lines over which a response is averaged to find its peak in noise."""
TRIED_Q = 12
WORTH = 40.0
"""Least decrease of the sum of squares by a further mode, in variances."""
SMALLEST_NOISE = 1e-9
"""Noise over the largest response that counts as rounding only."""
LONGEST, LONGEST_DECAY = 1 << 21, 1 << 20
"""Most samples used of a driven record and of a decay."""
MOST_LINES = 1 << 16
"""Most lines that are fitted; more would take minutes and gigabytes."""
BELOW, ABOVE, LEAST_ABOVE = 1 / 8, 12.0, 3.0
"""Lowest and highest line of a record that is fitted, over the resonance; the highest is LEAST_ABOVE for too many
lines.
"""
DECAY_TAUS, DECAY_PERIODS = 8.0, 10.0
"""Fitted length of a decay in time constants, and its minimum in periods; the rest is noise."""
FEWEST_PERIODS = 4.0
EXCITED = 1e-3
"""Power density at the edge of the excited band, over its largest."""
ROUGH_BAND = 64.0
"""Frequency that stands for the resonance in the first look for the excited band, in steps of a record's lines."""
MARGIN = 1.25
"""Factor by which lines are fitted beyond the excited band, to show a resonance outside of it."""


class Lines(NamedTuple):
    """Measured lines: `data` (n,) over `frequency` (n,) in Hz; `excitation` (n,), None for a free decay.

    `rate_hz` and the number of `samples` are those of a record, 0 for a spectrum.
    """

    frequency: np.ndarray
    data: np.ndarray
    excitation: np.ndarray | None
    rate_hz: float = 0.0
    samples: int = 0

    def between(self, low: float, high: float) -> "Lines":
        """Return the lines from `low` to `high` Hz."""
        keep = (self.frequency >= low) & (self.frequency <= high)
        excitation = None if self.excitation is None else self.excitation[keep]
        return self._replace(frequency=self.frequency[keep], data=self.data[keep], excitation=excitation)

    def own_columns(self, mode: int) -> np.ndarray:
        """Return the indices of a mode's columns in the basis: of its driven response, or of its free decay."""
        driven = self.samples and self.excitation is not None
        return np.array([3 * mode]) if driven else 2 * mode + np.arange(2)

    @property
    def step_hz(self) -> float:
        """Distance of a record's lines in Hz; 0 for a spectrum."""
        return self.rate_hz / self.samples if self.samples else 0.0


class Mode(NamedTuple):
    """The chosen resonance of a fit: its index, frequency in Hz, Q and peak; and the other peaks (Hz, amplitude)."""

    place: int
    hz: float
    q: float
    peak: float
    others: tuple[tuple[float, float], ...]


def fit_spectrum(frequency_hz: np.ndarray, response: np.ndarray, near_hz: float | None = None) -> ResonanceFit:
    """Fit a complex `response` (n,) over rising `frequency_hz` (n,).

    Of several comparable peaks the one nearest to `near_hz` is taken; without `near_hz` they are refused.

    Raises
    ------
    SolverError
        No peak, one at an end of the sweep, two comparable ones, too few points in it, or a phase that rises.
    """
    frequency, data = np.asarray(frequency_hz, float), np.asarray(response, complex)
    refuse_bad_spectrum(frequency, data)
    lines = Lines(frequency, data, np.ones(len(data)))
    fit = _fit_modes(lines, _peak_candidates(lines))
    _refuse_phase(lines, fit)
    mode = _chosen_mode(lines, fit, near_hz)
    noise = point_noise(data)
    refuse_no_peak(mode.peak, fit.noise, _gain(lines, fit), frequency, np.abs(data))
    refuse_no_resonance(np.abs(data), fit.noise, noise, mode.hz)
    refuse_edge(frequency[0], frequency[-1], mode.hz, mode.q)
    refuse_few(frequency, mode.hz, mode.q)
    inside = tuple(other for other in mode.others if frequency[0] < other[0] < frequency[-1])
    return _with_circle_check(lines, fit, mode._replace(others=inside), fit.noise, near_hz)


def fit_driven(
    rate_hz: float, squared_current: np.ndarray, displacement: np.ndarray, near_hz: float | None = None
) -> ResonanceFit:
    """Fit the response `displacement` (n,) to `squared_current` (n,); `peak` is per unit of a line of the latter.

    `near_hz` is the planned resonance, where the search starts; all of the excited band is searched.

    Raises
    ------
    SolverError
        No response, two comparable resonances, a resonance at an end of the excited band, or too short a record.
    """
    x, y = np.asarray(squared_current, float), np.asarray(displacement, float)
    refuse_bad_record(y)
    if np.ptp(x) == 0:
        raise SolverError("the excitation does not change; leave its column out for a free decay")
    _refuse_long(len(y), LONGEST, rate_hz)
    low, high, _ = _excited_band(rate_hz, x, ROUGH_BAND * rate_hz / len(x))
    whole = _lines_of(rate_hz, y, x).between(low / MARGIN, high * MARGIN)
    starts = _peak_candidates(whole)
    if near_hz is not None and near_hz < 0.4 * rate_hz:
        starts.append(near_hz)
    lines = whole.between(BELOW * min(starts), ABOVE * max(starts))
    if len(lines.data) > MOST_LINES:
        lines = whole.between(BELOW * min(starts), LEAST_ABOVE * max(starts))
        _refuse_long(len(lines.data), MOST_LINES, len(lines.data) * lines.step_hz)
    fit = _fit_modes(lines, starts)
    mode = _chosen_mode(lines, fit, near_hz)
    _refuse_short(len(y) / rate_hz, mode.hz)
    own = 3 * mode.place + np.arange(3)
    spectrum = np.zeros(len(y) // 2 + 1, dtype=complex)
    first = round(lines.frequency[0] / lines.step_hz)
    spectrum[first : first + len(lines.data)] = _basis(lines, fit.theta)[:, own] @ fit.coefficients[own]
    answer = float(np.abs(np.fft.irfft(spectrum, len(y))).max())
    noise = _sample_noise(lines, fit)
    refuse_hidden(answer, noise, _gain(lines, fit), "answer to the excitation")
    lower, upper, step = _excited_band(rate_hz, x, mode.hz)
    # The finer look may mistake drift for excitation, and the coarser one is uncertain by its step.
    refuse_edge(max(low + step, lower), max(high, upper), mode.hz, mode.q, "the excited band", "the excitation", step)
    return _with_circle_check(lines, fit, mode, noise * mode.peak / answer, near_hz)


def fit_decay(rate_hz: float, displacement: np.ndarray, near_hz: float | None = None) -> ResonanceFit:
    """Fit the free decay in `displacement` (n,) after its largest value; `peak` is about its amplitude there.

    Raises
    ------
    SolverError
        No decay, two comparable sines in it (unless `near_hz` selects one), or too short a record.
    """
    y = np.asarray(displacement, float)
    refuse_bad_record(y)
    first = _largest(y)
    if first > 0.8 * len(y):
        raise SolverError(
            f"is largest {number(first / rate_hz)} s into a record of {number(len(y) / rate_hz)} s: a free decay starts"
            " at its largest value; if there was an excitation, add it as a column"
        )
    y = y[first : first + LONGEST_DECAY]
    whole = _lines_of(rate_hz, y)
    hz, q = _start(whole.between(0, ABOVE * _peak_candidates(whole)[0]), _peak_candidates(whole)[:1])
    seconds = max(min(DECAY_TAUS * q / (np.pi * hz), MOST_LINES / (ABOVE * hz)), DECAY_PERIODS / hz)
    y = y[: int(seconds * rate_hz) + 1]
    _refuse_short(len(y) / rate_hz, hz)
    lines = _lines_of(rate_hz, y).between(BELOW * hz, ABOVE * hz)
    fit = _fit_modes(lines, [hz])
    mode = _chosen_mode(lines, fit, near_hz)
    noise = _sample_noise(lines, fit)
    refuse_hidden(mode.peak, noise, _gain(lines, fit), "free decay")
    return _with_circle_check(lines, fit, mode, noise, near_hz)


def rough_hz(rate_hz: float, displacement: np.ndarray, squared_current: np.ndarray | None = None) -> float:
    """Estimate the resonance in Hz: the largest velocity per excitation, or the largest line of a free decay."""
    if squared_current is not None:
        return _peak_candidates(_lines_of(rate_hz, displacement, squared_current))[0]
    return _peak_candidates(_lines_of(rate_hz, displacement[_largest(displacement) :][:LONGEST_DECAY]))[0]


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


def _lines_of(rate: float, y: np.ndarray, x: np.ndarray | None = None) -> Lines:
    """Return the lines of a record, without its mean."""
    data, excitation = (None if v is None else np.fft.rfft(v - v.mean(dtype=float))[1:-1] for v in (y, x))
    assert data is not None
    return Lines(np.fft.rfftfreq(len(y), 1 / rate)[1:-1], data, excitation, rate, len(y))


def _largest(y: np.ndarray) -> int:
    """Return the index at which a signal is farthest from its mean."""
    middle = y.mean(dtype=float)
    return max(int(y.argmax()), int(y.argmin()), key=lambda k: abs(float(y[k]) - middle))


def _peak_candidates(lines: Lines) -> list[float]:
    """Return frequencies in Hz to start at: the largest averaged mobility and the largest explained power."""
    from scipy.ndimage import uniform_filter1d

    data, found = lines.data, [float(lines.frequency[np.abs(lines.data).argmax()])]
    if lines.excitation is None:
        return found
    cross, power = data * lines.excitation.conj(), np.abs(lines.excitation) ** 2
    sizes = [points for points in SMOOTHED if points <= max(len(data) // 4, 1)]
    if lines.samples:
        sizes, found = [max(len(data) // 1000, 3)], []
    for points in sizes:
        over = np.abs(uniform_filter1d(cross, points, mode="constant"))
        under = np.maximum(uniform_filter1d(power, points, mode="constant"), 0)
        under += EXCITED * under.max()
        found += [float(lines.frequency[size.argmax()]) for size in (over / under * lines.frequency, over**2 / under)]
    return found


def _start(lines: Lines, tops: list[float], before: np.ndarray | None = None) -> np.ndarray:
    """Return frequency in Hz and Q of the mode, tried at `tops`, that leaves least beside the modes `before`."""
    finest = lines.step_hz / 10 or float(np.diff(lines.frequency).min())
    kept: list[float] = []
    for hz in tops:
        if all(abs(hz - other) > max(finest, 1e-3 * hz) for other in kept):
            kept.append(hz)
    tried = [(hz, q) for hz in kept for q in np.geomspace(1.0, max(2 * hz / finest, 4.0), TRIED_Q)]
    known = np.empty(0) if before is None else before
    left = [np.linalg.norm(left_over(_basis(lines, np.append(known, np.log(each))), lines.data)) for each in tried]
    return np.array(tried[int(np.argmin(left))])


def _fit_modes(lines: Lines, tops: list[float]) -> SeparableFit:
    """Fit modes one after the other, at the peaks of the residual, as long as each is worth its parameters."""
    fit = _least_squares(lines, np.log(_start(lines, tops)))
    for _ in range(MOST_MODES - 1):
        numbers = (len(fit.covariance) + 5) / 2
        rounding = fit.noise < SMALLEST_NOISE * np.abs(lines.data).max()
        if rounding or len(lines.data) < numbers or not _has_structure(fit):
            break
        start = _start(lines, _peak_candidates(lines._replace(data=fit.residual)), fit.theta)
        more = _least_squares(lines, np.concatenate([fit.theta, np.log(start)]))
        if not _is_better(lines, fit, more):
            break
        fit = more
    return fit


def _least_squares(lines: Lines, start: np.ndarray) -> SeparableFit:
    """Fit all modes together, from `start` in ln f₀ and ln Q of each."""
    low, high = lines.frequency[0] / 3, lines.frequency[-1] * (1 if lines.samples else 3)
    bounds = tuple(np.tile(np.log(pair), len(start) // 2) for pair in ((low, LEAST_Q), (high, LARGEST_Q)))
    scale = np.ones(len(start))
    scale[::2] = np.exp(-start[1::2])
    return separable_fit(lambda theta: _basis(lines, theta), lines.data, start, scale, (bounds[0], bounds[1]))


def _basis(lines: Lines, theta: np.ndarray) -> np.ndarray:
    """Return the columns of each mode, of peak 1, then of far modes and a drift; their factors are real."""
    frequency, x, columns = lines.frequency, lines.excitation, []
    for hz, q in np.exp(theta.reshape(-1, 2)):
        s = frequency / hz
        if x is not None:
            answer = x / (q * (1 - s) * (1 + s) + 1j * s)
            columns += [answer] if lines.samples else [answer, 1j * answer]
        if lines.samples:
            pole = 2 * np.pi * hz * complex(-1 / (2 * q), np.sqrt(1 - 1 / (4 * q * q)))
            one, other = (_free(lines, p) for p in (pole, pole.conjugate()))
            columns += [(one + other) / 2, (one - other) / 2j]
    if x is not None:
        share = frequency[0] * frequency[-1] / frequency**2
        far = [x, x * share]
        columns += [*far, x / share] if lines.samples else [*far, 1j * far[0], 1j * far[1]]
    if lines.samples:
        columns.append(1 / np.expm1(-2j * np.pi * frequency / lines.rate_hz))
    return np.stack(columns, axis=1).astype(complex)


def _free(lines: Lines, pole: complex) -> np.ndarray:
    """Return the transform (n,) of the samples of e^{λt} from the start of a record to its end."""
    z = (pole - 2j * np.pi * lines.frequency) / lines.rate_hz
    return np.asarray(np.expm1(pole * lines.samples / lines.rate_hz) / np.expm1(z))


def _has_structure(fit: SeparableFit) -> bool:
    """Return whether the residual stands out of white noise somewhere, or is correlated between neighbours."""
    highest = float(np.abs(fit.residual).max()) ** 2
    # The square of complex noise exceeds m times its mean with probability exp(-m).
    return highest > fit.noise**2 * (np.log(len(fit.residual)) + 4) or correlation_factor(fit.residual) > 1


def _is_better(lines: Lines, fit: SeparableFit, more: SeparableFit) -> bool:
    """Return whether a further mode is worth its four parameters, resolved, and apart from the others."""
    before, after = (float(np.linalg.norm(f.residual)) ** 2 for f in (fit, more))
    if before - after < WORTH * more.noise**2 / 2:
        return False
    hz, q = np.exp(more.theta.reshape(-1, 2)).T
    width = np.maximum(hz / q, lines.step_hz)
    near = np.abs(hz[:, None] - hz) <= 0.5 * np.maximum.outer(width, width)
    resolved = lines.samples or ((np.abs(lines.frequency[:, None] - hz) <= width).sum(0) >= 3).all()
    placed = np.sqrt(np.diag(more.covariance))[: 2 * len(hz) : 2] <= MOST_VAGUE / q
    return bool(resolved and placed.all() and near.sum() == len(hz))


def _chosen_mode(lines: Lines, fit: SeparableFit, near_hz: float | None) -> Mode:
    """Return the largest mode; with `near_hz`, the nearest to it among modes of comparable size."""
    hz, q = np.exp(fit.theta.reshape(-1, 2)).T
    peak = np.array([np.linalg.norm(fit.coefficients[lines.own_columns(k)]) for k in range(len(hz))])
    away = -peak if near_hz is None else np.abs(np.log(hz / near_hz))
    main = int(np.where(peak >= COMPARABLE * peak.max(), away, np.inf).argmin())
    others = tuple((float(hz[k]), float(peak[k])) for k in range(len(hz)) if k != main)
    return Mode(main, float(hz[main]), float(q[main]), float(peak[main]), others)


def _gain(lines: Lines, fit: SeparableFit) -> float:
    """Return the decrease of the sum of squares by all modes, in variances of the real or imaginary part of a point."""
    plain = left_over(_basis(lines, np.empty(0)), lines.data)
    taken = float(np.linalg.norm(plain)) ** 2 - float(np.linalg.norm(fit.residual)) ** 2
    return taken / max(fit.noise**2 / 2, np.finfo(float).tiny)


def _sample_noise(lines: Lines, fit: SeparableFit) -> float:
    """Return the root mean square noise of a record's samples in the band of the fitted lines."""
    return fit.noise * float(np.sqrt(2 * len(lines.data))) / lines.samples


def _with_circle_check(
    lines: Lines, fit: SeparableFit, mode: Mode, noise: float, near_hz: float | None
) -> ResonanceFit:
    """Return the least-squares result beside the circle's, which is fitted to the data without all other terms."""
    if near_hz is None:
        refuse_two(mode.hz, mode.peak, mode.others)
    widened, own = correlation_factor(fit.residual), lines.own_columns(mode.place)
    sigma = widened * np.sqrt(np.diag(fit.covariance))
    along, place = fit.coefficients[own] / mode.peak, len(fit.theta) + own
    peak_error = widened * float(np.sqrt(along @ fit.covariance[np.ix_(place, place)] @ along))
    alone, spread = fit.residual + _basis(lines, fit.theta)[:, own] @ fit.coefficients[own], np.ones(1)
    frequency = lines.frequency
    if lines.excitation is not None:
        strong = np.abs(lines.excitation) > EXCITED * np.abs(lines.excitation).max()
        spread = 1 / np.abs(lines.excitation[strong])
        frequency, alone = frequency[strong], alone[strong] / lines.excitation[strong]
    circle = circle_resonance(frequency, alone, mode.hz, mode.q, spread, lines.excitation is None)
    errors = float(mode.hz * sigma[2 * mode.place]), float(mode.q * sigma[2 * mode.place + 1])
    return checked((mode.hz, mode.q, mode.peak), (*errors, peak_error), noise, "circle", circle, mode.others)


def _excited_band(rate: float, x: np.ndarray, hz: float) -> tuple[float, float, float]:
    """Return the ends in Hz of the band with the squared current's power, and the resolution in Hz."""
    from scipy.signal import welch

    frequency, power = welch(x - x.mean(), rate, nperseg=min(len(x), max(int(8 * rate / hz), 64)))
    band = frequency[power > EXCITED * power[1:].max()]
    return float(band[band > 0].min()), float(band.max()), float(frequency[1])


def _refuse_phase(lines: Lines, fit: SeparableFit) -> None:
    """Refuse a phase that rises through the peak, or that shows no resonance."""
    if fit.noise < 0.05 * np.abs(lines.data).max():
        return
    turned = lines._replace(data=lines.data.conj())
    other = _least_squares(turned, np.log(_start(turned, _peak_candidates(turned))))
    if other.noise < 0.5 * fit.noise:
        raise SolverError(
            f"the phase rises through the peak at {number(float(np.exp(other.theta[0])))} Hz, where that of a"
            " displacement falls by 180°: negate the phase or the imaginary part, or swap real and imaginary parts"
        )
    try:
        alone = fit_magnitude(lines.frequency, np.abs(lines.data))
    except SolverError:
        return
    if alone.noise < 0.5 * fit.noise:
        raise SolverError(
            f"the magnitude has a peak at {number(alone.resonance_hz)} Hz, but the phase does not fall by 180°"
            " there as at a resonance; check that it is in degrees and of this taxel, or leave it out"
        )


def _refuse_long(count: int, most: int, rate: float) -> None:
    """Refuse more samples or lines than are fitted."""
    if count > most:
        raise SolverError(
            f"lasts {number(count / rate)} s; at most {at_most(most / rate)} s of it can be fitted: cut it to the part"
            " in which the excitation passes the resonance and the response rings"
        )


def _refuse_short(seconds: float, hz: float) -> None:
    """Refuse a record of too few periods."""
    if seconds * hz < FEWEST_PERIODS:
        raise SolverError(
            f"holds {number(float(seconds * hz))} periods of {number(hz)} Hz; record at least"
            f" {at_least(FEWEST_PERIODS / hz)} s"
        )
