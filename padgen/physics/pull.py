"""Pull of a coil with its core on a washer anywhere above it: force, side force and moment, by surface charges.

Windings are the magnetic charge on the ends of the magnetisation that has their current; core and washer are linear
steel (`physics.steel_body`), each in orders round its own axis, and each draws charge to the other. The force on the
washer is that of the field of all others on its charge.
"""

from functools import lru_cache
from math import ceil
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
LOST_SHARE = 0.0015
"""Of the forces up and down on parts of a washer, that does not cancel as it should (docs/accuracy.md)."""
COARSE = 0.1
"""Relative error of a pull with half of the nodes that it takes."""


class Pull(NamedTuple):
    """What a coil does to a washer, per A²: forces in N away from the coil's axis and upwards, and the moment in
    N·m about an axis across, through the middle of the washer's underside, that presses its far side up.

    The axial force may be off by `doubt` in N: a share of the forces up and down on all of the washer's charge, which
    may all but cancel, and more where there are not nodes enough. `dipole` in A·m² per ampere is what the coil makes of
    the washer.
    """

    side: float
    axial: float
    moment: float
    doubt: float
    dipole: float


class _Fineness(NamedTuple):
    """Nodes of a pair at one place: on faces of washer and core, and orders round the axes of both.

    `coarse` is how many times too few they are, at most; 1 where they are enough.
    """

    face: int
    top: int
    orders: int
    core_orders: int
    coarse: float


def pull(coil: CoilSource, washer: SteelRing, gap: float, offset: float) -> Pull:
    """The pull of a coil on a washer `gap` m over its top face and `offset` m off its axis.

    Against 3-D field solutions of 300 random pairs (docs/accuracy.md) the axial force is within 1 % for most; it is
    less sure where washers lie so that the forces on their parts cancel.
    """
    fine = _fineness(coil, washer, gap, offset)
    step = max(STEP * gap, coil.outer_diameter / MOST_RINGS)
    core = charged_core(coil, fine.top, fine.core_orders)
    body = _washer(washer, fine.face, fine.orders)
    turns = 1 if offset == 0 else fine.orders + 3
    angle = (np.arange(turns) + 0.5) * np.pi / turns
    arm = body.radius[:, None] * np.cos(angle)
    x, y = offset + arm, body.radius[:, None] * np.sin(angle)
    z = np.broadcast_to((body.height + gap)[:, None], x.shape)
    rho = np.maximum(np.hypot(x, y), 1e-9 * washer.outer_diameter)
    around = np.arctan2(y, x)
    radius, height, charge = winding_rings(coil.windings, step)
    of = ring_potential(rho[..., None], z[..., None], radius, height, 0, at_ring=False)
    potential, along_r, along_z, across = *(part[0] @ charge for part in of), np.zeros(x.shape)
    order = np.arange(fine.orders + 1)
    cosines = np.cos(order[:, None] * angle)
    project = cosines / turns / _mean_square(len(order))[:, None]
    if core is None:
        drawn = (body.response @ (project @ potential.T)[..., None])[..., 0]
    else:
        steel, own = core
        radius, height, shares = fine_rings(steel, step)
        of = ring_potential(rho[..., None], z[..., None], radius, height, fine.core_orders, at_ring=False)
        charge = shares @ own
        potential, along_r, along_z = (
            a + part[0] @ charge for a, part in zip((potential, along_r, along_z), of, strict=True)
        )
        order = np.arange(fine.core_orders + 1)[:, None, None]
        cosine, sine = np.cos(order * around), np.sin(order * around)
        at_nodes = (of.value @ shares) * cosine[..., None]
        to_washer = np.einsum("mp,cjpi->mjci", project, at_nodes, optimize=True)
        drawn, back = _mutual(body, steel, to_washer, project @ potential.T)
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
    doubt = LOST_SHARE * np.abs(upwards).sum() + COARSE * (fine.coarse - 1) * abs(axial)
    return Pull(*map(float, (sideways.sum(), axial, moment, doubt, dipole)))


def _fineness(coil: CoilSource, washer: SteelRing, gap: float, offset: float) -> _Fineness:
    """As many nodes as it takes to see what is a gap wide, within bounds of time."""
    width, rim, core = (
        (washer.outer_diameter - washer.inner_diameter) / 2,
        washer.outer_diameter / 2,
        coil.core_diameter / 2,
    )
    wanted = [5 + 0.5 * width / gap, 6 + core / gap]
    if offset:
        wanted += [3 + 1.3 * rim / (gap + 0.15e-3), 3 + 1.2 * min(offset, core + rim) / (gap + 0.3e-3)]
    counts = [min(ceil(count), most) for count, most in zip(wanted, MOST, strict=False)]
    coarse = max(1.0, *(count / most for count, most in zip(wanted, MOST, strict=False)))
    face, top, orders, core_orders = [*counts, 0, 0][: len(MOST)]
    return _Fineness(face, top, orders, core_orders, coarse)


@lru_cache(maxsize=32)
def _washer(washer: SteelRing, face: int, orders: int) -> SteelBody:
    sides = tube(washer.outer_diameter / 2, washer.inner_diameter / 2, 0.0, washer.thickness, (face, 5))
    return steel_body(sides, washer.permeability, orders)


def _mutual(
    washer: SteelBody, core: SteelBody, to_washer: np.ndarray, potential: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Charge (m, n) of the washer, and what it draws to the core (m, k), each in the other's field.

    `to_washer` (m, n, m, k) gives the potential at the washer's nodes of the core's charge; what is the other way
    round follows from the energy that they have together.
    """
    orders, nodes, core_orders, others = to_washer.shape
    forth = to_washer.reshape(orders * nodes, core_orders * others)
    weight, weight_core = (
        (_mean_square(count)[:, None] * body.area).ravel() for count, body in ((orders, washer), (core_orders, core))
    )
    back = (forth * weight[:, None] / weight_core).T.reshape(core_orders, others, -1)
    echoed = (core.response @ back).reshape(core_orders * others, -1)
    mutual = (washer.response @ (forth @ echoed).reshape(orders, nodes, -1)).reshape(orders * nodes, -1)
    alone = (washer.response @ potential[..., None])[..., 0]
    charge = np.linalg.solve(np.eye(orders * nodes) - mutual, alone.ravel())
    return charge.reshape(orders, nodes), (echoed @ charge).reshape(core_orders, others)


def _mean_square(orders: int) -> np.ndarray:
    """Of cos mφ, for m = 0 … `orders` − 1."""
    return np.where(np.arange(orders) == 0, 1.0, 0.5)
