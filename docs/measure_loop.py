"""Print the table of docs/accuracy.md on plans by the printed solid: `python docs/measure_loop.py [TEMPLATE …]`.

Every template's plan by `--model solid` with an empty cache, timed, and each exported taxel solved anew by finer
elements. About six minutes on two cores. Needs padgen[study].
"""

import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from padgen.core.cache import VARIABLE
from padgen.make.solid_tuning import plan_tuned_to_solid, solid_taxel
from padgen.planner import Plan
from padgen.solid.formats.step import write_taxel_step
from padgen.spec import load_spec, template_paths

FINER = (4, 2)
"""Order and layers; the loop takes order 3, extrapolated, where its own estimate allows."""


def finer_hz(taxel: Any) -> float:
    """The working resonance by finer elements, in a process of its own."""
    from padgen.verify.elasticity import solve_modes

    found = solve_modes(taxel, *FINER).modes
    return float(found.frequency_hz[found.working])


def solved(name: str) -> tuple[Plan, float]:
    """The plan of a template by its solids, and how long it took, s."""
    with TemporaryDirectory() as empty:
        os.environ[VARIABLE] = empty
        spec = load_spec(name)
        start = time.perf_counter()
        plan = plan_tuned_to_solid(replace(spec, model=replace(spec.model, structure="solid")))
        return plan, time.perf_counter() - start


def rows(name: str) -> list[str]:
    plan, seconds = solved(name)
    with TemporaryDirectory() as folder, ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        jobs = []
        for channel in plan.channels:
            step = Path(folder) / f"{channel.index}.step"
            write_taxel_step(plan, channel, step)
            jobs.append(pool.submit(finer_hz, solid_taxel(plan, channel, step)))
        found = [job.result() for job in jobs]
    lines = []
    for channel, hz in zip(plan.channels, found, strict=True):
        figures = (
            f"{channel.target_hz:.2f}",
            f"{channel.resonance_hz:.2f}",
            f"{hz:.2f}",
            f"{(channel.resonance_hz / hz - 1) * 100:+.2f}",
            f"{channel.model_error * 100:.2f}",
            f"{(channel.beam_error or 0.0) * 100:+.2f}",
        )
        lines.append(f"| {name}-{channel.index} | " + " | ".join(figures) + f" | {seconds:.1f} |")
    return lines


def main() -> None:
    print("| taxel | target Hz | plan Hz | finer Hz | plan off % | it states % | beam off % | whole plan s |")
    print("|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:] or [n for n in template_paths() if n != "big-512"]:
        print("\n".join(rows(name)), flush=True)


if __name__ == "__main__":
    main()
