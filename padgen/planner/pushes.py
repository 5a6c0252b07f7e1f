"""Predict how far fingers push the taxels at rest, and whether a washer then meets its coil.

A push acts on the middle of the boss, which is above the washer's axis. All modes of the taxel give way to it, so that
it also tilts. Skin that lies at the height of the frame is a spring that the boss, standing proud, compresses: its
stiffness is that of `padgen.planner.touch` (provisional), the same at every depth, although real skin stiffens.
"""

from collections.abc import Iterator, Sequence
from math import hypot, pi
from typing import NamedTuple

from padgen.core.errors import Finding, at_least, at_most, listed, number, plural
from padgen.core.units import MM, MN, UM
from padgen.planner.plan import Channel, Plan, Push, Pushed
from padgen.planner.sizing import STRENGTH_OVER_FATIGUE
from padgen.planner.touch import SKINS, contactor_of, skin_contact
from padgen.spec import Spec

__all__ = ["judge_pushes", "pushed_taxels"]


PUSHES_MN = (0.0, 10.0, 30.0, 100.0)
"""Forces of a finger on one boss."""
KEPT_SHARE = 0.5
"""Share of the gap that a cure is to leave under typical skin at the height of the frame."""
EDGE_SHARE = 0.75
"""Share of a boss' height that the chamfer of its edge takes at most in a cure: a spec may have 0.9."""


class _PushCompliance(NamedTuple):
    """Compliance in m/N under a push on the boss: of the washer's middle, and of the lowest point of its rim."""

    middle: float
    rim: float


def _push_compliance(spec: Spec, channel: Channel) -> _PushCompliance:
    modes = [
        (motion, motion[2] / (2 * pi * hz) ** 2)
        for motion, hz in zip(channel.mode_motions, channel.modes_hz, strict=True)
    ]
    sinks, roll, pitch = (sum(motion[axis] * push for motion, push in modes) for axis in (2, 3, 4))
    return _PushCompliance(sinks, sinks + spec.washer_or_magnet.outer_diameter_mm / 2 * MM * hypot(roll, pitch))


def pushed_taxels(spec: Spec, channels: Sequence[Channel]) -> Pushed:
    """Return how far static pushes and resting skin deflect each channel's OFF taxel, and forces that close its gap."""
    gives = [_push_compliance(spec, channel) for channel in channels]
    at_rest = 1.0 if spec.force_order == 1 else 0.0  # a core pulls at rest, a current does not
    gaps_mm = [max(spec.coil.gap_mm - (c.sag_um + at_rest * c.static_um) * UM / MM, 0.0) for c in channels]
    rows = []
    for push_mn in PUSHES_MN:
        rows.append(_push("", push_mn, [push_mn * MN * give.middle / MM for give in gives], gaps_mm, gives))
    for name in SKINS:
        spring = float(skin_contact("fingertip", name).impedance(0.0, contactor_of(spec)).stiffness)
        moved_mm = [spec.taxel.boss_protrusion_mm * spring / (spring + 1 / give.middle) for give in gives]
        rows.append(_push(name, None, moved_mm, gaps_mm, gives))
    bent = [
        channel.root_stress_mpa * spec.coil.gap_mm * MM / UM / channel.level_um for channel in channels
    ]  # sag and push together
    return Pushed(
        closing_force_mn=tuple(gap * MM / give.middle / MN for gap, give in zip(gaps_mm, gives, strict=True)),
        rim_force_mn=tuple(gap * MM / give.rim / MN for gap, give in zip(gaps_mm, gives, strict=True)),
        closed_stress_mpa=tuple(bent),
        pushes=tuple(rows),
    )


def _push(
    skin: str,
    push_mn: float | None,
    moved_mm: Sequence[float],
    gaps_mm: Sequence[float],
    gives: Sequence[_PushCompliance],
) -> Push:
    left_mm = [max(gap - moved, 0.0) for gap, moved in zip(gaps_mm, moved_mm, strict=True)]
    # The washer tilts, so that its rim moves farther than its middle.
    contact = [moved * give.rim / give.middle >= gap for moved, gap, give in zip(moved_mm, gaps_mm, gives, strict=True)]
    return Push(skin, push_mn, tuple(moved_mm), tuple(left_mm), tuple(contact))


