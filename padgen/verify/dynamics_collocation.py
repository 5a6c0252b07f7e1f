"""Collocation on Gauss or Radau points, of any number of stages.

Radau IIA damps what is stiffer than a step (an R-L circuit of a microsecond beside a taxel of a
millisecond), is of order 2s - 1 at the end of a step, and with many stages takes steps of a period.
"""

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.polynomial import legendre

__all__ = ["Collocation", "collocation"]


class Collocation(NamedTuple):
    """Points (s,) on [0, 1], integrals (s, s) from 0 to them, weights (s,), stage values → Legendre coefficients."""

    points: np.ndarray
    integrals: np.ndarray
    weights: np.ndarray
    to_legendre: np.ndarray

    def values(self, stages: np.ndarray, at: np.ndarray) -> np.ndarray:
        """The polynomials through `stages` (…, s) at points (k,) of the step: (…, k)."""
        basis = legendre.legvander(2 * at - 1, len(self.points) - 1) @ self.to_legendre
        return np.asarray(stages @ basis.T)

    def integrated(self, stages: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Their integrals from 0 to points (k,) of the step: (…, k), in unit of a step."""
        return np.asarray(stages @ (_integrals(at, len(self.points)) @ self.to_legendre).T)

    def tail(self, stages: np.ndarray) -> np.ndarray:
        """The larger of the last two Legendre coefficients (…): how much the polynomials leave out."""
        return np.asarray(np.abs(stages @ self.to_legendre[-2:].T).max(-1))


@lru_cache(maxsize=16)
def collocation(kind: Literal["gauss", "radau"], stages: int) -> Collocation:
    """Gauss (one stage: the implicit midpoint rule) or right Radau points."""
    if kind == "gauss":
        at = legendre.leggauss(stages)[0]
    else:
        series = np.zeros(stages + 1)
        series[-2:] = -1, 1
        at = np.sort(legendre.legroots(series))
        slope = legendre.legder(series)
        for _ in range(3):
            at = at - legendre.legval(at, series) / legendre.legval(at, slope)
        at[-1] = 1.0
    points = (at + 1) / 2
    to_legendre = np.linalg.inv(legendre.legvander(at, stages - 1))
    weights = _integrals(np.ones(1), stages)[0] @ to_legendre
    return Collocation(points, _integrals(points, stages) @ to_legendre, weights, to_legendre)


def _integrals(at: np.ndarray, count: int) -> np.ndarray:
    """Integrals (k, count) of the shifted Legendre polynomials from 0: ``(P_(j+1) − P_(j−1))/(2(2j + 1))``."""
    values = legendre.legvander(2 * at - 1, count)
    result = np.empty((len(at), count))
    result[:, 0] = at
    j = np.arange(1, count)
    result[:, 1:] = (values[:, 2:] - values[:, :-2]) / (2 * (2 * j + 1))
    return result
