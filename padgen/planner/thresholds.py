"""Choose the threshold of feeling for a spec's taxels, from the catalogue or from the spec's own curve."""

from functools import lru_cache
from math import pi

import numpy as np

from padgen.core.units import MM, UM
from padgen.physics.ladder import LevelLaw
from padgen.physics.sensation import Threshold, for_area
from padgen.spec import Spec
from padgen.spec.load import catalogue

__all__ = ["SENSATION", "detection_threshold", "level_law", "threshold_at"]

SENSATION = "sensation"
"""The `drive.level_law` of equal sensation."""
SITE = "fingertip"
SURROUND = "plate"
FARTHEST_HZ = (1e-3, 1e7)
"""The ends to which a threshold is continued for level laws: those of a spec's own curve."""


@lru_cache(maxsize=64)
def threshold_at(site: str, surround: str, area_mm2: float) -> Threshold:
    """Return the threshold of feeling at a body site through a contactor of an area, by the catalogue's rows.

    Only rows with this `surround` count.
    """
    rows = [row for row in catalogue("threshold").values() if (row["site"], row["surround"]) == (site, surround)]
    if not rows:
        raise ValueError(f"no threshold is known of site {site!r} with surround {surround!r}")
    known = [
        Threshold(np.array(row["hz"]), np.array(row["db"]), row["error_db"], row["area_mm2"] * MM**2) for row in rows
    ]
    return for_area(known, area_mm2 * MM**2)


def detection_threshold(spec: Spec) -> Threshold:
    """Return the threshold under a fingertip on a taxel's boss: the spec's own curve, or the catalogue's."""
    drive = spec.drive
    area_mm2 = pi / 4 * spec.contact_diameter_mm**2
    if drive.threshold_hz and drive.threshold_um:
        return Threshold(np.array(drive.threshold_hz), 20 * np.log10(drive.threshold_um), 0.0, area_mm2 * MM**2)
    return threshold_at(SITE, SURROUND, area_mm2)


def level_law(spec: Spec) -> LevelLaw:
    """Return the level law of a spec: a power of frequency, or equal sensation by its own curve or the catalogue's."""
    drive = spec.drive
    if drive.threshold_hz or drive.level_law != SENSATION:
        exponent = 1.0 if isinstance(drive.level_law, str) else drive.level_law
        return LevelLaw(exponent, drive.threshold_hz or (), drive.threshold_um or ())
    threshold = detection_threshold(spec)
    hz = np.union1d(threshold.hz, FARTHEST_HZ)
    return LevelLaw(1.0, tuple(hz.tolist()), tuple((threshold.amplitude(hz) / UM).tolist()))
