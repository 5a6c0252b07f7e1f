"""Find layouts whose resonances and beams can be made, in order of preference, and the most channels a coil can hold.

The most channels that one coil holds are counted by the paper's bound, by the exact response, and in printed pads.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache, lru_cache, partial
from itertools import islice
from math import ceil, exp, floor, log
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SpecError, at_least, at_most, number
from padgen.core.registry import SCHEMES, SUSPENSIONS
from padgen.core.units import UM, decibel
from padgen.physics.ladder import (
    LevelLaw,
    capacity,
    geometric_ladder,
    ladder_ratio,
    paper_ladder,
    slot_half_width,
    whole_channels,
)
from padgen.physics.schemes import simplest_first
from padgen.physics.selectivity import (
    Channels,
    Scheme,
    all_states,
    channels,
    estimated_print_share,
    loudest_line,
    one_hot_db,
)
from padgen.planner.channels import hanging_gap_um, plan_channels, resting
from padgen.planner.core_pull import snapping_message_and_cures, snaps
from padgen.planner.drive_scheme import chosen_drive
from padgen.planner.layout import (
    SLACK_MM,
    Layout,
    coil_reach_mm,
    room,
    roomy_layouts,
    sub_cell_centres,
    taxel_site,
    with_fitting_coil,
    with_other_coils,
)
from padgen.planner.plan import Capacity, Site, level_law, scheme_named
from padgen.planner.sizing import DRAWN_SHARE, SizedChannel, beam_inputs, beams_for_resonances, reach
from padgen.planner.suspensions import Room, allowed
from padgen.spec import DriveTable, Spec

__all__ = [
    "Optimum",
    "SizedLayout",
    "UnsizedLayout",
    "channel_limit",
    "coil_capacity",
    "ladders",
    "largest_counts",
    "largest_that_holds",
    "layouts_to_size",
    "most_channels_tried",
    "optimum",
    "planned_optimum",
    "printed_count",
    "reachable_hz",
    "sites_of",
    "sized_layouts",
    "slot_band_hz",
    "snapping",
]


KIND = "ladder"
CODE = ("physics", "planner/search.py", "planner/plan.py")
"""Code on which a cached optimum depends."""


class Optimum(NamedTuple):
    """The resonances in Hz that a search found best for a drive scheme, and their selectivity in all states in dB."""

    resonances_hz: tuple[float, ...]
    all_states_db: float
    drive: str


def slot_band_hz(spec: Spec) -> tuple[float, float]:
    """Return the lowest and highest resonance in Hz whose slot lies in the spec's band even if the beam is rounded."""
    half = max(slot_half_width(spec.q_min, spec.delta_y), DRAWN_SHARE)
    return spec.band_hz[0] / (1 - half), spec.band_hz[1] / (1 + half)


def reachable_hz(spec: Spec, room: Room, wanted_hz: tuple[float, float] | None = None) -> tuple[float, float] | None:
    """Return the lowest and highest resonance in Hz that allowed suspensions reach in `room`; None if no beam fits.

    Suspensions that surely do not reach `wanted_hz`, lowest and highest, may be left out.
    """
    names = allowed(spec.suspension.topology)
    spans = [reached.span_hz for name in names if (reached := reach(spec, name, room, wanted_hz))]
    return (min(low for low, _ in spans), max(high for _, high in spans)) if spans else None


