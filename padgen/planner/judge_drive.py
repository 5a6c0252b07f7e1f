"""Make the findings about selectivity, coils and amplifiers."""

from collections.abc import Iterator
from itertools import combinations
from typing import Any

from padgen.core.errors import at_least, at_most, number
from padgen.core.finding import Finding
from padgen.core.units import MA, decibel
from padgen.physics.ladder import slot_half_width
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import Plan
from padgen.spec import Spec

__all__ = ["judge_drive", "lower_level"]

SMALLEST_LEVEL_UM = 1e-4
"""Smallest level that a spec may ask for."""
PULL_DB = 1.0
"""Loss of selectivity by unequal pull up to which there is no finding."""
SNAPPING_DB = 0.5
"""Loss of selectivity by printing in steps up to which there is no finding."""
PULL_ERROR = 0.1
"""Relative error of a pull up to which there is no finding."""


def judge_drive(plan: Plan) -> Iterator[Finding]:
    """Yield the findings about the drive, its load on coils and amplifiers, and how quiet OFF taxels stay."""
    yield from _selectivity(plan)
    yield from _unequal_pull(plan)
    yield from _snapping(plan)
    yield from _leak(plan)
    yield from _unsure_pull(plan)
    yield from _limits(plan)
    yield from _softening(plan)
    yield from _beats(plan)
    yield from _imperceptible(plan)
    yield from _slow(plan)


def _selectivity(plan: Plan) -> Iterator[Finding]:
    figures = plan.selectivity
    kept, one_hot = figures.kept_db, figures.one_hot_db
    if one_hot is None or kept is None:
        return  # a single channel has no selectivity
    bound = figures.asked_db
    if one_hot < bound:
        yield Finding(
            "warning",
            "selectivity.one_hot",
            "coil",
            f"with one channel on, an OFF taxel vibrates {_quieter(one_hot)} than the ON one, asked are"
            f" {bound:.1f} dB less",
        )
    if kept < bound:
        placed = figures.all_states_db is not None and kept < figures.all_states_db - PULL_DB
        yield Finding(
            "warning",
            "selectivity.all_states",
            f"state {figures.worst_state}",
            f"in this worst state (lowest channel first, 1 is ON) with drive = {figures.drive!r} an OFF taxel vibrates"
            f" {_quieter(kept)} than an ON one{', unequal pull and all modes counted' if placed else ''}, asked are"
            f" {bound:.1f} dB less",
            _selectivity_cures(plan),
        )


def _selectivity_cures(plan: Plan) -> tuple[dict[str, Any], ...]:
    """Return cures that may keep the asked selectivity: other drive schemes, those that take turns last, and grids."""
    asked, schemes = (
        plan.selectivity.asked_db,
        sorted(plan.selectivity.schemes, key=lambda s: Scheme(s.scheme).takes_turns),
    )
    # Turns are slow: a cure by such a scheme also lowers the asked frame rate to what the scheme reaches.
    slow = {
        rate.scheme: {"drive.least_frames_per_s": float(at_most(rate.frames_per_s))}
        for rate in plan.refresh
        if Scheme(rate.scheme).takes_turns and rate.frames_per_s < plan.spec.drive.least_frames_per_s
    }
    ways: list[dict[str, Any]] = [
        {"drive.scheme": s.scheme, **slow.get(s.scheme, {})} for s in schemes if s.reached_db >= asked
    ]
    grids = [o for o in plan.layouts if o.kept_db is None or o.kept_db >= asked]
    return (*ways, *({"coil.grid": [o.rows, o.columns]} for o in grids))


def _quieter(level_db: float) -> str:
    return f"{abs(level_db):.1f} dB {'less' if level_db >= 0 else 'more'}"


def _unequal_pull(plan: Plan) -> Iterator[Finding]:
    figures, pull = plan.selectivity, [c.force_constant_n_per_a2 for c in plan.channels]
    if figures.one_hot_db is None or figures.placed_one_hot_db is None:
        return
    # The placed figure also counts other modes, so the pulls must differ by more than the loss to be its cause.
    if figures.placed_one_hot_db < figures.one_hot_db - PULL_DB and decibel(max(pull) / min(pull)) > PULL_DB:
        yield Finding(
            "warning",
            "selectivity.pull",
            "coil",
            f"the washer nearest to a coil's axis is pulled {number(max(pull) / min(pull))} times as strongly as the"
            f" farthest: with one channel on, an OFF taxel vibrates {_quieter(figures.placed_one_hot_db)} than the ON"
            " one",
        )


def _snapping(plan: Plan) -> Iterator[Finding]:
    cost = plan.selectivity.snapping_db
    if cost is not None and cost > SNAPPING_DB:
        yield Finding(
            "note",
            "selectivity.snapping",
            "coil",
            f"{cost:.1f} dB of selectivity are lost because {plan.spec.printer.name} makes beams wider in steps of"
            f" {number(plan.spec.printer.width_step_mm)} mm, which moves the resonances",
        )


