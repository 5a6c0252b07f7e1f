"""The pull of one coil on one washer over a range of gaps and offsets, interpolated from a table, with its errors."""

import json
from functools import cache
from math import log
from pathlib import Path
from typing import NamedTuple

import numpy as np

from padgen.physics.magnetics import CoilSource, SteelRing
from padgen.physics.pull import pull

__all__ = ["BROUGHT", "OWN_ERROR", "PullAt", "PullTable", "brought_table", "make_table", "parts_key", "solved_pulls"]

OWN_ERROR = 0.008
"""Relative error of a solved pull (docs/accuracy.md)."""
COLUMNS = 5
SLOPE_STEP = 0.02
"""Relative step of the gap in differences between solved pulls."""

BROUGHT = Path(__file__).with_name("pulls")
"""Tables of catalogue parts: the numbers in ``pulls.npy``; the start and the ranges of each table in ``pulls.json``."""


class PullAt(NamedTuple):
    """Pulls (n,) per A² at places.

    `pull` is towards the coil in N, `slope` its slope with the gap in N/m. `error` is relative; `jump` in N is its part
    from one table to the next; `slope_off` in N/m is the error of the slope. `side`, `moment` and `dipole` are as in
    `pull.Pull`.
    """

    pull: np.ndarray
    side: np.ndarray
    moment: np.ndarray
    slope: np.ndarray
    error: np.ndarray
    jump: np.ndarray
    slope_off: np.ndarray
    dipole: np.ndarray


