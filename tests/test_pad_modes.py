"""The pad by reduction: tiles, assembly, modes, crosstalk, and the bound of the frame's flexibility.

Agreement table (what must equal what, and why to that tolerance):

| model | against | tolerance |
|---|---|---|
| turned functions | the functions' formulas at turned points | 1e-12, rounding |
| a row of solid tiles | one box in one mesh | 0.5 %, polynomials of degree 4 between tiles |
| heaving of the free pad | mass of the solids and washers | 0.1 %, quadratic elements on round parts |
| modes by block iteration | dense eigenvalues of the assembled matrices | 2e-5, its error bound of 1e-4 is careful |
| crosstalk | dense complex solve | 0.01 dB, the same equations |
| bound of the shift | shift by reduction | above, and at most 20 times |

Finite elements run in a process of their own, which has no CAD kernel loaded.
"""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import kron
from scipy.sparse.linalg import eigsh

from padgen.core.errors import SolverError
from padgen.core.units import G_PER_CM3, MM
from padgen.planner import Plan, make_plan
from padgen.planner.frame_give import flexibility_bounds, frame_mode_estimate_hz
from padgen.spec import parse_spec
from padgen.verify.elastic_mesh import Fineness, meshed
from padgen.verify.elastic_modes import assembled
from padgen.verify.pad_assembly import Assembly, assembly
from padgen.verify.pad_interface import Degrees, height_shape, interface_functions, plane_shape, quarter_turned
from padgen.verify.pad_modes import crosstalk, driven_taxels, frame_modes_hz, frequency_shifts, pad_modes, receptance
from padgen.verify.pad_reduction import ReducedPad, Resolution, pad_materials, reduced_pad
from padgen.verify.pad_solids import CLAMPINGS, solid_cell, washer_volume_mm3
from padgen.verify.pad_strips import factored, modes_below, solved
from padgen.verify.pad_tiles import Elements, reduced_tile, turned

COARSE = Resolution(Degrees(3, 1), Elements(2))
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


@pytest.fixture(scope="module")
def plan() -> Plan:
    return make_plan(parse_spec(TEXT))


@pytest.fixture(scope="module")
def steps(plan, tmp_path_factory) -> dict[int, Path]:
    from padgen.solid.formats.step import write_taxel_step

    folder = tmp_path_factory.mktemp("steps")
    paths = {channel.index: folder / f"taxel-{channel.index}.step" for channel in plan.channels}
    for channel in plan.channels:
        write_taxel_step(plan, channel, paths[channel.index])
    return paths


@pytest.fixture(scope="module")
def worker():
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        yield lambda function, *given: pool.submit(function, *given).result()


def all_clampings(plan: Plan, steps: dict[int, Path]) -> dict[str, ReducedPad]:
    found: dict[str, ReducedPad] = {}
    for clamping in CLAMPINGS:
        found[clamping] = reduced_pad(plan, steps, clamping, COARSE, found.get("edges"))
    return found


@pytest.fixture(scope="module")
def pads(worker, plan, steps) -> dict[str, ReducedPad]:
    return worker(all_clampings, plan, steps)


