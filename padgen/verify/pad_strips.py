"""``K - σM`` of a pad solved strip by strip, with dense blocks and each distinct strip condensed once.

A tile's modes are eliminated first (they are decoupled), then the faces within a strip of tiles, which
leaves a block tridiagonal matrix of the lines between strips. Inertia adds up over the pivots
(Haynsworth, Linear Algebra Appl. 1, 1968), which counts the modes below σ.
"""

from collections.abc import Hashable
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError
from padgen.verify.engines import engine
from padgen.verify.pad_assembly import Assembly, PlacedTile
from padgen.verify.pad_tiles import ReducedTile

__all__ = ["Factors", "factored", "modes_below", "solved"]

ABOVE = "the pad's stiffness is not positive definite: the shift is above a mode"


class Strip(NamedTuple):
    """A strip's unknowns: the `lower` line's, those `inside`, the `upper` line's; and its tiles."""

    lower: np.ndarray
    inside: np.ndarray
    upper: np.ndarray
    tiles: list[PlacedTile]

    @property
    def ends(self) -> np.ndarray:
        """Unknowns of both lines."""
        return np.concatenate([self.lower, self.upper])


class Condensed(NamedTuple):
    """A strip with its inside eliminated: `pivot` (i, i), `carry` = pivot⁻¹ · coupling (i, e), `rest` (e, e)."""

    pivot: np.ndarray
    carry: np.ndarray
    rest: np.ndarray


class Factors(NamedTuple):
    """Factors of ``K (1 + j loss) - shift M``: of the strips' insides and of the lines' pivots, and what couples a
    line to the next."""

    assembly: Assembly
    shift: float
    loss: float
    strips: list[Strip]
    insides: list[Any]
    carries: list[np.ndarray]
    lines: list[Any]
    steps: list[np.ndarray]


def factored(assembly: Assembly, shift: float, loss: float = 0.0) -> Factors:
    """Factor ``K (1 + j loss) - shift M`` for a `shift` in (rad/s)², which without loss is below all modes.

    Raises
    ------
    SolverError
        Without loss it is not positive definite.
    """
    if not loss and (assembly.square <= shift).any():
        raise SolverError(ABOVE, "pad")
    strips = _strips(assembly)
    condensed = _condensed(assembly, strips, shift, loss)
    try:
        known = {id(c): _factor(c.pivot, loss) for c in condensed}
        lines: list[Any] = []
        steps: list[np.ndarray] = []
        for pivot, coupling in _lines(strips, condensed, lambda a, b: _solve(lines[-1], b, loss)):
            lines.append(_factor(pivot, loss))
            steps.append(coupling)
    except np.linalg.LinAlgError as error:
        raise SolverError(ABOVE, "pad") from error
    carries = [c.carry for c in condensed]
    return Factors(assembly, shift, loss, strips, [known[id(c)] for c in condensed], carries, lines, steps)


def _factor(matrix: np.ndarray, loss: float) -> Any:
    linalg = engine("scipy.linalg")
    return linalg.lu_factor(matrix) if loss else linalg.cho_factor(matrix, lower=True)


def _solve(factor: Any, load: np.ndarray, loss: float) -> Any:
    linalg = engine("scipy.linalg")
    return linalg.lu_solve(factor, load) if loss else linalg.cho_solve(factor, load)


def solved(factors: Factors, load: np.ndarray) -> np.ndarray:
    """``(K (1 + j loss) - shift M)⁻¹`` times (n, k)."""
    assembly, shift, loss = factors.assembly, factors.shift, factors.loss
    x = load.astype(complex) if loss else load.copy()
    own = (_lossy(assembly.square, loss) - shift)[:, None]
    first = assembly.size - len(assembly.square)
    tiles = [(tile, tile.interface >= 0) for tile in assembly.tiles if len(tile.modes)]
    for tile, on in tiles:
        moved = x[tile.modes] / own[tile.modes - first]
        x[tile.interface[on]] += shift * (assembly.kinds[tile.key].coupling[on] @ moved)
    _through_strips(factors, x)
    for tile, on in tiles:
        pulled = assembly.kinds[tile.key].coupling[on].T @ x[tile.interface[on]]
        x[tile.modes] = (x[tile.modes] + shift * pulled) / own[tile.modes - first]
    return x


def _through_strips(factors: Factors, x: np.ndarray) -> None:
    """Solve for the interface in place: insides, lines forth and back, insides."""
    loss, strips = factors.loss, factors.strips
    for strip, carry in zip(strips, factors.carries, strict=True):
        x[strip.ends] -= carry.T @ x[strip.inside]
    for strip, line, step in zip(strips, factors.lines, factors.steps, strict=False):
        x[strip.upper] -= step.T @ _solve(line, x[strip.lower], loss)
    last = strips[-1].upper
    x[last] = _solve(factors.lines[-1], x[last], loss)
    for strip, line, step in zip(strips[::-1], factors.lines[-2::-1], factors.steps[-2::-1], strict=True):
        x[strip.lower] = _solve(line, x[strip.lower] - step @ x[strip.upper], loss)
    for strip, inside, carry in zip(strips, factors.insides, factors.carries, strict=True):
        x[strip.inside] = _solve(inside, x[strip.inside], loss) - carry @ x[strip.ends]


