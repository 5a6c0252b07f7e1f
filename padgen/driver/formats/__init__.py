"""Formats of the files that drive a pad, for this and other programs and machines: one module each, found by name.

Others are added by `register`. A format holds to `DriveFormat`; what it needs to know is its `DriveJob`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Protocol

from padgen.core.errors import Finding
from padgen.core.registry import FORMATS

if TYPE_CHECKING:
    from padgen.core.files import OutputFolder
    from padgen.driver.drive_folder import Drive
    from padgen.driver.ear import Heard
    from padgen.driver.formats.wav import WaveReport
    from padgen.driver.signs import PlayedRecoil
    from padgen.driver.waveform import PadDrive, Timeline
    from padgen.planner.plan import Plan

__all__ = ["DriveFormat", "DriveJob", "in_order", "register", "unregister"]


@dataclass(slots=True, eq=False)
class DriveJob:
    """Plan, drive and options from which a drive format writes its files, with the findings and results so far.

    `request` is what is asked for, `depth` of a WAV's samples; `hear` and `gap` as `Drive.save` has them. `timeline` is
    None where nothing is shown, as is the `recoil` of the pad. `shown` are the findings about the timeline, `findings`
    all others; `report` and `heard` are the wave's.
    """

    plan: "Plan"
    request: "Drive"
    progress: Callable[[str], None]
    drive: "PadDrive"
    timeline: "Timeline | None"
    depth: str = "24"
    hear: bool = False
    gap: bool = False
    shown: tuple[Finding, ...] = ()
    findings: list[Finding] = field(default_factory=list)
    report: "WaveReport | None" = None
    heard: "Heard | None" = None
    recoil: "PlayedRecoil | None" = None

    def played(self) -> "tuple[PadDrive, Timeline]":
        """Return the drive and the timeline of its frames, for a format that needs frames (`MADE_OF` "frames")."""
        assert self.timeline is not None
        return self.drive, self.timeline


class DriveFormat(Protocol):
    """Interface of a drive format: a module or object with `FILE`, `MADE_OF` and `write`.

    An `ORDER` may say when it is written, the lowest first; those without one come last. A `refuse` may raise
    SpecError of a job that it cannot write, before anything else is done.
    """

    FILE: str
    """Name of the file that says what is played; findings name it."""
    MADE_OF: str
    """``"plan"``: of nothing else; ``"drive"``: also of what the coils play; ``"frames"``: of what is shown;
    ``"host"``: of what a host may send when it is played, which the format itself judges."""

    def write(self, out: "OutputFolder", job: DriveJob) -> None:
        """Add all files of this format to `out`; if it raises SpecError, no file of the whole drive is kept."""


register = FORMATS.register
unregister = FORMATS.unregister


def in_order(names: Iterable[str]) -> dict[str, DriveFormat]:
    """Return the drive formats of these names, keyed by name, in the order in which their files are written.

    Raises
    ------
    SpecError
        There is no such format.
    """
    formats: dict[str, DriveFormat] = {name: FORMATS.get(name, "--formats") for name in names}
    return dict(sorted(formats.items(), key=lambda item: getattr(item[1], "ORDER", inf)))