def ladders(spec: Spec, count: int, room: Room) -> list[tuple[float, ...]]:
    """Return candidate ladders: rising resonances in Hz, `count` per channel set, for beams in `room`; the best first.

    Resonances that the spec lists are the only candidate. Otherwise the first ladder spreads over the whole band, the
    next over the part of the band that the room reaches, and the last ones are as close as possible at the lower ends.
    All keep the paper's ratio between neighbours of a set. A second set lies half way between those of the first. With
    optimised spacing the optimum comes before these.
    """
    if spec.resonances_hz:
        return [spec.resonances_hz]
    lowest, highest = slot_band_hz(spec)
    sets = spec.coil.sets
    ratio = ladder_ratio(spec.q_min, spec.delta_y)
    spans = [(lowest, highest)]
    if reachable := reachable_hz(spec, room, (lowest, highest)):
        spans.append((max(lowest, reachable[0] * 1.01), min(highest, reachable[1] / 1.01)))
    options = []
    for low, high in spans if spec.spacing != "closest" else ():
        least = low * ratio ** ((count * sets - 1) / sets)
        if high >= least * (1 - 1e-9):
            options.append(geometric_ladder(low, max(high, least), count * sets))
    for low, _ in spans:
        start = low * (1 - slot_half_width(spec.q_min, spec.delta_y))
        first = paper_ladder(start, count, spec.q_min, spec.delta_y)
        options.append(np.stack([first * ratio ** (k / sets) for k in range(sets)], -1).ravel())
    unique = dict.fromkeys(hz for hz in map(_rounded, options) if hz[-1] <= highest * (1 + 1e-8))
    if spec.spacing == "optimised":
        low, high = _span_hz(spec, room)
        # A second set lies at most half a step higher, of a ladder of both sets from end to end: so much is left above.
        half_step = (high / low) ** ((sets - 1) / (2 * count - 1))
        best = optimum(spec, count, low, high / half_step).resonances_hz
        if sets > 1:
            # As many times the first set, the second is as selective if levels follow a power law.
            first = np.array(best)
            closest = (first[1:] / first[:-1]).min(initial=half_step**2) ** 0.5
            best = _rounded(np.stack([first, first * closest], -1).ravel())
        return [best, *unique]
    return list(unique)


def _span_hz(spec: Spec, room: Room) -> tuple[float, float]:
    """Return the part of the spec's band in Hz that beams in `room` can reach; the whole band if they reach none of it.

    Rooms that reach almost the same have the same part, so that they share a search for the optimum.
    """
    reachable = reachable_hz(spec, room, spec.band_hz) or (0.0, float("inf"))
    low = spec.band_hz[0]
    high = spec.band_hz[1]
    if reachable[0] * REACH_MARGIN > low:
        low = _stepped(reachable[0] * REACH_MARGIN, ceil)
    if reachable[1] / REACH_MARGIN < high:
        high = _stepped(reachable[1] / REACH_MARGIN, floor)
    return (low, high) if low < high else spec.band_hz


REACH_MARGIN = 1.005
"""Least distance of a resonance from the last one that a room reaches."""
STEP = 0.005
"""Logarithmic step of the ends of what a room reaches, so that rooms share a search."""
WIDER = 1.15
"""Step between the widths in octaves of the bands that are searched for the global optimum. In narrower bands the
search starts from that: of 200 random bands two lost 0.2 and 0.4 dB and the others at most 0.2."""


def _stepped(hz: float, whole: Callable[[float], int]) -> float:
    """Return a frequency rounded down or up to the grid of logarithmic steps, as `whole` is `floor` or `ceil`."""
    return exp(whole(log(hz) / STEP) * STEP)


def optimum(spec: Spec, count: int, low_hz: float, high_hz: float) -> Optimum:
    """Return the resonances in a band with the best selectivity under the drive scheme of `spec`, for equal masses.

    An automatic scheme takes plain tones if resonances are found that keep the asked selectivity with them, else a
    spur-free drive, else turns. A search takes up to one or two seconds, and its result is kept in the cache. Not so
    for a registered scheme, whose code may be another the next time.
    """
    searched = _searched if SCHEMES.version(spec.drive.scheme) else _known
    return searched(spec, count, low_hz, high_hz)


@lru_cache(maxsize=64)
def _known(spec: Spec, count: int, low_hz: float, high_hz: float) -> Optimum:
    from padgen.core import cache

    drive = spec.drive
    key = cache.key_of(
        {
            "band_hz": (low_hz, high_hz),
            "count": count,
            "q": spec.q_min,
            "delta_y": spec.delta_y,
            "scheme": (drive.scheme, drive.bias_ratio),
            "law": level_law(spec),
            "code": cache.code_hash(*CODE),
            "versions": [cache.version(name) for name in ("numpy", "scipy")],
        }
    )

    def kept() -> Optimum | None:
        entry = cache.load(KIND, key)
        return entry and Optimum(tuple(entry[0]), *entry[1:])

    def made() -> Optimum:
        best = _searched(spec, count, low_hz, high_hz)
        cache.store(KIND, key, best)
        return best

    return cache.get_or_compute(KIND, key, kept, made)


