"""The on/off states of one coil: what is driven, what vibrates, what spurs fall where.

A coil pulls with the square of its current (paper Eq. 5); what lines that makes is the drive
scheme's doing, see `padgen.physics.selectivity`.
"""

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from padgen.physics.currents import mean_square_a2
from padgen.physics.selectivity import Scheme
from padgen.planner.channels import squared_current_lines
from padgen.planner.plan import Channel, Plan
from padgen.planner.selectivity import scheme_named
from padgen.units import MN

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
    """One state of a coil: `state` has a 1 for every channel that is on, channel 0 first.

    `static_force_mn` is the mean pull on the washer of channel 0.
    """

    state: str
    drive_hz: tuple[float, ...]
    lines: tuple[Line, ...]
    spurs: tuple[Spur, ...]
    static_force_mn: float


def coil_states(plan: Plan) -> tuple[State, ...]:
    """All states of one coil, channel 0 changing slowest; empty above `LARGEST_TABLE` channels."""
    if len(plan.channels) > LARGEST_TABLE:
        return ()
    scheme = scheme_named(plan.typed_spec, plan.selectivity.drive)
    return tuple(_state(plan, scheme, bits) for bits in product((0, 1), repeat=len(plan.channels)))


def _state(plan: Plan, scheme: Scheme, bits: tuple[int, ...]) -> State:
    on = [c for c, bit in zip(plan.channels, bits, strict=True) if bit]
    return State(
        state="".join(str(bit) for bit in bits),
        drive_hz=tuple(c.drive_hz for c in on),
        lines=tuple(Line(c.index, c.resonance_hz, c.force_mn) for c in on),
        spurs=tuple(_spurs(plan, scheme, on)),
        static_force_mn=_static_force_mn(plan, scheme, on),
    )


def _static_force_mn(plan: Plan, scheme: Scheme, on: list[Channel]) -> float:
    """Biased, the constant current stays on, as for all channels, whatever is off."""
    lines = squared_current_lines(plan.channels)
    playing = np.isin([c.index for c in plan.channels], [c.index for c in on])
    if not on and scheme.name != "biased":
        return 0.0
    if scheme.name == "biased":
        bias2 = scheme.bias_ratio * lines.max() / 2
        square = float(bias2 + ((lines * playing) ** 2).sum() / (8 * bias2)) if bias2 else 0.0
    else:
        square = mean_square_a2(scheme, lines[playing], plan.typed_spec.drive.headroom)
    return square * plan.channels[0].force_constant_n_per_a2 / MN


def _spurs(plan: Plan, scheme: Scheme, on: list[Channel]) -> list[Spur]:
    if scheme.name not in ("tones", "biased"):
        return []
    spurs = []
    half = scheme.name == "tones"
    # Of i², the spur's line over the square root of the product of its channels' lines.
    largest = float(squared_current_lines(plan.channels).max())
    for a, b in combinations(on, 2):
        force = 2 * (a.force_mn * b.force_mn) ** 0.5
        if not half:
            force *= _root_of_lines(plan, a, b) / (4 * scheme.bias_ratio * largest) if largest else 0.0
        total, difference = a.resonance_hz + b.resonance_hz, abs(a.resonance_hz - b.resonance_hz)
        scale = 0.5 if half else 1.0
        spurs.append(_spur(plan, (a.index, b.index), "sum", total * scale, force))
        spurs.append(_spur(plan, (a.index, b.index), "difference", difference * scale, force))
    if not half:
        for c in on:
            force = c.force_mn * _root_of_lines(plan, c, c) / (4 * scheme.bias_ratio * largest) if largest else 0.0
            spurs.append(_spur(plan, (c.index,), "harmonic", 2 * c.resonance_hz, force))
    return spurs


def _root_of_lines(plan: Plan, a: Channel, b: Channel) -> float:
    lines = squared_current_lines(plan.channels)
    return float(np.sqrt(lines[a.index] * lines[b.index]))


def _spur(plan: Plan, which: tuple[int, ...], kind: str, hz: float, force_mn: float) -> Spur:
    thirds = [c for c in plan.channels if c.index not in which]
    near = min(thirds, key=lambda c: abs(c.resonance_hz - hz), default=None)
    return Spur(which, kind, hz, force_mn, near.index if near else None, hz - near.resonance_hz if near else None)
