"""Make the findings about taxels' other modes: the line of the drive that each lies on, and changes that avoid it."""

from collections.abc import Iterator, Sequence
from itertools import islice
from math import inf
from typing import NamedTuple

import numpy as np

from padgen.core.errors import SpecError, number
from padgen.core.finding import Finding
from padgen.physics.ladder import slot_half_width
from padgen.physics.modal import ModalTaxels, felt_energy
from padgen.physics.schemes import simplest_first
from padgen.physics.selectivity import Channels, Scheme, all_states, scheme_lines
from padgen.planner.cures import Cure, varied
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.plan import Channel, Plan, channel_sets
from padgen.planner.pull_modes import MODES_DB, coil_modes, mode_names, modes_in_slots
from padgen.planner.settings import scheme_named
from padgen.planner.suspensions import allowed
from padgen.spec import Spec

__all__ = ["Crowd", "crowds", "judge_modes"]

KEPT_DB = 0.05
"""Loss of selectivity in dB that a cure may cause."""
MOST_TRIED = 14
MOVES = (0.95, 1.05, 0.9, 1.1)
LENGTHS, LAYERS = (0.85, 1.15, 0.7), (1, -1, 2)
"""Cures that are tried: factors of a resonance (`MOVES`) and of beam lengths, and layers added to the thickness."""


class Crowd(NamedTuple):
    """A mode of a channel's taxel close to a line of the drive.

    The line, described by `line`, moves the taxel when OFF by `planned` of its ON amplitude, all modes counted, and by
    `at_peak` if this mode's peak lay on the line. `costs_db` is the all-state selectivity that the mode costs, 0 where
    that was not computed.
    """

    channel: int
    mode: int
    hz: float
    line_hz: float
    line: str
    at_peak: float
    planned: float
    is_spur: bool
    costs_db: float = 0.0


class _Lines(NamedTuple):
    """All lines (l,) of i² that a coil's drive can make, in the unit of `Channels.line`.

    `first` and `second` are the channels that make a line (the same one for a tone), `kind` is its index in `KINDS`.
    """

    hz: np.ndarray
    amplitude: np.ndarray
    first: np.ndarray
    second: np.ndarray
    kind: np.ndarray


KINDS = (
    "the tone of channel {0}",
    "twice the tone of channel {0}",
    "the sum spur of {0} and {1}",
    "the difference spur of {0} and {1}",
)


def crowds(spec: Spec, channels: Sequence[Channel], scheme: Scheme) -> list[Crowd]:
    """Return the modes that may spoil the selectivity, each with the line of the drive that moves it most.

    These are modes within half a slot of a line that could move the taxel, when OFF, by more than 1/Δy of its ON
    amplitude, and modes that cost more than `MODES_DB`.
    """
    found = list[Crowd]()
    for own in channel_sets(channels, spec.coil.sets) if len(channels) > spec.coil.sets else ():
        taxels, modes = placed_channels(spec, own), coil_modes(spec, own)
        lines = _lines(taxels, scheme)
        near = {(crowd.channel, crowd.mode): crowd for crowd in _near(spec, own, taxels, modes, lines)}
        costly = {(crowd.channel, crowd.mode): crowd for crowd in _costly(own, taxels, modes, lines, scheme)}
        found += (near | costly).values()
    return found


