"""The on/off states of one coil: what is driven, what vibrates, what spurs fall where.

A coil pulls with the square of its current (paper Eq. 5); what lines that makes is the drive
scheme's doing, see `padgen.physics.selectivity`.
"""

from dataclasses import dataclass
from itertools import combinations, product
from math import sqrt

import numpy as np

from padgen.core.units import MN
from padgen.physics.currents import mean_square_a2
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import Channel, Plan

__all__ = ["LARGEST_TABLE", "Line", "Spur", "State", "coil_states"]

SMALLEST_LINE = 1e-300
"""In A²: a coil that pulls no washer has none."""
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
    """An unwanted line of the force, and the third channel it falls nearest to (None: there is none).

    `force_mn` is on a washer that is pulled like those of its own channels (their geometric mean).
    """

    channels: tuple[int, ...]
    kind: str
    force_hz: float
    force_mn: float
    near_channel: int | None
    offset_hz: float | None


@dataclass(frozen=True, slots=True)
class State:
    """One state of a coil: `state` has a 1 for every channel that is on, the lowest first.

    `set` says of which coils, see `CoilGrid`; `static_force_mn` is the mean pull on the lowest channel's
    washer.
    """

    set: int
    state: str
    drive_hz: tuple[float, ...]
    lines: tuple[Line, ...]
    spurs: tuple[Spur, ...]
    static_force_mn: float


def coil_states(plan: Plan) -> tuple[State, ...]:
    """All states of a coil of each set, the lowest channel changing slowest; empty above `LARGEST_TABLE` channels."""
    if len(plan.sets[0]) > LARGEST_TABLE:
        return ()
    scheme = plan.scheme
    return tuple(
        _state(plan, scheme, number, bits)
        for number, own in enumerate(plan.sets)
        for bits in product((0, 1), repeat=len(own))
    )


def _state(plan: Plan, scheme: Scheme, number: int, bits: tuple[int, ...]) -> State:
    own = plan.sets[number]
    on = [c for c, bit in zip(own, bits, strict=True) if bit]
    return State(
        set=number,
        state="".join(str(bit) for bit in bits),
        drive_hz=tuple(c.drive_hz for c in on),
        lines=tuple(Line(c.index, c.resonance_hz, c.force_mn) for c in on),
        spurs=tuple(_spurs(scheme, own, on)),
        static_force_mn=_static_force_mn(plan, scheme, own, bits),
    )


def _static_force_mn(plan: Plan, scheme: Scheme, own: tuple[Channel, ...], bits: tuple[int, ...]) -> float:
    lines, on = np.array([c.line_a2 for c in own]), np.array(bits, dtype=bool)
    square_a2 = mean_square_a2(scheme, lines, plan.spec.drive.headroom, on)
    return square_a2 * own[0].force_constant_n_per_a2 / MN


def _spurs(scheme: Scheme, own: tuple[Channel, ...], on: list[Channel]) -> list[Spur]:
    if not scheme.has_pair_spurs:
        return []
    lines = {channel.index: channel.line_a2 for channel in own}
    largest = max(*lines.values(), SMALLEST_LINE)
    spurs = []
    for a, b in combinations(on, 2):
        total, difference = a.resonance_hz + b.resonance_hz, abs(a.resonance_hz - b.resonance_hz)
        force = 2 * sqrt(a.force_mn * b.force_mn)
        total, difference = total * scheme.pair_scale, difference * scheme.pair_scale
        if scheme.is_biased:
            force *= sqrt(lines[a.index] * lines[b.index]) / (4 * scheme.bias_ratio * largest)
        spurs.append(_spur(own, (a.index, b.index), "sum", total, force))
        spurs.append(_spur(own, (a.index, b.index), "difference", difference, force))
    if scheme.is_biased:
        for c in on:
            force = c.force_mn * lines[c.index] / (4 * scheme.bias_ratio * largest)
            spurs.append(_spur(own, (c.index,), "harmonic", 2 * c.resonance_hz, force))
    return spurs


def _spur(own: tuple[Channel, ...], which: tuple[int, ...], kind: str, hz: float, force_mn: float) -> Spur:
    thirds = [c for c in own if c.index not in which]
    near = min(thirds, key=lambda c: abs(c.resonance_hz - hz), default=None)
    return Spur(which, kind, hz, force_mn, near.index if near else None, hz - near.resonance_hz if near else None)
