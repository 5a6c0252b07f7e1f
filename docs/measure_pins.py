"""Print the table of docs/contactor.md on pins: the beam model against finite elements of the STEP that is built.

python docs/measure_pins.py                  errors and stated errors of the set, by quantity and suspension
python docs/measure_pins.py --solve 0 24     solve the numbers 0 … 23 that the set does not have yet; may be stopped

Number i is drawn from the seed (SEED, i): suspension, printer, frame, guard plate, pin and its place on the first beam,
and a resonance, for which the planner sizes the taxel. Numbers below FITTED chose `PIN_ENDS`, `PIN_SPREAD` and the
stated errors; the others were solved after that.
"""

import argparse
import csv
import json
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from math import hypot, pi
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
import padgen as pg
from padgen.core.errors import PadgenError
from padgen.planner.plan import Channel, Plan
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import make_spec

SET = Path(__file__).parents[1] / "tests" / "reference" / "pins.csv"
SEED = 20261126
TOPOLOGIES = ("cantilever", "folded", "bridge")
PRINTERS = ("fdm-0.4", "fdm-0.25", "resin-0.05")
QUANTITIES = ("lever", "sway", "resonance_hz", "stiffness_n_per_m")
FITTED = 15
TRIES = 200
ORDER = 3


class PinSeat(NamedTuple):
    """Where the pin's top is on the solid, in mm: its axis, its height and the radius of its flat face."""

    x_mm: float
    y_mm: float
    top_mm: float
    radius_mm: float


