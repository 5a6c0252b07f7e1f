"""The driver frequency table: what each channel's line of the current must be, as CSV and JSON."""

from dataclasses import asdict, astuple
from typing import Any

import numpy as np

from padgen.core.errors import number
from padgen.core.files import json_text
from padgen.driver.frames import taxel_grid
from padgen.driver.states import LARGEST_TABLE, coil_states
from padgen.physics.currents import bias_a, current_lines_a, formula, mean_square_a2
from padgen.planner.drive_rows import BIAS, COLUMNS, DriveRow, bias_row, coil_rows, table_csv
from padgen.planner.frame_rates import slot_ms
from padgen.planner.plan import Plan

__all__ = ["drive_csv", "drive_json", "drive_rows"]


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
