"""Data of coils, washers and steels, a coil's impedance, balance of pull and spring, and fields of magnetic charge.

The pull itself is in `physics.pull`; paper Eq. 4 has no air gap and is wrong by seven decades. Heights are above the
coil's top face. Magnetisation curves are flux density against field, monotone, saturated beyond the last point.

Fields are those of magnetic charge on rings, on linear steel and on coils.
Rings whose charge varies as cos mφ round their axis have toroidal functions as potential, the Legendre functions
Q_{m−½} of the second kind. Between circles about one axis

    ∫ cos mφ / R dφ = 2 Q_{m−½}(1 + ε) / √(r r'),   ε = ((r − r')² + (z − z')²) / (2 r r')

(Cohl and Tohline, *Astrophys. J.* 527, 1999).

A linear steel body of revolution (`steel_body`) in the potential u of a field from outside carries the surface charge σ
whose own potential is φ. With the susceptibility χ

    φ = −(1/χ + ½ + K)⁻¹ (½ + K) u,   σ = S⁻¹ φ

where S and K are the single and the double layer potentials on the surface (Kress, *Linear Integral Equations*, ch. 6;
Jackson, *Classical Electrodynamics*, 5.9). Round the axis everything is expanded in orders cos mφ, which do not couple;
along the meridian in polynomials on each side of the outline, of a variable that crowds at edges as the charge does.

A winding is replaced by a magnetisation whose curl is its current; the charge lies on the ends of that magnetisation.
Far away a coil is replaced by magnetic poles on its axis.

SI units; H in A/m, potentials in A.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import ceil, cos, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "BLOCK",
    "CORE_ORDERS",
    "EIGHTHS",
    "MILD_STEEL",
    "MOST_RINGS",
    "MU_0",
    "TEAM_STEEL",
    "BHCurve",
    "CoilSource",
    "LoopSides",
    "RectangularWinding",
    "RingPotential",
    "Side",
    "SteelBody",
    "SteelRing",
    "Winding",
    "balanced_deflection",
    "charged_core",
    "coil_poles",
    "coil_rings",
    "cylinder_outline",
    "deflection_without_growth",
    "fine_rings",
    "flux_density",
    "gauss",
    "graded_quadrature",
    "impedance",
    "multiple_of_eight",
    "mutual_error",
    "mutual_inductance",
    "paper_force_constant",
    "pole_error",
    "pole_field",
    "pull_in_deflection",
    "ring_factor",
    "ring_potential",
    "rings_potential",
    "saturating",
    "solenoid",
    "steel_body",
    "toroidal",
    "tube_outline",
    "winding_rings",
]

MU_0 = 4e-7 * pi


class Winding(NamedTuple):
    """Turns spread evenly over a ring of rectangular cross-section, in m; heights are over the coil's top face."""

    outer_diameter: float
    inner_diameter: float
    top: float
    bottom: float
    turns: float

    @property
    def length(self) -> float:
        """Height of the cross-section in m."""
        return self.top - self.bottom

    @property
    def mean_area(self) -> float:
        """Mean area in m² that a turn encloses."""
        return pi * self.mean_square_radius

    @property
    def mean_square_radius(self) -> float:
        """Mean of the squared radius of the turns in m²."""
        outer = self.outer_diameter / 2
        inner = self.inner_diameter / 2
        return (outer**2 + outer * inner + inner**2) / 3

    @property
    def largest_square(self) -> float:
        """Mean of the fourth power of the turns' radii over that of their squares, in m²."""
        outer = self.outer_diameter / 2
        inner = self.inner_diameter / 2
        return 0.6 * (outer**5 - inner**5) / (outer**3 - inner**3)


EIGHTHS = tuple((cos(k * pi / 4), sin(k * pi / 4)) for k in range(8))
"""Directions in which the sides and the cuts of a loop lie from its axis."""


class LoopSides(NamedTuple):
    """Distances in m from the axis: of the sides across x, of those across y, and of the cuts of the corners."""

    x: float
    y: float
    cut: float

    def inside(self, inset: float) -> "LoopSides":
        """Return the outline that lies `inset` m inside this one on all sides."""
        return LoopSides(self.x - inset, self.y - inset, self.cut - inset)

    def distance(self, eighth: int) -> float:
        """Return the distance in m of the side or cut in a direction, in eighths of a turn."""
        if eighth % 2:
            return self.cut
        return self.x if eighth % 4 == 0 else self.y

    @property
    def area(self) -> float:
        """Enclosed area in m²."""
        leg = max(self.x + self.y - sqrt(2) * self.cut, 0.0)
        return 4 * self.x * self.y - 2 * leg**2


