"""Upper bounds on what a signal asks of coils and taxels, judged by all limits before it is written or played.

What is judged is what is shown (a timeline), or where that is not known the worst of whatever a host may send to the
firmware: a `Load`.

With levels g in 0 … 1 the voltage of a spur-free coil is ``u/√w``, u and w linear in g wherever the channels
keep their order by level (`group_constant` in ``padgen_drive.c``): ``u²/w`` is convex there, so that no grey level is
worse than an on/off state; and mean squares are linear. Between two frames the force is blended; what the blend's
slope adds is bounded.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from math import ceil, cos, inf, pi
from typing import NamedTuple

import numpy as np

from padgen.core.errors import Finding, SpecError, at_least, at_most, number
from padgen.core.rules import RuleBook
from padgen.core.units import COPPER_J_PER_M3_K, COPPER_OHM_M, MM
from padgen.driver.excitation import Excitation
from padgen.driver.waveform import (
    CONTROLLER_RATES_HZ,
    RATES_HZ,
    CoilDrive,
    PadDrive,
    Timeline,
    bias_flows_at,
    blocks,
    coil_lines,
    constant_a2,
    drive_at,
    highest_hz,
    make_drive,
    ramp_s,
    timeline,
)
from padgen.measured.tuning import Tuning, played_tuning, printed_channels, spec_at_coil_temperature
from padgen.physics.crest import least_constant
from padgen.physics.magnetics import impedance
from padgen.physics.schemes import current_lines_a, mean_square_a2, on_carrier_v
from padgen.physics.selectivity import SQUARE
from padgen.planner.limits import LOWER, SMALLEST_LEVEL_UM, Demand, MovingTaxel, exceeded
from padgen.planner.plan import CARRIER_OVER_RESONANCE, Plan
from padgen.spec import Coil

__all__ = [
    "HEAT_S",
    "SIGNAL_RULES",
    "Load",
    "Signal",
    "carrier_text",
    "channels_per_group",
    "channels_per_signed_group",
    "excitation_load",
    "judge_limits",
    "judge_load",
    "judge_warmth",
    "least_constants",
    "least_thermal_time_s",
    "load_of",
    "refuse_frames",
    "signed_constants",
]

PER_CYCLE = 32
"""Points in a cycle of the highest line where a peak is looked for."""
BETWEEN = 1 / cos(pi / PER_CYCLE)
"""Factor by which a sum of lines is larger between those points, at most (Ehlich and Zeller, Math. Z. 86 (1964) 41)."""
STEEPEST = 630 / 256
"""Largest slope of the blend between two frames, over one transition."""
MOST_CHANNELS = 12
"""Channels of a coil up to which all on/off states of a spur-free drive are looked at; beyond, they are bounded."""
MOST_POINTS = 1 << 27
"""Points of these that are looked at, the worst states first; the others are bounded."""
BLOCK = 1 << 15
"""Points that are worked on at a time: what stays in a core's cache."""
SMALLEST = 1e-100
GROUP_CHANNELS = 8
"""Channels whose on/off states have their least constants in a table: 256 numbers, 1 KiB, at most."""
SIGNED_CHANNELS = 4
"""The same for states off, on and in counter-phase: 81 numbers at most."""
ROUNDING = 1e-6
"""Largest rounding error of `least_constant`, relative to the sum of the lines."""
HEAT_S = 10.0
LEAST_HEAT_S = 0.01
"""Bounds of the time over which a coil's heat is averaged; what has less copper than for the latter is no coil."""
MOST_W_PER_M2K = 100.0
"""Heat that flows off a coil's surface, at most, in W/(m² K).

Still air takes at most 25 (Incropera et al., Fundamentals of Heat and Mass Transfer, 7th ed. 2011, table 1.1); through
the 0.2 to 0.3 mm of air between a coil and the lower half of its printed socket go 90 to 130.
"""


