"""Print the tables of docs/accuracy.md on taxels drawn at random; `--solve` adds solved ones to the set.

python docs/measure_campaign.py                the beam model's errors and the errors that it states, by stratum
python docs/measure_campaign.py --solve 600    solve numbers 0 … 599 that the set does not have yet; may be stopped
python docs/measure_campaign.py --check 7 19   solve those numbers again by finer elements

Number i is drawn from the seed (SEED, i): half of the taxels are sized by the planner from a random spec, half have
random dimensions from all that a spec allows. Every third is held out of all fits. Numbers from 1000 on are
serpentines (`--solve 1060 --share 1000 1`); those from 1070 on were solved after the last fit. Numbers from 2000 on
(`--solve 2336 --share 2000 1`, into a file of their own) are drawn evenly from cells of topology, width over thickness
and length over width, with Poisson's ratio 0.3-0.45. Numbers from 5000 on (`--solve 5760 --share 5000 1`, into a third
file) are drawn in the same way, serpentines too, from the seed FRESH_SEED, after formulas were fixed; those
from 5440 on were solved to judge the errors that are stated now.
"""

import argparse
import csv
import sys
import tempfile
import time
from dataclasses import replace
from itertools import product
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.core.cache import version
from padgen.core.errors import PadgenError, SolverError
from padgen.core.runner import Runner
from padgen.core.units import G_PER_CM3, GPA, GRAM, UM
from padgen.planner.layout import Outline, outline
from padgen.planner.make import choose
from padgen.planner.plan import Cell, Plate
from padgen.planner.search import sites_of
from padgen.planner.suspensions import BeamShape, Room, suspension
from padgen.planner.taxel_model import TaxelModel, fillet_mm, plate_shape, post_diameter_mm, recess_mm
from padgen.spec import Spec, catalogue, make_spec
from padgen.verify.elasticity import Elastic, layered

SET = Path(__file__).parents[1] / "tests" / "reference" / "taxel_campaign.csv"
CELL_SET = SET.with_name("taxel_cells.csv")
FRESH_SET = SET.with_name("taxel_fresh.csv")
SEED = 20261122
THIRD = 3
MODES = 6
TIME_S = 900
MOST_MB = 3000
TRIES = 60
TOPOLOGIES = ("cantilever", "folded", "bridge")
BENT = ("serpentine-3", "serpentine-5", "serpentine-7")
BENT_FROM = 1000
LATER_FROM = 1070
"""First numbers of taxels on bent beams, and of those that no choice was made on."""
CELLS_FROM = 2000
"""First number of the taxels that are drawn by cells."""
FRESH_FROM = 5000
"""First number of those that were drawn after formulas were fixed."""
UNSEEN_FROM = 5440
"""First number of those that stated errors are judged by."""
FRESH_SEED = 20261127
WIDE = (0.3, 1.0, 4.0, 12.0, 30.0)
"""Bounds of the cells' width over thickness."""
LONG = (0.25, 1.0, 3.0, 10.0, 60.0)
"""Bounds of the cells' length over width."""
PLANES = len(WIDE) - 1
"""Number of ranges of either proportion."""
LEAST_POISSON = 0.3
MOST_POISSON = 0.45
CELL_TRIES = 400
LONGEST_MM = 40.0
MOST_ACROSS = 4.0
"""Largest length in mm of a serpentine's leg where dimensions are drawn directly."""
# Modulus in GPa, Poisson's ratio, density in g/cm³.
POLYMERS = {
    "pla": ("fdm", 3.0, 0.36, 1.24),
    "petg": ("fdm", 2.0, 0.38, 1.27),
    "abs": ("fdm", 2.1, 0.37, 1.05),
    "tpu": ("fdm", 0.06, 0.45, 1.21),
    "resin": ("resin", 2.2, 0.40, 1.18),
}
# ISO washers begin at M1.6.
SMALLEST = {"outer_diameter_mm": 2.5, "inner_diameter_mm": 1.1, "thickness_mm": 0.3}
WASHERS = ["m1", *(name for name in catalogue("washer") if not name.endswith(("-a2", "-410")))]

