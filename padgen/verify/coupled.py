"""Coil current, circuit and washers' motion simulated in time with all coupling: the most exact model of dynamics.

A washer pulled by ``c i² (g/(g − z))^m`` (z towards the coil, m its pull exponent) is half the slope of an
inductance, so that motion and circuit exchange energy without loss:

    λ = L(z) i,    u = R i + dλ/dt,    L(z) = L₀ + Σ 2 c g ((1 − z/g)^(1−m) − 1)/(m − 1)

It is solved by Radau IIA collocation (Hairer and Wanner, *Solving ODEs II*, 1996) of 20 stages with full Newton and
steps that follow the solution: of what was tried the cheapest at every error (docs/dynamics.md). A step lasts about
a period, is of order 2s − 1 at its end, and damps what is faster, so that an R-L time constant of a microsecond
costs nothing. The washers meet in the current alone: each is eliminated first, and Newton costs O(n s³).
`scipy_motion` solves the same equations by scipy, as a reference.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.polynomial import legendre

from padgen.core.errors import SolverError, number
from padgen.verify.propagation import DecayingTones, signal

__all__ = [
    "Collocation",
    "CoupledMotion",
    "CoupledSystem",
    "Source",
    "from_tones",
    "make_system",
    "radau",
    "scipy_motion",
    "simulate",
]

SMALLEST_STEP = 1e-13
"""Share of the simulated time."""
NEAREST = 0.99
"""Share of the gap at which a washer counts as pulled in."""
TOO_NEAR = 0.9999
"""Share of the gap from which a trial state is no use."""
MOST_ITERATIONS = 12


@dataclass(frozen=True)
class CoupledSystem:
    """Resonators that one coil pulls, as arrays (n,) in SI units; made by `make_system`.

    `pull_n_per_a2` is c at rest, `inductance_h` of the whole coil at rest.
    """

    frequency_hz: np.ndarray
    q: np.ndarray
    mass_kg: np.ndarray
    pull_n_per_a2: np.ndarray
    exponent: np.ndarray
    gap_m: np.ndarray
    resistance_ohm: float
    inductance_h: float

    @property
    def angular(self) -> np.ndarray:
        """Angular natural frequency 2πf (n,) in 1/s."""
        return 2 * np.pi * self.frequency_hz

    def slopes(self, z_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return dL/dz in H/m (twice the pull per A²) and d²L/dz² in H/m², at washer displacements z (n, k)."""
        m = self.exponent[:, None]
        gap = self.gap_m[:, None]
        near = 1 / (1 - z_m / gap)
        slope = 2 * self.pull_n_per_a2[:, None] * near**m
        return slope, slope * near * m / gap

    def inductance(self, z_m: np.ndarray) -> np.ndarray:
        """Return the coil's inductance in H (k,) at k instants, for n washers at displacements z (n, k) in m."""
        m1 = self.exponent[:, None] - 1
        log = -np.log1p(-z_m / self.gap_m[:, None])
        grown = np.where(m1 == 0, log, np.expm1(m1 * log) / np.where(m1 == 0, 1, m1))
        return np.asarray(self.inductance_h + 2 * (self.pull_n_per_a2 * self.gap_m) @ grown)

    def acceleration(self, z_m: np.ndarray, v_m_per_s: np.ndarray, current_a: np.ndarray) -> np.ndarray:
        """Return accelerations (n, k) in m/s² of washers at z and v (n, k) under a current (k,)."""
        pull = current_a**2 * self.slopes(z_m)[0] / (2 * self.mass_kg[:, None])
        angular = self.angular[:, None]
        return np.asarray(pull - angular**2 * z_m - angular / self.q[:, None] * v_m_per_s)


class Source(NamedTuple):
    """The drive of a coil: a smooth 'voltage' in V or 'current' in A as a function of times (k,) in s."""

    kind: Literal["voltage", "current"]
    wave: Callable[[np.ndarray], np.ndarray]


class CoupledMotion(NamedTuple):
    """Displacements and velocities (n, k) and coil current (k,) at the times asked for, and the energy balance in J.

    `energy_j` has what the source put in (driven by current: the pull), the losses in copper and in the suspensions,
    and what is stored; `residual` is what does not add up, over the largest of them.
    """

    displacement_m: np.ndarray
    velocity_m_per_s: np.ndarray
    current_a: np.ndarray
    energy_j: np.ndarray
    residual: float
    steps: int


