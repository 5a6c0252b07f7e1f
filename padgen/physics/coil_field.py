"""Field above a coil with its core, from magnetic charge that stands for the core and for the windings.

A winding is replaced by a magnetisation whose curl is its current; the charge lies on the ends of that magnetisation.
The core is linear steel (`physics.steel_body`).

Far away a coil is replaced by magnetic poles on its axis.
"""

from functools import lru_cache

import numpy as np

from padgen.physics.magnetics import MU_0, CoilSource, Winding
from padgen.physics.ring_charges import RingPotential, gauss, ring_potential
from padgen.physics.steel_body import SteelBody, crowded, cylinder, eights, fine_rings, steel_body

__all__ = [
    "CORE_ORDERS",
    "MOST_RINGS",
    "charged_core",
    "coil_poles",
    "coil_rings",
    "flux_density",
    "pole_error",
    "pole_field",
    "rings_potential",
    "winding_rings",
]

CORE_ORDERS = 1
"""Highest order round the axis of a core in its neighbours' fields."""
MOST_RINGS = 400
"""Most rings across a coil. Nearer to its top than a two-hundredth of its radius the field is less certain."""
AT_ONCE = 8192
"""Pairs of a point and a ring computed together: few enough for a processor's cache."""


@lru_cache(maxsize=32)
def charged_core(coil: CoilSource, top: int = 12, orders: int = CORE_ORDERS) -> tuple[SteelBody, np.ndarray] | None:
    """Return the core and the charge per dt at its nodes in A per ampere (`SteelBody`); None without a core.

    `top` is the number of nodes on its upper face, `orders` the highest order round its axis.
    """
    if not coil.has_core:
        return None
    low = coil.core_top - coil.core_length
    sides = cylinder(coil.core_diameter / 2, low, coil.core_top, (top, 8, 5))
    core = steel_body(sides, coil.core_permeability, orders)
    potential = np.zeros(len(core.area))
    for winding in coil.windings:
        full = winding.turns / winding.length
        for z, sign in ((winding.top, 1), (winding.bottom, -1)):
            for start, end in _spans(winding):
                nearest = np.clip((core.radius - start) / (end - start), 0, 1)
                t, weight = crowded(nearest, 24)
                radius = start + t * (end - start)
                of = ring_potential(core.radius[:, None], core.height[:, None], radius, np.array(z), 0, at_ring=True)
                potential += sign * (of.value[0] * _magnetised(winding, radius) * weight * (end - start)).sum(1)
        # Within the windings H is the field of the charges plus the magnetisation that replaces the current.
        potential -= full * np.clip(core.height, winding.bottom, winding.top)
    return core, core.response[0] @ potential


def _spans(winding: Winding) -> list[tuple[float, float]]:
    """Return the radii (from, to) in m of the bore and of the winding itself, without empty ones."""
    inner, outer = winding.inner_diameter / 2, winding.outer_diameter / 2
    return [span for span in ((0.0, inner), (inner, outer)) if span[1] > span[0]]


def _magnetised(winding: Winding, radius: np.ndarray) -> np.ndarray:
    """Return the axial magnetisation in A/m per ampere whose curl is the winding's current."""
    inner, outer = winding.inner_diameter / 2, winding.outer_diameter / 2
    full = winding.turns / winding.length
    inside = (radius < (inner + outer) / 2).astype(float) if outer == inner else (outer - radius) / (outer - inner)
    return np.asarray(full * np.clip(inside, 0, 1))


