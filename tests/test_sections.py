"""Large cross-sections are looked at in strips: the same findings, in time in proportion to their corners."""

import numpy as np
import pytest

from padgen.solid import sections
from padgen.solid.checks import check_pad
from padgen.solid.mesh import Mesh, as_manifold, ordered
from padgen.solid.sections import Section, narrow_gaps, narrow_walls
from padgen.solid.topology import intersecting_pairs, topology


@pytest.fixture
def comb():
    """A plate of 60 x 20 mm with slots whose walls and gaps are 0.3 mm here and 0.6 mm there, lying and standing."""
    import manifold3d

    plate = manifold3d.CrossSection.square((60, 20))
    slots = [manifold3d.CrossSection.square((0.6, 6)).translate((x, 3)) for x in (4, 4.9, 30, 31.2, 52)]
    slots += [manifold3d.CrossSection.square((0.3, 5)).translate((x, 12)) for x in (12, 33)]
    slots += [manifold3d.CrossSection.square((50, 0.6)).translate((5, y)) for y in (18.0, 18.9)]
    return Section(1.0, plate - manifold3d.CrossSection.batch_boolean(slots, manifold3d.OpType.Add))


def places(found):
    return sorted((round(n.x_mm, 3), round(n.y_mm, 3), round(n.area_mm2, 2)) for n in found)


@pytest.mark.parametrize("judge", [narrow_walls, narrow_gaps])
@pytest.mark.parametrize("limit_mm", [0.45, 0.7])
def test_strips_find_what_the_whole_finds(comb, judge, limit_mm, monkeypatch):
    whole = judge(comb, limit_mm)
    assert len(sections._strips(comb.shape, 2.0)) == 1
    monkeypatch.setattr(sections, "STRIP_CORNERS", 8)
    monkeypatch.setattr(sections, "STRIP_MM", 5.0)
    assert len(sections._strips(comb.shape, 2.0)) > 3
    assert whole
    found = judge(comb, limit_mm)
    # Clipper's own grid, and a core's edge through a piece.
    assert np.array(places(found)) == pytest.approx(np.array(places(whole)), abs=0.011)


def test_a_pad_in_strips_has_the_same_report(small_pad, small_plan, monkeypatch):
    whole = check_pad(small_pad, small_plan)
    monkeypatch.setattr(sections, "STRIP_CORNERS", 100)
    monkeypatch.setattr(sections, "STRIP_MM", 5.0)
    assert check_pad(small_pad, small_plan) == whole


def test_the_order_of_triangles_is_no_matter(small_pad):
    mesh = small_pad.mesh
    rng = np.random.default_rng(1)
    turned = np.stack([np.roll(t, rng.integers(0, 3)) for t in mesh.triangles])
    shuffled = Mesh(mesh.vertices_mm, rng.permutation(turned))
    assert np.array_equal(ordered(shuffled).triangles, ordered(mesh).triangles)
    assert as_manifold(ordered(mesh), "pad").volume() == pytest.approx(as_manifold(mesh, "pad").volume(), rel=1e-12)


def test_edges_are_counted(small_pad):
    """Against a count edge by edge."""
    triangles = np.concatenate([small_pad.mesh.triangles[5:60], small_pad.mesh.triangles[5:7], [[1, 2, 3]]])
    triangles[20] = triangles[20, ::-1]
    mesh = Mesh(small_pad.mesh.vertices_mm, triangles)
    seen: dict[tuple[int, int], list[bool]] = {}
    for a, b, c in triangles.tolist():
        for i, j in ((a, b), (b, c), (c, a)):
            seen.setdefault((min(i, j), max(i, j)), []).append(i < j)
    state = topology(mesh)
    assert state.open_edges == sum(len(ways) == 1 for ways in seen.values())
    assert state.crowded_edges == sum(len(ways) > 2 for ways in seen.values()) > 0
    assert state.turned_edges == sum(len(ways) == 2 and ways[0] == ways[1] for ways in seen.values()) > 0
    assert topology(Mesh(np.empty((0, 3)), np.empty((0, 3), np.int64))).open_edges == 0


def test_pierced_triangles_are_found_the_second_time_too():
    vertices = np.array([(0, 0, 0), (4, 0, 0), (0, 4, 0), (1, 1, -1), (1, 1, 1), (2, 1, 1)], float)
    mesh = Mesh(vertices, np.array([(0, 1, 2), (3, 4, 5)]))
    assert intersecting_pairs(mesh).tolist() == intersecting_pairs(mesh).tolist() == [[0, 1]]
    apart = Mesh(vertices + np.array([0, 0, 1.0]) * (np.arange(6)[:, None] > 2) * 5, mesh.triangles)
    assert intersecting_pairs(apart).tolist() == []
