"""Trim advice and findings for a re-tuned print: what tones cannot mend, what coils cannot give, what looks odd.

A trim lowers the resonances of named taxels where two came out too close for any tones. Only lowering is advised, since
weight is easily added and a beam easily thinned, but not the reverse. A weight dm on the plate lowers a resonance f to
f', ``dm = m ((f/f')² − 1)``, with the effective mass m. Filing a beam of size t by dt follows the sensitivity s of the
beam model, ``f'/f = (1 − dt/t)^s``. The search takes the lightest weight on one taxel that is enough for the coil.
Where no single weight is enough, taxels are lowered one after the other, each time by the change that helps most."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf, log

import numpy as np

from padgen.core.errors import Finding, at_most, number
from padgen.core.units import GRAM, MG
from padgen.measured.fits import TaxelFit
from padgen.measured.predict import CoilFigures, levels_um, predicted, tones_at
from padgen.measured.tuning import Tuning
from padgen.physics.selectivity import Channels, Scheme, off_energy
from padgen.planner.plan import CoilLoad, Plan
from padgen.planner.printed_pads import coils_of, sensitivities

__all__ = [
    "Trim",
    "TrimStep",
    "judge_print",
    "needed_db",
    "trims",
]

SHORT_OF_PLAN_DB = 1.0
"""Largest loss in dB against the plan that is accepted where the plan itself keeps less than was asked."""
LARGEST = 0.25
"""Largest share by which a resonance is lowered; it takes a weight of 0.8 times the moving mass."""
STEPS = 64
"""Number of shares tried for each taxel, from an eighth of the narrowest bandwidth, in even ratios."""
MOST_STEPS = 4
"""Most steps in which taxels of one coil are lowered."""


@dataclass(frozen=True, slots=True)
class TrimStep:
    """One taxel to lower: by `add_mg` of weight on its plate, or by beams filed thinner or narrower by the mm given."""

    id: str
    from_hz: float
    to_hz: float
    add_mg: float
    file_thickness_mm: float
    file_width_mm: float


@dataclass(frozen=True, slots=True)
class Trim:
    """The advice for one coil: its steps, and its selectivity in all states with re-tuned tones.

    `before_db` is without the steps, `after_db` with them, `needed_db` would be enough.
    """

    row: int
    column: int
    before_db: float
    after_db: float
    needed_db: float
    steps: tuple[TrimStep, ...]

    @property
    def reaches(self) -> bool:
        """True where the steps are enough, within rounding."""
        return self.after_db >= self.needed_db - 0.05


def needed_db(plan: Plan) -> float:
    """Return the dB that are enough for a coil: those asked for or, where the plan keeps less, 1 dB below the plan."""
    figures = plan.selectivity
    planned = figures.placed_all_states_db
    if planned is None or planned >= figures.asked_db:
        return figures.asked_db
    return planned - SHORT_OF_PLAN_DB


def trims(plan: Plan, tuning: Tuning, after: Sequence[CoilFigures]) -> tuple[Trim, ...]:
    """Return advice for every coil that keeps too little after re-tuning; `after` are the coils' figures then.

    Where no trim that was tried is enough, the advice is the one that helps most. A coil that no lowering helps gets
    none.
    """
    need = needed_db(plan)
    short = {(c.row, c.column): c for c in after if c.all_states_db is not None and c.all_states_db < need}
    if not short:
        return ()
    lowered: dict[tuple[int, int], np.ndarray] = {}
    hz = np.array([taxel.resonance_hz for taxel in tuning.taxels])
    for place, index in sorted(coils_of(plan).items()):
        if place in short and all(tuning.taxels[i].response_um_per_a2 > 0 for i in index):
            lowered[place] = _lowering(plan, tuning, index, short[place], need)
            hz[index] *= 1 - lowered[place]
    # Added weight leaves stiffness and response alone.
    taxels = (replace(taxel, resonance_hz=float(f)) for taxel, f in zip(tuning.taxels, hz, strict=True))
    trimmed = replace(tuning, taxels=tuple(taxels))
    figures = {(c.row, c.column): c for c in predicted(plan, trimmed, tones_at(plan, trimmed))}
    sensitivity = sensitivities(plan)
    found = []
    for place, share in lowered.items():
        index, db = coils_of(plan)[place], figures[place].all_states_db
        before = short[place].all_states_db
        if share.any() and db is not None and before is not None and db > before:
            steps = tuple(_step(plan, tuning, i, float(y), sensitivity) for i, y in zip(index, share, strict=True) if y)
            found.append(Trim(*place, before, db, need, steps))
    return tuple(found)


def _lowering(plan: Plan, tuning: Tuning, index: Sequence[int], figures: CoilFigures, need: float) -> np.ndarray:
    """Search the shares (n,) by which to lower the taxels of a coil, so that it keeps `need` dB."""
    known = [tuning.taxels[i] for i in index]
    hz, q, response = np.array([(t.resonance_hz, t.q, t.response_um_per_a2) for t in known]).T[..., None]
    mass = np.array([[plan.channels[plan.taxels[i].channel].effective_mass_g] for i in index])

    def energies(share: np.ndarray) -> np.ndarray:
        """Return OFF energies (n, columns) for resonances lowered by shares, with tones on the resonances."""
        lower = hz * (1 - share)
        line = levels_um(plan, lower.ravel()).reshape(lower.shape) / response
        return off_energy(Channels(lower, q, line), plan.scheme)

    # The other modes are assumed to cost as many dB after the trim as before.
    own_db = -10 * np.log10(energies(np.zeros(hz.shape)).max())
    cost = max(own_db - (figures.all_states_db or 0.0), 0.0) if np.isfinite(own_db) else 0.0
    limit = 10 ** (-(need + cost) / 10)

    def excess(share: np.ndarray) -> np.ndarray:
        """Return by how much the OFF energies exceed the limit, relative and summed over taxels (columns,)."""
        return np.asarray(np.maximum(energies(share) / limit - 1, 0.0).sum(0))

    steps = np.geomspace(min(1 / (8 * float(q.max())), LARGEST / 8), LARGEST, STEPS)
    share = np.zeros(len(hz))
    least = float(excess(share[:, None])[0])
    for _ in range(MOST_STEPS):
        # Each taxel in turn is lowered further, the others not.
        tried = np.repeat(share[:, None], len(hz) * STEPS, 1)
        for i in range(len(hz)):
            tried[i, i * STEPS : (i + 1) * STEPS] = np.maximum(share[i], steps)
        excesses = excess(tried)
        enough = tried[:, excesses == 0]
        if enough.shape[1]:
            return np.asarray(enough[:, (mass * ((1 - enough) ** -2 - 1)).sum(0).argmin()])
        best = int(excesses.argmin())
        if excesses[best] >= least:
            break
        share, least = tried[:, best], float(excesses[best])
    return share


def _step(plan: Plan, tuning: Tuning, index: int, share: float, sensitivity: np.ndarray) -> TrimStep:
    taxel, channel = tuning.taxels[index], plan.channels[plan.taxels[index].channel]
    width, thickness, _ = sensitivity[channel.index].tolist()
    sizes = (channel.beam.thickness_mm, thickness), (channel.beam.width_mm, width)
    filed = (size * (1 - (1 - share) ** (1 / s)) if s > 0 else inf for size, s in sizes)
    add_mg = channel.effective_mass_g * GRAM / MG * ((1 - share) ** -2 - 1)
    return TrimStep(taxel.id, taxel.resonance_hz, taxel.resonance_hz * (1 - share), add_mg, *filed)


LOW_Q = 0.8
"""Share of the plan's Q below which a taxel is worth a finding."""
SIGMAS = 4.0
"""Number of print spreads beyond which a resonance off its plan looks like another taxel's."""
COARSE = 0.25
"""Largest error of a resonance, as a share of half its bandwidth, that is not reported."""
MOST_NAMED = 4
ROUNDED_DB = 0.05
"""Largest difference of two figures in dB that print the same."""
LOWEST_TRIM = 0.85
"""Lowest ratio of trimmed to printed resonance that glue or a file can make: a weight of 0.38 times the moving mass."""


