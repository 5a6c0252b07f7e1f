"""Measure the figures of docs/retune.md, on how well a measured print is re-tuned, and print Markdown.

`python docs/measure_retune.py [PRINTS]` compares prints whose resonances are known with other models.
`python docs/measure_retune.py recordings [COUNT [EXCITATION …]]` measures the fits of disturbed recordings
(`tests/recordings.py`), `python docs/measure_retune.py loop [PRINTS]` the WAVs of prints that were recorded so and
re-tuned (`tests/retuned_loop.py`), `python docs/measure_retune.py eye` what a stroboscope tells, `python
docs/measure_retune.py big` time and memory of `padgen retune` with the largest files.
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from scipy.io import wavfile

import padgen as pg
from padgen.core.errors import PadgenError
from padgen.measured.fits import TaxelFit, fit_measured
from padgen.measured.read import read_measured
from padgen.measured.tune import estimated, tuning_of
from padgen.measured.tuning import (
    TunedTaxel,
    Tuning,
    levels_um,
    planned_tuning,
    predicted,
    simulate_print,
    tones_at,
    worst_db,
)
from padgen.physics.resonator import relative_energy
from padgen.physics.selectivity import Channels, Scheme, off_energy
from padgen.planner import Plan, make_plan
from padgen.planner.plan import scheme_named
from padgen.planner.print_yield import print_yield
from padgen.planner.printed_pads import coils_of
from padgen.spec import load_spec

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.recordings import KINDS, recorded
from tests.retuned_loop import by_truth, kept_db, record, spreads_for

PRINTS = 1000
SIGMA = 0.08


def plan_of(name: str, drive: str = "auto") -> Plan:
    spec = load_spec(name)
    return make_plan(replace(spec, drive=replace(spec.drive, scheme=drive)))


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
            before = predicted(plan, truth, tones_at(plan, planned_tuning(plan)), planned_um)
            dbs.append((worst_db(before), worst_db(predicted(plan, truth, tones_at(plan, truth)))))
        before_db, after_db = np.array(dbs, float).T
        after = result.retuned
        here = np.quantile(after_db, [0.05, 0.5, 0.95])
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
        errors = []
        stated = []
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
        spreads = spreads_for(plan, SIGMA)
        scheme = scheme_named(plan.spec, drive)
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
    hz = tones.hz[index]
    line = tones.line_a2[index]
    q = np.array([truth.taxels[i].q for i in index])
    which = Channels(hz[:, None], q[:, None], line[:, None])

    def tried(by: np.ndarray) -> tuple[float, np.ndarray]:
        tone = hz * np.exp(by / (2 * q))
        strength = line / np.sqrt(relative_energy(tone, hz, q))
        off = off_energy(which, scheme, drivers=Channels(tone[:, None], q[:, None], strength[:, None]))
        return float(-10 * np.log10(off.max())), strength

    best = tried(np.zeros(len(hz)))[0]
    by = np.zeros(len(hz))
    step = 1.0
    base = best
    while step > 0.02:
        moves = [(j, sign) for j in range(len(hz)) for sign in (1, -1)]
        better = False
        for j, sign in moves:
            other = by.copy()
            other[j] = np.clip(other[j] + sign * step, -3, 3)
            db, _ = tried(other)
            if db > best + 1e-6:
                best = db
                by = other
                better = True
        step = step if better else step / 2
    return base, best - base, float(10 * np.log10(tried(by)[1].sum() / line.sum()))


def recordings(count: int, excitations: list[str]) -> Iterator[str]:
    """Yield errors, coverage and run time of fits to recordings of one taxel, f and Q spread by 15 % and 25 %."""
    yield "| excitation, disturbance | fitted | error of f, median, worst | of Q | within 1.96 sigma, f, Q | s |"
    yield "|---|---|---|---|---|---|"
    plan = plan_of("paper-32")
    with ProcessPoolExecutor() as pool:
        for excitation in excitations:
            for kind, how in KINDS.items():
                fit = partial(fitted_recording, plan, excitation, how)
                yield f"| {excitation}, {kind} | {recorded_row(list(pool.map(fit, range(count), chunksize=20)))} |"


def benched(rng: np.random.Generator, excitation: str, how: dict) -> dict:
    """Return the arguments `how` of `recorded` on a usual bench.

    Gains drift by 3 % (one sigma) where no drift is stated. Clocks are off by up to 100 ppm each: the recorder's and
    that of the player to come where a taxel is plucked, and the two devices' where there is a delay between both.
    """
    usual: dict = {"rate": 4000, "drift": 0.03 * rng.standard_normal()}
    if excitation.startswith("pluck") or "delay_s" in how:
        usual["clock_ppm"] = float(rng.uniform(-100, 100, 2).sum())
    if excitation == "pluck":
        usual["seconds"] = 3.0
    if excitation == "plucks":
        usual |= {"seconds": 1.5, "taps": 12}
    return {**usual, **how}


def fitted_recording(plan: Plan, excitation: str, how: Any, seed: int) -> tuple[Any, str, float]:
    """Return true, found f and Q and their sigmas (3, 2) of a recording, or why it was refused, and seconds taken."""
    rng = np.random.default_rng(seed)
    true = 60 * np.exp(0.15 * rng.standard_normal()), 15 * np.exp(0.25 * rng.standard_normal())
    bench = benched(rng, excitation, how)
    made = recorded(rng, (true[0],), (true[1],), excitation=excitation, mains=(50.0, 60.0)[seed % 2], **bench)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r0c0k0.wav"
        path.write_bytes(made.wav())
        start = process_time()
        try:
            (fit,) = fit_measured(read_measured(path, plan), plan)
        except PadgenError as error:
            return None, str(error), process_time() - start
        seconds = process_time() - start
    return (true, (fit.resonance_hz, fit.q), (fit.resonance_error_hz, fit.q_error)), "", seconds


def recorded_row(results: list[tuple[Any, str, float]]) -> str:
    """Return counts, errors, coverage and time of `fitted_recording`s."""
    count = len(results)
    seconds = np.mean([seconds for _, _, seconds in results])
    fits = np.array([found for found, _, _ in results if found is not None], float)
    if not len(fits):
        return f"0 of {count} | | | | {seconds:.2f}"
    true, found, sigma = np.moveaxis(fits, 1, 0)
    error = np.abs(found / true - 1)
    within = (np.abs(found - true) < 1.96 * sigma).mean(0)
    middle = np.median(error, axis=0)
    worst = error.max(0)
    return (
        f"{len(fits)} of {count} | {middle[0]:.3%}, {worst[0]:.2%} | {middle[1]:.1%}, {worst[1]:.1%} |"
        f" {within[0]:.1%}, {within[1]:.1%} | {seconds:.2f}"
    )


def biggest() -> Iterator[str]:
    """Yield processor time and memory of `padgen retune` with files at the limits of what is read."""
    yield "| file | MB | taxels | processor time, s | s a taxel | memory, MB |"
    yield "|---|---|---|---|---|---|"
    plan = plan_of("paper-32")
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for what, rate, seconds, ids in (
            ("WAV, chirp, all taxels", 48000, 80, [t.id for t in plan.taxels]),
            ("WAV, noise, all taxels", 48000, 80, [t.id for t in plan.taxels]),
            ("WAV, pluck, all taxels", 48000, 80, [t.id for t in plan.taxels]),
            ("WAV, chirp, one taxel", 96000, 290, ["r0c0k0"]),
            ("WAV, noise, one taxel", 96000, 290, ["r0c0k0"]),
            ("CSV, chirp, one taxel", 8000, 120, ["r0c0k0"]),
            ("CSV, chirp, 8 taxels", 8000, 60, [t.id for t in plan.taxels][:8]),
        ):
            kind, excitation, _ = (part.strip() for part in what.split(","))
            made = recorded(rng, (60.0,), (15.0,), excitation=excitation, rate=rate, seconds=float(seconds), hum=0.01)
            each = [made.motion / np.abs(made.motion).max()] * len(ids)
            first = [] if made.reference is None else [made.reference / np.abs(made.reference).max()]
            columns = np.stack([*first, *each], 1)
            path = folder / f"{ids[0] if len(ids) == 1 else 'all'}.{kind.lower()}"
            if kind == "WAV":
                wavfile.write(path, rate, np.round(30000 * columns).astype(np.int16))
            else:
                time = np.arange(len(columns))[:, None] / rate
                heads = ",".join(["time_s", "current_a", *ids])
                np.savetxt(path, np.hstack([time, columns]), "%.9g", ",", header=heads, comments="")
            command = ["padgen", "retune", plan.name, str(path), "-o", str(folder / "out"), "--nearest"]
            ran = subprocess.run([sys.executable, "-c", USED, sys.executable, "-m", *command], stdout=-1, check=True)
            taken, most = (float(word) for word in ran.stdout.split())
            yield (
                f"| {what} | {path.stat().st_size / 1e6:.0f} | {len(ids)} | {taken:.1f} | {taken / len(ids):.2f} |"
                f" {most / 1e3:.0f} |"
            )
            path.unlink()


USED = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
"""
"""Runs a command from a small process, whose memory does not count as the command's."""


