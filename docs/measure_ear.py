"""Print the tables of docs/ear.md: what fingers feel of written files, against the plan (a few minutes, one core).

Every file is written as a 24-bit WAV and read back by the ear, with its sidecar.
"""

import json
import resource
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from padgen.core.wav_reader import read_wav
from padgen.driver.ear import Heard, hear
from padgen.driver.formats.wav import wave_json, write_wave
from padgen.driver.waveform import PadDrive, Timeline, frame_s, make_drive, ramp_s, steady, timeline
from padgen.physics.resonator import felt_energy
from padgen.physics.selectivity import all_states
from padgen.planner import make_plan
from padgen.planner.channels import coil_modes
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.plan import Plan
from padgen.spec import Spec, load_spec, parse_spec, template_paths

RATE_HZ = 48000
MOST_SPELLED_OUT = 6
RANDOM_STATES = 200


def row(*cells: object) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def db(ratio: float) -> float:
    return float(20 * np.log10(ratio))


def heard_from_file(plan: Plan, drive: PadDrive, line: Timeline, gap: bool = False) -> Heard:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "drive.wav"
        report = write_wave(path, drive, line)
        sidecar: dict[str, Any] = json.loads(wave_json(plan, drive, line, report))
        return hear(plan, read_wav(path), sidecar, gap=gap)


def states_of(plan: Plan) -> np.ndarray:
    """Return states (s, n) of a coil: all of them, or random ones and the plan's worst."""
    n = len(plan.sets[0])
    if n <= MOST_SPELLED_OUT:
        return (np.arange(2**n)[:, None] >> np.arange(n)) & 1
    spec = plan.spec
    own = plan.sets[0]
    scheme = plan.scheme
    worst = all_states(placed_channels(spec, own), scheme, coil_modes(spec, own)).state
    random = np.random.default_rng(1).random((RANDOM_STATES, n)) < 0.5
    return np.concatenate([random.astype(int), [[int(bit) for bit in worst]]])


def one_at_a_time(plan: Plan) -> np.ndarray:
    return np.eye(len(plan.sets[0]), dtype=int)


def through(plan: Plan, drive: PadDrive, states: np.ndarray) -> list[tuple[np.ndarray, Heard]]:
    """Play files until coils have been in all states, each coil of a file in another state."""
    heard = []
    coils = drive.coils
    for first in range(0, len(states), len(coils)):
        levels = np.zeros(len(plan.taxels))
        for k, coil in enumerate(coils):
            levels[coil.taxels] = states[(first + k) % len(states)][: len(coil.taxels)]
        heard.append((levels, heard_from_file(plan, drive, steady(levels, drive.period_s))))
    return heard


def figures(heard: Sequence[tuple[np.ndarray, Heard]]) -> tuple[float, float]:
    """Return the selectivity over all files in dB, and the largest miss of an ON taxel's own line in dB."""
    on = np.concatenate([h.on.ravel() for _, h in heard])
    off = np.concatenate([h.off.ravel() for _, h in heard])
    tone = np.concatenate([(h.tone_um[0] / h.wanted_um)[levels > 0] for levels, h in heard])
    selectivity = float("nan") if np.isnan(off).all() or not np.nanmax(off) > 0 else db(np.nanmin(on) / np.nanmax(off))
    return selectivity, max(db(tone.max()), db(tone.min()), key=abs)


def number_db(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}"


