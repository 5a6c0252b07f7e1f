"""Frames: levels of all taxels, in the plan's order, from images, tables, states, text and patterns.

Seen from the touch side a pad is an image: row 1 at the top (the largest y), column 1 at the left (the smallest x),
one pixel for each sub-cell of each coil's cell. A level is a share of a taxel's ON amplitude, 0 … 1. Files of frames:

============  =========================================================================================
`.png .gif`   grey, of colours the luminance (ITU-R BT.601), linear, transparent is dark; 1 to 16 bits;
              an animation is several frames
`.csv .tsv`   numbers between commas, semicolons, tabs or blanks; an empty line between frames
`.npy`        (rows, columns) or (frames, rows, columns): truth values and real numbers as they are, bytes
              over 255, unsigned 16 bits over 65535, other whole numbers 0 and 1
`.txt`        signs: ``1 #`` ON, ``0 .`` and blanks OFF, ``+`` a half; an empty line between frames
============  =========================================================================================

Letters are 5 pixels wide and 7 high, a blank column between two. A pixel is as many whole rows and columns of taxels as
fit and keep it nearly square in mm; on a pad of fewer than 7 rows or 5 columns it is a share of one, in levels of grey.
Patterns check a new pad: `padgen.driver.wiring` says what was felt of them tells of its wiring.
"""

import re
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, groupby, islice, product
from pathlib import Path
from typing import TypeVar

import numpy as np

from padgen.core.errors import FileError, SpecError, number, plural, shown
from padgen.core.files import read_bounded, reason
from padgen.core.registry import unknown_name
from padgen.planner.layout import taxel_places
from padgen.planner.plan import Plan

__all__ = [
    "CROSSED",
    "LARGEST_TABLE",
    "PATTERNS",
    "SUFFIXES",
    "Frames",
    "frames_text",
    "map_text",
    "pattern_frames",
    "read_frames",
    "read_text",
    "state_frames",
    "taxel_grid",
    "text_frames",
]

Row = TypeVar("Row", list[str], str)
Check = Callable[[int, int, int], None]
"""Called with each frame's number, rows and columns before it is decoded; raises where they do not fit."""
MAGIC = b"\x93NUMPY"
LARGEST_TEXT = 1 << 25
"""Bytes of a text file."""
MOST_ROWS = 100_000
"""Rows of a frame in a text file: as many as a pad has taxels at most."""
SIGNS = {"1": 1.0, "#": 1.0, "+": 0.5, "0": 0.0, ".": 0.0, " ": 0.0}
LUMINANCE = np.array([299, 587, 114])
"""Weights of red, green and blue in the luminance, in thousandths (ITU-R BT.601)."""


