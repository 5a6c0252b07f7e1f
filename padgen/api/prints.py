"""Public functions for measured prints: measure, simulate a measurement, re-tune, fit a printer or a finger."""

from collections.abc import Callable, Sequence
from math import floor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from padgen.api.drives import _tuning_of
from padgen.core.errors import FileError, SpecError

if TYPE_CHECKING:
    from padgen.driver.bench import Bench
    from padgen.measured.printer_fit import Calibration
    from padgen.measured.touched_skin import FingerFit
    from padgen.measured.tune import Retuned, RetunedFolder
    from padgen.measured.tuning import Tuning
    from padgen.planner.plan import Plan

__all__ = [
    "bench",
    "calibrate",
    "fit_touch",
    "retune",
    "save_printer",
    "save_retuned",
    "save_touch",
    "simulate_print",
]

Progress = Callable[[str], None]
LOUDER_DB = (2, 4, 8, 16, 32)
"""By how much a simulated measurement that shows too little is made louder."""
MOST_SNR_DB = 200


def _silent(step: str) -> None:
    """Ignore a progress message."""


def retune(
    plan: "Plan",
    measured: "str | Path | Sequence[str | Path]",
    *,
    excitation: str = "current",
    sensor: str | None = None,
    nearest: bool = False,
    estimate_rest: bool = False,
    coupon: "str | Path | None" = None,
) -> "Retuned":
    """Fit the measurements of a print, and re-tune tones and levels to it.

    Parameters
    ----------
    plan : Plan
        The printed plan.
    measured : path, or sequence of paths
        A CSV (resonances, spectra or time series), a WAV, several of these or a folder of them, named after taxels.
    excitation : {'current', 'voltage'}
        What the first channel of a WAV is where the others are taxels: the coil's current or its voltage.
    sensor : {'displacement', 'velocity', 'acceleration'}, optional
        Quantity that was measured, where the files do not say; by default recognised where that is possible.
    nearest : bool
        Where a recording shows two peaks of similar size, take the one nearer to the plan's resonance.
    estimate_rest : bool
        Give taxels that were not measured the tones that are likely from the others.
    coupon : path, optional
        Measurements of the coupon printed beside the pad.

    Returns
    -------
    Retuned
        ``.tuning`` is the print (resonances in Hz, Q, levels, with one-sigma errors), for `padgen.drive`; figures in dB
        before and after; ``.findings``.

    Raises
    ------
    FileError, SpecError, SolverError
        The measurements cannot be read, or show no resonance.
    """
    from padgen.measured.fits import fit_measured
    from padgen.measured.read import read_measured
    from padgen.measured.tune import retuned_with_coupon

    paths = [Path(each) for each in ([measured] if isinstance(measured, str | Path) else measured)]
    fits = fit_measured(read_measured(paths, plan, excitation, sensor), plan, nearest)
    return retuned_with_coupon(plan, fits, nearest, estimate_rest, coupon)


class SimulatedPrint(NamedTuple):
    """A simulated print: its true resonances, Q and responses, a measurement of it as CSV, and how that was made."""

    truth: "Tuning"
    measurement_csv: str
    seed: int
    kind: str
    snr_db: float


def simulate_print(plan: "Plan", seed: int, *, kind: str = "spectrum", snr_db: float = 30.0) -> SimulatedPrint:
    """Simulate a print of a plan and a measurement of it, to try re-tuning on; the same seed gives the same print.

    Parameters
    ----------
    plan : Plan
        The plan that is printed.
    seed : int
        Number of the print that the computer makes and measures, to try the loop by; 0 or more.
    kind : {'spectrum', 'chirp', 'pluck'}
        With a simulated print: what is measured.
    snr_db : float
        With a simulated print: signal over noise in dB, 0 to 200.

    Raises
    ------
    SpecError
        An argument is out of its bounds.

    Examples
    --------
    >>> import padgen as pg
    >>> plan = pg.plan("paper-pair")
    >>> pg.simulate_print(plan, 1).truth.taxels[0].id == plan.taxels[0].id
    True
    """
    if seed < 0:
        raise SpecError(f"must be 0 or more, got {seed}", "--simulate")
    if not 0 <= snr_db <= MOST_SNR_DB:
        raise SpecError(f"must be 0 … {MOST_SNR_DB} dB, got {snr_db:g}", "--snr")
    from padgen.measured.tuning import simulate_print as printed
    from padgen.measured.tuning import simulated_measurement

    truth = printed(plan, seed)
    return SimulatedPrint(truth, simulated_measurement(plan, truth, seed, kind, snr_db), seed, kind, snr_db)


