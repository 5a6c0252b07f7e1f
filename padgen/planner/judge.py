"""Make the findings of a plan: limits that it breaks or nearly breaks, with proposed cures."""

from collections.abc import Iterator
from dataclasses import fields
from itertools import pairwise
from math import inf

from padgen.core.errors import at_least, number, percent
from padgen.core.finding import LEVELS, Finding
from padgen.core.units import MM, UM, decibel
from padgen.physics.ladder import ladder_ratio, slot_half_width
from padgen.physics.stretching import jump_amplitude, level_kept, resonance_rise
from padgen.planner.drive_scheme import modes_matter
from padgen.planner.judge_drive import judge_drive, lower_level
from padgen.planner.left_out import judge_left_out
from padgen.planner.pitch import judge_pitch
from padgen.planner.plan import Channel, Plan
from padgen.planner.printable import DRAWN_SHARE, steps_are_coarse
from padgen.planner.solved_model import asked_error
from padgen.planner.touch import judge_touch
from padgen.spec import Coil, Spec

SPACING_SHARE = 0.05
"""Share of a slot by which a resonance may be off without a finding."""
GAPS_TRIED = (1.01, 1.3, 2.0)
"""Wider gaps that are proposed, over three times the travel: farther from the coil a washer is pulled more evenly."""
STRENGTH_OVER_FATIGUE = 4.0
"""Breaking stress over fatigue stress: the catalogue's fatigue stress is a quarter of the strength."""
LARGE_MOTION = 0.25
"""Largest deflection of a beam over its length. The secant stiffness of a cantilever under an end load is then 7 %
above that of linear theory (elastica)."""
LOSS_DB = 0.5
"""Loss of level by stretching beams up to which there is no finding."""
ROUNDING_MM = 1e-6
LARGEST_GAP_MM = next(item.metadata["high"] for item in fields(Coil) if item.name == "gap_mm")

__all__ = ["judge"]


def judge(plan: Plan) -> tuple[Finding, ...]:
    """Return all findings of a plan, errors first."""
    spec = plan.spec
    found = [
        *(found for own in plan.sets for found in _spacing(spec, own)),
        *_off_target(spec, plan.channels),
        *_bed(spec),
        *judge_drive(plan),
        *_prints(plan),
        *_single_layers(spec, plan.channels),
        *_recess(spec),
        *_modes(plan),
        *_mechanics(plan),
        *_empty_places(plan),
        *judge_pitch(plan),
        *judge_touch(plan),
        *judge_left_out(spec, plan.left_out),
    ]
    return tuple(sorted(found, key=lambda f: -LEVELS.index(f.level)))


def _spacing(spec: Spec, channels: tuple[Channel, ...]) -> Iterator[Finding]:
    bound = ladder_ratio(spec.q_min, spec.delta_y)
    for lower, upper in pairwise(channels):
        ratio = upper.resonance_hz / lower.resonance_hz
        if ratio < 1 + (bound - 1) * (1 - SPACING_SHARE):
            yield Finding(
                "warning",
                "ladder.ratio",
                f"channels {lower.index} and {upper.index}",
                f"{number(lower.resonance_hz)} and {number(upper.resonance_hz)} Hz lie a factor of {number(ratio)}"
                f" apart; at Q = {number(spec.q_min)} the paper's formula asks for {number(bound)}, the upper one at"
                f" {at_least(lower.resonance_hz * bound)} Hz or higher",
            )


def _off_target(spec: Spec, channels: tuple[Channel, ...]) -> Iterator[Finding]:
    """Warn of resonances off their targets by over `SPACING_SHARE` of a slot, and reject those outside the band.

    Beams print in steps of width. At a large Q, or where these steps are coarse, a step moves a resonance that far.
    """
    share = slot_half_width(spec.q_min, spec.delta_y) * SPACING_SHARE
    for channel in channels:
        miss = abs(channel.resonance_hz / channel.target_hz - 1)
        # With coarse steps the ladder is fitted to the steps; the loss is told by `selectivity.snapping`.
        if miss > share and (spec.resonances_hz or not steps_are_coarse(spec)):
            yield Finding(
                "warning",
                "resonance.off",
                f"channel {channel.index}",
                f"it resonates {percent(miss)} off its target of {number(channel.target_hz)} Hz, {percent(share)}"
                f" allowed: beams are as wide as whole steps of {number(spec.printer.width_step_mm)} mm; the driver"
                " table drives it where it resonates",
            )
        if not spec.band_hz[0] * (1 - DRAWN_SHARE) <= channel.resonance_hz <= spec.band_hz[1] * (1 + DRAWN_SHARE):
            yield Finding(
                "error",
                "resonance.band",
                f"channel {channel.index}",
                f"it resonates at {channel.resonance_hz:.9g} Hz, outside the band of {spec.band_hz[0]:.9g} …"
                f" {spec.band_hz[1]:.9g} Hz",
            )


