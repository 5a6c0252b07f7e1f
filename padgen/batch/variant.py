"""Make one variant: plan, build or study its spec, and return the figures by which variants are compared."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen.batch.definition import Sweep, Variant, variant_table
from padgen.core.cache import code_hash, key_of, versions
from padgen.core.errors import FileError, Finding, PadgenError
from padgen.core.files import (
    MANIFEST,
    YIELD_FILE,
    OutputFolder,
    built_files,
    differs,
    json_text,
    read_bounded,
    recover,
    sha256_hex,
)
from padgen.core.registry import PAD_FORMATS, names_in, plugin_code
from padgen.make.planning import plan_for
from padgen.spec import make_spec
from padgen.spec.load import LARGEST_CURVE

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = [
    "STATUSES",
    "Task",
    "VariantRecord",
    "plan_figures",
    "recover_and_check_files",
    "run_task",
    "task_of",
    "writes_folders",
]

STATUSES = ("done", "refused", "failed")
"""Made (whatever its findings); the spec cannot be met; something broke down."""
FDM_MM_PER_S = 40.0
"""Speed of a nozzle along fine walls; a print's time is of this order."""
RESIN_S_PER_LAYER = 9.0


@dataclass(frozen=True, slots=True)
class Task:
    """Task of a worker, to make one variant: plain data, which any executor can send.

    `key` is the hash of all that the record depends on; `folder` is where the base's files lie, `out` the
    variant's own folder (None: none is written).
    """

    number: int
    key: str
    values: dict[str, Any]
    table: dict[str, Any]
    folder: str
    out: str | None
    stage: str
    formats: tuple[str, ...]
    pads: int


@dataclass(frozen=True, slots=True)
class VariantRecord:
    """The result of one variant: one row of the index.

    `findings` are the codes of errors and warnings. `seconds` and `peak_memory_mb`, of the worker and all that it
    started, are filled in by who runs it; None where nobody measured.
    """

    number: int
    key: str
    status: str
    sentence: str
    values: dict[str, Any]
    figures: dict[str, Any]
    errors: int
    warnings: int
    findings: tuple[str, ...]
    seconds: float | None = None
    peak_memory_mb: float | None = None


def task_of(sweep: Sweep, variant: Variant, out: Path) -> Task:
    """Return the task that makes a variant; `out` is where the variant's folder will be made, if it gets one."""
    stage = sweep.settings.stage
    table = variant_table(sweep, variant)
    formats = names_in(sweep.settings.formats, PAD_FORMATS.names(), "formats") if stage == "build" else ()
    pads = sweep.settings.pads if stage == "yield" else 0
    inputs = {
        "table": table,
        "threshold": _threshold(table, sweep.folder),
        "stage": stage,
        "formats": formats,
        "pads": pads,
        "code": code_hash() + plugin_code(),
        "versions": versions(),
    }
    folder = str(out / table["name"]) if writes_folders(sweep) else None
    return Task(variant.number, key_of(inputs), variant.values, table, str(sweep.folder), folder, stage, formats, pads)


def writes_folders(sweep: Sweep) -> bool:
    """Tell whether each variant gets a folder."""
    return sweep.settings.folders or sweep.settings.stage in ("build", "study")


def recover_and_check_files(folder: Path, stage: str) -> bool:
    """Undo a killed run's commit in a variant's folder; tell whether all files of its stage are there."""
    try:
        recover(folder)
        names = {"yield": [YIELD_FILE], "study": ["study.csv"], "build": built_files(folder) or [MANIFEST]}
    except FileError:  # it is half-written, and not by this user
        return False
    return all((folder / name).is_file() for name in ("plan.json", *names.get(stage, ())))


def _threshold(table: dict[str, Any], folder: Path) -> str:
    """Return the hash of the file that a spec names for the vibrotactile threshold curve, empty if it names none."""
    drive = table.get("drive")
    name = drive.get("threshold_file") if isinstance(drive, dict) else None
    if not isinstance(name, str):
        return ""
    try:
        return sha256_hex(read_bounded(folder / name, LARGEST_CURVE, "a threshold"))
    except FileError:
        return "cannot be read"


