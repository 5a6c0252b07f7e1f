"""Stiffness and mass of one beam on elastic ends, reduced to the motion of its tip.

Beam axes: x along the beam at its tip, away from the root, z up, y so that the axes are right-handed. A tip has six
degrees of freedom, in this order: displacements x, y, z, rotations about x, y, z.

A straight beam has closed forms. A beam that bends in its plane is integrated along its path by the unit-load method
(Castigliano's theorem, as in Timoshenko, Strength of Materials, on thin curved bars): the load on the tip gives the
load on each slice, and each slice bends, twists, shears and stretches under it. The slices are those of a straight
beam, so radii should be no smaller than the width. An integral from the root to a slice is that of the polynomial
through the Gauss points of each piece.

The frame at its root and the plate at its tip are compliant. Each law has the right limits and a few constants, which
were fitted to 3-D elasticity of random printed taxels (`docs/measure_campaign.py`, docs/accuracy.md):

- An end turns about as much as a piece of beam that is as long as the beam is thick, less where the beam is flared. A
  root turns no more than a piece as long as the frame behind it is deep. Frame and plate reach higher than the beam, so
  the ends turn about points above its axis.
- The tip bends the wall between the plate's edge and the recess, or twists and bends the yoke that carries the plate:
  its crossbar bends under a force as far out as the middle of a wide beam, its neck under a moment that falls towards
  the plate.
- Layers that hold less well to each other make the ends softer, a wide beam's as a half-plane's edge (`layered_edge`).
  Beads of a layer that do so, too: a half-plane whose beads run along its edge gives way under a load on the edge as
  the power −5/8 of their ratio (Lekhnitskii), and some six tenths of the plastic at the ends lie like that.
- Ends keep the section from curling (anticlastic curvature): near them a beam is as stiff as a plate
  (`anticlastic_factors`).
- Ends keep the section from warping (Vlasov: each end shortens a ribbon in torsion by about ``w √((1+ν)/24)``).
"""

from collections.abc import Sequence
from functools import cache
from math import inf
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "RIGID",
    "SHORTEST_M",
    "BeamSection",
    "EndCompliance",
    "Flexibility",
    "PinFoot",
    "PinMotion",
    "Slices",
    "Surroundings",
    "YokeSize",
    "anticlastic_factors",
    "anticlastic_reduction",
    "beam_slices",
    "bend_stiffening",
    "columns",
    "doubtful_energies",
    "flexibility",
    "in_plane_loads",
    "largest_inverse_square",
    "largest_stress",
    "layered_edge",
    "matrices",
    "on_elastic_ends",
    "out_of_plane_loads",
    "piece_twist",
    "pin_motion",
    "pushed_stress",
    "root_load",
    "tip_mass",
    "tip_matrices",
    "tip_stiffness",
    "torsion_constant",
    "within_fitted_range",
]

Array = Any

SHORTEST_M = 1e-12
"""Smallest length in divisions, for pieces of length 0 such as corners."""
LEAST_PIECE_M = 1e-7
"""Shortest piece of a beam between its flare and a pin."""
_NO_PIECE = 0.0, 0.0, np.inf
"""Length, curvature and straight length at root and tip."""


class Slices(NamedTuple):
    """Slices of a bent beam, whose axis turns in its plane, from its root to its tip.

    `x` and `y` (…, k) in m are places from the tip, `cosine` and `sine` (…, k) directions, both in beam axes; `width`
    (…, k) in m; `share` (…, k) is the length in m of the slice's piece. `curved` (…, k) is the width over twice the
    radius, `straight` (…, k) the length in m of a straight piece, else inf. `running` (k, k) is the matrix of sums from
    the root to each slice.
    """

    x: Array
    y: Array
    cosine: Array
    sine: Array
    width: Array
    share: Array
    curved: Array
    straight: Array
    running: np.ndarray


def beam_slices(path: Sequence[tuple[Array, Array]], width: Array, fillet: Array) -> Slices:
    """Return the slices of a beam's path: at root and tip, and at Gauss points of each piece, more where it turns.

    `path` holds length in m and turn (left positive) of each piece. The `width` flares at the root by two quarter
    circles of radius `fillet`, on the first piece.
    """
    width, fillet = (np.asarray(v, float) for v in (width, fillet))
    pieces = [(*(np.asarray(v, float) for v in piece), 0.0 * fillet) for piece in path]
    if (fillet > 0).any():
        pieces[:1] = [(fillet, 0.0 * fillet, fillet), (pieces[0][0] - fillet, pieces[0][1], 0.0 * fillet)]
    shape = np.broadcast_shapes(width.shape, *(v.shape for piece in pieces for v in piece))
    table = np.empty((3, *shape, len(pieces)))
    for k, piece in enumerate(pieces):
        for row, value in zip(table, piece, strict=True):
            row[..., k] = value
    counts = [4 + int(np.ceil(np.abs(turn).max())) for _, turn, _ in pieces]
    # Where each piece begins, and its end as seen from there.
    length, turn, _ = table
    heading = np.cumsum(turn, -1) - turn
    chord = length * np.sinc(turn / (2 * np.pi))
    along = chord * np.cos(heading + turn / 2)
    aside = chord * np.sin(heading + turn / 2)
    begins = np.stack([np.cumsum(along, -1) - along, np.cumsum(aside, -1) - aside, heading])
    # The same for each slice.
    at = np.concatenate([_gauss(count)[0] for count in counts])
    length, turn, flare = np.repeat(table, counts, -1)
    from_x, from_y, heading = np.repeat(begins, counts, -1)
    half = turn * at / 2
    chord = length * at * np.sinc(half / np.pi)
    flared = 2 * (flare - np.sqrt(np.maximum(flare**2 - np.maximum(flare - length * at, 0) ** 2, 0)))
    slices = np.empty((7, *shape, len(at) + 2))
    inside = slices[..., 1:-1]
    inside[0] = from_x + chord * np.cos(heading + half)
    inside[1] = from_y + chord * np.sin(heading + half)
    inside[2] = heading + turn * at
    inside[3] = width[..., None] + flared
    inside[4] = length
    inside[5] = np.abs(turn) * width[..., None] / (2 * np.maximum(length, SHORTEST_M))
    inside[6] = np.where(turn, np.inf, length)
    root = slices[..., 0]
    root[:3] = 0.0
    root[3] = width + 2 * fillet
    tip = slices[..., -1]
    tip[0] = along.sum(-1)
    tip[1] = aside.sum(-1)
    tip[2] = table[1].sum(-1)
    tip[3] = width
    for end in (root, tip):
        end[4:] = np.reshape(_NO_PIECE, (3, *(1 for _ in shape)))
    x, y, heading, wide, share, curved, straight = slices
    # Turn from the root's axes to the tip's.
    turned = heading[..., -1:]
    x = x - x[..., -1:]
    y = y - y[..., -1:]
    x, y = np.cos(turned) * x + np.sin(turned) * y, np.cos(turned) * y - np.sin(turned) * x
    return Slices(
        x, y, np.cos(heading - turned), np.sin(heading - turned), wide, share, curved, straight, _running(tuple(counts))
    )


