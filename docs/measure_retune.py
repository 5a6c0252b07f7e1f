"""Measure the figures of docs/retune.md, on how well a measured print is re-tuned, and print Markdown.

`python docs/measure_retune.py [PRINTS]`; 1,000 prints of two pads take a while, mostly for the fits.
`python docs/measure_retune.py recordings [COUNT]` measures the fits of disturbed recordings (`tests/recordings.py`).
"""

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from padgen.core.errors import PadgenError
from padgen.measured.fits import TaxelFit, fit_measured
from padgen.measured.predict import CoilFigures, levels_um, planned_tones, predicted, tones_at, worst_db
from padgen.measured.read import read_measured, read_measured_text
from padgen.measured.simulate import simulate_print, simulated_measurement, spreads_for
from padgen.measured.tune import estimated, tuning_of
from padgen.measured.tuning import TunedTaxel, Tuning
from padgen.physics.resonator import relative_energy
from padgen.physics.selectivity import Channels, Scheme, off_energy
from padgen.planner import Plan, make_plan
from padgen.planner.print_yield import print_yield
from padgen.planner.printed_pads import coils_of
from padgen.planner.settings import scheme_named
from padgen.spec import load_spec

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.recordings import KINDS, recorded

PRINTS = 1000
SIGMA = 0.08
SNR_DB = 30.0
WHICH = ("planned tones", "re-tuned by the fits", "by the truth")
BARS = " ▁▂▃▄▅▆▇█"


def plan_of(name: str, drive: str = "auto") -> Plan:
    spec = load_spec(name)
    return make_plan(replace(spec, drive=replace(spec.drive, scheme=drive)))


def one_coil(plan: Plan, place: tuple[int, int]) -> set[str]:
    return {taxel.id for taxel in plan.taxels if taxel.coil == place}


def of_coil(figures: tuple[CoilFigures, ...], place: tuple[int, int]) -> float:
    return next(c.all_states_db or np.inf for c in figures if (c.row, c.column) == place)


class Tried:
    """Prints that were measured and re-tuned: one coil of each, in turn."""

    def __init__(self, plan: Plan, prints: int, kind: str = "spectrum") -> None:
        self.errors: list[float] = []
        self.pulls: list[float] = []
        self.q_errors: list[float] = []
        self.db: list[tuple[float, float, float]] = []
        spreads, places = spreads_for(plan, SIGMA), sorted(coils_of(plan))
        for seed in range(prints):
            truth, place = simulate_print(plan, seed, spreads), places[seed % len(places)]
            self._add(plan, truth, seed, place, kind)

    def _add(self, plan: Plan, truth: Tuning, seed: int, place: tuple[int, int], kind: str) -> None:
        measured = read_measured_text(simulated_measurement(plan, truth, seed, kind, SNR_DB), plan)
        ids = one_coil(plan, place)
        fits = fit_measured(replace(measured, taxels=tuple(t for t in measured.taxels if t.id in ids)), plan)
        known = {taxel.id: taxel for taxel in truth.taxels}
        for fit in fits:
            true = known[fit.id]
            self.errors.append(fit.resonance_hz / true.resonance_hz - 1)
            self.pulls.append((fit.resonance_hz - true.resonance_hz) / fit.resonance_error_hz)
            self.q_errors.append(fit.q / true.q - 1)
        planned_um = levels_um(plan, np.array([plan.channels[t.channel].resonance_hz for t in plan.taxels]))
        before = predicted(plan, truth, planned_tones(plan), planned_um)
        after = predicted(plan, truth, tones_at(plan, tuning_of(plan, fits)))
        best = predicted(plan, truth, tones_at(plan, truth))
        self.db.append((of_coil(before, place), of_coil(after, place), of_coil(best, place)))


def histogram(values: np.ndarray, low: float, high: float, bins: int = 24) -> str:
    count, _ = np.histogram(np.clip(values, low, high), bins, (low, high))
    return "".join(BARS[int(np.ceil(8 * c / count.max()))] for c in count)


