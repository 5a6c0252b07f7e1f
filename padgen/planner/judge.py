"""Make the findings of a plan: limits that it breaks or nearly breaks, with proposed cures."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, pairwise, permutations
from math import inf
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import LEVELS, Finding, about, at_least, at_most, less_or_more_text, number, percent, plural
from padgen.core.rules import RuleBook
from padgen.core.units import MM, UM, decibel
from padgen.physics.ladder import ladder_ratio, slot_half_width
from padgen.physics.modes import jump_amplitude, level_kept, resonance_rise
from padgen.physics.resonator import ModalTaxels, felt_energy
from padgen.physics.schemes import mean_pull_line, simplest_first
from padgen.physics.selectivity import Channels, Scheme, all_states, scheme_lines
from padgen.planner.ballast import ballast_findings
from padgen.planner.board_layout import board_findings
from padgen.planner.channels import coil_modes, mode_names
from padgen.planner.core_pull import core_findings
from padgen.planner.cures import Cure
from padgen.planner.drive_scheme import coil_demand, placed_channels
from padgen.planner.fixtures import tray_room_findings
from padgen.planner.guard import guard_findings
from padgen.planner.left_out import judge_left_out
from padgen.planner.limits import MovingTaxel, exceeded, lower_level
from padgen.planner.pins import judge_pins
from padgen.planner.plan import Channel, Plan, channel_sets
from padgen.planner.pushes import judge_pushes
from padgen.planner.shaken_pad import recoil_findings
from padgen.planner.sizing import DRAWN_SHARE, steps_are_coarse
from padgen.planner.suspensions import allowed
from padgen.planner.taxel_model import asked_error
from padgen.planner.touch import judge_felt, judge_touch
from padgen.planner.touched_prints import judge_touched_prints, played_channels
from padgen.spec import Spec

__all__ = ["PLAN_RULES", "ParasiticMode", "judge", "judge_modes", "parasitic_modes"]


PULL_DB = 1.0
"""Loss of selectivity by unequal pull up to which there is no finding."""
SNAPPING_DB = 0.5
"""Loss of selectivity by printing in steps up to which there is no finding."""
MODES_DB = 1.0
"""Loss of selectivity by other modes up to which there is no finding."""
QUIET_SHARE = 1e-6
"""Share of the static compliance below which a mode counts as not excited by a pull at the washer's axis."""
PULL_ERROR = 0.1
"""Relative error of a pull up to which there is no finding."""


def _selectivity(plan: Plan) -> Iterator[Finding]:
    figures = plan.selectivity
    spec = plan.spec
    kept = figures.kept_db
    one_hot = figures.one_hot_db
    placed = figures.placed_one_hot_db
    bound = figures.asked_db
    if one_hot is None or kept is None or placed is None:
        return  # a single channel has no selectivity
    if one_hot < bound:
        yield Finding(
            "warning",
            "selectivity.one_hot",
            "coil",
            f"with one channel on, an OFF taxel vibrates {_only(one_hot)} than the ON one (asked: {bound:.1f} dB)",
        )
    if kept < bound:
        counted = figures.all_states_db is not None and kept < figures.all_states_db - PULL_DB
        yield Finding(
            "warning",
            "selectivity.all_states",
            f"state {figures.worst_state}",
            "in this state, a coil's worst (lowest channel first, 1 is ON), an OFF taxel vibrates"
            f" {_only(kept)} than an ON one{', unequal pull and all modes counted' if counted else ''} (asked:"
            f" {bound:.1f} dB; drive = {figures.drive!r})",
            _selectivity_cures(plan),
        )
    pull = [c.force_constant_n_per_a2 for c in plan.channels]
    # The placed figure also counts other modes, so the pulls must differ by more than the loss to be its cause.
    if placed < one_hot - PULL_DB and decibel(max(pull) / min(pull)) > PULL_DB:
        yield Finding(
            "warning",
            "selectivity.pull",
            "coil",
            f"the {spec.mover.kind} nearest to a coil's axis is pulled {about(max(pull) / min(pull))}"
            " times as strongly as the"
            f" farthest: with one channel on, an OFF taxel vibrates {less_or_more_text(placed)} than the ON one",
        )
    if (figures.snapping_db or 0.0) > SNAPPING_DB:
        yield Finding(
            "note",
            "selectivity.snapping",
            "coil",
            f"{figures.snapping_db:.1f} dB of selectivity are lost because {spec.printer.name} makes beams wider in"
            f" steps of {number(spec.printer.width_step_mm)} mm, which moves the resonances",
        )


def _only(level_db: float) -> str:
    """Return in words how much less an OFF taxel vibrates than an ON one; with 'only' unless it vibrates more."""
    return f"{'only ' if level_db >= 0 else ''}{less_or_more_text(level_db)}"