def out_of_plane_loads(slices: Slices) -> np.ndarray:
    """Return out-of-plane internal loads in a bent beam's slices per unit load on its tip, as matrices (…, k, 3, 3).

    Rows: shear force, twist, bending moment. Columns: force up, moment about x, moment about y.
    """
    x = slices.x
    y = slices.y
    cosine = slices.cosine
    sine = slices.sine
    zero = 0.0 * slices.x
    twist = [sine * x - cosine * y, cosine, sine]
    bending = [cosine * x + sine * y, -sine, cosine]
    return matrices([1 + zero, zero, zero], twist, bending)


def in_plane_loads(slices: Slices) -> np.ndarray:
    """Return in-plane internal loads in a bent beam's slices per unit load on its tip, as matrices (…, k, 3, 3).

    Rows: pull, shear force, bending moment. Columns: force along x, force along y, moment about z.
    """
    x = slices.x
    y = slices.y
    cosine = slices.cosine
    sine = slices.sine
    zero = 0.0 * slices.x
    return matrices([cosine, sine, zero], [-sine, cosine, zero], [y, -x, 1 + zero])


def matrices(*rows: list[Array]) -> np.ndarray:
    """Return matrices (…, k, rows, columns) from their rows of entries, each a number or an array (…, k)."""
    shape = np.broadcast_shapes(*(np.shape(value) for row in rows for value in row))
    whole = np.empty((*shape, len(rows), len(rows[0])))
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            whole[..., i, j] = value
    return whole


def columns(values: list[Array]) -> np.ndarray:
    """Return arrays or numbers side by side along a new last axis."""
    whole = np.empty((*np.broadcast_shapes(*map(np.shape, values)), len(values)))
    for j, value in enumerate(values):
        whole[..., j] = value
    return whole


@cache
def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss points (k,) on 0 … 1, and the matrix (k + 1, k) that integrates from 0 to each and to 1."""
    nodes, _ = np.polynomial.legendre.leggauss(count)
    share = (nodes + 1) / 2
    legendre = np.polynomial.legendre.Legendre
    basis = np.linalg.inv(np.polynomial.legendre.legvander(nodes, count - 1))
    integrals = [legendre.basis(n).integ(lbnd=-1)(np.append(nodes, 1.0)) / 2 for n in range(count)]
    return share, np.array(integrals).T @ basis


@cache
def _running(counts: tuple[int, ...]) -> np.ndarray:
    """Return the matrix that turns values at slices into integrals from the root to each; `counts`: points per piece.

    Each piece counts as one of length 1.

    The slices at root and tip have no weight.
    """
    size = sum(counts) + 2
    first = 1
    matrix = np.zeros((size, size))
    for count in counts:
        _, integrals = _gauss(count)
        run = slice(first, first + count)
        matrix[run, run] = integrals[:-1]
        matrix[first + count :, run] = integrals[-1]
        first += count
    return matrix


MOST_CURVED = 0.98
"""Largest width over twice a bend's radius at which the series of its stiffness is summed; it diverges at 1."""
HELD_MOST = 0.85
"""Largest share of a beam's twist that ends may remove by holding its warping."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_NODES = (_NODES + 1) / 2
_WEIGHTS = _WEIGHTS / 2


class EndCompliance(NamedTuple):
    """Compliance of a beam's ends, mostly as the length in m of a piece of beam that is equally compliant.

    `root` and `tip` are for rotation under a moment in vertical bending, `lateral_root` and `lateral_tip` in lateral
    bending. `shear` and `lateral_shear` are for displacement of both ends together under a shear force up and sideways,
    `twist` for rotation of both together about the beam's axis (negative where the ends keep the section from warping),
    `stretch` for both along it. `mount` is the part of `tip` that is due to the wall or yoke that carries the plate.
    `curl_pure` and `curl_guided` are the shares of the beam's flexibility in vertical bending that its ends take away
    by keeping the section from curling, under a constant moment and under one that is zero at half the length. The ends
    turn about points `root_height` and `tip_height` (m) above the beam's axis, since frame and plate reach higher than
    the beam; this stiffens a beam that cannot move along itself. `warping` is the length in m over which the ends of
    each straight piece of a bent beam keep its section from warping. `yoke_turn` (m), `yoke_both` (m²) and `yoke_lift`
    (m³) are what a yoke that bends adds to the beam's ∫ (l−s)^p ds, p = 0, 1, 2: its neck runs back beside the beams.
    `mount_held` is what a crossbar with ends that are free to warp would add to `mount`.
    """

    root: Array = 0.0
    tip: Array = 0.0
    lateral_root: Array = 0.0
    lateral_tip: Array = 0.0
    shear: Array = 0.0
    lateral_shear: Array = 0.0
    twist: Array = 0.0
    curl_pure: Array = 0.0
    curl_guided: Array = 0.0
    root_height: Array = 0.0
    tip_height: Array = 0.0
    stretch: Array = 0.0
    mount: Array = 0.0
    warping: Array = 0.0
    yoke_turn: Array = 0.0
    yoke_both: Array = 0.0
    yoke_lift: Array = 0.0
    mount_held: Array = 0.0


RIGID = EndCompliance()


class PinFoot(NamedTuple):
    """A pin on a beam: the place of its axis as a share of the beam's length from the root, and its diameter in m."""

    share: Array
    diameter: Array


class BeamSection(NamedTuple):
    """Dimensions of a beam in m: numbers, or arrays of one shape.

    `fillet` is the radius of the flares on both sides of the root. `ends` is the compliance of the ends
    (`padgen.physics.beams`), zero by default. `path` holds length in m and turn (rad, left positive) of each piece
    of a beam that bends, from the root; it is empty for a straight beam. The flare must end on the first piece.
    `across` is the stiffness of the print across its layers, which lie flat, over the stiffness along them. `beads` is
    the stiffness across the beads of a layer over that along them. Beads run along the beam; more than half of what
    holds its ends runs across it. A `pin` that stands on the beam stiffens it where it stands.
    """

    width: Array
    thickness: Array
    length: Array
    fillet: Array = 0.0
    ends: EndCompliance = RIGID
    path: tuple[tuple[Array, Array], ...] = ()
    across: Array = 1.0
    beads: Array = 1.0
    pin: PinFoot | None = None


