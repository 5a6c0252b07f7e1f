"""A print and its measurement in the computer, so that re-tuning can be tried without a lab.

The print: resonances as `padgen.planner.printed_pads` draws them from the printer's and the material's spreads; Q and
pull log-normal with the spreads below, which are assumptions. The measurement: what a probe on each washer would
record, all modes of the taxel included (they move with its resonance), with white noise `snr_db` below the largest
value. Coils around and the frame's own motion are left out.
"""

import io
from collections.abc import Callable, Sequence
from dataclasses import astuple

import numpy as np

from padgen.core.errors import SpecError, number
from padgen.measured.predict import printed_channels
from padgen.measured.shake import chirp_current_a, measuring_band_hz, ring_s, shaking_line_a2, sweep_s
from padgen.measured.tuning import TunedTaxel, Tuning, planned_response_um_per_a2
from padgen.planner.plan import Plan
from padgen.planner.printed_pads import Spreads, design_of, log_detuning, spreads_of

__all__ = [
    "KINDS",
    "PULL_SPREAD",
    "Q_SPREAD",
    "simulate_print",
    "simulated_measurement",
    "spreads_for",
]

KINDS = ("spectrum", "chirp", "pluck")
Q_SPREAD = 0.10
"""Relative spread of Q from taxel to taxel: layers bond, and glue damps, differently. An assumption."""
PULL_SPREAD = 0.10
"""Relative spread of the pull: 0.1 mm of gap or half a millimetre of place. An assumption."""
POINTS_PER_BANDWIDTH = 10
REACH_BANDWIDTHS = 6
"""How far a spectrum of a high Q is looked at around each resonance."""
MOST_EVEN = 3000
"""Points up to which a spectrum is taken evenly in octaves over the whole band."""
MOST_NUMBERS = 20_000_000
"""Numbers that a file of a time series may have."""
RATE_OVER_HIGHEST = 8.0


def spreads_for(plan: Plan, sigma: float) -> Spreads:
    """The plan's spreads, all scaled alike so that the resonances of its taxels scatter by `sigma` (root of the mean
    square over the taxels)."""
    spreads, design = spreads_of(plan.spec), design_of(plan, None)
    drawn = log_detuning(design, spreads, 0, 0, 2048)[2]
    scale = sigma / float(np.sqrt((drawn**2).mean()))
    return Spreads(*(value * scale for value in astuple(spreads)))


def simulate_print(plan: Plan, seed: int, spreads: Spreads | None = None) -> Tuning:
    """What one print came out as, known exactly; the same seed, the same print."""
    spreads, design = spreads or spreads_of(plan.spec), design_of(plan, None)
    x = np.exp(np.clip(log_detuning(design, spreads, seed, 0, 1)[2, :, 0], -1.0, 1.0))
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, 100)))
    q_factor, pull_factor = np.exp(rng.standard_normal((2, len(x))) * [[Q_SPREAD], [PULL_SPREAD]])
    taxels = []
    for taxel, off, better, stronger in zip(plan.taxels, x, q_factor, pull_factor, strict=True):
        channel = plan.channels[taxel.channel]
        hz, q = channel.resonance_hz * float(off), max(channel.q * float(better), 0.5)
        response = planned_response_um_per_a2(channel, hz, q) * float(stronger)
        taxels.append(TunedTaxel(taxel.id, hz, 0.0, q, 0.0, response, 0.0, True, True))
    return Tuning(plan.name, tuple(taxels))


def simulated_measurement(plan: Plan, truth: Tuning, seed: int, kind: str = "spectrum", snr_db: float = 30.0) -> str:
    """What a lab would write of the print `truth`, as CSV for `padgen.measured.read.read_measured`.

    `kind`: 'spectrum', complex amplitude per line of i² over the frequency of the motion; 'chirp', displacement under
    the excitation of `padgen.driver.excitation`, with the current; 'pluck', the decay after a tap on each taxel, in
    relative units. `snr_db` is the largest value of a taxel's column over the noise's sigma at each point.

    Raises
    ------
    SpecError
        An unknown kind, or a time series too long for a file.
    """
    if kind not in KINDS:
        raise SpecError(f"must be one of {', '.join(KINDS)}, got {kind!r}", "--kind")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, 101)))
    answer = _answers(plan, truth)
    noise = 10 ** (-snr_db / 20)
    return {"spectrum": _spectrum, "chirp": _chirp, "pluck": _pluck}[kind](plan, truth, answer, rng, noise)


Answer = Callable[[int, np.ndarray], np.ndarray]
"""Of taxel i at frequencies in Hz: complex amplitude in µm of the washer per A² of a line of i²."""


def _answers(plan: Plan, truth: Tuning) -> Answer:
    channels = printed_channels(plan, truth)

    def answer(i: int, frequency_hz: np.ndarray) -> np.ndarray:
        channel, tuned = channels[i], truth.taxels[i]
        working = int(np.argmax(channel.mode_shares))
        total = np.zeros(frequency_hz.shape, complex)
        for k, (mode_hz, share) in enumerate(zip(channel.modes_hz, channel.pulled_shares, strict=True)):
            own = tuned.resonance_hz if k == working else mode_hz
            s = frequency_hz / own
            total += share / channel.pulled_shares[working] / ((1 - s) * (1 + s) + 1j * s / tuned.q)
        return total * (tuned.response_um_per_a2 / tuned.q)

    return answer


