"""Selectivity that prints keep in use: re-tuned once, then warmer or colder, aged, and each with a Q of its own.

Nothing printed keeps its resonances: plastic softens by some tenths of a percent per kelvin, and creeps. All taxels of
a pad shift alike, but the tones stay, so that each tone moves its own taxel less and its neighbours more. Nor is a Q
the one that was planned: a taxel of lower Q is driven harder for the same level, and its neighbours hear that.

Re-tuning follows resonances and levels as they are then, Q included. What comes after is a shift of ln f common to a
pad, by the plastic's softening and by ageing. Levels are those of tuned taxels, so that a detuned ON taxel counts by
what it still moves. A pad that is planned under a contact is judged under the drawn skins of `touched_prints`.
"""

from dataclasses import replace
from math import log
from typing import NamedTuple

import numpy as np

from padgen.planner.plan import NO_LIFE, Life, Plan
from padgen.planner.printed_pads import (
    FIRST_PADS,
    QUICK_PADS,
    STAGES,
    Design,
    Drift,
    design_of,
    few_pads,
    pads_until_sure,
    quantile_error,
    rising_db,
    share_error,
    simulated_prints,
    spreads_of,
    work_per_pad,
)
from padgen.planner.search import largest_that_holds
from padgen.planner.touched_prints import touched_pads
from padgen.planner.warm_pad import warm_resonance_ratio
from padgen.spec import Spec

__all__ = ["keeps_for_life", "planned_life"]

STEP_K = 0.5
"""Step of the temperatures up to which a pad may be used without re-tuning."""
WORTH = 1.2
"""Least number of prints, over those that are known already, for which all are simulated again."""


def planned_life(plan: Plan, design: Design, quick: bool = False) -> Life:
    """Return the selectivity kept, and the share of good prints, when warmer, colder and aged after one re-tuning.

    Few prints are enough of a plan whose prints keep too little on the day of re-tuning. With `quick`, which is for
    whether enough prints are good, few are taken, with other modes as they are in the plan, and no more figures are
    looked for: `retune_k` is 0 where the range is too large.
    """
    today = plan.retuned_prints
    few = QUICK_PADS
    if plan.touch is None:
        few = min(today.pads, few_pads(design))
    if quick:
        if today.good_share < plan.spec.print_share:
            return NO_LIFE
        return _life(plan, _with_planned_modes(design), few, plan.spec.print_share)
    life = _life(plan, design, few)
    if today.good_share < plan.spec.print_share:
        return life
    pads = min(pads_until_sure(work_per_pad(design), life.error_share, life.error_db or 0.0, few), today.pads)
    if pads > WORTH * few:
        life = _life(plan, design, pads)
    if life.good_share < plan.spec.print_share:
        life = replace(life, retune_k=_largest_change_k(plan, design, few))
    return life


def keeps_for_life(plan: Plan) -> bool:
    """Return whether enough prints keep the asked selectivity when aged, warmer or colder, by few simulated prints."""
    asked = plan.spec.print_share
    design = design_of(plan, None)
    few = few_pads(design)
    # To follow other modes from print to print takes several times as long: first those of the plan.
    rounds = [(_with_planned_modes(design), few), (design, few), (design, pads_until_sure(work_per_pad(design)))]
    for one, pads in rounds:
        share = float(_at_both_ends(plan, one, pads, asked).good.mean())
        unsure = share_error(share, pads)
        if share < asked - unsure:
            return False
        if one is design and share >= asked + unsure:
            return True
    return share >= asked


