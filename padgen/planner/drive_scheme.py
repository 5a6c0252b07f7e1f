"""Choose a coil's drive scheme, and work out its selectivity, its load on coil and amplifier, and its leakage.

The load is on beams, too, with the level that all these allow. Leakage is between coils, which all use the same
frequencies, with the choice of cells to turn; and there is the frame rate.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise, product, repeat
from math import hypot, inf
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from padgen.core.errors import number
from padgen.core.registry import MOVERS
from padgen.core.units import MA, MH, MM, MS, UM, decibel
from padgen.physics.magnetics import deflection_without_growth, pole_error, pull_in_deflection
from padgen.physics.modes import jump_amplitude
from padgen.physics.resonator import ModalTaxels, relative_energy
from padgen.physics.schemes import (
    in_order,
    mean_pull_line,
    mean_square_a2,
    on_carrier_v,
    peak_current_a,
    peak_voltage_v,
    simplest_first,
)
from padgen.physics.selectivity import (
    SQUARE,
    Channels,
    Scheme,
    all_states,
    channels,
    one_hot_db,
    pair_lines,
    tone_energy,
)
from padgen.physics.switching import Brake, brake_for, follow, keyframes
from padgen.planner.channels import hanging_gap_um, heard_modes, with_auto_scheme
from padgen.planner.coils import coil_source
from padgen.planner.layout import Layout
from padgen.planner.limits import Demand, MovingTaxel, exceeded, limits, linear_deflection_um, most_asked, pull_in_share
from padgen.planner.movers import Leakage, Mover, mover_of
from padgen.planner.plan import (
    Channel,
    CoilLoad,
    FrameRate,
    Parts,
    Plan,
    Reuse,
    SchemeFigures,
    Selectivity,
    can_play,
    carrier_hz,
    channel_sets,
    level_law,
    scheme_named,
)
from padgen.spec import Ballast, Coil, Magnet, Spec, Washer, catalogue

if TYPE_CHECKING:
    from padgen.planner.search import Optimum

__all__ = [
    "LONGEST_S",
    "MOST_WITH_SPURS",
    "RINGS",
    "SLOT_DB",
    "ChosenDrive",
    "cell_is_turned",
    "chosen_drive",
    "coil_demand",
    "coil_leakage",
    "coil_load",
    "coils_around",
    "fitting_parts",
    "frame_contrasts",
    "frame_rates",
    "is_fed",
    "placed_channels",
    "plan_selectivity",
    "slot_ms",
    "switch_brake",
    "switch_ms",
]


SWITCH_PERIODS = 9.0
"""Periods of the lowest resonance that a transition lasts: at most 1e-4 of the mean pull's step then rings on."""
SWITCH_BEATS = 2.5
"""Periods of the beat between neighbouring channels that a transition lasts: the ringing that a switched tone leaves on
a neighbouring taxel is then at least 38 dB below the motion that the steady tone makes there."""


def switch_ms(channels: Sequence[Channel], sets: int = 1) -> float:
    """Return the duration in ms of a switching transition that hardly excites taxels that stay OFF.

    The force is blended over it by a step that is flat to the fourth derivative at both ends. Two resonances of a coil
    within a half-power bandwidth act as one and do not beat.
    """
    resonances = [np.array([c.resonance_hz for c in channel_set]) for channel_set in channel_sets(channels, sets)]
    beats = [np.diff(np.sort(hz)).min(initial=np.inf) for hz in resonances]
    widths = [min(c.resonance_hz / c.q for c in channel_set) for channel_set in channel_sets(channels, sets)]
    beat_hz = min(max(float(beat), width) for beat, width in zip(beats, widths, strict=True))
    return max(SWITCH_PERIODS / min(channel.resonance_hz for channel in channels), SWITCH_BEATS / beat_hz) / MS


def slot_ms(channels: Sequence[Channel], sets: int = 1) -> float:
    """Return the length in ms of a channel's time slot when the channels of a pad take turns.

    A slot is twice the slowest taxel's ring-down or two transitions, whichever is longer. The force rises over the
    first half and falls over the second, so that neither the tone nor its mean pull sets another taxel swinging.
    """
    return 2 * max(*(channel.ring_down_ms for channel in channels), switch_ms(channels, sets))


def frame_rates(channels: Sequence[Channel], sets: int = 1, force_order: int = SQUARE) -> tuple[FrameRate, ...]:
    """Return the frames per second, for each scheme, at which a taxel switched OFF is quiet before the next frame.

    With all channels at once, a frame takes a transition and the slowest channel's ring-down. In turns, it takes a slot
    for every channel of a coil.
    """
    together = (switch_ms(channels, sets) + max(channel.ring_down_ms for channel in channels)) * MS
    in_turns = slot_ms(channels, sets) * MS * len(channels) / sets
    slowest = {True: in_turns, False: together}
    return tuple(FrameRate(name, 1 / slowest[Scheme(name).takes_turns]) for name in in_order(force_order))


SLOT_DB = 10.0
"""Contrast in dB over a whole frame for which a rate is stated, where more is asked: a taxel that rings down takes
frames of seconds to average out to 20 dB. Assumed: OFF taxels then have a third of the ON amplitude at most."""
LONGEST_S = 100.0
"""Length of a frame up to which one is looked for that keeps that contrast."""
BRAKE_SHARE = 0.5
"""Blend of a brake over the planned transition. Half of that still rings no neighbour by more than its steady tone
does, and takes no more counter-phase than a level of 1 on most pads (docs/frames.md)."""


def switch_brake(tau_s: np.ndarray, ramp_s: float, scheme: Scheme) -> Brake:
    """Return the counter-phase brake for taxels going OFF, with time constants `tau_s` and switching time `ramp_s`."""
    return brake_for(tau_s, BRAKE_SHARE * ramp_s, not scheme.at_resonance)


