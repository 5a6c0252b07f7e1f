"""Translate a spec's `[drive]` table for the physics: its level law and its drive schemes."""

import numpy as np

from padgen.core.registry import SCHEMES
from padgen.core.units import decibel
from padgen.physics.ladder import LevelLaw
from padgen.physics.selectivity import Scheme, all_states, channels
from padgen.spec import Spec

__all__ = ["level_law", "scheme_for", "scheme_named", "sets_db"]


def level_law(spec: Spec) -> LevelLaw:
    """Return the level law of a spec: a power of frequency, or equal sensation where it has a threshold curve."""
    drive = spec.drive
    return LevelLaw(drive.level_law, drive.threshold_hz or (), drive.threshold_um or ())


def scheme_named(spec: Spec, name: str) -> Scheme:
    """Return the drive scheme called `name` with the settings of `spec`."""
    return Scheme(name, spec.drive.bias_ratio, SCHEMES.version(name))


def scheme_for(spec: Spec, resonance_hz: np.ndarray) -> Scheme:
    """Return the scheme for which resonances are chosen: the one in the spec.

    For 'auto' it is plain tones if these keep the asked selectivity, else spur-free.
    """
    if spec.drive.scheme != "auto":
        return scheme_named(spec, spec.drive.scheme)
    tones = Scheme("tones")
    keeps = sets_db(spec, resonance_hz, np.ones(len(resonance_hz)), tones) >= decibel(spec.delta_y)
    return tones if keeps else Scheme("spur-free")


def sets_db(spec: Spec, resonance_hz: np.ndarray, mass: np.ndarray, scheme: Scheme) -> float:
    """Return the all-state selectivity in dB of the worst of the spec's sets, which the channels (n,) join in turn."""
    level, sets = level_law(spec)(resonance_hz), spec.coil.sets
    dealt = (slice(k, None, sets) for k in range(sets))
    return min(all_states(channels(resonance_hz[k], spec.q_min, level[k], mass[k]), scheme).db for k in dealt)
