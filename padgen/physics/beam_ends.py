"""Compliance of a beam's ends: the frame at its root and the plate at its tip, by laws fitted to 3-D elasticity.

Each law has the right limits and a few constants. The constants were fitted to 3-D elasticity of random printed taxels
(`docs/measure_campaign.py`, docs/accuracy.md):

- An end turns about as much as a piece of beam that is as long as the beam is thick, less where the beam is flared. A
  root turns no more than a piece as long as the frame behind it is deep. Frame and plate reach higher than the beam, so
  the ends turn about points above its axis.
- The tip bends the wall between the plate's edge and the recess, or twists and bends the yoke that carries the plate.
- Layers that hold less well to each other make the ends softer, by a power of the ratio of the two stiffnesses.
- Ends keep the section from curling (anticlastic curvature) and from warping (Vlasov: each end shortens a ribbon in
  torsion by about ``w √((1+ν)/24)``).
"""

from math import inf
from typing import Any, NamedTuple

import numpy as np

from padgen.physics.beams import BeamSection, EndCompliance, torsion_constant

__all__ = ["Surroundings", "YokeSize", "fitted", "on_elastic_ends"]

Array = Any

# Constants of the laws, all fitted.
CURL = 0.92
ROOT = 0.63
ROOT_HEIGHT = 0.66
FRAME = 0.82
TIP = 0.57
TIP_HEIGHT = 0.42
NARROW = 0.16
WALL = 1.37
BURIED = 2.64
THIN = 1.8
SPREAD = 4.65
DROP = 8.76
DROP_NARROW = 0.35
SIDE = 0.54
SIDE_NARROW = 0.024
SLIDE = 0.22
TWIST = 0.34
WARPING = 0.59
LAYERS = 0.35
LAYERS_WALL = 0.71
BAR_WARPING = 0.33
BAR_SIDE = 2.39
BAR_PULL = 1.62
NECK = 0.37
SHORTEST_THICKNESSES = 1.2
SHORTEST_WIDTHS = 0.25
"""Shortest beams that the laws were fitted to: length over thickness, and length over width."""


class YokeSize(NamedTuple):
    """A yoke: a crossbar between the beams and a neck that carries the plate. All sizes in m.

    `arm` is the free part of the bar between beam and neck, `bar_width` its width along the beam, `height` the height
    of bar and neck.
    """

    arm: Array
    bar_width: Array
    height: Array
    neck_length: Array
    neck_width: Array


class Surroundings(NamedTuple):
    """The parts that hold a beam's ends, in m.

    `frame` is the depth of the frame behind the root, up to the part that holds the frame. The plate at the tip has a
    `wall` between its edge and the recess, which is `recess_depth` deep and has `recess_radius`; or a `yoke` in place
    of both.
    """

    frame: Array
    wall: Array
    recess_depth: Array
    recess_radius: Array
    yoke: YokeSize | None = None


def on_elastic_ends(section: BeamSection, around: Surroundings, poisson: Array) -> BeamSection:
    """Return the beam with the compliance of its ends filled in; sizes are numbers, or arrays of one shape, in m."""
    width, thickness, length = (np.asarray(v, float) for v in section[:3])
    across = np.asarray(section.across, float)
    softer = across**-LAYERS
    flared = np.sqrt(width / (width + 2 * np.asarray(section.fillet)))
    side = 1 / (SIDE * width) + SIDE_NARROW / thickness
    mount, sideways, twisted, stretched = (_yoke_compliance if around.yoke else _wall_compliance)(
        section, around, poisson
    )
    tall = thickness / np.sqrt(across)
    held = _warping_length(WARPING, width, tall, inf if section.path else length, poisson)
    ends = EndCompliance(
        root=softer * flared / (1 / (ROOT * thickness) + 1 / (FRAME * around.frame)),
        tip=softer / (1 / (TIP * thickness) + NARROW / width) + mount,
        lateral_root=softer * flared**4 / (side + 1 / (FRAME * around.frame)),
        lateral_tip=softer / side + sideways,
        shear=softer / (1 / (DROP * thickness) + DROP_NARROW / width),
        lateral_shear=SLIDE * width,
        twist=TWIST / (1 / width + 1 / thickness) - (0.0 if section.path else held) + twisted,
        stiffening=1 + poisson**2 / (1 - poisson**2) / (1 + (CURL * length / width) ** 2),
        root_height=ROOT_HEIGHT * thickness,
        tip_height=TIP_HEIGHT * thickness,
        stretch=stretched,
        mount=mount,
        # Bends (about the vertical) keep a tall strip from warping; the warping of a flat one goes on round them.
        warping=np.where(tall > width, held, 0.0) if section.path else 0.0,
    )
    return section._replace(ends=ends)


def fitted(width: Array, thickness: Array, length: Array) -> Array:
    """Return where a beam is long enough, for its width and thickness, for the range that the laws were fitted to."""
    return (length >= SHORTEST_THICKNESSES * thickness) & (length >= SHORTEST_WIDTHS * width)


def _wall_compliance(section: BeamSection, around: Surroundings, poisson: Array) -> tuple[Array, ...]:
    """Compliance of the wall between edge and recess: in bending, and zero in lateral bending, twist and stretch.

    Each is a length of beam of equal compliance in m. The wall hangs from the roof of the recess like a plate, as high
    as the recess is deep, and spreads the moment over that height. A thick beam reaches the roof itself.
    """
    width, thickness = (np.asarray(v, float) for v in section[:2])
    depth = np.asarray(around.recess_depth, float)
    # The recess is round, so the wall is thicker away from its middle.
    wall = around.wall + width**2 / (24 * around.recess_radius)
    hanging = np.maximum(1 - thickness / (BURIED * depth), 0)
    bent = WALL * depth * hanging * (thickness / wall) ** THIN * width / (width + SPREAD * depth)
    return bent * np.asarray(section.across, float) ** -LAYERS_WALL, 0.0, 0.0, 0.0


def _yoke_compliance(section: BeamSection, around: Surroundings, poisson: Array) -> tuple[Array, ...]:
    """Compliance of the yoke: in bending, lateral bending, twist and stretch.

    Each is a length of beam of equal compliance in m: the beam's section constant over the bar's. Twist of the crossbar
    and bending of the neck add to bending; bending of the bar adds to the other three.
    """
    width, thickness = (np.asarray(v, float) for v in section[:2])
    assert around.yoke is not None
    across, (arm, bar, height, neck_length, neck_width) = np.asarray(section.across, float), around.yoke
    free = arm + bar - _warping_length(BAR_WARPING, bar, height / np.sqrt(across), arm, poisson)
    bending, shear = width * thickness**3, 2 * (1 + poisson)
    mount = bending / 12 * shear * free / torsion_constant(bar, height, across)
    # The neck carries the moments of two beams.
    mount = mount + NECK * 2 * neck_length * bending / (neck_width * height**3)
    sideways = BAR_SIDE * arm * thickness * width**3 / (height * bar**3)
    twisted = arm * torsion_constant(width, thickness, across) * 12 / shear / (bar * height**3)
    return mount, sideways, twisted, BAR_PULL * 4 * arm**3 * width * thickness / (height * bar**3)


def _warping_length(share: float, one: Array, other: Array, length: Array, poisson: Array) -> Array:
    """Return how much shorter in m a bar of section `one` × `other` acts in torsion because its ends cannot warp."""
    slim = np.minimum(one, other) / np.maximum(one, other)
    warping = 2 * share * np.maximum(one, other) * np.sqrt((1 + poisson) / 24) * (1 - slim**2)
    return warping * np.tanh(length / np.maximum(warping, 1e-12))
