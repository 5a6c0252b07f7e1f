"""Simulation of a print and of its measurement, so that re-tuning can be tried without a lab.

Resonances of the print are drawn by `padgen.planner.printed_pads` from the printer's and the material's spreads. Q and
pull are log-normal with the spreads below, which are assumptions. The measurement is the motion that a probe on each
washer would record: all modes of the taxel, which move with its resonance, and white noise `snr_db` below the largest
value. The coils around and the frame's own motion are left out.

All taxels of a coil are shaken by a chirp or by noise. The force goes with i², so the current is designed by i². A
chirp ``i = I sin(φ/2)`` gives ``i² = I²/2 (1 − cos φ)``: a chirp of the force without harmonics, at twice the current's
frequency. Noise is the root of a constant and lines on a comb, as in the spur-free drive. The force at each frequency
would move a taxel of the plan that resonates there as its ON tone does: with the same root mean square under noise,
with at most the same amplitude under a chirp."""

import io
from collections.abc import Callable, Sequence
from dataclasses import astuple

import numpy as np

from padgen.core.errors import SpecError, number
from padgen.measured.predict import printed_channels
from padgen.measured.tuning import TunedTaxel, Tuning, planned_response_um_per_a2
from padgen.planner.plan import Plan
from padgen.planner.printed_pads import Spreads, design_of, log_detuning, spreads_of

__all__ = [
    "KINDS",
    "PULL_SPREAD",
    "Q_SPREAD",
    "chirp_current_a",
    "measuring_band_hz",
    "noise_current_a",
    "ring_s",
    "shaking_line_a2",
    "simulate_print",
    "simulated_measurement",
    "spreads_for",
    "sweep_s",
]

KINDS = ("spectrum", "chirp", "pluck")
Q_SPREAD = 0.10
"""Relative spread of Q from taxel to taxel, as layers bond and glue damps differently. An assumption."""
PULL_SPREAD = 0.10
"""Relative spread of the pull: 0.1 mm of gap or half a millimetre of place. An assumption."""
POINTS_PER_BANDWIDTH = 10
REACH_BANDWIDTHS = 6
"""Bandwidths on either side of each resonance at which a spectrum of high Q gets close points."""
MOST_EVEN = 3000
"""Most points of a spectrum that is even in octaves over the whole band."""
MOST_NUMBERS = 20_000_000
"""Most numbers in a file of a time series."""
RATE_OVER_HIGHEST = 8.0


def spreads_for(plan: Plan, sigma: float) -> Spreads:
    """Return the plan's spreads, scaled by one factor so that ln f of its taxels has a root mean square of `sigma`."""
    spreads, design = spreads_of(plan.spec), design_of(plan, None)
    drawn = log_detuning(design, spreads, 0, 0, 2048)[2]
    scale = sigma / float(np.sqrt((drawn**2).mean()))
    return Spreads(*(value * scale for value in astuple(spreads)))


def simulate_print(plan: Plan, seed: int, spreads: Spreads | None = None) -> Tuning:
    """Return one simulated print, known exactly; the same seed gives the same print."""
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
    """Simulate a lab's measurement of the print `truth`, as CSV for `padgen.measured.read.read_measured`.

    The `kind` is 'spectrum' (complex amplitude per line of i² over the frequency of the motion), 'chirp' (displacement
    under the excitation of `padgen.driver.excitation`, with the current) or 'pluck' (the decay after a tap on each
    taxel, in relative units). `snr_db` is the largest value of a taxel's column over the noise's sigma at each point.

    Raises
    ------
    SpecError
        The kind is unknown, or the time series would be too long for a file.
    """
    if kind not in KINDS:
        raise SpecError(f"must be one of {', '.join(KINDS)}, got {kind!r}", "--kind")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, 101)))
    response = _responses(plan, truth)
    noise = 10 ** (-snr_db / 20)
    return {"spectrum": _spectrum, "chirp": _chirp, "pluck": _pluck}[kind](plan, truth, response, rng, noise)


Response = Callable[[int, np.ndarray], np.ndarray]
"""Function of a taxel's index and frequencies in Hz: the washer's complex amplitude in µm per A² of a line of i²."""


def _responses(plan: Plan, truth: Tuning) -> Response:
    channels = printed_channels(plan, truth)

    def response(i: int, frequency_hz: np.ndarray) -> np.ndarray:
        channel, tuned = channels[i], truth.taxels[i]
        working = int(np.argmax(channel.mode_shares))
        total = np.zeros(frequency_hz.shape, complex)
        for k, (mode_hz, share) in enumerate(zip(channel.modes_hz, channel.pulled_shares, strict=True)):
            own = tuned.resonance_hz if k == working else mode_hz
            s = frequency_hz / own
            total += share / channel.pulled_shares[working] / ((1 - s) * (1 + s) + 1j * s / tuned.q)
        return total * (tuned.response_um_per_a2 / tuned.q)

    return response


