"""A coil from afar: magnetic poles on its axis."""

from functools import lru_cache

import numpy as np

from padgen.physics.magnetics import SolenoidCoil, core_charges

__all__ = ["coil_poles", "pole_error", "pole_field"]


@lru_cache(maxsize=64)
def coil_poles(coil: SolenoidCoil) -> np.ndarray:
    """A coil as magnetic poles on its axis: charge in A·m/A and height in m over its top, shape (4, 2).

    The winding's ends, and core's positive and negative charges, each pair where its middle is.
    """
    outer, inner = coil.outer_diameter / 2, coil.inner_diameter / 2
    area = np.pi * (outer**2 + outer * inner + inner**2) / 3
    winding = coil.turns * area / coil.length
    poles = [(winding, 0.0), (-winding, -coil.length), (0.0, 0.0), (0.0, 0.0)]
    if coil.core_diameter > 0 and coil.core_permeability > 1:
        _, height, charge = core_charges(coil)
        for k, sign in ((2, charge > 0), (3, charge < 0)):
            total = float(charge[sign].sum())
            poles[k] = (total, float((charge[sign] * height[sign]).sum()) / total)
    result = np.array(poles)
    result.setflags(write=False)
    return result


def pole_field(poles: np.ndarray, height: float, away: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Field (…, 3) in A/m per ampere and its slope along z, `away` (…, 2) in m from a coil's axis."""
    charge, below = poles.T
    up = np.broadcast_to((height - below)[:, None], (*away.shape[:-1], len(poles), 1))
    arm = np.concatenate([np.broadcast_to(away[..., None, :], (*up.shape[:-1], 2)), up], -1)
    square = (arm**2).sum(-1, keepdims=True)
    weight = charge[:, None] / (4 * np.pi * square**1.5)
    along = np.array([0.0, 0.0, 1.0]) - 3 * arm * up / square
    return (weight * arm).sum(-2), (weight * along).sum(-2)


def pole_error(coil: SolenoidCoil, distance: np.ndarray) -> np.ndarray:
    """Relative error of `pole_field` at a `distance` (…) in m: the next multipole's, ``¾ ⟨r²⟩/d²``."""
    outer, inner = coil.outer_diameter / 2, coil.inner_diameter / 2
    square = max((outer**2 + outer * inner + inner**2) / 3, (coil.core_diameter / 2) ** 2)
    return np.asarray(0.75 * square / distance**2)
