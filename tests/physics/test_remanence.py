"""Remanence: pulls as i² + ρ i, against the spectrum of the force of a current in time.

| figure | reference | tolerance | reason |
|---|---|---|---|
| lines of i² + ρ i, plain tones | spectrum of one period, by FFT | 1e-12 of the largest | whole periods |
| OFF energy of every taxel | the same lines through receptances | 1e-9 | the same sums in another order |
| lines of a root | spectrum of one period | 5 % and 10 % of the others | phases of a comb are not all phases |
| level under a constant current | spectrum of one period | 1e-9 | the same product |
| ρ of a short coil | Biot-Savart's law on the axis, by loops | 1 % | a coil's middle |
"""

import json
from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest

from padgen.core.errors import SpecError
from padgen.driver.ear import hear
from padgen.driver.waveform import make_drive, steady
from padgen.physics.magnetics import MU_0, CoilSource, SteelRing, Winding, flux_density
from padgen.physics.remanence import remanent_current, root_lines
from padgen.physics.resonator import receptance
from padgen.physics.schemes import bias_a, current_lines_a
from padgen.physics.selectivity import Channels, Scheme, all_states, loudest_line, off_energy, own_lines, scheme_lines
from padgen.planner import make_plan, plan_to_json
from padgen.planner.judge import KINDS, REMANENCE, _lines
from padgen.spec import load_spec, parse_spec
from tests.driver.test_ear import all_states as pad_states
from tests.driver.test_ear import played

HZ = np.array([48.0, 66.0, 98.0, 142.0])
"""Resonances on a comb of 1 Hz, of which no two lines meet; the first is near half of the third."""
LINE_A2 = np.array([3e-4, 4e-4, 6e-4, 8e-4])
Q = np.full(4, 15.0)
RHO_A = 0.004
POINTS = 4096


def taxels(many=4):
    return Channels(HZ[:many], Q[:many], LINE_A2[:many])


def scheme(name, many=4):
    return Scheme(name, remanence=RHO_A**2 / LINE_A2[:many].max())


