"""Field of a coil far away, from magnetic poles on its axis."""

from functools import lru_cache

import numpy as np

from padgen.physics.coil_field import charged_core
from padgen.physics.magnetics import CoilSource, Winding

__all__ = ["coil_poles", "pole_error", "pole_field"]


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
    up = np.broadcast_to((height - below)[:, None], (*away.shape[:-1], len(poles), 1))
    arm = np.concatenate([np.broadcast_to(away[..., None, :], (*up.shape[:-1], 2)), up], -1)
    square = (arm**2).sum(-1, keepdims=True)
    weight = charge[:, None] / (4 * np.pi * square**1.5)
    along = np.array([0.0, 0.0, 1.0]) - 3 * arm * up / square
    return (weight * arm).sum(-2), (weight * along).sum(-2)


def pole_error(coil: CoilSource, distance: np.ndarray) -> np.ndarray:
    """Return the relative error of `pole_field` at a `distance` (…) in m: the next multipole's, ``¾ ⟨r²⟩/d²``."""
    square = max((coil.core_diameter / 2) ** 2, *(_radius_square(winding) / 3 for winding in coil.windings))
    return np.asarray(0.75 * square / distance**2)


def _radius_square(winding: Winding) -> float:
    """Return three times the mean of the squared radius of a winding's turns, in m²."""
    outer, inner = winding.outer_diameter / 2, winding.inner_diameter / 2
    return outer**2 + outer * inner + inner**2
