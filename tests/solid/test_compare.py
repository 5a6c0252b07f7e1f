"""Comparing a mesh with its plan's own solid: every change is found with its place, and unchanged pads pass."""

import zipfile
from dataclasses import replace

import numpy as np
import pytest

from padgen.planner import make_plan
from padgen.planner.layout import coil_axis_mm
from padgen.solid.checks import check_pad
from padgen.solid.compare import SMALLEST_MM, STRIP_MM, differences, pose_of, same_faces, unmatched_triangles
from padgen.solid.formats import _3mf
from padgen.solid.formats._3mf import read_3mf
from padgen.solid.mesh import Mesh, as_manifold, topology
from padgen.solid.pad_solid import build_pad, sampled, turned_grid
from padgen.solid.parts import build_coupon, build_tray, check_foreign
from padgen.spec import parse_spec
from tests.conftest import FOUR_LINES, SMALL
from tests.tampering import KINDS, WAYS, as_single_precision, box, from_manifold, honest, tampered

# Of the taxel that was changed, or of what is beside it: a lump in a gap may lie in the next cell.
ELSEWHERE = {"lump", "hair", "filled", "widened", "slot", "channels", "part", "triangles", "hole", "1"}


@pytest.fixture(scope="module")
def wide_plan():
    """Many coils, the last with a taxel fewer, and rows and columns of two kinds in turn."""
    text = FOUR_LINES.replace("= 4", "= 34") + "[pad]\nwidth_mm = 70\ndepth_mm = 80\n[coil]\ngrid = [5, 7]\n"
    return make_plan(parse_spec(text.replace("resolution = 34", "resolution = 69") + 'reuse = "alternate"\n'))


def found(mesh, plan):
    return check_foreign(mesh, plan.spec, plan).findings


@pytest.mark.sample(12)
@pytest.mark.parametrize("kind", KINDS)
def test_whatever_is_changed_is_found(kind, small_pad, small_plan):
    """One place is tried here; docs/measure_checks.py tries ten."""
    mesh, taxel = tampered(kind, 5, small_plan, small_pad)
    errors = [f for f in found(mesh, small_plan) if f.level == "error"]
    assert errors
    text = " ".join(f"{f.where} {f.message}" for f in errors)
    assert "nan" not in text.split()
    if kind.split()[0] not in ELSEWHERE and not any(f.code == "mesh.closed" for f in errors):
        assert any(f.code == "built.planned" and f.where == f"taxel {taxel.id}" for f in errors), errors


@pytest.mark.parametrize("way", WAYS)
def test_an_honest_pad_is_not_accused(way, small_pad, small_plan):
    assert found(WAYS[way](small_plan, small_pad), small_plan) == ()


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", [5, 8])
def test_honest_pads_of_random_specs(seed):
    plan, mesh, _ = honest(seed)
    assert found(mesh, plan) == ()


def test_what_is_found_is_as_small_as_is_said(small_pad):
    """Cubes on the border are a little larger and smaller than the stated one; a slab counts by its height."""
    solid = as_manifold(small_pad.mesh, "pad")
    top = small_pad.mesh.vertices_mm[small_pad.mesh.vertices_mm[:, 0] > 16][:, 2].max()

    def with_cube(*size):
        return differences(solid + box((*size[:2], 2 * size[2]), (16.0, 2.0, top)), solid)

    (cube,) = with_cube(*3 * [1.05 * SMALLEST_MM])
    assert cube.more
    assert cube.volume_mm3 == pytest.approx((1.05 * SMALLEST_MM) ** 3)
    assert cube.place_mm == pytest.approx((16, 2, top + 0.525 * SMALLEST_MM))
    assert with_cube(*3 * [0.95 * SMALLEST_MM]) == with_cube(1.0, 1.0, 0.95 * SMALLEST_MM) == []
    (missing,) = differences(solid, solid + box((1, 2, 4), (16, 2, top)))
    assert (missing.more, missing.extent_mm) == (False, pytest.approx((1, 2, 2)))


