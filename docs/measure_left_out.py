"""Measures what docs/accuracy.md says of the terms that a plan leaves out: `python docs/measure_left_out.py`.

For each scene and term: the bound, the true error by a finer model (tests/test_left_out.py says which), their
ratio, and what the bound takes beside computing the term, in ms of CPU time, the least of several runs. With
`--fine` also the 3-D field solutions of four washers over a coil, some 20 s each.
"""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.core.units import UM
from padgen.physics.bounds import core_eddies
from padgen.planner.left_out import _pulled, left_out
from padgen.planner.reuse import coil_reuse
from tests import test_left_out as truth

Row = tuple[str, str, float, float]


def cpu_ms(work: Callable[[], object], runs: int = 5) -> float:
    times = []
    for _ in range(runs):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times) * 1e3


def rows(fine: bool) -> Iterator[Row]:
    for name in truth.SCENES:
        for entry in left_out(truth.scene(name)[1]):
            if entry.term in truth.TRUE and entry.bound is not None:
                yield entry.term, name, entry.bound, truth.TRUE[entry.term](name)
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
    for name in ("paper-32", "strong", *(("triple-48", "quad-64", "resin-fine") if fine else ())):
        bound = truth.entry(name, "shielding").bound
        assert bound is not None
        yield "shielding", name, bound, truth.true_shielding(name)


def bounds_table(found: list[Row]) -> list[str]:
    lines = ["| term | scene | bound | true | ratio |", "|---|---|---|---|---|"]
    for term, scene, bound, true in found:
        lines.append(f"| {term} | {scene} | {bound:.2g} | {true:.2g} | {bound / true:.2f} |")
    return lines


def spread_table(found: list[Row]) -> list[str]:
    lines = ["| term | scenes | true from | to | ratio least | median | most |", "|---|---|---|---|---|---|---|"]
    for term in dict.fromkeys(row[0] for row in found):
        true, ratio = zip(*((t, b / t) for of, _, b, t in found if of == term), strict=True)
        least, most = f"{min(ratio):.2f}", f"{max(ratio):.2f}"
        lines.append(
            f"| {term} | {len(true)} | {min(true):.1g} | {max(true):.1g} | {least} | {median(ratio):.2f} | {most} |"
        )
    return lines


def times_table(name: str) -> list[str]:
    """What each term takes: its bound beside the term itself, as the true errors compute it."""
    spec, plan = truth.scene(name)
    channel = plan.channels
    case, beam = truth.FIELDS["paper coil"], truth.BEAMS[0]
    taxel = truth.suspended(*truth.scene(beam[0]), beam[1], truth.BeamShape(*beam[2]))
    pairs: dict[str, tuple[Callable[[], object], Callable[[], object], int]] = {
        "gap": (lambda: _pulled(plan, channel), lambda: truth.true_gap(name), 1),
        "softening": (lambda: _pulled(plan, channel), lambda: truth.true_softening(name), 1),
        "far coils": (
            lambda: [e for e in left_out(plan) if e.term == "far coils"],
            lambda: truth.true_far_coils(name),
            2,
        ),
        "beam inertia": (
            lambda: truth.beam_inertia(
                taxel.beams,
                taxel.modes.shape[:, int(taxel.working)],
                taxel.modes.reference,
                taxel.modes.frequency_hz[int(taxel.working)],
                *taxel.elastic,
            ),
            lambda: truth.element_error(taxel),
            3,
        ),
        "motion": (
            lambda: truth.motional_voltage(
                *(np.array([v]) for v in (0.033, 1e-5, 56.0, 28.0, 0.0)),
                lambda hz: truth.impedance(62.9, 0.0417, hz),
            ),
            lambda: truth.true_current_error(*truth.MOTIONS[0]),
            2,
        ),
        "saturation": (lambda: truth.core_polarisation(case[0]), lambda: truth.saturation("paper coil", 1.0), 1),
        "eddy currents": (
            lambda: core_eddies(case[0], 1e-7, 38.0),
            lambda: truth.eddy_currents("paper coil", 38.0),
            1,
        ),
        "shielding": (lambda: left_out(plan), lambda: truth.true_shielding(name), 1),
    }
    lines = ["| term | bound ms | computed ms | ratio |", "|---|---|---|---|"]
    for term, (bound, computed, runs) in pairs.items():
        left_ms, computed_ms = cpu_ms(bound, 20), cpu_ms(computed, runs)
        lines.append(f"| {term} | {left_ms:.2f} | {computed_ms:.1f} | {computed_ms / left_ms:.0f} |")
    all_ms = cpu_ms(lambda: left_out(plan), 20)
    near_ms = cpu_ms(lambda: coil_reuse(spec, _layout(plan), channel, plan.scheme), 5)
    lines.append("")
    lines.append(
        f"All bounds of {name} together: {all_ms:.1f} ms; leakage of the nearest eight coils: {near_ms:.1f} ms."
    )
    return lines


def _layout(plan: truth.Plan) -> truth.Layout:
    grid = plan.coils
    return truth.Layout(grid.rows, grid.columns, len(plan.channels), 1, 1, 1.0, 1.0, "x", 0, (("none", 1.0),))


def main() -> None:
    found = list(rows("--fine" in sys.argv))
    for table in (bounds_table(found), spread_table(found), times_table("paper-32")):
        print("\n".join(table), end="\n\n")


if __name__ == "__main__":
    main()
