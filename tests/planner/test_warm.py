"""Compare the temperatures of warm pads with closed forms and a 3-D heat solution.

| what | must equal | to | because |
|---|---|---|---|
| rise of a pad that conducts well | root of its balance, films of docs/measure_warm.py | 0.1 % | the same films |
| rise beside a line of heat | e^(−x/√(S/g)), a fin's | 1 % | 200 cells, six decay lengths |
| rises of a pad with more heat | larger | exact | physics |
| heat that leaves a pad, films of docs/measure_warm.py | the coils' heat | 0.1 % | rounds end at 0.01 % of the rise |
| rises of coils and beams | a 3-D heat solution (docs/measure_warm.py, 1.25 mm) | 30 % | as plans state |
| loss by a cold table | the receptance at its tones | 1e-6 dB | the same formula |
| loss by a cold file | the pad simulated in time | 0.15 dB | tones beside a constant are not small |
| level by a warm file | the pad simulated in time | 2 % | other modes of a taxel |
"""

import csv
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import padgen as pg
from padgen import cli, drive
from padgen.core.errors import FileError, OlderPlanError, SpecError
from padgen.core.units import COPPER_C, COPPER_MELTS_C, COPPER_PER_K
from padgen.core.wav_reader import read_wav
from padgen.driver.ear import hear
from padgen.driver.formats.wav import wave_json, write_wave
from padgen.driver.loads import judge_load, load_of
from padgen.driver.serial_line import plan_hash
from padgen.driver.waveform import RATES_HZ, drive_at, steady
from padgen.measured.tuning import levels_um, planned_tuning, tuning_from_json, tuning_to_json, warm_tuning
from padgen.physics.warmth import WarmedTable, WarmLayers, temperatures
from padgen.planner import Plan, plan_from_json, plan_to_json
from padgen.planner.warm_pad import planned_warmth, warm_layers
from padgen.report.plans import summary_text
from padgen.spec import make_spec

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
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


@pytest.mark.parametrize("sides_m", [(0.06, 0.06), (0.1, 0.04)])
def test_a_table_takes_from_a_plate_and_from_a_spot_what_a_half_space_does(sides_m):
    """A square plate on a half-space conducts 2.31 k per side (0.367 · 2π, its capacitance); a spot as if alone."""
    wide, deep = sides_m
    count = 12
    patches = np.arange(count)
    layers = even_layers(np.full(count, wide / 2 / count), 0.0, 1.0, 1.0, 1e9)._replace(
        depth_m=np.full(count, deep / 2 / count), ground_w_per_m_k=0.15, patch_row=patches, patch_column=patches
    )
    plate = 4 * WarmedTable(layers).flow(np.ones((count, count))).sum()
    if wide == deep:
        assert plate == pytest.approx(0.367 * 2 * np.pi * 0.15 * wide, rel=0.03)
    # Of all plates of an area the disc, 4 k r, conducts least (Pólya and Szegő); one 2.5 times as long not much more.
    disc = 4 * 0.15 * np.sqrt(wide * deep / np.pi)
    assert disc < plate < 1.1 * disc
    # Only the middle third touches.
    spot = np.zeros((count, count))
    spot[-4:, -4:] = 1e6  # W/K
    alone = 4 * WarmedTable(layers._replace(below_w_per_k=spot)).flow(np.ones((count, count))).sum()
    if wide == deep:
        assert alone == pytest.approx(0.367 * 2 * np.pi * 0.15 * wide / 3, rel=0.05)
    assert alone > 1.5 * plate / 9


def test_a_coil_that_heats_itself_without_end_is_told_as_too_hot():
    # Of 905 kΩ: copper resists more the hotter it is, so that no temperature balances its heat.
    four_lines = {"name": "hot", "resolution": 8, "band_hz": [50.0, 200.0], "q_min": 15.0}
    coil = {"resistance_ohm": 905564.0, "layers": 2}
    plan = pg.plan(make_spec(four_lines | {"pad": {"border_mm": 37.0}, "coil": coil, "taxel": {"glue_mg": 862.0}}))
    assert plan.warm.coil_c > 1000
    assert {"coil.heat", "pad.hot"} <= {finding.code for finding in plan.findings if finding.level == "error"}
    assert "coils burn" in summary_text(plan)


