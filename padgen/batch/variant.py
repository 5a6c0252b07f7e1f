"""One variant, from its table to its record: what a worker does."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen.batch.definition import Sweep
from padgen.batch.figures import build_figures, plan_figures, yield_figures
from padgen.batch.points import Variant, variant_table
from padgen.core.cache import code_hash, key_of, versions
from padgen.core.errors import FileError, PadgenError
from padgen.core.files import (
    MANIFEST,
    YIELD_FILE,
    OutputFolder,
    built_files,
    differs,
    file_hash,
    read_bounded,
)
from padgen.core.registry import plugin_code
from padgen.make.planning import plan_for
from padgen.spec import make_spec
from padgen.spec.threshold import LARGEST_FILE

if TYPE_CHECKING:
    from padgen.core.finding import Finding
    from padgen.planner.plan import Plan

__all__ = ["STATUSES", "Record", "Task", "is_whole", "run_task", "task_of", "writes_folders"]

STATUSES = ("done", "refused", "failed")
"""Made (whatever its findings); the spec cannot be met; something broke down."""


@dataclass(frozen=True, slots=True)
class Task:
    """What a worker is told: plain data, so that it travels to any executor.

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
class Record:
    """What came of a variant: one row of the index.

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
    seconds: float | None
    peak_memory_mb: float | None


def task_of(sweep: Sweep, variant: Variant, formats: tuple[str, ...], out: Path) -> Task:
    """The task of a variant; its folder lies in `out`."""
    settings, table = sweep.settings, variant_table(sweep, variant)
    folder = str(out / table["name"]) if writes_folders(sweep) else None
    inputs = {
        "table": table,
        "threshold": _threshold(table, sweep.folder),
        "stage": settings.stage,
        "formats": formats if settings.stage == "build" else (),
        "pads": settings.pads if settings.stage == "yield" else 0,
        "code": code_hash() + plugin_code(),
        "versions": versions(),
    }
    return Task(
        variant.number,
        key_of(inputs),
        variant.values,
        table,
        str(sweep.folder),
        folder,
        settings.stage,
        formats,
        settings.pads,
    )


def writes_folders(sweep: Sweep) -> bool:
    """Whether each variant gets a folder."""
    return sweep.settings.folders or sweep.settings.stage in ("build", "study")


def is_whole(folder: Path, stage: str) -> bool:
    """Whether the files that a stage writes are all there."""
    names = {"yield": [YIELD_FILE], "study": ["study.csv"], "build": built_files(folder) or [MANIFEST]}
    return all((folder / name).is_file() for name in ("plan.json", *names.get(stage, ())))


def _threshold(table: dict[str, Any], folder: Path) -> str:
    """Hash of the curve that a spec names, as its words alone do not tell when the file has changed."""
    drive = table.get("drive")
    name = drive.get("threshold_file") if isinstance(drive, dict) else None
    if not isinstance(name, str):
        return ""
    try:
        return file_hash(read_bounded(folder / name, LARGEST_FILE, "a threshold"))
    except FileError:
        return "cannot be read"


def run_task(task: Task) -> Record:
    """Make one variant as far as its stage asks for; a refusal is in its record."""
    figures: dict[str, Any] = {}
    findings: tuple[Finding, ...] = ()
    status, sentence = "done", ""
    try:
        figures, findings = _made(task)
    except PadgenError as error:
        status, sentence = ("refused" if error.code in ("spec", "infeasible") else "failed"), str(error)
    told = tuple(sorted({f.code for f in findings if f.level != "note"}))
    return Record(
        task.number,
        task.key,
        status,
        sentence,
        task.values,
        figures,
        sum(f.level == "error" for f in findings),
        sum(f.level == "warning" for f in findings),
        told,
        None,
        None,
    )


def _made(task: Task) -> "tuple[dict[str, Any], tuple[Finding, ...]]":
    spec = make_spec(task.table, Path(task.folder))
    if task.stage == "build":
        from padgen.make.pad import Pad

        pad = Pad(spec)
        built = pad.save(task.out or "", task.formats)
        return {**plan_figures(pad.plan), **build_figures(pad.plan, built.figures)}, built.findings
    from padgen.planner import plan_to_json

    plan = plan_for(spec)
    figures, texts = plan_figures(plan), {"plan.json": plan_to_json(plan)} if task.out else {}
    if task.stage == "yield":
        figures |= _yield(plan, task, texts)
    if task.out:
        _write(Path(task.out), texts)
        if task.stage == "study":
            figures |= _study(plan, Path(task.out))
    return figures, plan.findings


def _write(folder: Path, texts: dict[str, str]) -> None:
    """Write files of a plan; what belonged to another plan that was there goes."""
    with OutputFolder(folder) as out:
        for name, content in texts.items():
            out.write(name, content)
        out.commit(remove=built_files(folder) if differs(folder, "plan.json", texts["plan.json"]) else [])


def _yield(plan: "Plan", task: Task, texts: dict[str, str]) -> dict[str, Any]:
    from padgen.core.files import json_text
    from padgen.planner.print_yield import print_yield

    printed = print_yield(plan, task.pads, seed=0)
    texts[YIELD_FILE] = json_text(asdict(printed))
    return yield_figures(printed)


def _study(plan: "Plan", folder: Path) -> dict[str, Any]:
    from padgen.ladders.study import STUDY_FILES, run_study

    run_study(plan, folder)
    return {"study_files": len(STUDY_FILES)}
