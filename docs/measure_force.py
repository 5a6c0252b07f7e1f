"""Prints the tables of the force ladder for docs/accuracy.md; `python docs/measure_force.py [team]`.

Without `team` about two minutes of one core, TEAM problem 20 two more. Needs padgen[study].
"""

import json
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import netgen.occ as occ
import ngsolve as ng
import numpy as np

from padgen.core.units import MM
from padgen.ladders.stages.force import axisymmetric_pull, circuit_pull, paper_pull, three_d_pull
from padgen.physics.leakage import leakage
from padgen.physics.magnetics import SteelRing, force_constant, solenoid
from padgen.physics.pull_wrench import pull_wrench
from padgen.physics.saturation import MILD_STEEL, TEAM_STEEL
from padgen.planner import make_plan
from padgen.planner.channels import magnetic_parts
from padgen.spec import load_spec
from padgen.verify.field_axisymmetric import axisymmetric_force
from padgen.verify.field_scalar import body_wrench, solve_scalar
from padgen.verify.force_ladder import Pull, shielding, solid_pull

REFERENCE = Path(__file__).parents[1] / "tests" / "reference" / "magnetostatics.json"
COIL = solenoid(10 * MM, 4 * MM, 10 * MM, 1000, 4 * MM, 1000)
WASHER = SteelRing(4 * MM, 2 * MM, 0.5 * MM, 1000)
TEMPLATES = ("paper-16", "paper-32", "wide-11", "triple-48", "quad-64", "resin-fine")
INNER, OUTER, STRAIGHT, LOW, HIGH, FAR = 19.5, 37.5, 14.5, 26.7, 123.3, 600.0
"""TEAM 20's winding in mm: half widths, their straight part, heights; radius of the far sphere."""
TEAM_20 = {0.98: 8.00, 3.01: 53.8, 4.52: 74.7, 5.02: 79.7}


def row(*cells: object) -> None:
    print("| " + " | ".join(f"{c:.4g}" if isinstance(c, float) else str(c) for c in cells) + " |", flush=True)


def head(title: str, *cells: str) -> None:
    print(f"\n## {title}\n")
    row(*cells)
    row(*("---" for _ in cells))


def rungs() -> None:
    head("Rungs", "offset mm", "rung", "N/A²", "unknowns", "residual", "CPU s")
    for offset in (0.0, 3 * MM):
        models = {"paper": paper_pull, "circuit": circuit_pull}
        models |= {} if offset else {"axisymmetric": partial(axisymmetric_pull, order=5, levels=4)}
        models["solid"] = partial(three_d_pull, order=3, levels=1)
        for name, model in models.items():
            start = time.process_time()
            found = model(Pull(COIL, WASHER, MM, offset))
            seconds = time.process_time() - start
            row(offset / MM, name, float(found.values[0]), found.unknowns, found.residual, seconds)


def coaxial() -> None:
    head("Coaxial force against the reference", "gap mm", "reference mN", "bracket's middle", "width", "CPU s")
    for gap, wanted in json.loads(REFERENCE.read_text())["force_mn_by_gap_mm"].items():
        solved = [axisymmetric_force(COIL, WASHER, float(gap) * MM, 0.05) for _ in range(3)]
        error = -solved[0].force_n / MM / wanted - 1
        row(gap, wanted, f"{error:+.2%}", f"{solved[0].error:.2%}", min(s.seconds for s in solved))


def saturation() -> None:
    head("Saturated mild steel, coaxial, 1 mm", "A", "N", "N/A²", "width", "CPU s")
    for current in (0.05, 0.2, 0.5, 1.0, 2.0, 5.0):
        start = time.process_time()
        solved = axisymmetric_force(COIL, WASHER, MM, current, MILD_STEEL, MILD_STEEL)
        row(current, -solved.force_n, -solved.force_n / current**2, solved.error, time.process_time() - start)


def templates() -> None:
    head(
        "Templates: circuit and wrench against the solid field", "template", "offset mm", "solid N/A²", "stated error",
        "circuit N/A²", "off by", "Fx/Fz", "estimate", "My/Fz mm", "estimate",
    )  # fmt: skip
    for name in TEMPLATES:
        spec = load_spec(name)
        coil, washer = magnetic_parts(spec)
        gap = spec.coil.gap_mm * MM
        for offset in sorted({round(c.site.coil_distance_mm, 6) for c in make_plan(spec).channels}):
            solved = solid_pull(Pull(coil, washer, gap, offset * MM))
            force = solved.wrench[0]
            circuit = float(force_constant(coil, washer, gap, np.array(offset * MM)))
            estimate = pull_wrench(coil, washer, gap, np.array([offset * MM]))[0]
            ratios = (force[0] / force[2], estimate[0], force[4] / force[2] / MM, estimate[4] / MM)
            row(name, offset, -force[2], solved.error, circuit, f"{-circuit / force[2] - 1:+.0%}", *map(float, ratios))


