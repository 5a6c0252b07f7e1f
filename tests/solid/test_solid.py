"""Solids and the pad made of them: volumes by hand, seams, places, and checks by other programs."""

import importlib
import signal
from dataclasses import replace

import numpy as np
import pytest

from padgen.core.errors import GeometryError
from padgen.planner import make_plan
from padgen.planner.layout import outline, to_cell
from padgen.planner.suspensions import names
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.mesh import as_manifold, signed_volume_mm3, tessellated, topology, welded
from padgen.solid.pad_solid import build_pad, tile_grid
from padgen.solid.taxel import taxel_solid, washer_solid
from padgen.spec import parse_spec
from tests.conftest import FOUR_LINES


def volume_by_hand(plan, channel):
    """Add up frame less window, beams with flares, blocks, and boss with chamfer, less the recess."""
    spec = plan.spec
    made = plan.arrangement(channel)
    taxel = spec.taxel
    pad = spec.pad
    beam = channel.beam
    frame = (plan.cell.width_mm * plan.cell.depth_mm - float(np.prod(made.window_mm))) * pad.frame_thickness_mm
    flare = 2 * beam.fillet_mm**2 * (1 - np.pi / 4)
    beams = len(made.beams) * (beam.width_mm * beam.length_mm + flare) * beam.thickness_mm
    blocks = sum((b.high_x_mm - b.low_x_mm) * (b.high_y_mm - b.low_y_mm) * b.height_mm for b in made.blocks)
    radius = taxel.boss_diameter_mm / 2
    edge = taxel.boss_edge_mm
    height = pad.frame_thickness_mm + taxel.boss_protrusion_mm - taxel.plate_thickness_mm
    boss = np.pi * radius**2 * (height - edge) + np.pi * edge / 3 * (
        radius**2 + radius * (radius - edge) + (radius - edge) ** 2
    )
    washer = spec.washer
    recess = (
        np.pi
        / 4
        * (washer.outer_diameter_mm + taxel.washer_clearance_mm) ** 2
        * (washer.thickness_mm + taxel.glue_gap_mm)
    )
    return frame + beams + float(blocks) + boss - recess


@pytest.mark.parametrize("topology_name", names())
def test_volume_of_a_taxel_by_hand(topology_name):
    text = FOUR_LINES.replace("[50, 200]", "[100, 900]") + "resonances_hz = [150, 300]\ncoil = { grid = [2, 1] }\n"
    text += f"suspension = {{ topology = '{topology_name}' }}\npad = {{ width_mm = 30, depth_mm = 30 }}\n"
    plan = make_plan(parse_spec(text))
    for channel in plan.channels:
        solid = taxel_solid(plan, channel)
        assert float(solid.volume) == pytest.approx(volume_by_hand(plan, channel), rel=1e-9)


def test_a_pad_without_bosses_is_built(small_plan):
    spec = small_plan.spec
    flat = make_plan(replace(spec, taxel=replace(spec.taxel, boss_protrusion_mm=0.0, boss_edge_mm=0.0)))
    for channel in flat.channels:
        assert float(taxel_solid(flat, channel).volume) == pytest.approx(volume_by_hand(flat, channel), rel=1e-9)


def test_post_stands_in_the_recess(small_plan):
    spec = small_plan.spec
    with_post = make_plan(replace(spec, taxel=replace(spec.taxel, centre_post=True)))
    channel = with_post.channels[0]
    grown = float(taxel_solid(with_post, channel).volume) - volume_by_hand(with_post, channel)
    assert grown == pytest.approx(np.pi / 4 * (1.7 - 0.25) ** 2 * 0.4, rel=1e-6)


def test_washer_touches_the_roof_of_its_recess(small_plan):
    washer = washer_solid(small_plan, small_plan.channels[0])
    box = washer.bounding_box()
    assert (pytest.approx(0.1), pytest.approx(0.4)) == (box.min.Z, box.max.Z)
    assert float(washer.volume) == pytest.approx(np.pi / 4 * (3.5**2 - 1.7**2) * 0.3)


def test_pad_volume_is_its_tiles_and_border(small_pad, small_plan):
    tiles = sum(volume_by_hand(small_plan, small_plan.channels[t.channel]) for t in small_plan.taxels)
    pad = small_plan.spec.pad
    side = 25 + 2 * pad.border_mm
    radius = pad.border_mm / 2
    groove = 1.5 * 1.0
    border = side**2 - (4 - np.pi) * radius**2 - 25**2 - np.pi * pad.hole_diameter_mm**2 - groove
    assert small_pad.volume_mm3 == pytest.approx(tiles + border * pad.frame_thickness_mm, rel=1e-9)
    # Chords of 0.01 mm on holes and bosses.
    assert signed_volume_mm3(small_pad.mesh) == pytest.approx(small_pad.volume_mm3, rel=1e-4)


def test_pad_is_closed_and_whole(small_pad):
    state = topology(small_pad.mesh)
    assert state.closed
    assert state.shells == 1
    # One hole per window and per screw.
    assert as_manifold(small_pad.mesh, "pad").genus() == 4 + 4


def test_seams_leave_no_doubled_vertices(small_pad):
    vertices = np.round(small_pad.mesh.vertices_mm, 6)
    assert len(np.unique(vertices, axis=0)) == len(vertices)


