"""How run time grows with taxels, 32 … 8,192; draws docs/growth.svg. A section of docs/performance.md."""

import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from padgen.core.plots import STYLE, plot_bytes
from padgen.planner import Plan, make_plan
from padgen.solid.checks import _narrowest_of_cell, check_pad
from padgen.solid.pad_solid import build_pad
from padgen.solid.topology import _kept_pairs
from padgen.spec import parse_spec

HERE = Path(__file__).parent
SIZES = (32, 72, 128, 288, 512, 1152, 2048, 4608, 8192)
WHAT = ("plan", "build without checks", "checks")


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


def growth() -> list[str]:
    """Times against taxels, the fits of their growth, and the picture."""
    build_pad(large_plan(32))
    rows = []
    for taxels in SIZES:
        best = np.full(3, np.inf)
        for _ in range(3 if taxels < 2000 else 2):
            # What earlier rounds and sizes found of the same tiles.
            _kept_pairs.cache_clear()
            _narrowest_of_cell.cache_clear()
            clock = [time.perf_counter()]
            plan = large_plan(taxels)
            clock.append(time.perf_counter())
            pad = build_pad(plan)
            clock.append(time.perf_counter())
            report = check_pad(pad, plan)
            clock.append(time.perf_counter())
            assert not [f for f in report.findings if f.level == "error"], report.findings
            best = np.minimum(best, np.diff(clock))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        rows.append((taxels, len(pad.mesh.triangles), *best.tolist(), peak))
    table = np.array(rows, float)
    slopes = np.polyfit(np.log(table[:, 0]), np.log(table[:, 2:5]), 1)[0]
    last = np.log(table[-1, 2:5] / table[-3, 2:5]) / np.log(table[-1, 0] / table[-3, 0])
    draw(table, slopes)
    return [
        "| taxels | triangles | plan s | build without checks s | checks s | peak MiB |",
        "|---|---|---|---|---|---|",
        *(f"| {n} | {t} | {p:.3f} | {b:.3f} | {c:.3f} | {m:.0f} |" for n, t, p, b, c, m in rows),
        "| **fitted exponent** (bar 1.1) | | " + " | ".join(f"**{slope:.2f}**" for slope in slopes) + " | |",
        "| from the last but two to the last | | " + " | ".join(f"{slope:.2f}" for slope in last) + " | |",
        "",
        "![Run time against taxels](growth.svg)",
    ]


def draw(table: np.ndarray, slopes: np.ndarray) -> None:
    """The times in a log-log plot with their fits."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6, 4), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        marks = zip(WHAT, table[:, 2:5].T, slopes, "os^", ("#0072b2", "#009e73", "#d55e00"), strict=True)
        for name, seconds, slope, mark, colour in marks:
            centre = np.exp(np.log(table[:, 0]).mean()), np.exp(np.log(seconds).mean())
            axes.plot(table[:, 0], seconds, mark, color=colour, label=f"{name}, exponent {slope:.2f}")
            axes.plot(table[:, 0], centre[1] * (table[:, 0] / centre[0]) ** slope, color=colour, lw=1)
        axes.set(xscale="log", yscale="log", xlabel="taxels", ylabel="run time in s")
        axes.grid(which="major", lw=0.4)
        axes.legend(frameon=False)
        (HERE / "growth.svg").write_bytes(plot_bytes(figure, "svg"))
