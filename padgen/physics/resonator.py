"""Formulas of one resonator: frequency, receptance, ring-up (paper Eq. 1-3), and the effect of a finger's skin on it.

Skin is a spring, a damper and a mass beside the taxel's own. A flat contactor of radius a on skin: ``k = 2 E* a``, ``c
= τ k``, ``m = 4/3 ρ a³`` (contact of a rigid punch with a half-space, Johnson, Contact Mechanics, 3.4). No measurements
of contactors of 0.5 to 4 mm on glabrous skin were found: the constants are scaled from data on whole finger pads and
are provisional (docs/accuracy.md lists them).
"""

from math import pi
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "LOADED",
    "SKINS",
    "Skin",
    "natural_frequency",
    "receptance",
    "relative_energy",
    "ring_up_time",
    "rule_stiffness",
    "touched",
]

Array = Any


def natural_frequency(stiffness: Array, mass: Array) -> Array:
    """Return the natural frequency in Hz of a point mass in kg on a spring in N/m (paper Eq. 1)."""
    return np.sqrt(np.divide(stiffness, mass)) / (2 * pi)


def rule_stiffness(modulus: Array, width: Array, thickness: Array, length: Array, end_factor: Array) -> Array:
    """Return the stiffness in N/m of one beam by the point-mass rule ``k = c E w t³/l³`` (paper Eq. 2).

    `end_factor` c is 1/4 for a cantilever with a free end slope and 1 for a guided beam; the stiffnesses of parallel
    beams add. Lengths in m, `modulus` in Pa.
    """
    return end_factor * modulus * width * (np.asarray(thickness) / length) ** 3


def receptance(frequency: Array, resonance: Array, mass: Array, q: Array) -> Array:
    """Return the complex displacement per force in m/N at force `frequency` in Hz.

    ``H = 1/(4π² m) / (f_i² − f² + j f f_i/Q_i)``. The difference of squares is computed as a product, so that a tone
    next to its resonance keeps its digits at large Q.
    """
    frequency, resonance = np.asarray(frequency, float), np.asarray(resonance, float)
    detuning = (resonance - frequency) * (resonance + frequency)
    return 1 / (4 * pi**2 * np.asarray(mass)) / (detuning + 1j * frequency * resonance / q)


def relative_energy(frequency: Array, resonance: Array, q: Array, rest: Array = 0.0) -> Array:
    """Return the squared receptance at `frequency` over that at resonance, ``1/((Q (1−s²))² + s²)``, s = f/f_i.

    It is 1 at the resonance and 1/Q² far below. `rest` is the rounding error of `frequency`: the two are subtracted
    from the resonance one after the other, so that the distance of a line to it stays exact.
    """
    offset = (resonance - frequency) - rest
    share = frequency / resonance
    bracket = offset / resonance * q * (1 + share)
    return 1 / (bracket * bracket + share * share)


def ring_up_time(resonance: Array, q: Array) -> Array:
    """Return the time constant in s with which a vibration grows and decays, ``Q/(π f)``."""
    return np.asarray(q) / (pi * np.asarray(resonance))


DENSITY_KG_PER_M3 = 1100.0
LOADED = 0.1
"""Largest stiffness of skin over a taxel's that counts as not loading it; the resonance is then 5 % higher."""


class Skin(NamedTuple):
    """Reduced modulus E* in Pa and time constant τ in s of skin."""

    modulus: float
    time: float


SKINS = {"low": Skin(30e3, 0.4e-3), "typical": Skin(100e3, 1.0e-3), "high": Skin(300e3, 1.6e-3)}
"""Typical: a finger pad pressed with less than 0.5 N has 1000 N/m and 1.5 N·s/m (Grigorii et al. 2021), over an assumed
contact radius of 5 mm. Low: E = 25 kPa; high: a margin for firmer touch.
"""


def touched(skin: Skin, radius: float, stiffness: Any, mass: Any, q: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return resonance in Hz, Q and stiffness in N/m of taxels under skin, from those in air.

    All in SI units; `mass` is the effective one, `radius` that of the contact.

    >>> hz, q, k = touched(SKINS["typical"], 1.25e-3, 17.95, 1.45e-4, 15.0)
    >>> f"{hz:.0f} Hz, Q {q:.1f}, {k:.0f} N/m"
    '214 Hz, Q 0.8, 268 N/m'
    """
    added = 2 * skin.modulus * radius
    stiffer, heavier = np.asarray(stiffness + added), mass + 4 / 3 * DENSITY_KG_PER_M3 * radius**3
    damping = np.sqrt(stiffness * mass) / q + skin.time * added
    return np.sqrt(stiffer / heavier) / (2 * pi), np.sqrt(stiffer * heavier) / damping, stiffer
