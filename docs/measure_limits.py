"""Compare files that drive pads of random specs with what is judged of them: `python docs/measure_limits.py [SPECS]`.

For each plan, and again on a carrier where its drive is spur-free, random frames are saved as a WAV file. Its bytes are
integrated by tests/planner/test_limits.py. Prints every file of which volts, amperes or watts are 0.1 % above the
judged ones.
"""

import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.core.errors import PadgenError
from padgen.ladders.extreme import random_table
from padgen.planner import Plan, make_plan
from padgen.spec import load_spec, make_spec, template_paths
from tests.planner.test_limits import judged_and_found

SPECS = 200
MOST_TAXELS = 100
CARRIER = 5.5
"""Carrier over the highest resonance of a pad."""
EXCEEDED = 1.001
TURNS = np.array([1.001, 1.001, 1.05, 1.05])
"""In turns watts are averaged over a period of the lowest tone, which is no whole number of the others' periods."""
WHAT = ("V", "A", "W of a coil", "W of the pad")


def plans() -> Iterator[tuple[str, Plan]]:
    """Yield name and plan of all templates and of random specs that are planned, with up to `MOST_TAXELS` taxels."""
    for name in template_paths():
        yield name, make_plan(load_spec(name))
    for number in count():
        try:
            plan = make_plan(make_spec(random_table(number)))
        except PadgenError:
            continue
        if len(plan.taxels) <= MOST_TAXELS:
            yield f"random {number}", plan


def main(specs: int) -> int:
    """Compare so many random specs; the exit code is 1 if a file exceeds what was judged."""
    rng = np.random.default_rng(1)
    worst = np.zeros(4)
    files = 0
    beyond = 0
    refused = 0
    for index, (name, plan) in enumerate(plans()):
        if index == specs + len(template_paths()):
            break
        carrier_hz = CARRIER * plan.channels[-1].resonance_hz
        for hz in (None, carrier_hz) if plan.scheme.name == "spur-free" else (None,):
            with TemporaryDirectory() as folder:
                try:
                    judged, found = judged_and_found(plan, rng, Path(folder, "o"), hz)
                except PadgenError as error:
                    refused += 1
                    print(f"{name}, carrier {hz}: {error}", flush=True)
                    continue
            share = np.divide(found, judged, out=np.zeros(4), where=judged > 0)
            assert (found[judged == 0] == 0).all()
            worst = np.maximum(worst, share)
            files = files + 1
            if (share > (TURNS if plan.scheme.takes_turns else EXCEEDED)).any():
                beyond += 1
                print(f"{name}, carrier {hz}: {share}", flush=True)
    told = ", ".join(f"{share:.5f} ({what})" for share, what in zip(worst, WHAT, strict=True))
    print(f"{files} files, {refused} refused, {beyond} above what was judged; largest share of it: {told}")
    return int(beyond > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else SPECS))
