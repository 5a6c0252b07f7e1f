"""Re-tuning of a plan to a measured print: new tones, currents and levels, their selectivity, advice, and the files.

Each tone moves to its taxel's measured resonance, and each current restores the level that the level law gives there.
Tones beside the resonances were tried and are not worth their current (`docs/measure_retune.py`): they gain hundredths
of a dB on most coils, and at most 1.3 dB on two taxels that came out too close.

`estimated` infers taxels that were not measured from the measured ones. Most errors are common to a print: the modulus
of the spool, the height of the first layer, the model's own error for each kind of taxel. With the spreads of
`padgen.planner.printed_pads`, the vector of ln (printed over planned resonance) is normal with a known covariance K.
The other taxels r then follow from the measured ones m (values y, variances R of the measurement) as the conditional
mean ``K_rm (K_mm + R)⁻¹ y`` with the conditional variance (Rasmussen and Williams, *Gaussian Processes*, 2006,
2.23-2.24). A coupon printed beside the pad shares the common errors, but has no place on the pad.

A trim lowers the resonances of named taxels where two came out too close for any tones. Only lowering is advised, since
weight is easily added and a beam easily thinned, but not the reverse. A weight dm on the plate lowers a resonance f to
f', ``dm = m ((f/f')² − 1)``, with the effective mass m. Filing a beam of size t by dt follows the sensitivity s of the
beam model, ``f'/f = (1 − dt/t)^s``. The search takes the lightest weight on one taxel that is enough for the coil.
Where no single weight is enough, taxels are lowered one after the other, each time by the change that helps most.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, replace
from itertools import pairwise
from math import hypot, inf, log
from pathlib import Path
from typing import Any

import numpy as np

from padgen.core.errors import LEVELS, FileError, Finding, at_most, number, plural
from padgen.core.files import OutputFolder, differs, is_unchanged, json_text, recover
from padgen.core.units import GRAM, MG
from padgen.measured.fits import TaxelFit, fit_measured, fitted, tuning_picture
from padgen.measured.read import read_measured, read_measured_text
from padgen.measured.tuning import (
    PULL_SPREAD,
    Q_SPREAD,
    CoilFigures,
    TunedTaxel,
    Tuning,
    levels_um,
    one_coil_spec,
    planned_response_um_per_a2,
    planned_tuning,
    played_tuning,
    predicted,
    printed_channels,
    refuse_tuning,
    spec_at_coil_temperature,
    tones_at,
    tuning_to_json,
    worst_db,
)
from padgen.physics.resonator import relative_energy
from padgen.physics.schemes import in_order
from padgen.physics.selectivity import Channels, Scheme, off_energy
from padgen.planner.drive_rows import COLUMNS, DriveRow, bias_row, coil_rows, table_csv
from padgen.planner.drive_scheme import coil_load
from padgen.planner.fixtures import coupon_plan
from padgen.planner.plan import CoilLoad, Plan, carrier_hz, plan_to_json, scheme_named
from padgen.planner.printed_pads import coils_of, covariance, design_of, sensitivities, spreads_of

__all__ = [
    "Retuned",
    "RetunedCoil",
    "RetunedFolder",
    "Trim",
    "TrimStep",
    "UnfittedError",
    "estimated",
    "judge_print",
    "measured_rows",
    "needed_db",
    "retuned",
    "retuned_with_coupon",
    "trims",
    "tuned_drive_csv",
    "tuned_rows",
    "tuning_of",
    "write_retuned",
]

DRAWS = 200
"""Number of random prints, within the errors of the measurement, on which the new tones are tried."""
LOW_QUANTILE = 0.05
JITTER = 1e-12
"""Variance of ln f that is added to the measurement's own, so that errors of 0 leave the equations solvable."""
MOST_WITH_SPURS = 64
"""Most channels for which spurs (n³ of them) are counted for a drive scheme that is not the plan's."""


