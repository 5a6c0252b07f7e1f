"""Tray and coupon: they fit pad, coils and screws by their meshes, every check can fail, bad input is refused."""

import io
import zipfile
from dataclasses import replace

import manifold3d
import numpy as np
import pytest

import padgen as pg
from padgen.core.errors import InfeasibleError
from padgen.core.files import OutputFolder
from padgen.core.registry import PAD_FORMATS
from padgen.make.pad import PARTS
from padgen.planner import plan_from_json, plan_to_json
from padgen.planner.fixtures import (
    SIZES,
    coil_axis_mm,
    coupon_groove,
    coupon_plan,
    plan_spacer,
    plan_tray,
    screw_for,
    spacer_findings,
    tray_findings,
)
from padgen.solid.checks import check_pad
from padgen.solid.formats import ExportJob
from padgen.solid.kernel import build123d
from padgen.solid.mesh import Mesh, as_manifold, signed_volume_mm3
from padgen.solid.pad_solid import build_pad
from padgen.solid.parts import build_coupon, build_part, build_tray, check_tray, tray_solid
from padgen.spec import parse_spec, template_paths
from padgen.spec.model import GuardTable
from tests.conftest import FOUR_LINES
from tests.tampering import from_manifold, stl_mesh

GRID = FOUR_LINES.replace("resolution = 4", "resolution = 8") + "[pad]\nwidth_mm = 25\ndepth_mm = 25\n"
COILS = GRID + "[coil]\ngrid = [2, 2]\n"
ALTERNATE = COILS + "reuse = 'alternate'\n"
BESIDE = tuple(name for name in PARTS if name != "spacer")
"""The parts of a pad over wound coils."""
TINY_COIL = {"inner_diameter_mm": 0.5, "core_diameter_mm": 0.5}
ROUND_MM = 0.02
"""Tolerance of diameters: the chords on both sides."""


@pytest.fixture(scope="module")
def plan():
    return pg.plan(parse_spec(COILS))


@pytest.fixture(scope="module")
def tray(plan):
    return build_tray(plan)


@pytest.fixture(scope="module")
def pad(plan):
    return build_pad(plan)


@pytest.fixture(scope="module")
def coupon(plan):
    return build_coupon(plan)


def with_spec(plan, table, **changes):
    """Return the plan with other fields in one table of its spec, not planned anew."""
    return replace(plan, spec=replace(plan.spec, **{table: replace(getattr(plan.spec, table), **changes)}))


def rod(diameter, low, high, x=0.0, y=0.0):
    """Return a round bar that lies within its nominal circle."""
    return manifold3d.Manifold.cylinder(high - low, diameter / 2, diameter / 2, 96).translate((x, y, low))


def codes(report):
    return {finding.code for finding in report.findings}


def checked(tray, plan, solid):
    """Return the report on a tray with another body."""
    return check_tray(replace(tray, mesh=from_manifold(solid)), plan)


def hole_centres(mesh, z, diameter):
    """Return the sorted centres of the round holes of about this diameter in a cross-section."""
    found = []
    for contour in as_manifold(mesh, "part").slice(z).to_polygons():
        x, y = contour.T
        turned = np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)) < 0
        if turned and np.allclose(np.ptp(contour, axis=0), diameter, atol=ROUND_MM):
            found.append(tuple((contour.min(0) + contour.max(0)) / 2))
    return np.array(sorted(found))


def test_pad_coils_and_tray_go_together(plan, tray, pad):
    """In place nothing overlaps; a hundredth of a millimetre nearer, pad and coils each meet the tray."""
    body = as_manifold(tray.mesh, "tray")
    top = as_manifold(pad.mesh, "pad")
    coil = plan.spec.coil
    height = tray.tray.height_mm

    def overlap(a, b):
        return (a ^ b).volume()

    assert overlap(body, top.translate((0, 0, height))) == pytest.approx(0, abs=1e-6)
    assert overlap(body, top.translate((0, 0, height - 0.01))) > 1
    for x, y in tray.tray.coils_mm:
        low = tray.tray.floor_mm
        placed = rod(coil.outer_diameter_mm, low, low + coil.length_mm, x, y)
        assert overlap(body, placed) == pytest.approx(0, abs=1e-6)
        assert overlap(body, placed.translate((0, 0, -0.01))) > 0.1
        assert overlap(top.translate((0, 0, height)), placed) == 0
        # The socket is 0.3 mm wider than the coil, so that it stops a coil 0.4 mm wider.
        assert overlap(body, rod(coil.outer_diameter_mm + 0.4, low + 0.1, low + 1, x, y)) > 0.1


