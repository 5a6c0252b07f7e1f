"""The variants of a sweep: all combinations, or a seeded sample that fills the space evenly.

A sample is drawn by `scipy.stats.qmc`: Latin hypercube (McKay 1979), or Sobol's sequence with Owen's
scrambling. Variants are numbered before constraints take some away, so that a changed constraint does not
rename the others.
"""

from collections.abc import Iterable, Iterator
from itertools import product
from math import prod
from typing import Any, NamedTuple

import numpy as np

from padgen.batch.definition import Sweep
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
    points = sweep.sample.count or prod(len(axis.values) for axis in sweep.axes)
    if points > MOST_VARIANTS:
        raise SpecError(f"has {points} combinations, at most {MOST_VARIANTS} will do; take a sample", "axes")
    return points


def variants(sweep: Sweep) -> Iterator[Variant]:
    """The variants that the constraints leave, in the order of their numbers; made as they are asked for."""
    count_points(sweep)
    points = product(*(axis.values for axis in sweep.axes)) if sweep.sample.method == "grid" else _sample(sweep)
    for number, chosen in enumerate(points):
        pairs = zip(sweep.axes, chosen, strict=True)
        variant = Variant(
            number, {name: value for axis, row in pairs for name, value in zip(axis.fields, row, strict=True)}
        )
        if not sweep.constraints or _is_left(sweep, variant):
            yield variant


def _is_left(sweep: Sweep, variant: Variant) -> bool:
    try:
        # A constraint may ask for what a varied field brings along, as a printer its default material.
        spec = make_spec(variant_table(sweep, variant), sweep.folder)
    except PadgenError:
        spec = sweep.spec  # its row will tell what is wrong with it
    return all(condition.holds(variant.values, spec) for condition in sweep.constraints)


def variant_name(sweep: Sweep, number: int) -> str:
    """The name of a variant and of its folder."""
    return f"{sweep.settings.name}-{number:05d}"


def variant_table(sweep: Sweep, variant: Variant) -> dict[str, Any]:
    """The table of a variant's spec: the base's with the varied fields and a name of its own."""
    return laid_over(sweep.base, variant.values) | {"name": variant_name(sweep, variant.number)}


def _sample(sweep: Sweep) -> Iterator[list[tuple[Any, ...]]]:
    from scipy.stats import qmc

    count, generator = sweep.sample.count, np.random.default_rng(sweep.sample.seed)
    if sweep.sample.method == "latin-hypercube":
        blocks: Iterable[np.ndarray] = [qmc.LatinHypercube(len(sweep.axes), rng=generator).random(count)]
    else:
        engine = qmc.Sobol(len(sweep.axes), rng=generator)
        # Of a power of two, as the sequence is balanced.
        blocks = (engine.random(BLOCK)[: count - start] for start in range(0, count, BLOCK))
    for block in blocks:
        for shares in block.tolist():
            yield [axis.at(share, True) for axis, share in zip(sweep.axes, shares, strict=True)]
