"""Amplitudes of taxels whose tones are switched smoothly, braking in counter-phase to rest, and averages over frames.

A taxel of time constant τ = Q/(πf) under its own line follows the line's level g with ``τ a' = g − a``, a being its
amplitude over the one of level 1: the envelope of a resonator at resonance, to first order in 1/Q. A level below 0 is
the line in counter-phase. All is exact for the levels' smooth steps, up to the quadrature of the step (1e-4).

A *slot average* is the root mean square of that amplitude over a frame's whole slot, its switching included: what is
averaged is energy, as a finger does that feels a vibration (a model taken from loudness; assumed, no source binds it).
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

__all__ = ["STEPS", "Brake", "blend", "blend_slope", "brake_for", "course", "follow", "keyframes", "overlap"]

STEPS = 128
"""Steps of a blend in which its level is taken as straight: the error of an amplitude is 1e-4 at most."""
LONGER = 1.05
"""Factor by which a brake is lengthened until the counter-phase that it takes is no larger than what is planned."""


def blend(share: np.ndarray) -> np.ndarray:
    """Return a smooth step from 0 to 1 at `share` (0 to 1) of a transition's time: the integral of `blend_slope`."""
    return np.asarray(share**5 * (126 - share * (420 - share * (540 - share * (315 - 70 * share)))))


def blend_slope(share: np.ndarray) -> np.ndarray:
    """Return the slope of `blend`, ``630 (s (1 − s))⁴``."""
    return np.asarray(630 * (share * (1 - share)) ** 4)


class Brake(NamedTuple):
    """Braking of taxels at the end of their last ON frame by counter-phase, in smooth steps of `blend_s` seconds each.

    The level goes from what it was to one below 0, which is counter-phase, and from there to 0; `through_zero` tells
    that it stops at 0 in between, as plain tones must, whose current has the root of the level.
    """

    blend_s: float
    through_zero: bool

    @property
    def seconds(self) -> float:
        """Length of the whole brake in s."""
        return self.blend_s * len(self.shares)

    @property
    def shares(self) -> tuple[tuple[float, float], ...]:
        """For each step (a, b): at its end the level is a × that before the brake + b × the counter-phase level."""
        return ((0.0, 0.0), (0.0, 1.0), (0.0, 0.0)) if self.through_zero else ((0.0, 1.0), (0.0, 0.0))

    def counter(self, amplitude: np.ndarray, level: np.ndarray, tau_s: np.ndarray) -> np.ndarray:
        """Return the counter-phase level (n,), at most 1, that stops taxels at `amplitude` after drive at `level`."""
        kept = np.asarray(amplitude, float)
        before = np.asarray(level, float)
        braked = np.zeros(len(kept))
        countered = 0.0
        for _, share in self.shares:
            _, after = passage(tau_s, self.blend_s)
            counter_level, first, last = after.T
            kept = counter_level * kept + first * before
            braked = counter_level * braked + first * countered + last * share
            before = np.zeros(len(kept))
            countered = share
        return np.clip(kept / braked, 0.0, 1.0)


def brake_for(tau_s: np.ndarray, blend_s: float, through_zero: bool) -> Brake:
    """Return the shortest brake, in steps of at least `blend_s` seconds, that stops taxels (n,) moving at level 1."""
    one = np.ones(len(tau_s))
    brake = Brake(blend_s, through_zero)
    while (brake.counter(one, one, tau_s) >= 1).any():
        brake = Brake(brake.blend_s * LONGER, through_zero)
    return brake


