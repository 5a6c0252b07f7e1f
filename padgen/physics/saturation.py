"""Magnetisation curves of steels: flux density against field, monotone, saturated beyond the last point."""

from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Any

import numpy as np

from padgen.core.errors import SpecError, number

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
        Fewer than three points, arrays of different length, a point that is not above 0 and finite or does not rise
        above the one before, or two points between which the curve rises less than air. The message names the point.
    """

    name: str
    flux_density_t: np.ndarray
    field_a_per_m: np.ndarray

    def __post_init__(self) -> None:
        b, h = (np.asarray(v, float) for v in (self.flux_density_t, self.field_a_per_m))
        object.__setattr__(self, "flux_density_t", b)
        object.__setattr__(self, "field_a_per_m", h)
        if b.ndim != 1 or b.shape != h.shape:
            self._refuse(f"needs as many flux densities as fields, got {b.size} and {h.size}")
        if b.size < 3:
            self._refuse(f"needs at least 3 points above the origin, got {b.size}")
        for name, values, unit in (("flux density", b, "T"), ("field", h, "A/m")):
            before = np.concatenate([[0.0], values[:-1]])
            bad = np.flatnonzero(~(np.isfinite(values) & (values > before)))
            if bad.size:
                i = int(bad[0])
                self._refuse(
                    f"the {name} of point {i + 1} must be above {number(float(before[i]))} {unit},"
                    f" that of the point before, got {number(float(values[i]))} {unit}"
                )
        flat = np.flatnonzero(np.diff(b) < MU_0 * np.diff(h) * (1 - 1e-9))
        if flat.size:
            i = int(flat[0]) + 1
            self._refuse(
                f"from point {i} to {i + 1} the flux density must rise by at least"
                f" {number(float(MU_0 * (h[i] - h[i - 1])))} T, as in air, got {number(float(b[i] - b[i - 1]))} T"
            )

    def _refuse(self, message: str) -> None:
        raise SpecError(message, f"magnetisation curve {self.name}")

    @cached_property
    def _knots(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fields, flux densities and slopes, starting with the origin."""
        h = np.concatenate([[0.0], self.field_a_per_m])
        b = np.concatenate([[0.0], self.flux_density_t])
        return h, b, _monotone_slopes(h, b)

    def flux_density_at(self, field_a_per_m: Any) -> np.ndarray:
        """Return B in T at fields H of any shape in A/m; odd in H."""
        h, b, slope = self._knots
        size = np.abs(np.asarray(field_a_per_m, float))
        i = np.clip(np.searchsorted(h, size, side="right") - 1, 0, len(h) - 2)
        step = h[i + 1] - h[i]
        t = (size - h[i]) / step
        inside = (
            (1 + 2 * t) * (1 - t) ** 2 * b[i]
            + t * (1 - t) ** 2 * step * slope[i]
            + t**2 * (3 - 2 * t) * b[i + 1]
            - t**2 * (1 - t) * step * slope[i + 1]
        )
        beyond = b[-1] + MU_0 * (size - h[-1])
        return np.asarray(np.sign(field_a_per_m) * np.where(size > h[-1], beyond, inside))

    def samples(self, about: int = 160) -> tuple[np.ndarray, np.ndarray]:
        """Return about `about` fields and flux densities from the origin on, close enough for straight lines between.

        The last point is at a thousand times the last field, on the line of slope μ0.
        """
        h = self._knots[0]
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

    Raises
    ------
    SpecError
        A permeability not above 1 or a saturation not above 0 T.
    """
    if not initial_permeability > 1:
        raise SpecError(f"the permeability must be above 1, got {number(initial_permeability)}", name)
    if not saturation_t > 0:
        raise SpecError(f"the saturation must be above 0 T, got {number(saturation_t)} T", name)
    share = 1 / (1 + np.geomspace(1e3, 1e-3, 61))  # J/J_s
    field = saturation_t * share / (1 - share) / (MU_0 * (initial_permeability - 1))
    return BHCurve(name, saturation_t * share + MU_0 * field, field)


def _monotone_slopes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the slopes of a monotone cubic.

    Inside they are weighted harmonic means of the chords, at the origin a limited parabola's, at the end that of air.
    """
    step, chord = np.diff(x), np.diff(y) / np.diff(x)
    first, second = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    inner = (first + second) / (first / chord[:-1] + second / chord[1:])
    at_origin = ((2 * step[0] + step[1]) * chord[0] - step[0] * chord[1]) / (step[0] + step[1])
    return np.concatenate([[np.clip(at_origin, 0.1 * chord[0], 3 * chord[0])], inner, [MU_0]])


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
