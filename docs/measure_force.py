"""Prints the tables of the force ladder for docs/accuracy.md; `python docs/measure_force.py [team]`.

Without `team` about two minutes of one core, TEAM problem 20 two more. Needs padgen[study].
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

from padgen.core.units import MM
from padgen.physics.leakage import leakage
from padgen.physics.magnetics import SteelRing, force_constant, solenoid
from padgen.physics.pull_wrench import pull_wrench
from padgen.physics.saturation import MILD_STEEL
from padgen.planner import make_plan
from padgen.planner.channels import magnetic_parts
from padgen.spec import load_spec
from padgen.verify.field_axisymmetric import axisymmetric_force
from padgen.verify.field_team import team_20_force
from padgen.verify.force_ladder import (
    Pull,
    balance,
    force_ladder,
    neighbour_pull,
    pull_curve,
    pull_in,
    shielding,
    solid_pull,
)

REFERENCE = Path(__file__).parents[1] / "tests" / "reference" / "magnetostatics.json"
COIL = solenoid(10 * MM, 4 * MM, 10 * MM, 1000, 4 * MM, 1000)
WASHER = SteelRing(4 * MM, 2 * MM, 0.5 * MM, 1000)
TEMPLATES = ("paper-16", "paper-32", "wide-11", "triple-48", "quad-64", "resin-fine")
TEAM_20 = {0.98: 8.00, 3.01: 53.8, 4.52: 74.7, 5.02: 79.7}


def row(*cells: object) -> None:
    print("| " + " | ".join(f"{c:.4g}" if isinstance(c, float) else str(c) for c in cells) + " |", flush=True)


def head(title: str, *cells: str) -> None:
    print(f"\n## {title}\n")
    row(*cells)
    row(*("---" for _ in cells))


def rungs() -> None:
    head("Rungs", "offset mm", "rung", "N/A²", "stated error", "unknowns", "residual", "CPU s")
    for offset in (0.0, 3 * MM):
        for rung in force_ladder(Pull(COIL, WASHER, MM, offset)):
            row(offset / MM, *(rung[:1] if rung.refusal else rung[:6]), rung.refusal)


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
    curve = pull_curve("axisymmetric", Pull(COIL, WASHER, MM), 0.3 * MM, MM)
    for stiffness in (5.0, 20.0, 100.0):
        limit = pull_in(curve, stiffness, MM)
        rest = balance(curve, stiffness, MM, limit.mean_square_a2 / 2)
        row(stiffness, limit.mean_square_a2**0.5, limit.deflection_m / MM, f"{rest.resonance_shift:.1%}")
    pull, place, neighbour = Pull(COIL, WASHER, MM, 3 * MM), (3 * MM, 0.0), (12.5 * MM, 0.0)
    estimate = leakage(COIL, WASHER, MM, np.array([place]), np.array([neighbour])).mutual[0, 0, 0]
    solid = neighbour_pull(pull, place, neighbour)
    print(f"\nLeakage of a neighbour 12.5 mm away: solid {solid:.4f}, estimate {estimate:.4f}")
    print(f"Shielding by a second washer opposite: {shielding(pull):.1%}")


def team() -> None:
    head("TEAM 20", "A", "measured N", "virtual work N", "at the surface N", "unknowns", "Newton steps")
    for current, (pull, wrench, solved) in zip(TEAM_20, team_20_force(list(TEAM_20)), strict=True):
        row(current, TEAM_20[current], pull, -float(wrench.surface[2]), solved.unknowns, solved.steps)


def main() -> None:
    if sys.argv[1:] == ["team"]:
        team()
        return
    for table in (rungs, coaxial, saturation, templates, consequences):
        table()


if __name__ == "__main__":
    main()