NUMBERS = {
    "width_mm": None,
    "thickness_mm": None,
    "length_mm": None,
    "plate_length_mm": "taxel",
    "plate_width_mm": "taxel",
    "plate_thickness_mm": "taxel",
    "boss_diameter_mm": "taxel",
    "boss_protrusion_mm": "taxel",
    "boss_edge_mm": "taxel",
    "fillet_mm": "taxel",
    "glue_mg": "taxel",
    "frame_thickness_mm": "pad",
    "rib_mm": "pad",
    "line_width_mm": "printer",
    "layer_mm": "printer",
    "first_layer_mm": "printer",
    "smallest_gap_mm": "printer",
    "outer_diameter_mm": "washer",
    "inner_diameter_mm": "washer",
    "washer_thickness_mm": "washer",
    "youngs_modulus_gpa": "material",
    "poisson_ratio": "material",
    "density_g_per_cm3": "material",
    "cross_layer_ratio": "material",
}
"""Columns of numbers that define a taxel, with the table of the spec that holds each."""
OUTLINE = ("x0_mm", "x1_mm", "y0_mm", "y1_mm")
TEXTS = ("number", "drawn", "topology", "process", "polymer", "centre_post")
"""Columns of text; `drawn` is 'planned' (by the planner) or 'direct'."""
AXES = ("x", "y", "z", "rx", "ry", "rz")
FOUND = ("unknowns", "seconds", "working")
SOLVED = (
    *FOUND,
    *(f"hz_{k}" for k in range(MODES)),
    *(f"change_{k}" for k in range(MODES)),
    *(f"{axis}_{k}" for k in range(MODES) for axis in AXES),
)
STATIC = ("sag_um", "compliance_m_per_n", "stress_pa_per_m")
COLUMNS = (*TEXTS, *NUMBERS, *OUTLINE, *SOLVED)

Row = dict[str, Any]


def rows_of(path: Path = SET) -> list[Row]:
    """Read the taxels of the set, with numbers as floats."""
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return [
        {key: value if key in TEXTS[1:] else float(value) for key, value in row.items()}
        for row in csv.DictReader(lines)
    ]


ADDED = 0.15
MOST_ADDED = 2e-3
"""Share of the change from order 2 to 3 by which higher orders still lower a frequency, and its maximum.

Order 4 lowered it by 0.02 to 0.42 % on ten of the taxels.
"""


def true_hz(row: Row) -> np.ndarray:
    """Return extrapolated frequencies (6,) in Hz, the working mode's good to 0.25 %."""
    hz, change = (np.array([row[f"{name}_{k}"] for k in range(MODES)]) for name in ("hz", "change"))
    return np.asarray(hz * (1 - np.minimum(ADDED * np.abs(change), MOST_ADDED)))


def held_out(row: Row) -> bool:
    """Return whether a taxel is held out of all fits."""
    return int(row["number"]) % THIRD == 0


def table_of(row: Row) -> dict[str, Any]:
    """Return the spec of one taxel of the set as a table."""
    tables: dict[str, Any] = {
        "name": "set",
        "resolution": 1,
        "band_hz": [0.1, 1_000_000],
        "q_min": 15,
        "pad": {"border_mm": 20},
        # As when the set was drawn, before plans counted how beams are laid.
        "taxel": {"centre_post": row["centre_post"] == "yes", "washer_clearance_mm": 0.2},
        "printer": {
            "name": "fdm-0.25" if row["process"] == "fdm" else "resin-0.05",
            "nozzle_mm": 0.5,  # for every layer of the set
            "longest_bridge_mm": 50,
            "smallest_beam_mm": 0.05,
            "shortest_beam_mm": 0.0,
        },
        "washer": {"name": "iso7089-m2"},
        "material": {"name": "pla" if row["process"] == "fdm" else "tough-resin"},
    }
    for name, where in NUMBERS.items():
        if where:
            tables[where][name.removeprefix("washer_")] = row[name]
    return tables


def spec_of(row: Row) -> Spec:
    return make_spec(table_of(row))


def model_of(row: Row) -> TaxelModel:
    """Return the beam model of one taxel of the set."""
    spec = spec_of(row)
    return TaxelModel(spec, row["topology"], plate_shape(spec), beam_of(row))


def beam_of(row: Row) -> BeamShape:
    return BeamShape(row["width_mm"], row["thickness_mm"], row["length_mm"])


def is_deep(row: Row) -> bool:
    """Return whether the frame behind a root is much deeper than half a rib, the depth that the beam model assumes."""
    length = float(model_of(row).arrangement.window_mm[0])
    depth = max(-row["x0_mm"], row["x1_mm"] - length if row["topology"] == "bridge" else 0.0)
    return bool(depth > 0.75 * row["rib_mm"])


