"""`padgen plan --yield`: share of good pads among prints, before and after re-tuning, and the costliest error cause.

`padgen.planner.printed_pads` has the model of a print and judges it.
"""

from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from math import inf, log10

import numpy as np

from padgen.planner.plan import Plan
from padgen.planner.printed_pads import (
    NAMES,
    STAGES,
    Design,
    Simulated,
    Spreads,
    design_of,
    simulated_prints,
    spreads_of,
    work_per_pad,
)

__all__ = ["ChannelSpread", "Cost", "Gain", "Outcome", "PrintYield", "Share", "print_yield"]

BUDGET = 5e8
"""Most responses that are computed for all pads together: a few seconds."""
COST_SHARE = 20
COST_PADS = 2000
"""The cost of each spread is found on a twentieth of the pads, but on at least `COST_PADS` if there are as many."""
OUTCOMES = ("planned", "after_coupon", "after_some", "retuned")
"""Fields of `PrintYield` with an `Outcome`, in the order of `STAGES`."""
LEAST_GAINS = {"pads": 0.01, "taxels": 0.01, "median_db": 0.1}
"""Gains up to these are too small to call a spread the costliest."""


@dataclass(frozen=True, slots=True)
class Share:
    """The share of `good` among `made`, with Wilson's 95 % interval `low` … `high`.

    Taxels of one pad are off together. Where their counts scatter more from pad to pad than independent taxels would,
    the interval is that of fewer, independent taxels that scatter as much.
    """

    good: int
    made: int
    share: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """Shares of good taxels and pads, and quantiles over the pads of the selectivity in dB of a pad's worst coil.

    90 % of pads reach `reached_by_90_percent_db`. The dB are None where no coil has two channels.
    """

    taxels: Share
    pads: Share
    q05_db: float | None
    median_db: float | None
    q95_db: float | None
    reached_by_90_percent_db: float | None


@dataclass(frozen=True, slots=True)
class ChannelSpread:
    """Sigma of a channel's ln f over all prints, and its slopes d ln f / d ln of width, thickness and length."""

    channel: int
    sigma_f: float
    per_width: float
    per_thickness: float
    per_length: float


@dataclass(frozen=True, slots=True)
class Gain:
    """Increases of the share of good pads, of good taxels (0 … 1) and of the pads' median selectivity in dB."""

    pads: float
    taxels: float
    median_db: float | None


@dataclass(frozen=True, slots=True)
class Cost:
    """Loss of yield by one cause of print errors: what is gained if it is absent and all other errors stay the same."""

    spread: str
    sigma: float
    planned: Gain
    retuned: Gain


@dataclass(frozen=True, slots=True)
class PrintYield:
    """Yield of `pads` simulated prints, fewer than the `pads_asked` for if these would take too much computing.

    `criterion` says what a good taxel and a good pad are; `nominal_db` is the selectivity of the pad as drawn. In
    `after_coupon` the tones follow the error common to a print, in `after_some` also the smooth field over the bed.
    `good_prints` (t,) are the shares of pads in which each taxel is good once re-tuned. Of the neighbouring channels
    `swapped_share` came out in the other order, `crowded_share` closer than Eq. 12 asks for the wanted selectivity.
    `costs` come from the first `cost_pads` pads. `costliest_*` is the spread whose absence gains most, and the figure
    that shows it: the first of 'pads', 'taxels' and 'median_db' that does; ('none', 'none') where none does.
    """

    pads: int
    pads_asked: int
    seed: int
    drive: str
    asked_db: float
    nominal_db: float | None
    criterion: str
    spreads: Spreads
    channels: tuple[ChannelSpread, ...]
    planned: Outcome
    after_coupon: Outcome
    after_some: Outcome
    retuned: Outcome
    good_prints: tuple[float, ...]
    swapped_share: float | None
    crowded_share: float | None
    cost_pads: int
    costs: tuple[Cost, ...]
    costliest_planned: tuple[str, str]
    costliest_retuned: tuple[str, str]


