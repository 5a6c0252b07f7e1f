"""Least squares where some parameters enter linearly: ``data ≈ Φ(θ) c``, real θ and c, complex data.

Variable projection (G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10, 1973, 413-432): for each θ the best c is a linear
least-squares solution, so that scipy searches for θ only, in what the columns of Φ(θ) leave of the data.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

__all__ = ["SeparableFit", "correlation_factor", "left_over", "separable_fit"]

STEP = 1e-5
"""Of a parameter over its scale, in the slopes for the covariance."""
MOST_STEPS = 100


class SeparableFit(NamedTuple):
    """The result; `theta` (p,), `coefficients` (k,), `residual` (n,).

    `covariance` (p + k, p + k) is of θ, then of c, by the linear rule at the solution. `noise` is the root mean square
    of the residual of a point, real and imaginary part together, corrected for the number of parameters.
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

    `scale` (p,) is what a parameter must move for Φ to change by much. `data` (n,) may be complex. The nearest minimum
    downhill is found, not the deepest.
    """
    from scipy.optimize import least_squares

    size = float(np.linalg.norm(data)) or 1.0
    low, high = ((np.broadcast_to(bound, start.shape) - start) / scale for bound in bounds)
    moved = least_squares(
        lambda u: left_over(model(start + scale * u), data) / size,
        np.clip(0.0, low + 1e-9, high - 1e-9),
        bounds=(low, high),
        x_scale="jac",
        ftol=1e-14,
        xtol=1e-12,
        gtol=None,
        max_nfev=MOST_STEPS,
    ).x
    theta, basis = start + scale * moved, model(start + scale * moved)
    norm = np.linalg.norm(basis, axis=0)
    norm[norm == 0] = 1.0
    coefficients = np.linalg.lstsq(_parts(basis / norm), _parts(data), rcond=1e-12)[0] / norm
    slopes = [
        (model(theta + step) - model(theta - step)) @ coefficients / (2 * STEP)
        for step in STEP * np.diag(np.broadcast_to(scale, theta.shape))
    ]
    jacobian = _parts(np.concatenate([np.transpose(slopes), basis], axis=1))
    norm = np.linalg.norm(jacobian, axis=0)
    norm[norm == 0] = 1.0
    residual = data - basis @ coefficients
    variance = float(np.vdot(residual, residual).real) / max(len(jacobian) - jacobian.shape[1], 1)
    covariance = np.linalg.pinv((jacobian / norm).T @ (jacobian / norm), rcond=1e-15, hermitian=True)
    units = np.concatenate([np.broadcast_to(scale, theta.shape), np.ones(len(coefficients))]) / norm
    parts = len(jacobian) / len(data)
    return SeparableFit(
        theta, coefficients, residual, variance * covariance * np.outer(units, units), float(np.sqrt(parts * variance))
    )


def left_over(basis: np.ndarray, data: np.ndarray) -> np.ndarray:
    """What the columns of `basis` (n, k), with real factors, leave of `data`: real, then imaginary parts (2 n,)."""
    columns, goal = _parts(basis), _parts(data)
    norm = np.linalg.norm(columns, axis=0)
    norm[norm == 0] = 1.0
    q = np.linalg.qr(columns / norm)[0]
    return np.asarray(goal - q @ (q.T @ goal))


def _parts(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag]) if np.iscomplexobj(values) else values


def correlation_factor(residual: np.ndarray) -> float:
    """By how much neighbours that err alike widen the errors of a fit, 1 for white noise, at most 10.

    For a first-order process of lag-one correlation ρ, √((1+ρ)/(1−ρ)); ρ within two sigma of none counts as none.
    """
    power = float(np.vdot(residual, residual).real)
    if power <= 0:
        return 1.0
    rho = float(np.vdot(residual[:-1], residual[1:]).real) / power
    return 1.0 if rho < 2 / np.sqrt(len(residual)) else float(min(np.sqrt((1 + rho) / max(1 - rho, 1e-3)), 10.0))
