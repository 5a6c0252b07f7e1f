"""Recordings with unannounced faults: springs that soften, pick-up, gaps, knocks; shares no code with padgen.

A mode ``x'' + (ω/Q) x' + ω² x (1 + κ x²) = ω² F`` is stepped by Runge and Kutta's fourth-order rule, for many taxels at
once. `python tests/faulty_recordings.py [TAXELS]` prints the table of docs/retune.md.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

RATE_HZ = 4000
STEPS = 4
"""Samples of the recording in a second, and those of the force between two of them."""
SECONDS = 6.0
LOW_HZ = 30.0
HIGH_HZ = 400.0
SILENCE_S = 0.5
NOISE = 0.01
"""Noise over the largest motion."""


class Faulty(NamedTuple):
    """True f and Q of each taxel, the coil's current (None for plucks) and the recorded motions (n, taxels)."""

    hz: np.ndarray
    q: np.ndarray
    current: np.ndarray | None
    motion: np.ndarray


def taxels(rng, count):
    """Draw resonances in Hz and Q."""
    return rng.uniform(55, 180, count), rng.uniform(8, 35, count)


def swept_current():
    """Return a sweep of the current, so that its square sweeps from `LOW_HZ` to `HIGH_HZ`, between silence."""
    rate = RATE_HZ * STEPS
    time = np.arange(int(SECONDS * rate)) / rate
    growth = np.log(HIGH_HZ / LOW_HZ) / SECONDS
    swing = np.sin(np.pi * LOW_HZ / growth * np.expm1(growth * time))
    swing *= np.clip(time / 0.1, 0, 1) * np.clip((SECONDS - time) / 0.02, 0, 1)
    pause = np.zeros(int(SILENCE_S * rate))
    return np.concatenate([pause, swing, pause])


