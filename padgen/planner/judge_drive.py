"""The findings about selectivity, coils and amplifiers."""

from collections.abc import Iterator
from itertools import combinations

from padgen.core.errors import at_least, at_most, number
from padgen.core.finding import Finding
from padgen.core.units import decibel
from padgen.physics.ladder import slot_half_width
from padgen.physics.selectivity import Scheme
from padgen.planner.layout import coil_reach_mm
from padgen.planner.plan import Plan

__all__ = ["judge_drive"]

SMALLEST_LEVEL_UM = 1e-4
"""Smallest that a spec may ask for."""
PULL_DB = 1.0
"""Loss of selectivity by unequal pull that is worth a finding."""
SNAPPING_DB = 0.5
"""Loss of selectivity by printing in steps that is worth a finding."""
UNSURE = 0.1
"""Relative error of a pull that is worth a finding."""


def judge_drive(plan: Plan) -> Iterator[Finding]:
    """Findings about what is driven how, and how well OFF taxels stay quiet."""
    yield from _selectivity(plan)
    yield from _unequal_pull(plan)
    yield from _snapping(plan)
    yield from _leak(plan)
    yield from _reach(plan)
    yield from _limits(plan)
    yield from _softening(plan)
    yield from _beats(plan)
    yield from _imperceptible(plan)


def _selectivity(plan: Plan) -> Iterator[Finding]:
    figures = plan.selectivity
    kept, one_hot = figures.kept_db, figures.one_hot_db
    if one_hot is None or kept is None:
        return  # one channel has no other
    bound = figures.asked_db
    if one_hot < bound:
        yield Finding(
            "warning",
            "selectivity.one_hot",
            "coil",
            f"with one channel on, an OFF taxel vibrates {_below(one_hot)} than it,"
            f" asked: {bound:.1f} dB less (Δy); fewer channels per coil, a wider band or a higher Q raise it",
        )
    if kept < bound:
        placed = figures.all_states_db is not None and kept < figures.all_states_db - PULL_DB
        yield Finding(
            "warning",
            "selectivity.all_states",
            f"state {figures.worst_state}",
            f"(lowest channel first, 1 is ON) with {figures.drive} an OFF taxel vibrates {_below(kept)}"
            f" than an ON one{', unequal pull and all modes counted' if placed else ''}, asked:"
            f" {bound:.1f} dB less; {_better(plan)}",
        )


def _better(plan: Plan) -> str:
    """What would keep what was asked: another scheme for all at once, another grid, or, slow, turns."""
    figures, rates = plan.selectivity, {rate.scheme: rate.frames_per_s for rate in plan.refresh}
    reach = [s for s in figures.schemes if s.reached_db >= figures.asked_db]
    ways = [f"drive = {s.scheme!r} keeps {s.reached_db:.1f} dB" for s in reach if not Scheme(s.scheme).takes_turns][:1]
    for option in plan.layouts:
        if option.kept_db is None or option.kept_db >= figures.asked_db:
            kept = "one channel per coil" if option.kept_db is None else f"{option.channels} channels per coil"
            db = "" if option.kept_db is None else f" and keeps {option.kept_db:.1f} dB"
            ways.append(f"coil.grid = [{option.rows}, {option.columns}] has {kept}{db}")
            break
    for s in reach:
        if Scheme(s.scheme).takes_turns:
            ways.append(f"drive = {s.scheme!r} keeps {s.reached_db:.1f} dB at {rates[s.scheme]:.2g} frames/s")
    if not ways:
        ways.append("fewer channels per coil or a higher Q raise it; padgen plan --explain ranks what would do")
    return "; ".join(ways)


def _below(level_db: float) -> str:
    return f"{abs(level_db):.1f} dB {'less' if level_db >= 0 else 'more'}"


def _unequal_pull(plan: Plan) -> Iterator[Finding]:
    figures, pull = plan.selectivity, [c.force_constant_n_per_a2 for c in plan.channels]
    if figures.one_hot_db is None or figures.placed_one_hot_db is None or min(pull) <= 0:
        return
    # Other modes are in the placed figure, too: pulls that differ by less cannot cost as much.
    if figures.placed_one_hot_db < figures.one_hot_db - PULL_DB and decibel(max(pull) / min(pull)) > PULL_DB:
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
    """Re-tuned, coils play frequencies of their own; by the driver table they play in step."""
    step, asked = plan.reuse.leak_db, plan.selectivity.asked_db
    apart = min((db for db in plan.reuse.retuned_leaks_db if db is not None), default=None)
    if step is None or apart is None or step >= asked:
        return
    other = "coil.reuse = 'alternate', " if plan.coils.sets == 1 else ""
    short = apart < asked
    kept = f"re-tuned, {_below(apart)}" if short else f"re-tuned {_below(apart)} and by the driver table {_below(step)}"
    yield Finding(
        "warning" if short else "note",
        "coil.leak",
        f"channel {plan.reuse.leak_channel}",
        f"in their worst state the coils around shake this taxel, OFF, {kept} than its own would, asked:"
        f" {asked:.1f} dB less; {other}washers nearer to their coil or a wider pitch would do",
    )


