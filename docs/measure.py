"""Measures what docs/performance.md reports and writes it anew: `make performance`."""

import platform
import resource
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from statistics import median

from padgen.planner import Plan, make_plan
from padgen.solid.checks import check_pad
from padgen.solid.export import stl_bytes
from padgen.solid.mesh import as_manifold
from padgen.solid.pad import build_pad
from padgen.spec import load_spec, parse_spec

HERE = Path(__file__).parent
PADGEN = str(Path(sys.executable).with_name("padgen"))


def wall_s(command: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - start


def paired(command: list[str], base: list[str], runs: int) -> tuple[float, float, float]:
    """Medians of both, and of the ratio, run in turn after one warm-up."""
    wall_s(command), wall_s(base)
    pairs = [(wall_s(command), wall_s(base)) for _ in range(runs)]
    return median(a for a, _ in pairs), median(b for _, b in pairs), median(a / b for a, b in pairs)


def processes() -> list[str]:
    lines = ["| command, cold process | median s | against | median s | ratio | bar |", "|---|---|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as folder:
        build = [PADGEN, "build", "paper-32", "-o", folder]
        for name, command, module, bar, runs in (
            ("padgen plan paper-32", [PADGEN, "plan", "paper-32", "-o", folder + "/plan"], "numpy", "2.5", 15),
            ("padgen build paper-32 --force", [*build, "--force"], "build123d", "1.5", 7),
            ("padgen build paper-32, nothing changed", build, "numpy", "2.5", 15),
        ):
            own, other, ratio = paired(command, [sys.executable, "-c", f"import {module}"], runs)
            lines.append(f"| `{name}` | {own:.3f} | `import {module}` | {other:.3f} | {ratio:.2f} | {bar} |")
    return lines


def pad_plan(taxels: int) -> Plan:
    """The paper's cell, repeated to `taxels`."""
    coils = round((taxels / 2) ** 0.5)
    text = f"""
        name = "growth"
        resolution = {taxels}
        band_hz = [50, 200]
        q_min = 15
        resonances_hz = [56, 76]
        pad = {{ width_mm = {12.5 * coils}, depth_mm = {12.5 * coils} }}
        coil = {{ grid = [{coils}, {coils}] }}
        printer = {{ name = "fdm-0.4", bed_x_mm = 500, bed_y_mm = 500 }}
    """
    return make_plan(parse_spec(text))


def growth() -> list[str]:
    lines = [
        "| taxels | triangles | plan s | solids and union s | checks s | STL s | per taxel ms | peak MiB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for taxels in (32, 128, 512, 2048):
        times = [time.perf_counter()]
        plan = pad_plan(taxels)
        times.append(time.perf_counter())
        pad = build_pad(plan)
        times.append(time.perf_counter())
        report = check_pad(pad, plan)
        times.append(time.perf_counter())
        stl_bytes(pad.mesh, "growth")
        times.append(time.perf_counter())
        assert not report.findings, report.findings
        plan_s, union_s, checks_s, stl_s = (b - a for a, b in pairwise(times))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        each = (union_s + checks_s + stl_s) / taxels * 1e3
        lines.append(
            f"| {taxels} | {len(pad.mesh.triangles)} | {plan_s:.3f} | {union_s:.3f} | {checks_s:.3f} | {stl_s:.3f}"
            f" | {each:.2f} | {peak:.0f} |"
        )
    return lines


def chords() -> list[str]:
    lines = ["| chord mm | angle rad | triangles | volume error | solids and union s |", "|---|---|---|---|---|"]
    plan = make_plan(load_spec("paper-32"))
    for chord, angle in ((0.1, 0.6), (0.05, 0.6), (0.02, 0.4), (0.01, 0.3), (0.005, 0.2), (0.002, 0.1)):
        start = time.perf_counter()
        pad = build_pad(plan, chord, angle)
        seconds = time.perf_counter() - start
        error = as_manifold(pad.mesh, "pad").volume() / pad.volume_mm3 - 1
        default = " (default)" if (chord, angle) == (0.01, 0.3) else ""
        lines.append(f"| {chord}{default} | {angle} | {len(pad.mesh.triangles)} | {error:+.1e} | {seconds:.3f} |")
    return lines


def main() -> None:
    build_pad(pad_plan(32))
    machine = f"{platform.processor() or platform.machine()}, Python {platform.python_version()}, 2 cores, shared"
    text = [
        "# Performance",
        "",
        f"Written by `make performance` ({machine}). Trust ratios more than seconds.",
        "",
        "## Whole commands",
        "",
        *processes(),
        "",
        "Imports are the cost. `import build123d` spends about 40 % on scikit-learn, which it needs for one function",
        "that recognises primitives in foreign meshes; `padgen.solid.kernel` puts that import off until the function",
        "is called, which pays for all of padgen's own work. An unchanged build imports neither numpy nor a CAD",
        "kernel: it compares the manifest's hashes.",
        "",
        "## Growth",
        "",
        "The paper's cell repeated; in one process, the CAD kernel loaded. Each distinct taxel is modelled once; tiles",
        "are placed on a lattice and welded at their corners.",
        "",
        *growth(),
        "",
        "## Chord tolerance",
        "",
        "Mesh of paper-32 against the exact volume of its solids.",
        "",
        *chords(),
        "",
    ]
    (HERE / "performance.md").write_text("\n".join(text))


if __name__ == "__main__":
    main()
