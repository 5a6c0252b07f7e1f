"""All modes of the taxels: their effect on selectivity, and the findings about them.

| model | reference | tolerance | reason |
|---|---|---|---|
| answer of a taxel with two modes | complex sum by hand | 1e-14 | a few roundings |
| closed form over states | complex sums, all 2^n states | 1e-12 relative energy | same sums in another order |
| answers at Q up to 1e8, lines 1e-9 from a mode | mpmath, 50 digits | 1e-12 | a few roundings; no cancellation |
| one mode | the single resonator | 1e-13 | the same formula, rounded in another order |
| modes left out | all modes counted | the stated bound | it is a bound |
| modes of the beam model | another point of the same body | 1e-10 | a few roundings |
"""

import json
import re
from dataclasses import replace

import mpmath
import numpy as np
import pytest

import padgen as pg
from padgen.core.errors import number
from padgen.physics.ladder import LevelLaw
from padgen.physics.resonator import (
    LEFT_OUT,
    UPWARD,
    ModalTaxels,
    TaxelModes,
    felt_energy,
    felt_gains,
    modal_taxels,
    without_quiet_modes,
)
from padgen.physics.schemes import in_order
from padgen.physics.selectivity import (
    Channels,
    Scheme,
    all_states,
    channels,
    off_energy,
    one_hot_db,
    tone_energy,
)
from padgen.planner import judge, make_plan, plan_from_json, plan_to_json
from padgen.planner.channels import (
    coil_modes,
    hanging_gap_um,
    mode_names,
    plan_channels,
    site_pulls,
    site_wrenches,
    taxel_modes,
)
from padgen.planner.drive_scheme import _resonators, placed_channels, plan_selectivity
from padgen.planner.judge import parasitic_modes
from padgen.planner.plan import Site
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape, solved_model
from padgen.spec import load_spec, parse_spec
from tests.every_state import exhaustive_states_db

SCHEMES = in_order()
ALL = [Scheme(name) for name in SCHEMES]
DB = 10 / np.log(10)
CROWDED = """name = "crowded"
resolution = 16
band_hz = [40, 500]
q_min = 30
resonances_hz = [60, 85, 120, {}]
[coil]
grid = [2, 2]
[pad]
width_mm = 40
depth_mm = 40
[suspension]
topology = "cantilever"
[taxel]
boss_diameter_mm = 3.5
"""


def random_coil(count, modes, seed):
    """Return channels whose taxels have random other modes in three directions, up to half as strong as their own."""
    draw = np.random.default_rng(seed)
    own = np.sort(draw.uniform(40, 400, count))
    which = channels(own, draw.uniform(5, 50, count), draw.uniform(0.5, 2, count), 0.1, draw.uniform(0.5, 2, count))
    frequency = np.concatenate([own[:, None], draw.uniform(20, 2000, (count, modes - 1))], 1)
    gain = draw.uniform(-0.5, 0.5, (count, modes, 3))
    gain[:, 0, 0] = 1.0
    return which, modal_taxels(frequency, gain, which.q, own)


def model_of(spec, topology="cantilever", beam=(0.627, 0.3, 6.6)):
    return TaxelModel(spec, topology, plate_shape(spec), BeamShape(*beam))


# Answers


def test_a_taxel_with_two_modes_by_hand():
    """The own mode is at 50 Hz, one of opposite sign and a tenth of its compliance at 80 Hz, with Q = 10."""
    frequency = np.array([[50.0, 80.0]])
    gain = np.array([[[1.0], [-0.1]]])
    q = np.array([10.0])
    taxels = modal_taxels(frequency, gain, q, np.array([50.0]))

    def answer(f):
        return sum(g / (1 - (f / r) ** 2 + 1j * f / (r * 10)) for r, g in ((50, 1.0), (80, -0.1)))

    found = felt_energy(taxels, slice(None), np.array([30.0, 50.0, 80.0]))[0]
    assert found == pytest.approx([abs(answer(f) / answer(50.0)) ** 2 for f in (30.0, 50.0, 80.0)], rel=1e-14)
    assert found[1] == pytest.approx(1, rel=1e-14)
    # At its peak the small mode answers with a tenth of the own one's, turned by the own one's tail.
    assert abs(answer(80.0)) == pytest.approx(abs(1j + 1 / (1 - 2.56 + 0.16j)), rel=1e-12)


