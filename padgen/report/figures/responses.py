"""Curves of how each taxel over a coil responds to frequency, and spectral lines of its squared current, all ON.

A curve is a taxel's motion, in dB of its ON level, if the line that drives it moved in frequency. A point is what the
loudest OFF taxel hears of a tone or a spur that others make. Below are the lines' own strengths.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from padgen.physics.resonator import felt_energy
from padgen.planner.channels import coil_modes
from padgen.planner.drive_scheme import placed_channels
from padgen.report.figures import Curves, Facts, Figure, Line, Panel, Points, Scale, Stems
from padgen.report.motion import MOST_WITH_SPURS, CoilLines, coil_lines

if TYPE_CHECKING:
    from padgen.planner.plan import Channel, Plan

__all__ = ["CAPTION", "MOST_NAMED", "ORDER", "SHOWN_IN", "TITLE", "make"]

TITLE = "Responses"
CAPTION = (
    "How far each taxel of one coil moves as a tone passes over the frequencies, against its own full level; solid"
    " lines are the tones that are played, dashed ones the spurs that two of them make."
)
SHOWN_IN = ("draw", "page")
ORDER = 1
POINTS = 1200
MOST_NAMED = 12
MOST_LISTED = 40
"""Most spurs that the page marks and lists."""
FLOOR_DB = -60.0
PAGE_DB = (-70.0, 4.0)
HEARD = "{} of others, as the loudest OFF\ntaxel hears it: off its curve by how much\nweaker or stronger it is played"


def make(plan: "Plan", quick: bool) -> tuple[Figure, ...]:
    """Return a figure for each set of channels: the responses of the taxels over one of its coils."""
    return tuple(_of_set(plan, which) for which in range(len(plan.sets)))


def _of_set(plan: "Plan", which: int) -> Figure:
    channel_set = plan.sets[which]
    placed = placed_channels(plan.spec, channel_set)
    modes = coil_modes(plan.spec, channel_set)
    roles = [f"channel-{c.index}" for c in channel_set]
    lines = coil_lines(plan, channel_set, MOST_WITH_SPURS)
    energy = lines.energy(plan, channel_set, modes)
    for line, makers in enumerate(lines.makers):
        energy[list(makers), line] = 0.0
    spurs = _spurs(lines)
    hz = placed.resonance_hz
    seen = lines.hz >= hz[0] / 8
    low_hz = 0.9 * min(hz[0] / 2, lines.hz[seen].min())
    high_hz = 1.1 * max(2 * hz[-1], lines.hz[seen].max())
    marked_hz = [float(lines.hz[line]) for line in spurs if lines.hz[line] > hz[0] / 4]
    frequency = Scale(
        "frequency of the pull",
        "Hz",
        low_hz,
        high_hz,
        is_log=True,
        near=(
            float(min(0.7 * hz[0], *(0.9 * spur_hz for spur_hz in marked_hz))) if marked_hz else 0.7 * float(hz[0]),
            float(max(1.4 * hz[-1], *(1.05 * spur_hz for spur_hz in marked_hz))) if marked_hz else 1.4 * float(hz[-1]),
        ),
    )
    grid = np.unique(np.concatenate([np.geomspace(low_hz, high_hz, POINTS), hz]))
    named = range(len(channel_set)) if len(channel_set) <= MOST_NAMED else (0, len(channel_set) - 1)
    curves = Curves(
        x=grid,
        y=10 * np.log10(felt_energy(modes, slice(None), grid)),
        roles=tuple(roles),
        labels=tuple(
            f"channel {c.index}, {c.resonance_hz:.1f} Hz" if k in named else "" for k, c in enumerate(channel_set)
        ),
        short_labels=tuple(f"ch {c.index}" for c in channel_set),
    )
    asked_db = plan.selectivity.asked_db
    across = [
        Line("asked", -asked_db, f"asked of OFF taxels: {asked_db:.0f} dB below", "y", is_dashed=True, only=("draw",)),
        *(Line("spur", float(lines.hz[line]), is_dashed=True, only=("page",)) for line in spurs),
        *(Line(role, float(at), only=("page",)) for role, at in zip(roles, hz, strict=True)),
    ]
    points = []
    stems = []
    strongest = placed.line.max()
    is_tone = np.array([kind == "tone" for kind in lines.kinds])
    for role, symbol, of_kind in (("tone", "o", is_tone), ("spur", "X", ~is_tone)):
        shown = np.flatnonzero(of_kind & seen)
        if not shown.size:
            continue
        level_db = 10 * np.log10(np.maximum(lines.square[shown], 1e-30)) - 20 * np.log10(strongest)
        stems.append(Stems(role, role, tuple(lines.hz[shown].tolist()), tuple(level_db.tolist())))
        loudest = energy[:, shown].max(0)
        heard = shown[loudest > 0]
        if heard.size:
            heard_db = 10 * np.log10(loudest[loudest > 0])
            heard_by = energy[:, heard].argmax(0)
            points.append(
                Points(
                    label=HEARD.format(role),
                    symbol=symbol,
                    x=tuple(lines.hz[heard].tolist()),
                    y=tuple(heard_db.tolist()),
                    roles=tuple(roles[taxel] for taxel in heard_by),
                    only=("draw",),
                )
            )
    turns = " (one at a time)" if plan.scheme.takes_turns else ""
    motion = Panel(
        frequency,
        Scale("motion", "dB of the ON level", FLOOR_DB, 8.0, near=PAGE_DB),
        (curves,),
        lines=tuple(across),
        points=tuple(points),
    )
    pull = Panel(
        frequency,
        Scale("pull", "dB of\nthe strongest", FLOOR_DB, 8.0),
        tuple(stems),
        legend_title=f"{plan.scheme.name}, all on{turns}",
        height=1.0,
        only=("draw",),
    )
    near_hz = frequency.near or (low_hz, high_hz)
    listed = ", ".join(str(c.index) for c in channel_set)
    return Figure(
        title="how the taxels of one coil answer, and what its current asks of them",
        description=f"Responses of {len(channel_set)} channels from {near_hz[0]:.3g} to {near_hz[1]:.3g} hertz; the"
        " table below tells the spurs",
        panels=(motion, pull),
        channels=len(plan.channels),
        label=f"set {which}: channels {listed[:60]}",
        choice="Coils of",
        facts=_spur_table(channel_set, lines, energy, spurs) if spurs else None,
        notes=() if spurs else _why_none(plan, len(channel_set)),
    )


def _spurs(lines: CoilLines) -> list[int]:
    """Return the indices of the first `MOST_LISTED` spurs in the spectrum: harmonics, then sums and differences."""
    spurs = [line for line, kind in enumerate(lines.kinds) if kind != "tone"]
    return sorted(spurs, key=lambda line: (lines.kinds[line] != "harmonic", lines.makers[line]))[:MOST_LISTED]


def _spur_table(channel_set: "Sequence[Channel]", lines: CoilLines, energy: np.ndarray, spurs: Sequence[int]) -> Facts:
    """Return the table of spurs: the channels that make each, its frequency, and the OFF taxel that it moves most."""
    rows = []
    for line in spurs:
        makers = " and ".join(str(channel_set[maker].index) for maker in lines.makers[line])
        loudest = int(energy[:, line].argmax())
        heard = "no third channel hears it"
        if energy[loudest, line] > 0:
            heard_db = f"{10 * np.log10(energy[loudest, line]):.1f}".replace("-", "−")
            heard = f"moves channel {channel_set[loudest].index} at {heard_db} dB"
        rows.append((f"{lines.kinds[line]} of {makers}", f"{lines.hz[line]:.2f} Hz", heard))
    more = " or more" if len(rows) == MOST_LISTED else ""
    return Facts(f"Spurs with all channels on ({len(rows)}{more})", tuple(rows), is_folded=True, is_open=len(rows) <= 4)


def _why_none(plan: "Plan", channels: int) -> tuple[str, ...]:
    if channels < 2:
        return ("A coil of one channel has no neighbours to hear its tone.",)
    if plan.scheme.takes_turns:
        return ("One channel plays at a time, so that there are no spurs.",)
    if plan.scheme.is_root:
        return ("This drive makes no spurs: the current is the root of the wanted pull.",)
    if plan.scheme.force_order == 1:
        return ("This drive makes no spurs: the force goes with the current itself, not with its square.",)
    return (f"Spurs are worked out for up to {MOST_WITH_SPURS} channels of a coil.",)
