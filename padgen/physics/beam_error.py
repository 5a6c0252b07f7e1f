"""How far the beam model of a taxel may be off, from where its modes keep their energy.

A relative error u of a flexibility that holds the share s of a mode's energy moves the frequency by
u s/2 (Rayleigh). What is uncertain is what was fitted (`padgen.physics.beam_ends`) and what is left
out: the uncertainties were fitted to the errors against 3-D elasticity (docs/accuracy.md).
"""

from typing import Any, NamedTuple

import numpy as np

from padgen.physics.beams import BeamSection, Flexibility, Give, flexibility, root_load, tip_stiffness
from padgen.physics.modes import BeamPlacement, Modes

__all__ = ["BENT", "FLOOR", "UNCERTAINTY", "HeldBy", "relative_error", "uncertain_energies"]

Array = Any

FLOOR = 0.0045
"""What remains for slender beams: mass of the flares, rounding of the edges, the references' own error."""
BENT = 0.05
"""The same for beams that bend round corners, to which nothing was fitted, taken wide (docs/accuracy.md). Modes where
the beams themselves swing, far above the working one, may be off by more (`padgen.physics.bounds.beam_inertia`)."""
UNCERTAINTY = {
    "root": 0.11,
    "tip": 0.17,
    "curl": 0.05,
    "lateral root": 0.22,
    "lateral tip": 0.28,
    "shear": 0.23,
    "lateral shear": 0.4,
    "twist": 0.2,
    "plate": 0.25,
    "crossbar": 1.3,
}
"""Relative uncertainty of each flexibility, in the order of `uncertain_energies`."""


class HeldBy(NamedTuple):
    """What the model takes as rigid: plate in m (its thickness above the recess), and `twist_per_m3`, the
    arm of a crossbar over its torsion constant, 0 where there is none."""

    plate_length: Array
    plate_width: Array
    plate_thickness: Array
    twist_per_m3: Array


def uncertain_energies(
    beam: BeamPlacement, modes: Modes, modulus: float, poisson: float, held_by: HeldBy
) -> np.ndarray:
    """Twice the energy (…, 6, parts) in 1/s² that each mode keeps in each uncertain flexibility of one beam."""
    width, thickness, length, fillet = (_beside_modes(v) for v in beam.section[:4])
    give = Give(*(_beside_modes(v) for v in beam.section.give))
    path = tuple((_beside_modes(length), _beside_modes(turn)) for length, turn in beam.section.path)
    section = BeamSection(width, thickness, length, fillet, give, path)
    load = _tip_load(beam, modes, modulus, poisson)
    parts = flexibility(section, modulus, poisson)
    _, side, up, about_x, about_y, about_z = np.moveaxis(load, -1, 0)
    root_y, root_z = np.moveaxis(root_load(section, load)[..., 4:], -1, 0)
    plate_inertia = held_by.plate_width * held_by.plate_thickness**3 / 12
    plate = _beside_modes(held_by.plate_length / (modulus * plate_inertia))
    crossbar = _beside_modes(held_by.twist_per_m3 * 2 * (1 + poisson) / modulus)
    energies = [
        parts.root * root_y**2,
        parts.tip * about_y**2,
        0.0 * up if path else (give.stiffening - 1) * _bending(parts, up, about_y),
        parts.lateral_root * root_z**2,
        parts.lateral_tip * about_z**2,
        parts.end_shear * up**2,
        parts.lateral_end_shear * side**2,
        parts.twist * np.minimum(np.maximum(width, thickness) / length, 1) * about_x**2,
        plate * about_y**2,
        crossbar * (about_x**2 + about_z**2),
    ]
    return np.stack(np.broadcast_arrays(*energies), -1)


def relative_error(energies: np.ndarray, frequency_hz: np.ndarray, floor: float = FLOOR) -> np.ndarray:
    """Relative error (…, 6) of each frequency from the energies (…, 6, parts) of all beams, at least `floor`."""
    whole = (2 * np.pi * frequency_hz[..., None]) ** 2
    moved = np.array(list(UNCERTAINTY.values())) * energies / whole / 2
    return np.asarray(np.sqrt(floor**2 + (moved**2).sum(-1)))


def _bending(parts: Flexibility, up: Array, about_y: Array) -> Array:
    up0, up1, up2 = parts.up
    return up2 * up**2 - 2 * up1 * up * about_y + up0 * about_y**2


def _beside_modes(value: Array) -> np.ndarray:
    return np.asarray(value, float)[..., None]


def _tip_load(beam: BeamPlacement, modes: Modes, modulus: float, poisson: float) -> np.ndarray:
    """Forces and moments (…, 6 modes, 6) on the beam's tip in its own axes."""
    motion = np.concatenate([modes.at_point(beam.tip), modes.shape[..., 3:, :]], -2)
    cosine, sine = np.moveaxis(beam.direction, -1, 0)[..., None, None]
    turned = motion.copy()
    for x, y in ((0, 1), (3, 4)):
        turned[..., [x], :] = cosine * motion[..., [x], :] + sine * motion[..., [y], :]
        turned[..., [y], :] = cosine * motion[..., [y], :] - sine * motion[..., [x], :]
    return np.swapaxes(tip_stiffness(beam.section, modulus, poisson) @ turned, -1, -2)