def _selectivity_cures(plan: Plan) -> tuple[dict[str, Any], ...]:
    """Return cures that may reach the asked selectivity: other drive schemes (those that take turns last) and grids."""
    asked = plan.selectivity.asked_db
    schemes = sorted(plan.selectivity.schemes, key=lambda s: Scheme(s.scheme).takes_turns)
    # Turns are slow: a cure by such a scheme also lowers the asked frame rate to what the scheme reaches.
    slow = {
        rate.scheme: {"drive.least_frames_per_s": float(at_most(rate.frames_per_s))}
        for rate in plan.refresh
        if Scheme(rate.scheme).takes_turns and rate.frames_per_s < plan.spec.drive.least_frames_per_s
    }
    ways: list[dict[str, Any]] = [
        {"drive.scheme": s.scheme, **slow.get(s.scheme, {})} for s in schemes if s.reached_db >= asked
    ]
    ways += [{"coil.grid": [o.rows, o.columns]} for o in plan.layouts if o.kept_db is None or o.kept_db >= asked]
    return tuple(ways)


def _named(channels: Iterable[Channel]) -> str:
    indices = list(dict.fromkeys(str(channel.index) for channel in channels))
    return f"channel{plural(len(indices))} {', '.join(indices)}"


def _leak(plan: Plan) -> Iterator[Finding]:
    """Yield a warning if leakage is too strong even after re-tuning, a note if it is so only with the driver table."""
    step = plan.reuse.leak_db
    asked = plan.selectivity.asked_db
    apart = min((db for db in plan.reuse.retuned_leaks_db if db is not None), default=None)
    if step is not None and apart is not None and step < asked and plan.reuse.is_known:
        by_table = f", {less_or_more_text(step)} by the driver table" if apart >= asked else ""
        short = f", {asked - apart:.1g} dB short" if apart < asked < apart + 0.1 else ""
        yield Finding(
            "warning" if apart < asked else "note",
            "coil.leak",
            f"channel {plan.reuse.leak_channel}",
            "OFF, it is shaken by the coils around, in their worst state: once re-tuned, it vibrates"
            f" {less_or_more_text(apart)} than when it is ON{by_table} (asked: {asked:.1f} dB{short})",
        )


def _unknown_leak(plan: Plan) -> Iterator[Finding]:
    """Yield an error where the leakage's error is larger than the leakage and may spoil the asked selectivity."""
    reuse = plan.reuse
    length_mm = plan.spec.coil.length_mm
    coils = plan.coils
    if reuse.most_leak_db is not None and not reuse.is_known and reuse.most_leak_db < plan.selectivity.asked_db:
        pitch_mm = min(coils.pitch_x_mm, coils.pitch_y_mm)
        shorter = {"coil.length_mm": float(at_most(pitch_mm))}
        yield Finding(
            "error",
            "coil.leak_unknown",
            f"channel {reuse.leak_channel}",
            "how much the coils around shake this taxel, when it is OFF, is not known: the model errs by"
            f" {about(reuse.leak_error)} times the leakage, as cores of {number(length_mm)} mm every"
            f" {number(pitch_mm)} mm magnetise each other",
            (shorter, {"coil.core_diameter_mm": 0.0}) if length_mm > pitch_mm else (),
        )


def _unsure_pull(plan: Plan) -> Iterator[Finding]:
    why = "that one side of it is drawn up and the other down"
    if plan.spec.coil.kind == "board":
        why = "that the coil's spirals pull it less or more there than on the other side of the axis"
    for channel in plan.channels:
        if channel.force_error > PULL_ERROR:
            yield Finding(
                "warning",
                "coil.unsure",
                f"channel {channel.index}",
                f"the pull on its {plan.spec.mover.kind} is known to ± {channel.force_error:.0%}"
                " only, so far off the coil's axis"
                f" ({channel.site.coil_distance_mm:.2f} mm) {why}",
            )


def _softening(plan: Plan) -> Iterator[Finding]:
    spec = plan.spec
    quarter_slot = slot_half_width(spec.q_min, spec.delta_y) / 2
    worst = max(plan.channels, key=lambda c: c.pull_shift)
    if plan.scheme.force_order == 2 and plan.load.pull_in_share < 1 and worst.pull_shift > quarter_slot:
        yield Finding(
            "warning",
            "coil.softening",
            f"channel {worst.index}",
            f"the mean pull of all channels acts as a negative spring that lowers its resonance by"
            f" {worst.pull_shift:.1%}, more than a quarter of its slot, {quarter_slot:.1%}",
            lower_level(spec, quarter_slot / worst.pull_shift * 0.99),
        )


def _beats(plan: Plan) -> Iterator[Finding]:
    """Warn of spurs of two channels that fall on one of the two: spur and tone beat, and the level is not steady."""
    scheme = plan.scheme
    for channel_set in plan.sets if scheme.has_pair_spurs else ():
        for low, high in combinations(channel_set, 2):
            spurs = high.resonance_hz + low.resonance_hz, high.resonance_hz - low.resonance_hz
            for hz in (spur * scheme.pair_scale for spur in spurs):
                for hit in (low, high):
                    if abs(hz / hit.resonance_hz - 1) < 1 / hit.q:
                        yield Finding(
                            "warning",
                            "level.beats",
                            f"channels {low.index} and {high.index}",
                            f"both on, the two also pull at {number(hz)} Hz, so near to the resonance of channel"
                            f" {hit.index} ({number(hit.resonance_hz)} Hz) that its level beats",
                            ({"drive.scheme": "spur-free"},),
                        )


