"""Print the tables of docs/magnets.md: all, or some of air, core, image, space, pairs, times, heat, pads, most.

`air` and `core` are 300 random magnets each, without and with a core; `space` a dozen over cores off the axis and in
pairs, by elements in space. Half an hour of one core in all. Needs padgen[dev] and padgen[study].
"""

import sys
import time
from itertools import product
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.core.errors import PadgenError
from padgen.core.units import COPPER_OHM_M, MM, UM
from padgen.physics.magnet_pull import magnet_pull, rest_on_spring, shared_core
from padgen.physics.magnetics import solenoid
from padgen.physics.magnets import (
    DiscMagnet,
    demagnetising_factor,
    dipole_stiffness,
    eddy_damping,
    face_factor,
    margin_temperature,
    neighbour_pull,
    working_polarisation,
)
from padgen.planner import make_plan
from padgen.spec import make_spec
from padgen.spec.load import catalogue
from tests.magnet_oracles import (
    Case,
    coaxial_core_pull,
    core_pull_by_elements,
    force_by_elements,
    force_on_turns,
    magnets_force,
    random_cases,
)

COUNT = 300
AIR = solenoid(10 * MM, 4 * MM, 10 * MM, 1000)
CORE = solenoid(10 * MM, 4 * MM, 10 * MM, 1000, 4 * MM, 1000)
SIZES = ((2, 1), (3, 1), (3, 2))
SHARES = ("median %", "99 %", "worst %")


def row(*cells: object) -> None:
    print("| " + " | ".join(f"{c:.3g}" if isinstance(c, float) else str(c) for c in cells) + " |", flush=True)


def head(title: str, *cells: str) -> None:
    print(f"\n## {title}\n")
    row(*cells)
    row(*("---" for _ in cells))


def spread(name: str, shares: list[float]) -> None:
    """Print a row of the median, the 99th percentile and the largest of shares, in per cent."""
    row(name, len(shares), *(100 * float(np.quantile(shares, q)) for q in (0.5, 0.99, 1.0)))


def air() -> None:
    """Compare with magpylib, by so many points that its force has converged, and by half as many."""
    off: dict[str, list[float]] = {name: [] for name in ("oracle", "force", "side", "moment", "slope", "stated")}
    uncovered = 0
    for case in random_cases(COUNT, 1, core=False):
        step = 0.01 * case.gap
        exact = force_on_turns(case, 2)
        slope = np.subtract(*(force_on_turns(case._replace(gap=case.gap + d), 2)[0] for d in (step, -step)))
        pull = magnet_pull(case.coil, case.magnet, case.gap, np.array([case.offset, 0.0]))
        on_axis = abs(pull.force[1])
        off["oracle"].append(float(np.abs(force_on_turns(case) - exact)[0] / on_axis))
        off["force"].append(abs(pull.force[0] - exact[0]) / on_axis)
        off["side"].append(abs(pull.side[0] - exact[1]) / on_axis)
        off["moment"].append(abs(pull.moment[0] - exact[2]) / (on_axis * case.magnet.outer_diameter))
        off["slope"].append(abs(pull.slope[0] - slope / (2 * step)) / abs(pull.slope[1]))
        off["stated"].append(pull.error[0] / on_axis)
        uncovered += abs(pull.force[0] - exact[0]) > pull.error[0] + 1e-4 * on_axis
    head("Without a core, against magpylib", "share of that on the axis", "n", *SHARES)
    names = {
        "oracle": "magpylib's own, by fewer points",
        "force": "force per ampere",
        "side": "side force",
        "moment": "moment (over force on the axis times diameter)",
        "slope": "slope with the gap",
        "stated": "stated error of the force",
    }
    for name, label in names.items():
        spread(label, off[name])
    print(f"\nOff by more than stated and 0.01 %: {uncovered} of {COUNT}.")


def core() -> None:
    """Compare the force per ampere of coils with a core with elements in the half plane."""
    off: dict[str, list[float]] = {name: [] for name in ("force", "side", "slope", "stated")}
    for case in random_cases(COUNT, 2, core=True):
        step = 0.05 * case.gap
        exact, near, far = force_by_elements(case, step)
        pull = magnet_pull(case.coil, case.magnet, case.gap, np.array([case.offset, 0.0]))
        on_axis = abs(pull.force[1])
        off["force"].append(abs(pull.force[0] - exact[0]) / on_axis)
        off["side"].append(abs(pull.side[0] - exact[1]) / on_axis)
        steep = max(abs(pull.slope[1]), 2 * on_axis / case.coil.outer_diameter)  # where the force is largest, it is 0
        off["slope"].append(abs(pull.slope[0] - (far[0] - near[0]) / (2 * step)) / steep)
        off["stated"].append(pull.error[0] / on_axis)
    head("With a core, against elements in the half plane", "share of that on the axis", "n", *SHARES)
    names = {
        "force": "force per ampere",
        "side": "side force",
        "slope": "slope (or of force over radius)",
        "stated": "stated error",
    }
    for name, label in names.items():
        spread(label, off[name])
    print(f"\nOff by more than stated: {sum(np.greater(off['force'], off['stated']))}, by more than 2 %:", end=" ")
    print(f"{sum(np.greater(off['force'], 0.02))} of {COUNT}.")


