"""The taxels on their frame: coupling, the frame as a solid, crosstalk, and the bound of the frame's flexibility.

Agreement table (what must equal what, and why to that tolerance):

| model | against | tolerance |
|---|---|---|
| a mass on a spring on a mass on a spring | the quadratic's roots | 1e-12, rounding |
| crosstalk | dense complex solve of the same pad | 1e-9, the same equations |
| shift by elements of order 3 | reduction of every tile from 3-D elasticity, seams of degree 6 | 25 % of it |
| crosstalk by the same, other channels | the same | 1 dB at -90 … -112 dB |
| bound of the shift | the shift | above, and at most 20 times |

Finite elements run in a process of their own, which has no CAD kernel loaded.
"""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from padgen.core.units import G_PER_CM3, GPA
from padgen.planner import Plan, make_plan
from padgen.planner.left_out import flexibility_bounds, frame_around
from padgen.spec import parse_spec
from padgen.verify.elasticity import Elastic, assembled_system, eigenmodes, factored, meshed
from padgen.verify.pad_frame import (
    CLAMPINGS,
    HELD,
    MESH,
    MountedTaxel,
    PadModes,
    _frame_solid,
    central_taxels,
    coupled_modes,
    pad_modes,
    peak_hz,
    shift,
)
from tests.finer_models import crosstalk_db

TEXT = """
name = "tiny"
resolution = 4
band_hz = [50, 120]
q_min = 15
resonances_hz = [56, 76]
pad = { width_mm = 25, depth_mm = 12.5 }
coil = { grid = [1, 2] }
suspension = { topology = "cantilever", tune = "width" }
"""
REDUCED = {
    ("corners", 0): (-0.1456, -0.0536, (90.4, 97.2, 110.6)),
    ("corners", 1): (-0.2499, -0.0913, (112.1, 90.8, 92.1)),
    ("edges", 0): (-0.1448, -0.0529, (96.8, 88.4, 131.4)),
    ("edges", 1): (-0.2483, -0.0900, (132.6, 83.0, 98.4)),
}
"""Shifts in % of the softest and stiffest taxel of the driven channel, and by how many dB the others move less.

They are from a Craig-Bampton reduction of every tile, washers included, by elements of order 4 and polynomials of
degree 6 along the seams and 4 in height; from degree 6 to 9 its shifts grow by a twentieth.
"""


@pytest.fixture(scope="module")
def plan() -> Plan:
    return make_plan(parse_spec(TEXT))


@pytest.fixture(scope="module")
def worker():
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        yield lambda function, *given: pool.submit(function, *given).result()


@pytest.fixture(scope="module")
def pads(worker, plan) -> dict[str, tuple[PadModes, PadModes]]:
    return {clamping: worker(pad_modes, plan, clamping, 3) for clamping in CLAMPINGS}


def shifts(plan, pad, channel) -> list[float]:
    return [shift(plan, *pad, k) for k, taxel in enumerate(plan.taxels) if taxel.channel == channel]


def one_above_the_other(k: float, m: float, frame_k: float, frame_m: float) -> tuple[PadModes, np.ndarray, np.ndarray]:
    """Return a taxel that only moves vertically on a frame of one motion, and the equal system of two masses."""
    stiff = np.diag([1e6, 1e6, k, 1e3, 1e3, 1e3])
    up = np.eye(6)[:, [2]]
    body = np.diag([m, m, m, 1e-9, 1e-9, 1e-9])
    # Two beams that share the load: half the stiffness each.
    hung = MountedTaxel(body, [(stiff / 2, up), (stiff / 2, up)], up[:, 0])
    modes = coupled_modes(np.array([[frame_k]]), np.array([[frame_m]]), [hung])
    return modes, np.array([[frame_k + k, -k], [-k, k]]), np.diag([frame_m, m])


def test_two_masses_are_the_closed_form():
    k = 120.0
    m = 1e-3
    frame_k = 4e3
    frame_m = 7e-3
    modes, stiffness, mass = one_above_the_other(k, m, frame_k, frame_m)
    total = k / m + (k + frame_k) / frame_m
    root = np.sqrt(total**2 / 4 - k * frame_k / m / frame_m)
    seen = np.abs(modes.motion[0]) > 1e-6
    assert np.allclose(np.sort(modes.square[seen]), [total / 2 - root, total / 2 + root], rtol=1e-12)
    hertz = 50.0
    q = 12.0
    direct = np.linalg.solve(stiffness * (1 + 1j / q) - (2 * np.pi * hertz) ** 2 * mass, [0, 1])[1]
    assert modes.receptance(0, np.array([hertz]), q)[0, 0] == pytest.approx(direct, rel=1e-9)


@pytest.mark.parametrize("clamping, channel", REDUCED)
def test_shift_and_crosstalk_are_the_full_reductions(pads, plan, clamping, channel):
    lowest, highest, below = REDUCED[clamping, channel]
    found = 100 * np.array(shifts(plan, pads[clamping], channel))
    assert np.allclose([found.min(), found.max()], [lowest, highest], rtol=0.25, atol=0.02)
    driven = central_taxels(plan)[channel]
    level = crosstalk_db(plan, pads[clamping][0], driven)
    assert level[driven] == 0
    # Taxels of one channel in the two coils move each other through ways that cancel: 10 dB less than reduced.
    unlike = np.array([taxel.channel != channel for taxel in plan.taxels])
    if clamping == "corners":
        assert np.allclose(level[unlike], np.insert(below, driven, 0.0)[unlike], atol=1)


def test_a_held_sub_cell_resonates_as_planned(pads, plan):
    for taxel in central_taxels(plan):
        # Lower by the give of the rib behind the root, which the beam model has as well.
        share = peak_hz(plan, pads["corners"][1], taxel) / plan.channels[plan.taxels[taxel].channel].resonance_hz
        assert 0.98 < share < 1


@pytest.mark.parametrize("clamping", CLAMPINGS)
def test_the_bound_of_the_shift_holds(pads, plan, clamping):
    for channel, bound in enumerate(flexibility_bounds(plan, clamping)):
        largest = np.abs(shifts(plan, pads[clamping], channel)).max()
        assert largest <= bound <= 20 * largest


def test_a_frame_that_is_glued_down_carries_least(pads, plan):
    def loudest(clamping):
        return min(np.sort(crosstalk_db(plan, pads[clamping][0], k))[1] for k in central_taxels(plan))

    assert loudest("bottom") > 20 + max(loudest("edges"), loudest("corners"))


def bare_frame_hz(plan, clamping):
    """Return the lowest mode of the frame without taxels."""
    mesh = meshed(_frame_solid(plan, clamping), MESH, "frame", set())
    material = plan.spec.material
    plastic = Elastic(material.youngs_modulus_gpa * GPA, material.poisson_ratio, material.density_g_per_cm3 * G_PER_CM3)
    system = assembled_system(mesh, {".*": plastic}, 2, HELD)
    return float(eigenmodes(system, factored(system), 3).frequency_hz[0])


@pytest.mark.soak
def test_the_estimate_of_the_frames_own_mode_is_low(plan, worker):
    # A plate's formulas on a grid of ribs with all taxels riding on it, meant to be low.
    for clamping in ("edges", "corners"):
        lowest = worker(bare_frame_hz, plan, clamping)
        assert lowest / 10 < min(frame_around(plan, c, clamping).mode_hz for c in plan.channels) < lowest
    assert frame_around(plan, plan.channels[0], "bottom").mode_hz == float("inf")
