"""Print the tables of docs/accuracy.md on plans by the printed solid: `python docs/measure_loop.py [TEMPLATE|CASE …]`.

Every template is planned by `--model solid` with an empty cache, timed, and each exported taxel is solved again by
finer elements. Taxels of other kinds (`CASES`), as the beam model plans them, are solved by the elements that plans use
and by the finest. It takes about twenty minutes on two cores, and needs padgen[study].
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
from padgen.planner import Plan, make_plan
from padgen.planner.taxel_model import FINEST
from padgen.solid.formats.step import write_taxel_step
from padgen.spec import load_spec, parse_spec, template_paths

FINER = (4, 2)
"""Order and layers of the finer elements; the loop uses order 3, extrapolated, where its own estimate allows."""
RESIN = 'printer = "resin-0.05"\n'
TPU = (
    '[material]\nname = "tpu"\nprocess = "fdm"\nyoungs_modulus_gpa = 0.06\npoisson_ratio = 0.48\n'
    "density_g_per_cm3 = 1.21\nfatigue_stress_mpa = 3\n"
)
CASES = {
    "folded-resin": (2, 14, "[50, 400]", RESIN + 'material = "tough-resin"\n', "folded", ""),
    "folded-one": (1, 12, "[50, 400]", RESIN, "folded", ""),
    "bridge-resin": (2, 12.5, "[50, 400]", RESIN, "bridge", ""),
    "bridge-tall": (1, 14, "[200, 1500]", RESIN + "resonances_hz = [700]\n", "bridge", ""),
    "bridge-stubby": (1, 16, "[300, 3000]", "resonances_hz = [1500]\n", "bridge", "length_mm = 2.5\n"),
    "abs": (2, 12.5, "[50, 400]", 'material = "abs"\n', "cantilever", ""),
    "petg": (2, 12.5, "[50, 400]", 'material = "petg"\n', "cantilever", ""),
    "folded-petg": (2, 18, "[50, 400]", 'material = "petg"\n', "folded", ""),
    "tpu": (1, 12.5, "[10, 100]", "", "cantilever", TPU),
    "folded-tpu": (1, 14, "[10, 100]", "", "folded", TPU),
    "wide": (1, 14, "[100, 1000]", "resonances_hz = [300]\n", "cantilever", "thickness_mm = 0.4\n"),
    "stubby": (1, 14, "[200, 2000]", "resonances_hz = [900]\n", "cantilever", "length_mm = 3\n"),
}
"""Cases by name: channels of the one coil, side of the pad in mm, band, further top-level lines, suspension, tables."""


def finer_hz(taxel: Any) -> float:
    """Return the working resonance by finer elements, for a process of its own."""
    from padgen.verify.elasticity import solve_modes

    found = solve_modes(taxel, *FINER).modes
    return float(found.frequency_hz[found.working])


def solved(name: str) -> tuple[Plan, float]:
    """Return the plan of a template by its solids, and the seconds that it took."""
    with TemporaryDirectory() as empty:
        os.environ[VARIABLE] = empty
        spec = load_spec(name)
        start = time.perf_counter()
        plan = plan_tuned_to_solid(replace(spec, model=replace(spec.model, structure="solid")))
        return plan, time.perf_counter() - start


def case_plan(name: str) -> Plan:
    """Return the beam model's plan of a case."""
    channels, side_mm, band, top, topology, tables = CASES[name]
    return make_plan(
        parse_spec(
            f'name = "{name}"\nresolution = {channels}\nband_hz = {band}\nq_min = 15\n{top}'
            f"[pad]\nwidth_mm = {side_mm}\ndepth_mm = {side_mm}\n[coil]\ngrid = [1, 1]\n"
            f'[suspension]\ntopology = "{topology}"\n{tables}'
        )
    )


def by_plan_and_finest(taxel: Any) -> tuple[float, float, float, float]:
    """Return the resonance as plans take it, its stated error and processor seconds, and that of the finest setting."""
    from padgen.verify.elasticity import SETTINGS, converged_modes

    start = time.process_time()
    found = converged_modes(taxel, FINEST)
    seconds = time.process_time() - start
    finest = converged_modes(taxel, FINEST, first=len(SETTINGS) - 1)
    hz, finest_hz = (float(one.modes.frequency_hz[one.modes.working]) for one in (found, finest))
    return hz, found.working_error, seconds, finest_hz


def case_rows(name: str) -> list[str]:
    plan = case_plan(name)
    with TemporaryDirectory() as folder, ProcessPoolExecutor(1, get_context("spawn")) as pool:
        lines = []
        for channel in plan.channels:
            step = Path(folder) / f"{channel.index}.step"
            write_taxel_step(plan, channel, step)
            taxel = solid_taxel(plan, channel, step)
            hz, stated, seconds, finest_hz = pool.submit(by_plan_and_finest, taxel).result()
            figures = (
                f"{channel.resonance_hz:.2f}",
                f"{hz:.2f}",
                f"{finest_hz:.2f}",
                f"{(hz / finest_hz - 1) * 100:+.2f}",
                f"{stated * 100:.2f}",
                f"{(channel.resonance_hz / finest_hz - 1) * 100:+.2f}",
                f"{seconds:.0f}",
            )
            lines.append(f"| {name}-{channel.index} | " + " | ".join(figures) + " |")
    return lines


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
    asked = sys.argv[1:] or [*(n for n in template_paths() if n != "big-512"), *CASES]
    if templates := [name for name in asked if name not in CASES]:
        print("| taxel | target Hz | plan Hz | finer Hz | plan off % | it states % | beam off % | whole plan s |")
        print("|---|---|---|---|---|---|---|---|")
        for name in templates:
            print("\n".join(rows(name)), flush=True)
    if cases := [name for name in asked if name in CASES]:
        print("\n| taxel | beam Hz | solid Hz | finest Hz | solid off % | it states % | beam off % | processor s |")
        print("|---|---|---|---|---|---|---|---|")
        for name in cases:
            print("\n".join(case_rows(name)), flush=True)


if __name__ == "__main__":
    main()
