"""Parts beside the pad, made on request: the coil tray, the coupon, and a tray for the coupon's coil.

Each is modelled, checked and saved like the pad itself. The coupon is a small pad with a groove beside channel 0. The
tray is three extruded layers, fused (`padgen.planner.fixtures` draws its section); its dimensions are compared with the
plan. The bill of materials counts the pad and these parts. A mesh file that any program may have written is recognised
as one of them, and judged.
"""

import io
import logging
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import product
from math import isfinite, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from padgen.core.errors import Finding, GeometryError, InfeasibleError, MeshFileError, number
from padgen.core.files import read_as_one, read_bounded, reason
from padgen.planner.ballast import ballast_size
from padgen.planner.drive_rows import table_csv
from padgen.planner.fixtures import (
    Tray,
    board_parts,
    coupon_groove,
    coupon_plan,
    plan_tray,
    tray_findings,
)
from padgen.planner.plan import Plan
from padgen.solid.checks import (
    BUILT_MM,
    Report,
    check_against,
    check_mesh,
    check_pad,
    difference_findings,
    first_of_each_code,
    off_findings,
    volume_findings,
)
from padgen.solid.compare import Pose, differences, pose_of
from padgen.solid.formats import Part
from padgen.solid.formats._3mf import LARGEST_FILE, MOST_TRIANGLES, read_3mf
from padgen.solid.guard_plate import GuardSolid, build_guard, check_guard, free_diameter
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.measure import Dimension, holes_of, ray_distance_mm
from padgen.solid.mesh import ROUND_MM, Mesh, as_manifold, sound_mesh, tessellated
from padgen.solid.pad_solid import PadSolid, build_pad
from padgen.solid.spacer import SpacerSolid, build_spacer, check_spacer
from padgen.solid.taxel import box, only_solid, pad_outline
from padgen.spec import Coil, PadTable, Spec

__all__ = [
    "TraySolid",
    "bill_of_materials",
    "build_coupon",
    "build_part",
    "build_tray",
    "check_foreign",
    "check_tray",
    "measured_tray",
    "read_mesh",
    "tray_solid",
]


@dataclass(frozen=True)
class TraySolid:
    """A coil tray: its plan, its triangles, its build123d solid and the solid's exact volume."""

    tray: Tray
    mesh: Mesh
    volume_mm3: float
    solid: Any


PartSolid = PadSolid | TraySolid | GuardSolid | SpacerSolid


def build_tray(plan: Plan) -> TraySolid:
    """Build the tray for the coils of `plan`.

    Raises
    ------
    InfeasibleError
        See `padgen.planner.fixtures.plan_tray`.
    GeometryError
        A kernel refused a part.
    """
    return tray_solid(plan_tray(plan), plan.spec.pad)


def tray_solid(tray: Tray, pad: PadTable) -> TraySolid:
    """Build the solid of a `tray` with the outline of `pad`."""
    b = build123d()
    with kernel_errors("the coil tray"):
        seats = [b.Wire.make_circle(tray.seat_hole_mm / 2, b.Plane((x, y, 0))) for x, y in tray.coils_mm]
        sockets = [_socket(tray, x, y) for x, y in tray.coils_mm]
        outside = pad_outline(pad)
        layers = []
        for holes, low, high in (
            (seats, 0.0, tray.floor_mm),
            (sockets, tray.floor_mm, tray.socket_top_mm),
            ([b.Wire.make_rect(pad.width_mm, pad.depth_mm)], tray.socket_top_mm, tray.height_mm),
        ):
            layer = b.Solid.extrude(b.Face(outside, holes), b.Vector(0, 0, high - low))
            layers.append(layer.moved(b.Location((0, 0, low))))
        floor, block, rim = layers
        walls = rim.cut(*(box(slot, tray.height_mm, tray.socket_top_mm) for slot in tray.wire_slots))
        cuts = [box(tray.groove, tray.height_mm)]
        screw = tray.screw
        if screw:
            low = tray.height_mm - screw.hole_depth_mm
            radius = screw.hole_diameter_mm / 2
            holes = [b.Plane((x, y, low)) for x, y in tray.holes_mm]
            cuts += [b.Solid.make_cylinder(radius, screw.hole_depth_mm, plane) for plane in holes]
        solid = only_solid(floor.fuse(block, *walls.solids()).cut(*cuts), "the coil tray")
    return TraySolid(tray, tessellated(solid), float(solid.volume), solid)


