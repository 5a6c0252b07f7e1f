"""The folder of a re-tuned print: its tuning, its drive table, its measured and its predicted figures.

The drive table has a row for every taxel, with the columns of `drive.csv`.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from padgen.core.errors import FileError
from padgen.core.files import OutputFolder, differs, is_unchanged, json_text
from padgen.measured.fits import TaxelFit, fit_measured, fitted
from padgen.measured.predict import printed_channels
from padgen.measured.read import read_measured, read_measured_text
from padgen.measured.read_csv import Measured
from padgen.measured.simulate import simulate_print, simulated_measurement
from padgen.measured.tune import Retuned, retuned
from padgen.measured.tuning import Tuning, tuning_to_json
from padgen.measured.tuning_picture import tuning_picture
from padgen.planner.drive_rows import COLUMNS, DriveRow, bias_row, coil_rows, table_csv
from padgen.planner.fixtures import coupon_plan
from padgen.planner.plan import Plan, carrier_hz, plan_to_json
from padgen.planner.printed_pads import coils_of

__all__ = [
    "MeasuredRow",
    "RetunedFolder",
    "Simulated",
    "TunedRow",
    "fitted_and_retuned",
    "measured_rows",
    "simulated_print",
    "tuned_drive_csv",
    "tuned_rows",
    "write_retuned",
]

MEASURED, PRINTED, PICTURE = "measured.csv", "printed.json", "tuning.png"
Progress = Callable[[str], None]


class Simulated(NamedTuple):
    """A simulated print, and its simulated measurement as CSV."""

    printed: Tuning
    measured: str


@dataclass(frozen=True, slots=True)
class RetunedFolder:
    """A written folder: its files, the fits and the re-tuned print."""

    folder: Path
    files: tuple[str, ...]
    fits: tuple[TaxelFit, ...]
    result: Retuned

    def table(self) -> dict[str, Any]:
        """Return folder, files and the re-tuned print as plain data."""
        return {"folder": str(self.folder), "files": list(self.files), **asdict(self.result)}


def simulated_print(plan: Plan, seed: int, kind: str, snr_db: float) -> Simulated:
    """Simulate a print of `plan` and its measurement; `kind` and `snr_db` are those of `simulated_measurement`."""
    printed = simulate_print(plan, seed)
    return Simulated(printed, simulated_measurement(plan, printed, seed, kind, snr_db))


def write_retuned(
    plan: Plan,
    folder: Path,
    measured: Sequence[str],
    simulated: Simulated | None = None,
    excitation: str = "current",
    sensor: str | None = None,
    nearest: bool = False,
    estimate_rest: bool = False,
    coupon: str | None = None,
    progress: Progress = lambda step: None,
) -> RetunedFolder:
    """Re-tune `plan` to the files or the folder `measured`, or to a `simulated` print; write the results to `folder`.

    `excitation`, `sensor` and `nearest` are those of `read_measured` and `fit_measured`. With `estimate_rest`, or with
    the file of a measured `coupon`, unmeasured taxels get tones at their most likely resonances.

    Raises
    ------
    FileError, SpecError, SolverError
        The measurement cannot be read, or shows no resonance; nothing is written, but in the latter case a picture.
    """
    progress("fitting resonances")
    if simulated is not None:
        if differs(folder, MEASURED, simulated.measured) and not is_unchanged(folder, MEASURED):
            raise FileError(
                "is not of a simulated print, and --simulate would take its place; name another folder with -o",
                str(folder / MEASURED),
            )
        found = read_measured_text(simulated.measured, plan)
    else:
        found = read_measured([Path(each) for each in measured], plan, excitation, sensor)
    fits, curves, refused = fitted(found, plan, nearest)
    drawn = {PICTURE: tuning_picture(curves)} if curves else {}
    if refused is not None:
        if drawn:
            with OutputFolder(folder) as out:
                out.write(PICTURE, drawn[PICTURE])
                out.commit()
            raise FileError(f"{refused.message}; its data are drawn in {folder / PICTURE}", refused.where)
        raise refused
    progress("re-tuning")
    result = _retuned(plan, fits, nearest, estimate_rest, coupon)
    files: dict[str, str | bytes] = {
        "plan.json": plan_to_json(plan),
        "tuning.json": tuning_to_json(result.tuning),
        "drive-tuned.csv": tuned_drive_csv(plan, result.tuning),
        "retune.json": json_text(_table(plan, result, fits)),
    }
    if simulated is not None:
        files |= {MEASURED: simulated.measured, PRINTED: tuning_to_json(simulated.printed)}
    files |= drawn
    with OutputFolder(folder) as out:
        for name, text in files.items():
            out.write(name, text)
        out.commit()
    return RetunedFolder(folder, tuple(files), fits, result)


def fitted_and_retuned(
    plan: Plan, found: Measured, nearest: bool = False, estimate_rest: bool = False, coupon: str | None = None
) -> Retuned:
    """Fit the measurement `found` of a print and re-tune its plan; parameters and errors are `write_retuned`'s."""
    return _retuned(plan, fit_measured(found, plan, nearest), nearest, estimate_rest, coupon)


