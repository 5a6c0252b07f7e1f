"""Printed pads against the plan, the hand formula, the normal law and every state.

| figure | reference | tolerance | reason |
|---|---|---|---|
| prints without spreads | the plan's all-state figure | 1e-9 dB | the same closed form, summed in another order |
| sigma of f, one spread | rule of exponents | 2 %, and 4 sigma | beam and plate have mass, roots give; sampling |
| sigma of f by length | rule of exponents | 0.6 … 1 of it | the plate's own length adds to the beam's arm |
| sigma of f, all spreads | sum of squares | 4 sigma | sampling only |
| sigma of f by gradient | g/√(2π) in a square's corner | 4 sigma | an integral over directions |
| re-tuned, modulus alone | the plan's figure | 1e-9 dB | scaling all frequencies changes no ratio |
| neighbours swapped, too close | normal law of their distance | 4 sigma | sampling only |
| share of lone taxels | normal law over the half-power band | 4 sigma | independent taxels |
| one printed coil | all 2^n states with complex receptances | 1e-9 dB | the same sums in another order |
| capacity that prints, closed form | Monte-Carlo of the ladders | 1 channel | of all lines one comes near |
| same, two channels in turn | normal law of their ratio | 1e-9 | the same formula, by another distribution function |
| spread of a ratio | sample of simulated prints | 4 sigma | sampling only |
| slope of f over stiffness across beads | 3-D elasticity, beads as laid | a third | ends are filled differently |
| sigma of the pull | pull's exponent over the gap | 4 sigma | sampling only |
| what templates keep | a program that reads plan.json alone | 0.3 dB, 2 % | beams of its own, no modes that roll |
| intervals | Wilson's formula | 1e-3 of the width | whole numbers of independent taxels |
"""

import json
import re
import subprocess
import sys
from dataclasses import asdict, astuple, replace
from functools import cache
from itertools import combinations, pairwise, product
from math import hypot, log, sqrt
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

import padgen as pg
from padgen.physics.beams import torsion_constant
from padgen.physics.ladder import LevelLaw, geometric_ladder, ladder_ratio
from padgen.physics.pull import Leakage
from padgen.physics.resonator import receptance
from padgen.physics.schemes import in_order
from padgen.physics.selectivity import Scheme, channels, estimated_print_share
from padgen.planner import Plan, make_plan, plan_to_json
from padgen.planner import printed_pads as module
from padgen.planner.drive_scheme import _lines_apart
from padgen.planner.life import planned_life
from padgen.planner.print_yield import OUTCOMES, print_yield
from padgen.planner.printed_pads import (
    NOT_PRINTED,
    Drift,
    Spreads,
    compared_prints,
    design_of,
    simulated_prints,
    spreads_of,
    what_prints_keep,
)
from padgen.planner.search import largest_counts, printed_count
from padgen.spec import load_spec, parse_spec
from padgen.spec.model import LifeTable
from tests.print_and_count import kept_db

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

from measure_yield import random_spec, shortfall

SCHEMES = in_order()
NONE = Spreads(*[0.0] * len(module.NAMES))
USUAL = Spreads(
    *(0.05, 0.01, 0.02, 0.05, 0.02, 0.1, 2.0, 0.05),
    common_beads=0.1,
    across_beads=0.2,
    beads=0.05,
    common_gap_mm=0.1,
    gap_mm=0.05,
    common_glue_mg=3.0,
)
DB = 1e-9
FOUR = 'name = "four"\nresolution = 32\nband_hz = [50, 200]\nq_min = 15\n'


@cache
def template(name: str) -> Plan:
    return pg.plan(name)


@cache
def plan_of(
    hz=(50.0, 70.0, 105.0, 160.0), scheme="spur-free", q=30.0, coils=(2, 2), taxels=None, law=1.0, delta_y=10.0
) -> Plan:
    """Plan a pad of 25 mm cells with channels at `hz`."""
    rows, columns = coils
    taxels = taxels or rows * columns * len(hz)
    plan = make_plan(
        parse_spec(f"""
name = "t"
resolution = {taxels}
band_hz = [{min(hz) * 0.7}, {max(hz) * 1.4}]
q_min = {q}
delta_y = {delta_y}
resonances_hz = {list(hz)}
pad = {{ width_mm = {25 * columns}, depth_mm = {25 * rows} }}
coil = {{ grid = [{rows}, {columns}], outer_diameter_mm = 24, inner_diameter_mm = 10, core_diameter_mm = 10 }}
drive = {{ scheme = "{scheme}", level_law = {law}, remanent_share = 0.25 }}
""")
    )
    return bare(plan)


def bare(plan: Plan) -> Plan:
    """Return the plan without the coils around and other modes, so that a coil's closed form is exact."""
    own = []
    for c in plan.channels:
        k = int(np.argmax(c.mode_shares))
        one = {name: (getattr(c, name)[k],) for name in ("modes_hz", "mode_shares", "pulled_shares", "mode_motions")}
        own.append(replace(c, **one, rest_motion=(0.0,) * 6, level_loss_db=0.0))
    return replace(
        plan,
        channels=tuple(own),
        reuse=replace(plan.reuse, leaks_db=(None,) * len(own), retuned_leaks_db=(None,) * len(own)),
    )


def only(**spreads: float) -> Spreads:
    return replace(NONE, **spreads)


