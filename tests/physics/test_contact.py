"""Contact: skin by closed forms, by layers in finite elements, and what is felt, each against something else.

| figure | against | tolerance |
|---|---|---|
| k, c, m and impedance of skin | the tables of reference/skin2.md | their last digit; impedance 1 dB |
| touched resonance and Q of a taxel | the table of reference/skin2.md | the last digit |
| a contact that goes with frequency | a root by bisection | 1e-9 |
| guard factor | the table, and finite elements between its points | rounding; 1 %: 0.5 % seen |
| punch by elements | 2 a E/(1 − ν²) | 0.5 %: 0.1 % seen |
| layered skin by elements | Hankel transforms (tests/skin_by_hankel.py) | 0.5 %: 0.3 % seen |
| lumped skin | Hankel transforms of random layers | the stated error in 92 % of cases |
| thresholds | reference/thresholds.json | 0.2 dB: they have one digit |
| levels over the threshold | sums over lines by hand | 1e-9 |
"""

import json
import re
from dataclasses import replace
from math import inf, pi
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from padgen.core.errors import SolverError, SpecError
from padgen.core.registry import CONTACTS
from padgen.physics.contact import Contactor, dome_radius, guard_factor, loaded_resonance, preload_factor
from padgen.physics.contact.half_space import HalfSpace, layer_radius
from padgen.physics.selectivity import line_energy, own_lines
from padgen.physics.sensation import Threshold, distinct_frequencies, distinct_levels, for_area, level_db
from padgen.planner import make_plan, plan_from_json, plan_to_json
from padgen.planner.channels import heard_modes
from padgen.planner.cures import varied, with_tried_cures
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.thresholds import threshold_at
from padgen.planner.touch import felt_levels, skin_contact
from padgen.spec import parse_spec
from padgen.spec.load import catalogue, spec_schema
from padgen.verify.layered_skin import SkinLayer, SkinQuestion, solve_skin
from tests.skin_by_hankel import punch_stiffness

REFERENCE = Path(__file__).parents[1] / "reference"
TEXT = (REFERENCE / "skin2.md").read_text()
SKINS = ("low", "typical", "high")
FOUR = (
    'name = "four"\nresolution = 16\nband_hz = [50, 400]\nq_min = 15\nprinter = "fdm-0.25"\n'
    "[pad]\nwidth_mm = 25\ndepth_mm = 25\nrib_mm = 0.6\n[coil]\ngrid = [2, 2]\n"
)


def table(heading: str, columns: int) -> list[list[float]]:
    """Return the numbers of a table of the reference whose first line begins with `heading`."""
    lines = iter(TEXT[TEXT.index(heading) :].splitlines()[2:])
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        rows.append([float(x) for x in re.findall(r"\d+\.?\d*", line)])
    assert rows and {len(row) for row in rows} == {columns}
    return rows


# Skin by closed forms


def test_skin_is_that_of_the_reference_table():
    for diameter, *given in table("| ⌀ mm |", 12):
        contactor = Contactor(diameter * 0.5e-3)
        found = [skin_contact("fingertip", which).impedance(250.0, contactor) for which in SKINS]
        # Two or three digits.
        assert [float(z.stiffness) for z in found] == pytest.approx(given[:3], rel=0.01)
        assert [float(z.damping) for z in found] == pytest.approx(given[3:6], rel=0.03)
        assert float(found[1].mass) * 1e6 == pytest.approx(given[6], abs=0.06)
        hz = np.array([50.0, 100.0, 250.0, 500.0])
        typical = skin_contact("fingertip", "typical").impedance(hz, contactor)
        # The reference leaves c at its value of 250 Hz, which makes up to 0.9 dB at 500 Hz.
        assert np.abs(found[1].dynamic_stiffness(hz)) / (2 * pi * hz) == pytest.approx(given[7:11], rel=0.03)
        assert np.abs(20 * np.log10(np.abs(typical.dynamic_stiffness(hz)) / (2 * pi * hz) / given[7:11])).max() < 1


def test_touched_taxels_are_those_of_the_reference_table():
    mass = 145e-6
    skin = skin_contact("fingertip", "typical")
    for untouched, *given in table("| untouched Hz |", 9):
        k = (2 * pi * untouched) ** 2 * mass
        for (diameter, factor), hz, q in zip(
            ((0.5, 1), (1, 1), (0.5, 1.44), (1, 1.44)), given[::2], given[1::2], strict=True
        ):
            contactor = Contactor(diameter * 0.5e-3, 1.5 if factor > 1 else inf)
            found, touched_q = loaded_resonance(skin, contactor, k, mass, inf)
            # The reference cuts the decimals off, of factors with two digits.
            assert float(found) == pytest.approx(hz, rel=0.01)
            assert float(touched_q) == pytest.approx(q, rel=0.05, abs=0.06)