def _images(path: Path, check: Check) -> Iterator[np.ndarray]:
    """Yield the frames of a file, each (rows, columns) with values in 0 … 1."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise FileError(f"is none of the files that hold frames: {', '.join(SUFFIXES)}", str(path))
    frames = 0
    try:
        for frames, image in enumerate(reader(path, check), start=1):
            bad = np.argwhere(~((image >= 0) & (image <= 1)))
            if len(bad):
                row, column = bad[0].tolist()
                value = float(image[row, column])
                near = "" if np.isnan(value) else f"; {0 if value < 0 else 1} would do"
                sentence = f"must be a level in 0 … 1, got {number(value)}{near}"
                raise FileError(f"{_place(frames, row, column)} {sentence}", str(path))
            yield image
    except OSError as error:
        raise FileError(f"cannot be read ({reason(error)})", str(path)) from error
    if not frames:
        raise FileError("is empty; a frame is due", str(path))


def _pictures(path: Path, check: Check) -> Iterator[np.ndarray]:
    import struct
    import zlib

    from PIL import Image, UnidentifiedImageError

    damage = (SyntaxError, ValueError, EOFError, IndexError, KeyError, struct.error, zlib.error)
    try:
        with warnings.catch_warnings():
            # Of its size, which is checked before it is decoded, and of a palette's way to be transparent.
            warnings.simplefilter("ignore")
            with Image.open(path, formats=("PNG", "GIF")) as image:
                still = int(getattr(image, "default_image", False))  # a picture for viewers that show no animation
                for k in range(still, getattr(image, "n_frames", 1)):
                    image.seek(k)
                    check(k + 1 - still, image.height, image.width)
                    if image.mode.startswith("I"):  # 16 bits of grey
                        yield np.asarray(image).astype(float) / 65535
                    else:
                        colours = np.asarray(image.convert("RGBA")).astype(np.int64)
                        yield (colours[..., :3] @ LUMINANCE) * colours[..., 3] / (255_000 * 255)
    except UnidentifiedImageError as error:
        raise FileError("is not a PNG or GIF picture", str(path)) from error
    except Image.DecompressionBombError as error:
        raise FileError("is a picture of more pixels than any pad", str(path)) from error
    except (*damage, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise FileError(f"is a damaged picture ({error})", str(path)) from error


def read_text(path: Path, most_bytes: int = LARGEST_TEXT, what: str = "a text of frames") -> str:
    """Return the UTF-8 text of a file of at most `most_bytes`; `what` names its expected content in errors."""
    try:
        return read_bounded(path, most_bytes, what).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"is not text: byte {error.start} is not UTF-8", str(path)) from error


def _tables(text: str, path: Path, check: Check) -> Iterator[np.ndarray]:
    delimiter = next((sign for sign in ";\t," if sign in text), None)

    def level(cell: str) -> float:
        try:
            return float("" if "_" in cell else cell)  # which Python takes in numbers
        except ValueError as error:
            got = f"got {cell if len(cell) <= 40 else cell[:40] + '…'!r}" if cell else "is empty"
            hint = "; decimals take a point" if re.fullmatch(r"\d*,\d+", cell) else ""
            raise ValueError(f"must be a number in 0 … 1, {got}{hint}") from error

    rows = ([cell.strip() for cell in line.split(delimiter)] for line in text.splitlines())
    return _decoded(_blocks(rows, path), path, check, "numbers", level)


def _blocks(rows: Iterable[Row], path: Path) -> Iterator[list[Row]]:
    """Yield the rows of each frame of a text, split at empty rows; refuse a frame of more rows than any pad has."""
    for filled, rows_of_one in groupby(rows, key=any):
        block = list(islice(rows_of_one, MOST_ROWS + 1))
        if filled and len(block) > MOST_ROWS:
            raise FileError(f"has a frame of more than {MOST_ROWS} rows", str(path))
        if filled:
            yield block


def _decoded(
    blocks: Iterable[Sequence[Sequence[str]]], path: Path, check: Check, what: str, level: Callable[[str], float]
) -> Iterator[np.ndarray]:
    """Yield the frames of a text; `level` decodes a cell or raises ValueError, `what` names the cells in messages."""
    for frame, block in enumerate(blocks, start=1):
        first = len(block[0])
        for row, cells in enumerate(block):
            if len(cells) != first:
                raise FileError(
                    f"frame {frame}, row {row + 1} has {len(cells)} {what}, its row 1 has {first}; all must have as"
                    " many",
                    str(path),
                )
        check(frame, len(block), first)
        values = np.empty((len(block), first))
        for row, column in np.ndindex(values.shape):
            try:
                values[row, column] = level(block[row][column])
            except ValueError as error:
                raise FileError(f"{_place(frame, row, column)} {error}", str(path)) from error
        yield values


def _place(frame: int, row: int, column: int) -> str:
    return f"frame {frame}, row {row + 1}, column {column + 1}"


def _array(path: Path, check: Check) -> Iterator[np.ndarray]:
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise FileError("is not a NumPy array of numbers (it does not begin as one)", str(path))
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except OSError:
        raise
    except Exception as error:  # a damaged header fails in whichever part of it is read first
        raise FileError(f"is not a NumPy array of numbers ({error})", str(path)) from error
    if array.dtype.kind not in "biuf":
        raise FileError(f"must be an array of truth values or real numbers, holds {array.dtype}", str(path))
    if array.ndim not in (2, 3):
        raise FileError(f"must have the shape (rows, columns) or (frames, rows, columns), has {array.shape}", str(path))
    scale = {"uint8": 255, "uint16": 65535}.get(array.dtype.newbyteorder("=").name, 1)
    for frame, image in enumerate(array if array.ndim == 3 else array[None], start=1):
        check(frame, *image.shape)
        values = np.asarray(image).astype(float) / scale
        if scale == 1 and array.dtype.kind in "iu":
            bad = np.argwhere((values != 0) & (values != 1))
            if len(bad):
                row, column = bad[0].tolist()
                raise FileError(
                    f"{_place(frame, row, column)} must be 0 or 1 in an array of whole numbers that is neither of bytes"
                    f" nor of unsigned 16 bits, got {number(float(values[row, column]))}",
                    str(path),
                )
        yield values


def _signs(path: Path, check: Check) -> Iterator[np.ndarray]:
    text = read_text(path)
    if any(sign in text for sign in ";\t,"):
        return _tables(text, path, check)
    lines = text.splitlines()
    if all(re.fullmatch(r"[01]( [01])+ *", line) for line in lines if line):
        lines = [line.replace(" ", "") for line in lines]
    # Editors take blanks off the ends of lines: they are put back where blanks are what OFF is written as.
    pads = not any(sign in text for sign in "0.")

    def level(sign: str) -> float:
        if sign not in SIGNS:
            raise ValueError(
                f"must be 1 or # for ON, 0 or . or a blank for OFF or + for a half, got {sign!r}; numbers go into a"
                " .csv file"
            )
        return SIGNS[sign]

    blocks = ([line.ljust(pads * max(map(len, block))) for line in block] for block in _blocks(lines, path))
    return _decoded(blocks, path, check, "signs", level)


READERS: dict[str, Callable[[Path, Check], Iterator[np.ndarray]]] = {
    ".csv": lambda path, check: _tables(read_text(path), path, check),
    ".gif": _pictures,
    ".npy": _array,
    ".png": _pictures,
    ".tsv": lambda path, check: _tables(read_text(path), path, check),
    ".txt": _signs,
}
SUFFIXES = tuple(READERS)


LARGEST_TABLE = 6
"""Channels up to which all 2ⁿ states are spelled out (paper Table I has n = 2)."""
MOST_LEVELS = 1 << 25
"""Levels that are held at once: a quarter of a gigabyte."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Levels (k, taxels) in 0 … 1 of k frames, taxels in the plan's order, and notes on lit pixels without a taxel."""

    levels: np.ndarray
    notes: tuple[str, ...]