def dbs(outcome):
    return [outcome.q05_db, outcome.reached_by_90_percent_db, outcome.median_db, outcome.q95_db]


# Without spreads, and where nothing may change


@pytest.mark.parametrize("scheme", SCHEMES)
def test_prints_without_spreads_are_the_plan(scheme):
    plan = plan_of(scheme=scheme)
    result = print_yield(plan, 50, spreads=NONE)
    assert result.drive == scheme
    for outcome in (result.planned, result.retuned):
        assert dbs(outcome) == pytest.approx([plan.selectivity.placed_own_modes_db] * 4, abs=DB)


def test_the_paper_s_pad_as_planned_and_as_printed(paper_plan):
    own = print_yield(bare(paper_plan), 50, spreads=NONE)
    lost = paper_plan.selectivity.placed_own_modes_db + max(c.level_loss_db for c in paper_plan.channels)
    assert dbs(own.planned) == pytest.approx([lost] * 4, abs=DB)
    exact = print_yield(paper_plan, 50, spreads=NONE)
    # Coils around and other modes add energies to the worst channel's, which the plan states each for itself.
    leak_db = min(paper_plan.reuse.retuned_leaks_db)
    both = -10 * np.log10(sum(10 ** (-db / 10) for db in (paper_plan.selectivity.placed_all_states_db, leak_db)))
    assert both - 0.1 < exact.nominal_db < both + 1
    printed = print_yield(paper_plan, 2000)
    assert printed.spreads == spreads_of(paper_plan.spec)
    stages = [getattr(printed, name).median_db for name in OUTCOMES]
    assert stages == sorted(stages) and stages[-1] < exact.nominal_db


def test_a_pad_that_is_scaled_as_a_whole_is_as_selective_after_tuning():
    plan = plan_of()
    result = print_yield(plan, 2000, spreads=only(modulus=0.2))
    assert dbs(result.retuned) == pytest.approx([plan.selectivity.placed_own_modes_db] * 4, abs=DB)
    assert result.planned.median_db < result.retuned.median_db - 10
    assert result.swapped_share == 0


def test_tuning_never_costs_yield_where_channels_are_far_apart():
    plan = plan_of(hz=(50.0, 160.0), scheme="tones", q=15.0)
    for size in (0.1, 0.3, 1.0, 3.0):
        spreads = Spreads(*(size * v for v in astuple(USUAL)))
        result = print_yield(plan, 1000, spreads=spreads)
        assert result.retuned.taxels.share >= result.planned.taxels.share
        assert result.retuned.pads.share >= result.planned.pads.share
        assert all(np.greater_equal(dbs(result.retuned), dbs(result.planned)))
    assert result.planned.taxels.share < result.retuned.taxels.share


# The resonances of prints


@pytest.mark.parametrize(
    ("name", "sigma", "per_unit", "low", "high"),
    [
        ("modulus", 0.01, lambda c: 0.5, 1, 1),
        ("common_z_mm", 0.002, lambda c: 1.5 / c.beam.thickness_mm, 0.98, 1.02),
        ("width_mm", 0.01, lambda c: 0.5 / c.beam.width_mm, 0.95, 1.02),  # the wall bends with wide beams
        ("field_z_mm", 0.002, lambda c: 1.5 / c.beam.thickness_mm, 0.98, 1.02),
        ("thickness_mm", 0.002, lambda c: 1.5 / c.beam.thickness_mm, 0.98, 1.02),
        ("length_mm", 0.05, lambda c: 1.5 / c.beam.length_mm, 0.6, 1.0),
        ("glue_mg", 3.0, lambda c: 0.5 / (c.effective_mass_g * 1e3), 1, 1),
        ("common_glue_mg", 3.0, lambda c: 0.5 / (c.effective_mass_g * 1e3), 1, 1),
        ("gap_mm", 0.05, lambda c: c.pull_shift * (c.pull_exponent + 1) / (1 - c.sag_um / 1000), 1, 1),
        ("common_gap_mm", 0.05, lambda c: c.pull_shift * (c.pull_exponent + 1) / (1 - c.sag_um / 1000), 1, 1),
    ],
)
def test_sigma_of_one_spread_is_by_the_rule(name, sigma, per_unit, low, high):
    # At 50 Hz the lowest channel's sideways mode would lie on its own, and share what a width does.
    plan = plan_of((54.0, 70.0, 105.0, 160.0))
    result = print_yield(plan, 4000, spreads=only(**{name: sigma}))
    draws = 4000 * (1 if name in (*module.OF_A_PRINT, "field_z_mm") else 4)
    sampling = 4 / sqrt(2 * draws)
    for channel, found in zip(plan.channels, result.channels, strict=True):
        ratio = found.sigma_f / (sigma * per_unit(channel))
        assert low * (1 - sampling) < ratio < high * (1 + sampling)


def test_sigma_of_all_spreads_adds_in_squares():
    plan = plan_of()
    rest = ("modulus", "common_z_mm", "field_z_mm", "washer_mm", "gap_mm", "beads", *module.OF_A_PRINT)
    z = replace(USUAL, **dict.fromkeys(rest, 0.0))
    for channel, found in zip(plan.channels, print_yield(plan, 4000, spreads=z).channels, strict=True):
        terms = (
            found.per_width * z.width_mm / channel.beam.width_mm,
            found.per_thickness * z.thickness_mm / channel.beam.thickness_mm,
            found.per_length * z.length_mm / channel.beam.length_mm,
            0.5 * z.glue_mg / (channel.effective_mass_g * 1e3),
        )
        assert found.sigma_f == pytest.approx(sqrt(sum(t**2 for t in terms)), rel=4 / sqrt(2 * 16000))


