"""Trim advice and findings for a re-tuned print: what tones cannot mend, what coils cannot give, what looks odd.

A trim lowers the resonances of named taxels where two came out too close for any tones. Only lowering is advised, since
weight is easily added and a beam easily thinned, but not the reverse. A weight dm on the plate lowers a resonance f to
f', ``dm = m ((f/f')² − 1)``, with the effective mass m. Filing a beam of size t by dt follows the sensitivity s of the
beam model, ``f'/f = (1 − dt/t)^s``. The search takes the lightest weight on one taxel that is enough for the coil.
Where no single weight is enough, taxels are lowered one after the other, each time by the change that helps most."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import log
from typing import NamedTuple

import numpy as np

from padgen.core.errors import at_most, number
from padgen.core.finding import Finding
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
    "trim_text",
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


class _Coil(NamedTuple):
    """Taxels (n,) of one coil, and the limit that their OFF energies must stay below."""

    plan: Plan
    hz: np.ndarray
    q: np.ndarray
    response: np.ndarray
    mass_mg: np.ndarray
    scheme: Scheme
    limit: float


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
            share = _lowering(_coil(plan, tuning, index, short[place], need))
            hz[index] *= 1 - share
            lowered[place] = share
    trimmed = _with_resonances(tuning, hz)
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


def _with_resonances(tuning: Tuning, hz: np.ndarray) -> Tuning:
    """Return the print with resonances lowered to `hz` by added weight, which leaves stiffness and response alone."""
    taxels = (replace(t, resonance_hz=float(f)) for t, f in zip(tuning.taxels, hz, strict=True))
    return replace(tuning, taxels=tuple(taxels))


def _coil(plan: Plan, tuning: Tuning, index: Sequence[int], figures: CoilFigures, need: float) -> _Coil:
    taxels = [tuning.taxels[i] for i in index]
    mass = [plan.channels[plan.taxels[i].channel].effective_mass_g * GRAM / MG for i in index]
    bare = _Coil(
        plan,
        np.array([t.resonance_hz for t in taxels]),
        np.array([t.q for t in taxels]),
        np.array([t.response_um_per_a2 for t in taxels]),
        np.array(mass),
        plan.scheme,
        1.0,
    )
    # The other modes are assumed to cost as many dB after the trim as before.
    own_db = -10 * np.log10(_energies(bare, np.zeros((len(index), 1))).max())
    cost = max(own_db - (figures.all_states_db or 0.0), 0.0) if np.isfinite(own_db) else 0.0
    return bare._replace(limit=10 ** (-(need + cost) / 10))


def _energies(coil: _Coil, share: np.ndarray) -> np.ndarray:
    """Return OFF energies (n, columns) for resonances lowered by shares (n, columns), with tones on the resonances."""
    hz = coil.hz[:, None] * (1 - share)
    line = levels_um(coil.plan, hz.ravel()).reshape(hz.shape) / coil.response[:, None]
    which = Channels(hz, coil.q[:, None], line)
    return off_energy(which, coil.scheme)


def _lowering(coil: _Coil) -> np.ndarray:
    """Search the shares (n,) by which to lower the taxels of a coil."""
    share = np.zeros(len(coil.hz))
    excess = float(_excess(coil, share[:, None])[0])
    for _ in range(MOST_STEPS):
        tried = _each_lowered(coil, share)
        excesses = _excess(coil, tried)
        enough = tried[:, excesses == 0]
        if enough.shape[1]:
            return np.asarray(enough[:, _weight_mg(coil, enough).argmin()])
        best = int(excesses.argmin())
        if excesses[best] >= excess:
            break
        share, excess = tried[:, best], float(excesses[best])
    return share


def _excess(coil: _Coil, share: np.ndarray) -> np.ndarray:
    """Return by how much the OFF energies exceed the limit, relative and summed over taxels (columns,)."""
    excess: np.ndarray = np.maximum(_energies(coil, share) / coil.limit - 1, 0.0).sum(0)
    return excess


def _weight_mg(coil: _Coil, share: np.ndarray) -> np.ndarray:
    weight: np.ndarray = (coil.mass_mg[:, None] * ((1 - share) ** -2 - 1)).sum(0)
    return weight


def _each_lowered(coil: _Coil, base: np.ndarray) -> np.ndarray:
    """Return shares (n, columns) in which each taxel in turn is lowered further than in `base`, the others not."""
    least = min(1 / (8 * float(coil.q.max())), LARGEST / 8)
    steps = np.geomspace(least, LARGEST, STEPS)
    tried = np.repeat(base[:, None], len(base) * STEPS, 1)
    for i in range(len(base)):
        tried[i, i * STEPS : (i + 1) * STEPS] = np.maximum(base[i], steps)
    return tried


def _step(plan: Plan, tuning: Tuning, index: int, share: float, sensitivity: np.ndarray) -> TrimStep:
    taxel = tuning.taxels[index]
    channel = plan.channels[plan.taxels[index].channel]
    width, thickness, _ = sensitivity[channel.index]
    mass_mg = channel.effective_mass_g * GRAM / MG
    return TrimStep(
        taxel.id,
        taxel.resonance_hz,
        taxel.resonance_hz * (1 - share),
        mass_mg * ((1 - share) ** -2 - 1),
        _filed_mm(channel.beam.thickness_mm, share, float(thickness)),
        _filed_mm(channel.beam.width_mm, share, float(width)),
    )


def _filed_mm(size_mm: float, share: float, sensitivity: float) -> float:
    return size_mm * (1 - (1 - share) ** (1 / sensitivity)) if sensitivity > 0 else float("inf")


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
    yield from _unpulled(tuning)
    yield from _close(plan, tuning, after, schemes_db, trimmed)
    yield from _level(plan, after, loads)
    yield from _low_q(plan, tuning)
    yield from _order(plan, tuning)
    yield from _far(plan, tuning)
    yield from _coarse(tuning)
    yield from _disagree(fits)
    for sensor in ("velocity", "acceleration"):
        own = [fit.id for fit in fits if fit.sensor == sensor]
        if own:
            told = f"the data are taken to be of {sensor}, as stated or by their slope over frequency"
            yield Finding("note", "retune.sensor", _named(own), told)
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
        f"{off.id} at {number(off.resonance_hz)} Hz is moved most by the tone of {heard.id} at"
        f" {number(heard.resonance_hz)} Hz, {abs(off.resonance_hz / heard.resonance_hz - 1):.1%} apart with a"
        f" bandwidth of {1 / off.q:.1%}"
    )


def trim_text(trim: Trim) -> str:
    """Return a clause that says how to mend a coil."""
    if any(step.to_hz < LOWEST_TRIM * step.from_hz for step in trim.steps):
        return "they are too close for any weight or file to part them; print that pad, or these taxels' cells, again"
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
        f"{number(level)} µm with all channels on need {limits[load.reachable_by]}"
        + (f", {len(beyond)} coils in all need too much" if len(beyond) > 1 else "")
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
            " plans for it",
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
            f"the resonance of {worst.id} is known to ± {number(worst.resonance_error_hz)} Hz, needed:"
            f" ± {number(COARSE * worst.resonance_hz / (2 * worst.q))} Hz, an eighth of its bandwidth; measure longer"
            " or with less noise",
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
