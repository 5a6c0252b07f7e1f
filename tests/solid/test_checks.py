"""Every print check finds a pad that was broken for it, and passes a good one."""

import re
from dataclasses import replace

import manifold3d
import numpy as np
import pytest

from padgen.core import cache
from padgen.core.errors import GeometryError
from padgen.planner import make_plan
from padgen.planner.layout import to_cell
from padgen.report.plans import figures_text
from padgen.solid import checks
from padgen.solid.checks import check_against, check_mesh, check_pad
from padgen.solid.measure import _part_of, longest_unsupported_span, narrow_places, sections
from padgen.solid.mesh import Mesh, as_manifold, intersecting_pairs, topology
from padgen.solid.pad_solid import build_pad
from padgen.spec import parse_spec
from tests.conftest import SMALL
from tests.tampering import from_manifold

PRINTER = parse_spec(SMALL).printer


def codes(report):
    return {finding.code for finding in report.findings}


def box(size, at=(0.0, 0.0, 0.0)):
    return manifold3d.Manifold.cube(size).translate(at)


def joined(*meshes):
    """Put meshes into one without uniting them."""
    counts = np.cumsum([0] + [len(m.vertices_mm) for m in meshes])
    return Mesh(
        np.concatenate([m.vertices_mm for m in meshes]),
        np.concatenate([m.triangles + n for m, n in zip(meshes, counts, strict=False)]),
    )


def checked(solid):
    return check_mesh(from_manifold(solid), PRINTER, 1.24)


def with_beam(plan, index, **changes):
    """Return the plan with another beam for channel `index`."""
    channels = list(plan.channels)
    channels[index] = replace(channels[index], beam=replace(channels[index].beam, **changes))
    return replace(plan, channels=tuple(channels))


def test_a_good_pad_passes(small_pad, small_plan):
    report = check_pad(small_pad, small_plan)
    assert report.findings == ()
    assert report.figures["bodies"] == 1
    assert report.figures["largest_difference_from_plan_mm"] < 1e-6
    assert report.figures["smallest_gap_mm"] == pytest.approx(0.3, abs=2e-3)


def test_the_same_pad_passes_as_a_foreign_mesh(small_pad, small_plan):
    report = check_mesh(small_pad.mesh, PRINTER, 1.24)
    assert report.findings == ()
    assert check_against(small_pad.mesh, small_pad, small_plan).findings == ()


def test_a_hole(small_pad, small_plan):
    broken = Mesh(small_pad.mesh.vertices_mm, small_pad.mesh.triangles[1:])
    assert topology(broken).broken_edges == 3
    report = check_pad(replace(small_pad, mesh=broken), small_plan)
    (said,) = (finding.message for finding in report.findings if finding.code == "mesh.closed")
    edges = "3 edges do not join two triangles that agree which side is out, the first near"
    assert said.startswith(f"it has a hole, or triangles doubled or turned over: {edges} (")
    assert said.endswith(" mm; repair it in the slicer, or export it again")


def test_a_doubled_triangle(small_pad):
    triangles = np.concatenate([small_pad.mesh.triangles, small_pad.mesh.triangles[:1]])
    broken = Mesh(small_pad.mesh.vertices_mm, triangles)
    assert topology(broken).broken_edges == 3
    assert "mesh.closed" in codes(check_mesh(broken, PRINTER, 1.24))


def test_a_turned_triangle(small_pad):
    triangles = small_pad.mesh.triangles.copy()
    triangles[0] = triangles[0, ::-1]
    broken = Mesh(small_pad.mesh.vertices_mm, triangles)
    assert topology(broken).broken_edges == 3
    assert "mesh.closed" in codes(check_mesh(broken, PRINTER, 1.24))


def test_inside_out(small_pad):
    broken = Mesh(small_pad.mesh.vertices_mm, small_pad.mesh.triangles[:, ::-1])
    assert "mesh.inside_out" in codes(check_mesh(broken, PRINTER, 1.24))