def _socket(tray: Tray, x: float, y: float) -> Any:
    """Return a coil socket's outline, a build123d wire: a circle with a slot for the leads towards +x +y."""
    b = build123d()
    radius = tray.socket_diameter_mm / 2
    half = tray.lead.width_mm / 2
    mouth = sqrt(radius**2 - half**2)
    end = radius + tray.lead.reach_mm

    def at(along: float, across: float) -> Any:
        turn = sqrt(0.5)
        return b.Vector(x + turn * (along - across), y + turn * (along + across))

    (wire,) = b.Wire.combine(
        [
            b.Edge.make_three_point_arc(at(mouth, half), at(-radius, 0.0), at(mouth, -half)),
            b.Edge.make_line(at(mouth, -half), at(end, -half)),
            b.Edge.make_line(at(end, -half), at(end, half)),
            b.Edge.make_line(at(end, half), at(mouth, half)),
        ]
    )
    return wire


SEAT_RAYS = 3
COIL_SIDES = 64
BLOCKED_MM3 = 1e-3


def check_tray(built: TraySolid, plan: Plan, mesh: Mesh | None = None) -> Report:
    """Return the report of all checks of the coil tray of `plan`: of its own mesh, or of a `mesh` read from a file.

    The figures are those of the mesh, and the gap that was measured.
    """
    spec = plan.spec
    tray = built.tray
    mesh = mesh or built.mesh
    report = check_mesh(mesh, spec.printer, spec.material.density_g_per_cm3)
    figures = {**report.figures, "exact_volume_mm3": built.volume_mm3}
    findings = [
        *tray_findings(plan, tray),
        *report.findings,
        *volume_findings(report.figures["volume_mm3"], built.volume_mm3),
    ]
    try:
        solid = as_manifold(mesh, "the tray")
    except GeometryError:
        # check_mesh has reported it.
        return Report(figures, tuple(findings))
    if mesh is not built.mesh:
        differing = differences(solid, as_manifold(built.mesh, "the tray as planned"))
        findings += first_of_each_code(difference_findings([], differing, None))
    gauges = list(measured_tray(tray, spec, solid))
    findings += [
        *first_of_each_code(off_findings(gauges, "tray.built")),
        *_gap(plan, gauges, figures),
        *_free(tray, spec, mesh, solid),
    ]
    off = [abs(g.built_mm - g.planned_mm) for g in gauges if isfinite(g.built_mm) and not g.facets_mm]
    figures["largest_difference_from_plan_mm"] = max(off, default=None)
    figures["measured_dimensions"] = len(gauges)
    return Report(figures, tuple(findings))


def measured_tray(tray: Tray, spec: Spec, solid: Any) -> Iterator[Dimension]:
    """Yield planned and measured diameters, heights and depths of a tray's sockets, seats, rim and screw holes.

    A diameter is that of the largest circle about the planned axis that holds no material. A height is where a ray
    from above ends; a seat's is measured at several places about the axis.
    """
    sockets = holes_of(solid, (tray.floor_mm + tray.socket_top_mm) / 2)
    # On a coil's seat, half way between the seat's hole and the coil's rim.
    angles = 2 * np.pi * np.arange(SEAT_RAYS) / SEAT_RAYS
    seat_mm = (tray.seat_hole_mm + spec.coil.outer_diameter_mm) / 4 * np.stack([np.cos(angles), np.sin(angles)], -1)
    for x, y in tray.coils_mm:
        where = f"the socket at ({number(x)}, {number(y)}) mm"
        yield Dimension(where, "socket diameter", tray.socket_diameter_mm, free_diameter(sockets, x, y), ROUND_MM)
        for at in (seat_mm + np.array([x, y])).tolist():
            yield Dimension(where, "seat height", tray.floor_mm, _top(solid, tray, *at))
    # Two places on each side of the rim, near the corners.
    pad = spec.pad
    off_x = (pad.width_mm + pad.border_mm) / 2
    off_y = (pad.depth_mm + pad.border_mm) / 2
    for side, along in product((-1, 1), (-1, 1)):
        for x, y in ((along * 0.49 * pad.width_mm, side * off_y), (side * off_x, along * 0.49 * pad.depth_mm)):
            where = f"the rim at ({number(x)}, {number(y)}) mm"
            yield Dimension(where, "rim height", tray.height_mm, _top(solid, tray, x, y))
    if tray.screw is None:
        return
    bores = holes_of(solid, tray.height_mm - tray.screw.hole_depth_mm / 2)
    for x, y in tray.holes_mm:
        where = f"the screw hole at ({number(x)}, {number(y)}) mm"
        yield Dimension(where, "hole diameter", tray.screw.hole_diameter_mm, free_diameter(bores, x, y), ROUND_MM)
        bottom = np.nan_to_num(_top(solid, tray, x, y))
        yield Dimension(where, "hole depth", tray.screw.hole_depth_mm, float(tray.height_mm - bottom))


