"""The lowest modes of a pad by inverse iteration with a block, with bounds of their errors and a count.

The block is as large as the number of modes wanted: a pad of like taxels has hundreds of modes within a
per cent, which one-vector methods are slow to part.
"""

from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.verify.pad_assembly import Assembly
from padgen.verify.pad_strips import Factors, factored, modes_below, solved

__all__ = ["ACCURACY", "Ritz", "lowest_modes"]

SHIFT = 0.3
"""The iteration is about ``-(2πf)²``, f this share of the highest frequency: definite also for a free pad."""
ACCURACY = 1e-4
"""Of a frequency, by its residual: a bound, and most often a hundred times too careful."""
ROUNDS = 30
DEPENDENT = 1e-10
"""Vectors that differ from others by less than the root of this are dropped."""


class Ritz(NamedTuple):
    """Approximate modes, rising: `square` (m,) in (rad/s)², mass-normalised `vectors` (n, m), `heavy` the mass times
    them; `error`, the largest relative error of a frequency that was sought, by its residual."""

    square: np.ndarray
    vectors: np.ndarray
    heavy: np.ndarray
    error: float = float("inf")


def lowest_modes(assembly: Assembly, load: np.ndarray, limit: float, accuracy: float = ACCURACY) -> Ritz:
    """All modes with ``(2πf)²`` below `limit`.

    `load` (n, m) is the mass times the vectors to start from; `accuracy` the largest relative error of a frequency.

    Raises
    ------
    SolverError
        The iteration does not converge, or the modes found are not as many as there are.
    """
    factors = factored(assembly, -(SHIFT**2) * limit)
    ritz = _ritz(factors, load, solved(factors, load))
    for _ in range(ROUNDS):
        vectors = solved(factors, ritz.heavy)
        error = _error(factors, ritz, vectors, limit)
        if error < accuracy:
            _must_be_all(assembly, ritz.square, limit)
            return ritz._replace(error=error)
        ritz = _ritz(factors, ritz.heavy, vectors)
    raise SolverError(f"modes are known to {error:.0e} only after {ROUNDS} rounds, must be {accuracy:.0e}", "pad")


def _ritz(factors: Factors, load: np.ndarray, vectors: np.ndarray) -> Ritz:
    """The best that ``vectors = (K - σM)⁻¹ load`` hold; K times them is ``load + σ M vectors``."""
    heavy = factors.assembly.times_mass(vectors)
    mass = vectors.T @ heavy
    mix, square = _reduced(vectors.T @ load + factors.shift * mass, mass)
    return Ritz(square, vectors @ mix, heavy @ mix)


def _reduced(stiffness: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mass-normalised eigenvectors and eigenvalues of a small dense pencil whose mass may be singular."""
    scale = 1 / np.sqrt(np.diag(mass))
    weight, basis = np.linalg.eigh(mass * np.outer(scale, scale))
    kept = weight > DEPENDENT * weight[-1]
    basis = scale[:, None] * basis[:, kept] / np.sqrt(weight[kept])
    small = basis.T @ stiffness @ basis
    square, mix = np.linalg.eigh((small + small.T) / 2)
    return basis @ mix, square


def _error(factors: Factors, ritz: Ritz, answer: np.ndarray, limit: float) -> float:
    """Largest relative error of a frequency below `limit`.

    ``(K - σM)⁻¹ M`` is symmetric in the mass norm, so that an eigenvalue of it lies within ``|A v - μ v|`` of
    ``μ = 1/(square - σ)``; half its share of μ is the frequency's share, for f well above the shift's.
    """
    below = np.flatnonzero(ritz.square < limit)
    inverse = 1 / (ritz.square[below] - factors.shift)
    left = answer[:, below] - ritz.vectors[:, below] * inverse
    square = np.einsum("ik,ik->k", left, factors.assembly.times_mass(left))
    return float((np.sqrt(np.maximum(square, 0.0)) / inverse / 2).max(initial=0.0))


def _must_be_all(assembly: Assembly, square: np.ndarray, limit: float) -> None:
    """Count the modes below a frequency near `limit` that is no mode's own."""
    near = np.concatenate([[0.81 * limit], square[(square > 0.81 * limit) & (square < limit)], [limit]])
    widest = int(np.diff(near).argmax())
    cut = (near[widest] + near[widest + 1]) / 2
    found, expected = int((square < cut).sum()), modes_below(assembly, cut)
    if found != expected:
        hertz = number(float(np.sqrt(cut)) / (2 * np.pi))
        raise SolverError(f"{found} modes were found below {hertz} Hz, where there are {expected}", "pad")
