"""How many channels one coil holds: by the paper's bound and by the exact response."""

from collections.abc import Callable
from functools import lru_cache

from padgen.core.errors import SpecError, at_least, at_most, number
from padgen.core.units import decibel
from padgen.physics.ladder import capacity, geometric_ladder, ladder_ratio, slot_half_width, whole_channels
from padgen.physics.levels import LevelLaw
from padgen.physics.selectivity import Channels, Scheme, all_states, channels, loudest_line, one_hot_db, print_share
from padgen.planner.plan import Capacity
from padgen.planner.printable import DRAWN_SHARE
from padgen.planner.resonances import slot_band_hz
from padgen.planner.settings import level_law
from padgen.spec import Spec

__all__ = ["channel_limit", "coil_capacity", "largest_counts", "printed_count", "searched_to"]

WIDEST_HZ = 1e5
LARGEST_WITH_SPURS = 32
"""Exact capacities are searched up to here: the spurs of n channels take n³ numbers."""
LARGEST = 4096
"""The same without spurs."""
SCANNED = 64
"""Counts that are tried one by one; beyond, a figure that falls with the count is bisected."""


def channel_limit(spec: Spec) -> int:
    """Channels per coil that the paper's bound allows, at least one.

    Raises
    ------
    SpecError
        The band does not hold a single slot.
    """
    low, high = slot_band_hz(spec)
    if low > high and slot_half_width(spec.q_min, spec.delta_y) < DRAWN_SHARE:
        raise SpecError(
            f"is narrower than beams can be drawn, to {2 * DRAWN_SHARE:.1%}, got {spec.band_hz[0]:.9g} …"
            f" {spec.band_hz[1]:.9g} Hz",
            "band_hz",
            [_band_up_to(spec, (1 + DRAWN_SHARE) / (1 - DRAWN_SHARE))],
        )
    count = whole_channels(_paper(spec))
    if count < 1:
        low, ratio = spec.band_hz[0], ladder_ratio(spec.q_min, spec.delta_y)
        wider = low * ratio <= WIDEST_HZ
        raise SpecError(
            f"holds no channel: at Q = {spec.q_min:g} one slot needs a band of 1 : {ratio:.4g},"
            f" got {number(low)} … {number(spec.band_hz[1])} Hz",
            "band_hz",
            [_band_up_to(spec, ratio * 1.001)] if wider else _selective_q(spec),
        )
    return count


def _band_up_to(spec: Spec, ratio: float) -> dict[str, list[float]]:
    """The band with its upper end at so many times the lower one, as a cure."""
    return {"band_hz": [spec.band_hz[0], float(at_least(spec.band_hz[0] * ratio))]}


def _selective_q(spec: Spec) -> list[dict[str, float]]:
    """A ratio of ON over OFF with which a slot is a third of the band, as a cure."""
    third = (spec.band_hz[1] / spec.band_hz[0]) ** (1 / 3)
    return [{"delta_y": float(at_most(4 * spec.q_min * (third - 1) / (third + 1)))}]


def coil_capacity(spec: Spec, scheme: Scheme, limit: str) -> Capacity:
    """The plan's `Capacity` with the drive `scheme`; `limit` names what keeps the pad from more."""
    paper, law = _paper(spec), level_law(spec)
    states, one_hot = largest_counts(spec.band_hz, spec.q_min, law, scheme, decibel(spec.delta_y))
    ratio = ladder_ratio(spec.q_min, spec.delta_y)
    breaks = _what_breaks(spec.band_hz, states + 1, spec.q_min, law, scheme)
    return Capacity(whole_channels(paper), states, ratio, limit, paper, one_hot, breaks, searched_to(scheme))


def searched_to(scheme: Scheme) -> int:
    """How many channels the all-state capacity of a scheme is searched up to."""
    return LARGEST_WITH_SPURS if scheme.has_pair_spurs else LARGEST


@lru_cache(maxsize=256)
def largest_counts(
    band_hz: tuple[float, float], q: float, law: LevelLaw, scheme: Scheme, target_db: float, most: int = LARGEST
) -> tuple[int, int]:
    """Most channels on a geometric ladder from one end of the band to the other that keep `target_db`.

    In all states and with one channel on; equal masses. Searched up to `most` channels, in all states
    of schemes with spurs up to `LARGEST_WITH_SPURS`.
    """

    def one_hot_holds(count: int) -> bool:
        return one_hot_db(_ladder(band_hz, count, q, law), scheme) >= target_db

    def states_hold(count: int) -> bool:
        return all_states(_ladder(band_hz, count, q, law), scheme).db >= target_db

    one_hot = states = 1
    for count in range(2, min(SCANNED, most) + 1):
        which = _ladder(band_hz, count, q, law)
        if count <= searched_to(scheme) and all_states(which, scheme).db >= target_db:
            states = count
        if one_hot_db(which, scheme) < target_db:
            return states, one_hot
        one_hot = count
    if most <= SCANNED:
        return states, one_hot
    one_hot = _last(one_hot_holds, SCANNED, most)
    return (_last(states_hold, SCANNED, one_hot) if states == SCANNED else states), one_hot


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
    """Most channels on the ladders of `largest_counts` of which `share` of the pads keep `target_db`.

    By `padgen.physics.selectivity.print_share`: `followed` is the sigma of ln f of each taxel that tones follow,
    `missed` that which they do not.
    """

    def holds(count: int) -> bool:
        which = _ladder(band_hz, count, q, law)
        return print_share(which, scheme, 10 ** (target_db / 10), coils, followed, missed, share) >= share

    most, _ = largest_counts(band_hz, q, law, scheme, target_db)
    return next((n for n in range(most, 1, -1) if holds(n)), 1) if most <= SCANNED else _last(holds, 1, most)


def _last(holds: Callable[[int], bool], low: int, high: int) -> int:
    """Largest count from `low`, which holds, to `high` that holds, for a figure that falls with the count."""
    if holds(high):
        return high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _ladder(band_hz: tuple[float, float], count: int, q: float, law: LevelLaw) -> Channels:
    resonance = geometric_ladder(*band_hz, count)
    return channels(resonance, q, law(resonance))


def _what_breaks(band_hz: tuple[float, float], count: int, q: float, law: LevelLaw, scheme: Scheme) -> str:
    """Which line makes `count` channels too many."""
    if count > searched_to(scheme):
        return "none that was tried"
    which = _ladder(band_hz, count, q, law)
    off = all_states(which, scheme).off
    drivers, kind = loudest_line(which, scheme, off)
    heard = f"channel {off} of {count} at {number(float(which.resonance_hz[off]))} Hz"
    if len(drivers) == 1:
        return f"the {kind} of channel {drivers[0]} on {heard}"
    return f"the {kind} of channels {drivers[0]} and {drivers[1]} on {heard}"


def _paper(spec: Spec) -> float:
    return capacity(*spec.band_hz, spec.q_min, spec.delta_y)
