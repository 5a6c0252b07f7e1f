"""Cures: changes of the spec that a finding or a refusal suggests, each tried by planning the changed spec.

`refusal` explains why no pad meets a spec: the limit that binds, and the nearest specs that a pad would meet.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, fields, replace
from itertools import islice
from math import inf
from typing import Any

from padgen.core.errors import InfeasibleError, PadgenError, SpecError, cured, number
from padgen.core.finding import LEVELS
from padgen.planner.layout import (
    SLACK_MM,
    Layout,
    candidates,
    coil_reach_mm,
    explain,
    most_channels,
    most_coils,
    most_outputs,
    room,
    whole_grids,
)
from padgen.planner.plan import Plan
from padgen.planner.search import ladders, reachable_hz, sized_layouts
from padgen.planner.suspensions import allowed, suspension
from padgen.planner.taxel_model import plate_shape, shortest_mm
from padgen.spec import Spec, Suspension, make_spec
from padgen.spec.load import CARRIED_HEADROOM, catalogue, laid_over, spread_of, without_none

__all__ = ["Cure", "refusal", "varied", "with_tried_cures"]


MOST_TRIED = 4
"""Most cures that are tried for one plan."""
LOST_DB = 0.05
"""Loss of the asked selectivity in dB that a cure may cause."""
COUNTED = ("model.", "ladder.", "selectivity.", "coil.leak", "modes.")
"""Kinds of findings about the models, or about a loss of selectivity, which is counted in dB anyway."""

Cure = dict[str, Any]
"""New values of fields of the spec, by the fields' dotted names; None removes a field from the spec."""


def varied(spec: Spec, cure: Cure) -> Spec:
    """Return `spec` with the fields of `cure` as if they were written in its file; raises as `make_spec` does."""
    table = without_none(asdict(spec))
    if "printer" in cure and table["spread"] == catalogue("spread").get(spread_of(spec.printer)):
        del table["spread"]  # the file leaves it to the printer
    own = spec.amplifier
    if own and any(name.startswith("amplifier") for name in cure):
        # What the file leaves to the amplifier is left to the other one.
        for name, value in (("voltage_limit_v", own.voltage_v), ("headroom", CARRIED_HEADROOM)):
            if table["drive"][name] == value:
                del table["drive"][name]
    return make_spec(without_none(laid_over(table, cure)))


def with_tried_cures(plan: Plan, planned: Callable[[Cure], Plan]) -> Plan:
    """Return `plan` with the cures of its findings that hold, each finding's first one, and no others.

    `planned` makes the plan of the spec with a cure. A cure holds where no finding of that kind is left and there are
    no more errors; where there are fewer kinds of findings, or no more of those that are not `COUNTED`; and where as
    much is kept of the selectivity that is asked.
    """
    proposed: dict[str, list[Cure]] = {}
    for finding in plan.findings:
        proposed.setdefault(finding.code, []).extend(finding.cures)
    before, known, holds = _severities(plan), list[tuple[Cure, Plan | None]](), dict[str, list[Cure]]()
    for code, cures in proposed.items():
        for cure in cures:
            if cure not in (tried for tried, _ in known) and len(known) < MOST_TRIED:
                known.append((cure, _planned(planned, cure)))
            again = next((made for tried, made in known if tried == cure), None)
            if again and _is_better(plan, before, again, code):
                holds[code] = [cure]
                break
    findings = (
        replace(f, message=cured(f.message, holds.get(f.code, ())), cures=tuple(holds.get(f.code, ())))
        for f in plan.findings
    )
    return replace(plan, findings=tuple(findings))


def _planned(planned: Callable[[Cure], Plan], cure: Cure) -> Plan | None:
    try:
        return planned(cure)
    except PadgenError:
        return None


def _severities(plan: Plan) -> dict[str, int]:
    """Return the severity (index in `LEVELS`) of the worst finding of each code, notes left out."""
    worst: dict[str, int] = {}
    for f in plan.findings:
        if f.level != "note":
            worst[f.code] = max(worst.get(f.code, 0), LEVELS.index(f.level))
    return worst


def _is_better(plan: Plan, before: dict[str, int], again: Plan, code: str) -> bool:
    after = _severities(again)
    kept = [inf if p.selectivity.kept_db is None else p.selectivity.kept_db for p in (plan, again)]
    errors, others = [], []
    for severities in (after, before):
        errors.append(list(severities.values()).count(LEVELS.index("error")))
        others.append(sum(not code.startswith(COUNTED) for code in severities))
    return (
        code not in after
        and errors[0] <= errors[1]
        and (len(after) < len(before) or others[0] <= others[1])
        and kept[1] >= min(kept[0], plan.selectivity.asked_db) - LOST_DB
    )