class _Switched(NamedTuple):
    """Switching of one coil's taxels from frame to frame, with methods for the ON/OFF contrast of the frames.

    `steady` is the energy of an OFF taxel by steady tones, over that of an ON one.
    """

    tau_s: np.ndarray
    ramp_s: float
    steady: float
    takes_turns: bool
    brake: Brake | None

    def contrasts_db(self, seconds: float) -> tuple[float, float]:
        """Return the worst ON over OFF amplitude ratios in dB: averaged over a frame of `seconds`, and at its end."""
        count = len(self.tau_s)
        frames = np.array([[1.0], [0.0]]) * np.ones(count)
        if self.takes_turns:
            time_s = np.arange(4 * count + 1) * seconds / count / 2
            levels = np.zeros((len(time_s), count))
            levels[2 * np.arange(count) + 1, np.arange(count)] = 1.0
        else:
            time_s, levels = keyframes(frames, seconds, self.ramp_s, self.brake, self.tau_s)
        amplitude, energy = follow(time_s, levels, self.tau_s)
        is_shown = time_s[1:] <= seconds * (1 + 1e-9)
        on = energy[is_shown].sum(0) / seconds
        off = energy[~is_shown].sum(0) / seconds
        last_on = amplitude[:-1][is_shown][-1]
        last_off = np.zeros(count)
        if not self.takes_turns:
            if self.brake is not None:
                last_on = amplitude[len(time_s) - 1 - 2 * len(self.brake.shares) - 3]
            else:
                amplitude, energy = follow(np.array([0.0, self.ramp_s, seconds]), frames[[0, 1, 1]], self.tau_s, 1.0)
                off = energy.sum(0) / seconds
                last_off = amplitude[-1]
        return self._lowest_contrast_db(on, off), self._lowest_contrast_db(last_on**2, last_off**2)

    def _lowest_contrast_db(self, on: np.ndarray, off: np.ndarray) -> float:
        """Return the least ratio in dB of one channel's ON energy to another's OFF energy (its own if it is alone).

        Energies are (n,); `steady` is added to those when OFF.
        """
        ratio = on[:, None] / np.maximum(off + self.steady, 1e-12)
        if len(on) > 1:
            ratio[np.diag_indices(len(on))] = inf
        return decibel(float(ratio.min()) ** 0.5)

    def highest_rate(self, kept_db: float, least_s: float) -> float | None:
        """Return the highest frame rate in 1/s, at most 1/`least_s`, with a contrast of `kept_db` dB; None if none."""
        low = high = least_s
        while self.contrasts_db(high)[0] < kept_db:
            low = high
            high = 1.5 * high
            if high > LONGEST_S:
                return None
        while high > low * (1 + RATE_STEP):
            middle = (low * high) ** 0.5
            low, high = (low, middle) if self.contrasts_db(middle)[0] >= kept_db else (middle, high)
        return 1 / high


RATE_STEP = 1e-3
"""Relative error of a rate that is looked for."""


def frame_contrasts(channels: Sequence[Channel], sets: int, selectivity: Selectivity) -> tuple[FrameRate, ...]:
    """Return, for each drive scheme, how fast frames can follow each other and the ON/OFF contrast at that rate.

    The contrast is None where the selectivity with a scheme is not known. The rates that keep a contrast are looked for
    with the chosen scheme alone.
    """
    reached = {figures.scheme: figures.reached_db for figures in selectivity.schemes}
    ramp_s = switch_ms(channels, sets) * MS
    kept_db = min(selectivity.asked_db, SLOT_DB)
    channel_set = [np.array([channel.ring_up_ms * MS for channel in each]) for each in channel_sets(channels, sets)]
    alone = len(channel_set[0]) < 2
    contrasts = []
    for rate in frame_rates(channels, sets, Scheme(selectivity.drive).force_order):
        if not alone and reached.get(rate.scheme, -inf) == -inf:
            contrasts.append(rate)
            continue
        scheme = Scheme(rate.scheme)
        steady = 0.0 if alone else 10 ** (-reached[rate.scheme] / 10)
        coils = [_Switched(tau_s, ramp_s, steady, scheme.takes_turns, None) for tau_s in channel_set]
        least_s = ramp_s * (2 * len(channel_set[0]) if scheme.takes_turns else 1)
        at_rate = np.min([coil.contrasts_db(1 / rate.frames_per_s) for coil in coils], axis=0).tolist()
        figures = {
            "slot_db": at_rate[0],
            "end_db": None if scheme.takes_turns else at_rate[1],
            "kept_db": kept_db,
        }
        is_chosen = rate.scheme == selectivity.drive
        if is_chosen:
            figures["kept_frames_per_s"] = _lowest_or_none([coil.highest_rate(kept_db, least_s) for coil in coils])
        if is_chosen and not scheme.takes_turns:
            brake = switch_brake(np.concatenate(channel_set), ramp_s, scheme)
            braked = [coil._replace(brake=brake) for coil in coils]
            least_s = ramp_s + brake.blend_s + brake.seconds
            figures["braked_frames_per_s"] = _lowest_or_none([coil.highest_rate(kept_db, least_s) for coil in braked])
            if figures["braked_frames_per_s"] and not alone:
                seconds = 1 / figures["braked_frames_per_s"]
                figures["braked_db"] = min(coil.contrasts_db(seconds)[0] for coil in braked)
        contrasts.append(replace(rate, **figures))
    return tuple(contrasts)


def _lowest_or_none(rates: Sequence[float | None]) -> float | None:
    """Return the lowest of the rates; None if any of them is None."""
    return None if None in rates else min(rate for rate in rates if rate is not None)


