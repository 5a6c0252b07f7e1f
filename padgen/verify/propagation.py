"""Exact motion of resonators under sums of tones, at any time, in closed form.

A resonator with the poles s₁, s₂ that starts at rest moves under ``e^(at)`` by the divided difference of the
exponential over a and its poles,

    x(t) = exp(t·)[a, s₁, s₂],

for any damping, on resonance or off it. Three ways of computing it keep the digits (|·| of differences times t):

- a far from both poles: the steady state less the free motion from its initial state;
- a near one pole, the poles apart: ``(g(s₁) − g(s₂))/(s₁ − s₂)``, ``g(s) = e^(st) expm1((a − s)t)/(a − s)``, the latter
  by its power series;
- all three together (critical damping, early times): the power series of the divided difference.

Within a factor of two in time the choice is the same. Each way separates into sums over the tones and products with
functions of time, so that everything is matrix products. Displacements agree with 60-digit arithmetic to `STATED_ERROR`
of a resonator's largest (`tests/physics/test_dynamics.py`): Q from 1e-3 to infinity, on resonance, 1e-9 off it, 10 s at
200 kHz.

Everything linear in padgen's time domain is a sum of damped tones ``A e^(−σt) cos(2π f t + φ)``: the current of a
driven R-L circuit with its transient, its square (paper Eq. 5), and thus the pull.
"""

from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError

__all__ = [
    "STATED_ERROR",
    "DecayingTones",
    "circuit_current",
    "propagate",
    "signal",
    "squared",
    "steady_phasors",
    "tones",
    "turns",
]

SPLITTER = 134217729.0
"""2^27 + 1, the factor that splits a double into two halves of its digits (Dekker 1971)."""


class DecayingTones(NamedTuple):
    """A sum of tones (m,): ``Σ_j amplitude_j e^(−decay_j t) cos(2π (frequency_j + rest_j) t + phase_j)``.

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
) -> DecayingTones:
    """Return `DecayingTones` from values that broadcast to (m,); amplitudes may be (n, m)."""
    size = np.atleast_1d(np.asarray(amplitude, float))
    parts = (np.asarray(v, float) for v in (frequency_hz, phase_rad, decay_per_s))
    rest, frequency, phase, decay = np.broadcast_arrays(np.zeros(size.shape[-1]), *parts)
    return DecayingTones(frequency, np.broadcast_to(size, (*size.shape[:-1], len(frequency))), phase, decay, rest)


def turns(frequency_hz: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return frequency × time less the nearest whole number, in [−½, ½]: the phase of a tone in cycles.

    The product is computed to 106 bits before whole periods are dropped, since 2π f t of a long time has no digits left
    otherwise.
    """
    product = frequency_hz * time_s
    a, b = _halves(np.asarray(frequency_hz))
    c, d = _halves(np.asarray(time_s))
    lost = ((a * c - product) + a * d + b * c) + b * d
    return np.asarray((product - np.rint(product)) + lost)


def signal(wave: DecayingTones, time_s: np.ndarray) -> np.ndarray:
    """Return the values (k,) or (n, k) of a sum of tones at times (k,) in s."""
    at = np.asarray(time_s, float)
    cycles = turns(wave.frequency_hz[:, None], at) + wave.rest_hz[:, None] * at
    carrier = np.exp(-wave.decay_per_s[:, None] * at) * np.cos(2 * np.pi * cycles + wave.phase_rad[:, None])
    return np.asarray(wave.amplitude @ carrier)


def squared(wave: DecayingTones) -> DecayingTones:
    """Return the square of a sum of tones (m,), to which a coil's pull is proportional, as m(m + 1) tones.

    It has all lines, wanted or not: ``2 f_a``, ``f_a ± f_b`` and the constants (paper Eq. 5).
    """
    a, b = np.triu_indices(len(wave.frequency_hz))
    product = np.where(a == b, 0.5, 1.0) * wave.amplitude[a] * wave.amplitude[b]
    low, high = np.sort(wave.frequency_hz[[a, b]], axis=0)
    sign = np.where(wave.frequency_hz[a] >= wave.frequency_hz[b], 1.0, -1.0)
    total = high + low
    difference = high - low
    rest = np.stack([low - (total - high), (high - difference) - low])
    rest[0] += wave.rest_hz[a] + wave.rest_hz[b]
    rest[1] += sign * (wave.rest_hz[a] - wave.rest_hz[b])
    phase = np.stack([wave.phase_rad[a] + wave.phase_rad[b], sign * (wave.phase_rad[a] - wave.phase_rad[b])])
    return DecayingTones(
        np.concatenate([total, difference]),
        np.concatenate([product, product]),
        phase.ravel(),
        np.tile(wave.decay_per_s[a] + wave.decay_per_s[b], 2),
        rest.ravel(),
    )


