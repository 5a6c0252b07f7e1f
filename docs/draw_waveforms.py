"""Draw docs/waveforms.svg: the current, the voltage and the lines of i² of one coil, plain tones and spur-free."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from padgen.core.display import COLOURS, plot_bytes, plot_style
from padgen.driver.waveform import PadDrive, make_drive, steady, volts
from padgen.planner import make_plan
from padgen.spec import load_spec

RATE_HZ = 48_000
SHOWN_S = 0.1
HIGHEST_HZ = 750.0


def played(scheme: str) -> tuple[PadDrive, np.ndarray, np.ndarray]:
    """Return the drive and one period of the first coil of quad-64, all on: current in A and voltage in V."""
    spec = load_spec("quad-64")
    plan = make_plan(replace(spec, drive=replace(spec.drive, scheme=scheme)))
    drive = make_drive(plan, RATE_HZ)
    line = steady(np.ones(len(plan.taxels)), drive.period_s)
    current, voltage = (
        np.concatenate([block[:, 0] for block in volts(drive, line, signal=signal)])
        for signal in ("current", "voltage")
    )
    return drive, current, voltage


def main() -> None:
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(9, 5), layout="constrained")
        axes = figure.subplots(2, 2, sharex="col")
        for row, (scheme, title) in enumerate((("tones", "plain tones"), ("spur-free", "spur-free"))):
            drive, current, voltage = played(scheme)
            draw_time(axes[row, 0], current, voltage, title)
            draw_lines(axes[row, 1], drive, current, title)
        axes[1, 0].set_xlabel("time, ms")
        axes[1, 1].set_xlabel("frequency of the force, Hz")
    Path(__file__).with_name("waveforms.svg").write_bytes(plot_bytes(figure, "svg"))


def draw_time(axes: Any, current: np.ndarray, voltage: np.ndarray, title: str) -> None:
    """Draw current and voltage over the first part of a period."""
    count = round(SHOWN_S * RATE_HZ)
    time_ms = 1e3 * np.arange(count) / RATE_HZ
    axes.plot(time_ms, 1e3 * current[:count], color=COLOURS[0], lw=1.2)
    axes.set_ylabel("current, mA", color=COLOURS[0])
    axes.set_title(f"{title}: {1e3 * np.sqrt((current**2).mean()):.1f} mA rms", fontsize=9)
    twin = axes.twinx()
    twin.plot(time_ms, voltage[:count], color=COLOURS[4], lw=0.8)
    twin.set_ylabel("voltage, V", color=COLOURS[4])


def draw_lines(axes: Any, drive: PadDrive, current: np.ndarray, title: str) -> None:
    """Draw the lines of i²: wanted ones and spurs."""
    size = 2 * np.abs(np.fft.rfft(current**2)) / len(current)
    hz = np.arange(len(size)) / drive.period_s
    wanted = np.zeros(len(size), bool)
    wanted[drive.coils[0].harmonic] = True
    shown = (hz > 0) & (hz < HIGHEST_HZ) & (size > 1e-5 * size[wanted].min())
    for which, colour, label in ((shown & wanted, COLOURS[2], "wanted"), (shown & ~wanted, COLOURS[1], "spurs")):
        if which.any():
            axes.vlines(hz[which], 1e-3, 1e6 * size[which], color=colour, lw=1.6, label=label)
    axes.set_yscale("log")
    axes.set_ylim(1, 4e3)
    axes.set_ylabel("line of i², mA²")
    axes.set_title(f"{title}: what pulls the washers", fontsize=9)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))


if __name__ == "__main__":
    main()
