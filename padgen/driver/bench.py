"""A session that measures a printed pad: coils play a sweep in turn, and an audio input records the taxels.

A recording has the coil's current, as it is known to be played, and what was heard, so that the files are what ``padgen
retune`` reads. Delay and clock between the two are found by the fit. A file is kept once it is fitted: a session that
was stopped goes on with what is missing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, SolverError, SpecError
from padgen.core.files import OutputFolder, differs, recover
from padgen.core.units import MH
from padgen.driver.excitation import excitation, sweep_table
from padgen.driver.formats.wav import WavWriter
from padgen.driver.loads import excitation_load, judge_load
from padgen.driver.serial_line import BAUD, excite
from padgen.driver.sound_card import AudioDevice, audio_device, record_input
from padgen.measured.fits import TaxelFit, fit_measured
from padgen.measured.read import read_measured
from padgen.measured.shaking import measuring_band_hz, ring_s, sweep_s
from padgen.measured.tuning import Tuning
from padgen.physics.resonance_fit import current_of_voltage
from padgen.planner.plan import Plan, plan_to_json

__all__ = ["RECORDED", "Bench", "bench"]

RECORDED = "recorded"
TRIED = "tried"
"""Folder of the recordings, and in it that of those which could not be fitted."""
LATE_S = 0.5
"""Longest time by which what is heard may come after what is played."""
BELOW_FULL = 0.99
FULL = 0.9999
"""Largest value of the current in a file, which would else look clipped; the value from which an input is."""
KEPT = 16
"""Least samples in a file, over periods of the highest frequency that is measured."""
LONGER = 2.0
"""Factor on a sweep's length with each repetition."""
Told = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Bench:
    """Set-up of a session that measures a print: plan, folder, audio input, and what plays the sweeps.

    The sweeps are played by the output `sink`, or the firmware at `port`, which knows the print by `tuning`.
    """

    plan: Plan
    folder: Path
    source: AudioDevice
    sink: AudioDevice | None
    rate_hz: int
    port: str = ""
    baud: int = BAUD
    tuning: Tuning | None = None

    @property
    def recordings(self) -> Path:
        """The folder of the session's recordings."""
        return self.folder / RECORDED

    @property
    def by_hand(self) -> bool:
        """True where the audio output has fewer channels than coils: the user then plugs each coil into channel 1."""
        return self.sink is not None and self.sink.channels < self.plan.coils.rows * self.plan.coils.columns

    def names(self, by_coil: bool = False) -> tuple[str, ...]:
        """Return the names of the taxels to record or, with `by_coil`, of the coils to record as a whole."""
        if by_coil:
            return tuple(dict.fromkeys(taxel.id.partition("k")[0] for taxel in self.plan.taxels))
        return tuple(taxel.id for taxel in self.plan.taxels)

    def is_kept(self, name: str) -> bool:
        """Return whether a recording of this taxel or coil is there already."""
        return (self.recordings / f"{name}.wav").exists()

    def take(self, name: str, attempt: int, nearest: bool, notify: Told) -> tuple[TaxelFit, ...]:
        """Record the taxel or coil `name` and return its fitted resonances; each `attempt` plays a longer sweep.

        The firmware's sweep has the same length each time. `nearest` is that of `fit_measured`.

        Raises
        ------
        SolverError
            No resonance is seen, and the file is kept aside; or samples were lost. The sentence says what to do.
        FileError
            A device stopped.
        SpecError
            The excitation is beyond a limit, or devices do not go together.
        """
        plan = self.plan
        sink = self.sink
        row, column = next(t.coil for t in plan.taxels if name in (t.id, t.id.partition("k")[0]))
        coil = row * plan.coils.columns + column
        outputs = 1 if self.by_hand else plan.coils.rows * plan.coils.columns
        played: np.ndarray | None = None
        chirp = excitation(plan, "chirp", self.rate_hz, sweep_s(plan) * (1 if sink is None else LONGER**attempt))
        beyond = next(judge_load("", plan, excitation_load(plan, chirp)), None)
        if beyond is not None:
            raise SpecError(f"its excitation is not played: {beyond.message}", plan.name)
        if sink is None:
            volts = sweep_table(plan).voltage_v(self.rate_hz)
            ohms = plan.spec.coil.resistance_ohm
            henries = plan.spec.coil.inductance_mh * MH
            current = current_of_voltage(self.rate_hz, volts, ohms, henries)
            seconds = ring_s(plan) + LATE_S
        else:
            current = chirp.current_a
            seconds = len(chirp.current_a) / self.rate_hz + LATE_S
            played = chirp.voltage_v / plan.spec.drive.voltage_limit_v

        def by_firmware() -> None:
            notify(f"{name}: the firmware plays its sweep")
            excite(self.port, plan, coil, tuning=self.tuning, baud=self.baud)

        heard = record_input(
            self.source,
            self.rate_hz,
            seconds,
            sink,
            played,
            outputs,
            min(coil, outputs - 1),
            by_firmware if sink is None else None,
            lambda done: notify(f"{name}: {done:.1f} s of {max(done, seconds):.1f} s"),
        )
        notify(f"{name}: fitting")
        path = self.folder / RECORDED / TRIED / f"{name}.wav"
        for each in (path.parents[1], path.parent, path.parents[1] / path.name):
            if each.is_symlink():
                raise FileError("is a link, where recordings must be; remove it", str(each))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)  # it may be a link
        # Means over some samples are enough, and do not fill the disk; one that was clipped stays so.
        most = int(self.rate_hz / (KEPT * measuring_band_hz(plan)[1]))
        step = max((k for k in range(1, most + 1) if self.rate_hz % k == 0), default=1)
        parts = np.zeros((max(len(heard), len(current)) // step + 1, step, 2))
        parts.reshape(-1, 2)[: len(current), 0] = current * (BELOW_FULL / np.abs(current).max())
        parts.reshape(-1, 2)[: len(heard), 1] = heard
        kept = parts.mean(1)
        clipped = np.abs(parts[..., 1]).max(1) >= FULL
        kept[clipped, 1] = np.sign(kept[clipped, 1])
        with WavWriter(path, self.rate_hz // step, 2, len(kept), "float") as file:
            file.write(kept)
        try:
            fits = fit_measured(read_measured([path], plan), plan, nearest)
        except FileError as error:
            raise SolverError(error.message, error.where) from error
        path.replace(self.folder / RECORDED / path.name)
        return fits


def bench(
    plan: Plan,
    folder: Path,
    device: str | None = None,
    record: str | None = None,
    rate_hz: int | None = None,
    port: str = "",
    baud: int = BAUD,
    tuning: Tuning | None = None,
) -> Bench:
    """Find the audio devices for a session that measures a print, and create its folder or go on in it.

    `device` and `record` are an output and an input, by number or a part of their names (None: the computer's first
    choice); with a serial `port` the firmware plays instead, as it was written for `tuning`. `rate_hz` None: the
    output's own, or the input's.

    Raises
    ------
    SpecError
        A device is not there.
    FileError
        The folder has recordings of another plan.
    EngineMissingError
        sounddevice or its library PortAudio is not installed.
    """
    sink = None if port else audio_device(device, where="--device")
    try:
        source = audio_device(record, "input", "--record")
    except SpecError as error:
        raise SpecError(
            f"{error.message}; without an input, record by other means, one file a taxel, named as"
            f" {plan.taxels[0].id}.wav in a folder, and give it to padgen retune",
            error.where,
        ) from error
    text = plan_to_json(plan)
    recover(folder)
    if any((folder / RECORDED).glob("*.wav")) and differs(folder, "plan.json", text):
        raise FileError("has recordings of another plan; name another folder with -o", str(folder))
    with OutputFolder(folder) as out:
        out.write("plan.json", text)
        out.commit()
    rate = round((sink or source).rate_hz) if rate_hz is None else rate_hz
    return Bench(plan, folder, source, sink, rate, port, baud, tuning)
