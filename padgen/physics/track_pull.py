"""Pull on a small magnet of a coil of straight tracks: by the forces on the tracks in the magnet's own field.

The field of a disc or ring magnet, with any steel on top of it, is axisymmetric, a sum of Bessel functions as in
`physics.magnet_pull`: with the spectrum of its energy `faces` it is at the radius ρ, a depth z below the magnet

    A_φ = ∫ faces J₁(kρ) exp(−kz) dk / 4π,   B_z = ∫ k faces J₀(kρ) exp(−kz) dk / 4π

per ampere of a coil's current. The energy of a loop is the line integral of A along it, its slope with a shift of the
magnet that of B_z. Both are tabulated over the radius, summed over the layers, and integrated along every loop. Far
from the coil its sides take few points.

SI units.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from math import asinh, ceil, pi
from typing import NamedTuple

import numpy as np

from padgen.physics.magnetics import BLOCK, RectangularWinding, gauss
from padgen.physics.magnets import bessel
from padgen.physics.rectangular_spiral import loop_segments

__all__ = ["MagnetWaves", "TrackPulls", "track_pulls"]

STEP = 0.02
"""Step of asinh(ρ/ρ₀) in the tables, ρ₀ being the smallest gap for which the spectrum holds."""
ALONG = 4
"""Gauss points on a piece of a side."""
PIECE = 2.0
"""Most length of a piece over the distance of the magnet from the tracks."""
TRACK_SHARE = np.array([0.004, 0.03])
"""Errors of forces and of slopes by tables and points, over those on the coil's axis."""


class MagnetWaves(NamedTuple):
    """A magnet's spectra: wave numbers k (K,) in 1/m, `faces` of its energy, `turned` of its moment, with weights.

    They hold for gaps of `least_gap` and more, at radii of up to `reach`, in m.
    """

    k: np.ndarray
    faces: np.ndarray
    turned: np.ndarray
    least_gap: float
    reach: float


class TrackPulls(NamedTuple):
    """Per ampere, at n places: `force` towards the coil in N, its `slope` with the gap, and sideways vectors (n, 2).

    `side` is the force in N along x and y; `lowering` in N m is the moment about the middle of the magnet's underside,
    as a vector along which the magnet is tilted down. `error` bounds that of the force, `slope_error` of the slope.
    """

    force: np.ndarray
    slope: np.ndarray
    side: np.ndarray
    lowering: np.ndarray
    error: np.ndarray
    slope_error: np.ndarray


class _Pieces(NamedTuple):
    """Tracks as straight pieces: starts (n, 2) and ways (n, 2) in m, and which of the sets of layers each lies on (n,).

    All but the innermost turns are closed loops; these lie where they are drawn. Tracks that all layers have are there
    once, on the first set, which is all layers.
    """

    start: np.ndarray
    way: np.ndarray
    lies_on: np.ndarray
    layers: tuple[tuple[int, ...], ...]


@lru_cache(maxsize=64)
def _pieces(windings: tuple[RectangularWinding, ...]) -> _Pieces:
    whole = [w.outlines[: w.parts.count(1.0) - 1] for w in windings]
    common = [loop for loop in whole[0] if all(loop in loops for loops in whole)]
    segments = [[loop_segments(loop) for loop in common]]
    for winding, loops in zip(windings, whole, strict=True):
        besides = [loop_segments(loop) for loop in loops if loop not in common]
        segments.append([*besides, np.array(list(pairwise(winding.inner)))])
    ends = np.concatenate([each for of_set in segments for each in of_set])
    lies_on = np.repeat(np.arange(len(segments)), [sum(map(len, of_set)) for of_set in segments])
    layers = (tuple(range(len(windings))), *((k,) for k in range(len(windings))))
    return _Pieces(ends[:, 0], ends[:, 1] - ends[:, 0], lies_on, layers)


