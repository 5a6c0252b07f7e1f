"""Print what `padgen check --spec` finds of tampered and of unchanged pads; a section of docs/accuracy.md.

``python docs/measure_checks.py [PLACES [HONEST [FIRST]]]``: places tried of each kind (10), unchanged pads (200), and
the first seed of these.
"""

import sys
from collections import Counter
from itertools import count
from pathlib import Path

from padgen.core.errors import Finding
from padgen.planner import Plan, make_plan
from padgen.solid.mesh import Mesh
from padgen.solid.pad_solid import build_pad
from padgen.solid.parts import check_foreign
from padgen.spec import parse_spec

sys.path.insert(0, str(Path(__file__).parent.parent))
from tests.conftest import SMALL
from tests.tampering import KINDS, WAYS, honest, tampered


def errors(mesh: Mesh, plan: Plan) -> list[Finding]:
    return [f for f in check_foreign(mesh, plan.spec, plan).findings if f.level == "error"]


def tampering(places: int) -> None:
    """One coil with four channels, and three such coils, in turn."""
    larger = SMALL.replace("= 4", "= 12").replace("= 25", "= 40").replace("[1, 1]", "[1, 3]")
    plans = [make_plan(parse_spec(text)) for text in (SMALL, larger)]
    pads = [build_pad(plan) for plan in plans]
    print("| kind | caught | of | said of the first |\n|---|---|---|---|")
    caught = tried = 0
    for name in KINDS:
        found = []
        for seed in range(places):
            plan = plans[seed % 2]
            pad = pads[seed % 2]
            found.append(errors(tampered(name, seed, plan, pad)[0], plan))
        hits = sum(bool(each) for each in found)
        caught = caught + hits
        tried = tried + places
        said = next((f"{each[0].where}: {each[0].message}" for each in found if each), "")
        print(f"| {name} | {hits} | {places} | {said} |", flush=True)
    print(f"\n{caught} of {tried} caught.\n")


def accused(pads: int, first: int) -> None:
    tried = Counter[str]()
    wrong = Counter[str]()
    for seed in count(first):
        if sum(tried.values()) == pads:
            break
        if (made := honest(seed)) is None:
            continue
        plan, mesh, way = made
        tried[way] += 1
        if found := errors(mesh, plan):
            wrong[way] += 1
            print(f"seed {seed}, {way}: {found[0]}", flush=True)
    print("| honest pads, handed on as | accused | of |\n|---|---|---|")
    for way in WAYS:
        print(f"| {way} | {wrong[way]} | {tried[way]} |")


if __name__ == "__main__":
    places, pads, first = [int(v) for v in sys.argv[1:]] + [10, 200, 0][len(sys.argv) - 1 :]
    if places:
        tampering(places)
    if pads:
        accused(pads, first)
