"""Look up the pull of a spec's coil on its washers: from tables that come with padgen, or solved once and cached.

``padgen/physics/pulls.npy`` has tables of all coils and washers of the catalogues (`docs/measure_force.py tables` makes
them). For other parts the pull at each distance from the coil's axis is solved at a few gaps and kept in the cache,
over ranges of gaps that are the same for every spec.
"""

from functools import lru_cache
from math import log, sqrt

import numpy as np

from padgen.core.units import MM
from padgen.physics.magnetics import CoilSource, SteelRing
from padgen.physics.pull import PullAt, PullTable, brought_table, make_table, parts_key
from padgen.planner.coils import coil_source
from padgen.spec import Spec

__all__ = ["magnetic_parts", "pull_range", "pulls"]

KIND = "pulls"
CODE = tuple(f"physics/{name}.py" for name in ("coil_field", "pull", "pull_table", "ring_charges", "steel_body"))
LOW, RANGE, GAPS = 0.35 * MM, 3, 5
"""Parts outside the catalogues are solved at `GAPS` gaps in each range, from `LOW · RANGE^k` to `LOW · RANGE^(k+1)`."""


def magnetic_parts(spec: Spec) -> tuple[CoilSource, SteelRing]:
    """Return the coil and the washer of a spec in SI units."""
    washer = spec.washer
    return (
        coil_source(spec.coil),
        SteelRing(
            washer.outer_diameter_mm * MM,
            washer.inner_diameter_mm * MM,
            washer.thickness_mm * MM,
            washer.relative_permeability,
        ),
    )


def pulls(spec: Spec, gap_m: np.ndarray, offset_m: np.ndarray) -> PullAt:
    """Return the pulls (n,) on washers over gaps (n,) in m, at offsets (n,) in m from the coil's axis."""
    parts = magnetic_parts(spec)
    result, missing = np.empty((len(PullAt._fields), len(gap_m))), np.ones(len(gap_m), bool)

    def answer(table: PullTable | None, among: np.ndarray) -> None:
        if table is not None and (among := among & table.covers(gap_m, offset_m)).any():
            result[:, among] = table.at(gap_m[among], offset_m[among])
            missing[among] = False

    answer(_shipped_table(*parts), missing)
    part = pull_range(gap_m)
    for offset, k in sorted(set(zip(offset_m[missing].tolist(), part[missing].tolist(), strict=True))):
        answer(_own(*parts, k, offset), (offset_m == offset) & (part == k))
    return PullAt(*result)


def pull_range(gap_m: np.ndarray) -> np.ndarray:
    """Return the number (n,) of the range of a gap (n,) in m; gaps of different ranges may have different tables."""
    return np.floor(np.log(gap_m / LOW) / log(RANGE)).astype(int)


_shipped_table = lru_cache(maxsize=64)(brought_table)


@lru_cache(maxsize=1024)
def _own(coil: CoilSource, washer: SteelRing, part: int, offset_m: float) -> PullTable:
    """Return the pulls at one offset over one range of gaps; cached on disk, since solving takes some ten ms."""
    from padgen.core import cache

    low, high, reach = LOW * RANGE**part, LOW * RANGE ** (part + 1), max(offset_m, 1e-9) * sqrt(2)
    key = cache.key_of([parts_key(coil, washer), low, high, reach, GAPS, cache.code_hash(*CODE)])
    try:
        known = np.array(cache.load(KIND, key), float).reshape(-1, GAPS)
        if np.isfinite(known).all():
            return PullTable(low, high, reach, known[0], known[1:].T[:, None])
    except (TypeError, ValueError):
        pass
    table = make_table(coil, washer, low, high, reach, GAPS, 1)
    cache.store(KIND, key, [table.scale.tolist(), *table.shape[:, 0].T.tolist()])
    return table
