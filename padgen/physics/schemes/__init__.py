"""Drive schemes, one file each, found by the file's name; others are added by `register`.

A scheme holds to `DriveScheme`: what its current asks of coil and amplifier, and what its square makes beside the
wanted lines. `line_a2` (n,) are the amplitudes in A² of the wanted lines of i², one per channel; `scheme` is the
`padgen.physics.selectivity.Scheme` with the spec's settings.
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

    An `ORDER` may say where it stands in lists, a `SIMPLICITY` when an automatic choice tries it, the lowest first;
    those without one come last.
    """

    CURRENT: str
    """Of what the coil's current is made: ``"tones"`` (sines at half the resonances), ``"biased"`` (a constant and
    sines at the resonances) or ``"root"`` (of the wanted force)."""
    TAKES_TURNS: bool
    """Whether one channel plays at a time."""
    HAS_PAIR_SPURS: bool
    """Whether two channels make lines of i² that neither wants."""

    def pair_square(self, scheme: "Scheme", a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
        """Square of the amplitude of a pair's spurs, by wanted lines; `strongest` is the line that sets the bias."""

    def mean_square_a2(self, scheme: "Scheme", line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
        """Mean of i² in A² with the channels `on` (n,)."""

    def current_lines_a(self, scheme: "Scheme", line_a2: np.ndarray, headroom: float) -> np.ndarray:
        """Peak current (n,) in A of each channel."""

    def peak_current_a(self, scheme: "Scheme", line_a2: np.ndarray, headroom: float) -> float:
        """Largest current in A, all peaks together."""

    def peak_voltage_v(
        self,
        scheme: "Scheme",
        line_a2: np.ndarray,
        resonance_hz: np.ndarray,
        resistance: float,
        inductance: float,
        headroom: float,
    ) -> float:
        """Bound in V of what the coil asks for, all peaks together."""


def register(name: str, scheme: DriveScheme) -> None:
    """Add a scheme, which specs may name from then on and ``auto`` tries.

    Raises
    ------
    SpecError
        The name is taken or no name, or the scheme lacks something.
    """
    SCHEMES.register(name, scheme, DriveScheme)


def unregister(name: str) -> None:
    """Take away a scheme that was registered."""
    SCHEMES.unregister(name)


def in_order() -> tuple[str, ...]:
    """Names of all schemes, as plans list them."""
    return _sorted(lambda scheme: getattr(scheme, "ORDER", inf))


def simplest_first() -> tuple[str, ...]:
    """Names of all schemes by what the electronics must do, those that take turns last."""
    return _sorted(lambda scheme: (scheme.TAKES_TURNS, getattr(scheme, "SIMPLICITY", inf)))


def _sorted(key: Callable[[Any], Any]) -> tuple[str, ...]:
    return tuple(sorted(SCHEMES.names(), key=lambda name: key(SCHEMES.get(name))))
