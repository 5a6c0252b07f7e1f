"""Measure docs/recoil.md's tables of signs: WAV files stepped in time from their bytes, and frames one after the other.

`python docs/measure_signs.py` prints them; `tests/pad_stepper.py` steps.
"""

import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

sys.path.insert(0, str(Path(__file__).parents[1]))

import padgen as pg
from padgen.driver.frames import text_frames
from padgen.driver.signs import PlayedPad, choose_signs, played_recoil
from padgen.driver.waveform import RATES_HZ, drive_at
from padgen.physics import recoil
from padgen.planner.plan import Plan, plan_to_json
from padgen.planner.shaken_pad import pad_recoil, random_images
from tests.pad_stepper import stepped_wave

FILES = ("paper-16", "pad-32", "quad-64", "triple-48")
SEQUENCES = ("paper-16", "paper-pair", "pad-32", "quad-64", "triple-48")
TURNS = (np.inf, 1.0, 0.5, 0.1, 0.0)
"""Shares of a taxel's recoil by which a kept sign must lower the rest to turn."""


def stepped_db(plan: Plan, frame: np.ndarray, folder: Path) -> float:
    """Return the smallest ON over the largest OFF amplitude in dB in the last period of a WAV of one frame."""
    sidecar = json.loads((folder / "drive-wave.json").read_text())
    table = json.loads(plan_to_json(replace(plan, recoil=pad_recoil(plan, images=1))))
    rate, motion = stepped_wave(table, folder / "drive.wav", sidecar["full_scale"])
    lowest = min(channel.resonance_hz for channel in plan.channels)
    motion = sosfiltfilt(butter(4, lowest / 2, "high", fs=rate, output="sos"), motion)
    stop = round(sidecar["frame_s"] * rate)
    level = np.sqrt((motion[:, stop - round(sidecar["period_s"] * rate) : stop] ** 2).mean(1))
    return float(20 * np.log10(level[frame > 0].min() / level[frame <= 0].max()))


def changing(plan: Plan, share: float, count: int = 60) -> np.ndarray:
    """Return frames by chance, of which a share of the taxels changes from one to the next."""
    rng = np.random.default_rng(1)
    frames = [(rng.random(len(plan.taxels)) < 0.5).astype(float)]
    for _ in range(count - 1):
        frames.append(np.abs(frames[-1] - (rng.random(len(plan.taxels)) < share)))
    return np.array(frames)


def main() -> None:
    """Print a row for each file, then rows for each template's frames."""
    print("| template | ON | signs | stated, dB | stepped − stated, dB | heard − stepped, dB | heard, held still, dB |")
    print("|---|---|---|---|---|---|---|")
    for name in FILES:
        plan = pg.plan(name)
        pad = PlayedPad(plan, drive_at(plan, RATES_HZ))
        pad.leak[:] = 0.0
        for frame in random_images(len(plan.taxels), 4, seed=7)[2:]:
            with tempfile.TemporaryDirectory() as place:
                driven = pg.drive(plan, frames=frame[None], seconds=1.6).save_folder(Path(place), ("wav",), hear=True)
                stepped = stepped_db(plan, frame, Path(place))
            stated = played_recoil(pad, frame[None], choose_signs(pad, frame[None]))
            heard = driven.heard
            assert heard is not None and stated.signed_db is not None and heard.shaken_db is not None
            print(
                f"| {name} | {int(frame.sum())} of {len(frame)} | chosen ({stated.in_step_db:.1f} dB in step)"
                f" | {stated.signed_db:.2f} | {stepped - stated.signed_db:+.2f} | {heard.shaken_db - stepped:+.2f}"
                f" | {heard.selectivity_db:.1f} |",
                flush=True,
            )
    heads = " | ".join("never" if np.isinf(turn) else f"{turn:g}" for turn in TURNS)
    print(f"\n| template | frames | held still, dB | in step, dB | {heads} |\n|---|---|---|---|{'---|' * len(TURNS)}")
    for name in SEQUENCES:
        plan = pg.plan(name)
        pad = PlayedPad(plan, drive_at(plan, RATES_HZ))
        for what, frames in (("text", text_frames(plan, "padgen 8")), ("chance, 15 % change", changing(plan, 0.15))):
            cells = []
            for turn in TURNS:
                recoil.TURN = min(turn, 1e9)
                found = played_recoil(pad, frames, choose_signs(pad, frames))
                stays = int(((frames[1:] > 0) & (frames[:-1] > 0)).sum())
                cells.append(f"{found.signed_db:.1f} ({found.turned / stays:.0%})")
            row = f"| {name} | {what} | {found.clamped_db:.1f} | {found.in_step_db:.1f} | {' | '.join(cells)} |"
            print(row, flush=True)


if __name__ == "__main__":
    main()
