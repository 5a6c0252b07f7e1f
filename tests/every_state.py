"""All-state selectivity by trying every state, the reference for the closed form."""

import numpy as np

from padgen.physics.resonator import ModalTaxels
from padgen.physics.selectivity import Channels, Scheme, line_energy, scheme_lines


def exhaustive_states_db(which: Channels, scheme: Scheme, modes: ModalTaxels | None = None) -> float:
    """Return the figure of `all_states` in dB by trying all 2ⁿ states (n ≤ 16)."""
    count = len(which.line)
    if count > 16:
        raise ValueError(f"2^{count} states are too many to try, at most 2^16")
    states = (np.arange(2**count)[:, None] >> np.arange(count)) & 1
    energy = np.zeros(states.shape)
    for part in scheme_lines(which, scheme):
        heard = line_energy(which, part, modes)
        if len(part.makers) == 1:
            # A harmonic is no disturbance of its own taxel: it is there only when that is ON.
            heard[part.makers[0], 1:, part.makers[0]] = 0.0
        playing = np.prod([states[:, maker] for maker in part.makers], axis=0, dtype=float)
        heard = heard.sum(1)
        energy += (playing[:, None] * heard).max(-1) if scheme.takes_turns else playing @ heard.T
    on = states.astype(bool)
    return float(10 * np.log10(energy[on].min() / energy[~on].max()))