SQUARE = np.array([[[0, 0, 1], [1, 0, 1], [1, 1, 1]], [[0, 0, 1], [1, 1, 1], [0, 1, 1]]], float)
OTHERWISE = np.array([[[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[1, 0, 1], [1, 1, 1], [0, 1, 1]]], float)


def test_faces_cut_anew_are_told_from_others():
    """A square along its two diagonals: flat, sloping, moved by more and by less than the stated strip, turned over."""
    slope = np.array([[1, 0, 0], [0, 1, 0], [2, 1, 1]]).T
    assert same_faces(SQUARE, OTHERWISE) and same_faces(SQUARE @ slope, OTHERWISE @ slope)
    assert same_faces(SQUARE, OTHERWISE + np.array([0.8 * STRIP_MM, 0, 0]))
    assert not same_faces(SQUARE, OTHERWISE + np.array([1.2 * STRIP_MM, 0, 0]))
    assert not same_faces(SQUARE, OTHERWISE + np.array([0, 0, STRIP_MM]))
    assert not same_faces(SQUARE, OTHERWISE[:1]) and not same_faces(SQUARE, OTHERWISE[:, ::-1])


def turned(mesh, degrees):
    c = np.cos(np.radians(degrees))
    s = np.sin(np.radians(degrees))
    return mesh.vertices_mm @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def moves(mesh):
    v, t = mesh
    return {
        "moved by (40, 30, 2) mm": Mesh(v + np.array([40, 30, 2]), t),
        "turned by 90° about z": Mesh(turned(mesh, 90), t),
        "turned by -23.5° about z": Mesh(turned(mesh, -23.5) + np.array([100, 0, 0]), t),
        "upside down": Mesh(v * (1, -1, -1), t),
        "mirrored": Mesh(v * (-1, 1, 1), t[:, ::-1]),
        "25.4 times as large": Mesh(v * 25.4, t),
    }


@pytest.mark.parametrize("how", moves(Mesh(np.zeros((3, 3)), np.zeros((1, 3), int))))
def test_a_pad_that_only_lies_otherwise_is_said_to(how, small_pad, small_plan):
    mesh = as_single_precision(moves(small_pad.mesh)[how])
    (said,) = found(mesh, small_plan)
    assert said.code == "built.pose"
    assert how in said.message
    assert said.level == ("note" if "moved" in how or "turned" in how else "error")
    assert said.level == "note" or said.message.endswith("; figures and other findings are of the mesh put right")


def test_a_moved_pad_with_a_lump(small_pad, small_plan):
    mesh, _ = tampered("lump across a gap", 1, small_plan, small_pad)
    here = [f for f in found(mesh, small_plan) if f.code == "built.planned"]
    moved = found(Mesh(mesh.vertices_mm + np.array([5.0, 7.0, 0.0]), mesh.triangles), small_plan)
    assert here
    # At the plan's own coordinates.
    assert [f.where for f in moved if f.code == "built.planned"] == [f.where for f in here]
    assert moved[0].code == "built.pose"


def test_other_beams_are_said_in_one_sentence_for_all_that_differ_alike():
    text = SMALL.replace("= 4", "= 8").replace("[1, 1]", "[1, 2]").replace("width_mm = 25", "width_mm = 37")
    plan = make_plan(parse_spec(text))
    channel = plan.channels[0]
    beam = replace(channel.beam, width_mm=channel.beam.width_mm + 0.2)
    other = replace(plan, channels=(replace(channel, beam=beam), *plan.channels[1:]))
    (said,) = [f for f in found(build_pad(other).mesh, plan) if f.code == "built.planned"]
    assert f"beam width is {beam.width_mm:.5g} mm, planned are {channel.beam.width_mm:.5g} mm" in said.message
    assert "so are taxel" in said.message


def test_the_coupon_is_judged_as_one(small_plan):
    plan, pad = build_coupon(small_plan)
    report = check_foreign(as_single_precision(pad.mesh), small_plan.spec, small_plan)
    assert (report.figures["part"], report.findings) == ("coupon", ())
    lumped, _ = tampered("recess filled", 0, plan, pad)
    report = check_foreign(lumped, small_plan.spec, small_plan)
    assert report.figures["part"] == "coupon"
    assert any(f.code == "built.planned" for f in report.findings)


def test_a_tray_is_judged_as_one(small_plan):
    mesh = build_tray(small_plan).mesh
    report = check_foreign(as_single_precision(mesh), small_plan.spec, small_plan)
    assert report.figures["part"] == "tray"
    assert [f for f in report.findings if f.level == "error"] == []
    filled = from_manifold(as_manifold(mesh, "tray") + box((3, 3, 3), (5, 0, 2)))
    errors = [f for f in found(filled, small_plan) if f.level == "error"]
    assert any("more than planned near (" in f.message for f in errors)


def test_something_else_is_said_to_be(small_plan):
    said = [f for f in found(from_manifold(box((30, 20, 5), (0, 0, 0))), small_plan) if f.code == "built.other"]
    assert len(said) == 1


def test_a_sheet_is_no_pad(small_plan):
    """Seen from above the mesh is a line, and has no outline."""
    corners = np.array([(0, 0, 0), (30, 30, 0), (30, 30, 5), (0, 0, 5)], float)
    codes = {f.code for f in found(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]])), small_plan)}
    assert "built.other" in codes


