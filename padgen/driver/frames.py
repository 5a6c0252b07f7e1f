"""Read images, tables and states as levels of all taxels, in the plan's order.

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
"""

import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby, islice, product
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from padgen.core.errors import FileError, SpecError, number
from padgen.core.files import read_bounded
from padgen.planner.layout import taxel_places
from padgen.planner.plan import Plan

if TYPE_CHECKING:
    from PIL import Image

__all__ = [
    "LARGEST_TABLE",
    "SUFFIXES",
    "Check",
    "Frames",
    "frame_images",
    "frames_text",
    "map_text",
    "read_frames",
    "state_frame",
    "taxel_grid",
]

Row = TypeVar("Row")
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


def frame_images(path: Path, check: Check) -> Iterator[np.ndarray]:
    """Yield the frames of a file, each (rows, columns) with values in 0 … 1.

    Raises
    ------
    FileError
        The file is none of these, is damaged, or has what is no level.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise FileError(f"is none of the files that hold frames: {', '.join(SUFFIXES)}", str(path))
    frames = 0
    try:
        if path.exists() and not path.is_file():
            raise FileError("is not a file", str(path))
        for image in reader(path, check):
            frames += 1
            yield image
    except OSError as error:
        raise FileError(f"cannot be read ({error.strerror or type(error).__name__})", str(path)) from error
    if not frames:
        raise FileError("is empty; a frame is due", str(path))


def _pictures(path: Path, check: Check) -> Iterator[np.ndarray]:
    import struct
    import zlib

    from PIL import Image, UnidentifiedImageError

    damage = (SyntaxError, ValueError, EOFError, IndexError, KeyError, struct.error, zlib.error)
    try:
        with _opened(path) as image:
            still = int(getattr(image, "default_image", False))  # a picture for viewers that show no animation
            for k in range(still, getattr(image, "n_frames", 1)):
                image.seek(k)
                check(k + 1 - still, image.height, image.width)
                yield _grey(image)
    except UnidentifiedImageError as error:
        raise FileError("is not a PNG or GIF picture", str(path)) from error
    except Image.DecompressionBombError as error:
        raise FileError("is a picture of more pixels than any pad", str(path)) from error
    except (*damage, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise FileError(f"is a damaged picture ({error})", str(path)) from error


def _opened(path: Path) -> "Image.Image":
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its size, which is checked before it is decoded
        return Image.open(path, formats=("PNG", "GIF"))


def _grey(image: "Image.Image") -> np.ndarray:
    if image.mode.startswith("I"):
        return np.asarray(np.asarray(image).astype(float) / 65535)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a palette's way to be transparent
        colours = np.asarray(image.convert("RGBA")).astype(np.int64)
    return np.asarray((colours[..., :3] @ LUMINANCE) * colours[..., 3] / (255_000 * 255))


def _text(path: Path) -> str:
    try:
        return read_bounded(path, LARGEST_TEXT, "a text of frames").decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"is not text: byte {error.start} is not UTF-8", str(path)) from error


def _tables(text: str, path: Path, check: Check) -> Iterator[np.ndarray]:
    delimiter = next((sign for sign in ";\t," if sign in text), None)
    rows = ([cell.strip() for cell in line.split(delimiter)] for line in text.splitlines())
    blocks = (_block(block, path) for filled, block in groupby(rows, key=any) if filled)
    for frame, block in enumerate(blocks, start=1):
        _refuse_ragged(block, frame, path, "numbers")
        check(frame, len(block), len(block[0]))
        values = np.empty((len(block), len(block[0])))
        for row, cells in enumerate(block):
            for column, cell in enumerate(cells):
                try:
                    values[row, column] = float("" if "_" in cell else cell)  # which Python takes in numbers
                except ValueError as error:
                    got = f"got {cell if len(cell) <= 40 else cell[:40] + '…'!r}" if cell else "is empty"
                    hint = "; decimals take a point" if re.fullmatch(r"\d*,\d+", cell) else ""
                    at = _place(frame, row, column)
                    raise FileError(f"{at} must be a number in 0 … 1, {got}{hint}", str(path)) from error
        _refuse_levels(values, frame, path)
        yield values


def _block(rows: Iterator[Row], path: Path) -> list[Row]:
    """Return the rows of a frame, not more than a pad can have."""
    block = list(islice(rows, MOST_ROWS + 1))
    if len(block) > MOST_ROWS:
        raise FileError(f"has a frame of more than {MOST_ROWS} rows", str(path))
    return block


def _place(frame: int, row: int, column: int) -> str:
    return f"frame {frame}, row {row + 1}, column {column + 1}"


def _refuse_ragged(block: Sequence[Sequence[str]], frame: int, path: Path, what: str) -> None:
    first = len(block[0])
    for row, cells in enumerate(block):
        if len(cells) != first:
            raise FileError(
                f"frame {frame}, row {row + 1} has {len(cells)} {what}, its row 1 has {first}; all must have as many",
                str(path),
            )


def _refuse_levels(values: np.ndarray, frame: int, path: Path) -> None:
    bad = np.argwhere(~((values >= 0) & (values <= 1)))
    if len(bad):
        row, column = (int(k) for k in bad[0])
        value = float(values[row, column])
        near = "" if np.isnan(value) else f"; {0 if value < 0 else 1} would do"
        raise FileError(f"{_place(frame, row, column)} must be a level in 0 … 1, got {number(value)}{near}", str(path))


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
                row, column = (int(k) for k in bad[0])
                raise FileError(
                    f"{_place(frame, row, column)} must be 0 or 1 in an array of whole numbers that is neither of bytes"
                    f" nor of unsigned 16 bits, got {number(float(values[row, column]))}",
                    str(path),
                )
        _refuse_levels(values, frame, path)
        yield values


def _signs(path: Path, check: Check) -> Iterator[np.ndarray]:
    text = _text(path)
    if any(sign in text for sign in ";\t,"):
        yield from _tables(text, path, check)
        return
    lines = text.splitlines()
    if all(re.fullmatch(r"[01]( [01])+ *", line) for line in lines if line):
        lines = [line.replace(" ", "") for line in lines]
    # Editors take blanks off the ends of lines: they are put back where blanks are what OFF is written as.
    pads = not any(sign in text for sign in "0.")
    blocks = (_block(block, path) for filled, block in groupby(lines, key=bool) if filled)
    for frame, block in enumerate(blocks, start=1):
        width = max(len(line) for line in block)
        rows = [line.ljust(width) if pads else line for line in block]
        _refuse_ragged(rows, frame, path, "signs")
        check(frame, len(rows), width)
        for row, line in enumerate(rows):
            for column, sign in enumerate(line):
                if sign not in SIGNS:
                    at = _place(frame, row, column)
                    raise FileError(
                        f"{at} must be 1 or # for ON, 0 or . or a blank for OFF or + for a half, got {sign!r};"
                        " numbers go into a .csv file",
                        str(path),
                    )
        yield np.array([[SIGNS[sign] for sign in line] for line in rows])


READERS: dict[str, Callable[[Path, Check], Iterator[np.ndarray]]] = {
    ".csv": lambda path, check: _tables(_text(path), path, check),
    ".gif": _pictures,
    ".npy": _array,
    ".png": _pictures,
    ".tsv": lambda path, check: _tables(_text(path), path, check),
    ".txt": _signs,
}
SUFFIXES = tuple(READERS)


LARGEST_TABLE = 6
"""Channels up to which all 2ⁿ states are spelled out (paper Table I has n = 2)."""
MOST_LEVELS = 1 << 25
"""Levels that are held at once: a quarter of a gigabyte."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """`levels` (k, taxels) of k frames in 0 … 1, taxels as in the plan, and sentences on what was left out."""

    levels: np.ndarray
    notes: tuple[str, ...]


def taxel_grid(plan: Plan) -> np.ndarray:
    """Return the pad as an image (rows, columns) of indices of taxels in the plan; -1 where none is.

    A taxel's place is that of its sub-cell, since washers need not lie on a lattice within their cells.
    """
    return taxel_places(plan)[::-1]


def read_frames(paths: str | Path | Iterable[str | Path], plan: Plan) -> Frames:
    """Read the frames of files, folders and patterns (``frames/*.png``), one after the other.

    What is in a folder or matches a pattern comes in order of names, numbers in them by value. The files:
    `padgen.driver.frames`. Pixels where the pad has no taxel are left out; lit ones are counted in a note.

    Raises
    ------
    FileError
        A file is missing, unreadable, of another shape than the pad, or holds what is no level in 0 … 1;
        or there are more frames than can be held. Frames, rows and columns are counted from 1, top left.
    """
    grid = taxel_grid(plan)
    lost, first = 0, ""
    images: list[np.ndarray] = []
    for path in _files([paths] if isinstance(paths, (str, Path)) else paths):
        for frame, image in enumerate(frame_images(path, partial(_refuse_shape, plan, grid, images, path)), start=1):
            images.append(np.zeros(len(plan.taxels)))
            images[-1][grid[grid >= 0]] = image[grid >= 0]
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
    """Refuse a frame of a wrong shape, and one more than can be held, before it is read."""
    if (rows, columns) != grid.shape:
        raise FileError(
            f"frame {frame} is {rows} x {columns}; the pad shows {grid.shape[0]} x {grid.shape[1]}: {plan.coils.rows} x"
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
    for given in paths:
        text, path = str(given), Path(given)
        if not text.strip() or "\0" in text:
            raise FileError(f"must name a file, got {text!r}", "frames")
        try:
            found = [path] if path.is_file() else _several(path)
        except OSError as error:
            raise FileError(f"cannot be read ({error.strerror})", text) from error
        yield from sorted(found, key=_by_value)


def _several(path: Path) -> list[Path]:
    from glob import glob

    text = str(path)
    if path.is_dir():
        found = [entry for entry in path.iterdir() if entry.suffix.lower() in SUFFIXES and entry.is_file()]
        lacks = f"holds no frames; {', '.join(SUFFIXES)} files are read"
    else:
        wild = any(sign in text for sign in "*?[")
        found = [Path(name) for name in glob(text) if Path(name).is_file()] if wild else []  # noqa: PTH207
        lacks = "no file has such a name" if wild else "is not a file" if path.exists() else "there is no such file"
    if not found:
        raise FileError(lacks, text)
    return found


def _by_value(path: Path) -> tuple[list[tuple[bool, int, str]], str]:
    """Order names with the numbers in them by value: 2.png before 10.png."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(k % 2 == 1, int(part) if k % 2 else 0, part) for k, part in enumerate(parts)], str(path)


def state_frame(plan: Plan, text: str) -> np.ndarray:
    """Return frames (k, taxels) in which every coil is in the same state.

    A state is a digit 0 or 1 for each channel of a coil, its lowest first (``0110``), or levels between commas
    (``0,0.5,1,1``). Several, with blanks between them, and ``all`` for all 2ⁿ, make a frame each. With two
    sets of channels the digits count the coil's own.

    Raises
    ------
    SpecError
        The text is no state of this pad's coils, or ``all`` are more than 64.
    """
    count, where = len(plan.sets[0]), "--state"
    if text.strip() == "all":
        if count > LARGEST_TABLE:
            raise SpecError(
                f"all states of {count} channels are {2**count}; at most {2**LARGEST_TABLE} are played one after the"
                " other, so name those that are wanted",
                where,
            )
        states = np.array(list(product((0.0, 1.0), repeat=count)))
    else:
        words = text.split()
        if not words:
            raise SpecError(f"must have {_asked(count)}, got {text!r}", where)
        if len(words) * len(plan.taxels) > MOST_LEVELS:
            raise SpecError(f"must be at most {MOST_LEVELS // len(plan.taxels)} states, got {len(words)}", where)
        states = np.array([_state(word, count, where) for word in words])
    place = {channel.index: k for own in plan.sets for k, channel in enumerate(own)}
    return np.asarray(states[:, [place[taxel.channel] for taxel in plan.taxels]])


def _asked(count: int) -> str:
    return f"{count} digits 0 or 1, or as many levels 0 … 1 between commas, one for each channel of a coil"


def _state(word: str, count: int, where: str) -> list[float]:
    cells = list(word) if re.fullmatch("[01]+", word) else word.split(",")
    shown = repr(word if len(word) <= 40 else word[:40] + "…")
    try:
        levels = [float(cell) for cell in cells]
    except ValueError:
        levels = []
    if len(levels) != count or "_" in word or not word.isascii():
        raise SpecError(f"must have {_asked(count)}, got {shown}", where)
    for level in levels:
        if not 0 <= level <= 1:
            raise SpecError(f"levels must be in 0 … 1, got {number(level)} in {shown}", where)
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
        shown = signs[np.where(grid < 0, 3, kind[grid])]
        pictures.append("".join("".join(row) + "\n" for row in shown))
    return "\n".join(pictures)