def _imperceptible(plan: Plan) -> Iterator[Finding]:
    drive = plan.spec.drive
    silent = [channel for channel in plan.channels if drive.threshold_hz and channel.ring_down_ms <= 0]
    if silent:
        yield Finding(
            "warning",
            "level.threshold",
            _named(silent),
            f"{number(drive.level_um)} µm on channel 0 are not above the detection threshold: nobody feels it",
            tuple({"drive.level_um": float(at_least(drive.level_um * factor))} for factor in (1.01, 2, 5)),
        )


def _slow(plan: Plan) -> Iterator[Finding]:
    """Warn where the chosen scheme shows fewer frames than the spec asks for."""
    rate = {f.scheme: f.frames_per_s for f in plan.refresh}[plan.selectivity.drive]
    drive = plan.spec.drive
    feeds = plan.spec.drive_devices
    if rate >= drive.least_frames_per_s:
        return
    faster: tuple[dict[str, Any], ...] = ()
    reason = "" if plan.spec.may_have_found_scheme else "; the spec asks for that scheme"
    if drive.scheme == "auto":
        named = " and ".join(f"the {word} {device.name}" for word, device in feeds)
        plays = "plays" if len(feeds) == 1 else "play"
        reason = f"; {named} {plays} nothing faster that keeps what is asked" if feeds else "; no scheme shows more"
        faster = tuple(filter(None, (plan.spec.dc_coupling_change,)))
    elif Scheme(plan.selectivity.drive).takes_turns:
        faster = ({"drive.scheme": "auto"},)
    yield Finding(
        "warning",
        "drive.slow",
        "drive",
        f"driven {plan.selectivity.drive}, the pad shows only {at_most(rate)} frames per second;"
        f" drive.least_frames_per_s asks for {number(drive.least_frames_per_s)}{reason}",
        ({"drive.least_frames_per_s": float(at_most(rate))}, *faster),
    )


def _limits(plan: Plan) -> Iterator[Finding]:
    """Yield a finding for each limit of coils, amplifier, gap, beams or skin that is exceeded with all taxels on."""
    spec = plan.spec
    moved = []
    for channel_set in channel_sets(played_channels(plan), plan.coils.sets):
        lines = np.array([channel.line_a2 for channel in channel_set])
        pulling = mean_pull_line(plan.scheme, lines, spec.drive.headroom)
        moved += [MovingTaxel(channel, pulling, 1.0) for channel in channel_set]
    demand = coil_demand(plan.load, plan.coils.rows * plan.coils.columns, tuple(moved))
    demand = demand._replace(beam_rise_k=plan.warm.beam_rise_k)
    for one in exceeded(spec, demand):
        limit = one.limit
        share = limit.share_of_level(spec, one.asked)
        cures = lower_level(spec, share) if limit.cures is None else limit.cures(spec, one.asked)
        sentence = f"with all taxels on at {number(spec.drive.level_um)} µm {one.sentence}"
        yield Finding(limit.planned, limit.code, one.where, sentence, cures)


SPACING_SHARE = 0.05
"""Share of a slot by which a resonance may be off without a finding."""
LOSS_DB = 0.5
"""Loss of level by stretching beams up to which there is no finding."""
ROUNDING_MM = 1e-6
EVEN_RATIO = 1.2
HOLE_RATIO = 2.0
"""Largest over smallest distance up to which taxels feel evenly spaced, and above which a display has holes."""


def judge(plan: Plan) -> tuple[Finding, ...]:
    """Return all findings of a plan, errors first."""
    findings = _one_of_each(plan, list(PLAN_RULES.findings(plan)))
    findings += judge_left_out(plan.spec, plan.left_out)
    return tuple(sorted(findings, key=lambda f: -LEVELS.index(f.level)))


WORST: dict[str, Callable[[Channel], float]] = {
    "beam.stretching": lambda c: c.level_loss_db,
    "coil.unsure": lambda c: c.force_error,
    "model.error": lambda c: c.model_error,
    "resonance.band": lambda c: abs(c.resonance_hz / c.target_hz - 1),
    "resonance.off": lambda c: abs(c.resonance_hz / c.target_hz - 1),
}
"""By code of findings that each channel may have: the figure of a channel by which it is the worst."""


def _one_of_each(plan: Plan, findings: Sequence[Finding]) -> list[Finding]:
    """Join findings of one code and level on several channels into the worst channel's, naming all channels."""
    alike: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        if finding.code in WORST:
            alike.setdefault((finding.level, finding.code), []).append(finding)
    joined: list[Finding] = []
    for finding in findings:
        group = alike.pop((finding.level, finding.code), None) if finding.code in WORST else [finding]
        if group is None:
            continue
        if len(group) == 1:
            joined.append(finding)
            continue
        by_channel = {int(one.where.removeprefix("channel ")): one for one in group}
        worst = max(by_channel, key=lambda index: WORST[finding.code](plan.channels[index]))
        where = f"channels {', '.join(map(str, by_channel))}"
        message = f"at worst, on channel {worst}, {by_channel[worst].message}"
        joined.append(replace(by_channel[worst], where=where, message=message))
    return joined


