"""Checks of a mesh file from anywhere: read by trimesh or lib3mf, welded, judged."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from padgen.errors import MeshFileError
from padgen.planner import Plan
from padgen.solid.checks import Report, check_mesh, compare_mesh
from padgen.solid.mesh import Mesh, welded
from padgen.spec import Spec

__all__ = ["check_foreign", "read_mesh"]

WELD_MM = 1e-5
LARGEST_MM = 1e4


def read_mesh(path: Path) -> Mesh:
    """Triangles of an STL, 3MF, OBJ or PLY, welded; all but 3MF are taken as millimetres.

    Raises
    ------
    MeshFileError
        The file is not there, not a mesh, or holds no triangles.
    """
    if not path.is_file():
        raise MeshFileError("there is no such file" if not path.exists() else "is not a file", str(path))
    if path.suffix.lower() == ".3mf":
        from padgen.solid.threemf import read_3mf

        return read_3mf(path)
    if path.suffix.lower() not in (".stl", ".obj", ".ply"):
        raise MeshFileError("is not a mesh that can be checked; must be an STL, 3MF, OBJ or PLY file", str(path))
    _refuse_cut_short(path)
    import trimesh

    try:
        part = trimesh.load(path, force="mesh", process=False)
    except Exception as error:  # trimesh lets through whatever its many readers raise
        raise MeshFileError(f"is not a mesh that can be read ({error or type(error).__name__})", str(path)) from error
    if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
        raise MeshFileError("holds no triangles", str(path))
    vertices, faces = np.asarray(part.vertices, float), np.asarray(part.faces, np.int64)
    if not (np.abs(vertices) <= LARGEST_MM).all():
        raise MeshFileError(f"has coordinates beyond {LARGEST_MM:g} mm, or none at all", str(path))
    return welded(vertices, faces, WELD_MM)


def _refuse_cut_short(path: Path) -> None:
    """Binary STL says how many triangles it holds."""
    with path.open("rb") as file:
        head = file.read(84)
    if path.suffix.lower() != ".stl" or len(head) < 84 or head[:5] == b"solid":
        return
    promised, held = int.from_bytes(head[80:], "little"), (path.stat().st_size - 84) // 50
    if held < promised:
        raise MeshFileError(f"is cut short: it promises {promised} triangles and holds {held}", str(path))


def check_foreign(mesh: Mesh, spec: Spec, plan: Plan | None) -> Report:
    """Check a mesh against the limits of the spec's printer and, where there is one, against the `plan`."""
    report = check_mesh(mesh, spec.printer, spec.material.density_g_per_cm3)
    report = replace(report, figures={**report.figures, "limits_of": spec.printer.name})
    return report if plan is None else compare_mesh(report, mesh, plan)