@dataclass(frozen=True, slots=True)
class RetunedCoil:
    """One coil of a print: selectivity with planned and with new tones; current, voltage and heat with the new ones.

    `after_low_db` is the selectivity in all states that 95 of 100 prints exceed with the new tones, prints that differ
    from the measured one by the errors of the measurement; None for a coil of one channel.
    """

    before: CoilFigures
    after: CoilFigures
    after_low_db: float | None
    load: CoilLoad


@dataclass(frozen=True, slots=True)
class Retuned:
    """A measured print and the result of re-tuning to it: tones, selectivity before and after, advice, findings.

    Figures in dB are the selectivity of the worst coil in all states, None where no coil has two channels: as planned,
    as asked for, with the planned tones on the print (`before_db`), and with the new ones (`after_db`,
    `after_low_db`: see `RetunedCoil`). `schemes_db` has `after_db` for every drive scheme (None: not computed).
    `trims` is advice where tones do not suffice.
    """

    name: str
    drive: str
    asked_db: float
    planned_db: float | None
    before_db: float | None
    after_db: float | None
    after_low_db: float | None
    schemes_db: tuple[tuple[str, float | None], ...]
    tuning: Tuning
    coils: tuple[RetunedCoil, ...]
    trims: "tuple[Trim, ...]"
    findings: tuple[Finding, ...]


def tuning_of(plan: Plan, fits: Sequence[TaxelFit]) -> Tuning:
    """Return the print as `fits` measured it; other taxels stay as planned, with errors as large as prints spread."""
    by_id = {fit.id: fit for fit in fits}
    taxels = []
    for taxel, planned in zip(plan.taxels, planned_tuning(plan).taxels, strict=True):
        channel = plan.channels[taxel.channel]
        fit = by_id.get(taxel.id)
        if fit is None:
            taxels.append(
                replace(
                    planned,
                    resonance_error_hz=channel.print_spread * planned.resonance_hz,
                    q_error=Q_SPREAD * planned.q,
                    response_error=float(np.hypot(Q_SPREAD, PULL_SPREAD) * planned.response_um_per_a2),
                )
            )
            continue
        response = fit.response_um_per_a2
        error = fit.response_error
        if response is None:
            response = planned_response_um_per_a2(channel, fit.resonance_hz, fit.q)
            error = float(np.hypot(fit.q_error / fit.q, PULL_SPREAD)) * response
        taxels.append(
            TunedTaxel(
                fit.id,
                fit.resonance_hz,
                fit.resonance_error_hz,
                fit.q,
                fit.q_error,
                response,
                error or 0.0,
                True,
                fit.response_um_per_a2 is not None,
            )
        )
    return Tuning(plan.name, tuple(taxels))


def retuned(
    plan: Plan,
    fits: Sequence[TaxelFit],
    estimate_rest: bool = False,
    coupon: Mapping[int, TaxelFit] | None = None,
) -> Retuned:
    """Re-tune `plan` to the print that `fits` were measured on.

    Taxels that were not measured keep the plan's tones. With `estimate_rest` or a `coupon` printed beside the pad (fits
    by channel) they get tones at their most likely resonances (`estimated`).

    Raises
    ------
    FileError
        A figure of the print is outside its bounds (`refuse_tuning`).
    """
    tuning = tuning_of(plan, fits)
    if estimate_rest or coupon:
        tuning = estimated(plan, tuning, fits, coupon)
    refuse_tuning(tuning, plan, "what was measured")
    planned_um = levels_um(plan, np.array([plan.channels[t.channel].resonance_hz for t in plan.taxels]))
    before = predicted(plan, tuning, tones_at(plan, planned_tuning(plan)), planned_um)
    after = predicted(plan, tuning, tones_at(plan, tuning))
    channels = printed_channels(plan, tuning)
    grouped = sorted(coils_of(plan).items())
    loads = [coil_load(one_coil_spec(plan), [channels[i] for i in index], plan.scheme) for _, index in grouped]
    coils = tuple(map(RetunedCoil, before, after, _low_quantile_db(plan, tuning, after), loads))
    result = Retuned(
        name=plan.name,
        drive=plan.selectivity.drive,
        asked_db=plan.selectivity.asked_db,
        planned_db=plan.selectivity.placed_all_states_db,
        before_db=worst_db(before),
        after_db=worst_db(after),
        after_low_db=min((coil.after_low_db for coil in coils if coil.after_low_db is not None), default=None),
        schemes_db=tuple((name, _scheme_db(plan, tuning, name)) for name in in_order(plan.spec.force_order)),
        tuning=tuning,
        coils=coils,
        trims=trims(plan, tuning, after),
        findings=(),
    )
    findings = judge_print(plan, tuning, fits, after, loads, result.schemes_db, result.trims)
    return replace(result, findings=tuple(sorted(findings, key=lambda f: -LEVELS.index(f.level))))


