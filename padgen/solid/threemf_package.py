"""A 3MF as it lies in its file, judged before lib3mf reads it: unpacked within bounds, and placed how often.

A few hundred bytes can ask for 10^38 parts, each a component of the next, and deflate packs a thousandfold.
lib3mf follows both to the end.
"""

import io
import zipfile
from collections import Counter
from pathlib import Path
from typing import Any
from xml.parsers import expat

from padgen.core.errors import MeshFileError
from padgen.core.files import read_bounded

__all__ = ["LARGEST_FILE", "MOST_TRIANGLES", "unpacked"]

LARGEST_FILE = LARGEST_UNPACKED = 1 << 28
"""Bytes of a file that holds a mesh, and of a 3MF's parts unpacked."""
MOST_TRIANGLES = 2_000_000
"""Placed, instances counted each: some times as many as 512 taxels have."""
MOST_PARTS, DEEPEST = 50_000, 64
"""Meshes and components placed, and components within one another."""

Key = tuple[str, str]
"""An object: the part of the package that it lies in, and its number there."""


def unpacked(path: Path) -> bytes:
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
