"""Stiff and extreme cases of the time domain, each with a reference of its own.

References are 40-digit arithmetic on formulas that cancel freely, energy and balance in closed form,
or a solver of another kind at its finest setting.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from padgen.physics.magnetics import balanced_deflection, impedance, pull_in_deflection
from padgen.physics.propagation import STATED_ERROR, Tones, circuit_current, propagate, squared, steady_lines, tones
from padgen.verify.coupled import CoupledSystem, Source, from_tones, make_system, scipy_motion, simulate
from padgen.verify.engines import mpmath
from padgen.verify.extreme import Answer, ExtremeCase

__all__ = ["dynamics_cases", "exact_displacement"]

MASS_KG, GAP_M, RESISTANCE_OHM = 1e-4, 1e-3, 62.9
DIGITS = 40
MANY_DIGITS = f"mpmath, {DIGITS} digits"
COUPLED_TOLERANCE = 1e-9


def dynamics_cases() -> Iterator[ExtremeCase]:
    """Yield all cases of the domain 'dynamics'; references need mpmath or scipy when they are asked for."""
    hz, early_and_late = np.array([20.0, 110.0, 440.0, 1000.0]), np.array([1e-3, 0.1, 10.0])
    force = tones(np.append(hz[:2], hz[2:] + 1e-9), 1e-5, np.arange(4.0))
    for q in (1.0, 15.0, 1e3, 1e5, 1e7):
        yield _propagated(
            f"Q = {q:g}, on resonance and 1e-9 Hz off it, 1 ms and 10 s", hz, q, MASS_KG, force, early_and_late
        )
    critical = 0.5 * (1 + 1e-12 * np.arange(4))
    yield _propagated("critical damping, and 1e-12 off it", hz, critical, MASS_KG, force, early_and_late)
    yield _phasor_near_resonance()
    yield _many_oscillators()
    hz, name = np.geomspace(20, 1000, 7), "masses of 1e-3 to 1e3 of a taxel's under one force"
    yield _propagated(name, hz, 15.0, np.geomspace(1e-7, 1e-1, 7), tones(hz, 1e-5), np.array([0.01, 10.0]))
    for constant_s in (1e-6, 1e-3, 10.0):
        yield _circuit_and_taxel(constant_s)
    for constant_s in (1e-6, 10.0):
        yield _acting_back(constant_s)
    hz, mass = np.array([60.0, 170.0, 480.0]), MASS_KG * np.array([1e3, 1.0, 1e-3])
    pull = mass * (2 * np.pi * hz) ** 2 * GAP_M / 40
    system = make_system(hz, 15.0, mass, pull, 2.0, GAP_M, RESISTANCE_OHM, 40 * GAP_M * float(pull.sum()))
    voltage = tones(hz / 2, 0.4 * np.abs(impedance(RESISTANCE_OHM, system.inductance_h, hz / 2)))
    yield _against_scipy("masses of 1e-3 to 1e3 over one coil", system, voltage, np.array([0.01, 0.03]), False)
    yield from _pull_in()


def exact_displacement(frequency_hz: float, q: float, mass_kg: float, force: Tones, time_s: float) -> float:
    """Return the displacement in m of one resonator from rest by the textbook formula, in arithmetic of many digits.

    Raises
    ------
    EngineMissingError
        mpmath is not installed.
    """
    mp = mpmath.mp.clone()
    mp.dps = DIGITS + 20
    omega, t = 2 * mp.pi * mp.mpf(float(frequency_hz)), mp.mpf(float(time_s))
    alpha = omega / (2 * mp.mpf(float(q)))
    # Where the formula is 0/0 it is taken a hair beside, far below the digits that are kept.
    hair = mp.mpf(10) ** (-DIGITS // 2)
    alpha = alpha * (1 + hair) if alpha == omega else alpha
    root = mp.sqrt(mp.mpc(alpha**2 - omega**2))
    first, second = -alpha + root, -alpha - root
    push = (mp.exp(first * t) - mp.exp(second * t)) / (first - second)
    keep = (mp.exp(first * t) + mp.exp(second * t)) / 2 + alpha * push
    total = mp.mpf(0)
    for line in zip(*force, strict=True):
        hz, size, phase, decay, rest = (mp.mpf(float(v)) for v in line)
        a = mp.mpc(-decay, 2 * mp.pi * (hz + rest))
        a = a + omega * hair if abs(a - first) < omega * hair**1.5 else a
        moved = (mp.exp(a * t) - keep - a * push) / ((a - first) * (a - second))
        total += size * mp.re(mp.expj(phase) * moved)
    return float(total / mp.mpf(float(mass_kg)))


def _case(
    name: str, model: str, solve: Callable[[], Answer], reference: Callable[[], np.ndarray], source: str = MANY_DIGITS
) -> ExtremeCase:
    return ExtremeCase(name, "dynamics", model, solve, reference, source)


def _over_largest(values: np.ndarray) -> np.ndarray:
    """Return displacements (n, k) over each resonator's largest."""
    return np.asarray(values / np.abs(values).max(1, keepdims=True))


