"""Plan → a folder of files: the pad, its checks and its driver table.

Knows when a folder is up to date without importing numpy or a CAD kernel.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen import __version__
from padgen.core.cache import code_hash, versions
from padgen.core.files import OutputFolder, built_files, file_hash, is_current, json_text
from padgen.core.finding import Finding
from padgen.core.registry import SUSPENSIONS, names_in
from padgen.spec import Spec, find_spec, load_spec

if TYPE_CHECKING:
    from padgen.planner.plan import Plan
    from padgen.solid.pad_solid import PadSolid
    from padgen.solid.parts import Part

__all__ = [
    "DEFAULT_FORMATS",
    "FORMATS",
    "PARTS",
    "Built",
    "build",
    "parse_formats",
    "parse_parts",
    "plan_to_compare",
    "up_to_date",
]

FORMATS = ("stl", "3mf", "step", "glb")
PARTS = ("coupon", "coupon-tray", "tray")
"""What can be made beside the pad, see `padgen.solid.parts`."""
DEFAULT_FORMATS = ("stl", "3mf", "step")
OWN_FILES = ("pad.stl", "pad.3mf", "pad.glb", "taxel-*.step", *(f"{part}.*" for part in PARTS))
"""Files of a build that the next one of other formats, parts or channels takes away, where it wrote them."""
THUMBNAIL_PX = (256, 256)
PAD_COLOUR = (0.90, 0.88, 0.82)
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Built:
    """What a build left: the folder, its files, the figures of the checks, all findings, how to print it."""

    folder: Path
    files: tuple[str, ...]
    figures: dict[str, Any]
    findings: tuple[Finding, ...]
    printing: dict[str, str]
    up_to_date: bool


def parse_formats(text: str) -> tuple[str, ...]:
    """Formats from a comma-separated list, in the order of `FORMATS`."""
    return names_in(text, FORMATS, "--formats")


def parse_parts(text: str) -> tuple[str, ...]:
    """Parts from a comma-separated list, in the order of `PARTS`."""
    return names_in(text, PARTS, "--parts", optional=True)


def up_to_date(
    spec: Spec, folder: Path, formats: tuple[str, ...], instances: bool, parts: tuple[str, ...] = ()
) -> Built | None:
    """The build in `folder` if nothing that went into it has changed, else None."""
    # The code of what was registered is in no hash.
    if SUSPENSIONS.changes or not is_current(folder, _inputs(spec, formats, instances, parts)):
        return None
    try:
        checks = json.loads((folder / "checks.json").read_text(encoding="utf-8"))
        findings = tuple(Finding(**entry) for entry in checks["findings"])
        printing = json.loads((folder / "plan.json").read_text(encoding="utf-8"))["printing"]
        return Built(folder, tuple(built_files(folder)), checks["figures"], findings, printing, True)
    except (OSError, ValueError, TypeError, KeyError, RecursionError):  # a manifest that somebody has made up
        return None


def build(
    spec: Spec,
    folder: Path,
    formats: tuple[str, ...] = DEFAULT_FORMATS,
    instances: bool = False,
    progress: Progress = lambda step: None,
    parts: tuple[str, ...] = (),
) -> Built:
    """Plan, model, check and write the pad of `spec` into `folder`, and the `parts` that go with it.

    Raises
    ------
    SpecError, InfeasibleError
        The spec cannot be met; nothing is written.
    SolverError
        The finite elements of a taxel, where they are needed, have no trustworthy answer; nothing is written.
    GeometryError
        A kernel refused a part, or a file does not read back as written; nothing is written.
    FileError
        The folder cannot be written; what was there stays.
    """
    from padgen.driver import drive_csv, drive_json
    from padgen.make.solid_tuning import planned
    from padgen.planner import plan_to_json

    progress("planning")
    plan = planned(spec, progress)
    from padgen.solid.checks import check_pad
    from padgen.solid.export import bill_of_materials
    from padgen.solid.pad_solid import build_pad

    progress("modelling")
    pad = build_pad(plan)
    progress("checking")
    report = check_pad(pad, plan)
    beside = _parts(plan, parts, progress)
    figures = report.figures
    if beside:
        figures = {**figures, "parts": {part.name: part.report.figures for part in beside}}
    findings = (*plan.findings, *report.findings, *_part_findings(beside))
    inputs = _inputs(spec, formats, instances, parts)
    with OutputFolder(folder) as out:
        out.write("plan.json", plan_to_json(plan))
        out.write("drive.csv", drive_csv(plan))
        out.write("drive.json", drive_json(plan))
        out.write("bom.csv", bill_of_materials(plan, report.figures["plastic_g"], _plastic_g(beside)))
        out.write("checks.json", _checks_json(figures, findings))
        for name in formats:
            progress(f"writing {name}")
            _write_format(out, name, plan, pad, instances, inputs["spec"])
        _write_parts(out, plan, beside, formats, inputs["spec"])
        out.commit(inputs, remove=OWN_FILES)
    return Built(folder, tuple(built_files(folder)), figures, findings, plan.printing, False)


def plan_to_compare(spec: str, mesh: Path, progress: Progress = lambda step: None) -> "tuple[Plan, str]":
    """The plan that a mesh is compared with, and which one it is.

    A plan.json is taken as it is recorded, beams and all. The plan of another spec is the one recorded beside the
    mesh where that is of the same spec, by whichever model it was made; elsewhere it is planned as a build does.

    Raises
    ------
    FileError
        A plan.json, given or beside the mesh, holds no plan.
    SpecError, SolverError
        As planning does.
    """
    from padgen.planner import read_plan

    path, beside = find_spec(spec), mesh.parent / "plan.json"
    if path.suffix == ".json":
        return _named(read_plan(path), spec)
    asked = load_spec(spec)
    if beside.is_file():
        recorded = read_plan(beside)
        if replace(recorded.spec, model=asked.model) == asked:
            return _named(recorded, str(beside))
    from padgen.make.solid_tuning import planned

    progress("planning")
    return _named(planned(asked, progress), f"{spec}, planned anew")


def _named(plan: "Plan", source: str) -> "tuple[Plan, str]":
    models = " and ".join(sorted({channel.model for channel in plan.channels}))
    return plan, f"{source} ({models} model)"


def _parts(plan: "Plan", names: tuple[str, ...], progress: Progress) -> "tuple[Part, ...]":
    if not names:
        return ()
    from padgen.solid.parts import build_parts

    progress(f"modelling {', '.join(names)}")
    return build_parts(plan, names)


def _part_findings(parts: "tuple[Part, ...]") -> list[Finding]:
    return [replace(f, where=f"{part.name}: {f.where}") for part in parts for f in part.report.findings]


def _plastic_g(parts: "tuple[Part, ...]") -> dict[str, float]:
    return {part.name: part.report.figures["plastic_g"] for part in parts}


def _write_parts(
    out: OutputFolder, plan: "Plan", parts: "tuple[Part, ...]", formats: tuple[str, ...], spec_hash: str
) -> None:
    for part in parts:
        from padgen.solid.parts import write_part_files

        write_part_files(out, part, formats, _metadata(plan, spec_hash), f"{__version__} {spec_hash[:16]}")


def _write_format(out: OutputFolder, name: str, plan: "Plan", pad: "PadSolid", instances: bool, spec_hash: str) -> None:
    from padgen.solid import export

    if name == "stl":
        data = export.stl_bytes(pad.mesh, f"{__version__} {plan.name} {spec_hash[:16]}")
        path = out.write_by("pad.stl", lambda path: _write_bytes(path, data))
        export.verified("pad.stl", pad.mesh, export.stl_mesh(path.read_bytes()))
    elif name == "3mf":
        from padgen.solid.threemf import read_3mf, threemf_bytes

        data = threemf_bytes(plan, pad, _metadata(plan, spec_hash), _thumbnail(pad), instances)
        path = out.write_by("pad.3mf", lambda path: _write_bytes(path, data))
        compare = export.verified_volume if instances else export.verified
        compare("pad.3mf", pad.mesh, read_3mf(path, weld=instances))
    elif name == "step":
        for channel in plan.channels:
            out.write_by(f"taxel-{channel.index}.step", partial(export.write_taxel_step, plan, channel))
    elif name == "glb":
        out.write("pad.glb", export.glb_bytes(plan, pad))


def _write_bytes(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def _thumbnail(pad: "PadSolid") -> bytes:
    from padgen.solid.picture import picture_png

    return picture_png([(pad.mesh, PAD_COLOUR)], THUMBNAIL_PX)


def _metadata(plan: "Plan", spec_hash: str) -> dict[str, str]:
    """3MF metadata; names of our own carry our namespace, as the format asks."""
    own = "https://padgen.invalid/2026"
    settings = "; ".join(f"{key} {value}" for key, value in plan.printing.items())
    return {
        "Title": plan.name,
        "Application": f"padgen {__version__}",
        "LicenseTerms": "the pad is yours; padgen is Apache-2.0",
        "Description": f"{len(plan.taxels)} taxels over {plan.coils.rows} x {plan.coils.columns} coils",
        f"{own}:SpecHash": spec_hash,
        f"{own}:PrintSettings": settings,
    }


def _checks_json(figures: dict[str, Any], findings: tuple[Finding, ...]) -> str:
    return json_text({"figures": figures, "findings": [asdict(f) for f in findings]})


def _inputs(spec: Spec, formats: tuple[str, ...], instances: bool, parts: tuple[str, ...]) -> dict[str, Any]:
    """Everything that the bytes of a build depend on."""
    text = json.dumps(asdict(spec), sort_keys=True)
    return {
        "spec": file_hash(text.encode()),
        "formats": list(formats),
        "instances": instances,
        "parts": list(parts),
        "code": code_hash(),
        "versions": versions(),
    }
