"""Spec → Plan: capacity, layout, resonances, beams and their verdicts."""

from padgen.planner.make import make_plan
from padgen.planner.plan import Plan, plan_from_json, plan_to_json, read_plan

__all__ = ["Plan", "make_plan", "plan_from_json", "plan_to_json", "read_plan"]