def run_task(task: Task) -> VariantRecord:
    """Make one variant up to its stage (plan, yield, build or study) and return its record, also if it is refused."""
    figures: dict[str, Any] = {}
    findings: tuple[Finding, ...] = ()
    status = "done"
    sentence = ""
    try:
        figures, findings = _made(task)
    except PadgenError as error:
        status = "refused" if error.code in ("spec", "infeasible") else "failed"
        sentence = str(error)
    codes = tuple(sorted({f.code for f in findings if f.level != "note"}))
    errors, warnings = (sum(f.level == level for f in findings) for level in ("error", "warning"))
    return VariantRecord(task.number, task.key, status, sentence, task.values, figures, errors, warnings, codes)


def _made(task: Task) -> "tuple[dict[str, Any], tuple[Finding, ...]]":
    spec = make_spec(task.table, Path(task.folder))
    out = Path(task.out or "")
    if task.out and out.is_symlink():
        raise FileError("is a link, where the variant's folder must be; remove it", str(out))
    if task.stage == "build":
        from padgen.make.pad import Pad

        pad = Pad(spec)
        built = pad.save(out, task.formats)
        mesh = built.figures
        printer = pad.plan.spec.printer
        resin_s = mesh["size_mm"][2] / printer.layer_mm * RESIN_S_PER_LAYER
        nozzle_s = float(mesh["volume_mm3"]) / (printer.line_width_mm * printer.layer_mm * FDM_MM_PER_S)
        figures = plan_figures(pad.plan) | {
            "plastic_g": mesh["plastic_g"],
            "triangles": mesh["triangles"],
            "print_min": (resin_s if printer.process == "resin" else nozzle_s) / 60,
            "off_plan_mm": mesh.get("largest_difference_from_plan_mm"),
        }
        return figures, built.findings
    from padgen.planner import plan_to_json

    plan = plan_for(spec)
    figures = plan_figures(plan)
    texts = {"plan.json": plan_to_json(plan)} if task.out else {}
    if task.stage == "yield":
        from padgen.planner.print_yield import print_yield

        printed = print_yield(plan, task.pads, seed=0)
        texts |= {YIELD_FILE: json_text(asdict(printed))} if task.out else {}
        figures |= {
            "good_pads": printed.planned.pads.share,
            "good_pads_retuned": printed.retuned.pads.share,
            "good_taxels_retuned": printed.retuned.taxels.share,
            "median_retuned_db": printed.retuned.median_db,
        }
    if task.out:
        with OutputFolder(out) as folder:
            for name, content in texts.items():
                folder.write(name, content)
            # What belonged to another plan that was there goes.
            folder.commit(remove=built_files(out) if differs(out, "plan.json", texts["plan.json"]) else [])
    if task.stage == "study":
        from padgen.ladders.study import STUDY_FILES, run_study

        run_study(plan, out)
        figures["study_files"] = len(STUDY_FILES)
    return figures, plan.findings


def plan_figures(plan: "Plan") -> dict[str, Any]:
    """Return the figures of a plan by which variants are compared.

    `verdict` is the level of the plan's verdict and `verdict_db` its figure. `selectivity_db` is the worse of what a
    coil keeps in all states and what its neighbours leak; None where neither limits. `power_w` is the copper loss of
    all coils with all channels on.
    """
    kept = [db for db in (plan.selectivity.kept_db, plan.reuse.leak_db) if db is not None]
    coils = plan.coils.rows * plan.coils.columns
    return {
        "verdict": plan.verdict.level,
        "verdict_db": plan.verdict.figure_db,
        "taxels": len(plan.taxels),
        "coils": coils,
        "channels": len(plan.channels),
        "scheme": plan.selectivity.drive,
        "selectivity_db": min(kept, default=None),
        "in_coil_db": plan.selectivity.kept_db,
        "leak_db": plan.reuse.leak_db,
        "one_hot_db": plan.selectivity.one_hot_db,
        "lowest_hz": plan.channels[0].resonance_hz,
        "highest_hz": max(c.resonance_hz for c in plan.channels),
        "frames_per_s": {f.scheme: f.frames_per_s for f in plan.refresh}[plan.selectivity.drive],
        "reachable_level_um": plan.load.reachable_level_um,
        "voltage_v": plan.load.voltage_peak_v,
        "power_w": plan.heat_w,
        "largest_print_spread": max(c.print_spread for c in plan.channels),
        "largest_sag_um": max(c.sag_um for c in plan.channels),
    }