def circuit_current(
    voltage: DecayingTones, resistance: float, inductance: float, initial_a: float = 0.0
) -> DecayingTones:
    """Return the current in A of ``u = R i + L di/dt`` from `initial_a` at time 0.

    It has one tone for each of the voltage, and the transient. At times much shorter than L/R the tones cancel: they
    are exact to 1e-16 of the largest tone, not of their sum.
    """
    angular = 2 * np.pi * (voltage.frequency_hz + voltage.rest_hz)
    size = voltage.amplitude / np.hypot(resistance, angular * inductance)
    phase = voltage.phase_rad - np.arctan2(angular * inductance, resistance)
    transient = initial_a - float((size * np.cos(phase)).sum())
    return DecayingTones(
        np.append(voltage.frequency_hz, 0.0),
        np.append(size, transient),
        np.append(phase, 0.0),
        np.append(np.zeros(len(size)), resistance / inductance),
        np.append(voltage.rest_hz, 0.0),
    )


def steady_phasors(
    frequency_hz: np.ndarray, q: np.ndarray | float, mass_kg: np.ndarray | float, force: DecayingTones
) -> np.ndarray:
    """Return displacement phasors (n, m) in m of resonators (n,) under the steady tones (m,) of a `force` in N.

    The displacement is the real part of the phasors' sum, each turning with ``exp(2πj f t)``. Detuning is computed as
    ``(f_i − f)(f_i + f)`` with the tone's `rest_hz`, which keeps its digits at large Q.

    Raises
    ------
    SolverError
        A tone decays, or sits on a resonance without damping.
    """
    resonance_hz = np.atleast_1d(np.asarray(frequency_hz, float))[:, None]
    tone = force.frequency_hz
    offset = (resonance_hz - tone) - force.rest_hz
    quality, mass = (np.atleast_1d(np.asarray(v, float))[:, None] for v in (q, mass_kg))
    loss = tone * resonance_hz / quality
    bracket = offset * (resonance_hz + tone) + 1j * loss
    if force.decay_per_s.any() or (bracket == 0).any():
        raise SolverError("there is no steady state under a decaying tone, nor under one on an undamped resonance")
    return np.asarray(1 / (4 * np.pi**2 * mass * bracket) * force.amplitude * np.exp(1j * force.phase_rad))


