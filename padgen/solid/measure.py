"""Measurement of every taxel's dimensions on the finished mesh, by rays and cross-sections.

Walls, gaps and spans of a part come from its horizontal cross-sections. A cross-section is shrunk by r and grown again
by r, with square corners. Whatever is lost is narrower than 2 r: a thin wall where this is done to the material, a
narrow gap where it is done to the empty space.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import inf, isfinite, nan
from typing import Any, NamedTuple

import numpy as np

from padgen.planner.layout import coil_axis_mm, to_cell
from padgen.planner.plan import Channel, Pin, Plan, Taxel
from padgen.planner.suspensions import BeamPath, PathPoint
from padgen.solid.mesh import CHORD_MM, Mesh

__all__ = [
    "Dimension",
    "NarrowSpot",
    "distance_to_sides",
    "holes_of",
    "longest_unsupported_span",
    "measured",
    "narrow_places",
    "ray_distance_mm",
    "sections",
    "thin_skins",
    "washer_rooms",
]

STATIONS = (0.4, 0.65, 0.9)
"""Shares of a straight beam's length, from the root, at which width and thickness are measured, beyond the flare."""
HEIGHTS = (0.02, 0.5, 0.98)
"""Shares of a recess's depth at which the room for a washer is measured, since its mouth may be narrower."""
WIDTH_STEPS = 512
"""Steps in which the width of the narrowest wall or gap is found."""
LARGEST_RECESS = 1.5
"""Largest diameter of a hole that counts as a recess, in planned recess diameters."""
NEAR_MM = 0.05
"""Distance from the end of an arc at which a ray along the arc starts."""


class Dimension(NamedTuple):
    """A dimension of a finished mesh: place, name, planned and measured size in mm (nan if it could not be measured).

    The triangles of a round face may change it by `facets_mm`.
    """

    where: str
    name: str
    planned_mm: float
    built_mm: float
    facets_mm: float = 0.0


class _Gauge(NamedTuple):
    """A planned length in mm, the rays that measure it, and the function that combines the rays' lengths.

    `rays` (n, 2, 3) are from and to, in the taxel's axes. A run is the distance in mm from a ray's start to a face.
    """

    name: str
    planned_mm: float
    rays: np.ndarray
    combine: Callable[[list[float]], float]
    facets_mm: float = 0.0


def measured(plan: Plan, solid: Any, taxels: Sequence[Taxel] | None = None) -> Iterator[Dimension]:
    """Yield planned and measured sizes of beams, recess and boss on the pad's solid, of `taxels` (default: of all).

    Each ray runs until it meets a face. Rays go sideways from within a beam (its width and place), above the beam
    along its path to both ends (length), onto the beam from below and above (thickness), and up into the recess
    (depth). The recess's diameter and place are taken from a cross-section at half its depth.
    """
    gauges = {
        channel.index: [gauge._replace(rays=to_cell(gauge.rays, channel)) for gauge in _gauges(plan, channel)]
        for channel in plan.channels
    }
    taxels = plan.taxels if taxels is None else taxels
    for taxel, (outline, centroid) in zip(taxels, _recesses(plan, solid, 0.5, taxels), strict=True):
        where = f"taxel {taxel.id}"
        offset = centroid - (taxel.x_mm, taxel.y_mm)
        yield Dimension(where, "recess diameter", _opening_mm(plan), _diameter_mm(outline, centroid))
        yield Dimension(where, "recess centre offset", 0.0, float(np.hypot(*offset)))
        centre = np.array([*coil_axis_mm(plan.coils, *taxel.coil), 0.0])
        around = np.array([-1.0, -1.0, 1.0]) if taxel.turned else np.ones(3)
        for gauge in gauges[taxel.channel]:
            runs = [ray_distance_mm(solid, *(ray * around + centre)) for ray in gauge.rays]
            yield Dimension(where, gauge.name, gauge.planned_mm, gauge.combine(runs), gauge.facets_mm)


def washer_rooms(plan: Plan, solid: Any, taxels: Sequence[Taxel]) -> Iterator[tuple[str, float]]:
    """Yield for each taxel its id and the free diameter of its recess in mm, nan where there is no recess.

    The free diameter is that of the largest circle about the recess's middle that holds no plastic. In the mesh a
    round recess is a polygon, whose sides lie nearer to the middle than its corners do.
    """
    for taxel, *cuts in zip(taxels, *(_recesses(plan, solid, share, taxels) for share in HEIGHTS), strict=True):
        yield taxel.id, float(np.min([2 * distance_to_sides(*cut) for cut in cuts]))


