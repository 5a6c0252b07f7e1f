"""One step of `padgen.verify.coupled`: the stages by Newton's method, a washer at a time.

The washers meet in the current alone. So each is eliminated first, a system of s unknowns of its own,
and what they leave is one system of s currents.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from padgen.verify.dynamics_collocation import Collocation
from padgen.verify.dynamics_model import CoupledSystem, Source

__all__ = ["NoStepError", "Scales", "Stages", "StepState", "acceleration", "solved_stages"]

MOST_ITERATIONS = 12
TOO_NEAR = 0.9999
"""Share of the gap from which a trial state is no use."""


@dataclass
class StepState:
    """Where a run is: state, what is on its stop (1 the coil's, -1 the other), sums of energy."""

    time_s: float
    z: np.ndarray
    v: np.ndarray
    flux: float
    current: float
    held: np.ndarray
    parts: np.ndarray


class Scales(NamedTuple):
    """The largest speeds (n,) and the largest current so far, which errors are taken of."""

    speed: np.ndarray
    amps: float


class Stages(NamedTuple):
    """A solved step: its start, length, and values at the stages: (n, s), current and drive (s,)."""

    start: StepState
    length: float
    z: np.ndarray
    v: np.ndarray
    change: np.ndarray
    current: np.ndarray
    drive: np.ndarray


class NoStepError(Exception):
    """This step does not converge, or leaves the gap; a shorter one may."""


class _Trial(NamedTuple):
    """What Newton works on: motion (n, s) and current (s,); `integrals` in s, `free` (n, 1) what is not held."""

    z: np.ndarray
    v: np.ndarray
    current: np.ndarray
    drive: np.ndarray
    integrals: np.ndarray
    free: np.ndarray


def solved_stages(
    system: CoupledSystem,
    source: Source,
    points: Collocation,
    state: StepState,
    length: float,
    tolerance: float,
    scales: Scales,
) -> Stages:
    """A step of `length` s from `state`: velocities and, driven by voltage, currents that satisfy the stages.

    Raises
    ------
    NoStepError
        Newton does not converge, or leads out of the gap.
    """
    drive, free = _drive(source, state.time_s + points.points * length), (state.held == 0)[:, None]
    by_voltage, goal = source.kind == "voltage", max(1e-3 * tolerance, 1e-13)
    current = np.full(len(drive), state.current) if by_voltage else drive
    v = np.where(free, np.broadcast_to(state.v[:, None], (len(state.v), len(drive))), 0.0)
    integrals = points.integrals * length
    for _ in range(MOST_ITERATIONS):
        z = state.z[:, None] + v @ integrals.T
        if (z >= TOO_NEAR * system.gap_m[:, None]).any():
            raise NoStepError
        trial = _Trial(z, v, current, drive, integrals, free)
        more_v, more_current = _newton_voltage(system, state, trial) if by_voltage else _newton(system, state, trial)
        v, current = v + more_v, current + more_current
        off = _relative(more_v, np.abs(v).max(1) + scales.speed)
        off = max(off, _relative(more_current[None], np.array([max(float(np.abs(current).max()), scales.amps)])))
        if not np.isfinite(off):
            raise NoStepError
        if off < goal:
            z = state.z[:, None] + v @ integrals.T
            return Stages(state, length, z, v, np.where(free, acceleration(system, z, v, current), 0.0), current, drive)
    raise NoStepError


def acceleration(system: CoupledSystem, z: np.ndarray, v: np.ndarray, current: np.ndarray) -> np.ndarray:
    """Accelerations (n, s) of washers that no stop holds."""
    angular = system.angular[:, None]
    pull = current**2 * system.slopes(z)[0] / (2 * system.mass_kg[:, None])
    result: np.ndarray = pull - angular**2 * z - angular / system.q[:, None] * v
    return result


def _drive(source: Source, at: np.ndarray) -> np.ndarray:
    """The drive at the stages; at a break, where the last one may be, what it is just before."""
    for end in source.breaks_s:
        at = np.where(np.abs(at - end) <= 4e-16 * end, np.nextafter(end, -np.inf), at)
    return np.asarray(source.wave(at), float)


def _relative(change: np.ndarray, size: np.ndarray) -> float:
    largest = np.abs(change).max(1)
    return float(np.divide(largest, size, out=np.zeros(len(size)), where=size > 0).max())


def _motion(system: CoupledSystem, state: StepState, trial: _Trial) -> tuple[np.ndarray, np.ndarray]:
    """Jacobians (n, s, s) of the washers by themselves, and by how much (n, s) they miss."""
    angular, mass = system.angular[:, None], system.mass_kg[:, None]
    change = np.where(trial.free, acceleration(system, trial.z, trial.v, trial.current), 0.0)
    miss = np.where(trial.free, trial.v - state.v[:, None] - change @ trial.integrals.T, 0.0)
    bend = system.slopes(trial.z)[1]
    stiffness = np.where(trial.free, angular**2 - trial.current**2 * bend / (2 * mass), 0.0)
    loss = np.where(trial.free, angular / system.q[:, None], 0.0)[:, :, None]
    inner = loss * trial.integrals + trial.integrals @ (stiffness[:, :, None] * trial.integrals)
    return np.eye(len(trial.current)) + inner, miss


def _newton(system: CoupledSystem, state: StepState, trial: _Trial) -> tuple[np.ndarray, np.ndarray]:
    """Changes of v (n, s), the current given."""
    matrix, miss = _motion(system, state, trial)
    return np.linalg.solve(matrix, -miss[:, :, None])[:, :, 0], np.zeros(len(trial.current))


def _newton_voltage(system: CoupledSystem, state: StepState, trial: _Trial) -> tuple[np.ndarray, np.ndarray]:
    """Changes of v (n, s) and i (s,): the washers' systems first, then what they leave for the current."""
    matrix, miss = _motion(system, state, trial)
    emf = trial.current * system.slopes(trial.z)[0] * trial.free
    onto = trial.integrals * (emf / system.mass_kg[:, None])[:, None, :]
    solved = np.linalg.solve(matrix, np.concatenate([-miss[:, :, None], onto], -1))
    back = emf[:, :, None] * trial.integrals
    circuit, resistance = system.inductance(trial.z), system.resistance_ohm
    off = circuit * trial.current - state.flux - (trial.drive - resistance * trial.current) @ trial.integrals.T
    whole = np.diag(circuit) + resistance * trial.integrals + (back @ solved[:, :, 1:]).sum(0)
    amps = np.linalg.solve(whole, -off - (back @ solved[:, :, :1]).sum(0)[:, 0])
    return solved[:, :, 0] + solved[:, :, 1:] @ amps, amps