def image() -> None:
    """Compare the core's pull on the axis with elements in the half plane, where their two forces agree within 3 %."""
    off: dict[str, list[float]] = {name: [] for name in ("pull", "elements", "stated")}
    for case in random_cases(COUNT, 2, core=True)[::3]:
        work, stress = coaxial_core_pull(case)
        pull = magnet_pull(case.coil, case.magnet, case.gap, 0.0)
        if (doubt := abs(work - stress) / work) < 0.03:
            off["pull"].append(abs(pull.core_pull[0] / work - 1))
            off["elements"].append(doubt)
            off["stated"].append(pull.core_error[0] / pull.core_pull[0])
    head("Core's pull on the axis, against elements in the half plane", "share of it", "n", *SHARES)
    for name, label in {"pull": "pull", "elements": "virtual work and stress", "stated": "stated error"}.items():
        spread(label, off[name])
    within = np.less_equal(off["pull"], np.add(off["elements"], off["stated"])).sum()
    print(f"\nWithin the stated error and the elements' own: {within} of {len(off['pull'])}.")


def space() -> None:
    """Compare with elements in space: the core's pull off the axis, and two magnets over one core."""
    cells = ("gap, offset mm", "pull mN", "elements", "side mN", "elements", "moment µN·m", "elements", "CPU s")
    head("Core's pull off the axis, against elements in space", "magnet mm", *cells)
    rng = np.random.default_rng(3)
    for wide, hole, high in ((2, 0, 1), (3, 0, 1), (3, 0, 2), (4, 1.5, 1), (5, 0, 2), (6, 0, 2)):
        magnet = DiscMagnet(wide * MM, hole * MM, high * MM, 1.25)
        case = Case(CORE, magnet, rng.uniform(0.5, 1.5) * MM, rng.uniform(0.5, 4) * MM)
        start = time.process_time()
        side, _, axial, _, moment, _ = core_pull_by_elements(case, [])[0]
        spent = time.process_time() - start
        pull = magnet_pull(CORE, magnet, case.gap, case.offset)
        place = f"{case.gap / MM:.2f}, {case.offset / MM:.2f}"
        pairs = ((pull.core_pull[0], -axial), (pull.core_side[0], side), (1e3 * pull.core_moment[0], 1e3 * moment))
        row(
            f"{wide} × {high}" + (f", bore {hole}" if hole else ""),
            place,
            *(1e3 * float(v) for p in pairs for v in p),
            spent,
        )
    head("Two magnets of 3 × 1 mm over one core, 1 mm above it", "from the axis mm", "pull mN", "elements", "alone mN")
    disc = DiscMagnet(3 * MM, 0.0, 1 * MM, 1.2)
    for offset in (1.8, 2.2, 3.1):
        case = Case(CORE, disc, 1 * MM, offset * MM)
        axial = core_pull_by_elements(case, [(-offset * MM, 0.0)])[0][2]
        places = np.array([[offset, 0.0], [-offset, 0.0]]) * MM
        pull = shared_core(CORE, disc, np.full(2, case.gap), places, np.ones(2)).force[0]
        alone = magnet_pull(CORE, disc, case.gap, case.offset).core_pull[0]
        row(offset, 1e3 * float(pull), -1e3 * float(axial), 1e3 * float(alone))


