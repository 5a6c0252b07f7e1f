"""Make the plan of a spec: search layouts, try the values it leaves open, choose by simulated prints, and judge."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from heapq import merge
from itertools import chain, islice, product, starmap, tee
from math import inf, isnan
from operator import attrgetter
from pathlib import Path
from traceback import extract_tb
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import InfeasibleError, SolverError, at_least, number
from padgen.core.registry import SUSPENSIONS
from padgen.core.units import MM, UM, decibel
from padgen.physics.selectivity import SQUARE, Scheme
from padgen.planner.board_layout import board_of
from padgen.planner.channels import driven, force_constants, plan_channels, resting, unpulled
from padgen.planner.core_pull import snaps
from padgen.planner.cures import Cure, named_breakdown, refusal, varied, with_tried_cures
from padgen.planner.drive_scheme import (
    ChosenDrive,
    cell_is_turned,
    chosen_drive,
    coil_demand,
    coil_leakage,
    coil_load,
    fitting_parts,
    frame_contrasts,
    frame_rates,
    is_fed,
    plan_selectivity,
)
from padgen.planner.judge import judge
from padgen.planner.layout import (
    Layout,
    candidates,
    coil_reach_mm,
    pitch_of,
    placed_taxel,
    room,
    roomy_layouts,
    with_fitting_coil,
    with_other_coils,
)
from padgen.planner.left_out import left_out, unbounded_and_included
from padgen.planner.life import keeps_for_life, planned_life
from padgen.planner.limits import exceeded
from padgen.planner.pins import pushed, with_errors
from padgen.planner.plan import (
    NO_LIFE,
    NO_RECOIL,
    NOT_COUNTED,
    NOT_JUDGED,
    NOT_WARM,
    Cell,
    Channel,
    CoilGrid,
    LayoutOption,
    Parts,
    Plan,
    Plate,
    Selectivity,
    Taxel,
    can_play,
    channel_sets,
    level_law,
    non_finite_figures,
    scheme_named,
    worst_set_db,
)
from padgen.planner.printed_pads import NOT_PRINTED, SURELY, compared_prints, design_of, what_prints_keep
from padgen.planner.printing import print_settings
from padgen.planner.pushes import pushed_taxels
from padgen.planner.search import (
    COILS_SIZED,
    SizedLayout,
    UnsizedLayout,
    channel_limit,
    coil_capacity,
    layouts_to_size,
    planned_optimum,
    printed_count,
    sites_of,
    sized_layouts,
    snapping,
)
from padgen.planner.shaken_pad import planned_recoil
from padgen.planner.sizing import SizedChannel
from padgen.planner.taxel_model import plate_shape, post_diameter_mm, recess_mm
from padgen.planner.touch import felt_levels, skin_figures
from padgen.planner.touch_search import TouchTrial, decided_under_touch
from padgen.planner.touched_prints import planned_touch, played_channels, touched_felt, touched_figures
from padgen.planner.verdict import with_verdict
from padgen.planner.warm_pad import planned_warmth
from padgen.spec import Spec
from padgen.spec.model import FOUND_SCHEMES

__all__ = ["Choice", "choose", "finish", "make_plan", "with_cures"]

RUNNERS_UP = 2
REUSES = ("same", "alternate")
SCHEMES_TRIED = ("auto", *FOUND_SCHEMES)
GAPS_MM = (1.0, 0.6, 0.4)
"""Values that the search tries where the spec leaves them free, the simplest first: a small gap needs flat coils."""
MOST_BENT = 2
"""Layouts that are tried again with serpentine beams where straight ones print too unevenly: most of a second each."""
BESIDE_THE_BEAMS = {"mount.kind", "mount.base_mass_g", "printer.bed_x_mm", "printer.bed_y_mm"}
"""Fields that no layout or beam depends on."""
MOST_FOR_CURE = 32
MOST_TAXELS_FOR_CURE = 1024
"""Choices of layout, beams, gap, sets and drive that are tried to find out whether a cure works, and the taxels of all
of them together: one that needs more is not proposed. A plan has no such bound: the one choice that works may come
after hundreds."""
MOST_SURE = 8
"""Choices of which many prints are simulated to find the one that works most often, where none works as often as asked:
those that few prints leave the most hope for."""
NO_HOPE_DB = 0.5
"""A layout that falls short by more than this with a drive, or of which no print works, counts alike with that drive at
its other gaps: a gap moves the selectivity by some hundredths of a decibel."""
MOST_FAR_SHORT = 3
FAR_SHORT_DB = 2.0
"""Layouts of as many channels, of none of which a print works, all this far from it, after which no others are judged:
prints of theirs differ by less than that."""
MOST_JUDGED_FOR_LIFE = 48
MOST_TAXELS_FOR_LIFE = 1 << 13
LESS_FOR_CURE = 4
MOST_ALIKE = 3
"""Layouts that are judged for life after one that works re-tuned only, the taxels of all of them together (so that a
large pad is planned as quickly), by how much fewer for a cure, and layouts of one drive and channel count."""
SAME_FOR_ALL_LAYOUTS = {"plan.bed"}
"""Errors of a plan that follow from the spec alone."""
ALIKE_DB = 0.1
"""Difference of what prints keep below which two choices that work as often, mostly never, keep as much."""
MOST_PRINTED = 16
"""Choices whose prints are simulated where none works as often as asked: those with the highest upper bounds. Without
this bound, 342 instead of 16 choices of one spec are printed, for 0.001 dB (docs/accuracy.md)."""
_grid = attrgetter("rows", "columns", "channels")


class Choice(NamedTuple):
    """A layout with its sized beams, and the spec with every value that the search decided.

    `runners_up` are the next best layouts, `limits` names what prevents more channels per coil.
    """

    spec: Spec
    layout: Layout
    channels: tuple[SizedChannel, ...]
    runners_up: tuple[LayoutOption, ...] = ()
    limits: str = ""


class _Unsized(NamedTuple):
    """A layout for a spec with every value decided, and the call that sizes its beams."""

    spec: Spec
    layout: Layout
    size: Callable[[], SizedLayout | None]

    @classmethod
    def with_decided(
        cls, decided: Spec, sized: Spec, layout: Layout, size: Callable[[], SizedLayout | None]
    ) -> "_Unsized":
        """Return a candidate for the `decided` spec with the coil of the `sized` one, whose drive or gap may differ."""
        coil = replace(sized.coil, reuse=decided.coil.reuse, gap_mm=decided.coil.gap_mm)
        return cls(replace(decided, coil=coil), layout, size)

    @classmethod
    def of(cls, choice: Choice) -> "_Unsized":
        """Return a choice as a candidate whose beams have been sized already."""
        return cls(choice.spec, choice.layout, lambda: (choice.layout, choice.channels))

    def choice(self) -> Choice | None:
        """Return the choice with its beams sized; None where the layout does not work."""
        sized = self.size()
        return None if sized is None else Choice(self.spec, *sized)


BROKEN_DOWN = (ArithmeticError, np.linalg.LinAlgError)


@contextmanager
def strict_arithmetic() -> Iterator[None]:
    """Make computations in a `with` block raise `SolverError` where they divide by zero, overflow or give NaN.

    Code that means to has a `numpy.errstate` of its own, with the reason.
    """
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        try:
            yield
        except BROKEN_DOWN as error:
            our_frames = [frame for frame in extract_tb(error.__traceback__) if ROOT in Path(frame.filename).parents]
            raise SolverError(
                f"leaves the range in which it can be computed ({error} in {our_frames[-1].name} of"
                f" {Path(our_frames[-1].filename).relative_to(ROOT)})",
                "the spec",
            ) from error


ROOT = Path(__file__).parents[1]


def make_plan(spec: Spec, tries_cures: bool = True) -> Plan:
    """Plan the pad of `spec`; with `tries_cures` (a third of the run time) findings name spec changes that were tried.

    Raises
    ------
    InfeasibleError
        No layout works; the message names the limits of the best candidates, and changes that were tried and work.
    """
    try:
        choice = choose(decided_under_touch(spec, _touch_trial))
        return with_cures(spec, choice) if tries_cures else _without_cures(choice)
    except SolverError as error:
        if not isinstance(error.__cause__, BROKEN_DOWN):
            raise
        raise named_breakdown(spec, error, partial(_planned_with, spec, None, quick=False)) from error


@strict_arithmetic()
def with_cures(spec: Spec, choice: Choice) -> Plan:
    """Return the plan of a `choice` for the asked `spec`; its findings suggest only spec changes tried with success."""
    return with_tried_cures(_finite(finish(choice)), partial(_planned_with, spec, choice))


@strict_arithmetic()
def _without_cures(choice: Choice) -> Plan:
    """Return the plan of a `choice`, its findings without suggested spec changes."""
    plan = _finite(finish(choice))
    return with_verdict(plan, tuple(replace(finding, cures=()) for finding in plan.findings))


@strict_arithmetic()
def _planned_with(spec: Spec, choice: Choice | None, cure: Cure, quick: bool = True) -> Plan:
    """Return the plan of the asked `spec` with the changes in `cure` applied; with `quick` judged as `finish` says.

    What the spec leaves open is searched for anew, as it will be for who follows the cure. Where `cure` only changes
    the mount or the printer's bed, the beams of `choice` are kept. Without a `choice`, the plan is that of the first
    layout that works, however its prints come out. Raises `InfeasibleError` without cures.
    """
    if choice and set(cure) <= BESIDE_THE_BEAMS:
        return finish(choice._replace(spec=varied(choice.spec, cure)), quick)
    cured_spec = decided_under_touch(varied(spec, cure), _touch_trial)
    most = min(MOST_FOR_CURE, max(MOST_TAXELS_FOR_CURE // cured_spec.resolution, 1))
    if cured_spec.coil.sizing == "auto":
        most *= COILS_SIZED  # each layout comes with as many coils
    searched = _searched(cured_spec, quick=choice is None, most=most)
    if searched is None:
        raise InfeasibleError("no layout has room for its taxels", "resolution")
    return finish(searched, quick)


@strict_arithmetic()
def choose(spec: Spec) -> Choice:
    """Return the layout and beams that make the asked share of prints work with the fewest coils.

    If there are none, the choice with the most working prints. Raises as `make_plan` does.
    """
    if (choice := _searched(spec)) is not None:
        return choice
    raise refusal(next(_decided_specs(spec)), partial(_planned_with, spec, None))


def _searched(spec: Spec, quick: bool = False, most: int | None = None) -> Choice | None:
    """Return the best layout, or the first if `quick`, with sized beams; None if none fits or the best's movers snap.

    Where at most `most` are tried, the choice is returned without its runners-up.
    """
    ranked: list[Iterator[_Unsized]] = []
    known: dict[tuple[str, ...], Iterator[UnsizedLayout]] = {}
    for decided in _decided_specs(spec):
        # The gap changes no beam, and the drive does only where resonances are optimised for it.
        key = (decided.coil.reuse, decided.drive.scheme if spec.spacing == "optimised" else "")
        if key not in known:
            options = roomy_layouts(decided, channel_limit(decided))
            known[key] = layouts_to_size(decided, options, None if spec.leaves_layout_free else 1)
        known[key], unsized = tee(known[key])
        ranked.append(starmap(partial(_Unsized.with_decided, decided), unsized))
    if quick:
        return next((choice for one in chain(*ranked) if (choice := one.choice())), None)
    # Layouts are sized when it is their turn: those after the first one whose prints work never are.
    merged = merge(*ranked, key=lambda one: one.layout.rank_by_coils)
    sized = islice((choice for one in merged if (choice := one.choice())), most)
    some_found = list(islice(sized, 2))
    if not some_found:
        return None
    if len(some_found) == 1:
        fewest_coils = best = some_found[0]
    else:
        fewest_coils, works = _best(chain(some_found, sized), for_cure=most is not None)
        # The second is in neither list if the first works.
        unjudged = some_found[1:] if fewest_coils is some_found[0] else []
        best = fewest_coils
        if works:
            best = _lasting(fewest_coils, chain(map(_Unsized.of, unjudged), merged), for_cure=most is not None)
    sizing = spec.coil.sizing
    if sizing == "auto":
        best = _with_best_coils(best)
    spec, layout, channels, *_ = best
    sites = sites_of(spec, layout, channels)
    if snaps(resting(spec, channels, sites)):
        return None
    pulls = force_constants(spec, channels, sites)
    far = int(pulls.argmin())
    if pulls[far] <= 0:  # as on a grid with too few coils
        if snapping(spec):
            return None  # the core is why nearer movers are no candidates
        distance_mm = spec.coil.off_axis_mm(sites[far].washer_mm)
        reach_mm = coil_reach_mm(spec)
        up_to = f", but up to {number(reach_mm)} mm" if reach_mm < distance_mm else ""
        raise InfeasibleError(
            f"the {spec.mover.kind} of channel {far} lies {number(distance_mm)} mm off its coil's axis, where the coil"
            f" does not pull it{up_to}; more coils, or wider ones, pull taxels that are nearer to their axes",
            "coil.grid",
        )
    if most:
        return best
    limit = channel_limit(spec)
    any_coil = replace(spec, coil=replace(spec.coil, sizing=sizing))
    others = (option for option in roomy_layouts(any_coil, limit) if _grid(option) != _grid(layout))
    runners_up = tuple(_option(any_coil, *sized) for sized in islice(sized_layouts(any_coil, others), RUNNERS_UP))
    limits = _limiting_name(any_coil, layout, limit)
    if layout.channels < fewest_coils.layout.channels:
        limits = "what prints keep for life"
    return best._replace(runners_up=runners_up, limits=limits)


def _decided_specs(spec: Spec) -> Iterator[Spec]:
    """Yield `spec` with every combination of reuse, drive and gap that it leaves open, the simplest first."""
    coil = spec.coil
    drive = spec.drive
    tries_others = spec.leaves_layout_free and drive.scheme == "auto" and spec.force_order == SQUARE
    schemes = SCHEMES_TRIED if tries_others else (drive.scheme,)
    reuses = REUSES if coil.reuse == "auto" else (coil.reuse,)
    gaps = (coil.gap_mm,) if coil.gap_mm else GAPS_MM
    for reuse, scheme, gap_mm in product(reuses, schemes, gaps):
        if scheme == "auto" or can_play(spec, scheme_named(spec, scheme)):
            yield replace(spec, coil=replace(coil, reuse=reuse, gap_mm=gap_mm), drive=replace(drive, scheme=scheme))


Driven = dict[int, tuple[Choice, tuple[Channel, ...], ChosenDrive]]
"""Choices whose drive has been chosen, by `id`: kept with them, so that no other choice gets the same `id`."""


class ChoiceFigures(NamedTuple):
    """Figures of a choice: a bound of its selectivity in dB, the share of prints that work, and the dB they keep.

    A negative `share` means that no prints were simulated. `unsure_share` is by how much more prints might change it;
    0 where they were simulated.
    """

    at_most_db: float
    share: float = -1.0
    print_db: float = -inf
    unsure_share: float = 0.0


class _Round(NamedTuple):
    """Settings of one pass of the search, in which it judges its candidate layouts.

    Drives that are `known` are not chosen again. Few prints are simulated `for_cure`. Where the pads are all
    `overloaded`, the amplifier's limits count and the coils' do not. With `for_life`, prints must keep what is asked
    for life, too; with `cool`, beams and coils must not get too hot.
    """

    known: Driven
    for_cure: bool
    overloaded: bool
    cool: bool = False
    for_life: bool = False


def _best(
    rank: Iterator[Choice], for_cure: bool, known: Driven | None = None, overloaded: bool = False
) -> tuple[Choice, bool]:
    """Return the first of `rank` with the asked share of working prints, and True; else that with the most, and False.

    In the second case prints of few choices are simulated, `for_cure` none but those of the first round: what is asked
    of a cure is whether it works, not how well. Choices that exceed a limit of the coils count only if all do: then
    again, with `overloaded`; what is `known` of them is not computed again.
    """
    judged_by = _Round(known or {}, for_cure, overloaded)
    tried: list[tuple[Choice, ChoiceFigures]] = []
    works = _first_that_works(rank, judged_by, tried)
    if works is not None:
        return works, True
    if not overloaded and all(one.at_most_db == -inf for _, one in tried):
        return _best((choice for choice, _ in tried), for_cure, judged_by.known, overloaded=True)
    if for_cure:
        return max(tried, key=lambda item: (item[1].share, item[1].print_db, item[1].at_most_db))[0], False
    return _least_short(tried, judged_by), False


def _lasting(works: Choice, later: Iterator[_Unsized], for_cure: bool = False) -> Choice:
    """Return `works` if its prints keep the asked selectivity for life, else the first of `later` whose prints do.

    The others are of the layouts `later` in rank. Where some with a drive and reuse do not last, no others with that
    and as many channels per coil are judged: what a pad loses when its resonances drift depends on how near they are.
    Where none lasts, the first that works without getting too hot is returned, else the one that `works`. Fewer are
    judged `for_cure`. Skin differs so much that under a contact drift counts for little.
    """
    if not works.spec.touch.is_untouched:
        return works
    bare = _assemble(works, *_channels_and_selectivity(works))
    sound = None if _is_too_hot(bare) else works
    if sound and keeps_for_life(bare):
        return works
    today = _Round({}, for_cure=False, overloaded=False, cool=True)
    for_life = today._replace(for_life=True)
    short_lived = [_drive_and_layout(works)]
    most = min(MOST_JUDGED_FOR_LIFE, MOST_TAXELS_FOR_LIFE // works.spec.resolution)
    if for_cure:
        most //= LESS_FOR_CURE
    most = max(most, 1)
    judged = 0
    for one in later:
        kind = _drive_and_layout(one)
        of_this_drive = [other[-1] for other in short_lived if other[:2] == kind[:2]]
        as_dense = sum(layout.channels <= one.layout.channels for layout in of_this_drive)
        if sound and (kind in short_lived or as_dense >= MOST_ALIKE):
            continue
        choice = one.choice()
        if choice is None:
            continue
        asked = choice.spec.print_share
        asked_db = decibel(choice.spec.delta_y)
        tried = _tried(choice, asked_db, asked, for_life)
        if tried.share >= asked and not _has_errors(choice):
            return choice
        # Where a limit is exceeded another gap may do.
        if tried.share < asked and tried.at_most_db > -inf:
            short_lived.append(kind)
            if not sound and _tried(choice, asked_db, asked, today).share >= asked and not _has_errors(choice):
                sound = choice
        judged += 1
        if judged == most:
            break
    return sound or works


def _with_best_coils(first: Choice) -> Choice:
    """Return a choice with the best of its coils, those of `first`, wider and narrower ones.

    Beams are sized anew: movers come to lie nearer to narrow coils.
    """
    others = (_on_the_same_grid(spec, first.layout) for spec in with_other_coils(first.spec, first.layout))
    return max([first, *filter(None, others)], key=_coil_key)


def _coil_key(choice: Choice) -> tuple[bool, bool, bool, float]:
    """Return a sort key of choices that differ in their coils; the best has the largest.

    First come coils whose prints work for life as often as asked, then those whose prints work re-tuned, then those
    whose prints do beyond the coils' limits; of these the coils whose heat is least.
    """
    spec = choice.spec
    asked = spec.print_share
    today = _Round({}, for_cure=False, overloaded=False)

    def works(judged_by: _Round) -> bool:
        return _tried(choice, decibel(spec.delta_y), asked, judged_by).share >= asked

    lasts = works(today._replace(for_life=True))
    works_today = lasts or works(today)
    works_overloaded = works_today or works(today._replace(overloaded=True))
    channels, selectivity = _channels_and_selectivity(choice)
    load = coil_load(spec, channels, scheme_named(spec, selectivity.drive))
    return lasts, works_today, works_overloaded, -load.copper_loss_w


def _on_the_same_grid(spec: Spec, layout: Layout) -> Choice | None:
    """Return the first choice for another `spec` with the grid and channels of `layout`; None if none works."""
    options = (option for option in roomy_layouts(spec, layout.channels) if _grid(option) == _grid(layout))
    sized = next(sized_layouts(spec, options), None)
    return Choice(spec, *sized) if sized else None


def _is_too_hot(bare: Plan) -> bool:
    """Return whether a plan's beams or coils exceed a limit of heat or current once all its taxels are on."""
    coils = bare.coils.rows * bare.coils.columns
    demand = coil_demand(bare.load, coils)._replace(beam_rise_k=planned_warmth(bare).beam_rise_k)
    return any(one.limit.planned == "error" for one in exceeded(bare.spec, demand))