class RectangularWinding(NamedTuple):
    """Turns of rectangular spirals on one layer of a board as closed loops; heights in m over the coil's top face.

    Of each loop `parts` says which part of a turn it is: from the outside whole ones, then the rest. `inner` are the
    corners of the drawn track inside all but one of the whole turns. `share` is this layer's current over the coil's.
    """

    outlines: tuple[LoopSides, ...]
    parts: tuple[float, ...]
    inner: tuple[tuple[float, float], ...]
    share: float
    top: float
    bottom: float

    @property
    def turns(self) -> float:
        """Turns, weighted by their share of the coil's current."""
        return sum(self.parts) * self.share

    @property
    def length(self) -> float:
        """Thickness of the tracks in m."""
        return self.top - self.bottom

    @property
    def outer_diameter(self) -> float:
        """Diameter in m of the circle round the outermost loop."""
        return 2 * float(np.hypot(self.outlines[0].x, self.outlines[0].y))

    @property
    def mean_area(self) -> float:
        """Mean area in m² that a turn encloses."""
        return sum(part * loop.area for part, loop in zip(self.parts, self.outlines, strict=True)) / sum(self.parts)

    @property
    def mean_square_radius(self) -> float:
        """Twice the mean square distance in m² of what a turn encloses from the axis, as of a circle its radius²."""
        squares = (part * (loop.x**2 + loop.y**2) * 2 / 3 for part, loop in zip(self.parts, self.outlines, strict=True))
        return sum(squares) / sum(self.parts)

    @property
    def largest_square(self) -> float:
        """Bound in m² on ⟨r⁴⟩/⟨r²⟩ of circles that enclose as much: half the outermost loop's diagonal, squared."""
        return (self.outer_diameter / 2) ** 2


class CoilSource(NamedTuple):
    """A coil of any kind as a source of field: coaxial windings in series round a core, in m; or tracks, without one.

    The core is a cylinder from `core_top` down, of relative permeability `core_permeability`; `core_diameter` 0 is an
    air core. Nothing reaches above height 0, the coil's top face. `uneven` bounds by how much spirals pull unlike the
    closed turns that stand for them here, over the pull on the axis.
    """

    windings: tuple[Winding, ...]
    core_diameter: float = 0.0
    core_length: float = 0.0
    core_permeability: float = 1.0
    core_top: float = 0.0
    tracks: tuple[RectangularWinding, ...] = ()
    uneven: float = 0.0

    @property
    def layers(self) -> "tuple[Winding | RectangularWinding, ...]":
        """All windings, round and rectangular ones."""
        return (*self.windings, *self.tracks)

    @property
    def outer_diameter(self) -> float:
        """Outer diameter of the widest winding in m."""
        return max(winding.outer_diameter for winding in self.layers)

    @property
    def length(self) -> float:
        """Distance in m from the top face to the lowest end of a winding."""
        return max(-winding.bottom for winding in self.layers)

    @property
    def turns(self) -> float:
        """Turns of all windings."""
        return sum(winding.turns for winding in self.layers)

    @property
    def has_core(self) -> bool:
        """True with a magnetic core."""
        return self.core_diameter > 0 and self.core_permeability > 1


def solenoid(
    outer_diameter: float,
    inner_diameter: float,
    length: float,
    turns: float,
    core_diameter: float = 0.0,
    core_permeability: float = 1.0,
) -> CoilSource:
    """Return a coil of one winding and a core as long as the winding, or none if `core_diameter` is 0; sizes in m."""
    winding = Winding(outer_diameter, inner_diameter, 0.0, -length, turns)
    return CoilSource((winding,), core_diameter, length, core_permeability)


LEAST_SIDE = 1e-6
"""Length in m below which sides of an outline are left out."""


class SteelRing(NamedTuple):
    """A washer: diameters and thickness in m, and its relative permeability.

    On top of it may lie another ring of steel, its crown: ballast of the given diameters and height.
    """

    outer_diameter: float
    inner_diameter: float
    thickness: float
    permeability: float
    crown_outer_diameter: float = 0.0
    crown_inner_diameter: float = 0.0
    crown_height: float = 0.0

    @property
    def without_crown(self) -> "SteelRing":
        """The washer without the ballast ring (crown) that may lie on top of it."""
        return SteelRing(*self[:4])

    def outline(self, nodes: tuple[int, int]) -> "tuple[Side, ...]":
        """Return the sides of washer and ballast ring, underside at height 0; `nodes` are counts per face and rim."""
        outer = self.outer_diameter / 2
        inner = self.inner_diameter / 2
        top = self.thickness
        wide = self.crown_outer_diameter / 2
        bore = self.crown_inner_diameter / 2
        high = top + self.crown_height
        sides = tube_outline(outer, inner, 0.0, top, nodes)
        if high == top or bore >= outer or wide <= inner:
            return sides
        face, rim = nodes
        faces = [(inner, outer, 0.0, -1), (bore, wide, high, 1)]
        # What of either ring's face the other one does not cover.
        faces += [(inner, min(bore, outer), top, 1), (max(wide, inner), outer, top, 1)]
        faces += [(bore, min(inner, wide), top, -1), (max(outer, bore), wide, top, -1)]
        rims = [(outer, 0.0, top, 1), (inner, 0.0, top, -1), (wide, top, high, 1), (bore, top, high, -1)]
        return (
            *(Side((low, z), (up, z), (0, way), face) for low, up, z, way in faces if up > low + LEAST_SIDE),
            *(Side((r, low), (r, up), (way, 0), rim) for r, low, up, way in rims if r > LEAST_SIDE),
        )


