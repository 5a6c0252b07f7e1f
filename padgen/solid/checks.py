"""Print checks: what a pad's final mesh must hold, as findings.

Checks of the mesh alone need a printer's limits; with a plan come those that compare what was built
with what was planned.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from math import isfinite
from typing import Any

import numpy as np

from padgen.core.errors import GeometryError, at_least, number
from padgen.core.finding import Finding
from padgen.planner.plan import Plan
from padgen.solid.measure import Dimension, measured, washer_rooms
from padgen.solid.mesh import Mesh, as_manifold, from_manifold, ordered
from padgen.solid.pad_solid import PadSolid
from padgen.solid.sections import Section, narrow_gaps, narrow_walls, sections, smallest, thin_skins, unsupported_spans
from padgen.solid.topology import MOST_FOUND, Topology, intersecting_pairs, topology
from padgen.spec import Printer, Spec

__all__ = ["Report", "check_mesh", "check_pad", "compare_mesh"]

BUILT_MM = 0.01
"""Largest difference of a built dimension from the planned one."""
VOLUME_SHARE = 1e-3
"""Largest relative difference of the mesh's volume from the exact one."""
FACET_MM = 0.012
"""What triangles may take off a wall or gap between round faces: the chord, on both sides."""
UNCOMPARED = Finding(
    "error", "mesh.intersects", "mesh", "too many of its triangles lie over each other for all of them to be compared"
)
MOST_BODIES = 100
"""Bodies of a mesh whose walls are looked at: with more it is no pad."""
AT_ONCE = 5
"""Findings of one kind that are listed; the last says how many more there are."""


@dataclass(frozen=True)
class Report:
    """The findings of all checks and the figures they measured."""

    figures: dict[str, Any]
    findings: tuple[Finding, ...]


def check_mesh(mesh: Mesh, printer: Printer, density_g_per_cm3: float) -> Report:
    """The checks that need no plan, against the limits of `printer`."""
    state = topology(mesh)
    figures = _shape_figures(mesh, state, density_g_per_cm3)
    pierced = list(_pierced(mesh))
    findings = [*_closed(state), *_one_body(state), *pierced, *_on_bed(mesh, printer)]
    # Of a mesh that lies in itself a thousandfold, cross-sections would take hours and tell nothing.
    if state.closed and state.volume_mm3 > 0 and state.shells <= MOST_BODIES and UNCOMPARED not in pierced:
        solid, refused = _manifold(mesh)
        findings += refused
        if solid is not None:
            cuts = sections(solid, mesh)
            findings += [*_walls_and_gaps(cuts, printer), *_overhangs(mesh, printer)]
            smallest_figures, narrow = _narrowest(cuts, solid, mesh, printer)
            figures, findings = figures | smallest_figures, findings + narrow
    return Report(figures, tuple(findings))


def check_pad(pad: PadSolid, plan: Plan) -> Report:
    """All checks of a pad that was built from `plan`.

    What one coil's cell can tell is looked for there once, since all cells are alike: pierced
    triangles (a tile cannot leave its sub-cell), spans and the smallest widths. Everything that a
    seam or a lost taxel could break is looked for in the whole pad.
    """
    spec = plan.spec
    state = topology(pad.mesh)
    figures = _shape_figures(pad.mesh, state, spec.material.density_g_per_cm3)
    findings = [*_closed(state), *_one_body(state), *_on_bed(pad.mesh, spec.printer)]
    for name, tile in zip([*(f"taxel {c.index}" for c in plan.channels), "frame"], pad.tiles, strict=True):
        findings += [*_pierced(tile.mesh, name), *_within_cell(tile.mesh, plan, name)]
    findings += _volume(state.volume_mm3, pad.volume_mm3)
    figures["exact_volume_mm3"] = pad.volume_mm3
    if state.closed:
        solid, refused = _manifold(pad.mesh)
        findings += refused
        if solid is not None:
            findings += _walls_and_gaps(sections(solid, pad.mesh), spec.printer)
            findings += _overhangs(pad.mesh, spec.printer)
            findings += compare(plan, solid, figures)
            cell = ordered(from_manifold(_one_cell(plan, solid)))
            smallest_figures, narrow = _narrowest_of_cell(
                cell.vertices_mm.tobytes(), cell.triangles.tobytes(), spec.printer
            )
            figures, findings = figures | smallest_figures, findings + narrow
    return Report(figures, tuple(findings))