def _drive_and_layout(one: Choice | _Unsized) -> tuple[str, str, Layout]:
    """Return what all gaps of a candidate share: the reuse of frequencies by coils, the drive and the layout."""
    return one.spec.coil.reuse, one.spec.drive.scheme, one.layout


def _has_errors(choice: Choice) -> bool:
    """Return whether the plan of a choice has an error, as by a limit that only whole plans are judged by.

    Not counted is what no layout changes.
    """
    errors = {finding.code for finding in finish(choice, quick=True).findings if finding.level == "error"}
    return not errors <= SAME_FOR_ALL_LAYOUTS


def _first_that_works(
    rank: Iterator[Choice], judged_by: _Round, tried: list[tuple[Choice, ChoiceFigures]]
) -> Choice | None:
    """Return the first choice, of `rank` or then with bent beams, whose prints work; append failed ones to `tried`.

    Pads that were judged for an automatic drive are not judged again for that drive by its name, nor hopeless ones
    (`NO_HOPE_DB`, `MOST_FAR_SHORT`).
    """
    hopeless: dict[tuple[Any, ...], ChoiceFigures] = {}
    judged_pads = set[tuple[Any, ...]]()
    far_short = Counter[tuple[Any, ...]]()
    for choice in chain(rank, _with_bent_beams(tried)):  # those with bent beams once all of `rank` are in `tried`
        asked = decibel(choice.spec.delta_y)
        key = *_drive_and_layout(choice), choice.spec.coil.sides_mm
        kind = (len(choice.channels), choice.spec.suspension.topology, *key[:2])
        if _pad_of(choice, choice.spec.drive.scheme) in judged_pads or far_short[kind] >= MOST_FAR_SHORT:
            continue
        if key in hopeless:
            tried.append((choice, hopeless[key]))
            continue
        one = _tried(choice, asked, choice.spec.print_share, judged_by)
        if one.share >= choice.spec.print_share:
            return choice
        tried.append((choice, one))
        no_print_works = one.share == 0
        if no_print_works or -inf < one.at_most_db < asked - NO_HOPE_DB:
            hopeless[key] = one
        if no_print_works and one.print_db < asked - FAR_SHORT_DB:
            far_short[kind] += 1
        if id(choice) in judged_by.known:
            judged_pads.add(_pad_of(choice, judged_by.known[id(choice)][2].drive))
    return None


