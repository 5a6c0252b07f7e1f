"""`Drive`: what the coils of a plan are to show, and the files that make them show it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from padgen.core.errors import FileError, SpecError, shown
from padgen.core.files import reason
from padgen.core.registry import FORMATS
from padgen.driver.formats import in_order
from padgen.driver.frames import read_frames, state_frame
from padgen.planner.plan import Plan

if TYPE_CHECKING:
    from padgen.driver.drive_folder import Driven
    from padgen.measured.tuning import Tuning

__all__ = ["DEFAULT_TABLES", "DEFAULT_WAVES", "Drive", "levels_of"]

DEFAULT_TABLES, DEFAULT_WAVES = ("csv", "json"), ("csv", "json", "wav")
"""Formats where none is named: without and with something to show."""


def levels_of(plan: Plan, state: str | None, frames: Any) -> np.ndarray | None:
    """Levels (k, taxels) in 0 … 1 of a state, or of frames: files of images, or levels themselves; None for neither.

    Raises
    ------
    SpecError, FileError
        Both are given, or the pad cannot show them.
    """
    if state is not None and frames is not None:
        raise SpecError("is a state or frames, not both", "state")
    if state is not None:
        return state_frame(plan, state)
    if frames is None:
        return None
    if isinstance(frames, (str, Path)) or all(isinstance(frame, (str, Path)) for frame in frames):
        return read_frames(frames, plan).levels
    levels = np.atleast_2d(np.asarray(frames, float))
    if levels.ndim != 2 or levels.shape[1] != len(plan.taxels) or not ((levels >= 0) & (levels <= 1)).all():
        raise SpecError(f"must be (k, {len(plan.taxels)}) levels in 0 … 1, got an array {levels.shape}", "frames")
    return levels


@dataclass(frozen=True, eq=False, repr=False)
class Drive:
    """What the coils of a plan are to show; made by `padgen.drive`, whose parameters these are.

    `frames` (k, taxels) are levels in 0 … 1, None for tables alone; `held` tells that they are states.
    """

    plan: Plan
    frames: np.ndarray | None = None
    seconds: float | None = None
    held: bool = False
    loop: bool = False
    rate_hz: int | None = None
    signal: str = "voltage"
    carrier_hz: float | None = None
    tuning: "Tuning | None" = None
    progress: Callable[[str], None] = lambda step: None

    def __repr__(self) -> str:
        shown = "tables" if self.frames is None else f"{len(self.frames)} frames"
        return f"<Drive {self.plan.name}: {shown}, {self.plan.selectivity.drive}>"

    def save(
        self,
        path: str | Path,
        formats: Sequence[str] | None = None,
        depth: str = "24",
        hear: bool = False,
        gap: bool = False,
    ) -> "Driven":
        """Write one file, or a folder of files, judged against the limits of coil, amplifier and gap.

        Parameters
        ----------
        path : path
            A file such as ``drive.wav``, whose ending tells its format, or a folder.
        formats : sequence of str, optional
            For a folder: names of `padgen.driver.formats`; by default tables, and a WAV where something is shown.
        depth : {'24', 'float'}
            Of a WAV's samples.
        hear : bool
            Listen to the written WAV: what fingers feel of it, in ``.heard``. `gap`: the pull grows as the gap closes.

        Returns
        -------
        Driven
            ``.files`` and ``.findings``; an error tells which limit is exceeded.

        Raises
        ------
        SpecError
            What is asked for does not go together; nothing is written.
        FileError
            It cannot be written; what was there stays.
        """
        target = Path(path)
        if formats is not None or not target.suffix:
            return self.save_folder(target, formats, depth, hear, gap)
        # Of formats whose files end alike the first one counts, which padgen brings.
        known = reversed(in_order(FORMATS.names()).items())
        endings = {Path(each.FILE).suffix: (name, each.FILE) for name, each in known}
        if target.suffix.lower() not in endings:
            raise SpecError(
                f"must end with one of {', '.join(sorted(endings))}, got {shown(target.suffix)}", str(target)
            )
        name, file = endings[target.suffix.lower()]
        try:
            with TemporaryDirectory(prefix=".padgen-", dir=target.absolute().parent) as aside:
                driven = self.save_folder(Path(aside) / "drive", (name,), depth)
                (driven.folder / file).replace(target)
        except OSError as error:
            raise FileError(f"cannot be written ({reason(error)})", str(target)) from error
        return replace(driven, folder=target.absolute().parent, files=(target.name,))

    def save_folder(
        self, folder: Path, formats: Sequence[str] | None, depth: str = "24", hear: bool = False, gap: bool = False
    ) -> "Driven":
        """Write a folder of files; parameters, result and errors are those of `save`."""
        from padgen.driver.drive_folder import DriveRequest, parse_formats, write_drive

        chosen = formats or (DEFAULT_TABLES if self.frames is None else DEFAULT_WAVES)
        request = DriveRequest(
            formats=parse_formats(",".join(chosen)),
            frames=self.frames,
            seconds_each=self.seconds,
            held=self.held,
            loop=self.loop,
            rate_hz=self.rate_hz,
            depth=depth,
            signal=self.signal,
            carrier_hz=self.carrier_hz,
            tuning=self.tuning,
            hear=hear,
            gap=gap,
        )
        return write_drive(self.plan, folder, request, self.progress)
