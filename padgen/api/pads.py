"""Public functions on pads: plan, build, check, draw, write_report and explore."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from padgen.core.errors import Finding, SpecError

if TYPE_CHECKING:
    from typing_extensions import TypeIs

    from padgen.make.pad import Pad
    from padgen.planner.explain import Explanation
    from padgen.planner.plan import Plan, Recoil
    from padgen.planner.print_yield import PrintYield
    from padgen.sliced.judge_laid import LaidReport
    from padgen.solid.checks import Report
    from padgen.spec.model import Spec

__all__ = [
    "build",
    "check",
    "draw",
    "explain",
    "explore",
    "is_plan",
    "plan",
    "print_yield",
    "read_plan",
    "read_spec",
    "recoil",
    "save_plan",
    "template_names",
    "template_text",
    "write_report",
]

Progress = Callable[[str], None]
SMALLEST_SPEC = {"name": "default", "resolution": 1, "band_hz": [50, 200], "q_min": 15}
"""A spec that is used only for the limits of the default printer."""
PLOT_FILE = "plan.svg"
MOST_PADS = 10_000_000
LARGEST_BILL = 1_000_000
LONGEST_S = 86_400.0


def _silent(step: str) -> None:
    """Ignore a progress message."""


def template_names() -> tuple[str, ...]:
    """Return the names of the templates, which may be given wherever a spec is expected.

    >>> "paper-32" in template_names()
    True
    """
    from padgen.spec import template_paths

    return tuple(template_paths())


def template_text(name: str) -> str:
    """Return the TOML text of a template.

    >>> template_text("paper-32").splitlines()[2][:4]
    'name'

    Raises
    ------
    FileError
        There is no template of that name.
    """
    from padgen.core.errors import FileError
    from padgen.spec import template_paths
    from padgen.spec.fields import unknown_name

    paths = template_paths()
    if name not in paths:
        raise FileError(unknown_name(name, list(paths), "template", "").message, "NAME")
    return paths[name].read_text(encoding="utf-8")


def read_spec(
    spec: "str | Path | Mapping[str, Any] | Spec", *, folder: "str | Path | None" = None, **fields: Any
) -> "Spec":
    """Read a spec, and change fields of it.

    Parameters
    ----------
    spec : str, path, mapping or Spec
        A template's name, a TOML file or plan.json, the tables of one, or a `Spec`.
    folder : path, optional
        Folder of results: a spec that leaves the model of resonances open gets that of the plan there, if that is a
        plan of this spec.
    **fields
        Changed fields: top-level ones by name, tables as mappings (``coil={"grid": [4, 4]}``).

    Raises
    ------
    SpecError, FileError
        There is no such spec, a field is unknown or out of its bounds, or the folder is half-written.

    Examples
    --------
    >>> read_spec("paper-32", q_min=20).q_min
    20.0
    """
    from padgen.make.planning import spec_as_recorded, spec_of

    read = spec_of(spec, fields)
    return read if folder is None else spec_as_recorded(read, Path(folder))


def plan(
    spec: "str | Path | Mapping[str, Any] | Spec",
    *,
    tolerance: float | str | None = None,
    progress: Progress = _silent,
    **fields: Any,
) -> "Plan":
    """Plan a pad: coils, resonances, beams, drive and selectivity.

    Parameters
    ----------
    spec : str, path, mapping or Spec
        A template's name, a TOML file or plan.json, the tables of one, or a `Spec`.
    tolerance : float or str, optional
        Largest accepted relative error of a resonance, as 0.01 or '1%'. Where the beam model's own estimate is larger,
        finite elements of the printed solid are solved. Without a tolerance only ``model="solid"`` asks for them.
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
    from padgen.make.planning import parse_tolerance, plan_for, spec_of

    largest = None if tolerance is None else parse_tolerance(str(tolerance))
    return plan_for(spec_of(spec, fields), largest, progress, keep=True)


def read_plan(path: "str | Path") -> "Plan":
    """Read the plan recorded in a plan.json; one that an older padgen wrote is planned anew from its spec.

    Raises `FileError` where there is none.
    """
    from padgen.make.planning import recorded_plan

    return recorded_plan(Path(path))


def explain(
    plan: "Plan", spec: "str | Path | Mapping[str, Any] | Spec | None" = None, *, progress: Progress = _silent
) -> "Explanation":
    """Return what stops a plan's coils from having one more channel each, and the spec changes that would help.

    Every change is planned, as `plan` would plan the `spec` with it: what that leaves open is searched for anew.
    Without the `spec`, what the plan's search decided stays as it is.

    Examples
    --------
    >>> import padgen as pg
    >>> pg.explain(pg.plan("paper-pair"), "paper-pair").changes[0].change  # doctest: +SKIP
    'q_min = 52'
    """
    from padgen.make.planning import spec_of
    from padgen.planner.explain import explain_plan

    return explain_plan(plan, None if spec is None else spec_of(spec, {}), progress)