def _searched(spec: Spec, count: int, low_hz: float, high_hz: float) -> Optimum:
    band = (low_hz, high_hz)
    asked_db = decibel(spec.delta_y)
    if spec.drive.scheme != "auto":
        return _band_optimum(spec, count, *band, spec.drive.scheme)
    if spec.force_order == 1:
        return _band_optimum(spec, count, *band, "linear")
    best = None
    # Where as many or fewer channels cannot keep the asked selectivity with plain tones in a wider band, they cannot
    # here.
    if count > 2 and all(
        _wider_band_optimum(spec, few, *band, "tones").all_states_db >= asked_db for few in range(3, count + 1)
    ):
        best = _band_optimum(spec, count, *band, "tones")
    if best is None or best.all_states_db < asked_db:
        best = _band_optimum(spec, count, *band, "spur-free")
    if best.all_states_db < asked_db:
        turns = _band_optimum(spec, count, *band, "time-shared")
        best = turns if turns.all_states_db >= asked_db else best
    return best


def _band_optimum(spec: Spec, count: int, low_hz: float, high_hz: float, drive: str) -> Optimum:
    """Return the most selective resonances in a band for a drive scheme, searched from the optimum of a wider band."""
    law = level_law(spec)
    near_hz = np.array(_wider_band_optimum(spec, count, low_hz, high_hz, drive).resonances_hz)
    return _found(low_hz, high_hz, count, spec.q_min, law, scheme_named(spec, drive), near_hz)


def _wider_band_optimum(spec: Spec, count: int, low_hz: float, high_hz: float, drive: str) -> Optimum:
    """Return the most selective resonances of a wider band, by a global search that bands of similar width share."""
    law = level_law(spec)
    start_hz = low_hz if law.curve_hz else 1.0  # under a power law a shift in octaves changes nothing
    end_hz = start_hz
    if high_hz > low_hz:
        end_hz = start_hz * exp(WIDER ** ceil(log(log(high_hz / low_hz), WIDER)))
    return _searched_all_over(start_hz, end_hz, count, spec.q_min, law, scheme_named(spec, drive))


@lru_cache(maxsize=256)
def _searched_all_over(low_hz: float, high_hz: float, count: int, q: float, law: LevelLaw, scheme: Scheme) -> Optimum:
    return _found(low_hz, high_hz, count, q, law, scheme)


def _found(
    low_hz: float,
    high_hz: float,
    count: int,
    q: float,
    law: LevelLaw,
    scheme: Scheme,
    near_hz: np.ndarray | None = None,
) -> Optimum:
    from padgen.physics.ladder import optimal_ladder

    ladder = optimal_ladder(low_hz, high_hz, count, q, law, scheme, near_hz=near_hz)
    return Optimum(_rounded(ladder), all_states(channels(ladder, q, law(ladder)), scheme).db, scheme.name)


def planned_optimum(spec: Spec, count: int, room: Room) -> Optimum | None:
    """Return the most selective resonances in the part of the band that beams in `room` reach, for equal masses.

    None where the spec does not ask for optimised resonances, and for two sets or a single channel.
    """
    if spec.spacing != "optimised" or spec.resonances_hz or spec.coil.sets > 1 or count < 2:
        return None
    return optimum(spec, count, *_span_hz(spec, room))


def _rounded(ladder: np.ndarray) -> tuple[float, ...]:
    """Return resonances rounded to nine significant digits, so that the plan stays readable."""
    return tuple(float(f"{value:.9g}") for value in ladder)