def pairs() -> None:
    """Print forces, stiffness of neighbours, and springs that hold magnets over a core."""
    head(
        "N/A and the core's pull, 1.2 T, 1 mm above the catalogue's coil",
        "magnet mm",
        "core",
        *(f"{d} mm off" for d in (0, 2, 3.1, 4.4)),
    )
    offset = np.array([0, 2, 3.1, 4.4]) * MM
    for wide, high in SIZES:
        magnet = DiscMagnet(wide * MM, 0.0, high * MM, 1.2)
        for name, coil in (("none", AIR), ("µr 1000", CORE)):
            row(f"{wide} × {high}", f"{name}, N/A", *map(float, magnet_pull(coil, magnet, 1 * MM, offset).force))
        pull = magnet_pull(CORE, magnet, 1 * MM, offset)
        row("", "its pull, mN", *map(float, 1e3 * pull.core_pull))
        row("", "its stiffness, N/m", *map(float, pull.core_stiffness))
        rest = rest_on_spring(CORE, magnet, np.full(4, 1 * MM), offset, np.full(4, 1e5))
        row("", "spring that holds, N/m", *map(float, rest.least_stiffness))
    head(
        "Stiffness of two neighbours in N/m, 1.2 T, one polarity",
        "magnet mm",
        "apart mm",
        "this",
        "magpylib",
        "dipoles",
        "push mN",
    )
    for wide, high in SIZES:
        magnet = DiscMagnet(wide * MM, 0.0, high * MM, 1.2)
        for apart in (1.1 * wide, 6.25, 8.8):
            places = np.array([[0, 0], [apart * MM, 0]])
            coupling = neighbour_pull(magnet, places, np.ones(2))
            step = 0.01 * MM
            by = np.subtract(*(magnets_force(magnet, np.array([apart * MM, 0, d]), 2)[2] for d in (-step, step)))
            dipoles = float(dipole_stiffness(magnet.moment, apart * MM))
            cells = (
                float(coupling.stiffness[0, 0]),
                float(by / (2 * step)),
                dipoles,
                1e3 * float(coupling.force[1, 0]),
            )
            row(f"{wide} × {high}", apart, *cells)


def times() -> None:
    """Print processor times: the best of five, with nothing kept from before and again."""
    head("Milliseconds of one core a taxel", "core", "gap mm", "taxels", "nothing kept", "again")
    rng = np.random.default_rng(0)
    for name, coil in (("none", AIR), ("µr 1000", CORE)):
        for gap in (0.5, 1.0, 2.0):
            for count in (32, 256):
                offset = rng.uniform(0, 6, count) * MM
                gaps = gap * MM * rng.uniform(1, 1.1, count)
                first: list[float] = []
                again: list[float] = []
                for turn in range(5):
                    magnet = DiscMagnet(3 * MM, 0.0, 1 * MM, 1.2 + 1e-3 * turn)
                    for kept in (first, again):
                        start = time.process_time()
                        magnet_pull(coil, magnet, gaps, offset)
                        kept.append(1e3 * (time.process_time() - start) / count)
                row(name, gap, count, min(first), min(again))


def heat() -> None:
    """Print what limits the catalogue's magnets: working polarisation, temperatures, and eddy currents in a board."""
    cells = (
        "N",
        "N at the face",
        "J T",
        "first points from °C",
        "mean from °C",
        "N·s/m over 35 µm of copper, 0.5 mm below",
    )
    head("Magnets of the catalogue", "magnet", "grade", "mg", *cells)
    grades = catalogue("magnet_grade")
    for name, part in catalogue("magnet").items():
        for grade in ("n35", "n45", "n52") if name == "disc-3x1" else (part["grade"],):
            material = grades[grade]
            wide, hole, high = (part[key] * MM for key in ("outer_diameter_mm", "inner_diameter_mm", "thickness_mm"))
            shape = DiscMagnet(wide, hole, high, 1.0)
            mean = demagnetising_factor(shape)
            remanence = (material["remanence_low_t"] + material["remanence_high_t"]) / 2
            magnet = shape._replace(polarisation=working_polarisation(remanence, material["recoil_permeability"], mean))
            changes = material["remanence_per_k"], material["coercivity_per_k"]
            factors = face_factor(magnet), mean
            limits = [
                margin_temperature(magnet.polarisation, 1e3 * material["coercivity_ka_per_m"], factor, changes)
                for factor in factors
            ]
            mass = 1e9 * material["density_g_per_cm3"] * magnet.volume
            damping = eddy_damping(magnet, 0.5 * MM, 35 * UM, COPPER_OHM_M)
            row(name, grade, mass, mean, factors[0], magnet.polarisation, *limits, damping)