def print_yield(plan: "Plan", pads: int = 100_000, seed: int = 0) -> "PrintYield":
    """Simulate many prints of a pad, and return the share that is selective enough, before and after re-tuning.

    Parameters
    ----------
    plan : Plan
        The pad's plan.
    pads : int
        Number of simulated prints, 1 to 10 million.
    seed : int
        Start of the random numbers, 0 or more: the same seed gives the same figures.

    Raises
    ------
    SpecError
        A number is out of its bounds.

    Examples
    --------
    >>> import padgen as pg
    >>> 0 <= pg.print_yield(pg.plan("paper-pair"), 100).planned.pads.share <= 1
    True
    """
    if not 1 <= pads <= MOST_PADS:
        raise SpecError(f"must be 1 … {MOST_PADS} pads, got {pads}", "--yield")
    if seed < 0:
        raise SpecError(f"must be 0 or more, got {seed}", "--seed")
    from padgen.planner.print_yield import print_yield as printed

    return printed(plan, pads, seed)


def recoil(
    plan: "Plan",
    *,
    kind: str | None = None,
    base_mass_g: float | None = None,
    stiffness_n_per_m: float | None = None,
    q: float | None = None,
    images: int = 100,
) -> "Recoil":
    """Return the ratio in dB of ON to OFF amplitude that is left when the recoil of ON taxels shakes the whole pad.

    The driver table moves all taxels of a channel in step; a plan's verdict counts that where its spec has a mount.
    What `drive` writes chooses signs, frame by frame.

    Parameters
    ----------
    plan : Plan
        The pad's plan.
    kind : {'resting', 'skin', 'foam', 'screwed', 'glued'}, optional
        What holds the pad: the first three let it lie loose. Without any of these four, the mount of the plan's spec;
        loose where it has none.
    base_mass_g : float, optional
        Mass in g of a plate below pad and tray that moves with them; without it what the pad is screwed or glued to
        does not move.
    stiffness_n_per_m : float, optional
        Stiffness in N/m of skin, foam or feet below all of it.
    q : float, optional
        Quality factor of the vertical motion on that stiffness; by default 2.
    images : int
        Number of images by chance, of which the worst counts.

    Returns
    -------
    Recoil
        ``.clamped_db`` on a pad that does not move, ``.in_step_db`` as the driver table has it, ``.signed_db`` with
        the sign of each taxel's motion chosen as `drive` does, ``.base_g``: glued to a plate of this mass it would
        lose at most 2 dB then.

    Raises
    ------
    SpecError
        An argument is out of its bounds.

    Examples
    --------
    >>> import padgen as pg
    >>> found = pg.recoil(pg.plan("paper-pair"))
    >>> found.in_step_db < found.signed_db < found.clamped_db
    True
    """
    from padgen.planner.cures import varied
    from padgen.planner.shaken_pad import pad_recoil

    if images < 1:
        raise SpecError(f"must be 1 or more, got {images}", "images")
    stated = {"kind": kind, "base_mass_g": base_mass_g, "stiffness_n_per_m": stiffness_n_per_m, "q": q}
    if all(value is None for value in stated.values()):
        return pad_recoil(plan, images=images)
    mount = {f"mount.{name}": value for name, value in stated.items()} | {"mount.kind": kind or "resting"}
    return pad_recoil(plan, varied(plan.spec, mount).mount, images)


class SavedPlan(NamedTuple):
    """Files that `save_plan` wrote, the text of plan.json, and whether files built from an older plan remain."""

    files: tuple[str, ...]
    plan_json: str
    is_stale: bool


def save_plan(
    plan: "Plan", folder: "str | Path", *, printed: "PrintYield | None" = None, plot: bool = False
) -> SavedPlan:
    """Write ``plan.json`` into a folder, with ``yield.json`` if `printed` is given, and ``plan.svg`` if `plot`.

    Parameters
    ----------
    plan : Plan
        The pad's plan.
    folder : path
        It is made if it is not there.
    printed : PrintYield, optional
        What `print_yield` found.
    plot : bool
        Draw the overview, too: the pad to scale, which coils' prints suffer, resonances.

    Raises
    ------
    FileError
        The folder cannot be written; its old files stay.
    """
    from padgen.core.files import YIELD_FILE, OutputFolder, json_text
    from padgen.planner import plan_to_json

    with OutputFolder(Path(folder)) as out:
        record = plan_to_json(plan)
        out.write("plan.json", record)
        if printed:
            out.write(YIELD_FILE, json_text(printed))
        if plot:
            from padgen.core.display import plot_bytes

            out.write(PLOT_FILE, plot_bytes(plan.plot(), "svg"))
        stale = out.commit()
    return SavedPlan(tuple(out.names), record, bool(stale))


