"""Which drive scheme a coil gets, and how far OFF taxels then stay below ON taxels."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import inf
from time import perf_counter

import numpy as np

from padgen.physics.levels import LevelLaw
from padgen.physics.selectivity import SCHEMES, Channels, Scheme, all_states, channels, one_hot_db, tone_energy
from padgen.planner.plan import Channel, Plan, SchemeFigures, Selectivity, channel_sets
from padgen.spec import Spec
from padgen.units import decibel

__all__ = ["level_law", "plan_selectivity", "run_times_s", "scheme_named"]

SIMPLEST_FIRST = ("tones", "biased", "spur-free", "time-shared")
"""By what the electronics must do: sines; sines on a constant; a root; and, slow, one at a time."""
MOST_SPELLED_OUT = 16
"""Channels up to which a plan lists how each hears each."""
MOST_WITH_SPURS = 256
"""Channels up to which the n³ spurs of a scheme are counted that was not asked for."""


def level_law(spec: Spec) -> LevelLaw:
    """The level law of a spec: its exponent, or equal sensation where it has a threshold curve."""
    drive = spec.drive
    return LevelLaw(drive.level_law, drive.threshold_hz or (), drive.threshold_um or ())


def scheme_named(spec: Spec, name: str) -> Scheme:
    """The scheme called `name` with the settings of `spec`."""
    return Scheme(name, spec.drive.bias_ratio)


def plan_selectivity(spec: Spec, planned: Sequence[Channel], bound_db: float | None = None) -> Selectivity:
    """Choose the drive scheme for the channels of a coil, and judge it; `bound_db` is passed on.

    With two sets of channels, for the worse one.
    """
    sets = channel_sets(planned, spec.coil.sets)
    even = [_resonators(spec, own, "printed") for own in sets]
    figures = {name: _figures(spec, even, name) for name in SCHEMES}
    name, why = _chosen(spec, figures, len(sets[0]))
    scheme = scheme_named(spec, name)
    states = min((all_states(which, scheme) for which in even), key=lambda found: found.db)
    placed = [_resonators(spec, own, "placed") for own in sets]
    asked = [_resonators(spec, own, "asked") for own in sets]
    alone = len(sets[0]) < 2
    return Selectivity(
        drive=name,
        level_law="threshold" if spec.drive.threshold_hz else spec.drive.level_law,
        one_hot_db=None if alone else min(one_hot_db(which, scheme) for which in even),
        all_states_db=None if alone else states.db,
        worst_state=states.state,
        asked_db=decibel(spec.delta_y),
        placed_one_hot_db=None if alone else min(one_hot_db(which, scheme) for which in placed),
        placed_all_states_db=None if alone else _worst_db(placed, scheme),
        why=why,
        paper_db=None if alone else _paper_db(spec, planned),
        snapping_db=None if alone else _worst_db(asked, scheme) - states.db,
        bound_db=bound_db,
        matrix_db=tuple(_matrix_db(which) for which in even) if len(sets[0]) <= MOST_SPELLED_OUT else (),
        schemes=tuple(figures.values()),
    )


def _matrix_db(which: Channels) -> tuple[tuple[float, ...], ...]:
    below = -10 * np.log10(tone_energy(which, which))
    return tuple(tuple(float(value) + 0.0 for value in row) for row in below)


def _worst_db(sets: Sequence[Channels], scheme: Scheme) -> float:
    return min(all_states(which, scheme).db for which in sets)


def run_times_s(plan: Plan) -> tuple[float, float]:
    """What the paper's bound and the exact figures take to compute for this plan, in s, best of three."""
    spec, figures = plan.typed_spec, plan.selectivity
    scheme = scheme_named(spec, figures.drive)

    def exact() -> None:
        for own in plan.sets:
            which = _resonators(spec, own, "printed")
            one_hot_db(which, scheme)
            all_states(which, scheme)

    return _best_of_three(lambda: _paper_db(spec, plan.channels)), _best_of_three(exact)


def _best_of_three(work: Callable[[], object]) -> float:
    times = []
    for _ in range(3):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def _resonators(spec: Spec, planned: Sequence[Channel], which: str) -> Channels:
    """Channels as printed, as printed with each washer's own pull ('placed'), or as the ladder 'asked'."""
    resonance = np.array([c.target_hz if which == "asked" else c.resonance_hz for c in planned])
    mass = np.array([c.effective_mass_g for c in planned])
    pull = np.array([c.force_constant_n_per_a2 for c in planned])
    use_pull = which == "placed" and (pull > 0).all()
    q = np.array([c.q for c in planned])
    return channels(resonance, q, level_law(spec)(resonance), mass, pull if use_pull else 1.0)


def _figures(spec: Spec, sets: Sequence[Channels], name: str) -> SchemeFigures:
    count = len(sets[0].line)
    cubic = name in ("tones", "biased") and count > MOST_WITH_SPURS and name != spec.drive.scheme
    if count < 2 or cubic:
        return SchemeFigures(name, None, None)
    scheme = scheme_named(spec, name)
    return SchemeFigures(name, min(one_hot_db(which, scheme) for which in sets), _worst_db(sets, scheme))


def _chosen(spec: Spec, figures: dict[str, SchemeFigures], count: int) -> tuple[str, str]:
    """Name of the scheme, and why it is this one."""
    if spec.drive.scheme != "auto":
        return spec.drive.scheme, "as the spec asks"
    if count <= 2:
        return "tones", "plain tones are the simplest, and no third taxel is there for their spurs to fall on"
    asked = decibel(spec.delta_y)
    reached = {name: _reached(figures[name]) for name in SIMPLEST_FIRST}
    holds = [name for name in SIMPLEST_FIRST if reached[name] >= asked]
    if holds:
        simpler = SIMPLEST_FIRST[: SIMPLEST_FIRST.index(holds[0])]
        missed = ", ".join(f"{name} {reached[name]:.1f} dB" for name in simpler if reached[name] > -inf)
        return holds[0], f"the simplest that reaches {asked:.1f} dB in all states" + (f" ({missed})" if missed else "")
    # Taking turns costs level and frame rate, which only buys something where it meets what was asked.
    together = SIMPLEST_FIRST[:-1]
    best = max(together, key=lambda name: reached[name])
    others = ", ".join(f"{name} {reached[name]:.1f} dB" for name in SIMPLEST_FIRST if name != best)
    return best, f"no scheme reaches {asked:.1f} dB in all states; it comes nearest of those that drive all at once" + (
        f" ({others})" if others else ""
    )


def _reached(figures: SchemeFigures) -> float:
    return -inf if figures.all_states_db is None else figures.all_states_db


def _paper_db(spec: Spec, planned: Sequence[Channel]) -> float:
    """What Eq. 12's slots promise for the closest pair: ``Δy = 4 Q (ρ − 1)/(ρ + 1)``."""
    sets = channel_sets(planned, spec.coil.sets)
    ratio = min(b.resonance_hz / a.resonance_hz for own in sets for a, b in pairwise(own))
    return decibel(4 * spec.q_min * (ratio - 1) / (ratio + 1))
