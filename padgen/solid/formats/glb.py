"""The GLB format: the pad with its washers as binary glTF, for viewers; parts beside the pad are not written."""

from typing import Any

import numpy as np

from padgen.core.errors import GeometryError
from padgen.core.files import OutputFolder
from padgen.planner.layout import to_cell
from padgen.solid.formats import ExportJob
from padgen.solid.mesh import Mesh
from padgen.solid.pad_solid import washer_mesh

__all__ = ["write"]


def write(out: OutputFolder, job: ExportJob) -> None:
    """Add the pad and its washers in metres with y up, as viewers expect; do nothing for parts beside the pad."""
    if job.pad is None:
        return
    import trimesh

    plan = job.plan
    turn = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], float)
    turn[:3] *= 1e-3
    scene = trimesh.Scene()
    colours = {"pad": (225, 222, 214, 255), "washer": (120, 125, 135, 255)}
    scene.add_geometry(_coloured(job.pad.mesh, colours["pad"]), geom_name="pad", node_name="pad", transform=turn)
    for channel in plan.channels:
        washer = washer_mesh(plan, channel)
        vertices = to_cell(washer.vertices_mm, channel)
        centre = to_cell(np.array([float(plan.arrangement(channel).washer_x_mm), 0.0, 0.0]), channel)
        part = _coloured(Mesh(vertices, washer.triangles), colours["washer"])
        for taxel in plan.taxels:
            if taxel.channel == channel.index:
                place = np.eye(4)
                place[:2, 3] = np.array([taxel.x_mm, taxel.y_mm]) - centre[:2]
                scene.add_geometry(
                    part, geom_name=f"washer-{channel.index}", node_name=f"washer-{taxel.id}", transform=turn @ place
                )
    data = scene.export(file_type="glb")
    back = trimesh.load(trimesh.util.wrap_as_stream(data), file_type="glb")
    if len(back.graph.nodes_geometry) != 1 + len(plan.taxels):
        raise GeometryError("read back, it lacks parts", "pad.glb")
    out.write("pad.glb", bytes(data))


def _coloured(mesh: Mesh, rgba: tuple[int, int, int, int]) -> Any:
    import trimesh

    material = trimesh.visual.material.PBRMaterial(baseColorFactor=rgba, metallicFactor=0.0, roughnessFactor=0.8)
    part = trimesh.Trimesh(mesh.vertices_mm, mesh.triangles, process=False)
    part.visual = trimesh.visual.TextureVisuals(material=material)
    return part