def test_more_heat_makes_coils_and_beams_warmer_however_hot_they_are():
    # Where they radiate most, whole steps from one film to the next swing from cold to hot without end.
    layers = warm_layers(pg.plan("pad-32"))
    rises = []
    for heat_w in (0.1, 1.0, 5.0, 20.0, 100.0):
        hot = temperatures(layers._replace(heat_w=layers.heat_w / layers.heat_w.sum() * heat_w), 23.0)
        rises.append(hot.max((1, 2)) - 23.0)
    assert (np.diff(rises, axis=0) > 0).all()


@pytest.mark.parametrize("name", ["wide-11", "fingertip-24"])
@pytest.mark.parametrize("times", [1, 5, 30, 200])
def test_as_much_heat_leaves_as_coils_make_however_hot_they_are(name, times):
    # Of thirty times their heat coils of wide-11 came out at 950 °C, where 1310 balance it.
    layers = warm_layers(pg.plan(name))
    layers = layers._replace(heat_w=layers.heat_w * times)
    room_c = 23.0
    warm_c = temperatures(layers, room_c)
    area = np.outer(layers.depth_m, layers.width_m)
    half_m = layers.width_m.sum(), layers.depth_m.sum()
    pad_k = np.average(warm_c[1], weights=area) - room_c

    def off_top(top_k):
        return top_k * measure_warm.film_up(top_k, half_m[0] * half_m[1] / sum(half_m), room_c)

    # From the middle of the pad heat flows through half of it, and then off its top.
    to_top = layers.to_top_w_per_m2_k
    leaving_w = area.sum() * off_top(brentq(lambda top_k: to_top * (pad_k - top_k) - off_top(top_k), 0, pad_k))
    for sheet_c, height_m in zip(warm_c, layers.height_m, strict=True):
        edge_m = np.concatenate([layers.width_m, layers.depth_m])
        edge_k = np.average(np.concatenate([sheet_c[0], sheet_c[:, 0]]), weights=edge_m) - room_c
        film = measure_warm.film_side(edge_k, layers.height_m.sum(), room_c)
        leaving_w += edge_m.sum() * height_m * film * edge_k
    leaving_w += WarmedTable(layers).flow(warm_c[0] - room_c).sum()
    made_w = (layers.heat_w * (1 + COPPER_PER_K * (np.minimum(warm_c[0], COPPER_MELTS_C) - COPPER_C))).sum()
    assert leaving_w == pytest.approx(made_w, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "share"), [("pad-32", 0.06), ("eight", 0.2), ("fingertip-board-24", 0.08), ("two-coils", 0.2)]
)
def test_coils_and_beams_are_as_warm_as_a_heat_solution_says(name, share):
    """Plans state 30 %; these differ by 1 to 17 %, and a wrong layer by more."""
    plan = measure_warm.plan_of(name)
    found = measure_warm.solved(plan)
    warm = plan.warm
    assert warm.coil_c - warm.room_c == pytest.approx(found.coil_k, rel=share)
    assert warm.beam_rise_k == pytest.approx(found.beam_k, rel=share)


@pytest.mark.soak
def test_boards_are_as_warm_as_a_heat_solution_says():
    ratios = []
    for plan in measure_warm.board_plans(12):
        found = measure_warm.solved(plan)
        ratios.append(((plan.warm.coil_c - plan.warm.room_c) / found.coil_k, plan.warm.beam_rise_k / found.beam_k))
    off = np.abs(np.array(ratios) - 1)
    assert off.max() < 0.2


