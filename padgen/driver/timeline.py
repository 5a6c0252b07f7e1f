"""`Timeline`: the levels of all taxels in time, as keyframes between which they are blended.

A level is a share of a taxel's ON amplitude, and of its line of i². Between two keyframes the force is
blended from one's to the other's by a smooth step, so that switching neither clicks nor shakes a taxel that stays OFF:
the step is of ninth degree, flat to the fourth derivative at both ends, and as long as `ramp_s` says.
"""

from dataclasses import dataclass

import numpy as np

from padgen.core.errors import SpecError, at_least, number
from padgen.core.units import MS
from padgen.planner.frame_rates import switch_ms
from padgen.planner.plan import Plan

__all__ = ["Timeline", "blend", "blend_slope", "frame_s", "ramp_s", "steady", "timeline"]


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """Keyframes: `time_s` (k,), rising from 0, and `levels` (k, taxels) in 0 … 1, taxels as in the plan.

    `loops` tells that the end leads over into the beginning.
    """

    time_s: np.ndarray
    levels: np.ndarray
    loops: bool

    @property
    def seconds(self) -> float:
        """Its length."""
        return float(self.time_s[-1])


def blend(share: np.ndarray) -> np.ndarray:
    """The smooth step from 0 to 1 over shares of a transition, the integral of `blend_slope`."""
    step: np.ndarray = share**5 * (126 - share * (420 - share * (540 - share * (315 - 70 * share))))
    return step


def blend_slope(share: np.ndarray) -> np.ndarray:
    """The slope of `blend`, ``630 (s (1 − s))⁴``."""
    slope: np.ndarray = 630 * (share * (1 - share)) ** 4
    return slope


def frame_s(plan: Plan) -> float:
    """Seconds of a frame at the planned refresh rate of the plan's scheme."""
    return 1 / {f.scheme: f.frames_per_s for f in plan.refresh}[plan.selectivity.drive]


def ramp_s(plan: Plan) -> float:
    """Seconds that a transition takes, or time-shared the least that half a slot may be."""
    return switch_ms(plan.channels, plan.coils.sets) * MS


def steady(levels: np.ndarray, seconds: float) -> Timeline:
    """The same levels (taxels,) all the time: a loop without seam if `seconds` are whole periods of the comb."""
    return Timeline(np.array([0.0, seconds]), np.stack([levels, levels]), True)


def timeline(plan: Plan, frames: np.ndarray, seconds_each: float | None = None) -> Timeline:
    """Frames (k, taxels) one after the other, from silence to silence.

    `seconds_each` is a frame's length (None: by the planned refresh rate). Where the channels of a coil take
    turns, a frame is a slot for each channel, up over its one half and down over the other.

    Raises
    ------
    SpecError
        No frame, a level that is not in 0 … 1, or frames too short for their transitions.
    """
    frames = _checked(plan, frames, seconds_each)
    if plan.scheme.takes_turns:
        return _in_turns(plan, frames, seconds_each)
    ramp, length = ramp_s(plan), seconds_each or frame_s(plan)
    if length < ramp:
        raise SpecError(
            f"must be at least {at_least(ramp)} s for a frame, which switches in so long, got {number(length)} s",
            "frames",
        )
    silence = np.zeros((1, frames.shape[1]))
    starts = np.arange(len(frames) + 1) * length
    times = np.stack([starts, starts + ramp], 1).ravel()
    before = np.concatenate([silence, frames])
    after = np.concatenate([frames, silence])
    return Timeline(times, np.stack([before, after], 1).reshape(len(times), -1), False)


def _checked(plan: Plan, frames: np.ndarray, seconds_each: float | None) -> np.ndarray:
    """Frames (k, taxels), or the sentence that says what is wrong with them."""
    checked = np.atleast_2d(np.asarray(frames, float))
    if checked.ndim != 2 or checked.shape[1] != len(plan.taxels) or not len(checked):
        raise SpecError(
            f"must be one or more rows of {len(plan.taxels)} levels, got {' x '.join(map(str, np.shape(frames)))}",
            "frames",
        )
    bad = np.argwhere(~((checked >= 0) & (checked <= 1)))
    if len(bad):
        frame, taxel = bad[0]
        raise SpecError(
            f"levels must be in 0 … 1, got {number(float(checked[frame, taxel]))} for {plan.taxels[taxel].id} in frame"
            f" {frame}",
            "frames",
        )
    if seconds_each is not None and not (np.isfinite(seconds_each) and seconds_each > 0):
        raise SpecError(f"must be above 0 s for a frame, got {number(seconds_each)} s", "frames")
    return checked


def _in_turns(plan: Plan, frames: np.ndarray, seconds_each: float | None) -> Timeline:
    turn, slots = _turns(plan), len(plan.sets[0])
    slot = (seconds_each or frame_s(plan)) / slots
    if slot < 2 * ramp_s(plan) * (1 - 1e-12):
        raise SpecError(
            f"must be at least {at_least(2 * ramp_s(plan) * slots)} s for a frame of {slots} slots,"
            f" got {number(slot * slots)} s",
            "frames",
        )
    times = np.arange(2 * slots * len(frames) + 1) * slot / 2
    levels = np.zeros((len(times), frames.shape[1]))
    for k, frame in enumerate(frames):
        for s in range(slots):
            levels[2 * (k * slots + s) + 1] = np.where(turn == s, frame, 0.0)
    return Timeline(times, levels, False)


def _turns(plan: Plan) -> np.ndarray:
    """Which slot of its coil each taxel has."""
    order = {channel.index: k for own in plan.sets for k, channel in enumerate(own)}
    return np.array([order[taxel.channel] for taxel in plan.taxels])