def test_the_gap_is_what_the_spec_asks(plan, tray):
    """The gap follows from the tray's triangles (rim less seat less coil) and the glue's thickness."""
    z = np.unique(tray.mesh.vertices_mm[:, 2].round(9))
    seat = z[z > 1][0]
    rim = z[-1]
    spec = plan.spec
    assert rim - seat - spec.coil.length_mm + spec.taxel.glue_gap_mm == pytest.approx(spec.coil.gap_mm, abs=1e-9)
    report = check_tray(tray, plan)
    assert report.findings == ()
    assert report.figures["gap_mm"] == pytest.approx([1.0, 1.0], abs=1e-6)
    # 4 sockets of a diameter and three heights, 8 places on the rim, 4 holes of a diameter and a depth.
    assert report.figures["measured_dimensions"] == 4 * 4 + 8 + 4 * 2
    assert report.figures["volume_mm3"] == pytest.approx(tray.volume_mm3, rel=1e-3)


def test_screws_meet_the_pads_holes(plan, tray, pad):
    below = hole_centres(tray.mesh, tray.tray.height_mm - 1, 2.5)
    above = hole_centres(pad.mesh, 1.0, 3.4)
    assert len(above) == 4
    assert below == pytest.approx(above, abs=ROUND_MM)
    # M3 x 10 through 4 mm of frame into a 2.5 mm hole, a millimetre deeper than the screw.
    screw = tray.tray.screw
    assert (screw.name, screw.length_mm, screw.hole_diameter_mm, screw.nut) == ("M3", 10, 2.5, False)
    assert screw.hole_depth_mm == pytest.approx(10 - plan.spec.pad.frame_thickness_mm + 1)


def test_wires_leave_every_socket(plan, tray):
    """A wire of 0.8 mm fits into the lead slot over its whole depth, and one into each slot of the rim."""
    body = as_manifold(tray.mesh, "tray")
    t = tray.tray
    radius = t.socket_diameter_mm / 2 + t.lead.reach_mm / 2
    for x, y in t.coils_mm:
        lead = rod(0.8, t.floor_mm, t.height_mm, x + radius * 0.5**0.5, y + radius * 0.5**0.5)
        assert (body ^ lead).volume() == pytest.approx(0, abs=1e-6)
    assert len(t.wire_slots) == 4
    assert t.wires * len(t.wire_slots) >= 2 * len(t.coils_mm)
    for slot in t.wire_slots:
        at = ((slot.x0 + slot.x1) / 2, (slot.y0 + slot.y1) / 2)
        wire = manifold3d.Manifold.cube((1, 1, 1)).translate((at[0] - 0.5, at[1] - 0.5, t.socket_top_mm))
        assert (body ^ wire).volume() == pytest.approx(0, abs=1e-6)
        assert max(abs(at[0]), abs(at[1])) > 12.5


def test_the_groove_tells_the_corner_of_the_first_coil(tray):
    corner = rod(0.8, 1, 2, -11.75, -18.0)
    others = [(-11.75, 18.0), (11.75, -18.0), (-18.0, -11.75)]
    body = as_manifold(tray.mesh, "tray")
    assert (body ^ corner).volume() < 0.1
    for x, y in others:
        assert (body ^ rod(0.8, 1, 2, x, y)).volume() == pytest.approx(np.pi * 0.16, rel=0.01)


def block(size, at):
    return manifold3d.Manifold.cube(size).translate(at)


