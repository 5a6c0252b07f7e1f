"""How many coils pads on boards need by how many diameters each layout is tried with, and how long their plans take.

python docs/measure_coil_sizes.py [COUNT [FIRST [SHAPE]]]: COUNT random specs that leave the coils' size open, round
ones or of another SHAPE.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import random
import sys
import time
from typing import Any

from rich.progress import track

from padgen.core.errors import PadgenError
from padgen.planner import Plan, make_plan, search
from padgen.spec import make_spec

SIZED = (1, 2, 3)


def random_table(seed: int, shape: str = "round") -> dict[str, Any]:
    """Return a spec of 8 to 64 magnets over coils on a board, drawn with `seed`."""
    drawn = random.Random(seed)
    lowest_hz = drawn.choice([60, 80, 100, 150])
    taxels = drawn.choice([8, 9, 12, 16, 24, 32, 32, 40, 48, 64])
    side_mm = 50 * drawn.choice([0.8, 1, 1, 1.3, 1.6])
    coil: dict[str, Any] = {"kind": "board", "shape": shape}
    table = {
        "name": f"random-{seed}",
        "resolution": taxels,
        "band_hz": [lowest_hz, lowest_hz * drawn.choice([2, 3, 4])],
        "q_min": drawn.choice([10, 15, 20, 30]),
        "magnet": drawn.choice(["disc-2x1", "disc-3x1", "disc-3x2"]),
        "delta_y": drawn.choice([3, 5, 10]),
        "pad": {"width_mm": side_mm, "depth_mm": side_mm},
        "coil": coil,
    }
    if drawn.random() < 0.3:
        coil["house"] = drawn.choice(["fine-0.1", "fine-0.127", "heavy-0.2"])
    if drawn.random() < 0.3:
        coil["gap_mm"] = drawn.choice([0.5, 1, 1.5])
    return table


def planned(table: dict[str, Any]) -> tuple[Plan | None, float]:
    """Return the plan of a spec, None if it is refused, and the time that it took in s of the processor."""
    start_s = time.process_time()
    try:
        plan = make_plan(make_spec(table), tries_cures=False)
    except PadgenError:
        return None, time.process_time() - start_s
    return plan, time.process_time() - start_s


def works(plan: Plan) -> bool:
    """Return whether prints of a plan work as often as asked once they are re-tuned."""
    return not {"print.share", "coil.heat"} & {finding.code for finding in plan.findings}


def main() -> None:
    """Print coils, working pads and time by diameters tried with each layout, and the pads whose coils differ."""
    given = sys.argv[1:]
    count, first = [*map(int, given[:2]), *(80, 0)[len(given) :]]
    shape = given[2] if len(given) > 2 else "round"
    coils: dict[int, dict[int, int]] = {}
    for sized in SIZED:
        search.COILS_SIZED = sized
        seeds = track(range(first, first + count), f"{sized} of a layout")
        runs = {seed: planned(random_table(seed, shape)) for seed in seeds}
        plans = {seed: plan for seed, (plan, _) in runs.items() if plan}
        coils[sized] = {seed: plan.coils.rows * plan.coils.columns for seed, plan in plans.items() if works(plan)}
        took_s = [seconds for _, seconds in runs.values()]
        print(
            f"{sized} of a layout: {len(plans)} of {count} planned, {len(coils[sized])} work, with"
            f" {sum(coils[sized].values())} coils; {sum(took_s):.0f} s, slowest {max(took_s):.1f} s"
        )
    for seed in range(first, first + count):
        needed = [coils[sized].get(seed) for sized in SIZED]
        if len(set(needed)) > 1:
            print(f"seed {seed}: coils {needed}")


if __name__ == "__main__":
    main()
