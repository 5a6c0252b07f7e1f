"""Describe plans, builds, drives and prints as text for people; the command line prints it."""

from padgen.report.measured_prints import laid_text
from padgen.report.plans import (
    built_text,
    explanation_text,
    figures_text,
    findings_text,
    held_line,
    plan_text,
    serious_text,
    summary_text,
    yield_text,
)

__all__ = [
    "built_text",
    "explanation_text",
    "figures_text",
    "findings_text",
    "held_line",
    "laid_text",
    "plan_text",
    "serious_text",
    "summary_text",
    "yield_text",
]