def dense(pad: Assembly) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of the whole pad, put together without strips."""
    stiffness, mass = np.zeros((2, pad.size, pad.size))
    for tile in pad.tiles:
        kind, on = pad.kinds[tile.key], tile.interface >= 0
        at = np.concatenate([tile.interface[on], tile.modes])
        coupling, zero = kind.coupling[on], np.zeros((on.sum(), len(tile.modes)))
        stiffness[np.ix_(at, at)] += np.block([[kind.stiffness[np.ix_(on, on)], zero], [zero.T, np.diag(kind.square)]])
        mass[np.ix_(at, at)] += np.block([[kind.mass[np.ix_(on, on)], coupling], [coupling.T, np.eye(len(tile.modes))]])
    return stiffness, mass


def test_a_turned_function_is_the_function_at_turned_points():
    xi, eta, zeta = np.random.default_rng(1).uniform(-1, 1, (3, 20))

    def value(function, x, y):
        place, degree, height, axis = function
        return np.eye(3)[axis][:, None] * plane_shape(place, degree, x, y) * height_shape(height, zeta, False)

    for function in interface_functions(("south", "east", "north", "west"), Degrees(4, 2)):
        other, sign = quarter_turned(function)
        # A point turned by +90° came from (η, -ξ), and its displacement (u, v) is (-v, u).
        u, v, w = value(function, eta, -xi)
        assert np.allclose(sign * value(other, xi, eta), (-v, u, w), atol=1e-12)


def test_functions_vanish_where_tiles_do_not_share_them():
    s = np.linspace(-1, 1, 9)
    sides = {"south": (s, -1 + 0 * s), "north": (s, 1 + 0 * s), "west": (-1 + 0 * s, s), "east": (1 + 0 * s, s)}
    for side in sides:
        for degree in (2, 3, 4, 5):
            for other, (xi, eta) in sides.items():
                assert np.allclose(plane_shape(side, degree, xi, eta), 0) == (other != side)
    assert np.allclose(sum(plane_shape(vertex, 1, s, s[::-1]) for vertex in range(4)), 1)
    assert height_shape(2, -1.0, True) == 0
    assert height_shape(2, -1.0, False) == 1


def row_and_whole(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Free modes in Hz of four solid tiles in a row, and of the same box in one mesh."""
    tile = solid_cell(plan, "free")
    kind = reduced_tile(tile, pad_materials(plan), Degrees(4, 2), Elements(3), 1e3, "tile")
    # Turned by 180° a box is itself: two of them test the signs.
    kinds = {("solid", -1, 0): kind, ("solid", -1, 2): turned(kind, 2)}
    stiffness, mass = dense(assembly(kinds, [[("solid", -1, 0), ("solid", -1, 2)] * 2]))
    reduced = eigh(stiffness, mass, eigvals_only=True)
    from netgen.occ import Box, Pnt

    shape = Box(Pnt(0, 0, 0), Pnt(4 * tile.box.x1, tile.box.y1, tile.box.height))
    shape.solids[0].name = "printed"
    system = assembled(meshed(shape, Fineness(levels=0, largest_mm=tile.box.height)), pad_materials(plan), 3, "none")
    heavy = kron(system.mass, np.eye(3)).tocsc()
    whole = np.sort(eigsh(system.stiffness_blocks().tocsc(), 9, heavy, sigma=-1e6, return_eigenvectors=False))
    return np.sqrt(reduced[6:9]) / (2 * np.pi), np.sqrt(whole[6:9]) / (2 * np.pi)


def test_a_row_of_solid_tiles_is_one_box(worker, plan):
    reduced, whole = worker(row_and_whole, plan)
    assert whole[0] > 1000
    assert np.allclose(reduced, whole, rtol=5e-3)


def test_a_free_pad_moves_as_a_body(pads, plan):
    from padgen.solid.pad_solid import build_pad

    pad = pads["free"].assembly
    heave = np.array(
        [f.axis == 2 and f.height == 0 and p[0] == "vertex" for p, f in zip(pad.places, pad.functions, strict=True)]
    )
    motion = np.zeros((pad.size, 1))
    motion[: len(heave), 0] = heave
    spec = plan.spec
    printed = build_pad(plan).volume_mm3 * spec.material.density_g_per_cm3
    washers = len(plan.taxels) * washer_volume_mm3(plan) * spec.washer.density_g_per_cm3
    planned = (printed + washers) * MM**3 * G_PER_CM3
    assert motion[:, 0] @ pad.times_mass(motion)[:, 0] == pytest.approx(planned, rel=1e-3)
    assert np.allclose(pads["free"].pulls.T @ motion, 1, rtol=1e-3)
    found = pad_modes(pads["free"])
    # Single rounding of a stiffness of 1e6 N/m on a mass of grams: far below 1 Hz.
    assert (found.frequency_hz[:6] < 0.5).all()
    assert found.frequency_hz[6] > 50
    assert (found.frame_share[:6] > 0.999).all()


def test_a_tilted_pad_lifts_each_washer_by_its_place(pads, plan):
    pad, thickness = pads["free"].assembly, plan.spec.pad.frame_thickness_mm
    x = np.array([-18.5, -12.5, 0.0, 12.5, 18.5])
    tilt = np.zeros(pad.size)
    for k, (place, function) in enumerate(zip(pad.places, pad.functions, strict=True)):
        if place[0] == "vertex" and function.height <= 1:
            # u = (-z, 0, x): linear, so that the vertices' functions hold it exactly; P1 in ζ is 2 z/t - 1.
            tilt[k] = {0: -thickness / 2, 2: x[place[1]] * (function.height == 0)}.get(function.axis, 0.0)
    # Millimetres; the fit over the washer's volume is as exact as the quadratic elements' round washer.
    assert np.allclose(pads["free"].pulls.T @ tilt, [taxel.x_mm for taxel in plan.taxels], atol=2e-3)


@pytest.mark.parametrize("clamping", CLAMPINGS)
def test_modes_are_the_dense_ones(pads, clamping):
    pad = pads[clamping]
    square = eigh(*dense(pad.assembly), eigvals_only=True)
    found = pad_modes(pad)
    top = (2 * np.pi * 1.2 * 120) ** 2
    expected = np.sqrt(np.maximum(square[square < top], 0)) / (2 * np.pi)
    assert len(found.frequency_hz) == len(expected)
    assert np.allclose(found.frequency_hz, expected, rtol=2e-5, atol=0.5 if clamping == "free" else 0)
    assert found.error < 1e-4


