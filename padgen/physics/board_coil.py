"""A coil of spirals on the layers of a printed circuit board: its turns, resistance, inductance and field.

Layers are taken in pairs. Of a pair in series the current comes in on the upper layer's outside, goes round inwards,
down a via in the bore, and round outwards on the lower layer in the same sense, then by a via beside the coil to the
next pair. In parallel all upper layers of the pairs lead inwards together, one via in the bore joins all layers, and
all lower layers lead outwards together.

Resistances are those of the tracks' cross-section at 20 °C, of links and of plated holes. The inductance is a sum over
circular turns of mutual inductances by Maxwell's formula, ``M = μ₀ √(ab) Q_½(1 + ε)`` (Q as in `physics.magnetics`),
each turn as `FILAMENTS` filaments across its track; a turn's own is ``μ₀ r (ln 8r/g − 2)`` with the mean distance
g = 0.2235 (w + t) of its section from itself (Grover, Inductance Calculations, 1946). Up to some ten kHz the current
fills such tracks evenly: at 5 kHz the skin is 0.9 mm deep.

Rectangular spirals are straight tracks (`physics.rectangular_spiral`), with their corners cut to leave room for the
vias beside them. Their bore vias lie in the directions of the sides.

SI units. Heights are over the board's top copper; the solder mask is left out.
"""

from functools import lru_cache
from math import ceil, floor, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from padgen.core.units import COPPER_OHM_M
from padgen.physics.magnetics import BLOCK, MU_0, CoilSource, LoopSides, RectangularWinding, Winding, gauss, toroidal
from padgen.physics.rectangular_spiral import (
    Loops,
    inductance_of_loops,
    loop_segments,
    loops_between,
    spiral_path,
    squares_saved,
    turn_inside,
)

__all__ = [
    "LAMINATE_ACROSS_W_PER_M_K",
    "LAMINATE_J_PER_M3_K",
    "LAMINATE_KG_PER_M3",
    "LAMINATE_W_PER_M_K",
    "BoardCoil",
    "BoardLayer",
    "board_layers",
    "board_source",
    "bore_needed",
    "corner_leg",
    "ends_at_via",
    "heat_limit",
    "inductance",
    "layer_current_shares",
    "layer_resistances",
    "rectangle_path",
    "resistance",
    "rings_of",
    "side_via",
]

LAMINATE_KG_PER_M3 = 1850.0
"""Density of glass-epoxy laminate (FR-4): data sheets give 1.8 to 1.9 g/cm³."""
LAMINATE_W_PER_M_K = 0.81
LAMINATE_ACROSS_W_PER_M_K = 0.29
"""Conductivity of glass-epoxy along the board and across it (Azar and Graebner, SEMI-THERM 1996)."""
LAMINATE_J_PER_M3_K = 2.0e6
"""Heat that laminate takes up: 1850 kg/m³ times some 1100 J/(kg K)."""
FILAMENTS = 3
"""Filaments across a track, at Gauss points: of two tracks face to face on either side of a thin prepreg this leaves
less than a hundredth of their mutual inductance."""
OPEN_SHARE = 0.4
"""Own inductance of a short part of a turn over that part of its circle's: within 0.1 % of a spiral's of 5 turns and
more, 1.4 % of one of two and a half."""
LINK_DEGREES = (135.0, 225.0, 45.0, 315.0)
"""Angles of the vias beside a coil in series, in the corners of its cell; its ends lie at 0°."""
END_DEGREES = (45.0, 315.0)
"""Angles of the vias beside a coil in parallel, which are its two ends."""


class BoardCoil(NamedTuple):
    """Sizes of a board coil in m: the outside of its widest turn, its bore, tracks, vias and layers.

    `copper` is the thickness of each layer from the top, `depth` the distance of each layer's upper face from that of
    the first. `parallel` is true for pairs of layers in parallel. `outer_depth` is 0 for round coils; of rectangular
    ones it is the size along y, and `outer_diameter` that along x.
    """

    outer_diameter: float
    inner_diameter: float
    track: float
    space: float
    drill: float
    via: float
    plating: float
    copper: tuple[float, ...]
    depth: tuple[float, ...]
    parallel: bool
    outer_depth: float = 0.0

    @property
    def is_round(self) -> bool:
        """True for round spirals, false for rectangular ones."""
        return not self.outer_depth

    @property
    def narrower(self) -> float:
        """The lesser of the coil's sizes along x and y in m."""
        return self.outer_diameter if self.is_round else min(self.outer_diameter, self.outer_depth)

    @property
    def outline(self) -> LoopSides:
        """Outside of a rectangular coil: its corners are cut so far that the vias beside it fit into them."""
        x = self.outer_diameter / 2
        y = self.outer_depth / 2
        return LoopSides(x, y, (x + y - corner_leg(self)) / sqrt(2))

    @property
    def pitch(self) -> float:
        """Distance in m from turn to turn."""
        return self.track + self.space

    @property
    def bore_vias(self) -> int:
        """Number of vias in the bore."""
        return 1 if self.parallel else len(self.copper) // 2

    @property
    def bore_via_radius(self) -> float:
        """Distance in m from the coil's axis to the vias in its bore, packed as the board house allows."""
        places = self.bore_vias if self.is_round or self.bore_vias < 3 else 4
        return 0.0 if places == 1 else (self.via + self.space) / (2 * sin(pi / places))

    @property
    def side_via_radius(self) -> float:
        """Distance in m from the axis of a round coil to the vias beside it."""
        return self.outer_diameter / 2 + self.space + self.via / 2

    @property
    def length(self) -> float:
        """Length in m of a hole through all layers."""
        return self.depth[-1] + self.copper[-1]