def taxel_grid(plan: Plan) -> np.ndarray:
    """Return the pad as an image (rows, columns) of indices of taxels in the plan; -1 where none is.

    A taxel's place is that of its sub-cell, since washers need not lie on a lattice within their cells.
    """
    return taxel_places(plan)[::-1]


def _on_taxels(grid: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Return an image of the pad as levels (taxels,)."""
    levels = np.zeros(int(grid.max()) + 1)
    levels[grid[grid >= 0]] = image[grid >= 0]
    return levels


def read_frames(paths: str | Path | Iterable[str | Path], plan: Plan) -> Frames:
    """Read the frames of files, folders and file name patterns (``frames/*.png``), one after the other.

    What is in a folder or matches a pattern comes in order of names, numbers in them by value. The files:
    `padgen.driver.frames`. Pixels where the pad has no taxel are left out; lit ones are counted in a note.

    Raises
    ------
    FileError
        A file is missing, unreadable, of another shape than the pad, or holds what is no level in 0 … 1;
        or there are more frames than can be held. Frames, rows and columns are counted from 1, top left.
    """
    grid = taxel_grid(plan)
    lost = 0
    first = ""
    images: list[np.ndarray] = []
    for path in _files([paths] if isinstance(paths, (str, Path)) else paths):
        for frame, image in enumerate(_images(path, partial(_refuse_shape, plan, grid, images, path)), start=1):
            images.append(_on_taxels(grid, image))
            lit = np.argwhere((image > 0) & (grid < 0))
            if len(lit) and not lost:
                first = f"{path}, frame {frame}, row {lit[0][0] + 1}, column {lit[0][1] + 1}"
            lost += len(lit)
    if not images:
        raise FileError("must name a file, a folder or a pattern", "frames")
    note = f"pixels that are lit where the pad has no taxel, and are left out: {lost}; the first is {first}"
    return Frames(np.stack(images), (note,) if lost else ())


def _refuse_shape(
    plan: Plan, grid: np.ndarray, taken: list[np.ndarray], path: Path, frame: int, rows: int, columns: int
) -> None:
    """Refuse, before it is decoded, a frame of a wrong shape, or one more than are read at once."""
    if (rows, columns) != grid.shape:
        raise FileError(
            f"frame {frame} has {rows} row{plural(rows)} of {columns}; the pad shows {grid.shape[0]}"
            f" row{plural(grid.shape[0])} of {grid.shape[1]} pixel{plural(grid.shape[1])}: {plan.coils.rows} x"
            f" {plan.coils.columns} coils of {plan.cell.rows} x {plan.cell.columns} taxels",
            str(path),
        )
    most = MOST_LEVELS // len(plan.taxels)
    if len(taken) >= most:
        raise FileError(
            f"at most {most} frames of {len(plan.taxels)} taxels are read at once; frame {frame} is one too many",
            str(path),
        )


def _files(paths: Iterable[str | Path]) -> Iterator[Path]:
    from glob import glob

    for given in paths:
        text = str(given)
        path = Path(given)
        if not text.strip() or "\0" in text:
            raise FileError(f"must name a file, got {text!r}", "frames")
        try:
            if path.is_file():
                frame_files = [path]
                lacks = ""
            elif path.is_dir():
                frame_files = [
                    entry for entry in path.iterdir() if entry.suffix.lower() in SUFFIXES and entry.is_file()
                ]
                lacks = f"holds no frames; {', '.join(SUFFIXES)} files are read"
            elif any(sign in str(path) for sign in "*?["):
                frame_files = [Path(name) for name in glob(str(path)) if Path(name).is_file()]  # noqa: PTH207
                lacks = "no file has such a name"
            else:
                frame_files = []
                lacks = "is not a file" if path.exists() else "there is no such file"
        except OSError as error:
            raise FileError(f"cannot be read ({reason(error)})", text) from error
        if not frame_files:
            raise FileError(lacks, str(path))
        yield from sorted(frame_files, key=_by_value)


def _by_value(path: Path) -> tuple[list[tuple[bool, int, str]], str]:
    """Return a sort key that orders file names by the value of the numbers in them: 2.png before 10.png."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(k % 2 == 1, int(part) if k % 2 else 0, part) for k, part in enumerate(parts)], str(path)


def state_frames(plan: Plan, text: str) -> np.ndarray:
    """Return frames (k, taxels), one for each of the k states in `text`; within a frame all coils have the same state.

    A state is a digit 0 or 1 for each channel of a coil, its lowest first (``0110``), or levels between commas
    (``0,0.5,1,1``). Several, with blanks between them, and ``all`` for all 2ⁿ, make a frame each. With two
    sets of channels the digits count the coil's own.

    Raises
    ------
    SpecError
        The text is no state of this pad's coils, or ``all`` are more than 64.
    """
    count = len(plan.sets[0])
    where = "--state"
    if text.strip() == "all":
        if count > LARGEST_TABLE:
            raise SpecError(
                f"all states of {count} channels are {2**count}; at most {2**LARGEST_TABLE} are played one after the"
                " other, so name those that are wanted",
                where,
            )
        states = np.array(list(product((0.0, 1.0), repeat=count)))
    else:
        words = text.split() or [text]
        if len(words) * len(plan.taxels) > MOST_LEVELS:
            raise SpecError(f"must be at most {MOST_LEVELS // len(plan.taxels)} states, got {len(words)}", where)
        states = np.array([_state(word, count, where) for word in words])
    place = {channel.index: k for channel_set in plan.sets for k, channel in enumerate(channel_set)}
    return np.asarray(states[:, [place[taxel.channel] for taxel in plan.taxels]])


def _state(word: str, count: int, where: str) -> list[float]:
    cells = list(word) if re.fullmatch("[01]+", word) else word.split(",")
    word_shown = repr(word if len(word) <= 40 else word[:40] + "…")
    try:
        levels = [float(cell) for cell in cells]
    except ValueError:
        levels = []
    if len(levels) != count or "_" in word or not word.isascii():
        raise SpecError(
            f"a coil of this pad has {count} channel{plural(count)}, so a state is {count} digit{plural(count)} 0 or 1,"
            f" or {count} level{plural(count)} 0 … 1{' between commas' if count > 1 else ''}; got {word_shown}",
            where,
        )
    for level in levels:
        if not 0 <= level <= 1:
            raise SpecError(f"levels must be in 0 … 1, got {number(level)} in {word_shown}", where)
    return levels


def map_text(plan: Plan) -> str:
    """Write which taxel is at each pixel, as seen from the touch side: rows of names, '-' where none is."""
    grid = taxel_grid(plan)
    names = [[plan.taxels[index].id if index >= 0 else "-" for index in row] for row in grid.tolist()]
    width = max(len(name) for row in names for name in row)
    return "\n".join("  ".join(name.ljust(width) for name in row).rstrip() for row in names)


def frames_text(plan: Plan, levels: np.ndarray) -> str:
    """Draw frames (k, taxels), or one (taxels,), with signs: '#' for ON, '+' between, '.' for OFF, ' ' no taxel."""
    grid = taxel_grid(plan)
    signs = np.array([".", "+", "#", " "])
    pictures = []
    for frame in np.atleast_2d(levels):
        kind = np.where(frame >= 1, 2, np.where(frame > 0, 1, 0))
        drawn = signs[np.where(grid < 0, 3, kind[grid])]
        pictures.append("".join("".join(row) + "\n" for row in drawn))
    return "\n".join(pictures)


GLYPH_ROWS = 7
GLYPH_COLUMNS = 5
FONT = """
A     B     C     D     E     F     G     H     I     J     K     L     M
.###. ####. .###. ####. ##### ##### .###. #...# .###. ..### #...# #.... #...#
#...# #...# #...# #...# #.... #.... #...# #...# ..#.. ...#. #..#. #.... ##.##
#...# #...# #.... #...# #.... #.... #.... #...# ..#.. ...#. #.#.. #.... #.#.#
##### ####. #.... #...# ####. ####. #.### ##### ..#.. ...#. ##... #.... #.#.#
#...# #...# #.... #...# #.... #.... #...# #...# ..#.. ...#. #.#.. #.... #...#
#...# #...# #...# #...# #.... #.... #...# #...# ..#.. #..#. #..#. #.... #...#
#...# ####. .###. ####. ##### #.... .###. #...# .###. .##.. #...# ##### #...#
N     O     P     Q     R     S     T     U     V     W     X     Y     Z
#...# .###. ####. .###. ####. .#### ##### #...# #...# #...# #...# #...# #####
##..# #...# #...# #...# #...# #.... ..#.. #...# #...# #...# #...# #...# ....#
##..# #...# #...# #...# #...# #.... ..#.. #...# #...# #...# .#.#. .#.#. ...#.
#.#.# #...# ####. #...# ####. .###. ..#.. #...# #...# #.#.# ..#.. ..#.. ..#..
#..## #...# #.... #.#.# #.#.. ....# ..#.. #...# .#.#. #.#.# .#.#. ..#.. .#...
#..## #...# #.... #..#. #..#. ....# ..#.. #...# .#.#. ##.## #...# ..#.. #....
#...# .###. #.... .##.# #...# ####. ..#.. .###. ..#.. #...# #...# ..#.. #####
0     1     2     3     4     5     6     7     8     9     .     ,     :
.###. ..#.. .###. .###. ...#. ##### .###. ##### .###. .###. ..... ..... .....
#...# .##.. #...# #...# ..##. #.... #...# ....# #...# #...# ..... ..... ..#..
#..## ..#.. ....# ....# .#.#. ####. #.... ...#. #...# #...# ..... ..... ..#..
#.#.# ..#.. ...#. ..##. #..#. ....# ####. ...#. .###. .#### ..... ..... .....
##..# ..#.. ..#.. ....# ##### ....# #...# ..#.. #...# ....# ..... ..#.. ..#..
#...# ..#.. .#... #...# ...#. #...# #...# ..#.. #...# #...# .##.. ..#.. ..#..
.###. .###. ##### .###. ...#. .###. .###. ..#.. .###. .###. .##.. .#... .....
!     ?     -     +     =     /     (     )     '     "     #     *     _
..#.. .###. ..... ..... ..... ....# ...#. .#... ..#.. .#.#. .#.#. ..... .....
..#.. #...# ..... ..#.. ..... ....# ..#.. ..#.. ..#.. .#.#. .#.#. #.#.# .....
..#.. ....# ..... ..#.. ##### ...#. ..#.. ..#.. ..... ..... ##### .###. .....
..#.. ...#. ##### ##### ..... ..#.. ..#.. ..#.. ..... ..... .#.#. ##### .....
..#.. ..#.. ..... ..#.. ##### .#... ..#.. ..#.. ..... ..... ##### .###. .....
..... ..... ..... ..#.. ..... #.... ..#.. ..#.. ..... ..... .#.#. #.#.# .....
..#.. ..#.. ..... ..... ..... #.... ...#. .#... ..... ..... .#.#. ..... #####
"""
LONGEST_TEXT = 1000


def _glyphs() -> dict[str, np.ndarray]:
    """Return the font: arrays (7, 5) of 0 and 1 by their character."""
    lines = FONT.strip("\n").split("\n")
    glyphs = {" ": np.zeros((GLYPH_ROWS, GLYPH_COLUMNS))}
    for start in range(0, len(lines), GLYPH_ROWS + 1):
        rows = [line.split() for line in lines[start + 1 : start + 1 + GLYPH_ROWS]]
        for k, sign in enumerate(lines[start].split()):
            glyphs[sign] = np.array([[float(pixel == "#") for pixel in row[k]] for row in rows])
    return glyphs


def text_frames(plan: Plan, text: str) -> np.ndarray:
    """Return levels (k, taxels) in 0 … 1 that show `text`: one frame where it fits, else scrolled column by column.

    Small letters are shown as capitals, and accents are left out.

    Raises
    ------
    SpecError
        There is no letter, one that the font does not have, or the text is too long.
    """
    grid = taxel_grid(plan)
    glyphs = _glyphs()
    signs = [sign for sign in unicodedata.normalize("NFD", text.upper()) if not unicodedata.combining(sign)]
    if not "".join(signs).strip() or len(signs) > LONGEST_TEXT:
        raise SpecError(f"must have a letter to show, and {LONGEST_TEXT} at most, got {shown(text)}", "--text")
    if unknown := next((sign for sign in signs if sign not in glyphs), None):
        raise SpecError(f"{shown(unknown)} is none of the signs that are drawn: {''.join(glyphs).strip()}", "--text")
    blank = np.zeros((GLYPH_ROWS, 1))
    pixels = np.concatenate([part for sign in signs for part in (blank, glyphs[sign])][1:], axis=1)
    rows, columns = grid.shape
    high, wide = _pixel(rows, columns, plan.cell.depth_mm / plan.cell.width_mm)
    drawn = _scaled(_scaled(pixels, wide).T, high).T
    spare = [max(free, 0) for free in np.subtract(grid.shape, drawn.shape)]
    drawn = np.pad(drawn, [(free // 2, free - free // 2) for free in spare])
    windows = (drawn[:, at : at + columns] for at in range(drawn.shape[1] - columns + 1))
    return _levels(plan, windows, "--text")


def _pixel(rows: int, columns: int, aspect: float) -> tuple[float, float]:
    """Return height in taxel rows and width in taxel columns of a letter's pixel; `aspect`: row pitch/column pitch."""
    high = rows / GLYPH_ROWS
    if rows >= GLYPH_ROWS:
        high = max(int(min(high, columns / GLYPH_COLUMNS / aspect)), 1)
    if columns < GLYPH_COLUMNS:
        return high, columns / GLYPH_COLUMNS
    return high, min(max(round(high * aspect), 1), columns // GLYPH_COLUMNS)


def _scaled(pixels: np.ndarray, size: float) -> np.ndarray:
    """Resample `pixels` (…, n) along the last axis to `size` times as many, each the mean of what it covers."""
    count = pixels.shape[-1]
    edge = np.minimum(np.arange(int(np.ceil(count * size - 1e-9)) + 1) / size, count)
    pixel = np.minimum(edge.astype(int), count - 1)
    up_to = np.pad(np.cumsum(pixels, -1), [(0, 0), (1, 0)])[:, pixel] + (edge - pixel) * pixels[:, pixel]
    return np.asarray(np.round(np.diff(up_to) * size, 9))


def _bars(grid: np.ndarray, axis: int, half_width: float) -> Iterator[np.ndarray]:
    """Yield a bar across the pad at each row (axis 0) or column (axis 1), fading out on both sides."""
    place = np.indices(grid.shape)[axis]
    return (np.maximum(1 - np.abs(place - at) / half_width, 0.0) for at in range(grid.shape[axis]))


PATTERNS: dict[str, Callable[[np.ndarray], Iterator[np.ndarray]]] = {
    "each": lambda grid: (grid == index for index in range(int(grid.max()) + 1)),
    "rows": lambda grid: _bars(grid, 0, 1),
    "columns": lambda grid: _bars(grid, 1, 1),
    "checkerboard": lambda grid: (np.indices(grid.shape).sum(0) % 2 == odd for odd in (0, 1)),
    "sweep": lambda grid: chain(_bars(grid, 1, 2), _bars(grid, 0, 2)),
}
"""Images (rows, columns) of each pattern for the grid of a pad's taxels; 'each' goes in the plan's order, by coils."""


CROSSED = "crossed"
"""The pattern in which each output plays the tones of the other set of resonances (`padgen.driver.wiring`)."""


def pattern_frames(plan: Plan, name: str) -> np.ndarray:
    """Return levels (k, taxels) in 0 … 1 of the pattern called `name`; raises SpecError where there is none."""
    if name not in PATTERNS:
        raise unknown_name(name, [*PATTERNS, CROSSED], "pattern", "--pattern")
    return _levels(plan, PATTERNS[name](taxel_grid(plan)), "--pattern")


def _levels(plan: Plan, images: Iterable[np.ndarray], where: str) -> np.ndarray:
    """Return images of the pad as levels (k, taxels); raises SpecError where they are too many."""
    grid = taxel_grid(plan)
    most = MOST_LEVELS // len(plan.taxels)
    frames: list[np.ndarray] = []
    for image in images:
        if len(frames) == most:
            raise SpecError(
                f"takes more than {most} frames of {len(plan.taxels)} taxels, which are held at once", where
            )
        frames.append(_on_taxels(grid, image))
    return np.stack(frames)
