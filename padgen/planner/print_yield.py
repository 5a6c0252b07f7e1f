"""How many pads of a plan come out good, before and after re-tuning, and which spread costs most.

What is printed and how it is judged is told in `padgen.planner.printed_pads`.
"""

from dataclasses import astuple, dataclass, replace
from math import inf, log10

import numpy as np

from padgen.planner.plan import Plan
from padgen.planner.printed_pads import (
    NAMES,
    STAGES,
    Design,
    Prints,
    Spreads,
    design_of,
    printed,
    spreads_of,
    work,
)

__all__ = ["ChannelSpread", "Cost", "Gain", "Outcome", "PrintYield", "Share", "print_yield"]

BUDGET = 5e8
"""Responses that are computed for all pads together: a few seconds."""
COST_SHARE, COST_PADS = 20, 2000
"""What each spread costs is found on one pad in so many, but on so many pads if there are."""
OUTCOMES = ("planned", "after_coupon", "after_some", "retuned")
"""`Outcome`s in the order of `STAGES`."""
TELLING = {"pads": 0.01, "taxels": 0.01, "median_db": 0.1}
"""Gains below these do not tell one spread from another."""


@dataclass(frozen=True, slots=True)
class Share:
    """`good` out of `made`, with a 95 % interval by Wilson.

    Taxels of a pad share its drift: where their counts scatter more from pad to pad than independent ones
    would, the interval is that of as many independent taxels as scatter alike.
    """

    good: int
    made: int
    share: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """Yields, and quantiles of the pads' selectivity in dB, a pad's being that of its worst coil.

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
    """Sigma of a channel's ln f over all prints, and its d ln f / d ln of width, thickness and length."""

    channel: int
    sigma_f: float
    per_width: float
    per_thickness: float
    per_length: float


@dataclass(frozen=True, slots=True)
class Gain:
    """What the yields (of 1) and the pads' median dB would gain."""

    pads: float
    taxels: float
    median_db: float | None


@dataclass(frozen=True, slots=True)
class Cost:
    """What is gained when one spread alone is taken away, with the same random numbers for the others."""

    spread: str
    sigma: float
    planned: Gain
    retuned: Gain


