"""Cures: changes of the spec that a finding or a refusal suggests, each tried by planning the changed spec.

`refusal` explains why no pad meets a spec: the limit that binds, and the nearest specs that a pad would meet.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, fields, replace
from itertools import islice
from math import inf, log
from operator import itemgetter
from typing import Any

from padgen.core.errors import InfeasibleError, PadgenError, SolverError, SpecError, cured, number, plural
from padgen.planner.coils import without_sizes
from padgen.planner.layout import (
    SLACK_MM,
    Layout,
    binding_limit_text,
    candidates,
    channel_counts,
    coil_reach_mm,
    full_smaller_layouts,
    most_coils,
    most_outputs,
    room,
    roomy_layouts,
)
from padgen.planner.plan import Plan
from padgen.planner.search import channel_limit, ladders, reachable_hz, sized_layouts, snapping
from padgen.planner.verdict import with_verdict
from padgen.spec import Spec, SuspensionTable, load_spec, make_spec
from padgen.spec.load import (
    CARRIED_HEADROOM,
    as_table,
    catalogue,
    is_resizable,
    laid_over,
    spread_of,
    still_searched,
    without_none,
)

__all__ = ["Cure", "named_breakdown", "other_shapes", "refusal", "varied", "with_tried_cures"]


MOST_TRIED = 4
"""Most cures that are tried for one plan."""
LOST_DB = 0.05
"""Loss of the asked selectivity in dB that a cure may cause."""
COUNTED = ("model.", "ladder.", "selectivity.", "coil.leak", "modes.", "felt.")
"""Kinds of findings about the models, about a loss of selectivity, which is counted in dB anyway, or about what is
felt: a cure of something else may make a pad quieter."""

Cure = dict[str, Any]
"""New values of fields of the spec, by the fields' dotted names; None removes a field from the spec."""


def varied(spec: Spec, cure: Cure) -> Spec:
    """Return the spec that results if `cure` is written into the file of `spec`; raises as `make_spec` does."""
    table = as_table(spec)
    if "printer" in cure and table["spread"] == catalogue("spread").get(spread_of(spec.printer)):
        del table["spread"]  # the file leaves it to the printer
    amplifier = spec.amplifier
    # What the file leaves to amplifier and sound card is left to the other ones.
    drive = table["drive"]
    others = [name.split(".")[0] for name in cure]
    if amplifier and "amplifier" in others and drive["voltage_limit_v"] == amplifier.voltage_v:
        del drive["voltage_limit_v"]
    search = spec.touch.search
    if search != "none":  # the file leaves it to the parts that it does not give
        given = {name for name, value in cure.items() if value is not None}
        given |= {name.split(".")[0] for name in given}
        table["touch"]["search"] = still_searched(search.split("+"), given)
    if spec.blocked_by and {"amplifier", "sound_card"} & {*others} and drive["headroom"] == CARRIED_HEADROOM:
        del drive["headroom"]
    return make_spec(without_none(laid_over(table, cure)))


def with_tried_cures(plan: Plan, planned: Callable[[Cure], Plan]) -> Plan:
    """Return `plan` with each finding's first proposed cure that works when planned, and no other cures.

    `planned` makes the plan of the spec with a cure, for at most `MOST_TRIED` cures. A cure holds where no finding of
    that kind is left and there are no more errors; where there are fewer kinds of findings, or no more of those that
    are not `COUNTED`; and where as much is kept of the selectivity that is asked.
    """
    proposed: dict[str, list[Cure]] = {}
    for finding in plan.findings:
        proposed.setdefault(finding.code, []).extend(finding.cures)
    known = list[tuple[Cure, Plan | None]]()
    holds = dict[str, list[Cure]]()
    for code, cures in proposed.items():
        for cure in cures:
            if cure not in (tried for tried, _ in known) and len(known) < MOST_TRIED:
                try:
                    known.append((cure, planned(cure)))
                except PadgenError:
                    known.append((cure, None))
            again = next((made for tried, made in known if tried == cure), None)
            if again and _is_better(plan, again, code):
                holds[code] = [cure]
                break
    findings = tuple(
        replace(f, message=cured(f.message, holds.get(f.code, ())), cures=tuple(holds.get(f.code, ())))
        for f in plan.findings
    )
    return with_verdict(plan, findings)


