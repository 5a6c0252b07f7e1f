"""The 3MF format: pads are written with name, metadata and thumbnail; files of any program are read by lib3mf.

A few hundred bytes can ask for 10^38 parts, each a component of the next, and deflate packs a thousandfold. lib3mf
follows both to the end. So before lib3mf reads a package, it is unpacked here within bounds, and its placed parts are
counted.
"""

import ctypes
import io
import zipfile
from collections import Counter
from collections.abc import Generator, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

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
"""Most bytes of a mesh file, and of a 3MF's parts unpacked."""
MOST_TRIANGLES = 2_000_000
"""Most triangles of a mesh file, each instance counted: several times as many as a pad of 512 taxels has."""
MOST_PARTS, DEEPEST = 50_000, 64
"""Most meshes and components that are placed, and most levels of components within each other."""

PRUSA_CONFIG = "Metadata/Slic3r_PE.config"
"""Path at which PrusaSlicer looks for the settings of a project."""
Key = tuple[str, str]
"""The key of an object: the part of the package that holds it, and its number there."""

MODEL = "3D/3dmodel.model"
OWN = "https://padgen.invalid/2026"
QUICK = 1
"""Level of deflate: the other levels take three times as long for a file a tenth smaller."""
ROWS, READ_BYTES = 100_000, 1 << 23
"""Rows of text written, and bytes read, at a time: a large pad's whole text would take more memory than its mesh."""
_NUMBERS = bytes(c if chr(c) in "0123456789.-" else ord(" ") for c in range(256))
"""Translation table that turns rows of a file into numbers with blanks between."""
_CONTENT_TYPES = b"""<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
<Default Extension="png" ContentType="image/png"/>
<Default Extension="config" ContentType="text/plain"/>
</Types>
"""
_RELATIONS = b"""<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Id="rel0" Target="/3D/3dmodel.model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
<Relationship Id="rel1" Target="/Metadata/thumbnail.png"
 Type="http://schemas.openxmlformats.org/package/2006/relationships/metadata/thumbnail"/>
</Relationships>
"""
_MODEL_HEAD = f"""<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
 xmlns:padgen="{OWN}">"""
THUMBNAIL_PX = (256, 256)
COLOUR = (0.90, 0.88, 0.82)


def write(out: OutputFolder, job: ExportJob) -> None:
    """Add the part's mesh and read it back: compared corner by corner, or by volume where it is stored in instances."""
    name, instances = f"{job.part.name}.3mf", job.instances and job.pad is not None
    path = out.write(name, threemf_bytes(job))
    if instances:
        verified_volume(name, job.part.mesh, read_3mf(path, weld=False))
    else:
        verified(name, job.part.mesh, _read_plain(path))


def threemf_bytes(job: ExportJob) -> bytes:
    """Return the 3MF package: the part as one object, or the pad as instances of one mesh per distinct tile."""
    parts: dict[str, Iterable[bytes]] = {
        "[Content_Types].xml": [_CONTENT_TYPES],
        "_rels/.rels": [_RELATIONS],
        MODEL: _model(job),
        "Metadata/thumbnail.png": [picture_png([(job.part.mesh, COLOUR)], THUMBNAIL_PX)],
    }
    if profile := prusa_profile(job.plan.spec):
        # PrusaSlicer skips the first line.
        lines = ("; settings for PrusaSlicer", *(f"; {key} = {value}" for key, value in profile.items()), "")
        parts[PRUSA_CONFIG] = ["\n".join(lines).encode()]
    data = io.BytesIO()
    # Entries are dated 1980-01-01, the earliest that a zip knows.
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED, compresslevel=QUICK) as package:
        for name, texts in parts.items():
            with package.open(name, "w") as file:
                for text in texts:
                    file.write(text)
    return data.getvalue()