def _scheme_db(plan: Plan, tuning: Tuning, name: str) -> float | None:
    many = name != plan.selectivity.drive and len(plan.sets[0]) > MOST_WITH_SPURS
    if many and scheme_named(plan.spec, name).has_pair_spurs:
        return None
    return worst_db(predicted(plan, tuning, tones_at(plan, tuning), scheme_name=name))


def _low_quantile_db(plan: Plan, tuning: Tuning, after: Sequence[CoilFigures]) -> list[float | None]:
    """Return, for each coil, the selectivity in dB that all but the worst share `LOW_QUANTILE` of random prints reach.

    The prints differ from the measured one by the errors of the measurement.
    """
    rng = np.random.default_rng(0)
    scheme = plan.scheme
    value = np.array([(t.resonance_hz, t.q, max(t.response_um_per_a2, 1e-300)) for t in tuning.taxels])
    error = np.array([(t.resonance_error_hz, t.q_error, t.response_error) for t in tuning.taxels]) / value
    # Errors are log-normal, so that nothing becomes negative; the first draw is the print as measured.
    z = rng.standard_normal((*value.shape, DRAWS)) * (np.arange(DRAWS) > 0)
    hz, q, response = np.moveaxis(value[..., None] * np.exp(np.clip(error[..., None] * z, -20, 20)), 1, 0)
    tones = tones_at(plan, tuning)
    wanted = levels_um(plan, tones.hz)
    result: list[float | None] = []
    for figures, (_, index) in zip(after, sorted(coils_of(plan).items()), strict=True):
        if figures.all_states_db is None or not (tones.line_a2[index] > 0).all():
            result.append(figures.all_states_db)
            continue
        truth = Channels(hz[index], q[index], wanted[index, None] / response[index])
        drive = Channels(tones.hz[index, None], q[index], tones.line_a2[index, None])
        off = off_energy(truth, scheme, drivers=drive).max(0)
        energy = relative_energy(tones.hz[index, None], hz[index], q[index])
        db = 10 * np.log10((energy * (drive.line / truth.line) ** 2).min(0) / off)
        # The draws count the taxels' working modes only. Their loss in dB is taken off the figure with all modes.
        result.append(figures.all_states_db - float(db[0] - np.quantile(db, LOW_QUANTILE)))
    return result