RINGS = (0.0, 0.8, 1.0)
ALIKE_MM = 0.1
"""Shares of the farthest washer's distance at which the nearer ones are kept, tried where distances differ by more
than `ALIKE_MM`."""
WORTH_DB = 0.5
"""Least gain by keeping washers off the axis, where they take more current and feel more of the coils around."""
LAYOUTS_SIZED = 24
RARE_LAYOUTS_SIZED = 6
CHANNELS_SIZED = 600
"""Layouts, and channels in all of them, whose beams are sized before the search gives up: fewer of suspensions that
only a spec's name asks for (serpentines), whose bent beams take a hundred times as long."""
MOST_OPTIMISED = 6
"""Layouts with optimised resonances, each sized three times, after which the search gives up: of 165 random specs, 164
took one of the first five (docs/accuracy.md)."""


SizedLayout = tuple[Layout, tuple[SizedChannel, ...]]
"""A layout with its sized beams."""
UnsizedLayout = tuple[Spec, Layout, Callable[[], SizedLayout | None]]
"""A spec with the coil that it has with a layout, the layout, and the call that sizes its beams."""
COILS_SIZED = 2
"""Diameters of coils left open with which each layout is tried: the widest almost touch, and leak so much into the
cells beside theirs that some pads would need twice as many of them as of narrower ones (docs/boards.md)."""


def layouts_to_size(spec: Spec, options: Iterable[Layout], most: int | None = None) -> Iterator[UnsizedLayout]:
    """Yield layouts in their order, each with a function that sizes its beams, until `most` work or many were tried.

    The call returns None for a layout that does not work. Of each grid and count of channels only the first division of
    the cell that works is taken. Layouts for coils whose size is left open come with `COILS_SIZED` of them.
    """
    is_usual = set(allowed(spec.suspension.topology)) & set(allowed("auto"))
    most_tried = LAYOUTS_SIZED if is_usual else RARE_LAYOUTS_SIZED
    seen = set[tuple[int, int, int]]()
    tried = 0
    channels_tried = 0
    for layout in options:
        key = (layout.rows, layout.columns, layout.channels)
        if layout.margin_mm < -SLACK_MM or key in seen:
            continue
        is_enough = spec.spacing == "optimised" and len(seen) >= MOST_OPTIMISED
        if tried >= most_tried or channels_tried >= CHANNELS_SIZED or is_enough or len(seen) == most:
            break
        tried = tried + 1
        channels_tried = channels_tried + layout.channels
        fitted = with_fitting_coil(spec, layout)
        others = with_other_coils(fitted, layout) if spec.coil.sizing == "auto" else iter(())
        for one in [fitted, *islice(others, COILS_SIZED - 1)]:
            size = cache(partial(_with_sized_beams, one, layout))
            yield one, layout, size
            if size() is not None:
                seen.add(key)


def sized_layouts(spec: Spec, options: Iterable[Layout]) -> Iterator[SizedLayout]:
    """Yield, in their order, those layouts of `options` for which suitable beams are found, with these beams."""
    for _, _, size in layouts_to_size(spec, options):
        if (sized := size()) is not None:
            yield sized


def _with_sized_beams(spec: Spec, layout: Layout) -> SizedLayout | None:
    """Return a layout with sized beams, its washers moved if that makes it more selective; None if it cannot work.

    Every washer must overlap its coil, and none may snap to its core.
    """
    channels = _beams(spec, layout)
    if not channels:
        return None
    reach_mm = coil_reach_mm(spec) + SLACK_MM
    sites = sites_of(spec, layout, channels)
    if any(spec.coil.off_axis_mm(site.washer_mm) > reach_mm for site in sites):
        return None
    if snaps(resting(spec, channels, sites)):
        return None
    even = _with_even_pull(spec, layout, channels)
    held = even == layout or not snaps(resting(spec, channels, sites_of(spec, even, channels)))
    return (even if held else layout), channels


MOST_SNAPPING = 4
"""Layouts at which is looked whether their movers snap to the coils' cores, after none was found."""


