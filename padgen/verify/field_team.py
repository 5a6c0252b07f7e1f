"""A published problem with a measured answer: TEAM 20, the force on the pole of a saturated electromagnet.

Takahashi, Nakata and Morishige 1994, steel `TEAM_STEEL`. Dimensions in mm as in the problem's description.
"""

from typing import Any, NamedTuple

from padgen.physics.saturation import TEAM_STEEL
from padgen.verify.engines import engine
from padgen.verify.field_scalar import BodyWrench, ScalarField, body_wrench, solve_scalar

__all__ = ["Racetrack", "team_20_force"]


class Racetrack(NamedTuple):
    """A square winding with rounded corners, upright about the z axis; half widths, radii and heights in mm."""

    inner_mm: float
    outer_mm: float
    inner_radius_mm: float
    low_mm: float
    high_mm: float

    def solid(self, occ: Any, half_width_mm: float) -> Any:
        """The upright prism of the winding's inner or outer outline."""
        radius = self.inner_radius_mm + half_width_mm - self.inner_mm
        height = self.high_mm - self.low_mm
        lower, upper = (
            occ.Pnt(s * half_width_mm, s * half_width_mm, z) for s, z in ((-1, self.low_mm), (1, self.high_mm))
        )
        prism = occ.Box(lower, upper)
        upright = [e for e in prism.edges if abs(e.vertices[0].p.z - e.vertices[1].p.z) > height / 2]
        return prism.MakeFillet(upright, radius)

    def source(self, ng: Any, ampere_turns: float) -> Any:
        """T in A/m: along z, full inside, falling to 0 across the winding."""
        straight = self.inner_mm - self.inner_radius_mm
        x, y = (ng.IfPos(abs_ - straight, abs_ - straight, 0) for abs_ in (ng.sqrt(c**2) for c in (ng.x, ng.y)))
        share = 1 - (ng.sqrt(x**2 + y**2) - self.inner_radius_mm) / (self.outer_mm - self.inner_mm)
        share = ng.IfPos(share, ng.IfPos(share - 1, 1, share), 0)
        height = self.high_mm - self.low_mm
        within = ng.IfPos((ng.z - self.low_mm) * (self.high_mm - ng.z), 1, 0)
        return ng.CF((0, 0, 1e3 * ampere_turns / height * within * share))


def team_20_force(
    currents_a: "list[float]", order: int = 2, fineness: float = 1.0
) -> list[tuple[float, BodyWrench, ScalarField]]:
    """Pull in N (positive towards the yoke below) on the pole of problem 20 at each current, 1000 turns.

    `fineness` divides the element sizes.

    Raises
    ------
    SolverError
        Newton's method does not converge.
    """
    ng = engine("ngsolve")
    coil = Racetrack(19.5, 37.5, 5.0, 26.7, 123.3)
    mesh, far = _team_20_mesh(coil, fineness)
    steels = {"yoke": TEAM_STEEL, "pole": TEAM_STEEL}
    results = []
    for current in currents_a:
        solved = solve_scalar(mesh, coil.source(ng, 1000 * current), steels, far, order, 4.0)
        wrench = body_wrench(solved, "pole", (0, 0, 0))
        results.append((-float(wrench.virtual_work[2]), wrench, solved))
    return results


def _block(occ: Any, x: float, y: float, low: float, high: float) -> Any:
    """The quarter x, y ≥ 0 of a block about the z axis, by half widths."""
    return occ.Box(occ.Pnt(0, 0, low), occ.Pnt(x, y, high))


def _team_20_mesh(coil: Racetrack, fineness: float) -> tuple[Any, float]:
    """A quarter of problem 20."""
    occ = engine("netgen.occ")
    far = 600.0
    quarter = occ.Box(occ.Pnt(0, 0, -2 * far), occ.Pnt(2 * far, 2 * far, 2 * far))
    yoke = _block(occ, 63.5, 12.5, 0, 150) - _block(occ, 38.5, 12.5, 25, 125) - _block(occ, 13.5, 12.5, 125, 150)
    pole = _block(occ, 12.5, 5, 26.5, 125)
    within = coil.solid(occ, coil.inner_mm) * quarter
    winding = (coil.solid(occ, coil.outer_mm) * quarter - within).mat("winding")
    # The source jumps at the ends of the winding: the mesh has a face there, also through the pole.
    poles = [(pole * within).mat("pole"), (pole - within).mat("pole")]
    bore = (within - pole).mat("air")
    yoke.mat("yoke").maxh = 12 / fineness
    for part in poles:
        part.maxh = 5 / fineness
        part.faces[occ.Z < 30].maxh = 1.5 / fineness
    parts = [yoke, winding, bore, *poles]
    air = occ.Sphere(occ.Pnt(0, 0, 75), far)
    air.faces.name = "far"
    air *= quarter
    for part in parts:
        air -= part
    shape = occ.Glue([*parts, air.mat("air")])
    return _meshed(occ, shape, far), far


def _meshed(occ: Any, shape: Any, far: float) -> Any:
    ng = engine("ngsolve")
    grown = occ.OCCGeometry(shape).GenerateMesh(maxh=far / 3, grading=0.4, parallel_meshing=False, optsteps3d=3)
    mesh = ng.Mesh(grown)
    mesh.Curve(2)
    return mesh
