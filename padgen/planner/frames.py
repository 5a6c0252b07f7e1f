"""How fast frames may follow each other."""

from collections.abc import Sequence

from padgen.physics.selectivity import SCHEMES, Scheme
from padgen.planner.plan import Channel, FrameRate
from padgen.units import MS

__all__ = ["frame_rates", "slot_ms"]


def slot_ms(channels: Sequence[Channel]) -> float:
    """Length in ms of a channel's slot when channels of a pad take turns.

    Twice the slowest taxel's ring-down: ramped up over one and down over the other, so that neither
    the tone nor the step of its mean pull sets another taxel swinging.
    """
    return 2 * max(channel.ring_down_ms for channel in channels)


def frame_rates(channels: Sequence[Channel], sets: int = 1) -> tuple[FrameRate, ...]:
    """Frames a second, per scheme, at which what is switched off is quiet before the next frame.

    All at once: the slowest channel's ring-down. In turns: a slot for every channel of a coil.
    """
    together = max(channel.ring_down_ms for channel in channels) * MS
    in_turns = slot_ms(channels) * MS * len(channels) / sets
    times = {name: in_turns if Scheme(name).takes_turns else together for name in SCHEMES}
    return tuple(FrameRate(name, 1 / time if time > 0 else None) for name, time in times.items())
