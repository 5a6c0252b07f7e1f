"""Measure how run time and memory grow from 32 to 8,192 taxels; draw docs/growth.svg. A section of docs/performance.md.

``python docs/measure_growth.py TAXELS FOLDER`` builds one such pad into a folder, and prints the processor seconds of
its stages, on which other work on the machine has little influence.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from padgen.core.display import COLOURS, plot_bytes, plot_style
from padgen.make.pad import Pad
from padgen.planner import Plan, make_plan
from padgen.spec import parse_spec

HERE = Path(__file__).parent
SIZES = (32, 72, 128, 288, 512, 1152, 2048, 4608, 8192)
WHAT = ("plan", "solids and union", "checks", "whole command")


def large_plan(taxels: int) -> Plan:
    """Plan many of the paper's cells, at a level at which they stay cool."""
    coils = round((taxels / 2) ** 0.5)
    return make_plan(
        parse_spec(
            f"""
            name = "growth"
            resolution = {taxels}
            band_hz = [50, 200]
            q_min = 15
            resonances_hz = [56, 76]
            pad = {{ width_mm = {12.5 * coils}, depth_mm = {12.5 * coils} }}
            coil = {{ grid = [{coils}, {coils}] }}
            printer = {{ name = "fdm-0.4", bed_x_mm = 2000, bed_y_mm = 2000 }}
            drive = {{ level_um = 3 }}
            """
        )
    )


def one(taxels: int, folder: str) -> None:
    """Plan, model and check a pad, and print seconds; with a folder, build it with files as the command does."""
    clock = [time.process_time()]
    plan = large_plan(taxels)
    clock.append(time.process_time())
    pad = Pad(plan.spec, given=plan)
    if folder:
        findings = pad.save(folder, ("stl", "3mf", "step"), force=True).findings
    else:
        assert len(pad.mesh.triangles)
        clock.append(time.process_time())
        findings = pad.check().findings
    clock.append(time.process_time())
    assert not [f for f in findings if f.level == "error"], findings
    print(json.dumps([*np.diff(clock).tolist(), len(pad.mesh.triangles)]))


def measured(taxels: int, folder: str) -> tuple[list[float], float, float, float]:
    """Run `one` in a process of its own; return what it prints, its wall and processor seconds, and its peak in MiB."""
    start = time.perf_counter()
    child = subprocess.Popen([sys.executable, __file__, str(taxels), folder], stdout=subprocess.PIPE, text=True)
    printed = json.loads(child.stdout.read() if child.stdout else "")
    _, status, used = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - start
    assert status == 0
    return printed, seconds, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def growth() -> list[str]:
    """Return the table of times against taxels with the fits of their growth, and draw the picture."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        measured(32, folder)  # the taxels are known from then on
        for taxels in SIZES:
            best = np.full(6, np.inf)
            for _ in range(3 if taxels < 1000 else 1):
                (plan, build, checks, triangles), *_ = measured(taxels, "")
                _, whole, both, peak = measured(taxels, folder)
                best = np.minimum(best, [plan, build, checks, whole, both, peak])
            rows.append((taxels, int(triangles), *best.tolist()))
    table = np.array(rows, float)
    times = table[:, 2:7]
    slopes = np.polyfit(np.log(table[:, 0]), np.log(times), 1)[0]
    last = np.log(times[-1] / times[-3]) / np.log(table[-1, 0] / table[-3, 0])
    draw(table, slopes)
    return [
        "| taxels | triangles | plan s | solids and union s | checks s | whole command s | both cores s | peak MiB |",
        "|---|---|---|---|---|---|---|---|",
        *(
            f"| {n} | {t} | {p:.3f} | {b:.3f} | {c:.3f} | {w:.2f} | {u:.2f} | {m:.0f} |"
            for n, t, p, b, c, w, u, m in rows
        ),
        "| **fitted exponent** (bar 1.05) | | " + " | ".join(f"**{slope:.2f}**" for slope in slopes) + " | |",
        "| from the last but two to the last | | " + " | ".join(f"{slope:.2f}" for slope in last) + " | |",
        "",
        "![Run time against taxels](growth.svg)",
    ]


def draw(table: np.ndarray, slopes: np.ndarray) -> None:
    """Draw the times in a log-log plot with their fits."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(6, 4), layout="constrained")
        axes = figure.subplots()
        marks = zip(WHAT, table[:, 2:6].T, slopes[:4], "os^D", COLOURS[:4], strict=True)
        for name, seconds, slope, mark, colour in marks:
            centre = np.exp(np.log(table[:, 0]).mean()), np.exp(np.log(seconds).mean())
            axes.plot(table[:, 0], seconds, mark, color=colour, label=f"{name}, exponent {slope:.2f}")
            axes.plot(table[:, 0], centre[1] * (table[:, 0] / centre[0]) ** slope, color=colour, lw=1)
        axes.set(xscale="log", yscale="log", xlabel="taxels", ylabel="run time in s")
        axes.grid(which="major", lw=0.4)
        axes.legend(frameon=False)
        (HERE / "growth.svg").write_bytes(plot_bytes(figure, "svg"))


if __name__ == "__main__":
    one(int(sys.argv[1]), sys.argv[2])