def test_hot_beams_are_an_error_with_a_level_that_keeps_them_cool(tmp_path, capsys):
    plan = pg.plan(make_spec({**FOUR_LINES, "drive": {"level_um": 30}}))
    assert plan.verdict.level == "error"
    finding = next(one for one in plan.findings if one.code == "pad.hot")
    assert not any(one.code == "pad.warm" for one in plan.findings)  # said once
    assert f"by at least {plan.warm.beam_rise_k * 0.7:.0f} K over" in finding.message  # no more digits than are sure
    level_um = finding.cures[0]["drive.level_um"]
    cool = pg.plan(make_spec({**FOUR_LINES, "drive": {"level_um": level_um}}))
    assert not any(one.code in ("pad.hot", "pad.warm") for one in cool.findings)
    spec = tmp_path / "loud.toml"
    spec.write_text('name = "loud"\nresolution = 32\nband_hz = [50, 200]\nq_min = 15\n[drive]\nlevel_um = 30\n')
    assert cli.run(["plan", str(spec), "-o", str(tmp_path / "out")]) == 1
    assert "does not work" in capsys.readouterr().out


def test_what_is_borne_follows_plastic_and_room():
    def codes(**fields) -> set[str]:
        """Return the findings on warmth of a loud pad of one layout, since the search looks for one that is cooler."""
        loud = {"drive": {"level_um": 30, "scheme": "spur-free"}, "coil": {"grid": [4, 4], "gap_mm": 1.0}}
        plan = pg.plan(make_spec({**FOUR_LINES, **loud, **fields}))
        return {one.code for one in plan.findings if one.code in ("pad.hot", "pad.warm")}

    unknown = {"name": "own", "process": "fdm", "youngs_modulus_gpa": 3, "poisson_ratio": 0.36}
    unknown |= {"density_g_per_cm3": 1.24, "fatigue_stress_mpa": 12}
    assert codes() == {"pad.hot"}
    assert codes(material={**unknown, "glass_c": 300}) == set()
    assert codes(material=unknown) == set()
    assert codes(material={**unknown, "glass_c": 300}, limits={"room_c": 60}) == set()
    assert codes(material={**unknown, "glass_c": 110}, limits={"room_c": 60}) == {"pad.hot"}


def test_warm_resonances_fall_with_the_plastic():
    plan = pg.plan("pad-32")
    warm = plan.warm
    share = [hz / channel.resonance_hz - 1 for hz, channel in zip(warm.resonances_hz, plan.channels, strict=True)]
    softening = plan.spec.material.softening_per_k
    assert np.mean(share) == pytest.approx(-softening / 2 * (warm.mean_beam_c - warm.room_c), rel=1e-6)
    assert warm.resonance_shift == pytest.approx(-softening / 2 * warm.beam_rise_k)
    assert min(share) >= warm.resonance_shift
    assert next(one for one in plan.left_out if one.term == "warmth").bound == pytest.approx(-warm.resonance_shift)


def test_a_grid_of_odd_counts_is_as_warm_as_its_even_neighbours():
    def rise_k(coils: int) -> float:
        plan = pg.plan("pad-32")
        side_mm = plan.spec.pad.width_mm / plan.coils.columns * coils
        spec = replace(plan.spec, pad=replace(plan.spec.pad, width_mm=side_mm, depth_mm=side_mm))
        grid = replace(plan.coils, rows=coils, columns=coils)
        return planned_warmth(replace(plan, spec=spec, coils=grid)).beam_rise_k

    rises = [rise_k(coils) for coils in (6, 7, 8)]
    assert rises[0] < rises[1] < rises[2]
    assert rises[1] == pytest.approx((rises[0] + rises[2]) / 2, rel=0.02)


def test_a_plan_file_keeps_its_temperatures():
    plan: Plan = pg.plan("paper-16")
    again = plan_from_json(plan_to_json(plan)).warm
    assert again.beam_c == pytest.approx(plan.warm.beam_c, rel=1e-9)
    assert again.resonances_hz == pytest.approx(plan.warm.resonances_hz, rel=1e-9)


# The drive of a warm pad


@pytest.fixture(scope="module")
def eight() -> Plan:
    return measure_warm.plan_of("eight")


def receptance(hz: float, resonance_hz: float, q: float) -> float:
    """Return |H| by physics.md's formula with a mass of 1 kg."""
    return abs(1 / (4 * np.pi**2) / (resonance_hz**2 - hz**2 + 1j * hz * resonance_hz / q))


