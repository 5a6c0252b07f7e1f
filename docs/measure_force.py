"""Print the tables of the force ladder for docs/accuracy.md; `measure_force.py [team | tables | bounds | campaign N]`.

Without a word about two minutes of one core, TEAM problem 20 (`team`) two more. `tables` writes padgen/physics/pulls.*,
the tables that plans read: after every change of the pull's physics (half an hour of two cores). `campaign 300` solves
random pairs by the solid field into tests/reference/force_campaign.csv, going on where it was (two hours). `bounds`
tries the bounds of gap and softening on 1,960 combinations of core, gap, offset and sag (six minutes). Needs
padgen[study].
"""

import csv
import json
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import islice
from math import ceil
from pathlib import Path
from typing import Any

import netgen.occ as occ
import ngsolve as ng
import numpy as np
from rich.console import Console
from rich.progress import track

sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.core.errors import SolverError
from padgen.core.units import MM
from padgen.ladders.stages import axisymmetric_pull, charges_pull, paper_pull, three_d_pull
from padgen.physics.magnetics import MILD_STEEL, TEAM_STEEL, CoilSource, SteelRing, solenoid
from padgen.physics.pull import BROUGHT, PullTable, leakage, make_table, parts_key, solved_pulls
from padgen.planner import make_plan
from padgen.planner.coils import coil_source
from padgen.planner.movers.washer import magnetic_parts, steel_ring
from padgen.spec import Coil, Washer, load_spec
from padgen.spec.fields import build
from padgen.spec.load import catalogue, template_paths
from padgen.verify.field_solid import (
    PlacedWasher,
    PullQuestion,
    axisymmetric_force,
    body_wrench,
    solid_force,
    solid_pull,
    solve_scalar,
)
from tests.finer_models import many_coils, shielding

REFERENCE = Path(__file__).parents[1] / "tests" / "reference" / "magnetostatics.json"
COIL = solenoid(10 * MM, 4 * MM, 10 * MM, 1000, 4 * MM, 1000)
WASHER = SteelRing(4 * MM, 2 * MM, 0.5 * MM, 1000)
TEMPLATES = ("paper-16", "paper-32", "wide-11", "triple-48", "quad-64", "resin-fine")
INNER = 19.5
OUTER = 37.5
STRAIGHT = 14.5
LOW = 26.7
HIGH = 123.3
FAR = 600.0
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
        models = {"paper": paper_pull, "circuit": charges_pull}
        models |= {} if offset else {"axisymmetric": partial(axisymmetric_pull, order=5, levels=4)}
        models["solid"] = partial(three_d_pull, order=3, levels=1)
        for name, model in models.items():
            start = time.process_time()
            found = model(PullQuestion(COIL, WASHER, MM, offset))
            seconds = time.process_time() - start
            row(offset / MM, name, float(found.values[0]), found.unknowns, found.residual, seconds)


def coaxial() -> None:
    head("Coaxial force against the reference", "gap mm", "reference mN", "bracket's middle", "width", "CPU s")
    for gap, wanted in json.loads(REFERENCE.read_text())["force_mn_by_gap_mm"].items():
        start = time.process_time()
        solved = axisymmetric_force(COIL, WASHER, float(gap) * MM, 0.05)
        seconds = time.process_time() - start
        error = -solved.force_n / MM / wanted - 1
        row(gap, wanted, f"{error:+.2%}", f"{solved.error:.2%}", seconds)


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
            solved = solid_pull(PullQuestion(coil, washer, gap, offset * MM))
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
    # ln c as a polynomial of ln gap through field solutions; balance is at k z = c(1 mm − z) <i²>.
    gaps = MM * 0.3 ** ((1 + np.cos(np.pi * np.arange(5) / 4)) / 2)
    pulls = [float(axisymmetric_pull(PullQuestion(COIL, WASHER, gap), 5, 4).values[0]) for gap in gaps]
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
    place = np.array([3 * MM, 0.0])
    pitch = np.array([[12.5 * MM, 0.0]])
    estimate = leakage(COIL, WASHER, MM, place[None], pitch).mutual[0, 0, 0]
    found = many_coils(COIL, WASHER, MM, place, np.concatenate([np.zeros((1, 2)), pitch]))
    near, far = (float(solid_pull(PullQuestion(COIL, WASHER, MM, x * MM)).wrench[0, 2]) for x in (3, 9.5))
    print(f"\nLeakage of a neighbour 12.5 mm away: estimate {estimate:.4f}, all cores {found[1, 1] / found[0, 0]:.4f},")
    print(f"without the own core, solid: {far / near:.4f}")
    print(f"Shielding by a second washer opposite: {shielding(PullQuestion(COIL, WASHER, MM, 3 * MM)):.1%}")