def test_the_figures_of_two_modes_by_hand():
    """With one of two channels on, the OFF taxel 0 has a mode on the other's tone."""
    which = channels(np.array([50.0, 80.0]), 10.0, np.array([1.0, 1.0]))
    frequency = np.array([[50.0, 80.0], [80.0, 50.0]])
    gain = np.array([[[1.0], [0.2]], [[1.0], [0.0]]])
    modes = modal_taxels(frequency, gain, which.q, which.resonance_hz)
    ratio = which.line[1] / which.line[0]
    heard = 1 / (1 - 2.56 + 0.16j) + 0.2 / 0.1j
    own = 1 / 0.1j + 0.2 / (1 - 0.390625 + 0.0625j)
    assert one_hot_db(which, Scheme("tones"), modes) == pytest.approx(-20 * np.log10(abs(heard / own) * ratio))
    assert one_hot_db(which, Scheme("tones"), modes) < one_hot_db(which, Scheme("tones")) - 8


def test_in_turns_the_worst_channel_may_be_one_that_drives_a_mode():
    """The nearer tone moves the taxel's own mode more; its other mode lies on the farther tone."""
    which = channels(np.array([50.0, 80.0, 130.0]), 10.0, np.array([1.0, 0.5, 0.2]))
    frequency = np.array([[50.0, 130.0], [80.0, 1e3], [130.0, 1e3]])
    gain = np.zeros((3, 2, 1))
    gain[:, 0] = 1.0
    gain[0, 1] = 0.5
    modes = modal_taxels(frequency, gain, which.q, which.resonance_hz)
    turns = Scheme("time-shared")
    assert all_states(which, turns).state == "010"
    assert (all_states(which, turns, modes).state, all_states(which, turns, modes).off) == ("001", 0)


def test_one_mode_is_the_single_resonator():
    which, _ = random_coil(6, 2, seed=3)
    alone = modal_taxels(which.resonance_hz[:, None], np.full((6, 1, 1), 7.0), which.q, which.resonance_hz)
    for scheme in ALL:
        assert off_energy(which, scheme, alone) == pytest.approx(off_energy(which, scheme), rel=1e-13)


@pytest.mark.parametrize("own", [[0.1, 0.3, 0.4, 0.7], [100.0, 100.0 * (1 + 1e-9), 100.0 * (1 + 3e-9)]], ids=str)
@pytest.mark.parametrize("q", [15.0, 1e8])
def test_a_spur_on_a_resonance_keeps_its_distance(q, own):
    """A sum of rounded frequencies misses a third taxel's resonance by a rounding, which counts at Q = 1e8."""
    own = np.array(own)
    which = channels(own, q, 1 / own)
    alone = modal_taxels(own[:, None], np.ones((len(own), 1, 1)), which.q, own)
    for scheme in ALL:
        assert off_energy(which, scheme, alone) == pytest.approx(off_energy(which, scheme), rel=1e-12)


def test_a_taxel_that_its_own_tone_does_not_move_is_refused():
    with pytest.raises(ValueError, match="own tone"):
        modal_taxels(np.array([[50.0]]), np.zeros((1, 1, 3)), np.array([15.0]), np.array([50.0]))


# Every state


def plain_energies(which: Channels, scheme: Scheme, modes: ModalTaxels, state):
    """Return energies (n,) of all taxels in one state, line by line; where channels take turns, of the loudest turn."""
    on = np.flatnonzero(state)
    r = which.resonance_hz
    line = which.line

    def energy(i, f, amplitude):
        d = 1 - (f / modes.frequency_hz[i]) ** 2 + 1j * f / (modes.frequency_hz[i] * modes.q[i])
        return (abs((modes.gain[i] / d[:, None]).sum(0)) ** 2).sum() * (amplitude / line[i]) ** 2

    total = np.zeros(len(r))
    for i in range(len(r)):
        tones = [energy(i, r[j], line[j]) for j in on]
        total[i] = max(tones, default=0.0) if scheme.takes_turns else sum(tones)
        if scheme.name == "biased":
            bias = scheme.bias_ratio * line.max()
            total[i] += sum(energy(i, 2 * r[j], line[j] ** 2 / (4 * bias)) for j in on if j != i)
        for a in on if scheme.has_pair_spurs else ():
            for b in on[on > a]:
                if scheme.name == "tones":
                    found = ((r[a] + r[b]) / 2, abs(r[a] - r[b]) / 2), 2 * np.sqrt(line[a] * line[b])
                else:
                    found = (r[a] + r[b], abs(r[a] - r[b])), line[a] * line[b] / (2 * bias)
                total[i] += sum(energy(i, f, found[1]) for f in found[0])
    return total


