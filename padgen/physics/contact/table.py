"""A contact by a table of its own: stiffness, damping and mass at some frequencies, as they were measured.

Straight lines in the logarithms of frequency and value join the points; a value of 0 is joined by straight lines over
the logarithm of frequency. Outside the table the end values stay. The contactor is the one it was measured with.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from padgen.core.units import GRAM
from padgen.physics.contact import Contactor, Impedance

__all__ = ["Table", "made_of"]

Array = Any


class Table(NamedTuple):
    """A measured contact: stiffness in N/m, damping in N s/m and mass in kg (n,) at rising frequencies (n,) in Hz."""

    hz: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    mass: np.ndarray
    relative_error: float = 0.0

    def impedance(self, hz: Array, contactor: Contactor) -> Impedance:
        """Return the load at frequencies `hz` in Hz, interpolated from the table; `contactor` has no effect."""
        at = np.log(np.maximum(np.asarray(hz, float), self.hz[0]))
        known = np.log(self.hz)

        def joined(values: np.ndarray) -> Array:
            if np.all(values > 0):
                return np.exp(np.interp(at, known, np.log(values)))
            return np.interp(at, known, values)

        return Impedance(joined(self.stiffness), joined(self.damping), joined(self.mass))

    def error(self, hz: Array, contactor: Contactor) -> Array:
        """Return the relative error that the table states."""
        return np.full(np.shape(hz), self.relative_error)


def made_of(fields: Mapping[str, Any]) -> Table:
    """Return the contact given by `hz`, `k_n_per_m`, `c_n_s_per_m`, `m_g`: lists, or numbers valid at all frequencies.

    `error`, by default 0, is the relative error of the dynamic stiffness.

    Raises
    ------
    ValueError
        The frequencies are not positive and rising, or a list has another length, or a value is negative.
    """
    hz = np.atleast_1d(np.asarray(fields.get("hz", 1.0), float))
    if not (hz > 0).all() or not (np.diff(hz) > 0).all():
        raise ValueError("the frequencies must be positive and rise")
    columns = []
    for name, unit in (("k_n_per_m", 1.0), ("c_n_s_per_m", 1.0), ("m_g", GRAM)):
        values = np.atleast_1d(np.asarray(fields.get(name, 0.0), float))
        if values.size not in (1, hz.size):
            raise ValueError(f"{name} must have one number, or {hz.size} as hz has, got {values.size}")
        if not (values >= 0).all():
            raise ValueError(f"{name} must not be negative")
        columns.append(np.broadcast_to(values, hz.shape) * unit)
    stiffness, damping, mass = columns
    return Table(hz, stiffness, damping, mass, float(fields.get("error", 0.0)))