def snapping(spec: Spec) -> tuple[str, list[dict[str, Any]]] | None:
    """Return why movers snap to the coils' cores, and cures, for the first layout where they do; None if none do.

    The `MOST_SNAPPING` layouts with most room are tried.
    """
    roomiest = sorted(roomy_layouts(spec, channel_limit(spec)), key=lambda layout: -layout.margin_mm)
    for layout in roomiest[:MOST_SNAPPING]:
        fitted = with_fitting_coil(spec, layout)
        channels = _beams(fitted, layout)
        if not channels:
            continue
        sites = sites_of(fitted, layout, channels)
        rest = resting(fitted, channels, sites)
        if rest is not None and snaps(rest):
            gap_um = hanging_gap_um(fitted, np.array([float(c.model.sag_m) for c in channels]) / UM)
            stiffness = np.array([float(c.model.stiffness_n_per_m) for c in channels])
            return snapping_message_and_cures(fitted, sites, gap_um, stiffness, rest)
    return None


def _with_even_pull(spec: Spec, layout: Layout, channels: tuple[SizedChannel, ...]) -> Layout:
    """Return the layout, with washers near the coil's axis moved outward if that makes it more selective.

    It does if the more even pull gains over `WORTH_DB` of selectivity.
    """
    distances = [site.coil_distance_mm for site in sites_of(spec, layout, channels)]
    if len(channels) < 2 or max(distances) - min(distances) < ALIKE_MM:
        return layout
    rings = [replace(layout, ring_mm=round(share * max(distances), 6)) for share in RINGS]
    kept_db = [_selectivity_key(spec, ring, channels)[-1] for ring in rings]
    best = max(range(len(rings)), key=lambda k: kept_db[k])
    return rings[best] if kept_db[best] > kept_db[0] + WORTH_DB else layout


