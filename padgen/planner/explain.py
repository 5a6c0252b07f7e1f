"""Explain a plan: the limits that keep a coil from more channels, and the gain by each change of the spec."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from math import pi
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import PadgenError, SpecError, as_lines, number
from padgen.core.registry import SUSPENSIONS
from padgen.core.units import decibel
from padgen.physics.ladder import LevelLaw
from padgen.physics.schemes import in_order
from padgen.physics.selectivity import Scheme
from padgen.planner.channels import plan_channels, unpulled
from padgen.planner.cures import Cure, other_shapes, varied
from padgen.planner.drive_scheme import plan_selectivity
from padgen.planner.layout import SLACK_MM, binding_limit_text, candidates, roomy_layouts
from padgen.planner.make import make_plan
from padgen.planner.plan import Plan, Selectivity, level_law, scheme_named
from padgen.planner.printed_pads import STAGES, design_of, detuning_sigmas, simulated_prints, spreads_of
from padgen.planner.search import (
    channel_limit,
    coil_capacity,
    largest_counts,
    most_channels_tried,
    printed_count,
    sites_of,
    sized_layouts,
)
from padgen.planner.thresholds import SENSATION
from padgen.spec import Spec, catalogue

__all__ = ["CapacityRow", "Change", "Explanation", "MoverRow", "explain_plan"]

MOST_TRIED = 12
"""Most channels per coil that are tried with a change."""
OPTIMISED_TRIED = 8
"""Most channels per coil for which optimised resonances are tried."""
MOST_IN_BAND = 20
"""Most channels that are counted in the band, as if there were room for all."""
PATIENCE = 2
"""Counts of channels that fail in a row before larger ones are no longer tried."""
WORTH_DB = 0.1
WORTH_SHARE = 0.01
COSTS = ("a line of the spec", "another print", "other parts", "another pad")
ANOTHER_PRINT = 1
OTHER_PARTS = 2


@dataclass(frozen=True, slots=True)
class CapacityRow:
    """The most channels that one coil can have in the band, spaced geometrically, for a drive scheme and level law."""

    scheme: str
    level_law: float | str
    one_hot: int
    all_states: int
    searched_to: int


@dataclass(frozen=True, slots=True)
class Change:
    """A change of the spec that was planned: the lines to write into its file, the cost (one of `COSTS`), and the gain.

    With the change the pad has `coils` coils of `channels` channels each, driven by the scheme `drive`: the layout that
    `padgen plan` then finds. `good_share` of its re-tuned prints keep what is asked, `life_share` of them for life
    (`Life`), and the asked share of them keep `print_db` (None where a coil has one channel). `gained_db` is added to
    the selectivity in all on/off states of a perfect print. In the band, if there were room for all, a coil would have
    `gained_in_band` more channels that keep what is asked (0 where no more are counted).
    """

    change: str
    cost: str
    coils: int
    channels: int
    drive: str
    good_share: float
    life_share: float
    print_db: float | None
    gained_db: float | None
    gained_in_band: int


@dataclass(frozen=True, slots=True)
class MoverRow:
    """Figures of the pad planned anew with one mover and its catalogue coil: coils, heat, what prints keep.

    The layout is searched anew. `heat_w` and `peak_v` are with all taxels on, `outputs` what feeds the coils. Where no
    pad can be planned `why` says so and all figures are None.
    """

    mover: str
    coil: str
    coils: int | None = None
    channels: int | None = None
    heat_w: float | None = None
    peak_v: float | None = None
    print_db: float | None = None
    good_share: float | None = None
    outputs: str = ""
    why: str = ""


@dataclass(frozen=True, slots=True)
class Explanation:
    """The limits of a plan's coils, and the changes that would help.

    `layout` are the plan's coils and the channels of each. On this grid, perfect prints of `channels` per coil, driven
    by the scheme `drive`, keep the asked selectivity; `limits` say what stops one more. `good_share`, `life_share` and
    `print_db` are of the plan's prints, as in `Change`; all are None where the plan has errors, the last also where a
    coil has one channel. `channel_shares` (n,) are the shares of the prints in which a taxel of each channel is good.
    `stage_channels` are the channels per coil that prints would keep in the band at each of
    `padgen.planner.printed_pads.STAGES`, the last one `Capacity.prints`.
    """

    layout: tuple[int, int]
    channels: int
    drive: str
    limits: tuple[str, ...]
    changes: tuple[Change, ...]
    capacities: tuple[CapacityRow, ...]
    channel_shares: tuple[float, ...]
    good_share: float | None
    life_share: float | None
    print_db: float | None
    stage_channels: tuple[int, ...]
    movers: tuple[MoverRow, ...] = ()


MOVERS_COMPARED: tuple[tuple[str, str, str], ...] = (
    ("washer", "iso7092-m1.6", "paper"),
    ("magnet", "disc-2x1", "air-10"),
    ("magnet", "disc-3x1", "air-10"),
    ("magnet", "disc-3x2", "air-10"),
)
"""Kind, part and coil of the movers that are ranked for a pad."""


def _movers(spec: Spec) -> list[MoverRow]:
    """Return a row for each of `MOVERS_COMPARED`: first those with enough good prints, each group by rising heat.

    Movers with which no pad can be planned come last.
    """
    rows = [_with_mover(spec, *each) for each in MOVERS_COMPARED]
    works = spec.print_share
    return sorted(rows, key=lambda row: (row.heat_w is None, (row.good_share or 0.0) < works, row.heat_w or 0.0))


def _with_mover(spec: Spec, kind: str, part: str, coil: str) -> MoverRow:
    """Return the figures of the pad planned anew with a mover and a coil, or why no such pad can be planned."""
    change: Cure = dict.fromkeys(("washer", "magnet", "mover", "resonances_hz")) | {kind: part, "coil": coil}
    if (spec.drive.scheme, kind) != ("linear", "magnet"):
        change["drive.scheme"] = "auto"
    try:
        plan = make_plan(varied(spec, change), tries_cures=False)
    except PadgenError as error:
        return MoverRow(f"{kind} {part}", coil, why=str(error))
    coils = plan.coils.rows * plan.coils.columns
    prints = plan.retuned_prints
    return MoverRow(
        mover=f"{kind} {part}",
        coil=coil,
        coils=coils,
        channels=len(plan.channels) // plan.coils.sets,
        heat_w=plan.heat_w,
        peak_v=plan.load.voltage_peak_v,
        print_db=prints.print_db,
        good_share=prints.good_share,
        outputs="DC" if plan.scheme.has_constant else "AC or DC",
    )


def explain_plan(
    plan: Plan, asked: Spec | None = None, progress: Callable[[str], None] = lambda step: None
) -> Explanation:
    """Find the limits of `plan`, plan changes of the `asked` spec anew, and other movers on grids of their own.

    What `asked` leaves open is searched for with every change, as by who writes it into the file. Without `asked`, what
    the plan's search decided stays.
    """
    spec = plan.spec
    asked = asked or spec
    grid = (plan.coils.rows, plan.coils.columns)
    progress("what stops one more channel")
    held, drive = _channels_held(spec, grid, min(len(plan.sets[0]), MOST_TRIED))
    now = _printed(plan)
    design = design_of(plan, None)
    spreads = spreads_of(spec)
    good = simulated_prints(design, spreads, plan.prints.pads, 0, STAGES[-1:]).good_prints[0]
    shares = np.bincount(design.channel, good) / np.bincount(design.channel) / plan.prints.pads
    coils = plan.coils.rows * plan.coils.columns
    of_prints = plan.selectivity.asked_db, spec.print_share, coils
    stages = [
        printed_count(spec.band_hz, spec.q_min, level_law(spec), plan.scheme, *of_prints, 0.0, missed)
        for missed in detuning_sigmas(design, spreads)[:-1]
    ]
    return Explanation(
        layout=(coils, len(plan.sets[0])),
        channels=held,
        drive=drive,
        limits=tuple(_limits(plan, held, drive)),
        changes=_changes_that_help(plan, asked, progress),
        capacities=tuple(_capacities(spec)),
        channel_shares=tuple(shares.tolist()),
        good_share=now.good_share,
        life_share=now.life_share,
        print_db=now.kept_db,
        stage_channels=(*stages, plan.capacity.prints),
        movers=tuple(_movers(asked)),
    )


def _changes_that_help(plan: Plan, asked: Spec, progress: Callable[[str], None]) -> tuple[Change, ...]:
    """Plan the `asked` spec with each of `_changes`, and return those that are better in some way, the best first."""
    in_band = _channels_in_band(plan.spec)
    now = _printed(plan)
    now_db = plan.selectivity.kept_db
    coils = plan.coils.rows * plan.coils.columns
    changes = []
    for cost, cure in _changes(plan, asked):
        progress(as_lines(cure))
        try:
            again = make_plan(varied(asked, cure), tries_cures=False)
        except PadgenError:
            continue  # no pad can be planned with this change
        prints = _printed(again)
        if prints.good_share is None or prints.life_share is None:
            continue
        if (again.coils.rows, again.coils.columns) != (plan.coils.rows, plan.coils.columns):
            cost = max(cost, OTHER_PARTS)
        if not _is_same_print(plan, again):
            cost = max(cost, ANOTHER_PRINT)
        after_db = again.selectivity.kept_db
        change = Change(
            change=as_lines(cure),
            cost=COSTS[cost],
            coils=again.coils.rows * again.coils.columns,
            channels=len(again.sets[0]),
            drive=again.selectivity.drive,
            good_share=prints.good_share,
            life_share=prints.life_share,
            print_db=prints.kept_db,
            gained_db=after_db - now_db if after_db is not None and now_db is not None else None,
            gained_in_band=0 if in_band >= MOST_IN_BAND else _channels_in_band(again.spec) - in_band,
        )
        if _helps(change, now, coils, plan.spec.print_share):
            changes.append(change)
    return tuple(sorted(changes, key=lambda change: _rank(change, plan.spec.print_share)))


def _helps(change: Change, now: "_Printed", coils: int, asked: float) -> bool:
    """Return whether a change makes more prints good, today or for life, or else is no worse and better in some way.

    `now` are figures of the plan as it is, with so many `coils`; beyond the `asked` share no more prints need be good.
    """
    today = now.good_share or 0.0
    for_life = now.life_share or 0.0
    if change.good_share - today > WORTH_SHARE or change.life_share - for_life > WORTH_SHARE:
        return True
    if change.good_share < min(asked, today) or change.life_share < min(asked, for_life) or change.coils > coils:
        return False
    more_db = change.gained_db or 0.0
    if change.print_db is not None and now.kept_db is not None:
        more_db = change.print_db - now.kept_db
    return change.coils < coils or change.gained_in_band > 0 or more_db > WORTH_DB


def _rank(change: Change, asked: float) -> tuple[float, ...]:
    """Return the sort key of a change: share of good prints (capped at `asked`), dB kept, share of good ones for life.

    Changes that are alike in this go by the coils that they need, the channels that they buy, then by their cost.
    """
    share = change.good_share
    print_db = change.print_db or 0.0
    short_db = -print_db if share < asked else 0.0
    bought = change.coils, -change.gained_in_band, COSTS.index(change.cost)
    return -min(share, asked), short_db, -min(change.life_share, asked), *bought, -print_db


def _channels_in_band(spec: Spec) -> int:
    """Return the most channels that band, Q and drive allow, ignoring room; 'auto' counts as a scheme without spurs."""
    law = level_law(spec)
    asked_db = decibel(spec.delta_y)
    return largest_counts(spec.band_hz, spec.q_min, law, _spurless(spec), asked_db, MOST_IN_BAND)[0]


def _spurless(spec: Spec) -> Scheme:
    """Return the scheme that a spec asks for; where it leaves it open, the one that makes no spurs."""
    if spec.drive.scheme != "auto":
        return scheme_named(spec, spec.drive.scheme)
    return scheme_named(spec, "linear" if spec.force_order == 1 else "spur-free")


def _capacities(spec: Spec) -> Iterator[CapacityRow]:
    laws: list[tuple[float | str, LevelLaw]] = [(p, LevelLaw(p)) for p in (0.0, 1.0, 2.0)]
    if level_law(spec).curve_hz:
        laws.append(("threshold" if spec.drive.threshold_hz else SENSATION, level_law(spec)))
    for scheme, (key, law) in product((scheme_named(spec, name) for name in in_order(spec.force_order)), laws):
        states, one_hot = largest_counts(spec.band_hz, spec.q_min, law, scheme, decibel(spec.delta_y))
        yield CapacityRow(scheme.name, key, one_hot, states, most_channels_tried(scheme))


def _channels_held(spec: Spec, grid: tuple[int, int], least: int) -> tuple[int, str]:
    """Return the most channels per coil on `grid` that fit, print, and keep the asked all-state selectivity.

    The second result is their drive scheme. Counts up to `least` are tried, larger ones until `PATIENCE` in a row fail;
    optimised resonances only for `least`.
    """
    held = 0
    drive = spec.drive.scheme
    failed = 0
    for count in range(1, MOST_TRIED + 1):
        figures = _figures(spec, grid, count, count == least <= OPTIMISED_TRIED)
        failed += 1
        if figures and (figures.kept_db is None or figures.kept_db >= figures.asked_db):
            held = count
            drive = figures.drive
            failed = 0
        if failed >= PATIENCE and count >= least:
            break
    return held, drive


def _figures(spec: Spec, grid: tuple[int, int], count: int, optimise: bool = False) -> Selectivity | None:
    """Return the selectivity of `count` channels per coil on `grid`; None where they cannot be made.

    They cannot if they have no room, do not print, or have a washer that its coil does not pull. Without `optimise`,
    evenly spread resonances stand in for optimised ones, whose search takes long.
    """
    try:
        other = _with_grid(spec, grid, count, optimise)
        layout, beams = next(sized_layouts(other, roomy_layouts(other, channel_limit(other))))
    except (SpecError, StopIteration):
        return None
    channels = plan_channels(other, beams, sites_of(other, layout, beams))
    return None if unpulled(channels) else plan_selectivity(other, channels)


def _with_grid(spec: Spec, grid: tuple[int, int], count: int, optimise: bool) -> Spec:
    coils = grid[0] * grid[1]
    # As many taxels as asked where they need `count` channels per coil, else as many as there are places.
    taxels = spec.resolution if 0 <= coils * count - spec.resolution < coils else coils * count
    spacing = "spread" if spec.spacing == "optimised" and not optimise else spec.spacing
    listed = spec.resonances_hz if count * spec.coil.sets == len(spec.resonances_hz or ()) else None
    return replace(
        spec,
        resolution=taxels,
        coil=replace(spec.coil, grid=grid),
        spacing=spacing,
        resonances_hz=listed,
    )


class _Printed(NamedTuple):
    """Figures of simulated prints: `Explanation.good_share`, `life_share` and `print_db`."""

    good_share: float | None
    life_share: float | None
    kept_db: float | None


NO_PRINTS = _Printed(None, None, None)


def _is_same_print(plan: Plan, other: Plan) -> bool:
    """Return whether two plans have the same beams, and taxels at the same places."""
    prints = [
        ([channel.beam for channel in one.channels], [(taxel.x_mm, taxel.y_mm, taxel.channel) for taxel in one.taxels])
        for one in (plan, other)
    ]
    return prints[0] == prints[1]


def _printed(plan: Plan) -> _Printed:
    """Return the figures of simulated prints of `plan`; `NO_PRINTS` where the plan has errors."""
    if any(finding.level == "error" for finding in plan.findings):
        return NO_PRINTS
    today = plan.retuned_prints
    return _Printed(today.good_share, plan.life.good_share, today.print_db)


def _limits(plan: Plan, held: int, drive: str) -> Iterator[str]:
    """Yield in words which limits `held` + 1 channels per coil would break, and which the plan exceeds or nears."""
    spec = plan.spec
    load = plan.load
    grid = (plan.coils.rows, plan.coils.columns)
    more = held + 1
    if held >= MOST_TRIED:
        yield f"nothing that was tried: no more than {MOST_TRIED} channels were"
        return
    band = f"{number(spec.band_hz[0])} … {number(spec.band_hz[1])} Hz"
    figures = _figures(spec, grid, more)
    if figures is not None and figures.kept_db is not None and figures.kept_db < figures.asked_db:
        listed = more * spec.coil.sets == len(spec.resonances_hz or ())
        where = "at the listed resonances" if listed else f"with {spec.spacing!r} spacing"
        yield (
            f"selectivity: {more} channels per coil {where}, driven {figures.drive}, keep {figures.kept_db:.1f} dB in"
            f" all states, asked are {figures.asked_db:.1f} dB"
        )
    capacity = coil_capacity(spec, _spurless(spec), "")
    if more > capacity.paper:
        yield (
            f"Q and band: at Q = {number(spec.q_min)} the paper's slots of {number(capacity.ratio)} fill {band} with"
            f" {capacity.paper}"
        )
    if more > capacity.exact:
        yield (
            f"Q and band: with {drive}, {capacity.exact + 1} channels in {band} no longer keep"
            f" {decibel(spec.delta_y):.1f} dB in all states; what breaks it is {capacity.breaks}"
        )
    other = replace(spec, resolution=grid[0] * grid[1] * more, resonances_hz=None, coil=replace(spec.coil, grid=grid))
    options = candidates(other, more)
    best = max(options, key=lambda layout: layout.margin_mm, default=None)
    if best and best.margin_mm < -SLACK_MM:
        kind = {"coil": "coil", "width": "pitch and washer", "length": "pitch and beam", "reach": "coil's reach"}
        yield f"{kind[best.binding[0]]}: {binding_limit_text(other, best)}"
    elif best:
        sized = next(sized_layouts(other, options), None)
        if sized is None:
            yield f"printable beams: no set of beams in the sub-cells reaches {more} resonances in {band}"
        elif lost := unpulled(plan_channels(other, sized[1], sites_of(other, *sized))):
            yield (
                f"pull: of {more} {spec.mover.kind}s over a coil {lost} would lie so far off its axis that the coil"
                " does not pull them"
            )
    if load.reachable_level_um < spec.drive.level_um:
        yield (
            f"{load.reachable_by}: it allows {number(load.reachable_level_um)} µm on channel 0, asked are"
            f" {number(spec.drive.level_um)} µm"
        )
    if load.pull_in_share > 1 / 3:
        yield f"static pull: {load.pull_in_share:.0%} of the pull at which the softest washer snaps to the coil"


def _changes(plan: Plan, asked: Spec) -> list[tuple[int, Cure]]:
    """Return the changes of the `asked` spec of a plan to try, each with its cost (index into `COSTS`)."""
    spec = plan.spec
    weakest = max(plan.channels, key=lambda channel: channel.print_spread)
    low, high = spec.band_hz
    suspension = spec.suspension
    printer = spec.printer
    bands = (1.25, 1), (1, 1.5), (1 / 1.5, 1), (1, 2), (1 / 2, 1)
    sizes = {"pad.width_mm": spec.pad.width_mm, "pad.depth_mm": spec.pad.depth_mm}
    finer = [p for p in catalogue("printer").values() if p["line_width_mm"] < printer.line_width_mm]
    smaller = [
        w
        for w in catalogue(spec.mover_table_name).values()
        if w["outer_diameter_mm"] < spec.washer_or_magnet.outer_diameter_mm
    ]
    topologies = [name for name in SUSPENSIONS.names() if name not in (suspension.topology, weakest.beam.topology)]
    laws = () if spec.drive.threshold_hz else (0.0, 1.0, 2.0)
    free = {"topology": "auto", "tune": "width+thickness+length"}
    kinds: list[tuple[int, Iterable[Cure]]] = [
        (0, [{"resonances_hz": None}] if asked.resonances_hz and asked.touch.is_untouched else ()),
        (0, ({"drive.scheme": name} for name in in_order(plan.spec.force_order) if name != plan.selectivity.drive)),
        (0, ({"spacing": way} for way in ("spread", "optimised") if spec.spacing not in (way, "optimised"))),
        (0, ({"drive.level_law": law} for law in laws if law != spec.drive.level_law)),
        (0, [{"delta_y": float(number(spec.delta_y * 0.7))}]),
        (1, ({"q_min": round(spec.q_min * factor, 1)} for factor in (1.25, 1.5, 2.0))),
        (0, ({f"suspension.{key}": value} for key, value in free.items() if getattr(suspension, key) != value)),
        (0, ({"suspension.topology": name} for name in topologies)),
        (0, [{"suspension.thickness_mm": round(weakest.beam.thickness_mm + printer.layer_mm, 6)}]),
        (1, () if spec.spread.bed_meshed else [{"spread.bed_meshed": True}]),
        (1, ({"material": name} for name in _materials(spec))),
        (1, ({"band_hz": [float(number(low * less)), float(number(high * more))]} for less, more in bands)),
        (1, ({"printer": entry["name"]} for entry in finer if entry["process"] == printer.process)),
        (2, ({spec.mover_table_name: entry["name"]} for entry in smaller)),
        (2, other_shapes(asked)),
        (3, ({k: round(mm * more / 100, 1) for k, mm in sizes.items()} for more in (120, 150))),
        *_touch_changes(spec),
    ]
    return [(cost, cure) for cost, cures in kinds for cure in cures]


def _materials(spec: Spec) -> Iterator[str]:
    """Yield the catalogue's printable materials that soften less with warmth than the spec's, least softening first."""
    entries = [entry for entry in catalogue("material").values() if entry["process"] == spec.printer.process]
    for entry in sorted(entries, key=lambda entry: entry["softening_per_k"]):
        if entry["softening_per_k"] < spec.material.softening_per_k:
            yield entry["name"]


PLACES = (0.7, 0.85, 1.2)
"""Shares of the place of a pin along its beam that are tried."""


def _touch_changes(spec: Spec) -> Iterator[tuple[int, Iterable[Cure]]]:
    """Yield changes that matter under touch, with their cost: place and diameter of pins, and heavier ballast."""
    if spec.touch.is_untouched:
        return
    share = spec.pin_share
    places = [0.5] if share is None else [round(share * part, 3) for part in PLACES if share * part < 1]
    yield 1, ({"contactor.place": place} for place in places)
    finer_mm = round(spec.contact_diameter_mm * 0.7, 3)
    yield 1, [{"contactor.diameter_mm": finer_mm}]
    mass_g = spec.ballast.mass_g if spec.ballast else 0.0
    room_mm = spec.taxel.plate_thickness_mm - spec.recess_depth_mm - 2 * spec.printer.layer_mm
    heavier = [
        name
        for name, entry in catalogue("ballast").items()
        if name.startswith("steel-rod") and entry["height_mm"] <= room_mm and _rod_g(entry) > mass_g
    ]
    yield 2, ({"ballast": name} for name in heavier[:2])


def _rod_g(entry: dict[str, Any]) -> float:
    """Return the mass in g of a rod of the catalogue."""
    return float(pi / 4 * entry["width_mm"] ** 2 * entry["height_mm"] * entry["density_g_per_cm3"] * 1e-3)
