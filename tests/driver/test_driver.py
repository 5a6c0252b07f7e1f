"""The driver table: tones, currents and voltages, states and their spurs."""

import csv
import io
import json
from math import isclose, sqrt

import numpy as np
import pytest

from padgen.driver.formats.csv import drive_csv, drive_rows
from padgen.driver.formats.json import coil_states, drive_json
from padgen.planner import make_plan
from padgen.spec import parse_spec

COLUMNS = "channel,resonance_hz,drive_hz,force_mn,current_ma_peak,voltage_v_peak,impedance_ohm,phase_deg,ring_up_ms"


def test_columns_are_the_contract(paper_plan):
    assert drive_csv(paper_plan).splitlines()[0] == COLUMNS
    rows = list(csv.DictReader(io.StringIO(drive_csv(paper_plan))))
    assert [r["channel"] for r in rows] == ["0", "1"]
    for row in rows:
        assert float(row["drive_hz"]) == pytest.approx(float(row["resonance_hz"]) / 2, rel=1e-5)


def test_current_gives_the_force_and_voltage_the_current(paper_plan):
    for channel, row in zip(paper_plan.channels, drive_rows(paper_plan), strict=True):
        current = row.current_ma_peak * 1e-3
        assert channel.force_constant_n_per_a2 * current**2 / 2 == pytest.approx(channel.force_mn * 1e-3)
        z = complex(62.9, 2 * np.pi * row.drive_hz * 41.7e-3)
        assert row.impedance_ohm == pytest.approx(abs(z))
        assert row.voltage_v_peak == pytest.approx(current * abs(z))
        assert row.phase_deg == pytest.approx(np.degrees(np.angle(z)))


def test_force_gives_the_level(paper_plan):
    for channel in paper_plan.channels:
        level = channel.force_mn * 1e-3 * channel.q / channel.stiffness_n_per_m
        assert level * 1e6 == pytest.approx(channel.level_um)


def test_table_one_of_the_paper(paper_plan):
    states = coil_states(paper_plan)
    assert [s["state"] for s in states] == ["00", "01", "10", "11"]
    assert [len(s["lines"]) for s in states] == [0, 1, 1, 2]
    assert [len(s["spurs"]) for s in states] == [0, 0, 0, 2]
    low, high = (c.resonance_hz for c in paper_plan.channels)
    assert [s["force_hz"] for s in states[3]["spurs"]] == pytest.approx([(low + high) / 2, (high - low) / 2])
    assert all(s["near_channel"] is None for s in states[3]["spurs"])


def test_spurs_of_a_triple_fall_next_to_a_third_channel():
    text = 'name = "a"\nresolution = 3\nband_hz = [40, 300]\nq_min = 15\nresonances_hz = [60, 100, 140]\n'
    text += 'drive = "tones"\n'
    plan = make_plan(parse_spec(text))
    full = coil_states(plan)[-1]
    middle = next(s for s in full["spurs"] if s["channels"] == [0, 2] and s["kind"] == "sum")
    assert middle["near_channel"] == 1
    assert middle["offset_hz"] == pytest.approx(0, abs=0.1)


def test_spectrum_of_the_squared_current(paper_plan):
    """The lines of the sampled square of state 11's current are the table's."""
    rows = drive_rows(paper_plan)
    state = coil_states(paper_plan)[3]
    rate = 2000
    seconds = 200
    time = np.arange(rate * seconds) / rate
    current = sum(r.current_ma_peak * 1e-3 * np.sin(2 * np.pi * r.drive_hz * time) for r in rows)
    window = np.hanning(len(time))
    constants = [c.force_constant_n_per_a2 for c in paper_plan.channels]
    # A line as its own washer feels it; a spur, no one's, by the mean of the two.
    felt = [(line, constants[line["channel"]]) for line in state["lines"]]
    felt += [(spur, sqrt(constants[0] * constants[1])) for spur in state["spurs"]]
    for line, constant in felt:
        carrier = np.exp(-2j * np.pi * line["force_hz"] * time)
        amplitude = 2 * abs((constant * current**2 * carrier * window).sum()) / window.sum()
        assert isclose(amplitude * 1e3, line["force_mn"], rel_tol=1e-3)
    assert constants[0] * (current**2).mean() * 1e3 == pytest.approx(state["static_force_mn"], rel=1e-3)


def test_spurs_are_six_db_above_equal_lines(paper_plan):
    spur = coil_states(paper_plan)[3]["spurs"][0]
    forces = [c.force_mn for c in paper_plan.channels]
    assert spur["force_mn"] == pytest.approx(2 * sqrt(forces[0] * forces[1]))


def test_many_channels_are_not_spelled_out():
    text = (
        'name = "a"\nresolution = 7\nband_hz = [40, 900]\nq_min = 30\n[coil]\ngrid = [1, 1]\nouter_diameter_mm = 50\n'
    )
    plan = make_plan(parse_spec(text))
    assert len(plan.channels) == 7
    table = json.loads(drive_json(plan))
    assert table["states"] == []
    assert "not spelled out" in table["states_note"]


