"""Stiffness and mass of one straight beam, clamped at its root, as its tip feels them.

Beam axes: x from root to tip, z up, y so that the axes are right-handed. A tip has six degrees
of freedom, in this order: displacements x, y, z, rotations about x, y, z.
"""

from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "RIGID",
    "BeamSection",
    "Flexibility",
    "Give",
    "flexibility",
    "tip_mass",
    "tip_stiffness",
    "torsion_constant",
]

Array = Any

HELD_MOST = 0.85
"""Share of a beam's twist that ends may take away by holding its warping."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_NODES, _WEIGHTS = (_NODES + 1) / 2, _WEIGHTS / 2


class Give(NamedTuple):
    """What the ends of a beam give, each as the length in m of beam that would give as much.

    Rotations of root and tip in vertical and in lateral bending, under a moment; displacement of both
    ends together, up and sideways, under a shear force; rotation of both together about the beam's
    axis, negative where the ends keep the section from warping. `stiffening` is a factor on the
    modulus in vertical bending, from ends that keep the section from curling.
    """

    root: Array = 0.0
    tip: Array = 0.0
    lateral_root: Array = 0.0
    lateral_tip: Array = 0.0
    shear: Array = 0.0
    lateral_shear: Array = 0.0
    twist: Array = 0.0
    stiffening: Array = 1.0


RIGID = Give()


class BeamSection(NamedTuple):
    """Dimensions of a beam in m; arrays of one shape, or numbers.

    `fillet` is the radius of the flares on both sides of the root; `give` is what its ends give
    (`padgen.physics.beam_ends`), nothing by default.
    """

    width: Array
    thickness: Array
    length: Array
    fillet: Array = 0.0
    give: Give = RIGID


class Flexibility(NamedTuple):
    """How far a tip moves for a unit load on it, in parts: m/N, 1/N, 1/(N·m).

    Bending of the beam itself, up and sideways, as ∫ (l−s)^p ds/EI for p = 0, 1, 2; rotations of root
    and tip in both planes; shear and twist of the beam and of its ends; stretch.
    """

    up: tuple[Array, Array, Array]
    side: tuple[Array, Array, Array]
    root: Array
    tip: Array
    lateral_root: Array
    lateral_tip: Array
    shear: Array
    end_shear: Array
    lateral_end_shear: Array
    twist: Array
    end_twist: Array
    stretch: Array


def torsion_constant(width: Array, thickness: Array) -> Array:
    """Torsion constant in m⁴ of a rectangle (Roark's formula for a solid rectangle, within 0.5 %)."""
    a, b = np.maximum(width, thickness), np.minimum(width, thickness)
    slim = b / a
    return a * b**3 * (1 / 3 - 0.21 * slim * (1 - slim**4 / 12))


def flexibility(section: BeamSection, modulus: Array, poisson: Array) -> Flexibility:
    """What bends, shears, twists and gives. Shear coefficient after Cowper (1966)."""
    width, thickness = (np.asarray(v, float) for v in section[:2])
    give = section.give
    shear_modulus = modulus / (2 * (1 + poisson))
    sheared = 10 * (1 + poisson) / (12 + 11 * poisson) * shear_modulus
    flare = _flared(section)
    plate_like = modulus * give.stiffening
    bending = modulus * width * thickness**3 / 12
    lateral = modulus * thickness * width**3 / 12
    area, torsion = width * thickness, torsion_constant(width, thickness)
    return Flexibility(
        (flare.vertical[0] / plate_like, flare.vertical[1] / plate_like, flare.vertical[2] / plate_like),
        (flare.lateral[0] / modulus, flare.lateral[1] / modulus, flare.lateral[2] / modulus),
        give.root / bending,
        give.tip / bending,
        give.lateral_root / lateral,
        give.lateral_tip / lateral,
        flare.inverse_area / sheared,
        give.shear / (area * sheared),
        give.lateral_shear / (area * sheared),
        flare.inverse_torsion / shear_modulus,
        np.maximum(give.twist / torsion, -HELD_MOST * flare.inverse_torsion) / shear_modulus,
        flare.inverse_area / modulus,
    )


def tip_stiffness(section: BeamSection, modulus: Array, poisson: Array) -> np.ndarray:
    """Stiffness of the tip, shape (…, 6, 6), N/m and N·m/rad.

    Timoshenko beam by the unit-load method: the flexibility is integrated along the flared width
    and inverted, so that a flare stiffens as much as it should.
    """
    length = np.asarray(section.length, float)
    parts = flexibility(section, modulus, poisson)
    stiffness = np.zeros((*np.broadcast_shapes(np.shape(parts.up[2]), np.shape(parts.root)), 6, 6))
    stiffness[..., 0, 0] = 1 / parts.stretch
    stiffness[..., 3, 3] = 1 / (parts.twist + parts.end_twist)
    # What the ends give turns the beam about its root (arm: the whole length) and its tip (no arm).
    up0, up1, up2 = parts.up
    root, tip = parts.root, parts.tip
    bend = up2 + root * length**2 + parts.shear + parts.end_shear
    _fill_pair(stiffness, 2, 4, bend, -(up1 + root * length), up0 + root + tip)
    side0, side1, side2 = parts.side
    root, tip = parts.lateral_root, parts.lateral_tip
    bend = side2 + root * length**2 + parts.shear + parts.lateral_end_shear
    _fill_pair(stiffness, 1, 5, bend, side1 + root * length, side0 + root + tip)
    return stiffness


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


class _Flared(NamedTuple):
    """Integrals along a beam without its moduli: bending is ∫ (l−s)^p ds/I for p = 0, 1, 2."""

    vertical: list[Array]
    lateral: list[Array]
    inverse_area: Array
    inverse_torsion: Array


def _flared(section: BeamSection) -> _Flared:
    """The integrals of a beam whose width flares at the root, by Gauss points within the flare."""
    width, thickness, length, fillet = (np.asarray(v, float) for v in section[:4])
    start = np.minimum(fillet, length)
    at = _NODES * start[..., None]
    radius = fillet[..., None]
    flared = width[..., None] + 2 * (radius - np.sqrt(np.maximum(radius**2 - (radius - at) ** 2, 0)))
    t = thickness[..., None]
    weight, arm, straight = _WEIGHTS * start[..., None], length[..., None] - at, length - start

    def moments(flared_inertia: Array, uniform_inertia: Array) -> list[Array]:
        terms, run, found = weight / flared_inertia, straight / uniform_inertia, []
        for power in (1, 2, 3):
            found.append(terms.sum(-1) + run / power)
            terms, run = terms * arm, run * straight
        return found

    return _Flared(
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
