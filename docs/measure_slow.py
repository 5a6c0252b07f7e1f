"""Time plans and refusals of random specs by the beam model: `python docs/measure_slow.py [SPECS] [FIRST] [--calls]`.

The specs are four lines anywhere within their bounds, templates of which one to six fields are changed, and whole
random specs, in turns; the same on every machine. Prints the slowest plans and refusals in seconds of processor time
(one thread of numpy, a warm process), and the spec of each; with `--calls` also the functions that take it. What takes
longer than it should is timed twice more, each time in a process of its own, and the least counts: other work on the
machine makes the same plan take up to twice as long.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cProfile
import json
import multiprocessing
import pstats
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from math import inf
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
from dataclasses import asdict

from padgen.core.errors import PadgenError
from padgen.ladders.extreme import DRAWN, random_table
from padgen.planner import make_plan
from padgen.spec import load_spec, make_spec, template_paths
from padgen.spec.fields import choices
from padgen.spec.load import without_none

SPECS = 300
SLOWEST = 8
BARS_S = {"plan": 5.0, "refusal": 2.0}
TIMES_AGAIN = 2


def four_lines(random: Random) -> dict[str, Any]:
    """Draw the fields that most specs consist of, and the sides of the pad, over all that is allowed."""
    low = 10 * 100 ** random.random()
    table: dict[str, Any] = {
        "name": "slow",
        "resolution": random.choice([int(4096 ** random.random()), 2 ** random.randint(0, 12)]),
        "band_hz": [low, low * 1.05 * 100 ** random.random()],
        "q_min": 1000 ** random.random(),
        "pad": {"width_mm": 20 * 25 ** random.random(), "depth_mm": 20 * 25 ** random.random()},
    }
    table["spacing"] = random.choice(["spread", "spread", "closest", "optimised"])
    if random.random() < 0.3:
        table["delta_y"] = 1.1 * 100 ** random.random()
    if random.random() < 0.3:
        rows = random.randint(1, 8)
        table["coil"] = {"grid": [rows, random.randint(rows, 8)], "reuse": random.choice(["same", "same", "alternate"])}
    return table


def changed_template(random: Random) -> dict[str, Any]:
    """Draw a template and change one to six of its fields, to anywhere within their bounds or to a bound."""
    table = without_none(asdict(load_spec(random.choice(sorted(template_paths())))))
    for _ in range(random.randint(1, 6)):
        name, item = random.choice(DRAWN)
        meta = item.metadata
        if known := choices(meta):
            value: Any = random.choice(known)
        else:
            low = max(meta["low"], 1e-3)
            high = meta["high"]
            value = random.choice([meta["low"], high, *(low * (high / low) ** random.random() for _ in range(4))])
        entry = table.setdefault(name, {}) if name else table
        entry[item.name] = int(value) if item.type == "int" or item.type is int else value
    if random.random() < 0.5:
        table["resolution"] = int(4096 ** random.random())
    if random.random() < 0.3:
        table["spacing"] = "optimised"
    return table


def drawn(number: int) -> dict[str, Any]:
    """Draw spec `number`, as a table."""
    random = Random(number)
    kinds: list[Callable[[], dict[str, Any]]] = [
        lambda: four_lines(random),
        lambda: changed_template(random),
        lambda: random_table(number, 6),
    ]
    return kinds[number % len(kinds)]()


def timed(table: dict[str, Any]) -> tuple[str, float, str]:
    """Plan a table: return whether it is planned, refused or no spec, the seconds, and what was said."""
    started = process_time()
    kind = "no spec"
    try:
        spec = make_spec(table)
        kind = "refusal"
        made = make_plan(spec)
    except PadgenError as error:
        return kind, process_time() - started, str(error)
    return "plan", process_time() - started, f"{made.coils.rows} x {made.coils.columns} x {len(made.channels)}"


def timed_alone(number: int) -> float:
    """Return the seconds that spec `number` takes in a warm process, with nothing in the cache that helps it."""
    make_plan(load_spec("paper-32"))
    with TemporaryDirectory() as empty:
        os.environ["PADGEN_CACHE"] = empty
        return timed(drawn(number))[1]


def least_again(number: int) -> float:
    """Return the least of some `timed_alone`."""
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, fresh, max_tasks_per_child=1) as processes:
        return min(processes.map(timed_alone, [number] * TIMES_AGAIN))


def main(specs: int, first: int, calls: bool) -> None:
    """Time so many specs and print the slowest of each kind."""
    make_plan(load_spec("paper-32"))
    found: dict[str, list[tuple[float, int, str]]] = {"plan": [], "refusal": [], "no spec": []}
    for number in range(first, first + specs):
        kind, seconds, told = timed(drawn(number))
        if seconds > BARS_S.get(kind, inf):
            once = seconds
            seconds = min(once, least_again(number))
            print(f"{kind} {number}: {once:.1f} s, {seconds:.1f} s again; {told}", flush=True)
        found[kind].append((seconds, number, told))
    print(f"{len(found['no spec'])} of {specs} are no valid specs and are not counted", flush=True)
    for kind, bar_s in BARS_S.items():
        slowest = sorted(found[kind], reverse=True)
        above = sum(seconds > bar_s for seconds, *_ in slowest)
        total = sum(seconds for seconds, *_ in slowest)
        print(f"{kind}: {len(slowest)} in {total:.0f} s, {above} took more than {bar_s:g} s; the slowest:")
        for seconds, number, told in slowest[:SLOWEST]:
            print(f"  {seconds:6.2f} s  number {number}: {told}\n      {json.dumps(drawn(number))}")
            if calls:
                profile = cProfile.Profile()
                profile.runcall(timed, drawn(number))
                pstats.Stats(profile).sort_stats("cumulative").print_stats("padgen", 25)


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    asked = [*numbers, *(SPECS, 0)[len(numbers) :]]
    main(asked[0], asked[1], "--calls" in sys.argv)
