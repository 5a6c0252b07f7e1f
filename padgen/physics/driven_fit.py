"""One resonance from the record of its answer to a known excitation: least squares in time, and a circle.

    y'' + (ω₀/Q) y' + ω₀² y = P (ω₀²/Q) x,   y = Im(K w),   w' = λ w + x

x is the square of the current. It is taken as straight between samples and propagated exactly; beforehand its lines are
raised by 1/sinc²(f/rate), which is what the straight lines take off them. Beside it are a decay from before the
record, the answer ``a x`` of modes far above, a constant and a drift. The second method is the circle of the transfer
function Y/X of the whole record, to which what rings on after its end is added by the fit. Noise is taken as white.
"""

import numpy as np

from padgen.core.errors import SolverError, at_most, number
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

__all__ = ["current_of_voltage", "fit_driven", "rough_answer_hz"]

LONGEST = 1 << 21
"""Samples that are looked at, before they are thinned to those that are fitted."""
LEAST_PER_PERIOD = 6.0
"""Samples of a period that are enough where a record is long."""
WIDEST = 64.0
"""Half bandwidths about a resonance in which its circle is looked for."""
STEP = 1e-6
"""Of ln f₀ and ln Q, in the slopes."""


def fit_driven(
    rate_hz: float, squared_current: np.ndarray, displacement: np.ndarray, near_hz: float | None = None
) -> ResonanceFit:
    """Fit the answer `displacement` (n,) to `squared_current` (n,); `peak` is per unit of a line of the latter.

    `near_hz` is where to look first, the planned resonance; all of the excited band is looked at.

    Raises
    ------
    SolverError
        No answer, two comparable resonances, a resonance at an end of the excited band, or too short a record.
    """
    x, y = np.asarray(squared_current, float), np.asarray(displacement, float)
    refuse_record(y)
    if np.ptp(x) == 0:
        raise SolverError("the excitation does not change; leave its column out for a free decay")
    _refuse_long(len(y), LONGEST, rate_hz)
    starts = _driven_starts(rate_hz, x, y, near_hz)
    x, y, rate = _filtered(x, y, rate_hz, max(starts))
    _refuse_long(len(y), MOST_SAMPLES, rate)
    time = np.arange(len(y)) / rate
    fit = _driven_fit(time, _raised(x), y, starts)
    refuse_short(time[-1], float(np.exp(fit.theta[0])))
    return _driven_result(rate, time, x, y, fit, near_hz)


def _refuse_long(count: int, most: int, rate: float) -> None:
    if count > most:
        raise SolverError(
            f"lasts {number(count / rate)} s; at most {at_most(most / rate)} s of it can be fitted: cut it to those in"
            " which the excitation passes the resonance and the answer rings"
        )


def _raised(x: np.ndarray) -> np.ndarray:
    """x (n,) with each line over sinc²(f/rate)."""
    spectrum = np.fft.rfft(x, 2 * len(x))
    return np.asarray(np.fft.irfft(spectrum / np.sinc(np.fft.rfftfreq(2 * len(x))) ** 2)[: len(x)])