class Compared(NamedTuple):
    """One mode of one taxel: the beam model's relative error, the error that it states, and the frequency ratio."""

    row: Row
    working: bool
    error: float
    stated: float
    ratio: float
    """Its frequency over the working mode's."""


def compared(row: Row, frame_depth_mm: float | None = None) -> list[Compared]:
    """Compare the beam model's modes with the modes of 3-D elasticity that move the washer in the same way.

    `frame_depth_mm` is the depth of the frame in the beam model (None: half a rib).
    """
    model = replace(model_of(row), frame_depth_mm=frame_depth_mm)
    motion = np.array([[row[f"{axis}_{k}"] for axis in AXES] for k in range(MODES)])
    own = np.concatenate([model.modes.at_point(model.washer_point_m), model.modes.shape[3:]])
    alike = np.linalg.solve(own, motion.T) ** 2
    alike /= alike.sum(0)
    hz = true_hz(row)
    found = []
    for k in range(MODES):
        best = int(alike[k].argmax())
        if alike[k, best] > ALIKE:
            error = float(model.modes.frequency_hz[k] / hz[best] - 1)
            ratio = float(hz[best] / hz[int(row["working"])])
            found.append(Compared(row, k == int(model.working), error, float(model.mode_errors[k]), ratio))
    return found


ALIKE = 0.6
"""Least share of a mode's motion in a mode that counts as the same."""
NEAR = 10.0
"""Largest ratio to the working mode at which other modes are counted."""


def compared_as_planned(rows: list[Row]) -> list[Compared]:
    """Compare all modes of taxels with the frame's true depth, as plans do for the error that they state."""
    return [one for row in rows for one in compared(row, -row["x0_mm"] if is_deep(row) else None)]


def slenderness(row: Row) -> str:
    ratio = row["length_mm"] / row["thickness_mm"]
    return "l/t < 4" if ratio < 4 else "l/t 4 … 12" if ratio < 12 else "l/t > 12"


STRATA = {"topology": lambda row: row["topology"], "process": lambda row: row["process"], "slenderness": slenderness}


def line(name: str, group: list[Compared]) -> str:
    if not group:
        return f"| {name} | 0 | | | | | | |"
    signed, stated = (np.array([getattr(one, key) for one in group]) for key in ("error", "stated"))
    error = np.abs(signed)
    middle = np.median(error)
    own = np.median(stated)
    return (
        f"| {name} | {len(group)} | {np.median(signed):+.2%} | {middle:.2%} | {np.quantile(error, 0.9):.1%} | {own:.2%}"
        f" | {own / middle:.1f} | {(error <= stated).mean():.1%} |"
    )


HEADINGS = [
    "| modes | n | bias | median error | 90 % | median stated | ratio | covered |",
    "|---|---|---|---|---|---|---|---|",
]


def tables(rows: list[Row]) -> list[str]:
    deep = [row for row in rows if is_deep(row)]
    usual = [row for row in rows if not is_deep(row)]
    found = [one for row in usual for one in compared(row)]
    text = [*HEADINGS]
    for name, apart in (("fitted", False), ("held out", True)):
        own = [one for one in found if held_out(one.row) is apart]
        working = [one for one in own if one.working]
        text.append(line(f"{name}, working", working))
        for stratum in STRATA.values():
            for value in sorted({stratum(one.row) for one in working}):
                text.append(line(f"{name}, {value}", [one for one in working if stratum(one.row) == value]))
        for ratio in (0.5, 1.0):
            near = [one for one in working if (one.row["cross_layer_ratio"] < 1) is (ratio < 1)]
            text.append(line(f"{name}, cross_layer_ratio {'below ' * (ratio < 1)}1", near))
        text.append(line(f"{name}, other modes", [one for one in own if not one.working and one.ratio < NEAR]))
    text.append(line("deep frames, working", [one for row in deep for one in compared(row) if one.working]))
    return text


def bent_tables(rows: list[Row]) -> list[str]:
    text = [*HEADINGS]
    for name, later in (("fitted", False), ("solved later", True)):
        found = compared_as_planned([row for row in rows if (row["number"] >= LATER_FROM) is later])
        text.append(line(f"{name}, working", [one for one in found if one.working]))
        text.append(line(f"{name}, other modes", [one for one in found if not one.working and one.ratio < NEAR]))
    return text


# Drawing


