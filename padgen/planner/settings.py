"""Translate a spec's `[drive]` table for the physics: its level law and its drive schemes."""

import numpy as np

from padgen.core.errors import at_least
from padgen.core.registry import SCHEMES
from padgen.core.units import decibel
from padgen.physics.ladder import LevelLaw
from padgen.physics.selectivity import Scheme, all_states, channels
from padgen.spec import Spec

__all__ = ["CARRIER_OVER_RESONANCE", "carrier_hz", "level_law", "passes", "scheme_for", "scheme_named", "sets_db"]


def level_law(spec: Spec) -> LevelLaw:
    """Return the level law of a spec: a power of frequency, or equal sensation where it has a threshold curve."""
    drive = spec.drive
    return LevelLaw(drive.level_law, drive.threshold_hz or (), drive.threshold_um or ())


def scheme_named(spec: Spec, name: str) -> Scheme:
    """Return the drive scheme called `name` with the settings of `spec`."""
    return Scheme(name, spec.drive.bias_ratio, SCHEMES.version(name))


CARRIER_OVER_RESONANCE = 5
"""The carrier over the highest resonance: at twice the carrier a pull of i² is then ten times above every taxel."""


def carrier_hz(spec: Spec, scheme: Scheme, highest_hz: float) -> float | None:
    """Return the carrier on which an AC-coupled amplifier plays a spur-free scheme; None where none is needed."""
    needed = spec.amplifier is not None and spec.amplifier.coupling == "AC" and scheme.is_root
    return float(at_least(CARRIER_OVER_RESONANCE * highest_hz)) if needed else None


def passes(spec: Spec, scheme: Scheme) -> bool:
    """Return whether the spec's amplifier can play a scheme; one that is AC coupled passes no constant current."""
    return spec.amplifier is None or spec.amplifier.coupling == "DC" or not scheme.is_biased


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
