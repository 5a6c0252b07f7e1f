"""Maps that tell to which body of a taxel a piece of a slicer's extrusion belongs, and where on the body it lies.

Each distinct taxel has one map (`TaxelMap`), a fine grid over its sub-cell in its own axes; `PadMaps` looks up points
of all taxels at once.
"""

import numpy as np

from padgen.measured.gcode_file import Layer
from padgen.planner.plan import Channel, Plan
from padgen.planner.suspensions import BeamPath
from padgen.planner.tile import TURNS, outline, taxel_places

__all__ = ["PLATE", "PadMaps", "TaxelMap", "cut", "turned"]

PIXEL_MM, MOST_PIXELS = 0.02, 400_000
STATION_MM = 0.4
GAPS = (0.9, 1.6)
"""Least and largest width of a gap, over the plan's least gap; corners at a beam's ends are narrower."""
OPPOSITE = -0.8
"""Largest cosine of the angle between the directions to both sides of a gap."""
NEAR_MM = 1.2
"""Largest distance from the middle of a gap to the middle of a bead beside it."""
NODE_MM, MOST_NODES = 0.5, 16
"""Distance between the nodes along a beam at which its width is measured, and the most nodes."""
FRAME, PLATE, BEAM = 1, 2, 3


class TaxelMap:
    """A grid over a taxel's sub-cell in its own axes, with the body, beam node, gap station and depth of each pixel.

    `owner` is the nearest body (`FRAME`, `PLATE`, or `BEAM` plus the beam's index), `node` the fractional node number
    along the beams (−1 off them), `station` the nearest station of a gap (−1: none near), `side` the side of that gap,
    and `aside_mm` the distance from the gap's middle. `depth_mm` is the depth below the surface of the solid in its
    lowest layer, negative outside.
    """

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
            run, pixel = self._run_mm(path)
            long_mm = float(path.length_mm)
            points = np.bincount(pixel, minlength=frame.size).reshape(self.shape)
            run_sum = np.bincount(pixel, run, frame.size).reshape(self.shape)
            near, at = distance(points == 0, self.pixel_mm, return_indices=True)
            own = (run_sum / np.maximum(points, 1))[at[0], at[1]]
            fillet = channel.beam.fillet_mm * (not path.segments[0].turn_rad)
            flare = fillet - np.sqrt(np.maximum(fillet**2 - np.maximum(fillet - own, 0) ** 2, 0))
            bodies.append((near < float(path.width_mm) / 2 + flare) & rest)
            steps = min(max(round(long_mm / NODE_MM), 4), MOST_NODES - 1)
            along.append(count + own / long_mm * steps)
            self.beams.append(slice(count, count + steps + 1))
            weights += [share * long_mm / steps for share in (0.5, *[1.0] * (steps - 1), 0.5)]
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

    def _run_mm(self, path: BeamPath) -> tuple[np.ndarray, np.ndarray]:
        """Return points along a beam: their distances in mm from its root, and the pixels that they lie in."""
        runs, points, done = [], [], 0.0
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
        """Set stations along the middle of each gap, and for pixels near a gap the station, side and distance.

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


class PadMaps:
    """The maps of all channels, concatenated, so that points on all taxels are looked up at once."""

    owner: np.ndarray
    node: np.ndarray
    station: np.ndarray
    side: np.ndarray
    aside_mm: np.ndarray
    solid: np.ndarray
    depth_mm: np.ndarray

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.places = taxel_places(plan)
        self.maps = [TaxelMap(plan, channel) for channel in plan.channels]
        sizes = [m.owner.size for m in self.maps]
        self.first = np.cumsum([0, *sizes[:-1]])
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
        """Return the columns and rows of the sub-cells of points (…, 2) on the pad, and where there is a sub-cell."""
        pad, cell, (rows, columns) = self.plan.spec.pad, self.plan.cell, self.places.shape
        column = np.floor((points[..., 0] + pad.width_mm / 2) / cell.width_mm).astype(np.int32)
        row = np.floor((points[..., 1] + pad.depth_mm / 2) / cell.depth_mm).astype(np.int32)
        return column, row, (column >= 0) & (column < columns) & (row >= 0) & (row < rows)

    def found(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Look up points (n, 2) in mm on the pad.

        Return each one's taxel (−1: none), its place (n, 2) from the washer in the taxel's own axes, and its pixel.
        """
        column, row, inside = self.cells(points)
        rows, columns = self.places.shape
        taxel = np.where(inside, self.places[row.clip(0, rows - 1), column.clip(0, columns - 1)], -1)
        (x, y), (cosine, sine), corner = (points - self.axis[taxel]).T, self.ways[taxel].T, self.corner[taxel].T
        own = np.stack([cosine * x + sine * y, cosine * y - sine * x], -1)
        channel = self.channel[taxel]
        pixel, shape = self.pixel_mm[channel], self.shape[channel].T
        at = [((own[:, k] - corner[k]) / pixel).astype(np.int32).clip(0, shape[k] - 1) for k in (0, 1)]
        return taxel, own, self.first[channel] + at[0] * shape[1] + at[1]

    def solid_at(self, points: np.ndarray) -> np.ndarray:
        """Return where, among points (n, 2) in mm, the plan has plastic in its lowest layer."""
        spec = self.plan.spec
        taxel, _, pixel = self.found(points)
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
