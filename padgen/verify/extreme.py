"""Stiff and extreme cases: what each model says, what is true, and whether it knew."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

__all__ = ["Answer", "ExtremeCase"]


class Answer(NamedTuple):
    """What a model says: `values` of any shape and the relative error that it states itself.

    `residual` and `condition` are of the linear or eigen problem behind it, nan where there is none.
    """

    values: np.ndarray
    stated_error: float
    residual: float = float("nan")
    condition: float = float("nan")


@dataclass(frozen=True)
class ExtremeCase:
    """One case: what padgen answers (or refuses by raising a `PadgenError`), and what is true.

    Relative errors are of the largest entry of `values`. `reference` is analytic, of many digits, or a finer
    solve (`source` says which); as an `Answer` it has an error of its own, which is allowed for.
    """

    name: str
    domain: str
    model: str
    solve: Callable[[], Answer]
    reference: Callable[[], np.ndarray | Answer]
    source: str
