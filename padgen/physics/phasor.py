"""Sums of damped tones: currents, their response in a circuit, their square, and the steady state of resonators.

Everything linear in padgen's time domain is a sum of damped tones ``A e^(−σt) cos(2π f t + φ)``: the current of a
driven R-L circuit with its transient, its square (paper Eq. 5), and thus the pull. `padgen.physics.propagation` moves
resonators under these sums exactly; this module has their steady state.
"""

from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number

__all__ = ["Tones", "circuit_current", "merged", "signal", "squared", "steady_lines", "tones", "turns"]

SPLITTER = 134217729.0
"""2^27 + 1, the factor that splits a double into two halves of its digits (Dekker 1971)."""


class Tones(NamedTuple):
    """``Σ_j amplitude_j e^(−decay_j t) cos(2π (frequency_j + rest_j) t + phase_j)``, arrays of shape (m,).

    `amplitude` may be (n, m), for n receivers. `rest_hz` is the rounding error of `frequency_hz`.
    """

    frequency_hz: np.ndarray
    amplitude: np.ndarray
    phase_rad: np.ndarray
    decay_per_s: np.ndarray
    rest_hz: np.ndarray


def tones(
    frequency_hz: object,
    amplitude: object,
    phase_rad: object = 0.0,
    decay_per_s: object = 0.0,
    rest_hz: object = 0.0,
) -> Tones:
    """Return `Tones` from values that broadcast to (m,); amplitudes may be (n, m).

    Raises
    ------
    SolverError
        A number is not finite, or a frequency or a decay is negative.
    """
    size = np.atleast_1d(np.asarray(amplitude, float))
    parts = (np.asarray(v, float) for v in (frequency_hz, phase_rad, decay_per_s, rest_hz))
    _, frequency, phase, decay, rest = np.broadcast_arrays(np.zeros(size.shape[-1]), *parts)
    size = np.broadcast_to(size, (*size.shape[:-1], len(frequency)))
    for name, values in (("frequencies", frequency), ("decays", decay)):
        if not (np.isfinite(values).all() and (values >= 0).all()):
            raise SolverError(f"the {name} of tones must be finite and at least 0, got {number(float(values.min()))}")
    if not all(np.isfinite(v).all() for v in (size, phase, rest)):
        raise SolverError("amplitudes and phases of tones must be finite")
    return Tones(frequency, size, phase, decay, rest)