def _spacing(plan: Plan) -> Iterator[Finding]:
    bound = ladder_ratio(plan.spec.q_min, plan.spec.delta_y)
    for lower, upper in (pair for channel_set in plan.sets for pair in pairwise(channel_set)):
        ratio = upper.resonance_hz / lower.resonance_hz
        if ratio < 1 + (bound - 1) * (1 - SPACING_SHARE):
            yield Finding(
                "warning",
                "ladder.ratio",
                f"channels {lower.index} and {upper.index}",
                f"{number(lower.resonance_hz)} and {number(upper.resonance_hz)} Hz are only a factor of {number(ratio)}"
                f" apart; at Q = {number(plan.spec.q_min)} the paper's formula asks for {number(bound)}, the upper one"
                f" at {at_least(lower.resonance_hz * bound)} Hz or higher; what that costs is in the dB that prints"
                " keep",
            )


def _off_target(plan: Plan) -> Iterator[Finding]:
    """Warn of resonances off target by over a small share of a frequency slot; yield an error for any outside the band.

    Beams print in steps of width. At a large Q, or where these steps are coarse, a step moves a resonance that far.
    """
    spec = plan.spec
    share = slot_half_width(plan.spec.q_min, plan.spec.delta_y) * SPACING_SHARE
    for channel in plan.channels:
        # A core that draws a magnet lowers its resonance; `coil.core` tells so.
        drawn = 1 - channel.pull_shift if plan.scheme.force_order == 1 else 1.0
        miss = abs(channel.resonance_hz / (drawn * channel.target_hz) - 1)
        # With coarse steps the ladder is fitted to the steps; the loss is told by `selectivity.snapping`.
        if miss > share and (spec.resonances_hz or not steps_are_coarse(spec)):
            yield Finding(
                "warning",
                "resonance.off",
                f"channel {channel.index}",
                f"it resonates {percent(miss)} off its target of {number(channel.target_hz)} Hz (allowed:"
                f" {percent(share)}), since beams are whole steps of {number(spec.printer.width_step_mm)} mm wide; the"
                " driver table drives it where it resonates, so that nothing need be done",
            )
        if not spec.band_hz[0] * (1 - DRAWN_SHARE) <= channel.resonance_hz <= spec.band_hz[1] * (1 + DRAWN_SHARE):
            yield Finding(
                "error",
                "resonance.band",
                f"channel {channel.index}",
                f"it resonates at {channel.resonance_hz:.9g} Hz, outside the band of {spec.band_hz[0]:.9g} …"
                f" {spec.band_hz[1]:.9g} Hz",
            )


def _bed(plan: Plan) -> Iterator[Finding]:
    pad = plan.spec.pad
    printer = plan.spec.printer
    size = sorted((pad.width_mm + 2 * pad.border_mm, pad.depth_mm + 2 * pad.border_mm))
    bed = sorted((printer.bed_x_mm, printer.bed_y_mm))
    if size[0] > bed[0] or size[1] > bed[1]:
        # The largest active area that fits on the bed in either orientation, that of the same shape, or a larger bed.
        short, long = (side - 2 * pad.border_mm for side in bed)
        width, depth = (short, long) if pad.width_mm <= pad.depth_mm else (long, short)
        cures: list[Cure] = []
        if short > 0:
            share = min(width / pad.width_mm, depth / pad.depth_mm)
            cures = [
                {"pad.width_mm": min(pad.width_mm, width), "pad.depth_mm": min(pad.depth_mm, depth)},
                {
                    "pad.width_mm": float(at_most(pad.width_mm * share)),
                    "pad.depth_mm": float(at_most(pad.depth_mm * share)),
                },
            ]
        along_x, along_y = reversed(size) if printer.bed_x_mm >= printer.bed_y_mm else size
        larger = {
            "printer.bed_x_mm": float(at_least(max(along_x, printer.bed_x_mm))),
            "printer.bed_y_mm": float(at_least(max(along_y, printer.bed_y_mm))),
        }
        cures.append(larger)
        yield Finding(
            "error",
            "plan.bed",
            "pad",
            f"with its border it measures {number(size[1])} x {number(size[0])} mm, the bed of {printer.name} is"
            f" {number(bed[1])} x {number(bed[0])} mm",
            tuple(cures),
        )


def _share_below(share: float, wanted: float) -> str:
    """Return a share below `wanted` as percent text, with a decimal where both would round to the same percent."""
    whole = f"{share:.0%}"
    return f"{share:.1%}" if whole == f"{wanted:.0%}" else whole


