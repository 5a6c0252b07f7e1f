"""The public functions: plan, build, check, drive, re-tune, study and sweep pads from Python.

`padgen` imports this module when one of the functions is first used.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen.core.errors import SpecError
from padgen.core.files import read_as_one
from padgen.make.pad import Pad, parse_parts
from padgen.make.planning import Progress, plan_for, plan_to_compare, recorded_plan, spec_of
from padgen.planner.plan import Plan
from padgen.spec import Spec, make_spec, template_paths

if TYPE_CHECKING:
    from padgen.batch.sweep import SweepTable
    from padgen.driver.drive_folder import Drive
    from padgen.ladders.study import Study
    from padgen.measured.judge_laid import LaidReport
    from padgen.measured.printer_fit import Calibration
    from padgen.measured.tune import Retuned
    from padgen.measured.tuning import Tuning
    from padgen.solid.checks import Report

__all__ = [
    "build",
    "calibrate",
    "check",
    "draw",
    "drive",
    "plan",
    "read_plan",
    "read_tuning",
    "retune",
    "study",
    "sweep",
    "template_names",
]

SMALLEST_SPEC = {"name": "default", "resolution": 1, "band_hz": [50, 200], "q_min": 15}
"""A spec that is used only for the limits of the default printer."""


def _silent(step: str) -> None:
    """Ignore a progress message."""


def template_names() -> tuple[str, ...]:
    """Return the names of the templates, which may be given wherever a spec is expected.

    >>> "paper-32" in template_names()
    True
    """
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
        Largest accepted relative error of a resonance, 0 to 1. Where the beam model's own estimate is larger, finite
        elements of the printed solid are solved. Without a tolerance only ``model="solid"`` asks for them.
    progress : callable
        Called with one line of text at each step.
    **fields
        Changed fields of the spec: top-level ones by name, tables as mappings (``coil={"grid": [4, 4]}``).

    Returns
    -------
    Plan
        Frozen plain data: frequencies in Hz, lengths in mm, amplitudes in µm. ``.verdict`` says whether it works,
        ``.findings`` all else.

    Raises
    ------
    SpecError, FileError
        A field is unknown or out of its bounds, or a file cannot be read.
    InfeasibleError
        No pad meets the spec; the sentence names the limit that prevents it.
    SolverError
        Finite elements were asked for and have no answer.

    Examples
    --------
    >>> plan("paper-32", q_min=20)
    <Plan paper-32: 32 taxels over 4 x 4 coils, resonances 56.0 ... 76.0 Hz, tones drive>
    """
    return plan_for(spec_of(spec, fields), tolerance, progress)


def read_plan(path: "str | Path") -> "Plan":
    """Read the plan recorded in a plan.json; one that an older padgen wrote is planned anew from its spec.

    Raises `FileError` where there is none.
    """
    return recorded_plan(Path(path))


def build(
    plan: "Plan | str | Path | Mapping[str, Any] | Spec",
    *,
    parts: Sequence[str] = (),
    progress: Progress = _silent,
) -> Pad:
    """Make the pad of a plan or a spec; it is modelled once its mesh, checks or files are needed.

    Parameters
    ----------
    plan : Plan, or what `padgen.plan` takes
        The pad's plan or spec.
    parts : sequence of str
        Parts beside the pad: 'tray', 'coupon', 'coupon-tray'.
    progress : callable
        Called with one line of text at each step.

    Returns
    -------
    Pad
        With ``.mesh`` (vertices (n, 3) in mm), ``.check()`` and ``.save(folder, formats=...)``, which writes the folder
        of ``padgen build``.

    Raises
    ------
    SpecError, FileError
        The spec or a part's name is bad. Errors of planning and modelling are raised once these are needed.

    Examples
    --------
    >>> pad = build("paper-pair")
    >>> pad.plan.coils.rows
    4
    """
    named = parse_parts(",".join(parts))
    if isinstance(plan, Plan):
        return Pad(plan.spec, named, given=plan, progress=progress)
    return Pad(spec_of(plan), named, progress=progress)