def impedance(resistance: float, inductance: float, frequency: Any) -> Any:
    """Return the complex impedance in Ω at the *drive* frequency in Hz, ``R + j 2π f L``."""
    return resistance + 2j * pi * frequency * inductance


def paper_force_constant(coil: CoilSource, area: float) -> float:
    """Return c of F = c I² in N/A² by the paper's Eq. 4 (area in m²); kept as a reference, not used."""
    permeability = coil.core_permeability
    return float(MU_0 * permeability**2 * coil.turns**2 * area * np.log(permeability) / (2 * coil.length**2))


def deflection_without_growth(deflection: float, gap: float, exponent: float) -> float:
    """Return the deflection that the pull at zero deflection would cause if constant, from the real one `deflection`.

    For a pull ``c I² (g/(g − z))^m`` against a spring this is ``z (1 − z/g)^m``. All in the unit of `gap`.
    """
    return deflection * (1 - deflection / gap) ** exponent


def pull_in_deflection(gap: float, exponent: float) -> tuple[float, float]:
    """Return the largest stable deflection (where pull-in begins), and `deflection_without_growth` there.

    It is ``z = g/(m + 1)``.
    """
    end = gap / (exponent + 1)
    return end, deflection_without_growth(end, gap, exponent)


def balanced_deflection(slack: float, gap: float, exponent: float) -> float | None:
    """Return the equilibrium deflection by a pull that, if constant, would deflect by `slack`; None past pull-in."""
    low = 0.0
    high, largest = pull_in_deflection(gap, exponent)
    if slack > largest:
        return None
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if deflection_without_growth(middle, gap, exponent) > slack else (middle, high)
    return (low + high) / 2


def ring_factor(ring: SteelRing) -> float:
    """Estimate the demagnetising factor of a ring in a uniform field along its plane.

    A ring of mean radius R and cross-section w × t carries a line charge ∝ cos φ, whose own field along the ring is
    ``wt/2πR² (ln(8R/r) − 2)`` of the polarisation; r is the mean distance of the section from itself, 0.2235 (w + t)
    (Grover, Inductance Calculations, 1946). Of a thin disc without a hole it has 1.08 times the exact factor, of disc
    and hole in field solutions 0.9 to 1.1 times; of thick ones it is too small, at least 0.
    """
    radius = (ring.outer_diameter + ring.inner_diameter) / 4
    width = (ring.outer_diameter - ring.inner_diameter) / 2
    self_term = np.log(8 * radius / (0.2235 * (width + ring.thickness))) - 2
    return float(width * ring.thickness / (2 * np.pi * radius**2) * max(self_term, 0.0))


