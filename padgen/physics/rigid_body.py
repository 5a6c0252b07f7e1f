"""Mass, centroid and inertia of bodies composed of boxes and rings."""

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
    """Return a box between two corners in m, `density` in kg/m³; a negative density cuts it out."""
    x, y, z = (np.subtract(h, b) for b, h in zip(low, high, strict=True))
    mass = density * (x * y * z)
    share = mass / 12
    moments = share * (y**2 + z**2), share * (x**2 + z**2), share * (x**2 + y**2)
    return _upright(mass, tuple(np.add(h, b) / 2 for b, h in zip(low, high, strict=True)), moments)


def ring(
    centre: tuple[Array, Array], z_low: Array, z_high: Array, outer: Array, inner: Array, density: float
) -> RigidBody:
    """Return an upright ring (a disc for `inner` = 0) by its diameters in m; `density` in kg/m³."""
    height = np.subtract(z_high, z_low)
    mass = density * np.pi / 4 * (np.square(outer) - np.square(inner)) * height
    square = np.square(outer) + np.square(inner)
    radial = mass * (square / 16 + height**2 / 12)
    return _upright(mass, (*centre, np.add(z_low, z_high) / 2), (radial, radial, mass * square / 8))


def _upright(mass: Array, centre: tuple[Array, ...], moments: tuple[Array, ...]) -> RigidBody:
    """Return a body with main axes of inertia along x, y and z, with all parts broadcast to one shape."""
    shape = np.broadcast_shapes(*(np.shape(part) for part in (mass, *centre, *moments)))
    whole, at, inertia = np.empty(shape), np.empty((*shape, 3)), np.zeros((*shape, 3, 3))
    whole[...] = mass
    for i in range(3):
        at[..., i], inertia[..., i, i] = centre[i], moments[i]
    return RigidBody(whole, at, inertia)


def combine(*bodies: RigidBody) -> RigidBody:
    """Return the bodies as one, by Steiner's theorem."""
    mass: Any = sum(b.mass for b in bodies)
    centroid = sum(b.mass[..., None] * b.centroid for b in bodies) / mass[..., None]
    inertia: Any = 0.0
    for body in bodies:
        arm = body.centroid - centroid
        square = (arm * arm).sum(-1)[..., None, None] * _ONE
        inertia = inertia + body.inertia + body.mass[..., None, None] * (square - arm[..., :, None] * arm[..., None, :])
    return RigidBody(np.asarray(mass), centroid, inertia)


_ONE = np.eye(3)