@pytest.mark.parametrize("scheme", ALL, ids=SCHEMES)
@pytest.mark.parametrize("count", [2, 3, 5])
def test_closed_form_equals_all_states_with_all_modes(count, scheme):
    """The closed form agrees with complex sums over every state, and with the table of every state."""
    which, modes = random_coil(count, 4, seed=count)
    figure = all_states(which, scheme, modes)
    ratios = []
    for bits in range(1, 2**count - 1):
        state = (bits >> np.arange(count)) & 1
        energy = plain_energies(which, scheme, modes, state)
        ratios.append(energy[state == 0].max())
    on = [plain_energies(which, scheme, modes, np.eye(count)[i])[i] for i in range(count)]
    # 1e-12 of the energies, in dB.
    assert figure.db == pytest.approx(10 * np.log10(min(on) / max(ratios)), abs=1e-12 * DB * 10)
    assert figure.db == pytest.approx(exhaustive_states_db(which, scheme, modes), abs=1e-12 * DB * 10)
    worst = plain_energies(which, scheme, modes, np.array([int(c) for c in figure.state]))
    assert -10 * np.log10(worst[figure.off]) == pytest.approx(figure.db, abs=1e-12 * DB * 10)
    assert figure.db != pytest.approx(all_states(which, scheme).db, abs=0.01)


@pytest.mark.parametrize("scheme", ALL, ids=SCHEMES)
def test_eleven_taxels_with_five_modes_equal_their_2048_states(scheme):
    which, modes = random_coil(11, 5, seed=7)
    assert all_states(which, scheme, modes).db == pytest.approx(
        exhaustive_states_db(which, scheme, modes), abs=1e-12 * DB * 10
    )


@pytest.mark.parametrize("q", [2.500001, 15.0, 1e4, 1e8])
def test_answers_against_fifty_digits(q):
    own = 100.0
    other = 100.0 * (1 + 1e-9)
    frequency, gain = np.array([[own, 171.3, 38.1]]), np.array([[[1.0, 0.1], [-0.3, 0.7], [0.01, 0.2]]])
    taxels = modal_taxels(frequency, gain, np.array([q]), np.array([own]))
    lines = np.array([own, other, 171.3 * (1 - 1e-9), 38.1, 1e-3, 1e6])
    found = felt_energy(taxels, slice(None), lines)[0]
    with mpmath.workdps(50):

        def energy(f):
            parts = [mpmath.mpc(0)] * 2
            for r, row in zip(frequency[0], gain[0], strict=True):
                s = mpmath.mpf(float(f)) / mpmath.mpf(float(r))
                for p in (0, 1):
                    parts[p] += mpmath.mpf(float(row[p])) / (1 - s**2 + 1j * s / mpmath.mpf(q))
            return sum(abs(part) ** 2 for part in parts)

        exact = [float(energy(f) / energy(own)) for f in lines]
    # In parts that cancel, rounding is of the larger one: none here cancels by more than ten.
    assert found == pytest.approx(exact, rel=1e-12)


# Modes left out


def test_modes_far_from_every_line_are_left_out_within_their_bound():
    which, modes = random_coil(7, 6, seed=11)
    modes.frequency_hz[:, 4:] = 40e3
    modes.gain[:, 4:] *= 1e-8
    modes.gain[:3, 3] *= 1e-9  # near the lines, but hardly felt
    fewer = without_quiet_modes(modes, which.resonance_hz, which.line)
    assert fewer.frequency_hz.shape == (7, 4)
    assert (fewer.gain[:3] != 0).any(2).sum() == 9
    assert (fewer.left_out > 0).all() and (fewer.left_out <= LEFT_OUT).all()
    for scheme in ALL:
        all_, some = (np.sqrt(off_energy(which, scheme, m)) for m in (modes, fewer))
        assert (abs(some / all_ - 1) <= fewer.left_out).all()
        assert not np.array_equal(all_, some)


