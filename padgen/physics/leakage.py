"""Pull of a coil on the washers of its neighbours, relative to the pull of their own coil, by surface charges."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from padgen.physics.coil_field import (
    CORE_ORDERS,
    charged_core,
    coil_poles,
    coil_rings,
    pole_field,
    rings_potential,
    winding_rings,
)
from padgen.physics.magnetics import CoilSource, SteelRing
from padgen.physics.ring_charges import ring_potential
from padgen.physics.steel_body import SteelBody, fine_rings, steel_body, tube

__all__ = ["Leakage", "leakage"]

FACE, RIM, ORDERS = 5, 3, 2
"""Nodes on each face and each rim of a washer, and highest order round its axis; few, to save time."""
STEP = 1.0
"""Largest distance between rings that face the washer, over the gap."""


class Leakage(NamedTuple):
    """Pulls on washers (n,), over the pull of their own coil with unit current.

    `mutual` (n, k, k) is by the fields of neighbours k and l together: currents i_k pull with ``Σ mutual_kl i_k i_l``.
    `product` (n, k) is by neighbour k and the washer's own coil: ``2 product_k i i_k``.
    """

    mutual: np.ndarray
    product: np.ndarray


class _Parts(NamedTuple):
    """Fourier parts (…, parts, j) of a potential and of its slope along z at the nodes (j,) of a body of revolution.

    The parts are the constant round the body's axis, then cos φ, sin φ, cos 2φ …
    """

    value: np.ndarray
    slope: np.ndarray


def leakage(
    coil: CoilSource,
    washer: SteelRing,
    gap: float,
    place: np.ndarray,
    neighbours: np.ndarray,
    far: np.ndarray | None = None,
) -> Leakage:
    """Return the leakage on washers from the coils around their own.

    The washers are at `place` (n, 2) in m from the axis of their own coil, the other coils at `neighbours` and `far`
    (k, 2). `far` coils are replaced by their poles (`physics.coil_field`) and come last in the result. Every coil with
    its core magnetises the washer. Neighbours also magnetise the own coil's core, whose field magnetises the washer
    further; other cores act on each other as dipoles. The force is that of the fields on the washer's charges. The
    effect of the washer on cores is left out.
    """
    body = _washer(washer)
    turns = 2 * ORDERS + 2
    angle = (np.arange(turns) + 0.5) * 2 * np.pi / turns
    ring = body.radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    points = place[:, None, None] + ring  # (n, j, turns, 2)
    height = (body.height + gap)[:, None]
    own = _coil_potential(coil_rings(coil, STEP * gap), points[:, None], height)
    near = _coil_potential(_coarse_rings(coil), points[:, None] - neighbours[:, None, None], height)
    value, slope = (np.concatenate(pair, 1) for pair in zip(own, near, strict=True))
    parts = _fourier_parts(value, slope, angle)
    if far is not None and len(far):
        # Fields of far coils change linearly over the washer.
        up, across = body.height - washer.thickness / 2, body.radius
        flux = pole_field(coil_poles(coil), gap + washer.thickness / 2, place[:, None] - far)
        field, change = (v[..., None] for v in flux)
        beyond = np.zeros((2, len(place), len(far), *parts.value.shape[2:]))
        beyond[0, :, :, 0], beyond[1, :, :, 0] = -field[:, :, 2] * up, -field[:, :, 2] - change[:, :, 2] * up
        beyond[:, :, :, 1:3] = -np.stack([field, change])[:, :, :, :2] * across
        parts = _Parts(*(np.concatenate(pair, 1) for pair in zip(parts, beyond, strict=True)))
    if (drawn := _core_charge(coil, neighbours, far)) is not None:
        core, charge = drawn
        of_core = _core_field(core, charge, points, height, angle, STEP * gap)
        for part, more in zip(parts, of_core, strict=True):
            part[:, 1:] += more
        echo = _effective_currents(
            coil, core, np.concatenate([np.zeros((1, 2)), neighbours, *([] if far is None else [far])])
        )
        parts = _Parts(*((echo.T @ part.reshape(*part.shape[:2], -1)).reshape(part.shape) for part in parts))
    order = (np.arange(parts.value.shape[2]) + 1) // 2
    on_washer = (body.response[order] @ parts.value[..., None])[..., 0]
    weight = body.area * np.where(order == 0, 1.0, 0.5)[:, None]
    shape = len(place), parts.value.shape[1], -1
    pulled = (on_washer * weight).reshape(shape) @ np.swapaxes(parts.slope.reshape(shape), 1, 2)
    pulled = (pulled + np.swapaxes(pulled, 1, 2)) / 2
    alone = np.where(pulled[:, :1, :1] == 0, np.inf, pulled[:, :1, :1])
    return Leakage(pulled[:, 1:, 1:] / alone, pulled[:, 0, 1:] / alone[:, 0])


@lru_cache(maxsize=32)
def _washer(washer: SteelRing) -> SteelBody:
    sides = tube(washer.outer_diameter / 2, washer.inner_diameter / 2, 0.0, washer.thickness, (FACE, RIM))
    return steel_body(sides, washer.permeability, ORDERS)


@lru_cache(maxsize=32)
def _coarse_rings(coil: CoilSource) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a coil as a few rings of charge, for its field beside it.

    Each end of a winding is three rings, and the core one at every height of its nodes. Radii and heights in m, charges
    in A per ampere. Each ring has the charge, the mean height and the mean squared radius of its part.
    """
    radius, height, density = winding_rings(coil.windings, coil.outer_diameter / 8)
    # Sorted sets, since np.unique would load numpy.ma in every plan.
    zone, charge = np.floor(6 * radius / coil.outer_diameter), radius * density
    groups = [
        (radius, height, np.where((height == z) & (zone == k), charge, 0.0))
        for z in sorted(set(height))
        for k in sorted(set(zone))
    ]
    if (core := charged_core(coil)) is not None:
        radius, height, charge = core[0].radius, core[0].height, core[0].area * core[1] / (2 * np.pi)
        groups += [(radius, height, np.where(height == z, charge, 0.0)) for z in sorted(set(height))]
    total, square, at = np.array([(q.sum(), (q * r**2).sum(), (q * z).sum()) for r, z, q in groups if q.any()]).T
    across = np.sqrt(square / total)
    return across, at / total, total / across