def retuning(tried: dict[str, Tried]) -> list[str]:
    lines = [
        "| pad | taxels fitted | error of f, median, 95 % | error of Q, median | errors over stated sigma, rms |"
        " planned tones, dB | re-tuned by the fits, dB | by the truth, dB | given away, median, 95 %, dB |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, one in tried.items():
        error, q_error, pulls = np.abs(one.errors), np.abs(one.q_errors), np.array(one.pulls)
        before, after, best = np.array(one.db).T
        lost = best - after
        lines.append(
            f"| {name} | {len(error)} | {np.median(error):.3%}, {np.quantile(error, 0.95):.3%} |"
            f" {np.median(q_error):.2%} | {np.sqrt((pulls**2).mean()):.2f} | {np.median(before):.1f} |"
            f" {np.median(after):.2f} | {np.median(best):.2f} | {np.median(lost):.3f}, {np.quantile(lost, 0.95):.3f} |"
        )
    return lines


def histograms(tried: dict[str, Tried]) -> list[str]:
    lines = ["| pad, a coil of each print | 0 … 30 dB in all states | 5 %, median, 95 % dB |", "|---|---|---|"]
    for name, one in tried.items():
        for which, db in zip(
            ("planned tones", "re-tuned by the fits", "by the truth"), np.array(one.db).T, strict=True
        ):
            low, middle, high = np.quantile(db, [0.05, 0.5, 0.95])
            lines.append(f"| {name}, {which} | `{histogram(db, 0, 30)}` | {low:.1f}, {middle:.1f}, {high:.1f} |")
        lost = np.subtract(*np.array(one.db).T[[2, 1]])
        lines.append(f"| {name}, given away by the fits, 0 … 0.5 dB | `{histogram(lost, 0, 0.5)}` | |")
    return lines


def yields(prints: int) -> list[str]:
    """Compare whole pads by `print_yield`, without scatter of Q and pull and other modes, with `predicted`."""
    lines = [
        "| pad | planned tones: `--yield`, here, median dB of pads | re-tuned: `--yield`, here, 5 %, median, 95 % dB |",
        "|---|---|---|",
    ]
    for name in ("paper-32", "quad-64"):
        plan = plan_of(name)
        spreads = spreads_for(plan, SIGMA)
        result = print_yield(plan, 20_000, spreads=spreads)
        planned_um = levels_um(plan, np.array([plan.channels[t.channel].resonance_hz for t in plan.taxels]))
        dbs = []
        for seed in range(prints):
            truth = simulate_print(plan, seed, spreads)
            before = predicted(plan, truth, planned_tones(plan), planned_um)
            dbs.append((worst_db(before), worst_db(predicted(plan, truth, tones_at(plan, truth)))))
        before_db, after_db = np.array(dbs, float).T
        after, here = result.retuned, np.quantile(after_db, [0.05, 0.5, 0.95])
        lines.append(
            f"| {name} | {result.planned.median_db:.1f}, {np.median(before_db):.1f} |"
            f" {after.q05_db:.1f}, {after.median_db:.1f}, {after.q95_db:.1f};"
            f" {here[0]:.1f}, {here[1]:.1f}, {here[2]:.1f} |"
        )
    return lines


def rest(prints: int = 200) -> list[str]:
    """Return how well a few measured taxels, or a coupon, predict the others."""
    lines = [
        "| paper-32, catalogue's spreads | taxels measured | error of the other resonances, rms | stated |",
        "|---|---|---|---|",
    ]
    plan = plan_of("paper-32")
    for name, places in (("none", ()), ("one coil", ((1, 1),)), ("a coil in each corner", CORNERS), ("coupon", None)):
        errors, stated = [], []
        for seed in range(prints):
            truth = simulate_print(plan, seed)
            known = [fit_of(t) for t, p in zip(truth.taxels, plan.taxels, strict=True) if p.coil in (places or ())]
            coupon = {}
            if places is None:
                # Taxels of the pad itself stand in for a coupon's.
                coupon = {p.channel: fit_of(t) for t, p in zip(truth.taxels, plan.taxels, strict=True)}
            tuning = estimated(plan, tuning_of(plan, known), known, coupon)
            left = [k for k, t in enumerate(tuning.taxels) if not t.measured]
            left = left[:-2] if places is None else left
            errors += [tuning.taxels[k].resonance_hz / truth.taxels[k].resonance_hz - 1 for k in left]
            stated += [tuning.taxels[k].resonance_error_hz / tuning.taxels[k].resonance_hz for k in left]
        told = len(known) if known else 2 * (places is None)
        rms = np.sqrt(np.mean(np.square(errors))), np.sqrt(np.mean(np.square(stated)))
        lines.append(f"| {name} | {told} | {rms[0]:.1%} | {rms[1]:.1%} |")
    return lines


CORNERS = ((0, 0), (0, 3), (3, 0), (3, 3))


def fit_of(taxel: TunedTaxel) -> TaxelFit:
    return TaxelFit(
        taxel.id, taxel.resonance_hz, 1e-4 * taxel.resonance_hz, taxel.q, 0.1, None, None, True, True, None, ()
    )


def shifting(prints: int = 60) -> list[str]:
    """Return the gain of tones beside the resonances, by coordinate search for each print with levels restored."""
    lines = [
        "| pad, drive | on the resonances, median dB | gain, median, 95 %, most, dB | more square of the current, dB |",
        "|---|---|---|---|",
    ]
    for name, drive in (("paper-32", "tones"), ("quad-64", "biased"), ("quad-64", "spur-free"), ("quad-64", "tones")):
        plan = plan_of(name, drive)
        spreads, scheme = spreads_for(plan, SIGMA), scheme_named(plan.spec, drive)
        rows = [shifted(plan, simulate_print(plan, seed, spreads), scheme) for seed in range(prints)]
        base, gain, price = np.array(rows).T
        lines.append(
            f"| {name}, {drive} | {np.median(base):.1f} | {np.median(gain):.2f}, {np.quantile(gain, 0.95):.2f},"
            f" {gain.max():.2f} | {np.median(price):.2f} |"
        )
    return lines


def shifted(plan: Plan, truth: Tuning, scheme: Scheme) -> tuple[float, float, float]:
    """Return the first coil's dB with tones on the resonances, the dB gained by moving them, and the current's dB."""
    index = coils_of(plan)[(0, 0)]
    tones = tones_at(plan, truth)
    hz, line = tones.hz[index], tones.line_a2[index]
    q = np.array([truth.taxels[i].q for i in index])
    which = Channels(hz[:, None], q[:, None], line[:, None])

    def tried(by: np.ndarray) -> tuple[float, np.ndarray]:
        tone = hz * np.exp(by / (2 * q))
        strength = line / np.sqrt(relative_energy(tone, hz, q))
        off = off_energy(which, scheme, drivers=Channels(tone[:, None], q[:, None], strength[:, None]))
        return float(-10 * np.log10(off.max())), strength

    best, by, step = tried(np.zeros(len(hz)))[0], np.zeros(len(hz)), 1.0
    base = best
    while step > 0.02:
        moves = [(j, sign) for j in range(len(hz)) for sign in (1, -1)]
        better = False
        for j, sign in moves:
            other = by.copy()
            other[j] = np.clip(other[j] + sign * step, -3, 3)
            db, _ = tried(other)
            if db > best + 1e-6:
                best, by, better = db, other, True
        step = step if better else step / 2
    return base, best - base, float(10 * np.log10(tried(by)[1].sum() / line.sum()))


def recordings(count: int) -> Iterator[str]:
    """Yield errors, coverage and run time of fits to recordings of one taxel, f and Q spread by 15 % and 25 %."""
    yield "| excitation, disturbance | fitted | error of f, median, worst | of Q | within 1.96 sigma, f, Q | s |"
    yield "|---|---|---|---|---|---|"
    plan = plan_of("paper-32")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r0c0k0.wav"
        for excitation in ("chirp", "noise", "pluck"):
            for kind, how in KINDS.items():
                yield f"| {excitation}, {kind} | {recorded_row(plan, path, excitation, how, count)} |"


def recorded_row(plan: Plan, path: Path, excitation: str, how: Any, count: int) -> str:
    errors, pulls, seconds = [], [], 0.0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        true = np.array([60 * np.exp(0.15 * rng.standard_normal()), 15 * np.exp(0.25 * rng.standard_normal())])
        length = 3.0 if excitation == "pluck" else 8.0
        made = recorded(
            rng, (true[0],), (true[1],), excitation=excitation, seconds=length, mains=(50.0, 60.0)[seed % 2], **how
        )
        path.write_bytes(made.wav())
        start = process_time()
        try:
            (fit,) = fit_measured(read_measured(path, plan), plan)
            found, sigma = np.array([(fit.resonance_hz, fit.q), (fit.resonance_error_hz, fit.q_error)])
            errors.append(np.abs(found / true - 1))
            pulls.append(np.abs(found - true) / sigma)
        except PadgenError:
            pass
        seconds += process_time() - start
    if not errors:
        return f"0 of {count} | | | | {seconds / count:.2f}"
    middle, worst = np.median(errors, axis=0), np.max(errors, axis=0)
    within = (np.array(pulls) < 1.96).mean(0)
    return (
        f"{len(errors)} of {count} | {middle[0]:.3%}, {worst[0]:.2%} | {middle[1]:.1%}, {worst[1]:.1%} |"
        f" {within[0]:.0%}, {within[1]:.0%} | {seconds / count:.2f}"
    )


def main() -> None:
    if sys.argv[1:2] == ["recordings"]:
        for line in recordings(int(sys.argv[2]) if len(sys.argv) > 2 else 60):
            print(line, flush=True)
        return
    prints = int(sys.argv[1]) if len(sys.argv) > 1 else PRINTS
    tried = {name: Tried(plan_of(name), prints) for name in ("paper-32", "quad-64")}
    for kind in ("chirp", "pluck"):
        tried[f"paper-32, {kind}"] = Tried(plan_of("paper-32"), max(prints // 5, 1), kind)
    sections = {
        f"{prints} prints of a pad, resonances scattered by {SIGMA:.0%}, spectra at {SNR_DB:.0f} dB": retuning(tried),
        "One coil of each print": histograms(tried),
        "The same by `padgen plan --yield`": yields(prints),
        "Taxels that were not measured": rest(),
        "Tones beside the resonances": shifting(),
    }
    for title, lines in sections.items():
        print(f"## {title}\n", *lines, "", sep="\n")


if __name__ == "__main__":
    main()
