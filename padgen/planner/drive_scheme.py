"""Choose a coil's drive scheme, and work out how far OFF taxels then stay below ON taxels.

With it come the frame rate, and the load on coil, amplifier and beams with the level that these allow.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from padgen.core.errors import number
from padgen.core.units import MA, MH, MM, MS, UM, decibel
from padgen.physics.currents import mean_square_a2, on_carrier_v, peak_current_a, peak_voltage_v
from padgen.physics.magnetics import pull_in_deflection, slack_at
from padgen.physics.modes import jump_amplitude
from padgen.physics.resonator import ModalTaxels
from padgen.physics.schemes import in_order, simplest_first
from padgen.physics.selectivity import Channels, Scheme, all_states, channels, one_hot_db, tone_energy
from padgen.planner.channels import MODES_DB, coil_modes, hanging_gap_um, heard_modes, modes_in_slots
from padgen.planner.plan import (
    Channel,
    CoilLoad,
    FrameRate,
    Plan,
    SchemeFigures,
    Selectivity,
    carrier_hz,
    channel_sets,
    level_law,
    passes,
    scheme_named,
)
from padgen.spec import Amplifier, Spec, catalogue

if TYPE_CHECKING:
    from padgen.planner.search import Optimum

__all__ = [
    "coil_load",
    "fitting_amplifiers",
    "frame_rates",
    "is_fed",
    "modes_matter",
    "placed_channels",
    "plan_selectivity",
    "pull_in_share",
    "slot_ms",
    "switch_ms",
]


SWITCH_PERIODS = 9.0
"""Periods of the lowest resonance that a transition lasts: at most 1e-4 of the mean pull's step then rings on."""
SWITCH_BEATS = 2.5
"""Periods of the beat between neighbouring channels that a transition lasts: the ringing that a switched tone leaves on
a neighbouring taxel is then at least 38 dB below the motion that the steady tone makes there."""


def switch_ms(channels: Sequence[Channel], sets: int = 1) -> float:
    """Return the length in ms of a transition that neither clicks nor shakes a taxel that stays OFF.

    The force is blended over it by a step that is flat to the fourth derivative at both ends.
    """
    lowest_hz = min(channel.resonance_hz for channel in channels)
    beat_hz = min(_nearest_hz(own) for own in channel_sets(channels, sets))
    return max(SWITCH_PERIODS / lowest_hz, SWITCH_BEATS / beat_hz) / MS


def slot_ms(channels: Sequence[Channel], sets: int = 1) -> float:
    """Return the length in ms of a channel's time slot when the channels of a pad take turns.

    A slot is twice the slowest taxel's ring-down or two transitions, whichever is longer. The force rises over the
    first half and falls over the second, so that neither the tone nor its mean pull sets another taxel swinging.
    """
    return 2 * max(*(channel.ring_down_ms for channel in channels), switch_ms(channels, sets))


def frame_rates(channels: Sequence[Channel], sets: int = 1) -> tuple[FrameRate, ...]:
    """Return the frames per second, for each scheme, at which a taxel switched OFF is quiet before the next frame.

    With all channels at once, a frame takes a transition and the slowest channel's ring-down. In turns, it takes a slot
    for every channel of a coil.
    """
    together = (switch_ms(channels, sets) + max(channel.ring_down_ms for channel in channels)) * MS
    in_turns = slot_ms(channels, sets) * MS * len(channels) / sets
    times = {name: in_turns if Scheme(name).takes_turns else together for name in in_order()}
    return tuple(FrameRate(name, 1 / time) for name, time in times.items())


def _nearest_hz(own: Sequence[Channel]) -> float:
    """Return the smallest distance in Hz between resonances of a coil, at least one half-power bandwidth.

    Two resonances within a bandwidth act as one and do not beat.
    """
    gaps = np.diff(np.sort([channel.resonance_hz for channel in own]))
    bandwidth_hz = min(channel.resonance_hz / channel.q for channel in own)
    return max(float(gaps.min(initial=np.inf)), bandwidth_hz)


def coil_load(spec: Spec, channels: Sequence[Channel], scheme: Scheme) -> CoilLoad:
    """Return currents, voltage and heat of a coil with all channels on, and the largest level that all limits allow.

    With two sets of channels, the figures are of the coil that allows the lower level.
    """
    sets = channel_sets(channels, spec.coil.sets)
    carrier = carrier_hz(spec, scheme, max(c.resonance_hz for c in channels))
    return min((_load(spec, own, scheme, carrier) for own in sets), key=lambda load: load.reachable_level_um)


