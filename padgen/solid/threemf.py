"""The pad as 3MF, by lib3mf: millimetres, name, metadata, thumbnail; reading any 3MF."""

import ctypes
import io
import struct
import zipfile
from functools import cache
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_DNS, uuid5

import numpy as np

from padgen.core.errors import FileError, MeshFileError
from padgen.planner.plan import Plan
from padgen.solid.mesh import Mesh, joined, sound_mesh
from padgen.solid.pad_solid import PadSolid, turned_grid
from padgen.solid.threemf_package import unpacked

__all__ = ["part_3mf_bytes", "read_3mf", "threemf_bytes"]

_NAMESPACE = uuid5(NAMESPACE_DNS, "padgen")
"""Root of the name-based UUIDs: the same pad has the same ones."""


def threemf_bytes(plan: Plan, pad: PadSolid, metadata: dict[str, str], thumbnail_png: bytes, instances: bool) -> bytes:
    """The pad as one named object, or with `instances` as one mesh per distinct tile, placed many times."""
    if not instances:
        return part_3mf_bytes(plan.name, pad.mesh, metadata, thumbnail_png)
    model, wrapper = _new_model(metadata)
    _add_instances(model, wrapper, plan, pad)
    return _package(model, plan.name, thumbnail_png)


def part_3mf_bytes(name: str, mesh: Mesh, metadata: dict[str, str], thumbnail_png: bytes) -> bytes:
    """A part as one named object."""
    model, wrapper = _new_model(metadata)
    model.AddBuildItem(_add_mesh(model, mesh, name), wrapper.GetIdentityTransform())
    return _package(model, name, thumbnail_png)


def _new_model(metadata: dict[str, str]) -> tuple[Any, Any]:
    """An empty model in millimetres, and the library's wrapper that made it."""
    wrapper = _wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(_lib3mf().ModelUnit.MilliMeter)
    notes = model.GetMetaDataGroup()
    for key, value in metadata.items():
        space, _, name = key.rpartition(":")
        notes.AddMetaData(space, name, value, "xs:string", True)
    return model, wrapper


def _package(model: Any, name: str, thumbnail_png: bytes) -> bytes:
    picture = (ctypes.c_uint8 * len(thumbnail_png)).from_buffer_copy(thumbnail_png)
    model.CreatePackageThumbnailAttachment().ReadFromBuffer(picture)
    _name_uuids(model, name)
    data = bytes(model.QueryWriter("3mf").WriteToBuffer())
    return _without_times(data)


def read_3mf(path: Path, weld: bool = True) -> Mesh:
    """All triangles of the build items of a 3MF in mm, instances placed, parts joined where they touch.

    Raises
    ------
    MeshFileError
        The file is not a 3MF, or holds no triangle.
    """
    model = _wrapper().CreateModel()
    try:
        data = unpacked(path)
        model.QueryReader("3mf").ReadFromBuffer((ctypes.c_uint8 * len(data)).from_buffer_copy(data))
    except FileError:
        raise
    except Exception as error:  # zip, deflate, XML and lib3mf have one each
        raise MeshFileError(f"is not a 3MF that can be read ({error})", str(path)) from error
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    items = model.GetBuildItems()
    while items.MoveNext():
        item = items.GetCurrent()
        with np.errstate(all="ignore"):  # what no longer is a number is refused
            _collect(model, item.GetObjectResource(), _matrix(item.GetObjectTransform()), parts)
    if not parts:
        raise MeshFileError("holds no triangles", str(path))
    scale = _MM_PER_UNIT[model.GetUnit()]
    counts = np.cumsum([0] + [len(v) for v, _ in parts])
    vertices = np.concatenate([v for v, _ in parts]) * scale
    triangles = np.concatenate([t + n for (_, t), n in zip(parts, counts, strict=False)])
    mesh = sound_mesh(vertices, triangles, str(path))
    return joined(mesh, str(path)) if weld else mesh


_MM_PER_UNIT = (1e-3, 1.0, 10.0, 25.4, 304.8, 1000.0)


def _lib3mf() -> Any:
    from lib3mf import Lib3MF

    return Lib3MF


@cache
def _wrapper() -> Any:
    """The library, loaded once: it looks up a thousand functions."""
    return _lib3mf().Wrapper()


def _add_mesh(model: Any, mesh: Mesh, name: str) -> Any:
    lib3mf = _lib3mf()
    part = model.AddMeshObject()
    part.SetName(name)
    vertices = np.ascontiguousarray(mesh.vertices_mm, np.float32)
    triangles = np.ascontiguousarray(mesh.triangles, np.uint32)
    part.SetGeometry(
        (lib3mf.Position * len(vertices)).from_buffer(vertices),
        (lib3mf.Triangle * len(triangles)).from_buffer(triangles),
    )
    return part


