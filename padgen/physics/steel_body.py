"""Surface charge of a linear steel body of revolution in a potential from outside.

With u the potential from outside, φ that of the surface's own charge σ, and χ the susceptibility,

    φ = −(1/χ + ½ + K)⁻¹ (½ + K) u,   σ = S⁻¹ φ

where S and K are the single and the double layer potentials on the surface (Kress, *Linear Integral Equations*, ch. 6;
Jackson, *Classical Electrodynamics*, 5.9). Round the axis everything is expanded in orders cos mφ, which do not couple;
along the meridian in polynomials on each side of the outline, of a variable that crowds at edges as the charge does.
"""

from collections.abc import Sequence
from math import ceil, pi
from typing import NamedTuple

import numpy as np

from padgen.physics.ring_charges import gauss, ring_potential

__all__ = ["Side", "SteelBody", "crowded", "cylinder", "eights", "fine_rings", "steel_body", "tube"]

POINTS_ABOVE = 16
"""Quadrature points on either side of a singularity, in addition to a side's number of nodes."""


class Side(NamedTuple):
    """A straight side of the outline, (r, z) in m from `start` to `end`, with its outward `normal`.

    `nodes` is the number of unknowns. With `on_axis` the start lies on the axis and is no edge of the body.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    normal: tuple[int, int]
    nodes: int
    on_axis: bool = False

    @property
    def length(self) -> float:
        """Length of the side in m."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    def part(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the share of the length at t in 0 … 1, and its slope over t; equal steps of t crowd at edges."""
        return (1 - (1 - t) ** 2, 2 * (1 - t)) if self.on_axis else (t * t * (3 - 2 * t), 6 * t * (1 - t))

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return radius and height in m at t in 0 … 1."""
        share, (r, z), (r1, z1) = self.part(t)[0], self.start, self.end
        return r + share * (r1 - r), z + share * (z1 - z)


class SteelBody(NamedTuple):
    """A body by its nodes (n,): radius and height in m, `area` and `response`.

    t runs from 0 to 1 along each side. `area` (n,) in m is 2πr times the node's weight in dt: the sum of area times
    charge per dt is the total charge. `response` (m, n, n) gives, for each order round the axis, the charge per dt in A
    at the nodes for a potential in A there. `own` (n, n) gives the potential at the nodes of a charge that is the same
    all round.
    """

    sides: tuple[Side, ...]
    radius: np.ndarray
    height: np.ndarray
    area: np.ndarray
    response: np.ndarray
    own: np.ndarray


def tube(outer: float, inner: float, low: float, high: float, nodes: tuple[int, int]) -> tuple[Side, ...]:
    """Return the outline of a washer by radii and heights in m; `inner` 0 is a disc.

    `nodes` are the numbers on each face and on each rim.
    """
    face, rim = nodes
    if inner <= 0:
        return cylinder(outer, low, high, (face, rim, face))
    return (
        Side((inner, low), (outer, low), (0, -1), face),
        Side((outer, low), (outer, high), (1, 0), rim),
        Side((inner, high), (outer, high), (0, 1), face),
        Side((inner, low), (inner, high), (-1, 0), rim),
    )


def cylinder(radius: float, low: float, high: float, nodes: tuple[int, int, int]) -> tuple[Side, ...]:
    """Return the outline of a cylinder in m; `nodes` are the numbers on its top, round it and on its bottom."""
    top, around, below = nodes
    return (
        Side((0.0, high), (radius, high), (0, 1), top, True),
        Side((radius, low), (radius, high), (1, 0), around),
        Side((0.0, low), (radius, low), (0, -1), below, True),
    )


def steel_body(sides: Sequence[Side], permeability: float, most: int) -> SteelBody:
    """Return the body of an outline, with its response in orders 0 … `most` round the axis."""
    nodes = [gauss(side.nodes) for side in sides]
    radius, height = np.concatenate([np.stack(side.at(t)) for side, (t, _) in zip(sides, nodes, strict=True)], 1)
    area = 2 * pi * radius * np.concatenate([weight for _, weight in nodes])
    count = len(radius)
    single, double = np.zeros((2, most + 1, count, count))
    at = 0
    for side, (node, _) in zip(sides, nodes, strict=True):
        own = slice(at, at + side.nodes)
        single[..., own], double[..., own] = _layers(side, node, radius, height, own, most)
        at += side.nodes
    # A constant potential makes no field, so the rows of K must add to −½ in the lowest order. Their error is taken off
    # the diagonals of all orders, which share it.
    diagonal = np.arange(count)
    double[:, diagonal, diagonal] -= 0.5 + double[0].sum(-1)
    inside = np.eye(count) / 2 + double
    susceptibility = permeability - 1
    charge = -np.linalg.solve(single, np.linalg.solve(np.eye(count) / susceptibility + inside, inside))
    energy = area[:, None] * charge
    response = (energy + np.swapaxes(energy, 1, 2)) / 2 / area[:, None]
    return SteelBody(tuple(sides), radius, height, area, response, single[0])


def _layers(
    side: Side, node: np.ndarray, radius: np.ndarray, height: np.ndarray, own: slice, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the potentials (m, n, nodes) of single and double layers on a side, for each of its polynomials.

    They are at all nodes, by Gauss points on either side of the place nearest to the node, crowding towards it.
    """
    start, along = np.array(side.start), np.subtract(side.end, side.start)
    share = np.clip(((radius - start[0]) * along[0] + (height - start[1]) * along[1]) / side.length**2, 0, 1)
    fine = np.linspace(0, 1, 2001)
    nearest = np.interp(share, side.part(fine)[0], fine)
    nearest[own] = node
    t, weight = crowded(nearest, eights(side.nodes + POINTS_ABOVE))
    ring_radius, ring_height = side.at(t)
    of = ring_potential(radius[:, None], height[:, None], ring_radius, ring_height, most, at_ring=True)
    basis = _lagrange(node, t)
    out = side.normal[0] * of.along_r + side.normal[1] * of.along_z
    layers = of.value * weight, out * (weight * side.part(t)[1] * side.length)
    single, double = (np.swapaxes(np.swapaxes(layer, 0, 1) @ basis, 0, 1) for layer in layers)
    return single, double


