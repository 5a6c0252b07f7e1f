"""What two tiles of a pad share: polynomials on their side faces, continuous around the tile.

A tile is a box `size` wide, in coordinates (ξ, η, ζ) that run from -1 to 1. Its interface functions are
products of a shape in the plane and a Legendre polynomial in ζ, for each of the three displacements::

    y ^   3 ---- north ---- 2        vertex: (1±ξ)/2 (1±η)/2
      |   |                 |        face, degree j ≥ 2: integrated Legendre L_j along the face,
      |  west             east       linear to 0 at the opposite face
      |   |                 |
      |   0 ---- south ---- 1
      +-----> x

They depend on nothing but the tile's outline, so tiles with different meshes fit together. Where the
underside is held every polynomial in ζ is multiplied by (1+ζ)/2.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

__all__ = [
    "FACES",
    "VERTICES",
    "Degrees",
    "Function",
    "height_shape",
    "interface_functions",
    "plane_shape",
    "quarter_turned",
]

FACES = {"south": (0, 1), "east": (1, 2), "north": (3, 2), "west": (0, 3)}
"""The vertices at a face's two ends, in the direction of rising x or y."""
VERTICES = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_TURNED_FACE = {"south": "east", "east": "north", "north": "west", "west": "south"}
_FLIPPED = ("east", "west")
"""Faces whose direction is reversed when the tile is turned by +90°."""


class Degrees(NamedTuple):
    """Degrees of the interface polynomials, `along` a face and `through` the frame's height."""

    along: int = 5
    through: int = 2


class Function(NamedTuple):
    """One interface function: of a vertex number (`degree` 1) or of a face; `height` counts its ζ shapes, and
    `axis` is its displacement, 0 to 2."""

    place: int | str
    degree: int
    height: int
    axis: int


def interface_functions(faces: Iterable[str], degrees: Degrees, held_vertices: Iterable[int] = ()) -> list[Function]:
    """The functions of a tile that meets others at `faces`, vertices first; vertices held still have none."""
    faces, held = list(faces), set(held_vertices)
    vertices = sorted({vertex for face in faces for vertex in FACES[face]} - held)
    places: list[tuple[int | str, int]] = [(vertex, 1) for vertex in vertices]
    places += [(face, degree) for face in faces for degree in range(2, degrees.along + 1)]
    return [
        Function(*place, height, axis) for place in places for height in range(degrees.through + 1) for axis in range(3)
    ]


def quarter_turned(function: Function) -> tuple[Function, float]:
    """The function and its sign after the tile is turned by +90° about z."""
    place, degree, height, axis = function
    sign = -1.0 if axis == 1 else 1.0
    if isinstance(place, int):
        turned: int | str = (place + 1) % 4
    else:
        turned = _TURNED_FACE[place]
        sign *= (-1.0) ** degree if place in _FLIPPED else 1.0
    return Function(turned, degree, height, (1, 0, 2)[axis]), sign


def plane_shape(place: int | str, degree: int, xi: Any, eta: Any) -> Any:
    """The plane part of a function at points of the plan view: arrays, or coefficient functions of an engine."""
    if isinstance(place, int):
        x, y = VERTICES[place]
        return (1 + x * xi) / 2 * ((1 + y * eta) / 2)
    along, across = (xi, eta) if place in ("south", "north") else (eta, xi)
    side = 1 if place in ("east", "north") else -1
    return (_legendre(degree, along) - _legendre(degree - 2, along)) * ((1 + side * across) / 2)


def height_shape(height: int, zeta: Any, held_below: bool) -> Any:
    """The part of a function through the height: a Legendre polynomial, 0 at ζ = -1 if held there."""
    shape = _legendre(height, zeta)
    return shape * ((1 + zeta) / 2) if held_below else shape


def _legendre(degree: int, s: Any) -> Any:
    before, value = 0.0 * s, 1.0 + 0.0 * s
    for k in range(degree):
        before, value = value, ((2 * k + 1) * s * value - k * before) / (k + 1)
    return value
