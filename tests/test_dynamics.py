"""Time domain: phasors, exact propagation, the coupled system, the paper's pair.

Agreements that are checked:

=============================  ================================  ==========================================
what                           must be                           why
=============================  ================================  ==========================================
propagation                    = 40-digit arithmetic, 1e-12      closed form, digits kept (of the largest)
propagation, late              = phasors, 1e-10                  the transient is gone
one segment cut in two         = the whole, 1e-12                state and phases are carried over
coupled, vanishing pull        = propagation, 1e-9               nothing acts back; 1e-8 is what is asked
coupled, strong pull           = DOP853, 1e-9                    two programs, one physics
energy in                      = out + stored, 1e-10             what no error of the motion could hide
order of fixed steps           2 (midpoint), 3 (Radau, 2 stages) theory, within 0.15
static pull, pull-in           = balance in closed form          `balanced_deflection`
bounces                        = flight in closed form, 1e-10    piecewise cosines
every extreme case             error <= stated, or refused       it says when it does not know
=============================  ================================  ==========================================
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from docs.paper_figures import draw_paper_figures, paper_figures
from padgen.core.errors import SolverError
from padgen.physics.magnetics import balanced_deflection, impedance, pull_in_deflection
from padgen.physics.phasor import Tones, circuit_current, merged, signal, squared, steady_lines, tones
from padgen.physics.propagation import STATED_ERROR, Motion, propagate, propagate_piecewise
from padgen.planner import make_plan
from padgen.spec import load_spec
from padgen.verify.coupled import simulate
from padgen.verify.dynamics_collocation import collocation
from padgen.verify.dynamics_ladder import dynamics_ladder, dynamics_question, dynamics_rungs
from padgen.verify.dynamics_model import Source, coupled_rates, from_tones, make_system
from padgen.verify.extreme_dynamics import dynamics_cases, exact_displacement

MASS, GAP = 1e-4, 1e-3
HZ = np.array([20.0, 63.0, 200.0, 1000.0])
CRITICAL = (0.5, 0.5 * (1 + 1e-12), 0.5 * (1 - 1e-12), 0.5 * (1 + 1e-6))


@pytest.fixture(scope="module")
def pair_plan():
    return make_plan(load_spec("paper-pair"))


def worst(hz, q, force, times):
    """Largest error of propagation over the largest displacement of each resonator."""
    moved = propagate(hz, q, MASS, force, times).displacement_m
    exact = np.array([[exact_displacement(f, d, MASS, force, t) for t in times] for f, d in zip(hz, q, strict=True)])
    return (np.abs(moved - exact).max(1) / np.abs(exact).max(1)).max()


@pytest.mark.parametrize("q", [1e-3, 0.1, 0.4, *CRITICAL, 0.6, 1, 15, 1e3, 1e7, np.inf])
@pytest.mark.parametrize("offset_hz", [0.0, 1e-9, 3.0])
def test_propagation_is_exact(q, offset_hz):
    # The bar is 1e-10; what the module states is the tolerance. Beside the tones near resonance a constant and a decay.
    force = tones(np.append(HZ + offset_hz, [0.0, 300.0]), 1.0, np.arange(6.0), [0, 0, 0, 0, 0, 50.0])
    every = np.full(len(HZ), q)
    assert worst(HZ, every, force, np.array([1e-3, 0.1, 10.0])) <= STATED_ERROR
    for early in (1e-8, 1e-5, 1e-3):  # where the answer is a small part of the steady state
        assert worst(HZ, every, force, np.array([early])) <= STATED_ERROR


def test_a_decay_that_meets_a_pole_is_no_pole():
    q = np.full(4, 15.0)
    force = tones(HZ * np.sqrt(1 - 1 / 900), 1.0, 0.3, np.pi * HZ / q)
    assert worst(HZ, q, force, np.array([1e-3, 0.1, 1.0])) <= STATED_ERROR


def test_phases_of_long_times_keep_their_digits():
    hz = np.array([2e5, 199999.3, 1e5])
    for q in (1e3, 1e6, np.inf):
        # 2 million periods: 2π f t in double precision alone would be off by 1e-9.
        assert (
            worst(hz, np.full(3, q), tones([2e5, 20.3, 1e5], 1.0, 0.3), np.array([1.0, 9.99999, 10.0])) <= STATED_ERROR
        )


def test_thirty_two_resonators_for_ten_seconds():
    hz = np.geomspace(20, 1000, 32)
    force, times = tones(hz, 1e-5, np.arange(32.0)), np.linspace(0, 10, 401)
    moved = propagate(hz, 15.0, MASS, force, times).displacement_m
    for i, k in ((0, 400), (7, 13), (18, 250), (31, 399)):
        exact = exact_displacement(hz[i], 15.0, MASS, force, times[k])
        assert abs(moved[i, k] - exact) <= STATED_ERROR * np.abs(moved[i]).max()


def test_times_may_come_in_any_order_and_amplitudes_by_receiver():
    times, force = np.array([0.7, 0.0, 0.2]), tones(HZ[:2], np.array([[1.0, 0], [0, 2.0], [1.0, 2.0]]))
    moved = propagate([50.0, 90, 130], 8.0, MASS, force, times)
    for k, t in enumerate(times):
        alone = propagate([50.0, 90, 130], 8.0, MASS, force, [t])
        assert moved.displacement_m[:, k] == pytest.approx(alone.displacement_m[:, 0], rel=1e-12)
    own = propagate([130.0], 8.0, MASS, tones(HZ[:2], [1.0, 2.0]), times)
    assert moved.velocity_m_per_s[2] == pytest.approx(own.velocity_m_per_s[0], rel=1e-12)
    assert (moved.displacement_m[:, 1] == 0).all()


@pytest.mark.parametrize("q", [0.2, 0.5, 15.0, np.inf])
def test_velocity_is_the_slope_of_displacement(q):
    force, at, step = tones([60.0, 61.0], 1.0, 0.4), 0.113, 1e-6
    state = Motion(np.array([1.0]), np.array([-200.0]))
    moved = propagate([60.0], q, MASS, force, [at - step, at, at + step], state, 0.01)
    x, v = moved.displacement_m[0], moved.velocity_m_per_s[0]
    # Central differences: step² (2π 60)³ x/6 is 1e-8 of v; rounding of x over the step 1e-9.
    assert (x[2] - x[0]) / (2 * step) == pytest.approx(v[1], rel=1e-5, abs=1e-5 * np.abs(x).max() * 400)


@pytest.mark.parametrize("q", [0.3, 0.5, 15.0, 1e6])
def test_a_segment_cut_in_two_moves_as_the_whole(q):
    force, times = tones(HZ + 0.1, 1.0, 0.7), np.linspace(0.2, 3, 11)
    state = Motion(np.full(4, 1e-3), np.full(4, -0.1))
    whole = propagate(HZ, q, MASS, force, times, state, 0.2)
    cut = propagate_piecewise(HZ, q, MASS, [(0.2, force), (0.9, force), (1.3, force)], times, state)
    for one, other in zip(whole, cut, strict=True):
        assert np.abs(one - other).max() <= STATED_ERROR * np.abs(one).max()


def test_tones_switch_on_and_off():
    hz, times = np.array([60.0, 78.0]), np.linspace(0, 0.3, 31)
    segments = [(0.0, tones(60.0, 1e-5)), (0.1, tones([78.0, 9.0], [1e-5, 2e-5], 0.3)), (0.2, tones(0.0, 0.0))]
    moved = propagate_piecewise(hz, 26.0, MASS, segments, times)
    omega, state, found = 2 * np.pi * hz, np.zeros(4), []
    for (start, force), end in zip(segments, (0.1, 0.2, 0.3001), strict=True):

        def rates(t, y, force=force):
            return np.concatenate([y[2:], signal(force, [t]) / MASS - omega**2 * y[:2] - omega / 26 * y[2:]])

        at = times[(times >= start) & (times < end - 1e-9)]
        run = solve_ivp(rates, (start, end), state, "DOP853", np.append(at, end), rtol=1e-11, atol=1e-18)
        found.append(run.y[:2, : len(at)])
        state = run.y[:, -1]
    expected = np.concatenate(found, 1)
    assert np.abs(moved.displacement_m - expected).max() <= 1e-8 * np.abs(expected).max()  # the solver's accuracy


def test_phasors_are_what_propagation_ends_in():
    force = squared(tones([30.0, 39.0, 0.0], [0.02, 0.02, 0.01], [0.1, 0.2, 0.0]))
    hz, times = np.array([60.0, 78.0]), np.linspace(20, 20.1, 17)  # 145 ring-ups
    lines = steady_lines(hz, 26.0, MASS, force)
    turning = np.exp(2j * np.pi * force.frequency_hz[:, None] * times)
    moved = propagate(hz, 26.0, MASS, force, times).displacement_m
    assert (lines @ turning).real == pytest.approx(moved, abs=1e-10 * np.abs(moved).max())
    kinds = {30.0 * 2, 39.0 * 2, 69.0, 9.0, 30.0, 39.0, 0.0}  # 2f, f1 ± f2, with the constant f, and 0
    assert set(merged(force).frequency_hz) == kinds


def test_squares_and_merging_keep_the_signal():
    wave = tones([30.0, 39.1, 0.0, 51.7], [1.0, 2.0, 0.5, 0.3], [0.1, -2.0, 0.0, 1.0], [0.0, 3.0, 0.0, 0.5])
    times = np.linspace(0, 1, 57)
    assert signal(squared(wave), times) == pytest.approx(signal(wave, times) ** 2, rel=1e-12, abs=1e-12)
    doubled = Tones(*(np.concatenate([part, part]) for part in wave))
    assert len(merged(doubled).frequency_hz) == 4
    assert signal(merged(doubled), times) == pytest.approx(2 * signal(wave, times), abs=1e-12)
    # Frequencies of lines are known beyond the last digit of a double.
    odd = squared(tones([0.1, 1e6 / 3], 1.0))
    total, rest = odd.frequency_hz[1], odd.rest_hz[1]
    assert rest != 0 and (total - 1e6 / 3) - 0.1 == pytest.approx(-rest, abs=1e-20)


def test_a_circuit_current_solves_its_equation():
    voltage, resistance, inductance = tones([0.0, 500.0], [1.0, 2.0], [0.0, 0.3]), 62.9, 0.0417
    times = np.linspace(0, 0.01, 12)
    current = circuit_current(voltage, resistance, inductance, 0.004)
    turn = -current.decay_per_s + 2j * np.pi * current.frequency_hz
    slope = current._replace(amplitude=current.amplitude * np.abs(turn), phase_rad=current.phase_rad + np.angle(turn))
    asked = resistance * signal(current, times) + inductance * signal(slope, times)
    assert asked == pytest.approx(signal(voltage, times), abs=1e-13 * 3)  # of 3 V
    assert signal(current, np.zeros(1)) == pytest.approx([0.004], rel=1e-12)


def test_what_has_no_answer_is_refused():
    force = tones(60.0, 1.0)
    for broken in (
        lambda: propagate([60.0], 0.0, MASS, force, [1.0]),
        lambda: propagate([60.0], np.nan, MASS, force, [1.0]),
        lambda: propagate([0.0], 15.0, MASS, force, [1.0]),
        lambda: propagate([60.0], 15.0, np.inf, force, [1.0]),
        lambda: propagate([60.0], 15.0, MASS, force, [0.5], start_s=0.6),
        lambda: propagate([60.0], 15.0, MASS, force, [np.inf]),
        lambda: propagate_piecewise([60.0], 15.0, MASS, [], [1.0]),
        lambda: propagate_piecewise([60.0], 15.0, MASS, [(0.5, force), (0.5, force)], [1.0]),
        lambda: propagate_piecewise([60.0], 15.0, MASS, [(0.5, force)], [0.4]),
        lambda: tones(-1.0, 1.0),
        lambda: tones(1.0, np.nan),
        lambda: tones(1.0, 1.0, 0.0, -1.0),
        lambda: circuit_current(force, 1.0, 0.0),
        lambda: circuit_current(tones(60.0, 1.0, 0.0, 1.0), 1.0, 1.0),
        lambda: steady_lines([60.0], np.inf, MASS, force),
        lambda: steady_lines([60.0], 15.0, MASS, tones(60.0, 1.0, 0.0, 1.0)),
        lambda: make_system(60.0, 15.0, MASS, -1.0, 2.0, GAP),
        lambda: make_system(60.0, 15.0, MASS, 1.0, 2.0, GAP, restitution=1.1),
        lambda: make_system(60.0, 15.0, MASS, 1.0, 2.0, GAP, stop_m=GAP),
        lambda: simulate(make_system(60.0, 15.0, MASS, 1.0, 2.0, GAP), constant(1.0), [2.0, 1.0]),
        lambda: simulate(make_system(60.0, 15.0, MASS, 1.0, 2.0, GAP), constant(1.0), [1.0], displacement_m=GAP),
    ):
        with pytest.raises(SolverError):
            broken()
    with pytest.raises(SolverError, match="less than the washers' share"):
        simulate(make_system(60.0, 15.0, MASS, 1.0, 2.0, GAP, 1.0, 5e-4), from_tones("voltage", force), [0.1])


def test_no_tones_and_no_time_are_no_motion():
    still = propagate(HZ, 15.0, MASS, tones([], []), [0.0, 1.0])
    assert not still.displacement_m.any() and still.displacement_m.shape == (4, 2)
    start = simulate(make_system(60.0, 15.0, MASS, 1.0, 2.0, GAP), constant(1.0), [0.0], displacement_m=1e-4)
    assert start.displacement_m.tolist() == [[1e-4]] and start.steps == 0


def constant(amps):
    return Source("current", lambda time_s: np.full(len(time_s), amps))


def stiffness(hz):
    return MASS * (2 * np.pi * hz) ** 2


@pytest.mark.parametrize(("kind", "stages"), [("gauss", 1), ("gauss", 3), ("radau", 2), ("radau", 20)])
def test_collocation_integrates_what_it_must(kind, stages):
    rule = collocation(kind, stages)
    top = 2 * stages - (1 if kind == "gauss" else 2)  # degree that the weights integrate exactly
    assert rule.points**top @ rule.weights == pytest.approx(1 / (top + 1), rel=1e-12)
    power = rule.points ** (stages - 1)
    assert rule.integrals @ power == pytest.approx(rule.points**stages / stages, abs=1e-13)
    assert rule.values(power, np.array([0.3])) == pytest.approx(0.3 ** (stages - 1), abs=1e-12)
    assert rule.integrated(power, np.array([0.3])) == pytest.approx(0.3**stages / stages, abs=1e-12)


@pytest.mark.parametrize("constant_s", [1e-6, 1e-3, 10.0])
def test_a_vanishing_pull_is_the_linear_case(constant_s):
    inductance, times = 62.9 * constant_s, np.linspace(0, 0.05, 101)
    voltage = tones([0.0, 500.0], [1.0, 2.0], [0.0, 0.3])
    weak = np.array([1e-12, 2e-12])
    system = make_system([1000.0, 300.0], 15.0, MASS, weak, 2.0, GAP, 62.9, inductance)
    motion = simulate(system, from_tones("voltage", voltage), times)
    current = circuit_current(voltage, 62.9, inductance)
    lines = squared(current)
    linear = propagate([1000.0, 300.0], 15.0, MASS, lines._replace(amplitude=weak[:, None] * lines.amplitude), times)
    for one, other in zip(motion[:2], linear, strict=True):
        assert np.abs(one - other).max(1) == pytest.approx(0, abs=1e-9 * np.abs(other).max())
    assert np.abs(motion.current_a - signal(current, times)).max() <= 1e-9 * np.abs(motion.current_a).max()


def test_a_voltage_that_is_switched_is_propagated_exactly():
    resistance, inductance, weak, switch = 62.9, 0.0417, 1e-12, 0.0137
    first, second = tones(30.0, 2.0, 0.4), tones([39.0, 0.0], [2.0, 0.5], [1.0, 0.0])
    before = circuit_current(first, resistance, inductance)
    carried = float(signal(before, np.array([switch]))[0])
    after = circuit_current(second, resistance, inductance, carried, switch)
    segments = [(at, squared(i)) for at, i in ((0.0, before), (switch, after))]
    segments = [(at, wave._replace(amplitude=weak * wave.amplitude)) for at, wave in segments]
    times = np.linspace(0, 0.05, 41)
    exact = propagate_piecewise([60.0, 78.0], 26.0, MASS, segments, times)
    source = Source("voltage", lambda t: np.where(t < switch, signal(first, t), signal(second, t)), (switch,))
    system = make_system([60.0, 78.0], 26.0, MASS, weak, 2.0, GAP, resistance, inductance)
    motion = simulate(system, source, times)
    # 1e-8 is what is asked of the steps; a break that was stepped over would cost 1e-3.
    assert np.abs(motion.displacement_m - exact.displacement_m).max() <= 1e-9 * np.abs(exact.displacement_m).max()
    late = times > switch
    assert motion.current_a[late] == pytest.approx(signal(after, times[late], switch), abs=1e-9 * 0.03)


def strong():
    """Three washers of unlike mass and exponent over one coil, moved by a tenth of the gap."""
    hz = np.array([60.0, 95.0, 170.0])
    pull = stiffness(hz) * GAP / 40
    inductance = 30 * GAP * float(pull.sum())
    resistance = inductance / 2e-3
    system = make_system(hz, 15.0, MASS, pull, [0.0, 1.0, 2.5], GAP, resistance, inductance)
    ohms = impedance(resistance, inductance, hz / 2)
    return system, from_tones("voltage", tones(hz / 2, 0.8 * np.abs(ohms), np.angle(ohms)))


def test_a_strong_pull_agrees_with_another_solver_and_energy_balances():
    system, source = strong()
    times = np.linspace(0, 0.06, 13)
    motion = simulate(system, source, times, tolerance=1e-10)
    found = solve_ivp(coupled_rates(system, source), (0, 0.06), np.zeros(7), "DOP853", times, rtol=1e-12, atol=1e-17)
    assert np.abs(motion.displacement_m).max() > 0.05 * GAP
    for i in range(3):
        assert motion.displacement_m[i] == pytest.approx(found.y[i], abs=1e-9 * np.abs(found.y[i]).max())
        assert motion.velocity_m_per_s[i] == pytest.approx(found.y[3 + i], abs=1e-9 * np.abs(found.y[3 + i]).max())
    current = found.y[-1] / system.inductance(found.y[:3])
    assert motion.current_a == pytest.approx(current, abs=1e-9 * np.abs(current).max())
    # No part is so small that the balance could not tell if it were left out.
    energy = motion.energy
    assert energy.residual < 1e-10
    assert min(energy.supplied_j, energy.copper_j, energy.damping_j) > 1e-4 * energy.supplied_j > 0
    for tolerance in (1e-2, 1e-4, 1e-6):
        loose = simulate(system, source, times, tolerance=tolerance).displacement_m
        assert (np.abs(loose - motion.displacement_m).max(1) < tolerance * np.abs(motion.displacement_m).max(1)).all()


@pytest.mark.parametrize(("rule", "stages", "order"), [("gauss", 1, 2), ("radau", 2, 3)])
def test_fixed_steps_converge_in_their_order(rule, stages, order):
    system, source = strong()
    end = np.array([0.02])
    exact = simulate(system, source, end, tolerance=1e-12).displacement_m[:, 0]
    errors = []
    for steps in (150, 300):
        run = simulate(system, source, end, tolerance=1e-8, rule=rule, stages=stages, step_s=0.02 / steps)
        errors.append(np.abs(run.displacement_m[:, 0] - exact).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize(("exponent", "share"), [(0.8, 0.9), (2.0, 0.99), (3.0, 0.5)])
def test_a_steady_pull_ends_in_balance(exponent, share):
    largest = stiffness(100.0) * pull_in_deflection(GAP, exponent)[1]
    system = make_system(100.0, 0.5, MASS, share * largest, exponent, GAP)
    moved = simulate(system, constant(1.0), [1.0]).displacement_m[0, 0]
    expected = balanced_deflection(share * largest / stiffness(100.0), GAP, exponent)
    assert moved == pytest.approx(expected, rel=1e-8)  # what was asked of the steps


def test_pull_in_is_refused_or_followed_to_the_stop():
    largest = stiffness(100.0) * pull_in_deflection(GAP, 2.0)[1]
    pulls = [0.5 * largest, 1.05 * largest]
    with pytest.raises(SolverError, match=r"taxel 1 is pulled onto the coil at 0\.0\d+ s"):
        simulate(make_system(100.0, 0.5, MASS, pulls, 2.0, GAP), constant(1.0), [1.0])
    motion = simulate(make_system(100.0, 0.5, MASS, pulls, 2.0, GAP, stop_m=0.9 * GAP), constant(1.0), [1.0])
    assert motion.held.tolist() == [False, True]
    assert motion.displacement_m[1, 0] == pytest.approx(0.9 * GAP, rel=1e-12)
    assert {contact.taxel for contact in motion.contacts} == {1} and motion.contacts[-1].stays
    assert motion.energy.residual < 1e-10 and motion.energy.impact_j > 0


def test_undamped_pull_in_is_where_energy_says():
    # Let go of at rest under c i² (g/(g − z))²: ½ k z (1 − z/g) = c i², to be had up to z = g/2.
    end = stiffness(100.0) * GAP / 8
    system = make_system(100.0, np.inf, MASS, 0.99 * end, 2.0, GAP)
    highest = simulate(system, constant(1.0), np.linspace(0, 0.03, 3001)).displacement_m.max()
    # Sampled every 10 µs: the top is missed by at most (2π 100 · 5e-6)²/2 of the swing, 5e-6.
    assert highest / GAP == pytest.approx((1 - np.sqrt(0.01)) / 2, rel=1e-5)
    with pytest.raises(SolverError, match="pulled onto the coil"):
        simulate(make_system(100.0, np.inf, MASS, 1.01 * end, 2.0, GAP), constant(1.0), [0.1])


@pytest.mark.parametrize("restitution", [0.0, 0.4, 0.9, 1.0])
def test_bounces_are_flights_between_contacts(restitution):
    omega = 2 * np.pi * 100.0
    system = make_system(100.0, np.inf, MASS, stiffness(100.0) * GAP, 0.0, GAP, stop_m=GAP / 2, restitution=restitution)
    motion = simulate(system, constant(1.0), [0.02])
    # About its rest position at the gap the washer swings as a cosine; it meets the stop half way.
    first = motion.contacts[0]
    assert first.time_s == pytest.approx(np.arccos(0.5) / omega, rel=1e-10)
    assert first.speed_m_per_s == pytest.approx(GAP * omega * np.sin(np.arccos(0.5)), rel=1e-10)
    assert first.stays == (restitution == 0)
    if restitution > 0:
        flight = 2 * np.arctan2(restitution * first.speed_m_per_s / omega, GAP / 2) / omega
        assert motion.contacts[1].time_s - first.time_s == pytest.approx(flight, rel=1e-10)
        assert motion.contacts[1].speed_m_per_s == pytest.approx(restitution * first.speed_m_per_s, rel=1e-9)
    assert motion.energy.residual < 1e-10


def test_a_held_washer_is_let_go_when_the_current_stops():
    pull = 4 * stiffness(100.0) * GAP
    source = Source("current", lambda t: np.where(t < 0.015, 1.0, 0.0), (0.015,))
    system = make_system(100.0, np.inf, MASS, pull, 0.0, GAP, stop_m=GAP / 2, restitution=0.0, back_stop_m=0.3 * GAP)
    times = np.array([0.014, 0.016, 0.0165, 0.03])
    motion = simulate(system, source, times)
    free = GAP / 2 * np.cos(2 * np.pi * 100.0 * (times[1:3] - 0.015))
    assert motion.displacement_m[0, 0] == GAP / 2
    assert motion.displacement_m[0, 1:3] == pytest.approx(free, rel=1e-8)
    # It swings back and strikes the stop behind, inelastic, and stays below it: nothing pulls it off but its spring.
    back = [contact for contact in motion.contacts if not contact.at_coil]
    assert len(back) == 1 and not back[0].stays and not motion.held[0]
    assert back[0].time_s == pytest.approx(0.015 + np.arccos(-0.6) / (2 * np.pi * 100.0), rel=1e-8)
    assert abs(motion.displacement_m[0, 3]) <= 0.3 * GAP * (1 + 1e-9)


def test_a_run_that_takes_too_many_steps_is_refused():
    system, source = strong()
    with pytest.raises(SolverError, match="took 5 steps"):
        simulate(system, source, [1.0], most_steps=5)


@pytest.mark.parametrize("name", ["paper-pair", "triple-48"])
def test_every_rung_errs_by_no_more_than_it_states(name):
    plan = make_plan(load_spec(name))
    rows = dynamics_ladder(plan, 0.3)
    assert [row.model for row in rows[:3]] == ["phasor", "exponential", "coupled"]
    assert all(row.error <= row.stated_error for row in rows)
    assert all(row.error < 1e-5 for row in rows if row.resolution in ("tolerance 0.0001", "tolerance 1e-06"))
    assert all(row.residual < 1e-6 for row in rows[2:])


def test_every_drive_makes_its_current(pair_plan):
    import pickle
    from dataclasses import replace

    for scheme in ("tones", "biased", "spur-free"):
        plan = replace(pair_plan, selectivity=replace(pair_plan.selectivity, drive=scheme, worst_state="11"))
        question = dynamics_question(plan, 0.05)
        run = simulate(question.system, question.voltage, question.time_s, current_a=question.initial_a)
        square = signal(question.squared_current, question.time_s)
        # Motion changes the coil's inductance by 1e-5 or so: what the circuit then misses is of that size.
        assert run.current_a**2 == pytest.approx(square, abs=1e-4 * square.max())
        pickle.loads(pickle.dumps(dynamics_rungs(question)[1].solve))()
    with pytest.raises(SolverError):
        dynamics_question(pair_plan, -1.0)


@pytest.mark.parametrize("case", [c for c in dynamics_cases() if "Radau" not in c.source], ids=lambda c: c.name)
def test_extreme_cases_are_right_or_refused(case):
    if "101 %" in case.name:
        with pytest.raises(SolverError, match="pulled onto the coil"):
            case.solve()
        return
    answer, exact = case.solve(), case.reference()
    assert np.abs(answer.values - exact).max() <= answer.stated_error * np.abs(exact).max()
    assert answer.stated_error <= 1e-6


def test_the_papers_pair(pair_plan, tmp_path):
    figures = paper_figures(pair_plan)
    for found in figures.comparisons[:2]:  # the two levels that Q was fitted to; the paper gives whole dB
        assert found.here_db == pytest.approx(found.measured_db, abs=0.5)
    # 40 log10(78/60) of equal masses, and what the softer washer is pulled more since it hangs nearer to the coil.
    first, second = (channel.force_constant_n_per_a2 for channel in pair_plan.channels)
    difference = figures.comparisons[0].here_db - figures.comparisons[1].here_db
    assert difference == pytest.approx(-4.56 + 40 * np.log10(first / second), abs=0.05)
    assert figures.q == pytest.approx(25.1, abs=0.1)
    both = figures.spectra[2]
    assert both.state == "11" and both.line_hz.tolist() == [0.0, 9.0, 60.0, 69.0, 78.0]
    # The coupled model has the same lines, to what softening shifts a resonance: 3e-4 of f, at Q = 25 under 2 %.
    coupled = both.coupled_um[:, both.line_hz.astype(int)]
    assert coupled == pytest.approx(both.phasor_um, rel=0.02)
    for name in ("a.svg", "b.svg", "a.png"):
        draw_paper_figures(figures, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
