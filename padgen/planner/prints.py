"""Quick estimate of what printed pads keep: few simulated prints of `padgen.planner.printed_pads`, with their error."""

from math import sqrt

import numpy as np

from padgen.planner.plan import Plan, Prints
from padgen.planner.printed_pads import STAGES, design_of, printed, spreads_of, work

__all__ = ["NOT_PRINTED", "PADS", "on_paper_db", "what_prints_keep"]

PADS, FEWEST = 1000, 100
"""Pads that are simulated, and at least where they are much work."""
WORK = 4e6
"""Responses that are computed at most."""
CONFIDENT = 1.96
NOT_PRINTED = Prints(None, None, None, None, 0.0, 0.0, 0, None, 1.0)
"""Of a plan whose prints are not simulated yet."""


def what_prints_keep(plan: Plan, pads: int = PADS) -> Prints:
    """Simulate up to `pads` prints of `plan`, always the same ones."""
    design = design_of(plan, None)
    made = int(min(pads, max(WORK / work(design), FEWEST)))
    prints, share = printed(design, spreads_of(plan.spec), made, 0), plan.spec.print_share
    kept = np.sort(10 * np.log10(np.maximum(prints.ratio, np.finfo(float).tiny)), axis=1)
    reached = kept[:, min(int((1 - share) * made), made - 1)].tolist()
    good = float(prints.good[-1].mean())
    taxels = float(prints.good_taxels[-1].mean()) / len(plan.taxels)
    heard = bool(np.isfinite(kept).all())
    dbs = dict(zip(STAGES, reached if heard else [None] * len(STAGES), strict=True))
    # Ranks between which the quantile lies, by the normal limit of the binomial law.
    away = CONFIDENT * sqrt(made * share * (1 - share))
    low, high = (int(np.clip((1 - share) * made + sign * away, 0, made - 1)) for sign in (-1, 1))
    return Prints(
        print_db=dbs["retuned"],
        planned_db=dbs["planned"],
        coupon_db=dbs["coupon"],
        some_db=dbs["some"],
        good_share=good,
        good_taxel_share=taxels,
        pads=made,
        error_db=float(kept[-1, high] - kept[-1, low]) / 2 if heard else None,
        error_share=_half_width(good, made),
    )


def _half_width(share: float, made: int) -> float:
    """Half of Wilson's interval."""
    z2 = CONFIDENT**2
    return CONFIDENT * sqrt(share * (1 - share) / made + z2 / (4 * made**2)) / (1 + z2 / made)


def on_paper_db(plan: Plan) -> float:
    """ON over OFF of the drawing itself, coils around and other modes counted; no print keeps more."""
    design = design_of(plan, None)
    ratio = float(printed(design, spreads_of(plan.spec).none(), 1, 0, ("retuned",)).ratio.min())
    return 10 * float(np.log10(ratio)) if ratio > 0 else float("-inf")