def test_a_taxel_cut_off(small_pad, small_plan):
    solid = as_manifold(small_pad.mesh, "pad")
    taxel = small_plan.taxels[0]
    x, y = taxel.x_mm, taxel.y_mm
    # A ring of air around the plate, wider than its gap.
    moat = box((6.2, 6.2, 9.0), (x - 3.1, y - 3.1, -1.0)) - box((4.7, 4.7, 11.0), (x - 2.35, y - 2.35, -2.0))
    broken = from_manifold(solid - moat)
    found = check_pad(replace(small_pad, mesh=broken), small_plan)
    assert "mesh.bodies" in codes(found)


def test_pierced_triangles():
    apart = joined(from_manifold(box((1, 1, 1))), from_manifold(box((1, 1, 1), (2, 0, 0))))
    pierced = joined(from_manifold(box((1, 1, 1))), from_manifold(box((1, 1, 1), (0.5, 0.4, 0.3))))
    assert len(intersecting_pairs(apart)) == 0
    assert len(intersecting_pairs(pierced)) > 0
    assert "mesh.intersects" in codes(check_mesh(pierced, PRINTER, 1.24))


def test_pierced_tile(small_pad, small_plan):
    tile = small_pad.tiles[0]
    vertices = tile.mesh.vertices_mm.copy()
    vertices[vertices[:, 2].argmax(), 2] = -20
    tiles = (replace(tile, mesh=Mesh(vertices, tile.mesh.triangles)), *small_pad.tiles[1:])
    assert "mesh.intersects" in codes(check_pad(replace(small_pad, tiles=tiles), small_plan))


def test_pierced_pairs_agree_with_trying_all():
    """The grid of columns finds the same pairs as a comparison of every box with every other."""
    from padgen.solid.mesh import _overlapping, _pierce

    seed = np.random.default_rng(1)
    vertices = seed.uniform(0, 5, (90, 1, 3)) + seed.uniform(-1.2, 1.2, (90, 3, 3))
    mesh = Mesh(vertices.reshape(-1, 3), np.arange(270).reshape(-1, 3))
    a, b = np.triu_indices(90, 1)
    tried = np.stack([a, b], -1)[_pierce(mesh, a, b)]
    assert len(tried) > 5
    assert intersecting_pairs(mesh).tolist() == tried.tolist()
    corners = mesh.corners_mm
    once = np.concatenate(list(_overlapping(corners.min(1), corners.max(1))))
    assert (once[:, 0] < once[:, 1]).all()


def test_a_coarse_mesh_has_the_wrong_volume(small_plan):
    coarse = build_pad(small_plan, chord_mm=1.0, angle_rad=1.5)
    assert "mesh.volume" in codes(check_pad(coarse, small_plan))


def test_a_thin_beam(small_plan):
    thin = with_beam(small_plan, 0, width_mm=0.3)
    assert {"print.wall", "print.beam"} <= codes(check_pad(build_pad(thin), thin))


def test_a_beam_of_half_a_layer(small_plan):
    odd = with_beam(small_plan, 0, thickness_mm=small_plan.channels[0].beam.thickness_mm + 0.05)
    assert "print.layers" in codes(check_pad(build_pad(odd), odd))


@pytest.mark.parametrize(
    ("change", "dimension"),
    [({"width_mm": 0.02}, "width"), ({"thickness_mm": 0.1}, "thickness"), ({"length_mm": 0.02}, "length")],
)
def test_built_other_than_planned(small_pad, small_plan, change, dimension):
    beam = small_plan.channels[1].beam
    other = with_beam(small_plan, 1, **{name: getattr(beam, name) + step for name, step in change.items()})
    found = [f for f in check_pad(small_pad, other).findings if f.code == "built.planned"]
    assert any(dimension in f.message for f in found)


