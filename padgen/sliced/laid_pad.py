"""Measurement of a pad in a slicer's G-code and its comments: its place on the bed, and each taxel as it is laid.

A file is read layer by layer, so that it may have any size. The reader knows straight moves and arcs (G0–G3), absolute
and relative coordinates and extrusion (G90, G91, M82, M83, G92), millimetres and inches (G20, G21). From a slicer's
comments it takes the kind and the height of the extrusions that follow. A new layer begins where the nozzle's height
changes, whatever comments say.

Every extrusion is cut into short pieces. Each piece is looked up in a map of its taxel (`TaxelMap`, one per channel),
which tells its body, its place along a beam, and the nearest station of a gap with its distance. The work grows with
the length of the extrusions.

A map is a fine grid over its sub-cell in its own axes; `PadMaps` looks up points of all taxels at once.
"""

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from math import acos, atan2, ceil, cos, hypot, nan, pi, sin
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import FileError, number, shown
from padgen.core.files import reason
from padgen.planner.layout import outline, taxel_places
from padgen.planner.plan import TURNS, Channel, Plan
from padgen.planner.suspensions import BeamPath
from padgen.planner.taxel_model import hollows_mm

__all__ = ["PLATE", "LaidPad", "Layer", "PadMaps", "Placing", "TaxelMap", "laid_pads", "read_layers", "read_settings"]

