"""Effect of a finger's skin on a taxel that it touches: a spring, a damper and a mass beside the taxel's own.

A flat contactor of radius a on skin: ``k = 2 E* a``, ``c = τ k``, ``m = 4/3 ρ a³`` (contact of a rigid punch with a
half-space, Johnson, Contact Mechanics, 3.4). No measurements of contactors of 0.5 to 4 mm on glabrous skin were found:
the constants are scaled from data on whole finger pads and are provisional (docs/accuracy.md lists them).
"""

from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np

__all__ = ["HAND_LIMIT_M_PER_S2", "LOADED", "SKINS", "Skin", "touched", "weighted_acceleration"]

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


HAND_LIMIT_M_PER_S2 = 5.0
"""Daily exposure of a hand to vibration over eight hours, weighted: limit of Directive 2002/44/EC, article 3."""


def weighted_acceleration(hz: float, amplitude_m: float) -> float:
    """Return the root mean square of the acceleration in m/s² of a sine, weighted as ISO 5349-1:2001, annex A, does.

    Above 16 Hz the weight falls as 1/f, so that the figure goes with the velocity.

    >>> [round(weighted_acceleration(hz, sqrt(2) / (2 * pi * hz) ** 2), 3) for hz in (6.3, 16, 125)]  # of 1 m/s²
    [0.727, 0.894, 0.127]
    """
    s = 2j * pi * hz
    low, high, turn = 2 * pi * 10**0.8, 2 * pi * 10**3.1, 100.0
    band = s**2 / (s**2 + sqrt(2) * low * s + low**2) * high**2 / (s**2 + sqrt(2) * high * s + high**2)
    weight = abs(band * (s + turn) * turn / (s**2 + turn * s / 0.64 + turn**2))
    return weight * abs(s) ** 2 * amplitude_m / sqrt(2)
