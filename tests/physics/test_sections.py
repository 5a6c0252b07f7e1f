"""Counts of edges, and pairs of triangles that pierce each other."""

import numpy as np

from padgen.solid.mesh import Mesh, intersecting_pairs, topology


def test_edges_are_counted(small_pad):
    """The counts agree with those taken edge by edge."""
    triangles = np.concatenate([small_pad.mesh.triangles[5:60], small_pad.mesh.triangles[5:7], [[1, 2, 3]]])
    triangles[20] = triangles[20, ::-1]
    mesh = Mesh(small_pad.mesh.vertices_mm, triangles)
    seen: dict[tuple[int, int], list[bool]] = {}
    for a, b, c in triangles.tolist():
        for i, j in ((a, b), (b, c), (c, a)):
            seen.setdefault((min(i, j), max(i, j)), []).append(i < j)
    state = topology(mesh)
    assert state.broken_edges == sum(sorted(ways) != [False, True] for ways in seen.values()) > 0
    assert topology(Mesh(np.empty((0, 3)), np.empty((0, 3), np.int64))).broken_edges == 0


def test_pierced_triangles_are_found_the_second_time_too():
    vertices = np.array([(0, 0, 0), (4, 0, 0), (0, 4, 0), (1, 1, -1), (1, 1, 1), (2, 1, 1)], float)
    mesh = Mesh(vertices, np.array([(0, 1, 2), (3, 4, 5)]))
    assert intersecting_pairs(mesh).tolist() == intersecting_pairs(mesh).tolist() == [[0, 1]]
    apart = Mesh(vertices + np.array([0, 0, 1.0]) * (np.arange(6)[:, None] > 2) * 5, mesh.triangles)
    assert intersecting_pairs(apart).tolist() == []
