"""Steady temperatures of a pad and what holds its coils: two layers of cells, heated by coils, cooled by air and table.

The lower layer is the tray or board with its coils, the upper one the printed pad. Heat flows along each layer, from
one to the other through the air gap and the rim, from the lower one into the table, and from top and sides into the
room by natural convection and radiation. Films follow from their own temperatures, and the coils' resistance from
theirs, so that the linear balance is solved a few times.

The table is a half-space of which each patch warms every other: a flow P into a rectangle raises a place of its surface
by P/(2πk) times the mean of 1/distance (Carslaw and Jaeger, 2nd ed. 1959, 10.5).

Correlations of natural convection: plate facing upwards, Nu = 0.54 Ra^(1/4) with area over perimeter as its length
(Lloyd and Moran 1974); upright side, Churchill and Chu 1975. Both scatter by some 15 to 25 % on small plates.
"""

from functools import partial
from itertools import product
from math import inf
from typing import NamedTuple

import numpy as np

from padgen.core.units import COPPER_C, COPPER_MELTS_C, COPPER_PER_K, GRAVITY_M_PER_S2

__all__ = [
    "AIR_W_PER_M_K",
    "WARM_ERROR",
    "WarmLayers",
    "WarmedTable",
    "film_above",
    "film_beside",
    "gap_w_per_m2_k",
    "temperatures",
]

STEFAN_BOLTZMANN = 5.670374e-8
AIR_W_PER_M_K = 0.0265
AIR_DIFFUSIVITY_M2_PER_S = 2.3e-5
AIR_VISCOSITY_M2_PER_S = 1.63e-5
AIR_PRANDTL = 0.71
"""Air at 35 °C and 1 bar, half way between a warm pad and a room (Incropera, table A.4)."""
EMISSIVITY = 0.9
"""Printed plastics, the skin of a winding and wood radiate alike: tables give 0.85 to 0.95."""
KELVIN = 273.15
ROUNDS = 20
SETTLED_K = 0.01
SETTLED_SHARE = 1e-4
"""Most solutions in turns with films and resistances, which end once no temperature moves by more than `SETTLED_K`, or
by more than that share of the highest rise."""
NEARBY = 1.001
"""Ratio of two rises between which a film's slope is taken."""
LEAST_RISE_K = 0.01
"""Rise from which films are computed: without any, air at rest would conduct nothing."""
WARM_ERROR = 0.3
"""Relative error of a rise over the room: films scatter by 15 to 25 %, conductivities by as much (docs/warm.md)."""


class WarmLayers(NamedTuple):
    """Thermal grid of a quarter of a pad in SI units: cells (r, c) from its corner, in two layers, tray then pad.

    `width_m` (c,) and `depth_m` (r,) are the cells' sides, `heat_w` (r, c) the heat of the coils at 20 °C,
    `sheet_w_per_k` (2, r, c) conductivity times thickness of each layer, `through_w_per_k` (r, c) the conductance
    between the layers, `below_w_per_k` (r, c) that from the tray to the table's surface, `height_m` (2,) the heights of
    the layers' outer sides, and `stored_j_per_k` (2, r, c) the cells' heat capacity. `to_top_w_per_m2_k` is the
    conductance from the middle of the upper layer to its top. The table conducts with `ground_w_per_m_k`, by default so
    well that it is as cold as the room. Its surface is divided into patches: rows of cells with one number in
    `patch_row` (r,) and columns with one number in `patch_column` (c,).
    """

    width_m: np.ndarray
    depth_m: np.ndarray
    heat_w: np.ndarray
    sheet_w_per_k: np.ndarray
    through_w_per_k: np.ndarray
    below_w_per_k: np.ndarray
    height_m: np.ndarray
    stored_j_per_k: np.ndarray
    to_top_w_per_m2_k: float = inf
    ground_w_per_m_k: float = inf
    patch_row: np.ndarray = np.zeros(0, int)
    patch_column: np.ndarray = np.zeros(0, int)


def film_above(rise_k: float, length_m: float, room_c: float) -> float:
    """Return the heat transfer coefficient, with radiation, in W/(m² K) of a top face; `length_m`: area/perimeter."""
    rise_k = max(rise_k, LEAST_RISE_K)
    rayleigh = _rayleigh(rise_k, length_m, room_c)
    return AIR_W_PER_M_K / length_m * 0.54 * rayleigh**0.25 + _radiated(rise_k, room_c) * EMISSIVITY


def _film_over(rise_k: float, to_top: float, length_m: float, room_c: float) -> float:
    """Return the coefficient from the middle of a layer, whose rise it is given, through its top to the room."""
    if to_top == inf or not rise_k:
        return film_above(rise_k, length_m, room_c)
    at_top_k = rise_k
    for _ in range(FILM_ROUNDS):
        film = film_above(at_top_k, length_m, room_c)
        at_top_k += (to_top * (rise_k - at_top_k) - film * at_top_k) / (to_top + FILM_GROWTH * film)
    return to_top * (1 - at_top_k / rise_k)