def stepped(force, hz, q, kappa):
    """Return the motions (n, taxels) under a force (n STEPS,), at `RATE_HZ`."""
    omega = 2 * np.pi * hz
    step = 2 / (RATE_HZ * STEPS)

    def acceleration(x, v, push):
        return omega**2 * (push - x * (1 + kappa * x**2)) - omega / q * v

    x = np.zeros(len(hz))
    v = np.zeros(len(hz))
    motion = np.zeros((len(force) // STEPS, len(hz)))
    for k in range(0, len(force) - 2, 2):
        if k % STEPS == 0:
            motion[k // STEPS] = x
        first = acceleration(x, v, force[k])
        second = acceleration(x + step / 2 * v, v + step / 2 * first, force[k + 1])
        third_v = v + step / 2 * second
        third = acceleration(x + step / 2 * (v + step / 2 * first), third_v, force[k + 1])
        fourth_v = v + step * third
        fourth = acceleration(x + step * third_v, fourth_v, force[k + 2])
        x = x + step / 6 * (v + 2 * (v + step / 2 * first) + 2 * third_v + fourth_v)
        v = v + step / 6 * (first + 2 * second + 2 * third + fourth)
    return motion


def swept(rng, count, lean=0.0, pick_up=0.0, gap_s=0.0, direct=0.0):
    """Return sweeps of taxels whose peaks lean by so many half-bandwidths, either way, with a fault each.

    `pick_up` is that of the current and of its slope, each over the largest motion; `direct` the force in the sensor's
    signal, over the static answer to it.
    """
    hz, q = taxels(rng, count)
    current = swept_current()
    force = current**2
    # A sweep of a force of 1 ± 1, halved, moves a taxel by nearly half its Q; 3/8 κ A² is the shift of its resonance.
    largest = 0.45 * q
    kappa = lean * rng.choice([-1, 1], count) / (2 * q) * 8 / 3 / largest**2
    motion = stepped(force, hz, q, kappa)
    own = current[::STEPS][: len(motion)]
    slope = np.gradient(own)
    peak = np.abs(motion).max(0)
    both = rng.uniform(-1, 1, count) * own[:, None] + rng.choice([-1, 1], count) * (slope / slope.max())[:, None]
    motion = motion + pick_up * peak * both + direct * force[::STEPS][: len(motion), None]
    motion = motion + NOISE * peak * rng.standard_normal(motion.shape)
    for taxel in range(count if gap_s else 0):
        passed_s = SILENCE_S + SECONDS * np.log(hz[taxel] / LOW_HZ) / np.log(HIGH_HZ / LOW_HZ)
        at = int((passed_s + rng.uniform(0.0, 0.5) * q[taxel] / np.pi / hz[taxel]) * RATE_HZ)
        motion[at : at + int(gap_s * RATE_HZ), taxel] = 0
    return Faulty(hz, q, own, motion)


def plucked(rng, count, slam=0.0, first=False):
    """Return plucks beside a slam of another frequency, so many times as large, `first` or after the pluck."""
    hz, q = taxels(rng, count)
    time = np.arange(4 * RATE_HZ) / RATE_HZ

    def ringing(at_s, f, k, size):
        since = np.maximum(time - at_s, 0)[:, None]
        damped_hz = f * np.sqrt(1 - 1 / (4 * k**2))
        return size * np.exp(-np.pi * f * since / k) * np.sin(2 * np.pi * damped_hz * since)

    other = hz * rng.choice([0.7, 0.8, 0.9, 1.2], count)
    places = (2.2, 0.5) if first else (0.5, 2.2)
    motion = ringing(places[0], hz, q, 1.0) + ringing(places[1], other, rng.uniform(6, 20, count), slam)
    return Faulty(hz, q, None, motion + NOISE * rng.standard_normal(motion.shape))


KINDS = {
    "plain": lambda rng, count: swept(rng, count),
    "leaning by 0.1": lambda rng, count: swept(rng, count, lean=0.1),
    "leaning by 0.3": lambda rng, count: swept(rng, count, lean=0.3),
    "leaning by 1": lambda rng, count: swept(rng, count, lean=1.0),
    "half the force": lambda rng, count: swept(rng, count, direct=0.5),
    "pick-up of 20 %": lambda rng, count: swept(rng, count, pick_up=0.2),
    "pick-up of 100 %": lambda rng, count: swept(rng, count, pick_up=1.0),
    "gap of 20 ms": lambda rng, count: swept(rng, count, gap_s=0.02),
    "pluck": lambda rng, count: plucked(rng, count),
    "pluck, then a slam": lambda rng, count: plucked(rng, count, slam=2.0),
    "slam, then a pluck": lambda rng, count: plucked(rng, count, slam=2.0, first=True),
}
"""What is wrong with a recording, by its name."""


def fitted(made, fit_driven, fit_decay, refused):
    """Fit each taxel of `made`; return (f, its sigma, Q, its sigma) or the sentence of an error of type `refused`."""
    results = []
    for taxel in range(len(made.hz)):
        motion = made.motion[:, taxel]
        rings_s = made.q[taxel] / np.pi / made.hz[taxel]
        try:
            if made.current is None:
                fit = fit_decay(RATE_HZ, motion)
            else:
                fit = fit_driven(RATE_HZ, made.current**2, motion, ring_s=rings_s, current=made.current)
        except refused as error:
            results.append(str(error))
            continue
        results.append((fit.resonance_hz, fit.resonance_error_hz, fit.q, fit.q_error))
    return results


def judged(made, results):
    """Return errors of f in bandwidths and of Q as a share, and both over their sigmas, (k, 4), of what was fitted."""
    rows = []
    for hz, q, result in zip(made.hz, made.q, results, strict=True):
        if isinstance(result, str):
            continue
        f, f_sigma, k, k_sigma = result
        rows.append(((f - hz) / hz * q, k / q - 1, (f - hz) / f_sigma, (k - q) / k_sigma))
    return np.abs(np.array(rows).reshape(-1, 4))


def main(count):
    """Print the table of docs/retune.md."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from padgen.core.errors import SolverError
    from padgen.physics.resonance_fit import fit_decay, fit_driven

    print("| recording | fitted | f off by, bandwidths: median, worst | Q off by: median, worst | within 95 %: f, Q |")
    print("|---|---|---|---|---|")
    for kind, make in KINDS.items():
        made = make(np.random.default_rng(1), count)
        rows = judged(made, fitted(made, fit_driven, fit_decay, SolverError))
        line = f"| {kind} | {len(rows)} of {count} | "
        if len(rows):
            middle = np.median(rows, axis=0)
            worst = rows.max(0)
            within = (rows[:, 2:] < 1.96).mean(0)
            line += f"{middle[0]:.4f}, {worst[0]:.3f} | {middle[1]:.1%}, {worst[1]:.1%} | "
            line += f"{within[0]:.0%}, {within[1]:.0%} |"
        else:
            line += "– | – | – |"
        print(line, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