def _bed(spec: Spec) -> Iterator[Finding]:
    pad, printer = spec.pad, spec.printer
    size = sorted((pad.width_mm + 2 * pad.border_mm, pad.depth_mm + 2 * pad.border_mm))
    bed = sorted((printer.bed_x_mm, printer.bed_y_mm))
    if size[0] > bed[0] or size[1] > bed[1]:
        yield Finding(
            "error",
            "plan.bed",
            "pad",
            f"with its border it measures {number(size[1])} x {number(size[0])} mm, the bed of {printer.name} is"
            f" {number(bed[1])} x {number(bed[0])} mm",
            _fitting(spec),
        )


def _fitting(spec: Spec) -> tuple[dict[str, float], ...]:
    """Return a cure: the largest active area that fits on the bed, in either orientation."""
    pad, printer = spec.pad, spec.printer
    bed = sorted((printer.bed_x_mm - 2 * pad.border_mm, printer.bed_y_mm - 2 * pad.border_mm))
    sides = bed if pad.width_mm <= pad.depth_mm else bed[::-1]
    if bed[0] <= 0:
        return ()
    return ({"pad.width_mm": min(pad.width_mm, sides[0]), "pad.depth_mm": min(pad.depth_mm, sides[1])},)


def _prints(plan: Plan) -> Iterator[Finding]:
    """Tell how many prints keep the asked selectivity, and whether every taxel must be measured for that."""
    prints, wanted, asked = plan.prints, plan.spec.print_share, plan.selectivity.asked_db
    if prints.print_db is None or prints.planned_db is None:
        return
    if prints.good_share < wanted:
        yield Finding(
            "warning",
            "print.share",
            "pad",
            f"with every taxel re-tuned, {prints.good_share:.0%} of its prints keep the {asked:.1f} dB of ON over OFF"
            f" that are asked for; {wanted:.0%} of all prints keep {prints.print_db:.1f} dB; --explain ranks what would"
            " help, --plot draws which coils suffer",
        )
    if prints.planned_db < min(asked, prints.print_db):
        yield Finding(
            "note",
            "print.spread",
            "pad",
            f"expect to measure and re-tune every taxel: driven as planned, {wanted:.0%} of prints keep"
            f" {prints.planned_db:.1f} dB",
        )


def _single_layers(spec: Spec, channels: tuple[Channel, ...]) -> Iterator[Finding]:
    single = [c for c in channels if c.beam.layers < 2 and spec.printer.process == "fdm"]
    if single:
        yield Finding(
            "note",
            "beam.single_layer",
            ("channels " if len(single) > 1 else "channel ") + ", ".join(str(c.index) for c in single),
            f"beams of a single layer of {number(single[0].beam.thickness_mm)} mm are as uneven in thickness as the"
            " bed is: level it well",
        )


