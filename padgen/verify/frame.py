"""Natural modes and static deflection of a 3-D frame of Timoshenko elements that carries rigid bodies.

The stiffness is kept as a product of a square root, whose triangular factor comes from QR. Rounding therefore sees the
square root of the stiffness' condition. The lowest modes of the flexibility form M φ = (1/ω²) K φ are exact to about
1e-9, for thicknesses from 1/500 of the length to the length itself and masses from zero to a thousand times the beam's.

Each element is straight. Element axes: x from start to end, z as near to the given `up` as is normal to x, y so that
the axes are right-handed. A node has six degrees of freedom: displacements x, y, z, rotations about x, y, z.

The static stiffness is exact for a uniform element (Przemieniecki, Theory of Matrix Structural Analysis, 1968, §5.6).
It is kept as a square root so that a frame can be solved without squaring its condition. The mass is consistent with
the static deflection, shear and rotary inertia included (Friedman and Kosmatka, Computers & Structures 47, 1993). In
addition an element may have inner motions, polynomials that vanish at its ends (Szabó and Babuška, Finite Element
Analysis, 1991, chapter 3), with which few elements give many digits.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError
from padgen.physics.beams import torsion_constant
from padgen.physics.modes import RigidBody

__all__ = [
    "AttachedBody",
    "Element",
    "Frame",
    "FrameModes",
    "Section",
    "checked_frame_modes",
    "divided",
    "element_mass_root",
    "element_root",
    "frame_modes",
    "rectangle",
]

_PLANES = ((2, 4, -1.0), (1, 5, 1.0))
"""Bending in the planes up and across: displacement, rotation, and the sign of slope over rotation."""


class Section(NamedTuple):
    """The cross-section of a beam element: area, second moments, torsion constant and shear coefficients, in SI units.

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
        """Second moment of area in m⁴ and shear coefficient, as a pair for bending up and a pair for bending across."""
        return (self.inertia_up, self.shear_up), (self.inertia_across, self.shear_across)


