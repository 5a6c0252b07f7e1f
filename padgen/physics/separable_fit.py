"""Least squares where some parameters enter linearly: ``data ≈ Φ(θ) c``, real θ and c, complex data.

Variable projection (G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10, 1973, 413-432): for each θ the best c is a linear
least-squares solution, so that scipy searches for θ only, in the residual after the columns of Φ(θ). The slope of that
residual is computed without its second, small part (L. Kaufman, BIT 15, 1975, 49-57).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

__all__ = ["SeparableFit", "correlation_factor", "left_over", "separable_fit", "unit_covariance"]

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
