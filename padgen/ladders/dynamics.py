"""The dynamics ladder: where a coil's taxels are after switching on, from phasors to coil and washers in motion.

Phasors leave out the transient and how motion acts back, exact propagation only the latter.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.core.units import GRAM, MH, MM
from padgen.ladders.rung import Ladder, Rung, Scene, Solved
from padgen.physics.currents import bias_a
from padgen.physics.magnetics import impedance
from padgen.physics.phasor import Tones, signal, squared, steady_lines, tones
from padgen.physics.propagation import propagate
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import Plan
from padgen.verify.coupled import CoupledSystem, Source, from_tones, make_system, simulate
from padgen.verify.extreme import Answer

__all__ = ["DynamicsQuestion", "dynamics_ladders", "dynamics_models", "dynamics_question", "solved"]

FINEST = "coupled"
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
SAMPLES = 64
RING_UPS = 3.0


@dataclass(frozen=True)
class DynamicsQuestion:
    """One coil with its taxels, what it is driven with, and the times (k,) in s to answer for.

    `current` in A is of schemes that are sums of tones, None where it is the root of `squared_current` in A².
    """

    system: CoupledSystem
    scheme: Scheme
    current: Tones | None
    squared_current: Tones
    time_s: np.ndarray

    @property
    def force(self) -> Tones:
        """The pull in N on each washer where it rests, amplitudes (n, m)."""
        lines = self.squared_current
        return lines._replace(amplitude=self.system.pull_n_per_a2[:, None] * lines.amplitude)

    @property
    def voltage(self) -> Source:
        """The voltage that makes this current in the coil with its washers at rest."""
        resistance, inductance, current = self.system.resistance_ohm, self.system.inductance_h, self.current
        if current is None:
            return Source("voltage", partial(_root_voltage, self.squared_current, resistance, inductance))
        z = impedance(resistance, inductance, current.frequency_hz)
        size, phase = current.amplitude * np.abs(z), current.phase_rad + np.angle(z)
        return from_tones("voltage", current._replace(amplitude=size, phase_rad=phase))

    @property
    def initial_a(self) -> float:
        """The current in A at t = 0, when the taxels are let go: no step of the voltage is left to the circuit."""
        value = float(signal(self.current or self.squared_current, np.zeros(1))[0])
        return value if self.current else value**0.5


def dynamics_ladders(scene: Scene) -> Iterator[Ladder]:
    """Yield one ladder per kind of coil, in the plan's worst state; none where the coil pulls no washer."""
    for kind in range(len(scene.plan.sets)):
        try:
            question = dynamics_question(scene.plan, coil_set=kind)
        except SolverError:
            continue
        first, last = (1e3 * float(question.time_s[place]) for place in (0, -1))
        channels = ", ".join(str(channel.index) for channel in scene.plan.sets[kind])
        yield Ladder(
            "dynamics",
            f"channels {channels}, driven {question.scheme.name}",
            f"displacement {first:.4g} … {last:.4g} ms after switching on",
            "m",
            tuple(
                Rung(model, resolution, partial(solved, solve, unknowns), FINEST if model == FINEST else "")
                for model, resolution, unknowns, solve in dynamics_models(question)
            ),
            FINEST,
            note="errors are of the largest displacement; the coupled model refines its tolerance",
        )


def solved(solve: Callable[[], Answer], unknowns: int) -> Solved:
    """Turn the answer of one of the `dynamics_models` into a `Solved`."""
    answer = solve()
    return Solved(answer.values, unknowns, answer.residual)


