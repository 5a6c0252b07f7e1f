"""Measure the figures of docs/accuracy.md on the terms that a plan leaves out: `python docs/measure_left_out.py`.

For each scene and term it prints the bound, the true error by a finer model (see tests/planner/test_left_out.py), their
ratio, and the run times of the bound and of computing the term, in ms of CPU time, the least of several runs.

`random N` compares bounds with finer models (tests/finer_models.py) on N plans of random specs. Rows are added to
tests/reference/left_out_campaign.csv, going on where it was stopped. `random N --bounds` plans the known specs again,
for their bounds alone, after a bound has changed. Terms named after N are the only ones. 500 plans take forty minutes
of processor time.
"""

import csv
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from statistics import median

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from padgen.core.errors import PadgenError
from padgen.core.units import UM
from padgen.ladders.extreme import random_table
from padgen.make.planning import plan_for
from padgen.physics.bounds import core_eddies, core_polarisation, motional_voltage
from padgen.physics.magnetics import impedance
from padgen.planner.drive_scheme import coil_leakage
from padgen.planner.layout import Layout
from padgen.planner.left_out import _pulled, left_out
from padgen.planner.plan import Plan
from padgen.planner.suspensions import BeamShape
from padgen.spec import make_spec
from tests import finer_models
from tests.planner import test_left_out as truth

Row = tuple[str, str, float, float]


def cpu_ms(work: Callable[[], object], runs: int = 5) -> float:
    times = []
    for _ in range(runs):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times) * 1e3


def rows() -> Iterator[Row]:
    models = {**{term: finer_models.TRUE[term] for term in truth.ON_SCENES}, "shielding": finer_models.true_shielding}
    for name in truth.SCENES:
        plan = truth.scene(name)[1]
        for entry in left_out(plan):
            true = models[entry.term](plan) if entry.term in models and entry.bound is not None else None
            if isinstance(true, float) and entry.bound is not None:
                yield entry.term, name, entry.bound, true
    for numbers in truth.MOTIONS:
        yield "motion", f"{numbers[2]} Hz, {numbers[1] / UM:g} µm", *truth.motion(*numbers)
    for name, topology, shape in truth.BEAMS:
        size = " x ".join(f"{v:g}" for v in shape)
        yield "beam inertia", f"{name}, {topology} {size} mm", *truth.inertia(name, topology, shape)
    for name in truth.FIELDS:
        for current_a in (0.06, 0.25, 1.0, 3.0):
            yield "saturation", f"{name}, {current_a:g} A", *truth.saturation(name, current_a)
        for hz in (28.0, 38.0, 96.0, 350.0):
            yield "eddy currents", f"{name}, {hz:g} Hz", *truth.eddy_currents(name, hz)


def bounds_table(found: list[Row]) -> list[str]:
    lines = ["| term | scene | bound | true | ratio |", "|---|---|---|---|---|"]
    for term, scene, bound, true in found:
        lines.append(f"| {term} | {scene} | {bound:.2g} | {true:.2g} | {bound / true:.2f} |")
    return lines


def spread_table(found: list[Row]) -> list[str]:
    lines = ["| term | scenes | true from | to | ratio least | median | most |", "|---|---|---|---|---|---|---|"]
    for term in dict.fromkeys(row[0] for row in found):
        true, ratio = zip(*((t, b / t) for of, _, b, t in found if of == term), strict=True)
        least = f"{min(ratio):.2f}"
        most = f"{max(ratio):.2f}"
        lines.append(
            f"| {term} | {len(true)} | {min(true):.1g} | {max(true):.1g} | {least} | {median(ratio):.2f} | {most} |"
        )
    return lines


