"""Measurement of a pad in a slicer's G-code: its place on the bed, and each taxel as it is laid.

Every extrusion is cut into short pieces. Each piece is looked up in a map of its taxel (`TaxelMap`, one per channel),
which tells its body, its place along a beam, and the nearest station of a gap with its distance. The work grows with
the length of the extrusions, and only one layer is held at a time.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import FileError, number
from padgen.measured.gcode_file import Layer, read_layers
from padgen.measured.laid_map import PLATE, PadMaps, cut, turned
from padgen.planner.plan import Plan

__all__ = ["LaidPad", "Placing", "laid_pad"]

ROUND_EDGES = 1 - np.pi / 4
"""Excess width of a bead with round edges over a rectangle of the same area and height, over the height."""
FINE_MM, COARSE_MM = 0.04, 0.2
"""Longest pieces of extrusions at the height of beams and recesses, and above it."""
MOST_PIECES = 1_000_000
"""Most pieces that are looked up at a time."""
WITHIN_RECESS_MM = 0.35
"""Distance inwards from a recess's side from which plastic counts as its roof, not as a bead of the side."""
STRAND = 2.0
"""Multiple of the layer's median width above which an extrusion is taken as a free round strand of a bridge."""
SHIFTS_MM = 0.06 * np.stack(np.meshgrid(np.arange(-1, 2), np.arange(-1, 2)), -1).reshape(-1, 2)
"""Shifts from a recess's middle at which the room for its washer is tried."""
MOST_OTHER = 0.15
"""Largest share of a sub-cell that may differ from the plan: usual profiles have 0.06, other pads 0.23 or more."""
LONG_MM = 1.0
"""Least length of a bead along the pad's edge, and its largest distance from the edge."""
ALIKE = 2e-3
"""Difference of correlations that may be rounding; a pad that looks the same when turned then gets the smaller turn."""
IMAGE_MM, MOST_IMAGE = 0.5, 1000
"""Pixel size of the images that are compared, and the most pixels along a side of the searched area."""
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
    the depth below the lowest strands of the recess's roof, `strand_mm` the height of these strands, `room_mm` the
    diameter of the largest circle near the recess's middle that holds no plastic. `gap_mm` is the narrowest gap around
    plate and beams, `gap_top_mm` its height. `all_steps_mm` are the thicknesses of all layers, `volume_mm3` is all of
    the pad's plastic.
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


class _Pieces(NamedTuple):
    """Pieces (n,) of extrusions within the sub-cells of taxels.

    Volume in mm³, outer width and height in mm, index of the taxel, place `own` (n, 2) of the piece's middle from the
    washer's axis in the taxel's own axes in mm, and pixel of the maps.
    """

    volume: np.ndarray
    width: np.ndarray
    height: np.ndarray
    taxel: np.ndarray
    own: np.ndarray
    pixel: np.ndarray


def laid_pad(plan: Plan, path: Path, filament_mm: float | None = None) -> LaidPad:
    """Find the pad of `plan` in a file of G-code and measure it, layer by layer.

    Where the filament's diameter is not given, it is the one of `FILAMENTS_MM` with which the lowest layer comes out
    full.

    Raises
    ------
    FileError
        The file lays nothing, does not hold this pad, or ends before the pad is whole.
    """
    where, maps = str(path), PadMaps(plan)
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
                f"lays something at z = {number(layer.top_mm)} mm after z = {number(top)} mm; must be laid layer by"
                " layer, all objects together",
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
            f"ends at {number(measuring.top)} mm of the {number(measuring.whole_mm)} mm that the pad {plan.name} is"
            " high: the file is cut short, or of another pad",
            where,
        )
    return measuring.done(found)


def _placed(maps: PadMaps, layers: Iterator[Layer], where: str) -> tuple[Placing, Layer, float, float]:
    """Find the pad by its lowest layer; return its place, that layer, the layer's thickness in mm and its fullness.

    The fullness is its plastic over the planned plastic.
    """
    least, top = 1.0, 0.0
    for _, layer in zip(range(FIRST_LAYERS), layers, strict=False):
        told = float(layer.height_mm[0])
        step = told if told > 0 else layer.top_mm - top if layer.top_mm > top else layer.top_mm
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
        if placing.other <= MOST_OTHER:
            return placing, layer, step, _fullness(maps, placing, layer, step)
        least = min(least, placing.other)
    if not top:
        raise FileError("has no moves that lay plastic; it is no G-code of a print", where)
    raise FileError(
        f"does not hold the pad {maps.plan.name}: what is laid first differs from its underside on {least:.0%} of a"
        f" taxel's cell or of the border, must be {MOST_OTHER:.0%} at most; it is of another pad or spec, lies upside"
        " down, or is turned by no quarter turn",
        where,
    )


