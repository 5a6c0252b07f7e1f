"""Pull of a coil with its core on a washer anywhere above it: force, side force and moment, by surface charges.

Windings are the magnetic charge on the ends of the magnetisation that has their current; core and washer are linear
steel (`physics.steel_body`), each in orders round its own axis, and each draws charge to the other. The force on the
washer is that of the field of all others on its charge.
"""

from functools import lru_cache
from math import ceil, log
from typing import NamedTuple

import numpy as np

from padgen.physics.coil_field import MOST_RINGS, charged_core, winding_rings
from padgen.physics.magnetics import MU_0, CoilSource, SteelRing
from padgen.physics.ring_charges import ring_potential
from padgen.physics.steel_body import SteelBody, fine_rings, steel_body, tube

__all__ = ["Pull", "pull"]

STEP = 0.8
"""Rings that face the washer lie this share of the gap apart at most."""
MOST = (20, 40, 30, 40)
"""Most nodes on faces of washer and core, and orders round either axis, for the sake of time."""
SOLVED, MOST_STEPS = 1e-7, 60
"""Relative remainder at which two bodies' charges are solved, and the most steps for it."""
LOST_SHARE = 0.0015
"""Of the forces up and down on parts of a washer, that does not cancel as it should (docs/accuracy.md)."""
FEWER = 0.7
"""Of the nodes that it takes: what that changes counts as doubt."""
MOST_ACROSS = 50
"""Gaps across the core's radius or the washer's ring: with more, they would take too many nodes."""
FURTHER = 1.05
"""Over the least gap that is solved: from these two the pull is taken further down."""


class Pull(NamedTuple):
    """What a coil does to a washer, per A²: forces in N away from the coil's axis and upwards, and the moment in
    N·m about an axis across, through the middle of the washer's underside, that presses its far side up.

    The axial force may be off by `doubt` in N: a share of the forces up and down on all of the washer's charge, which
    may all but cancel, and what fewer nodes would change. `dipole` in A·m² per ampere is what the coil makes of
    the washer.
    """

    side: float
    axial: float
    moment: float
    doubt: float
    dipole: float


class _Fineness(NamedTuple):
    """Nodes of a pair at one place: on faces of washer and core, and orders round the axes of both."""

    face: int
    top: int
    orders: int
    core_orders: int


def pull(coil: CoilSource, washer: SteelRing, gap: float, offset: float) -> Pull:
    """The pull of a coil on a washer `gap` m over its top face and `offset` m off its axis.

    Against 3-D field solutions of 300 random pairs (docs/accuracy.md) the axial force is within 1 % for most; it is
    less sure where washers lie so that the forces on their parts cancel. Nearer than nodes can see it goes on as it
    changes there, with the logarithm of the gap, and may be off by all of that.
    """
    least = _least_gap(coil, washer, offset)
    if gap >= least:
        return _solved(coil, washer, gap, offset)
    at, further = (np.array(_solved(coil, washer, least * share, offset)) for share in (1.0, FURTHER))
    change = (at - further) * log(least / gap) / log(FURTHER)
    side, axial, moment, _, dipole = at + change
    return Pull(*map(float, (side, axial, moment, at[3] + abs(change[1]), dipole)))


@lru_cache(maxsize=1024)
def _solved(coil: CoilSource, washer: SteelRing, gap: float, offset: float) -> Pull:
    """The pull with enough nodes, and its doubt by what fewer of them would make of it."""
    fine = _fineness(coil, washer, gap, offset)
    enough, fewer = (_pull_by(nodes, coil, washer, gap, offset) for nodes in (fine, _fewer(fine)))
    return enough._replace(doubt=enough.doubt + abs(enough.axial - fewer.axial))


def _pull_by(fine: _Fineness, coil: CoilSource, washer: SteelRing, gap: float, offset: float) -> Pull:
    near = _nearest(coil, washer, gap, offset)
    finest = coil.outer_diameter / MOST_RINGS
    core = charged_core(coil, fine.top, fine.core_orders)
    body = _washer(washer, fine.face, fine.orders)
    turns = 1 if offset == 0 else fine.orders + 3
    angle = (np.arange(turns) + 0.5) * np.pi / turns
    arm = body.radius[:, None] * np.cos(angle)
    x, y = offset + arm, body.radius[:, None] * np.sin(angle)
    z = np.broadcast_to((body.height + gap)[:, None], x.shape)
    rho = np.maximum(np.hypot(x, y), 1e-9 * washer.outer_diameter)
    around = np.arctan2(y, x)
    radius, height, charge = winding_rings(coil.windings, max(STEP * gap, finest))
    of = ring_potential(rho[..., None], z[..., None], radius, height, 0, at_ring=False)
    potential, along_r, along_z, across = *(part[0] @ charge for part in of), np.zeros(x.shape)
    order = np.arange(fine.orders + 1)
    cosines = np.cos(order[:, None] * angle)
    project = cosines / turns / _mean_square(len(order))[:, None]
    if core is None:
        drawn = (body.response @ (project @ potential.T)[..., None])[..., 0]
    else:
        steel, own = core
        radius, height, shares = fine_rings(steel, max(STEP * near, finest))
        of = ring_potential(rho[..., None], z[..., None], radius, height, fine.core_orders, at_ring=False)
        charge = shares @ own
        potential, along_r, along_z = (
            a + part[0] @ charge for a, part in zip((potential, along_r, along_z), of, strict=True)
        )
        order = np.arange(fine.core_orders + 1)[:, None, None]
        cosine, sine = np.cos(order * around), np.sin(order * around)
        at_nodes = (of.value @ shares) * cosine[..., None]
        drawn, back = _mutual(body, steel, at_nodes, project, project @ potential.T)
        charges = back @ shares.T
        field = [(part @ charges[:, None, :, None])[..., 0] for part in of]
        along_r = along_r + (field[1] * cosine).sum(0)
        along_z = along_z + (field[2] * cosine).sum(0)
        across = -(field[0] * sine * order).sum(0) / rho
    on_charge = MU_0 / turns * body.area[:, None] * (drawn.T @ cosines)
    sideways = -on_charge * (along_r * np.cos(around) - across * np.sin(around))
    upwards = -on_charge * along_z
    moment = (body.height[:, None] * sideways - arm * upwards).sum()
    dipole = np.hypot((on_charge * arm).sum(), (on_charge * body.height[:, None]).sum()) / MU_0
    axial = upwards.sum()
    doubt = LOST_SHARE * np.abs(upwards).sum()
    return Pull(*map(float, (sideways.sum(), axial, moment, doubt, dipole)))