def _halves(value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split each value into two halves of its digits, whose products are exact."""
    scaled = SPLITTER * value
    high = scaled - (scaled - value)
    return high, value - high


STATED_ERROR = 1e-12
BLOCK = 1 << 21
"""Entries of an array computed at a time."""
SMALLEST_TERM = 1e-18
"""Relative size of the first term that a power series leaves out; its arguments are below 3."""
EXACT_Q = 10.0
"""Smallest Q for which whole periods are dropped exactly; a more damped vibration dies out before it matters."""


class _Poles(NamedTuple):
    """The poles s₁ and s₂ of resonators (n,).

    `alpha` is the decay rate in 1/s; `square` is ``((s₁ − s₂)/2)²`` and `root` the root of its size; `over` marks
    overdamped ones. The damped frequency, 0 where overdamped, is the sum of two doubles, `hz` and `rest_hz`; `slow` and
    `fast` are the decay rates of e^(s₁t) and e^(s₂t).
    """

    alpha: np.ndarray
    square: np.ndarray
    root: np.ndarray
    over: np.ndarray
    hz: np.ndarray
    rest_hz: np.ndarray
    slow: np.ndarray
    fast: np.ndarray


def propagate(
    frequency_hz: np.ndarray,
    q: np.ndarray | float,
    mass_kg: np.ndarray | float,
    force: DecayingTones,
    time_s: np.ndarray,
) -> np.ndarray:
    """Return the displacement (n, k) in m of resonators (n,), at rest at time 0, at times (k,) in s, in any order.

    `force` is in N; its amplitudes are (m,), the same for all, or (n, m). Q may be any number above 0 or infinity.
    Memory O(nk + nm); O(nmk) multiplications, in matrix products.
    """
    resonance_hz, quality, mass = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(v, float)) for v in (frequency_hz, q, mass_kg))
    )
    time = np.atleast_1d(np.asarray(time_s, float))
    poles = _poles(resonance_hz, quality)
    order = np.argsort(time, kind="stable")
    # The exponents a − s₁ and a − s₂ (n, m); frequencies are subtracted first, which keeps their digits.
    hz = poles.hz[:, None]
    rest_hz = poles.rest_hz[:, None]
    turning = [(force.frequency_hz + sign * hz) + (force.rest_hz + sign * rest_hz) for sign in (-1, 1)]
    first, second = (
        rate[:, None] - force.decay_per_s + 2j * np.pi * part
        for rate, part in zip((poles.slow, poles.fast), turning, strict=True)
    )
    phasor = force.amplitude / mass[:, None] * np.exp(1j * force.phase_rad)
    moved = np.empty((len(resonance_hz), len(time)))
    for part in _blocks(time[order], max(phasor.shape)):
        moved[:, order[part]] = _move(poles, (first, second), phasor, force, time[order[part]])
    return moved


def _blocks(time: np.ndarray, width: int) -> list[np.ndarray]:
    """Return indices of sorted times in blocks, within which times differ by less than a factor of two."""
    octave = np.where(time > 0, np.frexp(time)[1], -2000)
    most = max(BLOCK // width, 16)
    groups = np.split(np.arange(len(time)), np.flatnonzero(np.diff(octave)) + 1)
    return [group[k : k + most] for group in groups for k in range(0, len(group), most)]


def _poles(resonance_hz: np.ndarray, q: np.ndarray) -> _Poles:
    """Return the poles of damped resonators (n,), without cancellation: ``α² − ω² = ω² (1 − 2Q)(1 + 2Q)/4Q²``."""
    omega = 2 * np.pi * resonance_hz
    alpha = np.pi * resonance_hz / q
    half = 1 / (2 * q)
    finite = np.where(np.isfinite(q), q, 1.0)
    square = omega**2 * np.where(np.isfinite(q), (1 - 2 * finite) * half * ((1 + 2 * finite) * half), -1.0)
    root = np.sqrt(np.abs(square))
    over = square > 0
    exact = q >= EXACT_Q
    fast = np.where(over, alpha + root, alpha)
    share = np.minimum(half, 1.0) ** 2
    shortfall = resonance_hz * share / (1 + np.sqrt(1 - share))
    hz = np.where(over, 0.0, np.where(exact, resonance_hz, root / (2 * np.pi)))
    slow = np.divide(omega**2, fast, out=alpha.copy(), where=over)
    return _Poles(alpha, square, root, over, hz, np.where(exact, -shortfall, 0.0), slow, fast)


def _move(
    poles: _Poles, turns_by: tuple[np.ndarray, np.ndarray], phasor: np.ndarray, force: DecayingTones, time: np.ndarray
) -> np.ndarray:
    """Return the resonators' displacement (n, k) in m at times (k,) that differ by less than a factor of two.

    `turns_by` are the exponents ``a − s₁`` and ``a − s₂`` (n, m), `phasor` (n, m) is the force over the mass.
    """
    # Free motions (n, k): e^(s₁t), e^(s₂t), then the motions from a unit velocity and from a unit displacement.
    alpha, root, over, slow, fast = (v[:, None] for v in (poles.alpha, poles.root, poles.over, poles.slow, poles.fast))
    angle = 2 * np.pi * (turns(poles.hz[:, None], time) + poles.rest_hz[:, None] * time)
    modes = np.exp(-slow * time + 1j * angle), np.exp(-fast * time - 1j * angle)
    lone = np.where(root > 0, root, 1.0)
    fade = np.exp(-alpha * time)
    swing = np.where(root > 0, np.sin(angle) / lone, time) * fade
    push = np.where(over, np.exp(-slow * time) * -np.expm1(-2 * root * time) / (2 * lone), swing)
    keep = (modes[0] + modes[1]).real / 2 + alpha * push
    exponent = -force.decay_per_s + 2j * np.pi * (force.frequency_hz + force.rest_hz)
    first, second = turns_by
    near = np.minimum(np.abs(first), np.abs(second)) * time[0] < 1
    steady = np.divide(phasor, first * second, out=np.zeros(near.shape, complex), where=~near)
    moved = -keep * steady.real.sum(-1)[:, None] - push * (steady * exponent).real.sum(-1)[:, None]
    if near.any():
        which, tone = np.nonzero(near)
        pairs = phasor[near], exponent[tone], (first[near], second[near])
        moved, steady[near] = _with_near(moved, poles, which, *pairs, modes, time)
    cycles = turns(force.frequency_hz[:, None], time) + force.rest_hz[:, None] * time
    carrier = np.exp(-force.decay_per_s[:, None] * time + 2j * np.pi * cycles)
    return np.asarray(moved + steady.real @ carrier.real - steady.imag @ carrier.imag)


def _with_near(
    moved: np.ndarray,
    poles: _Poles,
    which: np.ndarray,
    phasor: np.ndarray,
    exponent: np.ndarray,
    detunings: tuple[np.ndarray, np.ndarray],
    modes: tuple[np.ndarray, np.ndarray],
    time: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return `moved` (n, k) plus the motion by p tones near a pole of their resonator, and their steady phasors (p,).

    A tone is near where it is close to a pole of its resonator; the phasors are (p,).

    `which` are the resonators, `detunings` the exponents ``a − s₁`` and ``a − s₂``.
    """
    count = len(moved)
    last = float(time[-1])
    gap = np.where(poles.over, 2 * poles.root, 2j * poles.root)[which]
    apart = np.abs(gap) * time[0] >= 1
    close = ~apart
    fade = np.exp(-poles.alpha[:, None] * time) * time**2
    at = time / last if last else time
    reach = (exponent + poles.alpha[which]) * last
    series = _series(reach[close], (poles.square * last**2)[which[close]], phasor[close], which[close], count)
    moved = moved + fade * _polynomial(series.real, at)
    steady = np.zeros(phasor.shape, complex)
    for sign, turn, mode in zip((1, -1), detunings, modes, strict=True):
        slow = apart & (np.abs(turn) * time[0] < 1)
        quick = apart & (np.abs(turn) * time[0] >= 1)
        shares = sign * np.divide(phasor, gap, out=np.zeros(phasor.shape, complex), where=apart)
        plain = np.divide(shares, turn, out=np.zeros(phasor.shape, complex), where=quick)
        steady += plain
        grown = _growth(turn[slow] * last, shares[slow], which[slow], count)
        moved = moved + (mode * (time * _polynomial(grown, at) - _sums(plain, which, count)[:, None])).real
    return moved, steady


def _sums(values: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Return for each of `count` resonators the sum of the `values` (p,) whose index in `which` (p,) is its."""
    return np.bincount(which, values.real, count) + 1j * np.bincount(which, values.imag, count)


def _growth(turn: np.ndarray, weights: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Return power series coefficients (n, terms) in τ of ``Σ weight expm1(zτ)/(zτ)``, with z = `turn` (p,)."""
    sums = [_sums(weights, which, count)]
    term = weights
    k = 1
    size = 1.0
    largest = float(np.abs(turn).max(initial=0.0))
    while size > SMALLEST_TERM and largest:
        k += 1
        term = term * (turn / k)
        size *= largest / k
        sums.append(_sums(term, which, count))
    return np.stack(sums, -1)


def _series(reach: np.ndarray, square: np.ndarray, weights: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Return coefficients (n, terms) of Σ weight × divided difference of exp over `reach` and ± the root of `square`.

    It is ``Σ h_k/(k+2)!`` with the complete homogeneous sums h_k of the three.
    """
    sums = [_sums(weights, which, count) / 2]
    power = np.ones(len(reach))
    k = 0
    scale = 0.5
    term = np.ones(len(reach), complex)
    largest = float(np.abs(reach).max(initial=0.0)) + 1
    size = 1.0
    while len(reach) and size > SMALLEST_TERM:
        k += 1
        scale /= k + 2
        term = reach * term
        if k % 2 == 0:
            power = power * square
            term += power
        size = scale * largest**k
        sums.append(_sums(weights * (term * scale), which, count))
    return np.stack(sums, -1)


def _polynomial(coefficients: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return values (…, n, k) of polynomials (…, n, terms), lowest power first, at points (k,) in [0, 1]."""
    return np.asarray(coefficients @ at ** np.arange(coefficients.shape[-1])[:, None])
