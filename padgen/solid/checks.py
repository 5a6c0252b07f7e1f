"""Print checks of a finished mesh, reported as findings.

Checks of the mesh alone need a printer's limits only. With a plan, the built dimensions are compared with the planned
ones, too.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, astuple, dataclass, replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from padgen.core import cache
from padgen.core.errors import Finding, GeometryError, at_least, number, plural
from padgen.core.files import sha256_hex
from padgen.core.rules import Rule, RuleBook, broken_rules
from padgen.planner.plan import Plan
from padgen.solid.compare import SMALLEST_MM, Cells, Difference, differences, same_faces, unmatched_triangles
from padgen.solid.measure import (
    Dimension,
    NarrowSpot,
    longest_unsupported_span,
    measured,
    narrow_places,
    sections,
    thin_skins,
    washer_rooms,
)
from padgen.solid.mesh import MOST_FOUND, Mesh, Topology, as_manifold, intersecting_pairs, topology
from padgen.solid.pad_solid import PadSolid, SampleShifts, assembled_pad_mesh, sampled
from padgen.spec import Printer, Spec

__all__ = [
    "BUILT_MM",
    "MESH_RULES",
    "PrintedMesh",
    "Report",
    "as_built",
    "check_against",
    "check_mesh",
    "check_pad",
    "check_part",
    "difference_findings",
    "first_of_each_code",
    "off_findings",
    "volume_findings",
]

BUILT_MM = 0.01
"""Largest allowed difference of a built dimension from the planned one."""
VOLUME_SHARE = 1e-3
"""Largest allowed relative difference of the mesh's volume from the exact one."""
FACET_MM = 0.012
"""Most that triangles in place of round faces may take off a wall or a gap."""
UNCOMPARED = Finding(
    "error", "mesh.intersects", "mesh", "too many of its triangles lie over each other for all of them to be compared"
)
KIND = "narrow-places"
CODE = ("solid/checks.py", "solid/measure.py", "solid/mesh.py", "core/errors.py")
"""The cache's name for measured walls, gaps and spans, and the code that they depend on."""
MOST_BODIES = 100
"""Most bodies of a mesh whose walls are measured; a mesh with more is no pad."""
Wrong = tuple[str, NarrowSpot, str]
"""The code of a finding, its place, and what is told of it."""
APART_MM = 1.0
"""Side of a square in the plane within which one narrow place is reported, whatever the heights."""
SAID = 2
"""Most wrong dimensions that are listed for one taxel."""
AT_ONCE = 5
"""Most findings of one kind that are listed; one more says how many were left out."""


@dataclass(frozen=True)
class Report:
    """The findings of all checks and the figures they measured."""

    figures: dict[str, Any]
    findings: tuple[Finding, ...]


def check_mesh(mesh: Mesh, printer: Printer, density_g_per_cm3: float) -> Report:
    """Run the checks that need no plan, against the limits of `printer`."""
    state = topology(mesh)
    figures, findings = _whole(mesh, state, printer, density_g_per_cm3)
    pierced = list(_pierced(mesh))
    # Of a mesh that lies in itself a thousandfold, cross-sections would take hours and tell nothing.
    printable = state.closed and state.volume_mm3 > 0 and state.shells <= MOST_BODIES and UNCOMPARED not in pierced
    more_figures, more = _printable(mesh, printer, SampleShifts()) if printable else ({}, [])
    return Report(figures | more_figures, (*findings, *pierced, *more))


def check_pad(pad: PadSolid, plan: Plan) -> Report:
    """Run all checks of a pad that was built from `plan`.

    The whole mesh must be closed, one body and of the right volume. Walls, gaps and dimensions are measured on a
    smaller pad that has every kind of tile and seam (`sampled`); the whole mesh must then consist of the same tiles.
    """
    state = topology(pad.mesh)
    figures, findings = _whole(pad.mesh, state, plan.spec.printer, plan.spec.material.density_g_per_cm3)
    own_figures, tile_findings = _of_tiles(pad, plan, state.closed)
    findings += [*volume_findings(state.volume_mm3, pad.volume_mm3), *tile_findings]
    if state.closed and own_figures["measured_taxels"] < len(plan.taxels):
        placed = assembled_pad_mesh(plan, pad.tiles, pad.border, pad.grid)
        if not all(np.array_equal(a, b) for a, b in zip(placed, pad.mesh, strict=True)):
            findings += _differing(pad.mesh, placed, plan)[1]
    return Report(figures | own_figures, tuple(findings))