def estimated(
    plan: Plan, tuning: Tuning, fits: Sequence[TaxelFit], coupon: Mapping[int, TaxelFit] | None = None
) -> Tuning:
    """Return `tuning` with the most likely resonances of unmeasured taxels, given `fits` and the `coupon`.

    `coupon` has fits by channel. Unmeasured taxels keep the plan's Q; their response follows with the plan's mass and
    pull.
    """
    coupon = coupon or {}
    place = {taxel.id: i for i, taxel in enumerate(plan.taxels)}
    count = len(plan.taxels)
    known = [place[fit.id] for fit in fits] + list(range(count, count + len(coupon)))
    rest = sorted(set(range(count)) - set(known))
    if not rest or not known:
        return tuning
    channel_of = np.array([*(taxel.channel for taxel in plan.taxels), *coupon])
    planned = np.array([c.resonance_hz for c in plan.channels])[channel_of]
    known_hz, error_hz = np.array([(f.resonance_hz, f.resonance_error_hz) for f in (*fits, *coupon.values())]).T
    # The covariance of ln f of the pad's taxels, followed by the coupon's, includes the printer's biases and the
    # model's own error, since measured taxels reveal both.
    design = design_of(plan, None)
    spreads = spreads_of(plan.spec)
    bias = plan.spec.spread
    spreads = replace(
        spreads,
        modulus=hypot(spreads.modulus, bias.modulus_bias),
        common_z_mm=hypot(spreads.common_z_mm, bias.z_bias_mm),
    )
    model = np.array([c.model_error for c in plan.channels])[channel_of]
    spread_of_prints = covariance(design, spreads, channel_of[count:])
    spread_of_prints += np.where(channel_of[:, None] == channel_of, model[:, None] * model, 0.0)
    among = spread_of_prints[np.ix_(known, known)] + np.diag((error_hz / known_hz) ** 2 + JITTER)
    across = spread_of_prints[np.ix_(rest, known)]
    gain = np.linalg.solve(among, across.T).T
    mean = gain @ np.log(known_hz / planned[known])
    spread = np.sqrt(np.maximum(spread_of_prints[rest, rest] - (gain * across).sum(1), 0.0))
    taxels = list(tuning.taxels)
    for i, shift, sigma in zip(rest, mean, spread, strict=True):
        tuned_taxel = taxels[i]
        channel = plan.channels[plan.taxels[i].channel]
        hz = channel.resonance_hz * float(np.exp(shift))
        response = planned_response_um_per_a2(channel, hz)
        share = tuned_taxel.response_error / tuned_taxel.response_um_per_a2 if tuned_taxel.response_um_per_a2 else 0.0
        taxels[i] = replace(
            tuned_taxel,
            resonance_hz=hz,
            resonance_error_hz=hz * float(sigma),
            response_um_per_a2=response,
            response_error=float(np.hypot(share, 2 * sigma)) * response,
        )
    return replace(tuning, taxels=tuple(taxels))


# Trims


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
    """One resonance to lower, by adding `add_mg` mg to the taxel's plate or by filing its beams thinner or narrower."""

    id: str
    from_hz: float
    to_hz: float
    add_mg: float
    file_thickness_mm: float
    file_width_mm: float


@dataclass(frozen=True, slots=True)
class Trim:
    """Advice on which resonances of one coil to lower, with its selectivity in all states before and after that.

    `before_db` is without the steps, `after_db` with them, `needed_db` would be enough.
    """

    row: int
    column: int
    before_db: float
    after_db: float
    needed_db: float
    steps: tuple[TrimStep, ...]

    @property
    def is_sufficient(self) -> bool:
        """True where lowering the resonances gives the coil the selectivity that it needs, within 0.05 dB."""
        return self.after_db >= self.needed_db - 0.05


def needed_db(plan: Plan) -> float:
    """Return the selectivity in dB that a coil needs: the asked one or, where the plan misses it, the plan's − 1 dB."""
    figures = plan.selectivity
    planned = figures.placed_all_states_db
    if planned is None or planned >= figures.asked_db:
        return figures.asked_db
    return planned - SHORT_OF_PLAN_DB


