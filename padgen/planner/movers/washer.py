"""A steel washer, which the coil pulls by the square of its current.

``padgen/physics/pulls.npy`` has tables of the pull for all coils and washers of the catalogues (`docs/measure_force.py
tables` makes them). For other parts the pull at each distance from the coil's axis is solved at a few gaps and kept in
the cache, over ranges of gaps that are the same for every spec.
"""

from functools import lru_cache
from math import sqrt

import numpy as np

from padgen.core.units import MM
from padgen.physics.magnetics import CoilSource, SteelRing
from padgen.physics.pull import (
    LOW,
    RANGE,
    Leakage,
    PullAt,
    PullTable,
    make_table,
    of_one_turn,
    parts_key,
    pull_range,
    supplied_table,
)
from padgen.physics.pull import leakage as steel_leakage
from padgen.physics.remanence import remanent_current
from padgen.planner.coils import coil_source
from padgen.spec import Ballast, Coil, Spec, Washer

__all__ = [
    "FORCE_ORDER",
    "PART",
    "assembly",
    "leakage",
    "magnetic_parts",
    "pulls",
    "remanent_currents",
    "steel_ring",
]

FORCE_ORDER = 2
PART = "washer"


KIND = "pulls"
CODE = ("physics/magnetics.py", "physics/pull.py")


def steel_ring(washer: Washer, ballast: Ballast | None = None) -> SteelRing:
    """Return a washer, with any magnetic ballast on it, in SI units; a hexagon of ballast counts as a disc of its area.

    Of both the permeability is the washer's.
    """
    outer, inner, height = (v * MM for v in (washer.outer_diameter_mm, washer.inner_diameter_mm, washer.thickness_mm))
    crown: tuple[float, ...] = ()
    if ballast and ballast.is_magnetic:
        crown = ballast.round_mm * MM, ballast.inner_diameter_mm * MM, ballast.height_mm * MM
    return SteelRing(outer, inner, height, washer.relative_permeability, *crown)


def magnetic_parts(spec: Spec) -> tuple[CoilSource, SteelRing]:
    """Return the coil and the washer of a spec in SI units."""
    assert spec.washer is not None, "a spec whose mover is a washer has one"
    return coil_source(spec.coil), steel_ring(spec.washer, spec.ballast)


def pulls(coil: Coil, part: Washer, gap_m: np.ndarray, place_m: np.ndarray, ballast: Ballast | None = None) -> PullAt:
    """Return pulls (n,) per A² of coil current on washers at gaps (n,) over the coil and places (n, 2) off its axis."""
    offset_m = np.hypot(*place_m.T)
    source = coil_source(coil)
    washer = steel_ring(part, ballast)
    one = of_one_turn(source)
    result = np.empty((len(PullAt._fields), len(gap_m)))
    ranges = pull_range(gap_m)
    for offset, k in sorted(set(zip(offset_m.tolist(), ranges.tolist(), strict=True))):
        alike = (offset_m == offset) & (ranges == k)
        table = _table_beside(one, washer, k, offset).with_turns(source.turns)
        result[:, alike] = table.at(gap_m[alike], offset_m[alike])
    return PullAt(*result)


@lru_cache(maxsize=1024)
def _table_beside(coil: CoilSource, washer: SteelRing, part: int, offset_m: float) -> PullTable:
    """Return the table of pull against gap at one offset off a one-turn coil for gap range `part`, stored or solved."""
    brought = supplied_table(coil, washer, part)
    if brought is None or offset_m > brought.reach:
        return _solved_table(coil, washer, part, round(offset_m, ALIKE_DIGITS))
    return brought.at_single_offset(offset_m)


ALIKE_DIGITS = 9
"""Digits of an offset in m, to a nanometre: offsets that differ by less share a table, within 1e-6 of the pull."""


@lru_cache(maxsize=1024)
def _solved_table(coil: CoilSource, washer: SteelRing, part: int, offset_m: float) -> PullTable:
    """Return the pulls at one offset over one range of gaps; cached on disk, since solving takes some ten ms."""
    from padgen.core import cache

    reach = max(offset_m, 1e-9) * sqrt(2)
    key = cache.key_of([parts_key(coil, washer), part, reach, cache.code_hash(*CODE)])
    if known := cache.load(KIND, key):
        scale, *shape = np.array(known)
        low = LOW * RANGE**part
        return PullTable(low, low * RANGE, reach, scale, np.array(shape).T[:, None])
    table = make_table(coil, washer, part, reach, 1)
    cache.store(KIND, key, [table.scale.tolist(), *table.shape[:, 0].T.tolist()])
    return table


def leakage(
    coil: Coil,
    part: Washer,
    place_m: np.ndarray,
    next_m: np.ndarray,
    far_m: np.ndarray,
    ballast: Ballast | None = None,
) -> Leakage:
    """Return other coils' pulls on a coil's washers, divided by that coil's pull; places are in m from its axis."""
    return steel_leakage(coil_source(coil), steel_ring(part, ballast), coil.gap_mm * MM, place_m, next_m, far_m)


def remanent_currents(coil: Coil, part: Washer, share: float, offset_m: np.ndarray) -> np.ndarray:
    """Return ρ (n,) in A of the pull ∝ i² + ρ i on remanent washers, at offsets (n,) in m from the coil's axis."""
    return _remanent_currents(coil, part, share, tuple(offset_m.tolist()))


@lru_cache(maxsize=64)
def _remanent_currents(coil: Coil, part: Washer, share: float, offset_m: tuple[float, ...]) -> np.ndarray:
    kept = share * part.coercivity_a_per_m, share * coil.core_coercivity_a_per_m
    return remanent_current(coil_source(coil), steel_ring(part), coil.gap_mm * MM, np.array(offset_m), *kept)


def assembly(part: Washer) -> tuple[str, str, str]:
    """Return the assembly instructions for washers, as the fields of `movers.Assembly`."""
    return "", "Connect all coils alike: their fields add before they are squared.", ""
