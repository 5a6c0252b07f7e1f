"""Pull of a coil on washers anywhere above it, by finite elements in three dimensions.

With a steel it is solved on the B-H curve; several washers shield each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, SpecError, number
from padgen.physics.magnetics import CoilSource, SteelRing
from padgen.physics.saturation import BHCurve
from padgen.verify.engines import ng, occ
from padgen.verify.field_axisymmetric import (
    WIDEST,
    ScalarField,
    Steel,
    body_wrench,
    check_parts,
    coil_cells,
    solve_scalar,
    wound,
)

__all__ = ["PlacedWasher", "Pull", "SolidForce", "solid_force", "solid_pull"]

FAR = 8.0
"""Radius of the far sphere over the largest distance of a part from the coil's middle."""
SHRINK = 0.2


class PlacedWasher(NamedTuple):
    """A washer whose underside's middle lies at (`x_m`, `y_m`, `gap_m`) from the middle of the coil's top face."""

    ring: SteelRing
    gap_m: float
    x_m: float
    y_m: float = 0.0
    steel: BHCurve | None = None


class SolidForce(NamedTuple):
    """Wrench (washers, 6) on each washer: force in N and moment in N·m about its axis at its underside.

    Axes as `PlacedWasher`'s; `surface` is the same by a second method (`field_axisymmetric.BodyWrench`), `error` the
    larger of their disagreement and the step from elements of one order less, relative to the force.
    """

    wrench: np.ndarray
    surface: np.ndarray
    error: float
    unknowns: int
    residual: float


def solid_force(
    coil: CoilSource,
    washers: Sequence[PlacedWasher],
    current_a: float = 1.0,
    core_steel: BHCurve | None = None,
    order: int = 3,
    levels: int = 1,
    size: float = 1.0,
) -> SolidForce:
    """Return forces and moments on `washers` above a coil that carries `current_a`.

    A steel of None is linear, with the part's permeability. Elements of `order` (at least 2), refined
    `levels` times towards the edges of core and washers; those of washers are `size` times as large as usual. Where
    all washers lie on y = 0 half the model is solved.

    Raises
    ------
    SpecError
        No washer, washers that overlap, or a dimension that makes no part.
    SolverError
        The parts cannot be meshed, Newton's method does not converge, or the force's own error is more than a
        fifth of it (a washer far away).
    """
    _check(coil, washers)
    half = all(abs(w.y_m) < 1e-9 for w in washers)
    mesh, far_mm = _mesh(coil, washers, half, levels, size)
    steels: dict[str, Steel] = {f"washer{i}": w.steel or w.ring.permeability for i, w in enumerate(washers)}
    steels["core"] = core_steel or coil.core_permeability
    saturates = any(isinstance(steel, BHCurve) for steel in steels.values())
    source, weight = ng.CF((0, 0, wound(coil, current_a, ng.sqrt(ng.x**2 + ng.y**2), ng.z)[0])), 2.0 if half else 1.0
    kept = np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0]) if half else np.ones(6)

    def at_order(p: int, start: ScalarField | None) -> tuple[ScalarField, np.ndarray, np.ndarray]:
        solved = solve_scalar(mesh, source, steels, far_mm, p, weight, start)
        both = [body_wrench(solved, f"washer{i}", _foot_mm(w)) for i, w in enumerate(washers)]
        return solved, kept * [b.virtual_work for b in both], kept * [b.surface for b in both]

    first, coarse, _ = at_order(order - 1, None)
    solved, wrench, surface = at_order(order, first if saturates else None)
    size = np.linalg.norm(wrench[:, :3], axis=1).max()
    off = max(np.linalg.norm((other - wrench)[:, :3], axis=1).max() for other in (coarse, surface))
    error = float(off / size) if size > 0 else 0.0
    if error > WIDEST:
        raise SolverError(
            f"the pull drowns in the field's own error, {number(error)} of it, which may be {WIDEST}: a higher order"
            f" than {order} or a washer nearer to the coil would do"
        )
    return SolidForce(
        wrench=wrench,
        surface=surface,
        error=error,
        unknowns=solved.unknowns,
        residual=solved.residual,
    )


def _foot_mm(washer: PlacedWasher) -> tuple[float, float, float]:
    return 1e3 * washer.x_m, 1e3 * washer.y_m, 1e3 * washer.gap_m


def _check(coil: CoilSource, washers: Sequence[PlacedWasher]) -> None:
    if not washers:
        raise SpecError("needs at least one washer, got none", "washers")
    for w in washers:
        check_parts(coil, w.ring, w.gap_m)
    for i, one in enumerate(washers):
        for other in washers[i + 1 :]:
            apart = float(np.hypot(one.x_m - other.x_m, one.y_m - other.y_m))
            least = (one.ring.outer_diameter + other.ring.outer_diameter) / 2
            above = max(one.gap_m - other.gap_m - other.ring.thickness, other.gap_m - one.gap_m - one.ring.thickness)
            if apart <= least and above <= 0:
                raise SpecError(
                    f"two washers must be more than {number(least)} m apart, got {number(apart)} m", "washers"
                )