def _retuned(plan: Plan, fits: tuple[TaxelFit, ...], nearest: bool, estimate_rest: bool, coupon: str | None) -> Retuned:
    return retuned(plan, fits, estimate_rest or coupon is not None, _coupon_fits(plan, coupon, nearest))


def _coupon_fits(plan: Plan, coupon: str | None, nearest: bool) -> dict[int, TaxelFit] | None:
    """Read and fit the measurement of the plan's coupon; return the fits by channel."""
    if coupon is None:
        return None
    strip = coupon_plan(plan)
    by_id = {fit.id: fit for fit in fit_measured(read_measured(Path(coupon), strip), strip, nearest)}
    return {taxel.channel: by_id[taxel.id] for taxel in strip.taxels if taxel.id in by_id}


def _table(plan: Plan, result: Retuned, fits: tuple[TaxelFit, ...]) -> dict[str, Any]:
    """Return all results as plain data, but the tuning, which has a file of its own."""
    table = {key: value for key, value in asdict(result).items() if key != "tuning"}
    return {
        **table,
        "taxels": [asdict(row) for row in measured_rows(plan, result.tuning)],
        "fits": [*map(asdict, fits)],
    }


class TunedRow(NamedTuple):
    """A row of the drive table: of a taxel, or of the constant part of a coil's current (`taxel` names the coil)."""

    taxel: str
    drive: DriveRow


@dataclass(frozen=True, slots=True)
class MeasuredRow:
    """A taxel as measured, with its tone; `_error` fields are one sigma.

    `planned_hz` is the planned resonance, `line_a2` the line of i², `level_um` the ON amplitude. `measured` is False
    where resonance and Q are the plan's or estimated, `level_measured` where the response follows from the plan's mass
    and pull.
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
    """Return the drive table: a row per taxel in the plan's order and, where currents have a constant, one per coil."""
    spec, channels = plan.spec, printed_channels(plan, tuning)
    scheme = plan.scheme
    carrier = carrier_hz(spec, scheme, max(taxel.resonance_hz for taxel in tuning.taxels))
    rows: dict[int, TunedRow] = {}
    constant = []
    for (row, column), index in sorted(coils_of(plan).items()):
        own = [channels[i] for i in index]
        for i, found in zip(index, coil_rows(spec, scheme, own, carrier), strict=True):
            rows[i] = TunedRow(plan.taxels[i].id, found)
        if scheme.has_constant and carrier is None:
            constant.append(TunedRow(f"r{row}c{column}", bias_row(spec, scheme, own)))
    return (*(rows[i] for i in range(len(plan.taxels))), *constant)


def tuned_drive_csv(plan: Plan, tuning: Tuning) -> str:
    """Return the drive table as CSV."""
    return table_csv(("taxel", *COLUMNS), ((row.taxel, *astuple(row.drive)) for row in tuned_rows(plan, tuning)))


def measured_rows(plan: Plan, tuning: Tuning) -> tuple[MeasuredRow, ...]:
    """Return a row per taxel in the plan's order, for people to read."""
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
