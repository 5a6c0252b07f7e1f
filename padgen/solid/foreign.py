"""Checks of a mesh file that any program may have written: read, welded, recognised, judged."""

import io
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from padgen.core.errors import Finding, InfeasibleError, MeshFileError
from padgen.core.files import read_bounded, reason
from padgen.planner import Plan
from padgen.solid.checks import Report, check_against, check_mesh
from padgen.solid.compare import Pose, pose_of
from padgen.solid.formats._3mf import LARGEST_FILE, MOST_TRIANGLES, read_3mf
from padgen.solid.mesh import Mesh, sound_mesh
from padgen.solid.pad_solid import PadSolid, build_pad
from padgen.solid.parts import TraySolid, build_coupon, build_tray, check_tray
from padgen.spec import Spec

__all__ = ["check_foreign", "read_mesh"]

LEAST_LIKENESS = 0.2
"""Least likeness of a mesh to a part (share of the part's corners found, less the difference in size)."""
SURE_LIKENESS = {"pad": 0.999, "coupon": 0.5, "tray": 0.5, "coupon-tray": 0.0}
"""Likeness from which no further parts are tried, by part. Trays come last, as they load the CAD kernel."""


def read_mesh(path: Path) -> Mesh:
    """Read an STL, 3MF, OBJ or PLY file as a welded mesh; coordinates of all but 3MF are taken as millimetres.

    Raises
    ------
    MeshFileError
        The file is not there, not a mesh, or holds no triangles.
    """
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
    if kind == ".stl" and len(data) >= 84 and data[:5] != b"solid":
        promised, held = int.from_bytes(data[80:84], "little"), (len(data) - 84) // 50
        if held < promised:
            raise MeshFileError(f"is cut short: it promises {promised} triangles and holds {held}", str(path))
    import trimesh

    try:
        # From memory, so that trimesh opens no other file which this one names.
        part = trimesh.load(io.BytesIO(data), file_type=kind[1:], force="mesh", process=False)
    except Exception as error:  # trimesh's readers raise errors of many kinds
        raise MeshFileError(f"is not a mesh that can be read ({error or type(error).__name__})", str(path)) from error
    if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
        raise MeshFileError("holds no triangles", str(path))
    if len(part.faces) > MOST_TRIANGLES:
        raise MeshFileError(f"has more than {MOST_TRIANGLES} triangles", str(path))
    return sound_mesh(np.asarray(part.vertices, float), np.asarray(part.faces, np.int64), str(path))


def check_foreign(mesh: Mesh, spec: Spec, plan: Plan | None) -> Report:
    """Check a mesh against the limits of the spec's printer and, where given, against the `plan`.

    Its corners tell which part of the plan it is (the pad, its coupon, or a tray for either) and how it lies.
    """
    printer, density = spec.printer, spec.material.density_g_per_cm3
    limits = {"limits_of": printer.name}
    found = None if plan is None else _recognised(mesh, plan)
    if plan is None or found is None:
        report = check_mesh(mesh, printer, density)
        unknown = Finding(
            "error",
            "built.other",
            "mesh",
            f"it is neither the pad {spec.name} nor its coupon nor a tray for either; name the spec or plan.json that"
            " it was built by",
        )
        return Report(report.figures | limits, (*report.findings, *([] if plan is None else [unknown])))
    name, own, planned, pose = found
    laid = pose.laid(mesh)
    report = check_tray(planned, own, laid) if isinstance(planned, TraySolid) else check_against(laid, planned, own)
    return Report(report.figures | limits | {"part": name}, (*pose.findings(), *report.findings))


def _recognised(mesh: Mesh, plan: Plan) -> tuple[str, Plan, PadSolid | TraySolid, Pose] | None:
    """Recognise the part that a mesh shows; return its name, plan, solid and the mesh's pose, or None."""
    best, most = None, LEAST_LIKENESS
    for name, own, planned in _parts(plan):
        pose = pose_of(mesh, planned.mesh)
        # All corners of a coupon are found in a pad of one coil: only the size tells the two apart.
        sizes = [np.sort(np.ptp(each.vertices_mm, axis=0)) for each in (pose.laid(mesh), planned.mesh)]
        likeness = pose.share - min(float(np.abs(sizes[0] / sizes[1] - 1).max()), 0.5)
        if likeness > most:
            best, most = (name, own, planned, pose), likeness
        if most > SURE_LIKENESS[name]:
            break
    return best


def _parts(plan: Plan) -> Iterator[tuple[str, Plan, PadSolid | TraySolid]]:
    yield "pad", plan, build_pad(plan)
    coupon, solid = build_coupon(plan)
    yield "coupon", coupon, solid
    for name, over in (("tray", plan), ("coupon-tray", coupon)):
        with suppress(InfeasibleError):
            yield name, over, build_tray(over)