def _reach(plan: Plan) -> Iterator[Finding]:
    reach = coil_reach_mm(plan.spec)
    far = max(plan.channels, key=lambda c: c.site.coil_distance_mm)
    distance = far.site.coil_distance_mm
    if distance > reach:
        needed = 2 * distance - plan.spec.washer.outer_diameter_mm
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
        elif channel.force_error > UNSURE:
            yield Finding(
                "warning",
                "coil.unsure",
                f"channel {channel.index}",
                f"the pull on its washer is known to ± {channel.force_error:.0%} only: what draws its parts up and down"
                " or turns it all but cancels",
            )


def _level(level_um: float) -> str:
    """A level that would do, unless it is none that a spec may ask for."""
    if level_um < SMALLEST_LEVEL_UM:
        return "no level would do"
    return f"drive.level_um = {at_most(level_um)} would do"


def _softening(plan: Plan) -> Iterator[Finding]:
    spec = plan.spec
    quarter_slot = slot_half_width(spec.q_min, spec.delta_y) / 2
    worst = max(plan.channels, key=lambda c: c.pull_shift)
    if plan.load.pull_in_share < 1 and worst.pull_shift > quarter_slot:
        yield Finding(
            "warning",
            "coil.softening",
            f"channel {worst.index}",
            f"the mean pull of all channels softens its spring and lowers its resonance by {worst.pull_shift:.1%}, a"
            f" quarter of its slot is {quarter_slot:.1%}; a level of"
            f" {at_most(spec.drive.level_um * quarter_slot / worst.pull_shift)} µm or a wider gap would do",
        )


def _beats(plan: Plan) -> Iterator[Finding]:
    """Spurs of two channels that fall on one of the two: their sum or difference with it is not a steady level."""
    scheme = plan.scheme
    for own in plan.sets if scheme.has_pair_spurs else ():
        for low, high in combinations(own, 2):
            spurs = high.resonance_hz + low.resonance_hz, high.resonance_hz - low.resonance_hz
            for hz in (spur * scheme.pair_scale for spur in spurs):
                for hit in (low, high):
                    if abs(hz / hit.resonance_hz - 1) < 1 / hit.q:
                        yield Finding(
                            "warning",
                            "level.beats",
                            f"channels {low.index} and {high.index}",
                            f"both on, they make a spur at {number(hz)} Hz, within the resonance of channel {hit.index}"
                            f" ({number(hit.resonance_hz)} Hz), whose level then beats; move one by"
                            f" {2 / hit.q:.0%}, or take drive = 'spur-free'",
                        )


def _imperceptible(plan: Plan) -> Iterator[Finding]:
    drive = plan.spec.drive
    silent = [channel for channel in plan.channels if drive.threshold_hz and channel.ring_down_ms <= 0]
    if silent:
        yield Finding(
            "warning",
            "level.threshold",
            "channels " + ", ".join(str(channel.index) for channel in silent),
            f"{number(drive.level_um)} µm on channel 0 is not above the detection threshold; a higher"
            " drive.level_um would do",
        )


def _limits(plan: Plan) -> Iterator[Finding]:
    spec, load, level = plan.spec, plan.load, plan.spec.drive.level_um
    volts, watts = spec.drive.voltage_limit_v, spec.coil.power_limit_w
    if load.voltage_peak_v > volts:
        yield Finding(
            "warning",
            "coil.voltage",
            "coil",
            f"{number(level)} µm with all channels on take up to {number(load.voltage_peak_v)} V, the amplifier has"
            f" {number(volts)} V; {_level(level * (volts / load.voltage_peak_v) ** 2)}",
        )
    if load.copper_loss_w > watts:
        yield Finding(
            "warning",
            "coil.heat",
            "coil",
            f"{number(level)} µm with all channels on take {number(load.copper_loss_w)} W of copper loss, the coil"
            f" bears {number(watts)} W; {_level(level * watts / load.copper_loss_w)}",
        )
    if load.pull_in_share >= 1:
        yield Finding(
            "error",
            "coil.pull_in",
            "coil",
            f"the mean pull is {number(load.pull_in_share)} times the one at which the softest washer snaps to the"
            f" coil; {_level(level / load.pull_in_share)}",
        )
