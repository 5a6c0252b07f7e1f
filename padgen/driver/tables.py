"""The driver table: what each channel's line of the current must be, and every on/off state of one coil; CSV and JSON.

A coil pulls with the square of its current (paper Eq. 5); what lines that makes is the drive
scheme's doing, see `padgen.physics.selectivity`.
"""

from dataclasses import asdict, astuple, dataclass
from itertools import combinations, product
from math import sqrt
from typing import Any

import numpy as np

from padgen.core.errors import number
from padgen.core.files import json_text
from padgen.core.units import MN
from padgen.driver.frames import LARGEST_TABLE, taxel_grid
from padgen.physics.currents import bias_a, current_lines_a, formula, mean_square_a2
from padgen.physics.selectivity import Scheme
from padgen.planner.drive_rows import BIAS, COLUMNS, DriveRow, bias_row, coil_rows, table_csv
from padgen.planner.frame_rates import slot_ms
from padgen.planner.plan import Channel, Plan

__all__ = ["Line", "Spur", "State", "coil_states", "drive_csv", "drive_json", "drive_rows"]

SMALLEST_LINE = 1e-300
"""In A²: a coil that pulls no washer has none."""


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


def drive_rows(plan: Plan) -> tuple[DriveRow, ...]:
    """The table: a row per channel and, where the current has a constant part, its row."""
    spec = plan.spec
    scheme = plan.scheme
    rows: dict[int | str, DriveRow] = {}
    constant: list[DriveRow] = []
    for kind, own in enumerate(plan.sets):
        rows |= {row.channel: row for row in coil_rows(spec, scheme, own)}
        if scheme.has_constant:
            constant.append(bias_row(spec, scheme, own, BIAS if len(plan.sets) == 1 else f"{BIAS} of set {kind}"))
    return (*(rows[c.index] for c in plan.channels), *constant)


def drive_csv(plan: Plan) -> str:
    """The table as CSV."""
    return table_csv(COLUMNS, (astuple(row) for row in drive_rows(plan)))


def drive_json(plan: Plan) -> str:
    """The table, the recipe of the current, the states of one coil (up to six channels), where the coils
    lie and which taxel is which.

    A pixel is [row, column] of an image of the pad, from its top left. Places are from the pad's centre, x to the
    right and y upwards seen from the touch side.
    """
    grid = taxel_grid(plan)
    pixels = {int(grid[row, column]): [int(row), int(column)] for row, column in np.argwhere(grid >= 0)}
    table = {
        "name": plan.name,
        "scheme": plan.selectivity.drive,
        "current": [_recipe(plan, kind) for kind in range(len(plan.sets))],
        "channels": [asdict(row) for row in drive_rows(plan)],
        "frames_per_s": {f.scheme: f.frames_per_s for f in plan.refresh}[plan.selectivity.drive],
        "states": [asdict(state) for state in coil_states(plan)],
        "states_note": ""
        if len(plan.sets[0]) <= LARGEST_TABLE
        else f"{number(2 ** len(plan.sets[0]))} states are not spelled out; at most {LARGEST_TABLE} channels are",
        "coils": [
            {
                "coil": [row, column],
                "set": (row + column) % len(plan.sets),
                "x_mm": (column - (plan.coils.columns - 1) / 2) * plan.coils.pitch_x_mm,
                "y_mm": (row - (plan.coils.rows - 1) / 2) * plan.coils.pitch_y_mm,
            }
            for row in range(plan.coils.rows)
            for column in range(plan.coils.columns)
        ],
        "taxels": [
            {
                "id": t.id,
                "coil": list(t.coil),
                "channel": t.channel,
                "x_mm": t.x_mm,
                "y_mm": t.y_mm,
                "pixel": pixels[index],
            }
            for index, t in enumerate(plan.taxels)
        ],
    }
    return json_text(table)


def _recipe(plan: Plan, kind: int) -> dict[str, Any]:
    """What the current of a coil of set `kind` is made of, as a formula and its numbers in A and A²."""
    scheme, own = plan.scheme, plan.sets[kind]
    lines, headroom = np.array([c.line_a2 for c in own]), plan.spec.drive.headroom
    recipe: dict[str, Any] = {
        "channels": [c.index for c in own],
        "squared_lines_a2": lines.tolist(),
        "formula": formula(scheme),
    }
    tones_a = current_lines_a(scheme, lines).tolist()
    if scheme.is_root:
        recipe["a0"] = f"{1 + headroom:g} times the sum of a_j over the ON channels"
        recipe["a0_all_on_a2"] = mean_square_a2(scheme, lines, headroom)
    elif scheme.is_biased:
        recipe["bias_a"] = bias_a(scheme, lines)
        recipe["bias_note"] = "B flows in every state, with all channels OFF too"
        recipe["b_a"] = tones_a
    else:
        recipe["I_a"] = tones_a
    if scheme.takes_turns:
        recipe["slot_ms"] = slot_ms(plan.channels, plan.coils.sets)
        recipe["ramp_ms"] = slot_ms(plan.channels, plan.coils.sets) / 2
    return recipe