def test_a_contact_that_goes_with_frequency_is_balanced_at_the_touched_resonance():
    fields = {"hz": [50, 500], "k_n_per_m": [50, 400], "c_n_s_per_m": [0.1, 0.05], "m_g": 0.002}
    contact = CONTACTS.get("table").made_of(fields)
    contactor = Contactor(1e-3)
    k = 300.0
    m = 2e-4
    lever = 0.7

    def excess(hz):
        added = contact.impedance(hz, contactor)
        return k + lever**2 * float(added.stiffness) - (m + lever**2 * float(added.mass)) * (2 * pi * hz) ** 2

    hz, q = loaded_resonance(contact, contactor, k, m, 20.0, lever)
    exact = brentq(excess, 100, 900, xtol=1e-10)
    assert float(hz) == pytest.approx(exact, rel=1e-9)
    # Straight in logarithms: 50 to 400 N/m over a decade is the power 0.903 of frequency.
    assert float(contact.impedance(exact, contactor).stiffness) == pytest.approx(50 * (exact / 50) ** np.log10(8))
    damping = (k * m) ** 0.5 / 20 + lever**2 * 0.1 * (exact / 50) ** np.log10(0.5)
    assert float(q) == pytest.approx((m + lever**2 * 2e-6) * 2 * pi * exact / damping, rel=1e-9)
    # Outside the table its ends stay.
    assert float(contact.impedance(5.0, contactor).stiffness) == pytest.approx(50)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"hz": [100, 50]}, "must be positive and rise"),
        ({"hz": [50, 100], "k_n_per_m": [1, 2, 3]}, "k_n_per_m must have one number, or 2"),
        ({"c_n_s_per_m": -1.0}, "must not be negative"),
    ],
)
def test_a_table_that_is_none(fields, sentence):
    with pytest.raises(ValueError, match=sentence):
        CONTACTS.get("table").made_of(fields)


def test_guard_plates_and_preload_are_those_of_the_reference():
    ratios = [1.1, 1.2, 1.3, 1.5, 2, 3, 4, 6]
    (factors,) = table("| b/a |", 8)
    assert guard_factor(np.array(ratios)) == pytest.approx(factors, rel=1e-12)
    assert float(guard_factor(inf)) == 1
    between = guard_factor(np.linspace(1.05, 30, 500))
    assert (np.diff(between) < 0).all() and (between > 1).all()
    with pytest.raises(ValueError, match="wider than the contactor"):
        guard_factor(1.0)
    assert preload_factor(np.array([0.1, 0.3, 0.5]) * 1e-3) == pytest.approx([1.2, 1.8, 2.7], abs=0.05)
    assert float(dome_radius(2e-3, 0.5e-3)) == pytest.approx(1e-3)


# Skin in layers


def test_a_punch_by_elements_is_that_of_the_closed_form():
    for poisson in (0.3, 0.5):
        layer = SkinLayer(inf, 20e3, 0.0, poisson=poisson)
        found = solve_skin(SkinQuestion(0.5e-3, 0.0, (layer,)), 3, 0.05).stiffness
        modulus = 2 * 20e3 * (1 + poisson)
        assert found.real == pytest.approx(2 * 0.5e-3 * modulus / (1 - poisson**2), rel=5e-3)
        assert found.imag == 0


def test_a_guard_plate_by_elements_is_that_of_the_table_between_its_points():
    found = solve_skin(SkinQuestion(0.5e-3, 0.0, (SkinLayer(inf, 20e3, 0.0),), 1.4), 3, 0.05).stiffness
    assert found.real / (8 * 20e3 * 0.5e-3) == pytest.approx(float(guard_factor(1.4)), rel=0.01)


@pytest.mark.parametrize(
    ("radius", "hz", "layers"),
    [
        (1.5e-3, 500.0, (SkinLayer(inf, 7.5e3, 0.4e-3),)),
        (0.5e-3, 250.0, (SkinLayer(inf, 20e3, 0.7e-3),)),
        (0.5e-3, 400.0, (SkinLayer(0.35e-3, 250e3, 0.5e-3), SkinLayer(inf, 15e3, 0.7e-3))),
    ],
)
def test_layers_by_elements_move_as_by_transforms(radius, hz, layers):
    exact = punch_stiffness(radius, hz, [(one.thickness, one.complex_shear(hz), one.density) for one in layers])
    found = solve_skin(SkinQuestion(radius, hz, layers), 4, 0.05)
    assert abs(found.stiffness / exact - 1) < 5e-3
    assert found.residual < 1e-9


def test_layers_without_an_end_are_refused():
    with pytest.raises(SolverError, match="last one alone is infinite"):
        solve_skin(SkinQuestion(1e-3, 100.0, (SkinLayer(1e-3, 1e4, 0.0),)))


