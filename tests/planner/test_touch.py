"""Beams that stretch, and taxels under a finger: against closed forms, reference tables and finite elements."""

from math import pi

import numpy as np
import pytest
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import brentq

import padgen as pg
from padgen.physics.beams import BeamSection
from padgen.physics.contact import Contactor, loaded_resonance
from padgen.physics.modes import BeamPlacement, hardening, jump_amplitude, level_kept
from padgen.planner import make_plan, plan_from_json, plan_to_json
from padgen.planner.touch import skin_contact
from padgen.spec import parse_spec

BRIDGE = """
name = "bridge"
resolution = 16
band_hz = [50, 400]
q_min = 15
delta_y = 5
suspension = { topology = "bridge" }
drive = { level_um = 87 }
"""
UP = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def test_a_touched_taxel_moves_as_a_coupled_oscillator_in_time():
    """Skin and taxel are integrated as one system of masses, springs and dampers; the decay gives f and Q."""
    radius = 0.5e-3
    k = 400.0
    m = 1.5e-4
    q = 15.0
    hz, touched_q = (float(v) for v in loaded_resonance(skin_contact("fingertip", "low"), Contactor(radius), k, m, q))
    # Low skin: 30 kPa, an outer layer that counts 0.1 mm, 0.4 ms; waves leave with 3.4/(1 − ν) times √(ρ G).
    wide = radius + 0.1e-3
    added = 2 * 30e3 * wide
    heavier = m + 4 / 3 * 1100 * wide**3
    waves = 6.8 * wide**2 * (1100 * 7500 * abs(1 + 2j * pi * hz * 0.4e-3)) ** 0.5
    damping = (k * m) ** 0.5 / q + 0.4e-3 * added + waves
    zeta = 1 / (2 * touched_q)
    period = 1 / (hz * (1 - zeta**2) ** 0.5)
    run = solve_ivp(
        lambda t, y: [y[1], -((k + added) * y[0] + damping * y[1]) / heavier],
        (0, 3 * period),
        [1.0, 0.0],
        rtol=1e-10,
        atol=1e-12,
        t_eval=[0.0, period, 2 * period],
    )
    # A tenth of a per mille: the integrator's tolerance over two periods.
    assert run.y[0] == pytest.approx(np.exp(-np.arange(3) * pi / touched_q / (1 - zeta**2) ** 0.5), rel=1e-4)


def test_the_plan_says_what_a_finger_makes_of_it():
    plan = pg.plan("paper-32")
    typical = plan.touched[1]
    assert typical.skin == "typical"
    assert typical.resonance_hz[0] == pytest.approx(210, abs=1.5)
    assert typical.q[0] == pytest.approx(0.76, abs=0.01)
    found = next(f for f in plan.findings if f.code == "touch.skin")
    assert found.level == "note"
    assert "no change of contact, moving mass or resonance alone" in found.message
    plan = pg.plan({"name": "one", "resolution": 2, "band_hz": [150, 400], "q_min": 15, "resonances_hz": [200.0]})
    found = next(f for f in plan.findings if f.code == "touch.skin")
    # The cure, applied: a plate as heavy as it says, at the same resonance, keeps it within 5 %.
    mass_g = float(found.message.split("a moving mass of ")[1].split(" g")[0])
    hz = plan.channels[0].resonance_hz
    mass = mass_g * 1e-3
    skin = skin_contact("fingertip", "typical")
    after, q = loaded_resonance(skin, Contactor(1.25e-3), (2 * pi * hz) ** 2 * mass, mass, np.inf)
    assert after / hz - 1 < 0.05
    assert q > 8


@pytest.mark.parametrize(("name", "which"), [("paper-32", 1), ("quad-64", 0), ("quad-64", 2)])
def test_a_touched_coil_keeps_what_complex_responses_say(name, which):
    plan = pg.plan(name, drive={"scheme": "spur-free"})
    found = plan.touched[which]
    modulus, layer, time = {"low": (30e3, 1e-4, 4e-4), "typical": (80e3, 3e-4, 7e-4), "high": (250e3, 4e-4, 1.5e-3)}[
        found.skin
    ]
    wide = plan.plate.boss_diameter_mm * 0.5e-3 + layer
    count = len(plan.channels)
    hz = np.array([c.resonance_hz for c in plan.channels])
    on = np.zeros((count, count))
    omega = 2 * pi * hz
    force_a2 = np.array([d.line_a2 for d in plan.channels])
    for i, c in enumerate(plan.channels):
        k = c.stiffness_n_per_m + 2 * modulus * wide
        m = c.effective_mass_g * 1e-3 + 4 / 3 * 1100 * wide**3
        waves = 6.8 * wide**2 * np.sqrt(1100 * modulus / 4 * np.abs(1 + 1j * omega * time))
        damping = (c.stiffness_n_per_m * c.effective_mass_g * 1e-3) ** 0.5 / c.q + time * 2 * modulus * wide + waves
        force = force_a2 * c.force_constant_n_per_a2
        on[i] = np.abs(force / (k - m * omega**2 + 1j * damping * omega)) / c.level_um
    own = on.diagonal()
    kept_db = 20 * np.log10(own.min() / np.sqrt(((on**2).sum(1) - own**2).max()))
    # Steel and plastic are those of both; 0.01 dB is the rounding of plan.json's figures.
    assert found.all_states_db == pytest.approx(kept_db, abs=0.01)


