"""What a study is made about, and the solids that finer models need."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from padgen.ladders.isolate import run_apart
from padgen.planner.plan import Channel, Plan

__all__ = ["Scene", "chosen_channels", "distinct_channels", "write_steps"]

MOST_SUBJECTS = 4
"""Taxels that are studied one by one where a pad has more."""


@dataclass(frozen=True)
class Scene:
    """A plan, a folder for what is made on the way, and how to say what is being done."""

    plan: Plan
    aside: Path
    progress: Callable[[str], None] = lambda step: None

    @cached_property
    def steps(self) -> dict[int, Path]:
        """The STEP file of each channel's taxel, as a build writes it; made once, in a process of its own.

        Raises
        ------
        PadgenError
            A kernel refused a taxel.
        """
        self.progress("modelling the taxels")
        written: dict[int, Path] = run_apart(write_steps, self.plan, self.aside)
        return written


def distinct_channels(plan: Plan) -> tuple[Channel, ...]:
    """Channels whose taxels differ in their beams, the first of each kind."""
    found = {channel.beam: channel for channel in reversed(plan.channels)}
    return tuple(sorted(found.values(), key=lambda channel: channel.index))


def chosen_channels(plan: Plan) -> tuple[Channel, ...]:
    """The distinct channels, or of many a few that are spread from the lowest to the highest."""
    every = distinct_channels(plan)
    if len(every) <= MOST_SUBJECTS:
        return every
    places = (round(k * (len(every) - 1) / (MOST_SUBJECTS - 1)) for k in range(MOST_SUBJECTS))
    return tuple(every[place] for place in places)


def write_steps(plan: Plan, folder: Path) -> dict[int, Path]:
    """Write the STEP file of every distinct channel into `folder`. Imports build123d."""
    from padgen.solid.formats.step import write_taxel_step

    paths = {channel.index: folder / f"taxel-{channel.index}.step" for channel in distinct_channels(plan)}
    for index, path in paths.items():
        write_taxel_step(plan, plan.channels[index], path)
    return paths
