"""Print the tables of docs/accuracy.md on the whole pad: shifts of the resonances, their bounds, crosstalk.

Run ``OPENBLAS_NUM_THREADS=1 python docs/measure_pad.py [TEMPLATE ...] [--order P]``; seconds are processor time.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.planner import make_plan
from padgen.planner.left_out import flexibility_bounds
from padgen.spec import load_spec
from padgen.verify.pad_frame import CLAMPINGS, central_taxels, pad_modes, shift
from tests.finer_models import crosstalk_db


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("templates", nargs="*", default=["paper-16", "paper-32", "quad-64", "resin-fine"])
    parser.add_argument("--order", type=int, default=3)
    parser.add_argument("--clampings", default=",".join(CLAMPINGS))
    asked = parser.parse_args()
    print(
        "| template | clamping | channel | shift % lowest, mean, highest | bound % | loudest: own coil, next dB | s |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in asked.templates:
        plan = make_plan(load_spec(name))
        coils = np.array([taxel.coil for taxel in plan.taxels])
        for clamping in asked.clampings.split(","):
            start = time.process_time()
            modes, held = pad_modes(plan, clamping, asked.order)
            seconds = time.process_time() - start
            bounds = flexibility_bounds(plan, clamping)
            for driven in central_taxels(plan):
                channel = plan.taxels[driven].channel
                every = [shift(plan, modes, held, k) for k, t in enumerate(plan.taxels) if t.channel == channel]
                below = crosstalk_db(plan, modes, driven)
                away = np.abs(coils - coils[driven]).sum(1)
                others = [below[(away == steps) & (below > 0)].min(initial=np.inf) for steps in (0, 1)]
                shares = ", ".join(f"{100 * v:+.3f}" for v in (min(every), np.mean(every), max(every)))
                loudest = ", ".join(f"{-v:.1f}" for v in others)
                print(
                    f"| {name} | {clamping} | {channel} | {shares} | {100 * bounds[channel]:.2f} | {loudest} |"
                    f" {seconds:.0f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