class Element(NamedTuple):
    """A straight Timoshenko beam element between two nodes (by index), its section and material, in SI units.

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
    """Return the cross-section of a layered rectangle, `thickness` upwards; sizes in m.

    `across` is as in `beams.BeamSection`; the shear coefficient is Cowper's (1966).
    """
    shear = 10 * (1 + poisson) / (12 + 11 * poisson)
    area = width * thickness
    torsion = float(torsion_constant(width, thickness, across))
    return Section(area, area * thickness**2 / 12, area * width**2 / 12, torsion, shear * across, shear)


def element_root(element: Element, length: float, bubbles: int) -> np.ndarray:
    """Return the square root of the stiffness in element axes, shape (r, 12 + m): stiffness = rootᵀ root.

    The first twelve columns are the nodes' motions, with the static deflection between them; the others are the inner
    motions of degrees up to `bubbles` + 1. The two groups do no work on each other, since the static deflection needs
    forces at the ends alone.
    """
    section = element.section
    modulus = element.modulus
    shear_modulus = element.shear_modulus
    root = np.zeros((6, 12))
    root[0, [0, 6]] = np.array([-1.0, 1.0]) * np.sqrt(modulus * section.area / length)
    root[1, [3, 9]] = np.array([-1.0, 1.0]) * np.sqrt(shear_modulus * section.torsion / length)
    for plane in (0, 1):
        *_, hinged = _bending_flexibility(element, length, plane)
        root[2 + 2 * plane : 4 + 2 * plane] = np.linalg.cholesky(np.linalg.inv(hinged)).T @ _from_chord(length, plane)
    strains = []
    for _, weight, value, slope in _inner_motions(bubbles, bubbles + 2):
        each = np.sqrt(weight / length)
        strains += [
            each * np.sqrt(modulus * section.area) * slope[0],
            each * np.sqrt(shear_modulus * section.torsion) * slope[1],
        ]
        for shift, (inertia, shear) in zip((2, 4), section.planes, strict=True):
            # Rotations are multiplied by the length, so that all inner motions are lengths.
            strains += [
                each / length * np.sqrt(modulus * inertia) * slope[shift + 1],
                each * np.sqrt(shear * shear_modulus * section.area) * (slope[shift] - value[shift + 1]),
            ]
    inner = np.array(strains)
    return np.block([[root, np.zeros((6, inner.shape[1]))], [np.zeros((len(inner), 12)), inner]])


def element_mass_root(element: Element, length: float, bubbles: int) -> np.ndarray:
    """Return the square root of the consistent mass matrix in element axes, shape (r, 12 + m): mass = rootᵀ root."""
    area = element.section.area
    up, across = (inertia for inertia, _ in element.section.planes)
    rows = []
    for s, weight, value, _ in _inner_motions(bubbles, bubbles + 4):
        ends = np.zeros((6, 12))
        ends[0, [0, 6]] = ends[1, [3, 9]] = 1 - s, s
        for plane in (0, 1):
            ends[2 + 2 * plane : 4 + 2 * plane] = _shapes(element, length, plane, s)
        value[[3, 5]] /= length
        size = np.sqrt(element.density * length * weight * np.array([area, up + across, area, up, area, across]))
        rows.append(size[:, None] * np.hstack([ends, value]))
    return np.concatenate(rows)


def _inner_motions(bubbles: int, points: int) -> Iterator[tuple[float, float, np.ndarray, np.ndarray]]:
    """Yield for each Gauss point its place in [0, 1], weight, and values and slopes (6, m) of the m bubble functions.

    Rows: stretch, twist, then shift and turn of each plane. The motions are integrated Legendre polynomials, of degree
    2 … and 0 at both ends; slopes are by the share of the length.
    """
    sizes = [bubbles, bubbles, bubbles + 1, bubbles, bubbles + 1, bubbles] if bubbles else [0] * 6
    row = np.repeat(np.eye(6), sizes, axis=1)
    order = np.arange(1, bubbles + 2)
    each = np.concatenate([np.arange(size) for size in sizes])
    nodes, weights = np.polynomial.legendre.leggauss(points)
    for node, weight in zip(nodes, weights, strict=True):
        legendre = np.polynomial.legendre.legvander(np.array([node]), bubbles + 2)[0]
        value = (legendre[2:] - legendre[:-2]) / (2 * (2 * order + 1))
        yield (node + 1) / 2, weight / 2, row * value[each], row * legendre[order][each]


def _bending_flexibility(element: Element, length: float, plane: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Return an element's shear parameter 12 EI / (κ G A l²), and its end rotations under unit end moments.

    Rotations (2, 2) in rad/(N·m) are those of both ends against the chord under unit moments at them, without and with
    the hinges.
    """
    inertia, coefficient = element.section.planes[plane]
    bending = 12 * element.modulus * inertia
    shear = bending / (coefficient * element.shear_modulus * element.section.area * length**2)
    free = length / bending * np.array([[4 + shear, shear - 2], [shear - 2, 4 + shear]])
    return shear, free, free + np.diag([element.hinge_start[plane], element.hinge_end[plane]])


def _from_chord(length: float, plane: int) -> np.ndarray:
    """Return the matrix (2, 12) that takes the nodes' 12 motions to both ends' slopes relative to the chord."""
    shift, turn, sign = _PLANES[plane]
    rows = np.zeros((2, 12))
    rows[:, [shift, shift + 6]] = np.array([1.0, -1.0]) / length
    rows[[0, 1], [turn, turn + 6]] = sign
    return rows


