"""Drive schemes, one file each, found by the file's name; `register` adds others.

A scheme has the names of `DriveScheme`: the demands of its current on coil and amplifier, and the lines of its squared
current beside the wanted ones. `line_a2` (n,) are the amplitudes in A² of the wanted lines of i², one per channel.
`scheme` is the `padgen.physics.selectivity.Scheme` with the spec's settings. `headroom` is the share by which the
spur-free force's constant exceeds the sum of the lines.
"""

from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from padgen.core.registry import SCHEMES

if TYPE_CHECKING:
    from padgen.physics.selectivity import Scheme

__all__ = ["DriveScheme", "in_order", "register", "simplest_first", "unregister"]


class DriveScheme(Protocol):
    """A drive scheme: a module, or any object, with these names.

    An `ORDER` may set its place in lists; a `SIMPLICITY` may set when an automatic choice tries it, the lowest first.
    Schemes without these come last.
    """

    CURRENT: str
    """Kind of the coil's current: ``"tones"`` (sines at half the resonances), ``"biased"`` (a constant and sines at the
    resonances) or ``"root"`` (the square root of the wanted force).
    """
    TAKES_TURNS: bool
    """True where one channel plays at a time."""
    HAS_PAIR_SPURS: bool
    """True where two channels together make unwanted lines of i²."""

    def pair_square(self, scheme: "Scheme", a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
        """Return the squared amplitude of the spurs of two channels with the wanted lines a and b.

        `strongest` is the line that sets the bias.
        """

    def mean_square_a2(self, scheme: "Scheme", line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
        """Return the mean of i² in A² with the channels `on` (n,)."""

    def current_lines_a(self, scheme: "Scheme", line_a2: np.ndarray, headroom: float) -> np.ndarray:
        """Return the peak current (n,) in A of each channel."""

    def peak_current_a(self, scheme: "Scheme", line_a2: np.ndarray, headroom: float) -> float:
        """Return an upper bound in A of the current: all peaks at one moment."""

    def peak_voltage_v(
        self,
        scheme: "Scheme",
        line_a2: np.ndarray,
        resonance_hz: np.ndarray,
        resistance: float,
        inductance: float,
        headroom: float,
    ) -> float:
        """Return an upper bound in V of the coil's voltage: all peaks at one moment."""


register, unregister = SCHEMES.register, SCHEMES.unregister


def in_order() -> tuple[str, ...]:
    """Return the names of all schemes in the order of a plan's lists."""
    return _sorted(lambda scheme: getattr(scheme, "ORDER", inf))


def simplest_first() -> tuple[str, ...]:
    """Return the names of all schemes by the demands on the electronics, those that take turns last."""
    return _sorted(lambda scheme: (scheme.TAKES_TURNS, getattr(scheme, "SIMPLICITY", inf)))


def _sorted(key: Callable[[Any], Any]) -> tuple[str, ...]:
    return tuple(sorted(SCHEMES.names(), key=lambda name: key(SCHEMES.get(name))))
