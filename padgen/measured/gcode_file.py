"""Reader of G-code files, layer by layer: where a slicer lays plastic, and how much.

Only one layer is held at a time: the file may have any size. The reader knows straight moves and arcs (G0–G3),
absolute and relative coordinates and extrusion (G90, G91, M82, M83, G92), millimetres and inches (G20, G21). From a
slicer's comments it takes the kind and the height of the extrusions that follow. A new layer begins where the nozzle's
height changes, whatever comments say.
"""

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import acos, atan2, ceil, cos, hypot, nan, pi, sin
from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, shown
from padgen.core.files import reason

__all__ = ["Layer", "read_layers", "read_settings"]

LONGEST_LINE = 1 << 16
END_BYTES = 1 << 18
"""Bytes at a file's beginning and end that are searched for the slicer's settings."""
MOST_MOVES = 3_000_000
"""Most extrusions in one layer; no pad has more."""
CHORD_MM = 0.005
"""Largest distance of an arc from the chords that replace it."""
INCH_MM = 25.4
SAME_Z_MM = 1e-4
NOT_OBJECT = (b"SKIRT", b"BRIM", b"SUPPORT", b"PRIME", b"WIPE", b"CUSTOM", b"RAFT")
"""First words, in slicers' comments, of the kinds of extrusions that are no part of the object."""
OTHER_FILES = (
    (b"GCDE", "is binary G-code (.bgcode); switch binary G-code off in the slicer and export it as text"),
    (b"PK", "is a 3MF or another archive; slice it first and export G-code"),
    (b"\xff\xfe", "is UTF-16 text; save it as plain text"),
    (b"\xfe\xff", "is UTF-16 text; save it as plain text"),
    (b"solid", "is an STL; slice it first and export G-code"),
    (b"\x1f\x8b", "is compressed; unpack it first"),
)
NOTE = re.compile(rb"; ?(?:(?:TYPE|FEATURE): ?(.*)|(?:LAYER_)?HEIGHT: ?(\d+\.?\d*|\.\d+))")
SETTING = re.compile(rb"^; ?([A-Za-z_ ]+?) ?= ?([^\r\n]*?)\r?$", re.MULTILINE)
SLICER = re.compile(
    rb"(?:[Gg]enerated (?:by|with)|^;) ?((?:\w*Slicer|BambuStudio|Slic3r|Cura_SteamEngine|Simplify3D|ideaMaker)"
    rb"[^\s,;]*(?: v?\d[^\s,;]*)?)",
    re.MULTILINE,
)
CODE = re.compile(rb"(?:G(0?[0-3]|2[01]|9[0-2])|M(8[23]))(?!\d)")
"""Commands that move, and commands that change what numbers mean."""
WORD = re.compile(rb"([A-Z]) *([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)")


@dataclass(frozen=True)
class Layer:
    """The plastic laid at one height: straight extrusions from `start` to `stop` (n, 2) in mm.

    `area_mm2` (n,) is the cross-section of the plastic. `height_mm` (n,) is the height of an extrusion as the slicer
    states it, nan where it states none. `top_mm` is the height of the nozzle.
    """

    top_mm: float
    start: np.ndarray
    stop: np.ndarray
    area_mm2: np.ndarray
    height_mm: np.ndarray

    @property
    def volume_mm3(self) -> np.ndarray:
        """Volume of the plastic of each extrusion, (n,)."""
        return np.asarray(np.hypot(*(self.stop - self.start).T) * self.area_mm2)


def read_settings(path: Path) -> dict[str, str]:
    """Read the slicer's settings, by the slicer's own names, from comments at a file's beginning and end.

    The key ``slicer`` has the slicer's name where the file tells it.

    Raises
    ------
    FileError
        The file is not there, or is not G-code as text.
    """
    try:
        if not path.is_file():
            raise FileError("is not a file" if path.exists() else "there is no such file", str(path))
        with path.open("rb") as file:
            begin = file.read(END_BYTES)
            size = file.seek(0, 2)
            file.seek(max(size - END_BYTES, len(begin)))
            end = file.read(END_BYTES)
    except (OSError, ValueError) as error:
        told = reason(error) if isinstance(error, OSError) else error
        raise FileError(f"cannot be read ({told})", str(path)) from error
    if not begin.strip():
        raise FileError("is empty", str(path))
    for magic, told in OTHER_FILES:
        if begin.startswith(magic):
            raise FileError(told, str(path))
    if b"\0" in begin:
        stl = size == 84 + 50 * int.from_bytes(begin[80:84], "little")
        raise FileError(OTHER_FILES[4][1] if stl else "is binary, not G-code as text", str(path))
    found = {key.decode(): value.decode(errors="replace") for key, value in SETTING.findall(begin + b"\n" + end)}
    slicer = SLICER.search(begin)
    return found | ({"slicer": slicer[1].decode()} if slicer else {})