def test_a_guided_beam_hardens_as_the_exact_beam_under_tension():
    """Two clamped beams on a guided body, by the exact shape under tension: w'''' = (T/EI) w'', T = EA ∫ w'²/2l."""
    e = 3e9
    width = 1e-3
    t = 2e-4
    length = 8e-3
    area = width * t
    inertia = width * t**3 / 12
    beams = [
        BeamPlacement(BeamSection(width, t, length), np.array([x, 0.0, 0.0]), np.array([c, 0.0]))
        for x, c in ((-2e-3, 1.0), (2e-3, -1.0))
    ]
    stiff = 2 * 12 * e * inertia / length**3
    # All that is not along z and x is held; x by both beams.
    held = np.diag([length / (2 * e * area), 1e-12, 1 / stiff, 1e-12, 1e-12, 1e-12])
    alpha = hardening(beams, UP, np.zeros(3), held, (e, 0.0))
    assert alpha * t**2 == pytest.approx(0.72, rel=1e-9)
    for moved in (3e-5, 1e-4):

        def force(tension, moved=moved):
            """Return the closed form of the guided beam-column, with tension T at deflection `moved`."""
            mu = (tension / e / inertia) ** 0.5 * length
            # w(0)=w'(0)=0, w'(l)=0, w(l)=moved: shear V = 12 EI/l³ · φ, φ = (mu³/12)/(mu − 2 tanh(mu/2)).
            return moved * e * inertia / length**3 * mu**3 / (mu - 2 * np.tanh(mu / 2))

        def slack(tension, moved=moved):
            mu = (tension / e / inertia) ** 0.5
            x = np.linspace(0, length, 4001)
            shape = (np.sinh(mu * x) - mu * x) - np.tanh(mu * length / 2) * (np.cosh(mu * x) - 1)
            slope = np.gradient(shape * moved / shape[-1], x, edge_order=2)
            return tension - e * area * np.trapezoid(slope**2, x) / 2 / length

        tension = brentq(slack, 1e-9, 1.0)
        exact = 2 * force(tension) / stiff / moved
        # The shape is taken as a cubic: 0.1 % of the force at a sixth of the thickness, 1 % at half of it.
        assert 1 + alpha * moved**2 == pytest.approx(exact, rel=0.01)


def test_beams_that_may_slide_do_not_harden():
    for topology in ("cantilever", "folded"):
        plan = make_plan(parse_spec(BRIDGE.replace("bridge", topology)), tries_cures=False)
        assert all(c.hardening_per_mm2 == 0 and c.level_loss_db == 0 for c in plan.channels)
        assert plan.load.reachable_by != "stretching"


def test_a_bridge_says_what_stretching_costs_and_what_would_do():
    stiffer = BRIDGE.replace("[50, 400]", "[150, 400]")
    plan = make_plan(parse_spec(stiffer))
    found = next(f for f in plan.findings if f.code == "beam.stretching")
    level = float(found.message.split("drive.level_um = ")[1].split(" ")[0])
    cured = make_plan(parse_spec(stiffer.replace("87", str(level))), tries_cures=False)
    assert not [f for f in cured.findings if f.code == "beam.stretching"]
    assert max(c.level_loss_db for c in plan.channels) > 0.5
    assert plan_to_json(plan_from_json(plan_to_json(plan))) == plan_to_json(plan)


def test_the_tone_of_small_motions_moves_a_hard_spring_less():
    """The steady state of Duffing's equation in time agrees within what the first harmonic leaves out."""
    alpha = 18.0
    q = 15.0
    asked = 0.087
    omega = 2 * pi * 70
    run = solve_ivp(
        lambda t, y: [
            y[1],
            asked * omega**2 / q * np.cos(omega * t) - omega / q * y[1] - omega**2 * y[0] * (1 + alpha * y[0] ** 2),
        ],
        (0, 1.5),
        [0.0, 0.0],
        rtol=1e-8,
        atol=1e-10,
        dense_output=True,
    )
    reached = np.abs(run.sol(np.linspace(1.4, 1.5, 4000))[0]).max()
    assert level_kept(alpha, q, asked) == pytest.approx(reached / asked, rel=0.02)