def test_the_bound_is_reached_by_a_mode_above_all_lines():
    """With one line at the top and one mode above it, in step, the bound is at most a few times the true error."""
    which = channels(np.array([100.0, 200.0]), 15.0, np.array([1.0, 1.0]))
    gain = np.array([[[1.0], [3e-6]], [[1.0], [0.0]]])
    modes = modal_taxels(np.array([[100.0, 600.0], [200.0, 600.0]]), gain, which.q, which.resonance_hz)
    fewer = without_quiet_modes(modes, which.resonance_hz, which.line)
    missed = abs(np.sqrt(off_energy(which, Scheme("tones"), fewer) / off_energy(which, Scheme("tones"), modes)) - 1)[0]
    assert missed <= fewer.left_out[0] <= 5 * missed


def test_the_bound_counts_lines_above_all_tones():
    """Beside a small constant, two tones make a strong line at their sum, where a mode with Q = 50 lies."""
    which = channels(np.array([100.0, 130.0, 170.0]), 50.0, np.array([100.0, 130.0, 170.0]) ** -2.0)
    frequency = np.array([[100.0, 300.0], [130.0, 1e4], [170.0, 1e4]])
    gain = np.zeros((3, 2, 1))
    gain[:, 0] = 1.0
    gain[0, 1] = 5e-9
    modes = modal_taxels(frequency, gain, which.q, which.resonance_hz)
    scheme = Scheme("biased", 0.1)
    fewer = without_quiet_modes(modes, which.resonance_hz, which.line, scheme.bias_ratio)
    alone = modes._replace(gain=modes.gain * [[0.0], [1.0]])
    # In step with all the rest it would be all of this.
    missed = np.sqrt(off_energy(which, scheme, alone) / off_energy(which, scheme, modes))[0]
    assert 0 < missed <= fewer.left_out[0] <= LEFT_OUT


def test_a_loud_mode_is_never_left_out():
    which, modes = random_coil(5, 4, seed=13)
    fewer = without_quiet_modes(modes, which.resonance_hz, which.line)
    assert fewer.frequency_hz.shape == modes.frequency_hz.shape
    assert (fewer.left_out == 0).all()


# What a pull beside the axis excites


def test_a_pull_off_the_axis_excites_torsion_by_its_lever():
    """A force F at y turns a plate on a torsion spring by θ = F y/k_t; the boss of radius a moves by a/2 θ."""
    inertia = 2e-10
    mass = 1e-4
    torsion_hz = 300.0
    bending_hz = 60.0
    lever = 1.5e-3
    radius = 1.25e-3
    motion = np.zeros((2, 6))
    motion[0, 2], motion[1, 3] = mass**-0.5, inertia**-0.5
    modes = TaxelModes(np.array([bending_hz, torsion_hz]), motion)
    wrench = UPWARD + lever * np.eye(6)[3]
    frequency, gain = felt_gains(modes, wrench, np.zeros(6), radius)
    spring = inertia * (2 * np.pi * torsion_hz) ** 2
    assert gain[1] == pytest.approx([0, radius / 2 * lever / spring, 0], rel=1e-12)
    assert gain[0] == pytest.approx([1 / (mass * (2 * np.pi * bending_hz) ** 2), 0, 0], rel=1e-12)
    assert (felt_gains(modes, UPWARD, np.zeros(6), radius)[1][1] == 0).all()
    assert frequency[:2] == pytest.approx([bending_hz, torsion_hz])
    # The mean square of z + θ y over the disc, by adding up points.
    at = (np.arange(400) + 0.5) / 400 * 2 - 1
    x, y = np.meshgrid(at, at)
    inside = x**2 + y**2 < 1
    assert np.sqrt(((radius * y[inside]) ** 2).mean()) == pytest.approx(radius / 2, rel=1e-3)