def distance_to_sides(outline: np.ndarray, at: np.ndarray) -> float:
    """Return the distance from a point (2,) to the nearest side of a closed outline (n, 2)."""
    start = outline - at
    along = np.roll(outline, -1, axis=0) - outline
    share = -np.einsum("ij,ij->i", start, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-30)
    nearest = start + np.clip(share, 0, 1)[:, None] * along
    return float(np.hypot(*nearest.T).min())


def _gauges(plan: Plan, channel: Channel) -> Iterator[_Gauge]:
    """Yield the planned lengths and measuring rays of a channel's beams, recess and boss, in the taxel's axes."""
    arrangement = plan.arrangement(channel)
    plate = plan.plate
    lowest_block = min(float(block.height_mm) for block in arrangement.blocks)
    for number, path in enumerate(arrangement.beams):
        name = f"beam {number + 1}" if len(arrangement.beams) > 1 else "beam"
        pin = channel.pin if channel.pin.on_beam and number == 0 else None
        yield _length_gauge(name, path, (float(path.thickness_mm) + lowest_block) / 2, pin)
        bends = [(k, 0.5) for k, segment in enumerate(path.segments) if segment.turn_rad]
        straight = [(k, 0.5) for k, segment in enumerate(path.segments) if not segment.turn_rad]
        stations = [(0, at) for at in STATIONS] if len(path.segments) == len(straight) == 1 else straight
        for what, places, facets in (("", stations, 0.0), (" in its bends", bends, CHORD_MM)):
            points = [point for place in places if _is_clear(point := path.within(*place), pin)]
            if points:
                for gauge in _section_gauges(path, points, lowest_block):
                    yield gauge._replace(name=f"{name} {gauge.name}{what}", facets_mm=facets)
    washer = np.array([float(arrangement.washer_x_mm), 0.0, 0.0])
    ballast = plan.spec.ballast
    inner = ballast.corners_mm if ballast else plate.post_diameter_mm
    if inner < plate.recess_diameter_mm:
        under = washer + np.array([0.0, (inner + plate.recess_diameter_mm) / 4, -1.0])
        up = np.array([[under, under + np.array([0, 0, plate.recess_depth_mm + 2])]])
        yield _Gauge("recess depth", plate.recess_depth_mm, up, lambda runs: runs[0] - 1)
    if ballast:
        top = plan.spec.pocket_top_mm
        under = washer + np.array([0.0, 0.0, -1.0])
        up = np.array([[under, under + np.array([0, 0, top + 2])]])
        yield _Gauge("pocket height", top, up, lambda runs: runs[0] - 1)
    top_mm = channel.pin.top_mm
    over = np.array([channel.pin.x_mm, channel.pin.y_mm, top_mm + 1])
    down = np.array([[over, over - np.array([0, 0, top_mm])]])
    yield _Gauge(
        "pin height" if channel.pin.on_beam else "boss height", top_mm, down, lambda runs: top_mm + 1 - runs[0]
    )


BESIDE_PIN_MM = 0.05
"""Least distance from the fillet of a pin's foot at which a beam is measured."""


def _is_clear(point: PathPoint, pin: Pin | None) -> bool:
    """Return whether a point of a beam's path is clear of the pin on it."""
    if pin is None:
        return True
    away = np.hypot(float(point.x_mm) - pin.x_mm, float(point.y_mm) - pin.y_mm)
    return bool(away > pin.diameter_mm / 2 + pin.fillet_mm + BESIDE_PIN_MM)


def _section_gauges(path: BeamPath, points: list[PathPoint], lowest_block: float) -> Iterator[_Gauge]:
    width, thickness = float(path.width_mm), float(path.thickness_mm)
    inside = [np.array([p.x_mm, p.y_mm, thickness / 2], float) for p in points]
    sides = [width * np.array([-p.along_y, p.along_x, 0.0], float) for p in points]
    across = np.array([[at, at + way] for at, side in zip(inside, sides, strict=True) for way in (side, -side)])
    yield _Gauge("width", width, across, lambda runs: _worst(runs, width, 0.0, 1.0, 1.0))
    if not path.is_straight:
        # The planned length between a bent beam's ends counts as built only if the beam lies on its path.
        yield _Gauge("offset from its path", 0.0, across, lambda runs: _worst(runs, 0.0, 0.0, 0.5, -0.5))
    span = lowest_block + 2
    faces = np.array([[[*at[:2], z], at] for at in inside for z in (-1.0, lowest_block + 1)])
    yield _Gauge("thickness", thickness, faces, lambda runs: _worst(runs, thickness, span, -1.0, -1.0))
    yield _Gauge("height above the bed", 0.0, faces[::2], lambda runs: max(runs) - 1)


