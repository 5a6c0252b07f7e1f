"""Linear elastic materials for finite elements: isotropic, or orthotropic along the taxel's axes."""

from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number

__all__ = ["Elastic", "Orthotropy", "layered", "stiffness_pa"]


class Orthotropy(NamedTuple):
    """Constants along x, y and z, as layered prints have: moduli (Ex, Ey, Ez) and shear moduli
    (Gyz, Gzx, Gxy) in Pa, and Poisson ratios (ν_yz, ν_zx, ν_xy), ν_ij = −ε_j/ε_i under σ_i."""

    modulus_pa: tuple[float, float, float]
    shear_pa: tuple[float, float, float]
    poisson: tuple[float, float, float]


class Elastic(NamedTuple):
    """A linear elastic material. With `axes` given, they replace `modulus_pa` and `poisson`."""

    modulus_pa: float
    poisson: float
    density_kg_per_m3: float
    axes: Orthotropy | None = None


def layered(material: Elastic, ratio: float) -> Elastic:
    """`material` printed in layers across z: its modulus and shear moduli across them are `ratio` of those along."""
    if ratio == 1:
        return material
    e, nu = material.modulus_pa, material.poisson
    shear = e / 2 / (1 + nu)
    # Pulled along a layer it narrows as before; ν_zx E_x = ν_xz E_z.
    axes = Orthotropy((e, e, ratio * e), (ratio * shear, ratio * shear, shear), (nu, ratio * nu, nu))
    return material._replace(axes=axes)


def stiffness_pa(material: Elastic) -> np.ndarray:
    """Stiffness (6, 6) in Pa for engineering strains in the order xx, yy, zz, yz, zx, xy (Voigt).

    Raises
    ------
    SolverError
        The constants belong to no stable material: strain energy or density would be negative.
    """
    e, nu = material.modulus_pa, material.poisson
    if material.density_kg_per_m3 <= 0:
        raise SolverError(f"density must be above 0, got {number(material.density_kg_per_m3)} kg/m³")
    if material.axes is None:
        if e <= 0 or not -1 < nu < 0.5:
            raise SolverError(f"needs E > 0 and -1 < ν < 0.5, got {number(e)} Pa and {number(nu)}, e.g. 0.36")
        axes = Orthotropy((e,) * 3, (e / 2 / (1 + nu),) * 3, (nu,) * 3)
    else:
        axes = material.axes
    return _inverted(_compliance(axes))


def _compliance(axes: Orthotropy) -> np.ndarray:
    """Compliance (6, 6) in 1/Pa."""
    ex, ey, ez = axes.modulus_pa
    yz, zx, xy = axes.poisson
    if min(*axes.modulus_pa, *axes.shear_pa) <= 0:
        raise SolverError(f"moduli must be above 0, got {axes.modulus_pa} and {axes.shear_pa} Pa")
    compliance = np.diag([1 / ex, 1 / ey, 1 / ez, *(1 / g for g in axes.shear_pa)])
    for i, j, coupling in ((0, 1, xy / ex), (1, 2, yz / ey), (0, 2, zx / ez)):
        compliance[i, j] = compliance[j, i] = -coupling
    return compliance


def _inverted(compliance: np.ndarray) -> np.ndarray:
    if np.linalg.eigvalsh(compliance / np.abs(compliance).max())[0] <= 0:
        raise SolverError("Poisson ratios too large for the moduli: strain energy must be positive in every direction")
    stiffness = np.linalg.inv(compliance)
    return np.asarray((stiffness + stiffness.T) / 2)