def print_yield(
    plan: Plan,
    pads: int,
    seed: int = 0,
    *,
    spreads: Spreads | None = None,
    budget: float = BUDGET,
) -> PrintYield:
    """Simulate `pads` prints of `plan` and return their yield; the same `seed` gives the same result to the bit.

    Without `spreads` those of the spec are taken. `budget` is the largest number of responses computed, which limits
    the pads: n² for each coil of n channels, n³ with pair spurs.

    A taxel is good when its ON amplitude over its own largest OFF amplitude reaches the asked selectivity, a pad when
    the selectivity of each of its coils does. A taxel alone over its coil is good while its tone moves it by at least
    1/√2 (−3 dB) of its level.
    """
    if pads < 1:
        raise ValueError(f"pads must be at least 1, got {pads}")
    spreads = spreads or spreads_of(plan.spec)
    design = design_of(plan, None)
    affordable = max(int(budget / work_per_pad(design)), 1)
    made = min(pads, affordable)
    prints = simulated_prints(design, spreads, made, seed)
    cost_pads = min(made, max(made // COST_SHARE, COST_PADS), max(affordable // COST_SHARE, 1))
    costs = tuple(_costs(design, spreads, cost_pads, seed))
    pairs = sum(coils.taxels.shape[1] * (len(coils.channels) - 1) for coils in design.coils) * made
    swapped, crowded = (float(count) / pairs if pairs else None for count in prints.neighbours)
    drawn = float(simulated_prints(design, spreads.none(), 1, 0, STAGES[-1:]).ratio[0, 0])
    sigma = np.sqrt(prints.square / (np.bincount(design.channel, minlength=len(design.q)) * made)).tolist()
    slopes = design.sensitivity.tolist()
    return PrintYield(
        pads=made,
        pads_asked=pads,
        seed=seed,
        drive=design.scheme.name,
        asked_db=plan.selectivity.asked_db,
        nominal_db=10 * log10(drawn) if 0 < drawn < inf else None,
        criterion=_criterion(plan, design),
        spreads=spreads,
        channels=tuple(ChannelSpread(i, sigma[i], *slopes[i]) for i in range(len(sigma))),
        **dict(zip(OUTCOMES, (_outcome(prints, k, len(design.channel)) for k in range(len(STAGES))), strict=True)),
        good_prints=tuple((prints.good_prints[-1] / made).tolist()),
        swapped_share=swapped,
        crowded_share=crowded,
        cost_pads=cost_pads,
        costs=costs,
        costliest_planned=_costliest({cost.spread: cost.planned for cost in costs}),
        costliest_retuned=_costliest({cost.spread: cost.retuned for cost in costs}),
    )


def _criterion(plan: Plan, design: Design) -> str:
    untouched = "" if plan.touch is None else "nobody touches these pads (the verdict is of touched ones); "
    asked = (
        f"{untouched}a taxel or a pad is good with an ON over OFF of {plan.selectivity.asked_db:.1f} dB, leakage of"
        " other coils and other modes of the taxels included"
    )
    alone = "a taxel with a coil to itself while its tone moves it by 1/sqrt(2) of its level"
    counts = {len(coils.channels) for coils in design.coils}
    if counts == {1}:
        return f"no coil has a second channel, so that there is no selectivity within a coil: {alone} is good"
    return f"{asked}, {alone}" if 1 in counts else asked


def _outcome(prints: Simulated, k: int, taxels: int) -> Outcome:
    pads = prints.ratio.shape[1]
    good = prints.good_taxels[k]
    ratio = prints.ratio[k]
    quantiles = [0.05, 0.5, 0.95, 0.1]
    dbs = (10 * np.log10(np.quantile(ratio, quantiles))).tolist() if np.isfinite(ratio).all() else [None] * 4
    # As many independent taxels as scatter as much as the pads' shares: from pads to pads × taxels.
    share = float((good / taxels).mean())
    scatter = float((good / taxels).var())
    alike = share * (1 - share) / scatter if scatter > 0 else 1.0
    independent = round(pads * min(max(alike, 1.0), taxels))
    return Outcome(
        _share(int(good.sum()), pads * taxels, independent),
        _share(int(prints.good[k].sum()), pads, pads),
        *dbs,
    )


def _share(good: int, made: int, independent: int) -> Share:
    from scipy.stats import binomtest

    interval = binomtest(round(good / made * independent), independent).proportion_ci(0.95, method="wilson")
    return Share(good, made, good / made, float(interval.low), float(interval.high))


def _costs(design: Design, spreads: Spreads, pads: int, seed: int) -> Iterator[Cost]:
    base = simulated_prints(design, spreads, pads, seed)
    taxels = len(design.channel)
    for name, sigma in zip(NAMES, astuple(spreads), strict=True):
        without = simulated_prints(design, replace(spreads, **{name: 0.0}), pads, seed) if sigma else base
        yield Cost(name, sigma, *(_gain(base, without, k, taxels) for k in (0, -1)))


def _gain(base: Simulated, without: Simulated, k: int, taxels: int) -> Gain:
    median = np.median(without.ratio[k]), np.median(base.ratio[k])
    return Gain(
        float(without.good[k].mean() - base.good[k].mean()),
        float(without.good_taxels[k].mean() - base.good_taxels[k].mean()) / taxels,
        float(10 * np.log10(median[0] / median[1])) if np.isfinite(median).all() else None,
    )


def _costliest(gains: dict[str, Gain]) -> tuple[str, str]:
    """Return the costliest cause of print errors, and which figure of `LEAST_GAINS` shows it; 'none' twice if none."""
    for figure, least in LEAST_GAINS.items():
        value = {name: getattr(gain, figure) or 0.0 for name, gain in gains.items()}
        best = max(value, key=lambda name: value[name])
        if value[best] > least:
            return best, figure
    return "none", "none"