def _life(plan: Plan, design: Design, pads: int, least_share: float = 0.0) -> Life:
    """Simulate `pads` prints, re-tuned once, then warmer or colder, aged and with another Q; return what they keep.

    `retune_k` is the spec's whole range, or 0 where fewer prints than asked stay good. Once less than a `least_share`
    of them can be good, the others may be left unjudged.
    """
    spec = plan.spec
    range_k = spec.life.temperature_range_k
    judged = _at_both_ends(plan, design, pads, least_share)
    share = float(judged.good.mean())
    kept_db, reached = rising_db(judged.ratio, spec.print_share)
    is_heard = plan.retuned_prints.print_db is not None and bool(np.isfinite(kept_db).all())
    return Life(
        temperature_range_k=range_k,
        shifts=(_shift(spec, range_k), _shift(spec, -range_k)),
        print_db=float(kept_db[reached]) if is_heard else None,
        good_share=share,
        retune_k=range_k if share >= spec.print_share else 0.0,
        pads=pads,
        error_db=quantile_error(kept_db, spec.print_share) if is_heard else None,
        error_share=share_error(share, pads),
    )


def _at_both_ends(plan: Plan, design: Design, pads: int, least_share: float) -> "_Judged":
    """Judge prints at the warm and at the cold end of the spec's range of temperature; the worse end counts."""
    range_k = plan.spec.life.temperature_range_k
    warmer = _after(plan, design, range_k, pads, least_share)
    if warmer.good.mean() < least_share:
        return warmer
    colder = _after(plan, design, -range_k, pads, least_share)
    return _Judged(np.minimum(warmer.ratio, colder.ratio), warmer.good & colder.good)


class _Judged(NamedTuple):
    """Prints (pads,) after temperature change and ageing: ON / OFF energy of each one's worst coil; which are good."""

    ratio: np.ndarray
    good: np.ndarray


def _after(plan: Plan, design: Design, change_k: float, pads: int, least_share: float = 0.0) -> _Judged:
    """Judge prints that are `change_k` warmer than when re-tuned, aged, and with Q drawn at random.

    Once less than a `least_share` of them can be good, the rest may be left as good, with an infinite ratio.
    """
    spec = plan.spec
    drift = Drift(log(1 + _shift(spec, change_k)), spec.life)
    if plan.touch is not None:
        ratio = touched_pads(plan, pads, plan.touch.tones, True, design, drift=drift).ratio
        return _Judged(ratio, ratio >= design.need)
    later = simulated_prints(design, spreads_of(spec), pads, 0, STAGES[-1:], drift, least_share)
    return _Judged(later.ratio[0], later.good[0])


def _shift(spec: Spec, change_k: float) -> float:
    """Return the relative change of all resonances of a pad that is warmer by `change_k`."""
    return float(warm_resonance_ratio(spec.material, change_k)) - 1


def _with_planned_modes(design: Design) -> Design:
    """Return `design` changed for speed: modes other than the working one act in every print as they do in the plan."""
    return design._replace(modes=(None,) * len(design.coils))


def _largest_change_k(plan: Plan, design: Design, pads: int) -> float:
    """Return the largest change in K, up or down, in steps of `STEP_K`, that the asked share of prints bears, else 0.

    Both warmer and colder. It is looked for near what few prints bear with other modes as they are in the plan.
    """
    as_planned = _with_planned_modes(design)
    few = min(pads, FIRST_PADS)
    share = plan.spec.print_share
    range_k = plan.spec.life.temperature_range_k
    worse = min((1, -1), key=lambda sign: float(_after(plan, as_planned, sign * range_k, few).ratio.mean()))

    def is_nearly_kept(steps: int) -> bool:
        return _after(plan, as_planned, worse * steps * STEP_K, few, share).good.mean() >= share

    def is_kept(steps: int) -> bool:
        good = _after(plan, design, worse * steps * STEP_K, pads, share).good
        if good.mean() < share:
            return False
        return (good & _after(plan, design, -worse * steps * STEP_K, pads, share).good).mean() >= share

    most = int(np.ceil(range_k / STEP_K)) - 1
    near = largest_that_holds(is_nearly_kept, 0, most)
    return largest_that_holds(is_kept, 0, most, near=near) * STEP_K
