"""The 3MF format: pads are written with name, metadata and thumbnail; files of any program are read.

A few hundred bytes can ask for 10^38 parts, each a component of the next, and deflate packs a thousandfold. So a
package is unpacked within bounds, and its parts are placed one by one until they are too many.
"""

import io
import struct
import zipfile
import zlib
from array import array
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import IO, Any, NamedTuple
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from padgen import __version__
from padgen.core.errors import FileError, GeometryError, MeshFileError
from padgen.core.files import OutputFolder, read_bounded
from padgen.planner.plan import Plan
from padgen.planner.printing import prusa_profile
from padgen.solid.formats import REREAD_MM, ExportJob, verify_volume
from padgen.solid.mesh import AT_ONCE, Mesh, group_indices, sound_mesh
from padgen.solid.pad_solid import PadSolid, turned_grid

__all__ = [
    "LARGEST_FILE",
    "MOST_TRIANGLES",
    "pack_3mf",
    "picture_png",
    "plain_rows",
    "read_3mf",
    "verify_rows",
    "write",
]

LARGEST_FILE = LARGEST_UNPACKED = 1 << 28
"""Most bytes of a mesh file, and of a 3MF's parts unpacked."""
MOST_TRIANGLES = 2_000_000
"""Most triangles of a mesh file, each instance counted: several times as many as a pad of 512 taxels has."""
MOST_PARTS = 50_000
DEEPEST = 64
"""Most meshes and components that are placed, and most levels of components within each other."""

PRUSA_CONFIG = "Metadata/Slic3r_PE.config"
"""Path at which PrusaSlicer looks for the settings of a project."""
Key = tuple[str, str]
"""The key of an object: the part of the package that holds it, and its number there."""

