"""Layouts that hold, with their beams: room first, then resonances and beams for that room."""

from collections.abc import Iterable, Iterator
from functools import lru_cache
from math import inf

import numpy as np

from padgen.physics.selectivity import Scheme
from padgen.planner.layout import SLACK_MM, Layout, coil_reach_mm, place, room, slots
from padgen.planner.plan import Site
from padgen.planner.resonances import ladders
from padgen.planner.settings import scheme_named, sets_db
from padgen.planner.sizing import SizedChannel, size_channels
from padgen.planner.suspensions import Room
from padgen.spec import Spec
from padgen.units import decibel

__all__ = ["sites_of", "sized_layouts"]

LAYOUTS_SIZED = 24
"""Layouts with room whose beams are sized before giving up."""


def sized_layouts(spec: Spec, options: Iterable[Layout]) -> Iterator[tuple[Layout, tuple[SizedChannel, ...]]]:
    """Those of `options` that hold, in their order, with their beams; one division of each grid and count."""
    seen, tried, far = set(), 0, []
    for layout in options:
        key = (layout.rows, layout.columns, layout.channels)
        if layout.margin_mm < -SLACK_MM or key in seen:
            continue
        if tried >= LAYOUTS_SIZED:
            break
        tried += 1
        channels = _beams(spec, layout.channels, room(spec, layout))
        if channels and _within_reach(spec, layout, channels):
            seen.add(key)
            yield layout, channels
        elif channels and spec.coil.grid:
            far.append((layout, channels))
    # A grid that the user chose is planned even if its coils do not reach; the findings judge it.
    if not seen:
        yield from far[:1]


def _within_reach(spec: Spec, layout: Layout, channels: tuple[SizedChannel, ...]) -> bool:
    """Whether every washer overlaps its coil."""
    sites = sites_of(spec, layout, channels)
    return max(site.coil_distance_mm for site in sites) <= coil_reach_mm(spec) + SLACK_MM


def sites_of(spec: Spec, layout: Layout, channels: tuple[SizedChannel, ...]) -> tuple[Site, ...]:
    """Where each channel's taxel lies in its cell."""
    centres = slots(layout)
    return tuple(
        place(spec, layout, centres[k // spec.coil.sets], channel.model.arrangement)
        for k, channel in enumerate(channels)
    )


@lru_cache(maxsize=64)
def _beams(spec: Spec, count: int, space: Room) -> tuple[SizedChannel, ...] | None:
    """Beams for the first ladder that prints; optimised, for the ladder that is told apart best as printed."""
    sized = (channels for hz in ladders(spec, count, space) if (channels := size_channels(spec, space, hz)))
    if spec.spacing != "optimised":
        return next(sized, None)
    # An optimum for equal masses need not be one for those of the beams.
    return max(sized, key=lambda channels: _printed_figure(spec, channels), default=None)


def _printed_figure(spec: Spec, sized: tuple[SizedChannel, ...]) -> tuple[bool, float]:
    """How good a ladder is as printed: with an automatic drive, plain tones that keep what is asked come first."""
    resonance = np.array([float(channel.model.resonance_hz) for channel in sized])
    mass = np.array([float(channel.model.effective_mass_kg) for channel in sized])
    tones_db = sets_db(spec, resonance, mass, Scheme("tones")) if spec.drive.scheme in ("auto", "tones") else -inf
    if spec.drive.scheme == "tones" or tones_db >= decibel(spec.delta_y):
        return True, tones_db
    scheme = "spur-free" if spec.drive.scheme == "auto" else spec.drive.scheme
    return False, sets_db(spec, resonance, mass, scheme_named(spec, scheme))
