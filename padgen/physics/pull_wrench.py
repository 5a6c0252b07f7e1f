"""What an off-axis pull does besides pulling: the side force and the moment on the washer."""

from math import pi

import numpy as np

from padgen.core.errors import SpecError, number
from padgen.physics.magnetics import CoilSource, SteelRing, flat_spheroid_factor, flux_density

__all__ = ["pull_wrench"]

MU_0 = 4e-7 * pi
RINGS, SPOKES = 3, 12


def pull_wrench(coil: CoilSource, washer: SteelRing, gap_m: float, offset_m: np.ndarray) -> np.ndarray:
    """Wrench (n, 6) of the pull per newton of its vertical part, for washers `offset_m` (n,) off the coil's axis.

    ``(Fx, Fy, Fz, Mx, My, Mz)`` over Fz, so that the third entry is 1: x points from the coil's axis
    to the washer's, z up, away from the coil; moments in m about the washer's axis at its
    underside, `gap_m` above the coil's top face. By symmetry only Fx and My differ from 0. The true
    wrench is this times a negative Fz: an Fx of +0.1 draws the washer to the coil's axis, a My
    above 0 pulls its side nearer to the coil's axis down more.

    The force on a magnetised body is ``∫(M·∇)B``, its moment ``∫M×B + r×(M·∇)B`` (Jackson, *Classical
    Electrodynamics*, 5.7), with M as in `magnetics.force_constant`. A washer that the coil does not
    draw down is driven by nothing: its row is (0, 0, 1, 0, 0, 0).

    Against 3-D field solutions of the templates' washers (`docs/measure_force.py`): with the 10 mm coil Fx is
    within 0.08, My within 0.17 mm; with the 44 mm coil of wide-11 within 0.2 and, of 10 mm, 2 mm.

    Raises
    ------
    SpecError
        `gap_m` is not above 0.
    """
    if gap_m <= 0:
        raise SpecError(f"the gap must be above 0 m, got {number(gap_m)} m", "coil.gap")
    offset = np.asarray(offset_m, float)
    arm, weight = _points(washer, offset.shape)
    place = arm + np.stack([offset, 0 * offset, 0 * offset + gap_m], -1)[..., None, :]
    step = 0.02 * (gap_m + washer.thickness)
    field, slopes = _field_and_slopes(coil, place, step)
    magnetised = _magnetisation(washer, field, weight)
    # B is curl free outside winding and core: (M·∇)B = M_k ∇B_k.
    force = (magnetised[..., None, :] * slopes).sum(-1)
    moment = np.cross(arm, force) + np.cross(magnetised, field)
    wrench = (np.concatenate([force, moment], -1) * weight[:, None]).sum(-2)
    wrench *= np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0])
    pulled = wrench[..., 2] < 0
    wrench[~pulled] = np.eye(6)[2]
    return np.asarray(wrench / wrench[..., 2:3] + 0.0)


def _points(washer: SteelRing, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Points (…, p, 3) of the middle plane from the middle of the underside, and their weights (p,) of sum 1."""
    node, weight = np.polynomial.legendre.leggauss(RINGS)
    inner, outer = washer.inner_diameter / 2, washer.outer_diameter / 2
    radius = np.sqrt(inner**2 + (node + 1) / 2 * (outer**2 - inner**2))[:, None]
    angle = (np.arange(SPOKES) + 0.5) * 2 * pi / SPOKES
    arm = np.stack(np.broadcast_arrays(radius * np.cos(angle), radius * np.sin(angle), washer.thickness / 2), -1)
    return np.broadcast_to(arm.reshape(-1, 3), (*shape, RINGS * SPOKES, 3)), np.repeat(weight / 2, SPOKES) / SPOKES


def _field_and_slopes(coil: CoilSource, place: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Flux density (…, 3) in T per ampere at points (…, 3) above the coil, and its slopes (…, axis, 3) in T/m.

    Of an axisymmetric field without curl and divergence the slopes along the axis give all others:
    ``∂B_z/∂r = ∂B_r/∂z`` and ``∂B_r/∂r = −B_r/r − ∂B_z/∂z``.
    """
    distance = np.maximum(np.hypot(place[..., 0], place[..., 1]), 1e-6 * coil.outer_diameter)
    height = place[..., 2] + step * np.array([-1.0, 0.0, 1.0]).reshape(-1, *(1,) * distance.ndim)
    radial, axial = flux_density(coil, np.broadcast_to(distance, height.shape).copy(), height)
    radial_z, axial_z = (radial[2] - radial[0]) / (2 * step), (axial[2] - axial[0]) / (2 * step)
    over = radial[1] / distance
    radial_r = -over - axial_z
    c, s = place[..., 0] / distance, place[..., 1] / distance
    mixed = (radial_r - over) * c * s
    slopes = [
        [radial_r * c * c + over * s * s, mixed, radial_z * c],
        [mixed, radial_r * s * s + over * c * c, radial_z * s],
        [radial_z * c, radial_z * s, axial_z],
    ]
    field = np.stack([radial[1] * c, radial[1] * s, axial[1]], -1)
    return field, np.stack([np.stack(row, -1) for row in slopes], -2)


def _magnetisation(washer: SteelRing, field: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Magnetisation (…, p, 3) times the washer's volume, in A·m² per ampere.

    A susceptibility for each direction: the mean field along the plane meets the whole disc, the
    rest of it the width of the ring, the axial field its thickness.
    """
    chi, outer = washer.permeability - 1, washer.outer_diameter
    width = (outer - washer.inner_diameter) / 2
    ring_share = width / (width + washer.thickness)
    eased = chi / (1 + chi * np.array([1 - ring_share, 1 - ring_share, ring_share]))
    one_sided = (field * weight[:, None]).sum(-2, keepdims=True) * np.array([1.0, 1.0, 0.0])
    whole = chi / (1 + chi * flat_spheroid_factor(outer / washer.thickness))
    volume = pi / 4 * (outer**2 - washer.inner_diameter**2) * washer.thickness
    return np.asarray(volume / MU_0 * (eased * (field - one_sided) + whole * one_sided))
