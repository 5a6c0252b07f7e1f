"""Mutual inductance of coils side by side, against filaments by elliptic integrals and against the far field."""

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from padgen.core.units import MM
from padgen.physics.magnetics import flux_density, mutual_error, mutual_inductance, solenoid

MU_0 = 4e-7 * np.pi
AIR = solenoid(10 * MM, 4 * MM, 8 * MM, 1000, 0.0, 1.0)
CORED = solenoid(10 * MM, 4 * MM, 8 * MM, 1000, 4 * MM, 500.0)


def vector_potential(radius, rho, z):
    """A_φ in V·s/m of a circular loop of 1 A (Jackson, Classical Electrodynamics, 5.37)."""
    m = 4 * radius * rho / ((radius + rho) ** 2 + z**2)
    return MU_0 / (np.pi * np.sqrt(m)) * np.sqrt(radius / rho) * ((1 - m / 2) * ellipk(m) - ellipe(m))


def filament_sum(inner_mm, outer_mm, high_mm, apart_mm, places=6, angles=192):
    """M in H of a coil of 1000 turns beside itself: flux of `places` by `places` loops through as many, by ∮ A dl."""
    apart = apart_mm * MM
    middle = (np.arange(places) + 0.5) / places
    radius = (inner_mm + (outer_mm - inner_mm) * middle) / 2 * MM
    height = high_mm * middle * MM
    angle = 2 * np.pi * (np.arange(angles) + 0.5) / angles
    total = 0.0
    for source in radius:
        for sink in radius:
            x = apart + sink * np.cos(angle)
            y = sink * np.sin(angle)
            rho = np.hypot(x, y)
            # The part of A_φ along the sink's loop.
            along = (x * np.cos(angle) + y * np.sin(angle)) / rho * sink * 2 * np.pi / angles
            for up in np.subtract.outer(height, height).ravel():
                total += (vector_potential(source, rho, up) * along).sum()
    return total * (1000 / places**2) ** 2


@pytest.mark.parametrize("size_mm", [(4, 10, 8), (2, 9.6, 0.9), (16, 20, 1)])
@pytest.mark.parametrize("over_diameter", [1.02, 1.1, 1.25, 1.77, 3.0])
def test_mutual_inductance_against_filaments(size_mm, over_diameter):
    """Poles give less, by half at most where flat coils nearly touch, and never by more than is stated."""
    inner_mm, outer_mm, high_mm = size_mm
    coil = solenoid(outer_mm * MM, inner_mm * MM, high_mm * MM, 1000, 0.0, 1.0)
    apart = np.array(over_diameter * outer_mm * MM)
    exact = filament_sum(*size_mm, over_diameter * outer_mm)
    by_poles = float(mutual_inductance(coil, apart))
    assert exact < by_poles < 0
    stated = float(mutual_error(coil, apart))
    assert exact / by_poles - 1 < stated < 0.05 + 4 * (exact / by_poles - 1)


@pytest.mark.parametrize("coil", [AIR, CORED])
def test_mutual_inductance_far_away_is_that_of_two_dipoles(coil):
    """Each of the moment that its own field far away has; cores count twice, in the field and in the answer to it."""
    apart = 0.2
    field = float(flux_density(coil, np.array([apart]), np.array([-4 * MM]))[1][0])
    moment = -field * 4 * np.pi * apart**3 / MU_0
    dipoles = -MU_0 * moment**2 / (4 * np.pi * apart**3)
    assert float(mutual_inductance(coil, np.array(apart))) == pytest.approx(dipoles, rel=0.01)
