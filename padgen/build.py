"""Plan → a folder of files: the pad, its checks and its driver table.

Knows when a folder is up to date without importing numpy or a CAD kernel.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen import __version__
from padgen.cache import code_hash, version
from padgen.errors import SpecError
from padgen.files import PLAN_FILES, OutputFolder, differs, file_hash, is_current, json_text, read_manifest
from padgen.finding import Finding
from padgen.spec import Spec

if TYPE_CHECKING:
    from padgen.planner.plan import Plan
    from padgen.solid.pad import PadSolid

__all__ = ["DEFAULT_FORMATS", "FORMATS", "Built", "build", "parse_formats", "up_to_date"]

FORMATS = ("stl", "3mf", "step", "glb")
DEFAULT_FORMATS = ("stl", "3mf", "step")
PACKAGES = ("build123d", "cadquery-ocp-novtk", "lib3mf", "manifold3d", "ngsolve", "numpy", "pillow", "trimesh")
OWN_FILES = ("pad.stl", "pad.3mf", "pad.glb", "taxel-*.step")
"""Files of a build that the next one of other formats or channels takes away."""
THUMBNAIL_PX = (256, 256)
PAD_COLOUR = (0.90, 0.88, 0.82)
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Built:
    """What a build left: the folder, its files, the figures of the checks, all findings."""

    folder: Path
    files: tuple[str, ...]
    figures: dict[str, Any]
    findings: tuple[Finding, ...]
    up_to_date: bool


def parse_formats(text: str) -> tuple[str, ...]:
    """Formats from a comma-separated list, in the order of `FORMATS`."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in FORMATS:
            raise SpecError(f"must be among {', '.join(FORMATS)}, got {name!r}", "--formats")
    if not names:
        raise SpecError(f"must name one or more of {', '.join(FORMATS)}", "--formats")
    return tuple(name for name in FORMATS if name in names)


def up_to_date(spec: Spec, folder: Path, formats: tuple[str, ...], instances: bool) -> Built | None:
    """The build in `folder` if nothing that went into it has changed, else None."""
    if not is_current(folder, _inputs(spec, formats, instances)):
        return None
    checks = json.loads((folder / "checks.json").read_text(encoding="utf-8"))
    findings = tuple(Finding(**entry) for entry in checks["findings"])
    files = tuple(read_manifest(folder)["files"])
    return Built(folder, files, checks["figures"], findings, True)


def build(
    spec: Spec,
    folder: Path,
    formats: tuple[str, ...] = DEFAULT_FORMATS,
    instances: bool = False,
    progress: Progress = lambda step: None,
) -> Built:
    """Plan, model, check and write the pad of `spec` into `folder`.

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
    from padgen.loop import planned
    from padgen.planner import plan_to_json

    progress("planning")
    plan = planned(spec, progress)
    progress("loading the CAD kernel")
    from padgen.solid.checks import check_pad
    from padgen.solid.export import bill_of_materials
    from padgen.solid.pad import build_pad

    progress("modelling")
    pad = build_pad(plan)
    progress("checking")
    report = check_pad(pad, plan)
    findings = (*plan.findings, *report.findings)
    inputs = _inputs(spec, formats, instances)
    with OutputFolder(folder) as out:
        out.write("plan.json", plan_to_json(plan))
        out.write("drive.csv", drive_csv(plan))
        out.write("drive.json", drive_json(plan))
        out.write("bom.csv", bill_of_materials(plan, report.figures["plastic_g"]))
        out.write("checks.json", _checks_json(report.figures, findings))
        for name in formats:
            progress(f"writing {name}")
            _write_format(out, name, plan, pad, instances, inputs["spec"])
        stale = [path.name for pattern in OWN_FILES for path in folder.glob(pattern)]
        if differs(folder, "plan.json", plan_to_json(plan)):
            stale += PLAN_FILES
        out.commit({"padgen": __version__, "inputs": inputs}, remove=stale)
    files = tuple(read_manifest(folder)["files"])
    return Built(folder, files, report.figures, findings, False)


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
            solid = pad.tiles[channel.index].solid
            out.write_by(f"taxel-{channel.index}.step", partial(export.write_taxel_step, plan, channel, solid=solid))
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


def _inputs(spec: Spec, formats: tuple[str, ...], instances: bool) -> dict[str, Any]:
    """Everything that the bytes of a build depend on."""
    text = json.dumps(asdict(spec), sort_keys=True)
    return {
        "spec": file_hash(text.encode()),
        "formats": list(formats),
        "instances": instances,
        "code": code_hash(),
        "versions": {name: version(name) for name in PACKAGES},
    }
