"""Parts beside the pad, made when asked for: the coil tray, the coupon, and a tray for the coupon's coil.

Each is modelled, checked and exported like the pad: STL, 3MF and, of trays, STEP, read back after writing.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from padgen.core.errors import GeometryError
from padgen.core.files import OutputFolder
from padgen.planner.coupon import coupon_plan
from padgen.planner.plan import Plan
from padgen.solid import export
from padgen.solid.checks import Report, check_pad
from padgen.solid.coupon_solid import build_coupon
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.mesh import Mesh
from padgen.solid.picture import picture_png
from padgen.solid.threemf import part_3mf_bytes, read_3mf
from padgen.solid.tray_checks import check_tray
from padgen.solid.tray_solid import build_tray

__all__ = ["PARTS", "Part", "build_part", "build_parts", "write_part_files"]

PARTS = ("coupon", "coupon-tray", "tray")
THUMBNAIL_PX = (256, 256)
COLOUR = (0.90, 0.88, 0.82)


@dataclass(frozen=True)
class Part:
    """A part that was built: `name` of its files, `title` in them, mesh and the `report` of its checks.

    `solid` is the build123d solid, None where there is only the mesh.
    """

    name: str
    title: str
    mesh: Mesh
    solid: Any
    report: Report


def build_parts(plan: Plan, names: Iterable[str]) -> tuple[Part, ...]:
    """The parts of `plan` by `names` out of `PARTS`, in that order, each checked.

    Raises
    ------
    InfeasibleError
        The plan's coils do not fit a tray.
    GeometryError
        A kernel refused a part.
    """
    wanted = set(names)
    return tuple(build_part(plan, name) for name in PARTS if name in wanted)


def build_part(plan: Plan, name: str) -> Part:
    """One part of `plan`; raises as `build_parts` does."""
    if name == "coupon":
        coupon, pad = build_coupon(plan)
        return Part(name, coupon.name, pad.mesh, None, check_pad(pad, coupon))
    over = coupon_plan(plan) if name == "coupon-tray" else plan
    tray = build_tray(over)
    return Part(name, tray.tray.name, tray.mesh, tray.solid, check_tray(tray, over))


def write_part_files(
    out: OutputFolder, part: Part, formats: Iterable[str], metadata: dict[str, str], stamp: str
) -> None:
    """Add the files of a part to `out`; formats that it does not have (glb, STEP of a coupon) are left out.

    `stamp` goes into the STL's header, `metadata` into the 3MF, whose title and description are the part's own.

    Raises
    ------
    GeometryError
        A file does not read back as it was written.
    """
    wanted = set(formats)
    if "stl" in wanted:
        name, data = f"{part.name}.stl", export.stl_bytes(part.mesh, f"{stamp} {part.title}")
        path = out.write_by(name, lambda path: _write(path, data))
        export.verified(name, part.mesh, export.stl_mesh(path.read_bytes()))
    if "3mf" in wanted:
        name, notes = f"{part.name}.3mf", {**metadata, "Title": part.title, "Description": DESCRIPTIONS[part.name]}
        package = part_3mf_bytes(part.title, part.mesh, notes, picture_png([(part.mesh, COLOUR)], THUMBNAIL_PX))
        path = out.write_by(name, lambda path: _write(path, package))
        export.verified(name, part.mesh, read_3mf(path, weld=False))
    if "step" in wanted and part.solid is not None:
        out.write_by(f"{part.name}.step", lambda path: _write_step(part, path))


DESCRIPTIONS = {
    "coupon": "one taxel of each channel, to be printed beside the pad and measured",
    "coupon-tray": "holds one coil of each kind under the coupon",
    "tray": "holds the coils under the pad",
}


def _write(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def _write_step(part: Part, path: Path) -> None:
    b, name = build123d(), f"{part.name}.step"
    part.solid.label = part.title
    with kernel_errors(name):
        b.export_step(part.solid, path, timestamp="1970-01-01T00:00:00")
        back = [float(s.volume) for s in b.import_step(path).solids()]
    if len(back) != 1 or not np.allclose(back, float(part.solid.volume), rtol=1e-6):
        raise GeometryError(f"read back its solids have {back} mm³, written were {float(part.solid.volume)} mm³", name)
