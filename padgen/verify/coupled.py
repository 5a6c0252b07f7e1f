"""Coil, circuit and washers in time, as they act on each other: the finest rung of dynamics.

Radau IIA with full Newton and steps that follow the solution. Chosen on evidence
(docs/dynamics.md): with 20 stages it was cheaper at every error than the implicit midpoint rule,
splitting with the exact propagator, and scipy's Radau, LSODA and DOP853, and an R-L time constant of
a microsecond costs it nothing. Per step each washer is a small system of its own that meets the
others in the current alone, so Newton costs O(n s³).

Contacts are events: the step ends on the stop, the washer leaves with its restitution or, too slow,
is held until the pull lets go. A stiff spring for a stop is cheap too, but errs by its compression.
"""

from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.verify.dynamics_collocation import Collocation, collocation
from padgen.verify.dynamics_model import CoupledSystem, EnergyBalance, Source
from padgen.verify.dynamics_newton import NoStepError, Scales, Stages, StepState, acceleration, solved_stages

__all__ = ["Contact", "CoupledMotion", "simulate"]

MOST_CONTACTS = 1000
"""Contacts that are kept; more are counted."""
SMALLEST_STEP = 1e-13
"""Of the time that is simulated."""
NEAREST = 0.99
"""Share of the gap at which a washer without a stop counts as pulled in."""
SLOW = 1e-3
"""Speed of an impact, over that of a vibration as large as the gap, below which a washer does not leave again."""


class Contact(NamedTuple):
    """A washer meets a stop: when, which, whether the coil's (else the one behind), how fast, whether it stays."""

    time_s: float
    taxel: int
    at_coil: bool
    speed_m_per_s: float
    stays: bool


class CoupledMotion(NamedTuple):
    """The motion at the times asked for, (n, k), the current (k,), and what happened on the way.

    `held` (n,) are the washers that lie on the coil at the end: pulled in.
    """

    displacement_m: np.ndarray
    velocity_m_per_s: np.ndarray
    current_a: np.ndarray
    contacts: tuple[Contact, ...]
    contact_count: int
    held: np.ndarray
    energy: EnergyBalance
    steps: int
    rejected: int


def simulate(
    system: CoupledSystem,
    source: Source,
    time_s: np.ndarray,
    displacement_m: np.ndarray | float = 0.0,
    velocity_m_per_s: np.ndarray | float = 0.0,
    current_a: float = 0.0,
    tolerance: float = 1e-8,
    stages: int = 20,
    rule: str = "radau",
    step_s: float | None = None,
    most_steps: int = 500_000,
) -> CoupledMotion:
    """Motion at rising times (k,) from a state at t = 0; only what is asked for is kept.

    `tolerance` is the share of a step's solution that its polynomials may leave out; ends of steps are
    far better. `rule` 'gauss' and a fixed `step_s` are there to compare methods.

    Raises
    ------
    SolverError
        No step converges, there are more than `most_steps`, or a washer without a stop is pulled onto
        the coil (the message says which and when).
    """
    times = np.atleast_1d(np.asarray(time_s, float))
    if not np.isfinite(times).all() or (np.diff(times) < 0).any() or (len(times) and times[0] < 0):
        raise SolverError("times must be finite, at least 0 and rising")
    if source.kind == "voltage" and not system.inductance(-system.gap_m) > 0:
        raise SolverError(f"{number(system.inductance_h)} H at rest is less than the washers' share of it")
    points = collocation("gauss" if rule == "gauss" else "radau", stages)
    run = _Run(system, source, points, tolerance, float(times[-1]), most_steps, step_s)
    return run.through(times, _start(system, displacement_m, velocity_m_per_s, current_a))


def _start(system: CoupledSystem, z: np.ndarray | float, v: np.ndarray | float, current: float) -> StepState:
    shape = system.frequency_hz.shape
    at, speed = (np.broadcast_to(np.asarray(value, float), shape).copy() for value in (z, v))
    if (at > np.minimum(system.stop_m, NEAREST * system.gap_m)).any() or (at < -system.back_stop_m).any():
        raise SolverError("the initial state must be between the stops")
    return StepState(0.0, at, speed, current * float(system.inductance(at)), current, np.zeros(shape, int), np.zeros(4))