def _top(solid: Any, tray: Tray, x: float, y: float) -> float:
    """Return the height in mm of the tray's highest face at a place, nan where there is none."""
    high = tray.height_mm + 1.0
    return high - ray_distance_mm(solid, (x, y, high), (x, y, -1.0))


def _gap(plan: Plan, gauges: list[Dimension], figures: dict[str, Any]) -> Iterator[Finding]:
    """Yield an error if a tray's measured seats and rim give a wrong coil-to-washer gap; put the gap into `figures`.

    It is measured on the mesh. It may differ from the spec's gap by half a layer (which `tray_findings` reports) and by
    `BUILT_MM`.
    """
    spec = plan.spec
    seat = np.array([g.built_mm for g in gauges if g.name == "seat height"])
    rim = np.array([g.built_mm for g in gauges if g.name == "rim height"])
    offset = plan.spec.mover_low_mm - spec.coil.length_mm
    low = float(rim.min() - seat.max()) + offset
    high = float(rim.max() - seat.min()) + offset
    figures["gap_mm"] = [low, high]
    within = spec.printer.layer_mm / 2 + BUILT_MM
    worst = low if not abs(low - spec.coil.gap_mm) <= abs(high - spec.coil.gap_mm) else high
    if not abs(worst - spec.coil.gap_mm) <= within:
        yield Finding(
            "error",
            "tray.gap",
            "mesh",
            f"its sockets give a gap of {number(worst) + ' mm' if isfinite(worst) else 'unknown size'}, planned are"
            f" {number(spec.coil.gap_mm)} mm within {number(within)} mm",
        )


def _free(tray: Tray, spec: Spec, mesh: Mesh, solid: Any) -> Iterator[Finding]:
    """Yield an error for each place in a tray that must be empty but is not: coil, room under the pad, wire slot."""
    import manifold3d

    pad = spec.pad
    radius = spec.coil.outer_diameter_mm / 2
    low = tray.floor_mm + BUILT_MM
    coil = manifold3d.Manifold.cylinder(tray.coil_top_mm - low, radius, radius, COIL_SIDES)
    coils = manifold3d.Manifold.compose([coil.translate((x, y, low)) for x, y in tray.coils_mm])
    blocked = [part for part in (coils ^ solid).decompose() if part.volume() > BLOCKED_MM3]
    if blocked:
        box_mm = np.reshape(blocked[0].bounding_box(), (2, 3))
        where = f"({', '.join(map(number, box_mm.mean(0)))}) mm"
        sentence = f"material lies where a coil stands; {len(blocked)} such places, must be 0"
        yield Finding("error", "tray.coil", where, sentence)
    x, y, z = mesh.vertices_mm.T
    inside = (np.abs(x) < pad.width_mm / 2 - BUILT_MM) & (np.abs(y) < pad.depth_mm / 2 - BUILT_MM)
    highest = float(z[inside].max(initial=0.0))
    if highest > tray.coil_top_mm + BUILT_MM:
        sentence = (
            f"under the pad it rises to {number(highest)} mm, the coils' tops are at {number(tray.coil_top_mm)} mm"
        )
        yield Finding("error", "tray.room", "mesh", sentence)
    for slot in tray.wire_slots:
        middle = np.array([slot.x0 + slot.x1, slot.y0 + slot.y1, tray.socket_top_mm + tray.height_mm]) / 2
        # A ray along the middle of a slot, from end to end, does not meet the tray.
        along_y = abs(middle[1]) > pad.depth_mm / 2
        half = np.array([0.0, slot.y1 - slot.y0, 0.0] if along_y else [slot.x1 - slot.x0, 0.0, 0.0]) / 2
        if isfinite(ray_distance_mm(solid, middle - half, middle + half)):
            where = f"the slot at ({number(middle[0])}, {number(middle[1])}) mm"
            yield Finding("error", "tray.wires", where, "no wire passes from the sockets to the outside")