@pytest.mark.parametrize("name", ["pad-32", "resin-fine", "paper-pair"])
def test_a_cold_table_loses_what_the_receptance_at_its_tones_loses(name):
    plan = pg.plan(name)
    warm = plan.warm
    for k, channel in enumerate(plan.channels):
        left = receptance(channel.resonance_hz, warm.resonances_hz[k], channel.q)
        left /= receptance(channel.resonance_hz, channel.resonance_hz, channel.q)
        assert warm.lost_db[k] == pytest.approx(-20 * np.log10(left), abs=1e-6)
        assert warm.levels_um[k] == pytest.approx(left * channel.level_um, rel=1e-9)
    assert warm.room_c < warm.mean_coil_c < warm.coil_c


def heard_um(plan: Plan, folder: Path, signal: str, tuning=None, listening=None) -> np.ndarray:
    """Return the levels that a simulated pad, `listening`, has of a file for `tuning` with all taxels on."""
    drive = drive_at(plan, RATES_HZ, tuning=tuning)
    shown = steady(np.ones(len(plan.taxels)), drive.period_s)
    report = write_wave(folder / "drive.wav", drive, shown, "float", signal)
    sidecar = json.loads(wave_json(plan, drive, shown, report, tuning))
    return hear(plan, read_wav(folder / "drive.wav"), sidecar, listening).tone_um[0]


@pytest.mark.sample(1)
@pytest.mark.parametrize("scheme", ["tones", "spur-free", "biased"])
def test_what_a_cold_file_leaves_is_what_a_warm_pad_in_time_does(scheme, tmp_path):
    """The file's lines lie on a comb, beside the resonances: by the receptance at its lines, to 0.15 dB."""
    plan = pg.plan(make_spec({**measure_warm.OWN[0], "drive": {"scheme": scheme}}))
    warmed = warm_tuning(plan)
    warm = plan.warm
    pad = drive_at(plan, RATES_HZ)
    expected_db = np.zeros(len(plan.taxels))
    copper_db = np.zeros(len(plan.taxels))
    for coil in pad.coils:
        for index, hz in zip(coil.taxels.tolist(), coil.force_hz.tolist(), strict=True):
            k = plan.taxels[index].channel
            cold = receptance(hz, plan.channels[k].resonance_hz, plan.channels[k].q)
            left = receptance(hz, warm.resonances_hz[k], plan.channels[k].q)
            expected_db[index] = 20 * np.log10(cold / left)
            copper_db[index] = warm.lost_by_voltage_db[k] - warm.lost_db[k]
    for signal, due_db in (("current", expected_db), ("voltage", expected_db + copper_db)):
        cold_um = heard_um(plan, tmp_path, signal)
        left_um = heard_um(plan, tmp_path, signal, listening=warmed)
        assert 20 * np.log10(cold_um / left_um) == pytest.approx(due_db, abs=0.15)
    wanted_um = levels_um(plan, np.array([taxel.resonance_hz for taxel in warmed.taxels]))
    assert heard_um(plan, tmp_path, "voltage", warmed, warmed) == pytest.approx(wanted_um, rel=0.02)


def test_the_warm_table_has_the_warm_pads_forces_and_its_coppers_voltages(tmp_path, eight):
    assert eight.scheme.name == "tones" or eight.scheme.has_constant
    drive(eight, warm=True).save(tmp_path, formats=["csv", "json"])
    rows = list(csv.DictReader((tmp_path / "drive-warm.csv").read_text().splitlines()))
    cold = list(csv.DictReader((tmp_path / "drive.csv").read_text().splitlines()))
    assert json.loads((tmp_path / "drive-warm.json").read_text())["channels"][0]["channel"] == 0
    warm = eight.warm
    coil = eight.spec.coil
    ohm = coil.resistance_ohm * (1 + 0.00393 * (warm.mean_coil_c - 20))
    for k, channel in enumerate(eight.channels):
        row = {name: float(value) for name, value in rows[k].items()}
        x = warm.resonances_hz[k] / channel.resonance_hz
        assert row["resonance_hz"] == pytest.approx(channel.resonance_hz * x, rel=1e-5)
        assert row["impedance_ohm"] == pytest.approx(
            abs(ohm + 2j * np.pi * row["drive_hz"] * coil.inductance_mh * 1e-3), rel=1e-5
        )
        # The force for a level D is k D/Q, the level that of the law at the warm resonance; the pull's constant stays.
        level_um = levels_um(eight, np.array([channel.resonance_hz * x]))[0]
        force_mn = channel.stiffness_n_per_m * x**2 * level_um * 1e-3 / channel.q
        assert row["force_mn"] == pytest.approx(force_mn, rel=1e-5)
        current = np.sqrt(row["force_mn"] / float(cold[k]["force_mn"]))
        assert row["current_ma_peak"] == pytest.approx(float(cold[k]["current_ma_peak"]) * current, rel=1e-5)
        assert row["voltage_v_peak"] > float(cold[k]["voltage_v_peak"])