def compare_mesh(report: Report, mesh: Mesh, plan: Plan) -> Report:
    """Add to the `report` on a mesh what its comparison with `plan` finds; it must lie as it was built."""
    solid, _ = _manifold(mesh) if topology(mesh).closed else (None, [])
    if solid is None:
        return report
    figures = dict(report.figures)
    return Report(figures, (*report.findings, *compare(plan, solid, figures)))


def compare(plan: Plan, solid: Any, figures: dict[str, Any]) -> list[Finding]:
    """Built against planned, for every taxel; adds the largest difference to `figures`."""
    spec = plan.spec
    dimensions = list(measured(plan, solid))
    gaps = [abs(d.built_mm - d.planned_mm) for d in dimensions]
    finite = [gap for gap in gaps if isfinite(gap)]
    figures["largest_difference_from_plan_mm"] = max(finite, default=None)
    figures["measured_dimensions"] = len(dimensions)
    return [
        *_few(_differs(d) for d in dimensions if not abs(d.built_mm - d.planned_mm) <= BUILT_MM + d.facets_mm),
        *_few(_washers_enter(spec, washer_rooms(plan, solid))),
        *_few(_washers_sink_in(spec, dimensions)),
        *_few(_lines_and_layers(spec.printer, dimensions)),
    ]


def _differs(dimension: Dimension) -> Finding:
    built = f"{number(dimension.built_mm)} mm" if isfinite(dimension.built_mm) else "missing"
    return Finding(
        "error",
        "built.planned",
        f"taxel {dimension.taxel}",
        f"{dimension.name} is {built}, planned are {number(dimension.planned_mm)} mm within"
        f" {number(BUILT_MM + dimension.facets_mm)} mm",
    )


def _washers_enter(spec: Spec, rooms: Iterable[tuple[str, float]]) -> Iterator[Finding]:
    """Catalogues give the largest diameter that a washer may have."""
    printer, washer = spec.printer, spec.washer
    laid_mm = 2 * printer.xy_compensation_mm + printer.hole_loss_mm
    needed_mm, least_mm = washer.outer_diameter_mm + laid_mm, laid_mm + FACET_MM
    cure = f"; taxel.washer_clearance_mm = {at_least(least_mm)} would do"
    for taxel, room_mm in rooms:
        if not room_mm >= needed_mm:
            room = f"{number(room_mm)} mm" if isfinite(room_mm) else "missing"
            yield Finding(
                "error",
                "washer.fit",
                f"taxel {taxel}",
                f"the recess diameter between the sides of its polygon is {room}, the washer {washer.name} of"
                f" {number(washer.outer_diameter_mm)} mm needs {number(needed_mm)} mm, as {printer.name} lays"
                f" {number(laid_mm)} mm into it{cure if spec.taxel.washer_clearance_mm < least_mm else ''}",
            )


def _washers_sink_in(spec: Spec, dimensions: Iterable[Dimension]) -> Iterator[Finding]:
    for d in dimensions:
        if d.name == "recess depth" and not d.built_mm >= spec.washer.thickness_mm:
            yield Finding(
                "error",
                "washer.fit",
                f"taxel {d.taxel}",
                f"{d.name} is {number(d.built_mm)} mm, the washer {spec.washer.name} needs"
                f" {number(spec.washer.thickness_mm)} mm",
            )


def _lines_and_layers(printer: Printer, dimensions: Iterable[Dimension]) -> Iterator[Finding]:
    for d in dimensions:
        if d.name.endswith("width") and d.built_mm < printer.smallest_beam_mm - 1e-3:
            yield Finding(
                "error",
                "print.beam",
                f"taxel {d.taxel}",
                f"{d.name} is {number(d.built_mm)} mm, {printer.name} prints at least"
                f" {number(printer.smallest_beam_mm)} mm",
            )
        is_beam = d.name.endswith("thickness")
        if (is_beam or d.name == "recess depth") and isfinite(d.built_mm):
            layers = (d.built_mm - printer.first_layer_mm) / printer.layer_mm + 1
            whole = max(round(layers), printer.smallest_beam_layers if is_beam else 1)
            if abs(layers - whole) * printer.layer_mm > BUILT_MM:
                nearest = printer.height_mm(whole)
                yield Finding(
                    "error",
                    "print.layers",
                    f"taxel {d.taxel}",
                    f"{d.name} is {number(d.built_mm)} mm, not a whole number of layers; {number(nearest)} mm would be",
                )