def _least_short(tried: list[tuple[Choice, ChoiceFigures]], judged_by: _Round) -> Choice:
    """Return the choice with the most working prints, where none works as often as asked.

    In falling order of their upper bounds: once a bound is below what was found, no print need be simulated. Few prints
    are enough of those that surely work less often than another.
    """
    best = ChoiceFigures(-inf, -inf, -inf)
    compared: list[tuple[int, Choice, ChoiceFigures]] = []
    least = -inf
    surely = max(one.share - one.unsure_share for _, one in tried)
    most_likely = sorted((one.share + one.unsure_share for _, one in tried if one.unsure_share), reverse=True)
    surely = max([surely, *most_likely[MOST_SURE - 1 : MOST_SURE]])
    printed = 0
    for rank, (choice, one) in sorted(enumerate(tried), key=lambda item: -item[1][1].at_most_db):
        if one.at_most_db < least:
            break
        may_be_better = one.share < 0 or (one.unsure_share and one.share + one.unsure_share >= max(surely, best.share))
        if may_be_better and printed < MOST_PRINTED:
            one = _tried(choice, least, max(surely, best.share), judged_by)
            printed += 1
        compared.append((rank, choice, one))
        if (one.share, one.print_db) > (best.share, best.print_db):
            best = one
            asked = decibel(choice.spec.delta_y)
            least = asked if one.at_most_db >= asked else one.print_db
    # Of those that keep as much the first in rank: with the fewest coils.
    alike = [
        (rank, choice)
        for rank, choice, one in compared
        if one.share >= best.share and one.print_db >= best.print_db - ALIKE_DB
    ]
    return min(alike)[1]