def _driven_starts(rate: float, x: np.ndarray, y: np.ndarray, near_hz: float | None) -> list[float]:
    """Where to look: where the excitation explains most of the answer, where the mobility is largest, the plan's."""
    from scipy.signal import oaconvolve

    count = 2 * len(y)
    frequency = np.fft.rfftfreq(count, 1 / rate)[1:]
    one, two = (np.fft.rfft(part - part.mean(), count)[1:] for part in (x, y))
    points = max(count // 2000, 3)
    kernel = np.ones(points) / points
    cross = np.abs(oaconvolve(two * one.conj(), kernel, "same"))
    power = np.maximum(oaconvolve(np.abs(one) ** 2, kernel, "same"), 0.0)
    power += 1e-3 * power.max()
    tops = [float(frequency[int(size.argmax())]) for size in (cross**2 / power, cross / power * frequency)]
    inside = [near_hz] if near_hz is not None and near_hz < 0.4 * rate else []
    return [min(hz, 0.4 * rate) for hz in (*tops, *inside)]


def _filtered(x: np.ndarray, y: np.ndarray, rate: float, hz: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Both through the same zero-phase filter to fewer samples, which keeps what the one makes of the other."""
    from scipy.signal import resample_poly

    fewer = min(-(-len(y) // MOST_SAMPLES), int(rate / (LEAST_PER_PERIOD * hz)))
    many = max(int(rate / (SAMPLES_PER_PERIOD * hz)), fewer)
    if many < 2:
        return x, y, rate
    return resample_poly(x, 1, many, padtype="line"), resample_poly(y, 1, many, padtype="line"), rate / many


def _driven_fit(time: np.ndarray, x: np.ndarray, y: np.ndarray, starts: list[float]) -> SeparableFit:
    tried = [(hz, float(q)) for hz in starts for q in np.geomspace(1.5, max(20 * hz * time[-1], 4.0), 8)]
    flat, left = _flat(time, x), []
    for hz, q in tried:
        basis = np.concatenate([_driven_mode(time, x, np.log([hz, q])), flat], axis=1)
        left.append(float(np.linalg.norm(y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0])))
    fit = _driven_from(time, x, y, np.log(tried[int(np.argmin(left))]))
    for _ in range(MOST_MODES - 1):
        if fit.noise < 1e-9 * np.abs(y).max() or len(y) < 40 or not structured(fit):
            break
        start = _next_mode(time, x, fit)
        more = _driven_from(time, x, y, np.concatenate([fit.theta, start]))
        if not worth_a_mode(more, fit, time[-1]):
            break
        fit = more
    return fit


def _driven_from(time: np.ndarray, x: np.ndarray, y: np.ndarray, start: np.ndarray) -> SeparableFit:
    low = np.tile(np.log([0.2 / time[-1], LEAST_Q]), len(start) // 2)
    high = np.tile(np.log([0.45 / time[1], LARGEST_Q]), len(start) // 2)
    return separable_fit(lambda theta: _driven_basis(time, x, theta), y, start, low, high)


def _next_mode(time: np.ndarray, x: np.ndarray, fit: SeparableFit) -> np.ndarray:
    """Where what is left answers the excitation most, and the Q of the mode there."""
    hz = _driven_starts(1 / time[1], x, fit.residual, None)[0]
    return np.log([min(hz, 0.4 / time[1]), float(np.exp(fit.theta[1]))])


def _driven_basis(time: np.ndarray, x: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each mode its answer of peak 1 and its decay (2); x, constant, drift; slopes by differences."""
    modes = [_driven_mode(time, x, pair) for pair in theta.reshape(-1, 2)]
    base = np.concatenate([*modes, _flat(time, x)], axis=1)
    slopes = np.zeros((len(theta), *base.shape))
    for k in range(len(theta)):
        own = k // 2
        moved = theta.reshape(-1, 2)[own] + STEP * np.eye(2)[k % 2]
        slopes[k, :, 3 * own : 3 * own + 3] = (_driven_mode(time, x, moved) - modes[own]) / STEP
    return base, slopes


def _flat(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.stack([x, np.ones(len(x)), time / time[-1] - 0.5], axis=1)


def _driven_mode(time: np.ndarray, x: np.ndarray, theta: np.ndarray) -> np.ndarray:
    pole = complex(poles(theta)[0][0])
    omega, q = 2 * np.pi * np.exp(theta[0]), np.exp(theta[1])
    answer = (omega**2 / q / pole.imag) * _answer(pole, x, time[1]).imag
    wave = np.exp(pole * time)
    return np.stack([answer, wave.real, wave.imag], axis=1)


def _answer(pole: complex | float, x: np.ndarray, step: float) -> np.ndarray:
    """w (n,) of ``w' = λ w + x`` from rest, x straight between samples: exact."""
    from scipy.signal import lfilter

    z = pole * step
    grown = np.exp(z)
    late = (np.expm1(z) - z) / z**2
    early = np.expm1(z) / z - late
    inputs = step * (early * np.concatenate([[0.0], x[:-1]]) + late * np.concatenate([[0.0], x[1:]]))
    return np.asarray(lfilter([1.0], [1.0, -grown], inputs))


def _driven_result(
    rate: float, time: np.ndarray, x: np.ndarray, y: np.ndarray, fit: SeparableFit, near_hz: float | None
) -> ResonanceFit:
    count = len(fit.theta) // 2
    all_hz, all_q = np.exp(fit.theta[::2]), np.exp(fit.theta[1::2])
    all_peak = np.abs(fit.coefficients[: 3 * count : 3])
    main = main_mode(all_hz, all_peak, near_hz)
    hz, q, peak = float(all_hz[main]), float(all_q[main]), float(all_peak[main])
    basis, _ = _driven_basis(time, _raised(x), fit.theta)
    answer = float(np.abs(basis[:, 3 * main] * fit.coefficients[3 * main]).max())
    flat = basis[:, 3 * count :]
    plain = float(np.sum((y - flat @ np.linalg.lstsq(flat, y, rcond=None)[0]) ** 2))
    gain = (plain - float(fit.residual @ fit.residual)) / max(fit.noise**2, np.finfo(float).tiny)
    refuse_noise(answer, fit.noise, gain, "answer to the excitation")
    _refuse_unexcited(rate, x, hz, q)
    others = tuple((float(all_hz[k]), float(all_peak[k])) for k in range(count) if k != main)
    if near_hz is None:
        refuse_two(hz, peak, others)
    alone = fit.residual + basis[:, 3 * main] * fit.coefficients[3 * main]
    circle = _driven_circle(rate, x, alone, hz, q, float(fit.coefficients[3 * main]))
    place = 2 * count + 3 * main
    error = float(np.sqrt(fit.covariance[place, place]))
    return record_result(fit, main, peak, error, circle, others, fit.noise * peak / answer)


def _driven_circle(rate: float, x: np.ndarray, alone: np.ndarray, hz: float, q: float, size: float) -> CircleFit | None:
    """The circle of Y/X of the whole record, `size` the fit's peak by which what rings on after its end is added."""
    pole = complex(poles(np.log([hz, q]))[0][0])
    times = max(int(np.ceil(4 * q / hz / (len(alone) / rate))), 1)
    frequency, (one, two) = _lines(rate, (x, alone), times, hz, q)
    gain = size * (2 * np.pi * hz) ** 2 / q / pole.imag
    last = _answer(pole, _raised(x), 1 / rate)[-1]
    # After the end y = Im(g w e^{λ t}), sampled: a geometric series for each half.
    turn = np.exp(-2j * np.pi * frequency / rate)
    grown = np.exp(pole / rate)
    later = (
        turn ** len(alone)
        * gain
        / 2j
        * (last * grown / (1 - grown * turn) - np.conj(last * grown) / (1 - np.conj(grown) * turn))
    )
    two = two + later
    strong = np.abs(one) > 1e-3 * np.abs(np.fft.rfft(x)[1:]).max()
    if strong.sum() < 8:
        return None
    found = circle_resonance(
        frequency[strong], (two / np.where(one == 0, 1, one))[strong], hz, q, 1 / np.abs(one[strong])
    )
    if found is None:
        return None
    # Points between those of the record's own length are no new ones.
    wider = np.sqrt(times)
    return found._replace(resonance_error_hz=found.resonance_error_hz * wider, q_error=found.q_error * wider)


def _lines(
    rate: float, signals: tuple[np.ndarray, np.ndarray], times: int, hz: float, q: float
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Transforms of two signals (n,) at multiples of 1/(`times` their length): all of them, or those about `hz`."""
    from scipy.signal import zoom_fft

    count = len(signals[0]) * times
    if times == 1:
        return np.fft.rfftfreq(count, 1 / rate)[1:], [np.fft.rfft(signal)[1:] for signal in signals]
    step, reach = rate / count, hz * WIDEST / (2 * q)
    first = max(int((hz - reach) / step), 1)
    last = min(int((hz + reach) / step), count // 2) + 1
    band = [first * step, last * step]
    return step * np.arange(first, last), [zoom_fft(signal, band, last - first, fs=rate) for signal in signals]


def _refuse_unexcited(rate: float, x: np.ndarray, hz: float, q: float) -> None:
    """Refuse a resonance outside, or at an end of, the band in which the squared current has its power."""
    from scipy.signal import welch

    frequency, power = welch(x - x.mean(), rate, nperseg=min(len(x), max(int(8 * rate / hz), 64)))
    band = frequency[power > 1e-3 * power[1:].max()]
    low, high = float(band[band > 0].min()), float(band.max())
    step = float(frequency[1])
    if hz - hz / (2 * q) < low - step:
        raise SolverError(
            f"the resonance of {number(hz)} Hz is at the lower end of what the excitation shakes,"
            f" {number(low)} Hz; start it at {number(hz * (1 - 2 / max(q, 4)))} Hz or below"
        )
    if hz + hz / (2 * q) > high + step:
        raise SolverError(
            f"the resonance of {number(hz)} Hz is at the upper end of what the excitation shakes,"
            f" {number(high)} Hz; end it at {number(hz * (1 + 2 / max(q, 4)))} Hz or above"
        )


def rough_answer_hz(rate_hz: float, squared_current: np.ndarray, displacement: np.ndarray) -> float:
    """Where the answer to the excitation is largest, of its velocity: a first look."""
    return _driven_starts(rate_hz, squared_current, displacement, None)[1]


def current_of_voltage(rate_hz: float, voltage: np.ndarray, resistance: float, inductance: float) -> np.ndarray:
    """Current (n,) in A that a voltage (n,) in V drives through R in Ω and L in H, steady before the record.

    Exact for a voltage that is straight between samples.
    """
    settled = voltage[0] / resistance
    if inductance == 0:
        return np.asarray(voltage / resistance)
    change = _answer(-resistance / inductance, (voltage - voltage[0]) / inductance, 1 / rate_hz)
    return np.asarray(settled + change)
