"""The simulated ear: what a finger feels at each taxel when a WAV file plays, computed from the file's samples.

Samples → what a sound card's high-pass leaves of them → the coil's current through R and L → the pull by i² + ρ i (ρ by
remanence, the largest of a coil's washers) → every taxel's motion, all modes → what is felt on the boss in every state
that is held, block by block. Left out: the coils beside (see `Plan.reuse`), the voltage that a moving washer induces,
and what an amplifier adds.

All is heard twice: on a pad that is held still, and on its mount, where all coils shake the pad and each taxel's
working mode is shaken by that (`padgen.physics.recoil_in_time`), as by the pull at the hanging gap.

The circuit's and each mode's pole p is stepped exactly, ``y(t + T) = e^(pT) y(t) + ∫ e^(p(T−τ)) s(t + τ) dτ``, and
`scipy.signal.lfilter` runs it. Between samples the voltage is the band-limited signal by a windowed sinc (lines below
0.4 of the sample rate are off by 2e-5 at most), the squared current the cubic through four samples (off by 8e-6 for
1 kHz of 48 kHz, by 0.7 % for an eighth of the rate). Exponential integrators: Cox and Matthews, J. Comput. Phys. 176,
2002, 430.

A *level* is √2 times the root mean square of what is felt, without its mean: for one line its amplitude. It is taken
over the last whole period of the comb in a hold, in which all lines are orthogonal; in a hold shorter than that, over
what has settled of it, with a Hann window. The *course* is the same figure in a Hann window of `COURSE_PERIODS`
periods of the lowest line, less a parabola: what moves with the mean pull is no vibration. Where the channels take
turns, a frame's level is the largest of its course.

A taxel's levels are compared with what it is to be felt at level 1: the planned motion of its working mode, times
what the plan's modal model lets a finger feel beyond that mode's own vertical motion (other modes, rolling).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import FileError, Finding, about, at_least, number
from padgen.core.units import GRAM, MA, MH, MM, UM
from padgen.core.wav_reader import Wave
from padgen.driver.signs import mount_text, printed_taxels
from padgen.driver.slots import slots_of, worst_contrast
from padgen.measured.tuning import (
    TunedTaxel,
    Tuning,
    levels_um,
    planned_response_um_per_a2,
    planned_tuning,
    spec_at_coil_temperature,
)
from padgen.physics.recoil_in_time import MOST_UNKNOWNS, THROUGH, WEIGHT, WITHIN, PadMotion, most_unknowns
from padgen.physics.resonator import TaxelModes, felt_gains
from padgen.physics.selectivity import Scheme
from padgen.planner.channels import hanging_gap_um
from padgen.planner.plan import Channel, Plan
from padgen.planner.shaken_pad import ShakenPad
from padgen.spec import Coil

__all__ = [
    "MISSED_DB",
    "SETTLED_TAUS",
    "STILL",
    "Heard",
    "Span",
    "circuit_filter",
    "ear_findings",
    "hear",
    "heard_table",
    "high_pass",
    "mode_filter",
]

WHERE = "drive.wav"
SETTLED_TAUS = 4.5
"""Time constants in which a vibration comes within 0.1 dB of its last level: ``1 − e^-4.5`` is −0.1 dB."""
# Time constants for which a loop is played before it is heard: e^-12 is 6e-6.
LOOP_TAUS = 12.0
# Samples on each side of an instant that make the voltage there, and Kaiser's β of their window.
AROUND = 16
KAISER = 10.0
# Time constants of the circuit in a sample, at most: with less inductance the current is that much late.
STIFFEST = 40.0
# Below a Q of a half there is no vibration; it is taken for critical damping.
LEAST_Q = 0.5 * (1 + 1e-9)
COURSE_PERIODS = 4.0
# Share of its ON level below which a taxel stands still: half a step of 24 bit is 6e-8.
STILL = 1e-9
# Share of its last level at which a taxel counts as switched on.
RISEN = 0.9
# Share of the gap at which a washer counts as pulled onto the coil; there its pull grows no further.
NEAREST = 0.99
# Samples of all coils together that are heard at a time.
BLOCK = 1 << 18
# With the gap: blocks a second, in each of which pull and motion are found in turns, so often at most.
GAP_BLOCKS_PER_S = 100
MOST_PULLS = 20


class Span(NamedTuple):
    """A state that a WAV file holds: switching to it begins at `begin_s`, and it lasts from `start_s` to `stop_s`.

    Levels are taken from `window_s` on, over a `whole` period of the comb or not. `in_turns` tells that it is a frame
    of slots. `levels` (taxels,) are shares of the ON amplitudes, `signs` those of the motion.
    """

    begin_s: float
    start_s: float
    stop_s: float
    window_s: float
    whole: bool
    in_turns: bool
    levels: np.ndarray
    signs: np.ndarray


class Shaken(NamedTuple):
    """Levels that a finger feels at the taxels when the pad recoils on its mount; also mount and moving mass."""

    mount: str
    is_stated: bool
    moving_g: float
    level_um: np.ndarray
    frame_um: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """Vibration that a simulated finger feels at each taxel (n,) of the plan in each span (h,) of a WAV file.

    `level_um` is all that is felt there, `tone_um` what of it is at the taxel's own line, `wanted_um` (n,) what is to
    be felt at level 1, `peak_um` the largest motion of the washer from where it hangs, the mean pull's share included,
    `rise_s` how long switching on takes to nine tenths (NaN: it was not), `settled` whether it has had its time before
    its level is taken. `pulled_in` (n,): drawn onto the coil, with the gap only. A state that is held for `needs_s` is
    heard settled, over a whole period of the comb. `coils` are rows of what flows in each over the whole file, its
    `signal_peak` and `signal_mean` in V, or A if the file holds that. `frames` (f, n) are the levels of the frames,
    each of `frame_s`, that follow each other in the file, `frame_um` (f, n) what is felt on average over each slot.
    `shaken` is what is heard on the moving pad; None where it does not move, or `unshaken` says why that is not known.
    """

    name: str
    ids: tuple[str, ...]
    coil_of: np.ndarray
    spans: tuple[Span, ...]
    wanted_um: np.ndarray
    level_um: np.ndarray
    tone_um: np.ndarray
    peak_um: np.ndarray
    rise_s: np.ndarray
    settled: np.ndarray
    pulled_in: np.ndarray
    coils: tuple[dict[str, Any], ...]
    line_hz: np.ndarray
    period_s: float
    needs_s: float
    with_gap: bool
    asked_db: float
    frame_s: float | None = None
    frames: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    frame_um: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    shaken: Shaken | None = None
    unshaken: str = ""

    @property
    def slot_contrast(self) -> tuple[float, int, int] | None:
        """Smallest ratio in dB of ON to OFF rms vibration on one coil in one frame; indices of that frame and coil.

        Both are root mean squares over the whole frame, switching and ringing included. None where no coil has taxels
        ON and OFF in one frame.
        """
        return worst_contrast(self.frames, (self.frame_um / self.wanted_um) ** 2, self.coil_of)

    @property
    def held_contrast(self) -> tuple[float, int, int] | None:
        """Smallest ratio in dB of ON to OFF vibration on one coil, late in a held state; indices of span and coil.

        None where no coil has taxels ON and OFF in one span.
        """
        return worst_contrast(self.shares, self.relative**2, self.coil_of)

    @property
    def shares(self) -> np.ndarray:
        """Levels (h, n) that the file asks of each taxel in each span, as shares of the taxel's ON amplitude."""
        return np.array([span.levels for span in self.spans])

    @property
    def relative(self) -> np.ndarray:
        """Felt levels (h, n) of n taxels in h spans, each divided by the level planned for that taxel when fully ON."""
        return np.asarray(self.level_um / self.wanted_um)

    @property
    def on(self) -> np.ndarray:
        """Felt levels (h, n) of ON taxels, each divided by the level that the file asks of that taxel; NaN if OFF."""
        shares = self.shares
        return np.asarray(np.divide(self.relative, shares, out=np.full(shares.shape, np.nan), where=shares > 0))

    @property
    def off(self) -> np.ndarray:
        """Felt levels (h, n) of OFF taxels, each divided by the same taxel's planned ON level; NaN for ON taxels."""
        return np.where(self.shares > 0, np.nan, self.relative)

    @property
    def selectivity_db(self) -> float | None:
        """Ratio in dB of the smallest ON to the largest OFF level in all held states.

        None without ON taxels, and where no OFF taxel moves, as where no coil plays that has one.
        """
        return self._worst_db(self.level_um)

    @property
    def shaken_db(self) -> float | None:
        """`selectivity_db` of the pad as it recoils on its mount; None where recoil was not simulated."""
        return None if self.shaken is None else self._worst_db(self.shaken.level_um)

    @property
    def shaken_slot_contrast(self) -> tuple[float, int, int] | None:
        """`slot_contrast` of the pad as it recoils on its mount; None where recoil was not simulated."""
        if self.shaken is None:
            return None
        return worst_contrast(self.frames, (self.shaken.frame_um / self.wanted_um) ** 2, self.coil_of)

    def _worst_db(self, level_um: np.ndarray) -> float | None:
        shares = self.shares
        relative = level_um / self.wanted_um
        quietest = float((relative[shares > 0] / shares[shares > 0]).min(initial=np.inf))
        loudest = float(relative[shares <= 0].max(initial=-1.0))
        if np.isinf(quietest) or loudest <= STILL:
            return None
        return float(20 * np.log10(quietest / loudest))


