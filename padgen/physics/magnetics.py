"""Coils, washers and steels as data, a coil's impedance, and the balance between a pull and a spring.

The pull itself is in `physics.pull`; paper Eq. 4 has no air gap and is wrong by seven decades. Heights are above the
coil's top face.

Magnetisation curves are flux density against field, monotone, saturated beyond the last point.
"""

from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "MILD_STEEL",
    "MU_0",
    "TEAM_STEEL",
    "BHCurve",
    "CoilSource",
    "SteelRing",
    "Winding",
    "balanced_deflection",
    "impedance",
    "paper_force_constant",
    "pull_in_deflection",
    "ring_factor",
    "saturating",
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


@dataclass(frozen=True, eq=False)
class BHCurve:
    """A magnetisation curve through the origin and the points `flux_density_t` (n,) at `field_a_per_m` (n,).

    Between points it is a monotone cubic (Fritsch and Carlson, *SIAM J. Numer. Anal.* 17, 1980); beyond the last one it
    is a line of slope μ0, since the steel is saturated there. Hysteresis is left out. Each point rises above the one
    before by as much as air does, at least.
    """

    name: str
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
        size, last = np.abs(np.asarray(field_a_per_m, float)), self.field_a_per_m[-1]
        inside, beyond = self._spline(np.minimum(size, last)), MU_0 * np.maximum(size - last, 0)
        return np.sign(field_a_per_m) * (inside + beyond)

    def samples(self, about: int = 160) -> tuple[np.ndarray, np.ndarray]:
        """Return about `about` fields and flux densities from the origin on, close enough for straight lines between.

        The last point is at a thousand times the last field, on the line of slope μ0.
        """
        h = self._spline.x
        per_interval = -(-about // (len(h) - 1))
        part = np.arange(per_interval) / per_interval
        fine = (h[:-1, None] + np.diff(h)[:, None] * part).ravel()
        fields = np.concatenate([fine, [h[-1], 1e3 * h[-1]]])
        return fields, self.flux_density_at(fields)


def saturating(name: str, initial_permeability: float, saturation_t: float) -> BHCurve:
    """Return the curve of a steel by two figures, ``J = χ μ0 H / (1 + χ μ0 H / J_s)``.

    The law is Fröhlich's (1881) and Kennelly's (1891); Bozorth, *Ferromagnetism*, 1951, ch. 11. `initial_permeability`
    is relative, at H → 0, so that a weakly driven part acts as in a linear model; `saturation_t` is the polarisation
    J_s in T. Sampled from J_s/1000 to 0.999 J_s.
    """
    share = 1 / (1 + np.geomspace(1e3, 1e-3, 61))  # J/J_s
    field = saturation_t * share / (1 - share) / (MU_0 * (initial_permeability - 1))
    return BHCurve(name, saturation_t * share + MU_0 * field, field)


# fmt: off
TEAM_STEEL = BHCurve(
    "TEAM problem 20 and 13",  # Takahashi, Nakata and Morishige, problem descriptions of the TEAM workshops
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

MILD_STEEL = saturating("mild steel", initial_permeability=300, saturation_t=2.14)
"""Low-carbon steel of washers: saturation polarisation of iron with little carbon (Bozorth 1951, table 2), permeability
of the catalogue's washers.
"""
