"""Compare the temperatures of planned pads with a 3-D heat solution: `python docs/measure_warm.py [SPEC ...]`.

Finite volumes of a quarter of pad, tray, coils, air and table, from the sizes in a plan: frame, windows with their
plates and the air around them, sockets, windings, cores, seats and their holes, the air between tray and pad with
radiation through it, and wood or foam to five times the pad's size; or of pad, board and the air above and below the
board, whose copper and pins are left out. Only the films on outer faces are the correlations that a plan uses, too,
written here once more. Prints a row a pad: rises over the room by plan and solution, their ratio, the share of its end
that the warmest plate reaches after the plan's warm-up time, the table's heat counted, and how many of these times it
takes to 63 %. `python docs/measure_warm.py bases` prints how plans' rises on other bases compare with
those on wood, and `python docs/measure_warm.py boards [N]` rows of N random pads over boards (12).
"""

import itertools
import os
import sys
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import cg

from padgen.core.errors import PadgenError
from padgen.physics.warmth import temperatures
from padgen.planner import make_plan
from padgen.planner.fixtures import plan_tray
from padgen.planner.layout import coil_axis_mm
from padgen.planner.plan import Plan
from padgen.planner.warm_pad import warm_layers
from padgen.spec import load_spec, make_spec

PLASTIC = 0.2
WOOD = 0.15
FOAM = 0.035
AIR = 0.0265
WINDING = 2.0
LAMINATE = 0.81
LAMINATE_ACROSS = 0.29
IRON = 50.0
SIGMA = 5.670374e-8
EMISSIVITY = 0.9
CONTACT_MM = 0.2
HELD_MM = 2.0
STEP_MM = float(os.environ.get("STEP_MM", 0.8))

# Beside templates: few and many coils, a wide pitch, a strong level, another plastic, coils on a board, a warm room.
OWN: list[dict[str, Any]] = [
    {"name": "eight", "resolution": 8, "band_hz": [60, 200], "q_min": 15, "coil": {"grid": [2, 2]}},
    {"name": "loud", "resolution": 32, "band_hz": [50, 200], "q_min": 15, "drive": {"level_um": 20}},
    {
        "name": "wide-pitch",
        "resolution": 32,
        "band_hz": [50, 200],
        "q_min": 15,
        "pad": {"width_mm": 100, "depth_mm": 100, "frame_thickness_mm": 5},
        "coil": {"grid": [4, 4]},
    },
    {"name": "petg", "resolution": 48, "band_hz": [50, 250], "q_min": 15, "material": "petg"},
    {
        "name": "two-coils",
        "resolution": 4,
        "band_hz": [80, 400],
        "q_min": 15,
        "magnet": "disc-3x1",
        "coil": {"kind": "board", "grid": [2, 1], "outer_diameter_mm": 8},
        "pad": {"width_mm": 40, "depth_mm": 40},
    },
    {"name": "warm-room", "resolution": 32, "band_hz": [80, 300], "q_min": 20, "limits": {"room_c": 35}},
]


def plan_of(name: str) -> Plan:
    """Return the plan of a template, of a spec in a file, or of one of `OWN`."""
    table = next((one for one in OWN if one["name"] == name), None)
    return make_plan(make_spec(table) if table else load_spec(name))


HOTTEST_K = 150.0
"""Rise of coils above which a random pad is left out: near it boards char, and copper heats itself without end."""


def board_plan(number: int) -> Plan | None:
    """Return the plan of a random pad with coils on a board; None where it has no room or gets far too hot."""
    random = Random(number)
    coil: dict[str, Any] = {
        "kind": "board",
        "house": random.choice(["coil-0.15", "fine-0.1", "heavy-0.2"]),
        "outer_diameter_mm": random.choice([8, 9.6, 12, 14]),
        "length_mm": random.choice([1.0, 1.6]),
        "layers": random.choice([2, 4]),
    }
    table = {
        "name": f"board-{number}",
        "resolution": random.choice([4, 8, 12, 16, 24, 32, 48]),
        "band_hz": [random.choice([60, 80, 120]), random.choice([300, 400, 500])],
        "q_min": 15,
        "magnet": random.choice(["disc-3x1", "disc-2x1", "disc-4x2", "disc-3x2"]),
        "coil": coil,
        "drive": {"level_um": random.choice([20, 60, 150])},
        "pad": {"width_mm": random.choice([40, 50, 80]), "depth_mm": random.choice([40, 50, 80])},
        "mount": random.choice(["foam", "resting", "skin"]),
    }
    try:
        plan = make_plan(make_spec(table), tries_cures=False)
    except PadgenError:
        return None
    return plan if plan.warm.coil_c - plan.warm.room_c < HOTTEST_K else None


