"""The driver frequency table as JSON, with the current's formula, a coil's on/off states, and coil and taxel places."""

from collections.abc import Iterator
from dataclasses import asdict
from itertools import combinations, product
from math import sqrt
from typing import Any

import numpy as np

from padgen.core.errors import number
from padgen.core.files import OutputFolder, json_text
from padgen.core.units import MN
from padgen.driver.formats import DriveJob
from padgen.driver.formats.csv import drive_rows, planned_carrier_hz
from padgen.driver.frames import LARGEST_TABLE, taxel_grid
from padgen.physics.schemes import bias_a, current_lines_a, formula, mean_pull_line, mean_square_a2
from padgen.physics.selectivity import SQUARE, Scheme
from padgen.planner.drive_scheme import slot_ms
from padgen.planner.plan import Channel, Plan
from padgen.planner.touched_prints import played_plan

__all__ = ["FILE", "MADE_OF", "ORDER", "coil_states", "drive_json", "write"]

ORDER = 1
MADE_OF = "plan"
FILE = "drive.json"
SMALLEST_LINE = 1e-300
"""In A²: a coil that pulls no washer has none."""


def write(out: OutputFolder, job: DriveJob) -> None:
    """Write `drive.json`, and `drive-warm.json` where the warm pad is driven."""
    out.write(FILE, drive_json(job.plan))
    if job.request.warm:
        from padgen.measured.tuning import warm_plan

        out.write("drive-warm.json", drive_json(warm_plan(job.plan)))


def coil_states(plan: Plan) -> list[dict[str, Any]]:
    """Return tones, forces and spurs of each on/off state of a coil; none for more channels than `LARGEST_TABLE`.

    The lowest channel changes slowest.

    `set` says of which coils (see `CoilGrid`), `state` has a 1 for every channel that is on, the lowest first. `lines`
    of the force are wanted, `spurs` are not: their force is on a washer that is pulled like those of their own channels
    (their geometric mean), and they fall nearest to a third channel (None: there is none). `static_force_mn` is the
    mean pull on the lowest channel's washer.
    """
    states: list[dict[str, Any]] = []
    for number_of, channel_set in enumerate(plan.sets if len(plan.sets[0]) <= LARGEST_TABLE else ()):
        lines = np.array([c.line_a2 for c in channel_set])
        for bits in product((0, 1), repeat=len(channel_set)):
            on = [c for c, bit in zip(channel_set, bits, strict=True) if bit]
            pulling = mean_pull_line(plan.scheme, lines, plan.spec.drive.headroom, np.array(bits, dtype=bool))
            states.append(
                {
                    "set": number_of,
                    "state": "".join(map(str, bits)),
                    "drive_hz": [c.drive_hz for c in on],
                    "lines": [{"channel": c.index, "force_hz": c.resonance_hz, "force_mn": c.force_mn} for c in on],
                    "spurs": list(_spurs(plan.scheme, channel_set, on)) if plan.scheme.has_pair_spurs else [],
                    "static_force_mn": pulling * channel_set[0].force_constant_n_per_a2 / MN,
                }
            )
    return states


def _spurs(scheme: Scheme, channel_set: tuple[Channel, ...], on: list[Channel]) -> Iterator[dict[str, Any]]:
    scale = 4 * scheme.bias_ratio * max(*(c.line_a2 for c in channel_set), SMALLEST_LINE)

    def spur(kind: str, hz: float, force_mn: float, *which: int) -> dict[str, Any]:
        thirds = [c for c in channel_set if c.index not in which]
        near = min(thirds, key=lambda c: abs(c.resonance_hz - hz), default=None)
        return {
            "channels": list(which),
            "kind": kind,
            "force_hz": hz,
            "force_mn": force_mn,
            "near_channel": near.index if near else None,
            "offset_hz": hz - near.resonance_hz if near else None,
        }

    for a, b in combinations(on, 2):
        force_mn = 2 * sqrt(a.force_mn * b.force_mn)
        if scheme.is_biased:
            force_mn *= sqrt(a.line_a2 * b.line_a2) / scale
        yield spur("sum", (a.resonance_hz + b.resonance_hz) * scheme.pair_scale, force_mn, a.index, b.index)
        yield spur("difference", abs(a.resonance_hz - b.resonance_hz) * scheme.pair_scale, force_mn, a.index, b.index)
    for c in on if scheme.is_biased else ():
        yield spur("harmonic", 2 * c.resonance_hz, c.force_mn * c.line_a2 / scale, c.index)


def drive_json(plan: Plan) -> str:
    """Return the driver table as JSON, with the current's formula, a coil's states, places of coils and taxels.

    States of more than six channels are left out. A pixel is [row, column] of an image of the pad, from its top left.
    Places are from the pad's centre, x to the right and y upwards seen from the touch side.
    """
    plan = played_plan(plan)
    grid = taxel_grid(plan)
    pixels = {int(grid[row, column]): [int(row), int(column)] for row, column in np.argwhere(grid >= 0)}
    table = {
        "name": plan.name,
        "scheme": plan.selectivity.drive,
        "current": [_recipe(plan, kind) for kind in range(len(plan.sets))],
        "channels": [asdict(row) for row in drive_rows(plan)],
        "frames_per_s": {f.scheme: f.frames_per_s for f in plan.refresh}[plan.selectivity.drive],
        "states": coil_states(plan),
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
    """Return the formula of the current in a coil of channel set `kind`, with its amplitudes in A and A²."""
    scheme = plan.scheme
    channel_set = plan.sets[kind]
    lines = np.array([c.line_a2 for c in channel_set])
    headroom = plan.spec.drive.headroom
    recipe: dict[str, Any] = {
        "channels": [c.index for c in channel_set],
        "formula": formula(scheme),
    }
    if scheme.force_order == SQUARE:
        recipe["squared_lines_a2"] = lines.tolist()
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
    if carrier := planned_carrier_hz(plan):
        recipe["carrier_hz"] = carrier
        recipe["formula"] += ", times sqrt(2) cos(2 pi carrier_hz t)"
    if scheme.takes_turns:
        recipe["slot_ms"] = slot_ms(plan.channels, plan.coils.sets)
        recipe["ramp_ms"] = slot_ms(plan.channels, plan.coils.sets) / 2
    return recipe
