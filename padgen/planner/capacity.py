"""Count the channels that one coil holds: by the paper's bound, by the exact response, and in printed pads."""

from collections.abc import Callable
from functools import lru_cache

from padgen.core.errors import SpecError, at_least, at_most, number
from padgen.core.units import decibel
from padgen.physics.ladder import LevelLaw, capacity, geometric_ladder, ladder_ratio, slot_half_width, whole_channels
from padgen.physics.selectivity import Channels, Scheme, all_states, channels, loudest_line, one_hot_db, print_share
from padgen.planner.plan import Capacity, level_law
from padgen.planner.search import slot_band_hz
from padgen.planner.sizing import DRAWN_SHARE
from padgen.spec import Spec

__all__ = ["channel_limit", "coil_capacity", "largest_counts", "printed_count", "searched_to"]

WIDEST_HZ = 1e5
LARGEST_WITH_SPURS = 32
"""Largest count of channels that is tried with a drive that makes spurs: the spurs of n channels take n³ numbers."""
LARGEST = 4096
"""Largest count of channels that is tried with a drive without spurs."""
TRIED_SINGLY = 64
"""Counts up to here are tried one by one; above, the largest that holds is found in doubling and halving steps."""


def channel_limit(spec: Spec) -> int:
    """Return how many channels per coil the paper's bound allows, at least one.

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
    count = whole_channels(_paper_capacity(spec))
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
    """Return a cure: the band with its upper end moved to `ratio` times the lower end."""
    return {"band_hz": [spec.band_hz[0], float(at_least(spec.band_hz[0] * ratio))]}


def _selective_q(spec: Spec) -> list[dict[str, float]]:
    """Return a cure: the delta_y (ON over OFF) at which a slot takes a third of the band."""
    third = (spec.band_hz[1] / spec.band_hz[0]) ** (1 / 3)
    return [{"delta_y": float(at_most(4 * spec.q_min * (third - 1) / (third + 1)))}]


def coil_capacity(spec: Spec, scheme: Scheme, limit: str) -> Capacity:
    """Return the plan's `Capacity` with the drive `scheme`; `limit` names what prevents more channels on the pad."""
    paper, law = _paper_capacity(spec), level_law(spec)
    states, one_hot = largest_counts(spec.band_hz, spec.q_min, law, scheme, decibel(spec.delta_y))
    ratio = ladder_ratio(spec.q_min, spec.delta_y)
    breaks = _loudest_line_text(spec.band_hz, states + 1, spec.q_min, law, scheme)
    return Capacity(whole_channels(paper), states, ratio, limit, paper, one_hot, breaks, searched_to(scheme))


def searched_to(scheme: Scheme) -> int:
    """Return the largest count of channels that is tried for the all-state capacity of a scheme."""
    return LARGEST_WITH_SPURS if scheme.has_pair_spurs else LARGEST


@lru_cache(maxsize=256)
def largest_counts(
    band_hz: tuple[float, float], q: float, law: LevelLaw, scheme: Scheme, target_db: float, most: int = LARGEST
) -> tuple[int, int]:
    """Return the most channels that keep a selectivity of `target_db` in all states, and the most with one channel on.

    The channels have equal masses, on a geometric ladder from one end of the band to the other. Up to `most` channels
    are tried; with spurs, in all states, up to `LARGEST_WITH_SPURS`.
    """

    def one_hot_holds(count: int) -> bool:
        return one_hot_db(_ladder(band_hz, count, q, law), scheme) >= target_db

    def states_hold(count: int) -> bool:
        return all_states(_ladder(band_hz, count, q, law), scheme).db >= target_db

    singly = min(TRIED_SINGLY, most)
    one_hot = next((count - 1 for count in range(2, singly + 1) if not one_hot_holds(count)), singly)
    # From above, since no count keeps more in all states than with one channel on.
    states = next((count for count in range(min(one_hot, searched_to(scheme)), 1, -1) if states_hold(count)), 1)
    if one_hot == TRIED_SINGLY:
        one_hot = _largest_that_holds(one_hot_holds, TRIED_SINGLY, most)
        if states == TRIED_SINGLY:
            states = _largest_that_holds(states_hold, TRIED_SINGLY, one_hot)
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
    """Return the most channels with which a `share` of the printed pads keeps `target_db`, on a geometric ladder.

    Computed by `padgen.physics.selectivity.print_share`. `followed` is the sigma of ln f of a taxel that its re-tuned
    tone follows, `missed` the sigma that the tone does not follow.
    """

    def holds(count: int) -> bool:
        ladder = _ladder(band_hz, count, q, law)
        return print_share(ladder, scheme, 10 ** (target_db / 10), coils, followed, missed, share) >= share

    most, _ = largest_counts(band_hz, q, law, scheme, target_db)
    return (
        next((n for n in range(most, 1, -1) if holds(n)), 1)
        if most <= TRIED_SINGLY
        else _largest_that_holds(holds, 1, most)
    )


def _largest_that_holds(holds: Callable[[int], bool], low: int, high: int) -> int:
    """Return the largest count from `low` to `high` that holds; `low` holds, and above a failing count all fail.

    The steps up from `low` double until one fails, and then halve: the work grows with the square of a count or faster.
    """
    step, failing = 1, high + 1
    while failing - low > 1:
        tried = min(low + step, high) if failing > high else (low + failing) // 2
        low, failing = (tried, failing) if holds(tried) else (low, tried)
        step *= 2
    return low


def _ladder(band_hz: tuple[float, float], count: int, q: float, law: LevelLaw) -> Channels:
    resonance = geometric_ladder(*band_hz, count)
    return channels(resonance, q, law(resonance))


def _loudest_line_text(band_hz: tuple[float, float], count: int, q: float, law: LevelLaw, scheme: Scheme) -> str:
    """Name the line of the drive that shakes an OFF taxel most when a coil has `count` channels."""
    if count > searched_to(scheme):
        return "none that was tried"
    ladder = _ladder(band_hz, count, q, law)
    off = all_states(ladder, scheme).off
    drivers, kind = loudest_line(ladder, scheme, off)
    heard = f"channel {off} of {count} at {number(float(ladder.resonance_hz[off]))} Hz"
    if len(drivers) == 1:
        return f"the {kind} of channel {drivers[0]} on {heard}"
    return f"the {kind} of channels {drivers[0]} and {drivers[1]} on {heard}"


def _paper_capacity(spec: Spec) -> float:
    return capacity(*spec.band_hz, spec.q_min, spec.delta_y)