def judge_print(
    plan: Plan,
    tuning: Tuning,
    fits: Sequence[TaxelFit],
    after: Sequence[CoilFigures],
    loads: Sequence[CoilLoad],
    schemes_db: Sequence[tuple[str, float | None]],
    trimmed: Sequence[Trim],
) -> Iterator[Finding]:
    """Yield all findings about a measured and re-tuned print.

    `after` and `loads` are each coil's figures and load with the new tones, row by row; `schemes_db` is what every
    drive scheme would keep; `trimmed` is the trim advice.
    """
    lost = [taxel.id for taxel in tuning.taxels if taxel.response_um_per_a2 <= 0]
    if lost:
        told = "not moved by any current of the coil: the tables cannot drive it"
        yield Finding("error", "retune.pull", _named(lost), told)
    yield from _close(plan, tuning, after, schemes_db, trimmed)
    yield from _level(plan, after, loads)
    yield from _of_taxels(plan, tuning)
    yield from _of_fits(fits)
    yield from _unmeasured(plan, tuning)


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
    taxels = {taxel.id: taxel for taxel in tuning.taxels}
    for db, coil in short[:MOST_NAMED]:
        trim = by_coil.get((coil.row, coil.column))
        ways = [f"drive = {other!r} would keep enough"] if other else []
        ways += [_trim_text(trim)] if trim else []
        off, heard = taxels[coil.off], taxels[coil.heard]
        yield Finding(
            "warning",
            "retune.close",
            f"coil r{coil.row}c{coil.column}",
            f"re-tuned it keeps {db:.1f} dB in all states, needed: {need:.1f} dB; {off.id} at"
            f" {number(off.resonance_hz)} Hz is moved most by the tone of {heard.id} at"
            f" {number(heard.resonance_hz)} Hz, {abs(off.resonance_hz / heard.resonance_hz - 1):.1%} apart with a"
            f" bandwidth of {1 / off.q:.1%};"
            f" {'; or '.join(ways) or 'no trim that was tried helps'}",
        )
    if more := len(short[MOST_NAMED:]):
        yield Finding(
            "warning",
            "retune.close",
            "1 more coil" if more == 1 else f"{more} more coils",
            f"re-tuned {'it keeps' if more == 1 else 'they keep'} {short[MOST_NAMED][0]:.1f} dB or more,"
            f" needed: {need:.1f} dB; retune.json has the advice for each",
        )


