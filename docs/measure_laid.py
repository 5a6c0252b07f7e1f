"""Slice pads drawn at random and read what is laid: `python docs/measure_laid.py [PADS] [FIRST]`.

Nozzles of 0.25 to 0.6 mm, washers from M1.6 to M3, all suspensions, with PrusaSlicer and padgen's own profile. Prints a
line for each pad: room beyond the washer, narrowest gap over the planned one, beams' widths, plastic of the plates.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import subprocess
import sys
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.core.errors import PadgenError
from padgen.make.pad import Pad
from padgen.sliced.judge_laid import check_gcode
from padgen.spec import Spec, parse_spec

PADS = 100


def drawn(number: int) -> Spec:
    """Draw spec `number`; raises `PadgenError` where there is none."""
    random = Random(number)
    nozzle = random.choice((0.25, 0.3, 0.4, 0.4, 0.5, 0.6))
    washer = random.choice(("m1.6", "m1.6", "m2", "m2.5", "m3"))
    side = random.choice((30, 40, 50))
    taxels = random.choice((4, 6, 8, 12, 16))
    low = random.choice((50, 80, 120))
    text = f"""
name = "drawn"
resolution = {taxels}
band_hz = [{low}, {low * random.choice((3, 4, 5))}]
q_min = 15
delta_y = {random.choice((3, 5, 10))}
printer = {{ name = "own", nozzle_mm = {nozzle} }}
washer = "iso7092-{washer}"
pad = {{ width_mm = {side}, depth_mm = {side} }}
"""
    if random.random() < 0.4:
        text += f'suspension = "{random.choice(("bridge", "cantilever", "folded", "serpentine-3"))}"\n'
    return parse_spec(text)


def laid(pad: Pad, folder: Path) -> str:
    """Slice a pad and return what is laid, in words."""
    pad.save(folder, ("stl",))
    gcode = folder / "pad.gcode"
    command = ["prusa-slicer", "--export-gcode", "--load", "pad.ini", "pad.stl", "-o", gcode.name]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=600)
    plan = pad.plan
    report = check_gcode(plan, gcode)
    taxels = report.figures["taxels"]
    washer_mm = plan.spec.washer_or_magnet.outer_diameter_mm
    room_mm = min(taxel["recess_room_mm"] for taxel in taxels) - washer_mm
    gap = min(taxel["gap_mm"] or 0.0 for taxel in taxels) / plan.plate.gap_mm
    wider_mm = [
        width_mm - plan.channels[taxel["channel"]].beam.width_mm
        for taxel in taxels
        for beam in taxel["beams"]
        for width_mm in beam["width_mm"]
    ]
    heavier = [100 * (taxel["plate_mg"] / taxel["planned_plate_mg"] - 1) for taxel in taxels]
    told = ", ".join(dict.fromkeys(finding.code for finding in report.findings)) or "as planned"
    return (
        f"room {room_mm:.3f} mm, gap {gap:.0%}, widths {min(wider_mm):+.3f} … {max(wider_mm):+.3f} mm,"
        f" plates {min(heavier):+.2f} … {max(heavier):+.2f} %: {told}"
    )


def main(pads: int, first: int) -> None:
    """Slice so many pads."""
    for number in range(first, first + pads):
        try:
            pad = Pad(drawn(number))
            with TemporaryDirectory() as folder:
                said = laid(pad, Path(folder))
        except PadgenError:
            continue  # there is no such pad
        printer = pad.plan.spec.printer
        kinds = ", ".join(dict.fromkeys(channel.beam.topology for channel in pad.plan.channels))
        print(f"{number}: {printer.nozzle_mm} mm, {pad.plan.spec.washer_or_magnet.name}, {kinds}: {said}", flush=True)


if __name__ == "__main__":
    asked = [int(word) for word in sys.argv[1:]]
    main(*[*asked, *(PADS, 0)[len(asked) :]])
