"""Rectangular coils on a board: R, L and pull against sums over the drawn tracks, their distances, and refusals."""

from itertools import pairwise

import magpylib
import numpy as np
import pytest
from scipy.spatial import KDTree

import padgen as pg
from padgen.core.errors import SpecError
from padgen.core.units import COPPER_OHM_M, MM
from padgen.physics.board_coil import (
    board_layers,
    board_source,
    inductance,
    layer_current_shares,
    layer_resistances,
)
from padgen.physics.magnet_pull import magnet_pull
from padgen.physics.magnetics import mutual_error, mutual_inductance
from padgen.physics.magnets import DiscMagnet
from padgen.planner.board_layout import coil_path
from padgen.planner.coils.board import board_coil, completed
from padgen.spec import catalogue, make_spec
from tests.board_oracles import Filaments, points_of

PAD = {"name": "board", "resolution": 32, "band_hz": [80, 320], "q_min": 15, "delta_y": 5, "magnet": "disc-3x1"}


def random_coil(rng, shape="rectangular"):
    """Return a coil of any house's layers; of one in three rectangular ones both sides are alike."""
    house = catalogue("board_house")[rng.choice(list(catalogue("board_house")))]
    width_mm = float(rng.uniform(7, 14))
    depth_mm = width_mm if rng.random() < 0.3 else float(rng.uniform(7, 14))
    return completed(
        {
            "kind": "board",
            "shape": shape,
            "house": house["name"],
            "wiring": str(rng.choice(["series", "parallel"])),
            "layers": int(rng.choice(house["layers"])),
            "length_mm": float(rng.choice(house["thickness_mm"])),
            "outer_diameter_mm": width_mm,
            **({"outer_depth_mm": depth_mm} if shape == "rectangular" else {}),
            "track_mm": house["track_mm"] * float(rng.uniform(1, 2)),
        }
    )


def filaments_of(coil, step_mm):
    tracks, _ = coil_path(coil, 1, (0.0, 0.0))
    return Filaments(coil, tracks, layer_current_shares(coil), step_mm)


def bends_ohm(coil):
    """Return by how much R is less than that of the tracks' middle lines: 0.44 squares a right angle, 0.09 at 45°."""
    share = layer_current_shares(coil)
    less = 0.0
    for k, copper in enumerate(coil.copper):
        own = [track for track in coil_path(coil, 1, (0.0, 0.0))[0] if track.layer == k]
        for one, other in pairwise(own):
            if one.end_mm == other.start_mm:
                a, b = (np.subtract(track.end_mm, track.start_mm) for track in (one, other))
                turn = np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))
                less += COPPER_OHM_M / copper * share[k] ** 2 * np.interp(turn, [0, 45, 90], [0, 0.089, 0.4413])
    return less


def off_tracks(coil, step_mm):
    """Return the relative differences of R and L from sums over the drawn tracks, links included."""
    filaments = filaments_of(coil, step_mm)
    stated = float((np.array(layer_resistances(coil)) * layer_current_shares(coil) ** 2).sum())
    ohm = filaments.resistance(COPPER_OHM_M) - bends_ohm(coil)
    return ohm / stated - 1, filaments.inductance() / inductance(coil) - 1


@pytest.mark.parametrize("seed", range(4))
def test_resistance_and_inductance_are_those_of_the_tracks(seed):
    """The bars are R within 1 % and L within 3 %; a step of 0.4 mm errs by less than 0.5 % of L."""
    coil = board_coil(random_coil(np.random.default_rng(seed)))
    of_r, of_l = off_tracks(coil, 0.4)
    assert abs(of_r) < 2e-3 and abs(of_l) < 0.03


@pytest.mark.soak
def test_fifty_random_coils():
    rng = np.random.default_rng(36)
    off = np.array([off_tracks(board_coil(random_coil(rng)), 0.3) for _ in range(50)])
    print("R and L of 50 rectangular coils, worst and median:", np.abs(off).max(0), np.median(np.abs(off), 0))
    assert np.abs(off[:, 0]).max() < 0.01 and np.abs(off[:, 1]).max() < 0.03


@pytest.mark.parametrize("shape", ["round", "rectangular"])
def test_pull_is_that_of_the_tracks(shape):
    """On the axis within 0.5 %, beside it within the error stated; side force and moment by the same measure.

    magpylib has the magnet's field; the forces on the tracks add up by Biot and Savart.
    """
    rng = np.random.default_rng(4)
    worst = 0.0
    for _ in range(8):
        coil = board_coil(random_coil(rng, shape))
        gap, diameter, height = rng.uniform(0.5, 2) * MM, rng.uniform(2, 5) * MM, rng.uniform(1, 2) * MM
        places = np.array([(0, 0), (1, 0), (2, 2), (-3, 2.5), (3.5, -3.5), (0, -2), (13, 3), (-6, 14)]) * MM
        there = DiscMagnet(diameter, 0.0, height, 1.2)
        here = magnet_pull(board_source(coil), there, np.full(len(places), gap), places)
        filaments = filaments_of(coil, 0.15)
        allowed = here.error[0]
        for k, (x, y) in enumerate(places):
            magnet = magpylib.magnet.Cylinder(
                polarization=(0, 0, 1.2), dimension=(diameter, height), position=(x, y, gap + height / 2)
            )
            flow = filaments.step * filaments.current[:, None]
            on_tracks = np.cross(flow, magnet.getB(filaments.middle))
            force = on_tracks.sum(0)
            moment = np.cross(filaments.middle - (x, y, gap), on_tracks).sum(0)
            out = places[k] / max(np.hypot(x, y), 1e-12)
            left = np.array([-out[1], out[0]])
            assert abs(force[2] - here.force[k]) < allowed
            assert abs(-force[:2] @ out - here.side[k]) < allowed
            assert abs(-force[:2] @ left - here.side_across[k]) < allowed
            # The axis of a moment that lowers the left side is the way inwards.
            assert abs(-moment[:2] @ left - here.moment[k]) < allowed * diameter
            assert abs(moment[:2] @ out - here.moment_across[k]) < allowed * diameter
            if k == 0:
                worst = max(worst, abs(force[2] / here.force[0] - 1))
    assert worst < 5e-3