def _trim_text(trim: Trim) -> str:
    """Return a clause that says how to mend a coil."""
    if any(step.to_hz < LOWEST_TRIM * step.from_hz for step in trim.steps):
        return "they are too close for any weight or file to part them; print that pad, or these taxels' cells, again"
    steps = " and ".join(
        f"lower {step.id} to {step.to_hz:.1f} Hz ({float(f'{step.add_mg:.2g}'):g} mg of weight, or beams filed"
        f" {float(f'{step.file_width_mm:.2g}'):g} mm narrower)"
        for step in trim.steps
    )
    reach = "keeps" if trim.reaches else "then keeps no more than"
    return f"{steps}: it {reach} {trim.after_db:.1f} dB; measure again after it"


def _level(plan: Plan, after: Sequence[CoilFigures], loads: Sequence[CoilLoad]) -> Iterator[Finding]:
    spec, level = plan.spec, plan.spec.drive.level_um
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
        f"{number(level)} µm with all channels on need {limits[load.reachable_by]}"
        + (f", {len(beyond)} coils in all need too much" if len(beyond) > 1 else "")
        + (f"; {do}" if do else ""),
    )


def _of_taxels(plan: Plan, tuning: Tuning) -> Iterator[Finding]:
    """Find taxels that came out unlike the plan, or that are not known well enough."""
    planned = {taxel.id: plan.channels[taxel.channel] for taxel in plan.taxels}
    measured = [taxel for taxel in tuning.taxels if taxel.measured]
    low = [taxel for taxel in measured if taxel.q < LOW_Q * planned[taxel.id].q]
    if low:
        worst = min(low, key=lambda taxel: taxel.q)
        yield Finding(
            "warning",
            "retune.q",
            _named([taxel.id for taxel in low]),
            f"Q is as low as {number(worst.q)} ({worst.id}), planned: {number(plan.channels[0].q)}; soft glue, a crack"
            f" at a root or a beam that touches the frame would explain it; a spec with q_min = {at_most(worst.q)}"
            " plans for it",
        )
    pairs = [pair for index in coils_of(plan).values() for pair in pairwise(tuning.taxels[i] for i in index)]
    swapped = [f"{one.id} above {other.id}" for one, other in pairs if one.resonance_hz > other.resonance_hz]
    if swapped:
        yield Finding(
            "note",
            "retune.order",
            _named(swapped),
            "the print has their resonances in another order than the plan; tones follow the taxels, but check that"
            " the measurement has not taken one for the other",
        )
    off = {taxel.id: abs(log(taxel.resonance_hz / planned[taxel.id].resonance_hz)) for taxel in measured}
    far = [taxel for taxel in measured if off[taxel.id] > SIGMAS * max(planned[taxel.id].print_spread, 0.02)]
    if far:
        worst = max(far, key=lambda taxel: off[taxel.id])
        yield Finding(
            "warning",
            "retune.far",
            _named([taxel.id for taxel in far]),
            f"{worst.id} is at {number(worst.resonance_hz)} Hz, planned: {number(planned[worst.id].resonance_hz)} Hz,"
            " farther than printing explains: another mode, another taxel or another unit may have been measured",
        )
    coarse = [t for t in measured if t.resonance_error_hz > COARSE * t.resonance_hz / (2 * t.q)]
    if coarse:
        worst = max(coarse, key=lambda t: t.resonance_error_hz * t.q / t.resonance_hz)
        yield Finding(
            "warning",
            "retune.uncertain",
            _named([t.id for t in coarse]),
            f"the resonance of {worst.id} is known to ± {number(worst.resonance_error_hz)} Hz, needed:"
            f" ± {number(COARSE * worst.resonance_hz / (2 * worst.q))} Hz, an eighth of its bandwidth; measure longer"
            " or with less noise",
        )


