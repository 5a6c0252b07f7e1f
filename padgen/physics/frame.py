"""Natural modes and static deflection of a 3-D frame of Timoshenko elements that carries rigid bodies.

The stiffness is kept as a product of a square root, whose triangular factor comes from QR. Rounding therefore sees the
square root of the stiffness' condition. The lowest modes of the flexibility form M φ = (1/ω²) K φ are exact to about
1e-9, for thicknesses from 1/500 of the length to the length itself and masses from zero to a thousand times the beam's.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError
from padgen.physics.frame_element import Element, bubble_count, element_axes, element_mass_root, element_root
from padgen.physics.rigid_body import RigidBody

__all__ = [
    "AttachedBody",
    "Frame",
    "FrameModes",
    "checked_frame_modes",
    "divided",
    "frame_deflection",
    "frame_modes",
]

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

    `held` lists single degrees of freedom as (node, 0 … 5), for supports that leave some free. Every element has inner
    motions, polynomials of degrees up to `bubbles` + 1; none for 0.
    """

    nodes: np.ndarray
    elements: tuple[Element, ...]
    bodies: tuple[AttachedBody, ...] = ()
    clamped: tuple[int, ...] = ()
    held: tuple[tuple[int, int], ...] = ()
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
    mass = _mass_root(frame, free / scale)
    form = np.linalg.solve(factor.T, mass.T)
    vectors, values, others = np.linalg.svd(form, full_matrices=False)
    count = min(count, len(values))
    if not values[0] > 0 or not values[count - 1] > 1e-14 * values[0]:
        raise SolverError(f"the frame has fewer than {count} modes with mass; ask for fewer")
    values, vectors, others = values[:count], vectors[:, :count], others[:count].T
    residual = np.linalg.norm(form @ others - vectors * values, axis=0) / values
    if not residual.max() <= RESIDUAL_LIMIT:
        raise SolverError(f"the modes leave a residual of {residual.max():.1e}, at most {RESIDUAL_LIMIT:.0e}")
    shapes = (free / scale) @ np.linalg.solve(factor, vectors / values)
    nodes, outer = len(frame.nodes), _outer(frame)
    moved = shapes[:outer].T.reshape(count, -1, 6)
    return FrameModes(1 / (2 * np.pi * values), moved[:, :nodes], moved[:, nodes:], float(residual.max()), condition)


def checked_frame_modes(frame: Frame, count: int = 6) -> tuple[FrameModes, np.ndarray]:
    """Return the lowest modes with one more inner motion per element, and a bound (k,) on their relative error.

    The bound is the change made by the last inner motion plus rounding. It covers the solution of the beam equations,
    not the beams as a model of a solid.

    Raises
    ------
    SolverError
        As `frame_modes`.
    """
    rough, fine = (frame_modes(frame._replace(bubbles=frame.bubbles + k), count) for k in (0, 1))
    change = np.abs(rough.frequency_hz / fine.frequency_hz - 1)
    return fine, change + ROUNDING * np.sqrt(fine.condition)


def frame_deflection(frame: Frame, load: np.ndarray) -> np.ndarray:
    """Return the static motion (n + b, 6) of nodes and bodies under a `load` (n + b, 6) in N and N·m.

    Loads of bodies act at their centroids.

    Raises
    ------
    SolverError
        The frame is a mechanism.
    """
    free = _motions(frame)
    factor, scale, _ = _stiffness_factor(frame, free)
    scaled = (free / scale)[: _outer(frame)]
    moved = np.linalg.solve(factor, np.linalg.solve(factor.T, scaled.T @ np.asarray(load, float).ravel()))
    return np.asarray((scaled @ moved).reshape(-1, 6))


def _outer(frame: Frame) -> int:
    """Return the number of degrees of freedom of nodes and bodies; the elements' inner ones follow these."""
    return 6 * (len(frame.nodes) + len(frame.bodies))


