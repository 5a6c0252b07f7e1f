"""The STL format: a mesh as binary STL."""

import numpy as np

from padgen import __version__
from padgen.core.files import OutputFolder
from padgen.solid.formats import ExportJob, verified
from padgen.solid.mesh import AT_ONCE, Mesh, unit_normals

__all__ = ["stl_bytes", "write"]

_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write(out: OutputFolder, job: ExportJob) -> None:
    """Add the part's mesh, and compare the file with it corner by corner."""
    part = job.part
    name = f"{part.name}.stl"
    title = f"{__version__} {part.title} {job.spec_hash[:16]}"
    path = out.write(name, stl_bytes(part.mesh, title))
    vertices, triangles = part.mesh
    for k in range(0, len(triangles), AT_ONCE):
        # The last block reads to the file's end, so that surplus triangles are noticed.
        count = AT_ONCE if k + AT_ONCE < len(triangles) else -1
        some = np.fromfile(path, _STL_TRIANGLE, count, offset=84 + k * _STL_TRIANGLE.itemsize)
        corners = some["corners"].reshape(-1, 3)
        read = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
        verified(name, Mesh(vertices, triangles[k : k + AT_ONCE]), read)


def stl_bytes(mesh: Mesh, title: str) -> bytearray:
    """Return the mesh as binary STL."""
    data = bytearray(84 + _STL_TRIANGLE.itemsize * len(mesh.triangles))
    data[:80] = f"padgen {title}".encode("ascii", "replace")[:80].ljust(80)
    data[80:84] = np.uint32(len(mesh.triangles)).tobytes()
    triangles = np.frombuffer(data, _STL_TRIANGLE, offset=84)
    for k in range(0, len(triangles), AT_ONCE):
        some = triangles[k : k + AT_ONCE]
        corners = mesh.vertices_mm[mesh.triangles[k : k + AT_ONCE]]
        some["normal"] = unit_normals(corners)
        some["corners"] = corners
    return data
