"""Estimate the error of a taxel's beam model from the energy of its modes in each uncertain part.

A part with the relative uncertainty u that holds the share s of a mode's energy moves the frequency to ``f/√(1 − u
s)``: by u s/2 to first order (Rayleigh), and by more where one part holds nearly all the energy. Uncertain are the
fitted compliances (`padgen.physics.beams`) and the effects that the model leaves out. The uncertainties were fitted
to the errors of random taxels against 3-D elasticity (`docs/measure_campaign.py`): the error of a working mode is
within the estimate in about 94 of 100 cases (docs/accuracy.md).
"""

from typing import Any, NamedTuple

import numpy as np

from padgen.physics.beams import (
    BeamSection,
    EndCompliance,
    Flexibility,
    flexibility,
    root_load,
    sharp_energies,
    tip_stiffness,
)
from padgen.physics.modes import BeamPlacement, Modes

__all__ = ["BENT", "FLOOR", "UNCERTAINTY", "Plate", "relative_error", "uncertain_energies"]

Array = Any

FLOOR = 0.008
"""Relative error that remains for slender beams: mass of the flares, rounding of the edges, the references' own error.
"""
OTHERS, OTHERS_FLOOR, OTHERS_RISE = 2.5, 0.02, 0.008
"""For all modes but the working one: a factor on the error from the uncertainties, its floor, and the floor's rise per
unit of frequency ratio to the working mode.
"""
BENT = 0.013
"""Floor for beams that bend round corners, from serpentines (docs/accuracy.md). Modes where the beams themselves swing,
far above the working one, may be off by more (`padgen.physics.bounds.beam_inertia`).
"""
UNCERTAINTY = {
    "root": 0.47,
    "tip": 0.097,
    "mount": 0.3,
    "curl": 0.13,
    "lateral root": 0.81,
    "lateral tip": 0.81,
    "shear": 0.99,
    "lateral shear": 1.1,
    "twist": 0.54,
    "plate": 0.2,
    "bends": 0.7,
    "warping": 0.4,
}
"""Relative uncertainty of each flexibility, in the order of `uncertain_energies`; the last two are `sharp_energies`."""
PLATE = list(UNCERTAINTY).index("plate")
"""Place of the plate among them."""

MOST_SOFTER = 0.8
"""Largest share of all flexibility that is taken as missing."""


class Plate(NamedTuple):
    """The plate that the model takes as rigid, in m; `thickness` is that of the part above the recess."""

    length: Array
    width: Array
    thickness: Array


def uncertain_energies(beam: BeamPlacement, modes: Modes, modulus: float, poisson: float, plate: Plate) -> np.ndarray:
    """Return twice the energy (…, 6, parts) in 1/s² that each mode has in each uncertain flexibility of one beam.

    The modes are mass-normalised; the parts are those of `UNCERTAINTY`, in its order.
    """
    width, thickness, length, fillet = (_beside_modes(v) for v in beam.section[:4])
    ends = EndCompliance(*(_beside_modes(v) for v in beam.section.ends))
    path = tuple((_beside_modes(length), _beside_modes(turn)) for length, turn in beam.section.path)
    section = BeamSection(width, thickness, length, fillet, ends, path, _beside_modes(beam.section.across))
    load = _tip_load(beam, modes, modulus, poisson)
    parts = flexibility(section, modulus, poisson)
    along, side, up, about_x, about_y, about_z = np.moveaxis(load, -1, 0)
    _, root_y, root_z = np.moveaxis(root_load(section, load)[..., 3:], -1, 0)
    at_tip = (about_y - ends.tip_height * along) ** 2
    mount = parts.tip * ends.mount / np.where(ends.tip, ends.tip, 1.0)
    plate_inertia = plate.width * plate.thickness**3 / 12
    energies = [
        parts.root * (root_y - ends.root_height * along) ** 2,
        (parts.tip - mount) * at_tip,
        mount * at_tip,
        0.0 * up if path else (ends.stiffening - 1) * _bending(parts, up, about_y),
        parts.lateral_root * root_z**2,
        parts.lateral_tip * about_z**2,
        parts.end_shear * up**2,
        parts.lateral_end_shear * side**2,
        parts.twist * np.minimum(np.maximum(width, thickness) / length, 1) * about_x**2,
        _beside_modes(plate.length / (modulus * plate_inertia)) * about_y**2,
        *(sharp_energies(section, load, modulus, poisson) if path else (0.0 * up, 0.0 * up)),
    ]
    return np.stack(np.broadcast_arrays(*energies), -1)


def relative_error(
    energies: np.ndarray, frequency_hz: np.ndarray, working: np.ndarray, floor: Array = FLOOR
) -> np.ndarray:
    """Return the relative error (…, 6) of each frequency from the energies (…, 6, parts) of all beams.

    It is at least `floor`. For modes other than the `working` one (…,) the model leaves out more: how yoke, wall and
    plate yield along and across the beam, and the beams' inertia. Their estimate is larger accordingly.
    """
    share = energies / (2 * np.pi * frequency_hz[..., None]) ** 2 / 2
    share[..., PLATE] /= 1 + share[..., PLATE]  # first order in the plate's share would overrate a very flexible plate
    moved = np.sqrt(((np.array(list(UNCERTAINTY.values())) * share) ** 2).sum(-1))
    at = np.asarray(working)[..., None]
    ratio = frequency_hz / np.take_along_axis(frequency_hz, at, -1)
    others = np.hypot(OTHERS * moved, np.maximum(OTHERS_FLOOR + OTHERS_RISE * ratio, floor))
    own = 1 / np.sqrt(1 - np.minimum(2 * moved, MOST_SOFTER)) - 1
    return np.asarray(np.where(np.arange(6) == at, np.hypot(own, floor), others))


def _bending(parts: Flexibility, up: Array, about_y: Array) -> Array:
    """Return twice the energy of vertical bending under a force `up` and a moment `about_y` on the tip."""
    up0, up1, up2 = parts.up
    return up2 * up**2 - 2 * up1 * up * about_y + up0 * about_y**2


def _beside_modes(value: Array) -> np.ndarray:
    """Return the value as an array with a last axis of length 1, for the modes."""
    return np.asarray(value, float)[..., None]


def _tip_load(beam: BeamPlacement, modes: Modes, modulus: float, poisson: float) -> np.ndarray:
    """Return forces and moments (…, 6 modes, 6) on the beam's tip, in the beam's axes."""
    motion = np.concatenate([modes.at_point(beam.tip), modes.shape[..., 3:, :]], -2)
    cosine, sine = np.moveaxis(beam.direction, -1, 0)[..., None, None]
    turned = motion.copy()
    for x, y in ((0, 1), (3, 4)):
        turned[..., [x], :] = cosine * motion[..., [x], :] + sine * motion[..., [y], :]
        turned[..., [y], :] = cosine * motion[..., [y], :] - sine * motion[..., [x], :]
    return np.swapaxes(tip_stiffness(beam.section, modulus, poisson) @ turned, -1, -2)
