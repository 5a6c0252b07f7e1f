"""Models of the skin that touches a taxel, one file each, found by the file's name; `register` adds others.

A contact is a spring, a damper and a mass beside the taxel's own, each of which may go with frequency. A model makes a
`Contact` from data (`ContactModel.made_of`); its `impedance` is that under a `Contactor`, the part of the taxel that
meets the skin. Sizes are in SI units, and everything works on arrays.

All figures of skin are provisional: nobody has published k, c or m of contactors of 0.5 to 3 mm (docs/touch.md).
"""

from collections.abc import Mapping
from math import inf, pi
from typing import Any, NamedTuple, Protocol

import numpy as np

from padgen.core.registry import CONTACTS

__all__ = [
    "Contact",
    "ContactModel",
    "Contactor",
    "Impedance",
    "LoadedTaxels",
    "Scaled",
    "dome_radius",
    "guard_factor",
    "loaded_resonance",
    "preload_factor",
    "register",
    "unregister",
]

Array = Any


class Impedance(NamedTuple):
    """Load of a contact on a taxel at some frequencies: stiffness in N/m, damping in N s/m and mass in kg."""

    stiffness: Array
    damping: Array
    mass: Array

    def dynamic_stiffness(self, hz: Array) -> Array:
        """Return force over displacement in N/m at `hz`, complex."""
        omega = 2 * pi * np.asarray(hz, float)
        return self.stiffness - self.mass * omega**2 + 1j * omega * self.damping

    def through(self, lever: Array) -> "Impedance":
        """Return the load as felt by a taxel's moving mass if the skin moves `lever` times as far as that mass."""
        return Impedance(*(part * np.asarray(lever) ** 2 for part in self))


class Contactor(NamedTuple):
    """The part of a taxel that meets the skin, a flat disc.

    `radius` in m is that of the contact (`dome_radius` for a dome). A guard plate round it holds the skin, with a hole
    of `hole_ratio` times the radius; without a plate that is infinite. The skin at rest is pressed in by `indentation`
    in m beyond the plate.
    """

    radius: Array
    hole_ratio: Array = inf
    indentation: Array = 0.0


class Contact(Protocol):
    """Something that touches taxels, such as skin."""

    def impedance(self, hz: Array, contactor: Contactor) -> Impedance:
        """Return the load of the contact on a taxel at frequencies `hz` in Hz, under a contactor."""

    def error(self, hz: Array, contactor: Contactor) -> Array:
        """Return the relative error of the dynamic stiffness by the model alone, as if its data were certain."""


class Scaled(NamedTuple):
    """A contact with all its stiffness, damping and mass multiplied by factors, numbers or arrays."""

    contact: Contact
    stiffness: Array = 1.0
    damping: Array = 1.0
    mass: Array = 1.0

    def impedance(self, hz: Array, contactor: Contactor) -> Impedance:
        """Return the scaled load of the contact on a taxel at frequencies `hz` in Hz, under a contactor."""
        added = self.contact.impedance(hz, contactor)
        return Impedance(added.stiffness * self.stiffness, added.damping * self.damping, added.mass * self.mass)

    def error(self, hz: Array, contactor: Contactor) -> Array:
        """Return the relative error of the unscaled contact's dynamic stiffness, which the factors leave as it is."""
        return self.contact.error(hz, contactor)


class ContactModel(Protocol):
    """A model of contact: a module, or any object, with the function `made_of`."""

    def made_of(self, fields: Mapping[str, Any]) -> Contact:
        """Return the contact with the data of a catalogue row or of a user's table."""


register = CONTACTS.register
unregister = CONTACTS.unregister


GUARD_RATIO = np.array([1.1, 1.2, 1.3, 1.5, 2.0, 3.0, 4.0, 6.0])
GUARD_FACTOR = np.array([2.0, 1.73, 1.59, 1.44, 1.27, 1.16, 1.11, 1.07])
"""Stiffness of skin within a hole of a rigid plate over that of free skin, by the ratio of hole and contactor."""
PRELOAD_M = 0.5e-3
"""Indentation that makes skin e times as stiff."""