def turns(frequency_hz: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return the cycles of a tone since its last whole period, in [−½, ½], of ``frequency × time``.

    The product is computed to 106 bits before whole periods are dropped, since 2π f t of a long time has no digits left
    otherwise.
    """
    product = frequency_hz * time_s
    (a, b), (c, d) = _halves(np.asarray(frequency_hz)), _halves(np.asarray(time_s))
    lost = ((a * c - product) + a * d + b * c) + b * d
    return np.asarray((product - np.rint(product)) + lost)


def signal(wave: Tones, time_s: np.ndarray) -> np.ndarray:
    """Return the values (k,) or (n, k) of a sum of tones at times (k,) in s."""
    at = np.asarray(time_s, float)
    cycles = turns(wave.frequency_hz[:, None], at) + wave.rest_hz[:, None] * at
    carrier = np.exp(-wave.decay_per_s[:, None] * at) * np.cos(2 * np.pi * cycles + wave.phase_rad[:, None])
    return np.asarray(wave.amplitude @ carrier)


def squared(wave: Tones) -> Tones:
    """Return the square of a sum of tones (m,), to which a coil's pull is proportional, as m(m + 1) tones.

    It has all lines, wanted or not: ``2 f_a``, ``f_a ± f_b`` and the constants (paper Eq. 5).
    """
    a, b = np.triu_indices(len(wave.frequency_hz))
    product = np.where(a == b, 0.5, 1.0) * wave.amplitude[a] * wave.amplitude[b]
    low, high = np.sort(wave.frequency_hz[[a, b]], axis=0)
    sign = np.where(wave.frequency_hz[a] >= wave.frequency_hz[b], 1.0, -1.0)
    total, difference = high + low, high - low
    rest = np.stack([low - (total - high), (high - difference) - low])
    rest[0] += wave.rest_hz[a] + wave.rest_hz[b]
    rest[1] += sign * (wave.rest_hz[a] - wave.rest_hz[b])
    phase = np.stack([wave.phase_rad[a] + wave.phase_rad[b], sign * (wave.phase_rad[a] - wave.phase_rad[b])])
    return Tones(
        np.concatenate([total, difference]),
        np.concatenate([product, product]),
        phase.ravel(),
        np.tile(wave.decay_per_s[a] + wave.decay_per_s[b], 2),
        rest.ravel(),
    )


def circuit_current(voltage: Tones, resistance: float, inductance: float, initial_a: float = 0.0) -> Tones:
    """Return the current in A of ``u = R i + L di/dt`` from `initial_a` at time 0.

    It has one tone for each of the voltage, and the transient. At times much shorter than L/R the tones cancel: they
    are exact to 1e-16 of the largest tone, not of their sum.

    Raises
    ------
    SolverError
        R or L is not positive, or the voltage has decaying tones.
    """
    if not (resistance > 0 and inductance > 0) or voltage.decay_per_s.any():
        raise SolverError(
            f"a circuit must have R and L above 0 and steady tones, got {number(resistance)} Ω, {number(inductance)} H"
        )
    angular = 2 * np.pi * (voltage.frequency_hz + voltage.rest_hz)
    size = voltage.amplitude / np.hypot(resistance, angular * inductance)
    phase = voltage.phase_rad - np.arctan2(angular * inductance, resistance)
    transient = initial_a - float((size * np.cos(phase)).sum())
    return Tones(
        np.append(voltage.frequency_hz, 0.0),
        np.append(size, transient),
        np.append(phase, 0.0),
        np.append(np.zeros(len(size)), resistance / inductance),
        np.append(voltage.rest_hz, 0.0),
    )


def merged(wave: Tones) -> Tones:
    """Add up the tones of one frequency and decay, lowest frequency first; `wave` has amplitudes (m,)."""
    key = np.stack([wave.frequency_hz, wave.rest_hz, wave.decay_per_s])
    unique, where = np.unique(key, axis=1, return_inverse=True)
    phasor = np.zeros(unique.shape[1], complex)
    np.add.at(phasor, where.ravel(), wave.amplitude * np.exp(1j * wave.phase_rad))
    still = (unique[0] == 0) & (unique[1] == 0)
    phasor[still] = phasor[still].real  # a tone of 0 Hz is the constant A cos φ
    return Tones(unique[0], np.abs(phasor), np.angle(phasor), unique[2], unique[1])


def steady_lines(
    frequency_hz: np.ndarray, q: np.ndarray | float, mass_kg: np.ndarray | float, force: Tones
) -> np.ndarray:
    """Return displacement phasors (n, m) in m of resonators (n,) under the steady tones (m,) of a `force` in N.

    The displacement is the real part of the phasors' sum, each turning with ``exp(2πj f t)``. Detuning is computed as
    ``(f_i − f)(f_i + f)`` with the tone's `rest_hz`, which keeps its digits at large Q.

    Raises
    ------
    SolverError
        A tone decays, or sits on a resonance without damping.
    """
    own, tone = np.atleast_1d(np.asarray(frequency_hz, float))[:, None], force.frequency_hz
    offset = (own - tone) - force.rest_hz
    quality, mass = (np.atleast_1d(np.asarray(v, float))[:, None] for v in (q, mass_kg))
    loss = tone * own / quality
    bracket = offset * (own + tone) + 1j * loss
    if force.decay_per_s.any() or (bracket == 0).any():
        raise SolverError("there is no steady state under a decaying tone, nor under one on an undamped resonance")
    return np.asarray(1 / (4 * np.pi**2 * mass * bracket) * force.amplitude * np.exp(1j * force.phase_rad))


def _halves(value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split each value into two halves of its digits, whose products are exact."""
    scaled = SPLITTER * value
    high = scaled - (scaled - value)
    return high, value - high