def _shapes(element: Element, length: float, plane: int, s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return deflection (12,) and slope (12,) at `s` in [0, 1] along the element, per unit of each node motion.

    They are the chord's motion plus the static deflection under the moments that the nodes' rotations cause. Shear
    bends the axis without turning the section.
    """
    shear, free, hinged = _bending_flexibility(element, length, plane)
    slopes = free @ np.linalg.solve(hinged, _from_chord(length, plane))
    up = s * (1 - s) / (1 + shear)
    bow = length * up * np.array([1 - s + shear / 2, -(s + shear / 2)])
    lean = np.array([1 - s, s]) - 3 * up
    shift, _, _ = _PLANES[plane]
    chord = np.zeros(12)
    chord[[shift, shift + 6]] = 1 - s, s
    tilt = np.zeros(12)
    tilt[[shift, shift + 6]] = np.array([-1.0, 1.0]) / length
    return chord + bow @ slopes, tilt + lean @ slopes


CONDITION_LIMIT = 1e10
"""Largest condition of the square root of the stiffness: beyond it the frame is a mechanism, or six digits are lost."""
RESIDUAL_LIMIT = 1e-8
ROUNDING = 1e-14
"""Relative error of a frequency per square root of the condition."""


class AttachedBody(NamedTuple):
    """A rigid body and the `nodes` (indices) that are fixed to it, in the frame's axes, SI units."""

    body: RigidBody
    nodes: tuple[int, ...]


class Frame(NamedTuple):
    """Nodes (n, 3) in m, elements between them, bodies, and the nodes that are clamped.

    Every element has inner motions, polynomials of degrees up to `bubbles` + 1; none for 0.
    """

    nodes: np.ndarray
    elements: tuple[Element, ...]
    bodies: tuple[AttachedBody, ...] = ()
    clamped: tuple[int, ...] = ()
    bubbles: int = 2


class FrameModes(NamedTuple):
    """Modes of a frame, lowest first, mass-normalised.

    `frequency_hz` (k,); `node_motion` (k, n, 6) of the nodes and `body_motion` (k, b, 6) of the bodies' centroids,
    displacements in kg^-½ and rotations in kg^-½/m. `residual` is the largest relative residual of the flexibility
    form's square root, `condition` that of the scaled stiffness.
    """

    frequency_hz: np.ndarray
    node_motion: np.ndarray
    body_motion: np.ndarray
    residual: float
    condition: float


def divided(
    start: np.ndarray, end: np.ndarray, elements: int, first_node: int = 0
) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Return nodes (elements + 1, 3) evenly from `start` to `end`, and the pairs of indices of the elements between."""
    share = np.linspace(0, 1, elements + 1)[:, None]
    nodes = (1 - share) * np.asarray(start, float) + share * np.asarray(end, float)
    return nodes, [(first_node + i, first_node + i + 1) for i in range(elements)]


def frame_modes(frame: Frame, count: int = 6) -> FrameModes:
    """Return the lowest `count` modes.

    Raises
    ------
    SolverError
        The frame is a mechanism, has no mass, or the modes do not satisfy their equation.
    """
    free = _motions(frame)
    factor, scale, condition = _stiffness_factor(frame, free)
    form = np.linalg.solve(factor.T, _mass_root(frame, free / scale).T)
    vectors, values, others = np.linalg.svd(form, full_matrices=False)
    count = min(count, len(values))
    if not values[0] > 0 or not values[count - 1] > 1e-14 * values[0]:
        raise SolverError(f"the frame has fewer than {count} modes with mass; ask for fewer")
    values = values[:count]
    vectors = vectors[:, :count]
    others = others[:count].T
    residual = np.linalg.norm(form @ others - vectors * values, axis=0) / values
    if not residual.max() <= RESIDUAL_LIMIT:
        raise SolverError(f"the modes leave a residual of {residual.max():.1e}, at most {RESIDUAL_LIMIT:.0e}")
    shapes = (free / scale) @ np.linalg.solve(factor, vectors / values)
    nodes, bodies = np.split(shapes[: _outer(frame)].T.reshape(count, -1, 6), [len(frame.nodes)], 1)
    return FrameModes(1 / (2 * np.pi * values), nodes, bodies, float(residual.max()), condition)


def checked_frame_modes(frame: Frame, count: int = 6) -> tuple[FrameModes, np.ndarray]:
    """Return the lowest k modes, solved at one polynomial degree more than set, and bounds (k,) on relative errors.

    The bound is the change made by the last inner motion plus rounding. It covers the solution of the beam equations,
    not the beams as a model of a solid.

    Raises
    ------
    SolverError
        As `frame_modes`.
    """
    rough, fine = (frame_modes(frame._replace(bubbles=frame.bubbles + k), count) for k in (0, 1))
    return fine, np.abs(rough.frequency_hz / fine.frequency_hz - 1) + ROUNDING * np.sqrt(fine.condition)


def _outer(frame: Frame) -> int:
    """Return the number of degrees of freedom of nodes and bodies; the elements' inner ones follow these."""
    return 6 * (len(frame.nodes) + len(frame.bodies))


def _motions(frame: Frame) -> np.ndarray:
    """Return the matrix (…, f) from the f free motions to all motions of nodes, bodies and elements' interiors.

    A node that is fixed to a body moves with it.
    """
    count = len(frame.nodes)
    rows = _outer(frame)
    inner = (6 * frame.bubbles + 2 if frame.bubbles else 0) * len(frame.elements)
    ties = np.eye(rows + inner)
    for k, attached in enumerate(frame.bodies):
        for node in attached.nodes:
            place = slice(6 * node, 6 * node + 6)
            ties[place] = 0
            x, y, z = frame.nodes[node] - attached.body.centroid
            carry = np.eye(6)
            carry[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
            ties[place, 6 * (count + k) : 6 * (count + k) + 6] = carry
    led = {6 * node + k for attached in frame.bodies for node in attached.nodes for k in range(6)}
    clamped = {6 * node + k for node in frame.clamped for k in range(6)}
    if led & clamped:
        raise SolverError("a node that is fixed to a rigid body cannot be clamped, too; clamp another node")
    used = {6 * n + k for e in frame.elements for n in (e.start, e.end) for k in range(6)}
    return ties[:, sorted(((used - led) | set(range(6 * count, rows + inner))) - clamped)]


def _stiffness_factor(frame: Frame, free: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the triangular factor (f, f) of the scaled stiffness, its scale (f,) and its condition.

    Each degree of freedom is scaled by its own stiffness, so that metres and radians become comparable.
    """
    root = np.concatenate([_placed(frame, k, element_root) for k in range(len(frame.elements))]) @ free
    scale = np.linalg.norm(root, axis=0)
    if not (scale > 0).all():
        raise SolverError("the frame is a mechanism: part of it is not held; clamp more nodes")
    # Stiff rows first, since only then is Householder's QR accurate in each row.
    order = np.argsort(-np.abs(root / scale).max(1))
    factor = np.asarray(np.linalg.qr((root / scale)[order], mode="r"))
    size = np.linalg.svd(factor, compute_uv=False)
    if not size[0] <= CONDITION_LIMIT * size[-1]:
        raise SolverError(
            f"the frame is a mechanism or nearly so (condition {(size[0] / max(size[-1], 1e-100)) ** 2:.0e}); hold more"
            " nodes, or use fewer elements"
        )
    return factor, scale, float((size[0] / size[-1]) ** 2)


def _mass_root(frame: Frame, free: np.ndarray) -> np.ndarray:
    """Return the square root (r, f) of the mass, mass = rootᵀ root.

    A square root keeps the digits of light parts beside heavy ones. A body's own is scaled, so that its small entries
    keep theirs.
    """
    rows = [_placed(frame, k, element_mass_root) @ free for k in range(len(frame.elements))]
    for k, attached in enumerate(frame.bodies):
        body = attached.body
        root_mass: Any = np.zeros((6, 6))
        root_mass[:3, :3] = np.eye(3) * body.mass
        root_mass[3:, 3:] = body.inertia
        scale = np.sqrt(np.maximum(root_mass.diagonal(), 0))
        unit = np.where(scale > 0, scale, 1)
        values, vectors = np.linalg.eigh(root_mass / np.outer(unit, unit))
        start = 6 * (len(frame.nodes) + k)
        rows.append((np.sqrt(np.maximum(values, 0))[:, None] * vectors.T * scale) @ free[start : start + 6])
    return np.concatenate(rows)


def _placed(frame: Frame, index: int, root: Callable[[Element, float, int], np.ndarray]) -> np.ndarray:
    """Return one element's root of stiffness or mass, computed by `root`, with a column per motion of the frame."""
    element = frame.elements[index]
    start, end = frame.nodes[element.start], frame.nodes[element.end]
    length = float(np.linalg.norm(end - start))
    if not length > 0:
        raise SolverError(f"the element between nodes {element.start} and {element.end} has no length")
    x = (end - start) / length
    z = np.asarray(element.up, float) - x * (x @ np.asarray(element.up, float))
    z = z / np.linalg.norm(z)
    axes = np.kron(np.eye(2), np.stack([x, np.cross(z, x), z]))
    element_root = root(element, length, frame.bubbles)
    inner = element_root.shape[1] - 12
    first = _outer(frame) + index * inner
    placed = np.zeros((len(element_root), _outer(frame) + inner * len(frame.elements)))
    for k, node in enumerate((element.start, element.end)):
        placed[:, 6 * node : 6 * node + 6] = element_root[:, 6 * k : 6 * k + 6] @ axes
    placed[:, first : first + inner] = element_root[:, 12:]
    return placed