@pytest.mark.parametrize(
    ("code", "words", "spoil"),
    [
        ("tray.built", "socket diameter", lambda b: b + block((0.5, 1, 4), (-11.4, -6.75, 2))),
        ("tray.built", "seat height", lambda b: b + block((1, 1, 0.2), (9.5, 5.75, 2.0))),
        ("tray.coil", "1 such places", lambda b: b + block((1, 1, 1), (-11.0, -6.75, 2.5))),
        ("tray.built", "rim height", lambda b: b - block((50, 2, 1), (-25, -16.5, 12.7))),
        ("tray.built", "hole diameter", lambda b: b - rod(2.8, 8, 14, 15.5, 15.5)),
        ("tray.built", "hole depth", lambda b: b - rod(2.5, 4, 14, 15.5, -15.5)),
        ("tray.gap", "a gap of 0.8 mm", lambda b: b.trim_by_plane((0, 0, -1), -12.7)),
        ("tray.room", "rises to 12.5 mm", lambda b: b + block((2, 2, 9.5), (-1, -1, 3.0))),
        ("tray.wires", "no wire passes", lambda b: b + block((5, 3, 5), (-2.5, 13.0, 7.0))),
        ("print.wall", "thinner than", lambda b: b + block((5, 0.2, 5), (13.0, 8.0, 12.0))),
        ("print.bed", "the bed of", lambda b: b + block((300, 1, 1), (17, 0, 0))),
        ("mesh.bodies", "2 separate", lambda b: b + block((1, 1, 1), (-0.5, -0.5, 10))),
        ("mesh.volume", "its volume", lambda b: b - block((5, 5, 1), (-2, 13, 1))),
    ],
)
def test_every_check_of_a_tray_can_fail(plan, tray, code, words, spoil):
    report = checked(tray, plan, spoil(as_manifold(tray.mesh, "tray")))
    assert any(f.code == code and words in f.message for f in report.findings), report.findings


def test_a_tray_with_a_hole_in_its_mesh(plan, tray):
    broken = replace(tray, mesh=Mesh(tray.mesh.vertices_mm, tray.mesh.triangles[1:]))
    assert "mesh.closed" in codes(check_tray(broken, plan))


def test_other_sockets_than_planned_are_found(plan, tray):
    """Of a tray built to other dimensions, five differences are listed, and the number of the others."""
    other = replace(tray.tray, socket_diameter_mm=10.1, floor_mm=2.2)
    built = tray_solid(other, plan.spec.pad)
    found = check_tray(replace(built, tray=tray.tray), plan).findings
    assert {f.code for f in found} == {"tray.built", "tray.coil", "tray.gap"}
    assert sum(f.code == "tray.built" for f in found) == 6
    assert any("11 more like the last" in f.message for f in found)


def test_layers_change_the_gap(plan):
    coarse = with_spec(plan, "coil", gap_mm=1.04)
    (found,) = tray_findings(coarse, plan_tray(coarse))
    assert (found.level, found.code) == ("note", "tray.gap")
    assert "comes out as 1 mm, planned are 1.04 mm" in found.message
    assert check_tray(build_tray(coarse), coarse).findings == (found,)
    narrow = with_spec(plan, "coil", gap_mm=0.44)
    (found,) = tray_findings(narrow, plan_tray(narrow))
    assert found.level == "warning"
    # What was said would be met is met.
    assert tray_findings(with_spec(plan, "coil", gap_mm=0.4), plan_tray(with_spec(plan, "coil", gap_mm=0.4))) == ()


def test_plates_that_come_down_on_the_coils(plan):
    channels = (replace(plan.channels[0], sag_um=950.0), *plan.channels[1:])
    sagging = replace(plan, channels=channels)
    (found,) = tray_findings(sagging, plan_tray(sagging))
    assert (found.level, found.code, found.where) == ("error", "tray.clear", "channel 0")
    assert "the coils lie 0.9 mm below it" in found.message
    assert tray_findings(plan, plan_tray(plan)) == ()


