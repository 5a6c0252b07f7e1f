"""Counts of edges."""

import numpy as np

from padgen.solid.mesh import Mesh, topology


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
