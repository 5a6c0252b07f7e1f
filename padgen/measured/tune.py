"""Re-tuning of a plan to a measured print: new tones, currents and levels, and the selectivity that they will reach.

Each tone moves to its taxel's measured resonance, and each current restores the level that the level law gives there.
Tones beside the resonances were tried and are not worth their current (`docs/measure_retune.py`): they gain hundredths
of a dB on most coils, and at most 1.3 dB on two taxels that came out too close.

`estimated` infers taxels that were not measured from the measured ones. Most errors are common to a print: the modulus
of the spool, the height of the first layer, the model's own error for each kind of taxel. With the spreads of
`padgen.planner.printed_pads`, the vector of ln (printed over planned resonance) is normal with a known covariance K.
The other taxels r then follow from the measured ones m (values y, variances R of the measurement) as the conditional
mean ``K_rm (K_mm + R)⁻¹ y`` with the conditional variance (Rasmussen and Williams, *Gaussian Processes*, 2006,
2.23-2.24). A coupon printed beside the pad shares the common errors, but has no place on the pad."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from padgen.core.errors import LEVELS, Finding
from padgen.measured.advice import Trim, judge_print, trims
from padgen.measured.fits import TaxelFit
from padgen.measured.predict import (
    CoilFigures,
    levels_um,
    one_coil_spec,
    planned_tones,
    predicted,
    printed_channels,
    tones_at,
    worst_db,
)
from padgen.measured.simulate import PULL_SPREAD, Q_SPREAD
from padgen.measured.tuning import TunedTaxel, Tuning, planned_response_um_per_a2, planned_tuning, refuse_tuning
from padgen.physics.resonator import relative_energy
from padgen.physics.schemes import in_order
from padgen.physics.selectivity import Channels, off_energy
from padgen.planner.drive_scheme import coil_load
from padgen.planner.plan import CoilLoad, Plan, scheme_named
from padgen.planner.printed_pads import coils_of, covariance, design_of, spreads_of

__all__ = ["Retuned", "RetunedCoil", "estimated", "retuned", "tuning_of"]

DRAWS = 200
"""Number of random prints, within the errors of the measurement, on which the new tones are tried."""
LOW_QUANTILE = 0.05
MOST_WITH_SPURS = 64
"""Most channels for which spurs (n³ of them) are counted for a drive scheme that is not the plan's."""


@dataclass(frozen=True, slots=True)
class RetunedCoil:
    """One coil of the print: its selectivity with the planned tones and with the new ones, and the new tones' load.

    `after_low_db` is the selectivity in all states that 95 of 100 prints exceed with the new tones, prints that differ
    from the measured one by the errors of the measurement; None for a coil of one channel.
    """

    before: CoilFigures
    after: CoilFigures
    after_low_db: float | None
    load: CoilLoad