def hear(
    plan: Plan,
    wave: Wave,
    sidecar: Mapping[str, Any],
    tuning: Tuning | None = None,
    gap: bool = False,
) -> Heard:
    """Simulate what is felt when `wave` plays on the pad of `plan`, or on the print that `tuning` describes.

    `sidecar` is the file's (`padgen.driver.formats.wav.wave_json`), of this plan, read from JSON. A file that loops is
    heard as it is after `LOOP_TAUS`, any other from rest. With the `gap` the pull grows as it closes, which takes more
    time.

    Raises
    ------
    FileError
        No state is held long enough.
    """
    line_hz, coil_of = (np.array([taxel[key] for taxel in sidecar["taxels"]]) for key in ("force_hz", "wav_channel"))
    step = max(round(COURSE_PERIODS / 2 / float(line_hz.min(initial=1e9)) * sidecar["rate_hz"]), 2)
    heard_print = tuning or planned_tuning(plan)
    known = heard_print.taxels
    resonance = np.array([taxel.resonance_hz for taxel in known])
    tau_s = np.array([taxel.q for taxel in known]) / (np.pi * resonance)
    spans = _spans(sidecar, len(plan.sets[0]), float(tau_s.max()), float(line_hz.min()))
    if not spans:
        raise FileError("holds no state long enough to listen to", WHERE)
    alike: dict[tuple, list[int]] = {}
    for k, (taxel, level) in enumerate(zip(plan.taxels, levels_um(plan, resonance).tolist(), strict=True)):
        alike.setdefault((taxel.channel, level, tuning and tuning.taxels[k]), []).append(k)

    def all_alike() -> list[_TaxelGroup]:
        return [
            _TaxelGroup(plan, plan.channels[channel], level, tuned, np.array(which), sidecar, step, spans, gap)
            for (channel, level, tuned), which in alike.items()
        ]

    groups = all_alike()
    pad = ShakenPad(plan)
    recoil = None
    if pad.moving_kg is not None:
        recoil = _Recoil(pad, tuning, coil_of, wave.channels, sidecar["rate_hz"], all_alike())
    coils = _play(plan, spec_at_coil_temperature(plan, heard_print.coil_c).coil, wave, sidecar, groups, gap, recoil)
    level_m, tone_m, peak_m, course_m, wanted_m, pulled_in = _joined_figures(groups)
    at_s = np.arange(len(course_m)) * (step / sidecar["rate_hz"])
    settled = np.zeros(level_m.shape, bool)
    rise_s = np.full(level_m.shape, np.nan)
    # A file that does nothing but hold one state, and loops, has done so for ever.
    since_s = np.full(len(tau_s), -np.inf if sidecar["loops"] and len(spans) == 1 else 0.0)
    before = spans[0].levels if sidecar["loops"] else np.zeros(len(tau_s))
    sign = spans[0].signs
    for h, span in enumerate(spans):
        if span.in_turns:
            level_m[h] = tone_m[h] = _largest_of(course_m, at_s, span)
        switched = np.isin(coil_of, coil_of[span.levels * span.signs != before * sign])
        sign = span.signs
        since_s = np.where(switched, span.start_s, since_s)
        settled[h] = span.in_turns | (span.window_s - since_s >= SETTLED_TAUS * tau_s * (1 - 1e-6))
        risen = (course_m >= RISEN * level_m[h]) & (at_s > span.begin_s)[:, None]
        is_risen = risen.any(0) & (level_m[h] > 0) & (span.levels > 0) & (before <= 0)
        rise_s[h, is_risen] = at_s[risen[:, is_risen].argmax(0)] - span.begin_s
        before = span.levels
    frame_s = sidecar.get("frame_s")
    frames = np.zeros((0, len(tau_s)))
    frame_m = np.zeros((0, len(tau_s)))
    if frame_s:
        keys = sidecar["keyframes"]
        time_s, levels = (np.array([key[name] for key in keys], float) for name in ("time_s", "levels"))
        frames = slots_of(time_s, levels, frame_s, Scheme(sidecar["scheme"]).takes_turns)[1]
        frame_m = _slot_levels(at_s, course_m, np.arange(len(frames) + 1) * frame_s)
    shaken = None
    if recoil is not None and recoil.groups:
        level_shaken, _, _, course_shaken, _, _ = _joined_figures(recoil.groups)
        for h, span in enumerate(spans):
            if span.in_turns:
                level_shaken[h] = _largest_of(course_shaken, at_s, span)
        frame_shaken = _slot_levels(at_s, course_shaken, np.arange(len(frames) + 1) * frame_s) if frame_s else frame_m
        moving_g = (pad.moving_kg or 0.0) / GRAM
        shaken = Shaken(mount_text(pad), pad.mount.is_said, moving_g, level_shaken / UM, frame_shaken / UM)
    return Heard(
        name=plan.name,
        ids=tuple(taxel.id for taxel in plan.taxels),
        coil_of=coil_of,
        spans=spans,
        wanted_um=wanted_m / UM,
        level_um=level_m / UM,
        tone_um=tone_m / UM,
        peak_um=peak_m / UM,
        rise_s=rise_s,
        settled=settled,
        pulled_in=pulled_in,
        coils=coils,
        line_hz=line_hz,
        period_s=sidecar["period_s"],
        needs_s=SETTLED_TAUS * float(tau_s.max()) + sidecar["period_s"],
        with_gap=gap,
        asked_db=plan.selectivity.asked_db,
        frame_s=frame_s,
        frames=frames,
        frame_um=frame_m / UM,
        shaken=shaken,
        unshaken="" if recoil is None else recoil.refused,
    )


