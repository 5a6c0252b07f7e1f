"""Stiff and extreme cases of the time domain, each with a reference of its own.

References are 40-digit arithmetic on formulas that cancel freely, energy and balance in closed form,
or a solver of another kind at its finest setting.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from padgen.physics.magnetics import balanced_deflection, impedance, pull_in_deflection
from padgen.physics.phasor import Tones, circuit_current, squared, steady_lines, tones
from padgen.physics.propagation import STATED_ERROR, propagate
from padgen.verify.coupled import simulate
from padgen.verify.dynamics_model import CoupledSystem, Source, coupled_rates, from_tones, make_system
from padgen.verify.engines import engine
from padgen.verify.extreme import Answer, ExtremeCase

__all__ = ["dynamics_cases", "exact_displacement"]

MASS_KG, GAP_M, RESISTANCE_OHM = 1e-4, 1e-3, 62.9
DIGITS = 40
MANY = 2048
COUPLED_TOLERANCE = 1e-9


def dynamics_cases() -> Iterator[ExtremeCase]:
    """All cases of the domain 'dynamics'; references need mpmath or scipy when they are asked for."""
    for q in (1.0, 15.0, 1e3, 1e5, 1e7):
        yield _propagated(f"Q = {q:g}, on resonance and 1e-9 Hz off it, 1 ms and 10 s", q)
    yield _propagated("critical damping, and 1e-12 off it", 0.5 * (1 + 1e-12 * np.arange(4)))
    yield _phasor_near_resonance()
    yield _many_oscillators()
    yield _masses_propagated()
    for constant_s in (1e-6, 1e-3, 10.0):
        yield _circuit_and_taxel(constant_s)
    for constant_s in (1e-6, 10.0):
        yield _acting_back(constant_s)
    yield _masses_coupled()
    yield from _pull_in()


def exact_displacement(
    frequency_hz: float, q: float, mass_kg: float, force: Tones, time_s: float, digits: int = DIGITS
) -> float:
    """Displacement in m of one resonator from rest by the textbook formula, in arithmetic of many digits.

    Raises
    ------
    EngineMissingError
        mpmath is not installed.
    """
    mp = engine("mpmath").mp.clone()
    mp.dps = digits + 20
    number = _numbers(mp)
    omega, t = 2 * mp.pi * number(frequency_hz), number(time_s)
    alpha = omega / (2 * number(q))
    # Where the formula is 0/0 it is taken a hair beside, far below the digits that are kept.
    hair = mp.mpf(10) ** (-digits // 2)
    alpha = alpha * (1 + hair) if alpha == omega else alpha
    root = mp.sqrt(mp.mpc(alpha**2 - omega**2))
    first, second = -alpha + root, -alpha - root
    push = (mp.exp(first * t) - mp.exp(second * t)) / (first - second)
    keep = (mp.exp(first * t) + mp.exp(second * t)) / 2 + alpha * push
    total = mp.mpf(0)
    for hz, size, phase, decay, rest in zip(*force, strict=True):
        a = mp.mpc(-number(decay), 2 * mp.pi * (number(hz) + number(rest)))
        a = a + omega * hair if abs(a - first) < omega * hair**1.5 else a
        product = (a - first) * (a - second)
        moved = (mp.exp(a * t) - keep - a * push) / product
        total += number(size) * mp.re(mp.expj(number(phase)) * moved)
    return float(total / number(mass_kg))


def _numbers(mp: Any) -> Callable[[Any], Any]:
    return lambda value: mp.mpf(float(value))


def _case(
    name: str, model: str, solve: Callable[[], Answer], reference: Callable[[], np.ndarray], source: str
) -> ExtremeCase:
    return ExtremeCase(name, "dynamics", model, solve, reference, source)


MANY_DIGITS = f"mpmath, {DIGITS} digits"


def _moved(
    hz: Any, q: Any, mass: Any, force: Tones, times: np.ndarray
) -> tuple[Callable[[], Answer], Callable[[], np.ndarray]]:
    """Answer and reference of propagation, each resonator's displacements over its largest."""

    def exact() -> np.ndarray:
        own = np.broadcast_arrays(hz, q, mass)
        return np.array([[exact_displacement(f, d, m, force, t) for t in times] for f, d, m in zip(*own, strict=True)])

    def scaled(values: np.ndarray) -> np.ndarray:
        return np.asarray(values / np.abs(values).max(1, keepdims=True))

    return (
        lambda: Answer(scaled(propagate(hz, q, mass, force, times).displacement_m), 10 * STATED_ERROR),
        lambda: scaled(exact()),
    )