def _motions(frame: Frame) -> np.ndarray:
    """Return all motions (nodes, bodies, inner ones) for a unit of each of the f free ones, shape (…, f).

    A node that is fixed to a body moves with it.
    """
    count, rows = len(frame.nodes), _outer(frame)
    inner = bubble_count(frame.bubbles) * len(frame.elements)
    ties = np.eye(rows + inner)
    led: set[int] = set()
    for k, attached in enumerate(frame.bodies):
        for node in attached.nodes:
            place = slice(6 * node, 6 * node + 6)
            ties[place] = 0
            ties[place, 6 * (count + k) : 6 * (count + k) + 6] = _carry(frame.nodes[node] - attached.body.centroid)
            led |= set(range(6 * node, 6 * node + 6))
    clamped = {6 * node + k for node in frame.clamped for k in range(6)} | {6 * n + k for n, k in frame.held}
    if led & clamped:
        raise SolverError("a node that is fast to a body cannot be held as well; hold another node")
    used = {6 * n + k for e in frame.elements for n in (e.start, e.end) for k in range(6)}
    others = set(range(6 * count, rows + inner))
    return ties[:, sorted(((used - led) | others) - clamped)]


def _carry(arm: np.ndarray) -> np.ndarray:
    """Return the matrix (6, 6) from the motion of a body's reference to that of a point at `arm` in m from it."""
    x, y, z = arm
    carry = np.eye(6)
    carry[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return carry


def _stiffness_factor(frame: Frame, free: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the triangular factor (f, f) of the scaled stiffness, its scale (f,) and its condition.

    Each degree of freedom is scaled by its own stiffness, so that metres and radians become comparable.
    """
    root = _stacked_root(frame) @ free
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


def _stacked_root(frame: Frame) -> np.ndarray:
    """Return the square root (r, …) of the stiffness of all elements, over all motions."""
    return np.concatenate([_placed(frame, k, element_root) for k in range(len(frame.elements))])


def _mass_root(frame: Frame, free: np.ndarray) -> np.ndarray:
    """Return the square root (r, f) of the mass, mass = rootᵀ root.

    A square root keeps the digits of light parts beside heavy ones.
    """
    rows = [_placed(frame, k, element_mass_root) @ free for k in range(len(frame.elements))]
    for k, attached in enumerate(frame.bodies):
        body = attached.body
        own: Any = np.zeros((6, 6))
        own[:3, :3] = np.eye(3) * body.mass
        own[3:, 3:] = body.inertia
        start = 6 * (len(frame.nodes) + k)
        rows.append(_root(own) @ free[start : start + 6])
    return np.concatenate(rows)


def _root(matrix: np.ndarray) -> np.ndarray:
    """Return the square root of a positive semi-definite matrix, scaled so that its small entries keep their digits."""
    scale = np.sqrt(np.maximum(matrix.diagonal(), 0))
    unit = np.where(scale > 0, scale, 1)
    values, vectors = np.linalg.eigh(matrix / np.outer(unit, unit))
    return np.asarray(np.sqrt(np.maximum(values, 0))[:, None] * vectors.T * scale)


def _placed(frame: Frame, index: int, root: Callable[[Element, float, int], np.ndarray]) -> np.ndarray:
    """Return the `root` of one element over all motions of the frame."""
    element = frame.elements[index]
    start, end = frame.nodes[element.start], frame.nodes[element.end]
    length = float(np.linalg.norm(end - start))
    if not length > 0:
        raise SolverError(f"the element between nodes {element.start} and {element.end} has no length")
    own = root(element, length, frame.bubbles)
    inner = bubble_count(frame.bubbles)
    first = _outer(frame) + index * inner
    placed = np.zeros((len(own), _outer(frame) + inner * len(frame.elements)))
    for k, node in enumerate((element.start, element.end)):
        placed[:, 6 * node : 6 * node + 6] = own[:, 6 * k : 6 * k + 6] @ np.kron(
            np.eye(2), element_axes(start, end, element.up)
        )
    placed[:, first : first + inner] = own[:, 12:]
    return placed
