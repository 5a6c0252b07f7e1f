"""Spectral lines of a coil's squared current with all its channels on, and the motion of each taxel under each line.

A state plays the lines all of whose makers are ON. Its motion is the sum of what these lines do, its felt level the
root of the sum of their energies, so that figures of all lines are figures of all states.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from padgen.physics.resonator import ModalTaxels, felt_response
from padgen.physics.selectivity import Lines, line_energy, own_lines, pair_lines
from padgen.planner.channels import heard_modes
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.plan import Channel
from padgen.report.figures import packed

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = ["MOST_MOVED", "MOST_WITH_SPURS", "CoilLines", "coil_lines", "line_motion", "motion_data"]

MOST_WITH_SPURS = 64
"""Most channels of a coil whose pairs' spurs are worked out: they grow with the square of the channels."""
MOST_MOVED = 32
"""Most channels of a coil that the page moves by their pairs' spurs, too: these figures grow with the cube."""
REMANENT = "remanent line"
"""Kind of a line by remanence: of the current itself, at half the tone's frequency."""
PHASES = {
    "tones": {"tone": np.pi, REMANENT: -np.pi / 2, "sum": np.pi, "difference": 0.0},
    "biased": {"tone": -np.pi / 2, "harmonic": np.pi, "sum": np.pi, "difference": 0.0},
    "root": {"tone": 0.0},
    "linear": {"tone": -np.pi / 2},
}
"""Phases of the lines of i² as cosines, by kind of current and of line: of the squares of `schemes.FORMULAS`, by
``2 sin a sin b = cos(a − b) − cos(a + b)``."""


class CoilLines(NamedTuple):
    """Spectral lines of one coil's i², all channels on: frequency, its rounding error, squared amplitude (lines,).

    `kinds` are 'tone', 'harmonic', 'sum', 'difference' or `REMANENT`; `makers` have the one or two channels of each, by
    their positions in the coil.
    """

    hz: np.ndarray
    rest: np.ndarray
    square: np.ndarray
    kinds: tuple[str, ...]
    makers: tuple[tuple[int, ...], ...]

    def energy(self, plan: "Plan", channel_set: Sequence[Channel], modes: ModalTaxels) -> np.ndarray:
        """Return the squared felt amplitude (taxels, lines) of each taxel under each line, relative to that when ON."""
        part = Lines(self.hz[None], self.rest[None], self.square[None], ())
        return line_energy(placed_channels(plan.spec, channel_set), part, modes)[:, 0]


def coil_lines(plan: "Plan", channel_set: Sequence[Channel], most_paired: int) -> CoilLines:
    """Return a coil's spectral lines of i²: the channels' tones, their harmonics, then sums and differences of pairs.

    Of more channels than `most_paired` there are no lines of pairs.
    """
    which = placed_channels(plan.spec, channel_set)
    scheme = plan.scheme
    second = "harmonic" if scheme.is_biased else REMANENT
    parts = [(part, ("tone", second)) for part in own_lines(which, scheme)]
    if scheme.has_pair_spurs and 1 < len(channel_set) <= most_paired:
        parts.append((pair_lines(which, scheme), ("sum", "difference")))
    hz = []
    rest = []
    square = []
    kinds: list[str] = []
    makers: list[tuple[int, ...]] = []
    for part, names in parts:
        hz.append(part.hz.ravel())
        rest.append(np.broadcast_to(part.rest[:, None] if part.rest.ndim < 2 else part.rest, part.hz.shape).ravel())
        square.append(np.broadcast_to(part.square, part.hz.shape).ravel())
        made_by = list(zip(*(maker.tolist() for maker in part.makers), strict=True))
        for name in names[: len(part.hz)]:
            kinds += [name] * len(made_by)
            makers += made_by
    return CoilLines(np.concatenate(hz), np.concatenate(rest), np.concatenate(square), tuple(kinds), tuple(makers))


def line_motion(plan: "Plan", channel_set: Sequence[Channel], lines: CoilLines, modes: ModalTaxels) -> np.ndarray:
    """Return the motion z (taxels, lines) in µm of each taxel towards the coil under each line, ``Re z exp(j2πft)``."""
    which = placed_channels(plan.spec, channel_set)
    level_um = np.array([channel.level_um for channel in channel_set])
    phases = PHASES[plan.scheme.kind.CURRENT]
    turned = np.exp(1j * np.array([phases[kind] for kind in lines.kinds]))
    real, imaginary = felt_response(modes, slice(None), lines.hz, lines.rest)
    over = np.sqrt(lines.square) / which.line[:, None]
    return level_um[:, None] * over * (real[:, 0] - 1j * imaginary[:, 0]) * turned


def motion_data(plan: "Plan") -> dict[str, Any]:
    """Return the motion of a coil's taxels under each line of each set of channels, as data for the page.

    Of each set of channels: its lines' `hz` and `makers`, the felt `energy` (taxels, lines), and the motion
    `moved_um` (taxels, lines, real and imaginary part).
    """
    sets = []
    for channel_set in plan.sets:
        lines = coil_lines(plan, channel_set, MOST_MOVED)
        modes = heard_modes(plan.spec, channel_set, placed_channels(plan.spec, channel_set).line)
        moved_um = line_motion(plan, channel_set, lines, modes)
        sets.append(
            {
                "channels": [c.index for c in channel_set],
                "hz": lines.hz.tolist(),
                "makers": lines.makers,
                "energy": packed(lines.energy(plan, channel_set, modes)),
                "moved_um": packed(np.stack([moved_um.real, moved_um.imag], axis=-1)),
                "without_spurs": plan.scheme.has_pair_spurs and len(channel_set) > MOST_MOVED,
            }
        )
    coils = plan.coils
    return {
        "scheme": plan.scheme.name,
        "turns": plan.scheme.takes_turns,
        "sets": sets,
        "set_of_coil": [sum(divmod(k, coils.columns)) % coils.sets for k in range(coils.rows * coils.columns)],
    }
