"""`PadDrive`: spectral lines that drive each coil of a planned or measured pad, and coil voltages along a `Timeline`.

Frequencies lie on a *comb*, whole multiples of 1/period, so that what is written can be looped without a seam and the
smallest constant of a spur-free force is known for all times. A line that the comb moves off its taxel's resonance is
made as much larger as the taxel answers less there.

A `Timeline` has the levels of all taxels in time. A level is a share of a taxel's ON amplitude, and of its line of i².
Between two keyframes the force is blended from one's to the other's by a smooth step, so that switching neither clicks
nor shakes a taxel that stays OFF: the step is of ninth degree, flat to the fourth derivative at both ends, and as long
as `ramp_s` says. For a force ``F = Σ g_j A_j cos(2π r_j t + φ_j)`` with levels g and a current through R and L,

===========  ==================================================  ================================
scheme       current                                             between keyframes
===========  ==================================================  ================================
spur-free    √(F₀ + F); on a carrier √(2 (F₀ + F)) cos 2πf_c t   F₀ + F blended: both are ≥ 0
tones        Σ √(2 g_j A_j) cos(π r_j t + φ_j/2)                 g blended; so time-shared
biased       B + Σ g_j A_j/(2B) cos(2π r_j t + φ_j)              g blended; B from and to 0 by √b
===========  ==================================================  ================================

A level below 0, as a brake has it, is the line in counter-phase; a tone of the current is then a quarter of its period
late. Each taxel also has a sign, times which its level counts. One that turns over between two keyframes passes
through 0: a tone goes down over the first half of the transition and comes up over the second, so that no blend of
tones leads through 0. The voltage is ``R i + L di/dt`` with the analytic slope, the blend's too.

Where a sound card has a high-pass of corner f_h, the file has what comes out of it as that voltage u:
``u + 2π f_h ∫ u dt``, which is each line at f times ``1 − j f_h/f``; on a carrier, all lines as the carrier's. In a
transition the integral is taken to have the line's envelope: that is off by a share f_h/f of the envelope's own lines
at f, which the smooth step has next to none of.

Phases count from the beginning of the file through all frames, in whole samples modulo the comb's period: they are as
exact after an hour as at first.

Coils of the same frequencies are one matrix product: ``cos(ω(c + f) + φ)`` for c whole rows and f in a row splits into
a table (row, 2n) that never changes and weights (2n, coils) that turn by one angle a row.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise, product
from math import ceil, floor
from typing import NamedTuple

import numpy as np

from padgen.core.errors import SpecError, at_least, number, plural
from padgen.core.units import MH, MS
from padgen.measured.tuning import Tuning, levels_um, played_tuning, spec_at_coil_temperature
from padgen.physics.crest import (
    ALIAS_DB,
    SHORTEST_S,
    RootMargin,
    comb_period_s,
    least_constant,
    low_crest_phases,
    on_comb,
    root_margin,
)
from padgen.physics.resonator import relative_energy, ring_up_time
from padgen.physics.schemes import bias_a, current_lines_a
from padgen.physics.selectivity import Scheme
from padgen.physics.switching import Brake, blend, blend_slope, keyframes
from padgen.planner.drive_scheme import switch_brake, switch_ms
from padgen.planner.plan import CARRIER_OVER_RESONANCE, Plan
from padgen.planner.plan import carrier_hz as planned_carrier_hz
from padgen.planner.printed_pads import coils_of

__all__ = [
    "BLOCK",
    "CONTROLLER_RATES_HZ",
    "HIGHEST_RATE_HZ",
    "RATES_HZ",
    "RATE_OVER_RESONANCE",
    "SECONDS",
    "CoilDrive",
    "PadDrive",
    "Timeline",
    "bias_flows_at",
    "blend",
    "blend_slope",
    "blocks",
    "brake_of",
    "braked_s",
    "coil_lines",
    "constant_a2",
    "drive_at",
    "edges",
    "frame_s",
    "highest_hz",
    "make_drive",
    "ramp_s",
    "sample_count",
    "steady",
    "taus_s",
    "timeline",
    "volts",
]

HIGHEST_RATE_HZ = 1_000_000
RATE_OVER_RESONANCE = 8
"""Samples in a period of the highest resonance: the fewest."""


@dataclass(frozen=True, slots=True, eq=False)
class CoilDrive:
    """Lines of i² that drive the taxels over one coil: frequency, amplitude and phase (n,), the lowest channel first.

    `taxels` are indices into the plan's. A taxel at level 1 gets the line ``line_a2 cos(2π force_hz t + phase_rad)``
    of i²; `force_hz` is ``harmonic / period``. `bias_a` is the constant current of the biased scheme, else 0;
    `margin` the share of its line that each channel adds to the smallest constant, spur-free, else 0.
    """

    row: int
    column: int
    taxels: np.ndarray
    force_hz: np.ndarray
    harmonic: np.ndarray
    line_a2: np.ndarray
    phase_rad: np.ndarray
    bias_a: float
    margin: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class PadDrive:
    """The drive of a pad: its scheme, and its coils, row by row, with lines at whole multiples of 1/`period_s`.

    `rate_hz` is that of the samples; a period is a whole number of them. `resistance_ohm`, `inductance_h`
    are each coil's. With a `carrier_hz` (spur-free only) the current is ``√(2F) cos(2π carrier_hz t)``, for amplifiers
    that pass no constant. `alias_db` is what the voltage has above the amplifier's band over its largest line, the
    worst of all coils; None but for spur-free. `corner_hz` is that of the sound card's high-pass, which what is written
    makes good; 0 where there is none.
    """

    scheme: Scheme
    rate_hz: int
    period_s: float
    resistance_ohm: float
    inductance_h: float
    voltage_limit_v: float
    coils: tuple[CoilDrive, ...]
    carrier_hz: float | None
    alias_db: float | None
    corner_hz: float = 0.0

    @property
    def period_samples(self) -> int:
        """Number of samples in `period_s`, after which all lines of the drive repeat."""
        return round(self.period_s * self.rate_hz)

    @property
    def has_constant(self) -> bool:
        """True where the amplifier must pass a part at 0 Hz."""
        return self.scheme.has_constant and self.carrier_hz is None

    def high_pass_correction(self, hz: np.ndarray) -> np.ndarray:
        """Return the complex factors that pre-correct lines at `hz` for the sound card's high-pass.

        On a carrier, those of the carrier: lines lie about it on both sides, so near that their factors differ by less
        than 1e-2 (`tests/driver/test_sound_cards.py`).
        """
        lines_hz = np.asarray(hz, float) if self.carrier_hz is None else np.full(np.shape(hz), self.carrier_hz)
        return np.asarray(1 - 1j * self.corner_hz / lines_hz)


def coil_lines(drive: PadDrive, coil: CoilDrive) -> tuple[np.ndarray, np.ndarray]:
    """Return harmonics and complex amplitudes (n,) of the lines of a coil's current in A or, spur-free, of i² in A².

    They are harmonics and complex amplitudes (n,), ``Re amplitude exp(2πi harmonic t / period)`` at level 1. They go
    with the level; where the scheme has no constant, with its root, at half the force's frequency.
    """
    height = coil.line_a2 if drive.scheme.is_root else current_lines_a(drive.scheme, coil.line_a2)
    if drive.scheme.at_resonance:
        return coil.harmonic, height * np.exp(1j * coil.phase_rad)
    return coil.harmonic // 2, height * np.exp(0.5j * coil.phase_rad)


def constant_a2(coil: CoilDrive, levels: np.ndarray) -> np.ndarray:
    """Return the constant part (s,) of i² of a spur-free coil with its channels at `levels` (s, n)."""
    lines = np.atleast_2d(levels) * coil.line_a2
    states, which = np.unique(lines, axis=0, return_inverse=True)
    least = least_constant(coil.harmonic, states, coil.phase_rad)
    return np.asarray((least + np.abs(states) @ coil.margin)[which.reshape(-1)])


def make_drive(plan: Plan, rate_hz: int, tuning: Tuning | None = None, carrier_hz: float | None = None) -> PadDrive:
    """Make the drive of `plan`, for the print that `tuning` describes (None: as planned), sampled at `rate_hz`.

    The comb's period is the shortest that moves no line far off its resonance; a carrier is moved onto the comb.

    Raises
    ------
    SpecError
        `rate_hz` is too low for the highest line of the current, a carrier is outside its bounds, or a coil cannot move
        a taxel.
    """
    tuning = played_tuning(plan, tuning)
    spec = spec_at_coil_temperature(plan, tuning.coil_c)
    scheme = plan.scheme
    known = np.array([(taxel.resonance_hz, taxel.q, taxel.response_um_per_a2) for taxel in tuning.taxels])
    resonance, q, response = known.T
    highest_hz = float(resonance.max())
    lowest_rate = ceil(RATE_OVER_RESONANCE * highest_hz)
    if not lowest_rate <= rate_hz <= HIGHEST_RATE_HZ:
        raise SpecError(
            f"must be {lowest_rate} … {HIGHEST_RATE_HZ} Hz, {RATE_OVER_RESONANCE} times the highest resonance or"
            f" more, got {number(rate_hz)} Hz",
            "--rate",
        )
    # A tone of the current at half the force's frequency must fit the period too.
    step = 1 if scheme.at_resonance else 2
    period_s = comb_period_s(resonance, q, step, rate_hz)
    harmonic = on_comb(resonance, period_s, step)
    if carrier_hz is not None:
        carrier_hz = _carrier_hz(carrier_hz, scheme, rate_hz, period_s, highest_hz)
    band_hz = min(rate_hz / 2, spec.drive.bandwidth_hz or rate_hz / 2)
    unmoved = [taxel.id for taxel in tuning.taxels if not taxel.response_um_per_a2 > 0]
    if unmoved:
        raise SpecError(f"{unmoved[0]} is not pulled by its coil and cannot be driven", plan.name)
    force_hz = harmonic / period_s
    line_a2 = levels_um(plan, resonance) / response / np.sqrt(relative_energy(force_hz, resonance, q))

    @cache
    def shaped(harmonics: tuple[int, ...], lines: tuple[float, ...]) -> tuple[np.ndarray, RootMargin]:
        """Return the phases (n,) of a coil's lines and the margin of its constant, cached for coils that are alike."""
        k = np.array(harmonics, int)
        line = np.array(lines)
        if scheme.at_resonance:
            phase = low_crest_phases(k, line) if len(k) else np.zeros(0)
        else:  # a tone's phase in i² is twice the current's
            alone = scheme.takes_turns or not len(k)
            phase = np.zeros(len(k)) if alone else 2 * low_crest_phases(k // 2, np.sqrt(line))
        if not scheme.is_root or not len(k):
            return phase, RootMargin(np.zeros(len(k)), -np.inf, 0.0, 1.0)
        return phase, root_margin(
            k,
            line,
            phase,
            period_s=period_s,
            rate_hz=rate_hz,
            resistance_ohm=spec.coil.resistance_ohm,
            inductance_h=spec.coil.inductance_mh * MH,
            voltage_limit_v=spec.drive.voltage_limit_v,
            # How far the root's lines may reach: about a carrier they go to both sides.
            bandwidth_hz=band_hz if carrier_hz is None else max(min(band_hz - carrier_hz, carrier_hz), 1.0),
            # More of it would heat the coil and pull the washers by more than the plan was judged by.
            most_constant=1 + spec.drive.headroom,
        )

    coils = []
    alias_db = []
    taxels_of = coils_of(plan)
    for place in product(range(plan.coils.rows), range(plan.coils.columns)):
        taxels = np.array(taxels_of.get(place, ()), int)  # the lowest channel first
        k = harmonic[taxels]
        line = line_a2[taxels]
        phase, margin = shaped(tuple(k.tolist()), tuple(line.tolist()))
        bias = bias_a(scheme, line) if scheme.is_biased and len(taxels) else 0.0
        coils.append(CoilDrive(*place, taxels, force_hz[taxels], k, line, phase, bias, margin.share))
        alias_db.append(margin.alias_db)
    return PadDrive(
        scheme,
        rate_hz,
        period_s,
        spec.coil.resistance_ohm,
        spec.coil.inductance_mh * MH,
        spec.drive.voltage_limit_v,
        tuple(coils),
        carrier_hz,
        max(alias_db) if scheme.is_root else None,
        spec.corner_hz,
    )


def _carrier_hz(carrier_hz: float, scheme: Scheme, rate_hz: int, period_s: float, highest_hz: float) -> float:
    if not scheme.is_root:
        raise SpecError(f"is for the spur-free drive only, this one is {scheme.name!r}", "--carrier")
    lowest = CARRIER_OVER_RESONANCE * highest_hz
    highest = rate_hz / 2 - CARRIER_OVER_RESONANCE * highest_hz
    # Those on the comb within the bounds: one that was moved there is accepted again, and stays where it is.
    first = ceil(lowest * period_s * (1 - ROUNDING))
    last = floor(highest * period_s * (1 + ROUNDING))
    if first > last:
        enough_hz = 4 * lowest + 2 / period_s
        raise SpecError(f"needs a rate of at least {at_least(enough_hz)} Hz, got {number(rate_hz)} Hz", "--carrier")
    if not lowest * (1 - ROUNDING) <= carrier_hz <= highest * (1 + ROUNDING):
        raise SpecError(
            f"must be {at_least(lowest)} … {number(floor(highest))} Hz, {CARRIER_OVER_RESONANCE} times the highest"
            f" resonance away from 0 and from half the rate, got {number(carrier_hz)} Hz",
            "--carrier",
        )
    return min(max(round(carrier_hz * period_s), first), last) / period_s


ROUNDING = 1e-12
"""Relative rounding of a frequency that is a whole number of periods."""
RATES_HZ = (48_000, 96_000, 192_000)
"""Sample rates of sound cards; the first that suits the highest resonance and the root's bends is taken."""
CONTROLLER_RATES_HZ = (8_000, 12_000, 16_000, 24_000, 32_000, *RATES_HZ)
"""For a microcontroller, which makes every sample anew."""
SAMPLES_OF_HIGHEST = 16
"""Samples in a period of the highest resonance, at least, where the rate is ours to choose."""


def drive_at(
    plan: Plan,
    rates_hz: tuple[int, ...],
    rate_hz: int | None = None,
    tuning: Tuning | None = None,
    carrier_hz: float | None = None,
) -> PadDrive:
    """Make the drive of `plan` at `rate_hz`, or where that is None at the first of `rates_hz` that is high enough.

    `carrier_hz` None: on the carrier that the spec's amplifier needs, if it needs one.
    """
    highest = highest_hz(plan, tuning)
    if carrier_hz is None:
        carrier_hz = planned_carrier_hz(plan.spec, plan.scheme, highest)

    least = SAMPLES_OF_HIGHEST * highest
    if carrier_hz is not None:
        # One that no rate carries is refused with the bounds of the highest.
        beyond = carrier_hz + CARRIER_OVER_RESONANCE * highest + 1 / SHORTEST_S
        least = max(least, min(2 * beyond, max(*rates_hz, least)))
    enough = [rate for rate in rates_hz if rate >= least] or [ceil(least / 1000) * 1000]
    for rate in enough if rate_hz is None else [rate_hz]:
        drive = make_drive(plan, rate, tuning, carrier_hz)
        if drive.alias_db is None or drive.alias_db <= ALIAS_DB:
            break
    return drive


def highest_hz(plan: Plan, tuning: Tuning | None) -> float:
    """Return the highest resonance of the plan's channels, or of the print's taxels."""
    return max(taxel.resonance_hz for taxel in played_tuning(plan, tuning).taxels)


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """Keyframes: `time_s` (k,), rising from 0, and `levels` (k, taxels) in −1 … 1, taxels as in the plan.

    A level below 0 is a brake's. `loops` tells that the end leads over into the beginning; `frame_s` is how long each
    of the frames lasts that are shown one after the other, from 0 on, None where it is one state. `signs` (k, taxels)
    are those of the taxels' motion, +1 and −1 (`padgen.driver.signs`).
    """

    time_s: np.ndarray
    levels: np.ndarray
    loops: bool
    frame_s: float | None = None
    signs: np.ndarray | float = 1.0

    @property
    def signed(self) -> np.ndarray:
        """Levels (k, taxels) times signs of motion: factors on taxels' spectral lines, negative in counter-phase."""
        return self.levels * self.signs

    @property
    def seconds(self) -> float:
        """Length of the timeline in s."""
        return float(self.time_s[-1])


def frame_s(plan: Plan, brake: bool = False) -> float:
    """Return a frame's duration in s at the planned refresh rate, or with `brake` at the rate that braking allows."""
    rate = next(one for one in plan.refresh if one.scheme == plan.selectivity.drive)
    return 1 / (rate.braked_frames_per_s if brake and rate.braked_frames_per_s else rate.frames_per_s)


def ramp_s(plan: Plan) -> float:
    """Return a transition's duration in s between frames; if channels take turns, the least duration of half a turn."""
    return switch_ms(plan.channels, plan.coils.sets) * MS


def taus_s(plan: Plan, tuning: Tuning | None = None) -> np.ndarray:
    """Return the time constants (taxels,) of the taxels as planned, or of the print that `tuning` describes."""
    known = played_tuning(plan, tuning).taxels
    return np.array([ring_up_time(taxel.resonance_hz, taxel.q) for taxel in known])


def brake_of(plan: Plan, tuning: Tuning | None = None) -> Brake:
    """Return the brake, a stretch of drive in counter-phase, that stops every taxel of the plan or of a print.

    Raises
    ------
    SpecError
        The channels of a coil take turns: a taxel is driven in its own turn only.
    """
    if plan.scheme.takes_turns:
        raise SpecError(
            "is for drives that play all channels at once, this one takes turns: a taxel is not driven while it rings",
            "--brake",
        )
    return switch_brake(np.unique(taus_s(plan, tuning)), ramp_s(plan), plan.scheme)


def braked_s(plan: Plan, tuning: Tuning | None = None) -> float:
    """Return the duration in s of the shortest frame with a brake: transition in, hold of one brake step, brake."""
    brake = brake_of(plan, tuning)
    return ramp_s(plan) + brake.blend_s + brake.seconds


def steady(levels: np.ndarray, seconds: float, signs: np.ndarray | float = 1.0) -> Timeline:
    """Return a looping timeline of constant levels (taxels,), seamless if `seconds` are whole drive periods."""
    return Timeline(np.array([0.0, seconds]), np.stack([levels, levels]), True, signs=signs)


def timeline(
    plan: Plan,
    frames: np.ndarray,
    seconds_each: float | None = None,
    brake: bool = False,
    tuning: Tuning | None = None,
    signs: np.ndarray | float = 1.0,
) -> Timeline:
    """Return a timeline of frames (k, taxels) in a row, from silence to silence, with `signs` (k, taxels) of motion.

    `seconds_each` is a frame's length (None: by the planned refresh rate). Where the channels of a coil take
    turns, a frame is a slot for each channel, up over its one half and down over the other. With `brake`, taxels that
    go OFF are stopped at the end of their last frame, for the time constants of the print that `tuning` tells of.

    Raises
    ------
    SpecError
        No frame, a level that is not in 0 … 1, or frames too short for their transitions.
    """
    shape = np.shape(frames)
    frames = np.atleast_2d(np.asarray(frames, float))
    if frames.ndim != 2 or frames.shape[1] != len(plan.taxels) or not len(frames):
        raise SpecError(
            f"must be one or more rows of {len(plan.taxels)} levels, got {' x '.join(map(str, shape))}", "frames"
        )
    bad = np.argwhere(~((frames >= 0) & (frames <= 1)))
    if len(bad):
        frame, taxel = bad[0]
        raise SpecError(
            f"levels must be in 0 … 1, got {number(float(frames[frame, taxel]))} for {plan.taxels[taxel].id} in frame"
            f" {frame}",
            "frames",
        )
    if seconds_each is not None and not (np.isfinite(seconds_each) and seconds_each > 0):
        raise SpecError(f"must be above 0 s for a frame, got {number(seconds_each)} s", SECONDS)
    if plan.scheme.takes_turns and not brake:
        return _in_turns(plan, frames, seconds_each, signs)
    ramp = ramp_s(plan)
    length = seconds_each or frame_s(plan, brake)
    stop = None
    why = "to switch in"
    least = ramp
    if brake:
        stop = brake_of(plan, tuning)
        least = braked_s(plan, tuning)
        why = "to be switched in, held and braked"
        length = length if seconds_each else max(length, least)
    if length < least * (1 - 1e-12):
        raise SpecError(
            f"a frame of {plan.name} needs at least {at_least(least)} s {why}, got {number(length)} s",
            SECONDS,
        )
    taus = taus_s(plan, tuning) if stop else None
    return _signed(*keyframes(frames, length, ramp, stop, taus, signs), length, frames, signs)


def _signed(
    time_s: np.ndarray, levels: np.ndarray, length: float, frames: np.ndarray, signs: np.ndarray | float
) -> Timeline:
    """Return the timeline with `levels` at `time_s`, where each frame of `length` s has its own `signs` (k, n)."""
    frame = np.ceil(time_s / length - 1e-9).astype(int) - 1
    of_frames = np.broadcast_to(signs, frames.shape)
    return Timeline(time_s, levels, False, length, of_frames[np.clip(frame, 0, len(frames) - 1)])


def _in_turns(plan: Plan, frames: np.ndarray, seconds_each: float | None, signs: np.ndarray | float = 1.0) -> Timeline:
    order = {channel.index: k for channel_set in plan.sets for k, channel in enumerate(channel_set)}
    turn = np.array([order[taxel.channel] for taxel in plan.taxels])
    slots = len(plan.sets[0])
    slot = (seconds_each or frame_s(plan)) / slots
    if slot < 2 * ramp_s(plan) * (1 - 1e-12):
        raise SpecError(
            f"a frame of {plan.name} needs at least {at_least(2 * ramp_s(plan) * slots)} s for {slots}"
            f" channel{plural(slots)} in turn, got {number(slot * slots)} s",
            SECONDS,
        )
    times = np.arange(2 * slots * len(frames) + 1) * slot / 2
    levels = np.zeros((len(times), frames.shape[1]))
    for k, frame in enumerate(frames):
        for s in range(slots):
            levels[2 * (k * slots + s) + 1] = np.where(turn == s, frame, 0.0)
    return _signed(times, levels, slot * slots, frames, signs)


SECONDS = "--seconds"
"""The option that asks for a frame's length, as refusals name it."""
BLOCK = 1 << 17
"""Numbers in a block, samples times coils: what stays in a core's cache."""
ROW = 256
"""Samples in a row of the table."""
SMALLEST = 1e-300
"""A force's square root is taken of no less: at silence its slope is then 0, not 0/0."""


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Coils (m,) that share their frequencies, with their taxels (m, n) and each taxel's line at level 1.

    `weight` (m, n) are complex amplitudes of the sum that is formed: of i², or of the current. `harmonic` (n,) are
    the sum's frequencies in 1/period, `table` (row, 2n + 1) cosines, sines and ones over a row. All is scaled to the
    voltage at the coil's resistance (its square, spur-free); `tau_s` is L/R, 0 for a current. What makes good a sound
    card's high-pass of corner ω adds ωL/R to each current's factor of 1, which is then `lift`, and ``−ω/ω_j`` to its
    `slope`.
    """

    coils: np.ndarray
    taxels: np.ndarray
    weight: np.ndarray
    harmonic: np.ndarray
    table: np.ndarray
    slope: np.ndarray
    gain: float
    tau_s: float
    lift: float
    bias: np.ndarray
    constant: np.ndarray


class _Stretch(NamedTuple):
    """Samples from `start` to before `stop` between keyframe `key` and the next."""

    start: int
    stop: int
    key: int


def volts(drive: PadDrive, timeline: Timeline, signal: str = "voltage") -> Iterator[np.ndarray]:
    """Yield blocks (samples, coils) of coil voltages in V, or of currents in A if `signal` is 'current'."""
    return (samples for samples, _ in blocks(drive, timeline, signal))


def sample_count(drive: PadDrive, timeline: Timeline) -> int:
    """Return the number of samples of the whole timeline."""
    return round(timeline.seconds * drive.rate_hz)


def blocks(
    drive: PadDrive, timeline: Timeline, signal: str = "voltage", periods: bool = False
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield blocks of samples (s, coils), in V or A, and each coil's sum (coils,) of i² over them in A².

    `signal` is 'voltage' or 'current'. Blocks follow each other without a gap; with `periods`, only the first period of
    the comb is made of levels that stay, since all others are the same.
    """
    coils = len(drive.coils)
    size = max(BLOCK // coils // ROW, 2) * ROW
    groups = list(_groups(drive, timeline, signal))
    form = _FORMS[drive.scheme.kind.CURRENT]
    for key, (first, last) in enumerate(pairwise(edges(drive, timeline))):
        end = last
        if periods and np.array_equal(*timeline.signed[key : key + 2]):
            end = min(last, first + drive.period_samples)
        for start in range(first, end, size):
            stop = min(start + size, end)
            samples = np.zeros((stop - start, coils))
            square = np.zeros(coils)
            for group in groups:
                part = form(drive, timeline, group, _Stretch(start, stop, key))
                if part is not None:
                    samples[:, group.coils], square[group.coils] = part
            yield samples, square


def _groups(drive: PadDrive, timeline: Timeline, signal: str) -> Iterator[_Group]:
    """Put coils with the same frequencies together; those without a taxel are in none and stay silent."""
    gain = drive.resistance_ohm if signal == "voltage" else 1.0
    tau_s = drive.inductance_h / drive.resistance_ohm if signal == "voltage" else 0.0
    alike: dict[tuple[int, ...], list[int]] = {}
    for index, coil in enumerate(drive.coils):
        if len(coil.taxels):
            alike.setdefault(tuple(coil.harmonic.tolist()), []).append(index)
    for members in alike.values():
        coils = [drive.coils[index] for index in members]
        lines = [coil_lines(drive, c) for c in coils]
        k = lines[0][0]
        weight = gain * np.stack([amplitude for _, amplitude in lines])
        bias = np.array([c.bias_a for c in coils])
        taxels = np.stack([c.taxels for c in coils])
        constant = np.zeros((0, len(coils)))
        if drive.scheme.is_root:
            weight = gain * weight
            levels = timeline.signed[:, taxels]
            constant = gain**2 * np.stack([constant_a2(c, levels[:, m]) for m, c in enumerate(coils)], 1)
        angle = 2 * np.pi * k / drive.period_samples * (np.arange(ROW) % drive.period_samples)[:, None]
        table = np.concatenate([np.cos(angle), np.sin(angle), np.ones((ROW, 1))], 1)
        omega = 2 * np.pi * k / drive.period_s
        lift = 1.0
        slope = omega * tau_s
        if drive.corner_hz and not drive.scheme.is_root:
            corner = 2 * np.pi * drive.corner_hz
            slope = slope - corner / omega
            lift += corner * tau_s
        yield _Group(np.array(members), taxels, weight, k, table, slope, gain, tau_s, lift, gain * bias, constant)


def edges(drive: PadDrive, timeline: Timeline) -> list[int]:
    """Return the index of the first sample at or after each keyframe; for the last keyframe the number of samples."""
    edge = np.ceil(np.round(timeline.time_s * drive.rate_hz, 6)).astype(int)
    return [*edge[:-1].tolist(), sample_count(drive, timeline)]


def _ramp(drive: PadDrive, timeline: Timeline, where: _Stretch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return, at each sample, weights (s, 1) of the keyframe before and the one after; the latter's slope in 1/s."""
    return _ramp_between(drive, where, timeline.time_s[where.key], timeline.time_s[where.key + 1])


def _ramp_between(
    drive: PadDrive, where: _Stretch, begin: float, end: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    share = (np.arange(where.start, where.stop) / drive.rate_hz - begin) / (end - begin)
    share = np.clip(share, 0.0, 1.0)[:, None]
    # 1 − b(s) is b(1 − s), which keeps its digits where it is small: its root is taken.
    return blend(1 - share), blend(share), blend_slope(share) / (end - begin)


def _sums(
    drive: PadDrive, group: _Group, where: _Stretch, weight: np.ndarray, constant: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return ``constant + Re Σ w_j exp(iω_j t)`` (s, m) for weights (m, n), and ``Re Σ i s_j w_j exp(iω_j t)``.

    s_j is `group.slope`; the second sum is zeros (1, 1) where all s_j are 0.
    """
    count = where.stop - where.start
    n = len(group.harmonic)
    rows = -(-count // ROW)
    period = drive.period_samples
    first = (where.start + ROW * np.arange(rows)) % period
    turn = np.exp(2j * np.pi / period * ((first[:, None] * group.harmonic) % period))
    turned = turn[:, :, None] * weight.T
    level = np.broadcast_to(constant, (rows, 1, len(weight)))
    value = np.matmul(group.table, np.concatenate([turned.real, -turned.imag, level], 1))
    value = value.reshape(rows * ROW, -1)[:count]
    if not group.slope.any():
        return value, np.zeros((1, 1))
    turned *= group.slope[:, None]
    slope = np.matmul(group.table[:, : 2 * n], np.concatenate([-turned.imag, -turned.real], 1))
    return value, slope.reshape(rows * ROW, -1)[:count]


Part = tuple[np.ndarray, np.ndarray] | None


def _levels(timeline: Timeline, group: _Group, key: int) -> tuple[np.ndarray, np.ndarray]:
    """Return levels with their signs (m, n) at a keyframe and at the next."""
    before, after = timeline.signed[key : key + 2]
    return before[group.taxels], after[group.taxels]


def _blended(
    drive: PadDrive,
    timeline: Timeline,
    group: _Group,
    where: _Stretch,
    constant: tuple[np.ndarray | float, np.ndarray | float],
) -> tuple[np.ndarray, np.ndarray]:
    """Return a group's sum of lines and constant, blended between keyframes, and the sum's time derivative times L/R.

    With a sound card's corner the second also has the high-pass correction (`group.slope`).
    """
    before, after = _levels(timeline, group, where.key)
    if np.array_equal(before, after):
        return _sums(drive, group, where, before * group.weight, constant[0])
    falling, rising, steepness = _ramp(drive, timeline, where)
    value = np.zeros((1, 1))
    slope = np.zeros((1, 1))
    for levels, settled, share, sign in ((before, constant[0], falling, -1), (after, constant[1], rising, 1)):
        if levels.any() or np.any(settled):
            part, part_slope = _sums(drive, group, where, levels * group.weight, settled)
            slope = slope + (part_slope * share + part * (sign * group.tau_s * steepness))
            value = value + part * share
    return value, slope


def _spur_free(drive: PadDrive, timeline: Timeline, group: _Group, where: _Stretch) -> Part:
    if not timeline.levels[where.key : where.key + 2, group.taxels].any():
        return None
    constant = group.constant[where.key], group.constant[where.key + 1]
    force, slope = _blended(drive, timeline, group, where, constant)
    square = force.sum(0) / group.gain**2
    root = np.sqrt(np.maximum(force, SMALLEST, out=force), out=force)
    slope = slope / (2 * root)
    if drive.carrier_hz is None:
        return root + slope, square
    harmonic = round(drive.carrier_hz * drive.period_s)
    period = drive.period_samples
    angle = 2 * np.pi / period * ((np.arange(where.start, where.stop) % period * harmonic) % period)[:, None]
    turned = np.sqrt(2) * np.exp(1j * angle) * drive.high_pass_correction(np.array(drive.carrier_hz))
    cosine, sine = turned.real, turned.imag
    turn: np.ndarray = cosine - 2 * np.pi * drive.carrier_hz * group.tau_s * sine
    return root * turn + slope * cosine, square


def _biased(drive: PadDrive, timeline: Timeline, group: _Group, where: _Stretch) -> Part:
    fed = bias_flows_at(timeline, where.key), bias_flows_at(timeline, where.key + 1)
    if fed == (True, True):
        value, slope = _blended(drive, timeline, group, where, (group.bias, group.bias))
    elif not any(fed):
        return None
    else:
        # i² rises with the blend b as a whole, so that both it and its root are smooth.
        levels = _levels(timeline, group, where.key)[fed.index(True)]
        value, slope = _sums(drive, group, where, levels * group.weight, group.bias)
        falling, rising, steepness = _ramp(drive, timeline, where)
        root = np.sqrt(rising if fed[1] else falling)
        root_slope = (1 if fed[1] else -1) * group.tau_s * steepness / (2 * np.maximum(root, SMALLEST))
        value, slope = value * root, slope * root + value * root_slope
    return value + slope, np.einsum("sm,sm->m", value, value) / group.gain**2


def _linear(drive: PadDrive, timeline: Timeline, group: _Group, where: _Stretch) -> Part:
    if not timeline.levels[where.key : where.key + 2, group.taxels].any():
        return None
    value, slope = _blended(drive, timeline, group, where, (0.0, 0.0))
    return group.lift * value + slope, np.einsum("sm,sm->m", value, value) / group.gain**2


def bias_flows_at(timeline: Timeline, key: int) -> bool:
    """Return whether a biased drive's constant current is on at a keyframe; off at silent ends unless looped."""
    ends = key in (0, len(timeline.time_s) - 1)
    return timeline.loops or not ends or bool(timeline.levels[key].any())


def _tones(drive: PadDrive, timeline: Timeline, group: _Group, where: _Stretch) -> Part:
    before, after = _levels(timeline, group, where.key)
    if not (before.any() or after.any()):
        return None
    steady = before == after
    value, slope = _sums(drive, group, where, np.sqrt(np.abs(before)) * steady * _delayed_tones(group, before))
    for levels, settled, ramp in _blends(drive, timeline, where, before, after):
        falling, rising, steepness = ramp
        # i² is in counter-phase where the tone is a quarter of its own period late.
        turned = _delayed_tones(group, np.minimum(levels, settled))
        low = np.abs(levels)
        high = np.abs(settled)
        for j in np.flatnonzero((low != high).any(0)):
            one = (low != high) & (np.arange(low.shape[1]) == j)
            tone, tone_slope = _sums(drive, group, where, one * turned)
            envelope = np.sqrt(low[:, j] * falling + high[:, j] * rising)
            change = steepness * (high[:, j] - low[:, j])
            envelope_slope = group.tau_s * change / (2 * np.maximum(envelope, SMALLEST))
            value = value + tone * envelope
            slope = slope + tone_slope * envelope + tone * envelope_slope
    return group.lift * value + slope, np.einsum("sm,sm->m", value, value) / group.gain**2


def _delayed_tones(group: _Group, levels: np.ndarray) -> np.ndarray:
    """Return the tones' complex amplitudes (m, n), delayed by a quarter period where `levels` (m, n) are below 0."""
    return group.weight * np.where(levels < 0, -1j, 1)


def _blends(
    drive: PadDrive, timeline: Timeline, where: _Stretch, before: np.ndarray, after: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]]:
    """Yield parts of a transition in which no level (m, n) changes sign: levels before and after, and their weights.

    Levels that change sign go to 0 in the first half of the transition, and from there in the second.
    """
    turns = before * after < 0
    ramp = _ramp(drive, timeline, where)
    yield np.where(turns, 0.0, before), np.where(turns, 0.0, after), ramp
    if turns.any():
        begin = timeline.time_s[where.key]
        end = timeline.time_s[where.key + 1]
        middle = (begin + end) / 2
        silent = np.zeros(before.shape)
        yield np.where(turns, before, 0.0), silent, _ramp_between(drive, where, begin, middle)
        yield silent, np.where(turns, after, 0.0), _ramp_between(drive, where, middle, end)


Form = Callable[[PadDrive, Timeline, _Group, _Stretch], Part]
_FORMS: dict[str, Form] = {"root": _spur_free, "biased": _biased, "tones": _tones, "linear": _linear}