def _load(spec: Spec, channels: Sequence[Channel], scheme: Scheme, carrier: float | None) -> CoilLoad:
    coil, headroom = spec.coil, spec.drive.headroom
    lines, resonance = np.array([(c.line_a2, c.resonance_hz) for c in channels]).T
    square_a2 = mean_square_a2(scheme, lines, headroom)
    volts = peak_voltage_v(scheme, lines, resonance, coil.resistance_ohm, coil.inductance_mh * MH, headroom)
    peak_a = peak_current_a(scheme, lines, headroom)
    if carrier is not None:
        volts = float(on_carrier_v(volts, peak_a, coil.inductance_mh * MH, carrier))
        peak_a *= 2**0.5
    loss_w = square_a2 * coil.resistance_ohm
    pull_in = max(pull_in_share(spec, channel, square_a2) for channel in channels)
    # Factors by which the displacements may grow: the square of the current grows in proportion.
    factors = {
        "voltage": (spec.drive.voltage_limit_v / volts) ** 2 if volts > 0 else inf,
        "copper loss": coil.power_limit_w / loss_w if loss_w > 0 else inf,
        "gap": min(_gap_factor(spec, channel, square_a2) for channel in channels),
        "stretching": min(jump_amplitude(c.hardening_per_mm2, c.q) * MM / UM / c.level_um for c in channels),
        "root stress": spec.material.fatigue_stress_mpa / max(c.root_stress_mpa for c in channels),
    }
    if spec.amplifier and peak_a > 0:
        factors["amplifier's current"] = (spec.amplifier.current_a / peak_a) ** 2
    if min(c.force_constant_n_per_a2 for c in channels) <= 0:
        factors["pull"] = 0.0
    tightest = min(factors, key=lambda name: factors[name])
    return CoilLoad(
        current_peak_ma=peak_a / MA,
        current_rms_ma=square_a2**0.5 / MA,
        voltage_peak_v=volts,
        copper_loss_w=loss_w,
        idle_w=mean_square_a2(scheme, lines, headroom, np.zeros(len(lines), bool)) * coil.resistance_ohm,
        pull_in_share=pull_in,
        reachable_level_um=spec.drive.level_um * factors[tightest],
        reachable_by=tightest,
    )


def fitting_amplifiers(plan: Plan) -> dict[str, int]:
    """Return the amplifiers of the catalogue that can play all channels of a plan, and how many of each it takes."""
    coils, fitting = plan.coils.rows * plan.coils.columns, {}
    for name, entry in catalogue("amplifier").items():
        drive = replace(plan.spec.drive, voltage_limit_v=entry["voltage_v"])
        spec = replace(plan.spec, amplifier=Amplifier(**entry), drive=drive)
        if passes(spec, plan.scheme) and is_fed(spec, coil_load(spec, plan.channels, plan.scheme)):
            fitting[name] = -(-coils // int(entry["channels"]))
    return fitting


def is_fed(spec: Spec, load: CoilLoad) -> bool:
    """Return whether the spec's amplifier, if there is one, has the volts and amperes of a load."""
    own = spec.amplifier
    enough_v = load.voltage_peak_v <= spec.drive.voltage_limit_v
    return own is None or (enough_v and load.current_peak_ma * MA <= own.current_a)


def pull_in_share(spec: Spec, channel: Channel, square_a2: float) -> float:
    """Return the mean pull on a washer for a mean square current, over the pull at which it snaps to the coil."""
    gap_um = float(hanging_gap_um(spec, channel.sag_um))
    _, largest_um = pull_in_deflection(gap_um, max(channel.pull_exponent, 0.0))
    return _slack_um(channel, square_a2) / largest_um


def _slack_um(channel: Channel, square_a2: float) -> float:
    """Return the deflection in µm under the mean pull at rest, as if the pull did not grow while the gap closes."""
    return max(square_a2 * channel.force_constant_n_per_a2, 0.0) / channel.stiffness_n_per_m / UM


def _gap_factor(spec: Spec, channel: Channel, square_a2: float) -> float:
    """Return the factor by which amplitude and mean pull may grow until, with the sag, they fill a third of the gap.

    The spring balances the mean pull, so the washer stays short of pull-in. 0 where sag alone fills a third of the gap.
    """
    gap_um, exponent = float(hanging_gap_um(spec, channel.sag_um)), max(channel.pull_exponent, 0.0)
    free_um, slack_um = spec.coil.gap_mm * MM / UM / 3 - channel.sag_um, _slack_um(channel, square_a2)
    if free_um <= 0 or slack_um <= 0:
        return max(free_um, 0.0) / channel.level_um
    low, high = 0.0, min(free_um, pull_in_deflection(gap_um, exponent)[0])
    for _ in range(60):
        static_um = (low + high) / 2
        grown = slack_at(static_um, gap_um, exponent) / slack_um
        low, high = (static_um, high) if grown * channel.level_um + static_um < free_um else (low, static_um)
    return slack_at(low, gap_um, exponent) / slack_um


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