def _propagated(name: str, q: Any) -> ExtremeCase:
    hz = np.array([20.0, 110.0, 440.0, 1000.0])
    force = tones(np.append(hz[:2], hz[2:] + 1e-9), 1e-5, np.arange(4.0))
    solve, reference = _moved(hz, q, MASS_KG, force, np.array([1e-3, 0.1, 10.0]))
    return _case(name, "exponential", solve, reference, MANY_DIGITS)


def _masses_propagated() -> ExtremeCase:
    hz, mass = np.geomspace(20, 1000, 7), np.geomspace(1e-7, 1e-1, 7)
    solve, reference = _moved(hz, 15.0, mass, tones(hz, 1e-5), np.array([0.01, 10.0]))
    return _case("masses of 1e-3 to 1e3 of a taxel's under one force", "exponential", solve, reference, MANY_DIGITS)


def _phasor_near_resonance() -> ExtremeCase:
    hz, q = 1000.0, 1e7
    force = tones(hz + 1e-9, 1e-5)

    def exact() -> np.ndarray:
        mp = engine("mpmath").mp.clone()
        mp.dps = DIGITS
        own, at = mp.mpf(hz), mp.mpf(float(force.frequency_hz[0]))
        per_force = 1 / (4 * mp.pi**2 * mp.mpf(MASS_KG) * mp.mpc(own**2 - at**2, at * own / mp.mpf(q)))
        moved = mp.mpf(1e-5) * per_force
        return np.array([float(moved.real), float(moved.imag)])

    def solve() -> Answer:
        line = steady_lines(np.array([hz]), q, MASS_KG, force)[0, 0]
        return Answer(np.array([line.real, line.imag]), STATED_ERROR)

    return _case("steady state at Q = 1e7, 1e-9 Hz off resonance", "phasor", solve, exact, MANY_DIGITS)