FILM_ROUNDS = 6
FILM_GROWTH = 1.5
"""Rounds in which a top's temperature settles, and how much faster its loss grows than in proportion: the middle of
what convection (1.25) and hot radiation do."""


def film_beside(rise_k: float, height_m: float, room_c: float) -> float:
    """Return the heat transfer coefficient in W/(m² K), by natural convection and radiation, of a warm upright side."""
    rise_k = max(rise_k, LEAST_RISE_K)
    rayleigh = _rayleigh(rise_k, height_m, room_c)
    slow = (1 + (0.492 / AIR_PRANDTL) ** (9 / 16)) ** (4 / 9)
    return AIR_W_PER_M_K / height_m * (0.68 + 0.67 * rayleigh**0.25 / slow) + _radiated(rise_k, room_c) * EMISSIVITY


def gap_w_per_m2_k(gap_m: float, mean_c: float) -> float:
    """Return the conductance in W/(m² K) of a gap of air at rest between two surfaces, by conduction and radiation."""
    return AIR_W_PER_M_K / gap_m + 4 * STEFAN_BOLTZMANN * (mean_c + KELVIN) ** 3 / (2 / EMISSIVITY - 1)


class WarmedTable:
    """Heat flow from the lower layer into the table, whose surface the whole of that flow warms."""

    def __init__(self, layers: WarmLayers) -> None:
        """Work out how patches of the table's surface warm each other and what flows to them."""
        self.below = layers.below_w_per_k
        self.patch = np.zeros(self.below.shape, int)
        self.rise_per_w: np.ndarray = np.zeros((1, 1))
        if layers.ground_w_per_m_k == inf:
            return
        columns = int(layers.patch_column.max()) + 1
        self.patch = layers.patch_row[:, None] * columns + layers.patch_column
        edges_x, edges_y = (
            np.concatenate([[0.0], np.cumsum(np.bincount(number, size_m))])
            for number, size_m in ((layers.patch_column, layers.width_m), (layers.patch_row, layers.depth_m))
        )
        apart = _half_space(edges_x, edges_y) / layers.ground_w_per_m_k
        seat = np.bincount(self.patch.ravel(), self.below.ravel())
        # Surface rises s = R q, with flows q = Σ below (T − s) from the cells above a patch, and B = Σ below:
        # s = (1 + R B)⁻¹ R Σ below T.
        self.rise_per_w = np.linalg.solve(np.eye(len(seat)) + apart * seat, apart)

    def flow(self, rise: np.ndarray) -> np.ndarray:
        """Return what flows into the table in W from cells (r, c) that are `rise` K above the room."""
        flow = self.below * rise
        surface = self.rise_per_w @ np.bincount(self.patch.ravel(), flow.ravel(), len(self.rise_per_w))
        return flow - self.below * surface[self.patch]


def _half_space(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the rises (n, n) in K of patches of a half-space's surface per W into each, times the conductivity.

    `x` and `y` are the patches' edges in m, from a corner of a plate to its middle; the other three quarters, mirrored,
    are as warm.
    """
    x = x - x[-1]
    y = y - y[-1]
    left, near = (part.ravel() for part in np.meshgrid(x[:-1], y[:-1]))
    right, far = (part.ravel() for part in np.meshgrid(x[1:], y[1:]))
    total = np.zeros((len(left), len(left)))
    for share_x, share_y in product(MEAN_AT, MEAN_AT):
        at_x = left + share_x * (right - left)
        at_y = near + share_y * (far - near)
        for sign_x, sign_y in product((1, -1), (1, -1)):
            sides_x = (np.subtract.outer(sign_x * at_x, edge) for edge in (left, right))
            sides_y = (np.subtract.outer(sign_y * at_y, edge) for edge in (near, far))
            for (k, along), (j, across) in product(enumerate(sides_x), list(enumerate(sides_y))):
                total += (-1) ** (k + j) * _corner(along, across)
    total /= len(MEAN_AT) ** 2 * 2 * np.pi * (right - left) * (far - near)
    return np.asarray((total + total.T) / 2)


MEAN_AT = (0.2113248654, 0.7886751346)
"""Places along a patch's side, as shares of it, at which its rise is averaged: Gauss's two points."""


def _corner(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the integral of 1/distance over a rectangle from a point to a corner `x`, `y` away."""
    return np.asarray(x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y)))


