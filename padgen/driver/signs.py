"""Choose the sign, up or down, of each ON taxel's motion so that the pad shakes least; compute the contrast left.

Whether a taxel begins upwards or downwards is free: a sign of −1 is its line in counter-phase, of the same force. Frame
by frame, signs are chosen with which what the pad tells the taxels of a frequency nearly cancels
(`padgen.physics.recoil.balanced_signs`). A taxel that stays ON keeps its sign, unless turning it over helps enough.
Nothing is left to chance: the same frames have the same signs.

The pad is on the mount of the plan's spec, and lies loose where that states none. Fastened to what does not move it
needs no signs, and has those of a pad that lies loose: they cost it nothing, and a table moves, too.
"""

from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from padgen.core.errors import number
from padgen.core.units import GRAM, UM
from padgen.driver.waveform import PadDrive
from padgen.measured.tuning import Tuning
from padgen.physics.recoil import MovingTaxels
from padgen.planner.plan import Plan
from padgen.planner.shaken_pad import ShakenPad

__all__ = ["PlayedPad", "PlayedRecoil", "choose_signs", "mount_text", "played_recoil", "printed_taxels"]


class PlayedRecoil(NamedTuple):
    """Least ON/OFF amplitude ratio in dB of all frames on a pad that recoils, with chosen signs of motion and in step.

    `signed_db` is with the signs that are played, `in_step_db` without, `clamped_db` of a pad that does not move; None
    where no taxel is OFF beside one that is ON. `turned` counts taxels that stay ON and turn over. `mount` says how the
    pad is held, `moving_g` is the mass on that; None where that does not move.
    """

    signed_db: float | None
    in_step_db: float | None
    clamped_db: float | None
    turned: int
    mount: str
    moving_g: float | None


class PlayedPad(ShakenPad):
    """A plan's pad as a rigid body on its mount, with a print's taxels, shaken by the spectral lines of a drive.

    What comes from different coils at one frequency adds with its phases.
    """

    def __init__(self, plan: Plan, drive: PadDrive, tuning: Tuning | None = None) -> None:
        super().__init__(plan)
        count = len(plan.taxels)
        harmonic = np.zeros(count, int)
        line = np.zeros(count, complex)
        for coil in drive.coils:
            harmonic[coil.taxels] = coil.harmonic
            line[coil.taxels] = coil.line_a2 * np.exp(1j * coil.phase_rad)
        if tuning is not None:
            self.taxels, self.pull = printed_taxels(self, tuning)
        tones, self.tone_of = np.unique(harmonic, return_inverse=True)
        self.hz = tones / drive.period_s
        self.line = line
        dynamic = [self.shaken[tone].dynamic[taxel] for taxel, tone in enumerate(self.tone_of)]
        self.unit = np.abs(self.pull * line / np.array(dynamic))


def printed_taxels(pad: ShakenPad, tuning: Tuning) -> tuple[MovingTaxels, np.ndarray]:
    """Return the taxels of a print, and the force constants (n,) in N/A² of its washers; masses are the plan's."""
    figures = [(taxel.resonance_hz, taxel.q, taxel.response_um_per_a2 * UM) for taxel in tuning.taxels]
    hz, q, response = np.array(figures).T
    mass = pad.taxels.mass
    return MovingTaxels(pad.taxels.momentum, mass, hz, q), response / q * mass * (2 * np.pi * hz) ** 2


TURNED_TAUS = 2.0
"""Time constants after which a taxel that turned over has three quarters of its level again: ``1 − 2 e^-2``."""
NEVER = 1e9


def choose_signs(pad: PlayedPad, frames: np.ndarray, held_s: float = inf, in_turns: bool = False) -> np.ndarray:
    """Return signs (k, n), +1 or −1, of taxels' motion that shake the pad least in frames of levels (k, n); OFF: +1.

    No taxel turns over that has not `TURNED_TAUS` in the `held_s` from the middle of a transition to the end of what is
    held. `in_turns`: every frame begins in silence, so that none are kept.
    """
    slowest_s = float((pad.taxels.q / (np.pi * pad.taxels.resonance_hz)).max())
    turn = None if held_s >= TURNED_TAUS * slowest_s else NEVER
    signs = np.ones(frames.shape)
    chosen = np.zeros(frames.shape[1])
    for k, levels in enumerate(frames):
        if k == 0 or not np.array_equal(levels, frames[k - 1]):
            chosen = pad.signs(levels, None if in_turns else chosen, turn)
        signs[k] = np.where(chosen == 0, 1.0, chosen)
    return signs


def played_recoil(pad: PlayedPad, frames: np.ndarray, signs: np.ndarray) -> PlayedRecoil:
    """Return the worst frame's ratio of ON to OFF amplitude: with `signs` (k, n), without, and on a pad held still.

    `frames` (k, n) are levels.
    """
    clamped = pad.mount.is_immovable
    in_step = np.unique(frames, axis=0)
    stays = (frames[1:] > 0) & (frames[:-1] > 0)
    return PlayedRecoil(
        signed_db=_worst_db(pad, np.unique(frames * signs, axis=0), clamped),
        in_step_db=_worst_db(pad, in_step, clamped),
        clamped_db=_worst_db(pad, in_step, True),
        turned=int((stays & (signs[1:] != signs[:-1])).sum()),
        mount=mount_text(pad),
        moving_g=None if pad.moving_kg is None else pad.moving_kg / GRAM,
    )


def mount_text(pad: ShakenPad) -> str:
    """Say how the pad is held."""
    mount = pad.mount
    if not mount.is_said:
        return "lying loose (no mount is stated)"
    if mount.is_immovable:
        return f"{mount.kind} to what does not move"
    plate = "" if mount.base_mass_g is None else f", with a base of {number(mount.base_mass_g)} g"
    layer = "" if mount.stiffness_n_per_m is None else f", on {number(mount.stiffness_n_per_m)} N/m"
    return f"{mount.kind}{plate}{layer}"


def _worst_db(pad: ShakenPad, driven: np.ndarray, clamped: bool) -> float | None:
    """Return the least ON/OFF amplitude ratio in dB of frames of signed levels (k, n); None if none has ON and OFF.

    If `clamped`, the pad does not move.
    """
    db = pad.listen(driven[(driven != 0).any(1)], clamped).db
    worst = float(db.min(initial=inf))
    return worst if isfinite(worst) else None