def draw(
    plan: "Plan | str | Path | Mapping[str, Any] | Spec",
    folder: "str | Path",
    *,
    only: Sequence[str] = (),
    formats: Sequence[str] = ("svg", "png"),
    progress: Progress = _silent,
) -> tuple[str, ...]:
    """Draw the pictures of a plan into a folder, and return their files' names.

    Parameters
    ----------
    plan : Plan, or what `padgen.plan` takes
        The pad's plan or spec.
    folder : path
        Where the files go; it is made if it is not there.
    only : sequence of str
        Some of 'pad', 'section', 'exploded', 'ladder', 'responses', 'selectivity', 'prints', 'wiring'; none: all.
    formats : sequence of str
        'svg', 'png' or both.
    progress : callable
        Called with one line of text at each step.

    Returns
    -------
    tuple of str
        ``NAME.svg`` and ``NAME.png`` of each picture.

    Raises
    ------
    SpecError, FileError, InfeasibleError
        The spec is bad, there is no picture or format of a name, or the folder cannot be written.

    Examples
    --------
    >>> draw("paper-32", "out/pictures", only=["ladder"], formats=["svg"])  # doctest: +SKIP
    ('ladder.svg',)
    """
    from padgen.core.display import plot_bytes
    from padgen.core.files import OutputFolder
    from padgen.core.registry import names_in
    from padgen.report.charts import PICTURES, picture

    # The overview is that of several pictures on one sheet.
    known = tuple(name for name in PICTURES if name != "overview")
    names = names_in(",".join(only), known, "only") if only else known
    kinds = names_in(",".join(formats), PICTURE_FORMATS, "formats")
    planned = plan if isinstance(plan, Plan) else plan_for(spec_of(plan), None, progress)
    with OutputFolder(Path(folder)) as out:
        for name in names:
            progress(f"drawing {name}")
            figure = picture(planned, name)
            for kind in kinds:
                out.write(f"{name}.{kind}", plot_bytes(figure, kind))
        out.commit()
    return tuple(out.names)


PICTURE_FORMATS = ("svg", "png")


def check(
    mesh: "str | Path", spec: str | None = None, *, gcode: bool = False, progress: Progress = _silent
) -> "Report | LaidReport":
    """Check a mesh against a printer's limits and, with a spec, against its plan; or G-code against its plan.

    Parameters
    ----------
    mesh : path
        An STL, 3MF, OBJ or PLY file in mm, or a slicer's G-code.
    spec : str, optional
        A template, a TOML file or a plan.json. If the plan recorded beside the mesh is of this spec, the mesh is
        compared with that plan. G-code needs a spec.
    gcode : bool
        The file is G-code: each taxel is judged as the slicer lays it, with its resonance.
    progress : callable
        Called with one line of text at each step.

    Returns
    -------
    Report or LaidReport
        ``.figures`` by name, and ``.findings``.

    Raises
    ------
    FileError
        The file holds no readable mesh or no G-code of this pad, or a plan.json holds no plan.
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
    from padgen.solid.parts import check_foreign, read_mesh

    path = Path(mesh)
    plan = None
    if spec is None:
        part = read_mesh(path)
    else:
        part, (plan, source) = read_as_one(
            path.parent, lambda: (read_mesh(path), plan_to_compare(spec, path, progress))
        )
    progress("checking")
    report = check_foreign(part, plan.spec if plan else make_spec(SMALLEST_SPEC), plan)
    return replace(report, figures={**report.figures, "compared_with": source}) if plan else report


def drive(
    plan: "Plan",
    *,
    state: str | None = None,
    frames: Any = None,
    text: str | None = None,
    pattern: str | None = None,
    seconds: float | None = None,
    loop: bool = False,
    rate_hz: int | None = None,
    signal: str = "voltage",
    carrier_hz: float | None = None,
    tuning: "Tuning | str | Path | None" = None,
    progress: Progress = _silent,
    brake: bool = False,
) -> "Drive":
    """Drive the coils of a plan with a state or with frames; ``.save`` writes tables, waveforms or firmware.

    Parameters
    ----------
    plan : Plan
        The plan whose coils are driven.
    state : str, optional
        One state on every coil, lowest channel first: '0110', levels as '0,0.5,1,0', or 'all', one after the other.
    frames : path, list of paths or array, optional
        Images of the pad, one pixel per taxel, or levels (k, taxels) in 0 ... 1.
    text : str, optional
        Letters of 5 x 7 taxels, which scroll where they do not fit.
    pattern : {'each', 'rows', 'columns', 'checkerboard', 'sweep'}, optional
        A built-in sequence of frames; 'each' plays one taxel after the other, to check the wiring.
    seconds : float, optional
        Duration of each frame; by default from the plan's frame rate.
    loop : bool
        With a state: whole periods, which repeat without a seam.
    rate_hz : int, optional
        Samples per second; by default 48000, or more where needed.
    signal : {'voltage', 'current'}
        Quantity that the amplifier controls.
    carrier_hz : float, optional
        Spur-free drive on a carrier, for amplifiers that pass no 0 Hz.
    tuning : Tuning or path, optional
        Measurements of a print, from `padgen.retune`.
    progress : callable
        Called with one line of text at each step.
    brake : bool
        Stop taxels that go OFF, in a WAV: their line in counter-phase at the end of their last frame.

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
    levels = levels_of(plan, state, frames, text, pattern)
    return Drive(plan, levels, seconds, state is not None, loop, rate_hz, signal, carrier_hz, tuning, progress, brake)


