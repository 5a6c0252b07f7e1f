"""Formulas of one resonator: frequency, receptance, ring-up (paper Eq. 1-3)."""

from math import pi
from typing import Any

import numpy as np

__all__ = [
    "natural_frequency",
    "receptance",
    "relative_energy",
    "ring_up_time",
    "rule_stiffness",
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