def _spectrum(plan: Plan, truth: Tuning, response: Response, rng: np.random.Generator, noise: float) -> str:
    frequency = _frequencies(plan, truth)
    columns, names = [frequency], ["frequency_hz"]
    for i, taxel in enumerate(truth.taxels):
        clean = response(i, frequency)
        sigma = noise * np.abs(clean).max() / np.sqrt(2)
        noisy = clean + sigma * (rng.standard_normal(len(clean)) + 1j * rng.standard_normal(len(clean)))
        columns += [noisy.real, noisy.imag]
        names += [f"{taxel.id}_re", f"{taxel.id}_im"]
    return _csv(names, columns, "# unit: um_per_a2\n")


def _frequencies(plan: Plan, truth: Tuning) -> np.ndarray:
    """Return the frequencies of a spectrum in Hz: even in octaves, or close around each resonance where Q is high."""
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
    """Return the measured band in Hz, widened where the print came out far off the plan."""
    low, high = measuring_band_hz(plan)
    hz = [taxel.resonance_hz for taxel in truth.taxels]
    return min(low, min(hz) / 2), max(high, max(hz) * 2)


def _chirp(plan: Plan, truth: Tuning, response: Response, rng: np.random.Generator, noise: float) -> str:
    low, high = _band_hz(plan, truth)
    rate = float(np.ceil(RATE_OVER_HIGHEST * high / 2))
    sweep, ring = sweep_s(plan), ring_s(plan)
    _refuse_long((sweep + ring) * rate * (2 + len(truth.taxels)), "chirp")
    time = np.arange(int((sweep + ring) * rate)) / rate
    current = chirp_current_a(time, sweep, (low, high), shaking_line_a2(plan))[0]
    # Twice as long, so that motion at the end does not wrap round to the beginning.
    size = 2 * len(time)
    force = np.fft.rfft(current**2, size)
    frequency = np.fft.rfftfreq(size, 1 / rate)
    return _series(truth, time, current, lambda i: np.fft.irfft(force * response(i, frequency), size), rng, noise)


def _pluck(plan: Plan, truth: Tuning, response: Response, rng: np.random.Generator, noise: float) -> str:
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


NARROWEST_MARGIN, WIDEST_MARGIN = 2.0, 3.0
"""Least and largest factor by which the band reaches beyond the channels, for prints that came out far off."""
SIGMAS = 3.0
SWEEP_WIDTHS, SHORTEST_SWEEP_S = 4.0, 2.0
"""Least length of a sweep, over the inverse of the narrowest bandwidth f/Q (which it then resolves), and in s."""
RING_TAUS = 6.0
"""Time constants of silence after the sweep: the slowest taxel is then down to 0.25 %."""
FADE_PERIODS = 4.0
CREST_STEPS = 30
CREST = 1.7
"""Goal for the constant of the noise's i², over the root mean square of its lines."""
MARGIN = 0.1
"""Share of the constant that is added so that i² stays above 0, where the slope of its root diverges."""

Line = Callable[[np.ndarray], np.ndarray]
"""Function of frequencies in Hz: the amplitude in A² of the line of i² there."""


def measuring_band_hz(plan: Plan) -> tuple[float, float]:
    """Return the lowest and the highest frequency in Hz of the motion to measure: the channels' and a margin."""
    hz = [channel.resonance_hz for channel in plan.channels]
    spread = max(channel.print_spread for channel in plan.channels)
    margin = min(max(NARROWEST_MARGIN, float(np.exp(SIGMAS * spread))), WIDEST_MARGIN)
    return min(hz) / margin, max(hz) * margin


def sweep_s(plan: Plan) -> float:
    """Return the length in s of a sweep that resolves the narrowest bandwidth of the plan's channels."""
    return max(SWEEP_WIDTHS * max(c.q / c.resonance_hz for c in plan.channels), SHORTEST_SWEEP_S)


def ring_s(plan: Plan) -> float:
    """Return the seconds of silence after a sweep in which the slowest taxel comes to rest."""
    return RING_TAUS / np.pi * max(c.q / c.resonance_hz for c in plan.channels)


