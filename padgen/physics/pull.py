"""Pull of a coil with its core on a washer anywhere above it, and on the washers of its neighbours, by surface charges.

A winding is replaced by the magnetic charge on the ends of a magnetisation that has its current as curl. Core and
washer are linear steel (`magnetics.steel_body`), each expanded in orders round its own axis, and magnetise each
other. The force on the washer is that of all other charges' field on its charge; with the side force comes a moment.

Plans interpolate the pull from tables over ranges of gaps and offsets, with the error of doing so. `leakage` is the
pull on neighbours' washers relative to that of their own coil.
"""

import json
from functools import cache, lru_cache
from math import ceil, log
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from padgen.physics.magnetics import (
    CORE_ORDERS,
    MOST_RINGS,
    MU_0,
    CoilSource,
    SteelBody,
    SteelRing,
    charged_core,
    coil_poles,
    coil_rings,
    fine_rings,
    pole_field,
    ring_potential,
    rings_potential,
    steel_body,
    winding_rings,
)

__all__ = [
    "BROUGHT",
    "GAPS",
    "LOW",
    "OWN_ERROR",
    "RANGE",
    "Leakage",
    "Pull",
    "PullAt",
    "PullTable",
    "leakage",
    "make_table",
    "of_one_turn",
    "parts_key",
    "pull",
    "pull_range",
    "solved_pulls",
    "supplied_table",
]

STEP = 0.8
"""Largest distance between rings that face the washer, over the gap."""
MOST = (20, 40, 30, 40)
"""Most nodes on faces of washer and core, and highest orders round the axis of either, to save time."""
RIM_NODES = 5
"""Nodes on each rim of a washer."""
SOLVED = 1e-7
MOST_STEPS = 60
"""Relative residual at which the charges of two bodies are solved, and the most steps to reach it."""
LOST_SHARE = 0.0015
"""Error by incomplete cancellation, over the forces up and down on parts of a washer (docs/accuracy.md)."""
FEWER = 0.7
"""Share of the nodes in a second solution; its difference counts as doubt."""
MOST_ACROSS = 50
"""Most gaps across the core's radius or the washer's ring: for more, too many nodes would be needed."""
FURTHER = 1.05
"""Second gap over the least one that is solved; the pull at smaller gaps is extrapolated from these two."""


class Pull(NamedTuple):
    """Forces and moment of a coil on a washer per A², the error of the axial force, and the washer's dipole per A.

    `side` and `axial` are forces in N away from the coil's axis and upwards. `moment` in N·m is about a horizontal axis
    through the middle of the washer's underside, at right angles to the offset; a positive one lowers the washer's far
    side. `doubt` in N bounds the error of the axial force: a share of the upward and downward forces on all of the
    washer's charge, which may nearly cancel, plus the change by fewer nodes. `dipole` in A·m² per ampere is the
    washer's magnetic moment.
    """

    side: float
    axial: float
    moment: float
    doubt: float
    dipole: float


def pull(coil: CoilSource, washer: SteelRing, gap: float, offset: float, *, in_table: bool = False) -> Pull:
    """Return the pull of a coil on a washer `gap` m over its top face and `offset` m off its axis.

    Against 3-D field solutions of 300 random pairs (docs/accuracy.md) the axial force is within 1 % for most. It is
    less certain where the forces on parts of the washer nearly cancel. At gaps too small for the nodes the pull is
    extrapolated in the logarithm of the gap, and all of that change counts as doubt. A pull `in_table` is solved with
    the nodes that the worst offset needs, so that it is a smooth function of the offset.
    """
    # A 200th of the coil's radius, or more for wide steel.
    wide = max(washer.outer_diameter - washer.inner_diameter, coil.core_diameter) / 2
    beside = 0.0 if in_table else _nearest(coil, washer, 0.0, offset)
    square = (wide / MOST_ACROSS) ** 2 - beside**2
    least = max(coil.outer_diameter / MOST_RINGS, float(np.sqrt(max(square, 0.0))))
    if gap >= least:
        return _solve(coil, washer, gap, offset, in_table)
    at, further = (np.array(_solve(coil, washer, least * share, offset, in_table)) for share in (1.0, FURTHER))
    change = (at - further) * log(least / gap) / log(FURTHER)
    side, axial, moment, _, dipole = at + change
    return Pull(*map(float, (side, axial, moment, at[3] + abs(change[1]), dipole)))


