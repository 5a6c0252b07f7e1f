"""Measure docs/recoil.md's tables: planned recoil stepped in time, what signs keep, and re-tuned prints.

`python docs/measure_recoil.py` prints them; `tests/pad_stepper.py` steps, from plan.json alone.
"""

import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import padgen as pg
from padgen.planner.plan import Plan, plan_to_json
from padgen.planner.shaken_pad import ShakenPad, pad_recoil, random_images
from padgen.spec import MountTable
from padgen.spec.load import template_paths
from tests.pad_stepper import stepped_db
from tests.retuned_pad import retuned_db

PADS = 40
STEPPED = ("pad-32", "paper-16", "paper-32", "paper-pair", "triple-48")
"""Templates that are stepped: with many taxels it takes long."""
RETUNED = ("calibration", "pad-32", "paper-16", "quad-64", "resin-fine", "triple-48")
SIGMAS = (0.01, 0.035)
"""Spreads of the resonances of a print's taxels."""


def a_mount(rng: np.random.Generator) -> MountTable:
    """Return a mount by chance: loose, on a layer, glued to a plate, or both of these."""
    base_g = float(np.round(10 ** rng.uniform(1, 3.3))) if rng.random() < 0.5 else None
    if rng.random() < 0.4:
        return MountTable("glued" if base_g else "resting", base_g)
    stiffness = float(np.round(10 ** rng.uniform(2, 5.3)))
    return MountTable("foam", base_g, stiffness, float(np.round(10 ** rng.uniform(0, 1.3), 1)))


def an_image(plan: Plan, rng: np.random.Generator) -> np.ndarray:
    """Return an image by chance, from one taxel ON to all but one."""
    count = len(plan.taxels)
    levels = np.zeros(count)
    levels[rng.permutation(count)[: rng.integers(1, count)]] = 1.0
    return levels


def main() -> None:
    """Print a row for each pad that is stepped, then one for each template."""
    rng = np.random.default_rng(2024)
    plans = {name: pg.plan(name) for name in STEPPED}
    worst = 0.0
    print("| pad | mount | base, g | stiffness, N/m | Q | ON | signs | planned, dB | stepped − planned, dB |")
    print("|---|---|---|---|---|---|---|---|---|")
    for k in range(PADS):
        name = STEPPED[k % len(STEPPED)]
        mount = a_mount(rng)
        plan = plans[name]
        table = json.loads(plan_to_json(plan))
        table["recoil"] = asdict(pad_recoil(plan, mount, 1))
        table["spec"]["mount"] = {key: value for key, value in asdict(mount).items() if value is not None}
        pad = ShakenPad(plan, mount)
        # Leakage and recoil come from different coils; stepped is the recoil.
        pad.leak[:] = 0.0
        levels = an_image(plan, rng)
        is_signed = bool(rng.random() < 0.5)
        driven = levels * pad.signs(levels) if is_signed else levels
        planned = float(pad.listen(driven).db)
        off = float(stepped_db(table, driven)) - planned
        worst = max(worst, abs(off))
        stiffness = f"{mount.stiffness_n_per_m:g} | {mount.q:g}" if mount.stiffness_n_per_m else "– | –"
        print(
            f"| {name} | {mount.kind} | {mount.base_mass_g or 0:g} | {stiffness} | {int(levels.sum())} of {len(levels)}"
            f" | {'chosen' if is_signed else 'in step'} | {planned:.2f} | {off:+.5f} |",
            flush=True,
        )
    print(f"\nLargest difference of {PADS} pads: {worst:.5f} dB\n")
    print("| template | pad, g | clamped, dB | in step, dB | apart, dB | signs, dB | lost, dB | plate for 2 dB, g |")
    print("|---|---|---|---|---|---|---|---|")
    for name in template_paths():
        one = pg.recoil(pg.plan(name))
        if one.clamped_db is None or one.in_step_db is None or one.apart_db is None or one.signed_db is None:
            continue
        base = "none needed" if one.base_g == 0 else f"{one.base_g:g}" if one.base_g else "none tried"
        print(
            f"| {name} | {one.pad_g:.0f} | {one.clamped_db:.1f} | {one.in_step_db:.1f} | {one.apart_db:.1f}"
            f" | {one.signed_db:.1f} | {one.lost_db:.1f} | {base} |",
            flush=True,
        )
    heads = " | ".join(f"prints, sigma {sigma:.1%}" for sigma in SIGMAS)
    print(f"\n| template | apart, dB | {heads} |\n|---|---|---|---|")
    for name in RETUNED:
        pad = ShakenPad(pg.plan(name))
        count = len(pad.unit)
        shown = random_images(count, 100)
        spans = []
        for sigma in SIGMAS:
            hz = [pad.taxels.resonance_hz * (1 + sigma * rng.normal(size=count)) for _ in range(5)]
            found = [retuned_db(pad, resonances, shown) for resonances in hz]
            spans.append(f"{min(found):.2f} … {max(found):.2f}")
        apart = float(pad.listen_apart(shown).db.min())
        print(f"| {name} | {apart:.2f} | {' | '.join(spans)} |", flush=True)


if __name__ == "__main__":
    main()