BEADS = re.compile(r"\| (pad-32|quad-64|wide-11), (\d+) \| [^|]* \| [0-9.]+ \| ([0-9.]+) \| ([0-9.]+) \|")


def test_resonances_feel_stiffness_across_beads_as_solids_do():
    """By 3-D elasticity (print_spread.md), its ends' part times the six tenths of their plastic that lie across.

    A third of it is the bar: how much of what holds a beam lies across differs from beam to beam by that.
    """
    rows = BEADS.findall((Path(__file__).parents[1] / "reference" / "print_spread.md").read_text())
    assert len(rows) == 11
    for name, channel, beam, ends in rows:
        slope = module.sensitivities(template(name))[int(channel), 3]
        assert slope == pytest.approx(float(beam) + 0.6 * float(ends), rel=1 / 3), (name, channel)


def test_twist_feels_stiffness_across_beads_and_bending_does_not():
    """A flat strip's twist goes with the shear between beads, a tall one's with that between layers (Lekhnitskii)."""
    flat, tall = (torsion_constant(w, t, beads=0.8) / torsion_constant(w, t) for w, t in ((50.0, 1.0), (1.0, 50.0)))
    assert flat == pytest.approx(0.8, rel=1e-2)
    assert tall == pytest.approx(1.0, rel=1e-2)
    # Both ratios alike are a softer shear modulus.
    assert torsion_constant(2.0, 1.0, 0.7, 0.7) == pytest.approx(0.7 * torsion_constant(2.0, 1.0), rel=1e-12)
    legs, straight = (
        make_plan(parse_spec(f'{FOUR}[coil]\ngrid = [4, 4]\n[suspension]\ntopology = "{name}"\n'))
        for name in ("serpentine-5", "cantilever")
    )
    twisting, bending = (module.sensitivities(plan)[:, 3] for plan in (legs, straight))
    assert twisting.min() > 2 * bending.max()


def test_beads_move_channels_apart_alike_in_every_print():
    plan = template("quad-64")
    design = module.design_of(plan, None)
    x = module.drawn_prints(design, only(across_beads=log(1 / 0.8)), 0, 0, 3).log_x
    slope = module.sensitivities(plan)[:, 3]
    assert x == pytest.approx(np.broadcast_to(((slope - slope.mean()) * log(0.8))[design.channel, None], x.shape))
    assert abs(x).max() > 0.004
    # They are no spread.
    assert module.ratio_spread(design, only(across_beads=0.3)) == 0
    assert module.detuning_sigmas(design, only(across_beads=0.3)) == (0, 0, 0, 0)


def test_pulls_go_with_their_gaps():
    plan = plan_of()
    design = module.design_of(plan, None)
    pads = 4000
    drawn = module.drawn_prints(design, only(common_gap_mm=0.05, gap_mm=0.03), 3, 0, pads)
    wanted = [c.pull_exponent / (1 - c.sag_um / 1000) for c in plan.channels]
    for rows, sigma in ((slice(0, 2), 0.05), (slice(2, 3), hypot(0.05, 0.03))):
        found = drawn.log_pull[rows].std(-1) / sigma
        assert found == pytest.approx(
            np.broadcast_to(np.array(wanted)[design.channel], found.shape), rel=4 / sqrt(2 * pads)
        )
    # A wider gap pulls less, and its smaller softening leaves a higher resonance.
    rise = np.corrcoef(drawn.log_x[2, 0], drawn.log_pull[2, 0])[0, 1]
    assert rise == pytest.approx(-1, abs=1e-9)


def test_the_field_runs_smoothly_over_the_bed():
    """The sample covariance of 4000 pads is exp(−d²/L²) plus that of all other causes, within 4 sigma of sampling."""
    plan = plan_of(coils=(2, 3))
    design = module.design_of(plan, None)
    pads = 4000
    for spreads in (only(field_z_mm=0.01), USUAL):
        x = module.drawn_prints(design, spreads, 3, 0, pads).log_x[2]
        expected = module.covariance(design, spreads)
        sigma = np.sqrt(np.diag(expected))
        found = x @ x.T / pads / np.outer(sigma, sigma)
        sure = 4 / sqrt(pads)
        assert found == pytest.approx(expected / np.outer(sigma, sigma), abs=sqrt(2) * sure)
    field = module.covariance(design, only(field_z_mm=0.01))
    apart = np.linalg.norm(design.place_mm[:, None] - design.place_mm, axis=-1)
    per_mm = [
        result.per_thickness / c.beam.thickness_mm
        for c, result in zip(plan.channels, print_yield(plan, 1).channels, strict=True)
    ]
    each = 0.01 * np.array(per_mm)[design.channel]
    assert field == pytest.approx(np.outer(each, each) * np.exp(-((apart / 50.0) ** 2)), rel=1e-6)