def test_a_sample_has_every_tile_and_every_seam(wide_plan, paper_plan):
    def neighbours(plan, pad):
        kinds = np.pad(2 * pad.grid + turned_grid(plan), 1, constant_values=-1)
        along, across = (
            (a.ravel().tolist(), b.ravel().tolist())
            for a, b in ((kinds[1:], kinds[:-1]), (kinds[:, 1:], kinds[:, :-1]))
        )
        return set(zip(*along, strict=True)), set(zip(*across, strict=True))

    for plan in (wide_plan, paper_plan):
        pad = build_pad(plan)
        sample = sampled(plan, pad)
        assert len(sample.plan.taxels) < len(plan.taxels)
        assert neighbours(sample.plan, sample.pad) == neighbours(plan, pad)
        assert topology(sample.pad.mesh).closed
        there = {t.id: (t.x_mm, t.y_mm) for t in plan.taxels}
        for taxel in sample.plan.taxels:
            assert sample.places.in_pad(taxel.x_mm, taxel.y_mm) == pytest.approx(there[taxel.id])
        # Places of their own, too: what is measured about a coil's axis is about that coil's.
        assert {t.coil for t in sample.plan.taxels} <= {
            (i, j) for i in range(sample.plan.coils.rows) for j in range(sample.plan.coils.columns)
        }
        assert coil_axis_mm(sample.plan.coils, 0, 0)[0] < 0


def test_a_large_pad_whose_mesh_is_not_of_its_tiles(paper_plan):
    """The change lies far from the sample."""
    pad = build_pad(paper_plan)
    assert check_pad(pad, paper_plan).findings == ()
    mesh, taxel = tampered("recess shallower", 3, paper_plan, pad)
    assert taxel.coil > (1, 1)
    errors = check_pad(replace(pad, mesh=mesh), paper_plan).findings
    assert [f.where for f in errors if f.code == "built.planned"] == [f"taxel {taxel.id}"]


def test_triangles_that_both_have_are_proven(small_pad):
    mesh = small_pad.mesh
    order = np.random.default_rng(1).permutation(len(mesh.triangles))
    again = as_single_precision(Mesh(mesh.vertices_mm, np.roll(mesh.triangles, 1, axis=1)[order]))
    loose, lost, snapped = unmatched_triangles(again, mesh)
    assert not loose.any() and not lost.any()
    assert np.isin(snapped.vertices_mm, mesh.vertices_mm).all()
    loose, lost, _ = unmatched_triangles(Mesh(mesh.vertices_mm, mesh.triangles[2:]), mesh)
    assert (loose.sum(), lost.sum()) == (0, 2)
    loose, lost, _ = unmatched_triangles(Mesh(mesh.vertices_mm, mesh.triangles[:, ::-1]), mesh)
    assert loose.all() and lost.all()
    assert pose_of(again, mesh).share == 1


def test_numbers_in_a_3mf_are_read_alike_by_lib3mf(tmp_path):
    """All readers agree on signs, noughts at both ends, carries and large numbers."""
    from lib3mf import get_wrapper

    rng = np.random.default_rng(2)
    special = [
        0,
        -0.0,
        1e-6,
        -1e-6,
        4e-7,
        -4e-7,
        0.1,
        -0.25,
        9.9999996,
        10,
        100.5,
        -999.999999,
        1234.5,
        9999.000001,
        0.999999,
    ]
    values = np.concatenate([special, rng.uniform(-1000, 1000, 45)])
    mesh = Mesh(values.reshape(-1, 3), rng.permuted(np.arange(20).repeat(3)).reshape(-1, 3))
    mesh = Mesh(mesh.vertices_mm, np.array([[i, (i + 1) % 20, (i + 2) % 20] for i in range(20)]))
    path = tmp_path / "a.3mf"
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("[Content_Types].xml", _3mf._CONTENT_TYPES)
        package.writestr(
            "_rels/.rels",
            _3mf._RELATIONS.replace(
                b'<Relationship Id="rel1" Target="/Metadata/thumbnail.png"\n Type="http://schemas.openxmlformats.org/package/2006/relationships/metadata/thumbnail"/>\n',
                b"",
            ),
        )
        head = (_3mf._MODEL_HEAD + "<resources>\n").encode()
        tail = b'</resources><build><item objectid="1"/></build></model>'
        package.writestr(_3mf.MODEL, head + b"".join(_3mf._object(1, 'a "<&> b', mesh)) + tail)
    rows = {True: [], False: []}
    for is_vertices, numbers in _3mf.plain_rows(path):
        rows[is_vertices].append(numbers)
    plain = Mesh(np.concatenate(rows[True]), np.concatenate(rows[False]).astype(np.int64))
    for own in (plain, read_3mf(path, weld=False)):
        assert np.abs(own.vertices_mm - mesh.vertices_mm).max() <= 5e-7 * (1 + 1e-6)
        assert (own.triangles == mesh.triangles).all()
    model = get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    items = model.GetBuildItems()
    assert items.MoveNext()
    other = model.GetMeshObjectByID(items.GetCurrent().GetObjectResource().GetUniqueResourceID())
    # lib3mf's single precision.
    corners = [list(vertex.Coordinates) for vertex in other.GetVertices()]
    assert np.array(corners) == pytest.approx(mesh.vertices_mm, rel=1e-6, abs=1e-6)
    assert [list(triangle.Indices) for triangle in other.GetTriangleIndices()] == mesh.triangles.tolist()