def _prints(plan: Plan) -> Iterator[Finding]:
    """Tell how many prints keep the asked selectivity, and whether every taxel must be measured for that."""
    prints = plan.prints
    wanted = plan.spec.print_share
    asked = plan.selectivity.asked_db
    if prints.print_db is None or prints.planned_db is None or plan.touch is not None:
        return
    if prints.good_share < wanted:
        yield Finding(
            "warning",
            "print.share",
            "pad",
            f"with every taxel re-tuned, {_share_below(prints.good_share, wanted)} of its prints keep the"
            f" {asked:.1f} dB of ON over OFF that are asked for; {wanted:.0%} of all prints keep"
            f" {prints.print_db:z.1f} dB; padgen plan --explain ranks what would help, --plot draws which coils suffer",
        )
    if prints.planned_db < min(asked, prints.print_db):
        yield Finding(
            "note",
            "print.spread",
            "pad",
            f"expect to measure and re-tune every taxel: driven as planned, {wanted:.0%} of prints keep"
            f" {prints.planned_db:.1f} dB",
        )


def _life(plan: Plan) -> Iterator[Finding]:
    """Warn where too few re-tuned prints stay good over changes of temperature, ageing and scatter of Q."""
    life = plan.life
    wanted = plan.spec.print_share
    if plan.retuned_prints.good_share < wanted or life.good_share >= wanted:
        return
    asked_db = plan.selectivity.asked_db
    do = f"keep the {asked_db:.1f} dB asked for"
    kept = "" if life.print_db is None else f" ({wanted:.0%} keep {life.print_db:z.1f} dB)"
    if life.print_db is None or life.print_db >= asked_db:
        do = "move every taxel by more than 0.7 of its level"
        kept = ""
    when = "too few do after a change of half a kelvin, too: re-tune it before each use"
    if life.retune_k > 0:
        when = f"re-tune it after every change of {number(life.retune_k)} K"
    yield Finding(
        "warning",
        "print.life",
        "pad",
        f"re-tuned once, only {_share_below(life.good_share, wanted)} of its {plan.spec.touch.prints_text} (asked:"
        f" {wanted:.0%}) still {do} when {plan.spec.life.changes_text}{kept}; {when}",
    )


def _layers(plan: Plan) -> Iterator[Finding]:
    spec = plan.spec
    single = [c for c in plan.channels if c.beam.layers < 2 and spec.printer.process == "fdm"]
    if single:
        yield Finding(
            "note",
            "beam.single_layer",
            _named(single),
            f"beams of a single layer of {number(single[0].beam.thickness_mm)} mm are as uneven in thickness as the"
            " bed is: level it well",
        )
    asked_mm = spec.washer_or_magnet.thickness_mm + spec.taxel.glue_gap_mm
    depth_mm = spec.recess_depth_mm
    if spec.ballast:
        yield from _layers_of_pocket(spec)
    elif depth_mm - asked_mm > ROUNDING_MM:
        yield Finding(
            "note",
            "recess.layers",
            "recess",
            f"the recess is {number(depth_mm)} mm deep, a whole number of layers; {spec.mover.kind} and glue need"
            f" {number(asked_mm)} mm;"
            f" taxel.glue_gap_mm = {number(depth_mm - spec.washer_or_magnet.thickness_mm)} says the same",
        )


def _layers_of_pocket(spec: Spec) -> Iterator[Finding]:
    """Yield a note where rounding to whole printed layers makes the roof of the ballast's pocket higher than asked."""
    rest_mm = spec.mover_low_mm - spec.taxel.glue_gap_mm
    if rest_mm > ROUNDING_MM:
        yield Finding(
            "note",
            "recess.layers",
            "pocket",
            f"the roof over the ballast is {number(spec.pocket_top_mm)} mm up, a whole number of layers, so that the"
            f" {spec.mover.kind} lies {number(spec.mover_low_mm)} mm within the plate;"
            f" taxel.glue_gap_mm = {number(round(spec.mover_low_mm, 6))} says the same",
        )


def _modes(plan: Plan) -> Iterator[Finding]:
    for channel in plan.channels:
        if all(path.is_straight for path in plan.arrangement(channel).beams):
            continue
        # The working mode's share is 1, all others are smaller.
        others = [hz for hz, share in zip(channel.modes_hz, channel.mode_shares, strict=True) if share < 1]
        near = min(others, key=lambda hz: abs(hz - channel.resonance_hz), default=inf)
        if abs(near / channel.resonance_hz - 1) < 1 / channel.q:
            yield Finding(
                "warning",
                "modes.doubled",
                f"channel {channel.index}",
                f"it has another mode at {number(near)} Hz, {abs(near / channel.resonance_hz - 1):.1%} off its"
                f" resonance of {number(channel.resonance_hz)} Hz, at least the half-power width of {1 / channel.q:.1%}"
                " should lie between them: a beam with bends has no plane of symmetry that would keep the two apart",
            )