@dataclass(frozen=True, eq=False)
class BHCurve:
    """A magnetisation curve through the origin and the points `flux_density_t` (n,) at `field_a_per_m` (n,).

    Between points it is a monotone cubic (Fritsch and Carlson, *SIAM J. Numer. Anal.* 17, 1980); beyond the last one it
    is a line of slope μ0, since the steel is saturated there. Hysteresis is left out. Each point rises above the one
    before by as much as air does, at least.
    """

    flux_density_t: np.ndarray
    field_a_per_m: np.ndarray

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

        h, b = (np.concatenate([[0.0], values]) for values in (self.field_a_per_m, self.flux_density_t))
        slope = PchipInterpolator(h, b).derivative()(h)
        return CubicHermiteSpline(h, b, [*slope[:-1], MU_0])

    def flux_density_at(self, field_a_per_m: Any) -> np.ndarray:
        """Return B in T at fields H of any shape in A/m; odd in H."""
        size = np.abs(np.asarray(field_a_per_m, float))
        last = self.field_a_per_m[-1]
        inside = self._spline(np.minimum(size, last))
        beyond = MU_0 * np.maximum(size - last, 0)
        return np.sign(field_a_per_m) * (inside + beyond)

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Return some 160 points of the curve, fields in A/m and flux densities in T, dense enough to join by lines.

        The last point is at a thousand times the last field, on the line of slope μ0.
        """
        h = self._spline.x
        per_interval = ceil(160 / (len(h) - 1))
        part = np.arange(per_interval) / per_interval
        fine = (h[:-1, None] + np.diff(h)[:, None] * part).ravel()
        fields = np.concatenate([fine, [h[-1], 1e3 * h[-1]]])
        return fields, self.flux_density_at(fields)


def saturating(initial_permeability: float, saturation_t: float) -> BHCurve:
    """Return a steel's curve from initial permeability and saturation, ``J = χ μ0 H / (1 + χ μ0 H / J_s)``.

    The law is Fröhlich's (1881) and Kennelly's (1891); Bozorth, *Ferromagnetism*, 1951, ch. 11. `initial_permeability`
    is relative, at H → 0, so that a weakly driven part acts as in a linear model; `saturation_t` is the polarisation
    J_s in T. Sampled from J_s/1000 to 0.999 J_s.
    """
    share = 1 / (1 + np.geomspace(1e3, 1e-3, 61))  # J/J_s
    field = saturation_t * share / (1 - share) / (MU_0 * (initial_permeability - 1))
    return BHCurve(saturation_t * share + MU_0 * field, field)


# fmt: off
# TEAM problem 20 and 13: Takahashi, Nakata and Morishige, problem descriptions of the TEAM workshops.
TEAM_STEEL = BHCurve(
    np.array([
        0.01, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.35, 1.4,
        1.45, 1.5, 1.55, 1.6, 1.65, 1.7, 1.75, 1.8, 1.85, 1.9, 1.95, 2.0, 2.05, 2.1, 2.15, 2.2, 2.25, 2.3,
    ]),
    np.array([
        27, 58, 100, 153, 185, 205, 233, 255, 285, 320, 355, 405, 470, 555, 673, 836, 1065, 1220, 1420,
        1720, 2130, 2670, 3480, 4500, 5950, 7650, 10100, 13000, 15900, 21100, 26300, 32900, 42700, 61700,
        84300, 110000, 135000,
    ]),
)
# fmt: on

MILD_STEEL = saturating(initial_permeability=300, saturation_t=2.14)
"""Low-carbon steel of washers: saturation polarisation of iron with little carbon (Bozorth 1951, table 2), permeability
of the catalogue's washers.
"""


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
BLOCK = 1 << 13
"""Values of a function that are computed at a time: few enough for a processor's cache, which halves the time."""


@lru_cache(maxsize=256)
def gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss-Legendre points and weights on [0, 1], cached since each is an eigenproblem."""
    node, weight = np.polynomial.legendre.leggauss(count)
    return (node + 1) / 2, weight / 2


def toroidal(above_one: np.ndarray, most: int) -> np.ndarray:
    """Return toroidal functions Q_{m−½}(1 + ε), ε = `above_one`, m = 0 … `most` (at least 1), shape (most + 1, …)."""
    flat = np.ravel(above_one)
    x = 1 + flat
    first, second = _elliptic(flat / (flat + 2))
    result = np.empty((most + 1, flat.size))
    result[0] = np.sqrt(2 / (x + 1)) * first
    far = flat > max(FAR, 0.5 * LOST ** (0.5 / most) - 1)
    if not far.all():
        near = ~far if far.any() else slice(None)
        up = result[:, near]
        x_near = x[near]
        up[1] = x_near * up[0] - np.sqrt(2 * (1 + x_near)) * second[near]
        for m in range(1, most):
            up[m + 1] = (4 * m * x_near * up[m] - (2 * m - 1) * up[m - 1]) / (2 * m + 1)
        result[:, near] = up
    if far.any():
        x_far = x[far]
        down = np.empty((most + 1, x_far.size))
        ratio = 1 / (2 * x_far)
        for m in range(most + ORDERS_ABOVE, 0, -1):
            # (2m − 1)/(4m x − (2m + 1) ratio), in place, since a field takes most of its time here.
            ratio *= (2 * m + 1) / (4 * m)
            np.subtract(x_far, ratio, out=ratio)
            np.divide((2 * m - 1) / (4 * m), ratio, out=ratio)
            if m <= most:
                down[m] = ratio
        down[0] = result[0][far]
        result[:, far] = np.multiply.accumulate(down, axis=0)
    return result.reshape(most + 1, *np.shape(above_one))


def _elliptic(complement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the complete elliptic integrals K(m) and E(m), m = 1 − `complement`, by the arithmetic-geometric mean."""
    b = np.sqrt(complement)
    # The first step has a = 1. The others are in place, since these lines take much of a field's time.
    a = (1 + b) / 2
    c = (1 - b) / 2
    b = np.sqrt(b)
    total = (1 - complement) / 2 + c * c
    power = 1.0
    square = np.empty_like(c)
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
    """Potential of rings of charge that varies as cos mφ round each ring, and its slopes along r and z.

    Each has the shape (m, …) and is per unit of ``density dr'``; the ring's radius r' is included as a factor.
    """

    value: np.ndarray
    along_r: np.ndarray
    along_z: np.ndarray


