"""Ballast, the extra mass pressed into the plates: findings about it, its size for orders, its assembly step.

Ballast is pressed upright into the plate above the mover. It makes the taxel heavy, and its modes of rocking slow: they
may lie near a tone, though a pull along the axis hardly excites them.
"""

from collections.abc import Iterator
from typing import Any

from padgen.core.errors import Finding, about, number
from padgen.planner.plan import Channel, Plan, channel_sets
from padgen.planner.taxel_model import recess_mm
from padgen.spec import Ballast, Spec, catalogue

__all__ = ["ballast_findings", "ballast_size", "ballast_step"]

NEAR_RATIO = 1.3
"""Least ratio of a rocking mode's frequency to that of any tone of its coil, or the other way round."""
LIKE_SHARE = 0.3
"""Relative difference of the mass of another ballast that is proposed in place of one."""


def ballast_findings(plan: Plan) -> Iterator[Finding]:
    """Yield findings where rocking modes lie near tones, and where ballast is wider than the recess of the mover."""
    ballast = plan.spec.ballast
    if ballast is None:
        return
    yield from _rocking(plan, ballast)
    wide_mm = ballast.width_mm - recess_mm(plan.spec)[0]
    if wide_mm > 0:
        kind = plan.spec.mover.kind
        yield Finding(
            "note",
            "ballast.wide",
            "recess",
            f"{ballast.name!r} is {number(wide_mm)} mm wider than the recess of the {kind}, which nothing centres"
            " there: glue it to the ballast's middle by a ring of"
            f" {number(plan.spec.washer_or_magnet.outer_diameter_mm)} mm bore,"
            " 0.2 mm off its middle is 0.2 mm off its place",
        )


def _rocking(plan: Plan, ballast: Ballast) -> Iterator[Finding]:
    """Yield a warning if a mode other than the working one lies too near to a tone of its coil."""
    nearest: tuple[float, Channel, float, float] | None = None
    for channels in channel_sets(plan.channels, plan.coils.sets):
        tones_hz = [channel.resonance_hz for channel in channels]
        for channel in channels:
            others = [hz for hz, share in zip(channel.modes_hz, channel.mode_shares, strict=True) if share < 1]
            for hz in others:
                for tone_hz in tones_hz:
                    ratio = max(hz / tone_hz, tone_hz / hz)
                    if nearest is None or ratio < nearest[0]:
                        nearest = ratio, channel, hz, tone_hz
    if nearest and nearest[0] < NEAR_RATIO:
        ratio, channel, hz, tone_hz = nearest
        yield Finding(
            "warning",
            "modes.rocking",
            f"channel {channel.index}",
            f"with its ballast of {about(ballast.mass_g, 3)} g it rocks at {number(hz)} Hz, only a factor of"
            f" {ratio:.2f} off the tone of {number(tone_hz)} Hz, which rocks it if its print is uneven; a factor of"
            f" {NEAR_RATIO:g} would be safe",
            tuple(_steadier(plan.spec, ballast)),
        )


def _steadier(spec: Spec, ballast: Ballast) -> Iterator[dict[str, Any]]:
    """Yield cures against rocking: other suspensions, and the flattest ballast of about the same mass."""
    for topology in ("bridge", "folded"):
        if spec.suspension.topology != topology:
            yield {"suspension.topology": topology}
    alike = {}
    for name, entry in catalogue("ballast").items():
        other = Ballast(**entry)
        if abs(other.mass_g / ballast.mass_g - 1) < LIKE_SHARE and other.height_mm < ballast.height_mm:
            alike[name] = other.height_mm
    if alike:
        yield {"ballast": min(alike, key=lambda name: alike[name])}


def ballast_size(ballast: Ballast) -> str:
    """Return name, sizes and mass of ballast, as a bill of materials has them."""
    bore = f" bore {number(ballast.inner_diameter_mm)}" if ballast.inner_diameter_mm else ""
    across = "mm across flats" if ballast.shape == "hexagon" else "mm diameter"
    size = f"{number(ballast.width_mm)} {across}{bore} {number(ballast.height_mm)} mm high"
    return f"{ballast.name}: {size} {number(ballast.mass_g)} g each"


def ballast_step(spec: Spec) -> str:
    """Return the assembly instruction for the ballast; empty without ballast."""
    ballast = spec.ballast
    if ballast is None:
        return ""
    turned = ", two of its flats facing the beam," if ballast.shape == "hexagon" else ""
    return (
        f"Turn the pad over and lay it on a flat board with a hole under the boss. Press one {ballast.name}"
        f" ({number(ballast.mass_g)} g){turned} into the pocket of each plate until it stops at the roof,"
        f" {number(spec.pocket_top_mm)} mm up, holding the plate, not the beam; where it goes in loosely, a drop of"
        f" thin glue first. Its lower face then lies {number(spec.mover_top_mm)} mm above the pad's underside."
    )