def drawn(number: int) -> tuple[dict[str, Any], Plan]:
    """Return the fields of the spec of number i, and its plan."""
    rng = np.random.default_rng((SEED, number))
    topology = TOPOLOGIES[number // 2 % len(TOPOLOGIES)]
    for _ in range(TRIES):
        printer = str(rng.choice(PRINTERS))
        frame_mm = float(rng.choice([2.0, 2.4, 3.0, 4.0]))
        least_mm = {"fdm-0.4": 0.9, "fdm-0.25": 0.54, "resin-0.05": 0.5}[printer]
        band = {"cantilever": (30, 300), "folded": (40, 400), "bridge": (80, 600)}[topology]
        hz = round(float(np.exp(rng.uniform(*np.log(band)))), 1)
        fields = {
            "name": f"pin-{number}",
            "resolution": 1,
            "band_hz": [hz / 1.2, hz * 1.2],
            "resonances_hz": [hz],
            "q_min": 15,
            "printer": printer,
            "coil": {"grid": [1, 1]},
            "suspension": {"topology": topology},
            "pad": {
                "width_mm": round(rng.uniform(14, 26), 1),
                "depth_mm": round(rng.uniform(9, 16), 1),
                "frame_thickness_mm": frame_mm,
            },
            "taxel": {"plate_thickness_mm": frame_mm, "boss_protrusion_mm": float(rng.choice([0.4, 1.0]))},
            "contactor": {
                "place": round(rng.uniform(0.2, 0.85), 3),
                "diameter_mm": round(least_mm * rng.uniform(1, 2), 2),
            },
            **({"guard": {"thickness_mm": 1.0}} if rng.random() < 0.4 else {}),
        }
        try:
            return fields, pg.plan(fields)
        except PadgenError:
            continue
    raise SystemExit(f"number {number} cannot be planned")


def seat_of(plan: Plan, channel: Channel) -> PinSeat:
    pin = channel.pin
    return PinSeat(pin.x_mm, pin.y_mm, pin.top_mm, pin.diameter_mm / 2 - plan.plate.boss_edge_mm)


def step_of(plan: Plan, folder: Path) -> Any:
    """Write the STEP of the plan's taxel, and return the input of the finite elements."""
    from padgen.make.solid_tuning import solid_taxel
    from padgen.solid.formats.step import write_taxel_step

    channel = plan.channels[0]
    path = folder / f"{plan.name}.step"
    write_taxel_step(plan, channel, path)
    return solid_taxel(plan, channel, path)


def solved(taxel: Any, seat: PinSeat, order: int = ORDER) -> dict[str, float]:
    """Return lever, sway, resonance in Hz, stiffness in N/m at the pin and unknowns, in a process of its own.

    The push is spread over the flat top of the pin, whose mean motion is what counts.
    """
    from padgen.verify import elasticity as el
    from padgen.verify import ng

    draft = el._drafted(taxel)
    tops = []
    for face in draft.shape.faces:
        low, high = (np.array(el._xyz(corner)) for corner in face.bounding_box)
        flat = abs(low[2] - seat.top_mm) < 1e-4 and abs(high[2] - seat.top_mm) < 1e-4
        middle = (low + high) / 2
        if flat and hypot(middle[0] - seat.x_mm, middle[1] - seat.y_mm) < 1e-3:
            face.name = "top"
            tops.append(face.mass)
    assert len(tops) == 1, tops
    assert abs(tops[0] / (pi * seat.radius_mm**2) - 1) < 1e-3, tops
    setting = el.FineSetting(order, 2)
    mesh = el._layered(taxel, draft, setting)
    answer = el._answered(taxel, draft, mesh, order, 6)
    system = answer.system
    loads = answer.loads
    eigen = answer.eigen
    v = system.space.TestFunction()
    area = ng.Integrate(1.0, mesh.Boundaries("top"))
    means = np.array(
        [
            ng.LinearForm(v[axis] / area * ng.ds(definedon=mesh.Boundaries("top"))).Assemble().vec.FV().NumPy()
            for axis in range(3)
        ]
    )
    working = el._result(answer, setting).modes.working
    top = means @ eigen.shape[:, working]
    mover = loads[:, 2] @ eigen.shape[:, working]
    pushed = el.factored(system)(means[2])
    return {
        "lever": float(top[2] / mover),
        "sway": float(hypot(top[0], top[1]) / abs(mover)),
        "resonance_hz": float(eigen.frequency_hz[working]),
        "stiffness_n_per_m": float(1 / (means[2] @ pushed)),
        "unknowns": float(system.free.sum()),
    }


def rows_of(path: Path = SET) -> list[dict[str, Any]]:
    """Return the rows of the set: number, fields of the spec, and what was solved."""
    if not path.exists():
        return []
    with open(path, newline="") as lines:
        return [
            {key: json.loads(value) if key in ("number", "fields") else float(value) for key, value in row.items()}
            for row in csv.DictReader(lines)
        ]


def solve(first: int, last: int, path: Path) -> None:
    """Add the solutions of the numbers from `first` to before `last` to the set."""
    known = {row["number"] for row in rows_of(path)}
    for number in range(first, last):
        if number in known:
            continue
        fields, plan = drawn(number)
        start = time.time()
        with (
            tempfile.TemporaryDirectory() as folder,
            ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool,
        ):
            taxel = step_of(plan, Path(folder))
            try:
                answer = pool.submit(solved, taxel, seat_of(plan, plan.channels[0])).result()
            except PadgenError as error:
                print(number, error, flush=True)
                continue
        beam = plan.channels[0].beam
        sizes = {"width_mm": beam.width_mm, "thickness_mm": beam.thickness_mm, "length_mm": beam.length_mm}
        row = {"number": number, "fields": json.dumps(fields), **sizes, **answer}
        new = not path.exists()
        with open(path, "a", newline="") as file:
            writer = csv.DictWriter(file, list(row), lineterminator="\n")
            if new:
                writer.writeheader()
            writer.writerow(row)
        print(number, f"{time.time() - start:.0f} s", compared(row | {"fields": fields}), flush=True)


def compared(row: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Return the relative error of the beam model and the one that it states, for each quantity of a row."""
    spec = make_spec(row["fields"])
    beam = BeamShape(row["width_mm"], row["thickness_mm"], row["length_mm"])
    model = TaxelModel(spec, spec.suspension.topology, plate_shape(spec), beam)
    moved = model.contact
    lever_error, stiffness_error = model.contact_errors
    # A sideways motion is compared with the whole motion of the pin.
    whole = hypot(row["lever"], row["sway"])
    return {
        "lever": (moved.lever / row["lever"] - 1, lever_error),
        "sway": ((moved.sway - row["sway"]) / whole, lever_error),
        "resonance_hz": (float(model.resonance_hz) / row["resonance_hz"] - 1, float(model.error_estimate)),
        "stiffness_n_per_m": (moved.stiffness / row["stiffness_n_per_m"] - 1, stiffness_error),
    }


def report(path: Path) -> None:
    rows = rows_of(path)
    print("| set | quantity | within stated | true median, largest % | stated median % | stated over true |")
    print("|---|---|---|---|---|---|")
    for title, chosen in (
        ("fitted", [row for row in rows if row["number"] < FITTED]),
        ("fresh", [row for row in rows if row["number"] >= FITTED]),
        ("all", rows),
    ):
        pairs = [compared(row) for row in chosen]
        if not pairs:
            continue
        for quantity in QUANTITIES:
            error = np.abs([pair[quantity][0] for pair in pairs])
            stated = np.array([pair[quantity][1] for pair in pairs])
            print(
                f"| {title}, {len(pairs)} | {quantity} | {100 * (error <= stated).mean():.0f} % |"
                f" {100 * np.median(error):.2f}, {100 * error.max():.1f} | {100 * np.median(stated):.2f} |"
                f" {np.median(stated) / np.median(error):.1f} |"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--solve", nargs=2, type=int, metavar=("FIRST", "LAST"))
    parser.add_argument("--set", type=Path, default=SET, help="file of the set")
    asked = parser.parse_args()
    if asked.solve:
        first, last = asked.solve
        solve(first, last, asked.set)
    report(asked.set)


if __name__ == "__main__":
    main()