def test_json_says_which_taxel_is_which(paper_plan):
    table = json.loads(drive_json(paper_plan))
    assert len(table["taxels"]) == 32
    assert table["scheme"] == "tones"
    assert table["coils"][0] == {"coil": [0, 0], "set": 0, "x_mm": -18.75, "y_mm": -18.75}


TRIPLE = 'name = "a"\nresolution = 3\nband_hz = [40, 300]\nq_min = 15\nresonances_hz = [60, 101, 140]\ndrive = "{}"\n'


def played(recipe, rows, on, time):
    """Return the current in A by the formula of drive.json, with these channels of a coil ON."""
    hz = np.array([row["resonance_hz"] for row in rows])[on]
    line = np.array(recipe["squared_lines_a2"])[on]
    if recipe["formula"].startswith("i(t) = B"):
        tones = np.array([row["current_ma_peak"] for row in rows])[on] * 1e-3
        return recipe["bias_a"] + (tones[:, None] * np.sin(2 * np.pi * hz[:, None] * time)).sum(0)
    if recipe["formula"].startswith("i(t) = sqrt"):
        constant = recipe["a0_all_on_a2"] * line.sum() / sum(recipe["squared_lines_a2"])
        return np.sqrt(constant + (line[:, None] * np.cos(2 * np.pi * hz[:, None] * time)).sum(0))
    tones = np.array([row["current_ma_peak"] for row in rows])[on] * 1e-3
    return (tones[:, None] * np.sin(np.pi * hz[:, None] * time)).sum(0)


@pytest.mark.parametrize("scheme", ["tones", "biased", "spur-free"])
@pytest.mark.parametrize("state", ["101", "111"])
def test_the_recipe_makes_the_lines_of_the_state(scheme, state):
    """The square of the current that drive.json describes has the lines and the mean of the table."""
    plan = make_plan(parse_spec(TRIPLE.format(scheme)))
    table = json.loads(drive_json(plan))
    rows = [row for row in table["channels"] if row["channel"] != "bias"]
    (listed,) = [s for s in table["states"] if s["state"] == state]
    rate = 2000
    seconds = 300
    time = np.arange(rate * seconds) / rate
    current = played(table["current"][0], rows, [bit == "1" for bit in state], time)
    window = np.blackman(len(time))
    pull = [c.force_constant_n_per_a2 for c in plan.channels]
    for line in (*listed["lines"], *listed["spurs"]):
        own = line["channels"] if "channels" in line else [line["channel"]]
        constant = float(np.prod([pull[k] for k in own])) ** (1 / len(own))
        carrier = np.exp(-2j * np.pi * line["force_hz"] * time)
        amplitude = 2 * abs((constant * current**2 * carrier * window).sum()) / window.sum()
        assert amplitude * 1e3 == pytest.approx(line["force_mn"], rel=2e-3)
    assert (pull[0] * current**2).mean() * 1e3 == pytest.approx(listed["static_force_mn"], rel=2e-3)
    assert ({spur["kind"] for spur in listed["spurs"]} == set()) == (scheme == "spur-free")


def test_bias_rows():
    for scheme in ("tones", "time-shared"):
        assert "bias" not in drive_csv(make_plan(parse_spec(TRIPLE.format(scheme))))
    biased, free = (make_plan(parse_spec(TRIPLE.format(scheme))) for scheme in ("biased", "spur-free"))
    *rows, bias = drive_rows(biased)
    assert (bias.channel, bias.drive_hz, bias.impedance_ohm) == ("bias", 0.0, 62.9)
    # Five times the largest tone.
    assert bias.current_ma_peak == pytest.approx(5 * max(row.current_ma_peak for row in rows))
    for channel, row in zip(biased.channels, rows, strict=True):
        force = 2 * channel.force_constant_n_per_a2 * bias.current_ma_peak * row.current_ma_peak * 1e-6
        assert force == pytest.approx(channel.force_mn * 1e-3)
    *rows, bias = drive_rows(free)
    lines = sum(c.force_mn * 1e-3 / c.force_constant_n_per_a2 for c in free.channels)
    assert (bias.current_ma_peak * 1e-3) ** 2 == pytest.approx(1.05 * lines)
    assert bias.voltage_v_peak == pytest.approx(bias.current_ma_peak * 1e-3 * 62.9)


def test_voltage_of_the_root_by_sampling():
    plan = make_plan(parse_spec(TRIPLE.format("spur-free")))
    for channel, row in zip(plan.channels, drive_rows(plan), strict=False):
        line = channel.force_mn * 1e-3 / channel.force_constant_n_per_a2
        time = np.linspace(0, 1 / channel.resonance_hz, 200_001)
        current = np.sqrt(line * (1.05 + np.cos(2 * np.pi * channel.resonance_hz * time)))
        volts = 62.9 * current + 41.7e-3 * np.gradient(current, time)
        assert row.voltage_v_peak == pytest.approx(volts[1:-1].max(), rel=1e-4)
        assert row.current_ma_peak == pytest.approx(current.max() * 1e3)
