"""Cut the path of a bent beam, straight pieces and arcs in one plane, into slices for integrals along it.

Places and directions are in the axes of the tip: x along the path there, away from the root, y to the left. An integral
from the root to a slice is that of the polynomial through the Gauss points of each piece.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

__all__ = ["SHORTEST_M", "Slices", "columns", "matrices", "sliced", "within_side", "within_up"]

Array = Any
SHORTEST_M = 1e-12
"""Smallest length in divisions, for pieces of length 0 such as corners."""
_NO_PIECE = 0.0, 0.0, np.inf
"""Length, curvature and straight length at root and tip."""


class Slices(NamedTuple):
    """Slices of a bent beam, from its root to its tip.

    `x` and `y` (…, k) in m are places from the tip, `cosine` and `sine` (…, k) directions, both in beam axes; `width`
    (…, k) in m; `share` (…, k) is the length in m of the slice's piece. `curved` (…, k) is the width over twice the
    radius, `straight` (…, k) the length in m of a straight piece, else inf. `running` (k, k) is the matrix of sums from
    the root to each slice.
    """

    x: Array
    y: Array
    cosine: Array
    sine: Array
    width: Array
    share: Array
    curved: Array
    straight: Array
    running: np.ndarray


def sliced(path: Sequence[tuple[Array, Array]], width: Array, fillet: Array) -> Slices:
    """Return slices at the Gauss points of every piece of a path, enough for its turn, and at root and tip.

    `path` holds length in m and turn (left positive) of each piece. The `width` flares at the root by two quarter
    circles of radius `fillet`, on the first piece.
    """
    width, fillet = np.asarray(width, float), np.asarray(fillet, float)
    pieces = [(np.asarray(length, float), np.asarray(turn, float), 0.0 * fillet) for length, turn in path]
    if (fillet > 0).any():
        pieces[:1] = [(fillet, 0.0 * fillet, fillet), (pieces[0][0] - fillet, pieces[0][1], 0.0 * fillet)]
    places: list[list[Array]] = [[0.0 * width, 0.0 * width, 0.0 * width, width + 2 * fillet, *_NO_PIECE]]
    x, y, heading = (0.0 * width for _ in range(3))
    counts = []
    for length, turn, flare in pieces:
        counts.append(4 + int(np.ceil(2 * np.abs(turn).max())))
        share, _ = _gauss(counts[-1])
        piece = length, np.abs(turn) * width / (2 * np.maximum(length, SHORTEST_M)), np.where(turn, np.inf, length)
        for at in (*share, 1.0):
            half = turn * at / 2
            chord = length * at * np.sinc(half / np.pi)
            flared = 2 * (flare - np.sqrt(np.maximum(flare**2 - np.maximum(flare - length * at, 0) ** 2, 0)))
            across = x + chord * np.cos(heading + half), y + chord * np.sin(heading + half)
            places.append([*across, heading + turn * at, width + flared, *piece])
        x, y, heading = places.pop()[:3]
    places.append([x, y, heading, width, *_NO_PIECE])
    shape = np.broadcast_shapes(*(np.shape(value) for place in places for value in place))
    whole = np.array([[np.broadcast_to(value, shape) for value in place] for place in places])
    x, y, heading, wide, share, curved, straight = np.moveaxis(whole, 0, -1)
    # Turn from the root's axes to the tip's.
    turned = heading[..., -1:]
    x, y = x - x[..., -1:], y - y[..., -1:]
    x, y = np.cos(turned) * x + np.sin(turned) * y, np.cos(turned) * y - np.sin(turned) * x
    return Slices(
        x, y, np.cos(heading - turned), np.sin(heading - turned), wide, share, curved, straight, _running(tuple(counts))
    )


def within_up(slices: Slices) -> np.ndarray:
    """Return shear force, twist and bending moment at each slice per unit load on the tip: up, about x, about y."""
    x, y, cosine, sine, zero = slices.x, slices.y, slices.cosine, slices.sine, 0.0 * slices.x
    twist, bending = [sine * x - cosine * y, cosine, sine], [cosine * x + sine * y, -sine, cosine]
    return matrices([1 + zero, zero, zero], twist, bending)


def within_side(slices: Slices) -> np.ndarray:
    """Return pull, shear force and bending moment at each slice per unit load on the tip: along, sideways, about z."""
    x, y, cosine, sine, zero = slices.x, slices.y, slices.cosine, slices.sine, 0.0 * slices.x
    return matrices([cosine, sine, zero], [-sine, cosine, zero], [y, -x, 1 + zero])


def matrices(*rows: list[Array]) -> np.ndarray:
    """Return small matrices, one per slice, from their rows of entries (…, k)."""
    return np.stack([columns(row) for row in rows], -2)


def columns(values: list[Array]) -> np.ndarray:
    """Return arrays or numbers side by side along a new last axis."""
    return np.stack(np.broadcast_arrays(*values), -1)


@cache
def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss points (k,) in 0 … 1, and the matrix (k + 1, k) from values there to integrals to each and to 1."""
    nodes, _ = np.polynomial.legendre.leggauss(count)
    share = (nodes + 1) / 2
    legendre = np.polynomial.legendre.Legendre
    basis = np.linalg.inv(np.polynomial.legendre.legvander(nodes, count - 1))
    integrals = [legendre.basis(n).integ(lbnd=-1)(np.append(nodes, 1.0)) / 2 for n in range(count)]
    return share, np.array(integrals).T @ basis


@cache
def _running(counts: tuple[int, ...]) -> np.ndarray:
    """Return the matrix of sums from the root to each slice, for pieces of `counts` Gauss points.

    The slices at root and tip have no weight.
    """
    size, first = sum(counts) + 2, 1
    matrix = np.zeros((size, size))
    for count in counts:
        _, integrals = _gauss(count)
        own = slice(first, first + count)
        matrix[own, own] = integrals[:-1]
        matrix[first + count :, own] = integrals[-1]
        first += count
    return matrix