def check_against(mesh: Mesh, pad: PadSolid, plan: Plan) -> Report:
    """Run all checks of a mesh in the planned pose, from any program, that should equal the `pad` of `plan`.

    Triangles that are the pad's own, or its faces cut anew, need no further check. Where the mesh has others, the
    solids are compared: every difference into which a cube of `padgen.solid.compare.SMALLEST_MM` fits is found, and
    beams and recesses of the taxels there are measured.
    """
    state = topology(mesh)
    printer = plan.spec.printer
    figures, findings = _whole(mesh, state, printer, plan.spec.material.density_g_per_cm3)
    if not state.closed or state.volume_mm3 <= 0:
        return Report(figures, tuple(findings))
    same, differing = _differing(mesh, pad.mesh, plan)
    findings += [] if same else _pierced(mesh)
    if differing:
        more_figures, more = _printable(mesh, printer, SampleShifts()) if state.shells <= MOST_BODIES else ({}, [])
    else:
        more_figures, more = _of_tiles(pad, plan, True)
    return Report(figures | more_figures, (*findings, *differing, *more))


def _whole(
    mesh: Mesh, state: Topology, printer: Printer, density_g_per_cm3: float
) -> tuple[dict[str, Any], list[Finding]]:
    """Return size, volume, mass and bodies of the whole mesh, and findings on closedness, bodies and bed size."""
    figures = {
        "triangles": len(mesh.triangles),
        "size_mm": [round(float(v), 4) for v in _size_mm(mesh)],
        "volume_mm3": state.volume_mm3,
        "plastic_g": state.volume_mm3 * 1e-3 * density_g_per_cm3,
        "bodies": state.shells,
    }
    return figures, list(MESH_RULES.findings(PrintedMesh(mesh, state, printer)))


class PrintedMesh(NamedTuple):
    """A whole mesh, its topology and volume, and the printer that is to print it."""

    mesh: Mesh
    topology: Topology
    printer: Printer


def _mesh_rules(printed: PrintedMesh) -> Iterator[Rule]:
    """Yield the rules of any mesh to be printed: closed, not inside out, one body, small enough for the bed."""
    mesh, state, printer = printed
    size = _size_mm(mesh)
    bed = (printer.bed_x_mm, printer.bed_y_mm, printer.bed_z_mm)
    small_enough = np.all(np.sort(size[:2]) <= np.sort(bed[:2])) and size[2] <= bed[2]
    measures, room = (" x ".join(map(number, each)) for each in (size, bed))
    first = _spot(*mesh.vertices_mm[state.first_broken].tolist()) if len(mesh.vertices_mm) else ""
    count = state.broken_edges
    edges = f"{count} edge{plural(count)} {'does' if count == 1 else 'do'} not join"
    broken = f"{edges} two triangles that agree which side is out, the first near {first}"
    yield Rule(
        state.closed,
        "mesh",
        f"it has a hole, or triangles doubled or turned over: {broken}; repair it in the slicer, or export it again",
        code="mesh.closed",
    )
    yield Rule(
        not state.closed or state.volume_mm3 > 0,
        "mesh",
        "the triangles face inwards; turn them all round",
        code="mesh.inside_out",
    )
    yield Rule(state.shells == 1, "mesh", f"it has {state.shells} separate bodies, must be 1", code="mesh.bodies")
    yield Rule(
        bool(small_enough),
        "mesh",
        f"it measures {measures} mm, the bed of {printer.name} is {room} mm",
        code="print.bed",
    )


MESH_RULES: RuleBook[PrintedMesh] = RuleBook("mesh", _mesh_rules)
"""Rules of every mesh, of whatever program; those that need a plan stand in the functions below."""


def _size_mm(mesh: Mesh) -> np.ndarray:
    return np.asarray(np.ptp(mesh.vertices_mm, axis=0) if len(mesh.vertices_mm) else np.zeros(3))