def _shape_figures(mesh: Mesh, state: Topology, density_g_per_cm3: float) -> dict[str, Any]:
    size = np.ptp(mesh.vertices_mm, axis=0) if len(mesh.vertices_mm) else np.zeros(3)
    return {
        "triangles": len(mesh.triangles),
        "size_mm": [round(float(v), 4) for v in size],
        "volume_mm3": state.volume_mm3,
        "plastic_g": state.volume_mm3 * 1e-3 * density_g_per_cm3,
        "bodies": state.shells,
    }


def _closed(state: Topology) -> Iterator[Finding]:
    for count, what in (
        (state.open_edges, "edges have a triangle on one side only"),
        (state.crowded_edges, "edges join more than two triangles"),
        (state.turned_edges, "edges join triangles that disagree which side is out"),
    ):
        if count:
            yield Finding("error", "mesh.closed", "mesh", f"{count} {what}, must be 0")
    if state.closed and state.volume_mm3 <= 0:
        yield Finding("error", "mesh.inside_out", "mesh", "the triangles face inwards; turn them all round")


def _one_body(state: Topology) -> Iterator[Finding]:
    if state.shells != 1:
        yield Finding("error", "mesh.bodies", "mesh", f"it has {state.shells} separate bodies, must be 1")


def _pierced(mesh: Mesh, where: str = "mesh") -> Iterator[Finding]:
    try:
        pairs = intersecting_pairs(mesh)
    except GeometryError:
        yield replace(UNCOMPARED, where=where)
        return
    if len(pairs):
        x, y, z = (number(float(v)) for v in mesh.corners_mm[pairs[0, 0]].mean(0))
        least = "at least " * (len(pairs) > MOST_FOUND)
        yield Finding(
            "error",
            "mesh.intersects",
            where,
            f"{least}{len(pairs)} pairs of triangles pierce each other, must be 0; the first near ({x}, {y}, {z}) mm",
        )


def _within_cell(mesh: Mesh, plan: Plan, where: str) -> Iterator[Finding]:
    half = np.array([plan.cell.width_mm, plan.cell.depth_mm]) / 2
    beyond = float((np.abs(mesh.vertices_mm[:, :2]) - half).max())
    if beyond > BUILT_MM:
        yield Finding("error", "mesh.cell", where, f"it reaches {number(beyond)} mm out of its sub-cell, must be 0")


def _on_bed(mesh: Mesh, printer: Printer) -> Iterator[Finding]:
    if not len(mesh.vertices_mm):
        return
    size = np.ptp(mesh.vertices_mm, axis=0)
    bed = (printer.bed_x_mm, printer.bed_y_mm, printer.bed_z_mm)
    if np.any(np.sort(size[:2]) > np.sort(bed[:2])) or size[2] > bed[2]:
        yield Finding(
            "error",
            "print.bed",
            "mesh",
            f"it measures {number(size[0])} x {number(size[1])} x {number(size[2])} mm, the bed of {printer.name} is"
            f" {number(bed[0])} x {number(bed[1])} x {number(bed[2])} mm",
        )


def _volume(built: float, exact: float) -> Iterator[Finding]:
    if abs(built / exact - 1) > VOLUME_SHARE:
        yield Finding(
            "error",
            "mesh.volume",
            "mesh",
            f"its volume is {number(built)} mm³, the solids' is {number(exact)} mm³,"
            f" within {VOLUME_SHARE:.1%}; a finer chord would do",
        )


def _manifold(mesh: Mesh) -> tuple[Any, list[Finding]]:
    try:
        return as_manifold(mesh, "the mesh"), []
    except GeometryError as error:
        return None, [Finding("error", "mesh.manifold", "mesh", error.message)]


def _walls_and_gaps(cuts: list[Section], printer: Printer) -> list[Finding]:
    return [*_few(_walls(cuts, printer)), *_few(_gaps(cuts, printer))]


def _walls(cuts: list[Section], printer: Printer) -> Iterator[Finding]:
    limit = min(printer.line_width_mm, printer.smallest_beam_mm)
    for cut in cuts:
        places = narrow_walls(cut, limit - FACET_MM)
        thinnest = smallest(cut, False, limit) if places else limit
        for place in places:
            yield Finding(
                "error",
                "print.wall",
                f"({number(place.x_mm)}, {number(place.y_mm)}, {number(place.z_mm)}) mm",
                f"a wall is thinner than {number(limit)} mm, the least that {printer.name} lays (at this height down to"
                f" {number(thinnest)} mm)",
            )