def times_table(name: str) -> list[str]:
    """Return the table of run times: of each bound, and of the term itself as the finer models compute it."""
    spec, plan = truth.scene(name)
    channel = plan.channels
    grid = plan.coils
    layout = Layout(grid.rows, grid.columns, len(channel), 1, 1, 1.0, 1.0, "x", 0, (("none", 1.0),))
    reused = spec, layout, channel, plan.scheme
    case = truth.FIELDS["paper coil"]
    beam = truth.BEAMS[0]
    taxel = finer_models.suspended(spec, plan, beam[1], BeamShape(*beam[2]))
    pull, amplitude, resonance, drive, bias = np.array([[0.033], [1e-5], [56.0], [28.0], [0.0]])
    pairs: dict[str, tuple[Callable[[], object], Callable[[], object], int]] = {
        "gap": (lambda: _pulled(plan, channel), lambda: finer_models.true_gap(copied(plan)), 1),
        "softening": (lambda: _pulled(plan, channel), lambda: finer_models.true_softening(copied(plan)), 1),
        "leakage": (lambda: coil_leakage(*reused), lambda: finer_models.true_leakage(plan), 1),
        "beam inertia": (
            lambda: finer_models.condensed_bound(taxel),
            lambda: finer_models.element_error(taxel),
            3,
        ),
        "motion": (
            lambda: motional_voltage(pull, amplitude, resonance, drive, bias, partial(impedance, 62.9, 0.0417)),
            lambda: truth.true_current_error(*truth.MOTIONS[0]),
            2,
        ),
        "saturation": (lambda: core_polarisation(case[0]), lambda: truth.saturation("paper coil", 1.0), 1),
        "eddy currents": (
            lambda: core_eddies(case[0], 1e-7, 38.0),
            lambda: truth.eddy_currents("paper coil", 38.0),
            1,
        ),
        "shielding": (lambda: left_out(plan), lambda: finer_models.true_shielding(plan), 1),
    }
    lines = ["| term | bound ms | computed ms | ratio |", "|---|---|---|---|"]
    for term, (bound, computed, runs) in pairs.items():
        left_ms = cpu_ms(bound, 20)
        computed_ms = cpu_ms(computed, runs)
        lines.append(f"| {term} | {left_ms:.2f} | {computed_ms:.1f} | {computed_ms / left_ms:.0f} |")
    all_ms = cpu_ms(lambda: left_out(plan), 20)
    lines += [
        "",
        f"All bounds of {name} together: {all_ms:.1f} ms; leakage: {cpu_ms(lambda: coil_leakage(*reused), 5):.1f} ms.",
    ]
    return lines


def copied(plan: Plan) -> Plan:
    """Return the same plan, for which the finer models have not kept any pulls."""
    return replace(plan, channels=tuple(replace(channel) for channel in plan.channels))


CAMPAIGN = Path(__file__).parents[1] / "tests" / "reference" / "left_out_campaign.csv"
MOST_S = 60
"""Longest time in s that a finer model of finite elements may take."""
REFUSED = "refused"
"""Term that marks a spec that has no plan, or one whose plan has an error."""


def planned(number: int) -> Plan | None:
    try:
        plan = plan_for(make_spec(random_table(number)))
    except PadgenError:
        return None
    return None if any(finding.level == "error" for finding in plan.findings) else plan


def asked(plan: Plan, only: list[str]) -> dict[str, Callable[[Plan], object]]:
    """Return the finer models to compare with a plan, those of `only` if there are any."""
    bounds = {entry.term: entry.bound or 0.0 for entry in plan.left_out if entry.status == "bounded"}
    models: dict[str, Callable[[Plan], object]] = {**finer_models.TRUE, **finer_models.DEAR}
    for term, model in finer_models.CLIMBING.items():
        if term != "frame" or len(plan.taxels) <= finer_models.MOST_TAXELS:
            models[term] = partial(model, bound=bounds.get(bounded(term), 0.0))
    return {term: model for term, model in models.items() if bounds.get(bounded(term)) and (not only or term in only)}


def bounded(term: str) -> str:
    """Return the term of the plan that a finer model is of."""
    return term.removesuffix(" aside")


def compared(plan: Plan, term: str, model: Callable[[Plan], object]) -> list[object]:
    """Return bound, true size, seconds, and the size's own error; an error of the model stands in place of its size."""
    start = time.perf_counter()
    bound = next(e.bound for e in plan.left_out if e.term == bounded(term))
    off = None
    true = solved(model, plan) if term in finer_models.TRUE else solved_in_time(model, plan)
    if isinstance(true, finer_models.Sized):
        true, off = true
    elif isinstance(true, tuple):
        bound, true = true
    return [bound, true, round(time.perf_counter() - start, 2), off]


