"""How many channels one coil holds: by the paper's bound and by the exact response."""

import numpy as np

from padgen.errors import SpecError, at_least
from padgen.physics.ladder import capacity, geometric_ladder, ladder_ratio, slot_half_width, whole_channels
from padgen.physics.selectivity import all_states_db, crosstalk, one_hot_db
from padgen.planner.plan import Capacity
from padgen.planner.resonances import DRAWN_SHARE, slot_band_hz
from padgen.spec import Spec
from padgen.units import decibel

__all__ = ["channel_limit", "coil_capacity"]

WIDEST_HZ = 1e5
LARGEST_COUNT = 32
"""Exact capacities are searched up to here: the spurs of n channels take n³ numbers."""


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
            f" {spec.band_hz[1]:.9g} Hz; the nearest that would do is up to"
            f" {at_least(spec.band_hz[0] * (1 + DRAWN_SHARE) / (1 - DRAWN_SHARE))} Hz",
            "band_hz",
        )
    count = whole_channels(_paper(spec))
    if count < 1:
        low, ratio = spec.band_hz[0], ladder_ratio(spec.q_min, spec.delta_y)
        cure = f"e.g. [{low:g}, {low * ratio * 1.001:.4g}] Hz"
        if low * ratio > WIDEST_HZ:
            cure = f"more than any band; raise Q or lower delta_y, e.g. q_min = {at_least(spec.delta_y)}"
        raise SpecError(
            f"holds no channel: at Q = {spec.q_min:g} one slot needs a band of 1 : {ratio:.4g}, {cure}",
            "band_hz",
        )
    return count


def coil_capacity(spec: Spec, limit: str) -> Capacity:
    """The plan's `Capacity`; `limit` names what keeps the pad from more."""
    paper = _paper(spec)
    target_db = decibel(spec.delta_y)
    exact, one_hot = 1, 1
    for count in range(2, min(max(whole_channels(paper) * 2, 4), LARGEST_COUNT) + 1):
        ladder = geometric_ladder(*slot_band_hz(spec), count)
        ones = np.ones(count)
        talk = crosstalk(ladder, ones, spec.q_min * ones, spec.drive.level_law)
        if one_hot_db(talk) >= target_db:
            one_hot = count
        if all_states_db(talk)[0] >= target_db:
            exact = count
        if one_hot < count:
            break
    ratio = ladder_ratio(spec.q_min, spec.delta_y)
    return Capacity(whole_channels(paper), exact, ratio, limit, paper, one_hot)


def _paper(spec: Spec) -> float:
    return capacity(*spec.band_hz, spec.q_min, spec.delta_y)