def coil_load(spec: Spec, channels: Sequence[Channel], scheme: Scheme) -> CoilLoad:
    """Return currents, voltage and heat of coils with all channels on, and the largest level that all limits allow.

    With two sets of channels, each figure is of the set that takes most, and the level the lower one.
    """
    carrier = carrier_hz(spec, scheme, max(c.resonance_hz for c in channels))
    loads = [_load(spec, channel_set, scheme, carrier) for channel_set in channel_sets(channels, spec.coil.sets)]
    tightest = min(loads, key=lambda load: load.reachable_level_um)
    most = {name: max(getattr(load, name) for load in loads) for name in MOST_OF_SETS}
    mean_w = sum(load.copper_loss_w for load in loads) / len(loads)
    return replace(tightest, **most, mean_copper_loss_w=mean_w)


MOST_OF_SETS = (
    "current_peak_ma",
    "current_rms_ma",
    "voltage_peak_v",
    "copper_loss_w",
    "idle_w",
    "pull_in_share",
)
"""Figures of a `CoilLoad` that are the largest of the coils' sets of channels."""


def _load(spec: Spec, channels: Sequence[Channel], scheme: Scheme, carrier: float | None) -> CoilLoad:
    coil = spec.coil
    headroom = spec.drive.headroom
    lines, resonance = np.array([(c.line_a2, c.resonance_hz) for c in channels]).T
    square_a2 = mean_square_a2(scheme, lines, headroom)
    pulling = mean_pull_line(scheme, lines, headroom)
    # What a sound card's high-pass takes from a line is made good beforehand, by as many volts more.
    more = np.zeros(len(lines)) if scheme.is_root else (spec.corner_hz / (resonance * scheme.pair_scale)) ** 2
    if scheme.force_order == 1:
        more = np.sqrt(1 + more) - 1
    raised = lines * (1 + more)
    volts = peak_voltage_v(scheme, raised, resonance, coil.resistance_ohm, coil.inductance_mh * MH, headroom)
    peak_a = peak_current_a(scheme, lines, headroom)
    if carrier is not None:
        volts = float(on_carrier_v(volts, peak_a, coil.inductance_mh * MH, carrier))
        volts *= hypot(1, spec.corner_hz / carrier)
        peak_a *= 2**0.5
    loss_w = square_a2 * coil.resistance_ohm
    # Factors by which the displacements may grow: that power of the current that pulls grows in proportion.
    moved = tuple(MovingTaxel(channel, pulling, 1.0) for channel in channels)
    demand = Demand(volts, peak_a, loss_w, loss_w, moved)
    factors = {
        limit.level_factor: limit.share_of_level(spec, most_asked(limit, spec, demand))
        for limit in limits()
        if limit.level_factor and limit.bound(spec) < inf
    }
    factors["gap"] = min(_gap_factor(spec, channel, pulling) for channel in channels)
    factors["stretching"] = min(jump_amplitude(c.hardening_per_mm2, c.q) * MM / UM / c.level_um for c in channels)
    if min(c.force_constant_n_per_a2 for c in channels) <= 0:
        factors["pull"] = 0.0
    tightest = min(factors, key=lambda name: factors[name])
    return CoilLoad(
        current_peak_ma=peak_a / MA,
        current_rms_ma=square_a2**0.5 / MA,
        voltage_peak_v=volts,
        copper_loss_w=loss_w,
        idle_w=mean_square_a2(scheme, lines, headroom, np.zeros(len(lines), bool)) * coil.resistance_ohm,
        pull_in_share=max(pull_in_share(spec, channel, pulling) for channel in channels),
        reachable_level_um=spec.drive.level_um * factors[tightest],
        reachable_by=tightest,
        mean_copper_loss_w=loss_w,
    )