def test_heads_that_reach_over_plates(plan):
    narrow = with_spec(plan, "pad", border_mm=4.4)
    (found,) = tray_findings(narrow, plan_tray(narrow))
    assert found.code == "tray.screw"
    assert "a border of 4.5 mm would do" in found.message
    assert tray_findings(with_spec(plan, "pad", border_mm=4.5), plan_tray(with_spec(plan, "pad", border_mm=4.5))) == ()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"outer_diameter_mm": 11.5},
            "coil.outer_diameter_mm: a coil of 11.5 mm at a pitch of 12.5 mm leaves 0.7 mm of wall between a tray's"
            " sockets, must be 0.9 mm (two lines of fdm-0.4); a coil of 11.3 mm or a pitch of 12.7 mm would do",
        ),
        (
            {"outer_diameter_mm": 1.0, **TINY_COIL},
            "coil.outer_diameter_mm: must be at least 1.8 mm for a tray's sockets on fdm-0.4, got 1 mm",
        ),
        ({"length_mm": 0.2}, "coil.length_mm: must be at least 0.3 mm (3 layers) for a tray's sockets, got 0.2 mm"),
        (
            {"gap_mm": 0.12},
            "coil.gap_mm: must be at least 0.2 mm for a tray: washers lie 0.1 mm within the pad (taxel.glue_gap_mm),"
            " and the coils must stay a layer below it, got 0.12 mm",
        ),
    ],
)
def test_coils_that_no_tray_holds(plan, changes, sentence):
    with pytest.raises(InfeasibleError) as refused:
        plan_tray(with_spec(plan, "coil", **changes))
    assert str(refused.value) == sentence


def test_what_a_refusal_says_would_do_does(plan):
    plan_tray(with_spec(plan, "coil", outer_diameter_mm=11.3))
    plan_tray(with_spec(plan, "coil", outer_diameter_mm=1.8, **TINY_COIL))
    plan_tray(with_spec(plan, "coil", length_mm=0.3))
    assert plan_tray(with_spec(plan, "coil", gap_mm=0.2)).clear_mm == pytest.approx(0.1)


def test_a_pad_without_holes_has_a_tray_without(plan):
    bare = with_spec(plan, "pad", hole_diameter_mm=0.0, border_mm=1.0)
    tray = build_tray(bare)
    assert (tray.tray.screw, tray.tray.holes_mm) == (None, ())
    assert check_tray(tray, bare).findings == ()


@pytest.mark.parametrize(
    ("hole", "clamped", "below", "expected"),
    [
        (3.4, 4.0, 12.9, ("M3", 10, 2.5, 7.0, False)),
        (2.4, 4.0, 12.9, ("M2", 8, 1.6, 5.0, False)),
        (4.5, 4.0, 12.9, ("M4", 12, 3.3, 9.0, False)),
        # 6 mm of screw in 7.5 mm of tray: the hole goes through.
        (3.4, 4.0, 7.5, ("M3", 10, 2.5, 7.5, False)),
        # Too low for 4.5 mm of thread: through it, into a nut of 2.4 mm.
        (3.4, 4.0, 3.9, ("M3", 12, 3.4, 3.9, True)),
        # The longest screw is too short for two diameters of thread, but not for a nut.
        (13.0, 47.0, 10.0, ("M12", 70, 13.0, 10.0, True)),
        # Of M8 and more none is long enough.
        (13.0, 60.0, 30.0, ("M6", 70, 5.0, 11.0, False)),
        (13.0, 80.0, 30.0, None),
        (1.6, 4.0, 12.9, None),
        (0.0, 4.0, 12.9, None),
    ],
)
def test_which_screw(hole, clamped, below, expected):
    screw = screw_for(hole, clamped, below)
    assert (screw and (screw.name, screw.length_mm, *screw[3:])) == expected


def test_screws_hold_and_end_within_their_part():
    """Over all sizes of pads and trays, screws have 1.5 diameters of thread and stay inside, or get a nut."""
    diameter = {name: diameter_mm for name, diameter_mm, *_ in SIZES}
    for hole in np.arange(1.7, 20.1, 0.4):
        for clamped in np.arange(0.5, 20.1, 1.5):
            for below in (2.1, 3.9, 6.0, 9.3, 12.9, 30.0, 200.0):
                screw = screw_for(float(hole), float(clamped), below)
                held = screw.length_mm - clamped
                assert diameter[screw.name] < hole
                if screw.nut:
                    assert held > below
                    assert screw.hole_depth_mm == below
                else:
                    assert 1.5 * diameter[screw.name] - 1e-9 <= held <= below
                    assert held <= screw.hole_depth_mm <= below


