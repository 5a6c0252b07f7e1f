"""Stiffness and mass of one straight beam, clamped at its root, as its tip feels them.

Beam axes: x from root to tip, z up, y so that the axes are right-handed. A tip has six degrees
of freedom, in this order: displacements x, y, z, rotations about x, y, z.
"""

from typing import Any, NamedTuple

import numpy as np

__all__ = ["BeamSection", "tip_mass", "tip_stiffness", "torsion_constant"]

Array = Any

ANTICLASTIC_RATIO = 1.6
"""Width over length at which half of the anticlastic stiffening has come: fitted (docs/accuracy.md)."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_NODES, _WEIGHTS = (_NODES + 1) / 2, _WEIGHTS / 2


class BeamSection(NamedTuple):
    """Dimensions of a beam in m; arrays of one shape, or numbers.

    `fillet` is the radius of the flares on both sides of the root. `root_give` and `tip_give` are
    the rotations of what the ends are held by, as lengths of beam that would turn as much under the
    same moment.
    """

    width: Array
    thickness: Array
    length: Array
    fillet: Array = 0.0
    root_give: Array = 0.0
    tip_give: Array = 0.0


def torsion_constant(width: Array, thickness: Array) -> Array:
    """Torsion constant in m⁴ of a rectangle (Roark's formula for a solid rectangle, within 0.5 %)."""
    a, b = np.maximum(width, thickness), np.minimum(width, thickness)
    slim = b / a
    return a * b**3 * (1 / 3 - 0.21 * slim * (1 - slim**4 / 12))


def tip_stiffness(section: BeamSection, modulus: Array, poisson: float) -> np.ndarray:
    """Stiffness of the tip, shape (…, 6, 6), N/m and N·m/rad.

    Timoshenko beam by the unit-load method: the flexibility is integrated along the flared width
    and inverted, so that a flare stiffens as much as it should. Shear coefficient after Cowper
    (1966).
    """
    length = np.asarray(section.length, float)
    shear_modulus = modulus / (2 * (1 + poisson))
    shear_factor = 10 * (1 + poisson) / (12 + 11 * poisson)
    flare = _flexibility(section)
    plate_like = modulus * anticlastic_stiffening(section, poisson)
    up0, up1, up2 = (v / plate_like for v in flare.bending_vertical)
    side0, side1, side2 = (v / modulus for v in flare.bending_lateral)
    # What the ends give turns the beam about its root (arm: the whole length) and its tip (no arm).
    bending = modulus * section.width * np.asarray(section.thickness, float) ** 3 / 12
    root, tip = section.root_give / bending, section.tip_give / bending
    up0, up1, up2 = up0 + root + tip, up1 + root * length, up2 + root * length**2
    area = flare.inverse_area
    shear = area / (shear_factor * shear_modulus)
    twist = flare.inverse_torsion / shear_modulus

    stiffness = np.zeros((*np.shape(length), 6, 6))
    stiffness[..., 0, 0] = modulus / area
    stiffness[..., 3, 3] = 1 / twist
    _fill_pair(stiffness, 2, 4, up2 + shear, -up1, up0)
    _fill_pair(stiffness, 1, 5, side2 + shear, side1, side0)
    return stiffness


def anticlastic_stiffening(section: BeamSection, poisson: float) -> np.ndarray:
    """Factor on the modulus in vertical bending, from 1 (narrow) to ``1/(1−ν²)`` (wide and short).

    The clamped ends keep a wide beam from curling across its width; how far along the beam that
    reaches goes with its width. The form is empirical, fitted to elasticity (docs/accuracy.md).
    """
    slimness = ANTICLASTIC_RATIO * np.asarray(section.length, float) / section.width
    return np.asarray(1 + poisson**2 / (1 - poisson**2) / (1 + slimness**2))


def tip_mass(section: BeamSection, density: float) -> np.ndarray:
    """Consistent mass of the beam as its tip feels it, shape (…, 6, 6), kg, kg·m, kg·m².

    Cubic deflection of a uniform beam clamped at its root; the flare's mass hardly moves and is
    left out.
    """
    width, thickness, length = (np.asarray(v, float) for v in section[:3])
    beam = density * width * thickness * length
    polar = (width**2 + thickness**2) / 12
    mass = np.zeros((*np.shape(beam), 6, 6))
    mass[..., 0, 0] = beam / 3
    mass[..., 3, 3] = beam * polar / 3
    for shift, turn, sign in ((2, 4, 1), (1, 5, -1)):
        mass[..., shift, shift] = beam * 13 / 35
        mass[..., shift, turn] = mass[..., turn, shift] = sign * beam * length * 11 / 210
        mass[..., turn, turn] = beam * length**2 / 105
    return mass


class _Flexibility(NamedTuple):
    """Integrals along a beam without its moduli: ``bending_*`` are ∫ (l−s)^p ds/I for p = 0, 1, 2."""

    bending_vertical: list[Array]
    bending_lateral: list[Array]
    inverse_area: Array
    inverse_torsion: Array


def _flexibility(section: BeamSection) -> _Flexibility:
    """The integrals of a beam whose width flares at the root, by Gauss points within the flare."""
    width, thickness, length, fillet = (np.asarray(v, float) for v in section[:4])
    start = np.minimum(fillet, length)
    at = _NODES * start[..., None]
    radius = fillet[..., None]
    flared = width[..., None] + 2 * (radius - np.sqrt(np.maximum(radius**2 - (radius - at) ** 2, 0)))
    t = thickness[..., None]
    weight, arm, straight = _WEIGHTS * start[..., None], length[..., None] - at, length - start

    def moments(flared_inertia: Array, uniform_inertia: Array) -> list[Array]:
        return [
            (weight * arm**p / flared_inertia).sum(-1) + straight ** (p + 1) / (p + 1) / uniform_inertia
            for p in range(3)
        ]

    return _Flexibility(
        moments(flared * t**3 / 12, width * thickness**3 / 12),
        moments(t * flared**3 / 12, thickness * width**3 / 12),
        (weight / (flared * t)).sum(-1) + straight / (width * thickness),
        (weight / torsion_constant(flared, t)).sum(-1) + straight / torsion_constant(width, thickness),
    )


def _fill_pair(matrix: np.ndarray, i: int, j: int, ii: Array, ij: Array, jj: Array) -> None:
    """Put the inverse of the 2 × 2 flexibility [[ii, ij], [ij, jj]] at rows and columns i, j."""
    determinant = ii * jj - ij**2
    matrix[..., i, i] = jj / determinant
    matrix[..., j, j] = ii / determinant
    matrix[..., i, j] = matrix[..., j, i] = -ij / determinant