def shaking_line_a2(plan: Plan) -> Line:
    """Return the function that gives the line of i² that would move a taxel of the plan by its level.

    It is exact at the channels' resonances, and straight between them on logarithmic axes.

    Raises
    ------
    SpecError
        The coils pull no washer.
    """
    line = np.array([c.line_a2 for c in plan.channels])
    hz = np.array([channel.resonance_hz for channel in plan.channels])
    order = np.argsort(hz)
    order = order[line[order] > 0]
    if not len(order):
        raise SpecError("no washer is pulled by its coil, so that nothing can be measured", plan.name)
    log_hz, log_line = np.log(hz[order]), np.log(line[order])

    def line_a2(frequency_hz: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(np.interp(np.log(frequency_hz), log_hz, log_line)))

    return line_a2


def chirp_current_a(
    time_s: np.ndarray, seconds: float, band_hz: tuple[float, float], line_a2: Line
) -> tuple[np.ndarray, np.ndarray]:
    """Return the current in A and its slope in A/s, both (n,), of a chirp of the force up through `band_hz`.

    It spends equal times in equal octaves and ends after `seconds`; then there is silence. It fades in over four
    periods of the lowest frequency, and out over four of the highest, each at most a tenth of its length.
    """
    low, high = band_hz
    rate = np.log(high / low) / seconds
    inside = (time_s >= 0) & (time_s <= seconds)
    time = np.where(inside, time_s, 0.0)
    frequency = low * np.exp(rate * time)
    half_phase = np.pi * low / rate * np.expm1(rate * time)
    amplitude = np.sqrt(2 * line_a2(frequency))
    step = 1e-4
    bend = (np.log(line_a2(frequency * (1 + step))) - np.log(line_a2(frequency * (1 - step)))) / (4 * step) * rate
    up, up_slope = _fade(time, min(FADE_PERIODS / low, seconds / 10))
    down, down_slope = _fade(seconds - time, min(FADE_PERIODS / high, seconds / 10))
    fade, fade_slope = up * down, up_slope * down - up * down_slope
    sine, cosine = np.sin(half_phase), np.cos(half_phase)
    slope = (fade_slope + fade * bend) * sine + fade * cosine * np.pi * frequency
    return np.where(inside, amplitude * fade * sine, 0.0), np.where(inside, amplitude * slope, 0.0)


def noise_current_a(
    samples: int, rate_hz: float, band_hz: tuple[float, float], line_a2: Line, q: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return a current in A and its slope in A/s, both (samples,), whose square is noise in `band_hz`.

    It begins and ends in silence. The lines lie on the comb of the record's length and have random phases, which are
    then moved so that i² needs a small constant (by clipping and restoring the lines: Van der Ouderaa et al. 1988).
    Together they move a taxel of quality factor `q` with the root mean square of its ON motion.
    """
    frequency = np.fft.rfftfreq(samples, 1 / rate_hz)
    within = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    amplitude = np.zeros(len(frequency))
    # A resonator passes the noise power of a bandwidth π f/(2Q): the lines of the comb in it act as one of its own.
    lines = samples / rate_hz * np.pi * frequency[within] / (2 * q)
    amplitude[within] = line_a2(frequency[within]) / np.sqrt(lines)
    phase = _smooth_phases(amplitude, samples, seed)
    spectrum = amplitude * np.exp(1j * phase) * samples / 2
    swing = np.fft.irfft(spectrum, samples)
    swing_slope = np.fft.irfft(2j * np.pi * frequency * spectrum, samples)
    force = swing - swing.min() * (1 + MARGIN)
    time = np.arange(samples) / rate_hz
    length = samples / rate_hz
    fade_s = min(FADE_PERIODS / band_hz[0], length / 10)
    up, up_slope = _fade(time, fade_s)
    down, down_slope = _fade(length - time, fade_s)
    fade, fade_slope = up * down, up_slope * down - up * down_slope
    current = np.sqrt(force * fade)
    bend = force * fade_slope + swing_slope * fade
    return current, np.divide(bend, 2 * current, out=np.zeros(samples), where=current > 1e-9 * current.max())


def _smooth_phases(amplitude: np.ndarray, samples: int, seed: int) -> np.ndarray:
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(amplitude))
    floor = -CREST * np.sqrt((amplitude**2).sum() / 2)
    best, least = phase, -np.inf
    for _ in range(CREST_STEPS):
        swing = np.fft.irfft(amplitude * np.exp(1j * phase) * samples / 2, samples)
        if swing.min() > least:
            best, least = phase, float(swing.min())
        phase = np.angle(np.fft.rfft(np.maximum(swing, floor)))
    return best


def _fade(time: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a smooth step from 0 to 1 over `seconds`, and its slope per second."""
    share = np.clip(time / seconds, 0.0, 1.0)
    return share**3 * (10 - 15 * share + 6 * share**2), 30 * share**2 * (1 - share) ** 2 / seconds