def test_the_semivariogram_of_measured_beds():
    """Of 288 public bed meshes (tests/reference/print_spread.md): 20, 47, 75, 92 % of the sill at 20, 40, 60, 80 mm."""
    length = parse_spec('name = "a"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\n').spread.field_length_mm
    places = np.arange(0, 81, 20.0)
    waves = module._waves(tuple(places.tolist()), length)
    sill = 1 - (waves @ waves.T)[0]
    # Their own spread over 25 printers is wider than this.
    assert sill[1:] == pytest.approx([0.20, 0.47, 0.75, 0.92], abs=0.06)


def test_a_coupon_shares_what_is_common_alone():
    plan = plan_of()
    design = module.design_of(plan, None)
    total = module.covariance(design, USUAL, np.array([0, 1]))
    taxels = len(plan.taxels)
    weight = np.array(astuple(USUAL))[:, None] * design.weight
    weight = weight[[module.NAMES.index(name) for name in module.OF_A_PRINT]]
    common = weight.T @ weight
    assert total[taxels:, :taxels] == pytest.approx(common[:2][:, design.channel], rel=1e-12)


def test_the_papers_five_replicas_are_likely_by_the_typical_spread_and_not_by_a_broad_one():
    """Ten taxels of five prints lay within f/2Q of their tones (print_spread.md: 15 % likely at Q = 15).

    The beam is taken as 1 × 1 × 10 mm, since the paper gives none; tones were set by the first print, the bias is off.
    """
    rng = np.random.default_rng(0)
    half = 1 / 30

    def likely(common, own, prints=20_000):
        x = common * rng.standard_normal((prints, 5, 1)) + own * rng.standard_normal((prints, 5, 2))
        return float((np.abs(x) < half).all((1, 2)).mean())

    spread = parse_spec('name = "a"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\n').spread
    common = hypot(1.5 * hypot(spread.common_z_mm, spread.field_z_mm), spread.common_modulus / 2)
    own = hypot(1.5 * spread.thickness_mm, 0.5 * spread.width_mm, 0.15 * spread.length_mm)
    assert 0.05 < likely(common, own) < 0.5
    assert likely(0.072, 0.044, 200_000) < 1e-3


# One printed coil, state by state


def lines_of(scheme, tone, force, ratio, rho, state):
    """Return lines of i² + ρ i as (frequency, amplitude, channel whose own it is), by multiplying the sines out."""
    active = np.flatnonzero(state)
    lines = [(tone[j], force[j], None) for j in active]
    if scheme in ("tones", "time-shared"):
        current = np.sqrt(2 * force)
        at = tone / 2
        lines += [(at[j], rho * current[j], j) for j in active]
    if scheme == "biased":
        bias = sqrt(ratio * force.max() / 2)
        current = force / (2 * bias)
        at = tone
        lines += [(2 * at[j], current[j] ** 2 / 2, j) for j in active]
    if scheme not in ("tones", "biased"):
        return lines
    for a, b in combinations(active, 2):
        lines += [(f, current[a] * current[b], None) for f in (at[a] + at[b], abs(at[a] - at[b]))]
    return lines


def states_db(plan, off_by, pulled, retuned):
    """Return the smallest ON over largest OFF amplitude in dB of a coil.

    Its resonances are `off_by` times the plan's, the pulls on its washers `pulled` times.
    """
    names = ("resonance_hz", "q", "effective_mass_g", "force_constant_n_per_a2")
    planned, q, mass, pull = (np.array([getattr(c, name) for c in plan.channels]) for name in names)
    drive = plan.spec.drive
    scheme = plan.selectivity.drive
    hz = planned * off_by
    tone = hz if retuned else planned
    level = tone**-drive.level_law
    force = level / np.abs(receptance(tone, tone, mass, q)) / (pull * pulled if retuned else pull)
    pull = pull * pulled
    on = []
    off = []
    for state in product((0, 1), repeat=len(hz)):
        rho = sqrt(plan.scheme.remanence * force.max())
        lines = lines_of(scheme, tone, force, drive.bias_ratio, rho, state)
        for i, active in enumerate(state):
            heard = [
                (own != i) * abs(a * pull[i] * receptance(f, hz[i], mass[i], q[i]) / level[i]) ** 2
                for f, a, own in lines
            ]
            energy = sum(heard)
            if scheme == "time-shared":
                # Each channel's turn has its tone and its line by remanence.
                turns = sum(state)
                energy = max((heard[k] + heard[k + turns] for k in range(turns)), default=0.0)
            (on if active else off).append(energy)
    return 10 * np.log10(min(on) / max(off))


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_printed_coil_state_by_state(scheme, seed):
    plan = plan_of(scheme=scheme, coils=(1, 1), law=0.7)
    design = module.design_of(plan, None)
    drawn = module.drawn_prints(design, USUAL, seed, 0, module.MOST_DRAWN)
    off_by, pulled = (np.exp(part[2, :, 0]) for part in drawn)
    result = print_yield(plan, 1, seed, spreads=USUAL)
    assert np.abs(off_by - 1).max() > 0.01
    assert plan.scheme.remanence > 0
    assert result.planned.median_db == pytest.approx(states_db(plan, off_by, pulled, False), abs=DB)
    assert result.retuned.median_db == pytest.approx(states_db(plan, off_by, pulled, True), abs=DB)


# Yields


