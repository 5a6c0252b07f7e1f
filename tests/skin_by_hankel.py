"""A punch on layers by Hankel transforms: no mesh, written from the equations of motion, to judge finite elements by.

Incompressible viscoelastic layers under a frictionless flat punch. Displacements are ``u_r = U J1(kr)``, ``u_z = W
J0(kr)`` with ``kU + W' = 0``: of potentials that go as exp(±kz), with a pressure, and as exp(±βz), ``β² = k² − ρω²/G``,
without. The pressure under the punch is a sum of functions whose transforms are spherical Bessel functions; the first
alone is the static answer on a half-space (Sneddon 1965).
"""

from itertools import pairwise
from math import pi

import numpy as np
from scipy.special import spherical_jn

TERMS = 16
WAVES = 1200
FARTHEST = 400.0
"""Terms of the pressure, points of the integral over k in each of its decades, and its end in 1/radius."""


def compliance(k: np.ndarray, hz: float, layers: list[tuple[float, complex, float]]) -> np.ndarray:
    """Return W at the surface under a unit pressure of wave numbers k; layers are thickness, complex G, density."""
    omega = 2 * pi * hz
    count = 4 * len(layers) - 2
    matrix = np.zeros((len(k), count, count), complex)
    right = np.zeros((len(k), count), complex)
    right[:, 0] = 1.0

    def states(shear, density, depth, thickness):
        """Return U, W, σ_zz, σ_rz (k, 4, 4 or 2) at `depth` below a layer's top: waves going down, then up."""
        beta = np.sqrt(k**2 - density * omega**2 / shear + 0j)
        columns = []
        for sign in (-1, 1):
            if sign > 0 and thickness == np.inf:
                continue
            way = depth if sign < 0 else thickness - depth
            # z points down, so that a wave that decays downwards has the slope -k.
            for slope, is_pressed in ((sign * k, True), (sign * beta, False)):
                size = np.exp(-sign * slope * way)
                if is_pressed:
                    u = -k * size
                    w = slope * size
                    pressure = density * omega**2 * size
                else:
                    u = -slope * size
                    w = k * size
                    pressure = 0 * size
                columns.append([u, w, -pressure + 2 * shear * slope * w, shear * (slope * u - k * w)])
        return np.moveaxis(np.array(columns), -1, 0).swapaxes(1, 2)

    top = states(layers[0][1], layers[0][2], 0.0, layers[0][0])
    width = top.shape[2]
    matrix[:, 0, :width] = -top[:, 2]  # a pressure of 1 is σ_zz = -1
    matrix[:, 1, :width] = top[:, 3]
    row = 2
    at = 0
    for (thickness, shear, density), below in pairwise(layers):
        here = states(shear, density, thickness, thickness)
        there = states(below[1], below[2], 0.0, below[0])
        matrix[:, row : row + 4, at : at + 4] = here
        matrix[:, row : row + 4, at + 4 : at + 4 + there.shape[2]] = -there
        row += 4
        at += 4
    solved = np.linalg.solve(matrix, right[..., None])[..., 0]
    return (top[:, 1] * solved[:, :width]).sum(1)


def punch_stiffness(radius: float, hz: float, layers: list[tuple[float, complex, float]]) -> complex:
    """Return the dynamic stiffness in N/m; the frequency must not be 0."""
    edges = np.concatenate([[0.0], np.logspace(-3, np.log10(FARTHEST), 60)]) / radius
    x, weight = np.polynomial.legendre.leggauss(WAVES // 20)
    k = ((edges[1:] + edges[:-1])[:, None] / 2 + np.diff(edges)[:, None] / 2 * x).ravel()
    weights = (np.diff(edges)[:, None] / 2 * weight).ravel()
    shapes = np.array([radius * (-1) ** n * spherical_jn(2 * n, k * radius) for n in range(TERMS)])
    matrix = (shapes * (compliance(k, hz, layers) * k * weights)) @ shapes.T
    # Beyond the end the compliance is that of the outer layer at rest, 1/(2 G k), and (-1)^n j_2n(x) is sin(x)/x.
    matrix = matrix + radius / (2 * layers[0][1]) / (2 * FARTHEST)
    ends = np.zeros(TERMS)
    ends[0] = radius
    return complex(2 * pi * ends @ np.linalg.solve(matrix, ends))