SWING_READ = 0.05
STEPS = 8
FALLEN = 0.7
"""One sigma of a swing that is read by eye, over the largest; tones in a bandwidth; the swing at both sides."""


def by_eye(count: int = 10_000) -> str:
    """Return errors of f and Q that are read off by a stroboscope: the middle of both sides where the swing is 70 %."""
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(count):
        q = 15 * np.exp(0.25 * rng.standard_normal())
        f = 1 + (np.arange(-3 * STEPS, 3 * STEPS) + rng.uniform()) / (STEPS * q)
        swing = 1 / np.hypot(1, q * (f - 1 / f)) + SWING_READ * rng.standard_normal(len(f))
        top = int(swing.argmax())
        low = swing < FALLEN * swing.max()
        below = f[:top][low[:top]][-1]
        above = f[top:][low[top:]][0]
        below = below + 0.5 / (STEPS * q)
        above = above - 0.5 / (STEPS * q)
        hz = np.sqrt(below * above)
        errors.append((hz - 1, hz * np.sqrt(FALLEN**-2 - 1) / (above - below) / q - 1))
    error = np.abs(errors)
    middle = np.median(error, 0)
    most = np.quantile(error, 0.95, axis=0)
    return f"f {middle[0]:.2%}, 95 % within {most[0]:.1%}; Q {middle[1]:.0%}, {most[1]:.0%}"