def _gaps(cuts: list[Section], printer: Printer) -> Iterator[Finding]:
    for cut in cuts:
        for place in narrow_gaps(cut, printer.smallest_gap_mm - FACET_MM):
            yield Finding(
                "error",
                "print.gap",
                f"({number(place.x_mm)}, {number(place.y_mm)}, {number(place.z_mm)}) mm",
                f"a gap is narrower than {number(printer.smallest_gap_mm)} mm, the least that {printer.name}"
                " keeps open",
            )


def _overhangs(mesh: Mesh, printer: Printer) -> Iterator[Finding]:
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
        x, y, z = (number(float(v)) for v in corners[worst].mean(0))
        yield Finding(
            "error",
            "print.overhang",
            f"({x}, {y}, {z}) mm",
            f"{number(area)} mm² lean out by up to {number(float(angle[worst]))}°, {printer.name} prints"
            f" {number(printer.steepest_overhang_deg)}° without supports",
        )


def _one_cell(plan: Plan, solid: Any) -> Any:
    """The part of the pad over the first coil, which has all channels, and over its neighbour where it has others."""
    import manifold3d

    coils, size = plan.coils, plan.spec.pad
    low = (-coils.columns * coils.pitch_x_mm / 2, -coils.rows * coils.pitch_y_mm / 2, -1.0)
    height = size.frame_thickness_mm + plan.spec.taxel.boss_protrusion_mm + 2
    wide, deep = (coils.sets, 1) if coils.columns > 1 else (1, coils.sets)
    room = manifold3d.Manifold.cube((wide * coils.pitch_x_mm, deep * coils.pitch_y_mm, height)).translate(low)
    return solid ^ room


@lru_cache(maxsize=64)
def _narrowest_of_cell(vertices_mm: bytes, triangles: bytes, printer: Printer) -> tuple[dict[str, Any], list[Finding]]:
    """`_narrowest` of a mesh in order: variants of a layout have the same cell."""
    corners, sides = np.frombuffer(vertices_mm).copy(), np.frombuffer(triangles, np.int64)
    mesh = Mesh(corners.reshape(-1, 3), sides.reshape(-1, 3))
    solid = as_manifold(mesh, "one cell of the mesh")
    return _narrowest(sections(solid, mesh), solid, mesh, printer)


def _narrowest(cuts: list[Section], solid: Any, mesh: Mesh, printer: Printer) -> tuple[dict[str, Any], list[Finding]]:
    """The smallest wall and gap and the longest span, and what is found about skins and the span."""
    bound = 4 * max(printer.line_width_mm, printer.smallest_gap_mm)
    limit = printer.longest_bridge_mm
    span, place = unsupported_spans(solid, mesh, limit + 1.0)
    figures = {
        "smallest_wall_mm": min((smallest(cut, False, bound) for cut in cuts), default=None),
        "smallest_gap_mm": min((smallest(cut, True, bound) for cut in cuts), default=None),
        "longest_bridge_mm": span,
    }
    findings = list(_few(_skins(solid, mesh, printer)))
    if place and span > limit:
        at_least = "at least " if span > limit + 0.99 else ""
        findings.append(
            Finding(
                "error",
                "print.bridge",
                f"({number(place.x_mm)}, {number(place.y_mm)}, {number(place.z_mm)}) mm",
                f"a face hangs free over {at_least}{number(span)} mm, {printer.name} bridges {number(limit)} mm",
            )
        )
    return figures, findings


def _skins(solid: Any, mesh: Mesh, printer: Printer) -> Iterator[Finding]:
    for place in thin_skins(solid, mesh, printer.layer_mm):
        yield Finding(
            "error",
            "print.skin",
            f"({number(place.x_mm)}, {number(place.y_mm)}, {number(place.z_mm)}) mm",
            f"{number(place.area_mm2)} mm² are thinner than a layer of {number(printer.layer_mm)} mm",
        )


def _few(findings: Iterable[Finding]) -> Iterator[Finding]:
    """The first findings of a kind, and how many more there are."""
    listed = list(findings)
    yield from listed[:AT_ONCE]
    if len(listed) > AT_ONCE:
        last = listed[-1]
        yield Finding(last.level, last.code, "elsewhere", f"{len(listed) - AT_ONCE} more like the last")
