"""Reader of G-code files, layer by layer: where a slicer lays plastic, and how much.

A file is read in blocks, whose moves numpy works out, and only one layer is held at a time: the file may have any size.
The reader knows straight moves and arcs (G0–G3), absolute and relative coordinates and extrusion (G90, G91, M82, M83,
G92), millimetres and inches (G20, G21). From a slicer's comments it takes the kind and the height of the extrusions
that follow. A new layer begins where the nozzle's height changes, whatever comments say.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, shown
from padgen.core.files import reason

__all__ = ["Layer", "read_layers", "read_settings"]

BLOCK_BYTES = 1 << 22
END_BYTES = 1 << 18
"""Bytes at a file's beginning and end that are searched for the slicer's settings."""
MOST_MOVES = 3_000_000
"""Most extrusions in one layer; no pad has more."""
CHORD_MM = 0.005
"""Largest distance of an arc from the chords that replace it."""
INCH_MM = 25.4
SAME_Z_MM = 1e-4
NOT_OBJECT = ("SKIRT", "BRIM", "SUPPORT", "PRIME", "WIPE", "CUSTOM", "RAFT")
"""First words, in slicers' comments, of the kinds of extrusions that are no part of the object."""
OTHER_FILES = (
    (b"GCDE", "is binary G-code (.bgcode); switch binary G-code off in the slicer and export it as text"),
    (b"PK", "is a 3MF or another archive; slice it first and export G-code"),
    (b"\xff\xfe", "is UTF-16 text; save it as plain text"),
    (b"\xfe\xff", "is UTF-16 text; save it as plain text"),
    (b"solid", "is an STL; slice it first and export G-code"),
    (b"\x1f\x8b", "is compressed; unpack it first"),
)
NOTE = re.compile(rb"^; ?(TYPE|FEATURE|HEIGHT|LAYER_HEIGHT): ?([^\r\n]*)", re.MULTILINE)
SETTING = re.compile(rb"^; ?([A-Za-z_ ]+?) ?= ?([^\r\n]*?)\r?$", re.MULTILINE)
SLICER = re.compile(
    rb"(?:[Gg]enerated (?:by|with)|^;) ?((?:\w*Slicer|BambuStudio|Slic3r|Cura_SteamEngine|Simplify3D|ideaMaker)"
    rb"[^\s,;]*(?: v?\d[^\s,;]*)?)",
    re.MULTILINE,
)
WORD = re.compile(rb"(?:[A-Z] *[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?\s*)*")
MOVES, SETS = (0, 1, 2, 3), (20, 21, 82, 83, 90, 91, 92)
"""Codes that move, and codes that change what numbers mean: 82 and 83 are M82 and M83, all others are G codes."""
AXES = {ord(letter): column for column, letter in enumerate("XYZEIJ")}


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
    filament_mm2 = np.pi / 4 * filament_mm**2
    state, count = _State(), 0
    held: list[np.ndarray] = []
    for number, block in _blocks(path):
        rows = _extrusions(block, number, state, path)
        if not len(rows):
            continue
        cuts = np.flatnonzero(np.abs(np.diff(rows[:, 4])) > SAME_Z_MM) + 1
        for first, last in pairwise((0, *cuts.tolist(), len(rows))):
            part = rows[first:last]
            if held and abs(held[0][0, 4] - part[0, 4]) > SAME_Z_MM:
                yield _layer(held, filament_mm2)
                held, count = [], 0
            held.append(part)
            count += len(part)
        if count > MOST_MOVES:
            raise FileError(f"has more than {MOST_MOVES} extrusions at one height; no pad has", str(path))
    if held:
        yield _layer(held, filament_mm2)


def _layer(parts: list[np.ndarray], filament_mm2: float) -> Layer:
    rows = np.concatenate(parts)
    start, stop = rows[:, :2], rows[:, 2:4]
    return Layer(float(rows[0, 4]), start, stop, rows[:, 5] * filament_mm2 / np.hypot(*(stop - start).T), rows[:, 6])


