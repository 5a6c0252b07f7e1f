"""Rectangular spirals of straight tracks, corners cut outside: their way, resistance and inductance.

A loop is given by how far its sides lie from the axis: those across x, those across y, and the cuts of its corners,
which lie at 45° and are absent where the sides meet before. A spiral's side lies an eighth of a pitch farther out than
the one before it; turns are a pitch apart on all sides.

The inductance is a sum over straight pieces: of parallel ones in closed form (Grover, Inductance Calculations, 1946,
ch. 7), with the mean distance of near tracks' sections from each other; of a side and a cut in closed form along the
side, and by Gauss points along the cut; of pieces at right angles it is 0.

SI units; seen from above, axes along the sides.
"""

from functools import lru_cache
from itertools import pairwise
from math import ceil, pi
from typing import NamedTuple

import numpy as np

from padgen.physics.magnetics import EIGHTHS, MU_0, LoopSides, gauss

__all__ = [
    "Loops",
    "inductance_of_loops",
    "loop_segments",
    "loops_between",
    "spiral_path",
    "squares_saved",
    "turn_inside",
]


NO_CUT = 1e-12
"""Depth in m of a corner's cut up to which there is none: rounding."""


def _crossing(one: tuple[int, float], other: tuple[int, float]) -> tuple[float, float]:
    """Return where two lines cross, each given by its direction in eighths of a turn and its distance from the axis."""
    ax, ay = EIGHTHS[one[0] % 8]
    bx, by = EIGHTHS[other[0] % 8]
    turning = ax * by - ay * bx
    return (one[1] * by - other[1] * ay) / turning, (ax * other[1] - bx * one[1]) / turning


def _is_cut(before: tuple[int, float], cut: tuple[int, float], after: tuple[int, float]) -> bool:
    """Return whether a cut takes something off the corner of the two sides beside it."""
    x, y = _crossing(before, after)
    along = EIGHTHS[cut[0] % 8]
    return along[0] * x + along[1] * y > cut[1] + NO_CUT


@lru_cache(maxsize=256)
def spiral_path(outer: LoopSides, pitch: float, start: int, turns: float, sense: int) -> np.ndarray:
    """Return the corners (n, 2) in m of a spiral's middle line, from its inner end outwards.

    It starts in the middle of the side in direction `start` and ends on `outer` after `turns`, in the middle of a side
    or a cut; both in eighths of a turn, so that `turns` is a multiple of 1/8. `sense` is 1 counterclockwise.
    """
    count = round(8 * turns)

    def line(k: int) -> tuple[int, float]:
        at = start + sense * k
        return at, outer.inside((count - k) / 8 * pitch).distance(at)

    lines = []
    for k in range(count + 1):
        eighth, distance = line(k)
        if eighth % 2 == 0 or k == count or _is_cut(line(k - 1), (eighth, distance), line(k + 1)):
            lines.append((eighth, distance))
    last = lines[-1]
    corners = [_foot(lines[0]), *(_crossing(a, b) for a, b in pairwise(lines))]
    if last[0] % 2:
        # The middle of the cut: between the side before it and the one that would follow.
        x, y = _crossing(last, line(count + 1))
        corners.append(((corners[-1][0] + x) / 2, (corners[-1][1] + y) / 2))
    else:
        corners.append(_foot(last))
    return np.array(corners)


def _foot(line: tuple[int, float]) -> tuple[float, float]:
    x, y = EIGHTHS[line[0] % 8]
    return line[1] * x, line[1] * y


SQUARES_SAVED = {90: 0.441, 45: 0.089}
"""Squares of track by which a bend's resistance is less than its middle line's, by its angle in degrees.

By finite elements of even sheets; of a right angle it is the textbook's 0.56 squares for the corner's one."""


def squares_saved(path: np.ndarray) -> float:
    """Return the squares by which a track along `path` (n, 2) resists less than its middle line does, for its bends."""
    step = np.diff(path, axis=0)
    angle = np.degrees(np.abs(np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0])))))
    return sum(squares * int(np.isclose(angle, bend).sum()) for bend, squares in SQUARES_SAVED.items())


class Loops(NamedTuple):
    """Closed loops that stand for the turns of a spiral: their outlines, and of each the part that is there."""

    outlines: tuple[LoopSides, ...]
    parts: tuple[float, ...]


def turn_inside(end: int, sense: int) -> LoopSides:
    """Return how far inside its end a spiral's last turn lies on the mean, in pitches: sides across x and y, and cuts.

    `end` is the direction of its end in eighths of a turn. Each of the eight sides and cuts lies an eighth of a pitch
    inside the next; that in which the spiral ends is there twice, with half its length.
    """
    inside = [0.5 if eighth == end % 8 else (sense * (end - eighth)) % 8 / 8 for eighth in range(8)]
    return LoopSides((inside[0] + inside[4]) / 2, (inside[2] + inside[6]) / 2, sum(inside[1::2]) / 4)


