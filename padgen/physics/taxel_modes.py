"""What every rung of the structure ladder says about a taxel: its modes, as washer and finger feel them."""

from typing import NamedTuple

import numpy as np

__all__ = ["UPWARD", "TaxelModes"]

UPWARD = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""A vertical unit pull at the washer's axis, as forces and moments."""


class TaxelModes(NamedTuple):
    """Modes of one taxel, lowest first.

    `frequency_hz` (k,); `motion` (k, 6): mass-normalised motion of the washer as a body, displacement
    of the point of its axis on the bed's plane (z = 0, taxel's own axes) in kg^-½ and rotation in
    kg^-½/m. All modes together give the compliance of the washer; a rung that solves for few of
    them may add in `rest` (6, 6) what the others add to the static compliance, in m/N (rad/(N·m)).
    """

    frequency_hz: np.ndarray
    motion: np.ndarray
    rest: np.ndarray | None = None

    def compliances(self, wrench: np.ndarray = UPWARD) -> np.ndarray:
        """Static compliance (k,) in m/N that each mode adds, from a `wrench` (6,) on the washer (its
        vertical part 1, moments in m about the axis' point) to the vertical motion at its axis."""
        both: np.ndarray = self.motion[:, 2] * (self.motion @ wrench) / (2 * np.pi * self.frequency_hz) ** 2
        return both

    @property
    def working(self) -> int:
        """Index of the mode that a vertical pull at the washer's axis moves most: the channel's own."""
        return int(self.compliances().argmax())
