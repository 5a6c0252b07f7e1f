"""Measures a pad in the G-code that a slicer made of it: where it lies, and each taxel as it is laid.

Every extrusion is cut into short pieces, and each piece is looked up in a map of its taxel (`TaxelMap`, one a channel):
of which body it is, how far along a beam it lies, which station of a gap is nearest and how far. So the work
grows with the length that is laid, and no more than a layer is held.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import FileError, number
from padgen.measured.gcode_file import Layer, read_layers
from padgen.planner.plan import Channel, Plan
from padgen.planner.tile import TURNS, outline, taxel_places

__all__ = ["LaidPad", "Placing", "laid_pad"]

ROUND_EDGES = 1 - np.pi / 4
"""What a bead of round edges is wider than the rectangle of its area, over its height."""
PIXEL_MM, MOST_PIXELS = 0.02, 400_000
FINE_MM, COARSE_MM = 0.04, 0.2
"""Pieces of an extrusion where beams and recesses are, and above them."""
STATION_MM = 0.4
GAPS = (0.9, 1.6)
"""Widths, over the plan's least gap, of what counts as a gap: not the corners where a beam meets what it joins."""
OPPOSITE = -0.8
"""Cosine of the angle between the ways to both sides of a gap, at most."""
NEAR_MM = 1.2
"""How far the middle of a bead may be from the middle of a gap that it borders."""
NODE_MM, MOST_NODES = 0.5, 16
"""How far apart along a beam its width is measured, at most in so many places."""
WITHIN_RECESS_MM = 0.35
"""How far within a recess's side plastic is its roof, and no bead of the side."""
STRAND = 2.0
"""Over the usual width: an extrusion that would be so much wider than it lies free, a round strand."""
SHIFTS_MM = 0.06 * np.stack(np.meshgrid(np.arange(-1, 2), np.arange(-1, 2)), -1).reshape(-1, 2)
"""Places about a recess's middle where its washer may lie."""
MOST_OTHER = 0.15
"""Share of a sub-cell that may be other than planned; slicers' settings make 0.06 of it, another pad 0.29 (docs/printing.md)."""
LONG_MM = 1.0
ALIKE = 2e-3
"""Difference of two correlations by rounding: of a pad that looks the same when turned, the smaller turn is taken."""
IMAGE_MM, MOST_IMAGE = 0.5, 1000
"""Pixels of the images that are compared, so many at most along a side of what is searched."""
WIDEST_MM = 2000.0
FIRST_LAYERS = 8
"""Layers in which the pad's lowest is looked for: below it may be a raft or a line that primes the nozzle."""
FILAMENTS_MM = (1.75, 2.85)
"""Diameters that a filament may have of which a file says nothing."""
FRAME, PLATE, BEAM = 1, 2, 3


class Placing(NamedTuple):
    """Where the pad's centre lies on the bed in mm, by how many quarter turns the pad is turned, how well what is laid
    matches the plan (a correlation, 1 at most), and the largest share of a sub-cell that is other than planned."""

    x_mm: float
    y_mm: float
    quarters: int
    match: float
    other: float


@dataclass(frozen=True)
class LaidPad:
    """What is laid, taxel by taxel in the plan's order; lengths in mm, heights from `bottom_mm` above the bed.

    `areas_mm2` (layers, taxels, nodes) is the cross-section of plastic at nodes along the beams, in layers up to a
    little above them, `steps_mm` (layers) their heights; `beams` has for each channel and beam the slice of its nodes,
    evenly from root to tip. `plate_mm3` is the plastic of plate and boss. `recess_mm` is the
    depth below the lowest strand of the recess's roof, `strand_mm` how high this is, nan without a roof; `room_mm` the
    largest circle about the recess's middle that holds no plastic. `gap_mm` is the narrowest place of the gaps around
    what moves, `gap_top_mm` at which height. `all_steps_mm` are the heights of all layers, `volume_mm3` all plastic.
    """

    placing: Placing
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
    gap_top_mm: np.ndarray
    all_steps_mm: np.ndarray
    volume_mm3: float