class _Run:
    """One simulation: the step's length, the scales of what moves, and counts."""

    def __init__(
        self,
        system: CoupledSystem,
        source: Source,
        points: Collocation,
        tolerance: float,
        end_s: float,
        most_steps: int,
        step_s: float | None,
    ) -> None:
        self.system, self.source, self.points, self.tolerance = system, source, points, tolerance
        self.end_s, self.most_steps, self.fixed = end_s, most_steps, step_s is not None
        circuit = system.inductance_h / system.resistance_ohm if system.resistance_ohm > 0 else np.inf
        shortest = min(1 / float(system.angular.max()), circuit if source.kind == "voltage" else np.inf)
        self.step_s = step_s if step_s is not None else min(shortest / 10, end_s or 1.0)
        self.stops_at = np.array(sorted({b for b in source.breaks_s if 0 < b < end_s} | {end_s}))
        self.scales = Scales(np.zeros(len(system.frequency_hz)), 0.0)
        self.steps = self.rejected = self.contact_count = 0
        self.most_stored = 0.0
        self.contacts: list[Contact] = []

    def through(self, times: np.ndarray, state: StepState) -> CoupledMotion:
        n = len(state.z)
        sampled, done = np.empty((2 * n + 1, len(times))), int(np.searchsorted(times, 0.0, "right"))
        if self.source.kind == "current":
            state.current = float(self.source.wave(np.zeros(1))[0])
        sampled[:, :done] = np.concatenate([state.z, state.v, [state.current]])[:, None]
        before = self.most_stored = self._stored(state)
        while state.time_s < self.end_s:
            stages = self._accepted(state)
            stages, event = self._cut_at_event(stages)
            state = self._advanced(stages)
            self.most_stored = max(self.most_stored, self._stored(state))
            upto = len(times) if state.time_s >= self.end_s else int(np.searchsorted(times, state.time_s, "right"))
            sampled[:, done:upto] = self._sampled(stages, times[done:upto])
            done = upto
            if event is not None:
                self._meet(state, event)
            self._refuse_pull_in(state)
        return CoupledMotion(
            sampled[:n],
            sampled[n : 2 * n],
            sampled[-1],
            tuple(self.contacts),
            self.contact_count,
            state.held > 0,
            self._balance(state, before),
            self.steps,
            self.rejected,
        )

    def _accepted(self, state: StepState) -> Stages:
        """A step from `state` that converges and resolves what happens in it."""
        limit = float(self.stops_at[np.searchsorted(self.stops_at, state.time_s, "right")]) - state.time_s
        while True:
            if self.steps >= self.most_steps:
                raise SolverError(
                    f"took {self.most_steps} steps up to {number(state.time_s)} s of {number(self.end_s)} s"
                )
            length = min(self.step_s, limit)
            if length < SMALLEST_STEP * self.end_s and length < limit:
                raise SolverError(
                    f"no step converges at {number(state.time_s)} s; a washer may be pulled onto the coil"
                )
            try:
                stages = self._solved(state, length)
            except NoStepError:
                self._shorten(length / 4)
                continue
            error = self._error(stages)
            if error <= 1 or self.fixed:
                if not self.fixed and length == self.step_s:
                    self.step_s = length * min(4.0, 0.9 * max(error, 1e-12) ** (-1 / len(self.points.points)))
                elif not self.fixed:
                    shorter = 0.9 * max(error, 1e-12) ** (-1 / len(self.points.points)) * length
                    self.step_s = min(self.step_s, max(shorter, length))
                self.steps += 1
                return stages
            self._shorten(length * max(0.2, 0.8 * error ** (-1 / len(self.points.points))))

    def _shorten(self, length: float) -> None:
        if self.fixed:
            raise SolverError(f"a fixed step of {number(self.step_s)} s does not converge")
        self.step_s = length
        self.rejected += 1

    def _error(self, stages: Stages) -> float:
        """What the step's polynomials leave out, over the tolerance."""
        speed = np.maximum(self.scales.speed, np.abs(stages.v).max(1))
        self.scales = Scales(speed, max(self.scales.amps, float(np.abs(stages.current).max())))
        share = np.divide(self.points.tail(stages.v), speed, out=np.zeros(len(speed)), where=speed > 0)
        ripple = float(self.points.tail(stages.current)) / self.scales.amps if self.scales.amps > 0 else 0.0
        return max(float(share.max()), ripple) / self.tolerance

    def _solved(self, state: StepState, length: float) -> Stages:
        return solved_stages(self.system, self.source, self.points, state, length, self.tolerance, self.scales)

    def _advanced(self, stages: Stages) -> StepState:
        """The state at the end of a step, with what it cost."""
        start, length, weights = stages.start, stages.length, self.points.weights
        system, by_voltage = self.system, self.source.kind == "voltage"
        loss = (system.mass_kg * system.angular / system.q) @ stages.v**2
        if by_voltage:
            supplied, copper = stages.drive * stages.current, system.resistance_ohm * stages.current**2
        else:
            supplied = stages.current**2 / 2 * (system.slopes(stages.z)[0] * stages.v).sum(0)
            copper = 0 * supplied
        parts = start.parts + length * np.array([supplied @ weights, copper @ weights, loss @ weights, 0.0])
        z = start.z + length * stages.v @ weights
        end = start.time_s + length
        ends = self.stops_at[np.abs(self.stops_at - end) <= 4e-16 * self.end_s]
        flux, current = start.flux, float(self.points.values(stages.current, np.ones(1))[0])
        if by_voltage:
            flux = start.flux + length * float((stages.drive - system.resistance_ohm * stages.current) @ weights)
            current = flux / float(system.inductance(z))
        v = start.v + length * stages.change @ weights
        return StepState(float(ends[0]) if len(ends) else end, z, v, flux, current, start.held.copy(), parts)

    def _sampled(self, stages: Stages, times: np.ndarray) -> np.ndarray:
        """Displacements, velocities and current (2n + 1, k) within a step."""
        at = np.minimum((times - stages.start.time_s) / stages.length, 1.0)
        z = stages.start.z[:, None] + stages.length * self.points.integrated(stages.v, at)
        v = stages.start.v[:, None] + stages.length * self.points.integrated(stages.change, at)
        return np.concatenate([z, v, self.points.values(stages.current, at)[None]])

    def _cut_at_event(self, stages: Stages) -> tuple[Stages, tuple[int, int] | None]:
        """The step, ended where the first washer meets a stop or is let go: (taxel, side) or (taxel, 0)."""
        system, state = self.system, stages.start
        if not (np.isfinite(system.stop_m).any() or np.isfinite(system.back_stop_m).any()):
            return stages, None
        grid = np.linspace(0, 1, 4 * len(self.points.points) + 1)[1:]
        first, found = 1.0, None
        for taxel, side in self._watched():
            over = self._over(stages, taxel, side, grid)
            if over is None or not (over > 0).any():
                continue
            k = int(np.argmax(over > 0))
            low, high = (float(grid[k - 1]) if k else 0.0), float(grid[k])
            for _ in range(52):
                middle = (low + high) / 2
                past = self._over(stages, taxel, side, np.array([middle]))
                low, high = (low, middle) if past is not None and past[0] > 0 else (middle, high)
            if high < first or found is None:
                first, found = high, (taxel, side if state.held[taxel] == 0 else 0)
        if found is None:
            return stages, None
        length = max(first * stages.length, 4e-16 * max(state.time_s, stages.length))
        return self._solved(state, length), found

    def _watched(self) -> list[tuple[int, int]]:
        stops = ((1, self.system.stop_m), (-1, self.system.back_stop_m))
        return [(taxel, side) for side, at in stops for taxel in np.flatnonzero(np.isfinite(at)).tolist()]

    def _over(self, stages: Stages, taxel: int, side: int, at: np.ndarray) -> np.ndarray | None:
        """Positive where a free washer is beyond its stop, or where a held one is no longer pressed to it."""
        system, held = self.system, int(stages.start.held[taxel])
        if held not in (0, side):
            return None
        if held:
            press = side * acceleration(system, stages.z, stages.v, stages.current)[taxel]
            scale = system.angular[taxel] ** 2 * system.gap_m[taxel]
            return np.asarray(-self.points.values(press, at) - 1e-12 * scale)
        limit = system.stop_m[taxel] if side > 0 else system.back_stop_m[taxel]
        z = stages.start.z[taxel] + stages.length * self.points.integrated(stages.v[taxel], at)
        return np.asarray(side * z - limit - 1e-12 * system.gap_m[taxel])

    def _meet(self, state: StepState, event: tuple[int, int]) -> None:
        """Turn the washer round, hold it, or let it go; the shape of the motion changes, so the next step is short."""
        system, (taxel, side) = self.system, event
        self.step_s = self.step_s if self.fixed else min(self.step_s, 0.1 / float(system.angular[taxel]))
        if side == 0:
            state.held[taxel] = 0
            return
        speed, before = abs(float(state.v[taxel])), self._stored(state)
        state.z[taxel] = side * (system.stop_m if side > 0 else system.back_stop_m)[taxel]
        stays = speed * max(system.restitution, SLOW) <= SLOW * system.angular[taxel] * system.gap_m[taxel]
        stays = stays or system.restitution == 0
        state.v[taxel] = 0.0 if stays else -side * system.restitution * speed
        moment = state.z[:, None], state.v[:, None], np.array([state.current])
        push = side * acceleration(system, *moment)[taxel, 0]
        state.held[taxel] = side if stays and push > 0 else 0
        state.parts[3] += before - self._stored(state)
        self.contact_count += 1
        if len(self.contacts) < MOST_CONTACTS:
            self.contacts.append(Contact(state.time_s, taxel, side > 0, speed, bool(state.held[taxel])))

    def _refuse_pull_in(self, state: StepState) -> None:
        near = (state.z > NEAREST * self.system.gap_m) & ~np.isfinite(self.system.stop_m)
        if near.any():
            raise SolverError(
                f"taxel {int(near.argmax())} is pulled onto the coil at {number(state.time_s)} s: less than"
                f" {1 - NEAREST:.0%} of its gap is left; a stop would let it be followed"
            )

    def _stored(self, state: StepState) -> float:
        return self.system.stored_j(state.z, state.v, state.flux if self.source.kind == "voltage" else None)

    def _balance(self, state: StepState, before: float) -> EnergyBalance:
        supplied, copper, damping, impact = (float(part) for part in state.parts)
        stored = self._stored(state) - before
        largest = max(abs(supplied), copper, damping, self.most_stored)
        miss = supplied - copper - damping - impact - stored
        return EnergyBalance(supplied, copper, damping, impact, stored, abs(miss) / largest if largest else 0.0)