def _of_tiles(pad: PadSolid, plan: Plan, closed: bool) -> tuple[dict[str, Any], list[Finding]]:
    """Check the mesh of each distinct sub-cell and, if the pad is `closed`, a reduced pad with all of these."""
    findings: list[Finding] = []
    half = np.array([plan.cell.width_mm, plan.cell.depth_mm]) / 2
    for name, tile in zip([*(f"taxel {c.index}" for c in plan.channels), "frame"], pad.tiles, strict=True):
        findings += _pierced(tile.mesh, name)
        beyond = float((np.abs(tile.mesh.vertices_mm[:, :2]) - half).max())
        if beyond > BUILT_MM:
            sentence = f"it reaches {number(beyond)} mm out of its sub-cell, must be 0"
            findings.append(Finding("error", "mesh.cell", name, sentence))
    figures: dict[str, Any] = {"exact_volume_mm3": pad.volume_mm3, "measured_taxels": 0}
    if not closed:
        return figures, findings
    sample = sampled(plan, pad)
    mesh = sample.pad.mesh
    solid, refused = _manifold(mesh)
    if solid is None:
        return figures, [*findings, *refused]
    print_figures, printable_findings = _cached_printable(mesh, plan.spec.printer, sample.places)
    taxels = sample.plan.taxels
    dimensions = list(measured(sample.plan, solid))
    off_mm = [abs(d.built_mm - d.planned_mm) for d in dimensions]
    figures |= print_figures | {
        "measured_taxels": len(taxels),
        "largest_difference_from_plan_mm": max(filter(isfinite, off_mm), default=None),
        "measured_dimensions": len(dimensions),
    }
    off = [d for d, far_mm in zip(dimensions, off_mm, strict=True) if not far_mm <= BUILT_MM + d.facets_mm]
    return figures, [
        *findings,
        *printable_findings,
        *first_of_each_code(difference_findings(off, [], None)),
        *first_of_each_code(_washers_enter(plan.spec, washer_rooms(sample.plan, solid, taxels))),
        *first_of_each_code(broken_rules(_dimension_rules(plan.spec, dimensions))),
    ]


def _differing(mesh: Mesh, planned: Mesh, plan: Plan) -> tuple[bool, list[Finding]]:
    """Return whether all faces are those planned, and findings about where they differ."""
    loose, lost, snapped = unmatched_triangles(mesh, planned)
    if same_faces(snapped.corners_mm[loose], planned.corners_mm[lost]):
        return True, []
    cells = Cells.of(plan)
    reached = cells.within(np.concatenate([snapped.corners_mm[loose], planned.corners_mm[lost]]))
    one, refused = _manifold(snapped)
    other, _ = _manifold(planned)
    if one is None:
        return False, refused
    if reached.mean() < 0.5:
        room = cells.room(reached)
        one = one ^ room
        other = other ^ room
    names = set(np.array(cells.names)[reached].tolist())
    taxels = [taxel for taxel in plan.taxels if f"taxel {taxel.id}" in names]
    within_mm = [BUILT_MM, BUILT_MM + SMALLEST_MM]
    off = [d for d in measured(plan, one, taxels) if not abs(d.built_mm - d.planned_mm) <= within_mm[d.facets_mm > 0]]
    differing = differences(one, other)
    rooms = washer_rooms(plan, one, taxels)
    entering = _washers_enter(plan.spec, rooms, SMALLEST_MM)
    return False, [*first_of_each_code(difference_findings(off, differing, cells)), *first_of_each_code(entering)]


def as_built(size_mm: float) -> str:
    """Return a measured size in mm as text, such as '3.4568 mm', or 'missing' where it is not a number.

    >>> as_built(3.4567891), as_built(float("nan"))
    ('3.4568 mm', 'missing')
    """
    return f"{number(size_mm)} mm" if isfinite(size_mm) else "missing"


def difference_findings(off: list[Dimension], differing: list[Difference], cells: Cells | None) -> Iterator[Finding]:
    """Yield one finding per group of taxels (or other parts) that differ from the plan in the same way."""
    dimensions: dict[str, list[str]] = {}
    for d in off:
        text = f"{d.name} is {as_built(d.built_mm)}, planned are {number(d.planned_mm)} mm"
        dimensions.setdefault(d.where, []).append(text)
    largest: dict[str, Difference] = {}
    for each in differing:
        largest.setdefault(cells.name_at(*each.place_mm[:2]) if cells else "mesh", each)
    alike: dict[str, list[str]] = {}
    for where in dict.fromkeys([*largest, *dimensions]):
        piece = largest.get(where)
        sizes = (piece.more, f"{piece.volume_mm3:.2g}", np.round(piece.extent_mm, 2).tolist()) if piece else None
        alike.setdefault(str((dimensions.get(where, [])[:SAID], sizes)), []).append(where)
    for first, *others in alike.values():
        said = dimensions.get(first, [])[:SAID]
        if piece := largest.get(first):
            x, y, z = (number(round(v, 3)) for v in piece.place_mm)
            extent = " x ".join(number(round(v, 2)) for v in piece.extent_mm)
            what = "more than planned" if piece.more else "missing"
            said.append(f"{piece.volume_mm3:.2g} mm³ are {what} near ({x}, {y}, {z}) mm, over {extent} mm")
        if others:
            rest = " and others" if len(others) > AT_ONCE else ""
            said.append(f"so are {', '.join(others[:AT_ONCE])}{rest}")
        yield Finding("error", "built.planned", first, "; ".join(said))


