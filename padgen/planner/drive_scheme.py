"""Choose a coil's drive scheme, and work out how far OFF taxels then stay below ON taxels."""

from collections.abc import Sequence
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from padgen.core.errors import number
from padgen.core.units import decibel
from padgen.physics.resonator import ModalTaxels
from padgen.physics.schemes import in_order, simplest_first
from padgen.physics.selectivity import Channels, Scheme, all_states, channels, one_hot_db, tone_energy
from padgen.planner.coil_load import coil_load, is_fed
from padgen.planner.frame_rates import frame_rates
from padgen.planner.plan import Channel, Plan, SchemeFigures, Selectivity, channel_sets
from padgen.planner.pull_modes import MODES_DB, coil_modes, heard_modes, modes_in_slots
from padgen.planner.settings import level_law, passes, scheme_named
from padgen.spec import Spec

if TYPE_CHECKING:
    from padgen.planner.resonances import Optimum

__all__ = ["modes_matter", "placed_channels", "plan_selectivity"]

MOST_SPELLED_OUT = 16
"""Channels per coil up to which a plan lists how much each channel's tone moves every other taxel."""
UNPULLED = 1e-12
"""Share of the strongest pull that stands in for no pull at all."""
MOST_WITH_SPURS = 256
"""Channels per coil up to which schemes that the spec does not ask for are judged, where they have n³ spurs."""
Placed = tuple[Channels, ModalTaxels]
"""Channels with each washer's own pull, and all modes of their taxels."""


def plan_selectivity(
    spec: Spec, planned: Sequence[Channel], optimum: "Optimum | None" = None, asked_only: bool = False
) -> Selectivity:
    """Choose the drive scheme for the channels of a coil, and return its selectivity.

    With two sets of channels, the figures are of the worse one. `optimum`, the figure of optimised resonances, is
    recorded if it is of the chosen scheme. With `asked_only`, no other schemes are judged than the spec asks for.
    """
    sets = channel_sets(planned, spec.coil.sets)
    alike, bare, asked = ([_resonators(spec, own, kind) for own in sets] for kind in ("alike", "placed", "asked"))
    placed = [(taxels, heard_modes(spec, own, taxels.line)) for own, taxels in zip(sets, bare, strict=True)]
    lost_db = max(channel.level_loss_db for channel in planned)
    names = (spec.drive.scheme,) if asked_only and spec.drive.scheme != "auto" else in_order()
    figures = {name: _scheme_figures(spec, alike, placed, name, lost_db) for name in names}
    name, why = _chosen_scheme(spec, figures, planned)
    scheme = scheme_named(spec, name)
    states = min((all_states(taxels, scheme) for taxels in alike), key=lambda found: found.db)
    alone = len(sets[0]) < 2
    return Selectivity(
        drive=name,
        level_law="threshold" if spec.drive.threshold_hz else spec.drive.level_law,
        one_hot_db=None if alone else min(one_hot_db(taxels, scheme) for taxels in alike),
        all_states_db=None if alone else states.db,
        worst_state=states.state,
        asked_db=decibel(spec.delta_y),
        placed_one_hot_db=None if alone else min(one_hot_db(taxels, scheme, modes) for taxels, modes in placed),
        placed_all_states_db=None if alone else _placed_db(placed, scheme) - lost_db,
        why=why,
        paper_db=None if alone else _paper_db(spec, planned),
        snapping_db=None if alone else _worst_db(asked, scheme) - states.db,
        modes_cost_db=None if alone else _worst_db(bare, scheme) - _placed_db(placed, scheme),
        modes_left_out=max(float(modes.left_out.max()) for _, modes in placed),
        optimum_db=optimum.all_states_db if optimum and optimum.drive == name else None,
        matrix_db=tuple(_matrix_db(taxels) for taxels in alike) if len(sets[0]) <= MOST_SPELLED_OUT else (),
        schemes=tuple(figures.values()),
    )


def _matrix_db(taxels: Channels) -> tuple[tuple[float, ...], ...]:
    below = -10 * np.log10(tone_energy(taxels, taxels))
    return tuple(tuple(float(value) + 0.0 for value in row) for row in below)


def _worst_db(sets: Sequence[Channels], scheme: Scheme) -> float:
    return min(all_states(taxels, scheme).db for taxels in sets)


def _placed_db(sets: Sequence[Placed], scheme: Scheme) -> float:
    return min(all_states(taxels, scheme, modes).db for taxels, modes in sets)


def _resonators(spec: Spec, planned: Sequence[Channel], kind: str) -> Channels:
    """Return a coil's channels for the physics; `kind` says with what pull and at kind resonances.

    'alike': as printed, all washers pulled alike. 'placed': as printed, each washer with its own pull. 'asked': at the
    target resonances, all washers pulled alike.
    """
    resonance = np.array([c.target_hz if kind == "asked" else c.resonance_hz for c in planned])
    mass = np.array([c.effective_mass_g for c in planned])
    pull = np.array([c.force_constant_n_per_a2 for c in planned])
    # No current moves a washer that the coil does not pull: a tiny pull asks for an almost endless current instead.
    pull = np.maximum(pull, UNPULLED * pull.max()) if (pull > 0).any() else np.ones(len(pull))
    q = np.array([c.q for c in planned])
    return channels(resonance, q, level_law(spec)(resonance), mass, pull if kind == "placed" else 1.0)