def _lines(taxels: Channels, scheme: Scheme) -> _Lines:
    parts = [
        (hz, np.sqrt(square), made.makers[0], made.makers[-1], np.full(len(hz), first_kind + k))
        for made, first_kind in zip(scheme_lines(taxels, scheme), (0, 2), strict=False)
        for k, (hz, square) in enumerate(zip(made.hz, np.broadcast_to(made.square, made.hz.shape), strict=True))
    ]
    return _Lines(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _near(spec: Spec, own: Sequence[Channel], taxels: Channels, modes: ModalTaxels, lines: _Lines) -> Iterator[Crowd]:
    half = slot_half_width(spec.q_min, spec.delta_y)
    order = np.argsort(lines.hz)
    ascending = lines.hz[order]
    for i, channel in enumerate(own):
        for k in _others(channel):
            hz = channel.modes_hz[k]
            ends = np.searchsorted(ascending, (hz / (1 + half), hz / (1 - half) if half < 1 else inf))
            some = order[ends[0] : ends[1]]
            some = some[(lines.first[some] != i) & (lines.second[some] != i)]
            if len(some):
                line = int(some[lines.amplitude[some].argmax()])
                crowd = _crowd(own, taxels, modes, lines, (i, k, line))
                if crowd.at_peak > 1 / spec.delta_y:
                    yield crowd


def _costly(
    own: Sequence[Channel], taxels: Channels, modes: ModalTaxels, lines: _Lines, scheme: Scheme
) -> Iterator[Crowd]:
    """Yield the modes of the worst OFF taxel that cost the coil more than `MODES_DB` each."""
    kept = all_states(taxels, scheme, modes)
    if all_states(taxels, scheme).db - kept.db <= MODES_DB:
        return
    channel = own[kept.off]
    for k in _others(channel):
        gain = modes.gain.copy()
        gain[kept.off, k] = 0.0
        costs_db = all_states(taxels, scheme, modes._replace(gain=gain)).db - kept.db
        if costs_db > MODES_DB:
            heard = felt_energy(_single_mode(modes, kept.off, k), slice(None), lines.hz)[0] * lines.amplitude**2
            heard *= (lines.first != kept.off) & (lines.second != kept.off)
            yield _crowd(own, taxels, modes, lines, (kept.off, k, int(heard.argmax())))._replace(costs_db=costs_db)


def _others(channel: Channel) -> list[int]:
    working = int(np.argmax(channel.mode_shares))
    return [k for k in range(len(channel.modes_hz)) if k != working]


def _single_mode(modes: ModalTaxels, i: int, k: int) -> ModalTaxels:
    return ModalTaxels(modes.frequency_hz[[i]][:, [k]], modes.q[[i]], modes.gain[[i]][:, [k]], modes.left_out[[i]])


def _crowd(
    own: Sequence[Channel], taxels: Channels, modes: ModalTaxels, lines: _Lines, at: tuple[int, int, int]
) -> Crowd:
    """Return the `Crowd` for the indices `at` of taxel, mode and line."""
    i, k, line = at
    ratio = float(lines.amplitude[line] / taxels.line[i])
    hz, line_hz = own[i].modes_hz[k], float(lines.hz[line])
    makers = own[lines.first[line]].index, own[lines.second[line]].index
    return Crowd(
        own[i].index,
        k,
        hz,
        line_hz,
        KINDS[lines.kind[line]].format(*makers),
        ratio * float(np.sqrt(felt_energy(_single_mode(modes, i, k), slice(None), np.array([hz]))[0, 0])),
        ratio * float(np.sqrt(felt_energy(modes, slice(i, i + 1), np.array([line_hz]))[0, 0])),
        bool(lines.kind[line]),
    )


def judge_modes(plan: Plan) -> Iterator[Finding]:
    """Yield findings about modes close to lines of the drive, and about the selectivity that all modes cost."""
    spec = plan.spec
    found = crowds(spec, plan.channels, plan.scheme)
    cures = tuple(_cures(plan, found)) if found else ()
    yield from _unexcited(plan, found)
    for crowd in found:
        name = mode_names(spec, plan.channels[crowd.channel])[crowd.mode]
        cost = f", and costs {crowd.costs_db:.1f} dB, at most {number(MODES_DB)}" if crowd.costs_db else ""
        yield Finding(
            "warning",
            "modes.crowded",
            f"channel {crowd.channel}",
            f"its {name} mode at {number(crowd.hz)} Hz lies near {crowd.line} ({number(crowd.line_hz)} Hz), which moves"
            f" the taxel, when OFF, by {crowd.planned:.2g} of its ON amplitude, and by {crowd.at_peak:.2g} if a print"
            f" brings the two together, at most {number(1 / spec.delta_y)}{cost}",
            cures,
        )
    figures = plan.selectivity
    if (figures.modes_cost_db or 0.0) > MODES_DB and figures.placed_all_states_db is not None:
        worst = max(found, key=lambda crowd: crowd.costs_db, default=None)
        most = ""
        if worst and worst.costs_db:
            name = mode_names(spec, plan.channels[worst.channel])[worst.mode]
            most = f", {worst.costs_db:.1f} dB of it by the {name} mode of channel {worst.channel}"
        yield Finding(
            "warning",
            "selectivity.modes",
            "coil",
            "the taxels' other modes, which a pull off the washers' centres excites, cost"
            f" {figures.modes_cost_db:.1f} dB in all states{most}: {figures.placed_all_states_db:.1f} dB are left, at"
            f" most {number(MODES_DB)} dB should be lost",
            cures,
        )


def _unexcited(plan: Plan, found: Sequence[Crowd]) -> Iterator[Finding]:
    loud = {(crowd.channel, crowd.hz) for crowd in found}
    silent = [(c, other) for c, other in modes_in_slots(plan) if (c.index, c.second_mode_hz) not in loud]
    if silent:
        listed = ", ".join(f"{c.index} at {number(c.second_mode_hz)} Hz on {o.index}" for c, o in silent)
        yield Finding(
            "note",
            "modes.near",
            "channels " + ", ".join(str(index) for index in dict.fromkeys(c.index for c, _ in silent)),
            f"a second mode lies in another channel's slot ({listed}); the coil's pull excites it too little to pass"
            f" {number(1 / plan.spec.delta_y)} of the ON amplitude, a washer glued off its place would excite it more",
        )


def _cures(plan: Plan, found: Sequence[Crowd]) -> Iterator[Cure]:
    """Yield the first cure that leaves no crowded mode on the same coils and loses at most `KEPT_DB` of selectivity."""
    least = min(plan.selectivity.kept_db or 0.0, plan.selectivity.asked_db) - KEPT_DB
    for cure in islice(_changes(plan, found), MOST_TRIED):
        try:
            changed = varied(plan.spec, cure)
        except SpecError:
            continue
        again = _planned_again(plan, changed)
        if again and again.kept_db >= least and not crowds(changed, again.channels, again.scheme):
            yield cure
            return


class _Again(NamedTuple):
    """Channels planned for a changed spec, their drive scheme, and the selectivity that it keeps."""

    channels: tuple[Channel, ...]
    scheme: Scheme
    kept_db: float


def _planned_again(plan: Plan, varied: Spec) -> _Again | None:
    """Plan the channels of a `varied` spec; None where it has no layout on the same coils with as many channels."""
    from padgen.planner.capacity import channel_limit
    from padgen.planner.channels import force_constants, plan_channels
    from padgen.planner.drive_scheme import plan_selectivity
    from padgen.planner.layout import candidates
    from padgen.planner.search import sites_of, sized_layouts

    sized = next(sized_layouts(varied, candidates(varied, channel_limit(varied))), None)
    if sized is None:
        return None
    layout, beams = sized
    if (layout.rows, layout.columns, layout.channels) != (plan.coils.rows, plan.coils.columns, len(plan.sets[0])):
        return None
    sites = sites_of(varied, layout, beams)
    if (force_constants(varied, beams, sites) <= 0).any():
        return None
    channels = plan_channels(varied, beams, sites)
    figures = plan_selectivity(varied, channels)
    kept_db = inf if figures.kept_db is None else figures.kept_db
    return _Again(channels, scheme_named(varied, figures.drive), kept_db)


def _changes(plan: Plan, found: Sequence[Crowd]) -> Iterator[Cure]:
    """Yield changes of the spec that move modes or lines, the smallest changes first."""
    spec, channels = plan.spec, plan.channels
    if any(crowd.is_spur for crowd in found):
        for name in reversed(simplest_first()):
            if name != plan.selectivity.drive and not Scheme(name).takes_turns:
                yield {"drive.scheme": name}
    if len(dict.fromkeys(crowd.channel for crowd in found)) == 1:
        for factor in MOVES:
            yield {
                "resonances_hz": [
                    float(f"{c.target_hz * (factor if c.index == found[0].channel else 1):.4g}") for c in channels
                ]
            }
    if spec.spacing == "optimised" and not spec.resonances_hz:
        return  # other suspensions would each need a new, slow search for the optimum
    for name in allowed("auto"):
        if {c.beam.topology for c in channels} != {name}:
            yield {"suspension.topology": name}
    if len({c.beam.thickness_mm for c in channels}) == 1:
        for layers in LAYERS:
            thickness = round(channels[0].beam.thickness_mm + layers * spec.printer.layer_mm, 6)
            if thickness >= spec.printer.first_layer_mm:
                yield {"suspension.thickness_mm": thickness}
    for factor in LENGTHS:
        yield {"suspension.length_mm": round(max(c.beam.length_mm for c in channels) * factor, 1)}