LONGEST_LINE = 1 << 16
END_BYTES = 1 << 18
"""Bytes at a file's beginning and end that are searched for the slicer's settings."""
MOST_MOVES = 3_000_000
"""Most extrusions in one layer; no pad has more."""
CHORD_MM = 0.005
"""Largest distance of an arc from the chords that replace it."""
INCH_MM = 25.4
SAME_Z_MM = 1e-4
NOT_OBJECT = (b"SKIRT", b"BRIM", b"PRIME", b"WIPE", b"CUSTOM", b"RAFT")
SUPPORT = b"SUPPORT"
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
    states it, nan where it states none. `top_mm` is the height of the nozzle. `supports` (m, 2, 2) are the ends in mm
    of extrusions that support the object, of this height and from the layer below on.
    """

    top_mm: float
    start: np.ndarray
    stop: np.ndarray
    area_mm2: np.ndarray
    height_mm: np.ndarray
    supports: np.ndarray

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
        cause = reason(error) if isinstance(error, OSError) else error
        raise FileError(f"cannot be read ({cause})", str(path)) from error
    if not begin.strip():
        raise FileError("is empty", str(path))
    for magic, cause in OTHER_FILES:
        if begin.startswith(magic):
            raise FileError(cause, str(path))
    if b"\0" in begin:
        stl = size == 84 + 50 * int.from_bytes(begin[80:84], "little")
        raise FileError(OTHER_FILES[4][1] if stl else "is binary, not G-code as text", str(path))
    settings = {key.decode(): value.decode(errors="replace") for key, value in SETTING.findall(begin + b"\n" + end)}
    slicer = SLICER.search(begin)
    return settings | ({"slicer": slicer[1].decode(errors="replace")} if slicer else {})


def read_layers(path: Path, filament_mm: float) -> Iterator[Layer]:
    """Read the layers of a file in the order in which they are laid.

    `filament_mm` is the filament's diameter, by which fed lengths become volumes.

    Raises
    ------
    FileError
        A move cannot be read, or a layer has more extrusions than any pad.
    """
    numbers = array("d")
    supports = array("d")
    for is_support, move in chain(_extrusions(path), [(False, ())]):  # after the last move, its layer ends
        if len(numbers) + len(supports) > MOST_MOVES * 7:
            raise FileError(f"has more than {MOST_MOVES} extrusions at one height; no pad has", str(path))
        if is_support:  # some slicers lay supports at heights of their own, which are no layers of the object
            supports.extend(move[:4])
            continue
        if numbers and (not move or abs(numbers[4] - move[4]) > SAME_Z_MM):
            rows = np.frombuffer(numbers).reshape(-1, 7)
            length = np.hypot(*(rows[:, 2:4] - rows[:, :2]).T)
            rows = rows[length > 0]
            length = length[length > 0]
            area_mm2 = rows[:, 5] * (pi / 4 * filament_mm**2) / length
            beneath = np.frombuffer(supports).reshape(-1, 2, 2)
            yield Layer(float(numbers[4]), rows[:, :2], rows[:, 2:4], area_mm2, rows[:, 6], beneath)
            numbers = array("d")
            supports = array("d")
        numbers.extend(move)


def _extrusions(path: Path) -> Iterator[tuple[bool, tuple[float, ...]]]:
    """Yield for each extrusion whether it is a support, and x, y, to_x, to_y, z, fed filament and height in mm.

    Arcs come as chords.
    """
    x = y = z = e = 0.0
    unit = 1.0
    is_relative = False
    is_e_relative = False
    is_beside = False
    is_support = False
    height = nan
    with path.open("rb") as file:
        for count, line in enumerate(iter(lambda: file.readline(LONGEST_LINE), b""), start=1):
            if len(line) == LONGEST_LINE:
                raise FileError("has a line that does not end; it is no G-code", str(path))
            if note := NOTE.match(line):
                if note[2]:
                    height = float(note[2])
                else:
                    kind = note[1].upper()
                    is_beside = kind.startswith(NOT_OBJECT)
                    is_support = kind.startswith(SUPPORT)
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
                words = _words(line, count, path)
                if unit != 1.0:
                    words = {letter: unit * value for letter, value in words.items()}
                # G92 states where the nozzle is, and moves nothing.
                moves = code != 92
                begin = (x, y)
                fed_before = e
                x = _moved(x, words.get(b"X"), moves and is_relative)
                y = _moved(y, words.get(b"Y"), moves and is_relative)
                z = _moved(z, words.get(b"Z"), moves and is_relative)
                e = _moved(e, words.get(b"E"), moves and (is_relative or is_e_relative))
                end = (x, y)
                fed = e - fed_before
                if not moves or fed <= 0 or is_beside or (code < 2 and begin == end):
                    continue
                if code < 2:
                    yield is_support, (*begin, *end, z, fed, height)
                elif b"I" in words or b"J" in words:
                    middle = begin[0] + words.get(b"I", 0.0), begin[1] + words.get(b"J", 0.0)
                    chords = _chords(begin, end, middle, 2 * code - 5)
                    for start, stop in pairwise(chords):
                        yield is_support, (*start, *stop, z, fed / (len(chords) - 1), height)
                else:
                    raise FileError(
                        f"line {count} is an arc by its radius; must be one by its middle (I, J), or lines", str(path)
                    )


def _moved(at: float, value: float | None, is_relative: bool) -> float:
    """Return the place along an axis after a move from `at`; `value` is None where the move does not name the axis."""
    if value is None:
        return at
    return at + value if is_relative else value


def _words(line: bytes, count: int, path: Path) -> dict[bytes, float]:
    """Return the numbers in a line of G-code, keyed by the letter before each."""
    text = line.partition(b";")[0].strip()
    parts = WORD.split(text)
    if b"".join(parts[::3]).strip():
        raise FileError(
            f"line {count} is no G-code that can be read: {shown(text.decode(errors='replace'))}", str(path)
        )
    return dict(zip(parts[1::3], map(float, parts[2::3]), strict=True))


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


PIXEL_MM = 0.02
MOST_PIXELS = 400_000
STATION_MM = 0.4
GAPS = (0.9, 1.6)
"""Least and largest width of a gap, over the plan's least gap; corners at a beam's ends are narrower."""
OPPOSITE = -0.8
"""Largest cosine of the angle between the directions to both sides of a gap."""
NEAR_MM = 1.2
"""Largest distance from the middle of a gap to the middle of a bead beside it."""
NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, -1), (-1, 1))
"""Steps from a pixel to those around it, the nearest first."""
NODE_MM = 0.5
MOST_NODES = 16
"""Distance between the nodes along a beam at which its width is measured, and the most nodes."""
FRAME = 1
PLATE = 2
BEAM = 3


class TaxelMap:
    """A pixel grid over a taxel's sub-cell: each pixel's body (frame, plate, beam), place on the beam and nearest gap.

    `owner` is the nearest body (`FRAME`, `PLATE`, or `BEAM` plus the beam's index), `node` the fractional node number
    along the beams (−1 off them), `station` the nearest station of a gap (−1: none near), `side` the side of that gap,
    `aside_mm` the distance of the pixel's middle from the gap's, and `outward` its direction from there (x + iy).
    `solid` is where the lowest layer has plastic.
    """

    def __init__(self, plan: Plan, channel: Channel) -> None:
        from scipy.ndimage import distance_transform_edt as distance

        arrangement = plan.arrangement(channel)
        sides = outline(plan, channel)
        long = sides.x1 - sides.x0
        wide = sides.y1 - sides.y0
        self.pixel_mm = max(PIXEL_MM, (long * wide / MOST_PIXELS) ** 0.5)
        self.low = np.array([sides.x0, sides.y0])
        self.shape = tuple(int(np.ceil(v / self.pixel_mm)) for v in (long, wide))
        x, y = (self.low[k] + (np.arange(self.shape[k]) + 0.5) * self.pixel_mm for k in (0, 1))
        x, y = x[:, None], y[None, :]
        length, width = (float(v) for v in arrangement.window_mm)
        frame = (x < 0) | (x > length) | (np.abs(y) > width / 2)
        corners = np.array([block[:4] for block in arrangement.blocks], float)
        inside = [(x > x0) & (x < x1) & (y > y0) & (y < y1) for x0, x1, y0, y1 in corners]
        plate = np.logical_or.reduce(inside)
        bodies = [frame, plate & ~frame]
        along = []
        self.beams: list[slice] = []
        weights: list[float] = []
        count = 0
        rest = ~frame & ~plate
        for path in arrangement.beams:
            run, pixel = self._run_mm(path)
            long_mm = float(path.length_mm)
            points = np.bincount(pixel, minlength=frame.size).reshape(self.shape)
            run_sum = np.bincount(pixel, run, frame.size).reshape(self.shape)
            near, at = distance(points == 0, self.pixel_mm, return_indices=True)
            mean_place = (run_sum / np.maximum(points, 1))[at[0], at[1]]
            fillet = channel.beam.fillet_mm * (not path.segments[0].turn_rad)
            flare = fillet - np.sqrt(np.maximum(fillet**2 - np.maximum(fillet - mean_place, 0) ** 2, 0))
            bodies.append((near < float(path.width_mm) / 2 + flare) & rest)
            steps = min(max(round(long_mm / NODE_MM), 4), MOST_NODES - 1)
            along.append(count + mean_place / long_mm * steps)
            self.beams.append(slice(count, count + steps + 1))
            weights += [share * long_mm / steps for share in (0.5, *[1.0] * (steps - 1), 0.5)]
            count += steps + 1
        self.node_mm = np.array(weights)
        far = (np.full(self.shape, np.inf), np.zeros((2, *self.shape), np.int32))
        nearest = [distance(~body, self.pixel_mm, return_indices=True) if body.any() else far for body in bodies]
        away = np.stack([n[0] for n in nearest])
        places = np.stack([n[1] for n in nearest])
        self.owner = (away.argmin(0) + 1).astype(np.int8)
        own_beam = [self.owner == BEAM + k for k in range(len(along))]
        self.node = np.select(own_beam, along, -1.0).astype(np.float32)
        solid = np.logical_or.reduce(bodies)
        washer_x = float(arrangement.washer_x_mm)
        sizes = plan.plate
        radius = np.hypot(x - washer_x, y)
        self.solid = solid & ~((radius < sizes.recess_diameter_mm / 2) & (radius > sizes.post_diameter_mm / 2))
        self._gaps(~solid, away, places, sizes.gap_mm)

    def _run_mm(self, path: BeamPath) -> tuple[np.ndarray, np.ndarray]:
        """Return points along a beam: their distances in mm from its root, and the pixels that they lie in."""
        runs = []
        points = []
        done = 0.0
        for k, segment in enumerate(path.segments):
            long = float(segment.length_mm)
            share = (np.arange(int(8 * long / self.pixel_mm) + 1) + 0.5) / (int(8 * long / self.pixel_mm) + 1)
            place = path.within(k, share)
            runs.append(done + share * long)
            points.append(np.stack(np.broadcast_arrays(place.x_mm, place.y_mm), -1).astype(float))
            done += long
        at = np.floor((np.concatenate(points) - self.low) / self.pixel_mm).astype(np.int64)
        at = np.clip(at, 0, np.array(self.shape) - 1)
        return np.concatenate(runs), at[:, 0] * self.shape[1] + at[:, 1]

    def _gaps(self, void: np.ndarray, away: np.ndarray, places: np.ndarray, gap_mm: float) -> None:
        """Set measuring points along the middle of each gap and, for each pixel near one, its point, side and distance.

        A gap has its two bodies on opposite sides, unlike a corner where a beam meets frame or plate.
        """
        from scipy.ndimage import distance_transform_edt as distance

        who = np.sort(np.argsort(away, 0)[:2], 0)
        one, other = (np.take_along_axis(away, k[None], 0)[0] for k in who)
        wide = one + other
        middle = (
            void & (np.abs(one - other) < 1.5 * self.pixel_mm) & (wide > GAPS[0] * gap_mm) & (wide < GAPS[1] * gap_mm)
        )
        at = np.stack(np.nonzero(middle))
        to_one, to_other = (places[k[middle], :, at[0], at[1]].T - at for k in who)
        middle[tuple(at)] = (to_one * to_other).sum(0) < OPPOSITE * np.hypot(*to_one) * np.hypot(*to_other)
        self.station = np.full(self.shape, -1, np.int32)
        self.side = np.zeros(self.shape, np.int8)
        self.aside_mm = np.full(self.shape, np.inf, np.float32)
        self.outward = np.zeros(self.shape, np.complex64)
        self.stations = 0
        if not middle.any():
            return
        off, at = distance(~middle, self.pixel_mm, return_indices=True)
        tile = [np.arange(n) * self.pixel_mm // STATION_MM for n in self.shape]
        name = ((who[0] * 64 + who[1]) * 1e8 + tile[0][:, None] * 1e4 + tile[1]).astype(np.int64)
        name = self._across(middle, who, name)
        names, station = np.unique(name[middle], return_inverse=True)
        numbers = np.zeros(self.shape, np.int32)
        numbers[middle] = station.ravel()
        lower, upper = (k[at[0], at[1]] + 1 for k in who)
        here = (off < NEAR_MM) & ((self.owner == lower) | (self.owner == upper))
        self.station[here] = numbers[at[0], at[1]][here]
        self.side[here] = (self.owner == upper)[here]
        # The middle is as thick as the pixels within rounding of it: the nearest one lies on this side of it.
        short = np.abs(one - other)[at[0], at[1]] / 2
        self.aside_mm[here] = (off + short)[here]
        apart = np.subtract(np.indices(self.shape), at)
        self.outward[here] = ((apart[0] + 1j * apart[1]) / np.maximum(np.hypot(*apart), 1))[here]
        self.stations = len(names)

    def _across(self, middle: np.ndarray, who: np.ndarray, name: np.ndarray) -> np.ndarray:
        """Return each pixel's measuring-point name, equal for adjoining pixels on both sides of a gap's middle.

        The middle is one or two pixels thick. One of the upper body takes the name of one of the lower body beside it.
        """
        is_lower = middle & (self.owner == who[0] + 1)
        at = np.stack(np.nonzero(middle & ~is_lower))
        taken = name[tuple(at)]
        is_alone = np.ones(at.shape[1], bool)
        for step in NEIGHBOURS:
            beside = at + np.array(step)[:, None]
            inside = ((beside >= 0) & (beside < np.array(self.shape)[:, None])).all(0)
            beside = tuple(np.where(inside, beside, 0))
            alike = (who[:, *at] == who[:, *beside]).all(0)
            here = is_alone & inside & is_lower[beside] & alike
            taken = np.where(here, name[beside], taken)
            is_alone &= ~here
        name = name.copy()
        name[tuple(at)] = taken
        return name


class PadMaps:
    """Look-up of points on a pad: the part of a taxel (frame, plate, beam, gap) that each lies in."""

    owner: np.ndarray
    node: np.ndarray
    station: np.ndarray
    side: np.ndarray
    aside_mm: np.ndarray
    outward: np.ndarray
    solid: np.ndarray

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.places = taxel_places(plan)
        self.maps = [TaxelMap(plan, channel) for channel in plan.channels]
        self.first = np.cumsum([0, *(m.owner.size for m in self.maps[:-1])])
        self.low = np.array([m.low for m in self.maps])
        self.shape = np.array([m.shape for m in self.maps])
        self.pixel_mm = np.array([m.pixel_mm for m in self.maps])
        for name in PadMaps.__annotations__:
            setattr(self, name, np.concatenate([getattr(m, name).ravel() for m in self.maps]))
        self.channel = np.array([t.channel for t in plan.taxels])
        ways = np.array([TURNS[c.site.along] for c in plan.channels], float)[self.channel]
        self.ways = ways * np.where([t.turned for t in plan.taxels], -1.0, 1.0)[:, None]
        self.axis = np.array([(t.x_mm, t.y_mm) for t in plan.taxels])
        washer = np.array([(float(plan.arrangement(c).washer_x_mm), 0.0) for c in plan.channels])
        self.corner = (self.low - washer)[self.channel]

    def cells(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return column and row of the sub-cell at points (…, 2) on the pad, and a mask of points that are in one."""
        pad = self.plan.spec.pad
        cell = self.plan.cell
        rows, columns = self.places.shape
        column = np.floor((points[..., 0] + pad.width_mm / 2) / cell.width_mm).astype(np.int32)
        row = np.floor((points[..., 1] + pad.depth_mm / 2) / cell.depth_mm).astype(np.int32)
        return column, row, (column >= 0) & (column < columns) & (row >= 0) & (row < rows)

    def looked_up(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return, for points (n, 2) in mm on the pad, the taxel, the place in that taxel's axes, and the map pixel.

        The taxel is −1 where there is none; the place (n, 2) is measured from the washer.
        """
        column, row, inside = self.cells(points)
        rows, columns = self.places.shape
        taxel = np.where(inside, self.places[row.clip(0, rows - 1), column.clip(0, columns - 1)], -1)
        x, y = (points - self.axis[taxel]).T
        cosine, sine = self.ways[taxel].T
        corner = self.corner[taxel].T
        along = np.stack([cosine * x + sine * y, cosine * y - sine * x], -1)
        channel = self.channel[taxel]
        pixel = self.pixel_mm[channel]
        shape = self.shape[channel].T
        at = [((along[:, k] - corner[k]) / pixel).astype(np.int32).clip(0, shape[k] - 1) for k in (0, 1)]
        return taxel, along, self.first[channel] + at[0] * shape[1] + at[1]

    def from_gap_mm(self, taxel: np.ndarray, along: np.ndarray, pixel: np.ndarray) -> np.ndarray:
        """Return distances (n,) in mm from the middle of the nearest gap, for points as `looked_up` returns them."""
        pixel_mm = self.pixel_mm[self.channel[taxel]][:, None]
        x, y = ((along - self.corner[taxel]) % pixel_mm - pixel_mm / 2).T
        outward = self.outward[pixel]
        return self.aside_mm[pixel] + x * outward.real + y * outward.imag

    def solid_at(self, points: np.ndarray) -> np.ndarray:
        """Return a mask of the points (n, 2) in mm at which the plan has plastic in its lowest layer."""
        spec = self.plan.spec
        taxel, _, pixel = self.looked_up(points)
        half = np.array([spec.pad.width_mm, spec.pad.depth_mm]) / 2
        outside = (np.abs(points) > half + spec.pad.border_mm).any(1)
        off = np.abs(points) - half - spec.pad.border_mm / 2
        holes = np.hypot(*off.T) < spec.pad.hole_diameter_mm / 2
        return np.asarray(np.where(taxel >= 0, self.solid[pixel], ~outside & ~holes))


def turned(points: np.ndarray, quarters: int) -> np.ndarray:
    """Return points (n, 2) turned anticlockwise by quarter turns."""
    cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    return np.stack([cosine * points[:, 0] - sine * points[:, 1], sine * points[:, 0] + cosine * points[:, 1]], -1)


def cut(layer: Layer, piece_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut a layer's extrusions into pieces no longer than `piece_mm`.

    Return the pieces' middles (n, 2) in mm, and the index (n,) of the extrusion that each was cut from.
    """
    along = layer.stop - layer.start
    count = np.maximum(np.ceil(np.hypot(*along.T) / piece_mm), 1).astype(np.int64)
    line = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[line]
    return layer.start[line] + share[:, None] * along[line], line


ROUND_EDGES = 1 - np.pi / 4
"""Excess width of a bead with round edges over a rectangle of the same area and height, over the height."""
FINE_MM = 0.04
COARSE_MM = 0.2
"""Longest pieces of extrusions at the height of beams and recesses, and above it."""
MOST_PIECES = 1_000_000
"""Most pieces that are looked up at a time."""
WITHIN_RECESS_MM = 0.35
"""Distance inwards from a recess's side from which plastic counts as its roof, not as a bead of the side."""
SAME_HEIGHT_MM = 0.02
"""Difference below which a layer begins at a planned height."""
STRAND = 2.0
"""Multiple of the layer's median width above which an extrusion is taken as a free round strand of a bridge."""
SHIFTS_MM = 0.06 * np.stack(np.meshgrid(np.arange(-1, 2), np.arange(-1, 2)), -1).reshape(-1, 2)
"""Shifts from a recess's middle at which the room for its washer is tried."""
MOST_OTHER = 0.15
"""Largest share of a sub-cell that may differ from the plan: usual profiles have 0.06, other pads 0.23 or more."""
LONG_MM = 1.0
PARALLEL_MM = 5e-3
"""Least length of a bead along the pad's edge, and its largest distance from the edge where that was first found; and
by how much its ends may differ in that distance: files have micrometres, so that ends may be one or two off."""
SHORT_MM = 0.02
"""Extrusions shorter than this count by their volume only: of how wide they are, rounded lengths say nothing, and the
beads before and behind end there."""
ALIKE = 2e-3
"""Difference of correlations that may be rounding; a pad that looks the same when turned then gets the smaller turn."""
IMAGE_MM = 0.5
PIXEL_SHARE = 1.1
MOST_PIXEL_MM = 1.5
"""Least size of a pixel over the usual width of a bead, as far as nozzles go."""
MOST_IMAGE = 1000
"""Pixel size of the images that are compared, and the most pixels along a side of the searched area."""
SCALES = np.linspace(0.95, 1.05, 101)
OUTSIDE_SHARE = 5e-4
MOST_SCALED = 20_000
"""Sizes of the pad that are tried, the share of plastic by which they may differ, and the most points tried."""
MOST_PADS = 64
LEAST_SHARE = 0.8
"""Most pads on a plate, and the least plastic of another one in the lowest layer over the first one's."""
SUPPORT_STEPS = 5
"""Points of each extrusion of a support that are looked up."""
WIDEST_MM = 2000.0
FIRST_LAYERS = 8
"""Layers among which the pad's lowest is searched: a raft, or a line that primes the nozzle, may lie below it."""
FILAMENTS_MM = (1.75, 2.85)
"""Diameters that are tried where a file does not state its filament's."""


class Placing(NamedTuple):
    """The place of the pad's centre on the bed in mm, the pad's quarter turns, and how well the pad matches there.

    `match` is the correlation with the plan (1 at most), `other` the largest share of a sub-cell that differs from it.
    """

    x_mm: float
    y_mm: float
    quarters: int
    match: float
    other: float


@dataclass(frozen=True)
class LaidPad:
    """The pad as laid, taxel by taxel in the plan's order; heights are measured from `bottom_mm`.

    `areas_mm2` (layers, taxels, nodes) is the cross-section of plastic at nodes along the beams, in layers up to a
    little above the beams; `steps_mm` (layers,) are these layers' thicknesses. `beams` has for each channel and beam
    the slice of its nodes, evenly spaced from root to tip. `plate_mm3` is the plastic of plate and boss. `recess_mm` is
    the depth below the lowest strands of the roof over mover and ballast, `strand_mm` their height, `room_mm` the
    diameter of the largest circle near the recess's middle that holds no plastic. `gap_mm` is the narrowest gap around
    plate and beams. `is_supported` (taxels,) tells where supports stand in a taxel's cell. `all_steps_mm` are the
    thicknesses of all layers. `scale` is the pad's size in the plane over the planned one (nan where it has another
    shape). `is_followed` tells that something as high is laid after the pad, in layers of its own.
    """

    placing: Placing
    scale: float
    bottom_mm: float
    filament_mm: float
    areas_mm2: np.ndarray
    steps_mm: np.ndarray
    beams: tuple[tuple[slice, ...], ...]
    plate_mm3: np.ndarray
    recess_mm: np.ndarray
    strand_mm: np.ndarray
    room_mm: np.ndarray
    gap_mm: np.ndarray
    is_supported: np.ndarray
    is_followed: bool
    all_steps_mm: np.ndarray


def laid_pads(plan: Plan, path: Path, filament_mm: float | None = None) -> tuple[LaidPad, ...]:
    """Find every pad of `plan` in a file of G-code and measure it, layer by layer; the best match comes first.

    Where the filament's diameter is not given, it is the one of `FILAMENTS_MM` with which the lowest layer comes out
    full.

    Raises
    ------
    FileError
        The file lays nothing, does not hold this pad, or ends before the pad is whole.
    """
    where = str(path)
    maps = PadMaps(plan)
    reading = read_layers(path, filament_mm or FILAMENTS_MM[0])
    placings, layer, step, full = _find_pads(maps, reading, where)
    diameter_mm = filament_mm or min(FILAMENTS_MM, key=lambda mm: abs(np.log(full * (mm / FILAMENTS_MM[0]) ** 2)))
    share = 1.0 if filament_mm else (diameter_mm / FILAMENTS_MM[0]) ** 2
    bottom = layer.top_mm - step
    scales = [_scale(maps, placing, layer) for placing in placings]
    rows: list[list[tuple[Any, ...]]] = [[] for _ in placings]
    top = 0.0
    last = step
    is_followed = False
    whole = max(plan.plate.boss_top_mm, plan.spec.pad.frame_thickness_mm)
    layer_mm = plan.spec.printer.layer_mm
    for each in chain([layer], reading):
        step = each.top_mm - bottom - top
        if step <= 0 and top > whole - max(last, layer_mm) - 0.05:
            is_followed = _is_as_high(reading, bottom + whole - layer_mm)
            break  # what comes after the pad
        if step <= 0:
            raise FileError(
                f"lays something at z = {number(each.top_mm)} mm after z = {number(bottom + top)} mm; must be laid"
                " layer by layer, all objects together",
                where,
            )
        scaled = replace(each, area_mm2=share * each.area_mm2)
        for pad_rows, placing in zip(rows, placings, strict=True):
            pad_rows.append(_laid_layer(maps, placing, scaled, top, step))
        top = top + step
        last = step
    if not top > whole - max(last, layer_mm) - 0.05:
        raise FileError(
            f"ends at {number(top)} mm of the {number(whole)} mm that the pad {plan.name} is high: the file is cut"
            " short, or of another pad",
            where,
        )
    pads = zip(placings, scales, rows, strict=True)
    return tuple(
        _of_layers(maps, placing, scale, bottom, diameter_mm, is_followed, pad_rows)
        for placing, scale, pad_rows in pads
    )


def _is_as_high(layers: Iterator[Layer], top_mm: float) -> bool:
    return any(layer.top_mm > top_mm for layer in layers)


def _of_layers(
    maps: PadMaps,
    placing: Placing,
    scale: float,
    bottom_mm: float,
    filament_mm: float,
    is_followed: bool,
    rows: list[tuple[Any, ...]],
) -> LaidPad:
    """Return the laid pad, put together from its layers' measurements: `rows` as `_laid_layer` returns them."""
    plan = maps.plan
    steps, areas, plate, roof, strands, room, gap, supported = (np.array(part) for part in zip(*rows, strict=True))
    tops = np.cumsum(steps)
    taxels = np.arange(len(plan.taxels))
    beam_layers = int((tops - steps < _beams_top_mm(plan)).sum())
    # A recess ends at the first layer with plastic over it; without a roof it is as deep as the pad is high.
    has_roof = (roof > 0).any(0)
    first = (roof > 0).argmax(0)
    strand = np.divide(strands[first, taxels], roof[first, taxels], out=np.full(len(taxels), np.nan), where=has_roof)
    below = np.arange(len(steps))[:, None] < np.where(has_roof, first, len(steps))
    # Ballast above the mover is pressed into a pocket that may be narrower.
    below &= ((tops - steps) < plan.spec.mover_top_mm - SAME_HEIGHT_MM)[:, None]
    return LaidPad(
        placing,
        scale,
        bottom_mm,
        filament_mm,
        areas[:beam_layers],
        steps[:beam_layers],
        tuple(tuple(m.beams) for m in maps.maps),
        plate.sum(0),
        np.where(has_roof, tops[first] - strand, tops[-1]),
        strand,
        np.where(below[:, None], room, np.inf).min(0).max(0),
        gap.min(0),
        np.asarray(supported.any(0)),
        is_followed,
        steps,
    )


def _find_pads(maps: PadMaps, layers: Iterator[Layer], where: str) -> tuple[list[Placing], Layer, float, float]:
    """Find the pads by their lowest layer; return places, layer, its thickness in mm, and its laid/planned volume.

    The fullness is the plastic of that layer within the first pad's taxels over the plan's there.
    """
    least = 1.0
    top = 0.0
    for _, layer in zip(range(FIRST_LAYERS), layers, strict=False):
        step = float(layer.height_mm[0])
        if not step > 0:  # nor where the file states no height, which is no number
            step = layer.top_mm - top if layer.top_mm > top else layer.top_mm
        top = layer.top_mm
        wide = float(np.ptp(layer.start, axis=0).max())
        if wide > WIDEST_MM:
            raise FileError(
                f"spreads over {number(wide)} mm, no printer is wider than {number(WIDEST_MM)} mm; look for"
                " a G20 (inches) or a G91 (relative moves) that is not meant",
                where,
            )
        if not step > 0:
            continue
        placing = _registered(maps, layer, step)
        mirrored = _registered(maps, replace(layer, start=layer.start * (-1, 1), stop=layer.stop * (-1, 1)), step)
        if mirrored.other <= MOST_OTHER and mirrored.match > placing.match + ALIKE:
            raise FileError(f"holds the pad {maps.plan.name} mirrored; switch mirroring off in the slicer", where)
        if placing.other <= MOST_OTHER:
            return _with_others(maps, placing, layer, step), layer, step, _fullness(maps, placing, layer, step)
        least = min(least, placing.other)
    if not top:
        raise FileError("has no moves that lay plastic; it is no G-code of a print", where)
    raise FileError(
        f"does not hold the pad {maps.plan.name}: what is laid first differs from its underside on {least:.0%} of a"
        f" taxel's cell or of the border, must be {MOST_OTHER:.0%} at most; it is of another pad or spec, lies upside"
        " down, or is turned by no quarter turn",
        where,
    )


def _with_others(maps: PadMaps, placing: Placing, layer: Layer, step_mm: float) -> list[Placing]:
    """Return the places of all pads in a layer: the known one, then others sought in the rest of the layer."""
    placings = [placing]
    pad = maps.plan.spec.pad
    half = np.array([pad.width_mm, pad.depth_mm]) / 2 + pad.border_mm + LONG_MM
    rest = layer
    least_mm3 = 0.0
    while len(placings) < MOST_PADS:
        middle = (rest.start + rest.stop) / 2
        at = turned(middle - (placing.x_mm, placing.y_mm), -placing.quarters)
        beyond = (np.abs(at) > half).any(1)
        least_mm3 = least_mm3 or LEAST_SHARE * float(rest.volume_mm3[~beyond].sum())
        rest = replace(
            rest,
            start=rest.start[beyond],
            stop=rest.stop[beyond],
            area_mm2=rest.area_mm2[beyond],
            height_mm=rest.height_mm[beyond],
        )
        if rest.volume_mm3.sum() < least_mm3 or not len(rest.start):
            break
        placing = _registered(maps, rest, step_mm)
        if placing.other > MOST_OTHER:
            break
        placings.append(placing)
    return placings


def _scale(maps: PadMaps, placing: Placing, layer: Layer) -> float:
    """Return the ratio of laid to planned size at which most of the lowest layer's beads lie in planned plastic.

    Beads lie half their width inside, so that many sizes have all of them there; the middle of these is returned, which
    wider or narrower walls do not change. It is no number where no size has all of them.
    """
    points, line = cut(layer, COARSE_MM)
    points = turned(points - (placing.x_mm, placing.y_mm), -placing.quarters)
    pad = maps.plan.spec.pad
    half = np.array([pad.width_mm, pad.depth_mm]) / 2 + pad.border_mm
    beyond = (np.abs(points) - half).max(1)
    # Cells, and the beads along the outer edge; the border between them has screw holes and marks.
    on = (maps.looked_up(points)[0] >= 0) | ((beyond > -LONG_MM) & (beyond < (SCALES[-1] - 1) * half.max()))
    points = points[on]
    volume = (layer.volume_mm3 / np.bincount(line, minlength=len(layer.start)))[line][on]
    every = len(points) // MOST_SCALED + 1
    points = points[::every]
    volume = volume[::every]
    inside = np.array([volume[maps.solid_at(points / scale)].sum() for scale in SCALES])
    if inside.max() < (1 - OUTSIDE_SHARE) * volume.sum():  # it has another shape
        return nan
    return float(SCALES[inside > (1 - OUTSIDE_SHARE) * inside.max()].mean())


def _fullness(maps: PadMaps, placing: Placing, layer: Layer, step_mm: float) -> float:
    """Return the ratio of laid to planned plastic in the lowest layer, within the taxels' sub-cells."""
    points, line = cut(layer, COARSE_MM)
    points = turned(points - (placing.x_mm, placing.y_mm), -placing.quarters)
    pieces = np.bincount(line, minlength=len(layer.start))
    laid = (layer.volume_mm3 / pieces)[line][maps.looked_up(points)[0] >= 0].sum() / step_mm
    planned = sum(float(m.solid.sum()) * m.pixel_mm**2 for m in (maps.maps[c] for c in maps.channel))
    return float(laid / planned)


def _registered(maps: PadMaps, layer: Layer, height_mm: float) -> Placing:
    """Find where the pad lies, by the correlation of a layer's extrusions with the plan's lowest cross-section.

    All quarter turns are tried on a coarse grid, by Fourier transforms. The two best are then centred by the beads
    along opposite edges of the pad.
    """
    from scipy.signal import correlate

    pad = maps.plan.spec.pad
    size = np.array([pad.width_mm, pad.depth_mm]) + 2 * pad.border_mm
    points, line = cut(layer, 0.2)
    low = points.min(0)
    high = points.max(0)
    coarse = max(IMAGE_MM, float(max(*(high - low), *size)) / MOST_IMAGE)
    volume = layer.volume_mm3 / np.bincount(line, minlength=len(layer.start))

    def image(at: np.ndarray, corner: np.ndarray, shape: Any, pixel: float) -> np.ndarray:
        """Return each pixel's share of plastic; `corner` is the image's lower left corner."""
        index = np.floor((at - corner) / pixel).astype(np.int64)
        inside = ((index >= 0) & (index < shape)).all(1)
        number = index[inside, 0] * shape[1] + index[inside, 1]
        full = np.bincount(number, volume[line][inside] / (height_mm * pixel**2), shape[0] * shape[1])
        return np.asarray(np.minimum(full, 1.2).reshape(shape))

    def planned(pixel: float) -> np.ndarray:
        """Return each pixel's planned share of plastic, with the pad's centre in the middle of the image."""
        shape = np.ceil(size / pixel).astype(np.int64)
        finer = int(np.clip(MOST_IMAGE * 3 // shape.max(), 2, 5))
        axes = (((np.arange(finer * n) + 0.5) / finer - n / 2) * pixel for n in shape)
        at = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
        return np.asarray(maps.solid_at(at).reshape(shape[0], finer, shape[1], finer).mean((1, 3)))

    # The pad may lie beyond what is laid, by its own size, on the coarse grid.
    plan = fine = planned(coarse)
    laid = image(points, low, np.ceil((high - low) / coarse).astype(np.int64) + 1, coarse)
    matches = []
    for quarters in range(4):
        kernel = np.rot90(plan - plan.mean(), quarters)
        score = correlate(laid, kernel, method="fft")
        shift = np.array(np.unravel_index(int(score.argmax()), score.shape)) + 1 - kernel.shape
        matches.append((float(score.max()), quarters, low + (shift + np.array(kernel.shape) / 2) * coarse))
    # Pixels between the middles of wide beads would be bare.
    usual_mm = float(np.median(layer.area_mm2)) / height_mm
    pixel = float(np.clip(PIXEL_SHARE * usual_mm, IMAGE_MM, MOST_PIXEL_MM))
    if coarse != pixel:
        fine = planned(pixel)
    middles = [(np.arange(n) + 0.5) * pixel - n * pixel / 2 for n in fine.shape]
    best = Placing(0.0, 0.0, 0, 0.0, 1.0)
    for _, quarters, centre in sorted(sorted(matches, key=lambda item: -item[0])[:2], key=lambda item: item[1]):
        start, stop = (turned(end - centre, -quarters) for end in (layer.start, layer.stop))
        turned_points = turned(points - centre, -quarters)
        moved = _off_centre(start, stop, size / 2)
        shown = image(turned_points - moved, -np.array(fine.shape) * pixel / 2, fine.shape, pixel)
        match = float(np.corrcoef(shown.ravel(), fine.ravel())[0, 1]) if shown.any() else 0.0
        if match > best.match + ALIKE:
            x, y = (centre + turned(moved[None], quarters)[0]).tolist()
            best = Placing(x, y, quarters, match, _largest_difference(maps, middles, fine, shown))
    return best


def _off_centre(start: np.ndarray, stop: np.ndarray, half_mm: np.ndarray) -> np.ndarray:
    """Return how far (2,) in mm the middle between beads at opposite edges lies off the origin.

    The origin is where the pad's centre is assumed.
    """
    off = np.zeros(2)
    for k in (0, 1):
        along = np.abs(stop[:, k] - start[:, k]) < PARALLEL_MM
        along &= np.abs(stop[:, 1 - k] - start[:, 1 - k]) > LONG_MM
        along &= np.maximum(np.abs(start), np.abs(stop))[:, 1 - k] < half_mm[1 - k] + LONG_MM
        depth = [half_mm[k] - side * start[along, k] for side in (-1, 1)]
        low, high = (d[np.abs(d) < LONG_MM] for d in depth)
        if len(low) and len(high):
            off[k] = (low.min() - high.min()) / 2
    return off


def _largest_difference(maps: PadMaps, middles: list[np.ndarray], plan: np.ndarray, laid: np.ndarray) -> float:
    """Return the largest share of the area of any sub-cell, or of the border, where laid and planned plastic differ.

    They differ where plastic is laid in a planned window, or is missing where it is planned.

    `middles` are the coordinates of the images' pixels along x and y.
    """
    column, row, inside = maps.cells(np.stack(np.meshgrid(*middles, indexing="ij"), -1))
    number = np.where(inside, row * maps.places.shape[1] + column, maps.places.size).ravel()
    differs = (((laid > 0.3) & (plan < 0.05)) | ((laid < 0.15) & (plan > 0.95))).ravel()
    return float((np.bincount(number, differs) / np.maximum(np.bincount(number), 1)).max())


def _beams_top_mm(plan: Plan) -> float:
    """Return the height in mm up to which layers are measured as parts of beams: a little above the thickest beam."""
    return max(c.beam.thickness_mm for c in plan.channels) + plan.spec.printer.layer_mm + 0.25


def _laid_layer(maps: PadMaps, placing: Placing, layer: Layer, below_mm: float, step_mm: float) -> tuple[Any, ...]:
    """Measure the layer that begins at `below_mm`, for each taxel.

    Return its thickness; areas (taxels, nodes) of the beams in mm²; plastic (taxels,) of the plates, of the recesses'
    roofs, and the same times its height; room (shifts, taxels) about the recess's middle; gap (taxels,); and whether
    supports stand in the taxel's cell (taxels,).
    """
    plan = maps.plan
    count = len(maps.plan.taxels)
    nodes = max(len(m.node_mm) for m in maps.maps)
    stations = max(1, *(m.stations for m in maps.maps))
    shared = np.zeros(count * nodes + 1)
    sides = np.full(count * stations * 2, np.inf)
    plate, roof, strands = np.zeros((3, count))
    room = np.full((len(SHIFTS_MM), count), np.inf)
    is_fine = below_mm < max(_beams_top_mm(plan), hollows_mm(plan.spec)[-1][1] + 0.3)
    radius = roof_radius = plan.plate.recess_diameter_mm / 2
    if ballast := plan.spec.ballast:
        roof_radius = min(radius, ballast.width_mm / 2)
    post = plan.plate.post_diameter_mm / 2
    for volume, width, height, taxel, along, pixel in _pieces(
        maps, placing, layer, step_mm, FINE_MM if is_fine else COARSE_MM
    ):
        plate += np.bincount(taxel, volume * (maps.owner[pixel] == PLATE), count)
        node = maps.node[pixel]
        at = taxel * nodes + np.maximum(node, 0).astype(np.int64)
        ahead = node % 1
        volume_on = np.where(node >= 0, volume, 0.0)
        # Shared between the nodes before and behind, so that where pieces are cut does not matter.
        shared += np.bincount(at, volume_on * (1 - ahead), len(shared))
        shared += np.bincount(at + 1, volume_on * ahead, len(shared))
        station = maps.station[pixel]
        on = station >= 0
        free = maps.from_gap_mm(taxel, along, pixel) - width / 2
        np.minimum.at(sides, ((taxel * stations + station) * 2 + maps.side[pixel])[on], free[on])
        near = np.abs(along).max(1) < radius + 1
        volume, width, height, taxel, along = (part[near] for part in (volume, width, height, taxel, along))
        away = np.hypot(*along.T)
        beside = away > post + WITHIN_RECESS_MM if post else np.ones(len(away), bool)
        above = beside & (away < roof_radius - WITHIN_RECESS_MM)
        roof += np.bincount(taxel[above], volume[above], count)
        strands += np.bincount(taxel[above], (volume * height)[above], count)
        for k, shift in enumerate(SHIFTS_MM):
            free = 2 * np.hypot(*(along - shift).T) - width
            np.minimum.at(room[k], taxel[beside], free[beside])
    areas = shared[:-1].reshape(count, nodes)
    for k, channel in enumerate(maps.channel):
        own_mm = maps.maps[channel].node_mm
        areas[k, : len(own_mm)] /= own_mm
    gap = sides.reshape(count, stations, 2).sum(2).min(1)
    supported = np.zeros(count, bool)
    if len(layer.supports):
        steps = np.linspace(layer.supports[:, 0], layer.supports[:, 1], SUPPORT_STEPS).reshape(-1, 2)
        beneath = maps.looked_up(turned(steps - (placing.x_mm, placing.y_mm), -placing.quarters))[0]
        supported[beneath[beneath >= 0]] = True
    return step_mm, areas, plate, roof, strands, room, gap, supported


def _pieces(
    maps: PadMaps, placing: Placing, layer: Layer, step_mm: float, piece_mm: float
) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield the pieces (n,) of extrusions within the sub-cells of taxels, `MOST_PIECES` or fewer at a time.

    They are volumes in mm³, outer widths and heights in mm, indices of the taxels, places (n, 2) of the pieces' middles
    from the washer's axis in the taxel's own axes in mm, and pixels of the maps.
    """
    height = np.where(np.isnan(layer.height_mm), step_mm, layer.height_mm)
    wide = layer.area_mm2 / height
    strand = np.isnan(layer.height_mm) & (wide > STRAND * np.median(wide))
    height = np.where(strand, np.sqrt(4 / np.pi * layer.area_mm2), height)
    length = np.hypot(*(layer.stop - layer.start).T)
    width = np.where(length < SHORT_MM, 0.0, layer.area_mm2 / height + ROUND_EDGES * height)
    run = np.cumsum(length / piece_mm + 1)
    ends = np.searchsorted(run, np.arange(MOST_PIECES, run[-1], MOST_PIECES))
    for first, last in pairwise((0, *ends.tolist(), len(run))):
        part = replace(layer, start=layer.start[first:last], stop=layer.stop[first:last])
        points, line = cut(part, piece_mm)
        points = turned(points - (placing.x_mm, placing.y_mm), -placing.quarters)
        volume = layer.volume_mm3[first:last] / np.bincount(line, minlength=last - first)
        taxel, along, pixel = maps.looked_up(points)
        on = taxel >= 0
        yield (
            volume[line[on]],
            width[first:last][line[on]],
            height[first:last][line[on]],
            taxel[on],
            along[on],
            pixel[on],
        )
