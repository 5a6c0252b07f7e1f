"""Measure sweeps on one worker and on two by `padgen sweep`. A section of docs/performance.md (`make performance`)."""

import csv
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from padgen.core.cache import VARIABLE

PADGEN = str(Path(sys.executable).with_name("padgen"))
PLANS = 1000
BUILDS = 60
MANY = 10_000
COLD_RUNS = 5
ROUNDS = 3
HEAD = """
name = "measured"
base = "paper-32"
stage = "{stage}"
"""
GRID_AXES = """
[axes]
q_min = { low = 12, high = 30, steps = 10 }
material.youngs_modulus_gpa = { low = 1.8, high = 2.8, steps = 10 }
drive.level_um = { low = 5, high = 14, steps = 10 }
"""
SAMPLE_AXES = f"""
[axes]
q_min = {{ low = 12, high = 30 }}
material.youngs_modulus_gpa = {{ low = 1.8, high = 2.8 }}
drive.level_um = {{ low = 5, high = 15 }}
[sample]
method = "latin-hypercube"
count = {PLANS}
"""
LAYOUT_AXES = """
[axes]
pad.border_mm = { low = 6, high = 12, steps = 10 }
pad.hole_diameter_mm = { low = 2.4, high = 3.4, steps = 6 }
"""
MANY_AXES = f"""
folders = false
[axes]
q_min = {{ low = 12, high = 30 }}
[sample]
method = "latin-hypercube"
count = {MANY}
"""


def beam_pairs() -> list[tuple[float, float]]:
    """Return resonances of `BUILDS` pads, no two of which share a taxel."""
    return [(round(54 + 4 * k / BUILDS, 3), round(74 + 6 * k / BUILDS, 3)) for k in range(BUILDS)]


def beam_axes() -> str:
    return f"[axes]\nresonances_hz = {[list(pair) for pair in beam_pairs()]}\n"


def wall_s(command: list[str], cache: Path) -> float:
    """Return the wall time in s of a command in a process of its own."""
    start = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, VARIABLE: str(cache)})
    return time.perf_counter() - start


def cold_s(work: Path, *command: str) -> float:
    """Return the median wall time in s of a `padgen` command on paper-32, with its cache and folder empty."""
    runs = []
    for _ in range(COLD_RUNS):
        with tempfile.TemporaryDirectory(dir=work) as there:
            runs.append(wall_s([PADGEN, *command, "-o", f"{there}/out"], Path(there, "cache")))
    return median(runs)


def swept_s(work: Path, text: str, workers: int, cache: Path) -> tuple[float, float]:
    """Return the wall time in s of a whole `padgen sweep`, and the peak memory in MB of a worker."""
    with tempfile.TemporaryDirectory(dir=work) as there:
        path = Path(there, "sweep.toml")
        path.write_text(text)
        seconds = wall_s([PADGEN, "sweep", str(path), "-j", str(workers), "-o", f"{there}/out"], cache)
        with Path(there, "out", "index.csv").open() as file:
            rows = list(csv.DictReader(file))
    assert all(row["status"] == "done" for row in rows), "a variant was not made"
    return seconds, max(float(row["peak_memory_mb"]) for row in rows)


def compared(work: Path, name: str, count: int, text: str, cold: list[str], bar: str, known: bool = False) -> str:
    """Return a row on a sweep on one and on two workers and the cold command, in turn: medians of times and ratios."""
    rounds = []
    memory = 0.0
    for _ in range(ROUNDS):
        seconds = [cold_s(work, *cold)]
        for workers in (1, 2):
            with tempfile.TemporaryDirectory(dir=work) as there:
                if known:
                    wall_s([PADGEN, *cold, "-o", f"{there}/known"], Path(there, "cache"))
                taken, memory = swept_s(work, text, workers, Path(there, "cache"))
                seconds.append(taken)
        rounds.append(seconds)
    command, one, two = (median(column) for column in zip(*rounds, strict=True))
    faster = median(a / b for _, a, b in rounds)
    in_cold = [median(seconds[k] / seconds[0] for seconds in rounds) for k in (1, 2)]
    return (
        f"| {name} | {command:.3f} | {one:.2f} | {two:.2f} | {faster:.2f} | {in_cold[0]:.1f} | {in_cold[1]:.1f} |"
        f" {in_cold[1] / count:.3f} | {bar} | {memory:.0f} |"
    )


def sweeps() -> list[str]:
    """Return the table of plans and builds, with their bars."""
    build = ["build", "paper-32"]
    plan = HEAD.format(stage="plan")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        rows = [
            compared(work, "1,000 plans, a grid", PLANS, plan + GRID_AXES, ["plan", "paper-32"], "≤ 40 in all"),
            compared(work, "1,000 plans, a sample", PLANS, plan + SAMPLE_AXES, ["plan", "paper-32"], "≤ 40 in all"),
            compared(
                work,
                "60 builds of distinct pads",
                BUILDS,
                HEAD.format(stage="build") + beam_axes(),
                build,
                "≤ 0.25 each",
            ),
            compared(
                work,
                "60 builds, layout only",
                BUILDS,
                HEAD.format(stage="build") + LAYOUT_AXES,
                build,
                "≤ 0.08 each",
                known=True,
            ),
        ]
    return [
        "| sweep | cold command s | 1 worker s | 2 workers s | faster | 1 worker, in cold commands | 2 workers | each |"
        " bar | worker's peak MB |",
        "|---|---|---|---|---|---|---|---|---|---|",
        *rows,
    ]


def many() -> list[str]:
    """Return the figures of 10,000 variants: the parent's memory over time, and the time of a second run."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "sweep.toml")
        out = Path(folder, "out")
        cache = Path(folder, "cache")
        path.write_text(HEAD.format(stage="plan") + MANY_AXES)
        command = [PADGEN, "sweep", str(path), "-o", str(out), "--json"]
        memory = watched_mb(command, cache)
        resumed = min(wall_s(command, cache) for _ in range(3))
        start = first_event_s(command, cache)
    (first, held), (last, held_then) = memory[0], memory[-1]
    return [
        f"The parent holds {held:.1f} MB after {first} variants and {held_then:.1f} MB after {last}. Started again with"
        f" all finished, it says",
        f"the first word after {start:.2f} s (bar 3 s), and has written index and front anew after {resumed:.2f} s.",
    ]


def watched_mb(command: list[str], cache: Path) -> list[tuple[int, float]]:
    """Return the parent's resident memory in MB after each fifth of the variants (Linux)."""
    found: list[tuple[int, float]] = []
    env = {**os.environ, VARIABLE: str(cache)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env) as process:
        assert process.stdout
        done = 0
        for line in process.stdout:
            done += '"done"' in line[:40]
            if done and done % (MANY // 5) == 0 and (not found or found[-1][0] != done):
                status = Path(f"/proc/{process.pid}/status").read_text()
                held = next(row for row in status.splitlines() if row.startswith("VmRSS"))
                found.append((done, int(held.split()[1]) / 1e3))
    return found


def first_event_s(command: list[str], cache: Path) -> float:
    """Return the wall time in s until a command writes its first line."""
    start = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, env={**os.environ, VARIABLE: str(cache)}) as process:
        assert process.stdout
        process.stdout.readline()
        seconds = time.perf_counter() - start
        process.stdout.read()
    return seconds
