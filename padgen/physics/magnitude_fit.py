"""Fit one resonance to magnitudes without phase: by least squares of ``|H|² + N²``, and by the parabola of 1/|H|².

``H = P/(Q (1 − s²) + j s) + a + b/s²`` as in `padgen.physics.resonance_fit`, with real P, a, b. In complex noise of rms
N a squared magnitude has the mean ``|H|² + N²`` and the variance ``N² (2 |H|² + N²)`` (S. O. Rice, Bell Syst. Tech. J.
24, 1945); the variance gives the weights. An average of many spectra has a smaller variance, by one factor at all
points. Near the peak ``1/|H|² = (Q² (1 − u)² + u)/P²``, u = s², is a parabola in f². Its three numbers are fitted by
least squares after the contributions of a, b and N are taken off.

Some parameters enter linearly, ``data ≈ Φ(θ) c`` with real θ and c and complex data: variable projection (G. Golub, V.
Pereyra, SIAM J. Numer. Anal. 10, 1973, 413-432): for each θ the best c is a linear least-squares solution, so that
scipy searches for θ only, in the residual after the columns of Φ(θ). The slope of that residual is computed without its
second, small part (L. Kaufman, BIT 15, 1975, 49-57).
"""

from collections.abc import Callable
from math import log
from typing import NamedTuple

import numpy as np

from padgen.physics.circle_fit import CircleFit
from padgen.physics.resonance_judge import (
    ResonanceFit,
    checked,
    point_noise,
    refuse_bad_spectrum,
    refuse_edge,
    refuse_few,
    refuse_no_peak,
    refuse_no_resonance,
    refuse_two,
    rough_peak,
)

__all__ = ["SeparableFit", "correlation_factor", "fit_magnitude", "left_over", "separable_fit", "unit_covariance"]

STEP = 1e-5
"""Step of a parameter over its scale, in finite differences."""
MOST_STEPS = 40


class SeparableFit(NamedTuple):
    """The result of a fit: `theta` (p,), `coefficients` (k,), `residual` (n,).

    `covariance` (p + k, p + k) is of θ, then of c, by the linear rule at the solution. `noise` is the root mean square
    residual of a point, real and imaginary part together, corrected for the number of parameters.
    """

    theta: np.ndarray
    coefficients: np.ndarray
    residual: np.ndarray
    covariance: np.ndarray
    noise: float