def _pad_of(choice: Choice, drive: str) -> tuple[Any, ...]:
    """Return a key of the pad that `choice` makes with `drive`, so that no pad is judged twice."""
    coil = choice.spec.coil
    topology = choice.spec.suspension.topology
    return choice.layout, choice.channels, topology, coil.reuse, coil.gap_mm, coil.sides_mm, drive


def _with_bent_beams(tried: Sequence[tuple[Choice, ChoiceFigures]]) -> Iterator[Choice]:
    """Yield choices with families of bent beams (serpentines), which 'auto' leaves out and which vary less in print.

    They are made of the first of those `tried` that would work if printed exactly.
    """
    near = [choice for choice, one in tried if one.share >= 0][:MOST_BENT]
    for (spec, layout, *_), kind in product(near, SUSPENSIONS.families()):
        if spec.leaves_layout_free and spec.suspension.topology == "auto":
            bent = replace(spec, suspension=replace(spec.suspension, topology=kind))
            if choice := _on_the_same_grid(bent, layout):
                yield choice


def _tried(choice: Choice, least_db: float, least_share: float, judged_by: _Round) -> ChoiceFigures:
    """Judge a choice in steps of rising cost, and stop once it cannot keep `least_db`, or `least_share` of prints.

    The steps are the resonances and the sag alone, then pull and modes, then what prints keep for life and heat if that
    is asked, then leakage, then simulated prints.
    """
    spec = choice.spec
    known = judged_by.known
    hz = np.array([channel.target_hz for channel in choice.channels])
    at_most = worst_set_db(spec, hz, np.ones(len(hz)), Scheme("time-shared"))  # the quietest drive
    if at_most < least_db:
        return ChoiceFigures(at_most)
    if any(channel.model.sag_m >= spec.coil.gap_mm * MM for channel in choice.channels):
        return ChoiceFigures(-inf)
    if id(choice) not in known:
        undriven = _channels_of(choice)
        chosen = chosen_drive(spec, undriven)
        known[id(choice)] = (choice, driven(spec, undriven, scheme_named(spec, chosen.drive)), chosen)
    _, channels, chosen = known[id(choice)]
    meets = any(c.level_um + c.sag_um + c.static_um >= spec.coil.gap_mm * MM / UM for c in channels)
    load = coil_load(spec, channels, scheme_named(spec, chosen.drive))
    if meets or unpulled(channels) or not is_fed(spec, load):
        return ChoiceFigures(-inf)
    if not judged_by.overloaded and any(exceeded(spec, coil_demand(load, choice.layout.coils))):
        return ChoiceFigures(-inf)
    at_most = min(at_most, chosen.kept_db)
    if at_most < least_db:
        return ChoiceFigures(at_most)
    bare = _assemble(choice, channels, _selectivity_of(choice))
    if not spec.touch.is_untouched:
        return _plan_tried_under_touch(bare, judged_by.overloaded)
    if judged_by.for_life and not keeps_for_life(bare):
        return ChoiceFigures(at_most)
    if judged_by.cool and _is_too_hot(bare):
        return ChoiceFigures(-inf)
    paper_db, prints = compared_prints(bare, least_db, least_share, judged_by.for_cure)
    at_most = min(at_most, paper_db)
    if prints is NOT_PRINTED:
        return ChoiceFigures(at_most)
    print_db = inf if prints.print_db is None else prints.print_db
    spread = SURELY * prints.error_share
    unsure = spread if 0 < prints.good_share < least_share - spread else 0.0
    return ChoiceFigures(at_most, prints.good_share, print_db, unsure)


