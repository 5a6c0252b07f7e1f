"""Measure the models of touch: finite elements of skin against closed forms, lumped skin against layers, data re-read.

Run it from a checkout, some ten minutes; a number makes that many random cases: python docs/measure_contact.py [60]
"""

import json
import sys
import time
from math import inf
from pathlib import Path

import numpy as np

from padgen.physics.contact import GUARD_RATIO, Contactor, guard_factor
from padgen.physics.contact.half_space import HalfSpace, layer_radius
from padgen.planner.thresholds import threshold_at
from padgen.verify.layered_skin import SkinLayer, SkinQuestion, solve_skin

RADIUS = 0.5e-3
SHEAR = 20e3
SEED = 20_26
GUARDED = 12


def punches() -> None:
    """Print the static stiffness of a punch over 4 G a/(1 - ν), which is 2 a E/(1 - ν²)."""
    for poisson in (0.3, 0.45, 0.5):
        layer = SkinLayer(inf, SHEAR, 0.0, poisson=poisson)
        answer = solve_skin(SkinQuestion(RADIUS, 0.0, (layer,)))
        exact = 4 * SHEAR * RADIUS / (1 - poisson)
        print(f"punch, ν = {poisson}: {answer.stiffness.real / exact - 1:+.3%}, {answer.unknowns} unknowns", flush=True)


def guards() -> None:
    """Print the guard factor by finite elements over the table's, and half way between its points."""
    layer = SkinLayer(inf, SHEAR, 0.0)
    for ratio in (*GUARD_RATIO.tolist(), 1.4, 2.5, 8.0):
        found = solve_skin(SkinQuestion(RADIUS, 0.0, (layer,), ratio)).stiffness.real / (8 * SHEAR * RADIUS)
        told = float(guard_factor(ratio))
        print(
            f"guard plate, b/a = {ratio:g}: {found:.3f} by elements, {told:.3f} planned, {told / found - 1:+.2%}",
            flush=True,
        )


def drawn(random: np.random.Generator) -> tuple[float, float, tuple[SkinLayer, SkinLayer]]:
    """Return radius, frequency and layers, drawn evenly in logarithms: low to high skin under 0.5 to 3 mm."""

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** random.random())

    outer = SkinLayer(between(0.1e-3, 0.4e-3), between(0.5e6, 4e6) / 4, between(0.4e-3, 1.5e-3))
    below = SkinLayer(inf, between(30e3, 250e3) / 4, between(0.4e-3, 1.5e-3))
    return between(0.25e-3, 1.5e-3), between(50, 500), (outer, below)


def lumped(count: int, hole_ratio: float) -> None:
    """Print how the lumped skin compares with layers: its error, and what it states of that."""
    random = np.random.default_rng(SEED)
    errors = []
    stated = []
    begun = time.monotonic()
    for _ in range(count):
        radius, hz, layers = drawn(random)
        outer, below = layers
        answer = solve_skin(SkinQuestion(radius, hz, layers, hole_ratio))
        layer = float(layer_radius(outer.thickness, outer.shear, below.shear))
        skin = HalfSpace(4 * below.shear, layer, below.time)
        contactor = Contactor(radius, hole_ratio)
        planned = skin.impedance(hz, contactor).dynamic_stiffness(hz)
        errors.append(abs(planned - answer.stiffness) / abs(answer.stiffness))
        stated.append(float(skin.error(hz, contactor)))
    within = np.mean(np.array(errors) <= stated)
    ratio = np.median(stated) / np.median(errors)
    print(
        f"{count} random skins, hole of {hole_ratio:g} radii: {within:.1%} within the stated error; true error median"
        f" {np.median(errors):.1%}, 90 % {np.quantile(errors, 0.9):.1%}, largest {max(errors):.1%}; stated median"
        f" {np.median(stated):.1%}, {ratio:.2f} x the true one; {time.monotonic() - begun:.0f} s",
        flush=True,
    )


def thresholds() -> None:
    """Print how far the thresholds are from those of the text that they were taken from."""
    known = json.loads((Path(__file__).parents[1] / "tests" / "reference" / "thresholds.json").read_text())
    worst = 0.0
    for row in known["rows"]:
        found = threshold_at(row["site"], "plate", row["area_mm2"]).at(np.array(row["hz"]))
        worst = max(worst, float(np.abs(found - row["db"]).max()))
    print(f"thresholds, {len(known['rows'])} rows: at most {worst:.2f} dB off")


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    thresholds()
    punches()
    guards()
    lumped(count, inf)
    for ratio in (1.5, 2.0, 4.0):
        lumped(min(GUARDED, count), ratio)
