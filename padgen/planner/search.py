"""Layouts that hold, with their beams: room first, then resonances and beams for that room."""

from collections.abc import Iterable, Iterator
from functools import lru_cache

from padgen.planner.layout import SLACK_MM, Layout, beam_room
from padgen.planner.resonances import ladders
from padgen.planner.sizing import SizedChannel, size_channels
from padgen.planner.suspensions import Room
from padgen.spec import Spec

__all__ = ["sized_layouts"]

LAYOUTS_SIZED = 24
"""Layouts with room whose beams are sized before giving up."""


def sized_layouts(spec: Spec, options: Iterable[Layout]) -> Iterator[tuple[Layout, tuple[SizedChannel, ...]]]:
    """Those of `options` that hold, in their order, with their beams; one division of each grid and count."""
    seen, tried = set(), 0
    for layout in options:
        key = (layout.rows, layout.columns, layout.channels)
        if layout.margin_mm < -SLACK_MM or key in seen:
            continue
        if tried >= LAYOUTS_SIZED:
            return
        tried += 1
        channels = _beams(spec, layout.channels, beam_room(spec, layout))
        if channels:
            seen.add(key)
            yield layout, channels


@lru_cache(maxsize=64)
def _beams(spec: Spec, count: int, room: Room) -> tuple[SizedChannel, ...] | None:
    for resonances in ladders(spec, count, room):
        channels = size_channels(spec, room, resonances)
        if channels:
            return channels
    return None