def _is_better(plan: Plan, again: Plan, code: str) -> bool:
    before, after = ({f.code for f in p.findings if f.level != "note"} for p in (plan, again))
    errors = [len({f.code for f in p.findings if f.level == "error"}) for p in (plan, again)]
    others = [sum(not kind.startswith(COUNTED) for kind in kinds) for kinds in (before, after)]
    kept = [inf if p.selectivity.kept_db is None else p.selectivity.kept_db for p in (plan, again)]
    return (
        code not in after
        and errors[1] <= errors[0]
        and (len(after) < len(before) or others[1] <= others[0])
        and kept[1] >= min(kept[0], plan.selectivity.asked_db) - LOST_DB
    )


UNUSUAL_TRIED = 3
"""Fields far from what is usual that are tried with their usual value, after a computation broke down."""


def named_breakdown(spec: Spec, error: SolverError, planned: Callable[[Cure], Any]) -> SolverError:
    """Return an error naming the first field that, set to its usual value, makes the plan computable; else `error`.

    Usual is what the template pad-32 has; fields are tried in the order of their ratio to that, the largest first.
    """
    usual = _numbers_of(load_spec("pad-32"))
    given = _numbers_of(spec)
    shared = [name for name in given if name in usual and given[name] > 0 and usual[name] > 0]
    far = sorted(shared, key=lambda name: -abs(log(given[name] / usual[name])))
    for name in far[:UNUSUAL_TRIED]:
        cure: Cure = {name: usual[name]}
        try:
            planned(cure)
        except PadgenError:
            continue
        message = f"must be nearer to what is usual, got {given[name]:g}: with it {error.where} {error.message}"
        return SolverError(message, name, [cure])
    return error


def _numbers_of(spec: Spec) -> dict[str, Any]:
    """Return the numeric fields of a spec by their dotted names."""
    table = asdict(spec)
    named = list(table.items())
    for name, value in table.items():
        if isinstance(value, dict):
            named += [(f"{name}.{key}", inner) for key, inner in value.items()]
    return {name: value for name, value in named if isinstance(value, (int, float)) and not isinstance(value, bool)}


FEWER = 3
"""Smaller counts of taxels that are tried for an amplifier."""
MOST_NAMED = 4
"""Most cures that a refusal names."""


def refusal(spec: Spec, planned: Callable[[Cure], Any]) -> InfeasibleError:
    """Return the error that says why no layout works for `spec`, which leaves no value open, with cures that do work.

    It names cures that work: `planned` makes the plan of the original spec with a cure, and that must have no error.
    """
    limit = channel_limit(spec)
    if snapped := snapping(spec):
        sentence, cures = snapped
        return InfeasibleError(sentence, "coil.gap_mm", list(_holding(cures, planned)))
    tried: list[Cure] = []
    # A cure that makes room for evenly spread resonances makes room for optimised ones, too, and is found faster.
    for cure in _cures(replace(spec, spacing="spread") if spec.spacing == "optimised" else spec, limit):
        if any(set(cure) == set(other) - {"drive.level_um"} for other in tried):
            continue
        try:
            plan = planned(cure)
            if cooler := _cooling_cure(plan):
                cure = {**cure, **cooler}
                plan = planned(cure)
        except PadgenError:
            continue
        # What amplifier and sound card play may be too little: a plan for them must also keep what is asked.
        kept_db = plan.selectivity.kept_db if plan.spec.drive_devices else None
        enough = kept_db is None or kept_db >= plan.selectivity.asked_db
        if enough and all(f.level != "error" for f in plan.findings):
            tried.append(cure)
        if len(tried) == MOST_NAMED:
            break
    best = sorted(candidates(spec, limit), key=lambda layout: -layout.margin_mm)
    if not best:
        reasons = [_too_many(spec, limit)]
    elif best[0].margin_mm >= -SLACK_MM:
        reasons = [_unreached(spec, best[0])]
    else:
        nearest = {layout.binding[0]: layout for layout in reversed(best)}  # the best of each kind
        reasons = [binding_limit_text(spec, layout) for layout in sorted(nearest.values(), key=best.index)[:2]]
    if spec.drive_devices and best:
        word, device = min(spec.drive_devices, key=lambda feed: feed[1].channels)
        reasons.append(f"the {word} {device.name} has {device.channels} channels, one for each coil")
    nothing = (
        ""
        if tried
        else f"; no single change of {spec.mover.kind}, printer, beams, pad or taxels that was tried would do"
    )
    wanted = f"{spec.resolution} taxels on {number(spec.pad.width_mm)} x {number(spec.pad.depth_mm)} mm"
    return InfeasibleError(f"{wanted} cannot be laid out: {'; '.join(reasons)}{nothing}", "resolution", tried)


