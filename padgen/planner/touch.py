"""Estimate resonance, Q and selectivity of taxels that a finger touches (`padgen.physics.resonator`)."""

from collections.abc import Iterator, Sequence
from math import pi

import numpy as np

from padgen.core.errors import at_least, at_most, number
from padgen.core.finding import Finding
from padgen.core.units import GRAM, MM, decibel
from padgen.physics.resonator import LOADED, SKINS, Skin, touched
from padgen.physics.selectivity import Channels, Scheme, line_energy, off_energy, own_lines
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.plan import Channel, Plan, Touched, channel_sets
from padgen.spec import Spec

__all__ = ["judge_touch", "touched_pads"]

MOST_CHANNELS = 32
"""Most channels of a coil for which the selectivity under a finger is computed."""
KEPT_Q = 8.0
"""Q that a touched taxel is to keep: by the rule of docs/accuracy.md, if k_skin/k is at most 1/(KEPT_Q ω τ)."""


def touched_pads(spec: Spec, channels: Sequence[Channel], scheme: Scheme) -> tuple[Touched, ...]:
    """Return the figures of the pad with every taxel under low, typical and high skin, driven as planned.

    Only the taxels' own modes and one coil are counted.
    """
    sets = channel_sets(channels, spec.coil.sets)
    found = []
    for name, skin in SKINS.items():
        hz, q, _ = _touched(spec, skin, channels)
        kept_db = [_kept_db(spec, own, scheme, skin) for own in sets]
        found.append(
            Touched(
                skin=name,
                skin_stiffness_n_per_m=2 * skin.modulus * spec.taxel.boss_diameter_mm / 2 * MM,
                resonance_hz=tuple(hz.tolist()),
                q=tuple(q.tolist()),
                all_states_db=None if None in kept_db else min(db for db in kept_db if db is not None),
            )
        )
    return tuple(found)


def judge_touch(plan: Plan) -> Iterator[Finding]:
    """Yield a note where typical skin stiffens or damps a taxel too much, with values that would prevent it."""
    skin = SKINS["typical"]
    worst = min(plan.channels, key=lambda c: c.stiffness_n_per_m / _allowed(skin, c.resonance_hz))
    typical = next(t for t in plan.touched if t.skin == "typical")
    added, omega, mass = typical.skin_stiffness_n_per_m, 2 * pi * worst.resonance_hz, worst.effective_mass_g * GRAM
    allowed = _allowed(skin, worst.resonance_hz)
    if added <= allowed * worst.stiffness_n_per_m:
        return
    contact_mm = allowed * worst.stiffness_n_per_m / skin.modulus / MM
    heavy_g = added / allowed / omega**2 / GRAM
    high_hz = max((added / LOADED / mass) ** 0.5, KEPT_Q * skin.time * added / mass) / 2 / pi
    hz, q, kept = typical.resonance_hz[worst.index], typical.q[worst.index], typical.all_states_db
    quieter = (
        ""
        if kept is None
        else f", and OFF taxels vibrate {abs(kept):.1f} dB {'less' if kept > 0 else 'more'} than ON ones"
    )
    yield Finding(
        "note",
        "touch.skin",
        f"channel {worst.index}",
        f"under typical skin (a provisional model) its {number(worst.resonance_hz)} Hz become {hz:.1f} Hz at Q ="
        f" {q:.2g}{quieter}; the touched resonance would stay within 5 % with a contact {at_most(contact_mm)} mm"
        f" wide, a moving mass of {at_least(heavy_g)} g or a resonance of {at_least(high_hz)} Hz",
    )


def _allowed(skin: Skin, hz: float) -> float:
    """Return the share of a taxel's stiffness that skin may add: f then rises by at most 5 %, and Q is at least 8."""
    return min(LOADED, 1 / (KEPT_Q * 2 * pi * hz * skin.time))


def _touched(spec: Spec, skin: Skin, channels: Sequence[Channel]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    stiffness, mass_g, q = np.array([(c.stiffness_n_per_m, c.effective_mass_g, c.q) for c in channels]).T
    return touched(skin, spec.taxel.boss_diameter_mm / 2 * MM, stiffness, mass_g * GRAM, q)


def _kept_db(spec: Spec, own: Sequence[Channel], scheme: Scheme, skin: Skin) -> float | None:
    """Return the smallest ON over the largest OFF level in dB of a touched coil in all states.

    None for a single channel, or for more than `MOST_CHANNELS`.
    """
    if not 2 <= len(own) <= MOST_CHANNELS:
        return None
    planned, (hz, q, stiffer) = placed_channels(spec, own), _touched(spec, skin, own)
    stiffness = np.array([c.stiffness_n_per_m for c in own])
    taxels = Channels(hz, q, planned.line * (stiffer / q) / (stiffness / planned.q))
    (made,) = own_lines(planned, scheme)
    on = line_energy(taxels, made)[:, 0].diagonal()
    return decibel(float((on.min() / off_energy(taxels, scheme, drivers=planned).max()) ** 0.5))
