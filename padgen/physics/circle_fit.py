"""A resonance by its circle in the complex plane: the circle's fit, then the angle over frequency.

Near a resonance of viscous damping the mobility ``s H = −j P / (1 + j x)``, ``x = Q (s − 1/s)``, s = f/f₀, runs on a
circle of diameter P through the origin, whatever constant the far modes add to it; seen from its centre the
angle is ``φ₀ − 2 arctan x`` (C. C. Kennedy, C. D. P. Pancu, J. Aeronaut. Sci. 14, 1947, 603-625). (Of hysteretic
damping the receptance H itself would be one; over one bandwidth the two differ by 1/Q.) The transform of a free decay
is a circle with ``x = (f − f_d)/h``, f_d its frequency and h half its bandwidth. The circle is G. Taubin's (IEEE Trans.
PAMI 13, 1991, 1115-1138), which is not drawn inwards by noise as the plain algebraic one is.
"""

from typing import NamedTuple

import numpy as np

__all__ = ["CircleFit", "circle_resonance", "taubin_circle"]

WIDEST_ARC, WIDEST_REACH = 2.5, 8.0
"""Points are taken up to this |x| from the peak, farther out where they would be too few."""
FEWEST = 6
MOST_STEPS = 30


class CircleFit(NamedTuple):
    """A resonance with one sigma of each figure; `points` on the circle were used."""

    resonance_hz: float
    resonance_error_hz: float
    q: float
    q_error: float
    points: int


def taubin_circle(points: np.ndarray, weight: np.ndarray) -> tuple[complex, float]:
    """Centre and radius of the circle through complex `points` (n,), by Taubin's algebraic distance.

    `weight` (n,) is of each squared distance. At least three points that are not on a line.
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
    decay: bool = False,
) -> CircleFit | None:
    """Resonance by the circle of a complex `response` (n,) near `start_hz`; None where it has too few points.

    `sigma` is the relative size of each point's noise. With `decay` the response is the transform of a free decay,
    and the result its own frequency; else it is a receptance.
    """
    hz, q = start_hz, start_q
    fit = None
    for _ in range(2):
        which = _arc(frequency_hz, hz, q, decay)
        if which.sum() < FEWEST:
            return fit
        spread = np.broadcast_to(np.asarray(sigma, float), frequency_hz.shape)[which]
        factor = np.ones(which.sum()) if decay else frequency_hz[which] / hz
        fit = _fitted(frequency_hz[which], response[which] * factor, hz, q, spread * factor, decay)
        if fit is None:
            return None
        hz, q = fit.resonance_hz, fit.q
    return fit


def _arc(frequency: np.ndarray, hz: float, q: float, decay: bool) -> np.ndarray:
    away = np.abs(_law(frequency, hz, q, decay)[0])
    reach = max(WIDEST_ARC, min(float(np.sort(away)[min(FEWEST, len(away)) - 1]), WIDEST_REACH))
    chosen: np.ndarray = away <= reach
    return chosen


def _law(frequency: np.ndarray, hz: float, q: float, decay: bool) -> tuple[np.ndarray, np.ndarray]:
    """x (n,) and its slope over ln f₀; that over ln Q is x itself."""
    s = frequency / hz
    if decay:
        return 2 * q * (s - 1), -2 * q * s
    return q * (s - 1 / s), -q * (s + 1 / s)


def _fitted(
    frequency: np.ndarray, points: np.ndarray, hz: float, q: float, sigma: np.ndarray, decay: bool
) -> CircleFit | None:
    centre, radius = taubin_circle(points, sigma**-2)
    if not np.isfinite(radius):
        return None
    arm = points - centre
    angle = np.angle(arm)
    theta = np.array([angle[np.abs(frequency - hz).argmin()], np.log(hz), np.log(q)])
    for _ in range(MOST_STEPS):
        x, slope = _law(frequency, float(np.exp(theta[1])), float(np.exp(theta[2])), decay)
        off = np.angle(np.exp(1j * (angle - theta[0] + 2 * np.arctan(x))))
        bend = -2 / (1 + x * x)
        jacobian = np.stack([np.ones(len(x)), bend * slope, bend * x], axis=1)
        inverse = np.linalg.pinv(jacobian / sigma[:, None])
        step = inverse @ (off / sigma)
        theta = theta + np.clip(step, -0.5, 0.5)
        if np.abs(step).max() < 1e-12:
            break
    error = _errors(arm, radius, off, inverse, sigma)
    if not np.isfinite(theta).all() or abs(theta[1] - np.log(hz)) > 1 or abs(theta[2] - np.log(q)) > 3:
        return None
    hz, q = float(np.exp(theta[1])), float(np.exp(theta[2]))
    return CircleFit(hz, float(hz * error[1]), q, float(q * error[2]), len(frequency))


def _errors(arm: np.ndarray, radius: float, off: np.ndarray, inverse: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """One sigma (3,) of the angle's parameters: noise along the circle, and what noise across it does to the centre."""
    radial = (np.abs(arm) - radius) / sigma
    along = radius * off / sigma
    variance = float(radial @ radial + along @ along) / max(2 * len(arm) - 6, 1)
    unit = arm / np.abs(arm)
    across = np.stack([unit.real, unit.imag, np.ones(len(arm))], axis=1) / sigma[:, None]
    # A centre off by d turns the angle of a point by −t·d over the radius, t the tangent there.
    turn = np.stack([unit.imag, -unit.real, np.zeros(len(arm))], axis=1) / sigma[:, None]
    moved = inverse @ turn @ np.linalg.pinv(across)
    return np.asarray(np.sqrt(variance * ((inverse**2).sum(1) + (moved**2).sum(1))) / radius)
