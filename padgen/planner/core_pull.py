"""Rest positions of movers that the steel cores of coils attract without current, and which would snap to a core.

A core's pull grows as the gap closes: it sinks the taxel, softens its spring and lowers its resonance; a spring that is
too soft gives way at once. Only movers with a `rest` are drawn at rest, as magnets are.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import Finding, about, at_least, number
from padgen.core.units import MM, MN, UM
from padgen.planner.movers import mover_of
from padgen.planner.plan import Channel, Plan, Site
from padgen.spec import Spec

__all__ = ["CoreRest", "core_findings", "core_rest", "finite_rest", "snapping_message_and_cures", "snaps"]

FARTHEST = 4.0
"""Largest gap over the spec's at which a magnet that snaps is tried to rest."""
STEPS = 24
SNAPPED_GAP = 0.2
SNAPPED_SHARE = 0.01
"""Share of gap and stiffness with which a taxel that snaps is planned on, to be refused or found an error."""


class CoreRest(NamedTuple):
    """Equilibrium of n taxels whose magnets a core attracts: gap in µm, and stiffness left, as a share of the beam's.

    `gap_um` and `stiffness_share` are at rest; `snap_um` is the gap below which they would snap to the core,
    `least_n_per_m` the least stiffness of a spring that holds. The first three are nan for taxels that snap at once.
    """

    gap_um: np.ndarray
    stiffness_share: np.ndarray
    snap_um: np.ndarray
    least_n_per_m: np.ndarray


def core_rest(spec: Spec, gap_um: np.ndarray, distance_mm: Sequence[float], stiffness: np.ndarray) -> CoreRest | None:
    """Return where taxels rest under the cores' pull, from gaps `gap_um` without it; None where no core pulls."""
    rest = getattr(mover_of(spec), "rest", None)
    if rest is None or not spec.coil.core_diameter_mm:
        return None
    gap, left, snap, least = rest(spec.coil, spec.washer_or_magnet, gap_um * UM, np.array(distance_mm) * MM, stiffness)
    return CoreRest(gap / UM, left / stiffness, snap / UM, least)


def snaps(rest: CoreRest | None) -> bool:
    """Return whether any of the taxels snaps to its core."""
    return rest is not None and bool(np.isnan(rest.gap_um).any())


def finite_rest(rest: CoreRest, hanging_um: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return gaps in µm and stiffness shares (n,) of `rest`, with small values instead of nan for snapped taxels."""
    lost = np.isnan(rest.gap_um)
    gap_um = np.where(lost, SNAPPED_GAP * hanging_um, rest.gap_um)
    return gap_um, np.where(lost, SNAPPED_SHARE, rest.stiffness_share)


def snapping_message_and_cures(
    spec: Spec, sites: Sequence[Site], gap_um: np.ndarray, stiffness: np.ndarray, rest: CoreRest
) -> tuple[str, list[dict[str, Any]]]:
    """Return a sentence (which mover snaps to its core most easily, the gap from which none does) and the cures."""
    gap_mm = float(spec.coil.gap_mm)
    worst = int(np.argmax(rest.least_n_per_m / stiffness))
    away = [site.coil_distance_mm for site in sites]
    low = gap_mm
    high = gap_mm * FARTHEST
    held = _at_gap(spec, gap_um, away, stiffness, high)
    for _ in range(STEPS):
        middle = (low + high) / 2
        if snaps(_at_gap(spec, gap_um, away, stiffness, middle)):
            low = middle
        else:
            high = middle
    farther = at_least(high)
    ends = f"from a gap of {farther} mm on the beam holds it" if not snaps(held) else "a wider gap does not help"
    sentence = (
        f"at a gap of {number(gap_mm)} mm the core pulls the {spec.mover.kind} {spec.washer_or_magnet.name} of"
        f" channel {worst},"
        f" {about(away[worst], 3)} mm off its coil's axis, onto itself: its beam has"
        f" {about(float(stiffness[worst]), 4)} N/m, {at_least(float(rest.least_n_per_m[worst]))} N/m would hold it;"
        f" {ends}"
    )
    return sentence, [*([] if snaps(held) else [{"coil.gap_mm": float(farther)}]), {"coil": "air-10"}]


def _at_gap(
    spec: Spec, gap_um: np.ndarray, away_mm: Sequence[float], stiffness: np.ndarray, gap_mm: float
) -> CoreRest | None:
    """Return the rest positions of taxels with the spec's gap changed to `gap_mm`."""
    return core_rest(spec, gap_um + (gap_mm - float(spec.coil.gap_mm)) * MM / UM, away_mm, stiffness)


def core_findings(plan: Plan) -> Iterator[Finding]:
    """Yield a finding on how far cores draw the movers at rest, and how near that is to snapping."""
    channels = plan.channels
    hanging_um, away_mm, stiffness = _springs(channels, plan.spec)
    rest = core_rest(plan.spec, hanging_um, away_mm, stiffness)
    if rest is None:
        return
    if snaps(rest):
        sentence, cures = snapping_message_and_cures(plan.spec, [c.site for c in channels], hanging_um, stiffness, rest)
        yield Finding("error", "coil.snap", "coil", sentence, tuple(cures))
        return
    nearest = int(np.argmax(rest.snap_um / rest.gap_um))
    channel = channels[nearest]
    sunk_um = channel.static_um
    left_um = float(rest.gap_um[nearest] - rest.snap_um[nearest])
    pull_mn = sunk_um * UM * float(stiffness[nearest]) / MN
    lowered = 1 - float(np.sqrt(rest.stiffness_share[nearest]))
    close = left_um < 2 * channel.level_um
    yield Finding(
        "warning" if close else "note",
        "coil.core",
        f"channel {nearest}",
        f"its coil's core draws the {plan.spec.mover.kind} with {number(pull_mn)} mN at rest: its gap is"
        f" {number(float(rest.gap_um[nearest]) * UM / MM)} mm, its resonance {lowered:.1%} lower; {number(left_um)} µm"
        f" nearer it snaps to the core, at least {number(2 * channel.level_um)} µm should be left",
    )


def _springs(channels: Sequence[Channel], spec: Spec) -> tuple[np.ndarray, list[float], np.ndarray]:
    """Return gaps in µm, distances to the coil axis in mm, stiffnesses in N/m, all without the cores' pull."""
    share = np.array([(1 - channel.pull_shift) ** 2 for channel in channels])
    stiffness = np.array([channel.stiffness_n_per_m for channel in channels]) / share
    hanging_um = float(spec.coil.gap_mm) * MM / UM - np.array([channel.sag_um for channel in channels])
    return hanging_um, [channel.site.coil_distance_mm for channel in channels], stiffness