def _joined_figures(groups: "Sequence[_TaxelGroup]") -> list[np.ndarray]:
    """Return levels and other results of all `groups` of taxels, joined in one array each, in the plan's order."""
    order = np.argsort(np.concatenate([group.which for group in groups]))
    figures = zip(*(group.figures() for group in groups), strict=True)
    return [np.concatenate(parts, axis=-1)[..., order] for parts in figures]


def _largest_of(course_m: np.ndarray, at_s: np.ndarray, span: Span) -> np.ndarray:
    """Return the largest value (n,) of each taxel's level over time, `course_m` (t, n), within a span."""
    return np.asarray(course_m[(at_s > span.start_s) & (at_s <= span.stop_s)].max(0, initial=0.0))


class _Recoil:
    """Simulation of the pad's recoil and the taxels that it shakes; left out (`refused`) if the model is too large."""

    def __init__(
        self,
        pad: ShakenPad,
        tuning: Tuning | None,
        coil_of: np.ndarray,
        coils: int,
        rate_hz: int,
        groups: "list[_TaxelGroup]",
    ) -> None:
        taxels = pad.taxels
        pull = pad.pull
        if tuning is not None:
            taxels, pull = printed_taxels(pad, tuning)
        self.groups = groups
        self.refused = ""
        count = most_unknowns(taxels)
        if count > MOST_UNKNOWNS:
            self.groups = []
            self.refused = f"has {count} motions that shake it, up to {MOST_UNKNOWNS} are heard"
            return
        push = np.zeros((len(coil_of), coils))
        push[np.arange(len(coil_of)), coil_of] = pull
        self.motion = PadMotion(pad.base, taxels, push, rate_hz)
        # A washer that its coil does not pull is not moved by it.
        self.reacts = -taxels.momentum / np.where(pull > 0, pull, np.inf)[:, None]

    def take_block(self, first: int, square_a2: np.ndarray) -> None:
        """Simulate the pad's recoil, and taxels shaken by it, for a block of i² (coils, s) from sample `first` on."""
        if self.groups:
            shaken = self.reacts @ self.motion.acceleration(square_a2)
            for group in self.groups:
                group.take_block(first, square_a2, shaken[group.which])