def track_pulls(
    windings: tuple[RectangularWinding, ...],
    waves: MagnetWaves,
    gap: np.ndarray,
    place: np.ndarray,
    uneven: float = 0.0,
) -> TrackPulls:
    """Return pulls of a coil of straight tracks on a magnet `gap` (n,) m above it, at `place` (n, 2) m off its axis.

    `uneven` is the coil's `magnetics.CoilSource.uneven`, a further error.
    """
    pieces = _pieces(windings)
    outer = windings[0].outlines[0]
    heights, of_height = np.unique(gap, return_inverse=True)
    sets = [[windings[k] for k in layers] for layers in pieces.layers]
    tables = np.array([[_table(some, waves, height) for some in sets] for height in heights.tolist()])
    # After the places themselves, for the errors, those on the axis, one at each height.
    place = np.concatenate([place, np.zeros((len(heights), 2))])
    of_height = np.append(of_height.ravel(), np.arange(len(heights)))
    outside = np.hypot(*(np.maximum(np.abs(place) - (outer.x, outer.y), 0).T))
    # Places as far from the tracks, to a factor of two, share their points along the tracks.
    octave = np.floor(np.log2(np.hypot(outside, heights[of_height]) / heights[0]))
    result = np.zeros((6, len(place)))
    for step in np.unique(octave):
        alike = octave == step
        longest = PIECE * heights[0] * 2**step
        result[:, alike] = _along_tracks(pieces, tables, waves.least_gap, longest, place[alike], of_height[alike])
    on_axis = np.abs(result[:2, len(gap) :])[:, of_height[: len(gap)]]
    force, slope, side_x, side_y, low_x, low_y = result[:, : len(gap)]
    error, slope_error = (TRACK_SHARE[:, None] + uneven) * on_axis
    side = np.stack([side_x, side_y], -1)
    return TrackPulls(force, slope, side, np.stack([low_x, low_y], -1), error, slope_error)


@lru_cache(maxsize=16)
def _round_waves(k: bytes, least_gap: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return J₀(kρ) and J₁(kρ)/ρ (points, K) at even steps of asinh(ρ/`least_gap`) up to the radius `reach`."""
    wave = np.frombuffer(k)
    rho = least_gap * np.sinh(STEP * np.arange(ceil(asinh(reach / least_gap) / STEP) + 2))
    zeroth, first = bessel(rho[:, None] * wave, 1)
    first[0] = wave / 2
    first[1:] /= rho[1:, None]
    return zeroth, first


def _table(windings: Sequence[RectangularWinding], waves: MagnetWaves, gap: float) -> np.ndarray:
    """Return the integrands (points, 4): of the force and its slope, over ρ, and of side force and moment."""
    k = waves.k
    zeroth, first_over_rho = _round_waves(k.tobytes(), waves.least_gap, waves.reach)
    by_depth = np.zeros_like(k)
    for winding in windings:
        length = k * winding.length
        by_depth += winding.share * np.exp(k * (winding.top - gap)) * -np.expm1(-length) / length
    faces = waves.faces * by_depth / (4 * pi)
    across = first_over_rho @ np.stack([-k * faces, k * k * faces], -1)
    along = zeroth @ np.stack([k * faces, waves.turned * by_depth / (4 * pi)], -1)
    return np.concatenate([across, along], 1)


def _along_tracks(
    pieces: _Pieces, tables: np.ndarray, scale: float, longest: float, place: np.ndarray, of_height: np.ndarray
) -> np.ndarray:
    """Return the sums (6, n) along all tracks: force, slope, and side force and moment along x and y.

    `tables` (heights, sets of layers, points, 4) have `scale` as their ρ₀, `of_height` (n,) is which of the heights a
    place has. No piece of a side is longer than `longest` m.
    """
    count = np.ceil(np.hypot(*pieces.way.T) / longest).astype(int)
    at, weight = gauss(ALONG)
    of = np.repeat(np.arange(len(count)), count)
    first = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    share = (first[:, None] + at) / count[of][:, None]
    points = (pieces.start[of][:, None] + share[..., None] * pieces.way[of][:, None]).reshape(-1, 2)
    step = ((weight / count[of][:, None])[..., None] * pieces.way[of][:, None]).reshape(-1, 2)
    rows = tables.reshape(-1, tables.shape[-1])
    row = np.repeat(pieces.lies_on[of], ALONG) * tables.shape[2]
    row_of_place = of_height * tables.shape[1] * tables.shape[2]
    sums = np.empty((6, len(place)))
    some = max(BLOCK // len(points), 1)
    for begin in range(0, len(place), some):
        block = slice(begin, begin + some)
        x, y = np.moveaxis(points - place[block, None], -1, 0)
        steps = np.arcsinh(np.hypot(x, y) / scale) / STEP
        low = steps.astype(int)
        at_row = low + row + row_of_place[block, None]
        below = rows[at_row]
        values = below + (steps - low)[..., None] * (rows[at_row + 1] - below)
        lever = x * step[:, 1] - y * step[:, 0]
        sums[:2, block] = np.einsum("npk,np->kn", values[..., :2], lever)
        along_x, along_y = np.einsum("npk,pj->jkn", values[..., 2:], step)
        sums[2:, block] = along_y[0], -along_x[0], -along_y[1], along_x[1]
    return sums