def solved(model: Callable[[Plan], object], plan: Plan) -> object:
    """Return what the model finds, or its error as a text."""
    try:
        return model(plan)
    except Exception as error:  # those of netgen and ngsolve have no other root
        return f"{type(error).__name__}: {error}"[:120]


def solved_in_time(model: Callable[[Plan], object], plan: Plan) -> object:
    """Solve in a process that is killed after `MOST_S`: finite elements of extreme shapes may not end."""
    context = get_context("fork")
    theirs, ours = context.Pipe()
    child = context.Process(target=lambda: ours.send(solved(model, plan)))
    child.start()
    found = theirs.recv() if theirs.poll(MOST_S) else f"not solved in {MOST_S} s"
    child.kill()
    child.join()
    return found


def random_campaign(wanted: int, only: list[str]) -> None:
    known: dict[int, set[str]] = {}
    if CAMPAIGN.exists():
        for row in csv.DictReader(CAMPAIGN.open()):
            known.setdefault(int(row["number"]), set()).add(row["term"])
    place = 0
    with CAMPAIGN.open("a", newline="", buffering=1) as file:
        write = csv.writer(file, lineterminator="\n").writerow
        if not known:
            write(["number", "term", "bound", "true", "seconds", "off"])
        for number in count():
            if place == wanted:
                return
            if REFUSED in known.get(number, ()):
                continue
            plan = planned(number)
            if plan is None:
                write([number, REFUSED, "", "", "", ""])
                continue
            for term, model in asked(plan, only).items():
                if term not in known.get(number, ()):
                    write([number, term, *compared(plan, term, model)])
            place += 1


def renewed_bounds() -> None:
    """Renew the bounds of the campaign's rows, except where the finer model gives a bound of its own.

    Rows of specs that have no plan any more go.
    """
    rows = []
    bounds = dict[str, float | None]()
    known = ""
    for row in csv.DictReader(CAMPAIGN.open()):
        if row["term"] != REFUSED and row["term"] not in finer_models.OWN_BOUND:
            if row["number"] != known:
                plan = planned(int(row["number"]))
                known = row["number"]
                bounds = {entry.term: entry.bound for entry in plan.left_out} if plan else {}
            if bounded(row["term"]) not in bounds:
                continue
            row["bound"] = str(bounds[bounded(row["term"])] or "")
        rows.append(row)
    aside = CAMPAIGN.with_suffix(".new")
    with aside.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    aside.replace(CAMPAIGN)


def campaign_table() -> list[str]:
    lines = [
        "| term | plans | broken | true from | to | bound / true: least | median | no bound | not solved |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    rows = [row for row in csv.DictReader(CAMPAIGN.open()) if row["term"] != REFUSED]
    for term in sorted({row["term"] for row in rows}):
        own = [r for r in rows if r["term"] == term]
        true = []
        ratio = []
        free = 0
        lost = 0
        for row in own:
            try:
                size = float(row["true"])
            except ValueError:
                lost += bool(row["true"])
                continue
            if not row["bound"]:
                free += 1
            elif size > finer_models.LEAST.get(term, 0.0):
                true.append(size)
                ratio.append(float(row["bound"]) / size)
        broken = sum(r * truth.SLACK < 1 for r in ratio)
        lines.append(
            f"| {term} | {len(ratio)} | {broken} | {min(true):.1g} | {max(true):.1g} | {min(ratio):.2f} |"
            f" {median(ratio):.2f} | {free} | {lost} |"
        )
    return lines


def main() -> None:
    if sys.argv[1:2] == ["random"]:
        if "--bounds" in sys.argv:
            renewed_bounds()
        else:
            random_campaign(int(sys.argv[2]), sys.argv[3:])
        print("\n".join(campaign_table()))
        return
    found = list(rows())
    for table in (bounds_table(found), spread_table(found), times_table("paper-32")):
        print("\n".join(table), end="\n\n")


if __name__ == "__main__":
    main()
