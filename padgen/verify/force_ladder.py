"""The force ladder's question, and its finest answers: a coil's pull on washers by fields in three dimensions.

With a steel it is solved on the B-H curve, with several washers they shield each other.
"""

from dataclasses import dataclass

from padgen.physics.magnetics import CoilSource, SteelRing
from padgen.physics.saturation import BHCurve
from padgen.verify.field_solid import PlacedWasher, SolidForce, solid_force

__all__ = ["Pull", "shielding", "solid_pull"]


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


def solid_pull(pull: Pull, order: int = 3, levels: int = 1, opposite: bool = False) -> SolidForce:
    """The solid field solution with its whole wrench, also with a second washer `opposite` on the same coil.

    Raises
    ------
    SolverError
        As `field_solid.solid_force`.
    """
    places = (pull.offset_m, -pull.offset_m)[: 2 if opposite else 1]
    washers = [PlacedWasher(pull.washer, pull.gap_m, x, 0.0, pull.washer_steel) for x in places]
    return solid_force(pull.coil, washers, pull.current_a, pull.core_steel, order, levels)


def shielding(pull: Pull, order: int = 3) -> float:
    """Share of the pull that a second washer, opposite on the same coil, takes from the first.

    Raises
    ------
    SolverError
        As `solid_pull`.
    """
    both, alone = (solid_pull(pull, order, opposite=more).wrench[:, 2].mean() for more in (True, False))
    return float(1 - both / alone)