def test_a_coupon_has_one_taxel_of_each_channel_as_the_pad_has(plan, coupon):
    own, solid = coupon
    assert [t.channel for t in own.taxels] == list(range(len(plan.channels)))
    assert own.name == "tiny-coupon"
    on_pad = {t.channel: t.coil_distance_mm for t in plan.taxels}
    for taxel in own.taxels:
        # Over the only coil, at the pad's distance.
        assert np.hypot(taxel.x_mm, taxel.y_mm) == pytest.approx(on_pad[taxel.channel], abs=1e-5)
    report = check_pad(solid, own)
    assert report.findings == ()
    assert report.figures["largest_difference_from_plan_mm"] < 1e-6
    # One cell of 12.5 mm, and heads of 5.5 mm beside it.
    assert report.figures["size_mm"] == pytest.approx([23.5, 23.5, 5.0], abs=1e-6)
    assert len(hole_centres(solid.mesh, 1.0, 3.4)) == 4


def test_tiles_of_coupon_and_pad_are_the_same(pad, coupon):
    for here, there in zip(coupon[1].tiles, pad.tiles, strict=True):
        assert here.mesh.vertices_mm == pytest.approx(there.mesh.vertices_mm, abs=1e-9)


def test_a_coupons_groove_is_beside_channel_0(coupon):
    own, solid = coupon
    first, *others = sorted(own.taxels, key=lambda t: t.channel)
    sides = coupon_groove(own)
    at = np.array([(sides.x0 + sides.x1) / 2, (sides.y0 + sides.y1) / 2])
    distance = [float(np.hypot(*(at - (t.x_mm, t.y_mm)))) for t in (first, *others)]
    assert distance[0] < min(distance[1:])
    assert (as_manifold(solid.mesh, "coupon") ^ rod(1.0, 1, 2, at[0], at[1] * 0.97)).volume() < 0.1


def test_two_sets_of_channels_lie_over_two_coils():
    plan = pg.plan(parse_spec(ALTERNATE))
    assert plan.coils.sets == 2
    own, solid = build_coupon(plan)
    assert (own.coils.rows, own.coils.columns) == (1, 2)
    assert sorted(t.channel for t in own.taxels) == list(range(len(plan.channels)))
    for taxel in own.taxels:
        x, y = coil_axis_mm(own.coils, *taxel.coil)
        assert taxel.channel % 2 == taxel.coil[1]
        assert np.hypot(taxel.x_mm - x, taxel.y_mm - y) == pytest.approx(taxel.coil_distance_mm, abs=1e-5)
    assert check_pad(solid, own).findings == ()
    assert len(plan_tray(own).coils_mm) == 2
    assert coupon_plan(replace(plan, coils=replace(plan.coils, rows=4, columns=1))).coils.rows == 2


def test_a_coupon_of_a_plan_from_its_file(plan):
    again = coupon_plan(plan_from_json(plan_to_json(plan)))
    assert plan_to_json(again) == plan_to_json(coupon_plan(plan))


def test_coupons_of_odd_pads(plan):
    long = coupon_plan(replace(plan, name="n" * 80))
    assert long.name == long.spec.name == "n" * 73 + "-coupon"
    fine = replace(plan, coils=replace(plan.coils, pitch_mm=3.0, pitch_x_mm=3.0, pitch_y_mm=12.5))
    assert (coupon_plan(fine).coils.columns, coupon_plan(fine).spec.pad.width_mm) == (2, 6.0)
    bare = coupon_plan(with_spec(plan, "pad", hole_diameter_mm=0.0))
    assert bare.spec.pad.border_mm == pytest.approx(4 * 0.45)
    assert coupon_plan(with_spec(plan, "pad", border_mm=5.0)).spec.pad.border_mm == 5.0


@pytest.fixture(scope="module")
def parts(plan):
    return built_parts(plan, BESIDE)


def built_parts(plan, names):
    """Return the parts; the guard plate is that of the same plan with one."""
    with_guard = replace(plan, spec=replace(plan.spec, guard=GuardTable(thickness_mm=1.0)))
    return [build_part(with_guard if name == "guard" else plan, name) for name in names]


