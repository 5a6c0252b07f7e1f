"""The front of many variants in several objectives: those that no other one beats, and what they are best in.

A variant beats another if it is as good in every objective and better in one; equals stay, all of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from padgen.batch.figures import OBJECTIVES

__all__ = ["BLOCK", "UNBOUNDED", "Overview", "Told", "front_mask", "scores_of"]

UNBOUNDED = frozenset({"selectivity_db"})
"""Empty where nothing limits it (one channel a coil has no other to disturb), so that empty is the best."""
BLOCK = 512


class Told(NamedTuple):
    """A variant that was not made, and why."""

    name: str
    sentence: str


@dataclass(frozen=True)
class Overview:
    """Summary of a sweep's index, with its Pareto front.

    Attributes
    ----------
    header, rows : the index's columns, and its rows on the front in the order of their numbers.
    objectives : those with a value in any row; columns of `values` (front), `beaten` and `faulty`, not a
        number where a row has none. `beaten` and `faulty` (made, with error findings) are thinned.
    counts : variants by status; `with_errors` of the made ones have error findings.
    of_faulty : the front is of variants with error findings, since there is none without.
    refused, failed : the first few of each.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    objectives: tuple[str, ...]
    values: np.ndarray
    beaten: np.ndarray
    faulty: np.ndarray
    counts: dict[str, int]
    with_errors: int
    of_faulty: bool
    refused: tuple[Told, ...]
    failed: tuple[Told, ...]

    @property
    def made(self) -> int:
        """Variants that were made, whatever their findings."""
        return self.counts.get("done", 0)

    def best(self) -> dict[str, int]:
        """By objective in which variants differ, the row of the front that is best in it; of equals the first."""
        if not len(self.values):
            return {}
        scores = scores_of(self.values, self.objectives)
        every = scores_of(np.concatenate([self.values, self.beaten, self.faulty]), self.objectives)
        differ = every.min(0) < every.max(0)
        return {name: int(np.argmax(scores[:, i])) for i, name in enumerate(self.objectives) if differ[i]}


def front_mask(scores: np.ndarray) -> np.ndarray:
    """Which rows of `scores` (variants, objectives; more is better) no other row beats.

    Rows are compared in lexicographic order, best first, so that only what is already on the front can
    beat the next: of the order of rows times front, in blocks.
    """
    losses, back = np.unique(-np.asarray(scores, dtype=float), axis=0, return_inverse=True)
    on_front = np.zeros(len(losses), dtype=bool)
    for start in range(0, len(losses), BLOCK):
        block = losses[start : start + BLOCK]
        open_ = np.flatnonzero(_as_good(losses[:start][on_front[:start]], block) == 0)
        # Rows are distinct, so each is as good as itself once.
        on_front[start + open_[_as_good(block[open_], block[open_]) == 1]] = True
    kept: np.ndarray = on_front[back.reshape(-1)]
    return kept


def _as_good(others: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """For each of `rows`, how many of `others` lose no more in any objective."""
    good = np.ones((len(rows), len(others)), dtype=bool)
    for own, other in zip(rows.T, others.T, strict=True):
        good &= other[None, :] <= own[:, None]
    count: np.ndarray = good.sum(axis=1)
    return count


def scores_of(values: np.ndarray, objectives: Sequence[str]) -> np.ndarray:
    """Values with a sign that makes more better, and infinities where there are none."""
    signs = [1.0 if OBJECTIVES[name].best == "most" else -1.0 for name in objectives]
    empty = [np.inf if name in UNBOUNDED else -np.inf for name in objectives]
    scores = values * np.array(signs)
    return np.where(np.isnan(scores), np.array(empty), scores)