def ring_potential(
    radius: np.ndarray, height: np.ndarray, ring_radius: np.ndarray, ring_height: np.ndarray, most: int, at_ring: bool
) -> RingPotential:
    """Return potentials at points due to charged rings (∝ cos mφ, m ≤ `most`), and slopes by point or (`at_ring`) ring.

    The four arrays, in m, broadcast. A radius on the axis is replaced by a ten-thousandth of the ring's.
    """
    pairs = np.broadcast_arrays(radius, height, ring_radius, ring_height)
    shape = pairs[0].shape
    r, z, ring_r, ring_z = (part.ravel() for part in pairs)
    result = np.empty((3, most + 1, r.size))
    for start in range(0, r.size, BLOCK):
        block = slice(start, start + BLOCK)
        result[..., block] = _of_pairs(r[block], z[block], ring_r[block], ring_z[block], most, at_ring)
    return RingPotential(*result.reshape(3, most + 1, *shape))


def _of_pairs(
    radius: np.ndarray, height: np.ndarray, ring_radius: np.ndarray, ring_height: np.ndarray, most: int, at_ring: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return potential and both slopes, as `ring_potential` does, for n pairs of one point and one ring."""
    ring_radius = np.maximum(ring_radius, 1e-12)
    radius = np.maximum(radius, 1e-4 * ring_radius)
    gap = height - ring_height
    product = radius * ring_radius
    above_one = np.maximum(((radius - ring_radius) ** 2 + gap**2) / (2 * product), NEAREST)
    q = toroidal(above_one, most + 1)
    x = 1 + above_one
    share = ring_radius / (2 * pi * np.sqrt(product))
    m = np.arange(1, most + 1)[:, None]
    slope = np.concatenate([-0.5 * (x * q[:1] - q[1:2]), (m - 0.5) * (x * q[1:-1] - q[:-2])])
    slope *= share / (above_one * (above_one + 2))
    value = q[:-1] * share
    here, there = (ring_radius, radius) if at_ring else (radius, ring_radius)
    along_r = slope * (1 / there - x / here) - value / (2 * here)
    return value, along_r, slope * ((-gap if at_ring else gap) / product)


POINTS_ABOVE = 16
"""Quadrature points on either side of a singularity, in addition to a side's number of nodes."""


class Side(NamedTuple):
    """A straight side of the outline of a body of revolution: `start` to `end`, (r, z) in m, and outward `normal`.

    `nodes` is the number of unknowns. A start on the axis is no edge of the body.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    normal: tuple[int, int]
    nodes: int

    @property
    def length(self) -> float:
        """Length of the side in m."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    def part(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the share of the side's length at t in 0 … 1, and its derivative; even steps of t crowd at edges."""
        return (1 - (1 - t) ** 2, 2 * (1 - t)) if self.start[0] == 0 else (t * t * (3 - 2 * t), 6 * t * (1 - t))

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return radius and height in m of the side's point at parameter t in 0 … 1."""
        share = self.part(t)[0]
        r, z = self.start
        r1, z1 = self.end
        return r + share * (r1 - r), z + share * (z1 - z)


class SteelBody(NamedTuple):
    """A body of revolution of linear steel by its surface nodes (n,): radius, height in m, `area`, magnetic `response`.

    t runs from 0 to 1 along each side of the body's outline. `area` (n,) in m is 2πr times the node's weight in dt: the
    sum of area times charge per dt is the total charge. `response` (m, n, n) gives, for each order round the axis, the
    charge per dt in A at the nodes for a potential in A there. `uniform` (n, n) gives the potential at the nodes of a
    charge that is the same all round.
    """

    sides: tuple[Side, ...]
    radius: np.ndarray
    height: np.ndarray
    area: np.ndarray
    response: np.ndarray
    uniform: np.ndarray


def tube_outline(outer: float, inner: float, low: float, high: float, nodes: tuple[int, int]) -> tuple[Side, ...]:
    """Return the outline of a washer by radii and heights in m; `inner` 0 is a disc.

    `nodes` are the numbers on each face and on each rim.
    """
    face, rim = nodes
    if inner <= 0:
        return cylinder_outline(outer, low, high, (face, rim, face))
    return (
        Side((inner, low), (outer, low), (0, -1), face),
        Side((outer, low), (outer, high), (1, 0), rim),
        Side((inner, high), (outer, high), (0, 1), face),
        Side((inner, low), (inner, high), (-1, 0), rim),
    )


def cylinder_outline(radius: float, low: float, high: float, nodes: tuple[int, int, int]) -> tuple[Side, ...]:
    """Return the sides of a cylinder, sizes in m; `nodes` are node counts of top, curved surface and bottom."""
    top, around, below = nodes
    return (
        Side((0.0, high), (radius, high), (0, 1), top),
        Side((radius, low), (radius, high), (1, 0), around),
        Side((0.0, low), (radius, low), (0, -1), below),
    )


def steel_body(sides: Sequence[Side], permeability: float, most: int) -> SteelBody:
    """Return the steel body within `sides`, with its response to potentials ∝ cos mφ round the axis, m = 0 … `most`."""
    nodes = [gauss(side.nodes) for side in sides]
    radius, height = np.concatenate([np.stack(side.at(t)) for side, (t, _) in zip(sides, nodes, strict=True)], 1)
    area = 2 * pi * radius * np.concatenate([weight for _, weight in nodes])
    count = len(radius)
    single, double = np.zeros((2, most + 1, count, count))
    at = 0
    for side, (node, _) in zip(sides, nodes, strict=True):
        part = slice(at, at + side.nodes)
        single[..., part], double[..., part] = _layers(side, node, radius, height, part, most)
        at += side.nodes
    # A constant potential makes no field, so the rows of K must add to −½ in the lowest order. Their error is taken off
    # the diagonals of all orders, which share it.
    diagonal = np.arange(count)
    double[:, diagonal, diagonal] -= 0.5 + double[0].sum(-1)
    inside = np.eye(count) / 2 + double
    charge = -np.linalg.solve(single, np.linalg.solve(np.eye(count) / (permeability - 1) + inside, inside))
    energy = area[:, None] * charge
    response = (energy + np.swapaxes(energy, 1, 2)) / 2 / area[:, None]
    return SteelBody(tuple(sides), radius, height, area, response, single[0])


def _layers(
    side: Side, node: np.ndarray, radius: np.ndarray, height: np.ndarray, part: slice, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return single- and double-layer potentials (m, n, nodes) at n nodes by each node's basis polynomial on a side.

    They are at all nodes, by Gauss points on either side of the place nearest to the node, crowding towards it.
    """
    start = np.array(side.start)
    along = np.subtract(side.end, side.start)
    share = np.clip(((radius - start[0]) * along[0] + (height - start[1]) * along[1]) / side.length**2, 0, 1)
    fine = np.linspace(0, 1, 2001)
    nearest = np.interp(share, side.part(fine)[0], fine)
    nearest[part] = node
    t, weight = graded_quadrature(nearest, multiple_of_eight(side.nodes + POINTS_ABOVE))
    ring_radius, ring_height = side.at(t)
    of = ring_potential(radius[:, None], height[:, None], ring_radius, ring_height, most, at_ring=True)
    basis = _lagrange(node, t)
    out = side.normal[0] * of.along_r + side.normal[1] * of.along_z
    layers = of.value * weight, out * (weight * side.part(t)[1] * side.length)
    single, double = (np.swapaxes(np.swapaxes(layer, 0, 1) @ basis, 0, 1) for layer in layers)
    return single, double


def graded_quadrature(nearest: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return quadrature points (n, 2 `count`) on [0, 1] that crowd towards `nearest` (n,), and their weights.

    Distances from `nearest` are cubes of Gauss points.
    """
    at, weight = gauss(count)
    cube = at**3
    weight = 3 * at**2 * weight
    low = nearest[:, None]
    high = 1 - nearest[:, None]
    return np.concatenate([low * (1 - cube), low + high * cube], 1), np.concatenate([low * weight, high * weight], 1)


def multiple_of_eight(count: float) -> int:
    """Return `count` rounded up to a multiple of eight, so that few different quadrature rules are needed."""
    return 8 * ceil(count / 8)


def _lagrange(node: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the polynomials (…, n) at `t` (…) that are 1 at one of the nodes (n,) and 0 at the others."""
    weight = 1 / np.prod(node[:, None] - node + np.eye(len(node)), axis=1)
    away = t[..., None] - node
    hit = np.abs(away) < 1e-14
    share = weight / np.where(hit, 1.0, away)
    share /= share.sum(-1, keepdims=True)
    return np.asarray(np.where(hit.any(-1, keepdims=True), hit, share))


def fine_rings(body: SteelBody, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rings in place of a body's charge, fine enough for fields near its top: radii, heights, shares.

    Radii and heights (rings,) in m, and shares (rings, nodes): how much of each node's charge a ring has. Rings on
    the topmost side are at most `step` m apart; elsewhere they lie at the nodes.
    """
    top = max(side.end[1] for side in body.sides)
    places = []
    shares = []
    at = 0
    for side in body.sides:
        node, weight = gauss(side.nodes)
        share = np.diag(weight)
        if side.start[1] == side.end[1] == top and (count := multiple_of_eight(1.7 * side.length / step)) > side.nodes:
            t, weight = gauss(count)
            node, share = t, _lagrange(node, t) * weight[:, None]
        places.append(np.stack(side.at(node)))
        shares.append(np.pad(share, ((0, 0), (at, len(body.area) - at - side.nodes))))
        at += side.nodes
    radius, height = np.concatenate(places, 1)
    return radius, height, np.concatenate(shares)


CORE_ORDERS = 1
"""Highest order round the axis of a core in its neighbours' fields."""
MOST_RINGS = 400
"""Most rings across a coil. Nearer to its top than a two-hundredth of its radius the field is less certain."""
AT_ONCE = 8192
"""Pairs of a point and a ring computed together: few enough for a processor's cache."""


@lru_cache(maxsize=32)
def charged_core(coil: CoilSource, top: int = 12, orders: int = CORE_ORDERS) -> tuple[SteelBody, np.ndarray] | None:
    """Return a coil's core as `SteelBody` and its nodes' magnetic charge density in A per ampere; None without core.

    `top` is the number of nodes on its upper face, `orders` the highest order round its axis.
    """
    if not coil.has_core:
        return None
    low = coil.core_top - coil.core_length
    core = steel_body(
        cylinder_outline(coil.core_diameter / 2, low, coil.core_top, (top, 8, 5)), coil.core_permeability, orders
    )
    potential = np.zeros(len(core.area))
    for winding in coil.windings:
        full = winding.turns / winding.length
        for z, sign in ((winding.top, 1), (winding.bottom, -1)):
            for start, end in _spans(winding):
                nearest = np.clip((core.radius - start) / (end - start), 0, 1)
                t, weight = graded_quadrature(nearest, 24)
                radius = start + t * (end - start)
                of = ring_potential(core.radius[:, None], core.height[:, None], radius, np.array(z), 0, at_ring=True)
                potential += sign * (of.value[0] * _magnetised(winding, radius) * weight * (end - start)).sum(1)
        # Within the windings H is the field of the charges plus the magnetisation that replaces the current.
        potential -= full * np.clip(core.height, winding.bottom, winding.top)
    return core, core.response[0] @ potential


def _spans(winding: Winding) -> list[tuple[float, float]]:
    """Return the radii (from, to) in m of the bore and of the winding itself, without empty ones."""
    inner = winding.inner_diameter / 2
    outer = winding.outer_diameter / 2
    return [span for span in ((0.0, inner), (inner, outer)) if span[1] > span[0]]


def _magnetised(winding: Winding, radius: np.ndarray) -> np.ndarray:
    """Return the axial magnetisation in A/m per ampere whose curl is the winding's current."""
    inner = winding.inner_diameter / 2
    outer = winding.outer_diameter / 2
    full = winding.turns / winding.length
    inside = (radius < (inner + outer) / 2).astype(float) if outer == inner else (outer - radius) / (outer - inner)
    return np.asarray(full * np.clip(inside, 0, 1))


def winding_rings(windings: tuple[Winding, ...], step: float) -> np.ndarray:
    """Return the windings as rings of charge for points above them: (3, n), radius and height in m, charge in A per A.

    Rings on upper ends are at most `step` m apart; rings on lower ends may be wider apart, since they are farther away.
    """
    rings = []
    for winding in windings:
        for z, sign, apart in ((winding.top, 1, step), (winding.bottom, -1, max(step, winding.length / 4))):
            for start, end in _spans(winding):
                t, weight = gauss(multiple_of_eight(1.7 * (end - start) / apart))
                radius = start + t * (end - start)
                charge = sign * _magnetised(winding, radius) * weight * (end - start)
                rings.append(np.stack([radius, np.full(len(t), z), charge]))
    return np.concatenate(rings, 1)


def flux_density(coil: CoilSource, radius: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return radial and axial flux density in T per ampere at points above the coil's top face.

    `radius` and `height` are arrays of one shape, in m.
    """
    height = np.asarray(height, float)
    step = max(float(height.min(initial=np.inf)) / 2, coil.outer_diameter / MOST_RINGS)
    _, along_r, along_z = rings_potential(coil_rings(coil, step), radius, height)
    return -MU_0 * along_r, -MU_0 * along_z


def rings_potential(rings: np.ndarray, radius: np.ndarray, height: np.ndarray) -> RingPotential:
    """Return the potential of charged rings (`coil_rings`) and its slopes at `radius` and `height` in m, broadcast."""
    at_radius, at_height, charge = rings
    points = np.stack([side.ravel() for side in np.broadcast_arrays(radius, height)])[..., None]
    some = max(AT_ONCE // len(charge), 1)
    count = points.shape[1]
    blocks = (points[:, first : first + some] for first in range(0, max(count, 1), some))
    each = [ring_potential(block[0], block[1], at_radius, at_height, 0, at_ring=False) for block in blocks]
    parts = (np.concatenate([part[0] @ charge for part in one]) for one in zip(*each, strict=True))
    return RingPotential(*(part.reshape(np.broadcast_shapes(np.shape(radius), np.shape(height))) for part in parts))


@lru_cache(maxsize=16)
def coil_rings(coil: CoilSource, step: float) -> np.ndarray:
    """Return coil and core as rings of charge (3, n), `step` m apart on top: radii, heights in m, charges in A/A."""
    rings = [winding_rings(coil.windings, step)]
    if (core := charged_core(coil)) is not None:
        radius, height, shares = fine_rings(core[0], step)
        rings.append(np.stack([radius, height, shares @ core[1]]))
    return np.concatenate(rings, 1)


@lru_cache(maxsize=64)
def coil_poles(coil: CoilSource) -> np.ndarray:
    """Return a coil's poles: charge in A·m per ampere and height in m over its top, shape (poles, 2).

    Each end of a winding is one pole. The core's positive and its negative charges are one pole each, at the mean
    height of those charges.
    """
    poles = []
    for winding in coil.layers:
        charge = winding.turns * winding.mean_area / winding.length
        poles += [(charge, winding.top), (-charge, winding.bottom)]
    if (core := charged_core(coil)) is not None:
        height = core[0].height
        charges = core[0].area * core[1]
        for sign in (charges > 0, charges < 0):
            total = float(charges[sign].sum())
            poles.append((total, float((charges[sign] * height[sign]).sum()) / total))
    return np.array(poles)


def pole_field(poles: np.ndarray, height: float, away: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the field (…, 3) of a coil's magnetic `poles` in A/m per ampere at `height` in m, and its slope along z.

    `away` (…, 2) in m is the horizontal distance from the coil's axis.
    """
    charge, below = poles.T
    up = height - below
    square = (away**2).sum(-1)[..., None] + up**2
    weight = charge / (4 * np.pi * square * np.sqrt(square))
    turning = 3 * weight * up / square
    field, slope = (
        np.concatenate([away * across.sum(-1, keepdims=True), along.sum(-1, keepdims=True)], -1)
        for across, along in ((weight, weight * up), (-turning, weight - turning * up))
    )
    return field, slope


def pole_error(coil: CoilSource, distance: np.ndarray) -> np.ndarray:
    """Return the relative error of `pole_field` at a `distance` (…) in m: the next multipole's, ``¾ ⟨r²⟩/d²``."""
    square = max((coil.core_diameter / 2) ** 2, *(winding.mean_square_radius for winding in coil.layers))
    return np.asarray(0.75 * square / distance**2)


def mutual_inductance(coil: CoilSource, apart: np.ndarray) -> np.ndarray:
    """Return the mutual inductance (…) in H of two equal, parallel coils side by side, axes `apart` (…) in m.

    It is negative: the flux of one returns through the other. Of poles on the axes, so that its amount is too small by
    up to a share of `mutual_error`; cores answer a field as they do the coil's own current.
    """
    charge, height = coil_poles(coil).T
    distance = np.hypot(np.asarray(apart)[..., None, None], height[:, None] - height)
    return np.asarray(-MU_0 / (4 * np.pi) * (charge[:, None] * charge / distance).sum((-1, -2)))


def mutual_error(coil: CoilSource, apart: np.ndarray) -> np.ndarray:
    """Return the share (…) by which `mutual_inductance` may be too small in amount, for coils `apart` (…) in m.

    The next multipole of flat coils adds ``c = 9/4 ⟨r⁴⟩/(⟨r²⟩ d²)``, r the radius of turns; the rest of the series is
    bounded by ``2 c² + 7.5 c³`` up to coils that touch (filament sums in `tests/physics/test_mutual_inductance.py`).
    """
    square = max(winding.largest_square for winding in coil.layers)
    next_pole = 2.25 * square / np.asarray(apart) ** 2
    return np.asarray(next_pole * (1 + 2 * next_pole + 7.5 * next_pole**2))
