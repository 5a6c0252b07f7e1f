"""Upper bound, by hand formulas, on the shift of a taxel's resonance by the frame's flexibility.

A taxel's resonance is planned with the four sides of its sub-cell held. The real frame yields in two ways: the rib at
the beams' root twists, and the pad bends as a plate. In series with a spring of stiffness k a compliance c lowers the
resonance by k c/2.
"""

from math import inf, pi
from typing import NamedTuple

__all__ = ["SUPPORTS", "Ribs", "Support", "TaxelReaction", "lowest_frame_mode_hz", "shift_bound"]

RIB_MARGIN, PLATE_MARGIN = 2.5, 2.5
"""Factors for effects outside the formulas: compliance of the joint, lateral bending of the rib, unequal supports, and
further modes.
"""
SHEAR_SHARE = 0.9
"""Factor on the frame's lowest mode for shear of the ribs, which thin-plate formulas leave out: 7 % were seen."""
NEAR_RESONANCE = 0.7
"""Share of the frame's lowest mode above which a static compliance is no bound."""


class Support(NamedTuple):
    """Coefficients of a square plate of side a and bending stiffness D on its supports.

    The centre's deflection is ``point · P a²/D`` under a force P there and ``even · p a⁴/D`` under an even pressure p.
    """

    point: float
    even: float


SUPPORTS = {
    "edges": Support(0.0056, 0.00126),
    "corners": Support(0.039, 0.0249),
    "bottom": Support(0.0, 0.0),
}
"""Supports by name of the clamping. Plate coefficients for ν = 0.3: Timoshenko and Woinowsky-Krieger, Theory of Plates
and Shells (1959), tables 35, 37 and 42.
"""


class Ribs(NamedTuple):
    """The frame in SI units: ribs of `width_m` and `height_m` that span `span_m` across the beams' root.

    The pad has sides of `side_m`. `share` is the part of its cross-section that is plastic, border included, as the
    mean of both directions; `mass_kg` is its mass.
    """

    width_m: float
    height_m: float
    span_m: float
    side_m: float
    share: float
    mass_kg: float
    modulus_pa: float
    poisson: float

    @property
    def twist_n_m(self) -> float:
        """Torsional stiffness in N·m/rad of a rib at its middle, both ends held: ``4 G J/l``."""
        thin, wide = sorted((self.width_m, self.height_m))
        constant = wide * thin**3 / 3 * (1 - 0.63 * thin / wide)
        return 4 * self.modulus_pa / 2 / (1 + self.poisson) * constant / self.span_m

    @property
    def bending_n_m(self) -> float:
        """Bending stiffness in N·m of the pad as a plate."""
        return self.share * self.modulus_pa * self.height_m**3 / 12


class TaxelReaction(NamedTuple):
    """One channel: resonance in Hz, stiffness in N/m at the washer, and the `arm_m` of the washer about the root."""

    resonance_hz: float
    stiffness_n_per_m: float
    arm_m: float


def lowest_frame_mode_hz(ribs: Ribs, support: Support, moving_kg: float) -> float:
    """Estimate the frame's lowest bending mode in Hz, with the mass of all taxels, `moving_kg`, on it.

    From the deflection w under its own weight, ``ω² = g/w`` (Rayleigh). The estimate is low, since w is that of the
    centre. Infinite where nothing bends.
    """
    if not support.even:
        return inf
    deflection = support.even * (ribs.mass_kg + moving_kg) * ribs.side_m**2 / ribs.bending_n_m
    return float(SHEAR_SHARE * (1 / deflection) ** 0.5 / (2 * pi))


def shift_bound(taxel: TaxelReaction, ribs: Ribs, support: Support, moving_kg: float) -> float:
    """Return the largest relative shift of a taxel's resonance by its frame; infinite near a frame mode.

    The resonance is the peak of the taxel's own response.
    """
    mode = lowest_frame_mode_hz(ribs, support, moving_kg)
    if taxel.resonance_hz >= NEAR_RESONANCE * mode:
        return inf
    half = taxel.stiffness_n_per_m / 2
    rib = half * taxel.arm_m**2 / ribs.twist_n_m
    plate = half * support.point * ribs.side_m**2 / ribs.bending_n_m / (1 - (taxel.resonance_hz / mode) ** 2)
    return float(RIB_MARGIN * rib + PLATE_MARGIN * plate)
