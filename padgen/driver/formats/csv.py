"""The driver frequency table as CSV: for each channel its frequencies, force, peak current, voltage and impedance.

A coil pulls with the square of its current (paper Eq. 5); what lines that makes is the drive
scheme's doing, see `padgen.physics.selectivity`. Beside it are the table of the warm pad, where that is driven, and
with a tuning the table of the print as measured, warm where the pad is.
"""

from dataclasses import astuple

from padgen.core.files import OutputFolder
from padgen.driver.formats import DriveJob
from padgen.planner.drive_rows import BIAS, COLUMNS, DriveRow, bias_row, coil_rows, table_csv
from padgen.planner.plan import Plan, carrier_hz
from padgen.planner.touched_prints import played_plan

__all__ = ["FILE", "MADE_OF", "ORDER", "drive_csv", "drive_rows", "planned_carrier_hz", "write"]

ORDER = 0
MADE_OF = "plan"
FILE = "drive.csv"


def write(out: OutputFolder, job: DriveJob) -> None:
    """Write `drive.csv`, and the tables of the warm pad and of the measured print where the drive is for these."""
    out.write(FILE, drive_csv(job.plan))
    tuning = job.request.tuning
    warm = job.request.warm
    # Loaded here: a build writes the plan's table alone, and re-tuning takes longer to load than that to write.
    if warm:
        from padgen.measured.tuning import warm_plan

        out.write("drive-warm.csv", drive_csv(warm_plan(job.plan)))
    if tuning is not None and (not warm or any(taxel.measured for taxel in tuning.taxels)):
        from padgen.measured.tune import tuned_drive_csv

        out.write("drive-tuned-warm.csv" if warm else "drive-tuned.csv", tuned_drive_csv(job.plan, tuning))


def drive_rows(plan: Plan) -> tuple[DriveRow, ...]:
    """Return the driver table's rows: one per channel, then the constant current of each set of channels, if any."""
    plan = played_plan(plan)
    spec = plan.spec
    scheme = plan.scheme
    carrier = planned_carrier_hz(plan)
    rows: dict[int | str, DriveRow] = {}
    constant: list[DriveRow] = []
    for kind, channel_set in enumerate(plan.sets):
        rows |= {row.channel: row for row in coil_rows(spec, scheme, channel_set, carrier)}
        if scheme.has_constant and carrier is None:
            constant.append(
                bias_row(spec, scheme, channel_set, BIAS if len(plan.sets) == 1 else f"{BIAS} of set {kind}")
            )
    return (*(rows[c.index] for c in plan.channels), *constant)


def planned_carrier_hz(plan: Plan) -> float | None:
    """Return the carrier in Hz that the spec's amplifier needs; None where it needs none."""
    return carrier_hz(plan.spec, plan.scheme, max(channel.resonance_hz for channel in plan.channels))


def drive_csv(plan: Plan) -> str:
    """Return the driver table as CSV text."""
    return table_csv(COLUMNS, (astuple(row) for row in drive_rows(plan)))