@dataclass(frozen=True, slots=True)
class Retuned:
    """A print and the tones that suit it.

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
    trims: tuple[Trim, ...]
    findings: tuple[Finding, ...]


def tuning_of(plan: Plan, fits: Sequence[TaxelFit]) -> Tuning:
    """Return the print that `fits` were measured on; other taxels stay as planned, with errors of the print spread."""
    by_id = {fit.id: fit for fit in fits}
    taxels = []
    for taxel, planned in zip(plan.taxels, planned_tuning(plan).taxels, strict=True):
        channel, fit = plan.channels[taxel.channel], by_id.get(taxel.id)
        if fit is None:
            spread = np.hypot(Q_SPREAD, PULL_SPREAD) * planned.response_um_per_a2
            taxels.append(
                replace(
                    planned,
                    resonance_error_hz=channel.print_spread * planned.resonance_hz,
                    q_error=Q_SPREAD * planned.q,
                    response_error=float(spread),
                )
            )
            continue
        response, error = fit.response_um_per_a2, fit.response_error
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
    tones = tones_at(plan, tuning)
    before = predicted(plan, tuning, planned_tones(plan), planned_um)
    after = predicted(plan, tuning, tones)
    coils = tuple(
        RetunedCoil(*figures)
        for figures in zip(before, after, _low_db(plan, tuning, after), _loads(plan, tuning), strict=True)
    )
    lows = [coil.after_low_db for coil in coils if coil.after_low_db is not None]
    result = Retuned(
        name=plan.name,
        drive=plan.selectivity.drive,
        asked_db=plan.selectivity.asked_db,
        planned_db=plan.selectivity.placed_all_states_db,
        before_db=worst_db(before),
        after_db=worst_db(after),
        after_low_db=min(lows, default=None),
        schemes_db=tuple((name, _scheme_db(plan, tuning, name)) for name in in_order()),
        tuning=tuning,
        coils=coils,
        trims=trims(plan, tuning, after),
        findings=(),
    )
    found = judge_print(plan, tuning, fits, after, [c.load for c in coils], result.schemes_db, result.trims)
    return replace(result, findings=tuple(sorted(found, key=lambda f: -LEVELS.index(f.level))))


def _scheme_db(plan: Plan, tuning: Tuning, name: str) -> float | None:
    cubic = scheme_named(plan.spec, name).has_pair_spurs and name != plan.selectivity.drive
    if cubic and len(plan.sets[0]) > MOST_WITH_SPURS:
        return None
    return worst_db(predicted(plan, tuning, tones_at(plan, tuning), scheme_name=name))


def _loads(plan: Plan, tuning: Tuning) -> tuple[CoilLoad, ...]:
    spec, channels = one_coil_spec(plan), printed_channels(plan, tuning)
    return tuple(
        coil_load(spec, [channels[i] for i in index], plan.scheme) for _, index in sorted(coils_of(plan).items())
    )


def _low_db(plan: Plan, tuning: Tuning, after: Sequence[CoilFigures]) -> list[float | None]:
    """Return for each coil the selectivity in dB that all but `LOW_QUANTILE` of the random prints keep.

    The prints differ from the measured one by the errors of the measurement.
    """
    rng, scheme = np.random.default_rng(0), plan.scheme
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
        own = relative_energy(tones.hz[index, None], hz[index], q[index])
        on = (own * (tones.line_a2[index, None] / truth.line) ** 2).min(0)
        db = 10 * np.log10(on / off)
        # The draws count the taxels' working modes only. Their loss in dB is taken off the figure with all modes.
        result.append(figures.all_states_db - float(db[0] - np.quantile(db, LOW_QUANTILE)))
    return result


JITTER = 1e-12


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
    channel = [taxel.channel for taxel in plan.taxels] + list(coupon)
    planned = np.array([plan.channels[c].resonance_hz for c in channel])
    measured = [*fits, *coupon.values()]
    hz = np.array([fit.resonance_hz for fit in measured])
    noise = np.array([fit.resonance_error_hz for fit in measured]) / hz
    spread_of_prints = _covariance(plan, np.array(list(coupon), int))
    among = spread_of_prints[np.ix_(known, known)] + np.diag(noise**2 + JITTER)
    across = spread_of_prints[np.ix_(rest, known)]
    gain = np.linalg.solve(among, across.T).T
    mean = gain @ np.log(hz / planned[known])
    spread = np.sqrt(np.maximum(spread_of_prints[rest, rest] - (gain * across).sum(1), 0.0))
    taxels = list(tuning.taxels)
    for i, shift, sigma in zip(rest, mean, spread, strict=True):
        taxels[i] = _at_ratio(plan, i, taxels[i], float(np.exp(shift)), float(sigma))
    return replace(tuning, taxels=tuple(taxels))


def _at_ratio(plan: Plan, index: int, taxel: TunedTaxel, ratio: float, sigma: float) -> TunedTaxel:
    channel = plan.channels[plan.taxels[index].channel]
    hz = channel.resonance_hz * ratio
    response = planned_response_um_per_a2(channel, hz)
    share = taxel.response_error / taxel.response_um_per_a2 if taxel.response_um_per_a2 else 0.0
    return replace(
        taxel,
        resonance_hz=hz,
        resonance_error_hz=hz * sigma,
        response_um_per_a2=response,
        response_error=float(np.hypot(share, 2 * sigma)) * response,
    )


def _covariance(plan: Plan, coupon: np.ndarray) -> np.ndarray:
    """Return the covariance of ln f of the pad's taxels, followed by a coupon's channels (k,).

    It includes the printer's biases and the model's own error, since measured taxels reveal both.
    """
    design, spreads, bias = design_of(plan, None), spreads_of(plan.spec), plan.spec.spread
    spreads = replace(
        spreads,
        modulus=hypot(spreads.modulus, bias.modulus_bias),
        common_z_mm=hypot(spreads.common_z_mm, bias.z_bias_mm),
    )
    channel = np.concatenate([design.channel, coupon])
    model = np.array([c.model_error for c in plan.channels])[channel]
    return covariance(design, spreads, coupon) + np.where(channel[:, None] == channel, model[:, None] * model, 0.0)
