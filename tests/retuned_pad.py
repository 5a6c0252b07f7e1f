"""A pad that recoils and whose taxels differ, each driven at its own resonance: its figure in the worst image."""

import numpy as np

from padgen.physics.recoil import MovingPad, MovingTaxels
from padgen.planner.shaken_pad import ShakenPad


def retuned_db(pad: ShakenPad, resonance_hz: np.ndarray, shown: np.ndarray) -> float:
    """Return ON over OFF in dB of the worst image (k, n) of a pad whose taxels have these resonances (n,) in Hz.

    What OFF taxels hear of tones at different frequencies adds as energies, with the pad's leakage.
    """
    line = pad.line_a2[pad.channel_of]
    taxels = MovingTaxels(pad.taxels.momentum, pad.taxels.mass, resonance_hz, pad.taxels.q)
    own = [taxels.stiffness(float(hz))[taxel] for taxel, hz in enumerate(resonance_hz)]
    unit = np.abs(pad.pull * line / np.array(own))
    motions = []
    for taxel, hz in enumerate(resonance_hz):
        force = np.where(pad.coil_of == pad.coil_of[taxel], pad.pull * line[taxel], 0.0)
        motions.append(np.abs(MovingPad(pad.base, taxels, float(hz)).relative_motion(force)) / unit)
    motion = np.array(motions)
    on = np.where(shown > 0, np.diagonal(motion), np.inf).min(-1)
    heard = np.where(shown > 0, 0.0, pad.leak + shown**2 @ motion**2).max(-1)
    return float((20 * np.log10(on / np.sqrt(heard))).min())
