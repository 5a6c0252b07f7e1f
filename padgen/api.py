"""The public functions: each does what the command of its name does, and the commands are thin over the same calls.

Imported by `padgen` when one of them is first touched.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen.core.errors import SpecError
from padgen.make.pad import Pad, parse_parts
from padgen.make.planning import plan_for, plan_to_compare, spec_of
from padgen.spec import Spec, make_spec

if TYPE_CHECKING:
    from padgen.batch.sweep import SweepTable
    from padgen.driver.drive_folder import Drive
    from padgen.ladders.study import Study
    from padgen.measured.judge_laid import LaidReport
    from padgen.measured.printer_fit import Calibration
    from padgen.measured.tune import Retuned
    from padgen.measured.tuning import Tuning
    from padgen.planner.plan import Plan
    from padgen.solid.checks import Report

__all__ = [
    "build",
    "calibrate",
    "check",
    "drive",
    "plan",
    "read_plan",
    "read_tuning",
    "retune",
    "study",
    "sweep",
    "template_names",
]

Source = "str | Path | Mapping[str, Any] | Spec"
Progress = Callable[[str], None]
SMALLEST_SPEC = {"name": "default", "resolution": 1, "band_hz": [50, 200], "q_min": 15}
"""For the limits of the default printer."""


def _silent(step: str) -> None:
    """Say nothing of what is being done."""


def template_names() -> tuple[str, ...]:
    """Names of the templates, which stand for their specs wherever one is asked for.

    >>> "paper-32" in template_names()
    True
    """
    from padgen.spec import template_paths

    return tuple(template_paths())


def plan(
    spec: "str | Path | Mapping[str, Any] | Spec",
    *,
    tolerance: float | None = None,
    progress: Progress = _silent,
    **fields: Any,
) -> "Plan":
    """Plan a pad: coils, resonances, beams, drive and selectivity.

    Parameters
    ----------
    spec : str, path, mapping or Spec
        A template's name, a TOML file or plan.json, the tables of one, or a `Spec`.
    tolerance : float, optional
        Relative error of a resonance that will do, 0 to 1; finite elements of the printed solid are solved where the
        beam model's own estimate is more. Without it only ``model="solid"`` asks for them.
    progress : callable
        Told what is being done, a line at a time.
    **fields
        Fields of the spec that differ: top-level ones by name, tables as mappings (``coil={"grid": [4, 4]}``).

    Returns
    -------
    Plan
        Frozen plain data: frequencies in Hz, lengths in mm, amplitudes in µm; verdicts in ``.findings``.

    Raises
    ------
    SpecError, FileError
        A field is unknown or out of its bounds, or a file cannot be read.
    InfeasibleError
        No pad meets the spec; the sentence says which limit binds.
    SolverError
        Finite elements were asked for and have no answer.

    Examples
    --------
    >>> plan("paper-32", q_min=20)
    <Plan paper-32: 32 taxels over 4 x 4 coils, resonances 56.0 ... 76.0 Hz, tones drive>
    """
    return plan_for(spec_of(spec, fields), tolerance, progress)


def read_plan(path: "str | Path") -> "Plan":
    """Read the plan that a plan.json records, as it is; raises `FileError` where there is none."""
    from padgen.planner import read_plan as read

    return read(Path(path))


def build(
    plan: "Plan | str | Path | Mapping[str, Any] | Spec",
    *,
    parts: Sequence[str] = (),
    progress: Progress = _silent,
) -> Pad:
    """Make the pad of a plan, or of a spec; it is modelled when its mesh, its checks or its files are asked for.

    Parameters
    ----------
    plan : Plan, or what `padgen.plan` takes
        Which pad.
    parts : sequence of str
        What goes with it: 'tray', 'coupon', 'coupon-tray'.

    Returns
    -------
    Pad
        With ``.mesh`` (vertices (n, 3) in mm), ``.check()`` and ``.save(folder, formats=...)``, which writes the
        folder of ``padgen build``.

    Raises
    ------
    SpecError, FileError
        The spec or a part's name is bad. Planning and modelling raise when they are asked for.

    Examples
    --------
    >>> pad = build("paper-pair")
    >>> pad.plan.coils.rows
    4
    """
    named = parse_parts(",".join(parts))
    if hasattr(plan, "channels"):
        return Pad(plan.spec, named, given=plan, progress=progress)  # type: ignore[union-attr,arg-type]
    return Pad(spec_of(plan), named, progress=progress)


def check(
    mesh: "str | Path", spec: str | None = None, *, gcode: bool = False, progress: Progress = _silent
) -> "Report | LaidReport":
    """Check a mesh file against a printer's limits and, with a spec, against its plan; or G-code against its plan.

    Parameters
    ----------
    mesh : path
        An STL, 3MF, OBJ or PLY file in mm, or a slicer's G-code.
    spec : str, optional
        A template, a TOML file or a plan.json; the plan that is recorded beside the mesh is taken where it is of this
        spec. G-code needs one.
    gcode : bool
        The file is G-code: each taxel is judged as the slicer lays it, and at which frequency it would resonate.

    Returns
    -------
    Report or LaidReport
        ``.figures`` by name, and ``.findings``.

    Raises
    ------
    FileError
        No mesh or no G-code of this pad can be read there, or a plan.json holds no plan.
    SpecError
        G-code is to be checked and no spec is given.
    """
    from dataclasses import replace

    progress("reading")
    if gcode:
        from padgen.measured.judge_laid import check_gcode

        if spec is None:
            raise SpecError("is needed to check G-code: a template, a TOML file or a plan.json", "spec")
        compared, source = plan_to_compare(spec, Path(mesh), progress)
        progress("reading and checking")
        laid = check_gcode(compared, Path(mesh))
        return replace(laid, figures={**laid.figures, "compared_with": source})
    from padgen.solid.foreign import check_foreign, read_mesh

    part = read_mesh(Path(mesh))
    if spec is None:
        progress("checking")
        return check_foreign(part, make_spec(SMALLEST_SPEC), None)
    compared, source = plan_to_compare(spec, Path(mesh), progress)
    progress("checking")
    report = check_foreign(part, compared.spec, compared)
    return replace(report, figures={**report.figures, "compared_with": source})


def drive(
    plan: "Plan",
    *,
    state: str | None = None,
    frames: Any = None,
    seconds: float | None = None,
    loop: bool = False,
    rate_hz: int | None = None,
    signal: str = "voltage",
    carrier_hz: float | None = None,
    tuning: "Tuning | str | Path | None" = None,
    progress: Progress = _silent,
) -> "Drive":
    """Say what the coils of a plan are to show; ``.save`` writes the tables, waveforms or firmware for it.

    Parameters
    ----------
    plan : Plan
        Whose coils.
    state : str, optional
        One state on every coil, lowest channel first: '0110', levels as '0,0.5,1,0', or 'all', one after the other.
    frames : path, list of paths or array, optional
        Images of the pad, a pixel a taxel, or levels (k, taxels) in 0 ... 1.
    seconds : float, optional
        How long each frame lasts; by default as the plan's frame rate has it.
    loop : bool
        With a state: whole periods, to be repeated without a seam.
    rate_hz : int, optional
        Samples per second; by default 48000, or what it takes.
    signal : {'voltage', 'current'}
        What the amplifier controls.
    carrier_hz : float, optional
        Spur-free drive on a carrier, for amplifiers that pass no 0 Hz.
    tuning : Tuning or path, optional
        A print as measured, from `padgen.retune`.

    Returns
    -------
    Drive
        ``.save("drive.wav")`` writes one file of a format, ``.save(folder, formats=[...])`` a folder of them.

    Raises
    ------
    SpecError, FileError
        A state or an image that this pad cannot show, or a tuning of another pad.

    Examples
    --------
    >>> import padgen as pg
    >>> shown = pg.drive(pg.plan("paper-pair"), state="10")
    >>> shown.frames.shape
    (1, 32)
    """
    from padgen.driver.drive_folder import Drive, levels_of

    if isinstance(tuning, (str, Path)):
        tuning = read_tuning(tuning, plan)
    levels = levels_of(plan, state, frames)
    held = state is not None
    return Drive(plan, levels, seconds, held, loop, rate_hz, signal, carrier_hz, tuning, progress)


def read_tuning(path: "str | Path", plan: "Plan") -> "Tuning":
    """Read a tuning.json of `plan`; raises `FileError` where it is none, or of another pad."""
    from padgen.measured.tuning import read_tuning as read

    return read(Path(path), plan)


def retune(
    plan: "Plan",
    measured: "str | Path",
    *,
    excitation: str = "current",
    nearest: bool = False,
    estimate_rest: bool = False,
    coupon: "str | Path | None" = None,
) -> "Retuned":
    """Fit what a print was measured to be, and re-tune tones and levels to it.

    Parameters
    ----------
    plan : Plan
        What was printed.
    measured : path
        A CSV (resonances, spectra or time series), a WAV, or a folder of them, one taxel a file.
    excitation : {'current', 'voltage'}
        What the first channel of a WAV holds, where it has one more than taxels.
    nearest : bool
        Of two peaks that are alike, take the one nearer to the plan's.
    estimate_rest : bool
        Taxels that were not measured get the tones that the others make likely.
    coupon : path, optional
        What was measured on the coupon printed beside the pad.

    Returns
    -------
    Retuned
        ``.tuning`` is the print (resonances in Hz, Q, levels, with one-sigma errors), for `padgen.drive`; figures in
        dB before and after; ``.findings``.

    Raises
    ------
    FileError, SpecError, SolverError
        What was measured cannot be read, or tells no resonance.
    """
    from padgen.measured.read import read_measured
    from padgen.measured.tuned_folder import fitted_and_retuned

    found = read_measured(Path(measured), plan, excitation)
    return fitted_and_retuned(plan, found, nearest, estimate_rest, None if coupon is None else str(coupon))[1]


def calibrate(plan: "Plan", measured: "Sequence[str | Path]") -> "Calibration":
    """Find a printer's offsets of height and width, and the modulus, from measured prints of a plan.

    Parameters
    ----------
    plan : Plan
        What was printed; beams of several thicknesses and widths tell the three apart.
    measured : sequence of paths
        What was measured of a print each: a CSV, a WAV, or a folder of them.

    Returns
    -------
    Calibration
        Offsets in mm and the modulus in GPa, with one sigma of each, and the chi-square of the fit.

    Raises
    ------
    FileError, SpecError
        What was measured cannot be read.
    SolverError
        It does not tell the three apart, or contradicts itself.
    """
    from padgen.measured.fits import fit_measured
    from padgen.measured.printer_fit import calibrated
    from padgen.measured.read import read_measured

    return calibrated(plan, [fit_measured(read_measured(Path(each), plan), plan) for each in measured])


def study(
    plan: "Plan | str | Path | Mapping[str, Any] | Spec",
    *,
    only: Sequence[str] | None = None,
    tolerance: float | None = None,
    progress: Progress = _silent,
) -> "Study":
    """Measure error against run time of the models behind a plan, every rung in a process of its own.

    Interrupted (Ctrl-C) when it has measured something, it returns that, and ``.missing`` names what was not run. Times
    are the best of a few runs in a process that has imported what it needs (``.about["times"]``).

    Parameters
    ----------
    plan : Plan, or what `padgen.plan` takes
        Whose models.
    only : sequence of str, optional
        Names of ladders, e.g. ``["structure"]``; all without.
    tolerance : float, optional
        A relative error to pick rungs for, beside the usual ones.

    Returns
    -------
    Study
        ``.ladders``, ``.picks`` (the quickest rung for each tolerance) and ``.plot()``.

    Raises
    ------
    SpecError
        A name is no ladder's, or the tolerance is not above 0 and at most 1.
    """
    from padgen.ladders.study import measured_study, parse_only

    made = plan if hasattr(plan, "channels") else plan_for(spec_of(plan), progress=progress)
    return measured_study(made, parse_only(None if only is None else ",".join(only)), tolerance, progress)  # type: ignore[arg-type]


def sweep(
    base: "str | Path | Mapping[str, Any] | Spec",
    *,
    stage: str = "plan",
    folder: "str | Path | None" = None,
    workers: int | None = None,
    **axes: Any,
) -> "SweepTable":
    """Make all combinations of some fields' values, in as many processes as there are cores.

    Parameters
    ----------
    base : str, path, mapping or Spec
        What `padgen.plan` takes.
    stage : {'plan', 'yield', 'build', 'study'}
        How far each variant is made.
    folder : path, optional
        Where the index, and with `stage` 'build' or 'study' a folder of each variant, is kept; a temporary place that
        goes afterwards without it.
    workers : int, optional
        Processes at a time.
    **axes
        Lists of values by field, fields of tables in mappings (``coil={"gap_mm": [0.8, 1.0]}``).

    Returns
    -------
    SweepTable
        ``.table()`` is a list with a dict for each variant, ``.counts`` how many were done, refused and failed.

    Raises
    ------
    SpecError
        A field is unknown, or holds no list of values that it may take.

    Examples
    --------
    >>> import padgen as pg
    >>> [row["selectivity_db"] > 10 for row in pg.sweep("paper-pair", q_min=[15, 20]).table()]
    [True, True]
    """
    from padgen.batch.definition import sweep_over
    from padgen.batch.sweep import run_to_table

    if stage in ("build", "study") and folder is None:
        raise SpecError(f"needs a folder for stage {stage!r}, whose files would go with it", "sweep")
    return run_to_table(sweep_over(spec_of(base), axes, stage), None if folder is None else Path(folder), workers)