def _washers_enter(spec: Spec, rooms: Iterable[tuple[str, float]], within_mm: float = 0.0) -> Iterator[Finding]:
    """Yield an error for each recess that prints too narrow for its washer or magnet.

    `rooms` are taxels and their free diameters in mm. The washer's diameter is the largest that its catalogue allows.
    `within_mm` is forgiven: other programs may cut a round face into coarser triangles.
    """
    printer = spec.printer
    washer = spec.washer_or_magnet
    laid_mm = 2 * printer.xy_compensation_mm + printer.hole_loss_mm
    needed_mm = washer.outer_diameter_mm + laid_mm
    least_mm = laid_mm + FACET_MM
    cure = f"; taxel.washer_clearance_mm = {at_least(least_mm)} would do"
    for taxel, room_mm in rooms:
        if not room_mm >= needed_mm - within_mm:
            yield Finding(
                "error",
                "washer.fit",
                f"taxel {taxel}",
                "the recess diameter between the sides of its polygon is"
                f" {as_built(room_mm)}, the {spec.mover.kind} {washer.name} of"
                f" {number(washer.outer_diameter_mm)} mm needs {number(needed_mm)} mm, as {printer.name} lays"
                f" {number(laid_mm)} mm into it{cure if spec.taxel.washer_clearance_mm < least_mm else ''}",
            )


def _dimension_rules(spec: Spec, dimensions: Iterable[Dimension]) -> Iterator[Rule]:
    """Yield the rules of measured dimensions: recesses deep enough, beams wide enough, heights in whole layers."""
    printer = spec.printer
    washer = spec.washer_or_magnet
    for d in dimensions:
        if not isfinite(d.built_mm):
            continue
        is_beam = d.name.endswith("thickness")
        is_recess = d.name == "recess depth"
        layers = (d.built_mm - printer.first_layer_mm) / printer.layer_mm + 1
        whole = max(round(layers), printer.smallest_beam_layers if is_beam else 1)
        off_mm = abs(layers - whole) * printer.layer_mm
        built = f"{d.name} is {number(d.built_mm)} mm"
        yield Rule(
            not is_recess or d.built_mm >= washer.thickness_mm,
            d.where,
            f"{built}, the {spec.mover.kind} {washer.name} needs {number(washer.thickness_mm)} mm",
            code="washer.fit",
        )
        yield Rule(
            not d.name.endswith("width") or d.built_mm >= printer.smallest_beam_mm - 1e-3,
            d.where,
            f"{built}, {printer.name} prints at least {number(printer.smallest_beam_mm)} mm",
            code="print.beam",
        )
        yield Rule(
            not (is_beam or is_recess) or off_mm <= BUILT_MM,
            d.where,
            f"{built}, not a whole number of layers; {number(printer.height_mm(whole))} mm would be",
            code="print.layers",
        )


def _pierced(mesh: Mesh, where: str = "mesh") -> Iterator[Finding]:
    try:
        pairs = intersecting_pairs(mesh)
    except GeometryError:
        yield replace(UNCOMPARED, where=where)
        return
    if len(pairs):
        least = "at least " if len(pairs) > MOST_FOUND else ""
        yield Finding(
            "error",
            "mesh.intersects",
            where,
            f"{least}{len(pairs)} pairs of triangles pierce each other, must be 0; the first near"
            f" {_spot(*mesh.corners_mm[pairs[0, 0]].mean(0).tolist())}",
        )


