"""Players: each shows frames or plays a WAV file on a connected pad, one module each; `register` adds others.

A player's name is its option of `padgen play`, and says after it where the pad is to be reached. A player holds to
`Player`; what it is to play is its `PlayJob`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from padgen.core.registry import PLAYERS

if TYPE_CHECKING:
    import numpy as np

    from padgen.measured.tuning import Tuning
    from padgen.planner.plan import Plan

__all__ = ["FramesJob", "Player", "WavJob", "register", "unregister"]


@dataclass(frozen=True, slots=True, eq=False)
class FramesJob:
    """Frames for a player, and where it is to show them.

    `levels` (frames, taxels) are from 0 to 1, each is shown for `seconds`, by default the device's. `baud` is of a
    serial line. `on_shown` is called with the number of frames that are shown.
    """

    address: str
    plan: "Plan"
    levels: "np.ndarray"
    seconds: float | None
    tuning: "Tuning | None"
    baud: int
    on_shown: Callable[[int], None]


@dataclass(frozen=True, slots=True, eq=False)
class WavJob:
    """A WAV file, the device to play it on (None: the player chooses), and how often it is repeated."""

    address: int | str | None
    path: Path
    repeat: int
    progress: Callable[[str], None]


class Player(Protocol):
    """Interface of a player: a module or object with `PLAYS`, `ADDRESS`, `ABOUT`, `play` and `outcome`."""

    PLAYS: str
    """``"frames"``: its job is a `FramesJob`; ``"wav"``: a `WavJob`."""
    ADDRESS: str
    """Name in the help of the value of its option, such as ``"PORT"``; in brackets if the value may be left out."""
    ABOUT: str
    """Help of that option."""

    def play(self, job: Any) -> Any:
        """Play a job, and return how it went.

        Raises
        ------
        SpecError, FileError, EngineMissingError
            What is to be played, or its address, is wrong; the pad is not reached; a package is missing.
        """

    def outcome(self, played: Any) -> tuple[str, dict[str, Any]]:
        """Return a sentence on what `play` returned, and its figures for ``--json``."""


register = PLAYERS.register
unregister = PLAYERS.unregister