def _leak(plan: Plan) -> Iterator[Finding]:
    """Tell how much the coils around shake an OFF taxel: in step by the driver table, or each re-tuned on its own."""
    step, asked = plan.reuse.leak_db, plan.selectivity.asked_db
    apart = min((db for db in plan.reuse.retuned_leaks_db if db is not None), default=None)
    if step is None or apart is None or step >= asked:
        return
    short = apart < asked
    kept = (
        f"re-tuned {_quieter(apart)} than its own coil does when ON"
        if short
        else f"re-tuned {_quieter(apart)} than its own coil does when ON ({_quieter(step)} by the driver table)"
    )
    yield Finding(
        "warning" if short else "note",
        "coil.leak",
        f"channel {plan.reuse.leak_channel}",
        f"in their worst state the coils around shake this taxel, when it is OFF, {kept};"
        f" asked are {asked:.1f} dB less",
    )


def _unsure_pull(plan: Plan) -> Iterator[Finding]:
    for channel in plan.channels:
        if channel.force_error > PULL_ERROR:
            yield Finding(
                "warning",
                "coil.unsure",
                f"channel {channel.index}",
                f"the pull on its washer is known to ± {channel.force_error:.0%} only, so far off the coil's axis"
                f" ({number(channel.site.coil_distance_mm)} mm) that one side of it is drawn up and the other down",
            )


def lower_level(spec: Spec, share: float) -> tuple[dict[str, float], ...]:
    """Return a cure: a `share` of the level. Empty where that is below the smallest level that a spec may ask for."""
    level_um = float(at_most(spec.drive.level_um * share))
    return ({"drive.level_um": level_um},) if level_um >= SMALLEST_LEVEL_UM else ()


def _softening(plan: Plan) -> Iterator[Finding]:
    spec = plan.spec
    quarter_slot = slot_half_width(spec.q_min, spec.delta_y) / 2
    worst = max(plan.channels, key=lambda c: c.pull_shift)
    if plan.load.pull_in_share < 1 and worst.pull_shift > quarter_slot:
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
                            f"both on, they also pull at {number(hz)} Hz, within the resonance of channel {hit.index}"
                            f" ({number(hit.resonance_hz)} Hz), whose level then rises and falls",
                            ({"drive.scheme": "spur-free"},),
                        )


def _imperceptible(plan: Plan) -> Iterator[Finding]:
    drive = plan.spec.drive
    silent = [channel for channel in plan.channels if drive.threshold_hz and channel.ring_down_ms <= 0]
    if silent:
        yield Finding(
            "warning",
            "level.threshold",
            "channels " + ", ".join(str(channel.index) for channel in silent),
            f"{number(drive.level_um)} µm on channel 0 are not above the detection threshold: nobody feels it",
            tuple({"drive.level_um": float(at_least(drive.level_um * factor))} for factor in (1.01, 2, 5)),
        )


def _slow(plan: Plan) -> Iterator[Finding]:
    """Warn where no scheme that the amplifier plays is fast enough."""
    rate, least = {f.scheme: f.frames_per_s for f in plan.refresh}[plan.selectivity.drive], plan.spec.drive
    if plan.spec.amplifier and least.scheme == "auto" and rate < least.least_frames_per_s:
        yield Finding(
            "warning",
            "drive.slow",
            "drive",
            f"{plan.selectivity.drive} shows {number(rate)} frames/s, drive.least_frames_per_s asks for"
            f" {number(least.least_frames_per_s)}; the amplifier {plan.spec.amplifier.name} plays nothing faster that"
            " keeps what is asked",
            ({"drive.least_frames_per_s": float(at_most(rate))}, {"amplifier.coupling": "DC"}),
        )


EXCEEDED = {
    "coil.voltage": "channels on take up to {} V, the amplifier has {} V",
    "coil.current": "channels on take up to {} A, the amplifier has {} A",
    "coil.heat": "channels on heat each coil with {} W, it bears {} W",
    "limits.power": "taxels on take {} W in all coils, limits.power_w allows {} W",
}
"""Sentences about a load and its limit, by the code of the finding."""


def _limits(plan: Plan) -> Iterator[Finding]:
    spec, load, coils = plan.spec, plan.load, plan.coils.rows * plan.coils.columns
    most_a = spec.amplifier.current_a if spec.amplifier else None
    # What is asked, the limit, and the power of it with which the level goes.
    loads = {
        "coil.voltage": (load.voltage_peak_v, spec.drive.voltage_limit_v, 2),
        "coil.current": (load.current_peak_ma * MA, most_a, 2),
        "coil.heat": (load.copper_loss_w, spec.coil.power_limit_w, 1),
        "limits.power": (load.copper_loss_w * coils, spec.limits.power_w, 1),
    }
    for code, (asked, most, power) in loads.items():
        if most is not None and asked > most:
            told = EXCEEDED[code].format(number(asked), number(most))
            where = "pad" if code == "limits.power" else "coil"
            cures = lower_level(spec, (most / asked) ** power)
            yield Finding("warning", code, where, f"{number(spec.drive.level_um)} µm with all {told}", cures)
    if load.pull_in_share >= 1:
        yield Finding(
            "error",
            "coil.pull_in",
            "coil",
            f"the mean pull is {number(load.pull_in_share)} times the one at which the softest washer snaps to"
            " the coil",
            lower_level(spec, 0.99 / load.pull_in_share),
        )