def _spectrum(plan: Plan, truth: Tuning, answer: Answer, rng: np.random.Generator, noise: float) -> str:
    frequency = _frequencies(plan, truth)
    columns, names = [frequency], ["frequency_hz"]
    for i, taxel in enumerate(truth.taxels):
        clean = answer(i, frequency)
        sigma = noise * np.abs(clean).max() / np.sqrt(2)
        noisy = clean + sigma * (rng.standard_normal(len(clean)) + 1j * rng.standard_normal(len(clean)))
        columns += [noisy.real, noisy.imag]
        names += [f"{taxel.id}_re", f"{taxel.id}_im"]
    return _csv(names, columns, "# unit: um_per_a2\n")


def _frequencies(plan: Plan, truth: Tuning) -> np.ndarray:
    """Frequencies for all taxels: evenly in octaves where that resolves each resonance, else points around each."""
    low, high = _band_hz(plan, truth)
    q = np.array([taxel.q for taxel in truth.taxels])
    even = int(np.ceil(np.log(high / low) * q.max() * POINTS_PER_BANDWIDTH))
    if even <= MOST_EVEN:
        return np.geomspace(low, high, max(even, 200))
    hz = np.array([taxel.resonance_hz for taxel in truth.taxels])
    offsets = np.linspace(-REACH_BANDWIDTHS, REACH_BANDWIDTHS, 2 * REACH_BANDWIDTHS * POINTS_PER_BANDWIDTH + 1)
    zoomed = hz[:, None] * (1 + offsets / q[:, None])
    coarse = np.geomspace(low, high, 200)
    return np.unique(np.concatenate([coarse, zoomed.ravel()]).clip(low, high))


def _band_hz(plan: Plan, truth: Tuning) -> tuple[float, float]:
    """The band that is measured: wide enough for a print that came out far off too."""
    low, high = measuring_band_hz(plan)
    hz = [taxel.resonance_hz for taxel in truth.taxels]
    return min(low, min(hz) / 2), max(high, max(hz) * 2)


def _chirp(plan: Plan, truth: Tuning, answer: Answer, rng: np.random.Generator, noise: float) -> str:
    low, high = _band_hz(plan, truth)
    rate = float(np.ceil(RATE_OVER_HIGHEST * high / 2))
    sweep, ring = sweep_s(plan), ring_s(plan)
    _refuse_long((sweep + ring) * rate * (2 + len(truth.taxels)), "chirp")
    time = np.arange(int((sweep + ring) * rate)) / rate
    current = chirp_current_a(time, sweep, (low, high), shaking_line_a2(plan))[0]
    # Twice as long, so that what still rings at the end does not come round to the beginning.
    size = 2 * len(time)
    force = np.fft.rfft(current**2, size)
    frequency = np.fft.rfftfreq(size, 1 / rate)
    return _series(truth, time, current, lambda i: np.fft.irfft(force * answer(i, frequency), size), rng, noise)


def _pluck(plan: Plan, truth: Tuning, answer: Answer, rng: np.random.Generator, noise: float) -> str:
    hz = np.array([taxel.resonance_hz for taxel in truth.taxels])
    q = np.array([taxel.q for taxel in truth.taxels])
    rate = float(np.ceil(RATE_OVER_HIGHEST * hz.max()))
    seconds = min(max(float((3 * q / (np.pi * hz)).max()), 5 / float(hz.min())), MOST_NUMBERS / rate / (1 + len(hz)))
    time = np.arange(int(seconds * rate)) / rate
    phase = rng.uniform(-0.5, 0.5, len(hz))

    def decay(i: int) -> np.ndarray:
        damped = hz[i] * np.sqrt(1 - min(1 / (4 * q[i] ** 2), 0.99))
        return np.asarray(np.exp(-np.pi * hz[i] / q[i] * time) * np.cos(2 * np.pi * damped * time + phase[i]))

    return _series(truth, time, None, decay, rng, noise)


def _series(
    truth: Tuning,
    time: np.ndarray,
    current: np.ndarray | None,
    motion: Callable[[int], np.ndarray],
    rng: np.random.Generator,
    noise: float,
) -> str:
    names, columns = ["time_s"], [time]
    if current is not None:
        names.append("current_a")
        columns.append(current)
    for i, taxel in enumerate(truth.taxels):
        clean = motion(i)[: len(time)]
        names.append(taxel.id)
        columns.append(clean + noise * np.abs(clean).max() * rng.standard_normal(len(time)))
    return _csv(names, columns, "" if current is None else "# unit: um\n")


def _refuse_long(numbers: float, kind: str) -> None:
    if numbers > MOST_NUMBERS:
        raise SpecError(
            f"{kind} would take a file of {number(float(round(numbers)))} numbers, at most {MOST_NUMBERS} are written;"
            " spectrum would do",
            "--kind",
        )


def _csv(names: Sequence[str], columns: Sequence[np.ndarray], head: str) -> str:
    text = io.StringIO()
    text.write(head + ",".join(names) + "\n")
    np.savetxt(text, np.stack(columns, 1), fmt=["%.10g"] + ["%.6g"] * (len(columns) - 1), delimiter=",")
    return text.getvalue()
