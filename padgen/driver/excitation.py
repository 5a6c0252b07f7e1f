"""Excitation files: voltages that make coils play a chirp or noise while the taxels' resonances are measured.

One chirp or one stretch of noise (`padgen.measured.shaking`), followed by the silence in which the slowest taxel comes
to rest; each coil in turn, or all at once. The volts are those that drive the current through the coil's resistance and
inductance, ``R i + L di/dt``. Levels are those of the plan, or as much lower as amplifier, copper and the mean pull of
all channels together ask for.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, cos, pi

import numpy as np

from padgen.core.errors import SpecError, at_least, number
from padgen.core.units import MH
from padgen.measured.shaking import (
    chirp_current_a,
    measuring_band_hz,
    noise_current_a,
    ring_s,
    shaking_line_a2,
    sweep_s,
)
from padgen.physics.schemes import mean_square_a2
from padgen.planner.plan import Plan

__all__ = ["KINDS", "SAMPLES_OF_HIGHEST", "Excitation", "FirmwareSweep", "excitation", "sweep_table"]

KINDS = ("chirp", "noise")
VOLTAGE_SHARE = 0.9
"""Share of the amplifier's voltage that the largest peak takes."""
SAMPLES_OF_HIGHEST = 4
MOST_SAMPLES = 1 << 25
"""Samples of one coil's turn that are held in memory."""
BLOCK_SAMPLES = 1 << 16


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """Current and voltage of a coil's chirp or noise that shakes taxels for measuring, and their strength.

    `current_a`, `voltage_v` (samples,) are of one coil's turn; `coils` (row, column) in the order of the columns of
    `blocks`. `level_share` is how strongly taxels are shaken over their planned levels; `copper_loss_w` the mean of a
    turn. `between` is the least ratio of the largest sample to what is reached between samples: that of a sine of the
    highest frequency, which in a chirp is half the motion's.
    """

    kind: str
    rate_hz: int
    band_hz: tuple[float, float]
    sweep_s: float
    together: bool
    coils: tuple[tuple[int, int], ...]
    current_a: np.ndarray
    voltage_v: np.ndarray
    level_share: float
    copper_loss_w: float
    between: float

    @property
    def samples(self) -> int:
        """Number of samples of the whole excitation: one coil's, times the number of coils if they play in turn."""
        return len(self.current_a) * (1 if self.together else len(self.coils))

    @property
    def seconds(self) -> float:
        """Length of the whole excitation in s."""
        return self.samples / self.rate_hz

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield the voltages of all coils in V, in blocks (samples, coils)."""
        for k in range(1 if self.together else len(self.coils)):
            for start in range(0, len(self.voltage_v), BLOCK_SAMPLES):
                part = self.voltage_v[start : start + BLOCK_SAMPLES]
                block = np.zeros((len(part), len(self.coils)))
                block[:, slice(None) if self.together else slice(k, k + 1)] = part[:, None]
                yield block


def excitation(
    plan: Plan, kind: str, rate_hz: int, seconds: float | None = None, seed: int = 0, together: bool = False
) -> Excitation:
    """Return the chirp or noise (`kind`) that shakes the pad of `plan` while it is measured, sampled at `rate_hz`.

    `seconds` is the length of the chirp or the noise (None: as long as the slowest taxel asks for), to which the
    silence is added. `seed` is the noise's. `together` shakes all coils at once: quicker, and each taxel then hears its
    neighbours' coils too.

    Raises
    ------
    SpecError
        An unknown kind; a rate too low for the highest frequency; a length too short for the slowest taxel, or too long
        for memory; no washer that is pulled.
    """
    if kind not in KINDS:
        raise SpecError(f"must be one of {', '.join(KINDS)}, got {kind!r}", "--excite")
    amplifier = plan.spec.amplifier
    if kind == "noise" and plan.spec.blocked_by:
        raise SpecError(
            f"of noise has a constant part, which {plan.spec.blocked_by} does not pass; chirp has none", "--excite"
        )
    band = measuring_band_hz(plan)
    least = SAMPLES_OF_HIGHEST * band[1]
    if not rate_hz >= least:
        raise SpecError(
            f"must be at least {number(float(np.ceil(least)))} Hz, {SAMPLES_OF_HIGHEST} times the highest frequency"
            f" that is measured, got {number(rate_hz)} Hz",
            "--rate",
        )
    sweep = sweep_s(plan) if seconds is None else seconds
    shortest = max(c.q / c.resonance_hz for c in plan.channels)
    if not sweep >= shortest:
        raise SpecError(
            f"must be at least {at_least(shortest)} s, Q periods of the slowest taxel, got {number(sweep)} s",
            "--seconds",
        )
    if (sweep + ring_s(plan)) * rate_hz > MOST_SAMPLES:
        longest = MOST_SAMPLES / rate_hz - ring_s(plan)
        would_do = f"at most {number(longest)} s would do" if longest > shortest else "a lower --rate would do"
        raise SpecError(
            f"{number(sweep)} s of sweep are too many samples at {number(rate_hz)} Hz; {would_do}", "--seconds"
        )
    line = shaking_line_a2(plan)
    order = plan.spec.force_order
    swept = round(sweep * rate_hz)
    total = round((sweep + ring_s(plan)) * rate_hz)
    if kind == "chirp":
        time = np.arange(total) / rate_hz
        current, slope = chirp_current_a(time, swept / rate_hz, band, line, order)
    else:
        q = float(np.median([channel.q for channel in plan.channels]))
        silence = (0, total - swept)
        noise = noise_current_a(swept, rate_hz, band, line, q, seed, order)
        current, slope = (np.pad(part, silence) for part in noise)
    coil = plan.spec.coil
    volts = coil.resistance_ohm * current + coil.inductance_mh * MH * slope
    volts = _corrected_for_high_pass(volts, plan.spec.corner_hz, rate_hz)
    between = cos(pi * band[1] / (order if kind == "chirp" else 1) / rate_hz)
    square = float((current[:swept] ** 2).mean())
    headroom = plan.spec.drive.headroom
    planned = max(
        mean_square_a2(plan.scheme, np.array([c.line_a2 for c in channel_set]), headroom) for channel_set in plan.sets
    )
    share = min(
        1.0,
        (min(VOLTAGE_SHARE, between) * plan.spec.drive.voltage_limit_v / float(np.abs(volts).max())) ** 2,
        coil.power_limit_w / (square * coil.resistance_ohm),
        (VOLTAGE_SHARE * amplifier.current_a / float(np.abs(current).max())) ** 2 if amplifier else 1.0,
        max(planned / square, 1e-6),
    )
    factor = share**0.5
    places = tuple((row, column) for row in range(plan.coils.rows) for column in range(plan.coils.columns))
    loss_w = share * square * swept / total * coil.resistance_ohm
    current = current * factor
    volts = volts * factor
    return Excitation(
        kind, rate_hz, band, swept / rate_hz, together, places, current, volts, factor**order, loss_w, between
    )


def _corrected_for_high_pass(volts: np.ndarray, corner_hz: float, rate_hz: int) -> np.ndarray:
    """Return periodic `volts` (n,) pre-corrected for a high-pass of corner f_h: spectral lines times ``1 − j f_h/f``.

    The mean, which no high-pass passes, is left out.
    """
    if not corner_hz:
        return volts
    spectrum = np.fft.rfft(volts)
    hz = np.fft.rfftfreq(len(volts), 1 / rate_hz)
    spectrum[0] = 0.0
    spectrum[1:] *= 1 - 1j * corner_hz / hz[1:]
    return np.fft.irfft(spectrum, len(volts))


SWEEP_ROWS = 65
SHORTEST_S = 0.1
"""Rows of the firmware's table, and the length in s of a silent sweep."""