def test_empty_places_are_plain_frame():
    text = FOUR_LINES.replace("= 4", "= 7") + "coil = { grid = [2, 2] }\n"
    plan = make_plan(parse_spec(text))
    grid = tile_grid(plan)
    assert (grid == len(plan.channels)).sum() == 1
    pad = build_pad(plan)
    assert topology(pad.mesh).closed
    assert as_manifold(pad.mesh, "pad").genus() == 7 + 4


def test_bosses_stand_where_the_plan_says(small_pad, small_plan):
    solid = as_manifold(small_pad.mesh, "pad")
    pad = small_plan.spec.pad
    taxel = small_plan.spec.taxel
    top = pad.frame_thickness_mm + taxel.boss_protrusion_mm
    for place in small_plan.taxels:
        hits = solid.ray_cast((place.x_mm, place.y_mm, 20.0), (place.x_mm, place.y_mm, -1.0))
        assert 20 - hits[0].distance * 21 == pytest.approx(top)


def test_solid_washer_and_plan_agree_on_the_washers_place(paper_plan):
    for channel in paper_plan.channels:
        own = np.array([float(paper_plan.arrangement(channel).washer_x_mm), 0.0, 0.0])
        x, y, _ = to_cell(own, channel)
        assert np.hypot(x, y) == pytest.approx(channel.site.coil_distance_mm)


def test_outline_is_the_sub_cell(paper_plan):
    for channel in paper_plan.channels:
        sides = outline(paper_plan, channel)
        corners = np.array([[sides.x0, sides.y0, 0.0], [sides.x1, sides.y1, 0.0]])
        placed = np.sort(to_cell(corners, channel)[:, :2], axis=0)
        centre = np.array(channel.site.centre_mm)
        half = np.array([paper_plan.cell.width_mm, paper_plan.cell.depth_mm]) / 2
        assert placed == pytest.approx(np.stack([centre - half, centre + half]))


@pytest.mark.parametrize("chord", [0.1, 0.01])
def test_chord_is_kept(chord):
    solid = build123d().Solid.make_cylinder(10, 1)
    mesh = tessellated(solid, chord, 3.0)
    middle = mesh.corners_mm[:, [0, 1, 2]].mean(1)
    rim = mesh.vertices_mm[np.hypot(*mesh.vertices_mm[:, :2].T) > 9.9]
    assert np.hypot(*rim[:, :2].T) == pytest.approx(10)
    sides = np.abs(middle[:, 2] - 0.5) < 0.4
    edges = mesh.corners_mm[sides]
    shortest = np.hypot(*((edges[:, 0] + edges[:, 1]) / 2)[:, :2].T).min()
    assert 10 - shortest <= chord * 1.001


def test_same_plan_same_mesh(small_plan):
    one, two = (build_pad(small_plan).mesh for _ in range(2))
    assert one.vertices_mm.tobytes() == two.vertices_mm.tobytes()
    assert one.triangles.tobytes() == two.triangles.tobytes()


def test_kernel_errors_are_ours():
    with pytest.raises(GeometryError, match="refused the cube"), kernel_errors("the cube"):
        build123d().Solid.make_box(-1, 0, 0)
    with pytest.raises(GeometryError, match="refused a face"), kernel_errors("a face"):
        raise RuntimeError("StdFail_NotDone")


@pytest.mark.parametrize("kind", [RuntimeError, ValueError, TypeError, AttributeError, IndexError])
def test_every_kernel_exception_is_mapped(kind):
    with pytest.raises(GeometryError), kernel_errors("a part"):
        raise kind("x")


def test_every_occt_exception_is_mapped():
    build123d()
    from OCP import Standard, StdFail

    kinds = [
        v for m in (Standard, StdFail) for v in vars(m).values() if isinstance(v, type) and issubclass(v, Exception)
    ]
    assert len(kinds) > 10
    for kind in kinds:
        with pytest.raises(GeometryError), kernel_errors("a part"):
            raise kind("x")


def test_what_no_kernel_raised_passes_through():
    with pytest.raises(KeyError), kernel_errors("a part"):
        raise KeyError("x")


def test_what_build123d_imports_late_still_works(tmp_path):
    """Clusters of scikit-learn, curves of svgpathtools and hulls of scipy are fetched when they are used."""
    import sys

    made = build123d()
    assert not any(type(module).__name__ == "_Deferred" for module in sys.modules.values())
    from build123d import brep_from_stl

    groups = brep_from_stl.DBSCAN(eps=1.0, min_samples=1).fit(np.array([[0.0], [0.1], [9.0]])).labels_
    assert len(set(groups)) == 2
    drawing = made.ExportSVG()
    drawing.add_shape(made.Face.make_rect(3, 2) - made.Face(made.Wire.make_circle(0.5)))
    drawing.write(str(tmp_path / "a.svg"))
    assert "<path" in (tmp_path / "a.svg").read_text()
    corners = [made.Vector(*at) for at in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.1, 0.1, 0.1))]
    assert made.ConvexPolyhedron(corners).volume == pytest.approx(1 / 6)


def test_ctrl_c_waits_until_the_kernel_is_imported(monkeypatch):
    imported = []

    def import_module(name):
        signal.raise_signal(signal.SIGINT)
        imported.append(name)

    monkeypatch.setattr(importlib, "import_module", import_module)
    with pytest.raises(KeyboardInterrupt):
        build123d.__wrapped__()
    assert imported == ["build123d"]


def test_welding_joins_and_drops():
    mesh = welded(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1e-8]], float), np.array([[0, 1, 2], [0, 3, 1]]))
    assert len(mesh.vertices_mm) == 3
    assert len(mesh.triangles) == 1