def save_retuned(
    plan: "Plan",
    folder: "str | Path",
    measured: "Sequence[str | Path]" = (),
    simulated: SimulatedPrint | None = None,
    *,
    excitation: str = "current",
    sensor: str | None = None,
    nearest: bool = False,
    estimate_rest: bool = False,
    coupon: "str | Path | None" = None,
    progress: Progress = _silent,
) -> "RetunedFolder":
    """Re-tune a pad as `retune` does, and write ``tuning.json``, tables and a picture into a folder.

    Parameters
    ----------
    plan : Plan
        The printed plan.
    folder : path
        It is made if it is not there.
    measured : sequence of paths
        As in `retune`; none where the print is simulated.
    simulated : SimulatedPrint, optional
        What `simulate_print` made.
    excitation, sensor, nearest, estimate_rest, coupon
        As in `retune`.
    progress : callable
        Called with one line of text at each step.

    Raises
    ------
    FileError, SpecError, SolverError
        The measurement cannot be read, or shows no resonance; nothing is written, but in the latter case a picture.
    """
    from padgen.measured.tune import UnfittedError, write_retuned

    paths = [str(each) for each in measured]
    rest = None if coupon is None else str(coupon)
    try:
        made = None if simulated is None else (simulated.truth, simulated.measurement_csv)
        return write_retuned(
            plan, Path(folder), paths, made, excitation, sensor, nearest, estimate_rest, rest, progress
        )
    except UnfittedError as error:
        if simulated is None:
            raise
        louder = _louder_text(plan, simulated, nearest, progress)
        raise FileError(f"{error.message}; {louder}", error.where) from error


def _louder_text(plan: "Plan", simulated: SimulatedPrint, nearest: bool, progress: Progress) -> str:
    """Simulate again, with higher ``--snr``, a print that cannot be fitted; return as text which value suffices."""
    from padgen.measured.fits import fitted
    from padgen.measured.read import read_measured_text

    for more_db in LOUDER_DB:
        snr_db = floor(simulated.snr_db) + more_db
        if snr_db > MOST_SNR_DB:
            break
        progress(f"measuring it with {snr_db} dB over the noise")
        louder = simulate_print(plan, simulated.seed, kind=simulated.kind, snr_db=snr_db)
        if fitted(read_measured_text(louder.measurement_csv, plan), plan, nearest)[2] is None:
            return f"of this simulated print, --snr {snr_db} would do"
    return "of this simulated print, no higher --snr that was tried would do"


def fit_touch(
    plan: "Plan",
    measured: "str | Path | Sequence[str | Path]",
    touched: "str | Path | Sequence[str | Path]",
    *,
    excitation: str = "current",
    sensor: str | None = None,
    nearest: bool = False,
) -> "FingerFit":
    """Fit stiffness, damping and mass of a finger to taxels of a print that were measured untouched and touched.

    Parameters
    ----------
    plan : Plan
        The printed plan.
    measured : path, or sequence of paths
        Measurements of the untouched taxels, as in `retune`.
    touched : path, or sequence of paths
        Measurements of the same taxels with a finger on them: writes a [touch] table of one's own, touch.toml.
    excitation, sensor, nearest
        As in `retune`.

    Returns
    -------
    FingerFit
        k in N/m, c in N s/m and m in g, with one sigma of each, and what each taxel says.

    Raises
    ------
    FileError, SpecError, SolverError
        The measurements cannot be read, or show no resonance, or no taxel that the finger raises.
    """
    from padgen.measured.fits import fitted
    from padgen.measured.read import read_measured
    from padgen.measured.touched_skin import fit_finger

    fits = []
    for files in (measured, touched):
        paths = [Path(each) for each in ([files] if isinstance(files, str | Path) else files)]
        # A finger may damp some taxels so much that they show no resonance: the others tell of it.
        shown, _, refused = fitted(read_measured(paths, plan, excitation, sensor), plan, nearest)
        if refused is not None and not shown:
            raise refused
        fits.append(shown)
    untouched, pressed = fits
    return fit_finger(plan, untouched, pressed)