class Flexibility(NamedTuple):
    """Motion of a beam's tip per unit load on it, by cause, in m/N, 1/N or 1/(N·m).

    `up` and `side` are bending of the beam itself, and `up` of a yoke, too, as ∫ (l−s)^p ds/EI for p = 0, 1, 2. `root`
    to `lateral_tip` are rotations of the ends in both planes. `shear` and `lateral_shear` belong to the beam,
    `end_shear` and `lateral_end_shear` to its ends, and so do `twist` and `end_twist`; `stretch` is of both.
    """

    up: tuple[Array, Array, Array]
    side: tuple[Array, Array, Array]
    root: Array
    tip: Array
    lateral_root: Array
    lateral_tip: Array
    shear: Array
    lateral_shear: Array
    end_shear: Array
    lateral_end_shear: Array
    twist: Array
    end_twist: Array
    stretch: Array


def torsion_constant(width: Array, thickness: Array, across: Array = 1.0, beads: Array = 1.0) -> Array:
    """Return the torsion constant in m⁴ of a rectangle, solid or printed in lines whose bonds shear more easily.

    Solid, it is Roark's formula, within 0.5 %. `across` and `beads` are the shear moduli in the directions of
    `thickness` and of `width` over the one that the constant is multiplied with, 1 if solid. It is exactly
    that of an isotropic rectangle ``thickness √(beads/across)`` thick, times ``across^{3/2}/beads^{1/2}`` (Lekhnitskii,
    Theory of Elasticity of an Anisotropic Body, 1963, on torsion of orthotropic bars).
    """
    tall = thickness * np.sqrt(beads / across)
    a = np.maximum(width, tall)
    b = np.minimum(width, tall)
    slim = b / a
    return a * b**3 * (1 / 3 - 0.21 * slim * (1 - slim**4 / 12)) * across**1.5 / np.sqrt(beads)


def flexibility(section: BeamSection, modulus: Array, poisson: Array) -> Flexibility:
    """Return the flexibility of a beam that bends, shears, twists and has elastic ends.

    The shear coefficient is Cowper's (1966). Weaker bonds between layers soften upward shear and twist, but not
    bending.
    """
    width, thickness = (np.asarray(v, float) for v in section[:2])
    ends = section.ends
    shear_modulus = modulus / (2 * (1 + poisson))
    sheared = 10 * (1 + poisson) / (12 + 11 * poisson) * shear_modulus
    bending = modulus * width * thickness**3 / 12
    lateral = modulus * thickness * width**3 / 12
    area = width * thickness
    torsion = torsion_constant(width, thickness, section.across, section.beads)
    up, (side0, side1, side2), inverse_area, inverse_torsion = _flared(section)
    yoke = (ends.yoke_turn, ends.yoke_both, ends.yoke_lift)
    up0, up1, up2 = (
        free / modulus + (more - held) / bending
        for free, more, held in zip(up, yoke, anticlastic_reduction(section), strict=True)
    )
    return Flexibility(
        (up0, up1, up2),
        (side0 / modulus, side1 / modulus, side2 / modulus),
        ends.root / bending,
        ends.tip / bending,
        ends.lateral_root / lateral,
        ends.lateral_tip / lateral,
        inverse_area / (sheared * section.across),
        inverse_area / (sheared * section.beads),
        ends.shear / (area * sheared),
        ends.lateral_shear / (area * sheared),
        inverse_torsion / shear_modulus,
        np.maximum(ends.twist / torsion, -HELD_MOST * inverse_torsion) / shear_modulus,
        (inverse_area + ends.stretch / area) / modulus,
    )


def anticlastic_factors(slenderness: Array) -> tuple[Array, Array]:
    """Return s for uniform and antisymmetric moments: clamped ends cut a strip's bending flexibility by a share s ν².

    The first is for a constant moment, the second for one that is zero at half the length and grows evenly towards both
    ends; any moment from loads at the ends is a sum of the two. `slenderness` is length over width. Both are 1 for a
    strip much shorter than wide (a plate: modulus ``E/(1 − ν²)``); of long ones they go as 0.85/`slenderness` and
    2.6/`slenderness`.

    Notes
    -----
    Fitted to solutions of Kirchhoff's plate equation (Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells,
    1959, eq. 103 and 112-114) for strips with free sides and rigid, clamped ends by polynomials (Ritz): within 0.05 %
    of the stiffness for length over width 0.25-12 and ν 0.2-0.45 (`tests/physics/test_plates.py` solves them anew). For
    deflections so small that ``w²/(R t)`` (Searle's parameter; R is the radius of curvature) is below 1; beyond it the
    middle of a strip curls less, too (Ashwell, J. R. Aeronaut. Soc. 54, 1950).
    """
    shares = []
    for one, two, low, middle, high in (CURL_PURE, CURL_GUIDED):
        above = 1 + slenderness * (one + slenderness * two)
        shares.append(above / (1 + slenderness * (low + slenderness * (middle + slenderness * high))))
    return shares[0], shares[1]


def anticlastic_reduction(section: BeamSection) -> tuple[Array, Array, Array]:
    """Return by how much ends that suppress anticlastic curvature lower ∫ (l−s)^p ds, p = 0, 1, 2, in m^(p + 1)."""
    length = np.asarray(section.length, float)
    pure = section.ends.curl_pure * length
    guided = section.ends.curl_guided * length
    half = length / 2
    # A unit force up bends by the moment `half` all along and by one from `half` to -`half`.
    return pure, pure * half, (pure + guided / 3) * half**2


