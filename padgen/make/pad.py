"""Write the folder of a plan: the pad, its checks and its driver table.

Tells whether a folder is up to date without importing numpy or a CAD kernel.
"""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen.core.cache import code_hash, versions
from padgen.core.errors import Finding, Verdict
from padgen.core.files import (
    OutputFolder,
    built_files,
    differs,
    is_current,
    json_text,
    read_as_one,
    recover,
    sha256_hex,
)
from padgen.core.registry import PAD_FORMATS, SCHEMES, SUSPENSIONS, USUAL_FORMATS, names_in
from padgen.make.planning import Progress, plan_for, with_found_layout
from padgen.spec import Spec

if TYPE_CHECKING:
    from padgen.planner.plan import Plan
    from padgen.solid.checks import Report
    from padgen.solid.formats import Part
    from padgen.solid.mesh import Mesh
    from padgen.solid.pad_solid import PadSolid

__all__ = ["PARTS", "Built", "Pad", "current_build", "parse_formats", "parse_parts"]

PARTS = ("coupon", "coupon-tray", "tray", "guard", "spacer")
"""Names of the parts that can be made beside the pad, see `padgen.solid.parts`."""


@dataclass(frozen=True)
class Built:
    """Result of a build: the pad's verdict, folder, files, figures of the checks, all findings, print settings."""

    verdict: Verdict
    folder: Path
    files: tuple[str, ...]
    figures: dict[str, Any]
    findings: tuple[Finding, ...]
    printing: dict[str, str]
    up_to_date: bool


def parse_formats(text: str) -> tuple[str, ...]:
    """Return the formats in a comma-separated list, in the order of the registry."""
    return names_in(text, PAD_FORMATS.names(), "--formats")


def parse_parts(text: str) -> tuple[str, ...]:
    """Return the parts in a comma-separated list, in the order of `PARTS`."""
    return names_in(text, PARTS, "--parts", optional=True)


def current_build(
    spec: Spec,
    folder: Path,
    formats: tuple[str, ...],
    instances: bool,
    parts: tuple[str, ...] = (),
    report: bool = False,
) -> Built | None:
    """Return the build in `folder` if none of its inputs has changed, else None."""
    return read_as_one(folder, lambda: _current_build(spec, folder, formats, instances, parts, report))


def _current_build(
    spec: Spec, folder: Path, formats: tuple[str, ...], instances: bool, parts: tuple[str, ...], report: bool
) -> Built | None:
    inputs = _inputs(with_found_layout(spec, folder), formats, instances, parts, report)
    # No hash covers the code of registered extensions.
    if inputs["registered"] or not is_current(folder, inputs):
        return None
    try:
        checks = json.loads((folder / "checks.json").read_text(encoding="utf-8"))
        findings = tuple(Finding(**entry) for entry in checks["findings"])
        plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
        verdict = Verdict(**plan["verdict"])
        return Built(verdict, folder, tuple(built_files(folder)), checks["figures"], findings, plan["printing"], True)
    except (OSError, ValueError, TypeError, KeyError, RecursionError):  # the manifest was made by somebody else
        return None