def build_coupon(plan: Plan) -> tuple[Plan, PadSolid]:
    """Return the coupon's plan, against which the coupon is checked, and the coupon's solid.

    Raises
    ------
    GeometryError
        A kernel refused a part.
    """
    coupon = coupon_plan(plan)
    return coupon, build_pad(coupon, groove=coupon_groove(coupon))


def build_part(plan: Plan, name: str) -> Part:
    """Model and check the part of `plan` with this name, one of `padgen.make.pad.PARTS`.

    Raises
    ------
    InfeasibleError
        The plan's coils do not fit a tray, or the spec has no such part.
    GeometryError
        A kernel refused the part.
    """
    if name == "coupon":
        coupon, pad = build_coupon(plan)
        use = "one taxel of each channel, to be printed beside the pad and measured"
        return Part(name, coupon.name, use, pad.mesh, None, check_pad(pad, coupon))
    if name == "guard":
        if not plan.spec.guard.thickness_mm:
            raise InfeasibleError(
                "the spec has no guard plate; guard.thickness_mm = 1 (usual) would give it one", "--parts"
            )
        guard = build_guard(plan)
        use = "lies on the pad, a hole round each pin, and bears the hand"
        return Part(name, guard.guard.name, use, guard.mesh, guard.solid, check_guard(guard, plan))
    if name == "spacer":
        spacer = build_spacer(plan)
        use = "lies between board and pad, and keeps the coils at their gap"
        return Part(name, spacer.spacer.name, use, spacer.mesh, spacer.solid, check_spacer(spacer, plan))
    of_coupon = name == "coupon-tray"
    over = coupon_plan(plan) if of_coupon else plan
    tray = build_tray(over)
    use = "holds one coil of each kind under the coupon" if of_coupon else "holds the coils under the pad"
    return Part(name, tray.tray.name, use, tray.mesh, tray.solid, check_tray(tray, over))