LOOPS = (
    ("pad-32", "spur-free"),
    ("paper-32", "spur-free"),
    ("triple-48", "spur-free"),
    ("quad-64", "spur-free"),
    ("quad-64", "biased"),
    ("resin-fine", "spur-free"),
)
"""Templates and drives of which prints are recorded, re-tuned and heard."""


def loops(prints: int) -> Iterator[str]:
    """Yield what the WAV of a re-tuned print keeps, by integration of its bytes, against true f and Q."""
    yield "| pad, drive | coils | planned tones, dB | re-tuned, dB | by true f and Q, dB | lost, median, worst, dB |"
    yield "|---|---|---|---|---|---|"
    for name, scheme in LOOPS:
        plan = plan_of(name, scheme)
        rows: list[Any] = []
        places = sorted(coils_of(plan))
        for seed in range(prints):
            rng = np.random.default_rng(seed)
            truth = simulate_print(plan, seed)
            coils = [places[k] for k in rng.choice(len(places), 2, replace=False)]
            with tempfile.TemporaryDirectory() as name_of:
                folder = Path(name_of)
                record(plan, truth, coils, folder, rng, **KINDS["all at once"])
                tuned = pg.retune(plan, sorted(folder.iterdir()), nearest=True).tuning
                rows += zip(
                    *(
                        kept_db(plan, each, truth, coils, folder)
                        for each in (planned_tuning(plan), tuned, by_truth(plan, truth))
                    ),
                    strict=True,
                )
        planned, after, best = np.array(rows).T
        lost = best - after
        yield (
            f"| {name}, {scheme} | {len(rows)} | {np.median(planned):.1f} | {np.median(after):.2f} |"
            f" {np.median(best):.2f} | {np.median(lost):.3f}, {lost.max():.3f} |"
        )


def main() -> None:
    if sys.argv[1:2] == ["recordings"]:
        excitations = sys.argv[3:] or ["chirp", "noise", "pluck"]
        for line in recordings(int(sys.argv[2]) if len(sys.argv) > 2 else 200, excitations):
            print(line, flush=True)
        return
    if sys.argv[1:2] == ["big"]:
        for line in biggest():
            print(line, flush=True)
        return
    if sys.argv[1:2] == ["eye"]:
        print(by_eye())
        return
    if sys.argv[1:2] == ["loop"]:
        for line in loops(int(sys.argv[2]) if len(sys.argv) > 2 else 20):
            print(line, flush=True)
        return
    prints = int(sys.argv[1]) if len(sys.argv) > 1 else PRINTS
    sections = {
        "Re-tuned pads by `padgen plan --yield`": yields(prints),
        "Taxels that were not measured": rest(),
        "Tones beside the resonances": shifting(),
    }
    for title, lines in sections.items():
        print(f"## {title}\n", *lines, "", sep="\n")


if __name__ == "__main__":
    main()
