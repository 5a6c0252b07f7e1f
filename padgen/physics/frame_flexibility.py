"""How far the frame's flexibility can shift a taxel's resonance: an upper bound by hand formulas.

The resonance of a taxel is planned with the four sides of its sub-cell held. The real frame gives in two
ways: the rib at the beams' root twists, and the pad bends as a plate. In series with a spring of stiffness k
a compliance c lowers the resonance by k c/2.
"""

from math import inf, pi
from typing import NamedTuple

__all__ = ["SUPPORTS", "Ribs", "Support", "TaxelReaction", "lowest_frame_mode_hz", "shift_bound"]

RIB_MARGIN, PLATE_MARGIN = 2.5, 2.5
"""For what the formulas leave out: the give of the joint and the rib's lateral bending, unequal supports,
more than one mode."""
SHEAR_SHARE = 0.9
"""What shear of the ribs, which a thin plate's formulas leave out, takes off the frame's lowest mode: 7 % were seen."""
NEAR_RESONANCE = 0.7
"""Share of the frame's lowest mode beyond which a static compliance says nothing."""


class Support(NamedTuple):
    """A square plate of side a and bending stiffness D: deflection of its centre under a force P there is
    ``point · P a²/D``, under an even pressure p it is ``even · p a⁴/D``."""

    point: float
    even: float


SUPPORTS = {
    "edges": Support(0.0056, 0.00126),
    "corners": Support(0.039, 0.0249),
    "bottom": Support(0.0, 0.0),
}
"""By name of the clamping. Plate coefficients for ν = 0.3: Timoshenko and Woinowsky-Krieger, Theory of Plates
and Shells (1959), tables 35, 37 and 42."""


class Ribs(NamedTuple):
    """The frame, in SI units: ribs of `width_m` and `height_m` that span `span_m` across the beams' root,
    a pad of side `side_m` of which `share` is plastic across, border and mean of both directions, `mass_kg` in all."""

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
    """Estimate of the frame's lowest bending mode with all taxels riding on it, `moving_kg` in all.

    From the deflection under its own weight, ``ω² = g/w`` (Rayleigh with w the centre's deflection, which is
    too low); infinite where nothing bends.
    """
    if not support.even:
        return inf
    deflection = support.even * (ribs.mass_kg + moving_kg) * ribs.side_m**2 / ribs.bending_n_m
    return float(SHEAR_SHARE * (1 / deflection) ** 0.5 / (2 * pi))


def shift_bound(taxel: TaxelReaction, ribs: Ribs, support: Support, moving_kg: float) -> float:
    """Largest relative shift of a taxel's resonance, the peak of its own response, on its frame; infinite near a
    frame mode."""
    mode = lowest_frame_mode_hz(ribs, support, moving_kg)
    if taxel.resonance_hz >= NEAR_RESONANCE * mode:
        return inf
    half = taxel.stiffness_n_per_m / 2
    rib = half * taxel.arm_m**2 / ribs.twist_n_m
    plate = half * support.point * ribs.side_m**2 / ribs.bending_n_m / (1 - (taxel.resonance_hz / mode) ** 2)
    return float(RIB_MARGIN * rib + PLATE_MARGIN * plate)
