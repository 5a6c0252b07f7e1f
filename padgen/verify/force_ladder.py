"""The force ladder: paper Eq. 4, surface charges, axisymmetric and solid field solution, and what they say
about a taxel: negative stiffness, pull-in, leakage, shielding."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan, pi
from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, SpecError, number
from padgen.physics.magnetics import CoilSource, SteelRing, paper_force_constant
from padgen.physics.pull_table import solved_pulls
from padgen.physics.saturation import BHCurve
from padgen.verify.field_axisymmetric import axisymmetric_force, check_parts
from padgen.verify.field_solid import PlacedWasher, SolidForce, solid_force

__all__ = [
    "RUNGS",
    "Balance",
    "Pull",
    "PullCurve",
    "PullIn",
    "Rung",
    "balance",
    "force_ladder",
    "force_rung",
    "force_table",
    "neighbour_pull",
    "pull_curve",
    "pull_in",
    "shielding",
    "solid_pull",
]


@dataclass(frozen=True)
class Pull:
    """One question to the ladder: a coil at `current_a` pulls a washer `offset_m` off its axis over `gap_m`.

    A steel of None is linear, with the part's permeability.
    """

    coil: CoilSource
    washer: SteelRing
    gap_m: float
    offset_m: float = 0.0
    current_a: float = 1.0
    core_steel: BHCurve | None = None
    washer_steel: BHCurve | None = None


class Rung(NamedTuple):
    """A rung's answer: the pull towards the coil in N over the current's square in A².

    `error` is what the rung itself says of it, relative (nan: it cannot tell); `refusal` its sentence where
    it has no answer.
    """

    name: str
    pull_n_per_a2: float
    error: float
    unknowns: int
    residual: float
    seconds: float
    refusal: str = ""


def force_ladder(pull: Pull, names: Sequence[str] = ()) -> tuple[Rung, ...]:
    """The answers of the rungs `names` (all when empty), coarsest first; a refusal is a rung without a number."""
    answers = []
    for name in names or RUNGS:
        try:
            answers.append(force_rung(name, pull))
        except SolverError as refusal:
            answers.append(Rung(name, nan, nan, 0, nan, nan, refusal.message))
    return tuple(answers)


def force_rung(name: str, pull: Pull) -> Rung:
    """The answer of one rung of `RUNGS`.

    Raises
    ------
    SpecError
        There is no such rung, or the dimensions make no coil or washer.
    SolverError
        The rung has no answer to this pull: off the axis, saturated, or not converged.
    """
    if name not in RUNGS:
        raise SpecError(f"must be one of {', '.join(RUNGS)}, got {name}", "rung")
    check_parts(pull.coil, pull.washer, pull.gap_m)
    if not pull.current_a > 0:
        raise SpecError(f"must be above 0 A, got {number(pull.current_a)} A", "current")
    start = time.process_time()
    value, error, unknowns, residual = RUNGS[name](pull)
    return Rung(name, value, error, unknowns, residual, time.process_time() - start)


def _paper(pull: Pull) -> tuple[float, float, int, float]:
    """Eq. 4 as printed, over the core's end (the bore's without a core)."""
    diameter = pull.coil.core_diameter or min(w.inner_diameter for w in pull.coil.windings)
    return paper_force_constant(pull.coil, pi / 4 * diameter**2), nan, 0, nan


def _charges(pull: Pull) -> tuple[float, float, int, float]:
    if pull.core_steel or pull.washer_steel:
        raise SolverError("surface charges know no saturation: ask the field solutions, or give no steel")
    solved = solved_pulls(pull.coil, pull.washer, np.array([pull.gap_m]), np.array([pull.offset_m]))
    return float(solved.pull[0]), float(solved.error[0]), 0, nan


def _axisymmetric(pull: Pull) -> tuple[float, float, int, float]:
    if pull.offset_m:
        raise SolverError(
            f"the axisymmetric field solution needs a washer on the coil's axis, got one {number(pull.offset_m)} m"
            " off it: ask the solid one"
        )
    solved = axisymmetric_force(pull.coil, pull.washer, pull.gap_m, pull.current_a, pull.core_steel, pull.washer_steel)
    return -solved.force_n / pull.current_a**2, solved.error, solved.unknowns, solved.residual


def _solid(pull: Pull) -> tuple[float, float, int, float]:
    solved = solid_pull(pull)
    return -float(solved.wrench[0, 2]) / pull.current_a**2, solved.error, solved.unknowns, solved.residual


RUNGS: Mapping[str, Callable[[Pull], tuple[float, float, int, float]]] = {
    "paper": _paper,
    "charges": _charges,
    "axisymmetric": _axisymmetric,
    "solid": _solid,
}
"""Rungs by name, coarsest first."""


def solid_pull(pull: Pull, order: int = 3, levels: int = 1) -> SolidForce:
    """The solid field solution with its whole wrench, at the pull's current.

    Raises
    ------
    SolverError
        As `field_solid.solid_force`.
    """
    washer = PlacedWasher(pull.washer, pull.gap_m, pull.offset_m, 0.0, pull.washer_steel)
    return solid_force(pull.coil, [washer], pull.current_a, pull.core_steel, order, levels)


def force_table(
    name: str,
    pull: Pull,
    gaps_m: Sequence[float] = (),
    offsets_m: Sequence[float] = (),
    currents_a: Sequence[float] = (),
) -> np.ndarray:
    """Pulls (gaps, offsets, currents) in N/A² by one rung; an axis that is not given is the pull's own value.

    Raises
    ------
    SolverError
        As `force_rung`, at the first pull that the rung refuses.
    """
    gaps, offsets, currents = gaps_m or [pull.gap_m], offsets_m or [pull.offset_m], currents_a or [pull.current_a]
    return np.array(
        [
            [
                [
                    force_rung(name, replace(pull, gap_m=gap, offset_m=offset, current_a=current)).pull_n_per_a2
                    for current in currents
                ]
                for offset in offsets
            ]
            for gap in gaps
        ]
    )


@dataclass(frozen=True)
class PullCurve:
    """A rung's pull against the gap: a polynomial of ln c in ln gap through `pull_n_per_a2` (n,) at `gap_m` (n,)."""

    gap_m: np.ndarray
    pull_n_per_a2: np.ndarray

    def __call__(self, gap_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pull in N/A² at gaps in m, and its slope dc/dgap in N/(A²·m), negative.

        Raises
        ------
        SolverError
            A gap outside the ones the curve was made from.
        """
        gap = np.asarray(gap_m, float)
        low, high = float(self.gap_m.min()), float(self.gap_m.max())
        if (gap < low * (1 - 1e-9)).any() or (gap > high * (1 + 1e-9)).any():
            raise SolverError(
                f"the pull is known for gaps of {number(low)} to {number(high)} m, asked for"
                f" {number(float(gap.min()))} to {number(float(gap.max()))} m"
            )
        fit = np.polynomial.Polynomial.fit(np.log(self.gap_m), np.log(self.pull_n_per_a2), len(self.gap_m) - 1)
        pull = np.exp(fit(np.log(gap)))
        return pull, pull * fit.deriv()(np.log(gap)) / gap


def pull_curve(name: str, pull: Pull, low_m: float, high_m: float, points: int = 5) -> PullCurve:
    """The rung `name` at `points` gaps from `low_m` to `high_m` (Chebyshev points of ln gap, ends included).

    Raises
    ------
    SpecError
        The range is empty, or there are fewer than two points.
    SolverError
        As `force_rung`, or the coil does not pull the washer at one of the gaps.
    """
    if not 0 < low_m < high_m or points < 2:
        raise SpecError(
            f"needs two or more points of a range above 0, got {points} from {number(low_m)} to {number(high_m)} m",
            "gap",
        )
    spread = (1 - np.cos(pi * np.arange(points) / (points - 1))) / 2
    gaps = low_m * (high_m / low_m) ** spread
    pulls = force_table(name, pull, gaps.tolist())[:, 0, 0]
    if (pulls <= 0).any():
        raise SolverError(f"the coil does not pull the washer {number(pull.offset_m)} m off its axis towards it")
    return PullCurve(gaps, pulls)


class Balance(NamedTuple):
    """A taxel in balance with a static pull: deflection towards the coil, the magnetic spring dF/dz (it adds
    to the motion, so it is subtracted from the stiffness) and the relative shift of the resonance, negative."""

    deflection_m: float
    magnetic_n_per_m: float
    resonance_shift: float


def balance(curve: PullCurve, stiffness_n_per_m: float, gap_m: float, mean_square_a2: float) -> Balance:
    """Balance of a taxel of `stiffness_n_per_m` with rest gap `gap_m`, pulled by the mean of i².

    ``k z = c(g − z) <i²>``; the resonance is that of ``k − dF/dz``: ``√(1 − (dF/dz)/k) − 1``.

    Raises
    ------
    SolverError
        There is no stable balance ("negative stiffness beyond pull-in"), or the curve does not reach so near.
    """
    limit = pull_in(curve, stiffness_n_per_m, gap_m)
    if mean_square_a2 >= limit.mean_square_a2:
        raise SolverError(
            f"negative stiffness beyond pull-in: the mean square current must be below"
            f" {number(limit.mean_square_a2)} A², got {number(mean_square_a2)} A²"
        )
    low, high = 0.0, limit.deflection_m
    for _ in range(60):
        middle = (low + high) / 2
        pulled = float(curve(np.array(gap_m - middle))[0]) * mean_square_a2 > stiffness_n_per_m * middle
        low, high = (middle, high) if pulled else (low, middle)
    deflection = (low + high) / 2
    magnetic = -float(curve(np.array(gap_m - deflection))[1]) * mean_square_a2
    return Balance(deflection, magnetic, float(np.sqrt(1 - magnetic / stiffness_n_per_m) - 1))


class PullIn(NamedTuple):
    """Where balance ends."""

    mean_square_a2: float
    deflection_m: float


def pull_in(curve: PullCurve, stiffness_n_per_m: float, gap_m: float) -> PullIn:
    """Largest mean of i² that a taxel bears, and its deflection there: the maximum of ``k z / c(g − z)``.

    Raises
    ------
    SolverError
        The maximum lies at smaller gaps than the curve covers.
    """
    reach = gap_m - float(curve.gap_m.min())

    def slack(z: float) -> float:
        """Sign of the slope of k z / c(g − z): balance is stable while it is positive."""
        pull, slope = curve(np.array(gap_m - z))
        return float(pull + z * slope)

    if slack(reach) > 0:
        raise SolverError(
            f"pull-in lies at a gap below {number(float(curve.gap_m.min()))} m, the smallest that the pull is known for"
        )
    low, high = 0.0, reach
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if slack(middle) > 0 else (low, middle)
    pull, _ = curve(np.array(gap_m - low))
    return PullIn(float(stiffness_n_per_m * low / pull), low)


def neighbour_pull(pull: Pull, place_m: tuple[float, float], neighbour_m: tuple[float, float], order: int = 3) -> float:
    """Pull on the washer at `place_m` by the coil at `neighbour_m`, over its own coil's (at the origin), by the
    solid field solution at equal currents: what `physics.leakage` estimates as ``mutual``.

    Each coil is solved alone: the other's core is left out, as it is there.

    Raises
    ------
    SolverError
        As `solid_pull`.
    """
    own, other = (
        replace(pull, offset_m=float(np.hypot(place_m[0] - x, place_m[1] - y))) for x, y in ((0.0, 0.0), neighbour_m)
    )
    return float(solid_pull(other, order).wrench[0, 2] / solid_pull(own, order).wrench[0, 2])


def shielding(pull: Pull, order: int = 3) -> float:
    """Share of the pull that a second washer, opposite on the same coil, takes from the first.

    Raises
    ------
    SolverError
        As `solid_pull`.
    """
    places = (pull.offset_m, -pull.offset_m)
    washers = [PlacedWasher(pull.washer, pull.gap_m, x, 0.0, pull.washer_steel) for x in places]
    both = solid_force(pull.coil, washers, pull.current_a, pull.core_steel, order)
    return float(1 - both.wrench[:, 2].mean() / solid_pull(pull, order).wrench[0, 2])