def build(
    plan: "Plan | str | Path | Mapping[str, Any] | Spec",
    *,
    parts: Sequence[str] = (),
    tolerance: float | str | None = None,
    progress: Progress = _silent,
) -> "Pad":
    """Return the pad of a plan or a spec; its solid is computed only when its mesh, checks or files are asked for.

    Parameters
    ----------
    plan : Plan, or what `padgen.plan` takes
        The pad's plan or spec.
    parts : sequence of str
        Parts beside the pad: 'tray' (holds the coils), 'coupon' (one taxel of each kind), 'coupon-tray',
        'guard' (the plate round the pins), 'spacer' (the frame between pad and board).
    tolerance : float or str, optional
        As in `padgen.plan`, where a spec is given.
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
    from padgen.make.pad import Pad, parse_parts
    from padgen.make.planning import parse_tolerance, spec_of

    named = parse_parts(",".join(parts))
    if is_plan(plan):
        return Pad(plan.spec, named, given=plan, progress=progress)
    largest = None if tolerance is None else parse_tolerance(str(tolerance))
    return Pad(spec_of(plan), named, largest, progress=progress)


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
        Some of 'pad', 'section', 'exploded', 'prints', 'wiring', 'responses', 'selectivity', 'ladder', 'kept', and
        figures that were registered; none: all.
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
    from padgen.report.charts import picture, picture_names

    # A sheet of several of these pictures is not drawn beside them.
    known = picture_names(with_sheets=False)
    names = names_in(",".join(only), known, "--only") if only else known
    kinds = names_in(",".join(formats), PICTURE_FORMATS, "--format")
    planned = _planned(plan, progress)
    with OutputFolder(Path(folder)) as out:
        for name in names:
            progress(f"drawing {name}")
            figure = picture(planned, name)
            for kind in kinds:
                out.write(f"{name}.{kind}", plot_bytes(figure, kind))
        out.commit()
    return tuple(out.names)


PICTURE_FORMATS = ("svg", "png")


def _planned(plan: "Plan | str | Path | Mapping[str, Any] | Spec", progress: Progress = _silent) -> "Plan":
    """Return the given plan, or the plan of the given spec."""
    from padgen.make.planning import plan_for, spec_of

    return plan if is_plan(plan) else plan_for(spec_of(plan), progress=progress, keep=True)


def is_plan(given: "Plan | str | Path | Mapping[str, Any] | Spec") -> "TypeIs[Plan]":
    """Tell whether the given thing is a plan; the planner's modules are not loaded for a spec or a path."""
    from padgen.spec.model import Spec

    if isinstance(given, (str, Path, Mapping, Spec)):
        return False
    from padgen.planner.plan import Plan

    return isinstance(given, Plan)


