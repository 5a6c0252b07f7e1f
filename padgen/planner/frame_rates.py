"""How fast frames may follow each other."""

from collections.abc import Sequence

import numpy as np

from padgen.core.units import MS
from padgen.physics.schemes import in_order
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import Channel, FrameRate, channel_sets

__all__ = ["frame_rates", "slot_ms", "switch_ms"]

SWITCH_PERIODS = 9.0
"""Periods of the lowest resonance in a transition: of the mean pull's step it then keeps 1e-4 or less as ringing."""
SWITCH_BEATS = 2.5
"""Periods of the beat between neighbouring channels in a transition: what a tone that is switched leaves ringing on its
neighbour is then 38 dB or more below what the neighbour hears of it when it is steady."""


def switch_ms(channels: Sequence[Channel], sets: int = 1) -> float:
    """Length in ms of a transition that neither clicks nor shakes a taxel that stays OFF.

    For a force that is blended by a step which is flat to the fourth derivative at both ends.
    """
    lowest_hz = min(channel.resonance_hz for channel in channels)
    beat_hz = min(_nearest_hz(own) for own in channel_sets(channels, sets))
    return max(SWITCH_PERIODS / lowest_hz, SWITCH_BEATS / beat_hz) / MS


def slot_ms(channels: Sequence[Channel], sets: int = 1) -> float:
    """Length in ms of a channel's slot when channels of a pad take turns.

    Twice the slowest taxel's ring-down, or two transitions: ramped up over one half and down over the other, so that
    neither the tone nor the step of its mean pull sets another taxel swinging.
    """
    return 2 * max(*(channel.ring_down_ms for channel in channels), switch_ms(channels, sets))


def frame_rates(channels: Sequence[Channel], sets: int = 1) -> tuple[FrameRate, ...]:
    """Frames a second, per scheme, at which what is switched off is quiet before the next frame.

    All at once: a transition and the slowest channel's ring-down. In turns: a slot for every channel of a coil.
    """
    together = (switch_ms(channels, sets) + max(channel.ring_down_ms for channel in channels)) * MS
    in_turns = slot_ms(channels, sets) * MS * len(channels) / sets
    times = {name: in_turns if Scheme(name).takes_turns else together for name in in_order()}
    return tuple(FrameRate(name, 1 / time) for name, time in times.items())


def _nearest_hz(own: Sequence[Channel]) -> float:
    """The smallest distance between resonances of a coil; closer than a bandwidth they are one and beat no more."""
    gaps = np.diff(np.sort([channel.resonance_hz for channel in own]))
    bandwidth_hz = min(channel.resonance_hz / channel.q for channel in own)
    return max(float(gaps.min(initial=np.inf)), bandwidth_hz)