@strict_arithmetic()
def _touch_trial(spec: Spec, felt_db: float) -> TouchTrial:
    """Return selectivity and heat under touch, and the level that puts the weakest channel `felt_db` over threshold."""
    choice = _searched(spec, quick=True)
    if choice is None:
        raise InfeasibleError("no layout has room for its taxels", "resolution")
    bare = _assemble(choice, *_channels_and_selectivity(choice))
    if spec.coil.kind == "board":
        board_of(bare)
    touch = planned_touch(bare, design_of(bare, None), quick=True)
    assert touch is not None, "the spec names a contact"
    bare = replace(bare, touch=touch)
    spec = bare.spec
    load = coil_load(spec, played_channels(bare), bare.scheme)
    level_um = float(at_least(spec.drive.level_um * 10 ** ((felt_db - min(touched_felt(bare).on_db)) / 20)))
    coils = bare.coils.rows * bare.coils.columns
    # Heat goes with the square of what pulls: the current, or its square.
    louder = (level_um / spec.drive.level_um) ** (2 / spec.force_order)
    hotter = louder * UNSURE_HEAT
    load = replace(
        load,
        copper_loss_w=load.copper_loss_w * hotter,
        mean_copper_loss_w=load.mean_copper_loss_w * hotter,
    )
    within = load.reachable_level_um >= level_um and not _is_too_hot(replace(bare, load=load))
    kept_db = -inf if touch.print_db is None else touch.print_db
    return TouchTrial(kept_db, load.mean_copper_loss_w * coils, level_um, within)


