"""Carriers for amplifiers that pass no 0 Hz: the lowest is tried before it is named."""

from padgen.core.errors import SpecError, at_least
from padgen.driver.limits import judge_load
from padgen.driver.loads import load_of
from padgen.driver.pad_drive import CARRIER_OVER_RESONANCE
from padgen.driver.rates import RATES_HZ, drive_at, highest_hz
from padgen.driver.timeline import Timeline
from padgen.measured.tuning import Tuning
from padgen.planner.plan import Plan

__all__ = ["carrier_text"]


def carrier_text(plan: Plan, shown: Timeline, rate_hz: int | None, tuning: Tuning | None) -> str:
    """Whether the lowest carrier that is accepted keeps all limits: as a clause."""
    hz = at_least(CARRIER_OVER_RESONANCE * highest_hz(plan, tuning))
    try:
        drive = drive_at(plan, RATES_HZ, rate_hz, tuning, float(hz))
    except SpecError as error:
        return f"; a carrier has none, but the lowest, {hz} Hz, {error.message}"
    beyond = next(judge_load("", plan, load_of(plan, drive, shown), tuning), None)
    if beyond is None:
        return f"; a carrier has none (--carrier {hz} keeps all limits)"
    return f"; a carrier has none, but with the lowest that is accepted, --carrier {hz}, the current {beyond.message}"