def test_taxels_that_have_a_coil_each_follow_the_normal_law():
    plan = plan_of(hz=(80.0,), q=15.0)
    sigma_mm = 0.04
    result = print_yield(plan, 5000, spreads=only(width_mm=sigma_mm))
    sigma = result.channels[0].per_width * sigma_mm / plan.channels[0].beam.width_mm
    # ON energy 1/((Q (u - 1))² + u) of a fixed force at least half, in u = (f'/f)².
    q = 15.0
    low, high = np.sort(np.roots([q**2, 1 - 2 * q**2, q**2 - 2]))
    share = norm.cdf(log(high) / 2 / sigma) - norm.cdf(log(low) / 2 / sigma)
    assert 0.2 < share < 0.95
    found = result.planned.taxels
    pads = result.planned.pads
    assert found.made == 20_000
    assert found.share == pytest.approx(share, abs=4 * sqrt(share * (1 - share) / 20_000))
    assert pads.share == pytest.approx(share**4, abs=4 * sqrt(share**4 * (1 - share**4) / 5000))
    assert result.retuned.taxels.share == 1
    assert (result.planned.median_db, result.nominal_db, result.swapped_share) == (None, None, None)
    assert "1/sqrt(2)" in result.criterion and "no selectivity" in result.criterion


def test_a_coil_with_one_taxel_beside_coils_with_two():
    plan = plan_of(hz=(50.0, 160.0), taxels=7)
    assert len(plan.taxels) == 7
    exact = print_yield(plan, 20, spreads=NONE)
    assert exact.planned.pads.share == exact.planned.taxels.share == exact.retuned.pads.share == 1
    assert exact.planned.median_db == pytest.approx(plan.selectivity.placed_own_modes_db, abs=DB)
    assert "to itself" in exact.criterion
    spoilt = print_yield(plan, 500, spreads=only(modulus=0.5))
    assert spoilt.planned.taxels.share < 0.5 and spoilt.retuned.pads.share == 1


def test_yields_are_of_the_asked_selectivity():
    plan = plan_of()
    high = replace(plan, selectivity=replace(plan.selectivity, asked_db=plan.selectivity.placed_own_modes_db))
    assert print_yield(high, 10, spreads=NONE).planned.pads.share == 1
    higher = replace(plan, selectivity=replace(plan.selectivity, asked_db=plan.selectivity.placed_own_modes_db + 1e-6))
    none = print_yield(higher, 10, spreads=NONE).planned
    assert none.pads.share == 0
    assert none.taxels.share == 0.75, "the worst taxel of four is the one that misses"


def test_quantiles_rise_and_intervals_are_wilson_s():
    shared = replace(USUAL, modulus=0.1, thickness_mm=0.01, common_z_mm=0.02)
    result = print_yield(plan_of(delta_y=2.5), 2000, spreads=shared)
    for outcome in (result.planned, result.retuned):
        assert dbs(outcome) == sorted(set(dbs(outcome)))
        share = outcome.pads
        z = norm.ppf(0.975)
        n = share.made
        p = share.share
        middle = p + z**2 / (2 * n)
        half = z * sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        expected = [(middle - half) / (1 + z**2 / n), (middle + half) / (1 + z**2 / n)]
        assert [share.low, share.high] == pytest.approx(expected, abs=1e-3 * half)
        # Taxels share their pad's drift: less is known than from as many independent ones, more than from pads.
        taxels = outcome.taxels
        alone = 2 * z * sqrt(taxels.share * (1 - taxels.share) / taxels.made)
        # Re-tuning takes the drift out again.
        least = 1.01 if outcome is result.planned else 0.999
        assert least * alone < taxels.high - taxels.low < 5 * alone


def test_neighbours_that_swapped_or_came_too_close():
    plan = plan_of()
    sigma_mm = 0.1
    result = print_yield(plan, 2000, spreads=only(thickness_mm=sigma_mm))
    limit = log(ladder_ratio(30.0, 10.0))
    swapped = []
    crowded = []
    pairs = pairwise(zip(plan.channels, result.channels, strict=True))
    for (a, low), (b, high) in pairs:
        sigma = sigma_mm * hypot(low.per_thickness / a.beam.thickness_mm, high.per_thickness / b.beam.thickness_mm)
        apart = norm(log(b.resonance_hz / a.resonance_hz), sigma)
        swapped.append(apart.cdf(0))
        crowded.append(apart.cdf(limit) - apart.cdf(-limit))
    # The pairs of a coil share channels: as sure as from one pair of each of 8000 coils.
    sampling = 4 * 0.5 / sqrt(8000)
    assert min(np.mean(swapped), np.mean(crowded)) > 2 * sampling
    assert result.swapped_share == pytest.approx(np.mean(swapped), abs=sampling)
    assert result.crowded_share == pytest.approx(np.mean(crowded), abs=sampling)


# Capacity with a guard band, in closed form

BAND_HZ = (20.0, 1000.0)
COILS = 16


