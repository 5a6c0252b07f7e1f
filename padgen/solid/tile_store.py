"""Cache of the triangles of distinct taxels, so that a known taxel needs no CAD kernel."""

import io
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from padgen.core import cache
from padgen.planner.plan import Channel, Plan
from padgen.planner.tile import shape_inputs
from padgen.solid.mesh import Mesh

__all__ = ["KnownSolid", "kept_solid", "known_solid", "taxel_key"]

KIND = "taxel-mesh"
CODE = ("solid/taxel.py", "solid/mesh.py", "planner/suspensions/__init__.py", "planner/tile.py")
PACKAGES = ("build123d", "cadquery-ocp-novtk", "numpy")


class KnownSolid(NamedTuple):
    """Triangles of a taxel in its own axes, and its exact volume."""

    mesh: Mesh
    volume_mm3: float


def taxel_key(plan: Plan, channel: Channel, **detail: Any) -> str:
    """Return the cache key of everything that the solid of a taxel depends on, and of `detail`."""
    return cache.key_of(
        {
            **shape_inputs(plan, channel),
            "code": cache.code_hash(*CODE),
            "versions": [cache.version(name) for name in PACKAGES],
            **detail,
        }
    )


def known_solid(key: str) -> KnownSolid | None:
    """Return the taxel kept under `key`, or None where there is none or its data are damaged."""
    data = cache.load_bytes(KIND, key)
    if data is None:
        return None
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            mesh, volume_mm3 = Mesh(arrays["vertices_mm"], arrays["triangles"]), float(arrays["volume_mm3"])
        whole = _is_whole(mesh) and volume_mm3 > 0
    except Exception:  # damaged data raise errors of many kinds
        return None
    return KnownSolid(mesh, volume_mm3) if whole else None


def _is_whole(mesh: Mesh) -> bool:
    """Return whether the arrays have the types, shapes and indices of a mesh."""
    vertices, triangles = mesh
    if vertices.dtype.kind != "f" or triangles.dtype.kind != "i":
        return False
    if vertices.shape[1:] != (3,) or triangles.shape[1:] != (3,) or not len(triangles):
        return False
    return bool(np.isfinite(vertices).all() and triangles.min() >= 0 and triangles.max() < len(vertices))


def kept_solid(key: str, make: Callable[[], KnownSolid]) -> KnownSolid:
    """Return the taxel kept under `key`, or make it with `make` and keep it."""

    def made() -> KnownSolid:
        solid, data = make(), io.BytesIO()
        mesh = solid.mesh
        np.savez(data, vertices_mm=mesh.vertices_mm, triangles=mesh.triangles, volume_mm3=solid.volume_mm3)
        cache.store_bytes(KIND, key, data.getvalue())
        return solid

    return cache.once(KIND, key, lambda: known_solid(key), made)