@dataclass(frozen=True, eq=False, repr=False)
class Pad:
    """A pad of `spec` with the `parts` that go with it; planned, modelled and checked on first use.

    Made by `padgen.build`. `given` is the plan where one exists already, `tolerance` is as in `padgen.plan`; `progress`
    is called with the name of each step. Lengths are in mm.
    """

    spec: Spec
    parts: tuple[str, ...] = ()
    tolerance: float | None = None
    given: "Plan | None" = None
    progress: Progress = lambda step: None

    def __repr__(self) -> str:
        beside = f" with {', '.join(self.parts)}" if self.parts else ""
        return f"<Pad {self.spec.name}: {self.spec.resolution} taxels{beside}>"

    @cached_property
    def plan(self) -> "Plan":
        """The plan of the pad."""
        return self.given or plan_for(self.spec, self.tolerance, self.progress, keep=True)

    @cached_property
    def solid(self) -> "PadSolid":
        """Solid model of the pad: its mesh, exact volume, and the tile (a sub-cell with its taxel) of each channel.

        Raises
        ------
        GeometryError
            A kernel refused a taxel, or a seam does not close.
        """
        plan = self.plan
        from padgen.solid.pad_solid import build_pad

        self.progress("modelling")
        return build_pad(plan)

    @property
    def mesh(self) -> "Mesh":
        """Vertices (n, 3) in mm and triangles (m, 3) of the whole pad."""
        return self.solid.mesh

    def _repr_html_(self) -> str:
        from padgen.report.plans import plan_html

        return plan_html(self.plan)

    def report(self) -> Any:
        """Return the `padgen.report.page.Page` of the built pad: ``.save("report.html")`` writes one file."""
        from padgen.report.page import Page

        return Page(self.plan, self)

    def check(self) -> "Report":
        """Measure the pad's mesh, once; return figures, and findings on unmet checks."""
        return self._report

    @cached_property
    def beside(self) -> "tuple[Part, ...]":
        """The extra printed parts that `parts` names (coupon, trays, guard, spacer), each modelled and checked."""
        if not self.parts:
            return ()
        from padgen.solid.parts import build_part

        self.progress(f"modelling {', '.join(self.parts)}")
        return tuple(build_part(self.plan, name) for name in self.parts)

    @cached_property
    def bill(self) -> str:
        """The bill of materials of the pad and the parts beside it, as CSV text."""
        from padgen.solid.parts import bill_of_materials

        parts_g = {part.name: part.report.figures["plastic_g"] for part in self.beside if part.report}
        return bill_of_materials(self.plan, self.check().figures["plastic_g"], parts_g)

    @cached_property
    def _report(self) -> "Report":
        solid = self.solid
        from padgen.solid.checks import check_pad

        self.progress("checking")
        return check_pad(solid, self.plan)

    def save(
        self,
        folder: str | Path,
        formats: Sequence[str] = USUAL_FORMATS,
        instances: bool = False,
        force: bool = False,
        report: bool = False,
    ) -> Built:
        """Write the pad, its driver table and its checks into `folder`, unless all of it is up to date.

        Parameters
        ----------
        folder : path
            Made with its parents. An unchanged build of the same inputs is left as it is.
        formats : sequence of str
            Names of `padgen.solid.formats`: stl, 3mf, step, glb and registered ones.
        instances : bool
            Write 3MF with one mesh per distinct taxel, placed many times.
        force : bool
            Build again even if nothing changed.
        report : bool
            Write ``report.html``, too: the page of `report`.

        Raises
        ------
        SpecError, InfeasibleError, SolverError, GeometryError
            The pad cannot be planned or made, or a file does not read back as written; nothing is written.
        FileError
            The folder cannot be written; its old files stay.
        """
        folder = Path(folder)
        formats = parse_formats(",".join(formats))
        recover(folder)
        # With a tolerance, only planning decides on the model.
        spec = self.spec if self.tolerance is None else self.plan.spec
        if self.given and not force:
            from padgen.planner import plan_to_json

            force = differs(folder, "plan.json", plan_to_json(self.given))
        built = None if force else current_build(spec, folder, formats, instances, self.parts, report)
        return built or self._written(folder, formats, instances, report)

    def _written(self, folder: Path, formats: tuple[str, ...], instances: bool, page: bool) -> Built:
        from padgen.driver.formats.csv import drive_csv
        from padgen.driver.formats.json import drive_json
        from padgen.planner import plan_to_json
        from padgen.planner.printing import (
            ORCA_FILE,
            OTHER_SLICERS_FILE,
            PROFILE_FILE,
            orca_text,
            other_slicers_text,
            profile_text,
        )

        plan = self.plan
        pad = self.solid
        from padgen.solid.formats import ExportJob, Part

        beside = self.beside
        inputs = _inputs(plan.spec, formats, instances, self.parts, page)
        about = f"{len(plan.taxels)} taxels over {plan.coils.rows} x {plan.coils.columns} coils"
        whole = Part("pad", plan.name, about, pad.mesh, None, None)
        jobs = [ExportJob(plan, whole, inputs["spec"], pad, instances)]
        jobs += [ExportJob(plan, part, inputs["spec"]) for part in beside]
        reports = {part.name: part.report for part in beside if part.report}
        # Formats are written in a thread, which leaves the other core to the checks.
        with OutputFolder(folder) as out, ThreadPoolExecutor(1) as writer:
            self.progress(f"checking, and writing {', '.join(formats)}")
            work = [(PAD_FORMATS.get(name), job) for name in formats for job in jobs]
            written = [writer.submit(maker.write, out, job) for maker, job in work]
            report = self.check()
            of_parts = (
                {"parts": {name: part_report.figures for name, part_report in reports.items()}} if reports else {}
            )
            figures = report.figures | of_parts
            findings = [*plan.findings, *report.findings]
            for name, part_report in reports.items():
                findings += [replace(each, where=f"{name}: {each.where}") for each in part_report.findings]
            for name, text in (
                ("plan.json", plan_to_json(plan)),
                ("drive.csv", drive_csv(plan)),
                ("drive.json", drive_json(plan)),
                ("bom.csv", self.bill),
                ("checks.json", json_text({"figures": figures, "findings": findings})),
                (PROFILE_FILE, profile_text(plan)),
                (ORCA_FILE, orca_text(plan)),
                (OTHER_SLICERS_FILE, other_slicers_text(plan)),
                ("report.html", self.report().html if page else ""),
            ):
                if text:
                    out.write(name, text)
            # Formats that the thread has not begun are written here, from the end.
            for each, (maker, job) in reversed(list(zip(written, work, strict=True))):
                if each.cancel():
                    maker.write(out, job)
                else:
                    each.result()
            out.commit(inputs)
        return Built(plan.verdict, folder, tuple(built_files(folder)), figures, tuple(findings), plan.printing, False)


def _inputs(
    spec: Spec, formats: tuple[str, ...], instances: bool, parts: tuple[str, ...], report: bool
) -> dict[str, Any]:
    """Return all inputs on which the bytes of a build depend."""
    return {
        "spec": sha256_hex(json.dumps(asdict(spec), sort_keys=True).encode()),
        "formats": list(formats),
        "instances": instances,
        "parts": list(parts),
        "report": report,
        "registered": [*SUSPENSIONS.registered, *SCHEMES.registered, *PAD_FORMATS.registered],
        "code": code_hash(),
        "versions": versions(),
    }
