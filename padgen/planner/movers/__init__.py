"""Movers: what a coil moves, one file each, named by the file; `register` adds others.

A mover follows `Mover`: the order of its force in the current, the pull at a place, what it hears of other coils, and
how it moves its neighbours. A plan's `force_constant_n_per_a2` and `line_a2` are per A² of the squared current for an
order of 2; for an order of 1 they are per A, and lines of the current itself.
"""

from typing import Any, NamedTuple, Protocol, cast

import numpy as np

from padgen.core.registry import MOVERS
from padgen.physics.pull import Leakage, PullAt
from padgen.spec import Ballast, Coil, Spec

__all__ = ["Assembly", "Leakage", "Mover", "PullAt", "assembly_of", "mover_of", "register", "unregister"]


class Mover(Protocol):
    """Interface of a mover (washer or magnet): a module, or any object, that gives its pulls, leakage and remanence.

    `coil` and `part` are a spec's coil, whose gap is known, and its washer or magnet. Where the spec has ballast, that
    is a further argument of `pulls` and `leakage` (and of ``coupling``): its steel lies on top of the mover. A mover
    that coils pull less far than they reach over it may have a ``reach_m(coil, part)``; one whose neighbours push it, a
    ``coupling``, and one that cores draw at rest, a ``rest`` and a ``core_coupling``, all as in `magnet`. What is to be
    heeded where it is put in, its ``assembly(part)`` says (`Assembly`).
    """

    FORCE_ORDER: int
    """Order of the force in the current: 1 or 2."""
    PART: str
    """The table of a spec that has its size and mass: ``"washer"`` or ``"magnet"``."""

    def pulls(self, coil: Coil, part: Any, gap_m: np.ndarray, place_m: np.ndarray, *hung: Ballast) -> PullAt:
        """Return pulls (n,) per A or A² at gaps (n,) in m over the coil's top, places (n, 2) in m from its axis."""

    def leakage(
        self, coil: Coil, part: Any, place_m: np.ndarray, next_m: np.ndarray, far_m: np.ndarray, *hung: Ballast
    ) -> Leakage:
        """Return pulls of coils at `next_m`, `far_m` (k, 2) on movers at `place_m` (n, 2), as ratios to their coil's.

        `next_m` and `far_m` each have a k of their own.
        """

    def remanent_currents(self, coil: Coil, part: Any, share: float, offset_m: np.ndarray) -> np.ndarray:
        """Return ρ (n,) in A, for pulls ∝ i² + ρ i on steel that stays magnetised by a `share` of its coercivity."""


class Assembly(NamedTuple):
    """Assembly instructions for a mover: on gluing it, on connecting its coils, and on screws near it."""

    gluing: str
    wiring: str
    screws: str


def assembly_of(spec: Spec) -> Assembly:
    """Return the assembly instructions for the mover of a spec."""
    sentences_of = getattr(mover_of(spec), "assembly", None)
    if sentences_of is None:
        return Assembly("", "Connect all coils alike.", "")
    return Assembly(*sentences_of(spec.washer_or_magnet))


register = MOVERS.register
unregister = MOVERS.unregister


def mover_of(spec: Spec) -> Mover:
    """Return the mover of a spec.

    Raises
    ------
    SpecError
        There is no such kind.
    """
    return cast(Mover, MOVERS.get(spec.mover.kind, "mover.kind"))
