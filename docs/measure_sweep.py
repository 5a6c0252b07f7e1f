"""Measures what docs/performance.md says of sweeps, and prints it as markdown: `python docs/measure_sweep.py [part …]`.

Parts: plans, builds, layouts, growth, openscad (needs ``openscad`` on the path, and half an hour); all without any.
The growth is drawn to docs/growth.svg.
"""

import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from math import acos, ceil, pi
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from padgen.cache import VARIABLE
from padgen.planner import Plan, make_plan
from padgen.planner.plan import Channel
from padgen.planner.tile import TURNS
from padgen.solid.checks import _narrowest_of_cell, check_pad
from padgen.solid.pad import build_pad
from padgen.solid.topology import _kept_pairs
from padgen.spec import find_spec, load_spec, parse_spec
from padgen.sweep.variant import Task, run_task

HERE = Path(__file__).parent
BASE = "paper-32"
PLANS, BUILDS = 1000, 60
COLD_RUNS = 3
SIZES = (32, 72, 128, 288, 512, 1152, 2048, 4608, 8192)
SCAD_LIMIT_S = 1500
CHORD_MM = 0.01


def cold_s(command: str, work: Path, runs: int = COLD_RUNS) -> float:
    """Median wall time of a `padgen` command in a process of its own, its cache empty each time."""
    times = []
    for run in range(runs):
        there = work / f"{command}-{run}"
        env = {**os.environ, VARIABLE: str(there / "cache")}
        start = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "padgen", command, BASE, "-o", str(there / "out")],
            env=env,
            check=True,
            capture_output=True,
        )
        times.append(time.perf_counter() - start)
    return median(times)


def tasks(count: int, stage: str, out: Path, vary: Callable[[float, dict[str, Any]], None]) -> list[Task]:
    """Variants of the base, of which `vary` changes the table by a share from 0 to 1."""
    made = []
    for number in range(count):
        table = tomllib.loads(find_spec(BASE).read_text())
        table["name"] = f"measure-{number:05d}"
        vary((number + 0.5) / count, table)
        made.append(Task(number, "", {}, table, ".", str(out / table["name"]), stage, ("stl", "3mf"), 0))
    return made


def quality(share: float, table: dict[str, Any]) -> None:
    """Q, modulus and level, of different periods: no two alike."""
    table["q_min"] = 12 + 18 * share
    table["material"] = {"youngs_modulus_gpa": 1.8 + (7 * share) % 1}
    table["drive"] = {"level_um": 5 + 10 * ((31 * share) % 1)}


def beams(share: float, table: dict[str, Any]) -> None:
    """Resonances, so that no two pads share a taxel."""
    table["resonances_hz"] = [54 + 4 * share, 74 + 6 * share]


def layout(share: float, table: dict[str, Any]) -> None:
    """Border and holes, so that all pads share their taxels."""
    table["pad"] = {"border_mm": 6 + 6 * share, "hole_diameter_mm": 2.4 + share}