def test_a_lifted_beam(small_pad, small_plan):
    """A beam above the bed is found by its underside."""
    solid = as_manifold(small_pad.mesh, "pad")
    lifted = solid - box((100, 100, 0.1), (-50, -50, -0.05)) + box((30, 2, 0.2), (-15, -18.4, 0))
    found = check_pad(replace(small_pad, mesh=from_manifold(lifted)), small_plan).findings
    assert any("above the bed" in f.message for f in found if f.code == "built.planned")


def test_a_washer_that_does_not_fit(small_pad, small_plan):
    spec = replace(small_plan.spec, washer=replace(small_plan.spec.washer, outer_diameter_mm=3.85))
    found = check_pad(small_pad, replace(small_plan, spec=spec)).findings
    assert any(f.code == "washer.fit" and "recess diameter" in f.message for f in found)
    other = replace(small_plan, plate=replace(small_plan.plate, recess_diameter_mm=4.0, recess_depth_mm=0.5))
    found = [f.message for f in check_pad(small_pad, other).findings if f.code == "built.planned"]
    assert any("recess diameter is 3.75 mm, planned are 4 mm" in message for message in found)
    assert any("recess depth is 0.4 mm, planned are 0.5 mm" in message for message in found)


def with_clearance(clearance_mm, printer="fdm-0.4"):
    text = f"printer = '{printer}'\n[taxel]\nwasher_clearance_mm = {clearance_mm}\n"
    return make_plan(parse_spec(SMALL.replace("[pad]", f"{text}[pad]")))


@pytest.mark.sample(1)
@pytest.mark.parametrize("printer", ["fdm-0.4", "resin-0.05"])
def test_a_washer_enters_what_is_laid_around_it(printer):
    """A polygon's sides are nearer to its middle than its corners, and a slicer lays some plastic beyond them."""
    plan = with_clearance(0.0, printer)
    tight = [f for f in check_pad(build_pad(plan), plan).findings if f.code == "washer.fit"]
    assert len(tight) == len(plan.taxels)
    assert all(f.level == "error" for f in tight)
    wider = float(re.search(r"taxel\.washer_clearance_mm = ([\d.]+) would do", tight[0].message).group(1))
    assert "washer.fit" not in codes(
        check_pad(build_pad(with_clearance(wider, printer)), with_clearance(wider, printer))
    )
    narrower = with_clearance(wider - 0.011, printer)
    assert "washer.fit" in codes(check_pad(build_pad(narrower), narrower))


def test_a_tight_recess_of_a_foreign_mesh(small_pad, small_plan):
    """A recess with few sides has its corners as planned but its sides too near; or only its mouth is narrow."""
    solid, (x, y) = as_manifold(small_pad.mesh, "pad"), (small_plan.taxels[0].x_mm, small_plan.taxels[0].y_mm)
    plate = small_plan.plate
    hole = manifold3d.Manifold.cylinder(plate.recess_depth_mm, plate.recess_diameter_mm / 2, -1, 12)
    whole = manifold3d.Manifold.cylinder(plate.recess_depth_mm, 1.95, 1.95, 64)
    coarse = solid + (whole - hole).translate((x, y, 0.0))
    lip = solid + (whole.trim_by_plane((0, 0, -1), -0.05) - hole).translate((x, y, 0.0))
    for broken in (coarse, lip):
        mesh = from_manifold(broken)
        found = check_against(mesh, small_pad, small_plan).findings
        (tight,) = [f for f in found if f.code == "washer.fit"]
        assert tight.where == f"taxel {small_plan.taxels[0].id}"
        # 3.75 cos(π/12)
        assert "the recess diameter between the sides of its polygon is 3.6222 mm" in tight.message
        # The plan's clearance would do.
        assert tight.message.endswith("lays 0.208 mm into it")


def test_a_recess_of_half_a_layer(small_plan):
    odd = replace(small_plan, plate=replace(small_plan.plate, recess_depth_mm=0.45))
    found = [f for f in check_pad(build_pad(odd), odd).findings if f.code == "print.layers"]
    assert "recess depth is 0.45 mm, not a whole number of layers" in found[0].message


