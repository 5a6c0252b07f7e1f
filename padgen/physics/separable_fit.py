"""Least squares where some parameters enter linearly: ``data ≈ Φ(θ) c``, real θ, real or complex c.

Variable projection: for each θ the best c is a linear least-squares solution, so that only θ is searched for.
The slope of what is left is taken without its second, small part (L. Kaufman, BIT 15, 1975, 49-57, after
G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 1973, 413-432); steps are damped after Marquardt.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

__all__ = ["Model", "SeparableFit", "correlation_factor", "separable_fit"]

Model = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""θ (p,) → basis Φ (n, k) and the slope of each nonlinear parameter (p, n, k)."""

MOST_STEPS = 80
SMALL = 1e-10
"""A step of θ, or a relative gain of the sum of squares, that ends the search."""
STIFFEST = 1e12


class SeparableFit(NamedTuple):
    """The result; `theta` (p,), `coefficients` (k,), `residual` (n,).

    `covariance` is of θ, then the real parts of c, then the imaginary parts of complex c, by the linear rule
    at the solution. `noise` is the root mean square of the residual of a point (both parts of a complex one),
    corrected for the number of parameters.
    """

    theta: np.ndarray
    coefficients: np.ndarray
    residual: np.ndarray
    covariance: np.ndarray
    noise: float


class _Point(NamedTuple):
    theta: np.ndarray
    coefficients: np.ndarray
    residual: np.ndarray
    squares: float
    normal: np.ndarray
    gradient: np.ndarray


def separable_fit(
    model: Model,
    data: np.ndarray,
    start: np.ndarray,
    low: np.ndarray | float = -np.inf,
    high: np.ndarray | float = np.inf,
) -> SeparableFit:
    """Minimise ``|data − Φ(θ) c|²`` from `start` (p,); steps are cut to keep θ within `low` and `high`.

    `data` (n,) is real or complex, as Φ. The nearest minimum downhill is found, not the deepest.
    """
    point, damping = _at(model, data, np.asarray(start, float)), 1e-3
    for _ in range(MOST_STEPS):
        diagonal = np.diag(point.normal)
        scale = np.diag(np.maximum(diagonal, 1e-12 * diagonal.max()) + np.finfo(float).tiny)
        step = np.linalg.solve(point.normal + damping * scale, -point.gradient)
        trial = _at(model, data, np.clip(point.theta + step, low, high))
        if trial.squares <= point.squares:
            gain, moved = point.squares - trial.squares, np.abs(trial.theta - point.theta).max()
            point, damping = trial, damping / 10
            if moved < SMALL or (gain <= SMALL * point.squares and moved < np.sqrt(SMALL)):
                break
        elif damping > STIFFEST:
            break
        else:
            damping *= 10
    return _with_covariance(model, data, point)


def correlation_factor(residual: np.ndarray) -> float:
    """By how much neighbours that err alike widen the errors of a fit, 1 for white noise, at most 10.

    For a first-order process of lag-one correlation ρ, √((1+ρ)/(1−ρ)); ρ within two sigma of none counts as none.
    """
    power = float(np.vdot(residual, residual).real)
    if power <= 0:
        return 1.0
    rho = float(np.vdot(residual[:-1], residual[1:]).real) / power
    return 1.0 if rho < 2 / np.sqrt(len(residual)) else float(min(np.sqrt((1 + rho) / max(1 - rho, 1e-3)), 10.0))


def _at(model: Model, data: np.ndarray, theta: np.ndarray) -> _Point:
    basis, slopes = model(theta)
    size = np.linalg.norm(basis, axis=0)
    size[size == 0] = 1.0
    q, r = np.linalg.qr(basis / size)
    diagonal = np.abs(np.diag(r))
    if diagonal.min() < 1e-13 * diagonal.max():  # two columns alike: the shortest solution
        coefficients = np.linalg.lstsq(basis / size, data, rcond=1e-12)[0] / size
    else:
        coefficients = np.linalg.solve(r, q.conj().T @ data) / size
    residual = data - basis @ coefficients
    moves = (slopes @ coefficients).T
    moves = moves - q @ (q.conj().T @ moves)
    normal = (moves.conj().T @ moves).real
    gradient = -(moves.conj().T @ residual).real
    return _Point(theta, coefficients, residual, float(np.vdot(residual, residual).real), normal, gradient)


def _with_covariance(model: Model, data: np.ndarray, point: _Point) -> SeparableFit:
    basis, slopes = model(point.theta)
    moves = (slopes @ point.coefficients).T
    if np.iscomplexobj(basis):
        columns = np.concatenate([moves, basis, 1j * basis], axis=1)
        jacobian = np.concatenate([columns.real, columns.imag])
        parts = 2
    else:
        jacobian, parts = np.concatenate([moves, basis], axis=1), 1
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0] = 1.0
    freedom = max(len(jacobian) - jacobian.shape[1], 1)
    variance = point.squares / freedom
    inverse = np.linalg.pinv((jacobian / size).T @ (jacobian / size), rcond=1e-15, hermitian=True)
    covariance = variance * inverse / np.outer(size, size)
    return SeparableFit(point.theta, point.coefficients, point.residual, covariance, float(np.sqrt(parts * variance)))