def board_plans(count: int) -> Iterator[Plan]:
    """Yield `count` random pads with coils on boards."""
    drawn = (board_plan(number) for number in itertools.count())
    yield from islice((plan for plan in drawn if plan), count)


def lines(inner: np.ndarray, end: float, ratio: float = 1.5) -> np.ndarray:
    """Continue the lines of a grid outwards to `end`, each step `ratio` times the last."""
    out = list(inner)
    step = inner[-1] - inner[-2]
    while out[-1] < end:
        step *= ratio
        out.append(out[-1] + step)
    return np.array(out)


class Solved(NamedTuple):
    """Rises in K of the warmest coil and plate over the room; if stepped, the share of the plate's after `warm_up_min`.

    `times` is the time to 63 % of the plate's rise over `warm_up_min`.
    """

    coil_k: float
    beam_k: float
    share: float
    times: float


class Stack(NamedTuple):
    """What lies below a pad: heights in mm above the table, and the coils' axes.

    `marks` are heights of all faces from the table up to the pad's underside, `parts` the cells between them.
    `low` and `top` are the coils' lower and upper ends.
    """

    marks: list[float]
    parts: list[int]
    low: float
    top: float
    coils_mm: list[tuple[float, float]]


def stack_of(plan: Plan) -> Stack:
    """Return the heights of a plan's tray, or of its board."""
    coil = plan.spec.coil
    if coil.kind == "board":
        grid = plan.coils
        axes = [coil_axis_mm(grid, r, c) for r in range(grid.rows) for c in range(grid.columns)]
        top = HELD_MM + coil.length_mm
        height = top + coil.gap_mm - plan.spec.mover_low_mm
        return Stack([0, HELD_MM, top, height], [4, 6, 4], HELD_MM, top, axes)
    tray = plan_tray(plan)
    marks = [0, CONTACT_MM, tray.floor_mm, tray.socket_top_mm, tray.coil_top_mm, tray.height_mm]
    return Stack(marks, [2, 2, 3, 4, 3], tray.floor_mm, tray.coil_top_mm, list(tray.coils_mm))


