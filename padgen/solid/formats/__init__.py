"""Files of a pad and of the parts beside it, for slicers, viewers and CAD: a format is one file here, found by name.

A name that begins with a digit has its file with an underscore before it: ``_3mf.py`` is ``3mf``. Others are added by
`register`. A format holds to `PadFormat`; what it is to write is its `ExportJob`.
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

__all__ = ["ExportJob", "PadFormat", "Part", "register", "unregister", "verified", "verified_volume"]

REREAD_SHARE = 1e-4
"""Largest relative difference in volume of a file from the mesh: single precision, many triangles."""
REREAD_MM = 5e-5
"""Single precision of coordinates up to 500 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """The pad, or a part beside it: `name` of its files, `title` and `description` in them, mesh in mm, and checks.

    `solid` is the build123d solid, None where there is only the mesh; `report` is None for the pad, which is written
    while it is checked.
    """

    name: str
    title: str
    description: str
    mesh: Mesh
    solid: Any
    report: "Report | None"


@dataclass(frozen=True, slots=True, eq=False)
class ExportJob:
    """The `part` that is to be written.

    `plan` is the pad's and `spec_hash` that of its spec; `pad` has the pad's distinct tiles, None for parts beside it.
    With `instances` each tile is to be stored once and placed many times, where a format can do so.
    """

    plan: "Plan"
    part: Part
    spec_hash: str
    pad: "PadSolid | None" = None
    instances: bool = False


class PadFormat(Protocol):
    """A format: a module, or any object, with this name."""

    def write(self, out: "OutputFolder", job: ExportJob) -> None:
        """Add the files of the job's part to `out`, read back where that can be; none of a part that it cannot hold.

        It raises GeometryError where a file is not what was to be written; then nothing is kept.
        """


def register(name: str, pad_format: PadFormat) -> None:
    """Add a format, which may be asked for from then on.

    Raises
    ------
    SpecError
        The name is taken or no name, or the format lacks something.
    """
    PAD_FORMATS.register(name, pad_format, PadFormat)


def unregister(name: str) -> None:
    """Take away a format that was registered."""
    PAD_FORMATS.unregister(name)


def verified(name: str, mesh: Mesh, written: Mesh) -> None:
    """Compare what a file holds with the mesh that was written, corner by corner in single precision.

    Raises
    ------
    GeometryError
        Its triangles differ.
    """
    if len(mesh.triangles) != len(written.triangles):
        raise GeometryError(
            f"read back it has {len(written.triangles)} triangles, written were {len(mesh.triangles)}", name
        )
    moved = 0.0
    for k in range(0, len(mesh.triangles), AT_ONCE):
        here, there = (each.vertices_mm[each.triangles[k : k + AT_ONCE]] for each in (mesh, written))
        moved = max(moved, float(np.abs(here - there).max()))
    if not moved <= REREAD_MM:
        raise GeometryError(f"read back a corner has moved by {number(moved)} mm", name)


def verified_volume(name: str, mesh: Mesh, written: Mesh) -> None:
    """Compare the volumes only, for files that hold the mesh in parts.

    Raises
    ------
    GeometryError
        The volumes differ.
    """
    before, after = signed_volume_mm3(mesh), signed_volume_mm3(written)
    if not abs(after / before - 1) <= REREAD_SHARE:
        raise GeometryError(f"read back its volume is {number(after)} mm³, written were {number(before)} mm³", name)
