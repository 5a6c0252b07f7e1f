"""Measures what docs/yield.md reports of the plan's estimate and of the search. Prints Markdown.

python docs/measure_yield.py templates    each template's estimate against 40,000 simulated pads of another seed
python docs/measure_yield.py life         what each template keeps for life, beside a program of its own
python docs/measure_yield.py lasting      how many plain pads last when the search plans for life, and when it does not
python docs/measure_yield.py [SPECS]      the same of random specs, and as many small ones of which every layout is
                                          planned; an hour for 200
"""

import json
import random
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from unittest.mock import patch

import numpy as np

from padgen.core.errors import PadgenError
from padgen.core.units import decibel
from padgen.planner import Plan, make, make_plan
from padgen.planner.layout import SLACK_MM, candidates, coil_reach_mm
from padgen.planner.life import planned_life
from padgen.planner.make import Choice, _assemble, _channels_and_selectivity, _decided_specs, choose
from padgen.planner.plan import plan_to_json
from padgen.planner.printed_pads import STAGES, design_of, simulated_prints, spreads_of
from padgen.planner.search import _beams, channel_limit, sites_of
from padgen.spec import Spec, load_spec, make_spec, parse_spec
from padgen.spec.load import template_paths
from padgen.spec.model import LifeTable

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.print_and_count import kept_db
from tests.touched_stepper import kept_figures

SPECS = 200
PADS = 40_000
SMALL_PADS = 4000
MOST_TAXELS = 5_120_000
"""Printed taxels of a template at most: 10,000 pads of `big-512`, whose share is then good to 1 % (two sigma)."""
NOTHING_CHANGES = LifeTable(temperature_range_k=0.0, ageing=0.0, common_q=0.0, q=0.0)
PRINTERS = ("fdm-0.4", "fdm-0.4", "fdm-0.25", "resin-0.05")


def random_spec(seed: int, most: int) -> Spec:
    """A spec of up to `most` taxels, whose layout is free in two of three."""
    rng = random.Random(seed)
    side = rng.choice((18, 25, 30, 40, 50))
    low = rng.uniform(30, 90)
    taxels = rng.choice([n for n in (2, 3, 4, 5, 6, 8, 9, 10, 12, 15, 16, 18, 20, 24, 32, 48) if n <= most])
    text = f"""
name = "random-{seed}"
resolution = {taxels}
band_hz = [{low:.0f}, {low * rng.uniform(2.5, 8):.0f}]
q_min = {rng.choice((8, 10, 15, 20, 30))}
delta_y = {rng.choice((3, 5, 7, 10))}
printer = "{rng.choice(PRINTERS)}"
pad = {{ width_mm = {side}, depth_mm = {rng.choice((side, 25))} }}
"""
    rows, columns = rng.choice(((0, 0), (0, 0), (2, 2), (2, 3)))
    return parse_spec(text + (f"coil = {{ grid = [{rows}, {columns}] }}\n" if rows and most > 24 else ""))


def kept(plan: Plan, pads: int, seed: int = 1) -> tuple[float, float]:
    """Share of simulated re-tuned pads that keep what is asked, and the dB that as many keep as the spec wants."""
    prints = simulated_prints(design_of(plan, None), spreads_of(plan.spec), pads, seed, STAGES[-1:])
    with np.errstate(divide="ignore"):
        db = 10 * np.log10(prints.ratio[0])
    return float(prints.good[0].mean()), float(np.sort(db)[int((1 - plan.spec.print_share) * pads)])


def every_layout(spec: Spec) -> Iterator[Choice]:
    """Each layout with room, in each of its divisions, under each reuse, drive and gap that the spec leaves free."""
    for decided in _decided_specs(spec):
        for layout in candidates(decided, channel_limit(decided)):
            beams = layout.margin_mm >= -SLACK_MM and _beams(decided, layout)
            reach_mm = coil_reach_mm(decided) + SLACK_MM
            if beams and all(s.coil_distance_mm <= reach_mm for s in sites_of(decided, layout, beams)):
                yield Choice(decided, layout, beams)