def guard_factor(hole_ratio: Array) -> Array:
    """Return the factor (≥ 1) by which a guard plate stiffens skin, from the ratio (> 1) of hole to contactor diameter.

    Notes
    -----
    Of a homogeneous half-space that the plate holds, solved as a mixed boundary problem at ratios from 1.1 to 6;
    straight between them in the logarithms of ratio - 1 and factor - 1, and beyond as the end pieces go. Finite
    elements agree (docs/touch.md). A stiff outer layer that bends over the hole may make it larger.

    >>> [round(float(guard_factor(ratio)), 2) for ratio in (1.5, 2.0, inf)]
    [1.44, 1.27, 1.0]
    """
    ratio = np.asarray(hole_ratio, float)
    if np.any(ratio <= 1):
        raise ValueError("the hole of a guard plate must be wider than the contactor")
    x = np.log(GUARD_RATIO - 1)
    y = np.log(GUARD_FACTOR - 1)
    at = np.log(np.minimum(ratio, 1e30) - 1)
    piece = np.clip(np.searchsorted(x, at) - 1, 0, len(x) - 2)
    slope = (y[piece + 1] - y[piece]) / (x[piece + 1] - x[piece])
    return 1 + np.exp(y[piece] + slope * (at - x[piece]))


def preload_factor(indentation: Array) -> Array:
    """Return the factor by which skin stiffens where it is pressed in by `indentation` in m at rest: ``exp(δ/0.5 mm)``.

    Assumed; the shape is that of whole finger pads, whose force rises exponentially (Pawluk and Howe 1999), and of
    pins, whose impedance goes with static force. For 0 to 0.5 mm; wrong by 2 or 3 times at the end.
    """
    return np.exp(np.asarray(indentation, float) / PRELOAD_M)


def dome_radius(curvature_radius: Array, indentation: Array) -> Array:
    """Return the radius in m of the contact of a dome pressed into skin: ``√(R δ)`` (Hertz 1882), δ well below R."""
    return np.sqrt(np.asarray(curvature_radius, float) * indentation)


MOST_ROUNDS = 200
SETTLED = 1e-12
"""Rounds in which a touched resonance settles where a contact goes with frequency, and its last relative step."""


def loaded_resonance(
    contact: Contact, contactor: Contactor, stiffness: Array, mass: Array, q: Array, lever: Array = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return resonance in Hz and Q of touched taxels (n,), from stiffness in N/m, effective mass in kg and Q untouched.

    What the contact adds is taken at the touched resonance: ``(k + k_s)/(m + m_s) = ω²``, found by steps of the
    logarithm, which are halved once they do not shrink: one step is enough where nothing goes with frequency. The
    taxel's own damper stays as it is.
    """
    stiffness = np.asarray(stiffness, float)
    hz = np.sqrt(stiffness / mass) / (2 * pi)
    share = 1.0
    last = np.inf
    for _ in range(MOST_ROUNDS):
        added = contact.impedance(hz, contactor).through(lever)
        step = np.log(np.sqrt((stiffness + added.stiffness) / (mass + added.mass)) / (2 * pi) / hz)
        longest = np.abs(step).max()
        if longest < SETTLED:
            break
        if longest > last / 2:
            share = 0.5
        last = longest
        hz = hz * np.exp(share * step)
    added = contact.impedance(hz, contactor).through(lever)
    damping = np.sqrt(stiffness * mass) / q + added.damping
    return hz, np.sqrt((stiffness + added.stiffness) * (mass + added.mass)) / damping


class LoadedTaxels(NamedTuple):
    """Touched taxels (n,), each a resonator loaded by a contact; a `Responses` of `padgen.physics.selectivity`.

    `stiffness` in N/m, `mass` in kg and `q` are untouched. The skin moves by `lever`, a number or (n,), times as far.
    """

    contact: Contact
    contactor: Contactor
    stiffness: np.ndarray
    mass: np.ndarray
    q: np.ndarray
    lever: Array = 1.0

    @property
    def responses(self) -> int:
        """Number of resonator responses computed for each taxel and spectral line: one."""
        return 1

    def energy(self, rows: slice, frequency: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:
        """Return touched taxels' squared amplitudes (rows, spectral lines), divided by those at resonance untouched.

        A line is a sine of the force at a `frequency`; all have one amplitude.

        `rest`, the rounding error of a frequency, does not count at a Q as low as that of touched taxels.
        """
        stiffness, mass, q = (part[rows, None] for part in (self.stiffness, self.mass, self.q))
        omega = 2 * pi * np.asarray(frequency)
        lever = np.broadcast_to(self.lever, self.q.shape)[rows, None]
        added = self.contact.impedance(frequency, self.contactor).through(lever)
        bare = stiffness - mass * omega**2 + 1j * omega * np.sqrt(stiffness * mass) / q
        return np.asarray(np.abs(stiffness / q / (bare + added.dynamic_stiffness(frequency))) ** 2)
