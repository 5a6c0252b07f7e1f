"""The findings of a re-tuned print: what tones cannot mend, what the coils cannot give, what looks odd."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import log

from padgen.core.errors import at_most, number
from padgen.core.finding import Finding
from padgen.measured.advice import Trim, TrimStep, needed_db
from padgen.measured.fits import TaxelFit
from padgen.measured.predict import CoilFigures
from padgen.measured.tuning import Tuning
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import CoilLoad, Plan
from padgen.planner.printed_pads import coils_of

__all__ = ["judge_print", "trim_text"]

LOW_Q = 0.8
"""Share of the plan's Q below which a taxel is worth a finding."""
SIGMAS = 4.0
"""Print spreads by which a resonance may be off its plan before it looks like another taxel's."""
COARSE = 0.25
"""Share of half a bandwidth that the error of a resonance may have."""
MOST_NAMED = 4
ROUNDED_DB = 0.05
"""What a figure may be short of another by and be shown alike."""
LOWEST_TRIM = 0.85
"""Of a resonance: what glue or a file can still do; further down a taxel gains a third of its mass."""


def judge_print(
    plan: Plan,
    tuning: Tuning,
    fits: Sequence[TaxelFit],
    after: Sequence[CoilFigures],
    loads: Sequence[CoilLoad],
    schemes_db: Sequence[tuple[str, float | None]],
    trimmed: Sequence[Trim],
) -> Iterator[Finding]:
    """All findings."""
    yield from _unpulled(tuning)
    yield from _close(plan, tuning, after, schemes_db, trimmed)
    yield from _level(plan, after, loads)
    yield from _low_q(plan, tuning)
    yield from _order(plan, tuning)
    yield from _far(plan, tuning)
    yield from _coarse(tuning)
    yield from _disagree(fits)
    yield from _unmeasured(plan, tuning)


def _unpulled(tuning: Tuning) -> Iterator[Finding]:
    lost = [taxel.id for taxel in tuning.taxels if taxel.response_um_per_a2 <= 0]
    if lost:
        yield Finding(
            "error", "retune.pull", _named(lost), "not moved by any current of the coil: the tables cannot drive it"
        )


def _close(
    plan: Plan,
    tuning: Tuning,
    after: Sequence[CoilFigures],
    schemes_db: Sequence[tuple[str, float | None]],
    trimmed: Sequence[Trim],
) -> Iterator[Finding]:
    need, by_coil = needed_db(plan), {(trim.row, trim.column): trim for trim in trimmed}
    others = [name for name, db in schemes_db if db is not None and db >= need and name != plan.selectivity.drive]
    other = min(others, key=lambda name: Scheme(name).takes_turns, default=None)
    short = [(c.all_states_db, c) for c in after if c.all_states_db is not None and c.all_states_db < need - ROUNDED_DB]
    short.sort(key=lambda entry: entry[0])
    for db, coil in short[:MOST_NAMED]:
        trim = by_coil.get((coil.row, coil.column))
        ways = [f"drive = {other!r} would keep enough"] if other else []
        ways += [trim_text(trim)] if trim else []
        yield Finding(
            "warning",
            "retune.close",
            f"coil r{coil.row}c{coil.column}",
            f"re-tuned it keeps {db:.1f} dB in all states, needed: {need:.1f} dB; {_pair_text(tuning, coil)};"
            f" {'; or '.join(ways) or 'no trim that was tried helps'}",
        )
    if len(short) > MOST_NAMED:
        more = len(short) - MOST_NAMED
        yield Finding(
            "warning",
            "retune.close",
            "1 more coil" if more == 1 else f"{more} more coils",
            f"re-tuned {'it keeps' if more == 1 else 'they keep'} {short[MOST_NAMED][0]:.1f} dB or more,"
            f" needed: {need:.1f} dB; retune.json has the advice for each",
        )


def _pair_text(tuning: Tuning, coil: CoilFigures) -> str:
    taxels = {taxel.id: taxel for taxel in tuning.taxels}
    off, heard = taxels[coil.off], taxels[coil.heard]
    return (
        f"{off.id} at {number(off.resonance_hz)} Hz hears most of {heard.id} at {number(heard.resonance_hz)} Hz,"
        f" {abs(off.resonance_hz / heard.resonance_hz - 1):.1%} apart with a bandwidth of {1 / off.q:.1%}"
    )


def trim_text(trim: Trim) -> str:
    """What to do to a coil, as a clause."""
    if any(step.to_hz < LOWEST_TRIM * step.from_hz for step in trim.steps):
        return "no trim that is a trim would part them; print that pad, or these taxels' cells, again"
    steps = " and ".join(_step_text(step) for step in trim.steps)
    reach = "keeps" if trim.reaches else "then keeps no more than"
    return f"{steps}: it {reach} {trim.after_db:.1f} dB; measure again after it"


def _step_text(step: TrimStep) -> str:
    weight, filed = (f"{float(f'{value:.2g}'):g}" for value in (step.add_mg, step.file_width_mm))
    return f"lower {step.id} to {step.to_hz:.1f} Hz ({weight} mg of weight, or beams filed {filed} mm narrower)"