class BoardLayer(NamedTuple):
    """The spiral of one layer: radius and angle of its inner end, turns, sense, and angle of its outer end.

    The middle of the track leaves `start_radius` in m at `start_angle` and widens by a pitch a turn over `turns`,
    counterclockwise with `sense` 1, seen from above. `end_angle` is where it ends; angles in rad.
    """

    start_radius: float
    start_angle: float
    turns: float
    sense: int
    end_angle: float


def bore_needed(coil: BoardCoil) -> float:
    """Return the smallest diameter in m of a bore that has room for the vias."""
    return 2 * (coil.bore_via_radius + coil.via / 2 + coil.space)


def corner_leg(coil: BoardCoil) -> float:
    """Return by how much in m, along each side, the corners of a rectangular coil are cut: room for a via."""
    return coil.via + sqrt(2) * (coil.via / 2 + coil.space)


RECTANGLE_STARTS = (pi, 0.0, pi / 2, 3 * pi / 2)
"""Angles of the vias in the bore of a rectangular coil, pair by pair of layers."""


def board_layers(coil: BoardCoil) -> tuple[BoardLayer, ...]:
    """Return the spirals from the top layer down; a layer has no turns where there is no room for one."""
    room = (coil.narrower - coil.inner_diameter) / 2 - coil.track
    layers = []
    for k in range(len(coil.copper)):
        pair = 0 if coil.parallel else k // 2
        start = 2 * pi * pair / coil.bore_vias + pi if coil.is_round else RECTANGLE_STARTS[pair]
        end = _end_angle(coil, k)
        sense = -1 if k % 2 == 0 else 1
        # As many turns as there is room for, so that the track ends at that angle.
        rest = round(sense * (end - start) / (2 * pi), 9) % 1.0
        turns = floor(room / coil.pitch - rest + 1e-9) + rest
        layers.append(BoardLayer(coil.inner_diameter / 2 + coil.track / 2, start, max(turns, 0.0), sense, end))
    return tuple(layers)


def _end_angle(coil: BoardCoil, layer: int) -> float:
    """Return the angle in rad at which the spiral of a layer ends, outside."""
    if coil.parallel:
        return END_DEGREES[layer % 2] * pi / 180
    if layer in (0, len(coil.copper) - 1):
        return 0.0
    return LINK_DEGREES[(layer - 1) // 2] * pi / 180


def layer_current_shares(coil: BoardCoil) -> np.ndarray:
    """Return each layer's share of the coil's current: 1 in series; in parallel, in proportion to its conductance."""
    count = len(coil.copper)
    if not coil.parallel:
        return np.ones(count)
    conductance = 1 / np.array(layer_resistances(coil))
    share = np.empty(count)
    for side in (slice(0, None, 2), slice(1, None, 2)):
        share[side] = conductance[side] / conductance[side].sum()
    return share


def ends_at_via(coil: BoardCoil, layer: int) -> bool:
    """Return whether the spiral of a layer ends at a via beside the coil; others end at the coil's ends."""
    return coil.parallel or 0 < layer < len(coil.copper) - 1


def rectangle_path(coil: BoardCoil, layer: BoardLayer) -> np.ndarray:
    """Return the corners (n, 2) in m of the middle of a rectangular spiral's track, from the inside out."""
    outer = coil.outline.inside(coil.track / 2)
    return spiral_path(outer, coil.pitch, round(layer.start_angle * 4 / pi), layer.turns, layer.sense)


def side_via(coil: BoardCoil, angle: float) -> tuple[float, float]:
    """Return where in m from the axis the via beside a coil lies in a direction; of rectangular coils, in a corner."""
    x, y = np.cos(angle), np.sin(angle)
    if coil.is_round:
        return float(coil.side_via_radius * x), float(coil.side_via_radius * y)
    half = coil.via / 2
    return float(np.copysign(coil.outer_diameter / 2 - half, x)), float(np.copysign(coil.outer_depth / 2 - half, y))


def _track_length(coil: BoardCoil, k: int, layer: BoardLayer) -> float:
    """Return the length in m of a straight track that resists as much as layer `k`'s spiral with its links to vias."""
    if coil.is_round:
        spiral = 2 * pi * layer.turns * (layer.start_radius + layer.turns * coil.pitch / 2)
        inwards = layer.start_radius - coil.bore_via_radius
        outwards = coil.side_via_radius - layer.start_radius - layer.turns * coil.pitch
        return spiral + inwards + (outwards if ends_at_via(coil, k) else 0.0)
    path = rectangle_path(coil, layer)
    spiral = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) - squares_saved(path) * coil.track
    inwards = float(np.hypot(*path[0])) - coil.bore_via_radius
    outwards = float(np.hypot(*(path[-1] - side_via(coil, layer.end_angle))))
    return spiral + inwards + (outwards if ends_at_via(coil, k) else 0.0)


