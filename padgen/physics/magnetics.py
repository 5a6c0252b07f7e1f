"""Coils and washers as data, a coil's impedance, and the balance between a pull and a spring.

The pull itself is in `physics.pull`; paper Eq. 4 has no air gap and is wrong by seven decades. Heights are above the
coil's top face.
"""

from math import pi
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "MU_0",
    "CoilSource",
    "SteelRing",
    "Winding",
    "balanced_deflection",
    "impedance",
    "paper_force_constant",
    "pull_in_deflection",
    "ring_factor",
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
    """A coil of any kind as a source of field: coaxial windings in series round a core, in m.

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
        """Outer diameter of the widest winding in m."""
        return max(winding.outer_diameter for winding in self.windings)

    @property
    def length(self) -> float:
        """Distance in m from the top face to the lowest end of a winding."""
        return max(-winding.bottom for winding in self.windings)

    @property
    def turns(self) -> float:
        """Turns of all windings."""
        return sum(winding.turns for winding in self.windings)

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
    """Return a coil of one winding with a core of the same length; lengths in m."""
    winding = Winding(outer_diameter, inner_diameter, 0.0, -length, turns)
    return CoilSource((winding,), core_diameter, length, core_permeability)


class SteelRing(NamedTuple):
    """A washer: diameters and thickness in m, and its relative permeability."""

    outer_diameter: float
    inner_diameter: float
    thickness: float
    permeability: float


def impedance(resistance: float, inductance: float, frequency: Any) -> Any:
    """Return the complex impedance in Ω at the *drive* frequency in Hz, ``R + j 2π f L``."""
    return resistance + 2j * pi * frequency * inductance


def paper_force_constant(coil: CoilSource, area: float) -> float:
    """Return c of F = c I² in N/A² by the paper's Eq. 4 (area in m²); kept as a reference, not used."""
    permeability = coil.core_permeability
    return float(MU_0 * permeability**2 * coil.turns**2 * area * np.log(permeability) / (2 * coil.length**2))


def slack_at(deflection: float, gap: float, exponent: float) -> float:
    """Return the static deflection by a pull that does not grow, if with growth it balances at `deflection`.

    For a pull ``c I² (g/(g − z))^m`` against a spring this is ``z (1 − z/g)^m``. All in the unit of `gap`.
    """
    return deflection * (1 - deflection / gap) ** exponent


def pull_in_deflection(gap: float, exponent: float) -> tuple[float, float]:
    """Return the largest deflection in balance, ``z = g/(m + 1)`` (g/3 for m = 2), and its `slack_at`."""
    end = gap / (exponent + 1)
    return end, slack_at(end, gap, exponent)


def balanced_deflection(slack: float, gap: float, exponent: float) -> float | None:
    """Return the deflection in balance of a pull that at rest would deflect by `slack`; None beyond pull-in."""
    low, (high, largest) = 0.0, pull_in_deflection(gap, exponent)
    if slack > largest:
        return None
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if slack_at(middle, gap, exponent) > slack else (middle, high)
    return (low + high) / 2


def ring_factor(ring: SteelRing) -> float:
    """Return the demagnetising factor of a ring in an even field along its plane.

    A ring of mean radius R and cross-section w × t carries a line charge ∝ cos φ, whose own field along the ring is
    ``wt/2πR² (ln(8R/r) − 2)`` of the polarisation; r is the mean distance of the section from itself, 0.2235 (w + t)
    (Grover, Inductance Calculations, 1946). Of a thin disc without a hole it has 1.08 times the exact factor, of disc
    and hole in field solutions 0.9 to 1.1 times; of thick ones it is too small, at least 0.
    """
    radius, width = (ring.outer_diameter + ring.inner_diameter) / 4, (ring.outer_diameter - ring.inner_diameter) / 2
    own = np.log(8 * radius / (0.2235 * (width + ring.thickness))) - 2
    return float(width * ring.thickness / (2 * np.pi * radius**2) * max(own, 0.0))
