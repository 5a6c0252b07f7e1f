"""Compare resonances of random taxels with ballast with finite elements of their STEP files.

    python docs/measure_ballast.py [first] [last]

Prints one row a taxel, and what share is within the stated error (docs/magnets.md). Taxels are drawn by their number:
suspension, mover, ballast from 0.1 to 2.5 g, material, plate and resonance.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import PadgenError
from padgen.make.solid_tuning import solid_taxel
from padgen.planner import make_plan
from padgen.planner.plan import Plan
from padgen.planner.suspensions import BeamShape, names
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.solid.formats.step import write_taxel_step
from padgen.spec import catalogue, make_spec

COUNT = 24
TOLERANCE = 0.01
"""Relative error to which finite elements solve the working mode."""
ALIKE = 0.6
"""Least share of a mode's motion in a mode of the other model that counts as the same."""
LIGHTEST_G = 0.1
HEAVIEST_G = 2.5
ROOF_MM = 0.4


class Compared(NamedTuple):
    """A taxel: the model's relative error and stated error of the working mode, and of all others that are found."""

    plan: Plan
    error: float
    stated: float
    others: tuple[tuple[float, float], ...]


def drawn(number: int) -> Plan:
    """Return the plan of the taxel of this number: one taxel over one coil."""
    random = np.random.default_rng([34, number])
    topology = names()[number % len(names())]
    while True:
        spec = make_spec_of(random, topology)
        try:
            return make_plan(spec)
        except PadgenError:
            continue


def make_spec_of(random: Any, topology: str) -> Any:
    """Return a random spec with ballast that a pad might have."""
    known = catalogue("ballast")
    while True:
        name = str(random.choice(list(known)))
        ballast = {**known[name], "name": name}
        ballast["height_mm"] = round(ballast["height_mm"] * float(random.uniform(0.7, 1.5)), 2)
        plate_mm = round(1.0 + ballast["height_mm"] + ROOF_MM + 0.3 * int(random.integers(0, 4)), 1)
        hz = float(np.exp(random.uniform(np.log(25), np.log(250))))
        mover = random.choice(["disc-2x1", "disc-3x1", "disc-4x1", "washer"])
        parts = {"washer": "iso7092-m1.6"} if mover == "washer" else {"magnet": str(mover), "coil": {"name": "air-10"}}
        table = {
            "name": "taxel",
            "resolution": 1,
            "band_hz": [hz * 0.8, hz * 1.25],
            "resonances_hz": [hz],
            "q_min": 15,
            "pad": {"width_mm": 14, "depth_mm": 14, "frame_thickness_mm": plate_mm},
            "taxel": {"plate_thickness_mm": plate_mm},
            "printer": {"name": "fdm-0.4", "longest_bridge_mm": 50},
            "material": str(random.choice(["pla", "petg", "pla"])),
            "ballast": ballast,
            "suspension": {"topology": topology},
            **parts,
        }
        try:
            spec = make_spec(table)
        except PadgenError:
            continue
        assert spec.ballast is not None
        if LIGHTEST_G <= spec.ballast.mass_g <= HEAVIEST_G:
            return spec


def compared(plan: Plan, path: Path) -> Compared:
    """Solve a taxel, whose STEP file is at `path`, by both models."""
    from padgen.verify.elasticity import converged_modes

    channel = plan.channels[0]
    solved = converged_modes(solid_taxel(plan, channel, path), TOLERANCE)
    beam = channel.beam
    shape = BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm)
    model = TaxelModel(plan.spec, beam.topology, plate_shape(plan.spec), shape)
    if channel.site.frame_depth_mm:
        model = replace(model, frame_depth_mm=max(channel.site.frame_depth_mm, plan.spec.pad.rib_mm / 2))
    own = np.concatenate([model.modes.at_point(model.washer_point_m), model.modes.shape[3:]])
    alike = np.linalg.solve(own, solved.modes.motion.T) ** 2
    alike /= alike.sum(0)
    working = int(model.working)
    others = []
    error = float("nan")
    for k in range(len(solved.modes.frequency_hz)):
        best = int(alike[:, k].argmax())
        if alike[best, k] > ALIKE:
            off = float(model.modes.frequency_hz[best] / solved.modes.frequency_hz[k] - 1)
            if best == working:
                error = off
            else:
                others.append((off, float(model.mode_errors[best])))
    return Compared(plan, error, float(channel.model_error), tuple(others))


def row(number: int, found: Compared) -> str:
    """Return a taxel as a row of a table."""
    plan = found.plan
    spec = plan.spec
    ballast = spec.ballast
    assert ballast is not None
    channel = plan.channels[0]
    beam = channel.beam
    size = f"{beam.width_mm:.2f} × {beam.thickness_mm:.2f} × {beam.length_mm:.2f}"
    others = ", ".join(f"{100 * off:+.1f} ({100 * stated:.1f})" for off, stated in found.others)
    return (
        f"| {number} | {beam.topology} | {spec.washer_or_magnet.name} | {ballast.name}, {ballast.height_mm:.2f} mm,"
        f" {ballast.mass_g:.2f} g | {size} | {channel.resonance_hz:.1f} | {100 * found.error:+.2f}"
        f" | {100 * found.stated:.2f} | {others} |"
    )


def main() -> None:
    """Print all rows, and the shares within the stated errors."""
    first = int(sys.argv[1]) if len(sys.argv) > 1 else 0
    last = int(sys.argv[2]) if len(sys.argv) > 2 else COUNT
    print("| | suspension | mover | ballast | beam w × t × l mm | f Hz | off % | stated % | others: off (stated) % |")
    print("|---|---|---|---|---|---|---|---|---|")
    all_found = []
    plans = {number: drawn(number) for number in range(first, last)}
    with tempfile.TemporaryDirectory() as folder:
        paths = {number: Path(folder) / f"taxel-{number}.step" for number in plans}
        # All files first: the elements bring a CAD kernel of their own, which the one that writes does not bear.
        for number, plan in plans.items():
            write_taxel_step(plan, plan.channels[0], paths[number])
        for number, plan in plans.items():
            found = compared(plan, paths[number])
            all_found.append(found)
            print(row(number, found), flush=True)
    errors = np.abs([f.error for f in all_found])
    stated = np.array([f.stated for f in all_found])
    print(f"working modes: {(errors <= stated).sum()} of {len(errors)} within the stated error")
    print(f"median error {100 * np.median(errors):.2f} %, median stated {100 * np.median(stated):.2f} %")
    others = np.array([pair for f in all_found for pair in f.others])
    within = (np.abs(others[:, 0]) <= others[:, 1]).sum()
    print(f"other modes: {within} of {len(others)} within the stated error")


if __name__ == "__main__":
    main()
