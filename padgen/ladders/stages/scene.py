"""What a study is made about, and the solids that finer models need."""

from pathlib import Path
from typing import NamedTuple

from padgen.planner.plan import Channel, Plan

__all__ = ["Scene", "chosen_channels", "distinct_channels", "write_steps"]

MOST_SUBJECTS = 4
"""Taxels that are studied one by one where a pad has more."""


class Scene(NamedTuple):
    """A plan, and a folder for what is made on the way."""

    plan: Plan
    aside: Path

    def step(self, channel: Channel) -> Path:
        """Where `write_steps` puts the STEP file of a channel's taxel."""
        return self.aside / f"taxel-{channel.index}.step"


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


def write_steps(scene: Scene) -> None:
    """Write the STEP files of `chosen_channels`, as a build does. Imports build123d.

    Raises
    ------
    PadgenError
        The kernel refuses a taxel.
    """
    from padgen.solid.formats.step import write_taxel_step

    for channel in chosen_channels(scene.plan):
        write_taxel_step(scene.plan, channel, scene.step(channel))
