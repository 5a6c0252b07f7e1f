"""The firmware compiled for this computer and run by scripts, for the tests of firmware and play."""

import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from padgen.driver.formats.c import FILE, c_header, firmware_files
from padgen.driver.pad_drive import PadDrive, make_drive
from padgen.driver.serial_line import Kind, Message, decode, encode, plan_hash
from padgen.planner import Plan, make_plan
from padgen.spec import load_spec, parse_spec

STRICT = ["-O1", "-Wall", "-Wextra", "-Werror", "-pedantic"]

DRUM = """
resolution = {taxels}
band_hz = [40, 700]
q_min = 15
drive = "{drive}"
[pad]
width_mm = 100
depth_mm = 100
[washer]
name = "iso7092-m3"
[coil]
name = "drum-44"
source = "an estimate"
outer_diameter_mm = 44
inner_diameter_mm = 16
length_mm = 20
turns = 1200
resistance_ohm = 12
inductance_mh = {inductance_mh}
core_diameter_mm = 16
core_relative_permeability = 1000
gap_mm = 1.5
grid = [2, 2]
{more}
"""


def drum(name: str, taxels: int, drive: str, inductance_mh: float = 61, more: str = "") -> Plan:
    """Plan a pad over four large coils, with any scheme and with empty places."""
    text = f'name = "{name}"\n' + DRUM.format(taxels=taxels, drive=drive, inductance_mh=inductance_mh, more=more)
    return make_plan(parse_spec(text))


def quick() -> Plan:
    """Plan a pad of one channel, so high that frames may be short."""
    return make_plan(parse_spec(QUICK))


QUICK = """
name = "quick"
resolution = 16
band_hz = [50, 400]
q_min = 15
resonances_hz = [300]
coil.grid = [4, 4]
"""

PADS: dict[str, tuple[Callable[[], Plan], int, float | None]] = {
    "one": (lambda: make_plan(load_spec("paper-16")), 8000, None),
    "quick": (quick, 8000, None),
    "tones": (lambda: drum("tones", 14, "tones", more='reuse = "alternate"'), 16000, None),
    "spur-free": (lambda: drum("spur-free", 16, "spur-free"), 16000, None),
    "no inductance": (lambda: drum("no-inductance", 12, "spur-free", 0), 16000, None),
    "carrier": (lambda: drum("carrier", 12, "spur-free"), 48000, 8000.0),
    "eleven": (lambda: make_plan(load_spec("wide-11")), 16000, None),
    "biased": (lambda: drum("biased", 13, "biased"), 16000, None),
    "time-shared": (lambda: drum("time-shared", 11, "time-shared", 10), 8000, None),
    "big": (lambda: make_plan(load_spec("big-512")), 8000, None),
}
"""Pads by name: the function that plans each, its samples a second, its carrier in Hz. Some coils have fewer taxels."""


FULL_V = 2000.0
"""Voltage limit above all that these pads ask for."""


def compiler(variable: str, name: str, package: str) -> str:
    """Return the path of a compiler, without which the firmware cannot be tested."""
    found = shutil.which(os.environ.get(variable, name))
    assert found, f"no compiler {os.environ.get(variable, name)!r}; make test installs {package}"
    return found


@dataclass(frozen=True)
class Run:
    """The result of a script: volts (samples, coils), answers in order, lines of the log."""

    volts: np.ndarray
    answers: list[Message | None]
    log: list[str]

    @property
    def begun(self) -> list[list[int] | None]:
        """The levels of every frame that began, None for a silence."""
        began = [line.split()[2:] for line in self.log if line.startswith("begin")]
        return [list(bytes.fromhex(levels[0])) if levels else None for _, *levels in began]

    @property
    def is_silent(self) -> bool:
        return "silent" in self.log[-2]


@dataclass(frozen=True)
class Host:
    """A compiled firmware in its folder, and the pad it was compiled for."""

    plan: Plan
    drive: PadDrive
    folder: Path

    @property
    def program(self) -> Path:
        return self.folder / "padgen_host"

    def number(self, name: str) -> int:
        """Return a whole number that the header defines."""
        text = (self.folder / FILE).read_text()
        return int(text.split(f"#define {name} ")[1].split()[0].rstrip("u"))

    def run(self, script: str, *options: str) -> Run:
        """Run the firmware with a script of `feed` and `run` lines."""
        volts, log = self.folder / "volts", self.folder / "log"
        command = [self.program, "script", "--volts", volts, "--log", log, *options]
        done = subprocess.run(command, input=script, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        sent = "".join(line.removeprefix("send ") for line in done.stdout.splitlines())
        answers, rest = decode(bytes.fromhex(sent))
        assert not rest
        samples = np.fromfile(volts, np.float32).reshape(-1, len(self.drive.coils)).astype(float)
        return Run(samples, answers, log.read_text().splitlines())

    @property
    def hello(self) -> str:
        """The line of a script that names the pad."""
        return feed(Message(Kind.HELLO, 0, plan_hash(self.plan)))

    def wait(self, samples: int) -> str:
        """Return lines of a script that let samples pass without tripping the watchdog."""
        step = self.number("PADGEN_WATCHDOG_SAMPLES") // 2
        pings = f"run {step}\n" + feed(Message(Kind.PING, 0))
        return pings * (samples // step) + f"run {samples % step}\n"


def feed(*messages: Message | bytes) -> str:
    """Return the line of a script that sends messages, or bytes."""
    return "feed " + b"".join(m if isinstance(m, bytes) else encode(m) for m in messages).hex() + "\n"


_compiled: dict[str, Host] = {}


def host(name: str, folders: pytest.TempPathFactory) -> Host:
    """Return the firmware of one of `PADS`, compiled once with all warnings as errors."""
    if name not in _compiled:
        make, rate_hz, carrier_hz = PADS[name]
        plan = make()
        # What is compared is not cut; those that ask for more than a pad's own limit have tests of theirs.
        drive = replace(make_drive(plan, rate_hz, carrier_hz=carrier_hz), voltage_limit_v=FULL_V)
        _compiled[name] = compiled(plan, drive, folders.mktemp("firmware"))
    return _compiled[name]


def compiled(plan: Plan, drive: PadDrive, folder: Path, header: Callable[[str], str] = str) -> Host:
    """Compile the firmware of a drive in a folder, with its header changed by `header`."""
    for name, data in firmware_files().items():
        (folder / name).write_bytes(data)
    (folder / FILE).write_text(header(c_header(plan, drive)))
    sources = sorted(path.name for path in folder.glob("*.c"))
    command = [compiler("CC", "cc", "gcc"), "-std=c99", *STRICT, *sources, "-lm", "-o", "padgen_host"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return Host(plan, drive, folder)