def _of_fits(fits: Sequence[TaxelFit]) -> Iterator[Finding]:
    split = [fit for fit in fits if not fit.agree]
    if split:
        told = ", ".join(f"{m.method} {number(m.resonance_hz)} Hz" for m in split[0].methods)
        yield Finding(
            "warning",
            "retune.fit",
            _named([fit.id for fit in split]),
            f"the methods differ by more than their errors ({split[0].id}: {told}): a second resonance, a nonlinear"
            " one, a disturbed record, or a voltage taken for a current (--excitation voltage); look at its data",
        )
    for sensor in ("velocity", "acceleration"):
        own = [fit.id for fit in fits if fit.sensor == sensor]
        if own:
            told = f"the data are taken to be of {sensor}, as stated or by their slope over frequency"
            yield Finding("note", "retune.sensor", _named(own), told)


def _unmeasured(plan: Plan, tuning: Tuning) -> Iterator[Finding]:
    missing = {taxel.id: taxel for taxel in tuning.taxels if not taxel.measured}
    if missing:
        planned = ((missing[t.id], plan.channels[t.channel]) for t in plan.taxels if t.id in missing)
        moved = any(taxel.resonance_hz != channel.resonance_hz for taxel, channel in planned)
        error = max(taxel.resonance_error_hz / taxel.resonance_hz for taxel in missing.values())
        what = "get the tones that the measured ones make likely" if moved else "keep the plan's tones"
        told = f"{len(missing)} of {len(tuning.taxels)} taxels were not measured and {what}, good to {error:.1%}"
        yield Finding("warning", "retune.unmeasured", _named(list(missing)), f"{told} (one sigma)")


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