def _fullness(maps: PadMaps, placing: Placing, layer: Layer, step_mm: float) -> float:
    """Return the plastic of the lowest layer within the taxels' sub-cells over the planned plastic there."""
    points, line = cut(layer, COARSE_MM)
    points = turned(points - (placing.x_mm, placing.y_mm), -placing.quarters)
    pieces = np.bincount(line, minlength=len(layer.start))
    is_taxel = maps.found(points)[0] >= 0
    laid = (layer.volume_mm3 / pieces)[line][is_taxel].sum() / step_mm
    planned = sum(float(m.solid.sum()) * m.pixel_mm**2 for m in (maps.maps[c] for c in maps.channel))
    return float(laid / planned)


def _registered(maps: PadMaps, layer: Layer, height_mm: float) -> Placing:
    """Find where the pad lies, by the correlation of a layer's extrusions with the plan's lowest cross-section.

    First all quarter turns are tried on a coarse grid, by Fourier transforms. The two best are then moved until the
    beads lie deepest within the plan's bodies, which leaves gaps equally wide on both sides.
    """
    pad = maps.plan.spec.pad
    size = np.array([pad.width_mm, pad.depth_mm]) + 2 * pad.border_mm
    points, line = cut(layer, 0.2)
    low, high = points.min(0), points.max(0)
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
        start, stop = (turned(end - centre, -quarters) - moved for end in (layer.start, layer.stop))
        moved = moved + _off_centre(start, stop, size / 2)
        shown = image(own - moved, -np.array(fine.shape) * IMAGE_MM / 2, fine.shape, IMAGE_MM)
        match = float(np.corrcoef(shown.ravel(), fine.ravel())[0, 1]) if shown.any() else 0.0
        if match > best.match + ALIKE:
            x, y = (centre + turned(moved[None], quarters)[0]).tolist()
            best = Placing(x, y, quarters, match, _largest_difference(maps, middles, fine, shown))
    return best


def _off_centre(start: np.ndarray, stop: np.ndarray, half_mm: np.ndarray) -> np.ndarray:
    """Return by how much (2,) in mm the middle between the beads at opposite edges is off the pad's middle."""
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


def _largest_difference(maps: PadMaps, middles: list[np.ndarray], plan: np.ndarray, laid: np.ndarray) -> float:
    """The largest share of a sub-cell, or of the border, that is laid where the plan has a window, or bare where it
    has plastic.

    `middles` are the coordinates of the images' pixels along x and y.
    """
    column, row, inside = maps.cells(np.stack(np.meshgrid(*middles, indexing="ij"), -1))
    number = np.where(inside, row * maps.places.shape[1] + column, maps.places.size).ravel()
    differs = (((laid > 0.3) & (plan < 0.05)) | ((laid < 0.15) & (plan > 0.95))).ravel()
    return float((np.bincount(number, differs) / np.maximum(np.bincount(number), 1)).max())


def _depth(maps: PadMaps, points: np.ndarray) -> float:
    """Return the sum of the points' depths in mm within the plan's bodies, each limited to −0.5 … 0.25 mm."""
    taxel, _, pixel = maps.found(points)
    return float(np.clip(maps.depth_mm[pixel[taxel >= 0]], -0.5, 0.25).sum())