def _propagated(name: str, hz: np.ndarray, q: Any, mass: Any, force: Tones, times: np.ndarray) -> ExtremeCase:
    def solve() -> Answer:
        return Answer(_over_largest(propagate(hz, q, mass, force, times)), 10 * STATED_ERROR)

    def exact() -> np.ndarray:
        own = zip(*np.broadcast_arrays(hz, q, mass), strict=True)
        return _over_largest(np.array([[exact_displacement(f, d, m, force, t) for t in times] for f, d, m in own]))

    return _case(name, "exponential", solve, exact)


def _phasor_near_resonance() -> ExtremeCase:
    hz, q = 1000.0, 1e7
    force = tones(hz + 1e-9, 1e-5)

    def exact() -> np.ndarray:
        mp = mpmath.mp.clone()
        mp.dps = DIGITS
        own, at = mp.mpf(hz), mp.mpf(float(force.frequency_hz[0]))
        bracket = 4 * mp.pi**2 * mp.mpf(MASS_KG) * mp.mpc(own**2 - at**2, at * own / mp.mpf(q))
        moved = mp.mpf(1e-5) / bracket
        return np.array([float(moved.real), float(moved.imag)])

    def solve() -> Answer:
        line = steady_lines(np.array([hz]), q, MASS_KG, force)[0, 0]
        return Answer(np.array([line.real, line.imag]), STATED_ERROR)

    return _case("steady state at Q = 1e7, 1e-9 Hz off resonance", "phasor", solve, exact)


def _many_oscillators() -> ExtremeCase:
    """Make a case of 2,048 resonators in unit of a static deflection, so that slow and fast ones weigh alike."""
    hz = np.geomspace(0.1, 1000, 2048)
    force, seen = tones(hz[::32], 1e-5, np.arange(64)), np.linspace(0, len(hz) - 1, 16).astype(int)
    times, static = np.linspace(0, 10, 201)[1:], 1e-5 / (MASS_KG * (2 * np.pi * hz[seen]) ** 2)

    def solve() -> Answer:
        moved = propagate(hz, 1e6, MASS_KG, force, times)
        return Answer(moved[seen, -1] / static, 10 * STATED_ERROR)

    def exact() -> np.ndarray:
        return np.asarray([exact_displacement(f, 1e6, MASS_KG, force, 10.0) for f in hz[seen]] / static)

    name = "2,048 oscillators over 1e4 in frequency, Q = 1e6, 64 tones, 10 s"
    return _case(name, "exponential", solve, exact, f"{MANY_DIGITS}, 16 of them")


def _refined(system: CoupledSystem, voltage: Tones, times: np.ndarray) -> Answer:
    """Make a coupled run; it states ten times what a finer one with other stages differs by."""
    source = from_tones("voltage", voltage)
    run = simulate(system, source, times, tolerance=COUPLED_TOLERANCE)
    fine = simulate(system, source, times, tolerance=COUPLED_TOLERANCE / 100, stages=14).displacement_m
    largest = np.abs(fine).max(1, keepdims=True)
    off = float(np.abs((run.displacement_m - fine) / largest).max())
    return Answer(run.displacement_m / largest, 10 * off + 1e-11, run.residual)


