"""The findings about selectivity, coils and amplifiers."""

from collections.abc import Iterator

from padgen.errors import at_least, at_most, number
from padgen.finding import Finding
from padgen.planner.layout import coil_reach_mm
from padgen.planner.plan import Plan
from padgen.spec import Spec

__all__ = ["judge_drive"]

PULL_DB = 1.0
"""Loss of selectivity by unequal pull that is worth a finding."""
SNAPPING_DB = 0.5
"""Loss of selectivity by printing in steps that is worth a finding."""


def judge_drive(spec: Spec, plan: Plan) -> Iterator[Finding]:
    """Findings about what is driven how, and how well OFF taxels stay quiet."""
    yield from _selectivity(plan)
    yield from _unequal_pull(plan)
    yield from _snapping(plan)
    yield from _leak(plan)
    yield from _reach(spec, plan)
    yield from _limits(spec, plan)


def _selectivity(plan: Plan) -> Iterator[Finding]:
    figures = plan.selectivity
    if figures.one_hot_db is None or figures.all_states_db is None:
        return  # one channel has no other
    bound = figures.asked_db
    if figures.one_hot_db < bound:
        yield Finding(
            "warning",
            "selectivity.one_hot",
            "coil",
            f"with one channel on, an OFF taxel vibrates {_below(figures.one_hot_db)} than it,"
            f" asked: {bound:.1f} dB less (Δy); fewer channels per coil, a wider band or a higher Q raise it",
        )
    if figures.all_states_db < bound:
        yield Finding(
            "warning",
            "selectivity.all_states",
            f"state {figures.worst_state}",
            f"(channel 0 first, 1 is on) with {figures.drive} an OFF taxel vibrates {_below(figures.all_states_db)}"
            f" than an ON one, asked: {bound:.1f} dB less; {_better(plan)}",
        )


def _better(plan: Plan) -> str:
    """What would raise the all-state figure: another scheme that does, or fewer channels per coil."""
    figures = plan.selectivity
    reach = [s for s in figures.schemes if s.all_states_db is not None and s.all_states_db >= figures.asked_db]
    if reach:
        return f"drive = {reach[0].scheme!r} reaches {reach[0].all_states_db:.1f} dB"
    clean = [o for o in plan.layouts if o.channels <= plan.capacity.exact]
    if clean and len(plan.sets[0]) > clean[0].channels:
        return f"coil.grid = [{clean[0].rows}, {clean[0].columns}] has {clean[0].channels} channels per coil"
    return "fewer channels per coil or a higher Q raise it; padgen plan --explain ranks what would do"


def _below(level_db: float) -> str:
    return f"{abs(level_db):.1f} dB {'less' if level_db >= 0 else 'more'}"


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
            f" with one channel on, an OFF taxel then vibrates {_below(figures.placed_one_hot_db)} than it;"
            " fewer channels per coil or a wider coil even it out",
        )


def _snapping(plan: Plan) -> Iterator[Finding]:
    cost = plan.selectivity.snapping_db
    if cost is not None and cost > SNAPPING_DB:
        yield Finding(
            "note",
            "selectivity.snapping",
            "coil",
            f"that beams print in steps moves the resonances, which costs {cost:.1f} dB in all states; a printer with"
            " finer steps has it back",
        )


def _leak(plan: Plan) -> Iterator[Finding]:
    leak, asked = plan.reuse.leak_db, plan.selectivity.asked_db
    other = "coil.reuse = 'alternate', " if plan.coils.sets == 1 else ""
    if leak is not None and leak < asked:
        yield Finding(
            "warning",
            "coil.leak",
            f"channel {plan.reuse.leak_channel}",
            f"the coils around an OFF taxel, all with its channel on, shake it {_below(leak)} than their own,"
            f" asked: {asked:.1f} dB less; {other}washers nearer to their coil or a wider pitch would do",
        )


def _reach(spec: Spec, plan: Plan) -> Iterator[Finding]:
    reach = coil_reach_mm(spec)
    far = max(plan.channels, key=lambda c: c.site.coil_distance_mm)
    distance = far.site.coil_distance_mm
    if distance > reach:
        needed = 2 * distance - spec.washer.outer_diameter_mm
        wider = f"a coil of {at_least(needed)} mm outer diameter or " if needed < plan.coils.pitch_mm else ""
        yield Finding(
            "warning",
            "coil.reach",
            f"channel {far.index}",
            f"its washer lies {number(distance)} mm off the coil axis, beyond the coil's reach of {number(reach)} mm;"
            f" {wider}a finer grid would do",
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


def _limits(spec: Spec, plan: Plan) -> Iterator[Finding]:
    load, level = plan.load, spec.drive.level_um
    volts, watts = spec.drive.voltage_limit_v, spec.coil.power_limit_w
    if load.voltage_peak_v > volts:
        yield Finding(
            "warning",
            "coil.voltage",
            "coil",
            f"{number(level)} µm with all channels on take up to {number(load.voltage_peak_v)} V, the amplifier has"
            f" {number(volts)} V; drive.level_um = {at_most(level * (volts / load.voltage_peak_v) ** 2)} would do",
        )
    if load.copper_loss_w > watts:
        yield Finding(
            "warning",
            "coil.heat",
            "coil",
            f"{number(level)} µm with all channels on take {number(load.copper_loss_w)} W of copper loss, the coil"
            f" bears {number(watts)} W; drive.level_um = {at_most(level * watts / load.copper_loss_w)} would do",
        )
    if load.pull_in_share >= 1:
        yield Finding(
            "error",
            "coil.pull_in",
            "coil",
            f"the mean pull is {number(load.pull_in_share)} times the one at which the softest washer snaps to the"
            f" coil; drive.level_um = {at_most(level / load.pull_in_share)} would just do",
        )