@dataclass(frozen=True, slots=True, eq=False)
class FirmwareSweep:
    """Sweep played by the firmware: frequency `hz` and amplitude `volts` of its voltage, at equally spaced times."""

    seconds: float
    hz: np.ndarray
    volts: np.ndarray

    def voltage_v(self, rate_hz: float) -> np.ndarray:
        """Return the sweep's voltage (n,) sampled at `rate_hz`, frequency and amplitude interpolated linearly."""
        at = np.arange(ceil(self.seconds * rate_hz)) / (self.seconds * rate_hz) * (len(self.hz) - 1)
        rows = np.arange(len(self.hz))
        hz = np.interp(at, rows, self.hz)
        turns = (np.cumsum(hz) - hz) / rate_hz
        return np.asarray(np.interp(at, rows, self.volts) * np.sin(2 * np.pi * turns))


def sweep_table(plan: Plan) -> FirmwareSweep:
    """Return the sweep that the firmware plays to measure one coil's taxels, as strong as the chirp of `excitation`.

    It is silent where nothing can be measured.
    """
    low, high = measuring_band_hz(plan)
    try:
        share = excitation(plan, "chirp", ceil(SAMPLES_OF_HIGHEST * high)).level_share
        hz = np.geomspace(low, high, SWEEP_ROWS)
        line = share * shaking_line_a2(plan)(hz)
    except SpecError:
        return FirmwareSweep(SHORTEST_S, np.zeros(2), np.zeros(2))
    coil = plan.spec.coil
    order = plan.spec.force_order
    ohms = np.hypot(coil.resistance_ohm, 2 * np.pi * hz / order * coil.inductance_mh * MH)
    current_a = line if order == 1 else np.sqrt(2 * line)
    fade = np.clip(np.minimum(np.arange(SWEEP_ROWS), np.arange(SWEEP_ROWS)[::-1]) / 4, 0, 1)
    return FirmwareSweep(sweep_s(plan), hz / order, ohms * current_a * fade)
