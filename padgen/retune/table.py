"""The drive table of a print: `drive.csv`'s columns, a row for every taxel, and what was measured beside it."""

import cmath
import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from math import degrees, inf, sqrt

import numpy as np

from padgen.physics.currents import bias_a, current_lines_a, mean_square_a2, root_voltage_v
from padgen.physics.magnetics import impedance
from padgen.physics.selectivity import Scheme
from padgen.planner.channels import squared_current_lines
from padgen.planner.plan import Channel, Plan
from padgen.planner.printed_pads import coils_of
from padgen.planner.settings import scheme_named
from padgen.retune.predict import printed_channels
from padgen.retune.tuning import Tuning
from padgen.units import MA, MH, MN

__all__ = ["MeasuredRow", "TunedRow", "measured_rows", "tuned_drive_csv", "tuned_rows"]

BIAS = "bias"


@dataclass(frozen=True, slots=True)
class TunedRow:
    """A taxel of the table, or the constant part of a coil's current (taxel the coil's, channel 'bias').

    As `padgen.driver.tables.DriveRow`; the bias row's force is the mean pull on the washer of the lowest channel.
    """

    taxel: str
    channel: int | str
    resonance_hz: float
    drive_hz: float
    force_mn: float
    current_ma_peak: float
    voltage_v_peak: float
    impedance_ohm: float
    phase_deg: float
    ring_up_ms: float


@dataclass(frozen=True, slots=True)
class MeasuredRow:
    """What was measured of a taxel, `_error` one sigma, and the tone that it gets.

    `planned_hz` is the plan's resonance, `line_a2` the line of i², `level_um` the ON amplitude. `measured` and
    `level_measured` tell what of it was measured; the rest is the plan's.
    """

    taxel: str
    row: int
    column: int
    channel: int
    planned_hz: float
    resonance_hz: float
    resonance_error_hz: float
    q: float
    q_error: float
    response_um_per_a2: float
    response_error: float
    drive_hz: float
    line_a2: float
    current_ma_peak: float
    voltage_v_peak: float
    level_um: float
    measured: bool
    level_measured: bool


def tuned_rows(plan: Plan, tuning: Tuning) -> tuple[TunedRow, ...]:
    """The table: a row per taxel in the plan's order and, where the current has a constant part, one per coil."""
    scheme, channels = scheme_named(plan.typed_spec, plan.selectivity.drive), printed_channels(plan, tuning)
    rows: dict[int, TunedRow] = {}
    constant = []
    for place, index in sorted(coils_of(plan).items()):
        own = [channels[i] for i in index]
        current = current_lines_a(scheme, squared_current_lines(own), plan.typed_spec.drive.headroom)
        for i, channel, amplitude in zip(index, own, current, strict=True):
            rows[i] = _row(plan, scheme, plan.taxels[i].id, channel, float(amplitude))
        if scheme.has_constant:
            constant.append(_bias_row(plan, scheme, place, own))
    return (*(rows[i] for i in range(len(plan.taxels))), *constant)


def _row(plan: Plan, scheme: Scheme, taxel: str, channel: Channel, current_a: float) -> TunedRow:
    coil = plan.typed_spec.coil
    z = complex(impedance(coil.resistance_ohm, coil.inductance_mh * MH, channel.drive_hz))
    volts = current_a * abs(z)
    if channel.force_constant_n_per_a2 <= 0:
        current_a = volts = inf
    elif scheme.name == "spur-free":
        line, headroom = float(squared_current_lines([channel])[0]), plan.typed_spec.drive.headroom
        volts = root_voltage_v(line, channel.resonance_hz, coil.resistance_ohm, coil.inductance_mh * MH, headroom)
    return TunedRow(
        taxel,
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


def _bias_row(plan: Plan, scheme: Scheme, place: tuple[int, int], own: Sequence[Channel]) -> TunedRow:
    lines, resistance = squared_current_lines(own), plan.typed_spec.coil.resistance_ohm
    square = mean_square_a2(scheme, lines, plan.typed_spec.drive.headroom)
    constant = bias_a(scheme, lines) if scheme.name == "biased" else sqrt(square)
    static_mn = square * own[0].force_constant_n_per_a2 / MN
    name = f"r{place[0]}c{place[1]}"
    return TunedRow(name, BIAS, 0.0, 0.0, static_mn, constant / MA, constant * resistance, resistance, 0.0, 0.0)


def tuned_drive_csv(plan: Plan, tuning: Tuning) -> str:
    """The table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f.name for f in fields(TunedRow)])
    for row in tuned_rows(plan, tuning):
        writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in asdict(row).values()])
    return text.getvalue()


def measured_rows(plan: Plan, tuning: Tuning) -> tuple[MeasuredRow, ...]:
    """A row per taxel in the plan's order, for people to read."""
    channels = printed_channels(plan, tuning)
    line = [float(np.squeeze(squared_current_lines([channel]))) for channel in channels]
    return tuple(
        MeasuredRow(
            taxel.id,
            *taxel.coil,
            taxel.channel,
            plan.channels[taxel.channel].resonance_hz,
            tuned.resonance_hz,
            tuned.resonance_error_hz,
            tuned.q,
            tuned.q_error,
            tuned.response_um_per_a2,
            tuned.response_error,
            row.drive_hz,
            amplitude,
            row.current_ma_peak,
            row.voltage_v_peak,
            channel.level_um,
            tuned.measured,
            tuned.level_measured,
        )
        for taxel, tuned, row, amplitude, channel in zip(
            plan.taxels, tuning.taxels, tuned_rows(plan, tuning), line, channels, strict=False
        )
    )