UNSURE_HEAT = 1.4
"""Heat by many simulated pads over that by few, which may leave 1.4 dB too little in hand."""


def _plan_tried_under_touch(bare: Plan, overloaded: bool) -> ChoiceFigures:
    """Judge a plan by simulated prints under touch, and its coils by the levels that touch needs."""
    spec = bare.spec
    touch = planned_touch(bare, design_of(bare, None), quick=True)
    assert touch is not None, "the spec names a contact"
    load = coil_load(spec, played_channels(replace(bare, touch=touch)), bare.scheme)
    coils = bare.coils.rows * bare.coils.columns
    if not overloaded and any(exceeded(spec, coil_demand(load, coils))):
        return ChoiceFigures(-inf)
    print_db = inf if touch.print_db is None else touch.print_db
    return ChoiceFigures(print_db, touch.good_share, print_db)


def finish(choice: Choice, quick: bool = False) -> Plan:
    """Return the complete, judged plan of a choice, whose beams and models may have been changed since it was made.

    The cures of its findings are untried proposals. With `quick`, which is for trials, few prints are simulated,
    pins' errors, the capacity, bounds of what is left out and contrasts of frames are not computed, and recoil only
    where the spec says how the pad is held: no finding by which a cure is judged needs more.
    """
    channels, selectivity = _channels_and_selectivity(choice)
    models = [sized.model for sized in choice.channels]
    pins = [pushed(channel.pin, model) for channel, model in zip(channels, models, strict=True)]
    if not quick:
        pins = [with_errors(pin, model) for pin, model in zip(pins, models, strict=True)]
    channels = tuple(replace(channel, pin=pin) for channel, pin in zip(channels, pins, strict=True))
    bare = _assemble(choice, channels, selectivity)
    spec = bare.spec
    touched = tuple(skin_figures(spec, channels, bare.scheme))
    bare = replace(bare, touched=touched)
    design = design_of(bare, None)
    prints = what_prints_keep(bare, design, quick)
    recoil = NO_RECOIL if quick and not spec.mount.is_said else planned_recoil(bare, prints)
    # Not quick for cures either: of few prints and fingers one in ten is known to a decibel.
    if touch := planned_touch(replace(bare, recoil=recoil), design):
        bare = replace(bare, touch=touch)
        bare = replace(bare, load=coil_load(spec, played_channels(bare), bare.scheme), felt=touched_felt(bare))
        bare = replace(bare, touched=touched_figures(bare, design))
    warm = planned_warmth(bare)
    coils = bare.coils.rows * bare.coils.columns
    capacity = NOT_COUNTED
    if not quick:
        asked = bare.selectivity.asked_db, spec.print_share, coils, prints.ratio_spread / 2**0.5
        count = printed_count(spec.band_hz, spec.q_min, level_law(spec), bare.scheme, *asked)
        capacity = replace(coil_capacity(spec, bare.scheme, choice.limits), prints=count)
    if quick:
        effects = unbounded_and_included(bare)
        refresh = frame_rates(channels, spec.coil.sets, spec.force_order)
    else:
        effects = left_out(replace(bare, recoil=recoil, warm=warm))
        refresh = frame_contrasts(channels, spec.coil.sets, selectivity)
    known = replace(
        bare,
        recoil=recoil,
        warm=warm,
        left_out=effects,
        prints=prints,
        life=planned_life(replace(bare, prints=prints), design, quick),
        capacity=capacity,
        parts=fitting_parts(bare),
        refresh=refresh,
    )
    return with_verdict(known, judge(known))


