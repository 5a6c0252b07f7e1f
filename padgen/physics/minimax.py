"""Minimise the largest of several functions by linear programs in a trust region that is a box.

Madsen, J. Inst. Maths Applics 16 (1975) 321.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

__all__ = ["Box", "Descent", "descend"]

Lines = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""A function of a place (n,): values (m,) and their slopes (m, n); m may differ from place to place."""


class Box(NamedTuple):
    """Bounds of a place (n,), and the least distance between each coordinate and the next, if they have an order."""

    low: np.ndarray
    high: np.ndarray
    closest: float | None = None


class Descent(NamedTuple):
    """State of a descent: a place (n,), the largest value there, and the half width of the trust region."""

    place: np.ndarray
    largest: float
    reach: float


def descend(lines: Lines, at: Descent, box: Box, programs: int, settled: float, tightest: float = 0.0) -> Descent:
    """Return the descent after up to `programs` linear programs.

    It ends when a program predicts a decrease of less than `settled`, or when the trust region is below `tightest`.
    """
    here, reach = at.place, at.reach
    values, slope = lines(here)
    for _ in range(programs):
        step, promised = _best_step(here, values, slope, reach, box)
        if promised < settled or reach < tightest:
            break
        there = np.clip(here + step, box.low, box.high)
        trial = lines(there)
        kept = (values.max() - trial[0].max()) / promised
        if kept > 0:
            here, (values, slope) = there, trial
        reach *= 2 if kept > 0.75 else 1 if kept > 0.25 else 0.3
    return Descent(here, float(values.max()), reach)


def _best_step(
    here: np.ndarray, values: np.ndarray, slope: np.ndarray, reach: float, box: Box
) -> tuple[np.ndarray, float]:
    """Return the step (n,) within `reach` that most lowers the linearised largest value, and its decrease."""
    from scipy.optimize import linprog

    # Only values that could become the largest, in units of the reach, so that the program is scaled alike each time.
    swing = reach * np.abs(slope).sum(1)
    near = values + swing >= (values - swing).max()
    matrix = np.hstack([slope[near] * reach, -np.ones((near.sum(), 1))])
    limit = values.max() - values[near]
    if box.closest is not None:
        gaps = np.diff(here)
        order = np.eye(len(here), len(here) + 1) - np.eye(len(here), len(here) + 1, k=1)
        matrix = np.vstack([matrix, order[:-1] * reach])
        limit = np.concatenate([limit, gaps - min(box.closest, gaps.min())])
    lower, upper = np.maximum(-1, (box.low - here) / reach), np.minimum(1, (box.high - here) / reach)
    bounds = np.column_stack([np.append(lower, -np.inf), np.append(upper, 0.0)])
    result = linprog(np.append(np.zeros(len(here)), 1.0), A_ub=matrix, b_ub=limit, bounds=bounds, method="highs")
    if result.x is None:
        return np.zeros(len(here)), 0.0
    return result.x[:-1] * reach, -float(result.x[-1])