def check(
    mesh: "str | Path", spec: str | None = None, *, gcode: bool = False, progress: Progress = _silent
) -> "Report | LaidReport":
    """Check a mesh against a printer's limits and, if a spec is given, its plan; or check G-code against a spec's plan.

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

    from padgen.core.files import read_as_one
    from padgen.make.planning import plan_to_compare
    from padgen.spec import make_spec

    progress("reading")
    if gcode:
        from padgen.sliced.judge_laid import check_gcode

        if spec is None:
            raise SpecError("is needed to check G-code: a template, a TOML file or a plan.json", "--spec")
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


class Reported(NamedTuple):
    """The page that `write_report` wrote: plan, file and size, whether it shows the pad as built, and all findings."""

    plan: "Plan"
    file: Path
    size_bytes: int
    is_built: bool
    findings: tuple[Finding, ...]


def write_report(
    plan: "Plan | str | Path | Mapping[str, Any] | Spec",
    folder: "str | Path",
    *,
    source: "str | Path | None" = None,
    progress: Progress = _silent,
) -> Reported:
    """Write ``report.html``, one page for the browser that needs no network: the pad in 3-D, figures, what to order.

    Parameters
    ----------
    plan : Plan, or what `padgen.plan` takes
        The pad's plan or spec; a folder of results stands for the plan in it.
    folder : path
        Where the page goes, with its plan.json.
    source : path, optional
        Folder of results: where it has an unchanged build of this plan, the page shows that, else the pad as the plan's
        dimensions give it. By default `folder`.
    progress : callable
        Called with one line of text at each step.

    Raises
    ------
    SpecError, FileError, InfeasibleError
        There is no such spec or plan, or the folder cannot be written.

    Examples
    --------
    >>> write_report("paper-32", "out/paper-32").is_built  # doctest: +SKIP
    False
    """
    from padgen.core.files import OutputFolder, read_as_one, recover
    from padgen.planner import plan_to_json
    from padgen.report.page import REPORT_FILE, Page, study_of

    of_folder = isinstance(plan, (str, Path)) and Path(plan).is_dir()
    results = Path(plan if of_folder and source is None else source or folder)  # type: ignore[arg-type]
    if of_folder:
        if results == Path(folder):
            recover(results)
        planned = _recorded(results)
    else:
        planned = _planned(plan, progress)
    pad = read_as_one(results, lambda: _built(planned, results))
    progress("drawing the page")
    page = Page(planned, pad, study_of(results), _bill(results) if pad else "").html
    with OutputFolder(Path(folder)) as out:
        out.write("plan.json", plan_to_json(planned))
        out.write(REPORT_FILE, page)
        out.commit()
    findings = (*planned.findings, *(pad.check().findings if pad else ()))
    return Reported(planned, Path(folder) / REPORT_FILE, len(page.encode()), pad is not None, findings)


def _recorded(folder: Path) -> "Plan":
    """Return the plan recorded in a folder; if planning its spec again gives the same plan, return that, unrounded."""
    from contextlib import suppress

    from padgen.core.errors import PadgenError
    from padgen.core.files import differs, read_as_one
    from padgen.make.planning import plan_for, recorded_plan
    from padgen.planner import plan_to_json

    if not read_as_one(folder, (folder / "plan.json").exists, "plan.json"):
        raise SpecError("has no plan.json; name a spec, or a folder that padgen plan or build wrote", str(folder))
    plan = recorded_plan(folder / "plan.json")
    if plan.spec.model.structure != "solid":
        with suppress(PadgenError):
            again = plan_for(plan.spec, keep=True)
            return plan if differs(folder, "plan.json", plan_to_json(again)) else again
    return plan


def _bill(folder: Path) -> str:
    """Return the bill of materials (CSV) in `folder`; empty where padgen did not write it or it was changed."""
    from padgen.core.files import is_unchanged, read_bounded

    bill = "bom.csv"
    return (
        read_bounded(folder / bill, LARGEST_BILL, "a bill of materials").decode() if is_unchanged(folder, bill) else ""
    )


def _built(plan: "Plan", folder: Path) -> "Pad | None":
    """Return the pad if `folder` has an unchanged build of this very plan, else None."""
    from padgen.core.files import built_files, differs, is_unchanged
    from padgen.make.pad import Pad
    from padgen.planner import plan_to_json

    names = ("plan.json", "checks.json")
    is_whole = names[1] in built_files(folder) and all(is_unchanged(folder, name) for name in names)
    return Pad(plan.spec, given=plan) if is_whole and not differs(folder, names[0], plan_to_json(plan)) else None


def explore(
    spec: "str | Path" = "pad-32",
    folder: "str | Path" = "out",
    *,
    port: int = 0,
    time_limit_s: float = 20.0,
    on_ready: Callable[[str], None] = print,
) -> None:
    """Serve the page of a report with a form of all fields of the spec, to this machine only, until Ctrl-C.

    Parameters
    ----------
    spec : str or path
        A TOML file, a template's name or a plan.json.
    folder : path
        Folder of specs and pads.
    port : int
        Port of the page; 0: a free one.
    time_limit_s : float
        Seconds after which a plan is given up.
    on_ready : callable
        Called with the page's address once it answers.

    Raises
    ------
    SpecError, FileError
        The spec cannot be read, a number is out of its bounds, or the port is taken.
    EngineMissingError
        The extra ``explore`` is not installed.
    """
    if not 0 <= port <= 65_535:
        raise SpecError(f"must be 0 … 65535, got {port}", "--port")
    if not 0 < time_limit_s <= LONGEST_S:
        raise SpecError(f"must be above 0 and at most {LONGEST_S:.0f} s, got {time_limit_s:g} s", "--time-limit")
    from padgen.report.live import serve

    serve(str(spec), Path(folder), port, on_ready, time_limit_s)