def made_s(work: Sequence[Task], workers: int) -> tuple[float, bool]:
    """Wall time of all tasks on so many workers, their start included, and whether one had the CAD kernel loaded."""
    start = time.perf_counter()
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        kernel = any(list(pool.map(one, work, chunksize=max(len(work) // 64, 1))))
    return time.perf_counter() - start, kernel


def one(task: Task) -> bool:
    """Make a variant; whether this process has loaded the CAD kernel."""
    record = run_task(task)
    if record.status != "done":
        raise RuntimeError(record.sentence)
    return "OCP" in sys.modules or "build123d" in sys.modules


def compared(
    stage: str, count: int, vary: Callable[[float, dict[str, Any]], None], known: bool, bar: float
) -> Iterator[str]:
    """One row of the table: `count` variants on one worker and on two against the cold command.

    Where `known`, the store knows the taxels from one pad before; else it is empty for each run.
    """
    command = "plan" if stage == "plan" else "build"
    with tempfile.TemporaryDirectory() as folder:
        work, seconds = Path(folder), {}
        cold = cold_s(command, work)
        for workers in (1, 2):
            os.environ[VARIABLE] = str(work / f"cache-{workers}")
            if known:
                made_s(tasks(1, stage, work / f"known-{workers}", vary), 1)
            seconds[workers], kernel = made_s(tasks(count, stage, work / f"{workers}", vary), workers)
        cold = (cold + cold_s(command, work)) / 2
        shutil.rmtree(work / "cache-1", ignore_errors=True)
    each = {workers: s / count / cold for workers, s in seconds.items()}
    yield (
        f"| {count} x {stage}, {vary.__name__} | {cold:.3f} | {seconds[1]:.2f} | {seconds[2]:.2f} |"
        f" {seconds[1] / seconds[2]:.2f} | {each[1]:.3f} | {each[2]:.3f} | {bar} | {'yes' if kernel else 'no'} |"
    )


HEAD = [
    "| what | cold command s | 1 worker s | 2 workers s | ratio | each over cold, 1 worker | 2 workers | bar |"
    " CAD kernel loaded |",
    "|---|---|---|---|---|---|---|---|---|",
]


def plans() -> Iterator[str]:
    yield from compared("plan", PLANS, quality, False, 0.04)


def builds() -> Iterator[str]:
    yield from compared("build", BUILDS, beams, False, 0.25)


def layouts() -> Iterator[str]:
    yield from compared("build", BUILDS, layout, True, 0.08)


def large_plan(taxels: int) -> Plan:
    """The paper's cell repeated, beyond the 500 mm that a spec allows."""
    coils = round((taxels / 2) ** 0.5)
    spec = parse_spec(
        """
        name = "growth"
        resolution = 2
        band_hz = [50, 200]
        q_min = 15
        resonances_hz = [56, 76]
        pad = { width_mm = 12.5, depth_mm = 12.5 }
        coil = { grid = [1, 1] }
        printer = { name = "fdm-0.4", bed_x_mm = 2000, bed_y_mm = 2000 }
        """
    )
    pad = replace(spec.pad, width_mm=12.5 * coils, depth_mm=12.5 * coils)
    return make_plan(replace(spec, resolution=taxels, pad=pad, coil=replace(spec.coil, grid=(coils, coils))))


def growth() -> Iterator[str]:
    """Times against taxels, the fits of their growth, and the picture."""
    build_pad(large_plan(32))
    rows = []
    for taxels in SIZES:
        best = np.full(3, np.inf)
        for _ in range(3 if taxels < 2000 else 1):
            # What earlier rounds and sizes found of the same tiles.
            _kept_pairs.cache_clear()
            _narrowest_of_cell.cache_clear()
            clock = [time.process_time()]
            plan = large_plan(taxels)
            clock.append(time.process_time())
            pad = build_pad(plan)
            clock.append(time.process_time())
            report = check_pad(pad, plan)
            clock.append(time.process_time())
            assert not [f for f in report.findings if f.level == "error"], report.findings
            best = np.minimum(best, np.diff(clock))
        rows.append((taxels, len(pad.mesh.triangles), *best.tolist()))
    yield "Processor time, which is run time where nobody else computes: all is on one core."
    yield ""
    yield "| taxels | triangles | plan s | build without checks s | checks s |"
    yield "|---|---|---|---|---|"
    yield from (f"| {n} | {t} | {p:.3f} | {b:.3f} | {c:.3f} |" for n, t, p, b, c in rows)
    table = np.array(rows, float)
    slopes = np.polyfit(np.log(table[:, 0]), np.log(table[:, 2:]), 1)[0]
    last = np.log(table[-1, 2:] / table[-3, 2:]) / np.log(table[-1, 0] / table[-3, 0])
    yield "| **fitted exponent** | | " + " | ".join(f"**{slope:.2f}**" for slope in slopes) + " |"
    yield "| from the last but two to the last | | " + " | ".join(f"{slope:.2f}" for slope in last) + " |"
    draw(table, slopes, HERE / "growth.svg")


def draw(table: np.ndarray, slopes: np.ndarray, path: Path) -> None:
    """The times in a log-log plot with their fits; the same figures give the same bytes."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "padgen", "svg.fonttype": "none", "font.size": 9})
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    names = ("plan", "build without checks", "checks")
    for name, seconds, slope, mark, colour in zip(
        names, table[:, 2:].T, slopes, "os^", ("#0072b2", "#009e73", "#d55e00"), strict=True
    ):
        centre = np.exp(np.log(table[:, 0]).mean()), np.exp(np.log(seconds).mean())
        axes.plot(table[:, 0], seconds, mark, color=colour, label=f"{name}, exponent {slope:.2f}")
        axes.plot(table[:, 0], centre[1] * (table[:, 0] / centre[0]) ** slope, color=colour, lw=1)
    axes.set(xscale="log", yscale="log", xlabel="taxels", ylabel="processor time in s")
    axes.grid(which="major", lw=0.4)
    axes.legend(frameon=False)
    figure.savefig(path, metadata={"Date": None, "Creator": None})
    pyplot.close(figure)


def scad(plan: Plan) -> str:
    """The pad as OpenSCAD text, as a careful user would write it: a module a channel, the frame drawn flat.

    Root fillets are left out; circles are as fine as padgen's.
    """
    size = plan.typed_spec.pad
    modules = "".join(_module(plan, channel) for channel in plan.channels)
    frame = (
        f"linear_extrude({size.frame_thickness_mm:.6f}) difference() {{\n{_outside(size)}\n"
        + "".join(_placed(plan, t, f"window{t.channel}();") for t in plan.taxels)
        + "}\n"
    )
    moving = "".join(_placed(plan, t, f"moving{t.channel}();") for t in plan.taxels)
    recesses = "".join(_placed(plan, t, f"recess{t.channel}();") for t in plan.taxels)
    return f"{modules}difference() {{\nunion() {{\n{frame}{moving}}}\n{recesses}}}\n"


def _outside(size: Any) -> str:
    """The border's outline with its holes, flat."""
    x, y = size.width_mm / 2 + size.border_mm, size.depth_mm / 2 + size.border_mm
    round_mm, hole = size.border_mm / 2, size.hole_diameter_mm / 2
    inner = f"square([{2 * (x - round_mm):.6f}, {2 * (y - round_mm):.6f}], center=true)"
    text = f"offset(r={round_mm:.6f}, $fn={_sides(round_mm)}) {inner};"
    if hole:
        off = [v - size.border_mm / 2 for v in (x, y)]
        text += "".join(
            f"\ntranslate([{sx * off[0]:.6f}, {sy * off[1]:.6f}]) circle(r={hole:.6f}, $fn={_sides(hole)});"
            for sx in (-1, 1)
            for sy in (-1, 1)
        )
    return text


def _module(plan: Plan, channel: Channel) -> str:
    """A channel's window, moving parts and recess in the taxel's own axes."""
    arranged, plate, k = plan.arrangement(channel), plan.plate, channel.index
    length, width = (float(v) for v in arranged.window_mm)
    x = float(arranged.washer_x_mm)
    boxes: list[tuple[float, ...]] = []
    for strip in arranged.beams:
        low, high = sorted((float(strip.root_x_mm), float(strip.tip_x_mm)))
        y, half = float(strip.y_mm), float(strip.width_mm) / 2
        # A little into frame and plate: what only touches is no solid for CGAL.
        boxes.append((low - 0.01, high + 0.01, y - half, y + half, float(strip.thickness_mm)))
    boxes += [tuple(float(v) for v in block) for block in arranged.blocks]
    parts = "".join(
        f"translate([{x0:.6f}, {y0:.6f}, 0]) cube([{x1 - x0:.6f}, {y1 - y0:.6f}, {z:.6f}]);\n"
        for x0, x1, y0, y1, z in boxes
    )
    radius, edge, top = plate.boss_diameter_mm / 2, plate.boss_edge_mm, plate.boss_top_mm
    low = plate.thickness_mm - 0.01
    if top > plate.thickness_mm:
        fine = f"$fn={_sides(radius)}"
        parts += f"translate([{x:.6f}, 0, {low:.6f}]) cylinder(r={radius:.6f}, h={top - edge - low:.6f}, {fine});\n"
        parts += (
            f"translate([{x:.6f}, 0, {top - edge:.6f}])"
            f" cylinder(r1={radius:.6f}, r2={radius - edge:.6f}, h={edge:.6f}, {fine});\n"
        )
    recess = plate.recess_diameter_mm / 2
    return (
        f"module window{k}() translate([0, {-width / 2:.6f}]) square([{length:.6f}, {width:.6f}]);\n"
        f"module moving{k}() {{\n{parts}}}\n"
        f"module recess{k}() translate([{x:.6f}, 0, -1])"
        f" cylinder(r={recess:.6f}, h={plate.recess_depth_mm + 1:.6f}, $fn={_sides(recess)});\n"
    )


def _placed(plan: Plan, taxel: Any, what: str) -> str:
    coils, site = plan.coils, plan.channels[taxel.channel].site
    x = (taxel.coil[1] - (coils.columns - 1) / 2) * coils.pitch_x_mm
    y = (taxel.coil[0] - (coils.rows - 1) / 2) * coils.pitch_y_mm
    cosine, sine = TURNS[site.along]
    angle = round(np.degrees(np.arctan2(sine, cosine)))
    turn = f"rotate({180 if taxel.turned else 0}) translate([{site.origin_mm[0]:.6f}, {site.origin_mm[1]:.6f}])"
    return f"translate([{x:.6f}, {y:.6f}]) {turn} rotate({angle}) {what}\n"


def _sides(radius: float) -> int:
    """Sides of a circle within the chord."""
    return ceil(pi / acos(1 - CHORD_MM / radius))


def openscad_s(plan: Plan, work: Path) -> tuple[float | None, float | None]:
    """Wall time that OpenSCAD takes for an STL, and its volume over padgen's; None beyond the limit."""
    (work / "pad.scad").write_text(scad(plan))
    start = time.perf_counter()
    try:
        subprocess.run(
            ["openscad", "-o", str(work / "pad.stl"), str(work / "pad.scad")],
            check=True,
            capture_output=True,
            timeout=SCAD_LIMIT_S,
            env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
        )
    except subprocess.TimeoutExpired:
        return None, None
    seconds = time.perf_counter() - start
    import trimesh

    return seconds, float(trimesh.load(work / "pad.stl").volume) / build_pad(plan).volume_mm3


def openscad() -> Iterator[str]:
    """One pad of each size; a loop over 60 takes 60 times as long, since OpenSCAD keeps nothing between runs."""
    version = subprocess.run(["openscad", "--version"], capture_output=True, text=True, check=False).stderr.strip()
    yield f"{version}, geometry by CGAL, on one core; fillets left out, which padgen has."
    yield ""
    yield "| pad | taxels | OpenSCAD s | padgen, cold process s | volume over padgen's |"
    yield "|---|---|---|---|---|"
    small = 'name = "four"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\n[pad]\nwidth_mm = 25\ndepth_mm = 25\n'
    for name, plan in (("four", make_plan(parse_spec(small))), (BASE, make_plan(load_spec(BASE)))):
        with tempfile.TemporaryDirectory() as folder:
            seconds, volume = openscad_s(plan, Path(folder))
            cold = cold_s("build", Path(folder), 2) if name == BASE else float("nan")
        told = (
            f"over {SCAD_LIMIT_S} | {cold:.2f} | " if seconds is None else f"{seconds:.1f} | {cold:.2f} | {volume:.4f}"
        )
        yield f"| {name} | {len(plan.taxels)} | {told} |"


PARTS: dict[str, Callable[[], Iterator[str]]] = {
    "plans": plans,
    "builds": builds,
    "layouts": layouts,
    "growth": growth,
    "openscad": openscad,
}


def main() -> None:
    asked = sys.argv[1:] or list(PARTS)
    in_table = [name for name in asked if name in ("plans", "builds", "layouts")]
    if in_table:
        print(*HEAD, sep="\n")
    for name in [*in_table, *(name for name in asked if name not in in_table)]:
        if name not in in_table:
            print(f"\n## {name.capitalize()}\n")
        for line in PARTS[name]():
            print(line, flush=True)


if __name__ == "__main__":
    main()