def spectrum(current):
    """Return the amplitude of i² + ρ i at each whole Hz, from one second of a current."""
    force = current**2 + RHO_A * current
    return np.abs(np.fft.rfft(force)) / len(force) * np.where(np.arange(len(force) // 2 + 1) == 0, 1, 2)


def seconds():
    return np.arange(POINTS) / POINTS


def test_plain_tones_make_lines_at_half_the_resonances():
    tones = sum(sqrt(2 * a) * np.sin(2 * pi * f / 2 * seconds() + 0.3 * f) for f, a in zip(HZ, LINE_A2, strict=True))
    expected = np.zeros(POINTS // 2 + 1)
    for part in scheme_lines(taxels(), scheme("tones")):
        for hz, square in zip(part.hz, np.broadcast_to(part.square, part.hz.shape), strict=True):
            np.add.at(expected, hz.round().astype(int), square)
    found = spectrum(tones)
    alone = np.arange(len(found)) > 0
    assert found[alone] == pytest.approx(np.sqrt(expected[alone]), abs=1e-12)
    assert found[24] == pytest.approx(RHO_A * sqrt(2 * LINE_A2[0]), rel=1e-9)


@pytest.mark.parametrize("name", ["tones", "time-shared"])
def test_off_taxels_hear_them(name):
    """Each OFF taxel's energy from the force's spectrum, turn by turn where channels take turns."""
    many = 2
    which = taxels(many)
    found = off_energy(which, scheme(name, many))
    for i in range(many):
        other = 1 - i
        found_force = spectrum(sqrt(2 * LINE_A2[other]) * np.sin(2 * pi * HZ[other] / 2 * seconds()))
        lines = np.arange(1.0, len(found_force))
        moved = found_force[1:] * np.abs(receptance(lines, HZ[i], 1.0, Q[i]) / receptance(HZ[i], HZ[i], 1.0, Q[i]))
        assert found[i] == pytest.approx((moved**2).sum() / LINE_A2[i] ** 2, rel=1e-9)
    plain = off_energy(which, Scheme(name))
    assert (found > plain).all()


def test_an_octave_is_spoilt():
    """A taxel at half of another's resonance hears its whole line by remanence; without it hardly anything."""
    octave = Channels(np.array([49.0, 98.0]), Q[:2], LINE_A2[[0, 2]])
    strongest = LINE_A2[2]
    kept = all_states(octave, Scheme("tones", remanence=RHO_A**2 / strongest))
    heard = RHO_A * sqrt(2 * LINE_A2[2]) / LINE_A2[0]
    assert kept.db < -20 * np.log10(heard) < all_states(octave, Scheme("tones")).db - 3
    assert loudest_line(octave, Scheme("tones", remanence=RHO_A**2 / strongest), 0) == ((1,), "remanence")


@pytest.mark.parametrize("many", [1, 2, 4])
def test_a_root_has_other_lines(many):
    """Of a current √(a₀ + Σ a cos), as the spectrum of one of its periods has them; phases by the frequencies."""
    headroom = 0.05
    line = LINE_A2[:many]
    comb = np.array([41.0, 67.0, 101.0, 149.0])[:many]  # no sums and differences on them
    cosine = np.cos(2 * pi * comb[:, None] * seconds() + np.arange(many)[:, None])
    current = np.sqrt((1 + headroom) * line.sum() + line @ cosine)
    amplitude = np.abs(np.fft.rfft(current)) / POINTS * 2
    told = root_lines(line, headroom)
    others = np.ones(len(amplitude), bool)
    others[[0, *comb.astype(int)]] = False
    rest = sqrt((amplitude[others] ** 2).sum())
    assert told.others == pytest.approx(rest, rel=0.1)
    assert told.wanted == pytest.approx(amplitude[comb.astype(int)], rel=0.05)
    # No OFF taxel hears more than all of these others, as strong as at its own resonance.
    assert told.others > 0.1 * told.wanted.min()


def test_a_constant_current_only_changes_levels():
    drive = Scheme("biased")
    bias = bias_a(drive, LINE_A2)
    tones = current_lines_a(drive, LINE_A2)
    found = spectrum(bias + sum(b * np.sin(2 * pi * f * seconds()) for f, b in zip(HZ, tones, strict=True)))
    at = HZ.astype(int)
    assert found[at[0]] == pytest.approx(LINE_A2[0] + RHO_A * tones[0], rel=1e-9)
    assert found[at[3]] / LINE_A2[3] == pytest.approx(found[at[0]] / LINE_A2[0], rel=0.1)
    for with_remanence, without in zip(own_lines(taxels(), scheme("biased")), own_lines(taxels(), drive), strict=True):
        assert np.array_equal(with_remanence.hz, without.hz)


def test_the_current_that_stands_for_remanence():
    coil = CoilSource((Winding(0.010, 0.004, 0.0, -0.010, 1000.0),), 0.004, 0.010, 1000.0)
    washer = SteelRing(0.0035, 0.0017, 0.0003, 300.0)
    offset = np.array([0.0, 0.003])
    of_core = remanent_current(coil, washer, 0.001, offset, 0.0, 80.0)
    # The field in the middle of the winding: loops of its mean radius, by Biot-Savart's law.
    z = (np.arange(2000) + 0.5) / 2000 * 0.010 - 0.005
    field = (0.0035**2 / (2 * (0.0035**2 + z**2) ** 1.5)).mean() * 1000
    assert of_core == pytest.approx(80.0 / field, rel=0.01)
    of_washer = remanent_current(coil, washer, 0.001, offset, 150.0, 0.0)
    sides = np.abs(offset + np.array([[-1], [1]]) * 0.0013)
    radial, _ = flux_density(coil, sides, np.full_like(sides, 0.001))
    assert of_washer * np.sqrt((radial**2).mean(0)) / MU_0 == pytest.approx([150.0] * 2, rel=1e-9)
    both = remanent_current(coil, washer, 0.001, offset, 150.0, 80.0)
    assert both == pytest.approx(of_core + of_washer, rel=1e-12)
    air = coil._replace(core_diameter=0.0)
    assert remanent_current(air, washer, 0.001, offset, 0.0, 80.0) == pytest.approx([0, 0])


def test_plans_count_it():
    spec = load_spec("calibration")
    assert spec.drive.remanent_share == 0, "no source tells it"
    plans = [make_plan(replace(spec, drive=replace(spec.drive, remanent_share=share))) for share in (0.0, 0.25, 1.0)]
    kept = [plan.selectivity.placed_all_states_db for plan in plans]
    assert kept[0] > kept[1] > kept[2] + 3
    prints = [plan.prints.print_db for plan in plans]
    assert prints[0] > prints[1] > prints[2]
    bounds = [{entry.term: entry for entry in plan.left_out}.get("remanence") for plan in plans]
    assert not bounds[0].computed and bounds[1].computed
    assert bounds[0].bound == pytest.approx(bounds[1].bound, rel=1e-9), "of the usual share where none is stated"
    line_a2 = min(c.line_a2 for c in plans[1].channels)
    rho_a = plans[1].channels[0].remanent_ma / 1e3
    assert bounds[1].bound == pytest.approx(rho_a * sqrt(2 / line_a2), rel=1e-9)
    assert 0.05 < bounds[1].bound < 0.2, "of the wanted force"
    assert json.loads(plan_to_json(plans[2]))["channels"][0]["remanent_ma"] == pytest.approx(4e3 * rho_a)


def test_modes_are_told_of_lines_at_half_a_tone():
    lines = _lines(taxels(), scheme("tones"))
    halves = lines.hz[lines.kind == REMANENCE]
    assert halves == pytest.approx(HZ / 2)
    assert "half the tone of channel 2" in KINDS[REMANENCE].format(2)
    plain = _lines(taxels(), Scheme("tones"))
    assert len(plain.hz) == len(lines.hz) - 4 and REMANENCE not in plain.kind
    assert REMANENCE not in _lines(taxels(), scheme("biased")).kind


@pytest.mark.parametrize(("name", "most"), [("biased", 0.05), ("spur-free", 0.1)])
def test_a_constant_current_has_a_bound(name, most):
    drive = f'drive = {{ scheme = "{name}", remanent_share = 0.25 }}\n'
    text = f'name = "r"\nresolution = 8\nband_hz = [50, 200]\nq_min = 15\nresonances_hz = [60, 120]\n{drive}'
    plan = make_plan(parse_spec(text + "coil = { grid = [2, 2] }\n"))
    entry = next(entry for entry in plan.left_out if entry.term == "remanence")
    assert not entry.computed and 0 < entry.bound < most
    if name == "biased":
        rho_a = plan.channels[0].remanent_ma / 1e3
        assert entry.bound == pytest.approx(
            rho_a / 2 / bias_a(plan.scheme, np.array([c.line_a2 for c in plan.channels]))
        )


def test_parts_of_one_s_own_need_not_state_it():
    washer = "{ name = 'mine', outer_diameter_mm = 3.5, inner_diameter_mm = 1.7, thickness_mm = 0.3,"
    washer += " density_g_per_cm3 = 7.8, relative_permeability = 250 }"
    spec = parse_spec(f'name = "o"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\nwasher = {washer}\n')
    assert spec.washer.coercivity_a_per_m == 200
    with pytest.raises(SpecError, match="nobody's"):
        parse_spec('name = "o"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\nwasher = "nobody\'s"\n')


def test_what_is_heard_of_a_file_has_it(tmp_path):
    """All ON and OFF states of a pad with tones, played sample by sample, keep what the lines of the plan say."""
    spec = load_spec("calibration")
    heard_db = []
    for share in (0.0, 1.0):
        plan = make_plan(replace(spec, drive=replace(spec.drive, remanent_share=share)))
        drive = make_drive(plan, 8000)
        heard = hear(plan, *played(plan, drive, steady(pad_states(plan, drive), drive.period_s), tmp_path))
        assert heard.selectivity_db == pytest.approx(plan.selectivity.placed_all_states_db, abs=0.3)
        heard_db.append(heard.selectivity_db)
    assert heard_db[0] > heard_db[1] + 3