def separable_fit(
    model: Callable[[np.ndarray], np.ndarray],
    data: np.ndarray,
    start: np.ndarray,
    scale: np.ndarray | float = 1.0,
    bounds: tuple[np.ndarray | float, np.ndarray | float] = (-np.inf, np.inf),
) -> SeparableFit:
    """Minimise ``|data − Φ(θ) c|²`` from `start` (p,) within `bounds`; `model` gives Φ (n, k) for θ.

    `scale` (p,) is the change of each parameter that changes Φ by much. `data` (n,) may be complex. Finds the nearest
    minimum downhill, not the deepest.
    """
    from scipy.optimize import least_squares

    size, goal = float(np.linalg.norm(data)) or 1.0, _parts(data)
    units = np.broadcast_to(scale, start.shape)
    low, high = ((np.broadcast_to(bound, start.shape) - start) / units for bound in bounds)

    def coefficients(columns: np.ndarray) -> np.ndarray:
        norm = _norms(columns)
        return np.asarray(np.linalg.lstsq(columns / norm, goal, rcond=1e-12)[0] / norm)

    def slopes(u: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """Return the slopes (2 n, p) of the fitted data over u, by differences."""
        moved = [start + units * (u + sign * step) for step in STEP * np.eye(len(u)) for sign in (1, -1)]
        values = [_parts(model(theta) @ factors) for theta in moved]
        return np.stack(values[::2], axis=1) / (2 * STEP) - np.stack(values[1::2], axis=1) / (2 * STEP)

    def slopes_left(u: np.ndarray) -> np.ndarray:
        columns = _parts(model(start + units * u))
        return -_orthogonal_part(columns, slopes(u, coefficients(columns))) / size

    found = least_squares(
        lambda u: left_over(model(start + units * u), data) / size,
        np.clip(0.0, low + 1e-9, high - 1e-9),
        slopes_left,
        bounds=(low, high),
        x_scale="jac",
        ftol=1e-12,
        xtol=1e-10,
        gtol=None,
        max_nfev=MOST_STEPS,
    )
    theta = start + units * found.x
    basis = model(theta)
    factors = coefficients(_parts(basis))
    jacobian = np.concatenate([slopes(found.x, factors) / units, _parts(basis)], axis=1)
    residual = data - basis @ factors
    variance = float(np.vdot(residual, residual).real) / max(len(goal) - jacobian.shape[1], 1)
    noise = float(np.sqrt(variance * len(goal) / len(data)))
    return SeparableFit(theta, factors, residual, variance * unit_covariance(jacobian), noise)


def unit_covariance(jacobian: np.ndarray) -> np.ndarray:
    """Return the covariance (p, p) by the linear rule, for data of the slopes `jacobian` (n, p) and noise of variance
    1.
    """
    norm = _norms(jacobian)
    return np.linalg.pinv((jacobian / norm).T @ (jacobian / norm), rcond=1e-15, hermitian=True) / np.outer(norm, norm)


def left_over(basis: np.ndarray, data: np.ndarray) -> np.ndarray:
    """Return the residual (2 n,) of `data` after `basis` (n, k) with real factors: real parts, then imaginary parts."""
    return _orthogonal_part(_parts(basis), _parts(data))


def _orthogonal_part(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the part of `values` orthogonal to the columns."""
    q = np.linalg.qr(columns / _norms(columns))[0]
    return np.asarray(values - q @ (q.T @ values))


def _norms(columns: np.ndarray) -> np.ndarray:
    """Return the columns' norms, 1 for empty columns."""
    norm = np.linalg.norm(columns, axis=0)
    return np.where(norm == 0, 1.0, norm)


def _parts(values: np.ndarray) -> np.ndarray:
    """Return complex values as real parts, then imaginary parts; real values as they are."""
    return np.concatenate([values.real, values.imag]) if np.iscomplexobj(values) else values


def correlation_factor(residual: np.ndarray) -> float:
    """Return the factor by which correlated noise widens the errors of a fit: 1 for white noise, at most 10.

    For a first-order process of lag-one correlation ρ it is √((1+ρ)/(1−ρ)); ρ within two sigma of 0 counts as 0.
    """
    power = float(np.vdot(residual, residual).real)
    if power <= 0:
        return 1.0
    rho = float(np.vdot(residual[:-1], residual[1:]).real) / power
    return 1.0 if rho < 2 / np.sqrt(len(residual)) else float(min(np.sqrt((1 + rho) / max(1 - rho, 1e-3)), 10.0))


LEAST_PROMINENCE = 0.1
"""Smallest prominence of a further peak, over the largest peak."""
SMOOTHED = (1, 5, 25)
"""Numbers of points over which magnitudes are averaged to find starts."""
CLEAR = 5.0
"""Sigmas by which a valley must lie below the two peaks beside it."""
LARGEST_Q = 1e7
ROUNDS = 4
"""Rounds of the fit, each with weights from the one before."""
SMALLEST_NOISE = 1e-6
"""Smallest noise in the weights, over the largest magnitude; it keeps points without noise from dominating."""


class _Squares(NamedTuple):
    """A fit of squared magnitudes.

    `theta` (6,) is ln f₀, ln Q, P, a, b, N; `left` (n,) is the residual over each point's scatter.
    """

    theta: np.ndarray
    covariance: np.ndarray
    left: np.ndarray
    noise: float


def fit_magnitude(frequency_hz: np.ndarray, magnitude: np.ndarray, near_hz: float | None = None) -> ResonanceFit:
    """Fit the resonance in a `magnitude` (n,) over rising `frequency_hz` (n,); see `fit_spectrum`.

    Further peaks are cut off at the valleys between.

    Raises
    ------
    SolverError
        No peak, one at an end of the sweep, two comparable ones, or too few points in it.
    """
    frequency, size = np.asarray(frequency_hz, float), np.asarray(magnitude, float)
    refuse_bad_spectrum(frequency, size)
    scale, scatter = float(size.max()), point_noise(size) * np.sqrt(2)
    peaks, part = _peaks(frequency, size, near_hz)
    inside, data = frequency[part], size[part] / scale
    floor = max(scatter / scale, SMALLEST_NOISE)
    fit = _fit_squares(inside, data, floor)
    hz, q, peak = float(np.exp(fit.theta[0])), float(np.exp(fit.theta[1])), float(abs(fit.theta[2]))
    refuse_no_peak(peak, fit.noise, _gain(inside, data, fit), frequency, size)
    refuse_edge(frequency[0], frequency[-1], hz, q)
    model = np.sqrt(_model(inside, fit.theta))
    refuse_no_resonance(data, float(np.sqrt(np.mean((data - model) ** 2))), floor, hz)
    refuse_few(frequency, hz, q)
    others = tuple(p for p in peaks if abs(p[0] - hz) > hz / q)
    if near_hz is None:
        refuse_two(hz, peak * scale, others)
    sigma = correlation_factor(fit.left) * np.sqrt(np.diag(fit.covariance))
    errors = float(hz * sigma[0]), float(q * sigma[1]), float(sigma[2]) * scale
    check = _parabola(inside, data, hz, q, fit)
    return checked((hz, q, peak * scale), errors, fit.noise * scale, "parabola", check, others)


def _peaks(
    frequency: np.ndarray, size: np.ndarray, near_hz: float | None
) -> tuple[tuple[tuple[float, float], ...], slice]:
    """Return all peaks (Hz, height), and the part of the sweep from valley to valley around the chosen one."""
    from scipy.signal import find_peaks

    hz, width = rough_peak(frequency, size)
    points = max(int((np.abs(frequency - hz) <= width / 2).sum()) // 4, 1)
    smooth = np.convolve(np.pad(size, points // 2, mode="edge"), np.full(points, 1 / points), "same")
    smooth = smooth[points // 2 : points // 2 + len(size)]
    least = max(LEAST_PROMINENCE * float(smooth.max()), 6 * point_noise(size) / np.sqrt(points))
    tops = _separate_peaks(size, smooth, find_peaks(smooth, prominence=least)[0])
    if not len(tops):
        return (), slice(0, len(size))
    main = tops[smooth[tops].argmax()]
    if near_hz is not None:
        tall = tops[smooth[tops] >= 0.5 * smooth[tops].max()]
        main = tall[np.abs(np.log(frequency[tall] / near_hz)).argmin()]
    below, above = tops[tops < main], tops[tops > main]
    first = below[-1] + int(smooth[below[-1] : main].argmin()) if len(below) else 0
    last = main + int(smooth[main : above[0] + 1].argmin()) + 1 if len(above) else len(size)
    return tuple((float(frequency[k]), float(smooth[k])) for k in tops), slice(int(first), int(last))


def _separate_peaks(size: np.ndarray, smooth: np.ndarray, tops: np.ndarray) -> np.ndarray:
    """Return those of the peaks `tops` (indices) with a valley between, in means over a quarter of their distance."""
    # Magnitudes scatter 1.5 times as much at a peak as at the floor, from which `point_noise` mostly comes.
    scatter, kept = 1.5 * point_noise(size), list(tops[:1])
    for top in tops[1:]:
        last, points = kept[-1], max((top - kept[-1]) // 4, 1)
        means = np.convolve(np.pad(size, points // 2, mode="edge"), np.full(points, 1 / points), "same")
        means = means[points // 2 : points // 2 + len(size)]
        if min(means[last], means[top]) - means[last : top + 1].min() > CLEAR * scatter / np.sqrt(points):
            kept.append(top)
        elif smooth[top] > smooth[last]:
            kept[-1] = top
    return np.array(kept, dtype=int)


def _fit_squares(frequency: np.ndarray, data: np.ndarray, floor: float) -> _Squares:
    from scipy.optimize import least_squares

    fits = []
    for hz, q in _starts(frequency, data):
        # ln f₀ in bandwidths, so that the finite differences take suitable steps.
        start, scale = np.array([log(hz), log(q), 1.0, 0.0, 0.0, floor]), np.array([1 / q, 1, 1, 1, 1, 1])
        theta = start
        for _ in range(ROUNDS):
            scatter = _scatter(frequency, theta, floor)
            found = least_squares(
                lambda u, x=start, k=scale, w=scatter: (_model(frequency, x + k * u) - data**2) / w,
                (theta - start) / scale,
                method="lm",
                x_scale="jac",
                max_nfev=1000,
            )
            theta = start + scale * found.x
        cost = float(np.sum(np.abs(np.sqrt(_model(frequency, theta)) - data) ** 2))
        fits.append((cost if np.isfinite(cost) else np.inf, theta, found.fun, found.jac / scale))
    _, theta, left, jacobian = min(fits, key=lambda fit: fit[0])
    variance = float(left @ left) / max(len(left) - len(theta), 1)
    return _Squares(theta, variance * unit_covariance(jacobian), left, max(abs(float(theta[5])), floor))


def _starts(frequency: np.ndarray, data: np.ndarray) -> list[tuple[float, float]]:
    """Return the two best pairs of frequency in Hz and Q among peaks of smoothed magnitudes, by a linear fit."""
    tried = []
    for points in SMOOTHED:
        smooth = np.convolve(data, np.full(points, 1 / points), "same")
        for size in (smooth, smooth * frequency)[: 2 if points == 1 else 1]:
            hz, width = rough_peak(frequency, size)
            tried += [(hz, min(max(hz / max(width, 1e-9 * hz) * k, 0.5), LARGEST_Q)) for k in (0.5, 1.0, 2.5)]
    left = []
    for hz, q in tried:
        s = frequency / hz
        basis = np.stack([1 / ((q * (1 - s) * (1 + s)) ** 2 + s * s), np.ones(len(s))], axis=1)
        left.append(float(np.linalg.norm(left_over(basis, data**2))))
    return [tried[k] for k in np.argsort(left, kind="stable")[:2]]


def _scatter(frequency: np.ndarray, theta: np.ndarray, floor: float) -> np.ndarray:
    """Return one sigma (n,) of the squared magnitudes by the model, with N at least `floor`."""
    square = max(float(theta[5]) ** 2, floor**2)
    clean = np.maximum(_model(frequency, theta) - theta[5] ** 2, 0.0)
    return np.asarray(np.sqrt(square * (2 * clean + square)))


def _model(frequency: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Return the model's squared magnitude (n,)."""
    s, q = frequency / np.exp(np.clip(theta[0], -50, 50)), np.exp(np.clip(theta[1], -20, 20))
    mode = theta[2] / (q * (1 - s) * (1 + s) + 1j * s)
    whole = mode + theta[3] + theta[4] * (frequency[0] * frequency[-1] / frequency**2)
    return np.asarray(np.abs(whole) ** 2 + theta[5] ** 2)


def _gain(frequency: np.ndarray, data: np.ndarray, fit: _Squares) -> float:
    """Return the decrease of the weighted sum of squares by the resonance against a smooth curve, in variances."""
    far = frequency[0] * frequency[-1] / frequency**2
    scatter = _scatter(frequency, fit.theta, fit.noise)
    left = left_over(np.stack([np.ones(len(far)), far, far**2], axis=1) / scatter[:, None], data**2 / scatter)
    own = float(fit.left @ fit.left)
    return (float(left @ left) - own) / max(own / len(left), np.finfo(float).tiny)


def _parabola(frequency: np.ndarray, data: np.ndarray, hz: float, q: float, fit: _Squares) -> CircleFit | None:
    """Fit f₀ and Q by the parabola of 1/|H|² over f² within 1.5 bandwidths of the peak; None if that is impossible."""
    from scipy.optimize import least_squares

    inside = frequency[np.abs(q * (frequency / hz - hz / frequency)) <= 1.5]
    alone = fit.theta * [1, 1, 1, 0, 0, 0]
    clean = _model(frequency, alone)
    square = (data**2 - _model(frequency, fit.theta) + clean)[np.isin(frequency, inside)]
    if len(inside) < 6 or (square <= 0).any():
        return None
    # The sigma of 1/|H|² is that of |H|² over |H|⁴, with the fit's |H|: the data's would favour points that noise
    # made small.
    weight = (clean**2 / _scatter(frequency, fit.theta, fit.noise))[np.isin(frequency, inside)]

    def off(u: np.ndarray) -> np.ndarray:
        model = _model(inside, alone + np.array([u[0] / q, *u[1:], 0, 0, 0]))
        return np.asarray(weight * (1 / model - 1 / square))

    found = least_squares(off, np.zeros(3), x_scale="jac")
    variance = float(fit.left @ fit.left) / max(len(fit.left) - len(fit.theta), 1)
    error = np.sqrt(variance * np.diag(unit_covariance(found.jac)))
    there, quality = float(hz * np.exp(found.x[0] / q)), float(q * np.exp(found.x[1]))
    return CircleFit(there, float(there * error[0] / q), quality, float(quality * error[1]))