class TaxelMap:
    """A grid over a taxel's sub-cell in its own axes: bodies, stretches of beams, stations of gaps, depth in a body."""

    def __init__(self, plan: Plan, channel: Channel) -> None:
        from scipy.ndimage import distance_transform_edt as distance

        arrangement = plan.arrangement(channel)
        sides = outline(plan, channel)
        long, wide = sides.x1 - sides.x0, sides.y1 - sides.y0
        self.pixel_mm = max(PIXEL_MM, (long * wide / MOST_PIXELS) ** 0.5)
        self.low = np.array([sides.x0, sides.y0])
        self.shape = tuple(int(np.ceil(v / self.pixel_mm)) for v in (long, wide))
        x, y = (self.low[k] + (np.arange(self.shape[k]) + 0.5) * self.pixel_mm for k in (0, 1))
        x, y = x[:, None], y[None, :]
        length, width = (float(v) for v in arrangement.window_mm)
        frame = (x < 0) | (x > length) | (np.abs(y) > width / 2)
        plate = np.zeros(self.shape, bool)
        for block in arrangement.blocks:
            x0, x1, y0, y1 = (float(v) for v in block[:4])
            plate |= (x > x0) & (x < x1) & (y > y0) & (y < y1)
        bodies, along = [frame, plate & ~frame], []
        self.node = np.full(self.shape, -1.0, np.float32)
        self.beams: list[slice] = []
        weights: list[float] = []
        count, rest = 0, ~frame & ~plate
        for path in arrangement.beams:
            run, place = self._run_mm(path)
            centre = np.zeros(self.shape, bool)
            centre[place] = True
            near, at = distance(~centre, self.pixel_mm, return_indices=True)
            at_run = np.zeros(self.shape)
            at_run[place] = run
            own = at_run[at[0], at[1]]
            fillet = channel.beam.fillet_mm * (not path.segments[0].turn_rad)
            flare = fillet - np.sqrt(np.maximum(fillet**2 - np.maximum(fillet - own, 0) ** 2, 0))
            bodies.append((near < float(path.width_mm) / 2 + flare) & rest)
            steps = min(max(round(run[-1] / NODE_MM), 4), MOST_NODES - 1)
            along.append(count + own / run[-1] * steps)
            self.beams.append(slice(count, count + steps + 1))
            weights += [share * run[-1] / steps for share in (0.5, *[1.0] * (steps - 1), 0.5)]
            count += steps + 1
        self.node_mm = np.array(weights)
        far = (np.full(self.shape, np.inf), np.zeros((2, *self.shape), np.int32))
        nearest = [distance(~body, self.pixel_mm, return_indices=True) if body.any() else far for body in bodies]
        away, places = np.stack([n[0] for n in nearest]), np.stack([n[1] for n in nearest])
        self.owner = (away.argmin(0) + 1).astype(np.int8)
        for k, node in enumerate(along):
            here = self.owner == BEAM + k
            self.node[here] = node[here]
        solid = np.logical_or.reduce(bodies)
        washer_x, sizes = float(arrangement.washer_x_mm), plan.plate
        radius = np.hypot(x - washer_x, y)
        self.solid = solid & ~((radius < sizes.recess_diameter_mm / 2) & (radius > sizes.post_diameter_mm / 2))
        self.depth_mm = (distance(self.solid, self.pixel_mm) - distance(~self.solid, self.pixel_mm)).astype(np.float32)
        self._gaps(~solid, away, places, sizes.gap_mm)

    def _run_mm(self, path: Any) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        """Points along a beam: how far from its root, and in which pixel."""
        runs, points, done = [], [], 0.0
        for k, segment in enumerate(path.segments):
            long = float(segment.length_mm)
            share = np.linspace(0, 1, int(2 * long / self.pixel_mm) + 2)
            place = path.within(k, share)
            runs.append(done + share * long)
            points.append(np.stack(np.broadcast_arrays(place.x_mm, place.y_mm), -1).astype(float))
            done += long
        return np.concatenate(runs), tuple(self.pixels(np.concatenate(points)).T)

    def _gaps(self, void: np.ndarray, away: np.ndarray, places: np.ndarray, gap_mm: float) -> None:
        """Stations along the middle of each gap, and every pixel's distance from the nearest.

        A gap has its two bodies on opposite sides; a corner where a beam meets what it joins has not.
        """
        from scipy.ndimage import distance_transform_edt as distance

        who = np.sort(np.argsort(away, 0)[:2], 0)
        one, other = (np.take_along_axis(away, k[None], 0)[0] for k in who)
        wide = one + other
        middle = void & (np.abs(one - other) < 1.5 * self.pixel_mm) & (wide > GAPS[0] * gap_mm) & (wide < GAPS[1] * gap_mm)
        at = np.stack(np.nonzero(middle))
        to_one, to_other = (places[k[middle], :, at[0], at[1]].T - at for k in who)
        middle[tuple(at)] = (to_one * to_other).sum(0) < OPPOSITE * np.hypot(*to_one) * np.hypot(*to_other)
        self.station = np.full(self.shape, -1, np.int32)
        self.side = np.zeros(self.shape, np.int8)
        self.aside_mm = np.full(self.shape, np.inf, np.float32)
        self.stations = 0
        if not middle.any():
            return
        off, at = distance(~middle, self.pixel_mm, return_indices=True)
        tile = [np.arange(n) * self.pixel_mm // STATION_MM for n in self.shape]
        name = ((who[0] * 64 + who[1]) * 1e8 + tile[0][:, None] * 1e4 + tile[1]).astype(np.int64)
        names, station = np.unique(name[middle], return_inverse=True)
        numbers = np.zeros(self.shape, np.int32)
        numbers[middle] = station.ravel()
        lower, upper = (k[at[0], at[1]] + 1 for k in who)
        here = (off < NEAR_MM) & ((self.owner == lower) | (self.owner == upper))
        self.station[here] = numbers[at[0], at[1]][here]
        self.side[here] = (self.owner == upper)[here]
        self.aside_mm[here] = off[here]
        self.stations = len(names)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """In which pixel each point (n, 2) in own axes lies."""
        at = np.floor((points - self.low) / self.pixel_mm).astype(np.int64)
        return np.asarray(np.clip(at, 0, np.array(self.shape) - 1))


class _Pieces(NamedTuple):
    """Pieces of extrusions, by their middles on the pad: volume, outer width and height in mm, the lowest that they
    reach; `taxel` −1 where none is. `own` (n, 2) is from the washer's axis in the taxel's own axes, `pixel` numbers its
    map's."""

    volume: np.ndarray
    width: np.ndarray
    height: np.ndarray
    taxel: np.ndarray
    own: np.ndarray
    pixel: np.ndarray


class _Maps:
    """The maps of all channels, one after the other, so that points of all taxels are looked up at once."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.places = taxel_places(plan)
        self.maps = [TaxelMap(plan, channel) for channel in plan.channels]
        sizes = [m.owner.size for m in self.maps]
        self.first = np.cumsum([0, *sizes[:-1]])
        self.low = np.array([m.low for m in self.maps])
        self.shape = np.array([m.shape for m in self.maps])
        self.pixel_mm = np.array([m.pixel_mm for m in self.maps])
        for name in ("owner", "node", "station", "side", "aside_mm", "solid", "depth_mm"):
            setattr(self, name, np.concatenate([getattr(m, name).ravel() for m in self.maps]))
        self.channel = np.array([t.channel for t in plan.taxels])
        ways = np.array([TURNS[c.site.along] for c in plan.channels], float)[self.channel]
        self.ways = ways * np.where([t.turned for t in plan.taxels], -1.0, 1.0)[:, None]
        self.axis = np.array([(t.x_mm, t.y_mm) for t in plan.taxels])
        washer = np.array([(float(plan.arrangement(c).washer_x_mm), 0.0) for c in plan.channels])
        self.corner = (self.low - washer)[self.channel]

    def found(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of points (n, 2) on the pad: the taxel (−1: none), the place from its washer's axis in own axes, the pixel."""
        pad, cell = self.plan.spec.pad, self.plan.cell
        rows, columns = self.places.shape
        column = np.floor((points[:, 0] + pad.width_mm / 2) / cell.width_mm).astype(np.int32)
        row = np.floor((points[:, 1] + pad.depth_mm / 2) / cell.depth_mm).astype(np.int32)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        taxel = np.where(inside, self.places[row.clip(0, rows - 1), column.clip(0, columns - 1)], -1)
        (x, y), (cosine, sine), corner = (points - self.axis[taxel]).T, self.ways[taxel].T, self.corner[taxel].T
        own = np.stack([cosine * x + sine * y, cosine * y - sine * x], -1)
        channel = self.channel[taxel]
        pixel, shape = self.pixel_mm[channel], self.shape[channel].T
        at = [((own[:, k] - corner[k]) / pixel).astype(np.int32).clip(0, shape[k] - 1) for k in (0, 1)]
        return taxel, own, self.first[channel] + at[0] * shape[1] + at[1]

    def solid_at(self, points: np.ndarray) -> np.ndarray:
        """Whether the plan has plastic at points (n, 2) of its lowest layer."""
        spec = self.plan.spec
        taxel, _, pixel = self.found(points)
        half = np.array([spec.pad.width_mm, spec.pad.depth_mm]) / 2
        outside = (np.abs(points) > half + spec.pad.border_mm).any(1)
        off = np.abs(points) - half - spec.pad.border_mm / 2
        holes = np.hypot(*off.T) < spec.pad.hole_diameter_mm / 2
        return np.asarray(np.where(taxel >= 0, self.solid[pixel], ~outside & ~holes))


def turned(points: np.ndarray, quarters: int) -> np.ndarray:
    """Points (n, 2) turned anticlockwise by quarter turns."""
    cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    return np.stack([cosine * points[:, 0] - sine * points[:, 1], sine * points[:, 0] + cosine * points[:, 1]], -1)


def cut(layer: Layer, piece_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Middles (n, 2) of pieces of a layer's extrusions that are no longer than `piece_mm`, and which each is of."""
    along = layer.stop - layer.start
    count = np.maximum(np.ceil(np.hypot(*along.T) / piece_mm), 1).astype(np.int64)
    line = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[line]
    return layer.start[line] + share[:, None] * along[line], line


def laid_pad(plan: Plan, path: Path, filament_mm: float | None = None) -> LaidPad:
    """Find the pad of `plan` in a file of G-code and measure it, layer by layer.

    Without a filament's diameter that of `FILAMENTS_MM` is taken by which the lowest layer comes out full.

    Raises
    ------
    FileError
        Nothing is laid, it is not this pad, or it ends before the pad does.
    """
    where, maps = str(path), _Maps(plan)
    reading = read_layers(path, filament_mm or FILAMENTS_MM[0])
    placing, layer, step, full = _placed(maps, reading, where)
    found = filament_mm or min(FILAMENTS_MM, key=lambda mm: abs(np.log(full * (mm / FILAMENTS_MM[0]) ** 2)))
    share = 1.0 if filament_mm else (found / FILAMENTS_MM[0]) ** 2
    measuring = _Measuring(maps, placing, layer.top_mm - step)
    top = layer.top_mm - step
    while True:
        if layer.top_mm <= top:
            if measuring.is_whole:
                break  # what comes after the pad
            raise FileError(
                f"lays something at z = {number(layer.top_mm)} mm after z = {number(top)} mm; must be laid layer by layer,"
                " all objects together",
                where,
            )
        measuring.add(replace(layer, area_mm2=share * layer.area_mm2), layer.top_mm - top)
        top = layer.top_mm
        after = next(reading, None)
        if after is None:
            break
        layer = after
    if not measuring.is_whole:
        raise FileError(
            f"ends at {number(measuring.top)} mm of the {number(measuring.whole_mm)} mm that the pad {plan.name} is high:"
            " the file is cut short, or of another pad",
            where,
        )
    return measuring.done(found)


def _placed(maps: _Maps, layers: Iterator[Layer], where: str) -> tuple[Placing, Layer, float, float]:
    """The pad's place by its lowest layer, that layer, its height, and how full of plastic it is, 1 as planned."""
    least, top = 1.0, 0.0
    for _, layer in zip(range(FIRST_LAYERS), layers, strict=False):
        told = float(layer.height_mm[0])
        step = told if told > 0 else layer.top_mm - top if layer.top_mm > top else layer.top_mm
        top = layer.top_mm
        wide = float(np.ptp(layer.start, axis=0).max())
        if wide > WIDEST_MM:
            raise FileError(
                f"spreads over {number(wide)} mm, no printer is wider than {number(WIDEST_MM)} mm; G20 makes its numbers inches",
                where,
            )
        if not step > 0:
            continue
        placing = _registered(maps, layer, step)
        if placing.other <= MOST_OTHER:
            return placing, layer, step, _fullness(maps, placing, layer, step)
        least = min(least, placing.other)
    if not top:
        raise FileError("has no moves that lay plastic; it is no G-code of a print", where)
    raise FileError(
        f"does not hold the pad {maps.plan.name}: what is laid first differs from its underside on {least:.0%} of a taxel's"
        f" cell, must be {MOST_OTHER:.0%} at most; it is of another pad or spec, lies upside down, or is turned by no"
        " quarter turn",
        where,
    )


def _fullness(maps: _Maps, placing: Placing, layer: Layer, step_mm: float) -> float:
    """Plastic of the lowest layer over what the plates and frames of the plan's taxels have in it."""
    points, line = cut(layer, COARSE_MM)
    points = turned(points - (placing.x_mm, placing.y_mm), -placing.quarters)
    pieces = np.bincount(line, minlength=len(layer.start))
    is_taxel = maps.found(points)[0] >= 0
    laid = (layer.volume_mm3 / pieces)[line][is_taxel].sum() / step_mm
    planned = sum(float(m.solid.sum()) * m.pixel_mm**2 for m in (maps.maps[c] for c in maps.channel))
    return float(laid / planned)


def _registered(maps: _Maps, layer: Layer, height_mm: float) -> Placing:
    """Where the pad lies, by the correlation of what a layer covers with the plan's lowest cross-section.

    First on a coarse grid in all quarter turns, by Fourier transforms; then the two best are moved until the beads
    lie deepest within the plan's bodies, which puts gaps on both sides alike.
    """
    pad = maps.plan.spec.pad
    size = np.array([pad.width_mm, pad.depth_mm]) + 2 * pad.border_mm
    points, line = cut(layer, 0.2)
    low, high = points.min(0), points.max(0)
    coarse = max(IMAGE_MM, float(max(*(high - low), *size)) / MOST_IMAGE)
    volume = layer.volume_mm3 / np.bincount(line, minlength=len(layer.start))

    def image(at: np.ndarray, corner: np.ndarray, shape: Any, pixel: float) -> np.ndarray:
        """How full of plastic each pixel is, from a corner on."""
        index = np.floor((at - corner) / pixel).astype(np.int64)
        inside = ((index >= 0) & (index < shape)).all(1)
        number = index[inside, 0] * shape[1] + index[inside, 1]
        full = np.bincount(number, volume[line][inside] / (height_mm * pixel**2), shape[0] * shape[1])
        return np.asarray(np.minimum(full, 1.2).reshape(shape))

    def planned(pixel: float) -> np.ndarray:
        """The same of the plan, its centre in the middle."""
        shape = np.ceil(size / pixel).astype(np.int64)
        finer = int(np.clip(MOST_IMAGE * 3 // shape.max(), 2, 5))
        axes = (((np.arange(finer * n) + 0.5) / finer - n / 2) * pixel for n in shape)
        at = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
        return maps.solid_at(at).reshape(shape[0], finer, shape[1], finer).mean((1, 3))

    # The pad may lie beyond what is laid, by its own size, on the coarse grid.
    shape = np.ceil((high - low) / coarse).astype(np.int64) + 1
    plan = fine = planned(coarse)
    full = [1 << int(np.ceil(np.log2(n + max(plan.shape)))) for n in shape]
    spectrum = np.fft.rfft2(image(points, low, shape, coarse), full)
    found = []
    for quarters in range(4):
        kernel = np.rot90(plan - plan.mean(), quarters)
        score = np.fft.irfft2(spectrum * np.conj(np.fft.rfft2(kernel, full)), full)
        i, j = np.unravel_index(int(score.argmax()), score.shape)
        shift = [k - n if k >= s else k for k, n, s in zip((i, j), full, shape, strict=True)]
        found.append((float(score[i, j]), quarters, low + (np.array(shift) + np.array(kernel.shape) / 2) * coarse))
    if coarse > IMAGE_MM:
        fine = planned(IMAGE_MM)
    middles = [(np.arange(n) + 0.5) * IMAGE_MM - n * IMAGE_MM / 2 for n in fine.shape]
    best = Placing(0.0, 0.0, 0, 0.0, 1.0)
    for _, quarters, centre in sorted(sorted(found, key=lambda item: -item[0])[:2], key=lambda item: item[1]):
        own = turned(points - centre, -quarters)
        step, moved, deepest = coarse / 2, np.zeros(2), -np.inf
        some = own[:: max(len(own) // 10_000, 1)]
        some = some[(np.abs(some) < size / 2).all(1)]
        while step > 0.004:
            tries = moved + step * SHIFTS_MM / 0.06
            depths = [_depth(maps, some - shift) for shift in tries]
            k = int(np.argmax(depths))
            if depths[k] <= deepest or k == len(tries) // 2:
                step /= 2
            moved, deepest = tries[k], depths[k]
        moved = moved + _off_centre(*(turned(end - centre, -quarters) - moved for end in (layer.start, layer.stop)), size / 2)
        shown = image(own - moved, -np.array(fine.shape) * IMAGE_MM / 2, fine.shape, IMAGE_MM)
        match = float(np.corrcoef(shown.ravel(), fine.ravel())[0, 1]) if shown.any() else 0.0
        if match > best.match + ALIKE:
            other = _largest_difference(maps, np.meshgrid(*middles, indexing="ij"), fine, shown)
            best = Placing(*(centre + turned(moved[None], quarters)[0]).tolist(), quarters, match, other)
    return best


def _off_centre(start: np.ndarray, stop: np.ndarray, half_mm: np.ndarray) -> np.ndarray:
    """How far the long straight beads within two opposite edges of the pad lie off the middle between them, (2,) in mm."""
    off = np.zeros(2)
    for k in (0, 1):
        along = np.abs(stop[:, k] - start[:, k]) < 1e-3
        along &= np.abs(stop[:, 1 - k] - start[:, 1 - k]) > LONG_MM
        along &= (np.abs(start[:, 1 - k]) < half_mm[1 - k]) & (np.abs(stop[:, 1 - k]) < half_mm[1 - k])
        depth = [half_mm[k] - side * start[along, k] for side in (-1, 1)]
        low, high = (d[(d > 0.02) & (d < LONG_MM)] for d in depth)
        if len(low) and len(high):
            off[k] = (low.min() - high.min()) / 2
    return off


def _largest_difference(maps: _Maps, at: list[np.ndarray], plan: np.ndarray, laid: np.ndarray) -> float:
    """The largest share of a sub-cell that is laid where the plan has a window, or bare where it has plastic."""
    spec, cell, shape = maps.plan.spec.pad, maps.plan.cell, maps.places.shape
    column = np.floor((at[0] + spec.width_mm / 2) / cell.width_mm).astype(np.int64)
    row = np.floor((at[1] + spec.depth_mm / 2) / cell.depth_mm).astype(np.int64)
    inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
    number = (row * shape[1] + column)[inside]
    differs = (((laid > 0.3) & (plan < 0.05)) | ((laid < 0.15) & (plan > 0.95)))[inside]
    return float((np.bincount(number, differs) / np.maximum(np.bincount(number), 1)).max())


def _depth(maps: _Maps, points: np.ndarray) -> float:
    """How deep points lie within the plan's bodies, all that is deeper than the beads of their sides counted alike."""
    taxel, _, pixel = maps.found(points)
    return float(np.clip(maps.depth_mm[pixel[taxel >= 0]], -0.5, 0.25).sum())


class _Measuring:
    """Sums and extremes over the layers that were added."""

    def __init__(self, maps: _Maps, placing: Placing, bottom_mm: float) -> None:
        self.maps, self.plan, self.placing, self.bottom = maps, maps.plan, placing, bottom_mm
        plan, count = maps.plan, len(maps.plan.taxels)
        self.beams_top = max(c.beam.thickness_mm for c in plan.channels) + plan.spec.printer.layer_mm + 0.25
        self.fine_top = max(self.beams_top, plan.plate.recess_depth_mm + 0.3)
        self.width = max(len(m.node_mm) for m in maps.maps)
        self.node_mm = np.ones((count, self.width))
        for taxel, channel in enumerate(maps.channel):
            own = maps.maps[channel].node_mm
            self.node_mm[taxel, : len(own)] = own
        self.stations = max(max(m.stations for m in maps.maps), 1)
        self.areas: list[np.ndarray] = []
        self.steps: list[float] = []
        self.plate = np.zeros(count)
        self.recess, self.strand = np.full(count, np.nan), np.full(count, np.nan)
        self.room = np.full((len(SHIFTS_MM), count), np.inf)
        self.gap, self.gap_top = np.full(count, np.inf), np.full(count, np.nan)
        self.top = self.volume = 0.0

        self.whole_mm = max(plan.plate.boss_top_mm, plan.spec.pad.frame_thickness_mm)

    @property
    def is_whole(self) -> bool:
        """Whether the pad's height is reached, but for less than a layer."""
        return self.top > self.whole_mm - max(self.steps[-1], self.plan.spec.printer.layer_mm) - 0.05

    def add(self, layer: Layer, step_mm: float) -> None:
        """Measure the next layer, `step_mm` higher than the last."""
        below, self.top = self.top, self.top + step_mm
        self.steps.append(step_mm)
        pieces = self._pieces(layer, step_mm, FINE_MM if below < self.fine_top else COARSE_MM)
        self.volume += float(pieces.volume.sum())
        is_taxel = pieces.taxel >= 0
        pieces = _Pieces(*(part[is_taxel] for part in pieces))
        owner, count = self.maps.owner[pieces.pixel], len(self.plate)
        self.plate += np.bincount(pieces.taxel, pieces.volume * (owner == PLATE), count)
        if below < self.beams_top:
            node = self.maps.node[pieces.pixel]
            on = node >= 0
            first = node[on].astype(np.int64)
            ahead = node[on] - first
            volume, at = pieces.volume[on], pieces.taxel[on] * self.width + first
            # Shared between the nodes before and behind, so that where pieces are cut does not matter.
            shared = np.bincount(at, volume * (1 - ahead), count * self.width + 1)
            shared += np.bincount(at + 1, volume * ahead, count * self.width + 1)
            self.areas.append(shared[:-1].reshape(count, self.width) / self.node_mm)
        self._add_recesses(pieces)
        self._add_gaps(pieces)

    def _pieces(self, layer: Layer, step_mm: float, piece_mm: float) -> _Pieces:
        points, line = cut(layer, piece_mm)
        points = turned(points - (self.placing.x_mm, self.placing.y_mm), -self.placing.quarters)
        spec = self.plan.spec
        half = np.array([spec.pad.width_mm, spec.pad.depth_mm]) / 2 + spec.pad.border_mm
        inside = (np.abs(points) < half + 0.1).all(1)
        pieces = np.bincount(line, minlength=len(layer.start))
        points, line = points[inside], line[inside]
        height = np.where(np.isnan(layer.height_mm), step_mm, layer.height_mm)
        wide = layer.area_mm2 / height
        strand = np.isnan(layer.height_mm) & (wide > STRAND * np.median(wide))
        height = np.where(strand, np.sqrt(4 / np.pi * layer.area_mm2), height)
        width = layer.area_mm2 / height + ROUND_EDGES * height
        return _Pieces((layer.volume_mm3 / pieces)[line], width[line], height[line], *self.maps.found(points))

    def _add_recesses(self, pieces: _Pieces) -> None:
        plate = self.plan.plate
        if self.top > self.fine_top + 1 and not np.isnan(self.recess).any():
            return
        radius, post = plate.recess_diameter_mm / 2, plate.post_diameter_mm / 2
        near = np.abs(pieces.own).max(1) < radius + 1
        own, taxel, width, height = (part[near] for part in (pieces.own, pieces.taxel, pieces.width, pieces.height))
        away = np.hypot(*own.T)
        above = (away < radius - WITHIN_RECESS_MM) & (away > post + WITHIN_RECESS_MM if post else True)
        open_yet = np.isnan(self.recess)
        volume, count = pieces.volume[near][above], len(open_yet)
        roof = np.bincount(taxel[above], volume, count)
        begins = open_yet & (roof > 0)
        strand = np.bincount(taxel[above], volume * height[above], count)[begins] / roof[begins]
        self.strand[begins], self.recess[begins] = strand, self.top - strand
        side = (open_yet & ~begins)[taxel] & (away > post + WITHIN_RECESS_MM if post else True)
        for k, shift in enumerate(SHIFTS_MM):
            free = 2 * np.hypot(*(own[side] - shift).T) - width[side]
            np.minimum.at(self.room[k], taxel[side], free)

    def _add_gaps(self, pieces: _Pieces) -> None:
        station = self.maps.station[pieces.pixel]
        on = station >= 0
        pixel, taxel = pieces.pixel[on], pieces.taxel[on]
        free = self.maps.aside_mm[pixel] - pieces.width[on] / 2
        shape = len(self.plate), self.stations, 2
        sides = np.full(shape[0] * shape[1] * 2, np.inf)
        np.minimum.at(sides, (taxel * self.stations + station[on]) * 2 + self.maps.side[pixel], free)
        gap = sides.reshape(shape).sum(2).min(1)
        narrower = gap < self.gap
        self.gap_top[narrower] = self.top
        self.gap = np.minimum(self.gap, gap)

    def done(self, filament_mm: float) -> LaidPad:
        """All that was measured."""
        return LaidPad(
            self.placing,
            self.bottom,
            filament_mm,
            np.array(self.areas),
            np.array(self.steps[: len(self.areas)]),
            tuple(tuple(m.beams) for m in self.maps.maps),
            self.plate,
            self.recess,
            self.strand,
            self.room.max(0),
            self.gap,
            self.gap_top,
            np.array(self.steps),
            self.volume,
        )

