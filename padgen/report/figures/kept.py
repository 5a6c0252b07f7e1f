"""Histogram of ON over OFF in many simulated prints, before and after every taxel is measured and re-tuned."""

from typing import TYPE_CHECKING

import numpy as np

from padgen.planner.printed_pads import STAGES, design_of, simulated_prints, spreads_of
from padgen.report.figures import Bars, Facts, Figure, Line, Panel, Scale
from padgen.report.plans import STAGES as STAGE_WORDS

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = ["CAPTION", "ORDER", "SHOWN_IN", "TITLE", "make"]

TITLE = "What prints keep"
CAPTION = (
    "The same pad printed many times in the computer: how far ON taxels stand out over OFF ones, before and after every"
    " taxel is measured and re-tuned."
)
SHOWN_IN = ("draw", "page", "sheet")
ORDER = 4
BINS = 48
MOST_DB = 200.0


def make(plan: "Plan", quick: bool) -> tuple[Figure, ...]:
    """Return a histogram of prints' dB and a table of dB kept by stage of measuring; if `quick`, the table only."""
    prints = plan.prints
    asked_db = plan.selectivity.asked_db
    stages_db = (prints.planned_db, prints.coupon_db, prints.some_db, prints.print_db)
    rows = [
        (f"{stage} measured", f"{db:.1f} dB".replace("-", "−"))
        for stage, db in zip(STAGE_WORDS, stages_db, strict=True)
        if db is not None
    ]
    is_counted = prints.print_db is not None and bool(prints.pads)
    if not rows:
        notes = ("Nothing moves OFF taxels of this pad, so there is no limit to what prints keep.",)
    elif is_counted and not quick:
        notes = (
            f"{100 * prints.good_share:.3g} % of {prints.pads} prints reach the {asked_db:.1f} dB asked for, once every"
            " taxel is measured and re-tuned.",
        )
    else:
        notes = ("The histogram is counted when the report is written.",)
    caption = f"ON over OFF that {100 * plan.spec.print_share:.3g} % of prints keep"
    return (
        Figure(
            title="what prints keep, before and after every taxel is measured and re-tuned",
            description=f"Histogram of {prints.pads} simulated prints; the table below has its figures",
            panels=(_histogram(plan),) if is_counted and not quick else (),
            channels=len(plan.channels),
            facts=Facts(caption, tuple(rows)) if rows else None,
            notes=notes,
        ),
    )


def _histogram(plan: "Plan") -> Panel:
    prints = plan.prints
    asked_db = plan.selectivity.asked_db
    stages = STAGES[0], STAGES[-1]
    ratio = simulated_prints(design_of(plan, None), spreads_of(plan.spec), prints.pads, 0, stages).ratio
    kept_db = np.clip(10 * np.log10(np.maximum(ratio, np.finfo(float).tiny)), -MOST_DB, MOST_DB)
    low_db = float(np.floor(min(kept_db.min(), asked_db)))
    high_db = max(float(np.ceil(max(kept_db.max(), asked_db))), low_db + 1)
    edges = np.linspace(low_db, high_db, BINS + 1)
    counts = [np.histogram(row, edges)[0].tolist() for row in kept_db]
    words = [f"{stage} measured" for stage in (STAGE_WORDS[0], STAGE_WORDS[-1])]
    return Panel(
        x=Scale("ON over OFF of a print's worst coil", "dB", low_db, high_db),
        y=Scale("prints", "", 0.0, float(max(1, *map(max, counts)))),
        marks=tuple(
            Bars(role, label, tuple(edges.tolist()), tuple(row))
            for role, label, row in zip(("planned", "retuned"), words, counts, strict=True)
        ),
        lines=(Line("asked", asked_db, f"asked {asked_db:.1f} dB", is_dashed=True),),
    )
