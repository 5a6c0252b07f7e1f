"""Coils on a board whose size the spec leaves open: they have room, and take no more power than others that work.

| what | must equal | to | because |
|---|---|---|---|
| heat of the coils found | the least of diameters 0.5 mm apart that work as well | 40 % more | steps of 7 % |
| a coil's figures | those of a spec that gives its diameter | exact | the same formulas |
"""

import random
from dataclasses import replace

import numpy as np
import pytest

from padgen.core.errors import InfeasibleError, PadgenError, SpecError
from padgen.planner import make_plan
from padgen.planner.board_layout import board_of
from padgen.planner.coils.board import resized
from padgen.planner.coils.board import widest_mm as widest_mm_of
from padgen.planner.cures import varied
from padgen.spec import load_spec, make_spec
from padgen.spec.load import as_table, laid_over, without_none

OPEN = {"name": "open", "band_hz": [80, 320], "q_min": 15, "magnet": "disc-3x1", "coil": {"kind": "board"}}
WARNINGS = ("print.share", "print.life")


def kinds(plan):
    return {finding.code for finding in plan.findings if finding.level != "note"}


@pytest.mark.parametrize(
    ("taxels", "coil", "diameters_mm"),
    [(32, {"grid": [5, 4], "reuse": "alternate"}, np.arange(8, 10, 0.5)), (9, {"grid": [3, 3]}, np.arange(4, 15, 0.5))],
)
def test_coils_take_little_more_power_than_any_that_work_as_well(taxels, coil, diameters_mm):
    table = {**OPEN, "resolution": taxels, "coil": {"kind": "board", "gap_mm": 1, **coil}}
    spec = make_spec(table)
    assert spec.coil.sizing == "auto"
    plan = make_plan(spec, tries_cures=False)
    assert plan.spec.coil.sizing == "given"
    heat_w = []
    for diameter_mm in diameters_mm.tolist():
        given = make_spec({**table, "coil": {**table["coil"], "outer_diameter_mm": diameter_mm}})
        try:
            other = make_plan(given, tries_cures=False)
        except PadgenError:
            continue
        if not (kinds(other) - kinds(plan)) & {*WARNINGS, "board.room"}:
            heat_w.append(other.load.copper_loss_w)
    assert len(heat_w) >= 2
    assert plan.load.copper_loss_w < 1.4 * min(heat_w)


def test_a_wider_coil_is_left_for_one_that_leaks_less():
    # Coils of 15.1 mm, for which the cells have room, leak so much that few prints keep what is asked.
    table = {**OPEN, "resolution": 9, "coil": {"kind": "board", "grid": [3, 3]}}
    plan = make_plan(make_spec(table), tries_cures=False)
    assert "print.share" not in kinds(plan)
    widest = make_plan(make_spec({**table, "coil": {**table["coil"], "outer_diameter_mm": 15.1}}), tries_cures=False)
    assert "print.share" in kinds(widest)


def test_coils_that_burn_are_left_for_ones_that_do_not():
    # Prints of this pad work with the widest coils, but these take 2.5 W and bear 0.2 W.
    table = {
        **OPEN,
        "resolution": 4,
        "coil": {"kind": "board", "grid": [2, 1], "gap_mm": 2},
        "pad": {"width_mm": 80, "depth_mm": 80},
        "drive": {"level_um": 60},
    }
    assert "coil.heat" not in kinds(make_plan(make_spec(table), tries_cures=False))


def test_pads_that_work_with_narrower_coils_need_no_more_coils():
    # With the widest for which 4 x 4 cells have room, 10.4 mm, no print works.
    table = {**OPEN, "resolution": 32}
    given = {"kind": "board", "grid": [4, 4], "reuse": "alternate", "gap_mm": 1, "outer_diameter_mm": 9.6}
    assert "print.share" not in kinds(make_plan(make_spec({**table, "coil": given}), tries_cures=False))
    plan = make_plan(make_spec(table), tries_cures=False)
    assert "print.share" not in kinds(plan)
    assert plan.coils.rows * plan.coils.columns <= 16