def _slot_levels(at_s: np.ndarray, course: np.ndarray, edges_s: np.ndarray) -> np.ndarray:
    """Return rms levels (f, n) of n taxels in f intervals with the limits `edges_s`, from `course` (t times, n)."""
    square = course**2
    steps = np.diff(at_s)[:, None] * (square[1:] + square[:-1]) / 2
    total = np.concatenate([np.zeros((1, course.shape[1])), steps.cumsum(0)])
    upto = np.stack([np.interp(edges_s, at_s, one) for one in total.T], 1)
    return np.asarray(np.sqrt(np.maximum(np.diff(upto, axis=0), 0.0) / np.diff(edges_s)[:, None]))


def _spans(sidecar: Mapping[str, Any], slots: int, tau_s: float, lowest_hz: float) -> tuple[Span, ...]:
    """Return the spans of a WAV file: its held states, or, if channels take turns, its frames of `slots` turns each.

    `tau_s` is the slowest taxel's time constant: windows begin, where they can, once it has settled.
    """
    time_s = [frame["time_s"] for frame in sidecar["keyframes"]]
    levels = np.array([frame["levels"] for frame in sidecar["keyframes"]], float)
    signs = np.array([frame.get("signs", np.ones(levels.shape[1])) for frame in sidecar["keyframes"]], float)
    period_s = sidecar["period_s"]
    spans: list[Span] = []
    if Scheme(sidecar["scheme"]).takes_turns and len(time_s) > 2:
        each = 2 * slots if (len(time_s) - 1) % (2 * slots) == 0 else 2
        for k in range(0, len(time_s) - each, each):
            start_s, stop_s = time_s[k], time_s[k + each]
            shown = levels[k : k + each + 1].max(0)
            spans.append(Span(start_s, start_s, stop_s, start_s, False, True, shown, signs[k + 1]))
        return tuple(spans)
    same = (np.abs(np.diff(levels, axis=0)).max(1) <= 1e-9).tolist()
    begin_s = time_s[0]
    if levels.min() < 0:  # the last brake ends in silence, which is no frame
        same[-1] = False
    for held, run in groupby(range(len(same)), same.__getitem__):
        first, *_, last = [*run] * 2
        if held:
            start_s, stop_s = time_s[first], time_s[last + 1]
            latest_s = stop_s - COURSE_PERIODS / lowest_hz
            window_s = start_s + SETTLED_TAUS * tau_s
            if whole := stop_s - start_s >= period_s * (1 - 1e-6):
                window_s = stop_s - period_s
            elif window_s > latest_s:
                window_s = max(min(latest_s, (start_s + stop_s) / 2), start_s)
            if frame_s := sidecar.get("frame_s"):  # a brake before the frame is no part of its switching
                begin_s = max(begin_s, np.floor(start_s / frame_s + 1e-9) * frame_s)
            spans.append(Span(begin_s, start_s, stop_s, window_s, whole, False, levels[first], signs[first]))
            begin_s = stop_s
    return tuple(spans)


