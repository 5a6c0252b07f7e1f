"""Pad formats: each file here writes pads and parts in one format for slicers, viewers or CAD, found by its name.

A format whose name begins with a digit has an underscore before its file's name: ``_3mf.py`` is ``3mf``. Formats from
elsewhere are added by `register`. A format has the functions of `PadFormat` and is given an `ExportJob`.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from padgen.core.errors import GeometryError, number
from padgen.core.registry import PAD_FORMATS
from padgen.solid.mesh import AT_ONCE, Mesh, signed_volume_mm3

if TYPE_CHECKING:
    from padgen.core.files import OutputFolder
    from padgen.planner.plan import Plan
    from padgen.solid.checks import Report
    from padgen.solid.pad_solid import PadSolid

__all__ = [
    "REREAD_MM",
    "ExportJob",
    "PadFormat",
    "Part",
    "register",
    "unregister",
    "verify_volume",
    "verify_written",
]

REREAD_SHARE = 1e-4
"""Largest allowed relative difference in volume of a file from the mesh: single precision, many triangles."""
REREAD_MM = 1e-4
"""Single precision of coordinates up to 1000 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """The pad, or a part printed beside it (tray, coupon, guard plate), with the name, mesh and texts to export.

    `name` is that of its files, `title` and `description` are written into them. `mesh` is in mm; `solid` is the
    build123d solid, None where there is only the mesh. `report` has the checks; it is None for the pad, which is
    written while it is checked.
    """

    name: str
    title: str
    description: str
    mesh: Mesh
    solid: Any
    report: "Report | None"


@dataclass(frozen=True, slots=True, eq=False)
class ExportJob:
    """One part to write in a file format, with the plan, the spec's hash and, for the pad, its modelled solid.

    `plan` is the pad's plan and `spec_hash` that of its spec. `pad` has the pad's distinct tiles; it is None for parts
    beside the pad. With `instances`, a format that can do so stores each tile once and places it many times.
    """

    plan: "Plan"
    part: Part
    spec_hash: str
    pad: "PadSolid | None" = None
    instances: bool = False


class PadFormat(Protocol):
    """Protocol of a pad format: a module, or any object, with a function `write`."""

    def write(self, out: "OutputFolder", job: ExportJob) -> None:
        """Add the files of the job's part to `out`, none where the format cannot hold the part.

        Files are read back where that is possible. A file that differs from the part raises GeometryError; then
        nothing is kept.
        """


register = PAD_FORMATS.register
unregister = PAD_FORMATS.unregister


def verify_written(name: str, mesh: Mesh, written: Mesh) -> None:
    """Raise GeometryError if the mesh `written` in file `name` differs from `mesh` beyond single precision.

    Raises
    ------
    GeometryError
        The triangles differ.
    """
    if len(mesh.triangles) != len(written.triangles):
        raise GeometryError(
            f"read back, it has {len(written.triangles)} triangles, must have {len(mesh.triangles)}", name
        )
    moved = 0.0
    for k in range(0, len(mesh.triangles), AT_ONCE):
        here, there = (each.vertices_mm[each.triangles[k : k + AT_ONCE]] for each in (mesh, written))
        moved = max(moved, float(np.abs(here - there).max()))
    if not moved <= REREAD_MM:
        raise GeometryError(f"read back, a corner has moved by {number(moved)} mm", name)


def verify_volume(name: str, mesh: Mesh, written: Mesh) -> None:
    """Raise GeometryError if the mesh `written`, read back from file `name`, differs in volume from `mesh`.

    Raises
    ------
    GeometryError
        The volumes differ.
    """
    before = signed_volume_mm3(mesh)
    after = signed_volume_mm3(written)
    if not abs(after / before - 1) <= REREAD_SHARE:
        raise GeometryError(f"read back, its volume is {number(after)} mm³, must be {number(before)} mm³", name)