@pytest.mark.parametrize(("topology", "beam"), [("cantilever", (0.627, 0.3, 6.6)), ("folded", (0.6, 0.4, 7.5))])
def test_modes_of_the_beam_model_move_the_washer_as_a_body(paper_spec, topology, beam):
    """The motion on the washer's axis and its turns give the model's compliances at any other point of the body."""
    model = model_of(paper_spec, topology, beam)
    modes = taxel_modes(model)
    arm = np.array([1.1e-3, -0.7e-3, 2.3e-3])
    moved = modes.motion[:, :3] + np.cross(modes.motion[:, 3:], arm)
    expected = model.modes.at_point(model.washer_point_m + arm)
    # The sign of a mode is free.
    expected = expected * np.sign((expected * moved.T).sum(axis=0))
    # A motion below 1e-10 of the most in its direction is zero: 1e-10 of 1e5 turns per metre, times an arm of 2 mm.
    assert pytest.approx(expected, rel=1e-10, abs=2e-8) == moved.T
    assert modes.compliances() == pytest.approx(model.compliances, rel=1e-12)
    # A taxel is symmetric about y = 0: an axial pull leaves three of its modes alone, a side pull moves just them.
    side = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    axial, sideways = (modes.motion @ wrench != 0 for wrench in (UPWARD, side))
    assert axial.sum() == sideways.sum() == 3
    assert (axial != sideways).all()


def test_modes_do_not_depend_on_the_signs_that_a_solver_chooses(paper_spec, monkeypatch):
    """Eigenvectors are free in sign and off by rounding, and both differ between versions of numpy."""
    beam = (0.627, 0.3, 6.6)
    modes = taxel_modes(model_of(paper_spec, "cantilever", beam))
    assert not np.signbit(modes.motion[modes.motion == 0]).any()
    solve = np.linalg.eigh
    random = np.random.default_rng(4)

    def otherwise(matrix):
        values, vectors = solve(matrix)
        signs = random.choice([-1.0, 1.0], vectors.shape[-1])
        return values, vectors * signs + 1e-16 * random.standard_normal(vectors.shape)

    monkeypatch.setattr(np.linalg, "eigh", otherwise)
    for _ in range(8):
        again = taxel_modes(model_of(paper_spec, "cantilever", beam))
        assert ((again.motion == 0) == (modes.motion == 0)).all()
        assert again.motion == pytest.approx(
            modes.motion, rel=1e-9
        )  # the rounding put in, times the modes' conditioning


def test_wrenches_turn_with_the_taxel(paper_spec):
    """The same taxel is seen from its coil in four directions, and from the washer's underside or the bed."""
    turned = {"+x": (2.0, -3.0), "+y": (3.0, 2.0), "-x": (-2.0, 3.0), "-y": (-3.0, -2.0)}
    sites = [Site((0, 0), (0, 0), at, along, float(np.hypot(*at))) for along, at in turned.items()]
    pulled = site_pulls(paper_spec, sites, np.full(4, 1000.0))
    wrench = site_wrenches(paper_spec, pulled, sites)
    assert wrench == pytest.approx(np.tile(wrench[0], (4, 1)), abs=1e-15)
    high = replace(paper_spec, taxel=replace(paper_spec.taxel, glue_gap_mm=paper_spec.taxel.glue_gap_mm + 0.5))
    lower = site_wrenches(high, site_pulls(high, sites[:1], np.array([1000.0])), sites[:1])[0]
    # Half a millimetre higher: r x F.
    assert lower - wrench[0] == pytest.approx(np.array([0, 0, 0, *np.cross([0, 0, 5e-4], wrench[0, :3])]), abs=1e-15)
    # Away from the axis and round it: the side force lies along (2, -3), the moment across.
    assert np.cross([2, -3, 0], [*wrench[0, :2], 0])[2] == pytest.approx(0, abs=1e-12)
    axis = [Site((0, 0), (0, 0), (0.0, 0.0), "+y", 0.0)]
    on_axis = site_wrenches(paper_spec, site_pulls(paper_spec, axis, np.array([1000.0])), axis)[0]
    assert on_axis == pytest.approx(UPWARD, abs=1e-9)


def test_the_side_nearer_to_the_coil_is_pulled_more(paper_plan):
    """On the paper's pad the coil lies on the side of the roots: it pulls nearer to them, and moves the boss less."""
    for channel in paper_plan.channels:
        working = int(np.argmax(channel.mode_shares))
        assert channel.pull_wrench[4] > 0
        assert 0.3 < channel.pulled_shares[working] < 1
        modes = TaxelModes(np.array(channel.modes_hz), np.array(channel.mode_motions))
        share = modes.compliances(np.array(channel.pull_wrench)) * channel.stiffness_n_per_m
        assert channel.pulled_shares == pytest.approx(tuple(share), abs=1e-12)
        # One newton turns the working mode as its lever does: 1 + M_y θ_y/z + F_x x/z of its shape.
        shape = modes.motion[working] / modes.motion[working, 2]
        wrench = channel.pull_wrench
        assert channel.pulled_shares[working] == pytest.approx(1 + wrench[4] * shape[4] + wrench[0] * shape[0])


