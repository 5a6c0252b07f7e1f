"""One resonance from a measured spectrum: frequency, Q and the response at the peak, with one sigma of each.

The model is the receptance of `padgen.physics.resonator`, with its peak P in place of the mass, and what modes far
below and above the sweep add (D. J. Ewins, Modal Testing, 2nd ed. 2000, ch. 4):

    H(f) = P / (Q (1 − s²) + j s) + a + b/s²,   s = f/f₀

Complex spectra are fitted by least squares in P, a, b (complex: any phase of the sensor), f₀ and Q, and by the circle
of `padgen.physics.circle_fit`. Further peaks that stand out of what is left become modes of the model, so that a small
one beside the taxel's own does not pull it. Magnitudes are for `padgen.physics.magnitude_fit`.

Noise is taken as alike at all points and independent; where what is left of the data is correlated, the errors are
widened (`correlation_factor`). Checked from Q = 2 to 10⁴, at 20 to 60 dB, in `tests/test_resonance_fit.py`.
"""

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.physics.circle_fit import circle_resonance
from padgen.physics.magnitude_fit import fit_magnitude
from padgen.physics.resonance_judge import (
    COMPARABLE,
    ResonanceFit,
    agreement,
    refuse_bad_spectrum,
    refuse_contradiction,
    refuse_edge,
    refuse_few,
    refuse_no_peak,
    refuse_no_resonance,
    refuse_two,
    refuse_vague,
)
from padgen.physics.separable_fit import SeparableFit, correlation_factor, separable_fit
from padgen.physics.spectrum_noise import point_noise, rough_peak

__all__ = ["fit_spectrum"]

MOST_OTHERS = 3
"""Further modes of a spectrum."""
LEAST_Q, LARGEST_Q = 0.5, 1e7
SMOOTHED = (1, 5, 25, 125)
"""Points over which a spectrum is averaged to find its peak in noise."""
WORTH = 40.0
"""What a further mode must take off the sum of squares, in variances."""
SMALLEST_NOISE = 1e-9
"""Of the largest response: rounding, which is no noise."""


def fit_spectrum(frequency_hz: np.ndarray, response: np.ndarray, near_hz: float | None = None) -> ResonanceFit:
    """Fit a complex `response` (n,) over rising `frequency_hz` (n,).

    With `near_hz`, of several comparable peaks the one nearest to it is taken; else they are refused.

    Raises
    ------
    SolverError
        No peak, one at an end of the sweep, two comparable ones, too few points in it, or a phase that turns the
        wrong way.
    """
    frequency, data = np.asarray(frequency_hz, float), np.asarray(response, complex)
    refuse_bad_spectrum(frequency, data)
    fit = _started_anew(frequency, data, _one_mode(frequency, data))
    _refuse_turned_phase(frequency, data, fit)
    fit = _with_further_modes(frequency, data, fit)
    _refuse_other_phase(frequency, data, fit)
    hz, q, peak = _modes_of(fit)
    main = _main(hz, peak, near_hz)
    refuse_no_peak(float(peak[main]), fit.noise, _gain(frequency, data, fit), frequency, np.abs(data))
    refuse_no_resonance(np.abs(data), fit.noise, point_noise(data), float(hz[main]))
    refuse_edge(frequency, float(hz[main]), float(q[main]))
    refuse_few(frequency, float(hz[main]), float(q[main]))
    inside = (hz > frequency[0]) & (hz < frequency[-1]) & (np.arange(len(hz)) != main)
    others = tuple((float(a), float(b)) for a, b in zip(hz[inside], peak[inside], strict=True))
    if near_hz is None:
        refuse_two(float(hz[main]), float(peak[main]), others)
    return _compared(frequency, data, fit, main, others)