class Load(NamedTuple):
    """Largest voltage, current and mean i² that a signal asks of any coil, and the largest level of each taxel.

    `peak_v` in V and `peak_a` in A; mean i² in A² of the strongest state of each coil, `square_a2` (coils,), and of all
    coils together, `total_a2`; `warm_a2` (coils,), the steady i² that warms a coil as much (`_warm_a2`); `level`
    (taxels,) in 0 … 1. A peak is a bound wherever that keeps the limit, and within 3 % of what is put out where it
    does not.
    """

    peak_v: float
    peak_a: float
    square_a2: np.ndarray
    total_a2: float
    level: np.ndarray
    warm_a2: np.ndarray


class _Asked(NamedTuple):
    """Largest levels (n,) of a coil's channels, and largest mean i², `square_a2` (spur-free: constant part of i²)."""

    level: np.ndarray
    square_a2: float


def least_thermal_time_s(coil: Coil) -> float:
    """Return a lower bound, in s, of a coil's thermal time constant.

    It is what the copper stores over what the surface can give off. How much copper there is follows from resistance
    and wire length; it is no more than fits into the winding. Core and bobbin, which store more, are left out, and
    aluminium of that resistance would store more too. Shorter is safe: with first-order lags the heat of a slower
    coil is a weighted mean of the past heat of a quicker one, and no higher.
    """
    length = coil.length_mm * MM
    wire = coil.turns * coil.mean_turn_mm * MM
    copper = min(COPPER_OHM_M * wire**2 / coil.resistance_ohm, (coil.face_mm2 - coil.bore_mm2) * MM**2 * length)
    # Of a rectangular coil the sides of a box round it.
    around = 2 * sum(coil.sides_mm) * (pi / 4 if coil.shape == "round" else 1.0) * MM
    surface = around * length + 2 * coil.face_mm2 * MM**2
    return min(max(COPPER_J_PER_M3_K * copper / (MOST_W_PER_M2K * surface), LEAST_HEAT_S), HEAT_S)


def _warm_a2(coil: Coil, shown: Timeline, squares: np.ndarray) -> np.ndarray:
    """Return the steady i² (coils,) in A² that heats coils as much as the i² in `squares` (coils, keyframes) does.

    A coil may be as warm as it may ever be when the file begins, since another may have been played before. Its heat
    ``h' = (i² − h)/T`` then stays within a limit P/R if, from the beginning to any time t, the mean of i² weighted by
    ``exp(−(t − s)/T)`` does: the largest of these means. Through a transition i² counts as the larger of before and
    after, so that a state alone is judged as it is held. A loop is held for ever.
    """
    warmest = squares.max(1)
    if not shown.loops:
        heat = np.zeros(len(squares))
        weight = 0.0
        warmest = squares[:, 0]
        for key, share in enumerate(-np.expm1(-np.diff(shown.time_s) / least_thermal_time_s(coil))):
            heat += (squares[:, key : key + 2].max(1) - heat) * share
            weight += (1 - weight) * share
            warmest = np.maximum(warmest, heat / weight)
    return np.asarray(warmest)


def load_of(plan: Plan, drive: PadDrive, shown: Timeline | None = None) -> Load:
    """Return bounds on the coils' load under the timeline `shown`, or, if it is None, under any frames from a host."""
    ramp = ramp_s(plan) if shown is None else min(ramp_s(plan), _shortest_s(shown))
    if shown is None:
        asked = [_largest_demand(drive, coil) for coil in drive.coils]
        warm = np.array([asked_set.square_a2 for asked_set in asked])
        level = np.ones(len(plan.taxels))
        total_a2 = sum(warm.tolist())
    else:
        squares = np.stack([_squares_a2(drive, coil, shown) for coil in drive.coils])
        level = np.abs(shown.levels).max(0)
        total_a2 = float(squares.sum(0).max())
        warm = _warm_a2(plan.spec.coil, shown, squares)
        pairs = zip(drive.coils, squares.max(1).tolist(), strict=True)
        asked = [_Asked(level[coil.taxels], square_a2) for coil, square_a2 in pairs]
    each = list(zip(drive.coils, asked, strict=True))
    peak_v = max(_bound_v(drive, coil, asked_set, ramp) for coil, asked_set in each)
    if peak_v > drive.voltage_limit_v:
        peak_v = _shown_peak(drive, shown, "voltage") if shown is not None else _bound_any_levels_v(drive, ramp)
    peak_a = max(_bound_a(drive, coil, asked_set) for coil, asked_set in each)
    if shown is not None and peak_a > _limit_a(plan):
        # What is written for a sound card's high-pass is not what flows.
        peak_a = _shown_peak(replace(drive, corner_hz=0.0), shown, "current")
    return Load(peak_v, peak_a, np.array([asked_set.square_a2 for asked_set in asked]), total_a2, level, warm)