def bill_of_materials(plan: Plan, plastic_g: float, parts_g: Mapping[str, float] | None = None) -> str:
    """Return the bill of materials as CSV text.

    `plastic_g` is the pad's plastic in g; `parts_g` that of parts printed beside the pad, by name.
    """
    spec = plan.spec
    coils = plan.coils.rows * plan.coils.columns
    washer = spec.washer_or_magnet
    coil = spec.coil
    pad = spec.pad
    screws = f"for {number(pad.hole_diameter_mm)} mm holes"
    if "tray" in (parts_g or {}):
        screw = plan_tray(plan).screw
        screws = f"{screw.name} x {number(screw.length_mm)} mm {screws}" if screw else screws
    pins = "'s pins on the board" if coil.kind == "board" else ""
    amplifier = spec.amplifier
    load = plan.load
    parts = plan.parts
    some = (
        f"{amplifier.name}: {amplifier.channels} channels"
        if amplifier
        else "; or ".join(f"{n} x {name}" for name, n in parts.amplifiers.items())
    )
    card = spec.sound_card
    cards = (
        f"{card.name}: {card.channels} outputs"
        if card
        else "; or ".join((*parts.sound_cards, "a board with as many converters"))
    )
    asked = f"{number(load.voltage_peak_v)} V and {number(load.current_peak_ma)} mA peak each"
    glue_mg = f", {number(spec.taxel.glue_mg)} mg each" if spec.taxel.glue_mg else ""
    bore = f"{number(washer.inner_diameter_mm)} x " if washer.inner_diameter_mm else ""
    grade = f", {spec.magnet.grade.upper()}, magnetised along its axis" if spec.magnet else ""
    if spec.magnet and pad.hole_diameter_mm:
        screws += ": brass, nylon or A2, since magnets draw steel ones"
    if spec.magnet and spec.magnet.polarity == "alternating":
        grade += ", north up and down from coil to coil"
    rows = [
        (
            spec.mover.kind,
            len(plan.taxels),
            "pieces",
            f"{washer.name}: {number(washer.outer_diameter_mm)} x {bore}{number(washer.thickness_mm)} mm{grade}",
        ),
        *([("ballast", len(plan.taxels), "pieces", ballast_size(spec.ballast))] if spec.ballast else []),
        _coil_row(coil, coils),
        *board_parts(plan),
        ("plastic", f"{plastic_g:.2f}", "g", f"pad: {spec.material.name} on {spec.printer.name}"),
        *(("plastic", f"{grams:.2f}", "g", f"{name}: at full infill") for name, grams in (parts_g or {}).items()),
        ("screw", 4 if pad.hole_diameter_mm else 0, "pieces", screws),
        ("amplifier channel", coils, "pieces", f"{asked}{'' if some == '' else f' ({some})'}"),
        ("sound card", 1, "pieces", f"{coils} outputs: {cards}"),
        (
            "wire",
            2 * coils,
            "leads",
            f"two from each coil{pins} to its amplifier channel: {number(load.current_rms_ma)} mA rms",
        ),
        ("glue", len(plan.taxels), "drops", f"one under each {spec.mover.kind}{glue_mg}"),
    ]
    return table_csv(("item", "quantity", "unit", "what"), rows)


def _coil_row(coil: Coil, count: int) -> tuple[str, int, str, str]:
    """Return the bill of materials' row for `count` coils: wound coils, or the board that they are printed on."""
    figures = f"{number(coil.resistance_ohm)} ohm {number(coil.inductance_mh)} mH"
    if coil.kind == "board":
        what = f"{count} coils of {coil.size_text} on {coil.layers} layers, {figures} each"
        return "board", 1, "pieces", f"{what}; padgen build --formats board makes its files"
    size = f"{number(coil.outer_diameter_mm)} mm diameter {number(coil.length_mm)} mm long"
    return "coil", count, "pieces", f"{coil.name}: {size} {figures}"


# Loaders log tracebacks of what they pass over, such as normals that are no numbers; without a handler Python prints
# them. Programs that use padgen and set up logging still get them.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

LEAST_LIKENESS = 0.2
"""Least likeness of a mesh to a part (share of the part's corners found, less the difference in size)."""
SURE_LIKENESS = {"pad": 0.999, "coupon": 0.5, "guard": 0.5, "spacer": 0.5, "tray": 0.5, "coupon-tray": 0.0}
"""Likeness from which no further parts are tried, by part. Those that load the CAD kernel come last."""


def read_mesh(path: Path) -> Mesh:
    """Read an STL, 3MF, OBJ or PLY file as a welded mesh; coordinates of all but 3MF are taken as millimetres.

    Raises
    ------
    MeshFileError
        The file is not there, not a mesh, or holds no triangles.
    FileError
        A killed run left its folder half-written.
    """
    return read_as_one(path.parent, partial(_read_mesh, path), path.name)