def test_the_outer_layers_radius_is_that_of_the_static_solution():
    for ratio in (5, 12, 40):
        for radius in (0.3e-3, 1e-3, 1.5e-3):
            layers = [(0.35e-3, ratio * 15e3 + 0j, 1100.0), (inf, 15e3 + 0j, 1100.0)]
            exact = punch_stiffness(radius, 0.5, layers).real
            wide = radius + float(layer_radius(0.35e-3, ratio * 60e3, 60e3))
            # The two numbers were read off for thin layers; 7 % seen where the layer is as thick as the punch is wide.
            assert 2 * 60e3 * wide == pytest.approx(exact, rel=0.08)


def test_lumped_skin_states_its_error_against_layers():
    random = np.random.default_rng(11)
    within = 0
    count = 60
    for _ in range(count):
        outer_modulus, modulus = (low * (high / low) ** random.random() for low, high in ((5e5, 4e6), (3e4, 2.5e5)))
        times = 0.4e-3 * (1.5 / 0.4) ** random.random(2)
        thickness = 0.1e-3 * 4 ** random.random()
        radius = 0.25e-3 * 6 ** random.random()
        hz = 50 * 10 ** random.random()
        layers = [
            (thickness, outer_modulus / 4 * (1 + 2j * pi * hz * times[0]), 1100.0),
            (inf, modulus / 4 * (1 + 2j * pi * hz * times[1]), 1100.0),
        ]
        exact = punch_stiffness(radius, hz, layers)
        skin = HalfSpace(modulus, layer_radius(thickness, outer_modulus, modulus), times[1])
        found = skin.impedance(hz, Contactor(radius)).dynamic_stiffness(hz)
        within += abs(found / exact - 1) <= skin.error(hz, Contactor(radius))
    assert within >= 0.92 * count


# What is felt


def test_thresholds_are_those_that_were_published():
    known = json.loads((REFERENCE / "thresholds.json").read_text())["rows"]
    for row in known:
        found = threshold_at(row["site"], "plate", row["area_mm2"]).at(np.array(row["hz"]))
        assert np.abs(found - row["db"]).max() < 0.2
    assert len(known) == len(catalogue("threshold"))
    with pytest.raises(ValueError, match="no threshold is known of site 'toe'"):
        threshold_at("toe", "plate", 3.0)


def test_a_threshold_between_contactors_and_beyond_its_ends():
    small = Threshold(np.array([50.0, 200.0]), np.array([10.0, 4.0]), 8.0, 2e-6)
    large = Threshold(np.array([50.0, 200.0]), np.array([10.0, 0.0]), 5.0, 8e-6)
    middle = for_area([large, small], 4e-6)
    assert middle.at(np.array([50, 100, 200])) == pytest.approx([10, 6, 2])
    assert middle.error_db == 8.0
    assert for_area([large, small], 1e-6).at(200.0) == 4.0
    assert for_area([large, small], 1e-4).at(200.0) == 0.0
    # Beyond its ends it goes on, and is less sure: an octave further by 6 dB.
    assert small.at(400.0) == pytest.approx(1.0)
    assert np.isfinite(small.at(np.array([0.0, 1e9]))).all()
    steep = Threshold(np.array([50.0, 50.0001]), np.array([-120.0, 100.0]), 0.0)
    assert steep.at(np.array([1.0, 400.0])).tolist() == [-300, 300]
    assert small.error_at(np.array([25.0, 100.0, 400.0])) == pytest.approx([14, 8, 14])
    assert level_db(np.array([10e-6, 0.0]), np.array([200.0, 200.0]), small).tolist() == pytest.approx([16, -inf])


def test_levels_and_frequencies_that_can_be_told_apart():
    assert [distinct_levels(db, 2.0) for db in (-0.1, 0, 1.9, 2, 10)] == [0, 1, 1, 2, 6]
    assert [distinct_levels(db, 4.0, 20.0) for db in (19, 20, 23.9, 24)] == [1, 2, 2, 3]
    assert distinct_frequencies([60, 70, 80, 99], 0.25) == 2
    assert distinct_frequencies([], 0.25) == 0


@pytest.fixture(scope="module")
def four():
    return make_plan(parse_spec(FOUR + "[drive]\nscheme = 'spur-free'\n"))