MODEL = "3D/3dmodel.model"
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_MM_PER_UNIT = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}
OWN = "https://padgen.invalid/2026"
QUICK = 1
"""Level of deflate: the other levels take three times as long for a file a tenth smaller."""
ROWS = 100_000
BLOCK_BYTES = 1 << 23
"""Rows written and bytes read at a time: a large pad's whole text would take more memory than its mesh."""
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
<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}"
 xmlns:padgen="{OWN}">"""
THUMBNAIL_PX = (256, 256)


def write(out: OutputFolder, job: ExportJob) -> None:
    """Write the part as a 3MF file into `out` and raise GeometryError if, read back, its mesh or volume differs."""
    name = f"{job.part.name}.3mf"
    path = out.write_by(name, partial(pack_3mf, job))
    if job.instances and job.pad is not None:
        verify_volume(name, job.part.mesh, read_3mf(path, weld=False))
    else:
        verify_rows(name, job.part.mesh, path)


def verify_rows(name: str, mesh: Mesh, path: Path) -> None:
    """Raise GeometryError if a one-object 3MF file that this module wrote differs from its mesh."""
    rows = 0
    corners = 0
    for is_vertices, numbers in plain_rows(path):
        if is_vertices:
            here = mesh.vertices_mm[rows : rows + len(numbers)]
            rows += len(numbers)
            if len(here) < len(numbers) or np.abs(here - numbers).max(initial=0.0) > REREAD_MM:
                raise GeometryError("read back, its vertices differ from the mesh's", name)
        else:
            if not np.array_equal(mesh.triangles[corners : corners + len(numbers)], numbers):
                raise GeometryError("read back, its triangles differ from the mesh's", name)
            corners += len(numbers)
    if rows < len(mesh.vertices_mm) or corners < len(mesh.triangles):
        raise GeometryError(f"read back, it has {corners} triangles, must have {len(mesh.triangles)}", name)


def plain_rows(path: Path) -> Iterator[tuple[bool, np.ndarray]]:
    """Yield vertices, then triangles, of a one-object 3MF file that `pack_3mf` wrote, 5 times as fast as `read_3mf`.

    Each yield has some rows in their order, and whether they are vertices (n, 3) in mm or else triangles (n, 3).
    """
    sections = iter(((b"<vertices>", b"</vertices>", True), (b"<triangles>", b"</triangles>", False)))
    begin, end, is_vertices = next(sections)
    has_begun = False
    with zipfile.ZipFile(path) as package, package.open(MODEL) as model:
        for block in _whole_lines(model):
            while block:
                if not has_begun:
                    _, found_begin, block = block.partition(begin)
                    has_begun = bool(found_begin)
                    continue
                text, found_end, block = block.partition(end)
                if text := text.translate(_NUMBERS).strip():
                    numbers = np.fromstring(text.decode(), sep=" ")
                    # In rows of triangles the digits of v1, v2 and v3 are read as numbers, too.
                    yield is_vertices, numbers.reshape(-1, 3) if is_vertices else numbers.reshape(-1, 6)[:, 1::2]
                if found_end:
                    following = next(sections, None)
                    if following is None:
                        return
                    begin, end, is_vertices = following
                    has_begun = False


def _whole_lines(file: IO[bytes]) -> Iterator[bytes]:
    """Yield a file in blocks of whole lines."""
    rest = b""
    while data := file.read(BLOCK_BYTES):
        text = rest + data
        cut = text.rfind(b"\n") + 1
        yield text[:cut]
        rest = text[cut:]
    yield rest


def pack_3mf(job: ExportJob, path: Path) -> None:
    """Write a 3MF file to `path`: the part as one mesh, or a pad as instances of one mesh per distinct taxel."""
    parts: dict[str, Iterable[bytes]] = {
        "[Content_Types].xml": [_CONTENT_TYPES],
        "_rels/.rels": [_RELATIONS],
        MODEL: _model(job),
        "Metadata/thumbnail.png": [picture_png(job.part.mesh, THUMBNAIL_PX)],
    }
    if profile := prusa_profile(job.plan.spec):
        # PrusaSlicer skips the first line.
        lines = ("; settings for PrusaSlicer", *(f"; {key} = {value}" for key, value in profile.items()), "")
        parts[PRUSA_CONFIG] = ["\n".join(lines).encode()]
    # Entries are dated 1980-01-01, the earliest that a zip knows.
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=QUICK) as package:
        for name, texts in parts.items():
            with package.open(name, "w") as file:
                for text in texts:
                    file.write(text)


def _model(job: ExportJob) -> Iterator[bytes]:
    """Yield the XML of the package's model, some rows at a time."""
    # Keys that 3MF does not define carry padgen's namespace, as the format requires.
    metadata = {
        "Title": job.part.title,
        "Application": f"padgen {__version__}",
        "LicenseTerms": "the pad is yours; padgen is Apache-2.0",
        "Description": job.part.description,
        "padgen:SpecHash": job.spec_hash,
        "padgen:PrintSettings": "; ".join(f"{key} {value}" for key, value in job.plan.printing.items()),
    }
    meta = [f"<metadata name={quoteattr(key)}>{escape(value)}</metadata>" for key, value in metadata.items()]
    yield "\n".join([_MODEL_HEAD, *meta, "<resources>\n"]).encode()
    pad = job.pad if job.instances else None
    meshes, placed = _instances(job.plan, pad) if pad else ([(job.part.title, job.part.mesh)], [])
    for number, (name, mesh) in enumerate(meshes, start=1):
        yield from _object(number, name, mesh)
    if placed:
        head = f'<object id="{len(meshes) + 1}" name={quoteattr(job.plan.name)} type="model">'
        yield "\n".join([head, "<components>", *placed, "</components>", "</object>\n"]).encode()
    printer = job.plan.spec.printer
    last = len(meshes) + bool(placed)
    middle = f"1 0 0 0 1 0 0 0 1 {printer.bed_x_mm / 2:.6f} {printer.bed_y_mm / 2:.6f} 0"
    yield f'</resources>\n<build>\n<item objectid="{last}" transform="{middle}"/>\n</build>\n</model>\n'.encode()