def _coil_potential(
    rings: tuple[np.ndarray, np.ndarray, np.ndarray], away: np.ndarray, height: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the potential of a coil's rings and its slope along z, at points `away` (…, 2) in m from its axis."""
    value, _, along_z = rings_potential(rings, np.hypot(away[..., 0], away[..., 1]), height)
    return value, along_z


def _fourier_parts(value: np.ndarray, slope: np.ndarray, angle: np.ndarray) -> _Parts:
    """Return Fourier coefficients of a potential and its slope (…, j, turns): of 1, cos φ, sin φ, cos 2φ …"""
    order = np.arange(1, len(angle) // 2)[:, None]
    waves = 2 * np.stack([np.cos(order * angle), np.sin(order * angle)], 1).reshape(-1, len(angle))
    waves = np.concatenate([np.ones((1, len(angle))), waves]) / len(angle)
    return _Parts(*(np.swapaxes(part @ waves.T, -1, -2) for part in (value, slope)))


def _core_charge(
    coil: CoilSource, neighbours: np.ndarray, far: np.ndarray | None
) -> tuple[SteelBody, np.ndarray] | None:
    """Return the own coil's core and its charge (k, parts, nodes) in the neighbours' fields; None without a core."""
    charged = charged_core(coil)
    if charged is None:
        return None
    core = charged[0]
    turns = 2 * CORE_ORDERS + 2
    angle = (np.arange(turns) + 0.5) * 2 * np.pi / turns
    points = core.radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    value, _ = _fourier_parts(
        *_coil_potential(_coarse_rings(coil), points - neighbours[:, None, None], core.height[:, None]), angle
    )
    if far is not None and len(far):
        middle = coil.core_top - coil.core_length / 2
        field = pole_field(coil_poles(coil), middle, -far)[0][..., None]
        beyond = np.concatenate([-field[:, 2:] * (core.height - middle), -field[:, :2] * core.radius], 1)
        value = np.concatenate([value, beyond])
    order = (np.arange(value.shape[1]) + 1) // 2
    return core, (core.response[order] @ value[..., None])[..., 0]


def _effective_currents(coil: CoilSource, core: SteelBody, axes: np.ndarray) -> np.ndarray:
    """Return effective currents (k, k) of coils at `axes`, the own one first, as their cores magnetise each other.

    A core in another coil's field is a dipole, which counts as additional current of the core's own coil. The first
    coil's core is left out, since `_core_charge` computes it better.
    """
    poles, middle = coil_poles(coil), coil.core_top - coil.core_length / 2
    apart = axes[:, None] - axes + np.eye(len(axes))[..., None]  # any distance but 0 for a core in its own coil
    field = pole_field(poles, middle, apart)[0][..., 2] * (1 - np.eye(len(axes)))
    drawn = core.area @ (core.response[0] @ (middle - core.height) * core.height)
    share = field * drawn / (poles[:, 0] @ poles[:, 1])
    share[0] = 0.0
    return np.asarray(np.linalg.inv(np.eye(len(axes)) - share))


def _core_field(
    core: SteelBody, charge: np.ndarray, points: np.ndarray, height: np.ndarray, angle: np.ndarray, step: float
) -> _Parts:
    """Return the field of `charge` (k, parts, nodes) on the core, round each washer, as (n, k, …).

    The washers' nodes are at `points` (n, j, turns, 2) in m.
    """
    radius, at, shares = fine_rings(core, step)
    rho, around = np.hypot(points[..., 0], points[..., 1]), np.arctan2(points[..., 1], points[..., 0])
    z = np.broadcast_to(height, rho.shape)[..., None]
    of = ring_potential(rho[..., None], z, radius, at, CORE_ORDERS, at_ring=False)
    waves = np.ones_like(around), np.cos(around), np.sin(around)
    made: list[np.ndarray] = []
    for part in (of.value, of.along_z):
        each = (part[(k + 1) // 2] @ (shares @ charge[:, k].T) for k in range(charge.shape[1]))
        field: np.ndarray = sum(wave[..., None] * one for wave, one in zip(waves, each, strict=False))
        made.append(np.moveaxis(field, -1, 1))
    return _fourier_parts(made[0], made[1], angle)