@pytest.mark.parametrize("case", range(6))
def test_boards_of_the_widest_coils_have_room_for_tracks_and_screws(case):
    drawn = random.Random(case)
    house = drawn.choice(["coil-0.15", "fine-0.1", "fine-0.127", "heavy-0.2"])
    rows = drawn.randint(1, 6)
    columns = drawn.randint(1, 6)
    table = {
        **OPEN,
        "resolution": rows * columns,
        "band_hz": [150, 300],
        "coil": {"kind": "board", "house": house, "grid": [rows, columns]},
        "pad": {"width_mm": columns * drawn.uniform(11, 15), "depth_mm": rows * drawn.uniform(11, 15)},
    }
    spec = make_spec(table)
    plan = make_plan(spec, tries_cures=False)
    assert "board.room" not in kinds(plan)
    widest_mm = widest_mm_of(spec.coil, spec.pad, rows, columns)[0]
    assert plan.spec.coil.outer_diameter_mm <= widest_mm
    widest = replace(plan, spec=replace(plan.spec, coil=resized(plan.spec.coil, (widest_mm, widest_mm))))
    assert plan.coils.pitch_y_mm - widest_mm > spec.coil.space_mm
    assert board_of(widest).lane_mm >= spec.coil.track_mm - 1e-9


def test_the_coil_found_is_the_one_that_a_spec_with_its_diameter_has():
    plan = make_plan(make_spec({**OPEN, "resolution": 9}), tries_cures=False)
    coil = plan.spec.coil
    given = make_spec({**OPEN, "resolution": 9, "coil": {"kind": "board", "outer_diameter_mm": coil.outer_diameter_mm}})
    assert replace(given.coil, gap_mm=coil.gap_mm, reuse=coil.reuse) == coil


def test_figures_that_the_spec_gives_stay():
    table = {**OPEN, "resolution": 9, "coil": {"kind": "board", "power_limit_w": 0.2, "layers": 2, "track_mm": 0.2}}
    coil = make_plan(make_spec(table), tries_cures=False).spec.coil
    assert (coil.power_limit_w, coil.layers, coil.track_mm) == (0.2, 2, 0.2)


@pytest.mark.parametrize("sizing", ["auto", "given"])
def test_a_cure_of_the_board_is_planned_with_the_figures_that_follow(sizing):
    table = {**OPEN, "resolution": 9}
    if sizing == "given":
        table["coil"] = {"kind": "board", "outer_diameter_mm": 9.6}
    for cure in ({"coil.house": "fine-0.1"}, {"coil.layers": 2}, {"coil.outer_diameter_mm": 8.0}):
        asked = {**table["coil"], **{name.removeprefix("coil."): value for name, value in cure.items()}}
        assert varied(make_spec(table), cure) == make_spec({**table, "coil": asked})


@pytest.mark.parametrize("coil", [{"sizing": "auto", "outer_diameter_mm": 9}, {"sizing": "given"}])
def test_a_diameter_and_how_it_is_found_may_not_disagree(coil):
    table = {**OPEN, "resolution": 9}
    with pytest.raises(SpecError) as caught:
        make_spec({**table, "coil": {"kind": "board", **coil}})
    assert caught.value.where == "coil.sizing"
    assert len(caught.value.cures) == 2
    for cure in caught.value.cures:
        make_spec(without_none(laid_over({**table, "coil": {"kind": "board", **coil}}, cure)))


@pytest.mark.parametrize("diameter_mm", [20, 70])
def test_it_is_said_where_leaving_out_the_diameter_would_do(diameter_mm):
    table = {**OPEN, "resolution": 36, "pad": {"width_mm": 64, "depth_mm": 64}}
    spec = make_spec({**table, "coil": {"kind": "board", "outer_diameter_mm": diameter_mm}})
    cure = {"coil.outer_diameter_mm": None}
    try:
        cures = next(f.cures for f in make_plan(spec).findings if f.code == "board.room")
    except InfeasibleError as error:
        cures = error.cures
    assert cure in cures
    assert varied(spec, cure) == make_spec(table)


def test_a_spec_is_what_its_table_makes():
    for table in (OPEN, {**OPEN, "coil": {"kind": "board", "outer_diameter_mm": 9}}):
        spec = make_spec({**table, "resolution": 9})
        assert make_spec(as_table(spec)) == spec


def test_a_wound_coil_has_the_size_that_is_given():
    with pytest.raises(SpecError, match="must be 'given' of coils of kind 'solenoid'") as caught:
        make_spec({**OPEN, "resolution": 9, "coil": {"sizing": "auto"}})
    assert caught.value.where == "coil.sizing"


def test_a_template_that_gives_a_diameter_keeps_it():
    assert load_spec("board-32").coil.sizing == "given"