def winding_rings(windings: tuple[Winding, ...], step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the windings as rings of charge, for points above them: radii and heights in m, charges in A per ampere.

    Rings on upper ends are at most `step` m apart; rings on lower ends may be wider apart, since they are farther away.
    """
    rings = []
    for winding in windings:
        for z, sign, apart in ((winding.top, 1, step), (winding.bottom, -1, max(step, winding.length / 4))):
            for start, end in _spans(winding):
                t, weight = gauss(eights(1.7 * (end - start) / apart))
                radius = start + t * (end - start)
                charge = sign * _magnetised(winding, radius) * weight * (end - start)
                rings.append(np.stack([radius, np.full(len(t), z), charge]))
    radius, height, charge = np.concatenate(rings, 1)
    return radius, height, charge


def flux_density(coil: CoilSource, radius: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return radial and axial flux density in T per ampere at points above the coil's top face.

    `radius` and `height` are arrays of one shape, in m.
    """
    height = np.asarray(height, float)
    step = max(float(height.min(initial=np.inf)) / 2, coil.outer_diameter / MOST_RINGS)
    _, along_r, along_z = rings_potential(coil_rings(coil, step), radius, height)
    return -MU_0 * along_r, -MU_0 * along_z


def rings_potential(
    rings: tuple[np.ndarray, np.ndarray, np.ndarray], radius: np.ndarray, height: np.ndarray
) -> RingPotential:
    """Return the potential of charged rings, as from `coil_rings`, and its slopes, at points in m that broadcast."""
    at_radius, at_height, charge = rings
    points = np.stack([side.ravel() for side in np.broadcast_arrays(radius, height)])[..., None]
    some, count = max(AT_ONCE // len(charge), 1), points.shape[1]
    blocks = (points[:, first : first + some] for first in range(0, max(count, 1), some))
    each = [ring_potential(block[0], block[1], at_radius, at_height, 0, at_ring=False) for block in blocks]
    parts = (np.concatenate([part[0] @ charge for part in one]) for one in zip(*each, strict=True))
    return RingPotential(*(part.reshape(np.broadcast_shapes(np.shape(radius), np.shape(height))) for part in parts))


@lru_cache(maxsize=16)
def coil_rings(coil: CoilSource, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return coil and core as rings, on top `step` m apart: radii and heights in m, charges in A per ampere."""
    rings = [np.stack(winding_rings(coil.windings, step))]
    if (core := charged_core(coil)) is not None:
        radius, height, shares = fine_rings(core[0], step)
        rings.append(np.stack([radius, height, shares @ core[1]]))
    radius, height, charge = np.concatenate(rings, 1)
    return radius, height, charge


@lru_cache(maxsize=64)
def coil_poles(coil: CoilSource) -> np.ndarray:
    """Return a coil's poles: charge in A·m per ampere and height in m over its top, shape (poles, 2).

    Each end of a winding is one pole. The core's positive and its negative charges are one pole each, at the mean
    height of those charges.
    """
    poles = []
    for winding in coil.windings:
        charge = winding.turns * (np.pi * _radius_square(winding) / 3) / winding.length
        poles += [(charge, winding.top), (-charge, winding.bottom)]
    if (core := charged_core(coil)) is not None:
        height, charges = core[0].height, core[0].area * core[1]
        for sign in (charges > 0, charges < 0):
            total = float(charges[sign].sum())
            poles.append((total, float((charges[sign] * height[sign]).sum()) / total))
    result = np.array(poles)
    result.setflags(write=False)
    return result


def pole_field(poles: np.ndarray, height: float, away: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the field (…, 3) in A/m per ampere at `height` in m, and its slope along z.

    `away` (…, 2) in m is the horizontal distance from the coil's axis.
    """
    charge, below = poles.T
    up = height - below
    square = (away**2).sum(-1)[..., None] + up**2
    weight = charge / (4 * np.pi * square * np.sqrt(square))
    turning = 3 * weight * up / square
    field, slope = (
        np.concatenate([away * across.sum(-1, keepdims=True), along.sum(-1, keepdims=True)], -1)
        for across, along in ((weight, weight * up), (-turning, weight - turning * up))
    )
    return field, slope


def pole_error(coil: CoilSource, distance: np.ndarray) -> np.ndarray:
    """Return the relative error of `pole_field` at a `distance` (…) in m: the next multipole's, ``¾ ⟨r²⟩/d²``."""
    square = max((coil.core_diameter / 2) ** 2, *(_radius_square(winding) / 3 for winding in coil.windings))
    return np.asarray(0.75 * square / distance**2)


def _radius_square(winding: Winding) -> float:
    """Return three times the mean of the squared radius of a winding's turns, in m²."""
    outer, inner = winding.outer_diameter / 2, winding.inner_diameter / 2
    return outer**2 + outer * inner + inner**2