class _Measuring:
    """A pad that is being measured: sums and extremes over the layers added so far."""

    def __init__(self, maps: PadMaps, placing: Placing, bottom_mm: float) -> None:
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
        """True where the pad's height is reached, within about a layer."""
        return self.top > self.whole_mm - max(self.steps[-1], self.plan.spec.printer.layer_mm) - 0.05

    def add(self, layer: Layer, step_mm: float) -> None:
        """Measure the next layer, `step_mm` higher than the last."""
        below, self.top = self.top, self.top + step_mm
        self.steps.append(step_mm)
        count, open_yet = len(self.plate), np.isnan(self.recess)
        shared = np.zeros(count * self.width + 1)
        roof, strands, room = np.zeros(count), np.zeros(count), np.full_like(self.room, np.inf)
        sides = np.full(count * self.stations * 2, np.inf)
        for pieces in self._pieces(layer, step_mm, FINE_MM if below < self.fine_top else COARSE_MM):
            taxel, volume = pieces.taxel, pieces.volume
            self.plate += np.bincount(taxel, volume * (self.maps.owner[pieces.pixel] == PLATE), count)
            node = self.maps.node[pieces.pixel]
            at, ahead = taxel * self.width + np.maximum(node, 0).astype(np.int64), node % 1
            volume_on = np.where(node >= 0, volume, 0.0)
            # Shared between the nodes before and behind, so that where pieces are cut does not matter.
            shared += np.bincount(at, volume_on * (1 - ahead), len(shared))
            shared += np.bincount(at + 1, volume_on * ahead, len(shared))
            station = self.maps.station[pieces.pixel]
            on = station >= 0
            free = self.maps.aside_mm[pieces.pixel] - pieces.width / 2
            side = (taxel * self.stations + station) * 2 + self.maps.side[pieces.pixel]
            np.minimum.at(sides, side[on], free[on])
            if open_yet.any():
                self._add_recesses(pieces, roof, strands, room)
        begins = open_yet & (roof > 0)
        self.strand[begins] = strands[begins] / roof[begins]
        self.recess[begins] = self.top - self.strand[begins]
        still = open_yet & ~begins
        self.room[:, still] = np.minimum(self.room, room)[:, still]
        if below < self.beams_top:
            self.areas.append(shared[:-1].reshape(count, self.width) / self.node_mm)
        gap = sides.reshape(count, self.stations, 2).sum(2).min(1)
        self.gap_top[gap < self.gap] = self.top
        self.gap = np.minimum(self.gap, gap)

    def _pieces(self, layer: Layer, step_mm: float, piece_mm: float) -> Iterator[_Pieces]:
        """Yield the pieces within the sub-cells of taxels, `MOST_PIECES` or fewer at a time; sum the pad's plastic."""
        height = np.where(np.isnan(layer.height_mm), step_mm, layer.height_mm)
        wide = layer.area_mm2 / height
        strand = np.isnan(layer.height_mm) & (wide > STRAND * np.median(wide))
        height = np.where(strand, np.sqrt(4 / np.pi * layer.area_mm2), height)
        width = layer.area_mm2 / height + ROUND_EDGES * height
        run = np.cumsum(np.hypot(*(layer.stop - layer.start).T) / piece_mm + 1)
        ends = np.searchsorted(run, np.arange(MOST_PIECES, run[-1], MOST_PIECES))
        pad = self.plan.spec.pad
        half = np.array([pad.width_mm, pad.depth_mm]) / 2 + pad.border_mm
        for first, last in pairwise((0, *ends.tolist(), len(run))):
            part = replace(layer, start=layer.start[first:last], stop=layer.stop[first:last])
            points, line = cut(part, piece_mm)
            points = turned(points - (self.placing.x_mm, self.placing.y_mm), -self.placing.quarters)
            inside = (np.abs(points) < half + 0.1).all(1)
            volume = layer.volume_mm3[first:last] / np.bincount(line, minlength=last - first)
            self.volume += float(volume[line[inside]].sum())
            taxel, own, pixel = self.maps.found(points)
            on = taxel >= 0
            line = line[on]
            yield _Pieces(
                volume[line], width[first:last][line], height[first:last][line], taxel[on], own[on], pixel[on]
            )

    def _add_recesses(self, pieces: _Pieces, roof: np.ndarray, strands: np.ndarray, room: np.ndarray) -> None:
        """Add each recess's roof plastic, the same times its height, and the room between beads about its middle."""
        radius, post = self.plan.plate.recess_diameter_mm / 2, self.plan.plate.post_diameter_mm / 2
        near = np.abs(pieces.own).max(1) < radius + 1
        own, taxel, width, height = (part[near] for part in (pieces.own, pieces.taxel, pieces.width, pieces.height))
        away = np.hypot(*own.T)
        beside = away > post + WITHIN_RECESS_MM if post else np.ones(len(away), bool)
        above = beside & (away < radius - WITHIN_RECESS_MM)
        volume = pieces.volume[near][above]
        roof += np.bincount(taxel[above], volume, len(roof))
        strands += np.bincount(taxel[above], volume * height[above], len(roof))
        for k, shift in enumerate(SHIFTS_MM):
            np.minimum.at(room[k], taxel[beside], 2 * np.hypot(*(own[beside] - shift).T) - width[beside])

    def done(self, filament_mm: float) -> LaidPad:
        """Return all measurements; a recess without a roof is as deep as the pad is high."""
        self.recess[np.isnan(self.recess)] = self.top
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
