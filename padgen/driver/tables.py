"""The driver frequency table: what each channel's line of the current must be, as CSV and JSON."""

import cmath
import csv
import io
from dataclasses import asdict, dataclass, fields
from math import degrees, inf, sqrt
from typing import Any

import numpy as np

from padgen.driver.frames import taxel_grid
from padgen.driver.states import LARGEST_TABLE, coil_states
from padgen.errors import number
from padgen.files import json_text
from padgen.physics.currents import bias_a, current_lines_a, mean_square_a2, root_voltage_v
from padgen.physics.magnetics import impedance
from padgen.physics.selectivity import Scheme
from padgen.planner.channels import squared_current_lines
from padgen.planner.frame_rates import slot_ms
from padgen.planner.plan import Channel, Plan
from padgen.planner.settings import scheme_named
from padgen.units import MA, MH, MN

__all__ = ["DriveRow", "drive_csv", "drive_json", "drive_rows"]

BIAS = "bias"


@dataclass(frozen=True, slots=True)
class DriveRow:
    """One channel of the table, or the row of the constant part (channel 'bias', at 0 Hz).

    Amplitudes are peaks, the phase is the voltage's over the current's. The bias row's current is the
    constant one, biased, and the root of the constant part of i², spur-free; its force is the mean
    pull on the washer of channel 0.
    """

    channel: int | str
    resonance_hz: float
    drive_hz: float
    force_mn: float
    current_ma_peak: float
    voltage_v_peak: float
    impedance_ohm: float
    phase_deg: float
    ring_up_ms: float


def drive_rows(plan: Plan) -> tuple[DriveRow, ...]:
    """The table: a row per channel and, where the current has a constant part, its row.

    A plain tone of I at f pulls with c I²/2 at 2f; beside a constant current B one of b at r pulls with
    2 c B b at r; spur-free, the current's peak with this channel alone on is given. A washer that the
    coil does not pull has an infinite current; the plan's findings say so.
    """
    scheme = scheme_named(plan.typed_spec, plan.selectivity.drive)
    rows: dict[int, DriveRow] = {}
    constant: list[DriveRow] = []
    for kind, own in enumerate(plan.sets):
        current = current_lines_a(scheme, squared_current_lines(own), plan.typed_spec.drive.headroom)
        rows |= {c.index: _row(plan, scheme, c, float(i)) for c, i in zip(own, current, strict=True)}
        if scheme.has_constant:
            constant.append(_bias_row(plan, scheme, kind))
    return (*(rows[c.index] for c in plan.channels), *constant)


def _row(plan: Plan, scheme: Scheme, channel: Channel, current_a: float) -> DriveRow:
    coil = plan.typed_spec.coil
    z = complex(impedance(coil.resistance_ohm, coil.inductance_mh * MH, channel.drive_hz))
    if channel.force_constant_n_per_a2 <= 0:
        current_a = volts = inf
    elif scheme.name == "spur-free":
        line = channel.force_mn * MN / channel.force_constant_n_per_a2
        volts = root_voltage_v(
            line, channel.resonance_hz, coil.resistance_ohm, coil.inductance_mh * MH, plan.typed_spec.drive.headroom
        )
    else:
        volts = current_a * abs(z)
    return DriveRow(
        channel.index,
        channel.resonance_hz,
        channel.drive_hz,
        channel.force_mn,
        current_a / MA,
        volts,
        abs(z),
        degrees(cmath.phase(z)),
        channel.ring_up_ms,
    )


def _bias_row(plan: Plan, scheme: Scheme, kind: int) -> DriveRow:
    own, resistance = plan.sets[kind], plan.typed_spec.coil.resistance_ohm
    lines = squared_current_lines(own)
    square = mean_square_a2(scheme, lines, plan.typed_spec.drive.headroom)
    constant = bias_a(scheme, lines) if scheme.name == "biased" else sqrt(square)
    static_mn = square * own[0].force_constant_n_per_a2 / MN
    name = BIAS if len(plan.sets) == 1 else f"{BIAS} of set {kind}"
    return DriveRow(name, 0.0, 0.0, static_mn, constant / MA, constant * resistance, resistance, 0.0, 0.0)


def drive_csv(plan: Plan) -> str:
    """The table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f.name for f in fields(DriveRow)])
    for row in drive_rows(plan):
        writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in asdict(row).values()])
    return text.getvalue()


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
    scheme, own = scheme_named(plan.typed_spec, plan.selectivity.drive), plan.sets[kind]
    lines, headroom = squared_current_lines(own), plan.typed_spec.drive.headroom
    recipe: dict[str, Any] = {"channels": [c.index for c in own], "squared_lines_a2": lines.tolist()}
    tones_a = current_lines_a(scheme, lines).tolist()
    if scheme.name == "spur-free":
        recipe["formula"] = "i(t) = sqrt(a0 + sum over ON channels of a_j cos(2 pi resonance_hz_j t))"
        recipe["a0"] = f"{1 + headroom:g} times the sum of a_j over the ON channels"
        recipe["a0_all_on_a2"] = mean_square_a2(scheme, lines, headroom)
    elif scheme.name == "biased":
        recipe["formula"] = "i(t) = B + sum over ON channels of b_j sin(2 pi resonance_hz_j t)"
        recipe["bias_a"] = bias_a(scheme, lines)
        recipe["bias_note"] = "B flows in every state, with all channels OFF too"
        recipe["b_a"] = tones_a
    elif scheme.takes_turns:
        recipe["formula"] = "i(t) = I_j sin(2 pi drive_hz_j t) in the slot of each ON channel j, one after the other"
        recipe["slot_ms"] = slot_ms(plan.channels, plan.coils.sets)
        recipe["ramp_ms"] = slot_ms(plan.channels, plan.coils.sets) / 2
        recipe["I_a"] = tones_a
    else:
        recipe["I_a"] = tones_a
        recipe["formula"] = "i(t) = sum over ON channels of I_j sin(2 pi drive_hz_j t)"
    return recipe