def _recess(spec: Spec) -> Iterator[Finding]:
    asked_mm, depth_mm = spec.washer.thickness_mm + spec.taxel.glue_gap_mm, spec.recess_depth_mm
    if depth_mm - asked_mm > ROUNDING_MM:
        yield Finding(
            "note",
            "recess.layers",
            "recess",
            f"the recess is {number(depth_mm)} mm deep, a whole number of layers; washer and glue need"
            f" {number(asked_mm)} mm; taxel.glue_gap_mm = {number(depth_mm - spec.washer.thickness_mm)} says the same",
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
    if not modes_matter(plan):
        return
    # Imported late: most plans do not need it.
    from padgen.planner.judge_modes import judge_modes

    yield from judge_modes(plan)


def _mechanics(plan: Plan) -> Iterator[Finding]:
    spec = plan.spec
    for channel in plan.channels:
        where = f"channel {channel.index}"
        travel_mm, gap_mm = (channel.level_um + channel.sag_um + channel.static_um) * UM / MM, spec.coil.gap_mm
        if travel_mm > gap_mm / 3:
            touches = travel_mm >= gap_mm
            bound = (
                f"the gap is {number(gap_mm)} mm: its washer meets the coil"
                if touches
                else f"a third of the gap is {number(gap_mm / 3)} mm"
            )
            yield Finding(
                "error" if touches else "warning",
                "gap.travel",
                where,
                f"sag ({number(channel.sag_um)} µm), static pull ({number(channel.static_um)} µm) and amplitude"
                f" together are {number(travel_mm)} mm, {bound}",
                _more_room(spec, travel_mm),
            )
        yield from _statics(spec, channel)
        yield from _stretching(spec, channel)
        if channel.root_stress_mpa > spec.material.fatigue_stress_mpa:
            yield Finding(
                "error",
                "beam.stress",
                where,
                f"at {number(channel.level_um)} µm the root of its beams is stressed by"
                f" {number(channel.root_stress_mpa)} MPa, {spec.material.name} bears"
                f" {number(spec.material.fatigue_stress_mpa)} MPa for long",
                lower_level(spec, spec.material.fatigue_stress_mpa / channel.root_stress_mpa),
            )
        if doubt := _model_doubt(spec, channel):
            yield Finding("warning", "model.error", where, doubt)


def _model_doubt(spec: Spec, channel: Channel) -> str:
    """Say why the resonance is known less well than asked; empty where it is known well enough."""
    error, asked = channel.model_error, spec.model.tolerance
    if channel.model == "solid":
        asked = asked_error(spec)
        known = f"finite elements may be off by {error:.2%} of its resonance, asked is {asked:.2%}: it is not tuned"
        return known if error > asked else ""
    if spec.model.structure == "solid":
        return (
            f"it is planned by the beam model, which may be off by {error:.2%} of its resonance, since finite elements"
            f" know it no better; asked is {asked_error(spec):.2%}"
        )
    own = f"the beam model may be off by {error:.1%} of its resonance, model.tolerance is {asked:.1%}"
    return f"{own}; --model solid computes it by finite elements and tunes its beams" if error > asked else ""


def _statics(spec: Spec, channel: Channel) -> Iterator[Finding]:
    """Yield errors for a taxel that breaks, or that bends too far for the beam model, by weight, pull and amplitude."""
    moved_um = channel.sag_um + channel.static_um + channel.level_um
    stress, strength = (
        channel.root_stress_mpa * moved_um / channel.level_um,
        STRENGTH_OVER_FATIGUE * spec.material.fatigue_stress_mpa,
    )
    if stress > strength:
        yield Finding(
            "error",
            "beam.strength",
            f"channel {channel.index}",
            f"sag, mean pull and amplitude, {number(moved_um * UM / MM)} mm in all, stress its root by {number(stress)}"
            f" MPa, {spec.material.name} breaks at about {number(strength)} MPa",
            lower_level(spec, 0.5),
        )
    length_mm = channel.beam.length_mm
    if moved_um * UM / MM > LARGE_MOTION * length_mm:
        yield Finding(
            "error",
            "beam.sag",
            f"channel {channel.index}",
            f"sag, mean pull and amplitude move it by {number(moved_um * UM / MM)} mm, more than {LARGE_MOTION:.0%} of"
            f" its beams' length of {number(length_mm)} mm: no figure of this plan holds",
            lower_level(spec, 0.5),
        )


def _stretching(spec: Spec, channel: Channel) -> Iterator[Finding]:
    """Warn where beams stretch as they bend (bridges), so that a tone planned for small motions misses the level."""
    alpha, sag_mm = channel.hardening_per_mm2, channel.sag_um * UM / MM
    if channel.level_loss_db <= LOSS_DB:
        return
    low, high = 0.0, channel.level_um
    for _ in range(30):
        level = (low + high) / 2
        kept = level_kept(alpha, channel.q, level * UM / MM, sag_mm)
        low, high = (low, level) if -decibel(kept) > LOSS_DB else (level, high)
    sagged_hz = channel.resonance_hz * (1 + resonance_rise(alpha, 0.0, sag_mm))
    sags = "" if low > 0 else f"; its sag alone raises it to {number(sagged_hz)} Hz: re-tune it"
    jump_um = jump_amplitude(alpha, channel.q) * MM / UM
    jumps = f"; above {number(jump_um)} µm its response jumps between two levels" if jump_um < channel.level_um else ""
    yield Finding(
        "warning",
        "beam.stretching",
        f"channel {channel.index}",
        f"its beams stretch as they bend: moving by {number(channel.level_um)} µm it resonates"
        f" {channel.level_shift:.1%} higher, and the planned tone moves it {channel.level_loss_db:.1f} dB less than"
        f" asked{jumps}{sags}",
        lower_level(spec, low / channel.level_um),
    )


def _more_room(spec: Spec, travel_mm: float) -> tuple[dict[str, float], ...]:
    """Return cures for a travel that takes too much of the gap: wider gaps and lower levels."""
    gaps = [float(at_least(3 * travel_mm * factor)) for factor in GAPS_TRIED]
    wider = [{"coil.gap_mm": gap_mm} for gap_mm in gaps if spec.coil.gap_mm < gap_mm <= LARGEST_GAP_MM]
    return (*wider, *lower_level(spec, 0.5), *lower_level(spec, 0.1))


def _empty_places(plan: Plan) -> Iterator[Finding]:
    places = plan.coils.rows * plan.coils.columns * len(plan.sets[0])
    if places > len(plan.taxels):
        yield Finding(
            "note",
            "layout.surplus",
            "coils",
            f"{places - len(plan.taxels)} of {places} places stay empty: no grid of exactly {len(plan.taxels)} taxels"
            " can be made here",
        )