def _compared(
    frequency: np.ndarray, data: np.ndarray, fit: SeparableFit, main: int, others: tuple[tuple[float, float], ...]
) -> ResonanceFit:
    """The result of least squares beside the circle's, which gets the data without what the other modes add."""
    hz, q, peak = (float(values[main]) for values in _modes_of(fit))
    basis, _ = _basis(frequency, fit.theta)
    alone = fit.residual + basis[:, main] * fit.coefficients[main]
    widened = correlation_factor(fit.residual)
    sigma = widened * np.sqrt(np.diag(fit.covariance))
    turn = fit.coefficients[main] / peak
    real = len(fit.theta) + main
    pair = np.array([real, real + len(fit.coefficients)])
    along = np.array([turn.real, turn.imag])
    peak_error = widened * float(np.sqrt(along @ fit.covariance[np.ix_(pair, pair)] @ along))
    errors = float(hz * sigma[2 * main]), float(q * sigma[2 * main + 1])
    refuse_vague(hz, errors[0], q)
    circle = circle_resonance(frequency, alone, hz, q)
    if circle is None:
        check: tuple[str, float, float, float, float] = ("", np.nan, np.nan, np.nan, np.nan)
        agree = True
    else:
        check = ("circle", *circle[:4])
        agree = agreement((hz, errors[0]), (q, errors[1]), (check[1], check[2]), (check[3], check[4]))
        if not agree:
            refuse_contradiction(hz, q, "circle", check[1], check[3])
    return ResonanceFit(hz, errors[0], q, errors[1], peak, peak_error, fit.noise, *check, agree, others)


