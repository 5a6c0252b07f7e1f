"""What a beam's ends give: the frame under its root, the plate at its tip, by laws fitted to elasticity.

Each law has the form that its limits ask for and a few constants, fitted to 3-D elasticity of printed
taxels (`docs/measure_beams.py`, docs/accuracy.md):

- an end turns about as much as a piece of beam as long as the beam is thick, less where the beam is
  narrow (it then presses on a small patch), and a root no more than a piece as long as the frame is
  deep behind it;
- the tip bends the wall between the plate's edge and the recess;
- ends keep the section from curling (anticlastic curvature) and from warping (Vlasov: each end shortens
  a ribbon in torsion by about ``w √((1+ν)/24)``).
"""

from typing import Any, NamedTuple

import numpy as np

from padgen.physics.beams import BeamSection, Give

__all__ = ["Surroundings", "fitted", "on_elastic_ends"]

Array = Any

CURL = 0.84
ROOT = 0.67
FRAME = 1.07
TIP = 0.6
NARROW = 0.34
WALL = 1.7
BURIED = 0.63
DROP = 7.9
DROP_NARROW = 0.39
SIDE = 0.61
SIDE_NARROW = 0.2
SLIDE = 0.28
TWIST = 0.79
WARPING = 0.9
ROOT_ACROSS=.5
TIP_ACROSS=.5
WALL_ACROSS=.7
SIDE_ACROSS=.3
DROP_ACROSS=.8
SHORTEST_THICKNESSES = 1.2
SHORTEST_WIDTHS = 0.25
"""Lengths of beam over thickness and width down to which the laws were fitted."""


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
    across = np.asarray(section.across, float)
    flared = width / (width + 2 * np.asarray(section.fillet))
    give = Give(
        root=across**-ROOT_ACROSS * flared / (1 / (ROOT * thickness) + 1 / (FRAME * around.frame)),
        tip=across**-TIP_ACROSS / (1 / (TIP * thickness) + NARROW / width) + _wall_give(section, around) * across**-WALL_ACROSS,
        lateral_root=across**-SIDE_ACROSS * flared**2 / (1 / (SIDE * width) + SIDE_NARROW / thickness + 1 / (FRAME * around.frame)),
        lateral_tip=across**-SIDE_ACROSS / (1 / (SIDE * width) + SIDE_NARROW / thickness),
        shear=across**-DROP_ACROSS / (1 / (DROP * thickness) + DROP_NARROW / width),
        lateral_shear=SLIDE * width,
        twist=_twist(width, thickness, length, poisson),
        stiffening=1 + poisson**2 / (1 - poisson**2) / (1 + (CURL * length / width) ** 2),
    )
    return section._replace(give=give)


def fitted(width: Array, thickness: Array, length: Array) -> Array:
    """Whether a beam is as long beside its width and thickness as those that the laws were fitted to."""
    return (length >= SHORTEST_THICKNESSES * thickness) & (length >= SHORTEST_WIDTHS * width)


def _wall_give(section: BeamSection, around: Surroundings) -> Array:
    """What the wall between edge and recess adds: it hangs from the roof of the recess like a plate, as
    high as the recess is deep, and spreads the moment by that; a thick beam reaches the roof itself."""
    width, thickness = (np.asarray(v, float) for v in section[:2])
    depth = np.asarray(around.recess_depth, float)
    # A recess is round: beside the middle the wall is thicker.
    wall = around.wall + width**2 / (24 * around.recess_radius)
    hanging = np.exp(-thickness / np.maximum(BURIED * depth, 1e-9))
    return WALL * depth * hanging * (thickness / wall) ** 3 * width / (width + 2 * depth)


def _twist(width: Array, thickness: Array, length: Array, poisson: Array) -> Array:
    """Length that local twist adds, less what held warping takes."""
    slim = np.minimum(width, thickness) / np.maximum(width, thickness)
    warping = WARPING * np.maximum(width, thickness) * np.sqrt((1 + poisson) / 24) * (1 - slim**2)
    held = 2 * warping * np.tanh(length / np.maximum(2 * warping, 1e-12))
    return TWIST / (1 / width + 1 / thickness) - held
