"""Print the tables of docs/accuracy.md on 3-D elasticity: error, estimate and cost, and against CalculiX.

Run ``python docs/measure_elasticity.py`` on one core with OPENBLAS_NUM_THREADS=1; seconds are processor time
from the STEP file to six modes, imports excluded, the least of three runs.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.verify.elasticity import (
    PRINTED,
    SETTINGS,
    WASHER,
    SolidModes,
    SolidTaxel,
    clamped_shape,
    coarse_mesh,
    converged_modes,
    solve_modes,
    taxel_shape,
)
from tests.verify.test_elasticity import POLYMER, REFERENCE, RING_MM3, STEEL, off_reference, write_steps

RUNS = 3
GRADED = (0.05, 1e3)
UNIFORM = (None, 0.25)
"""Element sizes along singular edges, and everywhere, in mm."""


def taxel(folder: Path, name: str) -> SolidTaxel:
    return SolidTaxel(folder / f"{name}.step", POLYMER, STEEL, RING_MM3, 3.25, clamp="root")


def quickest(solve: Any, *arguments: Any) -> tuple[float, SolidModes]:
    seconds = []
    for _ in range(RUNS):
        start = time.process_time()
        found = solve(*arguments)
        seconds.append(time.process_time() - start)
    return min(seconds), found


def ladder(folder: Path) -> list[str]:
    import netgen.occ  # noqa: F401
    import ngsolve  # noqa: F401

    rows = [
        "| taxel | order, levels | unknowns | error of f1 % | of the worst of six % | s |",
        "|---|---|---|---|---|---|",
    ]
    for name in REFERENCE["cases"]:
        for order, levels in ((2, 0), (2, 2), (3, 1), (3, 2), (4, 2), (4, 3)):
            seconds, found = quickest(solve_modes, taxel(folder, name), order, levels)
            off = 100 * off_reference(found, name)
            worst = np.abs(off).max()
            rows.append(
                f"| {name} | {order}, {levels} | {found.unknowns:,} | {off[0]:.4f} | {worst:.2f} | {seconds:.2f} |"
            )
    return rows


def estimates(folder: Path) -> list[str]:
    rows = ["| taxel | asked | order, levels | error of f1 % | estimate % | s |", "|---|---|---|---|---|---|"]
    for name in REFERENCE["cases"]:
        for tolerance in (1e-2, 3e-3, 3e-4):
            seconds, found = quickest(converged_modes, taxel(folder, name), tolerance)
            off = 100 * off_reference(found, name)[0]
            estimate = 100 * found.error[0]
            asked = f"{name} | {tolerance:g} | {found.order}, {SETTINGS[found.setting].levels}"
            rows.append(f"| {asked} | {off:.4f} | {estimate:.4f} | {seconds:.2f} |")
    return rows


def calculix_deck(folder: Path, along_mm: float | None, largest_mm: float) -> int:
    """Write base.inp with quadratic tetrahedra by Netgen; return the number of unknowns."""
    from netgen.occ import OCCGeometry

    shape = clamped_shape(taxel_shape(folder / "base.step", RING_MM3), "root")
    coarse_mesh(shape)
    for face in shape.faces:
        face.maxh = largest_mm
    if along_mm:
        for name in layered_edges(folder):
            shape.edges[name].maxh = along_mm
    mesh = OCCGeometry(shape).GenerateMesh(maxh=largest_mm, grading=0.5, parallel_meshing=False)
    mesh.SecondOrder()
    points = mesh.Coordinates() * 1e-3
    lines = ["*NODE"] + [f"{k + 1},{x:.12e},{y:.12e},{z:.12e}" for k, (x, y, z) in enumerate(points)]
    groups: dict[str, list[str]] = {PRINTED: [], WASHER: []}
    for number, element in enumerate(mesh.Elements3D(), 1):
        p = [vertex.nr for vertex in element.points]
        corner = points[np.array(p[:4]) - 1]
        abaqus = [p[k] for k in (0, 1, 2, 3, 4, 7, 5, 6, 8, 9)]
        if np.linalg.det(corner[1:] - corner[0]) < 0:
            abaqus = [p[k] for k in (1, 0, 2, 3, 4, 5, 7, 8, 6, 9)]
        groups[mesh.GetMaterial(element.index)].append(",".join(map(str, (number, *abaqus))))
    for part, material in ((PRINTED, POLYMER), (WASHER, STEEL)):
        lines += [f"*ELEMENT,TYPE=C3D10,ELSET={part}", *groups[part], f"*MATERIAL,NAME={part}"]
        lines += ["*ELASTIC", f"{material.modulus_pa},{material.poisson}", "*DENSITY", f"{material.density_kg_per_m3}"]
        lines += [f"*SOLID SECTION,ELSET={part},MATERIAL={part}"]
    held = np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-9) + 1
    lines += ["*BOUNDARY", *(f"{node},1,3" for node in held), "*STEP", "*FREQUENCY", "6", "*END STEP", ""]
    (folder / "base.inp").write_text("\n".join(lines))
    return 3 * (len(points) - len(held))


def layered_edges(folder: Path) -> list[int]:
    """Places of the edges that the solver would give layers."""
    from padgen.verify.elasticity import _drafted

    return [int(name.removeprefix("edge")) for name in _drafted(taxel(folder, "base")).layered]


def calculix(folder: Path) -> list[str]:
    ccx = shutil.which("ccx")
    if ccx is None:
        return ["CalculiX (ccx) is not installed: no comparison."]
    rows = ["| base by | unknowns | error of f1 % | s |", "|---|---|---|---|"]
    for name, sizes in (("CalculiX, edges 0.05", GRADED), ("CalculiX, uniform 0.25", UNIFORM)):
        started = time.process_time()
        unknowns = calculix_deck(folder, *sizes)
        meshed = time.process_time() - started
        seconds = min(calculix_seconds(ccx, folder) for _ in range(RUNS)) + meshed
        lines = (folder / "base.dat").read_text().splitlines()
        first = next(line for line in lines if line.split()[:1] == ["1"])
        off = 100 * (float(first.split()[3]) / REFERENCE["cases"]["base"]["modes_hz"][0] - 1)
        rows.append(f"| {name} | {unknowns:,} | {off:.3f} | {seconds:.2f} |")
    for order, levels in ((2, 2), (3, 1), (3, 2)):
        seconds, found = quickest(solve_modes, taxel(folder, "base"), order, levels)
        off = 100 * off_reference(found, "base")[0]
        rows.append(f"| order {order}, {levels} levels | {found.unknowns:,} | {off:.3f} | {seconds:.2f} |")
    return rows


def calculix_seconds(ccx: str, folder: Path) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [ccx, "base"], cwd=folder, check=True, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with ProcessPoolExecutor(1, get_context("spawn")) as maker:
            maker.submit(write_steps, folder).result()
        with ProcessPoolExecutor(1, get_context("spawn")) as solver:
            for table in (ladder, estimates, calculix):
                print("\n".join(solver.submit(table, folder).result()), "\n", flush=True)


if __name__ == "__main__":
    main()