class Collocation(NamedTuple):
    """A collocation rule of s points on [0, 1]: points, integration matrix, weights, matrix to Legendre coefficients.

    Integrals are from 0 to the points; `to_legendre` takes stage values to Legendre coefficients.
    """

    points: np.ndarray
    integrals: np.ndarray
    weights: np.ndarray
    to_legendre: np.ndarray

    def values(self, stages: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Return values (…, k), at points (k,) in [0, 1] of a step, of the polynomials through `stages` (…, s)."""
        return np.asarray(stages @ (legendre.legvander(2 * at - 1, len(self.points) - 1) @ self.to_legendre).T)

    def integrated(self, stages: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Return integrals (…, k) of the polynomials through `stages` (…, s), from 0 to points (k,) in [0, 1]."""
        return np.asarray(stages @ (_integrals(at, len(self.points)) @ self.to_legendre).T)


class _State(NamedTuple):
    """One instant of a simulation: time in s, displacements and velocities (n,), flux linkage in Wb, current in A."""

    time_s: float
    z: np.ndarray
    v: np.ndarray
    flux: float
    current: float


def make_system(
    frequency_hz: object,
    q: object,
    mass_kg: object,
    pull_n_per_a2: object,
    exponent: object,
    gap_m: object,
    resistance_ohm: float = 0.0,
    inductance_h: float = 1.0,
) -> CoupledSystem:
    """Make a `CoupledSystem` from arrays or numbers: pull, exponent and resistance at least 0, all others above 0."""
    given = (frequency_hz, q, mass_kg, pull_n_per_a2, exponent, gap_m)
    resonance_hz, quality, mass, pull, power, gap = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(v, float)) for v in given)
    )
    return CoupledSystem(resonance_hz, quality, mass, pull, power, gap, resistance_ohm, inductance_h)


def from_tones(kind: Literal["voltage", "current"], wave: DecayingTones) -> Source:
    """Make a source that is a sum of tones."""
    return Source(kind, lambda time_s: signal(wave, time_s))


def simulate(
    system: CoupledSystem,
    source: Source,
    time_s: np.ndarray,
    current_a: float = 0.0,
    tolerance: float = 1e-8,
    stages: int = 20,
    most_steps: int = 500_000,
) -> CoupledMotion:
    """Simulate a coupled system from rest, with `current_a` at t = 0, and sample it at rising times (k,).

    `current_a` counts with a voltage source only: a current source gives the current. `tolerance` is the share of a
    step's solution that its polynomials may leave out; ends of steps are far better.

    Raises
    ------
    SolverError
        No step converges, there are more than `most_steps`, or a washer is pulled onto the coil (the message says
        which and when).
    """
    times = np.atleast_1d(np.asarray(time_s, float))
    if source.kind == "voltage" and not system.inductance(-system.gap_m[:, None]) > 0:
        raise SolverError(f"{number(system.inductance_h)} H at rest is less than the washers' share of it")
    n = len(system.gap_m)
    by_voltage = source.kind == "voltage"
    if not by_voltage:
        current_a = float(source.wave(np.zeros(1))[0])
    first = at = _State(0.0, np.zeros(n), np.zeros(n), system.inductance_h * current_a, current_a)
    most = _stored(system, first, by_voltage)
    sampled = np.empty((2 * n + 1, len(times)))
    done = int(np.searchsorted(times, 0.0, "right"))
    count = 0
    sampled[:, :done] = np.append(np.zeros(2 * n), current_a)[:, None]
    energy = np.zeros(3)
    rule = radau(stages)
    for start, rows, z, faster, at in _steps(system, source, rule, first, float(times[-1]), tolerance, most_steps):
        length = at.time_s - start.time_s
        v = rows[:-1]
        current = rows[-1]
        upto = len(times) if at.time_s >= times[-1] else int(np.searchsorted(times, at.time_s, "right"))
        share = np.minimum((times[done:upto] - start.time_s) / length, 1.0)
        sampled[:n, done:upto] = start.z[:, None] + length * rule.integrated(v, share)
        sampled[n:-1, done:upto] = start.v[:, None] + length * rule.integrated(faster, share)
        sampled[-1, done:upto] = rule.values(current, share)
        copper = by_voltage * system.resistance_ohm * current**2
        supplied = source.wave(start.time_s + length * rule.points) * current
        if not by_voltage:
            supplied = current**2 / 2 * (system.slopes(z)[0] * v).sum(0)
        damping = (system.mass_kg * system.angular / system.q) @ v**2
        energy = energy + length * np.array([supplied, copper, damping]) @ rule.weights
        most = max(most, _stored(system, at, by_voltage))
        done = upto
        count = count + 1
    stored = _stored(system, at, by_voltage) - _stored(system, first, by_voltage)
    largest = max(np.abs(energy).max(), most)
    residual = abs(energy[0] - energy[1] - energy[2] - stored) / largest if largest else 0.0
    return CoupledMotion(sampled[:n], sampled[n:-1], sampled[-1], np.append(energy, stored), float(residual), count)