def test_a_narrow_gap():
    spec = parse_spec(SMALL + "[printer]\nname = 'fdm-0.4'\nsmallest_gap_mm = 0.2\n")
    pad = build_pad(make_plan(spec))
    assert "print.gap" in codes(check_mesh(pad.mesh, PRINTER, 1.24))
    assert "print.gap" not in codes(check_mesh(pad.mesh, spec.printer, 1.24))


def test_a_pad_larger_than_the_bed(small_pad):
    small_bed = replace(PRINTER, bed_x_mm=30, bed_y_mm=30)
    assert "print.bed" in codes(check_mesh(small_pad.mesh, small_bed, 1.24))
    assert "print.bed" not in codes(check_mesh(small_pad.mesh, replace(PRINTER, bed_x_mm=38, bed_y_mm=40), 1.24))


def test_a_long_bridge():
    def table(span):
        return box((2, 5, 5)) + box((2, 5, 5), (2 + span, 0, 0)) + box((4 + span, 5, 1), (0, 0, 5))

    assert "print.bridge" in codes(checked(table(15)))
    assert "print.bridge" not in codes(checked(table(8)))
    solid = table(8)
    # 2 steps of the bisection of 11 mm, and of 64 facets.
    assert longest_unsupported_span(solid, from_manifold(solid), 11)[0] == pytest.approx(8, abs=0.05)


def test_a_face_that_hangs_from_nothing():
    assert "print.bridge" in codes(checked(box((5, 5, 1)) + box((25, 2, 1), (0, 0, 1))))


def test_a_skin_thinner_than_a_layer():
    def roofed(roof):
        return box((6, 6, 1)) - box((3, 3, 1 - roof), (1.5, 1.5, 0))

    assert "print.skin" in codes(checked(roofed(0.06)))
    assert "print.skin" not in codes(checked(roofed(0.1)))
    assert "print.skin" in codes(checked(box((6, 6, 0.06))))


def test_a_tile_that_leaves_its_cell(small_pad, small_plan):
    tile = small_pad.tiles[1]
    moved = Mesh(tile.mesh.vertices_mm + np.array([0.2, 0, 0]), tile.mesh.triangles)
    tiles = (small_pad.tiles[0], replace(tile, mesh=moved), *small_pad.tiles[2:])
    assert "mesh.cell" in codes(check_pad(replace(small_pad, tiles=tiles), small_plan))


def test_a_tapered_beam(small_pad, small_plan):
    """A notch near the tip is found where the beam's middle is as planned."""
    channel = small_plan.channels[0]
    taxel = next(t for t in small_plan.taxels if t.channel == 0)
    solid = as_manifold(small_pad.mesh, "pad")
    spot = to_cell(np.array([0.9 * channel.beam.length_mm, 0.0, 0.0]), channel)
    washer = to_cell(np.array([float(small_plan.arrangement(channel).washer_x_mm), 0.0, 0.0]), channel)
    x = taxel.x_mm + spot[0] - washer[0]
    y = taxel.y_mm + spot[1] - washer[1]
    half = channel.beam.width_mm / 2
    across = abs(to_cell(np.array([0.0, 1.0, 0.0]), channel) - to_cell(np.zeros(3), channel))
    notch = box((0.3, 0.3, 2.0), (-0.15, -0.15, -1.0)).translate((x + half * across[0], y + half * across[1], 0.0))
    found = check_pad(replace(small_pad, mesh=from_manifold(solid - notch)), small_plan).findings
    assert any("beam width" in f.message for f in found if f.code == "built.planned")


def test_a_steep_overhang():
    steep = manifold3d.Manifold.cylinder(2, 2, 5, 64)
    mild = manifold3d.Manifold.cylinder(2, 2, 3, 64)
    assert "print.overhang" in codes(checked(steep))
    assert "print.overhang" not in codes(checked(mild))