# Plans


def test_plans_carry_their_modes(paper_plan):
    again = plan_from_json(plan_to_json(paper_plan))
    assert len(json.loads(plan_to_json(paper_plan))["channels"][0]["mode_motions"]) == 6
    figures = paper_plan.selectivity
    spec = paper_plan.spec
    scheme = Scheme(figures.drive)
    which = placed_channels(spec, again.channels)
    modes = coil_modes(spec, again.channels)
    # All modes; the plan leaves some out, within its bound.
    exact = all_states(which, scheme, modes).db
    left_out_db = 20 * np.log10(1 + figures.modes_left_out)
    assert figures.placed_all_states_db == pytest.approx(exact, abs=left_out_db + 1e-7)  # of ten digits in the file
    assert figures.modes_cost_db == pytest.approx(all_states(which, scheme).db - exact, abs=1e-3)
    assert 0 < figures.modes_left_out <= LEFT_OUT
    assert figures.placed_own_modes_db == pytest.approx(all_states(which, scheme).db, abs=1e-6)
    # What the headline figures keep: one resonator a taxel, as in the paper's bound.
    alike = _resonators(spec, again.channels, "alike")
    assert figures.one_hot_db == pytest.approx(-10 * np.log10(np.sort(tone_energy(alike, alike).ravel())[-3]), abs=1e-6)


def test_modes_of_a_solid_are_taken_as_they_are(paper_spec):
    """Four of the beam model's six modes, with the rest as static compliance, are as good far below."""
    model = model_of(paper_spec)
    full = taxel_modes(model)
    high = full.motion[4:] / (2 * np.pi * full.frequency_hz[4:, None])
    solved = TaxelModes(full.frequency_hz[:4], full.motion[:4], high.T @ high)
    other = solved_model(model, solved, 1e-3)
    assert taxel_modes(other) is solved
    wrench = np.array([0.5, -0.5, 1.0, 1e-3, 1e-3, 0.0])
    coils = []
    for modes in (full, solved, solved._replace(rest=None)):
        rest = np.zeros(6) if modes.rest is None else modes.rest @ wrench
        frequency, gain = felt_gains(modes, wrench, rest, 1.25e-3)
        coils.append(
            modal_taxels(frequency[None], gain[None], np.array([15.0]), np.array([full.frequency_hz[full.working]]))
        )
    lines = np.array([30.0, 76.0, 100.0])
    exact, with_rest, without = (felt_energy(coil, slice(None), lines)[0] for coil in coils)
    # The two modes lie at 1401 and 5878 Hz: (100/1401)² = 0.5 % of what they add, some of which cancels.
    missed = abs(without / exact - 1)
    assert (abs(with_rest / exact - 1) <= 0.02 * missed).all()
    assert missed.max() > 1e-9


def test_a_solid_s_modes_reach_the_plan(paper_spec):
    from padgen.planner.make import choose
    from padgen.planner.search import sites_of

    choice = choose(paper_spec)
    full = [taxel_modes(sized.model) for sized in choice.channels]
    rest = np.diag([0, 0, 1e-3, 0, 0, 0.0])
    solved = [
        replace(sized, model=solved_model(sized.model, modes._replace(rest=rest), 1e-3))
        for sized, modes in zip(choice.channels, full, strict=True)
    ]
    sites = sites_of(paper_spec, choice.layout, choice.channels)
    beam, solid = (plan_channels(paper_spec, which, sites) for which in (choice.channels, solved))
    assert solid[0].rest_motion == pytest.approx((0, 0, 1e-3, 0, 0, 0))
    assert beam[0].rest_motion == (0.0,) * 6
    assert np.array(solid[0].mode_motions) == pytest.approx(np.array(beam[0].mode_motions))
    figures = [plan_selectivity(paper_spec, which).placed_all_states_db for which in (beam, solid)]
    assert figures[0] != pytest.approx(figures[1], abs=1e-3)