@lru_cache(maxsize=1024)
def _solve(coil: CoilSource, washer: SteelRing, gap: float, offset: float, in_table: bool) -> Pull:
    """Return the pull solved with enough surface nodes; `doubt` includes its difference from that with fewer nodes."""
    near = gap if in_table else _nearest(coil, washer, gap, offset)
    fine = _fineness(coil, washer, near, None if in_table else offset)
    coarse = tuple(ceil(FEWER * count) for count in fine)
    enough, fewer = (_pull_with_nodes(nodes, near, coil, washer, gap, offset) for nodes in (fine, coarse))
    return enough._replace(doubt=enough.doubt + abs(enough.axial - fewer.axial))


def _pull_with_nodes(
    fine: tuple[int, ...], near: float, coil: CoilSource, washer: SteelRing, gap: float, offset: float
) -> Pull:
    """Return the pull solved with numbers of nodes and orders `fine`; steel of washer and core is `near` m apart."""
    face, top, orders, core_orders = fine
    finest = coil.outer_diameter / MOST_RINGS
    core = charged_core(coil, top, core_orders)
    body = _washer(washer, (face, RIM_NODES), orders)
    turns = 1 if offset == 0 else orders + 3
    angle = (np.arange(turns) + 0.5) * np.pi / turns
    arm = body.radius[:, None] * np.cos(angle)
    x = offset + arm
    y = body.radius[:, None] * np.sin(angle)
    z = np.broadcast_to((body.height + gap)[:, None], x.shape)
    rho = np.maximum(np.hypot(x, y), 1e-9 * washer.outer_diameter)
    around = np.arctan2(y, x)
    radius, height, charge = winding_rings(coil.windings, max(STEP * gap, finest))
    of = ring_potential(rho[..., None], z[..., None], radius, height, 0, at_ring=False)
    potential, along_r, along_z, across = *(part[0] @ charge for part in of), np.zeros(x.shape)
    order = np.arange(orders + 1)
    cosines = np.cos(order[:, None] * angle)
    project = cosines / turns / _mean_square(len(order))[:, None]
    if core is None:
        drawn = (body.response @ (project @ potential.T)[..., None])[..., 0]
    else:
        steel, core_nodes = core
        radius, height, shares = fine_rings(steel, max(STEP * near, finest))
        of = ring_potential(rho[..., None], z[..., None], radius, height, core_orders, at_ring=False)
        charge = shares @ core_nodes
        potential, along_r, along_z = (
            a + part[0] @ charge for a, part in zip((potential, along_r, along_z), of, strict=True)
        )
        order = np.arange(core_orders + 1)[:, None, None]
        cosine = np.cos(order * around)
        sine = np.sin(order * around)
        at_nodes = (of.value @ shares) * cosine[..., None]
        drawn, back = _mutual_charges(body, steel, at_nodes, project, project @ potential.T)
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
    doubt = LOST_SHARE * np.abs(upwards).sum()
    return Pull(*map(float, (sideways.sum(), upwards.sum(), moment, doubt, dipole)))


def _nearest(coil: CoilSource, washer: SteelRing, gap: float, offset: float) -> float:
    """Return the distance in m from the washer's steel to the core's; without a core, the gap."""
    core = coil.core_diameter / 2
    rim = washer.outer_diameter / 2
    bore = washer.inner_diameter / 2
    beside = max(offset - rim - core, bore - core - offset, 0.0) if coil.has_core else 0.0
    return float(np.hypot(gap, beside))


