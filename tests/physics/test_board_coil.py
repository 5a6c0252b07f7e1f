"""Coils on a board: R, L and pull against sums over the drawn tracks, what is worked out, and what is refused."""

import json
from math import cos, pi

import magpylib
import numpy as np
import pytest

import padgen as pg
from padgen.core.errors import SpecError
from padgen.core.units import COPPER_OHM_M, MM
from padgen.physics.board_coil import (
    board_layers,
    board_source,
    inductance,
    layer_current_shares,
    layer_resistances,
    resistance,
)
from padgen.physics.magnet_pull import magnet_pull
from padgen.physics.magnets import DiscMagnet
from padgen.planner import plan_to_json
from padgen.planner.board_layout import coil_path
from padgen.planner.coils.board import board_coil, completed
from padgen.spec import catalogue, make_spec
from padgen.spec.load import without_none
from tests.board_oracles import Filaments, points_of

PAD = {"name": "board", "resolution": 32, "band_hz": [80, 320], "q_min": 15, "delta_y": 5, "magnet": "disc-3x1"}


def random_coil(rng):
    house = catalogue("board_house")[rng.choice(list(catalogue("board_house")))]
    given = {"kind": "board", "house": house["name"], "wiring": str(rng.choice(["series", "parallel"]))}
    given["layers"] = int(rng.choice(house["layers"]))
    given["length_mm"] = float(rng.choice(house["thickness_mm"]))
    given["outer_diameter_mm"] = float(rng.uniform(7, 14))
    given["track_mm"] = house["track_mm"] * float(rng.uniform(1, 2))
    given["inner_diameter_mm"] = float(rng.uniform(2.8, 3.5))
    return completed(given)


def filaments_of(coil, step_mm):
    tracks, _ = coil_path(coil, 1, (0.0, 0.0))
    return Filaments(coil, tracks, layer_current_shares(coil), step_mm)


@pytest.mark.parametrize("seed", range(3))
def test_resistance_and_inductance_are_those_of_the_tracks(seed):
    """The bars are R within 1 % and L within 3 %; a step of 0.4 mm errs by less than 0.5 % of L."""
    coil = board_coil(random_coil(np.random.default_rng(seed)))
    filaments = filaments_of(coil, 0.4)
    share = layer_current_shares(coil)
    tracks = float((np.array(layer_resistances(coil)) * share**2).sum())
    assert filaments.resistance(COPPER_OHM_M) == pytest.approx(tracks, rel=2e-3)
    assert resistance(coil) > tracks
    assert filaments.inductance() == pytest.approx(inductance(coil), rel=0.03)


@pytest.mark.soak
def test_fifty_random_coils():
    rng = np.random.default_rng(36)
    off = []
    for _ in range(50):
        coil = board_coil(random_coil(rng))
        filaments = filaments_of(coil, 0.3)
        tracks = float((np.array(layer_resistances(coil)) * layer_current_shares(coil) ** 2).sum())
        off.append((filaments.resistance(COPPER_OHM_M) / tracks - 1, filaments.inductance() / inductance(coil) - 1))
    worst = np.abs(off).max(0)
    print("R and L of 50 coils, worst and median:", worst, np.median(np.abs(off), 0))
    assert worst[0] < 0.01 and worst[1] < 0.03


def test_pull_is_that_of_the_tracks():
    """Flat windings of even current pull as the tracks do, on the axis within 0.5 % half a millimetre away and more."""
    rng = np.random.default_rng(4)
    worst = 0.0
    for _ in range(8):
        coil = board_coil(random_coil(rng))
        gap, diameter, height = rng.uniform(0.5, 2) * MM, rng.uniform(2, 5) * MM, rng.uniform(1, 2) * MM
        magnet = magpylib.magnet.Cylinder(
            polarization=(0, 0, 1.2), dimension=(diameter, height), position=(0, 0, gap + height / 2)
        )
        there = DiscMagnet(diameter, 0.0, height, 1.2)
        here = magnet_pull(board_source(coil), there, np.array([gap]), np.zeros(1)).force[0]
        worst = max(worst, abs(filaments_of(coil, 0.2).force(magnet) / here - 1))
    assert worst < 5e-3