def drawn(number: int) -> Row:
    """Draw the taxel of that number."""
    for attempt in range(TRIES):
        random = np.random.default_rng((SEED, number, attempt))
        way = "planned" if np.random.default_rng((SEED, number)).random() < 0.5 else "direct"
        try:
            row = (_planned if way == "planned" else _direct)(random, BENT if number >= BENT_FROM else TOPOLOGIES)
            if row:
                spec_of(row)
        except PadgenError:
            continue
        if row:
            return {"number": number, "drawn": way, **row}
    raise SystemExit(f"number {number}: none of {TRIES} draws is a taxel")


def cell_of(row: Row) -> str:
    """Return the name of the cell of topology, width over thickness and length over width that a taxel is in."""
    wide = int(np.digitize(row["width_mm"] / row["thickness_mm"], WIDE[1:-1]))
    long = int(np.digitize(row["length_mm"] / row["width_mm"], LONG[1:-1]))
    kind = row["topology"].partition("-")[0]
    return f"{kind}, w/t {WIDE[wide]:g}-{WIDE[wide + 1]:g}, l/w {LONG[long]:g}-{LONG[long + 1]:g}"


def group_of(row: Row) -> str:
    """Return the name of the group of cells of one topology and one range of width over thickness."""
    return cell_of(row).rpartition(",")[0]


def static_compared(row: Row) -> dict[str, tuple[float, float]]:
    """Return error and stated error of the beam model's sag, compliance and stress, all relative, by their columns.

    Bent beams have no solved stress: its error is nan.
    """
    model = model_of(row)
    sag = float(model.sag_m) / UM / row["sag_um"] - 1
    compliance = float(model.compliances.sum()) / row["compliance_m_per_n"] - 1
    stress = float(model.stress_pa_per_m) / row["stress_pa_per_m"] - 1
    answers: tuple[tuple[float, float], ...] = (
        (sag, float(model.sag_error)),
        (compliance, float(model.compliance_error)),
        (stress, float(model.stress_error)),
    )
    return dict(zip(STATIC, answers, strict=True))


def cell_tables(rows: list[Row]) -> list[str]:
    """Return the tables of the taxels drawn by cells: working modes by group and cell, others, and static answers."""
    found = [one for row in rows for one in compared(row)]
    working = [one for one in found if one.working]
    text = [*HEADINGS, line("all, working", working)]
    for name, group in (("group", group_of), ("cell", cell_of)):
        for value in sorted({group(one.row) for one in working}):
            text.append(line(f"{name} {value}", [one for one in working if group(one.row) == value]))
    text.append(line("other modes", [one for one in found if not one.working]))
    answers = [(row, static_compared(row)) for row in rows]
    for what in STATIC:
        pairs = [Compared(row, False, *both[what], 1.0) for row, both in answers if np.isfinite(both[what][0])]
        text.append(line(what, pairs))
    return text


def drawn_in_cell(number: int) -> Row | None:
    """Draw the taxel of that number within its cell; None where nothing that can be made turns up there."""
    fresh = number >= FRESH_FROM
    seed = FRESH_SEED if fresh else SEED
    kinds = ((one,) for one in TOPOLOGIES)
    cells = list(product((*kinds, BENT) if fresh else kinds, range(PLANES), range(PLANES)))
    for attempt in range(CELL_TRIES):
        try:
            row = _in_cell(np.random.default_rng((seed, number, attempt)), *cells[number % len(cells)])
        except PadgenError:
            continue
        if row:
            return {"number": number, "drawn": "cell", **row}
    return None


