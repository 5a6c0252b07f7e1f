"""A pad as STL, 3MF, STEP and GLB, each read back after writing."""

import csv
import io
import itertools
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from padgen.core import cache
from padgen.core.errors import GeometryError, number
from padgen.planner.plan import Channel, Plan
from padgen.planner.screws import screw_for
from padgen.planner.tile import to_cell
from padgen.planner.tray import plan_tray
from padgen.solid.border import washer_mesh
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.mesh import Mesh, signed_volume_mm3
from padgen.solid.pad_solid import PadSolid
from padgen.solid.taxel import taxel_solid, washer_solid
from padgen.solid.tile_store import taxel_key

__all__ = ["bill_of_materials", "glb_bytes", "stl_bytes", "stl_mesh", "verified", "verified_volume", "write_taxel_step"]

_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STEP_KIND = "taxel-step"
_UNNAMED = "unnamed taxel of padgen"
"""In place of the pad's name and the channel's number, in what is kept."""
REREAD_SHARE = 1e-4
"""Largest relative difference in volume of a file from the mesh: single precision, many triangles."""
REREAD_MM = 5e-5
"""Single precision of coordinates up to 500 mm."""


def stl_bytes(mesh: Mesh, title: str) -> bytes:
    """Binary STL."""
    triangles = np.zeros(len(mesh.triangles), _STL_TRIANGLE)
    corners = mesh.corners_mm
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    triangles["normal"] = normal / np.maximum(size, 1e-30)
    triangles["corners"] = corners
    header = f"padgen {title}".encode("ascii", "replace")[:80].ljust(80)
    return header + np.uint32(len(triangles)).tobytes() + triangles.tobytes()


def stl_mesh(data: bytes) -> Mesh:
    """The triangles of a binary STL, not welded."""
    triangles = np.frombuffer(data, _STL_TRIANGLE, offset=84)
    corners = triangles["corners"].astype(float).reshape(-1, 3)
    return Mesh(corners, np.arange(len(corners)).reshape(-1, 3))


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
    moved = np.abs(mesh.corners_mm - written.corners_mm).max(initial=0.0)
    if not moved <= REREAD_MM:
        raise GeometryError(f"read back a corner has moved by {number(float(moved))} mm", name)


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


def write_taxel_step(plan: Plan, channel: Channel, path: Path) -> None:
    """Write the STEP file of a channel's taxel.

    Two named solids in the taxel's own axes: ``printed``, the taxel in the frame of its sub-cell, and
    ``washer`` where the glue holds it. Read back, they must have the same volumes. Kept like the taxel's
    triangles (`padgen.solid.tile_store`).
    """
    writer = cache.code_hash("solid/export.py")
    key = taxel_key(plan, channel, washer=asdict(plan.spec.washer), step=_UNNAMED, writer=writer)

    def made() -> bytes:
        text = _step(plan, channel, path).encode()
        cache.store_bytes(STEP_KIND, key, text)
        return text

    known = cache.once(STEP_KIND, key, lambda: _known_step(key), made)
    path.write_bytes(known.replace(_UNNAMED.encode(), f"{plan.name} taxel {channel.index}".encode()))


def _known_step(key: str) -> bytes | None:
    """The STEP text that is kept, None where that is none."""
    data = cache.load_bytes(STEP_KIND, key)
    if data is None or not data.startswith(b"ISO-10303-21;") or not data.rstrip().endswith(b"END-ISO-10303-21;"):
        return None
    return data if _UNNAMED.encode() in data else None


def _step(plan: Plan, channel: Channel, path: Path) -> str:
    """The STEP text of a taxel, `_UNNAMED`, written to `path` on the way."""
    printed, washer = taxel_solid(plan, channel), washer_solid(plan, channel)
    b, name = build123d(), f"taxel-{channel.index}.step"
    printed.label, washer.label = "printed", "washer"
    with kernel_errors(name):
        whole = b.Compound(label=_UNNAMED, children=[printed, washer])
        b.export_step(whole, path, timestamp="1970-01-01T00:00:00")
        text = _renumbered(path.read_text())
        path.write_text(text)
        back = sorted(float(s.volume) for s in b.import_step(path).solids())
    planned = sorted((float(printed.volume), float(washer.volume)))
    if len(back) != 2 or not np.allclose(back, planned, rtol=1e-6):
        raise GeometryError(f"read back its solids have {back} mm³, written were {planned} mm³", name)
    return text