def read_layers(path: Path, filament_mm: float) -> Iterator[Layer]:
    """Read the layers of a file in the order in which they are laid.

    `filament_mm` is the filament's diameter, by which fed lengths become volumes.

    Raises
    ------
    FileError
        A move cannot be read, or a layer has more extrusions than any pad.
    """
    filament_mm2, rows = pi / 4 * filament_mm**2, array("d")
    for row in _extrusions(path):
        if rows and abs(rows[4] - row[4]) > SAME_Z_MM:
            yield _layer(rows, filament_mm2)
            rows = array("d")
        rows.extend(row)
        if len(rows) > MOST_MOVES * len(row):
            raise FileError(f"has more than {MOST_MOVES} extrusions at one height; no pad has", str(path))
    if rows:
        yield _layer(rows, filament_mm2)


def _layer(numbers: array, filament_mm2: float) -> Layer:
    rows = np.frombuffer(numbers).reshape(-1, 7)
    length = np.hypot(*(rows[:, 2:4] - rows[:, :2]).T)
    rows, length = rows[length > 0], length[length > 0]
    return Layer(float(numbers[4]), rows[:, :2], rows[:, 2:4], rows[:, 5] * filament_mm2 / length, rows[:, 6])


def _extrusions(path: Path) -> Iterator[tuple[float, ...]]:
    """Yield moves that lay plastic: from x, y, to x, y, z, fed filament and stated height, in mm; arcs as chords."""
    at = dict.fromkeys("XYZE", 0.0)
    unit, is_relative, is_e_relative, is_beside, height = 1.0, False, False, False, nan
    with path.open("rb") as file:
        for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE), b""), start=1):
            if len(line) == LONGEST_LINE:
                raise FileError("has a line that does not end; it is no G-code", str(path))
            if note := NOTE.match(line):
                if note[2]:
                    height = float(note[2])
                else:
                    is_beside = note[1].upper().startswith(NOT_OBJECT)
            command = CODE.match(line)
            if not command:
                continue
            code = int(command[1] or command[2])
            if code in (20, 21):
                unit = INCH_MM if code == 20 else 1.0
            elif code in (82, 83):
                is_e_relative = code == 83
            elif code in (90, 91):
                is_relative = code == 91
            else:
                words = {axis: unit * value for axis, value in _words(line, number, path).items()}
                x, y, e = at["X"], at["Y"], at["E"]
                for axis in at.keys() & words.keys():
                    # G92 states where the nozzle is, and moves nothing.
                    adds = code != 92 and (is_relative or (axis == "E" and is_e_relative))
                    at[axis] = words[axis] + (at[axis] if adds else 0.0)
                begin, end, fed = (x, y), (at["X"], at["Y"]), at["E"] - e
                if code == 92 or fed <= 0 or is_beside or (code < 2 and begin == end):
                    continue
                if code < 2:
                    yield *begin, *end, at["Z"], fed, height
                elif "I" in words or "J" in words:
                    middle = x + words.get("I", 0.0), y + words.get("J", 0.0)
                    chords = _chords(begin, end, middle, 2 * code - 5)
                    for start, stop in pairwise(chords):
                        yield *start, *stop, at["Z"], fed / (len(chords) - 1), height
                else:
                    told = f"line {number} is an arc by its radius; must be one by its middle (I, J), or lines"
                    raise FileError(told, str(path))


def _words(line: bytes, number: int, path: Path) -> dict[str, float]:
    """Return the numbers of a line by their letters, which stand before them."""
    text = line.partition(b";")[0].strip()
    parts = WORD.split(text)
    if b"".join(parts[::3]).strip():
        raise FileError(
            f"line {number} is no G-code that can be read: {shown(text.decode(errors='replace'))}", str(path)
        )
    return {letter.decode(): float(value) for letter, value in zip(parts[1::3], parts[2::3], strict=True)}


Point = tuple[float, float]


def _chords(start: Point, stop: Point, middle: Point, turn: int) -> list[Point]:
    """Return points in mm on an arc, clockwise where `turn` is −1 and anticlockwise where it is 1."""
    begin, end = (atan2(y - middle[1], x - middle[0]) for x, y in (start, stop))
    radius = max(hypot(start[0] - middle[0], start[1] - middle[1]), 1e-9)
    sweep = (end - begin) * turn % (2 * pi)
    sweep = (2 * pi if sweep < 1e-9 else sweep) * turn
    count = ceil(abs(sweep) / (2 * acos(max(1 - CHORD_MM / radius, 0.0))))
    angles = (begin + sweep * k / count for k in range(count + 1))
    return [(middle[0] + radius * cos(angle), middle[1] + radius * sin(angle)) for angle in angles]
