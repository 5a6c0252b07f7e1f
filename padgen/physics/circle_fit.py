"""Fit a resonance by its circle in the complex plane: first the circle, then the angle over frequency.

Near a resonance with viscous damping the mobility ``s H = −j P / (1 + j x)``, ``x = Q (s − 1/s)``, s = f/f₀, runs on a
circle of diameter P through the origin. Far modes add a constant, which only shifts the circle. Seen from its centre
the angle is ``φ₀ − 2 arctan x`` (C. C. Kennedy, C. D. P. Pancu, J. Aeronaut. Sci. 14, 1947, 603-625). (With hysteretic
damping the receptance H itself would be a circle; over one bandwidth the two differ by 1/Q.) The circle is fitted by
the method of G. Taubin (IEEE Trans. PAMI 13, 1991, 1115-1138), which noise does not shrink as it does the plain
algebraic fit.
"""

from typing import NamedTuple

import numpy as np

__all__ = ["CircleFit", "circle_resonance", "detuning", "taubin_circle"]

WIDEST_ARC = 2.5
"""Largest |x| of the points that are fitted; larger where fewer than `FEWEST` points would remain."""
FEWEST = 6
VAGUE = 1.0
"""Largest useful sigma, of ln Q and of the frequency in bandwidths: with a larger one the circle has no result."""


class CircleFit(NamedTuple):
    """Frequency and Q of a resonance, each with one sigma."""

    resonance_hz: float
    resonance_error_hz: float
    q: float
    q_error: float


def taubin_circle(points: np.ndarray, weight: np.ndarray) -> tuple[complex, float]:
    """Return centre and radius of the circle through complex `points` (n,), by Taubin's algebraic distance.

    `weight` (n,) is of each squared distance. At least three points must not be on a line.
    """
    share = weight / weight.sum()
    middle = complex((share * points).sum())
    z = points - middle
    square = np.abs(z) ** 2
    mean = float((share * square).sum())
    root = np.sqrt(share)
    columns = np.stack([(square - mean) / (2 * np.sqrt(mean)), z.real, z.imag], axis=1) * root[:, None]
    a, b, c = np.linalg.svd(columns, full_matrices=False)[2][2]
    a = a / (2 * np.sqrt(mean))
    if a == 0:
        return middle, float("inf")
    radius = np.sqrt(b * b + c * c + 4 * a * a * mean) / (2 * abs(a))
    return middle - complex(b, c) / (2 * a), float(radius)


def circle_resonance(
    frequency_hz: np.ndarray,
    response: np.ndarray,
    start_hz: float,
    start_q: float,
    sigma: np.ndarray | float = 1.0,
) -> CircleFit | None:
    """Fit the circle of a receptance `response` (n,) near `start_hz`; None where too few points determine it.

    `sigma` is the relative size of each point's noise.
    """
    if len(frequency_hz) < FEWEST:
        return None
    sigma, fit = np.broadcast_to(np.asarray(sigma, float), frequency_hz.shape), None
    hz, q = start_hz, start_q
    for _ in range(2):
        away = np.abs(detuning(frequency_hz, hz, q))
        arc = away <= max(WIDEST_ARC, float(np.sort(away)[FEWEST - 1]))
        s = frequency_hz[arc] / hz
        fit = _fit_angle(frequency_hz[arc], response[arc] * s, hz, q, sigma[arc] * s)
        if fit is None:
            break
        hz, q = fit.resonance_hz, fit.q
    return fit


def detuning(frequency: np.ndarray, hz: float, q: float) -> np.ndarray:
    """Return x (n,) of the phase ``−2 arctan x``."""
    return np.asarray(q * (frequency / hz - hz / frequency))


def _fit_angle(frequency: np.ndarray, points: np.ndarray, hz: float, q: float, sigma: np.ndarray) -> CircleFit | None:
    from scipy.optimize import least_squares

    centre, radius = taubin_circle(points, sigma**-2)
    if not np.isfinite(radius):
        return None
    arm = points - centre
    angle, width = np.angle(arm), 1 / q

    def off(theta: np.ndarray) -> np.ndarray:
        x = detuning(frequency, hz * np.exp(theta[1] * width), q * np.exp(theta[2]))
        return np.asarray(np.angle(np.exp(1j * (angle - theta[0] + 2 * np.arctan(x)))) / sigma)

    start = np.array([angle[np.abs(frequency - hz).argmin()], 0.0, 0.0])
    found = least_squares(off, start, bounds=([-np.inf, -1 / width, -3], [np.inf, 1 / width, 3]), x_scale="jac")
    inverse = np.linalg.pinv(found.jac)
    # Noise along the circle turns a point directly. Noise across it moves the centre: a centre that is off by d turns
    # a point by −t·d over the radius, t being the tangent there.
    radial, along = (np.abs(arm) - radius) / sigma, radius * found.fun
    variance = float(radial @ radial + along @ along) / max(2 * len(arm) - 6, 1)
    unit = arm / np.abs(arm)
    across = np.stack([unit.real, unit.imag, np.ones(len(arm))], axis=1) / sigma[:, None]
    turn = np.stack([unit.imag, -unit.real, np.zeros(len(arm))], axis=1) / sigma[:, None]
    moved = inverse @ turn @ np.linalg.pinv(across)
    error = np.sqrt(variance * ((inverse**2).sum(1) + (moved**2).sum(1))) / radius
    if not (error[1:] < VAGUE).all() or abs(found.x[1]) > 0.99 / width or abs(found.x[2]) > 2.99:
        return None
    hz, q = float(hz * np.exp(found.x[1] * width)), float(q * np.exp(found.x[2]))
    return CircleFit(hz, float(hz * error[1] * width), q, float(q * error[2]))
