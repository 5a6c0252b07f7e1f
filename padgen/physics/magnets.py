"""Small disc and ring magnets by themselves: shape, polarisation, what demagnetises them, and their pull on each other.

A magnet magnetised along its axis is two charged faces. The charge of a face is a Bessel integral over wave numbers k
(Hankel transform; Watson, *Theory of Bessel Functions*, 1944, 11.3), so that energies are integrals of one variable.
The polarisation is even and fixed. `magnet_pull` has coils and cores. SI units.
"""

from functools import lru_cache
from math import ceil, log, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from padgen.physics.magnetics import (
    BLOCK,
    MU_0,
    SteelRing,
    gauss,
    graded_quadrature,
    ring_potential,
    steel_body,
    tube_outline,
)

__all__ = [
    "DECAY",
    "Coupling",
    "DiscMagnet",
    "bessel",
    "demagnetising_factor",
    "dipole_stiffness",
    "eddy_damping",
    "face_factor",
    "face_flux",
    "margin_temperature",
    "neighbour_pull",
    "neighbour_stiffness",
    "steel_charges",
    "wave_points",
    "working_polarisation",
]

DECAY = 10.0
"""Largest wave number times the least gap: all that is left out falls with exp(−10) and with powers of it."""
PANEL_NODES = 32
PANEL_PHASE = 44.0
"""Gauss points of a panel, and the phase in rad by which waves may turn within it."""


class DiscMagnet(NamedTuple):
    """A disc or ring magnetised along its axis: diameters and height in m, polarisation in T (`working_polarisation`).

    `inner_diameter` 0 is a disc.
    """

    outer_diameter: float
    inner_diameter: float
    height: float
    polarisation: float

    @property
    def volume(self) -> float:
        """Volume in m³."""
        return pi / 4 * (self.outer_diameter**2 - self.inner_diameter**2) * self.height

    @property
    def moment(self) -> float:
        """Magnetic moment in A·m²."""
        return self.polarisation * self.volume / MU_0

    @property
    def rims(self) -> tuple[tuple[float, int], ...]:
        """Radii in m of the outer and the inner edge, each with a sign: 1 for the disc, −1 for the hole."""
        outer = (self.outer_diameter / 2, 1)
        return (outer, (self.inner_diameter / 2, -1)) if self.inner_diameter else (outer,)


MILLER = 16.0
"""Argument from which on Bessel functions run up from Hankel's asymptotic series, exact there to 1e-12."""


def bessel(x: np.ndarray, most: int) -> np.ndarray:
    """Return the Bessel functions J_m(x) for m = 0 … `most` (at least 1), shape (most + 1, …), to 1e-10.

    For x below 16 and below `most` by Miller's downward recurrence, else by Hankel's series (DLMF 10.17.3) and upwards.
    """
    flat = np.ravel(np.asarray(x, float))
    result = np.empty((most + 1, flat.size))
    for start in range(0, flat.size, BLOCK):
        block = slice(start, start + BLOCK)
        result[:, block] = _bessel_of(flat[block], most)
    return result.reshape(most + 1, *np.shape(x))


def _bessel_of(x: np.ndarray, most: int) -> np.ndarray:
    """Return the Bessel functions J_m(x) (most + 1, n), m = 0 … `most`, for one block of arguments x (n,)."""
    result = np.empty((most + 1, *x.shape))
    near = x < max(MILLER, most)
    if near.any():
        result[:, near] = _downward(x[near], most)
    if not near.all():
        far = ~near
        x_far = x[far]
        up = np.empty((most + 1, x_far.size))
        up[0], up[1] = (_asymptotic(x_far, order) for order in (0, 1))
        for m in range(1, most):
            up[m + 1] = 2 * m / x_far * up[m] - up[m - 1]
        result[:, far] = up
    return result


def _downward(x: np.ndarray, most: int) -> np.ndarray:
    """Return J_m(x) (most + 1, n) by Miller's downward recurrence, scaled so that J₀ + 2 Σ J_2m = 1."""
    start = 8 * ceil((max(MILLER, most) + 20) / 8)
    twice = 2 / np.maximum(x, 1e-8)
    result = np.empty((most + 1, x.size))
    above = np.zeros(x.size)
    at = np.full(x.size, 1e-280)
    even = np.zeros(x.size)
    for m in range(start, 0, -1):
        if m <= most:
            result[m] = at
        if m % 2 == 0:
            even += at
        below = m * twice
        below *= at
        below -= above
        above = at
        at = below
        if m % 8 == 0:  # eight steps grow by less than 1e90
            large = np.abs(at) > 1e150
            if large.any():
                for part in (above, at, even, *result[m:]):
                    part[large] *= 1e-200
    result[0] = at
    return result / (at + 2 * even)