def _steps(
    system: CoupledSystem,
    source: Source,
    rule: Collocation,
    at: _State,
    end_s: float,
    tolerance: float,
    most_steps: int,
) -> Iterator[tuple[_State, np.ndarray, np.ndarray, np.ndarray, _State]]:
    """Yield each time step from `at` to `end_s`: its state at the start, values at the stages, state at the end.

    At the stages that is velocities and current (n + 1, s), displacements and accelerations (n, s).
    """
    circuit = system.resistance_ohm / system.inductance_h if source.kind == "voltage" else 0.0
    step = 0.1 / max(float(system.angular.max()), circuit)
    scales = np.zeros(len(at.z) + 1)
    tried = 0
    while at.time_s < end_s:
        length = min(step, end_s - at.time_s)
        if tried >= most_steps:
            raise SolverError(f"took {most_steps} steps up to {number(at.time_s)} s of {number(end_s)} s")
        if length < SMALLEST_STEP * end_s and length == step:
            raise SolverError(f"no step converges at {number(at.time_s)} s; a washer may be pulled onto the coil")
        tried += 1
        rows = _solved(system, source, rule, at, length, tolerance, scales)
        if rows is None:
            step = length / 4
            continue
        scales = np.maximum(scales, np.abs(rows).max(1))
        # The larger of the last two Legendre coefficients is what the polynomials leave out.
        left_out = _share(np.abs(rows @ rule.to_legendre[-2:].T).max(1), scales) / tolerance
        grown = max(left_out, 1e-12) ** (-1 / len(rule.points))
        if left_out > 1:
            step = length * max(0.2, 0.8 * grown)
            continue
        step = length * min(4.0, 0.9 * grown) if length == step else min(step, length * max(0.9 * grown, 1.0))
        start = at
        v = rows[:-1]
        current = float(rows[-1, -1])
        flux = start.flux
        z = start.z[:, None] + length * v @ rule.integrals.T
        faster = system.acceleration(z, v, rows[-1])
        end_z = start.z + length * v @ rule.weights
        if source.kind == "voltage":
            drop = source.wave(start.time_s + length * rule.points) - system.resistance_ohm * rows[-1]
            flux = start.flux + length * float(drop @ rule.weights)
            current = flux / float(system.inductance(end_z[:, None])[0])
        at = _State(start.time_s + length, end_z, start.v + length * faster @ rule.weights, flux, current)
        if end_s - start.time_s == length:
            at = at._replace(time_s=end_s)
        yield start, rows, z, faster, at
        near = at.z > NEAREST * system.gap_m
        if near.any():
            raise SolverError(
                f"taxel {int(near.argmax())} is pulled onto the coil at {number(at.time_s)} s: less than"
                f" {1 - NEAREST:.0%} of its gap is left"
            )


def scipy_motion(
    system: CoupledSystem, source: Source, time_s: np.ndarray, method: str = "DOP853", tolerance: float = 3e-14
) -> np.ndarray:
    """Return n displacements, n velocities and the current (2n + 1, k), solved by scipy from rest under a voltage."""
    from scipy.integrate import solve_ivp

    n = len(system.gap_m)
    damping = system.angular / system.q

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        z = y[:n, None]
        current = y[-1] / system.inductance(z)
        flux = source.wave(np.array([t])) - system.resistance_ohm * current
        pull = current**2 * system.slopes(z)[0][:, 0] / (2 * system.mass_kg)
        return np.concatenate([y[n:-1], pull - damping * y[n:-1] - system.angular**2 * y[:n], flux])

    scale = np.concatenate([system.gap_m, system.gap_m * system.angular, [1e-3]])
    span = (0.0, float(time_s[-1]))
    at_rest = np.zeros(2 * n + 1)
    motion = solve_ivp(rates, span, at_rest, method, time_s, rtol=tolerance, atol=1e-3 * tolerance * scale).y
    return np.concatenate([motion[:-1], [motion[-1] / system.inductance(motion[:n])]])