def layer_resistances(coil: BoardCoil) -> list[float]:
    """Return the resistance in Ω at 20 °C of each layer's spiral, with its links to the vias."""
    layers = enumerate(zip(board_layers(coil), coil.copper, strict=True))
    return [COPPER_OHM_M * _track_length(coil, k, layer) / (coil.track * copper) for k, (layer, copper) in layers]


def resistance(coil: BoardCoil) -> float:
    """Return the resistance in Ω at 20 °C, from end to end of the coil, without the tracks that lead to it."""
    barrel = pi * (coil.drill - coil.plating) * coil.plating
    of_layers = np.array(layer_resistances(coil))
    if coil.parallel:
        # The via in the bore carries all current over most of its length: a bound.
        through = COPPER_OHM_M * coil.length / barrel
        return float(1 / (1 / of_layers[::2]).sum() + 1 / (1 / of_layers[1::2]).sum()) + through
    falls = [coil.depth[k + 1] - coil.depth[k] for k in range(len(coil.depth) - 1)]
    return float(of_layers.sum()) + COPPER_OHM_M * sum(falls) / barrel


class Rings(NamedTuple):
    """Circles that stand for turns: radius, depth and thickness in m, part of a turn, share of the current.

    `depth` is that of the track's middle.
    """

    radius: np.ndarray
    depth: np.ndarray
    thickness: np.ndarray
    turns: np.ndarray
    current: np.ndarray


def rings_of(coil: BoardCoil) -> Rings:
    """Return all turns of a coil as circles: whole turns, and the rest of each layer as a part of a turn."""
    share = layer_current_shares(coil)
    rows = []
    for k, layer in enumerate(board_layers(coil)):
        for j in range(ceil(layer.turns)):
            part = min(layer.turns - j, 1.0)
            radius = layer.start_radius + (j + part / 2) * coil.pitch
            rows.append((radius, coil.depth[k] + coil.copper[k] / 2, coil.copper[k], part, share[k]))
    return Rings(*np.array(rows).T)