def good_share(count, q, law, scheme, need, sigma, stage, pads=200, band_hz=BAND_HZ, coils=COILS):
    """Share of simulated pads that are good: a ladder over so many coils, each taxel with a sigma of its own."""
    hz = geometric_ladder(*band_hz, count)
    one = np.ones(count)
    weight = np.zeros((len(module.NAMES), count))
    weight[module.NAMES.index("thickness_mm")] = 1.0
    design = module.Design(
        *(
            hz,
            q * one,
            one,
            one,
            np.zeros((2, count)),
            0 * one,
            (None,),
            1.0,
            law,
            scheme,
            need,
            1.0,
            weight,
            0 * hz,
            np.zeros((count, 3)),
        ),
        *(np.tile(np.arange(count), coils), np.zeros((count * coils, 2)), 50.0),
        (module.Coils(np.arange(count), np.arange(count * coils).reshape(coils, count).T),),
    )
    return module.simulated_prints(design, only(thickness_mm=sigma), pads, 1, (stage,)).good.mean()


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(
    ("q", "asked_db", "law", "sigma", "stage"),
    [
        (15, 20, 1, 0.03, "retuned"),
        (60, 14, 0, 0.03, "retuned"),
        (30, 20, 1, 0.01, "some"),
        (30, 17, 2, 0.01, "retuned"),
    ],
)
def test_channels_that_print_are_the_monte_carlos(scheme, q, asked_db, law, sigma, stage):
    """One channel less prints well, and two more do not (0.05 is 2 sigma of 200 pads).

    Biased at 1/f², where differences of pairs decide, whose amplitudes a print changes, may be three channels off.
    """
    slack = 3 if (scheme, law) == ("biased", 2) else 1
    law = LevelLaw(law)
    drive = Scheme(scheme)
    spreads = (sigma, 0.0) if stage == "retuned" else (0.0, sigma)
    found = printed_count(BAND_HZ, q, law, drive, asked_db, 0.9, COILS, *spreads)
    exact, _ = largest_counts(BAND_HZ, q, law, drive, asked_db)
    need = 10 ** (asked_db / 10)
    fewer = found - slack
    more = found + slack + 1
    assert fewer < 2 or good_share(fewer, q, law, drive, need, sigma, stage) > 0.85
    assert more > exact or good_share(more, q, law, drive, need, sigma, stage) < 0.95
    assert printed_count(BAND_HZ, q, law, drive, asked_db, 0.9, COILS, 0.0) == exact


def test_two_channels_in_turn_print_as_their_ratio_does():
    q = 15.0
    sigma = 0.1
    need = 100.0
    hz = np.array([50.0, 75.0])
    closest = np.arcsinh(sqrt(need - 1) / (2 * q))
    alone = norm.cdf((log(1.5) - closest) / (sqrt(2) * sigma)) + norm.cdf((-log(1.5) - closest) / (sqrt(2) * sigma))
    found = estimated_print_share(channels(hz, q, LevelLaw(1)(hz)), Scheme("time-shared"), need, 5, sigma)
    assert 0.1 < found == pytest.approx(alone**5, rel=1e-9)
    # Eq. 12 asks for 1.4: it takes √(Δy² − 1) for Δy and the response as straight.
    assert np.exp(closest) == pytest.approx(ladder_ratio(q, 10), rel=0.015)


def test_spread_of_a_ratio_and_coils_of_a_plan():
    """The worst pair's ratio as simulated prints have it, and each coil's share with its taxels'."""
    plan = pg.plan("triple-48")
    design = module.design_of(plan, None)
    spreads = spreads_of(plan.spec)
    pads = 4000
    log_x = module.drawn_prints(design, spreads, 3, 0, pads).log_x
    # Of both sets of resonances.
    pairs = [np.diff(log_x[2, module.coils_of(plan)[coil]], axis=0) for coil in ((0, 0), (0, 1))]
    sampled = np.std(pairs, axis=-1).max()
    assert plan.prints.ratio_spread == pytest.approx(sampled, rel=4 / sqrt(2 * pads))
    assert 1 <= plan.capacity.prints < plan.capacity.exact
    missed = [(log_x[2] - known).std(axis=-1).max() for known in (0.0, *log_x)]
    # The largest of several channels' samples is a little larger than its sigma.
    assert module.detuning_sigmas(design, spreads) == pytest.approx(missed, rel=6 / sqrt(2 * pads))
    plan = replace(plan, selectivity=replace(plan.selectivity, asked_db=21.5))
    prints = what_prints_keep(plan, design_of(plan, None))
    taxels = print_yield(plan, prints.pads).good_prints
    assert len(set(prints.coil_shares)) > 1
    for (row, column), own in module.coils_of(plan).items():
        share = prints.coil_shares[row * plan.coils.columns + column]
        assert prints.good_share <= share <= min(taxels[i] for i in own)
    assert prints.good_share >= 1 - sum(1 - share for share in prints.coil_shares)


# What costs most


def test_the_only_spread_is_the_costliest_and_all_of_the_loss():
    plan = plan_of(delta_y=2.0)
    result = print_yield(plan, 300, spreads=only(thickness_mm=0.04, modulus=1e-5))
    assert [cost.spread for cost in result.costs] == list(module.NAMES)
    cost = result.costs[module.NAMES.index("thickness_mm")]
    assert result.cost_pads == 300
    for name in ("planned", "retuned"):
        outcome = getattr(result, name)
        gain = getattr(cost, name)
        assert getattr(result, f"costliest_{name}") == ("thickness_mm", "pads")
        assert gain.pads == pytest.approx(1 - outcome.pads.share)
        assert gain.taxels == pytest.approx(1 - outcome.taxels.share)
        assert gain.median_db == pytest.approx(plan.selectivity.placed_own_modes_db - outcome.median_db, abs=0.05)
    assert print_yield(plan, 50, spreads=NONE).costliest_retuned == ("none", "none")


# The same bits, bounded work, plain data


