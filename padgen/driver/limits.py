"""The limits of coils, amplifiers and gaps: the one judge of all that is written or played, before it is.

What is judged is what is shown (a timeline), or where that is not known the worst of whatever a host may send to the
firmware (`padgen.driver.loads`).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from padgen.core.errors import SpecError, at_most, number
from padgen.core.finding import Finding
from padgen.core.units import MM, UM
from padgen.driver.loads import Load, load_of
from padgen.driver.pad_drive import PadDrive, make_drive
from padgen.driver.rates import CONTROLLER_RATES_HZ, drive_at
from padgen.driver.timeline import Timeline, timeline
from padgen.measured.predict import printed_channels
from padgen.measured.tuning import Tuning, planned_tuning
from padgen.physics.magnetics import balanced_deflection
from padgen.planner.channels import hanging_gap_um
from padgen.planner.coil_load import pull_in_share
from padgen.planner.plan import Channel, Plan

__all__ = ["judge_limits", "judge_load", "refuse_frames", "voltage_finding"]

NEAR = 1 + 1e-9
"""What is made to be at a limit is not beyond it by its rounding."""
TRIES = 6
SMALLEST_LEVEL_UM = 1e-4
"""Smallest that a spec may ask for."""


def judge_limits(
    where: str, plan: Plan, drive: PadDrive, shown: Timeline | None = None, tuning: Tuning | None = None
) -> tuple[Finding, ...]:
    """Errors where `drive`, made for `plan` and `tuning`, asks for more than is borne; none where all limits hold.

    `shown` None: by the worst of all levels and changes that the firmware may be sent.
    """
    load = load_of(plan, drive, shown)
    if not any(judge_load(where, plan, load, tuning, drive.voltage_limit_v)):
        return ()
    return tuple(
        judge_load(where, plan, load, tuning, drive.voltage_limit_v, _level_text(plan, drive, shown, tuning, load))
    )


def refuse_frames(plan: Plan, frames: np.ndarray, tuning: Tuning | None = None) -> None:
    """Raise if frames (k, taxels) that the firmware is to show are beyond a limit: what harms a coil is not played."""
    drive = drive_at(plan, CONTROLLER_RATES_HZ, tuning=tuning)
    if any(judge_load("", plan, load_of(plan, drive), tuning)):
        found = judge_limits("", plan, drive, timeline(plan, np.unique(frames, axis=0)), tuning)
        if found:
            raise SpecError(f"is not played: it {found[0].message}", plan.name)


def judge_load(
    where: str,
    plan: Plan,
    load: Load,
    tuning: Tuning | None = None,
    limit_v: float | None = None,
    cure: str = "",
) -> Iterator[Finding]:
    """Errors about a load; `limit_v` None is the spec's, `cure` ends every sentence."""
    spec = plan.spec
    limit_v = spec.drive.voltage_limit_v if limit_v is None else limit_v
    if load.peak_v > limit_v * NEAR:
        yield voltage_finding(where, load.peak_v, limit_v, cure)
    loss_w = float(load.square_a2.max(initial=0.0)) * spec.coil.resistance_ohm
    if loss_w > spec.coil.power_limit_w * NEAR:
        yield Finding(
            "error",
            "coil.heat",
            where,
            f"takes {number(loss_w)} W of copper loss in its warmest state, above coil.power_limit_w ="
            f" {number(spec.coil.power_limit_w)} W{cure}",
        )
    yield from _pull(where, plan, load, tuning, cure)


def voltage_finding(where: str, peak_v: float, limit_v: float, cure: str) -> Finding:
    """The error of a voltage above the amplifier's."""
    return Finding(
        "error",
        "wave.voltage",
        where,
        f"peaks at {number(peak_v)} V, above drive.voltage_limit_v = {number(limit_v)} V{cure}",
    )


def _pull(where: str, plan: Plan, load: Load, tuning: Tuning | None, cure: str) -> Iterator[Finding]:
    """Whether a washer snaps to its coil, or comes nearer to it than a third of the gap leaves."""
    spec, columns = plan.spec, plan.coils.columns
    share, travel_um = 0.0, 0.0
    seen: dict[tuple[Channel, float, float], tuple[float, float]] = {}
    channels = printed_channels(plan, tuning or planned_tuning(plan))
    for taxel, channel, level in zip(plan.taxels, channels, load.level.tolist(), strict=True):
        square_a2 = float(load.square_a2[taxel.coil[0] * columns + taxel.coil[1]])
        if (key := (channel, square_a2, level)) not in seen:
            gap_um = float(hanging_gap_um(spec, channel.sag_um))
            own = pull_in_share(spec, channel, square_a2)
            slack_um = max(square_a2 * channel.force_constant_n_per_a2, 0.0) / channel.stiffness_n_per_m / UM
            static_um = balanced_deflection(slack_um, gap_um, max(channel.pull_exponent, 0.0)) or 0.0
            seen[key] = own, channel.sag_um + static_um + level * channel.level_um
        share, travel_um = max(share, seen[key][0]), max(travel_um, seen[key][1])
    if share >= 1:
        yield Finding(
            "error",
            "coil.pull_in",
            where,
            f"pulls a washer {number(share)} times as strongly as it takes to snap to the coil{cure}",
        )
    third_um = spec.coil.gap_mm * MM / UM / 3
    if share < 1 and travel_um > third_um:
        yield Finding(
            "error",
            "gap.travel",
            where,
            f"moves a washer by {number(travel_um * UM / MM)} mm, sag and static pull with it; a third of the gap is"
            f" {number(third_um * UM / MM)} mm{cure}",
        )


def _level_text(plan: Plan, drive: PadDrive, shown: Timeline | None, tuning: Tuning | None, load: Load) -> str:
    """The level at which the same is within all limits, as a clause: it was tried."""
    spec = plan.spec
    level = spec.drive.level_um
    for _ in range(TRIES):
        loss_w = float(load.square_a2.max()) * spec.coil.resistance_ohm
        # All currents go with the root of the level.
        factor = (drive.voltage_limit_v / max(load.peak_v, 1e-9)) ** 2
        factor = min(factor, spec.coil.power_limit_w / max(loss_w, 1e-9))
        text = at_most(level * (factor if factor < 1 else 0.7))
        level = float(text)
        if level < SMALLEST_LEVEL_UM:
            break
        lower = replace(plan, spec=replace(spec, drive=replace(spec.drive, level_um=level)))
        other = make_drive(
            lower, drive.rate_hz, tuning, carrier_hz=drive.carrier_hz, bandwidth_hz=spec.drive.bandwidth_hz
        )
        load = load_of(lower, other, shown)
        if not any(judge_load("", lower, load, tuning, drive.voltage_limit_v)):
            return f"; drive.level_um of {text} would fit it"
    return "; no lower drive.level_um that was tried would fit it"
