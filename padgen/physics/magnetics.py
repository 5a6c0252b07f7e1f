"""Pull of a cored solenoid on a washer, and the coil's impedance.

The force rung here is a washer magnetised by the field of winding and core, with demagnetising
factors for its shape; paper Eq. 4 has no air gap and misses by seven decades. Axial positions are
heights above the coil's top face.
"""

from math import pi
from typing import Any, NamedTuple

import numpy as np

__all__ = ["SolenoidCoil", "SteelRing", "flux_density", "force_constant", "impedance", "paper_force_constant"]

MU_0 = 4e-7 * pi


class SolenoidCoil(NamedTuple):
    """A winding with a core of its own length, in m; `core_diameter` 0 is an air core."""

    outer_diameter: float
    inner_diameter: float
    length: float
    turns: float
    core_diameter: float
    core_permeability: float


class SteelRing(NamedTuple):
    """A washer, in m, with its relative permeability."""

    outer_diameter: float
    inner_diameter: float
    thickness: float
    permeability: float


def impedance(resistance: float, inductance: float, frequency: Any) -> Any:
    """Complex impedance in Ω at the *drive* frequency in Hz, ``R + j 2π f L``."""
    return resistance + 2j * pi * frequency * inductance


def paper_force_constant(coil: SolenoidCoil, area: float) -> float:
    """c of F = c I² in N/A² as the paper's Eq. 4 prints it; kept as the reference, not used."""
    permeability = coil.core_permeability
    return float(MU_0 * permeability**2 * coil.turns**2 * area * np.log(permeability) / (2 * coil.length**2))


def force_constant(coil: SolenoidCoil, washer: SteelRing, gap: float, offset: np.ndarray) -> np.ndarray:
    """c of the axial pull F = c I² in N/A², for washers whose axis is `offset` m off the coil's.

    `gap` in m from the coil's top face to the washer's underside. Against the axisymmetric field
    solution of the reference problem: within 12 % for gaps of 0.5 to 3 mm (docs/accuracy.md).
    """
    step = 0.02 * (gap + washer.thickness)
    above, below = (_co_energy(coil, washer, gap + d, np.asarray(offset, float)) for d in (step, -step))
    pull: np.ndarray = (below - above) / (2 * step)
    return pull


def flux_density(coil: SolenoidCoil, radius: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radial and axial flux density in T per ampere, outside the coil, at points of one shape."""
    radial, axial = _winding_field(coil, radius, height)
    if coil.core_diameter > 0:
        core_radial, core_axial = _sheet_field(coil.core_diameter / 2, coil.length, radius, height)
        magnetisation = _core_magnetisation(coil)
        radial, axial = radial + magnetisation * core_radial, axial + magnetisation * core_axial
    return radial, axial


def _co_energy(coil: SolenoidCoil, washer: SteelRing, gap: float, offset: np.ndarray) -> np.ndarray:
    """Magnetic co-energy in J/A² of the washer, ½ V χ_eff B²/μ0 with a factor per direction."""
    rings, spokes = 3, 12
    node, weight = np.polynomial.legendre.leggauss(rings)
    inner, outer = washer.inner_diameter / 2, washer.outer_diameter / 2
    radius = np.sqrt(inner**2 + (node + 1) / 2 * (outer**2 - inner**2))
    angle = (np.arange(spokes) + 0.5) * 2 * pi / spokes
    x = offset[..., None, None] + radius[:, None] * np.cos(angle)
    y = radius[:, None] * np.sin(angle)
    distance = np.hypot(x, y)
    radial, axial = flux_density(coil, distance, np.full_like(distance, gap + washer.thickness / 2))
    weights = (weight / 2)[:, None] / spokes
    mean_axial, mean_radial = ((b**2 * weights).sum((-1, -2)) for b in (axial, radial))
    # An elliptic cylinder bent to a ring: demagnetised across its section, not around it.
    width = outer - inner
    across = width / (width + washer.thickness)
    chi = washer.permeability - 1
    volume = pi * (outer**2 - inner**2) * washer.thickness
    gain_axial, gain_radial = (chi / (1 + chi * n) for n in (across, 1 - across))
    energy: np.ndarray = volume / (2 * MU_0) * (gain_axial * mean_axial + gain_radial * mean_radial)
    return energy


def _winding_field(coil: SolenoidCoil, radius: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Field per ampere of the winding, as a few nested current sheets."""
    node, weight = np.polynomial.legendre.leggauss(4)
    inner, outer = coil.inner_diameter / 2, coil.outer_diameter / 2
    radial, axial = 0.0, 0.0
    for at, share in zip((node + 1) / 2, weight / 2, strict=True):
        b_radial, b_axial = _sheet_field(inner + at * (outer - inner), coil.length, radius, height)
        sheet = share * coil.turns / coil.length
        radial, axial = radial + sheet * b_radial, axial + sheet * b_axial
    return np.asarray(radial), np.asarray(axial)


def _sheet_field(
    sheet_radius: float, length: float, radius: np.ndarray, height: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Field of a cylindrical current sheet of 1 A/m with its top at height 0, T·m/A.

    A sheet of 1 A/m is the field outside a cylinder magnetised with 1 A/m. Loops at Gauss points
    that crowd towards the top, where the washers are.
    """
    node, weight = np.polynomial.legendre.leggauss(16)
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
    a, b = np.ones_like(m), np.sqrt(1 - m)
    total, power = m / 2, 0.5
    for _ in range(6):
        a, b, c = (a + b) / 2, np.sqrt(a * b), (a - b) / 2
        power *= 2
        total = total + power * c**2
    first = pi / (2 * a)
    return first, first * (1 - total)


def _core_magnetisation(coil: SolenoidCoil) -> float:
    """Mean magnetisation of the core in A/m per ampere, with the rod's demagnetising factor.

    Factor of a cylinder after Sato and Ishii (1989): ``1/(1 + 4 γ/√π)``, γ = length/diameter.
    """
    slimness = coil.length / coil.core_diameter
    factor = 1 / (1 + 4 * slimness / np.sqrt(pi))
    chi = coil.core_permeability - 1
    inside = np.linspace(-0.95, -0.05, 10) * coil.length
    _, axial = _winding_field(coil, np.full(10, 0.5 * coil.core_diameter / 2), inside)
    field = float(axial.mean()) / MU_0
    return float(chi / (1 + chi * factor) * field)