def trims(plan: Plan, tuning: Tuning, after: Sequence[CoilFigures]) -> tuple[Trim, ...]:
    """Return advice on lowering resonances for coils whose selectivity after re-tuning (`after`) is below `needed_db`.

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
            lowered[place] = _lowered_shares(plan, tuning, index, short[place], need)
            hz[index] *= 1 - lowered[place]
    # Added weight leaves stiffness and response alone.
    taxels = (replace(taxel, resonance_hz=float(f)) for taxel, f in zip(tuning.taxels, hz, strict=True))
    trimmed = replace(tuning, taxels=tuple(taxels))
    figures = {(c.row, c.column): c for c in predicted(plan, trimmed, tones_at(plan, trimmed))}
    sensitivity = sensitivities(plan)
    trim_rows = []
    for place, share in lowered.items():
        index = coils_of(plan)[place]
        db = figures[place].all_states_db
        before = short[place].all_states_db
        if share.any() and db is not None and before is not None and db > before:
            steps = tuple(_step(plan, tuning, i, float(y), sensitivity) for i, y in zip(index, share, strict=True) if y)
            trim_rows.append(Trim(*place, before, db, need, steps))
    return tuple(trim_rows)


def _lowered_shares(plan: Plan, tuning: Tuning, index: Sequence[int], figures: CoilFigures, need: float) -> np.ndarray:
    """Return the relative drops (n,) of a coil's resonances that give it `need` dB of selectivity, or come closest."""
    known = (tuning.taxels[i] for i in index)
    hz, q, response = np.array([(t.resonance_hz, t.q, t.response_um_per_a2) for t in known]).T[..., None]
    mass = np.array([[plan.channels[plan.taxels[i].channel].effective_mass_g] for i in index])

    def energies(share: np.ndarray) -> np.ndarray:
        """Return each taxel's largest OFF/ON energy ratio (n, columns) if resonances and tones drop by `share`."""
        lower = hz * (1 - share)
        line = levels_um(plan, lower.ravel()).reshape(lower.shape) / response
        return off_energy(Channels(lower, q, line), plan.scheme)

    # The other modes are assumed to cost as many dB after the trim as before.
    own_db = -10 * np.log10(energies(np.zeros(hz.shape)).max())
    cost = max(own_db - (figures.all_states_db or 0.0), 0.0) if np.isfinite(own_db) else 0.0
    limit = 10 ** (-(need + cost) / 10)

    def excess(share: np.ndarray) -> np.ndarray:
        """Return, per column of `share`, the sum over taxels of OFF energy beyond the limit, relative to the limit."""
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
        share = tried[:, best]
        least = float(excesses[best])
    return share


def _step(plan: Plan, tuning: Tuning, index: int, share: float, sensitivity: np.ndarray) -> TrimStep:
    taxel = tuning.taxels[index]
    channel = plan.channels[plan.taxels[index].channel]
    width, thickness, *_ = sensitivity[channel.index].tolist()
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
    if lost := [taxel.id for taxel in tuning.taxels if taxel.response_um_per_a2 <= 0]:
        sentence = "not moved by any current of the coil: the tables cannot drive it"
        yield Finding("error", "retune.pull", _named(lost), sentence)
    yield from _close_resonances(plan, tuning, after, schemes_db, trimmed)
    yield from _level(plan, after, loads)
    yield from _of_taxels(plan, tuning)
    yield from _of_fits(fits)
    yield from _unmeasured(plan, tuning)


def _close_resonances(
    plan: Plan,
    tuning: Tuning,
    after: Sequence[CoilFigures],
    schemes_db: Sequence[tuple[str, float | None]],
    trimmed: Sequence[Trim],
) -> Iterator[Finding]:
    need = needed_db(plan)
    by_coil = {(trim.row, trim.column): trim for trim in trimmed}
    needed = f"{need:.1f} dB" + (", the plan's less 1 dB" if need < plan.selectivity.asked_db else "")
    others = [name for name, db in schemes_db if db is not None and db >= need and name != plan.selectivity.drive]
    other = min(others, key=lambda name: Scheme(name).takes_turns, default=None)
    short = [(c.all_states_db, c) for c in after if c.all_states_db is not None and c.all_states_db < need - ROUNDED_DB]
    short.sort(key=lambda entry: entry[0])
    taxels = {taxel.id: taxel for taxel in tuning.taxels}
    for db, coil in short[:MOST_NAMED]:
        trim = by_coil.get((coil.row, coil.column))
        ways = [f"drive = {other!r} would keep enough"] if other else []
        ways += [_trim_text(trim)] if trim else []
        off = taxels[coil.off]
        heard = taxels[coil.heard]
        yield Finding(
            "warning",
            "retune.close",
            f"coil r{coil.row}c{coil.column}",
            f"re-tuned it keeps {db:.1f} dB of ON over OFF in its worst state (asked: {needed}); {off.id} at"
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
            f"re-tuned {'it keeps' if more == 1 else 'they keep'} {short[MOST_NAMED][0]:.1f} dB of ON over OFF or more"
            f" (asked: {needed}); retune.json has the advice for each",
        )


