"""Prints the tables of the force ladder for docs/accuracy.md; `measure_force.py [team | tables | campaign N]`.

Without a word about two minutes of one core, TEAM problem 20 (`team`) two more. `tables` writes padgen/physics/pulls.*,
the tables that plans read: after every change of the pull's physics (two minutes). `campaign 300` solves random pairs
by the solid field into tests/reference/force_campaign.csv, going on where it was (an hour). Needs padgen[study].
"""

import csv
import json
import sys
import time
from collections.abc import Iterator
from math import ceil
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from padgen.core.errors import SolverError
from padgen.core.units import MM
from padgen.physics.leakage import leakage
from padgen.physics.magnetics import CoilSource, SteelRing, solenoid
from padgen.physics.pull_table import BROUGHT, make_table, parts_key, solved_pulls
from padgen.physics.saturation import MILD_STEEL
from padgen.planner import make_plan
from padgen.planner.pulls import magnetic_parts
from padgen.spec import Coil, Washer, load_spec
from padgen.spec.fields import build
from padgen.spec.load import catalogue, template_paths
from padgen.verify.field_axisymmetric import axisymmetric_force
from padgen.verify.field_solid import PlacedWasher, solid_force
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
        "Templates: surface charges against the solid field", "template", "offset mm", "solid N/A²", "stated error",
        "charges N/A²", "off by", "stated", "Fx/Fz", "charges", "My/Fz mm", "charges",
    )  # fmt: skip
    for name in TEMPLATES:
        spec = load_spec(name)
        coil, washer = magnetic_parts(spec)
        gap = spec.coil.gap_mm * MM
        for offset in sorted({round(c.site.coil_distance_mm, 6) for c in make_plan(spec).channels}):
            solved = solid_pull(Pull(coil, washer, gap, offset * MM))
            force = solved.wrench[0]
            found = solved_pulls(coil, washer, np.array([gap]), np.array([offset * MM]))
            pull, side, moment = (float(v[0]) for v in (found.pull, found.side, found.moment))
            ratios = (force[0] / force[2], -side / pull, force[4] / force[2] / MM, -moment / pull / MM)
            off = f"{-pull / force[2] - 1:+.1%}"
            row(name, offset, -force[2], solved.error, pull, off, f"{found.error[0]:.1%}", *map(float, ratios))


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


LOW, HIGH, GAPS, STEP = 0.2 * MM, 6 * MM, 9, 0.33 * MM
"""Gaps of the tables that padgen brings, and how far their offsets are apart, about."""


def brought_parts() -> Iterator[tuple[CoilSource, SteelRing]]:
    """All coils and magnetic washers of the catalogues, and the templates' own."""
    for coil in catalogue("coil").values():
        for washer in catalogue("washer").values():
            if washer["relative_permeability"] >= 2:
                parts = build(Coil, {}, "coil", coil), build(Washer, {}, "washer", washer)
                yield magnetic_parts(SimpleNamespace(coil=parts[0], washer=parts[1]))
    for name in template_paths():
        yield magnetic_parts(load_spec(name))


def tables() -> None:
    places: dict[str, list[float]] = {}
    numbers: list[np.ndarray] = []
    for coil, washer in dict.fromkeys(brought_parts()):
        reach = 0.6 * coil.outer_diameter + washer.outer_diameter / 2
        table = make_table(coil, washer, LOW, HIGH, reach, GAPS, offsets := ceil(reach / STEP))
        places[parts_key(coil, washer)] = [sum(map(len, numbers)), LOW, HIGH, reach, GAPS, offsets]
        numbers.append(np.concatenate([table.scale, table.shape.ravel()]).astype(np.float32))
    np.save(BROUGHT.with_suffix(".npy"), np.concatenate(numbers))
    lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(place)}" for key, place in places.items())
    BROUGHT.with_suffix(".json").write_text("{\n" + lines + "\n}\n")


CAMPAIGN = REFERENCE.with_name("force_campaign.csv")
FIELDS = (
    "case", "coil_outer_mm", "coil_inner_mm", "coil_length_mm", "core_mm", "core_permeability", "washer_outer_mm",
    "washer_inner_mm", "washer_thickness_mm", "washer_permeability", "gap_mm", "offset_mm",
    "axial_n_per_a2", "side_n_per_a2", "moment_nm_per_a2", "reference_error",
)  # fmt: skip
SEED, TURNS = 20, 1000
GOOD = 0.025
"""Of a solution's own error; one that states more is solved again with higher elements."""


def drawn(case: int) -> list[float]:
    """A coil, a washer and its place, `FIELDS` from the second on: cores of 0 to 20 mm, washers M1 to M6."""
    uniform = np.random.default_rng([SEED, case]).uniform

    def logarithmic(low: float, high: float) -> float:
        return float(np.exp(uniform(np.log(low), np.log(high))))

    core = 0.0 if uniform() < 0.15 else uniform(1, 20)
    inner = (core + (uniform(0.5, 2) if uniform() < 0.5 else 0.0)) if core else uniform(1, 20)
    outer, length = inner + 2 * uniform(1.5, 8), uniform(4, 25)
    core_permeability, thread = logarithmic(20, 5000), uniform(1, 6)
    bore = 1.07 * thread
    rim, thickness = bore * uniform(1.65, 2.4), max(0.2, thread * uniform(0.1, 0.28))
    permeability, gap = logarithmic(20, 2000), logarithmic(0.2, 5)
    offset = 0.0 if uniform() < 0.1 else uniform(0, min(15, outer / 2 + rim / 2))
    numbers = outer, inner, length, core, core_permeability, rim, bore, thickness, permeability, gap, offset
    return [round(value, 4) for value in numbers]


def field_solution(case: int) -> list[float]:
    """The last four of `FIELDS`; nan where the field has no answer."""
    outer, inner, length, core, core_permeability, rim, bore, thickness, permeability, gap, offset = drawn(case)
    coil = solenoid(outer * MM, inner * MM, length * MM, TURNS, core * MM, core_permeability)
    washer = SteelRing(rim * MM, bore * MM, thickness * MM, permeability)
    best = [np.nan] * 4
    if not offset:
        found = axisymmetric_force(coil, washer, gap * MM, order=5, levels=5)
        return [found.force_n, 0.0, 0.0, found.error]
    for order in (3, 4):
        try:
            solved = solid_force(coil, [PlacedWasher(washer, gap * MM, offset * MM)], order=order)
        except SolverError:
            continue
        if not solved.error > best[3]:
            best = [*map(float, solved.wrench[0, [2, 0, 4]]), solved.error]
        if solved.error <= GOOD:
            break
    return best


def campaign(count: int) -> None:
    lines = CAMPAIGN.read_text().splitlines() if CAMPAIGN.exists() else []
    known = {int(line.split(",")[0]) for line in lines if line[:1].isdigit()}
    with CAMPAIGN.open("a", newline="") as out:
        if not lines:
            out.write(
                "# Made by docs/measure_force.py campaign, from field_solid and field_axisymmetric of padgen/verify\n"
            )
            csv.writer(out).writerow(FIELDS)
        for case in sorted(set(range(count)) - known):
            csv.writer(out).writerow([case, *drawn(case), *(f"{value:.7g}" for value in field_solution(case))])
            out.flush()


def main() -> None:
    if sys.argv[1:] in (["team"], ["tables"]):
        {"team": team, "tables": tables}[sys.argv[1]]()
        return
    if sys.argv[1:2] == ["campaign"]:
        campaign(int(sys.argv[2]))
        return
    for table in (rungs, coaxial, saturation, templates, consequences):
        table()


if __name__ == "__main__":
    main()