def _mesh(coil: CoilSource, washers: Sequence[PlacedWasher], half: bool, levels: int, size: float) -> tuple[Any, float]:
    """Return the mesh in mm and the far sphere's radius in mm."""
    length = 1e3 * coil.length
    parts = _coil_parts(coil)
    reach = float(np.hypot(500 * coil.outer_diameter, length / 2))
    for i, w in enumerate(washers):
        x, y, z = _foot_mm(w)
        rim, high = 500 * w.ring.outer_diameter, 1e3 * w.ring.thickness
        body = _tube((x, y, z), 500 * w.ring.inner_diameter, rim, high)
        body.mat(f"washer{i}").maxh = size * max(high, rim / 2)
        parts.append(body)
        reach = max(reach, float(np.hypot(np.hypot(x, y) + rim, z + high + length / 2)))
    far = FAR * reach
    air = occ.Sphere(occ.Pnt(0, 0, -length / 2), far)
    air.faces.name = "far"
    for part in parts:
        air -= part
    shape = occ.Glue([*parts, air.mat("air")])
    if half:
        shape *= occ.Box(occ.Pnt(-2 * far, 0, -2 * far), occ.Pnt(2 * far, 2 * far, 2 * far))
    _mark_edges(shape, coil, washers)
    try:
        grown = occ.OCCGeometry(shape).GenerateMesh(maxh=far / 3, grading=0.5, parallel_meshing=False, optsteps3d=3)
    except Exception as error:  # netgen raises its own and the geometry kernel's types
        raise SolverError(f"coil and washers could not be meshed ({error})") from error
    mesh = ng.Mesh(grown)
    if levels:
        mesh.RefineHP(levels, SHRINK)
    mesh.Curve(3)
    return mesh, far


def _coil_parts(coil: CoilSource) -> list[Any]:
    parts = []
    for name, inner, outer, low, high in coil_cells(coil):
        foot = (0.0, 0.0, low)
        if inner > 0:
            part = _tube(foot, inner, outer, high - low)
        else:
            part = occ.Cylinder(occ.Pnt(*foot), occ.Z, outer, high - low)
        part.mat(name)
        if name == "core":
            part.faces.maxh = 0.6 * outer
        parts.append(part)
    return parts


def _tube(foot: tuple[float, float, float], inner: float, outer: float, height: float) -> Any:
    point = occ.Pnt(*foot)
    return occ.Cylinder(point, occ.Z, outer, height) - occ.Cylinder(point, occ.Z, inner, height)


def _mark_edges(shape: Any, coil: CoilSource, washers: Sequence[PlacedWasher]) -> None:
    """Mark the circular edges of core and washers, where the field is singular, for refinement."""
    core, top = 500 * coil.core_diameter, 1e3 * coil.core_top
    circles = [(0.0, 0.0, z, core) for z in (top, top - 1e3 * coil.core_length) if core > 0]
    for w in washers:
        x, y, z = _foot_mm(w)
        circles += [(x, y, h, 500 * d) for h in (z, z + 1e3 * w.ring.thickness) for d in w.ring[:2]]
    for edge in shape.edges:
        ends = [v.p for v in edge.vertices]  # edge.start crashes on the poles of the sphere
        for x, y, z, radius in circles:
            on_circle = all(abs(p.z - z) + abs(np.hypot(p.x - x, p.y - y) - radius) < 1e-6 * radius for p in ends)
            low, high = edge.bounding_box
            if on_circle and high.y - low.y > radius / 2:  # a cut's diameter ends on the circle too, but is flat in y
                edge.hpref = 1


@dataclass(frozen=True)
class Pull:
    """One question to the ladder: a coil at `current_a` pulls a washer `offset_m` off its axis over `gap_m`.

    A steel of None is linear, with the part's permeability.
    """

    coil: CoilSource
    washer: SteelRing
    gap_m: float
    offset_m: float = 0.0
    current_a: float = 1.0
    core_steel: BHCurve | None = None
    washer_steel: BHCurve | None = None


def solid_pull(pull: Pull, order: int = 3, levels: int = 1) -> SolidForce:
    """Solve the field in space; return the whole wrench.

    Raises
    ------
    SolverError
        As `field_solid.solid_force`.
    """
    washer = PlacedWasher(pull.washer, pull.gap_m, pull.offset_m, 0.0, pull.washer_steel)
    return solid_force(pull.coil, [washer], pull.current_a, pull.core_steel, order, levels)
