"""What a spec's `[drive]` table means to the physics: its level law and its schemes."""

import numpy as np

from padgen.core.registry import SCHEMES
from padgen.core.units import decibel
from padgen.physics.levels import LevelLaw
from padgen.physics.selectivity import Scheme, all_states, channels
from padgen.spec import Spec

__all__ = ["level_law", "scheme_for", "scheme_named", "sets_db"]


def level_law(spec: Spec) -> LevelLaw:
    """The level law of a spec: its exponent, or equal sensation where it has a threshold curve."""
    drive = spec.drive
    return LevelLaw(drive.level_law, drive.threshold_hz or (), drive.threshold_um or ())


def scheme_named(spec: Spec, name: str) -> Scheme:
    """The scheme called `name` with the settings of `spec`."""
    return Scheme(name, spec.drive.bias_ratio, SCHEMES.version(name))


def scheme_for(spec: Spec, resonance_hz: np.ndarray) -> Scheme:
    """The scheme to optimise resonances for: the spec's; of auto, tones if they keep what is asked, else spur-free."""
    if spec.drive.scheme != "auto":
        return scheme_named(spec, spec.drive.scheme)
    tones = Scheme("tones")
    keeps = sets_db(spec, resonance_hz, np.ones(len(resonance_hz)), tones) >= decibel(spec.delta_y)
    return tones if keeps else Scheme("spur-free")


def sets_db(spec: Spec, resonance_hz: np.ndarray, mass: np.ndarray, scheme: Scheme) -> float:
    """All-state selectivity in dB of channels (n,) that are dealt out in turn to the spec's sets: of the worse set."""
    level, sets = level_law(spec)(resonance_hz), spec.coil.sets
    dealt = (slice(k, None, sets) for k in range(sets))
    return min(all_states(channels(resonance_hz[k], spec.q_min, level[k], mass[k]), scheme).db for k in dealt)
