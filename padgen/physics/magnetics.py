"""Pull of a coil on a washer, and the coil's impedance.

The force rung here is a washer magnetised by the field of winding and core, with demagnetising
factors for its shape; paper Eq. 4 has no air gap and misses by seven decades. Axial positions are
heights above the coil's top face.
"""

from functools import lru_cache
from math import pi
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "CoilSource",
    "SteelRing",
    "Winding",
    "balanced_deflection",
    "core_charges",
    "flat_spheroid_factor",
    "flux_density",
    "force_constant",
    "impedance",
    "paper_force_constant",
    "pull_in_deflection",
    "pull_over_gap",
    "slack_at",
    "solenoid",
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


class CoilSource(NamedTuple):
    """What a coil of any kind is to its field: coaxial windings in series round a core, in m.

    The core is a cylinder from `core_top` down, of relative permeability `core_permeability`; `core_diameter` 0 is an
    air core. Nothing reaches above height 0, the coil's top face.
    """

    windings: tuple[Winding, ...]
    core_diameter: float = 0.0
    core_length: float = 0.0
    core_permeability: float = 1.0
    core_top: float = 0.0

    @property
    def outer_diameter(self) -> float:
        """Of the widest winding, in m."""
        return max(winding.outer_diameter for winding in self.windings)

    @property
    def length(self) -> float:
        """From the top face to the lowest winding's end, in m."""
        return max(-winding.bottom for winding in self.windings)

    @property
    def turns(self) -> float:
        """Of all windings."""
        return sum(winding.turns for winding in self.windings)

    @property
    def has_core(self) -> bool:
        """Whether there is a core that is magnetic."""
        return self.core_diameter > 0 and self.core_permeability > 1


def solenoid(
    outer_diameter: float,
    inner_diameter: float,
    length: float,
    turns: float,
    core_diameter: float = 0.0,
    core_permeability: float = 1.0,
) -> CoilSource:
    """One winding with a core of its own length, in m."""
    winding = Winding(outer_diameter, inner_diameter, 0.0, -length, turns)
    return CoilSource((winding,), core_diameter, length, core_permeability)


class SteelRing(NamedTuple):
    """A washer, in m, with its relative permeability."""

    outer_diameter: float
    inner_diameter: float
    thickness: float
    permeability: float


def impedance(resistance: float, inductance: float, frequency: Any) -> Any:
    """Complex impedance in Ω at the *drive* frequency in Hz, ``R + j 2π f L``."""
    return resistance + 2j * pi * frequency * inductance


def paper_force_constant(coil: CoilSource, area: float) -> float:
    """c of F = c I² in N/A² as the paper's Eq. 4 prints it; kept as the reference, not used."""
    permeability = coil.core_permeability
    return float(MU_0 * permeability**2 * coil.turns**2 * area * np.log(permeability) / (2 * coil.length**2))


def force_constant(coil: CoilSource, washer: SteelRing, gap: float, offset: np.ndarray) -> np.ndarray:
    """c of the axial pull F = c I² in N/A², for washers whose axis is `offset` m off the coil's.

    `gap` in m from the coil's top face to the washer's underside. Against field solutions of the
    reference problem it is 6 to 20 % low on the axis and 38 % low 3 mm off it (docs/accuracy.md):
    the current of the driver table is 3 to 27 % high there.
    """
    return pull_over_gap(coil, washer, gap, offset)[0]


