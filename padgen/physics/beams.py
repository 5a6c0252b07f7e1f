"""Stiffness and mass of one beam, clamped at its root, as its tip feels them.

Beam axes: x along the beam at its tip, away from the root, z up, y so that the axes are right-handed. A tip
has six degrees of freedom, in this order: displacements x, y, z, rotations about x, y, z.

A straight beam has closed forms. A beam that bends in its plane is integrated along its path by the
unit-load method (Castigliano's theorem, as in Timoshenko, Strength of Materials, on thin curved bars): each
slice bends, twists, shears and stretches under what a load on the tip makes of it there. The slices are
those of a straight beam, so radii should be no smaller than the width.
"""

from typing import Any, NamedTuple

import numpy as np

from padgen.physics.path_slices import SHORTEST_M, Slices, columns, matrices, sliced, within_side, within_up

__all__ = [
    "RIGID",
    "BeamSection",
    "Flexibility",
    "Give",
    "bend_stiffening",
    "bent_slowness",
    "flexibility",
    "largest_stress",
    "piece_twist",
    "root_load",
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
    modulus in vertical bending, from ends that keep the section from curling. The ends turn about points
    `root_height` and `tip_height` (m) above the beam's axis, since what holds them stands higher than it: a beam
    that may not move along itself is stiffer for it. `warping` is the length over which the two ends of each
    straight piece of a bent beam, most often bends, keep its section from warping.
    """

    root: Array = 0.0
    tip: Array = 0.0
    lateral_root: Array = 0.0
    lateral_tip: Array = 0.0
    shear: Array = 0.0
    lateral_shear: Array = 0.0
    twist: Array = 0.0
    stiffening: Array = 1.0
    root_height: Array = 0.0
    tip_height: Array = 0.0
    stretch: Array = 0.0
    hung: Array = 0.0
    warping: Array = 0.0


RIGID = Give()


class BeamSection(NamedTuple):
    """Dimensions of a beam in m; arrays of one shape, or numbers.

    `fillet` is the radius of the flares on both sides of the root; `give` is what its ends give
    (`padgen.physics.beam_ends`), nothing by default. `path` has length and turn (rad, left positive) of each
    piece of a beam that bends, from the root, and is empty for a straight one; the flare must end on the first.
    `across` is the stiffness of the print across its layers, which lie flat, over that along them.
    """

    width: Array
    thickness: Array
    length: Array
    fillet: Array = 0.0
    give: Give = RIGID
    path: tuple[tuple[Array, Array], ...] = ()
    across: Array = 1.0


class Flexibility(NamedTuple):
    """How far a tip moves for a unit load on it, in parts: m/N, 1/N, 1/(N·m).

    Bending of the beam itself, up and sideways, as ∫ (l−s)^p ds/EI for p = 0, 1, 2; rotations of root
    and tip in both planes; shear of the beam up and sideways and of its ends; twist of both; stretch.
    """

    up: tuple[Array, Array, Array]
    side: tuple[Array, Array, Array]
    root: Array
    tip: Array
    lateral_root: Array
    lateral_tip: Array
    shear: Array
    lateral_shear: Array
    end_shear: Array
    lateral_end_shear: Array
    twist: Array
    end_twist: Array
    stretch: Array


def torsion_constant(width: Array, thickness: Array, across: Array = 1.0) -> Array:
    """Torsion constant in m⁴ of a rectangle (Roark's formula for a solid rectangle, within 0.5 %).

    With a shear modulus `across` the thickness of that share of the one along it, it is exactly that of an isotropic
    rectangle ``thickness/√across`` thick, times ``across^{3/2}`` (Lekhnitskii, Theory of Elasticity of an
    Anisotropic Body, 1963, on torsion of orthotropic bars).
    """
    tall = thickness / np.sqrt(across)
    a, b = np.maximum(width, tall), np.minimum(width, tall)
    slim = b / a
    return a * b**3 * (1 / 3 - 0.21 * slim * (1 - slim**4 / 12)) * across**1.5


def flexibility(section: BeamSection, modulus: Array, poisson: Array) -> Flexibility:
    """Stiffness of a beam that bends, shears, twists and has elastic ends. Shear coefficient after Cowper (1966).

    Layers that hold less well to each other than in themselves do not weaken bending, but shear up and twist.
    """
    width, thickness = (np.asarray(v, float) for v in section[:2])
    give = section.give
    shear_modulus = modulus / (2 * (1 + poisson))
    sheared = 10 * (1 + poisson) / (12 + 11 * poisson) * shear_modulus
    flare = _flared(section)
    plate_like = modulus * give.stiffening
    bending = modulus * width * thickness**3 / 12
    lateral = modulus * thickness * width**3 / 12
    area, torsion = width * thickness, torsion_constant(width, thickness, section.across)
    return Flexibility(
        (flare.vertical[0] / plate_like, flare.vertical[1] / plate_like, flare.vertical[2] / plate_like),
        (flare.lateral[0] / modulus, flare.lateral[1] / modulus, flare.lateral[2] / modulus),
        give.root / bending,
        give.tip / bending,
        give.lateral_root / lateral,
        give.lateral_tip / lateral,
        flare.inverse_area / (sheared * section.across),
        flare.inverse_area / sheared,
        give.shear / (area * sheared),
        give.lateral_shear / (area * sheared),
        flare.inverse_torsion / shear_modulus,
        np.maximum(give.twist / torsion, -HELD_MOST * flare.inverse_torsion) / shear_modulus,
        (flare.inverse_area + give.stretch / area) / modulus,
    )


def tip_stiffness(section: BeamSection, modulus: Array, poisson: Array) -> np.ndarray:
    """Stiffness of the tip, shape (…, 6, 6), N/m and N·m/rad.

    Timoshenko beam by the unit-load method: the flexibility is integrated along the flared width
    and inverted, so that a flare stiffens as much as it should.
    """
    if section.path:
        return _of_planes([np.linalg.inv(plane.flexibility) for plane in _planes(section, modulus, poisson)])
    length = np.asarray(section.length, float)
    parts = flexibility(section, modulus, poisson)
    stiffness = np.zeros((*np.broadcast_shapes(np.shape(parts.up[2]), np.shape(parts.root)), 6, 6))
    stiffness[..., 3, 3] = 1 / (parts.twist + parts.end_twist)
    # What the ends give turns the beam about its root (arm: the whole length) and its tip (no arm).
    up0, up1, up2 = parts.up
    root, tip, high, low = parts.root, parts.tip, section.give.root_height, section.give.tip_height
    bend = up2 + root * length**2 + parts.shear + parts.end_shear
    along = parts.stretch + root * high**2 + tip * low**2
    lifted, turned = root * high * length, -(root * high + tip * low)
    rows = [[along, lifted, turned], [lifted, bend, -(up1 + root * length)], [turned, 0.0, up0 + root + tip]]
    rows[2][1] = rows[1][2]
    give = np.stack([np.stack(np.broadcast_arrays(*row), -1) for row in rows], -2)
    stiffness[..., [[0], [2], [4]], [0, 2, 4]] = np.linalg.inv(give)
    side0, side1, side2 = parts.side
    root, tip = parts.lateral_root, parts.lateral_tip
    bend = side2 + root * length**2 + parts.lateral_shear + parts.lateral_end_shear
    _fill_pair(stiffness, 1, 5, bend, side1 + root * length, side0 + root + tip)
    return stiffness


def tip_mass(section: BeamSection, density: float, poisson: Array = 0.3) -> np.ndarray:
    """Consistent mass of the beam as its tip feels it, shape (…, 6, 6), kg, kg·m, kg·m².

    Cubic deflection of a uniform beam clamped at its root; the flare's mass hardly moves and is
    left out. A bent beam has the shape that a load on its tip gives it.
    """
    if section.path:
        masses = []
        for plane in _planes(section, 1.0, poisson):
            stiffness = np.linalg.inv(plane.flexibility)
            shape = np.einsum("...ki,...ij->...kj", plane.back, plane.running)
            masses.append(density * stiffness @ _squared(shape, plane.inertia) @ stiffness)
        return _of_planes(masses)
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


def bent_slowness(section: BeamSection, modulus: Array, poisson: Array, density: float) -> Array:
    """1/ω² in s² of the lowest mode of a bent beam held at both ends, at most: Dunkerley's sum over its slices."""
    slowness = []
    for plane in _planes(section, modulus, poisson):
        stiffness = np.linalg.inv(plane.flexibility)[..., None, :, :]
        held = plane.running - plane.running @ stiffness @ plane.running
        own = np.diagonal(plane.back @ held @ np.swapaxes(plane.back, -1, -2), axis1=-2, axis2=-1)
        slowness.append(density * (own * plane.inertia).sum((-2, -1)))
    return np.maximum(*slowness)


def root_load(section: BeamSection, load: np.ndarray) -> np.ndarray:
    """Forces and moments (…, 6) at the root, in its own directions there, for a `load` (…, 6) on the tip."""
    if section.path:
        return _loads(section, load)[0][..., 0, :]
    moved = load.copy()
    moved[..., 4] -= section.length * load[..., 2]
    moved[..., 5] += section.length * load[..., 1]
    return moved


def largest_stress(section: BeamSection, load: np.ndarray) -> Array:
    """Largest stress (…) in Pa along a beam for a `load` (…, 6) on its tip, notch factors left out.

    Of a straight beam, in vertical bending: the moment is linear and the section uniform but for the flare, so it is
    at the root, where the flare ends, or at the tip. Of a bent one, of bending both ways and torsion together, after
    von Mises (torsion of a rectangle by Roark's formula).
    """
    thickness = np.asarray(section.thickness, float)
    if section.path:
        loads, width = _loads(section, load)
        t = thickness[..., None]
        slim = np.minimum(width, t) / np.maximum(width, t)
        pulled = (np.abs(loads[..., 4]) / t + np.abs(loads[..., 5]) / width) * 6 / (width * t)
        series = 1 + slim * (0.6095 + slim * (0.8865 + slim * (-1.8023 + slim * 0.91)))
        twisted = 3 * loads[..., 3] / (width * t * np.minimum(width, t)) * series
        return np.sqrt(pulled**2 + 3 * twisted**2).max(-1)
    stations: list[tuple[Any, Any]] = [
        (0.0, section.width + 2 * np.asarray(section.fillet)),
        (section.fillet, section.width),
        (section.length, section.width),
    ]
    stresses = [
        np.abs(load[..., 2] * (section.length - at) - load[..., 4]) * 6 / (width * section.thickness**2)
        for at, width in stations
    ]
    return np.maximum.reduce(np.broadcast_arrays(*stresses))


class _Flared(NamedTuple):
    """Integrals along a beam without its moduli: bending is ∫ (l−s)^p ds/I for p = 0, 1, 2."""

    vertical: list[Array]
    lateral: list[Array]
    inverse_area: Array
    inverse_torsion: Array


def _flared(section: BeamSection) -> _Flared:
    """The integrals of a beam whose width flares at the root, by Gauss points within the flare."""
    width, thickness, length, fillet = (np.asarray(v, float) for v in section[:4])
    across = np.asarray(section.across, float)
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
        (weight / torsion_constant(flared, t, across[..., None])).sum(-1)
        + straight / torsion_constant(width, thickness, across),
    )


def _fill_pair(matrix: np.ndarray, i: int, j: int, ii: Array, ij: Array, jj: Array) -> None:
    """Put the inverse of the 2 × 2 flexibility [[ii, ij], [ij, jj]] at rows and columns i, j."""
    determinant = ii * jj - ij**2
    matrix[..., i, i] = jj / determinant
    matrix[..., j, j] = ii / determinant
    matrix[..., i, j] = matrix[..., j, i] = -ij / determinant


_UP, _SIDE = [2, 3, 4], [0, 1, 5]
"""Degrees of freedom out of the beam's plane and in it, which a bent beam of rectangular section keeps apart."""


class _Plane(NamedTuple):
    """Flexibility of a bent beam in three degrees of freedom.

    For each slice: the three parts of the load `within` it for loads on the tip (…, k, 3, 3), what it gives under them
    `give` (…, k, 3); the motion there from that of the tip as if it were rigid (`back`, …, k, 3, 3); mass and inertia
    over density (…, k, 3). What `root` and `tip` give (…, 3).
    """

    slices: Slices
    within: np.ndarray
    back: np.ndarray
    give: np.ndarray
    root: np.ndarray
    tip: np.ndarray
    inertia: np.ndarray

    @property
    def flexibility(self) -> Array:
        """Of the tip (…, 3, 3)."""
        given = self.give * self.slices.running[-1][:, None]
        return _squared(self.within, given) + self._at_root + self.tip[..., None] * np.eye(3)

    @property
    def running(self) -> Array:
        """Flexibility (…, k, 3, 3) of the beam from the root to each slice, for loads on the tip."""
        # Sums written out: products of 3 x 3 matrices one by one take ten times as long.
        grown = np.einsum("...ki,...k,...kj->...ij", self.within, self.give, self.within)
        running = np.einsum("sp,...pij->...sij", self.slices.running, grown, optimize=True)
        return running + self._at_root[..., None, :, :]

    @property
    def _at_root(self) -> Array:
        # What an end gives in twist is negative where it holds the warping, and has no root that `_squared` could take.
        first = self.within[..., 0, :, :]
        held: Array = np.swapaxes(first, -1, -2) @ (self.root[..., None] * first)
        return held


def _squared(rows: np.ndarray, weight: np.ndarray) -> Array:
    """Sum (…, 3, 3) over slices (…, k, 3, 3) of their rows times themselves, each with its `weight` (…, k, 3)."""
    scaled = np.sqrt(weight)[..., None] * rows
    flat = scaled.reshape(*scaled.shape[:-3], -1, 3)
    return np.swapaxes(flat, -1, -2) @ flat


def _planes(section: BeamSection, modulus: Array, poisson: Array) -> tuple[_Plane, _Plane]:
    """How a bent beam moves out of its plane (up, and turning about x and y), and in it (along, sideways, about z)."""
    slices, parts = sliced(section.path, section.width, section.fillet), flexibility(section, modulus, poisson)
    x, y, cosine, sine, zero = slices.x, slices.y, slices.cosine, slices.sine, 0.0 * slices.x
    plain, thickness, stiffening = (
        np.asarray(v, float)[..., None] for v in (section.width, section.thickness, section.give.stiffening)
    )
    width = slices.width
    shear_modulus = modulus / (2 * (1 + poisson))
    sheared = 10 * (1 + poisson) / (12 + 11 * poisson) * shear_modulus
    across = np.asarray(section.across, float)[..., None]
    area, line, torsion = width * thickness, plain * thickness, torsion_constant(width, thickness, across)
    bending, lateral = modulus * stiffening * width * thickness**3 / 12, modulus * thickness * width**3 / 12
    high, wide = plain * thickness**3 / 12, thickness * plain**3 / 12
    inner = bend_stiffening(slices.curved)
    twisting = piece_twist(slices.straight, np.asarray(section.give.warping)[..., None]) / inner
    # What both ends give together, each gives half of.
    shear, twist, slip = parts.end_shear / 2, parts.end_twist / 2, parts.lateral_end_shear / 2
    pull, push = [cosine, sine, x * sine - y * cosine], [-sine, cosine, x * cosine + y * sine]
    return (
        _plane(
            slices,
            within_up(slices),
            matrices([1 + zero, y, -x], [zero, cosine, sine], [zero, -sine, cosine]),
            [1 / (area * sheared * across), twisting / (torsion * shear_modulus), 1 / (bending * inner)],
            ([shear, twist, parts.root], [shear, twist, parts.tip]),
            [line, high + wide, high],
        ),
        _plane(
            slices,
            within_side(slices),
            matrices(pull, push, [zero, zero, 1 + zero]),
            [1 / (area * modulus), 1 / (area * sheared), 1 / lateral],
            ([0 * slip, slip, parts.lateral_root], [0 * slip, slip, parts.lateral_tip]),
            [line, line, wide],
        ),
    )


def bend_stiffening(curved: Array) -> Array:
    """Ratio by which a bend is stiffer out of its plane than a straight beam, by its width over twice its radius.

    Slices turn as wholes, and their inner sides over less length: the first term of the mean across the width of the
    axis' radius over the radius there (as in Winkler's theory of thick curved bars, Timoshenko, Strength of Materials).
    All terms together overrate sharp bends (docs/accuracy.md).
    """
    return 1 + curved**2 / 3


def piece_twist(straight: Array, warping: Array) -> Array:
    """Twist of a straight piece of a bent beam, over that of one whose ends warp freely (`Give.warping`)."""
    pieces = np.maximum(straight, SHORTEST_M) / np.maximum(warping, SHORTEST_M)
    return 1 - np.tanh(pieces) / pieces


def _plane(
    slices: Slices,
    within: np.ndarray,
    back: np.ndarray,
    give: list[Array],
    ends: tuple[list[Array], list[Array]],
    inertia: list[Array],
) -> _Plane:
    """The motion in three degrees of freedom: `give` of a slice per length, and of root and tip, under the three parts
    of the load `within` the beam; `inertia` per length over density."""
    root, tip = (columns(end) for end in ends)
    share = slices.share[..., None]
    weight = slices.running[-1][:, None] * share
    return _Plane(slices, within, back, columns(give) * share, root, tip, columns(inertia) * weight)


def _loads(section: BeamSection, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces and moments (…, k, 6) at the slices of a bent beam for a `load` (…, 6) on its tip, and widths (…, k)."""
    slices = sliced(section.path, section.width, section.fillet)
    parts = [
        np.einsum("...pij,...j->...pi", within(slices), load[..., index])
        for within, index in ((within_up, _UP), (within_side, _SIDE))
    ]
    return np.concatenate(parts, -1)[..., np.argsort(_UP + _SIDE)], slices.width


def _of_planes(planes: list[np.ndarray]) -> np.ndarray:
    """A matrix (…, 6, 6) from its parts (…, 3, 3) out of the plane and in it."""
    whole = np.zeros((*planes[0].shape[:-2], 6, 6))
    for index, part in zip((_UP, _SIDE), planes, strict=True):
        whole[..., np.array(index)[:, None], index] = part
    return whole