def written(plan, parts, folder):
    with OutputFolder(folder) as out:
        for part in parts:
            for name in ("stl", "3mf", "step", "glb"):
                PAD_FORMATS.get(name).write(out, ExportJob(plan, part, "0123"))
        out.commit()
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "manifest.json"}


def test_a_guard_plate_that_the_spec_lacks_is_refused_with_what_would_add_one(plan):
    with pytest.raises(InfeasibleError) as refused:
        build_part(plan, "guard")
    sentence = "--parts: the spec has no guard plate; guard.thickness_mm = 1 (usual) would give it one"
    assert str(refused.value) == sentence


def test_files_of_parts(plan, parts, tmp_path):
    files = written(plan, parts, tmp_path / "one")
    assert set(files) == {f"{p}.{f}" for p in BESIDE for f in ("stl", "3mf", "step")} - {"coupon.step"}
    for part in parts:
        # Single precision.
        again = signed_volume_mm3(stl_mesh(files[f"{part.name}.stl"]))
        assert again == pytest.approx(signed_volume_mm3(part.mesh), rel=1e-5)
        model = zipfile.ZipFile(io.BytesIO(files[f"{part.name}.3mf"])).read("3D/3dmodel.model").decode()
        assert model.count("<object ") == 1
        assert f'name="{part.title}"' in model
        assert f">{part.title}</metadata>" in model
        assert [f for f in part.report.findings if f.level == "error"] == []
    (solid,) = build123d().import_step(tmp_path / "one" / "tray.step").solids()
    assert solid.volume == pytest.approx(parts[2].solid.volume, rel=1e-6)
    assert files == written(plan, built_parts(plan, BESIDE[::-1]), tmp_path / "two")


def test_the_coupons_tray_holds_its_coil(plan, coupon, parts):
    tray = next(part for part in parts if part.name == "coupon-tray")
    assert (tray.title, tray.report.findings) == ("tiny-coupon-tray", ())
    assert tray.report.figures["gap_mm"] == pytest.approx([1.0, 1.0], abs=1e-6)
    holes = hole_centres(coupon[1].mesh, 1.0, 3.4)
    assert hole_centres(tray.mesh, 12.0, 2.5) == pytest.approx(holes, abs=ROUND_MM)


@pytest.mark.parametrize("name", sorted(template_paths()))
def test_every_template_has_a_tray_and_a_coupon(name):
    plan = pg.plan(name)
    if plan.spec.coil.kind == "board":
        with pytest.raises(InfeasibleError, match=r"^--parts: coils on a board need no tray: .* 'spacer'$"):
            plan_tray(plan)
        assert spacer_findings(plan, plan_spacer(plan)) == ()
        return
    tray = plan_tray(plan)
    own = coupon_plan(plan)
    assert tray_findings(plan, tray) == ()
    assert tray.gap_mm == pytest.approx(plan.spec.coil.gap_mm, abs=1e-9)
    assert tray.clear_mm + plan.spec.mover_low_mm == pytest.approx(tray.gap_mm)
    assert len(tray.coils_mm) == plan.coils.rows * plan.coils.columns
    assert len(own.taxels) == len(plan.channels)
    # Two sets of channels alternate between coils: a cell of each.
    assert len(plan_tray(own).coils_mm) == (2 if plan.spec.coil.reuse == "alternate" else 1)


def test_a_plan_says_when_no_tray_can_hold_its_coils():
    """Coils of 10 mm at 10 mm touch each other; `build --parts tray` refuses them in the same words."""
    table = {"name": "dense", "resolution": 24, "band_hz": [60, 300], "q_min": 15, "delta_db": 14}
    close = pg.plan(
        {
            **table,
            "pad": {"width_mm": 60, "depth_mm": 40},
            "coil": {"name": "air-10", "grid": [4, 3]},
            "magnet": "disc-3x1",
        }
    )
    with pytest.raises(InfeasibleError) as refused:
        plan_tray(close)
    (found,) = (finding for finding in close.findings if finding.code == "tray.room")
    assert found.level == "warning"
    assert found.message.endswith(str(refused.value.message))
    assert not any(finding.code == "tray.room" for finding in pg.plan("pad-32").findings)
