"""What a beam's ends give: the frame under its root, the plate at its tip, by laws fitted to elasticity.

Each law has the form that its limits ask for and a few constants, fitted to 3-D elasticity of printed
taxels (`docs/measure_beams.py`, docs/accuracy.md):

- an end turns about as much as a piece of beam as long as the beam is thick, less where the beam is
  narrow (it then presses on a small patch), and a root no more than a piece as long as the frame is
  deep behind it;
- a thin beam at the tip bends the wall between the plate's edge and the recess;
- ends keep the section from curling (anticlastic curvature) and from warping (Vlasov: each end shortens
  a ribbon in torsion by about ``w √((1+ν)/24)``).
"""

from typing import Any, NamedTuple

import numpy as np

from padgen.physics.beams import BeamSection, Give

__all__ = ["Surroundings", "on_elastic_ends"]

Array = Any

CURL = 0.66
ROOT = 0.73
FRAME = 1.25
TIP = 0.58
NARROW = 0.29
WALL = 0.165
DROP = 7.3
DROP_NARROW = 0.355
SIDE = 0.68
SIDE_NARROW = 0.21
SLIDE = 0.2
TWIST = 0.62
WARPING = 0.9
THIN_WALL = 2.0
"""Depth of the recess over the wall beside it up to which a thin wall was fitted."""


class Surroundings(NamedTuple):
    """What a beam's ends are held by, in m: depth of the frame behind the root up to what holds it; at the
    tip the wall between the plate's edge and the recess, that recess' depth (0: none near) and radius."""

    frame: Array
    wall: Array
    recess_depth: Array
    recess_radius: Array


def on_elastic_ends(section: BeamSection, around: Surroundings, poisson: Array) -> BeamSection:
    """The same beam with what its ends give; arrays of one shape, or numbers, in m."""
    width, thickness, length = (np.asarray(v, float) for v in section[:3])
    flared = width / (width + 2 * np.asarray(section.fillet))
    give = Give(
        root=flared / (1 / (ROOT * thickness) + 1 / (FRAME * around.frame)),
        tip=1 / (1 / (TIP * thickness) + NARROW / width) + _wall_give(section, around),
        lateral_root=flared**2 / (1 / (SIDE * width) + SIDE_NARROW / thickness + 1 / (FRAME * around.frame)),
        lateral_tip=1 / (1 / (SIDE * width) + SIDE_NARROW / thickness),
        shear=1 / (1 / (DROP * thickness) + DROP_NARROW / width),
        lateral_shear=SLIDE * width,
        twist=_twist(width, thickness, length, poisson),
        stiffening=1 + poisson**2 / (1 - poisson**2) / (1 + (CURL * length / width) ** 2),
    )
    return section._replace(give=give)


def _wall_give(section: BeamSection, around: Surroundings) -> Array:
    """What the wall between edge and recess adds; a recess is round, so the wall is thicker off the middle."""
    width, thickness = (np.asarray(v, float) for v in section[:2])
    depth = np.asarray(around.recess_depth, float)
    wall = around.wall + width**2 / (24 * around.recess_radius)
    buried = np.exp(-thickness / np.maximum(2 * depth, 1e-9))
    return WALL * thickness * np.minimum(depth / wall, THIN_WALL) ** 3 * buried


def _twist(width: Array, thickness: Array, length: Array, poisson: Array) -> Array:
    """Length that local twist adds, less what held warping takes."""
    slim = np.minimum(width, thickness) / np.maximum(width, thickness)
    warping = WARPING * np.maximum(width, thickness) * np.sqrt((1 + poisson) / 24) * (1 - slim**2)
    held = 2 * warping * np.tanh(length / np.maximum(2 * warping, 1e-12))
    return TWIST / (1 / width + 1 / thickness) - held
