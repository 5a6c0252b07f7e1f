"""What the pad shows: images, tables and states → levels of all taxels in the plan's order.

Seen from the touch side a pad is an image: row 1 at the top (the largest y), column 1 at the left (the smallest x),
one pixel for each sub-cell of each coil's cell. A level is a share of a taxel's ON amplitude, 0 … 1.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, SpecError, number
from padgen.driver.frame_files import SUFFIXES, frame_images
from padgen.driver.states import LARGEST_TABLE
from padgen.planner.plan import Plan
from padgen.planner.tile import taxel_places

__all__ = ["Frames", "frames_text", "map_text", "read_frames", "state_frame", "taxel_grid"]

MOST_LEVELS = 1 << 25
"""Levels that are held at once: a quarter of a gigabyte."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """`levels` (k, taxels) of k frames in 0 … 1, taxels as in the plan, and sentences on what was left out."""

    levels: np.ndarray
    notes: tuple[str, ...]


def taxel_grid(plan: Plan) -> np.ndarray:
    """The pad as an image (rows, columns): which taxel, by index in the plan, is at each place; -1 where none is.

    A taxel's place is that of its sub-cell, since washers need not lie on a lattice within their cells.
    """
    return taxel_places(plan)[::-1]


def read_frames(paths: str | Path | Iterable[str | Path], plan: Plan) -> Frames:
    """The frames of files, folders and patterns (``frames/*.png``), one after the other.

    What is in a folder or matches a pattern comes in order of names, numbers in them by value. The files:
    `padgen.driver.frame_files`. Pixels where the pad has no taxel are left out; lit ones are counted in a note.

    Raises
    ------
    FileError
        A file is missing, unreadable, of another shape than the pad, or holds what is no level in 0 … 1;
        or there are more frames than can be held. Frames, rows and columns are counted from 1, top left.
    """
    grid = taxel_grid(plan)
    taken, lost = _Taken(plan, grid), 0
    images: list[np.ndarray] = []
    first = ""
    for path in _files([paths] if isinstance(paths, (str, Path)) else paths):
        for image in frame_images(path, taken.checked_in(str(path))):
            images.append(_by_taxel(image, grid, len(plan.taxels)))
            lit = np.argwhere((image > 0) & (grid < 0))
            if len(lit) and not lost:
                first = f"{path}, frame {taken.number}, row {lit[0][0] + 1}, column {lit[0][1] + 1}"
            lost += len(lit)
    if not images:
        raise FileError("must name a file, a folder or a pattern", "frames")
    note = f"pixels that are lit where the pad has no taxel, and are left out: {lost}; the first is {first}"
    return Frames(np.stack(images), (note,) if lost else ())


class _Taken:
    """Counts the frames that are read, and refuses those of a wrong shape and those too many, before they are."""

    def __init__(self, plan: Plan, grid: np.ndarray) -> None:
        coils, cell = plan.coils, plan.cell
        self._shape = grid.shape
        self._pad = (
            f"{grid.shape[0]} x {grid.shape[1]}: {coils.rows} x {coils.columns} coils"
            f" of {cell.rows} x {cell.columns} taxels"
        )
        self._taxels, self._most = len(plan.taxels), MOST_LEVELS // len(plan.taxels)
        self._all = self.number = 0

    def checked_in(self, where: str) -> Callable[[int, int], None]:
        """What a reader calls with the rows and columns of each frame before it hands it over."""
        self.number = 0

        def check(rows: int, columns: int) -> None:
            self.number += 1
            self._all += 1
            if (rows, columns) != self._shape:
                raise FileError(f"frame {self.number} is {rows} x {columns}; the pad shows {self._pad}", where)
            if self._all > self._most:
                raise FileError(
                    f"at most {self._most} frames of {self._taxels} taxels are read at once; frame {self.number}"
                    " is one too many",
                    where,
                )

        return check


def _by_taxel(image: np.ndarray, grid: np.ndarray, taxels: int) -> np.ndarray:
    levels = np.zeros(taxels)
    levels[grid[grid >= 0]] = image[grid >= 0]
    return levels


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
    """Order of names with the numbers in them by value: 2.png before 10.png."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(k % 2 == 1, int(part) if k % 2 else 0, part) for k, part in enumerate(parts)], str(path)


def state_frame(plan: Plan, text: str) -> np.ndarray:
    """Frames (k, taxels) in which every coil is in the same state.

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
    frames: np.ndarray = states[:, [place[taxel.channel] for taxel in plan.taxels]]
    return frames


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
    """Which taxel is at each pixel, as seen from the touch side: rows of names, '-' where none is."""
    grid = taxel_grid(plan)
    names = [[plan.taxels[index].id if index >= 0 else "-" for index in row] for row in grid.tolist()]
    width = max(len(name) for row in names for name in row)
    return "\n".join("  ".join(name.ljust(width) for name in row).rstrip() for row in names)


def frames_text(plan: Plan, levels: np.ndarray) -> str:
    """Frames (k, taxels), or one (taxels,), as small pictures: '#' for ON, '+' between, '.' for OFF, ' ' no taxel."""
    grid = taxel_grid(plan)
    signs = np.array([".", "+", "#", " "])
    pictures = []
    for frame in np.atleast_2d(levels):
        kind = np.where(frame >= 1, 2, np.where(frame > 0, 1, 0))
        shown = signs[np.where(grid < 0, 3, kind[grid])]
        pictures.append("".join("".join(row) + "\n" for row in shown))
    return "\n".join(pictures)
