"""Sample rates: the first of those that there are at which a drive is as exact as its amplifier."""

from math import ceil

from padgen.driver.pad_drive import CARRIER_OVER_RESONANCE, PadDrive, make_drive
from padgen.measured.tuning import Tuning
from padgen.physics.root_margin import ALIAS_DB
from padgen.planner.plan import Plan

__all__ = ["CONTROLLER_RATES_HZ", "RATES_HZ", "drive_at", "highest_hz"]

RATES_HZ = (48_000, 96_000, 192_000)
"""Of sound cards; the first that the highest resonance and the root's bends allow is taken."""
CONTROLLER_RATES_HZ = (8_000, 12_000, 16_000, 24_000, 32_000, *RATES_HZ)
"""For a microcontroller, which makes every sample anew."""
SAMPLES_OF_HIGHEST = 16
"""Samples in a period of the highest resonance, at least, where the rate is ours to choose."""


def drive_at(
    plan: Plan,
    rates_hz: tuple[int, ...],
    rate_hz: int | None = None,
    tuning: Tuning | None = None,
    carrier_hz: float | None = None,
) -> PadDrive:
    """The drive at `rate_hz`, or where that is None at the first of `rates_hz` that will do."""

    def made(rate: int) -> PadDrive:
        return make_drive(plan, rate, tuning=tuning, carrier_hz=carrier_hz, bandwidth_hz=plan.spec.drive.bandwidth_hz)

    if rate_hz is not None:
        return made(rate_hz)
    highest = highest_hz(plan, tuning)
    least = SAMPLES_OF_HIGHEST * highest
    if carrier_hz is not None:
        # One that no rate carries is refused with the bounds of the highest.
        least = max(least, min(2 * (carrier_hz + CARRIER_OVER_RESONANCE * highest), max(*rates_hz, least)))
    enough = [rate for rate in rates_hz if rate >= least] or [ceil(least / 1000) * 1000]
    for rate in enough:
        drive = made(rate)
        if drive.alias_db is None or drive.alias_db <= ALIAS_DB:
            break
    return drive


def highest_hz(plan: Plan, tuning: Tuning | None) -> float:
    """The highest resonance of the plan's channels, or of the print's taxels."""
    return max(one.resonance_hz for one in (plan.channels if tuning is None else tuning.taxels))
