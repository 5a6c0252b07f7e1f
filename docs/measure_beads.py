"""Measures how a slicer lays beams and what holds their ends with padgen's profile: along the beam or across it.

`python docs/measure_beads.py` (needs prusa-slicer) prints Markdown: the share of the plastic whose lines run along the
beam (the mean of cos² of the angle between them), in the layers of the beam: in the beam itself, behind its root as
deep as the beam is thick, and as far in front of its tip.
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from padgen.make.pad import Pad
from padgen.planner import Plan
from padgen.spec import Spec, load_spec, parse_spec
from tests.gcode import Extrusions, read_gcode
from tests.sliced.test_slicer import around, laid_mm3, own_axes

SMALL = """
name = "{name}"
resolution = 8
band_hz = [40, 500]
q_min = 15
resonances_hz = {hz}
pad = {{ width_mm = {side}, depth_mm = {side} }}
coil = {{ grid = [2, 2] }}
suspension = {{ {suspension} }}
"""
LEAST_MM = 0.3
"""Least depth of the places at the ends of a beam: a line or so."""


def specs() -> list[Spec]:
    """Templates and small pads whose beams are narrow and wide, straight and bent."""
    small = (
        ("wide", "[60, 120]", 50, 'topology = "cantilever", thickness_mm = 0.4, tune = "width+length"'),
        ("folded", "[60, 150]", 40, 'topology = "folded"'),
        ("bridge", "[120, 250]", 50, 'topology = "bridge"'),
        ("legs", "[60, 120]", 40, 'topology = "serpentine-5"'),
    )
    own = [parse_spec(SMALL.format(name=name, hz=hz, side=side, suspension=text)) for name, hz, side, text in small]
    return [load_spec("pad-32"), load_spec("quad-64"), load_spec("wide-11"), *own]


def along_share(
    plan: Plan, taxel: object, lines: Extrusions, middle: np.ndarray, low: np.ndarray, high: np.ndarray, way: np.ndarray
) -> float:
    """Return the share of the plastic between two corners whose lines run along `way` (2,)."""
    start, stop = own_axes(plan, taxel, lines, middle)
    run = stop - start
    square = (run @ way) ** 2 / np.maximum((run**2).sum(1), 1e-12)
    laid = laid_mm3(plan, taxel, lines, middle, np.minimum(low, high), np.maximum(low, high))
    return float((laid * square).sum() / laid.sum()) if laid.sum() > 0 else float("nan")


def rows(plan: Plan, lines: Extrusions, middle: np.ndarray) -> Iterator[str]:
    """Yield a row for each channel: size of the beam, and the shares in it and at its ends."""
    reach = max(plan.cell.width_mm, plan.cell.depth_mm)
    for channel in plan.channels:
        taxel = next(t for t in plan.taxels if t.channel == channel.index)
        near = around(lines, np.array([taxel.x_mm, taxel.y_mm]) + middle, reach)
        beam = channel.beam
        near = type(near)(
            *(getattr(near, name)[near.layer < beam.layers] for name in ("start", "stop", "width", "height", "layer")),
            near.layer_top_mm,
        )
        path = plan.arrangement(channel).beams[0]
        depth = max(beam.thickness_mm, LEAST_MM)
        half = beam.width_mm / 2
        inside = []
        for k, piece in enumerate(path.segments):
            if piece.turn_rad or piece.length_mm < plan.spec.printer.line_width_mm:
                continue
            centre, way = np.split(np.array(path.within(k, 0.5), float), 2)
            side = np.abs(way) * float(piece.length_mm) * 0.45 + np.abs(way[::-1]) * half
            inside.append(along_share(plan, taxel, near, middle, centre - side, centre + side, way))
        ends = []
        for point, out in ((path.corners[0], -1.0), (path.corners[-1], 1.0)):
            place, way = np.split(np.array(point, float), 2)
            across = np.abs(way[::-1]) * half
            ends.append(along_share(plan, taxel, near, middle, place - across, place + across + out * depth * way, way))
        shares = " | ".join(f"{100 * share:.0f}" for share in (min(inside), *ends))
        lines_across = beam.width_mm / plan.spec.printer.line_width_mm
        yield (
            f"| {plan.name}, {channel.index} | {beam.topology} | {beam.width_mm:.2f} ({lines_across:.1f} lines) |"
            f" {beam.thickness_mm:.2f} | {beam.length_mm:.1f} | {shares} |"
        )


def main() -> None:
    """Build, slice and measure every pad."""
    slicer = shutil.which("prusa-slicer")
    if slicer is None:
        raise SystemExit("prusa-slicer is not installed; make slice installs it")
    print(
        "| pad, channel | suspension | width mm | thick mm | long mm | along it, % | behind its root | before its tip |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for spec in specs():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / spec.name
            pad = Pad(spec)
            pad.save(path, formats=["3mf"])
            gcode = path / "pad.gcode"
            command = [slicer, "--export-gcode", path / "pad.3mf", "--dont-arrange", "--output", gcode]
            subprocess.run(list(map(str, command)), capture_output=True, check=True)
            middle = np.array([spec.printer.bed_x_mm, spec.printer.bed_y_mm]) / 2
            for row in rows(pad.plan, read_gcode(gcode), middle):
                print(row, flush=True)


if __name__ == "__main__":
    main()