def _finite(plan: Plan) -> Plan:
    """Return `plan`; raise `SolverError` if a figure is NaN, or infinite although the plan has no error."""
    broken = any(finding.level == "error" for finding in plan.findings)  # as where a coil does not pull its washer
    if lost := next(((at, value) for at, value in non_finite_figures(plan) if isnan(value) or not broken), None):
        raise SolverError(f"has no finite value ({lost[1]}), so that the pad cannot be judged", lost[0])
    return plan


def _channels_and_selectivity(choice: Choice) -> tuple[tuple[Channel, ...], Selectivity]:
    """Return the channels of a choice, and the selectivity with the drive that is chosen for them."""
    selectivity = _selectivity_of(choice)
    scheme = scheme_named(choice.spec, selectivity.drive)
    return driven(choice.spec, _channels_of(choice), scheme), selectivity


def _selectivity_of(choice: Choice) -> Selectivity:
    spec, layout, *_ = choice
    return plan_selectivity(spec, _channels_of(choice), planned_optimum(spec, layout.channels, room(spec, layout)))


def _channels_of(choice: Choice) -> tuple[Channel, ...]:
    """Return the channels of a choice without what depends on the drive."""
    spec, layout, sized, *_ = choice
    return plan_channels(spec, sized, sites_of(spec, layout, sized))


