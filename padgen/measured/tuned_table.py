"""The drive table of a print: `drive.csv`'s columns, a row for every taxel, and what was measured beside it."""

from dataclasses import astuple, dataclass
from typing import NamedTuple

from padgen.measured.predict import printed_channels
from padgen.measured.tuning import Tuning
from padgen.planner.drive_rows import COLUMNS, DriveRow, bias_row, coil_rows, table_csv
from padgen.planner.plan import Plan
from padgen.planner.printed_pads import coils_of

__all__ = ["MeasuredRow", "TunedRow", "measured_rows", "tuned_drive_csv", "tuned_rows"]


class TunedRow(NamedTuple):
    """A taxel's row, or that of the constant part of a coil's current, where `taxel` is the coil's name."""

    taxel: str
    drive: DriveRow


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
    spec, channels = plan.spec, printed_channels(plan, tuning)
    scheme = plan.scheme
    rows: dict[int, TunedRow] = {}
    constant = []
    for (row, column), index in sorted(coils_of(plan).items()):
        own = [channels[i] for i in index]
        for i, found in zip(index, coil_rows(spec, scheme, own), strict=True):
            rows[i] = TunedRow(plan.taxels[i].id, found)
        if scheme.has_constant:
            constant.append(TunedRow(f"r{row}c{column}", bias_row(spec, scheme, own)))
    return (*(rows[i] for i in range(len(plan.taxels))), *constant)


def tuned_drive_csv(plan: Plan, tuning: Tuning) -> str:
    """The table as CSV."""
    return table_csv(("taxel", *COLUMNS), ((row.taxel, *astuple(row.drive)) for row in tuned_rows(plan, tuning)))


def measured_rows(plan: Plan, tuning: Tuning) -> tuple[MeasuredRow, ...]:
    """A row per taxel in the plan's order, for people to read."""
    channels = printed_channels(plan, tuning)
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
            row.drive.drive_hz,
            channel.line_a2,
            row.drive.current_ma_peak,
            row.drive.voltage_v_peak,
            channel.level_um,
            tuned.measured,
            tuned.level_measured,
        )
        for taxel, tuned, row, channel in zip(
            plan.taxels, tuning.taxels, tuned_rows(plan, tuning), channels, strict=False
        )
    )