def _in_cell(random: Any, kinds: tuple[str, ...], wide: int, long: int) -> Row:
    """Draw a taxel within a cell; empty where its dimensions cannot be made."""
    topology = kinds[0] if len(kinds) == 1 else str(random.choice(kinds))
    row: Row = {"topology": topology, **_printed(random)}
    row["poisson_ratio"] = round(random.uniform(LEAST_POISSON, MOST_POISSON), 6)
    thickest = min(row["plate_thickness_mm"] - row["layer_mm"], 2.4)
    wanted = _logs(random, 0.1, max(thickest, 0.11))
    layers = max(round((wanted - row["first_layer_mm"]) / row["layer_mm"]), 0)
    thickness = row["first_layer_mm"] + row["layer_mm"] * layers
    width = thickness * _logs(random, WIDE[wide], WIDE[wide + 1])
    length = width * _logs(random, LONG[long], LONG[long + 1])
    bare = plate_shape(spec_of({**row, **_SIZED}))
    shortest = suspension(topology).shortest(bare, row["smallest_gap_mm"])
    if topology in BENT:
        widest = suspension(topology).widest(Room(inf, inf), bare, row["smallest_gap_mm"])
        longest = shortest + 2 * (int(topology[-1]) - 1) * MOST_ACROSS
    else:
        widest = row["plate_width_mm"] if topology != "folded" else 4.0
        longest = LONGEST_MM
    if not (row["line_width_mm"] <= width <= widest and thickness <= thickest and shortest <= length <= longest):
        return {}
    row |= {"width_mm": float(width), "thickness_mm": float(thickness), "length_mm": float(length)}
    row = {key: round(value, 6) if isinstance(value, float) else value for key, value in row.items()}
    model = model_of(row)
    if topology not in BENT and not model.in_range:
        return {}
    window_length, window_width = (float(v) for v in model.arrangement.window_mm)
    half = row["rib_mm"] / 2
    sides = (-half, window_length + half, -window_width / 2 - half, window_width / 2 + half)
    return row | dict(zip(OUTLINE, sides, strict=True))


