"""The variants of a sweep: all combinations, or a seeded sample that fills the space evenly.

A sample is drawn by `scipy.stats.qmc`: Latin hypercube (McKay 1979), or Sobol's sequence with Owen's
scrambling. Variants are numbered before constraints take some away, so that a changed constraint does not
rename the others.
"""

from collections.abc import Iterator
from itertools import product
from math import ceil, floor, prod
from typing import Any, NamedTuple

import numpy as np

from padgen.batch.definition import Axis, Sweep
from padgen.core.errors import PadgenError, SpecError
from padgen.spec import make_spec
from padgen.spec.load import laid_over

__all__ = ["Variant", "count_points", "variant_name", "variant_table", "variants"]

MOST_VARIANTS = 10_000_000
BLOCK = 4096


class Variant(NamedTuple):
    """One point: its number, and the values of the varied fields by dotted name."""

    number: int
    values: dict[str, Any]


def count_points(sweep: Sweep) -> int:
    """How many points there are, before constraints.

    Raises
    ------
    SpecError
        More than ten million.
    """
    if sweep.sample.method != "grid":
        return sweep.sample.count
    points = prod(len(axis.values) or axis.steps for axis in sweep.axes)
    if points > MOST_VARIANTS:
        raise SpecError(f"has {points} combinations, at most {MOST_VARIANTS} will do; take a sample", "axes")
    return points


def variants(sweep: Sweep) -> Iterator[Variant]:
    """The variants that the constraints leave, in the order of their numbers; made as they are asked for."""
    count_points(sweep)
    points = _grid(sweep) if sweep.sample.method == "grid" else _sample(sweep)
    indirect = _is_indirect(sweep)
    for number, values in enumerate(points):
        variant = Variant(number, values)
        try:
            spec = make_spec(variant_table(sweep, variant), sweep.folder) if indirect else None
        except PadgenError:
            yield variant  # its row will tell what is wrong with it
            continue
        if all(condition.holds(values, spec) for condition in sweep.constraints):
            yield variant


def _is_indirect(sweep: Sweep) -> bool:
    """Whether a constraint asks for a field that is not varied itself but may follow one that is.

    The printer brings its default material, and a catalogue's name all of its figures.
    """
    varied = {name for axis in sweep.axes for name in axis.fields}
    tables = {name.partition(".")[0] for name in varied}
    tables |= {"material"} if "printer" in tables else set()
    asked = {name for condition in sweep.constraints for name in condition.names}
    as_tables = {
        name
        for axis in sweep.axes
        for row in axis.values
        for name, value in zip(axis.fields, row, strict=True)
        if isinstance(value, dict)
    }
    return bool(asked & as_tables) or any(name.partition(".")[0] in tables for name in asked - varied)


def variant_name(sweep: Sweep, number: int) -> str:
    """The name of a variant and of its folder."""
    return f"{sweep.settings.name}-{number:05d}"


def variant_table(sweep: Sweep, variant: Variant) -> dict[str, Any]:
    """The table of a variant's spec: the base's with the varied fields and a name of its own."""
    return laid_over(sweep.base, variant.values) | {"name": variant_name(sweep, variant.number)}


def _grid(sweep: Sweep) -> Iterator[dict[str, Any]]:
    for chosen in product(*(_values(axis) for axis in sweep.axes)):
        yield _named(sweep, chosen)


def _values(axis: Axis) -> list[tuple[Any, ...]]:
    """The values of an axis of a grid."""
    if axis.values:
        return list(axis.values)
    found = [_at(axis, share) for share in np.linspace(0.0, 1.0, axis.steps).tolist()]
    return list(dict.fromkeys(found))


def _sample(sweep: Sweep) -> Iterator[dict[str, Any]]:
    from scipy.stats import qmc

    kind = qmc.LatinHypercube if sweep.sample.method == "latin-hypercube" else qmc.Sobol
    engine = kind(len(sweep.axes), rng=np.random.default_rng(sweep.sample.seed))
    if sweep.sample.method == "latin-hypercube":
        yield from (_named(sweep, _chosen(sweep, row)) for row in engine.random(sweep.sample.count))
        return
    left = sweep.sample.count
    while left > 0:
        # Blocks of a power of two, as the sequence is balanced.
        for row in engine.random(BLOCK)[:left]:
            yield _named(sweep, _chosen(sweep, row))
        left -= BLOCK


def _chosen(sweep: Sweep, shares: np.ndarray) -> list[tuple[Any, ...]]:
    pairs = zip(sweep.axes, shares.tolist(), strict=True)
    return [
        axis.values[min(int(share * len(axis.values)), len(axis.values) - 1)] if axis.values else _at(axis, share, True)
        for axis, share in pairs
    ]


def _at(axis: Axis, share: float, sampled: bool = False) -> tuple[Any, ...]:
    """The value of a range at a share of it; of a sample, each whole number is as likely as the others."""
    if axis.whole and sampled and axis.scale == "linear":
        low, high = ceil(axis.low), floor(axis.high)
        return (min(low + int(share * (high - low + 1)), high),)
    if axis.scale == "log":
        value = axis.low * (axis.high / axis.low) ** share
    else:
        value = axis.low + (axis.high - axis.low) * share
    return (round(value),) if axis.whole else (float(f"{value:.12g}"),)


def _named(sweep: Sweep, chosen: Any) -> dict[str, Any]:
    return {
        name: value
        for axis, values in zip(sweep.axes, chosen, strict=True)
        for name, value in zip(axis.fields, values, strict=True)
    }
