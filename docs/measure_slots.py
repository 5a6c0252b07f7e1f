"""Measure docs/frames.md's table: contrast over frames' slots, as stated and by an integration of the WAV's bytes.

`python docs/measure_slots.py` prints the table; `tests/slot_integrator.py` integrates, and shares no code with padgen.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import padgen as pg
from padgen.driver.drive_folder import levels_of
from tests.slot_integrator import slot_contrast_db

PADS = ("paper-32", "pad-32", "triple-48", "quad-64", "wide-11")
PATTERNS = ("each", "rows", "columns", "checkerboard", "sweep")
TEXTS = ("HI", "A", "OK", "GO", "NO", "42", "7", "X", "UP", "E", "M", "W8", "TO", "S", "Q")


def main() -> None:
    """Print a row for each pad, with and without a brake."""
    print("| pad | drive | brake | frame, s | shown | stated, dB | integrated − stated, dB | heard − integrated, dB |")
    print("|---|---|---|---|---|---|---|---|")
    for name in PADS:
        plan = pg.plan(name)
        asked: list[dict[str, Any]] = [{"pattern": one} for one in PATTERNS] + [{"text": one} for one in TEXTS]
        for brake in (False, True):
            stated = []
            integrated = []
            heard = []
            frame_s = 0.0
            for shown in asked:
                with TemporaryDirectory() as folder:
                    driven = pg.drive(plan, **shown, brake=brake).save(folder, formats=("wav",), hear=True)
                    if driven.contrast is None or driven.heard is None or driven.heard.slot_contrast is None:
                        continue
                    frame_s = driven.contrast.frame_s
                    frames = levels_of(plan, None, **shown)
                    slots, _ = slot_contrast_db(plan, frames, frame_s, Path(folder))
                    stated.append(driven.contrast.slot_db)
                    integrated.append(np.nanmin(slots))
                    heard.append(driven.heard.slot_contrast[0])
                    print(name, brake, shown, stated[-1], integrated[-1], heard[-1], file=sys.stderr, flush=True)
            off = np.subtract(integrated, stated)
            ear = np.subtract(heard, integrated)
            print(
                f"| {name} | {plan.scheme.name} | {'yes' if brake else 'no'} | {frame_s:.3f}"
                f" | {len(off)}"
                f" | {min(stated):.1f} … {max(stated):.1f} | {off.min():+.2f} … {off.max():+.2f}"
                f" | {ear.min():+.2f} … {ear.max():+.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
