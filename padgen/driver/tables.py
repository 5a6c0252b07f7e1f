"""The driver frequency table: what each channel's tone must be, as CSV and JSON."""

import cmath
import csv
import io
from dataclasses import asdict, dataclass, fields
from math import degrees, inf, sqrt

from padgen.driver.tones import LARGEST_TABLE, coil_states
from padgen.errors import number
from padgen.files import json_text
from padgen.physics.magnetics import impedance
from padgen.planner.plan import Plan
from padgen.units import MA, MH, MN

__all__ = ["DriveRow", "drive_csv", "drive_json", "drive_rows"]


@dataclass(frozen=True, slots=True)
class DriveRow:
    """One channel of the table; amplitudes are peaks, the phase is the voltage's over the current's."""

    channel: int
    resonance_hz: float
    drive_hz: float
    force_mn: float
    current_ma_peak: float
    voltage_v_peak: float
    impedance_ohm: float
    phase_deg: float
    ring_up_ms: float


def drive_rows(plan: Plan) -> tuple[DriveRow, ...]:
    """The table for plain tones (paper Eq. 5): a tone of I at f pulls with c I²/2 at 2f.

    A washer that the coil does not pull has an infinite current; the plan's findings say so.
    """
    coil = plan.typed_spec.coil
    rows = []
    for channel in plan.channels:
        pull = channel.force_constant_n_per_a2
        current_a = sqrt(2 * channel.force_mn * MN / pull) if pull > 0 else inf
        z = complex(impedance(coil.resistance_ohm, coil.inductance_mh * MH, channel.drive_hz))
        rows.append(
            DriveRow(
                channel.index,
                channel.resonance_hz,
                channel.drive_hz,
                channel.force_mn,
                current_a / MA,
                current_a * abs(z),
                abs(z),
                degrees(cmath.phase(z)),
                channel.ring_up_ms,
            )
        )
    return tuple(rows)


def drive_csv(plan: Plan) -> str:
    """The table as CSV, one row per channel."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f.name for f in fields(DriveRow)])
    for row in drive_rows(plan):
        writer.writerow([value if isinstance(value, int) else f"{value:.6g}" for value in asdict(row).values()])
    return text.getvalue()


def drive_json(plan: Plan) -> str:
    """The table, the states of one coil (up to six channels), where the coils lie and which taxel is which.

    Places are from the pad's centre, x to the right and y upwards seen from the touch side.
    """
    table = {
        "name": plan.name,
        "scheme": plan.selectivity.drive,
        "channels": [asdict(row) for row in drive_rows(plan)],
        "states": [asdict(state) for state in coil_states(plan)],
        "states_note": ""
        if len(plan.channels) <= LARGEST_TABLE
        else f"{number(2 ** len(plan.channels))} states are not spelled out; at most {LARGEST_TABLE} channels are",
        "coils": [
            {
                "coil": [row, column],
                "x_mm": (column - (plan.coils.columns - 1) / 2) * plan.coils.pitch_x_mm,
                "y_mm": (row - (plan.coils.rows - 1) / 2) * plan.coils.pitch_y_mm,
            }
            for row in range(plan.coils.rows)
            for column in range(plan.coils.columns)
        ],
        "taxels": [{"id": t.id, "coil": list(t.coil), "channel": t.channel} for t in plan.taxels],
    }
    return json_text(table)
