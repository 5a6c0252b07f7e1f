"""The on/off states of one coil under plain tones: what is driven, what vibrates, what spurs fall where.

A current of tones at f_j pulls with its square (paper Eq. 5): wanted lines at 2 f_j, and for every
pair that is on, spurs at f_a + f_b and |f_a − f_b| with twice the geometric mean of the wanted
forces, 6 dB more than equal ones.
"""

from dataclasses import dataclass
from itertools import combinations, product

from padgen.planner.plan import Channel, Plan

__all__ = ["LARGEST_TABLE", "Line", "Spur", "State", "coil_states"]

LARGEST_TABLE = 6
"""Channels up to which all 2ⁿ states are spelled out (paper Table I has n = 2)."""


@dataclass(frozen=True, slots=True)
class Line:
    """A wanted line of the force."""

    channel: int
    force_hz: float
    force_mn: float


@dataclass(frozen=True, slots=True)
class Spur:
    """An unwanted line of the force, and the third channel it falls nearest to (None: there is none)."""

    channels: tuple[int, int]
    kind: str
    force_hz: float
    force_mn: float
    near_channel: int | None
    offset_hz: float | None


@dataclass(frozen=True, slots=True)
class State:
    """One state of a coil: `state` has a 1 for every channel that is on, channel 0 first."""

    state: str
    drive_hz: tuple[float, ...]
    lines: tuple[Line, ...]
    spurs: tuple[Spur, ...]
    static_force_mn: float


def coil_states(plan: Plan) -> tuple[State, ...]:
    """All states of one coil, channel 0 changing slowest; empty above `LARGEST_TABLE` channels."""
    if len(plan.channels) > LARGEST_TABLE:
        return ()
    return tuple(_state(plan.channels, bits) for bits in product((0, 1), repeat=len(plan.channels)))


def _state(channels: tuple[Channel, ...], bits: tuple[int, ...]) -> State:
    on = [c for c, bit in zip(channels, bits, strict=True) if bit]
    return State(
        state="".join(str(bit) for bit in bits),
        drive_hz=tuple(c.drive_hz for c in on),
        lines=tuple(Line(c.index, 2 * c.drive_hz, c.force_mn) for c in on),
        spurs=tuple(spur for a, b in combinations(on, 2) for spur in _spurs(channels, a, b)),
        static_force_mn=sum(c.force_mn for c in on),
    )


def _spurs(channels: tuple[Channel, ...], a: Channel, b: Channel) -> list[Spur]:
    force = 2 * (a.force_mn * b.force_mn) ** 0.5
    thirds = [c for c in channels if c.index not in (a.index, b.index)]
    spurs = []
    for kind, hz in (("sum", a.drive_hz + b.drive_hz), ("difference", abs(a.drive_hz - b.drive_hz))):
        near = min(thirds, key=lambda c: abs(c.resonance_hz - hz), default=None)
        spurs.append(
            Spur(
                (a.index, b.index),
                kind,
                hz,
                force,
                near.index if near else None,
                hz - near.resonance_hz if near else None,
            )
        )
    return spurs