def test_turns_of_a_layer_keep_their_distance():
    """KiCad does not look at the space within a net, so that turns which touch are found here."""
    coil = board_coil(completed({"kind": "board", "layers": 6}))
    tracks, vias = coil_path(coil, 1, (0.0, 0.0))
    for k, layer in enumerate(board_layers(coil)):
        own = [track for track in tracks if track.layer == k]
        arcs = [points_of(track, 0.05) for track in own if track.middle_mm]
        for a in range(len(arcs)):
            for b in range(a + 2, len(arcs)):
                apart = np.sqrt(((arcs[a][:, None] - arcs[b]) ** 2).sum(-1)).min()
                assert apart - coil.track / MM > coil.space / MM - 2e-3
        for via in vias:
            free = min(np.sqrt(((arc - via.at_mm) ** 2).sum(1)).min() for arc in arcs)
            assert free - coil.track / MM / 2 - coil.via / MM / 2 > coil.space / MM - 5e-3, (k, via)
        # It ends where it should, and all its turns go round in one sense, the same on every layer for the current.
        x, y = points_of([track for track in own if track.middle_mm][-1], 0.05)[-1]
        assert x * cos(layer.end_angle) >= -1e-6 and np.hypot(x, y) * MM + coil.track / 2 <= coil.outer_diameter / 2
        turning = sum((arc[:-1, 0] * arc[1:, 1] - arc[:-1, 1] * arc[1:, 0]).sum() for arc in arcs)
        assert np.sign(turning) == layer.sense == (-1 if k % 2 == 0 else 1)
    assert len(vias) == 5


def test_one_turn_is_a_ring():
    """Of a wide ring of one turn the inductance is µ₀ r (ln 8r/g − 2), Grover's."""
    coil = board_coil(completed({"kind": "board", "layers": 2, "outer_diameter_mm": 40.0, "inner_diameter_mm": 38.8}))
    one = [layer.turns for layer in board_layers(coil)]
    radius = 0.0197
    ring = 4e-7 * pi * radius * (np.log(8 * radius / (0.2235 * (coil.track + coil.copper[0]))) - 2)
    turns = sum(one)
    assert ring * turns < inductance(coil) < ring * turns**2


def test_two_lines_make_a_pad():
    plan = pg.plan({**PAD, "coil": {"kind": "board"}})
    coil = plan.spec.coil
    assert plan.verdict.is_worth_printing and coil.layers == 4 and coil.length_mm == 1.6
    assert plan.load.copper_loss_w < coil.power_limit_w < 0.1
    # What is recorded makes the same spec again.
    recorded = json.loads(plan_to_json(plan))["spec"]
    assert make_spec(without_none(recorded)).coil == coil


def test_parallel_layers_have_a_quarter_of_the_resistance():
    series, parallel = (completed({"kind": "board", "wiring": wiring}) for wiring in ("series", "parallel"))
    assert parallel.resistance_ohm / series.resistance_ohm == pytest.approx(0.25, rel=0.15)
    assert parallel.turns / series.turns == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize(
    "fields, where, cure",
    [
        ({"house": "fine-0.2"}, "coil.house", None),
        ({"layers": 3}, "coil.layers", {"coil.layers": 2}),
        ({"layers": 8}, "coil.layers", {"coil.layers": 6}),
        ({"length_mm": 1.5}, "coil.length_mm", {"coil.length_mm": 1.6}),
        ({"track_mm": 0.1}, "coil.track_mm", {"coil.track_mm": 0.15}),
        ({"space_mm": 0.1}, "coil.space_mm", {"coil.space_mm": 0.15}),
        ({"copper_um": 105}, "coil.copper_um", {"coil.copper_um": 35.0}),
        ({"inner_diameter_mm": 0.5}, "coil.inner_diameter_mm", {"coil.inner_diameter_mm": None}),
        ({"outer_diameter_mm": 2.0}, "coil.outer_diameter_mm", None),
        ({"resistance_ohm": 7.0}, "coil.resistance_ohm", {"coil.resistance_ohm": None}),
        ({"core_diameter_mm": 1.0}, "coil.core_diameter_mm", {"coil.core_diameter_mm": 0.0}),
        ({"turns": 0.0}, "coil.turns", {"coil.turns": None}),
        ({"turns": "many"}, "coil.turns", {"coil.turns": None}),
    ],
)
def test_refusals_have_a_cure_that_does(fields, where, cure):
    with pytest.raises(SpecError) as refused:
        make_spec({**PAD, "coil": {"kind": "board", **fields}})
    assert refused.value.where == where
    if cure:
        assert cure in refused.value.cures
    for one in refused.value.cures:
        changed = {"kind": "board", **fields}
        for key, value in one.items():
            changed[key.removeprefix("coil.")] = value
        completed({key: value for key, value in changed.items() if value is not None})


def test_thinner_plating_has_more_resistance():
    coil = board_coil(completed({"kind": "board"}))
    assert resistance(coil._replace(plating=coil.plating / 10)) > resistance(coil)