def passage(tau_s: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return coefficients of energy (∫ amplitude² dt) and end amplitude of taxels (n,) over one smooth step of level.

    `energy` (n, 3, 3) is the quadratic form of start amplitude, level before and level after that gives ∫ a² dt in s,
    `after` (n, 3) the linear form of the amplitude at the end.
    """
    return _passage(tuple(np.asarray(tau_s, float).tolist()), float(f"{seconds:.9g}"))


def course(tau_s: np.ndarray, seconds: float) -> np.ndarray:
    """Return weights (3, `STEPS` + 1, n) of start amplitude, old level and new level in amplitudes during a step."""
    tau = np.asarray(tau_s, float)
    step = seconds / STEPS
    keep = np.exp(-step / tau)
    passed = -np.expm1(-step / tau) * tau / step
    level = blend(np.arange(STEPS + 1) / STEPS)
    risen = np.zeros((STEPS + 1, len(tau)))
    # Exact where the level is straight within each step: the sum of what the steps add, which falls by `keep` in every
    # later step, by doubling the number of steps that are summed.
    risen[1:] = (passed - keep) * level[:-1, None] + (1 - passed) * level[1:, None]
    apart = 1
    while apart < STEPS:
        risen[apart:] = risen[apart:] + keep**apart * risen[:-apart]
        apart = 2 * apart
    decay = np.exp(-np.arange(STEPS + 1)[:, None] * step / tau)
    return np.stack([decay, 1 - decay - risen, risen])


@lru_cache(maxsize=256)
def _passage(tau_s: tuple[float, ...], seconds: float) -> tuple[np.ndarray, np.ndarray]:
    parts = course(np.array(tau_s), seconds)
    weight = np.full(STEPS + 1, seconds / STEPS)
    weight[[0, -1]] /= 2
    return np.einsum("akn,bkn,k->nab", parts, parts, weight), parts[:, -1].T


def follow(
    time_s: np.ndarray, levels: np.ndarray, tau_s: np.ndarray, start: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return taxels' amplitudes (k, n) at keyframes, and the integrals (k − 1, n) in s of amplitude² between keyframes.

    `levels` (k, n) are those at `time_s` (k,), blended from one keyframe to the next; `tau_s` (n,) are time constants.
    """
    amplitude = np.zeros(levels.shape)
    energy = np.zeros((len(levels) - 1, levels.shape[1]))
    amplitude[0] = start
    tau = np.asarray(tau_s, float)
    for k, seconds in enumerate(np.diff(time_s).tolist()):
        begun = amplitude[k]
        before = levels[k]
        after = levels[k + 1]
        if seconds <= 0:
            amplitude[k + 1] = begun
        elif np.array_equal(before, after):
            fallen = np.exp(-seconds / tau)
            off = begun - before
            amplitude[k + 1] = before + off * fallen
            held = before**2 * seconds + 2 * before * off * tau * (1 - fallen) + off**2 * tau / 2 * (1 - fallen**2)
            # A taxel that takes hours to ring up has next to none, of which rounding may leave less than nothing.
            energy[k] = np.maximum(held, 0.0)
        else:
            form, last = passage(tau, seconds)
            three = np.stack([begun, before, after], 1)
            energy[k] = np.maximum(np.einsum("na,nab,nb->n", three, form, three), 0.0)
            amplitude[k + 1] = (last * three).sum(1)
    return amplitude, energy


def overlap(time_s: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return time integrals (k − 1, n) in s of the product of two sets of levels (k, n), blended between keyframes."""
    step = blend(np.arange(STEPS + 1) / STEPS)
    alike = float(np.trapezoid(step**2)) / STEPS
    apart = float(np.trapezoid(step * (1 - step))) / STEPS
    before = (first[:-1], second[:-1])
    after = (first[1:], second[1:])
    same = before[0] * before[1] + after[0] * after[1]
    crossed = before[0] * after[1] + after[0] * before[1]
    return np.asarray(np.diff(time_s)[:, None] * (alike * same + apart * crossed))


def keyframes(
    frames: np.ndarray,
    frame_s: float,
    ramp_s: float,
    brake: Brake | None = None,
    tau_s: np.ndarray | None = None,
    signs: np.ndarray | float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return times (m,) and levels (m, n) of keyframes that show `frames` (k, n) for `frame_s` each, OFF at both ends.

    Each is switched in over `ramp_s`. With a `brake`, taxels of time constants `tau_s` that go OFF are stopped at the
    end of their last frame: what they have by then depends on the `signs` (k, n) that they vibrate with.
    """
    count = len(frames)
    silence = np.zeros((1, frames.shape[1]))
    starts = np.arange(count + 1) * frame_s
    before = np.concatenate([silence, frames])
    after = np.concatenate([frames, silence])
    if brake is None or tau_s is None:
        return np.stack([starts, starts + ramp_s], 1).ravel(), np.stack([before, after], 1).reshape(2 * count + 2, -1)
    times = [0.0]
    levels = [silence[0]]
    amplitude = silence[0]
    before = silence[0]
    for k, sign in enumerate(np.broadcast_to(signs, frames.shape)):
        begin_s = starts[k + 1] - brake.seconds
        shown = frames[k]
        goes = (frames[k] > 0) & (after[k + 1] <= 0)
        times += [starts[k] + ramp_s, begin_s]
        levels += [shown, shown]
        played = np.stack([before, sign * shown, sign * shown])
        amplitude = follow(np.array([starts[k], *times[-2:]]), played, tau_s, amplitude)[0][-1]
        counter = brake.counter(sign * amplitude, shown, tau_s)
        first = len(times) - 1
        for place, (_, share) in enumerate(brake.shares, 1):
            times.append(begin_s + place * brake.blend_s)
            levels.append(np.where(goes, -share * counter, shown))
        times[-1] = starts[k + 1]
        amplitude = follow(np.array(times[first:]), sign * np.array(levels[first:]), tau_s, amplitude)[0][-1]
        before = sign * levels[-1]
    return np.array([*times, starts[-1] + ramp_s]), np.array([*levels, silence[0]])