def sites_of(spec: Spec, layout: Layout, channels: tuple[SizedChannel, ...]) -> tuple[Site, ...]:
    """Return the place of each channel's taxel in its cell."""
    centres = sub_cell_centres(layout)
    return tuple(
        taxel_site(spec, layout, centres[k // spec.coil.sets], channel.model.arrangement)
        for k, channel in enumerate(channels)
    )


def _beams(spec: Spec, layout: Layout) -> tuple[SizedChannel, ...] | None:
    """Return beams for the first ladder of resonances that can be printed; if optimised, for the most selective one."""
    bare = beam_inputs(spec)
    if spec.spacing == "optimised":
        bare = replace(bare, drive=spec.drive)
    options = _sized(bare, layout.channels, room(spec, layout), SUSPENSIONS.changes)
    if len(options) < 2:
        return options[0] if options else None
    return max(options, key=lambda channels: _selectivity_key(spec, layout, channels))


@lru_cache(maxsize=256)
def _sized(spec: Spec, count: int, space: Room, changes: int) -> tuple[tuple[SizedChannel, ...], ...]:
    """Return sets of beams: for the first printable ladder of resonances or, with optimised spacing, for all."""
    undriven = replace(spec, drive=DriveTable())
    sized = (channels for hz in ladders(spec, count, space) if (channels := _resonating(undriven, space, hz, changes)))
    return tuple(sized if spec.spacing == "optimised" else islice(sized, 1))


@lru_cache(maxsize=256)
def _resonating(
    spec: Spec, space: Room, resonance_hz: tuple[float, ...], changes: int
) -> tuple[SizedChannel, ...] | None:
    """Return beams for given resonances, cached, since beams do not depend on the drive."""
    return beams_for_resonances(spec, space, resonance_hz)


def _selectivity_key(spec: Spec, layout: Layout, sized: tuple[SizedChannel, ...]) -> tuple[bool, int, float]:
    """Return a sort key of a layout: whether it is as selective as asked, how simple its drive is, and its dB."""
    chosen = chosen_drive(spec, plan_channels(spec, sized, sites_of(spec, layout, sized)), asked_only=True)
    keeps = chosen.kept_db >= decibel(spec.delta_y)
    return keeps, -simplest_first(spec.force_order).index(chosen.drive) if keeps else 0, chosen.kept_db


WIDEST_HZ = 1e3
"""The highest end of a wider band that is proposed: what is faster skin hardly feels."""
LARGEST_WITH_SPURS = 32
"""Largest count of channels that is tried with a drive that makes spurs: the spurs of n channels take n³ numbers."""
LARGEST = 4096
"""Largest count of channels that is tried with a drive without spurs."""
LARGEST_PRINTED = 1024
"""Largest count of channels whose prints are judged: of n channels that takes some twenty tables of n² numbers."""
TRIED_SINGLY = 64
"""Counts up to here are tried one by one; above, the largest that holds is guessed, and found in doubling and halving
steps from there."""
GUESSES = 4
MOST_GUESSED_DB = 40.0
"""Most guesses that are made, each from the two before, and the most dB by which what is kept may exceed what is asked
in one."""
USUAL_FALL_DB = 20 / log(10)
LEAST_FALL_DB = 2.0
"""By how much less is kept of e times as many channels: of the first guess, since a taxel beside its resonance hears a
tone in proportion to one over their distance, and at least."""


def channel_limit(spec: Spec) -> int:
    """Return how many channels per coil the paper's bound allows; raise for a band without room for one.

    Raises
    ------
    SpecError
        The band does not hold a single slot.
    """
    lowest = slot_band_hz(spec)[0]
    low, high = spec.band_hz
    if lowest > slot_band_hz(spec)[1] and slot_half_width(spec.q_min, spec.delta_y) < DRAWN_SHARE:
        wider = low * ((1 + DRAWN_SHARE) / (1 - DRAWN_SHARE))
        raise SpecError(
            f"is narrower than beams can be drawn, to {2 * DRAWN_SHARE:.1%}, got {low:.9g} … {high:.9g} Hz",
            "band_hz",
            [{"band_hz": [low, float(at_least(wider))]}],
        )
    count = whole_channels(capacity(low, high, spec.q_min, spec.delta_y))
    if count < 1:
        ratio = ladder_ratio(spec.q_min, spec.delta_y)
        third = (high / low) ** (1 / 3)
        # A wider band or, where there is none, the ON over OFF at which a slot takes a third of the band.
        cure = (
            {"band_hz": [low, float(at_least(low * (ratio * 1.001)))]}
            if low * ratio <= WIDEST_HZ
            else {"delta_y": float(at_most(4 * spec.q_min * (third - 1) / (third + 1)))}
        )
        raise SpecError(
            f"holds no channel: at Q = {spec.q_min:g} a single channel takes a band of 1 : {ratio:.4g} (less at a"
            f" higher q_min), got {number(low)} … {number(high)} Hz (1 : {high / low:.4g})",
            "band_hz",
            [cure],
        )
    return count


def coil_capacity(spec: Spec, scheme: Scheme, limit: str) -> Capacity:
    """Return how many channels one coil can hold with a drive `scheme`; `limit` names what prevents more on the pad."""
    paper = capacity(*spec.band_hz, spec.q_min, spec.delta_y)
    law = level_law(spec)
    # As by the paper, of steel that keeps no magnetisation: other channels would be other currents.
    scheme = scheme._replace(remanence=0.0)
    states, one_hot = largest_counts(spec.band_hz, spec.q_min, law, scheme, decibel(spec.delta_y))
    ratio = ladder_ratio(spec.q_min, spec.delta_y)
    most = most_channels_tried(scheme)
    breaks = "none that was tried"
    if states < most:
        # The line of the drive that shakes an OFF taxel most when there is one channel more.
        ladder = _ladder(spec.band_hz, states + 1, spec.q_min, law)
        off = all_states(ladder, scheme).off
        drivers, kind = loudest_line(ladder, scheme, off)
        makers = f"channel {drivers[0]}" if len(drivers) == 1 else f"channels {drivers[0]} and {drivers[1]}"
        hz = number(float(ladder.resonance_hz[off]))
        breaks = f"the {kind} of {makers} on channel {off} of {states + 1} at {hz} Hz"
    return Capacity(whole_channels(paper), states, ratio, limit, paper, one_hot, breaks, most)


def most_channels_tried(scheme: Scheme) -> int:
    """Return the most channels per coil that are tried for a drive scheme when the capacity of a coil is searched."""
    return LARGEST_WITH_SPURS if scheme.has_pair_spurs else LARGEST


@lru_cache(maxsize=256)
def largest_counts(
    band_hz: tuple[float, float], q: float, law: LevelLaw, scheme: Scheme, target_db: float, most: int = LARGEST
) -> tuple[int, int]:
    """Return two counts: most channels per coil that keep `target_db` in all on/off states, and with one on at a time.

    The channels have equal masses, on a geometric ladder from one end of the band to the other. Up to `most` channels
    are tried; with spurs, in all states, up to `LARGEST_WITH_SPURS`.
    """

    @cache
    def one_hot_kept_db(count: int) -> float:
        return one_hot_db(_ladder(band_hz, count, q, law), scheme)

    @cache
    def states_keep_db(count: int) -> float:
        return all_states(_ladder(band_hz, count, q, law), scheme).db

    def largest(kept_db: Callable[[int], float], high: int) -> int:
        near = TRIED_SINGLY
        fall_db = USUAL_FALL_DB
        for _ in range(GUESSES):
            spare_db = min(kept_db(near) - target_db, MOST_GUESSED_DB)
            guess = min(int(near * exp(spare_db / fall_db)), high)
            if guess <= TRIED_SINGLY or guess == near:
                break
            fall_db = max((kept_db(near) - kept_db(guess)) / log(guess / near), LEAST_FALL_DB)
            near = guess
        return largest_that_holds(lambda count: kept_db(count) >= target_db, TRIED_SINGLY, high, near)

    singly = min(TRIED_SINGLY, most)
    one_hot = next((count - 1 for count in range(2, singly + 1) if one_hot_kept_db(count) < target_db), singly)
    # From above, since no count keeps more in all states than with one channel on.
    from_above = range(min(one_hot, most_channels_tried(scheme)), 1, -1)
    states = next((count for count in from_above if states_keep_db(count) >= target_db), 1)
    if one_hot == TRIED_SINGLY:
        one_hot = largest(one_hot_kept_db, most)
        if states == TRIED_SINGLY:
            states = largest(states_keep_db, one_hot)
    return states, one_hot


def printed_count(
    band_hz: tuple[float, float],
    q: float,
    law: LevelLaw,
    scheme: Scheme,
    target_db: float,
    share: float,
    coils: int,
    followed: float,
    missed: float = 0.0,
) -> int:
    """Return the most channels, on a geometric ladder of resonances, with which a `share` of prints keeps `target_db`.

    At most `LARGEST_PRINTED` are tried. Computed by `padgen.physics.selectivity.print_share`. `followed` is the sigma
    of ln f of a taxel that its re-tuned tone follows, `missed` the sigma that the tone does not follow.
    """

    scheme = scheme._replace(remanence=0.0)

    def holds(count: int) -> bool:
        ladder = _ladder(band_hz, count, q, law)
        return estimated_print_share(ladder, scheme, 10 ** (target_db / 10), coils, followed, missed, share) >= share

    most = min(largest_counts(band_hz, q, law, scheme, target_db)[0], LARGEST_PRINTED)
    if most <= TRIED_SINGLY:
        return next((n for n in range(most, 1, -1) if holds(n)), 1)
    return largest_that_holds(holds, 1, most)


def largest_that_holds(holds: Callable[[int], bool], low: int, high: int, near: int | None = None) -> int:
    """Return the largest count in `low` … `high` for which `holds` is true; it is true at `low`, changes at most once.

    Steps from `near`, up where that holds and else down, double until a count answers otherwise, and then halve: the
    work grows with the square of a count or faster. A guess is often off by one or two: the first two steps from it are
    alike.
    """
    failing = high + 1
    is_alike = near is not None
    if near is not None and near > low:
        low, failing = (near, failing) if holds(near) else (low, near)
    is_upwards = failing > high
    is_between = False
    step = 1
    while failing - low > 1:
        tried = min(low + step, high) if is_upwards else max(failing - step, low + 1)
        if is_between:
            tried = (low + failing) // 2
        held = holds(tried)
        low, failing = (tried, failing) if held else (low, tried)
        is_between = is_between or held != is_upwards
        if not is_alike:
            step *= 2
        is_alike = False
    return low


def _ladder(band_hz: tuple[float, float], count: int, q: float, law: LevelLaw) -> Channels:
    resonance = geometric_ladder(*band_hz, count)
    return channels(resonance, q, law(resonance))
