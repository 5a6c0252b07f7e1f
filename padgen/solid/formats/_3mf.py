"""3MF by lib3mf: millimetres, name, metadata, thumbnail; reading any 3MF, judged before lib3mf meets it.

A few hundred bytes can ask for 10^38 parts, each a component of the next, and deflate packs a thousandfold. lib3mf
follows both to the end, so a package is unpacked here within bounds, and how often its parts are placed is counted.
"""

import ctypes
import io
import struct
import zipfile
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_DNS, uuid5
from xml.parsers import expat

import numpy as np

from padgen import __version__
from padgen.core.errors import FileError, MeshFileError
from padgen.core.files import OutputFolder, read_bounded
from padgen.planner.plan import Plan
from padgen.planner.printing import prusa_profile
from padgen.solid.formats import ExportJob, verified, verified_volume
from padgen.solid.mesh import Mesh, joined, sound_mesh
from padgen.solid.pad_solid import PadSolid, turned_grid
from padgen.solid.picture import picture_png

__all__ = ["LARGEST_FILE", "MOST_TRIANGLES", "read_3mf", "threemf_bytes", "write"]

LARGEST_FILE = LARGEST_UNPACKED = 1 << 28
"""Bytes of a file that holds a mesh, and of a 3MF's parts unpacked."""
MOST_TRIANGLES = 2_000_000
"""Placed, instances counted each: some times as many as 512 taxels have."""
MOST_PARTS, DEEPEST = 50_000, 64
"""Meshes and components placed, and components within one another."""

Key = tuple[str, str]
"""An object: the part of the package that it lies in, and its number there."""

_NAMESPACE = uuid5(NAMESPACE_DNS, "padgen")
"""Root of the name-based UUIDs: the same pad has the same ones."""
OWN = "https://padgen.invalid/2026"
"""Namespace of the metadata that only padgen has."""
PRUSA_CONFIG = "/Metadata/Slic3r_PE.config"
"""Where PrusaSlicer looks for the settings of a project."""
THUMBNAIL_PX = (256, 256)
COLOUR = (0.90, 0.88, 0.82)


def write(out: OutputFolder, job: ExportJob) -> None:
    """Add the part's mesh, read back corner by corner, or where it is stored in instances by its volume."""
    name, instances = f"{job.part.name}.3mf", job.instances and job.pad is not None
    path = out.write(name, threemf_bytes(job))
    (verified_volume if instances else verified)(name, job.part.mesh, read_3mf(path, weld=instances))


def threemf_bytes(job: ExportJob) -> bytes:
    """The part as one named object, or the pad in instances: one mesh per distinct tile, placed many times."""
    wrapper, title = _wrapper(), job.part.title
    model = wrapper.CreateModel()
    model.SetUnit(_lib3mf().ModelUnit.MilliMeter)
    notes = model.GetMetaDataGroup()
    for key, value in _metadata(job).items():
        space, _, name = key.rpartition(":")
        notes.AddMetaData(space, name, value, "xs:string", True)
    printer = job.plan.spec.printer
    whole = (
        _instances(model, wrapper, job.plan, job.pad)
        if job.instances and job.pad is not None
        else _add_mesh(model, job.part.mesh, title)
    )
    model.AddBuildItem(whole, wrapper.GetTranslationTransform(printer.bed_x_mm / 2, printer.bed_y_mm / 2, 0.0))
    if profile := prusa_profile(job.plan.spec):
        model.AddCustomContentType("config", "text/plain")
        # PrusaSlicer skips the first line.
        lines = ("; settings for PrusaSlicer", *(f"; {key} = {value}" for key, value in profile.items()), "")
        config = "\n".join(lines).encode()
        attached = model.AddAttachment(PRUSA_CONFIG, f"{OWN}/slicer-config")
        attached.ReadFromBuffer((ctypes.c_uint8 * len(config)).from_buffer_copy(config))
    thumbnail = picture_png([(job.part.mesh, COLOUR)], THUMBNAIL_PX)
    picture = (ctypes.c_uint8 * len(thumbnail)).from_buffer_copy(thumbnail)
    model.CreatePackageThumbnailAttachment().ReadFromBuffer(picture)
    _name_uuids(model, title)
    return _without_times(bytes(model.QueryWriter("3mf").WriteToBuffer()))


def _metadata(job: ExportJob) -> dict[str, str]:
    """3MF metadata; names of our own carry our namespace, as the format asks."""
    return {
        "Title": job.part.title,
        "Application": f"padgen {__version__}",
        "LicenseTerms": "the pad is yours; padgen is Apache-2.0",
        "Description": job.part.description,
        f"{OWN}:SpecHash": job.spec_hash,
        f"{OWN}:PrintSettings": "; ".join(f"{key} {value}" for key, value in job.plan.printing.items()),
    }