def test_the_longest_of_several_spans_is_told_with_its_place():
    """Slots of 3, 3 and 5 mm under one roof, as long as each other: the last one decides."""
    roof = box((30, 12, 1), (0, 0, 2))
    walls = [box((wide, 12, 2), (x, 0, 0)) for x, wide in ((0, 3), (6, 4), (13, 4), (22, 8))]
    solid = sum(walls, roof)
    span, place = longest_unsupported_span(solid, from_manifold(solid), 11)
    assert span == pytest.approx(5, abs=0.03)
    assert (place.x_mm, place.z_mm) == pytest.approx((19.5, 2), abs=0.05)


@pytest.mark.parametrize("width", [0.2, 0.37, 0.8])
def test_walls_and_gaps_are_measured(width):
    wall = box((10, width, 3)) + box((3, 10, 3)) + box((3, 10, 3), (7, 0, 0))
    gap = box((10, 10, 3)) - box((8, width, 5), (1, 4, -1))
    cuts = sections(wall, from_manifold(wall))
    assert len(cuts) == 1 and narrow_places(cuts, False, 1.8)[0] == pytest.approx(width, abs=5e-3)
    cuts = sections(gap, from_manifold(gap))
    assert len(cuts) == 1 and narrow_places(cuts, True, 1.8)[0] == pytest.approx(width, abs=5e-3)


@pytest.mark.parametrize("gaps", [False, True])
def test_what_is_left_around_narrow_places_decides_as_the_whole_does(small_pad, gaps):
    cuts = sections(as_manifold(small_pad.mesh, "pad"), small_pad.mesh)
    decided = set()
    for cut in cuts:
        part = whole = _part_of(cut, gaps)
        for width_mm in (1.8, 1.1, 0.7, 0.5, 0.45, 0.3):
            spots, part = part.narrower_than(width_mm)
            expected, _ = whole.narrower_than(width_mm)
            assert [s.area_mm2 for s in sorted(spots)] == pytest.approx(
                [s.area_mm2 for s in sorted(expected)], rel=1e-3
            )
            decided.add((len(spots) > 0, part.shape.area() < 0.9 * whole.shape.area()))
    assert decided >= {(True, True), (False, True)}


@pytest.mark.parametrize("length", [0.05, 0.2, 0.5])
def test_a_fin_too_short_for_the_figure_is_still_found(length):
    """Over the figure's whole range a short fin counts as a corner's splinter; at the printer's limit it is a wall."""
    fin = box((10, 10, 3)) + box((0.2, length + 1, 3), (5, 9, 0))
    assert "print.wall" in codes(checked(fin))


def test_narrow_places_are_measured_once(small_plan, monkeypatch, tmp_path):
    thin = with_beam(small_plan, 0, width_mm=0.2)
    pad = build_pad(thin)
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path))
    report = check_pad(pad, thin)
    assert "print.wall" in codes(report)
    calls = []
    monkeypatch.setattr(checks, "narrow_places", lambda *arguments: calls.append(arguments) or (0.1, []))
    assert check_pad(pad, thin) == report and not calls
    (entry,) = tmp_path.glob("narrow-places/*/*.entry")
    cache.store("narrow-places", entry.stem, {"another": "form"})
    assert check_pad(pad, thin).figures["smallest_wall_mm"] == 0.1


@pytest.mark.parametrize("widths", [(0.2, 0.5, 0.9), (0.9, 0.5, 0.2), (0.5, 0.2, 0.2), (0.5, 3, 0.9), (3, 3, 3)])
def test_the_narrowest_of_several_heights_is_that_of_the_narrowest_alone(widths):
    ends = box((3, 10, 9)) + box((3, 10, 9), (7, 0, 0))
    wall = sum((box((10, width, 3), (0, 0, 3 * k)) for k, width in enumerate(widths)), ends)
    cuts = sections(wall, from_manifold(wall))
    assert len(cuts) >= 3
    alone = [width for cut in cuts if (width := narrow_places([cut], False, 1.8)[0]) is not None]
    assert narrow_places(cuts, False, 1.8)[0] == min(alone, default=None)
    assert narrow_places(cuts, False, 1.8)[0] == (pytest.approx(min(widths), abs=5e-3) if min(widths) < 1.8 else None)