def loops_between(outer: LoopSides, pitch: float, turns: float, inside: LoopSides) -> Loops:
    """Return the loops of a spiral that ends on `outer`, from the outside: whole turns, then the rest as a part.

    `inside` is how far inside its end a turn lies on the mean, in pitches (`turn_inside`).
    """
    parts = [min(turns - k, 1.0) for k in range(ceil(turns - 1e-9))]
    mean = LoopSides(*(distance - pitch * share for distance, share in zip(outer, inside, strict=True)))
    outlines = (mean.inside((k + (part - 1) / 2) * pitch) for k, part in enumerate(parts))
    return Loops(tuple(outlines), tuple(parts))


def loop_segments(outline: LoopSides) -> np.ndarray:
    """Return the sides and cuts of a loop, counterclockwise: start and end points (n, 2, 2) in m."""
    lines = [(k, outline.distance(k)) for k in range(8)]
    kept = [line for k, line in enumerate(lines) if k % 2 == 0 or _is_cut(lines[k - 1], line, lines[(k + 1) % 8])]
    corners = [_crossing(a, b) for a, b in zip([kept[-1], *kept], kept, strict=False)]
    return np.array([[a, b] for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)])


NEAR_TRACKS = 4.0
"""Distance of two tracks over their width from which on they count as thin."""
ACROSS = 3
"""Gauss points across each of two near tracks, and along a cut."""


def inductance_of_loops(
    segments: np.ndarray, depth: np.ndarray, flow: np.ndarray, track: tuple[float, np.ndarray]
) -> float:
    """Return the inductance in H of loops, given as straight pieces, per square of the coil's current.

    `segments` (n, 2, 2) are their start and end points in m, `depth` (n,) in m; `flow` (n,) is each one's current over
    the coil's, times the part of its turn that is there. `track` is the width of all and the thickness of each (n,).
    """
    way = segments[:, 1] - segments[:, 0]
    eighth = np.round(np.arctan2(way[:, 1], way[:, 0]) * 4 / pi).astype(int) % 8
    total = 0.0
    for direction in range(4):
        alike = eighth % 4 == direction
        total += _parallel(segments[alike], direction, depth[alike], flow[alike], track[0], track[1][alike])
        for beside in (direction + 1, direction - 1) if direction % 2 else ():
            sides = eighth % 4 == beside % 4
            total += _aslant(
                (segments[alike], depth[alike], flow[alike]), (segments[sides], depth[sides], flow[sides]), beside
            )
    return float(MU_0 / (4 * pi) * total)


def _parallel(
    segments: np.ndarray, direction: int, depth: np.ndarray, flow: np.ndarray, width: float, thickness: np.ndarray
) -> float:
    """Return ∬ dl·dl'/r in m between all pieces of one direction, times their currents."""
    if not len(segments):
        return 0.0
    x, y = EIGHTHS[direction]
    along = segments @ (x, y)
    aside = segments[:, 0] @ (-y, x)
    apart = np.subtract.outer(aside, aside)
    lower = np.subtract.outer(depth, depth)
    distance = np.hypot(apart, lower)
    near = distance < NEAR_TRACKS * width
    at, weight = gauss(ACROSS)
    shift = width * np.subtract.outer(at, at).ravel()
    share = np.multiply.outer(weight, weight).ravel()
    square = (apart[near][:, None] + shift) ** 2 + lower[near][:, None] ** 2
    distance[near] = np.exp((np.log(np.maximum(square, (1e-3 * width) ** 2)) / 2) @ share)
    # The mean distance of a rectangular section from itself (Grover).
    np.fill_diagonal(distance, 0.2235 * (width + thickness))
    start, end = along.T
    total = sum(
        sign * _antiderivative(np.subtract.outer(one, other), distance)
        for one, other, sign in ((end, start, 1), (start, start, -1), (end, end, -1), (start, end, 1))
    )
    return float(flow @ total @ flow)


def _antiderivative(along: np.ndarray, distance: np.ndarray) -> np.ndarray:
    return np.asarray(along * np.arcsinh(along / distance) - np.hypot(along, distance))


def _aslant(cuts: tuple[np.ndarray, ...], sides: tuple[np.ndarray, ...], direction: int) -> float:
    """Return twice ∬ dl·dl'/r in m between cuts and sides of one direction, times their currents."""
    (cut, cut_depth, cut_flow), (side, side_depth, side_flow) = cuts, sides
    if not len(cut) or not len(side):
        return 0.0
    x, y = EIGHTHS[direction % 8]
    at, weight = gauss(2 * ACROSS)
    way = cut[:, 1] - cut[:, 0]
    points = cut[:, 0, None] + way[:, None] * at[:, None]
    aside = np.abs((points @ (-y, x))[..., None] - side[:, 0] @ (-y, x))
    distance = np.maximum(np.hypot(aside, np.subtract.outer(cut_depth, side_depth)[:, None]), 1e-9)
    start, end = ((side[:, k] @ (x, y)) - (points @ (x, y))[..., None] for k in (0, 1))
    line = np.arcsinh(end / distance) - np.arcsinh(start / distance)
    of_cut = np.einsum("ijk,j->ik", line, weight) * (way @ (x, y))[:, None]
    return float(2 * cut_flow @ of_cut @ side_flow)
