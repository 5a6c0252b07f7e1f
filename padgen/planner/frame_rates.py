"""Frame rates: how fast one image on the pad may follow another."""

from collections.abc import Sequence

import numpy as np

from padgen.core.units import MS
from padgen.physics.schemes import in_order
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import Channel, FrameRate, channel_sets

__all__ = ["frame_rates", "slot_ms", "switch_ms"]

SWITCH_PERIODS = 9.0
"""Periods of the lowest resonance that a transition lasts: at most 1e-4 of the mean pull's step then rings on."""
SWITCH_BEATS = 2.5
"""Periods of the beat between neighbouring channels that a transition lasts: the ringing that a switched tone leaves on
a neighbouring taxel is then at least 38 dB below the motion that the steady tone makes there."""


def switch_ms(channels: Sequence[Channel], sets: int = 1) -> float:
    """Return the length in ms of a transition that neither clicks nor shakes a taxel that stays OFF.

    The force is blended over it by a step that is flat to the fourth derivative at both ends.
    """
    lowest_hz = min(channel.resonance_hz for channel in channels)
    beat_hz = min(_nearest_hz(own) for own in channel_sets(channels, sets))
    return max(SWITCH_PERIODS / lowest_hz, SWITCH_BEATS / beat_hz) / MS


def slot_ms(channels: Sequence[Channel], sets: int = 1) -> float:
    """Return the length in ms of a channel's time slot when the channels of a pad take turns.

    A slot is twice the slowest taxel's ring-down or two transitions, whichever is longer. The force rises over the
    first half and falls over the second, so that neither the tone nor its mean pull sets another taxel swinging.
    """
    return 2 * max(*(channel.ring_down_ms for channel in channels), switch_ms(channels, sets))


def frame_rates(channels: Sequence[Channel], sets: int = 1) -> tuple[FrameRate, ...]:
    """Return the frames per second, for each scheme, at which a taxel switched OFF is quiet before the next frame.

    With all channels at once, a frame takes a transition and the slowest channel's ring-down. In turns, it takes a slot
    for every channel of a coil.
    """
    together = (switch_ms(channels, sets) + max(channel.ring_down_ms for channel in channels)) * MS
    in_turns = slot_ms(channels, sets) * MS * len(channels) / sets
    times = {name: in_turns if Scheme(name).takes_turns else together for name in in_order()}
    return tuple(FrameRate(name, 1 / time) for name, time in times.items())


def _nearest_hz(own: Sequence[Channel]) -> float:
    """Return the smallest distance in Hz between resonances of a coil, at least one half-power bandwidth.

    Two resonances within a bandwidth act as one and do not beat.
    """
    gaps = np.diff(np.sort([channel.resonance_hz for channel in own]))
    bandwidth_hz = min(channel.resonance_hz / channel.q for channel in own)
    return max(float(gaps.min(initial=np.inf)), bandwidth_hz)
