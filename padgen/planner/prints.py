"""Estimate quickly the selectivity of printed pads from few prints of `padgen.planner.printed_pads`, with the error."""

from math import sqrt

import numpy as np

from padgen.planner.plan import Plan, Prints
from padgen.planner.printed_pads import STAGES, Design, design_of, printed, ratio_spread, spreads_of, work

__all__ = ["NOT_PRINTED", "compared_prints", "what_prints_keep"]

PADS, FEWEST = 1000, 100
"""Pads that are simulated, and the fewest where a pad takes much work."""
QUICK_PADS, NEAR_SHARE = 200, 0.07
"""Pads for comparing layouts, and three sigma of their good share: more are simulated if it is so near to the asked."""
SURE_SHARE, SURE_DB = 0.013, 0.2
"""Half intervals above which more pads are simulated; of two hundred plans none is then off by 2 % or 0.3 dB."""
WORK, MOST_WORK = 4e6, 1.6e7
"""Most responses that are computed at first, and when more pads are simulated."""
SIGMAS_95 = 1.96
"""Half width of a 95 % interval, in sigmas."""
NOT_PRINTED = Prints(None, None, None, None, 0.0, 0.0, 0, None, 1.0, 0.0, ())
"""Placeholder in a plan whose prints are not simulated yet."""


def what_prints_keep(plan: Plan, quick: bool = False) -> Prints:
    """Simulate prints of `plan`, always the same ones, until the estimate is sure; with `quick` only a few."""
    design = design_of(plan, None)
    return _simulated(plan, design, QUICK_PADS, STAGES) if quick else _simulated_until_sure(plan, design, STAGES)


def compared_prints(plan: Plan, least_db: float) -> tuple[float, Prints]:
    """Return the selectivity in dB of the pad as drawn, leakage and other modes counted, and its re-tuned prints.

    As many prints are simulated as comparing layouts needs; none (`NOT_PRINTED`) if the drawn pad keeps less than
    `least_db`.
    """
    design, stages = design_of(plan, None), STAGES[-1:]
    ratio = float(printed(design, spreads_of(plan.spec).none(), 1, 0, stages).ratio.min())
    paper_db = 10 * float(np.log10(ratio)) if ratio > 0 else float("-inf")
    if paper_db < least_db:
        return paper_db, NOT_PRINTED
    prints = _simulated(plan, design, QUICK_PADS, stages)
    if 0 < prints.good_share < plan.spec.print_share + NEAR_SHARE:
        prints = _simulated_until_sure(plan, design, stages)
    return paper_db, prints


def _simulated_until_sure(plan: Plan, design: Design, stages: tuple[str, ...]) -> Prints:
    first, most = (int(max(limit / work(design), FEWEST)) for limit in (WORK, MOST_WORK))
    prints = _simulated(plan, design, min(PADS, first), stages)
    unsure = max(prints.error_share / SURE_SHARE, (prints.error_db or 0.0) / SURE_DB) ** 2
    return _simulated(plan, design, int(min(unsure * prints.pads, most)), stages) if unsure > 1 else prints


def _simulated(plan: Plan, design: Design, made: int, stages: tuple[str, ...]) -> Prints:
    spreads, columns = spreads_of(plan.spec), plan.coils.columns
    prints, share = printed(design, spreads, made, 0, stages), plan.spec.print_share
    kept = np.sort(10 * np.log10(np.maximum(prints.ratio, np.finfo(float).tiny)), axis=1)
    reached = kept[:, min(int((1 - share) * made), made - 1)].tolist()
    good = float(prints.good[-1].mean())
    taxels = float(prints.good_taxels[-1].mean()) / len(plan.taxels)
    heard = bool(np.isfinite(kept).all())
    of_coils = dict(zip([t.coil for t in plan.taxels], (prints.good_coils[-1] / made).tolist(), strict=True))
    dbs: dict[str, float | None] = dict(zip(stages, reached, strict=True)) if heard else {}
    # The quantile lies between these ranks with 95 % confidence (normal approximation of the binomial distribution).
    away = SIGMAS_95 * sqrt(made * share * (1 - share))
    low, high = (int(np.clip((1 - share) * made + sign * away, 0, made - 1)) for sign in (-1, 1))
    return Prints(
        print_db=dbs.get("retuned"),
        planned_db=dbs.get("planned"),
        coupon_db=dbs.get("coupon"),
        some_db=dbs.get("some"),
        good_share=good,
        good_taxel_share=taxels,
        pads=made,
        error_db=float(kept[-1, high] - kept[-1, low]) / 2 if heard else None,
        error_share=_wilson_half_width(good, made),
        ratio_spread=ratio_spread(design, spreads),
        coil_shares=tuple(of_coils.get(divmod(k, columns), 1.0) for k in range(plan.coils.rows * columns)),
    )


def _wilson_half_width(share: float, made: int) -> float:
    """Return half of Wilson's 95 % interval of a share among `made`."""
    z2 = SIGMAS_95**2
    return SIGMAS_95 * sqrt(share * (1 - share) / made + z2 / (4 * made**2)) / (1 + z2 / made)
