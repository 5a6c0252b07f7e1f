"""Geometry: the mesh that is printed against the B-rep that was modelled, by chord tolerance."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from padgen.ladders.rung import Ladder, Rung, Solved, Theory
from padgen.ladders.stages.scene import Scene, distinct_channels
from padgen.planner.plan import Plan

__all__ = ["exact_volumes", "geometry_ladders", "mesh_volumes", "taxel_solids"]

CHORDS_MM = (0.04, 0.01, 0.0025, 0.000625, 0.00015625)
TOLERANCES = (1e-3, 1e-6, 1e-9)
KERNEL = ("build123d", "padgen.solid.taxel")
CHORD = "mesh, chord and angle together"


def geometry_ladders(scene: Scene) -> Iterator[Ladder]:
    """One ladder: the volumes of all distinct taxels, with the frame of their sub-cells."""
    from padgen.solid.mesh import ANGLE_RAD, CHORD_MM

    count, model = len(distinct_channels(scene.plan)), partial(taxel_solids, scene.plan)
    rungs = []
    for chord in CHORDS_MM:
        # The height of a segment goes with the square of its angle.
        angle = ANGLE_RAD * (chord / CHORD_MM) ** 0.5
        solve = partial(mesh_volumes, chord, angle)
        rungs.append(Rung("mesh", f"chord {chord:.2g} mm, {angle:.2g} rad", solve, CHORD, chord, KERNEL, prepare=model))
    for tolerance in TOLERANCES:
        solve = partial(exact_volumes, tolerance)
        label = f"integrated to {tolerance:g}"
        rungs.append(Rung("B-rep", label, solve, "B-rep", imports=KERNEL, prepare=model, offered=False))
    yield Ladder(
        "geometry",
        f"{count} distinct taxel{'s' if count > 1 else ''}",
        "volume of the printed solid",
        "mm³",
        tuple(rungs),
        "B-rep",
        "each",
        {CHORD: Theory(1, "a segment's area goes with its height, the chord tolerance", True)},
        f"a build meshes with a chord of {CHORD_MM:g} mm and {ANGLE_RAD:g} rad; the unknowns are triangles and faces",
    )


def taxel_solids(plan: Plan) -> list[Any]:
    """The build123d solids of all distinct taxels."""
    from padgen.solid.taxel import taxel_solid

    return [taxel_solid(plan, channel) for channel in distinct_channels(plan)]


def mesh_volumes(chord_mm: float, angle_rad: float, solids: list[Any]) -> Solved:
    """Volumes in mm³ of the solids' triangles."""
    from padgen.solid.mesh import signed_volume_mm3, tessellated

    meshes = [tessellated(solid, chord_mm, angle_rad) for solid in solids]
    return Solved(np.array([signed_volume_mm3(mesh) for mesh in meshes]), sum(len(m.triangles) for m in meshes))


def exact_volumes(tolerance: float, solids: list[Any]) -> Solved:
    """Volumes in mm³ of the solids by adaptive integration over their faces, to a relative `tolerance`."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    from padgen.solid.kernel import kernel_errors

    volumes = []
    with kernel_errors("a volume"):
        for solid in solids:
            found = GProp_GProps()
            BRepGProp.VolumeProperties_s(solid.wrapped, found, tolerance)
            volumes.append(float(found.Mass()))
    return Solved(np.array(volumes), sum(len(solid.faces()) for solid in solids))
