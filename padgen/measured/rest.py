"""What the taxels that were measured tell of those that were not.

Most of what a print gets wrong is common to it: the modulus of the spool, the height of the first layer, the model's
own error for each kind of taxel. With the spreads of `padgen.planner.printed_pads`, ln of printed over planned
resonance is a normal vector with a known covariance K, so that the rest follows from the measured ones as the
conditional mean, ``K_rm (K_mm + R)⁻¹ y``, with R the variances of the measurement, and is known to the conditional
variance (Rasmussen and Williams, *Gaussian Processes*, 2006, 2.23-2.24). A coupon printed beside the pad shares what is
common and has no place on the pad.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot

import numpy as np

from padgen.measured.fits import TaxelFit
from padgen.measured.tuning import TunedTaxel, Tuning, planned_response_um_per_a2
from padgen.planner.plan import Plan
from padgen.planner.printed_pads import covariance, design_of, spreads_of

__all__ = ["estimated"]

JITTER = 1e-12


def estimated(
    plan: Plan, tuning: Tuning, fits: Sequence[TaxelFit], coupon: Mapping[int, TaxelFit] | None = None
) -> Tuning:
    """`tuning` with the resonances of unmeasured taxels as `fits` and the `coupon` (fits by channel) make them likely.

    Their Q stays the plan's, their response follows with the plan's mass and pull.
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
        taxels[i] = _moved(plan, i, taxels[i], float(np.exp(shift)), float(sigma))
    return replace(tuning, taxels=tuple(taxels))


def _moved(plan: Plan, index: int, taxel: TunedTaxel, ratio: float, sigma: float) -> TunedTaxel:
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
    """Covariance of ln f of the pad's taxels and then of a coupon's channels (k,).

    The printer's biases and the model's own error are in it: the measured taxels tell them as well.
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
