"""Drive schemes, one file each, found by the file's name; `register` adds others.

A scheme has the names of `DriveScheme`: the demands of its current on coil and amplifier, and the lines of its squared
current beside the wanted ones. `line_a2` (n,) are the amplitudes in A² of the wanted lines of i², one per channel.
Movers whose force follows the current itself have schemes of `FORCE_ORDER` 1: their lines are of i, in A.
`scheme` is the `padgen.physics.selectivity.Scheme` with the spec's settings. `headroom` is the share by which the
spur-free force's constant exceeds the sum of the lines. Functions here are of a coil with all channels on.
"""

from collections.abc import Callable
from math import inf
from typing import Any, Protocol

import numpy as np

from padgen.core.registry import SCHEMES
from padgen.physics.selectivity import SQUARE, Scheme

__all__ = [
    "DriveScheme",
    "bias_a",
    "current_lines_a",
    "formula",
    "in_order",
    "in_words",
    "mean_pull_line",
    "mean_square_a2",
    "on_carrier_v",
    "peak_current_a",
    "peak_voltage_v",
    "register",
    "root_voltage_v",
    "simplest_first",
    "unregister",
]


class DriveScheme(Protocol):
    """A drive scheme: a module, or any object, with the attributes and functions below.

    An `ORDER` may set its place in lists; a `SIMPLICITY` may set when an automatic choice tries it, the lowest first.
    Schemes without these come last. A `FORCE_ORDER` of 1 is for forces in proportion to the current; without one it is
    2, for forces in proportion to its square.
    """

    CURRENT: str
    """Kind of the coil's current: ``"tones"`` (sines at half the resonances), ``"biased"`` (a constant and sines at the
    resonances), ``"root"`` (the square root of the wanted force) or ``"linear"`` (sines at the resonances alone).
    """
    TAKES_TURNS: bool
    """True where one channel plays at a time."""
    HAS_PAIR_SPURS: bool
    """True where two channels together make unwanted lines of i²."""

    def pair_square(self, scheme: Scheme, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
        """Return the squared amplitude of a spur of two channels, given the amplitudes a and b of their wanted lines.

        `strongest` is the line that sets the bias.
        """

    def mean_square_a2(self, scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray) -> float:
        """Return the mean of i² in A² with the channels `on` (n,)."""

    def current_lines_a(self, scheme: Scheme, line_a2: np.ndarray, headroom: float) -> np.ndarray:
        """Return each channel's peak current (n,) in A: of its tone or, without tones, of the coil when only it is on.

        The latter is for currents that are no sum of tones, such as the root of a force.
        """

    def peak_current_a(self, scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
        """Return an upper bound in A of the current: all peaks at one moment."""

    def peak_voltage_v(
        self,
        scheme: Scheme,
        line_a2: np.ndarray,
        resonance_hz: np.ndarray,
        resistance: float,
        inductance: float,
        headroom: float,
    ) -> float:
        """Return an upper bound in V of the coil's voltage: all peaks at one moment."""


register = SCHEMES.register
unregister = SCHEMES.unregister


def in_order(force_order: int = SQUARE) -> tuple[str, ...]:
    """Return the names of schemes for forces that go as current^`force_order`, in the order of a plan's lists."""
    return _sorted(force_order, lambda scheme: getattr(scheme, "ORDER", inf))


def simplest_first(force_order: int = SQUARE) -> tuple[str, ...]:
    """Return the names of schemes for forces that go as current^`force_order`, simplest electronics first.

    Schemes whose channels take turns come after all others.
    """
    return _sorted(force_order, lambda scheme: (scheme.TAKES_TURNS, getattr(scheme, "SIMPLICITY", inf)))


def _sorted(force_order: int, key: Callable[[Any], Any]) -> tuple[str, ...]:
    names = (name for name in SCHEMES.names() if Scheme(name).force_order == force_order)
    return tuple(sorted(names, key=lambda name: key(SCHEMES.get(name))))


FORMULAS = {
    "linear": "i(t) = sum over ON channels of I_j sin(2 pi resonance_hz_j t)",
    "root": "i(t) = sqrt(a0 + sum over ON channels of a_j cos(2 pi resonance_hz_j t))",
    "biased": "i(t) = B + sum over ON channels of b_j sin(2 pi resonance_hz_j t)",
    "tones": "i(t) = sum over ON channels of I_j sin(2 pi drive_hz_j t)",
}
"""The formula of each kind of current: a_j are `line_a2`, B is `bias_a`, b_j and I_j are `current_lines_a`."""


def formula(scheme: Scheme) -> str:
    """Return the formula of a coil's current over time, as text."""
    text = FORMULAS[scheme.kind.CURRENT]
    if not scheme.takes_turns:
        return text
    return f"{text.replace('sum over ON channels of ', '')} in the slot of each ON channel j, one after the other"


IN_WORDS = {
    "linear": "sines at the resonances",
    "root": "the square root of the wanted force",
    "biased": "a constant and sines at the resonances",
    "tones": "sines at half the resonances",
}
"""The kinds of current in words, for people."""


def in_words(scheme: Scheme) -> str:
    """Return what a coil's current is, in a few words."""
    return IN_WORDS[scheme.kind.CURRENT] + (", one channel at a time" if scheme.takes_turns else "")


def bias_a(scheme: Scheme, line_a2: np.ndarray) -> float:
    """Return the constant current B in A of the biased scheme: `bias_ratio` times its largest tone ``b = a/(2B)``."""
    return float(np.sqrt(scheme.bias_ratio * line_a2.max(initial=0.0) / 2))


def mean_square_a2(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray | None = None) -> float:
    """Return the mean of i² in A² with the channels `on` (n,), or with all.

    Times R it is the copper loss.
    """
    return scheme.kind.mean_square_a2(scheme, line_a2, headroom, np.full(len(line_a2), True) if on is None else on)


def mean_pull_line(scheme: Scheme, line_a2: np.ndarray, headroom: float, on: np.ndarray | None = None) -> float:
    """Return the mean of i² in A² for schemes whose force goes with i² (washers); 0 where it goes with i (magnets).

    Times a force constant it is the mean pull.
    """
    return 0.0 if scheme.force_order == 1 else mean_square_a2(scheme, line_a2, headroom, on)


def current_lines_a(scheme: Scheme, line_a2: np.ndarray, headroom: float = 0.0) -> np.ndarray:
    """Return each channel's peak current (n,) in A: of its tone or, if spur-free, of the coil when only it is on."""
    return scheme.kind.current_lines_a(scheme, line_a2, headroom)


def peak_current_a(scheme: Scheme, line_a2: np.ndarray, headroom: float) -> float:
    """Return an upper bound in A of the current: all peaks at one moment."""
    return scheme.kind.peak_current_a(scheme, line_a2, headroom)


def peak_voltage_v(
    scheme: Scheme, line_a2: np.ndarray, resonance_hz: np.ndarray, resistance: float, inductance: float, headroom: float
) -> float:
    """Return an upper bound in V of the coil's voltage: all peaks at one moment."""
    return scheme.kind.peak_voltage_v(scheme, line_a2, resonance_hz, resistance, inductance, headroom)


def on_carrier_v(
    volts: np.ndarray | float, root_a: np.ndarray | float, inductance: float, carrier_hz: float
) -> np.ndarray:
    """Return the voltage's envelope in V for the current ``√2 root cos 2πf_c t``; `volts`: voltage without carrier."""
    return np.asarray(np.sqrt(2) * np.hypot(volts, 2 * np.pi * carrier_hz * inductance * root_a))


def root_voltage_v(line_a2: float, resonance_hz: float, resistance: float, inductance: float, headroom: float) -> float:
    """Return the peak in V of ``R i + L di/dt`` for ``i² = a (1 + h + cos 2π r t)``: one spur-free channel on."""
    # Samples crowd at the sharpest bend of the current, which is √h wide.
    phase = np.pi + 2 * np.pi * np.sinh(np.linspace(-4, 4, 4001)) / (2 * np.sinh(4))
    current = np.sqrt(line_a2 * np.maximum(headroom + 2 * np.cos(phase / 2) ** 2, 1e-30))
    slope = -line_a2 * np.sin(phase) * 2 * np.pi * resonance_hz / (2 * current)
    return float((resistance * current + inductance * slope).max())
