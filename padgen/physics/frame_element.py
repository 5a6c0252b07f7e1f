"""One straight Timoshenko element of a 3-D frame: its stiffness and its mass.

Element axes: x from start to end, z as near to the given `up` as is normal to x, y so that the axes are right-handed. A
node has six degrees of freedom: displacements x, y, z, rotations about x, y, z.

The static stiffness is exact for a uniform element (Przemieniecki, Theory of Matrix Structural Analysis, 1968, §5.6).
It is kept as a square root so that a frame can be solved without squaring its condition. The mass is consistent with
the static deflection, shear and rotary inertia included (Friedman and Kosmatka, Computers & Structures 47, 1993). In
addition an element may have inner motions, polynomials that vanish at its ends (Szabó and Babuška, Finite Element
Analysis, 1991, chapter 3), with which few elements give many digits.
"""

from typing import Any, NamedTuple

import numpy as np

from padgen.physics.beams import torsion_constant

__all__ = [
    "Element",
    "Section",
    "bubble_count",
    "circle",
    "element_axes",
    "element_mass_root",
    "element_root",
    "rectangle",
]

Array = Any

_PLANES = ((2, 4, -1.0), (1, 5, 1.0))
"""Bending in the planes up and across: displacement, rotation, and the sign of slope over rotation."""


class Section(NamedTuple):
    """A cross-section of an element.

    Area in m², second moments in m⁴ for bending `up` and `across`, torsion constant in m⁴, and shear coefficients in
    both planes.
    """

    area: float
    inertia_up: float
    inertia_across: float
    torsion: float
    shear_up: float
    shear_across: float

    @property
    def planes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Second moment in m⁴ and shear coefficient of bending up, then across."""
        return (self.inertia_up, self.shear_up), (self.inertia_across, self.shear_across)


class Element(NamedTuple):
    """An element between two nodes (by index) of one material, in SI units.

    `hinge_start` and `hinge_end` are the rotations in rad/(N·m) of its ends relative to the nodes, under bending
    moments in the planes up and across.
    """

    start: int
    end: int
    section: Section
    modulus: float
    shear_modulus: float
    density: float
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    hinge_start: tuple[float, float] = (0.0, 0.0)
    hinge_end: tuple[float, float] = (0.0, 0.0)


def rectangle(width: float, thickness: float, poisson: float, across: float = 1.0) -> Section:
    """Return the section of a rectangle, `thickness` upwards, in layers; sizes in m.

    `across` is as in `beams.BeamSection`; the shear coefficient is Cowper's (1966).
    """
    shear = 10 * (1 + poisson) / (12 + 11 * poisson)
    area, torsion = width * thickness, float(torsion_constant(width, thickness, across))
    return Section(area, area * thickness**2 / 12, area * width**2 / 12, torsion, shear * across, shear)


def circle(diameter: float, poisson: float) -> Section:
    """Return the section of a solid circle, `diameter` in m; the shear coefficient is Cowper's (1966)."""
    inertia = np.pi * diameter**4 / 64
    shear = 6 * (1 + poisson) / (7 + 6 * poisson)
    return Section(np.pi * diameter**2 / 4, inertia, inertia, 2 * inertia, shear, shear)


def element_axes(start: np.ndarray, end: np.ndarray, up: Array) -> np.ndarray:
    """Return the element's axes as rows (3, 3)."""
    x = (end - start) / np.linalg.norm(end - start)
    z = np.asarray(up, float) - x * (x @ np.asarray(up, float))
    z = z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def bubble_count(bubbles: int) -> int:
    """Return the number of inner degrees of freedom of an element."""
    return 6 * bubbles + 2 if bubbles else 0


def element_root(element: Element, length: float, bubbles: int = 0) -> np.ndarray:
    """Return the square root of the stiffness in element axes, shape (r, 12 + m): stiffness = rootᵀ root.

    The first twelve columns are the nodes' motions, with the static deflection between them; the others are the inner
    motions of degrees up to `bubbles` + 1. The two groups do no work on each other, since the static deflection needs
    forces at the ends alone.
    """
    section = element.section
    root = np.zeros((6, 12))
    root[0, [0, 6]] = np.array([-1.0, 1.0]) * np.sqrt(element.modulus * section.area / length)
    root[1, [3, 9]] = np.array([-1.0, 1.0]) * np.sqrt(element.shear_modulus * section.torsion / length)
    for plane in (0, 1):
        stiffness = np.linalg.inv(_bending_flexibility(element, length, plane, hinged=True))
        root[2 + 2 * plane : 4 + 2 * plane] = np.linalg.cholesky(stiffness).T @ _from_chord(length, plane)
    return _block_diagonal(root, _inner_root(element, length, bubbles))


def element_mass_root(element: Element, length: float, bubbles: int = 0) -> np.ndarray:
    """Return the square root of the consistent mass in element axes, shape (r, 12 + m), as `element_root`."""
    section = element.section
    rows = []
    points, weights = np.polynomial.legendre.leggauss(bubbles + 4)
    for s, weight in zip((points + 1) / 2, weights / 2, strict=True):
        inner = _bubbles(bubbles, s)
        each = np.sqrt(element.density * length * weight)
        for k, (start, inertia) in enumerate(((0, section.area), (3, section.inertia_up + section.inertia_across))):
            ends = np.zeros(12)
            ends[[start, start + 6]] = 1 - s, s
            rows.append(each * np.sqrt(inertia) * np.r_[ends, _inner(bubbles, k, inner.shift[:bubbles])])
        for plane, (inertia, _) in enumerate(section.planes):
            shift, turn = _shapes(element, length, plane, s)
            rows.append(each * np.sqrt(section.area) * np.r_[shift, _inner(bubbles, 2 + 2 * plane, inner.shift)])
            rows.append(
                each * np.sqrt(inertia) * np.r_[turn, _inner(bubbles, 3 + 2 * plane, inner.shift[:bubbles] / length)]
            )
    return np.array(rows)