def _assemble(choice: Choice, channels: tuple[Channel, ...], selectivity: Selectivity) -> Plan:
    """Return a choice's plan with only the figures that candidates are compared by; `finish` adds the rest."""
    spec = choice.spec
    layout = choice.layout
    scheme = scheme_named(choice.spec, selectivity.drive, channels)
    reuse = coil_leakage(spec, layout, channels, scheme)
    pitch_x = spec.pad.width_mm / layout.columns
    pitch_y = spec.pad.depth_mm / layout.rows
    coils = CoilGrid(layout.rows, layout.columns, min(pitch_x, pitch_y), pitch_x, pitch_y, spec.coil.sets)
    taxels = _taxels(layout, coils, channels, reuse.turned)
    return Plan(
        name=spec.name,
        verdict=NOT_JUDGED,
        spec=spec,
        capacity=NOT_COUNTED,
        coils=coils,
        cell=Cell(layout.sub_columns, layout.sub_rows, layout.sub_width_mm, layout.sub_depth_mm, layout.beam_axis),
        plate=Plate(
            *plate_shape(spec),
            *recess_mm(spec),
            post_diameter_mm=post_diameter_mm(spec),
            boss_diameter_mm=spec.contact_diameter_mm,
            boss_top_mm=spec.taxel.plate_thickness_mm if spec.pin_share is not None else spec.contact_top_mm,
            boss_edge_mm=spec.contact_edge_mm,
            gap_mm=spec.printer.smallest_gap_mm,
        ),
        channels=channels,
        taxels=taxels,
        pitch=pitch_of(taxels),
        selectivity=selectivity,
        load=coil_load(spec, channels, scheme),
        refresh=(),
        reuse=reuse,
        prints=NOT_PRINTED,
        touched=(),
        layouts=choice.runners_up,
        printing=print_settings(spec, [c.beam for c in channels]),
        left_out=(),
        findings=(),
        parts=Parts({}, ()),
        pushed=pushed_taxels(spec, channels),
        recoil=NO_RECOIL,
        warm=NOT_WARM,
        life=NO_LIFE,
        felt=felt_levels(spec, channels, scheme),
    )


def _taxels(layout: Layout, coils: CoilGrid, channels: tuple[Channel, ...], turned: str) -> tuple[Taxel, ...]:
    """Return all taxels, coil by coil from the first row; any surplus sub-cells stay empty, one over each last coil."""
    sets = channel_sets(channels, coils.sets)
    full = layout.coils - layout.surplus
    taxels = []
    for index in range(layout.coils):
        coil = row, column = divmod(index, layout.columns)
        coil_set = sets[(row + column) % len(sets)][: layout.channels - (index >= full)]
        around = cell_is_turned(turned, row, column)
        taxels += [placed_taxel(coils, coil, k, channel, around) for k, channel in enumerate(coil_set)]
    return tuple(taxels)


def _option(spec: Spec, layout: Layout, sized: tuple[SizedChannel, ...]) -> LayoutOption:
    spec = with_fitting_coil(spec, layout)
    kept_db = plan_selectivity(spec, plan_channels(spec, sized, sites_of(spec, layout, sized))).kept_db
    return LayoutOption(*_grid(layout), layout.coils * layout.channels - layout.surplus, layout.margin_mm, kept_db)


def _limiting_name(spec: Spec, layout: Layout, limit: int) -> str:
    """Name the limit that keeps this pad from more channels per coil, and so from fewer coils."""
    if spec.resonances_hz:
        return "the listed resonances_hz"
    if layout.channels >= limit:
        return "band and Q"
    if spec.coil.grid and layout.coils > 1:
        return "coil.grid"
    more = [o for o in candidates(spec, limit) if o.channels > layout.channels and o.coils < layout.coils]
    if not more:
        return "the number of taxels asked for (resolution)"
    nearest = max(more, key=lambda o: o.margin_mm)
    return LIMITS[nearest.binding[0]] if nearest.margin_mm < 0 else "resonances that print"


LIMITS = {
    "coil": "coil diameter",
    "width": "washer in the sub-cell",
    "length": "beam in the sub-cell",
    "reach": "reach of the coil",
}