def read_3mf(path: Path, weld: bool = True) -> Mesh:
    """All triangles of the build items of a 3MF in mm, instances placed, parts joined where they touch.

    An only item lies about its own origin, wherever it is put on the bed.

    Raises
    ------
    MeshFileError
        The file is not a 3MF, or holds no triangle.
    """
    model = _wrapper().CreateModel()
    try:
        data = _unpacked(path)
        model.QueryReader("3mf").ReadFromBuffer((ctypes.c_uint8 * len(data)).from_buffer_copy(data))
    except FileError:
        raise
    except Exception as error:  # zip, deflate, XML and lib3mf have one each
        raise MeshFileError(f"is not a 3MF that can be read ({error})", str(path)) from error
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    items = model.GetBuildItems()
    while items.MoveNext():
        item = items.GetCurrent()
        matrix = _matrix(item.GetObjectTransform())
        if items.Count() == 1:  # where it lies on the bed
            matrix[3] = 0.0
        with np.errstate(all="ignore"):  # what no longer is a number is refused
            _collect(model, item.GetObjectResource(), matrix, parts)
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


def _instances(model: Any, wrapper: Any, plan: Plan, pad: PadSolid) -> Any:
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
    return whole


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


def _unpacked(path: Path) -> bytes:
    """The package with its parts unpacked, so that whoever reads it meets no more than what was judged here.

    Raises
    ------
    MeshFileError
        It is no package, larger than its bounds, or places more than can be checked.
    """
    data, left = io.BytesIO(), LARGEST_UNPACKED
    objects = _Objects(str(path))
    with (
        zipfile.ZipFile(io.BytesIO(read_bounded(path, LARGEST_FILE, "a 3MF"))) as package,
        zipfile.ZipFile(data, "w", zipfile.ZIP_STORED) as plain,
    ):
        for entry in package.infolist():
            left -= entry.file_size  # of which no more is read, whatever is there
            if left < 0:
                raise MeshFileError(f"holds more than {LARGEST_UNPACKED} bytes unpacked", str(path))
            part = package.read(entry)
            if part.count(b"<") > 2 * MOST_TRIANGLES:
                raise MeshFileError(f"holds more than {MOST_TRIANGLES} triangles", str(path))
            if part.lstrip().startswith((b"<", b"\xef\xbb\xbf")):  # whatever its name
                objects.read(entry.filename, part)
            plain.writestr(zipfile.ZipInfo(entry.filename), part)
    objects.refuse()
    return data.getvalue()


class _Objects:
    """The objects of a package: how many triangles each has, and which components, how often."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._triangles: Counter[Key] = Counter()
        self._components: dict[Key, Counter[Key]] = {}
        self._items: Counter[Key] = Counter()
        self._known: dict[Key, tuple[int, int, int]] = {}

    def read(self, name: str, part: bytes) -> None:
        """Add the objects of a part, XML in UTF-8."""
        own, current = name.lstrip("/"), ("", "")

        def started(tag: str, attributes: dict[str, str]) -> None:
            nonlocal current
            match tag.rpartition(":")[2]:
                case "triangle":
                    self._triangles[current] += 1
                case "object":
                    current = own, attributes.get("id", "")
                    self._components[current] = Counter()
                case "component":
                    self._components.setdefault(current, Counter())[_named(own, attributes)] += 1
                case "item":
                    self._items[_named(own, attributes)] += 1

        def declared(*_: Any) -> None:
            raise ValueError("it declares a document type, which 3MF does not allow")

        parser = expat.ParserCreate("UTF-8")
        parser.StartElementHandler, parser.StartDoctypeDeclHandler = started, declared
        parser.Parse(part, True)

    def refuse(self) -> None:
        """Raise `MeshFileError` for more than can be checked."""
        # Objects that are never placed count as well, as lib3mf looks through each.
        everything = sum(self._size(key, 0)[1] for key in self._components)
        items = [(times, *self._size(key, 0)) for key, times in self._items.items()]
        if sum(times * parts for times, _, parts, _ in items) > MOST_PARTS or everything > DEEPEST * MOST_PARTS:
            raise MeshFileError(f"places more than {MOST_PARTS} parts", self._where)
        if sum(times * triangles for times, *_, triangles in items) > MOST_TRIANGLES:
            raise MeshFileError(f"places more than {MOST_TRIANGLES} triangles", self._where)

    def _size(self, key: Key, above: int) -> tuple[int, int, int]:
        """Of an object: how deep its components go, how many parts it places, and how many triangles."""
        known = self._known.get(key)
        if above + (known[0] if known else 0) > DEEPEST:
            raise MeshFileError(f"has components more than {DEEPEST} deep within one another", self._where)
        if known is None:
            depth, parts, triangles = 0, 1, self._triangles[key]
            for inner, times in self._components.get(key, {}).items():
                deeper, more, own = self._size(inner, above + 1)
                depth = max(depth, 1 + deeper)
                parts, triangles = parts + times * more, triangles + times * own
            known = self._known[key] = depth, parts, triangles
        return known


def _named(own: str, attributes: dict[str, str]) -> Key:
    """The object that a component or item names, perhaps in another part."""
    path = next((value for name, value in attributes.items() if name.rpartition(":")[2] == "path"), own)
    return path.lstrip("/"), attributes.get("objectid", "")