def check_part(
    what: str,
    code: str,
    built: Mesh,
    exact_mm3: float,
    spec: Spec,
    gauges_of: Callable[[Any], Iterable[Dimension]],
    mesh: Mesh | None = None,
) -> Report:
    """Return the report of a part printed beside the pad: of its `built` mesh, or of a `mesh` read from a file.

    `what` names it in messages and `code` in findings of sizes that are off; `gauges_of` measures its solid.
    """
    mesh = mesh or built
    report = check_mesh(mesh, spec.printer, spec.material.density_g_per_cm3)
    figures = {**report.figures, "exact_volume_mm3": exact_mm3}
    findings = [*report.findings, *volume_findings(report.figures["volume_mm3"], exact_mm3)]
    try:
        solid = as_manifold(mesh, what)
    except GeometryError:
        # check_mesh has reported it.
        return Report(figures, tuple(findings))
    if mesh is not built:
        differing = differences(solid, as_manifold(built, f"{what} as planned"))
        findings += first_of_each_code(difference_findings([], differing, None))
    gauges = list(gauges_of(solid))
    findings += first_of_each_code(off_findings(gauges, code))
    off = [abs(g.built_mm - g.planned_mm) for g in gauges if isfinite(g.built_mm) and not g.facets_mm]
    figures["largest_difference_from_plan_mm"] = max(off, default=None)
    figures["measured_dimensions"] = len(gauges)
    return Report(figures, tuple(findings))


def off_findings(gauges: Iterable[Dimension], code: str) -> Iterator[Finding]:
    """Yield an error with this code for each dimension of a part that is not as planned."""
    for gauge in gauges:
        within_mm = BUILT_MM + gauge.facets_mm
        if not abs(gauge.built_mm - gauge.planned_mm) <= within_mm:
            sentence = (
                f"its {gauge.name} is {as_built(gauge.built_mm)}, planned are {number(gauge.planned_mm)} mm within"
                f" {number(within_mm)} mm"
            )
            yield Finding("error", code, gauge.where, sentence)


def volume_findings(built: float, exact: float) -> Iterator[Finding]:
    """Yield an error if the `built` volume in mm³ differs from the `exact` one by more than `VOLUME_SHARE`."""
    if not abs(built / exact - 1) <= VOLUME_SHARE:
        yield Finding(
            "error",
            "mesh.volume",
            "mesh",
            f"its volume is {number(built)} mm³, the solids' is {number(exact)} mm³,"
            f" within {VOLUME_SHARE:.1%}; a finer chord would do",
        )


def _manifold(mesh: Mesh) -> tuple[Any, list[Finding]]:
    """Return the mesh as a manifold3d solid, or None and the finding that says why it is no manifold."""
    try:
        return as_manifold(mesh, "the mesh"), []
    except GeometryError as error:
        return None, [Finding("error", "mesh.manifold", "mesh", error.message)]


def _cached_printable(mesh: Mesh, printer: Printer, places: SampleShifts) -> tuple[dict[str, Any], list[Finding]]:
    """Return the result of `_printable` from the cache, or compute and store it; pads of equal taxels share it."""
    inputs = {
        "mesh": [sha256_hex(part.tobytes()) for part in mesh],
        "printer": asdict(printer),
        "places": places,
        "code": cache.code_hash(*CODE),
        "versions": [cache.version(name) for name in ("manifold3d", "numpy")],
    }
    key = cache.key_of(inputs)

    def known() -> tuple[dict[str, Any], list[Finding]] | None:
        try:
            figures, findings = cache.load(KIND, key)
            return dict(figures), [Finding(*each) for each in findings]
        except (TypeError, ValueError):  # absent, or of another form
            return None

    def measured_anew() -> tuple[dict[str, Any], list[Finding]]:
        figures, findings = _printable(mesh, printer, places)
        cache.store(KIND, key, (figures, [astuple(each) for each in findings]))
        return figures, findings

    return cache.get_or_compute(KIND, key, known, measured_anew)


