"""The GLB format: the pad over its coils and tray as binary glTF, for viewers; parts beside the pad are not written.

Every taxel, washer and coil is a node of its own, named after its taxel or numbered, on meshes that all copies share.
"""

import numpy as np

from padgen.core.errors import GeometryError
from padgen.core.files import OutputFolder
from padgen.solid.formats import ExportJob
from padgen.solid.mesh import unit_normals
from padgen.solid.scene import scene_parts

__all__ = ["write"]

COLOURS = {
    "pad": (225, 222, 214, 255),
    "steel": (120, 125, 135, 255),
    "ballast": (150, 140, 110, 255),
    "copper": (184, 117, 58, 255),
    "iron": (74, 78, 85, 255),
    "tray": (185, 192, 201, 255),
    "board": (79, 125, 92, 255),
    "guard": (201, 216, 197, 255),
}


def write(out: OutputFolder, job: ExportJob) -> None:
    """Add ``pad.glb`` in metres with y up, as viewers expect; do nothing for parts beside the pad."""
    if job.pad is None:
        return
    import trimesh

    turn = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], float)
    turn[:3] *= 1e-3
    scene = trimesh.Scene()
    pbr = trimesh.visual.material.PBRMaterial
    materials = {
        name: pbr(name=name, baseColorFactor=colour, metallicFactor=0.0, roughnessFactor=0.8)
        for name, colour in COLOURS.items()
    }
    parts = scene_parts(job.plan, job.pad)
    for part in parts:
        # A normal for each corner of each triangle, so that edges stay sharp.
        corners = part.mesh.corners_mm
        number = np.arange(3 * len(corners)).reshape(-1, 3)
        normals = np.repeat(unit_normals(corners), 3, axis=0)
        shape = trimesh.Trimesh(corners.reshape(-1, 3), number, vertex_normals=normals, process=False)
        shape.visual = trimesh.visual.TextureVisuals(material=materials[part.material])
        scene.geometry[part.name] = shape
        for place in part.places:
            at = np.diag([-1.0, -1.0, 1.0, 1.0]) if place.turned else np.eye(4)
            at[:3, 3] = place.x_mm, place.y_mm, place.z_mm
            scene.graph.update(place.name, matrix=turn @ at, geometry=part.name)
    data = scene.export(file_type="glb", include_normals=True)
    back = trimesh.load(trimesh.util.wrap_as_stream(data), file_type="glb")
    if len(back.graph.nodes_geometry) != sum(len(part.places) for part in parts):
        raise GeometryError("read back, it lacks parts", "pad.glb")
    out.write("pad.glb", bytes(data))