def tip_stiffness(section: BeamSection, modulus: Array, poisson: Array) -> np.ndarray:
    """Return the stiffness of the tip, shape (…, 6, 6), in N/m, N and N·m (per radian).

    A Timoshenko beam by the unit-load method: the flexibility is integrated along the flared width and inverted, so
    that the flare is exact within beam theory. A pin takes its part of the flexibility away (`pin_motion`).
    """
    if section.pin:
        bare = tip_stiffness(section._replace(pin=None), modulus, poisson)
        return _held_by_pin(bare, pin_motion(section, modulus, poisson))
    if section.path:
        return _of_planes([np.linalg.inv(plane.flexibility) for plane in _planes(section, modulus, poisson)])
    length = np.asarray(section.length, float)
    parts = flexibility(section, modulus, poisson)
    stiffness = np.zeros((*np.broadcast_shapes(np.shape(parts.up[2]), np.shape(parts.root)), 6, 6))
    stiffness[..., 3, 3] = 1 / (parts.twist + parts.end_twist)
    # Rotation of the root moves the tip by the whole length as its arm, rotation of the tip by none.
    up0, up1, up2 = parts.up
    root = parts.root
    tip = parts.tip
    high = section.ends.root_height
    low = section.ends.tip_height
    bend = up2 + root * length**2 + parts.shear + parts.end_shear
    along = parts.stretch + root * high**2 + tip * low**2
    lifted = root * high * length
    turned = -(root * high + tip * low)
    tilted = -(up1 + root * length)
    compliance = matrices([along, lifted, turned], [lifted, bend, tilted], [turned, tilted, up0 + root + tip])
    stiffness[..., [[0], [2], [4]], [0, 2, 4]] = np.linalg.inv(compliance)
    side0, side1, side2 = parts.side
    root = parts.lateral_root
    tip = parts.lateral_tip
    bend = side2 + root * length**2 + parts.lateral_shear + parts.lateral_end_shear
    turned = side0 + root + tip
    both = side1 + root * length
    determinant = bend * turned - both**2
    stiffness[..., 1, 1] = turned / determinant
    stiffness[..., 5, 5] = bend / determinant
    stiffness[..., 1, 5] = stiffness[..., 5, 1] = -both / determinant
    return stiffness


def tip_mass(section: BeamSection, density: float, poisson: Array = 0.3) -> np.ndarray:
    """Return the consistent mass of the beam reduced to its tip, shape (…, 6, 6), in kg, kg·m and kg·m².

    A straight beam deflects as the cubic of a uniform clamped beam; its flare hardly moves, so the mass of the flare is
    left out. A bent beam has the shape that a load on its tip gives it.
    """
    if section.path:
        return _bent_matrices(section, 1.0, poisson, density)[1]
    width, thickness, length = (np.asarray(v, float) for v in section[:3])
    beam = density * width * thickness * length
    polar = (width**2 + thickness**2) / 12
    mass = np.zeros((*np.shape(beam), 6, 6))
    mass[..., 0, 0] = beam / 3
    mass[..., 3, 3] = beam * polar / 3
    for shift, turn, sign in ((2, 4, 1), (1, 5, -1)):
        mass[..., shift, shift] = beam * 13 / 35
        mass[..., shift, turn] = mass[..., turn, shift] = sign * beam * length * 11 / 210
        mass[..., turn, turn] = beam * length**2 / 105
    return mass


def tip_matrices(
    section: BeamSection, modulus: Array, poisson: Array, density: float, at_pin: "PinMotion | None"
) -> tuple[np.ndarray, np.ndarray]:
    """Return `tip_stiffness` and `tip_mass` of a beam at once, which takes half the time where it is bent.

    `at_pin` is the beam's `pin_motion`; None for a beam without a pin.
    """
    if section.path:
        stiffness, mass = _bent_matrices(section, modulus, poisson, density)
    else:
        stiffness = tip_stiffness(section._replace(pin=None), modulus, poisson)
        mass = tip_mass(section, density, poisson)
    return stiffness if at_pin is None else _held_by_pin(stiffness, at_pin), mass


def _held_by_pin(stiffness: np.ndarray, at_pin: "PinMotion") -> np.ndarray:
    """Return a pinned beam's tip stiffness (…, 6, 6), from that without the pin and the flexibility the pin removes."""
    return np.linalg.inv(np.linalg.inv(stiffness) - at_pin.held)