def _trim_text(trim: Trim) -> str:
    """Return a clause that says which resonances of a coil to lower, by what weight or filing, and what that gives."""
    if any(step.to_hz < LOWEST_TRIM * step.from_hz for step in trim.steps):
        return f"to part them enough one would have to be lowered by more than {1 - LOWEST_TRIM:.0%}: print them again"
    steps = " and ".join(
        f"lower {step.id} to {step.to_hz:.1f} Hz ({float(f'{step.add_mg:.2g}'):g} mg of weight, or beams filed"
        f" {float(f'{step.file_width_mm:.2g}'):g} mm narrower)"
        for step in trim.steps
    )
    reach = "keeps" if trim.is_sufficient else "then keeps no more than"
    return f"{steps}: it {reach} {trim.after_db:.1f} dB; measure again after it"


def _level(plan: Plan, after: Sequence[CoilFigures], loads: Sequence[CoilLoad]) -> Iterator[Finding]:
    spec = plan.spec
    level = plan.spec.drive.level_um
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
    """Yield findings on taxels with low Q, swapped order, resonance far off the plan's, or large measuring errors."""
    planned = {taxel.id: plan.channels[taxel.channel] for taxel in plan.taxels}
    measured = [taxel for taxel in tuning.taxels if taxel.measured]
    if low := [taxel for taxel in measured if taxel.q < LOW_Q * planned[taxel.id].q]:
        worst = min(low, key=lambda taxel: taxel.q)
        of_worst = f" ({worst.id})" if len(low) > 1 else ""
        yield Finding(
            "warning",
            "retune.q",
            _named([taxel.id for taxel in low]),
            f"Q is as low as {number(worst.q)}{of_worst}, planned: {number(plan.channels[0].q)}; soft glue, a crack"
            f" at a root or a beam that touches the frame would explain it; a spec with q_min = {at_most(worst.q)}"
            " plans for it",
        )
    pairs = [pair for index in coils_of(plan).values() for pair in pairwise(tuning.taxels[i] for i in index)]
    if swapped := [f"{one.id} above {other.id}" for one, other in pairs if one.resonance_hz > other.resonance_hz]:
        yield Finding(
            "note",
            "retune.order",
            _named(swapped),
            "the print has their resonances in another order than the plan; tones follow the taxels, but check that"
            " the measurement has not taken one for the other",
        )
    off = {taxel.id: abs(log(taxel.resonance_hz / planned[taxel.id].resonance_hz)) for taxel in measured}
    if far := [taxel for taxel in measured if off[taxel.id] > SIGMAS * max(planned[taxel.id].print_spread, 0.02)]:
        worst = max(far, key=lambda taxel: off[taxel.id])
        yield Finding(
            "warning",
            "retune.far",
            _named([taxel.id for taxel in far]),
            f"{worst.id} is at {number(worst.resonance_hz)} Hz, planned: {number(planned[worst.id].resonance_hz)} Hz,"
            " farther than printing explains: another mode, another taxel or another unit may have been measured",
        )
    if coarse := [t for t in measured if t.resonance_error_hz > COARSE * t.resonance_hz / (2 * t.q)]:
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
    if split := [fit for fit in fits if not fit.agree]:
        wording = ", ".join(f"{m.method} {number(m.resonance_hz)} Hz" for m in split[0].methods)
        yield Finding(
            "warning",
            "retune.fit",
            _named([fit.id for fit in split]),
            f"the methods differ by more than their errors ({split[0].id}: {wording}): a second resonance, a nonlinear"
            " one, a disturbed record, or a voltage taken for a current (--excitation voltage); look at its data",
        )
    if assumed := [fit.id for fit in fits if fit.order_assumed]:
        yield Finding(
            "note",
            "retune.assumed",
            _named(assumed),
            "the peaks of a coil's recording are given to its taxels in their planned order; pluck one of them and add"
            f" its file ({assumed[0]}.wav), which settles that",
        )
    for sensor in ("velocity", "acceleration"):
        if fitted := [fit.id for fit in fits if fit.sensor == sensor]:
            wording = f"the data are taken to be of {sensor}, as stated or by their slope over frequency"
            yield Finding("note", "retune.sensor", _named(fitted), wording)


