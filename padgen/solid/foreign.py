"""Checks of a mesh file from anywhere: read by trimesh or lib3mf, welded, judged."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from padgen.core.errors import MeshFileError
from padgen.core.files import read_bounded, reason, recover
from padgen.planner import Plan
from padgen.solid.checks import Report, check_mesh, compare_mesh
from padgen.solid.formats._3mf import LARGEST_FILE, MOST_TRIANGLES, read_3mf
from padgen.solid.mesh import Mesh, joined, sound_mesh
from padgen.spec import Spec

__all__ = ["check_foreign", "read_mesh"]


def read_mesh(path: Path) -> Mesh:
    """Triangles of an STL, 3MF, OBJ or PLY, welded; all but 3MF are taken as millimetres.

    Raises
    ------
    MeshFileError
        The file is not there, not a mesh, or holds no triangles.
    """
    recover(path.parent)
    try:
        if not path.is_file():
            raise MeshFileError("is not a file" if path.exists() else "there is no such file", str(path))
    except OSError as error:
        raise MeshFileError(f"cannot be read ({reason(error)})", str(path)) from error
    kind = path.suffix.lower()
    if kind == ".3mf":
        return read_3mf(path)
    if kind not in (".stl", ".obj", ".ply"):
        raise MeshFileError("is not a mesh that can be checked; must be an STL, 3MF, OBJ or PLY file", str(path))
    data = read_bounded(path, LARGEST_FILE, "a mesh")
    if kind == ".stl":
        _refuse_cut_short(data, path)
    import trimesh

    try:
        # From memory, so that it opens no other file that this one names.
        part = trimesh.load(io.BytesIO(data), file_type=kind[1:], force="mesh", process=False)
    except Exception as error:  # trimesh lets through whatever its many readers raise
        raise MeshFileError(f"is not a mesh that can be read ({error or type(error).__name__})", str(path)) from error
    if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
        raise MeshFileError("holds no triangles", str(path))
    if len(part.faces) > MOST_TRIANGLES:
        raise MeshFileError(f"has more than {MOST_TRIANGLES} triangles", str(path))
    mesh = sound_mesh(np.asarray(part.vertices, float), np.asarray(part.faces, np.int64), str(path))
    return joined(mesh, str(path))


def _refuse_cut_short(data: bytes, path: Path) -> None:
    """Binary STL says how many triangles it holds."""
    if len(data) < 84 or data[:5] == b"solid":
        return
    promised, held = int.from_bytes(data[80:84], "little"), (len(data) - 84) // 50
    if held < promised:
        raise MeshFileError(f"is cut short: it promises {promised} triangles and holds {held}", str(path))


def check_foreign(mesh: Mesh, spec: Spec, plan: Plan | None) -> Report:
    """Check a mesh against the limits of the spec's printer and, where there is one, against the `plan`."""
    report = check_mesh(mesh, spec.printer, spec.material.density_g_per_cm3)
    report = replace(report, figures={**report.figures, "limits_of": spec.printer.name})
    return report if plan is None else compare_mesh(report, mesh, plan)
