"""Pull of a coil on the washers of its neighbours, relative to what their own coil pulls."""

from typing import NamedTuple

import numpy as np

from padgen.physics.coil_field import flux_density
from padgen.physics.magnetics import MU_0, CoilSource, SteelRing
from padgen.physics.poles import coil_poles, pole_field

__all__ = ["Leakage", "easiness", "leakage"]

SPOKES = 6


class Leakage(NamedTuple):
    """Force gradients on washers (n,), over what their own coil makes with unit current.

    `mutual` (n, k, k): by the fields of neighbours k and l together, so that currents i_k pull with
    ``Σ mutual_kl i_k i_l``; `product` (n, k): by neighbour k and the own coil, ``2 product_k i i_k``.
    """

    mutual: np.ndarray
    product: np.ndarray


def leakage(
    coil: CoilSource,
    washer: SteelRing,
    gap: float,
    place: np.ndarray,
    neighbours: np.ndarray,
    far: np.ndarray | None = None,
) -> Leakage:
    """Leakage on washers at `place` (n, 2) in m from their coil, by coils at `neighbours` and `far` (k, 2) in m.

    Those `far` are seen as their poles (`physics.poles`), and come after the others in the result.

    The washer is a ring of points magnetised along its plane and its thickness as
    ``1/N``, N the demagnetising factors of its cross section; forces are gradients of ``B·B'`` over
    the gap. The fields of two coils add before they are squared, hence the products. That puts `mutual` at 0.4 to 1.4
    times what `physics.pull` says of washers one or two pitches away, more below the very rim of the next coil.
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
        if far is not None:
            beyond = MU_0 * pole_field(coil_poles(coil), height, points[:, None] - far[None, :, None])[0]
            field = np.concatenate([field, beyond], 1)
        weighed = (field * easiness(washer)).reshape(*field.shape[:2], -1)
        products.append(weighed @ np.swapaxes(field.reshape(weighed.shape), 1, 2) / SPOKES)
    gradient = products[0] - products[1]
    own = np.where(gradient[:, :1, :1] == 0, np.inf, gradient[:, :1, :1])
    return Leakage(gradient[:, 1:, 1:] / own, gradient[:, 0, 1:] / own[:, 0])


def easiness(washer: SteelRing) -> np.ndarray:
    """How easily a field along x, y and z magnetises the washer: ``1/(1 + χN)``."""
    width = (washer.outer_diameter - washer.inner_diameter) / 2
    along = np.array([washer.thickness, washer.thickness, width]) / (width + washer.thickness)
    magnetised: np.ndarray = 1 / (1 + (washer.permeability - 1) * along)
    return magnetised