def test_modes_are_named_by_their_shape(paper_plan):
    spec = paper_plan.spec
    names = [mode_names(spec, channel) for channel in paper_plan.channels]
    assert names == 2 * [("bending", "lateral", "torsion", "pitch", "yaw", "stretch")]
    extra = paper_plan.channels[0]
    more = replace(extra, modes_hz=(*extra.modes_hz, 9e3), mode_motions=(*extra.mode_motions, (1.0,) * 6))
    assert sorted(mode_names(spec, more)).count("higher") == 1
    hinged = [c for c in pg.plan("resin-fine").channels if np.argmax(c.mode_shares) == 0]
    assert hinged and all(mode_names(load_spec("resin-fine"), c)[0] == "bending" for c in hinged)


# Findings


@pytest.fixture(scope="module")
def crowded_plan():
    """Plan four channels, the highest on the lateral mode of the second, as the beam model has it."""
    top_hz = 170.0
    for _ in range(3):
        plan = make_plan(parse_spec(CROWDED.format(f"{top_hz:.6g}")))
        top_hz = lateral_hz(plan)
    assert plan.channels[3].resonance_hz == pytest.approx(top_hz, rel=2e-3)
    return plan


def lateral_hz(plan):
    channel = plan.channels[1]
    return channel.modes_hz[mode_names(plan.spec, channel).index("lateral")]


def of(plan, code):
    return [f for f in plan.findings if f.code == code]


def test_a_crowded_mode_is_found_and_costs(crowded_plan):
    """Channel 1's lateral mode lies on the tone of channel 3, and the pull off the washer's axis excites it."""
    (crowded,), (cost,) = of(crowded_plan, "modes.crowded"), of(crowded_plan, "selectivity.modes")
    figures = crowded_plan.selectivity
    assert (crowded.level, crowded.where, cost.where) == ("warning", "channel 1", "coil")
    lateral = lateral_hz(crowded_plan)
    top = crowded_plan.channels[3].resonance_hz
    line = f"lateral mode at {number(lateral)} Hz lies near the tone of channel 3 ({number(top)} Hz)"
    assert line in crowded.message
    assert figures.modes_cost_db > 2
    assert f"costs {figures.modes_cost_db:.1f} dB" in cost.message
    assert f"{figures.placed_all_states_db:.1f} dB are left" in cost.message
    # The mode alone, by hand: without it the coil keeps what it costs more.
    spec = crowded_plan.spec
    channels_ = crowded_plan.channels
    which = placed_channels(spec, channels_)
    modes = coil_modes(spec, channels_)
    scheme = Scheme(figures.drive)
    gain = modes.gain.copy()
    gain[1, np.argmin(abs(modes.frequency_hz[1] - lateral))] = 0
    gained = all_states(which, scheme, modes._replace(gain=gain)).db - all_states(which, scheme, modes).db
    assert f"costs {gained:.1f} dB (allowed: 1 dB)" in crowded.message
    sites = [c.site for c in channels_]
    pulled = site_pulls(spec, sites, hanging_gap_um(spec, np.array([c.sag_um for c in channels_])))
    wrench = site_wrenches(spec, pulled, sites)
    assert np.array([c.pull_wrench for c in channels_]) == pytest.approx(wrench, abs=1e-15)
    assert abs(wrench - wrench[0]).max() > 1e-3
    # No vertical pull at the axis excites it.
    straight = [replace(c, pull_wrench=tuple(UPWARD)) for c in channels_]
    assert parasitic_modes(spec, straight, Scheme(figures.drive)) == []
    assert plan_selectivity(spec, straight).modes_cost_db < 0.1


def test_a_mode_that_is_near_and_costs_is_one_finding(crowded_plan):
    """With equal displacement the highest tone is the strongest: the mode exceeds 1/Δy and costs more."""
    spec = parse_spec(CROWDED.format(f"{lateral_hz(crowded_plan):.6g}") + "[drive]\nlevel_law = 0\n")
    plan = make_plan(spec)
    (crowded,) = of(plan, "modes.crowded")
    (found,) = parasitic_modes(spec, plan.channels, plan.scheme)
    assert found.at_peak > 1 / spec.delta_y
    assert found.costs_db > 4
    assert f"by {found.at_peak:.2g} if a print" in crowded.message
    assert f"costs {found.costs_db:.1f} dB (allowed: 1 dB)" in crowded.message