def pull_over_gap(coil: CoilSource, washer: SteelRing, gap: float, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`force_constant`, and the exponent m with which it falls about the gap, ``c ∝ gap^−m``."""
    step = 0.02 * (gap + washer.thickness)
    offset = np.asarray(offset, float)
    below, middle, above = (_co_energy(coil, washer, gap + d, offset) for d in (-step, 0.0, step))
    pull = (below - above) / (2 * step)
    curvature = (below - 2 * middle + above) / step**2
    with np.errstate(divide="ignore", invalid="ignore"):
        exponent = np.where(pull > 0, gap * curvature / pull, 0.0)
    return pull, exponent


def slack_at(deflection: float, gap: float, exponent: float) -> float:
    """What a pull that is in balance at `deflection` would deflect the spring by, did it not grow as the gap closes.

    With a pull ``c I² (g/(g − z))^m`` against a spring, ``z (1 − z/g)^m``. All in the unit of `gap`.
    """
    slack: float = deflection * (1 - deflection / gap) ** exponent
    return slack


def pull_in_deflection(gap: float, exponent: float) -> tuple[float, float]:
    """Where balance ends, ``z = g/(m + 1)``, a third of the gap for m = 2, and its `slack_at` there, the largest."""
    end = gap / (exponent + 1)
    return end, slack_at(end, gap, exponent)


def balanced_deflection(slack: float, gap: float, exponent: float) -> float | None:
    """Where a pull that at rest would deflect the spring by `slack` is in balance; None beyond pull-in."""
    low, (high, largest) = 0.0, pull_in_deflection(gap, exponent)
    if slack > largest:
        return None
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if slack_at(middle, gap, exponent) > slack else (middle, high)
    return (low + high) / 2


def flux_density(coil: CoilSource, radius: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radial and axial flux density in T per ampere, outside winding and core, at points of one shape.

    Read-only arrays: plans of one coil and layout ask for the same points again.
    """
    radius, height = np.broadcast_arrays(np.asarray(radius, float), np.asarray(height, float))
    if radius.size > MOST_POINTS_KEPT:
        return _flux_density(coil, radius, height)
    return _kept_flux_density(coil, radius.shape, radius.tobytes(), height.tobytes())


MOST_POINTS_KEPT = 20_000


@lru_cache(maxsize=64)
def _kept_flux_density(
    coil: CoilSource, shape: tuple[int, ...], radius: bytes, height: bytes
) -> tuple[np.ndarray, np.ndarray]:
    field = _flux_density(coil, *(np.frombuffer(at).reshape(shape) for at in (radius, height)))
    for part in field:
        part.setflags(write=False)
    return field


def _flux_density(coil: CoilSource, radius: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    radial, axial = _winding_field(coil, radius, height)
    if coil.has_core:
        at_radius, at_height, charge = core_charges(coil)
        core_radial, core_axial = _ring_charge_field(at_radius, radius[..., None], height[..., None] - at_height)
        radial = radial + MU_0 * (charge * core_radial).sum(-1)
        axial = axial + MU_0 * (charge * core_axial).sum(-1)
    return radial, axial


@lru_cache(maxsize=8)
def _gauss_points(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points and weights on [−1, 1]: an eigenproblem, needed many times over."""
    node, weight = np.polynomial.legendre.leggauss(count)
    return node, weight


def _co_energy(coil: CoilSource, washer: SteelRing, gap: float, offset: np.ndarray) -> np.ndarray:
    """Magnetic co-energy in J/A² of the washer, ½ V χ_eff B²/μ0 with a factor per direction."""
    rings, spokes = 3, 12
    node, weight = _gauss_points(rings)
    inner, outer = washer.inner_diameter / 2, washer.outer_diameter / 2
    radius = np.sqrt(inner**2 + (node + 1) / 2 * (outer**2 - inner**2))
    angle = (np.arange(spokes) + 0.5) * 2 * pi / spokes
    x = offset[..., None, None] + radius[:, None] * np.cos(angle)
    y = radius[:, None] * np.sin(angle)
    distance = np.hypot(x, y)
    radial, axial = flux_density(coil, distance, np.full_like(distance, gap + washer.thickness / 2))
    weights = (weight / 2)[:, None] / spokes
    mean_square_axial, mean_square_radial = ((b**2 * weights).sum((-1, -2)) for b in (axial, radial))
    # What of the radial field is one-sided magnetises the washer across its diameter, the rest
    # across the width of its ring; the axial field through its thickness.
    one_sided = (radial * x / distance * weights).sum((-1, -2)) ** 2
    width = outer - inner
    ring_share = width / (width + washer.thickness)
    disc_share = flat_spheroid_factor(2 * outer / washer.thickness)
    chi = washer.permeability - 1
    volume = pi * (outer**2 - inner**2) * washer.thickness
    energy: np.ndarray = (
        volume
        / (2 * MU_0)
        * (
            chi / (1 + chi * ring_share) * mean_square_axial
            + chi / (1 + chi * (1 - ring_share)) * (mean_square_radial - one_sided)
            + chi / (1 + chi * disc_share) * one_sided
        )
    )
    return energy


def flat_spheroid_factor(flatness: float) -> float:
    """Demagnetising factor across a flat spheroid of diameter over thickness `flatness` (Osborn 1945)."""
    if flatness <= 1.01:
        return 1 / 3
    m2 = flatness**2 - 1
    return float((flatness**2 / m2**1.5 * np.arcsin(np.sqrt(m2) / flatness) - 1 / m2) / 2)


def _winding_field(
    coil: CoilSource, radius: np.ndarray, height: np.ndarray, loops: int = 16
) -> tuple[np.ndarray, np.ndarray]:
    """Field per ampere of the windings, each as a few nested current sheets of `loops` each."""
    node, weight = _gauss_points(4)
    radial, axial = 0.0, 0.0
    for winding in coil.windings:
        inner, outer = winding.inner_diameter / 2, winding.outer_diameter / 2
        for at, share in zip((node + 1) / 2, weight / 2, strict=True):
            at_radius = inner + at * (outer - inner)
            b_radial, b_axial = _sheet_field(at_radius, winding.length, radius, height - winding.top, loops)
            sheet = share * winding.turns / winding.length
            radial, axial = radial + sheet * b_radial, axial + sheet * b_axial
    return np.asarray(radial), np.asarray(axial)


def _sheet_field(
    sheet_radius: float, length: float, radius: np.ndarray, height: np.ndarray, loops: int
) -> tuple[np.ndarray, np.ndarray]:
    """Field in T of a cylindrical current sheet of 1 A/m with its top at height 0.

    Loops at Gauss points that crowd towards the top, where the washers are.
    """
    node, weight = _gauss_points(loops)
    depth = ((node + 1) / 2) ** 2 * length
    current = weight * (node + 1) / 2 * length
    radial, axial = _loop_field(sheet_radius, radius[..., None], height[..., None] + depth)
    return (radial * current).sum(-1), (axial * current).sum(-1)


def _loop_field(loop_radius: float, radius: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Field of a 1 A loop (Smythe, *Static and Dynamic Electricity*, 7.10) by complete elliptic integrals."""
    radius = np.maximum(radius, 1e-6 * loop_radius)
    far = (loop_radius + radius) ** 2 + height**2
    near = (loop_radius - radius) ** 2 + height**2
    first, second = _elliptic(4 * loop_radius * radius / far)
    scale = MU_0 / (2 * pi * np.sqrt(far))
    axial = scale * (first + (loop_radius**2 - radius**2 - height**2) / near * second)
    radial = scale * height / radius * (-first + (loop_radius**2 + radius**2 + height**2) / near * second)
    return radial, axial


def _elliptic(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Complete elliptic integrals K(m) and E(m) by the arithmetic-geometric mean."""
    m = np.atleast_1d(m)
    b = np.sqrt(1 - m)
    # The first step, of a = 1; then in place, since these are the dearest lines of a plan.
    a, c, b = (1 + b) / 2, (1 - b) / 2, np.sqrt(b)
    total, power, square = m / 2 + c * c, 1.0, np.empty_like(c)
    for _ in range(5):
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
        if c.max(initial=0.0) < CONVERGED:
            break
    first = pi / (2 * a)
    return first, first * (1 - total)


CONVERGED = 1e-9
"""Half the difference of the two means; the next one would be less than its square."""


@lru_cache(maxsize=32)
def core_charges(coil: CoilSource) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rings of magnetic charge on the core's surface: radii, heights in m and charges in A·m per ampere.

    The core is an equipotential of winding and charges together, with no net charge: an
    axisymmetric boundary element solution, panels crowding at the edges where the charge does. A
    core of finite permeability holds less by ``χN/(1+χN)``, N the rod's demagnetising factor after
    Sato and Ishii (1989), ``1/(1 + 4γ/√π)``, γ = length/diameter.
    """
    edge = coil.core_diameter / 2
    radius, height, width = _core_panels(edge, coil.core_length)
    height = height + coil.core_top
    far = (radius[:, None] + radius) ** 2 + (height[:, None] - height) ** 2
    same = np.eye(len(radius), dtype=bool)
    first, _ = _elliptic(np.where(same, 0.0, 4 * radius[:, None] * radius / far))
    kernel = np.where(same, (np.log(16 * radius / width) + 1) / (2 * radius), first / np.sqrt(far)) / (2 * pi**2)
    system = np.block([[kernel, -np.ones((len(radius), 1))], [np.ones((1, len(radius))), np.zeros((1, 1))]])
    charge = np.linalg.solve(system, np.append(-_winding_potential(coil, radius, height), 0.0))[:-1]
    chi_n = (coil.core_permeability - 1) / (1 + 4 * coil.core_length / coil.core_diameter / np.sqrt(pi))
    return radius, height, charge * chi_n / (1 + chi_n)


def _core_panels(edge: float, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles and widths of panels along the core's outline, from the top's centre to the bottom's."""
    disc = edge * np.sin(np.linspace(0, pi / 2, 19))
    side = -length / 2 * (1 - np.cos(np.linspace(0, pi, 41)))
    radius = np.concatenate([disc, np.full(40, edge), disc[-2::-1]])
    height = np.concatenate([np.zeros(19), side[1:], np.full(18, -length)])
    middle_radius, middle_height = (radius[1:] + radius[:-1]) / 2, (height[1:] + height[:-1]) / 2
    return middle_radius, middle_height, np.hypot(np.diff(radius), np.diff(height))


def _winding_potential(coil: CoilSource, radius: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Scalar potential in A per ampere of the winding along the core's outline, from its first point."""
    radial, axial = (b / MU_0 for b in _winding_field(coil, radius, height, loops=48))
    along = (radial[1:] + radial[:-1]) / 2 * np.diff(radius) + (axial[1:] + axial[:-1]) / 2 * np.diff(height)
    return -np.concatenate([[0.0], np.cumsum(along)])


def _ring_charge_field(
    ring_radius: np.ndarray, radius: np.ndarray, height: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Field in A/m of a ring of magnetic charge of 1 A·m (Jackson, *Classical Electrodynamics*, ch. 3)."""
    radius = np.maximum(radius, 1e-6 * ring_radius)
    far = (ring_radius + radius) ** 2 + height**2
    near = (ring_radius - radius) ** 2 + height**2
    first, second = _elliptic(4 * ring_radius * radius / far)
    axial = height * second / (np.sqrt(far) * near) / (2 * pi**2)
    radial = (first - second * (ring_radius**2 - radius**2 + height**2) / near) / (4 * pi**2 * radius * np.sqrt(far))
    return radial, axial