def _holding(cures: Sequence[Cure], planned: Callable[[Cure], Any]) -> Iterator[Cure]:
    """Yield the cures that make a pad without errors."""
    for cure in cures:
        try:
            plan = planned(cure)
        except PadgenError:
            continue
        if all(finding.level != "error" for finding in plan.findings):
            yield cure


def _cooling_cure(plan: Any) -> Cure:
    """Return the cure with a lower vibration level if overheating is a plan's only error, else an empty cure.

    Where taxels have room does not change how much they heat the pad.
    """
    errors = [finding for finding in plan.findings if finding.level == "error"]
    if [finding.code for finding in errors] != ["pad.hot"]:
        return {}
    return next(iter(errors[0].cures), {})


def _too_many(spec: Spec, limit: int) -> str:
    per_coil = max(channel_counts(spec, limit))
    rows, columns = spec.coil.grid or most_coils(spec)
    coils = int(min(rows * columns, most_outputs(spec)))
    there_are = "the grid has" if spec.coil.grid else "there is room for"
    if spec.drive_devices and coils < rows * columns:
        word, device = min(spec.drive_devices, key=lambda feed: feed[1].channels)
        there_are = f"the {word} {device.name} has channels for"
    return (
        f"{there_are} {coils} coil{plural(coils)} of {spec.coil.size_text}; band, Q and room for"
        f" plates allow each at most {per_coil} channel{plural(per_coil)}: {coils * per_coil} taxels before beams are"
        " counted"
    )


def _unreached(spec: Spec, layout: Layout) -> str:
    space = room(spec, layout)
    reachable = reachable_hz(spec, space)
    wanted = ladders(spec, layout.channels, space)
    cell = f"the {number(layout.sub_width_mm)} x {number(layout.sub_depth_mm)} mm of a taxel"
    grid = f"the {layout.rows} x {layout.columns} grid"
    if not reachable:  # no beam at all fits a sub-cell that has room for the plate
        length_mm = spec.suspension.length_mm
        such = f"beam of suspension.length_mm = {number(length_mm)}" if length_mm else "beam that prints"
        return f"{cell} on {grid} hold the plate, but no {such}"
    asked = ", ".join(number(f) for f in wanted[0]) if wanted else "none in the band"
    if wanted and reachable[0] <= wanted[0][0] and wanted[0][-1] <= reachable[1]:
        reach = number(coil_reach_mm(spec))
        sentence = f"beams for {asked} Hz hold a {spec.mover.kind} beyond the coil's reach of {reach} mm from its axis"
    else:
        sentence = (
            f"beams that fit {cell} can be printed for {number(reachable[0])} … {number(reachable[1])} Hz (asked:"
            f" {asked} Hz)"
        )
    return f"{layout.channels} channel{plural(layout.channels)} per coil on {grid}: {sentence}"


def other_shapes(spec: Spec) -> list[Cure]:
    """Return the changes that give coils on a board, under magnets, the other shape."""
    coil = spec.coil
    if coil.kind != "board" or spec.mover.kind != "magnet":
        return []
    if coil.shape == "round":
        return [{"coil.shape": "rectangular"}]
    return [{"coil.shape": "round"} | ({} if coil.outer_depth_mm is None else {"coil.outer_depth_mm": None})]


