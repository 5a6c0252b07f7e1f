"""Rings of magnetic charge: potential and field of charge that varies as cos mφ round an axis.

Both are toroidal functions, the Legendre functions Q_{m−½} of the second kind. Between circles about one axis

    ∫ cos mφ / R dφ = 2 Q_{m−½}(1 + ε) / √(r r'),   ε = ((r − r')² + (z − z')²) / (2 r r')

(Cohl and Tohline, *Astrophys. J.* 527, 1999). SI units; H in A/m, potentials in A.
"""

from functools import lru_cache
from math import pi
from typing import NamedTuple

import numpy as np

__all__ = ["RingPotential", "gauss", "ring_potential", "toroidal"]

CONVERGED = 1e-9
"""Half the difference of the two means at which their iteration ends; the next one would be less than its square."""
FAR = 0.3
"""ε above which the recurrence runs down from high orders, since running up to order twelve loses too many digits
there.
"""
LOST = 1e7
"""Largest growth of rounding errors in the upward recurrence, which is about (2 + 2 ε)² per order."""
ORDERS_ABOVE = 12
"""Orders above the highest wanted at which the downward recurrence starts: its starting error then decays to 1e-8."""
NEAREST = 1e-15


@lru_cache(maxsize=256)
def gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss-Legendre points and weights on [0, 1], cached since each is an eigenproblem."""
    node, weight = np.polynomial.legendre.leggauss(count)
    return (node + 1) / 2, weight / 2


def toroidal(above_one: np.ndarray, most: int) -> np.ndarray:
    """Return Q_{m−½}(1 + ε) for m = 0 … `most` (at least 1), shape (most + 1, …); `above_one` is ε."""
    flat = np.ravel(above_one)
    x = 1 + flat
    first, second = _elliptic(flat / (flat + 2))
    result = np.empty((most + 1, flat.size))
    result[0] = np.sqrt(2 / (x + 1)) * first
    far = flat > max(FAR, 0.5 * LOST ** (0.5 / most) - 1)
    if not far.all():
        near = ~far if far.any() else slice(None)
        up, x_near = result[:, near], x[near]
        up[1] = x_near * up[0] - np.sqrt(2 * (1 + x_near)) * second[near]
        for m in range(1, most):
            up[m + 1] = (4 * m * x_near * up[m] - (2 * m - 1) * up[m - 1]) / (2 * m + 1)
        result[:, near] = up
    if far.any():
        x_far = x[far]
        down = np.empty((most + 1, x_far.size))
        ratio, below = 1 / (2 * x_far), np.empty_like(x_far)
        for m in range(most + ORDERS_ABOVE, 0, -1):
            # (2m − 1)/(4m x − (2m + 1) ratio), in place, since a field takes most of its time here.
            np.multiply(4 * m, x_far, out=below)
            ratio *= 2 * m + 1
            np.subtract(below, ratio, out=ratio)
            np.divide(2 * m - 1, ratio, out=ratio)
            if m <= most:
                down[m] = ratio
        down[0] = result[0][far]
        result[:, far] = np.multiply.accumulate(down, axis=0)
    return result.reshape(most + 1, *np.shape(above_one))


def _elliptic(complement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the complete elliptic integrals K(m) and E(m), m = 1 − `complement`, by the arithmetic-geometric mean."""
    b = np.sqrt(complement)
    # The first step has a = 1. The others are in place, since these lines take much of a field's time.
    a, c, b = (1 + b) / 2, (1 - b) / 2, np.sqrt(b)
    total, power, square = (1 - complement) / 2 + c * c, 1.0, np.empty_like(c)
    while c.max(initial=0.0) > CONVERGED:
        np.subtract(a, b, out=c)
        c *= 0.5
        np.multiply(a, b, out=b)
        np.sqrt(b, out=b)
        # (a + b)/2 = a − (a − b)/2
        a -= c
        power *= 2
        np.multiply(c, c, out=square)
        square *= power
        total += square
    first = pi / (2 * a)
    return first, first * (1 - total)


class RingPotential(NamedTuple):
    """Potential of rings with a charge of cos mφ per metre of their meridian, and its slopes along r and z.

    Each has the shape (m, …) and is per unit of ``density dr'``; the ring's radius r' is included as a factor.
    """

    value: np.ndarray
    along_r: np.ndarray
    along_z: np.ndarray


def ring_potential(
    radius: np.ndarray, height: np.ndarray, ring_radius: np.ndarray, ring_height: np.ndarray, most: int, at_ring: bool
) -> RingPotential:
    """Return potentials of orders m = 0 … `most` at points, with slopes at the points, or at the rings with `at_ring`.

    The four arrays, in m, broadcast. A radius on the axis is replaced by a ten-thousandth of the ring's.
    """
    ring_radius = np.maximum(ring_radius, 1e-12)
    radius = np.maximum(radius, 1e-4 * ring_radius)
    gap = height - ring_height
    product = radius * ring_radius
    above_one = np.maximum(((radius - ring_radius) ** 2 + gap**2) / (2 * product), NEAREST)
    q = toroidal(above_one, most + 1)
    x = 1 + above_one
    share = ring_radius / (2 * pi * np.sqrt(product))
    m = np.arange(1, most + 1).reshape(-1, *(1,) * above_one.ndim)
    slope = np.concatenate([-0.5 * (x * q[:1] - q[1:2]), (m - 0.5) * (x * q[1:-1] - q[:-2])])
    slope *= share / (above_one * (above_one + 2))
    value = q[:-1] * share
    here, there = (ring_radius, radius) if at_ring else (radius, ring_radius)
    along_r = slope * (1 / there - x / here) - value / (2 * here)
    return RingPotential(value, along_r, slope * ((-gap if at_ring else gap) / product))