def solved(plan: Plan, steps_in_time: int = 0) -> Solved:
    """Solve the heat of a plan's pad, and step it up, its warm-up time in so many steps."""
    spec = plan.spec
    stack = stack_of(plan)
    on_board = spec.coil.kind == "board"
    height = stack.marks[-1]
    pad = spec.pad
    coil = spec.coil
    half_x = pad.width_mm / 2
    half_y = pad.depth_mm / 2
    edge_x = half_x + pad.border_mm
    edge_y = half_y + pad.border_mm
    x = lines(np.linspace(0, edge_x, round(edge_x / STEP_MM) + 1), 5 * edge_x)
    y = lines(np.linspace(0, edge_y, round(edge_y / STEP_MM) + 1), 5 * edge_y)
    top = height + pad.frame_thickness_mm
    marks = [*stack.marks, top]
    parts = [*stack.parts, 3]
    above = np.concatenate([np.linspace(a, b, n + 1)[1:] for a, b, n in zip(marks, marks[1:], parts, strict=False)])
    below = -lines(np.array([0.0, 0.5]), 4 * max(edge_x, edge_y))[::-1]
    z = np.concatenate([below, above])
    size = tuple(len(side) - 1 for side in (z, y, x))
    mid_z, mid_y, mid_x = ((side[1:] + side[:-1]) / 2 for side in (z, y, x))
    at_z, at_y, at_x = np.meshgrid(mid_z, mid_y, mid_x, indexing="ij")

    on_pad = (at_x < edge_x) & (at_y < edge_y)
    active = (at_x < half_x) & (at_y < half_y)
    exists = (at_z < 0) | on_pad
    ground = FOAM if spec.mount.kind == "foam" else WOOD
    k = np.where(at_z < 0, ground, PLASTIC)
    high = (at_z > stack.low) & (at_z < stack.top)
    if on_board:
        k[on_pad & (at_z > 0) & (at_z < height)] = AIR
        k[on_pad & high] = LAMINATE
    else:
        tray = plan_tray(plan)
        k[on_pad & (at_z > 0) & (at_z < CONTACT_MM)] = AIR
        k[active & (at_z > tray.socket_top_mm) & (at_z < height)] = AIR
    heat = np.zeros(size)
    wound = np.zeros(size, int)
    for number, (cx, cy) in enumerate(stack.coils_mm, 1):
        radius = np.hypot(at_x - cx, at_y - cy)
        winding = high & (radius < coil.outer_diameter_mm / 2) & (radius >= coil.inner_diameter_mm / 2)
        if coil.shape == "rectangular":
            within, bore = (
                (np.abs(at_x - cx) < width_mm / 2) & (np.abs(at_y - cy) < depth_mm / 2)
                for width_mm, depth_mm in (coil.sides_mm, coil.bore_sides_mm)
            )
            winding = high & within & ~bore
        wound[winding] = number
        if on_board:
            continue
        k[(radius < tray.seat_hole_mm / 2) & (at_z > CONTACT_MM) & (at_z < tray.floor_mm)] = AIR
        k[high & (radius < tray.socket_diameter_mm / 2) & (radius >= coil.outer_diameter_mm / 2)] = AIR
        k[high & (radius < coil.inner_diameter_mm / 2)] = AIR
        k[high & (radius < coil.core_diameter_mm / 2)] = IRON
        k[winding] = WINDING
    plates = np.zeros(size, int)
    for number, taxel in enumerate(plan.taxels, 1):
        channel = plan.channels[taxel.channel]
        sign = -1 if taxel.turned else 1
        wx, wy = channel.site.washer_mm
        cx = taxel.x_mm - sign * wx + sign * channel.site.centre_mm[0]
        cy = taxel.y_mm - sign * wy + sign * channel.site.centre_mm[1]
        frame = at_z > height
        inside = (np.abs(at_x - cx) < (plan.cell.width_mm - pad.rib_mm) / 2) & (
            np.abs(at_y - cy) < (plan.cell.depth_mm - pad.rib_mm) / 2
        )
        length = plan.plate.length_mm
        width = plan.plate.width_mm
        if channel.site.along in ("+y", "-y"):
            length = plan.plate.width_mm
            width = plan.plate.length_mm
        plate = (np.abs(at_x - taxel.x_mm) < length / 2) & (np.abs(at_y - taxel.y_mm) < width / 2)
        k[frame & inside & ~plate] = AIR
        plates[frame & plate] = number

    area = np.diff(y)[:, None] * np.diff(x) * 1e-6
    index = -np.ones(size, int)
    index[exists] = np.arange(exists.sum())
    rows: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    values: list[np.ndarray] = []

    def join(first: np.ndarray, second: np.ndarray, conductance: np.ndarray) -> None:
        """Let heat flow between cells."""
        rows.extend([first, second, first, second])
        columns.extend([first, second, second, first])
        values.extend([conductance, conductance, -conductance, -conductance])

    steps = (np.diff(z), np.diff(y), np.diff(x))
    for axis in range(3):
        low = tuple(slice(None, -1) if a == axis else slice(None) for a in range(3))
        high_side = tuple(slice(1, None) if a == axis else slice(None) for a in range(3))
        shape = [1, 1, 1]
        shape[axis] = -1
        step = (steps[axis] * 1e-3).reshape(shape)
        others = [steps[a] * 1e-3 for a in range(3) if a != axis]
        face = np.expand_dims(others[0][:, None] * others[1], axis)
        along = np.where(on_pad & high, LAMINATE_ACROSS, k) if on_board and axis == 0 else k
        resistance = step / 2 / along
        conductance = face / (resistance[low] + resistance[high_side])
        both = exists[low] & exists[high_side]
        join(index[low][both], index[high_side][both], np.broadcast_to(conductance, both.shape)[both])
    # Radiation from what looks up at the pad's underside, coil or socket.
    mean_k = spec.limits.room_c + 20 + 273.15
    through = 4 * SIGMA * mean_k**3 / (2 / EMISSIVITY - 1)
    under = int(np.searchsorted(mid_z, height))
    coil_layer = int(np.searchsorted(mid_z, stack.top)) - 1
    if on_board:
        seen = on_pad[0]
        join(index[coil_layer][seen], index[under][seen], area[seen] * through)
        table_layer = int(np.searchsorted(mid_z, 0)) - 1
        board_layer = int(np.searchsorted(mid_z, stack.low))
        join(index[table_layer][seen], index[board_layer][seen], area[seen] * through)
    else:
        socket_layer = int(np.searchsorted(mid_z, tray.socket_top_mm)) - 1
        seen = active[0]
        is_coil = k[coil_layer] > AIR
        from_index = np.where(is_coil, index[coil_layer], index[socket_layer])[seen]
        join(from_index, index[under][seen], area[seen] * through)
    count = int(exists.sum())
    matrix = coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (count, count)
    ).tocsr()

    volume = np.diff(z)[:, None, None] * np.diff(y)[:, None] * np.diff(x)
    room = spec.limits.room_c
    length_m = 4 * edge_x * edge_y / (4 * (edge_x + edge_y)) * 1e-3
    rise = np.zeros(count)
    top_cells = index[-1][on_pad[-1]]
    top_area = area[on_pad[-1]]
    far = np.zeros(size, bool)
    far[0] = far[:, -1] = far[:, :, -1] = True
    for _ in range(6):
        loss = np.zeros(count)
        loss[index[far & exists]] += 1e3
        warm = float((rise[top_cells] * top_area).sum() / top_area.sum())
        loss[top_cells] += top_area * film_up(warm, length_m, room)
        last_x = int(np.searchsorted(mid_x, edge_x)) - 1
        last_y = int(np.searchsorted(mid_y, edge_y)) - 1
        for part, face in (
            (np.s_[:, :, last_x], steps[0][:, None] * steps[1] * 1e-6),
            (np.s_[:, last_y, :], steps[0][:, None] * steps[2] * 1e-6),
        ):
            outer = on_pad[part] & (at_z[part] > 0)
            if on_board:
                outer &= k[part] > AIR
            cells = index[part][outer]
            warm = float((rise[cells] * face[outer]).sum() / face[outer].sum())
            loss[cells] += face[outer] * film_side(warm, top * 1e-3, room)
        table = ~on_pad[0]
        surface = int(np.searchsorted(mid_z, 0)) - 1
        loss[index[surface][table]] += area[table] * 8.0
        for number in range(1, len(stack.coils_mm) + 1):
            cells = wound == number
            if cells.any():
                share = volume[cells] / (
                    np.pi / 4 * (coil.outer_diameter_mm**2 - coil.inner_diameter_mm**2) * coil.length_mm
                )
                warm_c = room + float((rise[index[cells]] * volume[cells]).sum() / volume[cells].sum())
                heat[cells] = (
                    share / share.sum() * quarter(share) * plan.load.copper_loss_w * (1 + 3.93e-3 * (warm_c - 20))
                )
        full = matrix + diags(loss)
        rise, failed = cg(full, heat[exists], x0=rise, rtol=1e-7, maxiter=20000, M=diags(1 / full.diagonal()))
        assert not failed
    coils = [rise[index[wound == n]].mean() for n in range(1, len(stack.coils_mm) + 1) if (wound == n).any()]
    beams = {n: rise[index[plates == n]].mean() for n in range(1, len(plan.taxels) + 1) if (plates == n).any()}
    warmest = max(beams, key=lambda number: beams[number])
    shares = [0.0]
    if steps_in_time:
        stored = np.select([k == AIR, at_z < 0, k >= WINDING], [1.2e3, 1e6, 3.45e6], 1240 * 1500.0) * volume * 1e-9
        rate = stored[exists] * steps_in_time / (plan.warm.warm_up_min * 60)
        stepped = full + diags(rate)
        now = np.zeros(count)
        while len(shares) <= steps_in_time or shares[-1] < SETTLED:
            now, failed = cg(
                stepped, heat[exists] + rate * now, x0=now, rtol=1e-7, maxiter=20000, M=diags(1 / stepped.diagonal())
            )
            assert not failed
            shares.append(float(now[index[plates == warmest]].mean() / beams[warmest]))
    share = shares[steps_in_time]
    times = float(np.interp(SETTLED, shares, np.arange(len(shares)) / max(steps_in_time, 1)))
    return Solved(float(max(coils)), float(beams[warmest]), share, times)