def _many_oscillators() -> ExtremeCase:
    hz = np.geomspace(0.1, 1000, MANY)
    force, looked_at = tones(hz[::32], 1e-5, np.arange(MANY // 32)), np.linspace(0, MANY - 1, 16).astype(int)
    times = np.linspace(0, 10, 201)[1:]

    def solve() -> Answer:
        moved = propagate(hz, 1e6, MASS_KG, force, times).displacement_m
        return Answer(_over_largest(moved[looked_at, -1], hz[looked_at]), 10 * STATED_ERROR)

    def exact() -> np.ndarray:
        last = np.array([exact_displacement(f, 1e6, MASS_KG, force, 10.0) for f in hz[looked_at]])
        return _over_largest(last, hz[looked_at])

    name = "2,048 oscillators over 1e4 in frequency, Q = 1e6, 64 tones, 10 s"
    return _case(name, "exponential", solve, exact, f"{MANY_DIGITS}, 16 of them")


def _over_largest(values: np.ndarray, hz: np.ndarray) -> np.ndarray:
    """Displacements in unit of a static deflection, so that slow and fast resonators weigh alike."""
    return np.asarray(values * MASS_KG * (2 * np.pi * hz) ** 2 / 1e-5)


def _refined(system: CoupledSystem, source: Source, times: np.ndarray) -> Answer:
    """A coupled run; it states ten times what a finer one with other stages differs by."""
    runs = [
        simulate(system, source, times, tolerance=tolerance, stages=stages)
        for tolerance, stages in ((COUPLED_TOLERANCE, 20), (COUPLED_TOLERANCE / 100, 14))
    ]
    coarse, fine = (run.displacement_m / np.abs(runs[1].displacement_m).max(1, keepdims=True) for run in runs)
    return Answer(coarse, 10 * float(np.abs(coarse - fine).max()) + 1e-11, runs[0].energy.residual)


def _circuit_and_taxel(constant_s: float) -> ExtremeCase:
    """A pull so weak that nothing acts back: the linear model is the truth."""
    inductance, weak = RESISTANCE_OHM * constant_s, 1e-12
    voltage = tones([0.0, 500.0, 380.0], [1.0, 2.0, 2.0], [0.0, 0.3, 0.2])
    system = make_system(1000.0, 15.0, MASS_KG, weak, 0.0, GAP_M, RESISTANCE_OHM, inductance)
    times = np.array([0.002, 0.01, 0.05])

    def exact() -> np.ndarray:
        lines = squared(circuit_current(voltage, RESISTANCE_OHM, inductance))
        force = lines._replace(amplitude=weak * lines.amplitude)
        moved = np.array([exact_displacement(1000.0, 15.0, MASS_KG, force, t) for t in times])
        return np.asarray(moved / np.abs(moved).max())[None]

    return _case(
        f"R-L time constant of {constant_s:g} s beside a taxel of 1 kHz",
        "coupled",
        lambda: _refined(system, from_tones("voltage", voltage), times),
        exact,
        MANY_DIGITS,
    )


def _acting_back(constant_s: float) -> ExtremeCase:
    """A pull that moves the washer by a tenth of its gap, and motion that moves the current."""
    inductance, hz = RESISTANCE_OHM * constant_s, 1000.0
    stiffness = MASS_KG * (2 * np.pi * hz) ** 2
    pull = min(stiffness * GAP_M / 10, inductance / GAP_M / 20)
    ohms = float(np.abs(impedance(RESISTANCE_OHM, inductance, hz / 2)))
    amps = float(np.sqrt(stiffness * GAP_M / 10 / pull))
    voltage = tones(hz / 2, ohms * amps, 0.0)
    system = make_system(hz, 5.0, MASS_KG, pull, 2.0, GAP_M, RESISTANCE_OHM, inductance)
    name = f"motion that acts back on a circuit of {constant_s:g} s, taxel of 1 kHz"
    return _against_scipy(name, system, from_tones("voltage", voltage), np.array([0.0005, 0.001]), constant_s < 1e-4)


def _masses_coupled() -> ExtremeCase:
    hz, mass = np.array([60.0, 170.0, 480.0]), MASS_KG * np.array([1e3, 1.0, 1e-3])
    pull = mass * (2 * np.pi * hz) ** 2 * GAP_M / 40
    inductance = 40 * GAP_M * float(pull.sum())
    system = make_system(hz, 15.0, mass, pull, 2.0, GAP_M, RESISTANCE_OHM, inductance)
    ohms = np.abs(impedance(RESISTANCE_OHM, inductance, hz / 2))
    source = from_tones("voltage", tones(hz / 2, 0.4 * ohms))
    return _against_scipy("masses of 1e-3 to 1e3 over one coil", system, source, np.array([0.01, 0.03]), False)


def _against_scipy(name: str, system: CoupledSystem, source: Source, times: np.ndarray, stiff: bool) -> ExtremeCase:
    def reference() -> np.ndarray:
        n = len(system.frequency_hz)
        solver = engine("scipy.integrate").solve_ivp
        scale = np.concatenate([system.gap_m, system.gap_m * system.angular, [1e-3]])
        found = solver(
            coupled_rates(system, source),
            (0.0, float(times[-1])),
            np.zeros(2 * n + 1),
            method="Radau" if stiff else "DOP853",
            rtol=1e-12 if stiff else 3e-14,
            atol=1e-15 * scale,
            t_eval=times,
        )
        moved = found.y[:n]
        return np.asarray(moved / np.abs(moved).max(1, keepdims=True))

    how = "scipy Radau at 1e-12" if stiff else "scipy DOP853 at 3e-14"
    return _case(name, "coupled", lambda: _refined(system, source, times), reference, how)


def _pull_in() -> Iterator[ExtremeCase]:
    """A constant current beside the one that pulls the washer in: damped, and let go of undamped."""
    hz, exponent = 100.0, 2.0
    stiffness = MASS_KG * (2 * np.pi * hz) ** 2
    largest = stiffness * pull_in_deflection(GAP_M, exponent)[1]

    def held(share: float) -> Callable[[], Answer]:
        system = make_system(hz, 0.5, MASS_KG, share * largest, exponent, GAP_M)

        def solve() -> Answer:
            motion = simulate(system, _direct(), np.array([1.0]), tolerance=COUPLED_TOLERANCE)
            return Answer(motion.displacement_m / GAP_M, 1e-9, motion.energy.residual)

        return solve

    balance = balanced_deflection(0.99 * largest / stiffness, GAP_M, exponent) or float("nan")
    source = "balance in closed form"
    yield _case("mean pull at 99 % of pull-in", "coupled", held(0.99), lambda: np.array([[balance / GAP_M]]), source)
    yield _case(
        "mean pull at 101 % of pull-in", "coupled", held(1.01), lambda: np.array([[float("nan")]]), "there is none"
    )
    # Let go of at rest, ½ k z (1 − z/g) = c i² gives the turning point, of a half of the gap at most.
    share = 0.999

    def solve() -> Answer:
        system = make_system(hz, np.inf, MASS_KG, share * stiffness * GAP_M / 8, exponent, GAP_M)
        motion = simulate(system, _direct(), np.linspace(0, 0.03, 20_001), tolerance=COUPLED_TOLERANCE)
        highest = motion.displacement_m.max(keepdims=True) / GAP_M
        return Answer(highest, 1e-6, motion.energy.residual)

    turning = (1 - np.sqrt(1 - share)) / 2
    name = "undamped, let go of at 99.9 % of what pulls it in"
    yield _case(name, "coupled", solve, lambda: np.array([[turning]]), "conservation of energy")


def _direct() -> Source:
    return Source("current", np.ones_like)
