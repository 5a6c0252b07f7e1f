"""Modes of one taxel as washer and finger feel them: the common result of all rungs of the structure ladder."""

from typing import NamedTuple

import numpy as np

__all__ = ["UPWARD", "TaxelModes"]

UPWARD = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""A vertical unit pull at the washer's axis, as forces and moments."""


class TaxelModes(NamedTuple):
    """Modes of one taxel, lowest first.

    `frequency_hz` (k,); `motion` (k, 6) is the mass-normalised motion of the washer as a body: displacement of the
    point of its axis on the bed's plane (z = 0, taxel axes) in kg^-½ and rotation in kg^-½/m. All modes together make
    up the compliance of the washer. A rung that solves for few modes may give the static compliance of the others in
    `rest` (6, 6), in m/N (rad/(N·m)).
    """

    frequency_hz: np.ndarray
    motion: np.ndarray
    rest: np.ndarray | None = None

    def compliances(self, wrench: np.ndarray = UPWARD) -> np.ndarray:
        """Return the static compliance (k,) in m/N of each mode, from a `wrench` (6,) to the washer's vertical motion.

        The wrench acts on the washer; its vertical part is 1, its moments are in m about the axis' point. The motion is
        that at the axis.
        """
        both: np.ndarray = self.motion[:, 2] * (self.motion @ wrench) / (2 * np.pi * self.frequency_hz) ** 2
        return both

    @property
    def working(self) -> int:
        """Index of the channel's own mode: the one that a vertical pull at the washer's axis moves most."""
        return int(self.compliances().argmax())