def _fineness(coil: CoilSource, washer: SteelRing, near: float, offset: float | None) -> tuple[int, ...]:
    """Return node counts and angular orders that resolve fields of steel `near` m away, at most `MOST` to save time.

    They are those on faces of washer and core, then the orders round the axes of both. An `offset` of None stands for
    the one that needs most.
    """
    width = (washer.outer_diameter - washer.inner_diameter) / 2
    rim = washer.outer_diameter / 2
    core = coil.core_diameter / 2
    overlap = core + rim if offset is None else min(offset, core + rim)
    wanted = [5 + 0.5 * width / near, 6 + core / near, 0.0, 0.0]
    if overlap:
        wanted[2:] = 3 + 1.3 * rim / (near + 0.15e-3), 3 + 1.2 * overlap / (near + 0.3e-3)
    return tuple(min(ceil(count), most) for count, most in zip(wanted, MOST, strict=True))


@lru_cache(maxsize=32)
def _washer(washer: SteelRing, nodes: tuple[int, int], orders: int) -> SteelBody:
    return steel_body(washer.outline(nodes), washer.permeability, orders)


def _mutual_charges(
    washer: SteelBody, core: SteelBody, at_nodes: np.ndarray, project: np.ndarray, potential: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the charge induced on the washer (m, n), by `potential` and core, and on the core (j, k), by the washer.

    `at_nodes` (j, n, turns, k) is the potential of the core's charge at the washer's nodes; `project` (m, turns)
    expands it in orders round the washer. The opposite direction follows from their mutual energy. Solved by conjugate
    residuals (Eisenstat, Elman and Schultz, *SIAM J. Numer. Anal.* 20, 1983).
    """
    core_orders, nodes, turns, others = at_nodes.shape
    forth = at_nodes.reshape(core_orders, nodes * turns, others)
    weight, weight_core = (
        _mean_square(count)[:, None] * body.area for count, body in ((len(project), washer), (core_orders, core))
    )

    def echo(charge: np.ndarray) -> np.ndarray:
        """Return the charge (j, k) that a charge (m, n) on the washer induces on the core."""
        back = ((weight * charge).T @ project).ravel() @ forth / weight_core
        return np.asarray((core.response @ back[..., None])[..., 0])

    def answer(potential: np.ndarray) -> np.ndarray:
        """Return the charge (m, n) that a potential (m, n) induces on the washer."""
        return np.asarray((washer.response @ potential[..., None])[..., 0])

    left = answer(potential)
    charge = np.zeros(left.shape)
    steps = list[tuple[np.ndarray, np.ndarray]]()
    enough = SOLVED * np.linalg.norm(left)
    while np.linalg.norm(left) > enough and len(steps) < MOST_STEPS:
        step = left
        drop = step - answer(project @ (forth @ echo(step)[..., None]).sum(0).reshape(nodes, turns).T)
        for other, fall in steps:
            share = np.vdot(fall, drop)
            step = step - share * other
            drop = drop - share * fall
        size = np.linalg.norm(drop)
        steps.append((step / size, drop / size))
        share = np.vdot(drop / size, left)
        charge = charge + share * step / size
        left = left - share * drop / size
    return charge, echo(charge)


def _mean_square(orders: int) -> np.ndarray:
    """Return the mean squares of cos mφ, for m = 0 … `orders` − 1."""
    return np.where(np.arange(orders) == 0, 1.0, 0.5)


OWN_ERROR = 0.008
"""Relative error of a solved pull (docs/accuracy.md)."""
COLUMNS = 5
DIPOLE = 4
SLOPE_STEP = 0.02
"""Relative step of the gap in differences between solved pulls."""

LOW = 0.35e-3
RANGE = 3
GAPS = 5
"""Tables are solved at `GAPS` gaps in each range, from `LOW · RANGE^k` to `LOW · RANGE^(k+1)` m."""
BROUGHT = Path(__file__).with_name("pulls")
"""Tables of catalogue parts: numbers in ``pulls.npy``; turns, reach and the ranges' places in ``pulls.json``."""


class PullAt(NamedTuple):
    """Pulls of a coil on washers (per A²) or magnets (per A) at n places, with moments, slopes and errors (n,).

    `pull` is towards the coil in N, `slope` its slope with the gap in N/m. `error` is relative; `jump` in N is its part
    from one table to the next; `slope_off` in N/m is the error of the slope, and `bend_off` in N/m² that of the second
    derivative. `side`, `moment` and `dipole` are as in `pull.Pull`; `side_across` and `moment_across` are at right
    angles to these, to the left of the way out and lowering that side, 0 over round coils.
    """

    pull: np.ndarray
    side: np.ndarray
    moment: np.ndarray
    slope: np.ndarray
    error: np.ndarray
    jump: np.ndarray
    slope_off: np.ndarray
    bend_off: np.ndarray
    dipole: np.ndarray
    side_across: np.ndarray
    moment_across: np.ndarray


class PullTable(NamedTuple):
    """Table of pulls: coefficients (gaps, offsets, 5) of Chebyshev polynomials in ln gap and squared offset.

    The five are axial force, side force and moment over the offset, doubt and dipole of `pull.Pull`, each over the
    exponential of the polynomial `scale` (gaps,) in ln gap. The table covers gaps `low` … `high` and offsets up to
    `reach`, in m.
    """

    low: float
    high: float
    reach: float
    scale: np.ndarray
    shape: np.ndarray

    def with_turns(self, share: float) -> "PullTable":
        """Return the table for a coil of `share` times the turns: forces change by share², the dipole by share."""
        scale = self.scale.copy()
        shape = self.shape.copy()
        scale[0] += 2 * log(share)
        shape[..., DIPOLE] /= share
        return self._replace(scale=scale, shape=shape)

    def at_single_offset(self, offset: float) -> "PullTable":
        """Return the table for the single `offset` in m, interpolated from the offsets of this table."""
        nodes = _chebyshev_matrices(len(self.scale))[0]
        across = chebyshev.chebvander(2 * (offset / self.reach) ** 2 - 1, self.shape.shape[1] - 1)[0]
        columns = nodes @ np.einsum("ijk,j->ik", self.shape, across) * np.exp(nodes @ self.scale)[:, None]
        reach = max(offset, 1e-9) * 2**0.5
        columns[:, 1:3] *= reach / self.reach  # side force and moment are over the offset, as a share of the reach
        return _table(self.low, self.high, reach, columns[:, None])

    def at(self, gap: np.ndarray, offset: np.ndarray) -> PullAt:
        """Return the pulls at gaps and offsets (n,) in m within the table.

        The interpolation's own error is estimated as the size of the last coefficients in both directions. Derivatives
        are less certain: doubts at all of the table's gaps bend the polynomial that runs through them.
        """
        per_log = 2 / log(self.high / self.low)
        along = np.log(gap / self.low) * per_log - 1
        count = len(self.scale)
        basis = chebyshev.chebvander(along, count - 1)
        at_gaps, through, *derived = _chebyshev_matrices(count)
        slopes, bends = (basis[:, : len(rise)] @ rise for rise in derived)
        across = chebyshev.chebvander(2 * (offset / self.reach) ** 2 - 1, self.shape.shape[1] - 1)
        size = np.exp(basis @ self.scale)
        coefficients = np.einsum("ijk,nj->nik", self.shape, across)
        axial, side, moment, doubt, dipole = size * np.einsum("nik,ni->kn", coefficients, basis)
        change = np.einsum("ni,ni->n", coefficients[..., 0], slopes)
        power = slopes @ self.scale * per_log
        slope = (size * change * per_log + axial * power) / gap
        tails = np.abs(coefficients[:, -1, 0])
        if self.shape.shape[1] > 1:
            tails = tails + np.abs(basis @ self.shape[:, -2:, 0]).sum(-1)
        jump = size * tails
        lost = jump + np.abs(doubt)
        # Errors over `size` at each of the table's gaps. With one offset only `scale` depends on the gap, and the other
        # last coefficients are 0.
        off = np.abs(coefficients[..., 3] @ at_gaps.T) + (tails + np.abs(axial / size * self.scale[-1]))[:, None]
        first, second = ((np.abs(part @ through) * off).sum(1) * size for part in (slopes, bends))
        steep = first * per_log / gap
        bend = (
            second * (per_log / gap) ** 2
            + (np.abs(2 * power - 1) * steep + np.abs(power - 1) * OWN_ERROR * np.abs(slope)) / gap
        )
        x = offset / self.reach
        return _with_errors(axial, side * x, moment * x, slope, lost, jump, steep, bend, dipole)


@cache
def _chebyshev_matrices(count: int) -> tuple[np.ndarray, ...]:
    """Return matrices from `count` Chebyshev coefficients to node values, back, and to first and second derivatives."""
    values = chebyshev.chebvander(chebyshev.chebpts1(count), count - 1)
    return values, np.linalg.inv(values), *(chebyshev.chebder(np.eye(count), order) for order in (1, 2))


def pull_range(gap_m: np.ndarray) -> np.ndarray:
    """Return the index (n,) of the range in which each gap (n,) in m lies; each range has its table."""
    return np.floor(np.log(gap_m / LOW) / log(RANGE)).astype(int)


def make_table(coil: CoilSource, washer: SteelRing, part: int, reach: float, offsets: int) -> PullTable:
    """Return a table of the pull over range `part` of gaps, at `offsets` offsets up to `reach` in m.

    A single offset is `reach`/√2. At one offset and gaps below all tables that come with padgen it is solved with the
    nodes that this offset needs, in down to a twentieth of the time; elsewhere with those of the worst, so that it is
    what such a table says.
    """
    low = LOW * RANGE**part
    high = LOW * RANGE ** (part + 1)
    at_gap = chebyshev.chebpts1(GAPS)
    at_offset = chebyshev.chebpts1(offsets)
    gap = low * RANGE ** ((at_gap + 1) / 2)
    offset = reach * np.sqrt((at_offset + 1) / 2)
    for_all_offsets = offsets > 1 or part >= 0
    solved = np.array([[pull(coil, washer, float(g), float(d), in_table=for_all_offsets) for d in offset] for g in gap])
    side, axial, moment, doubt, dipole = np.moveaxis(solved, -1, 0)
    x = offset / reach
    return _table(low, high, reach, np.stack([axial, side / x, moment / x, doubt, dipole], -1))


def _table(low: float, high: float, reach: float, columns: np.ndarray) -> PullTable:
    """Return the table with the values `columns` (gaps, offsets, 5) at its nodes."""
    scale = np.sqrt((columns[..., 0] ** 2).mean(1)) + 1e-30
    transforms = [_chebyshev_matrices(count)[1] for count in columns.shape[:2]]
    coefficients = np.einsum("ig,jd,gdk->ijk", *transforms, columns / scale[:, None, None], optimize=True)
    return PullTable(low, high, reach, transforms[0] @ np.log(scale), coefficients)


def of_one_turn(coil: CoilSource) -> CoilSource:
    """Return the coil scaled to one turn in all: coils that differ in turns alone share a table (see `with_turns`)."""
    return coil._replace(windings=tuple(w._replace(turns=w.turns / coil.turns) for w in coil.windings))


def parts_key(coil: CoilSource, washer: SteelRing) -> str:
    """Return a text that identifies a coil and a washer: all their numbers but the coil's number of turns."""
    ring = washer if washer.crown_height else washer[:4]
    return " ".join(f"{v:.9g}" for part in (*of_one_turn(coil).windings, coil[1:5], ring) for v in part)


def supplied_table(coil: CoilSource, washer: SteelRing, part: int) -> PullTable | None:
    """Return the table that comes with padgen for a coil, a washer and range `part` of gaps; None without one.

    The coil may have any number of turns.
    """
    places, numbers = _supplied_tables()
    place = places.get(parts_key(coil, washer))
    if place is None or not 0 <= part < len(place["ranges"]):
        return None
    begin, offsets = place["ranges"][part]
    end = begin + GAPS
    shape = numbers[end : end + COLUMNS * GAPS * offsets].reshape(GAPS, offsets, COLUMNS)
    low = LOW * RANGE**part
    scale = numbers[begin:end].astype(float)
    table = PullTable(low, low * RANGE, place["reach_m"], scale, shape.astype(float))
    return table.with_turns(coil.turns / place["turns"])


@cache
def _supplied_tables() -> tuple[dict[str, dict[str, Any]], np.ndarray]:
    """Read the pull tables that come with padgen: an index by `parts_key`, and one array with the numbers of all."""
    return json.loads(BROUGHT.with_suffix(".json").read_text(encoding="ascii")), np.load(BROUGHT.with_suffix(".npy"))


def solved_pulls(coil: CoilSource, washer: SteelRing, gap: np.ndarray, offset: np.ndarray) -> PullAt:
    """Return the pulls at gaps and offsets (n,) in m without a table, each solved at three gaps for the slope."""
    steps = (1 - SLOPE_STEP, 1.0, 1 + SLOPE_STEP)
    solved = [[pull(coil, washer, g * step, d) for step in steps] for g, d in zip(gap, offset, strict=True)]
    near, at, far = np.moveaxis(np.array(solved).reshape(-1, 3, COLUMNS), (1, 2), (0, 1))
    side, axial, moment, lost, dipole = at
    slope = (far[1] - near[1]) / (2 * SLOPE_STEP * gap)
    return _with_errors(axial, side, moment, slope, lost, 0 * lost, lost / gap, lost / gap**2, dipole)


def _with_errors(
    axial: np.ndarray,
    side: np.ndarray,
    moment: np.ndarray,
    slope: np.ndarray,
    lost: np.ndarray,
    jump: np.ndarray,
    steep: np.ndarray,
    bend: np.ndarray,
    dipole: np.ndarray,
) -> PullAt:
    """Return pulls towards the coil with their relative errors, from upward forces and absolute errors."""
    with np.errstate(divide="ignore", invalid="ignore"):
        error = OWN_ERROR + lost / np.abs(axial)
    none = np.zeros_like(axial)
    steep = steep + OWN_ERROR * np.abs(slope)
    return PullAt(-axial, side, moment, -slope, error, jump, steep, bend, dipole, none, none)


FACE = 5
RIM = 3
ORDERS = 2
"""Nodes on each face and each rim of a washer, and highest order round its axis; few, to save time."""
COARSE_STEP = 1.0
"""Largest distance between rings that face the washer, over the gap, for leakage."""


class Leakage(NamedTuple):
    """Pulls of neighbouring coils on n washers, divided by the pull of the washers' coil at 1 A; quadratic in currents.

    `mutual` (n, k, k) is by the fields of neighbours k and l together: currents i_k pull with ``Σ mutual_kl i_k i_l``.
    `product` (n, k) is by neighbour k and the washer's own coil: ``2 product_k i i_k``.
    """

    mutual: np.ndarray
    product: np.ndarray


NO_COILS = np.zeros((0, 2))
"""Places of no coils at all."""


def leakage(
    coil: CoilSource,
    washer: SteelRing,
    gap: float,
    place: np.ndarray,
    neighbours: np.ndarray,
    far: np.ndarray = NO_COILS,
) -> Leakage:
    """Return the pulls of neighbouring coils on the washers of one coil, divided by that coil's pull on them.

    The washers are at `place` (n, 2) in m from the axis of their own coil, the other coils at `neighbours` and `far`
    (k, 2). `far` coils are replaced by their poles (`magnetics.coil_poles`) and come last in the result. Every
    coil with its core magnetises the washer. Neighbours also magnetise the own coil's core, whose field magnetises the
    washer further; other cores act on each other as dipoles. The force is that of the fields on the washer's charges.
    The effect of the washer on cores is left out.
    """
    body = _washer(washer, (FACE, RIM), ORDERS)
    turns = 2 * ORDERS + 2
    angle = (np.arange(turns) + 0.5) * 2 * np.pi / turns
    points = place[:, None, None] + body.radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    height = (body.height + gap)[:, None]
    coil_potential = _coil_potential(coil_rings(coil, COARSE_STEP * gap), points[:, None], height)
    near = _coil_potential(_coarse_rings(coil), points[:, None] - neighbours[:, None, None], height)
    # Fields of far coils change linearly over the washer.
    flux = pole_field(coil_poles(coil), gap + washer.thickness / 2, place[:, None] - far)
    field, change = (v[..., None] for v in flux)
    up = body.height - washer.thickness / 2
    parts = _fourier_parts(np.concatenate([coil_potential, near], 2), angle)
    beyond = np.zeros((2, len(place), len(far), *parts.shape[3:]))
    beyond[0, :, :, 0] = -field[:, :, 2] * up
    beyond[1, :, :, 0] = -field[:, :, 2] - change[:, :, 2] * up
    beyond[:, :, :, 1:3] = -np.stack([field, change])[:, :, :, :2] * body.radius
    parts = np.concatenate([parts, beyond], 2)
    if (charged := charged_core(coil)) is not None:
        core, _ = charged
        charge = _core_charge(coil, core, neighbours, far)
        parts[:, :, 1:] += _core_field(core, charge, points, height, angle, COARSE_STEP * gap)
        echo = _effective_currents(coil, core, np.concatenate([np.zeros((1, 2)), neighbours, far]))
        parts = (echo.T @ parts.reshape(*parts.shape[:3], -1)).reshape(parts.shape)
    value, slope = parts
    order = (np.arange(value.shape[2]) + 1) // 2
    on_washer = (body.response[order] @ value[..., None])[..., 0]
    weight = body.area * np.where(order == 0, 1.0, 0.5)[:, None]
    shape = len(place), value.shape[1], -1
    pulled = (on_washer * weight).reshape(shape) @ np.swapaxes(slope.reshape(shape), 1, 2)
    pulled = (pulled + np.swapaxes(pulled, 1, 2)) / 2
    alone = np.where(pulled[:, :1, :1] == 0, np.inf, pulled[:, :1, :1])
    return Leakage(pulled[:, 1:, 1:] / alone, pulled[:, 0, 1:] / alone[:, 0])


@lru_cache(maxsize=32)
def _coarse_rings(coil: CoilSource) -> np.ndarray:
    """Return a coil as a few rings of charge (3, n), which suffice for its field at neighbouring coils.

    Each end of a winding is three rings, and the core one at every height of its nodes. Radii and heights in m, charges
    in A per ampere. Each ring has the charge, the mean height and the mean squared radius of its part. Where a part has
    charge of both signs, as a face of a core of low permeability may, each sign is a ring of its own: the mean squared
    radius over a sum that nearly cancels would lie outside of the core, or be negative.
    """
    radius, height, density = winding_rings(coil.windings, coil.outer_diameter / 8)
    # Sorted sets, since np.unique would load numpy.ma in every plan.
    zone = np.floor(6 * radius / coil.outer_diameter)
    charge = radius * density
    groups = [
        (radius, height, np.where((height == z) & (zone == k), charge, 0.0))
        for z in sorted(set(height))
        for k in sorted(set(zone))
    ]
    if (core := charged_core(coil)) is not None:
        radius = core[0].radius
        height = core[0].height
        charge = core[0].area * core[1] / (2 * np.pi)
        groups += [(radius, height, np.where(height == z, charge, 0.0)) for z in sorted(set(height))]
    signed = [(r, z, part) for r, z, q in groups for part in (np.maximum(q, 0), np.minimum(q, 0)) if part.any()]
    total, square, at = np.array([(q.sum(), (q * r**2).sum(), (q * z).sum()) for r, z, q in signed]).T
    across = np.sqrt(square / total)
    return np.stack([across, at / total, total / across])


def _coil_potential(rings: np.ndarray, away: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Return the magnetic potential of a coil's rings of charge and its slope along z (2, …), `away` m off the axis."""
    value, _, along_z = rings_potential(rings, np.hypot(away[..., 0], away[..., 1]), height)
    return np.stack([value, along_z])


def _fourier_parts(values: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return the Fourier coefficients (…, parts, j) of `values` (…, j, turns): of 1, cos φ, sin φ, cos 2φ and so on."""
    order = np.arange(1, len(angle) // 2)[:, None]
    waves = 2 * np.stack([np.cos(order * angle), np.sin(order * angle)], 1).reshape(-1, len(angle))
    waves = np.concatenate([np.ones((1, len(angle))), waves]) / len(angle)
    return np.swapaxes(values @ waves.T, -1, -2)


def _core_charge(coil: CoilSource, core: SteelBody, neighbours: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Return the charge (k, parts, nodes) that each of k other coils induces on the core of the washers' coil."""
    turns = 2 * CORE_ORDERS + 2
    angle = (np.arange(turns) + 0.5) * 2 * np.pi / turns
    points = core.radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    near, _ = _coil_potential(_coarse_rings(coil), points - neighbours[:, None, None], core.height[:, None])
    middle = coil.core_top - coil.core_length / 2
    field = pole_field(coil_poles(coil), middle, -far)[0][..., None]
    beyond = np.concatenate([-field[:, 2:] * (core.height - middle), -field[:, :2] * core.radius], 1)
    value = np.concatenate([_fourier_parts(near, angle), beyond])
    order = (np.arange(value.shape[1]) + 1) // 2
    return np.asarray((core.response[order] @ value[..., None])[..., 0])


def _effective_currents(coil: CoilSource, core: SteelBody, axes: np.ndarray) -> np.ndarray:
    """Return effective currents (k, k) for 1 A in each coil, as cores magnetise each other; the washers' coil first.

    A core in another coil's field is a dipole, which counts as additional current of the core's own coil. The first
    coil's core is left out, since `_core_charge` computes it better.
    """
    poles = coil_poles(coil)
    middle = coil.core_top - coil.core_length / 2
    apart = axes[:, None] - axes + np.eye(len(axes))[..., None]  # any distance but 0 for a core in its own coil
    field = pole_field(poles, middle, apart)[0][..., 2] * (1 - np.eye(len(axes)))
    drawn = core.area @ (core.response[0] @ (middle - core.height) * core.height)
    share = field * drawn / (poles[:, 0] @ poles[:, 1])
    share[0] = 0.0
    return np.asarray(np.linalg.inv(np.eye(len(axes)) - share))


def _core_field(
    core: SteelBody, charge: np.ndarray, points: np.ndarray, height: np.ndarray, angle: np.ndarray, step: float
) -> np.ndarray:
    """Return Fourier coefficients of potential and slope (2, n, k, parts, j) by the core's `charge` (k, parts, nodes).

    They are round each washer, whose nodes are at `points` (n, j, turns, 2) in m.
    """
    radius, at, shares = fine_rings(core, step)
    rho = np.hypot(points[..., 0], points[..., 1])
    around = np.arctan2(points[..., 1], points[..., 0])
    z = np.broadcast_to(height, rho.shape)[..., None]
    of = ring_potential(rho[..., None], z, radius, at, CORE_ORDERS, at_ring=False)
    waves = np.ones_like(around), np.cos(around), np.sin(around)
    made: list[np.ndarray] = []
    for part in (of.value, of.along_z):
        each = (part[(k + 1) // 2] @ (shares @ charge[:, k].T) for k in range(charge.shape[1]))
        field: np.ndarray = sum(wave[..., None] * one for wave, one in zip(waves, each, strict=False))
        made.append(np.moveaxis(field, -1, 1))
    return _fourier_parts(np.stack(made), angle)
