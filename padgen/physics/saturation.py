"""Magnetisation curves of steels: flux density against field, monotone, saturated beyond the last point."""

from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Any

import numpy as np

from padgen.core.errors import SpecError

__all__ = ["MILD_STEEL", "TEAM_STEEL", "BHCurve", "saturating"]

MU_0 = 4e-7 * pi


@dataclass(frozen=True, eq=False)
class BHCurve:
    """A magnetisation curve through the origin and the points `flux_density_t` (n,) at `field_a_per_m` (n,).

    Between points it is a monotone cubic (Fritsch and Carlson, *SIAM J. Numer. Anal.* 17, 1980); beyond the last one it
    is a line of slope μ0, since the steel is saturated there. Hysteresis is left out.

    Raises
    ------
    SpecError
        Fewer than three points, arrays of different length, or a point that does not rise above the one before by as
        much as air does.
    """

    name: str
    flux_density_t: np.ndarray
    field_a_per_m: np.ndarray

    def __post_init__(self) -> None:
        b, h = self.flux_density_t, self.field_a_per_m
        rise, step = (np.diff(values, prepend=0.0) for values in (b, h[: b.size]))
        is_curve = b.size == h.size >= 3 and (step > 0).all() and (rise >= MU_0 * step * (1 - 1e-9)).all()
        if not (is_curve and np.isfinite([b, h]).all()):
            message = "must rise from the origin through 3 points or more, each step at least as steeply as in air"
            raise SpecError(message, f"magnetisation curve {self.name}")

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