def test_a_print_measured_cold_is_driven_warm(tmp_path, eight):
    planned = planned_tuning(eight)
    measured = replace(
        planned,
        taxels=tuple(
            replace(one, resonance_hz=one.resonance_hz * (1.03 + 0.002 * k), measured=True, resonance_error_hz=0.1)
            for k, one in enumerate(planned.taxels)
        ),
    )
    warmed = warm_tuning(eight, measured)
    for one, cold, taxel in zip(warmed.taxels, measured.taxels, eight.taxels, strict=True):
        share = eight.warm.resonances_hz[taxel.channel] / eight.channels[taxel.channel].resonance_hz
        assert one.resonance_hz == pytest.approx(cold.resonance_hz * share)
        assert one.response_um_per_a2 == pytest.approx(cold.response_um_per_a2 / share**2)
        assert one.q == cold.q
        unsure_hz = 0.3 * (cold.resonance_hz - one.resonance_hz)
        assert one.resonance_error_hz == pytest.approx(np.hypot(0.1 * share, unsure_hz))
    again = tuning_from_json(tuning_to_json(warmed), eight)
    assert again.coil_c == pytest.approx(eight.warm.mean_coil_c)
    driven = drive(eight, tuning=measured, warm=True).save(tmp_path, formats=["csv"])
    assert driven.files == ("plan.json", "drive.csv", "drive-warm.csv", "drive-tuned-warm.csv")
    row = next(csv.DictReader((tmp_path / "drive-tuned-warm.csv").read_text().splitlines()))
    assert float(row["resonance_hz"]) == pytest.approx(warmed.taxels[0].resonance_hz, rel=1e-5)
    coil = eight.spec.coil
    ohm = coil.resistance_ohm * (1 + 0.00393 * (warmed.coil_c - 20))
    reactance = 2 * np.pi * float(row["drive_hz"]) * coil.inductance_mh * 1e-3
    assert float(row["impedance_ohm"]) == pytest.approx(np.hypot(ohm, reactance), rel=1e-5)
    with pytest.raises(SpecError, match="already; drive it without --warm"):
        drive(eight, tuning=warmed, warm=True)
    for text in ('"coil_c": null', '"coil_c": 900.0'):
        with pytest.raises(FileError, match=r"coil_c|null"):
            tuning_from_json(re.sub(r'"coil_c": [\d.]+', text, tuning_to_json(warmed)), eight)


def test_firmware_heat_and_file_are_those_of_warm_copper(tmp_path, eight):
    warmed = warm_tuning(eight)
    ohm = eight.spec.coil.resistance_ohm * (1 + 0.00393 * (eight.warm.mean_coil_c - 20))
    drive(eight, warm=True).save(tmp_path, formats=["c"])
    header = (tmp_path / "pad_drive.h").read_text()
    stated = re.search(r"PADGEN_RESISTANCE_OHM (\S+?)f", header)
    assert float(stated[1]) == pytest.approx(ohm, rel=1e-6)
    assert f"{plan_hash(eight, warmed)[0]:#04x}" in header
    pad = drive_at(eight, RATES_HZ, tuning=warmed)
    load = load_of(eight, pad)
    limit_w = ohm * load.warm_a2.max() * 0.99
    tight = replace(eight, spec=replace(eight.spec, coil=replace(eight.spec.coil, power_limit_w=limit_w)))
    assert [one.code for one in judge_load("", tight, load, warmed)] == ["coil.heat"]
    assert not list(judge_load("", tight, load))  # the same currents in cold copper


