"""A disc or ring magnet, which the current itself pulls and pushes: plain tones make no spurs.

Its axis is vertical; all north poles look the same way, or those over every second coil the other way. A
core of steel draws it in, and may snap it up (`planner/core_pull.py`).
"""

from functools import lru_cache

import numpy as np

from padgen.core.units import MM
from padgen.physics.magnet_pull import RestOnSpring, magnet_pull, rest_on_spring, shared_core
from padgen.physics.magnetics import SteelRing
from padgen.physics.magnets import (
    DiscMagnet,
    demagnetising_factor,
    margin_temperature,
    neighbour_stiffness,
    working_polarisation,
)
from padgen.physics.pull import Leakage, PullAt
from padgen.planner.coils import coil_source
from padgen.spec import Ballast, Coil, Magnet

__all__ = [
    "FORCE_ORDER",
    "PART",
    "assembly",
    "core_coupling",
    "coupling",
    "demagnetising_limit_c",
    "leakage",
    "magnet_of",
    "pulls",
    "reach_m",
    "remanent_currents",
    "rest",
]

FORCE_ORDER = 1
PART = "magnet"
BEND_OVER_SLOPE = 2.0
"""Error of a pull's second derivative over that of its first, times the gap: assumed as for a pull over 1/gap²."""


def magnet_of(magnet: Magnet) -> DiscMagnet:
    """Return the magnet of a spec in SI units, with the mean remanence of its grade."""
    sizes = magnet.outer_diameter_mm * MM, magnet.inner_diameter_mm * MM, magnet.thickness_mm * MM
    remanence_t = (magnet.remanence_low_t + magnet.remanence_high_t) / 2
    factor = demagnetising_factor(DiscMagnet(*sizes, remanence_t))
    return DiscMagnet(*sizes, working_polarisation(remanence_t, magnet.recoil_permeability, factor))


def demagnetising_limit_c(part: Magnet) -> float:
    """Return the temperature in °C up to which a magnet keeps its polarisation by itself.

    It is that of its grade, or the lower one at which half of so flat a magnet is past the knee of its curve.
    """
    disc = magnet_of(part)
    changes = part.remanence_per_k, part.coercivity_per_k
    coercivity = part.coercivity_ka_per_m * 1e3
    return min(part.limit_c, margin_temperature(disc.polarisation, coercivity, demagnetising_factor(disc), changes))


LEAST_SHARE = 0.05
"""Share of the pull on the coil's axis below which a place is out of the coil's reach: it would take 20 times the
current."""
REACH_PLACES = {"round": 40, "rectangular": 9}
USUAL_GAP_MM = 1.0
"""Number of offsets at which the reach is looked for, in one direction or in three, and the gap where it is still to be
found."""


@lru_cache(maxsize=256)
def reach_m(coil: Coil, part: Magnet) -> float:
    """Return how far off its axis, in m, a coil still pulls a magnet with `LEAST_SHARE` of its pull on the axis.

    Of a rectangular coil it is so far along x, and as far along y and to its corners in proportion to its sides.
    """
    gap_m = (coil.gap_mm or USUAL_GAP_MM) * MM
    last_m = (coil.outer_diameter_mm + part.outer_diameter_mm) / 2 * MM
    offset_m = np.linspace(0.0, last_m, REACH_PLACES[coil.shape])
    width_mm, depth_mm = coil.sides_mm
    ways = [(1.0, 0.0)]
    if coil.shape == "rectangular":
        ways += [(0.0, depth_mm / width_mm), (1.0, depth_mm / width_mm)]
    places_m = np.concatenate([np.multiply.outer(offset_m, way) for way in ways])
    force = magnet_pull(coil_source(coil), magnet_of(part), np.full(len(places_m), gap_m), places_m).force
    share = (force / force[0]).reshape(len(ways), -1).min(0)
    low = share < LEAST_SHARE
    if not low.any():
        return float(offset_m[-1])
    first = int(low.argmax())
    left = (share[first - 1] - LEAST_SHARE) / (share[first - 1] - share[first])
    return float(offset_m[first - 1] + left * (offset_m[first] - offset_m[first - 1]))


STEEL_SHARE = 0.015
"""Relative error of the pull on a magnet with steel on top of it (docs/magnets.md)."""


def steel_on(ballast: Ballast | None) -> SteelRing | None:
    """Return magnetic ballast as a steel ring in SI units (a hexagon as round, of equal area); None for any other."""
    if ballast is None or not ballast.is_magnetic:
        return None
    sizes = ballast.round_mm * MM, ballast.inner_diameter_mm * MM, ballast.height_mm * MM
    return SteelRing(*sizes, ballast.relative_permeability)