def _add_instances(model: Any, wrapper: Any, plan: Plan, pad: PadSolid) -> None:
    spec, turned = plan.spec, turned_grid(plan)
    names = [f"taxel-{channel.index}" for channel in plan.channels] + ["frame"]
    whole = model.AddComponentsObject()
    whole.SetName(plan.name)
    whole.AddComponent(_add_mesh(model, pad.border.mesh, "border"), wrapper.GetIdentityTransform())
    for index, tile in enumerate(pad.tiles):
        places = np.argwhere(pad.grid == index)
        if not len(places):
            continue
        part = _add_mesh(model, tile.mesh, names[index])
        for row, column in places:
            place = wrapper.GetIdentityTransform()
            if turned[row, column]:
                place.Fields[0][0] = place.Fields[1][1] = -1.0
            x = (column + 0.5) * plan.cell.width_mm - spec.pad.width_mm / 2
            y = (row + 0.5) * plan.cell.depth_mm - spec.pad.depth_mm / 2
            place.Fields[3][0], place.Fields[3][1] = float(x), float(y)
            whole.AddComponent(part, place)
    model.AddBuildItem(whole, wrapper.GetIdentityTransform())


def _name_uuids(model: Any, name: str) -> None:
    """lib3mf draws random UUIDs; name-based ones keep the bytes the same."""
    model.SetBuildUUID(str(uuid5(_NAMESPACE, f"{name}/build")))
    resources = model.GetObjects()
    count = 0
    while resources.MoveNext():
        part = resources.GetCurrentObject()
        part.SetUUID(str(uuid5(_NAMESPACE, f"{name}/object/{count}")))
        if part.IsComponentsObject():
            components = model.GetComponentsObjectByID(part.GetUniqueResourceID())
            for i in range(components.GetComponentCount()):
                components.GetComponent(i).SetUUID(str(uuid5(_NAMESPACE, f"{name}/component/{i}")))
        count += 1
    items = model.GetBuildItems()
    while items.MoveNext():
        items.GetCurrent().SetUUID(str(uuid5(_NAMESPACE, f"{name}/item")))


def _without_times(data: bytes) -> bytes:
    """The same package with its zip entries dated 1980-01-01, the earliest that a zip knows.

    lib3mf dates them at month 0. Only the dates are written over: to pack anew takes as long as to write.
    """
    result = bytearray(data)
    with zipfile.ZipFile(io.BytesIO(data)) as package:
        at, entries = package.start_dir, package.infolist()
    for entry in entries:
        _DOS_TIME.pack_into(result, entry.header_offset + 10, 0, _DOS_DAY)
        _DOS_TIME.pack_into(result, at + 12, 0, _DOS_DAY)
        # Behind a fixed part follow name, extra field and comment.
        at += 46 + sum(struct.unpack_from("<HHH", data, at + 28))
    return bytes(result)


_DOS_TIME = struct.Struct("<HH")
_DOS_DAY = 1 << 5 | 1
"""The first day of the first month of 1980."""


def _matrix(transform: Any) -> np.ndarray:
    return np.array([list(row) for row in transform.Fields])


def _collect(model: Any, part: Any, matrix: np.ndarray, parts: list[tuple[np.ndarray, np.ndarray]]) -> None:
    if part.IsComponentsObject():
        components = model.GetComponentsObjectByID(part.GetUniqueResourceID())
        for i in range(components.GetComponentCount()):
            component = components.GetComponent(i)
            inner = _matrix(component.GetTransform())
            turned = inner[:3] @ matrix[:3]
            moved = inner[3] @ matrix[:3] + matrix[3]
            _collect(model, component.GetObjectResource(), np.vstack([turned, moved]), parts)
        return
    mesh = model.GetMeshObjectByID(part.GetUniqueResourceID())
    vertices, triangles = _arrays(mesh)
    if len(triangles):
        parts.append((vertices @ matrix[:3] + matrix[3], triangles))


def _arrays(mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (T, 3) of a mesh object, in one copy each.

    The wrapper's ``GetVertices`` would make a Python object of each.
    """
    lib3mf, wrapper, handle = _lib3mf(), mesh._wrapper, mesh._handle
    vertices = (lib3mf.Position * mesh.GetVertexCount())()
    triangles = (lib3mf.Triangle * mesh.GetTriangleCount())()
    for part, get in (
        (vertices, wrapper.lib.lib3mf_meshobject_getvertices),
        (triangles, wrapper.lib.lib3mf_meshobject_gettriangleindices),
    ):
        needed = ctypes.c_uint64(0)
        wrapper.checkError(mesh, get(handle, ctypes.c_uint64(len(part)), needed, part))
    at = np.frombuffer(vertices, np.float32) if len(vertices) else np.empty(0)
    corners = np.frombuffer(triangles, np.uint32) if len(triangles) else np.empty(0)
    return at.reshape(-1, 3).astype(float), corners.reshape(-1, 3).astype(np.int64)