def _cures(spec: Spec, limit: int) -> Iterator[Cure]:
    """Yield cures that make room: other grid, coil, mover, printer or pad, more outputs, freer beams, fewer taxels.

    Of the cures of a kind it is the first with room.
    """
    if spec.coil.grid and (best_layout := _best_layout(spec, limit, {"coil.grid": None})):
        yield {"coil.grid": [best_layout.rows, best_layout.columns]}
    if spec.drive_devices:
        free = replace(spec, amplifier=None, sound_card=None)
        sized = next(sized_layouts(free, roomy_layouts(free, limit)), None)
        if sized and sized[0].coils > most_outputs(spec):
            short = [word for word, device in spec.drive_devices if device.channels < sized[0].coils]
            yield {f"{word.replace(' ', '_')}.channels": sized[0].coils for word in short}
    diameter = itemgetter("outer_diameter_mm")
    larger = [e for e in catalogue("coil").values() if spec.drive_devices and diameter(e) > spec.coil.outer_diameter_mm]
    smaller = [
        e for e in catalogue(spec.mover_table_name).values() if diameter(e) < spec.washer_or_magnet.outer_diameter_mm
    ]
    finer = [e for e in catalogue("printer").values() if e["line_width_mm"] < spec.printer.line_width_mm]
    beams = {
        f"suspension.{f.name}": f.default
        for f in fields(SuspensionTable)
        if getattr(spec.suspension, f.name) != f.default
    }
    sides = {"pad.width_mm": spec.pad.width_mm, "pad.depth_mm": spec.pad.depth_mm}
    larger_pads: list[Cure] = [
        {name: round(mm * more / 100, 1) for name, mm in sides.items()} for more in (110, 120, 130, 150, 175, 200)
    ]
    if not any(_best_layout(spec, limit, cure) for cure in (larger_pads[0], larger_pads[-1])):
        larger_pads = []  # what lies between is not worth its time
    ways: list[list[Cure]] = [
        [without_sizes(spec.coil)] if spec.coil.sizing == "given" and is_resizable(spec.coil) else [],
        other_shapes(spec),
        [{"coil": e["name"]} for e in sorted(larger, key=diameter)],
        [{spec.mover_table_name: e["name"]} for e in sorted(smaller, key=diameter, reverse=True)],
        [{"printer": e["name"]} for e in finer if e["process"] == spec.printer.process],
        *([{name: default}] for name, default in beams.items()),
        larger_pads,
    ]
    if spec.coil.grid:
        coils = spec.coil.grid[0] * spec.coil.grid[1]
        most = min(max(channel_counts(spec, limit)), (spec.resolution - 1) // coils)
        ways.append([{"resolution": coils * count} for count in range(most, 0, -1)])
    for way in ways:
        yield from islice((cure for cure in way if _best_layout(spec, limit, cure)), 1)
    # The most taxels that have room are named; of those that an amplifier can play, the most that keep what is asked.
    whole = () if spec.coil.grid else sized_layouts(spec, full_smaller_layouts(spec, limit))
    fewer = dict.fromkeys(
        layout.coils * layout.channels for layout, _ in islice(whole, None if spec.drive_devices else 1)
    )
    yield from ({"resolution": count} for count in islice(fewer, FEWER))


def _best_layout(spec: Spec, limit: int, cure: Cure) -> Layout | None:
    """Return the first layout in rank that works for `spec` changed by `cure`; None if it is refused or none works."""
    try:
        other = varied(spec, cure)
    except SpecError:
        return None
    # Another coil's table leaves gap and reuse to the search, which has decided them in `spec`.
    coil = replace(other.coil, gap_mm=other.coil.gap_mm or spec.coil.gap_mm, reuse=spec.coil.reuse)
    other = replace(other, coil=coil)
    layout = next(sized_layouts(other, roomy_layouts(other, limit)), None)
    return layout[0] if layout else None