FEWER = 3
"""Smaller counts of taxels that are tried for an amplifier."""
MOST_NAMED = 4
"""Most cures that a refusal names."""


def refusal(
    spec: Spec, options: list[Layout], limit: int, planned: Callable[[Cure], Any], where: str = "resolution"
) -> InfeasibleError:
    """Return the error that says why none of `options` works with up to `limit` channels per coil.

    It names cures that work: `planned` makes the plan of the original spec with a cure, and that must have no error.
    """
    pad = spec.pad
    wanted = f"{spec.resolution} taxels on {number(pad.width_mm)} x {number(pad.depth_mm)} mm"
    # A cure that makes room for evenly spread resonances makes room for optimised ones, too, and is found faster.
    cures = _cures(replace(spec, spacing="spread") if spec.spacing == "optimised" else spec, limit)
    found: list[Cure] = []
    for cure in cures:
        if all(set(cure) != set(other) for other in found) and _plans_without_error(planned, cure):
            found.append(cure)
        if len(found) == MOST_NAMED:
            break
    nothing = "" if found else "; no single change that was tried would do: washer, printer, beams, pad, taxels"
    reasons = _reasons(spec, options, limit)
    if spec.amplifier and options:
        reasons.append(f"the amplifier {spec.amplifier.name} has {spec.amplifier.channels} channels, one for each coil")
    sentence = f"{wanted} cannot be laid out: {'; '.join(reasons)}{nothing}"
    return InfeasibleError(sentence, where, found)


def _plans_without_error(planned: Callable[[Cure], Any], cure: Cure) -> bool:
    try:
        plan = planned(cure)
    except PadgenError:
        return False
    # What an amplifier plays may be too little: a plan for it must also keep what is asked.
    kept = plan.selectivity.kept_db if plan.spec.amplifier else None
    return not any(f.level == "error" for f in plan.findings) and (kept is None or kept >= plan.selectivity.asked_db)


def _reasons(spec: Spec, options: list[Layout], limit: int) -> list[str]:
    if not options:
        return [_too_many(spec, limit)]
    best = sorted(options, key=lambda layout: -layout.margin_mm)
    if best[0].margin_mm >= -SLACK_MM:
        return [_unreached(spec, best[0])]
    kinds: dict[str, Layout] = {}
    for layout in best:
        kinds.setdefault(layout.binding[0], layout)
    return [explain(spec, layout) for layout in list(kinds.values())[:2]]


def _too_many(spec: Spec, limit: int) -> str:
    grid = spec.coil.grid
    per_coil = most_channels(spec, limit)
    rows, columns = grid or most_coils(spec)
    coils = int(min(rows * columns, most_outputs(spec)))
    there_are = "the grid has" if grid else "there is room for"
    if spec.amplifier and coils < rows * columns:
        there_are = f"the amplifier {spec.amplifier.name} has channels for"
    band = f"Q = {number(spec.q_min)} in {number(spec.band_hz[0])} … {number(spec.band_hz[1])} Hz"
    if per_coil < limit and not spec.resonances_hz:
        band = "there is no room for more plates at it"
    exact = "exactly" if spec.resonances_hz else "at most"
    return (
        f"{there_are} {coils} coil{'s' * (coils > 1)} of {number(spec.coil.outer_diameter_mm)} mm, each with {exact}"
        f" {per_coil} channels"
        f" ({band}), {coils * per_coil} taxels in all"
    )


def _unreached(spec: Spec, layout: Layout) -> str:
    space = room(spec, layout)
    found = reachable_hz(spec, space)
    wanted = ladders(spec, layout.channels, space)
    asked = ", ".join(number(f) for f in wanted[0]) if wanted else "none in the band"
    if not found:
        return _no_beam(spec, layout)
    grid = f"{layout.channels} channels per coil on the {layout.rows} x {layout.columns} grid"
    if wanted and found[0] <= wanted[0][0] and wanted[0][-1] <= found[1]:
        reach = number(coil_reach_mm(spec))
        return f"{grid}: beams for {asked} Hz hold a washer beyond the coil's reach of {reach} mm from its axis"
    return (
        f"{grid}: the {number(layout.sub_width_mm)} x {number(layout.sub_depth_mm)} mm sub-cell can be printed for"
        f" {number(found[0])} … {number(found[1])} Hz, asked are {asked} Hz"
    )


