"""Allocation: how far a coil's channels can be told apart in the band, from Eq. 12 to the optimum."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from padgen.ladders.rung import Ladder, Rung, Solved
from padgen.ladders.stages.scene import Scene
from padgen.physics.ladder import geometric_ladder
from padgen.physics.optimal_ladder import optimal_ladder
from padgen.physics.selectivity import Channels, all_states, channels, one_hot_db
from padgen.planner.settings import level_law, scheme_named
from padgen.spec import Spec

__all__ = ["allocation_ladders", "bound_promise", "even_ratio", "optimal_ratio"]

EFFORTS = (0.1, 0.3, 1.0)
"""Shares of the random sets that are improved, and of the linear programs."""


def allocation_ladders(scene: Scene) -> Iterator[Ladder]:
    """One ladder: the smallest ON over the largest OFF amplitude in all states, equal masses, in the spec's band."""
    spec, drive = scene.plan.spec, scene.plan.selectivity.drive
    count = len(scene.plan.sets[0])
    if count < 2:
        return
    solve = (spec, drive, count)
    rungs = [
        Rung("paper's bound", "Eq. 12", partial(bound_promise, *solve)),
        Rung("exact response", "one channel on", partial(even_ratio, *solve, True)),
        Rung("exact response", "all states", partial(even_ratio, *solve, False)),
    ]
    rungs += [
        Rung("optimised", f"{effort:.0%} of the search", partial(optimal_ratio, *solve, effort), "optimised")
        for effort in EFFORTS
    ]
    low, high = spec.band_hz
    yield Ladder(
        "allocation",
        f"{count} channels in {low:g} … {high:g} Hz, driven {drive}",
        "ON over OFF amplitude in all states",
        "",
        tuple(rungs),
        "optimised",
        note="the first three are of resonances evenly in octaves: what they lack is what another choice would gain;"
        " a search proves nothing: docs/selectivity.md compares it with what has been proven",
    )


def bound_promise(spec: Spec, drive: str, count: int) -> Solved:
    """Δy that Eq. 12 promises for `count` channels evenly in octaves: ``4 Q (ρ − 1)/(ρ + 1)``."""
    ratio = (spec.band_hz[1] / spec.band_hz[0]) ** (1 / (count - 1))
    return Solved(np.array([4 * spec.q_min * (ratio - 1) / (ratio + 1)]))


def even_ratio(spec: Spec, drive: str, count: int, one_hot: bool) -> Solved:
    """The exact figure of resonances evenly in octaves."""
    which, scheme = _resonators(spec, geometric_ladder(*spec.band_hz, count)), scheme_named(spec, drive)
    return _as_ratio(one_hot_db(which, scheme) if one_hot else all_states(which, scheme).db, count)


def optimal_ratio(spec: Spec, drive: str, count: int, effort: float) -> Solved:
    """The figure of the best resonances that a search of this effort finds."""
    scheme = scheme_named(spec, drive)
    ladder = optimal_ladder(*spec.band_hz, count, spec.q_min, level_law(spec), scheme, effort)
    return _as_ratio(all_states(_resonators(spec, ladder), scheme).db, count)


def _resonators(spec: Spec, resonance_hz: np.ndarray) -> Channels:
    return channels(resonance_hz, spec.q_min, level_law(spec)(resonance_hz))


def _as_ratio(decibel: float, count: int) -> Solved:
    return Solved(np.array([10 ** (decibel / 20)]), count)