def _modes_of(fit: SeparableFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies, Qs and peaks (m,) of the modes of a fit."""
    hz, q = np.exp(fit.theta[::2]), np.exp(fit.theta[1::2])
    return hz, q, np.abs(fit.coefficients[: len(hz)])


def _one_mode(frequency: np.ndarray, data: np.ndarray) -> SeparableFit:
    return _fitted(frequency, data, np.log(_start(frequency, data)))


def _started_anew(frequency: np.ndarray, data: np.ndarray, fit: SeparableFit) -> SeparableFit:
    """Where one mode explains little, the better of it and of one that starts where the magnitude has its own."""
    if fit.noise < 0.05 * np.abs(data).max():
        return fit
    try:
        alone = fit_magnitude(frequency, np.abs(data))
    except SolverError:
        return fit
    other = _fitted(frequency, data, np.log([alone.resonance_hz, alone.q]))
    return other if other.noise < fit.noise else fit


def _fitted(frequency: np.ndarray, data: np.ndarray, start: np.ndarray) -> SeparableFit:
    count = len(start) // 2
    low = np.tile([np.log(frequency[0] / 3), np.log(LEAST_Q)], count)
    high = np.tile([np.log(frequency[-1] * 3), np.log(LARGEST_Q)], count)
    return separable_fit(lambda theta: _basis(frequency, theta), data, start, low, high)


def _with_further_modes(frequency: np.ndarray, data: np.ndarray, fit: SeparableFit) -> SeparableFit:
    """Add modes at the peaks of what is left, as long as one is worth its numbers."""
    for _ in range(MOST_OTHERS):
        numbers = len(fit.theta) + 2 * len(fit.coefficients) + 4
        rounding = fit.noise < SMALLEST_NOISE * np.abs(data).max()
        if rounding or len(frequency) < numbers or not _structured(fit):
            break
        more = _fitted(frequency, data, np.concatenate([fit.theta, np.log(_start(frequency, fit.residual))]))
        if not _better(frequency, fit, more):
            break
        fit = more
    return fit


def _structured(fit: SeparableFit) -> bool:
    """Whether what is left of the data stands out of white noise somewhere, or is alike at neighbours."""
    highest = float(np.abs(fit.residual).max()) ** 2
    # The square of complex noise is above m times its mean with probability exp(-m).
    return highest > fit.noise**2 * (np.log(len(fit.residual)) + 4) or correlation_factor(fit.residual) > 1


def _better(frequency: np.ndarray, fit: SeparableFit, more: SeparableFit) -> bool:
    """Whether a further mode is worth its four numbers, is resolved, and all stand apart from each other."""
    before, after = (float(np.linalg.norm(f.residual)) ** 2 for f in (fit, more))
    if before - after < WORTH * more.noise**2 / 2:
        return False
    hz, q, _ = _modes_of(more)
    resolved = (np.abs(frequency[:, None] - hz) <= hz / q).sum(0) >= 3
    near = np.abs(hz[:, None] - hz) <= 0.5 * np.maximum.outer(hz / q, hz / q)
    return bool(resolved.all() and near.sum() == len(hz))


def _gain(frequency: np.ndarray, data: np.ndarray, fit: SeparableFit) -> float:
    """What the modes take off the sum of squares, in variances of a part of a point."""
    far = _far(frequency)
    plain = data - far @ np.linalg.lstsq(far, data, rcond=None)[0]
    taken = float(np.linalg.norm(plain)) ** 2 - float(np.linalg.norm(fit.residual)) ** 2
    return taken / max(fit.noise**2 / 2, np.finfo(float).tiny)


def _refuse_turned_phase(frequency: np.ndarray, data: np.ndarray, fit: SeparableFit) -> None:
    if fit.noise < 0.05 * np.abs(data).max():
        return
    turned = _one_mode(frequency, data.conj())
    if turned.noise < 0.5 * fit.noise:
        hz = float(np.exp(turned.theta[0]))
        raise SolverError(
            f"the phase rises through the peak at {number(hz)} Hz, where that of a displacement falls by 180°: negate"
            " the phase or the imaginary part, or swap real and imaginary part back"
        )


def _refuse_other_phase(frequency: np.ndarray, data: np.ndarray, fit: SeparableFit) -> None:
    """Refuse a peak of the magnitude that the phase knows nothing of."""
    if fit.noise < 0.05 * np.abs(data).max():
        return
    try:
        alone = fit_magnitude(frequency, np.abs(data))
    except SolverError:
        return
    if alone.noise < 0.5 * fit.noise:
        raise SolverError(
            f"the magnitude has a peak at {number(alone.resonance_hz)} Hz, but the phase does not fall by 180°"
            " through it as that of a resonance; see that it is in degrees and of this taxel, or leave the phase out"
        )


def _basis(frequency: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modes of peak 1, a constant and 1/f²; slopes over ln f₀ and ln Q of each mode."""
    count = len(theta) // 2
    s, q = frequency[:, None] / np.exp(theta[::2]), np.exp(theta[1::2])
    off = q * (1 - s) * (1 + s)
    mode = 1 / (off + 1j * s)
    slopes = np.zeros((2 * count, len(frequency), count + 2), dtype=complex)
    own = np.arange(count)
    slopes[2 * own, :, own] = (-(mode**2) * (2 * q * s * s - 1j * s)).T
    slopes[2 * own + 1, :, own] = (-(mode**2) * off).T
    return np.concatenate([mode, _far(frequency)], axis=1), slopes


def _far(frequency: np.ndarray) -> np.ndarray:
    """A constant and 1/f² (n, 2): what modes far above and far below add."""
    return np.stack([np.ones(len(frequency)), frequency[0] * frequency[-1] / frequency**2], axis=1)


def _start(frequency: np.ndarray, data: np.ndarray) -> tuple[float, float]:
    """Where the mobility, averaged over so many points, is largest, and a Q: those that leave least."""
    tried = []
    for points in SMOOTHED:
        if points > len(frequency) // 4:
            break
        size = np.abs(np.convolve(data, np.full(points, 1 / points), "same")) * frequency
        hz, width = rough_peak(frequency, size)
        tried += [(hz, min(max(hz / width * factor, LEAST_Q), LARGEST_Q)) for factor in (0.4, 1.0, 2.5, 6.0)]
    left = [_left_over(frequency, data, *each) for each in tried]
    return tried[int(np.argmin(left))]


def _left_over(frequency: np.ndarray, data: np.ndarray, hz: float, q: float) -> float:
    basis, _ = _basis(frequency, np.log([hz, q]))
    return float(np.linalg.norm(data - basis @ np.linalg.lstsq(basis, data, rcond=None)[0]))


def _main(hz: np.ndarray, peak: np.ndarray, near_hz: float | None) -> int:
    if near_hz is None:
        return int(peak.argmax())
    away = np.where(peak >= COMPARABLE * peak.max(), np.abs(np.log(hz / near_hz)), np.inf)
    return int(away.argmin())
