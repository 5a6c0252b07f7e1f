"""What the taxels that were measured tell of those that were not.

Most of what a print gets wrong is common to it: the modulus of the spool, the height of the first layer, the model's
own error for each kind of taxel. With the spreads of `padgen.planner.printed_pads`, ln of printed over planned
resonance is a normal vector with a known covariance K, so that the rest follows from the measured ones as the
conditional mean, ``K_rm (K_mm + R)⁻¹ y``, with R the variances of the measurement, and is known to the conditional
variance (Rasmussen and Williams, *Gaussian Processes*, 2006, 2.23-2.24). A coupon printed beside the pad shares what is
common and has no place on the pad.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, replace

import numpy as np

from padgen.measured.fits import TaxelFit
from padgen.measured.tuning import TunedTaxel, Tuning, planned_response_um_per_a2
from padgen.planner.plan import Plan
from padgen.planner.printed_pads import NAMES, OF_A_PAD, design_of, spreads_of

__all__ = ["estimated"]

DIRECTIONS = 64
"""Directions of a gradient that are averaged over."""
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
    covariance = _covariance(plan, np.array(channel))
    among = covariance[np.ix_(known, known)] + np.diag(noise**2 + JITTER)
    across = covariance[np.ix_(rest, known)]
    gain = np.linalg.solve(among, across.T).T
    mean = gain @ np.log(hz / planned[known])
    spread = np.sqrt(np.maximum(covariance[rest, rest] - (gain * across).sum(1), 0.0))
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


def _covariance(plan: Plan, channel: np.ndarray) -> np.ndarray:
    """Covariance of ln f of the pad's taxels and then of a coupon's, whose `channel` (n,) are given."""
    design, spreads = design_of(plan, None), spreads_of(plan.spec)
    count = len(plan.taxels)
    model = np.array([c.model_error for c in plan.channels])[channel]
    total = np.where(channel[:, None] == channel, model[:, None] * model, 0.0)
    along = np.zeros((len(channel), DIRECTIONS))
    angle = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    direction = np.stack([np.cos(angle), np.sin(angle)])
    along[:count] = design.place_mm @ direction / (design.size_mm @ np.abs(direction))
    for k, (name, sigma) in enumerate(zip(NAMES, astuple(spreads), strict=True)):
        each = (sigma * design.weight[k])[channel]
        if name not in OF_A_PAD:
            total += np.diag(each**2)
        elif name == "plate_gradient":
            total += each[:, None] * each * (along @ along.T) / DIRECTIONS
        else:
            total += each[:, None] * each
    covariance: np.ndarray = total
    return covariance