def _no_beam(spec: Spec, layout: Layout) -> str:
    """Say why no beam at all fits a sub-cell that has room for the plate."""
    space, plate, gap = room(spec, layout), plate_shape(spec), spec.printer.smallest_gap_mm
    spans = []
    for name in allowed(spec.suspension.topology):
        shape = suspension(name)
        longest, widest = shape.longest(space, plate, gap), shape.widest(space, plate, gap)
        spans.append(
            f"{name}: lengths of {number(shortest_mm(spec, name))} … {number(longest)} mm,"
            f" widths of {number(spec.printer.smallest_beam_mm)} … {number(widest)} mm"
        )
    asked = (
        f", asked is suspension.length_mm = {number(spec.suspension.length_mm)}" if spec.suspension.length_mm else ""
    )
    return (
        f"the {number(layout.sub_width_mm)} x {number(layout.sub_depth_mm)} mm sub-cell of the {layout.rows} x"
        f" {layout.columns} grid holds no such beam ({'; '.join(spans)}){asked}"
    )


def _cures(spec: Spec, limit: int) -> Iterator[Cure]:
    """Yield cures after which the parts have room: another grid, washer, printer or pad, freer beams, fewer taxels."""
    if spec.coil.grid and (found := _best_layout(spec, limit, {"coil.grid": None})):
        yield {"coil.grid": [found.rows, found.columns]}
    yield from _amplifier_cures(spec, limit)
    sizes = {name: float(entry["outer_diameter_mm"]) for name, entry in catalogue("washer").items()}
    smaller = [name for name, size in sizes.items() if size < spec.washer.outer_diameter_mm]
    yield from _first_with_room(
        spec, limit, [{"washer": name} for name in sorted(smaller, key=lambda name: -sizes[name])]
    )
    printers = catalogue("printer").values()
    finer = [entry for entry in printers if entry["line_width_mm"] < spec.printer.line_width_mm]
    yield from _first_with_room(
        spec, limit, [{"printer": e["name"]} for e in finer if e["process"] == spec.printer.process]
    )
    for item in fields(Suspension):
        if getattr(spec.suspension, item.name) != item.default:
            yield from _first_with_room(spec, limit, [{f"suspension.{item.name}": item.default}])
    sides = ("width_mm", "depth_mm")
    yield from _first_with_room(
        spec,
        limit,
        [
            {f"pad.{side}": round(getattr(spec.pad, side) * percent / 100, 1) for side in sides}
            for percent in (110, 120, 130, 150, 175, 200)
        ],
    )
    # The most taxels that have room are named; of those that an amplifier can play, the most that keep what is asked.
    whole = () if spec.coil.grid else sized_layouts(spec, whole_grids(spec, limit))
    fewer = dict.fromkeys(layout.coils * layout.channels for layout, _ in islice(whole, None if spec.amplifier else 1))
    yield from ({"resolution": count} for count in islice(fewer, FEWER))
    if spec.coil.grid:
        coils = spec.coil.grid[0] * spec.coil.grid[1]
        most = min(most_channels(spec, limit), (spec.resolution - 1) // coils)
        yield from _first_with_room(spec, limit, [{"resolution": coils * count} for count in range(most, 0, -1)])


def _amplifier_cures(spec: Spec, limit: int) -> Iterator[Cure]:
    """Yield cures where an amplifier has too few channels: as many as it takes, or larger coils of the catalogue."""
    free = replace(spec, amplifier=None)
    found = next(sized_layouts(free, candidates(free, limit)), None) if spec.amplifier else None
    if found and found[0].coils > most_outputs(spec):
        yield {"amplifier.channels": found[0].coils}
    if spec.amplifier:
        sizes = {name: float(entry["outer_diameter_mm"]) for name, entry in catalogue("coil").items()}
        larger = sorted((n for n in sizes if sizes[n] > spec.coil.outer_diameter_mm), key=lambda n: sizes[n])
        yield from _first_with_room(spec, limit, [{"coil": name} for name in larger])


def _first_with_room(spec: Spec, limit: int, cures: list[Cure]) -> Iterator[Cure]:
    """Yield the first of `cures` after which the parts have room, if there is one."""
    yield from islice((cure for cure in cures if _best_layout(spec, limit, cure)), 1)


def _best_layout(spec: Spec, limit: int, cure: Cure) -> Layout | None:
    """Return the best layout of the spec with a cure, or None if no layout has room."""
    try:
        other = varied(spec, cure)
    except SpecError:
        return None
    found = next(sized_layouts(other, candidates(other, limit)), None)
    return found[0] if found else None