def placed_channels(spec: Spec, planned: Sequence[Channel]) -> Channels:
    """Return the channels of one coil as printed, with each washer's own pull."""
    return _resonators(spec, planned, "placed")


def modes_matter(plan: Plan) -> bool:
    """Return whether other modes of the taxels may matter: True if `judge_modes` is to look at them.

    They may if a mode lies in another channel's slot, if the modes cost selectivity, or if a line of the drive on a
    mode's peak could move an OFF taxel by more than 1/Δy of its ON amplitude. The last is a quick bound: no line is
    more than twice the largest wanted one, or 1/(2 `bias_ratio`) of it in a biased drive.
    """
    if len(plan.sets[0]) < 2:
        return False
    return (
        bool(modes_in_slots(plan))
        or (plan.selectivity.modes_cost_db or 0.0) > MODES_DB
        or any(_loudest_peak(plan.spec, own) > 1 / plan.spec.delta_y for own in plan.sets)
    )


def _loudest_peak(spec: Spec, own: Sequence[Channel]) -> float:
    modes, line = coil_modes(spec, own), placed_channels(spec, own).line
    peak = np.sqrt((modes.gain**2).sum(-1)) * (modes.q / line)[:, None]
    peak[np.arange(len(own)), [int(np.argmax(c.mode_shares)) for c in own]] = 0.0
    return float(peak.max() * line.max()) * max(2.0, 0.5 / spec.drive.bias_ratio)


def _scheme_figures(
    spec: Spec, alike: Sequence[Channels], placed: Sequence[Placed], name: str, lost_db: float
) -> SchemeFigures:
    count, scheme = len(alike[0].line), scheme_named(spec, name)
    cubic = scheme.has_pair_spurs and count > MOST_WITH_SPURS and name != spec.drive.scheme
    if count < 2 or cubic:
        return SchemeFigures(name, None, None, None)
    one_hot = min(one_hot_db(taxels, scheme) for taxels in alike)
    return SchemeFigures(name, one_hot, _worst_db(alike, scheme), _placed_db(placed, scheme) - lost_db)


def _chosen_scheme(spec: Spec, figures: dict[str, SchemeFigures], planned: Sequence[Channel]) -> tuple[str, str]:
    """Return the name of the scheme, and the reason for it in words."""
    if spec.drive.scheme != "auto":
        return spec.drive.scheme, "as the spec asks"
    if len(planned) // spec.coil.sets == 1:
        return "tones", "a plain tone is the simplest, and a coil's one channel has no other to be told from"
    if len(planned) // spec.coil.sets == 2:
        return "tones", "plain tones are the simplest, and no third taxel is there for their spurs to fall on"
    asked, least = decibel(spec.delta_y), spec.drive.least_frames_per_s
    simplest = _playable(spec, planned)
    reached = {name: figures[name].reached_db for name in simplest}
    rates = {rate.scheme: rate.frames_per_s for rate in frame_rates(planned, spec.coil.sets)}
    # A scheme that takes turns is slow, so its frame rate must suffice, too; all other schemes share one frame rate.
    holds = [n for n in simplest if reached[n] >= asked and (rates[n] >= least or not Scheme(n).takes_turns)]
    if holds:
        told = _reached_text(simplest[: simplest.index(holds[0])], reached, rates)
        return holds[0], f"the simplest that keeps {asked:.1f} dB in all states{told}"
    slow = [name for name in simplest if reached[name] >= asked] if spec.amplifier else []
    if slow:
        return slow[0], f"of the schemes that the amplifier plays the only kind that keeps {asked:.1f} dB in all states"
    together = [name for name in simplest if not Scheme(name).takes_turns]
    best = max(together or simplest, key=lambda name: reached[name])
    told = _reached_text([name for name in simplest if name != best], reached, rates)
    none = f"no drive keeps {asked:.1f} dB in all states at {number(least)} frames/s or more"
    return best, f"{none}; of those that drive all at once it comes nearest{told}"


def _playable(spec: Spec, planned: Sequence[Channel]) -> list[str]:
    """Return the schemes that the amplifier can play, the simplest first: if any are, those within its limits."""
    names = [name for name in simplest_first() if passes(spec, scheme_named(spec, name))]
    if spec.amplifier is None:
        return names
    return [n for n in names if is_fed(spec, coil_load(spec, planned, scheme_named(spec, n)))] or names


def _reached_text(names: Sequence[str], reached: dict[str, float], rates: dict[str, float]) -> str:
    """Return what other schemes reach, in brackets, or nothing."""
    words = [
        f"{name} {reached[name]:.1f} dB" + (f" at {rates[name]:.2g} frames/s" if Scheme(name).takes_turns else "")
        for name in names
        if reached[name] > -inf
    ]
    return f" ({', '.join(words)})" if words else ""


def _paper_db(spec: Spec, planned: Sequence[Channel]) -> float:
    """Return the selectivity in dB that the paper's Eq. 12 gives for the closest pair: ``Δy = 4 Q (ρ − 1)/(ρ + 1)``."""
    sets = channel_sets(planned, spec.coil.sets)
    ratio = min(b.resonance_hz / a.resonance_hz for own in sets for a, b in pairwise(own))
    return decibel(4 * spec.q_min * (ratio - 1) / (ratio + 1))