@dataclass(frozen=True, slots=True)
class PrintYield:
    """What becomes of `pads` printed pads; fewer than `pads_asked` where those were too much work.

    `criterion` says what a good taxel and a good pad are; `nominal_db` is what the drawing itself keeps. `after_coupon`
    the tones know what is common to a print, `after_some` measured taxels the smooth field as well; `good_prints` has
    the share of pads in which each taxel (t,) is good once re-tuned. `swapped_share` of the neighbouring channels came
    out in the other order, `crowded_share` closer than the slots of Eq. 12 are for the asked selectivity. `costs` come
    from the first `cost_pads` pads;
    `costliest_*` is the spread that gains most, and by which figure: 'pads', 'taxels' or 'median_db', the first of
    them that tells; ('none', 'none') where a print without one spread is no better by any.
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
    pads: int = 100_000,
    seed: int = 0,
    *,
    spreads: Spreads | None = None,
    places_mm: np.ndarray | None = None,
    budget: float = BUDGET,
) -> PrintYield:
    """Print `plan` so many times; the same `seed` gives the same result to the bit.

    `spreads` are the spec's when absent, `places_mm` (taxels, 2) the plan's. `budget` limits the number of
    pads: it is the number of responses computed, n² for each coil of n channels, n³ where pairs make spurs.

    A taxel is good when its ON amplitude over its own loudest OFF amplitude reaches what the plan was asked for, a
    pad when the selectivity of each of its coils does. A taxel that has a coil to itself has no OFF
    amplitude to be heard: it is good while its tone still moves it by 1/√2 (−3 dB) of its level.
    """
    if pads < 1:
        raise ValueError(f"pads must be at least 1, got {pads}")
    spreads = spreads or spreads_of(plan.spec)
    design = design_of(plan, places_mm)
    affordable = max(int(budget / work(design)), 1)
    made = min(pads, affordable)
    prints = printed(design, spreads, made, seed)
    cost_pads = min(made, max(made // COST_SHARE, COST_PADS), max(affordable // COST_SHARE, 1))
    costs = _costs(design, spreads, cost_pads, seed)
    pairs = sum(coils.taxels.shape[1] * (len(coils.channels) - 1) for coils in design.coils) * made
    swapped, crowded = (float(count) / pairs if pairs else None for count in prints.neighbours)
    return PrintYield(
        pads=made,
        pads_asked=pads,
        seed=seed,
        drive=design.scheme.name,
        asked_db=plan.selectivity.asked_db,
        nominal_db=_nominal_db(design, spreads),
        criterion=_criterion(plan, design),
        spreads=spreads,
        channels=_channel_spreads(design, prints, made),
        **dict(zip(OUTCOMES, (_outcome(prints, k, len(design.channel)) for k in range(len(STAGES))), strict=True)),
        good_prints=tuple((prints.good_prints[-1] / made).tolist()),
        swapped_share=swapped,
        crowded_share=crowded,
        cost_pads=cost_pads,
        costs=costs,
        costliest_planned=_costliest({cost.spread: cost.planned for cost in costs}),
        costliest_retuned=_costliest({cost.spread: cost.retuned for cost in costs}),
    )


def _nominal_db(design: Design, spreads: Spreads) -> float | None:
    ratio = float(printed(design, spreads.none(), 1, 0, STAGES[-1:]).ratio[0, 0])
    return 10 * log10(ratio) if 0 < ratio < inf else None


def _criterion(plan: Plan, design: Design) -> str:
    asked = (
        f"a taxel or a pad is good with an ON over OFF of {plan.selectivity.asked_db:.1f} dB, leakage of other coils"
        " and other modes of the taxels included"
    )
    alone = "a taxel with a coil to itself while its tone moves it by 1/sqrt(2) of its level"
    counts = {len(coils.channels) for coils in design.coils}
    if counts == {1}:
        return f"no coil has a second channel, so that there is no selectivity: {alone} is good"
    return f"{asked}, {alone}" if 1 in counts else asked


def _outcome(prints: Prints, k: int, taxels: int) -> Outcome:
    pads = prints.ratio.shape[1]
    good = prints.good_taxels[k]
    dbs: list[float | None] = [None] * 4
    if np.isfinite(prints.ratio[k]).all():
        dbs = [float(v) for v in 10 * np.log10(np.quantile(prints.ratio[k], [0.05, 0.5, 0.95, 0.1]))]
    return Outcome(
        _share(int(good.sum()), pads * taxels, _independent(good / taxels, taxels)),
        _share(int(prints.good[k].sum()), pads, pads),
        *dbs,
    )


def _independent(shares: np.ndarray, taxels: int) -> int:
    """Independent taxels whose share scatters as the pads' shares (pads,) do: at least pads, at most taxels."""
    share, pads = float(shares.mean()), len(shares)
    scatter = float(shares.var())
    alike = share * (1 - share) / scatter if scatter > 0 else 1.0
    return round(pads * min(max(alike, 1.0), taxels))


def _share(good: int, made: int, independent: int) -> Share:
    from scipy.stats import binomtest

    interval = binomtest(round(good / made * independent), independent).proportion_ci(0.95, method="wilson")
    return Share(good, made, good / made, float(interval.low), float(interval.high))


def _channel_spreads(design: Design, prints: Prints, pads: int) -> tuple[ChannelSpread, ...]:
    count = np.bincount(design.channel, minlength=len(design.q)) * pads
    sigma = np.sqrt(prints.square / count)
    return tuple(
        ChannelSpread(i, float(sigma[i]), *(float(v) for v in design.sensitivity[i])) for i in range(len(sigma))
    )


def _costs(design: Design, spreads: Spreads, pads: int, seed: int) -> tuple[Cost, ...]:
    base, taxels = printed(design, spreads, pads, seed), len(design.channel)
    costs = []
    for name, sigma in zip(NAMES, astuple(spreads), strict=True):
        without = printed(design, replace(spreads, **{name: 0.0}), pads, seed) if sigma else base
        costs.append(Cost(name, sigma, *(_gain(base, without, k, taxels) for k in (0, -1))))
    return tuple(costs)


def _gain(base: Prints, without: Prints, k: int, taxels: int) -> Gain:
    median = np.median(without.ratio[k]), np.median(base.ratio[k])
    return Gain(
        float(without.good[k].mean() - base.good[k].mean()),
        float(without.good_taxels[k].mean() - base.good_taxels[k].mean()) / taxels,
        float(10 * np.log10(median[0] / median[1])) if np.isfinite(median).all() else None,
    )


def _costliest(gains: dict[str, Gain]) -> tuple[str, str]:
    """Spread and figure of the largest gain, by the first figure in which one stands out."""
    for figure, least in TELLING.items():
        value = {name: getattr(gain, figure) or 0.0 for name, gain in gains.items()}
        best = max(value, key=lambda name: value[name])
        if value[best] > least:
            return best, figure
    return "none", "none"
