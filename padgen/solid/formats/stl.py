"""The STL format: a mesh as binary STL."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from padgen import __version__
from padgen.core.files import OutputFolder
from padgen.solid.formats import ExportJob, verify_written
from padgen.solid.mesh import AT_ONCE, Mesh, unit_normals

__all__ = ["stl_blocks", "write"]

_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write(out: OutputFolder, job: ExportJob) -> None:
    """Write the part's mesh as a binary STL file; raise GeometryError if a triangle, read back, differs."""
    part = job.part
    name = f"{part.name}.stl"
    title = f"{__version__} {part.title} {job.spec_hash[:16]}"

    def fill(path: Path) -> None:
        with path.open("wb") as file:
            file.writelines(stl_blocks(part.mesh, title))

    path = out.write_by(name, fill)
    vertices, triangles = part.mesh
    for k in range(0, len(triangles), AT_ONCE):
        # The last block reads to the file's end, so that surplus triangles are noticed.
        count = AT_ONCE if k + AT_ONCE < len(triangles) else -1
        some = np.fromfile(path, _STL_TRIANGLE, count, offset=84 + k * _STL_TRIANGLE.itemsize)
        corners = some["corners"].reshape(-1, 3)
        read = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
        verify_written(name, Mesh(vertices, triangles[k : k + AT_ONCE]), read)


def stl_blocks(mesh: Mesh, title: str) -> Iterator[bytes]:
    """Yield the bytes of a mesh's binary STL file, header first, then the triangles in blocks to save memory."""
    yield f"padgen {title}".encode("ascii", "replace")[:80].ljust(80) + np.uint32(len(mesh.triangles)).tobytes()
    for k in range(0, len(mesh.triangles), AT_ONCE):
        corners = mesh.vertices_mm[mesh.triangles[k : k + AT_ONCE]]
        some = np.zeros(len(corners), _STL_TRIANGLE)
        some["normal"] = unit_normals(corners)
        some["corners"] = corners
        yield some.tobytes()