SETTLED = 1 - np.exp(-1)
"""Share of a rise that a lag of the first order has reached after its time constant."""


def quarter(share: np.ndarray) -> float:
    """Return the share of a coil that lies in the quarter: 1, 1/2 or 1/4."""
    return float(min((1.0, 0.5, 0.25), key=lambda part: abs(part - share.sum())))


def film_up(rise: float, length_m: float, room: float) -> float:
    """Return the film of the top in W/(m² K), by Lloyd and Moran's correlation and radiation."""
    rise = max(rise, 0.01)
    film = room + rise / 2 + 273.15
    rayleigh = 9.81 * rise / film * length_m**3 / (1.63e-5 * 2.3e-5)
    hot = room + rise + 273.15
    cold = room + 273.15
    return AIR / length_m * 0.54 * rayleigh**0.25 + EMISSIVITY * SIGMA * (hot**4 - cold**4) / (hot - cold)


def film_side(rise: float, height_m: float, room: float) -> float:
    """Return the film of a side in W/(m² K), by Churchill and Chu's correlation and radiation."""
    rise = max(rise, 0.01)
    film = room + rise / 2 + 273.15
    rayleigh = 9.81 * rise / film * height_m**3 / (1.63e-5 * 2.3e-5)
    nusselt = 0.68 + 0.67 * rayleigh**0.25 / (1 + (0.492 / 0.71) ** (9 / 16)) ** (4 / 9)
    hot = room + rise + 273.15
    cold = room + 273.15
    return AIR / height_m * nusselt + EMISSIVITY * SIGMA * (hot**4 - cold**4) / (hot - cold)


