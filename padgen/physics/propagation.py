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
of a resonator's largest (`tests/test_dynamics.py`): Q from 1e-3 to infinity, on resonance, 1e-9 off it, 10 s at 200
kHz.
"""

from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.physics.phasor import Tones, turns

__all__ = ["STATED_ERROR", "propagate"]

STATED_ERROR = 1e-12
BLOCK = 1 << 21
"""Entries of an array computed at a time."""
SMALLEST_TERM = 1e-18
"""Relative size of the first term that a power series leaves out; its arguments are below 3."""
EXACT_Q = 10.0
"""Smallest Q for which whole periods are dropped exactly; a more damped vibration dies out before it matters."""


class _Poles(NamedTuple):
    """Resonators (n,).

    `alpha` is the decay rate in 1/s; `square` is ``((s₁ − s₂)/2)²`` and `root` the root of its size; `over` marks
    overdamped ones. The damped frequency is the sum of two doubles, `cycles_hz` and `cycles_rest_hz`; `slow` and `fast`
    are the decay rates of overdamped resonators.
    """

    alpha: np.ndarray
    square: np.ndarray
    root: np.ndarray
    over: np.ndarray
    cycles_hz: np.ndarray
    cycles_rest_hz: np.ndarray
    slow: np.ndarray
    fast: np.ndarray


class _Driven(NamedTuple):
    """Tones on resonators, (n, m).

    The exponents a (m,), ``a − s₁`` and ``a − s₂``, the smaller of their sizes, and the force over mass as a phasor.
    """

    exponent: np.ndarray
    first: np.ndarray
    second: np.ndarray
    nearest: np.ndarray
    phasor: np.ndarray


class _Free(NamedTuple):
    """Free motions (n, k): e^(s₁t), e^(s₂t), the motion from a unit velocity and from a unit displacement."""

    first: np.ndarray
    second: np.ndarray
    push: np.ndarray
    keep: np.ndarray


def propagate(
    frequency_hz: np.ndarray,
    q: np.ndarray | float,
    mass_kg: np.ndarray | float,
    force: Tones,
    time_s: np.ndarray,
) -> np.ndarray:
    """Return the displacement (n, k) in m of resonators (n,), at rest at time 0, at times (k,) in s, in any order.

    `force` is in N; its amplitudes are (m,), the same for all, or (n, m). Q may be any number above 0 or infinity.
    Memory O(nk + nm); O(nmk) multiplications, in matrix products.

    Raises
    ------
    SolverError
        Frequency, Q or mass not above 0, or a time below 0 or not finite.
    """
    own, quality, mass = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in (frequency_hz, q, mass_kg)))
    time = np.atleast_1d(np.asarray(time_s, float))
    for name, values in (("frequency", own), ("Q", quality), ("mass", mass)):
        if not (values > 0).all() or (name != "Q" and not np.isfinite(values).all()):
            raise SolverError(f"the {name} of a resonator must be above 0, got {number(float(values.min()))}")
    if not (np.isfinite(time) & (time >= 0)).all():
        raise SolverError(f"times must be finite and at least 0 s, got {number(float(time.min()))} s")
    poles = _poles(own, quality)
    driven = _driven(poles, force, mass)
    order = np.argsort(time, kind="stable")
    moved = np.empty((len(own), len(time)))
    for part in _blocks(time[order], max(driven.phasor.shape)):
        moved[:, order[part]] = _move(poles, driven, force, time[order[part]])
    return moved


def _blocks(time: np.ndarray, width: int) -> list[np.ndarray]:
    """Return indices of sorted times in blocks, each at most as long as the time before it."""
    octave = np.where(time > 0, np.frexp(time)[1], -2000)
    most = max(BLOCK // width, 16)
    groups = np.split(np.arange(len(time)), np.flatnonzero(np.diff(octave)) + 1)
    return [group[k : k + most] for group in groups for k in range(0, len(group), most)]


def _poles(own: np.ndarray, q: np.ndarray) -> _Poles:
    """Return the poles without cancellation: ``α² − ω² = ω² (1 − 2Q)(1 + 2Q)/4Q²``."""
    omega, alpha = 2 * np.pi * own, np.pi * own / q
    half = 1 / (2 * q)
    finite = np.where(np.isfinite(q), q, 1.0)
    square = omega**2 * np.where(np.isfinite(q), (1 - 2 * finite) * half * ((1 + 2 * finite) * half), -1.0)
    root = np.sqrt(np.abs(square))
    over = square > 0
    fast = np.where(over, alpha + root, 1.0)
    share = np.minimum(half, 1.0) ** 2
    shortfall = own * share / (1 + np.sqrt(1 - share))
    exact = q >= EXACT_Q
    return _Poles(
        alpha=alpha,
        square=square,
        root=root,
        over=over,
        cycles_hz=np.where(exact, own, root / (2 * np.pi)),
        cycles_rest_hz=np.where(exact, -shortfall, 0.0),
        slow=np.where(over, omega**2 / fast, 0.0),
        fast=fast,
    )


def _free(poles: _Poles, time: np.ndarray) -> _Free:
    """Return the free motions at times (k,)."""
    alpha, root, over = poles.alpha[:, None], poles.root[:, None], poles.over[:, None]
    cycles = turns(poles.cycles_hz[:, None], time) + poles.cycles_rest_hz[:, None] * time
    angle, fade = 2 * np.pi * np.where(over, 0.0, cycles), np.exp(-alpha * time)
    crawl, dash = np.exp(-poles.slow[:, None] * time), np.exp(-poles.fast[:, None] * time)
    lone = np.where(root > 0, root, 1.0)
    swing = np.where(root > 0, np.sin(angle) / lone, time) * fade
    push = np.where(over, crawl * -np.expm1(-2 * root * time) / (2 * lone), swing)
    middle = np.where(over, (crawl + dash) / 2, np.cos(angle) * fade)
    first = np.where(over, crawl, fade * np.exp(1j * angle))
    return _Free(first, np.where(over, dash, first.conj()), push, middle + alpha * push)


def _driven(poles: _Poles, force: Tones, mass: np.ndarray) -> _Driven:
    """Return detunings and initial phasors; frequencies are subtracted first, which keeps their digits."""
    hz, rest_hz, over = poles.cycles_hz[:, None], poles.cycles_rest_hz[:, None], poles.over[:, None]
    alpha, slow, fast = (rate[:, None] for rate in (poles.alpha, poles.slow, poles.fast))
    own_hz = force.frequency_hz + force.rest_hz
    below = np.where(over, own_hz, (force.frequency_hz - hz) + (force.rest_hz - rest_hz))
    above = np.where(over, own_hz, (force.frequency_hz + hz) + (force.rest_hz + rest_hz))
    first = np.where(over, slow, alpha) - force.decay_per_s + 2j * np.pi * below
    second = np.where(over, fast, alpha) - force.decay_per_s + 2j * np.pi * above
    return _Driven(
        exponent=-force.decay_per_s + 2j * np.pi * own_hz,
        first=first,
        second=second,
        nearest=np.minimum(np.abs(first), np.abs(second)),
        phasor=force.amplitude / mass[:, None] * np.exp(1j * force.phase_rad),
    )


def _move(poles: _Poles, driven: _Driven, force: Tones, time: np.ndarray) -> np.ndarray:
    """Return the displacement (n, k) at the times of one block."""
    free = _free(poles, time)
    near = driven.nearest * time[0] < 1
    steady = np.divide(driven.phasor, driven.first * driven.second, out=np.zeros(near.shape, complex), where=~near)
    moved = -free.keep * steady.real.sum(-1)[:, None] - free.push * (steady * driven.exponent).real.sum(-1)[:, None]
    if near.any():
        _add_near(moved, steady, near, poles, driven, free, time)
    cycles = turns(force.frequency_hz[:, None], time) + force.rest_hz[:, None] * time
    carrier = np.exp(-force.decay_per_s[:, None] * time + 2j * np.pi * cycles)
    return np.asarray(moved + steady.real @ carrier.real - steady.imag @ carrier.imag)


def _add_near(
    moved: np.ndarray,
    steady: np.ndarray,
    near: np.ndarray,
    poles: _Poles,
    driven: _Driven,
    free: _Free,
    time: np.ndarray,
) -> None:
    """Add the `near` pairs (n, m) to `moved`, and their part that goes as the tones to `steady`."""
    which, tone = np.nonzero(near)
    phasor, exponent, last = driven.phasor[which, tone], driven.exponent[tone], float(time[-1])
    gap = np.where(poles.over, 2 * poles.root, 2j * poles.root)[which]
    apart = np.abs(gap) * time[0] >= 1
    close = ~apart
    reach = (exponent + poles.alpha[which]) * last
    fade = np.exp(-poles.alpha[:, None] * time) * time**2
    at = time / last if last else time
    series = _series(reach[close], (poles.square * last**2)[which[close]], phasor[close], which[close], len(steady))
    moved += fade * _polynomial(series.real, at)
    for sign, detuning, mode in ((1, driven.first, free.first), (-1, driven.second, free.second)):
        turn = detuning[which, tone]
        slow, quick = apart & (np.abs(turn) * time[0] < 1), apart & (np.abs(turn) * time[0] >= 1)
        shares = sign * np.divide(phasor, gap, out=np.zeros(phasor.shape, complex), where=apart)
        plain = np.divide(shares, turn, out=np.zeros(phasor.shape, complex), where=quick)
        steady[which, tone] += plain
        moved -= (_sums(plain, which, len(steady))[:, None] * mode).real
        grown = _growth(turn[slow] * last, shares[slow], which[slow], len(steady))
        moved += (mode * time * _polynomial(grown, at)).real


def _sums(values: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Return sums (count,) of values (p,) by resonator `which` (p,)."""
    sums: np.ndarray = np.bincount(which, values.real, count) + 1j * np.bincount(which, values.imag, count)
    return sums


def _growth(turn: np.ndarray, weights: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Return coefficients (n, terms) of ``Σ weight expm1(z)/z``, z = `turn` (p,), at the block's last time."""
    sums, term, k, size = [_sums(weights, which, count)], weights, 1, 1.0
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
    sums, power, k, scale = [_sums(weights, which, count) / 2], np.ones(len(reach)), 0, 0.5
    term, largest, size = np.ones(len(reach), complex), float(np.abs(reach).max(initial=0.0)) + 1, 1.0
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