def _asymptotic(x: np.ndarray, order: int) -> np.ndarray:
    """Return J_0 or J_1 by Hankel's series."""
    square = 4 * order**2
    term = np.ones_like(x)
    parts = [np.ones_like(x), np.zeros_like(x)]
    for n in range(1, 17):
        term = term * (square - (2 * n - 1) ** 2) / (8 * n * x)
        parts[n % 2] += term if n % 4 < 2 else -term
    turned = x - (order / 2 + 0.25) * pi
    return np.sqrt(2 / (pi * x)) * (parts[0] * np.cos(turned) - parts[1] * np.sin(turned))


def wave_points(end: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return quadrature points on 0 … `end` and weights that integrate waves of up to `rate` rad per unit."""
    panels = ceil(end * rate / PANEL_PHASE)
    node, weight = gauss(PANEL_NODES)
    step = end / panels
    return ((np.arange(panels)[:, None] + node) * step).ravel(), np.tile(weight * step, panels)


def face_flux(magnet: DiscMagnet, k: np.ndarray) -> np.ndarray:
    """Return ∫ J₀(kρ) dA/2π over a face in m², ``(a J₁(ka) − b J₁(kb))/k``, at wave numbers k in 1/m."""
    return sum((sign * a * bessel(k * a, 1)[1] for a, sign in magnet.rims), np.zeros_like(k)) / k


class Coupling(NamedTuple):
    """Static magnetic `force` on n magnets in N, and the `stiffness` (n, n) in N/m that couples their vertical motions.

    With z upwards the additional vertical forces are ``−stiffness @ z``.
    """

    force: np.ndarray
    stiffness: np.ndarray


def neighbour_pull(magnet: DiscMagnet, places: np.ndarray, polarity: np.ndarray) -> Coupling:
    """Return the coupling of equal magnets at `places` (n, 2) in m and one height; their `polarity` (n,) is 1 or −1.

    `force` (n, 2) in N is along x and y; at one height they push each other sideways only. By the charges of their
    faces; far away the stiffness is `dipole_stiffness`. They must be a twentieth of their diameter apart at least.
    """
    away = places[:, None] - places
    apart = np.hypot(*np.moveaxis(away, -1, 0))
    rounded = np.round(apart, 9)
    side, stiffness = np.zeros((2, *apart.shape))
    for distance in sorted(set(rounded[rounded > 0])):
        side[rounded == distance], stiffness[rounded == distance] = _beside(magnet, distance)
    signs = np.multiply.outer(polarity, polarity)
    pushed = (signs * side)[..., None] * away / np.where(apart > 0, apart, 1.0)[..., None]
    return Coupling(pushed.sum(1), _laplacian(signs * stiffness))


def _laplacian(stiffness: np.ndarray) -> np.ndarray:
    """Return the stiffness matrix of springs between all pairs, from each pair's `stiffness` (n, n), diagonal 0."""
    return np.diag(stiffness.sum(1)) - stiffness


@lru_cache(maxsize=256)
def _beside(magnet: DiscMagnet, apart: float) -> tuple[float, float]:
    """Return two like-poled magnets' repulsion in N, and d²U/dz² in N/m of their energy U if one is lifted by z."""
    outer = magnet.outer_diameter / 2
    inner = magnet.inner_diameter / 2
    turns = min(max(ceil(16 / log((apart - outer) / outer)), 12), 96)
    node, weight = gauss(8)
    square = inner**2 + (outer**2 - inner**2) * node  # even steps of area
    angle = (np.arange(turns) + 0.5) * 2 * pi / turns
    x, y = (np.sqrt(square)[:, None] * wave for wave in (np.cos(angle), np.sin(angle)))
    charge = np.repeat(weight, turns) / turns * magnet.moment / magnet.height
    along = apart + x.reshape(-1, 1) - x.ravel()
    level = along**2 + (y.reshape(-1, 1) - y.ravel()) ** 2
    slant = level + magnet.height**2
    push = along * (level**-1.5 - slant**-1.5)
    bend = slant**-1.5 - 3 * magnet.height**2 * slant**-2.5 - level**-1.5
    scale = MU_0 / (2 * pi)
    return float(scale * (charge @ push @ charge)), float(scale * (charge @ bend @ charge))


NEAREST_KNOWN = 1.25
"""Distance over the diameter from which on stiffnesses are interpolated; nearer ones are computed one by one."""
KNOWN = 20
"""Distances at which they are computed. Interpolated ones are within 1e-6 of those computed one by one."""


def neighbour_stiffness(magnet: DiscMagnet, apart: np.ndarray, steel: SteelRing | None = None) -> np.ndarray:
    """Return d²U/dz² (…) in N/m of the energy U of two equal magnets, axes `apart` (…) in m, if one is lifted by z.

    They are of one polarity, `apart` is between their axes; `steel` is that on top of each. Over `dipole_stiffness` it
    is a smooth function of the inverse square of the distance.
    """
    apart = np.asarray(apart, float)
    wide = max(magnet.outer_diameter, steel.outer_diameter if steel else 0.0)
    square = (wide / apart) ** 2
    share = chebyshev.chebval(2 * square * NEAREST_KNOWN**2 - 1, _over_dipoles(magnet, steel, wide))
    result = np.asarray(share * dipole_stiffness(magnet.moment, apart))
    for place in zip(*np.nonzero(apart < NEAREST_KNOWN * wide), strict=True):
        result[place] = _pair_stiffness(magnet, float(apart[place]), steel)
    return result


@lru_cache(maxsize=64)
def _over_dipoles(magnet: DiscMagnet, steel: SteelRing | None, wide: float) -> np.ndarray:
    """Return Chebyshev coefficients, in 1/distance², of the ratio of two magnets' stiffness to two dipoles'."""
    node = chebyshev.chebpts1(KNOWN)
    apart = wide * NEAREST_KNOWN / np.sqrt((node + 1) / 2)
    stiffness = np.array([_pair_stiffness(magnet, float(distance), steel) for distance in apart])
    return np.asarray(chebyshev.chebfit(node, stiffness / dipole_stiffness(magnet.moment, apart), KNOWN - 1))


STEEL_NODES = 10
"""Nodes on each side of the steel on a magnet."""
RING_TURNS = 16
"""Places round each ring of the steel's charge, for its pull on neighbours."""


@lru_cache(maxsize=64)
def steel_charges(magnet: DiscMagnet, steel: SteelRing) -> np.ndarray:
    """Return the charge that a magnet induces on a piece of steel that lies on top of it, as rings (3, n).

    They are radii and heights above the magnet's underside in m, and charges in A·m. The steel is linear; its charge
    moves with the magnet, so that a coil's current pulls on it in proportion. What the current itself magnetises is
    left out: it goes with the current's square.
    """
    low = magnet.height
    nodes = (STEEL_NODES, STEEL_NODES)
    outline = tube_outline(steel.outer_diameter / 2, steel.inner_diameter / 2, low, low + steel.thickness, nodes)
    body = steel_body(outline, steel.permeability, 0)
    density = magnet.polarisation / MU_0
    potential = np.zeros(len(body.area))
    start = magnet.inner_diameter / 2
    end = magnet.outer_diameter / 2
    nearest = np.clip((body.radius - start) / (end - start), 0, 1)
    t, weight = graded_quadrature(nearest, 24)
    radius = start + t * (end - start)
    for height, sign in ((magnet.height, 1), (0.0, -1)):
        of = ring_potential(body.radius[:, None], body.height[:, None], radius, np.array(height), 0, at_ring=True)
        potential += sign * density * (of.value[0] * weight * (end - start)).sum(1)
    return np.stack([body.radius, body.height, body.area * (body.response[0] @ potential)])


def _pair_stiffness(magnet: DiscMagnet, apart: float, steel: SteelRing | None) -> float:
    """Return d²U/dz² in N/m of the energy U of two magnets, with steel on top of each, if one is lifted by z."""
    bare = _beside(magnet, apart)[1]
    if steel is None:
        return bare
    radius, height, charge = steel_charges(magnet, steel)
    node, weight = gauss(8)
    square = (magnet.inner_diameter / 2) ** 2 + (magnet.outer_diameter**2 - magnet.inner_diameter**2) / 4 * node
    face = weight * magnet.moment / magnet.height
    of_magnet = [np.tile(np.sqrt(square), 2), np.repeat([magnet.height, 0.0], 8), np.concatenate([face, -face])]
    faces = _point_charges(np.array(of_magnet), RING_TURNS // 2)
    drawn = _point_charges(np.stack([radius, height, charge]), RING_TURNS // 2)
    beside = _point_charges(np.stack([radius, height, charge]), RING_TURNS) + np.array([[apart], [0.0], [0.0], [0.0]])
    # Twice: the halves round the magnet are alike, and so are one's faces beside the other's steel and the reverse.
    return bare + 2 * (_bend(drawn, beside) + 2 * _bend(faces, beside))


def _point_charges(rings: np.ndarray, turns: int) -> np.ndarray:
    """Return the first `turns` of `RING_TURNS` point charges that stand for each ring: x, y, z in m, charge in A·m."""
    angle = (np.arange(turns) + 0.5) * 2 * pi / RING_TURNS
    x, y = (np.multiply.outer(rings[0], wave).ravel() for wave in (np.cos(angle), np.sin(angle)))
    return np.stack([x, y, np.repeat(rings[1], turns), np.repeat(rings[2] / RING_TURNS, turns)])


def _bend(one: np.ndarray, other: np.ndarray) -> float:
    """Return d²U/dz² in N/m of the energy U of two sets of point charges (x, y, z in m; A·m) if one is lifted by z."""
    x, y, rise = (np.subtract.outer(a, b) for a, b in zip(one[:3], other[:3], strict=True))
    square = rise**2
    inverse = 1 / (x**2 + y**2 + square)
    return float(MU_0 / (4 * pi) * (one[3] @ (inverse * np.sqrt(inverse) * (3 * square * inverse - 1)) @ other[3]))


def dipole_stiffness(moment: float, apart: Any) -> Any:
    """Return d²U/dz² = −9μ0m²/(4πr⁵) in N/m of the energy U of two parallel dipoles side by side if one is lifted by z.

    Of real magnets it is a rough estimate: of discs of 3 × 1 mm 6.25 mm apart it is 28 % too small.
    """
    return -9 * MU_0 * moment**2 / (4 * pi * np.asarray(apart, float) ** 5)


def demagnetising_factor(magnet: DiscMagnet) -> float:
    """Return the mean demagnetising factor along the axis of an evenly magnetised disc or ring (magnetometric).

    The mean field within is ``−N`` times the magnetisation; the load line's permeance coefficient is ``(1 − N)/N``.
    Of cylinders as Chen, Brug and Goldfarb, *IEEE Trans. Magn.* 27, 1991.
    """
    radius = magnet.outer_diameter / 2
    k, weight = wave_points(400 / radius, 2 * radius)
    flux = face_flux(magnet, k)
    return float(-2 * pi / magnet.volume * (weight * flux**2) @ np.expm1(-k * magnet.height))


def face_factor(magnet: DiscMagnet) -> float:
    """Return the demagnetising factor in the middle of a disc's face, where it loses magnetisation first.

    ``1 − h/(2 √(h² + a²))`` by the charge of both faces; rings have less.
    """
    return float(1 - magnet.height / (2 * np.hypot(magnet.height, magnet.outer_diameter / 2)))


def working_polarisation(remanence: float, recoil_permeability: float, factor: float) -> float:
    """Return a magnet's mean polarisation in T after self-demagnetisation, from its remanence in T and `factor`.

    It falls by its own field, ``J = Br/(1 + χN)`` with χ the recoil permeability less 1.
    """
    return remanence / (1 + (recoil_permeability - 1) * factor)


def margin_temperature(
    polarisation: float,
    coercivity: float,
    factor: float,
    per_kelvin: tuple[float, float],
    opposing: float = 0.0,
    squareness: float = 0.9,
) -> float:
    """Return the temperature in °C from which on a magnet loses magnetisation for good.

    There its own field ``N J/μ0`` and an `opposing` one in A/m reach the knee of its curve, `squareness` times the
    intrinsic coercivity in A/m. Polarisation and coercivity are at 20 °C; `per_kelvin` is how they change, as a share.
    With N = `demagnetising_factor` that is the mean of the magnet, with `face_factor` its first points, far earlier.
    """
    field = factor * polarisation / MU_0
    knee = squareness * coercivity
    return 20 + (knee - field - opposing) / (field * per_kelvin[0] - knee * per_kelvin[1])


def eddy_damping(magnet: DiscMagnet, gap: float, thickness: float, resistivity: float) -> float:
    """Return an upper bound on the eddy-current damping in N·s/m of a magnet moving vertically over a sheet of metal.

    The sheet is infinite, `thickness` m thick, of `resistivity` in Ω·m, its top `gap` m below the magnet. Its currents
    are those of the magnet's field alone: their own field weakens them (Saslow, *Am. J. Phys.* 60, 1992), and so do
    gaps between a board's turns. Far away it is ``3μ0²m²t/(64π ρ d⁴)``.
    """
    radius = magnet.outer_diameter / 2
    k, weight = wave_points(DECAY / gap, 2 * radius)
    flux = face_flux(magnet, k)
    wave = flux * np.expm1(-k * magnet.height) * magnet.polarisation
    return float(-pi / (4 * resistivity) * (weight * wave**2 * np.exp(-2 * k * gap)) @ np.expm1(-2 * k * thickness))