def _model(job: ExportJob) -> Iterator[bytes]:
    """Yield the XML of the package's model, some rows at a time."""
    meta = [f"<metadata name={quoteattr(key)}>{escape(value)}</metadata>" for key, value in _metadata(job).items()]
    yield "\n".join([_MODEL_HEAD, *meta, "<resources>\n"]).encode()
    if job.instances and job.pad is not None:
        last = yield from _instances(job.plan, job.pad)
    else:
        last = 1
        yield from _object(last, job.part.title, job.part.mesh)
    printer = job.plan.spec.printer
    middle = f"1 0 0 0 1 0 0 0 1 {printer.bed_x_mm / 2:.6f} {printer.bed_y_mm / 2:.6f} 0"
    yield f'</resources>\n<build>\n<item objectid="{last}" transform="{middle}"/>\n</build>\n</model>\n'.encode()


def _object(number: int, name: str, mesh: Mesh) -> Iterator[bytes]:
    yield f'<object id="{number}" name={quoteattr(name)} type="model">\n<mesh>\n<vertices>\n'.encode()
    # To the millionth, without negative noughts.
    yield from _rows(np.round(mesh.vertices_mm, 6) + 0.0, '<vertex x="%.6f" y="%.6f" z="%.6f"/>\n')
    yield b"</vertices>\n<triangles>\n"
    yield from _rows(mesh.triangles, '<triangle v1="%d" v2="%d" v3="%d"/>\n')
    yield b"</triangles>\n</mesh>\n</object>\n"