def test_a_seed_gives_the_same_bits_in_blocks_of_any_size(monkeypatch):
    for plan in (plan_of(scheme="tones"), plan_of(scheme="biased", coils=(1, 1))):
        first = print_yield(plan, 20, 7, spreads=USUAL)
        assert print_yield(plan, 20, 7, spreads=USUAL) == first
        assert dbs(print_yield(plan, 20, 8, spreads=USUAL).planned) != dbs(first.planned)
        for block in (1, 300):
            monkeypatch.setattr(module, "BLOCK", block)
            assert print_yield(plan, 20, 7, spreads=USUAL) == first
        monkeypatch.undo()


def test_the_first_pads_are_the_same_however_many():
    plan = plan_of()
    design = module.design_of(plan, None)
    few, many = (module.simulated_prints(design, USUAL, pads, 0) for pads in (100, 5000))
    assert np.array_equal(few.ratio, many.ratio[:, :100])
    assert len(np.unique(many.ratio[0])) > 4990, "streams must differ"


def test_pads_are_limited_by_work():
    plan = plan_of(scheme="tones")
    responses = 4 * 4 * (4**2 + 4 * 4 * 3) + 10 * 16
    result = print_yield(plan, 1000, spreads=USUAL, budget=100 * responses)
    assert (result.pads, result.pads_asked, result.cost_pads) == (100, 1000, 5)
    assert result.planned.pads.made == 100
    with pytest.raises(ValueError, match="pads must be at least 1, got 0"):
        print_yield(plan, 0)


def test_the_result_is_plain_data(small_plan):
    result = print_yield(small_plan, 20)
    assert json.loads(json.dumps(asdict(result), allow_nan=False))["pads"] == 20
    absurd = print_yield(small_plan, 200, spreads=only(thickness_mm=100.0))
    json.dumps(asdict(absurd), allow_nan=False)


def test_planning_does_not_load_it():
    code = "import sys, padgen.planner; sys.exit('padgen.planner.print_yield' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


# A plan's own estimate, and a second opinion that shares no code with it


@cache
def four_lines() -> Plan:
    return make_plan(parse_spec(FOUR))


def test_the_four_line_spec_prints():
    """Nine in ten re-tuned pads keep what was asked, by a program that knows only plan.json and print_spread.md.

    It differs by up to half a decibel, by its rule of exponents, its sampling (0.1 dB of 1000 pads) and its modes,
    whose answers it adds as amplitudes where the plan adds energies.
    """
    plan = four_lines()
    data = json.loads(plan_to_json(plan))
    told = kept_db(data, pads=1000)
    assert np.mean(told >= 14) >= 0.95
    assert np.mean(kept_db(data, pads=1000, leak=False) >= 20) >= 0.9
    assert np.quantile(told, 0.1) == pytest.approx(plan.prints.print_db, abs=0.5)
    assert plan.prints.good_share >= plan.spec.print_share


TEMPLATES = ("pad-32", "paper-32", "calibration", "triple-48", "quad-64", "resin-fine", "wide-11")


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", TEMPLATES)
def test_what_templates_keep_by_a_program_of_its_own(name):
    """Within 0.3 dB and 2 % by plan.json and print_spread.md, whose terms it works out in its own way.

    As drawn they agree within 0.02 dB. Without the modes' own errors in prints, padgen promised triple-48 1.2 dB more.
    """
    plan = template(name)
    data = json.loads(plan_to_json(plan))
    told = kept_db(data, pads=4000)
    if name == "triple-48":
        drawn = kept_db(data, level=None, pads=1)[0]
        assert drawn == pytest.approx(compared_prints(plan, np.inf, 0.0)[0], abs=0.02)
    assert plan.prints.print_db == pytest.approx(np.quantile(told, 0.1), abs=0.3)
    assert plan.prints.good_share == pytest.approx(np.mean(told >= plan.selectivity.asked_db), abs=0.02)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "range_k"), [("pad-32", 16.0), ("quad-64", 4.0), ("resin-fine", 2.0)])
def test_what_prints_keep_for_life_by_a_program_of_its_own(name, range_k):
    """Within 0.3 dB by the program that shares no code, of pads that keep all, most and few of what is asked."""
    plan = template(name)
    spec = replace(plan.spec, life=replace(plan.spec.life, temperature_range_k=range_k))
    plan = replace(plan, spec=spec)
    life = planned_life(plan, design_of(plan, None))
    told = kept_db(json.loads(plan_to_json(plan)), pads=4000, for_life=True)
    assert life.print_db == pytest.approx(np.quantile(told, 0.1), abs=0.3)
    # A decibel is up to a quarter of all prints, and the programs differ by 0.2 dB before anything has changed.
    assert life.good_share == pytest.approx(np.mean(told >= plan.selectivity.asked_db), abs=0.06)
    assert life.print_db < plan.prints.print_db - 0.5


def test_a_pad_that_nothing_happens_to_keeps_for_life_what_it_keeps_re_tuned():
    plan = template("pad-32")
    nothing = LifeTable(temperature_range_k=0.0, ageing=0.0, common_q=0.0, q=0.0)
    plan = replace(plan, spec=replace(plan.spec, life=nothing))
    design = design_of(plan, None)
    few = replace(plan, prints=what_prints_keep(plan, design, quick=True))
    life = planned_life(few, design)
    assert life.pads == few.prints.pads
    assert life.print_db == pytest.approx(few.prints.print_db, abs=1e-9)
    assert (life.shifts, life.retune_k) == ((0.0, 0.0), 0.0)