def templates() -> list[str]:
    lines = [
        "| template (drive) | states | plan, dB | heard, dB | difference | own lines off by at most, dB | s |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in sorted(template_paths()):
        plan = make_plan(load_spec(name))
        drive = make_drive(plan, RATE_HZ)
        states = states_of(plan)
        start = time.process_time()
        found, tone = figures(through(plan, drive, states))
        took = time.process_time() - start
        planned = plan.selectivity.placed_all_states_db
        kind = "all" if len(plan.sets[0]) <= MOST_SPELLED_OUT else "random, and the worst:"
        told = f"{planned:.2f}" if planned is not None else "–"
        miss = f"{found - planned:+.2f}" if planned is not None else "–"
        scheme = plan.selectivity.drive
        lines.append(
            row(
                f"{name} ({scheme})",
                f"{kind} {len(states)}",
                told,
                number_db(found),
                miss,
                f"{tone:+.3f}",
                f"{took:.1f}",
            )
        )
    return lines


def state_by_state() -> str:
    """Compare each state's loudest OFF taxel with the modal model's, for the pad with the most channels."""
    plan = make_plan(load_spec("wide-11"))
    drive = make_drive(plan, RATE_HZ)
    spec = plan.spec
    own = plan.sets[0]
    which = placed_channels(spec, own)
    modes = coil_modes(spec, own)
    tones = felt_energy(modes, slice(None), which.resonance_hz) * (which.line / which.line[:, None]) ** 2
    misses = []
    for levels, heard in through(plan, drive, states_of(plan)):
        for coil in drive.coils:
            on = levels[coil.taxels] > 0
            if on.any() and not on.all():
                expected = np.sqrt(tones @ on)[~on]
                misses.append(db(heard.relative[0, coil.taxels][~on].max() / expected.max()))
    return (
        f"State by state, the loudest OFF taxel of a coil of wide-11 is {min(misses):+.2f} … {max(misses):+.2f} dB off"
        f" what the modal model says ({len(misses)} coils and states)."
    )


def schemes() -> list[str]:
    lines = ["| pad | drive | states | plan, dB | heard, dB | difference |", "|---|---|---|---|---|---|"]
    for name in ("paper-32", "triple-48", "quad-64"):
        spec = load_spec(name)
        for scheme in ("tones", "biased", "spur-free", "time-shared"):
            plan = make_plan(replace(spec, drive=replace(spec.drive, scheme=scheme)))
            states = one_at_a_time(plan) if scheme == "time-shared" else states_of(plan)
            found, _ = figures(through(plan, make_drive(plan, RATE_HZ), states))
            planned = {f.scheme: f for f in plan.selectivity.schemes}[scheme].placed_all_states_db
            assert planned is not None
            told = f"{planned:.2f}", f"{found:.2f}", f"{found - planned:+.2f}"
            lines.append(row(name, scheme, len(states), *told))
    return lines


def pair() -> list[str]:
    plan = make_plan(load_spec("paper-pair"))
    drive = make_drive(plan, RATE_HZ)
    ((_, heard),) = through(plan, drive, states_of(plan))
    lines = [
        "| state | 60 Hz taxel: own line, dB | all that is felt | 78 Hz taxel: own line, dB | all that is felt |",
        "|---|---|---|---|---|",
    ]
    tone = heard.tone_um[0] / heard.wanted_um
    felt = heard.relative[0]
    for state, k in (("10", 1), ("01", 2), ("11", 3)):
        cells = []
        for index, bit in zip(drive.coils[k].taxels, state, strict=True):
            cells += [f"{db(tone[index]):+.2f}" if bit == "1" else "OFF", f"{db(felt[index]):+.2f}"]
        lines.append(row(state, *cells))
    return lines


def sequences() -> list[str]:
    lines = [
        "| pad | drive | frame, s | smallest ON, dB | loudest OFF, dB | selectivity, dB | settled |",
        "|---|---|---|---|---|---|---|",
    ]
    rng = np.random.default_rng(2)
    for name, scheme in (("paper-pair", "auto"), ("quad-64", "auto"), ("wide-11", "auto"), ("quad-64", "time-shared")):
        spec = load_spec(name)
        plan = make_plan(replace(spec, drive=replace(spec.drive, scheme=scheme)))
        drive = make_drive(plan, RATE_HZ)
        frames = (rng.random((4, len(plan.taxels))) < 0.5).astype(float)
        planned = heard_from_file(plan, drive, timeline(plan, frames))
        heard = [(frame_s(plan), planned)]
        if scheme == "auto":
            enough = ramp_s(plan) + planned.needs_s
            heard.append((enough, heard_from_file(plan, drive, timeline(plan, frames, enough))))
        for seconds, each in heard:
            told = f"{db(np.nanmin(each.on)):+.2f}", f"{db(np.nanmax(each.off)):.2f}", f"{each.selectivity_db:.2f}"
            settled = "–" if scheme == "time-shared" else f"{each.settled.mean():.0%}"
            lines.append(row(name, plan.selectivity.drive, f"{seconds:.2f}", *told, settled))
    return lines


def gap() -> list[str]:
    lines = [
        "| pad | level, µm | pull's shift of a resonance, at most | own lines of ON taxels, dB | without, dB |"
        " with the gap, dB | CPU s |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in ("paper-pair", "quad-64", "resin-fine", "wide-11"):
        for times in (1, 4):
            spec: Spec = load_spec(name)
            level_um = times * spec.drive.level_um
            plan = make_plan(replace(spec, drive=replace(spec.drive, level_um=level_um)))
            drive = make_drive(plan, RATE_HZ)
            levels = np.zeros(len(plan.taxels))
            states = states_of(plan)
            for k, coil in enumerate(drive.coils):
                levels[coil.taxels] = states[-1 - k % len(states)]
            line = steady(levels, drive.period_s)
            without = heard_from_file(plan, drive, line)
            start = time.process_time()
            closing = heard_from_file(plan, drive, line, gap=True)
            took = time.process_time() - start
            tone = (closing.tone_um[0] / closing.wanted_um)[levels > 0]
            shift = max(channel.pull_shift for channel in plan.channels)
            assert without.selectivity_db is not None and closing.selectivity_db is not None
            told = f"{db(tone.min()):+.2f} … {db(tone.max()):+.2f}", f"{without.selectivity_db:.2f}"
            pulled = ", pulled in" if closing.pulled_in.any() else ""
            selectivity = f"{closing.selectivity_db:.2f}{pulled}"
            lines.append(row(name, f"{level_um:g}", f"{shift:.2%}", *told, selectivity, f"{took:.1f}"))
    return lines


LARGE = """
name = "large"
resolution = {taxels}
band_hz = [50, 200]
q_min = 15
resonances_hz = [56, 76]
[pad]
width_mm = 100
depth_mm = 100
[coil]
grid = [8, 8]
"""


def cost() -> list[str]:
    """Measure 64 coils of two channels over 10 s at 48 kHz, as planned and as a print of unlike taxels."""
    plan = make_plan(parse_spec(LARGE.format(taxels=128)))
    drive = make_drive(plan, RATE_HZ)
    frames = (np.random.default_rng(3).random((5, len(plan.taxels))) < 0.5).astype(float)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.process_time()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "drive.wav"
        line = timeline(plan, frames, (10 - ramp_s(plan)) / 5)
        report = write_wave(path, drive, line)
        sidecar = json.loads(wave_json(plan, drive, line, report))
        wrote = time.process_time()
        heard = hear(plan, read_wav(path), sidecar)
        done = time.process_time()
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return [
        f"{len(drive.coils)} coils, {len(plan.taxels)} taxels, {report.seconds:.1f} s at {RATE_HZ} Hz: written in"
        f" {wrote - start:.1f} s, heard in {done - wrote:.1f} s (CPU, one core), {more:.0f} MB more memory than before;"
        f" {heard.selectivity_db:.2f} dB.",
    ]


def main() -> None:
    # The cost is measured first, since later tables raise the peak of the memory.
    costs = cost()
    parts = (
        ("Selectivity that files achieve", [*templates(), "", state_by_state()]),
        ("Other drives, same pads", schemes()),
        ("The paper's pair", pair()),
        ("Frames one after the other", sequences()),
        ("The gap that closes", gap()),
        ("What it costs", costs),
    )
    for title, lines in parts:
        print("\n".join([f"## {title}", "", *lines, ""]))


if __name__ == "__main__":
    main()