def _circuit_and_taxel(constant_s: float) -> ExtremeCase:
    """Make a case of a pull so weak that nothing acts back: the linear model is the truth."""
    inductance, weak = RESISTANCE_OHM * constant_s, 1e-12
    voltage = tones([0.0, 500.0, 380.0], [1.0, 2.0, 2.0], [0.0, 0.3, 0.2])
    system = make_system(1000.0, 15.0, MASS_KG, weak, 0.0, GAP_M, RESISTANCE_OHM, inductance)
    times = np.array([0.002, 0.01, 0.05])

    def exact() -> np.ndarray:
        lines = squared(circuit_current(voltage, RESISTANCE_OHM, inductance))
        force = lines._replace(amplitude=weak * lines.amplitude)
        return _over_largest(np.array([[exact_displacement(1000.0, 15.0, MASS_KG, force, t) for t in times]]))

    name = f"R-L time constant of {constant_s:g} s beside a taxel of 1 kHz"
    return _case(name, "coupled", partial(_refined, system, voltage, times), exact)


def _acting_back(constant_s: float) -> ExtremeCase:
    """Make a case of a pull that moves the washer by a tenth of its gap, and motion that moves the current."""
    inductance, hz = RESISTANCE_OHM * constant_s, 1000.0
    stiffness = MASS_KG * (2 * np.pi * hz) ** 2
    pull = min(stiffness * GAP_M / 10, inductance / GAP_M / 20)
    amps = float(np.sqrt(stiffness * GAP_M / 10 / pull))
    voltage = tones(hz / 2, amps * float(np.abs(impedance(RESISTANCE_OHM, inductance, hz / 2))), 0.0)
    system = make_system(hz, 5.0, MASS_KG, pull, 2.0, GAP_M, RESISTANCE_OHM, inductance)
    name = f"motion that acts back on a circuit of {constant_s:g} s, taxel of 1 kHz"
    return _against_scipy(name, system, voltage, np.array([0.0005, 0.001]), constant_s < 1e-4)


def _against_scipy(name: str, system: CoupledSystem, voltage: Tones, times: np.ndarray, stiff: bool) -> ExtremeCase:
    how, method, tolerance = ("Radau at 1e-12", "Radau", 1e-12) if stiff else ("DOP853 at 3e-14", "DOP853", 3e-14)

    def reference() -> np.ndarray:
        moved = scipy_motion(system, from_tones("voltage", voltage), times, method, tolerance)
        return _over_largest(moved[: len(system.gap_m)])

    return _case(name, "coupled", partial(_refined, system, voltage, times), reference, f"scipy {how}")


def _pull_in() -> Iterator[ExtremeCase]:
    """Yield cases of a constant current beside the one that pulls the washer in: damped, and let go of undamped."""
    hz, exponent, direct = 100.0, 2.0, Source("current", np.ones_like)
    stiffness = MASS_KG * (2 * np.pi * hz) ** 2
    largest = stiffness * pull_in_deflection(GAP_M, exponent)[1]

    def highest(q: float, pull: float, times: np.ndarray, stated: float) -> Answer:
        system = make_system(hz, q, MASS_KG, pull, exponent, GAP_M)
        motion = simulate(system, direct, times, tolerance=COUPLED_TOLERANCE)
        return Answer(motion.displacement_m.max(keepdims=True) / GAP_M, stated, motion.residual)

    balance = balanced_deflection(0.99 * largest / stiffness, GAP_M, exponent) or float("nan")
    cases = (("99", balance / GAP_M, "balance in closed form"), ("101", float("nan"), "there is none"))
    for percent, truth, source in cases:
        solve = partial(highest, 0.5, int(percent) / 100 * largest, np.ones(1), 1e-9)
        yield _case(f"mean pull at {percent} % of pull-in", "coupled", solve, partial(np.full, (1, 1), truth), source)
    # Let go of at rest, ½ k z (1 − z/g) = c i² gives the turning point, of a half of the gap at most.
    share, times = 0.999, np.linspace(0, 0.03, 20_001)
    solve = partial(highest, np.inf, share * stiffness * GAP_M / 8, times, 1e-6)
    turning, name = (1 - np.sqrt(1 - share)) / 2, "undamped, let go of at 99.9 % of what pulls it in"
    yield _case(name, "coupled", solve, partial(np.full, (1, 1), turning), "conservation of energy")