def winding(half_width: float) -> Any:
    """Return the upright prism of the outline of TEAM 20's winding in mm, rounded by 5 mm inside and wider outside."""
    box = occ.Box(occ.Pnt(-half_width, -half_width, LOW), occ.Pnt(half_width, half_width, HIGH))
    upright = [e for e in box.edges if abs(e.vertices[0].p.z - e.vertices[1].p.z) > 1]
    return box.MakeFillet(upright, half_width - STRAIGHT)


def team_mesh() -> Any:
    """Mesh a quarter of TEAM 20 (Takahashi, Nakata, Morishige 1994) in mm: a saturated yoke and the pole it pulls."""

    def block(x: float, y: float, low: float, high: float) -> Any:
        return occ.Box(occ.Pnt(0, 0, low), occ.Pnt(x, y, high))

    quarter = occ.Box(occ.Pnt(0, 0, -2 * FAR), occ.Pnt(2 * FAR, 2 * FAR, 2 * FAR))
    yoke = block(63.5, 12.5, 0, 150) - block(38.5, 12.5, 25, 125) - block(13.5, 12.5, 125, 150)
    pole = block(12.5, 5, 26.5, 125)
    within = winding(INNER) * quarter
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
    """Print the pull on the pole at each current, with 1000 turns and elements of order 2."""
    head("TEAM 20", "A", "measured N", "virtual work N", "at the surface N", "unknowns")
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
        row(current, measured, *pulls, solved.unknowns)


RANGES = 3
"""Ranges of gaps that padgen brings, from `pull.LOW` on: up to 9.45 mm."""
STEPS_MM = (0.07, 0.17, 0.34)
MORE = 1.25
MOST_OFFSETS = 600
SMOOTH = 3e-7
"""Distance of offsets that is tried first in each range, the factor to more of them, the most, and the share of the
last coefficients that is small enough."""


def brought_parts() -> Iterator[tuple[CoilSource, SteelRing]]:
    """Yield all coils and magnetic washers of the catalogues, and the templates' own."""
    for coil in catalogue("coil").values():
        for washer in catalogue("washer").values():
            if washer["relative_permeability"] >= 2:
                yield coil_source(build(Coil, {}, "coil", coil)), steel_ring(build(Washer, {}, "washer", washer))
    for name in template_paths():
        spec = load_spec(name)
        if spec.mover.kind == "washer":
            yield magnetic_parts(spec)