def consequences() -> None:
    head(
        "Pull-in and shift of the resonance, coaxial, gap 1 mm",
        "k N/m",
        "pull-in A rms",
        "at mm",
        "shift at half of i²",
    )
    # ln c as a polynomial of ln gap through field solutions; balance is at k z = c(1 mm − z) <i²>.
    gaps = MM * 0.3 ** ((1 + np.cos(np.pi * np.arange(5) / 4)) / 2)
    pulls = [float(axisymmetric_pull(Pull(COIL, WASHER, gap), 5, 4).values[0]) for gap in gaps]
    fit = np.polynomial.Polynomial.fit(np.log(gaps), np.log(pulls), 4)
    z = np.linspace(0, 0.7 * MM, 100_001)[1:-1]
    log_gap = np.log(MM - z)
    square_per_stiffness = z / np.exp(fit(log_gap))
    end = int(square_per_stiffness.argmax())
    half = int(np.searchsorted(square_per_stiffness[:end], square_per_stiffness[end] / 2))
    softening = -fit.deriv()(log_gap[half]) * z[half] / (MM - z[half])  # (dF/dz)/k
    for stiffness in (5.0, 20.0, 100.0):
        current = float(stiffness * square_per_stiffness[end]) ** 0.5
        row(stiffness, current, float(z[end] / MM), f"{np.sqrt(1 - softening) - 1:.1%}")
    near, far = (float(solid_pull(Pull(COIL, WASHER, MM, x * MM)).wrench[0, 2]) for x in (3, 9.5))
    estimate = leakage(COIL, WASHER, MM, np.array([(3 * MM, 0.0)]), np.array([(12.5 * MM, 0.0)])).mutual[0, 0, 0]
    print(f"\nLeakage of a neighbour 12.5 mm away: solid {far / near:.4f}, estimate {estimate:.4f}")
    print(f"Shielding by a second washer opposite: {shielding(Pull(COIL, WASHER, MM, 3 * MM)):.1%}")


def winding(half_width: float) -> Any:
    """The upright prism of the outline of TEAM 20's winding, in mm: rounded by 5 mm inside, wider outside."""
    box = occ.Box(occ.Pnt(-half_width, -half_width, LOW), occ.Pnt(half_width, half_width, HIGH))
    upright = [e for e in box.edges if abs(e.vertices[0].p.z - e.vertices[1].p.z) > 1]
    return box.MakeFillet(upright, half_width - STRAIGHT)


def team_mesh() -> Any:
    """A quarter of TEAM 20 (Takahashi, Nakata and Morishige 1994) in mm: a saturated yoke and the pole it pulls."""

    def block(x: float, y: float, low: float, high: float) -> Any:
        return occ.Box(occ.Pnt(0, 0, low), occ.Pnt(x, y, high))

    quarter = occ.Box(occ.Pnt(0, 0, -2 * FAR), occ.Pnt(2 * FAR, 2 * FAR, 2 * FAR))
    yoke = block(63.5, 12.5, 0, 150) - block(38.5, 12.5, 25, 125) - block(13.5, 12.5, 125, 150)
    pole, within = block(12.5, 5, 26.5, 125), winding(INNER) * quarter
    # The source jumps at the ends of the winding: the mesh has a face there, also through the pole.
    poles = [(pole * within).mat("pole"), (pole - within).mat("pole")]
    yoke.mat("yoke").maxh = 12
    for part in poles:
        part.maxh = 5
        part.faces[occ.Z < 30].maxh = 1.5
    wound = (winding(OUTER) * quarter - within).mat("winding")
    parts = [yoke, wound, (within - pole).mat("air"), *poles]
    air = occ.Sphere(occ.Pnt(0, 0, 75), FAR)
    air.faces.name = "far"
    air *= quarter
    for part in parts:
        air -= part
    shape = occ.OCCGeometry(occ.Glue([*parts, air.mat("air")]))
    mesh = ng.Mesh(shape.GenerateMesh(maxh=FAR / 3, grading=0.4, parallel_meshing=False, optsteps3d=3))
    mesh.Curve(2)
    return mesh


def team() -> None:
    """Pull on the pole at each current, 1000 turns, elements of order 2."""
    head("TEAM 20", "A", "measured N", "virtual work N", "at the surface N", "unknowns", "Newton steps")
    mesh = team_mesh()
    # T in A/m along z, full inside the winding, falling to 0 across it.
    x, y = (ng.IfPos(a - STRAIGHT, a - STRAIGHT, 0) for a in (ng.sqrt(c**2) for c in (ng.x, ng.y)))
    share = 1 - (ng.sqrt(x**2 + y**2) - (INNER - STRAIGHT)) / (OUTER - INNER)
    share = ng.IfPos(share, ng.IfPos(share - 1, 1, share), 0) * ng.IfPos((ng.z - LOW) * (HIGH - ng.z), 1, 0)
    for current, measured in TEAM_20.items():
        source = ng.CF((0, 0, 1e6 * current / (HIGH - LOW) * share))
        solved = solve_scalar(mesh, source, {"yoke": TEAM_STEEL, "pole": TEAM_STEEL}, FAR, 2, 4.0)
        wrench = body_wrench(solved, "pole", (0, 0, 0))
        pulls = (-float(wrench.virtual_work[2]), -float(wrench.surface[2]))
        row(current, measured, *pulls, solved.unknowns, solved.steps)


def main() -> None:
    if sys.argv[1:] == ["team"]:
        team()
        return
    for table in (rungs, coaxial, saturation, templates, consequences):
        table()


if __name__ == "__main__":
    main()