def judge_pushes(plan: Plan) -> Iterator[Finding]:
    """Say which push closes the softest taxel's gap, and warn where a finger resting on the frame closes a gap.

    Another warning where beams break before the coil stops a push. A note where only a push closes a gap.
    """
    spec = plan.spec
    pushed = plan.pushed
    typical = next(push for push in pushed.pushes if push.skin == "typical")
    strength = STRENGTH_OVER_FATIGUE * spec.material.fatigue_stress_mpa
    stopped = [force <= PUSHES_MN[-1] for force in pushed.rim_force_mn]
    closed = [force <= PUSHES_MN[-1] for force in pushed.closing_force_mn]
    broken = [c.index for c in plan.channels if closed[c.index] and pushed.closed_stress_mpa[c.index] > strength]
    if not any(stopped) and not any(typical.contact):
        return
    soft = min(plan.channels, key=lambda channel: pushed.rim_force_mn[channel.index])
    at = soft.index
    others = [k for k in range(len(plan.channels)) if k != at and stopped[k]]
    further = f"; {number(PUSHES_MN[-1])} mN stop {sum(stopped)} of {len(stopped)} channels" if others else ""
    touching = [str(k) for k, touches in enumerate(typical.contact) if touches]
    resting = (
        f"stops channel{plural(len(touching))} {listed(touching)}" if touching else "leaves every taxel free to move"
    )
    sentence = (
        f"a finger that presses the rim of its boss with {_short(pushed.rim_force_mn[at])} mN stops it: the"
        f" {spec.mover.kind} then touches the coil{further}; a finger of typical skin (a provisional model) that only"
        f" rests on the frame presses this boss, {number(spec.taxel.boss_protrusion_mm)} mm proud, in by"
        f" {_short(typical.deflection_mm[at])} mm, and {resting}"
    )
    yield Finding(
        "warning" if any(typical.contact) else "note",
        "touch.push",
        f"channel {at}",
        sentence,
        tuple(_cures(plan)) if any(typical.contact) else (),
    )
    if broken:
        worst = max(broken, key=lambda k: pushed.closed_stress_mpa[k])
        yield Finding(
            "warning",
            "touch.strength",
            f"channel {worst}",
            f"a finger that pushes its {plan.spec.mover.kind} onto the coil, with"
            f" {_short(pushed.closing_force_mn[worst])} mN, stresses"
            f" the roots of its beams by {_short(pushed.closed_stress_mpa[worst])} MPa; {spec.material.name} breaks at"
            f" about {number(strength)} MPa",
        )


def _short(value: float) -> str:
    return f"{value:.2g}"


def _cures(plan: Plan) -> Iterator[dict[str, float]]:
    """Yield spec changes, a lower boss or a wider gap, with which typical skin on the frame leaves half of each gap."""
    spec = plan.spec
    skin = next(push for push in plan.pushed.pushes if push.skin == "typical")
    proud_mm = spec.taxel.boss_protrusion_mm
    layer_mm = spec.printer.layer_mm
    shares = [moved / proud_mm for moved in skin.deflection_mm]
    fits_mm = min(
        KEPT_SHARE * (spec.coil.gap_mm - channel.sag_um * UM / MM) / share
        for channel, share in zip(plan.channels, shares, strict=True)
    )
    layers = int(fits_mm / layer_mm * (1 + 1e-9))
    if layers >= 1:
        lower_mm = round(layers * layer_mm, 6)
        height_mm = spec.pad.frame_thickness_mm - spec.taxel.plate_thickness_mm + lower_mm
        edge_mm = float(at_most(EDGE_SHARE * height_mm))
        edge = {"taxel.boss_edge_mm": edge_mm} if edge_mm < spec.taxel.boss_edge_mm else {}
        yield {"taxel.boss_protrusion_mm": lower_mm, **edge}
    if fits_mm > 0:
        wide_mm = max(
            moved / KEPT_SHARE + channel.sag_um * UM / MM
            for channel, moved in zip(plan.channels, skin.deflection_mm, strict=True)
        )
        yield {"coil.gap_mm": float(at_least(wide_mm))}