def _printable(mesh: Mesh, printer: Printer, places: SampleShifts) -> tuple[dict[str, Any], list[Finding]]:
    """Measure walls, gaps, overhangs, skins and bridges; return figures and findings, with places in the pad."""
    solid, refused = _manifold(mesh)
    if solid is None:
        return {}, refused
    cuts = sections(solid, mesh)
    bound = 4 * max(printer.line_width_mm, printer.smallest_gap_mm)
    wall_mm, walls = narrow_places(cuts, False, bound, _thinnest_wall_mm(printer) - FACET_MM)
    gap_mm, gaps = narrow_places(cuts, True, bound, printer.smallest_gap_mm - FACET_MM)
    limit = printer.longest_bridge_mm
    span, place = longest_unsupported_span(solid, mesh, limit + 1.0)
    figures = {
        "smallest_wall_mm": wall_mm,
        "smallest_gap_mm": gap_mm,
        # Where one of the two is None, there is none below this width.
        "searched_below_mm": bound if cuts else None,
        "longest_bridge_mm": span,
    }
    wrong = [*_thin_walls(cuts, walls, printer), *_narrow_gaps(gaps, printer), *_overhangs(mesh, printer)]
    for thin in thin_skins(solid, mesh, printer.layer_mm):
        sentence = f"{number(thin.area_mm2)} mm² are thinner than a layer of {number(printer.layer_mm)} mm"
        wrong.append(("print.skin", thin, sentence))
    if place and span > limit:
        hangs = f"a face hangs free over {'at least ' if span > limit + 0.99 else ''}{number(span)} mm"
        wrong.append(("print.bridge", place, f"{hangs}, {printer.name} bridges {number(limit)} mm"))
    spots = [_spot(*places.in_pad(at.x_mm, at.y_mm), at.z_mm) for _, at, _ in wrong]
    findings = (Finding("error", code, spot, sentence) for spot, (code, _, sentence) in zip(spots, wrong, strict=True))
    return figures, list(first_of_each_code(findings))


def _thinnest_wall_mm(printer: Printer) -> float:
    return min(printer.line_width_mm, printer.smallest_beam_mm)


def _thin_walls(
    cuts: list[tuple[float, Any]], places: list[tuple[int, NarrowSpot]], printer: Printer
) -> Iterator[Wrong]:
    """Yield walls too thin to print."""
    limit = _thinnest_wall_mm(printer)
    for index, place in _lowest(places):
        least_mm, _ = narrow_places([cuts[index]], False, limit)
        least = "" if least_mm is None else f" (at this height down to {number(least_mm)} mm)"
        sentence = f"a wall is thinner than {number(limit)} mm, the least that {printer.name} lays{least}"
        yield "print.wall", place, sentence


def _narrow_gaps(places: list[tuple[int, NarrowSpot]], printer: Printer) -> Iterator[Wrong]:
    """Yield gaps too narrow to stay open."""
    limit = printer.smallest_gap_mm
    for _, place in _lowest(places):
        yield "print.gap", place, f"a gap is narrower than {number(limit)} mm, the least that {printer.name} keeps open"


def _lowest(places: list[tuple[int, NarrowSpot]]) -> Iterator[tuple[int, NarrowSpot]]:
    """Yield only the lowest of places that lie above one another."""
    seen: set[tuple[int, int]] = set()
    for index, place in places:
        near = round(place.x_mm / APART_MM), round(place.y_mm / APART_MM)
        if near not in seen:
            seen.add(near)
            yield index, place


def _overhangs(mesh: Mesh, printer: Printer) -> Iterator[Wrong]:
    corners = mesh.corners_mm
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    down = -normal[:, 2] / np.maximum(size, 1e-30)
    angle = np.degrees(np.arcsin(np.clip(down, -1, 1)))
    on_bed = corners[..., 2].max(1) < corners[..., 2].min(initial=np.inf) + printer.first_layer_mm
    steep = (angle > printer.steepest_overhang_deg + 0.1) & (angle < 89.9) & ~on_bed
    area = float(size[steep].sum() / 2)
    if area > printer.line_width_mm**2:
        worst = np.flatnonzero(steep)[angle[steep].argmax()]
        leans = f"{number(area)} mm² lean out by up to {number(float(angle[worst]))}°"
        sentence = f"{leans}, {printer.name} prints {number(printer.steepest_overhang_deg)}° without supports"
        x, y, z = corners[worst].mean(0).tolist()
        yield "print.overhang", NarrowSpot(x, y, z, area), sentence


def _spot(x_mm: float, y_mm: float, z_mm: float) -> str:
    return f"({number(x_mm)}, {number(y_mm)}, {number(z_mm)}) mm"


def first_of_each_code(findings: Iterable[Finding]) -> Iterator[Finding]:
    """Yield the first findings of each code, then one that says how many more there are."""
    of_code: dict[str, list[Finding]] = {}
    for finding in findings:
        of_code.setdefault(finding.code, []).append(finding)
    for code, listed in of_code.items():
        yield from listed[:AT_ONCE]
        if len(listed) > AT_ONCE:
            yield Finding(listed[-1].level, code, "elsewhere", f"{len(listed) - AT_ONCE} more like the last")