def _unmeasured(plan: Plan, tuning: Tuning) -> Iterator[Finding]:
    pairs = zip(tuning.taxels, plan.taxels, strict=True)
    if missing := [(taxel, plan.channels[taxel_plan.channel]) for taxel, taxel_plan in pairs if not taxel.measured]:
        moved = any(taxel.resonance_hz != channel.resonance_hz for taxel, channel in missing)
        error = max(taxel.resonance_error_hz / taxel.resonance_hz for taxel, _ in missing)
        one = len(missing) == 1
        keep = f"keep{'s its' if one else ' their'} planned tone{plural(len(missing))}"
        likely = f"get{'s the tone' if one else ' tones'} that the measured ones make likely"
        cure = "measure the rest" if moved else "measure the rest, or add --estimate-rest"
        yield Finding(
            "warning",
            "retune.unmeasured",
            _named([taxel.id for taxel, _ in missing]),
            f"{len(missing)} of {len(tuning.taxels)} taxels {'was' if one else 'were'} not measured and"
            f" {likely if moved else keep}, off the resonance by up to {error:.1%} (one sigma); {cure}",
        )


def _named(names: Sequence[str]) -> str:
    return ", ".join(names[:MOST_NAMED]) + (f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")


# Files


MEASURED = "measured.csv"
PRINTED = "printed.json"
PICTURE = "tuning.png"
Progress = Callable[[str], None]


class UnfittedError(FileError):
    """Error that a taxel's data do not show one resonance; a picture of the data is in the folder."""


@dataclass(frozen=True, slots=True)
class RetunedFolder:
    """A written folder: its files and the re-tuned print."""

    folder: Path
    files: tuple[str, ...]
    result: Retuned

    def table(self) -> dict[str, Any]:
        """Return folder, files and the re-tuned print as plain data."""
        return {"folder": str(self.folder), "files": list(self.files), **asdict(self.result)}


def write_retuned(
    plan: Plan,
    folder: Path,
    measured: Sequence[str],
    simulated: tuple[Tuning, str] | None = None,
    excitation: str = "current",
    sensor: str | None = None,
    nearest: bool = False,
    estimate_rest: bool = False,
    coupon: str | None = None,
    progress: Progress = lambda step: None,
) -> RetunedFolder:
    """Re-tune `plan` to the files or the folder `measured`, or to a `simulated` print; write the results to `folder`.

    A simulated print comes with its measurement as CSV. `excitation`, `sensor` and `nearest` are those of
    `read_measured` and `fit_measured`. With `estimate_rest`, or with the file of a measured `coupon`, unmeasured taxels
    get tones at their most likely resonances.

    Raises
    ------
    FileError, SpecError, SolverError
        The measurement cannot be read, or shows no resonance; nothing is written, but in the latter case a picture.
    """
    progress("fitting resonances")
    if simulated is not None:
        recover(folder)
        if differs(folder, MEASURED, simulated[1]) and not is_unchanged(folder, MEASURED):
            raise FileError(
                "is not of a simulated print, and --simulate would take its place; name another folder with -o",
                str(folder / MEASURED),
            )
        recordings = read_measured_text(simulated[1], plan)
    else:
        recordings = read_measured([Path(each) for each in measured], plan, excitation, sensor)
    fits, curves, refused = fitted(recordings, plan, nearest)
    drawn = {PICTURE: tuning_picture(curves)} if curves else {}
    if refused is not None:
        with OutputFolder(folder) as out:
            out.write(PICTURE, drawn[PICTURE])
            out.commit()
        raise UnfittedError(f"{refused.message}; its data are drawn in {folder / PICTURE}", refused.where)
    progress("re-tuning")
    result = retuned_with_coupon(plan, fits, nearest, estimate_rest, coupon)
    table = {**asdict(result), "taxels": measured_rows(plan, result.tuning), "fits": fits}
    del table["tuning"]  # has a file of its own
    files: dict[str, str | bytes] = {
        "plan.json": plan_to_json(plan),
        "tuning.json": tuning_to_json(result.tuning),
        "drive-tuned.csv": tuned_drive_csv(plan, result.tuning),
        "retune.json": json_text(table),
    }
    if simulated is not None:
        files |= {MEASURED: simulated[1], PRINTED: tuning_to_json(simulated[0])}
    files |= drawn
    with OutputFolder(folder) as out:
        for name, text in files.items():
            out.write(name, text)
        out.commit()
    return RetunedFolder(folder, tuple(files), result)


def retuned_with_coupon(
    plan: Plan, fits: Sequence[TaxelFit], nearest: bool, estimate_rest: bool, coupon: str | Path | None
) -> Retuned:
    """Re-tune `plan` to the print of `fits` as `retuned` does, with the file of its measured `coupon` if not None.

    `nearest` is that of `fit_measured`.

    Raises
    ------
    FileError
        The coupon's file cannot be read, or shows no resonance; or as in `retuned`.
    """
    if coupon is None:
        return retuned(plan, fits, estimate_rest)
    strip = coupon_plan(plan)
    channel = {taxel.id: taxel.channel for taxel in strip.taxels}
    of_coupon = fit_measured(read_measured(Path(coupon), strip), strip, nearest)
    return retuned(plan, fits, True, {channel[fit.id]: fit for fit in of_coupon})


def tuned_rows(plan: Plan, tuning: Tuning) -> tuple[tuple[str, DriveRow], ...]:
    """Return the drive table: the name and the row of each taxel in the plan's order.

    Where currents have a constant, the coils with theirs follow.
    """
    tuning = played_tuning(plan, tuning)
    spec = spec_at_coil_temperature(plan, tuning.coil_c)
    channels = printed_channels(plan, tuning)
    scheme = plan.scheme
    carrier = carrier_hz(spec, scheme, max(taxel.resonance_hz for taxel in tuning.taxels))
    rows: dict[int, DriveRow] = {}
    constant = []
    for (row, column), index in sorted(coils_of(plan).items()):
        channel_set = [channels[i] for i in index]
        rows |= zip(index, coil_rows(spec, scheme, channel_set, carrier), strict=True)
        if scheme.has_constant and carrier is None:
            constant.append((f"r{row}c{column}", bias_row(spec, scheme, channel_set)))
    return (*((taxel.id, rows[i]) for i, taxel in enumerate(plan.taxels)), *constant)


def tuned_drive_csv(plan: Plan, tuning: Tuning) -> str:
    """Return the drive table as CSV, with the columns of `drive.csv` after each taxel's name."""
    return table_csv(("taxel", *COLUMNS), ((name, *astuple(row)) for name, row in tuned_rows(plan, tuning)))


def measured_rows(plan: Plan, tuning: Tuning) -> list[dict[str, Any]]:
    """Return a row per taxel in the plan's order: the print's figures as `TunedTaxel` has them, and its tone.

    `planned_hz` is the planned resonance, `line_a2` the line of i², `level_um` the ON amplitude.
    """
    channels = printed_channels(plan, tuning)
    rows = tuned_rows(plan, tuning)
    return [
        {
            "taxel": taxel.id,
            "row": taxel.coil[0],
            "column": taxel.coil[1],
            "channel": taxel.channel,
            "planned_hz": plan.channels[taxel.channel].resonance_hz,
            **{name: value for name, value in asdict(tuned).items() if name != "id"},
            "drive_hz": row.drive_hz,
            "line_a2": channel.line_a2,
            "current_ma_peak": row.current_ma_peak,
            "voltage_v_peak": row.voltage_v_peak,
            "level_um": channel.level_um,
        }
        for taxel, tuned, (_, row), channel in zip(plan.taxels, tuning.taxels, rows, channels, strict=False)
    ]
