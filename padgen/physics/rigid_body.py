"""Mass, centroid and inertia of a body composed of boxes, discs and points."""

from typing import Any, NamedTuple

import numpy as np

__all__ = ["RigidBody", "box", "combine", "ring"]

Array = Any


class RigidBody(NamedTuple):
    """A rigid body: `mass` (…) in kg, `centroid` (…, 3) in m, `inertia` (…, 3, 3) about it in kg·m²."""

    mass: np.ndarray
    centroid: np.ndarray
    inertia: np.ndarray


def box(low: tuple[Array, Array, Array], high: tuple[Array, Array, Array], density: float) -> RigidBody:
    """A box between two corners in m; a negative `density` cuts it out."""
    size = np.stack(np.broadcast_arrays(*(np.subtract(h, b) for b, h in zip(low, high, strict=True))), -1)
    centre = np.stack(np.broadcast_arrays(*(np.add(h, b) / 2 for b, h in zip(low, high, strict=True))), -1)
    mass = density * size.prod(-1)
    square = size**2
    moments = mass[..., None] / 12 * (square.sum(-1, keepdims=True) - square)
    return RigidBody(mass, centre, moments[..., None] * np.eye(3))


def ring(
    centre: tuple[Array, Array], z_low: Array, z_high: Array, outer: Array, inner: Array, density: float
) -> RigidBody:
    """An upright ring (or disc, `inner` = 0) by its diameters in m."""
    x, y, z, height, outer, inner = np.broadcast_arrays(
        centre[0], centre[1], np.add(z_low, z_high) / 2, np.subtract(z_high, z_low), outer, inner
    )
    mass = density * np.pi / 4 * (outer**2 - inner**2) * height
    radial = mass * ((outer**2 + inner**2) / 16 + height**2 / 12)
    axial = mass * (outer**2 + inner**2) / 8
    moments = np.stack([radial, radial, axial], -1)
    return RigidBody(mass, np.stack([x, y, z], -1), moments[..., None] * np.eye(3))


def combine(*bodies: RigidBody) -> RigidBody:
    """The bodies as one, by Steiner's theorem."""
    mass: Any = sum(b.mass for b in bodies)
    centroid = sum(b.mass[..., None] * b.centroid for b in bodies) / mass[..., None]
    inertia: Any = 0.0
    for body in bodies:
        arm = body.centroid - centroid
        square = (arm**2).sum(-1)[..., None, None] * np.eye(3)
        outer_product = arm[..., :, None] * arm[..., None, :]
        inertia = inertia + body.inertia + body.mass[..., None, None] * (square - outer_product)
    return RigidBody(np.asarray(mass), centroid, inertia)