def read_tuning(path: "str | Path", plan: "Plan") -> "Tuning":
    """Read a tuning.json of `plan`; raises `FileError` where the file is no tuning, or of another pad."""
    from padgen.measured.tuning import read_tuning as read

    return read(Path(path), plan)


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
        Quantity in the first channel of a WAV that has one channel more than taxels.
    sensor : {'displacement', 'velocity', 'acceleration'}, optional
        Quantity that was measured, where the files do not say; by default recognised where that is possible.
    nearest : bool
        Of two peaks of similar size, take the one nearer to the plan's resonance.
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


def calibrate(plan: "Plan", measured: "Sequence[str | Path]") -> "Calibration":
    """Fit a printer's offsets of height and width, and the modulus, to measured prints of a plan.

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


def study(
    plan: "Plan | str | Path | Mapping[str, Any] | Spec",
    *,
    only: Sequence[str] | None = None,
    tolerance: float | None = None,
    progress: Progress = _silent,
) -> "Study":
    """Measure error against run time of the models behind a plan, each rung in a process of its own.

    After an interruption (Ctrl-C) the measured part is returned, and ``.missing`` names the rungs that were not run.
    Times are the best of a few runs in a process that has imported its modules (``.about["times"]``).

    Parameters
    ----------
    plan : Plan, or what `padgen.plan` takes
        The plan whose models are measured.
    only : sequence of str, optional
        Names of ladders, e.g. ``["structure"]``; by default all.
    tolerance : float, optional
        A relative error to pick rungs for, beside the usual ones.
    progress : callable
        Called with one line of text at each step.

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

    made = plan if isinstance(plan, Plan) else plan_for(spec_of(plan), progress=progress)
    return measured_study(made, parse_only(None if only is None else ",".join(only)), tolerance, progress)


def sweep(
    base: "str | Path | Mapping[str, Any] | Spec",
    *,
    stage: str = "plan",
    folder: "str | Path | None" = None,
    workers: int | None = None,
    **axes: Any,
) -> "SweepTable":
    """Make all combinations of some fields' values, with one process per core.

    Parameters
    ----------
    base : str, path, mapping or Spec
        The spec to vary, as `padgen.plan` takes it.
    stage : {'plan', 'yield', 'build', 'study'}
        Last stage made of each variant.
    folder : path, optional
        Folder for the index and, with `stage` 'build' or 'study', a folder of each variant. Without it a temporary
        folder is used and removed.
    workers : int, optional
        Processes at a time.
    **axes
        Lists of values by field, fields of tables in mappings (``coil={"gap_mm": [0.8, 1.0]}``).

    Returns
    -------
    SweepTable
        ``.table()`` is a list with a dict for each variant, ``.counts`` the numbers of done, refused and failed ones.

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