def test_the_change_of_temperature_up_to_which_prints_keep_what_is_asked():
    """At that change nine in ten keep it, a kelvin beyond it they do not, and the finding names it."""
    plan = make_plan(replace(load_spec("quad-64"), life=LifeTable()))
    kept_k = plan.life.retune_k
    assert 0 < kept_k < plan.life.temperature_range_k
    finding = next(finding for finding in plan.findings if finding.code == "print.life")
    assert f"re-tune it after every change of {kept_k:g} K" in finding.message
    shares = []
    for range_k in (kept_k, kept_k + 1.0):
        spec = replace(plan.spec, life=replace(plan.spec.life, temperature_range_k=range_k))
        changed = replace(plan, spec=spec)
        shares.append(planned_life(changed, design_of(changed, None)).good_share)
    # By 200 prints, of which nine in ten are sure to 4 %.
    assert shares[0] > plan.spec.print_share - 0.04 > shares[1]


def test_prints_are_not_judged_once_too_few_of_them_can_be_good():
    plan = pg.plan("pad-32")
    design = design_of(plan, None)
    spreads = spreads_of(plan.spec)
    drift = Drift(0.05, plan.spec.life)
    whole = simulated_prints(design, spreads, 5000, 0, ("retuned",), drift)
    share = whole.good[0].mean()
    assert 0.1 < share < 0.99
    kept = simulated_prints(design, spreads, 5000, 0, ("retuned",), drift, share - 0.01)
    assert np.array_equal(kept.good, whole.good)
    broken_off = simulated_prints(design, spreads, 5000, 0, ("retuned",), drift, 0.999)
    judged = np.flatnonzero(np.isfinite(broken_off.ratio[0]))
    # In blocks: those that are judged come first, and the others count as good.
    assert 0 < len(judged) < 5000
    assert np.array_equal(broken_off.good[0, judged], whole.good[0, judged])
    assert broken_off.good[0, len(judged) :].all()
    assert broken_off.good[0].mean() < 0.999


@pytest.mark.parametrize("seed", [None, pytest.param(77, marks=pytest.mark.soak), 147])
def test_the_plans_estimate_is_the_monte_carlos(seed):
    """Of 200 random specs none is 0.3 dB or 2 % off (docs/yield.md); where 89 or 74 % are good, more pads are taken."""
    plan = make_plan(random_spec(seed, 48) if seed else load_spec("paper-32"))
    many = print_yield(plan, 10_000, seed=1)
    quick = plan.prints
    assert quick.print_db == pytest.approx(many.retuned.reached_by_90_percent_db, abs=0.3)
    # As planned, prints scatter most: the tenth-worst of a thousand is known to 0.5 dB (one sigma).
    assert quick.planned_db == pytest.approx(many.planned.reached_by_90_percent_db, abs=1.2)
    assert quick.good_share == pytest.approx(many.retuned.pads.share, abs=0.02)
    assert 0 < quick.error_db < 0.3 and quick.error_share < 0.02
    assert (quick.pads > 1000) == (seed is not None)


@pytest.mark.parametrize("seed", [20002, 20029, 20045])
def test_the_search_against_every_layout(seed):
    """Each layout of a small pad planned and printed: the choice is good enough, and none of fewer coils is.

    Two that need alternate sets, another drive or more coils than the fewest, and one that none satisfies. By 2000 pads
    of another seed; over random specs: docs/yield.md.
    """
    spec = random_spec(seed, 10)
    short, coils, layouts = shortfall(replace(spec, coil=replace(spec.coil, gap_mm=1.0)), 2000)
    assert layouts > 5
    assert (short <= 0.01, coils) == (True, 0)


def test_modes_and_leakage_are_counted_once_each():
    """On the pad as drawn, the planned energies of all modes and of the coils around are added."""
    plan = four_lines()
    worst = max(
        10 ** (-plan.selectivity.placed_all_states_db / 10) + 10 ** (-leak / 10) for leak in plan.reuse.retuned_leaks_db
    )
    lost = max(c.level_loss_db for c in plan.channels)
    paper_db, prints = compared_prints(plan, np.inf, 0.0)
    assert prints is NOT_PRINTED
    assert paper_db == pytest.approx(-10 * np.log10(worst) - lost, abs=1.0)
    assert paper_db <= min(*plan.reuse.retuned_leaks_db, plan.selectivity.kept_db)


def test_lines_of_coils_apart_add_as_energies():
    """Lines i_k i_l of tones at f_k and f_l are added by hand for three coils; in step their fields add to (Σ b)⁴."""
    field = np.array([0.3, 0.2, 0.1])
    leak = Leakage(np.outer(field, field)[None], field[None])
    lines = [(field[k] ** 2) ** 2 for k in range(3)]
    lines += [(2 * field[a] * field[b]) ** 2 for a, b in combinations(range(3), 2)]
    every = np.ones(3, bool)
    assert _lines_apart(leak, every, Scheme("tones")) == pytest.approx([sum(lines)], rel=1e-12)
    biased = [(field[k] * field.sum() + field[k]) ** 2 for k in range(3)]
    assert _lines_apart(leak, every, Scheme("biased")) == pytest.approx([sum(biased)], rel=1e-12)
    assert sum(lines) < field.sum() ** 4