def _length_gauge(name: str, path: BeamPath, height: float, pin: Pin | None) -> _Gauge:
    """Return the gauge of a beam's length: rays towards frame and plate, `height` mm above the bed, that miss the pin.

    They start within the first and the last segment, near their ends where a pin stands in the way. A straight ray
    leaves an arc, so on an arc it starts close to the arc's end.
    """
    length = float(path.length_mm)
    last = len(path.segments) - 1
    aside = {}
    for k, sign in ((0, 1), (last, -1)):
        segment_mm = float(path.segments[k].length_mm)
        share = 0.5 if not path.segments[k].turn_rad else min(NEAR_MM / segment_mm, 0.5)
        tried = [share * (1 - step / 20) for step in range(20)]
        aside[sign] = next((at for at in tried if _all_clear(path, k, sign, at, pin)), tried[-1])
    places = path.within(0, aside[1]), path.within(last, 1 - aside[-1])
    between = length - sum(aside[sign] * float(path.segments[k].length_mm) for k, sign in ((0, 1), (last, -1)))
    rays = []
    for place, reach in zip(places, (-length, length), strict=True):
        start = np.array([place.x_mm, place.y_mm, height], float)
        rays.append([start, start + reach * np.array([place.along_x, place.along_y, 0.0], float)])
    return _Gauge(f"{name} length", length, np.array(rays), lambda runs: between + sum(runs))


def _all_clear(path: BeamPath, k: int, sign: int, share: float, pin: Pin | None) -> bool:
    """Return whether the first (`sign` −1: last) `share` of segment `k` of a beam's path is clear of the pin."""
    shares = np.linspace(0, share, 10)
    return all(_is_clear(path.within(k, at if sign > 0 else 1 - at), pin) for at in shares.tolist())


def _worst(runs: list[float], planned: float, span: float, one: float, other: float) -> float:
    """Return the size in mm farthest from `planned`, of ``span + one * a + other * b`` for pairs a, b of `runs`."""
    sizes = [span + one * a + other * b for a, b in zip(runs[::2], runs[1::2], strict=True)]
    return max(sizes, key=lambda size: abs(size - planned) if isfinite(size) else inf)


def _opening_mm(plan: Plan) -> float:
    """Return the width in mm of the opening in the plate's underside: recess or ballast, whichever is wider."""
    recess = plan.plate.recess_diameter_mm
    ballast = plan.spec.ballast
    return max(recess, ballast.corners_mm) if ballast else recess


