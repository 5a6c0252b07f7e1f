"""What a ladder of models is made of, and what measuring it gives. Data only."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf, nan
from typing import Any, NamedTuple

import numpy as np

__all__ = ["NOT_RUN", "Judged", "Ladder", "Measured", "Order", "Row", "Rung", "Solved", "Theory"]


class Solved(NamedTuple):
    """What a rung answers: `values` of any shape, how many `unknowns` it solved for, the `residual` if it knows one.

    `unknowns` is 0 for a formula.
    """

    values: np.ndarray
    unknowns: int = 0
    residual: float = nan


class Theory(NamedTuple):
    """The order with which the errors of a series should fall with its `step`, and why.

    `same_limit` where the series converges to what the ladder's reference does: then errors are
    against that, else the series' own differences are looked at.
    """

    order: float
    why: str
    same_limit: bool = False


@dataclass(frozen=True)
class Rung:
    """One model at one resolution.

    `solve` runs in a process of its own, so that it must pickle: a `functools.partial` of a function
    of a module. Rungs of one `series` follow each other from coarse to fine; `step` is what is refined
    in it (size of elements, chord, time step), nan where no order is expected. `imports` are loaded
    before the clock starts, and so runs `prepare`, whose result `solve` is called with where there is one.
    A rung that is not `offered` is never recommended: it is there to be measured against.
    """

    model: str
    resolution: str
    solve: Callable[..., Solved]
    series: str = ""
    step: float = nan
    imports: tuple[str, ...] = ()
    limit_s: float = 600.0
    prepare: Callable[[], Any] | None = None
    offered: bool = True


@dataclass(frozen=True)
class Ladder:
    """The rungs that answer one question about one `subject`, coarse to fine.

    The last three rungs of the series `reference` are what the others are measured against. Errors
    are relative to each value (`relative_to` = "each") or to the largest one ("largest"). `before` is called
    once, ahead of the rungs.
    """

    name: str
    subject: str
    quantity: str
    unit: str
    rungs: tuple[Rung, ...]
    reference: str
    relative_to: str = "largest"
    theory: Mapping[str, Theory] = field(default_factory=dict)
    note: str = ""
    before: Callable[[], Any] | None = None


@dataclass(frozen=True)
class Measured:
    """What running a rung gave; `values` is None where it refused or broke down, and `note` says why.

    `seconds` (wall) and `cpu_seconds` are the best of `runs`, `memory_mb` is the peak over what the
    process held after its imports.
    """

    values: np.ndarray | None = None
    unknowns: int = 0
    residual: float = nan
    seconds: float = nan
    cpu_seconds: float = nan
    runs: int = 0
    memory_mb: float = nan
    note: str = ""


NOT_RUN = Measured(note="not run: the study was stopped")


@dataclass(frozen=True)
class Row:
    """A rung with what was measured and its `error`, which is at most `at_most`.

    With `is_bound` the error cannot be told from the reference's own: only `at_most` is known.
    """

    rung: Rung
    measured: Measured
    error: float = nan
    at_most: float = inf
    is_bound: bool = False


@dataclass(frozen=True)
class Order:
    """Order of convergence of a series by its finest rungs whose differences are more than noise.

    None where it has too few of them, or where their differences do not fall.
    """

    series: str
    observed: float | None
    theory: Theory | None


@dataclass(frozen=True)
class Judged:
    """A ladder that was run. `uncertainty` is the reference's own error, inf where nothing is known of it.

    `converged` tells whether two refinements show it; `why` is that as a sentence. `reference` is
    the index of its row, None where no rung of the reference's series has an answer.
    """

    ladder: Ladder
    rows: tuple[Row, ...]
    reference: int | None
    uncertainty: float
    converged: bool
    why: str
    orders: tuple[Order, ...]