def _instances(plan: Plan, pad: PadSolid) -> tuple[list[tuple[str, Mesh]], list[str]]:
    """Return names and meshes of border, distinct taxels and bare frame, and the XML components that place copies."""
    spec = plan.spec
    turned = turned_grid(plan)
    meshes = [("border", pad.border.mesh)]
    placed = ['<component objectid="1"/>']
    names = [f"taxel-{channel.index}" for channel in plan.channels] + ["frame"]
    for index, (name, tile) in enumerate(zip(names, pad.tiles, strict=True)):
        places = np.argwhere(pad.grid == index).tolist()
        meshes += [(name, tile.mesh)] * bool(places)
        for row, column in places:
            x = (column + 0.5) * plan.cell.width_mm - spec.pad.width_mm / 2
            y = (row + 0.5) * plan.cell.depth_mm - spec.pad.depth_mm / 2
            way = -1 if turned[row, column] else 1
            place = f"{way} 0 0 0 {way} 0 0 0 1 {x:.6f} {y:.6f} 0"
            placed.append(f'<component objectid="{len(meshes)}" transform="{place}"/>')
    return meshes, placed


def _object(number: int, name: str, mesh: Mesh) -> Iterator[bytes]:
    yield f'<object id="{number}" name={quoteattr(name)} type="model">\n<mesh>\n<vertices>\n'.encode()
    yield from _rows(mesh.vertices_mm, '<vertex x="%.6f" y="%.6f" z="%.6f"/>\n')
    yield b"</vertices>\n<triangles>\n"
    yield from _rows(mesh.triangles, '<triangle v1="%d" v2="%d" v3="%d"/>\n')
    yield b"</triangles>\n</mesh>\n</object>\n"