def dynamics_question(plan: Plan, after_s: float | None = None, coil_set: int = 0) -> DynamicsQuestion:
    """Ask about one coil of a plan, in its worst state, two periods of the lowest channel from `after_s` on.

    Three ring-ups of the slowest channel unless told otherwise.

    Raises
    ------
    SolverError
        `after_s` is negative, or the coil pulls none of its washers.
    """
    own, coil, scheme, state = plan.sets[coil_set], plan.spec.coil, plan.scheme, plan.selectivity.worst_state
    on = np.array([bit == "1" for bit in state] if len(state) == len(own) and "1" in state else [True] * len(own))
    line_a2 = np.array([c.line_a2 for c in own])
    frequency, q = np.array([c.resonance_hz for c in own]), np.array([c.q for c in own])
    start = RING_UPS * float((q / (np.pi * frequency)).max()) if after_s is None else after_s
    if start < 0 or not line_a2[on].any():
        raise SolverError(f"needs a time of at least 0 s and a washer that is pulled, got {number(start)} s")
    system = make_system(
        frequency,
        q,
        [c.effective_mass_g * GRAM for c in own],
        [max(c.force_constant_n_per_a2, 0.0) for c in own],
        [max(c.pull_exponent, 0.0) for c in own],
        coil.gap_mm * MM,
        coil.resistance_ohm,
        coil.inductance_mh * MH,
    )
    hz, lines, bias = frequency[on], line_a2[on], bias_a(scheme, line_a2)
    current = None if scheme.is_root else tones(hz / 2, np.sqrt(2 * lines), -np.pi / 2)
    if scheme.is_biased:
        phase = np.append(np.full(len(hz), -np.pi / 2), 0.0)
        current = tones(np.append(hz, 0.0), np.append(lines / (2 * bias), bias), phase)
    wanted = tones(np.append(hz, 0.0), np.append(lines, (1 + plan.spec.drive.headroom) * lines.sum()))
    times = start + np.linspace(0, 2 / float(frequency.min()), SAMPLES)
    return DynamicsQuestion(system, scheme, current, squared(current) if current else wanted, times)


def dynamics_models(question: DynamicsQuestion) -> Iterator[tuple[str, str, int, Callable[[], Answer]]]:
    """Yield model, resolution, unknowns and what answers, coarsest first; the coupled one with ever finer tolerances.

    Answers are displacements (n, k) in m; they can be sent to another process.
    """
    n = len(question.system.frequency_hz)
    yield "phasor", "steady state", n, partial(_phasor, question)
    yield "exponential", "exact, linear", 2 * n, partial(_exponential, question)
    for tolerance in TOLERANCES:
        yield FINEST, f"tolerance {tolerance:g}", 2 * n + 1, partial(_coupled, question, tolerance)


def _phasor(question: DynamicsQuestion) -> Answer:
    system, force = question.system, question.force
    lines = steady_lines(system.frequency_hz, system.q, system.mass_kg, force)
    moved = (lines @ np.exp(2j * np.pi * (force.frequency_hz + force.rest_hz)[:, None] * question.time_s)).real
    transient = np.exp(-np.pi * system.frequency_hz / system.q * question.time_s[0]).max()
    return Answer(moved, float(transient) + _acting_back(question, moved))


def _exponential(question: DynamicsQuestion) -> Answer:
    system = question.system
    moved = propagate(system.frequency_hz, system.q, system.mass_kg, question.force, question.time_s)
    return Answer(moved, _acting_back(question, moved))


def _coupled(question: DynamicsQuestion, tolerance: float) -> Answer:
    motion = simulate(question.system, question.voltage, question.time_s, question.initial_a, tolerance)
    # Steps add up: a hundred periods of a root's corners came to 1.2 tolerances.
    return Answer(motion.displacement_m, 10 * tolerance, motion.residual)


def _acting_back(question: DynamicsQuestion, moved: np.ndarray) -> float:
    """Estimate what the linear models leave out, as a share of the amplitude.

    The mean pull softens a spring by ``m z/g``, and its resonance, met within 1/Q, feels that Q
    times; the swing itself does so in second order; and it changes the coil's inductance.
    """
    system, largest = question.system, np.abs(moved).max(1)
    mean, swing = np.abs(moved.mean(1)) / system.gap_m, largest / system.gap_m
    m, q = system.exponent, np.maximum(system.q, 1)
    spring = q * m * mean + m * swing + q * m * (m + 1) * swing**2
    return float(spring.max()) + 4 * float((system.pull_n_per_a2 * largest).sum()) / system.inductance_h


def _root_voltage(lines: Tones, resistance: float, inductance: float, time_s: np.ndarray) -> np.ndarray:
    """Return u = R i + L di/dt in V of i = √F: ``di/dt = F'/(2i)``."""
    slope = 2 * np.pi * lines.frequency_hz * lines.amplitude
    quarter = lines._replace(amplitude=slope, phase_rad=lines.phase_rad + np.pi / 2)
    current = np.sqrt(signal(lines, time_s))
    return np.asarray(resistance * current + inductance * signal(quarter, time_s) / (2 * current))