def test_felt_levels_are_sums_over_lines(four):
    threshold = threshold_at("fingertip", "plate", pi / 4 * 2.5**2)
    hz = np.array([c.resonance_hz for c in four.channels])
    um = np.array([c.level_um for c in four.channels])
    lost = np.array([c.level_loss_db for c in four.channels])
    assert four.felt.on_db == pytest.approx(20 * np.log10(um) - threshold.at(hz) - lost, abs=1e-9)
    planned = placed_channels(four.spec, four.channels)
    (made,) = own_lines(planned, four.scheme)
    energy = line_energy(planned, made, heard_modes(four.spec, four.channels, planned.line))[:, 0]
    heard = energy * (um[:, None] / 10 ** (threshold.at(hz) / 20)) ** 2
    np.fill_diagonal(heard, 0)
    assert four.felt.off_db == pytest.approx(10 * np.log10(heard.sum(1)), abs=1e-9)
    assert four.felt.most_levels == tuple(max(0, int(db // 1.6) + 1) for db in four.felt.on_db)
    assert plan_to_json(plan_from_json(plan_to_json(four))) == plan_to_json(four)


def test_a_taxel_under_skin_is_felt_less(four):
    skin = skin_contact("fingertip", "typical")
    touched = felt_levels(four.spec, four.channels, four.scheme, skin)
    for channel, before, after in zip(four.channels, four.felt.on_db, touched.on_db, strict=True):
        omega = 2 * pi * channel.resonance_hz
        added = skin.impedance(channel.resonance_hz, Contactor(1.25e-3)).dynamic_stiffness(channel.resonance_hz)
        damper = 1j * channel.stiffness_n_per_m / channel.q
        untouched = channel.stiffness_n_per_m - channel.effective_mass_g * 1e-3 * omega**2 + damper
        # 1e-4 dB: the plan's resonance is rounded apart from its stiffness and mass.
        assert before - after == pytest.approx(20 * np.log10(abs((untouched + added) / untouched)), abs=1e-3)


def test_equal_sensation_is_equally_far_above_the_threshold():
    plan = make_plan(parse_spec(FOUR + "[drive]\nlevel_law = 'sensation'\nlevel_um = 12\nscheme = 'spur-free'\n"))
    assert plan.selectivity.level_law == "sensation"
    assert np.ptp(plan.felt.on_db) < 1e-9
    assert plan.channels[0].level_um == 12
    channel = plan.channels[1]
    # It is quiet where it is not felt any more.
    quiet_after = channel.q / (pi * channel.resonance_hz) * 1e3 * plan.felt.on_db[1] / 20 * np.log(10)
    assert channel.ring_down_ms == pytest.approx(quiet_after, rel=1e-9)
    assert plan_from_json(plan_to_json(plan)).spec == plan.spec


def test_a_level_law_is_a_number_or_a_word():
    with pytest.raises(SpecError, match=r"drive\.level_law: .*sensation"):
        parse_spec(FOUR + "[drive]\nlevel_law = 'sensatoin'\n")
    with pytest.raises(SpecError, match=r"drive\.level_law: must be at least 0 and at most 2, got 3"):
        parse_spec(FOUR + "[drive]\nlevel_law = 3\n")
    words, number = spec_schema()["properties"]["drive"]["anyOf"][1]["properties"]["level_law"]["anyOf"]
    assert words["enum"] == ["sensation"] and number["maximum"] == 2


def cured(plan):
    """Return the plan with its tried cures."""
    return with_tried_cures(plan, lambda cure: make_plan(varied(plan.spec, cure)))


def test_taxels_that_are_not_felt_are_told_with_a_level_that_would_be(four):
    spec = replace(four.spec, drive=replace(four.spec.drive, level_um=6.0))
    plan = cured(make_plan(spec))
    (found,) = (f for f in plan.findings if f.code == "felt.below")
    silent = [c.index for c in plan.channels if plan.felt.on_db[c.index] < 0]
    assert silent and found.where.removeprefix("channels ").removeprefix("channel ") == ", ".join(map(str, silent))
    assert found.level == "warning" and f"{-min(plan.felt.on_db):.1f} dB less than the" in found.message
    again = make_plan(varied(spec, found.cures[0]))
    assert min(again.felt.on_db) >= 0
    assert "felt.below" not in {f.code for f in again.findings}


def test_off_taxels_that_are_felt_are_told_with_a_level_that_hides_them():
    text = FOUR.replace("q_min = 15", "q_min = 15\ndelta_y = 5") + "[drive]\nscheme = 'spur-free'\nlevel_um = 60\n"
    plan = cured(make_plan(parse_spec(text)))
    (found,) = (f for f in plan.findings if f.code == "felt.off")
    loudest = max(db for db in plan.felt.off_db if db is not None)
    assert loudest > 0 and f"move it {loudest:.1f} dB (±" in found.message
    again = make_plan(varied(plan.spec, found.cures[0]))
    assert max(db for db in again.felt.off_db if db is not None) <= 0 <= min(again.felt.on_db)
    quiet = make_plan(varied(plan.spec, {"drive.level_um": 10.0}))
    assert "felt.off" not in {f.code for f in quiet.findings}