def _rows(numbers: np.ndarray, row: str) -> Iterator[bytes]:
    """Yield numbers (n, 3) as XML text, each three formatted by the template `row`, in blocks of rows."""
    for some in np.array_split(numbers, len(numbers) // ROWS + 1):
        # To the millionth, without negative noughts.
        rounded = np.round(some, 6) + 0
        yield (row * len(some) % tuple(rounded.ravel().tolist())).encode()


class _Object(NamedTuple):
    """An object of a 3MF file: vertex coordinates, triangles' vertex indices, and components with transforms."""

    coordinates: array
    corners: array
    components: list[tuple[Key, np.ndarray]]


def read_3mf(path: Path, weld: bool = True) -> Mesh:
    """Return one mesh in mm of all build items of a 3MF file, instances placed; `weld` merges coincident vertices.

    Where there is only one item, its place on the bed is ignored.

    Raises
    ------
    MeshFileError
        The file is not a 3MF, holds no triangle, exceeds the bounds, or places more than can be checked.
    """
    objects: dict[Key, _Object] = {}
    items: list[tuple[Key, np.ndarray]] = []
    try:
        for name, part in _unpacked(path):
            if part.lstrip().startswith((b"<", b"\xef\xbb\xbf")):  # XML may have any name
                _read_part(name, part, objects, items)
        # Objects that are never placed count as well: whatever reads the file next may resolve them.
        _placed([(key, np.eye(4)) for key in objects], objects, str(path))
        if len(items) == 1:  # a single item's place on the bed tells nothing
            items[0][1][3, :3] = 0.0
        parts = _placed(items, objects, str(path))
    except FileError:
        raise
    except Exception as error:  # zip, deflate and XML each have exceptions of their own
        raise MeshFileError(f"is not a 3MF that can be read ({error})", str(path)) from error
    if not parts:
        raise MeshFileError("holds no triangles", str(path))
    counts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    triangles = np.concatenate([triangles_of + n for (_, triangles_of), n in zip(parts, counts, strict=False)])
    return sound_mesh(vertices, triangles, str(path), weld)


def _unpacked(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the path and content of each file in a 3MF package; raise MeshFileError beyond the size limits."""
    left = LARGEST_UNPACKED
    with zipfile.ZipFile(io.BytesIO(read_bounded(path, LARGEST_FILE, "a 3MF"))) as package:
        for entry in package.infolist():
            left -= entry.file_size  # zipfile reads no more than this of an entry
            if left < 0:
                raise MeshFileError(f"holds more than {LARGEST_UNPACKED} bytes unpacked", str(path))
            part = package.read(entry)
            if part.count(b"<") > 2 * MOST_TRIANGLES:
                raise MeshFileError(f"holds more than {MOST_TRIANGLES} triangles", str(path))
            yield entry.filename.lstrip("/"), part


def _read_part(name: str, part: bytes, objects: dict[Key, _Object], items: list[tuple[Key, np.ndarray]]) -> None:
    """Parse the XML `part` at path `name` of a 3MF package, and add to `objects` and `items` what it defines."""
    current = _Object(array("d"), array("q"), [])
    scale = 1.0

    def named(attributes: dict[str, str]) -> tuple[Key, np.ndarray]:
        """Return the key of the object that a component or item places, and its transform (4, 4)."""
        path = next((value for key, value in attributes.items() if key.rpartition(" ")[2] == "path"), name)
        place = np.eye(4)
        if "transform" in attributes:
            place[:, :3] = np.array(attributes["transform"].split(), float).reshape(4, 3)
        return (path.lstrip("/"), attributes.get("objectid", "")), place

    def started(tag: str, attributes: dict[str, str]) -> None:
        nonlocal current, scale
        match tag[len(CORE) + 1 :] if tag.startswith(CORE) else tag:
            case "triangle":
                current.corners.extend((int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"])))
            case "vertex":
                current.coordinates.extend((float(attributes["x"]), float(attributes["y"]), float(attributes["z"])))
            case "object":
                current = objects[name, attributes.get("id", "")] = _Object(array("d"), array("q"), [])
            case "component":
                current.components.append(named(attributes))
            case "item":
                key, place = named(attributes)
                place[:, :3] *= scale
                items.append((key, place))
            case "model":
                scale = _MM_PER_UNIT[attributes.get("unit", "millimeter")]

    def declared(*_: Any) -> None:
        raise ValueError("it declares a document type, which 3MF does not allow")

    parser = expat.ParserCreate("UTF-8", " ")
    parser.StartElementHandler = started
    parser.StartDoctypeDeclHandler = declared
    parser.Parse(part, True)


def _placed(
    items: list[tuple[Key, np.ndarray]], objects: dict[Key, _Object], where: str
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return vertices (V, 3) in mm and triangles (T, 3) of every mesh that the items place.

    Raises
    ------
    MeshFileError
        These are more than can be checked.
    """
    placed: list[tuple[np.ndarray, np.ndarray]] = []
    parts = triangles = 0
    waiting = [(key, place, 0) for key, place in reversed(items)]
    while waiting:
        key, place, depth = waiting.pop()
        if key not in objects:
            raise ValueError(f"it has no object {key[1]!r}")
        if depth > DEEPEST:
            raise MeshFileError(f"has components more than {DEEPEST} deep within one another", where)
        part = objects[key]
        parts = parts + 1
        triangles = triangles + len(part.corners) // 3
        if parts > MOST_PARTS:
            raise MeshFileError(f"places more than {MOST_PARTS} parts", where)
        if triangles > MOST_TRIANGLES:
            raise MeshFileError(f"places more than {MOST_TRIANGLES} triangles", where)
        with np.errstate(all="ignore"):  # sound_mesh refuses overflows and nan
            if part.corners:
                vertices = np.frombuffer(part.coordinates).reshape(-1, 3) @ place[:3, :3] + place[3, :3]
                placed.append((vertices, np.frombuffer(part.corners, np.int64).reshape(-1, 3)))
            waiting += [(inner, at @ place, depth + 1) for inner, at in reversed(part.components)]
    return placed


BACKGROUND = np.array([1.0, 1.0, 1.0])
# In the viewer's axes: right, up, towards. Key light from the upper left, fill from the right.
LIGHTS = ((np.array([-0.45, 0.75, 0.5]), 0.62), (np.array([0.7, -0.1, 0.7]), 0.28))
AMBIENT = 0.24
OVERSAMPLE = 2


AZIMUTH, ELEVATION = np.radians((-35.0, 38.0))
"""Direction that a picture is taken from: angles around z from −y, and above the horizon."""
COLOUR = np.array([0.90, 0.88, 0.82])


def picture_png(mesh: Mesh, size_px: tuple[int, int]) -> bytes:
    """Return a PNG picture, `size_px` (width, height), of a mesh seen from above at an angle in parallel projection.

    A depth buffer in numpy, so that it needs no window and no graphics driver.
    """
    width, height = (OVERSAMPLE * n for n in size_px)
    right = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0])
    toward = np.array([np.sin(AZIMUTH) * np.cos(ELEVATION), -np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
    axes = np.stack([right, np.cross(toward, right), toward])
    seen = mesh.vertices_mm @ axes.T
    low = seen.min(0)
    high = seen.max(0)
    scale = 0.94 * min(width / (high[0] - low[0]), height / (high[1] - low[1]))
    shift = np.array([width, height, 0]) / 2 - (low + high) / 2 * (scale, -scale, scale)
    image = np.tile(BACKGROUND, (width * height, 1))
    nearest = np.full(width * height, -np.inf)
    for some in np.array_split(mesh.triangles, len(mesh.triangles) // AT_ONCE + 1):
        corners = seen[some]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing = normal[:, 2] > 1e-9
        normal = normal[facing] / np.linalg.norm(normal[facing], axis=1, keepdims=True)
        lit = [share * np.clip(normal @ (light / np.linalg.norm(light)), 0, 1) for light, share in LIGHTS]
        shades = np.clip(COLOUR * (AMBIENT + sum(lit))[:, None], 0, 1)
        pixel, owner, depth = _covered(corners[facing] * (scale, -scale, scale) + shift, width, height)
        # Assigned in the order of depth, the nearest triangle comes last and stays.
        order = np.argsort(depth, kind="stable")
        order = order[depth[order] >= nearest[pixel[order]]]
        nearest[pixel[order]] = depth[order]
        image[pixel[order]] = shades[owner[order]]
    image = image.reshape(height, width, 3)
    steps = range(OVERSAMPLE)
    # A mean over two axes would take ten times as long.
    image = np.add.reduce([image[i::OVERSAMPLE, j::OVERSAMPLE] for i in steps for j in steps]) / OVERSAMPLE**2
    return _png((image * 255 + 0.5).astype(np.uint8))


def _png(pixels: np.ndarray) -> bytes:
    """Return an image (height, width, 3) of bytes as PNG, without Pillow, which takes long to load."""
    height, width, _ = pixels.shape
    # Each line is the difference from the one above, whose filter is number 2.
    lines = np.insert(np.diff(pixels, axis=0, prepend=np.zeros_like(pixels[:1])).reshape(height, -1), 0, 2, axis=1)
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(lines.tobytes())),
        (b"IEND", b""),
    )
    png = b"\x89PNG\r\n\x1a\n"
    for name, data in parts:
        png += struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    return png


def _covered(corners: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return indices of pixels whose centres lie in triangles (n, 3, 3), each with its triangle and depth."""
    low = corners[..., 1].min(1)
    high = corners[..., 1].max(1)
    owner, row = _runs(np.maximum(np.ceil(low - 0.5), 0), np.minimum(np.floor(high - 0.5), height - 1))
    # The corners' weights and the depth are linear in the place: slopes to the right and down, and offsets.
    depth = corners[..., 2:].copy()
    planes = np.linalg.inv(np.concatenate([corners[..., :2], np.ones_like(depth)], axis=2))
    along, down, offset = np.moveaxis(np.concatenate([planes, planes @ depth], axis=2)[owner], 1, 0)
    offset += down * (row + 0.5)[:, None]
    # Inside no weight is negative.
    with np.errstate(divide="ignore", invalid="ignore"):
        edges = -offset[:, :3] / along[:, :3]
    left = np.where(along[:, :3] > 0, edges, 0.0).max(1)
    right = np.where(along[:, :3] < 0, edges, width).min(1)
    line, column = _runs(np.ceil(left - 0.5), np.minimum(np.floor(right - 0.5), width - 1))
    return row[line] * width + column, owner[line], offset[line, 3] + along[line, 3] * (column + 0.5)


def _runs(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all integers first[k] … last[k] of all ranges k as two arrays: the k of each integer, and the integers."""
    run, step = group_indices(np.maximum(last - first + 1, 0).astype(np.int64))
    return run, first[run].astype(np.int64) + step