@lru_cache(maxsize=16)
def radau(stages: int) -> Collocation:
    """Return the Radau IIA collocation rule with `stages` points, the roots of ``P_s − P_(s−1)``."""
    at = np.sort(legendre.legroots(np.append(np.zeros(stages - 1), [-1, 1])))
    at[-1] = 1.0
    points = (at + 1) / 2
    to_legendre = np.linalg.inv(legendre.legvander(at, stages - 1))
    weights = _integrals(np.ones(1), stages)[0] @ to_legendre
    return Collocation(points, _integrals(points, stages) @ to_legendre, weights, to_legendre)


def _integrals(at: np.ndarray, count: int) -> np.ndarray:
    """Return integrals (k, count), from 0 to points `at` (k,), of the first `count` shifted Legendre polynomials."""
    values = legendre.legvander(2 * at - 1, count)
    return np.column_stack([at, (values[:, 2:] - values[:, :-2]) / (2 * (2 * np.arange(1, count) + 1))])


def _solved(
    system: CoupledSystem,
    source: Source,
    rule: Collocation,
    at: _State,
    length: float,
    tolerance: float,
    scales: np.ndarray,
) -> np.ndarray | None:
    """Return n velocities and the current (n + 1, s) at the s stages of a step; None if a shorter step is needed.

    Newton's method from a motion that goes on as it is. Driven by current, the last row is given.
    """
    drive = source.wave(at.time_s + length * rule.points)
    integrals = length * rule.integrals
    rows = np.tile(np.append(at.v, at.current)[:, None], len(drive))
    if source.kind == "current":
        rows[-1] = drive
    mass, angular, loss = (x[:, None] for x in (system.mass_kg, system.angular, system.angular / system.q))
    amps = np.zeros(len(drive))
    for _ in range(MOST_ITERATIONS):
        v = rows[:-1]
        current = rows[-1]
        z = at.z[:, None] + v @ integrals.T
        if (z >= TOO_NEAR * system.gap_m[:, None]).any():
            return None
        slope, bend = system.slopes(z)
        miss = v - at.v[:, None] - system.acceleration(z, v, current) @ integrals.T
        spring = (angular**2 - current**2 * bend / (2 * mass))[:, :, None]
        matrix = np.eye(len(drive)) + loss[:, :, None] * integrals + integrals @ (spring * integrals)
        push = (current * slope / mass)[:, None, :] * integrals
        solved = np.linalg.solve(matrix, np.concatenate([-miss[:, :, None], push], -1))
        if source.kind == "voltage":
            back = (current * slope)[:, :, None] * integrals
            coil = system.inductance(z)
            resistance = system.resistance_ohm
            off = coil * current - at.flux - (drive - resistance * current) @ integrals.T
            whole = np.diag(coil) + resistance * integrals + (back @ solved[:, :, 1:]).sum(0)
            amps = np.linalg.solve(whole, -off - (back @ solved[:, :, :1]).sum(0)[:, 0])
        more = np.vstack([solved[:, :, 0] + solved[:, :, 1:] @ amps, amps])
        rows = rows + more
        changed = _share(np.abs(more).max(1), np.abs(rows).max(1) + scales)
        if not np.isfinite(changed):
            return None
        if changed < max(1e-3 * tolerance, 1e-13):
            return rows
    return None


def _share(change: np.ndarray, size: np.ndarray) -> float:
    """Return the largest ratio of `change` (k,) to `size` (k,); a ratio is 0 where its size is 0."""
    return float(np.divide(change, size, out=np.zeros(len(size)), where=size > 0).max())


def _stored(system: CoupledSystem, at: _State, by_voltage: bool) -> float:
    """Return the energy in J stored in springs, masses and, where a voltage drives the coil, its magnetic field."""
    mechanical = float((system.mass_kg * (at.v**2 + (system.angular * at.z) ** 2)).sum() / 2)
    return mechanical + (at.flux**2 / (2 * float(system.inductance(at.z[:, None])[0])) if by_voltage else 0.0)