def _logs(random: Any, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _printed(random: Any) -> Row:
    """Draw polymer, printer, washer and plate."""
    polymer = str(random.choice([*POLYMERS, "resin"]))  # resin twice, as it is a process of its own
    process, modulus, poisson, density = POLYMERS[polymer]
    if random.random() < 0.4:
        poisson = random.uniform(0.2, 0.45)
    ratio = 1.0
    if random.random() < (0.6 if process == "fdm" else 0.3):
        ratio = _logs(random, 0.1 if process == "fdm" else 0.5, 1)
    if process == "fdm":
        layer = float(random.choice([0.05, 0.1, 0.15, 0.2, 0.25, 0.3]))
        first = max(layer, float(random.choice([0.1, 0.2, 0.3])))
        line = float(random.choice([0.27, 0.45]))
        gap = 0.3 if line > 0.3 else 0.2
    else:
        layer = float(random.choice([0.025, 0.05, 0.1]))
        first = layer
        line = 0.3
        gap = 0.2
    name = str(random.choice(WASHERS))
    washer = SMALLEST if name == "m1" else {key: float(catalogue("washer")[name][key]) for key in SMALLEST}
    row: Row = {
        "process": process,
        "polymer": polymer,
        "centre_post": "yes" if random.random() < 0.25 else "no",
        "youngs_modulus_gpa": modulus,
        "poisson_ratio": poisson,
        "density_g_per_cm3": density,
        "cross_layer_ratio": ratio,
        "layer_mm": layer,
        "first_layer_mm": first,
        "line_width_mm": line,
        "smallest_gap_mm": gap if random.random() < 0.7 else random.uniform(0.2, 0.6),
        "outer_diameter_mm": washer["outer_diameter_mm"],
        "inner_diameter_mm": washer["inner_diameter_mm"],
        "washer_thickness_mm": washer["thickness_mm"],
        "glue_mg": 0.0 if random.random() < 0.5 else random.uniform(1, 10),
        "rib_mm": random.uniform(0.5, 2),
        "fillet_mm": float(random.choice([0.0, 0.3, 0.3, 0.6, 1.0])) if random.random() < 0.7 else random.uniform(0, 1),
        "boss_diameter_mm": random.uniform(1.5, 4),
        "boss_protrusion_mm": random.uniform(0.3, 2),
        "boss_edge_mm": float(random.choice([0.0, 0.2, 0.3])),
    }
    layers = int(np.ceil((row["washer_thickness_mm"] + 0.1 - first) / layer - 1e-6)) + 1
    recess = first + (max(layers, 1) - 1) * layer
    row["plate_thickness_mm"] = max(float(recess + 2 * layer), 0.4) * (1 + random.random() ** 2 * 2)
    if random.random() < 0.5 and recess + 2 * layer < 4:
        row["plate_thickness_mm"] = 4.0  # a spec's default
    row["frame_thickness_mm"] = row["plate_thickness_mm"] + float(random.choice([0, 0.5, 2]))
    walled = max(row["outer_diameter_mm"] + 0.2 + 2 * line, row["boss_diameter_mm"])
    grown = random.uniform(1, 1.5, 2) if random.random() < 0.4 else (1.0, 1.0)
    row["plate_length_mm"], row["plate_width_mm"] = (float(walled * g) + 1e-6 for g in grown)
    return {key: round(value, 6) if isinstance(value, float) else value for key, value in row.items()}


def _direct(random: Any, topologies: tuple[str, ...]) -> Row:
    """Draw proportions evenly in their logarithms."""
    row: Row = {"topology": str(random.choice(topologies)), **_printed(random)}
    thickest = min(row["plate_thickness_mm"] - row["layer_mm"], 2.4)
    wanted = _logs(random, 0.1, max(thickest, 0.11))
    count = max(round((wanted - row["first_layer_mm"]) / row["layer_mm"]), 0)
    thickness = row["first_layer_mm"] + count * row["layer_mm"]
    widest = row["plate_width_mm"] if row["topology"] != "folded" else 4.0
    width = np.clip(thickness * _logs(random, 0.4, 16), row["line_width_mm"], widest)
    bare = plate_shape(spec_of({**row, **_SIZED}))
    shortest = suspension(row["topology"]).shortest(bare, row["smallest_gap_mm"])
    length = np.clip(thickness * _logs(random, 1, 60), max(shortest, thickness), max(25.0, shortest))
    if row["topology"] in BENT:
        widest = suspension(row["topology"]).widest(Room(inf, inf), bare, row["smallest_gap_mm"])
        if widest < row["line_width_mm"]:
            return {}
        width = _logs(random, row["line_width_mm"], widest)
        length = shortest + 2 * (int(row["topology"][-1]) - 1) * random.uniform(0, MOST_ACROSS)
    row |= {"width_mm": float(width), "thickness_mm": float(thickness), "length_mm": float(length)}
    row = {key: round(value, 6) if isinstance(value, float) else value for key, value in row.items()}
    if thickness > thickest + 1e-9:
        return {}
    window_length, window_width = (float(v) for v in model_of(row).arrangement.window_mm)
    half = row["rib_mm"] / 2
    return row | dict(
        zip(OUTLINE, (-half, window_length + half, -window_width / 2 - half, window_width / 2 + half), strict=True)
    )


_SIZED = {"width_mm": 1.0, "thickness_mm": 1.0, "length_mm": 1.0}


def _planned(random: Any, topologies: tuple[str, ...]) -> Row:
    """Draw one channel of the plan of a random spec."""
    row: Row = {"topology": str(random.choice(topologies)), **_printed(random)}
    channels = int(random.integers(1, 4))
    coils = int(random.integers(1, 5))
    pitch = _logs(random, 1.3, 4) * row["plate_width_mm"] * channels**0.5
    base = _logs(random, 25, 600) * (row["youngs_modulus_gpa"] / 2) ** 0.5
    table = table_of(row)
    table |= {
        "resolution": channels * coils**2,
        "resonances_hz": [base * 1.4**k for k in range(channels)],
        "suspension": {"topology": row["topology"]},
        "coil": {
            "name": "drum-20",
            "outer_diameter_mm": 0.95 * pitch,
            "inner_diameter_mm": 0.3 * pitch,
            "core_diameter_mm": 0.3 * pitch,
            "grid": [coils, coils],
        },
    }
    table["pad"] |= {"width_mm": max(coils * pitch, 5.0), "depth_mm": max(coils * pitch, 5.0)}
    table["printer"]["smallest_beam_mm"] = row["line_width_mm"]
    spec = make_spec(table)
    choice = choose(spec)
    sized = choice.channels[int(random.integers(channels))]
    layout = choice.layout
    site = sites_of(spec, layout, choice.channels)[choice.channels.index(sized)]
    plan: Any = SimpleNamespace(
        cell=Cell(layout.sub_columns, layout.sub_rows, layout.sub_width_mm, layout.sub_depth_mm, layout.beam_axis)
    )
    channel: Any = SimpleNamespace(site=site)
    sides = outline(plan, channel)
    beam = (round(float(v), 9) for v in sized.beam)
    return (
        row
        | dict(zip(("width_mm", "thickness_mm", "length_mm"), beam, strict=True))
        | dict(zip(OUTLINE, sides, strict=True))
    )


# Solving


def polymer_of(row: Row) -> Any:
    """Return the printed material as the finite elements need it."""
    polymer = Elastic(row["youngs_modulus_gpa"] * GPA, row["poisson_ratio"], row["density_g_per_cm3"] * G_PER_CM3)
    return layered(polymer, row["cross_layer_ratio"])


def solved(row: Row, levels: int = 1, order: int = 3, kept: float = 0.05) -> Row:
    """Solve a taxel of the set by 3-D elasticity."""
    import ngsolve
    from measure_campaign_mesh import PRINTED, WASHER, Round, Taxel, modes, taxel_mesh

    ngsolve.SetNumThreads(1)
    began = time.process_time()
    spec = spec_of(row)
    arrangement = model_of(row).arrangement
    taxel = spec.taxel
    washer = spec.washer_or_magnet
    recess, depth = recess_mm(spec)
    # The boss is made shorter by the volume of its chamfer.
    radius = taxel.boss_diameter_mm / 2
    edge = taxel.boss_edge_mm
    top = spec.pad.frame_thickness_mm + taxel.boss_protrusion_mm - edge**2 * (radius - edge / 3) / radius**2
    ring = (washer.outer_diameter_mm, washer.inner_diameter_mm, depth - washer.thickness_mm)
    boss = (taxel.boss_diameter_mm, top, taxel.plate_thickness_mm)
    given = Taxel(
        arrangement,
        Round(recess, depth, post_diameter_mm(spec), *ring, *boss),
        float(fillet_mm(spec, arrangement)),
        spec.pad.frame_thickness_mm,
        tuple(row[key] for key in OUTLINE),
    )
    volume = np.pi / 4 * (ring[0] ** 2 - ring[1] ** 2) * washer.thickness_mm
    steel = Elastic(200e9, 0.3, washer.density_g_per_cm3 * G_PER_CM3 + taxel.glue_mg * 1e-6 / (volume * 1e-9))
    found = modes(
        taxel_mesh(given, levels, 1.0),
        {PRINTED: polymer_of(row), WASHER: steel},
        float(arrangement.washer_x_mm),
        order,
        kept=kept,
        taxel=given,
    )
    if not np.isfinite(found.frequency_hz).all():
        raise SolverError("a mode has no frequency")
    compliance = (found.motion[:, 2] / found.frequency_hz) ** 2
    return {
        "unknowns": found.unknowns,
        "seconds": time.process_time() - began,
        "working": int(compliance.argmax()),
        "sag_um": found.sag_m / UM,
        "compliance_m_per_n": found.compliance,
        "stress_pa_per_m": found.stress,
        **{f"hz_{k}": f for k, f in enumerate(found.frequency_hz)},
        **{f"change_{k}": e for k, e in enumerate(found.change)},
        **{f"{axis}_{k}": m for k, motion in enumerate(found.motion) for axis, m in zip(AXES, motion, strict=True)},
    }


def solved_step(row: Row) -> Any:
    """Solve a taxel by other elements, `padgen.verify.elasticity` on the STEP file, in a process of its own."""
    from padgen.solid.kernel import build123d
    from padgen.solid.taxel import taxel_solid, washer_solid

    b = build123d()  # before the elements' own OCCT
    from padgen.verify.elasticity import SolidTaxel, solve_modes

    spec = spec_of(row)
    arrangement, sides, taxel = model_of(row).arrangement, Outline(*(row[key] for key in OUTLINE)), spec.taxel
    boss = (taxel.boss_diameter_mm, spec.pad.frame_thickness_mm + taxel.boss_protrusion_mm, taxel.boss_edge_mm)
    centre = ((sides.x0 + sides.x1) / 2, (sides.y0 + sides.y1) / 2)
    channel: Any = SimpleNamespace(
        index=int(row["number"]),
        beam=SimpleNamespace(fillet_mm=float(fillet_mm(spec, arrangement))),
        pin=SimpleNamespace(on_beam=False, shape="flat", diameter_mm=boss[0], top_mm=boss[1], fillet_mm=0.0),
        site=SimpleNamespace(centre_mm=centre, origin_mm=(0.0, 0.0), along="+x"),
    )
    round_parts = (*recess_mm(spec), post_diameter_mm(spec), *boss)
    plan: Any = SimpleNamespace(
        plate=Plate(*plate_shape(spec), *round_parts, spec.printer.smallest_gap_mm),
        spec=spec,
        arrangement=lambda _: arrangement,
        cell=Cell(1, 1, sides.x1 - sides.x0, sides.y1 - sides.y0, "x"),
    )
    printed = taxel_solid(plan, channel)
    washer = washer_solid(plan, channel)
    printed.label = "printed"
    washer.label = "washer"
    steel = Elastic(200e9, 0.3, spec.washer_or_magnet.density_g_per_cm3 * G_PER_CM3)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "taxel.step"
        b.export_step(b.Compound(label="taxel", children=[printed, washer]), path)
        given = SolidTaxel(
            path,
            polymer_of(row),
            steel,
            float(washer.volume),
            float(arrangement.washer_x_mm),
            taxel.glue_mg * 1e-3 * GRAM,
        )
        return solve_modes(given).modes


def _text(name: str, value: Any) -> str:
    if isinstance(value, str) or name in ("number", "unknowns", "working"):
        return str(value)
    digits = 10 if name in NUMBERS or name in OUTLINE else 7 if name.startswith("hz") else 3
    return f"{value:.{digits}g}"


def solve(most: int, first: int, step: int) -> None:
    """Solve the taxels that the set does not have yet."""
    from measure_campaign import solved as job  # by a name that other processes know

    by_cells = first >= CELLS_FROM
    path = FRESH_SET if first >= FRESH_FROM else CELL_SET if by_cells else SET
    columns = (*COLUMNS, *STATIC) if by_cells else COLUMNS
    if not path.exists():
        versions = ", ".join(f"{name} {version(name)}" for name in ("netgen-mesher", "ngsolve"))
        path.write_text(HEADER.format(versions=versions) + ",".join(columns) + "\n")
    known = {int(line.split(",")[0].split()[-1]) for line in path.read_text().splitlines() if line[:1].isdigit()}
    known |= {int(line.split()[2]) for line in path.read_text().splitlines() if line.startswith("# without")}
    with Runner(1, ("ngsolve", "measure_campaign_mesh")) as runner:
        for number in range(first, most, step):
            if number in known:
                continue
            row = drawn_in_cell(number) if by_cells else drawn(number)
            if row is None:
                continue
            answer = runner.run(job, row, time_s=TIME_S, most_mb=MOST_MB)
            if answer.error:
                line = f"# without {number} {row['topology']}: {answer.sentence}".replace("\n", " ")
            else:
                line = ",".join(_text(name, {**row, **answer.value}[name]) for name in columns)
            with path.open("a") as file:
                file.write(line + "\n")


HEADER = """\
# Modes of random taxels by 3-D elasticity (`python docs/measure_campaign.py --solve 600`; {versions}).
# The printed solid with its washer bonded to the recess' roof, held at the sub-cell's sides; half of it on prisms.
# hz_k: frequencies by elements of order 3; change_k: how much higher order 2 had them, relative; x_k ... rz_k: motion
# of the washer about its axis at z = 0, mass-normalised, kg^-1/2 and kg^-1/2/m; working: the mode that a vertical pull
# moves most. Computed for padgen.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--solve", type=int, metavar="MOST", default=0)
    parser.add_argument("--share", type=int, nargs=2, metavar=("FIRST", "STEP"), default=(0, 1))
    parser.add_argument("--check", type=int, nargs="+", metavar="NUMBER", default=[])
    asked = parser.parse_args()
    rows = {int(row["number"]): row for row in rows_of()} if SET.exists() else {}
    if asked.solve:
        solve(asked.solve, *asked.share)
    elif asked.check:
        print("\n".join(checked([rows[number] for number in asked.check])))
    else:
        for bent, tell in ((False, tables), (True, bent_tables)):
            print("\n".join(tell([row for number, row in rows.items() if (number >= BENT_FROM) is bent])) + "\n")
        fresh = rows_of(FRESH_SET)
        seen = [row for row in fresh if row["number"] < UNSEEN_FROM]
        for part in (rows_of(CELL_SET), seen, fresh[len(seen) :]):
            print("\n".join(cell_tables(part)) + "\n")


def checked(rows: list[Row]) -> list[str]:
    """Return each taxel's frequencies in Hz beside those by tetrahedra on its STEP file."""
    from measure_campaign import solved_step as job

    text = ["| number | set | by tetrahedra |", "|---|---|---|"]
    with Runner(1) as runner:
        for row in rows:
            answer = runner.run(job, row)
            new = answer.sentence if answer.error else ", ".join(f"{hz:.5g}" for hz in answer.value.frequency_hz[:4])
            text.append(f"| {row['number']:g} | {', '.join(f'{hz:.5g}' for hz in true_hz(row)[:4])} | {new} |")
    return text


if __name__ == "__main__":
    main()