def test_the_command_says_for_which_warmth_it_drives(tmp_path, capsys):
    assert cli.run(["drive", "paper-pair", "--warm", "-o", str(tmp_path)]) == 0
    assert "of the pad that all taxels, left on, have warmed" in " ".join(capsys.readouterr().out.split())
    for arguments in (
        ["drive", "paper-pair", "--warm", "--excite", "chirp"],
        ["play", "any.wav", "--audio", "--warm"],
    ):
        assert cli.run([*arguments, *(["-o", str(tmp_path / "x")] if arguments[0] == "drive" else [])]) == 2
        assert "--warm" in capsys.readouterr().err
    assert cli.run(["plan", "paper-pair", "--verbose", "-o", str(tmp_path / "p")]) == 0
    assert "(2.1 dB less than planned), driven by its voltages 2.9 dB less" in " ".join(capsys.readouterr().out.split())


def test_a_file_that_is_played_over_and_over_is_as_warm_as_its_heat(tmp_path, eight):
    rises = {}
    for state in ("11", "01"):
        driven = drive(eight, state=state, loop=True, signal="current").save(tmp_path / state, formats=["wav"])
        heat_w = max(driven.report.copper_loss_w)
        alike = replace(eight, load=replace(eight.load, copper_loss_w=heat_w))
        assert driven.beam_rise_k == pytest.approx(planned_warmth(alike).beam_rise_k, rel=1e-9)
        rises[state] = driven.beam_rise_k
    assert rises["11"] == pytest.approx(eight.warm.beam_rise_k, rel=0.01)  # lines on a comb
    assert rises["01"] < 0.8 * rises["11"]
    between_c = eight.warm.room_c + 15 + (rises["01"] + rises["11"]) / 2
    soft = replace(eight, spec=replace(eight.spec, material=replace(eight.spec.material, glass_c=between_c)))
    for state, codes in (("11", ["pad.warm"]), ("01", [])):
        driven = drive(soft, state=state, loop=True, signal="current").save(tmp_path / state, formats=["wav"])
        assert [one.code for one in driven.findings if one.code == "pad.warm"] == codes


def test_foam_keeps_a_pad_warmer_than_wood():
    wood = measure_warm.plan_of("eight")
    foam = pg.plan(make_spec({**measure_warm.OWN[0], "mount": "foam"}))
    assert wood.warm.beam_rise_k * 1.05 < foam.warm.beam_rise_k < wood.warm.beam_rise_k * 1.5


def test_a_plastic_that_melts_keeps_a_resonance():
    plan = measure_warm.plan_of("eight")
    melting = replace(plan.spec, material=replace(plan.spec.material, softening_per_k=0.1))
    load = replace(plan.load, copper_loss_w=4 * plan.load.copper_loss_w)
    warm = planned_warmth(replace(plan, spec=melting, load=load))
    assert warm.beam_rise_k * 0.1 / 2 > 1  # by the slope its resonance would be below 0
    for hz, channel in zip(warm.resonances_hz, plan.channels, strict=True):
        assert hz >= 0.1 * channel.resonance_hz * (1 - 1e-9)
    assert warm.resonance_shift >= -0.9
    assert all(np.isfinite(warm.lost_db))


def test_a_plan_file_must_have_a_warm_resonance_for_each_channel():
    text = plan_to_json(measure_warm.plan_of("eight"))
    assert plan_from_json(text).warm.lost_db
    table = json.loads(text)
    for wrong in ([], [50.0], [50.0, 0.0], [50.0, None]):
        table["warm"]["resonances_hz"] = wrong
        with pytest.raises(FileError, match="one above 0 for each channel"):
            plan_from_json(json.dumps(table))
    del table["warm"]["lost_db"]
    with pytest.raises(OlderPlanError):
        plan_from_json(json.dumps(table))
