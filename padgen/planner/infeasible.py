"""The sentence for a spec that no pad meets: which limit binds, and the nearest specs that would do."""

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any

from padgen.core.errors import SpecError, number
from padgen.planner.layout import SLACK_MM, Layout, candidates, explain, most_channels, most_coils, room, whole_grids
from padgen.planner.resonances import ladders, reachable_hz
from padgen.planner.search import sized_layouts
from padgen.planner.suspensions import allowed, suspension
from padgen.planner.taxel_model import plate_shape, shortest_mm
from padgen.spec import Spec, Suspension, catalogue, make_spec
from padgen.spec.load import without_none

__all__ = ["why_not"]


def why_not(spec: Spec, options: list[Layout], limit: int) -> str:
    """Why none of `options` holds with up to `limit` channels per coil, and what would do."""
    pad = spec.pad
    wanted = f"{spec.resolution} taxels on {number(pad.width_mm)} x {number(pad.depth_mm)} mm"
    # Where a pad can be laid out at all, optimised resonances can be had as well.
    cures = list(_cures(replace(spec, spacing="spread") if spec.spacing == "optimised" else spec, limit))
    cure = (
        "what would do: " + ", or ".join(cures)
        if cures
        else "no other washer, printer, pad or resolution that was tried would do"
    )
    return f"{wanted} cannot be laid out: {'; '.join(_reasons(spec, options, limit))}; {cure}"


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
    coils = rows * columns
    which = "the grid has" if grid else "there is room for"
    band = f"Q = {number(spec.q_min)} in {number(spec.band_hz[0])} … {number(spec.band_hz[1])} Hz"
    if per_coil < limit and not spec.resonances_hz:
        band = "there is no room for more plates at it"
    exact = "exactly" if spec.resonances_hz else "at most"
    return (
        f"{which} {coils} coils of {number(spec.coil.outer_diameter_mm)} mm, each with {exact} {per_coil} channels"
        f" ({band}), {coils * per_coil} taxels in all"
    )


def _unreached(spec: Spec, layout: Layout) -> str:
    space = room(spec, layout)
    found = reachable_hz(spec, space)
    wanted = ladders(spec, layout.channels, space)
    asked = ", ".join(number(f) for f in wanted[0]) if wanted else "none in the band"
    if not found:
        return _no_beam(spec, layout)
    span = f"{number(found[0])} … {number(found[1])} Hz"
    return (
        f"{layout.channels} channels per coil on the {layout.rows} x {layout.columns} grid: the"
        f" {number(layout.sub_width_mm)} x {number(layout.sub_depth_mm)} mm sub-cell can be printed for {span},"
        f" asked are {asked} Hz"
    )


def _no_beam(spec: Spec, layout: Layout) -> str:
    """Why no beam at all fits a sub-cell that has room for the plate."""
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


def _cures(spec: Spec, limit: int) -> Iterator[str]:
    """Nearest specs that hold: another grid, washer, printer or pad, or fewer taxels."""
    if spec.coil.grid and (found := _holds(spec, limit, coil={**asdict(spec.coil), "grid": None})):
        yield f"coil.grid = [{found.rows}, {found.columns}]"
    entries = catalogue("washer").values()
    smaller = [w for w in entries if w["outer_diameter_mm"] < spec.washer.outer_diameter_mm]
    for washer in sorted(smaller, key=lambda w: -float(w["outer_diameter_mm"])):
        if found := _holds(spec, limit, washer=washer):
            yield (
                f"washer {washer['name']} ({number(washer['outer_diameter_mm'])} mm) on the"
                f" {found.rows} x {found.columns} grid"
            )
            break
    for printer in catalogue("printer").values():
        finer = printer["line_width_mm"] < spec.printer.line_width_mm and printer["process"] == spec.printer.process
        if finer and _holds(spec, limit, printer=printer):
            yield f"printer {printer['name']}"
            break
    yield from _freer_beams(spec, limit)
    yield from _larger_pads(spec, limit)
    fewer = None if spec.coil.grid else next(sized_layouts(spec, whole_grids(spec, limit)), None)
    if fewer:
        yield f"{fewer[0].coils * fewer[0].channels} taxels ({fewer[0].rows} x {fewer[0].columns} coils)"


def _freer_beams(spec: Spec, limit: int) -> Iterator[str]:
    """Leaving one wish about the beams open."""
    wishes, defaults = asdict(spec.suspension), asdict(Suspension())
    for key, default in defaults.items():
        if wishes[key] != default and _holds(spec, limit, suspension={**wishes, key: default}):
            yield f"suspension.{key} = {default!r}" if default else f"no suspension.{key}"


def _larger_pads(spec: Spec, limit: int) -> Iterator[str]:
    pad = asdict(spec.pad)
    for percent in (110, 120, 130, 150, 175, 200):
        sides = {key: round(pad[key] * percent / 100, 1) for key in ("width_mm", "depth_mm")}
        if _holds(spec, limit, pad={**pad, **sides}):
            yield f"a pad of {number(sides['width_mm'])} x {number(sides['depth_mm'])} mm"
            return


def _holds(spec: Spec, limit: int, **changes: Any) -> Layout | None:
    """The best layout of the spec with some of its tables changed, None where it has none."""
    try:
        other = make_spec(without_none({**asdict(spec), **changes}))
    except SpecError:
        return None
    found = next(sized_layouts(other, candidates(other, limit)), None)
    return found[0] if found else None