@pytest.mark.parametrize(
    ("piece", "wall_mm", "gap_mm", "said"),
    [
        (box((50, 50, 4)), None, None, "no wall or gap below 1.8 mm"),
        (box((20, 20, 3)) - box((8, 0.8, 5), (4, 4, -1)), None, 0.8, "0.8 mm smallest gap, no wall below 1.8 mm"),
        (box((20, 20, 3)) + box((0.8, 5, 3), (9, 19, 0)), 0.8, None, "0.8 mm smallest wall, no gap below 1.8 mm"),
    ],
)
def test_the_end_of_the_search_is_no_measured_wall_or_gap(piece, wall_mm, gap_mm, said):
    """A solid block of 50 x 50 x 4 mm was reported with walls and gaps of 1.8 mm, where the search ends."""
    figures = checked(piece).figures
    assert figures["searched_below_mm"] == 1.8
    for key, width_mm in (("smallest_wall_mm", wall_mm), ("smallest_gap_mm", gap_mm)):
        assert figures[key] == (None if width_mm is None else pytest.approx(width_mm, abs=5e-3))
    assert f" g of plastic, {said}, 0 mm longest bridge" in figures_text(figures)


def test_limits_of_a_spec_are_advised_only_where_none_was_given():
    figures = {"limits_of": "fdm-0.4"}
    assert figures_text(figures) == "limits of printer fdm-0.4 (--spec takes those of a spec)"
    told = figures_text({"compared_with": "pad-32", **figures})
    assert told == "compared with pad-32, limits of printer fdm-0.4"


def test_many_findings_are_summed_up(small_pad, small_plan):
    beam = small_plan.channels[0].beam
    other = small_plan
    for index in range(len(small_plan.channels)):
        other = with_beam(other, index, width_mm=beam.width_mm + 7, length_mm=beam.length_mm + 1)
    found = [f for f in check_pad(small_pad, other).findings if f.code == "built.planned"]
    # One for each taxel, or for all that are off alike, of its first dimensions.
    assert [f.where for f in found] == [f"taxel {taxel.id}" for taxel in small_plan.taxels]
    assert all(f.message.count("planned are") == 2 for f in found)


def test_legs_of_a_serpentine_that_are_too_near_or_too_thin_are_found():
    """A serpentine as planned passes; it fails with a finer printer's gaps, or with thinner legs."""
    text = SMALL.replace("coil = { grid = [1, 1] }", "resonances_hz = [100, 140]").replace("[50, 200]", "[40, 400]")
    plan = make_plan(parse_spec(text + "[suspension]\ntopology = 'serpentine-5'\n"))
    pad = build_pad(plan)
    report = check_pad(pad, plan)
    assert not [finding for finding in report.findings if finding.level == "error"]
    assert report.figures["smallest_gap_mm"] == pytest.approx(plan.plate.gap_mm, abs=2e-3)
    assert report.figures["largest_difference_from_plan_mm"] < 0.01
    near = replace(plan, plate=replace(plan.plate, gap_mm=plan.plate.gap_mm - 0.05))
    assert "print.gap" in codes(check_pad(build_pad(near), near))
    thin = with_beam(plan, 0, width_mm=plan.channels[0].beam.width_mm - 0.03)
    assert {"built.planned"} <= codes(check_pad(build_pad(thin), plan))


def test_a_closed_mesh_that_the_kernel_refuses_is_a_finding(small_pad, small_plan, monkeypatch):
    def refusing(mesh, what):
        raise GeometryError(f"{what} is not a manifold (ResultTooLarge)")

    monkeypatch.setattr("padgen.solid.checks.as_manifold", refusing)
    for report in (check_mesh(small_pad.mesh, PRINTER, 1.24), check_pad(small_pad, small_plan)):
        assert "mesh.manifold" in codes(report)