def temperatures(layers: WarmLayers, room_c: float) -> np.ndarray:
    """Return the steady temperatures (2, r, c) in °C of all cells, in a room at `room_c`."""
    area = layers.depth_m[:, None] * layers.width_m
    half_m = float(layers.width_m.sum()), float(layers.depth_m.sum())
    length_m = half_m[0] * half_m[1] / sum(half_m)  # area over perimeter of the whole
    right, down = _conductances(layers)
    table = WarmedTable(layers)
    top = partial(_film_over, to_top=layers.to_top_w_per_m2_k, length_m=length_m, room_c=room_c)
    side = partial(film_beside, height_m=float(layers.height_m.sum()), room_c=room_c)
    sides = [_side_lengths(layers) * height for height in layers.height_m]
    faces = [(1, area, top), (0, sides[0], side), (1, sides[1], side)]
    rise = np.zeros((2, *area.shape))
    last_step = np.zeros_like(rise)
    for _ in range(ROUNDS):
        out = np.zeros_like(rise)
        heat = np.zeros_like(rise)
        for layer, face_m2, film in faces:
            # A warmer face gives off more than in proportion: the excess is in both, and cancels once all is settled.
            mean_k = float((rise[layer] * face_m2).sum() / face_m2.sum())
            coefficient = film(mean_k)
            excess = (film(mean_k * NEARBY) - coefficient) / (NEARBY - 1)
            out[layer] += face_m2 * (coefficient + excess)
            heat[layer] += face_m2 * excess * rise[layer]
        # The hotter, the more it resists: without an end of that nothing would balance the heat of some coils.
        copper_c = np.minimum(room_c + rise[0], COPPER_MELTS_C)
        heat[0] += layers.heat_w * (1 + COPPER_PER_K * (copper_c - COPPER_C))
        step = _balanced(right, down, layers.through_w_per_k, out, heat, rise, table) - rise
        # Copper gets hotter round by round, each time by a like share: the rounds to come are added at once.
        alike = 0.0
        if step.min() > 0 and last_step.min() > 0:
            alike = float(min(step.sum() / last_step.sum(), MOST_ALIKE))
        rise = np.maximum(rise + step / (1 - alike), 0)
        last_step = step
        if float(np.abs(step).max()) < max(SETTLED_K, SETTLED_SHARE * float(rise.max())):
            break
    return room_c + rise


def _conductances(layers: WarmLayers) -> tuple[np.ndarray, np.ndarray]:
    """Return conductances in W/K between neighbour cells of both layers, along x (2, r, c − 1) and y (2, r − 1, c)."""
    half_x = layers.width_m / 2 / (layers.sheet_w_per_k * layers.depth_m[:, None])
    half_y = layers.depth_m[:, None] / 2 / (layers.sheet_w_per_k * layers.width_m)
    return 1 / (half_x[..., 1:] + half_x[..., :-1]), 1 / (half_y[:, 1:] + half_y[:, :-1])


def _side_lengths(layers: WarmLayers) -> np.ndarray:
    """Return the length (r, c) in m of each cell's sides on the pad's outer edge, which face the room; 0 inside."""
    length = np.zeros((len(layers.depth_m), len(layers.width_m)))
    length[0] += layers.width_m
    length[:, 0] += layers.depth_m
    return length


def _balanced(
    right: np.ndarray,
    down: np.ndarray,
    through: np.ndarray,
    out: np.ndarray,
    heat: np.ndarray,
    start: np.ndarray,
    table: WarmedTable,
) -> np.ndarray:
    """Return cells' rises over the room in K at which heat in equals heat out, by conjugate gradients from `start`."""

    def flowing(rise: np.ndarray) -> np.ndarray:
        """Return the net heat flow out of each cell in W."""
        flow = out * rise
        along = right * (rise[..., 1:] - rise[..., :-1])
        flow[..., 1:] += along
        flow[..., :-1] -= along
        across = down * (rise[:, 1:] - rise[:, :-1])
        flow[:, 1:] += across
        flow[:, :-1] -= across
        upwards = through * (rise[0] - rise[1])
        flow[0] += upwards + table.flow(rise[0])
        flow[1] -= upwards
        return flow

    leaving = out + through
    leaving[0] += table.below
    leaving[..., 1:] += right
    leaving[..., :-1] += right
    leaving[:, 1:] += down
    leaving[:, :-1] += down
    rise = start.copy()
    left = heat - flowing(rise)
    enough = max(CLOSE * float(np.abs(heat).sum()), LEFT * float(np.abs(left).sum()))
    toward = left / leaving
    direction = toward
    size = float((left * toward).sum())
    for _ in range(2 * rise.size):
        if float(np.abs(left).sum()) <= enough:
            break
        flow = flowing(direction)
        step = size / float((direction * flow).sum())
        rise += step * direction
        left = left - step * flow
        toward = left / leaving
        before = size
        size = float((left * toward).sum())
        direction = toward + size / before * direction
    return rise


MOST_ALIKE = 0.8
"""Most that a round may be of the one before where the rounds to come are added."""
CLOSE = 1e-8
LEFT = 0.01
"""Shares of the heat, and of what was missing before, that may be missing from the balance after a solution: the next
one starts from it."""


def _rayleigh(rise_k: float, length_m: float, room_c: float) -> float:
    film_k = room_c + rise_k / 2 + KELVIN
    return GRAVITY_M_PER_S2 * rise_k / film_k * length_m**3 / (AIR_VISCOSITY_M2_PER_S * AIR_DIFFUSIVITY_M2_PER_S)


def _radiated(rise_k: float, room_c: float) -> float:
    """Return the radiative film coefficient in W/(m² K) of a black surface in a room."""
    warm = room_c + rise_k + KELVIN
    cold = room_c + KELVIN
    return STEFAN_BOLTZMANN * (warm**2 + cold**2) * (warm + cold)