def bases() -> None:
    """Print the rises of pads on a base of metal, on foam and in the air, over those on wood."""
    print(f"{'pad':12} {'metal':>7} {'foam':>7} {'none':>7}")
    for name in ("pad-32", "big-512", "quad-64"):
        plan = plan_of(name)
        room_c = plan.spec.limits.room_c
        wood = warm_layers(plan)
        grounds = [wood._replace(ground_w_per_m_k=conductivity) for conductivity in (np.inf, WOOD, FOAM)]
        bases = [*grounds, wood._replace(below_w_per_k=0 * wood.below_w_per_k)]
        rises = [temperatures(base, room_c)[1].max() - room_c for base in bases]
        print(f"{name:12} " + " ".join(f"{rise / rises[1]:7.2f}" for rise in (rises[0], *rises[2:])))


def main() -> None:
    """Print a row for each pad, or those of `bases`."""
    if sys.argv[1:] == ["bases"]:
        bases()
        return
    names = sys.argv[1:] or [
        "pad-32",
        "big-512",
        "calibration",
        "quad-64",
        "wide-11",
        "board-32",
        "fingertip-board-24",
        *(one["name"] for one in OWN),
    ]
    plans: Iterator[Plan] = map(plan_of, names)
    if names[0] == "boards":
        plans = board_plans(int(names[1]) if names[1:] else 12)
    headings = f"{'plan K':>7} {'3-D K':>7} {'ratio':>6}"
    print(f"{'pad':18} {'W':>6}  coils: {headings}  beams: {headings}  share after warm_up_min, times to 63 %")
    for plan in plans:
        warm = plan.warm
        coil_k, beam_k, share, times = solved(plan, steps_in_time=40)
        coil = warm.coil_c - warm.room_c
        beam = warm.beam_rise_k
        coils = f"{coil:7.1f} {coil_k:7.1f} {coil / coil_k:6.2f}"
        beams = f"{beam:7.1f} {beam_k:7.1f} {beam / beam_k:6.2f}"
        print(
            f"{plan.name:18} {warm.heat_w:6.2f}         {coils}         {beams} {share:6.2f} {times:6.2f}", flush=True
        )


if __name__ == "__main__":
    main()