def test_the_strips_solve_and_count(pads):
    pad = pads["corners"].assembly
    stiffness, mass = dense(pad)
    load = np.random.default_rng(2).normal(size=(pad.size, 3))
    shift = -1e5
    answer = solved(factored(pad, shift), load)
    assert np.allclose((stiffness - shift * mass) @ answer, load, atol=1e-6 * np.abs(load).max())
    assert np.allclose(pad.times_mass(load), mass @ load, rtol=1e-9, atol=1e-12)
    square = eigh(stiffness, mass, eigvals_only=True)
    for below in (0, 1, 3, 8, 20):
        assert modes_below(pad, (square[below] + square[below + 1]) / 2) == below + 1
    with pytest.raises(SolverError, match="above a mode"):
        factored(pad, 2 * square[0])


@pytest.mark.parametrize("clamping", ["corners", "free"])
def test_crosstalk_is_the_direct_solve(pads, plan, clamping):
    pad = pads[clamping]
    found = pad_modes(pad)
    stiffness, mass = dense(pad.assembly)
    pulls = pad.pulls
    for one, driven in zip(crosstalk(pad, found), driven_taxels(pad), strict=True):
        q = plan.channels[plan.taxels[driven].channel].q
        dynamic = stiffness * (1 + 1j / q) - (2 * np.pi * one.resonance_hz) ** 2 * mass
        amplitude = np.abs(pulls.T @ np.linalg.solve(dynamic, pulls[:, driven]))
        assert np.allclose(one.below_db, 20 * np.log10(amplitude[driven] / amplitude), atol=0.01)
        around = np.abs(receptance(found, driven, one.resonance_hz * np.array([0.999, 1, 1.001]), q)[:, driven])
        assert around.argmax() == 1
        assert one.taxel == plan.taxels[driven].id
        near = [t.id for t in plan.taxels if t.coil == plan.taxels[driven].coil and t.id != one.taxel]
        assert one.same_coil is not None and one.same_coil[0] in near


def test_a_free_pad_carries_more_crosstalk(pads):
    def loudest(pad):
        return min(one.below_db[one.below_db > 0].min() for one in crosstalk(pad, pad_modes(pad)))

    assert loudest(pads["free"]) + 20 < loudest(pads["edges"]) < loudest(pads["bottom"])


@pytest.mark.parametrize("clamping", CLAMPINGS)
def test_the_bound_of_the_shift_holds(pads, plan, clamping):
    pad = pads[clamping]
    bounds = flexibility_bounds(plan, clamping)
    for shift, bound in zip(frequency_shifts(pad, pad_modes(pad)), bounds, strict=True):
        largest = max(abs(shift.lowest), abs(shift.highest))
        assert largest <= bound <= 20 * largest


def test_the_frames_own_modes_lie_above_the_estimate(pads, plan):
    for clamping in ("edges", "corners"):
        lowest = frame_modes_hz(pads[clamping], 6000.0)[0]
        estimate = frame_mode_estimate_hz(plan, clamping)
        # A plate's formulas on a grid of ribs, meant to be low: within a factor of five.
        assert lowest / 5 < estimate < lowest
    assert frame_mode_estimate_hz(plan, "bottom") == float("inf")
    assert frame_modes_hz(pads["bottom"], 6000.0).min() > 3000


def sentence(function, *given) -> str:
    try:
        function(*given)
    except SolverError as error:
        return str(error)
    return ""


def test_what_cannot_be_solved_is_said(worker, plan, steps, tmp_path):
    swapped = {0: steps[1], 1: steps[0]}
    other = make_plan(parse_spec(TEXT.replace("width_mm = 25,", "width_mm = 26,")))
    empty = tmp_path / "empty.step"
    empty.write_text("")
    for given, words in (
        ((plan, steps, "glued"), "clamping: must be one of edges, bottom, corners, free, got glued"),
        ((plan, {0: steps[0]}, "edges"), "channel 1: has no STEP file"),
        ((plan, swapped, "edges", COARSE), "it is another taxel's"),
        ((other, steps, "edges", COARSE), "build the plan's own taxels"),
        ((plan, {**steps, 0: empty}, "edges", COARSE), "STEP"),
    ):
        assert words in worker(sentence, reduced_pad, *given)
    with pytest.raises(SolverError, match="must be one of"):
        flexibility_bounds(plan, "glued")


def test_a_limit_must_be_positive(pads):
    with pytest.raises(SolverError, match="must be above 0 Hz"):
        pad_modes(pads["edges"], 0.0)