class _Bubbles(NamedTuple):
    """Values and derivatives (by the share of the length) of polynomials of degree 2 … that vanish at both ends."""

    shift: np.ndarray
    slope: np.ndarray


def _bubbles(bubbles: int, s: float) -> _Bubbles:
    """Return integrated Legendre polynomials at the share `s` of the length: `bubbles` + 1 of them, or none for 0."""
    count = bubbles + 1 if bubbles else 0
    legendre = np.polynomial.legendre.legvander(np.array([2 * s - 1]), count + 1)[0]
    order = np.arange(1, count + 1)
    return _Bubbles((legendre[2:] - legendre[:-2]) / (2 * (2 * order + 1)), legendre[1 : count + 1])


def _inner(bubbles: int, kind: int, values: np.ndarray) -> np.ndarray:
    """Place `values` among an element's inner motions: stretch, twist, then shift and turn of each plane."""
    sizes = [bubbles, bubbles, bubbles + 1, bubbles, bubbles + 1, bubbles]
    row = np.zeros(bubble_count(bubbles))
    if bubbles:
        row[sum(sizes[:kind]) : sum(sizes[: kind + 1])] = values
    return row


def _inner_root(element: Element, length: float, bubbles: int) -> np.ndarray:
    """Return the square root of the inner motions' stiffness, with one row per strain and Gauss point."""
    section, shear_modulus = element.section, element.shear_modulus
    rows = []
    points, weights = np.polynomial.legendre.leggauss(bubbles + 2)
    for s, weight in zip((points + 1) / 2, weights / 2, strict=True):
        inner = _bubbles(bubbles, s)
        each = np.sqrt(weight / length)
        few = inner.slope[:bubbles]
        rows.append(each * np.sqrt(element.modulus * section.area) * _inner(bubbles, 0, few))
        rows.append(each * np.sqrt(shear_modulus * section.torsion) * _inner(bubbles, 1, few))
        for plane, (inertia, shear) in enumerate(section.planes):
            # Rotations are multiplied by the length, so that all inner motions are lengths.
            rows.append(each / length * np.sqrt(element.modulus * inertia) * _inner(bubbles, 3 + 2 * plane, few))
            gap = _inner(bubbles, 2 + 2 * plane, inner.slope) - _inner(bubbles, 3 + 2 * plane, inner.shift[:bubbles])
            rows.append(each * np.sqrt(shear * shear_modulus * section.area) * gap)
    return np.array(rows)


def _block_diagonal(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    whole = np.zeros((len(first) + len(second), first.shape[1] + second.shape[1]))
    whole[: len(first), : first.shape[1]] = first
    whole[len(first) :, first.shape[1] :] = second
    return whole


def _shear_ratio(element: Element, length: float, plane: int) -> float:
    """Return 12 EI / (κ G A l²), the share that shear adds to the bending of an element."""
    inertia, shear = element.section.planes[plane]
    return 12 * element.modulus * inertia / (shear * element.shear_modulus * element.section.area * length**2)


def _bending_flexibility(element: Element, length: float, plane: int, *, hinged: bool) -> np.ndarray:
    """Return the rotations of both ends against the chord under unit moments at them, shape (2, 2), in rad/(N·m)."""
    inertia, _ = element.section.planes[plane]
    shear = _shear_ratio(element, length, plane)
    free = length / (12 * element.modulus * inertia) * np.array([[4 + shear, shear - 2], [shear - 2, 4 + shear]])
    hinges = np.diag([element.hinge_start[plane], element.hinge_end[plane]])
    return np.asarray(free + hinges) if hinged else free


def _from_chord(length: float, plane: int) -> np.ndarray:
    """Return the matrix (2, 12) from the nodes' motions to the rotations of both ends against the chord, as slopes."""
    shift, turn, sign = _PLANES[plane]
    rows = np.zeros((2, 12))
    rows[:, [shift, shift + 6]] = np.array([1.0, -1.0]) / length
    rows[[0, 1], [turn, turn + 6]] = sign
    return rows


def _shapes(element: Element, length: float, plane: int, s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return displacement and rotation (as a slope) at the share `s` of the length, for the 12 node motions.

    They are the chord's motion plus the static deflection under the moments that the nodes' rotations cause. Shear
    bends the axis without turning the section.
    """
    free = _bending_flexibility(element, length, plane, hinged=False)
    hinged = _bending_flexibility(element, length, plane, hinged=True)
    slopes = free @ np.linalg.solve(hinged, _from_chord(length, plane))
    shear = _shear_ratio(element, length, plane)
    up = s * (1 - s) / (1 + shear)
    bow = length * up * np.array([1 - s + shear / 2, -(s + shear / 2)])
    lean = np.array([1 - s, s]) - 3 * up
    shift, _, _ = _PLANES[plane]
    chord = np.zeros(12)
    chord[[shift, shift + 6]] = 1 - s, s
    tilt = np.zeros(12)
    tilt[[shift, shift + 6]] = np.array([-1.0, 1.0]) / length
    return chord + bow @ slopes, tilt + lean @ slopes
