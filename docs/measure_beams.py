"""Print the tables of docs/accuracy.md on the beam model; `--solve` solves taxels of its set anew.

python docs/measure_beams.py                    errors and estimates against the stored solutions
python docs/measure_beams.py --solve NAME …     the STEP of those taxels, by padgen.verify.elasticity
"""

import argparse
import json
import multiprocessing
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from padgen.core.errors import SolverError
from padgen.core.units import G_PER_CM3, GPA
from padgen.planner.plan import Cell, Plate, Site
from padgen.planner.suspensions import BeamShape, suspension
from padgen.planner.taxel_model import fillet_mm, plate_shape, post_diameter_mm, recess_mm

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.physics.test_beam_model import errors_and_estimates, row_spec

SET = Path(__file__).parents[1] / "tests" / "reference" / "beam_calibration.json"
STEEL_PA = 200e9
STEEL_POISSON = 0.3
BINS = ((1, 2), (2, 4), (4, 8), (8, 16), (16, 100))


def beam_of(row: dict[str, Any]) -> BeamShape:
    return BeamShape(row["width_mm"], row["thickness_mm"], row["length_mm"])


def line(name: str, pairs: list[tuple[float, float]]) -> str:
    error, estimate = np.abs(np.array(pairs)).T
    ratio = error / estimate
    own, said = (float(np.sqrt(np.mean(values**2))) for values in (error, estimate))
    return (
        f"| {name} | {len(error)} | {np.median(error):.2%} | {own:.2%} | {error.max():.1%} | {said:.2%}"
        f" | {np.median(ratio):.2f} | {np.quantile(ratio, 0.95):.2f} | {ratio.max():.2f} |"
    )


def tables(rows: list[dict[str, Any]]) -> list[str]:
    inside = [(row, errors_and_estimates(row)) for row in rows if row["in_range"]]
    text = [
        "| taxels, mode | n | median | rms | largest | rms estimate | error/estimate median | 95 % | largest |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    groups = {
        "templates": [pairs for row, pairs in inside if "spec" not in row],
        "fitted": [pairs for row, pairs in inside if not row["held_out"]],
        "held out": [pairs for row, pairs in inside if row["held_out"]],
    }
    for name, group in groups.items():
        for kind in ("working", "along", "across"):
            text.append(line(f"{name}, {kind}", [pair for pairs in group for pair in pairs.get(kind, [])]))
    for topology in dict.fromkeys(row["topology"] for row, _ in inside):
        mine = [pair for row, pairs in inside if row["topology"] == topology for pair in pairs["working"]]
        text.append(line(f"{topology}, working", mine))
    for low, high in BINS:
        mine = [
            pair
            for row, pairs in inside
            if low <= row["length_mm"] / row["thickness_mm"] < high
            for pair in pairs["working"]
        ]
        text.append(line(f"l/t {low} … {high}, working", mine))
    return text


def write_step(row: dict[str, Any], path: Path) -> float:
    """Write the STEP file of a taxel of the set, with half a rib around its window; return its washer's mm³."""
    from padgen.solid.kernel import build123d
    from padgen.solid.taxel import taxel_solid, washer_solid

    spec = row_spec(row)
    b = build123d()
    shape = plate_shape(spec)
    arrangement = suspension(row["topology"]).arrange(shape, beam_of(row), spec.printer.smallest_gap_mm)
    top_mm = spec.pad.frame_thickness_mm + spec.taxel.boss_protrusion_mm
    round_parts = (post_diameter_mm(spec), spec.taxel.boss_diameter_mm, top_mm, spec.taxel.boss_edge_mm)
    length, width = (float(v) for v in arrangement.window_mm)
    rib = spec.pad.rib_mm
    channel: Any = SimpleNamespace(
        index=0,
        beam=SimpleNamespace(fillet_mm=float(fillet_mm(spec, arrangement))),
        site=Site((length / 2, 0.0), (0.0, 0.0), (0.0, 0.0), "+x", 0.0),
    )
    plan: Any = SimpleNamespace(
        plate=Plate(*shape, *recess_mm(spec), *round_parts, spec.printer.smallest_gap_mm),
        spec=spec,
        arrangement=lambda _: arrangement,
        cell=Cell(1, 1, length + rib, width + rib, "x"),
    )
    printed = taxel_solid(plan, channel)
    washer = washer_solid(plan, channel)
    printed.label = "printed"
    washer.label = "washer"
    b.export_step(b.Compound(label=row["name"], children=[printed, washer]), path)
    return float(washer.volume)


def solve(row: dict[str, Any], path: Path, washer_mm3: float) -> tuple[float, list[float]]:
    """Return the working resonance and all modes in Hz by finite elements, in a process without build123d."""
    from padgen.verify.elasticity import Elastic, SolidTaxel, solve_modes

    spec = row_spec(row)
    material = spec.material
    washer = spec.washer
    printed = Elastic(material.youngs_modulus_gpa * GPA, material.poisson_ratio, material.density_g_per_cm3 * G_PER_CM3)
    steel = Elastic(STEEL_PA, STEEL_POISSON, washer.density_g_per_cm3 * G_PER_CM3)
    arrangement = suspension(row["topology"]).arrange(plate_shape(spec), beam_of(row), spec.printer.smallest_gap_mm)
    found = solve_modes(SolidTaxel(path, printed, steel, washer_mm3, float(arrangement.washer_x_mm))).modes
    return float(found.frequency_hz[found.working]), [float(f) for f in found.frequency_hz]


def solved_anew(rows: list[dict[str, Any]]) -> list[str]:
    """Return a table of each taxel's stored working resonance, a new solution, and the new modes."""
    text = ["| taxel | stored Hz | solved Hz | change | modes Hz |", "|---|---|---|---|---|"]
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        for row in rows:
            path = Path(folder) / f"{row['name']}.step"
            # The CAD kernel and the elements do not live together in one process.
            with spawn.Pool(1) as pool:
                washer_mm3 = pool.apply(write_step, (row, path))
            with spawn.Pool(1) as pool:
                try:
                    hz, modes = pool.apply(solve, (row, path, washer_mm3))
                except SolverError as error:
                    text.append(f"| {row['name']} | {row['working_hz']} | {error.message} | | |")
                    continue
            listed = ", ".join(f"{f:.5g}" for f in modes[:5])
            change = hz / row["working_hz"] - 1
            text.append(f"| {row['name']} | {row['working_hz']} | {hz:.3f} | {change:+.2%} | {listed} |")
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--solve", nargs="+", metavar="NAME", default=[])
    names = parser.parse_args().solve
    rows = json.loads(SET.read_text())["taxels"]
    print("\n".join(solved_anew([row for row in rows if row["name"] in names]) if names else tables(rows)))


if __name__ == "__main__":
    main()