def _renumbered(step: str) -> str:
    """OCCT numbers the parts of an assembly through all files of a process; number them from 1 in each."""
    count = itertools.count(1)
    return re.sub(r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\(')\d+'", lambda match: f"{match[1]}{next(count)}'", step)


def glb_bytes(plan: Plan, pad: PadSolid) -> bytes:
    """The pad and its washers as binary glTF, in metres, y up, as viewers expect."""
    import trimesh

    turn = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], float)
    turn[:3] *= 1e-3
    scene = trimesh.Scene()
    colours = {"pad": (225, 222, 214, 255), "washer": (120, 125, 135, 255)}
    scene.add_geometry(_coloured(pad.mesh, colours["pad"]), geom_name="pad", node_name="pad", transform=turn)
    for channel in plan.channels:
        washer = washer_mesh(plan, channel)
        vertices = to_cell(washer.vertices_mm, channel)
        centre = to_cell(np.array([float(plan.arrangement(channel).washer_x_mm), 0.0, 0.0]), channel)
        part = _coloured(Mesh(vertices, washer.triangles), colours["washer"])
        for taxel in plan.taxels:
            if taxel.channel == channel.index:
                place = np.eye(4)
                place[:2, 3] = np.array([taxel.x_mm, taxel.y_mm]) - centre[:2]
                scene.add_geometry(
                    part, geom_name=f"washer-{channel.index}", node_name=f"washer-{taxel.id}", transform=turn @ place
                )
    data = scene.export(file_type="glb")
    back = trimesh.load(trimesh.util.wrap_as_stream(data), file_type="glb")
    if len(back.graph.nodes_geometry) != 1 + len(plan.taxels):
        raise GeometryError("read back it lacks parts", "pad.glb")
    return bytes(data)


def _coloured(mesh: Mesh, rgba: tuple[int, int, int, int]) -> Any:
    import trimesh

    material = trimesh.visual.material.PBRMaterial(baseColorFactor=rgba, metallicFactor=0.0, roughnessFactor=0.8)
    part = trimesh.Trimesh(mesh.vertices_mm, mesh.triangles, process=False)
    part.visual = trimesh.visual.TextureVisuals(material=material)
    return part


def _screw_text(plan: Plan, tray: bool) -> str:
    """Which screws: with a tray, of the length that it takes."""
    pad = plan.spec.pad
    screw = screw_for(pad.hole_diameter_mm, pad.frame_thickness_mm, plan_tray(plan).height_mm) if tray else None
    holes = f"for {number(pad.hole_diameter_mm)} mm holes"
    return holes if screw is None else f"{screw.name} x {number(screw.length_mm)} mm {holes}"


def bill_of_materials(plan: Plan, plastic_g: float, parts_g: Mapping[str, float] | None = None) -> str:
    """What to buy, as CSV; `parts_g` is the plastic of parts that are printed beside the pad, by name."""
    spec = plan.spec
    coils = plan.coils.rows * plan.coils.columns
    washer, coil = spec.washer, spec.coil
    rows = [
        ("item", "quantity", "unit", "what"),
        (
            "washer",
            len(plan.taxels),
            "pieces",
            f"{washer.name}: {number(washer.outer_diameter_mm)} x {number(washer.inner_diameter_mm)} x"
            f" {number(washer.thickness_mm)} mm",
        ),
        (
            "coil",
            coils,
            "pieces",
            f"{coil.name}: {number(coil.outer_diameter_mm)} mm diameter {number(coil.length_mm)} mm long"
            f" {number(coil.resistance_ohm)} ohm {number(coil.inductance_mh)} mH",
        ),
        ("plastic", f"{plastic_g:.2f}", "g", f"pad: {spec.material.name} on {spec.printer.name}"),
        *(("plastic", f"{grams:.2f}", "g", f"{name}: at full infill") for name, grams in (parts_g or {}).items()),
        ("screw", 4 if spec.pad.hole_diameter_mm else 0, "pieces", _screw_text(plan, "tray" in (parts_g or {}))),
    ]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
