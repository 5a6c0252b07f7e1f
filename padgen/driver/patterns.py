"""Frames that need no file: text, patterns that check a new pad, and what they tell of its wiring.

Letters are 5 pixels wide and 7 high, a blank column between two. A pixel is as many whole rows and columns of taxels as
fit and keep it nearly square in mm; on a pad of fewer than 7 rows or 5 columns it is a share of one, in levels of grey.
"""

import csv
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, SpecError, shown
from padgen.core.files import read_bounded
from padgen.core.finding import Finding
from padgen.core.registry import unknown_name
from padgen.driver.frames import MOST_LEVELS, taxel_grid
from padgen.planner.plan import Plan

__all__ = ["PATTERNS", "pattern_frames", "text_frames", "wiring_findings"]

GLYPH_ROWS, GLYPH_COLUMNS = 7, 5
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
LARGEST_FELT = 1 << 24
"""Bytes of a table of what was felt."""


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
    grid, glyphs = taxel_grid(plan), _glyphs()
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
    """Return height and width of a font's pixel in rows and columns; `aspect` is a row's step over a column's."""
    high = rows / GLYPH_ROWS
    if rows >= GLYPH_ROWS:
        high = max(int(min(high, columns / GLYPH_COLUMNS / aspect)), 1)
    if columns < GLYPH_COLUMNS:
        return high, columns / GLYPH_COLUMNS
    return high, min(max(round(high * aspect), 1), columns // GLYPH_COLUMNS)


def _scaled(pixels: np.ndarray, size: float) -> np.ndarray:
    """Return `pixels` (…, n) with each of them `size` places wide; a place has the mean of what lies in it."""
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


def pattern_frames(plan: Plan, name: str) -> np.ndarray:
    """Return levels (k, taxels) in 0 … 1 of the pattern called `name`; raises SpecError where there is none."""
    if name not in PATTERNS:
        raise unknown_name(name, list(PATTERNS), "pattern", "--pattern")
    return _levels(plan, PATTERNS[name](taxel_grid(plan)), "--pattern")


def _levels(plan: Plan, images: Iterable[np.ndarray], where: str) -> np.ndarray:
    """Return images of the pad as levels (k, taxels); raises SpecError where they are too many."""
    grid, most = taxel_grid(plan), MOST_LEVELS // len(plan.taxels)
    frames: list[np.ndarray] = []
    for image in images:
        if len(frames) == most:
            raise SpecError(
                f"takes more than {most} frames of {len(plan.taxels)} taxels, which are held at once", where
            )
        frames.append(np.zeros(len(plan.taxels)))
        frames[-1][grid[grid >= 0]] = image[grid >= 0]
    return np.stack(frames)


Coil = tuple[int, int]
LEAST_HEARD = 1 / 3
"""Least answer of a taxel over the middle one's of its channel: coils around move it by a tenth at most."""


def wiring_findings(plan: Plan, path: Path) -> list[Finding]:
    """Say which coils are swapped by what was felt: rows ``played,felt`` of taxels, `felt` empty where nothing was.

    A WAV, or a folder of recordings named after taxels as `padgen.measured.read` reads them, tells it too: a taxel
    moves where it answers to its own coil's current about as the others of its channel do. Swapped leads of one coil
    cannot be felt and do no harm: it pulls with the square of its current.

    Raises
    ------
    FileError
        The file is no such table, or names a taxel that the pad does not have.
    """
    taxels = {taxel.id: taxel for taxel in plan.taxels}
    felt: dict[Coil, list[Coil | None]] = {}
    findings, heard = [], path.is_dir() or path.suffix.lower() in (".wav", ".wave")
    for row, (played, got) in (_heard_rows if heard else _felt_rows)(plan, path):
        for name in filter(None, (played, got)):
            if name not in taxels:
                raise FileError(unknown_name(name, list(taxels), "taxel", "").message, f"{path}, row {row}")
        own = taxels[played].coil
        felt.setdefault(own, []).append(taxels[got].coil if got else None)
        if got and got != played and taxels[got].coil == own:
            told = (
                f"was felt as {got} of the same coil: the two resonances are exchanged, or {played} is far off its own"
            )
            findings.append(Finding("warning", "wiring.taxel", played, f"{told}; measure the print (padgen retune)"))
    moved: dict[Coil, Coil] = {}
    silent = [_coil(own) for own, places in felt.items() if not any(places)]
    if heard and len(silent) == 2 < len(felt):
        told = "are the only silent ones: if both are connected, their plugs are exchanged"
        findings.append(Finding("error", "wiring.swapped", " and ".join(silent), told))
    for own, places in felt.items():
        counts = Counter(place for place in places if place)
        if not counts:
            sense = "heard" if heard else "felt"
            told = f"nothing was {sense} when it was played: look at its wire, its plug and its amplifier channel"
            findings.append(Finding("error", "wiring.silent", _coil(own), told))
        elif len(counts) > 1:
            where = " and ".join(_coil(place) for place in sorted(counts))
            findings.append(Finding("error", "wiring.mixed", _coil(own), f"was felt at {where}: play its taxels again"))
        elif None in places:
            told = (
                f"{places.count(None)} of its {len(places)} taxels were not felt: are their washers glued in, and free?"
            )
            findings.append(Finding("warning", "wiring.silent", _coil(own), told))
        if len(counts) == 1 and own not in counts:
            moved[own] = next(iter(counts))
    findings += _moved_findings(plan, moved, set(felt))
    if untried := plan.coils.rows * plan.coils.columns - len(felt):
        findings.append(Finding("note", "wiring.untried", "coils", f"{untried} of them are not in the table"))
    return findings


Rows = Iterator[tuple[int, tuple[str, str]]]


def _heard_rows(plan: Plan, path: Path) -> Rows:
    """Yield each recorded taxel as felt where it is, or as silent."""
    from padgen.measured.fits import fitted
    from padgen.measured.read import read_measured

    measured = read_measured(path, plan)
    if measured.kind != "driven":
        raise FileError("must hold the current of a coil and the motion of its taxel in every recording", str(path))
    channel = {taxel.id: taxel.channel for taxel in plan.taxels}
    size = {c.id: 0.0 if c.cause else float(np.abs(c.seen.data).max()) for c in fitted(measured, plan)[1]}
    for row, (name, own) in enumerate(size.items(), start=1):
        usual = np.median([other for at, other in size.items() if other and channel[at] == channel[name]] or [0.0])
        yield row, (name, name if own > LEAST_HEARD * usual else "")


def _felt_rows(plan: Plan, path: Path) -> Rows:
    try:
        lines = read_bounded(path, LARGEST_FELT, "a table of what was felt").decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise FileError(f"is not text: byte {error.start} is not UTF-8", str(path)) from error
    rows = [(k, [cell.strip() for cell in row]) for k, row in enumerate(csv.reader(lines), start=1) if any(row)]
    if rows and rows[0][1] == ["played", "felt"]:
        del rows[0]
    for k, row in rows:
        if len(row) != 2 or not row[0]:
            raise FileError(
                f"must have the taxel that was played and the one that was felt, has {len(row)} cells",
                f"{path}, row {k}",
            )
        yield k, (row[0], row[1])
    if not rows:
        raise FileError("has no rows of played,felt", str(path))


def _moved_findings(plan: Plan, moved: dict[Coil, Coil], tried: set[Coil]) -> Iterator[Finding]:
    """Yield a finding for a plug that is on the wrong way, else for each pair that is swapped, else for each coil."""
    rows, columns = plan.coils.rows, plan.coils.columns
    whole: dict[str, Callable[[int, int], Coil]] = {
        "in the opposite order, the last first": lambda r, c: (rows - 1 - r, columns - 1 - c),
        "with left and right exchanged, as seen from the coils' side": lambda r, c: (r, columns - 1 - c),
        "with the first row of coils at the top, where it belongs at the bottom": lambda r, c: (rows - 1 - r, c),
        "column by column, where they belong row by row": lambda r, c: divmod(c * rows + r, columns),
    }
    for told, place in whole.items():
        if len(moved) > 2 and all(moved.get(coil, coil) == place(*coil) for coil in tried):
            yield Finding("error", "wiring.order", "coils", f"are all connected {told}")
            return
    for own, at in moved.items():
        if moved.get(at) == own:
            if own < at:
                pair = f"{_coil(own)} and {_coil(at)}"
                yield Finding("error", "wiring.swapped", pair, "are swapped: exchange their plugs")
        else:
            told = f"its amplifier channel is connected to {_coil(at)}"
            yield Finding("error", "wiring.swapped", _coil(own), told)


def _coil(coil: Coil) -> str:
    return f"coil r{coil[0]}c{coil[1]}"
