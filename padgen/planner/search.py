"""Search layouts that work and size their beams: first the room, then resonances and beams for that room."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import islice
from math import inf

from padgen.physics.schemes import simplest_first
from padgen.planner.channels import plan_channels
from padgen.planner.drive_scheme import plan_selectivity
from padgen.planner.layout import SLACK_MM, Layout, coil_reach_mm, place, room, slots
from padgen.planner.plan import Site
from padgen.planner.resonances import ladders
from padgen.planner.sizing import SizedChannel, beams_for_resonances
from padgen.planner.suspensions import Room
from padgen.spec import Spec

__all__ = ["sites_of", "sized_layouts"]

RINGS, ALIKE_MM = (0.0, 0.8, 1.0), 0.1
"""Shares of the farthest washer's distance at which the nearer ones are kept, tried where distances differ by more
than `ALIKE_MM`."""
WORTH_DB = 0.5
"""Least gain by keeping washers off the axis, where they take more current and feel more of the coils around."""
LAYOUTS_SIZED, CHANNELS_SIZED = 24, 600
"""Layouts, and channels in all of them, whose beams are sized before the search gives up."""


def sized_layouts(spec: Spec, options: Iterable[Layout]) -> Iterator[tuple[Layout, tuple[SizedChannel, ...]]]:
    """Yield the `options` that work, in their order, with sized beams.

    Of each grid and count of channels only the first division of the cell that works is taken.
    """
    seen, tried, sized = set(), 0, 0
    for layout in options:
        key = (layout.rows, layout.columns, layout.channels)
        if layout.margin_mm < -SLACK_MM or key in seen:
            continue
        if tried >= LAYOUTS_SIZED or sized >= CHANNELS_SIZED:
            break
        tried, sized = tried + 1, sized + layout.channels
        channels = _beams(spec, layout)
        if channels and _within_reach(spec, layout, channels):
            seen.add(key)
            yield _with_even_pull(spec, layout, channels), channels


def _within_reach(spec: Spec, layout: Layout, channels: tuple[SizedChannel, ...]) -> bool:
    """Return whether every washer overlaps its coil."""
    sites = sites_of(spec, layout, channels)
    return max(site.coil_distance_mm for site in sites) <= coil_reach_mm(spec) + SLACK_MM


def _with_even_pull(spec: Spec, layout: Layout, channels: tuple[SizedChannel, ...]) -> Layout:
    """Return the layout with near washers moved off the coil's axis, if a more even pull gains over `WORTH_DB`."""
    distances = [site.coil_distance_mm for site in sites_of(spec, layout, channels)]
    if len(channels) < 2 or max(distances) - min(distances) < ALIKE_MM:
        return layout
    rings = [replace(layout, ring_mm=round(share * max(distances), 6)) for share in RINGS]
    kept_db = [_selectivity_key(spec, ring, channels)[-1] for ring in rings]
    best = max(range(len(rings)), key=lambda k: kept_db[k])
    return rings[best] if kept_db[best] > kept_db[0] + WORTH_DB else layout


def sites_of(spec: Spec, layout: Layout, channels: tuple[SizedChannel, ...]) -> tuple[Site, ...]:
    """Return the place of each channel's taxel in its cell."""
    centres = slots(layout)
    return tuple(
        place(spec, layout, centres[k // spec.coil.sets], channel.model.arrangement)
        for k, channel in enumerate(channels)
    )


def _beams(spec: Spec, layout: Layout) -> tuple[SizedChannel, ...] | None:
    """Return beams for the first ladder that prints; with optimised spacing, for the most selective as printed."""
    # The gap moves no resonance, so that all gaps share one cached search.
    options = _sized(replace(spec, coil=replace(spec.coil, gap_mm=1.0)), layout.channels, room(spec, layout))
    if len(options) < 2:
        return options[0] if options else None
    return max(options, key=lambda channels: _selectivity_key(spec, layout, channels))


@lru_cache(maxsize=64)
def _sized(spec: Spec, count: int, space: Room) -> tuple[tuple[SizedChannel, ...], ...]:
    """Return beams for the first ladder that prints; with optimised spacing, for all ladders that print."""
    sized = (channels for hz in ladders(spec, count, space) if (channels := beams_for_resonances(spec, space, hz)))
    return tuple(sized if spec.spacing == "optimised" else islice(sized, 1))


def _selectivity_key(spec: Spec, layout: Layout, sized: tuple[SizedChannel, ...]) -> tuple[bool, int, float]:
    """Return a sort key: whether the asked selectivity is kept, how simple the drive is, and the dB kept."""
    figures = plan_selectivity(spec, plan_channels(spec, sized, sites_of(spec, layout, sized)), asked_only=True)
    kept_db = inf if figures.kept_db is None else figures.kept_db
    keeps = kept_db >= figures.asked_db
    return keeps, -simplest_first().index(figures.drive) if keeps else 0, kept_db