@lru_cache(maxsize=64)
def inductance(coil: BoardCoil) -> float:
    """Return the inductance in H of a board coil at low frequencies, with currents by `layer_current_shares`."""
    if not coil.is_round:
        return _inductance_of_rectangles(coil)
    rings = rings_of(coil)
    at, weight = gauss(FILAMENTS)
    across = coil.track * (at - 0.5)
    radius = (rings.radius[:, None] + across).ravel()
    depth = np.repeat(rings.depth, FILAMENTS)
    flow = ((rings.turns * rings.current)[:, None] * weight).ravel()
    turn = np.repeat(np.arange(len(rings.radius)), FILAMENTS)
    between = 0.0
    step = max(BLOCK // len(turn), 1)
    for start in range(0, len(turn), step):
        some = slice(start, start + step)
        beyond = slice(start, None)  # each pair of turns once
        product = np.multiply.outer(radius[some], radius[beyond])
        square = (
            np.subtract.outer(radius[some], radius[beyond]) ** 2 + np.subtract.outer(depth[some], depth[beyond]) ** 2
        )
        is_later = turn[some, None] < turn[beyond]
        mutual = np.sqrt(product) * toroidal(np.where(is_later, square / (2 * product), 1.0), 1)[1]
        between += 2 * MU_0 * float(flow[some] @ np.where(is_later, mutual, 0.0) @ flow[beyond])
    mean_distance = 0.2235 * (coil.track + rings.thickness)
    # What an open part of a turn has of its circle's own inductance, by sums over the filaments of spirals.
    part = rings.turns * (OPEN_SHARE + (1 - OPEN_SHARE) * rings.turns)
    alone = MU_0 * rings.radius * (np.log(8 * rings.radius / mean_distance) - 2) * part * rings.current**2
    return between + float(alone.sum())


def _loops_of(coil: BoardCoil, layer: BoardLayer) -> Loops:
    """Return the loops that stand for a layer's turns: where those of all layers lie on the mean."""
    ends = [(round(each.end_angle * 4 / pi), each.sense) for each in board_layers(coil)]
    inside = LoopSides(*np.mean([turn_inside(*end) for end in ends], axis=0).tolist())
    return loops_between(coil.outline.inside(coil.track / 2), coil.pitch, layer.turns, inside)


def _inductance_of_rectangles(coil: BoardCoil) -> float:
    share = layer_current_shares(coil)
    segments = []
    of_layer = []
    flow = []
    for k, layer in enumerate(board_layers(coil)):
        loops = _loops_of(coil, layer)
        for outline, part in zip(loops.outlines, loops.parts, strict=True):
            pieces = loop_segments(outline)
            segments.append(pieces)
            of_layer += [k] * len(pieces)
            flow += [part * share[k]] * len(pieces)
    thickness = np.array(coil.copper)
    depth = np.array(coil.depth) + thickness / 2
    tracks = coil.track, thickness[of_layer]
    return inductance_of_loops(np.concatenate(segments), depth[of_layer], np.array(flow), tracks)


def board_source(coil: BoardCoil) -> CoilSource:
    """Return the coil as one flat winding per layer.

    A round one is uniform, a model valid from some track pitches away on; a rectangular one has its turns as loops.
    """
    share = layer_current_shares(coil)
    windings = []
    tracks = []
    for k, layer in enumerate(board_layers(coil)):
        top = -coil.depth[k]
        bottom = top - coil.copper[k]
        if coil.is_round:
            inner = 2 * layer.start_radius
            outer = inner + 2 * layer.turns * coil.pitch
            windings.append(Winding(outer, inner, top, bottom, layer.turns * float(share[k])))
        else:
            loops = _loops_of(coil, layer)
            innermost = _innermost(coil, layer)
            tracks.append(RectangularWinding(loops.outlines, loops.parts, innermost, float(share[k]), top, bottom))
    return CoilSource(tuple(windings), tracks=tuple(tracks), uneven=UNEVEN * coil.pitch / coil.narrower)


UNEVEN = 0.9
"""Bound on how far off a coil's axis the pull of its drawn tracks differs from that of closed turns: over the pull on
the axis, and over pitch by size (of 80 random coils of both shapes the median has 0.3, docs/boards.md)."""


def _innermost(coil: BoardCoil, layer: BoardLayer) -> tuple[tuple[float, float], ...]:
    """Return the corners of a rectangular spiral's innermost turn and what it has inside, counterclockwise."""
    whole = floor(layer.turns) - 1
    start = round(layer.start_angle * 4 / pi)
    outer = coil.outline.inside(coil.track / 2 + whole * coil.pitch)
    path = spiral_path(outer, coil.pitch, start, layer.turns - whole, layer.sense)
    return tuple((float(x), float(y)) for x, y in path[:: layer.sense])


RISE_K = 40.0
"""Rise of a board coil's copper over the air that its heat limit allows: 60 °C in a room."""
AIR_W_PER_M2K = 10.0
"""Heat that flows off each face of a board into still air (Incropera et al., 7th ed. 2011, table 1.1: 2 to 25)."""
MIL_M = 25.4e-6
IPC_INNER = 0.024


def heat_limit(coil: BoardCoil) -> float:
    """Return the heat in W that a board coil bears for long: the lower of two rules for a rise of `RISE_K`.

    Its two faces give off ``2 h A ΔT``, what the board around it takes being left out; no track carries more than
    ``I = 0.024 ΔT^0.44 A^0.725`` (IPC-2221, inner layers; A in square mils), a rule for tracks by themselves.
    """
    faces = 2 * (pi / 4 * coil.outer_diameter**2 if coil.is_round else coil.outline.area)
    given_off = AIR_W_PER_M2K * faces * RISE_K
    most = IPC_INNER * RISE_K**0.44 * (np.array(coil.copper) * coil.track / MIL_M**2) ** 0.725
    current = float((most / layer_current_shares(coil)).min())
    return float(min(given_off, current**2 * resistance(coil)))