def order(choice: Choice) -> tuple[bool, int]:
    """What is wanted of layouts whose prints work: no empty places, few coils."""
    return choice.layout.surplus > 0, choice.layout.coils


def shortfall(spec: Spec, pads: int) -> tuple[float, int, int]:
    """How much the share of the search's choice falls short, its coils beyond the fewest, and the layouts.

    Of the share asked where some layout reaches it, else of the best.
    """
    chosen = choose(spec)
    share = kept(_assemble(chosen, *_channels_and_selectivity(chosen)), pads)[0]
    found = [(kept(_assemble(one, *_channels_and_selectivity(one)), pads)[0], one) for one in every_layout(spec)]
    most = max(share for share, _ in found)
    if most < spec.print_share:
        return most - share, 0, len(found)
    fewest = min(order(one) for share, one in found if share >= spec.print_share)
    return spec.print_share - share, order(chosen)[1] - fewest[1] if order(chosen) > fewest else 0, len(found)


def off_by(plan: Plan, share: float, db: float) -> tuple[float, float]:
    """Return by how much the plan's estimate of dB and share is more than a Monte-Carlo's."""
    told = plan.prints
    return 0.0 if told.print_db is None or not np.isfinite(db) else told.print_db - db, told.good_share - share


def templates() -> list[str]:
    text = ["| template | asked, dB | keep, dB | off | pads, % | off | prints |", "|---|---|---|---|---|---|---|"]
    for name in template_paths():
        plan = make_plan(load_spec(name))
        share, db = kept(plan, min(PADS, MOST_TAXELS // len(plan.taxels)))
        off_db, off_share = off_by(plan, share, db)
        figures = f"{db:.2f} | {off_db:+.2f} | {100 * share:.2f} | {100 * off_share:+.2f} | {plan.prints.pads:,}"
        text.append(f"| {name} | {plan.selectivity.asked_db:.0f} | {figures} |")
    return text


def for_life() -> list[str]:
    """What each template keeps re-tuned once, 10 K warmer or colder, aged, of unlike Q; by two programs."""
    lines = []
    for path in sorted(template_paths()):
        plan = make_plan(load_spec(str(path)))
        spec = replace(plan.spec, life=LifeTable())
        plan = replace(plan, spec=spec)
        life = planned_life(plan, design_of(plan, None))
        told = np.zeros(0)
        # The program of untouched pads knows neither magnets nor bent beams.
        if plan.touch is not None:
            told, _ = kept_figures(json.loads(plan_to_json(replace(plan, life=life))), SMALL_PADS, 1, for_life=True)
        elif spec.washer is not None and {channel.beam.topology for channel in plan.channels} == {"cantilever"}:
            told = kept_db(json.loads(plan_to_json(plan)), pads=SMALL_PADS, for_life=True)
        program = f"{np.quantile(told, 1 - spec.print_share):.1f}" if told.size else "–"
        kept = ["–" if db is None else f"{db:.1f}" for db in (plan.retuned_prints.print_db, life.print_db)]
        lines.append(
            f"| {plan.name} | {plan.selectivity.asked_db:.1f} | {kept[0]} | {kept[1]} | {program}"
            f" | {100 * life.good_share:.0f} | {life.retune_k:g} |"
        )
    return lines


def lasting() -> list[str]:
    """Count plain pads, of four lines and the sides, that keep what is asked for life without an error."""
    rows = list[str]()
    figures = {"re-tuned": list[tuple[bool, int, float]](), "for life": list[tuple[bool, int, float]]()}
    for taxels, q_min, band_hz, side_mm in product(
        (16, 32, 64), (10, 15, 20, 30, 50), ((50, 200), (60, 400)), (50, 80)
    ):
        pad = {"width_mm": side_mm, "depth_mm": side_mm}
        spec = make_spec({"name": "plain", "resolution": taxels, "band_hz": band_hz, "q_min": q_min, "pad": pad})
        for way, found in figures.items():
            for_life = make._lasting if way == "for life" else lambda works, later, for_cure: works
            start = time.process_time()
            try:
                with patch.object(make, "_lasting", for_life):
                    plan = make_plan(spec, tries_cures=False)
            except PadgenError:
                continue
            seconds = time.process_time() - start
            has_errors = any(finding.level == "error" for finding in plan.findings)
            lasts = plan.life.good_share >= spec.print_share and not has_errors
            found.append((lasts, plan.coils.rows * plan.coils.columns, seconds))
    for way, found in figures.items():
        last, coils, seconds = np.array(found).T
        rows.append(
            f"| {way} | {len(found)} | {last.sum():.0f} | {coils.mean():.1f} |"
            f" {np.median(seconds):.2f} | {seconds.max():.1f} |"
        )
    return ["| searched | planned | last | coils, mean | median, s | slowest, s |", "|---|---|---|---|---|---|", *rows]


def estimates(specs: int) -> list[str]:
    seed = 0
    off = list[tuple[float, ...]]()
    while len(off) < specs:
        seed += 1
        try:
            plan = make_plan(random_spec(seed, 48))
        except PadgenError:
            continue
        share, db = kept(plan, PADS)
        told = plan.prints
        off.append((*off_by(plan, share, db), told.error_db or 0.0, told.error_share))
        print(seed, plan.name, told.pads, *(f"{value:.4f}" for value in (*off[-1], share, db)), file=sys.stderr)
    db, share, error_db, error_share = np.abs(np.array(off)).T
    rows = [("print_db, dB", db, error_db, 0.01), ("share of good pads, %", 100 * share, 100 * error_share, 1e-9)]
    table = [
        "| of the plan's estimate | median off | 95 % | largest | within its stated error |",
        "|---|---|---|---|---|",
    ]
    for name, values, stated, rounding in rows:
        figures = " | ".join(f"{value:.2f}" for value in (np.median(values), np.quantile(values, 0.95), values.max()))
        table.append(f"| {name} | {figures} | {np.mean(values <= stated + rounding):.0%} |")
    return table


def searches(specs: int) -> list[str]:
    seed = 10_000
    found = list[tuple[float, int, int]]()
    times = list[float]()
    while len(found) < specs:
        seed += 1
        spec = replace(random_spec(seed, 24), life=NOTHING_CHANGES)
        start = time.process_time()
        try:
            choose(spec)
        except PadgenError:
            continue
        times.append(time.process_time() - start)
        found.append(shortfall(spec, SMALL_PADS))
        print(seed, f"{times[-1]:.2f} s", found[-1], f"{decibel(spec.delta_y):.0f} dB", file=sys.stderr)
    short, coils, layouts = np.array(found).T
    large = np.array(times)[layouts >= 200]
    return [
        f"{specs} small specs of {layouts.min():.0f} to {layouts.max():.0f} layouts (median {np.median(layouts):.0f}):"
        f" share short by more than 1 % in {(short > 0.01).sum()}, at most {max(short.max(), 0):.1%}; more coils than"
        f" needed in {(coils > 0).sum()}. Search: median {np.median(times):.2f} s, largest {max(times):.2f} s,"
        f" of 200 layouts or more {large.max() if len(large) else 0:.2f} s ({len(large)} specs) of processor time",
    ]


if __name__ == "__main__":
    asked = sys.argv[1] if len(sys.argv) > 1 else str(SPECS)
    for name, lines in (("templates", templates), ("life", for_life), ("lasting", lasting)):
        if asked == name:
            raise SystemExit(print("\n".join(lines())))
    count = int(asked)
    for part in (estimates, searches):
        print("\n".join(["", *part(count)]), flush=True)