def test_the_remedy_of_a_crowded_mode_works(crowded_plan):
    (crowded,) = of(crowded_plan, "modes.crowded")
    (change,) = re.findall(r"; (resonances_hz = \[.*\]) would do$", crowded.message)
    again = make_plan(parse_spec(CROWDED.replace("resonances_hz = [60, 85, 120, {}]", change)))
    assert of(again, "modes.crowded") == of(again, "selectivity.modes") == []
    assert again.selectivity.kept_db > crowded_plan.selectivity.kept_db


def test_a_mode_on_a_spur_is_named_with_its_makers_and_cleared_by_a_drive(crowded_plan):
    """Channel 0's torsion mode is moved onto the sum spur of channels 1 and 3, and made strong."""
    spec, (first, *others) = crowded_plan.spec, crowded_plan.channels
    torsion = mode_names(spec, first).index("torsion")
    spur_hz = (others[0].resonance_hz + others[2].resonance_hz) / 2
    hz = [spur_hz if k == torsion else f for k, f in enumerate(first.modes_hz)]
    motions = [tuple(10 * np.array(m)) if k == torsion else m for k, m in enumerate(first.mode_motions)]
    moved = (replace(first, modes_hz=tuple(hz), mode_motions=tuple(motions)), *others)
    found = [c for c in parasitic_modes(spec, moved, Scheme("tones")) if (c.channel, c.mode) == (0, torsion)]
    assert [(c.line, c.is_spur) for c in found] == [("the sum spur of 1 and 3", True)]
    assert found[0].line_hz == pytest.approx(spur_hz)
    which = placed_channels(spec, moved)
    modes = coil_modes(spec, moved)
    spur = 2 * np.sqrt(which.line[1] * which.line[3]) / which.line[0]
    peak = np.linalg.norm(modes.gain[0, torsion]) * first.q
    assert found[0].at_peak == pytest.approx(spur * peak, rel=1e-9)
    heard = felt_energy(modes, slice(0, 1), np.array([spur_hz]))[0, 0]
    assert found[0].planned == pytest.approx(spur * np.sqrt(heard), rel=1e-9)
    assert [
        c
        for c in parasitic_modes(spec, moved, Scheme("spur-free"))
        if (c.channel, c.mode) == (0, torsion) and c.is_spur
    ] == []
    # On a taxel that makes the spur, it is no disturbance: it is there only when the taxel is ON.
    last = replace(others[2], modes_hz=tuple(hz), mode_motions=tuple(motions), mode_shares=first.mode_shares)
    for crowd in parasitic_modes(spec, (first, *others[:2], last), Scheme("tones")):
        assert "3" not in crowd.line or crowd.channel != 3


@pytest.mark.parametrize("name", ["paper-16", "paper-32", "triple-48", "resin-fine"])
def test_templates_have_no_crowded_modes(name):
    plan = pg.plan(name)
    assert of(plan, "modes.crowded") == of(plan, "selectivity.modes") == []


def test_a_second_mode_in_a_slot_that_nothing_excites_is_a_note(crowded_plan):
    straight = [replace(c, pull_wrench=tuple(UPWARD)) for c in crowded_plan.channels]
    figures = plan_selectivity(crowded_plan.spec, straight)
    found = list(judge.judge_modes(replace(crowded_plan, channels=tuple(straight), selectivity=figures)))
    assert [(f.level, f.code, f.where) for f in found] == [("note", "modes.near", "channel 1")]
    assert f"channel 1's at {number(lateral_hz(crowded_plan))} Hz near channel 3" in found[0].message
    assert of(crowded_plan, "modes.near") == []


def test_levels_bend_what_counts():
    """A flatter level law makes high tones relatively stronger, so that a low taxel's mode on them counts more."""
    spec = parse_spec(CROWDED.format(170))
    costs = []
    for law in (0.0, 2.0):
        plan = make_plan(replace(spec, drive=replace(spec.drive, level_law=law, scheme="spur-free")))
        costs.append(plan.selectivity.modes_cost_db)
        assert LevelLaw(law)(np.array([60.0, 120.0]))[1] > 0
    assert costs[0] > costs[1]