def test_large_slopes_stay_within_their_bound():
    """Secant stiffness of an end-loaded cantilever by the elastica, θ'' = −α cos θ, over the linear 3."""

    def tip(alpha):
        x = np.linspace(0, 1, 60)
        start = np.array([alpha * (x - x * x / 2), alpha * (1 - x), alpha * x * x / 2])
        found = solve_bvp(
            lambda _, y: [y[1], -alpha * np.cos(y[0]), np.sin(y[0])],
            lambda a, b: [a[0], b[1], a[2]],
            x,
            start,
            tol=1e-8,
        )
        return found.y[2, -1]

    for share in (0.05, 0.1, 0.2):
        stiffer = brentq(lambda alpha, share=share: tip(alpha) - share, 0.1, 1.5) / 3 / share - 1
        assert 0.1 * 1.2 * share**2 < stiffer < 1.2 * share**2


def added_mass_of_a_square(n):
    """Return the added mass of a plate of side 1 in a fluid of density 1, by a lattice of n × n vortex rings."""
    centre = (np.arange(n) + 0.5) / n
    x, y = (v.ravel() for v in np.meshgrid(centre, centre, indexing="ij"))
    wash = np.zeros((n * n, n * n))
    for sx, sy in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        a = x[:, None] - x + sx * 0.5 / n
        b = y[:, None] - y + sy * 0.5 / n
        # Downwash of a ring of unit circulation in its plane: the sum over its corners of √(a² + b²)/(a b)/4π.
        wash -= sx * sy * np.hypot(a, b) / (a * b) / (4 * pi)
    return abs(np.linalg.solve(wash, np.ones(n * n)).sum()) / n**2


def test_air_that_moves_with_a_plate_stays_within_its_bound():
    plan = pg.plan("paper-32")
    # The lattice converges as 1/n; 0.455 is Blevins' figure.
    added = 2 * added_mass_of_a_square(16) - added_mass_of_a_square(8)
    assert added == pytest.approx(0.455, rel=0.01)
    entry = next(e for e in plan.left_out if e.term == "air's mass")
    side = plan.plate.length_mm * 1e-3
    lightest = min(c.effective_mass_g for c in plan.channels) * 1e-3
    true = added * 1.2 * side**3 / lightest / 2
    assert plan.plate.length_mm == plan.plate.width_mm
    assert true < entry.bound < 10 * true


def test_every_effect_is_included_bounded_or_unbounded_and_bridges_warn():
    plan = pg.plan("paper-32")
    by_status = {s: [e for e in plan.left_out if e.status == s] for s in ("included", "bounded", "unbounded")}
    assert sum(map(len, by_status.values())) == len(plan.left_out) >= 25
    assert all(e.bound is None for e in by_status["unbounded"] + by_status["included"])
    assert "skin" in {e.term for e in by_status["unbounded"]}
    bridge = make_plan(parse_spec(BRIDGE))
    assert "model.unbounded" in {f.code for f in bridge.findings if f.level == "warning"}
    assert "model.unbounded" not in {f.code for f in plan.findings}


def test_jumps_begin_where_the_response_becomes_threefold():
    alpha = 18.0
    q = 15.0
    for share, branches in ((0.97, 1), (1.03, 3)):
        amplitude = share * jump_amplitude(alpha, q)
        most = 0
        for detuning in np.linspace(0, 0.3, 3001):
            # y ((2 Q (δ − ⅜ α a² y))² + 1) = 1, y = (amplitude reached over peak)².
            rise = 3 / 8 * alpha * amplitude**2
            roots = np.roots([(2 * q * rise) ** 2, -8 * q**2 * rise * detuning, (2 * q * detuning) ** 2 + 1, -1])
            most = max(most, int((np.abs(roots.imag) < 1e-9).sum()))
        assert most == branches


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("resonances_hz = [3, 50]\npad = { width_mm = 180, depth_mm = 180 }\ncoil = { grid = [2, 1] }", "beam.sag"),
        ("resonances_hz = [30, 50]\ncoil = { gap_mm = 0.2, grid = [2, 1] }", "gap.contact"),
        ("resonances_hz = [30, 50]\nmaterial = { name = 'pla', fatigue_stress_mpa = 0.1 }", "beam.strength"),
    ],
)
def test_impossible_statics_are_errors(text, code):
    plan = make_plan(parse_spec(f'name = "low"\nresolution = 4\nband_hz = [2.5, 60]\nq_min = 15\n{text}\n'))
    assert code in {f.code for f in plan.findings if f.level == "error"}