def _shortest_s(shown: Timeline) -> float:
    """Return the length in s of a timeline's shortest transition, a brake's included; inf where nothing changes."""
    lasts_s = np.diff(shown.time_s)
    changes = (np.diff(shown.levels, axis=0) != 0).any(1) & (lasts_s > 0)
    return float(lasts_s[changes].min(initial=inf))


def _limit_a(plan: Plan) -> float:
    return plan.spec.amplifier.current_a if plan.spec.amplifier else inf


def excitation_load(plan: Plan, played: Excitation) -> Load:
    """Return bounds on the coils' load during an excitation, with i² averaged over its sweep."""
    sweep = played.current_a[: round(played.sweep_s * played.rate_hz)]
    squares = np.full(len(played.coils), float((sweep**2).mean()))
    peak_v = float(np.abs(played.voltage_v).max(initial=0.0)) / played.between
    peak_a = float(np.abs(played.current_a).max(initial=0.0)) * BETWEEN
    total_a2 = float(squares.sum() if played.together else squares.max())
    return Load(peak_v, peak_a, squares, total_a2, np.full(len(plan.taxels), played.level_share), squares)


def _squares_a2(drive: PadDrive, coil: CoilDrive, timeline: Timeline) -> np.ndarray:
    """Return the mean of i² (k,) in A² that a coil has while the levels of each keyframe are held."""
    levels = timeline.signed[:, coil.taxels]
    if not len(coil.taxels):
        return np.zeros(len(levels))
    if drive.scheme.is_root:
        return constant_a2(coil, levels)
    if drive.scheme.is_biased:
        fed = np.array([bias_flows_at(timeline, key) for key in range(len(levels))])
        tones = levels * current_lines_a(drive.scheme, coil.line_a2)
        return np.asarray(fed * (coil.bias_a**2 + (tones**2).sum(1) / 2))
    if drive.scheme.force_order == 1:
        return np.asarray(levels**2 @ coil.line_a2**2 / 2)
    return np.asarray(np.abs(levels) @ coil.line_a2)


def _largest_demand(drive: PadDrive, coil: CoilDrive) -> _Asked:
    """Return the largest levels and mean square of the current that a host may ask of a coil."""
    level = np.ones(len(coil.line_a2))
    if drive.scheme.is_root:
        return _Asked(level, _largest_constant_a2(drive, coil) if len(level) else 0.0)
    return _Asked(level, mean_square_a2(drive.scheme, coil.line_a2, 0.0))


def _tones_v(drive: PadDrive, coil: CoilDrive) -> np.ndarray:
    """Return complex amplitudes (n,) in V of a coil's tones at level 1; the spur-free drive has no tones."""
    harmonic, amplitude = coil_lines(drive, coil)
    hz = harmonic / drive.period_s
    ohm = impedance(drive.resistance_ohm, drive.inductance_h, hz)
    return np.asarray(ohm * amplitude * drive.high_pass_correction(hz))


def _bound_v(drive: PadDrive, coil: CoilDrive, asked: _Asked, ramp: float) -> float:
    """Return an upper bound in V of a coil's voltage, in held states and in transitions of `ramp` seconds."""
    if not len(coil.taxels):
        return 0.0
    if drive.scheme.is_root:
        state = _root_bound_v(drive, coil, asked.level[None], np.array([asked.square_a2]))
        return float(state[0]) + _ramp_v(drive, coil, asked, ramp)
    share = asked.level if drive.scheme.goes_with_level else np.sqrt(asked.level)
    volts = np.abs(_tones_v(drive, coil)) * share
    steady = volts.max() if drive.scheme.takes_turns else volts.sum()
    return float(drive.resistance_ohm * coil.bias_a + steady) + _ramp_v(drive, coil, asked, ramp)