class PullTable(NamedTuple):
    """Coefficients (gaps, offsets, 5) of Chebyshev polynomials in ln gap and in the squared offset.

    The five are axial force, side force and moment over the offset, doubt and dipole of `pull.Pull`, each over the
    exponential of the polynomial `scale` (gaps,) in ln gap. The table covers gaps `low` … `high` and offsets up to
    `reach`, in m.
    """

    low: float
    high: float
    reach: float
    scale: np.ndarray
    shape: np.ndarray

    def covers(self, gap: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Return which places (n,) lie within the table."""
        slack = 1e-9
        inside = (gap >= self.low * (1 - slack)) & (gap <= self.high * (1 + slack))
        return np.asarray(inside & (offset <= self.reach * (1 + slack)))

    def at(self, gap: np.ndarray, offset: np.ndarray) -> PullAt:
        """Return the pulls at gaps and offsets (n,) in m that the table covers.

        The interpolation's own error is estimated as the size of the last coefficients in both directions.
        """
        per_log = 2 / log(self.high / self.low)
        along = np.log(gap / self.low) * per_log - 1
        basis, slopes = _chebyshev(along, len(self.scale)), _chebyshev_slopes(along, len(self.scale))
        across = _chebyshev(2 * (offset / self.reach) ** 2 - 1, self.shape.shape[1])
        size = np.exp(basis @ self.scale)
        coefficients = np.einsum("ijk,nj->nik", self.shape, across)
        axial, side, moment, doubt, dipole = size * np.einsum("nik,ni->kn", coefficients, basis)
        change = np.einsum("ni,ni->n", coefficients[..., 0], slopes)
        slope = (size * change + axial * (slopes @ self.scale)) * per_log / gap
        tails = np.abs(coefficients[:, -1, 0])
        if self.shape.shape[1] > 1:
            tails = tails + np.abs(basis @ self.shape[:, -2:, 0]).sum(-1)
        jump = size * tails
        lost = jump + np.abs(doubt)
        # The error of a polynomial's slope is larger by about its number of coefficients.
        steep = lost * len(self.scale) * per_log / gap
        x = offset / self.reach
        return _with_errors(axial, side * x, moment * x, slope, lost, jump, steep, dipole)


def make_table(
    coil: CoilSource, washer: SteelRing, low: float, high: float, reach: float, gaps: int, offsets: int
) -> PullTable:
    """Solve the pull at `gaps` times `offsets` places and return the table; a single offset is `reach` over √2."""
    at_gap, at_offset = _nodes(gaps), _nodes(offsets)
    gap = low * (high / low) ** ((at_gap + 1) / 2)
    offset = reach * np.sqrt((at_offset + 1) / 2)
    solved = np.array([[pull(coil, washer, float(g), float(d)) for d in offset] for g in gap])
    side, axial, moment, doubt, dipole = np.moveaxis(solved, -1, 0)
    x = offset / reach
    shape = np.stack([axial, side / x, moment / x, doubt, dipole], -1)
    scale = np.sqrt((axial**2).mean(1)) + 1e-30
    transforms = [np.linalg.inv(_chebyshev(at, len(at))) for at in (at_gap, at_offset)]
    coefficients = np.einsum("ig,jd,gdk->ijk", *transforms, shape / scale[:, None, None], optimize=True)
    return PullTable(low, high, reach, transforms[0] @ np.log(scale), coefficients)


def parts_key(coil: CoilSource, washer: SteelRing) -> str:
    """Return all numbers of a coil and a washer as text, to identify the pair."""
    numbers = [*(v for winding in coil.windings for v in winding), *coil[1:], *washer]
    return " ".join(f"{number:.9g}" for number in numbers)


def brought_table(coil: CoilSource, washer: SteelRing) -> PullTable | None:
    """Return the table that comes with padgen for these parts, None for others."""
    places, numbers = _supplied_tables()
    place = places.get(parts_key(coil, washer))
    if place is None:
        return None
    at, low, high, reach, gaps, offsets = place
    end = at + gaps
    shape = numbers[end : end + COLUMNS * gaps * offsets].reshape(gaps, offsets, COLUMNS)
    return PullTable(low, high, reach, numbers[at:end].astype(float), shape.astype(float))


@cache
def _supplied_tables() -> tuple[dict[str, tuple[int, float, float, float, int, int]], np.ndarray]:
    """Read the places of the tables by `parts_key`, and all their numbers."""
    places = json.loads(BROUGHT.with_suffix(".json").read_text(encoding="ascii"))
    return places, np.load(BROUGHT.with_suffix(".npy"))


def solved_pulls(coil: CoilSource, washer: SteelRing, gap: np.ndarray, offset: np.ndarray) -> PullAt:
    """Return the pulls at gaps and offsets (n,) in m without a table, by three solutions each."""
    steps = (1 - SLOPE_STEP, 1.0, 1 + SLOPE_STEP)
    solved = [[pull(coil, washer, g * step, d) for step in steps] for g, d in zip(gap, offset, strict=True)]
    near, at, far = np.moveaxis(np.array(solved).reshape(-1, 3, COLUMNS), (1, 2), (0, 1))
    side, axial, moment, lost, dipole = at
    slope = (far[1] - near[1]) / (2 * SLOPE_STEP * gap)
    return _with_errors(axial, side, moment, slope, lost, 0 * lost, lost / gap, dipole)


def _with_errors(
    axial: np.ndarray,
    side: np.ndarray,
    moment: np.ndarray,
    slope: np.ndarray,
    lost: np.ndarray,
    jump: np.ndarray,
    steep: np.ndarray,
    dipole: np.ndarray,
) -> PullAt:
    """Return pulls towards the coil with their relative errors, from upward forces and absolute errors."""
    with np.errstate(divide="ignore", invalid="ignore"):
        error = OWN_ERROR + lost / np.abs(axial)
    return PullAt(-axial, side, moment, -slope, error, jump, steep + OWN_ERROR * np.abs(slope), dipole)


def _nodes(count: int) -> np.ndarray:
    """Return the Chebyshev nodes (count,) in −1 … 1."""
    return np.asarray(np.cos((np.arange(count) + 0.5) * np.pi / count))


def _chebyshev(x: np.ndarray, count: int, kind: int = 1) -> np.ndarray:
    """Return Chebyshev polynomials (n, count) of the first or second kind at x (n,)."""
    twice = 2 * x
    values = [np.ones(len(x)), kind * x]
    for _ in range(2, count):
        values.append(twice * values[-1] - values[-2])
    return np.stack(values[:count], -1)


def _chebyshev_slopes(x: np.ndarray, count: int) -> np.ndarray:
    """Return slopes (n, count) of the polynomials of the first kind: k times the second kind's of one order less."""
    slopes = np.arange(count) * np.ones((len(x), 1))
    slopes[:, 1:] *= _chebyshev(x, count - 1, kind=2)
    return slopes