def _read_mesh(path: Path) -> Mesh:
    try:
        if not path.is_file():
            there = "is a folder; name a mesh in it, as pad.stl" if path.is_dir() else "is not a file"
            raise MeshFileError(there if path.exists() else "there is no such file", str(path))
    except OSError as error:
        raise MeshFileError(f"cannot be read ({reason(error)})", str(path)) from error
    kind = path.suffix.lower()
    if kind == ".3mf":
        return read_3mf(path)
    if kind not in (".stl", ".obj", ".ply"):
        raise MeshFileError("is not a mesh that can be checked; must be an STL, 3MF, OBJ or PLY file", str(path))
    data = read_bounded(path, LARGEST_FILE, "a mesh")
    if kind == ".stl" and len(data) >= 84 and data[:5] != b"solid":
        promised = int.from_bytes(data[80:84], "little")
        held = (len(data) - 84) // 50
        if held < promised:
            raise MeshFileError(f"is cut short: it promises {promised} triangles and holds {held}", str(path))
    import trimesh

    try:
        # From memory and without materials, so that trimesh opens no other file which this one names, nor tries to.
        part = trimesh.load(
            io.BytesIO(data), file_type=kind[1:], force="mesh", process=False, resolver=None, skip_materials=True
        )
    except Exception as error:  # trimesh's readers raise errors of many kinds
        raise MeshFileError(f"is not a mesh that can be read ({error or type(error).__name__})", str(path)) from error
    if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
        what = 'is no STL (neither binary nor text that begins with "solid"), or' if kind == ".stl" else ""
        raise MeshFileError(f"{what} holds no triangles".lstrip(), str(path))
    if len(part.faces) > MOST_TRIANGLES:
        raise MeshFileError(f"has more than {MOST_TRIANGLES} triangles", str(path))
    return sound_mesh(np.asarray(part.vertices, float), np.asarray(part.faces, np.int64), str(path))


def check_foreign(mesh: Mesh, spec: Spec, plan: Plan | None) -> Report:
    """Check a mesh against the limits of the spec's printer and, where given, against the `plan`.

    Its corners tell which part of the plan it is (the pad, its coupon, or a tray for either) and how it lies.
    """
    printer = spec.printer
    density = spec.material.density_g_per_cm3
    limits = {"limits_of": printer.name}
    recognised = None if plan is None else _recognised(mesh, plan)
    if plan is None or recognised is None:
        report = check_mesh(mesh, printer, density)
        unknown = Finding(
            "error",
            "built.other",
            "mesh",
            f"it is neither the pad {spec.name} nor a part of it; name the spec or plan.json that it was built by",
        )
        return Report(report.figures | limits, (*report.findings, *([] if plan is None else [unknown])))
    name, part_plan, solid, pose = recognised
    laid = pose.laid(mesh)
    if isinstance(solid, TraySolid):
        report = check_tray(solid, part_plan, laid)
    elif isinstance(solid, GuardSolid):
        report = check_guard(solid, part_plan, laid)
    elif isinstance(solid, SpacerSolid):
        report = check_spacer(solid, part_plan, laid)
    else:
        report = check_against(laid, solid, part_plan)
    return Report(report.figures | limits | {"part": name}, (*pose.findings(), *report.findings))


def _recognised(mesh: Mesh, plan: Plan) -> tuple[str, Plan, PartSolid, Pose] | None:
    """Recognise the part that a mesh shows; return its name, plan, solid and the mesh's pose, or None."""
    best = None
    most = LEAST_LIKENESS
    for name, part_plan, solid in _parts(plan):
        pose = pose_of(mesh, solid.mesh)
        # All corners of a coupon are found in a pad of one coil: only the size tells the two apart.
        sizes = [np.sort(np.ptp(each.vertices_mm, axis=0)) for each in (pose.laid(mesh), solid.mesh)]
        likeness = pose.share - min(float(np.abs(sizes[0] / sizes[1] - 1).max()), 0.5)
        if likeness > most:
            best = (name, part_plan, solid, pose)
            most = likeness
        if most > SURE_LIKENESS[name]:
            break
    return best


def _parts(plan: Plan) -> Iterator[tuple[str, Plan, PartSolid]]:
    yield "pad", plan, build_pad(plan)
    coupon, solid = build_coupon(plan)
    yield "coupon", coupon, solid
    if plan.spec.guard.thickness_mm:
        yield "guard", plan, build_guard(plan)
    # A pad over a board has a spacer, one over wound coils trays.
    with suppress(InfeasibleError):
        yield "spacer", plan, build_spacer(plan)
    for name, over in (("tray", plan), ("coupon-tray", coupon)):
        with suppress(InfeasibleError):
            yield name, over, build_tray(over)