def _rows(numbers: np.ndarray, row: str) -> Iterator[bytes]:
    """Yield the numbers (n, 3) as text, each three in a `row`; some rows at a time."""
    for some in np.array_split(numbers, len(numbers) // ROWS + 1):
        yield (row * len(some) % tuple(some.ravel().tolist())).encode()


def _read_plain(path: Path) -> Mesh:
    """Read the mesh of a file that this module wrote as one object, faster than any 3MF can be read."""
    # In rows of triangles the digits of v1, v2 and v3 are read as numbers, too: every other number is a vertex.
    kinds = (b"<vertex ", (3, slice(None)), float), (b"<triangle ", (6, slice(1, None, 2)), np.int64)
    found: dict[bytes, list[np.ndarray]] = {row: [np.empty((0, 3), kind)] for row, _, kind in kinds}
    with zipfile.ZipFile(path) as package, package.open(MODEL) as file:
        rest = b""
        while block := file.read(READ_BYTES):
            text = rest + block
            text, rest = text[: text.rfind(b"\n") + 1], text[text.rfind(b"\n") + 1 :]
            for row, (width, used), kind in kinds:
                if (start := text.find(row)) >= 0:
                    rows = text[start : text.index(b"\n", text.rfind(row))].translate(_NUMBERS).decode()
                    found[row].append(np.fromstring(rows, kind, sep=" ").reshape(-1, width)[:, used])
    return Mesh(*(np.concatenate(parts) for parts in found.values()))


def _metadata(job: ExportJob) -> dict[str, str]:
    """Return the 3MF metadata; keys that 3MF does not define carry padgen's namespace, as the format requires."""
    return {
        "Title": job.part.title,
        "Application": f"padgen {__version__}",
        "LicenseTerms": "the pad is yours; padgen is Apache-2.0",
        "Description": job.part.description,
        "padgen:SpecHash": job.spec_hash,
        "padgen:PrintSettings": "; ".join(f"{key} {value}" for key, value in job.plan.printing.items()),
    }


def read_3mf(path: Path, weld: bool = True) -> Mesh:
    """Read all triangles of the build items of a 3MF in mm, with instances placed, and weld them unless told not to.

    Where there is only one item, its place on the bed is ignored.

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
    except Exception as error:  # zip, deflate, XML and lib3mf each have exceptions of their own
        raise MeshFileError(f"is not a 3MF that can be read ({error})", str(path)) from error
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    items = model.GetBuildItems()
    while items.MoveNext():
        item = items.GetCurrent()
        matrix = _matrix(item.GetObjectTransform())
        if items.Count() == 1:  # a single item's place on the bed tells nothing
            matrix[3] = 0.0
        with np.errstate(all="ignore"):  # sound_mesh refuses overflows and nan
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
    """Return the lib3mf library, loaded once, since loading looks up a thousand functions."""
    return _lib3mf().Wrapper()


def _instances(plan: Plan, pad: PadSolid) -> Generator[bytes, None, int]:
    """Yield the XML of the border, the distinct tiles and the object that places them; return its number."""
    spec, turned = plan.spec, turned_grid(plan)
    yield from _object(1, "border", pad.border.mesh)
    placed, number = ['<component objectid="1"/>'], 1
    names = [f"taxel-{channel.index}" for channel in plan.channels] + ["frame"]
    for index, (name, tile) in enumerate(zip(names, pad.tiles, strict=True)):
        places = np.argwhere(pad.grid == index)
        if not len(places):
            continue
        number += 1
        yield from _object(number, name, tile.mesh)
        for row, column in places.tolist():
            x = (column + 0.5) * plan.cell.width_mm - spec.pad.width_mm / 2
            y = (row + 0.5) * plan.cell.depth_mm - spec.pad.depth_mm / 2
            way = -1 if turned[row, column] else 1
            place = f"{way} 0 0 0 {way} 0 0 0 1 {x:.6f} {y:.6f} 0"
            placed.append(f'<component objectid="{number}" transform="{place}"/>')
    number += 1
    head = f'<object id="{number}" name={quoteattr(plan.name)} type="model">'
    yield "\n".join([head, "<components>", *placed, "</components>", "</object>\n"]).encode()
    return number


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
    """Return vertices (V, 3) and triangles (T, 3) of a mesh object, copied at once.

    The wrapper's ``GetVertices`` would make a Python object of every vertex.
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
    """Return the package stored without compression, after its size and its placed parts were judged.

    Raises
    ------
    MeshFileError
        The file is no package, exceeds the bounds, or places more than can be checked.
    """
    data, left = io.BytesIO(), LARGEST_UNPACKED
    objects = _Objects(str(path))
    with (
        zipfile.ZipFile(io.BytesIO(read_bounded(path, LARGEST_FILE, "a 3MF"))) as package,
        zipfile.ZipFile(data, "w", zipfile.ZIP_STORED) as plain,
    ):
        for entry in package.infolist():
            left -= entry.file_size  # zipfile reads no more than this of an entry
            if left < 0:
                raise MeshFileError(f"holds more than {LARGEST_UNPACKED} bytes unpacked", str(path))
            part = package.read(entry)
            if part.count(b"<") > 2 * MOST_TRIANGLES:
                raise MeshFileError(f"holds more than {MOST_TRIANGLES} triangles", str(path))
            if part.lstrip().startswith((b"<", b"\xef\xbb\xbf")):  # XML may have any name
                objects.read(entry.filename, part)
            plain.writestr(zipfile.ZipInfo(entry.filename), part)
    objects.refuse()
    return data.getvalue()


class _Objects:
    """The objects of a package: each one's number of triangles, its components, and how often each is placed."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._triangles: Counter[Key] = Counter()
        self._components: dict[Key, Counter[Key]] = {}
        self._items: Counter[Key] = Counter()
        self._known: dict[Key, tuple[int, int, int]] = {}

    def read(self, name: str, part: bytes) -> None:
        """Add the objects of a part of the package; `name` is its path."""
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
        """Raise `MeshFileError` where more is placed than can be checked."""
        # Objects that are never placed count as well, since lib3mf reads each of them.
        everything = sum(self._size(key, 0)[1] for key in self._components)
        items = [(times, *self._size(key, 0)) for key, times in self._items.items()]
        if sum(times * parts for times, _, parts, _ in items) > MOST_PARTS or everything > DEEPEST * MOST_PARTS:
            raise MeshFileError(f"places more than {MOST_PARTS} parts", self._where)
        if sum(times * triangles for times, *_, triangles in items) > MOST_TRIANGLES:
            raise MeshFileError(f"places more than {MOST_TRIANGLES} triangles", self._where)

    def _size(self, key: Key, above: int) -> tuple[int, int, int]:
        """Return the depth of an object's components, the number of parts that it places, and of their triangles."""
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
    """Return the key of the object that a component or item names; it may be in another part than `own`."""
    path = next((value for name, value in attributes.items() if name.rpartition(":")[2] == "path"), own)
    return path.lstrip("/"), attributes.get("objectid", "")
