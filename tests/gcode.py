"""A reader of a slicer's G-code, independent of padgen's: the width of each laid beam, and its layers.

The laid width of a layer is the plastic it extrudes per length of beam and per layer height: a bead
with round edges counts as the rectangle of the same area.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from padgen.planner.layout import to_cell
from padgen.planner.plan import TURNS, Channel, Plan, Taxel


@dataclass(frozen=True)
class Extrusions:
    """Straight extrusions from `start` to `stop` (n, 2) in mm.

    `width` (n,) is that of a rectangle of the same area and of the layer's `height` (n,); `layer` (n,) counts from 0.
    """

    start: np.ndarray
    stop: np.ndarray
    width: np.ndarray
    height: np.ndarray
    layer: np.ndarray
    layer_top_mm: np.ndarray

    @property
    def volume_mm3(self) -> np.ndarray:
        """Plastic of each extrusion."""
        return np.hypot(*(self.stop - self.start).T) * self.width * self.height


def read_gcode(path: Path) -> Extrusions:
    """Read the extruding moves of PrusaSlicer's G-code for 1.75 mm filament."""
    x = y = e = 0.0
    height = 0.0
    layer = -1
    filament = np.pi / 4 * 1.75**2
    tops: list[float] = []
    rows = []
    for line in path.read_text().splitlines():
        if line.startswith(";LAYER_CHANGE"):
            layer += 1
        elif line.startswith(";Z:"):
            tops.append(float(line[3:]))
        elif line.startswith(";HEIGHT:"):
            height = float(line[8:])
        elif line.startswith("G92"):
            e = 0.0
        elif line.startswith("G1 "):
            words = {w[0]: float(w[1:]) for w in line.split(";")[0].split()[1:]}
            nx = words.get("X", x)
            ny = words.get("Y", y)
            ne = words.get("E", e)
            if ne > e and (nx, ny) != (x, y) and layer >= 0:
                length = ((nx - x) ** 2 + (ny - y) ** 2) ** 0.5
                rows.append((x, y, nx, ny, (ne - e) * filament / length / height, height, layer))
            x = nx
            y = ny
            e = ne
    table = np.array(rows)
    return Extrusions(*np.split(table[:, :4], 2, 1), *table[:, 4:6].T, table[:, 6].astype(int), np.array(tops))


@dataclass(frozen=True)
class LaidBeam:
    """One beam as laid across its middle: planned width, and laid width layer by layer, in mm."""

    taxel: str
    planned_width_mm: float
    planned_layers: int
    laid_width_mm: tuple[float, ...]


def laid_beams(plan: Plan, extrusions: Extrusions, centre_mm: tuple[float, float]) -> list[LaidBeam]:
    """Measure every beam of the plan as laid, for a pad whose centre lies at `centre_mm` on the bed."""
    result = []
    for taxel in plan.taxels:
        channel = plan.channels[taxel.channel]
        for middle, across in _middles(plan, channel, taxel):
            widths = []
            for layer in range(channel.beam.layers + 1):
                at = extrusions.layer == layer
                widths.append(_laid_width(extrusions, at, middle + np.array(centre_mm), across, channel.beam.width_mm))
            result.append(LaidBeam(taxel.id, channel.beam.width_mm, channel.beam.layers, tuple(widths)))
    return result


@dataclass(frozen=True)
class LaidRecess:
    """One recess as laid: its depth, and the diameter of the largest circle in it that holds no bead."""

    taxel: str
    depth_mm: float
    room_mm: float


ROUND_EDGES = 1 - np.pi / 4
"""Excess width of a bead with round edges over the rectangle of its area, over its height."""
AROUND = 0.06 * np.stack(np.meshgrid(np.arange(-1, 2), np.arange(-1, 2)), -1).reshape(-1, 2)
"""Shifts in mm from a recess's middle at which the room for its washer is tried."""


def laid_recesses(plan: Plan, lines: Extrusions, centre_mm: tuple[float, float]) -> list[LaidRecess]:
    """Measure every recess of the plan as laid, for a pad whose centre lies at `centre_mm` on the bed."""
    result = []
    for taxel in plan.taxels:
        middle = np.array([taxel.x_mm, taxel.y_mm]) + centre_mm
        roof = _distance(lines, middle) < plan.plate.recess_diameter_mm / 4
        first = lines.layer[roof].min()
        top = lines.layer_top_mm[first]
        height = lines.height[roof & (lines.layer == first)].max()
        beads = (lines.width + ROUND_EDGES * lines.height) / 2
        # Ballast above the mover is pressed into a pocket that may be narrower.
        of_mover = lines.layer_top_mm[lines.layer] - lines.height < plan.spec.mover_top_mm - 0.02
        below = (lines.layer < first) & of_mover
        rooms = [2 * (_distance(lines, middle + step) - beads)[below].min() for step in AROUND]
        result.append(LaidRecess(taxel.id, float(top - height), float(max(rooms))))
    return result


def _distance(lines: Extrusions, point: np.ndarray) -> np.ndarray:
    """Return the distance of a point from the middle line of each extrusion."""
    along = lines.stop - lines.start
    start = point - lines.start
    share = np.clip((start * along).sum(1) / (along**2).sum(1), 0, 1)
    return np.hypot(*(start - share[:, None] * along).T)


def _middles(plan: Plan, channel: Channel, taxel: Taxel) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the middle of each beam on the pad, and the direction across it."""
    arrangement = plan.arrangement(channel)
    middles = [path.within(0, 0.5) for path in arrangement.beams]
    points = [[float(middle.x_mm), float(middle.y_mm), 0.0] for middle in middles]
    washer = to_cell(np.array([float(arrangement.washer_x_mm), 0.0, 0.0]), channel)
    places = to_cell(np.array(points), channel) - washer
    cosine, sine = TURNS[channel.site.along]
    across = np.array([-sine, cosine], float)
    return [(place[:2] + np.array([taxel.x_mm, taxel.y_mm]), across) for place in places]


def _laid_width(lines: Extrusions, at: np.ndarray, middle: np.ndarray, across: np.ndarray, width: float) -> float:
    """Return the sum of the widths of the lines that cross the section through `middle`."""
    along = np.array([across[1], -across[0]])
    start = lines.start[at] - middle
    stop = lines.stop[at] - middle
    a = start @ along
    b = stop @ along
    crosses = (a * b <= 0) & (np.abs(a - b) > 1e-9)
    share = np.divide(a, a - b, out=np.zeros_like(a), where=crosses)
    place = (start @ across) + share * ((stop - start) @ across)
    near = crosses & (np.abs(place) < width / 2 + 0.15)
    return float(lines.width[at][near].sum())