def save_touch(plan: "Plan", finger: "FingerFit", folder: "str | Path") -> tuple[str, ...]:
    """Write a finger fit: ``touch.toml`` with stiffness, damping and mass for a spec, ``touch.json`` with all taxels.

    Raises
    ------
    FileError
        A file cannot be written.
    """
    from dataclasses import asdict

    from padgen.core.files import OutputFolder, json_text
    from padgen.measured.touched_skin import finger_toml

    files = {"touch.toml": finger_toml(plan, finger), "touch.json": json_text(asdict(finger))}
    with OutputFolder(Path(folder)) as out:
        for name, text in files.items():
            out.write(name, text)
        out.commit()
    return tuple(files)


def bench(
    plan: "Plan",
    folder: "str | Path",
    *,
    device: str | None = None,
    record: str | None = None,
    rate_hz: int | None = None,
    port: str = "",
    baud: int = 115_200,
    tuning: "Tuning | str | Path | None" = None,
) -> "Bench":
    """Start or resume a session that measures a print: each taxel is shaken, recorded by a sensor, and fitted at once.

    Parameters
    ----------
    plan : Plan
        The printed plan.
    folder : path
        Folder of results; the recordings go into one of its own in it.
    device : str, optional
        Sound card that plays, by number or a part of its name; by default the computer's first choice.
    record : str, optional
        Sound card that records.
    rate_hz : int, optional
        Samples per second; by default the sound card's.
    port : str
        Serial port of the microcontroller that plays, in place of a sound card.
    baud : int
        Baud rate of the port.
    tuning : Tuning or path, optional
        With a serial port: the tuning.json that the firmware was written for.

    Returns
    -------
    Bench
        ``.names(by_coil)`` are due, ``.take(name, ...)`` records and fits one; then `save_retuned` takes its folder.

    Raises
    ------
    SpecError, FileError
        A device is not there, or the folder has recordings of another plan.
    EngineMissingError
        The extra ``play`` is not installed.
    """
    from padgen.driver.bench import bench as begin

    return begin(plan, Path(folder), device, record, rate_hz, port, baud, _tuning_of(tuning, plan))


def calibrate(plan: "Plan", measured: "Sequence[str | Path]") -> "Calibration":
    """Fit to measured prints by how much a printer makes beams too thick and too wide, and the plastic's modulus.

    Parameters
    ----------
    plan : Plan
        The printed plan; it needs beams of several thicknesses and widths to separate the three figures.
    measured : sequence of paths
        Measurements of one print each: a CSV, a WAV, or a folder of these.

    Returns
    -------
    Calibration
        Offsets in mm and the modulus in GPa, with one sigma of each, and the chi-square of the fit.

    Raises
    ------
    FileError, SpecError
        The measurements cannot be read.
    SolverError
        The measurements do not separate the three figures, or contradict each other.
    """
    from padgen.measured.fits import fit_measured
    from padgen.measured.printer_fit import calibrated
    from padgen.measured.read import read_measured

    return calibrated(plan, [fit_measured(read_measured(Path(each), plan), plan) for each in measured])


def save_printer(plan: "Plan", calibration: "Calibration", path: "str | Path") -> None:
    """Write a calibrated printer as a TOML file, which a spec beside it names as ``printer = "my-printer.toml"``.

    Raises
    ------
    FileError
        The file cannot be written.
    """
    from padgen.core.files import OutputFolder
    from padgen.measured.printer_fit import printer_toml

    file = Path(path)
    with OutputFolder(file.parent) as out:
        out.write(file.name, printer_toml(plan.spec, calibration, file.stem))
        out.commit()