def crowded(nearest: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n, 2 `count`) on [0, 1] whose cubed distances crowd them towards `nearest` (n,), and weights."""
    at, weight = gauss(count)
    cube, weight = at**3, 3 * at**2 * weight
    low, high = nearest[:, None], 1 - nearest[:, None]
    return np.concatenate([low * (1 - cube), low + high * cube], 1), np.concatenate([low * weight, high * weight], 1)


def eights(count: float) -> int:
    """Return a number of points, rounded up to a multiple of eight, so that few different rules are needed."""
    return 8 * ceil(count / 8)


def _lagrange(node: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the polynomials (…, n) at `t` (…) that are 1 at one of the nodes (n,) and 0 at the others."""
    own = 1 / np.prod(node[:, None] - node + np.eye(len(node)), axis=1)
    away = t[..., None] - node
    hit = np.abs(away) < 1e-14
    share = own / np.where(hit, 1.0, away)
    share /= share.sum(-1, keepdims=True)
    return np.asarray(np.where(hit.any(-1, keepdims=True), hit, share))


def fine_rings(body: SteelBody, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rings of charge for fields near the body.

    Radii and heights in m, and shares (rings, nodes) of the nodes' charge. Rings on the topmost side are at most `step`
    m apart; elsewhere they lie at the nodes.
    """
    top = max(side.end[1] for side in body.sides)
    places, shares, at = [], [], 0
    for side in body.sides:
        node, weight = gauss(side.nodes)
        share = np.diag(weight)
        if side.start[1] == side.end[1] == top and (count := eights(1.7 * side.length / step)) > side.nodes:
            t, weight = gauss(count)
            node, share = t, _lagrange(node, t) * weight[:, None]
        places.append(np.stack(side.at(node)))
        shares.append(np.pad(share, ((0, 0), (at, len(body.area) - at - side.nodes))))
        at += side.nodes
    radius, height = np.concatenate(places, 1)
    return radius, height, np.concatenate(shares)