def _blocks(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield blocks of whole lines, some megabytes each, with the number of their first line."""
    number, rest = 1, b""
    with path.open("rb") as file:
        while data := file.read(BLOCK_BYTES):
            whole, newline, rest = (rest + data).rpartition(b"\n")
            if newline:
                yield number, whole + newline
                number += whole.count(b"\n") + 1
            elif len(rest) > BLOCK_BYTES:
                raise FileError("has a line that does not end; it is no G-code", str(path))
    if rest:
        yield number, rest + b"\n"


class _State:
    """The printer's state between two blocks of lines: its modes, and the place of the nozzle and of the filament."""

    def __init__(self) -> None:
        self.last = dict.fromkeys("XYZE", 0.0)
        self.modes = {"unit": 1.0, "relative": 0.0, "relative_e": 0.0, "beside": 0.0, "height": np.nan}

    def kept(self, name: str, sets: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return a mode's value in each row: that of `values` in the last row that `sets` it."""
        at = np.maximum.accumulate(np.where(sets, np.arange(len(sets)), -1))
        result = np.where(at < 0, self.modes[name], values[at])
        self.modes[name] = float(result[-1])
        return result

    def followed(self, axis: str, given: np.ndarray, relative: np.ndarray) -> np.ndarray:
        """Return an axis's place in mm before the first row and after each row, from the words `given` (nan: none)."""
        is_given = ~np.isnan(given)
        run = np.cumsum(np.where(is_given & relative, given, 0.0))
        at = np.maximum.accumulate(np.where(is_given & ~relative, np.arange(len(given)), -1))
        result = np.where(at < 0, self.last[axis] + run, given[at] + run - run[at])
        before, self.last[axis] = self.last[axis], float(result[-1])
        return np.concatenate([[before], result])


def _extrusions(block: bytes, number: int, state: _State, path: Path) -> np.ndarray:
    """Return the moves of a block that lay plastic: rows of from x, y, to x, y, z, fed filament and height, in mm."""
    text = np.frombuffer(block, np.uint8)
    ends = np.flatnonzero(text == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    code = _codes(text, starts)
    rows = np.flatnonzero(code >= 0)
    if not len(rows):
        _notes(block, starts[:0], state)
        return np.empty((0, 7))
    words = _words(text, starts[rows], ends[rows])
    if words is None:
        lines = block.split(b"\n")
        for k in rows.tolist():
            written = lines[k].split(b";")[0].strip()
            if not WORD.fullmatch(written):
                told = shown(written.decode(errors="replace"))
                raise FileError(f"line {number + k} is no G-code that can be read: {told}", str(path))
        raise FileError(f"holds numbers that cannot be read after line {number}", str(path))
    code = code[rows]
    is_set = np.isin(code, SETS)
    unit = state.kept("unit", is_set & ((code == 20) | (code == 21)), np.where(code == 20, INCH_MM, 1.0))
    relative = state.kept("relative", (code == 90) | (code == 91), code == 91).astype(bool)
    relative_e = state.kept("relative_e", (code == 82) | (code == 83), code == 83).astype(bool) | relative
    words *= unit[:, None]
    places = code == 92  # G92 states where the nozzle is, and moves nothing
    x, y, z, e = (
        state.followed(axis, words[:, k], (relative_e if axis == "E" else relative) & ~places)
        for k, axis in enumerate("XYZE")
    )
    beside, height = _notes(block, starts[rows], state)
    fed = np.diff(e)
    is_arc = (code == 2) | (code == 3)
    moved = (np.diff(x) != 0) | (np.diff(y) != 0) | is_arc
    lays = (code <= 3) & moved & (fed > 0) & ~beside
    by_radius = lays & is_arc & np.isnan(words[:, 4:]).all(1)
    if by_radius.any():
        line = number + int(rows[by_radius.argmax()])
        raise FileError(f"line {line} is an arc by its radius; must be one by its middle (I, J), or lines", str(path))
    table = np.stack([x[:-1], y[:-1], x[1:], y[1:], z[1:], fed, height], -1)
    if not (lays & is_arc).any():
        return np.asarray(table[lays])
    return _without_arcs(table[lays], np.where(is_arc, 2 * code - 5, 0)[lays], np.nan_to_num(words[lays, 4:]))


def _codes(text: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the number of each line's command where it is one of `MOVES` or `SETS`, else −1."""
    padded = np.concatenate([text, np.full(4, ord("\n"), np.uint8)])
    letter, *digits = (padded[starts + k] for k in range(4))
    one, two, three = ((d - np.uint8(48)).astype(np.int16) for d in digits)
    is_digit = [(d >= 0) & (d <= 9) for d in (one, two, three)]
    code = np.where(is_digit[1], 10 * one + two, one)
    known = np.where(letter == ord("G"), np.isin(code, (*MOVES, 20, 21, 90, 91, 92)), np.isin(code, (82, 83)))
    is_command = (letter == ord("G")) | (letter == ord("M"))
    return np.where(is_command & is_digit[0] & ~(is_digit[1] & is_digit[2]) & known, code, -1)


def _words(text: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray | None:
    """Return the numbers after X, Y, Z, E, I and J of lines, (n, 6), nan where there is none.

    Return None where the number of any word cannot be read.
    """
    signs = np.flatnonzero(text == ord(";"))
    comment = np.concatenate([signs, [len(text)]])[np.searchsorted(signs, starts)]
    stops = np.minimum(ends, comment) + 1
    length = stops - starts
    row = np.repeat(np.arange(len(starts)), length)
    at = np.arange(length.sum()) + np.repeat(starts - np.cumsum(length) + length, length)
    line = text[at]
    line[np.cumsum(length) - 1] = ord(" ")
    is_letter = (line >= ord("A")) & (line <= ord("Z"))
    letters, rows = line[is_letter], row[is_letter]
    line[is_letter] = ord(" ")
    try:
        values = np.fromstring(line.tobytes(), sep=" ")
    except ValueError:  # a word has no number
        values = np.empty(0)
    if len(values) != len(letters) or not np.isfinite(values).all():
        return None
    column = np.full(256, -1)
    column[list(AXES)] = list(AXES.values())
    column = column[letters]
    words = np.full((len(starts), len(AXES)), np.nan)
    words[rows[column >= 0], column[column >= 0]] = values[column >= 0]
    return words


def _notes(block: bytes, starts: np.ndarray, state: _State) -> tuple[np.ndarray, np.ndarray]:
    """Read from comments, for rows that begin at `starts`, if they lie beside the object, and their height in mm."""
    beside = np.full(len(starts) + 1, np.nan)
    height = beside.copy()
    for note in NOTE.finditer(block):
        # A comment behind the last row is kept for the next block.
        row = int(np.searchsorted(starts, note.start()))
        if note[1] in (b"TYPE", b"FEATURE"):
            kind = note[2].decode(errors="replace").upper()
            beside[row] = any(kind.startswith(word) for word in NOT_OBJECT)
        else:
            try:
                height[row] = float(note[2])
            except ValueError:
                height[row] = np.nan
    is_beside = state.kept("beside", ~np.isnan(beside), beside)[:-1].astype(bool)
    return is_beside, state.kept("height", ~np.isnan(height), height)[:-1]


def _without_arcs(table: np.ndarray, turn: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Replace arcs in a table of extrusions by chords; rows with `turn` 0 stay.

    An arc turns clockwise (`turn` −1) or anticlockwise (1) about its start plus `centre` (n, 2), in mm.
    """
    middle, radius = table[:, :2] + centre, np.maximum(np.hypot(*centre.T), 1e-9)
    begin, end = (np.arctan2(*(table[:, k : k + 2] - middle)[:, ::-1].T) for k in (0, 2))
    sweep = (end - begin) * turn % (2 * np.pi)
    sweep = np.where(sweep < 1e-9, 2 * np.pi, sweep) * turn
    step = 2 * np.arccos(np.maximum(1 - CHORD_MM / radius, 0.0))
    count = np.where(turn == 0, 1, np.ceil(np.abs(sweep) / step)).astype(np.int64)
    row = np.repeat(np.arange(len(table)), count)
    share = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    result = table[row]
    result[:, 5] /= count[row]
    for k, ahead in ((0, 0), (2, 1)):
        angle = begin[row] + sweep[row] * (share + ahead) / count[row]
        on_arc = middle[row] + radius[row, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
        result[:, k : k + 2] = np.where((turn != 0)[row, None], on_arc, result[:, k : k + 2])
    return np.asarray(result[np.hypot(*(result[:, 2:4] - result[:, :2]).T) > 0])
