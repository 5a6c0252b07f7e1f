"""Spec → Plan: capacity, layout, resonances, beams and their verdicts."""

from typing import TYPE_CHECKING, Any

from padgen.planner.plan import Plan, plan_from_json, plan_to_json, read_plan

if TYPE_CHECKING:
    from padgen.planner.make import make_plan

__all__ = ["Plan", "make_plan", "plan_from_json", "plan_to_json", "read_plan"]


def __getattr__(name: str) -> Any:
    """Return `make_plan`, which loads all that plans: a command that finds its plan in the cache needs none of it."""
    if name != "make_plan":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from padgen.planner.make import make_plan

    return make_plan