def _level(plan: Plan, after: Sequence[CoilFigures], loads: Sequence[CoilLoad]) -> Iterator[Finding]:
    spec = plan.spec
    level = spec.drive.level_um
    beyond = [(c, load) for c, load in zip(after, loads, strict=True) if load.reachable_level_um < level]
    if not beyond:
        return
    worst, load = min(beyond, key=lambda pair: pair[1].reachable_level_um)
    limits = {
        "voltage": f"{number(load.voltage_peak_v)} V of {number(spec.drive.voltage_limit_v)} V",
        "copper loss": f"{number(load.copper_loss_w)} W of {number(spec.coil.power_limit_w)} W",
        "gap": "more than a third of the gap, with sag and mean pull",
        "stretching": "more than beams that stretch follow without jumping between two levels",
        "root stress": "more than the beams' fatigue stress",
        "pull": "a washer that is not pulled",
    }
    do = f"drive.level_um = {at_most(load.reachable_level_um)} would do" if load.reachable_level_um > 0 else ""
    yield Finding(
        "warning",
        "retune.level",
        f"coil r{worst.row}c{worst.column}",
        f"{number(level)} µm with all channels on ask for {limits[load.reachable_by]}"
        + (f", {len(beyond)} coils in all ask for too much" if len(beyond) > 1 else "")
        + (f"; {do}" if do else ""),
    )


def _low_q(plan: Plan, tuning: Tuning) -> Iterator[Finding]:
    low = [
        tuned
        for taxel, tuned in zip(plan.taxels, tuning.taxels, strict=True)
        if tuned.measured and tuned.q < LOW_Q * plan.channels[taxel.channel].q
    ]
    if low:
        worst = min(low, key=lambda tuned: tuned.q)
        yield Finding(
            "warning",
            "retune.q",
            _named([tuned.id for tuned in low]),
            f"Q is as low as {number(worst.q)} ({worst.id}), planned: {number(plan.channels[0].q)}; soft glue, a crack"
            f" at a root or a beam that touches the frame would explain it; a spec with q_min = {at_most(worst.q)}"
            " counts with it",
        )


def _order(plan: Plan, tuning: Tuning) -> Iterator[Finding]:
    swapped = []
    for index in coils_of(plan).values():
        for low, high in pairwise(tuning.taxels[i] for i in index):
            if low.resonance_hz > high.resonance_hz:
                swapped.append(f"{low.id} above {high.id}")
    if swapped:
        yield Finding(
            "note",
            "retune.order",
            _named(swapped),
            "the print has their resonances in another order than the plan; tones follow the taxels, but check that"
            " the measurement has not taken one for the other",
        )


def _far(plan: Plan, tuning: Tuning) -> Iterator[Finding]:
    far = []
    for taxel, tuned in zip(plan.taxels, tuning.taxels, strict=True):
        channel = plan.channels[taxel.channel]
        ratio = tuned.resonance_hz / channel.resonance_hz
        if tuned.measured and abs(log(ratio)) > SIGMAS * max(channel.print_spread, 0.02):
            far.append((max(ratio, 1 / ratio), tuned, channel.resonance_hz))
    if far:
        _, worst, planned = max(far, key=lambda entry: entry[0])
        yield Finding(
            "warning",
            "retune.far",
            _named([tuned.id for _, tuned, _ in far]),
            f"{worst.id} is at {number(worst.resonance_hz)} Hz, planned: {number(planned)} Hz, farther than printing"
            " explains: another mode, another taxel or another unit may have been measured",
        )


def _coarse(tuning: Tuning) -> Iterator[Finding]:
    coarse = [t for t in tuning.taxels if t.measured and t.resonance_error_hz > COARSE * t.resonance_hz / (2 * t.q)]
    if coarse:
        worst = max(coarse, key=lambda t: t.resonance_error_hz * t.q / t.resonance_hz)
        yield Finding(
            "warning",
            "retune.uncertain",
            _named([t.id for t in coarse]),
            f"the resonance of {worst.id} is known to {number(worst.resonance_error_hz)} Hz, a quarter of half its"
            f" bandwidth is {number(COARSE * worst.resonance_hz / (2 * worst.q))} Hz; a longer record or less noise"
            " would do",
        )


def _disagree(fits: Sequence[TaxelFit]) -> Iterator[Finding]:
    split = [fit for fit in fits if not fit.agree]
    if split:
        worst = split[0]
        told = ", ".join(f"{m.method} {number(m.resonance_hz)} Hz" for m in worst.methods)
        yield Finding(
            "warning",
            "retune.fit",
            _named([fit.id for fit in split]),
            f"the methods differ by more than their errors ({worst.id}: {told}): a second resonance, a nonlinear one, a"
            " disturbed record, or a voltage taken for a current (--excitation voltage); look at its data",
        )


def _unmeasured(plan: Plan, tuning: Tuning) -> Iterator[Finding]:
    missing = [
        (taxel, planned) for taxel, planned in zip(tuning.taxels, plan.taxels, strict=True) if not taxel.measured
    ]
    if not missing:
        return
    moved = any(taxel.resonance_hz != plan.channels[p.channel].resonance_hz for taxel, p in missing)
    error = max(taxel.resonance_error_hz / taxel.resonance_hz for taxel, _ in missing)
    what = "get the tones that the measured ones make likely" if moved else "keep the plan's tones"
    yield Finding(
        "warning",
        "retune.unmeasured",
        _named([taxel.id for taxel, _ in missing]),
        f"{len(missing)} of {len(tuning.taxels)} taxels were not measured and {what}, good to {error:.1%} (one sigma)",
    )


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
