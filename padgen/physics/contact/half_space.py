"""Skin as a half-space with a stiff outer layer, under a flat punch: few constants, closed form.

    k = 2 E* (a + a0) g p      c = τ k + c_rad      m = 4/3 ρ (a + a0)³
    c_rad = 3.4 (a + a0)² √(ρ |G|)/(1 − ν),   G = E*/4 (1 + jωτ),  ν = 1/2

E* is the reduced modulus of what lies below, τ its time constant of loss. The outer layer spreads the pressure as if
the contactor were wider by a0. The static part is a rigid punch on a half-space (Johnson, *Contact Mechanics*, 1985,
3.4), c_rad the waves that leave a disc (Lysmer and Richart, J. Soil Mech. Found. Div. 92 (1966) 65), m half of the mass
of a ball of that radius. g counts a guard plate, p a preload. For diameters of 0.5 to 3 mm and 50 to 500 Hz.
"""

from collections.abc import Mapping
from math import pi
from typing import Any, NamedTuple

import numpy as np

from padgen.core.units import KPA, MM, MS
from padgen.physics.contact import Contactor, Impedance, guard_factor, preload_factor

__all__ = ["DENSITY", "HalfSpace", "layer_radius", "made_of"]

Array = Any

DENSITY = 1100.0
"""Density of skin in kg/m³."""
POISSON = 0.5
LEAST_ERROR = 0.03
LAYER_ERROR = 0.17
RADIATION_ERROR = 1.1
"""Relative error of the dynamic stiffness against that of layers (docs/touch.md): at least, for all of the contact's
width that the outer layer adds, and over the share of the radiation that is out of step with the velocity."""
GUARD_ERROR = 2.5
"""Share by which an outer layer stiffens the skin in a guard plate's hole, for one that adds as much as the gap is
wide: the layer bends and shears across it, which the factor of a homogeneous half-space leaves out."""


class HalfSpace(NamedTuple):
    """Skin: reduced modulus E* in Pa, length a0 in m that its outer layer adds to contact radius, time constant τ in s.

    Each is a number or an array.
    """

    modulus: Array
    layer: Array
    time: Array

    def impedance(self, hz: Array, contactor: Contactor) -> Impedance:
        """Return the load of the skin on a taxel at frequencies `hz` in Hz, under a contactor."""
        wide = np.asarray(contactor.radius) + self.layer
        stiffness = 2 * self.modulus * wide * guard_factor(contactor.hole_ratio)
        stiffness = stiffness * preload_factor(contactor.indentation)
        damping = self.time * stiffness + self._radiated(hz, contactor)
        return Impedance(stiffness, damping, 4 / 3 * DENSITY * wide**3)

    def _radiated(self, hz: Array, contactor: Contactor) -> Array:
        """Return the damping in N s/m by waves that leave the contact."""
        wide = np.asarray(contactor.radius) + self.layer
        shear = self.modulus / 4 * np.hypot(1, 2 * pi * np.asarray(hz, float) * self.time)
        return 3.4 / (1 - POISSON) * wide**2 * np.sqrt(DENSITY * shear)

    def error(self, hz: Array, contactor: Contactor) -> Array:
        """Return the relative error of the dynamic stiffness against finite elements of layered skin.

        With a complex modulus the waves' force lags the velocity by half of the loss angle, which the damper leaves
        out; the outer layer's own loss and inertia are not those below; and it bridges the gap of a guard plate.
        """
        omega = 2 * pi * np.asarray(hz, float)
        total = np.abs(self.impedance(hz, contactor).dynamic_stiffness(hz))
        lag = np.sin(np.arctan(omega * self.time) / 2)
        outer = self.layer / (np.asarray(contactor.radius) + self.layer)
        radiated = omega * self._radiated(hz, contactor) * lag / total
        across = GUARD_ERROR * self.layer / (np.asarray(contactor.radius) * (contactor.hole_ratio - 1))
        return LEAST_ERROR + LAYER_ERROR * outer + RADIATION_ERROR * radiated + across / (1 + across)


def layer_radius(thickness: Array, outer_modulus: Array, modulus: Array) -> Array:
    """Return the length a0 in m that a stiff outer layer adds to contact radius, from its thickness and both moduli.

    Notes
    -----
    ``a0 = 0.62 h (R^(1/3) − 0.86)`` with R the ratio of moduli: a plate on a half-space bends over a length that goes
    as ``h R^(1/3)`` (Timoshenko and Woinowsky-Krieger, *Theory of Plates and Shells*, 1959, 8.). The two numbers are of
    the static solution of a punch on layers, R from 3 to 60, radii from 0.6 h on (docs/touch.md).
    """
    ratio = np.asarray(outer_modulus, float) / modulus
    return np.maximum(0.62 * thickness * (ratio ** (1 / 3) - 0.86), 0.0)


def made_of(fields: Mapping[str, Any]) -> HalfSpace:
    """Return the skin of a catalogue row: `modulus_kpa`, `layer_mm` and `time_ms`."""
    return HalfSpace(fields["modulus_kpa"] * KPA, fields["layer_mm"] * MM, fields["time_ms"] * MS)