def pulls(coil: Coil, part: Magnet, gap_m: np.ndarray, place_m: np.ndarray, ballast: Ballast | None = None) -> PullAt:
    """Return the pulls (n,) per A on magnets at gaps (n,) in m above the coil and places (n, 2) in m off its axis."""
    steel = steel_on(ballast)
    pulled = magnet_pull(coil_source(coil), magnet_of(part), gap_m, place_m, steel)
    of_grade = (part.remanence_high_t - part.remanence_low_t) / (part.remanence_high_t + part.remanence_low_t)
    off = np.divide(pulled.error, np.abs(pulled.force), out=np.ones(len(gap_m)), where=pulled.force != 0)
    none = np.zeros(len(gap_m))
    return PullAt(
        pull=pulled.force,
        side=pulled.side,
        moment=pulled.moment,
        slope=pulled.slope,
        error=off + of_grade + (STEEL_SHARE if steel else 0.0),
        jump=none,
        slope_off=pulled.slope_error,
        bend_off=BEND_OVER_SLOPE * pulled.slope_error / gap_m,
        dipole=none,
        side_across=pulled.side_across,
        moment_across=pulled.moment_across,
    )


def rest(coil: Coil, part: Magnet, gap_m: np.ndarray, offset_m: np.ndarray, stiffness: np.ndarray) -> RestOnSpring:
    """Return the equilibrium, without current, of magnets (n,) on springs, each alone over the core of its coil."""
    return rest_on_spring(coil_source(coil), magnet_of(part), gap_m, offset_m, stiffness)


def core_coupling(coil: Coil, part: Magnet, place_m: np.ndarray) -> np.ndarray:
    """Return the stiffness (n, n) in N/m by which a shared core couples magnets at `place_m` (n, 2); diagonal is 0."""
    gap_m = np.full(len(place_m), coil.gap_mm * MM)
    stiffness = shared_core(coil_source(coil), magnet_of(part), gap_m, place_m, np.ones(len(place_m))).stiffness
    return np.diag(np.diag(stiffness)) - stiffness


def leakage(
    coil: Coil,
    part: Magnet,
    place_m: np.ndarray,
    next_m: np.ndarray,
    far_m: np.ndarray,
    ballast: Ballast | None = None,
) -> Leakage:
    """Return pulls of coils at `next_m`, `far_m` on one coil's magnets at `place_m`, divided by that coil's own pulls.

    Forces of coils add as they are, so that only the diagonal of `Leakage.mutual` is not zero.
    """
    source = coil_source(coil)
    magnet = magnet_of(part)
    gap_m = coil.gap_mm * MM
    steel = steel_on(ballast)
    pulled = magnet_pull(source, magnet, np.full(len(place_m), gap_m), place_m, steel).force
    away = place_m[:, None] - np.concatenate([next_m, far_m])
    count = away.shape[0] * away.shape[1]
    heard = magnet_pull(source, magnet, np.full(count, gap_m), away.reshape(count, 2), steel).force
    share = heard.reshape(away.shape[:2]) / np.where(pulled == 0, np.inf, pulled)[:, None]
    return Leakage(share[..., None] * np.eye(away.shape[1]), np.zeros(away.shape[:2]))


def remanent_currents(coil: Coil, part: Magnet, share: float, offset_m: np.ndarray) -> np.ndarray:
    """Return zeros (n,): the force on a magnet is linear in the current."""
    return np.zeros(len(offset_m))


def assembly(part: Magnet) -> tuple[str, str, str]:
    """Return the assembly instructions for magnets, as the fields of `movers.Assembly`."""
    mark = (
        " First mark a pole: stack the magnets and put a dot on the upper face of each as you take it off; all dots are"
        " of one pole."
    )
    held = " Let the glue of each set before its neighbour comes near: they push or draw each other sideways."
    screws = " Take screws and nuts of brass, nylon or A2 stainless steel: magnets draw others, and bend towards them."
    if part.polarity == "alternating":
        turned = (
            " Over coil 1 the dots look up, over its neighbours along rows and columns down, and so on like a"
            " chessboard's colours; all magnets over one coil look the same way."
        )
        leads = (
            "Swap the two leads of every coil over which the dots look down, and connect all others alike: then all"
            " magnets move in step."
        )
        return mark + turned + held, leads, screws
    turned = " All dots look up, towards the boss; a magnet the other way round moves against its neighbours."
    leads = "Connect all coils alike: one the other way round pushes while its neighbours pull."
    return mark + turned + held, leads, screws


def coupling(part: Magnet, apart_m: np.ndarray, ballast: Ballast | None = None) -> np.ndarray:
    """Return the vertical coupling stiffness in N/m (second derivative of energy) of two magnets `apart_m` apart."""
    return neighbour_stiffness(magnet_of(part), apart_m, steel_on(ballast))
