"""Compare the temperatures of warm pads with closed forms and a 3-D heat solution.

| what | must equal | to | because |
|---|---|---|---|
| rise of a pad that conducts well | root of its balance, films of docs/measure_warm.py | 0.1 % | the same films |
| rise beside a line of heat | e^(−x/√(S/g)), a fin's | 1 % | 200 cells, six decay lengths |
| rises of coils and beams | a 3-D heat solution (docs/measure_warm.py, 1.25 mm) | 30 % | as plans state |
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from padgen import cli
from padgen.physics.warmth import WarmLayers, temperatures
from padgen.planner import Plan, make_plan, plan_from_json, plan_to_json
from padgen.planner.warm_pad import planned_warmth
from padgen.spec import load_spec, make_spec

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))
import measure_warm

FOUR_LINES = {"name": "loud", "resolution": 32, "band_hz": [50, 200], "q_min": 15}


def even_layers(sides_m: np.ndarray, heat_w: float, sheet: float, through: float, below: float) -> WarmLayers:
    """Return a quarter of equal cells."""
    shape = (len(sides_m), len(sides_m))
    share = np.outer(sides_m, sides_m) / sides_m.sum() ** 2
    return WarmLayers(
        sides_m,
        sides_m,
        heat_w * share,
        np.full((2, *shape), sheet),
        through * share,
        below * share,
        np.array([0.01, 0.003]),
        np.ones((2, *shape)),
    )


def test_a_pad_that_conducts_well_is_as_warm_as_its_films_allow():
    side_m = 0.06
    heat_w = 2.0
    below = 0.02
    room_c = 23.0
    layers = even_layers(np.full(4, side_m / 8), heat_w / 4, 1e4, 1e4, below / 4)

    def balance(rise: float) -> float:
        top = side_m**2 * measure_warm.film_up(rise, side_m / 4, room_c)
        sides = 4 * side_m * 0.013 * measure_warm.film_side(rise, 0.013, room_c)
        return (top + sides + below) * rise - heat_w * (1 + 3.93e-3 * (room_c + rise - 20))

    rises = temperatures(layers, room_c) - room_c
    assert np.ptp(rises) < 0.01
    assert rises.mean() == pytest.approx(brentq(balance, 0.1, 500), rel=1e-3)


def test_heat_decays_along_a_sheet_as_in_a_fin():
    cells = 200
    sheet = 2e-3
    g = 200.0
    width_m = np.full(cells, 0.02 / cells)
    area = np.array([[1.0]]) * width_m  # one cell of 1 m in depth, whose films are small beside g
    heat = np.zeros((1, cells))
    heat[0, -1] = 1.0
    lower = np.full((1, cells), sheet)
    layers = WarmLayers(
        width_m,
        np.array([1.0]),
        heat,
        np.stack([lower, lower]),
        np.full((1, cells), 1e-9),
        g * area,
        np.array([1e-6, 1e-6]),
        np.ones((2, 1, cells)),
    )
    rise = temperatures(layers, 23.0)[0, 0] - 23.0
    decay_m = np.sqrt(sheet / g)
    far = 20
    assert rise[-1 - far] / rise[-1 - 2 * far] == pytest.approx(np.exp(far * width_m[0] / decay_m), rel=1e-2)


@pytest.mark.parametrize("name", ["pad-32", "eight"])
def test_coils_and_beams_are_as_warm_as_a_heat_solution_says(name):
    plan = measure_warm.plan_of(name)
    coil_k, beam_k, _ = measure_warm.solved(plan)
    warm = plan.warm
    assert warm.coil_c - warm.room_c == pytest.approx(coil_k, rel=warm.error)
    assert warm.beam_rise_k == pytest.approx(beam_k, rel=warm.error)


def test_hot_beams_are_an_error_with_a_level_that_keeps_them_cool(tmp_path, capsys):
    plan = make_plan(make_spec({**FOUR_LINES, "drive": {"level_um": 30}}))
    assert plan.verdict.level == "error"
    finding = next(one for one in plan.findings if one.code == "pad.hot")
    assert not any(one.code == "pad.warm" for one in plan.findings)  # said once
    assert f"{plan.warm.beam_rise_k * 0.7:.3f}"[:4] in finding.message
    level_um = finding.cures[0]["drive.level_um"]
    cool = make_plan(make_spec({**FOUR_LINES, "drive": {"level_um": level_um}}))
    assert not any(one.code in ("pad.hot", "pad.warm") for one in cool.findings)
    spec = tmp_path / "loud.toml"
    spec.write_text('name = "loud"\nresolution = 32\nband_hz = [50, 200]\nq_min = 15\n[drive]\nlevel_um = 30\n')
    assert cli.run(["plan", str(spec), "-o", str(tmp_path / "out")]) == 1
    assert "does not work" in capsys.readouterr().out


def test_what_is_borne_follows_plastic_and_room():
    def codes(**fields) -> set[str]:
        """Return the findings on warmth of a loud pad."""
        plan = make_plan(make_spec({**FOUR_LINES, "drive": {"level_um": 30}, **fields}))
        return {one.code for one in plan.findings if one.code in ("pad.hot", "pad.warm")}

    unknown = {"name": "own", "process": "fdm", "youngs_modulus_gpa": 3, "poisson_ratio": 0.36}
    unknown |= {"density_g_per_cm3": 1.24, "fatigue_stress_mpa": 12}
    assert codes() == {"pad.hot"}
    assert codes(material={**unknown, "glass_c": 300}) == set()
    assert codes(material=unknown) == set()
    assert codes(material={**unknown, "glass_c": 300}, limits={"room_c": 60}) == set()
    assert codes(material={**unknown, "glass_c": 110}, limits={"room_c": 60}) == {"pad.hot"}


def test_warm_resonances_fall_with_the_plastic():
    plan = make_plan(load_spec("pad-32"))
    warm = plan.warm
    share = [hz / channel.resonance_hz - 1 for hz, channel in zip(warm.resonances_hz, plan.channels, strict=True)]
    softening = plan.spec.material.softening_per_k
    assert np.mean(share) == pytest.approx(-softening / 2 * (warm.mean_beam_c - warm.room_c), rel=1e-6)
    assert warm.resonance_shift == pytest.approx(-softening / 2 * warm.beam_rise_k)
    assert min(share) >= warm.resonance_shift
    assert next(one for one in plan.left_out if one.term == "warmth").bound == pytest.approx(-warm.resonance_shift)


def test_a_grid_of_odd_counts_is_as_warm_as_its_even_neighbours():
    def rise_k(coils: int) -> float:
        plan = make_plan(load_spec("pad-32"))
        side_mm = plan.spec.pad.width_mm / plan.coils.columns * coils
        spec = replace(plan.spec, pad=replace(plan.spec.pad, width_mm=side_mm, depth_mm=side_mm))
        grid = replace(plan.coils, rows=coils, columns=coils)
        return planned_warmth(replace(plan, spec=spec, coils=grid)).beam_rise_k

    rises = [rise_k(coils) for coils in (6, 7, 8)]
    assert rises[0] < rises[1] < rises[2]
    assert rises[1] == pytest.approx((rises[0] + rises[2]) / 2, rel=0.02)


def test_a_plan_file_keeps_its_temperatures():
    plan: Plan = make_plan(load_spec("paper-16"))
    again = plan_from_json(plan_to_json(plan)).warm
    assert again.beam_c == pytest.approx(plan.warm.beam_c, rel=1e-9)
    assert again.resonances_hz == pytest.approx(plan.warm.resonances_hz, rel=1e-9)