def _ramp_v(drive: PadDrive, coil: CoilDrive, asked: _Asked, ramp: float) -> float:
    """Return an upper bound in V of what a transition adds: L times peak current times steepest slope of a blend."""
    return drive.inductance_h * _bound_a(drive, coil, asked) * STEEPEST / ramp


def _bound_a(drive: PadDrive, coil: CoilDrive, asked: _Asked) -> float:
    """Bound a coil's current at all times: all its lines at their peaks at once."""
    if drive.scheme.is_root:
        square = asked.square_a2 + float(asked.level @ coil.line_a2)
        return float(np.sqrt(square if drive.carrier_hz is None else 2 * square))
    share = asked.level if drive.scheme.goes_with_level else np.sqrt(asked.level)
    tones = share * current_lines_a(drive.scheme, coil.line_a2)
    return float(coil.bias_a + (tones.max(initial=0.0) if drive.scheme.takes_turns else tones.sum()))


def _root_bound_v(drive: PadDrive, coil: CoilDrive, states: np.ndarray, constant_a2: np.ndarray) -> np.ndarray:
    """Return upper bounds (s,) in V of a spur-free coil's voltage in held `states` (s, n), by ``F'² ≤ 2 F max F''``.

    That holds for any force F ≥ 0.
    """
    lines = states * coil.line_a2
    root = np.sqrt(constant_a2 + lines.sum(1))
    slope = np.sqrt(lines @ (2 * np.pi * coil.force_hz) ** 2 / 2)
    volts: np.ndarray = drive.resistance_ohm * root + drive.inductance_h * slope
    if drive.carrier_hz is None:
        return volts
    correction = float(np.abs(drive.high_pass_correction(np.array(drive.carrier_hz))))
    return correction * on_carrier_v(volts, root, drive.inductance_h, drive.carrier_hz)


# ---- Peaks ---------------------------------------------------------------------------------------------------------


def _shown_peak(drive: PadDrive, timeline: Timeline, signal: str) -> float:
    """Return the peak voltage or current of a timeline, by oversampling, with a margin for peaks between samples."""
    highest_hz = max(float(coil.force_hz.max(initial=0.0)) for coil in drive.coils) + (drive.carrier_hz or 0.0)
    finer = int(np.ceil(PER_CYCLE * highest_hz / drive.rate_hz))
    fine = replace(drive, rate_hz=max(finer, 1) * drive.rate_hz)
    played = blocks(fine, timeline, signal=signal, periods=True)
    return max(float(np.abs(samples).max(initial=0.0)) for samples, _ in played) * BETWEEN


def _bound_any_levels_v(drive: PadDrive, ramp: float) -> float:
    """Return an upper bound in V of the coils' voltage under any levels that a host may send, changes included."""
    alike = {coil.harmonic.tobytes() + coil.line_a2.tobytes(): coil for coil in drive.coils if len(coil.taxels)}
    each = ((_bound_v(drive, c, _largest_demand(drive, c), ramp), key) for key, c in alike.items())
    bounds = sorted(each, reverse=True)
    peak = 0.0
    for bound, key in bounds:
        if bound > peak:
            coil = alike[key]
            peak = max(peak, _steady_v(drive, coil) + _ramp_v(drive, coil, _largest_demand(drive, coil), ramp))
    return peak


def _steady_v(drive: PadDrive, coil: CoilDrive) -> float:
    if drive.scheme.is_root:
        return _largest_spur_free_v(drive, coil)
    if drive.scheme.takes_turns:
        return float(np.abs(_tones_v(drive, coil)).max())
    harmonic, _ = coil_lines(drive, coil)
    above = np.zeros(1)
    below = np.zeros(1)
    # At each time the worst state has those channels on that push the same way.
    for k, amplitude in zip(harmonic.tolist(), _tones_v(drive, coil).tolist(), strict=True):
        angle = np.arange(_points(harmonic)) * (2 * np.pi * k / _points(harmonic))
        volts = abs(amplitude) * np.cos(angle + np.angle(amplitude))
        above = above + np.maximum(volts, 0.0)
        below = below + np.minimum(volts, 0.0)
    bias_v = drive.resistance_ohm * coil.bias_a
    return max(bias_v + BETWEEN * float(above.max()), -bias_v - BETWEEN * float(below.min()))