def _recesses(plan: Plan, solid: Any, share: float, taxels: Sequence[Taxel]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield each taxel's recess, cut at a `share` of its depth: outline (n, 2) and centroid (2,) in mm, nan if none."""
    outlines = holes_of(solid, plan.plate.recess_depth_mm * share)
    sides = [(outline + np.roll(outline, -1, axis=0), _crosses(outline)) for outline in outlines]
    centroids = [(both * crosses[:, None]).sum(0) / (3 * crosses.sum()) for both, crosses in sides]
    diameters = np.array([_diameter_mm(*each) for each in zip(outlines, centroids, strict=True)])
    # The window around a plate may have the same centre as the recess, but it is larger.
    small = diameters < LARGEST_RECESS * _opening_mm(plan)
    for taxel in taxels:
        offsets = np.hypot(*(np.reshape(centroids, (-1, 2)) - (taxel.x_mm, taxel.y_mm)).T)
        around = np.flatnonzero(small & (offsets < diameters / 2))
        k = min(around, key=diameters.__getitem__, default=None)
        yield (np.full((3, 2), nan), np.full(2, nan)) if k is None else (outlines[k], centroids[k])


def _diameter_mm(outline: np.ndarray, centroid: np.ndarray) -> float:
    """Return twice the largest distance of an outline's corners from its centroid: a round hole's diameter."""
    return 2 * float(np.hypot(*(outline - centroid).T).max())


def holes_of(solid: Any, z_mm: float) -> list[np.ndarray]:
    """Return the clockwise outlines (n, 2) of the holes in the cross-section at height `z_mm`."""
    return [contour for contour in solid.slice(z_mm).to_polygons() if _crosses(contour).sum() < 0]


def _crosses(outline: np.ndarray) -> np.ndarray:
    """Return twice the signed areas (n,) of the triangles between the origin and each side."""
    x, y = outline.T
    next_x, next_y = np.roll(outline, -1, axis=0).T
    return np.asarray(x * next_y - next_x * y)


def ray_distance_mm(solid: Any, start: Any, stop: Any) -> float:
    """Return the distance in mm from a ray's start to the first face, nan where it meets none."""
    hits = solid.ray_cast(tuple(start), tuple(stop))
    return float(hits[0].distance * np.linalg.norm(np.subtract(stop, start))) if hits else nan


LEVELS = 16
MOST_HEIGHTS = 100
"""Most cross-sections of a part, and most heights of its horizontal faces, that are examined."""
STEP_MM = 1e-4
AREA_MM2 = 1e-6
ROOM_MM = 5.0
SPLINTER_SHARE = 0.05


class NarrowSpot(NamedTuple):
    """A place where a wall, gap, span or skin breaks a print limit: its centre in mm and its area in mm²."""

    x_mm: float
    y_mm: float
    z_mm: float
    area_mm2: float


def sections(solid: Any, mesh: Mesh) -> list[tuple[float, Any]]:
    """Return cross-sections halfway between neighbouring heights of the vertices, at most `LEVELS` of them.

    Each is its height in mm and a manifold3d cross-section; empty ones are left out. Where there are more heights, the
    cuts lie halfway between quantiles of the heights.
    """
    heights = np.unique(np.round(mesh.vertices_mm[:, 2] / STEP_MM) * STEP_MM)
    if len(heights) > LEVELS + 1:
        heights = np.quantile(heights, np.linspace(0, 1, LEVELS + 1))
    cuts = ((z, solid.slice(z)) for z in ((heights[1:] + heights[:-1]) / 2).tolist())
    # A cut between two bodies that lie above each other is empty.
    return [(z, shape) for z, shape in cuts if not shape.is_empty()]


class _Part(NamedTuple):
    """A region of material or of empty space in a cross-section; only narrow places inside `core` count (None: all)."""

    z_mm: float
    shape: Any
    core: Any = None

    def narrower_than(self, limit_mm: float) -> "tuple[list[NarrowSpot], _Part]":
        """Return the places narrower than a limit, and the part in which to look for narrower ones.

        Lost is what does not come back when the shape is shrunk by half of the limit and grown again. A corner that
        shrinks and grows reaches no farther than twice the limit.
        """
        from manifold3d import JoinType

        half = limit_mm / 2
        lost = self.shape - self.shape.offset(-half, JoinType.Miter).offset(half * 1.001, JoinType.Miter)
        if self.core is not None:
            lost = lost ^ self.core
        pieces = [] if lost.is_empty() else lost.decompose()
        # Square corners survive; acute ones lose a splinter, which is no wall.
        splinter = SPLINTER_SHARE * half**2
        spots = [_where(piece, self.z_mm) for piece in pieces if piece.area() > splinter]
        return spots, _Part(self.z_mm, self.shape ^ _boxes(pieces, 2 * limit_mm), _boxes(pieces, STEP_MM))


def _boxes(pieces: list[Any], margin_mm: float) -> Any:
    """Return the boxes around pieces of a cross-section, each wider by a margin on every side, as one shape."""
    from manifold3d import CrossSection, OpType

    boxes = []
    for x0, y0, x1, y1 in (piece.bounds() for piece in pieces):
        box = CrossSection.square((x1 - x0 + 2 * margin_mm, y1 - y0 + 2 * margin_mm))
        boxes.append(box.translate((x0 - margin_mm, y0 - margin_mm)))
    return CrossSection.batch_boolean(boxes, OpType.Add) if boxes else CrossSection()


def _part_of(section: tuple[float, Any], gaps: bool) -> _Part:
    """Return the material of a cross-section, or with `gaps` the empty space in it and around it."""
    z_mm, filled = section
    if not gaps:
        return _Part(z_mm, filled)
    x0, y0, x1, y1 = filled.bounds()
    room = type(filled).square((x1 - x0 + 2 * ROOM_MM, y1 - y0 + 2 * ROOM_MM))
    return _Part(z_mm, room.translate((x0 - ROOM_MM, y0 - ROOM_MM)) - filled)


def narrow_places(
    cuts: Sequence[tuple[float, Any]], gaps: bool, bound_mm: float, limit_mm: float = 0.0
) -> tuple[float | None, list[tuple[int, NarrowSpot]]]:
    """Return the smallest wall width (with `gaps`: gap width) in mm in the cuts, and places narrower than `limit_mm`.

    The width is None where none is below `bound_mm`, else right within half of a step of `bound_mm` / `WIDTH_STEPS`.
    With each place comes the index of its cut. A cut is looked at as a whole once, for the larger of the limit and the
    least width so far; smaller ones are looked for only where it is narrow.
    """
    step_mm = bound_mm / WIDTH_STEPS
    least = WIDTH_STEPS + 1
    places: list[tuple[int, NarrowSpot]] = []
    for index, cut in enumerate(cuts):
        low = 0
        high = least - 1
        _, part = _part_of(cut, gaps).narrower_than(max(high * step_mm, limit_mm))
        if limit_mm:
            spots, _ = part.narrower_than(limit_mm)
            places += [(index, spot) for spot in spots]
        if not high:
            continue
        spots, part = part.narrower_than(high * step_mm)
        if not spots:
            continue
        while high - low > 1:
            middle = (low + high) // 2
            spots, smaller = part.narrower_than(middle * step_mm)
            if spots:
                high = middle
                part = smaller
            else:
                low = middle
        least = high
    return None if least > WIDTH_STEPS else (least - 0.5) * step_mm, places


def longest_unsupported_span(solid: Any, mesh: Mesh, bound_mm: float) -> tuple[float, NarrowSpot | None]:
    """Return the longest span in mm that is printed over air, up to `bound_mm`, and its place.

    A horizontal face that looks down is bridged from the material beneath its rim. Its span is twice the largest
    distance from that material. The search stops at `bound_mm`.
    """
    low = high = 0.0
    where = None
    bed = float(mesh.vertices_mm[:, 2].min())
    for z in (height for height in _flat_heights_mm(mesh, up=False) if height > bed + 2 * STEP_MM):
        below = solid.slice(z - STEP_MM)
        hanging = _beyond(solid.slice(z + STEP_MM), below, high + STEP_MM)
        while (piece := _largest(hanging)).area() > AREA_MM2:
            # Material farther from the piece than half of the bound supports nothing of it.
            near = below ^ _boxes([piece], bound_mm / 2 + STEP_MM)
            low, high = _bisect(partial(_is_supported, piece, near), bound_mm)
            place = _beyond(piece, near, 0.9 * low)
            where = _where(place if place.area() else piece, z)
            hanging = _beyond(hanging - piece, below, high + STEP_MM)
    return (low + high) / 2, where


def _beyond(hanging: Any, below: Any, span_mm: float) -> Any:
    """Return the part of the cross-section `hanging` farther than `span_mm` / 2 from the material `below` it."""
    from manifold3d import JoinType

    return hanging - below.offset(span_mm / 2, JoinType.Round, 2.0, 64)


def _is_supported(hanging: Any, below: Any, span_mm: float) -> bool:
    return bool(_beyond(hanging, below, span_mm).area() <= AREA_MM2)


def _largest(shape: Any) -> Any:
    return shape if shape.is_empty() else max(shape.decompose(), key=lambda piece: piece.area())


def thin_skins(solid: Any, mesh: Mesh, limit_mm: float) -> list[NarrowSpot]:
    """Return the parts of horizontal faces that look up and have less than `limit_mm` of material beneath them."""
    skins = []
    for z in _flat_heights_mm(mesh, up=True):
        surface = solid.slice(z - STEP_MM) - solid.slice(z + STEP_MM)
        thin = surface - solid.slice(z - limit_mm + 2 * STEP_MM)
        skins += [_where(piece, z) for piece in thin.decompose() if piece.area() > limit_mm**2]
    return skins


def _flat_heights_mm(mesh: Mesh, up: bool) -> np.ndarray:
    """Return the heights of the horizontal faces that look up, or down, at most `MOST_HEIGHTS` of them."""
    corners = mesh.corners_mm
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = (np.ptp(corners[..., 2], axis=1) < STEP_MM) & ((normal[:, 2] > 0) == up)
    heights = np.unique(np.round(corners[flat][:, 0, 2] / STEP_MM) * STEP_MM)
    chosen = np.linspace(0, len(heights) - 1, MOST_HEIGHTS).round().astype(int)
    return np.asarray(heights[chosen] if len(heights) > MOST_HEIGHTS else heights)


def _where(shape: Any, z_mm: float) -> NarrowSpot:
    x0, y0, x1, y1 = shape.bounds()
    return NarrowSpot((x0 + x1) / 2, (y0 + y1) / 2, z_mm, float(shape.area()))


def _bisect(narrower: Callable[[float], bool], bound_mm: float) -> tuple[float, float]:
    """Return widths, 0.2 % of `bound_mm` apart, where `narrower` is false and true, or (`bound_mm`, `bound_mm`)."""
    if not narrower(bound_mm):
        return bound_mm, bound_mm
    low = 0.0
    high = bound_mm
    for _ in range(9):
        middle = (low + high) / 2
        low, high = (low, middle) if narrower(middle) else (middle, high)
    return low, high