def _nearest(coil: CoilSource, washer: SteelRing, gap: float, offset: float) -> float:
    """Return the distance in m of the washer's steel from the core's, or from the windings."""
    core, rim, bore = coil.core_diameter / 2, washer.outer_diameter / 2, washer.inner_diameter / 2
    beside = max(offset - rim - core, bore - core - offset, 0.0) if coil.has_core else 0.0
    return float(np.hypot(gap, beside))


def _least_gap(coil: CoilSource, washer: SteelRing, offset: float) -> float:
    """The gap in m from which on a pull can be solved: a 200th of the coil's radius; between steel as nodes allow."""
    least, beside = coil.outer_diameter / MOST_RINGS, _nearest(coil, washer, 0.0, offset)
    wide = max(washer.outer_diameter - washer.inner_diameter, coil.core_diameter) / 2
    return max(least, float(np.sqrt(max((wide / MOST_ACROSS) ** 2 - beside**2, 0.0))))


def _fineness(coil: CoilSource, washer: SteelRing, gap: float, offset: float) -> _Fineness:
    """As many nodes as it takes to see what is a gap wide, within bounds of time."""
    width, rim, core = (
        (washer.outer_diameter - washer.inner_diameter) / 2,
        washer.outer_diameter / 2,
        coil.core_diameter / 2,
    )
    near = _nearest(coil, washer, gap, offset)
    wanted = [5 + 0.5 * width / near, 6 + core / near]
    if offset:
        wanted += [3 + 1.3 * rim / (near + 0.15e-3), 3 + 1.2 * min(offset, core + rim) / (near + 0.3e-3)]
    counts = [min(ceil(count), most) for count, most in zip(wanted, MOST, strict=False)]
    return _Fineness(*[*counts, 0, 0][: len(MOST)])


def _fewer(fine: _Fineness) -> _Fineness:
    return _Fineness(*(ceil(FEWER * count) for count in fine))


@lru_cache(maxsize=32)
def _washer(washer: SteelRing, face: int, orders: int) -> SteelBody:
    sides = tube(washer.outer_diameter / 2, washer.inner_diameter / 2, 0.0, washer.thickness, (face, 5))
    return steel_body(sides, washer.permeability, orders)


def _mutual(
    washer: SteelBody, core: SteelBody, at_nodes: np.ndarray, project: np.ndarray, potential: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Charge (m, n) of the washer, and what it draws to the core (j, k), each in the other's field.

    `at_nodes` (j, n, turns, k) gives the potential at the washer's nodes of the core's charge, `project` (m, turns)
    its orders round the washer; what is the other way round follows from the energy that they have together. Solved
    by conjugate residuals (Eisenstat, Elman and Schultz, *SIAM J. Numer. Anal.* 20, 1983).
    """
    core_orders, nodes, turns, others = at_nodes.shape
    forth = at_nodes.reshape(core_orders, nodes * turns, others)
    weight, weight_core = (
        _mean_square(count)[:, None] * body.area for count, body in ((len(project), washer), (core_orders, core))
    )

    def echo(charge: np.ndarray) -> np.ndarray:
        """Return the charge that (m, n) on the washer draws to the core."""
        back = ((weight * charge).T @ project).ravel() @ forth / weight_core
        return np.asarray((core.response @ back[..., None])[..., 0])

    def answer(potential: np.ndarray) -> np.ndarray:
        return np.asarray((washer.response @ potential[..., None])[..., 0])

    left = answer(potential)
    charge, steps = np.zeros(left.shape), list[tuple[np.ndarray, np.ndarray]]()
    enough = SOLVED * np.linalg.norm(left)
    while np.linalg.norm(left) > enough and len(steps) < MOST_STEPS:
        step = left
        drop = step - answer(project @ (forth @ echo(step)[..., None]).sum(0).reshape(nodes, turns).T)
        for other, fall in steps:
            share = np.vdot(fall, drop)
            step, drop = step - share * other, drop - share * fall
        size = np.linalg.norm(drop)
        steps.append((step / size, drop / size))
        share = np.vdot(drop / size, left)
        charge, left = charge + share * step / size, left - share * drop / size
    return charge, echo(charge)


def _mean_square(orders: int) -> np.ndarray:
    """Of cos mφ, for m = 0 … `orders` − 1."""
    return np.where(np.arange(orders) == 0, 1.0, 0.5)