def _bent_matrices(
    section: BeamSection, modulus: Array, poisson: Array, density: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness and mass (…, 6, 6) of a bent beam reduced to its tip; mass does not depend on `modulus`."""
    stiffnesses = []
    masses = []
    for plane in _planes(section, modulus, poisson):
        stiffness = np.linalg.inv(plane.flexibility)
        shape = plane.back @ plane.running
        stiffnesses.append(stiffness)
        masses.append(density * stiffness @ _squared(shape, plane.inertia) @ stiffness)
    return _of_planes(stiffnesses), _of_planes(masses)


class PinMotion(NamedTuple):
    """Motion of a beam at the foot of its pin, in the beam's axes there: x along the beam, z up.

    `shape` (…, 6, 6) is its motion per motion of the tip without load on the pin, `local` (…, 6, 6) its flexibility
    under loads at the pin while the tip is held, and `held` (…, 6, 6) the part of the tip's flexibility that the pin
    takes away.
    """

    shape: np.ndarray
    local: np.ndarray
    held: np.ndarray


def pin_motion(section: BeamSection, modulus: Array, poisson: Array) -> PinMotion:
    """Return how a beam moves at the foot of its pin, and by how much the foot makes the beam's tip less flexible.

    Motions are per motion of its tip, and per load on the pin, by the unit-load method along the path to the pin.

    The pin holds the beam over its diameter, but for what the beam turns at both ends of the foot, as it does at a
    root: together about a piece as long as `PIN_ENDS` times the thickness. A pin much narrower than the beam holds less
    of it (`PIN_SPREAD`).
    """
    pin = section.pin
    assert pin is not None, "the beam has a pin"
    length = np.asarray(section.length, float)
    at = pin.share * length
    half = np.asarray(pin.diameter) / 2
    bare = section._replace(path=_cut_round_pin(section))
    width, thickness = (np.asarray(v, float) for v in section[:2])
    spread = np.minimum(PIN_SPREAD * pin.diameter / width, 1.0)
    share = np.clip(spread - PIN_ENDS * thickness / pin.diameter, 0.0, 1.0)
    bending = np.asarray(modulus * width * thickness**3 / 12)[..., None, None]
    yokes = _yoke_at_tip(section.ends) / bending, 0.0
    parts = []
    for plane, yoke in zip(_planes(bare, modulus, poisson), yokes, strict=True):
        along, station = _stations(plane.slices)
        under = np.abs(along - at[..., None]) < half
        taken = plane.compliance * (share[..., None] * under)[..., None]
        held = _squared(plane.within, taken * plane.slices.running[-1][:, None])
        stiff = plane._replace(compliance=plane.compliance - taken)
        back = stiff.back[..., station, :, :]
        moved = back @ stiff.running_to(slice(station, station + 1))[..., 0, :, :]
        shape = moved @ np.linalg.inv(plane.flexibility - held + yoke)
        local = moved @ np.swapaxes(back, -1, -2) - shape @ np.swapaxes(moved, -1, -2)
        parts.append((shape, local, held))
    return PinMotion(*(_of_planes(list(planes)) for planes in zip(*parts, strict=True)))


def _yoke_at_tip(ends: EndCompliance) -> np.ndarray:
    """Return what a yoke (crossbar and neck) adds to a tip's out-of-plane flexibility (…, 3, 3), times the beam's EI.

    The slices of the beam do not include the yoke.
    """
    turn, both, lift = (np.asarray(part)[..., None, None] for part in (ends.yoke_turn, ends.yoke_both, ends.yoke_lift))
    bent = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    tilted = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    turned = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(lift * bent + both * tilted + turn * turned)


def _stations(slices: Slices) -> tuple[np.ndarray, int]:
    """Return distances (…, k) in m from the root to the slices of a path cut by `_cut_at`, and the pin's slice."""
    weight = slices.running[-1] * slices.share
    # The middle of each slice, whose weights add up to the length of its piece.
    along = np.cumsum(weight, -1) - weight / 2
    return along, int(np.flatnonzero((slices.share == 0).reshape(-1, slices.share.shape[-1]).all(0))[1])


def pushed_stress(section: BeamSection, tip: np.ndarray, modulus: Array, poisson: Array) -> Array:
    """Return the largest stress in Pa along one beam while its pin is pushed down by 1 N, without notch factors.

    `tip` (6,) is the motion in m of the tip under this push. Bending in both planes and torsion count as in
    `largest_stress` of bent beams; what the pin stiffens does not.
    """
    pin = section.pin
    assert pin is not None, "the beam has a pin"
    length = np.asarray(section.length, float)
    at = pin.share * length
    half = np.asarray(pin.diameter) / 2
    bare = section._replace(path=_cut_round_pin(section))
    push = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    bending = modulus * section.width * section.thickness**3 / 12
    yokes = _yoke_at_tip(section.ends) / bending, 0.0
    parts = []
    for plane, index, yoke in zip(_planes(bare, modulus, poisson), (_UP, _SIDE), yokes, strict=True):
        along, station = _stations(plane.slices)
        # The push as a load on the tip that makes the same loads before the pin, and what the held tip adds.
        carried = plane.back[station].T @ push[index]
        loose = plane.running_to(slice(station, station + 1))[0] @ carried
        load = np.linalg.solve(plane.flexibility + yoke, tip[index] - loose)
        before = along < at - half / 2
        inside = np.einsum("kij,kj->ki", plane.within, load + before[:, None] * carried)
        parts.append(inside)
    loads = np.concatenate(parts, -1)[..., np.argsort(_UP + _SIDE)]
    return _mises(loads, plane.slices.width, np.asarray(section.thickness, float)[..., None]).max(-1)


def _cut_round_pin(section: BeamSection) -> tuple[tuple[Array, Array], ...]:
    """Return the path of a beam, cut on both sides of its pin and at the pin's axis.

    A search also tries beams too short for the pin. There the cuts move beyond the flare, which must end on the first
    piece, and stay on the beam.
    """
    pin = section.pin
    assert pin is not None, "the beam has a pin"
    length = np.asarray(section.length, float)
    at = pin.share * length
    half = np.asarray(pin.diameter) / 2
    first = np.asarray(section.fillet) + LEAST_PIECE_M
    cuts = [np.clip(cut, first, np.maximum(length, first)) for cut in (at - half, at, at + half)]
    return _cut_at(section.path or ((length, 0.0 * length),), cuts)


def _cut_at(path: Sequence[tuple[Array, Array]], cuts: Sequence[Array]) -> tuple[tuple[Array, Array], ...]:
    """Return a path cut at three distances from the root, with a piece of zero length at the second cut."""
    ends = np.cumsum([np.broadcast_arrays(length, *cuts)[0] for length, _ in path], axis=0)
    low = 0.0 * ends[-1]
    pieces: list[tuple[Array, Array]] = []
    for number, high in enumerate((*cuts, ends[-1])):
        if number == 2:
            pieces.append((0.0 * low, 0.0 * low))
        for end, (length, turn) in zip(ends, path, strict=True):
            inside = np.clip(np.minimum(end, high) - np.maximum(end - length, low), 0.0, None)
            if (inside > 0).any():
                pieces.append((inside, turn * inside / np.maximum(length, SHORTEST_M)))
        low = np.asarray(high)
    return tuple(pieces)


def largest_inverse_square(section: BeamSection, modulus: Array, poisson: Array, density: float) -> Array:
    """Return an upper bound in s² of 1/ω² for a bent beam held at both ends; ω is its lowest angular frequency.

    The bound is Dunkerley's sum over slices.
    """
    slowness = []
    for plane in _planes(section, modulus, poisson):
        stiffness = np.linalg.inv(plane.flexibility)[..., None, :, :]
        held = plane.running - plane.running @ stiffness @ plane.running
        diagonal = np.diagonal(plane.back @ held @ np.swapaxes(plane.back, -1, -2), axis1=-2, axis2=-1)
        slowness.append(density * (diagonal * plane.inertia).sum((-2, -1)))
    return np.maximum(*slowness)


def root_load(section: BeamSection, load: np.ndarray) -> np.ndarray:
    """Return forces and moments (…, 6) at the root for a `load` (…, 6) on the tip, along the axes at the root."""
    if section.path:
        return _loads(section, load)[0][..., 0, :]
    moved = load.copy()
    moved[..., 4] -= section.length * load[..., 2]
    moved[..., 5] += section.length * load[..., 1]
    return moved


def largest_stress(section: BeamSection, load: np.ndarray) -> Array:
    """Return the largest stress (…) in Pa along a beam for a `load` (…, 6) on its tip, without notch factors.

    For a straight beam it is the stress of vertical bending: the moment is linear and the section uniform but for the
    flare, so the largest is at the root, where the flare ends, or at the tip. For a bent beam it is bending in both
    planes and torsion together, after von Mises (torsion of a rectangle by Roark's formula).
    """
    thickness = np.asarray(section.thickness, float)
    if section.path:
        loads, width = _loads(section, load)
        return _mises(loads, width, thickness[..., None]).max(-1)
    stations: list[tuple[Any, Any]] = [
        (0.0, section.width + 2 * np.asarray(section.fillet)),
        (section.fillet, section.width),
        (section.length, section.width),
    ]
    stresses = [
        np.abs(load[..., 2] * (section.length - at) - load[..., 4]) * 6 / (width * section.thickness**2)
        for at, width in stations
    ]
    return np.maximum.reduce(np.broadcast_arrays(*stresses))


def _mises(loads: np.ndarray, width: Array, t: Array) -> Array:
    """Return the von Mises stress (…, k) in Pa of sections `t` m thick under the moments of `loads` (…, k, 6).

    The forces among the loads are left out.
    """
    slim = np.minimum(width, t) / np.maximum(width, t)
    pulled = (np.abs(loads[..., 4]) / t + np.abs(loads[..., 5]) / width) * 6 / (width * t)
    series = 1 + slim * (0.6095 + slim * (0.8865 + slim * (-1.8023 + slim * 0.91)))
    twisted = 3 * loads[..., 3] / (width * t * np.minimum(width, t)) * series
    return np.sqrt(pulled**2 + 3 * twisted**2)


def _flared(section: BeamSection) -> tuple[list[Array], list[Array], Array, Array]:
    """Return a beam's flexibility integrals with the flare at its root, before division by elastic moduli.

    ∫ (l−s)^p ds/I for p = 0, 1, 2 of vertical and of lateral bending, then ∫ ds/A and ∫ ds/J; by Gauss points within
    the flare.
    """
    width, thickness, length, fillet = (np.asarray(v, float) for v in section[:4])
    across, beads = (np.asarray(v, float) for v in (section.across, section.beads))
    start = np.minimum(fillet, length)
    at = _NODES * start[..., None]
    radius = fillet[..., None]
    flared = width[..., None] + 2 * (radius - np.sqrt(np.maximum(radius**2 - (radius - at) ** 2, 0)))
    t = thickness[..., None]
    weight = _WEIGHTS * start[..., None]
    arm = length[..., None] - at
    straight = length - start

    def moments(flared_inertia: Array, uniform_inertia: Array) -> list[Array]:
        terms = weight / flared_inertia
        run = straight / uniform_inertia
        moment_rows = []
        for power in (1, 2, 3):
            moment_rows.append(terms.sum(-1) + run / power)
            terms = terms * arm
            run = run * straight
        return moment_rows

    return (
        moments(flared * t**3 / 12, width * thickness**3 / 12),
        moments(t * flared**3 / 12, thickness * width**3 / 12),
        (weight / (flared * t)).sum(-1) + straight / (width * thickness),
        (weight / torsion_constant(flared, t, across[..., None], beads[..., None])).sum(-1)
        + straight / torsion_constant(width, thickness, across, beads),
    )


_UP = [2, 3, 4]
_SIDE = [0, 1, 5]
"""Degrees of freedom out of a bent beam's plane and in it; a rectangular section does not couple the two."""


class _Plane(NamedTuple):
    """Flexibility of a beam with bends for the three motions in its plane, or for the three out of it.

    For each of k slices: `within` (…, k, 3, 3), the internal load per unit load on the tip; `compliance` (…, k, 3), the
    deformation per unit internal load; `back` (…, k, 3, 3), the motion there per unit motion of the tip if all were
    rigid; `inertia` (…, k, 3), mass and rotary inertia over density. `root` and `tip` (…, 3) are the compliance of the
    ends.
    """

    slices: Slices
    within: np.ndarray
    back: np.ndarray
    compliance: np.ndarray
    root: np.ndarray
    tip: np.ndarray
    inertia: np.ndarray

    @property
    def flexibility(self) -> Array:
        """Flexibility of the tip (…, 3, 3)."""
        per_slice = self.compliance * self.slices.running[-1][:, None]
        return _squared(self.within, per_slice) + self._at_root + self.tip[..., None] * np.eye(3)

    @property
    def running(self) -> Array:
        """Flexibility (…, k, 3, 3) of the part between root and each slice, for loads on the tip."""
        return self.running_to(slice(None))

    def running_to(self, stations: slice) -> Array:
        """Flexibility (…, n, 3, 3) of the part between root and each of n slices, for loads on the tip."""
        per_slice = np.swapaxes(self.within, -1, -2) @ (self.compliance[..., None] * self.within)
        grown = per_slice.reshape(*per_slice.shape[:-2], 9)
        running = self.slices.running[stations] @ grown
        return running.reshape(*running.shape[:-1], 3, 3) + self._at_root[..., None, :, :]

    @property
    def _at_root(self) -> Array:
        # The ends' compliance in twist may be negative (held warping), so `_squared` cannot take its square root.
        first = self.within[..., 0, :, :]
        return np.swapaxes(first, -1, -2) @ (self.root[..., None] * first)


def _squared(rows: np.ndarray, weight: np.ndarray) -> Array:
    """Return the sum (…, 3, 3) over slices of rowsᵀ · weight · rows, for `rows` (…, k, 3, 3) and `weight` (…, k, 3)."""
    scaled = np.sqrt(weight)[..., None] * rows
    flat = scaled.reshape(*scaled.shape[:-3], -1, 3)
    return np.swapaxes(flat, -1, -2) @ flat


def _planes(section: BeamSection, modulus: Array, poisson: Array) -> tuple[_Plane, _Plane]:
    """Return a bent beam's flexibility out of its plane (up, about x and y) and in it (along, sideways, about z)."""
    slices = beam_slices(section.path, section.width, section.fillet)
    parts = flexibility(section, modulus, poisson)
    x = slices.x
    y = slices.y
    cosine = slices.cosine
    sine = slices.sine
    zero = 0.0 * slices.x
    plain, thickness, held = (
        np.asarray(v, float)[..., None] for v in (section.width, section.thickness, section.ends.curl_pure)
    )
    width = slices.width
    shear_modulus = modulus / (2 * (1 + poisson))
    sheared = 10 * (1 + poisson) / (12 + 11 * poisson) * shear_modulus
    across, beads = (np.asarray(v, float)[..., None] for v in (section.across, section.beads))
    area = width * thickness
    line = plain * thickness
    torsion = torsion_constant(width, thickness, across, beads)
    bending = modulus / (1 - held) * width * thickness**3 / 12
    lateral = modulus * thickness * width**3 / 12
    high = plain * thickness**3 / 12
    wide = thickness * plain**3 / 12
    inner = bend_stiffening(slices.curved)
    twisting = piece_twist(slices.straight, np.asarray(section.ends.warping)[..., None]) / inner
    # These compliances are of both ends together; each end has half.
    shear = parts.end_shear / 2
    twist = parts.end_twist / 2
    slip = parts.lateral_end_shear / 2
    pull = [cosine, sine, x * sine - y * cosine]
    push = [-sine, cosine, x * cosine + y * sine]
    # Compliances and inertias per length become those of the slices.
    share = slices.share[..., None]
    weight = slices.running[-1][:, None] * share
    up = _Plane(
        slices,
        out_of_plane_loads(slices),
        matrices([1 + zero, y, -x], [zero, cosine, sine], [zero, -sine, cosine]),
        columns([1 / (area * sheared * across), twisting / (torsion * shear_modulus), 1 / (bending * inner)]) * share,
        columns([shear, twist, parts.root]),
        columns([shear, twist, parts.tip]),
        columns([line, high + wide, high]) * weight,
    )
    side = _Plane(
        slices,
        in_plane_loads(slices),
        matrices(pull, push, [zero, zero, 1 + zero]),
        columns([1 / (area * modulus), 1 / (area * sheared * beads), 1 / lateral]) * share,
        columns([0 * slip, slip, parts.lateral_root]),
        columns([0 * slip, slip, parts.lateral_tip]),
        columns([line, line, wide]) * weight,
    )
    return up, side


def bend_stiffening(curved: Array) -> Array:
    """Return how many times stiffer a bend is out of its plane than a straight beam.

    `curved` is the width over twice the radius. Slices turn as rigid sections, over less length on the inner side. This
    is the first term of the mean across the width of the axis' radius over the local radius (as in Winkler's theory of
    thick curved bars, Timoshenko, Strength of Materials). The full series overrates sharp bends (docs/accuracy.md).
    """
    return 1 + curved**2 / 3


def piece_twist(straight: Array, warping: Array) -> Array:
    """Return a straight piece's twist with ends kept from warping, divided by its twist with ends free to warp.

    `warping` is that of `EndCompliance`, in m.
    """
    pieces = np.maximum(straight, SHORTEST_M) / np.maximum(warping, SHORTEST_M)
    return 1 - np.tanh(pieces) / pieces


def doubtful_energies(section: BeamSection, load: np.ndarray, modulus: Array, poisson: Array) -> tuple[Array, Array]:
    """Return twice two possible errors (…) in J of a bent beam's elastic energy, for a `load` (…, 6) on its tip.

    The first is what the rest of the series of `bend_stiffening` would take from bending and twist of the bends. The
    second is what twist would add to the straight pieces, were their ends free to warp (`piece_twist`).
    """
    up, _ = _planes(section, modulus, poisson)
    slices = up.slices
    inside = np.einsum("...kij,...j->...ki", up.within, load[..., _UP])
    energy = inside**2 * up.compliance * slices.running[-1][:, None]
    curved = np.minimum(slices.curved, MOST_CURVED)
    whole = np.arctanh(curved) / np.maximum(curved, SHORTEST_M)
    rest = np.where(curved > 0, whole / bend_stiffening(curved) - 1, 0)
    twisted = piece_twist(slices.straight, np.asarray(section.ends.warping)[..., None])
    freed = 1 / np.maximum(twisted, SHORTEST_M) - 1
    return (rest * energy[..., 1:].sum(-1)).sum(-1), (freed * energy[..., 1]).sum(-1)


def _loads(section: BeamSection, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return internal loads (…, k, 6) at a bent beam's slices for a `load` (…, 6) on its tip, and the slices' widths.

    The second result is the width (…, k) of each slice in m.
    """
    slices = beam_slices(section.path, section.width, section.fillet)
    parts = [
        np.einsum("...pij,...j->...pi", within(slices), load[..., index])
        for within, index in ((out_of_plane_loads, _UP), (in_plane_loads, _SIDE))
    ]
    return np.concatenate(parts, -1)[..., np.argsort(_UP + _SIDE)], slices.width


def _of_planes(planes: list[np.ndarray]) -> np.ndarray:
    """Return a matrix (…, 6, 6) from its blocks (…, 3, 3) for motions out of a beam's plane and in that plane."""
    whole = np.zeros((*planes[0].shape[:-2], 6, 6))
    for index, part in zip((_UP, _SIDE), planes, strict=True):
        whole[..., np.array(index)[:, None], index] = part
    return whole


# Constants of the laws, all fitted.
CURL_PURE = 0.0181, 0.3519, 0.3579, 0.2695, 0.4135
CURL_GUIDED = 0.0947, 0.0782, 0.2293, 0.1086, 0.0301
"""Coefficients of `anticlastic_factors` in powers of length over width: two of the numerator, then three below it."""
CURL_NARROW = 3.56
"""Factor of thickness over width, by which `anticlastic_factors` counts narrow beams longer than they are."""
ROOT = 0.655
ROOT_HEIGHT = 0.996
FRAME = 0.874
TIP = 0.545
TIP_HEIGHT = 0.521
NARROW = 0.303
WALL = 1.27
BURIED = 2.64
THIN = 1.95
SPREAD = 4.65
DROP = 10.7
DROP_NARROW = 0.377
SIDE = 0.54
SIDE_NARROW = 0.024
SLIDE = 0.22
TWIST = 0.34
WARPING = 0.59
LAYERS = 0.35
LAYERS_SPREAD = 0.4
LAYERS_WALL = 0.71
BEADS = 0.5
PIN_ENDS = 0.9
PIN_SPREAD = 2.5
BAR_END = 1.4
BAR_SIDE = 2.39
BAR_PULL = 1.62
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
    """Sizes in m of the parts that hold a beam's ends: the frame at the root, and the plate's wall or yoke at the tip.

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
    across, beads = (np.asarray(v, float) for v in (section.across, section.beads))
    softer = layered_edge(across, poisson) ** (width / (width + LAYERS_SPREAD * thickness)) * beads**-BEADS
    softer_sideways = across**-LAYERS * beads**-BEADS
    flared = np.sqrt(width / (width + 2 * np.asarray(section.fillet)))
    side = 1 / (SIDE * width) + SIDE_NARROW / thickness
    if around.yoke:
        mount, unheld = _crossbar_twist(section, around.yoke, poisson)
        sideways, twisted, stretched = _yoke_compliance(section, around.yoke, poisson)
        turn, both, lift = _yoke_bending(section, around.yoke, poisson)
    else:
        mount = _wall_compliance(section, around)
        sideways = twisted = stretched = unheld = turn = both = lift = 0.0
    tall = thickness * np.sqrt(beads / across)
    held = _warping_length(WARPING, width, tall, inf if section.path else length, poisson)
    # A narrow beam is held over less length than a plate of its width.
    held_pure, held_guided = anticlastic_factors(length / width * (1 + CURL_NARROW * thickness / width))
    # Curling is the product of both Poisson's ratios, and the one across the beads is smaller by `beads`.
    held_share = poisson**2 * beads
    ends = EndCompliance(
        root=softer * flared / (1 / (ROOT * thickness) + 1 / (FRAME * around.frame)),
        tip=softer / (1 / (TIP * thickness) + NARROW / width) + mount,
        lateral_root=softer_sideways * flared**4 / (side + 1 / (FRAME * around.frame)),
        lateral_tip=softer_sideways / side + sideways,
        shear=softer / (1 / (DROP * thickness) + DROP_NARROW / width),
        lateral_shear=SLIDE * width,
        twist=TWIST / (1 / width + 1 / thickness) - (0.0 if section.path else held) + twisted,
        curl_pure=held_pure * held_share,
        curl_guided=held_guided * held_share,
        root_height=ROOT_HEIGHT * thickness,
        tip_height=TIP_HEIGHT * thickness,
        stretch=stretched,
        mount=mount,
        # Bends (about the vertical) keep a tall strip from warping; the warping of a flat one goes on round them.
        warping=np.where(tall > width, held, 0.0) if section.path else 0.0,
        yoke_turn=turn,
        yoke_both=both,
        yoke_lift=lift,
        mount_held=unheld,
    )
    return section._replace(ends=ends)


def layered_edge(across: Array, poisson: Array) -> Array:
    """Return how much more a half-plane's edge yields to pressure with weakly bonded layers: a ratio, 1 for full bonds.

    It is 1 for full bonds. The layers lie along the pressure. `across` is the stiffness across them over that along
    them.

    Notes
    -----
    Lekhnitskii, Theory of Elasticity of an Anisotropic Body, 1963, on the orthotropic half-plane: the edge sinks in
    proportion to ``s₁₁ (μ₁ + μ₂)/i``, with ``(μ₁ + μ₂)² = −(2 √(s₁₁ s₃₃) + 2 s₁₃ + s₅₅)/s₁₁``. Here
    ``s₃₃ = s₁₁/across``, ``s₁₃ = −ν s₁₁`` and ``s₅₅ = 2 (1 + ν) s₁₁/across``, as in `padgen.verify.elasticity.layered`.
    Under a beam much narrower than thick the material beside it holds, too, along its layers: `on_elastic_ends` takes
    a power of this.
    """
    return np.sqrt((1 / np.sqrt(across) - poisson + (1 + poisson) / across) / 2)


def within_fitted_range(width: Array, thickness: Array, length: Array) -> Array:
    """Return which beams are long enough, relative to width and thickness, for the fitted laws of this module."""
    return (length >= SHORTEST_THICKNESSES * thickness) & (length >= SHORTEST_WIDTHS * width)


def _wall_compliance(section: BeamSection, around: Surroundings) -> Array:
    """Return the length in m of beam that bends as much as the wall between the plate's edge and its recess does.

    The wall hangs from the roof of the recess like a plate, as high as the recess is deep, and spreads the moment over
    that height. A thick beam reaches the roof itself.
    """
    width, thickness = (np.asarray(v, float) for v in section[:2])
    depth = np.asarray(around.recess_depth, float)
    # The recess is round, so the wall is thicker away from its middle.
    wall = around.wall + width**2 / (24 * around.recess_radius)
    hanging = np.maximum(1 - thickness / (BURIED * depth), 0)
    bent = WALL * depth * hanging * (thickness / wall) ** THIN * width / (width + SPREAD * depth)
    across, beads = (np.asarray(v, float) for v in (section.across, section.beads))
    return bent * across**-LAYERS_WALL * beads**-BEADS


def _yoke_compliance(section: BeamSection, yoke: YokeSize, poisson: Array) -> tuple[Array, ...]:
    """Return lengths of beam in m as compliant as a yoke's crossbar: in lateral bending, twist and stretch.

    Each is the beam's section constant over the bar's.
    """
    width, thickness = (np.asarray(v, float) for v in section[:2])
    across = np.asarray(section.across, float)
    arm, bar, height, _, _ = yoke
    shear = 2 * (1 + poisson)
    sideways = BAR_SIDE * arm * thickness * width**3 / (height * bar**3)
    twisted = arm * torsion_constant(width, thickness, across, section.beads) * 12 / shear / (bar * height**3)
    return sideways, twisted, BAR_PULL * 4 * arm**3 * width * thickness / (height * bar**3)


def _crossbar_twist(section: BeamSection, yoke: YokeSize, poisson: Array) -> tuple[Array, Array]:
    """Return the length in m of beam that bends as much as a yoke's crossbar twists, and what free warping would add.

    The second is what the length would gain if the crossbar's ends were free to warp.
    """
    across = np.asarray(section.across, float)
    arm, bar, height, _, _ = yoke
    held = _warping_length(WARPING, bar, height / np.sqrt(across), arm, poisson)
    inertia = np.asarray(section.width, float) * np.asarray(section.thickness, float) ** 3 / 12
    softness = inertia * 2 * (1 + poisson) / torsion_constant(bar, height, across)
    return softness * (arm + BAR_END * bar - held), softness * held


def _yoke_bending(section: BeamSection, yoke: YokeSize, poisson: Array) -> tuple[Array, Array, Array]:
    """Return what a yoke that bends up and down adds to a beam's ∫ (l−s)^p ds, p = 0, 1, 2, in m, m² and m³.

    Neck and crossbar are beams in Euler's theory (Timoshenko, Strength of Materials), each clamped in what holds it as
    elastically as a beam in a frame (`ROOT`). The neck carries both beams' moments, which change with the distance from
    the tips as in the beam beside it. The crossbar is a cantilever from the neck to the middle of a beam: the beam's
    force bends it, its resistance to twist bends it back, and it shears.
    """
    width, thickness, length = (np.asarray(v, float) for v in section[:3])
    across = np.asarray(section.across, float)
    arm, bar, height, neck_length, neck_width = yoke
    inertia = width * thickness**3 / 12
    held = ROOT * height
    shear = 2 * (1 + poisson)
    neck = 2 * 12 * inertia / (neck_width * height**3)
    crossbar = 12 * inertia / (bar * height**3)
    reach = arm + width / 2
    lifted = reach**3 / 3 + held * reach**2
    both = reach**2 / 2 + held * reach
    turned = reach + held
    # The beam's stiffness in twist over that of the crossbar in bending, per length.
    back = torsion_constant(width, thickness, across, section.beads) / (shear * length) * crossbar / inertia
    bent = lifted - both**2 * back / (1 + turned * back)
    sheared = 1.2 * shear * reach * inertia / (bar * height * across)
    return (
        neck * (neck_length + held),
        neck * (neck_length**2 / 2 + held * neck_length),
        neck * (neck_length**3 / 3 + held * neck_length**2) + crossbar * bent + sheared,
    )


def _warping_length(share: float, one: Array, other: Array, length: Array, poisson: Array) -> Array:
    """Return how much shorter in m a bar of section `one` × `other` acts in torsion because its ends cannot warp."""
    slim = np.minimum(one, other) / np.maximum(one, other)
    warping = 2 * share * np.maximum(one, other) * np.sqrt((1 + poisson) / 24) * (1 - slim**2)
    return warping * np.tanh(length / np.maximum(warping, 1e-12))
