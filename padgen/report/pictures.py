"""The pictures that explain a plan, by name: `padgen draw` writes them, `Plan.plot` shows them."""

from typing import TYPE_CHECKING, Any

from padgen.core.display import plot_style
from padgen.core.registry import unknown_name
from padgen.report.charts import draw_ladder, draw_overview, draw_prints, draw_responses, draw_selectivity
from padgen.report.drawings import draw_exploded, draw_pad, draw_section, draw_wiring

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = ["PICTURES", "picture"]

PICTURES = {
    "pad": draw_pad,
    "section": draw_section,
    "exploded": draw_exploded,
    "ladder": draw_ladder,
    "responses": draw_responses,
    "selectivity": draw_selectivity,
    "prints": draw_prints,
    "wiring": draw_wiring,
    "overview": draw_overview,
}


def picture(plan: "Plan", name: str) -> Any:
    """Draw one of `PICTURES` from a plan alone, without a display or a CAD kernel.

    Returns
    -------
    matplotlib.figure.Figure
        `padgen.core.display.plot_bytes` makes SVG and PNG of it, the same bytes for the same plan.

    Raises
    ------
    SpecError
        There is no picture of that name; the sentence has the nearest.
    """
    if name not in PICTURES:
        raise unknown_name(name, list(PICTURES), "picture", "")
    with plot_style():
        return PICTURES[name](plan)