def supplied_table(parts: tuple[CoilSource, SteelRing], part: int) -> PullTable:
    """Return the table with so many offsets that its last coefficients are small, or with the most."""
    coil, washer = parts
    reach = 0.6 * coil.outer_diameter + washer.outer_diameter / 2
    offsets = ceil(reach / (STEPS_MM[part] * MM))
    while True:
        table = make_table(coil, washer, part, reach, offsets)
        tail = np.abs(table.shape[:, -max(2, offsets // 16) :, 0]).max() / np.abs(table.shape[:, :, 0]).max()
        print(parts_key(coil, washer), part, offsets, f"{tail:.1e}", flush=True)
        if tail < SMOOTH or offsets >= MOST_OFFSETS:
            return table
        offsets = ceil(MORE * offsets)


def tables() -> None:
    places: dict[str, dict[str, Any]] = {}
    numbers: list[np.ndarray] = []
    parts = list(dict.fromkeys(brought_parts()))
    asked = [(pair, part) for pair in parts for part in range(RANGES)]
    with ProcessPoolExecutor() as pool:
        solved = pool.map(supplied_table, *zip(*asked, strict=True))
        hidden = not sys.stderr.isatty()
        shown = track(solved, "solving tables of pulls", len(asked), console=Console(stderr=True), disable=hidden)
        made = iter(list(shown))
    for pair in parts:
        ranges = []
        for table in islice(made, RANGES):
            ranges.append([sum(map(len, numbers)), table.shape.shape[1]])
            numbers.append(np.concatenate([table.scale, table.shape.ravel()]).astype(np.float32))
        places[parts_key(*pair)] = {"turns": pair[0].turns, "reach_m": table.reach, "ranges": ranges}
    np.save(BROUGHT.with_suffix(".npy"), np.concatenate(numbers))
    lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(place)}" for key, place in places.items())
    BROUGHT.with_suffix(".json").write_text("{\n" + lines + "\n}\n")


CAMPAIGN = REFERENCE.with_name("force_campaign.csv")
FIELDS = (
    "case", "coil_outer_mm", "coil_inner_mm", "coil_length_mm", "core_mm", "core_permeability", "washer_outer_mm",
    "washer_inner_mm", "washer_thickness_mm", "washer_permeability", "gap_mm", "offset_mm",
    "axial_n_per_a2", "side_n_per_a2", "moment_nm_per_a2", "reference_error",
)  # fmt: skip
SEED = 20
TURNS = 1000
GOOD = 0.01
"""Largest accepted error of a solution over its axial force; above it the next elements are tried."""
ELEMENTS = ((3, 1, 1.0), (4, 1, 1.0), (4, 1, 1 / 3))
"""Order, levels of refinement at edges, and relative size in the washer, of the elements tried in turn."""


def drawn(case: int) -> list[float]:
    """Draw a coil, a washer and its place (`FIELDS` from the second on): cores of 0 to 20 mm, washers M1 to M6."""
    uniform = np.random.default_rng([SEED, case]).uniform

    def logarithmic(low: float, high: float) -> float:
        return float(np.exp(uniform(np.log(low), np.log(high))))

    core = 0.0 if uniform() < 0.15 else uniform(1, 20)
    inner = (core + (uniform(0.5, 2) if uniform() < 0.5 else 0.0)) if core else uniform(1, 20)
    outer = inner + 2 * uniform(1.5, 8)
    length = uniform(4, 25)
    core_permeability = logarithmic(20, 5000)
    thread = uniform(1, 6)
    bore = 1.07 * thread
    rim = bore * uniform(1.65, 2.4)
    thickness = max(0.2, thread * uniform(0.1, 0.28))
    permeability = logarithmic(20, 2000)
    gap = logarithmic(0.2, 5)
    offset = 0.0 if uniform() < 0.1 else uniform(0, min(15, outer / 2 + rim / 2))
    numbers = outer, inner, length, core, core_permeability, rim, bore, thickness, permeability, gap, offset
    return [round(value, 4) for value in numbers]


def field_solution(case: int) -> list[float]:
    """Return the last four of `FIELDS`, nan where the field has no solution."""
    outer, inner, length, core, core_permeability, rim, bore, thickness, permeability, gap, offset = drawn(case)
    coil = solenoid(outer * MM, inner * MM, length * MM, TURNS, core * MM, core_permeability)
    washer = SteelRing(rim * MM, bore * MM, thickness * MM, permeability)
    best = [np.nan] * 4
    if not offset:
        found = axisymmetric_force(coil, washer, gap * MM, order=5, levels=5)
        return [found.force_n, 0.0, 0.0, found.error]
    for order, levels, size in ELEMENTS:
        try:
            solved = solid_force(coil, [PlacedWasher(washer, gap * MM, offset * MM)], 1.0, None, order, levels, size)
        except SolverError:
            continue
        axial, side, moment = map(float, solved.wrench[0, [2, 0, 4]])
        error = solved.error * float(np.hypot(axial, side)) / abs(axial)
        if not error > best[3]:
            best = [axial, side, moment, error]
        if error <= GOOD:
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


def bounds() -> None:
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from tests.planner.test_pulled_bounds import pulled_bounds

    bounded, broken = pulled_bounds()
    head(
        "Bounds of gap and softening that the pull itself breaks",
        "term",
        "core mm",
        "gap mm",
        "offset mm",
        "sag",
        "bound",
        "true",
    )
    for cells in broken:
        row(*cells)
    print(f"\n{len(broken)} broken of those of {bounded} combinations")


def main() -> None:
    if sys.argv[1:] in (["team"], ["tables"], ["bounds"]):
        {"team": team, "tables": tables, "bounds": bounds}[sys.argv[1]]()
        return
    if sys.argv[1:2] == ["campaign"]:
        campaign(int(sys.argv[2]))
        return
    for table in (rungs, coaxial, saturation, templates, consequences):
        table()


if __name__ == "__main__":
    main()
