"""Planner: from a spec to the plan of its pad, with layout, resonances, beams, drive, findings and verdict."""

from typing import TYPE_CHECKING, Any

from padgen.planner.plan import Plan, plan_from_json, plan_to_json, read_plan

if TYPE_CHECKING:
    from padgen.planner.make import make_plan

__all__ = ["Plan", "make_plan", "plan_from_json", "plan_to_json", "read_plan"]


def __getattr__(name: str) -> Any:
    """Import and return `make_plan` on first use, so that commands whose plan is cached do not load it."""
    if name != "make_plan":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from padgen.planner.make import make_plan

    return make_plan