def _points(harmonic: np.ndarray) -> int:
    return 1 << (PER_CYCLE * int(harmonic.max()) - 1).bit_length()


def _largest_spur_free_v(drive: PadDrive, coil: CoilDrive) -> float:
    """Return the largest voltage in V of a spur-free coil in any on/off state; an upper bound for many channels."""
    count = len(coil.line_a2)
    if count > MOST_CHANNELS:
        largest = np.array([_largest_constant_a2(drive, coil)])
        return float(_root_bound_v(drive, coil, np.ones((1, count)), largest)[0])
    states = _states(count)
    constant = _constants_a2(drive, coil)
    bound = _root_bound_v(drive, coil, states, constant)
    order = np.argsort(-bound, kind="stable")
    points = _points(coil.harmonic)
    angle = np.outer(coil.harmonic, np.arange(points)) * (2 * np.pi / points) + coil.phase_rad[:, None]
    cosine = coil.line_a2[:, None] * np.cos(angle)
    sine = -(2 * np.pi * coil.force_hz * coil.line_a2)[:, None] * np.sin(angle)
    size = max(BLOCK // points, 1)
    peak = 0.0
    for start in range(0, len(order), size):
        part = order[start : start + size]
        if bound[part[0]] <= peak or start * points > MOST_POINTS:
            return max(peak, float(bound[part[0]]) if start * points > MOST_POINTS else 0.0)
        root = np.sqrt(np.maximum(constant[part, None] + states[part] @ cosine, SMALLEST))
        volts = drive.resistance_ohm * root + drive.inductance_h * (states[part] @ sine) / (2 * root)
        if drive.carrier_hz is not None:
            volts = on_carrier_v(volts, root, drive.inductance_h, drive.carrier_hz)
        peak = max(peak, BETWEEN * float(np.abs(volts[states[part].any(1)]).max(initial=0.0)))
    return peak


def _states(count: int) -> np.ndarray:
    """Return all on/off states (2ⁿ, n), the first channel changing fastest."""
    return np.asarray((np.arange(1 << count)[:, None] >> np.arange(count)) & 1, float)


def _group_constants_a2(drive: PadDrive, coil: CoilDrive) -> tuple[float, list[np.ndarray], int]:
    """Return the least constant of i² in A² with all channels on, those of each group's states, and the group size."""
    size = channels_per_group(max(len(c.taxels) for c in drive.coils))
    all_on, groups = least_constants(coil, size)
    return all_on, [np.array(group) for group in groups], size


def _constants_a2(drive: PadDrive, coil: CoilDrive) -> np.ndarray:
    """Return the constant (2ⁿ,) in A² that the firmware adds in each on/off state so that i² stays above its margin."""
    all_on, groups, size = _group_constants_a2(drive, coil)
    states = _states(len(coil.line_a2))
    which = np.arange(len(states))
    constant = sum(group[(which >> (size * k)) & (len(group) - 1)] for k, group in enumerate(groups))
    constant[-1] = all_on
    return np.asarray(constant + states @ (coil.margin * coil.line_a2))


def _largest_constant_a2(drive: PadDrive, coil: CoilDrive) -> float:
    """Return the largest constant part of i² in A² that the firmware adds in any state; a bound for many channels."""
    if len(coil.line_a2) <= MOST_CHANNELS:
        return float(_constants_a2(drive, coil).max())
    all_on, groups, _ = _group_constants_a2(drive, coil)
    return max(all_on, float(sum(group.max() for group in groups))) + float(coil.margin @ coil.line_a2)


def channels_per_group(channels: int) -> int:
    """Return the number of channels per group when split evenly into the fewest groups of at most `GROUP_CHANNELS`."""
    return ceil(channels / ceil(channels / GROUP_CHANNELS))


def least_constants(coil: CoilDrive, size: int) -> tuple[float, tuple[tuple[float, ...], ...]]:
    """Return least constants of i² in A² of a coil: with all channels on, and in each state of each group of `size`."""
    return _least_constants(*(tuple(part.tolist()) for part in (coil.harmonic, coil.line_a2, coil.phase_rad)), size)


@lru_cache(maxsize=1024)
def _least_constants(
    harmonics: tuple[int, ...], line_a2: tuple[float, ...], phase_rad: tuple[float, ...], size: int
) -> tuple[float, tuple[tuple[float, ...], ...]]:
    harmonic = np.array(harmonics, int)
    phase = np.array(phase_rad)
    line = np.array(line_a2)
    groups = []
    for start in range(0, len(line), size):
        part = slice(start, start + size)
        states = _states(size)[:, : len(line[part])] * line[part]
        least = least_constant(harmonic[part], states, phase[part]) + ROUNDING * states.sum(1)
        groups.append(tuple(least.tolist()))
    all_on = least_constant(harmonic, line[None], phase)[0] + ROUNDING * line.sum() if len(line) else 0.0
    return float(all_on), tuple(groups)


def channels_per_signed_group(channels: int) -> int:
    """Return what `channels_per_group` does, with at most `SIGNED_CHANNELS` channels in a group.

    In these a channel is off, on or in counter-phase.
    """
    return ceil(channels / ceil(channels / SIGNED_CHANNELS))


def signed_constants(coil: CoilDrive, size: int) -> tuple[tuple[float, ...], ...]:
    """Return, for each group of `size` channels and each of its states, the least constant in A² that keeps i² ≥ 0.

    A state's index has one base-3 digit a channel: 0 for off, 1 for on, 2 for in counter-phase; the first channel's is
    the lowest.
    """
    groups = []
    for start in range(0, len(coil.line_a2), size):
        part = slice(start, start + size)
        line = coil.line_a2[part]
        digits = np.arange(3**size)[:, None] // 3 ** np.arange(size) % 3
        states = np.where(digits == 2, -1.0, digits)[:, : len(line)] * line
        least = least_constant(coil.harmonic[part], states, coil.phase_rad[part]) + ROUNDING * np.abs(states).sum(1)
        groups.append(tuple(least.tolist()))
    return tuple(groups)


TRIES = 6


def judge_limits(
    where: str, plan: Plan, drive: PadDrive, shown: Timeline | None = None, tuning: Tuning | None = None
) -> tuple[Finding, ...]:
    """Return an error for each limit that a drive of a plan exceeds; an empty tuple where all hold.

    `shown` None: by the worst of all levels and changes that the firmware may be sent.
    """
    load = load_of(plan, drive, shown)
    findings = tuple(judge_load(where, plan, load, tuning))
    cure = _level_text(plan, drive, shown, tuning, load) if findings else ""
    return tuple(replace(finding, message=finding.message + cure) for finding in findings)


def refuse_frames(plan: Plan, frames: np.ndarray, tuning: Tuning | None = None) -> None:
    """Raise SpecError if frames (k, taxels) that the firmware is to show would exceed a limit of coils or taxels.

    Levels below 0 are of taxels that move in counter-phase.
    """
    drive = replace(drive_at(plan, CONTROLLER_RATES_HZ, tuning=tuning), corner_hz=0.0)
    if any(judge_load("", plan, load_of(plan, drive), tuning)):
        states = np.unique(frames, axis=0)
        shown = timeline(plan, np.abs(states), signs=np.where(states < 0, -1.0, 1.0))
        findings = judge_limits("", plan, drive, shown, tuning)
        if findings:
            raise SpecError(f"is not played: {findings[0].message}", plan.name)


def judge_load(where: str, plan: Plan, load: Load, tuning: Tuning | None = None) -> Iterator[Finding]:
    """Yield an error for each limit, or registered rule, that a load breaks."""
    return SIGNAL_RULES.findings(Signal(where, plan, load, tuning))


class Signal(NamedTuple):
    """A signal to be written or played: its file or port, plan, load on coils and taxels, and tuning, if any."""

    where: str
    plan: Plan
    load: Load
    tuning: Tuning | None


def _limit_errors(signal: Signal) -> Iterator[Finding]:
    """Yield an error for each limit that the signal exceeds."""
    spec = signal.plan.spec
    for one in exceeded(spec, _demand(signal.plan, signal.load, signal.tuning)):
        averaged = (
            f", averaged over {number(least_thermal_time_s(spec.coil))} s" if one.limit.code == "coil.heat" else ""
        )
        yield Finding("error", one.limit.code, signal.where, one.sentence + averaged)


SIGNAL_RULES: RuleBook[Signal] = RuleBook("signal", _limit_errors)
"""Rules that a signal must keep before it is written or played: the limits, and registered ones."""


def judge_warmth(where: str, plan: Plan, beam_rise_k: float) -> Iterator[Finding]:
    """Yield a warning where a file that is played over and over warms the beams more than the plastic bears."""
    for one in exceeded(plan.spec, Demand(0.0, 0.0, 0.0, 0.0, beam_rise_k=beam_rise_k)):
        yield Finding("warning", one.limit.code, where, f"played over and over, {one.sentence}")


def _demand(plan: Plan, load: Load, tuning: Tuning | None) -> Demand:
    """Return the peak voltage, peak current and heat that a load asks of the coils, and the motion of printed taxels.

    Before coils are as warm as the tuning has them, voltages let more current flow: its peak and the mean pull count
    so.
    """
    known = played_tuning(plan, tuning)
    resistance_ohm = spec_at_coil_temperature(plan, known.coil_c).coil.resistance_ohm
    more = max(resistance_ohm / plan.spec.coil.resistance_ohm, 1.0)
    channels = printed_channels(plan, known)
    coil_of = [taxel.coil[0] * plan.coils.columns + taxel.coil[1] for taxel in plan.taxels]
    pulling = load.square_a2 if plan.spec.force_order == SQUARE else np.zeros(len(load.square_a2))
    moved = {
        MovingTaxel(channel, float(pulling[coil]) * more**2, level)
        for coil, channel, level in zip(coil_of, channels, load.level.tolist(), strict=True)
    }
    coil_w = resistance_ohm * float(load.warm_a2.max(initial=0.0))
    pad_w = resistance_ohm * load.total_a2
    return Demand(load.peak_v, load.peak_a * more, coil_w, pad_w, tuple(moved))


def _level_text(plan: Plan, drive: PadDrive, shown: Timeline | None, tuning: Tuning | None, load: Load) -> str:
    """Return a clause that names a lower drive level which keeps all limits, or says that none that was tried does."""
    for _ in range(TRIES):
        # All currents go with the root of the level.
        broken = exceeded(plan.spec, _demand(plan, load, tuning))
        part = min((one.limit.share_of_level(plan.spec, one.asked) for one in broken), default=LOWER)
        text = at_most(plan.spec.drive.level_um * part)
        if float(text) < SMALLEST_LEVEL_UM:
            break
        plan = replace(plan, spec=replace(plan.spec, drive=replace(plan.spec.drive, level_um=float(text))))
        load = load_of(plan, make_drive(plan, drive.rate_hz, tuning, drive.carrier_hz), shown)
        if not any(judge_load("", plan, load, tuning)):
            return f"; drive.level_um of {text} would fit it"
    return "; no lower drive.level_um that was tried would fit it"


def carrier_text(plan: Plan, shown: Timeline, rate_hz: int | None, tuning: Tuning | None) -> str:
    """Return a clause that says whether a drive on the lowest accepted carrier frequency would keep all limits."""
    hz = at_least(CARRIER_OVER_RESONANCE * highest_hz(plan, tuning))
    try:
        drive = drive_at(plan, RATES_HZ, rate_hz, tuning, float(hz))
    except SpecError as error:
        return f"; a carrier has none, but the lowest, {hz} Hz, {error.message}"
    beyond = next(judge_load("", plan, load_of(plan, drive, shown), tuning), None)
    if beyond is None:
        return f"; a carrier has none (--carrier {hz} keeps all limits)"
    return f"; a carrier has none, but with the lowest that is accepted, --carrier {hz}, {beyond.message}"