def _mechanics(plan: Plan) -> Iterator[Finding]:
    """Yield findings on how beams stretch, and how well the model knows their resonances."""
    spec = plan.spec
    for channel in plan.channels:
        if channel.level_loss_db > LOSS_DB:
            yield _stretching(spec, channel)
        if doubt := _model_doubt(spec, channel):
            yield Finding("warning", "model.error", f"channel {channel.index}", doubt)


def _model_doubt(spec: Spec, channel: Channel) -> str:
    """Say why the resonance is known less well than asked; empty where it is known well enough."""
    error = channel.model_error
    tuned = asked_error(spec)
    asked = spec.model.tolerance
    if channel.model == "solid":
        known = f"finite elements may be off by {error:.2%} of its resonance (allowed: {tuned:.2%}): it is not tuned"
        return known if error > tuned else ""
    if spec.model.structure == "solid":
        return (
            f"it is planned by the beam model, which may be off by {error:.2%} of its resonance, since finite elements"
            f" know it no better (allowed: {tuned:.2%})"
        )
    doubt = f"the beam model may be off by {error:.1%} of its resonance, more than model.tolerance = {asked:.1%}"
    return f"{doubt}; --model solid computes it by finite elements and tunes its beams" if error > asked else ""


def _stretching(spec: Spec, channel: Channel) -> Finding:
    """Return a warning that beams stretch as they bend, so that a tone planned for small motions misses the level."""
    alpha = channel.hardening_per_mm2
    sag_mm = channel.sag_um * UM / MM
    low = 0.0
    high = channel.level_um
    for _ in range(30):
        level = (low + high) / 2
        kept = float(level_kept(alpha, channel.q, level * UM / MM, sag_mm))
        low, high = (low, level) if -decibel(kept) > LOSS_DB else (level, high)
    sagged_hz = channel.resonance_hz * (1 + resonance_rise(alpha, 0.0, sag_mm))
    sags = "" if low > 0 else f"; its sag alone raises it to {number(sagged_hz)} Hz: re-tune it"
    jump_um = jump_amplitude(alpha, channel.q) * MM / UM
    jumps = f"; above {number(jump_um)} µm its response jumps between two levels" if jump_um < channel.level_um else ""
    return Finding(
        "warning",
        "beam.stretching",
        f"channel {channel.index}",
        f"its beams stretch as they bend: moving by {number(channel.level_um)} µm it resonates"
        f" {channel.level_shift:.1%} higher, and the planned tone moves it {channel.level_loss_db:.1f} dB less than"
        f" asked{jumps}{sags}",
        lower_level(spec, low / channel.level_um),
    )


def _places(plan: Plan) -> Iterator[Finding]:
    """Tell of places without a taxel, and of an uneven pitch; warn where a display would have holes."""
    places = plan.coils.rows * plan.coils.columns * len(plan.sets[0])
    if places > len(plan.taxels):
        yield Finding(
            "note",
            "layout.surplus",
            "coils",
            f"{places - len(plan.taxels)} of {places} places stay empty: no grid of exactly {len(plan.taxels)} taxels"
            " can be made here",
        )
    if plan.pitch.ratio > EVEN_RATIO:
        steps = [(name, step) for name, step in (("columns", plan.pitch.x_mm), ("rows", plan.pitch.y_mm)) if step]
        name, (low, high) = max(steps, key=lambda item: item[1][1] / item[1][0])
        across = "rows" if name == "columns" else "columns"
        yield Finding(
            "warning" if plan.pitch.ratio > HOLE_RATIO else "note",
            "layout.pitch",
            "pad",
            f"images come out uneven: seen along the {across}, neighbouring {name} of taxels lie {low:.2f} to"
            f" {high:.2f} mm apart ({about(high / low, 3)} : 1, even is up to {EVEN_RATIO:g} : 1), since"
            f" {plan.spec.mover.kind}s hang as near to their coil's axis as their beams allow",
        )


MOVES = (0.95, 1.05, 0.9)
"""Factors of the resonance of a channel whose taxel has a mode on a line of the drive, proposed as cures."""


class ParasiticMode(NamedTuple):
    """A mode of a taxel that may spoil the selectivity, with the spectral line of the drive that excites it most.

    The line, described by `line`, moves the taxel when OFF by `planned` of its ON amplitude, all modes counted, and by
    `at_peak` if this mode's peak lay on the line. `costs_db` is the all-state selectivity that the mode costs, 0 where
    that was not computed.
    """

    channel: int
    mode: int
    hz: float
    line_hz: float
    line: str
    at_peak: float
    planned: float
    is_spur: bool
    costs_db: float = 0.0


class _Lines(NamedTuple):
    """All spectral lines (l,) of i² that a coil's drive can make, with amplitudes in the unit of `Channels.line`.

    `first` and `second` are the channels that make a line (the same one for a tone), `kind` is its index in `KINDS`.
    """

    hz: np.ndarray
    amplitude: np.ndarray
    first: np.ndarray
    second: np.ndarray
    kind: np.ndarray