def _play(
    plan: Plan,
    coil: Coil,
    wave: Wave,
    sidecar: Mapping[str, Any],
    groups: "Sequence[_TaxelGroup]",
    gap: bool,
    recoil: "_Recoil | None",
) -> tuple[dict[str, Any], ...]:
    """Simulate coil currents and the motion of taxels and pad; return, for each coil, its current and copper loss.

    Each row also has the signal's peak and mean.
    """
    from scipy.signal import lfilter

    resistance = coil.resistance_ohm
    inductance = coil.inductance_mh * MH
    rate_hz = sidecar["rate_hz"]
    late = 0
    coefficients = (np.ones(1), np.ones(1))
    if sidecar["signal"] == "voltage":
        late = AROUND - 1
        coefficients = circuit_filter(resistance, inductance, rate_hz)
    memory = np.zeros((wave.channels, len(coefficients[0]) - 1))
    slowest_s = max(group.slowest_s for group in groups) + inductance / resistance
    corner_hz = sidecar.get("corner_hz", 0.0)
    if corner_hz:
        slowest_s += 1 / (2 * np.pi * corner_hz)
    passing = high_pass(corner_hz, rate_hz)
    passed = np.zeros((wave.channels, 1))
    start = -int(np.ceil(LOOP_TAUS * slowest_s * rate_hz)) if sidecar["loops"] else 0
    remanent_a = np.zeros((wave.channels, 1))
    for taxel, heard in zip(plan.taxels, sidecar["taxels"], strict=True):
        at = heard["wav_channel"]
        remanent_a[at] = max(remanent_a[at, 0], plan.channels[taxel.channel].remanent_ma * MA)
    most_a, most, total, energy = np.zeros((4, wave.channels))
    size = max(rate_hz // GAP_BLOCKS_PER_S if gap else BLOCK // wave.channels, 1)
    for first, samples in _blocks(wave, start, wave.count + late, size):
        signal = samples * sidecar["full_scale"]
        left = signal
        if corner_hz:
            left, passed = lfilter(*passing, signal, zi=passed)
        current, memory = lfilter(*coefficients, left, zi=memory)
        pulled = current**plan.spec.force_order + remanent_a * current
        for group in groups:
            group.take_block(first - late, pulled)
        if recoil is not None:
            recoil.take_block(first - late, pulled)
        current, signal = (part[:, max(late - first, 0) :] for part in (current, signal))
        most_a = np.maximum(most_a, np.abs(current).max(1, initial=0.0))
        most = np.maximum(most, np.abs(signal).max(1, initial=0.0))
        energy += (current**2).sum(1)
        total += signal.sum(1)
    square = energy / wave.count
    return tuple(
        {
            "coil": tuple(entry["coil"]),
            "peak_a": float(most_a[k]),
            "rms_a": float(np.sqrt(square[k])),
            "copper_loss_w": float(square[k] * resistance),
            "signal_peak": float(most[k]),
            "signal_mean": float(total[k] / wave.count),
        }
        for k, entry in enumerate(sidecar["coils"])
    )


def _blocks(wave: Wave, first: int, last: int, size: int) -> Iterator[tuple[int, np.ndarray]]:
    """Yield a looped file's samples from `first` to before `last` in blocks: first index, and samples (channels, s)."""
    while first < last:
        at = first % wave.count
        stop = min(at + size, wave.count, at + last - first)
        yield first, np.ascontiguousarray(wave.read(at, stop).T)
        first += stop - at


def high_pass(corner_hz: float, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return numerator and denominator of a first-order high-pass (bilinear transform, exact at its corner)."""
    turn = np.tan(np.pi * corner_hz / rate_hz)
    return np.array([1.0, -1.0]) / (1 + turn), np.array([1.0, -(1 - turn) / (1 + turn)])


def circuit_filter(resistance_ohm: float, inductance_h: float, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return numerator and denominator of a digital filter, coil voltage to current, ``AROUND − 1`` samples late."""
    inductance_h = max(inductance_h, resistance_ohm / STIFFEST / rate_hz)
    pole = -resistance_ohm / inductance_h / rate_hz
    off = WITHIN - np.arange(AROUND, -AROUND, -1)[:, None]
    through = np.sinc(off) * np.i0(KAISER * np.sqrt(1 - (off / AROUND) ** 2))
    taps = through / through.sum(0) @ (WEIGHT * np.exp(pole * (1 - WITHIN)))
    return taps / (inductance_h * rate_hz), np.array([1.0, -np.exp(pole)])


def mode_filter(hz: float, q: float, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return numerator and denominator of the filter from samples of s to u, for ``u'' + ω/Q u' + ω² u = ω² s``.

    ``y' = p y + ω² s / Im p`` has ``u = Im y``: the real filter is that of the pole and its conjugate.
    """
    omega = 2 * np.pi * hz / rate_hz
    damping = 1 / (2 * max(q, LEAST_Q))
    pole = omega * (-damping + 1j * np.sqrt((1 - damping) * (1 + damping)))
    keep = np.exp(pole)
    taps = THROUGH @ (WEIGHT * np.exp(pole * (1 - WITHIN))) * (omega**2 / pole.imag)
    return np.convolve(taps, [1.0, -keep.conj()]).imag, np.array([1.0, -2 * keep.real, np.abs(keep) ** 2])


class _TaxelGroup:
    """Simulation of taxels with equal channel, ON level and tuning: a filter per mode, running sums of their motion."""

    def __init__(
        self,
        plan: Plan,
        channel: Channel,
        level_um: float,
        tuned: TunedTaxel | None,
        which: np.ndarray,
        sidecar: Mapping[str, Any],
        step: int,
        spans: tuple[Span, ...],
        gap: bool,
    ) -> None:
        modes = TaxelModes(np.array(channel.modes_hz), np.array(channel.mode_motions))
        radius_m = plan.spec.taxel.boss_diameter_mm / 2 * MM
        hz, gain = felt_gains(modes, np.array(channel.pull_wrench), np.array(channel.rest_motion), radius_m)
        # The plan's force constant is of the working mode, with its share of the pull as it is.
        share = channel.pulled_shares[int(np.argmax(channel.mode_shares))]
        gain = gain * (channel.force_constant_n_per_a2 / share if share else 0.0)
        # What is felt at the own tone, all modes, over the motion of the working mode there.
        over = channel.resonance_hz / hz
        working = planned_response_um_per_a2(channel)
        felt = np.linalg.norm((gain / (1 - over**2 + 1j * over / channel.q)[:, None]).sum(0)) / UM
        self.wanted_m = np.full(len(which), level_um * (felt / working if working > 0 else 1.0) * UM)
        q = channel.q
        if tuned is not None:  # other modes of a print move with the working one, in frequency and in answer
            gain = gain * (tuned.response_um_per_a2 / tuned.q / working * q if working > 0 else 0.0)
            hz = hz * (tuned.resonance_hz / channel.resonance_hz)
            q = tuned.q
        self.slowest_s = q / (np.pi * float(hz.min()))
        rate_hz = sidecar["rate_hz"]
        alike = [sidecar["taxels"][i] for i in which]
        self.which = which
        self.coil = [taxel["wav_channel"] for taxel in alike]
        self.spans = spans
        self.gain = gain.T
        self.filters = [mode_filter(float(each), q, rate_hz) for each in hz[:-1]]
        self.working = int(np.argmax(channel.mode_shares))
        self.memory = [np.zeros((len(which), len(THROUGH)))] * len(self.filters)
        self.gap_m = float(hanging_gap_um(plan.spec, channel.sag_um)) * UM if gap else None
        self.exponent = max(channel.pull_exponent, 0.0)
        self.pulled_in = np.zeros(len(which), bool)
        # Samples at which a span's switching begins, its level is taken from, and it ends; a comb has whole samples.
        edges = [(span.begin_s, span.window_s - span.stop_s, span.stop_s) for span in spans]
        self.edges = np.rint(np.array(edges) * rate_hz).astype(int)
        self.edges[:, 1] += self.edges[:, 2]
        self.turns = 2j * np.pi * np.array([[taxel["force_hz"]] for taxel in alike]) / rate_hz
        self.mean, self.square = np.zeros((2, len(spans), 3, len(which)))
        self.tone = np.zeros(self.mean.shape, complex)
        self.peak_m = np.zeros((len(spans), len(which)))
        self.step = step
        at = (np.arange(2 * step) + 0.5) / (2 * step) - 0.5
        self.root = np.cos(np.pi * at) / np.sqrt((np.cos(np.pi * at) ** 2).sum())
        self.parabola = np.linalg.qr(self.root[:, None] * at[:, None] ** np.arange(3))[0]
        self.loops = sidecar["loops"]  # a loop is one state, whose course is not asked for
        self.course_m = [np.zeros((1, len(which)))]
        self.tail = np.zeros((3, len(which), 0))

    def take_block(self, first: int, square_a2: np.ndarray, shaken_a2: np.ndarray | float = 0.0) -> None:
        """Simulate a block that starts at sample `first`; input is i² (coils, s), or i if force is proportional to i.

        `shaken_a2` (taxels, s) is what would pull as the moving pad does.
        """
        felt = self._felt(square_a2[self.coil], shaken_a2)
        for h, (begin, start, stop) in enumerate(np.clip(self.edges - first, 0, felt.shape[2]).tolist()):
            if stop == begin:
                continue
            self.peak_m[h] = np.maximum(self.peak_m[h], np.abs(felt[0, :, begin:stop]).max(1))
            at = first + np.arange(start, stop)
            length = self.edges[h, 2] - self.edges[h, 1]
            weight = np.full(len(at), 1 / length)
            if not self.spans[h].whole:
                weight *= 2 * np.sin(np.pi * (at - self.edges[h, 1] + 0.5) / length) ** 2
            part = felt[:, :, start:stop]
            self.mean[h] += part @ weight
            self.square[h] += part**2 @ weight
            self.tone[h] += np.einsum("pns,ns->pn", part, weight * np.exp(-self.turns * at))
        if not self.loops:
            joined = np.concatenate([self.tail, felt], 2)
            count = max(joined.shape[2] // self.step - 1, 0)
            if count:
                windows = np.lib.stride_tricks.sliding_window_view(joined, 2 * self.step, axis=2)
                parts = windows[:, :, : count * self.step : self.step] * self.root
                energy = (parts**2).sum((0, 3)) - ((parts @ self.parabola) ** 2).sum((0, 3))
                self.course_m.append(np.sqrt(2 * np.maximum(energy, 0.0)).T)
            self.tail = joined[:, :, count * self.step :]

    def _felt(self, square_a2: np.ndarray, shaken_a2: np.ndarray | float) -> np.ndarray:
        """Return the felt motion (3, taxels, s) in m for i² (taxels, s): vertical at the boss's axis, and two tilts."""
        from scipy.signal import lfilter

        pull = square_a2
        for _ in range(MOST_PULLS):
            pulls = [pull] * len(self.filters)
            pulls[self.working] = pull + shaken_a2
            moved = [
                lfilter(*each, pulled, zi=held)
                for each, pulled, held in zip(self.filters, pulls, self.memory, strict=True)
            ]
            felt = np.tensordot(self.gain, [*(motion for motion, _ in moved), pull], 1)
            if self.gap_m is None:
                break
            # F = c i² (g/(g − z))^p at the motion that was just found.
            was = pull
            pull = square_a2 * (1 - np.minimum(felt[0] / self.gap_m, NEAREST)) ** -self.exponent
            if np.abs(pull - was).max() <= 1e-9 * pull.max():
                break
        self.memory = [held for _, held in moved]
        self.pulled_in |= (felt[0] >= NEAREST * (self.gap_m or np.inf)).any(1)
        return felt

    def figures(self) -> tuple[np.ndarray, ...]:
        """Return level, tone, peak (spans, n), levels over time (t, n), ON levels (n,), in m; pull-in flags (n,)."""
        level_m = np.sqrt(2 * np.maximum((self.square - self.mean**2).sum(1), 0.0))
        tone_m = 2 * np.sqrt((np.abs(self.tone) ** 2).sum(1))
        return level_m, tone_m, self.peak_m, np.concatenate(self.course_m), self.wanted_m, self.pulled_in


MISSED_DB = 0.5
"""Largest error in dB of an ON taxel's level without a finding."""


def heard_table(heard: Heard) -> dict[str, Any]:
    """Return what a simulated finger feels as a dictionary for JSON: summary, coils, rows, each taxel's level by span.

    In the summary `tone_low_db`, `tone_high_db` are how far ON taxels' own lines are off what they are to be, `rise_s`
    is the slowest switching on, `peak_um` the largest motion of a washer; currents and losses are of the coil that has
    most; None where no taxel is ON, or OFF and moves. `slot_db` is `Heard.slot_contrast`, `held_db` is
    `Heard.held_contrast`; in `frames` the levels are averages over each frame's whole slot. `recoil` is of the moving
    pad, all coils at once: `selectivity_db` and `slot_db` as in the summary, None where it does not move.
    """
    tone = _tone_db(heard)
    of_coils = ("peak_a", "rms_a", "copper_loss_w", "signal_peak", "signal_mean")
    return {
        "name": heard.name,
        "with_gap": heard.with_gap,
        "asked_db": heard.asked_db,
        "summary": {
            "smallest_on_db": _largest(-_db(heard.on), -1.0),
            "loudest_off_db": _largest(_db(heard.off)),
            "selectivity_db": heard.selectivity_db,
            "slot_db": None if heard.slot_contrast is None else heard.slot_contrast[0],
            "held_db": None if heard.held_contrast is None else heard.held_contrast[0],
            "tone_low_db": _largest(-tone, -1.0),
            "tone_high_db": _largest(tone),
            "rise_s": _largest(heard.rise_s),
            "peak_um": float(heard.peak_um.max()),
            **{figure: max((coil[figure] for coil in heard.coils), key=abs) for figure in of_coils},
            "all_settled": bool(heard.settled.all()),
        },
        "recoil": _shaken_table(heard),
        "coils": list(heard.coils),
        "rows": list(_rows(heard)),
        "taxels": list(heard.ids),
        "wanted_um": heard.wanted_um.tolist(),
        "spans": [
            {
                "start_s": span.start_s,
                "stop_s": span.stop_s,
                "heard_from_s": span.window_s,
                "whole_periods": span.whole,
                "in_turns": span.in_turns,
                "levels": span.levels.tolist(),
                "level_um": heard.level_um[h].tolist(),
                "shaken_um": None if heard.shaken is None else heard.shaken.level_um[h].tolist(),
                "tone_um": heard.tone_um[h].tolist(),
                "peak_um": heard.peak_um[h].tolist(),
                "rise_s": heard.rise_s[h].tolist(),
                "settled": heard.settled[h].tolist(),
            }
            for h, span in enumerate(heard.spans)
        ],
        "frame_s": heard.frame_s,
        "frames": [
            {"start_s": k * (heard.frame_s or 0.0), "levels": levels, "level_um": felt}
            for k, (levels, felt) in enumerate(zip(heard.frames.tolist(), heard.frame_um.tolist(), strict=True))
        ],
    }


def _shaken_table(heard: Heard) -> dict[str, Any] | None:
    if heard.shaken is None:
        return {"not_heard": heard.unshaken} if heard.unshaken else None
    slot = heard.shaken_slot_contrast
    return {
        "mount": heard.shaken.mount,
        "moving_g": heard.shaken.moving_g,
        "selectivity_db": heard.shaken_db,
        "slot_db": None if slot is None else slot[0],
    }


def _rows(heard: Heard) -> Iterator[dict[str, Any]]:
    """Yield a dictionary for each pair of span and coil, in the file's order: the coil's state, ON and OFF level in dB.

    `state` has a sign for every taxel, the lowest line first: 1 is ON, 0 is OFF, + in between. `on_db` is the smallest
    ON level, over what that taxel is to have there, `off_db` the loudest OFF level over the taxel's own ON level; None
    where there is none, -inf is silence.
    """
    on = _db(heard.on)
    off = _db(heard.off)
    by_line = np.argsort(heard.line_hz, kind="stable")
    for h, span in enumerate(heard.spans):
        for k in np.unique(heard.coil_of).tolist():
            which = by_line[heard.coil_of[by_line] == k]
            quiet = min(((float(on[h, i]), heard.ids[i]) for i in which if span.levels[i] > 0), default=None)
            loud = max(((float(off[h, i]), heard.ids[i]) for i in which if span.levels[i] <= 0), default=None)
            on_db, on_taxel = quiet or (None, "")
            off_db, off_taxel = loud or (None, "")
            yield {
                "until_s": span.stop_s,
                "coil": heard.coils[k]["coil"],
                "state": "".join(map(_level_mark, span.levels[which].tolist())),
                "on_db": on_db,
                "on_taxel": on_taxel,
                "off_db": off_db,
                "off_taxel": off_taxel,
                "selectivity_db": None if on_db is None or off_db is None else on_db - off_db,
                "settled": bool(heard.settled[h, which].all()),
            }


def _level_mark(level: float) -> str:
    """Return '0' for a taxel that is OFF, '1' for one fully ON and '+' for one between."""
    if level <= 0:
        return "0"
    return "1" if level > 1 - 1e-9 else "+"


def ear_findings(heard: Heard) -> Iterator[Finding]:
    """Yield findings on what is felt: pull-in, wrong levels, low selectivity, recoil, states held too briefly."""
    if heard.pulled_in.any():
        yield Finding(
            "error",
            "ear.pull_in",
            heard.ids[int(heard.pulled_in.argmax())],
            f"is pulled onto its coil by {WHERE}, as {int(heard.pulled_in.sum())} of {len(heard.ids)} taxels are;"
            " a lower drive.level_um or a wider coil.gap_mm would do",
        )
    tone = _tone_db(heard)
    missed = np.abs(tone) > MISSED_DB
    if missed.any():
        h, i = np.unravel_index(int(np.nanargmax(np.abs(tone))), tone.shape)
        span = heard.spans[h]
        hurried = heard.spans[h].in_turns or not heard.settled[h, i]
        yield Finding(
            "warning",
            "ear.level",
            heard.ids[i],
            f"should move by {about(span.levels[i] * heard.wanted_um[i], 3)} µm in the state that ends at"
            f" {about(span.stop_s, 4)} s, and moves by {about(heard.tone_um[h, i], 3)} µm ({tone[h, i]:+.1f} dB;"
            f" allowed: {MISSED_DB:g} dB); ON taxels are off by more than that {int(missed.sum())} of"
            f" {int((heard.shares > 0).sum())} times, counted over all states;"
            f" {'longer frames' if hurried else 'padgen retune, or a lower level,'} would do",
        )
    asked = heard.asked_db
    kept = heard.selectivity_db
    if kept is not None and kept < asked:
        h, i = np.unravel_index(int(np.nanargmax(heard.off)), heard.off.shape)
        yield Finding(
            "warning",
            "ear.selectivity",
            WHERE,
            f"has {kept:.1f} dB of ON over OFF (asked: {asked:.1f} dB); the loudest OFF taxel is {heard.ids[i]} in the"
            f" state that ends at {about(heard.spans[h].stop_s, 4)} s",
        )
    shaken_db = heard.shaken_db
    is_stated = heard.shaken is not None and heard.shaken.is_stated
    if is_stated and shaken_db is not None and kept is not None and shaken_db < asked <= kept:
        yield Finding(
            "warning",
            "ear.recoil",
            WHERE,
            f"has {shaken_db:.1f} dB of ON over OFF on the pad as it recoils (asked: {asked:.1f} dB), and {kept:.1f} dB"
            " held still",
        )
    late = ~heard.settled.all(1)
    if late.any():
        span = heard.spans[int(late.argmax())]
        yield Finding(
            "warning",
            "ear.unsettled",
            WHERE,
            f"holds {int(late.sum())} of {len(heard.spans)} states too briefly for taxels to come within 0.1 dB of"
            f" their levels (the first, which ends at {about(span.stop_s, 4)} s, for"
            f" {about(span.stop_s - span.start_s, 3)} s);"
            f" {at_least(heard.needs_s)} s after each switch would do",
        )
    if any(not span.whole and not span.in_turns for span in heard.spans):
        yield Finding(
            "note",
            "ear.window",
            WHERE,
            f"holds states for less than the comb's period of {number(heard.period_s)} s, so that their levels are"
            " means over a part of it and lines close to each other are not told apart",
        )


def _tone_db(heard: Heard) -> np.ndarray:
    """Return the amplitude of each ON taxel at its tone over the amplitude that is wanted, in dB; NaN for OFF taxels.

    Rows are the frames that are held, columns the taxels.
    """
    wanted = heard.shares * heard.wanted_um
    return _db(np.divide(heard.tone_um, wanted, out=np.full(wanted.shape, np.nan), where=wanted > 0))


def _db(ratio: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.asarray(20 * np.log10(ratio))


def _largest(values: np.ndarray, sign: float = 1.0) -> float | None:
    """Return `sign` times the largest of `values`, leaving out NaN; None where all values are NaN."""
    return None if np.isnan(values).all() else sign * float(np.nanmax(values))