def test_slope_is_the_difference_of_pulls():
    source = board_source(board_coil(random_coil(np.random.default_rng(2))))
    gap = np.array([0.999, 1.0, 1.001])[:, None] * MM
    place = np.array([[0.0, 0.0], [2e-3, 1e-3], [-3e-3, 3e-3]])
    disc = DiscMagnet(3e-3, 1e-3, 1e-3, 1.2)
    low, middle, high = (magnet_pull(source, disc, np.full(3, each[0]), place) for each in gap)
    assert (high.force - low.force) / 2e-6 == pytest.approx(middle.slope, rel=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_coils_side_by_side_couple_within_the_bound(seed):
    """Mutual inductance by Neumann's sum over the tracks lies between that of poles and its bound, along both sides."""
    rng = np.random.default_rng(seed)
    coil = board_coil(random_coil(rng))
    one = filaments_of(coil, 0.4)
    for side, way in ((coil.outer_diameter, (1, 0, 0)), (coil.outer_depth, (0, 1, 0))):
        apart = side + 2 * coil.space
        away = one.middle[:, None] - one.middle - apart * np.array(way)
        flow = one.step * one.current[:, None]
        henry = 1e-7 * float(((flow @ flow.T) / np.linalg.norm(away, axis=-1)).sum())
        poles = float(mutual_inductance(board_source(coil), np.array(apart)))
        most = poles * (1 + float(mutual_error(board_source(coil), np.array(apart))))
        assert most < henry < 0


@pytest.mark.parametrize("seed", range(6))
def test_turns_of_a_layer_keep_their_distance(seed):
    """KiCad does not look at the space within a net, so that turns which touch are found here."""
    given = random_coil(np.random.default_rng(10 + seed))
    coil = board_coil(given)
    tracks, vias = coil_path(coil, 1, (0.0, 0.0))
    for k, layer in enumerate(board_layers(coil)):
        own = [track for track in tracks if track.layer == k]
        ends = [index for index, track in enumerate(own) if np.hypot(*track.end_mm) > 0]
        spiral = [own[index] for index in ends if own[index].end_mm != own[0].start_mm]
        spiral = spiral[: -1 if (coil.parallel or 0 < k < len(coil.copper) - 1) else None]
        lines = [points_of(track, 0.05) for track in spiral]
        for a in range(len(lines)):
            beyond = lines[a + 6 :]
            if beyond:
                apart = KDTree(np.concatenate(beyond)).query(lines[a])[0].min()
                assert apart - coil.track / MM > coil.space / MM - 2e-3
        whole = KDTree(np.concatenate(lines[:-1]))
        for via in vias:
            free = whole.query([via.at_mm])[0][0] - coil.track / MM / 2 - coil.via / MM / 2
            assert free > coil.space / MM - 5e-3, (k, via)
        x, y = np.abs(np.concatenate(lines)).max(0) * MM + coil.track / 2
        assert x < coil.outer_diameter / 2 + 1e-9 and y < coil.outer_depth / 2 + 1e-9
        turning = sum((line[:-1, 0] * line[1:, 1] - line[:-1, 1] * line[1:, 0]).sum() for line in lines)
        assert np.sign(turning) == layer.sense


@pytest.mark.parametrize(
    "fields, where",
    [
        ({"shape": "square"}, "coil.shape"),
        ({"outer_depth_mm": 9}, "coil.outer_depth_mm"),
        ({"shape": "rectangular", "outer_depth_mm": 9}, "coil.outer_depth_mm"),
        ({"shape": "rectangular", "outer_diameter_mm": 9, "outer_depth_mm": 2}, "coil.outer_depth_mm"),
        ({"shape": "rectangular", "outer_diameter_mm": 2, "outer_depth_mm": 9}, "coil.outer_diameter_mm"),
        ({"shape": "rectangular", "outer_diameter_mm": 2}, "coil.outer_diameter_mm"),
    ],
)
def test_refusals_have_cures_that_do(fields, where):
    with pytest.raises(SpecError) as refused:
        make_spec({**PAD, "coil": {"kind": "board", **fields}})
    assert refused.value.where == where
    for one in refused.value.cures:
        changed = {"kind": "board", **fields} | {key.removeprefix("coil."): value for key, value in one.items()}
        completed({key: value for key, value in changed.items() if value is not None})


@pytest.mark.parametrize(
    "table", [{"coil": {"shape": "rectangular"}}, {"coil": {"kind": "board", "shape": "rectangular"}}]
)
def test_washers_and_wound_coils_are_round(table):
    with pytest.raises(SpecError) as refused:
        make_spec({key: value for key, value in PAD.items() if key != "magnet"} | table)
    assert refused.value.where == "coil.shape" and {"coil.shape": "round"} in refused.value.cures


def test_a_rectangular_coil_takes_less_power_of_the_same_grid():
    """Its corners reach movers that lie off the axis in both directions: a third of the heat, or less."""
    plans = [
        pg.plan({**PAD, "coil": {"kind": "board", "grid": [4, 4], "shape": shape}})
        for shape in ("round", "rectangular")
    ]
    round_one, rectangular = (plan.load.copper_loss_w for plan in plans)
    assert rectangular < round_one / 3
    assert plans[1].spec.coil.outer_depth_mm > plans[1].spec.coil.outer_diameter_mm
