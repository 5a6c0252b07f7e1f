"""Pull of a coil on the washers of its neighbours, relative to what their own coil pulls."""

from typing import NamedTuple

import numpy as np

from padgen.physics.magnetics import SolenoidCoil, SteelRing, flux_density

__all__ = ["Leakage", "leakage"]

SPOKES = 6


class Leakage(NamedTuple):
    """Force gradients (n, k) of neighbour k on washer n, over its own coil's: with `square` the
    neighbour's current alone, with `product` twice the two currents together."""

    square: np.ndarray
    product: np.ndarray


def leakage(coil: SolenoidCoil, washer: SteelRing, gap: float, place: np.ndarray, neighbours: np.ndarray) -> Leakage:
    """Leakage on washers at `place` (n, 2) in m from their coil, by coils at `neighbours` (k, 2) in m.

    The washer is a ring of points magnetised along its plane and its thickness as
    ``1/N``, N the demagnetising factors of its cross section; forces are gradients of ``B·B'`` over
    the gap. The fields of two coils add before they are squared, hence the product: it is the larger.
    """
    radius = (washer.outer_diameter + washer.inner_diameter) / 4
    angle = (np.arange(SPOKES) + 0.5) * 2 * np.pi / SPOKES
    points = place[:, None, :] + radius * np.stack([np.cos(angle), np.sin(angle)], -1)
    axes = np.concatenate([np.zeros((1, 2)), neighbours])
    away = points[:, None] - axes[None, :, None]  # (n, 1 + k, spokes, 2)
    distance = np.maximum(np.hypot(away[..., 0], away[..., 1]), 1e-3 * radius)
    step = 0.02 * (gap + washer.thickness)
    products = []
    for height in (gap + washer.thickness / 2 - step, gap + washer.thickness / 2 + step):
        radial, axial = flux_density(coil, distance, np.full_like(distance, height))
        field = np.concatenate([away * (radial / distance)[..., None], axial[..., None]], -1)
        products.append(_weighted(field, field[:, :1], washer))
        products.append(_weighted(field, field, washer))
    with_own, alone = products[0] - products[2], products[1] - products[3]
    own = np.where(alone[:, :1] == 0, np.inf, alone[:, :1])
    return Leakage(alone[:, 1:] / own, with_own[:, 1:] / own)


def _weighted(field: np.ndarray, other: np.ndarray, washer: SteelRing) -> np.ndarray:
    """Mean of ``B·B'`` over the ring, the components weighted by how easily they magnetise it."""
    width = (washer.outer_diameter - washer.inner_diameter) / 2
    chi = washer.permeability - 1
    across, through = (1 + chi * t / (width + washer.thickness) for t in (washer.thickness, width))
    product = field * other
    mean: np.ndarray = (product[..., :2].sum(-1) / across + product[..., 2] / through).mean(-1)
    return mean
