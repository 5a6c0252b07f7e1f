"""Spec → Plan: search the layouts, size the beams, place the taxels, judge the result."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice, product
from math import inf
from typing import NamedTuple

import numpy as np

from padgen.core.errors import InfeasibleError, number
from padgen.core.units import decibel
from padgen.physics.selectivity import Scheme
from padgen.planner.capacity import channel_limit, coil_capacity
from padgen.planner.channels import driven, force_constants, plan_channels
from padgen.planner.coil_load import coil_load
from padgen.planner.cures import Cure, varied, with_tried_cures
from padgen.planner.drive_scheme import plan_selectivity
from padgen.planner.frame_rates import frame_rates
from padgen.planner.judge import judge
from padgen.planner.layout import Layout, candidates, coil_reach_mm, room
from padgen.planner.left_out import left_out
from padgen.planner.pitch import pitch_of
from padgen.planner.plan import Cell, Channel, CoilGrid, LayoutOption, Plan, Plate, Taxel, channel_sets
from padgen.planner.printing import print_settings
from padgen.planner.prints import NOT_PRINTED, PADS, on_paper_db, what_prints_keep
from padgen.planner.resonances import planned_optimum
from padgen.planner.reuse import cell_is_turned, coil_reuse
from padgen.planner.search import sites_of, sized_layouts
from padgen.planner.settings import scheme_named, sets_db
from padgen.planner.sizing import SizedChannel
from padgen.planner.taxel_model import plate_shape, post_diameter_mm, recess_mm
from padgen.planner.touch import touched_pads
from padgen.spec import Spec

__all__ = ["Choice", "choose", "finish", "make_plan", "with_cures"]

RUNNERS_UP = 2
REUSES, SCHEMES_TRIED, GAPS_MM = ("same", "alternate"), ("auto", "spur-free", "biased"), (1.0, 0.6, 0.4)
"""Values that the search tries where it is free, the simplest first: a smaller gap asks for flatter coils."""
QUICK_PADS = 200
"""Simulated prints by which layouts are compared."""
NEAREST = 12
"""Layouts that are compared by their prints where none works."""


class Choice(NamedTuple):
    """A layout with its beams, the spec with what the search decided, what limits it, and the next best ones."""

    spec: Spec
    layout: Layout
    channels: tuple[SizedChannel, ...]
    runners_up: tuple[LayoutOption, ...] = ()
    limits: str = ""


def make_plan(spec: Spec) -> Plan:
    """Allot resonances and beams for `spec`.

    Raises
    ------
    InfeasibleError
        No layout holds; the message names the limits of the best candidates and what would do.
    """
    return with_cures(spec, choose(spec))


def with_cures(spec: Spec, choice: Choice) -> Plan:
    """The plan of a `choice` for `spec`, with the cures of its findings that hold."""
    return with_tried_cures(finish(choice), partial(_planned_with, spec, choice))


def _planned_with(spec: Spec, choice: Choice | None, cure: Cure) -> Plan:
    """The plan of `spec` with the fields of `cure`, from few prints; raises as `choose` does, without cures.

    Another level moves no beam of the `choice` that there is. Where there is none, it is the plan of the first layout
    that holds, whether or not its prints work.
    """
    if choice and set(cure) == {"drive.level_um"}:
        return finish(choice._replace(spec=varied(choice.spec, cure)), QUICK_PADS)
    found = _searched(varied(spec, cure), quick=choice is None)
    if found is None:
        raise InfeasibleError("no layout holds", "resolution")
    return finish(found, QUICK_PADS)


def choose(spec: Spec) -> Choice:
    """Search the layouts and size the beams: the fewest coils of which as many prints work as asked, else the best.

    Raises as `make_plan` does.
    """
    choice = _searched(spec)
    if choice is None:
        from padgen.planner.infeasible import refusal

        decided = next(_decided(spec))
        limit = channel_limit(decided)
        raise refusal(decided, candidates(decided, limit), limit, partial(_planned_with, spec, None))
    return choice


def _searched(spec: Spec, quick: bool = False) -> Choice | None:
    found: list[Choice] = []
    known: dict[tuple[str, ...], list[tuple[Layout, tuple[SizedChannel, ...]]]] = {}
    for decided in _decided(spec):
        # Neither the gap nor, but for optimised resonances, the drive changes a beam.
        key = (decided.coil.reuse, decided.drive.scheme if spec.spacing == "optimised" else "")
        if key not in known:
            some = sized_layouts(decided, candidates(decided, channel_limit(decided)))
            known[key] = list(islice(some, None if spec.leaves_layout_free and not quick else 1))
        if quick and known[key]:
            return Choice(decided, *known[key][0])
        found += [Choice(decided, *sized) for sized in known[key]]
    if not found:
        return None
    best = found[0] if len(found) == 1 else _best(found)
    _refuse_unpulled(best)
    limit = channel_limit(best.spec)
    options = candidates(best.spec, limit)
    limits = _what_limits(best.spec, options, best.layout, limit)
    return best._replace(runners_up=_runners_up(best.spec, options, best.layout), limits=limits)


def _refuse_unpulled(choice: Choice) -> None:
    """Raise `InfeasibleError` where a coil does not pull one of its washers, as on a grid with too few coils."""
    spec, sites = choice.spec, sites_of(choice.spec, choice.layout, choice.channels)
    pulls = force_constants(spec, choice.channels, sites)
    far = int(pulls.argmin())
    if pulls[far] <= 0:
        raise InfeasibleError(
            f"the washer of channel {far} lies {number(sites[far].coil_distance_mm)} mm off its coil's axis, where the"
            f" coil does not pull it; beyond {number(coil_reach_mm(spec))} mm the two do not overlap",
            "coil.grid",
        )


def _decided(spec: Spec) -> Iterator[Spec]:
    """`spec` with each reuse, drive and gap that is left to the search, the simplest first."""
    coil, drive = spec.coil, spec.drive
    schemes = SCHEMES_TRIED if spec.leaves_layout_free and drive.scheme == "auto" else (drive.scheme,)
    reuses = REUSES if coil.reuse == "auto" else (coil.reuse,)
    gaps = (coil.gap_mm,) if coil.gap_mm else GAPS_MM
    for reuse, scheme, gap_mm in product(reuses, schemes, gaps):
        yield replace(spec, coil=replace(coil, reuse=reuse, gap_mm=gap_mm), drive=replace(drive, scheme=scheme))


def _best(found: Sequence[Choice]) -> Choice:
    """The first of the fewest coils whose prints work; else that of which prints keep most, of some that may."""
    asked, wanted = decibel(found[0].spec.delta_y), found[0].spec.print_share
    at_most_db = [_at_most_db(choice) for choice in found]
    rank = sorted(range(len(found)), key=lambda k: (found[k].layout.surplus > 0, found[k].layout.coils))
    for k in rank:
        if at_most_db[k] >= asked:
            plan = _assemble(found[k])
            if on_paper_db(plan) >= asked and what_prints_keep(plan, QUICK_PADS).good_share >= wanted:
                return found[k]
    nearest = sorted(rank, key=lambda k: -min(at_most_db[k], asked))[:NEAREST]
    return max((found[k] for k in nearest), key=_prints_keep_db)


def _prints_keep_db(choice: Choice) -> float:
    kept = what_prints_keep(_assemble(choice), QUICK_PADS).print_db
    return inf if kept is None else kept


def _at_most_db(choice: Choice) -> float:
    """A bound of what the choice keeps, by its resonances alone and the quietest drive."""
    hz = np.array([channel.target_hz for channel in choice.channels])
    return sets_db(choice.spec, hz, np.ones(len(hz)), Scheme("time-shared"))


def finish(choice: Choice, pads: int = PADS) -> Plan:
    """The plan of a choice; its channels' beams and models may have been changed since.

    Up to `pads` of its prints are simulated. The cures of its findings are proposals, which nobody has tried.
    """
    bare = _assemble(choice)
    known = replace(bare, left_out=left_out(bare), prints=what_prints_keep(bare, pads))
    return replace(known, findings=judge(known))


def _assemble(choice: Choice) -> Plan:
    spec, layout, sized = choice.spec, choice.layout, choice.channels
    sites = sites_of(spec, layout, sized)
    bare = plan_channels(spec, sized, sites)
    selectivity = plan_selectivity(spec, bare, planned_optimum(spec, layout.channels, room(spec, layout)))
    scheme = scheme_named(spec, selectivity.drive)
    channels = driven(spec, bare, scheme)
    reuse = coil_reuse(spec, layout, channels, scheme)
    pitch_x, pitch_y = spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows
    taxels = _taxels(spec, layout, channels, reuse.turned)
    return Plan(
        name=spec.name,
        spec=spec,
        capacity=coil_capacity(spec, scheme, choice.limits),
        coils=CoilGrid(layout.rows, layout.columns, min(pitch_x, pitch_y), pitch_x, pitch_y, spec.coil.sets),
        cell=Cell(layout.sub_columns, layout.sub_rows, layout.sub_width_mm, layout.sub_depth_mm, layout.beam_axis),
        plate=_plate(spec),
        channels=channels,
        taxels=taxels,
        pitch=pitch_of(taxels),
        selectivity=selectivity,
        load=coil_load(spec, channels, scheme),
        refresh=frame_rates(channels, spec.coil.sets),
        reuse=reuse,
        prints=NOT_PRINTED,
        touched=touched_pads(spec, channels, scheme),
        layouts=choice.runners_up,
        printing=print_settings(spec, [c.beam for c in channels]),
        left_out=(),
        findings=(),
    )


def _plate(spec: Spec) -> Plate:
    shape, taxel = plate_shape(spec), spec.taxel
    diameter, depth = recess_mm(spec)
    return Plate(
        *shape,
        recess_diameter_mm=diameter,
        recess_depth_mm=depth,
        post_diameter_mm=post_diameter_mm(spec),
        boss_diameter_mm=taxel.boss_diameter_mm,
        boss_top_mm=spec.pad.frame_thickness_mm + taxel.boss_protrusion_mm,
        boss_edge_mm=taxel.boss_edge_mm,
        gap_mm=spec.printer.smallest_gap_mm,
    )


def _taxels(spec: Spec, layout: Layout, channels: tuple[Channel, ...], turned: str) -> tuple[Taxel, ...]:
    """All taxels, coil by coil from the first row; surplus places are left out at the last coils."""
    pitch_x, pitch_y = spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows
    full = layout.coils - layout.surplus
    sets = channel_sets(channels, spec.coil.sets)
    taxels = []
    for coil in range(layout.coils):
        row, column = divmod(coil, layout.columns)
        x0 = (column - (layout.columns - 1) / 2) * pitch_x
        y0 = (row - (layout.rows - 1) / 2) * pitch_y
        around = cell_is_turned(turned, row, column)
        sign = -1 if around else 1
        own = sets[(row + column) % len(sets)]
        for k, channel in enumerate(own[: layout.channels - (coil >= full)]):
            x, y = channel.site.washer_mm
            taxels.append(
                Taxel(
                    f"r{row}c{column}k{k}",
                    (row, column),
                    channel.index,
                    round(x0 + sign * x, 6),
                    round(y0 + sign * y, 6),
                    channel.site.coil_distance_mm,
                    around,
                )
            )
    return tuple(taxels)


def _runners_up(spec: Spec, options: list[Layout], chosen: Layout) -> tuple[LayoutOption, ...]:
    """The next layouts that hold as well."""
    others = (sized for sized in sized_layouts(spec, options) if sized[0] is not chosen)
    return tuple(_option(spec, *sized) for sized in islice(others, RUNNERS_UP))


def _option(spec: Spec, layout: Layout, sized: tuple[SizedChannel, ...]) -> LayoutOption:
    taxels = layout.coils * layout.channels - layout.surplus
    kept_db = plan_selectivity(spec, plan_channels(spec, sized, sites_of(spec, layout, sized))).kept_db
    return LayoutOption(layout.rows, layout.columns, layout.channels, taxels, layout.margin_mm, kept_db)


def _what_limits(spec: Spec, options: list[Layout], layout: Layout, limit: int) -> str:
    """Which limit keeps this pad from more channels per coil, and so from fewer coils."""
    if spec.resonances_hz:
        return "resonances_hz"
    if layout.channels >= limit:
        return "band and Q"
    if layout.coils == 1 or spec.coil.grid:
        return "resolution"
    more = [o for o in options if o.channels > layout.channels and o.coils < layout.coils]
    if not more:
        return "resolution"
    nearest = max(more, key=lambda o: o.margin_mm)
    return LIMITS[nearest.binding[0]] if nearest.margin_mm < 0 else "resonances that print"


LIMITS = {
    "coil": "coil diameter",
    "width": "washer in the sub-cell",
    "length": "beam in the sub-cell",
    "reach": "reach of the coil",
}