def _lossy(stiffness: np.ndarray, loss: float) -> np.ndarray:
    return np.asarray(stiffness * (1 + 1j * loss)) if loss else stiffness


def modes_below(assembly: Assembly, square: float) -> int:
    """Number of the pad's modes with ``(2πf)²`` below `square`, by Sylvester's law of inertia."""
    linalg = engine("scipy.linalg")
    strips = _strips(assembly)
    condensed = _condensed(assembly, strips, square)
    known = {id(c): _negative(c.pivot) for c in condensed}
    count = int((assembly.square < square).sum()) + sum(known[id(c)] for c in condensed)
    for pivot, _ in _lines(strips, condensed, lambda a, b: linalg.solve(a, b, check_finite=False)):
        count += _negative(pivot)
    return count


def _lines(strips: list[Strip], condensed: list[Condensed], solve: Any) -> Any:
    """Pivot of each line after elimination of the ones before, and its coupling to the next."""
    size = [len(strip.lower) for strip in strips] + [len(strips[-1].upper)]
    pivot = np.zeros((size[0], size[0]))
    for lower, part in zip(size, condensed, strict=False):
        pivot = pivot + part.rest[:lower, :lower]
        coupling = part.rest[:lower, lower:]
        yield pivot, coupling
        pivot = part.rest[lower:, lower:] - coupling.T @ solve(pivot, coupling)
    yield pivot, np.zeros((size[-1], 0))


def _strips(assembly: Assembly) -> list[Strip]:
    """Rows of tiles, or columns where these are shorter."""
    rows, columns = assembly.shape
    by_row = columns <= rows
    inner = "west" if by_row else "south"
    at = np.array([row if by_row else column for _, column, row in assembly.places], dtype=np.int64)
    inside = np.array([kind == inner for kind, _, _ in assembly.places], dtype=bool)
    tiles: list[list[PlacedTile]] = [[] for _ in range(rows if by_row else columns)]
    for tile in assembly.tiles:
        tiles[tile.row if by_row else tile.column].append(tile)
    return [
        Strip(
            np.flatnonzero((at == k) & ~inside),
            np.flatnonzero((at == k) & inside),
            np.flatnonzero((at == k + 1) & ~inside),
            own,
        )
        for k, own in enumerate(tiles)
    ]


def _condensed(assembly: Assembly, strips: list[Strip], shift: float, loss: float = 0.0) -> list[Condensed]:
    """Each strip condensed; strips that are alike share one."""
    dynamic = {key: _dynamic(kind, shift, loss) for key, kind in assembly.kinds.items()}
    known: dict[Hashable, Condensed] = {}
    found = []
    for strip in strips:
        order = np.concatenate([strip.inside, strip.ends])
        local = np.full(assembly.size + 1, -1)
        local[order] = np.arange(len(order))
        indices = [local[tile.interface] for tile in strip.tiles]
        key = (
            len(strip.inside),
            len(strip.lower),
            *((t.key, i.tobytes()) for t, i in zip(strip.tiles, indices, strict=True)),
        )
        if key not in known:
            whole = np.zeros((len(order), len(order)), dtype=complex if loss else float)
            for tile, index in zip(strip.tiles, indices, strict=True):
                on = index >= 0
                whole[np.ix_(index[on], index[on])] += dynamic[tile.key][np.ix_(on, on)]
            known[key] = _without_inside(whole, len(strip.inside))
        found.append(known[key])
    return found


def _dynamic(kind: ReducedTile, shift: float, loss: float) -> np.ndarray:
    """A tile's ``K (1 + j loss) - shift M`` with its modes eliminated."""
    through = kind.coupling * (shift / (_lossy(kind.square, loss) - shift))
    return np.asarray(_lossy(kind.stiffness, loss) - shift * kind.mass - shift * (through @ kind.coupling.T))


def _without_inside(whole: np.ndarray, inside: int) -> Condensed:
    pivot, coupling = whole[:inside, :inside], whole[:inside, inside:]
    carry = engine("scipy.linalg").solve(pivot, coupling, assume_a="gen", check_finite=False)
    return Condensed(pivot, carry, whole[inside:, inside:] - coupling.T @ carry)


def _negative(matrix: np.ndarray) -> int:
    """Number of negative eigenvalues, from pivoted LDLᵀ factors."""
    if not len(matrix):
        return 0
    factor, pivots, info = engine("scipy.linalg.lapack").dsytrf(matrix, lower=1)
    if info:
        raise SolverError("a pivot is zero: the frequency is a mode's own", "pad")
    diagonal, single = np.diag(factor), pivots > 0
    # A block of two has one eigenvalue of each sign: LAPACK takes it only where its determinant is negative.
    return int((diagonal[single] < 0).sum() + (~single).sum() // 2)
