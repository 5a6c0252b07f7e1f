"""The findings of a plan: what holds only just, what does not, and what would."""

from collections.abc import Iterator
from itertools import pairwise

from padgen.errors import number
from padgen.finding import Finding
from padgen.physics.ladder import ladder_ratio
from padgen.planner.layout import coil_reach_mm
from padgen.planner.plan import Channel, Plan
from padgen.planner.sizing import SizedChannel, crowded_modes
from padgen.spec import Spec
from padgen.units import MM, MN, UM

PULL_DB = 1.0
"""Loss of selectivity by unequal pull that is worth a finding."""

__all__ = ["judge"]


def judge(spec: Spec, plan: Plan, sized: tuple[SizedChannel, ...]) -> tuple[Finding, ...]:
    """All findings of a plan, errors first."""
    found = [
        *_spacing(spec, plan.channels),
        *_selectivity(plan),
        *_unequal_pull(plan),
        *_modes(spec, plan, sized),
        *_coils(spec, plan),
        *_mechanics(spec, plan),
        *_places(plan),
    ]
    order = ("error", "warning", "note")
    return tuple(sorted(found, key=lambda f: order.index(f.level)))


def _spacing(spec: Spec, channels: tuple[Channel, ...]) -> Iterator[Finding]:
    bound = ladder_ratio(spec.q_min, spec.delta_y)
    for lower, upper in pairwise(channels):
        ratio = upper.resonance_hz / lower.resonance_hz
        if ratio < bound * (1 - 2e-3):
            yield Finding(
                "warning",
                "ladder.ratio",
                f"channels {lower.index} and {upper.index}",
                f"{number(lower.resonance_hz)} and {number(upper.resonance_hz)} Hz are {number(ratio)} apart,"
                f" the paper's slots need {number(bound)} at Q = {number(spec.q_min)}: move the upper to"
                f" {number(lower.resonance_hz * bound)} Hz, or raise Q to"
                f" {number(spec.delta_y / 4 * (ratio + 1) / (ratio - 1))}",
            )


def _selectivity(plan: Plan) -> Iterator[Finding]:
    figures = plan.selectivity
    if figures.one_hot_db is None or figures.all_states_db is None:
        return
    bound = figures.asked_db
    hint = "fewer channels per coil or a higher Q raise it"
    if figures.one_hot_db < bound:
        yield Finding(
            "warning",
            "selectivity.one_hot",
            "coil",
            f"an OFF taxel is {figures.one_hot_db:.1f} dB below an ON one with one channel on,"
            f" asked are {bound:.1f} dB (Δy); {hint}",
        )
    if figures.all_states_db < bound:
        few = "" if len(plan.channels) <= 2 else f", plain tones are clean up to {max(plan.capacity.exact, 1)} channels"
        yield Finding(
            "warning",
            "selectivity.all_states",
            f"state {figures.worst_state}",
            f"an OFF taxel is {figures.all_states_db:.1f} dB below an ON one (channel 0 first), asked are"
            f" {bound:.1f} dB{few}; {hint}",
        )


def _unequal_pull(plan: Plan) -> Iterator[Finding]:
    figures, pull = plan.selectivity, [c.force_constant_n_per_a2 for c in plan.channels]
    if figures.one_hot_db is None or figures.placed_one_hot_db is None or min(pull) <= 0:
        return
    if figures.placed_one_hot_db < figures.one_hot_db - PULL_DB:
        yield Finding(
            "warning",
            "selectivity.pull",
            "coil",
            f"the nearest washer of a coil is pulled {number(max(pull) / min(pull))} times as strongly as the farthest:"
            f" with that, an OFF taxel is {figures.placed_one_hot_db:.1f} dB below an ON one with one channel on;"
            " fewer channels per coil or a wider coil even it out",
        )


def _modes(spec: Spec, plan: Plan, sized: tuple[SizedChannel, ...]) -> Iterator[Finding]:
    for i, mode_hz, j, response in crowded_modes(spec, sized):
        yield Finding(
            "warning",
            "modes.crowded",
            f"channel {i}",
            f"its mode at {number(mode_hz)} Hz lies in the slot of channel {j}"
            f" ({number(plan.channels[j].resonance_hz)} Hz) and answers with {number(response)} of its ON amplitude,"
            f" at most {number(1 / spec.delta_y)}; another topology or resonance moves it",
        )


def _coils(spec: Spec, plan: Plan) -> Iterator[Finding]:
    reach = coil_reach_mm(spec)
    far = max(plan.channels, key=lambda c: c.site.coil_distance_mm)
    distance = far.site.coil_distance_mm
    if distance > reach:
        yield Finding(
            "warning",
            "coil.reach",
            f"channel {far.index}",
            f"its washer lies {number(distance)} mm off the coil axis, beyond the coil's reach of {number(reach)} mm;"
            f" take a coil of {number(2 * distance - spec.washer.outer_diameter_mm)} mm outer diameter or a finer grid",
        )
    for channel in plan.channels:
        if channel.force_constant_n_per_a2 <= 0:
            yield Finding(
                "error",
                "coil.force",
                f"channel {channel.index}",
                f"the coil does not pull its washer, {number(channel.site.coil_distance_mm)} mm off the axis;"
                f" at most {number(reach)} mm would do",
            )


def _mechanics(spec: Spec, plan: Plan) -> Iterator[Finding]:
    # All channels on: the mean of the squared current pulls every washer, c_i Σ F_j/c_j.
    square = sum(c.force_mn / c.force_constant_n_per_a2 for c in plan.channels if c.force_constant_n_per_a2 > 0)
    for channel in plan.channels:
        where = f"channel {channel.index}"
        static_um = square * channel.force_constant_n_per_a2 * MN / channel.stiffness_n_per_m / UM
        travel_mm = (channel.level_um + channel.sag_um + static_um) * UM / MM
        if travel_mm > spec.coil.gap_mm / 3:
            yield Finding(
                "warning",
                "gap.travel",
                where,
                f"sag ({number(channel.sag_um)} µm), static pull ({number(static_um)} µm) and amplitude together are"
                f" {number(travel_mm)} mm, a third of the gap is {number(spec.coil.gap_mm / 3)} mm;"
                f" a gap of {number(3 * travel_mm)} mm would do",
            )
        if channel.root_stress_mpa > spec.material.fatigue_stress_mpa:
            level = channel.level_um * spec.material.fatigue_stress_mpa / channel.root_stress_mpa
            yield Finding(
                "error",
                "beam.stress",
                where,
                f"the root is stressed by {number(channel.root_stress_mpa)} MPa at {number(channel.level_um)} µm,"
                f" {spec.material.name} bears {number(spec.material.fatigue_stress_mpa)} MPa;"
                f" a level of {number(level)} µm would do",
            )
        if channel.beam.layers < 2 and spec.printer.process == "fdm":
            yield Finding(
                "note",
                "beam.single_layer",
                where,
                f"its beams are a single layer of {number(channel.beam.thickness_mm)} mm: level the bed well,"
                f" their resonance spreads by {channel.print_spread:.0%}",
            )


def _places(plan: Plan) -> Iterator[Finding]:
    places = plan.coils.rows * plan.coils.columns * len(plan.channels)
    if places > len(plan.taxels):
        yield Finding(
            "note",
            "layout.surplus",
            "coils",
            f"{places - len(plan.taxels)} of {places} places stay empty: no whole grid gives {len(plan.taxels)} taxels",
        )