def pads() -> None:
    """Print the same jobs planned with washers and with magnets, the search free; plans take a second each."""
    head(
        "job",
        "mover",
        "coils",
        "channels a coil",
        "heat W",
        "peak V",
        "idle W",
        "kept dB",
        "prints",
        "outputs",
        "CPU s",
    )
    movers: dict[str, dict[str, object]] = {
        "washer M1.6": {},
        **{name: {"magnet": name, "coil": "air-10"} for name in ("disc-2x1", "disc-3x1", "disc-3x2")},
    }
    make_plan(make_spec({"name": "warm-up", **JOBS["32 taxels, 50–200 Hz"]}))
    for job, fields in JOBS.items():
        for mover, parts in movers.items():
            started = time.process_time()
            plan = make_plan(make_spec({"name": "job", **fields, **parts}))
            seconds = time.process_time() - started
            coils = plan.coils.rows * plan.coils.columns
            load = plan.load
            watts = plan.heat_w
            kept_db = plan.prints.print_db
            share = plan.prints.good_share
            coupling = "DC" if plan.scheme.has_constant else "AC or DC"
            channels = len(plan.channels) // plan.coils.sets
            idle = load.idle_w * coils
            row(job, mover, coils, channels, watts, load.voltage_peak_v, idle, kept_db, share, coupling, seconds)


JOBS: dict[str, dict[str, object]] = {
    "32 taxels, 50–200 Hz": {"resolution": 32, "band_hz": [50, 200], "q_min": 15, "delta_y": 5},
    "32 taxels, 80–320 Hz": {"resolution": 32, "band_hz": [80, 320], "q_min": 15, "delta_y": 5},
    "32 taxels, 100–500 Hz": {"resolution": 32, "band_hz": [100, 500], "q_min": 15, "delta_y": 5},
    "48 taxels, 100–500 Hz, 75 × 75 mm": {
        "resolution": 48,
        "band_hz": [100, 500],
        "q_min": 15,
        "delta_y": 5,
        "pad": {"width_mm": 75, "depth_mm": 75},
    },
}
"""Jobs that washers and magnets are compared by; 5 is 14 dB."""


def most() -> None:
    """Print, by how many channels there are, the one-coil pad whose prints keep most, of 48 tried."""
    head(
        "Most channels over one coil",
        "channels",
        "mover",
        "pad mm",
        "coil mm",
        "core mm",
        "band from Hz",
        "drive",
        "heat W",
        "kept dB",
        "prints",
    )
    for channels, mover in product(range(4, 8), ("disc-2x1", "washer M1.6")):
        found = []
        for side_mm, share, low_hz, core_mm in product((50, 54, 58, 66), (0.75, 0.83, 0.9), (50, 80), (0, 4)):
            coil = wide_coil(round(side_mm * share, 1), core_mm)
            parts = {} if mover.startswith("washer") else {"magnet": mover}
            fields = {"band_hz": [low_hz, 1000], "q_min": 15, "delta_y": 5, "spacing": "optimised"}
            sides = {"width_mm": side_mm, "depth_mm": side_mm}
            try:
                plan = make_plan(
                    make_spec({"name": "most", "resolution": channels, "pad": sides, "coil": coil, **fields, **parts})
                )
            except PadgenError:
                continue
            found.append((plan.prints.good_share, plan.prints.print_db or 0.0, (side_mm, coil, low_hz), plan))
        if not found:
            row(channels, mover, *["none"] * 8)
            continue
        share, kept_db, (side_mm, coil, low_hz), plan = max(found, key=lambda one: one[:2])
        watts = plan.load.copper_loss_w
        sizes = (coil["outer_diameter_mm"], coil["core_diameter_mm"])
        row(channels, mover, side_mm, *sizes, low_hz, plan.selectivity.drive, watts, kept_db, share)


def wide_coil(outer_mm: float, core_mm: float) -> dict[str, object]:
    """Return a coil of 600 turns that fill a third of its winding, 0.3 of its diameter high and open inside."""
    inner_mm = 0.3 * outer_mm
    wire_m2 = 0.35 * (outer_mm - inner_mm) / 2 * inner_mm * MM**2 / TURNS
    length_m = np.pi * (outer_mm + inner_mm) / 2 * MM * TURNS
    # Of the template's coil, as the square of the turns and the diameter; a core gives some three times as much.
    inductance_mh = 6.4 * outer_mm / 44 * (3 if core_mm else 1)
    return {
        "name": "wide",
        "source": "computed",
        "outer_diameter_mm": outer_mm,
        "inner_diameter_mm": inner_mm,
        "length_mm": inner_mm,
        "turns": TURNS,
        "resistance_ohm": float(COPPER_OHM_M * length_m / wire_m2),
        "inductance_mh": inductance_mh,
        "core_diameter_mm": core_mm,
        "core_relative_permeability": 1000 if core_mm else 1,
        "gap_mm": 1,
        "grid": [1, 1],
    }


TURNS = 600


if __name__ == "__main__":
    parts = {
        "air": air,
        "core": core,
        "image": image,
        "space": space,
        "pairs": pairs,
        "times": times,
        "heat": heat,
        "pads": pads,
        "most": most,
    }
    for part in sys.argv[1:] or parts:
        parts[part]()