KINDS = (
    "the tone of channel {0}",
    "twice the tone of channel {0}",
    "the sum spur of {0} and {1}",
    "the difference spur of {0} and {1}",
    "half the tone of channel {0} (remanence)",
)
REMANENCE = len(KINDS) - 1


def parasitic_modes(spec: Spec, channels: Sequence[Channel], scheme: Scheme) -> list[ParasiticMode]:
    """Return the modes of taxels that may spoil the selectivity, each with the spectral line that excites it most.

    These are modes within half a slot of a line that could move the taxel, when OFF, by more than 1/Δy of its ON
    amplitude, and modes that cost more than `MODES_DB`.
    """
    coils = channel_sets(channels, spec.coil.sets) if len(channels) > spec.coil.sets else ()
    return [crowd for channel_set in coils for crowd in _coil_crowds(spec, channel_set, scheme)]


def _lines(taxels: Channels, scheme: Scheme) -> _Lines:
    parts = [
        (hz, np.sqrt(square), made.makers[0], made.makers[-1], np.full(len(hz), first_kind + k))
        for made, first_kind in zip(scheme_lines(taxels, scheme), (0, 2), strict=False)
        for k, (hz, square) in enumerate(zip(made.hz, np.broadcast_to(made.square, made.hz.shape), strict=True))
    ]
    if scheme.remanence and not scheme.has_constant:
        parts[1] = (*parts[1][:-1], np.full(len(taxels.line), REMANENCE))
    return _Lines(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _coil_crowds(spec: Spec, channel_set: Sequence[Channel], scheme: Scheme) -> Iterable[ParasiticMode]:
    """Return a coil's modes that may spoil its selectivity: near a spectral line, or costly for its worst OFF taxel."""
    taxels = placed_channels(spec, channel_set)
    modes = coil_modes(spec, channel_set)
    crowd_at = dict[tuple[int, int], ParasiticMode]()
    lines = _lines(taxels, scheme)
    half = slot_half_width(spec.q_min, spec.delta_y)
    order = np.argsort(lines.hz)
    for i, channel in enumerate(channel_set):
        for k in _others(channel):
            hz = channel.modes_hz[k]
            ends = (hz / (1 + half), hz / (1 - half) if half < 1 else inf)
            some = order[slice(*np.searchsorted(lines.hz, ends, sorter=order))]
            some = some[(lines.first[some] != i) & (lines.second[some] != i)]
            if len(some):
                crowd = _crowd(channel_set, taxels, modes, lines, (i, k, int(some[lines.amplitude[some].argmax()])))
                if crowd.at_peak > 1 / spec.delta_y:
                    crowd_at[i, k] = crowd
    kept = all_states(taxels, scheme, modes)
    costly = all_states(taxels, scheme).db - kept.db > MODES_DB
    for k in _others(channel_set[kept.off]) if costly else ():
        gain = modes.gain.copy()
        gain[kept.off, k] = 0.0
        costs_db = all_states(taxels, scheme, modes._replace(gain=gain)).db - kept.db
        if costs_db > MODES_DB:
            heard = felt_energy(_single_mode(modes, kept.off, k), slice(None), lines.hz)[0] * lines.amplitude**2
            heard *= (lines.first != kept.off) & (lines.second != kept.off)
            crowd = _crowd(channel_set, taxels, modes, lines, (kept.off, k, int(heard.argmax())))
            crowd_at[kept.off, k] = crowd._replace(costs_db=costs_db)
    return crowd_at.values()


def _others(channel: Channel) -> list[int]:
    working = int(np.argmax(channel.mode_shares))
    return [k for k in range(len(channel.modes_hz)) if k != working]


def _single_mode(modes: ModalTaxels, i: int, k: int) -> ModalTaxels:
    return ModalTaxels(modes.frequency_hz[[i]][:, [k]], modes.q[[i]], modes.gain[[i]][:, [k]], modes.left_out[[i]])


def _crowd(
    channel_set: Sequence[Channel], taxels: Channels, modes: ModalTaxels, lines: _Lines, at: tuple[int, int, int]
) -> ParasiticMode:
    """Return the `ParasiticMode` for the indices `at` of taxel, mode and line."""
    i, k, line = at
    ratio = float(lines.amplitude[line] / taxels.line[i])
    hz = channel_set[i].modes_hz[k]
    line_hz = float(lines.hz[line])
    makers = channel_set[lines.first[line]].index, channel_set[lines.second[line]].index
    return ParasiticMode(
        channel_set[i].index,
        k,
        hz,
        line_hz,
        KINDS[lines.kind[line]].format(*makers),
        ratio * float(np.sqrt(felt_energy(_single_mode(modes, i, k), slice(None), np.array([hz]))[0, 0])),
        ratio * float(np.sqrt(felt_energy(modes, slice(i, i + 1), np.array([line_hz]))[0, 0])),
        bool(lines.kind[line]),
    )


def judge_modes(plan: Plan) -> Iterator[Finding]:
    """Yield findings about modes close to lines of the drive, and about the selectivity that all modes cost."""
    spec = plan.spec
    all_crowds = parasitic_modes(spec, plan.channels, plan.scheme)
    cures = tuple(_mode_cures(plan, all_crowds)) if all_crowds else ()
    yield from _unexcited(plan, all_crowds)
    for crowd in all_crowds:
        name = mode_names(spec, plan.channels[crowd.channel])[crowd.mode]
        cost = f"; it costs {crowd.costs_db:.1f} dB (allowed: {number(MODES_DB)} dB)" if crowd.costs_db else ""
        yield Finding(
            "warning",
            "modes.crowded",
            f"channel {crowd.channel}",
            f"its {name} mode at {number(crowd.hz)} Hz lies near {crowd.line} ({number(crowd.line_hz)} Hz), which moves"
            f" the OFF taxel by {crowd.planned:.2g} of its ON amplitude, by {crowd.at_peak:.2g} if a print"
            f" brings the two together (allowed: {number(1 / spec.delta_y)}){cost}",
            cures,
        )
    figures = plan.selectivity
    if (figures.modes_cost_db or 0.0) > MODES_DB and figures.placed_all_states_db is not None:
        worst = max(all_crowds, key=lambda crowd: crowd.costs_db, default=None)
        most = ""
        if worst and worst.costs_db:
            name = mode_names(spec, plan.channels[worst.channel])[worst.mode]
            most = f", {worst.costs_db:.1f} dB of it by the {name} mode of channel {worst.channel}"
        yield Finding(
            "warning",
            "selectivity.modes",
            "coil",
            f"pulled off their centres, {spec.mover.kind}s also swing in other modes, which costs"
            f" {figures.modes_cost_db:.1f} dB in the worst state (allowed: {number(MODES_DB)} dB){most};"
            f" {figures.placed_all_states_db:.1f} dB are left",
            cures,
        )


def _unexcited(plan: Plan, all_crowds: Sequence[ParasiticMode]) -> Iterator[Finding]:
    """Yield a note on second modes near other channels' resonances that the coils' pull hardly excites."""
    loud = {(crowd.channel, crowd.hz) for crowd in all_crowds}
    half = slot_half_width(plan.spec.q_min, plan.spec.delta_y)
    silent = [
        (channel, other)
        for channel_set in plan.sets
        for channel, other in permutations(channel_set, 2)
        if channel.second_mode_share < QUIET_SHARE
        and abs(channel.second_mode_hz / other.resonance_hz - 1) < half
        and (channel.index, channel.second_mode_hz) not in loud
    ]
    if silent:
        listed = ", ".join(
            f"channel {c.index}'s at {number(c.second_mode_hz)} Hz near channel {o.index}" for c, o in silent
        )
        yield Finding(
            "note",
            "modes.near",
            _named(c for c, _ in silent),
            f"further modes lie near resonances of other channels ({listed}); the coil moves them by less than"
            f" {number(1 / plan.spec.delta_y)} of the ON amplitude; a {plan.spec.mover.kind} glued"
            " off its place would move them more",
        )


def _mode_cures(plan: Plan, all_crowds: Sequence[ParasiticMode]) -> Iterator[Cure]:
    """Yield cures for modes near spectral lines: changes of the spec that part the two, the smallest changes first."""
    spec = plan.spec
    channels = plan.channels
    if any(crowd.is_spur for crowd in all_crowds):
        others = [name for name in reversed(simplest_first(plan.spec.force_order)) if name != plan.selectivity.drive]
        yield from ({"drive.scheme": name} for name in others if not Scheme(name).takes_turns)
    if len({crowd.channel for crowd in all_crowds}) == 1:
        for factor in MOVES:
            moved = [c.target_hz * (factor if c.index == all_crowds[0].channel else 1) for c in channels]
            yield {"resonances_hz": [float(f"{hz:.4g}") for hz in moved]}
    if spec.spacing == "optimised" and not spec.resonances_hz:
        return  # other suspensions would each need a new, slow search for the optimum
    used = {c.beam.topology for c in channels}
    yield from ({"suspension.topology": name} for name in allowed("auto") if used != {name})
    if len({c.beam.thickness_mm for c in channels}) == 1:
        yield {"suspension.thickness_mm": round(channels[0].beam.thickness_mm + spec.printer.layer_mm, 6)}


PLAN_RULES: RuleBook[Plan] = RuleBook(
    "plan",
    _spacing,
    _off_target,
    _bed,
    _selectivity,
    _leak,
    _unknown_leak,
    recoil_findings,
    _unsure_pull,
    _limits,
    _softening,
    _beats,
    _imperceptible,
    _slow,
    _prints,
    _life,
    _layers,
    _modes,
    judge_modes,
    ballast_findings,
    core_findings,
    _mechanics,
    _places,
    board_findings,
    tray_room_findings,
    judge_touch,
    judge_touched_prints,
    judge_felt,
    judge_pushes,
    judge_pins,
    guard_findings,
)
"""Rules by which a plan is judged: functions that yield its findings.

They judge trials, such as cures, too, which lack some figures: see `quick` of `make.finish`.
"""
