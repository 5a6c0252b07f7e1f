"""The ladder of dynamics: the same question answered by phasors, exact propagation and the coupled system.

The question: where are the taxels of one coil, in the plan's worst state, from some time after
switching on? Phasors leave out the transient and how motion acts back, propagation only the latter.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.core.units import GRAM, MH, MM
from padgen.physics.currents import bias_a
from padgen.physics.magnetics import impedance
from padgen.physics.phasor import Tones, signal, squared, steady_lines, tones
from padgen.physics.propagation import propagate
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import Plan
from padgen.verify.coupled import simulate
from padgen.verify.dynamics_model import CoupledSystem, Source, from_tones, make_system
from padgen.verify.extreme import Answer

__all__ = ["DynamicsQuestion", "DynamicsRow", "DynamicsRung", "dynamics_ladder", "dynamics_question", "dynamics_rungs"]

TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
SAMPLES = 64
RING_UPS = 3.0


@dataclass(frozen=True)
class DynamicsQuestion:
    """One coil with its taxels, what it is driven with, and the times (k,) in s to answer for.

    `lines_a2` (m,) are the wanted lines of i² that are on, at `line_hz`; `largest_a2` is the largest of
    the coil's channels, on or not, which sets the bias.
    """

    system: CoupledSystem
    scheme: Scheme
    line_hz: np.ndarray
    lines_a2: np.ndarray
    largest_a2: float
    headroom: float
    time_s: np.ndarray

    @property
    def current(self) -> Tones:
        """The current of schemes that are sums of tones, in A."""
        if self.scheme.is_biased:
            bias = bias_a(self.scheme, np.array([self.largest_a2]))
            sines = tones(self.line_hz, self.lines_a2 / (2 * bias), -np.pi / 2)
            return Tones(*(np.append(a, b) for a, b in zip(sines, (0.0, bias, 0.0, 0.0, 0.0), strict=True)))
        return tones(self.line_hz / 2, np.sqrt(2 * self.lines_a2), -np.pi / 2)

    @property
    def squared_current(self) -> Tones:
        """All lines of i² in A²."""
        if not self.scheme.is_root:
            return squared(self.current)
        constant = (1 + self.headroom) * self.lines_a2.sum()
        return tones(np.append(self.line_hz, 0.0), np.append(self.lines_a2, constant))

    @property
    def force(self) -> Tones:
        """The pull in N on each washer where it rests, amplitudes (n, m)."""
        lines = self.squared_current
        return lines._replace(amplitude=self.system.pull_n_per_a2[:, None] * lines.amplitude)

    @property
    def voltage(self) -> Source:
        """The voltage that makes this current in the coil with its washers at rest."""
        resistance, inductance = self.system.resistance_ohm, self.system.inductance_h
        if not self.scheme.is_root:
            current = self.current
            z = impedance(resistance, inductance, current.frequency_hz)
            return from_tones(
                "voltage",
                current._replace(amplitude=current.amplitude * np.abs(z), phase_rad=current.phase_rad + np.angle(z)),
            )
        return Source("voltage", partial(_root_voltage, self.squared_current, resistance, inductance))

    @property
    def initial_a(self) -> float:
        """The current in A at t = 0, when the taxels are let go: no step of the voltage is left to the circuit."""
        if self.scheme.is_root:
            return float(np.sqrt(signal(self.squared_current, np.zeros(1))[0]))
        return float(signal(self.current, np.zeros(1))[0])


class DynamicsRung(NamedTuple):
    """A model of the ladder; `solve` gives displacements (n, k) in m and can be sent to another process."""

    model: str
    resolution: str
    unknowns: int
    solve: Callable[[], Answer]


class DynamicsRow(NamedTuple):
    """What a rung costs, its largest error over the taxels (of each one's own largest), and what it stated."""

    model: str
    resolution: str
    unknowns: int
    error: float
    stated_error: float
    seconds: float
    residual: float


def dynamics_question(plan: Plan, after_s: float | None = None, coil_set: int = 0) -> DynamicsQuestion:
    """The question for one coil of a plan, in its worst state, two periods of the lowest channel from `after_s` on.

    Three ring-ups of the slowest channel unless told otherwise.

    Raises
    ------
    SolverError
        `after_s` is negative, or the coil pulls none of its washers.
    """
    own, spec = plan.sets[coil_set], plan.spec
    scheme = plan.scheme
    state = plan.selectivity.worst_state
    on = np.array([bit == "1" for bit in state] if len(state) == len(own) and "1" in state else [True] * len(own))
    lines = np.array([c.line_a2 for c in own])
    frequency, q = np.array([c.resonance_hz for c in own]), np.array([c.q for c in own])
    start = RING_UPS * float((q / (np.pi * frequency)).max()) if after_s is None else after_s
    if start < 0 or not lines[on].any():
        raise SolverError(f"needs a time of at least 0 s and a washer that is pulled, got {number(start)} s")
    system = make_system(
        frequency,
        q,
        [c.effective_mass_g * GRAM for c in own],
        [max(c.force_constant_n_per_a2, 0.0) for c in own],
        [max(c.pull_exponent, 0.0) for c in own],
        spec.coil.gap_mm * MM,
        spec.coil.resistance_ohm,
        spec.coil.inductance_mh * MH,
    )
    times = start + np.linspace(0, 2 / float(frequency.min()), SAMPLES)
    return DynamicsQuestion(system, scheme, frequency[on], lines[on], float(lines.max()), spec.drive.headroom, times)


def dynamics_rungs(question: DynamicsQuestion) -> tuple[DynamicsRung, ...]:
    """The models, coarsest first; the coupled one with ever finer tolerances."""
    n = len(question.system.frequency_hz)
    return (
        DynamicsRung("phasor", "steady state", n, partial(_phasor, question)),
        DynamicsRung("exponential", "exact, linear", 2 * n, partial(_exponential, question)),
        *(
            DynamicsRung("coupled", f"tolerance {tolerance:g}", 2 * n + 1, partial(_coupled, question, tolerance))
            for tolerance in TOLERANCES
        ),
    )


def dynamics_ladder(plan: Plan, after_s: float | None = None) -> tuple[DynamicsRow, ...]:
    """Every rung's answer against the finest; raises as `dynamics_question` and `simulate` do."""
    question = dynamics_question(plan, after_s)
    answers = []
    for rung in dynamics_rungs(question):
        start = perf_counter()
        answers.append((rung, rung.solve(), perf_counter() - start))
    finest = answers[-1][1].values
    scale = np.abs(finest).max(1)
    return tuple(
        DynamicsRow(
            rung.model,
            rung.resolution,
            rung.unknowns,
            float((np.abs(answer.values - finest).max(1) / np.where(scale > 0, scale, 1)).max()),
            answer.stated_error,
            seconds,
            answer.residual,
        )
        for rung, answer, seconds in answers
    )


def _phasor(question: DynamicsQuestion) -> Answer:
    system, force = question.system, question.force
    lines = steady_lines(system.frequency_hz, system.q, system.mass_kg, force)
    unit = Tones(force.frequency_hz, np.abs(lines), 0 * force.phase_rad, force.decay_per_s, force.rest_hz)
    moved = np.stack([signal(unit._replace(amplitude=a, phase_rad=p), question.time_s) for a, p in _polar(lines)])
    transient = np.exp(-np.pi * system.frequency_hz / system.q * question.time_s[0]).max()
    return Answer(moved, float(transient) + _acting_back(question, moved))


def _polar(lines: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    return list(zip(np.abs(lines), np.angle(lines), strict=True))


def _exponential(question: DynamicsQuestion) -> Answer:
    system = question.system
    moved = propagate(system.frequency_hz, system.q, system.mass_kg, question.force, question.time_s).displacement_m
    return Answer(moved, _acting_back(question, moved))


def _coupled(question: DynamicsQuestion, tolerance: float) -> Answer:
    motion = simulate(
        question.system, question.voltage, question.time_s, current_a=question.initial_a, tolerance=tolerance
    )
    # Steps add up: a hundred periods of a root's corners came to 1.2 tolerances.
    return Answer(motion.displacement_m, 10 * tolerance, motion.energy.residual)


def _acting_back(question: DynamicsQuestion, moved: np.ndarray) -> float:
    """Estimate of what the linear models leave out, of the amplitude.

    The mean pull softens a spring by ``m z/g``, and its resonance, met within 1/Q, feels that Q
    times; the swing itself does so in second order; and it changes the coil's inductance.
    """
    system = question.system
    mean = np.abs(moved.mean(1)) / system.gap_m
    swing = np.abs(moved).max(1) / system.gap_m
    m, q = system.exponent, np.maximum(system.q, 1)
    spring = q * m * mean + m * swing + q * m * (m + 1) * swing**2
    coil = 4 * float((system.pull_n_per_a2 * np.abs(moved).max(1)).sum()) / system.inductance_h
    return float(spring.max()) + coil


def _root_voltage(lines: Tones, resistance: float, inductance: float, time_s: np.ndarray) -> np.ndarray:
    """u = R i + L di/dt in V of i = √F: ``di/dt = F'/(2i)``."""
    square = signal(lines, time_s)
    quarter = lines._replace(
        amplitude=lines.amplitude * 2 * np.pi * lines.frequency_hz, phase_rad=lines.phase_rad + np.pi / 2
    )
    current = np.sqrt(square)
    return np.asarray(resistance * current + inductance * signal(quarter, time_s) / (2 * current))