def fitting_parts(plan: Plan) -> Parts:
    """Return the catalogues' amplifiers and sound cards that can play all channels of a plan, driven as planned.

    The smallest come first: amplifiers by the power of a channel, sound cards by their channels.
    """
    coils = plan.coils.rows * plan.coils.columns
    load = plan.load
    amplifiers = sorted(catalogue("amplifier").items(), key=lambda part: part[1]["voltage_v"] * part[1]["current_a"])
    carrier = carrier_hz(plan.spec, plan.scheme, max(channel.resonance_hz for channel in plan.channels))
    passed = ("DC",) if plan.scheme.has_constant and carrier is None else ("AC", "DC")
    fed = {
        name: -(-coils // int(entry["channels"]))
        for name, entry in amplifiers
        if entry["coupling"] in passed
        and load.voltage_peak_v <= entry["voltage_v"]
        and load.current_peak_ma * MA <= entry["current_a"]
    }
    cards = sorted(catalogue("sound_card").items(), key=lambda part: int(part[1]["channels"]))
    return Parts(fed, tuple(name for name, e in cards if e["channels"] >= coils and e["coupling"] in passed))


def coil_demand(load: CoilLoad, coils: int, moved: tuple[MovingTaxel, ...] = ()) -> Demand:
    """Return the `Demand` of a load: peaks and heat of one coil, heat of `coils` coils, and taxels `moved` to judge."""
    pad_w = load.mean_copper_loss_w * coils
    return Demand(load.voltage_peak_v, load.current_peak_ma * MA, load.copper_loss_w, pad_w, moved)


def is_fed(spec: Spec, load: CoilLoad) -> bool:
    """Return whether amplifier and sound card, where the spec names any, have the volts and amperes of a load."""
    codes = {one.limit.code for one in exceeded(spec, coil_demand(load, 1))}
    return codes.isdisjoint({"coil.voltage", "coil.current"}) or not spec.drive_devices


def _gap_factor(spec: Spec, channel: Channel, square_a2: float) -> float:
    """Return the factor by which amplitude and mean pull may grow until, with the sag, they fill a third of the gap.

    The spring balances the mean pull, so the washer stays short of pull-in. 0 where sag alone fills a third of the gap.
    """
    gap_um = float(hanging_gap_um(spec, channel.sag_um))
    exponent = max(channel.pull_exponent, 0.0)
    free_um = spec.coil.gap_mm * MM / UM / 3 - channel.sag_um
    resting_um = linear_deflection_um(channel, square_a2)
    if free_um <= 0 or resting_um <= 0:
        return max(free_um, 0.0) / channel.level_um
    low = 0.0
    high = min(free_um, pull_in_deflection(gap_um, exponent)[0])
    for _ in range(60):
        static_um = (low + high) / 2
        grown = deflection_without_growth(static_um, gap_um, exponent) / resting_um
        low, high = (static_um, high) if grown * channel.level_um + static_um < free_um else (low, static_um)
    return deflection_without_growth(low, gap_um, exponent) / resting_um


MOST_SPELLED_OUT = 16
"""Channels per coil up to which a plan lists how much each channel's tone moves every other taxel."""
UNPULLED = 1e-12
"""Share of the strongest pull that stands in for no pull at all."""
MOST_WITH_SPURS = 256
"""Channels per coil up to which schemes that the spec does not ask for are judged, where they have n³ spurs."""


class ChosenDrive(NamedTuple):
    """The drive scheme of a coil's channels, why it was chosen, and the figures of all schemes that were judged."""

    drive: str
    why: str
    schemes: tuple[SchemeFigures, ...]

    @property
    def kept_db(self) -> float:
        """All-state selectivity in dB with the chosen scheme, as `Selectivity.kept_db`; inf where it is not judged."""
        figures = next(figures for figures in self.schemes if figures.scheme == self.drive)
        return inf if figures.all_states_db is None else figures.reached_db


def chosen_drive(spec: Spec, planned: Sequence[Channel], asked_only: bool = False) -> ChosenDrive:
    """Choose the drive scheme for the channels of a coil: the part of `plan_selectivity` that a search needs.

    With `asked_only`, no other schemes are judged than the spec asks for.
    """
    any_drive = with_auto_scheme(spec)
    planned = tuple(planned)
    names = (spec.drive.scheme,) if asked_only and spec.drive.scheme != "auto" else in_order(spec.force_order)
    too_many_spurs = len(planned) // spec.coil.sets > MOST_WITH_SPURS
    figures = {}
    for name in names:
        scheme = scheme_named(spec, name, planned)
        if too_many_spurs and scheme.has_pair_spurs and name != spec.drive.scheme:
            figures[name] = SchemeFigures(name, None, None, None)
        else:
            figures[name] = _scheme_figures(any_drive, planned, scheme)
    return ChosenDrive(*_chosen_scheme(spec, figures, planned), tuple(figures.values()))


def plan_selectivity(spec: Spec, planned: Sequence[Channel], optimum: "Optimum | None" = None) -> Selectivity:
    """Choose the drive scheme for the channels of a coil, and return its selectivity.

    With two sets of channels, the figures are of the worse one. `optimum`, the figure of optimised resonances, is
    recorded if it is of the chosen scheme.
    """
    name, why, schemes = chosen_drive(spec, planned)
    return replace(
        _selectivity(with_auto_scheme(spec), tuple(planned), scheme_named(spec, name, planned)),
        why=why,
        optimum_db=optimum.all_states_db if optimum and optimum.drive == name else None,
        schemes=schemes,
    )


class _CoilSets(NamedTuple):
    """Channels of each set as resonators, in the three kinds of `_resonators`, and the modes that the drive excites."""

    alike: list[Channels]
    placed: list[Channels]
    asked: list[Channels]
    modes: list[ModalTaxels]

    @property
    def has_one_channel(self) -> bool:
        """True where a coil has one channel only, so that it has no selectivity."""
        return len(self.alike[0].line) < 2


@lru_cache(maxsize=256)
def _coil_sets(spec: Spec, planned: tuple[Channel, ...]) -> _CoilSets:
    sets = channel_sets(planned, spec.coil.sets)
    alike, placed, asked = (
        [_resonators(spec, channel_set, kind) for channel_set in sets] for kind in ("alike", "placed", "asked")
    )
    modes = [heard_modes(spec, channel_set, taxels.line) for channel_set, taxels in zip(sets, placed, strict=True)]
    return _CoilSets(alike, placed, asked, modes)


def _level_loss_db(planned: tuple[Channel, ...]) -> float:
    return max(channel.level_loss_db for channel in planned)


@lru_cache(maxsize=1024)
def _scheme_figures(spec: Spec, planned: tuple[Channel, ...], scheme: Scheme) -> SchemeFigures:
    sets = _coil_sets(spec, planned)
    if sets.has_one_channel:
        return SchemeFigures(scheme.name, None, None, None)
    return SchemeFigures(
        scheme.name,
        min(one_hot_db(taxels, scheme) for taxels in sets.alike),
        _worst_db(sets.alike, scheme),
        _worst_db(sets.placed, scheme, sets.modes) - _level_loss_db(planned),
    )


@lru_cache(maxsize=256)
def _selectivity(spec: Spec, planned: tuple[Channel, ...], scheme: Scheme) -> Selectivity:
    """Return the selectivity of channels under a scheme; `why`, `optimum_db` and `schemes` are left empty."""
    sets = _coil_sets(spec, planned)
    alone = sets.has_one_channel
    states = min((all_states(taxels, scheme) for taxels in sets.alike), key=lambda one: one.db)
    few = len(sets.alike[0].line) <= MOST_SPELLED_OUT
    below = [-10 * np.log10(tone_energy(taxels, taxels)) + 0.0 for taxels in sets.alike if few]
    placed_db = _worst_db(sets.placed, scheme, sets.modes)
    return Selectivity(
        drive=scheme.name,
        level_law="threshold" if spec.drive.threshold_hz else spec.drive.level_law,
        one_hot_db=None if alone else min(one_hot_db(taxels, scheme) for taxels in sets.alike),
        all_states_db=None if alone else states.db,
        worst_state=states.state,
        asked_db=decibel(spec.delta_y),
        placed_one_hot_db=None if alone else min(map(one_hot_db, sets.placed, repeat(scheme), sets.modes)),
        placed_all_states_db=None if alone else placed_db - _level_loss_db(planned),
        why="",
        paper_db=None if alone else _paper_db(spec, channel_sets(planned, spec.coil.sets)),
        snapping_db=None if alone else _worst_db(sets.asked, scheme) - states.db,
        modes_cost_db=None if alone else _worst_db(sets.placed, scheme) - placed_db,
        modes_left_out=max(float(modes.left_out.max()) for modes in sets.modes),
        optimum_db=None,
        matrix_db=tuple(tuple(map(tuple, table.tolist())) for table in below),
        schemes=(),
    )


def _worst_db(sets: Sequence[Channels], scheme: Scheme, modes: Iterable[ModalTaxels | None] = repeat(None)) -> float:
    """Return the all-state selectivity in dB of the worst set of channels, with all `modes` of taxels if given."""
    return min(all_states(taxels, scheme, set_modes).db for taxels, set_modes in zip(sets, modes, strict=False))


def _resonators(spec: Spec, planned: Sequence[Channel], kind: str) -> Channels:
    """Return a coil's channels as resonators; `kind` selects equal or actual pulls, and printed or target resonances.

    'alike': as printed, all washers pulled alike. 'placed': as printed, each washer with its own pull. 'asked': at the
    target resonances, all washers pulled alike.
    """
    resonance, q, mass, pull = np.array(
        [
            (c.target_hz if kind == "asked" else c.resonance_hz, c.q, c.effective_mass_g, c.force_constant_n_per_a2)
            for c in planned
        ]
    ).T
    # No current moves a washer that the coil does not pull: a tiny pull asks for an almost endless current instead.
    pull = np.maximum(pull, UNPULLED * pull.max()) if (pull > 0).any() else np.ones(len(pull))
    return channels(resonance, q, level_law(spec)(resonance), mass, pull if kind == "placed" else 1.0)


def placed_channels(spec: Spec, planned: Sequence[Channel]) -> Channels:
    """Return the channels of one coil as printed, with each washer's own pull."""
    return _resonators(spec, planned, "placed")


def _chosen_scheme(spec: Spec, figures: dict[str, SchemeFigures], planned: Sequence[Channel]) -> tuple[str, str]:
    """Return the name of the scheme, and the reason for it in words."""
    if spec.drive.scheme != "auto":
        may_be_found = ", or chosen by the search for the fewest coils" if spec.may_have_found_scheme else ""
        return spec.drive.scheme, f"as the spec says{may_be_found}"
    few = {
        1: "a plain tone is the simplest, and each coil has only one channel, so that there is nothing to separate",
        2: "plain tones are the simplest, and no third taxel is there for their spurs to fall on",
    }
    if (why := few.get(len(planned) // spec.coil.sets)) and spec.force_order == SQUARE:
        return "tones", why
    asked = decibel(spec.delta_y)
    least = spec.drive.least_frames_per_s
    # The simplest first: those that amplifier and sound card play, and of these, if there are any, those within limits.
    names = [name for name in simplest_first(spec.force_order) if can_play(spec, scheme_named(spec, name))]
    fed = [n for n in names if spec.drive_devices and is_fed(spec, coil_load(spec, planned, scheme_named(spec, n)))]
    names = fed or names
    reached = {name: figures[name].reached_db for name in names}
    rates = {rate.scheme: rate.frames_per_s for rate in frame_rates(planned, spec.coil.sets, spec.force_order)}

    def reached_text(others: Sequence[str]) -> str:
        """Return a phrase in brackets on the selectivity in dB of other schemes; empty if none is known."""
        words = [
            f"{name} {reached[name]:.1f} dB" + (f" at {rates[name]:.2g} frames/s" if Scheme(name).takes_turns else "")
            for name in others
            if reached[name] > -inf
        ]
        return f" ({', '.join(words)})" if words else ""

    keeps = [name for name in names if reached[name] >= asked]
    # A scheme that takes turns is slow, so its frame rate must suffice, too; all other schemes share one frame rate.
    holds = [name for name in keeps if rates[name] >= least or not Scheme(name).takes_turns]
    if holds:
        simpler = reached_text(names[: names.index(holds[0])])
        return holds[0], f"the simplest that keeps {asked:.1f} dB in all states{simpler}"
    if keeps and spec.drive_devices:
        feeding = " and ".join(word for word, _ in spec.drive_devices)
        plays = "plays" if len(spec.drive_devices) == 1 else "play"
        why = f"of the schemes that the {feeding} {plays} the only kind that keeps {asked:.1f} dB in all states"
        return keeps[0], why
    together = [name for name in names if not Scheme(name).takes_turns]
    best = max(together or names, key=lambda name: reached[name])
    none = f"no drive keeps {asked:.1f} dB in all states at {number(least)} frames/s or more"
    others = reached_text([name for name in names if name != best])
    return best, f"{none}; of those that drive all at once it comes nearest{others}"


def _paper_db(spec: Spec, sets: Sequence[Sequence[Channel]]) -> float:
    """Return the selectivity in dB of the closest pair, of ratio ρ, by the paper's Eq. 12.

    ``Δy = 4 Q (ρ − 1)/(ρ + 1)``.
    """
    ratio = min(b.resonance_hz / a.resonance_hz for channel_set in sets for a, b in pairwise(channel_set))
    return decibel(4 * spec.q_min * (ratio - 1) / (ratio + 1))


TURNS = ("none", "odd rows", "odd columns")
"""Cells that are turned by 180°, so that taxels of one channel lie farthest apart; the simplest choice first."""
RINGS = 5
"""Number of coils, in each direction, up to which leakage is counted."""
LEAK_ERROR = 0.25
"""Relative error of leakage from the nearest coils if cores are no longer than the pitch (docs/accuracy.md)."""


def coil_leakage(spec: Spec, layout: Layout, channels: Sequence[Channel], scheme: Scheme) -> Reuse:
    """Choose which cells to turn by 180°, and bound how much the coils around, in their worst state, move OFF taxels.

    With the driver table neighbours play in step, so that their fields add. Where the taxel's own coil plays its other
    channels, its field beats with theirs.
    """
    # Lists of distances compare by the shortest first; of equal ones, `max` takes the simplest choice.
    turned = max(TURNS, key=lambda turned: _distances_mm(spec, layout, channels, turned))
    if layout.coils < 2:
        return Reuse(None, None, turned, (None,) * len(channels), (None,) * len(channels))
    pitch = np.array([spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows])
    washers_mm = tuple(channel.site.washer_mm for channel in channels)
    steps_to = coils_around(layout.rows, layout.columns)
    at = steps_to * pitch * MM
    grid = layout.rows, layout.columns
    leak = _leakage(
        spec.mover.kind, spec.coil, spec.washer_or_magnet, washers_mm, grid, tuple(pitch), spec.ballast_argument
    )
    away = np.abs(steps_to).sum(1) % spec.coil.sets
    heard = [_foreign_coil_energies(spec, scheme, channels, steps) for steps in range(spec.coil.sets)]
    energy, apart = np.zeros((2, len(channels)))
    for there in _surroundings(layout, steps_to):
        total, own_lines = np.zeros((2, len(channels)))
        for steps, (tones, spurs, beats) in enumerate(heard):
            some = there & (away == steps)
            square = np.abs(leak.mutual[:, some][:, :, some]).sum((1, 2))
            product = np.abs(leak.product[:, some]).sum(1)
            constant = product if scheme.is_biased else 0.0
            # Spurs and beats of the same channels have the same frequencies, so that their amplitudes add.
            total += (square + constant) ** 2 * tones + (square * np.sqrt(spurs) + product * np.sqrt(beats)) ** 2
            lines = _lines_apart(leak, some, scheme)
            products = (leak.product[:, some] ** 2).sum(1)
            own_lines += lines * tones + (np.sqrt(lines * spurs) + np.sqrt(products * beats)) ** 2
        energy = np.maximum(energy, total)
        apart = np.maximum(apart, own_lines)
    pushed = neighbour_energies(spec, channels, pitch, (layout.rows, layout.columns), turned)
    energy = (np.sqrt(energy) + np.sqrt(pushed.in_step)) ** 2
    apart = apart + pushed.apart
    worst = int(energy.argmax())
    leaks, retuned = (tuple(-decibel(float(value) ** 0.5) for value in each) for each in (energy, apart))
    away_m = np.array(washers_mm)[:, None] * MM - at
    far = np.abs(steps_to).max(1) > 1
    error = _leak_error(spec, layout, leak, away_m, far, pitch) + channels[worst].force_error
    return Reuse(leaks[worst], worst, turned, leaks, retuned, error)


COUPLED_STEPS = 3
"""Coils in each direction up to which movers push a taxel: their pull on each other falls with the fifth power."""


class CoupledEnergies(NamedTuple):
    """Vibration energies (n,) of OFF taxels moved by forces from ON neighbours' movers, divided by their ON energies.

    The forces act without any current. `in_step`: neighbours of one channel move in step, as by the driver table;
    `apart`: each at a frequency of its own.
    """

    in_step: np.ndarray
    apart: np.ndarray


def neighbour_energies(
    spec: Spec, channels: Sequence[Channel], pitch_mm: np.ndarray, grid: tuple[int, int], turned: str
) -> CoupledEnergies:
    """Return the energies that forces between movers, such as magnets, give OFF taxels in the middle of the pad.

    Every two movers are joined by a spring of the mover's `coupling`, if it has one. A taxel's own stiffness is taken
    as it is, since taxels are measured in their places. At each channel's tone its other taxels are held at their
    level, and all else is free.
    """
    rows, columns = grid
    mover = mover_of(spec)
    coupling = getattr(mover, "coupling", None)
    in_step, apart = np.zeros((2, len(channels)))
    if coupling is None:
        return CoupledEnergies(in_step, apart)
    alternate = spec.magnet is not None and spec.magnet.polarity == "alternating"
    steps = [
        step
        for step in product(range(-COUPLED_STEPS, COUPLED_STEPS + 1), repeat=2)
        if abs(step[0]) <= columns // 2 and abs(step[1]) <= rows // 2
    ]
    stiffness, hz, q, level = np.array([(c.stiffness_n_per_m, c.resonance_hz, c.q, c.level_um) for c in channels]).T
    for own_set in range(spec.coil.sets):
        places = []
        kinds = []
        poles = []
        for step in steps:
            around = -1.0 if cell_is_turned(turned, step[1] % 2, step[0] % 2) else 1.0
            for channel in channels[(own_set + sum(map(abs, step))) % spec.coil.sets :: spec.coil.sets]:
                places.append(np.array(step) * pitch_mm + around * np.array(channel.site.washer_mm))
                kinds.append(channel.index)
                poles.append(-1.0 if alternate and sum(step) % 2 else 1.0)
        kind = np.array(kinds)
        distance = np.linalg.norm(np.array(places)[:, None] - np.array(places), axis=-1)
        spring = np.zeros(distance.shape)
        spring[distance > 0] = coupling(spec.washer_or_magnet, distance[distance > 0] * MM, *spec.ballast_argument)
        spring *= np.multiply.outer(poles, poles)
        if core_coupling := getattr(mover, "core_coupling", None) if spec.coil.core_diameter_mm else None:
            _add_core_coupling(spring, spec, steps, channels, own_set, core_coupling)
        if not spring.any():
            continue
        middle = steps.index((0, 0)) * len(channels[own_set :: spec.coil.sets])
        members = np.arange(own_set, len(channels), spec.coil.sets)
        for j in range(len(channels)):
            ratio = hz[j] / hz[kind]
            holds = stiffness[kind] * (1 - ratio**2 + 1j * ratio / q[kind])
            for of_channel in (members[members == j], members[members != j]):
                if not len(of_channel):
                    continue
                off = middle + np.searchsorted(members, of_channel)
                held = kind == j
                held[off] = False
                free = np.flatnonzero(~held)
                system = np.diag(holds[free]) - spring[np.ix_(free, free)]
                heard_at = np.linalg.solve(system.T, np.eye(len(kind))[free][:, off])
                heard = heard_at.T @ spring[np.ix_(free, held)] * (level[j] / level[of_channel])[:, None]
                in_step[of_channel] += np.abs(heard.sum(1)) ** 2
                apart[of_channel] += (np.abs(heard) ** 2).sum(1)
    return CoupledEnergies(in_step, apart)


def _add_core_coupling(
    spring: np.ndarray,
    spec: Spec,
    steps: Sequence[tuple[int, ...]],
    channels: Sequence[Channel],
    own_set: int,
    core_coupling: Callable[[Coil, Any, np.ndarray], np.ndarray],
) -> None:
    """Add to `spring` (in N/m) how a coil's core couples the movers above that coil (see `neighbour_energies`)."""
    at = 0
    for step in steps:
        over_one = channels[(own_set + sum(map(abs, step))) % spec.coil.sets :: spec.coil.sets]
        place_m = np.array([channel.site.washer_mm for channel in over_one]) * MM
        cell = slice(at, at + len(over_one))
        spring[cell, cell] += core_coupling(spec.coil, spec.washer_or_magnet, place_m)
        at = cell.stop


@lru_cache(maxsize=64)
def _leakage(
    mover: str,
    coil: Coil,
    part: Washer | Magnet,
    washers_mm: tuple[tuple[float, float], ...],
    grid: tuple[int, int],
    pitch_mm: tuple[float, float],
    hung: tuple[Ballast, ...],
) -> Leakage:
    """Return the pulls of other coils on movers, in the order of `coils_around`, divided by that of their own coil."""
    steps = coils_around(*grid)
    at = steps * np.array(pitch_mm) * MM
    next_to = np.abs(steps).max(1) == 1
    leakage = cast(Mover, MOVERS.get(mover)).leakage
    return leakage(coil, part, np.array(washers_mm) * MM, at[next_to], at[~next_to], *hung)


def _lines_apart(leak: Leakage, some: np.ndarray, scheme: Scheme) -> np.ndarray:
    """Return the energy (n,) of pulls by the coils in mask `some`, each with own tones, over that of the taxel's coil.

    Each coil then makes a line of its own, and with plain tones every two coils one more between theirs. Lines of
    different frequencies add as energies. With constant currents each coil's tone makes its line with all of them.
    """
    mutual = np.abs(leak.mutual[:, some][:, :, some])
    alone = np.einsum("nkk->nk", mutual)
    if scheme.has_constant:
        constant = np.abs(leak.product[:, some]) if scheme.is_biased else 0.0
        return ((mutual.sum(1) + constant) ** 2).sum(1)
    return 2 * (mutual**2).sum((1, 2)) - (alone**2).sum(1)


def _leak_error(
    spec: Spec, layout: Layout, leak: Leakage, away_m: np.ndarray, far: np.ndarray, pitch_mm: np.ndarray
) -> float:
    """Return the relative error of the leakage.

    It is made of the model's error, that of far coils taken as poles, and that of coils too far to be counted, whose
    field falls with the cube of the distance.
    """
    doubt = np.where(far, pole_error(coil_source(spec.coil), np.linalg.norm(away_m, axis=-1)), 0.0)
    parts = (np.abs(leak.mutual).sum(1), 2.0), (np.abs(leak.product), 1.0)
    shares = [times * (doubt * part).sum(1) / np.maximum(part.sum(1), 1e-300) for part, times in parts]
    steps = np.stack(np.meshgrid(*(np.arange(-(n // 2), n // 2 + 1) for n in (layout.columns, layout.rows))), -1)
    cube = np.linalg.norm(steps * pitch_mm, axis=-1) ** 3
    ring = np.abs(steps).max(-1)
    beyond, counted = ((1 / cube[among]).sum() for among in (ring > RINGS, (ring > 0) & (ring <= RINGS)))
    # The model takes cores that magnetise each other as dipoles, which holds at distances above their length. Nearer
    # they do so with the cube of length over distance.
    nearest = np.linalg.norm(steps * pitch_mm, axis=-1)[ring > 0].min() * MM
    long = max(coil_source(spec.coil).core_length / nearest, 1.0)
    return float(LEAK_ERROR * long**3 + max(map(np.max, shares)) + 2 * beyond / counted)


def _foreign_coil_energies(
    spec: Spec, scheme: Scheme, channels: Sequence[Channel], steps: int
) -> tuple[np.ndarray, ...]:
    """Return OFF/ON energy ratios (n,) by tones, by spurs and by beats of a coil `steps` away, as if it lay below.

    The three are by the tones of all channels of that coil, by its pair spurs, and by twice the product of its current
    with that of the own coil, which plays all channels but the OFF one.
    """
    taxels = _resonators(spec, channels, "alike")
    sets, tones, spurs, beats = spec.coil.sets, *np.zeros((3, len(channels)))
    for i in range(len(channels)):
        taxel = Channels(*(part[[i]] for part in taxels))
        other = slice((i + steps) % sets, None, sets)
        played = Channels(*(part[other] for part in taxels))
        others = [k for k in range(i % sets, len(channels), sets) if k != i]
        tones[i] = tone_energy(taxel, played).sum()
        if scheme.has_pair_spurs:
            spurs[i] = _line_energy(taxel, *pair_lines(played, scheme)[:3])
        beats[i] = _beat_energy(
            taxel, Channels(*(part[others] for part in taxels)), played, scheme, spec.drive.headroom
        )
    return tones, spurs, beats


def _beat_energy(taxel: Channels, channel_set: Channels, other: Channels, scheme: Scheme, headroom: float) -> float:
    """Return an OFF taxel's largest energy, over its ON energy, due to 2 × its coil's current × another coil's current.

    With tones or biased currents every two channels make a line at their sum and one at their difference; the caller
    counts the constant of biased currents. With spur-free currents the own root is at most the root of its mean square;
    the other coil plays one channel alone, whose root has harmonics of ``4√2/(π(4n² − 1)) √a``.
    """
    if not len(channel_set.line) or scheme.takes_turns or scheme.force_order == 1:
        return 0.0
    if scheme.has_pair_spurs:
        # If both coils play the same two channels, these make the same line twice, at worst in step.
        twice = 1.0 if set(channel_set.resonance_hz.tolist()).isdisjoint(other.resonance_hz.tolist()) else 2.0
        both = Channels(*(np.concatenate(parts) for parts in zip(channel_set, other, strict=True)))
        a, b = np.indices((len(channel_set.line), len(other.line))).reshape(2, -1)
        made = pair_lines(both, scheme, (a, b + len(channel_set.line)), other.line.max())
        return twice * _line_energy(taxel, *made[:3])
    mean = (1 + headroom) * channel_set.line.sum()
    harmonic = np.arange(1, 4)[:, None]
    amplitude = 8 * 2**0.5 / (np.pi * (4 * harmonic**2 - 1)) * np.sqrt(mean * other.line)
    return _line_energy(taxel, harmonic * other.resonance_hz, np.zeros(1), amplitude**2)


def _line_energy(taxel: Channels, hz: np.ndarray, rest: np.ndarray, square: np.ndarray) -> float:
    """Return a taxel's vibration energy under spectral lines (`selectivity.Lines`), divided by its energy when ON."""
    return float((relative_energy(hz, taxel.resonance_hz[0], taxel.q[0], rest) * square).sum() / taxel.line[0] ** 2)


def coils_around(rows: int, columns: int) -> np.ndarray:
    """Return the steps (k, 2) along x and y from a coil in the middle of the grid to those around, adjacent first.

    They reach as far as `RINGS`. With an even number of rows or columns they are those around either middle coil.
    """
    sides = (range(-min(n // 2, RINGS), min(n // 2, RINGS) + 1) for n in (columns, rows))
    steps = [step for step in product(*sides) if step != (0, 0)]
    return np.array(sorted(steps, key=lambda step: max(map(abs, step)) > 1))


def _surroundings(layout: Layout, steps: np.ndarray) -> list[np.ndarray]:
    """Return, for each coil in the middle of the grid, a mask (k,): true where one of the `steps` ends on a coil."""
    spans = [{(-(n // 2), (n - 1) // 2), (-((n - 1) // 2), n // 2)} for n in (layout.columns, layout.rows)]
    low_high = [np.array(span) for span in product(*(sorted(span) for span in spans))]
    return [np.asarray(((steps >= span[:, 0]) & (steps <= span[:, 1])).all(1)) for span in low_high]


def cell_is_turned(turned: str, row: int, column: int) -> bool:
    """Return whether the cell of a coil is turned by 180°."""
    return {"none": False, "odd rows": row % 2 == 1, "odd columns": column % 2 == 1}[turned]


def _distances_mm(spec: Spec, layout: Layout, channels: Sequence[Channel], turned: str) -> list[float]:
    """Return the distances in mm, rising, from each channel's taxel to those of that channel in the nearest cells."""
    sets = spec.coil.sets
    distances = []
    for row, column in product(range(sets + 1), range(-sets, sets + 1)):
        is_ahead = (row, column) > (0, 0)
        has_same_channels = (row + column) % sets == 0
        if is_ahead and has_same_channels and row < layout.rows and abs(column) < layout.columns:
            # Measured from a cell that is not turned; from a turned one the distances are the same.
            shift = -2 if cell_is_turned(turned, row, column % 2) else 0
            x = column * (spec.pad.width_mm / layout.columns)
            y = row * (spec.pad.depth_mm / layout.rows)
            washers = (channel.site.washer_mm for channel in channels)
            distances += [round(hypot(x + shift * own_x, y + shift * own_y), 6) for own_x, own_y in washers]
    return sorted(distances)
