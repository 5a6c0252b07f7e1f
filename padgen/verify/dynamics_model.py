"""One coil and the washers over it: the equations that `padgen.verify.coupled` integrates.

A washer pulled by ``c i² (g/(g − z))^m`` (z towards the coil, m its pull exponent) is half the slope
of an inductance, so that motion and circuit exchange energy without loss:

    λ = L(z) i,    u = R i + dλ/dt,    L(z) = L₀ + Σ 2 c g ((1 − z/g)^(1−m) − 1)/(m − 1)
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.physics.phasor import Tones, signal

__all__ = ["CoupledSystem", "EnergyBalance", "Source", "coupled_rates", "from_tones", "make_system"]


@dataclass(frozen=True)
class CoupledSystem:
    """Resonators over one coil, arrays (n,) in SI units; `make_system` checks and broadcasts.

    `pull_n_per_a2` is c at rest, `inductance_h` of the whole coil at rest. A washer meets the coil's
    face at `stop_m` and a stop behind it at ``-back_stop_m`` (infinite: there is none), and leaves them
    with `restitution` of its speed. Without `stop_m` one that comes near the coil is an error.
    """

    frequency_hz: np.ndarray
    q: np.ndarray
    mass_kg: np.ndarray
    pull_n_per_a2: np.ndarray
    exponent: np.ndarray
    gap_m: np.ndarray
    resistance_ohm: float
    inductance_h: float
    stop_m: np.ndarray
    back_stop_m: np.ndarray
    restitution: float = 0.3

    @property
    def angular(self) -> np.ndarray:
        """Natural frequency (n,) in 1/s."""
        return 2 * np.pi * self.frequency_hz

    def closeness(self, z_m: np.ndarray) -> np.ndarray:
        """``g/(g − z)`` (n, …), 1 at rest."""
        return np.asarray(1 / (1 - z_m / _column(self.gap_m, z_m)))

    def slopes(self, z_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """dL/dz in H/m and d²L/dz² in H/m² (n, …): twice the pull per A² and its own slope."""
        m, near = _column(self.exponent, z_m), self.closeness(z_m)
        slope = 2 * _column(self.pull_n_per_a2, z_m) * near**m
        return slope, slope * near * m / _column(self.gap_m, z_m)

    def inductance(self, z_m: np.ndarray) -> np.ndarray:
        """L in H (…) of washers at z (n, …)."""
        m1 = _column(self.exponent, z_m) - 1
        log = -np.log1p(-z_m / _column(self.gap_m, z_m))
        grown = np.where(m1 == 0, log, np.expm1(m1 * log) / np.where(m1 == 0, 1, m1))
        scale = 2 * self.pull_n_per_a2 * self.gap_m
        return np.asarray(self.inductance_h + (_column(scale, z_m) * grown).sum(0))

    def stored_j(self, z_m: np.ndarray, v_m_per_s: np.ndarray, flux_wb: float | None) -> float:
        """Energy in J of springs and masses (n,), and of the field for a flux."""
        mechanical = (self.mass_kg * (v_m_per_s**2 + (self.angular * z_m) ** 2)).sum() / 2
        return float(mechanical + (0.0 if flux_wb is None else flux_wb**2 / (2 * self.inductance(z_m))))


class Source(NamedTuple):
    """What drives the coil: a 'voltage' in V or a 'current' in A as a function of times (k,) in s.

    `breaks_s` are the times at which it jumps or has a corner; no step goes across them.
    """

    kind: Literal["voltage", "current"]
    wave: Callable[[np.ndarray], np.ndarray]
    breaks_s: tuple[float, ...] = ()


class EnergyBalance(NamedTuple):
    """Where the energy went, in J: of the source (driven by current: of the pull), and the mismatch.

    `residual` is what does not add up over the largest of the parts.
    """

    supplied_j: float
    copper_j: float
    damping_j: float
    impact_j: float
    stored_j: float
    residual: float


def make_system(
    frequency_hz: object,
    q: object,
    mass_kg: object,
    pull_n_per_a2: object,
    exponent: object,
    gap_m: object,
    resistance_ohm: float = 0.0,
    inductance_h: float = 1.0,
    stop_m: object = np.inf,
    back_stop_m: object = np.inf,
    restitution: float = 0.3,
) -> CoupledSystem:
    """A `CoupledSystem` of arrays or numbers.

    Raises
    ------
    SolverError
        A number is out of its bounds: frequency, Q, mass, gap, L above 0; pull, exponent, R at least 0;
        restitution within 0 … 1; stops above 0 and short of the coil.
    """
    given = (frequency_hz, q, mass_kg, pull_n_per_a2, exponent, gap_m, stop_m, back_stop_m)
    values = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in given))
    own, quality, mass, pull, power, gap, stop, back = (v.copy() for v in values)
    _refuse(
        "frequencies, Q, masses, gaps and L", min(v.min() for v in (own, quality, mass, gap, inductance_h + 0 * gap))
    )
    _refuse("pulls, exponents and R", min(pull.min(), power.min(), resistance_ohm), strict=False)
    _refuse("stops", min(stop.min(), back.min()))
    if not 0 <= restitution <= 1:
        raise SolverError(f"the restitution must be within 0 … 1, got {number(restitution)}")
    if (np.isfinite(stop) & (stop >= gap)).any():
        raise SolverError(f"a stop must be short of the gap of {number(float(gap.min()))} m; 99 % of it would do")
    return CoupledSystem(own, quality, mass, pull, power, gap, resistance_ohm, inductance_h, stop, back, restitution)


def from_tones(kind: Literal["voltage", "current"], wave: Tones) -> Source:
    """A source that is a sum of tones."""
    return Source(kind, lambda time_s: signal(wave, time_s))


def coupled_rates(system: CoupledSystem, source: Source) -> Callable[[float, np.ndarray], np.ndarray]:
    """The equations without stops as ``f(t, y)`` for a general solver: y = (z, v, λ), without λ driven by current."""
    n, damping = len(system.frequency_hz), system.angular / system.q

    def rates(time_s: float, y: np.ndarray) -> np.ndarray:
        z, v = y[:n], y[n : 2 * n]
        value = float(source.wave(np.array([time_s]))[0])
        current = value if source.kind == "current" else y[-1] / float(system.inductance(z))
        pull = current**2 * system.slopes(z)[0] / 2
        change = pull / system.mass_kg - damping * v - system.angular**2 * z
        flux = [] if source.kind == "current" else [value - system.resistance_ohm * current]
        return np.concatenate([v, change, flux])

    return rates


def _column(values: np.ndarray, like: np.ndarray) -> np.ndarray:
    return values.reshape(-1, *([1] * (like.ndim - 1)))


def _refuse(what: str, least: float, strict: bool = True) -> None:
    if not (least > 0 if strict else least >= 0):
        raise SolverError(f"{what} must be {'above' if strict else 'at least'} 0, got {number(float(least))}")
